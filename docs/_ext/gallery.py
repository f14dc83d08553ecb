"""The notebooks as a gallery; each thumbnail is the last picture that the run of its notebook has
drawn."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from executed import NOTEBOOKS
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


class Gallery(Directive):
    """The notebooks, each with a picture of its own, its title, and what one learns from it."""

    def run(self) -> list[nodes.Node]:
        """Called by docutils."""
        cards = []
        for path in NOTEBOOKS:
            first = "".join(json.loads(path.read_text("utf-8"))["cells"][0]["source"])
            title, learned = re.match(
                r"# (.+?)\n\nWhat you learn here: (.+?)(?:\n\n|$)", first, re.DOTALL
            ).groups()
            picture = f'<img src="../_static/thumbnails/{path.stem}.png" alt="" loading="lazy">'
            learned = learned.replace("\n", " ").replace("*", "")
            learned = learned[0].upper() + learned[1:]
            cards.append(
                f'<a href="{path.stem}.html">{picture}<b>{title}</b><span>{learned}</span></a>'
            )
        return [nodes.raw("", f'<div class="gallery">{"".join(cards)}</div>', format="html")]


def thumbnails(app: Sphinx, failure: Exception | None) -> None:
    """Copy the last picture of every notebook's page; there is none where notebooks are not run."""
    if failure is not None or not app.config.run_notebooks:
        return
    place = Path(app.outdir) / "_static" / "thumbnails"
    place.mkdir(parents=True, exist_ok=True)
    for notebook in NOTEBOOKS:
        page = Path(app.outdir) / "gallery" / f"{notebook.stem}.html"
        shown = re.findall(r'src="\.\./(_images/[^"]+\.png)"', page.read_text("utf-8"))
        if not shown:
            raise ExtensionError(f"{notebook.name} shows no picture for the gallery.")
        shutil.copyfile(Path(app.outdir) / shown[-1], place / f"{notebook.stem}.png")


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by sphinx."""
    app.add_directive("gallery", Gallery)
    app.connect("build-finished", thumbnails)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
