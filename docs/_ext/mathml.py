"""Formulas as MathML, which browsers draw without loading anything."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx

from dobc_design._show.text import mathml


def inline(writer: object, node: nodes.math) -> None:
    """Within a line."""
    writer.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def block(writer: object, node: nodes.math_block) -> None:
    """On lines of its own."""
    # Aligned lines are separated by an empty one in the source; each is a formula of its own.
    for line in node.astext().split("\n\n"):
        writer.body.append(f'<div class="equation">{mathml(line, display=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.connect("config-inited", choose)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def choose(app: Sphinx, config: object) -> None:
    """Take it without being asked."""
    config.html_math_renderer = "mathml"
