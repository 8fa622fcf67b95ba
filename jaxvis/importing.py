"""Imports without looking for garbage meanwhile, or ever again in what they made."""

import contextlib
import gc
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def uncollected_imports() -> Iterator[None]:
    """The collector neither runs within nor visits later what is there at the end.

    Importing makes no garbage, and looking for it takes a third of the time; at the end of the
    process it takes as long again. Does nothing where JAX is imported already: others' garbage
    would stay. OpenImageIO must not be among what is imported: at the end it complains, in a
    hundred lines, of what was not collected.
    """
    if "jax" in sys.modules or not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
