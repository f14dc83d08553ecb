"""When agents know what they use (theory, sections 15 and 17): late, held, lost and triggered
readings, and what the rows of a certificate make of them.

Readings of neighbours are at most ``delay`` old, with a relative error of at most ``event``; own
ones at most ``own_delay``.  With a ``period`` T couplings and pins are computed at its multiples
and held, so that ages are counted in ticks.  With ``sampled`` the compensation is computed there,
too, and the observer is the recursion eps+ = (Ad - W C Gamma) eps; then rates are slopes per tick:
N falls by the factor 1 - T rate, which is at most exp(-rate T).

What acts is ``ahead`` s late, which both ages count; on a processor by whole ticks.  Estimates are
predicted by as much: from ``ahead`` on d - dhat is C exp(A ahead) eps(t - ahead), and before
nothing is applied.
"""

import math
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache

from dobc_design._checks import noun
from dobc_design.exact.interval import (
    Interval,
    IntervalMatrix,
    discretise,
    exp,
    interval_product,
    points,
)
from dobc_design.exact.matrix import Matrix, identity, subtract, zeros
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import counted
from dobc_design.problem.exosystems import Exosystem

E = exp(Interval.point(1))


@noun
class Timing:
    """Times in s; ``period`` 0: nothing is held.  ``steps``: agents themselves move from tick to
    tick."""

    delay: Fraction = ZERO
    own_delay: Fraction = ZERO
    period: Fraction = ZERO
    lost: int = 0
    event: Fraction = ZERO
    sampled: bool = False
    steps: bool = False
    ahead: Fraction = ZERO

    @property
    def own_ticks(self) -> int:
        """The age of what an agent knows of itself at a tick."""
        return math.ceil(self.own_delay / self.period) if self.period else 0

    @property
    def at_once(self) -> "Timing":
        """The same where all that is computed acts at once."""
        read = {name: getattr(self, name) - self.ahead for name in ("delay", "own_delay")}
        return replace(self, ahead=ZERO, **read)

    @property
    def is_late(self) -> bool:
        """Whether readings are not those of the same instant, or not true."""
        return bool(self.delay or self.own_delay or self.lost or self.event)

    def stretch(self, rate: Fraction) -> Fraction:
        """What v_j of a neighbour counts as: (1 + event) exp(rate delay), rounded up."""
        age = exp(Interval.point(rate * self.delay))
        if self.period:
            ticks = math.ceil(self.delay / self.period) + self.lost
            age = Interval.point(1 - self.period * rate) ** -ticks
        return (1 + self.event) * age.hi

    def lag(self, beta: Fraction) -> Fraction:
        """How much larger the observer error was when an agent knew itself: exp(beta own_delay),
        rounded up."""
        if self.sampled:
            return (Interval.point(1 - self.period * beta) ** -self.own_ticks).hi
        return exp(Interval.point(beta * (self.period * self.own_ticks or self.own_delay))).hi

    def decay(self, beta: Fraction) -> Fraction:
        """The rate per tick, (1 - exp(-beta T))/T rounded down, of an error that decays with
        beta."""
        if not self.period or self.sampled:
            return beta
        return (1 - exp(Interval.point(-beta * self.period)).hi) / self.period

    @property
    def steepest(self) -> Fraction | None:
        """The largest sum of slopes and gains of an agent (1/s) at which it does not overshoot,
        rounded down: 1/(e own_delay), or d^d/(d + 1)^(d + 1)/T; None where nothing is late or
        held."""
        if self.period:
            d = self.own_ticks
            return Fraction(d**d, (d + 1) ** (d + 1)) / self.period
        return 1 / (E.hi * self.own_delay) if self.own_delay else None


@noun
class Sampled:
    """An exosystem from tick to tick: A (q, q), the transition, and C (p, q), the mean output."""

    A: IntervalMatrix
    C: IntervalMatrix

    def error(self, W: Matrix, period: Fraction) -> IntervalMatrix:
        """A - T W C, (q, q): what becomes of the observer error."""
        seen = interval_product(points(W), self.C)
        return tuple(
            tuple(a - x * period for a, x in zip(*rows, strict=True))
            for rows in zip(self.A, seen, strict=True)
        )


@lru_cache(maxsize=16)
def sampled(exosystem: Exosystem, timing: Timing) -> Sampled:
    """Ad and (1/T) C Gamma, enclosed (theory, section 17); A and C where agents move in steps."""
    if timing.steps:
        return Sampled(A=points(exosystem.A), C=points(exosystem.C))
    found = discretise(exosystem.A, timing.period)
    return Sampled(A=found.transition, C=interval_product(points(exosystem.C), found.mean))


@lru_cache(maxsize=16)
def predicted(exosystem: Exosystem, timing: Timing | None) -> IntervalMatrix:
    """C exp(A ahead), enclosed, of a processor with the mean C: what is left of the disturbance by
    an error of the estimate."""
    C = points(exosystem.C)
    if timing is not None and timing.sampled:
        C = sampled(exosystem, timing).C
    if timing is None or not timing.ahead:
        return C
    return interval_product(C, discretise(exosystem.A, timing.ahead).transition)


def late_step(step: Matrix, late: int) -> Matrix:
    """x+ = x + (step - I) x of ``late`` ticks ago, for the states from that of now to that one."""
    n = len(step)
    if not late:
        return step
    felt = subtract(step, identity(n))
    between = zeros(n, n * (late - 1))
    own = zip(identity(n), between, felt, strict=True)
    return (*(a + b + c for a, b, c in own), *identity(n * (late + 1))[: n * late])


def middle_of(M: IntervalMatrix) -> Matrix:
    """A rational matrix inside M, to be proposed with."""
    return tuple(tuple(x.midpoint for x in row) for row in M)


def timing_words(timing: Timing | None) -> str:
    """What is stated, in the rest of a sentence."""
    if timing in (None, Timing()):
        return "readings of the same instant"
    parts = []
    unit = "steps" if timing.steps else "s"
    if timing.ahead:
        parts.append(f"all that agents compute acting {_number(timing.ahead)} s late")
    read = timing.at_once
    if read.delay:
        parts.append(f"readings of neighbours up to {_number(read.delay)} {unit} old")
    if read.own_delay:
        own = "own ones" if read.delay else "own readings"
        parts.append(f"{own} up to {_number(read.own_delay)} {unit} old")
    if timing.lost:
        parts.append(f"{counted(timing.lost, 'reading')} of a neighbour lost in a row")
    if timing.event:
        parts.append(f"readings off by up to {_number(100 * timing.event)} %")
    if timing.period and not timing.steps:
        what = "everything" if timing.sampled else "couplings and pins"
        parts.append(f"{what} computed every {_number(timing.period)} s and held")
    if timing.steps:
        parts.append("agents that move in steps, each of which counts as 1 s")
    return ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + "".join(parts[-1:])


def _number(x: Fraction) -> str:
    return f"{float(x):.6g}"
