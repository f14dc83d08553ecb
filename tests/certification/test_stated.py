"""The verdict is about the plant that the file states: limits, errors of weights and gains,
disturbances and noise.

Format page, the overall verdict, tables.  Every table has a proved problem and a twin that just
fails, and both programs refuse a verdict that was edited.
"""

import json
from typing import Any

import pytest
from certified import certified, few_chords
from networks import listening
from stated_tables import broken, kept

from dobc_design import Certificate, Network, Observer, Problem, Switching, Verdict, load_problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.certification.recheck import recheck
from dobc_design.checker.examine import examine
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import constant

#: Six agents, saturating couplings, a disturbance of amplitude 2 and actuators that give 1/2.
LIMIT_BELOW_DISTURBANCE = """
name = "limit-below-disturbance"
target = 20
[network]
agents = 6
arrow = "listens_to"
[network.modes]
normal = [[3, 1], [4, 1], [4, 2], [5, 2], [6, 3], [6, 5]]
[coupling]
h = "2*tanh(y)"
[pinning]
gains = { 1 = 2, 2 = 2 }
[exosystem]
constant = true
hz = 0.5
[observer]
rate = 2
[region]
initial_states = [18, 22]
initial_disturbance = 0.5
[actuators]
limit = 0.5
amplitude = 2
"""
#: Five tanks in a row; the input of the first may reach 1.6 of 1.
TANKS = """
name = "tanks"
target = "3/2"
[network]
agents = ["T1", "T2", "T3", "T4", "T5"]
arrow = "sends_to"
[network.modes]
pipes = [["T1", "T2"], ["T2", "T1"], ["T2", "T3"], ["T3", "T2"], ["T3", "T4"], ["T4", "T3"],
  ["T4", "T5"], ["T5", "T4"]]
[coupling]
h = "y/sqrt(1+y**2)"
[pinning]
gains = { T1 = "1/2" }
[exosystem]
constant = true
hz = 0.01
[observer]
rate = 0.1
[region]
initial_states = [0.5, 2.5]
initial_disturbance = 0.05
[actuators]
limit = 1
amplitude = 0.1
"""
BOX = {"initial_states": [-1, 1]}
SEEN = {"exosystem": constant(), "observer": Observer(W=[[4]])}
SEEN_BOX = BOX | {"initial_disturbance": "1/10"}


def read(text: str, tmp_path: Any) -> Problem:
    (tmp_path / "problem.toml").write_text(text)
    return load_problem(tmp_path / "problem.toml")


def pair(h: str = "y + y**3/9", **more: Any) -> Problem:
    """2 hears 1, which is pinned with k = 3."""
    arcs = [[2, 1]]
    return listening(arcs, h, n=2, gains={1: 3}, target=0, **more)


def both_accept(certificate: Certificate, **changes: Any) -> tuple[bool, bool]:
    """Whether the package and the second program accept the certificate with another verdict."""
    document = json.loads(certificate_bytes(certificate.claims)) | changes
    data = json.dumps(document).encode()
    problem = certificate.problem
    findings = examine(data, canonical_bytes(problem))
    by_the_checker = all(holds for holds, _ in findings)
    return recheck(data, problem).holds, by_the_checker


def require_undecided(certificate: Certificate, *words: str, proof: str = "max-separable") -> None:
    """Undecided in both programs, with these words; neither accepts it edited to proved by
    ``proof``."""
    assert certificate.verdict is Verdict.UNDECIDED
    assert certificate.rate is None
    assert certificate.covered_by is None
    assert certificate.reason.startswith("Undecided: without ")
    assert "What would help: " in certificate.reason
    for word in words:
        assert word in certificate.reason
    assert both_accept(certificate) == (True, True)
    rate = certificate.check(proof).rate
    answers = both_accept(certificate, verdict="proved", covered_by=proof, rate=rate)
    assert answers == (False, False)


def test_a_limit_below_the_disturbance_makes_the_verdict_undecided(tmp_path: Any):
    certificate = certify(read(LIMIT_BELOW_DISTURBANCE, tmp_path))
    require_undecided(
        certificate,
        "without the actuator limit all agents reach the target from every start in the region",
        "with the limit of 0.5 it is not proved",
        "The disturbance alone may need 2",
    )
    assert certificate.reason.endswith("What would help: a larger limit.")


@pytest.mark.slow
def test_tanks_whose_pump_may_saturate_are_undecided(tmp_path: Any):
    certificate = certify(read(TANKS, tmp_path))
    require_undecided(
        certificate,
        "with the limit of 1 it is not proved",
        "agent T1 may reach 1.",
        "more than its limit",
    )


