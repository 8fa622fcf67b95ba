"""Frames of a session: those of the methods themselves, however the light is turned."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.methods import create
from jaxvis.scene import trace_surface
from jaxvis.view import Look, Session
from jaxvis.view.session import quicker
from tests.interaction import compilations, light, small
from tests.methods.known_scenes import MATERIALS, SCENES

BOX = SCENES[2].with_material(*MATERIALS["diffuse"])
SIZE = (24, 18)
POLYGONS = ("vectorized", "correspondence")


LIGHT = Environment(light(0).radiance * jnp.linspace(0.1, 4.0, 32)[:, None], "brighter on a side")


@pytest.fixture(scope="module")
def session(own_caches):
    return Session(BOX, LIGHT)


@pytest.mark.parametrize(
    ("name", "yaw"),
    [
        ("mc-mis", 0.0),
        ("mc-mis", -1.0),
        ("distance-field", math.pi / 2),
        ("vectorized", math.pi / 2),
        ("correspondence", -1.0),
    ],
)
def test_a_frame_is_what_the_method_makes_of_the_turned_light(session, name, yaw):
    agrees(session, name, yaw)


def test_gloss_turns_with_the_scene(own_caches):
    agrees(Session(SCENES[2].with_material(*MATERIALS["phong"]), LIGHT), "correspondence", 1.0)


def agrees(session, name, yaw):
    look = Look(small(name), BOX.camera, SIZE, yaw)
    method = create(look.method)
    scene = session.scene
    surface = trace_surface(scene, BOX.camera, SIZE)
    turned = method.light(session.environment.rotate(yaw))
    visibility = method.precompute(scene, progress=False)
    expected = np.asarray(method.shade(visibility, turned, surface, key=jax.random.key(3)))
    found = session.frame(look, seed=3)
    # Directions on the edge of a texel of the tables may fall into the next one.
    slack = 0.02 if name in POLYGONS else 1e-5
    scale = expected[found.setting.covered].mean()
    assert np.abs(found.radiance - expected).max() < slack * scale
    assert found.setting.environment.radiance.shape == session.environment.radiance.shape
    if yaw:  # turned, and the right way
        other = session.frame(replace(look, yaw=-yaw), seed=3)
        assert np.abs(other.radiance - expected).max() > 5.0 * slack * scale


@pytest.mark.parametrize("name", POLYGONS)
def test_turning_and_orbiting_compile_nothing(session, name):
    look = Look(f"{name}:vectors=16,resolution=16,zeta=0", BOX.camera, SIZE, 0.3)
    session.frame(look)
    with compilations() as found:
        session.frame(replace(look, yaw=1.1))
        session.frame(replace(look, yaw=1.4, camera=replace(BOX.camera, eye=(1.3, 2.6, 4.0))))
    assert found == []


def test_more_samples_come_nearer_to_the_reference(session):
    look = Look("mc-mis:spp=1", BOX.camera, SIZE, 0.5)
    truth = session.reference(look)
    first = session.frame(look)
    mean = first
    for seed in range(1, 16):
        mean = mean.with_more(session.frame(look, seed))
    assert mean.samples == 16
    assert mean.psnr(truth) > first.psnr(truth) + 8.0
    assert mean.error(truth).mean() < first.error(truth).mean()
    assert truth.error(truth)[truth.setting.covered].max(axis=0).tolist() == (
        truth.error(truth)[truth.setting.covered].min(axis=0).tolist()
    )


def test_pictures_show_the_scene_before_its_environment(session):
    frame = session.frame(Look("mc-mis:spp=4", BOX.camera, SIZE))
    shown = frame.shown(frame.exposure)
    assert shown.shape == (18, 24, 3)
    assert shown.dtype == np.uint8
    assert shown[~frame.setting.covered].size
    assert shown[~frame.setting.covered].max() > 0
    brighter = frame.shown(4.0 * frame.exposure)
    assert brighter.mean() > shown.mean()


def test_a_view_of_nothing_has_no_error(session):
    eye, target = np.asarray(BOX.camera.eye), np.asarray(BOX.camera.target)
    away = replace(BOX.camera, target=tuple((2.0 * eye - target).tolist()))
    frame = session.frame(Look("mc-mis:spp=1", away, SIZE))
    assert frame.psnr(frame) is None
    assert frame.shown(frame.exposure).max() > 0


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("correspondence:vectors=16,resolution=16,zeta=2", "zeta", 0.0),
        ("mc-mis:spp=16", "spp", 4),
    ],
)
def test_quick_frames_ask_for_less(session, name, parameter, value):
    look = Look(name, BOX.camera, SIZE, quick=True)
    method, size = quicker(create(name), SIZE)
    assert size == SIZE
    assert getattr(method, parameter) == value
    fewer = replace(
        look, method=name[: name.index(parameter)] + f"{parameter}={value}", quick=False
    )
    np.testing.assert_array_equal(session.frame(look).radiance, session.frame(fewer).radiance)


def test_quick_frames_of_other_methods_have_fewer_pixels(session):
    frame = session.frame(Look("mc-mis:spp=1", BOX.camera, SIZE, quick=True))
    assert frame.setting.size == (12, 9)


def test_few_methods_are_kept(session, monkeypatch):
    made = []
    small = Session(BOX, LIGHT)
    prepare = small._prepare
    monkeypatch.setattr(small, "_prepare", lambda name: made.append(name) or prepare(name))
    names = [f"mc-mis:spp={n}" for n in (1, 2, 3, 1, 4, 1, 2)]
    for name in names:
        small.frame(Look(name, BOX.camera, SIZE))
    assert [int(name[-1]) for name in made] == [1, 2, 3, 4, 2]


def test_unknown_methods_are_refused_and_nothing_is_lost(session):
    with pytest.raises(ValueError, match="no-such"):
        session.frame(Look("no-such", BOX.camera, SIZE))
    session.frame(Look("mc-mis:spp=1", BOX.camera, SIZE))
