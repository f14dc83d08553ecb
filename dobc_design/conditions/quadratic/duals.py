"""Why no quadratic V reaches farther: an exact alternative to every certificate of theorems.lure.

Theory, section 4, last line.  Suppose that couplings attain the gains of finitely many choices k on |y| <= r, and let
A_k = -K - L(gains).  If there are X_k >= 0, not all zero, such that S = sum (A_k X_k + X_k A_k') satisfies

    S >= 0 (full P_e)        diag S >= 0 (diagonal P_e)        tr S >= 0 (P_e = c I),

no P_e > 0 of that shape has A_k'P_e + P_e A_k < 0 for all k: else 0 > sum tr X_k (A_k'P_e + P_e A_k) = tr P_e S >= 0.
The inequalities of ``lure``, with multipliers, interval bounds or corners, each imply those, whatever the observer, so
none of them holds with a radius of r or more.  Nothing is said about other V, nor about the loop itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Final, Literal

from dobc_design._show.cards import Card, Shown, plain
from dobc_design.conditions.quadratic.sectors import GainRange, Sectors, build_sectors
from dobc_design.errors import SpecError
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import float_above
from dobc_design.problem.problem import Problem

Shape = Literal["identity", "diagonal", "full"]
SHAPES: Final = ("identity", "diagonal", "full")
#: A little above 1/sqrt 2.
ABOVE_HALF_ROOT: Final = Fraction(707107, 10**6)
Ends = tuple[Fraction, Fraction]


@dataclass(frozen=True, slots=True, kw_only=True)
class DualTerm:
    """One choice of gains in a mode, and X = sum of v v' over ``vectors`` (n m entries each).

    ``high``: channel by channel, whether the gain is the higher of the two attained ones.
    """

    mode: str
    high: tuple[bool, ...]
    vectors: tuple[Vector, ...]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class QuadraticDual(Shown):
    """A claim: no P_e of ``shape`` certifies a radius |e_j - e_i| <= r with r >= ``radius`` > 0.

    ``gains``: place in problem.couplings -> two gains low <= high that h(y)/y attains on |y| <= radius; ``at``: two y
    other than 0 with h(y)/y <= low at the first and >= high at the second, so that it passes both on the way.
    Raises: SpecError for what cannot be a claim.
    """

    shape: Shape
    radius: Fraction
    at: Mapping[int, Ends]
    gains: Mapping[int, Ends]
    terms: tuple[DualTerm, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", MappingProxyType(dict(self.at)))
        object.__setattr__(self, "gains", MappingProxyType(dict(self.gains)))
        if self.shape not in SHAPES:
            raise SpecError(f"shape must be one of {', '.join(SHAPES)}; got {self.shape!r}.", key="shape")
        if self.radius <= 0:
            raise SpecError("radius must be > 0.", key="radius")

    def _card(self) -> Card:
        return Card(
            title="Quadratic limit",
            text=f"no P of shape {self.shape} reaches",
            facts=[("|e_j - e_i| of", repr(float_above(self.radius))), ("nor a ball of", repr(float_above(self.ball)))],
        )

    def __repr__(self) -> str:
        return f"<QuadraticDual: no P of shape {self.shape} reaches |e_j - e_i| <= {plain(self.radius)}>"

    @property
    def ball(self) -> Fraction:
        """Certified balls |e| <= R of this shape have R below: they hold two agents with |e_j - e_i| = R sqrt 2.

        A rational number above radius/sqrt 2, by about a millionth.
        """
        return self.radius * ABOVE_HALF_ROOT


def attained_sectors(problem: Problem, dual: QuadraticDual) -> Sectors:
    """The attained gains at the arcs of every mode.  Raises: SpecError if a coupling that is used has none."""
    ranges = [
        GainRange(coupling=place, radius=dual.radius, entries=_entries(low, high, problem.m))
        for place, (low, high) in dual.gains.items()
    ]
    return build_sectors(problem, ranges, radius=dual.radius)


def _entries(low: Fraction, high: Fraction, m: int) -> tuple[tuple[Interval, ...], ...]:
    gain, none = Interval(low, high), Interval.point(0)
    return tuple(tuple(gain if c == d else none for d in range(m)) for c in range(m))
