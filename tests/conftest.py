"""Array annotations are checked (jaxtyping, beartype) in tests only."""

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")

from jaxtyping import install_import_hook

install_import_hook("jaxvis", "beartype.beartype")
