"""Plans of stages: levels fall and rates rise; quadratic stages are proved, the fastest that is asked for."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from lure_cases import HARMONIC, PAPER_GAIN, is_proved
from lure_cases import cycle as quadratic_cycle
from separable_problems import cycle, pair

from dobc_design.conditions.schedule.propose import plan_stages, propose_quadratic_stages
from dobc_design.conditions.separable.decide import largest_rate
from dobc_design.conditions.separable.propose import propose_separable, propose_vectors
from dobc_design.exact.matrix import to_float

F = Fraction


def test_a_plan_has_falling_levels_and_rising_rates():
    problem = cycle()
    plan = plan_stages(problem, rho=F(4), tolerance=F(1, 1000))
    levels = [rho for _, rho in plan]
    assert levels[0] == 4 and levels == sorted(levels, reverse=True) and len(levels) > 2
    # Levels are those that the vectors are proved for.
    rates = [largest_rate(problem, v, rho=rho) for v, rho in plan]
    assert None not in rates
    assert rates == sorted(rates)


def test_no_plan_is_made_where_no_vector_has_a_rate():
    assert plan_stages(cycle(3, h="sin(y)"), rho=F(4), tolerance=F(1, 1000)) == []
    assert plan_stages(cycle(gains={}), rho=F(1), tolerance=F(1, 1000)) == []


def test_vectors_for_a_part_of_the_rate_are_flatter_and_have_it():
    problem = cycle()
    best = propose_separable(problem, rho=2.0)
    full, half = propose_vectors(problem, rho=2.0, parts=(1.0, 0.5))
    assert np.max(half) < np.max(full)
    rate = largest_rate(problem, tuple(F(round(x * 10**6), 10**6) for x in half.tolist()), rho=F(2))
    assert float(rate) == pytest.approx(0.5 * best.rate, rel=0.03)


def test_quadratic_stages_are_faster_at_smaller_radii_and_each_is_proved():
    problem = quadratic_cycle(3, {1: 5}, exosystem=HARMONIC)
    holds, radii = partial(is_proved, problem), (0.1, 0.5, 1.0)
    found = propose_quadratic_stages(problem, W=PAPER_GAIN, holds=holds, radii=radii, slowest=0.1)
    assert [lure.radius for lure in found] == [F(1, 10), F(1, 2), 1]
    assert sorted((lure.rate for lure in found), reverse=True) == [lure.rate for lure in found]
    assert all(is_proved(problem, lure) for lure in found)


def test_quadratic_stages_of_a_linear_loop_reach_nearly_its_spectral_abscissa():
    problem = pair("y", k=5)
    found = propose_quadratic_stages(problem, W=None, holds=partial(is_proved, problem), radii=(1.0,), slowest=0.1)
    (lure,) = found
    assert lure.radius is None
    assert 0.9 < float(lure.rate) <= 1  # e_2' = e_1 - e_2
    assert np.linalg.eigvalsh(to_float(lure.P_e.to_dense()))[0] > 0


def test_no_quadratic_stage_is_faster_than_asked_of_the_slowest():
    problem = quadratic_cycle(3, {1: 5}, exosystem=HARMONIC)
    found = propose_quadratic_stages(problem, W=PAPER_GAIN, holds=lambda lure: True, radii=(0.1,), slowest=50.0)
    assert found == []
    assert propose_quadratic_stages(problem, W=PAPER_GAIN, holds=lambda lure: False, radii=(0.1,), slowest=0.1) == []
