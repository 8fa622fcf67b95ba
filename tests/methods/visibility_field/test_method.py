"""The two methods: parameters, names, keys, chunks, threads, caches, programs."""

import logging
from dataclasses import fields
from functools import cache

import jax
import numpy as np
import pytest

from jaxvis.cache import cache_folder
from jaxvis.errors import JaxvisWarning
from jaxvis.methods import Unculled, VisibilityField, create, names
from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field import FieldVisibility, estimate, method, stages
from jaxvis.scene import RayTracer
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted
from tests.methods.visibility_field.made_fields import VO, filled

SPP = 16
BOX = SCENES[2]
pytestmark = pytest.mark.usefixtures("own_caches")
SMALL = {"cell": 1.0, "masks": 6, "samples": 3_000, "rays": 16, "spp": SPP}


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch):
    monkeypatch.setattr(stages, "RAYS_PER_BLOCK", 64 * SPP)
    monkeypatch.setattr(estimate, "WEIGHED_AT_ONCE", 64 * SPP)


@cache
def surface_of(material="diffuse"):
    return BOX.surface(*MATERIALS[material])


def refusal(cls, name, value):
    """What a method of this class says to a parameter. Set behind the back of the type checks."""
    made = cls()
    object.__setattr__(made, name, value)
    with pytest.raises(ValueError, match=f"^{name} ") as error:
        made.__post_init__()
    return str(error.value)


@pytest.mark.parametrize("cls", [Unculled, VisibilityField])
@pytest.mark.parametrize(
    ("name", "value"),
    [("spp", 0), ("spp", -3), ("rays_per_chunk", 0), ("lighting", "moon")],
)
def test_bad_parameters_of_both_are_named(cls, name, value):
    message = refusal(cls, name, value)
    assert "\n" not in message
    assert str(value) in message
    if not isinstance(value, str):
        with pytest.raises(ValueError, match=f"^{name} "):
            cls(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("labels", "guess"),
        ("dilation", "guess"),
        ("masks", 0),
        ("masks", 256),
        ("cell", 0.0),
        ("cell", -1.0),
        ("cell", float("nan")),
        ("cell", float("inf")),
        ("samples", 0),
        ("rays", 0),
        ("sampling", "guess"),
        ("seed", -1),
    ],
)
def test_bad_parameters_of_the_field_are_named(name, value):
    message = refusal(VisibilityField, name, value)
    assert "\n" not in message
    assert str(value) in message


def test_parameters_are_the_fields():
    made = VisibilityField(cell=0.5, labels="paper")
    shown = made.parameters()
    assert list(shown) == [field.name for field in fields(VisibilityField)]
    assert (shown["cell"], shown["labels"], shown["spp"]) == (0.5, "paper", 64)
    assert Unculled(spp=8).parameters()["spp"] == 8
    assert hash(made) == hash(VisibilityField(cell=0.5, labels="paper"))


def test_the_registry_makes_them():
    assert {"visibility-field", "unculled"} <= set(names())
    assert create("visibility-field") == VisibilityField()
    assert create("unculled:spp=8,lighting=environment") == Unculled(8, "environment")
    made = create("visibility-field:cell=0.5,masks=12,labels=paper,conservative=false")
    assert made == VisibilityField(cell=0.5, masks=12, labels="paper", conservative=False)
    assert create("visibility-field:cell=none") == VisibilityField()
    with pytest.raises(ValueError, match="labels must be one of four-state, paper"):
        create("visibility-field:labels=some")
    with pytest.raises(ValueError, match="spp"):
        create("visibility-field:ssp=3")


