"""What worker processes need, sooner or later: the process that is forked imports this module.

None of it starts threads, which would not be forked with it.
"""

import importlib

from jaxvis.importing import uncollected_imports

MODULES = ("distributed", "jaxvis.sweep.work", "scipy.stats", "trimesh")

with uncollected_imports():  # workers share this memory for as long as nothing writes to it
    for name in MODULES:
        importlib.import_module(name)
