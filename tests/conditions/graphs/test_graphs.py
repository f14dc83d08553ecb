"""`safety` and `markov`: what `certify` proves, beside moments and graphs that others computed."""

from fractions import Fraction
from itertools import permutations
from typing import Any

import networkx as nx
import numpy as np
import pytest
from certified import only
from checker_files.files import second_loop
from networks import loop_by_hand

from dobc_design import Exosystem, Network, Problem, Switching, Verdict, certify, simulate
from dobc_design.certification.recheck import verify_twice
from dobc_design.checker import guarantee as checker_guarantee
from dobc_design.checker.reading import read
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.graphs.decide import closed_classes, why_not
from dobc_design.conditions.graphs.propose import mean_claim, square_claim
from dobc_design.conditions.graphs.stage import markov_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.errors import SpecError
from dobc_design.loop.make import loop_of

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
PAPER = "exp(y) - 1 + y"
CHAIN = {"A": [[3, 2]], "B": [[2, 1]]}
WAVE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
MOBILE = Switching(signal="mobile", radius=1)


def problem(
    modes: Any = CHAIN,
    *,
    n: int = 3,
    coupling: Any = "y",
    generator: Any = ((-1, 1), (2, -2)),
    **more: Any,
) -> Problem:
    network = Network.from_arcs(modes, arrow="listens_to", agents=n)
    rates = [list(row) for row in generator]
    switching = Switching(guarantee="markov", generator=rates)
    parts = {"network": network, "coupling": coupling, "gains": {1: 1}, "switching": switching}
    return Problem(**parts | more)


def check_of(found: Any, id: str) -> Any:
    assert verify_twice(found.claims, found.problem).holds
    return found.check(id)


def ids(found: Any) -> set[str]:
    return {each.id for each in found.checks}


def side(radius: Any) -> dict[str, Any]:
    """A region."""
    return {"initial_states": [f"-{radius}", f"{radius}"]}


def drawn(rng: np.random.Generator, *, n: int, count: int) -> tuple[dict[str, Any], Any]:
    """Modes of few arcs, and a generator with few rates."""
    modes = dict[str, Any]()
    for p in range(count):
        arcs = list[list[int]]()
        for i, j in permutations(range(n), 2):
            if rng.random() < 0.25:
                weight = int(rng.integers(1, 4))
                arc = [i + 1, j + 1, weight]
                arcs.append(arc)
        modes[f"M{p}"] = arcs
    kept = rng.random((count, count)) < 0.6
    rates = np.where(kept, rng.integers(1, 4, (count, count)), 0)
    np.fill_diagonal(rates, 0)
    leaving = np.diag(rates.sum(axis=1))
    return modes, (rates - leaving).tolist()


def systems(own: Problem, sign: float = 1.0) -> list[np.ndarray]:
    """A_p = J_p - K of h = sign y, with scalar gains."""
    return [loop_by_hand(own, mode, slope=sign) for mode in own.network.modes]


def rate_of(systems: list[np.ndarray], generator: Any) -> float:
    """Of E x 1_p with x' = A_p x in mode p, by the eigenvalues of its equation."""
    G = np.array(generator, dtype=float)
    n = len(systems[0])
    moments = np.kron(G.T, np.eye(n))
    for p, A in enumerate(systems):
        own = slice(p * n, (p + 1) * n)
        moments[own, own] += A
    return float(-max(np.linalg.eigvals(moments).real))


def squares(systems: list[np.ndarray]) -> list[np.ndarray]:
    """The systems of e e', twice as fast as e."""
    one = np.eye(len(systems[0]))
    sums = []
    for A in systems:
        sums.append(np.kron(A, one) + np.kron(one, A))
    return sums


