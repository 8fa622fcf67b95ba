"""Light from one picture: recovers the spherical Gaussians of a light through shade.

A known scene is rendered under a few lobes by signed distance fields; from that image, the scene
and the number of lobes alone, their axes, sharpnesses and colours are found again. The image is
linear in the light's energy: of many directions, that whose image explains most of what is left
gives the next lobe, and gradient descent (optax) through shade moves all that there are. What
tells sharpnesses is the softness of shadows and highlights.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

import jaxvis
from experiments.measuring import Row
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.methods.distance_field.method import DistanceField
from jaxvis.methods.distance_field.shade import shade_view, view_of
from jaxvis.scene import Scene, Surface, trace_surface
from jaxvis.sphere import SphericalGaussians
from jaxvis.sphere.gaussians import total

Render = Callable[[SphericalGaussians], Float[Array, "height width 3"]]

SHARPNESS = (2.0, 1000.0)
"""The range that is searched."""

DARK = -20.0
"""Logarithm of the energy of a lobe that has not been added yet."""


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("sphere-on-plane", "what is lit")
    size: tuple[int, int] = setting((96, 72), "of the image", metavar=("W", "H"))
    lobes: int = setting(3, "of the light")
    steps: int = setting(300, "of descent for each lobe")
    resolution: int = setting(64, "of the distance fields")
    noise: float = setting(0.0, "standard deviation by which each pixel is disturbed, relative")
    seed: int = setting(0, "of the lights and the noise")


class Recovery(NamedTuple):
    """Lobes, brightest first, and how far their image is from the given one."""

    lobes: SphericalGaussians
    error: float
    """Root mean square, over that of the image."""
    first_error: float
    """The same after the first lobe, before any descent."""


class Unknowns(NamedTuple):
    """Unbounded parameters of lobes. Energy, unlike amplitude, does not pull at sharpness."""

    vector: Float[Array, "lobes 3"]
    logit: Float[Array, "lobes"]
    """Of log sharpness in :data:`SHARPNESS`."""
    log_energy: Float[Array, "lobes 3"]

    def lobes(self) -> SphericalGaussians:
        low, high = np.log(SHARPNESS)
        sharpness = jnp.exp(low + (high - low) * jax.nn.sigmoid(self.logit))
        axis = self.vector / jnp.linalg.norm(self.vector, axis=-1, keepdims=True)
        return SphericalGaussians(
            axis, sharpness, jnp.exp(self.log_energy) / total(sharpness)[:, None]
        )


def from_energy(axis: np.ndarray, sharpness: np.ndarray, energy: np.ndarray) -> SphericalGaussians:
    """Lobes of these integrals over the sphere."""
    width = jnp.asarray(sharpness, jnp.float32)
    amplitude = jnp.asarray(energy, jnp.float32) / total(width)[:, None]
    return SphericalGaussians(jnp.asarray(axis, jnp.float32), width, amplitude)


def renderer(scene: Scene, size: tuple[int, int], resolution: int) -> tuple[Render, Surface]:
    """The scene's default view as a function of the light."""
    surface = trace_surface(scene, scene.camera, size)
    fields = DistanceField(resolution=resolution).precompute(scene, progress=False)
    view = view_of(fields, surface)
    return lambda lobes: shade_view(fields, lobes, view, surface), surface


def recover(
    render: Render,
    image: Float[Array, "height width 3"],
    count: int,
    *,
    steps: int = 300,
    step_size: float = 0.05,
    candidates: int = 128,
) -> Recovery:
    """``count`` lobes whose image is ``image``; ``steps`` of descent after each one is added.

    Until all are there sharpnesses stay as they were: free, one lobe would widen to stand for two.
    """
    scale = float(jnp.sqrt(jnp.mean(jnp.square(image))))

    def loss(unknowns: Unknowns) -> Float[Array, ""]:
        return jnp.mean(jnp.square((render(unknowns.lobes()) - image) / scale))

    optimizer = optax.adam(optax.cosine_decay_schedule(step_size, steps))

    @jax.jit
    def descend(unknowns: Unknowns, widths: float) -> tuple[Unknowns, Float[Array, ""]]:
        def step(carry, _):
            unknowns, state = carry
            update, state = optimizer.update(jax.grad(loss)(unknowns), state)
            update = update._replace(logit=widths * update.logit)
            return (jax.tree.map(jnp.add, unknowns, update), state), None

        (moved, _), _ = jax.lax.scan(step, (unknowns, optimizer.init(unknowns)), length=steps)
        return moved, loss(moved)

    offered, pictures = _candidates(render, candidates)
    dark = jnp.full((count, 3), DARK)
    unknowns = Unknowns(jnp.tile(jnp.array([[0.0, 1.0, 0.0]]), (count, 1)), jnp.zeros(count), dark)
    first, error = None, jnp.float32(1.0)
    for k in range(count):
        left = np.asarray(image - render(unknowns.lobes())).reshape(-1, 3)
        unknowns = _with_best(unknowns, k, offered, pictures, left)
        first = float(loss(unknowns)) if first is None else first
        unknowns, error = descend(unknowns, 0.0)
    for _ in range(2):
        unknowns, error = descend(unknowns, 1.0)
    lobes = unknowns.lobes()
    order = np.argsort(-np.asarray(lobes.integral()).sum(axis=-1))
    lobes = jax.tree.map(lambda leaf: leaf[order], lobes)
    return Recovery(lobes, float(error) ** 0.5, (first or 0.0) ** 0.5)


