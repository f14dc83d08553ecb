"""Witnesses against Lambda < 0, told by the agents that carry them.

A vector v != 0 with v' Lambda v >= 0 that moves few agents says who is not held.  Candidates are exact facts of the
graph (groups that listen to nobody outside) and proposals from floating point; each is multiplied out exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from dobc_design.conditions.consensus.negative import Enclosed, find_witness
from dobc_design.conditions.consensus.network import name_agents, unheld_groups
from dobc_design.exact.matrix import Vector
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem

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
