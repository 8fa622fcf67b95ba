"""The precompute: known masks, brute force, and the same bits whatever the threads."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from jaxvis.methods.visibility_field import build
from jaxvis.methods.visibility_field.build import (
    Settings,
    trace_masks,
    traced_size,
    visibility_field,
)
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.methods.visibility_field.masks import (
    dilated,
    half_dilated,
    halved,
    with_neighbours,
)
from jaxvis.reflectance import Material
from jaxvis.scene import RayTracer
from jaxvis.scene.builtin import builtin_scene
from tests.methods.visibility_field.mask_oracle import all_samples, sets, traced_masks

STRATEGIES = ["random", "stratified"]


def traced(scene, **settings):
    return trace_masks(scene, Settings(**settings), progress=False)


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_an_open_plane_sees_the_upper_half_and_nothing_else(sampling):
    masks = traced(builtin_scene("plane"), edge=2.5, samples=10_000, rays=128, sampling=sampling)
    # The plane's normal is +y, the map's second axis; an even map has no texel across the horizon.
    upper = np.zeros((18, 18), bool)
    upper[:, 9:] = True
    assert len(masks.keys) >= 16
    assert masks.counts.sum() == 10_000
    assert not masks.occluded.any()
    many = masks.counts > 200
    assert many.sum() >= 16
    np.testing.assert_array_equal(masks.visible[many], np.tile(upper.reshape(-1), (many.sum(), 1)))
    assert not masks.visible[:, ~upper.reshape(-1)].any()


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_a_two_sided_plane_sees_everything(sampling):
    scene = builtin_scene("plane").with_materials((Material(two_sided=True),))
    masks = traced(scene, edge=5.0, samples=10_000, rays=128, sampling=sampling)
    assert masks.visible[masks.counts > 800].all()
    assert not masks.occluded.any()


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_a_closed_room_is_occluded_all_around(sampling):
    scene = builtin_scene("furnace")
    masks = traced(scene, edge=1.0, samples=20_000, rays=64, sampling=sampling)
    assert not masks.visible.any()
    assert masks.occluded.mean() > 0.45  # at the edges of the room cells look more than one way
    grid = Grid.covering(scene.positions, 1.0)
    assert np.all(visibility_field(scene, grid, masks, size=18).visible == 0)


@pytest.mark.parametrize("sampling", STRATEGIES)
@pytest.mark.parametrize(("name", "size"), [("box-on-plane", 18), ("sphere-on-plane", 5)])
def test_masks_are_those_of_brute_force(name, size, sampling):
    scene = builtin_scene(name)
    settings = Settings(edge=1.5, size=size, samples=400, rays=24, sampling=sampling, seed=3)
    masks = trace_masks(scene, settings, progress=False)
    visible, occluded = traced_masks(scene, settings)
    assert sets(masks.keys, masks.visible) == visible
    assert sets(masks.keys, masks.occluded) == occluded
    assert occluded


def test_counts_and_keys_are_those_of_the_samples():
    scene = builtin_scene("sphere-on-plane")
    settings = Settings(edge=0.4, size=2, samples=10_000, rays=1)
    masks = trace_masks(scene, settings, progress=False)
    cells = np.array([cell for *_, cell in all_samples(scene, settings)])
    keys, counts = np.unique(cells, return_counts=True)
    np.testing.assert_array_equal(masks.keys, keys)
    np.testing.assert_array_equal(masks.counts, counts)
    assert masks.keys.dtype == masks.counts.dtype == np.int32
    # Each sample has one ray, which left a bit.
    assert np.all((masks.visible | masks.occluded).any(axis=1))


@pytest.mark.parametrize("sampling", STRATEGIES)
def test_threads_and_batches_change_no_bit(sampling, monkeypatch):
    scene = builtin_scene("box-on-plane")
    settings = Settings(edge=0.5, size=5, samples=3 * build.DRAWN + 77, rays=16, sampling=sampling)
    results = []
    for threads in (1, 2, 5):
        clone = replace(scene)
        clone.__dict__["tracer"] = RayTracer(scene.positions, scene.triangles, threads=threads)
        results.append(trace_masks(clone, settings, progress=False))
        assert clone.tracer.rays_traced == settings.samples * settings.rays
        assert clone.tracer.embree_seconds > 0.0
    monkeypatch.setattr(build, "BATCH", build.DRAWN)
    monkeypatch.setattr(build, "TRACED", 1000)
    results.append(trace_masks(scene, settings, progress=False))
    assert all(same(result, results[0]) for result in results[1:])
    other = trace_masks(scene, settings._replace(seed=1), progress=False)
    assert not same(other, results[0])


def test_a_block_of_rays_is_traced_as_any_other_and_counted():
    scene = builtin_scene("sphere-on-plane")
    rng = np.random.default_rng(0)
    origins = rng.uniform(-3.0, 3.0, (500, 3)).astype(np.float32)
    directions = rng.normal(size=(500, 3)).astype(np.float32)
    tracer = RayTracer(scene.positions, scene.triangles)
    blocked = tracer.occluded_block(origins, directions)
    assert tracer.rays_traced == 500
    assert 0 < blocked.sum() < 500
    np.testing.assert_array_equal(blocked, tracer.occluded(origins, directions))


def test_more_rays_than_a_block_holds():
    scene = builtin_scene("plane", cells=1)
    masks = traced(scene, edge=20.0, samples=3, rays=build.TRACED + 1)
    assert masks.counts.sum() == 3
    assert masks.visible.any(axis=0).sum() == 162


def test_progress_goes_to_a_bar_or_nowhere(capfd):
    scene = builtin_scene("plane", cells=1)
    settings = Settings(edge=5.0, samples=500, rays=4)
    trace_masks(scene, settings, progress=False)
    assert capfd.readouterr() == ("", "")
    trace_masks(scene, settings)
    out, err = capfd.readouterr()
    assert out == ""
    assert "visibility field" in err
    assert "500/500" in err


@pytest.mark.parametrize("where", ["first block", "fourth block", "bar"])
def test_an_interrupt_ends_it_within_a_batch(where, monkeypatch):
    scene = builtin_scene("plane", cells=1)
    monkeypatch.setattr(build, "TRACED", 256)
    trace, calls = RayTracer.occluded_block, []

    def counted(self, origins, directions):
        calls.append(len(origins))
        if len(calls) == {"first block": 1, "fourth block": 4}.get(where):
            raise KeyboardInterrupt
        return trace(self, origins, directions)

    class Bar(build.tqdm):
        def update(self, n=1):
            raise KeyboardInterrupt

    monkeypatch.setattr(RayTracer, "occluded_block", counted)
    if where == "bar":
        monkeypatch.setattr(build, "tqdm", Bar)
    with pytest.raises(KeyboardInterrupt):
        traced(scene, edge=1.0, samples=3 * build.BATCH, rays=16)
    # One batch has 16384 blocks. Some are begun before the first thread's end is noticed.
    assert len(calls) < 8000
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if name.startswith("jaxvis-field")]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edge": 0.0}, "edge must be a positive length, got 0.0"),
        ({"edge": float("nan")}, "edge must be a positive length, got nan"),
        ({"edge": float("inf")}, "edge must be a positive length, got inf"),
        ({"size": 0}, "size must be from 1 to 255 texels, got 0"),
        ({"size": 256}, "size must be from 1 to 255 texels, got 256"),
        ({"samples": 0}, "samples must be at least 1, got 0"),
        ({"rays": 0}, "rays must be at least 1, got 0"),
        ({"sampling": "poisson"}, "sampling must be random or stratified, got 'poisson'"),
        ({"seed": -1}, "seed must not be negative, got -1"),
    ],
)
def test_bad_settings_say_what_is_wrong(change, message):
    settings = Settings(1.0)._replace(**change)
    with pytest.raises(ValueError, match=message):
        settings.check()
    with pytest.raises(ValueError, match=message):
        trace_masks(builtin_scene("plane"), settings, progress=False)


@pytest.mark.parametrize("dilation", ["full", "half", "none"])
@pytest.mark.parametrize("neighbours", [False, True])
def test_the_field_holds_the_grown_masks_and_their_counts(dilation, neighbours):
    scene = builtin_scene("sphere-on-plane")
    grid = Grid.covering(scene.positions, 1.0)
    fine = traced_size(9, dilation)
    masks = traced(scene, edge=1.0, size=fine, samples=5000, rays=16)
    options = {"size": 9, "dilation": dilation, "neighbours": neighbours}
    field = visibility_field(scene, grid, masks, **options)
    for bit, raw, count in ((1, masks.visible, field.visible), (2, masks.occluded, field.occluded)):
        seen = halved(raw, 9) if dilation == "half" else raw
        expected = {
            "full": lambda raw: dilated(raw, 9, 1),
            "half": lambda raw: half_dilated(raw, 9),
            "none": lambda raw: raw,
        }[dilation](raw)
        if neighbours:
            expected = expected | with_neighbours(grid, masks.keys, seen)
        found = (field.texels() & bit).reshape(len(masks.keys), -1) > 0
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(count, expected.sum(axis=1))
    np.testing.assert_array_equal(field.keys, masks.keys)
    assert field.grid is grid
    assert field.tracer is scene.tracer


def test_masks_are_kept_a_bit_a_texel(monkeypatch):
    scene = builtin_scene("sphere-on-plane")
    settings = {"edge": 1.0, "size": 14, "samples": 5000, "rays": 16}
    masks = traced(scene, **settings)
    assert masks.visible_bits.shape == (len(masks.keys), 25)
    assert masks.visible.shape == (len(masks.keys), 14 * 14)
    grid = Grid.covering(scene.positions, 1.0)
    whole = visibility_field(scene, grid, masks, size=7, dilation="half", neighbours=True)
    monkeypatch.setattr(build, "CELLS_AT_ONCE", 5)
    assert same(traced(scene, **settings), masks)
    parts = visibility_field(scene, grid, masks, size=7, dilation="half", neighbours=True)
    np.testing.assert_array_equal(parts.words, whole.words)


def test_cells_without_samples_have_no_row():
    scene = builtin_scene("plane")
    grid = Grid.covering(scene.positions, 0.5)
    masks = traced(scene, edge=0.5, samples=50, rays=4, sampling="random")
    surface = np.unique(cell_of(grid, scene.positions + np.float32([0.01, 0.0, 0.01])))
    assert len(masks.keys) <= 50 < len(surface)
    assert np.all(masks.counts > 0)


def test_field_arguments_must_fit_the_masks():
    scene = builtin_scene("plane")
    grid = Grid.covering(scene.positions, 5.0)
    masks = traced(scene, edge=5.0, size=4, samples=50, rays=4)
    with pytest.raises(ValueError, match="the masks have 4 x 4 texels, not 8 x 8"):
        visibility_field(scene, grid, masks, size=4, dilation="half")
    with pytest.raises(ValueError, match="the masks have 4 x 4 texels, not 5 x 5"):
        visibility_field(scene, grid, masks, size=5)


def test_stratified_samples_miss_less_than_random_ones():
    """Ornaments have little surface: random samples leave their cells nearly unseen."""
    from tests.methods.visibility_field.test_samples import floor_with_ornaments

    scene = floor_with_ornaments()
    truth = traced(scene, edge=1.0, samples=200_000, rays=64)
    missing = {}
    for sampling in STRATEGIES:
        masks = traced(scene, edge=1.0, samples=6000, rays=64, sampling=sampling)
        found = dict(zip(masks.keys.tolist(), dilated(masks.visible, 18, 1), strict=True))
        nothing = np.zeros(18 * 18, bool)
        missing[sampling] = sum(
            int(np.sum(seen & ~found.get(key, nothing)))
            for key, seen in zip(truth.keys.tolist(), truth.visible, strict=True)
        )
    assert missing["stratified"] < 0.2 * missing["random"]
