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
# # Gradients
#
# jaxvis' pictures are JAX programs. Methods that trace no rays while shading can be differentiated:
# JAX turns the program for an image into one for the derivative of any number made from it, with
# respect to the light, the materials, or constants of the method. Visibility is precomputed and
# held fixed, so that there are no derivatives with respect to geometry.
#
# This notebook descends three such gradients: to tune a constant of a method, to find a light from
# one picture, and to find a material from one picture. The last two are small cases of what is
# called inverse rendering.

# %%
from dataclasses import replace

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
import pandas as pd

import jaxvis
from jaxvis.image import display, exposure_of, relative_rmse
from jaxvis.methods.distance_field.shade import shade_view, view_of
from jaxvis.methods.vectorized import tuning
from jaxvis.report import beside_errors
from jaxvis.sphere import SphericalGaussians, latlong
from jaxvis.sphere.gaussians import total


def descend(loss, start, steps, rate):
    """Adam from ``start``: (parameters before each step, losses there)."""
    optimizer = optax.adam(optax.cosine_decay_schedule(rate, steps))

    def step(carry, _):
        free, state = carry
        value, gradient = jax.value_and_grad(loss)(free)
        update, state = optimizer.update(gradient, state)
        return (optax.apply_updates(free, update), state), (free, value)

    return jax.lax.scan(step, (start, optimizer.init(start)), length=steps)[1]


# %% [markdown]
# ## A constant of a method
#
# Vectorized visibility integrates light over polygons, edge by edge (notebook 02). The paper's
# rule, *vsat*, looks up the light above and below an edge, $E$ and $F$, and mixes them (paper 000,
# eqs. 10 and 11):
#
# $$(1 - \beta) E + \beta F, \qquad \beta = \tfrac12 + \tfrac12 \tanh(\alpha' x_c).$$
#
# $x_c$ is the signed angle from the edge to the mean direction of the light between the two
# look-ups. The sharpness $\alpha'$ says how fast $\beta$ goes from 0 to 1 as that light moves over
# the edge. It is a constant, which the paper puts at 5.8. Which is best?
#
# `tuning.sample_polygons` takes some of a scene's polygons and integrates them with every edge cut
# into pieces shorter than a texel, where $\beta$ no longer matters. `tuning.relative_error` is
# vsat's error for these, a differentiable function of $\alpha'$. The gradient, beside differences:

# %%
scene = jaxvis.load_scene("sphere-on-plane:clearance=0.4,size=8,cells=8,rows=16")
environment = jaxvis.load_environment("windows").resize(128)
method = jaxvis.VectorizedVisibility(
    vectors=16, resolution=48, integration="vsat", shading="fragment", sharpness="paper"
)
polygons = method.precompute(scene, progress=False)
light = method.light(environment)
samples = tuning.sample_polygons(polygons, light, jax.random.key(0), 128)


def error_of(log_sharpness):
    return tuning.relative_error(samples, light, jnp.exp(log_sharpness))


lines = []
for sharpness in (2.0, 5.8, 20.0, 60.0):
    at = np.log(sharpness)
    gradient = float(jax.grad(error_of)(jnp.float32(at)))
    difference = float(error_of(at + 0.02) - error_of(at - 0.02)) / 0.04
    lines.append({"α'": sharpness, "gradient": gradient, "difference": difference})
pd.DataFrame(lines)

# %% [markdown]
# Both are with respect to $\ln \alpha'$. Adam descends from the paper's value. The curve is a scan,
# which for a single parameter could have found the optimum itself; the descent gets there without
# being told where to look. (It must not start too far out: where the hyperbolic tangent is
# saturated, there is no gradient.)

# %%
slope = jax.value_and_grad(lambda log: error_of(log) ** 2)
optimizer = optax.adam(0.15, eps=1e-20)
log = jnp.log(jnp.float32(5.8))
state = optimizer.init(log)
course = []
for _ in range(30):
    value, gradient = slope(log)
    course.append((float(jnp.exp(log)), float(jnp.sqrt(value))))
    update, state = optimizer.update(gradient, state)
    log = optax.apply_updates(log, update)
course = np.array(course)
best = course[np.argmin(course[:, 1]), 0]

scanned = np.geomspace(1, 1000, 16)
plt.figure(figsize=(7, 3.4), layout="constrained")
plt.semilogx(scanned, [100 * error_of(np.log(a)) for a in scanned], color="#888888", label="scan")
plt.plot(course[:, 0], 100 * course[:, 1], "o-", ms=4, color="#d6423b", label="descent")
plt.axhline(100 * error_of(-np.inf), ls=":", color="#222222", label="β = 1/2")
plt.xlabel("α' per radian")
plt.ylabel("error, % of unoccluded")
plt.legend()
plt.show()
print(f"5.8: {error_of(np.log(5.8)):.3%}   {best:.1f}: {error_of(np.log(best)):.3%}")

