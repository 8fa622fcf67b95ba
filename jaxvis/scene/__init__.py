"""The host world: meshes with materials, cameras, rays, and what each pixel sees."""

from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin import builtin_scenes
from jaxvis.scene.camera import Camera
from jaxvis.scene.framing import default_camera
from jaxvis.scene.info import SceneInfo, scene_info
from jaxvis.scene.load import load_scene
from jaxvis.scene.rays import Hits, RayTracer
from jaxvis.scene.scene import Scene
from jaxvis.scene.surface import Surface
from jaxvis.scene.trace import trace_surface

__all__ = [
    "Camera",
    "Hits",
    "RayTracer",
    "Scene",
    "SceneInfo",
    "Surface",
    "build_scene",
    "builtin_scenes",
    "default_camera",
    "load_scene",
    "scene_info",
    "trace_surface",
]
