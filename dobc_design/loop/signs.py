"""Signed networks (theory, section 14): an arc of negative weight couples by |w| h(-x_j - x_i).

Where two sides of agents fit all signs, the errors s_i e_i, s_i = +1 or -1, are those of a network
without signs: agents on the second side have h*(y) = -h(-y).  Every proof knows that.
"""

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from dobc_design.exact.matrix import scale, subtract
from dobc_design.problem.network import Arc, sized
from dobc_design.problem.signs import Signs

from .arcs import coupling_places
from .loop import Loop
from .pairs import both_ways


def turned(loop: Loop, signs: Signs) -> Loop:
    """The loop of the errors s_i e_i; where no two sides fit, the loop itself, in which agents can
    only meet at 0."""
    if signs.sides is None:
        return replace(loop, goal="target")
    second = np.array(signs.sides) < 0
    functions, mirrored = both_ways(loop)
    exceptions = dict[Arc, int](loop.exceptions)
    modes = {}
    for name, arcs in loop.modes.items():
        modes[name] = sized(arcs)
        places = coupling_places(loop, arcs)
        other = second[arcs.listeners] & (mirrored[places] != places)
        ends = arcs.listeners[other].tolist(), arcs.speakers[other].tolist()
        found = mirrored[places[other]].tolist()
        exceptions |= zip(zip(*ends, strict=True), found, strict=True)
    goals = loop.goals
    offsets = {}
    for agent in goals.offsets:
        own = scale(signs.side(agent), (goals.of(agent),))
        (offsets[agent],) = subtract(own, (goals.target,))
    return replace(
        loop,
        modes=modes,
        functions=functions,
        exceptions=MappingProxyType(exceptions),
        goals=replace(goals, offsets={i: o for i, o in offsets.items() if any(o)}),
        signed=False,
        turned=True,
    )
