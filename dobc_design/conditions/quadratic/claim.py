"""Theorems 1 and 2 over a region: V = e'P_e e + sum eps_i'P eps_i and the inequalities that make it
decrease there.

Theory, section 4 (circle criterion, S-procedure), after the Schur complements that leave n m rows.
For channels with gains in [low, high], g0 = (low + high)/2, d = (high - low)/2, A0 = -K + sum g0 b
c', multipliers tau > 0 where d > 0, S = C (-Omega0 - 2 beta P)^-1 C', the inequality of one mode is

    P_e A0 + A0'P_e + 2 beta P_e + P_e (I (x) S + sum b b'/(2 tau)) P_e + sum 2 tau d^2 c c' < 0

which equals the block inequality of theory for any low, high, and takes linear channels (d = 0) as
they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from types import MappingProxyType
from typing import Final, Literal

from dobc_design._checks import noun
from dobc_design.conditions.numbers import as_json, fields_to_json, form_from_json, known_to_json
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import (
    Matrix,
    add,
    is_symmetric,
    multiply,
    scale,
    transpose,
    zeros,
)
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.loop import Loop
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.groups import agent_blocks

from .sectors import GainRange, Sectors

Shape = Literal["diagonal", "full"]
METHOD: Final = "lure"  # in files, which had others once


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

    def to_json(self) -> Document:
        return fields_to_json(self, "level", "rate") | known_to_json(self, "P")


@noun
class Lure(Quadratic):
    """One with bounded gains.  ``radius`` bounds |e_j - e_i| by component, ``ranges`` are the gains
    there (None: everywhere).  ``multipliers``: mode -> one tau per channel, 0 where it is linear.
    """

    ranges: tuple[GainRange, ...]
    radius: Fraction | None
    multipliers: Mapping[str, tuple[Fraction, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", MappingProxyType(dict(self.multipliers)))
        signs = "rate must be >= 0 and level > 0."
        if self.rate < 0:
            raise SpecError(signs, key="rate")
        if self.level is not None and self.level <= 0:
            raise SpecError(signs, key="level")
        if (self.P is None) is not (self.Q is None):
            raise ShapeError("P and Q must both be given, or neither.", key="P")

    @property
    def shape(self) -> Shape:
        return "diagonal" if self.P_e.is_diagonal else "full"

    def to_json(self) -> Document:
        entries = [[*place, value] for place, value in sorted(self.P_e.entries.items())]
        values = {"method": METHOD, "P_e": as_json(entries)}
        values |= fields_to_json(self, "level", "radius", "ranges", "multipliers", "rate")
        return values | known_to_json(self, "P")


def observed_in(loop: Loop) -> Document:
    """The shape of the observer's part (``read_parts``)."""
    return {"P": form_from_json} if loop.groups else {}


def observer_of(values: Document, loop: Loop, W: Matrix | None) -> Document:
    """The same values with the observer's pair (P, P W), where there is one.  Raises: ValueError
    for a P that is none."""
    if loop.groups:
        P = values["P"]
        if [len(row) for row in P] != [loop.q] * loop.q or not is_symmetric(P):
            raise ValueError(f"P must be a symmetric matrix of {loop.q} rows")
        values["Q"] = None if W is None else multiply(P, W)
    return values


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
    loop = sectors.loop
    nothing = zeros(loop.m, loop.m)
    pins = block_diagonal([loop.pulls.gains.get(i, nothing) for i in range(loop.n)])
    blocks = [nothing] * loop.n if S is None else agent_blocks(S, loop.groups, loop.labels)
    # A0, what stands between P_e, and sum 2 tau d^2 c c', with rows and columns for the target,
    # whose error is 0.
    given = (scale(-1, pins), block_diagonal(blocks), ())
    linear, inner, added = (_rows_of(each, size + 1) for each in given)
    for channel, tau in zip(channels, multipliers, strict=True):
        b, plus, minus = channel.target, channel.plus, channel.minus
        linear[b][plus] += channel.centre
        linear[b][minus] -= channel.centre
        if not channel.spread:  # a linear channel is in A0 already
            continue
        if tau <= 0:
            raise ShapeError(
                f"mode {mode}: multipliers must be > 0 where the gain has a range.",
                key="multipliers",
            )
        inner[b][b] += 1 / (2 * tau)
        weight = 2 * tau * channel.spread**2
        added[plus][plus] += weight
        added[minus][minus] += weight
        added[plus][minus] -= weight
        added[minus][plus] -= weight
    A, N, squares = (_first(size, each) for each in (linear, inner, added))
    P = P_e.to_dense()
    half = add(multiply(P, A), scale(rate, P))
    sandwich = multiply(multiply(P, N), P)
    return SparseSymmetric.from_dense(add(add(half, transpose(half)), add(sandwich, squares)))


def _rows_of(M: Matrix, size: int) -> list[list[Fraction]]:
    """The entries of a matrix, with zeros up to a size (size, size)."""
    rows = [[*row, *[ZERO] * (size - len(row))] for row in M]
    return rows + [[ZERO] * size for _ in range(size - len(M))]


def _first(size: int, rows: list[list[Fraction]]) -> Matrix:
    """The first rows and columns."""
    return tuple(tuple(row[:size]) for row in rows[:size])
