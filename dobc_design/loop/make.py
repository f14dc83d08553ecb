"""From a problem to its loop: one function for each way in which agents and goals can be stated.

Single integrators have the errors of (22) as they stand.  Agents with dynamics of their own,
x_i' = A x_i + B (sum h + u_i + d_i) with u_i = -K_i e_i - dhat_i + u0 and xihat = z + W B+ x,
B+ B = I, have (theory, section 13)

    e_i' = sum B h(e_j - e_i) - B K_i e_i + A e_i + B C eps_i,   eps_i' = (A_xi - W C) eps_i

which is a loop with the functions B h, the pins B K_i, the drift A, and residuals with the output
B C and the gain W B+, whose product with the output is W C again.  With f in place of A the drift
is f(target + e) - f(target).  With a leader s the target is 0, and the errors obey f(s + e) - f(s).
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import LONGEST_MADE
from dobc_design.coupling.tree import variable_names
from dobc_design.exact.interval import Box, Interval
from dobc_design.exact.matrix import Matrix, multiply, subtract, zeros
from dobc_design.exact.number import ONE, ZERO, number_text
from dobc_design.exact.reading import Names, is_scalar_matrix
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.fixed import hull
from dobc_design.problem.groups import Group, Groups, Observer
from dobc_design.problem.leader import enclosure, not_enclosed
from dobc_design.problem.network import Places
from dobc_design.problem.problem import Problem
from dobc_design.problem.readings import Readings
from dobc_design.problem.region import Pairs

from .arcs import Pin, with_pins
from .guarantee import guarantee_of
from .loop import Drift, Goals, Loop, Pins, Starts, pins_of, zero_goals
from .outputs import residual, sensed, through
from .signs import turned
from .timing import Timing


@noun(eq=False)
class _Same:
    """A problem that equals itself only: to compare large networks takes longer than to make their
    loop."""

    problem: Problem

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.problem is self.problem

    def __hash__(self) -> int:
        return id(self.problem)


def loop_of(problem: Problem) -> Loop:
    """What proofs about ``problem`` are about; the same Loop for the same problem, so that what is
    computed about a loop is kept with it.  Where agents oppose others these are the errors s_i e_i
    (``loop.signs``)."""
    return errors_of(problem) if problem.signs is None else _turned_once(_Same(problem=problem))


def errors_of(problem: Problem) -> Loop:
    """The loop of the errors e_i themselves, which runs and models integrate."""
    return _made_once(_Same(problem=problem))


@lru_cache(maxsize=16)
def _turned_once(same: _Same) -> Loop:
    signs = same.problem.signs
    loop = errors_of(same.problem)
    return loop if signs is None else turned(loop, signs)


@lru_cache(maxsize=16)
def _made_once(same: _Same) -> Loop:
    problem = same.problem
    region = problem.region
    modes = problem.network.modes
    starts = None
    if region is not None:
        starts = Starts(states=region.initial_states, disturbance=region.initial_disturbance)
    pins = pins_of(problem.pinning.gains)
    loop = Loop(
        name=problem.name,
        labels=problem.network.labels,
        fixed=problem.network.fixed,
        m=problem.m,
        modes=modes,
        functions=problem.couplings,
        exceptions=problem.exception_places,
        pins=pins,
        pulls=pins,
        drift=None,
        groups=problem.groups,
        goal=problem.goal,
        gap=ZERO,
        goals=_goals(problem, is_curved=False),
        starts=starts,
        guarantee=guarantee_of(problem.switching, tuple(modes)),
        uncertainty=problem.uncertainty,
        actuators=problem.actuators,
        xi0=problem.simulation.xi0,
        unit=problem.unit,
        signed=problem.signs is not None,
        timing=timing_of(problem),
    )
    dynamics = problem.dynamics
    if dynamics is not None:
        loop = _with_dynamics(loop, problem, dynamics)
    if problem.goal == "containment":
        return _between(loop, hull(problem.fixed))
    if problem.pinning.modes:
        return with_pins(loop, dict(_pins_of_modes(loop, problem)), "target")
    return loop


def timing_of(problem: Problem) -> Timing | None:
    """[readings], [processor] and the delay of actuators, or discrete time, whose tick is 1."""
    given, processor = problem.readings, problem.processor
    acts = None if problem.actuators is None else problem.actuators.delay
    if given is None and processor is None and not problem.steps and acts is None:
        return None
    table = given or Readings()
    ahead = acts or ZERO
    return Timing(
        delay=table.delay + ahead,
        own_delay=table.own_delay + ahead,
        period=problem.period or ZERO,
        lost=table.lost,
        event=table.event,
        sampled=processor is not None or problem.steps,
        steps=problem.steps,
        ahead=ahead,
    )


def _between(loop: Loop, box: Pairs) -> Loop:
    """The loop whose errors are distances to a box that no fixed node leaves.  Where it is a point,
    that is the target."""
    gap = max(hi - lo for lo, hi in box)
    if not gap:
        target = tuple(lo for lo, _ in box)
        return replace(loop, goal="target", goals=replace(loop.goals, target=target))
    starts = loop.starts
    if starts is not None:
        zero = ZERO
        sides = zip(starts.states, box, strict=True)
        apart = tuple((min(lo - a, zero), max(hi - b, zero)) for (lo, hi), (a, b) in sides)
        starts = Starts(states=apart, disturbance=starts.disturbance)
    return replace(loop, gap=gap, goals=zero_goals(loop.m), starts=starts)


class Functions(NamedTuple):
    """The functions of arcs, and which arcs have another one than the first."""

    all: tuple[Coupling, ...]
    exceptions: Places


def _with_dynamics(loop: Loop, problem: Problem, dynamics: Dynamics) -> Loop:
    """The loop of single integrators with all that the dynamics of agents change."""
    functions, exceptions = _acting(problem, dynamics)
    A, curve = dynamics.about(problem.target)
    place = None
    if curve is not None:
        place = len(functions)
        functions = (*functions, curve)
    pins, pulls = _pins_with_dynamics(problem, dynamics, A)
    if dynamics.H is None:
        groups = tuple(_seen_in_states(group, dynamics) for group in problem.groups)
    else:
        groups = tuple(residual(group, dynamics) for group in problem.groups)
        estimated = not dynamics.acts_on
        loop = replace(
            loop,
            sensed=tuple(sensed(group, dynamics) for group in problem.groups),
            starts=_estimated(loop.starts) if estimated else loop.starts,
            estimated=estimated,
        )
    return replace(
        loop,
        functions=functions,
        exceptions=exceptions,
        pins=pins,
        pulls=pulls,
        drift=Drift(A=A, B=dynamics.B, place=place),
        groups=groups,
        goals=_goals(problem, is_curved=curve is not None),
    )


def _estimated(starts: Starts | None) -> Starts | None:
    """Where estimated states start: off the states by no more than estimation errors."""
    if starts is None or starts.disturbance is None:
        return starts
    off = starts.disturbance
    wider = tuple((lo - off, hi + off) for lo, hi in starts.states)
    return replace(starts, states=wider, off=off)


def _pins_of_modes(loop: Loop, problem: Problem) -> Iterator[tuple[str, list[Pin]]]:
    """The pins of single modes, linear pulls: multiples of y, or of a function of their own."""
    y = _made("y", loop.m)
    for mode, gains in problem.pinning.modes.items():
        pins = []
        for i, K in gains.items():
            pull = K if problem.dynamics is None else pull_of(problem.dynamics, K)
            if is_scalar_matrix(pull) and pull[0][0] > 0:
                pins.append(Pin(i, y, pull[0][0]))
            else:
                pins.append(Pin(i, _linear(pull), ONE))
        yield mode, pins


def _linear(M: Matrix) -> Coupling:
    """The coupling M y."""
    rows = []
    for row in M:
        parts = [f"({number_text(x)})*y{d + 1}" for d, x in enumerate(row) if x]
        rows.append(" + ".join(parts) or "0")
    return _made(rows, len(M))


def _goals(problem: Problem, *, is_curved: bool) -> Goals:
    """Where agents are to go; the box of a leader is looked for only where slopes move with it."""
    dynamics = problem.dynamics
    leader = problem.leader
    at_target = Interval.point(ZERO)
    stays_in: Box | None = (at_target,) * problem.m
    unbounded = ""
    if leader is not None and dynamics is not None and is_curved:
        stays_in = enclosure(dynamics, leader)
        if stays_in is None:
            unbounded = not_enclosed(dynamics, leader)
    offsets = problem.offsets
    if problem.signs is not None:
        goals = {i: (problem.goal_of(i),) for i in range(problem.n)}
        from_target = {i: subtract(goal, (problem.target,))[0] for i, goal in goals.items()}
        offsets = {i: offset for i, offset in from_target.items() if any(offset)}
    return Goals(
        target=problem.target,
        offsets=offsets,
        moves=leader is not None,
        starts=problem.leads,
        stays_in=stays_in,
        unbounded=unbounded,
    )


def _pins_with_dynamics(problem: Problem, dynamics: Dynamics, A: Matrix) -> tuple[Pins, Pins]:
    """The pins B K_i, and B K_i - A of every agent; agents often share one matrix."""
    stated = problem.pinning.gains
    # Agents without a pin share one gain of 0, so that it is multiplied once.
    none = zeros(dynamics.inputs, dynamics.felt)
    acting = {}
    pulling = {}
    for K in (none, *stated.values()):
        acting[id(K)] = pull_of(dynamics, K)
        pulling[id(K)] = subtract(acting[id(K)], A)
    pins = {i: acting[id(K)] for i, K in stated.items()}
    # An agent without a pin has its drift all the same.
    pulls = {i: pulling[id(stated.get(i, none))] for i in range(problem.n)}
    return pins_of(pins), pins_of(pulls)


def pull_of(dynamics: Dynamics, K: Matrix) -> Matrix:
    """B K, or B K H where pins act on outputs: a gain as it acts on the states."""
    return multiply(dynamics.B, dynamics.on_states(K))


def _seen_in_states(group: Group, dynamics: Dynamics) -> Group:
    """A group whose disturbance acts on the states, and whose gain W acts on them."""
    exosystem = group.exosystem
    observer = group.observer
    seen = multiply(dynamics.B, exosystem.C)
    # z is driven by all of x: a gain that the file gives for inputs is spread over the states.
    W = on_states(observer.W, dynamics)
    return Group(
        agents=group.agents,
        exosystem=Exosystem(A=exosystem.A, C=seen),
        observer=Observer(W=W, P=observer.P, rate=observer.rate),
    )


def observed(problem: Problem) -> Groups:
    """The groups whose C is what a gain W of the file acts on: C of the inputs, or B C where W acts
    on x (p = m)."""
    own = problem.dynamics
    if own is not None and own.H is not None:
        return tuple(sensed(group, own) for group in problem.groups)
    return loop_of(problem).groups if problem.inputs == problem.m else problem.groups


def on_states(W: Matrix | None, dynamics: Dynamics) -> Matrix | None:
    """An observer gain of all state components, (q, m), from one of the inputs, (q, p); others stay
    as they are."""
    if W is None or len(W[0]) == dynamics.dimension:
        return W
    return multiply(W, dynamics.left_inverse)


def _acting(problem: Problem, dynamics: Dynamics) -> Functions:
    """The functions B h of the arcs, each different one once."""
    first = _times(dynamics, problem.coupling)
    special = {arc: _times(dynamics, coupling) for arc, coupling in problem.exceptions.items()}
    # Couplings of the file that differ may be the same after B, and count once then.
    different = tuple(dict.fromkeys((first, *special.values())))
    places = {function: place for place, function in enumerate(different)}
    exceptions = {arc: places[function] for arc, function in special.items()}
    return Functions(different, MappingProxyType(exceptions))


def _times(dynamics: Dynamics, coupling: Coupling) -> Coupling:
    """B h, with as many expressions as state components; of H y where couplings act on outputs."""
    B = dynamics.B
    m = dynamics.dimension
    texts = coupling.texts
    if coupling.by_component and is_scalar_matrix(B) and not dynamics.acts_on:
        if B[0][0] == 1:
            return coupling
        return _made(f"({number_text(B[0][0])})*({texts[0]})", m)
    if coupling.by_component:
        # y of the file stands for every component in turn.
        names = variable_names(dynamics.felt)
        texts = tuple(re.sub(r"\by\b", name, texts[0]) for name in names)
    if dynamics.acts_on:
        texts = through(dynamics.seen, texts)
    rows = []
    for row in B:
        parts = [f"({number_text(b)})*({h})" for b, h in zip(row, texts, strict=True) if b]
        rows.append(" + ".join(parts) or "0")
    return _made(rows, m)


def _made(h: str | Names, m: int) -> Coupling:
    """A coupling made of one of the file, and longer."""
    return make_coupling(h, dimension=m, longest=LONGEST_MADE)
