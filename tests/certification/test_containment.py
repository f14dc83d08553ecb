"""Several leaders: agents that end between fixed nodes (theory, section 14, "Several leaders").

Oracles: -L_FF^-1 L_FL by NumPy, and runs of the plant in NumPy itself.
"""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from published import leaders_in_turn

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.checker.examine import examine
from dobc_design.conditions.check import Check
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import verify_separable
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical, problem_sha256
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.verdict import Verdict

PATH = [[1, "a"], [1, 2], [2, 1], [2, 3], [3, 2], [3, "b"]]


def contained(
    arcs=PATH, coupling="y", a=0, b=4, *, goal="containment", agents=None, **more
) -> dd.Problem:
    """Agents that listen to each other and to the fixed nodes a and b."""
    network = dd.Network.from_arcs(
        arcs,
        arrow="listens_to",
        agents=agents,
        fixed=("a", "b"),
        optional=more.pop("optional", None),
    )
    return dd.Problem(network=network, coupling=coupling, goal=goal, fixed={"a": a, "b": b}, **more)


def proof(certificate: dd.Certificate) -> Check:
    """Its max-separable check."""
    return next(check for check in certificate.checks if check.id == "max-separable")


def test_a_path_between_two_leaders_is_proved_from_every_start_by_both_programs():
    """Linear couplings: the rows hold for every s, whatever the leaders do; 2 - sqrt(2) = 0.5858 is
    the smallest eigenvalue of L_FF, and no v has more."""
    certificate = dd.certify(contained(b={"between": [3, 5]}))
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "max-separable"
    assert 0.99 * (2 - 2**0.5) < certificate.rate <= 2 - 2**0.5
    assert dd.verify(certificate, contained(b={"between": [3, 5]})).holds


def test_a_rising_coupling_is_proved_on_a_region_between_moving_leaders():
    problem = contained(
        coupling="exp(y) - 1 + y",
        a={"between": [-1, 0]},
        b={"between": [1, "3/2"]},
        region={"initial_states": [-2, 2]},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_sine_between_leaders_at_plus_and_minus_three_is_no_proof():
    """At x = 3 the leader at -3 pushes outwards: sin(-6) > 0.  The same rows hold with both leaders
    at 0, and between leaders so close that the sine rises on all that is heard."""
    arcs = [[1, "a"], [1, "b"]]
    far = contained(arcs, "sin(y)", -3, 3)
    claim = Separable(v=(Fraction(1),), alpha=Fraction(1), rho=Fraction(1, 10))
    answer = verify_separable(loop_of(far), claim)
    assert answer.verdict is Verdict.UNDECIDED
    assert "is not shown to rise on |y| <= 6.1" in answer.reason
    assert verify_separable(loop_of(contained(arcs, "sin(y)", 0, 0)), claim).wrong is None
    near = contained(arcs, "sin(y)", "-7/10", "7/10")
    assert verify_separable(loop_of(near), claim).wrong is None
    assert dd.certify(far).verdict is Verdict.UNDECIDED
    assert np.sin(-6) > 0  # what pushes outwards


def test_a_forged_proof_for_the_sine_is_refused_by_the_second_program():
    arcs = [[1, "a"], [1, "b"]]
    near = contained(arcs, "sin(y)", "-7/10", "7/10", region={"initial_states": ["-4/5", "4/5"]})
    true = dd.certify(near)
    assert true.verdict is Verdict.PROVED
    far = contained(arcs, "sin(y)", -3, 3, region={"initial_states": ["-31/10", "31/10"]})
    forged = certificate_bytes(replace(true.claims, problem_sha256=problem_sha256(far)))
    assert not dd.verify(forged, far).holds
    refused = [text for holds, text in examine(forged, canonical_bytes(far)) if not holds]
    assert any("falls as far as rows look" in text for text in refused)


def test_agents_that_no_fixed_node_reaches_are_refuted_unless_they_start_inside():
    """4 and 5 hear each other only: at x = 6 they stay.  From a region inside the leaders they do
    not leave it, and nothing is refuted."""
    arcs = [*PATH, [4, 5], [5, 4]]
    problem = contained(arcs, region={"initial_states": [-1, 6]})
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert (
        "no path of arcs leads from a fixed node to agents 4 and 5. Let agent 4 or 5 listen"
        in certificate.claims.why.told
    )
    assert dd.verify(certificate, problem).holds
    inside = contained(arcs, region={"initial_states": [0, 4]})
    assert dd.certify(inside).verdict is Verdict.UNDECIDED


def test_a_fixed_node_that_is_heard_at_times_leaves_linear_couplings_linear():
    """Its slope is none, so that Lemma 1 says nothing; both programs give it the same domain."""
    problem = contained(optional=[[2, "b"]])
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_leaders_at_one_place_are_a_target():
    problem = contained(a=2, b=2)
    loop = loop_of(problem)
    assert (loop.gap, loop.goal, loop.goals.target) == (0, "target", (2,))
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_one_fixed_node_at_rest_is_the_target():
    """The same rate as a pin of gain 1 there."""
    network = dd.Network.from_arcs([[1, "post"], [2, 1]], arrow="listens_to", fixed=["post"])
    problem = dd.Problem(network=network, coupling="y", fixed={"post": 3})
    pinned = dd.Problem(
        network=dd.Network.from_arcs([[2, 1]], arrow="listens_to", agents=2),
        coupling="y",
        target=3,
        gains={1: 1},
    )
    certificate = dd.certify(problem)
    assert problem.target == (3,)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate == dd.certify(pinned).rate
    assert dd.verify(certificate, problem).holds


@pytest.mark.parametrize(
    "problem",
    [
        contained(b={"between": [3, 5]}, region={"initial_states": [-1, 6]}),
        contained(exceptions={(2, 4): "tanh(y)"}),
        contained([[1, "a"], [1, "b"]], ["y1", "2*y2"], [0, 1], {"between": [[0, 1], [2, 3]]}),
    ],
)
def test_problem_json_and_the_problem_file_give_the_problem_back(problem):
    data = canonical_bytes(problem)
    assert json.loads(data)["version"] == 4
    assert problem_from_canonical(data) == problem
    text = problem_text(problem).encode()
    assert canonical_bytes(read_problem_text(text, folder=None)) == data
    assert canonical_bytes(problem.replace(name=problem.name)) == data


FILE = """
goal = "containment"
[fixed]
left = 0
right = {{ between = [4, 5] }}
[network]
agents = 2
arrow = "listens_to"
[network.modes]
G = [[1, "left"], [2, "right"], [1, 2], [2, 1]]
{more}
[coupling]
h = "y"
"""


def read(text: str) -> dd.Problem:
    return read_problem_text(text.encode(), folder=None)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('[1, "left"]', '["left", 1]', "left is a fixed node, of .fixed.: it listens to nobody"),
        ("left = 0", "left = 0\n1 = 0", "'1' is an agent as well"),
        ("left = 0", "left = [0, 1]\nup = [0, 1, 2]", "fixed.up must have 2 numbers"),
        (
            "left = 0",
            "left = {{ from = 1 }}",
            "fixed.left must be a value, or have the key between",
        ),
        ("[4, 5]", "[5, 4]", "fixed.right.between must be a pair .lo, hi. with lo <= hi"),
        ('"containment"', '"agreement"', 'fixed has no meaning with goal = "agreement"'),
        ('"containment"', '"target"', "fixed has several nodes, or one that moves"),
        ("{more}", "[pinning]\ngains = {{ 1 = 1 }}", "pinning is not known with goal"),
        ("{more}", "[actuators]\nlimit = 1", "actuators is not known with goal"),
        ("{more}", "[dynamics]\nA = [[0]]", "dynamics is not known together with"),
        ("[fixed]", "target = 1\n[fixed]", "target is not known with goal"),
    ],
)
def test_what_does_not_go_with_fixed_nodes_is_refused(old, new, words):
    with pytest.raises(SpecError, match=words):
        read(FILE.replace(old, new).format(more=""))


