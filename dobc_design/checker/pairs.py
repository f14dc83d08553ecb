"""What rows are about where agents agree without a target: differences of states.

If exactly one agent hears nobody in any mode, it is the target of the others, in their order. Else
the nodes are the pairs (i, j), i != j, in the order of i, then j, with the error x_i - x_j: where i
hears l by w h, (i, j) hears (l, j) by w h and (j, i) hears (j, l) by w h*, h*(y) = -h(-y); for l =
j these are the fixed nodes n (n - 1) and n (n - 1) + 1. With one function, a linear one, the lesser
weight by which both of a pair always hear the same agent is taken off both, and is the weight of an
arc to the first fixed node, unless weights or measured states are uncertain. Of more than MOST
agents nodes are the agents, and only graphs are looked at. C counts twice and W half, because there
are two residuals.
"""

import copy
from collections import defaultdict
from fractions import Fraction
from functools import lru_cache
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from .claims import Case
from .intervals import Exact
from .loop import Arc, Loop
from .matrices import ZERO, diagonal, opposite
from .signs import mirrored

MOST = 300  # agents, of which pairs are looked at


@lru_cache(maxsize=1)  # every check asks
def rows_of(case: Case) -> Case:
    """The same case about differences, where agents agree, or without signs, which rows do not
    see; itself otherwise."""
    if not case.agrees and not case.signed:
        return case
    rows = copy.copy(case)
    if case.signed:
        rows.agents = case
        rows.modes = {}
        for mode, arcs in case.modes.items():
            rows.modes[mode] = [arc._replace(w=abs(arc.w)) for arc in arcs]
        rows.collect()
        return rows
    rows.differences = True
    leader = silent(case)
    rows.agrees = leader is None and case.n > MOST
    if leader is not None:
        led(case, rows, leader)
    elif case.n <= MOST:
        pairs(case, rows)
    rows.n = len(rows.labels)
    rows.nodes = range(rows.n)
    rows.size = rows.n * rows.m
    # of agents, which nodes no longer are; whatever asks for them fails
    del rows.goals, rows.place, rows.region, rows.exact_region
    if case.drift is not None:  # A x_i - A x_j
        rows.hold = dict.fromkeys(rows.nodes, opposite(case.drift))
    rows.collect()
    # both residuals of a pair: |C eps_i - C eps_j| <= 2 max |C eps|
    rows.residuals = []
    for residual in case.residuals:
        C = [[2 * x for x in row] for row in residual.C]
        W = halved_gain(residual.W)
        rows.residuals.append(residual._replace(C=C, W=W))
    if case.uncertainty is not None:  # so are disturbances, and noise of a difference
        stated = vars(case.uncertainty)
        both = {name: 2 * stated[name] for name in ("disturbance", "measurement")}
        both["bands"] = [(low, high, 2 * size) for low, high, size in case.bands]
        rows.uncertainty = SimpleNamespace(**stated | both)
    rows.C = diagonal([residual.C for residual in rows.residuals]) or [[]] * rows.m
    rows.W = halved_gain(case.W)
    rows.given_W = halved_gain(case.given_W)
    return rows


def shared_starts(case: Case) -> list[Exact]:
    """By component, the interval in which every x_i - offset_i starts."""
    found = []
    for c, (lo, hi) in enumerate(case.region.initial_states):
        offsets = [goal[c] for goal in case.goals]
        found.append((lo - max(offsets), hi - min(offsets)))
    return found


def halved_gain(W: Any) -> Any:
    """W/2, with which A - W C is the same for 2 C."""
    return None if W is None else [[x / 2 for x in row] for row in W]


def silent(loop: Loop) -> int | None:
    """The only agent that hears nobody in any mode, if there is one."""
    listeners = {arc.i for arc in loop.arcs}
    found = [i for i in loop.nodes if i not in listeners]
    return found[0] if len(found) == 1 else None


def led(case: Case, rows: Case, leader: int) -> None:
    """The others, with the agent that hears nobody as the only fixed node."""
    others = [i for i in case.nodes if i != leader]
    number = {i: k for k, i in enumerate([*others, leader])}
    rows.labels = [case.labels[i] for i in others]
    rows.fixed = 1
    rows.modes = {}
    for mode, arcs in case.modes.items():
        rows.modes[mode] = [arc._replace(i=number[arc.i], j=number[arc.j]) for arc in arcs]


def pairs(case: Case, rows: Case) -> None:
    """All pairs."""
    n = case.n
    agents = case.nodes
    number = {pair: k for k, pair in enumerate((i, j) for i in agents for j in agents if i != j)}
    count = len(number)
    rows.labels = [f"({case.labels[i]}, {case.labels[j]})" for i, j in number]
    rows.fixed = 2
    star = {h: h if h.straight else mirrored(h, case.m) for h in case.functions}
    rows.functions = [*case.functions, *(star[h] for h in case.functions if star[h] is not h)]
    plant = case.uncertainty
    exact = plant is None or not (plant.weights or plant.measurement)
    sole = exact and len(case.functions) == 1 and case.functions[0].straight
    rows.matched = sole
    rows.modes = {}
    for mode, arcs in case.modes.items():
        hears: dict[int, dict[int, Fraction]] = defaultdict(dict)  # who is heard: by whom
        for arc in arcs:
            if sole and not arc.loose:
                hears[arc.j][arc.i] = arc.w
        found, mirror = [], []
        shared: dict[int, Fraction] = defaultdict(Fraction)
        for both in hears.values():
            for i, w in both.items():
                for j, other in both.items():
                    if i != j:
                        shared[number[i, j]] += min(w, other)
        for pair, w in shared.items():
            found.append(Arc(pair, count, w, case.functions[0]))
        for arc in arcs:
            i, heard = arc.i, arc.j
            for j in range(n):
                if j == i:
                    continue
                w = arc.w
                if sole and not arc.loose:
                    w -= min(w, hears[heard].get(j, ZERO))
                if not w:
                    continue
                first = count if j == heard else number[heard, j]
                second = count + 1 if j == heard else number[j, heard]
                found.append(Arc(number[i, j], first, w, arc.coupling, arc.loose))
                mirror.append(Arc(number[j, i], second, w, star[arc.coupling], arc.loose))
        rows.modes[mode] = sorted([*found, *mirror], key=attrgetter("loose"))
