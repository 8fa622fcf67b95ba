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
# # Distance fields and adaptive sampling
#
# Where vectorized visibility keeps the boundary of the visible sky, a *spherical signed distance
# function* keeps for every direction the angle to that boundary: positive where the sky is seen,
# negative where it is hidden. Distances have two virtues. They can be interpolated, as
# visible/hidden bits cannot; and the distance along the axis of a spherical Gaussian tells, nearly,
# how much of that Gaussian is seen.
#
# This notebook looks at the maps and their distances, takes the environment apart into Gaussians,
# and then saves most of the maps: those that neighbours foretell.

# %%
import time

import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxvis
from jaxvis.image import display, exposure_of
from jaxvis.report import beside_errors

size = (144, 108)
scene = jaxvis.load_scene("torus-on-plane:cells=24,around=48")
environment = jaxvis.load_environment("windows").resize(128)
camera = jaxvis.Camera(eye=(4.4, 4.6, 7.4), target=(0.0, 0.2, 0.0), field_of_view=0.6)
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)

everywhere = jaxvis.DistanceField(resolution=64, lights=256)
fields = everywhere.precompute(scene, progress=False)
print(f"{len(scene.positions)} vertices, {fields.nbytes / 1e6:.1f} MB, {fields.rays_traced} rays")

# %% [markdown]
# ## Maps and signed distances
#
# Each sample has a map of its hemisphere. Its pole lies *on the horizon*, so that the hemisphere is
# the square $0 < \theta, \varphi < \pi$: no row and no column wraps around. The signed distance of
# direction $l$ is
#
# $$d(l) = \pm \min_{l' :\, V(l') \neq V(l)} \angle(l, l'),$$
#
# with the sign of what is seen at $l$. A distance transform finds it for all texels in linear time.
# Two vertices of the plane: in the middle of nowhere, and between torus and sphere.

# %%
place = np.asarray(fields.positions)
floor = np.flatnonzero(place[:, 1] < place[:, 1].min() + 1e-3)
off_axis = np.linalg.norm(place[floor][:, [0, 2]], axis=-1)
chosen = {
    "4 from the axis": floor[np.argmin(np.abs(off_axis - 4.0))],
    "between torus and sphere": floor[np.argmin(np.abs(off_axis - 1.25))],
}
sample_of = {int(v): i for i, v in enumerate(np.asarray(fields.samples))}
figure, axes = plt.subplots(1, 4, figsize=(13, 3.3), layout="constrained")
for pair, (name, vertex) in zip(axes.reshape(2, 2), chosen.items(), strict=True):
    sample = sample_of[int(vertex)]
    pair[0].imshow(fields.maps()[sample], cmap="gray", extent=(0, 180, 180, 0), vmin=-0.5)
    pair[0].set_title(f"{name}\nvisible sky")
    distance = np.degrees(np.asarray(fields.signed_distance[sample], np.float32))
    shown = pair[1].imshow(distance, cmap="RdBu", vmin=-60, vmax=60, extent=(0, 180, 180, 0))
    pair[1].contour(distance, levels=[0.0], colors="#222222", linewidths=1, extent=(0, 180, 0, 180))
    pair[1].set_title("signed distance")
    for axis in pair:
        axis.set_xticks([0, 90, 180])
        axis.set_yticks([0, 90, 180])
        axis.set_xlabel("φ (degrees)")
    pair[0].set_ylabel("θ (degrees)")
figure.colorbar(shown, ax=axes, label="degrees")
plt.show()

# %% [markdown]
# ## Light as spherical Gaussians
#
# A spherical Gaussian with axis $p$, sharpness $\lambda$ and amplitude $\mu$ is $G(l) = \mu\,
# e^{\lambda (l \cdot p - 1)}$. The method lights with a sum of them. `lobes="cells"` cuts the
# environment into as many cells as there are `lights`, small where it is bright, and takes one
# Gaussian for each; `lobes="fitted"` fits a few by least squares, as the paper does. What is seen
# of a Gaussian follows from the signed distance $d$ along $p$ and its sharpness alone, as if the
# boundary were a great circle. Here are the environment and its sums.

# %%
rows, columns = environment.height, environment.width
theta = np.pi * (np.arange(rows) + 0.5) / rows
phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
ring = np.sin(theta)[:, None]
directions = np.stack(
    np.broadcast_arrays(ring * np.sin(phi), np.cos(theta)[:, None], -ring * np.cos(phi)), axis=-1
).astype(np.float32)


def summed(lobes):
    """Radiance of a sum of Gaussians, as a panorama."""
    value = np.zeros((rows, columns, 3))
    for axis, sharpness, amplitude in zip(*map(np.asarray, lobes), strict=True):
        value += np.exp(sharpness * (directions @ axis - 1))[..., None] * amplitude
    return value


panoramas = {"environment": np.asarray(environment.radiance)}
for lobes, count in (("cells", 256), ("cells", 64), ("fitted", 32)):
    light = jaxvis.DistanceField(lights=count, lobes=lobes).light(environment)
    panoramas[f"{count} Gaussians ({lobes})"] = summed(
        (light.axis, light.sharpness, light.amplitude)
    )
