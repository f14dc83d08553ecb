"""Optional arcs come and go at any time: how they are written, read and kept; what is proved about
them."""

import itertools
import json
import random
import time
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from certified import certified, consensus_claims

from dobc_design import (
    Certificate,
    Network,
    Problem,
    Switching,
    Verdict,
    certify,
    design,
    export,
    simulate,
    verify,
)
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.conditions.accuracy.stage import accuracy_stage
from dobc_design.conditions.case import Case
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.graphs.stage import markov_stage
from dobc_design.conditions.quadratic.stage import quadratic_stage
from dobc_design.conditions.schedule.stage import schedule_stage, settling_stage
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.designer.source import python_source
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical, problem_sha256
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import read_problem_text
from dobc_design.problem.network import Arcs

HEAD = 'name = "p"\n[network]\nagents = 3\narrow = "sends_to"\n[network.modes]\n'
TAIL = '[coupling]\nh = "y"\n[pinning]\ngains = { 1 = 1 }\n'
G = "G = { arcs = [[1, 2], [2, 3]], optional = [[1, 3, 2], [3, 2]] }\n"
Pairs = Sequence[Sequence[Any]]


def read(modes: str, *, tail: str = TAIL, folder: Path | None = None) -> Problem:
    return read_problem_text((HEAD + modes + tail).encode(), folder=folder)


def loose(arcs: Any, optional: Any, *, agents: int = 3, **more: Any) -> Problem:
    network = Network.from_arcs(arcs, arrow="listens_to", agents=agents, optional=optional)
    given: dict[str, Any] = {"coupling": "y", "gains": {1: 1}}
    return Problem(network=network, **given | more)


def listed(arcs: Pairs, optional: Pairs, **more: Any) -> Problem:
    """The same with a mode for every subset."""
    modes = {}
    for kept in itertools.product((False, True), repeat=len(optional)):
        modes[f"m{len(modes)}"] = [*arcs, *itertools.compress(optional, kept)]
    return loose(modes, (), **more)


# --- How they are written, read and kept
# ------------------------------------------------------------------------------
def test_files_python_and_the_canonical_problem_say_the_same(tmp_path: Path):
    (tmp_path / "all.csv").write_text("1,2\n2,3\n")
    (tmp_path / "some.csv").write_text("1,3,2\n3,2\n")
    files = 'G = { arcs = { file = "all.csv" }, optional = { file = "some.csv" } }\n'
    always = {"G": [[1, 2], [2, 3]]}
    optional = {"G": [[1, 3, 2], [3, 2]]}
    network = Network.from_arcs(always, arrow="sends_to", optional=optional)
    problem = Problem(name="p", network=network, coupling="y", gains={1: 1})
    assert read(G) == problem
    assert read(files, folder=tmp_path) == problem
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    assert read_problem_text(problem_text(problem).encode(), folder=None) == problem
    assert problem.network.modes["G"].always == read("G = [[1, 2], [2, 3]]\n").network.modes["G"]


def test_only_such_a_problem_has_the_key_and_version_3():
    problem = read(G)
    document = json.loads(canonical_bytes(problem))
    assert document["version"] == 3
    (mode,) = document["modes"]
    assert mode["name"] == "G"
    assert mode["arcs"] == [[1, 0, "1"], [2, 1, "1"]]
    assert mode["optional"] == [[2, 0, "2"], [1, 2, "1"]]
    assert set(mode) == {"name", "arcs", "optional"}

    plain = read("G = [[1, 2], [2, 3]]\n")
    without = read("G = { arcs = [[1, 2], [2, 3]], optional = [] }\n")
    assert canonical_bytes(without) == canonical_bytes(plain)

    older = json.dumps(document | {"version": 1}).encode()
    with pytest.raises(SpecError):
        problem_from_canonical(older)
    with pytest.raises(checker.Refused):
        checker.examine(certificate_bytes(consensus_claims(problem)), older)
    empty = {"modes": [{"name": "G", "arcs": [], "optional": []}]}
    with pytest.raises(SpecError):
        problem_from_canonical(json.dumps(document | empty).encode())


WRONG_MODES: list[Any] = []


def wrong_modes(key: str, modes: str) -> None:
    WRONG_MODES.append((modes, key))


