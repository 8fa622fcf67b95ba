"""A comparison as tables, figures and one HTML page."""

from jaxvis.report.page import html
from jaxvis.report.tables import csv, markdown, plain
from jaxvis.report.write import write_report

__all__ = ["csv", "html", "markdown", "plain", "write_report"]
