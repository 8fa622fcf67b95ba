"""Real light probes (JAXVIS_DATA): the readers agree with each other and with what is known."""

import os
from pathlib import Path

import numpy as np
import pytest

from jaxvis.errors import JaxvisWarning
from jaxvis.lighting import load_environment
from jaxvis.lighting.files import read_pixels
from jaxvis.lighting.layouts import layout_of
from jaxvis.sphere import latlong

FOLDER = os.environ.get("JAXVIS_DATA", "")
PROBES = Path(FOLDER) / "probes"
pytestmark = pytest.mark.skipif(
    not FOLDER or not PROBES.is_dir(),
    reason="set JAXVIS_DATA to the folder with probes/ to test on real light probes",
)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def mean_luminance(environment):
    weights = latlong.row_solid_angles(environment.height, environment.width) / (4.0 * np.pi)
    return np.einsum("h,hwc,c->", weights, np.asarray(environment.radiance, float), LUMINANCE)


@pytest.fixture(scope="module")
def grove():
    """The eucalyptus grove from its cross and from its angular probe, at one size."""
    return [load_environment(PROBES / f"rnl_{kind}.hdr", height=64) for kind in ("cross", "probe")]


def test_cross_and_probe_hold_the_same_energy(grove):
    for environment in grove:
        assert mean_luminance(environment) == pytest.approx(1.177, abs=1e-3)


def test_cross_and_probe_agree_in_place_and_orientation(grove):
    cross, probe = (np.log(np.asarray(e.radiance) @ LUMINANCE) for e in grove)

    def correlation(one, other):
        return np.corrcoef(one.ravel(), other.ravel())[0, 1]

    assert correlation(cross, probe) > 0.99
    turned = [correlation(cross, np.roll(probe, k, axis=1)) for k in range(1, 128)]
    mirrored = [correlation(cross, np.roll(probe[:, ::-1], k, axis=1)) for k in range(128)]
    upside_down = correlation(cross, probe[::-1])
    assert max(turned) < 0.97
    assert max(mirrored) < 0.9
    assert upside_down < 0.9


def test_the_sky_is_above(grove):
    for environment in grove:
        rows = np.asarray(environment.radiance).mean(axis=(1, 2))
        assert rows[:32].mean() > 3.0 * rows[32:].mean()


def test_st_peters_cross_has_no_seams():
    """Steps across the faces' borders are no larger than steps beside them."""
    environment = load_environment(PROBES / "stpeters_cross.hdr", height=256)
    assert mean_luminance(environment) == pytest.approx(0.79, abs=0.02)
    values = np.log(np.asarray(environment.radiance) @ LUMINANCE + 1e-3)
    band = values[96:160]  # only side faces: borders at odd eighths of the turn
    steps = np.abs(np.diff(band, axis=1, append=band[:, :1])).mean(axis=0)
    for eighth in (1, 3, 5, 7):
        border = eighth * 64 - 1
        assert steps[border] < 2.0 * np.median(steps[border - 8 : border + 9])


def test_lat_long_probes_are_taken_as_stored():
    uffizi = load_environment(PROBES / "uffizi_latlong.hdr")
    assert (uffizi.height, uffizi.width) == (600, 1200)
    np.testing.assert_array_equal(
        uffizi.radiance, read_pixels(PROBES / "uffizi_latlong.hdr").astype(np.float32)
    )
    sun = load_environment(PROBES / "kloppenheim_05_1k.hdr")
    assert float(sun.radiance.max()) == 83456.0
    assert mean_luminance(sun.resize(64)) == pytest.approx(mean_luminance(sun), rel=1e-4)


def test_tiny_negative_values_are_mended_with_a_warning():
    with pytest.warns(JaxvisWarning, match=r"city\.exr: 299 of 524288 texels are negative"):
        city = load_environment(PROBES / "city.exr")
    assert float(city.radiance.min()) == 0.0


def test_data_sets_are_known_by_name():
    by_name = load_environment("uffizi")
    assert by_name.name == "uffizi"
    assert by_name.width == 1200


def test_layouts_are_told_by_shape():
    for name, layout in (("stpeters_cross", "vertical-cross"), ("rnl_probe", "angular")):
        assert layout_of(*read_pixels(PROBES / f"{name}.hdr").shape[:2]) == layout
