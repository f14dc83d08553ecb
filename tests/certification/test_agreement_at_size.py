"""Agreement of many agents, and under signals: what graphs alone decide, and what pairs add.

The oracles are the graphs that the tests make: a root by construction, or two closed sets.
"""

import math
import random
from dataclasses import replace

import pytest
from certified import few_chords

from dobc_design import Exosystem, Network, Problem, Switching, Verdict, certify, verify
from dobc_design.certification.recheck import _work_of, verify_twice
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import MOST_AGENTS, rows_of
from dobc_design.problem.canonical import problem_sha256

RISING = "exp(y) - 1 + y"
REGION = {"initial_states": [-1, 1]}
MANY = MOST_AGENTS + 20


def agreeing(modes, *, agents, **more):
    network = Network.from_arcs(modes, agents=agents, arrow="listens_to")
    return Problem(network=network, goal="agreement", **more)


def rooted(agents, seed=1):
    """A random tree that hears agent 1, which hears agent 2: both are roots."""
    choose = random.Random(seed)
    arcs = [[1, 2], [2, 1]]
    return {"G": arcs + [[i, choose.randrange(1, i)] for i in range(3, agents + 1)]}


def parted(agents):
    """Agents 1 and 2 hear each other, so do agents 3 and 4; all others hear one before them."""
    arcs = [[1, 2], [2, 1], [3, 4], [4, 3]]
    return {"G": arcs + [[i, i - 1] for i in range(5, agents + 1)]}


def check_of(certificate, id):
    return next(check for check in certificate.checks if check.id == id)


@pytest.mark.parametrize(
    ("coupling", "more"),
    [
        ("y", {}),
        pytest.param(RISING, {}, marks=pytest.mark.slow),
        (RISING, {"region": REGION}),
        (RISING, {"exosystem": Exosystem(A=[[0]], C=[[1]])}),
    ],
)
def test_many_agents_agree_where_couplings_rise_and_somebody_is_heard_by_all(coupling, more):
    """Theory, section 16: by the graph alone, where there are too many pairs for rows."""
    problem = agreeing(rooted(MANY), agents=MANY, coupling=coupling, **more)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.covered_by == "schedule"
    found = verify(certificate, problem)
    assert found.holds
    assert found.lone_checker == "it accepts every claim"


def test_many_agents_with_two_closed_sets_do_not_agree():
    problem = agreeing(parted(MANY), agents=MANY, coupling=RISING, region=REGION)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert verify(certificate, problem).holds


@pytest.mark.parametrize("coupling", ["y**3", pytest.param("sin(2*y)", marks=pytest.mark.slow)])
def test_couplings_that_do_not_rise_leave_the_question_open(coupling):
    """y^3 is flat at 0, sin(2 y) falls from pi/4 on."""
    problem = agreeing(rooted(MANY), agents=MANY, coupling=coupling, region=REGION)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.UNDECIDED
    assert "a coupling is not shown to rise" in check_of(certificate, "schedule").reason


@pytest.mark.parametrize(
    ("modes", "coupling"),
    [(parted(MANY), RISING), pytest.param(rooted(MANY), "sin(2*y)", marks=pytest.mark.slow)],
)
def test_both_programs_refuse_a_proof_by_the_graph_of_another_problem(modes, coupling):
    """The claim of a network with a root, carried to one without, and to couplings that fall."""
    honest = certify(agreeing(rooted(MANY), agents=MANY, coupling=RISING, region=REGION))
    problem = agreeing(modes, agents=MANY, coupling=coupling, region=REGION)
    own = certify(problem).claims
    forged = tuple(check for check in own.checks if check.id != "schedule")
    claims = replace(
        own,
        problem_sha256=problem_sha256(problem),
        verdict=Verdict.PROVED,
        rate=None,
        factor=None,
        covered_by="schedule",
        checks=(*forged, check_of(honest, "schedule")),
    )
    found = verify_twice(claims, problem)
    assert not found.holds
    assert found.lone_checker.startswith("it refuses the certificate")
    assert any("schedule" in failure for failure in found.failures)


@pytest.mark.slow
def test_pairs_of_a_long_cycle_have_a_rate_close_to_the_known_one():
    """2 (1 - cos(pi/n)) of the directed n-cycle (theory, section 16), beyond 60 agents."""
    n = 64
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    certificate = certify(agreeing({"G": arcs}, agents=n, coupling="y"))
    known = 2 * (1 - math.cos(math.pi / n))
    assert certificate.covered_by == "max-separable"
    assert 0.75 * known < certificate.rate <= known


