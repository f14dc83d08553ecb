"""`settling` beside the other checks of a certificate: which starts, when it is left out, and what
is made of it."""

import json
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from certified import coarse_tables, few_chords, rough_settling, settling_alone
from checker_files.files import accepted_by
from networks import cycle, pair
from regional_problems import HARMONIC, listening_pair
from simulated_runs import INTEGRATION, compare
from texts import exosystem_of

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.domain import NEAR_TARGET, Box
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.conditions.schedule import propose, stage
from dobc_design.conditions.schedule.decide import why_not
from dobc_design.conditions.separable.claim import Separable
from dobc_design.errors import CertificateError, SpecError
from dobc_design.exact.work import spend
from dobc_design.loop.make import loop_of
from dobc_design.verdict import Verdict

F = Fraction


@cache
@coarse_tables()
@few_chords()
def certified() -> dd.Certificate:
    """Two agents, sin, k = 1/10, starts in [-1, 1]."""
    return dd.certify(listening_pair(reach=1), settling="1/100")


def changed(certificate: dd.Certificate, **exact: object) -> bytes:
    """The text of the certificate with other exact values in `settling`."""
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "settling"]
    check["exact"] |= exact
    return json.dumps(data).encode()


def test_the_check_stands_in_the_certificate_and_both_programs_accept_it():
    check = certified().check("settling")
    assert check.verdict is Verdict.PROVED
    assert check.domain == Box(1.0, 0.0)
    assert check.rate is None
    found = dd.verify(certified(), certified().problem)
    assert found.holds
    assert "settling" in found.confirmed


def endless(*args: Any) -> Iterator[Any]:
    """Balls that are looked for as long as there is work."""
    while True:
        spend(1000)
    yield


@coarse_tables()
@few_chords()
def test_balls_that_take_too_long_leave_time_for_the_box_that_moves(monkeypatch):
    monkeypatch.setattr(propose, "_quadratic", endless)
    case = Case(loop=loop_of(listening_pair(reach=1)), W=None, domain=NEAR_TARGET, checks=())
    found = stage.settling_stage(case, tolerance=F(1, 100), report=lambda text: None)
    assert found.verdict is Verdict.PROVED
    assert isinstance(found.claim.certificate, Separable)


def test_a_settling_time_changes_no_verdict():
    without = dd.certify(listening_pair(reach=1))
    beside = certified()
    assert "settling" not in {check.id for check in without.checks}
    assert without.settling is None
    for name in ("verdict", "rate", "covered_by"):
        assert getattr(without, name) == getattr(beside, name)


def test_the_envelope_comes_back_from_the_certificate_and_simulated_starts_stay_below_it():
    settling = certified().settling
    assert settling.radius == F(1)
    assert settling.tolerance == F(1, 100)
    times = np.linspace(0, settling.time, 50)
    bounds = settling.envelope(times)
    assert bounds[0] >= 1
    assert bounds[-1] <= 0.01
    assert np.all(np.diff(bounds) <= 0)
    assert certified().regions.tolerance == 0.01
    for start in ([1, -1], [1, 1], [-1, 0.3]):
        initial = {"x": [[x] for x in start]}
        run = dd.simulate(certified().problem, start=initial, t_final=settling.time)
        allowed = settling.envelope(run.times) + 1e-7
        assert np.all(run.error() <= allowed)


def test_a_claim_that_cannot_be_read_says_so():
    claims = certified().claims
    checks = tuple(
        replace(c, claim=Values({"time": "soon"})) if c.id == "settling" else c
        for c in claims.checks
    )
    broken = replace(certified(), claims=replace(claims, checks=checks))
    with pytest.raises(CertificateError, match="cannot be read"):
        _ = broken.settling


def box(radius: float, verdict: Verdict = Verdict.PROVED, reason: str = "") -> Check:
    domain = Box(radius, 0.0)
    claim = Separable(v=(F(1),), alpha=F(1), rho=F(radius)) if verdict is Verdict.PROVED else None
    return Check(id="max-separable", verdict=verdict, domain=domain, reason=reason, claim=claim)


