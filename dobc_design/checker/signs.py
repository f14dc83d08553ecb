"""Agents that oppose others: an arc of negative weight couples by |w| h(-x_j - x_i).

Sides: +1 or -1 for every agent, so that the product along every arc of every mode is its sign; in
every connected part the first pinned agent, or the first one, has +1. Where there are such sides,
the errors times them are those of a loop without signs, in which agents of the side -1 have
h*(y) = -h(-y), their offsets change sign, and the region is as it was. Else agents can meet at 0
only, rows are those of |w|, and only what is said to know signs may be claimed.
"""

import re
from collections import defaultdict
from collections.abc import Collection
from typing import Any

from .expressions import LONGEST_MADE, Coupling, read_coupling
from .matrices import combined
from .reading import need


def without_signs(loop: Any, stated: Any) -> bool:
    """Make the loop one without signs, where there are sides; whether there are signs and no
    sides."""
    some = any(arc.w < 0 for arc in loop.arcs)
    need(
        some == (stated.negative is not None), "negative weights have no meaning, or there are none"
    )
    if not some:
        return False
    need(loop.B is None and loop.leader is None, "agents that oppose others have no dynamics")
    region = [] if loop.region is None else loop.region.initial_states
    need(all(lo == -hi for lo, hi in region), "the region is not the same on both sides of 0")
    side = sides(loop)
    if not side:
        need(not any(stated.target) and not stated.offsets, "agents can meet at 0 only")
        loop.agrees = False
        return True
    star = {h: h if h.straight else mirrored(h, loop.m) for h in loop.functions}
    loop.functions += [star[h] for h in loop.functions if star[h] is not h]
    for mode, arcs in loop.modes.items():
        turned = []
        for arc in arcs:
            h = arc.coupling if side[arc.i] > 0 else star[arc.coupling]
            turned.append(arc._replace(w=abs(arc.w), coupling=h))
        loop.modes[mode] = turned
    for i, offset in stated.offsets:
        loop.goals[i] = combined(stated.target, side[i], offset)
    loop.collect()
    return False


def sides(loop: Any) -> dict[int, int]:
    """Those of all agents; empty where there are none."""
    near = defaultdict(list)
    for arc in loop.arcs:
        if arc.j < loop.n:
            sign = 1 if arc.w > 0 else -1
            near[arc.i].append((arc.j, sign))
            near[arc.j].append((arc.i, sign))
    found: dict[int, int] = {}
    for first in (*sorted(loop.pinned(loop.modes, True)), *loop.nodes):
        if first in found:
            continue
        found[first] = 1
        stack = [first]
        while stack:
            i = stack.pop()
            for j, sign in near[i]:
                if j not in found:
                    found[j] = sign * found[i]
                    stack.append(j)
                elif found[j] != sign * found[i]:
                    return {}
    return found


def mirrored(h: Coupling, m: int) -> Coupling:
    """-h(-y), written with (-y) for y."""
    texts = tuple(f"-({re.sub('y[0-9]*', lambda y: f'(-{y[0]})', text)})" for text in h.h)
    return read_coupling(texts, m, 2 * LONGEST_MADE)


def cover(loop: Any, modes: Collection[str], loose: bool) -> tuple[list[list[int]], ...]:
    """Whom every node of the double cover hears, and by whom it is heard: i + n stands for -x_i."""
    n = loop.n
    hears: list[list[int]] = [[] for _ in range(2 * n)]
    heard_by: list[list[int]] = [[] for _ in range(2 * n)]
    for mode in modes:
        for arc in loop.modes[mode]:
            if arc.j >= n or (arc.loose and not loose):
                continue
            for half in (0, n):
                other = half if arc.w > 0 else n - half
                hears[arc.i + half].append(arc.j + other)
                heard_by[arc.j + other].append(arc.i + half)
    return hears, heard_by
