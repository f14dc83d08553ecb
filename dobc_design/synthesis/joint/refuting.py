"""What is impossible from the start: no W, groups without a pin, rates that no gains reach; exact, whatever V."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dobc_design.conditions.consensus.jacobians import Jacobians, jacobians_at_consensus
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.observer.decide import detectability_check
from dobc_design.conditions.statement import Statement
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import value_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.ground import Ground
from dobc_design.synthesis.joint.perron import slow_directions
from dobc_design.synthesis.joint.rate_limit import rate_obstacle, too_few_pins
from dobc_design.synthesis.joint.request import DesignRequest
from dobc_design.verdict import Verdict


def reduced_exosystem(
    problem: Problem, request: DesignRequest
) -> tuple[Mapping[str, Any], tuple[str, ...], Statement | None]:
    """The observable part in place of an undetectable exosystem, or why there is no W at all.

    That of one group of agents among several is named, and left to the caller.
    """
    if problem.is_grouped:
        return {}, (), next(_undetectable_groups(problem, request), None)
    if problem.exosystem is None:
        return {}, (), None
    check = detectability_check(problem.exosystem, problem)
    if check.verdict is Verdict.PROVED:
        return {}, (), None
    if check.fix is None or not request.reduce:
        exact = {} if check.exact is None else {name: str(value) for name, value in check.exact.items()}
        text = check.reason[0].lower() + check.reason[1:]
        return {}, (), Statement(kind="detectable", verdict=Verdict.REFUTED, text=f"no W exists: {text}", exact=exact)
    return check.fix.set, (f"Exosystem: {check.fix.text}",), None


def _undetectable_groups(problem: Problem, request: DesignRequest) -> Iterator[Statement]:
    for group in problem.groups:
        check = detectability_check(group.exosystem)
        if check.verdict is Verdict.PROVED:
            continue
        text = f"no W exists for the group of agent {group.name}: {check.reason[0].lower() + check.reason[1:]}"
        fix = check.fix
        if not request.reduce or fix is None:
            yield Statement(kind="detectable", verdict=Verdict.REFUTED, text=text)
            continue
        parts = "; ".join(f"{key.rpartition('.')[2]} = {value_text(value)}" for key, value in fix.set.items() if value)
        rest = f" ({parts})" if parts else ""
        yield Statement(
            kind="detectable",
            verdict=Verdict.UNDECIDED,
            text=f"{text} Write its observable part in its place{rest}, and design again; that is done by itself only"
            " where all agents have one exosystem.",
        )


def network_obstacle(ground: Ground) -> Statement | None:
    """Groups that nobody outside is heard by, against who may be pinned and how many."""
    labels, request, structure = ground.problem.network.labels, ground.request, ground.structure
    several = len(ground.problem.network.modes) > 1  # signals that leave a mode often enough may do with fewer pins
    where, always = (" in one of the modes", " under arbitrary switching") if several else ("", "")
    if structure.unmet is not None:
        who = name_agents([labels[i] for i in structure.unmet])
        return Statement(
            kind="structure",
            verdict=Verdict.REFUTED,
            exact={"group": ", ".join(labels[i] for i in structure.unmet)},
            text=f"consensus{always} is out of reach with pins on the allowed agents only: {who} listen"
            f"{'s' if len(structure.unmet) == 1 else ''} to nobody else{where}, and no pin may be put there, so moved"
            f" together they stay moved{' while it lasts' if several else ''}.",
        )
    if request.pins is not None and request.pins < structure.least:
        groups = structure.apart if len(structure.apart) > request.pins else structure.groups
        named = "; ".join(name_agents([labels[i] for i in group]) for group in groups[:8])
        return Statement(
            kind="pins",
            verdict=Verdict.REFUTED,
            exact={
                "least": str(structure.least),
                "groups": " | ".join(", ".join(labels[i] for i in group) for group in groups[:50]),
            },
            text=f"{counted(request.pins, 'pin')} cannot do{always}, whatever the gains: at least {structure.least} are"
            f" needed, because each of these groups hears nobody outside{where} and needs a pin of its own: {named}.",
        )
    return None


def too_fast(ground: Ground) -> Statement | None:
    """A rate that no gains on the allowed agents, or on so many of them, reach near the target, whatever proves it."""
    problem, request = ground.problem, ground.request
    jacobians = _jacobians(problem)
    if request.rate is None or jacobians is None:
        return None

    def propose(mode: Any, component: int, pinned: Any, caps: Any) -> Iterator[list[float]]:
        return slow_directions(mode, component, pinned, caps, size=problem.n)

    found = rate_obstacle(problem, jacobians, request.rate, allowed=request.allowed, caps=request.caps, propose=propose)
    if found is None and request.pins is not None:
        found = too_few_pins(
            problem, jacobians, request.rate, request.pins, allowed=request.allowed, caps=request.caps, propose=propose
        )
    return found


def _jacobians(problem: Problem) -> Jacobians | None:
    if any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    try:
        return jacobians_at_consensus(problem)
    except UndefinedError:
        return None
