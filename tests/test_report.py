"""The report of a hand-made comparison: numbers as text, tables, figures and the page."""

import csv as csv_reader
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from jaxvis.compare import Comparison, Yardstick
from jaxvis.image import exposure_of, read_image
from jaxvis.report import csv, figures, html, markdown, numbers, plain, write_report

WIDTH, HEIGHT = 24, 16
NASTY = "mc-mis:spp=4 <b>|&"


def sample_comparison() -> Comparison:
    """A reference, an exact copy of it, a slightly wrong method with a curve, and a failure."""
    random = np.random.default_rng(5)
    covered = np.zeros((HEIGHT, WIDTH), bool)
    covered[4:, 3:20] = True
    reference = random.gamma(2.0, 1.0, (HEIGHT, WIDTH, 3)).astype(np.float32)
    reference[~covered] = 0.0
    wrong = (1.1 * reference).astype(np.float32)
    yardstick = Yardstick(reference, covered, exposure_of(reference, covered))
    measured = {
        "precompute_s": 12.3,
        "light_s": 0.0021,
        "compile_s": 1.5,
        "frame_s": 0.25,
        "frames_timed": 5,
        "visibility_bytes": 123456,
        "rays_traced": 0,
        "evaluations": 4321,
        "notes": [],
    }
    rows = [
        {
            "method": "exact",
            "label": "exact",
            "parameters": {"rows": 3},
            "shading": "vertex",
            **yardstick.errors(reference),
            **measured,
            "image": "exact.exr",
            "png": "exact.png",
        },
        {
            "method": "mc-mis",
            "label": NASTY,
            "parameters": {"spp": 4, "compensation": False, "rows": None},
            "shading": None,
            **yardstick.errors(wrong),
            **{**measured, "frame_s": 0.02, "notes": ["half of it was <mended>"]},
            "curve": [
                {"spp": 1, "frame_s": 0.005, "psnr_db": 12.0},
                {"spp": 4, "frame_s": 0.02, "psnr_db": 18.0},
            ],
            "image": "mc-mis-spp-4-b.exr",
            "png": "mc-mis-spp-4-b.png",
        },
        {
            "method": "shadow-map",
            "label": "shadow-map",
            "parameters": {},
            "shading": None,
            **dict.fromkeys((*yardstick.errors(wrong), *measured)),
            "notes": [],
            "error": "12 edges <have> more than two faces",
        },
    ]
    results = {
        "schema": 1,
        "scene": "teapot",
        "environment": "windows",
        "size": [WIDTH, HEIGHT],
        "supersampling": 1,
        "reflectance": "Lambert()",
        "camera": {"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 1, 0], "field_of_view": 0.6},
        "scene_info": {
            "vertices": 10,
            "triangles": 12,
            "materials": 1,
            "covered_pixels": int(covered.sum()),
            "back_pixels": 17,
            "notes": ["3 zero-area faces were dropped"],
        },
        "environment_info": {"height": 8, "width": 16, "largest_radiance": 100.0},
        "seed": 7,
        "created": "2025-01-02T03:04:05+00:00",
        "versions": {"jaxvis": "0.1.0", "jax": "0.10"},
        "machine": {"cpu": "a processor", "cores": 2, "memory_gib": 23.4},
        "metric": {"exposure": yardstick.exposure, "peak": 1.0, "transfer": "sRGB", "notes": []},
        "display": {"exposure": yardstick.exposure, "transfer": "sRGB"},
        "reference": {
            "method": "reference",
            "parameters": {"error": 0.005},
            "seconds": 3.0,
            "from_cache": True,
            "relative_error": 0.004,
            "rays_traced": 1000,
            "evaluations": 2000,
            "image": "reference.exr",
            "png": "reference.png",
        },
        "results": rows,
    }
    images = {"reference": reference, "exact": reference, NASTY: wrong}
    background = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    return Comparison(results, images, covered.astype(np.float32), background)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return sample_comparison()


@pytest.fixture(scope="module")
def page(comparison) -> str:
    return html(comparison)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0 s"),
        (4.2e-6, "4.20 µs"),
        (0.00123, "1.23 ms"),
        (0.9996, "1.00 s"),
        (0.0123, "12.3 ms"),
        (1.234, "1.23 s"),
        (59.94, "59.9 s"),
        (125.4, "2 min 5 s"),
    ],
)
def test_seconds(value, text):
    assert numbers.seconds(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0, "0"),
        (999, "999"),
        (1000, "1.00 k"),
        (12_345_678, "12.3 M"),
        (10**15, "1000 T"),
    ],
)
def test_count(value, text):
    assert numbers.count(value) == text


