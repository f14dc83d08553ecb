"""Names for two controls of the theme that have a wrong one or none: the search button, the arrows
beside pages."""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

NAMES = (
    # what stands on it is its name
    ('title="Search" aria-label="Search" data-bs', 'title="Search" data-bs'),
    (
        '<summary><span class="toctree-toggle"',
        '<summary aria-label="Pages below"><span class="toctree-toggle"',
    ),
)


def name(app: Sphinx, failure: Exception | None) -> None:
    """Change the pages where they still need it."""
    for page in Path(app.outdir).rglob("*.html"):
        text = new = page.read_text("utf-8")
        for old, better in NAMES:
            new = new.replace(old, better)
        if new != text:
            page.write_text(new, "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by sphinx."""
    app.connect("build-finished", name)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
