"""Agents with dynamics as integrators that have the same errors, so that every condition knows
them.

x_i' = A x_i + B (sum h + u_i + d_i) with u_i = -K_i e_i - dhat_i + u0 and xihat = z + W B+ x, B+ B
= I, gives

    e_i' = sum B h(e_j - e_i) - (B K_i - A) e_i + B C eps_i,   eps_i' = (A_xi - W C) eps_i
    (theory, section 13)

That is (22) with the couplings B h, the gains B K_i - A, the output B C and the observer gain W B+,
whose product with the output is W C again.  With f in place of A the gains have its slopes A at the
target, and f(target + e) - f(target) itself is the last of the couplings, which no arc has:
``problem.node`` is its place.  With a leader s the target is 0, and the errors obey f(s + e) -
f(s): the node at s + e less that at s.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

from dobc_design._checks import put
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import LONGEST_MADE
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, multiply, subtract, zeros
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import is_scalar_matrix
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Group, Observer
from dobc_design.problem.leader import Box, Leader, enclosure, not_enclosed
from dobc_design.problem.pinning import Pinning
from dobc_design.problem.problem import Problem


@lru_cache(maxsize=16)
def as_integrators(problem: Problem) -> Problem:
    """The problem of integrators with the errors of ``problem``; without [dynamics] the problem
    itself.

    Its states, targets, modes, exosystem states and observer states are those of ``problem``; its
    inputs are B u + A (x - xbar - offset), and its gains need not pull towards the target.
    """
    dynamics = problem.dynamics
    if dynamics is None:
        return problem
    systems = [
        Exosystem(A=each.exosystem.A, C=multiply(dynamics.B, each.exosystem.C))
        for each in problem.groups
    ]
    observers = [
        Observer(W=on_states(each.observer.W, dynamics), P=each.observer.P, rate=each.observer.rate)
        for each in problem.groups
    ]
    parts: dict[str, Any] = {}
    if problem.is_grouped:
        each = zip(problem.groups, systems, observers, strict=True)
        parts["groups"] = [
            Group(agents=group.agents, exosystem=x, observer=y) for group, x, y in each
        ]
    elif systems:
        parts = {"exosystem": systems[0], "observer": observers[0]}
    A, node = dynamics.about(problem.target)
    own, none = problem.pinning.gains, zeros(dynamics.inputs, dynamics.dimension)
    different = {id(k): k for k in (none, *own.values())}  # agents often share one matrix
    felt = {key: subtract(multiply(dynamics.B, k), A) for key, k in different.items()}
    gains = {i: felt[id(own.get(i, none))] for i in range(problem.n)}
    found = problem.replace(
        dynamics=None,
        leader=None,
        coupling=acting(problem.coupling, dynamics),
        exceptions={arc: acting(each, dynamics) for arc, each in problem.exceptions.items()},
        gains=None,
        **parts,
    )
    # the gains need not pull towards the target, and a leader goes with [dynamics]
    put(found, pinning=Pinning(gains=gains), origin=problem, leader=problem.leader)
    if node is not None:
        put(found, couplings=(*found.couplings, node), node=len(found.couplings))
    return found


def observed(problem: Problem) -> tuple[Group, ...]:
    """The groups whose C is what a gain W of the file acts on: C of the inputs, or B C where W acts
    on x (p = m)."""
    return as_integrators(problem).groups if problem.inputs == problem.m else problem.groups


def on_states(W: Matrix | None, dynamics: Dynamics) -> Matrix | None:
    """An observer gain of all state components, (q, m), from one of the inputs, (q, p); others stay
    as they are."""
    if W is None or len(W[0]) == dynamics.dimension:
        return W
    return multiply(W, dynamics.left_inverse)


def acting(coupling: Coupling, dynamics: Dynamics) -> Coupling:
    """B h, with as many expressions as state components."""
    m, texts, B = dynamics.dimension, coupling.texts, dynamics.B
    if coupling.by_component and is_scalar_matrix(B):
        return coupling if B[0][0] == 1 else _made(f"({number_text(B[0][0])})*({texts[0]})", m)
    if coupling.by_component:
        texts = tuple(re.sub(r"\by\b", f"y{c + 1}", texts[0]) for c in range(m))
    rows = [
        [f"({number_text(b)})*({h})" for b, h in zip(row, texts, strict=True) if b] for row in B
    ]
    return _made([" + ".join(row) or "0" for row in rows], m)


def _made(h: Any, m: int) -> Coupling:
    """A coupling made of one of the file, and longer."""
    return make_coupling(h, dimension=m, longest=LONGEST_MADE)


def enclosed(problem: Problem) -> Leader | None:
    """The leader with the box that it stays in, where slopes of f move with it and a box is given
    or found."""
    leader, dynamics = problem.leader, problem.dynamics
    if leader is None or dynamics is None or dynamics.about(problem.target)[1] is None:
        return leader
    box = None if leader.stays_in else enclosure(dynamics, leader)
    return (
        leader
        if box is None
        else Leader(initial=leader.initial, stays_in=tuple((x.lo, x.hi) for x in box))
    )


def leaders_box(problem: Problem) -> Box:
    """The box that the leader of ``as_integrators`` never leaves, proved; 0 without one.  Raises:
    UndefinedError."""
    if problem.leader is None or problem.origin is None or problem.origin.dynamics is None:
        return (Interval.point(0),) * problem.m
    box = enclosure(problem.origin.dynamics, problem.leader)
    if box is None:
        raise UndefinedError(not_enclosed(problem.origin.dynamics, problem.leader))
    return box


def dynamics_of(problem: Problem) -> Dynamics | None:
    """The [dynamics] behind ``as_integrators``; None without any."""
    return None if problem.origin is None else problem.origin.dynamics


def slopes_of_nodes(problem: Problem) -> Matrix:
    """The A that is in the gains of ``as_integrators``."""
    dynamics, origin = dynamics_of(problem), problem.origin
    return () if origin is None or dynamics is None else dynamics.about(origin.target)[0]
