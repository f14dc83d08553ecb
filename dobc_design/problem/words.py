"""A problem in words: who listens to whom, who is pinned, who is not reached."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import decimal_text
from dobc_design.exact.reading import counted, is_scalar_matrix, named, some
from dobc_design.problem.arrays import unreached
from dobc_design.problem.contradictions import warnings
from dobc_design.problem.groups import Group
from dobc_design.problem.integrators import as_integrators, enclosed
from dobc_design.problem.leader import enclosure, not_enclosed
from dobc_design.problem.meaning import disturbance_words, remarks, time_words
from dobc_design.problem.network import Arcs, Network
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Region, Switching
from dobc_design.problem.uncertainty import Actuators, Uncertainty

LISTED = 30
MOST_COUPLINGS = 8  # beside the default one, and arcs with each of them
FIRST = 8  # labels and modes in the first line


def describe(problem: Problem) -> str:
    """Several lines that an engineer can compare with the drawing on the wall."""
    labels = problem.network.labels
    order = f"disturbance of order {problem.q}." if problem.q else "no disturbance."
    if problem.is_grouped:
        order = f"disturbances of {counted(len(problem.groups), 'group')} of agents"
        order += ", none for the others." if problem.undisturbed else "."
    others = (
        f" ({counted(len(problem.exceptions), 'arc')} with another)" if problem.exceptions else ""
    )
    lines = [
        f"{problem.name}: {size_words(problem.network)}.",
        f"{counted(problem.m, 'state component')} each, {order}",
        f"Target: {leader_words(problem) or _vector(problem.target)}."
        f" Coupling: h = {'; '.join(problem.coupling.texts)}{others}.",
        *dynamics_lines(problem),
    ]
    for mode, arcs in problem.network.modes.items():
        loose = (
            f", {arcs.optional} of which come and go at any time (the last ones)"
            if arcs.optional
            else ""
        )
        lines.append(f'Mode "{mode}": {counted(len(arcs), "arc")}{loose}.')
        lines += [f"  {text}" for text in _listening(labels, arcs)]
        missing = some([labels[i] for i in unreached(problem, [arcs])], LISTED)
        yes = (
            "  Every agent is reached from a pinned "
            f"agent{' by the other arcs' if arcs.optional else ''}."
        )
        missing += (
            " (nothing but their own dynamics holds them)"
            if missing and problem.dynamics is not None
            else ""
        )
        lines.append(f"  NOT REACHED from a pinned agent: {missing}." if missing else yes)
    gains = problem.pinning.gains.items()
    pins = [f"{labels[i]} (k = {gain_text(k)})" for i, k in gains]
    lines.append(f"Pinned: {some(pins, LISTED)}." if pins else "Pinned: nobody.")
    lines += [f"{name[0].upper()}{name[1:]}: {words}." for name, words in table_words(problem)]
    lines += [f"Note: {note}" for note in problem.notes]
    return "\n".join([*lines, *meaning_lines(problem)])


def table_words(problem: Problem) -> list[tuple[str, str]]:
    """What the tables of the file beside network, pins and disturbance say: a name, and the rest of
    a sentence."""
    labels, switching = problem.network.labels, problem.switching
    found = []
    if problem.exceptions:
        found.append(("other couplings", exception_words(problem)))
    if problem.offsets:
        offsets = [f"{labels[i]}: {_vector(offset)}" for i, offset in problem.offsets.items()]
        found.append(("formation offsets", some(offsets, LISTED)))
    found += [_observer(problem, group) for group in problem.groups[:LISTED]]
    if problem.region is not None:
        found.append(("region asked for", _region_words(problem.region)))
    if problem.actuators is not None:
        found.append(("actuators", actuator_words(problem)))
    if problem.uncertainty is not None:
        found.append(("uncertainty", uncertainty_words(problem.uncertainty)))
    if switching is not None:
        found.append(("switching in simulations", switching_words(problem) or ""))
    if assumed := guarantee_words(problem):
        found.append(("proofs may assume", assumed))
    found.append(("simulations", simulation_words(problem)))
    return found


def exception_words(problem: Problem) -> str:
    """Which arcs have a coupling of their own, coupling by coupling."""
    labels = problem.network.labels
    arcs: dict[int, list[str]] = defaultdict(list)
    for (listener, speaker), place in problem.exception_places.items():
        arcs[place].append(f"{labels[listener]} listens to {labels[speaker]}")
    said = []
    for place in list(arcs)[:MOST_COUPLINGS]:
        h = "; ".join(problem.couplings[place].texts)
        said.append(f"h = {h} where {some(arcs[place], MOST_COUPLINGS)}")
    more = len(arcs) - len(said)
    return "; ".join(said) + (f"; and {more} more" if more > 0 else "")


def _region_words(region: Region) -> str:
    pairs = ", ".join(
        f"[{decimal_text(lo)}, {decimal_text(hi)}]" for lo, hi in region.initial_states
    )
    error = region.initial_disturbance
    return f"initial states in {pairs}" + (
        "" if error is None else f", estimation error at most {decimal_text(error)}"
    )


def actuator_words(problem: Problem) -> str:
    """What [actuators] says: limits of inputs, and how large the disturbance may be."""
    table = problem.actuators or Actuators()
    if isinstance(table.limit, Mapping):
        limits = some(
            [f"{label}: {decimal_text(limit)}" for label, limit in table.limit.items()], LISTED
        )
        said = f"|u_i| by component is at most {limits}"
        if len(table.limit) < problem.n:
            said += "; the inputs of the other agents have no limit"
    elif table.limit is not None:
        said = f"|u_i| is at most {decimal_text(table.limit)} by component, for every agent"
    else:
        said = "inputs have no limit"
    if table.amplitude is not None:
        return f"{said}; |d_i| is at most {decimal_text(table.amplitude)} by component"
    if problem.groups and problem.simulation.xi0 is not None:
        return f"{said}; |d_i| is as large as from simulation.xi0"
    return f"{said}; how large |d_i| may be is not said" if problem.groups else said


def uncertainty_words(table: Uncertainty) -> str:
    """What [uncertainty] says: how far the plant may be from the model."""
    said = []
    for error, what in ((table.weights, "every arc weight"), (table.gains, "every gain")):
        if error:
            said.append(f"{what} may be {decimal_text(100 * error)} % off")
    for bound, what in (
        (table.disturbance, "a disturbance that no exosystem generates, |w_i|,"),
        (table.drift, "|xi' - A xi|"),
        (table.measurement, "the noise of every measured state"),
    ):
        if bound:
            said.append(f"{what} is at most {decimal_text(bound)}")
    if not said:
        said.append("nothing is uncertain")
    if not table.known_to_agents:
        said.append("the observers do not know the true weights")
    return "; ".join(said)


def simulation_words(problem: Problem) -> str:
    """What [simulation] says, and what runs do without it: how long, from which seed, from
    where."""
    own = problem.simulation
    said = [f"{decimal_text(own.t_final)} s, seed {own.seed}"]
    if own.x0 is not None:
        where = (
            f"all agents at {_vector(own.x0[0])}" if len(own.x0) == 1 else "every agent at its own"
        )
        said.append(f"they start at x0, {where}")
    if own.xi0 is not None:
        where = (
            f"{_vector(own.xi0[0])} for all agents" if len(own.xi0) == 1 else "one for every agent"
        )
        said.append(f"the exosystem starts at xi0, {where}")
    return "; ".join(said)


def size_words(network: Network) -> str:
    """What a network is at first sight, "3 agents, 2 arcs, labels a, b, c": a file that was misread
    shows there."""
    sizes = [str(len(arcs)) for arcs in network.modes.values()]
    arcs = (
        counted(int(sizes[0]), "arc")
        if len(sizes) == 1
        else f"{len(sizes)} modes of {some(sizes, FIRST)} arcs"
    )
    numbered = network.size > 1 and network.labels == tuple(map(str, range(1, network.size + 1)))
    labels = (
        f"1 to {network.size}"
        if numbered
        else some([named(label) for label in network.labels], FIRST)
    )
    return (
        f"{counted(network.size, 'agent')}, {arcs}, label{'s' if network.size > 1 else ''} {labels}"
    )


def dynamics_lines(problem: Problem) -> list[str]:
    """The equation of agents with [dynamics], and the constant inputs that hold their goals."""
    own = problem.dynamics
    if own is None:
        return []
    A, B = (
        "; ".join(" ".join(map(decimal_text, row)) for row in each or ()) for each in (own.A, own.B)
    )
    inputs, moves = counted(own.inputs, "input"), "A x" if own.f is None else "f(x)"
    by = f"A = [{A}]" if own.f is None else f"f = ({', '.join(own.f)})"
    lines = [f"Agents: x' = {moves} + B (couplings + u + d), {inputs} each, {by}, B = [{B}]."]
    labels = {
        problem.input_at(problem.goal_of(i)): problem.network.labels[i]
        for i in reversed(range(problem.n))
    }
    u0 = [
        f"{_vector(u)} for {label}" if len(labels) > 1 else _vector(u)
        for u, label in labels.items()
        if u and any(u)
    ]
    return lines + [f"Inputs u0 that hold the goals: {some(u0, LISTED)}."] * bool(u0)


def leader_words(problem: Problem) -> str:
    """What a leader is, where it starts and stays, and who knows it."""
    own, leader = problem.dynamics, enclosed(problem)
    if own is None or leader is None:
        return ""
    starts, stays = (
        " x ".join(f"[{decimal_text(lo)}, {decimal_text(hi)}]" for lo, hi in box or ())
        for box in (leader.initial, leader.stays_in)
    )
    pins = problem.pinning.agents
    known = (
        "the pinned agents alone know it "
        f"({some([problem.network.labels[i] for i in pins], LISTED)})"
    )
    known = "all agents know it" if len(pins) == problem.n else known if pins else "nobody knows it"
    moving = as_integrators(problem).slopes_move
    open_ = (
        f"; {not_enclosed(own, leader).rstrip('.')}"
        if moving and enclosure(own, leader) is None
        else ""
    )
    kept = f"; it never leaves {stays}" if stays and not open_ else ""
    return (
        f"a leader, s' = {'A s' if own.f is None else 'f(s)'} from s(0) in {starts}{kept}; "
        f"{known}{open_}"
    )


def gain_text(gain: Matrix) -> str:
    """A gain: a number, a row [1 2], or "matrix"."""
    if is_scalar_matrix(gain):
        return decimal_text(gain[0][0])
    return f"[{' '.join(map(decimal_text, gain[0]))}]" if len(gain) == 1 else "matrix"


def meaning_lines(problem: Problem) -> list[str]:
    """The disturbance and the time scales, what does not fit together, and what looks like a
    slip."""
    lines = [f"{name[0].upper()}{name[1:]}: {words}." for name, words in disturbance_facts(problem)]
    lines += [f"Time scales near the target: {times}."] if (times := time_words(problem)) else []
    return [*lines, *caution_lines(problem)]


def disturbance_facts(problem: Problem) -> list[tuple[str, str]]:
    """Whose disturbance it is, and its parts in words."""
    groups = problem.groups[:LISTED]
    found = [
        (f"disturbance{_of(problem, group)}", disturbance_words(problem, group)) for group in groups
    ]
    if problem.undisturbed:
        found.append((f"disturbance of {some(problem.undisturbed, LISTED)}", "none"))
    return found


def caution_lines(problem: Problem) -> list[str]:
    """What does not fit together, and what looks like a slip."""
    lines = [f"Warning: {warning}" for warning in warnings(problem)]
    return lines + [f"Look at this: {remark}" for remark in remarks(problem)]


def _observer(problem: Problem, group: Group) -> tuple[str, str]:
    own, name = group.observer, f"observer gain W{_of(problem, group)}"
    if own.W is not None:
        return name, "given" + (". P: given, will be tested" if own.P else "")
    asked = "" if own.rate is None else f" for a decay rate of {decimal_text(own.rate)} 1/s"
    return name, f"to be designed{asked}"


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
        **(
            {"groups": [list(group.agents) for group in problem.groups]}
            if problem.is_grouped
            else {}
        ),
        **({"undisturbed": list(problem.undisturbed)} if problem.undisturbed else {}),
        "pinned": [labels[i] for i in problem.pinning.agents],
        "switching": switching_words(problem),
        "notes": list(problem.notes),
        "warnings": list(warnings(problem)),
        "remarks": list(remarks(problem)),
    }


def guarantee_words(problem: Problem) -> str:
    """What proofs may assume of the signal; "" for one mode, where there is nothing to say."""
    switching = problem.switching
    if switching is not None and switching.guarantee == "sequence":
        return "this order and these times"
    if switching is not None and switching.guarantee == "markov":
        return "this Markov chain, with any first mode"
    if switching is not None and switching.guarantee == "dwell" and switching.dwell is not None:
        return f"a mode lasts {lasting(switching.dwell, switching.longest)}"
    return (
        "nothing of the signal (any mode, for any time)" if len(problem.network.modes) > 1 else ""
    )


def lasting(dwell: Fraction, longest: Fraction | None) -> str:
    """How long a mode lasts: "at least 1 s and at most 2 s"."""
    if dwell == longest:
        return f"exactly {float(dwell):.6g} s"
    return f"at least {float(dwell):.6g} s" + (
        "" if longest is None else f" and at most {float(longest):.6g} s"
    )


def switching_words(problem: Problem) -> str | None:
    """What [switching] asks of simulations; None without such a table."""
    own = problem.switching
    if own is None:
        return None
    dwell = None if own.dwell is None else f"{decimal_text(own.dwell)} s"
    if own.signal == "mobile":
        return (
            f"mobile, {_nearness(own)}; the arcs of the modes are not used, and proofs are "
            "about those arcs"
        )
    if own.schedule is not None:
        listed = ", ".join(
            f"{mode} from {decimal_text(time)} s" for time, mode in own.schedule[:LISTED]
        )
        listed += ", ..." if len(own.schedule) > LISTED else ""
        return listed + (
            "" if own.period is None else f", and so again every {decimal_text(own.period)} s"
        )
    if own.signal == "periodic":
        modes = ", ".join((own.sequence or tuple(problem.network.modes))[:LISTED])
        pace = (
            f"a round in {decimal_text(own.period)} s"
            if own.period is not None
            else f"{dwell or 'dwell not given'}"
        )
        return f"periodic, {modes} in turn, {pace}{' each' if dwell else ''}"
    if own.generator is not None:
        stays = [
            f"{mode} for ever" if row[k] == 0 else f"{mode} {decimal_text(-1 / row[k])} s"
            for k, (mode, row) in enumerate(zip(problem.network.modes, own.generator, strict=True))
        ]
        return f"a Markov chain, whose stays last on average: {some(stays, LISTED)}"
    if own.signal == "markov":
        return (
            f"a Markov chain, stays of {dwell or 'a length not given'} on average, other modes "
            "equally likely"
        )
    return (
        "random, a mode drawn anew "
        f"{f'every {dwell}' if dwell else 'after a dwell time that is not given'}"
    )


def _nearness(own: Switching) -> str:
    kept = f", with a hysteresis of {decimal_text(own.hysteresis)}" if own.hysteresis else ""
    if own.radius is None:
        return f"an agent hears its {counted(own.neighbours or 1, 'nearest neighbour')}{kept}"
    return f"an agent hears everyone within {decimal_text(own.radius)} in the unit of x{kept}"


def _listening(labels: Sequence[str], arcs: Arcs) -> list[str]:
    heard: dict[int, list[str]] = defaultdict(list)
    for listener, speaker, weight in arcs:
        heard[listener].append(
            labels[speaker] + ("" if weight == 1 else f" (weight {decimal_text(weight)})")
        )
        if len(heard) > LISTED:
            break
    rows = [
        f"{labels[i]} listens to {', '.join(names[:LISTED])}"
        for i, names in list(heard.items())[:LISTED]
    ]
    return [*rows, "..."] if len(heard) > LISTED else rows


def _vector(values: Sequence[Any]) -> str:
    texts = [decimal_text(value) for value in values]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
