"""Weights with the least certified time to one percent, ln(100 max v / min v) / rate."""

import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from certified import certified
from scipy.optimize import linprog

from dobc_design import Network, Problem, load_problem, verify
from dobc_design.conditions.domain import Box
from dobc_design.conditions.numbers import golden_section, time_to_one_percent
from dobc_design.conditions.separable.propose import (
    Cover,
    field_of,
    least_solution,
)
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import read_problem_text

FOUND = Path(__file__).resolve().parents[2] / "found"
TANKS = """
target = 1.5
[network]
agents = 5
arrow = "listens_to"
modes.pipes = [[1, 2], [2, 1], [2, 3], [3, 2], [3, 4], [4, 3], [4, 5], [5, 4]]
[coupling]
h = "0.2*y"
[pinning]
gains = { 1 = 0.5, 4 = 0.5 }
[exosystem]
constant = true
[observer]
rate = 0.5
[region]
initial_states = [0.5, 2.5]
initial_disturbance = 0.1
[actuators]
limit = 1.2
amplitude = 0.1
[uncertainty]
gains = 0.05
weights = 0.1
"""
CHAIN = Problem(
    network=Network.from_arcs([[2, 1], [3, 2], [4, 3], [5, 4]], arrow="listens_to", agents=5),
    coupling="2*y",
    gains={1: 3},
)


def stiffness() -> np.ndarray:
    """M of the chain: agent 1 has k = 3, the others 2 (x_i - x_(i - 1))."""
    diagonal = np.diag([3.0, 2, 2, 2, 2])
    below = np.diag([2.0] * 4, -1)
    return diagonal - below


@pytest.mark.parametrize("rate", [0.5, 1.0, 1.6])
def test_the_least_weights_have_the_least_largest_one(rate: float):
    """A linear program: minimise t over 1 <= v <= t, (M - rate I) v >= 0."""
    M = stiffness() - rate * np.eye(5)
    n = 5
    upper = np.hstack([-M, np.zeros((n, 1))])
    ones = -np.ones((n, 1))
    lower = np.hstack([np.eye(n), ones])
    blocks = [upper, lower]
    rows = np.vstack(blocks)
    bounds = [(1, None)] * n + [(0, None)]
    costs = np.append(np.zeros(n), 1.0)
    right = np.zeros(2 * n)
    answer = linprog(costs, A_ub=rows, b_ub=right, bounds=bounds)
    field = field_of(loop_of(CHAIN), rho=1.0)
    v = least_solution(field, alpha=rate, start=np.ones(n))
    assert v is not None
    assert v.max() == pytest.approx(answer.fun, rel=1e-6)


def test_no_other_rate_of_a_chain_settles_earlier():
    """By the linear program on a fine grid of rates: v_1 = 1, v_(i + 1) = 2 v_i / (2 - rate)."""
    cover = Cover(loop=loop_of(CHAIN), radius=Fraction(1))
    plan = cover.fastest()
    assert plan is not None
    sooner = cover.sooner(plan)
    rates = np.linspace(0.01, 1.99, 2000)
    grid = (time_to_one_percent(rate, (2 / (2 - rate)) ** 4) for rate in rates)
    assert sooner.time == pytest.approx(min(grid), rel=2e-3)
    assert sooner.time < 0.75 * plan.time
    assert sooner.rate < plan.rate


def test_a_flat_plan_is_left_as_it_is():
    alike = Problem(network=CHAIN.network, coupling="2*y", gains=3)
    cover = Cover(loop=loop_of(alike), radius=Fraction(1))
    plan = cover.fastest()
    assert plan is not None
    assert cover.sooner(plan) is plan


def test_a_golden_section_closes_in_on_the_minimum():
    seen: list[float] = []

    def f(x: float) -> float:
        seen.append(x)
        return (x - 0.3) ** 2

    golden_section(f, 0.0, 1.0, steps=12)
    assert len(seen) == 12
    assert min(abs(x - 0.3) for x in seen) < 0.01


@pytest.mark.slow
def test_the_fastest_weights_of_eight_drones_are_not_chosen():
    """At 0.987 1/s they reach from 1 to 1e6, and the bound starts at ten million for an error of
    7."""
    problem = load_problem(FOUND / "drones.toml")
    certificate = certified(problem)
    check = certificate.check("max-separable")
    assert certificate.covered_by == "max-separable"
    assert certificate.rate == check.rate
    assert certificate.factor == check.factor
    assert check.time_to_one_percent < 12.3
    assert (check.factor or math.inf) < 80
    assert "The largest rate is about 0.98" in check.reason
    assert "falls to one percent within 12.2 s" in certificate.reason
    assert check.domain == Box(7.0, 1.0)
    assert verify(certificate, problem).holds


@pytest.mark.slow
def test_no_rate_below_the_certified_one_is_called_the_largest():
    """A plan promises 0.0915 1/s, a little less than the claim chosen in its place proves."""
    problem = read_problem_text(TANKS.encode(), folder=None)
    check = certified(problem).check("max-separable")
    largest = re.search(r"The largest rate is about ([\d.]+)", check.reason)
    assert largest is None or float(largest[1]) > (check.rate or 0.0)


@pytest.mark.slow
def test_the_bound_of_four_cars_starts_near_their_error():
    """A full P_e of condition 50 in place of 3e11."""
    certificate = certified(load_problem(FOUND / "cars.toml"))
    check = certificate.check("lure")
    assert certificate.covered_by == "lure"
    assert check.time_to_one_percent < 12.5
    assert (check.factor or math.inf) < 10
    assert "The largest rate is about" in check.reason
