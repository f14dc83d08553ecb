"""Theorems 1 and 2 with weights: V = e'De + sum eps_i' P eps_i, D > 0 diagonal (theory, section
10).

With arc gains a >= 0 at the target and diagonal k >= 0, M = L(a) + K is an M-matrix.  For a rate
beta let

    N = D M + M'D - 2 beta D - D (I (x) sigma I) D,        sigma >= lambda_max(S),  S = C (-Omega0 -
    2 beta P)^-1 C'

N is a symmetric Z-matrix, so w > 0 with N w > 0 proves N > 0, and by the Reduction V' <= -2 beta V
near the target (linear couplings: everywhere).  One D and one P serve all modes; each mode has a w
of its own. The rows are decided exactly for few agents, else in floats rounded outward.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import ModeJacobian, Pair, Statements
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.numbers import MANY_AGENTS, fields_to_json, vector_to_json
from dobc_design.conditions.separable.large import floats_around
from dobc_design.errors import ShapeError
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import Matrix, Vector, is_symmetric, multiply, row_norm
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import blocks_of, group_blocks, group_numbers


@noun
class Weighted:
    """A claim: N w > 0 in every mode.  ``D`` and ``w[mode]`` (n m,), all > 0, entry i m + c for
    component c of agent i; ``P`` (q, q) symmetric, None without an exosystem.  Raises: ShapeError
    for an entry that is not > 0."""

    D: Vector | Doubles
    w: Mapping[str, Vector | Doubles]
    P: Matrix | None = None

    def __post_init__(self) -> None:
        for name, vector in (("D", self.D), *self.w.items()):
            if not len(vector) or least(vector) <= 0:
                raise ShapeError(f"{name} must have one entry > 0 per state.", key=name)

    def to_json(self) -> Document:
        """The exact values of a proved check."""
        values: Document = {
            "D": vector_to_json(self.D),
            "w": {mode: vector_to_json(vector) for mode, vector in self.w.items()},
        }
        if self.P is not None:
            values |= fields_to_json(self, "P")
        return values

    def holds(self, statements: Statements, W: Matrix | None, *, rate: Fraction) -> bool:
        """Whether the claim proves V' <= -2 rate V near the target, for the gain W (q, m) of the
        observer."""
        sigma = observer_bounds(statements.loop, self.P, W, rate=rate)
        return sigma is not None and network_holds(self, statements, rate=rate, sigma=sigma)


_SMALLEST = 2.0**-240  # a product of four numbers above keeps its digits
_ROUNDINGS = 12  # of one term, generously; those of the sums are counted


def why_not(statements: Statements) -> str | None:
    """Why the theorem does not apply; None if it does: gains of arcs and pins diagonal and >= 0."""
    if statements.inapplicable is not None or statements.jacobians is None:
        return statements.inapplicable
    if not all(mode.is_nonnegative_diagonal for mode in statements.jacobians.modes):
        return "does not apply: a coupling has a negative slope at the target, or mixes components."
    known = {id(k): k for mode in statements.jacobians.modes for k in mode.pulls.gains.values()}
    for k in known.values():
        if any(x for c, row in enumerate(k) for d, x in enumerate(row) if c != d):
            return "does not apply: a pinning gain mixes components."
    return None


def network_holds(
    claim: Weighted,
    statements: Statements,
    *,
    rate: Fraction,
    sigma: Sequence[Fraction] | None = None,
) -> bool:
    """The same for sigma of every group; for the network alone (eps = 0) without."""
    loop = statements.loop
    if why_not(statements) is not None or statements.jacobians is None:
        return False
    if sigma is None:
        sigma = (ZERO,) * max(1, len(loop.groups))
    return all(
        rows_hold(mode, loop, claim.D, claim.w[mode.name], rate=rate, sigma=sigma)
        for mode in statements.jacobians.modes
    )


def observer_bounds(
    loop: Loop, P: Matrix | None, W: Matrix | None, *, rate: Fraction
) -> Vector | None:
    """Of each group a row-sum bound of lambda_max(S), 0 without an exosystem; None unless Omega0 +
    2 rate P < 0 < P."""
    exosystem = loop.joint_exosystem
    if exosystem is None:
        return (ZERO,)
    if P is None or W is None or not is_symmetric(P) or len(P) != exosystem.order:
        return None
    if not decide_positive_definite(P).is_proved:
        return None
    # A P that mixes groups says nothing of a group by itself.
    orders = [(group.exosystem.order,) * 2 for group in loop.groups]
    if blocks_of(P, orders) is None:
        return None
    S = schur_block(Pair(P=P, Q=multiply(P, W)), exosystem, rate=rate)
    if S is None:
        return None
    return tuple(map(row_norm, group_blocks(S, len(loop.groups))))


@noun(eq=False)
class _Sums:
    """Sums by row of exact terms, or of floats with what rounding may have taken or added."""

    total: NDArray[Any]
    sizes: NDArray[Any]
    counts: NDArray[Any]

    @classmethod
    def of(cls, size: int, *, exact: bool) -> _Sums:
        zeros = np.full(size, ZERO) if exact else np.zeros(size)
        return cls(total=zeros, sizes=np.zeros(size), counts=np.zeros(size))

    def add(self, rows: NDArray[np.int64], terms: NDArray[Any]) -> None:
        if self.total.dtype == object:  # fractions have no roundings to be counted
            np.add.at(self.total, rows, terms)
            return
        size = len(self.total)
        self.total[:] += np.bincount(rows, weights=terms, minlength=size)
        self.sizes[:] += np.bincount(rows, weights=np.abs(terms), minlength=size)
        self.counts[:] += np.bincount(rows, minlength=size)

    def are_positive(self) -> bool:
        if self.total.dtype == object:
            return bool((self.total > 0).all())
        with np.errstate(invalid="ignore", over="ignore"):
            # Every term may be off by its own roundings and by those of the sum.
            slack = (self.counts + _ROUNDINGS) * 2.0**-52 * self.sizes
            return bool((self.total > slack).all())


def rows_hold(
    mode: ModeJacobian,
    loop: Loop,
    D: Vector | Doubles,
    w: Vector | Doubles,
    *,
    rate: Fraction,
    sigma: Sequence[Fraction],
) -> bool:
    """Whether N w > 0 holds in this mode for every gain in its enclosure."""
    m = loop.m
    size = loop.n * m
    exact = size <= MANY_AGENTS or not (isinstance(D, Doubles) and isinstance(w, Doubles))
    d = _entries(D, exact=exact)
    v = _entries(w, exact=exact)
    _, slow = _ends([2 * rate], exact=exact)
    # An agent of no group has the number after the last one, and nothing from an observer.
    _, of_groups = _ends([*sigma, ZERO], exact=exact)
    owners = np.array(group_numbers(loop.groups, loop.labels), dtype=np.int64)
    weights = of_groups[np.repeat(owners, m)]
    pulls = mode.pulls.gains
    pins = np.array([i * m + c for i in pulls for c in range(m)], dtype=np.int64)
    gains, _ = _ends([2 * k[c][c] for k in pulls.values() for c in range(m)], exact=exact)
    if not exact and not _keeps_digits(d, v, weights, gains, slow):
        return False
    # Row by row: -2 rate d w - sigma d^2 w + 2 k d w, and what every arc adds to its two rows.
    sums = _Sums.of(size, exact=exact)
    everyone = np.arange(size)
    with np.errstate(over="ignore", invalid="ignore"):
        sums.add(everyone, -slow[0] * d * v)
        sums.add(everyone, -weights * d * d * v)
        sums.add(pins, gains * d[pins] * v[pins])
        for c in range(m):
            low, _ = _ends([gain[c][c].lo for gain in mode.gains], exact=exact)
            _, high = _ends([gain[c][c].hi for gain in mode.gains], exact=exact)
            if not exact and not _keeps_digits(low, high):
                return False
            i = mode.arcs.listeners * m + c
            j = mode.arcs.speakers * m + c
            # The end of the gain that makes the row smallest.
            pull = 2 * v[i] - v[j]
            gain = np.where(pull >= 0, low[mode.kind], high[mode.kind])
            sums.add(i, gain * d[i] * pull)
            sums.add(j, -high[mode.kind] * d[i] * v[i])
    return sums.are_positive()


def _ends(numbers: Sequence[Fraction], *, exact: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Numbers as they enter the sums, from below and from above: themselves, or floats."""
    if not exact:
        return floats_around(numbers)
    entries = np.array(numbers, dtype=object)
    return entries, entries


def _entries(vector: Vector | Doubles, *, exact: bool) -> NDArray[Any]:
    """The vector as fractions where ``exact``, else as the floats it is made of."""
    if not isinstance(vector, Doubles):
        return np.array(vector, dtype=object)
    if exact:
        return np.array(tuple(vector), dtype=object)
    return vector.array


def _keeps_digits(*arrays: NDArray[Any]) -> bool:
    """Whether no product of these numbers loses digits below the smallest float."""
    return all(bool(((x == 0) | (np.abs(x) > _SMALLEST)).all()) for x in arrays)
