"""Functions on arrays that Numba compiles, for what goes through lists step by step (host)."""

import inspect
from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compiles a function, once and for all: the code is kept on disk, and it leaves the
    interpreter to other threads while it runs.

    Numba looks for changes in the function's own file only: after an edit of a compiled function
    that another file calls, delete ``__pycache__``.
    """
    # Type checks, which tests wrap around every function, cannot be compiled.
    return njit(cache=True, nogil=True)(inspect.unwrap(function))
