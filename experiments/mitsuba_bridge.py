"""The same mesh, camera, light and material for Mitsuba 3 (the ``[peers]`` extra)."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

import jaxvis
from jaxvis.lighting import Environment
from jaxvis.scene import Camera, Scene

UPSAMPLING = 4
"""Mitsuba interpolates between texels, which jaxvis does not: finer texels make the two agree."""


def mitsuba_environment(environment: Environment) -> Float[np.ndarray, "rows columns 3"]:
    """The piecewise-constant map resampled to Mitsuba's pixel convention.

    Mitsuba's ``envmap`` puts row 0 on one pole and the last row on the other, columns at the
    centres of equal steps, and interpolates bilinearly. Each texel becomes UPSAMPLING^2; a node on
    the boundary between two rows takes their mean, which keeps their sum.
    """
    fine = np.asarray(environment.radiance).repeat(UPSAMPLING, axis=1)
    height = environment.height
    theta = np.arange(UPSAMPLING * height + 1) / UPSAMPLING
    above = np.clip(np.ceil(theta).astype(int) - 1, 0, height - 1)
    below = np.clip(np.floor(theta).astype(int), 0, height - 1)
    return (0.5 * (fine[above] + fine[below])).astype(np.float32)


def mitsuba_scene(
    mi: Any,
    scene: Scene,
    camera: Camera,
    environment: Environment,
    size: tuple[int, int],
    bsdf: dict[str, Any],
) -> Any:
    """A Mitsuba scene of the whole mesh with one BSDF, lit by the environment alone."""
    import trimesh

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.ply"
        mesh = trimesh.Trimesh(
            scene.positions, scene.triangles, vertex_normals=scene.normals, process=False
        )
        mesh.export(path, vertex_normal=True)
        eye, target = (np.asarray(v) - scene.origin for v in (camera.eye, camera.target))
        transform = mi.ScalarTransform4f().look_at(
            origin=eye.tolist(), target=target.tolist(), up=list(camera.up)
        )
        return mi.load_dict(
            {
                "type": "scene",
                "mesh": {"type": "ply", "filename": str(path), "bsdf": bsdf},
                "light": {
                    "type": "envmap",
                    "bitmap": mi.Bitmap(mitsuba_environment(environment)),
                },
                "sensor": {
                    "type": "perspective",
                    "fov": float(np.degrees(camera.field_of_view)),
                    "fov_axis": "y",
                    "near_clip": 1e-4 * scene.diagonal,
                    "far_clip": 1e4 * scene.diagonal,
                    "to_world": transform,
                    "film": {
                        "type": "hdrfilm",
                        "width": size[0],
                        "height": size[1],
                        "rfilter": {"type": "box"},
                        "pixel_format": "rgb",
                    },
                },
            }
        )


def direct_integrator(mi: Any) -> Any:
    """Mitsuba's direct light with multiple importance sampling, without the sky behind the scene.

    ``hide_emitters`` leaves pixels that miss the scene black, as jaxvis does.
    """
    return mi.load_dict({"type": "direct", "hide_emitters": True})


def load_mitsuba(variant: str | None = None) -> Any:
    """The mitsuba module with a variant set: the one named, else LLVM if it works, else scalar.

    Raises:
        ModuleNotFoundError: the ``[peers]`` extra is missing.
    """
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("Mitsuba 3 is missing: pip install 'jaxvis[peers]'") from error
    for name in [variant] if variant else ["llvm_ad_rgb", "scalar_rgb"]:
        try:
            mi.set_variant(name)
            mi.load_dict({"type": "sphere"})
        except (ImportError, RuntimeError, AttributeError):
            if variant:
                raise
        else:
            return mi
    raise ImportError("no variant of Mitsuba works here")


def white_diffuse(scene: Scene, albedo: float = 0.8) -> Scene:
    """The scene with every material replaced by one diffuse grey."""
    return _with_material(
        scene, jaxvis.Material(base_colour=(albedo,) * 3), jaxvis.reflectance.Lambert()
    )


def rough_metal(scene: Scene, roughness: float = 0.5) -> Scene:
    """The scene with every material replaced by a perfectly reflecting GGX metal."""
    material = jaxvis.Material(base_colour=(0.0,) * 3, specular=(1.0,) * 3, roughness=roughness)
    return _with_material(scene, material, jaxvis.reflectance.CookTorrance("ggx"))


def _with_material(scene: Scene, material: Any, reflectance: Any) -> Scene:
    from dataclasses import replace

    return replace(
        scene,
        materials=(material,),
        material_ids=np.zeros(len(scene.triangles), np.int32),
        colours=None,
        reflectance=reflectance,
    )


MITSUBA_BSDFS = {
    "diffuse": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8] * 3}},
    "metal": {
        "type": "roughconductor",
        "material": "none",
        "distribution": "ggx",
        "alpha": 0.25,
    },
}
"""What :func:`white_diffuse` and :func:`rough_metal` are in Mitsuba (alpha = roughness^2)."""
