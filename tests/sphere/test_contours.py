"""Contour integrals against closed forms, rasters and the float64 oracle of contour_oracle.py."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from jaxvis.sphere import contours, latlong
from jaxvis.sphere.contours import ContourTable, integrate, integrate_small
from jaxvis.sphere.polygons import subdivide

from .contour_oracle import (
    HEIGHT,
    WIDTH,
    about,
    arcs,
    as_jax,
    circle,
    contour_integral,
    directions_of,
    points_of,
    random_values,
    raster_integral,
    solid_angles,
    star,
    unit,
)

OCTANTS = [(r, c) for r in (5, 10) for c in (4, 12, 20, 28)]
POLES = [(0, 7), (15, 9)]
SEAM = [(7, 0), (8, 31)]

build = jax.jit(ContourTable.build)
vsat = jax.jit(contours.vsat, static_argnames=("lookup",))
integrals = jax.jit(integrate)
small_integrals = jax.jit(integrate_small)


@partial(jax.jit, static_argnames=("height", "lookup", "pieces"))
def trapezoid(height, directions, lookup, pieces=1):
    return contours.trapezoid(height, subdivide(directions, pieces), lookup)


def padded(polygons, vectors=(64, 512), count=(12, 64)):
    """Directions of few shapes, so that few programs are compiled: the last vector repeated."""
    most = max(len(points) for points in polygons)
    size = next(n for n in vectors if n >= most)
    full = [np.pad(p, ((0, size - len(p)), (0, 0)), mode="edge") for p in polygons]
    return directions_of(*full, *full[:1] * (next(n for n in count if n >= len(full)) - len(full)))


def whole_numbers(channels=2):
    """Of which every sum is exact in float32."""
    return np.random.default_rng(1).integers(0, 50, (HEIGHT, WIDTH, channels)).astype(float)


def light_and_direction(radiance):
    """Texel integrals [height, width, 4] of L and L times direction."""
    height = radiance.shape[0]
    l = latlong.texel_directions(height, 2 * height)
    weighted = radiance[..., None] * solid_angles(height)
    return np.concatenate([weighted, weighted * l], axis=-1)


def sun(height, centre, radius=0.25):
    """A bright disc on a dim sky."""
    l = latlong.texel_directions(height, 2 * height)
    return 0.05 + 50.0 * (l @ unit(centre) > np.cos(radius))


def split(table, *polygons, pieces=1, lookup="bilinear"):
    lookups = trapezoid(table.height, padded(polygons), lookup, pieces)
    return np.asarray(integrals(table, lookups), np.float64)[: len(polygons)]


def steered(table, luminous, *polygons, sharpness, lookup="bilinear"):
    lookups = vsat(luminous, [padded(polygons)], sharpness, lookup)
    return np.asarray(integrals(table, lookups), np.float64)[: len(polygons)]


# Known answers

CENTRES = [
    *(latlong.texel_directions(HEIGHT, WIDTH)[t] for t in OCTANTS + SEAM),
    *([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.2, 1.0, 0.1], [-0.1, -1.0, 0.3]),
]


@pytest.fixture(scope="module")
def uniform():
    return build(as_jax(light_and_direction(np.ones((128, 256)))))


@pytest.mark.parametrize("lookup", ["nearest", "bilinear"])
def test_caps_under_uniform_light(uniform, lookup):
    """Half angle 0.7: solid angle 2 pi (1 - cos 0.7), n . integral of l = pi sin^2 0.7."""
    centres = unit(np.array(CENTRES))
    got = split(uniform, *(circle(c, 0.7, 512) for c in centres), lookup=lookup)
    # All vectors of the caps about the poles are rounded the same way, by up to half a row.
    tolerance = 5e-4 if lookup == "bilinear" else 2.0 * (0.5 * np.pi / 128) / 0.7
    np.testing.assert_allclose(got[:, 0], 1.477540, rtol=tolerance)
    np.testing.assert_allclose((got[:, 1:] * centres).sum(-1), 1.303813, rtol=tolerance)


@pytest.mark.parametrize("lookup", ["nearest", "bilinear"])
def test_clockwise_polygons_have_minus_the_value(uniform, lookup):
    """Round a pole too: the whole sphere is added or taken as often as is needed."""
    polygons = [circle(c, 0.7, 64) for c in unit(np.array(CENTRES))]
    forwards = split(uniform, *polygons, lookup=lookup)
    backwards = split(uniform, *(p[::-1] for p in polygons), lookup=lookup)
    np.testing.assert_allclose(backwards, -forwards, atol=1e-5 * 4.0 * np.pi)


@pytest.mark.parametrize("texel", OCTANTS + POLES + SEAM)
def test_one_bright_texel_is_inside_or_it_is_not(texel):
    values = np.zeros((HEIGHT, WIDTH, 1))
    values[texel] = 1.0
    table = build(as_jax(values))
    centre = latlong.texel_directions(HEIGHT, WIDTH)[texel]
    around, opposite = circle(centre, 0.5, 64), circle(-centre, 0.5, 64)
    beside = circle(about(centre, np.array([2.0]), np.array([0.8]))[0], 0.5, 64)
    luminous = build(as_jax(values * latlong.texel_directions(HEIGHT, WIDTH)))
    expected = [[1.0], [0.0], [0.0]]
    np.testing.assert_allclose(split(table, around, opposite, beside), expected, atol=2e-3)
    got = steered(table, luminous, around, opposite, beside, sharpness=20.0)
    np.testing.assert_allclose(got, expected, atol=2e-3)


@given(
    u0=st.floats(0.0, 1.0),
    du=st.floats(0.02, 0.45),
    v=st.tuples(st.floats(0.3, 15.7), st.floats(0.3, 15.7)),
)
@example(u0=0.5703125, du=0.25, v=(1.0, 12.5))
@settings(max_examples=25, deadline=None)
def test_boxes_at_fractional_texels_are_exact(u0, du, v):
    """Edges along rows and columns, which no rule can get wrong; over the seam too.

    Seen from outside the panorama runs to the left: counter-clockwise is its clockwise.
    """
    v0, v1 = min(v), max(v)
    corners = np.array([[u0, v0], [u0 + du, v0], [u0 + du, v1], [u0, v1]])
    phi, theta = 2.0 * np.pi * corners[:, 0], np.pi * corners[:, 1] / HEIGHT
    points = np.stack(
        [np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1
    )
    values = random_values(2)
    rows = np.diff(np.clip(np.arange(HEIGHT + 1.0), v0, v1))
    across = np.arange(2 * WIDTH + 1.0)
    columns = np.diff(np.clip(across, u0 * WIDTH, (u0 + du) * WIDTH)).reshape(2, WIDTH).sum(0)
    expected = np.einsum("r,c,rcx->x", rows, columns, values)
    # Without padding, each vector of which may add 4e-7 of the whole (see integrate).
    lookups = trapezoid(HEIGHT, directions_of(points), "bilinear")
    got = np.asarray(integrals(build(as_jax(values)), lookups))[0]
    np.testing.assert_allclose(got, expected, atol=2e-6 * values.sum())


# Oracles

POLYGONS = {
    "north pole": [0.05, 1.0, 0.1],
    "south pole": [0.1, -1.0, 0.05],
    "north pole on the boundary's side": [0.9, 1.0, 0.1],
    "south pole on the boundary's side": [0.6, -1.0, -0.5],
    "seam": [0.05, 0.1, -1.0],
    "away": [0.3, 0.2, 1.0],
}


@pytest.mark.parametrize("centre", POLYGONS.values(), ids=POLYGONS.keys())
def test_oracle_and_trapezoid_against_a_raster(centre):
    rng = np.random.default_rng(3)
    values = random_values(3)
    points = star(rng, centre, 48)
    raster = raster_integral(values, points, unit(centre), samples=10)
    oracle = contour_integral(values, points)
    scale = values.sum(axis=(0, 1)).max()
    np.testing.assert_allclose(oracle, raster, atol=1e-3 * scale)
    got = split(build(as_jax(values)), arcs(points, 8))[0]
    np.testing.assert_allclose(got, oracle, atol=4e-4 * scale)


def test_polygons_with_holes_and_overlaps_against_a_raster():
    """Holes run clockwise; what is wound twice counts twice; bridges do not count."""
    rng = np.random.default_rng(4)
    values = random_values(2)
    centre = unit([0.2, -1.0, 0.3])
    outer, hole = star(rng, centre, 48, 0.8, 1.3), circle(centre, 0.4, 48)[::-1]
    holed = np.concatenate([outer, outer[:1], hole, hole[:1]])
    twice = about(centre, 4.0 * np.pi * np.arange(98) / 98, 0.6 + 0.4 * rng.random(98))
    scale = values.sum(axis=(0, 1)).max()
    got = split(build(as_jax(values)), arcs(holed, 5), arcs(twice, 5))
    for k, points in enumerate((holed, twice)):
        oracle = contour_integral(values, points)
        raster = raster_integral(values, points, centre, samples=8)
        np.testing.assert_allclose(oracle, raster, atol=2e-3 * scale)
        np.testing.assert_allclose(got[k], oracle, atol=1e-3 * scale)


def test_error_of_the_trapezoid_falls_with_the_square_of_the_pieces():
    rng = np.random.default_rng(5)
    values = light_and_direction(sun(64, [0.4, 0.7, -0.2], 0.6))
    polygons = [star(rng, unit(rng.normal(size=3)), 32) for _ in range(24)]
    oracle = np.stack([contour_integral(values, p) for p in polygons])
    table = build(as_jax(values))
    errors = [
        np.abs(split(table, *(arcs(p, s) for p in polygons)) - oracle).mean() for s in (1, 2, 4)
    ]
    in_the_program = np.abs(split(table, *polygons, pieces=2) - oracle).mean()
    np.testing.assert_allclose(in_the_program, errors[1], rtol=0.1)  # by chord, not by angle
    assert errors[1] < 0.45 * errors[0]
    assert errors[2] < 0.45 * errors[1]
    assert errors[2] < 0.12 * errors[0]


def four_lookups(values, points, lookup):
    """The untelescoped rule, edge by edge, with SummedAreaTable's own unwrapped lookups."""
    table = build(as_jax(values))
    height = table.height
    u, theta = (
        np.asarray(c, np.float64) for c in latlong.coordinates(jnp.asarray(points, jnp.float32))
    )
    x, y = u * 2 * height, theta * height / np.pi
    if lookup == "nearest":
        x, y = np.round(x), np.round(y)
    corners = np.asarray(table.corners, np.float64)

    def prefix(x, y):
        c, r = int(np.floor(x)) + height, min(int(np.floor(y)), height - 1)
        fx, fy = x + height - c, y - r
        upper = (1 - fx) * corners[r, c] + (fx * corners[r, c + 1] if fx > 0 else 0.0)
        lower = (1 - fx) * corners[r + 1, c] + (fx * corners[r + 1, c + 1] if fx > 0 else 0.0)
        return (1 - fy) * upper + fy * lower

    total, steps = 0.0, 0.0
    for k in range(len(points)):
        n = (k + 1) % len(points)
        step = np.mod(x[n] - x[k] + height, 2 * height) - height
        ahead, back = x[k] + step, x[n] - step
        run_at_start = prefix(ahead, y[k]) - prefix(x[k], y[k])
        run_at_end = prefix(x[n], y[n]) - prefix(back, y[n])
        total, steps = total - 0.5 * (run_at_start + run_at_end), steps + step
    return total + max(round(steps / (2 * height)), 0) * np.asarray(table.total)


