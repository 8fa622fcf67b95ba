"""Which rows a grid has, and what is said to grids that cannot be."""

import pytest

from jaxvis.sweep import Grid, read_grid, variants
from jaxvis.sweep.grid import split

TEXT = """
scene = ["sphere-on-plane", "plane"]
environment = "uniform"
size = [16, 12]
seed = [0, 1]
rotate = [0, 90]
albedo = 1

[[methods]]
name = "vectorized"
zeta = [0, 1.5]
shading = "tessellated"

[[methods]]
name = "mc-mis"
spp = 4
compensation = true
"""

METHODS = (
    "vectorized:zeta=0,shading=tessellated",
    "vectorized:zeta=1.5,shading=tessellated",
    "mc-mis:spp=4,compensation=true",
)


def written(tmp_path, text):
    path = tmp_path / "grid.toml"
    path.write_text(text)
    return path


def test_variants_are_all_combinations():
    assert variants("mc-mis") == ("mc-mis",)
    assert variants("vectorized", zeta=(0, 2), vectors=[32, 64]) == (
        "vectorized:zeta=0,vectors=32",
        "vectorized:zeta=0,vectors=64",
        "vectorized:zeta=2,vectors=32",
        "vectorized:zeta=2,vectors=64",
    )


def test_a_file_is_the_grid_that_it_describes(tmp_path):
    grid = read_grid(written(tmp_path, TEXT))
    assert grid == Grid(
        METHODS,
        scene=("sphere-on-plane", "plane"),
        environment=("uniform",),
        rotate=(0.0, 90.0),
        size=(16, 12),
        seed=(0, 1),
        albedo=1.0,
    )
    jobs = grid.jobs()
    assert len(jobs) == 2 * 1 * 2 * 3 * 2
    assert len({job.key for job in jobs}) == len(jobs)
    assert [job.seed for job in jobs[:4]] == [0, 1, 0, 1]
    assert [job.method for job in jobs[:6:2]] == list(METHODS)
    # Twelve rows in a row share the scene, and six of them the light.
    assert [len({job.view for job in jobs[:n]}) for n in (6, 7, 12, 13)] == [1, 2, 2, 3]


def test_a_list_of_names_will_do(tmp_path):
    assert read_grid(written(tmp_path, 'methods = ["mc-mis", "vectorized"]')).methods == (
        "mc-mis",
        "vectorized",
    )
    assert read_grid(written(tmp_path, 'methods = "mc-mis:spp=2"')).methods == ("mc-mis:spp=2",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("methods = [", "Invalid"),
        ('scene = "plane"', "it names no methods"),
        ('methods = "mc-miss"', "did you mean mc-mis"),
        ('methods = "mc-mis"\nscenes = "plane"', "a grid has no parameter 'scenes'; it has"),
        ('methods = "mc-mis"\nscene = []', "scene is empty"),
        ('methods = "mc-mis"\nseed = [1, 1]', "seed lists 1 twice"),
        ('methods = "mc-mis"\nseed = -1', "seed must be at least 0"),
        ('methods = "mc-mis"\nseed = 1.5', "seed: 1.5 is not an integer"),
        ('methods = "mc-mis"\nseed = true', "seed: True is not an integer"),
        ('methods = "mc-mis"\nscene = 3', "scene: 3 is not a text"),
        ('methods = "mc-mis"\nsize = 3', "size must be width and height"),
        ('methods = "mc-mis"\nsize = [0, 3]', "size: width must be at least 1"),
        ('methods = "mc-mis"\nrotate = nan', "rotate must be finite"),
        ('methods = "mc-mis"\nrotate = "left"', "rotate: 'left' is not a number"),
        ('methods = "mc-mis"\nreflectance = "shiny"', "shiny"),
        ('methods = "mc-mis"\nreflectance = ["ggx"]', "reflectance is one value of all rows"),
        ('methods = "mc-mis"\nalbedo = [0.5, 0.8]', "albedo is one value of all rows"),
        ('methods = "mc-mis"\nalbedo = 1.5', "albedo must lie in [0, 1], got 1.5"),
        ('methods = "mc-mis"\nalbedo = nan', "albedo must lie in [0, 1]"),
        ('methods = "mc-mis"\nalbedo = "grey"', "albedo: 'grey' is not a number"),
        ('methods = "mc-mis"\nreference = "truth"', "truth"),
        ("methods = 3", "methods: 3 is neither a name nor a table with a name"),
        ("[[methods]]\nspp = 3", "neither a name nor a table"),
        ('[[methods]]\nname = "mc-mis"\nspp = [[1]]', "spp cannot be [1]"),
        ('[[methods]]\nname = "mc-mis"\nspp = []', "methods is empty"),
        ('[[methods]]\nname = "mc-mis"\nspp = 0', "spp must be"),
        ('[[methods]]\nname = "mc-mis"\nzeta = 0', "no parameter 'zeta'"),
    ],
)
def test_what_is_no_grid_is_refused_in_one_line(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=r"grid\.toml: ") as error:
        read_grid(path)
    assert str(error.value).startswith(f"{path}: ")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"absent\.toml: no such file"):
        read_grid(tmp_path / "absent.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"binary\.toml"):
        read_grid(tmp_path / "binary.toml")


def test_parts_are_even_and_every_other_one_goes_backwards():
    jobs = Grid(("mc-mis",), seed=tuple(range(7))).jobs()
    parts = split(jobs, 3)
    assert [len(part) for part in parts] == [2, 2, 3]
    assert [job.seed for part in parts for job in part] == [0, 1, 3, 2, 4, 5, 6]
    assert [len(part) for part in split(jobs[:1], 2)] == [0, 1]


def test_parts_share_no_method_and_no_light_that_they_need_not():
    """Programs depend on the method, and on the size of a light's tables."""
    grid = Grid(
        ("mc-mis:spp=1", "vectorized", "mc-mis:spp=4", "visibility-field"),
        ("teapot", "hat"),
        ("windows", "uniform"),
        rotate=(0.0, 90.0),
    )
    parts = split(grid.jobs(), 4)
    assert [len(part) for part in parts] == [8, 8, 8, 8]
    assert [{job.method for job in part} for part in parts] == [
        {"mc-mis:spp=1", "mc-mis:spp=4"},
        {"mc-mis:spp=1", "mc-mis:spp=4"},
        {"vectorized"},
        {"visibility-field"},
    ]
    assert {job.environment for job in parts[0]} == {"windows"}
    assert {job.environment for job in parts[1]} == {"uniform"}
    assert [job.scene for job in parts[0]] == 4 * ["teapot"] + 4 * ["hat"]
    assert [job.scene for job in parts[1]] == 4 * ["hat"] + 4 * ["teapot"]
    assert sorted(repr(job) for part in parts for job in part) == sorted(map(repr, grid.jobs()))
