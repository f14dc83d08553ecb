"""The value that agents agree on: its interval is never left, its formula is met by runs."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified import certified, only
from scipy.integrate import solve_ivp

from dobc_design import (
    Certificate,
    Exosystem,
    Network,
    Observer,
    Problem,
    Verdict,
    certify,
    verify,
)
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.conditions.accuracy.value import Agreed, interval_of
from dobc_design.conditions.schedule.stage import schedule_stage
from dobc_design.loop.make import loop_of

PAPER = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
GAIN = Observer(W=[["16/5"], ["12/5"]])
REGION = {"initial_states": [-1, 1], "initial_disturbance": "1/2"}
ARCS = [[1, 2, 2], [2, 1], [3, 2], [1, 3], [4, 3]]


def agents(coupling: str = "y", **settings) -> Problem:
    """Agents 1, 2 and 3 hear each other, agent 4 only listens; the paper's disturbance."""
    network = Network.from_arcs(ARCS, arrow="listens_to", agents=4)
    known = {"exosystem": PAPER, "observer": GAIN, "region": REGION, "goal": "agreement"}
    return Problem(network=network, coupling=coupling, **known | settings)


def end_of_run(coupling, x0: np.ndarray, eps0: np.ndarray) -> np.ndarray:
    """The states after a long time, by SciPy: x_i' = sum w h(x_j - x_i) + C eps_i."""
    F = np.array([[-3.2, 2], [-4.4, 0]])
    hears = np.zeros((4, 4))
    for i, j, *w in ARCS:
        hears[i - 1, j - 1] = (w or [1])[0]

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        x, eps = z[:4], z[4:].reshape(4, 2)
        moved = (hears * coupling(x[None, :] - x[:, None])).sum(axis=1) + eps[:, 0]
        return np.concatenate([moved, (eps @ F.T).ravel()])

    start = np.concatenate([x0, eps0.ravel()])
    return solve_ivp(rates, (0, 40), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:4, -1]


def worst_errors(random: np.random.Generator) -> np.ndarray:
    """Estimation errors of the length 1/2, the same for all agents."""
    angle = random.uniform(0, 2 * np.pi)
    return np.tile([np.cos(angle) / 2, np.sin(angle) / 2], (4, 1))


def test_the_shift_of_the_papers_observer_is_known_and_so_is_the_value():
    """C (-F)^-1 = (0, 5/22): the paper's xi(0), with xihat(0) = 0, moves the value by 0.061398."""
    value = certified(agents()).value
    assert value is not None
    assert value.shifts == (((Fraction(0), Fraction(5, 22)),),)
    xi0 = [[0.420735492, 0.270151153]] * 4
    assert value.reached(np.zeros((4, 1)), xi0) == pytest.approx(0.061398, abs=1e-6)


def test_the_weights_are_the_left_null_vector_and_who_only_listens_has_none():
    """pi' L = 0 by hand: pi_1 (2 + 1) = pi_2, pi_2 = 2 pi_1 + pi_3, pi_3 = pi_1."""
    value = certified(agents()).value
    assert value is not None
    assert value.weights is not None
    assert list(value.weights.values()) == [Fraction(x, 5) for x in (1, 3, 1, 0)]


def test_runs_of_a_linear_coupling_end_where_the_formula_says():
    random = np.random.default_rng(1)
    value = certified(agents()).value
    assert value is not None
    for _ in range(3):
        x0, eps0 = random.uniform(-1, 1, 4), worst_errors(random)
        ends = end_of_run(lambda y: y, x0, eps0)
        assert ends == pytest.approx(value.reached(x0[:, None], eps0)[0], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "h"),
    [("tanh(y)", np.tanh), pytest.param("y + y**3", lambda y: y + y**3, marks=pytest.mark.slow)],
)
def test_no_run_ends_outside_of_the_interval(text: str, h):
    """Starts at the corners, and estimation errors that push all agents the same way."""
    random = np.random.default_rng(2)
    with only(schedule_stage):
        value = certify(agents(text)).value
    assert value is not None
    assert value.lo is not None
    assert value.hi is not None
    assert value.weights is None
    reached = []
    for _ in range(6):
        x0 = np.full(4, random.choice([-1.0, 1.0]))
        ends = end_of_run(h, x0, worst_errors(random))
        assert np.ptp(ends) < 1e-6
        reached.append(ends[0])
    assert value.lo[0] <= min(reached)
    assert max(reached) <= value.hi[0]
    assert max(reached) > 1.09  # the estimation error does move it out of the starts


def test_without_disturbance_the_value_lies_between_the_starts_and_offsets_are_taken_off():
    plain = {"exosystem": None, "observer": None, "region": {"initial_states": [0, 5]}}
    value = certified(agents(**plain)).value
    assert value is not None
    assert (value.lo, value.hi) == ((0.0,), (5.0,))
    value = certified(agents(offsets={1: 2, 2: -1}, **plain)).value
    assert value is not None
    assert (value.lo, value.hi) == ((-2.0,), (6.0,))


def test_a_coupling_that_repels_far_out_has_no_interval():
    """Starts differ by up to 2; y - y^3/8 changes its sign at 2.83, y - y^3/3 at 1.73."""
    plain = {"exosystem": None, "observer": None, "region": {"initial_states": [-1, 1]}}
    assert interval_of(loop_of(agents("y - y**3/8", **plain)), None) == ((-1, 1),)
    assert interval_of(loop_of(agents("y - y**3/3", **plain)), None) is None


def claims_with(certificate: Certificate, **changes) -> bytes:
    value = certificate.value
    assert isinstance(value, Agreed)
    return certificate_bytes(replace(certificate.claims, value=replace(value, **changes)))


@pytest.mark.parametrize(
    "forged",
    [
        {"lo": (-1.0,)},
        {"hi": (1.0, 1.0)},
        {"hi": None},
        {"peaks": None},
        {"weights": {label: Fraction(1, 4) for label in "1234"}},
        {"weights": dict(zip("1234", map(Fraction, ("2/5", "6/5", "2/5", "0")), strict=True))},
        {"weights": None},
        {"shifts": (((Fraction(0), Fraction(5, 21)),),)},
        {"shifts": ()},
    ],
)
def test_a_forged_value_is_refused_by_both_programs(forged: dict):
    problem = agents()
    certificate = certified(problem)
    again = verify(claims_with(certificate, **forged), problem)
    assert not again.holds
    assert again.lone_checker.startswith("it refuses the certificate; the value agreed upon")
    assert not any("disagree" in failure for failure in again.failures)


@pytest.mark.slow
def test_a_value_is_written_read_back_and_claimed_only_where_agreement_is_proved():
    problem = agents("tanh(y)")
    certificate = certified(problem)
    data = certificate_bytes(certificate.claims)
    assert read_claims(data).value == certificate.value
    assert verify(data, problem).holds
    document = json.loads(data)
    document["verdict"] = "undecided"
    assert not verify(json.dumps(document).encode(), problem).holds
    assert "value" not in json.loads(certificate_bytes(certified("clock-sync").claims))
    apart = Network.from_arcs([[1, 2]], arrow="listens_to", agents=3)
    alone = certified(Problem(network=apart, coupling="y", goal="agreement"))
    assert alone.verdict is Verdict.REFUTED
    assert alone.value is None
