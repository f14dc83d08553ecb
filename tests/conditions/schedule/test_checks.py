"""The check `settling`: written, read and confirmed again; claims that are changed by hand are not."""

from __future__ import annotations

import copy
import re
from dataclasses import replace
from fractions import Fraction

import confirming
import pytest
from checker_cases import HOLDS
from lure_cases import PAPER_GAIN
from quadratic_cases import quadratic_cases
from region_cases import judged
from staging_cases import problem, settling

from dobc_design.conditions.check import Check, check_from_json
from dobc_design.conditions.schedule.checks import StageTiming, settling_check, stage_timings
from dobc_design.verdict import Verdict

F = Fraction


@pytest.fixture(scope="module")
def check() -> Check:
    return settling_check(problem(), PAPER_GAIN, settling(), domain="consensus")


def confirmed(data: dict) -> str | None:
    """What the text of a check is answered with."""
    return confirming.confirmed(check_from_json(data), problem(), W=PAPER_GAIN)


def test_the_package_refuses_what_the_lone_checker_refuses_of_settling_times_and_boxes():
    """Claims whose truth is known, and their twins; the package's bounds on boxes are wider where V is not sharp."""
    for case in quadratic_cases():
        assert judged(case) == case.code or (case.code == HOLDS and case.name.startswith("wavy")), case.name


def test_a_proved_chain_is_written_read_and_confirmed(check: Check):
    assert check.verdict is Verdict.PROVED
    assert check.domain == {"kind": "box", "radius": 2.0, "disturbance": 0.5}
    kinds = [stage["kind"] for stage in check.exact["stages"]]
    assert kinds == ["max-separable", "max-separable", "quadratic", "quadratic"]
    assert [("diagonal" in stage, "factor" in stage) for stage in check.exact["stages"]][2:] == [(1, 0), (0, 1)]
    assert confirmed(check.to_json()) is None


def less(value: str | float) -> str | float:
    return str(F(value) * F(99, 100))


def more(value: str | float) -> str | float:
    return str(F(value) * F(101, 100)) if isinstance(value, str) else value * 1.01


STAGES = ("exact", "stages")


@pytest.mark.parametrize(
    ("path", "change", "answer"),
    [
        (("exact", "time"), less, "tolerance|last"),
        (("domain", "disturbance"), more, "first level set"),
        ((*STAGES, 1, "level"), less, "too small for what is handed over"),
        ((*STAGES, 2, "noise"), less, "noise is less"),
        ((*STAGES, 3, "factor"), less, "not semidefinite"),
        ((*STAGES, 0, "certificate", "rho"), more, "stage 1: the .* row"),
        ((*STAGES, 2, "certificate", "rate"), more, "stage 3: the matrix inequality"),
        ((*STAGES, 0, "kind"), lambda kind: "other", "."),
        ((*STAGES, 0, "stretch"), lambda value: "2", "the first stage"),
        (STAGES, lambda stages: stages[:1] * 101, "stages must be"),
        (("rate",), lambda rate: 1.0, "no rate"),
        (("verdict",), lambda verdict: "refuted", "the domain must be"),
    ],
)
def test_a_claim_changed_by_hand_is_not_confirmed(check: Check, path, change, answer):
    data = copy.deepcopy(check.to_json())
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = change(place.get(path[-1]) if isinstance(place, dict) else place[path[-1]])
    found = confirmed(data)
    assert found is not None
    assert re.search(answer, found), found


def test_the_stages_of_another_observer_gain_are_not_confirmed(check: Check):
    other = tuple(tuple(x * F(11, 10) for x in row) for row in PAPER_GAIN)
    assert confirming.confirmed(check, problem(), W=other) is not None
    assert confirming.confirmed(check, problem()) is not None


def test_an_undecided_settling_claims_nothing():
    undecided = replace(settling(), verdict=Verdict.UNDECIDED, reason="nothing was found.", staging=None)
    check = settling_check(problem(), PAPER_GAIN, undecided, domain="consensus")
    assert (check.verdict, check.domain, check.exact) == (Verdict.UNDECIDED, "consensus", None)


def test_later_stages_allow_longer_sampling_periods_and_faster_loops_with_delay():
    """The smaller the box the flatter exp(y): and none for quadratic stages."""
    first, second, *others = stage_timings(problem(), settling())
    assert others == [StageTiming(), StageTiming()]
    assert first.sampling.period < second.sampling.period
    assert 0 < first.delay.rate < second.delay.rate
