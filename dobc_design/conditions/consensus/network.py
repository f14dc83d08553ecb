"""What the graph alone decides: which agents no pinned agent reaches.

If a set S of agents listens to nobody outside S and holds no pin, e_S = c is an equilibrium for every
c, so consensus fails; and the indicator of S is a vector v with v' Lambda v = 0 (theory, section 2).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from dobc_design.conditions.check import Check, Witness
from dobc_design.exact.matrix import Vector, identity, nullspace
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.problem.reaching import closed_groups, unreached
from dobc_design.verdict import Verdict

SHOWN = 8


def reachability_check(problem: Problem, mode: str) -> Check:
    """Decide for one mode whether every agent is reached from a pinned one."""
    missing = unreached(problem, [problem.network.modes[mode]])
    if not missing:
        return Check(
            id="reachability",
            mode=mode,
            verdict=Verdict.PROVED,
            domain="global",
            reason="every agent is reached from a pinned agent.",
        )
    labels = tuple(problem.network.labels[i] for i in missing)
    whom = "it" if len(labels) == 1 else "them"
    pins = f"no pinned agent reaches {whom}" if problem.pinning.agents else "there is no pinned agent"
    return Check(
        id="reachability",
        mode=mode,
        verdict=Verdict.REFUTED,
        domain="global",
        reason=f"{name_agents(labels)} {'hears' if len(labels) == 1 else 'hear'} no pinned agent: {pins}."
        f" {cure_in_words(problem, [problem.network.modes[mode]])}",
        witness=Witness(kind="agents", labels=labels),
    )


def unheld_groups(
    problem: Problem, arcs: Iterable[Arcs] | None = None
) -> Iterator[tuple[tuple[int, ...], tuple[Vector, ...]]]:
    """Smallest sets S of agents that listen to nobody outside, with directions c != 0, k_i c = 0 on S.

    ``arcs``: the modes to put together, all of them by default.  Then e_S = c, eps = 0 is an equilibrium whatever
    the others do.  With scalar gains such a set is one without a pin, and every direction is free.
    """
    for group in closed_groups(problem, problem.network.modes.values() if arcs is None else arcs):
        gains = [problem.pinning.gains[i] for i in group if i in problem.pinning.gains]
        free = nullspace(tuple(row for gain in gains for row in gain)) if gains else identity(problem.m)
        if free:
            yield group, free


def cure_in_words(problem: Problem, arcs: Sequence[Arcs]) -> str:
    """Which agents have to be pinned so that everybody is reached: one of each closed group without a pin."""
    pinned = set(problem.pinning.agents)
    groups = [group for group in closed_groups(problem, arcs) if not pinned & set(group)]
    named = [
        " or ".join(problem.network.labels[i] for i in group[:3]) + (" or another of theirs" if len(group) > 3 else "")
        for group in groups[:SHOWN]
    ]
    more = f", and one of each of {len(groups) - SHOWN} more groups" if len(groups) > SHOWN else ""
    return f"Pin agent {', and agent '.join(named)}{more}."


def name_agents(labels: Sequence[str]) -> str:
    """Agents in words: "agent 4", "agents 4, 5 and 6", long lists cut."""
    if len(labels) == 1:
        return f"agent {labels[0]}"
    if len(labels) > SHOWN:
        return f"agents {', '.join(labels[:SHOWN])} and {len(labels) - SHOWN} more"
    return f"agents {', '.join(labels[:-1])} and {labels[-1]}"