def test_a_key_is_required():
    stored = filled(BOX.load(), VO)
    for made, visibility in ((Unculled(), stored.rays), (VisibilityField(), stored)):
        with pytest.raises(ValueError, match=rf"^{type(made).__name__}.shade needs key=") as error:
            made.shade(visibility, made.light(contrasted()), surface_of())
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("material", ["diffuse", "ggx"])
@pytest.mark.parametrize("lighting", ["harmonics", "environment"])
def test_the_same_key_gives_the_same_bits_for_any_chunk_and_threads(material, lighting):
    scene, surface = BOX.load(), surface_of(material)
    images = []
    for chunk, threads in ((1, 1), (128 * SPP, 3), (1 << 21, 2)):
        tracer = RayTracer(scene.positions, scene.triangles, threads=threads)
        stored = filled(scene, VO, tracer=tracer)
        options = {"spp": SPP, "lighting": lighting, "rays_per_chunk": chunk}
        for made, visibility in (
            (VisibilityField(**options), stored),
            (Unculled(**options), RayVisibility(scene.positions, scene.triangles, tracer)),
        ):
            light = made.light(contrasted())
            images.append(made.shade(visibility, light, surface, key=jax.random.key(7)))
            other = made.shade(visibility, light, surface, key=jax.random.key(8))
            assert not np.array_equal(images[-1], other)
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_evaluations_are_the_rays_of_the_covered_pixels():
    stored, surface = filled(BOX.load(), VO), surface_of()
    expected = 5 * int(np.sum(surface.mask))
    for made, visibility in ((Unculled(5), stored.rays), (VisibilityField(spp=5), stored)):
        assert made.evaluations(visibility, made.light(contrasted()), surface) == expected


def test_unculled_keeps_nothing_but_the_tree():
    visibility = Unculled().precompute(BOX.load())
    assert isinstance(visibility, RayVisibility)
    assert visibility.tracer is BOX.load().tracer


def cached_files():
    return sorted((cache_folder() / "visibility-masks").glob("*.npz"))


def precomputed(**options):
    """A field, and the rays that it took."""
    scene = BOX.load()
    before = scene.tracer.rays_traced
    stored = VisibilityField(**{**SMALL, **options}).precompute(scene, progress=False)
    return stored, scene.tracer.rays_traced - before


def same_fields(one, other):
    return all(
        np.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    )


def test_masks_are_traced_once_whatever_is_made_of_them():
    first, traced = precomputed(seed=1)
    assert isinstance(first, FieldVisibility)
    assert traced == 3_000 * 16
    files = cached_files()
    again, none = precomputed(seed=1)
    assert none == 0
    assert same_fields(first, again)
    for options in ({"labels": "paper"}, {"spp": 3}, {"conservative": False}):
        assert precomputed(seed=1, **options)[1] == 0
    assert cached_files() == files
    for options in ({"seed": 2}, {"samples": 2_000}, {"masks": 5}, {"cell": 1.5}):
        other, traced = precomputed(**{"seed": 1, **options})
        assert traced > 0
        assert not same_fields(first, other)


def test_damaged_masks_are_traced_again_with_a_warning():
    files = cached_files()
    first, _ = precomputed(seed=3)
    (path,) = set(cached_files()) - set(files)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.warns(JaxvisWarning, match="damaged"):
        again, traced = precomputed(seed=3)
    assert traced == 3_000 * 16
    assert same_fields(first, again)
    assert precomputed(seed=3)[1] == 0  # stored anew


def test_cells_are_a_share_of_the_diagonal_if_no_size_is_given():
    stored = VisibilityField(masks=2, samples=500, rays=4).precompute(BOX.load(), progress=False)
    expected = BOX.load().diagonal / method.CELLS_ALONG_DIAGONAL
    assert float(stored.grid.edge) == pytest.approx(expected, rel=1e-6)


def test_a_saved_field_shades_alike(tmp_path):
    stored, _ = precomputed()
    stored.save(tmp_path / "field.npz")
    made = VisibilityField(**SMALL)
    light = made.light(contrasted())
    loaded = FieldVisibility.load(tmp_path / "field.npz")
    image, expected = (
        made.shade(visibility, light, surface_of(), key=jax.random.key(0))
        for visibility in (loaded, stored)
    )
    np.testing.assert_array_equal(image, expected)
    assert loaded.rays_traced > 0


@pytest.mark.parametrize("material", ["diffuse", "ggx"])
@pytest.mark.parametrize("lighting", ["harmonics", "environment"])
def test_another_frame_compiles_nothing(material, lighting, caplog):
    """Another key, other rays left to trace."""
    stored = precomputed()[0]
    for made, visibility in (
        (VisibilityField(**SMALL, lighting=lighting), stored),
        (Unculled(SPP, lighting), stored.rays),
    ):
        light = made.light(contrasted())
        first = made.shade(visibility, light, surface_of(material), key=jax.random.key(0))
        with jax.log_compiles(), caplog.at_level(logging.WARNING):
            caplog.clear()
            second = made.shade(visibility, light, surface_of(material), key=jax.random.key(1))
        assert [r.message for r in caplog.records if "ompil" in r.message] == []
        assert not np.array_equal(first, second)
