"""Certified bounds of |e(t)|_inf beside simulated runs: worked out by hand, never crossed, and only
where they hold."""

import json
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from checker_files import schedules, separable
from checker_files.schedules import (
    A_ENDS,
    A_STARTS,
    CHAINED,
    CUBIC,
    GOES_ON,
    GRAPHS,
    OBSERVED,
    retimed,
)
from checker_files.settling import SEEN

import dobc_design as dd
from dobc_design import Certificate, Exosystem, Network, Observer, Problem, Verdict
from dobc_design.certificate.bounds import certified_bound, keeps_guarantee
from dobc_design.certificate.claims import certified_period
from dobc_design.certificate.text import read_claims
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.domain import Ball
from dobc_design.errors import CertificateError, SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import problem_from_canonical
from dobc_design.report.pictures import error_picture, svg_of


def ring(*, disturbed: bool = True, n: int = 3, **settings) -> Problem:
    """Agents in a directed ring, all pinned."""
    given = {"coupling": "y", "gains": 3, "target": 1, "name": "ring"}
    if disturbed:
        given["exosystem"] = Exosystem(A=[[0]], C=[[1]])
        given["observer"] = Observer(W=[[4]])
    arcs = []
    for i in range(n):
        arcs.append([i + 1, (i + 1) % n + 1])
    network = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    return Problem(network=network, **given | settings)


REGION = {"initial_states": [0, 2], "initial_disturbance": "1/2"}
N = 3
FAR = np.linspace(0, 2, N)[:, None]
NEAR = np.linspace(0.9, 1.1, N)[:, None]
#: A start close to the target, with no disturbance.
QUIET = {"x": NEAR, "xi": 0 * NEAR}


@pytest.fixture(scope="module")
def curved() -> tuple[Problem, Certificate]:
    """A max-separable proof of the region, and beside it a quadratic claim in numbers of our own,
    nobody's proof."""
    problem = ring(n=N, coupling="exp(y) - 1 + y", region=REGION)
    certificate = dd.certify(problem)
    assert certificate.covered_by == "max-separable"
    checks = (*certificate.checks, QUADRATIC)
    return problem, replace(certificate, claims=replace(certificate.claims, checks=checks))


SIZES = {"method": "lure", "level": "5/2", "radius": "1", "rate": "1/4"}
FORMS = {"P": [["2"]], "P_e": [[0, 0, "2"], [0, 1, "1/2"], [1, 1, "1"], [2, 2, "3"]]}
SECTOR = {"coupling": 0, "gains": [[["1", "4"]]]}
QUADRATIC = Check(
    id="lure",
    verdict=Verdict.PROVED,
    domain=Ball(0.5, 0.25),
    rate=0.25,
    reason="",
    claim=Values(SIZES | FORMS | {"multipliers": {"G": []}, "ranges": [SECTOR]}),
)


DRAWN = "certified bound on |e|∞"


def only(certificate: Certificate, *ids: str) -> Certificate:
    checks = tuple(check for check in certificate.checks if check.id in ids)
    return replace(certificate, claims=replace(certificate.claims, checks=checks))


def test_the_max_separable_bound_is_that_of_its_numbers(curved):
    """|e_i| <= v_i V, V(0) <= R/min v + kappa s sqrt(size), V falls at min(alpha, beta - 1/(kappa
    min v))."""
    problem, certificate = curved
    exact = certificate.check("max-separable").exact
    v = [float(Fraction(x)) for x in exact["v"]]
    names = ("alpha", "beta", "kappa", "size")
    alpha, beta, kappa, size = (float(Fraction(exact[name])) for name in names)
    run = dd.simulate(problem, start={"x": FAR}, t_final=2)
    bound = only(certificate, "max-separable").envelope(run)
    box, _, disturbance = run.start_size()
    first = box / min(v) + kappa * disturbance * np.sqrt(size)
    t = np.array([0.0, 0.5, 3.0])
    rate = min(alpha, beta - 1 / (kappa * min(v)))
    wanted = max(v) * first * np.exp(-rate * t)
    np.testing.assert_allclose(bound(t), wanted, rtol=1e-9)
    assert (bound(t) >= wanted * (1 - 1e-15)).all()
    assert bound(np.array([1e9])) > 0  # what underflows is not 0
    assert bound.sources == ("max-separable",)


