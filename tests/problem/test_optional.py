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


def loose(
    arcs: Any,
    optional: Any,
    *,
    agents: int = 3,
    coupling: str = "y",
    gains: Any = None,
    **more: Any,
) -> Problem:
    network = Network.from_arcs(arcs, arrow="listens_to", agents=agents, optional=optional)
    return Problem(
        network=network, coupling=coupling, gains={1: 1} if gains is None else gains, **more
    )


def listed(arcs: Pairs, optional: Pairs, **more: Any) -> Problem:
    """The same with a mode for every subset."""
    kept = itertools.product((False, True), repeat=len(optional))
    modes = {f"m{k}": [*arcs, *itertools.compress(optional, each)] for k, each in enumerate(kept)}
    return loose(modes, (), **more)


# --- How they are written, read and kept
# ------------------------------------------------------------------------------
def test_files_python_and_the_canonical_problem_say_the_same(tmp_path: Path):
    (tmp_path / "all.csv").write_text("1,2\n2,3\n")
    (tmp_path / "some.csv").write_text("1,3,2\n3,2\n")
    files = 'G = { arcs = { file = "all.csv" }, optional = { file = "some.csv" } }\n'
    network = Network.from_arcs(
        {"G": [[1, 2], [2, 3]]}, arrow="sends_to", optional={"G": [[1, 3, 2], [3, 2]]}
    )
    problem = Problem(name="p", network=network, coupling="y", gains={1: 1})
    assert (
        problem
        == read(G)
        == read(files, folder=tmp_path)
        == problem_from_canonical(canonical_bytes(problem))
    )
    assert read_problem_text(problem_text(problem).encode(), folder=None) == problem
    assert problem.network.modes["G"].always == read("G = [[1, 2], [2, 3]]\n").network.modes["G"]


def test_only_such_a_problem_has_the_key_and_version_3():
    document = json.loads(canonical_bytes(read(G)))
    assert document["version"] == 3
    assert document["modes"] == [
        {"name": "G", "arcs": [[1, 0, "1"], [2, 1, "1"]], "optional": [[2, 0, "2"], [1, 2, "1"]]}
    ]
    plain = "G = [[1, 2], [2, 3]]\n"
    assert canonical_bytes(
        read("G = { arcs = [[1, 2], [2, 3]], optional = [] }\n")
    ) == canonical_bytes(read(plain))
    older, empty = {"version": 1}, {"modes": [{"name": "G", "arcs": [], "optional": []}]}
    for changes in (older, empty):
        with pytest.raises(SpecError):
            problem_from_canonical(json.dumps(document | changes).encode())
    with pytest.raises(checker.Refused):
        checker.examine(
            certificate_bytes(consensus_claims(read(G))), json.dumps(document | older).encode()
        )


WRONG_MODES: list[Any] = []


def wrong_modes(key: str, modes: str) -> None:
    WRONG_MODES.append((modes, key))


wrong_modes(
    "network.modes.G.optional[1]", "G = { arcs = [[1, 2]], optional = [[2, 3], [1, 2, 5]] }"
)
wrong_modes("network.modes.G.optional[1]", "G = { arcs = [[1, 2]], optional = [[2, 3], [2, 3]] }")
wrong_modes("network.modes.G.arcs[1]", "G = { arcs = [[1, 2], [3, 3]], optional = [[2, 3]] }")
wrong_modes("network.modes.G.optional[0]", "G = { arcs = [[1, 2]], optional = [[2, 9]] }")
wrong_modes("network.modes.G", "G = { arcs = [[1, 2]], optional = [[2, 3]], more = 1 }")
wrong_modes("network.modes.G", "G = { optional = [[2, 3]] }")


@pytest.mark.parametrize(
    ("modes", "key"),
    WRONG_MODES,
)
def test_what_cannot_be_is_named(modes: str, key: str):
    with pytest.raises(SpecError) as error:
        read(modes + "\n")
    assert key in {each.key for each in error.value.errors}


