"""Real models and light probes by name: from a local folder, or downloaded once and checked.

``JAXVIS_DATA`` names a folder with ``models/``, ``scenes/``, ``probes/`` and ``terrain/``, and is
looked in first. A file that is not there is downloaded from its pinned address into the cache
folder, and refused unless its SHA-256 is the known one. Files that were converted from their
upstream have no address: they are found in ``JAXVIS_DATA`` only.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pooch

from jaxvis import specs
from jaxvis.cache import cache_folder

Kind = Literal["scene", "probe"]


@dataclass(frozen=True)
class Dataset:
    """A file: where it lies in the data folder, what it hashes to, and where it comes from."""

    name: str
    kind: Kind
    file: str
    sha256: str
    source: str | None = None
    """``OWNER/REPO@COMMIT:PATH`` on GitHub; None for converted files."""

    @property
    def url(self) -> str | None:
        """Address of exactly these bytes."""
        if self.source is None:
            return None
        repository, _, path = self.source.partition(":")
        return f"https://raw.githubusercontent.com/{repository.replace('@', '/')}/{path}"


_TABLE = (
    Dataset(
        "duck",
        "scene",
        "models/duck.glb",
        "65bf938f54d6073e619e76e007820bbf980cdc3dc0daec0d94830ffc4ae54ab5",
        "sbtron/glTF-Sample-Models@54e8526ddf5f0bd1b075fadb7f42b63ce88c3da1"
        ":2.0/Duck/glTF-Binary/Duck.glb",
    ),
    Dataset(
        "utah-teapot",
        "scene",
        "models/teapot.obj",
        "153ba534a7f04c32f86a274432c4a2b290a248a385ed93e0d171bde9faf9c335",
        "gyng/raytracer-assets@4643f60f255056b85d4ea0ffa1137affe5d27734:models/teapot.obj",
    ),
    Dataset(
        "bunny",
        "scene",
        "models/bunny.obj",
        "c93e4a6fc6423194ff8b24de372d0a0632264290302a11d391f832313a0d55ef",
        "kayru/Probulator@ad916bda84a6383ec34a69eaf2f3444bfef6026d:Data/Models/bunny.obj",
    ),
    Dataset(
        "sponza",
        "scene",
        "scenes/sponza.glb",
        "873302c580df2368235305ad142b19df17137474f457ef24e53f50bde8f1fd20",
    ),
    Dataset(
        "bistro",
        "scene",
        "scenes/bistro.ply",
        "c745276d6ee6a89519f5bb04b730fb24dbb75f035d1d1c29d6d10054a7485121",
    ),
    Dataset(
        "sibenik",
        "scene",
        "scenes/sibenik.ply",
        "797f3ddacb5db2e3db02cfddaaab1db5e38b59c2678b871a07acd9c750dd33a0",
    ),
    Dataset(
        "delft",
        "scene",
        "scenes/delft.ply",
        "b8e3ca1d3c40c5990c6376a5fdacfb68b647329974ca3ef505224911acab73a8",
    ),
    Dataset(
        "bigtujunga",
        "scene",
        "terrain/bigtujunga.npz",
        "28a30dc28c564d0a91c65c10a2cf27169c1f9bf69c059b793d5839b4452f346c",
    ),
    Dataset(
        "stpeters",
        "probe",
        "probes/stpeters_cross.hdr",
        "7faeab624a196fcdddd6baa1f838b2f935a08b0a3b152cd2321e22d8132daefb",
        "patriciogonzalezvivo/glslViewer@ba904816fed8809532ed112b3ac9c2ec61538b7a"
        ":examples/stpeters_cross.hdr",
    ),
    Dataset(
        "uffizi",
        "probe",
        "probes/uffizi_latlong.hdr",
        "71107c21de29ebae9295904572ab25856a433017706a7c483528c17aa79d1e29",
        "tatsy/spica@9c1485eae242a13cff18f7cedc88962ed2538168:tests/data/uffizi.hdr",
    ),
    Dataset(
        "rnl",
        "probe",
        "probes/rnl_cross.hdr",
        "93e7ef8ac85e57744a8f261e8d971f511b9305acdf03dac6ce57403d517f1988",
        "patriciogonzalezvivo/glslViewer@ba904816fed8809532ed112b3ac9c2ec61538b7a"
        ":examples/rnl_cross.hdr",
    ),
    Dataset(
        "rnl-probe",
        "probe",
        "probes/rnl_probe.hdr",
        "48ece612940742870f68c4fa2b05f8823be7fd3e37375982fa6a1edcb55847a9",
        "patriciogonzalezvivo/glslViewer@216abfa28264bb43c0e5f0bb162df791e2088cc1"
        ":examples/rnl_probe.hdr",
    ),
    Dataset(
        "kloppenheim",
        "probe",
        "probes/kloppenheim_05_1k.hdr",
        "42bea3f025fd616169560422783d5cebde209867280295537f1d2f37bc1e3208",
        "gkjohnson/3d-demo-data@a79b5400ba8ed5bdeffebc10ce5adeecda7c3ebc"
        ":hdri/kloppenheim_05_1k.hdr",
    ),
    Dataset(
        "city",
        "probe",
        "probes/city.exr",
        "70940108df90c0721799d29f758ca79e67e509d9a2636487e639db7779561524",
    ),
)

_BY_NAME = {dataset.name: dataset for dataset in _TABLE}


def names(kind: Kind | None = None) -> tuple[str, ...]:
    """Names of the data sets, of one kind or all."""
    return tuple(d.name for d in _TABLE if kind in (None, d.kind))


def describe(name: str) -> Dataset:
    """The table's entry for ``name``.

    Raises:
        ValueError: there is no such data set; the message lists those that there are.
    """
    if name not in _BY_NAME:
        raise ValueError(specs.unknown(name, _BY_NAME, "data set"))
    return _BY_NAME[name]


def find(name: str) -> Path:
    """Where the data set's file lies on this machine, after a download if need be.

    Raises:
        ValueError: there is no such data set, or the downloaded file is not the known one.
        FileNotFoundError: the file is not in ``JAXVIS_DATA`` and cannot be downloaded.
    """
    dataset = describe(name)
    folder = os.environ.get("JAXVIS_DATA")
    if folder and (path := Path(folder).expanduser() / dataset.file).is_file():
        return path
    where = f"not in JAXVIS_DATA ({folder})" if folder else "JAXVIS_DATA is not set"
    if dataset.url is None:
        raise FileNotFoundError(
            f"data set {name!r}: {where}, and the file has no public address; "
            f"set JAXVIS_DATA to a folder that holds {dataset.file}"
        )
    return _download(dataset, dataset.url, where)


def _download(dataset: Dataset, url: str, where: str) -> Path:
    target = cache_folder() / "datasets" / dataset.file
    try:
        pooch.retrieve(
            url, known_hash=f"sha256:{dataset.sha256}", path=target.parent, fname=target.name
        )
    except ValueError as error:
        raise ValueError(
            f"data set {dataset.name!r}: {url} does not have the known SHA-256; "
            f"set JAXVIS_DATA to a folder that holds {dataset.file}"
        ) from error
    except OSError as error:
        raise FileNotFoundError(
            f"data set {dataset.name!r}: {where}, and {url} cannot be downloaded "
            f"({type(error).__name__}); set JAXVIS_DATA to a folder that holds {dataset.file}"
        ) from error
    return target