# %% [markdown]
# An edge of these polygons is long: they have 16 vectors at most. Does the optimum show in images?
# The reference below is the image by the same polygons, with finely cut edges, so that only the
# integration differs.

# %%
size = (96, 72)
camera = jaxvis.Camera(eye=(4.2, 4.4, 5.4), target=(0.5, 0.6, 0.0), field_of_view=0.6)
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)
fine = replace(method, integration="split", pieces=8, lookup="bilinear")
exact = fine.shade(polygons, fine.light(environment), surface)
images = {
    name: np.asarray(
        method.shade(polygons, replace(light, sharpness=jnp.float32(sharpness)), surface)
    )
    for name, sharpness in (("β = 1/2", 0.0), ("α' = 5.8", 5.8), (f"α' = {best:.1f}", best))
}
beside_errors(images, exact, mask, brightness=0.6)

# %% [markdown]
# `tuning.fit_sharpness` does all this in one call, and can fit $\alpha'$ times the edge's length
# instead (`scaled=True`); `python -m experiments.tune_beta` runs it over scenes, lights and budgets
# of vectors.
#
# ## A light from a picture
#
# Now for an image. Light is a sum of spherical Gaussians, $G(l) = \mu\, e^{\lambda (l \cdot p -
# 1)}$, and `DistanceField` shades with it through signed distances (notebook 04). What a lobe's
# axis $p$ changes are shadows, which these distances make smooth: a method with hard visibility
# bits would give no derivative there.
#
# Given a picture $I$ of a known scene under one lobe of known sharpness and energy, where is the
# lobe? The loss is the squared error over the image's own square,
#
# $$\ell(p) = \frac{\sum (R(p) - I)^2}{\sum I^2}.$$
#
# First its landscape, over the upper hemisphere (equal-area, seen from above), with descents from
# six starts.

# %%
scene = jaxvis.load_scene("torus-on-plane:cells=20,around=36")
camera = jaxvis.Camera(eye=(4.4, 4.6, 7.4), target=(0.0, 0.2, 0.0), field_of_view=0.6)
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)
method = jaxvis.DistanceField(resolution=48)
fields = method.precompute(scene, progress=False)


def lobes_of(free):
    """Spherical Gaussians of free parameters; of energy, since that does not pull at sharpness."""
    axis = free["axis"] / jnp.linalg.norm(free["axis"], axis=-1, keepdims=True)
    sharpness = jnp.exp(free["log_sharpness"])
    amplitude = jnp.exp(free["log_energy"]) / total(sharpness)[:, None]
    return SphericalGaussians(axis, sharpness, amplitude)


def render(free):
    return method.shade(fields, lobes_of(free), surface)


one = {
    "axis": jnp.array([[-0.6, 0.6, 0.4]]),
    "log_sharpness": jnp.log(jnp.array([40.0])),
    "log_energy": jnp.zeros((1, 3)),
}
image = render(one)


def loss_of_axis(axis):
    return jnp.sum((render(one | {"axis": axis}) - image) ** 2) / jnp.sum(image**2)


def disc(direction):
    """Equal-area view from above: x to the right, z downwards."""
    scale = 1 / np.sqrt(1 + direction[..., 1])
    return direction[..., 0] * scale, direction[..., 2] * scale


height, turn = np.meshgrid(np.linspace(1, 0.02, 12) ** 2, np.linspace(0, 2 * np.pi, 33))
ring = np.sqrt(1 - height**2)
grid = np.stack([ring * np.cos(turn), height, ring * np.sin(turn)], axis=-1).astype(np.float32)
losses = jax.jit(lambda axes: jax.lax.map(loss_of_axis, axes))(grid.reshape(-1, 1, 3))
losses = np.asarray(losses).reshape(height.shape)

angle = 2 * np.pi * np.arange(6) / 6 + 0.3
starts = np.stack([np.cos(angle), np.full(6, 0.5), np.sin(angle)], axis=-1).astype(np.float32)
follow = jax.jit(lambda start: descend(loss_of_axis, start, steps=100, rate=0.1))
paths = [follow(start[None]) for start in starts]

plt.figure(figsize=(6, 4.8), layout="constrained")
levels = np.linspace(0, losses.max(), 15)
contours = plt.contourf(*disc(grid), losses, levels=levels, cmap="viridis")
for path, _ in paths:
    path = np.asarray(path)[:, 0]
    path = path / np.linalg.norm(path, axis=-1, keepdims=True)
    plt.plot(*disc(path), ".-", color="white", lw=0.8, ms=3)
    plt.plot(*disc(path[0]), "o", color="white")
