"""The page, and the folder of a report."""

import base64
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from jaxvis.compare import Comparison
from jaxvis.image import read_image
from jaxvis.report import html, write_report


@pytest.fixture(scope="module")
def page(comparison) -> str:
    return html(comparison)


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


def test_page_says_what_was_done(page, nasty):
    text = _read(page).text
    for words in (
        "teapot under windows",
        "24 × 16 pixels",
        "standard error of 0.4 %",
        "3 zero-area faces were dropped",
        "17 pixels see the back of a one-sided face",
        "half of it was <mended>",
        "4 texels are negative",
        "Reference: relative error 0.004, not 0.001",
        "shadow-map failed: 12 edges <have> more than two faces",
        nasty,
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


def test_images_on_the_page_are_the_images(page, comparison, nasty):
    images = [attributes for tag, attributes in _read(page).tags if tag == "img"]
    by_name = {image["alt"]: image for image in images if "src" in image}
    assert set(by_name) == {
        "reference",
        "exact",
        nasty,
        "error of exact",
        f"error of {nasty}",
    }
    data = base64.b64decode(by_name[nasty]["src"].partition(",")[2])
    with Image.open(io.BytesIO(data)) as picture:
        assert np.array_equal(np.asarray(picture), np.rint(255 * comparison.shown(nasty)))
    data = base64.b64decode(by_name["error of exact"]["src"].partition(",")[2])
    with Image.open(io.BytesIO(data)) as picture:
        opacity = np.asarray(picture)[..., 3] / 255
    assert np.array_equal(opacity, comparison.coverage)


def test_shown_image_has_the_sky_and_radiance_does_not(comparison):
    empty = comparison.coverage == 0
    assert np.all(comparison.images["reference"][empty] == 0.0)
    assert np.all(comparison.shown("reference")[empty] > 0.1)
    assert np.array_equal(comparison.error("exact"), np.zeros((16, 24)))


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
    assert read_image(tmp_path / "comparison.png").shape[0] > 16


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
