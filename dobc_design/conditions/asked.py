"""What the checks of a region are asked: how far, with which disturbance, for which loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import decimal_above
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import root_above
from dobc_design.problem.problem import Problem

Progress = Callable[[str], None]

#: The largest box that is tried where no region is asked for, in the unit of the states.
CAP = Fraction(10)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is to be covered: |e|_inf <= radius and |eps_i| <= disturbance, by the loop with the gain W (q, m).

    ``ball``: |e| <= ball holds all of these starts, and no less of the region does.  ``wanted`` is False where no
    region was asked for and the largest up to ``radius`` is looked for.  ``domain``: that of Lemma 1.  ``everything``:
    go on where the region is covered already.
    """

    problem: Problem
    W: Matrix | None
    radius: float
    ball: float
    disturbance: float
    domain: str
    wanted: bool
    everything: bool


def read_region(problem: Problem, W: Matrix | None, *, domain: str, everything: bool) -> Asked:
    """Decimals that are not below what is asked; a point counts as a small region."""
    region = problem.region
    reach = (CAP,) * problem.m if region is None else asked_radius(problem)
    disturbance = _first_error(problem) if region is None else region.initial_disturbance or Fraction(0)
    square = problem.n * sum((r * r for r in reach), Fraction(0))
    return Asked(
        problem=problem,
        W=W,
        radius=decimal_above(max(reach)) or 1e-6,
        ball=decimal_above(root_above(square, unit=10**9)) or 1e-6,
        disturbance=decimal_above(disturbance),
        domain=domain,
        wanted=region is not None,
        everything=everything,
    )


def _first_error(problem: Problem) -> Fraction:
    """The largest |xi_i(0)| of the simulation, about, where xihat begins at 0; 0 if the file names none."""
    rows = problem.simulation.xi0 or ()
    square = max((sum((x * x for x in row), Fraction(0)) for row in rows), default=Fraction(0))
    return root_above(square, unit=10**6)
