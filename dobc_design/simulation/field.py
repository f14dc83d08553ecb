"""The right-hand sides of the closed loop in NumPy: the full loop as printed, and its errors alone.

``Field`` is the loop (1), (12), (13), (19) with the flat state [x; xi; z], each stacked agent by agent.  It is the same
loop as ``model.model``'s ``closed_loop``, written a second time on purpose: tests hold the two together.
``Network`` gives e' of (22) when the observer's error is known in closed form: only e is left to be integrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import expm

from dobc_design.problem.arrays import ArcGroup, Gain, arc_groups, disturbance_arrays, goals, pinning_matrix
from dobc_design.problem.problem import Problem
from dobc_design.simulation.graph import Graph, graph_of, hears

Array = NDArray[np.float64]
TERMS = 11  # (1/8)^11 / 11! < 2^-57: anchors are at most 1/(8 |F|) away
TERMS_OF_STEP = 20  # (1/4)^20 / 20! < 2^-100
MOST_ANCHORS = 100_000
MOST_NUMBERS = 1 << 24  # of the table


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """What does not depend on the mode, as floats.

    Shapes: A (q, q), C (m, q), F = A - W C (q, q), W (q, m), K (n m, n m) sparse, goal (n, m); q = 0 without an
    exosystem.  Where agents have different exosystems, A, C, F, W (n, q, m) and ``own`` (n, q) are those of
    ``problem.arrays.Disturbance``: q counts the states of all groups.
    """

    n: int
    m: int
    q: int
    A: Array
    C: Array
    F: Array
    W: Array
    K: sp.csr_array
    goal: Array
    own: NDArray[np.bool_] | None = None

    @property
    def width(self) -> int:
        """Number of states of the full loop."""
        return self.n * (self.m + 2 * self.q)

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """Cut states (..., n (m + 2 q)) into x (..., n, m), xi and z (..., n, q)."""
        states, inner = self.n * self.m, self.n * self.q
        lead = state.shape[:-1]
        return (
            state[..., :states].reshape(*lead, self.n, self.m),
            state[..., states : states + inner].reshape(*lead, self.n, self.q),
            state[..., states + inner :].reshape(*lead, self.n, self.q),
        )

    def correction(self, y: Array) -> Array:
        """W y of every agent: (..., n, m) -> (..., n, q)."""
        return applied(self.W, y)

    def control(self, e: Array, dhat: Array) -> Array:
        """u of (19) for e and dhat, both (..., n, m)."""
        flat = e.reshape(-1, self.n * self.m)
        return np.asarray(-(self.K @ flat.T).T.reshape(e.shape) - dhat)


def applied(gain: Array, y: Array) -> Array:
    """A gain (q, m) of all agents, or (n, q, m) one for each, times y (..., n, m): (..., n, q)."""
    return np.asarray(y @ gain.T if gain.ndim == 2 else np.einsum("iqm,...im->...iq", gain, y))


def act(matrix: Array, y: Array) -> Array:
    """A matrix (p, q) of all agents, or (n, p, q) one for each, times y (n, q, R): (n, p, R)."""
    return applied(matrix, y[..., 0])[..., None] if y.shape[2] == 1 else np.asarray(matrix @ y)


def make_loop(problem: Problem, gain: Gain | None) -> Loop:
    """Read the problem's numbers as floats.

    Raises: SpecError if there is an exosystem and no W, or for a gain that does not fit.
    """
    found = disturbance_arrays(problem, gain)
    return Loop(
        n=problem.n,
        m=problem.m,
        q=problem.q,
        A=found.A,
        C=found.C,
        F=found.F,
        W=found.W,
        own=found.own,
        K=pinning_matrix(problem),
        goal=goals(problem),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """The full closed loop of one graph as a function of time and state."""

    loop: Loop
    graph: Graph
    groups: Sequence[ArcGroup]

    def __call__(self, time: float, state: Array) -> Array:
        """Return the derivative of the state; not finite where a coupling overflows or is undefined."""
        loop = self.loop
        x, xi, z = loop.split(state)
        e = x - loop.goal
        xihat = z + loop.correction(x)
        u = loop.control(e, xihat @ loop.C.T)
        felt = self.graph(e.ravel()).reshape(e.shape) + u
        z_dot = xihat @ loop.F.T - loop.correction(felt)
        return np.concatenate([(felt + xi @ loop.C.T).ravel(), (xi @ loop.A.T).ravel(), z_dot.ravel()])

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """x, xi and z of a state: see ``Loop.split``."""
        return self.loop.split(state)

    def pattern(self) -> sp.csr_array:
        """Which derivative may depend on which state."""
        return full_pattern(self.loop, self.groups)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """h(e) - K e of one graph: e' of (22) without the observer's error.

    Shapes: e (n m,), or (n m, R) for R runs.
    """

    loop: Loop
    graph: Graph
    groups: Sequence[ArcGroup]

    def __call__(self, e: Array) -> Array:
        """Return h(e) - K e; not finite where a coupling overflows or is undefined."""
        result = self.graph(e)
        result -= self.loop.K @ e
        return result

    def pattern(self) -> sp.csr_array:
        """Which derivative may depend on which error."""
        return _block(hears(self.groups, self.loop.n), self.loop.m, self.loop.m)


def make_field(problem: Problem, mode: str, gain: Gain | None) -> Field:
    """Build the right-hand side of the full loop in one mode."""
    return field_of(make_loop(problem, gain), arc_groups(problem, mode))


def field_of(loop: Loop, groups: Sequence[ArcGroup]) -> Field:
    """The full loop on arcs that are grouped by coupling."""
    graph = graph_of(groups, n=loop.n, m=loop.m)
    return Field(loop=loop, graph=graph, groups=groups)


def network_of(loop: Loop, groups: Sequence[ArcGroup], *, runs: int = 1) -> Network:
    """h(e) - K e on arcs that are grouped by coupling."""
    graph = graph_of(groups, n=loop.n, m=loop.m, runs=runs)
    return Network(loop=loop, graph=graph, groups=groups)


def full_pattern(loop: Loop, groups: Sequence[ArcGroup]) -> sp.csr_array:
    """Who may influence whom: agents by neighbourhood, and all states of one agent among themselves."""
    m, q = loop.m, loop.q
    neighbours, own = hears(groups, loop.n), sp.eye_array(loop.n, format="csr")
    return sp.block_array(
        [
            [_block(neighbours, m, m), _block(own, m, q), _block(own, m, q)],
            [None, _block(own, q, q), None],
            [_block(neighbours, q, m), None, _block(own, q, q)],
        ],
        format="csr",
    )


def _block(graph: sp.csr_array, rows: int, columns: int) -> sp.csr_array:
    return sp.kron(graph, np.ones((rows, columns)), format="csr")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """C exp(F t) for 0 <= t <= the horizon it was made for.

    Shapes: F (q, q) in 1/s, C (p, q).  ``table`` (TERMS, anchors, p q) holds the scaled derivatives at the anchors.
    """

    F: Array
    C: Array
    spacing: float
    table: Array

    def at(self, time: float) -> Array:
        """C exp(F t), (p, q)."""
        number = min(round(time / self.spacing), self.table.shape[1] - 1)
        offset = time - number * self.spacing
        powers = offset ** np.arange(TERMS)
        return np.asarray(powers @ self.table[:, number]).reshape(self.C.shape)

    def many(self, times: Array) -> Array:
        """C exp(F t) for an array of times: (p, q, *times.shape)."""
        flat = times.ravel()
        numbers = np.minimum(np.rint(flat / self.spacing).astype(np.int64), self.table.shape[1] - 1)
        offsets = (flat - numbers * self.spacing)[:, None]
        total = self.table[-1].take(numbers, axis=0)
        for term in self.table[-2::-1]:
            total *= offsets
            total += term.take(numbers, axis=0)
        return np.ascontiguousarray(total.T).reshape(*self.C.shape, *times.shape)


def make_closed_form(F: Array, C: Array, horizon: float) -> ClosedForm | None:
    """Prepare C exp(F t) up to ``horizon`` in s; None where a table would be too long or not finite.

    That happens when |F| times the horizon is very large: the observer is then stiff, and the caller
    integrates the full loop instead.
    """
    if not (np.isfinite(F).all() and np.isfinite(C).all()):
        return None
    size = max(float(np.linalg.norm(F, 1)), 1e-6 / horizon)
    spacing = 1 / (4 * size)
    ratio = horizon / spacing
    if not ratio < min(MOST_ANCHORS, MOST_NUMBERS / (TERMS * C.size)):
        return None
    anchors = int(np.ceil(ratio)) + 1
    start = _powers(F, spacing, anchors)
    derivatives = [C]
    for k in range(1, TERMS):
        derivatives.append(derivatives[-1] @ F / k)
    with np.errstate(all="ignore"):
        table = np.stack([(each @ start).reshape(anchors, C.size) for each in derivatives])
    return ClosedForm(F=F, C=C, spacing=spacing, table=table) if np.isfinite(table).all() else None


def _powers(F: Array, spacing: float, count: int) -> Array:
    """exp(F spacing k) for k < count, (count, q, q), by doubling.

    In extended precision where the machine has it: SciPy's expm alone is off by 1e-12 for |F t| of about 100.
    """
    with np.errstate(all="ignore"):
        small: Any = F.astype(np.longdouble) * np.longdouble(spacing)
        term: Any = np.eye(len(F), dtype=np.longdouble)
        step: Any = np.eye(len(F), dtype=np.longdouble)
        for k in range(1, TERMS_OF_STEP):
            term = term @ small / k
            step = step + term
        powers: Any = np.eye(len(F), dtype=np.longdouble)[None]
        while len(powers) < count:
            powers = np.concatenate([powers, powers @ step])
            step = step @ step
        return np.asarray(powers[:count], dtype=np.float64)


def evolve(F: Array, start: Array, times: Array) -> Array:
    """exp(F t) applied to every row of ``start``: the solution of xi_i' = F xi_i.

    Shapes: F (q, q), start (n, q), times (T,).  Returns: (T, n, q); entries beyond the floats are inf or nan.
    """
    if len(F) == 0:
        return np.zeros((len(times), *start.shape))
    closed = make_closed_form(F, np.eye(len(F)), float(times[-1])) if times[-1] > 0 else None
    powers = expm(F[None] * times[:, None, None]) if closed is None else np.moveaxis(closed.many(times), -1, 0)
    return np.asarray(start[None] @ np.swapaxes(powers, 1, 2))
