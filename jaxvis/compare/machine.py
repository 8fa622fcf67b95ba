"""What the numbers were measured with: versions and hardware, but no names of hosts or people."""

import os
import platform
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import jax

from jaxvis.cores import core_count

LIBRARIES = ("jaxvis", "jax", "jaxlib", "numpy", "embreex")


def versions() -> dict[str, str | None]:
    """Versions of Python and of the libraries that results depend on."""
    return {"python": platform.python_version()} | {name: _version(name) for name in LIBRARIES}


@cache
def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, memory in GiB, platform and JAX's device."""
    return {
        "cpu": _processor(),
        "cores": core_count(),
        "memory_gib": _memory(),
        "platform": f"{platform.system()} {platform.machine()}",
        "jax_backend": jax.default_backend(),
        "jax_device": jax.devices()[0].device_kind,
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def _memory() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return None
