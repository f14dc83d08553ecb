"""The right-hand side of the full loop (1), (12), (13), (19) in NumPy, one vector operation per coupling.

The state is one flat vector [x; xi; z], each stacked agent by agent.  This is the same loop as
``model.model``'s ``closed_loop``, written a second time on purpose: tests hold the two together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from dobc_design.model.arrays import (
    Array,
    Gain,
    arc_groups,
    difference_matrix,
    exosystem_arrays,
    gathering_matrix,
    goals,
    pinning_matrix,
    required_gain,
)
from dobc_design.spec.problem import Problem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Arcs:
    """Arcs of one coupling: h, whom they compare, and how they add up at the listeners."""

    h: Callable[[Array], Array]
    listeners: NDArray[np.int64]
    speakers: NDArray[np.int64]
    gather: sp.csr_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """The closed loop of one mode as a function of time and state.

    Shapes: A (q, q), C (m, q), W (q, m), K (n m, n m) sparse, goal (n, m); q = 0 without an exosystem.
    ``pattern`` marks which derivative may depend on which state.
    """

    n: int
    m: int
    q: int
    A: Array
    C: Array
    W: Array
    K: sp.csr_array
    goal: Array
    arcs: tuple[_Arcs, ...]
    pattern: sp.csr_array

    def __call__(self, time: float, state: Array) -> Array:
        """Return the derivative of the state; not finite where a coupling overflows or is undefined."""
        x, xi, z = self.split(state)
        e = x - self.goal
        xihat = z + x @ self.W.T
        u = self.control(e, xihat)
        felt = self.couplings(e) + u
        z_dot = xihat @ (self.A - self.W @ self.C).T - felt @ self.W.T
        return np.concatenate([(felt + xi @ self.C.T).ravel(), (xi @ self.A.T).ravel(), z_dot.ravel()])

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """Cut states (..., n (m + 2 q)) into x (..., n, m), xi and z (..., n, q)."""
        states, inner = self.n * self.m, self.n * self.q
        lead = state.shape[:-1]
        return (
            state[..., :states].reshape(*lead, self.n, self.m),
            state[..., states : states + inner].reshape(*lead, self.n, self.q),
            state[..., states + inner :].reshape(*lead, self.n, self.q),
        )

    def couplings(self, e: Array) -> Array:
        """h(e) of (9): e (n, m) gives (n, m)."""
        total = np.zeros_like(e)
        for group in self.arcs:
            total += group.gather @ group.h(e[group.speakers] - e[group.listeners])
        return total

    def control(self, e: Array, xihat: Array) -> Array:
        """u of (19) for e (..., n, m) and xihat (..., n, q)."""
        flat = e.reshape(-1, self.n * self.m)
        return np.asarray(-(self.K @ flat.T).T.reshape(e.shape) - xihat @ self.C.T)


def make_field(problem: Problem, mode: str, gain: Gain | None) -> Field:
    """Build the right-hand side of one mode.

    Raises: SpecError if there is an exosystem and no W, or for a gain that does not fit.
    """
    groups = arc_groups(problem, mode)
    A, C = exosystem_arrays(problem)
    return Field(
        n=problem.n, m=problem.m, q=problem.q, A=A, C=C, W=required_gain(problem, gain),
        K=pinning_matrix(problem), goal=goals(problem),
        arcs=tuple(
            _Arcs(
                h=group.coupling.numpy_function(), listeners=group.listeners, speakers=group.speakers,
                gather=gathering_matrix(group, problem.n),
            )
            for group in groups
        ),
        pattern=_pattern(problem, mode),
    )  # fmt: skip


def _pattern(problem: Problem, mode: str) -> sp.csr_array:
    """Who may influence whom: agents by neighbourhood, and all states of one agent among themselves."""
    n, m, q = problem.n, problem.m, problem.q
    hears = sp.eye_array(n, format="csr")
    for group in arc_groups(problem, mode):
        hears = hears + abs(gathering_matrix(group, n)) @ abs(difference_matrix(group, n))
    neighbours = sp.csr_array(hears != 0).astype(np.float64)
    own = sp.eye_array(n, format="csr")

    def block(graph: sp.csr_array, rows: int, columns: int) -> sp.csr_array:
        return sp.kron(graph, np.ones((rows, columns)), format="csr")

    return sp.block_array(
        [
            [block(neighbours, m, m), block(own, m, q), block(own, m, q)],
            [None, block(own, q, q), None],
            [block(neighbours, q, m), None, block(own, q, q)],
        ],
        format="csr",
    )
