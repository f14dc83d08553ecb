"""What is shown while the hand still moves: numbers in floating point, in a fraction of a second, and no proofs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dobc_design.conditions.consensus.propose import float_lambda, largest_eigenvalue
from dobc_design.conditions.separable.claim import acts_by_component, find_ordering
from dobc_design.conditions.separable.propose import field_of, least_above
from dobc_design.errors import DobcError
from dobc_design.problem.problem import Problem
from dobc_design.simulation.simulations import simulate

HALVINGS = 7
SCALES = 8  # sizes of the box, down to the smallest, at which it has to shrink
SMALLEST = 1 / 64  # of the radius asked for: below that nothing is shown
POINTS = 120  # of a curve


def remade(problem: Problem, changes: Mapping[str, Any]) -> Problem:
    """The problem with some arguments of its constructor replaced.  Raises: SpecError as that does."""
    remake, (given,) = problem.__reduce__()
    made: Problem = remake(given | dict(changes))
    return made


@dataclass(frozen=True, slots=True, kw_only=True)
class Preview:
    """Estimates for one problem.

    Fields:
        lambda_max: the largest eigenvalue of Lambda over all modes in 1/s, or None where h may have a kink.
        reach: the largest box |e|_inf <= reach, up to the radius asked for, that seems to shrink at the rate asked for
            (the network alone, without the observer); 0 if none does.
        times, errors: |x_i - goal_i|_inf of every agent, errors (agents, times), in s and in the unit of x.
        note: why something is missing, or "".
    """

    lambda_max: float | None
    reach: float
    times: tuple[float, ...]
    errors: tuple[tuple[float, ...], ...]
    note: str

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON has them."""
        return {
            "lambda_max": self.lambda_max,
            "reach": self.reach,
            "times": self.times,
            "errors": self.errors,
            "note": self.note,
        }


def preview(
    problem: Problem,
    *,
    radius: float,
    rate: float,
    t_final: float,
    same_gains: Preview | None = None,
    same_start: Preview | None = None,
) -> Preview:
    """Estimate everything.  ``radius`` in the unit of x, ``rate`` in 1/s, ``t_final`` in s.

    ``same_gains``: of this problem with another radius or rate, whose lambda_max is taken over; ``same_start``: with
    another rate only, whose response is taken over too.
    """
    if same_start is not None:
        times, errors, note = same_start.times, same_start.errors, same_start.note
    else:
        times, errors, note = _response(problem, radius, t_final)
    top = _lambda_max(problem) if same_gains is None else same_gains.lambda_max
    return Preview(lambda_max=top, reach=_reach(problem, radius, rate), times=times, errors=errors, note=note)


def _lambda_max(problem: Problem) -> float | None:
    if any(coupling.nonsmooth for coupling in problem.couplings):
        return None
    tops = []
    for mode in problem.network.modes:
        try:
            tops.append(largest_eigenvalue(float_lambda(problem, mode)).value)
        except (ArithmeticError, DobcError):
            return None
    return float(max(tops)) if all(math.isfinite(top) for top in tops) else None


def _reach(problem: Problem, radius: float, rate: float) -> float:
    if not acts_by_component(problem) or not find_ordering(problem).exists:
        return 0.0
    if _shrinks(problem, radius, rate):
        return radius
    low, high = 0.0, radius
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _shrinks(problem, middle, rate) else (low, middle)
        if high < SMALLEST * radius:
            return 0.0
        if high - low < 0.02 * high:
            break
    return low


def _shrinks(problem: Problem, radius: float, rate: float) -> bool:
    try:
        field = field_of(problem, rho=radius)
    except (ArithmeticError, DobcError):
        return False
    field = replace(field, grid=field.grid[:: max(1, len(field.grid) // SCALES)])  # enough for an estimate
    return least_above(field, alpha=rate, lower=np.ones(problem.n)) is not None


def _response(
    problem: Problem, radius: float, t_final: float
) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...], str]:
    """The network without disturbances, from a start on the box's boundary that is the same every time."""
    goals = np.array([[float(value) for value in problem.goal_of(agent)] for agent in range(problem.n)])
    start = goals + radius * np.random.default_rng(0).choice((-1.0, -0.5, 0.5, 1.0), size=goals.shape)
    absent = ("exosystem", "observer", "groups", "region", "switching", "simulation")
    without = dict.fromkeys(absent)
    try:
        run = simulate(
            remade(problem, without),
            mode=next(iter(problem.network.modes)),
            start={"x": start},
            t_final=t_final,
            samples=POINTS,
            tolerance=1e-5,
        )
    except DobcError as error:
        return (), (), str(error)
    errors = np.abs(run.x - goals).max(axis=2)  # (times, agents)
    rows = tuple(tuple(float(f"{value:.4g}") for value in row) for row in errors.T)
    return tuple(float(f"{t:.4g}") for t in run.times), rows, run.reason if run.diverged else ""
