"""Agents with nonlinear dynamics x' = f(x) + B (...): linearisation and quadratic regions, in both
programs."""

from fractions import Fraction

import numpy as np
import pytest
from published import LORENZ, PENDULUM, ring
from scipy.integrate import solve_ivp

from dobc_design import Dynamics, Exosystem, Network, Problem, Verdict, certify, verify
from dobc_design.loop.make import loop_of


def pendulums(reach: str = "1/5", **given) -> Problem:
    """Pendulums that hear their neighbour's angle and speed; the first one its target, too."""
    region = {"initial_states": [f"-{reach}", reach]}
    parts = {"coupling": "2*y1 + 3*y2", "gains": {1: 3}, "region": region}
    settings = {"dynamics": PENDULUM} | parts | given
    return Problem(network=ring(2), **settings)


def lorenz(gain: int) -> Problem:
    """Pinned Lorenz systems with their classical parameters, at the origin."""
    target = [0, 0, 0]
    return Problem(network=ring(3), coupling="20*y", gains=gain, dynamics=LORENZ, target=target)


def slope(_, e):
    """The error system of ``pendulums()`` written out by hand."""
    x = e.reshape(2, 2)
    H = np.array([2.0, 3.0])
    differences = np.roll(x, -1, axis=0)
    coupled = (differences - x) @ H
    pinned = np.array([3 * H @ x[0], 0])
    pull = coupled - pinned
    driven = pull - np.sin(x[:, 0])
    acceleration = driven - x[:, 1] / 2
    velocity = [x[:, 1], acceleration]
    return np.stack(velocity, axis=1).ravel()


def test_pulls_of_the_loop_hold_the_slopes_at_the_target():
    own = loop_of(pendulums())
    expected_row = (1, Fraction(1, 2))
    expected = ((0, -1), expected_row)
    assert own.pulls.gains[1] == expected
    first_row = (1 + 6, Fraction(1, 2) + 9)
    expected_first = ((0, -1), first_row)
    assert own.pulls.gains[0] == expected_first
    assert own.drift_place == 1
    assert own.functions[1].texts == ("y2 - 0", "-sin(y1) - y2/2 - 0")


@pytest.mark.evidence
def test_pendulums_are_proved_from_a_ball_that_no_run_leaves():
    problem = pendulums()
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "lure"
    assert verify(certificate, problem).holds
    radius = certificate.check("lure").domain.radius
    rng = np.random.default_rng(0)
    for _ in range(100):
        start = rng.normal(size=4)
        start *= radius / np.linalg.norm(start)
        run = solve_ivp(slope, (0, 40), start, rtol=1e-9, atol=1e-12)
        last = np.abs(run.y[:, -1])
        assert np.max(last) < 1e-6


@pytest.mark.evidence
def test_a_region_too_wide_for_sin_is_left_open():
    """Twin: the pin of 3 is stiffer than gravity, and holds from everywhere; with 1/100 both can
    stand upside down."""
    assert certify(pendulums(reach="4")).verdict is Verdict.PROVED
    weak = pendulums(reach="4", gains={1: "1/100"})
    certificate = certify(weak)
    assert certificate.verdict is Verdict.UNDECIDED
    assert verify(certificate, weak).holds


@pytest.mark.slow
def test_upright_pendulums_need_gains():
    """x1'' = sin(x1) - x1'/2: with one pin of four it is refuted by its linearisation, with all
    pinned proved."""
    B = [[0], [1]]
    upright = Dynamics(f=["x2", "sin(x1) - x2/2"], B=B)
    alone = certify(pendulums(dynamics=upright, gains={1: "1/100"}))
    assert alone.verdict is Verdict.REFUTED
    assert certify(pendulums(dynamics=upright, gains=2)).verdict is Verdict.PROVED


@pytest.mark.parametrize(("gain", "verdict"), [(28, Verdict.PROVED), (1, Verdict.REFUTED)])
def test_lorenz_systems_are_held_at_the_unstable_origin_by_enough_gain(gain, verdict):
    """Locally the origin of one system with gain k on every component is stable iff k > (sqrt(1201)
    - 11)/2 = 11.83."""
    certificate = certify(lorenz(gain))
    assert certificate.verdict is verdict
    assert verify(certificate, lorenz(gain)).holds


@pytest.mark.evidence
def test_a_scalar_node_away_from_the_origin():
    """x' = x - x^3/3 + ... at xbar = 1 with u0 = -2/3: f'(1) = 0."""
    nodes = Dynamics(f=["x - x**3/3"])
    problem = Problem(network=ring(3), coupling="tanh(y)", gains=1, dynamics=nodes, target=1)
    found = nodes.feedforward((Fraction(1),))
    expected = (Fraction(-2, 3),)
    assert found == expected
    assert loop_of(problem).pulls.gains[0] == ((1,),)
    certificate = certify(problem.replace(region={"initial_states": ["4/5", "6/5"]}))
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, certificate.problem).holds


@pytest.mark.evidence
def test_nodes_with_a_disturbance():
    """The observer watches B+ x; its error does not see f."""
    A = [[0, 2], [-2, 0]]
    C = [[1, 0]]
    exosystem = Exosystem(A=A, C=C)
    region = {"initial_states": ["-1/20", "1/20"], "initial_disturbance": "1/100"}
    problem = pendulums(exosystem=exosystem, region=region)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, problem).holds


def test_nodes_that_pull_by_themselves_are_not_refuted():
    """x' = -x**3 goes to 0 without pins, although its slope there is 0: nothing is said, in both
    programs."""
    pair = Network.from_arcs([["a", "b"]], arrow="listens_to")
    for f, gains in (("-x**3", None), ("x - x**3", {"b": 1})):
        dynamics = {"f": [f]}
        problem = Problem(network=pair, coupling="y", dynamics=dynamics, gains=gains)
        certificate = certify(problem)
        assert certificate.verdict is not Verdict.REFUTED
        assert verify(certificate, problem).verdict is not Verdict.REFUTED
