"""Numbers and sentences of the report."""

from fractions import Fraction

import pytest
from certified import few_chords
from hypothesis import given
from hypothesis import strategies as st
from networks import linked

from dobc_design import Exosystem, Group, Network, Problem, Switching, certify
from dobc_design._show.text import significant_towards_zero
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Ball, Box, domain_from_json
from dobc_design.report import words
from dobc_design.report.words import (
    agents_table,
    domain_words,
    mode_sentences,
    number,
    pin_sentence,
)
from dobc_design.report.write import render_report


@given(st.floats(min_value=1e-300, max_value=1e300))
def test_a_number_cut_towards_zero_is_never_larger_and_loses_less_than_a_thousandth(value: float):
    shown = Fraction(significant_towards_zero(value))
    lower = Fraction(repr(value))
    assert lower * Fraction(999, 1000) <= shown <= lower
    assert significant_towards_zero(-value) == "-" + significant_towards_zero(value)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.58229999, "0.5822"),
        (None, "–"),
        (0.0, "0"),
        (Fraction(2, 3), "0.6666"),
        (1.99999e-9, "1.999e-09"),
        (5, "5"),
    ],
)
def test_cut_numbers(value: float | Fraction | None, text: str):
    assert significant_towards_zero(value) == text


@pytest.mark.parametrize(
    ("reason", "shown"),
    [
        (
            "Lambda(J) < 0, lambda_max <= -0.58: V = e'e falls",
            "Λ(J) < 0, λmax ≤ −0.58: V = e′e falls",
        ),
        ("it is v'(Lambda + I (x) S)v >= 0: Psi is not", "It is v′(Λ + I ⊗ S)v ≥ 0: Ψ is not"),
        (
            "from |e_i| <= 4 and |eps_i|_P: exp(-0.2 t), A - WC",
            "From |eᵢ| ≤ 4 and |εᵢ|ₚ: exp(−0.2 t), A − WC",
        ),
        (
            "agent Lambda's label, agent-3 and 1e-05 stay",
            "Agent Lambda's label, agent-3 and 1e-05 stay",
        ),
    ],
)
def test_a_reason_is_shown_in_letters_and_signs_of_mathematics(reason: str, shown: str):
    assert words.sentence(reason) == shown


def test_sums_have_the_sign_that_the_traceability_has():
    """kinds.toml, which the report shows beside the reasons, writes V = Σ eᵢ′eᵢ + Σ εᵢ′Pεᵢ."""
    assert words.sentence("V = e'De + sum eps_i' P eps_i falls") == "V = e′De + Σ εᵢ′ P εᵢ falls"
    assert words.sentence("it is the sum of all") == "It is the sum of all"


def test_numbers_are_written_as_people_write_them():
    assert words.typeset("-1.5e-08") == "−1.5·10⁻⁸"
    assert number(-0.0) == "0"
    assert number(None) == "–"
    assert number(1234567.0) == "1.235·10⁶"


def test_domains_in_words():
    assert domain_words(EVERYWHERE, "m") == "every start"
    assert domain_words(NEAR_TARGET, "") == "near the target"
    assert domain_words(Ball(1.5, 0), "m") == "starts with |e|₂ ≤ 1.5 m and every |εᵢ| ≤ 0"
    assert domain_words(Box(1.5, 0.25), "") == "starts with |e|∞ ≤ 1.5 and every |εᵢ| ≤ 0.25"
    assert domain_words(domain_from_json({"kind": "box"}), "m") == '{"kind": "box"}'
    assert domain_words(domain_from_json("<i>"), "") == "<i>"


def test_what_is_not_said_names_the_disturbances_that_the_problem_has(problem_with, certificate_of):
    exosystem = Exosystem(A=[[0]], C=[[1]])
    groups = [Group(agents=[1, 2], exosystem=exosystem)]
    one_system = (problem_with(), "one (A, C) for all agents")
    by_groups = (problem_with(groups=groups, observer=None), "one (A, C) for each group of agents")
    undisturbed = (problem_with(exosystem=None, observer=None), "single integrators, messages")
    for problem, said in (
        one_system,
        by_groups,
        undisturbed,
    ):
        assert said in words.what_it_means(certificate_of(problem)).says_not[-1]


def test_a_ring_is_said_in_words(problem_with):
    problem = problem_with()
    assert mode_sentences(problem) == [
        "Ga: 10 arcs; every agent i listens to i + 1, counted around a circle of 10."
    ]
    named = linked([["a", "b"], ["b", "c"], ["c", "d"], ["d", "a"]])
    (around,) = mode_sentences(named)
    assert around.endswith(": 4 arcs; a listens to b, and so on around the circle of agents.")
    assert pin_sentence(problem) == "2 of 10 agents are pinned: 1 and 6."
    assert agents_table(problem).rows[0] == ("1", "5", "1", "2")


def test_weights_and_undirected_arcs_are_said_in_words(problem_with):
    arcs = [(1, 2, "1/3"), (2, 1), (3, 1), (1, 3)]
    network = Network.from_arcs(arcs, arrow="sends_to", agents=4)
    problem = problem_with(network=network, gains=None)
    assert mode_sentences(problem)[0].startswith(
        "G: 4 arcs, with weights; whoever listens is also listened to"
    )
    assert agents_table(problem).rows[1][3:] == ("1 (1/3×)",)
    assert agents_table(problem).rows[3][3:] == ("–",)
    assert pin_sentence(problem) == "No agent is pinned."


@few_chords()
def test_a_proof_under_a_guarantee_says_for_which_signals_it_holds(drawn_only):
    """Two agents, the second hears the first every other second: nothing is said about arbitrary
    switching."""
    arcs = {"A": [[2, 1]], "B": []}
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    turns = Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)
    problem = Problem(network=network, coupling="y", gains={1: 1}, switching=turns)
    certificate = certify(problem)
    assert certificate.covered_by == "schedule"
    assert "for the signal A for 1 s, B for 1 s, over and over" in certificate.reason
    drawn_only("network-2", "spectrum-loop")  # a mode without arcs, and real eigenvalues
    text = render_report(certificate)["report.md"].decode()
    assert "It holds for the signal A for 1 s, B for 1 s, over and over." in text
    assert "arbitrarily fast" not in text
    assert "may switch in any way" not in text


def test_between_fixed_nodes_of_which_one_moves_the_table_says_which_reach_each_agent():
    """Where an agent ends, as a mean of these, is known only if all rest."""
    arcs = [[1, "a"], [2, 1], [2, "b"], [3, "b"]]
    network = Network.from_arcs(arcs, arrow="listens_to", fixed=["a", "b"])
    given = {"network": network, "coupling": "y", "goal": "containment"}
    moves = Problem(**given, fixed={"a": 0, "b": {"between": [3, 4]}})
    table = agents_table(moves)
    assert table.columns[1].head == "reached from"
    assert [row[1] for row in table.rows] == ["a", "a, b", "b"]
    rests = Problem(**given, fixed={"a": 0, "b": 4})
    assert agents_table(rests).columns[1].head == "ends at"