@pytest.mark.parametrize(("limit", "proved"), [("3.0001", True), ("2.9999", False)])
def test_a_limit_counts_where_it_is_the_largest_input(limit: str, proved: bool):
    """k = 3, |e| <= 1, no disturbance: 3 is needed, and a certificate with v = 1 at agent 1 shows
    it."""
    arcs = [[2, 1]]
    actuators = {"limit": {"1": limit}}
    problem = listening(arcs, "y", n=2, gains={1: 3}, target=0, region=BOX, actuators=actuators)
    certificate = certified(problem)
    if proved:
        assert certificate.verdict is Verdict.PROVED
        assert "no input of an agent with a limit exceeds the limit of 3.0001" in certificate.reason
        assert certificate.rate is not None
        assert both_accept(certificate) == (True, True)
    else:
        require_undecided(certificate, f"the limit of {limit}")


@pytest.mark.parametrize(("error", "proved"), [("0.33", True), ("0.34", False)])
def test_errors_of_gains_count(error: str, proved: bool):
    """K = [[1, 1/2], [1/2, 1]] holds its agent while 1 - d > (1 + d)/2, d < 1/3."""
    K = [[1, "1/2"], ["1/2", 1]]
    problem = listening([], "y", n=1, gains={1: K}, target=[0, 0], uncertainty={"gains": error})
    certificate = certified(problem)
    if proved:
        assert certificate.verdict is Verdict.PROVED
        assert certificate.covered_by == "tolerance"
        assert certificate.rate == certificate.check("tolerance").rate
        assert "gains off by up to 33 %" in certificate.reason
        assert both_accept(certificate) == (True, True)
        rate = certificate.check("lemma1").rate
        assert both_accept(certificate, covered_by="lemma1", rate=rate) == (False, False)
    else:
        require_undecided(certificate, "gains off by up to 34 % it is not proved", proof="lemma1")


@pytest.mark.parametrize(("omega", "proved"), [("0.5", True), ("1.01", False)])
def test_a_disturbance_counts_and_the_agents_end_near_the_target(omega: str, proved: bool):
    """2 hears 1 by tanh, which gives less than 1 however far it is."""
    arcs = [[2, 1]]
    problem = listening(
        arcs, "tanh(y)", n=2, gains={1: 30}, target=0, uncertainty={"disturbance": omega}
    )
    problem = problem.replace(region={"initial_states": [-1, 1]})
    certificate = certified(problem)
    if proved:
        assert certificate.verdict is Verdict.PROVED
        assert certificate.covered_by == "accuracy"
        assert certificate.rate is None
        assert "All agents end within 0.5" in certificate.reason
        assert "reach the target" not in certificate.reason
        assert both_accept(certificate) == (True, True)
        rate = certificate.check("max-separable").rate
        assert both_accept(certificate, covered_by="max-separable", rate=rate) == (False, False)
    else:
        require_undecided(certificate, "with a disturbance of up to 1.01 it is not proved")


@pytest.mark.slow
def test_followers_end_near_their_place_behind_the_leader():
    A = [[0, 1], [0, 0]]
    dynamics = {"A": A, "B": [[0], [1]]}
    leader = {"initial": [[0, 0], [1, 2]]}
    double = {"dynamics": dynamics, "leader": leader}
    arcs = [[2, 1]]
    gains = {1: [[3, 6]]}
    problem = listening(
        arcs,
        "y1 + 2*y2",
        n=2,
        gains=gains,
        uncertainty={"disturbance": "0.1"},
        **double,
    )
    assert " of the leader, in every component, from every start" in certified(problem).reason
    offsets = {2: [-20, 0]}
    moved_apart = problem.replace(offsets=offsets)
    apart = certified(moved_apart)
    assert " of the leader plus their offset, in every component, from every start" in apart.reason


#: Two agents, an observer, and everything that a file can state.
FULL = {
    "uncertainty": {"weights": "1/50", "gains": "1/50", "disturbance": "1/50", "drift": "1/100"},
    "actuators": {"limit": 7, "amplitude": 1},
}


def full(**more: Any) -> Problem:
    return pair(**SEEN | FULL | {"region": SEEN_BOX} | more)


def test_one_proof_has_all_tables():
    certificate = certified(full())
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "accuracy"
    assert certificate.rate is None
    assert "All agents end within" in certificate.reason
    assert (
        "weights off by up to 2 %, gains off by up to 2 %, a disturbance of up to 0.02"
        in certificate.reason
    )
    assert "no input exceeds the limit of 7" in certificate.reason
    assert both_accept(certificate) == (True, True)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            {"actuators": {"limit": "3.05", "amplitude": 1}},
            "with the limit of 3.05 it is not proved",
        ),
        (
            {"uncertainty": FULL["uncertainty"] | {"disturbance": 2}, "h": "tanh(y)"},
            "a disturbance of up to 2",
        ),
    ],
    ids=["limit", "disturbance"],
)
def test_one_table_that_is_too_much_makes_all_undecided(more: dict[str, Any], words: str):
    require_undecided(certified(full(**more)), words)


