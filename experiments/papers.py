"""Every table and figure of the four papers, and what of this repository shows it.

An item is shown by scripts of :mod:`experiments` (by name), by a command of ``jaxvis`` (text that
begins so), or by nothing: it is missing then, or a diagram or list that has no measurement.
"""

from dataclasses import dataclass

PAPERS = {
    "000": "All frequency direct illumination using visibility correspondence (Leung et al. 2021)",
    "001": "Precomputed discrete visibility fields (Xu et al. 2022)",
    "002": "Parallel and adaptive visibility sampling (Wang et al. 2014)",
    "003": "Global illumination by hybrid cone tracing (Liu et al. 2020)",
}


@dataclass(frozen=True)
class Item:
    """A table or figure of a paper.

    ``by`` are the scripts and commands that show it. ``lacks`` says what of it they do not, or, of
    an item that nothing shows, why. A ``diagram`` explains and measures nothing.
    """

    paper: str
    label: str
    what: str
    by: tuple[str, ...] = ()
    lacks: str = ""
    diagram: bool = False

    @property
    def state(self) -> str:
        """``shown``, ``partly``, ``missing`` or ``diagram``."""
        if self.diagram and not self.by:
            return "diagram"
        if not self.by:
            return "missing"
        return "partly" if self.lacks else "shown"

    @property
    def scripts(self) -> tuple[str, ...]:
        """Names of the scripts among ``by``, without their options."""
        return tuple(by.split()[0] for by in self.by if not by.startswith("jaxvis "))


TRIANGLE = "jaxvis compare --methods correspondence --triangle 914"
"""Draws the Voronoi diagram and the entity layout of one triangle."""

ITEMS = (
    Item("000", "fig. 1", "vectorized visibility at a sample", diagram=True),
    Item("000", "fig. 2", "spherical Voronoi diagram of a triangle", (TRIANGLE,), diagram=True),
    Item("000", "fig. 3", "entity layout of a triangle", (TRIANGLE,), diagram=True),
    *(
        Item("000", f"fig. {number}", what, diagram=True)
        for number, what in {
            4: "a triple that rule 1 rejects",
            5: "a triple that rule 2 rejects",
            6: "partial triples of adjacent triangles",
            7: "partial triples completed",
            8: "partial triples propagated",
            9: "triples under relaxed constraints",
        }.items()
    ),
    Item("000", "table 1", "sizes and build times", ("correspondence_table",)),
    Item(
        "000",
        "fig. 10",
        "pictures over the tessellation quality",
        ("zeta_sweep --out DIR",),
        "pictures of vectorized, not of correspondence",
    ),
    Item(
        "000",
        "fig. 11",
        "PSNR over the tessellation quality",
        ("correspondence_table --sweep", "zeta_sweep"),
    ),
    Item("000", "fig. 12", "shadow boundaries per fragment", ("per_fragment --out DIR",)),
    Item(
        "000",
        "fig. 13",
        "frame time over the tessellation quality",
        ("correspondence_table --sweep", "zeta_sweep"),
    ),
    Item(
        "000",
        "fig. 14",
        "scores of phones' GPUs",
        lacks="a list of another site's scores: nothing to run",
        diagram=True,
    ),
    Item("000", "fig. 15", "beside distance fields, per fragment", ("per_fragment --out DIR",)),
    Item(
        "000",
        "fig. 16",
        "PSNR and MSE over time beside Monte Carlo",
        ("equal_time --out DIR",),
    ),
    Item("000", "fig. 17", "pictures beside Monte Carlo at equal time", ("equal_time --out DIR",)),
    Item(
        "000",
        "fig. 18",
        "pictures of MIS IDES at more and more samples",
        ("equal_time --out DIR",),
    ),
    Item(
        "000",
        "fig. 19",
        "pictures with textures",
        ("jaxvis render correspondence --scene sponza --environment stpeters",),
        "the paper's own models are not public",
    ),
    Item(
        "001",
        "fig. 1",
        "Sponza and Bistro",
        ("visibility_field_table --scene sponza bistro --out DIR",),
    ),
    Item("001", "fig. 2", "overview", diagram=True),
    Item("001", "fig. 3", "merging of masks", diagram=True),
    Item("001", "fig. 4", "a layer of the texture array", ("drawings --out DIR",)),
    Item(
        "001",
        "fig. 5",
        "pictures with and without the field, and their difference",
        ("visibility_field_table --scene sponza bistro --out DIR",),
    ),
    Item("001", "table 1", "frame time over rays a pixel", ("visibility_field_table --spp-sweep",)),
    Item(
        "001",
        "fig. 6",
        "numbers of point samples",
        ("visibility_field_table --samples-sweep",),
    ),
    Item("001", "fig. 7", "sizes of cells", ("visibility_field_table --cell-sweep",)),
    Item(
        "001",
        "fig. 8",
        "rays a pixel",
        ("visibility_field_table --spp-sweep",),
        "errors, not pictures",
    ),
    Item(
        "001",
        "fig. 9",
        "occlusion labels",
        ("visibility_field_table --scene bistro --labels",),
        "numbers; labels are not drawn",
    ),
    Item("001", "fig. 10", "glossy materials", ("visibility_field_table --glossy",)),
    Item("002", "table 1", "three moving scenes", ("adaptive_table --what table1",)),
    Item(
        "002",
        "fig. 1",
        "the hat and the cloth",
        ("jaxvis render adaptive --scene hat --environment windows",),
        "a scene of our own in place of the paper's",
    ),
    Item("002", "fig. 2", "parametrisation of the hemisphere", diagram=True),
    Item("002", "fig. 3", "overview", diagram=True),
    Item(
        "002",
        "fig. 4",
        "visibility maps refined",
        ("adaptive_table --what maps", "drawings --out DIR"),
    ),
    Item(
        "002",
        "fig. 5",
        "samples placed",
        ("adaptive_table --what placement", "drawings --out DIR"),
    ),
    Item("002", "fig. 6", "thresholds and resolutions", ("adaptive_table --what thresholds",)),
    Item("002", "fig. 7", "beside shadow maps", ("adaptive_table --what resolution",)),
    Item("002", "fig. 8", "beside Monte Carlo", ("adaptive_table --what equal --out DIR",)),
    Item(
        "002",
        "fig. 9",
        "more moving scenes",
        (
            "adaptive_table --what frames",
            "jaxvis render adaptive --scene balls --environment uffizi --frames 0:60",
        ),
        "scenes of our own in place of the paper's",
    ),
    Item("003", "table 1", "real-time methods of others", diagram=True),
    Item("003", "fig. 1", "flow chart", diagram=True),
    Item("003", "fig. 2", "cubes fitted to a cone", diagram=True),
    Item("003", "fig. 3", "a cone over a height field", diagram=True),
    Item("003", "fig. 4", "light sampled from both lightmaps", diagram=True),
    Item("003", "fig. 5", "the height field cut by projections", diagram=True),
    Item("003", "fig. 6", "hybrid cone tracing", ("cone_table --what quality --out DIR",)),
    Item("003", "fig. 7", "ray-traced ground truth", ("cone_table --what quality --out DIR",)),
    Item("003", "fig. 8", "voxel cone tracing", ("cone_table --what quality --out DIR",)),
    Item("003", "table 2", "memory", ("cone_table --what memory",)),
)


def shown_by(script: str) -> list[Item]:
    """The tables and figures that a script shows."""
    return [item for item in ITEMS if script in item.scripts]
