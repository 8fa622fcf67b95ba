"""Sections about correspondence, and their place on the page."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.cli import main
from jaxvis.compare import prepare
from jaxvis.lighting import Environment
from jaxvis.methods import create
from jaxvis.report import Section, correspondence_sections, draw_seams, html
from jaxvis.report import sections as module
from tests.methods.corresponding_polygons import two_triangles


def test_a_page_holds_its_sections(comparison, nasty):
    page = html(
        comparison, [Section(f"Seams of {nasty}", "a < b", (draw_seams({"pixels": np.ones(3)}),))]
    )
    assert "<h2>Seams of mc-mis:spp=4 &lt;b&gt;|&amp;</h2><p>a &lt; b</p>" in page
    assert page.count("<svg") == html(comparison).count("<svg") + 1


def test_other_methods_have_no_sections():
    def setting():
        raise AssertionError("nothing is to be prepared")

    assert correspondence_sections({"vectorized": create("vectorized")}, setting, 3) == []


def test_a_correspondence_has_its_seams_and_its_triangle(monkeypatch):
    method = create("correspondence:vectors=16")
    monkeypatch.setattr(type(method), "precompute", lambda *_, **__: two_triangles())
    monkeypatch.setattr(type(method), "light", lambda *_: None)
    sides = np.array([[[1.0, 2.0, 3.0], [1.5, 2.0, 3.0]]], np.float32)
    monkeypatch.setattr(module, "sides_of_edges", lambda *_, **__: sides)
    monkeypatch.setattr(module, "mean_irradiance", lambda *_: 2.0)
    setting = prepare("plane:cells=2", Environment(jnp.ones((16, 32, 3))), (4, 4))
    (alone,) = correspondence_sections({"mine": method}, lambda: setting)
    assert alone.title == "Seams of mine"
    assert "at 1 edges" in alone.text
    (axes,) = alone.figures[0].axes
    label = axes.get_legend().get_texts()[0].get_text()
    assert label.startswith("pixels: mean 8.3 %")  # 0.5 in one of three channels, of 2
    _, drawn = correspondence_sections({"mine": method}, lambda: setting, 1)
    assert drawn.title == "Triangle 1 of mine"
    assert len(drawn.figures) == 1
    _, refused = correspondence_sections({"mine": method}, lambda: setting, 7)
    assert refused.text == "Not drawn: triangle must be from 0 to 1, got 7."


def test_a_triangle_without_correspondence_is_refused(tmp_path, capsys):
    arguments = ["compare", "--methods", "vectorized", "--triangle", "3", "--out", str(tmp_path)]
    assert main(arguments) == 2
    assert "--triangle draws `correspondence`: name it in --methods" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["correspondence", "correspondence:interpolation=direction"])
def test_correspondence_is_known_by_name(name):
    assert module.has_correspondence(create(name))
