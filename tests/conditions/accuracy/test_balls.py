"""Final bounds by arc-wise balls: where no common box exists, against the worst runs that are
found, both programs."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from arc_wise import motion, rows

from dobc_design import Certificate, Exosystem, Observer, Problem, Verdict, certify, verify
from dobc_design.conditions.accuracy.decide import Accuracy
from dobc_design.conditions.domain import Box

ACTS = 0.02
SEEN: dict[str, Any] = {
    "exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
    "observer": Observer(W=[["16/5"], ["12/5"]]),
    "region": {"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/20"},
}


def disturbed(radius: str | None = "4/5", **uncertainty: Any) -> Problem:
    return rows(radius, uncertainty=uncertainty or {"disturbance": str(ACTS)})


@cache
def proved(problem: Problem) -> Certificate:
    return certify(problem)


def claim_of(problem: Problem) -> Accuracy:
    certificate = proved(problem)
    assert certificate.verdict is Verdict.PROVED, certificate.reason
    assert certificate.covered_by == "accuracy"
    assert verify(certificate, problem).lone_checker == "it accepts every claim"
    claim = certificate.check("accuracy").claim
    assert isinstance(claim, Accuracy)
    assert claim.balls
    return claim


def test_no_run_under_the_worst_that_is_found_ends_outside():
    """Disturbances push outwards, or all one way; modes are those in which V, or the largest error,
    grows most."""
    problem = disturbed()
    claim = claim_of(problem)
    moved = [motion(problem, mode) for mode in problem.network.modes]
    e = 0.8 * np.array([[1, s, t, u] for s in (1, -1) for t in (1, -1) for u in (1, -1)], float)
    e = np.concatenate([e, e])
    outwards = np.arange(len(e)) < len(e) // 2
    largest = np.zeros(4)
    step = 0.02
    for k in range(4000):
        push = np.where(outwards[:, None], np.sign(e), 1.0) * ACTS
        ways = np.stack([step * (each(e) + push) for each in moved])
        ends = np.where(outwards, np.sum((e + ways) ** 2, axis=2), np.max(e + ways, axis=2))
        e = e + ways[np.argmax(ends, axis=0), np.arange(len(e))]
        assert np.sum(e * e, axis=1).max() <= float(claim.balls[0].level)
        if k >= 3000:
            largest = np.maximum(largest, np.abs(e).max(axis=0))
    bounds = np.array([float(x) for x in claim.bounds.values()])
    assert np.all(largest <= bounds)
    assert largest.max() > bounds.max() / 2


def test_each_ball_begins_where_the_one_before_ends():
    first, *others = claim_of(disturbed()).balls
    assert others
    assert [ball.rate > first.rate for ball in others] == [True] * len(others)
    assert [ball.level < first.level / 10 for ball in others] == [True] * len(others)


@pytest.mark.slow
def test_too_large_a_disturbance_leaves_no_ball_and_the_reason_names_both_ways():
    check = proved(disturbed(disturbance="1/5")).check("accuracy")
    assert check.verdict is Verdict.UNDECIDED
    assert "no common weights v exist" in check.reason
    assert "no ball of an arc-wise proof" in check.reason


@pytest.mark.slow
def test_noise_and_errors_of_weights_and_gains_are_in_the_balls():
    exact = claim_of(disturbed("1/2", disturbance="1/100")).bounds["4"]
    off = {"weights": "1/10", "gains": "1/10", "measurement": "1/1000"}
    assert claim_of(disturbed("1/2", disturbance="1/100", **off)).bounds["4"] > exact


@pytest.mark.slow
def test_without_a_region_a_box_near_the_target_answers():
    certificate = proved(disturbed(None))
    assert (certificate.verdict, certificate.covered_by) == (Verdict.PROVED, "accuracy")
    assert isinstance(certificate.check("accuracy").domain, Box)


@pytest.mark.slow
def test_observers_and_sines_in_bands_are_in_the_balls():
    """What observers leave of a sine in a narrow band is little."""
    watched = rows(None).replace(**SEEN)
    acts = claim_of(watched.replace(uncertainty={"disturbance": "1/100"})).bounds["4"]
    band = {"bands": [["19/10", "21/10", "1/20"]]}
    assert claim_of(watched.replace(uncertainty=band)).bounds["4"] < acts / 5


@pytest.mark.slow
def test_linear_couplings_of_modes_without_common_weights_end_in_a_ball():
    """Slopes of sin are at most 1, so that the bound of y is smaller, and from afar the same."""
    linear = disturbed().replace(coupling="y")
    near, far = linear, linear.replace(region={"initial_states": [-100, 100]})
    assert claim_of(near).bounds["4"] == claim_of(far).bounds["4"]
    assert claim_of(near).bounds["4"] < claim_of(disturbed()).bounds["4"]
