"""One self-contained HTML page: images, error maps, table and plot, readable without a network."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.colors import to_hex
from PIL import Image

from jaxvis.compare import Comparison
from jaxvis.compare.result import REFERENCE
from jaxvis.report import figures, numbers
from jaxvis.report.sections import Section
from jaxvis.report.tables import COLUMNS, best_rows, summary

THEME_BUTTON = '<button id="theme" aria-label="switch between light and dark">◐</button>'


def html(comparison: Comparison, sections: Sequence[Section] = ()) -> str:
    """The page. Works in light and dark; without JavaScript all but wiping and sorting remains.

    Args:
        comparison: what it is about.
        sections: that follow the plot.
    """
    title = f"{escape(comparison['scene'])} under {escape(comparison['environment'])}"
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}: jaxvis</title>",
        f"<style>{_resource('page.css')}</style></head><body>",
        _header(comparison),
        *_notices(comparison),
        _stage(comparison),
        _numbers(comparison),
        _grid(comparison),
        _plot(comparison),
        *map(_section, sections),
        _details(comparison),
        f"<footer>jaxvis {escape(str(comparison['versions']['jaxvis']))}, "
        f"{escape(comparison['created'])}</footer>",
        f"<script>{_resource('page.js')}</script></body></html>",
    ]
    return "\n".join(parts) + "\n"


def _resource(name: str) -> str:
    return resources.files("jaxvis.report").joinpath(name).read_text(encoding="utf-8")


def _header(comparison: Comparison) -> str:
    return (
        f'<header><p class="eyebrow">jaxvis comparison</p>{THEME_BUTTON}'
        f"<h1>{escape(comparison['scene'])} <em>under</em> {escape(comparison['environment'])}</h1>"
        f'<p class="facts">{escape(summary(comparison))}.</p></header>'
    )


def _notices(comparison: Comparison) -> Iterable[str]:
    info = comparison["scene_info"]
    texts = [f"Scene: {note}" for note in info["notes"]]
    if info["back_pixels"]:
        texts.append(
            f"{info['back_pixels']:,} pixels see the back of a one-sided face, which is black in "
            "every image."
        )
    texts += comparison["notes"]
    texts += [f"Reference: {note}" for note in comparison["reference"]["notes"]]
    for row in comparison["results"]:
        texts += [f"{row['label']}: {note}" for note in row["notes"]]
    for text in dict.fromkeys(texts):
        yield f'<p class="notice">{escape(text)}</p>'
    for row in comparison.failed:
        text = f"{row['label']} failed: {row['error']}"
        yield f'<p class="notice bad">{escape(text)}</p>'


def _stage(comparison: Comparison) -> str:
    choices = "".join(
        f'<button data-card="card-{i}"><i class="swatch" style="background:{figures.colour_of(i)}">'
        f"</i>{escape(row['label'])}</button>"
        for i, row in enumerate(comparison["results"])
        if "error" not in row
    )
    if not choices:
        return ""
    width, height = comparison["size"]
    modes = (("wipe", "wipe"), ("flip", "flip"), ("error", "error map"))
    zooms = (("fit", "fit"), ("1", "1:1"), ("2", "2:1"), ("4", "4:1"))
    mode_buttons = "".join(f'<button data-mode="{m}">{text}</button>' for m, text in modes)
    zoom_buttons = "".join(f'<button data-zoom="{z}">{text}</button>' for z, text in zooms)
    return (
        '<section id="look"><h2>Against the reference</h2>'
        "<p>Choose a method; the edge follows the pointer.</p>"
        f'<div class="bar"><span id="choices">{choices}</span></div>'
        f'<div id="frame"><div id="stage" data-width="{width}" data-height="{height}">'
        '<img alt="reference"><img alt="the chosen method"><div id="edge"></div>'
        '<span class="tag left"></span><span class="tag right"></span></div></div>'
        f'<div class="bar"><span id="modes">{mode_buttons}</span>'
        f'<span id="zooms">{zoom_buttons}</span>'
        '<span class="hint"><kbd>1</kbd>–<kbd>9</kbd> method &nbsp; <kbd>w</kbd> wipe &nbsp; '
        "<kbd>f</kbd> flip &nbsp; <kbd>e</kbd> error</span></div></section>"
    )


def _numbers(comparison: Comparison) -> str:
    rows = comparison["results"]
    heads = ['<th scope="col" data-first="ascending"><button>method</button></th>']
    for column in COLUMNS:
        first = "descending" if column.best is max else "ascending"
        heads.append(
            f'<th scope="col" data-first="{first}" title="{escape(column.explanation)}">'
            f"<button>{escape(column.title)}</button></th>"
        )
    best = [best_rows(column, rows) for column in COLUMNS]
    body = []
    for i, row in enumerate(rows):
        cells = [_label_cell(row["label"], i)]
        if "error" in row:
            cells.append(f'<td class="error" colspan="{len(COLUMNS)}">{escape(row["error"])}</td>')
        else:
            for column, winners in zip(COLUMNS, best, strict=True):
                value = column.value(row)
                data = "" if value is None else str(value).replace("inf", "Infinity")
                mark = ' class="best"' if i in winners else ""
                cells.append(f'<td{mark} data-value="{data}">{escape(column.text(row))}</td>')
        body.append(f"<tr>{''.join(cells)}</tr>")
    exposure = numbers.significant(comparison["metric"]["exposure"], 4)
    return (
        "<section><h2>Numbers</h2>"
        "<p>PSNR and FLIP compare sRGB images after one exposure for all, taken from the "
        f"reference ({exposure}); RMSE and relMSE compare linear radiance. Only pixels that see "
        "the scene count. Times are of this machine, warm, without compilation.</p>"
        f'<div class="scroll"><table><thead><tr>{"".join(heads)}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div></section>"
    )


def _label_cell(label: str, index: int) -> str:
    swatch = f'<i class="swatch" style="background:{figures.colour_of(index)}"></i>'
    return f'<td data-value="{escape(label)}">{swatch}{escape(label)}</td>'


def _grid(comparison: Comparison) -> str:
    reference = comparison["reference"]
    seconds = "cached" if reference["from_cache"] else numbers.seconds(reference["seconds"])
    cards = [
        f'<figure><div class="pair">{_image(comparison.shown(REFERENCE), "reference", REFERENCE)}'
        f"</div><figcaption><b>reference</b><span>{escape(seconds)}</span></figcaption>"
        f"{_scale()}</figure>"
    ]
    for i, row in enumerate(comparison["results"]):
        if "error" in row:
            continue
        label = row["label"]
        errors = figures.error_map(comparison.error(label), comparison.covered)
        caption = f"{numbers.decibels(row)} dB · {numbers.seconds(row['frame_s'])} a frame"
        cards.append(
            f'<figure id="card-{i}"><div class="pair" data-tag="reference">'
            f"{_image(comparison.shown(label), label)}</div>"
            f'<div class="map">{_image(errors, f"error of {label}")}</div>'
            f'<figcaption><b><i class="swatch" style="background:{figures.colour_of(i)}"></i>'
            f"{escape(label)}</b><span>{escape(caption)}</span></figcaption></figure>"
        )
    return (
        "<section><h2>Side by side</h2>"
        "<p>Each image above its error map. Hover or click an image to see the reference in its "
        f'place.</p><div class="grid">{"".join(cards)}</div></section>'
    )


def _scale() -> str:
    """The colour bar of the error maps."""
    colours = colormaps[figures.ERROR_MAP]
    stops = ",".join(to_hex(colours(t)) for t in np.linspace(0.0, 1.0, 17))
    ticks = "".join(
        f'<span style="left:{100 * figures.scale_position(t):.2f}%">{figures.tick_text(t)}</span>'
        for t in figures.ERROR_TICKS
    )
    return (
        f'<div class="scale"><i style="background:linear-gradient(90deg,{stops})"></i>'
        f"<div>{ticks}</div>Error maps: {escape(figures.ERROR_LABEL)}, root mean square over the "
        "channels, on a logarithmic scale that is the same in every report.</div>"
    )


def _plot(comparison: Comparison) -> str:
    drawing = figures.svg(figures.psnr_over_time(comparison, figures.INK))
    return (
        "<section><h2>Quality over time</h2>"
        "<p>Up and to the left is better. Methods that sample are a curve over samples per pixel: "
        f'1, 4, 16 and so on.</p><div class="plot">{drawing}</div></section>'
    )


def _section(section: Section) -> str:
    drawings = "".join(
        f'<div class="plot">{figures.svg(figure)}</div>' for figure in section.figures
    )
    words = f"<h2>{escape(section.title)}</h2><p>{escape(section.text)}</p>"
    return f"<section>{words}{drawings}</section>"


def _details(comparison: Comparison) -> str:
    camera = comparison["camera"]
    sections: dict[str, dict[str, Any]] = {
        "scene": {
            "name": comparison["scene"],
            **{k: v for k, v in comparison["scene_info"].items() if k != "notes"},
            "reflectance": comparison["reflectance"],
        },
        "light": {"name": comparison["environment"], **comparison["environment_info"]}
        | {f"lamp {i}": _lamp(lamp) for i, lamp in enumerate(comparison.get("lamps", ()), 1)},
        "camera": {
            **camera,
            "size": comparison["size"],
            "supersampling": comparison["supersampling"],
        },
        "reference": {
            k: v
            for k, v in comparison["reference"].items()
            if k not in ("image", "png", "parameters", "notes")
        }
        | comparison["reference"]["parameters"],
        "metric": {k: v for k, v in comparison["metric"].items() if k != "notes"}
        | {"display_exposure": comparison["display"]["exposure"]},
        "machine": comparison["machine"],
        "versions": comparison["versions"],
    }
    for row in comparison["results"]:
        sections[row["label"]] = row["parameters"]
    blocks = "".join(
        f"<section><h3>{escape(name)}</h3><dl>{_definitions(values)}</dl></section>"
        for name, values in sections.items()
        if values
    )
    notes = "".join(f"<p>{escape(note)}.</p>" for note in comparison["metric"]["notes"])
    return f'<section><h2>Details</h2>{notes}<div class="details">{blocks}</div></section>'


def _lamp(lamp: dict[str, Any]) -> str:
    return ", ".join(f"{key} {_text(value)}" for key, value in lamp.items())


def _definitions(values: dict[str, Any]) -> str:
    return "".join(
        f"<dt>{escape(_words(key))}</dt><dd>{escape(_text(value))}</dd>"
        for key, value in values.items()
    )


def _words(key: str) -> str:
    return key.replace("_gib", " (GiB)").replace("_", " ")


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: numbers.MISSING}[value]
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(v) for v in value)
    return str(value)


def _image(pixels: Float[np.ndarray, "height width channels"], alt: str, id: str = "") -> str:
    """An <img> that holds its own .png."""
    buffer = io.BytesIO()
    Image.fromarray(np.rint(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)).save(
        buffer, "png", optimize=True
    )
    data = base64.b64encode(buffer.getvalue()).decode()
    named = f'id="{id}" ' if id else ""
    height, width = pixels.shape[:2]
    return (
        f'<img {named}alt="{escape(alt)}" width="{width}" height="{height}" '
        f'src="data:image/png;base64,{data}">'
    )
