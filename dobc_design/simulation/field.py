"""The right-hand sides of the closed loop in NumPy: h(e) - K e of (9), arc by arc or for all at
once.

h(e) is fast enough for a million agents and for thousands of runs, which are columns of the same
arrays: arcs are worked through in blocks that fit into the processor's cache.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import block_array, block_diag, csr_array, eye_array, kron

from dobc_design._checks import noun
from dobc_design.coupling import tree
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.tree import NumpyAlgebra
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Texts
from dobc_design.loop import arrays
from dobc_design.loop.arrays import ArcGroup, ArcGroups, Gain, Plant, Sensed
from dobc_design.loop.make import errors_of
from dobc_design.loop.matrices import pull_matrix
from dobc_design.problem.network import BoolArray, IndexArray
from dobc_design.problem.problem import Problem

from .fixed import FixedNodes
from .measures import disagreements
from .switches import drawn_graphs

ArrayFunction = Callable[[Array], Array]

BLOCK = 1 << 15  # differences held at once: a quarter of a MiB per array
LARGEST_PRODUCT = 8  # exponents up to which a power is computed by multiplication


class _FastAlgebra(NumpyAlgebra):
    """Small powers are products, and clip is one function: both take a fraction of the time."""

    def call(self, name: str, arguments: tuple[Array, ...]) -> Array:
        return np.asarray(np.clip(*arguments)) if name == "clip" else super().call(name, arguments)

    def power(self, base: Any, exponent: int) -> Any:
        in_range = 1 <= exponent <= LARGEST_PRODUCT
        return math.prod([base] * exponent) if in_range else base**exponent


def compile_coupling(coupling: Coupling) -> ArrayFunction:
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


def _of_rows(coupling: Coupling, m: int) -> ArrayFunction:
    """h of differences (arcs, ...): if it does not act by component, it needs to see the m
    components of each together."""
    h = compile_coupling(coupling)
    if coupling.by_component:
        return h
    return lambda y: h(y.reshape(len(y), m, -1)).reshape(y.shape)


@noun(eq=False)
class _Block:
    """Some arcs of one coupling: ``rows`` listen to ``speakers`` (arcs,), the i-th of them to
    ``counts[i]`` in turn; ``gather`` adds what they feel, weights included."""

    h: ArrayFunction
    rows: slice
    speakers: IndexArray
    counts: IndexArray
    gather: csr_array
    opposes: bool  # e of the speakers counts with the other sign

    def add(self, total: Array, e: Array) -> None:
        """Add what the listeners feel; ``e`` and ``total`` have a row for every agent."""
        # take is faster than an index here
        y = e.take(self.speakers, axis=0)
        if self.opposes:
            np.negative(y, out=y)
        # in place: these arrays are as large as the processor's cache allows
        y -= np.repeat(e[self.rows], self.counts, axis=0)
        total[self.rows] += self.gather @ self.h(y)


def _blocks(group: ArcGroup, size: int, m: int) -> Iterator[_Block]:
    """Cut the arcs of one coupling into blocks of about ``size``."""
    # so that the arcs of a listener stand together and are added once
    order = np.argsort(group.listeners, kind="stable")
    listeners = group.listeners[order]
    h = _of_rows(group.coupling, m)
    first = 0
    while first < len(order):
        last = min(first + size, len(order))
        # at the end of an agent's arcs, unless it has more than a block of them
        if last < len(order):
            end = int(np.searchsorted(listeners, listeners[last], side="left"))
            last = end if end > first else last
        yield _block_of(h, group.where(order[first:last]))
        first = last


def _block_of(h: ArrayFunction, arcs: ArcGroup) -> _Block:
    """One block of arcs that stand in the order of their listeners."""
    lowest = int(arcs.listeners[0])
    # how many agents each listener of the block hears
    counts = np.bincount(arcs.listeners - lowest)
    begins = np.concatenate([[0], np.cumsum(counts)])
    shape = (len(counts), len(arcs.speakers))
    return _Block(
        h=h,
        rows=slice(lowest, lowest + len(counts)),
        speakers=arcs.speakers,
        counts=counts,
        gather=csr_array((arcs.weights, np.arange(shape[1]), begins), shape=shape),
        opposes=arcs.opposes,
    )


class Links:
    """The arcs of one graph as in (9), evaluated arc by arc: every arc may hold an older value of
    its speaker."""

    def __init__(self, groups: ArcGroups, n: int) -> None:
        self.groups = groups
        self.parts = [
            (compile_coupling(group.coupling), arrays.gathering_matrix(group, n))
            for group in groups
        ]
        none = np.zeros(0, dtype=np.int64)
        self.listeners = np.concatenate([none, *(group.listeners for group in groups)])
        self.speakers = np.concatenate([none, *(group.speakers for group in groups)])
        self.codes = self.listeners * n + self.speakers
        opposed = [np.full(len(group.weights), group.opposes) for group in groups]
        self.opposed = np.flatnonzero(np.concatenate([none, *opposed]))

    def felt(self, own: Array, heard: Array) -> Array:
        """Sum of h(heard - own) over the arcs of each listener; own (n, m, R), heard (arcs, m, R),
        nan if silent."""
        if len(self.opposed):
            heard = heard.copy()
            heard[self.opposed] *= -1
        difference = heard - own[self.listeners]
        # a vanished agent: its arcs are not there
        silent: Any = np.isnan(heard).any(axis=1)
        total = np.zeros_like(own)
        begin = 0
        for h, gather in self.parts:
            end = begin + gather.shape[1]
            value = np.array(h(difference[begin:end]))
            by_run = value.swapaxes(1, 2)
            by_run[silent[begin:end]] = 0.0
            summed = gather @ value.reshape(len(value), -1)
            total += summed.reshape(own.shape)
            begin = end
        return total


class Active(NamedTuple):
    """Mode ``names[modes[k]]`` is on in the k-th row of errors."""

    names: Texts
    modes: IndexArray


@noun(eq=False)
class ClosedLoop:
    """What does not depend on the mode, as floats; A, C, F, W and ``own`` as in
    ``loop.arrays.Disturbance``.
    Shapes: A, F (q, q), C (m, q), W (q, m) or (n, q, m), K (n m, n m), goal (n, m), own (n, q); q
    may be 0.  They are those of the error system (``loop.loop.Loop``), and ``plant`` has those of
    agents with [dynamics]; ``bend`` is f(goal + e) - f(goal) less its slopes at e = 0 for e (n, m,
    R), None where that is 0.  ``lead`` is s' of a leader s (m, R), whose m numbers follow those of
    e in what is integrated; ``bend`` is of s, too, then.  ``pins``: further gains of single modes,
    (n p, n m)."""

    n: int
    m: int
    q: int
    A: Array
    C: Array
    F: Array
    W: Array
    K: csr_array
    goal: Array
    own: BoolArray | None = None
    plant: Plant | None = None
    bend: Callable[..., Array] | None = None
    lead: ArrayFunction | None = None
    fixed: int = 0  # nodes after the agents, whose error is 0 unless ``nodes`` has them
    nodes: FixedNodes | None = None
    sides: Array = field(default_factory=lambda: np.zeros(0))  # as those of a trajectory
    pins: Mapping[str, csr_array] = field(default_factory=dict)
    sensed: Sensed | None = None  # where outputs are measured
    steps: bool = False  # agents move from step to step, xi+ = A xi

    @property
    def size(self) -> int:
        """How many numbers e has, n m."""
        return self.n * self.m

    @property
    def rows(self) -> int:
        """How many numbers e takes, with those of a leader."""
        return self.size + self.m * (self.lead is not None)

    @property
    def moves(self) -> bool:
        """Whether fixed nodes move."""
        return self.nodes is not None and self.nodes.moves

    @property
    def slack(self) -> Array:
        """Errors so small are none, (m,)."""
        return np.zeros(self.m) if self.nodes is None else self.nodes.slack

    @property
    def output(self) -> Array:
        """C of d = C xi, (p, q), p = m without [dynamics]."""
        return self.C if self.plant is None else self.plant.C

    @property
    def of_xi(self) -> BoolArray | slice:
        """Which numbers of xi are those of an exosystem; the others are of x, where outputs are
        measured."""
        return slice(None) if self.sensed is None else np.all(self.sensed.x == 0, axis=0)

    @property
    def owned(self) -> Array:
        """1 where a number of xi is an agent's own, else 0, (n, q)."""
        return np.ones((self.n, self.q)) if self.own is None else self.own.astype(np.float64)

    def far(self, e: Array) -> Array:
        """|e| (n, m, ...) less what is no error; where agents agree, their disagreements."""
        if self.sides.size:
            return disagreements(e, self.sides, axis=0)
        far = np.abs(e)
        if self.nodes is None:
            return far
        slack = self.slack.reshape(-1, *(1,) * (e.ndim - 2))
        return np.asarray(np.maximum(far - slack, 0.0))

    def split(self, y: Array) -> tuple[Array, Array, Array]:
        """Cut states (n (m + 2 q), R) into x (n, m, R), xi and z (n, q, R); also without R."""
        many = y.shape[1:]
        # slices and transposes: `split` and `moveaxis` take as long as the products
        after = self.n * (self.m + self.output.shape[1])
        x = y[: self.size].reshape(self.n, self.m, *many)
        xi = y[self.size : after].reshape(self.n, -1, *many)
        return x, xi, y[after:].reshape(self.n, self.q, *many)

    def control(self, e: Array, dhat: Array, active: Active) -> Array:
        """u of (19) for e (..., n, m) and dhat (..., n, p), one mode for each row of errors."""
        K: csr_array = self.K
        u0: Array | float = 0.0
        if self.plant is not None:
            K = self.plant.K
            u0 = self.plant.u0
        flat = e.reshape(-1, self.size).T
        pulled = (K @ flat).T
        for number in np.unique(active.modes).tolist() if self.pins else ():
            of_mode = self.pins.get(active.names[number])
            if of_mode is not None:
                rows = active.modes == number
                pulled[rows] += (of_mode @ flat[:, rows]).T
        return np.asarray(-pulled.reshape(dhat.shape) - dhat + u0)

    def moved(self, u: Array, e: Array) -> Array:
        """What inputs u (n, p, R) and errors e (n, m, R) do to x without couplings and disturbance:
        A x + B u."""
        plant = self.plant
        if plant is None:
            return u
        # A goal + B u0 = 0
        pushed = act(plant.B, u - plant.u0[..., None])
        moved = pushed + act(plant.A, e)
        return moved if self.bend is None else moved + self.bend(e)


