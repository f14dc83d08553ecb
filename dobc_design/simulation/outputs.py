"""Runs of agents whose outputs are measured: what their states are, where a run has followed the
errors e of a loop and the estimation errors eps = (x - xhat, xi - xihat) (``loop.outputs``).
"""

import numpy as np

from dobc_design.exact.matrix import to_float
from dobc_design.loop.matrices import Array
from dobc_design.loop.outputs import is_estimated
from dobc_design.problem.problem import Problem

from .closed_form import evolve
from .field import Active, ClosedLoop
from .integrate import Samples


def initial_errors(problem: Problem, drawn: Array) -> Array:
    """eps (n, m + q, side by side for several groups): as drawn, with xi0 of the problem, where it
    has one, in place of what is drawn for xi: estimates of xi begin with 0."""
    rows = problem.simulation.xi0
    if rows is None:
        return drawn
    eps = drawn.copy()
    place = problem.network.index
    first = 0
    for group in problem.groups:
        first += problem.m
        after = first + group.exosystem.order
        for label in group.agents:
            agent = place[label]
            eps[agent, first:after] = to_float((rows[agent if len(rows) > 1 else 0],))[0]
        first = after
    return eps


def off(problem: Problem, eps: Array) -> Array:
    """x - xhat of every agent, (..., n, m), of eps (..., n, all)."""
    total = np.zeros((*eps.shape[:-1], problem.m))
    first = 0
    for group in problem.groups:
        total += eps[..., first : first + problem.m]
        first += problem.m + group.exosystem.order
    return total


def seen_samples(
    problem: Problem, loop: ClosedLoop, states: Array, eps: Array, times: Array, active: Active
) -> Samples:
    """Of errors, flat and those of a leader after them, and eps (T, n, all) at times (T,): what is
    seen of the agents."""
    e, s = np.split(states, [loop.size], axis=1)
    e = e.reshape(-1, loop.n, loop.m)
    n = loop.n
    xi = []
    xihat = []
    d = np.zeros((len(times), n, loop.output.shape[0]))
    missed = np.zeros_like(d)
    first = 0
    for group in problem.groups:
        first += problem.m
        after = first + group.exosystem.order
        own = eps[..., first:after]
        true = evolve(to_float(group.exosystem.A), own[0], times)
        C = to_float(group.exosystem.C)
        xi.append(true)
        xihat.append(true - own)
        d += true @ C.T
        missed += own @ C.T
        first = after
    x = e + loop.goal
    if loop.lead:
        x = x + s[:, None]
    if is_estimated(problem.dynamics):
        x = x + off(problem, eps)
    dhat = d - missed
    return Samples(
        x=x,
        xi=np.concatenate(xi, axis=2),
        xihat=np.concatenate(xihat, axis=2),
        d=d,
        dhat=dhat,
        u=loop.control(e, dhat, active),
        leader=s if loop.lead else None,
    )
