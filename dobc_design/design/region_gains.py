"""Proposals for pins and gains over a region: the smallest gains with which a max-separable v exists (theory, 5).

For pinned agents with given v_i the rows of the others determine their least v, and each gain follows from its own
row: k_i = alpha + sup_s (sum_j sup h) / (s v_i).  What is left to choose are the v_i of the pinned agents.  Every row
has a price: one linear solve gives what a faster rate costs and which other agent a gain would help most.
Floating point only; ``certify`` decides.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.design.estimates import decay_rate
from dobc_design.design.program import Array
from dobc_design.design.separable_field import Field, field_of
from dobc_design.design.separable_observer import propose_error_bound, radius_needed
from dobc_design.exact.matrix import Matrix
from dobc_design.spec.problem import Problem
from dobc_design.theorems.separable import ErrorBound

HARD = 1e7  # a gain that holds an agent as well as any, in units of the network's own gains
LARGEST_V = 1e4  # what a v may span: beyond, gains are of no use to anybody
DENSE = 100  # agents up to which the rows are solved as a full matrix
CLOSE, ROUGH = 1e-3, 2e-2  # relative accuracy of the fastest rate, and where many sets are compared
STEPS, BISECTIONS = 60, 14
TIGHT, DROP = 1e-12, 1e-9
PARTS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the observer's decay, for kappa
COARSE = 8  # points of s where many sets are compared
FACTORS = (1.5, 1.1, 1.02)  # steps of the search for the v_i of the pinned agents
SWEEPS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegionGains:
    """Gains (1/s) by agent index that reach ``rate`` (1/s), about, and v (n).

    ``prices``: by agent, what the whole sum of gains would fall by for each 1/s of gain there (1 for pinned agents
    that are at their optimum).  ``rate_price``: what the sum rises by for each 1/s of rate.
    """

    gains: dict[int, float]
    rate: float
    v: Array
    prices: Array
    rate_price: float

    @property
    def total(self) -> float:
        """The sum of the gains (1/s)."""
        return sum(self.gains.values())


class RegionSearch:
    """One problem (its gains are not looked at), one W (q, m), one region: |e|_inf <= radius, |eps_i| <= disturbance.

    ``radius`` None: near the consensus, as close as need be.
    """

    def __init__(self, problem: Problem, W: Matrix | None, *, radius: Fraction, disturbance: Fraction) -> None:
        self.problem, self.W, self.radius, self.disturbance = problem, W, radius, disturbance
        exosystem = problem.exosystem
        self.decay = math.inf if exosystem is None or W is None else decay_rate(exosystem, W)
        self._bounds: dict[float, ErrorBound | None] = {}
        self._fields: dict[float, Field] = {}

    def reach(self, rate: float) -> Fraction | None:
        """The rho that the region needs at a rate (1/s); None where the observer is too slow for it."""
        if math.isinf(self.decay):
            return self.radius
        part = next((each for each in PARTS if each * self.decay >= rate), None)
        if part is None or self.problem.exosystem is None or self.W is None:
            return None
        if part not in self._bounds:
            self._bounds[part] = propose_error_bound(self.problem.exosystem, self.W, rate=part * self.decay)
        bound = self._bounds[part]
        return None if bound is None else radius_needed(self.radius, bound, self.disturbance)

    def field(self, rate: float, *, coarse: bool = False) -> Field | None:
        """All rows without gains, for the rho of a rate; fewer points of s with ``coarse``.  None as in ``reach``."""
        rho = self.reach(rate)
        if rho is None:
            return None
        if float(rho) not in self._fields:
            self._fields[float(rho)] = replace(field_of(self.problem, rho=float(rho)), gains=np.zeros(self.problem.n))
        field = self._fields[float(rho)]
        if self.problem.is_linear:  # all s say the same
            return replace(field, grid=field.grid[-1:])
        return replace(field, grid=field.grid[:: max(1, len(field.grid) // COARSE)]) if coarse else field

    def holds(
        self, pinned: Collection[int], caps: Mapping[int, Fraction], rate: float, *, coarse: bool = False,
        start: Array | None = None,
    ) -> Array | None:  # fmt: skip
        """The least v >= 1 with the largest gains that are allowed; None if there is none.

        ``start``: the answer for a lower rate, which lies below.
        """
        field = self.field(rate, coarse=coarse)
        if field is None:
            return None
        limit = HARD * (1.0 + self._size(field))
        gains = np.zeros(self.problem.n)
        for i in pinned:
            gains[i] = float(caps.get(i, Fraction(limit)))
        return least_above(replace(field, gains=gains), alpha=rate, floor=np.ones(self.problem.n), start=start)

    def fastest(self, pinned: Collection[int], caps: Mapping[int, Fraction], *, coarse: bool = False) -> float:
        """The largest rate (1/s), about, with gains on these agents; 0 if none is possible."""
        best = self.holds(pinned, caps, 0.0, coarse=coarse) if pinned else None
        if best is None:
            return 0.0
        low, high = 0.0, min(self.decay, self._most(pinned, caps))
        for _ in range(BISECTIONS):
            middle = (low + high) / 2 if low else high / 4
            found = self.holds(pinned, caps, middle, coarse=coarse, start=best)
            low, high, best = (low, middle, best) if found is None else (middle, high, found)
            if low and high - low <= (ROUGH if coarse else CLOSE) * high:
                break
        return low

    def smallest(self, pinned: Sequence[int], caps: Mapping[int, Fraction], rate: float) -> RegionGains | None:
        """Small gains on these agents for a rate (1/s), about; None if the rate is out of reach."""
        field, start = self.field(rate), self.holds(pinned, caps, rate)
        if field is None or start is None:
            return None
        agents = list(pinned)
        limits = np.array([float(caps.get(i, Fraction(10) ** 300)) for i in agents])
        best = self._gains_at(field, agents, limits, start[agents], rate)
        if best is None:
            return None
        for factor in FACTORS if len(agents) > 1 else ():
            for _ in range(SWEEPS):
                better = self._improved(field, agents, limits, best, rate, factor)
                if better is None:
                    break
                best = better
        return self._priced(field, agents, best, rate)

    def _improved(
        self, field: Field, agents: list[int], limits: Array, best: tuple[Array, Array], rate: float, factor: float
    ) -> tuple[Array, Array] | None:
        improved = None
        for place in range(len(agents)):
            for step in (factor, 1 / factor):
                trial = best[0][agents].copy()
                trial[place] *= step
                found = self._gains_at(field, agents, limits, trial / min(1.0, float(np.min(trial))), rate)
                if found is not None and float(np.sum(found[1])) < float(np.sum(best[1])) * (1 - 1e-6):
                    best = improved = found
                    break
        return improved

    def _gains_at(
        self, field: Field, agents: list[int], limits: Array, own: Array, rate: float
    ) -> tuple[Array, Array] | None:
        """v and the gains for given v_i of the pinned agents; None if a cap is exceeded or there is no v."""
        floor = np.ones(self.problem.n)
        floor[agents] = np.maximum(1.0, own)
        gains = np.zeros(self.problem.n)
        gains[agents] = HARD * (1.0 + self._size(field))
        v = least_above(replace(field, gains=gains), alpha=rate, floor=floor)
        if v is None:
            return None
        needed = np.maximum(field.rows(v, alpha=rate)[0][agents] / v[agents], 0.0)
        return (v, needed) if np.all(needed <= limits * (1 + 1e-9)) and np.all(np.isfinite(needed)) else None

    def _priced(self, field: Field, agents: list[int], best: tuple[Array, Array], rate: float) -> RegionGains:
        """The multipliers: l with J'l = 0 on the free v, l_i v_i = 1 on pinned agents, l_i = 0 on slack rows."""
        v, gains = best
        residual, jacobian, scale = field.rows(v, alpha=rate)
        prices = np.zeros(self.problem.n)
        prices[agents] = 1 / v[agents]
        others = np.setdiff1d(np.arange(self.problem.n), agents)
        others = others[np.abs(residual[others]) <= 1e-6 * np.maximum(scale[others], 1e-300)]
        pull = sparse.csr_array(jacobian[agents][:, others]).T @ prices[agents]
        block = sparse.csc_array(sparse.csr_array(jacobian[others][:, others]).T)
        try:
            prices[others] = sparse.linalg.splu(block).solve(-pull) if len(others) else 0.0
        except RuntimeError:  # exactly singular: no price
            prices[others] = 0.0
        prices = np.maximum(prices * v, 0.0)
        return RegionGains(
            gains=dict(zip(agents, gains.tolist(), strict=True)), rate=rate, v=v, prices=prices,
            rate_price=float(np.sum(prices)),
        )  # fmt: skip

    def _most(self, pinned: Collection[int], caps: Mapping[int, Fraction]) -> float:
        """No rate is larger: an agent with the least v has at most its gain, or it hears others."""
        field = self.field(0.0)
        size = 0.0 if field is None else self._size(field)
        if all(i in caps for i in pinned):
            return max(float(caps[i]) for i in pinned)
        return 4 * (1.0 + size)

    def _size(self, field: Field) -> float:
        """About the largest sum of arc gains of an agent."""
        ones = np.ones(self.problem.n)
        return float(np.max(field.rows(ones, alpha=0.0)[2], initial=0.0)) + max(
            (float(np.max(np.bincount(arcs.listeners, minlength=1))) for arcs in self.problem.network.modes.values()),
            default=0.0,
        )