@pytest.mark.parametrize("lookup", ["nearest", "bilinear"])
@pytest.mark.parametrize("centre", POLYGONS.values(), ids=POLYGONS.keys())
def test_telescoping_equals_the_sum_of_four_lookups(centre, lookup):
    values = random_values(2)
    points = star(np.random.default_rng(6), centre, 40)
    got = split(build(as_jax(values)), points, lookup=lookup)[0]
    expected = four_lookups(values, points, lookup)
    np.testing.assert_allclose(got, expected, atol=1e-5 * values.sum())


# Poles

HORIZONS = [np.array([np.cos(a), 0.0, np.sin(a)]) for a in np.linspace(0.1, 6.2, 12)]


def horizon(normal, count, turn):
    """The great circle about a horizontal normal."""
    across = np.cross(normal, [0.0, 1.0, 0.0])
    angle = 2.0 * np.pi * (np.arange(count) + turn) / count
    # (across, normal x across, normal) is right-handed.
    return np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(normal, across))


@pytest.mark.parametrize("turn", [0.0, 0.25, 0.5, 0.37])
@pytest.mark.parametrize("count", [32, 128])
def test_horizons_of_vertical_walls(count, turn):
    """They pass through both poles: rounding decides whether they wind round both or neither,
    and columns walked cannot tell the two apart, between which the whole sphere lies.
    """
    values = light_and_direction(sun(128, [0.6, 0.4, -0.5]))
    table = build(as_jax(values))
    polygons = [horizon(n, count, turn) for n in HORIZONS]
    l = latlong.texel_directions(512, 1024)
    fine = np.repeat(np.repeat(values[..., 0], 4, 0), 4, 1)  # where l varies within a texel, too
    total = np.abs(values[..., 0]).sum()
    for lookup in ("bilinear", "nearest"):
        got = split(table, *polygons, lookup=lookup)
        for normal, integral in zip(HORIZONS, got, strict=True):
            oracle = np.einsum("rc,rcx->x", fine / 16, (l @ normal > 0.0)[..., None])
            np.testing.assert_allclose(integral[0], oracle[0], atol=0.03 * total)
        errors = [
            abs((contour_integral(values, p) - e)[1:] @ n)
            for n, p, e in zip(HORIZONS, polygons, got, strict=True)
        ]
        assert max(errors) < (5e-3 if count == 32 else 1e-3) * total


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_a_vertex_on_a_pole(pole):
    values = random_values(3)
    table = build(as_jax(values))
    centre = unit([0.5, pole, 0.2])
    points = np.concatenate([star(np.random.default_rng(7), centre, 40, 1.0, 1.3), [[0, pole, 0]]])
    # Walking in to the pole and out again after the last vertex: a wedge is cut out.
    oracle = contour_integral(values, points)
    scale = values.sum(axis=(0, 1)).max()
    got = split(table, arcs(points, 12))[0]
    np.testing.assert_allclose(got, oracle, atol=1e-3 * scale)
    got = split(table, arcs(points, 12), lookup="nearest")[0]
    assert np.isfinite(got).all()


