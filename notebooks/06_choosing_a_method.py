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
# # Choosing a method
#
# No method is best. Which one is worth its cost depends on how often the picture is made again, on
# what changes between pictures, on how much may be stored, and on how the surfaces reflect. This
# notebook puts one method of each family on the same scene, light, camera and reference, prints
# what each costs, and ends in a table of advice. Every line of it rests on a number printed above
# it: your machine and your scene have others.
#
# The scene is small, so that all methods build in a minute: a torus on a plane, in a room whose
# windows are bright and whose walls are dark. Estimators take up to 16 samples a pixel.

# %%
import time
from dataclasses import replace

import jax
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

import jaxvis
from jaxvis.image import display, psnr
from jaxvis.report import beside_errors, psnr_over_time

scene = jaxvis.load_scene("torus-on-plane:cells=20,around=28")
environment = jaxvis.load_environment("windows").resize(64)
camera = jaxvis.Camera(eye=(4.4, 4.6, 7.4), target=(0.0, 0.2, 0.0), field_of_view=0.6)

figure, axes = plt.subplots(1, 2, figsize=(11, 2.9), layout="constrained")
for axis, exposure in zip(axes, (2.0, 0.02), strict=True):
    axis.imshow(display(environment.radiance, exposure))
    axis.set_title(f"the room's walls and windows, exposure {exposure:g}")
    axis.set_axis_off()
plt.show()

# %%
size, accuracy = (128, 96), "reference:error=0.02"
methods = (
    "mc-mis:spp=16,mc-ides:spp=16,mc-adaptive:spp=16,mc-adaptive+denoise:spp=16,"
    "visibility-field:lighting=environment,samples=200000,spp=16,"
    "vectorized:vectors=48,resolution=32,zeta=1,correspondence:vectors=48,resolution=32,zeta=1,"
    "adaptive:resolution=64,lights=256,hybrid-cones:voxels=32,texels=128"
)
comparison = jaxvis.compare(
    scene, environment, methods, size, camera=camera, reference=accuracy, progress=False
)
for row in comparison["results"]:  # names without parameters: there is one of each
    comparison.images[row["method"]] = comparison.images.pop(row["label"])
    row["label"] = row["method"]
rows = {row["label"]: row for row in comparison["results"]}
comparison.to_frame().set_index("label")[
    ["psnr_db", "frame_s", "precompute_s", "light_s", "visibility_bytes", "rays_traced"]
].round(4)

# %% [markdown]
# * `mc-mis`, `mc-ides` and `mc-adaptive` are estimators: they trace rays in every frame and store
#   no visibility but the scene's triangles. `mc-ides` finds out, frame by frame, in which
#   directions the sky is free; in `mc-adaptive` the first rays of a block of pixels tell the
#   others. `+denoise` removes noise by Open Image Denoise.
# * `visibility-field` is an estimator, too, which knows of most rays what they would find.
# * `vectorized`, `correspondence` (polygons), `adaptive` (signed distances) and `hybrid-cones`
#   store visibility, and trace nothing in a frame but the cones' suns.
#
# Their errors have different looks: noise, wrong interpolation, and blur.

# %%
truth, covered = comparison.images["reference"], comparison.covered
images = {name: comparison.images[name] for name in rows}
beside_errors(images, truth, covered, brightness=0.6, columns=5)

# %% [markdown]
# ## Quality over time
#
# Frame times are warm. Estimators draw a curve, from 1 sample a pixel on; stored methods are
# points: another point takes another precomputation.

# %%
plot = psnr_over_time(comparison)
plot.set_facecolor("white")
plot

# %% [markdown]
# *Equal time* is a vertical line through that figure. In the time of a stored method's frame, what
# does the best estimator reach? Between its points PSNR is interpolated over the logarithm of time,
# along which an estimator's error is nearly a straight line; beyond its last point that one stands.
# (`experiments.equal_time` does the same, with more frames.)


# %%
def reached(name, seconds):
    """PSNR of an estimator in this time."""
    curve = [(np.log(point["frame_s"]), point["psnr_db"]) for point in rows[name]["curve"]]
    return float(np.interp(np.log(seconds), *zip(*curve, strict=True), left=-np.inf))


estimators = [name for name, row in rows.items() if "curve" in row and name != "visibility-field"]
stored = [name for name in rows if "curve" not in rows[name]]
print(f"{'':15} frame s    dB   at equal time")
for name in stored:
    seconds, decibels = rows[name]["frame_s"], rows[name]["psnr_db"]
    others = {other: reached(other, seconds) for other in estimators}
    best = max(others, key=others.get)
    print(f"{name:15} {seconds:7.3f} {decibels:5.1f}   {others[best]:.1f} ({best})")

# %% [markdown]
# ## When does storing pay?
#
# Precomputation is paid once. Against an estimator that takes $t_e$ for a frame of the same PSNR, a
# method that takes $P$ beforehand and $t_m$ for a frame has paid after
#
# $$N = \frac{P}{t_e - t_m}$$
#
# frames, and never if $t_m \ge t_e$ or if no estimator is as slow. $P$ contains compilation here,
# which a second run finds in the cache: these $N$ are upper bounds.


