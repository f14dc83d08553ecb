"""The search against regions and certified sets: what it has to find, and what it must never
find."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from networks import cycle
from regional_problems import cycle as lure_cycle
from regional_problems import field, half_difference, is_proved, listening_pair
from scipy.integrate import solve_ivp

import dobc_design as dd
from dobc_design import Problem, Verdict
from dobc_design.conditions.quadratic.propose import design_lure, raise_rate
from dobc_design.conditions.separable.claim import Separable, separable_from_json
from dobc_design.conditions.separable.propose import (
    propose_separable,
    rounded_vectors,
)
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import scale
from dobc_design.falsification import search
from dobc_design.falsification.suspect import LEAVES, RESTS, STAYS_AWAY, Falsification
from dobc_design.loop.make import loop_of
from dobc_design.problem.changes import changed_problem, gain_changes

F = Fraction
SADDLE = float(half_difference(3.3))
NODE = float(half_difference(6.0))


def end_of(problem: Problem, suspect, duration: float) -> np.ndarray:
    """Where SciPy ends from the start of a suspect, without disturbance, in its only mode."""
    goals = [[float(x) for x in problem.goal_of(i)] for i in range(problem.n)]
    goal = np.array(goals)
    start = (suspect.start - goal).ravel()
    (mode,) = {name for _, name in suspect.modes}
    return flown(problem, mode, start, duration, method="LSODA", rtol=1e-9, atol=1e-11)


def flown(problem: Problem, mode: str, start: np.ndarray, duration: float, **given) -> np.ndarray:
    """Where SciPy ends."""
    solution = solve_ivp(lambda t, e: field(problem, mode, e), (0, duration), start, **given)
    return solution.y[:, -1]


def certificate_of(problem: Problem, rho: F, *, digits: int = 2) -> Separable:
    """The max-separable certificate of a radius, proved."""
    loop = loop_of(problem)
    proposed = propose_separable(loop, rho=float(rho))
    v = list(rounded_vectors(proposed))[digits]
    alpha = largest_rate(loop, v, rho=rho)
    return Separable(v=v, alpha=alpha, rho=rho)


@pytest.fixture
def few_looks_for_equilibria(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method from four corners, four random starts and four ends at most, for tests that
    are not about it."""
    monkeypatch.setattr(search, "NEWTON_STARTS", 4)


@cache
def found_of_the_pair() -> Falsification:
    """sin, k = 1/10, starts in [-5, 5]; runs that stall last 60 s."""
    return dd.falsify(listening_pair(), runs=30, t_final=15)


