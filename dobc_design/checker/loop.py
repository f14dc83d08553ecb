"""The loop that every claim is about, made of what problem.json states.

Nodes are the agents; e_i is the error of node i, its state less its goal. Of every node

    e_i' = sum over its arcs of w h(e_j - e_i) - pin_i e_i + A e_i + own(e_i) + C eps_i

where a pin is an arc to a fixed node of error 0, A e + own(e) is what a node does by itself, and
eps_i, the error of its observer, obeys eps_i' = (A - W C) eps_i with the A, C and W of its
residual. Integrators have A = 0 and own = 0. With `dynamics` B turns inputs into states: couplings
are B h, pins B K, C is B C, and W is W B+ (the format page, "Dynamics"); with a leader errors are
those to its solution. Without exosystem q = 0.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import chain
from types import SimpleNamespace
from typing import Any, NamedTuple

from .expressions import LONGEST, LONGEST_MADE, Coupling, Expression, read_coupling
from .files import Problem
from .guarantee import Guarantee
from .intervals import Exact, Floats, enclosed, halved
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    combined,
    diagonal,
    identity,
    norm,
    paired,
    plus,
    product,
    solved,
    transpose,
)
from .outputs import error_of, pair_of
from .reading import Refused, need
from .signs import without_signs

TICKS = 1000  # that a reading may be old
PIECES = 4096  # of a face of a leader's box


class Arc(NamedTuple):
    """Node i listens to node j."""

    i: int
    j: int
    w: Fraction
    coupling: Coupling
    loose: bool = False  # it comes and goes: w times any number from 0 to 1


class Node(NamedTuple):
    """What every node does by itself, x' = A x + B (its inputs), or f(x) in place of A x."""

    A: Any  # (m, m), with f its slopes at the target; none for integrators
    B: Any  # (m, p); none for integrators
    left: Matrix  # B+ = (B'B)^-1 B'; 1 for integrators
    flow: Sequence[Expression] = ()  # f(target + e), where the file has f
    own: Coupling | None = None  # f(target + e) - f(target), unless f is linear
    H: Any = None  # (r, m): couplings and pins act on H x; none where they act on states

    def pull(self, k: Matrix) -> Matrix:
        """What a gain of the file does to the states."""
        if self.H is not None:
            k = product(k, self.H)
        return k if self.B is None else product(self.B, k)


class Residual(NamedTuple):
    """The observers of the nodes of one exosystem: eps' = (A - W C) eps, and C eps acts on the
    states."""

    agents: list[int]
    A: Matrix
    C: Matrix  # (m, q)
    W: Matrix | None  # (q, m), where the problem has one
    P: Matrix | None
    name: str | None  # by which checks name it; none if it is that of all nodes
    #: The pair (A, C) that its observers work with, and its gain, where these are others.
    sensed: tuple[Matrix, Matrix, Matrix] | None = None

    @property
    def observed(self) -> "Residual":
        """With that pair."""
        if self.sensed is None:
            return self
        A, C, W = self.sensed
        return self._replace(A=A, C=C, W=W, sensed=None)


