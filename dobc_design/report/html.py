"""A document as one HTML page: no script, no network, readable on paper, on a phone and in the dark."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from dobc_design.report.document import Document, in_form, leads, pieces
from dobc_design.report.formulas import math
from dobc_design.report.pictures import svg_of
from dobc_design.report.words import capitalize_first, typeset


def html_page(document: Document) -> str:
    """The page.  The same document gives the same text."""
    environment = Environment(
        loader=PackageLoader("dobc_design.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "capitalize_first": capitalize_first,
        "kind": lambda value: type(value).__name__,
        "math": math,
        "pieces": pieces,
        "svg": svg_of,
        "typeset": typeset,
    }
    template = environment.get_template("document.html.j2")
    return template.render(document=in_form(document, "html"), leads=leads) + "\n"
