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
# # First steps
#
# jaxvis lights a scene with an environment map and measures which way of doing it is worth its
# cost. What a camera sees at a point $x$ with normal $n$ is the integral over the hemisphere above
# it
#
# $$L_o(x, o) = \int_{\Omega} f(o, l)\; L_e(l)\; V(x, l)\; \max(n \cdot l, 0)\; \mathrm{d}l$$
#
# of the BRDF $f$, the environment's radiance $L_e$, which depends on the direction alone, and the
# visibility $V$, 1 where the ray from $x$ towards $l$ leaves the scene and 0 where it hits it. The
# visibility is what costs. Every method in jaxvis is a way to store it, or to sample it.
#
# This notebook loads a scene, looks at it, lights it by several methods, and reads the numbers that
# tell them apart. It takes well under two minutes on two cores and needs no file.

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

import jaxvis
from jaxvis.image import display, displayed_error, exposure_of, psnr, rmse, write_image
from jaxvis.report import psnr_over_time, sheet
from jaxvis.view import App

# %% [markdown]
# ## A scene and an environment
#
# Both load by name. A scene is a built-in (`jaxvis.scene.builtin_scenes()` lists them), the name of
# a data set, or any mesh file that trimesh reads; parameters follow a colon, as in
# `"courtyard:triangles=20000"`. The teapot's porcelain shines; it is taken as diffuse (Lambert)
# here, which is quicker for all methods. An environment is a built-in, or an .hdr, .exr or .pfm
# file.

# %%
print("scenes:      ", ", ".join(jaxvis.scene.builtin_scenes()))
print("environments:", ", ".join(jaxvis.lighting.BUILTIN))

scene = jaxvis.load_scene("teapot:subdivisions=6,plane_cells=32")
scene = scene.with_reflectance(jaxvis.reflectance.Lambert())
environment = jaxvis.load_environment("windows")

print(f"\n{scene.name}: {len(scene.triangles)} triangles, {len(scene.positions)} vertices")
print(f"{environment.name}: {environment.height} x {environment.width} texels, ", end="")
print(f"radiance {environment.radiance.min():.3g} to {environment.radiance.max():.3g}")

# %% [markdown]
# The environment is a panorama seen from inside: +Y is up, -Z lies at the left and right edges, +X
# a quarter of the way, +Z in the middle. It is a room: dark walls, and windows a hundred times as
# bright with a dome over them. Such contrasts are what makes the integral hard. At the exposure
# that shows the walls the windows are white; at a fiftieth of it they have colours.

# %%
figure, axes = plt.subplots(1, 2, figsize=(11, 3.2), layout="constrained")
quarter = environment.width / 4
for axis, exposure in zip(axes, (2.0, 0.02), strict=True):
    axis.imshow(display(environment.radiance, exposure))
    axis.set_xticks([0, quarter, 2 * quarter, 3 * quarter], ["-Z", "+X", "+Z", "-X"])
    axis.set_yticks([0, environment.height / 2, environment.height - 1], ["up", "horizon", "down"])
    axis.set_title(f"windows, exposure {exposure:g}")

# %% [markdown]
# ## What the camera sees
#
# `trace_surface` traces one ray for every pixel. The `Surface` that it returns holds what each
# pixel sees (position, normal, material, triangle) and is all that the methods need of camera and
# geometry. `mask` tells the pixels that see the scene from those that see the sky past it.

# %%
size = (160, 120)  # width, height
camera = jaxvis.default_camera(scene, aspect=size[0] / size[1])
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)

distance = np.linalg.norm(np.asarray(surface.position - surface.eye), axis=-1)
pictures = {
    "base colour": np.asarray(surface.material.base_colour),
    "normal, (n + 1) / 2": 0.5 * np.asarray(surface.normal) + 0.5,
    "distance to the eye": np.where(mask, distance, np.nan),
}
figure, axes = plt.subplots(1, 3, figsize=(11, 3), layout="constrained")
for axis, (title, picture) in zip(axes, pictures.items(), strict=True):
    shown = axis.imshow(np.where(mask[..., None], picture, 1.0) if picture.ndim == 3 else picture)
    axis.set_title(title)
    axis.set_axis_off()
figure.colorbar(shown, ax=axes, label="scene units")
plt.show()