def test_memory_is_binary():
    assert numbers.memory(1023) == "1.00 KiB"
    assert numbers.memory(512) == "512 B"
    assert numbers.memory(3 * 2**20) == "3.00 MiB"


def test_decibels_of_equal_and_failed_images():
    assert numbers.decibels({"psnr_db": None, "rmse": 0.0}) == "∞"
    assert numbers.decibels({"psnr_db": None, "rmse": None}) == "–"
    assert numbers.decibels({"psnr_db": 31.456, "rmse": 0.1}) == "31.46"


def test_markdown_has_a_row_per_method_and_marks_the_best(comparison):
    text = markdown(comparison)
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table) == 2 + 3
    cells = [re.split(r"(?<!\\)\|", line) for line in table]
    assert {len(line) for line in cells} == {len(cells[0])}
    assert cells[2][1].strip() == "exact"
    assert cells[2][2].strip() == "**∞**"
    assert "**20.0 ms**" in table[3]
    assert "**250 ms**" not in text
    assert "- shadow-map failed: 12 edges <have> more than two faces" in text


def test_csv_reads_back(comparison):
    rows = list(csv_reader.DictReader(io.StringIO(csv(comparison))))
    assert [row["label"] for row in rows] == ["exact", NASTY, "shadow-map"]
    assert rows[0]["psnr_db"] == "inf"
    assert float(rows[1]["rmse"]) == pytest.approx(comparison["results"][1]["rmse"])
    assert rows[2]["error"].startswith("12 edges")
    assert "curve" not in rows[0]


def test_plain_table_is_aligned(comparison):
    lines = plain(comparison).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines[:3]}) == 1
    assert lines[3].endswith("12 edges <have> more than two faces")


def test_error_map_uses_one_fixed_logarithmic_scale():
    error = np.array([[0.0, 1.0 / 255.0, 255.0**-0.5, 1.0, 5.0]])
    colours = figures.error_map(error, np.array([[True, True, True, True, False]]))
    assert np.array_equal(colours[0, 0], colours[0, 1])
    assert np.array_equal(colours[0, 3, :3], colours[0, 4, :3])
    brightness = colours[0, 1:4, :3].sum(axis=-1)
    assert np.all(np.diff(brightness) > 0.5)
    assert colours[0, :, 3].tolist() == [1, 1, 1, 1, 0]
    assert figures.scale_position(255.0**-0.5) == pytest.approx(0.5)


def test_plot_shows_curves_and_leaves_out_what_has_no_psnr(comparison):
    figure = figures.psnr_over_time(comparison)
    lines = [line for line in figure.axes[0].lines if line.get_marker() not in ("None", None)]
    assert [line.get_xydata().tolist() for line in lines] == [[[0.005, 12.0], [0.02, 18.0]]]
    assert figure.axes[0].get_xscale() == "log"
    names = [text.get_text() for text in figure.axes[0].texts]
    assert names == [NASTY]


def test_plot_without_any_point_says_so(comparison):
    empty = Comparison(
        {**comparison, "results": comparison["results"][:1]},
        comparison.images,
        comparison.coverage,
        comparison.background,
    )
    figure = figures.psnr_over_time(empty)
    assert "no method has a finite PSNR" in figure.axes[0].texts[0].get_text()


def test_names_at_the_edge_do_not_overlap(comparison):
    row = comparison["results"][1]
    rows = [
        {**row, "label": f"m{i}", "curve": [{"frame_s": 0.1, "psnr_db": 30 + 1e-3 * i}]}
        for i in range(12)
    ]
    crowded = Comparison(
        {**comparison, "results": rows}, {}, comparison.coverage, comparison.background
    )
    texts = figures.psnr_over_time(crowded).axes[0].texts
    heights = sorted(text.get_position()[1] for text in texts)
    assert len(heights) == 12
    assert np.diff(heights).min() > 0.05
    assert heights[-1] <= 1.0 + 1e-9


class _Reader(HTMLParser):
    """Collects tags, checks that they nest, and keeps the text."""

    VOID = ("meta", "img", "link", "br", "input", "path", "use")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] not in ("script", "style"):
            self.text += data


