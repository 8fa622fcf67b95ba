"""Array annotations are checked (jaxtyping, beartype) in tests only; caches of their own."""

import contextlib
import ctypes
import os
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import pytest
from jaxtyping import install_import_hook

install_import_hook("jaxvis", "beartype.beartype")

# Most of a test's time is XLA's, which compiles programs that run once: it need not optimise them,
# and the older way to fuse them takes half as long. The flags are read with the first device; what
# tests start in processes of their own is compiled as users compile it.
jax.config.update("jax_disable_most_optimizations", True)
with pytest.MonkeyPatch.context() as patch:
    flags = os.environ.get("XLA_FLAGS", "")
    patch.setenv("XLA_FLAGS", f"{flags} --xla_cpu_use_fusion_emitters=false")
    jax.devices()


@pytest.fixture(scope="module")
def optimised():
    """Programs as users compile them, for tests of the last digits."""
    jax.clear_caches()
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", True)
    jax.clear_caches()


MOST_GIGABYTES = 3.0
"""That a test process holds before it lets go of its compiled programs: all come to over 6."""


@pytest.fixture(scope="module", autouse=True)
def bounded_memory():
    yield
    with contextlib.suppress(OSError, AttributeError):  # on systems that do not tell, or trim
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        if pages * os.sysconf("SC_PAGE_SIZE") > MOST_GIGABYTES * 1e9:
            jax.clear_caches()
            ctypes.CDLL("libc.so.6").malloc_trim(0)


@pytest.fixture(scope="session", autouse=True)
def no_user_cache(tmp_path_factory):
    """What the user has cached neither helps nor hinders a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXVIS_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def own_caches(tmp_path_factory):
    """References and compiled programs of a module's tests stay out of the user's cache."""
    folder = tmp_path_factory.mktemp("cache")
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(folder / "xla"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXVIS_CACHE", str(folder))
        yield folder
    jax.config.update("jax_compilation_cache_dir", before)
