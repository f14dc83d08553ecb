"""Equilibria of one mode other than the target, claimed as boxes, and the numbers that decide such a claim.

With eps = 0 the error system (22) is e' = f(e) = h(e) - K e, whatever the gain W.  Krawczyk's test shows an e* != 0
with f(e*) = 0 in a box X with the middle c: if c - Y f(c) + (I - Y F)(X - c) lies in the interior of X, where F
encloses the slopes of f on X (Clarke's at kinks), x - Y f(x) maps X into itself and Y is invertible, so X holds exactly
one zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from dobc_design.conditions.check import Check, read_object
from dobc_design.conditions.numbers import VECTOR_BITS, has_short_denominator, read_rational
from dobc_design.coupling.tree import GradientAlgebra, IntervalAlgebra, evaluate
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.problem.problem import Problem

Box = tuple[Interval, ...]
Slopes = Mapping[tuple[int, int], Interval]

_ZERO = Interval.point(0)
LARGEST: Final = 60  # rows n m


@dataclass(frozen=True, slots=True, kw_only=True)
class Equilibrium:
    """A claim: the box, n m intervals for e, agent by agent, holds an equilibrium of h(e) - K e in ``mode`` and not 0.
    A box of points is one itself: then others may lie beside it.  Raises: ShapeError or SpecError for no claim."""

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

    @property
    def half_widths(self) -> Vector:
        return tuple(side.width / 2 for side in self.box)

    def to_json(self) -> dict[str, Any]:
        return {"mode": self.mode, "box": [[number_text(side.lo), number_text(side.hi)] for side in self.box]}


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Equilibrium:
    """What a check claims, for this problem; the gain ``W`` (q, m) is not needed.  Raises: KeyError, TypeError,
    ValueError or SpecError for anything that cannot be such a claim."""
    values = read_object(check.exact, ("mode", "box"))
    mode, rows = values["mode"], values["box"]
    if mode not in list(problem.network.modes) or not isinstance(rows, (list, tuple)):
        raise ValueError("it needs a mode of this problem, and a list of intervals")
    if problem.n * problem.m > LARGEST or len(rows) != problem.n * problem.m:
        raise ValueError(f"the box must have one interval per component of e, at most {LARGEST}")
    if not all(isinstance(row, (list, tuple)) and len(row) == 2 for row in rows):
        raise ValueError("the box is no list of intervals")
    ends = [tuple(map(read_rational, row)) for row in rows]
    if any(lo > hi for lo, hi in ends):
        raise ValueError("the box is no list of intervals")
    if not has_short_denominator((end for pair in ends for end in pair), VECTOR_BITS):
        raise ValueError("the box needs too long a common denominator")
    return Equilibrium(mode=mode, box=tuple(Interval(lo, hi) for lo, hi in ends))


def field_at(problem: Problem, mode: str, point: Vector) -> Box:
    """Enclose f(e) = h(e) - K e at one rational point, (n m,).  Raises: UndefinedError where a coupling is not
    defined there."""
    m, algebra = problem.m, IntervalAlgebra()
    total = [_ZERO] * (problem.n * m)
    for listener, speaker, weight in problem.network.modes[mode]:
        h = problem.coupling_of(listener, speaker)
        y = tuple(Interval.point(point[speaker * m + c] - point[listener * m + c]) for c in range(m))
        for c in range(m):
            node, variables = (h.components[0].node, y[c : c + 1]) if h.by_component else (h.components[c].node, y)
            total[listener * m + c] += evaluate(node, variables, algebra) * weight
    for agent, gain in problem.pinning.gains.items():
        for c, row in enumerate(gain):
            total[agent * m + c] -= sum((k * point[agent * m + d] for d, k in enumerate(row)), Fraction(0))
    return tuple(total)


def slopes_on(problem: Problem, mode: str, box: Box) -> Slopes:
    """Enclose the entries of df/de on a box; those that are not there are 0.  Raises: UndefinedError where a
    coupling or its slope is not bounded on the box."""
    m = problem.m
    found: dict[tuple[int, int], Interval] = {}

    def add(row: int, column: int, slope: Interval) -> None:
        found[row, column] = found.get((row, column), _ZERO) + slope

    for listener, speaker, weight in problem.network.modes[mode]:
        h = problem.coupling_of(listener, speaker)
        y = tuple(box[speaker * m + c] - box[listener * m + c] for c in range(m))
        parts = [((c,), h.components[0]) for c in range(m)] if h.by_component else [(range(m), g) for g in h.components]
        for c, (places, component) in enumerate(parts):
            algebra = GradientAlgebra(len(places))
            partials = evaluate(component.node, algebra.variables([y[d] for d in places]), algebra).partials
            for d, slope in zip(places, partials, strict=True):
                add(listener * m + c, speaker * m + d, slope * weight)
                add(listener * m + c, listener * m + d, -(slope * weight))
    for agent, gain in problem.pinning.gains.items():
        for c, row in enumerate(gain):
            for d, k in enumerate(row):
                add(agent * m + c, agent * m + d, Interval.point(-k))
    return found