def _read(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    reader.close()
    assert not reader.open
    return reader


def test_page_is_well_formed_and_needs_no_network(page):
    reader = _read(page)
    for tag, attributes in reader.tags:
        for name in ("src", "href", "xlink:href"):
            assert attributes.get(name, "data:").startswith(("data:", "#")), (tag, attributes)
    assert "@import" not in page
    assert re.search(r"url\((?!#)", page) is None
    assert "prefers-color-scheme: dark" in page


def test_page_says_what_was_done(page):
    text = _read(page).text
    for words in (
        "teapot under windows",
        "24 × 16 pixels",
        "standard error of 0.4 %",
        "3 zero-area faces were dropped",
        "17 pixels see the back of a one-sided face",
        "half of it was <mended>",
        "shadow-map failed: 12 edges <have> more than two faces",
        NASTY,
        "a processor",
        "0.1.0",
        "display units (1 = white)",
        "PSNR (dB)",
        "seed 7",
    ):
        assert words in text, words


def test_page_escapes_what_users_name(page):
    assert "<b>|" not in page
    assert "<mended>" not in page
    assert "<have>" not in page


def test_images_on_the_page_are_the_images(page, comparison):
    images = [attributes for tag, attributes in _read(page).tags if tag == "img"]
    by_name = {image["alt"]: image for image in images if "src" in image}
    assert set(by_name) == {
        "reference",
        "exact",
        NASTY,
        "error of exact",
        f"error of {NASTY}",
    }
    import base64

    data = base64.b64decode(by_name[NASTY]["src"].partition(",")[2])
    with Image.open(io.BytesIO(data)) as picture:
        assert np.array_equal(np.asarray(picture), np.rint(255 * comparison.shown(NASTY)))
    data = base64.b64decode(by_name["error of exact"]["src"].partition(",")[2])
    with Image.open(io.BytesIO(data)) as picture:
        opacity = np.asarray(picture)[..., 3] / 255
    assert np.array_equal(opacity, comparison.coverage)


def test_shown_image_has_the_sky_and_radiance_does_not(comparison):
    empty = comparison.coverage == 0
    assert np.all(comparison.images["reference"][empty] == 0.0)
    assert np.all(comparison.shown("reference")[empty] > 0.1)
    assert np.array_equal(comparison.error("exact"), np.zeros((HEIGHT, WIDTH)))


def test_write_report(tmp_path, comparison):
    comparison.save(tmp_path)
    page = write_report(comparison, tmp_path)
    assert page == tmp_path / "index.html"
    assert {path.name for path in tmp_path.iterdir()} == {
        "index.html",
        "results.json",
        "results.md",
        "results.csv",
        "psnr_over_time.png",
        "comparison.png",
        "coverage.exr",
        *(f"reference{suffix}" for suffix in (".exr", ".png")),
        *(f"exact{suffix}" for suffix in (".exr", ".png", ".error.png")),
        *(f"mc-mis-spp-4-b{suffix}" for suffix in (".exr", ".png", ".error.png")),
    }
    stored = json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)
    assert stored == dict(comparison)
    assert np.array_equal(read_image(tmp_path / "reference.exr"), comparison.images["reference"])
    assert read_image(tmp_path / "comparison.png").shape[0] > HEIGHT


def test_report_of_nothing_but_failures(tmp_path, comparison):
    failed = Comparison(
        {**comparison, "results": comparison["results"][2:]},
        {"reference": comparison.images["reference"]},
        comparison.coverage,
        comparison.background,
    )
    write_report(failed, tmp_path)
    text = (tmp_path / "index.html").read_text()
    assert "shadow-map failed" in text
    assert 'id="stage"' not in text
    _read(text)


def test_every_part_of_the_page_is_packaged():
    """Files that are not Python reach a wheel only if pyproject.toml names them."""
    import tomllib
    from pathlib import Path

    import jaxvis.report

    folder = Path(jaxvis.report.__file__).parent
    project = folder.parents[1] / "pyproject.toml"
    if not project.exists():
        pytest.skip("jaxvis is installed without its sources")
    packaged = tomllib.loads(project.read_text())["tool"]["setuptools"]["package-data"]
    patterns = packaged["jaxvis.report"]
    parts = [path for path in folder.iterdir() if path.is_file() and path.suffix != ".py"]
    assert len(parts) == 2
    for path in parts:
        assert any(path.match(pattern) for pattern in patterns), path
