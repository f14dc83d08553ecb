"""Certified bounds of |e(t)|_inf over time that follow from proved checks, evaluated towards the larger bound.

Each of the functions V that a certificate is about falls like exp(-rate t) from its largest value over a set of starts,
and |e|_inf is at most a height times V (max-separable) or times sqrt(V) (quadratic).  Theory, sections 2, 4 and 5.
Nothing is decided here: the checks are taken as proved, ``dobc verify`` decides them again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dobc_design._show.cards import Card, Shown, listed
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic.decide import eigenvalue_bound
from dobc_design.conditions.quadratic.json_text import lure_from_json, names_of
from dobc_design.conditions.schedule.decide import diagonal_of_inverse
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.separable.checks import separable_from_json
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.observer import composite_rate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_above, float_below, root_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]
ZERO: Final = Fraction(0)
#: Rows of a full P_e up to which the diagonal of its inverse is computed; beyond, its least eigenvalue is used.
MOST_INVERTED: Final = 40
#: Starts count as inside a region when they exceed it by rounding only; floats of a run are what they are.
ROUNDING: Final = Fraction(1, 10**12)
#: Of the floats that evaluate height exp(-rate t): a thousand times what they can be off.
IN_HAND: Final = 1e-12
_UNIT: Final = 10**18
_QUADRATIC: Final = {"lure": "level", "exhaustive": "outer"}
_EVERYWHERE: Final = ("lemma1", "theorem1", "theorem2", "theorem1-printed", "theorem2-printed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Starts:
    """Starts with |e|_inf <= box, |e| <= ball (Euclidean, all agents stacked) and |eps_i| <= disturbance."""

    box: Fraction
    ball: Fraction
    disturbance: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """|e(t)|_inf <= height exp(-rate t) for t >= 0 s, by the check ``id``; height in the unit of x, rate in 1/s."""

    id: str
    height: Fraction
    rate: Fraction


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class CertifiedBound(Shown):
    """The least of several proved bounds of |e(t)|_inf, a function of times in s; without any, ``reason`` says why.

    ``settling``: staged bounds, where they hold for the same starts.
    """

    envelopes: tuple[Envelope, ...] = ()
    settling: Settling | None = None
    reason: str = ""

    def _card(self) -> Card:
        text = f"of |e(t)|_inf, from {listed(self.sources)}" if self.sources else f"none: {self.reason}"
        return Card(title="Certified bound", text=text)

    def __repr__(self) -> str:
        return f"<CertifiedBound {self._card().text}>"

    @property
    def sources(self) -> tuple[str, ...]:
        """The ids of the checks it follows from."""
        return (*(each.id for each in self.envelopes), *(() if self.settling is None else ("settling",)))

    def __call__(self, times: ArrayLike) -> Array:
        """The bound at times >= 0 in s, rounded up, same shape.  Raises: SpecError if there is none."""
        t = np.asarray(times, dtype=np.float64)
        if not self.sources:
            raise SpecError("there is no certified bound to evaluate.", key="certificate", cure=self.reason)
        if not (np.isfinite(t).all() and (t >= 0).all()):
            raise SpecError("times must be finite and >= 0 s.", key="times", cure="Leave out the others.")
        bounds = [
            float_above(each.height) * (1 + IN_HAND) * np.exp(-float_below(each.rate) * t) + np.finfo(float).tiny
            for each in self.envelopes
        ]
        if self.settling is not None:
            bounds.append(self.settling.envelope(t.ravel()).reshape(t.shape))
        return np.asarray(np.minimum.reduce(bounds))


def envelopes_of(problem: Problem, W: Matrix | None, checks: Sequence[Check], starts: Starts) -> tuple[Envelope, ...]:
    """The bounds that hold for all of ``starts``, from every proved check whose domain holds them.

    Regional checks bound every start of their region, the others every start of ``starts``.
    Raises: what a check raises that cannot be read.
    """
    return tuple(_envelopes(problem, W, checks, starts))


def is_inside(domain: object, starts: Starts) -> bool:
    """Whether a check with this domain is about these starts; not for one that holds close to the target only."""
    if not isinstance(domain, Mapping):
        return domain == "global"
    reach = starts.box if domain["kind"] == "box" else starts.ball
    room = 1 + ROUNDING
    return reach <= claimed(domain["radius"]) * room and starts.disturbance <= claimed(domain["disturbance"]) * room


def _envelopes(problem: Problem, W: Matrix | None, checks: Sequence[Check], starts: Starts) -> Iterator[Envelope]:
    readers: dict[str, Callable[[Check], Envelope]] = {
        "max-separable": lambda check: _separable(problem, check, starts),
        **dict.fromkeys(_QUADRATIC, lambda check: _quadratic(problem, W, check, starts)),
        **dict.fromkeys(_EVERYWHERE[1:], lambda check: _everywhere(problem, check, starts)),
    }
    for check in checks:
        if check.verdict is Verdict.PROVED and check.id in readers and is_inside(check.domain, starts):
            if check.id in _EVERYWHERE and check.rate is None:
                continue
            yield readers[check.id](check)
    lemmas = [check for check in checks if check.id == "lemma1"]
    rates = [check.rate for check in lemmas if check.verdict is Verdict.PROVED and check.domain == "global"]
    known = [rate for rate in rates if rate is not None]
    if not problem.groups and lemmas and len(known) == len(lemmas):
        yield Envelope(id="lemma1", height=starts.ball, rate=claimed(min(known)))


def _reach(check: Check, starts: Starts) -> tuple[Fraction, Fraction]:
    """Radius and disturbance over which the function of a check is bounded at the start."""
    domain = check.domain
    if isinstance(domain, Mapping):
        return claimed(domain["radius"]) * (1 + ROUNDING), claimed(domain["disturbance"]) * (1 + ROUNDING)
    return (starts.box if check.id == "max-separable" else starts.ball), starts.disturbance


def _separable(problem: Problem, check: Check, starts: Starts) -> Envelope:
    claim: Separable = separable_from_json(check.exact, problem)
    radius, disturbance = _reach(check, starts)
    first = radius / claim.least
    if claim.error is not None:
        first += root_above((claim.error.kappa * disturbance) ** 2 * claim.error.size, unit=_UNIT)
    return Envelope(id=check.id, height=first * max(claim.v), rate=composite_rate(claim))


def _quadratic(problem: Problem, W: Matrix | None, check: Check, starts: Starts) -> Envelope:
    exact: Mapping[str, Any] = check.exact or {}
    lure = lure_from_json({name: exact[name] for name in names_of(problem)}, problem, W)
    radius, disturbance = _reach(check, starts)
    first = eigenvalue_bound(lure.P_e) * radius**2 + _errors(problem, lure.P, disturbance)
    if isinstance(check.domain, Mapping):  # the level is a bound as well
        first = min(first, read_rational(exact[_QUADRATIC[check.id]]))
    return Envelope(id=check.id, height=root_above(first * tallest(lure.P_e), unit=_UNIT), rate=lure.rate)


def _everywhere(problem: Problem, check: Check, starts: Starts) -> Envelope:
    """V = e'e + sum eps_i'P eps_i of Theorems 1 and 2."""
    P = tuple(tuple(read_rational(entry) for entry in row) for row in (check.exact or {})["P"])
    first = starts.ball**2 + _errors(problem, P, starts.disturbance)
    return Envelope(id=check.id, height=root_above(first, unit=_UNIT), rate=claimed(check.rate or 0.0))


def _errors(problem: Problem, P: Matrix | None, disturbance: Fraction) -> Fraction:
    """What |eps_i| <= disturbance add to a quadratic V at most."""
    if P is None:
        return ZERO
    return problem.n * eigenvalue_bound(SparseSymmetric.from_dense(P)) * disturbance**2


def tallest(P_e: SparseSymmetric) -> Fraction:
    """A bound of the largest e_c^2 where e'P_e e <= 1, P_e > 0: exact for diagonal and for small P_e."""
    if P_e.size <= MOST_INVERTED or all(i == j for i, j in P_e.entries):
        return max(diagonal_of_inverse(P_e))
    ceiling = eigenvalue_bound(P_e)
    least = ceiling - eigenvalue_bound(P_e.negated().shifted(ceiling))
    if least <= 0:
        raise ValueError("P_e is too close to a singular matrix")
    return 1 / least
