"""Theorems 1 and 2 over a region: V = e'P_e e + sum eps_i'P eps_i and the inequalities that make it decrease there.

Theory, section 4 (circle criterion, S-procedure), after the Schur complements that leave n m rows.  For channels
with gains in [low, high], g0 = (low + high)/2, d = (high - low)/2, A0 = -K + sum g0 b c', multipliers tau > 0 where
d > 0, S = C (-Omega0 - 2 beta P)^-1 C', the inequality of one mode is

    P_e A0 + A0'P_e + 2 beta P_e + P_e (I (x) S + sum b b'/(2 tau)) P_e + sum 2 tau d^2 c c' < 0             ("lure")

which equals the block inequality of theory for any low, high, and takes linear channels (d = 0) as they are.  Two
other sufficient conditions share the interface: g0 and row sums of the deviations ("interval"), and all corners of
the box of gains ("vertices").
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, Literal

from dobc_design.conditions.quadratic.sectors import Channel, GainRange, Sectors
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.canonical import matrix_text
from dobc_design.problem.groups import agent_blocks

Method = Literal["lure", "interval", "vertices"]
METHODS: Final = ("lure", "interval", "vertices")
#: Channels with a range of their own up to which corners are enumerated.
MOST_VERTICES: Final = 12
ZERO: Final = Fraction(0)
Entries = dict[tuple[int, int], Fraction]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lure:
    """A claim: {V <= level} is invariant and V' <= -2 rate V in it, V = e'P_e e + sum eps_i'P eps_i, in every mode.

    P_e (n m, n m); ``radius`` bounds |e_j - e_i| by component, and ``ranges`` are the gains claimed there.
    ``multipliers``: mode -> one tau per channel, 0 where the channel is linear; empty unless ``method`` is "lure".
    ``level`` is rho^2; None: all of space (without a radius).  ``rate`` in 1/s.  P, Q (q, q), (q, m): the observer's
    pair; None without an exosystem, or for eps = 0 only.
    Raises: SpecError or ShapeError for what cannot be a claim.
    """

    P_e: SparseSymmetric
    ranges: tuple[GainRange, ...]
    radius: Fraction | None
    level: Fraction | None
    multipliers: Mapping[str, tuple[Fraction, ...]] = field(default_factory=dict)
    rate: Fraction = ZERO
    P: Matrix | None = None
    Q: Matrix | None = None
    method: Method = "lure"

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", MappingProxyType(dict(self.multipliers)))
        if self.method not in METHODS:
            raise SpecError(f"method must be one of {', '.join(METHODS)}; got {self.method!r}.", key="method")
        if self.rate < 0 or (self.level is not None and self.level <= 0):
            raise SpecError("rate must be >= 0 and level > 0.", key="rate" if self.rate < 0 else "level")
        if (self.P is None) is not (self.Q is None):
            raise ShapeError("P and Q must both be given, or neither.", key="P")

    @property
    def shape(self) -> str:
        """ "identity" for a multiple of I, "diagonal", or "full"."""
        if any(i != j for i, j in self.P_e.entries):
            return "full"
        values = {self.P_e.entries.get((i, i), ZERO) for i in range(self.P_e.size)}
        return "identity" if len(values) == 1 else "diagonal"

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        values: dict[str, Any] = {
            "method": self.method,
            "P_e": [[i, j, number_text(value)] for (i, j), value in sorted(self.P_e.entries.items())],
            "level": None if self.level is None else number_text(self.level),
            "radius": None if self.radius is None else number_text(self.radius),
            "ranges": [
                {
                    "coupling": each.coupling,
                    "gains": [[[number_text(gain.lo), number_text(gain.hi)] for gain in row] for row in each.entries],
                }
                for each in self.ranges
            ],
            "multipliers": {mode: [number_text(tau) for tau in taus] for mode, taus in self.multipliers.items()},
            "rate": number_text(self.rate),
        }
        return values if self.P is None else values | {"P": matrix_text(self.P)}


def lure_matrix(
    sectors: Sectors,
    mode: str,
    P_e: SparseSymmetric,
    multipliers: Sequence[Fraction],
    *,
    rate: Fraction = ZERO,
    S: Matrix | None = None,
) -> SparseSymmetric:
    """The left side of the Lur'e inequality of one mode, (n m, n m).

    S (m, m) is the observer's border or None; where agents have different exosystems, that of the joint one.

    Raises: ShapeError unless there is one multiplier per channel, > 0 where its range is not a point.
    """
    channels = sectors.modes[mode]
    if len(multipliers) != len(channels):
        raise ShapeError(
            f"mode {mode}: multipliers must have {len(channels)} entries, one per channel; got {len(multipliers)}.",
            key="multipliers",
        )
    inner, added = _observer_block(sectors, S), dict[tuple[int, int], Fraction]()
    for channel, tau in zip(channels, multipliers, strict=True):
        if not channel.spread:
            continue
        if tau <= 0:
            raise ShapeError(f"mode {mode}: multipliers must be > 0 where the gain has a range.", key="multipliers")
        add(inner, channel.target, channel.target, 1 / (2 * tau))
        weight = 2 * tau * channel.spread**2
        for i, j, sign in ((channel.plus, channel.plus, 1), (channel.minus, channel.minus, 1)):
            add(added, i, j, sign * weight)
        add(added, channel.plus, channel.minus, -weight)
    linear = linear_part(sectors, mode, [channel.centre for channel in channels])
    return _derivative(P_e, linear, rate) + _sandwich(P_e, inner) + SparseSymmetric(sectors.size, added)


def interval_matrix(
    sectors: Sectors, mode: str, P_e: SparseSymmetric, *, rate: Fraction = ZERO, S: Matrix | None = None
) -> SparseSymmetric:
    """An upper bound of the derivative for all gains: middle gains, and row sums of |deviation| on the diagonal."""
    channels = sectors.modes[mode]
    linear = linear_part(sectors, mode, [channel.centre for channel in channels])
    rows = rows_of(P_e)
    sums = [ZERO] * sectors.size
    for channel in channels:
        if channel.spread:
            for (i, j), value in _rank_two(rows[channel.target], channel).items():
                for row in {i, j}:
                    sums[row] += channel.spread * abs(value)
    bound = SparseSymmetric(sectors.size, {(i, i): value for i, value in enumerate(sums)})
    return _derivative(P_e, linear, rate) + _sandwich(P_e, _observer_block(sectors, S)) + bound


def vertex_matrices(
    sectors: Sectors, mode: str, P_e: SparseSymmetric, *, rate: Fraction = ZERO, S: Matrix | None = None
) -> Iterator[SparseSymmetric]:
    """The derivative at every corner of the box of gains; it is affine in them, so the corners decide.

    Raises: SpecError for more than MOST_VERTICES channels with a range.
    """
    channels = sectors.modes[mode]
    free = sum(1 for channel in channels if channel.spread)
    if free > MOST_VERTICES:
        raise SpecError(
            f"mode {mode} has {free} channels with a range of gains; corners are enumerated for at most"
            f" {MOST_VERTICES}.",
            key="method",
            cure='Use the method "lure".',
        )
    rows = rows_of(P_e)
    fixed = _derivative(P_e, linear_part(sectors, mode, [channel.low for channel in channels]), rate)
    fixed = fixed + _sandwich(P_e, _observer_block(sectors, S))
    steps = [
        SparseSymmetric(sectors.size, _rank_two(rows[channel.target], channel)).scaled(2 * channel.spread)
        for channel in channels
        if channel.spread
    ]
    for corner in itertools.product((False, True), repeat=free):
        yield sum((step for step, up in zip(steps, corner, strict=True) if up), fixed)


def linear_part(sectors: Sectors, mode: str, gains: Sequence[Fraction]) -> dict[int, dict[int, Fraction]]:
    """-K + sum of g b c' as rows: row -> column -> entry."""
    problem, m = sectors.problem, sectors.problem.m
    rows: dict[int, dict[int, Fraction]] = {i: {} for i in range(sectors.size)}
    for agent, gain in problem.pinning.gains.items():
        for c in range(m):
            for d in range(m):
                if gain[c][d]:
                    rows[agent * m + c][agent * m + d] = -gain[c][d]
    for channel, g in zip(sectors.modes[mode], gains, strict=True):
        row = rows[channel.target]
        row[channel.plus] = row.get(channel.plus, ZERO) + g
        row[channel.minus] = row.get(channel.minus, ZERO) - g
    return rows


