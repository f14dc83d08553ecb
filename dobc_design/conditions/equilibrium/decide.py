"""Decides claims of ``claim``: a second equilibrium inside a box, and inside the region asked for.

A proved one is the start of a motion that never reaches the target, so consensus fails in a region that holds it.
Krawczyk's test is exact here: f(c) and the slopes are enclosed outwards, the rest is rational.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.check import Check, Witness
from dobc_design.conditions.equilibrium.claim import LARGEST, Box, Equilibrium, Slopes, field_at, read_claim, slopes_on
from dobc_design.conditions.numbers import read_rational
from dobc_design.conditions.schedule.cycles import may_stay
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, identity, multiply, subtract
from dobc_design.exact.number import nearest, number_text
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]

# Half widths tried, relative to the size of the equilibrium, and the digits of the middle beyond them.
HALF_WIDTHS: Final = (6, 8, 10, 4, 3)
EXTRA_DIGITS: Final = 4
BITS: Final = (0, 1, 2, 4, 8, 16)  # of the numbers of a point that is an equilibrium exactly
IN_HAND: Final = Fraction(9, 10)  # of each half width is used by boxes made here: other enclosures may be wider
LEAST: Final = 1e-200  # of |e|_inf of an equilibrium that is looked at
SHOWN: Final = 6  # components of an equilibrium that a sentence names

ONE: Final = Fraction(1)


@dataclass(frozen=True, slots=True)
class EquilibriumDecision:
    """PROVED: the box holds an equilibrium and not the target.  UNDECIDED: not shown, with the reason."""

    verdict: Verdict
    reason: str


def verify_equilibrium(problem: Problem, claim: Equilibrium, *, part: Fraction = ONE) -> EquilibriumDecision:
    """Decide by Krawczyk's test (1969; Moore 1977), using a ``part`` of each half width, if the box holds an
    equilibrium other than 0.  Raises: ShapeError or SpecError for a claim that does not fit the problem."""
    if len(claim.box) != problem.n * problem.m:
        many = f"box must have {problem.n * problem.m} sides, one per component of e; got {len(claim.box)}."
        raise ShapeError(many, key="box")
    if claim.mode not in problem.network.modes:
        raise SpecError(f"mode must be one of the problem's; got {claim.mode[:60]!r}.", key="mode")
    undecided = partial(EquilibriumDecision, Verdict.UNDECIDED)
    if not may_stay(problem, claim.mode):
        return undecided("the guarantee does not let that mode stay on.")
    if len(claim.box) > LARGEST:
        return undecided(f"equilibria are proved for at most {LARGEST} rows n m.")
    if all(side.contains(0) for side in claim.box):
        return undecided("the box holds the target itself.")
    try:
        value = field_at(problem, claim.mode, claim.middle)
        if claim.is_point:
            if any(each != Interval.point(0) for each in value):
                return undecided("the point is not shown to be an equilibrium exactly.")
            return EquilibriumDecision(Verdict.PROVED, "The point is an equilibrium exactly.")
        slopes = slopes_on(problem, claim.mode, claim.box)
    except UndefinedError as error:
        return undecided(f"the couplings are not bounded on the box: {error}")
    Y = _preconditioner(slopes, len(claim.box))
    if Y is None or not krawczyk_holds(claim, value, slopes, Y, part):
        return undecided("Krawczyk's test does not show an equilibrium in the box.")
    return EquilibriumDecision(Verdict.PROVED, "The box holds exactly one equilibrium.")


def lies_in_region(problem: Problem, claim: Equilibrium) -> bool:
    """Whether every x = e + goal in the box is a start that the region asks for; true without a region."""
    if problem.region is None:
        return True
    pairs = list(problem.region.initial_states) * problem.n
    goals = [goal for agent in range(problem.n) for goal in problem.goal_of(agent)]
    sides = zip(pairs, goals, claim.box, strict=True)
    return all(lo <= side.lo + goal and side.hi + goal <= hi for (lo, hi), goal, side in sides)


def enclose_equilibrium(
    problem: Problem, mode: str, point: Sequence[float], *, within_region: bool = False
) -> Equilibrium | None:
    """A proved box, in the region asked for if ``within_region``, around an equilibrium that floating point sees at
    ``point`` (n m,), or one of short numbers near it; None if none is proved.  Half widths are powers of ten, about
    1e-6 of |e|_inf first."""
    if len(point) != problem.n * problem.m or len(point) > LARGEST or not all(map(math.isfinite, point)):
        return None
    if max(map(abs, point)) < LEAST:
        return None
    size = math.ceil(math.log10(max(map(abs, point))))
    for digits in HALF_WIDTHS:
        half, unit = Fraction(10) ** (size - digits), Fraction(10) ** (digits + EXTRA_DIGITS - size)
        middle = [Fraction(round(Fraction(x) * unit)) / unit for x in point]
        claim = Equilibrium(mode=mode, box=tuple(Interval(c - half, c + half) for c in middle))
        if within_region and not lies_in_region(problem, claim):
            continue
        if verify_equilibrium(problem, claim, part=IN_HAND).verdict is Verdict.PROVED:
            return claim
    largest = max(map(abs, map(Fraction, point)))  # one of many, as in a dead zone: some short numbers may be one, too
    for bits in BITS:
        unit = Fraction(2) ** (largest.numerator.bit_length() - largest.denominator.bit_length() - bits)
        claim = Equilibrium(mode=mode, box=tuple(Interval.point(round(Fraction(x) / unit) * unit) for x in point))
        inside = not within_region or lies_in_region(problem, claim)
        if inside and verify_equilibrium(problem, claim).verdict is Verdict.PROVED:
            return claim
    return None


def refuting_check(problem: Problem, claim: Equilibrium) -> Check | None:
    """The check that consensus fails in the region; None unless the equilibrium is proved and lies there."""
    inside = problem.region is not None and lies_in_region(problem, claim)
    if not inside or verify_equilibrium(problem, claim).verdict is not Verdict.PROVED:
        return None
    return Check(
        id="equilibrium",
        verdict=Verdict.REFUTED,
        domain="global" if problem.is_linear else "consensus",
        reason=_reason(problem, claim),
        claim=claim,
        witness=Witness(kind="start", values=tuple(map(number_text, claim.middle))),
    )


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a refuted ``equilibrium`` claims is confirmed, else what is not.  ``W`` (q, m) has to be
    known where there is an exosystem; ``domain`` is that of Lemma 1. Raises what a malformed claim raises."""
    if check.verdict is not Verdict.REFUTED or check.domain != domain:
        return f"an equilibrium can only refute, with the domain {domain!r}"
    if problem.groups and W is None:
        return "without W there is no loop that could rest"
    if check.margin is not None or check.rate is not None or check.mode is not None:
        return "it claims a number that this check does not have"
    witness = check.witness
    if witness is None or witness.kind != "start" or witness.labels is not None:
        return "it needs a start"
    claim = read_claim(check, problem, W)
    if tuple(map(read_rational, witness.values or ())) != claim.middle:
        return "the start is not the middle of the box"
    if not lies_in_region(problem, claim):
        return "the box leaves the region asked for"
    decision = verify_equilibrium(problem, claim)
    return None if decision.verdict is Verdict.PROVED else decision.reason