# %%
def needed(name, decibels):
    """Seconds in which an estimator reaches a PSNR; infinite if it did not."""
    curve = sorted((point["psnr_db"], np.log(point["frame_s"])) for point in rows[name]["curve"])
    quality, seconds = zip(*curve, strict=True)
    return float(np.exp(np.interp(decibels, quality, seconds, right=np.inf)))


pays = {}
for name in stored:
    others = {other: needed(other, rows[name]["psnr_db"]) for other in estimators}
    best = min(others, key=others.get)
    saved = others[best] - rows[name]["frame_s"]
    pays[name] = rows[name]["precompute_s"] / saved if saved > 0 else np.inf
    verdict = f"pays after {pays[name]:.0f} frames" if saved > 0 else "does not pay"
    print(f"{name:15} {rows[name]['frame_s']:.3f} s, {best} {others[best]:.3f} s: {verdict}")

# %% [markdown]
# ## Noise from frame to frame
#
# An estimator's error changes in every frame, which the eye sees as flicker; a stored method's
# stays where it is. Two frames with different random keys, and two of a stored method:

# %%
surface = jaxvis.trace_surface(scene, camera, size)
estimator = jaxvis.methods.create("mc-adaptive:spp=16")
nothing, sampled = estimator.precompute(scene), estimator.light(environment)
first, second = (
    np.asarray(estimator.shade(nothing, sampled, surface, key=jax.random.key(k))) for k in (1, 2)
)
flicker = psnr(first, second, covered)
adaptive = jaxvis.AdaptiveVisibility(resolution=64, lights=256)
fields = adaptive.precompute_for(scene, surface, progress=False)  # what the picture shows
lobes = adaptive.light(environment)
again = [np.asarray(adaptive.shade(fields, lobes, surface)) for _ in range(2)]
print(f"two frames of mc-adaptive agree to {flicker:.1f} dB; ", end="")
print(f"two of adaptive are the same: {np.array_equal(*again)}")

# %% [markdown]
# ## The light turns
#
# Stored visibility knows nothing of the light. Under another one `light` and `shade` are done
# again, and nothing else. Here the room turns about the objects by a quarter, under visibility that
# was made once:

# %%
vectorized = jaxvis.VectorizedVisibility(vectors=48, resolution=32, zeta=1.0)
reference = jaxvis.Reference(error=0.02)
turning = {"adaptive": adaptive, "vectorized": vectorized}
kept = {"adaptive": fields, "vectorized": vectorized.precompute(scene, progress=False)}
turned = environment.rotate(np.radians(90))
image = reference.solve(nothing, reference.light(turned), surface).image
per_light = {}
for name, method in turning.items():
    begin = time.perf_counter()
    shaded = np.asarray(method.shade(kept[name], method.light(turned), surface))
    per_light[name] = time.perf_counter() - begin, psnr(shaded, image, covered)
    print(f"{name:10} {per_light[name][0]:.2f} s, {per_light[name][1]:.1f} dB; ", end="")
    print(f"before: {rows[name]['psnr_db']:.1f} dB")

# %% [markdown]
# ## The scene moves
#
# Then all that is stored is out of date. `adaptive` carries maps over from frame to frame, and
# traces only directions in which something moved; the others begin again. Two balls roll in a dish:
# seconds of each of three frames after the first, and their rays.

# %%
animation = jaxvis.load_animation("balls:detail=16")
spent = {"carried": [], "anew": []}
for name, found in spent.items():
    previous = None
    for frame in range(4):
        moved = animation.scene(frame)
        view = jaxvis.trace_surface(moved, jaxvis.default_camera(moved, aspect=4 / 3), size)
        begin = time.perf_counter()
        maps = adaptive.precompute_for(moved, view, previous, progress=False)
        found.append((time.perf_counter() - begin, maps.rays_traced))
        previous = maps if name == "carried" else None
    seconds = ", ".join(f"{seconds:.2f}" for seconds, _ in found[1:])
    print(f"adaptive, {name:8} {seconds} s; {sum(rays for _, rays in found[1:]):,} rays")
again = rows["vectorized"]["precompute_s"]
print(f"(vectorized took {again:.2f} s for the torus, and would each time)")

# %% [markdown]
# ## Memory is short
#
# What is stored beside what it brings. Each family has knobs: here `adaptive` with fewer samples
# and with smaller maps.

# %%
small = {"adaptive": (rows["adaptive"]["visibility_bytes"], rows["adaptive"]["psnr_db"])}
for change in ({"budget": 0.05}, {"resolution": 32}):
    less = replace(adaptive, **change)
    found = less.precompute_for(scene, surface, progress=False)
    shaded = less.shade(found, less.light(environment), surface)
    name = ", ".join(f"{key} {value}" for key, value in change.items())
    small[f"adaptive, {name}"] = found.nbytes, psnr(shaded, truth, covered)

