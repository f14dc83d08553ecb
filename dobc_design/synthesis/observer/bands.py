"""The fewest poles in the bands of sines of unknown frequency with which an observer leaves no more
of them than is asked (theory, section 19)."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design._show.cards import Card
from dobc_design.conditions.observer.bands import are_bounded
from dobc_design.conditions.observer.propose import band_gains, design_gain
from dobc_design.conditions.statement import refuted
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Matrix, row_norm
from dobc_design.exact.number import Number, parse_number
from dobc_design.exact.reading import shown_number
from dobc_design.loop.make import loop_of
from dobc_design.problem.bands import MOST_PAIRS, Band, band_words, nodes
from dobc_design.problem.exosystems import Exosystem, harmonics, stacked, total
from dobc_design.problem.groups import Observer
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .claim import Answer

INTERNAL_MODEL = (
    "no observer leaves nothing of {sine}: S(jw) = det(jw I - A)/det(jw I - A + W C) is 0 at "
    "eigenvalues of A only (internal model principle)."
)


@noun
class BandDesign(Answer):
    """Poles for sines of unknown frequency, and what is left of these.

    ``pairs``: how many pairs of poles each band has; ``problem``: with these in its exosystem, and
    with the gain ``W`` (q, m); ``left``: for each band the part that is left, proved.
    """

    residual: Fraction
    pairs: int | None = None
    problem: Problem | None = None
    W: Matrix | None = None
    left: tuple[Fraction, ...] = ()

    def _why(self) -> str:
        if self.obstacle is not None:
            return self.obstacle.text
        asked = f"at most {shown_number(self.residual)} of a sine in a band"
        if self.pairs is None:
            return f"no gain with up to {MOST_PAIRS} pairs of poles in each band leaves {asked}."
        poles = f"{self.pairs} pair{'s' * (self.pairs > 1)} of poles in each band"
        return f"with {poles} and this W {asked} is left."

    def _card(self) -> Card:
        facts: list[tuple[str, Any]] = [("pairs", self.pairs), ("W", self.W)]
        facts += [("part left at most", part) for part in self.left]
        known = [(name, value) for name, value in facts if value is not None]
        return self._card_of("Poles in bands", known)


def design_bands(problem: Source, *, residual: Number, rate: Number | None = None) -> BandDesign:
    """Choose the fewest pairs of poles in the bands of [exosystem], and a gain W, with which at
    most the part ``residual`` of every sine in a band is left.

    Poles that A has inside a band are chosen anew, at Chebyshev nodes.  ``rate`` (1/s): at which
    the estimation error decays, by default that of the problem, else half that of a Kalman gain; a
    faster observer needs fewer poles.
    Returns: a BandDesign: PROVED; REFUTED for a residual of 0; UNDECIDED.
    Raises: SpecError for a problem without bands, with groups, or a residual below 0.
    Example:
        >>> design = dd.design_bands(problem, residual="0.05", rate=2)  # doctest: +SKIP
    """
    stated = load_problem(problem)
    stated.require("the design of poles for bands")
    own = stated.exosystem
    bands = loop_of(stated).bands
    if not bands or own is None:
        cure = "For example bands = [[1.8, 2.2]] and amplitude = 0.5."
        raise wrong("exosystem.bands", "is missing: there is no band to choose poles for.", cure)
    most = parse_number(residual, "residual")
    if most < 0:
        must = f"must be a part of a sine, >= 0; got {shown_number(most)}."
        raise wrong("residual", must, "For example 0.05.")
    wide = next((band for band in bands if band.low < band.high), None)
    if most == 0 and wide is not None:
        obstacle = refuted("internal model", INTERNAL_MODEL.format(sine=band_words(wide)))
        return BandDesign(
            verdict=Verdict.REFUTED, residual=most, obstacle=obstacle, statements=(obstacle,)
        )
    pace = stated.observer.rate if rate is None else parse_number(rate, "rate")
    for pairs in range(1, MOST_PAIRS + 1):
        exosystem = _with_poles(own, bands, pairs)
        design = design_gain(exosystem, rate=pace)
        if design.W is None:
            continue
        changed = stated.replace(exosystem=exosystem, observer=Observer(W=design.W))
        loop = loop_of(changed)
        W = loop.joint_observer.W or ()
        gains = [band_gains(loop, W, band) for band in bands]
        bounded = all(are_bounded(loop, W, *pair) for pair in zip(bands, gains, strict=True))
        left = tuple(map(row_norm, gains))
        if bounded and max(left) <= most:
            return BandDesign(
                verdict=Verdict.PROVED,
                residual=most,
                pairs=pairs,
                problem=changed,
                W=design.W,
                left=left,
            )
    return BandDesign(verdict=Verdict.UNDECIDED, residual=most)


def _with_poles(exosystem: Exosystem, bands: Sequence[Band], pairs: int) -> Exosystem:
    """The exosystem with so many pairs of poles in each band, of every component, in place of
    those that it has there."""
    kept = _without_sines(exosystem, bands)
    frequencies = [w for band in bands for w in nodes(band.low, band.high, pairs)]
    sines = stacked(*[harmonics(frequencies)] * exosystem.outputs)
    return sines if kept is None else total(kept, sines)


def _without_sines(exosystem: Exosystem, bands: Sequence[Band]) -> Exosystem | None:
    """What is left without blocks [[0, w], [-w, 0]] with w in a band; None if nothing is."""
    A = exosystem.A
    states = set(range(len(A)))
    for i in range(len(A) - 1):
        w = A[i][i + 1]
        is_in_band = any(band.low <= abs(w) <= band.high for band in bands)
        alone = all(
            A[a][b] == 0 for a in states for b in states if (a in (i, i + 1)) != (b in (i, i + 1))
        )
        rotates = A[i][i] == A[i + 1][i + 1] == 0 and A[i + 1][i] == -w
        if is_in_band and rotates and alone and {i, i + 1} <= states:
            states -= {i, i + 1}
    order = sorted(states)
    if not order:
        return None
    return Exosystem(
        A=[[A[a][b] for b in order] for a in order],
        C=[[row[b] for b in order] for row in exosystem.C],
    )
