"""Theorems 1 and 2 over a region: V = e'P_e e + sum eps_i'P eps_i and the inequalities that make it
decrease there.

Theory, section 4 (circle criterion, S-procedure), after the Schur complements that leave n m rows.
For channels with gains in [low, high], g0 = (low + high)/2, d = (high - low)/2, A0 = -K + sum g0 b
c', multipliers tau > 0 where d > 0, S = C (-Omega0 - 2 beta P)^-1 C', the inequality of one mode is

    P_e A0 + A0'P_e + 2 beta P_e + P_e (I (x) S + sum b b'/(2 tau)) P_e + sum 2 tau d^2 c c' < 0
    ("lure")

which equals the block inequality of theory for any low, high, and takes linear channels (d = 0) as
they are.  Two other sufficient conditions share the interface: g0 and row sums of the deviations
("interval"), and all corners of the box of gains ("vertices").
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, Literal

from dobc_design._checks import noun
from dobc_design.conditions.consensus.claim import add_to as add
from dobc_design.conditions.numbers import as_json, fields_to_json, form_from_json, known_to_json
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix, is_symmetric, multiply
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import Table
from dobc_design.exact.symmetric import Entries, SparseSymmetric
from dobc_design.loop.loop import Loop
from dobc_design.problem.groups import agent_blocks

from .sectors import Channel, GainRange, Sectors

Method = Literal["lure", "interval", "vertices"]
Shape = Literal["identity", "diagonal", "full"]
METHODS: Final[tuple[Method, ...]] = ("lure", "interval", "vertices")
MOST_VERTICES = 12  # channels with a range of their own up to which corners are enumerated
LinearRows = dict[int, dict[int, Fraction]]  # row -> column -> value


@noun
class Quadratic:
    """A claim: {V <= level} is invariant and V' <= -2 rate V in it, V = e'P_e e + sum eps_i'P
    eps_i, in every mode.

    P_e (n m, n m); level is rho^2 (None: all of space).  P, Q (q, q), (q, m): the observer's pair;
    None without an exosystem, or for eps = 0.
    """

    P_e: SparseSymmetric
    level: Fraction | None
    rate: Fraction = ZERO
    P: Matrix | None = None
    Q: Matrix | None = None

    def to_json(self) -> dict[str, Any]:
        return fields_to_json(self, "level", "rate") | known_to_json(self, "P")


@noun
class Lure(Quadratic):
    """One with bounded gains.  ``radius`` bounds |e_j - e_i| by component, ``ranges`` are the gains
    there (None: everywhere).  ``multipliers``: mode -> one tau per channel, 0 where it is linear;
    for "lure" only.
    """

    ranges: tuple[GainRange, ...]
    radius: Fraction | None
    multipliers: Mapping[str, tuple[Fraction, ...]] = field(default_factory=dict)
    method: Method = "lure"

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", MappingProxyType(dict(self.multipliers)))
        if self.method not in METHODS:
            known = ", ".join(METHODS)
            raise SpecError(f"method must be one of {known}; got {self.method!r}.", key="method")
        signs = "rate must be >= 0 and level > 0."
        if self.rate < 0:
            raise SpecError(signs, key="rate")
        if self.level is not None and self.level <= 0:
            raise SpecError(signs, key="level")
        if (self.P is None) is not (self.Q is None):
            raise ShapeError("P and Q must both be given, or neither.", key="P")

    @property
    def shape(self) -> Shape:
        """What P_e is: a multiple of I, diagonal or full."""
        if not self.P_e.is_diagonal:
            return "full"
        return "identity" if len(set(self.P_e.diagonal())) == 1 else "diagonal"

    def to_json(self) -> dict[str, Any]:
        entries = [[*place, value] for place, value in sorted(self.P_e.entries.items())]
        values = {"method": self.method, "P_e": as_json(entries)}
        values |= fields_to_json(self, "level", "radius", "ranges", "multipliers", "rate")
        return values | known_to_json(self, "P")


def observer_from_json(
    values: Table, loop: Loop, W: Matrix | None
) -> tuple[Matrix | None, Matrix | None]:
    """The observer's pair (P, P W), None where there is none.  Raises: KeyError, TypeError or
    ValueError."""
    if not loop.groups:
        return None, None
    P = form_from_json(values["P"])
    if [len(row) for row in P] != [loop.q] * loop.q or not is_symmetric(P):
        raise ValueError(f"P must be a symmetric matrix of {loop.q} rows")
    return P, None if W is None else multiply(P, W)


def lure_matrix(
    sectors: Sectors,
    mode: str,
    P_e: SparseSymmetric,
    multipliers: Sequence[Fraction],
    *,
    rate: Fraction = ZERO,
    S: Matrix | None = None,
) -> SparseSymmetric:
    """The left side of the Lur'e inequality of one mode, (n m, n m); S (m, m): the observer's
    (joint) border or None.
    Raises: ShapeError unless there is one multiplier per channel, > 0 where its range is not a
    point."""
    channels = sectors.modes[mode]
    size = sectors.size
    if len(multipliers) != len(channels):
        many = f"{len(channels)} entries, one per channel; got {len(multipliers)}"
        raise ShapeError(f"mode {mode}: multipliers must have {many}.", key="multipliers")
    added: Entries = {}  # sum 2 tau d^2 c c'
    inner = _observer_block(sectors.loop, S)  # and sum b b'/(2 tau): what stands between P_e
    for channel, tau in zip(channels, multipliers, strict=True):
        if not channel.spread:  # a linear channel is in A0 already
            continue
        if tau <= 0:
            raise ShapeError(
                f"mode {mode}: multipliers must be > 0 where the gain has a range.",
                key="multipliers",
            )
        add(inner, channel.target, channel.target, 1 / (2 * tau))
        weight = 2 * tau * channel.spread**2
        add(added, channel.plus, channel.plus, weight)
        add(added, channel.minus, channel.minus, weight)
        add(added, channel.plus, channel.minus, -weight)
    linear = linear_part(sectors, mode, [channel.centre for channel in channels])
    added = _without_target(added, size)
    return _derivative(P_e, linear, rate) + _sandwich(P_e, inner) + SparseSymmetric(size, added)


def interval_matrix(
    sectors: Sectors,
    mode: str,
    P_e: SparseSymmetric,
    *,
    rate: Fraction,
    S: Matrix | None = None,
) -> SparseSymmetric:
    """An upper bound of the derivative for all gains: middle gains, and row sums of |deviation| on
    the diagonal."""
    channels = sectors.modes[mode]
    size = sectors.size
    linear = linear_part(sectors, mode, [channel.centre for channel in channels])
    rows = P_e.rows()
    sums = [ZERO] * size
    for channel in channels:
        for (i, j), value in _rank_two(rows[channel.target], channel, size).items():
            # An entry beside the diagonal stands in two rows, one on it in one.
            for row in {i, j}:
                sums[row] += channel.spread * abs(value)
    bound = SparseSymmetric(size, {(i, i): value for i, value in enumerate(sums)})
    observer = _sandwich(P_e, _observer_block(sectors.loop, S))
    return _derivative(P_e, linear, rate) + observer + bound


def vertex_matrices(
    sectors: Sectors,
    mode: str,
    P_e: SparseSymmetric,
    *,
    rate: Fraction = ZERO,
    S: Matrix | None = None,
) -> Iterator[SparseSymmetric]:
    """The derivative at every corner of the box of gains, which decide.  Raises: SpecError beyond
    MOST_VERTICES."""
    channels = sectors.modes[mode]
    free = [channel for channel in channels if channel.spread]
    if len(free) > MOST_VERTICES:
        many = (
            f"mode {mode} has {len(free)} channels with a range of gains; corners are "
            "enumerated for at most"
        )
        raise SpecError(f"{many} {MOST_VERTICES}.", key="method", cure='Use the method "lure".')
    size = sectors.size
    rows = P_e.rows()
    linear = linear_part(sectors, mode, [channel.low for channel in channels])
    lowest = _derivative(P_e, linear, rate)
    lowest = lowest + _sandwich(P_e, _observer_block(sectors.loop, S))
    # What each free gain adds from its lowest value to its highest.
    steps = []
    for channel in free:
        step = SparseSymmetric(size, _rank_two(rows[channel.target], channel, size))
        steps.append(step.scaled(2 * channel.spread))
    # The derivative is affine in every gain, so that it is largest at a corner.
    for corner in itertools.product((False, True), repeat=len(free)):
        yield sum(itertools.compress(steps, corner), lowest)


def linear_part(sectors: Sectors, mode: str, gains: Sequence[Fraction]) -> LinearRows:
    """-K + sum of g b c' as rows: row -> column -> entry."""
    m = sectors.loop.m
    rows: LinearRows = {i: {} for i in range(sectors.size)}
    for agent, gain in sectors.loop.pulls.gains.items():
        for c, own in enumerate(gain):
            rows[agent * m + c] = {agent * m + d: -entry for d, entry in enumerate(own) if entry}
    for channel, g in zip(sectors.modes[mode], gains, strict=True):
        row = rows[channel.target]
        row[channel.plus] = row.get(channel.plus, ZERO) + g
        row[channel.minus] = row.get(channel.minus, ZERO) - g
        # The error of the target is 0.
        row.pop(sectors.size, None)
    return rows


