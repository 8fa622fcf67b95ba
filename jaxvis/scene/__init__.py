"""The host world: meshes with materials, cameras, rays, and what each pixel sees."""

from jaxvis.scene.animation import Animation, moved_vertices
from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin import builtin_scenes
from jaxvis.scene.camera import Camera
from jaxvis.scene.framing import default_camera
from jaxvis.scene.info import SceneInfo, scene_info
from jaxvis.scene.load import load_animation, load_scene
from jaxvis.scene.rays import Hits, RayTracer
from jaxvis.scene.scene import Scene
from jaxvis.scene.surface import Surface
from jaxvis.scene.trace import trace_surface

__all__ = [
    "Animation",
    "Camera",
    "Hits",
    "RayTracer",
    "Scene",
    "SceneInfo",
    "Surface",
    "build_scene",
    "builtin_scenes",
    "default_camera",
    "load_animation",
    "load_scene",
    "moved_vertices",
    "scene_info",
    "trace_surface",
]