def _preconditioner(slopes: Slopes, size: int) -> Matrix | None:
    """Any invertible rational Y would do; the inverse of the middle slopes, by floating point, makes the test sharp."""
    middle = np.zeros((size, size))
    for place, slope in slopes.items():
        middle[place] = nearest(slope.midpoint)
    if not np.isfinite(middle).all():
        return None
    try:
        with np.errstate(all="ignore"):
            Y = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        return None
    return tuple(tuple(map(Fraction, row)) for row in Y.tolist()) if np.isfinite(Y).all() else None


def krawczyk_holds(claim: Equilibrium, value: Box, slopes: Slopes, Y: Matrix, part: Fraction) -> bool:
    """Whether c - Y f(c) + (I - Y F)(X - c) lies in the interior of X, side by side.  With F = M +- R and half
    widths w the product has the half widths |I - Y M| w + |Y| R w."""
    size, zero = len(Y), Fraction(0)
    half = claim.half_widths
    M = [[zero] * size for _ in range(size)]
    spread = [zero] * size
    for (row, column), slope in slopes.items():
        middle = Fraction(nearest(slope.midpoint))
        M[row][column] = middle
        spread[row] += max(slope.hi - middle, middle - slope.lo) * half[column]
    rest = subtract(identity(size), multiply(Y, tuple(map(tuple, M))))
    centres, radii = [each.midpoint for each in value], [each.width / 2 for each in value]
    for own, left, width in zip(Y, rest, half, strict=True):
        moved = abs(sum((y * c for y, c in zip(own, centres, strict=True)), zero))
        blur = sum((abs(y) * (r + s) for y, r, s in zip(own, radii, spread, strict=True)), zero)
        linear = sum((abs(x) * w for x, w in zip(left, half, strict=True)), zero)
        if moved + blur + linear >= part * width:
            return False
    return True


def _reason(problem: Problem, claim: Equilibrium) -> str:
    m, named = problem.m, []
    for k, e in enumerate(claim.middle[:SHOWN]):
        place = problem.network.labels[k // m] + ("" if m == 1 else f".{k % m + 1}")
        named.append(f"{place}: {nearest(e + problem.goal_of(k // m)[k % m]):.6g}")
    more = ", ..." if len(claim.middle) > SHOWN else ""
    advice = "Ask for a smaller region, or raise the gains until it is gone."
    if claim.is_point:
        advice = "Others may lie between it and the target: pin more agents."
    where = f"in mode {claim.mode} the agents can rest away from the target, at x = ({', '.join(named)}{more})"
    return f"Consensus fails: {where}. This start lies in the region asked for. {advice}"
