"""A problem in words: who listens to whom, who is pinned, who is not reached."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, is_scalar_matrix, some
from dobc_design.problem.arrays import unreached
from dobc_design.problem.groups import Group
from dobc_design.problem.integrators import as_integrators, enclosed
from dobc_design.problem.leader import enclosure, not_enclosed
from dobc_design.problem.meaning import disturbance_words, remarks, time_words
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching

LISTED = 30


def describe(problem: Problem) -> str:
    """Several lines that an engineer can compare with the drawing on the wall."""
    labels = problem.network.labels
    order = f"disturbance of order {problem.q}." if problem.q else "no disturbance."
    if problem.is_grouped:
        order = f"disturbances of {counted(len(problem.groups), 'group')} of agents."
    others = f" ({counted(len(problem.exceptions), 'arc')} with another)" if problem.exceptions else ""
    lines = [
        f"{problem.name}: {counted(problem.n, 'agent')}, {counted(problem.m, 'state component')} each, {order}",
        f"Target: {leader_words(problem) or _vector(problem.target)}."
        f" Coupling: h = {'; '.join(problem.coupling.texts)}{others}.",
        *dynamics_lines(problem),
    ]
    for mode, arcs in problem.network.modes.items():
        loose = f", {arcs.optional} of which come and go at any time (the last ones)" if arcs.optional else ""
        lines.append(f'Mode "{mode}": {counted(len(arcs), "arc")}{loose}.')
        lines += [f"  {text}" for text in _listening(labels, arcs)]
        missing = some([labels[i] for i in unreached(problem, [arcs])], LISTED)
        yes = f"  Every agent is reached from a pinned agent{' by the other arcs' if arcs.optional else ''}."
        missing += " (nothing but their own dynamics holds them)" if missing and problem.dynamics is not None else ""
        lines.append(f"  NOT REACHED from a pinned agent: {missing}." if missing else yes)
    gains = problem.pinning.gains.items()
    pins = [f"{labels[i]} (k = {gain_text(k)})" for i, k in gains]
    lines.append(f"Pinned: {some(pins, LISTED)}." if pins else "Pinned: nobody.")
    if problem.offsets:
        lines.append(
            f"Formation offsets: {some([f'{labels[i]}: {_vector(o)}' for i, o in problem.offsets.items()], LISTED)}."
        )
    lines += [_observer(problem, group) for group in problem.groups]
    if problem.region is not None:
        pairs = ", ".join(f"[{number_text(lo)}, {number_text(hi)}]" for lo, hi in problem.region.initial_states)
        error = problem.region.initial_disturbance
        noise = "" if error is None else f", estimation error at most {number_text(error)}"
        lines.append(f"Region asked for: initial states in {pairs}{noise}.")
    if problem.switching is not None:
        lines.append(f"Switching in simulations: {switching_words(problem)}.")
        lines += guarantee_words(problem.switching)
    if problem.simulation.x0 is not None:
        rows = problem.simulation.x0
        where = f"all agents at {_vector(rows[0])}" if len(rows) == 1 else "every agent at its own"
        lines.append(f"Simulations start at x0, {where}.")
    lines += [f"Note: {note}" for note in problem.notes]
    return "\n".join([*lines, *meaning_lines(problem)])


def dynamics_lines(problem: Problem) -> list[str]:
    """The equation of agents with [dynamics], and the constant inputs that hold their goals."""
    own = problem.dynamics
    if own is None:
        return []
    A, B = ("; ".join(" ".join(map(number_text, row)) for row in each or ()) for each in (own.A, own.B))
    inputs, moves = counted(own.inputs, "input"), "A x" if own.f is None else "f(x)"
    by = f"A = [{A}]" if own.f is None else f"f = ({', '.join(own.f)})"
    lines = [f"Agents: x' = {moves} + B (couplings + u + d), {inputs} each, {by}, B = [{B}]."]
    labels = {problem.input_at(problem.goal_of(i)): problem.network.labels[i] for i in reversed(range(problem.n))}
    u0 = [f"{_vector(u)} for {label}" if len(labels) > 1 else _vector(u) for u, label in labels.items() if u and any(u)]
    return lines + [f"Inputs u0 that hold the goals: {some(u0, LISTED)}."] * bool(u0)


def leader_words(problem: Problem) -> str:
    """What a leader is, where it starts and stays, and who knows it."""
    own, leader = problem.dynamics, enclosed(problem)
    if own is None or leader is None:
        return ""
    starts, stays = (
        " x ".join(f"[{number_text(lo)}, {number_text(hi)}]" for lo, hi in box or ())
        for box in (leader.initial, leader.stays_in)
    )
    pins = problem.pinning.agents
    known = f"the pinned agents alone know it ({some([problem.network.labels[i] for i in pins], LISTED)})"
    known = "all agents know it" if len(pins) == problem.n else known if pins else "nobody knows it"
    moving = as_integrators(problem).slopes_move
    open_ = f"; {not_enclosed(own, leader).rstrip('.')}" if moving and enclosure(own, leader) is None else ""
    kept = f"; it never leaves {stays}" if stays and not open_ else ""
    return f"a leader, s' = {'A s' if own.f is None else 'f(s)'} from s(0) in {starts}{kept}; {known}{open_}"


def gain_text(gain: Matrix) -> str:
    """A gain: a number, a row [1 2], or "matrix"."""
    if is_scalar_matrix(gain):
        return number_text(gain[0][0])
    return f"[{' '.join(map(number_text, gain[0]))}]" if len(gain) == 1 else "matrix"


def meaning_lines(problem: Problem) -> list[str]:
    """The disturbance and the time scales, and what looks like a slip."""
    lines = [
        f"Disturbance{_of(problem, each)}: {disturbance_words(problem, each)}." for each in problem.groups[:LISTED]
    ]
    lines += [f"Time scales near the target: {times}."] if (times := time_words(problem)) else []
    return lines + [f"Look at this: {remark}" for remark in remarks(problem)]


def _observer(problem: Problem, group: Group) -> str:
    given = "given" if group.observer.W is not None else "to be designed"
    P = " P: given, will be tested." if group.observer.P else ""
    return f"Observer gain W{_of(problem, group)}: {given}.{P}"


def _of(problem: Problem, group: Group) -> str:
    return f" of {some(group.agents, LISTED)}" if problem.is_grouped else ""


def facts(problem: Problem) -> dict[str, Any]:
    """The same for a program: JSON types only."""
    labels = problem.network.labels
    return {
        "name": problem.name,
        "agents": problem.n,
        "dimension": problem.m,
        "exosystem_order": problem.q,
        **({} if problem.dynamics is None else {"inputs": problem.inputs}),
        "modes": {
            mode: {"arcs": len(arcs), "unreached": [labels[i] for i in unreached(problem, [arcs])]}
            for mode, arcs in problem.network.modes.items()
        },
        **({"groups": [list(group.agents) for group in problem.groups]} if problem.is_grouped else {}),
        "pinned": [labels[i] for i in problem.pinning.agents],
        "switching": switching_words(problem),
        "notes": list(problem.notes),
        "remarks": list(remarks(problem)),
    }


def guarantee_words(switching: Switching) -> list[str]:
    """What proofs may assume of the signal, in a sentence; nothing without a guarantee."""
    if switching.guarantee == "sequence":
        return ["Proofs may assume this order and these times."]
    if switching.guarantee == "markov":
        return ["Proofs may assume this Markov chain, with any first mode."]
    if switching.guarantee == "dwell" and switching.dwell is not None:
        return [f"Proofs may assume that a mode lasts {lasting(switching.dwell, switching.longest)}."]
    return []


def lasting(dwell: Fraction, longest: Fraction | None) -> str:
    """How long a mode lasts: "at least 1 s and at most 2 s"."""
    if dwell == longest:
        return f"exactly {float(dwell):.6g} s"
    return f"at least {float(dwell):.6g} s" + ("" if longest is None else f" and at most {float(longest):.6g} s")


def switching_words(problem: Problem) -> str | None:
    """What [switching] asks of simulations; None without such a table."""
    own = problem.switching
    if own is None:
        return None
    dwell = None if own.dwell is None else f"{number_text(own.dwell)} s"
    if own.signal == "mobile":
        return f"mobile, {_nearness(own)}; the arcs of the modes are not used, and proofs are about those arcs"
    if own.schedule is not None:
        listed = ", ".join(f"{mode} from {number_text(time)} s" for time, mode in own.schedule[:LISTED])
        listed += ", ..." if len(own.schedule) > LISTED else ""
        return listed + ("" if own.period is None else f", and so again every {number_text(own.period)} s")
    if own.signal == "periodic":
        modes = ", ".join((own.sequence or tuple(problem.network.modes))[:LISTED])
        pace = f"a round in {number_text(own.period)} s" if own.period is not None else f"{dwell or 'dwell not given'}"
        return f"periodic, {modes} in turn, {pace}{' each' if dwell else ''}"
    if own.generator is not None:
        stays = [
            f"{mode} for ever" if row[k] == 0 else f"{mode} {number_text(-1 / row[k])} s"
            for k, (mode, row) in enumerate(zip(problem.network.modes, own.generator, strict=True))
        ]
        return f"a Markov chain, whose stays last on average: {some(stays, LISTED)}"
    if own.signal == "markov":
        return f"a Markov chain, stays of {dwell or 'a length not given'} on average, other modes equally likely"
    return f"random, a mode drawn anew {f'every {dwell}' if dwell else 'after a dwell time that is not given'}"


def _nearness(own: Switching) -> str:
    kept = f", with a hysteresis of {number_text(own.hysteresis)}" if own.hysteresis else ""
    if own.radius is None:
        return f"an agent hears its {counted(own.neighbours or 1, 'nearest neighbour')}{kept}"
    return f"an agent hears everyone within {number_text(own.radius)} in the unit of x{kept}"


def _listening(labels: Sequence[str], arcs: Arcs) -> list[str]:
    heard: dict[int, list[str]] = defaultdict(list)
    for listener, speaker, weight in arcs:
        heard[listener].append(labels[speaker] + ("" if weight == 1 else f" (weight {number_text(weight)})"))
        if len(heard) > LISTED:
            break
    rows = [f"{labels[i]} listens to {', '.join(names[:LISTED])}" for i, names in list(heard.items())[:LISTED]]
    return [*rows, "..."] if len(heard) > LISTED else rows


def _vector(values: Sequence[Any]) -> str:
    texts = [number_text(value) for value in values]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