def applied(gain: Array, y: Array) -> Array:
    """A gain (q, m) of all agents, or (n, q, m) one for each, times y (..., n, m): (..., n, q)."""
    if gain.ndim == 2:
        return y @ gain.T
    return np.asarray(np.einsum("iqm,...im->...iq", gain, y))


def act(matrix: Array, y: Array) -> Array:
    """A matrix (p, q) of all agents, or (n, p, q) one for each, times y (n, q, R): (n, p, R)."""
    if y.shape[2] == 1:  # faster without the last axis
        return applied(matrix, y[..., 0])[..., None]
    return matrix @ y


def _sides(problem: Problem) -> Array:
    """Of agents that agree on one s_i e_i, (n,); none with a goal, (0,)."""
    if not problem.agrees:
        return np.zeros(0)
    signs = problem.signs
    if signs is None:
        return np.ones(problem.n)
    return np.array([signs.side(i) for i in range(problem.n)], dtype=np.float64)


def largest(y: Array) -> Array:
    """|y|_inf of every run, (R,), for y (n, p, R)."""
    return np.asarray(np.abs(y).max(axis=(0, 1)))


def make_closed_loop(
    problem: Problem, gain: Gain | None, nodes: FixedNodes | None = None
) -> ClosedLoop:
    """Read the numbers of the plant and of its errors as floats; ``nodes``: where fixed ones are.
    Raises: SpecError without a W, or for a gain that does not fit."""
    loop = errors_of(problem)
    goal = arrays.goals(problem)
    plant = arrays.plant_arrays(problem)
    disturbance = arrays.disturbance_arrays(loop, gain)
    own = None
    if loop.drift_place is not None:
        own = compile_coupling(loop.functions[loop.drift_place])
    lead = None
    if plant is not None and problem.leader is not None:
        lead = _lead(plant, own, arrays.leaders_drift(problem))
    return ClosedLoop(
        n=problem.n,
        m=problem.m,
        q=loop.q,
        A=disturbance.A,
        C=disturbance.C,
        F=disturbance.F,
        W=disturbance.W,
        K=pull_matrix(loop),
        goal=goal if nodes is None else goal + nodes.middle,
        own=disturbance.own,
        plant=plant,
        bend=None if plant is None or own is None else _bend(plant, own),
        lead=lead,
        fixed=len(loop.fixed),
        pins=_pins_of_modes(problem),
        sensed=arrays.sensed_arrays(problem, loop),
        nodes=nodes,
        sides=_sides(problem),
        steps=problem.steps,
    )