def asked_beside(problem: dd.Problem, *checks: Check, tolerance: Fraction | None = None) -> Any:
    """What is asked of a settling time beside these checks, without a W."""
    case = Case(loop=loop_of(problem), W=None, domain=NEAR_TARGET, checks=checks)
    return stage.asked_beside(case, tolerance=tolerance)


def test_starts_are_the_region_or_as_much_of_it_as_is_proved():
    problem = listening_pair(reach=2)
    none = listening_pair(reach=None)
    ball = asked_beside(problem, box(2.0), tolerance=F(1, 9))
    assert ball.radius == 2
    assert asked_beside(problem, box(1.5)).tolerance == F(3, 200)
    assert asked_beside(problem).radius == 2
    assert asked_beside(none, box(1.5)).radius == F(3, 2)


def test_without_starts_or_without_a_certificate_it_is_left_out():
    none = listening_pair(reach=None)
    assert "nothing says where the agents start" in asked_beside(none)
    open_one = box(1.0, Verdict.UNDECIDED)
    assert "nothing says where the agents start" in asked_beside(none, open_one)
    assert "the target alone" in asked_beside(listening_pair(reach=[0, 0]))


def line(coupling: str | list[str], **more: object) -> dd.Problem:
    """Agent 1 is pinned with 5, agent 2 hears it."""
    arcs = [[2, 1]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    region = {"initial_states": [-1, 1]}
    return dd.Problem(network=network, coupling=coupling, gains={1: 5}, region=region, **more)


def test_couplings_that_do_not_act_by_component_leave_it_undecided():
    problem = line(["y1 + y2**3", "y2"], target=[0, 0])
    case = Case(loop=loop_of(problem), W=None, domain=NEAR_TARGET)
    check = stage.settling_stage(case, tolerance=F(1), report=lambda name: None)
    assert check.verdict is Verdict.UNDECIDED
    assert check.reason.startswith("does not apply")
    assert settling_alone(problem, radius=1).reason.startswith("does not apply")


@few_chords()
def test_agents_with_different_exosystems_settle_and_both_programs_accept_it():
    """e_i' = -2 e_i + eps_i, eps_i' = -b_i eps_i: the slower group's error decides; twin: one
    percent sooner."""
    agents = ((1, 4), (2, 1))
    groups = []
    for agent, b in agents:
        groups.append(
            dd.Group(
                agents=[agent], exosystem=exosystem_of("0", "1"), observer=dd.Observer(W=[[b]])
            )
        )
    network = dd.Network.from_arcs([], arrow="listens_to", agents=2)
    region = {"initial_states": [-1, 1]}
    region["initial_disturbance"] = 1
    problem = dd.Problem(network=network, coupling="y", gains=2, groups=groups, region=region)
    certificate = dd.certify(problem, settling="1/100")
    found = dd.verify(certificate, problem)
    assert found.holds
    assert "settling" in found.confirmed
    # With e(0) = eps(0) = 1 agent 2 has e = exp(-t) exactly: no time before ln 100 is true.
    assert np.log(100) <= certificate.settling.time <= 3 * np.log(100)
    own = certificate.check("settling").exact["time"]
    too_early = str(F(own) * F(99, 100))
    hurried = changed(certificate, time=too_early)
    twin = dd.verify(hurried, problem)
    assert not twin.holds
    assert "settling" in twin.lone_checker
    quadratic = certificate.check("settling").exact["last"]
    last = dict(quadratic) | {"kind": "quadratic"}
    assert not dd.verify(changed(certificate, last=last), problem).holds


@few_chords()
def test_everything_with_a_region_includes_it_at_a_hundredth_of_the_radius():
    certificate = dd.certify(line("y"), everything=True)
    assert certificate.check("settling").exact["tolerance"] == "1/100"


@pytest.fixture(scope="module")
def fixed():
    return settling_alone("paper-fixed")


@pytest.mark.evidence
def test_example_1_holds_a_settling_time_that_the_lone_checker_decides():
    """R = 4, |eps_i| <= 1/2; Example 2 is among the evidence."""
    certificate = dd.certify("paper-fixed", settling="1/1000")
    assert dd.verify(certificate, "paper-fixed").holds
    text = json.dumps(certificate.check("settling").to_json())
    settling = json.loads(text)["exact"]
    tube = settling["tube"]
    middle = len(tube["times"]) // 2
    entry = F(tube["upper"][middle][4])
    smaller = entry * F(9, 10)
    tube["upper"][middle][4] = str(smaller)
    twin = dd.verify(changed(certificate, tube=tube), "paper-fixed")
    assert not twin.holds
    assert "settling" in twin.lone_checker


@pytest.mark.slow
def test_example_1_settles_hardly_later_than_its_slowest_run(fixed):
    """Found: 19.81 s; the slowest simulated run takes 18.9 s, one rate for the box 43.7 s."""
    assert fixed.verdict is Verdict.PROVED
    assert fixed.radius == 4
    assert fixed.disturbance == F(1, 2)
    assert fixed.tolerance == F(1, 1000)
    assert 18.9 < fixed.time <= 20.5
    assert fixed.single_time == pytest.approx(43.7, abs=0.5)


@pytest.mark.slow
def test_example_1_is_proved_again_and_fails_earlier_or_in_smaller_boxes(fixed):
    problem = dd.load_problem("paper-fixed")
    claim = fixed.claim
    W = observer_gain(loop_of(problem))
    tube = claim.tube
    assert why_not(loop_of(problem), W, claim) is None
    descending = claim.time - tube.ends
    hurried = descending * F(999, 1000)
    early = replace(claim, time=tube.ends + hurried)
    assert "by the time claimed" in why_not(loop_of(problem), W, early)
    fifth = len(tube.times) // 5
    for k in range(1, len(tube.times), fifth):
        box = tuple(x * F(19, 20) for x in tube.upper[k])
        behind = tube.upper[k + 1 :]
        upper = (*tube.upper[:k], box, *behind)
        smaller = replace(tube, upper=upper)
        assert "a row does not hold" in why_not(loop_of(problem), W, replace(claim, tube=smaller))


@pytest.mark.slow
def test_no_run_of_example_1_crosses_the_envelope(fixed):
    """100 random starts of the region, and corners of the box."""
    found = compare(dd.load_problem("paper-fixed"), fixed, runs=100)
    assert not found.crossings
    assert found.runs == 108
    assert found.settled <= fixed.time <= 1.1 * found.settled
    assert found.closest > 0.5  # the comparison means something


@pytest.mark.evidence
def test_example_2_settles_three_times_sooner_than_one_rate_says_and_no_run_crosses_the_envelope():
    """Found: 83.5 s for arbitrary switching among the four modes; the runs switch as the problem
    says."""
    settling = settling_alone("paper-switching")
    assert settling.verdict is Verdict.PROVED
    assert settling.time <= 84
    assert settling.single_time / settling.time >= 3
    assert settling.claim.kind == "quadratic"
    found = compare(dd.load_problem("paper-switching"), settling, runs=10)  # more in the evidence
    assert not found.crossings
    assert found.settled <= settling.time


@pytest.mark.slow
def test_all_pinned_alike_settle_as_their_gain_says():
    """V = 1 and alpha = k = 5: |e| <= R exp(-5 t), so ln(2000)/5 s."""
    at_first = cycle(4, gains=5)
    settling = settling_alone(at_first, radius=2, tolerance="1/1000")
    exactly = np.log(2000) / 5
    assert settling.time == pytest.approx(exactly, abs=1e-3)


@few_chords()
def test_a_linear_problem_settles_for_every_radius():
    """Agent 1 alone: e' = -5 e; agent 2 follows: e_2' = e_1 - e_2."""
    settling = settling_alone(pair("y"), radius=100)
    assert settling.verdict is Verdict.PROVED
    times = np.linspace(0, settling.time, 200)
    slow = 100 * np.exp(-times)
    fast = np.exp(-times) - np.exp(-5 * times)
    slowest = slow + 25 * fast
    assert np.all(slowest <= settling.envelope(times) * (1 + INTEGRATION))
    assert settling.time >= np.log(125_000)


@rough_settling()
def test_starts_that_no_certificate_holds_leave_the_answer_undecided():
    """Sin, one pin: from |e| <= 4 other equilibria may be reached."""
    turning = cycle(3, h="sin(y)")
    settling = settling_alone(turning, radius=4, tolerance=2)
    assert settling.verdict is Verdict.UNDECIDED
    assert "no moving box was found from |e|_inf <= 4" in settling.reason
    assert settling.time is None
    assert settling.stages == ()
    with pytest.raises(SpecError, match="no envelope"):
        settling.envelope(1.0)


@pytest.mark.slow
@few_chords()
def test_starts_that_are_named_take_the_place_of_the_region_and_both_programs_accept_it():
    """The pair above, from a larger box than its [region]; alone it gives the same time."""
    problem = listening_pair(reach=1)
    certificate = dd.certify(problem, settling="1/100", settling_radius="11/10")
    check = certificate.check("settling")
    assert check.domain == Box(1.1, 0.0)
    assert dd.verify(certificate, problem).holds
    alone = settling_alone(problem, tolerance="1/100", radius="11/10")
    assert certificate.settling.time == alone.time > certified().settling.time
    # What a report tells to run again asks for the same starts.
    assert certificate.claims.options == (
        "--settling 1/100",
        "--settling-radius 11/10",
        "--settling-disturbance 0",
    )


def test_without_a_region_the_starts_have_to_be_given():
    without = cycle(3, exosystem=HARMONIC)
    with pytest.raises(
        SpecError, match=r"settling_radius must be given, because the problem has no \[region\]"
    ):
        dd.certify(without, settling=1, settling_disturbance=1)
    with pytest.raises(SpecError, match="settling_disturbance must be given"):
        dd.certify(without, settling=1, settling_radius=1)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"settling_radius": 0}, "settling_radius must be > 0"),
        ({"settling": 0}, "settling must be > 0"),
        ({"settling": float("nan")}, "settling must be"),
        ({"settling": None}, "settling must be given"),
        ({"settling_disturbance": -1}, "settling_disturbance must be >= 0"),
        ({"settling_disturbance": 1}, "settling_disturbance must be 0"),
        ({"settling_radius": "far"}, "settling_radius must be"),
    ],
)
def test_wrong_numbers_are_refused_by_name(numbers, message):
    options = {"settling": 1, "settling_radius": 1} | numbers
    with pytest.raises(SpecError, match=message):
        dd.certify(cycle(3), **options)


