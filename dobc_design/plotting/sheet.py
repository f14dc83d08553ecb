"""A finished figure that shows itself in a notebook and saves itself to a file."""

from __future__ import annotations

import io
from collections.abc import Callable
from os import PathLike
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dobc_design.errors import SpecError
from dobc_design.plotting.look import styled

KINDS = ("png", "svg", "pdf")
DOTS = 160  # per inch, of pictures in pixels


class Sheet:
    """A figure of this package's look.  ``figure`` is Matplotlib's, for changes before it is saved."""

    def __init__(self, draw: Callable[[Figure], object], *, width: float, height: float) -> None:
        with styled(), np.errstate(all="ignore"):
            self.figure = Figure(figsize=(width, height), layout="constrained")
            draw(self.figure)

    def file(self, kind: str) -> bytes:
        """The figure as a file: "png", "svg" or "pdf"; no dates in it."""
        buffer = io.BytesIO()
        nothing = {
            "png": {"Software": None},
            "pdf": {"CreationDate": None},
            "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
        }
        with styled(), np.errstate(all="ignore"):  # an axis that ends at 1e300 has ticks beyond the floats
            self.figure.savefig(buffer, format=kind, dpi=DOTS, facecolor="white", metadata=nothing[kind])
        return buffer.getvalue()

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the figure to ``path``, .png, .svg or .pdf.  Raises: SpecError."""
        place = Path(path)
        kind = place.suffix.lower().removeprefix(".")
        if kind not in KINDS:
            raise SpecError(
                f"a figure is saved as .png, .svg or .pdf; got {place.name[:40]!r}.",
                key="path",
                cure="Choose one of these endings.",
            )
        return write_new(place, self.file(kind), force=force)

    def _repr_png_(self) -> bytes:
        return self.file("png")


def write_new(place: Path, data: bytes, *, force: bool) -> Path:
    """Write a file that must not be there yet, unless ``force``.  Raises: SpecError."""
    if place.exists() and not force:
        raise SpecError(f"{str(place)!r} exists already.", key="path", cure="Replace it with force=True.")
    place.write_bytes(data)
    return place
