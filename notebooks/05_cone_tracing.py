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

# %%

# %% [markdown]
# # Cone tracing
#
# Smooth light needs no sharp visibility. Cone tracing replaces the rays of a hemisphere by six wide
# cones, and the triangles that they meet by averages of the scene at the cones' own width. A pixel
# then costs a fixed number of look-ups in maps, however many triangles there are.
#
# The maps are the price. A volume of voxels grows with the cube of its resolution; yet most of an
# open world is ground, which has one height everywhere and fits into a picture. *Hybrid* cone
# tracing (paper 003) keeps the ground as a height field and all that stands on it as voxels.
#
# This notebook looks at both maps and at what goes where, follows one cone on its way, puts the
# images beside ray-traced ones, without and with a bounce of light, and counts bytes.

# %%
import time
from dataclasses import replace

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxvis
from jaxvis.image import display, exposure_of
from jaxvis.methods import HybridCones, VoxelCones
from jaxvis.methods.cones.cells import fitting_cube, footprint, may_meet, range_table
from jaxvis.methods.cones.cones import cone_set
from jaxvis.methods.cones.heights import LARGEST, corners
from jaxvis.methods.cones.ranges import pyramid_range
from jaxvis.report import beside_errors

scene = jaxvis.load_scene("terrain")
environment = jaxvis.load_environment("sky:elevation=0.5,turbidity=3").resize(64)
size = (160, 100)
camera = jaxvis.default_camera(scene, aspect=size[0] / size[1])
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)

hybrid = HybridCones(voxels=128, texels=512, bounces=1, directions=16)
visibility = hybrid.precompute(scene, progress=False)
maps, flat = visibility.maps, visibility.flat
print(f"{len(scene.triangles)} triangles, {flat.sum()} of them in the height field")

# %% [markdown]
# ## What goes where
#
# A *mesh* is what is connected. It may go to the height field if it is one: its vertices $X$ lie,
# on average, close to the surface $Y$ of its own topmost points (paper 003, eq. 5),
#
# $$d(X, Y) = \frac{1}{D}\; \underset{x \in X}{\mathrm{avg}}\; \inf_{y \in Y} \lVert x - y \rVert
# < 0.001,$$
#
# where $D$ is the diagonal of its bounding box. (jaxvis takes points spread over the surface in
# place of vertices, so that a box does not count as eight corners.) Roofs stand out over walls, and
# crowns of trees over trunks: these fail, and become voxels.
#
# Left, what the camera sees of each kind. Middle, the height field from above; right, how opaque
# the voxels are to a ray straight down.


# %%
def from_above(level):
    """Opacity of all voxels of a level to a vertical ray, x along rows."""
    n = maps.grid.resolution
    start = sum((n >> finer) ** 3 for finer in range(level))
    opacity = np.asarray(maps.volume[-1]).reshape(6, -1)[3]  # of the face towards -y
    side = n >> level
    cells = opacity[start : start + side**3].reshape(side, side, side).astype(np.float32)
    return 1 - np.prod(1 - cells, axis=1)


plan, grid = maps.plan, maps.grid
n, texel, voxel = plan.resolution, float(plan.texel), float(grid.voxel)
metres = float(plan.rise) / LARGEST  # heights are 16-bit whole numbers
heights = metres * np.asarray(maps.heights[: n * n], np.float32).reshape(n, n)
ground = (plan.low[0], plan.low[0] + n * texel, plan.low[2] + n * texel, plan.low[2])
edge = grid.resolution * voxel
box = (grid.low[0], grid.low[0] + edge, grid.low[2] + edge, grid.low[2])

kind = np.where(flat[np.asarray(surface.triangle)][..., None], (0.56, 0.66, 0.42), (0.72, 0.4, 0.3))
slope = np.asarray(surface.normal) @ np.array([0.5, 0.7, 0.5])
figure, axes = plt.subplots(
    1, 3, figsize=(14, 4), layout="constrained", width_ratios=(1.5, 1.15, 1)
)
axes[0].imshow(np.where(mask[..., None], kind * (0.6 + 0.4 * slope[..., None]), 1))
axes[0].set_title("height field (green), voxels (red)")
axes[0].set_axis_off()
shown = axes[1].imshow(heights.T, extent=ground, cmap="terrain")
figure.colorbar(shown, ax=axes[1], label="height above the lowest, m", shrink=0.8)
axes[1].set_title(f"heights, {n}² texels of {texel:.1f} m")
axes[2].imshow(from_above(0).T, extent=box, cmap="magma", vmin=0, vmax=1)
axes[2].set_title(f"voxels of {voxel:.1f} m, opacity downwards")
for axis in axes[1:]:
    axis.set_xlabel("x, m")
    axis.set_ylabel("z, m")