def test_a_mode_that_is_not_there_is_named():
    with pytest.raises(SpecError, match="optional names a mode that arcs does not; got 'H'"):
        loose({"G": []}, {"H": [[1, 2]]})
    assert Network.from_arcs([[1, 2]], arrow="listens_to", optional=None).loose is None
    for key, given in (("arcs", {"arcs": 5}), ("optional", {"arcs": [[1, 2]], "optional": True})):
        with pytest.raises(SpecError, match=f"{key} must be a list of arcs"):
            Network.from_arcs(**given, arrow="listens_to")


@pytest.mark.parametrize(
    "use",
    [
        design,
        python_source,
        export.to_control,
        export.build_model,
        export.to_sdpa,
        export.to_casadi,
    ],
)
def test_what_does_not_know_them_says_so(use: Any):
    with pytest.raises(
        SpecError, match=r"network\.modes\.G\.optional: .* does not know arcs that come and go"
    ):
        use(read(G))


def test_runs_draw_them():
    """Agent 2 hears agent 1 by an optional arc only: while it is off it stays where it is."""
    problem = loose([], [[2, 1]], agents=2, simulation={"x0": [[1], [1]], "t_final": 10})
    run = simulate(problem, seed=3)
    assert {"G", "G, no optional arc"} <= set(run.switches.names)
    off = [
        k
        for k, t in enumerate(run.times[:-1])
        if "no" in run.switches.names[run.switches.at(np.array([t]))[0]]
    ]
    moved = np.abs(np.diff(run.x[:, 1, 0]))
    assert len(off) > 10
    assert np.mean(moved[off] == 0) > 0.5  # but where a sample interval holds a switch
    assert run.final_error < 1
    assert (
        simulate(problem, seed=3).final_error
        == run.final_error
        != simulate(problem, seed=4).final_error
    )


# --- What is proved
# --------------------------------------------------------------------------------------------------
KINDS = ("y", "exp(y) - 1 + y", "tanh(y)", "-y/2", "sin(2*y) - y/4", "y - y**3/4")


@pytest.mark.parametrize("seed", [*range(7), pytest.param(7, marks=pytest.mark.slow)])
def test_rows_have_the_rate_of_all_vertices(seed: int):
    """Oracle: the 2^k graphs listed as modes, k <= 4, with couplings that rise, fall and turn."""
    rng = random.Random(seed)
    n = rng.choice([2, 3, 4])
    pairs = [(i, j) for i in range(1, n + 1) for j in range(1, n + 1) if i != j]
    rng.shuffle(pairs)
    k = rng.randint(1, min(4, len(pairs)))
    arcs, optional = (
        [[*p, rng.choice(["1", "2", "1/3"])] for p in each]
        for each in (pairs[k : 2 * k], pairs[:k])
    )
    exceptions = (
        {(optional[0][0] - 1, optional[0][1] - 1): rng.choice(KINDS)} if rng.random() < 0.5 else {}
    )
    gains = {i: rng.choice([2, 5, 20]) for i in range(1, n + 1) if i < 3 or rng.random() < 0.7}
    given: Any = {
        "agents": n,
        "coupling": rng.choice(KINDS),
        "gains": gains,
        "exceptions": exceptions,
    }
    v, rho = (
        tuple(Fraction(rng.randint(70, 140), 100) for _ in range(n)),
        Fraction(rng.randint(1, 20), 10),
    )
    own, every = (
        largest_rate(loop_of(make(arcs, optional, **given)), v, rho=rho) for make in (loose, listed)
    )
    assert own == every or (own and every and abs(own / every - 1) < Fraction(1, 10**4))


def chain_with(count: int, *, coupling: str, seed: int = 3) -> tuple[Pairs, Pairs]:
    rng, found = random.Random(seed), list[list[int]]()
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
    pulls = [3 if i == 0 else 0 for i in range(8)]
    # by hand: of each agent the arcs that are always there, and the optional ones that push it
    # outward
    worst = []
    for i in range(8):
        sure = sum(v[j - 1] - v[i] for a, j in arcs if a == i + 1)
        worst.append(
            pulls[i]
            - (sure + sum(max(v[j - 1] - v[i], Fraction(0)) for a, j in optional if a == i + 1))
            / v[i]
        )
    assert rate is not None
    assert abs(rate / min(worst) - 1) < Fraction(1, 10**6)
    found = certify(problem)
    assert found.verdict is Verdict.PROVED
    assert verify(found.claims, problem).holds


