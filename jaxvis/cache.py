"""Files that are whole or absent, and the folder of cached results (references, precomputation)."""

import contextlib
import glob
import hashlib
import json
import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jaxvis.errors import JaxvisWarning
from jaxvis.npz import read_npz

FORMAT = 4
"""Version of what is cached. Raise it when the meaning of a cached array changes."""


DIGEST = "sha256"
"""In a file's header: of all else that is in it."""


class OutdatedError(ValueError):
    """A whole file of jaxvis, written by another version."""


def cache_folder() -> Path:
    """``JAXVIS_CACHE`` if set, otherwise ``jaxvis`` in the user's cache folder."""
    if given := os.environ.get("JAXVIS_CACHE"):
        return Path(given).expanduser()
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "jaxvis"


def lock(file: BinaryIO, *, wait: bool) -> bool:
    """Locks an open file until it is closed; false if another has it, and this shall not wait.

    Where there are no locks (on Windows, on some network drives) everyone gets one.
    """
    return _locked(file, wait) is not False


def _locked(file: BinaryIO, wait: bool) -> bool | None:
    """Whether it is locked now; None where there are no locks."""
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except (ImportError, OSError):
        return None
    return True


@contextlib.contextmanager
def whole_file(path: str | os.PathLike) -> Iterator[Path]:
    """Yields a temporary path beside ``path``, renamed to it only if the block succeeds.

    The temporary name keeps the suffix, by which writers choose the format.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{path.stem}-"
    remove_leftovers(path.parent, prefix)
    handle, name = tempfile.mkstemp(prefix=prefix, suffix=path.suffix, dir=path.parent)
    temporary = Path(name)
    with os.fdopen(handle, "wb") as held:
        lock(held, wait=False)  # so that others see that it is not left over
        try:
            yield temporary
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


LEFT_AFTER = 60.0
"""Seconds after which something temporary that nobody holds is left over from a killed process."""


def remove_leftovers(folder: Path, prefix: str) -> None:
    """Removes temporary files, and folders with a file :data:`HELD`, of processes that were killed.

    Nothing is removed where there are no locks that would tell.
    """
    for path in folder.glob(f"{glob.escape(prefix)}*"):
        held = path / HELD if path.is_dir() else path
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime < LEFT_AFTER:
                continue
            with held.open("ab") as file:
                if _locked(file, wait=False):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()


HELD = ".held"
"""Locked in a temporary folder for as long as its process lives."""


def save_arrays(path: str | os.PathLike, kind: str, arrays: dict[str, Any], **header: Any) -> None:
    """Writes arrays and a JSON header of what they are, as one .npz file."""
    contents: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    facts = json.loads(json.dumps({"format": FORMAT, "kind": kind, **header}))
    text = json.dumps({**facts, DIGEST: content_hash(facts, contents)})
    with whole_file(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, allow_pickle=False, header=np.array(text), **contents)


def load_arrays(path: str | os.PathLike, kind: str) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Reads what :func:`save_arrays` wrote: (arrays, header).

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is damaged or holds something else.
        OutdatedError: a ValueError; the file is of another version.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        arrays = read_npz(path)
        header = json.loads(str(arrays.pop("header")))
        found = (header["format"], header["kind"])
        digest = header.pop(DIGEST, None)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: damaged or not a jaxvis file; delete it and rebuild") from error
    if found != (FORMAT, kind):
        error = ValueError if found[0] == FORMAT else OutdatedError
        raise error(
            f"{path}: holds {found[1]!r} of format {found[0]}, not {kind!r} of format {FORMAT}; "
            "delete it and rebuild"
        )
    if digest != content_hash(header, arrays):
        raise ValueError(f"{path}: its arrays are not those that were saved; delete and rebuild it")
    return arrays, header


def content_hash(*parts: Any) -> str:
    """SHA-256 (hex) of arrays (values, shape, dtype), strings, numbers, None, tuples and dicts."""
    digest = hashlib.sha256()
    for part in parts:
        _feed(digest, part)
    return digest.hexdigest()


def _feed(digest: Any, part: Any) -> None:
    if isinstance(part, (list, tuple)):
        digest.update(b"(")
        for item in part:
            _feed(digest, item)
        digest.update(b")")
    elif isinstance(part, dict):
        _feed(digest, sorted(part.items()))
    elif part is None or isinstance(part, (str, bytes, bool, int, float)):
        digest.update(f"{type(part).__name__}:{part!r};".encode())
    else:
        array = np.ascontiguousarray(part)
        digest.update(f"{array.dtype.str}{array.shape};".encode())
        digest.update(array.tobytes())


def cached_arrays(
    kind: str, key: str, build: Callable[[], dict[str, Any]]
) -> tuple[dict[str, np.ndarray], bool]:
    """The arrays cached under ``key``, or those of ``build``, stored for the next time.

    A damaged entry is rebuilt with a warning, one of an earlier version silently; a folder that
    cannot be written costs only the caching. Where another process builds the same, this one waits
    for what it stores. Returns (arrays, whether they came from the cache).
    """
    path = cache_folder() / kind / f"{key}.npz"
    with contextlib.nullcontext() if path.exists() else _alone(path):
        return _stored_or_built(path, kind, build)


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Holds a lock beside ``path``, after whoever holds it; a process that dies lets go.

    Without locks, or in a folder that cannot be written, processes may do the same work.
    """
    name = path.with_name(f".{path.stem}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = name.open("wb")
    except OSError:
        yield
        return
    with file:
        lock(file, wait=True)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                name.unlink(missing_ok=True)


def _stored_or_built(
    path: Path, kind: str, build: Callable[[], dict[str, Any]]
) -> tuple[dict[str, np.ndarray], bool]:
    if path.exists():
        try:
            return load_arrays(path, kind)[0], True
        except OutdatedError:
            pass
        except ValueError as error:
            warnings.warn(f"{error} (rebuilt now)", JaxvisWarning, stacklevel=3)
    arrays = {name: np.asarray(value) for name, value in build().items()}
    try:
        save_arrays(path, kind, arrays)
    except OSError as error:
        warnings.warn(f"{path}: not cached ({error.strerror})", JaxvisWarning, stacklevel=3)
    return arrays, False