points = {name: (row["visibility_bytes"], row["psnr_db"]) for name, row in rows.items()}
figure, axis = plt.subplots(figsize=(8.5, 4.2), layout="constrained")
for name, at in (points | small).items():
    changed = name not in rows
    axis.plot(at[0] / 1e6, at[1], "o", color="#e45756" if changed else "#4c78a8")
    place = {"xytext": (-7, -4), "ha": "right"} if changed else {"xytext": (7, -4)}
    if name in ("vectorized", "adaptive"):  # their neighbours are on the right
        place = {"xytext": (0, 8 if name == "adaptive" else -16), "ha": "center"}
    axis.annotate(name, (at[0] / 1e6, at[1]), textcoords="offset points", **place)
axis.set_xscale("log")
axis.set_xlim(0.02, 10)
axis.xaxis.set_major_formatter("{x:g}")
axis.set_xlabel("stored visibility, MB")
axis.set_ylabel("PSNR, dB")
axis.grid(alpha=0.2)
plt.show()
for name, (nbytes, decibels) in small.items():
    print(f"{name:25} {nbytes / 1e6:6.2f} MB {decibels:5.1f} dB")

# %% [markdown]
# ## Surfaces shine
#
# With glossy materials the BRDF makes the integrand narrow, too. Estimators sample it; `adaptive`
# takes its lobe as one more spherical Gaussian; `hybrid-cones` leaves highlights out.

# %%
glossy = scene.with_materials(
    tuple(
        replace(material, base_colour=(0.3, 0.3, 0.3), specular=(0.3, 0.3, 0.3), roughness=0.35)
        for material in scene.materials
    )
).with_reflectance(jaxvis.reflectance.CookTorrance())
shining = jaxvis.trace_surface(glossy, camera, size)
polished = np.asarray(reference.solve(nothing, reference.light(environment), shining).image)
shines = {}
for name, spec in {
    "mc-mis": "mc-mis:spp=16",
    "adaptive": adaptive,
    "hybrid-cones": "hybrid-cones:voxels=32,texels=128",
}.items():
    method = jaxvis.methods.create(spec)
    found = method.precompute_for(glossy, shining, progress=False)
    shines[name] = np.asarray(
        method.shade(found, method.light(environment), shining, key=jax.random.key(0))
    )
for name, image in shines.items():
    print(f"{name:13} {rows[name]['psnr_db']:5.1f} dB diffuse, ", end="")
    print(f"{psnr(image, polished, covered):5.1f} dB glossy")
beside_errors(shines, polished, covered, brightness=0.6)

# %% [markdown]
# ## Advice
#
# Written by the numbers above, those of this run.


# %%
def told(name):
    """A method with its PSNR and frame time."""
    return f"`{name}`: {rows[name]['psnr_db']:.1f} dB in {rows[name]['frame_s']:.3f} s"


best = max(estimators, key=lambda name: rows[name]["psnr_db"])
kind = max(stored, key=lambda name: rows[name]["psnr_db"])
cheapest = min(turning, key=lambda name: per_light[name][0])
carried, anew = (sum(rays for _, rays in spent[how][1:]) for how in ("carried", "anew"))
lean = min(small, key=lambda name: small[name][0])
fewer = rows["visibility-field"]["rays_traced"] / rows["mc-mis"]["rays_traced"]
quality = {name: psnr(image, polished, covered) for name, image in shines.items()}
gloss = ", ".join(f"`{name}` {decibels:.1f} dB" for name, decibels in quality.items())
rough, smooth = (
    f"{rows[name]['curve'][0]['psnr_db']:.1f} dB in {rows[name]['curve'][0]['frame_s']:.3f} s"
    for name in ("mc-adaptive", "mc-adaptive+denoise")
)
memory = f"{small[lean][0] / 1e6:.2f} MB, {small[lean][1]:.1f} dB"
blurred = f"{rows['hybrid-cones']['psnr_db']:.1f} dB without it"
advice = [
    ("one picture is wanted", "an estimator", f"{told(best)}, nothing stored"),
    ("a scene stays", "stored visibility", f"{told(kind)}, paid after {pays[kind]:.0f} frames"),
    ("flicker disturbs", "stored visibility", f"`mc-adaptive` repeats itself to {flicker:.1f} dB"),
    ("few samples must do", "an estimator, denoised", f"at 1 sample {smooth}, else {rough}"),
    ("rays cost most", "`visibility-field`", f"{fewer:.0%} of `mc-mis`'s, at equal samples"),
    ("the light turns", f"`{cheapest}`", f"{per_light[cheapest][0]:.2f} s for a new light"),
    (
        "the scene moves",
        "`adaptive`, carried",
        f"{carried / anew:.0%} of the rays of a new start",
    ),
    ("memory is short", "an estimator, or small maps", f"{lean}: {memory}"),
    ("surfaces shine", "what keeps highlights", gloss),
    ("a bounce is wanted", "`hybrid-cones`", f"no other method here has one; {blurred}"),
]
table = ["| when | then | because here |", "|---|---|---|"]
Markdown("\n".join([*table, *(f"| {' | '.join(line)} |" for line in advice)]))
