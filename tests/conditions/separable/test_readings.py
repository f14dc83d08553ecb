"""Late, held, lost and triggered readings, and the processor: known answers by hand, and what is
just beyond them."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified import only
from hypothesis import given
from hypothesis import strategies as st
from networks import network_of
from scipy import linalg, optimize

import dobc_design as dd
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.observer.decide import sampled_verdict
from dobc_design.conditions.observer.propose import (
    decay_of_error,
    design_sampled_gain,
    observer_gain,
)
from dobc_design.conditions.separable.claim import ErrorBound, Separable
from dobc_design.conditions.separable.decide import error_bound_obstacle
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.conditions.separable.stage import readings_stage, separable_stage
from dobc_design.conditions.separable.timing import (
    overshoots,
    rest_matrix,
    shortest_gap,
    steepness,
    turns_too_far,
    verify_readings,
)
from dobc_design.exact.interval import Interval, middle
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing, sampled
from dobc_design.problem.exosystems import Exosystem
from dobc_design.verdict import Verdict

F = Fraction
PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
PAPER = dd.load_problem("paper-fixed")
GAINS = {PAPER.network.labels[i]: gain for i, gain in PAPER.pinning.gains.items()}
#: The paper's network with the slopes of its coupling at the target.
LINEAR = loop_of(dd.Problem(network=PAPER.network, coupling="2*y", gains=GAINS))
#: M v = (1, ..., 1).
V = tuple(map(F, ("1", "3", "5/2", "2", "3/2") * 2))
A = ((F(0), F(2)), (F(-2), F(0)))
WAVE = Exosystem(A=A, C=[[1, 0]])
W = ((F("3.2"),), (F("2.4"),))


def with_timing(loop: Loop, **given: object) -> Loop:
    numbers = {key: x if isinstance(x, bool | int) else F(x) for key, x in given.items()}
    return replace(loop, timing=Timing(**numbers))


def verdict(rate: str, **given: object) -> dd.Verdict:
    claim = Separable(v=V, alpha=F(rate), rho=None)
    return verify_readings(with_timing(LINEAR, **given), None, claim).verdict


@pytest.mark.parametrize(
    ("delay", "rate", "beyond"),
    [("0", "1/3", "0.333334"), ("0.5", "0.178104", "0.178105"), ("3", "0.049040", "0.049041")],
)
def test_a_neighbour_that_is_late_costs_a_rate_that_is_known(delay, rate, beyond):
    # lambda = 1/3 at agent 2: 2 (5/2 exp(lambda tau) - 3) = -3 lambda there
    assert verdict(rate, delay=delay) is PROVED
    assert verdict(beyond, delay=delay) is REFUTED


@pytest.mark.parametrize(
    ("given", "beyond"),
    [
        ({"own_delay": "0.052553"}, {"own_delay": "0.052555"}),
        ({"period": "1/7"}, {"period": "0.142858"}),
        ({"period": "1/7", "sampled": True}, {"period": "0.142858", "sampled": True}),
        ({"period": "1/28", "own_delay": "1/28"}, {"period": "0.035715", "own_delay": "0.035715"}),
        ({"period": "4/189", "own_delay": "8/189"}, {"period": "0.021165", "own_delay": "0.04233"}),
    ],
)
def test_own_readings_cost_nothing_up_to_a_bound_that_is_known(given, beyond):
    # Q = 7: 1/(7 e), and d^d/(d + 1)^(d + 1)/7 for d = 0, 1, 2
    assert verdict("1/3", **given) is PROVED
    assert verdict("1/3", **beyond) is UNDECIDED


@given(d=st.integers(0, 6), part=st.sampled_from([F("0.999"), F("1.05")]))
def test_a_scalar_agent_with_d_ticks_changes_sign_just_beyond_the_bound(d, part):
    period = Timing(period=F(1), own_delay=F(d)).steepest * part
    past = [1.0] * (d + 1)
    for _ in range(4000):
        past.append(past[-1] - float(period) * past[-1 - d])
        if past[-1] < 0:
            break
    assert (min(past) < 0) is (part > 1)


def test_lost_readings_count_as_older_ones_and_an_event_as_a_larger_neighbour():
    held = Timing(period=F(1, 10), delay=F(1, 4), lost=2, event=F(1, 4))
    # ceil(2.5) + 2 ticks, each of which a rate of 1/s takes a tenth of
    assert float(held.stretch(F(1))) == pytest.approx(1.25 * 0.9**-5, rel=1e-15)
    assert held.stretch(F(1)) >= F(5, 4) / F(9, 10) ** 5
    flow = Timing(delay=F(1, 2), event=F(1, 4))
    assert float(flow.stretch(F(2))) == pytest.approx(1.25 * math.e, rel=1e-15)
    assert Timing(own_delay=F(1, 2)).lag(F(2)) >= F(math.e)


def test_kappa_of_the_page_is_needed_for_own_readings_as_late_as_they_may_be():
    # max over agents of Q (exp(beta/(e Q)) - 1) is that of Q = 2
    beta = F("1.6")
    drag = max(q * (Timing(own_delay=1 / (F(math.e) * q)).lag(beta) - 1) for q in (2, 7))
    assert float(1 / (beta - drag)) == pytest.approx(1.092160, abs=1e-6)


def test_the_observer_of_the_paper_sampled_has_the_radii_that_are_known():
    for period, radius in (("0.05", 0.919925), ("0.1", 0.840267), ("0.2", 0.686773)):
        timing = Timing(period=F(period), sampled=True)
        rate = -math.log(radius) / float(period)
        assert sampled_verdict(WAVE, W, timing, F(rate) - F(1, 10**4)) is PROVED
        assert sampled_verdict(WAVE, W, timing, F(rate) + F(1, 10**4)) is REFUTED
        assert decay_of_error(WAVE, W, timing) == pytest.approx(rate, abs=1e-5)


@pytest.mark.parametrize("turn", [0, 1])
def test_the_observer_of_the_paper_is_stable_sampled_on_intervals_that_are_known(turn):
    for part, found in ((0.01, PROVED), (0.5585, PROVED), (0.5587, REFUTED), (3.0, REFUTED)):
        timing = Timing(period=F(turn * math.pi + part), sampled=True)
        assert sampled_verdict(WAVE, W, timing) is found
    assert decay_of_error(WAVE, W, Timing(period=F("3.3"), sampled=True)) * 3.3 == pytest.approx(
        -math.log(0.7492), abs=1e-4
    )


def test_what_is_enclosed_of_an_exosystem_is_what_scipy_computes():
    for period in (F(1, 50), F(1), F("1.5707")):
        found = sampled(WAVE, Timing(period=period, sampled=True))
        step = linalg.expm(np.array(A, dtype=float) * float(period))
        mean = np.linalg.solve(np.array(A, dtype=float), step - np.eye(2)) / float(period)
        for row, truth in zip((*found.A, *found.C), (*step, mean[0]), strict=True):
            assert [float(x.midpoint) for x in row] == pytest.approx(list(truth), abs=1e-13)
            assert max(x.width for x in row) < F(1, 10**30)


@given(
    entries=st.lists(st.integers(-5, 5), min_size=6, max_size=6),
    spread=st.integers(0, 10),
    direction=st.lists(st.integers(-3, 3), min_size=3, max_size=3),
)
def test_no_matrix_of_an_interval_matrix_leaves_its_middle_by_more_than_the_room(
    entries, spread, direction
):
    width = F(spread, 7)
    places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    rows = [[Interval.point(0)] * 3 for _ in range(3)]
    worst = F(0)
    centre = F(0)
    for (i, j), x in zip(places, entries, strict=True):
        rows[i][j] = rows[j][i] = Interval(x - width, x + width)
        times = direction[i] * direction[j] * (1 if i == j else 2)
        worst += abs(times) * width
        centre += times * x
    found = middle(tuple(map(tuple, rows)))
    form = sum(
        direction[i] * direction[j] * (found.centre[i][j] + found.room[i][j])
        for i in range(3)
        for j in range(3)
    )
    assert form >= centre + worst


def test_an_observer_of_a_processor_decays_in_the_norm_that_is_proposed_and_no_faster():
    timing = Timing(period=F(1, 10), sampled=True)
    found = propose_error_bound(WAVE, W, rate=0.5, timing=timing)
    assert found is not None
    assert error_bound_obstacle(WAVE, W, found, timing) is None
    # the largest |eigenvalue| is 0.840267: no norm falls faster
    fastest = (1 - F("0.8402")) / F(1, 10)
    faster = replace(found, beta=fastest)
    assert "beta" in error_bound_obstacle(WAVE, W, faster, timing)
    smaller = replace(found, P=tuple(tuple(x / 100 for x in row) for row in found.P))
    assert "c'c" in error_bound_obstacle(WAVE, W, smaller, timing)
    assert "times the identity" in error_bound_obstacle(
        WAVE, W, replace(found, size=found.size / 10), timing
    )


def test_a_smaller_kappa_is_not_enough_where_own_readings_are_late():
    problem = dd.Problem(
        network=PAPER.network, coupling="2*y", gains=GAINS, exosystem=WAVE,
        readings={"own_delay": "0.02"},
    )  # fmt: skip
    loop = loop_of(problem)
    error = propose_error_bound(WAVE, W, rate=0.5)
    claim = Separable(v=V, alpha=F(1, 10), rho=None, error=error)
    steep = steepness(loop, claim, loop.timing)
    left = error.beta - claim.alpha - steep * (loop.timing.lag(error.beta) - 1)
    enough = replace(claim, error=replace(error, kappa=1 / left))
    assert verify_readings(loop, W, enough).verdict is PROVED
    less = replace(claim, error=replace(error, kappa=1 / left - F(1, 10**6)))
    assert "kappa" in verify_readings(loop, W, less).wrong


def test_a_constant_delay_of_everything_is_refuted_from_the_exact_margin_on():
    M = rest_matrix(LINEAR)
    roots = np.linalg.eigvals(np.array(M, dtype=float))
    margin = min((math.pi / 2 - abs(np.angle(mu))) / abs(mu) for mu in roots)
    assert margin == pytest.approx(0.222832, abs=1e-6)
    for part, fails in ((0.9999, False), (1.0001, True)):
        tau = F(margin * part)
        loop = with_timing(LINEAR, delay=tau, own_delay=2 * tau)
        found = [turns_too_far(loop, M, (F(mu.real), F(mu.imag))) for mu in roots]
        assert any(found) is fails
    # only what is late in everything is refuted by it
    loop = with_timing(LINEAR, delay="5")
    assert not any(turns_too_far(loop, M, (F(mu.real), F(mu.imag))) for mu in roots)


def test_a_period_is_refuted_from_the_exact_margin_on():
    M = rest_matrix(LINEAR)
    for period, fails in (("0.283718", False), ("0.283720", True)):
        assert overshoots(with_timing(LINEAR, period=period), M) is fails


def staged(problem: dd.Problem) -> dd.Check:
    loop = loop_of(problem)
    domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
    asked = read_region(loop, observer_gain(loop), domain=domain, everything=True)
    (check,) = readings_stage(asked, lambda text: None)
    return check


def pair(coupling: str = "tanh(y)", **more: object) -> dd.Problem:
    network = dd.Network.from_arcs([["tail", "head"]], arrow="listens_to")
    return dd.Problem(network=network, coupling=coupling, gains={"head": 1}, **more)


def test_nothing_is_said_without_the_tables():
    loop = loop_of(pair())
    asked = read_region(loop, None, domain=NEAR_TARGET, everything=True)
    assert readings_stage(asked, lambda text: None) == []


def test_linear_couplings_are_proved_everywhere_or_refuted():
    assert staged(pair("y", readings={"own_delay": "0.3"})).domain == EVERYWHERE
    assert staged(pair("y", processor={"period": "0.5"})).verdict is PROVED
    found = staged(pair("y", processor={"period": "2.1"}))
    assert found.verdict is REFUTED
    late = staged(pair("y", readings={"delay": "1.6", "own_delay": "1.6"}))
    assert late.verdict is REFUTED
    assert "pi/2" in late.reason
    # between what is proved and what is refuted nothing is said
    assert staged(pair("y", readings={"delay": "1.5", "own_delay": "1.5"})).verdict is UNDECIDED


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"uncertainty": {"disturbance": "0.1"}}, "disturbance"),
        (
            {
                "uncertainty": {"weights": "0.1", "known_to_agents": False},
                "exosystem": Exosystem(A=[[0]], C=[[1]]),
            },
            "do not know",
        ),
        ({"actuators": {"limit": 5}}, "limit"),
    ],
)
def test_what_is_not_counted_is_said(more, words):
    check = staged(pair(readings={"delay": "0.1"}, **more))
    assert check.verdict is UNDECIDED
    assert not check.applies
    assert words in check.reason


def test_own_readings_may_be_late_only_where_couplings_rise(monkeypatch: pytest.MonkeyPatch):
    # how much smaller a box has to be is not asked closely
    monkeypatch.setattr("dobc_design.conditions.separable.stage.ROUGHLY", ((60, 2),))
    region = {"initial_states": [-1, 1]}
    assert staged(pair("sin(y)", region=region, readings={"own_delay": "0.1"})).verdict is PROVED
    wide = {"initial_states": [-3, 3]}
    check = staged(pair("sin(y)", region=wide, readings={"own_delay": "0.1"}))
    assert not check.is_proved or check.domain.radius < 3


def test_errors_of_weights_and_gains_are_counted_with_late_readings():
    # one agent: its gain may be 10 % less
    alone = dd.Network.from_arcs({"a": []}, arrow="listens_to", agents=["1"])
    uncertain = {"gains": "0.1"}
    problem = dd.Problem(
        network=alone, coupling="y", gains={"1": 1}, uncertainty=uncertain,
        readings={"own_delay": "0.2"},
    )  # fmt: skip
    loop = loop_of(problem)
    for rate, found in (("0.9", PROVED), ("0.900001", REFUTED)):
        assert (
            verify_readings(loop, None, Separable(v=(F(1),), alpha=F(rate), rho=None)).verdict
            is found
        )
    # and ten percent more, which overshoots sooner
    late = replace(loop, timing=Timing(own_delay=F("0.35")))
    assert verify_readings(late, None, Separable(v=(F(1),), alpha=F("0.9"), rho=None)).wrong


@pytest.mark.parametrize("rate", [None, F(1, 2), F(2), F(10), F(1000)])
def test_a_gain_is_designed_for_the_recursion_with_the_rate_that_is_asked_for(rate):
    """rho(A_d - W C Gamma) < exp(-rate T), by the eigenvalues of SciPy's exponential."""
    T = 0.1
    timing = Timing(period=F(1, 10), sampled=True)
    found = design_sampled_gain(WAVE, timing, rate)
    if rate == 1000:  # of W that are rounded no eigenvalue is so close to 0
        assert found.W is None
        return
    assert found.W is not None
    block = np.block([[np.array(A, float), np.eye(2)], [np.zeros((2, 4))]])
    exponential = linalg.expm(block * T)
    Ad, Gamma = exponential[:2, :2], exponential[:2, 2:]
    error = Ad - np.array(found.W, float) @ np.array([[1.0, 0.0]]) @ Gamma
    assert max(abs(np.linalg.eigvals(error))) < math.exp(-float(rate or 0) * T)