# vsat


def test_vsat_of_sharpness_zero_is_the_trapezoid():
    rng = np.random.default_rng(8)
    table = build(as_jax(random_values(3)))
    luminous = build(as_jax(random_values(3)))
    polygons = [star(rng, c, 48) for c in POLYGONS.values()]
    for lookup in ("nearest", "bilinear"):
        got = steered(table, luminous, *polygons, sharpness=0.0, lookup=lookup)
        np.testing.assert_allclose(got, split(table, *polygons, lookup=lookup), atol=2e-6)


@pytest.fixture(scope="module")
def concentrated():
    """Polygons of 16 edges under a small sun that lies near their outlines, with the truth."""
    rng = np.random.default_rng(9)
    height = 128
    centre = unit([0.5, 0.4, 0.6])
    values = light_and_direction(sun(height, centre, 0.06))
    polygons = []
    while len(polygons) < 60:
        axis = about(centre, 2.0 * np.pi * rng.random(1), rng.uniform(0.4, 1.0, 1))[0]
        polygons.append(star(rng, axis, 16))
    oracle = np.stack([contour_integral(values, p, step=0.5) for p in polygons])
    return build(as_jax(values)), build(as_jax(values[..., 1:])), polygons, oracle


@pytest.mark.parametrize("lookup", ["nearest", "bilinear"])
def test_vsat_beats_the_trapezoid_where_light_is_concentrated(concentrated, lookup):
    """And the wrong sign is worse than either; spec: about 5 / edge length is best."""
    table, luminous, polygons, oracle = concentrated

    def error(sharpness):
        got = steered(table, luminous, *polygons, sharpness=sharpness, lookup=lookup)
        return np.abs(got[:, 0] - oracle[:, 0]).mean()

    plain, paper, sharp, wrong = error(0.0), error(5.8), error(15.0), error(-5.8)
    assert paper < 0.85 * plain
    assert sharp < 0.6 * plain
    assert wrong > 1.3 * plain


