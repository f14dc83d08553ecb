"""Agents that agree on a value that nobody prescribes: what is said of them, and cures."""

import re
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
from certified import rough_settling

from dobc_design import Problem, Verdict, certify, verify
from dobc_design.conditions.check import main_cure
from dobc_design.description.words import describe
from dobc_design.loop.make import loop_of
from dobc_design.loop.words import said_of
from dobc_design.problem.changes import changed_file, changed_problem, problem_text
from dobc_design.problem.load import read_problem_text

RING = """\
name = "ring"
goal = "agreement"
[network]
agents = 3
arrow = "listens_to"
[network.modes]
ring = [[1, 2], [2, 3], [3, 1]]
[coupling]
h = "tanh(y)"
[exosystem]
constant = true
[region]
initial_states = [-1, 1]
initial_disturbance = 0.1
"""
FORMATION = """\
[formation]
offsets = { 2 = 1, 3 = -1 }
"""
APART = """\
name = "apart"
goal = "agreement"
[network]
agents = 5
arrow = "sends_to"
[network.modes]  # who sends to whom
first = [[2, 1], [1, 2], [3, 4]]
second = [[1, 2], [2, 3]]
[coupling]
h = "2*y"
"""
FOLLOWED = RING.replace("[[1, 2], [2, 3], [3, 1]]", "[[1, 2], [3, 2]]")


@pytest.fixture(autouse=True)
def rough_search():
    """How soon agents settle is not asked here."""
    with rough_settling():
        yield


def read(text: str) -> Problem:
    return read_problem_text(text.encode(), folder=None)


def texts_of(problem: Problem) -> list[str]:
    """All that a certificate says."""
    certificate = certify(problem, everything=True)
    checks = [check.reason for check in certificate.checks if check.is_proved]
    return [certificate.reason, *certificate.claims.notes, *checks, describe(problem)]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(RING, marks=pytest.mark.slow),
        pytest.param(RING + FORMATION, marks=pytest.mark.slow),
        FOLLOWED,
    ],
    ids=["ring", "form", "led"],
)
def test_where_agents_agree_nothing_says_target_pin_or_goal_of_an_agent(text: str):
    for told in texts_of(read(text)):
        assert not re.search(r"\btarget|\bpin|\|e(\||\(|_i\|)", told), told


def test_a_problem_with_a_target_says_what_it_said():
    said = said_of(loop_of(read(RING.replace('goal = "agreement"\n', ""))))
    told = "every start with |e_i| <= 1 reaches the target: |e|_inf falls."
    assert said(told) is told


def test_errors_are_differences_of_all_or_to_the_agent_that_hears_nobody():
    told = "max_i |e_i|/v_i near the target, the targets"
    ring, led, form = (said_of(loop_of(read(x))) for x in (RING, FOLLOWED, RING + FORMATION))
    assert ring(told) == "max |x_i - x_j|/v_ij near agreement, the targets"
    assert led(told) == "max |x_i - x_2|/v_i near agreement, the targets"
    assert form(told) == "max |e_i - e_j|/v_ij near agreement, the targets"


def test_what_a_user_typed_is_not_turned():
    """Agents, modes, notes: here an agent and a note that hold phrases of the package."""
    text = RING.replace("agents = 3", 'agents = ["2", "near the target area", "3"]')
    text = text.replace("[1, 2]", '["near the target area", "2"]').replace("[3, 1]", "[3, 2]")
    said = said_of(loop_of(read(text.replace("[2, 3], ", ""))), "as in |e_i| = 1")
    told = "agent near the target area ends near the target, as in |e_i| = 1 and |e_i|"
    turned = "agent near the target area ends near agreement, as in |e_i| = 1 and |x_i - x_2|"
    assert said(told) == turned


@pytest.mark.parametrize("goal", ["agreement", "containment"])
def test_every_phrase_that_is_turned_stands_in_a_text_of_the_package(goal: str):
    """Else a sentence has changed, and its phrase is left behind."""
    room = files("dobc_design")
    tables = tomllib.loads((room / "loop" / "words.toml").read_text("utf-8"))
    texts = []
    for path in Path(str(room)).rglob("*"):
        if path.suffix in (".py", ".toml") and path.name != "words.toml":
            # Long texts go on after a quote, or a backslash, at the end of a line.
            texts.append(re.sub(r'(?:"\s*\n\s*f?"|\\\n\s*)', "", path.read_text("utf-8")))
    assert [x for x in tables[goal] if not any(x in text for text in texts)] == []


def test_offsets_of_a_formation_widen_the_differences_from_which_agents_start():
    """x_i - offset_i starts in [-1 - 1, 1 + 1] for somebody: differences are up to 4, not 2."""
    certificate = certify(read(RING + FORMATION))
    asked = certificate.regions.asked
    assert asked is not None
    assert asked.box == certificate.check("max-separable").domain.radius == 4
    assert verify(certificate, read(RING + FORMATION)).holds
    # what covers the region without offsets does not cover it with them
    smaller = certify(read(RING)).check("max-separable")
    assert smaller.domain.radius == 2


def test_two_closed_groups_refute_and_the_arcs_that_join_them_are_a_cure_that_is_proved(
    tmp_path: Path,
):
    problem = read(APART)
    certificate = certify(problem)
    assert certificate.verdict is Verdict.REFUTED
    assert "is heard by agents 1 and 2, nor by agent 5" in certificate.reason
    assert verify(certificate, problem).holds
    cure = main_cure(certificate.checks)
    assert cure is not None
    assert cure.fix is not None
    assert "agent 3 listen to agent 1" in cure.fix.text
    cured = certify(changed_problem(problem, cure.fix.set))
    assert cured.verdict is Verdict.PROVED
    # The file turns from "sends_to" to "listens_to" as a whole, and comments stay.
    text = changed_file(problem, cure.fix.set, text=APART, folder=tmp_path)
    assert "# who sends to whom" in text
    assert read(text).network == cured.problem.network


def test_arcs_that_come_and_go_are_not_rewritten_by_a_cure():
    modes = "G = []\nH = { arcs = [[2, 1]], optional = [[1, 2]] }"
    head = 'goal = "agreement"\n[network]\nagents = 2\narrow = "listens_to"\n[network.modes]\n'
    certificate = certify(read(f'{head}{modes}\n[coupling]\nh = "y"\n'))
    assert main_cure(certificate.checks) is None


def test_eigenvalues_of_differences_are_for_smooth_couplings():
    """As for a target, in both programs: nothing is withdrawn."""
    local, _, _ = RING.replace('"tanh(y)"', '"y + y*abs(y)"').partition("[exosystem]")
    certificate = certify(read(local))
    assert "abs" in certificate.problem.coupling.nonsmooth
    assert "linearisation" not in {check.id for check in certificate.checks}
    assert not any("second checker" in check.reason for check in certificate.checks)


def test_the_file_of_a_problem_that_agrees_keeps_its_goal():
    assert read(problem_text(read(RING))).agrees


def test_of_agents_that_agree_no_mix_of_neighbour_sets_is_claimed():
    """1 hears 2, or 2 hears 1: if each took its neighbours from the other mode, nobody would hear
    anybody."""
    text = RING.replace("agents = 3", "agents = 2") + '[switching]\nsignal = "mobile"\nradius = 1\n'
    problem = read(text.replace("ring = [[1, 2], [2, 3], [3, 1]]", "a = [[1, 2]]\nb = [[2, 1]]"))
    found = certify(problem)
    assert found.verdict is Verdict.PROVED
    assert "This is about the graphs of the declared modes. " in found.reason
