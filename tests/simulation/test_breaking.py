"""What breaks first, and the longest sampling period, against borders known in closed form."""

import numpy as np
import pytest
from simulated_runs import single

import dobc_design as dd
from dobc_design import Exosystem, Network, Observer, Problem, load_problem
from dobc_design.errors import SpecError
from dobc_design.simulation import breaking
from dobc_design.simulation.breaking import OPTIONS, PeriodLimit, what_breaks_first


def ring(**settings) -> Problem:
    """Five agents in a directed ring, linear, all pinned with k = 3."""
    arcs = [[i + 1, (i + 1) % 5 + 1] for i in range(5)]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=5)
    all_settings = {"gains": 3, "target": 1} | settings
    return Problem(network=network, coupling="y", **all_settings)


@pytest.fixture
def no_short_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sampling periods from the fastest time constant on: shorter ones cost much and break
    nothing."""
    monkeypatch.setattr(breaking, "DOUBLED", breaking.DOUBLED[4:])


@pytest.mark.usefixtures("no_short_periods")
def test_the_longest_period_is_that_of_the_spectral_radius():
    """I + T (J - K) has the eigenvalues 1 + T (w - 4), w fifth roots of 1: all inside the circle up
    to T*."""
    angles = 2j * np.pi * np.arange(5)
    roots = np.exp(angles / 5) - 4
    sizes = np.abs(roots) ** 2
    limits = -2 * roots.real / sizes
    border = float(limits.min())
    found = what_breaks_first(ring(), options=["period"], t_final=30).period
    assert found.converges < found.fails
    assert found.certified is None
    assert border * 0.97 < found.converges < border
    assert found.fails == pytest.approx(found.converges, rel=2e-3)


@pytest.mark.usefixtures("no_short_periods")
def test_one_agent_with_its_observer_breaks_where_its_matrices_do():
    """e+ = (1 - 2 T) e + ..., and for A = 0, C = 1, W = w: Ad - L Cd = exp(-w T), so T* = 1 for
    every w > 0."""
    exosystem = Exosystem(A=[[0]], C=[[1]])
    observer = Observer(W=[[2]])
    problem = single(exosystem=exosystem, observer=observer)
    found = what_breaks_first(problem, options=["period"], t_final=60).period
    assert 0.96 < found.converges < 1
    assert "certified up to 0.5 s" in str(PeriodLimit(converges=0.9, fails=None, certified=0.5))


def test_an_unmodelled_sine_breaks_one_agent_where_the_closed_form_says():
    """x' = -2 x + a sin(t + p) from 1: the late error is at most a/sqrt(5) and grows with a; it
    breaks beyond 0.1."""
    from simulated_runs import simulate

    from dobc_design.simulation.stress import Stress

    found = what_breaks_first(single(), options=["disturbance"], start=[[1]], t_final=20)
    sweep = found.sweeps[0]
    gain = sweep.late / sweep.severity
    inner = gain[1:-1]
    np.testing.assert_allclose(inner, gain[1], rtol=1e-2)
    assert gain[2] <= 1 / np.hypot(2, 1) * 1.001
    assert sweep.survives * gain[1] <= 0.1 < sweep.breaks * gain[1]
    run = simulate(single(), start=[[1]], t_final=20, stress=Stress(disturbance=sweep.breaks))
    answer = np.abs(run.x[run.times >= 18]).max()
    assert answer > 0.1


def test_saturation_breaks_where_the_input_can_no_longer_reach_the_target_in_time():
    """From 1 with |u| <= b the agent needs about 1/b s: with 10 s and 18/20 of them gone, b near
    0.9/9."""
    found = what_breaks_first(single(), options=["saturation"], start=[[1]], t_final=10)
    sweep = found.sweeps[0]
    assert sweep.breaks < 0.1 <= sweep.survives
    assert (np.diff(sweep.relative) > 0).all()


def test_failing_agents_break_a_ring_that_nobody_else_holds():
    """One pin: those who heard it through a vanished agent are lost; agents that are all held
    stay."""
    problem = ring(gains={"1": 3})
    found = what_breaks_first(problem, options=["failures"], t_final=15, seed=1)
    assert found.sweeps[0].breaks is not None
    held = what_breaks_first(ring(), options=["failures"], t_final=15, seed=1)
    assert held.sweeps[0].breaks is None
    assert held.order == ()


@pytest.mark.slow
def test_everything_breaks_the_papers_example_somewhere_and_the_order_is_said():
    found = what_breaks_first(load_problem("paper-fixed"), t_final=8)
    assert {each.option for each in found.sweeps} == set(OPTIONS)
    assert set(found.order) <= set(OPTIONS)
    assert found.period.converges < 2 / 9 < 1
    for each in found.sweeps:
        assert each.breaks is None or each.late[-1] > found.tolerance
        assert (each.late[:-1] <= found.tolerance).all()
    assert "what breaks first" in str(found)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"options": ["heat"]}, "options must be among"),
        ({"options": []}, "got none"),
        ({"tolerance": 0}, "tolerance must be"),
        ({"t_final": 0.1}, "must converge without stress"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message: str):
    with pytest.raises(SpecError, match=message):
        what_breaks_first(ring(), **arguments)


@pytest.mark.slow
def test_a_certified_period_stands_beside_and_below_the_observed_one():
    """Linear ring, all k = 3: 1/(1 + 3) s at most, less what is kept in hand; the loop works up to
    0.4 s."""
    region = {"initial_states": [0, 2]}
    problem = ring(region=region)
    certificate = dd.certify(problem, everything=True)
    found = dd.what_breaks_first(problem, options=["period"], t_final=60, certificate=certificate)
    assert 0.2 < found.period.certified <= 0.25
    assert found.period.certified < found.period.converges


def test_severities_have_the_unit_of_the_states():
    options = ["noise", "disturbance"]
    units = []
    for problem in (ring(), ring(units="m")):
        found = what_breaks_first(problem, options=options, start=[[2]] * 5, t_final=1)
        units.append([sweep.unit for sweep in found.sweeps])
    assert units == [["unit of x", "unit of x per s"], ["m", "m per s"]]