def test_sharpness_may_differ_from_edge_to_edge():
    table = build(as_jax(random_values(3)))
    luminous = build(as_jax(random_values(3)))
    points = star(np.random.default_rng(10), [0.2, 0.8, 0.5], 48)
    one = steered(table, luminous, points, sharpness=7.0)
    same = steered(table, luminous, points, sharpness=jnp.full((1, 64), 7.0))
    np.testing.assert_allclose(same, one, atol=1e-6)
    other = steered(table, luminous, points, sharpness=jnp.linspace(0.0, 20.0, 64)[None])
    assert np.abs(other - one).max() > 1e-5


# What adds nothing


@pytest.mark.parametrize("sharpness", [None, 12.0])
def test_bridges_and_padding_add_nothing(sharpness):
    """Exactly where texels and weights are exact in float32, else to rounding."""
    values = whole_numbers()
    table, luminous = build(as_jax(values)), build(as_jax(random_values(3)))
    rng = np.random.default_rng(11)
    points = star(rng, [0.1, -0.6, 0.4], 40)
    loop = circle([0.1, -0.6, 0.4], 0.15, 22)[::-1]
    bridged = np.concatenate([points, points[:1], loop, loop[:1]])
    long = np.concatenate([points, np.repeat(points[-1:], 300, axis=0)])
    nothing = np.repeat(points[:1], 64, axis=0)
    for lookup in ("nearest", "bilinear"):
        run = (
            partial(split, table, lookup=lookup)
            if sharpness is None
            else partial(steered, table, luminous, sharpness=sharpness, lookup=lookup)
        )
        exact = lookup == "nearest" and sharpness is None
        tolerance = 0.0 if exact else 1e-4 * values.sum()
        plain, inner = run(points)[0], run(loop)[0]
        joined, none = run(bridged, nothing)
        np.testing.assert_allclose(joined, plain + inner, atol=tolerance)
        if sharpness is None:
            np.testing.assert_allclose(run(long)[0], plain, atol=tolerance)
        np.testing.assert_allclose(none, 0.0, atol=tolerance)


