"""Equilibria of one mode other than the target, claimed as boxes, and decided.

With eps = 0 the error system (22) is e' = f(e) = h(e) - K e, whatever the gain W.  Krawczyk's test
shows an e* != 0 with f(e*) = 0 in a box X with the middle c: if c - Y f(c) + (I - Y F)(X - c) lies
in the interior of X, where F encloses the slopes of f on X (Clarke's at kinks), x - Y f(x) maps X
into itself and Y is invertible, so X holds exactly one zero.  A proved one inside the region asked
for is the start of a motion that never reaches the target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.check import Check, Witness, read_object
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Domain
from dobc_design.conditions.numbers import VECTOR_BITS, has_short_denominator, read_rational
from dobc_design.conditions.reason import pins_obstacle
from dobc_design.coupling.tree import GradientAlgebra, IntervalAlgebra, evaluate
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, identity, multiply, subtract
from dobc_design.exact.number import nearest, number_text
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

Box = tuple[Interval, ...]
Slopes = Mapping[tuple[int, int], Interval]

_ZERO = Interval.point(0)
LARGEST: Final = 60  # rows n m


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A claim: the box, n m intervals for e, agent by agent, holds an equilibrium of h(e) - K e in
    ``mode`` and not 0. A box of points is one itself: then others may lie beside it.  Raises:
    ShapeError or SpecError for no claim."""

    mode: str
    box: Box

    def __post_init__(self) -> None:
        if not self.box:
            raise ShapeError("box must have one interval per component of e; got none.", key="box")
        if len({side.is_point for side in self.box}) > 1:
            raise SpecError("every side of the box must be longer than 0, or none.", key="box")

    @property
    def is_point(self) -> bool:
        return self.box[0].is_point

    @property
    def middle(self) -> Vector:
        return tuple(side.midpoint for side in self.box)

    def to_json(self) -> dict[str, Any]:
        return {
            "mode": self.mode,
            "box": [[number_text(side.lo), number_text(side.hi)] for side in self.box],
        }


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Equilibrium:
    """What a proved check of this topic claims, for this problem."""
    values = read_object(check.exact, ("mode", "box"))
    mode, rows = values["mode"], values["box"]
    if mode not in list(loop.modes) or not isinstance(rows, (list, tuple)):
        raise ValueError("it needs a mode of this problem, and a list of intervals")
    if loop.n * loop.m > LARGEST or len(rows) != loop.n * loop.m:
        raise ValueError(f"the box must have one interval per component of e, at most {LARGEST}")
    if not all(isinstance(row, (list, tuple)) and len(row) == 2 for row in rows):
        raise ValueError("the box is no list of intervals")
    ends = [tuple(map(read_rational, row)) for row in rows]
    if any(lo > hi for lo, hi in ends):
        raise ValueError("the box is no list of intervals")
    if not has_short_denominator((end for pair in ends for end in pair), VECTOR_BITS):
        raise ValueError("the box needs too long a common denominator")
    return Equilibrium(mode=mode, box=tuple(Interval(lo, hi) for lo, hi in ends))


def field_at(loop: Loop, mode: str, point: Vector) -> Box:
    """Enclose f(e) = h(e) - K e at one rational point, (n m,).  Raises: UndefinedError."""
    m, algebra = loop.m, IntervalAlgebra()
    total = [_ZERO] * (loop.n * m)
    for listener, speaker, weight in loop.modes[mode]:
        h = loop.function_of(listener, speaker)
        y = tuple(
            Interval.point(point[speaker * m + c] - point[listener * m + c]) for c in range(m)
        )
        for c in range(m):
            node, variables = (
                (h.components[0].node, y[c : c + 1])
                if h.by_component
                else (h.components[c].node, y)
            )
            total[listener * m + c] += evaluate(node, variables, algebra) * weight
    for agent, gain in loop.pulls.gains.items():
        for c, row in enumerate(gain):
            total[agent * m + c] -= sum(
                (k * point[agent * m + d] for d, k in enumerate(row)), Fraction(0)
            )
    return tuple(total)


