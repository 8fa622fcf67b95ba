# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#       jupytext_version: 1.19.6
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Discrete visibility fields
#
# A path tracer asks of each ray whether it leaves the scene. In a courtyard the answer is nearly
# always the same for neighbours: towards the wall no, straight up yes. A *discrete visibility
# field* (paper 001) asks once for all. It puts a grid over the scene and keeps, for each cell, two
# coarse maps of directions: where *some* point of the cell sees the sky, and where *some* point is
# blocked. At runtime the renderer draws the same rays as before, and traces only those that the
# maps leave open.
#
# So this method, unlike those of the other notebooks, interpolates nothing. Its image is that of
# Monte Carlo with the same rays, as long as no ray is decided wrongly. This notebook looks at the
# grid and its maps, at what is traced and what is not, at time, and at how errors come about.

# %%
import time
from dataclasses import replace

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.colors import ListedColormap

import jaxvis
from jaxvis.image import display, exposure_of, relative_rmse
from jaxvis.methods.traced import shading_points
from jaxvis.methods.visibility_field import cull
from jaxvis.methods.visibility_field.estimate import cosine_rays
from jaxvis.methods.visibility_field.hemisphere import (
    local_directions,
    shifts,
    world_directions,
)
from jaxvis.report import beside_errors

scene = jaxvis.load_scene("courtyard:triangles=20000")
scene = scene.with_reflectance(jaxvis.reflectance.Lambert())
environment = jaxvis.load_environment("sky:elevation=0.9,azimuth=4.2").resize(64)
size = (240, 180)
camera = jaxvis.default_camera(scene, aspect=size[0] / size[1])
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)
key = jax.random.key(0)

method = jaxvis.VisibilityField(samples=300_000)
start = time.perf_counter()
field = method.precompute(scene, progress=False)
print(f"{len(scene.triangles)} triangles, {scene.diagonal:.1f} from corner to corner")
print(f"precomputed in {time.perf_counter() - start:.1f} s, {field.rays_traced:,} rays")
print(f"grid of {' x '.join(map(str, field.grid.shape))} cells, edge {field.grid.edge:.3f}")
print(f"{len(field.keys):,} of {field.grid.cells:,} cells hold surface")
print(
    f"{field.nbytes / 1e6:.2f} MB; a byte a texel in every cell: {field.dense_bytes / 1e6:.1f} MB"
)

# %% [markdown]
# ## The grid
#
# Cells are cubes; by default the scene's diagonal is 96 of them. Only those that hold surface are
# kept, with two bits a texel where the paper's layout has a byte for each texel of every cell,
# border included. Below, the view, and the same view with a random colour for the cell that each
# pixel's point lies in.

# %%
points = shading_points(surface)  # the pixels that see the scene, as lists
decisions, _ = cull.rules(field, method.labels, conservative=method.conservative)
table = cull.Table.of(field, decisions)
rows = np.asarray(cull.locate(table, points))
print(f"{np.sum(rows < 0)} of {len(rows)} pixels lie in cells that no sample fell into")

unculled = jaxvis.Unculled(spp=64)
unmasked = unculled.precompute(scene)
light = unculled.light(environment)
truth = np.asarray(unculled.shade(unmasked, light, surface, key=key))
exposure = exposure_of(truth, mask)

colours = np.random.default_rng(1).uniform(0.25, 1.0, (len(field.keys), 3))
figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
axes[0].imshow(np.where(mask[..., None], display(truth, exposure), 1))
axes[0].set_title("64 rays a pixel, all traced")
tinted = np.ones((mask.size, 3))
tinted[points.pixel] = np.where(rows[:, None] < 0, 0, colours[rows])
axes[1].imshow(tinted.reshape(*mask.shape, 3))
axes[1].set_title("cells")
for axis in axes:
    axis.set_axis_off()

# %% [markdown]
# ## The masks of one cell
#
# Directions are kept on the octahedral map: the sphere's eight octants, folded out onto a square of
# 18 x 18 texels. Shown here, +Z is in the middle and -Z at all four corners, +X at the middle of
# the right edge and +Y (up) at the middle of the top. The horizon runs across the middle, and for
# directions towards -Z along the left and right edges: what is above the middle is above it.
#
# A sample point $s$ of the surface sends 128 rays over its hemisphere. For each texel its
# *visibility mask* says whether one of them got out and its *occlusion mask* whether one was
# blocked. The cell $c$ takes what any of its samples saw (paper 001, eqs. 5 and 6):
#
# $$V_c(\omega) = \bigvee_{s \in c} V_s(\omega), \qquad
# O_c(\omega) = \bigvee_{s \in c} O_s(\omega).$$
#
# Two bits make four states: nobody looked there; all see the sky; all are blocked; they disagree.
# Here are three cells: one in the middle of the court's floor, one in the gallery beside it, and
# one on the roof.