class Timing(NamedTuple):
    """Readings of neighbours are up to ``delay`` old, and off by a part of up to ``event``; own
    ones up to ``own_delay``. With a ``period`` that is not 0 couplings and pins are held over it,
    and up to ``lost`` readings in a row do not arrive; ``sampled``: so is all that observers do, in
    ``steps`` agents themselves move at its ticks. What acts is ``ahead`` late, which both ages
    count, and estimates are predicted by as much."""

    delay: Fraction
    own_delay: Fraction
    period: Fraction
    lost: int
    event: Fraction
    sampled: bool
    steps: bool
    ahead: Fraction = ZERO

    @property
    def late(self) -> bool:
        """Whether readings are not those of the instant at which they are used, or not true."""
        return bool(self.delay or self.own_delay or self.lost or self.event)

    def ticks(self, age: Fraction) -> int:
        """How many periods old it may be."""
        return -(-age // self.period)


class Loop:
    """Nodes, arcs, pins and residuals, with the region and the plant that are asked for."""

    agents: "Loop"  # of rows that have left out signs: where these are

    def __init__(self, problem: Problem) -> None:
        stated = problem.stated
        self.labels = problem.labels
        self.n = problem.n
        self.m = problem.m
        self.nodes = range(self.n)
        self.size = self.n * self.m  # of e
        offsets = dict(stated.offsets)
        none = [ZERO] * self.m
        #: Where each node shall be, from the target or the leader.
        self.goals = [combined(stated.target, 1, offsets.get(i, none)) for i in self.nodes]
        self.node = node_of(problem, self.goals)
        self.drift = self.node.A
        self.B = self.node.B
        self.own = self.node.own
        self.leader = stated.leader
        #: Where the leader may start, by component.
        self.leads = [[ZERO, ZERO]] * self.m if self.leader is None else self.leader.initial
        self.region = stated.region
        #: How far apart the fixed nodes may be; 0 where there is one target.
        self.gap = ZERO
        if stated.goal == "containment":
            self.between([place for _, place in problem.fixed])
        #: Whether there is no target: nodes are to agree.
        self.agrees = stated.goal == "agreement"
        #: Whether nodes are differences of agents (pairs.py).
        self.differences = False
        #: Whether what both agents of a pair hear may count with one weight.
        self.matched = False
        self.uncertainty = stated.uncertainty
        self.actuators = stated.actuators
        self.timing: Any = timing_of(stated)
        self.xi0 = stated.simulation.get("xi0")  # the starts of the disturbance, not read yet
        # a pin acts on e_i as an arc to a node whose error is 0
        self.pins = pins_of(problem, self.node)
        #: Pin less A of every node: what pulls e_i back; absent: 0.
        self.hold = held(self.pins, self.node, self.n)
        self.fixed = len(problem.fixed)
        self.connect(stated)
        self.pin_modes(stated)
        #: Whether arcs have signs that fit no two sides: those of negative weight oppose.
        self.signed = without_signs(self, stated)
        self.guarantee = Guarantee(stated.switching, list(self.modes))
        self.observe(problem)
        self.estimate(problem)

    def estimate(self, problem: Problem) -> None:
        """Where errors are those of estimates, these start off the states."""
        #: Where they start with estimates that are right, which refutes what fails from there.
        self.exact_region = self.region
        own = problem.dynamics
        if own is None or own.H is None or own.acts_on is not None or self.region is None:
            return
        off = self.region.initial_disturbance or ZERO
        starts = [[lo - off, hi + off] for lo, hi in self.region.initial_states]
        self.region = SimpleNamespace(initial_states=starts, initial_disturbance=off)

    def between(self, places: list[Matrix]) -> None:
        """Errors are distances to the box of all fixed nodes; from one of no width, a target."""
        box = []
        for sides in zip(*places, strict=True):
            box.append((min(lo for lo, _ in sides), max(hi for _, hi in sides)))
        self.gap = max(hi - lo for lo, hi in box)
        if not self.gap:
            self.goals = [[lo for lo, _ in box] for _ in self.nodes]
        elif self.region is not None:
            starts = []
            for (lo, hi), (low, high) in paired(self.region.initial_states, box):
                starts.append([min(lo - low, ZERO), max(hi - high, ZERO)])
            disturbance = self.region.initial_disturbance
            self.region = SimpleNamespace(initial_states=starts, initial_disturbance=disturbance)

    def connect(self, stated: Any) -> None:
        """The arcs of every mode, with their functions."""
        m = self.m
        h = through(self.node, of_outputs(self.node, stated.coupling.h), m)
        exceptions = {}
        for each in stated.coupling.exceptions:
            exceptions[tuple(each.arc)] = through(self.node, of_outputs(self.node, each.h), m)
        known = {each: read_coupling(each, m, LONGEST_MADE) for each in (h, *exceptions.values())}
        #: All different: h, the exceptions, and last what a node does beside A.
        self.functions = list(known.values())
        if self.own is not None:
            self.functions.append(self.own)
        self.modes: dict[str, list[Arc]] = {}
        for mode in stated.modes:
            arcs = []
            for loose, listed in ((False, mode.arcs), (True, mode.optional or [])):
                for i, j, w in listed:
                    arcs.append(Arc(i, j, w, known[exceptions.get((i, j), h)], loose))
            self.modes[mode.name] = arcs
        #: Whether there is more than one graph.
        self.switches = len(self.modes) > 1 or any(arc.loose for arc in self.arcs)
        saturates = self.actuators is not None and self.actuators.saturates
        # a pin that saturates is linear near the target only
        linear = not saturates and all(each.straight for each in self.functions)
        self.domain = "global" if linear else "consensus"  # the local domain
        #: Whether the theorems, which are about slopes at one point, do not apply: there are none
        #: at a kink, nor where a leader takes them along.
        moved_along = self.own is not None and self.leader is not None
        self.kinked = moved_along or any(each.kinked for each in self.functions)

    def pin_modes(self, stated: Any) -> None:
        """The pins of single modes: arcs that come before those of the mode, to nodes from n on,
        whose error is 0."""
        own: dict[int, list[Coupling]] = {}  # the functions by which an agent is pinned
        for mode in stated.modes:
            pins = []
            for i, k in mode.gains or []:
                pull = self.node.pull(k)
                if not any(map(any, pull)):
                    continue
                h, w = self.function_of(pull)
                known = own.setdefault(i, [])
                if h not in known:
                    known.append(h)
                pins.append(Arc(i, self.n + self.fixed + known.index(h), w, h))
            self.modes[mode.name][:0] = pins
        #: How many nodes come after those with a label.
        self.fixed += max(map(len, own.values()), default=0)
        self.collect()

    def collect(self) -> None:
        """The arcs of each mode by the node that hears."""
        self.heard: dict[str, list[list[Arc]]] = {}  # in a mode and by a node
        for name, arcs in self.modes.items():
            self.heard[name] = [[] for _ in self.nodes]
            for arc in arcs:
                self.heard[name][arc.i].append(arc)

    def function_of(self, pull: Matrix) -> tuple[Coupling, Fraction]:
        """The function of a linear pull, y or one of its own, and the factor of it."""
        w = pull[0][0]
        texts: tuple[str, ...] = ("y",)
        if w <= 0 or pull != identity(self.m, w):
            w = Fraction(1)
            texts = tuple(linear_text(row) for row in pull)
        h = read_coupling(texts, self.m, LONGEST_MADE)
        if h not in self.functions:
            self.functions.append(h)
        return h, w

    def with_fixed(self, weights: Sequence[Any], none: Any = 0) -> list[Any]:
        """What belongs to each node, and ``none`` for those whose error is 0."""
        return [*weights, *[none] * self.fixed]

    def observe(self, problem: Problem) -> None:
        """The residuals, each alone and all together."""
        self.residuals = residuals_of(problem, self.node)
        self.names = [residual.name for residual in self.residuals]
        #: Which of the residuals is that of a node.
        self.place = {i: k for k, residual in enumerate(self.residuals) for i in residual.agents}
        #: Of all together, block diagonal.
        self.A = diagonal([residual.A for residual in self.residuals])
        self.C = diagonal([residual.C for residual in self.residuals]) or [[]] * self.m
        self.given_W = joint([residual.W for residual in self.residuals])
        self.given_P = joint([residual.P for residual in self.residuals])
        self.q = len(self.A)

    # --- arcs
    @property
    def arcs(self) -> Iterator[Arc]:
        """Those of all modes."""
        return chain.from_iterable(self.modes.values())

    @property
    def rows(self) -> Iterator[tuple[int, list[Arc]]]:
        """Every node in every mode, with the arcs by which it hears others there."""
        for heard in self.heard.values():
            yield from enumerate(heard)

    @property
    def single(self) -> bool:
        """Whether all arcs act by component, and nodes do nothing beside A."""
        return self.own is None and all(h.single for h in self.functions)

    @property
    def sampled(self) -> bool:
        """Whether nodes move from sample to sample: nothing is left of the flow."""
        return self.timing is not None and self.timing.sampled

    @property
    def disturbed(self) -> bool:
        """Whether `uncertainty` has a disturbance, noise or a drift that acts."""
        plant = self.uncertainty
        if plant is None:
            return False
        observed = plant.drift or self.bands
        return bool(plant.disturbance or plant.measurement or (observed and self.q))

    @property
    def bands(self) -> list[Any]:
        """Sines of unknown frequencies: the least and the largest (rad/s), and the amplitude."""
        return (self.uncertainty and self.uncertainty.bands) or []

    # --- pins
    def pinned(self, modes: Iterable[str], loose: bool = False) -> list[int]:
        """The nodes with a pin in these modes."""
        always = [i for i, k in self.pins.items() if any(map(any, k))]
        return [*always, *self.tied(modes, loose)]

    def tied(self, modes: Iterable[str], loose: bool = False) -> list[int]:
        """The nodes with an arc to one whose error is 0, in these modes."""
        arcs = (arc for mode in modes for arc in self.modes[mode])
        return [arc.i for arc in arcs if arc.j >= self.n and (loose or not arc.loose)]

    def least_gain(self, i: int, error: Fraction = ZERO) -> Fraction:
        """The least of k_cc - sum over d != c of |k_cd|, 0 without a pin; for all relative errors
        of the entries."""
        found = []
        for c, row in enumerate(self.gain(i)):
            others = sum(map(abs, row[:c] + row[c + 1 :]))
            found.append((1 - error) * row[c] - (1 + error) * others)
        return min(found)

    def gain_size(self, i: int) -> Fraction:
        """The largest sum of absolute values in a row of k, 0 without a pin."""
        return Fraction(norm(self.gain(i)))

    def tied_size(self, i: int, error: Fraction) -> Fraction:
        """The same of the arcs of a node to those whose error is 0, in the worst mode and for this
        relative error."""
        found = ZERO
        for heard in self.heard.values():
            own = ZERO
            for arc in heard[i]:
                if arc.j >= self.n:
                    need(arc.coupling.straight, "a pin is curved")
                    own += arc.w * max(map(abs, arc.coupling.slope(0, 0)))
            found = max(found, own)
        return (1 + error) * found

    def gain(self, i: int) -> Matrix:
        """k of a node, 0 without a pin."""
        return self.hold.get(i) or identity(self.m, 0)

    # --- residuals
    def block(self, S: Matrix, i: int) -> Matrix:
        """The block of S = C X C' that belongs to the residual of node i; 0 without a
        disturbance."""
        if self.residuals and i not in self.place:
            return identity(self.m, 0)
        first = self.place.get(i, 0) * self.m
        return [row[first : first + self.m] for row in S[first : first + self.m]]

    # --- who hears whom
    def edges(self, modes: Iterable[str], hears: bool, loose: bool = False) -> list[list[int]]:
        """Whom every node listens to, or who listens to it, by arcs that are always there, or by
        all (``loose``)."""
        found: list[list[int]] = [[] for _ in self.labels]
        for mode in modes:
            for arc in self.modes[mode]:
                if arc.j >= self.n or (arc.loose and not loose):
                    continue
                if hears:
                    found[arc.i].append(arc.j)
                else:
                    found[arc.j].append(arc.i)
        return found


def reach(starts: Collection[int], edges: list[list[int]]) -> set[int]:
    """Everybody who is reached along the edges."""
    found = set[int]()
    extend(found, starts, edges)
    return found


def extend(found: set[int], starts: Collection[int], edges: list[list[int]]) -> None:
    """Add everybody who is reached, and was not found before."""
    found |= set(starts)
    stack = list(starts)
    while stack:
        fresh = {i for i in edges[stack.pop()] if i not in found}
        found |= fresh
        stack += fresh


# --- From problem.json
def through(node: Node, h: tuple[str, ...], m: int) -> tuple[str, ...]:
    """B h, what the states feel of a coupling h of the inputs."""
    B = node.B
    if B is None:
        return h
    # B = b I: every component is multiplied alike
    first = B[0][0]
    if len(h) == 1 and identity(m, first) == B:  # still by component
        if first == 1:
            return h
        return (f"({first})*({h[0]})",)
    inputs = len(node.left)
    if len(h) == 1 < inputs:
        need(inputs == m, "there is not one expression for each input")
        h = tuple(re.sub(r"\by\b", f"y{c + 1}", h[0]) for c in range(m))
    sums = []
    for row in B:
        parts = [f"({b})*({each})" for b, each in paired(row, h) if b]
        sums.append(" + ".join(parts) or "0")
    return tuple(sums)


def of_outputs(node: Node, h: tuple[str, ...]) -> tuple[str, ...]:
    """A coupling of outputs, written for the states."""
    H = node.H
    if H is None:
        return h
    r = len(H)
    if len(h) == 1 < len(node.left):
        need(r == len(node.left), "there is not one expression for each input")
        h = tuple(re.sub(r"\by\b", f"y{k + 1}", h[0]) for k in range(r))
    if len(H[0]) == 1:
        return tuple(re.sub(r"\by\b", f"(({H[0][0]})*y)", each) for each in h)
    # in one go: what is put in has such names, too
    return tuple(
        re.sub(r"\by([0-9]*)\b", lambda y: f"({linear_text(H[int(y[1] or 1) - 1])})", each)
        for each in h
    )


def timing_of(stated: Any) -> Timing | None:
    """What is stated of the times at which readings are taken, and used."""
    late = stated.readings
    processor = stated.processor
    steps = stated.time is not None
    ahead = ZERO if stated.actuators is None else stated.actuators.delay or ZERO
    if late is None and processor is None and not (steps or ahead):
        return None
    delay, own = (ahead, ahead)
    if late is not None:
        delay += late.delay
        own += late.own_delay
    lost, event = (0, ZERO) if late is None else (late.lost, late.event)
    period = Fraction(steps)  # of discrete time 1
    if processor is not None:
        period = processor.period
    elif late is not None and late.period is not None:
        period = late.period
    # more ticks would fill the memory
    few = not period or max(delay, own) - ahead <= TICKS * period >= ahead
    need(few, f"readings are older than {TICKS} periods")
    return Timing(delay, own, period, lost, event, processor is not None or steps, steps, ahead)


def pins_of(problem: Problem, node: Node) -> dict[int, Matrix]:
    """What the gains of the file do to the states, B K."""
    gains = dict(problem.stated.gains)
    if node.B is None:
        return gains
    return {i: node.pull(k) for i, k in gains.items() if any(map(any, k))}


def linear_text(row: Vector) -> str:
    """A row times y, as the format page writes it."""
    return " + ".join(f"({x})*y{d + 1}" for d, x in enumerate(row) if x) or "0"


def held(pins: dict[int, Matrix], node: Node, n: int) -> dict[int, Matrix]:
    """Pin less A of every node where that is not 0."""
    if node.A is None:
        return pins
    found = {}
    none = identity(len(node.A), 0)
    for i in range(n):
        hold = plus(pins.get(i, none), -1, node.A)
        # a node whose pin is just A has none in what follows: nothing pulls its error
        if any(map(any, hold)):
            found[i] = hold
    return found


def residuals_of(problem: Problem, node: Node) -> list[Residual]:
    """The groups of the file, with C and W acting on the states."""
    groups = problem.groups
    alone = len(groups) == 1 and len(groups[0].agents) == problem.n
    found = []
    for group in groups:
        name = None if alone else problem.labels[group.agents[0]]
        if problem.dynamics is not None and problem.dynamics.H is not None:
            F, E = error_of(problem.dynamics, group.A, group.C, group.W)
            none = [[ZERO] * problem.m for _ in F]
            sensed = (*pair_of(problem.dynamics, group.A, group.C), group.W)
            found.append(Residual(group.agents, F, E, none, group.P, name, sensed))
            continue
        C = group.C if node.B is None else product(node.B, group.C)
        W = group.W
        if W is not None and len(W[0]) != problem.m:
            W = product(W, node.left)
        found.append(Residual(group.agents, group.A, C, W, group.P, name))
    return found


def joint(blocks: list[Matrix | None]) -> Matrix | None:
    """One block diagonal matrix; none if a block is missing, or there is none at all."""
    if not blocks or None in blocks:
        return None
    return diagonal(blocks)


# --- What a node does by itself
def node_of(problem: Problem, goals: Matrix) -> Node:
    """A or f about the target or the leader; every goal is an equilibrium for some constant
    input, which the format page asks a checker to test."""
    dynamics = problem.dynamics
    m = problem.m
    if dynamics is None:
        return Node(None, None, identity(m))
    B = dynamics.B
    left = left_inverse(B)
    if dynamics.A is not None:
        targets = transpose([problem.stated.target, *goals])
        rests(B, left, product(dynamics.A, targets))
        return Node(dynamics.A, B, left, H=dynamics.acts_on and dynamics.H)

    flow, values = moved(problem)
    falls = tuple(f"({f.source}) - ({x})" for f, x in paired(flow, values))
    whole = read_coupling(falls, m, LONGEST_MADE)
    slopes = [[whole.slope(c, d) for d in range(m)] for c in range(m)]
    exact = not whole.kinked and all(lo == hi for row in slopes for lo, hi in row)
    # A is taken from them, and A is exact
    need(exact, "f has no exact slopes")
    if problem.stated.leader is None:  # else the leader itself moves by f
        rests(B, left, [[x] for x in values])
    A = [[lo for lo, _ in row] for row in slopes]
    return Node(A, B, left, flow, None if whole.straight else whole)


def left_inverse(B: Matrix) -> Matrix:
    """(B'B)^-1 B', by elimination."""
    turned = transpose(B)
    return solved(product(turned, B), turned)


def rests(B: Matrix, left: Matrix, pulled: Matrix) -> None:
    """What pulls at the goals lies in the range of B."""
    inside = product(B, product(left, pulled)) == pulled
    need(inside, "a goal is no equilibrium for a constant input")


def moved(problem: Problem) -> tuple[list[Expression], Vector]:
    """f(target + e), in y for e, and f(target)."""
    m = problem.m
    f = problem.dynamics.f
    formed = any(any(offset) for _, offset in problem.stated.offsets)
    need(not formed, "a formation goes with A, not with f")
    names = ["y"] if m == 1 else [f"y{d + 1}" for d in range(m)]
    states = {name.replace("y", "x") for name in names}
    in_states = all(set(re.findall(r"\b[xy][0-9]*\b", each)) <= states for each in f)
    need(in_states, "f is written in x1 to xm")
    need(all(len(each) <= LONGEST for each in f), "an expression is too long")

    def shifted(state: re.Match[str]) -> str:
        d = int(state[1] or 1) - 1
        x = problem.stated.target[d]
        if x:
            return f"({x} + {names[d]})"
        return names[d]

    texts = [re.sub(r"\bx([0-9]*)\b", shifted, each) for each in f]
    flow = [Expression(each, names, LONGEST_MADE) for each in texts]
    return flow, [at_target(each) for each in flow]


def at_target(f: Expression) -> Fraction:
    """The exact value of an expression where its variables are 0."""
    (low, high), _ = f.run(f.steps, [((ZERO, ZERO), ()) for _ in f.names])
    need(low == high, "f is not rational at the target")
    return Fraction(low)


# --- A leader with f
def leader_box(loop: Loop) -> list[Floats]:
    """The box of the leader: it starts there, and on no face f points outwards, so that it
    stays (Nagumo)."""
    need(loop.leader.stays_in is not None, "the leader's solution is not enclosed")
    box = [(lo, hi) for lo, hi in loop.leader.stays_in]
    for (lo, hi), (a, b) in paired(loop.leads, box):
        need(a <= lo and hi <= b, "it starts outside")
    # f >= 0 on each lower face, f <= 0 on each upper one
    for c, f in enumerate(loop.node.flow):
        for sign, end in paired((1, -1), box[c]):
            face = [*box[:c], (end, end), *box[c + 1 :]]
            inwards = points(f, sign, face)
            need(inwards, "f is not shown to point inwards on a face of the leader's box")
    # outward: slopes on more than the box are bounds on the box
    return [(enclosed(lo)[0], enclosed(hi)[1]) for lo, hi in box]


def points(f: Expression, sign: int, face: list[Exact], pieces: int = PIECES) -> bool:
    """sign f >= 0 on a face, shown on its parts; exactly, since f may be 0 there."""
    parts = [face]
    while parts:
        if not pieces:
            return False
        part = parts.pop()
        pieces -= 1
        with suppress(Refused):  # it may be defined on the halves
            (least, most), _ = f.at(*((side, ()) for side in part))
            if (least if sign > 0 else -most) >= 0:
                continue
        if all(lo == hi for lo, hi in part):  # a single point has no halves
            return False
        parts += halved(part)
    return True