def _derivative(P_e: SparseSymmetric, linear: LinearRows, rate: Fraction) -> SparseSymmetric:
    """P_e A + A'P_e + 2 rate P_e."""
    entries: Entries = {}
    if rate:
        entries = {place: 2 * rate * value for place, value in P_e.entries.items()}
    for k, weights in enumerate(P_e.rows()):
        for j, a in linear[k].items():
            for i, p in weights.items():  # P_e[i, k] A[k, j], and its transpose
                add(entries, i, j, 2 * p * a if i == j else p * a)
    return SparseSymmetric(P_e.size, entries)


def _sandwich(P_e: SparseSymmetric, inner: Entries) -> SparseSymmetric:
    """P_e N P_e for a sparse symmetric N."""
    size = P_e.size
    # A full P_e is multiplied as a whole, a diagonal one entry by entry.
    if len(P_e.entries) > 4 * size:
        dense = P_e.to_dense()
        product = multiply(multiply(dense, SparseSymmetric(size, inner).to_dense()), dense)
        upper = {(i, j): product[i][j] for i in range(size) for j in range(i, size)}
        return SparseSymmetric(size, upper)
    entries: Entries = {}
    rows = P_e.rows()
    for (k, l), value in inner.items():  # noqa: E741  k, l as in matrix entries
        for left, right in {(k, l), (l, k)}:
            for i, p in rows[left].items():
                for j, q in rows[right].items():
                    if i <= j:
                        add(entries, i, j, p * value * q)
    return SparseSymmetric(size, entries)


def _without_target(entries: Entries, size: int) -> Entries:
    """The entries without the row and column of the target, whose error is 0."""
    return {places: value for places, value in entries.items() if size not in places}


def _rank_two(row: Mapping[int, Fraction], channel: Channel, size: int) -> Entries:
    """P_e b c' + c b'P_e, where ``row`` is the row of P_e at the channel's target."""
    # c has 1 at plus and -1 at minus; on the diagonal both terms fall on the same entry.
    entries: Entries = {}
    for i, p in row.items():
        for place, x in ((channel.plus, p), (channel.minus, -p)):
            add(entries, i, place, 2 * x if i == place else x)
    return _without_target(entries, size)


def _observer_block(loop: Loop, S: Matrix | None) -> Entries:
    """I (x) S; where agents have different exosystems, the block of each agent's group."""
    entries: Entries = {}
    if S is None:
        return entries
    m = loop.m
    for agent, block in enumerate(agent_blocks(S, loop.groups, loop.labels)):
        for i in range(m):
            for j in range(i, m):
                if block[i][j]:
                    entries[agent * m + i, agent * m + j] = block[i][j]
    return entries
