"""Boxes around a quadratic certificate: radii of small networks, what just fails, simulation."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from lure_cases import HARMONIC, PAPER_GAIN, cycle, field, is_proved, random_problem, values_along

from dobc_design import Network, Problem, Verdict
from dobc_design.conditions.boxes.decide import Shell, verify_shell
from dobc_design.conditions.boxes.stage import grow_shell
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import border_of, covered_radius
from dobc_design.conditions.quadratic.propose import design_lure


def inner(problem: Problem, **options) -> Lure:
    options = {"shape": "identity"} | options
    lure = design_lure(problem, holds=lambda each: is_proved(problem, each), **options)
    assert lure is not None
    return lure


def ball(problem: Problem, shell: Shell) -> float:
    """The radius of the ball in {V <= outer}, eps = 0."""
    return covered_radius(problem, replace(shell.lure, level=shell.outer))


FARTHER = ((2, 3, 6.0), (3, 3, 6.0), (4, 3, 6.0), (3, {1: 3}, 3.63), (4, {1: 3}, 3.63))


@pytest.mark.parametrize(
    ("n", "gains", "radius"), [(2, {1: 3}, 3.75), *(pytest.param(*each, marks=pytest.mark.slow) for each in FARTHER)]
)
def test_small_cycles_are_certified_as_far_as_v_decreases(n, gains, radius):
    """V = e'e on the directed cycle: the truth from many directions is not passed, and nearly reached."""
    problem = cycle(n, gains)
    shell = grow_shell(problem, inner(problem))
    assert verify_shell(problem, shell).verdict is Verdict.PROVED
    rng = np.random.default_rng(1)
    v = rng.standard_normal((50_000 * (n - 1), n))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    reached = ball(problem, shell)
    radii = np.linspace(0.9, 1.2, 61) * reached
    rises = [R for R in radii if np.max(np.sum(v * field(problem, "G", R * v), axis=1)) >= 0]
    assert radius <= reached < rises[0] < 1.03 * reached


def test_two_agents_are_certified_to_just_below_their_other_equilibrium():
    """h = y - y^3 both ways, k = 1: e = (z/2, -z/2) with z^2 = 3/2 stays, so |e| < sqrt(3)/2."""
    network = Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to", agents=2)
    problem = Problem(network=network, coupling="y - y**3", gains=1)
    shell = grow_shell(problem, inner(problem, largest=Fraction(1, 2)))
    truth = math.sqrt(3) / 2
    assert 0.99 * truth < ball(problem, shell) < truth
    assert verify_shell(problem, shell).verdict is Verdict.PROVED
    beyond = replace(shell, outer=Fraction(truth**2 * 1.001).limit_denominator(10**6), half=Fraction(1))
    assert verify_shell(problem, beyond).verdict is Verdict.UNDECIDED


@pytest.mark.slow
def test_a_coupling_that_is_not_monotone_is_certified_beyond_its_turning_point():
    """sin, one pin: the Lur'e sector ends where the gain does, boxes do not."""
    problem = cycle(3, {1: 2}, coupling="sin(y)")
    lure = inner(problem, shape="full")
    shell = grow_shell(problem, lure)
    assert verify_shell(problem, shell).verdict is Verdict.PROVED
    assert ball(problem, shell) > 1.05 * covered_radius(problem, lure)


def test_another_tree_a_larger_set_or_a_smaller_box_is_not_accepted():
    problem = cycle(2, 3)
    shell = grow_shell(problem, inner(problem))
    assert verify_shell(problem, shell).verdict is Verdict.PROVED
    assert verify_shell(problem, replace(shell, tree=".")).verdict is Verdict.UNDECIDED
    for tree in (shell.tree[:-1], shell.tree + ".", "2.." + shell.tree, "x" + shell.tree[1:]):
        assert verify_shell(problem, replace(shell, tree=tree)).verdict is Verdict.REFUTED
    wider = replace(shell, outer=shell.outer * Fraction(103, 100))
    assert verify_shell(problem, wider).verdict is not Verdict.PROVED
    assert verify_shell(problem, replace(shell, half=shell.half / 2)).step == "boxes"
    worse = replace(shell.lure, level=shell.lure.level * 2)
    assert verify_shell(problem, replace(shell, lure=worse)).step == "region"


@pytest.mark.slow
def test_with_the_observer_and_a_rate_no_start_leaves():
    """50 starts with V = outer; V <= V(0) exp(-2 beta t) along (22), integrated by SciPy."""
    problem = cycle(3, 3, exosystem=HARMONIC)
    lure = inner(problem, W=PAPER_GAIN, disturbance=Fraction(1, 5), rate=Fraction(1, 10))
    shell = grow_shell(problem, lure, S=border_of(problem, lure, lure.rate))
    assert verify_shell(problem, shell).verdict is Verdict.PROVED
    assert shell.outer > lure.level * Fraction(3, 2)
    times = np.linspace(0, 3, 25)
    V = values_along(problem, lure, shell.outer, times)
    assert np.max(V / (float(shell.outer) * np.exp(-0.2 * times))) <= 1 + 1e-6


@pytest.mark.parametrize("seed", [*(pytest.param(k, marks=pytest.mark.slow) for k in (0, 1)), 2])
def test_random_small_networks_are_certified_and_checked(seed):
    problem = random_problem(seed, coupling="y + y**3/5")
    lure = design_lure(problem, holds=lambda each: is_proved(problem, each))
    shell = None if lure is None else grow_shell(problem, lure, largest=Fraction(6), most=20_000)
    assert shell is None or (verify_shell(problem, shell).verdict is Verdict.PROVED and shell.outer > lure.level)


def test_no_more_boxes_are_left_than_allowed_and_smaller_sets_are_not_looked_for():
    problem = cycle(2, 3)
    lure = inner(problem)
    shell = grow_shell(problem, lure)
    count = shell.tree.count(".")
    fewer = grow_shell(problem, lure, most=count - 1)
    assert fewer is None or (fewer.tree.count(".") < count and fewer.outer < shell.outer)
    assert grow_shell(problem, lure, most=3) is None
    assert grow_shell(problem, lure, least=2 * shell.outer) is None
    assert grow_shell(problem, lure, least=shell.outer / 2) == shell
