"""The rays that are left to be traced, gathered into lists and settled again (host, compiled)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float, Float32, Int32, UInt8

from jaxvis.compiled import compiled
from jaxvis.methods.traced import Components
from jaxvis.methods.visibility_field.cull import ACCEPT, DROP, TRACE
from jaxvis.scene import RayTracer


class Turned(NamedTuple):
    """The same local directions in the frame of every point."""

    frames: Float[Array, "points 3 3"]
    local: Float[Array, "samples 3"]

    def gather(
        self,
        points: slice,
        places: Int32[np.ndarray, "rays"],
        along: Float32[np.ndarray, "rays 3"],
    ) -> None:
        """Writes the directions at flat ``places`` of some points' rays to ``along``."""
        _turn(np.asarray(self.frames)[points], np.asarray(self.local), places, along)


class Listed(NamedTuple):
    """Directions of their own for every point."""

    directions: Components

    def gather(
        self,
        points: slice,
        places: Int32[np.ndarray, "rays"],
        along: Float32[np.ndarray, "rays 3"],
    ) -> None:
        """Writes the directions at flat ``places`` of some points' rays to ``along``."""
        for axis, component in enumerate(self.directions):
            along[:, axis] = np.asarray(component)[points].take(places)


def settle(
    tracer: RayTracer,
    origins: Float32[np.ndarray, "points 3"],
    directions: Turned | Listed,
    first: int,
    decision: UInt8[np.ndarray, "points samples"],
) -> None:
    """Traces the rays that are left in some points' ``decision``, in the calling thread, and enters
    the answers: ACCEPT for those that nothing blocks, DROP for the others.

    Args:
        directions: of a whole block of points, of which these are those from ``first`` on.
    """
    count = np.count_nonzero(decision == TRACE)
    if not count:
        return
    places = np.empty(count, np.int32)
    starts = np.empty((count, 3), np.float32)
    along = np.empty((count, 3), np.float32)
    _list(decision, origins, places, starts)
    directions.gather(slice(first, first + len(decision)), places, along)
    _enter(tracer.occluded_block(starts, along), places, decision.reshape(-1))


@compiled
def _list(decision, origins, places, starts):
    """The places of rays to trace, point after point, and their origins."""
    ray = 0
    samples = decision.shape[1]
    for point in range(decision.shape[0]):
        for sample in range(samples):
            if decision[point, sample] == TRACE:
                places[ray] = point * samples + sample
                for axis in range(3):
                    starts[ray, axis] = origins[point, axis]
                ray += 1


@compiled
def _turn(frames, local, places, along):
    """Directions of rays that have their points' frames in common."""
    samples = len(local)
    for ray in range(len(places)):
        point, sample = places[ray] // samples, places[ray] % samples
        frame = frames[point]
        for axis in range(3):
            along[ray, axis] = (
                frame[0, axis] * local[sample, 0]
                + frame[1, axis] * local[sample, 1]
                + frame[2, axis] * local[sample, 2]
            )


@compiled
def _enter(blocked, places, decision):
    """What tracing told."""
    for ray in range(len(places)):
        decision[places[ray]] = DROP if blocked[ray] else ACCEPT
