"""Proposals near the consensus for gains of max-separable certificates: the best v there, and weights that bound it.

With s -> 0 the rows are posynomials in v, so that the cheapest gains are a geometric program with one exponential cone
per arc.  Its multipliers, balanced and rounded to integers, are what ``verify`` multiplies out.  Floating point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import optimize, sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from dobc_design.exact.matrix import Vector
from dobc_design.solvers.program import Array, is_solver_failure
from dobc_design.synthesis.pinning.request import PinningRequest

MOST_ARCS = 20_000  # cones of the program
SPAN = math.log(1e5)  # of log v
BITS = 2**44  # of the largest flow, and of v
TINY = 1e-9  # flows below this part of the largest are left out
STEPS = 100  # of balancing
Rows = Mapping[str, tuple[Mapping[tuple[int, int], Fraction], Sequence[Fraction]]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearOptimum:
    """The cheapest gains near the consensus: v (n,) > 0, and the weights of all rows, mode by mode (n,)."""

    v: Array
    weights: Mapping[str, Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class Flows:
    """Weights by mode, v and balanced flows as rational numbers."""

    weights: Mapping[str, Vector]
    v: Vector
    flows: Mapping[tuple[int, int], Fraction]


def near_optimum(rows: Rows, request: PinningRequest, *, time_limit: float = 30.0) -> NearOptimum | None:
    """Solve the geometric program near the consensus; None if it is too large or the solver gives nothing.

    ``rows``: of every mode a_ij by (listener, speaker), and their sums (n,).
    """
    import clarabel

    if not 0 < sum(len(arcs) for arcs, _ in rows.values()) <= MOST_ARCS:
        return None
    try:
        answer = _run(rows, request, clarabel, time_limit)
    except BaseException as error:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(error):
            raise
        return None
    x, z = np.asarray(answer.x, dtype=np.float64), np.asarray(answer.z, dtype=np.float64)
    if str(answer.status) not in ("Solved", "AlmostSolved") or not np.all(np.isfinite(x)):
        return None
    n = len(request.costs)
    weights = {mode: np.maximum(z[k * n : (k + 1) * n], 0.0) for k, mode in enumerate(rows)}
    return NearOptimum(v=np.exp(x[:n] - np.min(x[:n])), weights=weights)


def bounding_flows(rows: Rows, request: PinningRequest, found: NearOptimum) -> Flows | None:
    """The weights made to fit the costs, and balanced flows for them, as rationals; None if balancing fails."""
    n = len(request.costs)
    weights = _fitted(request, {mode: _rational(q) for mode, q in found.weights.items()})
    room: dict[tuple[int, int], float] = {}
    for mode, (arcs, _) in rows.items():
        for (i, j), a in arcs.items():
            room[i, j] = room.get((i, j), 0.0) + float(weights[mode][i] * a)
    pairs = np.array(list(room), dtype=np.int64).reshape(-1, 2)
    sizes = np.array(list(room.values()))
    top = np.max(sizes, initial=0.0)
    kept = (sizes > TINY * top) & (pairs[:, 0] != pairs[:, 1]) if len(pairs) else np.zeros(0, dtype=bool)
    pairs, sizes = pairs[kept], sizes[kept]
    graph = sparse.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    group = connected_components(graph, connection="strong")[1]
    inside = group[pairs[:, 0]] == group[pairs[:, 1]]
    pairs, sizes = pairs[inside], sizes[inside]
    v = _balancing(pairs, sizes, np.maximum(found.v, 1e-12))
    exact_v = tuple(Fraction(max(1, round(float(x) * BITS)), BITS) for x in v / np.max(v))
    flows = _circulation(pairs, sizes, np.array([float(x) for x in exact_v]), group)
    return None if flows is None else Flows(weights=weights, v=exact_v, flows=flows)


def hopeless_weights(rows: Rows, request: PinningRequest) -> Mapping[str, Vector] | None:
    """Weights p of rows, sum 1, that make every column as large as they can; None if one stays <= 0.

    Rows of agents with a gain without cap have none.
    """
    n, modes = len(request.costs), list(rows)
    free = set(request.allowed) - set(request.caps)
    capped = set(request.allowed) & set(request.caps)
    parts = []
    for arcs, sums in rows.values():
        diagonal = [
            float(request.rate - total - (request.caps[i] if i in capped else 0)) for i, total in enumerate(sums)
        ]
        pairs = np.array(list(arcs), dtype=np.int64).reshape(-1, 2)
        values = np.array([float(a) for a in arcs.values()])
        across = sparse.csr_array((values, (pairs[:, 1], pairs[:, 0])), shape=(n, n))
        parts.append(across + sparse.diags_array(diagonal))
    columns = sparse.hstack(parts, format="csr")
    matrix = sparse.hstack([-columns, sparse.csr_array(np.ones((n, 1)))], format="csr")
    bounds = [(0.0, 0.0 if i in free else 1.0) for _ in modes for i in range(n)] + [(None, 1.0)]
    total = sparse.csr_array(np.concatenate([np.ones(n * len(modes)), [0.0]])[None, :])
    linear = np.zeros(n * len(modes) + 1)
    linear[-1] = -1.0
    answer = optimize.linprog(
        linear, A_ub=matrix, b_ub=np.zeros(n), A_eq=total, b_eq=[1.0], bounds=bounds, method="highs"
    )
    if answer.x is None or not np.all(np.isfinite(answer.x)):
        return None
    return {mode: _rational(answer.x[k * n : (k + 1) * n]) for k, mode in enumerate(modes)}


def _run(rows: Rows, request: PinningRequest, clarabel: Any, time_limit: float) -> Any:
    """Unknowns: u = log v (n), the gains of the allowed agents, t of every arc with t >= exp(u_j - u_i)."""
    n, allowed = len(request.costs), np.array(request.allowed)
    count, rate = len(allowed), float(request.rate)
    pairs = [np.array(list(arcs), dtype=np.int64).reshape(-1, 2) for arcs, _ in rows.values()]
    values = [np.array([float(a) for a in arcs.values()]) for arcs, _ in rows.values()]
    edges = sum(len(each) for each in values)
    size = n + count + edges
    places = np.arange(count)
    gains = sparse.csr_array((np.full(count, -1.0), (allowed, n + places)), shape=(n, size))
    blocks, right, start = [], [], n + count
    for own, value, (_, sums) in zip(pairs, values, rows.values(), strict=True):
        here = start + np.arange(len(value))
        blocks.append(sparse.csr_array((value, (own[:, 0], here)), shape=(n, size)) + gains)
        right.append(np.array([float(total) for total in sums]) - rate)
        start += len(value)
    caps = np.array([float(request.caps.get(i, np.inf)) for i in request.allowed])
    capped = np.flatnonzero(np.isfinite(caps))
    unit = sparse.eye_array(size, format="csr")
    blocks += [unit[:n], -unit[:n], -unit[n : n + count], unit[n + capped]]
    right += [np.full(n, SPAN), np.zeros(n), np.zeros(count), caps[capped]]
    linear_rows = sum(len(each) for each in right)
    both = np.concatenate(pairs)
    blocks.append(_exponentials(both, n + count, size))
    right.append(np.tile([0.0, 1.0, 0.0], edges))
    cost = np.concatenate([np.zeros(n), [float(request.costs[i]) for i in request.allowed], np.zeros(edges)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    cones = [clarabel.NonnegativeConeT(linear_rows)] + [clarabel.ExponentialConeT()] * edges
    matrix = sparse.csc_matrix(sparse.vstack(blocks))
    nothing = sparse.csc_matrix((size, size))
    return clarabel.DefaultSolver(nothing, cost, matrix, np.concatenate(right), cones, settings).solve()


def _exponentials(pairs: Any, start: int, size: int) -> Any:
    """Minus the rows (u_j - u_i, 1, t) of every arc; the 1 stands on the right side."""
    edges = len(pairs)
    place = 3 * np.arange(edges)
    rows = np.concatenate([place, place, place + 2])
    columns = np.concatenate([pairs[:, 1], pairs[:, 0], start + np.arange(edges)])
    return sparse.csr_array((np.repeat([-1.0, 1.0, -1.0], edges), (rows, columns)), shape=(3 * edges, size))


def _fitted(request: PinningRequest, weights: dict[str, Vector]) -> dict[str, Vector]:
    """Weights scaled down where they exceed the cost of an agent whose gain has no cap."""
    factor = {}
    for i in set(request.allowed) - set(request.caps):
        total = sum((q[i] for q in weights.values()), Fraction(0))
        if total > request.costs[i]:
            factor[i] = request.costs[i] / total
    return {mode: tuple(x * factor.get(i, 1) for i, x in enumerate(q)) for mode, q in weights.items()}


def _rational(values: Array) -> Vector:
    top = float(np.max(np.abs(values), initial=0.0))
    unit = BITS / 2.0 ** math.ceil(math.log2(top)) if top > 0 else 1.0
    return tuple(Fraction(max(0, round(float(x) * unit))) / Fraction(unit) for x in values)


def _balancing(pairs: Any, sizes: Array, start: Array) -> Array:
    """v that makes size v_j / v_i balanced at every agent: the least of their convex sum, by damped Newton steps."""
    n, u = len(start), np.log(start)
    if not len(pairs):
        return start
    i, j = pairs[:, 0], pairs[:, 1]

    def flow(u: Array) -> Array:
        with np.errstate(over="ignore"):
            return np.asarray(sizes * np.exp(u[j] - u[i]))

    for _ in range(STEPS):
        f = flow(u)
        gradient = np.bincount(j, f, n) - np.bincount(i, f, n)
        if np.max(np.abs(gradient)) <= 1e-15 * np.max(f):
            break
        both = sparse.csr_array((f, (i, j)), shape=(n, n))
        both = both + both.T
        degree = np.asarray(both.sum(axis=1)).ravel()
        hessian = sparse.diags_array(degree * (1 + 1e-13) + 1e-14 * np.max(degree)) - both
        step = -sparse.linalg.spsolve(sparse.csc_array(hessian), gradient)
        step *= min(1.0, 1.0 / max(float(np.max(np.abs(step))), 1e-300))
        part = 1.0
        while part > 1e-6 and not np.sum(flow(u + part * step)) <= np.sum(f):
            part /= 2
        if part <= 1e-6:
            break
        u = u + part * step
    return np.asarray(np.exp(u - np.max(u)))


def _circulation(pairs: Any, sizes: Array, v: Array, group: Any) -> dict[tuple[int, int], Fraction] | None:
    """Balanced flows, integers over one denominator, at most size v_j / v_i; surplus is taken back along trees."""
    if not len(pairs):
        return {}
    n = len(v)
    real = sizes * v[pairs[:, 1]] / v[pairs[:, 0]] * (1 - 1e-11)
    unit = Fraction(BITS) / Fraction(2) ** math.ceil(math.log2(float(np.max(real))))
    flows = {(int(i), int(j)): int(float(x) * float(unit)) for (i, j), x in zip(pairs, real, strict=True)}
    balance = [0] * n
    for (i, j), x in flows.items():
        balance[i] += x
        balance[j] -= x
    graph = sparse.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    for root in np.unique(group[pairs[:, 0]], return_index=True)[1].tolist():
        top = int(pairs[root, 0])
        for matrix, sign in ((graph.T.tocsr(), 1), (graph, -1)):  # towards the root, then away from it
            order, before = breadth_first_order(matrix, top, return_predecessors=True)
            for agent in order[:0:-1].tolist():
                surplus, parent = sign * balance[agent], int(before[agent])
                if surplus > 0:
                    flows[(agent, parent) if sign > 0 else (parent, agent)] -= surplus
                    balance[agent] -= sign * surplus
                    balance[parent] += sign * surplus
    if any(balance) or min(flows.values()) < 0:
        return None
    return {pair: Fraction(x) / unit for pair, x in flows.items()}