def test_errors_and_a_limit_that_can_be_kept_alone_are_not_proved_together():
    """k = 3 and |e| <= 1: 3 is needed, with an error of 1/5 it is 3.6."""
    arcs = [[2, 1]]
    problem = listening(arcs, "y", n=2, gains={1: 3}, target=0, region=BOX)
    limit = {"limit": {"1": "3.5"}}
    errors = {"gains": "1/5"}
    assert certified(problem.replace(actuators=limit)).verdict is Verdict.PROVED
    assert certified(problem.replace(uncertainty=errors)).verdict is Verdict.PROVED
    both = problem.replace(actuators=limit, uncertainty=errors)
    require_undecided(certified(both), "limit of 3.5", proof="tolerance")
    actuators = {"limit": {"1": "3.7"}}
    wide = problem.replace(actuators=actuators, uncertainty=errors)
    assert certified(wide).verdict == Verdict.PROVED
    assert certified(wide).covered_by == "tolerance"


@pytest.mark.slow
def test_a_disturbance_that_the_coupling_of_the_file_holds_is_too_much_for_a_weaker_one():
    """tanh gives less than 1: 3/4 acts, and an error of 30 % leaves 7/10."""
    arcs = [[2, 1]]
    problem = listening(arcs, "tanh(y)", n=2, gains={1: 30}, target=0, region=BOX)
    acts = {"disturbance": "3/4"}
    errors = {"weights": "3/10"}
    assert certified(problem.replace(uncertainty=acts)).verdict is Verdict.PROVED
    assert certified(problem.replace(uncertainty=errors)).verdict is Verdict.PROVED
    require_undecided(
        certified(problem.replace(uncertainty=acts | errors)), "a disturbance of up to 0.75"
    )
    held = problem.replace(uncertainty=acts | {"weights": "1/10"})
    assert certified(held).covered_by == "accuracy"


def test_without_a_region_limits_are_kept_near_the_target():
    """Also beside errors at the target, which have weights of their own: inputs get a box of their
    own."""
    enough = {"limit": "1.1", "amplitude": 1}
    inside = pair(**SEEN, actuators=enough, uncertainty={"gains": "1/10"})
    near = certified(inside)
    assert near.verdict is Verdict.PROVED
    assert near.covered_by == "tolerance"
    assert both_accept(near) == (True, True)
    too_little = {"limit": "0.99", "amplitude": 1}
    outside = pair(**SEEN, actuators=too_little)
    far = certified(outside)
    require_undecided(far, "The disturbance alone may need 1", proof="theorem1")


@pytest.mark.parametrize(
    "seed", [0, 1, 4, *(pytest.param(k, marks=pytest.mark.slow) for k in (2, 3, 5, 6, 7, 8))]
)
def test_tables_that_cannot_be_kept_are_never_proved(seed: int):
    """A share of the evidence, which has more of them; every third has two or three tables."""
    certificate = certified(broken(seed).problem)
    assert certificate.verdict is not Verdict.PROVED, broken(seed).why


@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_tables_that_can_be_kept_are_proved(seed: int):
    certificate = certified(kept(seed).problem)
    assert certificate.verdict is Verdict.PROVED, certificate.reason
    assert both_accept(certificate) == (True, True)


def test_a_drift_needs_the_amplitude():
    simulation = {"xi0": [1]}
    problem = full(actuators={"limit": 7}, simulation=simulation)
    require_undecided(certified(problem), "give actuators.amplitude")


def test_what_no_table_states_is_not_asked_for():
    """A drift without an exosystem is none, an amplitude is no limit, and zeros are no errors."""
    nothing = pair(region=BOX, uncertainty={"drift": 1}, actuators={"amplitude": 1})
    certificate = certified(nothing)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "max-separable"


def test_a_refuted_problem_stays_refuted_whatever_its_tables_say():
    arcs = [[2, 1]]
    problem = listening(arcs, "y", n=2, gains={2: 1}, target=0, actuators={"limit": 1})
    assert certified(problem).verdict is Verdict.REFUTED


