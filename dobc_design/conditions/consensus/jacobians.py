"""Enclosures of dh/de on a domain, arc by arc (eq. 11).

Today the only domain is the consensus, e = 0, where each gain is h'(0) of the arc: a point when it is
rational, else a narrow outward interval.  A region will give wider intervals in the same place; Psi is
affine in J, so the theorems need nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact.interval import Interval
from dobc_design.problem.arcs import arc_table
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem

Gain = tuple[tuple[Interval, ...], ...]  # m x m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeJacobian:
    """dh/de of one mode: J has +gain at block (listener, speaker) and -gain at (listener, listener).

    ``gains[kind[a]]`` is the m x m gain of arc a, weight included; arcs that are alike share it.
    """

    name: str
    arcs: Arcs
    kind: NDArray[np.int64]
    gains: tuple[Gain, ...]

    @property
    def is_point(self) -> bool:
        """Whether every gain is a single rational matrix."""
        return all(entry.lo == entry.hi for gain in self.gains for row in gain for entry in row)

    @property
    def is_nonnegative_diagonal(self) -> bool:
        """Whether every gain is diagonal and >= 0: then -Lambda is a Z-matrix and J - K cannot be unstable."""
        return all(
            entry.lo >= 0 if i == j else entry.lo == entry.hi == 0
            for gain in self.gains
            for i, row in enumerate(gain)
            for j, entry in enumerate(row)
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Jacobians:
    """The Jacobians of every mode on one domain ("consensus", or "global" for linear couplings)."""

    domain: str
    size: int  # n
    dimension: int  # m
    modes: tuple[ModeJacobian, ...]


def jacobians_at_consensus(problem: Problem) -> Jacobians:
    """Enclose J(0) of every mode.

    For linear couplings J does not depend on e, so the domain is "global".
    Raises: exact.interval.UndefinedError if a coupling has no derivative at 0.
    """
    modes = tuple(_mode(problem, name, arcs) for name, arcs in problem.network.modes.items())
    domain = "global" if problem.is_linear else "consensus"
    return Jacobians(domain=domain, size=problem.n, dimension=problem.m, modes=modes)


def _mode(problem: Problem, name: str, arcs: Arcs) -> ModeJacobian:
    slopes = [coupling.jacobian_at_zero() for coupling in problem.couplings]
    table = arc_table(problem, name)
    weights = table.weights
    pairs, kinds = np.unique(table.coupling * max(1, len(weights)) + table.weight, return_inverse=True)
    gains: list[Gain] = []
    for coupling, place in (divmod(pair, max(1, len(weights))) for pair in pairs.tolist()):
        scale = Interval(weights[place], weights[place])
        gains.append(tuple(tuple(entry * scale for entry in row) for row in slopes[coupling]))
    kinds.setflags(write=False)
    return ModeJacobian(name=name, arcs=arcs, kind=kinds, gains=tuple(gains))