# %% [markdown]
# A voxel has an opacity for each of the six ways in which a ray may go through it: the share of its
# side that the triangles inside cover, seen that way. Coarser levels halve the resolution. Along
# the ray the nearer voxel covers the farther one, $\alpha = \alpha_1 + (1 - \alpha_1)\, \alpha_2$
# t.show() across it four such pairs are averaged. So a wall is as opaque from its front at every
# level as it covers the coarser voxel, and stays thin from the side. Heights are simply averaged.

# %%
figure, axes = plt.subplots(1, 4, figsize=(13, 3.2), layout="constrained")
for axis, level in zip(axes, range(4), strict=True):
    shown = axis.imshow(from_above(level).T, extent=box, cmap="magma", vmin=0, vmax=1)
    axis.set(xlim=(-220, 220), ylim=(160, -280), xticks=[-200, 0, 200], yticks=[-200, 0])
    axis.set_title(f"level {level}: voxels of {voxel * 2**level:.0f} m")
figure.colorbar(shown, ax=axes, label="opacity downwards", shrink=0.85)
plt.show()

# %% [markdown]
# ## Six cones
#
# For a diffuse surface of albedo $\rho$ the integral over the hemisphere becomes a sum over cones
# (eq. 4),
#
# $$L_r(x) = \frac{\rho}{\pi} \sum_{k=1}^{6} L_k(x, \omega_k)\, W_k, \qquad
# W_k = \int_{\Omega_k} \langle n, \omega \rangle \,\mathrm{d}\omega, \qquad \sum_k W_k = \pi,$$
#
# where $L_k$ is the average radiance in cone $k$. One cone stands about the normal, five lean 60°
# from it; all are 60° wide. What a cone has not met when it leaves the scene is sky: the
# environment, averaged over a cone beforehand.

# %%
cones = cone_set(6)
lean = np.degrees(np.arccos(cones.axes[:, 2]))
for angle, weight in zip(lean[:2], cones.weights[:2], strict=True):
    print(f"leaning by {angle:2.0f}°: W = {weight / np.pi:.2f} π each")
print(f"sum: {cones.weights.sum() / np.pi:.2f} π")

# %% [markdown]
# ## One cone on its way
#
# A cone of aperture $\theta$ marches in cubes that touch one another. At distance $s$ it is $d = 2
# s \tan(\theta / 2)$ wide, and the cube has the side
#
# $$S = d / \sqrt{2}, \qquad s \leftarrow s + S$$
#
# (eq. 10). Each cube reads the voxels at the level whose cells are as large as itself: every step
# reaches farther, and sees less detail. From a texel to a kilometre that takes about a dozen steps.
#
# With the height field a cube can do one of two things. The paper *searches* the cells of the map
# below it, and needs to know beforehand whether the search is worth it: tables hold the lowest and
# highest height over rectangles. jaxvis has exact ones (`ranges="pyramid"`) and the paper's, means
# of powers $p = 8$ from summed-area tables (`"hsat"`; eq. 14),
#
# $$\max_i h_i \approx \Bigl( \frac{1}{N} \sum_{i=1}^{N} h_i^{\,p} \Bigr)^{1/p}.$$
#
# Below, a cone from a point of the ground towards +x, cut by the plane of its axis. Orange cubes
# may meet the ground, by the exact table; the bars are the heights over each cube's footprint,
# which reaches to both sides of the plane.

# %%
row, column, aperture = 319, 454, np.pi / 3
start = np.array(
    [
        plan.low[0] + (row + 0.5) * texel,
        plan.low[1] + heights[row, column],
        plan.low[2] + (column + 0.5) * texel,
    ]
)
toward = (np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0)  # 60° from the vertical
growth = 1 + np.sqrt(2) * np.tan(aperture / 2)
steps = texel * growth ** np.arange(11)  # where cubes begin, along the axis
apex = tuple(jnp.full(len(steps), a, jnp.float32) for a in start)
along = tuple(jnp.full(len(steps), a, jnp.float32) for a in toward)
cubes = fitting_cube(apex, along, jnp.asarray(steps, jnp.float32), aperture / 2, "clean")
below = footprint(plan, cubes)
table = range_table(maps.heights, plan, "pyramid")
meets = np.asarray(may_meet(table, plan, below, cubes))
low, high = pyramid_range(table, n, below.low[::-1], below.high[::-1])
low, high = (np.asarray(h) * float(plan.rise) + plan.low[1] - start[1] for h in (low, high))

reach = np.arange(n - row) * texel
profile = heights[row:, column] - heights[row, column]
figure, axis = plt.subplots(figsize=(11, 5.2), layout="constrained")
axis.fill_between(reach, profile, profile.min() - 20, color="#b9b08f", label="ground")
end = 1.1 * reach[-1]
for angle in (0, np.pi / 3):
    axis.plot([0, end * np.cos(angle)], [0, end * np.sin(angle)], color="#4477aa", lw=1)
