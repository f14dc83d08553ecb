"""Final bounds: known answers, the exact L-infinity gain of linear loops, twins that just fail,
both programs."""

import json
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from checker_files import groups
from networks import listening
from scipy import integrate, linalg
from stated_tables import exact_gain, final_errors, linear_problem, responses, second_order

from dobc_design import Exosystem, Observer, Problem, Verdict, load_problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify as certified
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.conditions.accuracy import decide, stage
from dobc_design.conditions.accuracy.decide import Accuracy, confirm
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Values
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.exact.matrix import matrix, multiply
from dobc_design.exact.peaks import peak_gains
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.load import read_problem_text

certify = cache(certified)
PROVED, UNDECIDED = Verdict.PROVED, Verdict.UNDECIDED
PAPER = load_problem("paper-fixed")
OMEGA = {"disturbance": "1/10"}
LINEAR = PAPER.replace(coupling="2*y", uncertainty=OMEGA)
CURVED = PAPER.replace(uncertainty=OMEGA)
SOFT = PAPER.replace(region=None, uncertainty=OMEGA | {"drift": "1/100", "measurement": "1/1000"})
#: M^-1 1 of the linearised paper-fixed (theory, section 12).
INVERSE = [1, 3, 2.5, 2, 1.5] * 2


@pytest.fixture(autouse=True)
def coarse_steps(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Responses of the observer are followed in fewer steps, which costs less than 1e-4 of a bound;
    not in slow tests, and not where a bound is known."""
    as_it_is = request.node.get_closest_marker("slow") or "the_known_bounds" in request.node.name
    if not as_it_is:
        monkeypatch.setattr(stage, "FINENESS", (0.03,))
        monkeypatch.setattr(stage, "FINE", 0.25)
        monkeypatch.setattr(stage, "LEFT", 2e-3)


def row(problem: Problem) -> Check:
    return certify(problem).check("accuracy")


def claim_of(problem: Problem) -> Accuracy:
    """What is proved."""
    check = row(problem)
    assert check.verdict is PROVED, check.reason
    assert isinstance(check.claim, Accuracy)
    return check.claim


def bounds(problem: Problem) -> np.ndarray:
    """By agent."""
    return in_order(problem, claim_of(problem).bounds)


def in_order(problem: Problem, found: Any) -> np.ndarray:
    """The bounds of every agent, as the network names them."""
    listed = [found[label] for label in problem.network.labels]
    return np.array(listed, dtype=float)


def followed(k: object, **more: Any) -> Problem:
    """Agent 1 is pinned with k, and agent 2 hears it; both linear."""
    arc = (1, 0, "1")
    modes = {"a": [arc]}
    return linear_problem(2, modes, {"1": k}, **more)


def read(text: str) -> Problem:
    return read_problem_text(text.encode(), folder=None)


def unchanged(exact: Any) -> None:
    """The certificate as it is."""


def both(problem: Problem, change: Any) -> tuple[bool, bool]:
    """Whether the package and the second program accept the certificate once ``change`` is done to
    its exact values."""
    certificate = certify(problem)
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "accuracy"]
    change(check["exact"])
    changed = json.dumps(data).encode()
    lone = examine(changed, canonical_bytes(problem))
    return recheck(changed, problem).holds, all(holds for holds, _ in lone)


def test_the_peak_gains_of_the_paper():
    C = matrix([[1, 0]])
    steady = matrix([[0, 1], [-1, 0]])
    assert peak_gains(steady, C, [], step=Fraction(1, 100), steps=2000) is None
    # Theory, section 12: 1.33276; the bounds come down to it from above with shorter steps.
    F = matrix([["-16/5", 2], ["-22/5", 0]])
    W = matrix([["16/5"], ["12/5"]])
    coarse = peak_gains(F, C, [W], step=Fraction(1, 50), steps=600)
    fine = peak_gains(F, C, [W], step=Fraction(1, 500), steps=6000)
    assert coarse is not None
    assert fine is not None
    assert float(fine[0][0]) == pytest.approx(1.33276, abs=1e-5)
    assert coarse[0][0] >= fine[0][0]
    # F W of the measurement gain, by hand.
    assert multiply(F, W) == matrix([["-136/25"], ["-352/25"]])


@pytest.mark.parametrize("rate", [1, 3])
def test_peak_gain_of_a_first_order_lag_is_its_static_gain(rate: int):
    lag = matrix([[-rate]])
    seen = matrix([[2]])
    gain = matrix([[5]])
    found = peak_gains(lag, seen, [gain], step=Fraction(1, 300), steps=4000)
    assert found is not None
    assert 10 / rate <= found[0][0] <= 10.001 / rate


def test_linear_paper_network_ends_within_the_known_bounds():
    """omega = 0.1: b = 0.1 (1 + 1.33276), bounds b M^-1 1."""
    exact = 0.1 * (1 + 1.33276) * np.array(INVERSE)
    found = bounds(LINEAR)
    assert np.all(found >= exact)
    assert np.all(found <= exact * 1.0001)
    reason = row(LINEAR).reason
    assert "|e_i| <= 0.2333 (agents 1, 6)" in reason
    assert "0.6999 (agents 2, 7)" in reason


def test_bounds_of_two_agents_have_closed_forms():
    """One agent pinned with 1, the other hears it with weight 1 or 2: the bound is that of weight
    1."""
    modes = {"a": [(1, 0, "1")], "b": [(1, 0, "2")]}
    problem = linear_problem(2, modes, {"1": "1"}).replace(uncertainty=OMEGA)
    assert bounds(problem) == pytest.approx([0.1, 0.2], rel=1e-4)
    # No observer: b_1 = nubar k, b_2 = 2 nubar w.
    problem = followed("4").replace(uncertainty={"measurement": "1/100"})
    assert bounds(problem) == pytest.approx([0.01, 0.03], rel=1e-4)
    # and no drift
    problem = problem.replace(uncertainty={"drift": "1/100"})
    assert "accuracy" not in {check.id for check in certify(problem).checks}


@pytest.mark.slow
@pytest.mark.parametrize("problem", [CURVED, SOFT], ids=["region", "no region"])
def test_curved_couplings_are_confirmed_by_both_programs(problem: Problem):
    assert both(problem, unchanged) == (True, True)
    found = bounds(problem)
    assert min(found) > 0.2333
    assert max(final_errors(problem, seed=1) / found) <= 1


@pytest.mark.slow
def test_without_a_region_the_box_of_starts_is_chosen():
    domain = row(SOFT).domain
    assert not isinstance(domain, str)
    assert domain.radius > 0 < domain.disturbance


@pytest.mark.parametrize("name", ["three", "region"])
def test_agents_with_different_exosystems_count_with_the_worst_peak_gain(name: str):
    named = groups.problems()[name]
    uncertainty = OMEGA | {"measurement": "1/1000"}
    problem = named.replace(uncertainty=uncertainty)
    assert both(problem, unchanged) == (True, True)
    smaller_peak = scaled(["peaks", "disturbance"], "0.9999")
    assert both(problem, smaller_peak) == (False, False)


SLOW = [pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3)]


@pytest.mark.parametrize("seed", [13, *SLOW])
def test_bounds_of_agents_with_dynamics_are_never_below_the_exact_gain(seed: int):
    problem, loop = second_order(seed)
    gains = np.abs(responses(loop)[0])
    exact = np.sum(gains @ loop.limits, axis=0)
    ends = in_order(problem, claim_of(problem).bounds)
    ratio = ends.T.ravel() / exact
    assert min(ratio) >= 1
    assert max(ratio) <= (10 if problem.q else 4)
    assert both(problem, unchanged) == (True, True)
    smaller_bound = scaled(["bounds", "1", 0], "0.9999")
    assert both(problem, smaller_bound) == (False, False)


def test_agents_with_dynamics_and_couplings_by_component_have_bounds():
    """e_1' = -3 e_1 - e_1 + w, e_2' = -3 e_2 + sin(e_1 - e_2) + w: w = 1/50 leaves 1/200, and near
    (w + 1/200)/4."""
    A = [[-3, 0], [0, -3]]
    agents = Dynamics(A=A)
    own = {"target": [0, 0], "dynamics": agents, "gains": {"1": 1}}
    problem = Problem(network=followed(1).network, coupling="sin(y)", **own)
    region = {"initial_states": ["-1/5", "1/5"]}
    problem = problem.replace(uncertainty={"disturbance": "1/50"}, region=region)
    for found, exact in zip(bounds(problem), (0.005, 0.00625), strict=True):
        assert np.all(found >= exact * (1 - 1e-4))
        assert np.all(found <= 1.01 * exact)
    assert both(problem, unchanged) == (True, True)


def test_inputs_too_large_for_the_gains_are_undecided():
    """tanh saturates at 1, the pin is gone: a disturbance of 3 drives agent 2 away for good."""
    problem = followed("4").replace(coupling="tanh(y)")
    large = problem.replace(uncertainty={"disturbance": "3"})
    assert row(large).verdict is UNDECIDED
    small = problem.replace(uncertainty={"disturbance": "1/10"})
    assert row(small).verdict is PROVED


LAGS = """
[network]
agents = 2
arrow = "listens_to"
[network.modes.G]
arcs = [[2, 1, "1/10"]]
optional = [[1, 2, 5]]
[dynamics]
A = [["-1/20"]]
B = [[1]]
[coupling]
h = "y"
[pinning]
gains = { 1 = 1, 2 = "1/20" }
[uncertainty]
disturbance = 0.1
"""
FOLLOWERS = """
[network]
agents = 3
arrow = "listens_to"
[network.modes.G]
arcs = [[2, 1], [3, 2]]
optional = [[3, 1], [2, 3]]
[dynamics]
A = [[0, 1], [0, -4]]
B = [[0], [1]]
[coupling]
h = "y1"
[pinning]
gains = { 1 = [[1, 1]] }
[uncertainty]
disturbance = 0.1
drift = 0.05
[exosystem]
constant = true
[observer]
W = [[2]]
[leader]
initial = [[-1, 1], [-1, 1]]
"""
BEHIND_A_LEADER = """
[network]
agents = 3
arrow = "listens_to"
[network.modes.A]
arcs = [[1, 2, "27/20"], [2, 1, "9/10"], [3, 2, "7/5"]]
optional = [[3, 1, "19/10"]]
[dynamics]
A = [[0, 1], ["-9/20", "-1/4"]]
B = [[0], [1]]
[leader]
initial = [[-1, 1], [-1, 1]]
[coupling]
h = ["(8/5)*y1 + (14/5)*y2"]
[pinning]
gains = { 1 = [["28/5", "49/5"]], 3 = [["42/25", "147/50"]] }
[exosystem]
A = [[0, "7/4"], ["-7/4", 0]]
C = [[1, 0]]
[observer]
W = [["13/10"], ["-1/20"]]
[uncertainty]
disturbance = "37/100"
drift = "11/50"
"""


def test_bounds_of_two_lags_with_an_optional_arc_have_closed_forms():
    """The arc that agent 1 may hear is the worst where v_2 > v_1: 21/20 v_1 = 5 (v_2 - v_1) + 1/10
    and v_2/10 = (v_1 - v_2)/10 + 1/10, that is 52/71 and 123/142.  With the arc always absent v_1
    is 2/21."""
    problem = read(LAGS)
    exact = np.array([[52 / 71], [123 / 142]])
    found = bounds(problem)
    assert np.all(found >= exact)
    assert np.all(found <= 1.0001 * exact)
    assert certify(problem).verdict is PROVED
    assert both(problem, unchanged) == (True, True)
    slightly_lower = scaled(["stages", 0, "level"], "0.999")
    assert both(problem, slightly_lower) == (False, False)


@pytest.mark.parametrize("text", [pytest.param(FOLLOWERS, marks=pytest.mark.slow), BEHIND_A_LEADER])
def test_agents_with_optional_arcs_behind_a_leader_have_bounds(text: str):
    problem = read(text)
    assert certify(problem).verdict is PROVED
    assert row(problem).domain == EVERYWHERE
    assert both(problem, unchanged) == (True, True)
    lower = scaled(["stages", 0, "level"], "0.9")
    assert both(problem, lower) == (False, False)


MIXED = """
target = [0, 0]
[network]
agents = 4
arrow = "listens_to"
[network.modes]
A = [[1, 2, 1], [2, 4, 1], [3, 1, 1], [3, 4, 1], [4, 1, "11/20"], [4, 3, "5/4"]]
[coupling]
h = ["(27/20)*y1 + (-7/20)*y2", "(9/20)*y1 + (37/20)*y2"]
[[coupling.exceptions]]
arcs = [[2, 4]]
h = ["(19/10)*y1 + (3/20)*y2", "(-2/5)*y1 + (5/4)*y2"]
[pinning]
gains = { 1 = [["27/10", "-1/20"], ["1/4", "5/4"]] }
[uncertainty]
disturbance = "9/25"
"""


SOMETIMES = MIXED.replace("A = [[1, 2, 1],", "A.optional = [[1, 2, 1]]\nA.arcs = [")


def test_a_stable_linear_loop_is_never_told_that_its_disturbance_is_too_large():
    """No coordinates make its rows dominant, whatever the disturbance is, and with an optional arc
    no response of the whole loop is followed."""
    certificate = certify(read(SOMETIMES))
    accuracy = certificate.check("accuracy")
    assert accuracy.verdict is UNDECIDED
    for reason in (accuracy.reason, certificate.reason):
        assert "The loop is linear, so that it is not their size" in reason
        assert "too large" not in reason
        assert "smaller" not in reason


def scaled(path: list[Any], factor: str) -> Any:
    """A change: one number of the exact values times a factor."""

    def change(exact: Any) -> None:
        for key in path[:-1]:
            exact = exact[key]
        entry = exact[path[-1]]
        scaled_entry = Fraction(entry) * Fraction(factor)
        exact[path[-1]] = str(scaled_entry)

    return change


def test_the_unchanged_linear_claim_is_accepted_by_both():
    assert both(LINEAR, unchanged) == (True, True)


def test_larger_inputs_are_not_covered():
    """The twin of the problem: with 0.1001 in place of 0.1 the same claim fails in both
    programs."""
    claim = row(LINEAR).claim
    check = Check(id="accuracy", verdict=Verdict.PROVED, domain=EVERYWHERE, reason="", claim=claim)
    assert claim is not None
    W = certify(LINEAR).claims.W
    case = Case(loop=loop_of(LINEAR), W=W, domain=EVERYWHERE)
    assert confirm(check, case) is None
    louder = LINEAR.replace(uncertainty={"disturbance": "0.1001"})
    louder_case = replace(case, loop=loop_of(louder))
    assert "row of agent" in str(confirm(check, louder_case))
    as_text = replace(check, claim=Values(claim.to_json()))
    assert confirm(as_text, case) is None


@pytest.mark.parametrize("seed", [0, 2, 25])
def test_the_bound_is_never_below_the_exact_gain(seed: int):
    problem, gain = exact_gain(seed)
    assert np.all(bounds(problem) >= gain)


@pytest.mark.slow
def test_boxes_inside_are_found_where_a_newton_step_overshoots():
    """Curved rows with noise: the step for the weights of the inner boxes passes one entry of the
    solution by 1e-6."""
    arcs = [[1, 3, 1], [2, 1, 2], [3, 2, 2]]
    gains = {1: 5, 2: 2, 3: 3}
    problem = listening(arcs, "y + y**3/10", n=3, gains=gains, target=0)
    inputs = {
        "disturbance": "0.05",
        "drift": "0.02",
        "measurement": "0.01",
        "weights": "0.05",
        "gains": "0.05",
    }
    A = [[0, 1], [-1, 0]]
    exosystem = Exosystem(A=A, C=[[1, 0]])
    observer = Observer(W=[[2], [0]])
    problem = problem.replace(
        exosystem=exosystem,
        observer=observer,
        region={"initial_states": ["-1/2", "1/2"], "initial_disturbance": "1/5"},
        uncertainty=inputs,
    )
    assert max(bounds(problem)) < 0.13


def shown_bounds(problem: Problem, *, steps: int, step: str = "1/200") -> np.ndarray:
    """What the response of a whole loop shows, by agent and component."""
    plant = decide.Plant(loop=loop_of(problem), peaks=None)
    response = decide.Response(step=Fraction(step), steps=steps)
    found = plant.response_bounds(response)
    assert found is not None
    return in_order(problem, found)


@pytest.mark.parametrize("k", [1, 4])
def test_the_response_of_one_agent_is_its_static_gain(k: int):
    """e' = -k e + w ends at omega / k."""
    alone = linear_problem(1, {"a": []}, {"1": k})
    problem = alone.replace(uncertainty=OMEGA)
    ((bound,),) = shown_bounds(problem, steps=4000)
    assert 0.1 / k <= bound <= 0.1 / k * 1.0001


def test_the_response_of_two_states_is_that_of_quadrature():
    """e' = [[-1, 5], [0, -2]] e + w, with kernels exp(-t), 5 (exp(-t) - exp(-2 t)) and exp(-2
    t)."""
    agents = Dynamics(A=[[0, 5], [0, -1]])
    bare = linear_problem(1, {"a": []}, {"1": 1}, target=[0, 0], dynamics=agents)
    entries = [[-1.0, 5.0], [0.0, -2.0]]
    M = np.array(entries)
    whole, _ = integrate.quad_vec(lambda t: np.sum(np.abs(linalg.expm(M * t)), axis=1), 0, 40)
    exact = 0.1 * whole
    assert exact == pytest.approx([0.35, 0.05])
    (found,) = shown_bounds(bare.replace(uncertainty=OMEGA), steps=4000)
    assert np.all(exact <= found)
    assert np.all(found <= exact * 1.001)


def mixed_loop() -> np.ndarray:
    """M of MIXED, written out from its text."""
    usual = np.array([[1.35, -0.35], [0.45, 1.85]])
    other = np.array([[1.9, 0.15], [-0.4, 1.25]])
    arcs = [(1, 2, 1, usual), (2, 4, 1, other), (3, 1, 1, usual), (3, 4, 1, usual)]
    fourth = (4, 1, 0.55, usual)
    fifth = (4, 3, 1.25, usual)
    arcs += [fourth, fifth]
    M = np.zeros((4, 2, 4, 2))
    entries_of_M = [[2.7, -0.05], [0.25, 1.25]]
    M[0, :, 0] = -np.array(entries_of_M)
    for i, j, w, H in arcs:
        M[i - 1, :, j - 1] += w * H
        M[i - 1, :, i - 1] -= w * H
    return M.reshape(8, 8)


@pytest.mark.slow
def test_where_no_coordinates_are_found_the_response_gives_bounds_that_are_reached():
    """Inputs that are bang-bang along the response come within a few percent of every bound, and
    never above it."""
    problem = read(MIXED)
    assert certify(problem).verdict is PROVED
    assert row(problem).domain == EVERYWHERE
    claim = claim_of(problem)
    assert claim.stages == ()
    assert claim.T is None
    ends = in_order(problem, claim.bounds).ravel()
    M = mixed_loop()
    phi = linalg.expm(M * 0.05)
    kick = np.linalg.solve(M, phi - np.eye(8))
    kernels = [kick]
    for _ in range(600):
        kernels.append(phi @ kernels[-1])
    for place, end in enumerate(ends):
        e = np.zeros(8)
        for kernel in reversed(kernels):
            e = phi @ e + kick @ (0.36 * np.sign(kernel[place]))
        assert 0.97 * end < e[place] < end
    smaller_bound = scaled(["bounds", "2", 1], "0.995")
    assert both(problem, smaller_bound) == (False, False)
    smaller_step = scaled(["response", "step"], "0.1")
    assert both(problem, smaller_step) == (False, False)


SECOND_MODE = "B = [[1, 2, 1], [2, 4, 1], [3, 1, 1], [4, 1, 1]]\n[coupling]"
CURVED_ENTRY = '"(27/20)*sin(y1) + (-7/20)*y2"'
OTHERS = {
    "optional arc": SOMETIMES,
    "two modes": MIXED.replace("[coupling]", SECOND_MODE),
    "weights": MIXED + 'weights = "1/100"',
    "noise": MIXED + 'measurement = "1/100"',
    "curved": MIXED.replace('"(27/20)*y1 + (-7/20)*y2"', CURVED_ENTRY),
}


@pytest.mark.parametrize("text", OTHERS.values(), ids=OTHERS)
def test_other_loops_than_linear_ones_in_one_mode_have_no_response(text: str):
    assert decide.response_obstacle(loop_of(read(text))) is not None
    assert decide.response_obstacle(loop_of(read(MIXED))) is None


#: Of agents 2 and 3 one follows the other and is repelled by it in return: they swing, and no rows
#: are dominant.
SIGNED = """
[network]
agents = 3
arrow = "listens_to"
[network.modes]
A = [[2, 1, 1], [2, 3, 1], [3, 2, 3]]
[coupling]
h = "y"
[[coupling.exceptions]]
arcs = [[2, 3]]
h = "-y/2"
[pinning]
gains = { 1 = 1 }
[uncertainty]
disturbance = "1/10"
[actuators]
limit = 100
amplitude = 1
"""


def test_inputs_that_rest_on_bounds_without_stages_stay_undecided():
    certificate = certify(read(SIGNED))
    verdicts = {check.id: check.verdict for check in certificate.checks}
    assert verdicts["accuracy"] is PROVED
    assert verdicts["actuators"] is certificate.verdict is UNDECIDED