@pytest.mark.parametrize(
    ("arcs", "optional", "gains", "coupling", "verdict"),
    [
        # x' = [[-k + s, -s], [0, -1]] x, s in [0, 1]: decays iff k > 1 (constant s = 1 is allowed)
        ([], [[1, 2]], {1: "11/10", 2: 1}, "-y", Verdict.PROVED),
        ([], [[1, 2]], {1: 1, 2: 1}, "-y", Verdict.UNDECIDED),
        # an agent that hears nobody for certain
        ([[2, 1]], [[3, 2]], {1: 1}, "y", Verdict.UNDECIDED),
        ([[2, 1], [3, 2]], [[3, 1]], {1: 1}, "y", Verdict.PROVED),
        # nobody at all, not even now and then
        ([[2, 1]], [[2, 3]], {1: 1}, "y", Verdict.REFUTED),
        ([[2, 1]], [[2, 3]], {1: 1}, "exp(y) - 1 + y", Verdict.REFUTED),
    ],
)
def test_known_answers(arcs: Pairs, optional: Pairs, gains: Any, coupling: str, verdict: Verdict):
    problem = loose(
        arcs,
        optional,
        gains=gains,
        coupling=coupling,
        agents=max(max(a[:2]) for a in [*arcs, *optional]),
    )
    found = certify(problem)
    assert found.verdict is verdict, found.reason
    assert verify(found.claims, problem).holds


def test_an_agent_that_may_lose_all_its_arcs_is_named_with_what_would_help():
    reason = certified(loose([[2, 1]], [[3, 2]])).reason
    assert (
        "in mode G no pinned agent reaches agent 3 by arcs that are always there. Pin agent 3."
        in reason
    )
    assert (
        "An arc that is always there would help as well: in this mode or, with a guarantee"
        in reason
    )


TURNS = Switching(guarantee="sequence", sequence=["A", "B"], dwell="1/8")
DRAWN = Switching(guarantee="markov", generator=[[-1, 1], [1, -1]])


@pytest.mark.parametrize(
    ("arcs", "optional", "switching", "verdict"),
    [
        (
            {"A": [[3, 2]], "B": [[2, 1]]},
            {"A": [[1, 2]], "B": [[1, 3], [2, 3]]},
            TURNS,
            Verdict.PROVED,
        ),
        # never on: agent 3 hears nobody
        ({"A": [[2, 1]], "B": []}, {"B": [[3, 2]]}, TURNS, Verdict.REFUTED),
        ({"A": [[3, 2]], "B": [[2, 1]]}, {"A": [[1, 2]]}, DRAWN, Verdict.PROVED),
        ({"A": [[2, 1]], "B": [[2, 1]]}, {"B": [[3, 2]]}, DRAWN, Verdict.REFUTED),  # as well
    ],
)
def test_beside_a_guarantee(arcs: Any, optional: Any, switching: Switching, verdict: Verdict):
    problem = loose(arcs, optional, switching=switching)
    found = certify(problem)
    assert found.verdict is verdict, found.reason
    assert verify(found.claims, problem).holds
    if verdict is not Verdict.PROVED:
        assert "by arcs that are always there" in " ".join(
            [found.reason, *(each.reason for each in found.checks)]
        )


