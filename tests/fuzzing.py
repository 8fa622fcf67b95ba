"""Files changed at random, and what jaxvis does with them: ``python -m tests.fuzzing KIND ...``.

Every file ends in use or in one clear line: no traceback, no hang, no crash, no memory blow-up. A
crash ends the process; the last line printed says on which file.
"""

import argparse
import contextlib
import io
import json
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from jaxvis import cli
from jaxvis.compare import read_camera
from jaxvis.errors import JaxvisWarning
from jaxvis.image import write_image
from jaxvis.methods.registry import create
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sweep import Grid, read_grid
from jaxvis.sweep.store import Store
from tests.bad_files import CORNERS, glb, ply

SECONDS = 20.0
"""Longer than this is a hang."""

MEGABYTES = 500.0
"""More than this for a file of kilobytes is a blow-up."""

INTERESTING = [b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999", b"4294967295", b"", b"\n"]
INTERESTING += [b"\x00" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"{", b"[", b'"', b"null", b"-"]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        name: of the file.
        content: of a good one.
        use: reads it; raises what a user would see.
    """

    name: str
    content: Callable[[], bytes]
    use: Callable[[Path], object]


class Problem(Exception):
    """What a file should not have done."""


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """One to eight changes: bytes, runs of bytes, words, pieces left out, doubled or swapped."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        size = len(changed)
        if size == 0:
            break
        # Half of the changes go to the beginning, where headers are.
        reach = size if rng.random() < 0.5 else min(size, 256)
        a, b = sorted(int(rng.integers(0, reach)) for _ in range(2))
        match int(rng.integers(0, 9)):
            case 0:
                changed[a] ^= 1 << int(rng.integers(0, 8))
            case 1:
                changed[a] = int(rng.integers(0, 256))
            case 2:
                run = slice(a, min(a + int(rng.integers(1, 9)), size))
                changed[run] = rng.bytes(run.stop - run.start)
            case 3:
                word = INTERESTING[int(rng.integers(0, len(INTERESTING)))]
                changed[a : a + len(word)] = word
            case 4:
                changed[a:a] = INTERESTING[int(rng.integers(0, len(INTERESTING)))]
            case 5:
                del changed[a : min(b, a + 64)]
            case 6:
                changed[b:b] = changed[a : min(b, a + 64)]
            case 7:
                span = min(8, b - a)
                one, other = changed[a : a + span], changed[b : b + span]
                if len(one) == len(other):
                    changed[a : a + span], changed[b : b + span] = other, one
            case 8:
                if rng.random() < 0.3:
                    del changed[b:]
    return bytes(changed)


def info(path: Path) -> None:
    """Through the command line, which has the rules for what is printed."""
    printed, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        code = cli.main(["info", str(path)])
    lines = [x for x in errors.getvalue().splitlines() if not x.startswith("jaxvis: warning: ")]
    if code == 0 and not lines:
        return
    if code != 2 or len(lines) != 1 or not lines[0].startswith("jaxvis: "):
        raise Problem(f"exit code {code} with {lines}")
    if path.name not in lines[0]:
        raise Problem(f"does not name the file: {lines[0]}")


def picture(suffix: str) -> Callable[[], bytes]:
    def content() -> bytes:
        pixels = np.random.default_rng(0).uniform(0.1, 9.0, (16, 32, 3)).astype(np.float32)
        with tempfile.TemporaryDirectory() as folder:
            write_image(Path(folder) / f"light{suffix}", pixels)
            return (Path(folder) / f"light{suffix}").read_bytes()

    return content


def saved(spec: str) -> tuple[Callable[[], bytes], Callable[[Path], object]]:
    """A method's visibility of a box on a plane, and its class's ``load``."""

    @cache
    def build():
        return create(spec).precompute(builtin_scene("box-on-plane"), progress=False)

    def content() -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            build().save(Path(folder) / "saved.npz")
            return (Path(folder) / "saved.npz").read_bytes()

    return content, lambda path: type(build()).load(path)


def terrain() -> bytes:
    z = np.random.default_rng(0).uniform(0.0, 2.0, (12, 9)).astype(np.float32)
    content = io.BytesIO()
    np.savez_compressed(content, z=z, dx=0.5)
    return content.getvalue()


def results() -> bytes:
    camera = {"eye": [1.0, 2.0, 3.0], "target": [0, 0, 0], "up": [0, 1, 0], "field_of_view": 0.7}
    row = {"method": "mc-mis", "psnr_db": 31.5, "parameters": {"spp": 4}}
    return json.dumps({"schema": 1, "camera": camera, "results": [row]}, indent=2).encode()


def grid() -> bytes:
    return b"""scene = ["plane", "sphere-on-plane"]
size = [16, 12]
seed = [0, 1]

[[methods]]
name = "vectorized"
zeta = [0, 1.5]
"""


def rows() -> bytes:
    with tempfile.TemporaryDirectory() as folder, Store(folder) as store:
        for number, job in enumerate(Grid(("mc-mis",), seed=(0, 1, 2)).jobs()):
            store.append(job, {"psnr_db": 30.0 + number, "error": None})
        return (Path(folder) / "rows.jsonl").read_bytes()


def open_rows(path: Path) -> None:
    with Store(path.parent) as store:
        store.write_tables(Grid(("mc-mis",), seed=(0, 1, 2)).jobs())


def gltf() -> bytes:
    """The JSON of a .glb, with its buffer in it."""
    import base64

    data = glb()
    length = int.from_bytes(data[12:16], "little")
    content = json.loads(data[20 : 20 + length])
    binary = base64.b64encode(data[28 + length :]).decode()
    content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{binary}"
    return json.dumps(content).encode()


OBJ = f"mtllib none.mtl\n{CORNERS}vt 0 0\nvt 1 0\nvt 1 1\nvn 0 1 0\nusemtl red\n"
OBJ += "f 1/1/1 2/2/1 3/3/1\nf 1 4 2\nf 2 4 3\nf 3 4 1\n"
STL = "solid s\nfacet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 1 0 0\nendloop\n"
STL += "endfacet\nendsolid s\n"
VISIBILITIES = {
    "polygons": "vectorized:vectors=16,resolution=16",
    "correspondence": "correspondence:vectors=16,resolution=16",
    "distances": "distance-field:resolution=8,lights=8",
    "field": "visibility-field:cell=2",
    "cones": "hybrid-cones",
    "rays": "mc-mis",
}

KINDS = {
    "glb": Kind("mesh.glb", glb, info),
    "gltf": Kind("mesh.gltf", gltf, info),
    "obj": Kind("mesh.obj", OBJ.encode, info),
    "ply": Kind("mesh.ply", ply, info),
    "stl": Kind("mesh.stl", STL.encode, info),
    "terrain": Kind("terrain.npz", terrain, info),
    "hdr": Kind("light.hdr", picture(".hdr"), info),
    "exr": Kind("light.exr", picture(".exr"), info),
    "pfm": Kind("light.pfm", picture(".pfm"), info),
    "results": Kind("results.json", results, read_camera),
    "grid": Kind("grid.toml", grid, read_grid),
    "rows": Kind("rows.jsonl", rows, open_rows),
}
KINDS |= {name: Kind("saved.npz", *saved(spec)) for name, spec in VISIBILITIES.items()}


@contextlib.contextmanager
def _within(seconds: float) -> Iterator[None]:
    def late(*_: object) -> None:
        raise Problem(f"not done in {seconds:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def peak_megabytes() -> float:
    """The most memory that this process had."""
    try:
        # Other than what getrusage says, this does not begin with what the parent process had.
        status = Path("/proc/self/status").read_text()
        return int(status.partition("VmHWM:")[2].split()[0]) / 1024.0
    except (OSError, ValueError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def tried(use: Callable[[Path], object], path: Path) -> str | None:
    """What is wrong with how a file was used or refused, if anything."""
    before = peak_megabytes()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with _within(SECONDS):
                use(path)
        except (ValueError, OSError) as error:
            if "\n" in str(error) or not str(error):
                return f"not one line: {error!r}"
            if path.name not in str(error) and path.name not in str(getattr(error, "filename", "")):
                return f"does not name the file: {error}"
        except (Exception, SystemExit) as error:
            return f"{type(error).__name__}: {error}"
    grown = peak_megabytes() - before
    if grown > MEGABYTES:
        return f"took {grown:.0f} MB"
    strange = [w for w in caught if not issubclass(w.category, JaxvisWarning)]
    return f"{strange[0].category.__name__}: {strange[0].message}" if strange else None


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzzing", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--files", type=int, default=1000, help="of each kind")
    parser.add_argument("--keep", type=Path, help="folder for files that did what they should not")
    options = parser.parse_args(arguments)
    found = 0
    for name in options.kinds or KINDS:
        kind, start, bad = KINDS[name], time.perf_counter(), 0
        content = kind.content()
        rng = np.random.default_rng([options.seed, *name.encode()])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / kind.name
            path.write_bytes(content)
            if problem := tried(kind.use, path):
                print(f"{name}: the good file: {problem}")
                bad += 1
            for number in range(options.files):
                data = mutated(content, rng)
                path.write_bytes(data)
                print(f"{name} {number}", end="\r", flush=True)
                if problem := tried(kind.use, path):
                    print(f"{name} {number}: {problem}")
                    bad += 1
                    if options.keep is not None:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / f"{number}-{kind.name}").write_bytes(data)
        print(f"{name}: {options.files} files, {bad} bad, {time.perf_counter() - start:.1f} s")
        found += bad
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
