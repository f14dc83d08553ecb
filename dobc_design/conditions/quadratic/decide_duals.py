"""Upper bounds of quadratic certificates, decided: gains that are attained, and X_k multiplied out over the rationals.

The statement and its proof are in ``duals``.  Only the values h(y)/y are enclosed, everything else is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from dobc_design.conditions.quadratic.claim import linear_part
from dobc_design.conditions.quadratic.duals import DualTerm, QuadraticDual, attained_sectors
from dobc_design.conditions.quadratic.sectors import Sectors
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.enclosures import Curve, secant_range
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

ZERO: Final = Fraction(0)
Entries = dict[tuple[int, int], Fraction]


@dataclass(frozen=True, slots=True, kw_only=True)
class DualAnswer:
    """Whether a QuadraticDual holds, and why; PROVED or UNDECIDED."""

    verdict: Verdict
    reason: str


def verify_dual(problem: Problem, dual: QuadraticDual) -> DualAnswer:
    """Decide whether no quadratic certificate of this shape reaches ``dual.radius``.

    Raises: ShapeError or SpecError for a claim that does not fit the problem.
    """
    if any(coupling.nonsmooth or not coupling.by_component for coupling in problem.couplings):
        return _open("does not apply: gains are followed for smooth couplings that act by component.")
    for place, coupling in enumerate(problem.couplings):
        if place in dual.gains and not _attained(coupling, dual, place):
            return _open(f'the gains of h = "{coupling.texts[0]}" are not shown to be attained.')
    terms = [term for term in dual.terms if any(any(v) for v in term.vectors)]
    if not terms:
        return _open("all X are zero.")
    total: Entries = {}
    sectors = attained_sectors(problem, dual)
    for term in terms:
        for where, value in _products(sectors, term):
            total[where] = total.get(where, ZERO) + value
    if not _has_shape(total, sectors.size, dual.shape):
        return _open("the sum of A X + X A' does not have the sign it needs.")
    return DualAnswer(
        verdict=Verdict.PROVED,
        reason=f"no V with {_WORDS[dual.shape]} decreases for all gains that couplings have while |e_j - e_i| <="
        f" {float(dual.radius):.6g}, so no quadratic certificate of this kind reaches so far.",
    )


_WORDS: Final = {"identity": "P_e = c I", "diagonal": "a diagonal P_e", "full": "any P_e"}


def _attained(coupling: Coupling, dual: QuadraticDual, place: int) -> bool:
    """g passes from at most low to at least high between two points of 0 < |y| <= radius, and is continuous there."""
    low, high = dual.gains[place]
    if coupling.is_linear:
        slope = coupling.jacobian_at_zero()[0][0]
        return slope.is_point and low == high == slope.lo
    points = dual.at.get(place, ())
    if not points or low > high or not all(0 < abs(y) <= dual.radius for y in points):
        return False
    curve = Curve(coupling.components[0])
    try:
        secant_range(curve, Interval(min(points), max(points)))  # h is defined and smooth all the way
        first, second = (secant_range(curve, Interval.point(y)) for y in points)
    except UndefinedError:
        return False
    return first.hi <= low and high <= second.lo


def _products(sectors: Sectors, term: DualTerm) -> Iterator[tuple[tuple[int, int], Fraction]]:
    """The upper triangle of A X + X A'."""
    channels = sectors.modes[term.mode]
    if len(term.high) != len(channels):
        raise ValueError(f"mode {term.mode} has {len(channels)} channels; got {len(term.high)} choices")
    gains = [each.high if up else each.low for each, up in zip(channels, term.high, strict=True)]
    rows = linear_part(sectors, term.mode, gains)
    for v in term.vectors:
        if len(v) != sectors.size:
            raise ValueError(f"a vector must have {sectors.size} entries; got {len(v)}")
        image: Vector = tuple(sum((a * v[j] for j, a in rows[i].items()), ZERO) for i in range(sectors.size))
        for i in range(sectors.size):
            for j in range(i, sectors.size):
                yield (i, j), image[i] * v[j] + v[i] * image[j]


def _has_shape(total: Entries, size: int, shape: str) -> bool:
    diagonal = [total.get((i, i), ZERO) for i in range(size)]
    if shape == "identity":
        return sum(diagonal, ZERO) >= 0
    if shape == "diagonal":
        return all(x >= 0 for x in diagonal)
    matrix = SparseSymmetric(size, {place: x for place, x in total.items() if x})
    return decide_positive_semidefinite(matrix).verdict is Verdict.PROVED


def _open(reason: str) -> DualAnswer:
    return DualAnswer(verdict=Verdict.UNDECIDED, reason=reason)
