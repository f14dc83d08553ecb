"""Signals that keep a guarantee: their phases, the claim, its decision, and what `certify`
finds."""

import json
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from certified import HALF_AS_FAST, coarse_tables, few_chords, few_coordinates, only, settling_alone
from checker_files.files import accepted_by, second_loop
from scipy.linalg import expm
from texts import matrix

from dobc_design import Network, Problem, Switching, Verdict, certify, simulate
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck, verify_twice
from dobc_design.checker import cycles as checker_cycles
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.schedule import propose_cycles
from dobc_design.conditions.schedule.claim import Cycles, Weights
from dobc_design.conditions.schedule.cycles import holds_starts, unreached_cycles, why_not
from dobc_design.conditions.schedule.rounds import growth_check
from dobc_design.conditions.schedule.rows import Box, moving_rows
from dobc_design.conditions.schedule.stage import schedule_stage
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.errors import SpecError
from dobc_design.exact import work
from dobc_design.exact.work import at_most
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.make import loop_of
from dobc_design.problem.dynamics import Dynamics


def phases_of(problem):
    return loop_of(problem).guarantee.phases


ZERO = Fraction(0)
HALF = Fraction(1, 2)
ONE = Fraction(1)
TWO = Fraction(2)
BARE = Cycles(phases=(), rate=None, rho=None)  # linear couplings, by the graphs alone
PAPER = "exp(y) - 1 + y"
MODES = {"A": [[3, 2]], "B": [[2, 1]], "C": []}
RING = [[i, i % 10 + 1] for i in range(1, 11)]
HALVES = {
    "odd": [arc for arc in RING if arc[0] % 2],
    "even": [arc for arc in RING if not arc[0] % 2],
}


def problem(
    modes: Any = MODES,
    *,
    coupling: str = "y",
    n: int = 3,
    gains: Any = None,
    region: Any = None,
    **turns: Any,
) -> Problem:
    network = Network.from_arcs(modes, arrow="listens_to", agents=n)
    gains = {1: 1} if gains is None else gains
    return Problem(
        network=network, coupling=coupling, gains=gains, region=region, switching=Switching(**turns)
    )


def chain(**turns: Any) -> Problem:
    modes = {"A": [[3, 2]], "B": [[2, 1]]}
    return problem(modes, **turns)


def in_turn(sequence: str = "", dwell: Any = 1, **more: Any) -> Problem:
    """Modes in a sequence; all in their order where none are named."""
    if sequence:
        more["sequence"] = list(sequence)
    return problem(guarantee="sequence", dwell=dwell, **more)


def ring(gains: Any, dwell: Any = 1, **more: Any) -> Problem:
    turns = Switching(guarantee="sequence", sequence=["odd", "even"], dwell=dwell)
    network = Network.from_arcs(HALVES, arrow="listens_to", agents=10)
    return Problem(network=network, coupling=PAPER, gains=gains, switching=turns, **more)


def growth_over_a_round(systems: Any, dwell: float) -> float:
    """The spectral radius of the map of a round, by SciPy: each system is on for the dwell time."""
    whole = np.eye(len(systems[0]))
    for M in systems:
        whole = expm(dwell * np.array(M)) @ whole
    sizes = np.abs(np.linalg.eigvals(whole))
    return float(sizes.max())


def accepted(result: Any) -> tuple[bool, bool]:
    """Whether both programs accept the certificate."""
    return accepted_by(json.loads(certificate_bytes(result.claims)), result.problem)


LASTING = problem(guarantee="dwell", dwell=1)


def schedule_of(found: Any) -> Any:
    (check,) = [each for each in found.claims.checks if each.id == "schedule"]
    return check


def lengths(own: Problem) -> list[tuple[str, Fraction, Fraction | None, tuple[int, ...], bool]]:
    phases = []
    for each in phases_of(own):
        phase = (each.mode, each.shortest, each.longest, each.successors, each.first)
        phases.append(phase)
    return phases


def test_after_a_dwell_any_other_mode_may_follow():
    in_b = ("B", ONE, None, (0, 2), True)
    in_c = ("C", ONE, None, (0, 1), True)
    assert lengths(LASTING) == [("A", ONE, None, (1, 2), True), in_b, in_c]
    brief = problem(guarantee="dwell", dwell=1, longest=2)
    assert {each.longest for each in phases_of(brief)} == {TWO}


