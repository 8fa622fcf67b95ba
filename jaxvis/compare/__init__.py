"""Methods side by side: one scene, light and camera, one reference, one table."""

import sys
import types
from typing import Any

from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.frames import frame_range, render_frames
from jaxvis.compare.measurement import Yardstick, measure
from jaxvis.compare.render import Picture, render
from jaxvis.compare.result import Comparison, composite, file_stem, output_folder
from jaxvis.compare.run import choose_methods, compare
from jaxvis.compare.setting import Setting, checked_size, prepare, read_camera

__all__ = [
    "Comparison",
    "Picture",
    "Setting",
    "Yardstick",
    "checked_size",
    "choose_methods",
    "compare",
    "composite",
    "file_stem",
    "frame_range",
    "measure",
    "output_folder",
    "prepare",
    "read_camera",
    "render",
    "render_frames",
    "use_compilation_cache",
]


class _Callable(types.ModuleType):
    """``jaxvis.compare`` is a function to users, and to Python, once imported, this package."""

    def __call__(self, *arguments: Any, **settings: Any) -> Comparison:
        return compare(*arguments, **settings)


sys.modules[__name__].__class__ = _Callable