for k in range(len(steps)):
    side, x = float(cubes.side[k]), float(cubes.centre[0][k]) - start[0]
    y = float(cubes.centre[1][k]) - start[1]
    colour = "#d97b1c" if meets[k] else "#999999"
    axis.add_patch(plt.Rectangle((x - side / 2, y - side / 2), side, side, fill=False, ec=colour))
    if high[k] > low[k]:
        axis.plot([x, x], [low[k], high[k]], color="#333333", lw=3, solid_capstyle="butt")
axis.set_xlim(-20, reach[-1])
axis.set_ylim(profile.min() - 10, 260)
axis.set_aspect("equal")
axis.set_xlabel("distance, m")
axis.set_ylabel("height over the start, m")
axis.set_title("a cone (blue), its cubes, and the heights over each (bars)")
plt.show()
print(f"{len(steps)} cubes, {meets.sum()} may meet the ground")

# %% [markdown]
# The other way is to follow the *horizon* (`search="horizon"`, jaxvis' own and the default). A cone
# is cut into three vertical slices. Each reads one height a step, at the level of the cone's width
# there, and keeps the steepest elevation $e$ so far. Of a slice between elevations $e_0$ and $e_1$,
# with the normal's components $n_y$ upwards and $a$ along it, the ground then hides
#
# $$\frac{F(e) - F(e_0)}{F(e_1) - F(e_0)}, \qquad
# F(e) = \int_0^{e} (n_y \sin t + a \cos t) \cos t \,\mathrm{d}t .$$
#
# A height that rises above the horizon adds its radiance, one below adds nothing: there is no
# search, and no cell is counted twice. Here is the horizon of the middle slice for the cone above,
# as its steps find it and as all texels have it.

# %%
true_horizon = np.maximum.accumulate(np.degrees(np.arctan2(profile[1:], reach[1:])))
away = steps * toward[0] * np.sqrt(growth)  # in the middle of each step
level = np.clip(np.round(np.log2(away * np.tan(aperture / 2) / texel)), 0, plan.levels - 1)
inside = away < reach[-1]
places = corners(plan, start[0] + away, jnp.full(len(away), start[2]), jnp.asarray(level, int))
read = np.asarray(places.read(maps.heights)) * metres - heights[row, column]
seen = np.degrees(np.arctan2(read, away))

plt.figure(figsize=(9, 3.4), layout="constrained")
plt.plot(reach[1:], true_horizon, color="#222222", label="horizon by all texels")
plt.plot(away[inside], seen[inside], "o", color="#d97b1c", label="elevation of each step's read")
kept = np.maximum.accumulate(seen[inside])
plt.step(away[inside], kept, where="post", color="#d97b1c", label="horizon by steps")
plt.xscale("log")
plt.xlabel("distance, m")
plt.ylabel("elevation, degrees")
plt.legend()
plt.show()
print(f"horizon by {inside.sum()} steps: {kept[-1]:.1f}°, ", end="")
print(f"by {len(true_horizon)} texels: {true_horizon[-1]:.1f}°")

# %% [markdown]
# This is a hard case: the ridge falls between two steps. How good are horizons in general? From
# 4096 starts all over the map, the same way:

# %%
first = np.arange(4, n, 8)
x, z = (a.reshape(-1) for a in np.meshgrid(first, first, indexing="ij"))
by_texels, by_steps = np.zeros((2, len(x)))  # of slices that begin at elevation 0
for k in range(1, n):
    rise = heights[np.minimum(x + k, n - 1), z] - heights[x, z]
    by_texels = np.maximum(by_texels, np.degrees(np.arctan2(rise, k * texel)))
east, south = (plan.low[i] + (a + 0.5) * texel for i, a in ((0, x), (2, z)))
for distance, at in zip(away, level, strict=True):
    places = corners(plan, east + distance, south, jnp.full(len(x), int(at)))
    rise = np.asarray(places.read(maps.heights)) * metres - heights[x, z]
    inside = x * texel + distance < n * texel
    by_steps = np.maximum(by_steps, np.where(inside, np.degrees(np.arctan2(rise, distance)), 0))
print(f"mean horizon by texels {by_texels.mean():.2f}°, by steps {by_steps.mean():.2f}°; ", end="")
print(f"they differ by {np.abs(by_texels - by_steps).mean():.2f}° on average")

