"""The smallest pinning gains: minimise sum c_i k_i over k >= 0 subject to Lambda(K) <= -2 beta I
(theory, section 7), or, with weights of V, subject to mu(M) >= beta (section 10), M = K - J, mu its
least real part of an eigenvalue.

Where J has no negative entry off its diagonal, mu(M) >= beta iff M v >= beta v for a v > 0, in each
strongly connected part of the network by itself.  There k_i = beta - (M0 v)_i / v_i on the pins,
the other rows are 0, and the sum is convex in log v: Newton's method.

Where -(J + J') is a Z-matrix the optimum has a closed form.  Gains that several Z-matrices share
are a geometric program, solved through its dual: the cost of every pinned agent is shared, sum over
r of v_r,i^2 <= c_i, and -1/2 sum of v_r' S_r v_r maximised, where the others follow by one solve;
the gains are its prices.  Others go to a conic program, or get gains that are not the smallest.
All is floating point and on the boundary: round up, then decide exactly.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import linalg, optimize, sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import cg, eigs

from dobc_design._checks import noun
from dobc_design.conditions.numbers import bisected
from dobc_design.exact.matrix import Array, largest_entry
from dobc_design.loop.loop import Loop
from dobc_design.solvers.conic import Cone, smat, solve_cones, svec, svec_diagonal
from dobc_design.solvers.program import factored

from .propose import (
    dominating_vector,
    float_lambda,
    is_symmetric,
    largest_eigenvalue,
    rows_of,
)

DENSE = 50  # rows up to which a dense solve is the faster one
FULL = 0.3  # part of the entries from which it is, whatever the size
CAP_EDGE = 1e-9  # a gain above its cap by less (relatively) is at it
PROGRAM_ROWS = 80  # rows of one block up to which the conic program is solved
PROGRAM_SIZE = 40_000  # squared rows of all blocks together
ACCURACY = 1e-10  # of the conic program
LARGE = 3000  # rows from which conjugate gradients go first
ITERATIONS = 300  # of conjugate gradients
ENOUGH = 1e-6  # of the cost: a bound this close leaves nothing to look for
SINGULAR = 1e-11  # relative to the entries: smaller eigenvalues are not told from 0 here
STEPS = 60  # of a bisection
FEW_ROWS = 15  # up to which a conic program is the quicker way to shared gains
ROWS = 5000  # agents up to which factors of sparse networks stay small
DUAL_STEPS = 1500
NEGATIVE = 1e-10  # relative to the entries: what counts as a gain below 0 there
DENSE_PARTS = 200  # rows up to which all eigenvalues are computed
MANY_PINS = 2000  # pins from which v is not balanced
SHIFT = 1e-3  # of the largest entry: how far from the discs eigenvalues are looked for
NEWTON = 200  # steps towards the smallest gains at most
CLOSE = 1e-10  # the relative imbalance where they end
UNUSED = 0.1  # the part of the cost that is nobody's at the beginning, to mode 1's
# What the gains are raised by, relatively, until all matrices are definite.
RISES = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
# Gains below this part of the largest are left out:
NOISE = 1e-8  # noise of the conic solver
SMALL = 1e-9  # noise of the dual
# For the factors: an order that suits a symmetric pattern, and no exchange of rows.  A random graph
# of degree 8 with 2000 agents takes a quarter of the time (0.09 s in place of 0.34 s), with 40 % of
# the entries in the factor.
SYMMETRIC: Any = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "options": {"SymmetricMode": True},
}


@noun(eq=False)
class Blocks:
    """S = -(J + J') - 2 beta I of every mode (by component with ``width`` 1), equal ones once: S +
    2 k_i on the rows of agent i is to be >= 0.  ``z``: no entry off the diagonal is > 0;
    ``sources``: the mode and component of each. ``weighted``: S = -2 J - 2 beta I, not symmetric,
    is to have no eigenvalue with a negative real part."""

    agents: int
    width: int
    tables: tuple[Any, ...]
    scale: float
    z: bool
    sources: tuple[tuple[str, int], ...] = ()
    weighted: bool = False


@noun(eq=False)
class Shared:
    """Gains k (n,) that serve all blocks, and the vectors v of every block that show how good they
    are: sum v v'/2 is its multiplier (of one Z-matrix, v_i^2 >= c_i at a cap, <= c_i at 0); with
    the ``bound`` of the cost, if known."""

    gains: Array
    vectors: list[list[Array]]
    bound: float = 0.0


def network_blocks(loop: Loop, *, pins: bool = False, weighted: bool = False) -> Blocks | None:
    """The blocks, beta = 0; None beyond the floats.  ``pins``: the present gains stay.
    ``weighted``: V has weights."""
    m = loop.m
    whole = []
    for mode in loop.modes:
        lambda_ = float_lambda(loop, mode, pins=pins, twice=weighted)
        table = sparse.coo_array(-lambda_)
        table.sum_duplicates()
        table.eliminate_zeros()
        if not np.all(np.isfinite(table.data)):
            return None
        whole.append(table)
    # Where no component acts on another, each is a smaller problem by itself.
    apart = all(np.all((table.row - table.col) % m == 0) for table in whole)
    width = 1 if apart else m
    step = m // width
    tables: dict[bytes, Any] = {}
    sources: dict[bytes, tuple[str, int]] = {}
    for mode, table in zip(loop.modes, whole, strict=True):
        for component in range(step):
            each = table.tocsr()[component::step, component::step]
            each.sum_duplicates()
            key = each.indptr.tobytes() + each.indices.tobytes() + each.data.tobytes()
            tables.setdefault(key, each)
            sources.setdefault(key, (mode, component))
    largest = [largest_entry(each.data) for each in tables.values()]
    return Blocks(
        agents=loop.n,
        width=width,
        tables=tuple(tables.values()),
        scale=max(largest, default=0.0),
        z=width == 1 and all(map(_is_z_matrix, tables.values())),
        sources=tuple(sources.values()),
        weighted=weighted,
    )


def _is_z_matrix(table: Any) -> bool:
    """Whether no entry off the diagonal is > 0."""
    entries = sparse.coo_array(table)
    return bool(np.all((entries.data <= 0) | (entries.row == entries.col)))


def for_rate(blocks: Blocks, rate: float) -> Blocks:
    """The same blocks for a rate beta (1/s): S - 2 beta I."""
    tables = []
    for table in blocks.tables:
        shift = 2 * rate * sparse.eye_array(table.shape[0])
        tables.append(sparse.csr_array(table - shift))
    return replace(blocks, tables=tuple(tables), scale=max(blocks.scale, 2 * rate))


def fastest_rate(blocks: Blocks, allowed: Collection[int]) -> float:
    """The rate (1/s) that gains on the ``allowed`` agents approach as they grow; positive iff some
    gains can do."""
    rows = rows_of(np.setdiff1d(np.arange(blocks.agents), list(allowed)), blocks.width)
    return min((lowest_on(table, rows)[0] / 2 for table in blocks.tables), default=0.0)


def rough_rate(blocks: Blocks, allowed: Collection[int]) -> float:
    """``fastest_rate``; of large symmetric Z-matrices a lower bound close to it, which takes fewer
    products."""
    others = np.setdiff1d(np.arange(blocks.agents), list(allowed))
    if not blocks.z or len(others) <= LARGE:
        return fastest_rate(blocks, allowed)
    least = math.inf
    for table in blocks.tables:
        block = table[others][:, others]
        found = dominating_vector(-block) if is_symmetric(block) else None
        if found is None or not found.least > 0:
            least = min(least, lowest_on(table, others)[0])
        else:
            least = min(least, found.least)
    return least / 2


def smallest_gains(blocks: Blocks, allowed: Collection[int]) -> Array | None:
    """The gains k (n,) of least sum on the ``allowed`` agents, about; None if none can do."""
    if not blocks.z and fastest_rate(blocks, allowed) <= 1e-9 * blocks.scale:
        return None
    chosen = np.isin(np.arange(blocks.agents), list(allowed))
    found = cheapest_gains(blocks, chosen, np.ones(blocks.agents))
    return None if found is None else found.gains


def cheapest_gains(
    blocks: Blocks, chosen: Any, costs: Array, caps: Array | None = None
) -> Shared | None:
    """The gains of least cost found on the ``chosen`` agents (n,), or gains that suffice; None if
    none can do."""
    found = valid_gains(blocks, chosen, costs, caps) if blocks.z else None
    # The closed form is the optimum of one matrix, and no shared one is known with weights of V.
    if blocks.z and (found is None or len(blocks.tables) == 1 or blocks.weighted):
        return found
    if found is not None and blocks.agents > FEW_ROWS:
        shared = solve_shared(blocks.tables, chosen, costs, caps)
        if shared is not None:
            found = _cheaper(found, shared, costs)
            cost = float(costs @ shared.gains)
            if cost - shared.bound <= ENOUGH * cost:
                return found
    rows = blocks.agents * blocks.width
    if rows <= PROGRAM_ROWS and rows * rows * len(blocks.tables) <= PROGRAM_SIZE:
        program = solve_program(blocks, np.flatnonzero(chosen), costs, caps)
        if program is not None:
            return _cheaper(found, program, costs)
    # One gain for all need not stay below the caps.
    if found is None and (caps is None or not np.any(np.isfinite(caps))):
        gains = _alike(blocks, chosen)
        if gains is not None:
            found = Shared(gains=gains, vectors=[[] for _ in blocks.tables])
    return found


def valid_gains(
    blocks: Blocks, chosen: Any, costs: Array, caps: Array | None = None
) -> Shared | None:
    """For Z-matrices: of each agent the largest gain of the closed forms (theory, 7 and 10);
    Lambda only falls when a gain rises."""
    found = []
    for table in blocks.tables:
        own = table if is_symmetric(table) else within_parts(table)
        found.append(_with_caps(_uncapped, [own], chosen, costs, caps))
    known = [each for each in found if each is not None]
    if len(known) < len(found):
        return None
    best = max(range(len(known)), key=lambda k: costs @ known[k].gains)
    vectors: list[list[Array]] = [[] for _ in known]
    if not blocks.weighted:
        vectors[best] = known[best].vectors[0]
    gains = np.max([each.gains for each in known], axis=0)
    return Shared(gains=gains, vectors=vectors)


def _cheaper(found: Shared | None, other: Shared, costs: Array) -> Shared:
    """The cheaper gains; where they cost about the same, the vectors of all blocks."""
    if found is None:
        return other
    cost = costs @ other.gains
    present = costs @ found.gains
    if cost < present:
        return other
    if cost < present * 1.000001:
        return replace(found, vectors=other.vectors)
    return found


def _factors(Z: Array, *, z: bool) -> list[Array]:
    """Vectors with sum v v'/2 = Z, about; of a Z-matrix the one with the same diagonal, which is no
    worse."""
    if z:
        return [np.sqrt(np.maximum(2 * np.diag(Z), 0.0))]
    values, vectors = np.linalg.eigh((Z + Z.T) / 2)
    top = float(np.max(values, initial=0.0))
    return [
        np.sqrt(2 * value) * vectors[:, k]
        for k, value in enumerate(values)
        if value > 1e-10 * top > 0
    ]


def _with_caps(
    solve: Callable[..., Shared | None],
    tables: Sequence[Any],
    chosen: Any,
    costs: Array,
    caps: Array | None,
) -> Shared | None:
    """An agent whose gain would exceed its cap (inf: none) is held at it, which only raises the
    gains of the others."""
    limits = np.full(len(costs), np.inf) if caps is None else caps
    full = np.zeros(len(costs), dtype=bool)
    held = tables
    # Every round holds one agent more at least.
    for _ in range(int(np.sum(chosen)) + 1):
        extra = np.where(full, limits, 0.0)
        if np.any(full):
            pull = sparse.diags_array(2 * extra)
            held = [sparse.csr_array(table + pull) for table in tables]
        found = solve(held, chosen & ~full, costs)
        if found is None:
            return None
        over = found.gains > limits * (1 + CAP_EDGE)
        if not np.any(over):
            bound = found.bound + float(costs @ extra)
            return replace(found, gains=found.gains + extra, bound=bound)
        full |= over
    return None


def _uncapped(tables: Sequence[Any], chosen: Any, weights: Array) -> Shared | None:
    """v: (S v)_i = 0 off the chosen; k_i = -(S v)_i / (2 v_i).  An agent whose gain would be
    negative is set free."""
    (table,) = tables
    active = np.array(chosen, dtype=bool)
    v = np.zeros(len(weights))
    size = largest_entry(table.data)
    for _ in range(int(active.sum()) + 1):
        free = np.flatnonzero(~active)
        v[active] = _on_pins(table, active, weights, size=size)
        if len(free):
            held = np.flatnonzero(active)
            rows = table[free]
            solution = _solve(rows[:, free], -(rows[:, held] @ v[held]), size=size)
            if solution is None:
                return None
            v[free] = np.maximum(solution, 0.0)
        flow = table @ v
        gains = np.where(active, -flow / (2 * np.where(active, v, 1.0)), 0.0)
        negative = active & (gains < -NEGATIVE * size)
        if not np.any(negative):
            return Shared(gains=np.maximum(gains, 0.0), vectors=[[v]])
        active &= ~negative
    return None


def within_parts(table: Any) -> Any:
    """The entries within strongly connected parts of the pattern, which alone have the
    eigenvalues."""
    _, owner = csgraph.connected_components(table, connection="strong")
    entries = sparse.coo_array(table)
    kept = owner[entries.row] == owner[entries.col]
    places = entries.row[kept], entries.col[kept]
    return sparse.csr_array((entries.data[kept], places), shape=table.shape)


def _on_pins(table: Any, active: Any, weights: Array, *, size: float) -> Array:
    """v on the ``active`` agents for which, with (S v)_i = 0 on the others, the sum of the gains is
    least."""
    pins = np.flatnonzero(active)
    others = np.flatnonzero(~active)
    own = weights[pins]
    if len(pins) > MANY_PINS or is_symmetric(table):
        return np.sqrt(own)
    flows = table[pins][:, pins].toarray()
    if len(others) and len(pins):
        inner = table[others][:, others]
        if _solve(inner, np.ones(len(others)), size=size) is None:
            return np.sqrt(own)
        # The others follow the pins: what flows between pins through them (Schur complement).
        across = table[others][:, pins].toarray()
        solve = factorised(inner)
        flows -= table[pins][:, others] @ solve(across).reshape(across.shape)
    return _balance(-flows * own[:, None])


def _balance(flows: Array) -> Array:
    """v > 0 with the least sum of flows_ij v_j / v_i, entries >= 0 off the diagonal: row sums equal
    column sums."""
    logs = np.zeros(len(flows))
    for _ in range(NEWTON):
        moved = flows * np.exp(logs[None, :] - logs[:, None])
        np.fill_diagonal(moved, 0.0)
        out = moved.sum(axis=1)
        back = moved.sum(axis=0)
        both = out + back
        if np.all(np.abs(out - back) <= CLOSE * both):
            break
        # The Hessian, a little more on its diagonal: a constant in each part changes nothing.
        diagonal = np.where(both > 0, both * (1 + CLOSE), 1.0)
        whole = np.diag(diagonal) - moved - moved.T
        step = np.linalg.solve(whole, out - back)
        logs += step / max(1.0, largest_entry(step))
    return np.asarray(np.exp(logs))


def _solve(matrix: Any, right: Array, *, size: float) -> Array | None:
    """Solve M x = right for a Z-matrix M; None unless M is a nonsingular M-matrix (M w = 1 has a
    solution w > 0)."""
    if len(right) > LARGE and is_symmetric(matrix):
        quick = _iterated(matrix, right)
        if quick is not None:
            return quick
    both = np.column_stack([right, np.ones(len(right))])
    try:
        if len(right) <= DENSE or matrix.nnz > FULL * len(right) ** 2:
            answer = np.linalg.solve(matrix.toarray(), both)
        else:
            answer = factored(matrix, **SYMMETRIC).solve(both)
    except (np.linalg.LinAlgError, RuntimeError, ValueError):  # singular
        return None
    w = answer[:, 1]
    if not np.all(np.isfinite(answer)) or not np.all(w > 0):
        return None
    if float(np.max(w)) * size * SINGULAR > 1:  # singular but for rounding
        return None
    x: Array = answer[:, 0]
    return x


def factorised(matrix: Any) -> Callable[[Array], Array]:
    """How to solve with a sparse matrix, again and again.  Raises: RuntimeError if it is
    singular."""
    solve: Callable[[Array], Array] = factored(matrix, **SYMMETRIC).solve
    return solve


def _iterated(matrix: Any, right: Array) -> Array | None:
    """The same by conjugate gradients where they are quick: random graphs fill up a factor, a long
    path does not."""
    diagonal = matrix.diagonal()
    if not np.all(diagonal > 0):
        return None
    scaling = sparse.diags_array(1 / diagonal)

    def solution(side: Array, tolerance: float) -> Array | None:
        x, status = cg(matrix, side, rtol=tolerance, maxiter=ITERATIONS, M=scaling)
        return x if status == 0 and np.all(np.isfinite(x)) else None

    # w only shows that M is an M-matrix, so that its first digits are enough.
    w = solution(np.ones(len(right)), 1e-3)
    x = None if w is None else solution(right, 1e-14)
    if w is None or x is None:
        return None
    return x if np.all(w > 0) and np.all(matrix @ w > 0) else None


def looseness(blocks: Blocks, allowed: Collection[int]) -> float:
    """How loosely gains on the ``allowed`` agents hold the others, however large they are; inf if
    they cannot: 1'M^-1 1 of a Z-matrix M = S on the others, which takes one solve; otherwise one
    over the smallest eigenvalue."""
    if not blocks.z:
        rate = fastest_rate(blocks, allowed)
        if rate == np.inf:
            return 0.0
        return 1 / rate if rate > 1e-9 * blocks.scale else np.inf
    others = np.setdiff1d(np.arange(blocks.agents), list(allowed))
    worst = 0.0
    for table in blocks.tables if len(others) else ():
        found = _solve(table[others][:, others], np.ones(len(others)), size=blocks.scale)
        worst = np.inf if found is None else max(worst, float(np.sum(found)))
    return worst


def lowest_on(table: Any, rows: Any) -> tuple[float, Array]:
    """The least real part of an eigenvalue of a principal submatrix, and how much a gain on each
    row would raise it."""
    if not len(rows):
        return float("inf"), np.zeros(0)
    block = sparse.csr_array(table[rows][:, rows])
    if not is_symmetric(block):
        return _lowest_of_parts(block)
    top = largest_eigenvalue(sparse.coo_array(-table[rows][:, rows]))
    return -top.value, top.vector


def _lowest_of_parts(block: Any) -> tuple[float, Array]:
    """The same for a Z-matrix without symmetry: the eigenvalue and u_i w_i of its left and right
    eigenvectors."""
    inner = sparse.csc_array(within_parts(block))
    if inner.shape[0] <= DENSE_PARTS:
        values, left, right = linalg.eig(inner.toarray(), left=True)
        place = int(np.argmin(values.real))
        value = values[place]
        u = left[:, place]
        w = right[:, place]
    else:  # the eigenvalues lie to the right of all discs
        diagonal = inner.diagonal()
        ends = 2 * diagonal - abs(inner).sum(axis=1)
        shift = float(np.min(ends)) - SHIFT * largest_entry(diagonal)
        start = np.ones(inner.shape[0])
        (value,), right = eigs(inner, 1, sigma=shift, v0=start)
        _, left = eigs(inner.T, 1, sigma=shift, v0=start)
        u = left[:, 0]
        w = right[:, 0]
    return float(value.real), np.abs(u * w)


def slowest_on(blocks: Blocks, agents: Array) -> Array:
    """How much each of these agents carries of the slowest direction of the worst block."""
    rows = rows_of(agents, blocks.width)
    lowest = (lowest_on(table, rows) for table in blocks.tables)
    _, vector = min(lowest, key=lambda found: found[0])
    by_agent = np.abs(vector.reshape(len(agents), blocks.width))
    weights: Array = np.max(by_agent, axis=1)
    return weights


def _alike(blocks: Blocks, chosen: Any) -> Array | None:
    """One gain for all chosen agents, by bisection; None if the largest one tried does not do."""
    indicator = np.repeat(chosen.astype(np.float64), blocks.width)

    def does(gain: float) -> bool:
        held = sparse.diags_array(2 * gain * indicator)
        everything = np.arange(len(indicator))
        return all(lowest_on((table + held).tocsr(), everything)[0] > 0 for table in blocks.tables)

    def middle(high: float, low: float) -> float:
        return (low * high) ** 0.5 if low else high / 100

    def close(high: float, low: float) -> bool:
        if high <= low * (1 + 1e-6) or high < blocks.scale * 1e-9:
            return True
        return not low < middle(high, low) < high  # floats end

    most = blocks.scale * 1e6
    if not most or not does(most):
        return None
    gain, _ = bisected(does, most, 0.0, steps=STEPS, middle=middle, close=close)
    return np.asarray(gain * chosen.astype(np.float64))


def solve_program(
    blocks: Blocks, allowed: Any, costs: Array, caps: Array | None = None
) -> Shared | None:
    """Minimise c'k, S + 2 sum k_i E_i >= 0 for every block, 0 <= k <= ``caps`` (n,); None if none
    are found."""
    count = len(allowed)
    scale = blocks.scale
    width = blocks.width
    if not count or not scale > 0:
        return None
    # -2 svec(E_i), one column per allowed agent: what its gain adds to every block.
    size = len(costs) * width
    places = svec_diagonal(size)[rows_of(allowed, width)], np.repeat(np.arange(count), width)
    entries = np.full(count * width, -2.0)
    columns = sparse.csc_array((entries, places), shape=(size * (size + 1) // 2, count))
    cones = [Cone("semidefinite", columns, svec(table / scale)) for table in blocks.tables]
    cones.append(Cone("nonnegative", -sparse.eye_array(count), np.zeros(count)))
    own = np.full(count, np.inf) if caps is None else caps[allowed]
    capped = np.flatnonzero(np.isfinite(own))
    if len(capped):
        chosen = sparse.eye_array(count).tocsr()[capped]
        cones.append(Cone("nonnegative", chosen, own[capped] / scale))
    answer = solve_cones(costs[allowed], cones, time_limit=20.0, accuracy=ACCURACY)
    if not answer.found:
        return None
    gains = np.zeros(len(costs))
    gains[allowed] = np.maximum(answer.x, 0.0) * scale
    gains[gains < NOISE * np.max(gains, initial=0.0)] = 0.0
    ends = np.cumsum([len(each.right) for each in cones])
    parts = np.split(answer.multipliers, ends)[: len(blocks.tables)]
    return Shared(gains=gains, vectors=[_factors(smat(part), z=blocks.z) for part in parts])


@noun(eq=False)
class _Block:
    """One matrix, split into pinned rows and others; ``factor`` is that of the others, None if
    there are none."""

    own: Any
    across: Any
    factor: Any

    def follow(self, v: Array) -> Array:
        """v on the other agents, where S v is 0."""
        if self.factor is None:
            return np.zeros(0)
        return np.asarray(-self.factor.solve(self.across.T @ v))

    def flow(self, v: Array) -> Array:
        """S v on the pinned agents."""
        flow = self.own @ v
        if self.factor is not None:
            flow = flow + self.across @ self.follow(v)
        return np.asarray(flow)


def solve_shared(
    tables: Sequence[Any], chosen: Any, costs: Array, caps: Array | None = None
) -> Shared | None:
    """Gains of least cost on the ``chosen`` agents (n,) for symmetric Z-matrices (n, n); None if
    none are found."""
    return _with_caps(_uncapped_shared, tables, chosen, costs, caps)


def _uncapped_shared(tables: Sequence[Any], chosen: Any, costs: Array) -> Shared | None:
    """``solve_shared`` without caps, through the dual; its gains are raised until they do."""
    pins = np.flatnonzero(chosen)
    others = np.flatnonzero(~chosen)
    if not len(pins) or len(costs) > ROWS:
        return None
    try:
        blocks = [_split(table, pins, others) for table in tables]
    except RuntimeError:  # exactly singular
        return None
    scale = max(largest_entry(table.data) for table in tables)
    if not scale > 0:
        return None
    dual = _Dual(blocks=blocks, root=np.sqrt(costs[pins]), scale=scale)
    shares = dual.solved()
    flows = dual.flows(shares)
    # Gains are the mean of what the matrices ask for, weighted by their shares.
    gains = np.zeros(len(costs))
    gains[pins] = np.maximum(0.0, -np.sum(shares * flows, axis=0) / (2 * costs[pins]))
    gains[gains < SMALL * np.max(gains)] = 0.0
    raised = _raised(tables, gains)
    if raised is None:
        return None
    vectors = []
    for block, v in zip(blocks, shares, strict=True):
        whole = np.zeros(len(costs))
        whole[pins] = v
        whole[others] = np.maximum(block.follow(v), 0.0)
        vectors.append([whole])
    return Shared(gains=raised, vectors=vectors, bound=-float(np.sum(shares * flows)) / 2)


@noun(eq=False)
class _Dual:
    """How the cost of every pin is shared among the matrices: v_r on the pins, sum over r of
    v_r,i^2 <= c_i, ``root`` = sqrt(c)."""

    blocks: Sequence[_Block]
    root: Array
    scale: float

    def flows(self, shares: Array) -> Array:
        """S_r v_r on the pins, of every matrix."""
        return np.array([block.flow(v) for block, v in zip(self.blocks, shares, strict=True)])

    def on_spheres(self, x: Array) -> tuple[Array, Array]:
        """The lengths of the columns of x, one per pin, and these: a part for every matrix and one
        that nobody uses."""
        parts = x.reshape(len(self.blocks) + 1, -1)
        norms = np.sqrt(np.sum(parts**2, axis=0))
        return norms, parts / norms

    def value(self, x: Array) -> tuple[float, Array]:
        """Half of the sum of v_r'S_r v_r, to be minimised, and its slope."""
        norms, unit = self.on_spheres(x)
        shares = self.root * unit[:-1]
        flows = self.flows(shares)
        slope = np.zeros_like(unit)
        slope[:-1] = flows * self.root
        slope = (slope - unit * np.sum(slope * unit, axis=0)) / norms
        return float(np.sum(shares * flows)) / (2 * self.scale), (slope / self.scale).ravel()

    def solved(self) -> Array:
        """The v_r >= 0 (matrices, pins) that were found."""
        start = np.ones((len(self.blocks) + 1, len(self.root)))
        start[-1] = UNUSED
        options: Any = {
            "maxiter": DUAL_STEPS,
            "maxfun": 2 * DUAL_STEPS,
            "maxcor": 20,
            "ftol": 1e-15,
            "gtol": 1e-12,
        }
        answer = optimize.minimize(
            self.value, start.ravel(), jac=True, method="L-BFGS-B", options=options
        )
        _, unit = self.on_spheres(answer.x)
        return np.asarray(self.root * np.abs(unit[:-1]))


def _raised(tables: Sequence[Any], gains: Array) -> Array | None:
    """The gains, raised a little until all matrices are definite; None if that is not enough."""
    for rise in RISES:
        raised = gains * (1 + rise)
        pull = sparse.diags_array(2 * raised)
        ones = np.ones(len(raised))
        try:  # a Z-matrix is positive definite if its inverse is >= 0
            held = [factorised(table + pull)(ones) for table in tables]
        except RuntimeError:  # exactly singular
            continue
        if all(np.all(np.isfinite(w)) and np.all(w > 0) for w in held):
            return raised
    return None


def _split(table: Any, pins: Any, others: Any) -> _Block:
    rows = sparse.csr_array(table)[pins]
    factor = factored(table[others][:, others], **SYMMETRIC) if len(others) else None
    return _Block(own=rows[:, pins], across=rows[:, others], factor=factor)
