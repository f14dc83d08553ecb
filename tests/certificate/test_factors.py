"""The factor beside a rate: |e(t)| <= factor |e(0)| exp(-rate t); both programs refuse a smaller
one."""

import json
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from certified import certified
from oracles.factors import least_factor, of_phases
from scipy.linalg import expm

from dobc_design import Dynamics, Exosystem, Network, Observer, Problem, Switching
from dobc_design.certificate.text import certificate_bytes, read_claims
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import Box
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.canonical import canonical_bytes

WATCHED: dict[str, Any] = {"exosystem": Exosystem(A=[[0]], C=[[1]]), "observer": Observer(W=[[2]])}
LESS = 1 - 1e-6


def line(modes: Any, *, agents: int = 3, **settings: Any) -> Problem:
    network = Network.from_arcs(modes, arrow="listens_to", agents=agents)
    given = {"coupling": "2*y", "gains": {1: 1}} | settings
    return Problem(network=network, **given)


CHAIN = [[2, 1], [3, 2]]
TURNS = {"A": [[2, 1]], "B": [[3, 2]]}
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]])
RING = [[2, 1], [3, 2], [1, 3]]
PAIR = [[2, 1]]
BOX: dict[str, Any] = {"initial_states": [-1, 1]}
#: Problems, and the checks whose factors are looked at.
CASES: dict[str, tuple[Problem, tuple[str, ...]]] = {}

NOISY = BOX | {"initial_disturbance": 1}
EVERY = ("lemma1", "theorem1-weighted", "max-separable", "delay", "tolerance")
CASES["box"] = (line(CHAIN, **WATCHED, coupling="tanh(y)", region=NOISY), EVERY)
CASES["ball"] = (line(RING, coupling=["2*y"], region=BOX), ("lemma1",))
moving: dict[str, Any] = {"dynamics": DOUBLE, "coupling": "y1 + 2*y2", "gains": {1: [[1, 2]]}}
CASES["coordinates"] = (line(PAIR, agents=2, region=BOX, **moving), ("theorem1-weighted",))
mixed: dict[str, Any] = {"coupling": ["y1 + sin(y2)/9", "y2"], "target": [0, 0]}
SQUARE = {"initial_states": [[-1, 1], [-1, 1]]}
CASES["vectors"] = (line(PAIR, agents=2, region=SQUARE, **mixed), ("max-separable", "lure"))
dwell = Switching(signal="random", guarantee="dwell", dwell=1, longest=2)
CASES["turns"] = (line(TURNS, switching=dwell), ("schedule",))
markov = Switching(signal="markov", guarantee="markov", generator=[[-1, 1], [1, -1]])
CASES["chain"] = (line(TURNS, switching=markov), ("markov",))
mobile = Switching(signal="mobile", radius=1)
CASES["held"] = (line(CHAIN, gains=1, switching=mobile), ("safety",))


@cache
def document(name: str) -> dict[str, Any]:
    problem = CASES[name][0]
    return dict(json.loads(certificate_bytes(certified(problem).claims)))


def place_of(name: str, id: str) -> int:
    """Where this check stands in the certificate of this problem."""
    return [check["id"] for check in document(name)["checks"]].index(id)


def unreadable(name: str, changed: dict[str, Any]) -> bool:
    """Whether both programs cannot read a certificate of this problem."""
    data = json.dumps(changed).encode()
    problem = CASES[name][0]
    with pytest.raises(CertificateError):
        read_claims(data)
    with pytest.raises(checker.Refused):
        checker.examine(data, canonical_bytes(problem))
    return True


def accepted(name: str, changed: dict[str, Any]) -> tuple[bool, bool]:
    """Whether the package and the second program accept a certificate of this problem."""
    data = json.dumps(changed).encode()
    problem = CASES[name][0]
    lone = checker.examine(data, canonical_bytes(problem))
    return recheck(data, problem).holds, all(holds for holds, _ in lone)


