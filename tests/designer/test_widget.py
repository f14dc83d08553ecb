"""The Designer without a browser: what is set is what is certified, previewed and saved."""

import runpy
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

pytest.importorskip(
    "anywidget", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)

from measured import CARTS, floats

import dobc_design as dd
from dobc_design.designer.source import python_source
from dobc_design.designer.widget import preview
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.report.plant import plant_numbers


def problem(coupling: str, arcs: list[list[int]], agents: int, **settings: Any) -> dd.Problem:
    return dd.Problem(
        network=dd.Network.from_arcs(arcs, arrow="listens_to", agents=agents),
        coupling=coupling,
        **settings,
    )


@pytest.fixture
def designer() -> dd.Designer:
    return dd.Designer(
        problem("tanh(y) + y", [[2, 1], [3, 2]], 3, target=2, gains={1: 3}, name="line")
    )


def test_until_something_is_changed_the_problem_is_the_one_given_exactly():
    """A region that is not symmetric, a gain that no double equals."""
    region = {"initial_states": [0, 5]}
    given = problem(
        "tanh(y) + y", [[2, 1]], 2, target=1, gains={1: "1/3"}, region=region, name="third"
    )
    designer = dd.Designer(given)
    assert designer.problem == given
    designer.gains = {**designer.gains, "2": 0.125}
    assert [k[0][0] for k in designer.problem.pinning.gains.values()] == [
        Fraction(1, 3),
        Fraction(1, 8),
    ]
    assert designer.problem.region == given.region
    designer.radius = 2.0
    assert designer.problem.region.initial_states == ((Fraction(-1), Fraction(3)),)


def test_arcs_are_added_and_removed_with_the_couplings_of_their_own(designer):
    own = problem(
        "y", [[2, 1, "1/3"], [3, 2]], 3, gains={1: 3}, exceptions={(1, 0): "2*y", (2, 1): "3*y"}
    )
    designer = dd.Designer(own)
    designer.arcs = {"G": [[1, 0, "1/3"], [0, 2, "1"]]}
    changed = designer.problem
    assert list(changed.network.modes["G"]) == [(1, 0, Fraction(1, 3)), (0, 2, Fraction(1))]
    assert set(changed.exceptions) == {(1, 0)}
    assert "agent 3" in designer.certify().reason
    designer.arcs = {"G": [[1, 1, "1"]]}
    assert "network.modes.G" in designer.numbers["note"]


FEATURES = {
    "groups": {
        "groups": [
            dd.Group(agents=[k], exosystem=dd.Exosystem(A=[[f"-{k}/3"]], C=[[1]])) for k in (1, 2)
        ]
    },
    "own couplings": {"exceptions": {(1, 0): "2*y"}, "offsets": {"2": 1}, "name": 'it\'s "here"'},
    "matrix gains": {
        "target": [0, 1],
        "gains": {1: [["1/3", 0], [0, 2]]},
        "simulation": {"x0": [[0, 1], ["1/3", 2]]},
    },
}


@pytest.mark.parametrize("source", ["paper-fixed", "paper-switching", "uav-swarm", *FEATURES])
def test_the_python_of_a_problem_builds_an_equal_problem(source, tmp_path):
    given = (
        problem("sin(y)", [[2, 1, "1/3"], [1, 2]], 2, **FEATURES[source])
        if source in FEATURES
        else source
    )
    wanted = given if source in FEATURES else dd.load_problem(source)
    (tmp_path / "script.py").write_text(python_source(wanted), encoding="utf-8")
    found = runpy.run_path(str(tmp_path / "script.py"))["problem"]
    assert found == wanted
    assert canonical_bytes(found) == canonical_bytes(wanted)


def test_the_exact_verdict_is_that_of_certify_and_goes_with_the_next_move(designer):
    certificate = designer.certify()
    assert certificate.verdict is dd.Verdict.PROVED
    assert designer.verdict["verdict"] == "proved"
    assert dd.verify(certificate, designer.problem).holds
    designer.gains = {}
    assert designer.certificate is None
    assert designer.verdict == {}
    assert designer.certify().verdict is dd.Verdict.REFUTED
    assert "no agent is pinned" in designer.verdict["text"]