def _pins_of_modes(problem: Problem) -> dict[str, csr_array]:
    """The gains of single modes, by mode and by graph that is drawn of one."""
    found = {
        mode: arrays.block_gains(gains, problem) for mode, gains in problem.pinning.modes.items()
    }
    graphs = drawn_graphs(problem) if found else {}
    drawn = {name: found[graph.mode] for name, graph in graphs.items() if graph.mode in found}
    return found | drawn


def _bend(plant: Plant, own: ArrayFunction) -> Callable[..., Array]:
    """What ``own``, the curved part of an agent's dynamics, adds to its slopes at the target."""

    def bend(e: Array, s: Array | None = None) -> Array:
        moved = own(e) if s is None else own(s + e) - own(s[None])
        return moved - act(plant.A, e)

    return bend


def _lead(plant: Plant, own: ArrayFunction | None, drift: Array) -> ArrayFunction:
    """s' of a leader s (m, R), which moves as an agent by itself would."""

    def lead(s: Array) -> Array:
        moved = plant.A @ s if own is None else own(s[None])[0]
        return moved + drift[:, None]

    return lead


@noun(eq=False)
class Network:
    """h(e) - K e of one graph: e' of (22) without the observer's error."""

    loop: ClosedLoop
    groups: ArcGroups
    blocks: tuple[_Block, ...]

    def __call__(self, e: Array, time: float = 0.0) -> Array:
        """Return h(e) - K e in a new array; not finite where a coupling overflows or is undefined;
        ``time`` (s) counts where fixed nodes move.
        Shapes: e (n m,) or (n m, R) with one column for each of R runs; rows agent by agent, then
        those of a leader."""
        loop = self.loop
        n, m = loop.n, loop.m
        e, s = e[: loop.size], e[loop.size :]
        # one run of agents with one component is a vector: no axes of length 1 in the blocks
        rows = np.ascontiguousarray(e).reshape((n, -1) if e.size > n else (n,))
        if loop.fixed:
            rows = np.concatenate([rows, self.others(rows, time)])
        total = np.zeros_like(rows)
        for block in self.blocks:
            block.add(total, rows)
        result = total[:n].reshape(e.shape)
        result -= loop.K @ e
        if loop.bend is not None:
            led = [np.reshape(s, (m, -1))] if len(s) else []
            bent = loop.bend(np.reshape(e, (n, m, -1)), *led)
            result += bent.reshape(e.shape)
        if len(s) and loop.lead is not None:
            moved = loop.lead(s.reshape(m, -1))
            result = np.concatenate([result, moved.reshape(s.shape)])
        return result

    def others(self, rows: Array, time: float) -> Array:
        """Where the fixed nodes are, as ``rows`` of agents are given."""
        loop = self.loop
        found = np.zeros((loop.fixed, *rows.shape[1:]))
        if loop.nodes is not None:
            # runs of an agent stand component by component
            runs = max(1, found.size // (loop.fixed * loop.m))
            found[...] = np.repeat(loop.nodes.at(time), runs, axis=1).reshape(found.shape)
        return found


Networks = Callable[[int], Network]  # by the index of a mode


def network_of(loop: ClosedLoop, groups: ArcGroups, *, runs: int = 1) -> Network:
    """h(e) - K e on arcs that are grouped by coupling."""
    # with many runs a block holds fewer arcs
    size = max(1, BLOCK // (loop.m * runs))
    blocks = [block for group in groups for block in _blocks(group, size, loop.m)]
    return Network(loop=loop, groups=groups, blocks=tuple(blocks))


def hears(groups: ArcGroups, n: int) -> csr_array:
    """Mark who may influence whose derivative: neighbours, and every agent itself."""
    groups = arrays.between_agents(groups, n)
    own = np.arange(n)
    rows = np.concatenate([own, *(group.listeners for group in groups)])
    columns = np.concatenate([own, *(group.speakers for group in groups)])
    # a pair that is heard over several arcs is marked once
    marks = csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    return csr_array(marks != 0).astype(np.float64)


def full_pattern(loop: ClosedLoop, groups: ArcGroups) -> csr_array:
    """Who may influence whom: agents by neighbourhood, and all states of one agent among
    themselves."""
    m, q = loop.m, loop.q
    neighbours = hears(groups, loop.n)
    # agents hear estimates, too, where outputs are measured
    own = eye_array(loop.n, format="csr") if loop.sensed is None else neighbours
    x_of_exosystem = _filled(own, m, q)
    among_exosystem = _filled(own, q, q)
    rows = [
        [_filled(neighbours, m, m), x_of_exosystem, x_of_exosystem],
        [None, among_exosystem, None],
        [_filled(neighbours, q, m), None, among_exosystem],
    ]
    return block_array(rows, format="csr")


def errors_pattern(loop: ClosedLoop, groups: ArcGroups, *, both: bool) -> csr_array:
    """Who may influence whom in e, or in ``both`` [e; eps]."""
    n, m, q = loop.n, loop.m, loop.q
    alone = _filled(hears(groups, n), m, m)
    if loop.lead is not None:
        everyone = np.ones((n * m, m))
        rows = [[alone, everyone], [None, np.ones((m, m))]]
        alone = block_array(rows, format="csr")
    if not both:
        return alone
    if loop.lead is not None:
        observers = np.ones((n * q, n * q))
        return block_diag([alone, observers], format="csr")
    own = eye_array(n, format="csr")
    rows = [[alone, _filled(own, m, q)], [None, _filled(own, q, q)]]
    return block_array(rows, format="csr")


def _filled(graph: csr_array, rows: int, columns: int) -> csr_array:
    """Every mark of a graph as a block of ones."""
    return kron(graph, np.ones((rows, columns)), format="csr")