SECOND = "network.modes.G.optional[1]"
wrong_modes(SECOND, "G = { arcs = [[1, 2]], optional = [[2, 3], [1, 2, 5]] }")
wrong_modes(SECOND, "G = { arcs = [[1, 2]], optional = [[2, 3], [2, 3]] }")
wrong_modes("network.modes.G.arcs[1]", "G = { arcs = [[1, 2], [3, 3]], optional = [[2, 3]] }")
wrong_modes("network.modes.G.optional[0]", "G = { arcs = [[1, 2]], optional = [[2, 9]] }")
wrong_modes("network.modes.G", "G = { arcs = [[1, 2]], optional = [[2, 3]], more = 1 }")
wrong_modes("network.modes.G", "G = { optional = [[2, 3]] }")


@pytest.mark.parametrize(("modes", "key"), WRONG_MODES)
def test_what_cannot_be_is_named(modes: str, key: str):
    with pytest.raises(SpecError) as error:
        read(modes + "\n")
    assert key in {each.key for each in error.value.errors}


def test_a_mode_that_is_not_there_is_named():
    with pytest.raises(SpecError, match="optional names a mode that arcs does not; got 'H'"):
        loose({"G": []}, {"H": [[1, 2]]})
    without = Network.from_arcs([[1, 2]], arrow="listens_to", optional=None)
    assert without.loose is None
    no_arcs = ("arcs", {"arcs": 5})
    no_optional = ("optional", {"arcs": [[1, 2]], "optional": True})
    for key, given in (no_arcs, no_optional):
        with pytest.raises(SpecError, match=f"{key} must be a list of arcs"):
            Network.from_arcs(**given, arrow="listens_to")


WITHOUT_OPTIONAL: list[Any] = [design, python_source]
WITHOUT_OPTIONAL += [export.to_control, export.build_model, export.to_sdpa, export.to_casadi]


@pytest.mark.parametrize("use", WITHOUT_OPTIONAL)
def test_what_does_not_know_them_says_so(use: Any):
    said = r"network\.modes\.G\.optional: .* does not know arcs that come and go"
    with pytest.raises(SpecError, match=said):
        use(read(G))


def test_runs_draw_them():
    """Agent 2 hears agent 1 by an optional arc only: while it is off it stays where it is."""
    start = {"x0": [[1], [1]], "t_final": 10}
    problem = loose([], [[2, 1]], agents=2, simulation=start)
    run = simulate(problem, seed=3)
    names = np.array(run.switches.names)
    assert {"G", "G, no optional arc"} <= set(names)

    active = names[run.switches.at(run.times[:-1])]
    off = ["no" in name for name in active]
    assert sum(off) > 10
    moved = np.abs(np.diff(run.x[:, 1, 0]))
    # an agent moves where a sample interval holds a switch
    assert np.mean(moved[off] == 0) > 0.5

    assert run.final_error < 1
    assert simulate(problem, seed=3).final_error == run.final_error
    assert simulate(problem, seed=4).final_error != run.final_error


# --- What is proved
# --------------------------------------------------------------------------------------------------
PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


def certified_as(problem: Problem, verdict: Verdict) -> Certificate:
    found = certify(problem)
    assert found.verdict is verdict, found.reason
    assert verify(found.claims, problem).holds
    return found


KINDS = ("y", "exp(y) - 1 + y", "tanh(y)", "-y/2", "sin(2*y) - y/4", "y - y**3/4")


@pytest.mark.parametrize("seed", [*range(7), pytest.param(7, marks=pytest.mark.slow)])
def test_rows_have_the_rate_of_all_vertices(seed: int):
    """Oracle: the 2^k graphs listed as modes, k <= 4, with couplings that rise, fall and turn."""
    rng = random.Random(seed)
    n = rng.choice([2, 3, 4])
    agents = range(1, n + 1)
    pairs = [*itertools.permutations(agents, 2)]
    rng.shuffle(pairs)
    k = rng.randint(1, min(4, len(pairs)))

    def weighted(chosen: list[tuple[int, int]]) -> Pairs:
        return [[*pair, rng.choice(["1", "2", "1/3"])] for pair in chosen]

    arcs = weighted(pairs[k : 2 * k])
    optional = weighted(pairs[:k])
    given: Any = {"agents": n, "gains": {}, "exceptions": {}}
    if rng.random() < 0.5:
        listener, speaker, _ = optional[0]
        given["exceptions"] = {(listener - 1, speaker - 1): rng.choice(KINDS)}
    for i in agents:
        if i < 3 or rng.random() < 0.7:
            given["gains"][i] = rng.choice([2, 5, 20])
    given["coupling"] = rng.choice(KINDS)
    v = tuple(Fraction(rng.randint(70, 140), 100) for _ in agents)
    rho = Fraction(rng.randint(1, 20), 10)

    own = largest_rate(loop_of(loose(arcs, optional, **given)), v, rho=rho)
    every = largest_rate(loop_of(listed(arcs, optional, **given)), v, rho=rho)
    if own != every:
        assert own
        assert every
        assert abs(own / every - 1) < Fraction(1, 10**4)