def with_factor(name: str, place: int, factor: float) -> dict[str, Any]:
    """The certificate with another factor of one check, and with what follows of the verdict."""
    changed = json.loads(json.dumps(document(name)))
    own = changed["checks"][place]
    if (changed["covered_by"], changed["factor"]) == (own["id"], own["factor"]):
        changed["factor"] = factor
    own["factor"] = factor
    return dict(changed)


PLACES = [(name, id) for name, (_, ids) in CASES.items() if name != "vectors" for id in ids]
PLACES += [pytest.param("vectors", id, marks=pytest.mark.slow) for id in CASES["vectors"][1]]


@pytest.mark.parametrize(("name", "id"), PLACES)
def test_the_factor_is_the_least_that_follows_and_a_smaller_one_is_refused_by_both_programs(
    name: str, id: str
):
    whole = document(name)
    place = place_of(name, id)
    check = whole["checks"][place]
    room = 1 + 1e-6
    if id == "schedule":
        least = of_phases(check["exact"], [0, 1])
        room = 1.02
    else:
        least = least_factor(check, whole["checks"])
    assert check["verdict"] == "proved"
    assert least is not None
    assert check["factor"] >= max(1.0, least * (1 - 1e-9))
    assert check["factor"] <= least * room
    assert accepted(name, whole) == (True, True)
    if check["factor"] > 1:
        smaller = with_factor(name, place, check["factor"] * LESS)
        assert accepted(name, smaller) == (False, False)


@pytest.mark.parametrize("id", ["hurwitz", "observability", "sampling"])
def test_a_check_without_a_bound_has_no_factor_and_may_claim_none(id: str):
    place = place_of("box", id)
    assert document("box")["checks"][place]["factor"] is None
    assert accepted("box", with_factor("box", place, 1e9)) == (False, False)


@pytest.mark.parametrize("factor", [0.999, 0, -1, 1e301, True, "1"])
def test_a_factor_below_one_cannot_be_read(factor: Any):
    assert unreadable("held", with_factor("held", 0, factor))


WRITTEN = [("3", 3.0), ("1.5", 1.5)]
WRITTEN.append(("1.50000000000000000000001", 1.5))
WRITTEN.append(("2.99999999999999999999999", math.nextafter(3, 0)))
WRITTEN.append(("1.00000000000000000000001", 1.0))


@pytest.mark.parametrize(("text", "read"), WRITTEN)
def test_a_factor_is_never_read_as_more_than_is_written(text: str, read: float):
    """A larger one claims less, other than a rate."""
    name = "box"
    changed = with_factor(name, 0, 777.0) | {"covered_by": None}
    data = json.dumps(changed).replace("777.0", text).encode()
    assert read_claims(data).checks[0].factor == read


@pytest.mark.parametrize("name", ["coordinates", "ball"])
def test_no_motion_of_a_linear_loop_leaves_the_bound(name: str):
    """The matrix exponential of the loop, in the norm of the check."""
    problem = CASES[name][0]
    loop = _loop(name)
    order = {"|e|": 2, "|e|_inf": np.inf}
    bounds: list[Check] = [each for each in certified(problem).checks if each.factor is not None]
    assert {each.norm for each in bounds} >= {"|e|"}
    assert loop.shape == (problem.n * problem.m,) * 2
    for time in np.linspace(0, 20, 41):
        motion = expm(loop * time)
        for own in bounds:
            if own.id in ("delay", "tolerance", "sampling"):
                continue
            exponent = -(own.rate or 0.0)
            growth = math.exp(exponent * time)
            most = (own.factor or 0.0) * growth
            size = np.linalg.norm(motion, order[own.norm])
            allowed = most * (1 + 1e-9)
            assert size <= allowed


def _loop(name: str) -> Any:
    """e' = loop e, from the numbers of the cases above."""
    if name == "ball":
        return np.array([[-3.0, 0, 2], [2, -2, 0], [0, 2, -2]])
    coupled = np.array([[0.0, 0], [1, -1]])
    pinned = np.diag([1.0, 0])
    arcs = coupled - pinned
    free = [[0, 1], [0, 0]]
    blocks = np.kron(np.eye(2), free)
    felt = np.kron(arcs, [[0, 0], [1, 2]])
    return blocks + felt