def slopes_on(loop: Loop, mode: str, box: Box) -> Slopes:
    """Enclose the entries of df/de on a box; those that are not there are 0.  Raises:
    UndefinedError."""
    m = loop.m
    found: dict[tuple[int, int], Interval] = {}

    def add(row: int, column: int, slope: Interval) -> None:
        found[row, column] = found.get((row, column), _ZERO) + slope

    for listener, speaker, weight in loop.modes[mode]:
        h = loop.function_of(listener, speaker)
        y = tuple(box[speaker * m + c] - box[listener * m + c] for c in range(m))
        parts = (
            [((c,), h.components[0]) for c in range(m)]
            if h.by_component
            else [(range(m), g) for g in h.components]
        )
        for c, (places, component) in enumerate(parts):
            algebra = GradientAlgebra(len(places))
            partials = evaluate(
                component.node, algebra.variables([y[d] for d in places]), algebra
            ).partials
            for d, slope in zip(places, partials, strict=True):
                add(listener * m + c, speaker * m + d, slope * weight)
                add(listener * m + c, listener * m + d, -(slope * weight))
    for agent, gain in loop.pulls.gains.items():
        for c, row in enumerate(gain):
            for d, k in enumerate(row):
                add(agent * m + c, agent * m + d, Interval.point(-k))
    return found


Array = NDArray[np.float64]

# Half widths tried, relative to the size of the equilibrium, and the digits of the middle beyond
# them.
HALF_WIDTHS: Final = (6, 8, 10, 4, 3)
EXTRA_DIGITS: Final = 4
BITS: Final = (0, 1, 2, 4, 8, 16)  # of the numbers of a point that is an equilibrium exactly
# of each half width is used by boxes made here: other enclosures may be wider
IN_HAND: Final = Fraction(9, 10)
LEAST: Final = 1e-200  # of |e|_inf of an equilibrium that is looked at
SHOWN: Final = 6  # components of an equilibrium that a sentence names

ONE: Final = Fraction(1)


def why_not(loop: Loop, claim: Equilibrium, *, part: Fraction = ONE) -> str | None:
    """None if the box is proved, by Krawczyk's test on a ``part`` of each half width, to hold an
    equilibrium other than 0; else why that is not shown.  Raises: ShapeError; SpecError for an
    unknown mode."""
    if len(claim.box) != loop.n * loop.m:
        many = (
            f"box must have {loop.n * loop.m} sides, one per component of e; got {len(claim.box)}."
        )
        raise ShapeError(many, key="box")
    if claim.mode not in loop.modes:
        raise SpecError(f"mode must be one of the problem's; got {claim.mode[:60]!r}.", key="mode")
    if (reason := pins_obstacle(loop)) is not None:
        return reason
    if not loop.may_stay(claim.mode):
        return "the guarantee does not let that mode stay on."
    if len(claim.box) > LARGEST:
        return f"equilibria are proved for at most {LARGEST} rows n m."
    if all(side.contains(0) for side in claim.box):
        return "the box holds the target itself."
    try:
        value = field_at(loop, claim.mode, claim.middle)
        if claim.is_point:
            exactly = all(each == Interval.point(0) for each in value)
            return None if exactly else "the point is not shown to be an equilibrium exactly."
        slopes = slopes_on(loop, claim.mode, claim.box)
    except UndefinedError as error:
        return f"the couplings are not bounded on the box: {error}"
    Y = _preconditioner(slopes, len(claim.box))
    shown = Y is not None and krawczyk_holds(claim, value, slopes, Y, part)
    return None if shown else "Krawczyk's test does not show an equilibrium in the box."


def lies_in_region(loop: Loop, claim: Equilibrium) -> bool:
    """Whether every x = e + goal in the box is a start that the region asks for; true without a
    region."""
    if loop.starts is None:
        return True
    pairs = list(loop.starts.states) * loop.n
    goals = [goal for agent in range(loop.n) for goal in loop.goals.of(agent)]
    sides = zip(pairs, goals, claim.box, strict=True)
    return all(lo <= side.lo + goal and side.hi + goal <= hi for (lo, hi), goal, side in sides)


