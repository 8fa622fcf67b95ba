"""What a page shows besides the comparison itself: sections about single methods."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jaxvis.compare import Setting
from jaxvis.methods import Method
from jaxvis.methods.vectorized.correspondence.method import VisibilityCorrespondence
from jaxvis.methods.vectorized.correspondence.seams import (
    differences,
    mean_irradiance,
    sides_of_edges,
)
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.report.correspondence import draw_correspondence, draw_seams
from jaxvis.report.figures import INK


class Section(NamedTuple):
    """A part of the page."""

    title: str
    text: str
    figures: tuple[Figure, ...]


def has_correspondence(method: Method) -> bool:
    """Whether there are seams and triangles to be drawn."""
    return isinstance(method, VisibilityCorrespondence)


def correspondence_sections(
    methods: Mapping[str, Method], setting: Callable[[], Setting], triangle: int | None = None
) -> list[Section]:
    """The seams of each correspondence among methods, and pictures of a triangle's.

    Args:
        methods: by label.
        setting: makes what was compared; called if there is something to show.
        triangle: which is drawn; none if None.
    """
    chosen = {k: m for k, m in methods.items() if isinstance(m, VisibilityCorrespondence)}
    if not chosen:
        return []
    place = setting()
    sections = []
    for label, method in chosen.items():
        visibility = method.precompute(place.scene, progress=False)
        sections.append(_seams(label, method, visibility, place))
        if triangle is not None:
            sections.append(_triangle(label, visibility, triangle))
    return sections


def _seams(
    label: str, method: VisibilityCorrespondence, visibility: CorrespondingPolygons, place: Setting
) -> Section:
    light = method.light(place.environment)
    unit = 0.01 * mean_irradiance(method, visibility, light, place.surface)
    seams = {
        name: differences(sides_of_edges(visibility, light, method.quadrature, clipped=c)) / unit
        for name, c in (("pixels", True), ("triples alone", False))
    }
    separate = int(np.count_nonzero(np.asarray(visibility.separate)))
    text = (
        "How much the light at the midpoint of an edge differs between the triangles on its two "
        f"sides, at {len(seams['pixels']):,} edges. Their triples differ; in pixels, so do the "
        f"planes below which nothing is seen. {separate:,} of {len(visibility.separate):,} "
        "triangles keep three evaluations."
    )
    return Section(f"Seams of {label}", text, (draw_seams(seams, INK),))


def _triangle(label: str, visibility: CorrespondingPolygons, triangle: int) -> Section:
    title = f"Triangle {triangle} of {label}"
    try:
        drawing = draw_correspondence(visibility, triangle, INK)
    except ValueError as error:  # the comparison, which took longer, is worth its page
        return Section(title, f"Not drawn: {error}.", ())
    text = (
        "Left, the position vectors of the triangle's three corners, a column for each, and the "
        "triples that make them correspond. Right, whose vector is nearest in each direction of "
        "the hemisphere, seen from the triangle's middle; white dots are the RGB tripoints from "
        "which triples are chosen."
    )
    return Section(title, text, (drawing,))