@pytest.mark.parametrize("seed", range(60))
def test_means_and_squares_agree_with_the_eigenvalues_of_the_moments(seed: int):
    """Couplings of either sign; where means decay by the eigenvalues, weights are found, and the
    rates are those."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    count = int(rng.integers(2, 4))
    sign = 1 if seed % 3 else -1
    modes, generator = drawn(rng, n=n, count=count)
    most = 8 if sign < 0 else 3
    gains = dict[int, int]()
    for i in range(n):
        if i == 0 or sign < 0 or rng.random() < 0.2:
            gains[i + 1] = int(rng.integers(1, most))
    coupling = "y" if sign > 0 else "-y"
    own = problem(modes, n=n, coupling=coupling, generator=generator, gains=gains)
    loop = loop_of(own)
    linear = systems(own, sign)
    mean = rate_of(linear, generator)
    square = rate_of(squares(linear), generator) / 2
    G = own.switching.generator
    squared = square_claim(loop, None, G)
    if abs(square) > 1e-6:
        is_proved = squared is not None and why_not(loop, None, squared) is None
        assert is_proved == (square > 0)
    if squared is not None:
        assert 0.9 * square <= float(squared.rate) <= square
    found = mean_claim(loop, None, G)
    is_proved = found is not None and why_not(loop, None, found) is None
    if sign > 0 and abs(mean) > 1e-6:
        assert is_proved == (mean > 0)
        assert found is None or 0.99 * mean <= float(found.rate) <= mean
    else:
        assert not is_proved


@pytest.mark.parametrize("seed", range(60))
def test_almost_surely_iff_every_closed_class_reaches_every_agent(seed: int):
    """With networkx: attracting components of the chain, and the union of their graphs."""
    rng = np.random.default_rng(1000 + seed)
    n = int(rng.integers(2, 6))
    count = int(rng.integers(2, 5))
    modes, generator = drawn(rng, n=n, count=count)
    region = side(1)
    own = problem(modes, n=n, coupling=PAPER, generator=generator, region=region)
    pairs = permutations(range(count), 2)
    steps = [(p, q) for p, q in pairs if generator[p][q] > 0]
    chain = nx.DiGraph(steps)
    chain.add_nodes_from(range(count))
    classes = sorted(tuple(sorted(each)) for each in nx.attracting_components(chain))
    assert closed_classes(own.switching.generator) == classes
    lost = []
    for each in classes:
        arcs = [(b, a) for p in each for a, b, _ in modes[f"M{p}"]]
        graph = nx.DiGraph(arcs)
        graph.add_nodes_from(range(1, n + 1))
        left = set(graph) - {1} - nx.descendants(graph, 1)
        if left:
            names = tuple(f"M{p}" for p in each)
            lost.append((names, tuple(map(str, sorted(left)))))
    asked = read_region(loop_of(own), None, domain=NEAR_TARGET, everything=False)
    (check,) = markov_stage(asked, lambda _: None)
    assert check.verdict is (Verdict.REFUTED if lost else Verdict.PROVED)
    if lost:
        told = (tuple(check.exact["modes"]), check.witness.labels)
        assert told == lost[0]


def test_larger_networks_in_the_mean():
    ring = []
    for i in range(1, 21):
        ring.append([i, i % 20 + 1])
    even = ring[1::2]
    halves = {"odd": ring[::2], "even": even}
    gains = {1: 1, 11: 1}
    own = problem(halves, n=20, gains=gains, exosystem=WAVE)
    check = check_of(certify(own), "markov")
    assert check.exact["kind"] == "mean"
    assert check.domain == EVERYWHERE
    generator = [[-1, 1], [2, -2]]
    expected_rate = rate_of(systems(own), generator)
    assert check.rate <= expected_rate
    assert "in the mean" in check.reason


def test_couplings_that_mix_components_in_mean_square():
    own = problem(coupling=["y1 + y2/4", "y2"], target=[0, 0])
    check = check_of(certify(own), "markov")
    assert check.exact["kind"] == "mean square"
    modes = {"A": [[1, 2]], "B": [[2, 1]]}
    stiff = problem(modes, n=2, coupling=["y1 + 9*y2", "y2 - 9*y1"], target=[0, 0])
    assert check_of(certify(stiff), "markov").verdict is PROVED


@only(separable_stage, markov_stage)
def test_an_unstable_mode_that_does_not_last_refutes_nothing():
    """e_1' = e_1/2 - e_2 in A; the chain leaves A nine times as fast as it comes."""
    gains = {1: "1/2", 2: 3}
    more: Any = {"n": 2, "coupling": "-y", "gains": gains}
    modes = {"A": [[1, 2]], "B": [[2, 1]]}
    rarely_off = ((-9, 9), (1, -1))
    brief = problem(modes, generator=rarely_off, **more)
    assert certify(brief).verdict is PROVED
    often_off = ((-1, 1), (9, -9))
    longer = problem(modes, generator=often_off, **more)
    found = certify(longer)
    assert found.verdict is UNDECIDED
    assert verify_twice(found.claims, found.problem).holds
    never_off = ((0, 0), (9, -9))
    for_ever = problem(modes, generator=never_off, **more)
    assert certify(for_ever).verdict is REFUTED