@pytest.mark.parametrize(
    ("turns", "expected"),
    [
        ({"sequence": ["A", "B"], "dwell": 2}, [("A", TWO), ("B", TWO)]),
        ({"dwell": 2}, [("A", TWO), ("B", TWO), ("C", TWO)]),
        (
            {"sequence": ["A", "B", "A"], "dwell": [1, 2, "1/2"]},
            [("A", ONE), ("B", TWO), ("A", HALF)],
        ),
        ({"sequence": ["A", "B"], "period": 1}, [("A", HALF), ("B", HALF)]),
        ({"schedule": [[0, "B"], ["1/2", "A"]], "period": "5/2"}, [("B", HALF), ("A", TWO)]),
        ({"sequence": ["C"], "dwell": 1}, [("C", ONE)]),
    ],
)
def test_a_sequence_has_one_phase_after_the_other(turns, expected):
    count = len(expected)
    found = lengths(problem(guarantee="sequence", **turns))
    wanted = []
    for k, (mode, time) in enumerate(expected):
        wanted.append((mode, time, time, ((k + 1) % count,), k == 0))
    assert found == wanted


def test_there_are_no_phases_without_a_guarantee_or_with_one_mode():
    assert phases_of(problem(signal="random", dwell=1)) == ()
    assert phases_of(problem(guarantee="arbitrary", dwell=1)) == ()
    one_mode = problem({"A": [[2, 1]]}, guarantee="dwell", dwell=1)
    assert phases_of(one_mode) == ()
    any_mode = loop_of(problem(signal="random", dwell=1))
    assert why_not(any_mode, None, BARE) is not None


def test_asking_for_phases_does_not_hash_the_generator_of_a_chain(monkeypatch):
    """It has as many entries as pairs of modes, and every refuted check of a mode asks."""
    rates = [[-1, 1, 0], [0, -1, 1], [1, 0, -1]]
    own = problem(guarantee="markov", generator=rates)

    def hashed(_: Any) -> int:
        raise AssertionError

    monkeypatch.setattr(Switching, "__hash__", hashed)
    assert phases_of(own) == ()


@pytest.mark.filterwarnings("error")
def test_a_round_that_leaves_the_floats_is_undecided():
    modes = {"A": [[2, 1]], "B": [[3, 2]]}
    repelling = in_turn("AB", 10_000, modes=modes, coupling="-y")
    assert schedule_of(certify(repelling)).verdict is Verdict.UNDECIDED


def test_a_sequence_that_repeats_a_shorter_one_has_its_phases():
    """Also in the second program; other lengths make another sequence."""
    by_the_number = (50, 1, 1)
    pairs = [1, 2, 1, 2]
    in_turns = (2, pairs, [1, 2])
    for times, dwell, once in (by_the_number, in_turns):
        own = in_turn("AB" * times, dwell)
        shorter = in_turn("AB", once)
        assert lengths(own) == lengths(shorter)
        found = second_loop(own).guarantee.phases
        again = [(each.mode, each.shortest) for each in found]
        assert again == [(each.mode, each.shortest) for each in phases_of(own)]
    turns = in_turn("ABAB", [1, 2, 1, 1])
    assert len(phases_of(turns)) == 4
    assert len(phases_of(in_turn("ABA"))) == 3