def test_beside_the_verdict_stands_what_is_proved_about_the_plant(designer):
    designer.certify()
    assert designer.verdict["plant"] == plant_numbers(designer.certificate)
    assert designer.verdict["plant"][-1].startswith("weights may be off by ")


def test_the_preview_agrees_with_closed_forms(designer):
    """h'(0) = 2, gain 3 at agent 1: Lambda = [[-6, 2, 0], [2, -4, 2], [0, 2, -4]]; without pins it
    is not negative."""
    wanted = np.linalg.eigvalsh(np.array([[-6.0, 2, 0], [2, -4, 2], [0, 2, -4]])).max()
    assert designer.numbers["lambda_max"] == pytest.approx(wanted, rel=1e-9)
    assert designer.numbers["reach"] == 1.0
    designer.gains = {}
    assert designer.numbers["lambda_max"] >= 0
    assert designer.numbers["reach"] == 0


def test_the_previewed_region_is_about_what_certify_proves():
    """sin, one pin of two agents that listen to each other: a box below pi is all there is."""
    both = [[2, 1], [1, 2]]
    reach = preview(
        problem("sin(y)", both, 2, gains={1: 1}), radius=6.0, rate=0.01, t_final=1.0
    ).reach
    region = {"initial_states": [-0.9 * reach, 0.9 * reach]}
    assert 0.5 < reach < 3.2
    assert (
        dd.certify(problem("sin(y)", both, 2, gains={1: 1}, region=region)).verdict
        is dd.Verdict.PROVED
    )


def test_a_saved_file_is_the_problem(designer, tmp_path):
    designer.gains = {"2": 0.7}
    path = designer.save(tmp_path / "new.toml")
    assert canonical_bytes(dd.load_problem(path)) == canonical_bytes(designer.problem)
    with pytest.raises(SpecError, match=r"there already"):
        designer.save(path)
    again = dd.Designer(path)  # as after a restart of the kernel
    assert again.gains == designer.gains
    assert again.arcs == designer.arcs
    assert again.radius == designer.radius
    assert again.problem == dd.load_problem(path)


def test_after_any_moves_the_estimates_are_those_of_a_new_widget(designer):
    """Estimates depend on the problem and the sliders, not on the order of the moves."""
    for name, value in (
        ("rate", 0.2),
        ("radius", 2.5),
        ("rate", 0.1),
        ("gains", {"2": 4.0}),
        ("radius", 1.5),
    ):
        setattr(designer, name, value)
        fresh = dd.Designer(designer.problem, rate=designer.rate)
        seen, wanted = (dict(each.numbers, milliseconds=0, version=0) for each in (designer, fresh))
        assert seen == wanted


def test_agents_with_different_exosystems_are_designed_too():
    groups = [
        dd.Group(agents=["1"], exosystem=dd.Exosystem(A=[[0]], C=[[1]])),
        dd.Group(agents=["2"], exosystem=dd.Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0]])),
    ]
    designer = dd.Designer(problem("y", [[2, 1], [1, 2]], 2, gains={1: 3}, groups=groups))
    designer.radius = 2.0
    assert designer.numbers["note"] == ""
    assert designer.numbers["lambda_max"] < 0
    assert designer.problem.is_grouped


def test_a_rate_is_shown_cut_towards_zero(designer):
    rate = designer.certify().rate
    assert Fraction(designer.verdict["rate"]) <= Fraction(repr(rate))