@pytest.mark.parametrize(("guarantee", "verdict"), [("arbitrary", REFUTED), ("markov", UNDECIDED)])
@only(markov_stage)
def test_an_equilibrium_of_a_mode_that_does_not_last_refutes_nothing(
    guarantee: str, verdict: Verdict
):
    """sin vanishes at pi: agent 2 may rest there while it hears agent 1."""
    generator = [[-1, 1], [1, -1]]
    turns = Switching(signal="markov", guarantee=guarantee, generator=generator)
    modes = {"A": [[2, 1]], "B": [[2, 1], [1, 2]]}
    own = problem(modes, n=2, coupling="sin(y)", region=side(4), switching=turns)
    found = certify(own)
    assert ("equilibrium" in ids(found)) == (verdict is REFUTED)
    assert found.verdict is verdict
    assert verify_twice(found.claims, found.problem).holds


def test_a_box_as_large_as_couplings_rise_and_nothing_without_the_guarantee():
    generator = [[-1, 1], [2, -2]]
    switching = Switching(signal="markov", generator=generator)
    found = certify(problem(switching=switching))
    assert "markov" not in ids(found)
    with pytest.raises(SpecError, match=r"switching\.generator is required"):
        Switching(guarantee="markov")
    # sin rises up to pi/2: a box of pi/4 at most; the region asks for more.
    found = certify(problem(coupling="sin(y)", region=side(2)))
    check = check_of(found, "markov")
    assert check.verdict is Verdict.PROVED
    assert check.domain.radius == 0.5
    assert found.verdict is UNDECIDED
    assert "consensus is proved from |e_i| <= 0.5 for every agent (markov)" in found.reason


def test_all_pinned_agents_reach_the_target_for_every_graph():
    gains = {1: 1, 2: "1/2", 3: 2}
    own = problem(coupling=PAPER, gains=gains, switching=MOBILE, region=side(2))
    found = certify(own)
    check = check_of(found, "safety")
    assert check.rate == 0.5
    assert check.claim.rate == Fraction(1, 2)
    kept = "from |e(0)| <= 2 no agent ever leaves the box |e| <= 2, whatever the graph"
    assert check.reason.startswith(f"{kept}, its switching and the")
    all_pinned = "All agents are pinned, so from there all reach the target"
    assert f"{all_pinned} for every graph and every motion" in check.reason
    pace = "for every graph and every motion, at a rate of at least 0.5 1/s with"
    assert f"in the region {pace}" in found.reason


def test_an_observer_takes_its_part_of_the_box():
    region = {"initial_states": [-1, 1], "initial_disturbance": 1}
    own = problem(coupling=PAPER, gains=1, switching=MOBILE, region=region, exosystem=WAVE)
    claim = check_of(certify(own), "safety").claim
    assert claim.rate is not None
    error = claim.box.error
    assert error.kappa * (error.beta - claim.rate) >= 1
    size = error.kappa**2 * error.size
    allowed = (claim.box.rho - 1) ** 2
    assert size <= allowed