figure, axes = plt.subplots(1, 4, figsize=(13, 2.3), layout="constrained")
for axis, (name, panorama) in zip(axes, panoramas.items(), strict=True):
    axis.imshow(display(panorama.astype(np.float32), 0.1))
    axis.set_title(name)
    axis.set_axis_off()

# %% [markdown]
# ## The picture
#
# Pixels interpolate the signed distances of their triangle's corners, then look up each Gaussian.

# %%
reference = jaxvis.Reference(error=0.01)
truth = np.asarray(
    reference.shade(
        reference.precompute(scene), reference.light(environment), surface, key=jax.random.key(0)
    )
)
images = {}
for lobes, count in (("cells", 256), ("fitted", 32)):
    method = jaxvis.DistanceField(resolution=64, lights=count, lobes=lobes)
    image = method.shade(fields, method.light(environment), surface)
    images[f"every vertex, {lobes}, {count}"] = np.asarray(image)

beside_errors(images, truth, mask, brightness=0.6)

# %% [markdown]
# ## Most maps are foretold by their neighbours
#
# Out on the plane one map is like the next; near the torus it is not. `AdaptiveVisibility` starts
# from few samples, placed by $k$-means clustering under
#
# $$e_g = \alpha \frac{\lVert x_i - x_j \rVert}{\text{diagonal}} + \lVert n_i - n_j \rVert ,$$
#
# and then asks of each sample whether its neighbours foretell it. Where they do not, to `largest`
# of its value, samples are added; those that are foretold to `least` are dropped. `budget` bounds
# their number as a share of the vertices. Maps are traced adaptively, too: coarsely at first, then
# only where the boundary passes.

# %%
adaptive, sampled = {}, {}
for budget in (0.03, 0.12):
    method = jaxvis.AdaptiveVisibility(resolution=64, lights=256, budget=budget)
    found = method.precompute(scene, progress=False)
    name = f"adaptive, {budget:.0%}"
    sampled[name] = found
    adaptive[name] = np.asarray(method.shade(found, method.light(environment), surface))

figure, axes = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
for axis, (name, found) in zip(axes, sampled.items(), strict=True):
    at = np.asarray(found.positions)[np.asarray(found.samples)]
    shown = axis.scatter(at[:, 0], at[:, 2], c=at[:, 1] - place[:, 1].min(), s=9, cmap="viridis")
    axis.set_title(f"{name}: {len(at)} samples, seen from above")
    axis.set_aspect("equal")
    axis.set_xlabel("x")
    axis.set_ylabel("z")
    axis.invert_yaxis()
figure.colorbar(shown, ax=axes, label="height above the plane")

beside_errors(
    {"every vertex": images["every vertex, cells, 256"], **adaptive}, truth, mask, brightness=0.6
)
for name, found in {"every vertex": fields, **sampled}.items():
    print(f"{name:15} {len(found.samples):5d} maps {found.rays_traced:9,d} rays ", end="")
    print(f"{found.nbytes / 1e6:6.2f} MB")

# %% [markdown]
# Three per cent are too few: samples are spent where normals differ, on torus and sphere, and the
# plane around them is interpolated over too far. Twelve per cent come within a few decibels of
# every vertex, for a thirtieth of the rays.

# %% [markdown]
# ## Scenes that move
#
# When a scene moves, samples and maps are carried from frame to frame: `precompute_for(scene,
# surface, previous)` traces only directions in which something moved. Two balls roll in a dish:

# %%
animation = jaxvis.load_animation("balls:detail=32")
method = jaxvis.AdaptiveVisibility(resolution=64, lights=256)
light = method.light(environment)
previous, frames = None, {}
for frame in (0, 3, 6, 9):
    moved = animation.scene(frame)
    view = jaxvis.trace_surface(moved, jaxvis.default_camera(moved, aspect=4 / 3), size)
    start = time.perf_counter()
    previous = method.precompute_for(moved, view, previous, progress=False)
    seconds = time.perf_counter() - start
    frames[frame] = np.asarray(method.shade(previous, light, view)), np.asarray(view.mask)
    print(f"frame {frame}: {len(previous.samples)} maps, {previous.rays_traced:,} rays", end=", ")
    print(f"{seconds:.2f} s")

exposure = exposure_of(*frames[0])
figure, axes = plt.subplots(1, 4, figsize=(13, 2.7), layout="constrained")
for axis, (frame, (image, seen)) in zip(axes, frames.items(), strict=True):
    axis.imshow(np.where(seen[..., None], display(image, exposure), 1))
    axis.set_title(f"frame {frame}")
    axis.set_axis_off()

# %% [markdown]
# `rays_traced` falls after the first frame: what did not move is taken over. (Times here contain
# compilation; `experiments.adaptive_table` measures warm ones.) `shadow-map` is the paper's
# baseline: the same samples with maps that are drawn into hemicubes, not traced.
