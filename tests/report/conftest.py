"""A hand-made comparison."""

import numpy as np
import pytest

from jaxvis.compare import Comparison, Yardstick
from jaxvis.image import exposure_of

WIDTH, HEIGHT = 24, 16
NASTY = "mc-mis:spp=4 <b>|&"


def sample_comparison() -> Comparison:
    """A reference, an exact copy of it, a slightly wrong method with a curve, and a failure."""
    random = np.random.default_rng(5)
    covered = np.zeros((HEIGHT, WIDTH), bool)
    covered[4:, 3:20] = True
    reference = random.gamma(2.0, 1.0, (HEIGHT, WIDTH, 3)).astype(np.float32)
    reference[~covered] = 0.0
    wrong = (1.1 * reference).astype(np.float32)
    yardstick = Yardstick(reference, covered, exposure_of(reference, covered))
    measured = {
        "precompute_s": 12.3,
        "light_s": 0.0021,
        "compile_s": 1.5,
        "frame_s": 0.25,
        "frames_timed": 5,
        "visibility_bytes": 123456,
        "rays_traced": 0,
        "evaluations": 4321,
        "notes": [],
    }
    rows = [
        {
            "method": "exact",
            "label": "exact",
            "parameters": {"rows": 3},
            "shading": "vertex",
            **yardstick.errors(reference),
            **measured,
            "image": "exact.exr",
            "png": "exact.png",
        },
        {
            "method": "mc-mis",
            "label": NASTY,
            "parameters": {"spp": 4, "compensation": False, "rows": None},
            "shading": None,
            **yardstick.errors(wrong),
            **{**measured, "frame_s": 0.02, "notes": ["half of it was <mended>"]},
            "curve": [
                {"spp": 1, "frame_s": 0.005, "psnr_db": 12.0},
                {"spp": 4, "frame_s": 0.02, "psnr_db": 18.0},
            ],
            "image": "mc-mis-spp-4-b.exr",
            "png": "mc-mis-spp-4-b.png",
        },
        {
            "method": "shadow-map",
            "label": "shadow-map",
            "parameters": {},
            "shading": None,
            **dict.fromkeys((*yardstick.errors(wrong), *measured)),
            "notes": [],
            "error": "12 edges <have> more than two faces",
        },
    ]
    results = {
        "schema": 1,
        "scene": "teapot",
        "environment": "windows",
        "size": [WIDTH, HEIGHT],
        "supersampling": 1,
        "reflectance": "Lambert()",
        "camera": {"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "field_of_view": 0.6},
        "scene_info": {
            "vertices": 10,
            "triangles": 12,
            "materials": 1,
            "covered_pixels": int(covered.sum()),
            "back_pixels": 17,
            "notes": ["3 zero-area faces were dropped"],
        },
        "environment_info": {"height": 8, "width": 16, "largest_radiance": 100.0},
        "notes": ["4 texels are negative"],
        "seed": 7,
        "created": "2025-01-02T03:04:05+00:00",
        "versions": {"jaxvis": "0.1.0", "jax": "0.10"},
        "machine": {"cpu": "a processor", "cores": 2, "memory_gib": 23.4},
        "metric": {"exposure": yardstick.exposure, "peak": 1.0, "transfer": "sRGB", "notes": []},
        "display": {"exposure": yardstick.exposure, "transfer": "sRGB"},
        "reference": {
            "method": "reference",
            "parameters": {"error": 0.005},
            "seconds": 3.0,
            "from_cache": True,
            "relative_error": 0.004,
            "rays_traced": 1000,
            "evaluations": 2000,
            "image": "reference.exr",
            "png": "reference.png",
            "notes": ["relative error 0.004, not 0.001"],
        },
        "results": rows,
    }
    images = {"reference": reference, "exact": reference, NASTY: wrong}
    background = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    return Comparison(results, images, covered.astype(np.float32), background)


@pytest.fixture(scope="session")
def comparison() -> Comparison:
    return sample_comparison()


@pytest.fixture(scope="session")
def nasty() -> str:
    """A label that every format must escape."""
    return NASTY
