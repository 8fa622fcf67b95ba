"""XLA's persistent cache: a second run on the same machine does not compile again."""

import jax

from jaxvis.cache import cache_folder


def use_compilation_cache() -> None:
    """Keeps compiled programs in ``cache_folder()/xla``, unless the user chose a folder."""
    if jax.config.values["jax_compilation_cache_dir"] is None:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "xla"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
