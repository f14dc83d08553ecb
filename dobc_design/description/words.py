"""A problem in words, as ``dobc check`` says it: who listens to whom, who is pinned, who is not
reached, what its tables say, and what looks like a slip.

A Problem never asks for these words, since some of them are computed.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any

from dobc_design._show.text import capitalize_first
from dobc_design.conditions.consensus.agreement import roots_words
from dobc_design.conditions.consensus.network import reachability_check
from dobc_design.exact.number import decimal_text, number_text
from dobc_design.exact.reading import Document, Names, counted, named, some
from dobc_design.loop.arcs import unreached
from dobc_design.loop.limits import MOST_AGENTS, mean_weights, reached_from
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import timing_words
from dobc_design.loop.words import said_of
from dobc_design.problem.fixed import place_words
from dobc_design.problem.leader import enclosed, enclosure, not_enclosed
from dobc_design.problem.network import Arcs, Network
from dobc_design.problem.problem import Problem, table_words
from dobc_design.problem.region import Pair
from dobc_design.problem.signs import signs_words
from dobc_design.problem.tables import LISTED, gain_text, switching_words, vector_text

from .contradictions import warnings
from .meaning import disturbance_words, remarks, time_words

FIRST = 8  # labels and modes in the first line


def describe(problem: Problem) -> str:
    """Several lines that an engineer can compare with the drawing on the wall."""
    network = problem.network
    others = ""
    if problem.exceptions:
        others = f" ({counted(len(problem.exceptions), 'arc')} with another)"
    h = "; ".join(problem.coupling.texts)
    units = f", in {problem.unit or ', '.join(problem.units)}" if problem.units else ""
    lines = [
        f"{problem.name}: {size_words(network)}.",
        f"{counted(problem.m, 'state component')} each{units}, {_order_words(problem)}",
        f"{_goal_words(problem)}. Coupling: h = {h}{others}.",
        *dynamics_lines(problem),
    ]
    if problem.signs is not None:
        lines.append(f"Signs: {signs_words(problem.signs, network.labels)}.")
    for mode, arcs in network.modes.items():
        lines += _mode_lines(problem, mode, arcs)
    if problem.goal == "target":
        lines += [_sentence(name, words) for name, words in pin_words(problem)]
    lines += limit_lines(problem)
    lines += [_sentence(name, words) for name, words in table_words(problem)]
    timing = loop_of(problem).timing
    if timing is not None:
        lines.append(_sentence("timing", timing_words(timing)))
    lines += [f"Note: {note}" for note in problem.notes]
    return "\n".join([*lines, *meaning_lines(problem)])


def limit_lines(problem: Problem) -> Iterator[str]:
    """Where agents between fixed nodes end, or which of these some of them do not hear."""
    weights = mean_weights(problem)
    labels, fixed = problem.network.labels, tuple(problem.fixed)
    for label, own in list(zip(labels, weights or (), strict=False))[:LISTED]:
        yield f"Agent {named(label)} ends at {limit_words(problem, own)}."
    if weights or problem.goal != "containment" or problem.n > MOST_AGENTS:
        return
    for label, reached in reached_from(loop_of(problem)):
        away = [labels[i] for i in range(problem.n) if i not in reached]
        if away and len(fixed) > 1:
            yield f"Not reached from {named(label)}: {some(away, LISTED)}."


def limit_words(problem: Problem, weights: Sequence[Fraction]) -> str:
    """A mean of what the fixed nodes have, with its value."""
    pairs = zip(problem.fixed, weights, strict=True)
    parts = [f"{number_text(w)} {named(label)}" for label, w in pairs if w]
    values = []
    for c in range(problem.m):
        known = (place[c][0] for place in problem.fixed.values())
        values.append(sum((w * x for w, x in zip(weights, known, strict=True)), Fraction(0)))
    return f"{vector_text(tuple(values), problem.units)} ({' + '.join(parts)})"


def _goal_words(problem: Problem) -> str:
    """Where agents are to go."""
    if problem.agrees:
        return "Goal: agreement, on a value that nobody prescribes"
    if not problem.fixed:
        target = leader_words(problem) or vector_text(problem.target, problem.units)
        return f"Target: {target}"
    places = [
        f"{named(label)} {place_words(place, problem.unit)}"
        for label, place in islice(problem.fixed.items(), LISTED)
    ]
    said = some(places, LISTED)
    if problem.goal == "target":
        return f"Target: the fixed node {said}"
    return f"Goal: all agents end between the fixed nodes: {said}"


def _order_words(problem: Problem) -> str:
    """How many states the disturbances have."""
    if problem.is_grouped:
        groups = counted(len(problem.groups), "group")
        none = ", none for the others" if problem.undisturbed else ""
        return f"disturbances of {groups} of agents{none}."
    if problem.q:
        return f"disturbance of order {problem.q}."
    return "no disturbance."


def _mode_lines(problem: Problem, mode: str, arcs: Arcs) -> Iterator[str]:
    """The arcs of a mode, and whom they do not reach."""
    labels = problem.network.labels
    loose, by = "", ""
    if arcs.optional:
        loose = f", {arcs.optional} of which come and go at any time (the last ones)"
        by = " by the other arcs"
    source = "a fixed node" if problem.fixed else "a pinned agent"
    reached = f"  Every agent is reached from {source}{by}."
    missing = some([labels[i] for i in _unreached(problem, mode)], LISTED)
    if problem.agrees:
        reached = f"  {roots_words(loop_of(problem), [arcs])}"
    elif loop_of(problem).signed:
        reached = f"  {capitalize_first(reachability_check(loop_of(problem), mode).reason)}"
    elif missing:
        held = ""
        if problem.dynamics is not None:
            held = " (nothing but their own dynamics holds them)"
        reached = f"  NOT REACHED from {source}: {missing}{held}."
    yield f'Mode "{mode}": {counted(len(arcs), "arc")}{loose}.'
    for text in _listening(problem.network.names, arcs):
        yield f"  {text}"
    yield reached


def _listening(labels: Names, arcs: Arcs) -> Iterator[str]:
    """Whom each agent hears, of the first agents."""
    heard = defaultdict(list)
    # Large networks are not gone through: the first agents say what the arrow means.
    for listener, speaker, weight in arcs:
        size = abs(weight)
        of = "" if size == 1 else f" (weight {decimal_text(size)})"
        # A negative weight opposes: the listener follows -x.
        what = labels[speaker] if weight > 0 else f"-x of {labels[speaker]}"
        heard[listener].append(what + of)
        if len(heard) > LISTED:
            break
    for i, names in list(heard.items())[:LISTED]:
        yield f"{labels[i]} listens to {', '.join(names[:LISTED])}"
    if len(heard) > LISTED:
        yield "..."


def pin_words(problem: Problem) -> Iterator[tuple[str, str]]:
    """Who is pinned, and how strongly, in every mode and in single ones."""
    pinning = problem.pinning
    every = {"pinned": pinning.gains} if pinning.gains or not pinning.modes else {}
    own = {f'pinned in mode "{mode}"': gains for mode, gains in pinning.modes.items()}
    for name, gains in (every | own).items():
        pins = [f"{problem.network.labels[i]} (k = {gain_text(k)})" for i, k in gains.items()]
        yield name, some(pins, LISTED) or "nobody"


def _sentence(name: str, words: str) -> str:
    return f"{name[0].upper()}{name[1:]}: {words}."


def size_words(network: Network) -> str:
    """What a network is at first sight, "3 agents, 2 arcs, labels a, b, c": a file that was misread
    shows there."""
    n, sizes = network.size, [len(arcs) for arcs in network.modes.values()]
    arcs = counted(sizes[0], "arc")
    if len(sizes) > 1:
        arcs = f"{len(sizes)} modes ({some([counted(size, 'arc') for size in sizes], FIRST)})"
    if n == 1:
        return f"1 agent, {arcs}, label {named(network.labels[0])}"
    if network.labels == tuple(map(str, range(1, n + 1))):
        return f"{n} agents, {arcs}, labels 1 to {n}"
    return f"{n} agents, {arcs}, labels {some([*map(named, network.labels)], FIRST)}"


def dynamics_lines(problem: Problem) -> Iterator[str]:
    """The equation of agents with [dynamics], and the constant inputs that hold their goals."""
    own = problem.dynamics
    if own is None:
        return
    moves = "f(x)"
    by = f"f = ({', '.join(own.f or ())})"
    if own.f is None:
        moves = "A x"
        by = f"A = [{_rows_text(own.A or ())}]"
    equation = f"x' = {moves} + B (couplings + u + d), {counted(own.inputs, 'input')} each"
    yield f"Agents: {equation}, {by}, B = [{_rows_text(own.B)}]."
    if own.H is not None:
        outputs = f"{counted(len(own.H), 'output')} of {counted(problem.m, 'state')}"
        acting = own.acts_on or "estimated states"
        yield (
            f"Measured: y = H x, H = [{_rows_text(own.H)}], {outputs}; couplings and pins act on "
            f"{acting}."
        )
    first = {}  # the first agent with each input
    for i in reversed(range(problem.n)):
        first[problem.input_at(problem.goal_of(i))] = problem.network.labels[i]
    held = []
    for u, label in first.items():
        if any(u):
            whose = f" for {label}" if len(first) > 1 else ""
            held.append(f"{vector_text(u)}{whose}")
    if held:
        yield f"Inputs u0 that hold the goals: {some(held, LISTED)}."


def _rows_text(matrix: Sequence[Sequence[Any]]) -> str:
    return "; ".join(" ".join(map(decimal_text, row)) for row in matrix)


def leader_words(problem: Problem) -> str:
    """What a leader is, where it starts and stays, and who knows it."""
    own, leader = problem.dynamics, enclosed(problem.leader, problem.dynamics)
    if own is None or leader is None:
        return ""
    moves = "A s" if own.f is None else "f(s)"
    said = f"a leader, s' = {moves} from s(0) in {_box_text(leader.initial)}"
    if loop_of(problem).slopes_move and enclosure(own, leader) is None:
        why = not_enclosed(own, leader).rstrip(".")
        return f"{said}; {_who_knows(problem)}; {why}"
    if leader.stays_in:
        said += f"; it never leaves {_box_text(leader.stays_in)}"
    return f"{said}; {_who_knows(problem)}"


def _box_text(box: Sequence[Pair]) -> str:
    return " x ".join(f"[{decimal_text(lo)}, {decimal_text(hi)}]" for lo, hi in box)


def _who_knows(problem: Problem) -> str:
    """Which agents know a leader."""
    pins = problem.pinning.agents
    if len(pins) == problem.n:
        return "all agents know it"
    if not pins:
        return "nobody knows it"
    names = some([problem.network.labels[i] for i in pins], LISTED)
    return f"the pinned agents alone know it ({names})"


def meaning_lines(problem: Problem) -> Iterator[str]:
    """The disturbance and the time scales, what does not fit together, and what looks like a
    slip."""
    for name, words in disturbance_facts(problem):
        yield _sentence(name, words)
    times = time_words(problem)
    if times:
        yield said_of(loop_of(problem))(f"Time scales near the target: {times}.")
    yield from caution_lines(problem)


def disturbance_facts(problem: Problem) -> Iterator[tuple[str, str]]:
    """Whose disturbance it is, and its parts in words."""
    for group in problem.groups[:LISTED]:
        of = f" of {some(group.agents, LISTED)}" if problem.is_grouped else ""
        yield f"disturbance{of}", disturbance_words(problem, group)
    if problem.undisturbed:
        yield f"disturbance of {some(problem.undisturbed, LISTED)}", "none"


def caution_lines(problem: Problem) -> Iterator[str]:
    """What does not fit together, and what looks like a slip."""
    for warning in warnings(problem):
        yield f"Warning: {warning}"
    for remark in remarks(problem):
        yield f"Look at this: {remark}"


def facts(problem: Problem) -> Document:
    """The same for a program: JSON types only."""
    labels, switching = problem.network.labels, problem.switching
    modes = {}
    for mode, arcs in problem.network.modes.items():
        missing = [labels[i] for i in _unreached(problem, mode)]
        modes[mode] = {"arcs": len(arcs), "unreached": missing}
    found = {
        "name": problem.name,
        "agents": problem.n,
        "dimension": problem.m,
        "exosystem_order": problem.q,
    }
    if problem.units:
        found["units"] = list(problem.units)
    if problem.dynamics is not None:
        found["inputs"] = problem.inputs
    if problem.agrees:
        found["goal"] = problem.goal
    found["modes"] = modes
    if problem.is_grouped:
        found["groups"] = [list(group.agents) for group in problem.groups]
    if problem.undisturbed:
        found["undisturbed"] = list(problem.undisturbed)
    if problem.fixed:
        found["fixed"] = list(problem.fixed)
    found["pinned"] = [labels[i] for i in problem.pinning.agents]
    if problem.pinning.modes:
        own = problem.pinning.modes.items()
        found["pinned_in_modes"] = {mode: [labels[i] for i in gains] for mode, gains in own}
    found["switching"] = switching and switching_words(switching, tuple(modes))
    timing = loop_of(problem).timing
    if timing is not None:
        found["timing"] = timing_words(timing)
    found["notes"] = list(problem.notes)
    found["warnings"] = list(warnings(problem))
    found["remarks"] = list(remarks(problem))
    return found


def _unreached(problem: Problem, mode: str) -> tuple[int, ...]:
    """The agents that no pinned agent reaches in one mode."""
    loop = loop_of(problem)
    return unreached(loop, [loop.modes[mode]], pins=loop.pins)