@pytest.mark.slow
def test_the_work_of_a_sequence_grows_like_its_phases():
    """30 and 100 phases, none of which repeats: at most 3.6 times the steps."""

    def steps(count: int) -> int:
        turns = "AA"
        for k in range(count // 2 - 1):
            turns += "BA" if k % 3 else "BB"
        modes = {"A": [[2, 1]], "B": [[3, 2]]}
        own = in_turn(turns, "1/10", modes=modes)
        assert len(phases_of(own)) == count
        with at_most(10**9):
            claim = propose_cycles.propose(loop_of(own), None, rho=None, error=None)
            account = work._ACCOUNT.get()
        assert claim.rate > 0
        assert account is not None
        return account.granted - account.left

    assert steps(100) <= 3.6 * steps(30)


def test_a_guarantee_in_words():
    words = {
        "every signal whose modes last at least 0.5 s": problem(guarantee="dwell", dwell="1/2"),
        "every signal whose modes last at least 1 s and at most 2 s": problem(
            guarantee="dwell", dwell=1, longest=2
        ),
        "every signal whose modes last exactly 1 s": problem(guarantee="dwell", dwell=1, longest=1),
        "the signal A for 1 s, B for 2 s, over and over": in_turn("AB", [1, 2]),
        "the signal A for 1 s, A for 1 s, B for 1 s, A for 1 s, B for 1 s, A for 1 s, ..., "
        "over and over": in_turn("AABABABAB"),
    }
    for expected, own in words.items():
        assert loop_of(own).guarantee.in_words() == expected


@pytest.mark.parametrize(
    ("own", "missed"),
    [
        (chain(guarantee="dwell", dwell=1, longest=2), []),
        (chain(guarantee="dwell", dwell=1), [(("A",), ("2", "3")), (("B",), ("3",))]),
        (
            problem(guarantee="dwell", dwell=1, longest=2),
            [(("A", "C"), ("2", "3")), (("B", "C"), ("3",))],
        ),
        (in_turn(), []),
        (in_turn("ABA"), []),
        (in_turn("AC"), [(("A", "C"), ("2", "3"))]),
        (chain(guarantee="sequence", sequence=["B"], dwell=1), [(("B",), ("3",))]),
        (chain(guarantee="sequence", dwell=1, gains={3: 1}), [(("A", "B"), ("1", "2"))]),
    ],
)
@few_chords()
def test_cycles_that_do_not_reach_every_agent(own: Problem, missed):
    loop = loop_of(own)
    assert list(unreached_cycles(loop)) == missed
    assert (why_not(loop, None, BARE) is None) == (not missed)
    certificate = certify(own)
    assert certificate.verdict is (Verdict.REFUTED if missed else Verdict.PROVED)
    assert recheck(certificate.claims, own).holds
    if missed and own.pinning.agents:
        _, agents = missed[0]
        reason = certificate.reason
        assert name_agents(agents) in reason
        by_guarantee = "as the guarantee allows" in reason
        assert by_guarantee == ("in any mode" not in reason)


def test_claims_that_cannot_be_are_refused():
    box = ((ONE,), (ONE,))
    one = Weights(times=(ZERO, ONE), v=box)
    good = Cycles(phases=(one,), rate=ONE, rho=ONE)
    for changes in [{"rate": None}, {"phases": ()}, {"rate": ZERO}, {"rho": ZERO}]:
        with pytest.raises(SpecError):
            replace(good, **changes)
    nothing = {"times": (), "v": ()}
    one_vertex = {"times": (ONE,), "v": ((ONE,),)}
    touching = {"v": ((ONE,), (ZERO,))}
    still = {"times": (ZERO, ZERO)}
    one_weight = {"v": one.v[:1]}
    not_weights = [nothing, one_vertex, still, one_weight, touching]
    for each in not_weights:
        weights = replace(one, **each)
        with pytest.raises(SpecError):
            Cycles(phases=(weights,), rate=ONE, rho=None)
    assert BARE.least == 1


def test_three_agents_that_are_never_connected():
    own = chain(guarantee="sequence", sequence=["A", "B"], dwell=1)
    with few_chords(propose_cycles.TRIED_CURVED):
        result = certify(own)
    check = schedule_of(result)
    assert check.verdict is Verdict.PROVED
    assert 0.45 <= float(check.rate) <= 0.5
    assert "for the signal A for 1 s, B for 1 s" in check.reason
    assert result.claims.verdict is Verdict.PROVED
    assert result.claims.covered_by == "schedule"
    assert accepted(result) == (True, True)


def test_half_a_ring_at_a_time_holds_by_the_graphs():
    gains = {1: 5, 6: 5}
    region = {"initial_states": [-4, 4]}
    own = ring(gains, region=region)
    loop = loop_of(own)
    claim = Cycles(phases=(), rate=None, rho=Fraction(4))
    assert why_not(loop, None, claim) is None
    assert holds_starts(loop, claim, radius=Fraction(4), disturbance=ZERO)
    assert not holds_starts(loop, claim, radius=Fraction("4.001"), disturbance=ZERO)
    assert why_not(loop, None, BARE) is not None
    without_pins = loop_of(ring({}))
    assert "no pin reaches agents 1, 2" in str(why_not(without_pins, None, claim))


@pytest.mark.slow
def test_half_a_ring_at_a_time_has_a_rate_from_far_out():
    """Where exp is steep it is far below that near the target; by the graphs alone there would be
    none."""
    gains = {1: 5, 6: 5}
    region = {"initial_states": [-4, 4]}
    result = certify(ring(gains, region=region))
    check = schedule_of(result)
    assert check.verdict is Verdict.PROVED, check.reason
    assert 0.05 < check.rate < 0.4818
    document = json.loads(certificate_bytes(result.claims))
    assert recheck(certificate_bytes(result.claims), result.problem).holds
    (bent,) = [each for each in document["checks"] if each["id"] == "schedule"]
    bent["exact"]["rho"] = "3.999"
    assert accepted_by(document, result.problem) == (False, False)


@coarse_tables()
def test_without_pins_nothing_is_proved():
    unpinned = ring({}, region={"initial_states": [-4, 4]})
    check = schedule_of(certify(unpinned))
    assert check.verdict is Verdict.UNDECIDED
    assert "no pin reaches agents 1, 2" in check.reason


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("pins", "dwell", "rounds"), [((1, 6), ONE, 8), ((1, 6), HALF, 16), ((1,), ONE, 15)]
)
def test_half_a_ring_at_a_time_settles_nearly_as_soon_as_its_slowest_run(pins, dwell, rounds):
    """Known answers: from 4 to 0.04 after so many rounds.  Runs of rising couplings lie between
    those from corners."""
    own = ring(dict.fromkeys(pins, 5), dwell)
    settling = settling_alone(own, tolerance="1/25", radius=4)
    assert settling.verdict is Verdict.PROVED
    assert "for the signal odd" in settling.reason
    assert settling.time <= 2 * dwell * (rounds + 1)
    for sign in (-4, 4):
        start = [[sign]] * 10
        run = simulate(own, start=start, t_final=settling.time, samples=2000)
        sizes = np.abs(run.x[:, :, 0])
        largest = sizes.max(axis=1)
        bound = settling.envelope(run.times)
        assert np.all(largest <= bound * (1 + 1e-6))
        outside = np.flatnonzero(largest > 0.04)
        assert run.times[outside[-1]] <= settling.time