@pytest.mark.parametrize(("radius", "squared"), [(0.5, None), (0.9, 2.5)])
def test_the_quadratic_bound_is_that_of_its_ellipsoid(curved, radius: float, squared):
    """V(0) <= lambda_max(P_e) |e(0)|^2 + n lambda_max(P) s^2, and no more than the level; |e_c|^2
    <= V (P_e^-1)_cc."""
    problem, certificate = curved
    rows = [[2, 0.5, 0], [0.5, 1, 0], [0, 0, 3]]
    P_e = np.array(rows)
    check = replace(QUADRATIC, domain=Ball(radius, 0.25))
    claims = replace(certificate.claims, checks=(check,))
    run = dd.simulate(problem, start=QUIET, t_final=2)
    bound = certified_bound(problem, claims, run)
    _, ball, disturbance = run.start_size()
    assert ball <= radius
    of_positions = np.linalg.eigvalsh(P_e)[-1]
    of_errors = N * 2 * disturbance**2
    first = of_positions * ball**2 + of_errors
    if squared is not None:
        first = min(first, squared)
    tallest = 0.0
    # the point of the ellipsoid that is farthest in direction c, by Lagrange
    for c in range(N):
        direction = np.linalg.solve(P_e, np.eye(N)[c])
        length = np.sqrt(direction @ P_e @ direction)
        tallest = max(tallest, direction[c] / length)
    first_height = tallest * np.sqrt(first)
    decay = np.exp([0, -0.25 * 2])
    wanted = first_height * decay
    np.testing.assert_allclose(bound([0.0, 2.0]), wanted, rtol=1e-9)
    assert bound.sources == ("lure",)


@pytest.mark.parametrize("disturbed", [True, False])
def test_linear_couplings_are_bounded_from_every_start(disturbed: bool):
    """V = e'e + sum eps_i'P eps_i falls at twice the rate; without a region, far away."""
    problem = ring(disturbed=disturbed)
    certificate = dd.certify(problem)
    id = "theorem1" if disturbed else "lemma1"
    check = certificate.check(id)
    start = {"x": [[50.0], [-70.0], [1.0]]}
    length = 49**2 + 71**2
    if disturbed:
        start["xi"] = [[3.0], [4.0], [0.0]]
        entry = check.exact["P"][0]
        size = Fraction(entry[0])
        length += 3 * 4**2 * float(size)
    run = dd.simulate(problem, start=start, t_final=3)
    bound = only(certificate, id).envelope(run)
    assert bound(0.0) == pytest.approx(np.sqrt(length), rel=1e-9)
    assert (run.error() <= bound(run.times)).all()
    fallen = np.log(bound(0.0) / bound(1.0))
    assert fallen == pytest.approx(check.rate, rel=1e-9)


def test_no_run_crosses_the_bound_and_a_tenth_of_it_is_crossed(curved):
    problem, certificate = curved
    many = dd.simulate(problem, runs=40, t_final=4)
    bound = certificate.envelope(many)
    assert (many.error <= bound(many.times)).all()
    assert not (many.error <= 0.1 * bound(many.times)).all()


def test_the_least_of_all_proved_bounds_counts(curved):
    problem, certificate = curved
    run = dd.simulate(problem, start=QUIET, t_final=3)
    every = certificate.envelope(run)
    assert {"max-separable", "lure"} <= set(every.sources)
    parts = []
    for id in every.sources:
        parts.append(only(certificate, id).envelope(run)(run.times))
    np.testing.assert_array_equal(every(run.times), np.minimum.reduce(parts))


#: Runs without a bound, and why.
OUTSIDE = "starts outside what is certified"
UNBOUNDED: list[tuple[dict, str]] = [
    ({"stress": dd.Stress(noise=0.1)}, "under stress"),
    ({"observer": "off"}, "here it is off"),
    ({"signal": dd.signals.Mobile(radius=9)}, "follows from positions"),
    ({"start": {"x": 9 * FAR}}, OUTSIDE),
    ({"start": {"x": NEAR, "xi": 9 * FAR}}, OUTSIDE),
]


