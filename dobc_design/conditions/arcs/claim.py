"""Arc-wise dissipation in a region: V = sum d_i e_i'e_i + sum eps_i'P eps_i, and how its decrease is
shared out among arcs and agents.

Theory, section 20.  Along an arc i <- j of weight w the derivative of V is 2 d_i w e_i'h(e_j - e_i).
Two numbers a, b per arc bound it, by component, wherever d_i x^2 + d_j y^2 <= level:

    2 d_i w x h(y - x) <= a x^2 + b y^2

What an agent's own gain leaves of all a of arcs by which it hears, and all b of arcs by which it is
heard, is its slack, which has to pay for the rate and for the error of its observer:

    d_i (K_i + K_i') - (sum of a + sum of b + 2 rate d_i) I - d_i^2 S >= 0

S = C (-Omega0 - 2 rate P)^-1 C' of the agent's exosystem.  No coupling has to rise, and the work
grows with the arcs, of which those that look alike count once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design.conditions.domain import Around, Box
from dobc_design.conditions.numbers import (
    as_json,
    claimed,
    fields_to_json,
    form_from_json,
    known_to_json,
    read_rational,
    read_rationals,
    vector_from_json,
    vector_to_json,
)
from dobc_design.exact.matrix import Matrix, is_symmetric, multiply
from dobc_design.exact.reading import Table
from dobc_design.exact.symmetric import SparseSymmetric, largest, least
from dobc_design.conditions.quadratic.decide import eigenvalue_bound
from dobc_design.loop.loop import Loop, Pair

NAMES = ("d", "shares", "level", "rate")


@noun
class ArcWise:
    """A claim: {V <= level} is invariant and V' <= -2 rate V in it, in every mode.

    ``d``: one number > 0 per node. ``shares``: mode -> (a, b) of every arc, in the order of the
    loop, in 1/s times the unit of d.  P, Q (q, q), (q, m): the observer's pair; None without an
    exosystem.
    """

    d: Sequence[Fraction]
    shares: Mapping[str, tuple[Pair, ...]]
    level: Fraction
    rate: Fraction
    P: Matrix | None = None
    Q: Matrix | None = None

    def to_json(self) -> dict[str, Any]:
        shares = {mode: as_json(pairs) for mode, pairs in self.shares.items()}
        values = {"d": vector_to_json(tuple(self.d)), "shares": shares}
        return values | fields_to_json(self, "level", "rate") | known_to_json(self, "P")


def claim_from_json(values: Table, loop: Loop, W: Matrix | None) -> ArcWise:
    """Read it back.  Raises: KeyError, TypeError or ValueError for what is no such claim."""
    shares = {}
    for mode, arcs in loop.modes.items():
        pairs = [(read_rational(a), read_rational(b)) for a, b in values["shares"][mode]]
        if len(pairs) != len(arcs):
            raise ValueError(f"mode {mode} has {len(arcs)} arcs, not {len(pairs)}")
        shares[mode] = tuple(pairs)
    if len(values["shares"]) != len(shares):
        raise ValueError("shares must have one entry for each mode")
    d = vector_from_json(values["d"], loop.n)
    level, rate = read_rationals(values, "level", "rate")
    if least(d) <= 0 or level <= 0 or rate < 0:
        raise ValueError("d and level must be > 0, the rate >= 0")
    P = None
    if loop.groups:
        P = form_from_json(values["P"])
        if [len(row) for row in P] != [loop.q] * loop.q or not is_symmetric(P):
            raise ValueError(f"P must be a symmetric matrix of {loop.q} rows")
    return ArcWise(
        d=d,
        shares=shares,
        level=level,
        rate=rate,
        P=P,
        Q=None if P is None or W is None else multiply(P, W),
    )


def names_of(loop: Loop) -> tuple[str, ...]:
    """The keys of ``exact``."""
    return (*NAMES, "P") if loop.groups else NAMES


def room_of(loop: Loop, claim: ArcWise, disturbance: Fraction) -> Fraction:
    """What observers leave of the level for sum d_i e_i'e_i; negative: nothing."""
    if not disturbance:
        return claim.level
    if claim.P is None:
        return Fraction(-1)
    bound = eigenvalue_bound(SparseSymmetric.from_dense(claim.P))
    return claim.level - loop.n * bound * disturbance**2


def covers(loop: Loop, claim: ArcWise, domain: Around) -> bool:
    """Whether all starts of a box or ball lie in {V <= level}."""
    room = room_of(loop, claim, claimed(domain.disturbance))
    square = claimed(domain.radius) ** 2
    weight = loop.m * sum(claim.d) if isinstance(domain, Box) else largest(claim.d)
    return square * weight <= room