@pytest.mark.slow
def test_curved_couplings_without_a_region_have_a_box_of_differences_beyond_sixty_agents():
    problem = agreeing(rooted(70), agents=70, coupling=RISING)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert certificate.rate > 0


SWITCHING = {"guarantee": "sequence", "dwell": 1}


def in_turn(modes, *, agents, **more):
    return agreeing(modes, agents=agents, switching=Switching(**SWITCHING), **more)


@few_chords()
def test_two_graphs_in_turn_whose_union_has_a_root_lead_to_agreement():
    """Neither graph has a root: 2 hears 1; 3 hears 2 and 1 hears 3 (Moreau 2005)."""
    problem = in_turn({"A": [[2, 1]], "B": [[3, 2], [1, 3]]}, agents=3, coupling="y")
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, problem).holds


def test_two_graphs_in_turn_whose_union_has_no_root_do_not():
    problem = in_turn({"A": [[2, 1]], "B": [[4, 3], [1, 2]]}, agents=4, coupling=RISING)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert verify(certificate, problem).holds


def test_a_complete_graph_that_is_on_half_of_the_time_has_half_of_its_rate():
    """K3 alone has the rate 3, every second second 3/2."""
    arcs = [[i, j] for i in (1, 2, 3) for j in (1, 2, 3) if i != j]
    problem = in_turn({"A": arcs, "B": []}, agents=3, coupling="y")
    certificate = certify(problem)
    assert certificate.covered_by == "schedule"
    assert 0.9 * 1.5 < certificate.rate <= 1.5


@pytest.mark.slow
def test_many_agents_agree_under_graphs_in_turn():
    """Arcs of a tree with even and with odd listeners, in turn: neither graph has a root."""
    (arcs,) = rooted(MANY).values()
    modes = {"even": [a for a in arcs if a[0] % 2 == 0], "odd": [a for a in arcs if a[0] % 2]}
    problem = in_turn(modes, agents=MANY, coupling=RISING, region=REGION)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, problem).holds


def drawn(generator, modes, *, agents, **more):
    """The modes drawn by a Markov chain."""
    signal = Switching(guarantee="markov", signal="markov", generator=generator)
    return agreeing(modes, agents=agents, switching=signal, **more)


LEAVES_BOTH, STAYS_IN_B = [[-1, 1], [1, -1]], [[-1, 1], [0, 0]]
APART = {"A": [[2, 1]], "B": [[3, 2], [1, 3]]}


@pytest.mark.parametrize("coupling", ["y", RISING])
def test_graphs_drawn_again_and_again_lead_to_agreement_if_their_union_has_a_root(coupling):
    """Neither graph has a root; the chain visits both for ever (theory, section 11)."""
    more = {} if coupling == "y" else {"region": REGION}
    problem = drawn(LEAVES_BOTH, APART, agents=3, coupling=coupling, **more)
    certificate = certify(problem)
    assert certificate.covered_by == "markov"
    assert verify(certificate, problem).holds


def test_a_chain_that_stays_in_a_graph_without_a_root_is_refuted():
    """Nobody else is heard by agents 1 and 2 in mode B, which the chain never leaves."""
    modes = {"A": [[2, 1], [1, 3]], "B": [[3, 2]]}
    problem = drawn(STAYS_IN_B, modes, agents=3, coupling="y")
    certificate = certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert verify(certificate, problem).holds


def test_many_agents_agree_under_graphs_that_are_drawn():
    (arcs,) = rooted(MANY).values()
    modes = {"even": [a for a in arcs if a[0] % 2 == 0], "odd": [a for a in arcs if a[0] % 2]}
    problem = drawn(LEAVES_BOTH, modes, agents=MANY, coupling=RISING, region=REGION)
    certificate = certify(problem)
    assert certificate.covered_by == "markov"
    assert verify(certificate, problem).holds


def test_the_work_of_the_second_program_is_counted_in_pairs():
    """Each arc is one of n - 1 pairs twice: once for either side."""
    n = 12
    arcs = [[i, i % n + 1] for i in range(1, n + 1)]
    loop = loop_of(agreeing({"G": arcs}, agents=n, coupling=RISING, region=REGION))
    assert _work_of(loop) == (2 * n * (n - 1), n * (n - 1))
    rows = rows_of(loop, None)
    assert rows is not None
    assert rows.n == n * (n - 1)


def test_couplings_that_mix_components_have_weights_in_coordinates():
    problem = agreeing({"G": [[1, 2], [2, 1]]}, agents=2, coupling=["2*y1 - y2", "y2"])
    certificate = certify(problem, everything=True)
    assert "T" in (check_of(certificate, "max-separable").exact or {})
    assert verify(certificate, problem).holds