def test_containment_without_fixed_nodes_is_refused():
    network = dd.Network.from_arcs([[1, 2]], arrow="listens_to")
    with pytest.raises(SpecError, match=r"without \[fixed\], between whose nodes agents end"):
        dd.Problem(network=network, coupling="y", goal="containment")


def test_a_fixed_node_without_a_value_is_refused():
    network = dd.Network.from_arcs([[1, "a"]], arrow="listens_to", fixed=["a"])
    with pytest.raises(SpecError, match=r"fixed\.a has no value"):
        dd.Problem(network=network, coupling="y")
    with pytest.raises(SpecError, match="the network has no fixed node 'b'"):
        dd.Problem(network=network, coupling="y", fixed={"a": 1, "b": 2})


MODES = {"A": [[1, "a"], [2, 1], [2, 3], [3, 2]], "B": [[1, 2], [2, 1], [2, 3], [3, "b"]]}


IN_TURN = dd.Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)


def named(certificate: dd.Certificate, id: str) -> Check:
    return next(check for check in certificate.checks if check.id == id)


def test_graphs_in_turn_bring_agents_between_leaders_at_the_rate_of_one_target():
    """Mode A: 3 hears 2, mode B: 2 hears 1, which hears both leaders in both: rate 1/2, as with a
    pin of gain 1 (theory, section 11)."""
    problem = leaders_in_turn()
    certificate = dd.certify(problem)
    assert certificate.covered_by == "schedule"
    assert 0.48 < certificate.rate <= 0.5
    assert "one target, and the fixed nodes differ" in named(certificate, "lemma1").reason
    assert dd.verify(certificate, problem).holds


