"""What the theme leaves out for people who cannot see or point: axe-core finds nothing in the pages
then."""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

# The search button shows "Search Ctrl+K", so "Search" must not be its name; a toggle of the
# navigation shows an icon.
NAMES = (
    (
        'search-button__button pst-js-only" title="Search" aria-label="Search"',
        'search-button__button pst-js-only"',
    ),
    (
        '<summary><span class="toctree-toggle"',
        '<summary aria-label="Pages below"><span class="toctree-toggle"',
    ),
    ('<th class="head"><p></p></th>', "<td></td>"),  # the corner of a table is no heading
    # a wide card scrolls by keys, too
    ('<div class="dobc-shown">', '<div class="dobc-shown" tabindex="0">'),
)


def name_controls(text: str) -> str:
    """The page with a name on each of them."""
    for nameless, named in NAMES:
        text = text.replace(nameless, named)
    return text


def _finish(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.format == "html":
        for page in Path(app.outdir).rglob("*.html"):
            text = page.read_text("utf-8")
            if (named := name_controls(text)) != text:
                page.write_text(named, "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