# %%
state_names = ["nobody looked", "visible", "occluded", "both"]
state_colours = ListedColormap(["#d9d9d9", "#f5c542", "#35557a", "#a03c78"])


def nearest_cell(place):
    """Row of the cell with surface whose middle is nearest to a place."""
    index = np.stack(np.unravel_index(field.keys, field.grid.shape), axis=-1)
    middle = np.asarray(field.grid.origin) + (index + 0.5) * float(field.grid.edge)
    return int(np.argmin(np.linalg.norm(middle - np.asarray(place), axis=-1)))


def draw_states(axis, states):
    """An octahedral map of states with +Y up."""
    axis.imshow(states.T, origin="lower", cmap=state_colours, vmin=-0.5, vmax=3.5)
    axis.set_xticks([-0.5, 8.5, 17.5], ["-X", "", "+X"])
    axis.set_yticks([-0.5, 8.5, 17.5], ["-Y", "", "+Y"])
    axis.text(8.5, 8.5, "+Z", ha="center", va="center", bbox={"fc": "white", "alpha": 0.8})


low, high = scene.positions.min(axis=0), scene.positions.max(axis=0)
places = {
    "the court's floor": (0.0, low[1], 0.0),
    "the gallery's floor": (0.0, low[1], 0.75 * high[2]),
    "the roof": (0.0, high[1], 0.95 * high[2]),
}
chosen = {name: nearest_cell(place) for name, place in places.items()}
states = field.texels()
figure, axes = plt.subplots(1, 3, figsize=(11, 3.9), layout="constrained")
for axis, (name, row) in zip(axes, chosen.items(), strict=True):
    draw_states(axis, states[row])
    axis.set_title(name)
bar = figure.colorbar(axes[0].images[0], ax=axes, ticks=range(4))
bar.set_ticklabels(state_names)

# %% [markdown]
# The lower halves of the floors' maps are grey: no ray of their hemispheres points down. Over the
# court there is sky between the walls, which all of the cell's points see ("occluded"). From the
# gallery there is a sliver towards -Z, over the opposite wall and under the arch. (It is in two
# pieces because the top edge is folded there: its left half meets its right half.) Sky is framed by
# "both": the skyline, which moves as one moves through the cell. Over the gallery nothing else is
# left. On the roof nearly everything is visible.
#
# How does a map come about? Left, what the samples saw, with few of them and with more. A texel
# that they missed is filled in two ways before the field is stored: maps grow by half a texel
# (`dilation="half"`), and, since the field is `conservative`, what the six neighbouring cells saw
# is added.

# %%
row = chosen["the court's floor"]
steps = {
    "as seen, 20,000 samples": {"samples": 20_000, "dilation": "none", "conservative": False},
    "as seen, 80,000 samples": {"samples": 80_000, "dilation": "none", "conservative": False},
    "grown": {"samples": 80_000, "conservative": False},
    "grown, neighbours added": {"samples": 80_000},
}
figure, axes = plt.subplots(1, 4, figsize=(13, 3.4), layout="constrained")
for axis, (name, parameters) in zip(axes, steps.items(), strict=True):
    other = replace(method, **parameters).precompute(scene, progress=False)
    draw_states(axis, other.texels()[np.searchsorted(other.keys, field.keys[row])])
    axis.set_title(name)
bar = figure.colorbar(axes[0].images[0], ax=axes, ticks=range(4))
bar.set_ticklabels(state_names)

# %% [markdown]
# ## Which rays are traced
#
# jaxvis decides by state: a ray towards "visible" is *accepted* without tracing, one towards
# "occluded" is *dropped*, and "both" and "nobody looked" are *traced* (`labels="four-state"`).
#
# The paper (Algorithm 2) gives each cell a label instead. Where most directions are occluded (eqs.
# 7 and 8) it traces what may be visible, drops the rest and adds up light; elsewhere it traces what
# may be occluded, accepts the rest, and takes what is blocked off the unshadowed irradiance (eq.
# 11). A "both" texel is traced either way, but so are all "visible" ones of the first kind of cell
# and all "occluded" ones of the second.
#
# The decisions for 64 cosine-weighted rays a pixel, in the view from above and in one of the roof:


# %%
def decided(view):
    """The shaded points of a view, their rays, and an image of the share of each decision."""
    points = shading_points(view)
    rays = cosine_rays(table, local_directions(64), jnp.int32(size[0]), shifts(key), points)
    images = np.full((3, mask.size), np.nan)
    outcome = np.asarray(rays.decision)
    images[:, points.pixel] = [(outcome == k).mean(axis=1) for k in range(3)]
    return points, rays, images.reshape(3, *mask.shape)


