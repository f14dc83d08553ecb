"""Lemma 1 and Theorems 1 and 2 of the paper, stated once, for any enclosed Jacobians.

    Lambda(J) = J + J' - (K + K')                                            (10), twice F
    Omega0    = P A + A' P - C'Q' - Q C
    Psi(J)    = [[Lambda(J), I (x) C], [(I (x) C)', I (x) Omega0]] < 0       (18), (28)

With a rate beta > 0, 2 beta diag(I, I (x) P) is added, and V' <= -2 beta V follows.  Unknowns are P
(symmetric, q x q) and Q (q x m); W = P^-1 Q.  Lemma 1 is Lambda < 0 and has no unknowns.

dh/de is enclosed arc by arc (11) at the consensus, where each gain is h'(0) of the arc: a point
when it is rational, else a narrow outward interval; that of an optional arc lies between 0 and
that.  Lambda of a large network is stated in arrays of integers: slopes are exact where a common
denominator of 512 bits holds them all; others become the nearest float with a deviation that
reaches over their whole enclosure.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._checks import noun
from dobc_design.conditions.check import Check, Claim
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Domain
from dobc_design.conditions.numbers import (
    doubles_to_json,
    fields_to_json,
    known_to_json,
    matrix_from_json,
    read_rational,
)
from dobc_design.conditions.reason import gap_obstacle
from dobc_design.errors import SpecError
from dobc_design.exact import symmetric as sparse
from dobc_design.exact.interval import Interval, IntervalMatrix, UndefinedError
from dobc_design.exact.matrix import Array, Matrix, add, multiply, scale, transpose
from dobc_design.exact.number import ZERO, common_denominator
from dobc_design.exact.pencil import Deviation, Pencil, Place, Unknown
from dobc_design.exact.reading import Document, is_scalar_matrix
from dobc_design.exact.symmetric import Entries, Places, SparseSymmetric, as_integers
from dobc_design.loop.arcs import arc_table
from dobc_design.loop.loop import Loop, Pins, pins_of
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import group_numbers
from dobc_design.problem.network import Arcs

Triplets = tuple[Places, Places, sparse.Integers]

#: Rows n m, and arcs times m^2, beyond which Lambda is stated in arrays.
LARGE_ROWS = 2000
LARGE_ENTRIES = 20_000


@noun(eq=False)
class ModeJacobian:
    """dh/de of one mode: J has +gain at block (listener, speaker) and -gain at (listener,
    listener). ``gains[kind[a]]`` is the m x m gain of arc a, weight included; arcs that are alike
    share it.  ``arcs`` are those between free nodes: what fixed nodes add, like pins, is in
    ``pulls``, the K of this mode."""

    name: str
    arcs: Arcs
    kind: NDArray[np.int64]
    gains: tuple[IntervalMatrix, ...]
    pulls: Pins

    def entries(self) -> Iterator[Interval]:
        """The entries of all gains, row by row."""
        for gain in self.gains:
            for row in gain:
                yield from row

    @property
    def is_point(self) -> bool:
        """Whether every gain is a single rational matrix."""
        return all(entry.is_point for entry in self.entries())

    @property
    def is_nonnegative_diagonal(self) -> bool:
        """Whether every gain is diagonal and >= 0: then -Lambda is a Z-matrix and J - K cannot be
        unstable."""
        for gain in self.gains:
            for i, row in enumerate(gain):
                if row[i].lo < 0:
                    return False
                beside = (*row[:i], *row[i + 1 :])
                if any(entry.lo != 0 or entry.hi != 0 for entry in beside):
                    return False
        return True


@noun(eq=False)
class Jacobians:
    """The Jacobians of every mode on one domain ("consensus", or "global" for linear couplings)."""

    domain: Domain
    size: int  # n
    dimension: int  # m
    modes: tuple[ModeJacobian, ...]


def jacobians_at_consensus(loop: Loop) -> Jacobians:
    """Enclose J(0) of every mode.  For linear couplings J does not depend on e, so the domain is
    EVERYWHERE. Raises: exact.interval.UndefinedError if a coupling has no derivative at 0."""
    slopes = [coupling.jacobian_at_zero() for coupling in loop.functions]
    modes = [_mode_jacobian(loop, name, slopes) for name in loop.modes]
    domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
    return Jacobians(domain=domain, size=loop.n, dimension=loop.m, modes=tuple(modes))


def _mode_jacobian(loop: Loop, name: str, slopes: Sequence[IntervalMatrix]) -> ModeJacobian:
    """The Jacobian of one mode, from the slopes at 0 of every coupling."""
    arcs = loop.modes[name]
    table = arc_table(loop, name)
    width = max(1, len(table.weights))
    # Arcs of the same coupling and weight share a gain: one number says which they are.
    numbers = (table.coupling * width + table.weight) * 2 + arcs.uncertain
    different, kinds = np.unique(numbers, return_inverse=True)
    kinds.setflags(write=False)
    gains: list[IntervalMatrix] = []
    for number in different.tolist():
        pair, loose = divmod(number, 2)
        coupling, place = divmod(pair, width)
        weight = table.weights[place]
        ends = (ZERO if loose else weight, weight)
        size = Interval(min(ends), max(ends))
        gains.append(tuple(tuple(entry * size for entry in row) for row in slopes[coupling]))
    made = partial(ModeJacobian, name=name, gains=tuple(gains))
    free = arcs.speakers < loop.n
    # |w| h'(0) (-e_j - e_i) is w h'(0) (e_j - e_i) and a pull by 2 |w| h'(0).
    opposes = arcs.opposes if loop.signed else ~free
    own = opposes | ~free
    if not own.any():
        return made(arcs=arcs, kind=kinds, pulls=loop.pulls)
    held = dict(loop.pulls.gains)
    factors = np.where(opposes & free, -2, 1)[own].tolist()
    found = zip(arcs.listeners[own].tolist(), kinds[own].tolist(), factors, strict=True)
    for node, kind, factor in found:
        pull = scale(factor, _point(gains[kind], loop.labels[node]))
        held[node] = add(held[node], pull) if node in held else pull
    return made(arcs=arcs.where(free), kind=kinds[free], pulls=pins_of(held))


def _point(gain: IntervalMatrix, label: str) -> Matrix:
    """The gain of an arc to a fixed node, as a matrix.  Raises: UndefinedError where it is only
    enclosed, or comes and goes."""
    if not all(entry.is_point for row in gain for entry in row):
        raise UndefinedError(
            f"agent {label} hears a fixed node, or opposes another one, by a slope that is not one "
            "rational number"
        )
    return tuple(tuple(entry.lo for entry in row) for row in gain)


@noun(eq=False)
class Deviations(Sequence[Deviation]):
    """Deviations of very many arcs: number a stands at rows[a], speakers[a], listeners[a] and has
    sizes[kinds[a]]."""

    rows: Places
    speakers: Places
    listeners: Places
    kinds: Places
    sizes: tuple[Fraction, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        row = int(self.rows[place])
        speaker = int(self.speakers[place])
        listener = int(self.listeners[place])
        return Deviation(row, speaker, listener, self.sizes[int(self.kinds[place])])


def lemma1_in_arrays(jacobian: ModeJacobian, *, size: int, dimension: int) -> Pencil | None:
    """``lemma1`` with an IntegerSymmetric; None if the gains have no common denominator of 512
    bits."""
    pulls = jacobian.pulls
    # Agents often share one matrix, which is added to its transpose once.
    held = {id(k): add(k, transpose(k)) for k in pulls.gains.values()}
    numbers = (x for rows in held.values() for row in rows for x in row)
    below = common_denominator(numbers, bits=sparse.DENOMINATOR_BITS)
    if below is None:
        return None
    entries = list(jacobian.entries())
    points = (entry.lo for entry in entries if entry.is_point)
    # Exact slopes stay exact only where one denominator holds them all.
    exact = common_denominator(points, bits=sparse.DENOMINATOR_BITS, start=below) is not None
    middles = np.array([_middle(entry, exact) for entry in entries], dtype=object)
    # A middle may be rounded, so the enclosure reaches differently far on its two sides.
    spreads = [max(entry.hi - x, x - entry.lo) for entry, x in zip(entries, middles, strict=True)]
    common = math.lcm(below, *{x.denominator for x in middles})
    whole = (middles * common).reshape(-1, dimension, dimension)
    nothing = np.zeros(0, dtype=np.int64)
    parts = [
        (nothing, nothing, nothing),
        *_pin_triplets(pulls, held, common, dimension),
        *_arc_triplets(jacobian, whole, dimension),
    ]
    rows, columns, values = map(np.concatenate, zip(*parts, strict=True))
    constant = sparse.IntegerSymmetric(
        size=size * dimension, rows=rows, columns=columns, values=values, denominator=common
    )
    return Pencil(
        name=f"lemma1 ({jacobian.name})",
        constant=constant,
        unknowns=(),
        coefficients={},
        deviations=_deviations(jacobian, spreads, dimension),
    )


def _middle(entry: Interval, exact: bool) -> Fraction:
    """The middle of a gain; exact ones are kept if that costs no long denominator."""
    middle = entry.midpoint
    if exact and entry.is_point:
        return middle
    try:
        return Fraction(float(middle))
    except OverflowError:  # beyond the floats
        return middle


def _pin_triplets(
    pulls: Pins, held: Mapping[int, Sequence[Sequence[Fraction]]], common: int, dimension: int
) -> Iterable[Triplets]:
    """-(K + K'), on and above the diagonal."""
    # A table of different gains, and for each agent its place there.
    count = len(pulls.gains)
    agents = np.fromiter(pulls.gains, dtype=np.int64, count=count) * dimension
    numbers = {key: number for number, key in enumerate(held)}
    own = (numbers[id(k)] for k in pulls.gains.values())
    kind = np.fromiter(own, dtype=np.int64, count=count)
    for c in range(dimension):
        for d in range(c, dimension):
            table = as_integers([int(-common * rows[c][d]) for rows in held.values()])
            if table.any():
                yield agents + c, agents + d, table[kind]


def _arc_triplets(
    jacobian: ModeJacobian, whole: NDArray[Any], dimension: int
) -> Iterable[Triplets]:
    """J + J' of every arc, on and above the diagonal: the slope at (row, speaker), minus it at
    (row, listener)."""
    listeners = jacobian.arcs.listeners * dimension
    speakers = jacobian.arcs.speakers * dimension
    for c, d in np.ndindex(dimension, dimension):
        slopes = [int(x) for x in whole[:, c, d]]
        if not any(slopes):
            continue
        row = listeners + c
        off = speakers + d
        values = as_integers(slopes)[jacobian.kind]
        yield np.minimum(row, off), np.maximum(row, off), values
        # On the diagonal a slope and its transpose fall on the same entry.
        own = listeners + d
        minus = as_integers([-2 * x if c == d else -x for x in slopes])[jacobian.kind]
        yield np.minimum(row, own), np.maximum(row, own), minus


def _deviations(
    jacobian: ModeJacobian, spreads: Sequence[Fraction], dimension: int
) -> Sequence[Deviation]:
    """What the slopes may differ by from their middles, arc by arc; none where all are exact."""
    entries = dimension**2
    found = []
    for c, d in np.ndindex(dimension, dimension):
        place = c * dimension + d
        # Only slopes that are not known exactly.
        wide = np.array([bool(x) for x in spreads[place::entries]], dtype=bool)
        chosen = wide[jacobian.kind]
        hearers = jacobian.arcs.listeners[chosen] * dimension
        speakers = jacobian.arcs.speakers[chosen] * dimension + d
        kinds = jacobian.kind[chosen] * entries + place
        found.append([hearers + c, speakers, hearers + d, kinds])
    rows, speakers, listeners, kinds = np.concatenate(found, axis=1)
    if not len(rows):
        return ()
    return Deviations(
        rows=rows, speakers=speakers, listeners=listeners, kinds=kinds, sizes=tuple(spreads)
    )


def linearisation(jacobian: ModeJacobian, dimension: int) -> Entries:
    """The entries of J - K of one mode, with the middle of a slope that is not rational."""
    entries: Entries = {}

    # Several arcs may fall on the same entry.
    def put(agent: int, other: int, c: int, d: int, value: Fraction) -> None:
        place = agent * dimension + c, other * dimension + d
        entries[place] = entries.get(place, ZERO) + value

    middles = [[[entry.midpoint for entry in row] for row in gain] for gain in jacobian.gains]
    for (listener, speaker, _), kind in zip(jacobian.arcs, jacobian.kind.tolist(), strict=True):
        for c, row in enumerate(middles[kind]):
            for d, slope in enumerate(row):
                if slope:
                    put(listener, speaker, c, d, slope)
                    put(listener, listener, c, d, -slope)
    for agent, k in jacobian.pulls.gains.items():
        for c, row in enumerate(k):
            for d, x in enumerate(row):
                put(agent, agent, c, d, -x)
    return entries


def lemma1(jacobian: ModeJacobian, *, size: int, dimension: int) -> Pencil:
    """Lambda(J) = J + J' - (K + K') < 0: Lemma 1, eq. (10) without its factor 1/2.  Size: n m.  No
    unknowns."""
    if size * dimension > LARGE_ROWS or len(jacobian.arcs) * dimension**2 > LARGE_ENTRIES:
        lean = lemma1_in_arrays(jacobian, size=size, dimension=dimension)
        if lean is not None:
            return lean
    entries: Entries = {}
    for (i, j), value in linearisation(jacobian, dimension).items():
        add_to(entries, i, j, 2 * value if i == j else value)
    halves = [entry.width / 2 for entry in jacobian.entries()]
    return Pencil(
        name=f"lemma1 ({jacobian.name})",
        constant=SparseSymmetric(size * dimension, entries),
        unknowns=(),
        coefficients={},
        deviations=tuple(_deviations(jacobian, halves, dimension)),
    )


def theorem1(
    lambda_: Pencil,
    systems: Mapping[str, Exosystem],
    numbers: Sequence[int],
    *,
    rate: Fraction,
) -> Pencil:
    """Psi of eq. (18), n m rows and a block per agent, from Lambda, the exosystems and each agent's
    number among them. Unknowns: P and Q of each, by its name: "P[1]", "Q[1]".  ``rate`` (1/s) adds
    2 rate diag(I, I (x) P).  An agent without a disturbance has the number ``len(systems)``, and no
    block."""
    known = list(systems.values())
    m = known[0].outputs
    entries: Entries = dict(lambda_.constant.entries)
    size = len(numbers) * m
    if rate:
        for i in range(size):  # the errors of the agents; those of observers come with P below
            add_to(entries, i, i, 2 * rate)
    starts: list[list[int]] = [[] for _ in known]  # where the blocks of the agents begin
    for agent, number in enumerate(numbers):
        if number == len(known):
            continue
        starts[number].append(size)
        for c, row in enumerate(known[number].C):
            entries |= {(agent * m + c, size + k): x for k, x in enumerate(row) if x}
        size += known[number].order
    unknowns: list[Unknown] = []
    coefficients: dict[Place, SparseSymmetric] = {}
    for (name, exosystem), own in zip(systems.items(), starts, strict=True):
        for unknown in _unknowns(name, exosystem.order, m):
            unknowns.append(unknown)
            for place in unknown.places():
                # The same block for every agent of this exosystem.
                of_one = unknown.name[0], place[1], place[2]
                block = omega_coefficient(exosystem, of_one, rate=rate)
                values = {(start + i, start + j): x for start in own for (i, j), x in block.items()}
                coefficients[place] = SparseSymmetric(size, values)
    return Pencil(
        name=lambda_.name.replace("lemma1", "theorem1"),
        constant=SparseSymmetric(size, entries),
        unknowns=tuple(unknowns),
        coefficients=coefficients,
        deviations=lambda_.deviations,
    )


def _unknowns(name: str, q: int, m: int) -> tuple[Unknown, Unknown]:
    """P and Q of one exosystem, with its name in brackets where it has one."""
    mark = f"[{name}]" if name else ""
    return (
        Unknown(name=f"P{mark}", rows=q, columns=q, symmetric=True),
        Unknown(name=f"Q{mark}", rows=q, columns=m, symmetric=False),
    )


def reduced(bound: Fraction, exosystem: Exosystem, *, rate: Fraction = ZERO) -> Pencil:
    """The same for one agent with Lambda = bound I (theory, Reduction), bound = max
    lambda_max(Lambda) over the modes: equivalent to Theorem 2 when m = 1 or Lambda = Lambda_n (x)
    I_m, sufficient in general.  Size: m + q."""
    m = exosystem.outputs
    diagonal = SparseSymmetric(m, {(i, i): bound for i in range(m)})
    one = Pencil(name="reduced", constant=diagonal, unknowns=(), coefficients={})
    return theorem1(one, {"": exosystem}, [0], rate=rate)


def omega_coefficient(exosystem: Exosystem, place: Place, *, rate: Fraction) -> Entries:
    """What one entry of P or Q contributes to Omega0 + 2 rate P = X + X' (upper triangle, q x
    q)."""
    name, k, l = place  # noqa: E741  k, l as in matrix entries
    terms: list[tuple[int, int, Fraction]] = []
    if name == "P":  # X = E (A + rate I)
        for r, s in {(k, l), (l, k)}:
            terms += [(r, j, x + rate * (s == j)) for j, x in enumerate(exosystem.A[s])]
    else:  # X = -E C
        terms += [(k, j, -x) for j, x in enumerate(exosystem.C[l])]
    entries: Entries = {}
    for i, j, x in terms:
        add_to(entries, i, j, 2 * x if i == j else x)
    return {where: value for where, value in entries.items() if value}


def omega(P: Matrix, Q: Matrix, exosystem: Exosystem, *, rate: Fraction = ZERO) -> SparseSymmetric:
    """Omega0 + 2 rate P at rational P = P', Q: the block every agent has."""
    q = exosystem.order
    PA = multiply(P, exosystem.A)
    QC = multiply(Q, exosystem.C)
    X = [[PA[i][j] - QC[i][j] + rate * P[i][j] for j in range(q)] for i in range(q)]
    return SparseSymmetric(q, {(i, j): X[i][j] + X[j][i] for i in range(q) for j in range(i, q)})


def add_to(entries: Entries, i: int, j: int, value: Fraction) -> None:
    """Add to the entry (i, j) of a symmetric matrix, kept in its upper triangle."""
    if value:
        where = (i, j) if i <= j else (j, i)
        entries[where] = entries.get(where, ZERO) + value


def with_gain(pencil: Pencil, W: Matrix) -> Pencil:
    """The pencil with Q = P W put in: P is the only unknown left.  Shape: W (q, m)."""
    P, Q = pencil.unknowns
    coefficients: dict[Place, SparseSymmetric] = {}
    for place in P.places():
        _, k, l = place  # noqa: E741
        total = pencil.coefficients[place]
        # Both entries of a symmetric P that this unknown stands for.
        for row, other in {(k, l), (l, k)}:  # P_row,other stands in row `row` of P W
            for j, w in enumerate(W[other][: Q.columns]):
                if w:
                    total = total + pencil.coefficients["Q", row, j].scaled(w)
        coefficients[place] = total
    return replace(pencil, unknowns=(P,), coefficients=coefficients)


@noun(eq=False)
class Shown:
    """lambda_max(Lambda) <= bound, proved by the vector v > 0 (n m,) of floats; 1/s."""

    vector: Array
    bound: Fraction

    def to_json(self) -> Document:
        """The exact values of Lemma 1, proved for a large network."""
        return {"v": doubles_to_json(self.vector)}


@noun
class Unstable:
    """Of a refuted Lemma 1: a lower bound of the eigenvalues of J - K with positive real part, and
    perhaps v'Lambda v.  ``value``: a lower bound of v'Lambda v for the vector v of the witness;
    None where it is not rational."""

    roots: int
    value: Fraction | None = None

    def to_json(self) -> Document:
        """The exact values."""
        return known_to_json(self, "value") | {"unstable_roots": str(self.roots)}


@noun
class Pair:
    """A proposed pair (P, Q) with W = P^-1 Q.  Shapes: P (q, q) symmetric, Q (q, m).  Where agents
    have different exosystems, here and below: block diagonal, for the joint one
    (``problem.groups``)."""

    P: Matrix
    Q: Matrix


@noun
class PairFacts:
    """What a decided pair says exactly, with S = C (-Omega0)^-1 C' (m, m), and the ``mode`` in
    which it fails."""

    pair: Pair
    S: Matrix
    mode: str | None = None

    @property
    def bound(self) -> Fraction | None:
        """What lambda_max(Lambda) must stay below, where S = s I: the number -s."""
        return -self.S[0][0] if is_scalar_matrix(self.S) else None

    def to_json(self) -> Document:
        """The exact values."""
        return fields_to_json(self.pair, "P", "Q") | known_to_json(self, "S", "bound", "mode")


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Claim | None:
    """What Lemma 1 or a theorem claims; problem and gain are not needed."""
    exact = check.exact or {}
    if "unstable_roots" in exact:
        roots = read_rational(exact["unstable_roots"])
        if roots.denominator != 1 or roots < 0 or not {"unstable_roots", "value"} >= set(exact):
            raise ValueError("unstable_roots must be a whole number >= 0, with a value or alone")
        value = read_rational(exact["value"]) if "value" in exact else None
        return Unstable(roots=int(roots), value=value)
    if "P" in exact:
        P, Q, S = (matrix_from_json(exact[name]) for name in "PQS")
        return PairFacts(pair=Pair(P=P, Q=Q), S=S, mode=exact.get("mode"))
    return check.claim


@noun(eq=False)
class Statements:
    """The conditions of one problem.  ``lambdas``: mode -> Lambda(J), without unknowns; empty where
    the couplings are ``inapplicable``, not C1, for that reason.  ``shown``: what a vector has
    proved about Lambda of large networks."""

    loop: Loop
    domain: Domain
    jacobians: Jacobians | None
    lambdas: Mapping[str, Pencil]
    inapplicable: str | None
    shown: Mapping[str, Shown] = field(default_factory=dict)

    @property
    def where(self) -> str:
        """The starts for which slopes at the target decide, in words."""
        if self.domain == EVERYWHERE:
            return "everywhere (the couplings are linear)"
        return "near the target"

    def psi(self, *, rate: Fraction = ZERO) -> tuple[Pencil, ...]:
        """Psi of every mode, (28), with shared unknowns.  Raises: SpecError without an
        exosystem."""
        groups = self.loop.groups
        if not groups:
            raise SpecError(
                "Psi of (18) needs an [exosystem].",
                key="exosystem",
                cure="Without one, Lemma 1 is the condition.",
            )
        # A single exosystem has no name: its unknowns are P and Q.
        if self.loop.is_grouped:
            systems = {group.name: group.exosystem for group in groups}
        else:
            systems = {"": groups[0].exosystem}
        numbers = group_numbers(groups, self.loop.labels)
        return tuple(theorem1(each, systems, numbers, rate=rate) for each in self.lambdas.values())


def state_theorems(loop: Loop) -> Statements:
    """State Lemma 1, Theorem 1 and Theorem 2 for ``problem`` at the consensus."""
    jacobians = None
    domain: Domain = NEAR_TARGET
    reason = _why_inapplicable(loop)
    smooth = not any(coupling.nonsmooth for coupling in loop.functions)
    # Eigenvalues of differences ask for the slopes, too.
    if reason is None or (smooth and (loop.agrees or loop.gap or loop.is_sampled)):
        try:
            jacobians = jacobians_at_consensus(loop)
        except UndefinedError as error:
            # An arc that comes and goes may have no one slope where nothing is curved.
            domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
            reason = (
                "does not apply: the coupling has no bounded derivative at the consensus "
                f"({error})."
            )
    lambdas: dict[str, Pencil] = {}
    if jacobians is not None:
        domain = jacobians.domain
        for mode in jacobians.modes:
            lambdas[mode.name] = lemma1(mode, size=loop.n, dimension=loop.m)
    return Statements(
        loop=loop, domain=domain, jacobians=jacobians, lambdas=lambdas, inapplicable=reason
    )


def _why_inapplicable(loop: Loop) -> str | None:
    """Why slopes at the target decide nothing; None where they may."""
    if loop.agrees:
        return "does not apply: it is about a target, and agents agree without one."
    if loop.gap:
        return gap_obstacle(loop)
    if loop.is_sampled:
        return "does not apply: everything is computed from samples and held; see readings."
    if loop.slopes_move:
        return "does not apply: the leader moves, and the slopes of f that it needs change with it."
    # The theorems ask for a derivative on a neighbourhood, not only at the consensus.
    kinked = next((coupling for coupling in loop.functions if coupling.nonsmooth), None)
    if kinked is None:
        return None
    return (
        f'does not apply: h = "{kinked.texts[0]}" uses {", ".join(kinked.nonsmooth)}; '
        "Lemma 1 and both theorems are for continuously differentiable couplings, and that is "
        "not shown here; use a smooth one, such as tanh for clip."
    )