@pytest.mark.parametrize(("given", "reason"), UNBOUNDED)
def test_where_nothing_is_proved_about_a_run_no_bound_is_shown_and_the_reason_is(
    curved, given, reason: str
):
    problem, certificate = curved
    for runs in (None, 2):
        done = dd.simulate(problem, runs=runs, t_final=1, **given)
        bound = certificate.envelope(done)
        assert reason in bound.reason
        assert bound.sources == ()
        with pytest.raises(SpecError, match="no certified bound"):
            bound([0.0])
    for ax in done.plot(certificate=certificate).figure.axes:
        assert DRAWN not in [line.get_label() for line in ax.get_lines()]


def test_a_certificate_without_regions_bounds_nothing_and_says_what_to_ask_for():
    problem = ring(coupling="exp(y) - 1 + y")
    bound = dd.certify(problem).envelope(dd.simulate(problem, t_final=1))
    assert "ask for a [region]" in bound.reason


def test_a_claim_that_cannot_be_read_is_no_bound(curved):
    problem, certificate = curved
    check = certificate.check("max-separable")
    exact = {**check.exact, "v": ["1", "2"]}
    broken = replace(check, claim=Values(exact))
    claims = replace(certificate.claims, checks=(broken,))
    with pytest.raises(CertificateError, match="cannot be read"):
        replace(certificate, claims=claims).envelope(dd.simulate(problem, t_final=1))


def test_the_bound_is_drawn_as_far_as_the_integration_can_be_held_against_it():
    """A loop that decays like exp(-3 t): after 20 s the bound is 1e-26 of its start, and the run
    integration error."""
    problem = ring(disturbed=False)
    run = dd.simulate(problem, t_final=20)
    certificate = dd.certify(problem)
    errors = run.plot(certificate=certificate).figure.axes[-1]
    line = next(each for each in errors.get_lines() if each.get_label() == DRAWN)
    bound = certificate.envelope(run)(line.get_xdata())
    gaps = np.isnan(line.get_ydata())
    small = bound < 1e-9 * bound[0]
    assert np.array_equal(gaps, small)
    assert bound[-1] < 1e-20
    assert run.final_error > bound[-1]  # which says nothing against the bound


def test_a_settling_time_bounds_by_its_envelope():
    name = "observed, linear"
    problem = separable.problems()[name]
    claims = read_claims(separable.certificate(name, SEEN))
    certificate = Certificate(problem=problem, claims=claims)
    x = [[1], [-1]]
    xi = [[0.5], [-0.5]]
    start = {"x": x, "xi": xi}
    run = dd.simulate(problem, start=start, t_final=6)
    bound = certificate.envelope(run)
    assert set(bound.sources) == {"theorem1", "theorem1-weighted", "settling"}
    bound = only(certificate, "settling").envelope(run)
    envelope = certificate.settling.envelope(run.times)
    np.testing.assert_array_equal(bound(run.times), envelope)
    assert (run.error() <= bound(run.times)).all()
    assert not (run.error() <= 0.1 * bound(run.times)).all()