from_above = jaxvis.Camera(eye=(-15, 30, 18), target=(0, 3, 0), field_of_view=0.7)
roof = jaxvis.trace_surface(scene, from_above, size)
names = {cull.ACCEPT: "accepted", cull.DROP: "dropped", cull.TRACE: "traced"}
figure, axes = plt.subplots(2, 3, figsize=(12, 6.4), layout="constrained")
for line, view in zip(axes, (surface, roof), strict=True):
    images = decided(view)[2]
    for axis, (number, name) in zip(line, names.items(), strict=True):
        shown = axis.imshow(images[number], vmin=0, vmax=1, cmap="viridis")
        axis.set_title(f"{name}: {np.nanmean(images[number]):.1%} of the rays")
        axis.set_axis_off()
figure.colorbar(shown, ax=axes, label="share of a pixel's rays")
plt.show()

# %% [markdown]
# In the court most rays are dropped, in the galleries nearly all; little of the sky is seen from
# everywhere in a cell. On the roof it is the other way round. What is left to trace lies along
# skylines, and in cells that hold both sides of something thin.
#
# The decisions can be checked against the tracer, ray by ray.

# %%
points, rays, _ = decided(surface)
outcome = np.asarray(rays.decision)
directions = np.stack(world_directions(*rays.directions), axis=-1)
origins = np.broadcast_to(np.asarray(points.origin)[:, None], directions.shape)
above = np.asarray(cull.above_plane(points, tuple(np.moveaxis(directions, -1, 0))))
blocked = scene.tracer.occluded(origins.reshape(-1, 3), directions.reshape(-1, 3))
free = ~np.asarray(blocked).reshape(outcome.shape) & above
for name, wrong in {
    "accepted, but blocked": (outcome == cull.ACCEPT) & ~free,
    "dropped, but free": (outcome == cull.DROP) & free,
}.items():
    print(f"{name:22} {wrong.sum():5d} of {wrong.size:,} rays, in {wrong.any(axis=1).sum()} pixels")

# %% [markdown]
# ## Time
#
# `Unculled` is the same estimator without a field: the same rays, all traced. What the two images
# differ by is thus what wrong decisions cost (the *error* below: root mean square difference over
# the mean radiance). Times are the better of two frames after the one that compiles.


# %%
def frame(method, visibility):
    """(image, seconds, rays traced) of a warm frame."""
    light = method.light(environment)
    seconds = []
    for _ in range(3):
        before, start = visibility.rays_traced, time.perf_counter()
        image = np.asarray(method.shade(visibility, light, surface, key=key))
        seconds.append(time.perf_counter() - start)
    return image, min(seconds[1:]), visibility.rays_traced - before


lines = []
for spp in (16, 64, 128):
    without, slow, every = frame(jaxvis.Unculled(spp=spp), unmasked)
    image, fast, left = frame(replace(method, spp=spp), field)
    line = {"rays a pixel": spp, "ms without": 1e3 * slow, "ms with": 1e3 * fast}
    line |= {"times faster": slow / fast, "traced without": every, "traced with": left}
    lines.append(line | {"share": left / every, "error": relative_rmse(image, without, mask)})
pd.DataFrame(lines).round(3)

# %% [markdown]
# (`traced without` counts rays above the plane of their triangle; the others need no tracer.) Time
# gains less than rays do, since rays are drawn, looked up and added up in both. The paper reports
# 3.0 to 3.5 times for Sponza on a GPU (table 1).
#
# ## Errors
#
# A ray is decided wrongly where a cell holds a point whose view no sample stood for. There are two
# remedies: more samples a cell, and less trust. Four states trace what nobody looked at in any
# case; `conservative=True` adds to each cell what its neighbours saw, so that where they disagree,
# too, rays are traced. The paper's settings trust: they take what nobody looked at for blocked or
# free, as the label says, but grow masks by a whole texel. (`control_variate=False` keeps label-0
# cells to the same rays, so that the error is that of wrong decisions alone.)

# %%
settings = {
    "conservative": {},
    "not conservative": {"conservative": False},
    "paper": {
        "labels": "paper",
        "conservative": False,
        "dilation": "full",
        "sampling": "random",
        "control_variate": False,
    },
}


def measured(variant):
    """Share of the rays above their planes that are traced, error, and the field."""
    stored = variant.precompute(scene, progress=False)
    before = stored.rays_traced
    image = np.asarray(variant.shade(stored, light, surface, key=key))
    traced = (stored.rays_traced - before) / above.sum()
    return traced, relative_rmse(image, truth, mask), stored