# %% [markdown]
# ## One method, three verbs
#
# A method is a frozen dataclass of its parameters. It has three verbs:
#
# * `precompute(scene)` stores what the method needs of the scene's visibility,
# * `light(environment)` makes tables of the light,
# * `shade(visibility, light, surface)` gives the image: linear radiance, `[height, width, 3]`.
#
# Visibility does not depend on the light, nor the light on the scene: each can be changed while the
# other stays. Here is Monte Carlo integration with multiple importance sampling: it stores no
# visibility but traces 64 rays a pixel, half of them where the environment is bright and half where
# the BRDF is large. What is random takes an explicit key: the same key gives the same bits.

# %%
method = jaxvis.MonteCarlo("mis", spp=64)
visibility = method.precompute(scene)
light = method.light(environment)
radiance = method.shade(visibility, light, surface, key=jax.random.key(0))
print(method)
print("radiance", radiance.shape, radiance.dtype, f"mean {np.mean(np.asarray(radiance)[mask]):.3f}")

# %% [markdown]
# Radiance is not yet a picture. `display` multiplies by an exposure, clips at 1 and applies the
# sRGB curve; `exposure_of` proposes the exposure that makes the 99.5th percentile of the luminance
# white. Pixels past the scene are zero; the environment belongs there.

# %%
behind = environment.towards(camera.directions(*size))


def picture(radiance, exposure):
    """The scene before its environment, as a display shows it."""
    coverage = np.asarray(surface.coverage)[..., None]
    return display(coverage * radiance + (1 - coverage) * behind, exposure)


exposure = exposure_of(radiance, mask)
plt.figure(figsize=(6, 4.5))
plt.imshow(picture(radiance, exposure))
plt.title(f"mc-mis, {method.spp} samples, exposure {exposure:.3g}")
plt.axis("off")
plt.show()

# %% [markdown]
# ## Several methods against the reference
#
# `jaxvis.compare` renders a list of methods with one surface and one exposure, and measures them
# against the reference: an integral over every texel of the environment, or over a stratified
# subset large enough for the standard error that is asked for (2 % here). Times leave compilation
# out. Methods go by name, with parameters after a colon; `jaxvis methods` at the command line lists
# them.
#
# * `mc-environment` samples the environment alone, `mc-mis` shares its samples with the BRDF;
# * `vectorized` stores polygons at each vertex that bound the visible sky, and integrates the light
#   in them with summed-area tables;
# * `adaptive` stores, at a few of the vertices, the signed angle from each direction to the
#   boundary of the visible sky.

# %%
comparison = jaxvis.compare(
    scene,
    environment,
    "mc-environment,mc-mis,vectorized,adaptive",
    size,
    spp=64,
    reference="reference:error=0.02",
    out="jaxvis-out",
    progress=False,
)
table = comparison.to_frame()
table[["label", "psnr_db", "rmse", "precompute_s", "frame_s", "visibility_bytes", "rays_traced"]]

# %% [markdown]
# How to read a row: `precompute_s` is paid once for each scene, `frame_s` for every image;
# `visibility_bytes` is what is kept in between. Monte Carlo keeps next to nothing and traces rays
# in every frame (`rays_traced`). Its error is noise, which halves with four times the samples. The
# precomputed methods trace nothing while shading. Their error is no noise but bias: light
# interpolated between vertices, boundaries of finitely many edges. More time for the frame does not
# mend it, more for the precomputation does. (Under small bright windows half of the samples are
# better spent on the windows than on the BRDF: `mc-mis` is worse than `mc-environment` here. On
# mirrors it is the other way round.)
#
# `psnr_db` is the peak signal-to-noise ratio of the displayed images $a$ and $b$ over the $N$
# channel values of the pixels that see the scene,
#
# $$\mathrm{PSNR} = -10 \log_{10} \frac{1}{N} \sum_{i} (a_i - b_i)^2 \quad\text{dB},$$
#
# where 1 is white: 20 dB means an error of a tenth, 30 dB of 3 %, 40 dB of 1 %. `rmse` is the root
# mean square difference of radiance itself, which a few very bright pixels may rule. The images are
# at hand, and so the numbers can be had again:

