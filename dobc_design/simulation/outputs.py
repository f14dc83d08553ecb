"""Runs of agents whose outputs are measured: what their states are, where a run has followed the
errors e of a loop and the estimation errors eps = (x - xhat, xi - xihat) (``loop.outputs``).
"""

import numpy as np

from dobc_design.exact.matrix import to_float
from dobc_design.loop.arrays import Sensed
from dobc_design.loop.matrices import Array
from dobc_design.problem.problem import Problem

from .closed_form import evolve
from .field import Active, ClosedLoop
from .integrate import Samples


def seen_samples(
    problem: Problem,
    loop: ClosedLoop,
    sensed: Sensed,
    states: Array,
    eps: Array,
    times: Array,
    active: Active,
) -> Samples:
    """Of errors, flat and those of a leader after them, and eps (T, n, all) at times (T,): what is
    seen of the agents."""
    e, s = np.split(states, [loop.size], axis=1)
    e = e.reshape(-1, loop.n, loop.m)
    xi = []
    xihat = []
    d: Array | float = 0.0
    first = 0
    for group in problem.groups:
        first += problem.m
        after = first + group.exosystem.order
        own = eps[..., first:after]
        true = evolve(to_float(group.exosystem.A), own[0], times)
        xi.append(true)
        xihat.append(true - own)
        d = d + true @ to_float(group.exosystem.C).T
        first = after
    x = e + loop.goal
    if loop.lead:
        x = x + s[:, None]
    if sensed.estimated:
        x = x + eps @ sensed.x.T
    dhat = np.asarray(d - eps @ sensed.d.T)
    return Samples(
        x=x,
        xi=np.concatenate(xi, axis=2),
        xihat=np.concatenate(xihat, axis=2),
        d=np.asarray(d),
        dhat=dhat,
        u=loop.control(e, dhat, active),
        leader=s if loop.lead else None,
    )
