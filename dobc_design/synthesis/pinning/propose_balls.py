"""Proposals for the smallest gains with which V = e'e decays over a ball, all arc gains in their sectors (Lur'e).

With P_e = I the inequality of theory, section 4, is affine in the gains k, in the multipliers and in their inverses:
with t s >= 1 for every channel of half-width d, and N0 the part with the middle gains,

    minimise  sum c_i k_i   subject to   N0 + 2 rate I + sum d (s b b' + t c c') - 2 K < 0   in every mode.

No closed form is known: the worst gain of an arc depends on the direction.  Floating point: a proposal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.conditions.quadratic.claim import linear_part
from dobc_design.conditions.quadratic.sectors import Channel, Sectors
from dobc_design.solvers.program import Array, is_solver_failure
from dobc_design.synthesis.pinning.request import PinningRequest

ROOT2 = math.sqrt(2.0)
MOST_ROWS = 60  # n m: the inequality of every mode is a dense cone


@dataclass(frozen=True, slots=True, kw_only=True)
class BallProposal:
    """Gains (n,) in 1/s, and the multipliers tau of every mode, one per channel, 0 where its gain is one number."""

    gains: tuple[float, ...]
    multipliers: Mapping[str, tuple[float, ...]]


def propose_for_ball(
    sectors: Sectors, request: PinningRequest, *, rate: float, time_limit: float = 60.0
) -> Iterator[BallProposal]:
    """The cheapest gains on the allowed agents for the sectors of a problem without gains; nothing if too large."""
    import clarabel

    if sectors.size > MOST_ROWS:
        return
    try:
        answer = _run(sectors, request, rate, clarabel, time_limit)
    except BaseException as error:  # Clarabel panics with pyo3's PanicException, which is no Exception
        if not is_solver_failure(error):
            raise
        return
    x = np.asarray(answer.x, dtype=np.float64)
    if "Infeasible" in str(answer.status) or not np.all(np.isfinite(x)):
        return
    n, count = sectors.problem.n, len(request.allowed)
    gains = np.zeros(n)
    gains[list(request.allowed)] = np.maximum(x[:count], 0.0)
    multipliers, start = {}, count
    for mode, channels in sectors.modes.items():
        wide = [each for each in channels if each.spread]
        t = iter(x[start : start + len(wide)].tolist())
        multipliers[mode] = tuple(next(t) / (2 * float(each.spread)) if each.spread else 0.0 for each in channels)
        start += 2 * len(wide)
    yield BallProposal(gains=tuple(gains.tolist()), multipliers=multipliers)


def _run(sectors: Sectors, request: PinningRequest, rate: float, clarabel: Any, time_limit: float) -> Any:
    """Unknowns: the gains of the allowed agents; then of every mode t, then s, of its channels with a range."""
    m, size = sectors.problem.m, sectors.size
    count = len(request.allowed)
    wide = {mode: [each for each in channels if each.spread] for mode, channels in sectors.modes.items()}
    unknowns = count + 2 * sum(map(len, wide.values()))
    rows, right, cones = [], [], []
    start = count
    for mode, channels in wide.items():
        columns = [_columns([_pin(size, i, m) for i in request.allowed], size)]
        columns.append(sparse.csc_array((size * (size + 1) // 2, start - count)))
        columns.append(_columns([float(each.spread) * _difference(size, each) for each in channels], size))
        columns.append(_columns([float(each.spread) * _unit(size, each.target) for each in channels], size))
        start += 2 * len(channels)
        columns.append(sparse.csc_array((size * (size + 1) // 2, unknowns - start)))
        rows.append(sparse.hstack(columns, format="csc"))
        right.append(-_svec(_middle(sectors, mode, rate)))
        cones.append(clarabel.PSDTriangleConeT(size))
    caps = np.array([float(request.caps.get(i, np.inf)) for i in request.allowed])
    capped = np.flatnonzero(np.isfinite(caps))
    unit = sparse.eye_array(unknowns, format="csr")
    rows += [-unit[:count], unit[capped]]
    right += [np.zeros(count), caps[capped]]
    cones.append(clarabel.NonnegativeConeT(count + len(capped)))
    start = count
    for channels in wide.values():
        for place in range(start, start + len(channels)):
            t, s = unit[[place]], unit[[place + len(channels)]]
            rows.append(sparse.vstack([-(t + s), -(t - s), sparse.csr_array((1, unknowns))]))
            right.append(np.array([0.0, 0.0, 2.0]))
            cones.append(clarabel.SecondOrderConeT(3))
        start += 2 * len(channels)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    linear = np.concatenate([[float(request.costs[i]) for i in request.allowed], np.zeros(unknowns - count)])
    matrix = sparse.csc_matrix(sparse.vstack(rows))
    nothing = sparse.csc_matrix((unknowns, unknowns))
    return clarabel.DefaultSolver(nothing, linear, matrix, np.concatenate(right), cones, settings).solve()


def _middle(sectors: Sectors, mode: str, rate: float) -> Array:
    """A + A' + 2 rate I with the middle gains."""
    table = np.zeros((sectors.size, sectors.size))
    for i, row in linear_part(sectors, mode, [each.centre for each in sectors.modes[mode]]).items():
        for j, value in row.items():
            table[i, j] = float(value)
    return table + table.T + 2 * rate * np.eye(sectors.size)


def _pin(size: int, agent: int, m: int) -> Array:
    table = np.zeros((size, size))
    table[range(agent * m, agent * m + m), range(agent * m, agent * m + m)] = -2.0
    return table


def _difference(size: int, channel: Channel) -> Array:
    """c c'."""
    c = np.zeros(size)
    c[channel.plus], c[channel.minus] = 1.0, -1.0
    return np.outer(c, c)


def _unit(size: int, row: int) -> Array:
    """b b'."""
    table = np.zeros((size, size))
    table[row, row] = 1.0
    return table


def _columns(tables: list[Array], size: int) -> Any:
    if not tables:
        return sparse.csc_array((size * (size + 1) // 2, 0))
    return sparse.hstack([sparse.csc_array(_svec(table)[:, None]) for table in tables], format="csc")


def _svec(table: Array) -> Array:
    """Upper triangle, column by column, off-diagonal entries times sqrt 2 (Clarabel's order)."""
    rows, columns = np.triu_indices(len(table))
    order = np.lexsort((rows, columns))
    rows, columns = rows[order], columns[order]
    return np.asarray(table[rows, columns] * np.where(rows == columns, 1.0, ROOT2))