@pytest.mark.slow
def test_agents_settle_between_leaders_that_move_and_no_run_is_later():
    """Euler's method, leaders that jump between their ends: distances stay below 1/10 from the
    certified time on."""
    modes = {"A": [[1, "a"], [2, 1]], "B": [[1, 2], [2, "b"]]}
    region = {"initial_states": [-1, 5]}
    problem = contained(modes, "tanh(y)", b={"between": [3, 4]}, region=region, switching=IN_TURN)
    certificate = dd.certify(problem, settling="1/10")
    settling = named(certificate, "settling")
    assert settling.is_proved
    assert dd.verify(certificate, problem).holds
    time = float(settling.claim.time)
    step = 4e-3
    rng = np.random.default_rng(1)
    x = np.array([[-1.0, 5], [5, -1]])
    last = np.zeros(2)
    for k in range(int((time + 4) / step)):
        right = 4 if rng.random() < 0.5 else 3
        mode = modes["AB"[int(k * step) % 2]]
        change = np.zeros_like(x)
        for i, j in mode:
            heard = {"a": 0, "b": right}.get(j)
            change[i - 1] += np.tanh((x[j - 1] if heard is None else heard) - x[i - 1])
        x = x + step * change
        away = np.maximum(np.maximum(x - 4, -x), 0).max(axis=0)
        last = np.where(away > 0.1, k * step, last)
    assert 0 < last.max() <= time


@pytest.mark.slow
def test_forged_tubes_for_the_sine_are_refused_by_both_programs():
    """Distances are the same between leaders at 0 and 1/2, and at -3 and 3, where the sine
    falls."""
    modes = {"A": [[1, "a"]], "B": [[1, 2], [2, "b"]]}
    region = {"initial_states": ["-1/4", "3/4"]}
    near = contained(modes, "sin(y)", 0, "1/2", region=region, switching=IN_TURN)
    true = dd.certify(near, settling="1/10")
    assert named(true, "schedule").is_proved
    assert named(true, "settling").is_proved
    far = near.replace(fixed={"a": -3, "b": 3}, region={"initial_states": ["-13/4", "13/4"]})
    forged = certificate_bytes(replace(true.claims, problem_sha256=problem_sha256(far)))
    failures = dd.verify(forged, far).failures
    refused = [text for holds, text in examine(forged, canonical_bytes(far)) if not holds]
    for id in ("schedule", "settling"):
        assert any(id in text and "not shown to rise on |y| <= " in text for text in failures)
        assert f"{id} : proved: a coupling may fall" in refused


@pytest.mark.parametrize("id", ["lure", "schedule", "sampling", "tolerance", "accuracy", "markov"])
def test_a_forged_check_that_knows_one_target_only_is_refused_by_both_programs(id):
    problem = contained(region={"initial_states": [-1, 5]})
    true = dd.certify(problem)
    check = replace(proof(true), id=id)
    forged = certificate_bytes(replace(true.claims, checks=(*true.claims.checks, check)))
    assert not dd.verify(forged, problem).holds
    assert not all(holds for holds, _ in examine(forged, canonical_bytes(problem)))


def test_an_optional_arc_between_agents_does_no_harm():
    problem = contained(
        [[1, "a"], [1, "b"], [2, "b"]],
        "tanh(y)",
        optional=[[1, 2], [2, 1]],
        region={"initial_states": [-1, 5]},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_fixed_node_and_pins_of_single_modes_have_nodes_of_their_own():
    network = dd.Network.from_arcs(
        {"A": [[1, "post"], [2, 1]], "B": [[2, 1]]}, arrow="listens_to", fixed=["post"]
    )
    problem = dd.Problem(
        network=network,
        coupling="tanh(y)",
        fixed={"post": 1},
        mode_gains={"B": {1: 2}},
        region={"initial_states": [0, 2]},
    )
    assert loop_of(problem).fixed == ("post", "target")
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_moving_disturbance_is_compensated_between_leaders():
    """A constant on each agent: the observer's part of the proof is the same."""
    problem = contained(
        exosystem=dd.Exosystem(A=[[0]], C=[[1]]),
        coupling="tanh(y)",
        region={"initial_states": [-1, 5], "initial_disturbance": "1/10"},
    )
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert dd.verify(certificate, problem).holds


def test_a_gain_that_fails_refutes_nothing_between_leaders():
    """The estimation error stays, and a state well inside the leaders may stay there with it."""
    problem = contained(exosystem=dd.Exosystem(A=[[0]], C=[[1]]), observer=dd.Observer(W=[[0]]))
    certificate = dd.certify(problem)
    assert certificate.verdict is Verdict.UNDECIDED
    assert dd.verify(certificate, problem).holds


def test_three_thousand_agents_between_two_leaders_are_proved():
    n = 3_000
    arcs = [[i + 1, i, 1] for i in range(1, n)] + [[i, i % 100 + 1, 1] for i in range(101, n + 1)]
    arcs += [[i, "a" if i % 2 else "b", 1] for i in range(1, n + 1)]
    certificate = dd.certify(
        contained(arcs, "tanh(y)", agents=n, region={"initial_states": [-1, 5]})
    )
    assert certificate.verdict is Verdict.PROVED


def test_certified_starts_are_distances_and_no_states():
    """From [-3, 8] between 0 and 5 the distance is at most 3, which is no state."""
    problem = contained(coupling="tanh(y)", b=5, region={"initial_states": [-3, 8]})
    regions = dd.certify(problem).regions
    assert regions.asked.box == 3
    assert regions.asked.interval is None
    assert all(agent.goal is None and agent.bound >= 3 for agent in regions.agents)