def chain_with(count: int, *, coupling: str, seed: int = 3) -> tuple[Pairs, Pairs]:
    rng = random.Random(seed)
    found: list[list[int]] = []
    while len(found) < count:
        arc = [rng.randint(2, 8), rng.randint(1, 8)]
        if arc[0] - arc[1] not in (0, 1) and arc not in found:
            found.append(arc)
    return [[i, i - 1] for i in range(2, 9)], found


def test_twelve_arcs_take_one_certificate():
    """4096 graphs in one row of each agent.  Oracle: the rows written out by hand."""
    arcs, optional = chain_with(12, coupling="y")
    problem = loose(arcs, optional, agents=8, gains={1: 3}, coupling="y")
    v = tuple(2 - Fraction(1, 20) ** i for i in range(8))
    begin = time.perf_counter()
    rate = largest_rate(loop_of(problem), v, rho=None)
    assert time.perf_counter() - begin < 0.5
    # by hand: of each agent the arcs that are always there, and the optional ones that push it
    # outward
    pushed = [Fraction(0)] * 8
    for a, j in arcs:
        pushed[a - 1] += v[j - 1] - v[a - 1]
    for a, j in optional:
        difference = v[j - 1] - v[a - 1]
        pushed[a - 1] += max(difference, Fraction(0))
    worst = [-push / size for push, size in zip(pushed, v, strict=True)]
    worst[0] += 3
    assert rate is not None
    assert abs(rate / min(worst) - 1) < Fraction(1, 10**6)
    certified_as(problem, PROVED)


ANSWERS: list[Any] = []


def answer(verdict: Verdict, arcs: Pairs, optional: Pairs, **more: Any) -> None:
    ANSWERS.append((arcs, optional, more, verdict))


# x' = [[-k + s, -s], [0, -1]] x, s in [0, 1]: decays iff k > 1 (constant s = 1 is allowed)
answer(PROVED, [], [[1, 2]], gains={1: "11/10", 2: 1}, coupling="-y", agents=2)
answer(UNDECIDED, [], [[1, 2]], gains={1: 1, 2: 1}, coupling="-y", agents=2)
# an agent that hears nobody for certain
answer(UNDECIDED, [[2, 1]], [[3, 2]])
answer(PROVED, [[2, 1], [3, 2]], [[3, 1]])
# nobody at all, not even now and then
answer(REFUTED, [[2, 1]], [[2, 3]])
answer(REFUTED, [[2, 1]], [[2, 3]], coupling="exp(y) - 1 + y")


@pytest.mark.parametrize(("arcs", "optional", "more", "verdict"), ANSWERS)
def test_known_answers(arcs: Pairs, optional: Pairs, more: Any, verdict: Verdict):
    certified_as(loose(arcs, optional, **more), verdict)


def test_an_agent_that_may_lose_all_its_arcs_is_named_with_what_would_help():
    unreached = loose([[2, 1]], [[3, 2]])
    reason = certified(unreached).reason
    named = "in mode G no pinned agent reaches agent 3 by arcs that are always there. Pin agent 3."
    assert named in reason
    helpful = "An arc that is always there would help as well: in this mode or, with a guarantee"
    assert helpful in reason


TURNS = Switching(guarantee="sequence", sequence=["A", "B"], dwell="1/8")
DRAWN = Switching(guarantee="markov", generator=[[-1, 1], [1, -1]])


GUARANTEED: list[Any] = []


def guaranteed(verdict: Verdict, switching: Switching, arcs: Any, optional: Any) -> None:
    GUARANTEED.append((arcs, optional, switching, verdict))


IN_TURN = {"A": [[3, 2]], "B": [[2, 1]]}
guaranteed(PROVED, TURNS, IN_TURN, {"A": [[1, 2]], "B": [[1, 3], [2, 3]]})
guaranteed(PROVED, DRAWN, IN_TURN, {"A": [[1, 2]]})
# never on: agent 3 hears nobody
guaranteed(REFUTED, TURNS, {"A": [[2, 1]], "B": []}, {"B": [[3, 2]]})
guaranteed(REFUTED, DRAWN, {"A": [[2, 1]], "B": [[2, 1]]}, {"B": [[3, 2]]})