# %%
truth = comparison.images["reference"]
exposure = exposure_of(truth, mask)  # of the reference, for all images
for label in ("mc-mis", "vectorized"):
    other = comparison.images[label]
    print(f"{label:12} {psnr(other, truth, mask):6.2f} dB   RMSE {rmse(other, truth, mask):.4f}")

figure, axes = plt.subplots(1, 3, figsize=(12, 3.2), layout="constrained")
for axis, label in zip(axes, ("reference", "mc-mis"), strict=False):
    axis.imshow(picture(comparison.images[label], exposure))
    axis.set_title(label)
error = displayed_error(comparison.images["mc-mis"], truth, mask, exposure)
shown = axes[2].imshow(np.where(mask, error, np.nan), cmap="magma", vmin=0, vmax=0.2)
axes[2].set_title("error of mc-mis")
figure.colorbar(shown, ax=axes[2], label="display units (1 = white)")
for axis in axes:
    axis.set_axis_off()

# %% [markdown]
# The sheet shows each image above its error, on a logarithmic scale that is the same in every
# report. Look at where the errors are: noise is everywhere; interpolation errs where shadows end.

# %%
sheet(comparison, columns=5)

# %% [markdown]
# Quality over time is the fair view. Methods that take samples draw a curve, from 1 sample a pixel
# on; the others are a point. Up and to the left is better.

# %%
plot = psnr_over_time(comparison)
plot.set_facecolor("white")
plot

# %% [markdown]
# ## Turn the environment
#
# The visibility stays when the light changes. That is what precomputation is for: below, one
# `precompute` serves a sky with a low sun from four sides. `rotate` turns the environment about +Y,
# counter-clockwise seen from above.

# %%
sky = jaxvis.load_environment("sky:elevation=0.5,sun_radius=0.03")
method = jaxvis.AdaptiveVisibility()
visibility = method.precompute(scene, progress=False)
print(f"{visibility.nbytes / 1e6:.1f} MB of visibility, {len(visibility.samples)} samples ", end="")
print(f"for {len(scene.positions)} vertices")

figure, axes = plt.subplots(1, 4, figsize=(12, 2.6), layout="constrained")
for axis, degrees in zip(axes, (0, 90, 180, 270), strict=True):
    turned = sky.rotate(np.radians(degrees))
    radiance = np.asarray(method.shade(visibility, method.light(turned), surface))
    behind = turned.towards(camera.directions(*size))
    exposure = exposure_of(radiance, mask)
    axis.imshow(picture(radiance, exposure))
    axis.set_title(f"turned by {degrees}°")
    axis.set_axis_off()

# %% [markdown]
# ## Save an image
#
# `write_image` goes by the suffix: `.exr`, `.hdr` and `.pfm` hold linear radiance, `.png` what a
# display shows.

# %%
write_image("jaxvis-out/turned.exr", radiance)
write_image("jaxvis-out/turned.png", picture(radiance, exposure))
print(jaxvis.image.read_image("jaxvis-out/turned.exr").shape)

# %% [markdown]
# ## The report
#
# `compare(..., out="jaxvis-out")` above wrote `results.json` and the images into a folder beside
# this notebook. `write_report` adds tables, figures, and one self-contained page, `index.html`:
# images side by side with a slider, error maps, PSNR over time.

# %%
page = jaxvis.write_report(comparison, "jaxvis-out", progress=False)
print(page, f"{page.stat().st_size / 1e6:.1f} MB")

# %% [markdown]
# ## Look around
#
# `jaxvis.view.App` shows a scene in place: orbit with the mouse, turn or spin the light, pick a
# method and its parameters. Once nothing moves, a reference is rendered aside, and with it come the
# PSNR and, under `show`, the error map. (The browser must run on the machine of the notebook; there
# is nothing to see in a notebook that is only read.)

# %%
app = App(scene, environment, "vectorized:zeta=1,vectors=64", camera=camera, height=192)
app

# %% [markdown]
# `app.stop()` ends it. At the command line the comparison is
#
# ```bash
# jaxvis compare --methods mc-environment,mc-mis,vectorized,adaptive --spp 64 --size 160 120
# ```
#
# Try other scenes (`courtyard:triangles=20000`, `hat`, a mesh of your own),
# `sky:turbidity=3,elevation=0.4` as the environment, and other methods. How the methods work is
# told in the notebooks that follow.