def _candidates(
    render: Render, count: int
) -> tuple[SphericalGaussians, Float[np.ndarray, "candidates pixels"]]:
    """Lobes of energy 1 all over the sphere, narrow ones and an eighth as many wide ones, and the
    images of each, in green."""
    axes, sharpness = [], []
    for number in (count, max(count // 8, 1)):
        k = np.arange(number) + 0.5
        height, turn = 1.0 - 2.0 * k / number, np.pi * (1.0 + 5.0**0.5) * k
        ring = np.sqrt(1.0 - height * height)
        axes.append(np.stack([ring * np.sin(turn), height, ring * np.cos(turn)], axis=-1))
        sharpness.append(np.full(number, number / 2.0))  # they just meet
    axis, width = np.concatenate(axes), np.concatenate(sharpness)
    lobes = from_energy(axis, np.maximum(width, 2.0 * SHARPNESS[0]), np.ones((len(axis), 3)))
    one = jax.jit(lambda lobe: render(lobe)[..., 1].reshape(-1))
    pictures = [
        one(jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], lobes)) for k in range(len(axis))
    ]
    return lobes, np.stack(pictures)


def _with_best(
    unknowns: Unknowns,
    k: int,
    offered: SphericalGaussians,
    pictures: Float[np.ndarray, "candidates pixels"],
    left: Float[np.ndarray, "pixels 3"],
) -> Unknowns:
    """Lobe ``k`` made the candidate that explains most of what is left of the image."""
    overlap = np.maximum(pictures @ left, 0.0)
    square = np.maximum(np.sum(pictures**2, axis=-1), 1e-12)
    best = int(np.argmax(np.sum(overlap**2, axis=-1) / square))
    energy = np.maximum(overlap[best] / square[best], 1e-3)
    low, high = np.log(SHARPNESS)
    share = (np.log(float(offered.sharpness[best])) - low) / (high - low)
    return Unknowns(
        unknowns.vector.at[k].set(offered.axis[best]),
        unknowns.logit.at[k].set(float(np.log(share / (1.0 - share)))),
        unknowns.log_energy.at[k].set(jnp.log(jnp.asarray(energy, jnp.float32))),
    )


def comparison(truth: SphericalGaussians, found: SphericalGaussians) -> list[Row]:
    """Each true lobe beside the recovered one whose axis is nearest; energy is red, green, blue."""
    rows = []
    for k in range(len(truth.sharpness)):
        cosine = np.asarray(found.axis) @ np.asarray(truth.axis[k])
        j = int(np.argmax(cosine))
        axis, own_axis = np.asarray(truth.axis[k]), np.asarray(found.axis[j])
        energy, own_energy = np.asarray(truth.integral()[k]), np.asarray(found.integral()[j])
        apart = np.linalg.norm(own_axis - axis)
        row: Row = {"lobe": k + 1}
        row |= _parts("", "xyz", axis) | _parts("recovered ", "xyz", own_axis)
        row["degrees apart"] = np.degrees(2.0 * np.arcsin(min(apart / 2.0, 1.0)))
        row["sharpness"] = float(truth.sharpness[k])
        row["recovered"] = float(found.sharpness[j])
        row |= _parts("energy ", "rgb", energy) | _parts("recovered ", "rgb", own_energy)
        rows.append(row)
    return rows


def _parts(prefix: str, names: str, values: Float[np.ndarray, "3"]) -> Row:
    """A vector as three columns."""
    return {prefix + name: float(value) for name, value in zip(names, values, strict=True)}


def random_lights(count: int, seed: int) -> SphericalGaussians:
    """Coloured lobes of sharpness 10 to 200 from above, at least half a radian apart."""
    random = np.random.default_rng(seed)
    axes: list[np.ndarray] = []
    while len(axes) < count:
        axis = random.normal(size=3)
        axis[1] = abs(axis[1]) + 0.3
        axis /= np.linalg.norm(axis)
        if all(axis @ other < np.cos(0.5) for other in axes):
            axes.append(axis)
    sharpness = np.exp(random.uniform(np.log(10.0), np.log(200.0), count))
    return from_energy(np.array(axes), sharpness, random.uniform(0.5, 3.0, (count, 3)))


def measure(settings: Settings, output: Output) -> None:
    """Renders a picture under random lobes and recovers them from it."""
    scene = jaxvis.load_scene(settings.scene)
    render, _ = renderer(scene, settings.size, settings.resolution)
    truth = random_lights(settings.lobes, settings.seed)
    image = render(truth)
    random = np.random.default_rng(settings.seed + 1)
    image = image * jnp.asarray(1.0 + settings.noise * random.normal(size=image.shape), jnp.float32)
    start = time.perf_counter()
    recovery = recover(render, image, settings.lobes, steps=settings.steps)
    seconds = time.perf_counter() - start
    output.table("lobes", "Recovered lobes", comparison(truth, recovery.lobes))
    of = {"RMSE": recovery.error, "after the first lobe": recovery.first_error, "s": seconds}
    output.table("image", "Error of the image, relative to its root mean square", [of])


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
