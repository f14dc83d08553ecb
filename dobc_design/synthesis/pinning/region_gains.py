"""Proposals for pins and gains over a region: the smallest gains with which a max-separable v exists (theory, 5).

Which rates gains on given agents can reach, by bisection, and the smallest gains for one of them, as
``propose_boxes`` finds them.  Every row has a price: one linear solve gives what a faster rate costs and which
other agent a gain would help most.  Floating point only; ``certify`` decides.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from scipy import sparse

from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.separable.claim import ErrorBound
from dobc_design.conditions.separable.propose import Field, field_of, least_above
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array
from dobc_design.synthesis.pinning.propose_boxes import box_of, cheapest

HARD = 1e7  # a gain that holds an agent as well as any, in units of the network's own gains
LARGEST_V = 1e4  # what a v may span: beyond, gains are of no use to anybody
CLOSE, ROUGH = 1e-3, 2e-2  # relative accuracy of the fastest rate, and where many sets are compared
BISECTIONS = 14
PARTS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the observer's decay, for kappa
COARSE = 8  # points of s where many sets are compared


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
        self.exosystem = exosystem = problem.joint_exosystem
        self.decay = math.inf if exosystem is None or W is None else decay_rate(exosystem, W)
        self._bounds: dict[float, ErrorBound | None] = {}
        self._fields: dict[float, Field] = {}

    def reach(self, rate: float) -> Fraction | None:
        """The rho that the region needs at a rate (1/s); None where the observer is too slow for it."""
        if math.isinf(self.decay):
            return self.radius
        part = next((each for each in PARTS if each * self.decay >= rate), None)
        if part is None or self.exosystem is None or self.W is None:
            return None
        if part not in self._bounds:
            self._bounds[part] = propose_error_bound(self.exosystem, self.W, rate=part * self.decay)
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
        self,
        pinned: Collection[int],
        caps: Mapping[int, Fraction],
        rate: float,
        *,
        coarse: bool = False,
        start: Array | None = None,
    ) -> Array | None:
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
        v = least_above(replace(field, gains=gains), alpha=rate, lower=np.ones(self.problem.n), start=start)
        return None if v is None or np.max(v) > LARGEST_V else v

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
        """The smallest gains found on these agents for a rate (1/s), about; None if the rate is out of reach."""
        field = self.field(rate)
        with np.errstate(all="ignore"):
            found = None if field is None else cheapest(box_of(field, pinned, caps, rate=rate))
        if field is None or found is None:
            return None
        box, v = found
        return self._priced(field, box.gains(v), v, rate)

    def _priced(self, field: Field, gains: Array, v: Array, rate: float) -> RegionGains:
        """The multipliers: l with J'l = 0 on the free v, l_i v_i = 1 on pinned agents, l_i = 0 on slack rows."""
        agents = np.flatnonzero(gains)
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
            gains=dict(zip(agents.tolist(), gains[agents].tolist(), strict=True)),
            rate=rate,
            v=v,
            prices=prices,
            rate_price=float(np.sum(prices)),
        )

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
