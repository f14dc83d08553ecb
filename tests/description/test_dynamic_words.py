"""What is said of agents with [dynamics]: by `dobc check`, in the card and in the report."""

import re
from typing import Any

import pytest
from agents import double_integrators, pendulums, three_states
from certified import certified, consensus_claims
from networks import network_of

import dobc_design as dd
from dobc_design.description.meaning import remarks, time_words
from dobc_design.description.words import describe, facts
from dobc_design.report import pages
from dobc_design.report.content import report_document
from dobc_design.report.findings import Findings
from dobc_design.report.pages import html_page, markdown_page
from dobc_design.report.write import render_report


def test_check_tells_the_equation_the_inputs_and_the_row_gains():
    """x' = A x + B (couplings + u + d); no u0 where it is 0; k = [2 4] stands for 2 times y1 + 2
    y2."""
    text = describe(double_integrators())
    linear = "Agents: x' = A x + B (couplings + u + d), 1 input each, A = [0 1; 0 0], B = [0; 1]."
    assert linear in text
    assert "Pinned: a (k = [2 4]), b (k = [1 2])." in text
    assert "u0" not in text
    text = describe(pendulums())
    assert "x' = f(x) + B (couplings + u + d), 1 input each, f = (x2, -x1**3 - x2/2)" in text
    assert "Inputs u0 that hold the goals: 1." in text
    assert facts(double_integrators())["inputs"] == 1
    assert "inputs" not in facts(dd.load_problem("paper-fixed"))


def test_inputs_that_hold_the_goals_are_named_by_agent():
    """A goal + B u0 = 0: at (1, 0, 2) for a and b, at (2, 0, 3) for c."""
    held = "Inputs u0 that hold the goals: (0.625, 2.375) for c, (0.25, 1.75) for a."
    assert held in describe(three_states())


def test_agents_that_no_pin_reaches_are_not_said_to_drift():
    """A Hurwitz A holds them: no remark; with A = 0 there is one."""
    alone = network_of([["a", "b"]])
    held = dd.Problem(network=alone, coupling="y", dynamics={"A": [[-1]]})
    words = "NOT REACHED from a pinned agent: a, b (nothing but their own dynamics holds them)."
    assert words in describe(held)
    assert not any("pinned" in remark for remark in remarks(held))
    free = dd.Problem(network=alone, coupling="y", dynamics={"A": [[0]]})
    assert any("No agent is pinned" in remark for remark in remarks(free))


def test_couplings_are_not_judged_without_b():
    """h = -y with B = -1 attracts; h = 2 y2 with p = 1 does not vanish to first order."""
    pair = network_of([["a", "b"]])
    turning = dd.Dynamics(A=[[0]], B=[[-1]])
    turned = dd.Problem(network=pair, coupling="-y", dynamics=turning, gains={"b": [[-1]]})
    spring = dd.Dynamics(A=[[0, 1], [-1, 0]], B=[[0], [1]])
    damping = {"b": [[0, 1]]}
    damped = dd.Problem(network=pair, coupling="2*y2", dynamics=spring, gains=damping)
    for problem in (turned, damped):
        assert "coupling" not in "\n".join(remarks(problem))


def test_silent_inputs_and_time_scales_are_those_of_the_plant():
    """A zero row of C is an input without disturbance; the time scale of x' = -4 x is 0.25 s."""
    alone = network_of([], ["a"])
    plant = {"A": [[-4, 0], [0, -4]]}
    exosystem = dd.Exosystem(A=[[0]], C=[[1], [0]])
    given: dict[str, Any] = {"dynamics": plant, "exosystem": exosystem, "target": [0, 0]}
    problem = dd.Problem(network=alone, coupling=["y1", "y2"], **given)
    assert "acts on input 2" in "\n".join(remarks(problem))
    assert "0.25 s (network)" in time_words(problem)


@pytest.mark.parametrize("problem", [double_integrators(), pendulums()], ids=["carts", "pendulums"])
def test_report_shows_the_plant_and_says_nothing_of_integrators_alone(problem):
    """Typeset: x_i' = A_x x_i + B (...), u0, the matrices, f; no advice that is refused for such
    problems."""
    document = report_document(Findings(certificate=certified(problem)))
    page, text = html_page(document), markdown_page(document)
    moves = "A_x x_i" if problem.dynamics.f is None else "f(x_i)"
    assert rf"\dot x_i = {moves} + B" in text
    assert r"u_i = -K_i e_i - \hat{d}_i + u^0_i" in text
    for advice in ("single integrators", "dobc design", "dobc export"):
        assert advice not in text
    assert "read B h for h" in text
    assert ("<mi>f</mi>" in page) is (problem.dynamics.f is not None)
    assert not re.search(r"\[[^]]*\] 1/s on", text)


def test_report_of_integrators_is_as_it_was():
    """No word of dynamics where there are none."""
    text = markdown_page(report_document(Findings(certificate=certified("clock-sync"))))
    assert "single integrators" in text
    assert "u^0_i" not in text
    assert "of their own" not in text


def test_every_equation_of_the_report_has_its_formula_for_the_pdf():
    """Names in report.typ: those of dynamics are made by a function, once for A and once for f."""
    from pathlib import Path

    from dobc_design.report import words

    template = (Path(words.__file__).parent / "templates" / "report.typ").read_text("utf-8")
    for name, latex, _ in words.TEXTS["loop"]["dynamic"]:
        assert f'"{name}" + ending' in template, latex
    for name, latex, _ in words.TEXTS["loop"]["dynamic disturbed"]:
        assert f'"{name}, disturbed"' in template, latex


def test_full_report_has_diagnostics_runs_and_the_slow_signal_of_a_guarantee(monkeypatch):
    """Eigenvalues and Lambda of the errors, one simulated run, and one under the slowest signal
    allowed."""
    arcs = {"ring": [["a", "b"], ["b", "c"], ["c", "a"]], "line": [["c", "b"], ["b", "a"]]}
    slow = dd.Switching(signal="periodic", dwell=2, guarantee="dwell")
    problem = double_integrators().replace(network=network_of(arcs), switching=slow)
    monkeypatch.setattr(pages, "html_page", lambda document, full: "")  # only the text is looked at
    files = render_report(dd.Certificate(problem=problem, claims=consensus_claims(problem)))
    text = files["report.md"].decode("utf-8")
    for part in ("J − K, mode ring", "A − WC", "One run of 6 s in mode ring, line"):
        assert part in text


def test_a_row_gain_with_one_entry_is_no_number():
    """k = [[10, 0]] is not 10, which stands for 10 times the coupling."""
    problem = double_integrators().replace(gains={"a": [[10, 0]]})
    assert "Pinned: a (k = [10 0])." in describe(problem)
    assert "(k = a matrix)" in str(problem._card().facts)
