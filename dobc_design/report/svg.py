"""One look for all figures, and a drawing as SVG text that can stand inside a page.

The colours are those of Okabe and Ito that keep a contrast of 3:1 on white; in the SVG each is a CSS variable
with the colour itself as fallback, so that a page may exchange them in the dark.  Text stays text.  The
same drawing gives the same bytes: no date, no random identifiers.  pyplot is never imported.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from xml.etree import ElementTree

from matplotlib.figure import Figure

from dobc_design.plotting.look import BLUE, GREEN, GRID, INK, MARKERS, MUTED, PAPER, PURPLE, SERIES, VERMILLION, styled

__all__ = ["BLUE", "INK", "MARKERS", "MUTED", "PAPER", "SERIES", "VERMILLION", "svg_text"]

VARIABLES = {
    INK: "ink",
    MUTED: "muted",
    GRID: "grid",
    PAPER: "paper",
    BLUE: "blue",
    VERMILLION: "vermillion",
    GREEN: "green",
    PURPLE: "purple",
}

_FONT = re.compile(r"font-family:[^;]*")
_LONG_DECIMAL = re.compile(r"-?\d+\.\d{3,}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_COLOUR = re.compile(r"#[0-9a-f]{6}\b")


def svg_text(draw: Callable[[Figure], object], *, name: str, alt: str, width: float = 4.6, height: float = 2.9) -> str:
    """Draw on a new Figure (inches) and return one <svg> element.

    ``name`` begins its identifiers, so that several drawings can share a page; ``alt`` is its text alternative.
    """
    buffer = io.StringIO()
    with styled():
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
        figure.savefig(buffer, format="svg", metadata=nothing, transparent=True)
    return _inline(buffer.getvalue(), name=name, alt=alt)


def _inline(text: str, *, name: str, alt: str) -> str:
    """Make the SVG file an element of a page: own identifiers, colours as variables, nothing global."""
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if _local(child.tag) in ("metadata", "style"):  # a style inside would hold for the whole page
                parent.remove(child)
    new_names = _referenced(root, name)
    for element in root.iter():
        element.tag = _local(element.tag)
        attributes = {_local(key): value for key, value in element.attrib.items()}
        element.attrib.clear()
        for key, value in attributes.items():
            if key != "id":
                element.set(key, _attribute(key, value, new_names))
            elif value in new_names:
                element.set("id", new_names[value])
        if element.text is not None and not element.text.strip():
            element.text = None
        element.tail = None
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    root.set("xmlns", "http://www.w3.org/2000/svg")
    root.set("style", "stroke-linejoin: round; stroke-linecap: butt")
    root.set("role", "img")
    root.set("aria-label", alt)
    return ElementTree.tostring(root, encoding="unicode")


def _referenced(root: ElementTree.Element, name: str) -> dict[str, str]:
    """New identifiers for those that something refers to, numbered as they are met."""
    names: dict[str, str] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            found = _REFERENCE.findall(value) if "url(#" in value else []
            if _local(key) == "href":
                found = [value.removeprefix("#")]
            for old in found:
                names.setdefault(old, f"{name}-{len(names) + 1}")
    return names


def _attribute(key: str, value: str, names: dict[str, str]) -> str:
    if key == "href":
        return "#" + names[value.removeprefix("#")]
    if "url(#" in value:
        value = _REFERENCE.sub(lambda match: f"url(#{names[match.group(1)]})", value)
    if key == "style":
        value = _FONT.sub("font-family: inherit", value)
        value = _COLOUR.sub(lambda match: _variable(match.group()), value)
    if key == "d":
        value = " ".join(value.split())
    return _LONG_DECIMAL.sub(lambda match: f"{float(match.group()):.2f}".rstrip("0").rstrip("."), value)


def _variable(colour: str) -> str:
    return f"var(--figure-{VARIABLES[colour]}, {colour})" if colour in VARIABLES else colour


def _local(name: str) -> str:
    return name.rsplit("}", 1)[-1]