@pytest.mark.parametrize(
    ("box", "told"), [({}, " from starts with |e_i| <= 0.16"), ({"region": BOX}, ".")]
)
def test_without_a_region_the_verdict_names_the_starts_that_keep_the_limit(
    box: dict[str, Any], told: str
):
    """Linear couplings bring every start to the target, but k = 3 asks for 3 |e|: far out a limit
    is exceeded."""
    arcs = [[2, 1]]
    actuators = {"limit": 1 if not box else 4}
    problem = listening(arcs, "y", n=2, gains={1: 3}, target=0, actuators=actuators)
    certificate = certified(problem.replace(**box))
    assert certificate.verdict is Verdict.PROVED
    assert f"no input exceeds the limit of {1 if not box else 4}{told}" in certificate.reason


@pytest.mark.parametrize(
    ("limit", "proved"), [pytest.param(2, True, marks=pytest.mark.slow), ("0.49", False)]
)
def test_without_a_region_boxes_hold_errors_of_estimates(limit: Any, proved: bool):
    """Close to the target, also of the estimates: with a disturbance, with a limit, and with
    both."""
    near = pair(**SEEN)
    limits = {"limit": limit, "amplitude": "1/2"}
    for plant in ({"uncertainty": {"disturbance": "0.02"}}, {}):
        certificate = certified(near.replace(**plant, actuators=limits))
        if proved:
            assert certificate.verdict is Verdict.PROVED
            assert (
                "no input exceeds the limit of 2 from starts with |e_i| <= " in certificate.reason
            )
            assert certificate.check("actuators").domain.disturbance > 0
            assert both_accept(certificate) == (True, True)
        else:
            require_undecided(certificate, "The disturbance alone may need 0.5")
            assert "region is larger" not in certificate.reason
            assert "smaller [region]" not in certificate.reason
    if proved:
        certificate = certified(near.replace(uncertainty={"disturbance": "0.02"}))
        assert certificate.verdict is Verdict.PROVED
        assert certificate.covered_by == "accuracy"


@pytest.mark.parametrize(
    ("limit", "told"), [("1.5", "from starts with |e_i| <= 0.75"), ("0.9", "is still 1.000")]
)
def test_a_limit_that_the_disturbance_reaches_is_not_kept_from_closer_starts(limit: str, told: str):
    """e' = -2 e + w with |w| <= 1 ends within 1/2, where u = -2 e is 1."""
    problem = listening(
        [], "y", n=1, gains={1: 2}, target=0, region=BOX, uncertainty={"disturbance": 1}
    )
    certificate = certified(problem.replace(actuators={"limit": limit}))
    assert certificate.verdict is Verdict.UNDECIDED
    assert told in certificate.reason
    assert ("never saturates" in certificate.reason) is (limit == "1.5")


@pytest.mark.parametrize(
    ("h", "why"), [(["y1", "y2 + y1/5"], "act on each state component by itself"), ("y", None)]
)
def test_a_limit_beside_couplings_of_vectors_is_open_because_of_these(h: Any, why: str | None):
    arcs = [[2, 1]]
    gains = {1: [[2, 0], [0, 2]]}
    problem = listening(arcs, h, n=2, gains=gains, target=[0, 0], actuators={"limit": 1})
    certificate = certified(problem)
    assert certificate.verdict is (Verdict.UNDECIDED if why else Verdict.PROVED)
    assert (why or "no input exceeds the limit of 1") in certificate.reason


def in_turns(a: list[list[int]], b: list[list[int]]) -> Network:
    modes = {"a": a, "b": b}
    labels = [1, 2, 3]
    return Network.from_arcs(modes, agents=labels, arrow="listens_to")


@few_chords()
@pytest.mark.parametrize(
    "table",
    [
        {"uncertainty": {"weights": "0.02"}},
        pytest.param({"uncertainty": {"disturbance": "0.02"}}, marks=pytest.mark.slow),
        {"actuators": {"limit": 3}},
    ],
)
def test_tables_beside_a_guarantee_are_open_because_of_the_signal_not_of_their_size(
    table: dict[str, Any],
):
    """2 hears 1 and 3 hears 2 in turn: no v serves both modes, whatever the errors are."""
    arcs = [[2, 1]]
    chain = listening(arcs, "y", n=3, gains={1: 2}, target=0, region=BOX)
    problem = chain.replace(**table)
    guarantee = Switching(guarantee="sequence", dwell=1)
    first_arcs = [[2, 1]]
    network = in_turns(first_arcs, [[3, 2]])
    turns = certified(problem.replace(network=network, switching=guarantee))
    assert turns.verdict is Verdict.UNDECIDED
    assert "decided for arbitrary switching, where no common weights v exist" in turns.reason
    assert "too large" not in turns.reason
    assert "search" not in turns.reason
    assert "pins or arcs by which every agent is reached in every mode" in turns.reason
    first = [[2, 1], [3, 2]]
    second = [[2, 1], [3, 1]]
    always = in_turns(first, second)
    assert certified(problem.replace(network=always)).verdict is Verdict.PROVED
