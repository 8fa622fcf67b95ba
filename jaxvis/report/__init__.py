"""A comparison as tables, figures and one HTML page."""

from jaxvis.report.correspondence import draw_correspondence, draw_seams
from jaxvis.report.figures import psnr_over_time
from jaxvis.report.page import html
from jaxvis.report.sections import Section, correspondence_sections, has_correspondence
from jaxvis.report.sheets import beside_errors, sheet
from jaxvis.report.tables import csv, markdown, plain
from jaxvis.report.write import write_report

__all__ = [
    "Section",
    "beside_errors",
    "correspondence_sections",
    "csv",
    "draw_correspondence",
    "draw_seams",
    "has_correspondence",
    "html",
    "markdown",
    "plain",
    "psnr_over_time",
    "sheet",
    "write_report",
]
