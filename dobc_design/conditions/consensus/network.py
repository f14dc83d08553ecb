"""What the graph alone decides, and witnesses against Lambda < 0 told by the agents that carry them.

If a set S of agents listens to nobody outside S and holds no pin, e_S = c is an equilibrium for every c, so consensus
fails; and the indicator of S is a vector v with v' Lambda v = 0 (theory, section 2).  Vectors v != 0 with v' Lambda v
>= 0 that move few agents say who is not held; proposals from floating point are multiplied out exactly.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.check import Check, Witness
from dobc_design.conditions.consensus.negative import Enclosed, find_witness
from dobc_design.exact.matrix import Vector, identity, nullspace
from dobc_design.problem.arrays import closed_groups, unreached
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
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


Directions = Sequence[Sequence[float]]
LARGEST = 500  # rows up to which the agents without a pin are eliminated


def group_directions(problem: Problem, arcs: Arcs) -> list[list[float]]:
    """For every closed group of one mode whose gains leave a direction c free: the group moved along c.

    The group listens to nobody outside and k_i c = 0 in it, so J e = 0 and e'K e = 0: the value is exactly 0.
    """
    m = problem.m
    found = []
    for group, free in unheld_groups(problem, [arcs]):
        vector = [0.0] * (problem.n * m)
        for agent in group:
            vector[agent * m : (agent + 1) * m] = [float(x) for x in free[0]]
        found.append(vector)
    return found


def unpinned_witness(
    problem: Problem, matrices: Mapping[str, Enclosed], directions: Mapping[str, Directions]
) -> tuple[str, Vector] | None:
    """A mode and a v with v' Lambda v >= 0 that moves no pinned agent: then no gains on the present pins can do.

    ``matrices``: Lambda of every mode.  None: none was found (or some gains can do).
    """
    pinned = set(problem.pinning.agents)
    rows = [row for row in range(problem.n * problem.m) if row // problem.m not in pinned]
    for mode, matrix in matrices.items():
        candidates = [*group_directions(problem, problem.network.modes[mode]), *directions.get(mode, ())]
        found = find_witness(matrix, candidates, rows=rows if len(rows) <= LARGEST else [])
        if found is not None:
            return mode, found
    return None


def carriers(problem: Problem, vector: Sequence[Fraction]) -> tuple[str, ...]:
    """Labels of the agents that a direction moves."""
    m = problem.m
    return tuple(label for i, label in enumerate(problem.network.labels) if any(vector[i * m : (i + 1) * m]))


def refutation(problem: Problem, vector: Vector, *, alone: Sequence[int], roots: int) -> str:
    """Why Lambda < 0 fails, in words; ``alone`` are the agents that hear no pinned one in this mode."""
    moved = carriers(problem, vector)
    labels = tuple(problem.network.labels[i] for i in alone)
    if labels and set(moved) <= set(labels):
        them = "it" if len(labels) == 1 else "them"
        text = f"{name_agents(labels)} hear{'s' if len(labels) == 1 else ''} no pinned agent, so nothing holds {them}:"
        moving = f"{them} alone" if len(moved) == len(labels) == 1 else them if moved == labels else name_agents(moved)
        text += f" v' Lambda v >= 0 for the vector that moves {moving}."
    else:
        text = f"the slowest direction is carried by {name_agents(moved)}: V = e'e does not decrease along it."
        pinned = {problem.network.labels[i] for i in problem.pinning.agents}
        if pinned and not pinned & set(moved):
            text += " No gain on the present pins changes that."
    if roots:
        text += f" The linearisation has {roots} eigenvalue(s) with positive real part: the target is unstable."
    return text
