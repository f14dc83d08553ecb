"""The one look of all figures, in reports, notebooks and files.

The colours are those of Okabe and Ito that keep a contrast of 3:1 on white: they can be told apart by people with any
colour vision.  pyplot is never imported.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from matplotlib import style

INK, MUTED, GRID, PAPER = "#1b1e24", "#5b6470", "#d8dce2", "#fefefe"
BLUE, VERMILLION, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, INK, MUTED)
MARKERS = ("o", "s", "^", "D", "v", "P")

STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "dobc_design",
    "svg.image_inline": True,
    "font.size": 9.0,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "text.usetex": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 5.0,
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
    "path.simplify": True,
}

_LOCK = threading.Lock()  # Matplotlib's parameters belong to the process; they are put back after each figure


@contextmanager
def styled() -> Iterator[None]:
    """Matplotlib's parameters as this package wants them, for one thread at a time."""
    with _LOCK, style.context(["default", STYLE]):
        yield
