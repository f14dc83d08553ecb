"""The conic program behind shared gains: minimise c'k subject to S + 2 sum k_i E_i >= 0 for every block, k >= 0.

E_i is the identity on the rows of agent i.  The answer is a proposal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.solvers.conic import Cone, smat, solve_cones, svec, svec_diagonal
from dobc_design.solvers.program import Array

ACCURACY = 1e-10
SMALL = 1e-8  # gains below this part of the largest are noise of the solver


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProgramOptimum:
    """Gains (n,) of least cost, about, and the multiplier Z >= 0 of every block."""

    gains: Array
    multipliers: tuple[Array, ...]


def solve_for_gains(
    tables: Sequence[Any], allowed: Any, costs: Array, *, width: int, scale: float, time_limit: float = 20.0
) -> Array | None:
    """The gains (n,) of least cost, about; None if the solver gives none.

    ``tables``: symmetric SciPy arrays (n width, n width); ``scale`` their largest entry; ``allowed`` agent indices.
    """
    found = solve_program(tables, allowed, costs, width=width, scale=scale, time_limit=time_limit)
    return None if found is None else found.gains


def solve_program(
    tables: Sequence[Any],
    allowed: Any,
    costs: Array,
    *,
    width: int,
    scale: float,
    caps: Array | None = None,
    time_limit: float = 20.0,
) -> ProgramOptimum | None:
    """The same with its multipliers, and with k <= ``caps`` (n,), where inf is no cap."""
    if not len(allowed) or not scale > 0:
        return None
    count = len(allowed)
    cones = [Cone("semidefinite", _columns(allowed, table.shape[0], width), svec(table / scale)) for table in tables]
    cones.append(Cone("nonnegative", -sparse.eye_array(count), np.zeros(count)))
    own = np.full(count, np.inf) if caps is None else caps[allowed]
    capped = np.flatnonzero(np.isfinite(own))
    if len(capped):
        cones.append(Cone("nonnegative", sparse.eye_array(count).tocsr()[capped], own[capped] / scale))
    answer = solve_cones(costs[allowed], cones, time_limit=time_limit, accuracy=ACCURACY)
    if not answer.found:
        return None
    gains = np.zeros(len(costs))
    gains[allowed] = np.maximum(answer.x, 0.0) * scale
    gains[gains < SMALL * np.max(gains, initial=0.0)] = 0.0
    ends = np.cumsum([len(each.right) for each in cones[: len(tables)]])
    parts = np.split(answer.multipliers, ends)[: len(tables)]
    return ProgramOptimum(gains=gains, multipliers=tuple(smat(part) for part in parts))


def _columns(allowed: Any, size: int, width: int) -> Any:
    """-2 svec(E_i), one column per allowed agent."""
    j = (allowed[:, None] * width + np.arange(width)).ravel()
    columns = np.repeat(np.arange(len(allowed)), width)
    shape = (size * (size + 1) // 2, len(allowed))
    return sparse.csc_array((np.full(len(j), -2.0), (svec_diagonal(size)[j], columns)), shape=shape)