def test_the_false_equilibria_of_two_agents_are_found_proved_and_shown():
    """e = (-y/2, y/2), y = 3.3077 and 5.98, and what falls into others beyond."""
    problem = listening_pair()
    found = found_of_the_pair()
    sizes = []
    for claim in found.proved:
        sizes.append(float(max(map(abs, claim.middle))))
    assert sizes == pytest.approx([SADDLE, SADDLE, NODE, NODE], abs=1e-5)
    assert found.check.verdict is Verdict.REFUTED
    kinds = [suspect.kind for suspect in found.suspects]
    assert kinds[:4] == [RESTS] * 4
    assert STAYS_AWAY in kinds
    assert found.suspects[0].final_error == pytest.approx(SADDLE, abs=1e-5)
    assert "1.654" in str(found)
    assert f" {len(found.suspects)} suspect(s), 4 proved" in repr(found)
    for suspect in found.suspects:
        if suspect.kind == STAYS_AWAY:
            end = np.max(np.abs(end_of(problem, suspect, 60.0)))
            assert end == pytest.approx(suspect.final_error, rel=1e-4)
            assert end > 1


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_below_the_saddle_nothing_is_found():
    """Twins: the region of 1.653 is clean, that of 1.66 is refuted."""
    clean = dd.falsify(listening_pair(reach=1.653), runs=30, t_final=20)
    assert clean.suspects == ()
    assert clean.proved == ()
    assert clean.check is None
    assert clean.tried == 30
    found = dd.falsify(listening_pair(reach=1.66), runs=30, t_final=5)
    assert found.check is not None


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_without_a_region_equilibria_are_proved_and_refute_nothing():
    found = dd.falsify(listening_pair(reach=None), runs=14, radius=2.0, t_final=10)
    assert len(found.proved) == 2
    assert found.check is None
    assert found.target == "|e|_inf <= 2"
    unbounded = dd.falsify(listening_pair(reach=None), runs=14, t_final=10)
    assert unbounded.proved == ()


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_agents_that_repel_each_other_are_found_and_named():
    arcs = [["left", "right"], ["right", "left"]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    problem = Problem(network=network, coupling="-y - tanh(y)", gains="1/10")
    found = dd.falsify(problem, runs=10)
    assert all(suspect.kind == STAYS_AWAY for suspect in found.suspects)
    assert found.suspects[0].final_error == np.inf
    assert set(found.suspects[0].labels) <= {"left", "right"}


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_a_certified_set_of_different_exosystems_is_not_contradicted_and_a_false_one_is():
    """Twin: a hundredth of the certificate's P, so that the observer's error seems to cost next to
    nothing."""
    harmonics = dd.exosystems.harmonics(2)
    sine = dd.Group(agents=[1, 3], exosystem=harmonics)
    constant_shape = dd.exosystems.constant()
    constant = dd.Group(agents=[2], exosystem=constant_shape)
    arcs = [[2, 1], [3, 2], [1, 3]]
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=3)
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
    problem = dd.Problem(
        network=network, coupling="tanh(y)", gains=1, groups=[sine, constant], region=region
    )
    certificate = dd.certify(problem)
    found = dd.falsify(problem, runs=9, certified=certificate, t_final=8)
    assert found.suspects == ()
    assert found.observed_rate >= found.certified_rate * (1 - 1e-6)
    claim = separable_from_json(certificate.check("max-separable").exact, loop_of(problem))
    P = scale(F(1, 100), claim.error.P)
    error = replace(claim.error, P=P)
    false = replace(claim, error=error)
    given = changed_problem(problem, gain_changes(problem, certificate.claims.W))
    twin = dd.falsify(given, runs=9, certified=false, t_final=5)
    assert LEAVES in {suspect.kind for suspect in twin.suspects}


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_a_rate_that_is_too_high_is_contradicted():
    """Twin: the same set with 1 in place of 0.49; the slowest decay that is seen is about 0.76."""
    certificate = certificate_of(cycle(3), F(2))
    claim = replace(certificate, alpha=F(1))
    found = dd.falsify(cycle(3), runs=14, certified=claim, t_final=8)
    assert {suspect.kind for suspect in found.suspects} == {LEAVES}
    assert found.observed_rate < 1


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_a_set_that_is_too_large_is_contradicted():
    """Two agents, sin: v = (1, 1) is proved up to 1.65387; at 1.7 starts leave."""
    problem = listening_pair(reach=None)
    v = (F(1), F(1))
    rho = F("1.653")
    alpha = largest_rate(loop_of(problem), v, rho=rho)
    inside = Separable(v=v, alpha=alpha, rho=rho)
    again = dd.falsify(problem, runs=14, certified=inside, t_final=20)
    assert again.suspects == ()
    larger = replace(inside, rho=F("1.7"))
    beyond = dd.falsify(problem, runs=14, certified=larger, t_final=5)
    assert {LEAVES, RESTS} <= {suspect.kind for suspect in beyond.suspects}
    assert len(beyond.proved) == 2


@pytest.mark.usefixtures("few_looks_for_equilibria")
@pytest.mark.parametrize("shape", ["diagonal", pytest.param("full", marks=pytest.mark.slow)])
def test_a_quadratic_certificate_is_never_contradicted_and_a_false_one_is(shape: str):
    """Two agents that hear each other, one pin; the twin asks for five times its rate."""
    problem = lure_cycle(2, {1: 3})
    lure = design_lure(loop_of(problem), holds=lambda each: is_proved(problem, each), shape=shape)
    lure = raise_rate(loop_of(problem), lure, holds=lambda each: is_proved(problem, each))
    found = dd.falsify(problem, runs=9, certified=lure, t_final=8)
    assert found.suspects == ()
    assert found.observed_rate >= float(lure.rate) > 0
    faster = replace(lure, rate=5 * lure.rate + 1)
    result = dd.falsify(problem, runs=9, certified=faster, t_final=1)
    assert result.suspects[0].kind == LEAVES


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_the_set_of_a_certificate_is_searched_with_its_own_gain():
    """certify, then falsify: what was proved for the region asked for."""
    problem = listening_pair("tanh(y)", gains=1, reach=2)
    certificate = dd.certify(problem)
    check = next(each for each in certificate.checks if each.id == "max-separable")
    found = dd.falsify(problem, runs=9, certified=certificate)
    assert found.suspects == ()
    assert found.certified_rate >= certificate.rate > 0
    checked = dd.falsify(problem, runs=9, certified=check)
    assert str(checked) == str(found)