def test_the_envelope_has_no_other_times_than_those_from_zero_on():
    for t in (-1.0, float("nan"), float("inf")):
        with pytest.raises(SpecError, match="t must be a time >= 0"):
            certified().settling.envelope(t)


def test_own_late_readings_leave_it_undecided_and_both_programs_refuse_a_forged_one():
    late = listening_pair(reach=1).replace(readings={"delay": "1/10", "own_delay": "1/50"})
    case = Case(loop=loop_of(late), W=None, domain=NEAR_TARGET, checks=())
    found = stage.settling_stage(case, tolerance=F(1, 100), report=lambda text: None)
    assert found.verdict is Verdict.UNDECIDED
    assert "own_delay, a period, and errors of weights or gains are not known" in found.reason
    data = json.loads(certificate_bytes(dd.certify(late).claims))
    assert accepted_by(data, late) == (True, True)
    (forged,) = [x for x in certified().claims.checks if x.id == "settling"]
    data["checks"].append(forged.to_json())
    assert accepted_by(data, late) == (False, False)


@pytest.mark.slow
def test_nothing_settles_below_a_tolerance_where_something_acts_for_ever():
    """What [uncertainty] says acts for ever; with a bound of 0 the time is proved."""
    calm = cycle(3).replace(region={"initial_states": [-1, 1]})
    assert settled(calm).is_proved
    assert settled(calm.replace(uncertainty={"disturbance": 0})).is_proved
    check = settled(calm.replace(uncertainty={"disturbance": "1/100"}))
    assert check.verdict is Verdict.UNDECIDED
    assert "acts for ever" in check.reason


def settled(problem: dd.Problem) -> Check:
    """The check of a settling time to 1/20."""
    certificate = dd.certify(problem, settling="1/20")
    return next(check for check in certificate.checks if check.id == "settling")