@few_chords()
@only(schedule_stage)
def test_weights_that_move_take_over_from_a_box_and_both_programs_accept_it():
    """Agent 2 hears the pinned one in every other second; twin: a hundredth of the time sooner."""
    region = {"initial_states": [-1, 1]}
    modes = {"A": [[2, 1]], "B": []}
    own = in_turn(modes=modes, n=2, region=region)
    result = certify(own, settling="1/10")
    settling = result.settling
    assert settling.claim.kind == "schedule"
    assert "for the signal A for 1 s, B for 1 s" in settling.reason
    document = json.loads(certificate_bytes(result.claims))
    assert accepted_by(document, own) == (True, True)
    together = [[1], [1]]
    apart = [[1], [-1]]
    for start in (together, apart):
        run = simulate(own, start=start, t_final=settling.time)
        bound = settling.envelope(run.times)
        assert np.all(run.error() <= bound * (1 + 1e-6))
    (early,) = [each for each in document["checks"] if each["id"] == "settling"]
    time = Fraction(early["exact"]["time"])
    early["exact"]["time"] = str(time * Fraction(99, 100))
    assert accepted_by(document, own) == (False, False)


def test_starts_are_those_of_phases_that_may_be_first():
    times = (ZERO, ONE)
    ones = ((ONE,) * 3,) * 2
    flat = Weights(times=times, v=ones)
    halves = ((HALF,) * 3,) * 2
    high = Weights(times=times, v=halves)
    claim = Cycles(phases=(flat, high), rate=ONE, rho=ONE)
    one_first = loop_of(chain(guarantee="sequence", dwell=1))
    lasting = loop_of(chain(guarantee="dwell", dwell=1))
    assert holds_starts(one_first, claim, radius=ONE, disturbance=ZERO)
    assert not holds_starts(lasting, claim, radius=ONE, disturbance=ZERO)
    assert holds_starts(lasting, claim, radius=HALF, disturbance=ZERO)
    first = Phase(mode="A", shortest=ONE, longest=None, successors=(1,), first=True)
    assert first in lasting.guarantee.phases


@pytest.mark.slow
def test_an_unstable_mode_refutes_only_where_it_may_stay_on():
    """Agent 1 runs away from agent 2 in B, at 4: exp(0.4 - 2) over 2.1 s where B lasts 0.1 s."""
    arcs = {"A": [], "B": [[1, 2]]}
    gains = {1: 1, 2: 1}
    after_a_dwell = {"guarantee": "dwell", "dwell": 1}
    at_random = {"signal": "random", "dwell": 1}
    for turns in (after_a_dwell, at_random):
        unstable = problem(arcs, n=2, coupling="-5*y", gains=gains, **turns)
        assert certify(unstable).verdict is Verdict.REFUTED
    briefly_on_b = in_turn("AB", [2, "1/10"], modes=arcs, n=2, coupling="-5*y", gains=gains)
    brief = certify(briefly_on_b)
    assert brief.verdict is not Verdict.REFUTED
    assert recheck(brief.claims, brief.problem).holds