plt.plot(*disc(np.asarray(lobes_of(one).axis[0])), "*", ms=15, color="#d6423b")
plt.colorbar(contours, label="loss", format="%.2f")
plt.gca().set_aspect("equal")
plt.gca().invert_yaxis()
plt.axis("off")
plt.show()
print("last losses:", ", ".join(f"{float(values[-1]):.1e}" for _, values in paths))

# %% [markdown]
# The star is the light. There is one basin here, and all six starts are led into it.
#
# ## Two lights, all unknown
#
# Two coloured lobes now, and nothing is known of them but their number: axes, sharpnesses and
# energies are all free, 14 numbers. The start is two wide white lobes beside each other overhead.

# %%
truth = {
    "axis": jnp.array([[-0.6, 0.6, 0.4], [0.7, 0.5, 0.1]]),
    "log_sharpness": jnp.log(jnp.array([60.0, 15.0])),
    "log_energy": jnp.log(jnp.array([[3.0, 2.0, 1.0], [0.4, 0.9, 1.8]])),
}
start = {
    "axis": jnp.array([[0.0, 1.0, 0.3], [0.0, 1.0, -0.3]]),
    "log_sharpness": jnp.log(jnp.array([8.0, 8.0])),
    "log_energy": jnp.zeros((2, 3)),
}
image = render(truth)


def loss_of_light(free):
    return jnp.sum((render(free) - image) ** 2) / jnp.sum(image**2)


course, losses = jax.jit(lambda s: descend(loss_of_light, s, steps=300, rate=0.1))(start)

towards = latlong.texel_directions(32, 64).astype(np.float32)
shown = {"target": truth} | {
    f"step {k}": jax.tree.map(lambda leaf, k=k: leaf[k], course) for k in (0, 25, 60, 299)
}
exposure = exposure_of(image, mask)
figure, axes = plt.subplots(2, 5, figsize=(13, 4), layout="constrained", height_ratios=(3, 2))
for (above, below), (name, free) in zip(axes.T, shown.items(), strict=True):
    above.imshow(np.where(mask[..., None], display(render(free), 0.6 * exposure), 1))
    above.set_title(name)
    below.imshow(display(lobes_of(free).mixture(towards), 0.1))
for axis in axes.flat:
    axis.set_axis_off()

figure, axes = plt.subplots(1, 2, figsize=(11, 3), layout="constrained")
axes[0].semilogy(losses, color="#222222")
axes[0].set_ylabel("loss")
for k, colour in enumerate(("#3b6fd6", "#c98a2b")):
    axes[1].semilogy(np.exp(course["log_sharpness"][:, k]), color=colour, label=f"lobe {k}")
    axes[1].axhline(np.exp(truth["log_sharpness"][k]), color="#222222", ls=":")
axes[1].set_ylabel("sharpness")
axes[1].legend()
for axis in axes:
    axis.set_xlabel("step")
plt.show()

# %% [markdown]
# Above the scene, below the light as a panorama. Axes and colours come first. Sharpnesses, dotted
# where they should end, come last: they show in nothing but the softness of shading and shadows.
# Found and true:

# %%
found, true = lobes_of(shown["step 299"]), lobes_of(truth)
lines = []
for k in range(2):
    j = int(np.argmax(np.asarray(found.axis) @ true.axis[k]))  # lobes come in any order
    chord = np.linalg.norm(found.axis[j] - true.axis[k])
    line = {"lobe": k, "degrees apart": np.degrees(2 * np.arcsin(chord / 2))}
    line |= {"sharpness": float(true.sharpness[k]), "found": float(found.sharpness[j])}
    for name, energy in (("energy", true.integral()[k]), ("found energy", found.integral()[j])):
        line[name] = ", ".join(f"{e:.2f}" for e in energy)
    lines.append(line)
pd.DataFrame(lines).round(2)

# %% [markdown]
# The start need not be near, but with more lobes it must be better than here. `python -m
# experiments.inverse_lighting` adds one lobe at a time: of many directions, the one whose image
# explains most of what is left.
#
# ## A material from a picture
#
# A teapot under the windows: its base colour and its roughness are unknown. `shade` finds the
# pixels on the host, which cannot be compiled; so this is done once, by `view_of`, and materials
# are replaced in its list of fragments. Colour and roughness stay in (0, 1) as logistic
# functions of free numbers.

# %%
scene = jaxvis.load_scene("teapot:subdivisions=6,plane_cells=16")
scene = scene.with_reflectance(jaxvis.reflectance.CookTorrance())
camera = jaxvis.Camera(eye=(2.0, 5.2, 10.6), target=(0.2, 0.95, 0.0), field_of_view=0.5)
surface = jaxvis.trace_surface(scene, camera, size)
mask = np.asarray(surface.mask)
environment = environment.resize(64)
method = jaxvis.DistanceField(resolution=48, lights=64)
fields = method.precompute(scene, progress=False)
light = method.light(environment)
view = view_of(fields, surface)