def enclose_equilibrium(
    loop: Loop, mode: str, point: Sequence[float], *, within_region: bool = False
) -> Equilibrium | None:
    """A proved box, in the region asked for if ``within_region``, around an equilibrium that
    floating point sees at ``point`` (n m,), or one of short numbers near it; None if none is
    proved.  Half widths are powers of ten, about 1e-6 of |e|_inf first."""
    if len(point) != loop.n * loop.m or len(point) > LARGEST or not all(map(math.isfinite, point)):
        return None
    if max(map(abs, point)) < LEAST:
        return None
    size = math.ceil(math.log10(max(map(abs, point))))
    for digits in HALF_WIDTHS:
        half, unit = Fraction(10) ** (size - digits), Fraction(10) ** (digits + EXTRA_DIGITS - size)
        middle = [Fraction(round(Fraction(x) * unit)) / unit for x in point]
        claim = Equilibrium(mode=mode, box=tuple(Interval(c - half, c + half) for c in middle))
        if within_region and not lies_in_region(loop, claim):
            continue
        if why_not(loop, claim, part=IN_HAND) is None:
            return claim
    # one of many, as in a dead zone: some short numbers may be one, too
    largest = max(map(abs, map(Fraction, point)))
    for bits in BITS:
        unit = Fraction(2) ** (
            largest.numerator.bit_length() - largest.denominator.bit_length() - bits
        )
        claim = Equilibrium(
            mode=mode, box=tuple(Interval.point(round(Fraction(x) / unit) * unit) for x in point)
        )
        inside = not within_region or lies_in_region(loop, claim)
        if inside and why_not(loop, claim) is None:
            return claim
    return None


def refuting_check(loop: Loop, claim: Equilibrium) -> Check | None:
    """The check that consensus fails in the region; None unless the equilibrium is proved and lies
    there."""
    inside = loop.starts is not None and lies_in_region(loop, claim)
    if not inside or why_not(loop, claim) is not None:
        return None
    return Check(
        id="equilibrium",
        verdict=Verdict.REFUTED,
        domain=EVERYWHERE if loop.is_linear else NEAR_TARGET,
        reason=_reason(loop, claim),
        claim=claim,
        witness=Witness(kind="start", values=tuple(map(number_text, claim.middle))),
    )


def confirm(check: Check, loop: Loop, W: Matrix | None, *, domain: Domain) -> str | None:
    """None if everything that a refuted check of this topic claims is confirmed, else what is
    not."""
    if check.verdict is not Verdict.REFUTED or check.domain != domain:
        return f"an equilibrium can only refute, with the domain '{domain}'"
    if loop.groups and W is None:
        return "without W there is no loop that could rest"
    if loop.drift_place is not None or loop.goals.moves:
        return (
            "it is not known for agents whose own dynamics are curved, nor with a leader, "
            "beside which nobody rests"
        )
    if check.margin is not None or check.rate is not None or check.mode is not None:
        return "it claims a number that this check does not have"
    witness = check.witness
    if witness is None or witness.kind != "start" or witness.labels is not None:
        return "it needs a start"
    claim = read_claim(check, loop, W)
    if tuple(map(read_rational, witness.values or ())) != claim.middle:
        return "the start is not the middle of the box"
    if not lies_in_region(loop, claim):
        return "the box leaves the region asked for"
    return why_not(loop, claim)


def _preconditioner(slopes: Slopes, size: int) -> Matrix | None:
    """Any invertible rational Y would do; the inverse of the middle slopes, by floating point,
    makes the test sharp."""
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


def krawczyk_holds(
    claim: Equilibrium, value: Box, slopes: Slopes, Y: Matrix, part: Fraction
) -> bool:
    """Whether c - Y f(c) + (I - Y F)(X - c) lies inside X; F = M +- R adds |I - Y M| w + |Y| R w to
    half widths w."""
    size, zero = len(Y), Fraction(0)
    half = [side.width / 2 for side in claim.box]
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


def _reason(loop: Loop, claim: Equilibrium) -> str:
    m, named = loop.m, []
    for k, e in enumerate(claim.middle[:SHOWN]):
        place = loop.labels[k // m] + ("" if m == 1 else f".{k % m + 1}")
        named.append(f"{place}: {nearest(e + loop.goals.of(k // m)[k % m]):.6g}")
    more = ", ..." if len(claim.middle) > SHOWN else ""
    advice = "Ask for a smaller region, or raise the gains until it is gone."
    if claim.is_point:
        advice = "Others may lie between it and the target: pin more agents."
    where = (
        f"in mode {claim.mode} the agents can rest away from the target, at x = "
        f"({', '.join(named)}{more})"
    )
    return f"Consensus fails: {where}. This start lies in the region asked for. {advice}"