def rows_of(M: SparseSymmetric) -> list[dict[int, Fraction]]:
    """The rows of a sparse symmetric matrix, both triangles."""
    rows: list[dict[int, Fraction]] = [{} for _ in range(M.size)]
    for (i, j), value in M.entries.items():
        rows[i][j] = rows[j][i] = value
    return rows


def add(entries: Entries, i: int, j: int, value: Fraction) -> None:
    """Add to the entry (i, j) of a symmetric matrix, kept in its upper triangle."""
    where = (i, j) if i <= j else (j, i)
    entries[where] = entries.get(where, ZERO) + value


def _derivative(P_e: SparseSymmetric, linear: dict[int, dict[int, Fraction]], rate: Fraction) -> SparseSymmetric:
    """P_e A + A'P_e + 2 rate P_e."""
    entries: Entries = {place: 2 * rate * value for place, value in P_e.entries.items()} if rate else {}
    for k, weights in enumerate(rows_of(P_e)):
        for j, a in linear[k].items():
            for i, p in weights.items():  # P_e[i, k] A[k, j], and its transpose
                value = p * a
                add(entries, i, j, 2 * value if i == j else value)
    return SparseSymmetric(P_e.size, entries)


def _sandwich(P_e: SparseSymmetric, inner: Entries) -> SparseSymmetric:
    """P_e N P_e for a sparse symmetric N."""
    middle = SparseSymmetric(P_e.size, inner)
    if len(P_e.entries) > 4 * P_e.size:
        dense = P_e.to_dense()
        product = multiply(multiply(dense, middle.to_dense()), dense)
        return SparseSymmetric(
            P_e.size, {(i, j): x for i, row in enumerate(product) for j, x in enumerate(row) if i <= j}
        )
    rows, entries = rows_of(P_e), dict[tuple[int, int], Fraction]()
    for (k, l), value in middle.entries.items():  # noqa: E741  k, l as in matrix entries
        for i, left in rows[k].items():
            for j, right in rows[l].items():
                product_ = left * value * right
                if k == l:
                    if i <= j:
                        add(entries, i, j, product_)
                else:
                    add(entries, i, j, 2 * product_ if i == j else product_)
    return SparseSymmetric(P_e.size, entries)


def _rank_two(row: Mapping[int, Fraction], channel: Channel) -> Entries:
    """P_e b c' + c b'P_e, where ``row`` is the row of P_e at the channel's target."""
    entries: Entries = {}
    for i, p in row.items():
        add(entries, i, channel.plus, 2 * p if i == channel.plus else p)
        add(entries, i, channel.minus, -2 * p if i == channel.minus else -p)
    return entries


def _observer_block(sectors: Sectors, S: Matrix | None) -> Entries:
    """I (x) S; where agents have different exosystems, the block of each agent's group."""
    if S is None:
        return {}
    problem, m = sectors.problem, sectors.problem.m
    return {
        (agent * m + i, agent * m + j): block[i][j]
        for agent, block in enumerate(agent_blocks(S, problem.groups, problem.network.labels))
        for i in range(m)
        for j in range(i, m)
        if block[i][j]
    }