# Lookups


def test_repeating_texels_changes_only_the_nearest_lookup():
    """Which tends to the bilinear one."""
    rng = np.random.default_rng(12)
    values = random_values(2)
    polygons = [star(rng, c, 48) for c in POLYGONS.values()]
    bilinear = split(build(as_jax(values)), *polygons)
    distances = []
    for times in (1, 4, 16):
        finer = np.repeat(np.repeat(values, times, axis=0), times, axis=1) / times**2
        table = build(as_jax(finer))
        np.testing.assert_allclose(split(table, *polygons), bilinear, atol=1e-5 * values.sum())
        nearest = split(table, *polygons, lookup="nearest")
        distances.append(np.abs(nearest - bilinear).mean())
    assert distances[1] < 0.5 * distances[0]
    assert distances[2] < 0.5 * distances[1]


def test_small_polygons_are_precise():
    """Against the same lookups weighted in float64: the sphere's total is 3e4 times as large."""
    rng = np.random.default_rng(13)
    table = build(as_jax(random_values(3, height=256)))
    polygons = [circle(c, 0.02, 128) for c in unit(rng.normal(size=(50, 3)))]
    lookups = trapezoid(256, directions_of(*polygons), "nearest")
    corners = np.asarray(table.corners, np.float64).reshape(-1, 3)
    exact = np.einsum(
        "pk,pkc->pc", np.asarray(lookups.weight, np.float64), corners[np.asarray(lookups.index)]
    )
    exact += np.asarray(lookups.south)[:, None] * np.asarray(table.total, np.float64)
    scale = np.asarray(table.total).max()
    errors = [np.abs(f(table, lookups) - exact).mean() for f in (integrals, small_integrals)]
    assert errors[0] < 1e-6 * scale
    assert errors[1] < 2e-7 * scale
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("count", [3, 7, 32])
def test_sets_taken_in_turn_are_one_polygon(count):
    """Of any number of vectors."""
    table = build(as_jax(whole_numbers()))
    points = circle([0.3, 0.5, -0.7], 0.9, count)
    sets = subdivide(directions_of(points), 2)
    whole = np.stack([points_of(d)[0] for d in sets], axis=1).reshape(-1, 3)
    got = integrals(table, trapezoid(HEIGHT, directions_of(points), "nearest", 2))
    np.testing.assert_allclose(got[0], split(table, whole, lookup="nearest")[0], rtol=1e-6)


def test_build_needs_no_more_than_half_a_turn_beside_the_map():
    values = random_values(1)
    table = build(as_jax(values))
    assert (table.height, table.width) == (HEIGHT, WIDTH)
    assert table.corners.shape == (HEIGHT + 1, 2 * WIDTH + 1, 1)
    np.testing.assert_allclose(table.total, values.sum(axis=(0, 1)), rtol=1e-6)
    corners = np.asarray(table.corners)[..., 0]
    turn = corners[:, WIDTH:] - corners[:, : WIDTH + 1]  # the same from every column
    rows = np.concatenate([[0.0], values[..., 0].sum(axis=1).cumsum()])
    np.testing.assert_allclose(turn, np.broadcast_to(rows[:, None], turn.shape), atol=3e-6)
