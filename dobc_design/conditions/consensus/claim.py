"""Lemma 1 and Theorems 1 and 2 of the paper, stated once, for any enclosed Jacobians.

    Lambda(J) = J + J' - (K + K')                                            (10), twice F
    Omega0    = P A + A' P - C'Q' - Q C
    Psi(J)    = [[Lambda(J), I (x) C], [(I (x) C)', I (x) Omega0]] < 0       (18), (28)

With a rate beta > 0, 2 beta diag(I, I (x) P) is added, and V' <= -2 beta V follows.  Unknowns are P
(symmetric, q x q) and Q (q x m); W = P^-1 Q.  Lemma 1 is Lambda < 0 and has no unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from dobc_design.conditions.consensus.arrays import is_large, lemma1_in_arrays
from dobc_design.conditions.consensus.jacobians import Jacobians, ModeJacobian
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.pencil import Deviation, Pencil, Place, Unknown
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, group_numbers
from dobc_design.problem.pinning import Pinning

ZERO = Fraction(0)
Entries = dict[tuple[int, int], Fraction]


def lemma1(jacobian: ModeJacobian, pinning: Pinning, *, size: int, dimension: int) -> Pencil:
    """Lambda(J) = J + J' - (K + K') < 0: Lemma 1, eq. (10) without its factor 1/2.

    Size: n m.  No unknowns.  Large ones are stated in arrays (``arrays``).
    """
    if is_large(jacobian, size=size, dimension=dimension):
        lean = lemma1_in_arrays(jacobian, pinning, size=size, dimension=dimension)
        if lean is not None:
            return lean
    entries: Entries = {}
    deviations: list[Deviation] = []
    for (listener, speaker, _), kind in zip(jacobian.arcs, jacobian.kind.tolist(), strict=True):
        gain = jacobian.gains[kind]
        for c in range(dimension):
            for d in range(dimension):
                row, off, own = listener * dimension + c, speaker * dimension + d, listener * dimension + d
                _add_slope(entries, deviations, gain[c][d], row=row, off=off, own=own)
    for agent, gain in pinning.gains.items():
        for c in range(dimension):
            for d in range(c, dimension):
                _add(entries, agent * dimension + c, agent * dimension + d, -(gain[c][d] + gain[d][c]))
    return Pencil(
        name=f"lemma1 ({jacobian.name})",
        constant=SparseSymmetric(size * dimension, entries),
        unknowns=(),
        coefficients={},
        deviations=tuple(deviations),
    )


def theorem1(lambda_: Pencil, exosystem: Exosystem, *, agents: int, rate: Fraction = ZERO) -> Pencil:
    """Psi of eq. (18), from Lambda (a Pencil of ``lemma1``) and the exosystem.

    Size: n m + n q.  Unknowns P and Q.  ``rate`` (1/s) adds 2 rate diag(I, I (x) P).
    """
    return _psi(lambda_, [("", exosystem)], [0] * agents, rate=rate)


def theorem1_of_groups(
    lambda_: Pencil, groups: Sequence[Group], labels: Sequence[str], *, rate: Fraction = ZERO
) -> Pencil:
    """Psi where agents have different exosystems: every agent has the C and the Omega0 of its group.

    Size: n m + the sum of the agents' orders.  Unknowns: P and Q of every group, by its name: "P[1]", "Q[1]".
    """
    systems = [(f"[{group.name}]", group.exosystem) for group in groups]
    return _psi(lambda_, systems, group_numbers(groups, labels), rate=rate)


def _psi(
    lambda_: Pencil, systems: Sequence[tuple[str, Exosystem]], numbers: Sequence[int], *, rate: Fraction
) -> Pencil:
    """Psi from the exosystems, each with what distinguishes its unknowns, and each agent's number among them."""
    m = systems[0][1].outputs
    entries: Entries = dict(lambda_.constant.entries)
    size = offset = len(numbers) * m
    for i in range(offset if rate else 0):
        _add(entries, i, i, 2 * rate)
    starts: list[list[int]] = [[] for _ in systems]  # where the blocks of the agents begin
    for agent, number in enumerate(numbers):
        exosystem = systems[number][1]
        starts[number].append(size)
        for c in range(m):
            for k in range(exosystem.order):
                if exosystem.C[c][k]:
                    entries[agent * m + c, size + k] = exosystem.C[c][k]
        size += exosystem.order
    unknowns: list[Unknown] = []
    coefficients: dict[Place, SparseSymmetric] = {}
    for (mark, exosystem), own in zip(systems, starts, strict=True):
        q = exosystem.order
        pair = (
            Unknown(name=f"P{mark}", rows=q, columns=q, symmetric=True),
            Unknown(name=f"Q{mark}", rows=q, columns=m, symmetric=False),
        )
        unknowns += pair
        for name, unknown in zip("PQ", pair, strict=True):
            for place in unknown.places():
                block = omega_coefficient(exosystem, (name, place[1], place[2]), rate=rate)
                values = {(start + i, start + j): x for start in own for (i, j), x in block.items()}
                coefficients[place] = SparseSymmetric(size, values)
    return Pencil(
        name=lambda_.name.replace("lemma1", "theorem1"),
        constant=SparseSymmetric(size, entries),
        unknowns=tuple(unknowns),
        coefficients=coefficients,
        deviations=lambda_.deviations,
    )


