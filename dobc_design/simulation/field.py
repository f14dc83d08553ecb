"""The right-hand sides of the closed loop in NumPy: h(e) - K e of (9), arc by arc or for all at
once; C exp(F t).

h(e) is fast enough for a million agents and for thousands of runs, which are columns of the same
arrays: arcs are worked through in blocks that fit into the processor's cache, slot by slot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import expm

from dobc_design.coupling import tree
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.tree import NumpyAlgebra
from dobc_design.problem import arrays
from dobc_design.problem.arrays import ArcGroup, Array, Gain, Plant
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.network import IndexArray
from dobc_design.problem.problem import Problem

BLOCK = 1 << 15  # differences held at once: a quarter of a MiB per array
MOST_SLOTS = 32  # arcs of one agent up to which a block is worked through slot by slot
LARGEST_PRODUCT = 8  # exponents up to which a power is computed by multiplication


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """Some arcs of one coupling: ``rows`` listen to ``speakers`` (arcs,); ``factor``: a common
    weight, or (arcs,). ``slots``: begin and end of every slot, whose i-th arc ends at the i-th of
    ``rows``.  Without slots, for hubs, ``counts[i]`` arcs end at the i-th of ``rows``, and the
    matrix ``factor`` adds them."""

    h: Callable[[Array], Array]
    vector: bool  # whether h needs to see the m components of a difference together
    rows: slice | IndexArray
    speakers: IndexArray
    factor: float | Array | sp.csr_array
    slots: tuple[tuple[int, int], ...] = ()
    counts: IndexArray | None = None

    def add(self, total: Array, e: Array, m: int) -> None:
        """Add what the listeners feel; ``e`` and ``total`` have a row for every agent."""
        own = e[self.rows]
        y = e.take(self.speakers, axis=0)
        if self.counts is not None:
            y -= np.repeat(own, self.counts, axis=0)
        for begin, end in self.slots:
            y[begin:end] -= own[: end - begin]
        felt = self.h(y.reshape(len(y), m, -1)).reshape(y.shape) if self.vector else self.h(y)
        if isinstance(self.factor, sp.csr_array):
            total[self.rows] += self.factor @ felt
            return
        if isinstance(self.factor, np.ndarray):
            felt = felt * (self.factor if felt.ndim == 1 else self.factor[:, None])
        found = felt[: self.slots[0][1]].copy()
        for begin, end in self.slots[1:]:
            found[: end - begin] += felt[begin:end]
        if not isinstance(self.factor, np.ndarray) and self.factor != 1:
            found *= self.factor
        total[self.rows] += found


def _blocks(group: ArcGroup, size: int) -> Iterator[_Block]:
    """Cut the arcs of one coupling into blocks of about ``size``."""
    order = np.argsort(group.listeners, kind="stable")
    listeners, speakers, weights = (
        group.listeners[order],
        group.speakers[order],
        group.weights[order],
    )
    h, vector = compile_coupling(group.coupling), not group.coupling.by_component
    first = 0
    while first < len(listeners):
        last = min(first + size, len(listeners))
        # at the end of an agent's arcs, unless it has more than a block of them
        if last < len(listeners):
            end = int(np.searchsorted(listeners, listeners[last], side="left"))
            last = end if end > first else last
        ends, part = listeners[first:last], slice(first, last)
        lowest, rows = int(ends[0]), int(ends[-1] - ends[0]) + 1
        counts = np.bincount(ends - lowest, minlength=rows)
        if counts.max() > MOST_SLOTS:
            places = np.concatenate([[0], np.cumsum(counts)])
            gather = sp.csr_array(
                (weights[part], np.arange(len(ends)), places), shape=(rows, len(ends))
            )
            heard, span = speakers[part].copy(), slice(lowest, lowest + rows)
            yield _Block(
                h=h, vector=vector, rows=span, counts=counts, speakers=heard, factor=gather
            )
        else:
            yield _by_slots(h, vector, lowest, counts, speakers[part], weights[part])
        first = last


def _by_slots(
    h: Callable[[Array], Array],
    vector: bool,
    lowest: int,
    counts: IndexArray,
    speakers: IndexArray,
    weights: Array,
) -> _Block:
    """Order agents by their number of arcs, and the arcs by slots."""
    agents = np.argsort(-counts, kind="stable")
    begins = np.cumsum(counts) - counts
    having = [int(np.count_nonzero(counts > slot)) for slot in range(int(counts.max()))]
    arcs = np.concatenate([begins[agents[:many]] + slot for slot, many in enumerate(having)])
    edges = np.concatenate([[0], np.cumsum(having)]).tolist()
    listeners = lowest + agents[: having[0]]
    in_order = having[0] == len(counts) and bool((np.diff(agents) == 1).all())
    factor = weights[arcs] if (weights != weights[0]).any() else float(weights[0])
    rows = slice(lowest, lowest + len(counts)) if in_order else listeners
    return _Block(
        h=h,
        vector=vector,
        rows=rows,
        speakers=speakers[arcs],
        slots=tuple(pairwise(edges)),
        factor=factor,
    )


def hears(groups: Sequence[ArcGroup], n: int) -> sp.csr_array:
    """Mark who may influence whose derivative: neighbours, and every agent itself."""
    own = np.arange(n)
    rows = np.concatenate([own, *(group.listeners for group in groups)])
    columns = np.concatenate([own, *(group.speakers for group in groups)])
    marks: Any = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    return sp.csr_array(marks != 0).astype(np.float64)


class Links:
    """The arcs of one graph as in (9), evaluated arc by arc: every arc may hold an older value of
    its speaker."""

    def __init__(self, groups: Sequence[ArcGroup], n: int, m: int) -> None:
        self.groups, self.n, self.m = groups, n, m
        self.parts = [
            (compile_coupling(group.coupling), arrays.gathering_matrix(group, n))
            for group in groups
        ]
        ends: list[Any] = [
            np.zeros((2, 0), dtype=np.int64),
            *((group.listeners, group.speakers) for group in groups),
        ]
        self.listeners, self.speakers = np.concatenate(ends, axis=1)
        self.codes = self.listeners * n + self.speakers

    def felt(self, own: Array, heard: Array) -> Array:
        """Sum of h(heard - own) over the arcs of each listener; own (n, m, R), heard (arcs, m, R),
        nan if silent."""
        difference = heard - own[self.listeners]
        silent: Any = np.isnan(heard).any(axis=1)
        total = np.zeros_like(own)
        begin = 0
        for h, gather in self.parts:
            end = begin + gather.shape[1]
            value = np.array(h(difference[begin:end]))
            np.moveaxis(value, 1, -1)[silent[begin:end]] = 0.0
            total += (gather @ value.reshape(len(value), -1)).reshape(own.shape)
            begin = end
        return total


def compile_coupling(coupling: Coupling) -> Callable[[Array], Array]:
    """Return h as a function of differences y (arcs, m, ...), or of any shape where h acts by
    component."""
    programs = [tree.program(expression.node, _FastAlgebra()) for expression in coupling.components]
    if coupling.by_component:

        def by_component(y: Array) -> Array:
            value = np.asarray(tree.run(programs[0], (y,)))
            return value if value.shape == y.shape else np.broadcast_to(value, y.shape)

        return by_component

    def by_vector(y: Array) -> Array:
        variables = [y[:, c] for c in range(len(programs))]
        result = np.empty_like(y)
        for c, program in enumerate(programs):
            result[:, c] = tree.run(program, variables)
        return result

    return by_vector


class _FastAlgebra(NumpyAlgebra):
    """Small powers are products, and clip is one function: both take a fraction of the time."""

    def call(self, name: str, arguments: tuple[Array, ...]) -> Array:
        return np.asarray(np.clip(*arguments)) if name == "clip" else super().call(name, arguments)

    def power(self, base: Any, exponent: int) -> Any:
        if not 1 <= exponent <= LARGEST_PRODUCT:
            return base**exponent
        result, square, rest = None, base, exponent
        while rest:
            if rest & 1:
                result = square if result is None else result * square
            rest >>= 1
            square = square * square if rest else square
        return result


TERMS = 11  # (1/8)^11 / 11! < 2^-57: anchors are at most 1/(8 |F|) away
TERMS_OF_STEP = 20  # (1/4)^20 / 20! < 2^-100
MOST_ANCHORS = 100_000
MOST_NUMBERS = 1 << 24  # of the table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """What does not depend on the mode, as floats; A, C, F, W and ``own`` as in
    ``problem.arrays.Disturbance``.
    Shapes: A, F (q, q), C (m, q), W (q, m) or (n, q, m), K (n m, n m), goal (n, m), own (n, q); q
    may be 0.  Of agents with [dynamics] these are those of integrators with the same errors, and
    ``plant`` has their own; ``bend`` is f(goal + e) - f(goal) less its slopes at e = 0 for e (n, m,
    R), None where that is 0.  ``lead`` is s' of a leader s (m, R), whose m numbers follow those of
    e in what is integrated; ``bend`` is of s, too, then."""

    n: int
    m: int
    q: int
    A: Array
    C: Array
    F: Array
    W: Array
    K: sp.csr_array
    goal: Array
    own: NDArray[np.bool_] | None = None
    plant: Plant | None = None
    bend: Callable[..., Array] | None = None
    lead: Callable[[Array], Array] | None = None

    @property
    def rows(self) -> int:
        """How many numbers e takes, with those of a leader."""
        return self.m * (self.n + (self.lead is not None))

    @property
    def output(self) -> Array:
        """C of d = C xi, (p, q), p = m without [dynamics]."""
        return self.C if self.plant is None else self.plant.C

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """Cut states (..., n (m + 2 q)) into x (..., n, m), xi and z (..., n, q)."""
        x, xi, z = np.split(state, [self.n * self.m, self.n * (self.m + self.q)], axis=-1)
        lead = (*state.shape[:-1], self.n)
        return x.reshape(*lead, self.m), xi.reshape(*lead, self.q), z.reshape(*lead, self.q)

    def control(self, e: Array, dhat: Array) -> Array:
        """u of (19) for e (..., n, m) and dhat (..., n, p)."""
        K, u0 = (self.K, 0.0) if self.plant is None else (self.plant.K, self.plant.u0)
        return np.asarray(-(K @ e.reshape(-1, self.n * self.m).T).T.reshape(dhat.shape) - dhat + u0)

    def moved(self, u: Array, e: Array) -> Array:
        """What inputs u (n, p, R) and errors e (n, m, R) do to x without couplings and disturbance:
        A x + B u."""
        if self.plant is None:
            return u
        # A goal + B u0 = 0
        moved = act(self.plant.B, u - self.plant.u0[..., None]) + act(self.plant.A, e)
        return moved if self.bend is None else moved + self.bend(e)


def applied(gain: Array, y: Array) -> Array:
    """A gain (q, m) of all agents, or (n, q, m) one for each, times y (..., n, m): (..., n, q)."""
    return np.asarray(y @ gain.T if gain.ndim == 2 else np.einsum("iqm,...im->...iq", gain, y))


def act(matrix: Array, y: Array) -> Array:
    """A matrix (p, q) of all agents, or (n, p, q) one for each, times y (n, q, R): (n, p, R)."""
    return applied(matrix, y[..., 0])[..., None] if y.shape[2] == 1 else np.asarray(matrix @ y)


def make_loop(problem: Problem, gain: Gain | None) -> Loop:
    """Read the problem's numbers as floats.  Raises: SpecError without a W, or for a gain that does
    not fit."""
    problem = as_integrators(problem)
    plant = arrays.plant_arrays(problem.origin or problem)
    given: dict[str, Any] = asdict(arrays.disturbance_arrays(problem, gain)) | {
        "K": arrays.pinning_matrix(problem)
    }
    bend = lead = node = None
    if plant is not None and problem.node is not None:
        node, slopes = compile_coupling(problem.couplings[problem.node]), plant.A

        def bend(e: Array, s: Array | None = None) -> Array:
            moved = node(e) if s is None else node(s + e) - node(s[None])
            return np.asarray(moved - act(slopes, e))

    if plant is not None and problem.leader is not None:
        own, start = plant.A, arrays.leaders_drift(problem)

        def lead(s: Array) -> Array:
            return np.asarray(own @ s if node is None else node(s[None])[0]) + start[:, None]

    shape: dict[str, Any] = {
        "n": problem.n,
        "m": problem.m,
        "q": problem.q,
        "goal": arrays.goals(problem),
    }
    return Loop(**shape, plant=plant, bend=bend, lead=lead, **given)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """h(e) - K e of one graph: e' of (22) without the observer's error."""

    loop: Loop
    groups: Sequence[ArcGroup]
    blocks: tuple[_Block, ...]

    def __call__(self, e: Array) -> Array:
        """Return h(e) - K e in a new array; not finite where a coupling overflows or is undefined.
        Shapes: e (n m,) or (n m, R) with one column for each of R runs; rows agent by agent, then
        those of a leader."""
        n, m = self.loop.n, self.loop.m
        e, s = e[: n * m], e[n * m :]
        rows = np.ascontiguousarray(e).reshape((n, -1) if e.size > n else (n,))
        total = np.zeros_like(rows)
        for block in self.blocks:
            block.add(total, rows, self.loop.m)
        result = total.reshape(e.shape)
        result -= self.loop.K @ e
        if self.loop.bend is not None:
            led = [np.reshape(s, (m, -1))] if len(s) else []
            result += self.loop.bend(np.reshape(e, (n, m, -1)), *led).reshape(e.shape)
        if len(s) and self.loop.lead is not None:
            result = np.concatenate([result, self.loop.lead(s.reshape(m, -1)).reshape(s.shape)])
        return result


def network_of(loop: Loop, groups: Sequence[ArcGroup], *, runs: int = 1) -> Network:
    """h(e) - K e on arcs that are grouped by coupling."""
    size = max(1, BLOCK // (loop.m * runs))
    blocks = tuple(block for group in groups for block in _blocks(group, size))
    return Network(loop=loop, groups=groups, blocks=blocks)


def full_pattern(loop: Loop, groups: Sequence[ArcGroup]) -> sp.csr_array:
    """Who may influence whom: agents by neighbourhood, and all states of one agent among
    themselves."""
    m, q = loop.m, loop.q
    neighbours, own = hears(groups, loop.n), sp.eye_array(loop.n, format="csr")
    x_dot = [_block(neighbours, m, m), _block(own, m, q), _block(own, m, q)]
    rows = [
        x_dot,
        [None, _block(own, q, q), None],
        [_block(neighbours, q, m), None, _block(own, q, q)],
    ]
    return sp.block_array(rows, format="csr")


def errors_pattern(loop: Loop, groups: Sequence[ArcGroup], *, both: bool) -> sp.csr_array:
    """Who may influence whom in e, or in ``both`` [e; eps]."""
    own, alone = sp.eye_array(loop.n, format="csr"), _block(hears(groups, loop.n), loop.m, loop.m)
    if loop.lead is not None:
        alone = sp.block_array(
            [[alone, np.ones((loop.n * loop.m, loop.m))], [None, np.ones((loop.m,) * 2)]],
            format="csr",
        )
        return (
            sp.block_diag([alone, np.ones((loop.n * loop.q,) * 2)], format="csr") if both else alone
        )
    rows = [[alone, _block(own, loop.m, loop.q)], [None, _block(own, loop.q, loop.q)]]
    return sp.block_array(rows, format="csr") if both else alone


def _block(graph: sp.csr_array, rows: int, columns: int) -> sp.csr_array:
    return sp.kron(graph, np.ones((rows, columns)), format="csr")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """C exp(F t), (p, q), up to a horizon; ``table`` (TERMS, anchors, p q): scaled derivatives at
    the anchors."""

    F: Array
    C: Array
    spacing: float
    table: Array

    def at(self, time: float) -> Array:
        """C exp(F t), (p, q)."""
        number = min(round(time / self.spacing), self.table.shape[1] - 1)
        powers = (time - number * self.spacing) ** np.arange(TERMS)
        return np.asarray(powers @ self.table[:, number]).reshape(self.C.shape)

    def many(self, times: Array) -> Array:
        """C exp(F t) for an array of times: (p, q, *times.shape)."""
        flat = times.ravel()
        numbers = np.minimum(np.rint(flat / self.spacing).astype(np.int64), self.table.shape[1] - 1)
        offsets = (flat - numbers * self.spacing)[:, None]
        total = self.table[-1].take(numbers, axis=0)
        for term in self.table[-2::-1]:
            total *= offsets
            total += term.take(numbers, axis=0)
        return np.ascontiguousarray(total.T).reshape(*self.C.shape, *times.shape)


def make_closed_form(F: Array, C: Array, horizon: float) -> ClosedForm | None:
    """Prepare C exp(F t) up to ``horizon`` in s; None where |F| times the horizon is too large, or
    not finite."""
    if not (np.isfinite(F).all() and np.isfinite(C).all()):
        return None
    spacing = 1 / (4 * max(float(np.linalg.norm(F, 1)), 1e-6 / horizon))
    ratio = horizon / spacing
    if not ratio < min(MOST_ANCHORS, MOST_NUMBERS / (TERMS * C.size)):
        return None
    anchors = int(np.ceil(ratio)) + 1
    start = _powers(F, spacing, anchors)
    derivatives = [C]
    for k in range(1, TERMS):
        derivatives.append(derivatives[-1] @ F / k)
    with np.errstate(all="ignore"):
        table = np.stack([(each @ start).reshape(anchors, C.size) for each in derivatives])
    return ClosedForm(F=F, C=C, spacing=spacing, table=table) if np.isfinite(table).all() else None


def _powers(F: Array, spacing: float, count: int) -> Array:
    """exp(F spacing k), k < count, in extended precision: SciPy's expm alone is off by 1e-12 for |F
    t| of about 100."""
    with np.errstate(all="ignore"):
        small: Any = F.astype(np.longdouble) * np.longdouble(spacing)
        one: Any = np.eye(len(F), dtype=np.longdouble)
        term, step, powers = one, one, one[None]
        for k in range(1, TERMS_OF_STEP):
            term = term @ small / k
            step = step + term
        while len(powers) < count:
            powers = np.concatenate([powers, powers @ step])
            step = step @ step
        return np.asarray(powers[:count], dtype=np.float64)


def evolve(F: Array, start: Array, times: Array) -> Array:
    """exp(F t) applied to every row of ``start`` (n, q) at times (T,): (T, n, q); inf or nan beyond
    the floats."""
    if len(F) == 0:
        return np.zeros((len(times), *start.shape))
    closed = make_closed_form(F, np.eye(len(F)), float(times[-1])) if times[-1] > 0 else None
    powers = (
        expm(F[None] * times[:, None, None])
        if closed is None
        else np.moveaxis(closed.many(times), -1, 0)
    )
    return np.asarray(start[None] @ np.swapaxes(powers, 1, 2))