def relay(**changes) -> Problem:
    """Agents 2 and 3 hear the one before, each in one mode."""
    modes = {"A": [[3, 2]], "B": [[2, 1]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    turns = {"guarantee": "dwell", "dwell": 1, "longest": "11/10"}
    switching = dd.Switching(**turns | changes.pop("turns", {}))
    return Problem(network=network, coupling="2*y", gains={1: 2}, switching=switching, **changes)


def by_hand(name: str, check: dict[str, object]) -> Certificate:
    """A claim of checker_files/schedules.py and its problem: what starts within 1 of the target is
    certified."""
    claims, problem = schedules.certificate(name, check)
    return Certificate(problem=problem_from_canonical(problem), claims=read_claims(claims))


BY_HAND = {"pair": CUBIC, "chain, observed": OBSERVED, "chain": CHAINED}


@pytest.mark.parametrize("name", BY_HAND)
def test_weights_under_a_guarantee_bound_every_run_that_keeps_it(name: str):
    certificate = by_hand(name, BY_HAND[name])
    problem = certificate.problem
    rate = certificate.check("schedule").rate
    own = [{"stress": "worst"}] if name == "pair" else []
    for seed, changes in enumerate([*own, {}, {}, {}]):
        rng = np.random.default_rng(seed)
        x = rng.uniform(-1, 1, (problem.n, 1))
        start = {"x": x}
        run = dd.simulate(problem, seed=seed, start=start, t_final=12, **changes)
        bound = certificate.envelope(run)
        assert bound.sources == ("schedule",)
        assert (run.error() <= bound(run.times)).all()
        decayed = bound(0.0) * np.exp(-12 * rate)
        assert bound(12.0) == pytest.approx(decayed, rel=1e-4)


def test_the_bound_by_weights_is_their_largest_over_their_least():
    """Between two times a quarter of a second apart the bound is that of the earlier weights at the
    later time."""
    first = np.array(A_STARTS, float)
    change = np.array(A_ENDS, float) - first
    times = ["0", "1/4", "1/2", "3/4", "1"]
    parts = list[list[str]]()
    for k in range(5):
        v = first + k / 4 * change
        parts.append([f"{x:.6f}" for x in v])
    certificate = by_hand("chain", retimed(CHAINED, times, *parts))
    assert dd.verify(certificate.claims, certificate.problem).holds
    tallest = 0.0
    for _, each in certificate.weights:
        heights = np.array(each.v, float).max(axis=1)
        decay = certificate.rate * np.array(each.times, float)
        decayed = heights * np.exp(decay)
        tallest = max(tallest, decayed.max())
    far_start = {"x": [[2], [0], [0]]}
    run = dd.simulate(certificate.problem, start=far_start, t_final=1)
    vertices = certificate.weights[0][1].v
    numbers = map(float, vertices[0])
    least = min(numbers)
    found = float(certificate.envelope(run)(0.0)) / (2 * tallest / least)
    assert 1 <= found < 1.1


SEQUENCE = {"guarantee": "sequence", "longest": None}


ORDER = ["A", "B"]
TWICE = ["A", "B", "A", "B"]
Periodic, RandomDwell = dd.signals.Periodic, dd.signals.RandomDwell
#: Guarantees, and signals that keep them or do not.
SIGNALS: list[tuple[dict, object, bool]] = []


def signal(kept: bool, own: object, **turns) -> None:
    """One more signal, under the guarantee of ``relay`` with these changes."""
    SIGNALS.append((turns, own, kept))


signal(True, Periodic(dwell=1.05))
signal(True, Periodic(dwell=[1, 1.1]))
signal(False, Periodic(dwell=[1, 1, 1], order=["A", "B", "A"]))
signal(False, Periodic(dwell=[0.9, 1]))
signal(False, Periodic(dwell=1.2))
signal(False, RandomDwell(dwell=1))
signal(True, RandomDwell(dwell=1.05, longest=1.1))
signal(False, RandomDwell(dwell=0.9, longest=1.1))
signal(False, RandomDwell(dwell=1, longest=1.2))
signal(False, dd.signals.Fixed())
signal(False, dd.signals.Markov(generator=[[-1, 1], [1, -1]]))
signal(True, Periodic(dwell=1, order=ORDER), **SEQUENCE)
signal(True, Periodic(dwell=[1, 1, 1, 1], order=TWICE), **SEQUENCE)
signal(True, Periodic(dwell=1, order=TWICE), **SEQUENCE, sequence=TWICE)
signal(False, Periodic(dwell=[1, 1, 1, 1.1], order=TWICE), **SEQUENCE)
signal(False, Periodic(dwell=1, order=["A", "B", "A"]), **SEQUENCE)
signal(False, Periodic(dwell=1, order=["B", "A"]), **SEQUENCE)
signal(False, Periodic(dwell=2, order=ORDER), **SEQUENCE)
signal(False, RandomDwell(dwell=1), **SEQUENCE)


@pytest.mark.parametrize(("turns", "signal", "kept"), SIGNALS, ids=str)
def test_a_run_under_another_signal_has_no_bound_by_the_guarantee(turns, signal, kept):
    problem = relay(turns=turns)
    run = dd.simulate(problem, signal=signal, t_final=1)
    assert keeps_guarantee(loop_of(problem), json.loads(run.signal)) is kept
    assert ("The signal need not keep the guarantee of [switching]." in run.notes) is not kept


def test_weights_bound_no_run_in_one_mode():
    certificate = by_hand("pair", CUBIC)
    start = {"x": [[1], [0]]}
    run = dd.simulate(certificate.problem, signal=dd.signals.Fixed(), start=start, t_final=1)
    assert certificate.envelope(run).reason == "the proof is not about the signal of the run"


def test_a_settling_time_of_a_sequence_bounds_no_other_signal():
    certificate = by_hand("chain", GOES_ON)
    start = {"x": [[1], [-1], [0]]}
    run = partial(dd.simulate, certificate.problem, start=start, t_final=2)
    assert "settling" in certificate.envelope(run()).sources
    stuck = run(signal=dd.signals.Fixed(mode="A"))
    assert not certificate.envelope(stuck).sources


def test_a_proof_by_the_graphs_bounds_no_run():
    certificate = by_hand("two", GRAPHS)
    assert certificate.weights == ()
    run = dd.simulate(certificate.problem, t_final=1)
    assert certificate.envelope(run).reason == "the proof states no rate"


@pytest.mark.parametrize("times", [[-1.0], [np.nan], [0.0, np.inf]])
def test_times_without_a_meaning_are_refused(curved, times):
    problem, certificate = curved
    with pytest.raises(SpecError, match="finite and >= 0"):
        certificate.envelope(dd.simulate(problem, t_final=1))(times)


def test_the_report_draws_the_bound_and_says_whose_it_is(curved):
    """Where the start is not covered, the slope of the rate stands there, as a slope."""
    problem, certificate = curved
    box = only(certificate, "max-separable")
    picture = error_picture(box, dd.simulate(problem, t_final=2))
    assert picture.caption.endswith(
        "Dashed: certified upper bound for this start (max-separable). It may begin above the "
        "run: it holds for all runs from starts as large."
    )
    assert "certified bound" in svg_of(picture)
    outside = dd.simulate(problem, start={"x": 3 * FAR}, t_final=2)
    picture = error_picture(box, outside)
    assert picture.caption.endswith("the slope of the certified rate, for comparison.")
    assert "certified bound" not in svg_of(picture)


@pytest.mark.parametrize(
    "changes",
    [{"gains": {1: 0.1}}, {"coupling": "y"}, {"observer": dd.Observer(W=[[5]])}, {"target": 3}],
)
def test_a_run_of_another_problem_of_the_same_name_has_no_bound(curved, changes):
    """Problems made in Python are often called the same; only the problem and W that were simulated
    count."""
    problem, certificate = curved
    given = dict(problem.__reduce__()[0].keywords)
    other = Problem(**given | changes)
    assert other.name == problem.name
    for runs in (None, 3):
        with pytest.raises(SpecError, match="another problem of that name, or with another gain W"):
            certificate.envelope(dd.simulate(other, runs=runs, t_final=0.5))
    assert certificate.envelope(dd.simulate(problem, t_final=0.5)).sources


def test_a_run_that_does_not_say_of_which_problem_it_is_has_no_bound(curved):
    problem, certificate = curved
    run = dd.simulate(problem, t_final=0.5)
    foreign = replace(run, loop_sha256="")
    bound = certificate.envelope(foreign)
    assert not bound.sources
    assert "does not record of which problem" in bound.reason


def test_the_certified_period_is_that_of_a_proved_check(curved):
    problem, certificate = curved
    claims = certificate.claims
    loop = loop_of(problem)
    sampling = certificate.check("sampling")
    period = sampling.claim.period
    assert certified_period(loop, claims) == period > 0
    place = claims.checks.index(sampling)
    for verdict in (Verdict.UNDECIDED, Verdict.REFUTED):
        checks = list(claims.checks)
        checks[place] = replace(sampling, verdict=verdict)
        assert certified_period(loop, replace(claims, checks=tuple(checks))) is None