def theorem2(
    jacobians: Jacobians, pinning: Pinning, exosystem: Exosystem, *, rate: Fraction = ZERO
) -> tuple[Pencil, ...]:
    """Theorem 2, eq. (28): one Psi per mode, with the same unknowns P and Q.  One mode: Theorem 1."""
    return tuple(
        theorem1(
            lemma1(mode, pinning, size=jacobians.size, dimension=jacobians.dimension),
            exosystem,
            agents=jacobians.size,
            rate=rate,
        )
        for mode in jacobians.modes
    )


def reduced(bound: Fraction, exosystem: Exosystem, *, rate: Fraction = ZERO) -> Pencil:
    """The same statement for one agent with Lambda = bound I: what Psi < 0 comes down to (theory, Reduction).

    With bound = max lambda_max(Lambda) over the modes it is equivalent to Theorem 2 when m = 1 or
    Lambda = Lambda_n (x) I_m, and sufficient in general.  Size: m + q.
    """
    m = exosystem.outputs
    diagonal = SparseSymmetric(m, {(i, i): bound for i in range(m)})
    one = Pencil(name="reduced", constant=diagonal, unknowns=(), coefficients={})
    return theorem1(one, exosystem, agents=1, rate=rate)


def omega_coefficient(exosystem: Exosystem, place: Place, *, rate: Fraction = ZERO) -> Entries:
    """What one entry of P or Q contributes to Omega0 + 2 rate P (upper triangle, q x q)."""
    name, k, l = place  # noqa: E741  k, l as in matrix entries
    A, C, q = exosystem.A, exosystem.C, exosystem.order
    full: dict[tuple[int, int], Fraction] = {}

    def put(i: int, j: int, value: Fraction) -> None:
        if value:
            full[i, j] = full.get((i, j), ZERO) + value

    if name == "P":
        for r, s in {(k, l), (l, k)}:
            for j in range(q):
                put(r, j, A[s][j])  # (E A)_rj
                put(j, r, A[s][j])  # (A' E')_jr
            put(r, s, 2 * rate)
    else:
        for j in range(q):
            put(k, j, -C[l][j])  # (Q C)_kj
            put(j, k, -C[l][j])
    return {(i, j): value for (i, j), value in full.items() if i <= j and value}


def omega(P: Matrix, Q: Matrix, exosystem: Exosystem, *, rate: Fraction = ZERO) -> SparseSymmetric:
    """Omega0 + 2 rate P at rational P, Q: the block every agent has."""
    q, m = exosystem.order, exosystem.outputs
    entries: Entries = {}
    places: list[tuple[Place, Fraction]] = [(("P", i, j), P[i][j]) for i in range(q) for j in range(i, q)]
    places += [(("Q", i, j), Q[i][j]) for i in range(q) for j in range(m)]
    for place, x in places:
        if x:
            for where, value in omega_coefficient(exosystem, place, rate=rate).items():
                entries[where] = entries.get(where, ZERO) + x * value
    return SparseSymmetric(q, entries)


def _add(entries: Entries, i: int, j: int, value: Fraction) -> None:
    if value:
        where = (i, j) if i <= j else (j, i)
        entries[where] = entries.get(where, ZERO) + value


def _add_slope(entries: Entries, deviations: list[Deviation], slope: Interval, *, row: int, off: int, own: int) -> None:
    """Add J + J' of one entry of one arc: the slope at (row, off), minus the slope at (row, own)."""
    middle = slope.midpoint
    _add(entries, row, off, middle)
    _add(entries, row, own, -2 * middle if row == own else -middle)
    if not slope.is_point:
        deviations.append(Deviation(row, off, own, slope.width / 2))


def with_gain(pencil: Pencil, W: Matrix) -> Pencil:
    """The pencil with Q = P W put in: P is the only unknown left.  Shape: W (q, m)."""
    P, Q = pencil.unknowns
    coefficients: dict[Place, SparseSymmetric] = {}
    for place in P.places():
        _, k, l = place  # noqa: E741
        total = pencil.coefficients[place]
        for row, other in {(k, l), (l, k)}:  # P_row,other stands in row `row` of P W
            for j in range(Q.columns):
                if W[other][j]:
                    total = total + pencil.coefficients["Q", row, j].scaled(W[other][j])
        coefficients[place] = total
    return Pencil(
        name=pencil.name,
        constant=pencil.constant,
        unknowns=(P,),
        coefficients=coefficients,
        deviations=pencil.deviations,
    )