def test_without_a_pin_the_box_holds_and_couplings_that_fall_are_left_open():
    own = problem(coupling="y + y**3", switching=MOBILE, region=side(2))
    found = certify(own)
    check = check_of(found, "safety")
    assert check.verdict is PROVED
    assert check.rate is None
    assert found.verdict is UNDECIDED
    assert 'agents 2 and 3); a guarantee on time would help (guarantee = "dwell")' in found.reason
    falling = problem(coupling="-y", gains=5, switching=MOBILE)
    check = check_of(certify(falling), "safety")
    assert check.verdict is UNDECIDED
    assert "not shown to rise" in check.reason


def test_other_proofs_of_a_moving_graph_are_about_the_declared_modes():
    modes = {"A": [[2, 1]], "B": [[2, 1], [1, 2]]}
    own = problem(modes, n=2, coupling=PAPER, switching=MOBILE, region=side(1))
    found = certify(own)
    assert found.claims.covered_by == "max-separable"
    assert "every mix of their neighbour sets" in found.reason
    told = "Graphs that the modes do not list are not covered. From |e(0)| <= 1"
    assert f"{told} no agent ever leaves the box |e| <= 1" in found.reason


def test_no_simulated_agent_that_moves_leaves_the_box():
    moving = Switching(signal="mobile", radius="1/2")
    own = problem({"A": []}, n=5, coupling=PAPER, switching=moving)
    rng = np.random.default_rng(1)
    for seed in range(3):
        start = rng.uniform(-1, 1, (5, 1))
        run = simulate(own, start=start, t_final=3, seed=seed)
        largest = np.max(np.abs(run.x))
        allowed = np.max(np.abs(start)) * (1 + 1e-9)
        assert largest <= allowed


TWO: dict[str, Any] = {"A": [[2, 1]], "B": []}


THREE = {**TWO, "C": []}
TO_B = [[-1, 1], [0, 0]]
#: B and C in turn, for ever.
BETWEEN = [[-2, 1, 1], [0, -1, 1], [0, 1, -1]]
NEVER_LEFT = [
    (TWO, TO_B, {}, REFUTED),  # agent 2 hears nobody in B, which is never left
    (TWO, [[-1, 1], ["1/1000", "-1/1000"]], {}, PROVED),  # B is left at last
    (TWO, [[0, 0], [1, -1]], {}, PROVED),  # it ends in A
    (TWO, TO_B, {"gains": {1: 1, 2: 1}}, PROVED),  # all are held in B
    (TWO, TO_B, {"region": side(0)}, None),  # nobody starts away from the target
    (THREE, BETWEEN, {}, REFUTED),
    ({**TWO, "C": [[2, 1]]}, BETWEEN, {}, PROVED),  # C helps
]


@pytest.mark.parametrize(("modes", "generator", "more", "verdict"), NEVER_LEFT)
def test_modes_that_are_never_left_and_hold_agents_apart_refute_consensus(
    modes, generator, more, verdict
):
    """Theory, section 6; simulated: a start next to the target in the mode that stays keeps its
    error."""
    own = problem(modes, n=2, generator=generator, **more)
    found = certify(own)
    if verdict is None:
        assert found.verdict is not REFUTED
    else:
        assert found.verdict is verdict
    assert verify_twice(found.claims, own).holds
    if verdict is REFUTED:
        assert "which it never leaves, no pinned agent reaches agent 2" in found.reason
        last_mode = list(modes)[-1]
        start = [[0.0], [1e-6]]
        run = simulate(own, mode=last_mode, start=start, t_final=50)
        assert run.final_error == pytest.approx(1e-6)


def test_the_second_program_reads_the_generator_once(monkeypatch):
    """And not once for every mode whose Lemma 1 is refuted."""
    guarantee = second_loop(problem()).guarantee
    asked = []

    def counted(value: Any, shape: Any) -> Any:
        asked.append(shape)
        return read(value, shape)

    monkeypatch.setattr(checker_guarantee, "read", counted)
    for mode in guarantee.modes:
        for _ in range(3):
            assert not guarantee.may_stay(mode)
    assert len(asked) == 1
