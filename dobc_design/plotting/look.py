"""The one look of all figures, the sheet that saves itself, and what plots share: thinning, names,
ticks, legends.

The colours are those of Okabe and Ito that keep a contrast of 3:1 on white: they can be told apart
by people with any colour vision.  Names of users are never read as mathematics.  pyplot is never
imported.
"""

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, StrMethodFormatter
from numpy.typing import NDArray

from dobc_design.errors import refused

INK, MUTED, GRID, PAPER = "#1b1e24", "#5b6470", "#d8dce2", "#fefefe"
BLUE, VERMILLION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, INK, MUTED)
DASHED, DOTTED = (0, (4, 2)), (0, (1, 1.4))
MARKERS = ("o", "s", "^", "D", "v", "P")
MOST_POINTS = 400  # of one series
MOST_AGENTS = 30  # lines in one plot
SHOWN_NAME = 18  # letters
SMALLEST = 1e-14  # below it an error on a logarithmic axis is rounding
# of its start: where a bound is below, a simulated error is that of the integration, and no
# comparison
RESOLVED = 1e-9
STEEP = 30  # most over least value from which an axis is logarithmic
FEW_DECADES = 3  # up to which 1, 2 and 5 of each are marked
DOTS = 160  # per inch, of pictures in pixels
#: What a file says about its making: nothing, by its kind.
NOTHING: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None},
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

# Matplotlib's parameters belong to the process; they are put back after each figure
_LOCK = threading.Lock()


@contextmanager
def styled() -> Iterator[None]:
    """Matplotlib's parameters as figures.mplstyle has them, for one thread at a time."""
    with _LOCK, style.context(["default", "dobc_design.plotting.figures"]):
        yield


class Sheet:
    """A finished figure that shows itself in a notebook; ``figure`` is Matplotlib's, for changes
    before it is saved."""

    def __init__(
        self, draw: Callable[[Figure], object], *, width: float, height: float, title: str = ""
    ) -> None:
        with styled(), np.errstate(all="ignore"):
            self.figure = Figure(figsize=(width, height), layout="constrained")
            draw(self.figure)
            if title:
                self.figure.suptitle(title, fontsize=10, x=0.01, ha="left", parse_math=False)

    def file(self, kind: str) -> bytes:
        """The figure as a file: "png", "svg" or "pdf"; no dates in it."""
        buffer = io.BytesIO()
        made_by = NOTHING[kind]
        # an axis that ends at 1e300 has ticks beyond the floats
        with styled(), np.errstate(all="ignore"):
            self.figure.savefig(buffer, format=kind, dpi=DOTS, facecolor="white", metadata=made_by)
        return buffer.getvalue()

    def save(self, path: str | PathLike[str], *, force: bool = True) -> Path:
        """Write the figure to ``path``, .png, .svg or .pdf.  Raises: SpecError."""
        place = Path(path)
        kind = place.suffix.lower().removeprefix(".")
        if kind not in NOTHING:
            told = f"a figure is saved as .png, .svg or .pdf; got {place.name[:40]!r}."
            raise refused("path", told, "Choose one of these endings.")
        return write_new(place, self.file(kind), force=force)

    def _repr_png_(self) -> bytes:
        return self.file("png")


def sheet_or_axes(
    draw: Callable[[Axes], Axes], ax: Axes | None, *, width: float, height: float
) -> Sheet | Axes:
    """What ``draw`` puts into ``ax``, which is returned; without it a sheet of its own, sizes in
    inches."""
    if ax is not None:
        return draw(ax)
    return Sheet(lambda figure: draw(figure.subplots()), width=width, height=height)


def write_new(place: Path, data: bytes, *, force: bool) -> Path:
    """Write a file that must not be there yet, unless ``force``.  Raises: SpecError."""
    if place.exists() and not force:
        told = f"{str(place)!r} exists already."
        raise refused("path", told, "Replace it with force=True.")
    place.write_bytes(data)
    return place


def resolved(bound: NDArray[np.float64]) -> NDArray[np.float64]:
    """A falling bound as far as a simulated error can be held against it; nan beyond."""
    return np.where(bound >= RESOLVED * bound[0], bound, np.nan)


def power_of_ten(value: float, _: object = None) -> str:
    """Write 0.001 as 10⁻³ and 1 as 1."""
    if value <= 0:
        return ""
    exponent = round(float(np.log10(value)))
    return {0: "1", 1: "10", -1: "0.1"}.get(exponent, "10" + str(exponent).translate(_RAISED))


def tick_numbers(axis: Axis) -> None:
    """Numbers along an axis, at 1, 2 and 5 of every decade."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))


def fit_heights(ax: Axes, values: NDArray[np.float64] | None = None) -> None:
    """A logarithmic vertical axis where all ``values``, by default those of the lines, are > 0 and
    span decades; else a linear one, from 0 where none is below."""
    if values is None:
        values = np.concatenate([np.asarray(line.get_ydata(), float) for line in ax.lines])
    if spans_decades(values):
        ax.set_yscale("log")
        low, high = ax.get_ylim()
        if high >= 10**FEW_DECADES * low:
            ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
        else:
            tick_numbers(ax.yaxis)
        ax.minorticks_off()
    elif np.nanmin(values, initial=0.0) >= 0:
        ax.set_ylim(bottom=0)


def spans_decades(values: NDArray[np.float64]) -> bool:
    """Whether the values, nan left out, are for a logarithmic axis."""
    known = values[np.isfinite(values)]
    return bool(len(known) and known.min() > 0 and known.max() > STEEP * known.min())


def in_units(*units: str) -> str:
    """What an axis says of its unit; ``units`` are those of the state components that it shows,
    which may differ, or be none."""
    unit = units[0] if len(set(units)) == 1 else ""
    return f"in {unit or 'units of x'}"


def short(name: object, longest: int = SHOWN_NAME) -> str:
    """Cut a name for a drawing."""
    text = str(name)
    return text if len(text) <= longest else text[: longest - 1] + "…"


def shown_agents(n: int, first: set[int], most: int = MOST_AGENTS) -> list[int]:
    """The agents that are drawn: those in ``first`` (at most half), then others, evenly taken."""
    if n <= most:
        return list(range(n))
    kept = sorted(first)[: most // 2]
    others = [agent for agent in range(n) if agent not in first]
    count = min(most - len(kept), len(others))
    evenly = np.linspace(0, len(others) - 1, count).astype(int)
    return sorted([*kept, *(others[i] for i in evenly)])


def thinned_rows(count: int, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Indices of at most ``most`` of ``count`` samples, first and last included."""
    evenly = np.linspace(0, count - 1, min(count, most))
    return np.unique(evenly.round().astype(np.intp))


def legend_above(ax: Axes, *, right: bool = False, widest: int = 3, least: int = 2) -> Axes:
    """The axes, above them a legend of at least ``least`` entries, each once; in two rows or
    more beyond ``widest``."""
    handles, labels = ax.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    if len(entries) < least:
        return ax
    columns = len(entries)
    if columns > widest:
        columns = max(2, min(widest, (columns + 1) // 2))
    legend = ax.legend(
        list(entries.values()),
        list(entries),
        loc="lower right" if right else "lower left",
        bbox_to_anchor=(1.0 if right else 0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.5,
        columnspacing=1.1,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
    return ax
