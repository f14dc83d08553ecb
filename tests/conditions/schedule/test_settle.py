"""Certified settling times end to end: the paper's examples, refusals, and simulated runs against the envelope."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from lure_cases import HARMONIC
from separable_problems import cycle, pair
from settled import INTEGRATION, compare

import dobc_design as dd
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.conditions.schedule.decide import verify_staging
from dobc_design.conditions.separable.claim import Separable
from dobc_design.errors import SpecError
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

F = Fraction


@pytest.fixture(scope="module")
def fixed():
    return dd.certify_settling("paper-fixed")


def test_example_1_settles_in_a_time_that_one_rate_for_the_box_nearly_doubles(fixed):
    """R = 4, |eps_i| <= 1/2, tolerance 1/1000.

    Not three times: the slowest simulated run takes 18.9 s, so no proof can give less than 0.43 of the 43.7 s.
    """
    assert fixed.verdict is Verdict.PROVED
    assert (fixed.radius, fixed.disturbance, fixed.tolerance) == (4, F(1, 2), F(1, 1000))
    assert fixed.time < 24
    assert fixed.single_time == pytest.approx(43.7, abs=0.5)
    assert fixed.single_time / fixed.time > 1.8


def test_every_stage_of_example_1_is_proved_again_and_fails_one_thousandth_earlier(fixed):
    problem = dd.load_problem("paper-fixed")
    W = observer_gain(problem)
    assert verify_staging(problem, W, fixed.staging).verdict is Verdict.PROVED
    last = fixed.stages[-1]
    early = replace(fixed.staging, time=last.start + (fixed.staging.time - last.start) * F(999, 1000))
    assert verify_staging(problem, W, early).step == "tolerance"
    for k, stage in enumerate(fixed.stages[1:], start=1):
        before = fixed.stages[k - 1]
        wait = (stage.start - before.start) * F(1, 1000)
        sooner = replace(stage, start=stage.start - wait, level=2 * stage.level)
        moved = (*fixed.stages[:k], sooner, *fixed.stages[k + 1 :])
        answer = verify_staging(problem, W, replace(fixed.staging, stages=moved))
        assert (answer.verdict, answer.stage) == (Verdict.REFUTED, k)


def test_no_run_of_example_1_crosses_the_envelope(fixed):
    """100 random starts of the region, and corners of the box."""
    found = compare(dd.load_problem("paper-fixed"), fixed, runs=100)
    assert not found.crossings
    assert found.runs == 108
    assert found.settled <= fixed.time <= 1.3 * found.settled
    assert found.closest > 0.5  # the comparison means something


@pytest.mark.slow
def test_example_2_settles_three_times_sooner_than_one_rate_says_and_no_run_crosses_the_envelope():
    """Arbitrary switching among the four modes; the runs switch as the problem says."""
    settling = dd.certify_settling("paper-switching")
    assert settling.verdict is Verdict.PROVED
    assert settling.single_time / settling.time >= 3
    assert any(stage.is_quadratic for stage in settling.stages)
    assert not any(isinstance(stage.certificate, Separable) for stage in settling.stages[-2:])
    found = compare(dd.load_problem("paper-switching"), settling, runs=10)
    assert not found.crossings
    assert found.settled <= settling.time


def test_all_pinned_alike_settle_as_their_gain_says():
    """V = 1 and alpha = k = 5: |e| <= R exp(-5 t), so ln(2000)/5 s."""
    settling = dd.certify_settling(cycle(4, gains=5), radius=2, tolerance="1/1000")
    assert settling.time == pytest.approx(np.log(2000) / 5, abs=1e-3)


def test_a_linear_problem_settles_for_every_radius():
    """Agent 1 alone: e' = -5 e; agent 2 follows: e_2' = e_1 - e_2."""
    settling = dd.certify_settling(pair("y"), radius=100)
    assert settling.verdict is Verdict.PROVED
    times = np.linspace(0, settling.time, 200)
    slowest = 100 * np.exp(-times) + 25 * (np.exp(-times) - np.exp(-5 * times))
    assert np.all(slowest <= settling.envelope(times) * (1 + INTEGRATION))
    assert settling.time >= np.log(125_000)


def test_couplings_that_turn_keep_their_guards():
    """Sin with one pin, from a box beyond its monotone range."""
    problem = cycle(3, h="sin(y)")
    settling = dd.certify_settling(problem, radius=1)
    assert settling.verdict is Verdict.PROVED
    assert not compare(problem, settling, runs=20).crossings


def test_starts_that_no_certificate_holds_leave_the_answer_undecided():
    """Sin, one pin: from |e| <= 4 other equilibria may be reached."""
    settling = dd.certify_settling(cycle(3, h="sin(y)"), radius=4)
    assert settling.verdict is Verdict.UNDECIDED
    assert "no max-separable certificate was found from |e|_inf <= 4" in settling.reason
    assert settling.time is None and settling.stages == ()
    with pytest.raises(SpecError, match="no envelope"):
        settling.envelope(1.0)


def test_couplings_of_vectors_do_not_apply():
    problem = Problem(network=pair("y").network, coupling=["y1 + y2**3", "y2"], gains={1: 5}, target=[0, 0])
    assert dd.certify_settling(problem, radius=1).reason.startswith("does not apply")


def test_without_a_region_the_starts_have_to_be_given():
    with pytest.raises(SpecError, match=r"radius must be given, because the problem has no \[region\]"):
        dd.certify_settling(cycle(3))
    with pytest.raises(SpecError, match="disturbance must be given"):
        dd.certify_settling(cycle(3, exosystem=HARMONIC), radius=1)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"radius": 0}, "radius must be > 0"),
        ({"radius": 1, "tolerance": 0}, "tolerance must be > 0"),
        ({"radius": 1, "tolerance": float("nan")}, "tolerance must be"),
        ({"radius": 1, "disturbance": -1}, "disturbance must be >= 0"),
        ({"radius": 1, "disturbance": 1}, "disturbance must be 0"),
        ({"radius": "far"}, "radius must be"),
    ],
)
def test_wrong_numbers_are_refused_by_name(numbers, message):
    with pytest.raises(SpecError, match=message):
        dd.certify_settling(cycle(3), **numbers)


def test_the_envelope_has_no_other_times_than_those_from_zero_on(fixed):
    for t in (-1.0, float("nan"), float("inf")):
        with pytest.raises(SpecError, match="t must be a time >= 0"):
            fixed.envelope(t)


def test_a_settling_time_shows_itself_as_text_and_as_escaped_html(fixed):
    text = repr(replace(fixed, problem_name="<b>"))
    assert "proved" in text and "max-separable" in text and f"{fixed.single_time:.6g} s" in text
    page = replace(fixed, problem_name="<b>")._repr_html_()
    assert "&lt;b&gt;" in page and page.count("<b>") == 1  # its own
    assert page.count("<tr>") == len(fixed.stages) + 1


@pytest.mark.slow
def test_the_numbers_are_those_of_every_other_run(fixed):
    """Same input and versions, same claims; asked in another process."""
    script = "import dobc_design as dd; print(dd.certify_settling('paper-fixed').staging.time)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, text=True, timeout=300)
    assert F(done.stdout.strip()) == fixed.staging.time