def test_a_certificate_without_a_region_and_a_check_that_is_not_proved_are_refused():
    problem = listening_pair("tanh(y)", gains=1, reach=None)
    certificate = dd.certify(problem)
    with pytest.raises(SpecError, match="has none"):
        dd.falsify(problem, certified=certificate)
    with pytest.raises(SpecError, match="proved check of a region"):
        dd.falsify(problem, certified=certificate.checks[0])
    region = {"initial_states": [-1, 1]}
    other = dd.certify(cycle(3, h="tanh(y)", region=region))
    with pytest.raises(SpecError, match="must have 2 weights v"):
        dd.falsify(problem, certified=other)


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_the_same_seed_gives_the_same_search_and_another_one_other_starts():
    problem = listening_pair()
    first = dd.falsify(problem, runs=4, seed=5, t_final=2)
    again = dd.falsify(problem, runs=4, seed=5, t_final=2)
    other = dd.falsify(problem, runs=4, seed=6, t_final=2)
    assert str(first) == str(again)
    starts = [each.start.tolist() for each in first.suspects]
    assert starts == [each.start.tolist() for each in again.suspects]
    assert starts != [each.start.tolist() for each in other.suspects]


@pytest.mark.usefixtures("few_looks_for_equilibria")
def test_stages_are_told_and_names_and_results_show_themselves():
    stages: list[str] = []
    found = dd.falsify("paper-fixed", runs=5, t_final=1.0, progress=stages.append)
    assert len(stages) == 3
    assert found.tried == 5
    assert "<p><b>paper-fixed" in found._repr_html_()
    one = found_of_the_pair().suspects[0]
    assert "equilibrium (proved)" in repr(one)
    with pytest.raises(ValueError, match="read-only"):
        one.start[0] = 0.0


def test_networks_beyond_sixty_rows_are_simulated_only():
    region = {"initial_states": [-1, 1]}
    problem = cycle(80, h="sin(y)", region=region)
    found = dd.falsify(problem, runs=10, t_final=2.0)
    assert found.tried == 10
    assert found.proved == ()


OF_ONE_AGENT = Separable(v=(F(1),), alpha=F(1), rho=F(1))
WRONG = {"runs": {"runs": 0}, "radius": {"radius": -1.0}, "t_final": {"t_final": 0}}
WRONG["seed"] = {"seed": -1}
WRONG["certified says where"] = {"radius": 1.0, "certified": OF_ONE_AGENT}
WRONG["weights v for this problem"] = {"certified": OF_ONE_AGENT}


@pytest.mark.parametrize(("complaint", "given"), WRONG.items())
def test_wrong_arguments_are_refused(given: dict, complaint: str):
    with pytest.raises(SpecError, match=complaint):
        dd.falsify(listening_pair(), **given)


def test_an_observer_that_is_too_fast_to_be_followed_is_told_and_starts_at_its_disturbance():
    """|A - WC| times the horizon is far beyond what the closed form covers."""
    region = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
    exosystem = dd.exosystems.constant()
    observer = dd.Observer(W=[[1]])
    problem = Problem(
        network=listening_pair().network,
        coupling="y",
        gains=1,
        region=region,
        exosystem=exosystem,
        observer=observer,
    )
    assert dd.falsify(problem, runs=4).notes == ()
    fast = problem.replace(observer=dd.Observer(W=[["1e12"]]))
    told = "The observer is too fast for its closed form: every run starts with xihat = xi."
    assert dd.falsify(fast, runs=4).notes == (told,)


@pytest.mark.parametrize("name", ["radius", "disturbance", "certified", "t_final"])
def test_a_certificate_says_where_to_start(name: str):
    """Whatever else would say it is refused, by its name."""
    certificate = dd.certify(listening_pair(reach=0.5))
    given = certificate if name == "certified" else 1.0
    with pytest.raises(SpecError, match="must be left out with a certificate") as refused:
        dd.falsify(certificate, **{name: given})
    assert refused.value.key == name