def least_above(field: Field, *, alpha: float, floor: Array, start: Array | None = None) -> Array | None:
    """The least v >= ``floor`` whose rows hold with rate alpha, about, by Newton's method; None if none is found.

    ``start`` lies below it.
    """
    v = floor.copy() if start is None else np.maximum(floor, start)
    for _ in range(STEPS):
        with np.errstate(all="ignore"):
            residual, jacobian, scale = field.rows(v, alpha=alpha)
        if not np.all(np.isfinite(residual)):
            return None
        if np.all(residual <= TIGHT * scale):
            return v
        step = _newton_step(jacobian, residual, np.flatnonzero((residual > 0) | (v > floor)))
        if step is None:
            return None
        proposed = np.maximum(floor, v + step)
        raised = residual > 0
        if np.any(proposed[raised] < v[raised] * (1 - DROP)) or not np.all(np.isfinite(proposed)):
            return None
        proposed = np.minimum(proposed, 2 * v)
        if np.max(proposed / floor) > LARGEST_V:
            return None
        if np.allclose(proposed, v, rtol=1e-15, atol=0.0):
            return v if np.all(residual <= 1e3 * TIGHT * scale) else None
        v = proposed
    return None


def _newton_step(jacobian: Any, residual: Array, places: Any) -> Array | None:
    """One step on some of the agents; None if their matrix is singular."""
    step = np.zeros(len(residual))
    try:
        if len(residual) <= DENSE:
            step[places] = np.linalg.solve(jacobian.toarray()[np.ix_(places, places)], -residual[places])
        else:
            block = sparse.csc_array(jacobian[places][:, places])
            step[places] = sparse.linalg.splu(block).solve(-residual[places])
    except (RuntimeError, np.linalg.LinAlgError):  # exactly singular
        return None
    return step
