"""A region that only an arc-wise certificate covers, and everything that is asked of it."""

import math
from functools import cache
from itertools import product

import pytest
from arc_wise import radius_of, rows, searched
from certified import only, rough_settling, settling_alone

from dobc_design import (
    Certificate,
    Verdict,
    certify,
    design,
    falsify,
    signals,
    simulate,
    verify,
    what_breaks_first,
)
from dobc_design.conditions.arcs.stage import arcs_stage
from dobc_design.conditions.domain import Ball, Box
from dobc_design.conditions.separable.stage import separable_stage


@cache
def proved() -> Certificate:
    return certify(rows())


def test_it_covers_a_region_for_which_no_common_box_exists():
    certificate = proved()
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "arc-wise"
    verdicts = {check.id: check.verdict for check in certificate.checks}
    assert verdicts["max-separable"] is Verdict.REFUTED
    assert verify(certificate, rows()).holds


@pytest.mark.slow
@only(separable_stage, arcs_stage)
def test_it_answers_for_weights_and_gains_that_err_and_a_limit_stays_open_beside_it():
    """Of inputs it says nothing."""
    off = {"weights": "1/5", "gains": "1/10"}
    problem = rows(uncertainty=off)
    certificate = certify(problem)
    assert (certificate.verdict, certificate.covered_by) == (Verdict.PROVED, "arc-wise")
    assert certificate.rate < proved().rate / 2
    assert "with weights off by up to 20 % and gains off by up to 10 %" in certificate.reason
    assert verify(certificate, problem).holds
    assert not verify(proved(), problem).holds
    limited = rows(uncertainty=off, actuators={"limit": 100, "amplitude": 0})
    assert certify(limited).verdict is Verdict.UNDECIDED
    assert certify(rows(uncertainty={"weights": "3/10"})).verdict is Verdict.UNDECIDED


@pytest.mark.parametrize(
    ("radius", "needs"), [("3/2", "the region needs 3"), (None, "no region is asked for")]
)
def test_where_it_covers_nothing_the_largest_ball_is_proved_and_said(radius, needs):
    check = searched(rows(radius))
    assert isinstance(check.domain, Ball)
    assert 1.9 < radius_of(check) < 2
    assert f" {needs}: beyond, no a and b of the arcs are found." in check.reason
    assert check.remark.startswith(f"The ball reaches |e| <= {check.domain.radius:.6g} ")


def test_it_has_a_row_among_the_regions():
    (row,) = (each for each in proved().regions.claims if each.id == "arc-wise")
    check = next(each for each in proved().checks if each.id == "arc-wise")
    assert isinstance(check.domain, Box)
    assert (row.method, row.kind, row.box, row.covers) == ("Arc-wise", "box", 0.8, True)
    # From |e| <= 1.6, where all four agents are at an edge, to a hundredth of 0.8.
    assert row.time == pytest.approx(math.log(1.6 / 0.008) / check.rate, rel=1e-3)


def test_its_bound_over_time_holds_for_a_run():
    certificate = proved()
    run = simulate(rows(), seed=1, t_final=20)
    bound = certificate.envelope(run)
    assert bound.sources == ("arc-wise",)
    assert (run.error() <= bound(run.times) + 1e-9).all()
    assert certificate.bound([0]) == pytest.approx([1.6])


@pytest.mark.slow
def test_a_search_from_its_boundary_finds_no_run_that_leaves_and_names_it():
    searched = falsify(proved(), runs=40, seed=1)
    targets = {search.target: search for search in searched.searches}
    search = targets["the boundary of the arc-wise set"]
    assert search.suspects == ()
    assert search.certified_rate < search.observed_rate


@pytest.mark.slow
@rough_settling()
@only(separable_stage, arcs_stage)
def test_a_settling_time_ends_with_it():
    """By itself from |e| <= 1.6 to a hundredth at its rate; sooner where the pinned agent has come
    closer before it takes over."""
    certificate = certify(rows(), settling="1/100")
    settling = certificate.settling
    assert settling.verdict is Verdict.PROVED
    assert float(settling.time) < 0.95 * math.log(160) / certificate.rate
    assert [stage.kind for stage in settling.stages] == ["moving box", "arc-wise"]
    assert verify(certificate, rows()).lone_checker == "it accepts every claim"


@pytest.mark.slow
@rough_settling()
@only(separable_stage, arcs_stage)
def test_a_box_that_moves_is_handed_over_to_it_from_where_it_does_not_reach_itself():
    """Corners with |e_i| = 1 lie outside of every ball that it proves; once agent 1 is close, the
    box fits.  With |e_i| = 1.1 three corners alone are too far out, since no box falls for both
    modes."""
    certificate = certify(rows("1"), settling="1/100")
    assert (certificate.verdict, certificate.covered_by) == (Verdict.PROVED, "settling")
    settling = certificate.settling
    assert settling.verdict is Verdict.PROVED
    assert [stage.kind for stage in settling.stages] == ["moving box", "arc-wise"]
    assert verify(certificate, rows("1")).lone_checker == "it accepts every claim"
    horizon = float(settling.time)
    for signs in product([1.0, -1.0], repeat=3):
        corner = {"x": [[1.0], *([sign] for sign in signs)]}
        run = simulate(rows("1"), t_final=horizon, start=corner, signal=signals.Periodic(dwell=0.3))
        assert run.error()[-1].max() <= 0.01
    assert settling_alone(rows("11/10"), tolerance="1/100").verdict is Verdict.UNDECIDED


@pytest.mark.slow
def test_a_design_is_compared_with_the_rate_that_it_certifies():
    found = design(rows())
    assert found.verdict is Verdict.PROVED
    assert "Your own gains are certified at 0.126" in found.decisions[0]


def test_what_breaks_first_knows_that_it_states_no_period():
    found = what_breaks_first(rows(), options=["period"], certificate=proved())
    assert found.period is not None
    assert found.period.certified is None
    assert 0.3 < found.period.converges < 0.6