def test_an_open_verdict_says_what_is_not_known_of_late_readings():
    problem = dd.Problem(
        network=dd.Network.from_arcs([[1, 2], [2, 3], [3, 1]], arrow="listens_to"),
        coupling="tanh(y)",
        goal="agreement",
        readings={"delay": "1/10"},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is UNDECIDED
    assert "is no difference of states at one time" in certificate.reason
    assert "What would help: a target with pins, or readings at the ticks" in certificate.reason


def test_another_equilibrium_refutes_a_loop_on_a_processor():
    """x = (0, 1) rests where h = y - y^3 and agent 1 is pinned at 0, from tick to tick as well."""
    problem = dd.Problem(
        network=dd.Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y - y**3",
        gains={1: "1/10"},
        processor={"period": "1/20"},
        region={"initial_states": [-3, 3]},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is REFUTED
    assert certificate.check("equilibrium").witness.values == ("0", "1")
    assert dd.verify(certificate, problem).holds
    run = dd.simulate(problem, start=[[0.0], [1.0]], t_final=2)
    assert np.abs(run.x[-1, :, 0] - [0, 1]).max() < 1e-12
    smaller = problem.replace(region={"initial_states": ["-1/4", "1/4"]})
    assert dd.certify(smaller).verdict is PROVED


def test_a_verdict_names_the_errors_of_weights_that_its_readings_count():
    problem = dd.Problem(
        network=dd.Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y",
        gains={1: 1, 2: 1},
        region={"initial_states": [-1, 1]},
        uncertainty={"weights": "1/50"},
        processor={"period": "1/10"},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is PROVED
    said = "with weights off by up to 2 % and everything computed every 0.1 s and held"
    assert said in certificate.reason


@pytest.mark.slow
def test_only_a_proof_with_late_readings_covers_a_region_where_they_are_stated():
    problem = dd.Problem(
        network=dd.Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y + y**3",
        gains={1: 1, 2: 1},
        region={"initial_states": [-1, 1]},
        readings={"delay": "1/2"},
    )
    with only(separable_stage):
        certificate = dd.certify(problem, everything=True)
    claims = {each.id: each for each in certificate.regions.claims}
    late, instant = claims["readings"], claims["max-separable"]
    assert late.covers
    assert late.time is not None
    assert not instant.covers
    assert instant.time is None
    assert instant.limit == "It is about readings of the same instant."


def test_nothing_is_said_of_the_value_agreed_upon_from_tick_to_tick():
    # what estimation errors add is a sum over ticks there, and W is that of the recursion
    problem = pair("y").replace(
        gains=None, goal="agreement", exosystem=dd.Exosystem(A=[[0]], C=[[1]]),
        region={"initial_states": [0, 1], "initial_disturbance": "0.1"},
    )  # fmt: skip
    assert dd.certify(problem).value is not None
    certificate = dd.certify(problem.replace(processor={"period": "0.1"}))
    assert certificate.verdict is PROVED
    assert certificate.value is None


def test_broadcasts_on_events_are_apart_by_the_time_in_which_a_threshold_is_reached():
    # agent 2: |e'| <= 2 (1.1 * 5/2 + 3) s = 11.5 s, the threshold is 0.3 s; agent 1, which has a
    # pin: 2 (1.1 * 3 + 1) + 5 = 13.6, and 0.1; the slope of t exp(t/6) at 0 is 1
    claim = Separable(v=V, alpha=F(1, 12), rho=None)
    found = float(shortest_gap(with_timing(LINEAR, event="1/10"), claim))
    root = optimize.brentq(lambda t: t * math.exp(t / 12) - 0.1 / 13.6, 0, 1)
    assert root * 0.9999 < found <= root
    assert shortest_gap(with_timing(LINEAR, event="1/10", period="1/50"), claim) is None
    late = with_timing(LINEAR, event="1/10", own_delay="1/50")
    grown = math.exp(1 / 600)  # of what it knew of itself
    root = 0.1 / (2 * (1.1 * 3 + grown) + 5 * grown)
    assert root * 0.999 < float(shortest_gap(late, claim)) < root
    # next to the target it moves by C eps, and its threshold is next to 0
    error = ErrorBound(P=((F(1),),), beta=F(1), kappa=F(9), size=F(1))
    assert shortest_gap(with_timing(LINEAR, event="1/10"), replace(claim, error=error)) is None
    falling = with_timing(loop_of(pair("sin(y)")), event="1/10")
    assert shortest_gap(falling, Separable(v=(F(1), F(1)), alpha=F(1, 9), rho=F(2))) is None


def test_broadcasts_on_events_count_errors_of_weights_and_gains_that_mix_components():
    # |e_c'| <= 1.1 (2 + 1/2) s of an agent that hears nobody
    alone = dd.Problem(
        network=network_of([], 1),
        coupling="y",
        target=[0, 0],
        gains={1: [["2", "1/2"], ["-1/2", "2"]]},
        uncertainty={"gains": "1/10"},
    )
    claim = Separable(v=(F(1),), alpha=F(1), rho=F(1))
    found = float(shortest_gap(with_timing(loop_of(alone), event="1/10"), claim))
    root = optimize.brentq(lambda t: t * math.exp(t) - 0.1 / 2.75, 0, 1)
    assert root * 0.99 < found <= root


def test_diagonal_gains_may_be_late_and_observers_that_are_not_there_need_no_weights():
    alone = dd.Problem(
        network=network_of([], 1),
        coupling="y",
        target=[0, 0],
        gains={1: [[2, 0], [0, 3]]},
        uncertainty={"weights": "1/10", "known_to_agents": False},
        readings={"own_delay": "1/10"},
    )
    claim = Separable(v=(F(1),), alpha=F(2), rho=None)
    assert verify_readings(loop_of(alone), None, claim).verdict is PROVED
    mixed = alone.replace(gains={1: [[3, "1/10"], [0, 2]]})
    found = verify_readings(loop_of(mixed), None, claim)
    assert found.verdict is UNDECIDED
    assert "a gain mixes components" in found.reason


def test_agents_that_fit_no_two_sides_are_not_refuted_by_the_network_without_signs():
    # eigenvalues 2 - sqrt(2) and 2 + sqrt(2): they go to 0 for T < 2/(2 + sqrt(2)) = 0.586; the
    # ring without signs has the eigenvalue 0
    arcs = [[1, 2], [2, 3], [3, 4], [4, 1, -1]]
    both = arcs + [[j, i, *w] for i, j, *w in arcs]
    network = dd.Network.from_arcs(both, arrow="listens_to", negative="opposes")
    ring = dd.Problem(network=network, coupling="y", processor={"period": "0.4"})
    certificate = dd.certify(ring)
    assert certificate.verdict is UNDECIDED
    (check,) = [each for each in certificate.checks if each.id == "readings"]
    assert "second checker" not in check.reason


def test_a_verdict_says_first_what_agents_read_then_how_fast_they_arrive():
    late = pair("y", readings={"delay": "1/10", "own_delay": "1/50"})
    with only(separable_stage, readings_stage):
        reason = dd.certify(late).reason
    who, _, pace = reason.partition(", at a rate of at least ")
    assert who.endswith("with readings of neighbours up to 0.1 s old and own ones up to 0.02 s old")
    assert "falls to one percent within" in pace
    assert ",," not in reason