FORGED = [  # arcs that are needed, and with which couplings; the check that is proved with them
    ({"A": [[2, 1]], "B": [[2, 1], [1, 2]]}, {1: 1, 2: "1/10"}, "y", {}, "lemma1"),
    ({"A": [[2, 1]], "B": [[2, 1]]}, {1: 1}, "y", {}, "theorem2-weighted"),
    ({"A": [[2, 1]], "B": [[2, 1]]}, {1: 1}, "tanh(y)", {}, "max-separable"),
    ({"A": [[2, 1]], "B": [[2, 1]]}, {1: 1}, "y", {}, "max-separable"),
    ({"A": [[2, 1]], "B": [[2, 1]]}, {1: 1}, "y", {}, "lure"),
    (
        {"A": [[2, 1]], "B": [[2, 1]]},
        {1: 1},
        "tanh(y)",
        {"uncertainty": {"disturbance": "1/50"}},
        "accuracy",
    ),
    (
        {"A": [[2, 1]], "B": [[2, 1]]},
        {1: 1},
        "y",
        {"region": {"initial_states": [-1, 1]}},
        "settling",
    ),
    ({"A": [[2, 1]], "B": []}, {1: 1}, "y", {"switching": TURNS}, "schedule"),
    pytest.param(
        {"A": [[2, 1]], "B": []},
        {1: 1},
        "tanh(y)",
        {"switching": TURNS},
        "schedule",
        marks=pytest.mark.slow,
    ),
    ({"A": [[2, 1]], "B": []}, {1: 1}, "y", {"switching": DRAWN}, "markov"),
]


STAGES = {
    "max-separable": separable_stage,
    "lure": quadratic_stage,
    "schedule": schedule_stage,
    "markov": markov_stage,
    "accuracy": separable_stage,  # which the accuracy rests on
}


def with_check(problem: Problem, id: str) -> Claims:
    """The claims of the theorems, and of the stage that makes this check."""

    def report(stage: str) -> None:
        pass

    claims, domain = consensus_claims(problem), state_theorems(loop_of(problem)).domain
    checks = claims.checks
    if id in STAGES:
        asked = read_region(loop_of(problem), claims.W, domain=domain, everything=problem.is_linear)
        checks += tuple(STAGES[id](asked, report))
    case = Case(loop=loop_of(problem), W=claims.W, domain=domain, checks=checks)
    if id == "settling":
        checks += (settling_stage(case, tolerance=Fraction(1, 2), report=report),)
    if id == "accuracy":
        checks += tuple(accuracy_stage(case, report))
    return replace(claims, checks=checks)


@pytest.mark.parametrize(("arcs", "gains", "coupling", "more", "id"), FORGED)
def test_what_needs_an_arc_is_refused_by_both_programs_where_it_may_be_absent(
    arcs: Any, gains: Any, coupling: str, more: Any, id: str
):
    """The claims of the problem whose arcs are always there, put beside the one whose arc from 1 to
    2 is optional."""
    region = {} if coupling == "y" else {"region": {"initial_states": [-1, 1]}}
    given: Any = {"agents": 2, "gains": gains, "coupling": coupling, **region, **more}
    honest = loose(arcs, (), **given)
    modes = {name: [arc for arc in each if arc != [2, 1]] for name, each in arcs.items()}
    optional = {name: [arc for arc in each if arc == [2, 1]] for name, each in arcs.items()}
    problem = loose(modes, optional, **given)
    claims = with_check(honest, id)
    checks = [each for each in claims.checks if each.id == id]
    assert checks
    assert all(each.verdict is Verdict.PROVED for each in checks)
    document = json.loads(certificate_bytes(claims)) | {"problem_sha256": problem_sha256(problem)}
    data = json.dumps(document).encode()
    titles = {each.title for each in checks}
    assert titles & {
        text.partition(":")[0] for text in _refused(recheck(data, problem).failures, titles)
    }
    refused = [text for holds, text in checker.examine(data, canonical_bytes(problem)) if not holds]
    assert any(text.startswith(id) for text in refused), refused


def _refused(failures: Sequence[str], titles: set[str]) -> list[str]:
    return [
        f"{title}:" for title in titles if any(text.startswith(f"{title}: ") for text in failures)
    ]


def test_a_part_of_a_mode_is_always_there():
    arcs = read(G).network.modes["G"]
    assert (len(arcs), arcs.optional, len(arcs.always), len(arcs.present)) == (4, 2, 2, 4)
    assert arcs != arcs.present == Arcs(arcs.listeners, arcs.speakers, arcs.weights)
    assert arcs.uncertain.tolist() == [False, False, True, True]
