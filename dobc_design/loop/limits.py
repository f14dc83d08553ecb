"""Where agents between fixed nodes end (theory, section 14, "Several leaders").

With linear couplings, one graph and fixed nodes at rest every state converges to a mean of what the
fixed nodes have, with the weights -L_FF^-1 L_FL: L_FF is the Laplacian among agents, what they hear
of fixed nodes included, and L_FL what they hear of these.  Exact; without that, which fixed nodes
an agent hears at all, directly or through others.
"""

from collections.abc import Iterator
from fractions import Fraction

from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.matrix import Matrix, inverse, multiply
from dobc_design.problem.fixed import resting
from dobc_design.problem.problem import Problem

from .arcs import unreached
from .loop import Loop
from .make import loop_of

MOST_AGENTS = 100  # for which the weights are computed


def mean_weights(problem: Problem) -> Matrix | None:
    """The weight of every fixed node in where each agent ends, (n, fixed); None where agents have
    no such limit, or it is not known here.  Rows add up to 1."""
    loop = loop_of(problem)
    if not loop.gap or loop.n > MOST_AGENTS or loop.switches:
        return None
    moves = any(resting(place) is None for place in problem.fixed.values())
    slopes = [_slope(function) for function in loop.functions]
    (arcs,) = loop.modes.values()
    if moves or None in slopes or unreached(loop, [arcs]):
        return None
    among = [[Fraction(0)] * loop.n for _ in range(loop.n)]
    heard = [[Fraction(0)] * len(loop.fixed) for _ in range(loop.n)]
    for i, j, weight in arcs:
        pull = weight * (slopes[loop.place_of(i, j)] or 0)
        among[i][i] += pull
        if j < loop.n:
            among[i][j] -= pull
        else:
            heard[i][j - loop.n] += pull
    return multiply(inverse(tuple(map(tuple, among))), tuple(map(tuple, heard)))


def _slope(function: Coupling) -> Fraction | None:
    """g of h(y) = g y in every component; None of another function, or g <= 0."""
    slope = function.jacobian_at_zero()[0][0]
    linear = function.is_linear and function.by_component and slope.is_point
    return slope.lo if linear and slope.lo > 0 else None


def reached_from(loop: Loop) -> Iterator[tuple[str, frozenset[int]]]:
    """Every fixed node with the agents that hear it, directly or through others, in all modes
    together."""
    speakers: dict[int, list[int]] = {}
    for arcs in loop.modes.values():
        for i, j, _ in arcs:
            speakers.setdefault(j, []).append(i)
    for number, label in enumerate(loop.fixed, loop.n):
        found = set[int]()
        waiting = [number]
        while waiting:
            for listener in speakers.get(waiting.pop(), ()):
                if listener not in found:
                    found.add(listener)
                    waiting.append(listener)
        yield label, frozenset(found)
