"""Final bounds of agents whose outputs are measured, beside what their whole loop of states and
estimates can be driven to (theory, sections 18 and 19)."""

import json
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from broken_certificates import mutate
from checker_files.files import accepted_by
from measured import CARTS
from oracles.disturbed_outputs import driven, random_plant

import dobc_design as dd
from dobc_design import Problem, Verdict
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.accuracy.decide import Accuracy
from dobc_design.problem.bands import Band
from dobc_design.problem.uncertainty import Uncertainty

HUM = Band("1.8", "2.2", "1/2")
#: 50 Hz, far above what the carts do.
FAST = Band("313", "315", 2)
ACTS = {
    "disturbance": {"disturbance": "1/10"},
    "drift": {"drift": "1/10"},
    "noise": {"measurement": "1/100"},
    "sines": {"bands": [HUM]},
    "fast sines": {"bands": [FAST]},
    "all": {"disturbance": "1/10", "drift": "1/10", "measurement": "1/100", "bands": [HUM, FAST]},
}


@cache
def certified(kind: str, acts: str) -> Certificate:
    """Three carts with W for the rate 1."""
    given: dict[str, Any] = dict(ACTS[acts])
    if kind == "outputs":
        given.pop("measurement", None)
    certificate = dd.certify(CARTS[kind].replace(uncertainty=Uncertainty(**given)))
    assert dd.verify(certificate, certificate.problem).holds
    return certificate


def bounds_of(certificate: Certificate) -> dict[str, Any]:
    check = certificate.check("accuracy")
    assert check.verdict is Verdict.PROVED, check.reason
    assert isinstance(check.claim, Accuracy)
    return {label: np.array(x, dtype=float) for label, x in check.claim.listed.items()}


@pytest.mark.parametrize(
    ("kind", "acts", "most"),
    [
        pytest.param("estimates", "disturbance", 4.0, marks=pytest.mark.slow),
        pytest.param("estimates", "drift", 4.0, marks=pytest.mark.slow),
        pytest.param("estimates", "noise", 20.0, marks=pytest.mark.slow),
        pytest.param("estimates", "sines", 30.0, marks=pytest.mark.slow),
        ("estimates", "fast sines", 1.2),
        pytest.param("outputs", "disturbance", 3.0, marks=pytest.mark.slow),
        ("outputs", "sines", 4.0),
        pytest.param("groups", "all", 6.0, marks=pytest.mark.slow),
    ],
)
def test_bounds_are_never_below_what_is_reached_and_not_far_above(kind, acts, most):
    certificate = certified(kind, acts)
    reached = driven(certificate.problem, "G")
    for label, bounds in bounds_of(certificate).items():
        assert np.all(bounds >= reached[label] * (1 - 1e-9)), label
        assert np.all(bounds <= most * reached[label]), (label, bounds / reached[label])


def test_of_fast_sines_a_loop_passes_on_what_one_over_the_frequency_says():
    """e' = -e + what is left of a sine: of frequency w at most 1/w, where a disturbance of the
    same size leaves 1."""
    exosystem = dd.Exosystem(A=[[0]], C=[[1]])
    problem = Problem(
        network=dd.Network.from_arcs({"G": []}, arrow="listens_to", agents=1),
        coupling="y",
        gains={1: 1},
        exosystem=exosystem,
        observer=dd.Observer(W=[[1]]),
        uncertainty=Uncertainty(bands=[Band(100, 101, 1)]),
    )
    (bounds,) = bounds_of(dd.certify(problem)).values()
    w = 100.0
    reached = abs((1j * w) / (1j * w + 1)) / abs(1j * w + 1)
    assert reached <= bounds[0] <= 1.03 * reached


@pytest.mark.slow
def test_curved_couplings_have_bounds_near_the_target():
    """Runs that are driven at the worst from the target stay within them, and come near."""
    table = Uncertainty(disturbance="1/100", bands=[Band("1.9", "2.1", "1/100")])
    problem = CARTS["curved"].replace(
        coupling="tanh(y1)/2",
        gains={agent: [[4, 4]] for agent in (1, 2, 3)},
        uncertainty=table,
        region={"initial_states": [["0.9", "1.1"], ["-0.1", "0.1"]], "initial_disturbance": "0.1"},
    )
    certificate = dd.certify(problem)
    assert dd.verify(certificate, problem).holds
    bounds = np.array(list(bounds_of(certificate).values()))
    n, m = bounds.shape
    rest = {"x": np.tile([1.0, 0.0], (n, 1)), "xi": np.zeros((n, m + 2))}
    run = dd.simulate(certificate.problem, t_final=30, stress="worst", start=rest)
    share = np.abs(run.x - run.goal).max(axis=0) / bounds
    assert np.all(share <= 1)
    assert np.max(share) > 0.9


@pytest.mark.slow
def test_what_one_program_refuses_of_states_and_estimates_the_other_refuses():
    certificate = certified("groups", "all")
    document = json.loads(certificate_bytes(certificate.claims))
    check = next(each for each in document["checks"] if each["id"] == "accuracy")
    assert {"off", "bands"} <= set(check["exact"]["peaks"])
    refused = 0
    for seed in range(10):
        mutated = mutate({"it": check}, seed, other={"it": document["checks"][0]})
        changed = mutated.get("it")
        if isinstance(changed, dict) and changed != check:
            checks = [changed if each is check else each for each in document["checks"]]
            package, lone = accepted_by(document | {"checks": checks}, certificate.problem)
            assert package is lone, (seed, changed)
            refused += not package
    assert refused > 4


@pytest.mark.slow
def test_numbers_a_thousandth_smaller_are_refused_by_both():
    """Peaks are claimed a millionth above what is shown, bounds as well."""
    certificate = certified("groups", "all")
    original = certificate_bytes(certificate.claims)
    assert accepted_by(json.loads(original), certificate.problem) == (True, True)
    for key in ("off", "disturbance", "bands", "bounds"):
        document = json.loads(original)
        exact = next(each for each in document["checks"] if each["id"] == "accuracy")["exact"]
        holder = exact if key == "bounds" else exact["peaks"]
        holder[key] = _scaled(holder[key], Fraction(999, 1000))
        assert accepted_by(document, certificate.problem) == (False, False), key


def _scaled(value: Any, factor: Fraction) -> Any:
    if isinstance(value, dict):
        return {key: _scaled(each, factor) for key, each in value.items()}
    if isinstance(value, list):
        return [_scaled(each, factor) for each in value]
    return str(Fraction(value) * factor)


@pytest.mark.slow
def test_random_agents_are_never_driven_beyond_their_bounds():
    proved = 0
    for seed in range(30):
        problem = random_plant(seed)
        if problem is None:
            continue
        certificate = dd.certify(problem)
        assert dd.verify(certificate, problem).holds
        check = certificate.check("accuracy")
        if check.verdict is not Verdict.PROVED:
            continue
        proved += 1
        bounds = bounds_of(certificate)
        for mode in problem.network.modes:
            for label, reached in driven(certificate.problem, mode).items():
                assert np.all(bounds[label] >= reached * (1 - 1e-6)), (seed, mode, label)
    assert proved >= 2
