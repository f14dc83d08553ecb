"""A problem's numbers as (rounded) float64 arrays: what runs, models and exports compute with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import block_diag

from dobc_design._checks import noun, require_shape
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.tree import postorder
from dobc_design.errors import wrong
from dobc_design.exact.matrix import Array, Matrix, matrix, to_float
from dobc_design.exact.reading import Names, one_of
from dobc_design.problem.groups import gains_of, group_numbers
from dobc_design.problem.network import Arcs, BoolArray, IndexArray, Places, distinct_weights
from dobc_design.problem.problem import Problem

from .arcs import places_at, split_by
from .loop import Loop
from .matrices import block_sparse

LARGEST_FLOAT = Fraction(np.finfo(np.float64).max.item())


def require_floats(problem: Problem) -> Problem:
    """The problem, whose numbers all fit into floats.  Raises: SpecError that names the key of one
    that does not."""
    for key, numbers in _stated(problem):
        _refuse_large(key, numbers)
    return problem


def require_float_errors(loop: Loop) -> None:
    """Refuse products of numbers of the file that do not fit into floats, such as B K of agents
    with [dynamics].  Raises: SpecError that names the key of one."""
    # Products of two numbers that fit may not fit themselves.
    if loop.drift is None:
        return  # the numbers of the file as they stand
    _refuse_large("coupling", _constants(loop.functions))
    _refuse_large("exosystem", [group.exosystem.C for group in loop.groups])
    _refuse_large("observer.W", [group.observer.W or () for group in loop.groups])
    for node, gain in loop.pulls.gains.items():
        _refuse_large(f"pinning.gains.{loop.labels[node]}", gain)


def _stated(problem: Problem) -> Iterator[tuple[str, Any]]:
    """All numbers of a problem file, by their keys."""
    labels = problem.network.labels
    dynamics, region, start = problem.dynamics, problem.region, problem.simulation
    yield "target", problem.target
    yield "coupling", _constants(problem.couplings)
    yield "exosystem", [(each.exosystem.A, each.exosystem.C) for each in problem.groups]
    yield "observer.W", [each.observer.W or () for each in problem.groups]
    if dynamics is not None:
        yield "dynamics", (dynamics.A or (), dynamics.B)
    yield "leader", problem.leads
    if region is not None:
        yield "region", (region.initial_states, region.initial_disturbance or 0)
    yield "simulation", (start.x0 or (), start.xi0 or ())
    for mode, arcs in problem.network.modes.items():
        # each different weight once: there may be a million arcs
        yield f"network.modes.{mode}", distinct_weights(arcs.weights)[1]
    for agent, gain in problem.pinning.gains.items():
        yield f"pinning.gains.{labels[agent]}", gain
    for mode, gains in problem.pinning.modes.items():
        yield f"pinning.modes.{mode}", list(gains.values())
    for agent, offset in problem.offsets.items():
        yield f"formation.offsets.{labels[agent]}", offset


def _constants(functions: Sequence[Coupling]) -> list[Any]:
    """The numbers that stand in these functions."""
    found = []
    for function in functions:
        for part in function.components:
            nodes = postorder(part.node)
            found += [node.own for node in nodes if node.kind == "constant"]
    return found


def _refuse_large(key: str, numbers: Any) -> None:
    if all(-LARGEST_FLOAT <= x <= LARGEST_FLOAT for x in _flat(numbers)):
        return
    raise wrong(
        key,
        "must be at most 1.8e308 in size, because floats are computed with here.",
        "Choose other units; `dobc certify` and `dobc check` compute exactly.",
    )


def _flat(numbers: Any) -> Iterator[Any]:
    if not isinstance(numbers, (list, tuple)):
        return iter((numbers,))
    return chain.from_iterable(map(_flat, numbers))


Gain = Sequence[Sequence[Any]] | NDArray[Any]


@noun(eq=False)
class Disturbance:
    """Exosystem and observer as floats: A (q, q), C (m, q), F = A - W C (q, q), W (q, m).

    Where agents have different exosystems, every agent has places for the states of all groups,
    side by side; those of other groups than its own are 0 and stay 0.  Then A and F are block
    diagonal, C holds those of the groups side by side, W (n, q, m) has the gain of the agent's
    group in its rows, and ``own`` (n, q) says which places are its own.
    """

    A: Array
    C: Array
    F: Array
    W: Array
    own: BoolArray | None = None


@noun(eq=False)
class Plant:
    """What agents with [dynamics] are, as floats: A (m, m), or the slopes of f at the target, B (m,
    p), C (p, q), gains K (n p, n m), u0 (n, p)."""

    A: Array
    B: Array
    C: Array
    K: sp.csr_array
    u0: Array


def plant_arrays(problem: Problem) -> Plant | None:
    """The plant of a problem with [dynamics], else None."""
    own = problem.dynamics
    if own is None:
        return None
    goals = [problem.goal_of(agent) for agent in range(problem.n)]
    # agents mostly share their goal, and u0 solves a system
    u0 = {goal: problem.input_at(goal) for goal in goals}
    none = np.zeros((own.inputs, 0))
    outputs = [to_float(group.exosystem.C) for group in problem.groups]
    return Plant(
        A=to_float(own.about(problem.target)[0]),
        B=to_float(own.B),
        C=np.hstack([none, *outputs]),
        K=pinning_matrix(problem),
        u0=to_float(tuple(u0[goal] for goal in goals)),
    )


@noun(eq=False)
class ArcGroup:
    """The arcs of one mode that share a coupling: ``listeners[a]`` hears ``speakers[a]``, h times
    ``weights[a]``; where it ``opposes``, h is of -e_j - e_i."""

    coupling: Coupling
    listeners: IndexArray
    speakers: IndexArray
    weights: Array
    opposes: bool = False

    def where(self, chosen: BoolArray | IndexArray) -> ArcGroup:
        """Some of the arcs, by truth values or by places."""
        return replace(
            self,
            listeners=self.listeners[chosen],
            speakers=self.speakers[chosen],
            weights=self.weights[chosen],
        )


ArcGroups = tuple[ArcGroup, ...]  # the arcs of one graph


def chosen_mode(problem: Problem, mode: str | None) -> str:
    """Return ``mode`` if the problem has it, its first mode for None.  Raises: SpecError."""
    names = tuple(problem.network.modes)
    return names[0 if mode is None else mode_index(mode, names)]


def mode_index(mode: str, names: Names) -> int:
    """The index of a mode.  Raises: SpecError if there is no such mode."""
    return names.index(one_of(mode, names, "mode", "Leave it out for the first one."))


def chosen_gain(loop: Loop, gain: Gain | None) -> Matrix | None:
    """Return the observer gain W (q, m): ``gain`` if given, else the loop's; None if there is
    neither.  Where agents have different exosystems, W is block diagonal, (q, m times the number of
    groups). Raises: SpecError for a gain without an exosystem, ShapeError for one of the wrong
    shape."""
    if gain is None:
        return loop.joint_observer.W
    if not loop.groups:
        raise wrong(
            "gain",
            "has no meaning without an [exosystem]: there is no disturbance to estimate.",
            "Leave it out, or give the problem an exosystem.",
        )
    W = matrix(gain, name="gain")
    require_shape(
        W,
        (loop.q, loop.m * len(loop.groups)),
        name="gain",
        because="one row per exosystem state, one column per state component",
    )
    return W


def no_gain(loop: Loop) -> Matrix | None:
    """W = 0, for what does not depend on it; None without an exosystem."""
    row = (Fraction(0),) * (loop.m * len(loop.groups))
    return (row,) * loop.q or None


def required_gain(loop: Loop, gain: Gain | None) -> Array:
    """Return W (q, m) as floats, with no rows without an exosystem.  Raises: SpecError, also where
    there is no W."""
    W = chosen_gain(loop, gain)
    if W is not None:
        return to_float(W)
    if loop.groups:
        raise wrong(
            "observer.W",
            f'must be known to build the observer (13); problem "{loop.name}" has an '
            "exosystem but no W.",
            "Give W in [observer], or design one and hand it over as gain=W.",
        )
    return np.zeros((0, loop.m))


def disturbance_arrays(loop: Loop, gain: Gain | None) -> Disturbance:
    """Exosystem and observer for the gain W.  Raises: SpecError or ShapeError, also for entries
    outside the blocks."""
    # Agents that share an exosystem share one small matrix; others need a block each.
    W = required_gain(loop, gain)
    if not loop.is_grouped:
        A, C = exosystem_arrays(loop)
        return Disturbance(A=A, C=C, F=A - W @ C, W=W)
    gains = [to_float(each) for each in gains_of(loop.groups, chosen_gain(loop, gain) or ())]
    drifts = [to_float(group.exosystem.A) for group in loop.groups]
    outputs = [to_float(group.exosystem.C) for group in loop.groups]
    errors = [a - w @ c for a, w, c in zip(drifts, gains, outputs, strict=True)]
    owners = np.array(group_numbers(loop.groups, loop.labels))
    # Which states are those of the group of each agent, (n, q).
    own = owners[:, None] == np.repeat(np.arange(len(drifts)), [len(each) for each in drifts])
    return Disturbance(
        A=block_diag(*drifts),
        C=np.hstack(outputs),
        F=block_diag(*errors),
        W=np.where(own[:, :, None], np.vstack(gains), 0),
        own=own,
    )


@noun(eq=False)
class Sensed:
    """What observes agents with measured outputs (``loop.outputs``), as floats: the ``pairs`` with
    their W, groups side by side; of their states z = (x, xi) those of the agent, x z, and the
    disturbance, d z; how inputs and what moves x move z, and what is taken of y = H x.  Shapes: H
    (r, m), x (m, q), d (p, q), B (q, p), entry and gain (q, m), or (n, q, ...) as W.
    ``estimated``: couplings and pins act on estimates."""

    pairs: Disturbance
    H: Array
    x: Array
    d: Array
    B: Array
    entry: Array
    gain: Array
    estimated: bool


def sensed_arrays(problem: Problem, loop: Loop) -> Sensed | None:
    """The same for the loop of a problem; None where all states are measured."""
    if not loop.sensed or loop.drift is None:
        return None
    m, p = problem.m, problem.inputs
    C = [to_float(group.exosystem.C) for group in problem.groups]
    pairs = disturbance_arrays(replace(loop, groups=loop.sensed), None)
    x = np.hstack([np.eye(m, m + each.shape[1]) for each in C])
    H = pairs.C[:, :m]
    entry = x.T if pairs.own is None else x.T * pairs.own[:, :, None]
    return Sensed(
        pairs=pairs,
        H=H,
        x=x,
        B=entry @ to_float(loop.drift.B),
        entry=entry,
        gain=pairs.W @ H,
        d=np.hstack([np.hstack([np.zeros((p, m)), each]) for each in C]),
        estimated=loop.estimated,
    )


def exosystem_arrays(loop: Loop) -> tuple[Array, Array]:
    """Return A (q, q) and C (m, q) of (12) where all nodes share them; q = 0 without an
    exosystem."""
    if not loop.groups:
        return np.zeros((0, 0)), np.zeros((loop.m, 0))
    shared = loop.groups[0].exosystem
    return to_float(shared.A), to_float(shared.C)


def goals(problem: Problem) -> Array:
    """Return where the agents are to go, xbar + offset_i in row i: (n, m)."""
    # Only agents with an offset, or on another side, differ from the target.
    result = np.tile(to_float((problem.target,)), (problem.n, 1))
    for agent in range(problem.n) if problem.signs else problem.offsets:
        result[agent] = to_float((problem.goal_of(agent),))[0]
    return result


def leaders_drift(problem: Problem) -> Array:
    """f(0) of [dynamics], or 0: (m,)."""
    own = problem.dynamics
    drift = None if own is None else own.drift_at(problem.target)
    return np.zeros(problem.m) if drift is None else np.ravel(to_float((drift,)))


def error_arcs(loop: Loop, mode: str, there: BoolArray | None = None) -> ArcGroups:
    """Split the arcs of one mode, or those ``there`` (arcs,), by what errors feel along them: by
    functions of the loop, in their order; empty groups are left out."""
    return _split(loop.modes[mode], loop.functions, loop.exceptions, size=loop.nodes, there=there)


def plant_arcs(problem: Problem, mode: str) -> ArcGroups:
    """The same by couplings of the file, which act on the inputs of agents with [dynamics]."""
    return _split(
        problem.network.modes[mode], problem.couplings, problem.exception_places, size=problem.n
    )


def _split(
    arcs_of_mode: Arcs,
    functions: Sequence[Coupling],
    places: Places,
    *,
    size: int,
    there: BoolArray | None = None,
) -> ArcGroups:
    which, different = distinct_weights(arcs_of_mode.weights)
    weights = to_float((different,))[0][which]
    codes = arcs_of_mode.listeners * size + arcs_of_mode.speakers
    # Arcs are grouped by function, so that each is evaluated on one long array.
    kinds = 2 * places_at(places, codes, size=size) + (weights < 0)
    if there is not None:
        kinds = np.where(there, kinds, -1)
    groups = []
    for kind, arcs in split_by(kinds):
        if kind >= 0:
            place, opposes = divmod(kind, 2)
            group = ArcGroup(
                coupling=functions[place],
                listeners=arcs_of_mode.listeners[arcs],
                speakers=arcs_of_mode.speakers[arcs],
                weights=np.abs(weights[arcs]),
                opposes=bool(opposes),
            )
            groups.append(group)
    return tuple(groups)


def difference_matrix(group: ArcGroup, size: int) -> sp.csr_array:
    """Return D (arcs, n) with D e = e_j - e_i, or -e_j - e_i, for the arc in which i hears j; e_j =
    0 of fixed nodes."""
    arcs = np.tile(np.arange(len(group.weights)), 2)
    heard = -1.0 if group.opposes else 1.0
    entries = np.repeat([heard, -1.0], len(group.weights))
    columns = np.concatenate([group.speakers, group.listeners])
    free = columns < size
    places = arcs[free], columns[free]
    return sp.csr_array((entries[free], places), shape=(len(group.weights), size))


def gathering_matrix(group: ArcGroup, size: int) -> sp.csr_array:
    """Return S (n, arcs), which adds up what every listener feels, weights included."""
    arcs = np.arange(len(group.weights))
    return sp.csr_array((group.weights, (group.listeners, arcs)), shape=(size, len(arcs)))


def between_agents(groups: ArcGroups, n: int) -> ArcGroups:
    """Arcs without those to fixed nodes."""
    kept = (group.where(group.speakers < n) for group in groups)
    return tuple(group for group in kept if len(group.weights))


def pinning_matrix(problem: Problem, mode: str | None = None) -> sp.csr_array:
    """Return the block diagonal K (n m, n m), with [dynamics] (n p, n m); K (x) I_m of (9) where
    gains are numbers.  ``mode``: of its own pins, too."""
    return block_gains(problem.pinning.of(mode), problem)


def block_gains(gains: Mapping[int, Matrix], problem: Problem) -> sp.csr_array:
    """K of these gains, by agent."""
    agents = np.fromiter(gains, dtype=np.int64, count=len(gains))
    own = problem.dynamics
    acting = [k if own is None else own.on_states(k) for k in gains.values()]
    blocks = np.array([to_float(k) for k in acting]).reshape(-1, problem.inputs, problem.m)
    return block_sparse(blocks, agents, agents, size=problem.n)