@few_chords()
@only(separable_stage, schedule_stage)
def test_what_holds_for_every_signal_carries_the_verdict_also_where_it_is_slower():
    arcs = {"A": [[2, 1], [3, 2]], "B": [[2, 1], [3, 1]]}
    found = certify(in_turn(modes=arcs), everything=True)
    proved = {each.id for each in found.claims.checks if each.verdict is Verdict.PROVED}
    assert proved >= {"max-separable", "schedule"}
    assert found.claims.covered_by not in ("schedule", None)
    assert "arbitrary switching" in found.reason
    assert recheck(found.claims, found.problem).holds


@pytest.mark.parametrize(
    ("coupling", "region", "tried", "least"),
    [
        ("y1", None, HALF_AS_FAST, 0.48),
        pytest.param("y1", None, propose_cycles.TRIED, 0.96, marks=pytest.mark.slow),
        pytest.param(
            "tanh(y1)",
            {"initial_states": ["-1/20", "1/20"]},
            propose_cycles.TRIED,
            0.1,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_double_integrators_that_are_never_connected(
    coupling: str, region: Any, tried: Any, least: float
):
    """p'' = h(p_j - p_i) - 3 p' (- p of the first): the rate is close to that of the exact flow
    over a round, or to half of it where few chords are asked for."""
    dynamics = Dynamics(A=matrix("0 1; 0 -3"), B=matrix("0; 1"))
    gains = {1: [[1, 0]]}
    turns = Switching(guarantee="sequence", sequence=["A", "B"], dwell=2)
    modes = {"A": [[3, 2]], "B": [[2, 1]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=3)
    plant = {"target": [0, 0], "gains": gains, "dynamics": dynamics}
    own = Problem(network=network, coupling=coupling, region=region, switching=turns, **plant)
    with few_chords(tried), few_coordinates(), only(schedule_stage):
        result = certify(own)
    check = schedule_of(result)
    assert result.verdict is check.verdict is Verdict.PROVED
    free_motion = [[0, 1], [0, -3]]
    alone = np.kron(np.eye(3), free_motion)
    felt = [[0, 0], [1, 0]]
    in_mode_a = [[1, 0, 0], [0, 0, 0], [0, -1, 1]]
    in_mode_b = [[1, 0, 0], [-1, 1, 0], [0, 0, 0]]
    laplacians = (in_mode_a, in_mode_b)
    motions = [alone - np.kron(L, felt) for L in laplacians]
    growth = np.log(growth_over_a_round(motions, 2))
    rate = -growth / 4
    assert least * rate <= float(check.rate) <= rate
    assert accepted(result) == (True, True)
    assert result.weights == ()
    moving_apart = {"x": [[0.05, -0.05]] * 3}
    run = simulate(own, start=moving_apart, t_final=12)
    errors = np.abs(run.x)
    largest = errors.max(axis=(1, 2))
    envelope = result.envelope(run)
    assert np.all(largest <= envelope(run.times) + 1e-12)


@pytest.mark.slow
def test_agents_whose_dynamics_couple_components_are_seen_in_coordinates():
    """p' = q + sum of (p_j - p_i), q' = -3 q + sum of (q_j - q_i): by component the pinned agent
    looks unreached."""
    modes = {"A": [], "B": [[2, 1]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=2)
    turns = Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)
    agents = Dynamics(A=matrix("0 1; 0 -3"))
    own = Problem(
        network=network, coupling="y", gains={1: 1}, target=[0, 0], switching=turns, dynamics=agents
    )
    result = certify(own)
    check = schedule_of(result)
    assert result.verdict is check.verdict is Verdict.PROVED
    free_motion = [[0, 1], [0, -3]]
    alone = np.kron(np.eye(2), free_motion)
    in_mode_a = [[1, 0], [0, 0]]
    in_mode_b = [[1, 0], [-1, 1]]
    laplacians = (in_mode_a, in_mode_b)
    systems = [alone - np.kron(L, np.eye(2)) for L in laplacians]
    rate = -np.log(growth_over_a_round(systems, 1)) / 2
    assert 0.9 * rate <= float(check.rate) <= rate
    said = next(each.reason for each in result.checks if each.id == "max-separable")
    assert "these agents are not held by a pin in every component and hear only each other" in said
    assert said.endswith(": 1 in A, 2 in A.")
    assert accepted(result) == (True, True)


def test_weights_settle_where_the_map_shrinks_and_end_where_it_grows_or_takes_too_long():
    """x >= max(1, G(x)) for G(x) = factor x + 1, whose fixed point is 1 / (1 - factor)."""

    alone = [Phase(mode="A", shortest=ONE, longest=ONE, successors=(0,), first=True)]

    def settled(factor, *, most=100.0, steps=100):
        start = [np.ones(2)]
        return propose_cycles._settled(
            alone, lambda p, x: factor * x + 1, start, most=most, steps=steps
        )

    (found,) = settled(0.5)
    assert found == pytest.approx([2, 2], rel=1e-2)
    next_one = found * (1 + propose_cycles.SETTLED)
    assert np.all(0.5 * found + 1 <= next_one)
    assert settled(0.5, most=1.5) is None  # too large
    assert settled(1.1) is None  # grows for ever
    assert settled(0.9, steps=2) is None  # not within so many steps
    ones = [np.ones(2)]
    stuck = propose_cycles._settled(alone, lambda p, x: None, ones, most=1.0, steps=1)
    assert stuck is None  # no way on


def switched_pair(k: Any, dwell: Any, **more: Any) -> Problem:
    """e_1' = (1 - k) e_1 - e_2 in A and the same for e_2 in B: two agents that repel each other in
    turn."""
    modes = {"A": [[1, 2]], "B": [[2, 1]]}
    gains = {1: k, 2: k}
    return in_turn("AB", dwell, modes=modes, coupling="-y", n=2, gains=gains, **more)


@pytest.mark.parametrize("dwell", ["1/10", 1, 3])
def test_errors_that_grow_from_round_to_round_refute_consensus_and_others_do_not(dwell):
    """Oracle: the eigenvalues of the product of SciPy's exponentials."""
    for k in ("1/2", "19/20", "1", "21/20", "3/2"):
        gain = float(Fraction(k))
        in_a = [[1 - gain, -1], [0, -gain]]
        in_b = [[-gain, 0], [-1, 1 - gain]]
        radius = growth_over_a_round([in_a, in_b], float(Fraction(dwell)))
        found = growth_check(loop_of(switched_pair(k, dwell)), EVERYWHERE)
        if radius < 1 + 1e-9:
            assert found is None
        elif radius > 1.1:
            assert f"about {radius:.4g} in every round" in found.reason


def test_a_sequence_whose_round_expands_is_refuted_in_seconds_by_both_programs():
    own = switched_pair("1/2", 3)
    found = certify(own)
    assert found.verdict is Verdict.REFUTED
    assert found.reason.startswith(
        "Consensus fails: errors grow by a factor of about 20.09 in every round of the signal A"
    )
    assert verify_twice(found.claims, own).holds
    region = {"initial_states": [0, 0]}
    at_the_target = switched_pair("1/2", 3, region=region)
    assert certify(at_the_target).verdict is not Verdict.REFUTED


def test_the_second_program_encloses_an_exponential():
    """Its bound of what the rows miss holds what SciPy gives, and is far below it."""
    first = [Fraction(1, 3), Fraction(-2)]
    second = [Fraction(5, 2), Fraction(-7, 4)]
    X = [first, second]
    rows, missed = checker_cycles.exponential(X)
    unit = 2**checker_cycles.BITS
    found = np.array(rows, dtype=object) / unit
    wanted = expm(np.array(X, dtype=float))
    assert found.astype(float) == pytest.approx(wanted, rel=1e-12)
    assert Fraction(missed, unit) < Fraction(1, 10**60)


def test_a_false_claim_is_not_halved_all_along():
    """A row that fails everywhere on 1000 segments: without a bound 2^11 parts of each are looked
    at."""
    modes = {"A": [[2, 1]], "B": [[3, 2]]}
    own = in_turn("AB", modes=modes)
    rows = moving_rows(loop_of(own), ONE, ["A"])
    # all weights fall, agent 2 is held by 1
    v = []
    for k in range(1001):
        v.append((Fraction(2000 - k, 2000),) * 3)
    times = [Fraction(k, 1000) for k in range(1001)]
    with at_most(10**6):
        box = Box.of(v, v)
        open_ones = rows.open_segments(box, times, np.zeros(1001))
        account = work._ACCOUNT.get()
    assert open_ones == list(range(1000))
    assert account.granted - account.left < 30_000