# %% [markdown]
# ## Direct light
#
# A sun does not fit into averages. Up to two small bright sources are taken out of the environment
# and their shadows traced with rays; cones gather the rest. Here is the terrain beside the
# ray-traced reference: by the hybrid's maps, and by voxels alone at the same resolution, which is
# the paper's baseline (`voxel-cones`). What is hidden is black as yet. `reference.solve` gives the
# image with one bounce and the bounce apart, so that both are at hand.

# %%
reference = jaxvis.Reference(error=0.02, bounces=1, bounce_rays=128)
solved = reference.solve(reference.precompute(scene), reference.light(environment), surface)
truth, indirect = np.asarray(solved.image), np.asarray(solved.indirect)

light = hybrid.light(environment)
images = {"hybrid": np.asarray(replace(hybrid, bounces=0).shade(visibility, light, surface))}
voxels = VoxelCones(voxels=128)
alone = voxels.precompute(scene, progress=False)
images["voxels alone"] = np.asarray(voxels.shade(alone, light, surface))
print(f"{len(light.sun_flux)} sun taken out of the environment")
beside_errors(images, truth - indirect, mask, brightness=0.8)

# %% [markdown]
# ## One bounce
#
# With `bounces=1` the maps are *light*maps. The light of the sun, and of the sky by `directions`
# places of it, falls on texels and voxels through shadow rays, is reflected by the base colour and
# averaged along with the opacity. A cone then collects it where it is hidden. `lightmaps` lights
# the maps, once for each light; `shade_lit` gathers from them, once for each view.

# %%
lit = hybrid.lightmaps(visibility, light)
image = np.asarray(hybrid.shade_lit(visibility, lit, light, surface))
bounce = np.maximum(image - images["hybrid"], 0)

share = indirect[mask].mean() / truth[mask].mean()
print(f"the bounce is {share:.1%} of the reference's light; ", end="")
print(f"the hybrid's is {bounce[mask].mean() / indirect[mask].mean():.2f} times as bright")
beside_errors({"direct light alone": images["hybrid"], "with the bounce": image}, truth, mask)

# %% [markdown]
# The bounce alone, six times as bright: walls throw their colour on the ground before them, and the
# ground lights the undersides of eaves, crowns and the bridge. The cones blur it, and lose what is
# finer than a voxel.

# %%
exposure = 6 * exposure_of(truth, mask)
figure, axes = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
for axis, picture in zip(axes, (indirect, bounce), strict=True):
    axis.imshow(np.where(mask[..., None], display(picture, exposure), 1))
    axis.set_title(f"the bounce alone: {'reference' if picture is indirect else 'hybrid'}")
    axis.set_axis_off()

# %% [markdown]
# The visibility stays when the sun moves: only the lightmaps are made anew. Warm, that takes

# %%
for elevation in (0.2, 0.9):
    moved = jaxvis.load_environment(f"sky:elevation={elevation},turbidity=3").resize(64)
    begin = time.perf_counter()
    other = hybrid.light(moved)
    relit = jax.block_until_ready(hybrid.lightmaps(visibility, other))
    middle = time.perf_counter()
    hybrid.shade_lit(visibility, relit, other, surface)
    print(f"sun at {elevation}: lit in {middle - begin:.2f} s, ", end="")
    print(f"gathered in {time.perf_counter() - middle:.2f} s")

# %% [markdown]
# ## Memory
#
# A voxel that is lit has six faces of four half floats, and a volume of $N^3$ has $8/7\, N^3$ of
# them in all levels; a texel has three half floats and a 16-bit height, and a map of $M^2$ has
# $4/3\, M^2$. That is how the tables grow:


# %%
def megabytes(voxels, texels):
    """Of lit maps, by the formula."""
    return (voxels**3 * 8 / 7 * 6 * 4 * 2 + texels**2 * 4 / 3 * 4 * 2) / 1e6


print(f"128³ + 512²:  {megabytes(128, 512):5.0f} MB by the formula, ", end="")
print(f"{lit.nbytes / 1e6:.0f} MB allocated; 512² alone {megabytes(0, 512):.1f} MB")
print(f"128³ + 2048²: {megabytes(128, 2048):5.0f} MB")
print(f"256³:         {megabytes(256, 0):5.0f} MB")
print(f"512³:         {megabytes(512, 0):5.0f} MB, with voxels about as fine as the texels above")
ratio = megabytes(128, 2048) / megabytes(256, 0)
print(f"128³ + 2048² is {ratio:.1%} of 256³; in the paper's table 2, {117 / 896:.1%}")

# %% [markdown]
# The height field costs next to nothing beside the voxels, and resolves the ground as no volume of
# that size could. Only diffuse light is meant, as in the paper, and walls thinner than a voxel
# leak. `python -m experiments.cone_table` prints the tables: memory, errors, leaks, sweeps of the
# cones and of the search, and growth with the number of triangles.