def test_a_message_of_the_page_saves_and_says_what_went_wrong(designer, tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(
        type(designer), "send", lambda self, content, buffers=None: said.append(content["text"])
    )
    for path in (tmp_path / "a.toml", tmp_path / "a.toml", tmp_path / "no" / "folder.toml"):
        designer._asked(designer, {"kind": "save", "path": str(path)}, [])
    designer._asked(designer, "noise", [])
    designer._asked(
        designer, {"kind": "save", "path": str(tmp_path / "a.toml"), "replace": True}, []
    )
    designer._asked(designer, {"kind": "python"}, [])
    assert said[4] == python_source(designer.problem)
    assert said[0] == f"Saved. To open it again: dd.Designer({str(tmp_path / 'a.toml')!r})"
    assert "there already" in said[1]
    assert "folder.toml" in said[2]
    assert said[3] == said[0]


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(SpecError, match=r"201 agents; the drawing shows at most 200"):
        dd.Designer(problem("y", [[2, 1]], 201))
    with pytest.raises(SpecError, match=r"^leader: the Designer is not available yet"):
        dd.Designer(CARTS["leader"])


def test_a_matrix_counts_as_one_and_is_scaled():
    """Of a cart with the coupling 2 y1 + 3 y2 only its multiples are numbers of the file."""
    designer = dd.Designer(CARTS["estimates"])
    assert designer.gains == {"1": 1} and designer.problem == CARTS["estimates"]
    designer.gains = {"1": 0.5, "2": 0.25}
    held = designer.problem.pinning.gains
    assert held == {0: ((2, 2),), 1: ((Fraction(1, 2), Fraction(3, 4)),)}


@pytest.mark.parametrize("name", ["estimates", "outputs"])
def test_agents_that_measure_outputs_are_run_as_if_estimates_were_right(name):
    """Of estimated states the couplings are those of carts that know themselves."""
    given = CARTS[name]
    designer = dd.Designer(given)
    assert designer.numbers["note"] == "" and designer.numbers["lambda_max"] is None
    own = given.dynamics
    H = np.eye(2) if own.acts_on is None else floats(own.H)
    knowing = given.replace(
        dynamics={"A": own.A, "B": own.B},
        coupling="2*y1 + 3*y2" if own.acts_on is None else "2*y1",
        gains={1: (floats(given.pinning.gains[0]) @ H).tolist()},
        exosystem=None,
        observer=None,
        simulation=None,
    )
    assert designer.numbers["errors"] == dd.Designer(knowing).numbers["errors"]
    assert designer.certify().verdict is dd.Verdict.PROVED


def test_a_kink_at_the_target_leaves_the_eigenvalue_out():
    assert (
        dd.Designer(problem("y + abs(y)/2", [[2, 1]], 2, gains={1: 1, 2: 1})).numbers["lambda_max"]
        is None
    )


def test_readings_stay_and_the_proved_rate_is_given_with_other_ages():
    """The rate falls with the age; an age of eight times the stated one is proved, too."""
    given = problem("y", [[2, 1], [3, 2]], 3, gains={1: 3}, name="late", readings={"delay": "1/2"})
    designer = dd.Designer(given, rate=0.1)
    assert designer.problem == given
    certificate = designer.certify()
    rates = dict(designer.verdict["rates"]["points"])
    assert len(rates) > 3 and 0.5 in rates
    falling = [rates[time] for time in sorted(rates)]
    assert falling == sorted(falling, reverse=True) and falling[-1] > 0
    # The verdict may rest on a slower one with an earlier time to one percent.
    assert rates[0.5] >= certificate.rate > 0
    assert "4 s" in designer.verdict["rates"]["text"]


def test_a_gain_that_overshoots_between_samples_is_not_previewed_as_converging():
    """T = 0.4 allows slopes and gains up to 2.5: 1 + 1 is held, 1 + 3 is not; theory, 15."""
    given = problem("y", [[2, 1], [1, 2]], 2, gains={1: 1}, processor={"period": "2/5"})
    assert preview(given, radius=1.0, rate=0.1, t_final=5.0).reach == 1.0
    steep = given.replace(gains={1: 3})
    assert preview(steep, radius=1.0, rate=0.1, t_final=5.0).reach == 0.0