def test_the_bound_is_the_least_of_all_proved_checks():
    """At the beginning a flat proof, later a fast one; and no check alone is below it."""
    problem = line(CHAIN, coupling="2*y")
    certificate = certified(problem)
    times = np.linspace(0, 40, 81)
    bound = certificate.bound(times, radius=3, disturbance=0)
    proofs = [each for each in certificate.checks if each.kind.is_consensus]
    proved = [each for each in proofs if each.rate and each.factor]
    assert len(proved) > 1
    for each in proved:
        start = 3 * (1 if each.norm == "|e|_inf" else math.sqrt(3))
        height = (each.factor or 0) * start
        decay = np.exp(-(each.rate or 0) * times)
        alone = height * decay
        assert np.all(bound <= alone * (1 + 1e-6) + 1e-300)
    assert bound[0] <= 3 * math.sqrt(3) * (1 + 1e-9)


def test_no_start_of_a_linear_loop_exceeds_the_bound():
    arcs = [[2, 1], [3, 2], [1, 3]]
    problem = line(arcs, coupling="2*y")
    certificate = certified(problem)
    times = np.linspace(0, 10, 21)
    bound = certificate.bound(times, radius=1, disturbance=0)
    for time, most in zip(times, bound, strict=True):
        motion = expm(_loop("ball") * time)
        assert np.linalg.norm(motion, np.inf) <= most * (1 + 1e-9)


def test_a_bound_needs_starts_that_are_proved():
    alone = certified(line(CHAIN))
    missing = r"radius must be given, because the problem has no \[region\]"
    with pytest.raises(SpecError, match=missing):
        alone.bound([0.0])
    box = certified(CASES["box"][0])
    assert box.bound([0.0])[0] >= 1
    with pytest.raises(SpecError, match="there is no certified bound"):
        box.bound([0.0], radius=1000)
    with pytest.raises(SpecError, match="disturbance must be >= 0"):
        alone.bound([0.0], radius=1, disturbance=1)


def test_a_bound_is_about_the_plant_that_the_file_states():
    """Links that may be ten times weaker decay more slowly than the proof for the model says."""
    times = np.array([0.0, 5.0, 20.0])
    rows = [[-1, 0, 0], [0.2, -0.2, 0], [0, 0.2, -0.2]]
    slow = np.array(rows)
    real = []
    for time in times:
        real.append(np.linalg.norm(expm(slow * time), np.inf))
    loose = certified(line(CHAIN, uncertainty={"weights": "9/10"}))
    bound = loose.bound(times, radius=1, disturbance=0)
    assert np.all(real <= bound * (1 + 1e-9))
    model = certified(line(CHAIN)).bound(times, radius=1, disturbance=0)
    assert real[1] > 2 * model[1]
    gains = {1: 1, 2: 1, 3: 1}
    hidden = {"weights": "1/10", "known_to_agents": False}
    known = CASES["box"][0]
    changed = known.replace(gains=gains, uncertainty=hidden)
    unknown = certified(changed)
    tolerance = unknown.check("tolerance")
    found = unknown.bound([9.0])[0]
    least = math.exp(-9 * (tolerance.rate or math.inf))
    assert found >= least


def test_no_bound_is_stated_where_errors_remain_or_inputs_exceed_a_limit():
    pushed = certified(line(CHAIN, uncertainty={"disturbance": "1/10"}))
    with pytest.raises(SpecError) as remains:
        pushed.bound([1.0], radius=1, disturbance=0)
    assert "accuracy has the errors that remain" in str(remains.value)
    gains = {1: 1, 2: 1, 3: 1}
    limited = line(CHAIN, gains=gains, actuators={"limit": 1})
    held = certified(limited)
    domain = held.check("actuators").domain
    assert isinstance(domain, Box)
    bounds = held.bound([0.0], radius=domain.radius, disturbance=0)
    assert bounds[0] >= domain.radius
    with pytest.raises(SpecError) as exceeded:
        held.bound([0.0], radius=2 * domain.radius, disturbance=0)
    assert "it is not proved that inputs keep the limit of 1" in str(exceeded.value)
