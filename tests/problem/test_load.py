"""The shipped problems: they load, introduce themselves, and a file of the same name wins."""

from pathlib import Path

import pytest
from bad_files import VALID

from dobc_design.errors import SpecError
from dobc_design.problem.load import builtin_names, builtin_summary, builtin_text, load_problem


def test_the_papers_problems_come_first():
    assert builtin_names()[:2] == ("paper-fixed", "paper-switching")
    assert len(builtin_names()) >= 5


@pytest.mark.parametrize("name", builtin_names())
def test_a_built_in_problem_loads_under_its_own_name_and_says_what_it_is(name):
    problem = load_problem(name)
    assert problem.name == name
    summary = builtin_summary(name)
    assert 20 < len(summary) < 200
    assert summary.endswith(".")
    assert builtin_text(name).startswith("#")


@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching"])
def test_stand_ins_of_the_papers_problems_are_labelled(name):
    """The text prints neither the arcs of Fig. 1 nor K: what is used in their place says so
    wherever it is shown."""
    stand_ins = [note for note in load_problem(name).notes if "Stand-in" in note]
    for words in ("arcs of Fig. 1", "no gains K"):
        assert any(words in note for note in stand_ins)


def test_a_file_of_that_name_in_the_current_folder_wins_and_a_path_is_never_a_built_in_name(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert load_problem("paper-fixed").name == "paper-fixed"
    with pytest.raises(SpecError, match="there is no file"):
        load_problem(Path("paper-fixed"))
    Path("paper-fixed").write_text(VALID, encoding="utf-8")
    assert load_problem("paper-fixed").name == "four-agents"


@pytest.mark.parametrize(
    ("typed", "meant"), [("paper-fixd", "paper-fixed"), ("uav_swarm", "uav-swarm")]
)
def test_a_misspelt_name_is_guessed(tmp_path, monkeypatch, typed, meant):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        SpecError, match=rf"there is no file '{typed}' and no built-in.*did you mean {meant}\?"
    ):
        load_problem(typed)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "../paper-fixed",
        "paper-fixed.toml",
        "problems/paper-fixed",
        "__init__",
        "x" * 999,
        "paper-fixed\0",
    ],
)
def test_other_names_are_no_built_in_problems(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SpecError):
        load_problem(name)


def test_the_karate_club_has_the_pairs_and_weights_of_networkx():
    """Zachary's matrix C as networkx has it, members from 1; both ways."""
    networkx = pytest.importorskip("networkx")
    graph = networkx.karate_club_graph()
    wanted = set()
    for a, b, weight in graph.edges(data="weight"):
        wanted |= {(a, b, weight), (b, a, weight)}
    network = load_problem("karate-club").network
    assert set(network.modes["club"]) == wanted
    assert network.labels == tuple(str(i + 1) for i in range(34))