lines = []
for name, parameters in settings.items():
    for samples in (20_000, 80_000, 300_000):
        traced, error, stored = measured(replace(method, samples=samples, **parameters))
        lines.append({"settings": name, "samples": samples, "traced": traced, "error": error})
by_samples = pd.DataFrame(lines)

lines = []
for cell in (0.25, 0.5, 1.0, 2.0):
    traced, error, stored = measured(replace(method, samples=80_000, cell=cell))
    line = {"cell": cell, "cells": len(stored.keys), "MB": stored.nbytes / 1e6}
    lines.append(line | {"traced": traced, "error": error})
by_cell = pd.DataFrame(lines)

figure, axes = plt.subplots(1, 3, figsize=(13, 3.4), layout="constrained")
for name, group in by_samples.groupby("settings", sort=False):
    axes[0].loglog(group["samples"], group["error"], "o-", label=name)
    axes[1].semilogx(group["samples"], group["traced"], "o-", label=name)
axes[0].set_ylabel("error")
axes[1].set_ylabel("share traced")
for axis in axes[:2]:
    axis.set_xticks(group["samples"], [f"{samples:,}" for samples in group["samples"]])
    axis.minorticks_off()
    axis.set_xlabel("samples")
axes[0].set_yticks([0.01, 0.03, 0.1, 0.3], ["1 %", "3 %", "10 %", "30 %"])
axes[0].legend()
axes[2].loglog(by_cell["cell"], by_cell["error"], "o-", label="error")
axes[2].loglog(by_cell["cell"], by_cell["traced"], "o-", label="share traced")
axes[2].set_xticks(by_cell["cell"], [f"{cell:g}" for cell in by_cell["cell"]], minor=False)
axes[2].minorticks_off()
axes[2].set_xlabel("edge of the cells, 80,000 samples")
axes[2].legend()
plt.show()
by_samples.pivot(index="samples", columns="settings").round(4)

# %%
by_cell.round(4)

# %% [markdown]
# Errors fall with the samples. The share of rays traced falls at first, because cells without any
# sample trace everything, and there are fewer of them; then it rises, because maps that were looked
# at more have more bits. Being conservative costs a few rays and takes most of the error. It
# matters here because samples are few: at 300,000 there are nine a cell. (The paper takes 10
# million for Sponza, whose grid has as many cells as this one.)
#
# Larger cells get more samples each and err less, but little holds for all points of a large cell,
# so that more is traced. Small cells want many samples.
#
# ## Where the errors are
#
# The error maps are of what the images with and without a field differ by: the reference here is
# the image without. Conservative fields err in single pixels. The others lose light in whole cells,
# which show as dark squares. With the paper's settings many are on banners and curtains: where a
# cell's few samples lie on one side of a cloth, nobody looked to the other.

# %%
images = {}
for name, parameters in settings.items():
    variant = replace(method, samples=80_000, **parameters)
    stored = variant.precompute(scene, progress=False)
    images[f"{name}, 80,000 samples"] = np.asarray(variant.shade(stored, light, surface, key=key))
beside_errors(images, truth, mask)

# %% [markdown]
# ## The whole environment
#
# Rays that look up nine harmonics suit a blurred sky. The maps do not mind what light there is.
# With `lighting="environment"` the same field decides the rays of multiple importance sampling:
# half of them drawn by the environment's radiance, half by the BRDF. There is no bias but for wrong
# decisions. The reference below integrates over the texels, to 2 %.

# %%
small = (144, 108)
view = jaxvis.trace_surface(scene, camera, small)
seen = np.asarray(view.mask)
reference = jaxvis.Reference(error=0.02)
correct = np.asarray(
    reference.shade(
        reference.precompute(scene), reference.light(environment), view, key=jax.random.key(1)
    )
)
images = {}
for name, variant, visibility in (
    ("nine harmonics, field", method, field),
    ("all, without field", jaxvis.Unculled(lighting="environment"), unmasked),
    ("all, field", replace(method, lighting="environment"), field),
):
    before = visibility.rays_traced
    lit = variant.light(environment)
    images[name] = np.asarray(variant.shade(visibility, lit, view, key=key))
    print(f"{name:22} {visibility.rays_traced - before:9,d} rays traced")
beside_errors(images, correct, seen)

# %% [markdown]
# With the field, noise and all, the image is as good as without, for less than a third of the rays.
# Nine harmonics, on the other hand, cannot tell where the sun is: they lose its shadow, whatever
# the rays. Among other methods the field is `visibility-field:lighting=environment` in `jaxvis
# compare`.
