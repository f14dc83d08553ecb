"""The check `settling`: written, read and confirmed again; claims that are changed by hand are not."""

from __future__ import annotations

import copy
import re
from fractions import Fraction

import confirming
import pytest
from lure_cases import PAPER_GAIN
from staging_cases import ASKED, chain, problem

from dobc_design.conditions.check import Check, check_from_json
from dobc_design.conditions.schedule.checks import StageTiming, settling_check, stage_timings
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.verdict import Verdict

F = Fraction


def settling() -> Settling:
    return Settling(
        verdict=Verdict.PROVED,
        reason="",
        problem_name="three",
        radius=ASKED.radius,
        disturbance=ASKED.disturbance,
        tolerance=ASKED.tolerance,
        staging=chain(),
    )


@pytest.fixture(scope="module")
def check() -> Check:
    return settling_check(problem(), PAPER_GAIN, settling(), domain="consensus")


def confirmed(data: dict) -> str | None:
    """What the text of a check is answered with."""
    return confirming.confirmed(check_from_json(data), problem(), W=PAPER_GAIN)


def test_a_proved_chain_is_written_read_and_confirmed(check: Check):
    assert check.verdict is Verdict.PROVED
    assert check.domain == {"kind": "box", "radius": 2.0, "disturbance": 0.5}
    kinds = [stage["kind"] for stage in check.exact["stages"]]
    assert kinds == ["max-separable", "max-separable", "quadratic", "quadratic"]
    assert [("diagonal" in stage, "factor" in stage) for stage in check.exact["stages"]][2:] == [(1, 0), (0, 1)]
    assert confirmed(check.to_json()) is None


def less(text: str) -> str:
    return str(F(text) * F(99, 100))


def more(text: str) -> str:
    return str(F(text) * F(101, 100))


@pytest.mark.parametrize(
    ("path", "change", "answer"),
    [
        (("exact", "time"), less, "tolerance|last"),
        (("exact", "tolerance"), less, "last stage"),
        (("domain", "radius"), lambda value: value * 1.01, "first level set"),
        (("domain", "disturbance"), lambda value: value * 1.01, "first level set"),
        (("exact", "stages", 1, "level"), less, "too small for what is handed over"),
        (("exact", "stages", 2, "noise"), less, "noise is less"),
        (("exact", "stages", 2, "stretch"), less, "not semidefinite"),
        (("exact", "stages", 3, "factor"), less, "not semidefinite"),
        (("exact", "stages", 3, "height"), less, "height"),
        (("exact", "stages", 0, "certificate", "alpha"), more, "stage 1: the .* row"),
        (("exact", "stages", 0, "certificate", "rho"), more, "stage 1: the .* row"),
        (("exact", "stages", 2, "certificate", "rate"), more, "stage 3: the matrix inequality"),
        (("exact", "stages", 0, "kind"), lambda kind: "quadratic", "."),
        (("exact", "stages", 0, "kind"), lambda kind: "other", "."),
        (("exact", "stages", 0, "stretch"), lambda value: "2", "the first stage"),
        (("exact", "stages", 0, "factor"), lambda value: "1", "."),
        (("exact", "stages"), lambda stages: [], "stages must be"),
        (("exact", "stages"), lambda stages: stages[:1] * 101, "stages must be"),
        (("exact", "stages"), lambda stages: [stages[0], stages[3]], "."),
        (("exact", "extra"), lambda value: "1", "."),
        (("rate",), lambda rate: 1.0, "no rate"),
        (("verdict",), lambda verdict: "refuted", "the domain must be"),
        (("domain",), lambda domain: "global", "."),
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
    undecided = Settling(
        verdict=Verdict.UNDECIDED,
        reason="nothing was found.",
        problem_name="",
        radius=F(1),
        disturbance=F(0),
        tolerance=F(1, 10),
    )
    check = settling_check(problem(), PAPER_GAIN, undecided, domain="consensus")
    assert (check.verdict, check.domain, check.exact) == (Verdict.UNDECIDED, "consensus", None)


def test_later_stages_allow_longer_sampling_periods_and_faster_loops_with_delay():
    """The smaller the box the flatter exp(y): and none for quadratic stages."""
    first, second, *others = stage_timings(problem(), settling())
    assert others == [StageTiming(), StageTiming()]
    assert first.sampling.period < second.sampling.period
    assert 0 < first.delay.rate < second.delay.rate
