"""NumPy's .npz files, read so that a damaged one is one kind of error."""

import os
from collections.abc import Sequence

import numpy as np


def read_npz(path: str | os.PathLike, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of a file, by name.

    Args:
        names: those that are wanted; all by default.

    Raises:
        ValueError: there is no such file, it is damaged or something else, or its arrays do not
            fit into memory.
        KeyError: an array is not in it.
    """
    try:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            wanted = file.files if names is None else [n for n in names if n in file.files]
            arrays = {name: file[name] for name in wanted}
    except Exception as error:
        # zipfile, zlib, NumPy and Python's parser have a dozen kinds, MemoryError among them:
        # a damaged header may ask for any size.
        raise ValueError(f"{path}: damaged or not a NumPy .npz file") from error
    for name in names or ():
        if name not in arrays:
            raise KeyError(name)
    return arrays
