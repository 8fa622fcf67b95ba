"""The pages under docs/ name files, links and packages that exist."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

import jaxvis

ROOT = Path(jaxvis.__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
SHOWN = ["sphere", "sampling", "lighting", "reflectance", "scene", "image", "methods", "compare"]


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^)]+)\)", page.read_text())
    assert links
    for link in links:
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    named = re.findall(r"`((?:jaxvis|tests|docs|experiments)/[\w/.]*)`", page.read_text())
    assert named
    for name in named:
        assert (ROOT / name).exists(), name


def test_the_picture_shows_the_packages_in_the_order_that_is_enforced():
    picture = ElementTree.parse(ROOT / "docs" / "architecture.svg")
    texts = [
        node.text for node in picture.iter("{http://www.w3.org/2000/svg}text") if node.get("y")
    ]
    shown = [text for text in texts if text in [*SHOWN, "report", "cli"]]
    # compare and report also stand in the picture's upper part.
    assert shown[-10:] == [*SHOWN, "report", "cli"]
    for name in shown:
        assert (ROOT / "jaxvis" / name).is_dir() or (ROOT / "jaxvis" / f"{name}.py").is_file()
