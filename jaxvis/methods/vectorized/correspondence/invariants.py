"""What every correspondence must fulfil, whatever the mesh (host)."""

import numpy as np
from jaxtyping import Int


def check_lists(
    triples: Int[np.ndarray, "faces room 3"],
    sizes: Int[np.ndarray, "faces"],
    counts: Int[np.ndarray, "faces 3"],
) -> None:
    """Every list goes round each polygon once, entity by entity: so it visits them all, in order.

    Args:
        triples: entities.
        sizes: of the lists.
        counts: of the polygons' entities.

    Raises:
        AssertionError: a list does not.
    """
    place = np.arange(triples.shape[1])
    own = place < sizes[:, None]
    following = np.where(place + 1 < sizes[:, None], place + 1, 0)
    after = np.take_along_axis(triples, following[..., None], axis=1)
    steps = np.where(own[..., None], (after - triples) % counts[:, None], 0)
    assert (steps <= 1).all(), "triples skip vectors, or go back"
    assert (steps.sum(axis=1) == np.where(counts > 1, counts, 0)).all(), "a list is not one turn"


def check_shared(
    links: Int[np.ndarray, "faces links 3"],
    lengths: Int[np.ndarray, "faces"],
    triples: Int[np.ndarray, "faces room 3"],
    sizes: Int[np.ndarray, "faces"],
) -> None:
    """Every list holds what was selected for its face, so that faces share it along edges.

    Raises:
        AssertionError: one does not.
    """
    base = np.int64(triples.shape[1])
    own = np.arange(triples.shape[1]) < sizes[:, None]
    selected = np.arange(links.shape[1]) < lengths[:, None]
    face = np.arange(len(sizes))[:, None]
    for x, y in ((0, 1), (1, 2), (2, 0)):
        held = ((face * base + triples[..., x]) * base + triples[..., y])[own]
        known = selected & (links[..., x] >= 0) & (links[..., y] >= 0)
        wanted = ((face * base + links[..., x]) * base + links[..., y])[known]
        assert np.isin(wanted, held).all(), "a selected link is missing"
