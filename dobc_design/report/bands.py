"""Sines whose frequencies are known to lie in bands: what the observer leaves of them, over the
frequency."""

import numpy as np
from matplotlib.axes import Axes

from dobc_design._show.text import significant_away_from_zero
from dobc_design.certificate.claims import claim_of
from dobc_design.certificate.topics import TOPICS
from dobc_design.conditions.accuracy.decide import ID, Accuracy
from dobc_design.conditions.observer.bands import filters
from dobc_design.exact.matrix import Array, Matrix, row_norm
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.plotting.look import BLUE, DASHED, INK, VERMILLION, legend_above, tick_numbers
from dobc_design.problem.bands import Band

from .document import Blocks, Column, Picture, Pictures, Text, on_pages, section, table_of
from .findings import Findings
from .words import FIXED, number

POINTS = 600
LEAST = 1e-6  # of the largest part, so that zeros have a logarithm
BESIDE = 3.0  # how far below and above the bands is drawn, as a factor


@section("Sines of unknown frequency", "bands", "Sines")
def bands_section(found: Findings) -> Blocks:
    """What is left of sines in the bands of [exosystem]; nothing without them."""
    agents = loop_of(found.problem)
    gain = found.certificate.claims.W
    if not agents.bands or gain is None:
        return
    yield Text(FIXED["bands"])
    shown = slice(0 if not agents.estimated else -agents.m, None)
    check = next((each for each in found.certificate.checks if each.id == ID), None)
    loop, W = TOPICS["accuracy"].about(ID, agents, gain)
    claim = None
    if check is not None and check.is_proved:
        claim = claim_of(check, loop, W)
    proved: list[float] = []
    if isinstance(claim, Accuracy) and claim.peaks is not None:
        proved = [float(row_norm(gains[shown])) for gains in claim.peaks.bands]
        rows = list(zip(agents.bands, proved, strict=True))
        yield table_of(
            "What is left of a sine",
            rows,
            Column("frequency in rad/s", lambda row: _ends(row[0])),
            Column("amplitude ≤", lambda row: number(float(row[0].amplitude)), style="number"),
            Column("part left ≤", lambda row: significant_away_from_zero(row[1]), style="number"),
        )
    yield on_pages(Pictures((_picture(agents, gain, proved, shown),)))


def _ends(band: Band) -> str:
    return f"{number(float(band.low))} to {number(float(band.high))}"


def _picture(loop: Loop, W: Matrix, proved: list[float], shown: slice) -> Picture:
    lowest = min(float(band.low) for band in loop.bands)
    highest = max(float(band.high) for band in loop.bands)
    w = np.geomspace((lowest or highest / BESIDE) / BESIDE, highest * BESIDE, POINTS)
    left = _left(loop, W, w, shown)
    bounds = ", ".join(map(significant_away_from_zero, proved))
    return Picture(
        "bands",
        "Part of a sine that the observer leaves, over its frequency",
        caption=FIXED["bands-outputs" if loop.estimated else "bands-picture"],
        alt=f"Part of a sine that is left, over frequency in rad/s. Proved in the bands: {bounds}.",
        draw=lambda ax: plot_filter(ax, w, left, loop.bands, proved, whole=not loop.estimated),
    )


def _left(loop: Loop, W: Matrix, w: Array, shown: slice) -> Array:
    """The largest row sum of |S(jw)| of all groups, of the rows ``shown``."""
    largest = np.zeros(len(w))
    for below, rows in filters(loop, W):
        bottom = np.abs(np.polyval(np.array(below, dtype=float), 1j * w))
        for row in rows[shown]:
            tops = [np.abs(np.polyval(np.array(x, dtype=float), 1j * w)) for x in row]
            largest = np.maximum(largest, sum(tops) / bottom)
    return largest


def plot_filter(
    ax: Axes,
    w: Array,
    left: Array,
    bands: tuple[Band, ...],
    proved: list[float],
    *,
    whole: bool = True,
) -> Axes:
    """The part of a sine that is left over its frequency w (rad/s), the bands, and what is proved
    in each of them; ``whole``: with a line where all of it is left."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.plot(w, np.maximum(left, LEAST * np.max(left)), color=BLUE, label="|S|, computed")
    for k, band in enumerate(bands):
        ends = (float(band.low), float(band.high))
        ax.axvspan(*ends, color=INK, alpha=0.08, linewidth=0, label=None if k else "band")
        if proved:
            name = None if k else "at most, proved"
            ax.plot(ends, [proved[k]] * 2, color=VERMILLION, linewidth=2, label=name)
    if whole:
        ax.axhline(1.0, color=INK, linewidth=0.8, linestyle=DASHED, label="nothing is compensated")
    tick_numbers(ax.xaxis)
    ax.minorticks_off()
    ax.set_xlabel("frequency in rad/s")
    ax.set_ylabel("part that is left")
    return legend_above(ax)
