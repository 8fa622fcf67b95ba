"""NumPy's .npz files, read so that a damaged one is one kind of error."""

import os

import numpy as np


def read_npz(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """The arrays of a file, by name.

    Raises:
        ValueError: there is no such file, it is damaged or something else, or its arrays do not
            fit into memory.
    """
    try:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:
        # zipfile, zlib, NumPy and Python's parser have a dozen kinds, MemoryError among them:
        # a damaged header may ask for any size.
        raise ValueError(f"{path}: damaged or not a NumPy .npz file") from error