def painted(material, free):
    """Materials in which the pot, all that is glossy, has these free parameters."""
    pot = material.specular[..., 0] > 0
    colour, roughness = jax.nn.sigmoid(free["colour"]), jax.nn.sigmoid(free["roughness"])
    return replace(
        material,
        base_colour=jnp.where(pot[..., None], colour, material.base_colour),
        roughness=jnp.where(pot, roughness, material.roughness),
    )


def free_of(colour, roughness):
    logit = jax.scipy.special.logit
    return {"colour": logit(jnp.array(colour)), "roughness": logit(jnp.float32(roughness))}


@jax.jit
def render_material(free):
    fragments = replace(view.fragments, material=painted(view.fragments.material, free))
    return shade_view(fields, light, replace(view, fragments=fragments), surface)


truth, start = free_of([0.6, 0.12, 0.06], 0.3), free_of([0.5, 0.5, 0.5], 0.7)
image = render_material(truth)


def loss_of_material(free, image):
    return jnp.sum((render_material(free) - image) ** 2) / jnp.sum(image**2)


gradient = jax.grad(loss_of_material)(start, image)
lines = []
for name, h in (("colour", np.float32([0.02, 0, 0])), ("roughness", np.float32(0.02))):
    ends = [loss_of_material(start | {name: start[name] + s * h}, image) for s in (1, -1)]
    difference = float(ends[0] - ends[1]) / 0.04
    lines.append({"of": name, "gradient": float(np.ravel(gradient[name])[0])})
    lines[-1]["difference"] = difference
pd.DataFrame(lines)

# %% [markdown]
# The picture is fitted twice. Once it is the method's own, from which descent should find exactly
# what made it. And once it is the reference's, by rays and every texel, as a photograph would be:
# then what the method does not model goes into the parameters.

# %%
reference = jaxvis.Reference(error=0.02)
seen = replace(surface, material=painted(surface.material, truth))
photograph = reference.shade(
    reference.precompute(scene), reference.light(environment), seen, key=jax.random.key(0)
)
follow = jax.jit(
    lambda image: descend(lambda f: loss_of_material(f, image), start, steps=100, rate=0.3)
)
courses = {"its own": (image, *follow(image)), "the reference's": (photograph, *follow(photograph))}

exposure = exposure_of(image, mask)
figure, axes = plt.subplots(2, 5, figsize=(13, 4.4), layout="constrained")
for line, (name, (target, course, _)) in zip(axes, courses.items(), strict=True):
    shown = {f"target: {name}": target} | {
        f"step {k}": render_material(jax.tree.map(lambda leaf, k=k: leaf[k], course))
        for k in (0, 5, 20, 99)
    }
    for axis, (title, picture) in zip(line, shown.items(), strict=True):
        axis.imshow(np.where(mask[..., None], display(picture, exposure), 1))
        axis.set_title(title)
        axis.set_axis_off()

figure, axes = plt.subplots(1, 2, figsize=(11, 3.2), layout="constrained", sharey=True)
for axis, (name, (_, course, _)) in zip(axes, courses.items(), strict=True):
    axis.plot(jax.nn.sigmoid(course["roughness"]), color="#222222", label="roughness")
    axis.axhline(0.3, color="#222222", ls=":")
    for k, colour in enumerate(("#d6423b", "#3f9b4f", "#3b6fd6")):
        axis.plot(jax.nn.sigmoid(course["colour"][:, k]), color=colour, label="base, " + "rgb"[k])
        axis.axhline(float(jax.nn.sigmoid(truth["colour"][k])), color=colour, ls=":")
    axis.set_title(f"target: {name}")
    axis.set_xlabel("step")
axes[1].legend(loc="upper right", fontsize=8)
plt.show()

# %%
lines = []
for name, free in {
    "true": truth,
    "start": start,
    **{k: jax.tree.map(lambda leaf: leaf[-1], course) for k, (_, course, _) in courses.items()},
}.items():
    line = dict(zip("rgb", np.asarray(jax.nn.sigmoid(free["colour"])), strict=True))
    line |= {"material": name, "roughness": float(jax.nn.sigmoid(free["roughness"]))}
    lines.append(line | {"error": relative_rmse(render_material(free), photograph, mask)})
pd.DataFrame(lines).set_index("material").round(4)

# %% [markdown]
# (The error is relative, against the reference's picture.) From its own picture the method finds
# the material. From the reference's, the parameters are a little off, and the picture is a little
# nearer to the target than with the true ones: what shading by signed distances and 64 lobes gets
# wrong is made up for by them. A fitted parameter is as good as the model that it was fitted with.
#
# What else can be differentiated: texels of an environment and albedo through `vectorized`
# (`shade_planned`), constants such as the sharpness above, and signed distances themselves.