@pytest.mark.parametrize(("arcs", "optional", "switching", "verdict"), GUARANTEED)
def test_beside_a_guarantee(arcs: Any, optional: Any, switching: Switching, verdict: Verdict):
    found = certified_as(loose(arcs, optional, switching=switching), verdict)
    if verdict is REFUTED:
        reasons = [found.reason, *(each.reason for each in found.checks)]
        assert "by arcs that are always there" in " ".join(reasons)


ALWAYS = {"A": [[2, 1]], "B": [[2, 1]]}
NOW_AND_THEN = {"A": [[2, 1]], "B": []}
INTERVAL = {"initial_states": [-1, 1]}
FORGED: list[Any] = []


def forged(id: str, arcs: Any, marks: Any = (), **more: Any) -> None:
    """The arcs are needed for what this check says."""
    FORGED.append(pytest.param(arcs, more, id, marks=marks))


BACK = {"A": [[2, 1]], "B": [[2, 1], [1, 2]]}
forged("lemma1", BACK, gains={1: 1, 2: "1/10"})
forged("theorem2-weighted", ALWAYS)
forged("max-separable", ALWAYS, coupling="tanh(y)")
forged("max-separable", ALWAYS)
forged("lure", ALWAYS)
forged("accuracy", ALWAYS, coupling="tanh(y)", uncertainty={"disturbance": "1/50"})
forged("settling", ALWAYS, region=INTERVAL)
forged("schedule", NOW_AND_THEN, switching=TURNS)
forged("schedule", NOW_AND_THEN, pytest.mark.slow, coupling="tanh(y)", switching=TURNS)
forged("markov", NOW_AND_THEN, switching=DRAWN)


STAGES = {"max-separable": separable_stage, "lure": quadratic_stage}
STAGES |= {"schedule": schedule_stage, "markov": markov_stage}
STAGES["accuracy"] = separable_stage  # which the accuracy rests on


def with_check(problem: Problem, id: str) -> Claims:
    """The claims of the theorems, and of the stage that makes this check."""

    def report(stage: str) -> None:
        pass

    loop = loop_of(problem)
    claims = consensus_claims(problem)
    domain = state_theorems(loop).domain
    checks = claims.checks
    if id in STAGES:
        asked = read_region(loop, claims.W, domain=domain, everything=problem.is_linear)
        checks += tuple(STAGES[id](asked, report))
    case = Case(loop=loop, W=claims.W, domain=domain, checks=checks)
    if id == "settling":
        checks += (settling_stage(case, tolerance=Fraction(1, 2), report=report),)
    if id == "accuracy":
        checks += tuple(accuracy_stage(case, report))
    return replace(claims, checks=checks)


@pytest.mark.parametrize(("arcs", "more", "id"), FORGED)
def test_what_needs_an_arc_is_refused_by_both_programs_where_it_may_be_absent(
    arcs: Any, more: Any, id: str
):
    """The claims of the problem whose arcs are always there, put beside the one whose arc from 1 to
    2 is optional."""
    given: Any = {"agents": 2, **more}
    if "coupling" in more:
        given["region"] = INTERVAL
    claims = with_check(loose(arcs, (), **given), id)
    checks = [each for each in claims.checks if each.id == id]
    assert checks
    assert {each.verdict for each in checks} == {PROVED}

    modes: dict[str, Pairs] = {}
    optional: dict[str, Pairs] = {}
    for name, each in arcs.items():
        modes[name] = [arc for arc in each if arc != [2, 1]]
        optional[name] = [arc for arc in each if arc == [2, 1]]
    problem = loose(modes, optional, **given)
    document = json.loads(certificate_bytes(claims))
    document["problem_sha256"] = problem_sha256(problem)
    data = json.dumps(document).encode()

    failures = recheck(data, problem).failures
    beginnings = tuple(f"{each.title}: " for each in checks)
    assert any(text.startswith(beginnings) for text in failures)
    refused = [text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds]
    assert any(text.startswith(id) for text in refused), refused


def test_a_part_of_a_mode_is_always_there():
    arcs = read(G).network.modes["G"]
    assert len(arcs) == 4
    assert arcs.optional == 2
    assert len(arcs.always) == 2
    assert len(arcs.present) == 4
    assert arcs != arcs.present
    assert arcs.present == Arcs(arcs.listeners, arcs.speakers, arcs.weights)
    assert arcs.uncertain.tolist() == [False, False, True, True]
