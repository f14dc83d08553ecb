"""[dynamics] with H: what agents measure, as it is read, refused and written (theory, section
18)."""

from typing import Any

import pytest
from networks import linked

import dobc_design as dd
from dobc_design import Dynamics, Exosystem, Group, Observer, Problem, load_problem
from dobc_design.description.words import dynamics_lines
from dobc_design.designer.source import python_source
from dobc_design.errors import ShapeError, SpecError
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)
from dobc_design.problem.changes import changed_file, problem_text
from dobc_design.problem.uncertainty import Uncertainty

CART: dict[str, Any] = {"A": [[0, 1], [0, 0]], "B": [[0], [1]]}
POSITION = CART | {"H": [[1, 0]]}
OUTPUTS = POSITION | {"acts_on": "outputs"}
CONSTANT = Exosystem(A=[[0]], C=[[1]])
W = [[3], [3], [1]]
FILE = """
name = "carts"
[network]
agents = 2
arrow = "listens_to"
[network.modes]
G = [[2, 1]]
[coupling]
h = "2*y1 + 3*y2"
[pinning]
gains = { 1 = [[4, 4]] }
[dynamics]
A = [[0, 1], [0, 0]]
B = [[0], [1]]
H = [[1, 0]] # an encoder
[exosystem]
constant = true
[observer]
W = [[3], [3], [1]]
"""


def agents(dynamics: dict[str, Any] = POSITION, **given: Any) -> Problem:
    sound: dict[str, Any] = {"gains": {1: [[4, 4]]}, "exosystem": CONSTANT}
    return linked([[2, 1]], 2, "2*y1 + 3*y2", dynamics=dynamics, **sound | given)


def acting_on_outputs() -> Problem:
    return linked([[2, 1]], 2, "tanh(y)", gains={1: 2}, exosystem=CONSTANT, dynamics=OUTPUTS)


def written(tmp_path: Any, text: str = FILE) -> Problem:
    path = tmp_path / "problem.toml"
    path.write_text(text, "utf-8")
    return load_problem(path)


def test_a_file_is_read_as_it_is_written_in_python(tmp_path):
    own = agents(name="carts", observer=Observer(W=W))
    assert written(tmp_path) == own


def test_states_are_what_couplings_act_on_unless_outputs_are_named():
    assert Dynamics(**POSITION).felt == 2
    assert Dynamics(**OUTPUTS).felt == 1
    assert Dynamics(**POSITION, acts_on="states") == Dynamics(**POSITION)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"H": [[1, 0, 0]]}, r"^dynamics\.H must have 2 columns, one per state component; got 3"),
        ({"H": [[1, 0], [2, 0]]}, r"^dynamics\.H must have full row rank"),
        ({"H": [[0, 0]]}, r"^dynamics\.H must have full row rank"),
        ({"acts_on": "outputs"}, r"^dynamics\.acts_on needs H"),
        ({"H": [[1, 0]], "acts_on": "y"}, r'^dynamics\.acts_on must be "states" or "outputs"'),
        ({"A": None, "f": ["x2", "-x1"], "H": [[1, 0]]}, r"^dynamics\.H is known for linear"),
    ],
)
def test_an_h_that_measures_nothing_new_is_refused(given, message):
    with pytest.raises(SpecError, match=message):
        Dynamics(**CART | given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"exosystem": None}, r"^dynamics\.H needs an \[exosystem\]"),
        ({"readings": {"delay": "0.1"}}, r"^readings is not known together with dynamics\.H"),
        ({"uncertainty": {"weights": "0.1"}}, r"^uncertainty\.weights is not known"),
        ({"actuators": {"limit": 1}}, r"^actuators is not known"),
    ],
)
def test_tables_that_no_proof_knows_beside_h_are_refused(given, message):
    with pytest.raises(SpecError, match=message):
        agents(**given)


def test_noise_of_outputs_is_known_where_estimates_are_acted_on():
    assert agents(uncertainty={"measurement": "0.1"}).uncertainty is not None
    with pytest.raises(SpecError, match=r"^uncertainty\.measurement is not known where couplings"):
        acting_on_outputs().replace(uncertainty=Uncertainty(measurement="0.1"))


@pytest.mark.parametrize(
    ("observer", "message"),
    [
        (Observer(W=[[1], [2]]), r"^observer\.W must have shape \(3, 1\)"),
        (Observer(W=[[1, 1], [2, 2], [3, 3]]), r"^observer\.W must have shape \(3, 1\)"),
        (Observer(W=W, P=[[1]]), r"^observer\.P must have shape \(3, 3\)"),
    ],
)
def test_a_gain_is_one_of_states_and_exosystem(observer, message):
    with pytest.raises(ShapeError, match=message):
        agents(observer=observer)


def test_every_agent_needs_an_exosystem():
    """The states of others would be known to nobody."""
    with pytest.raises(SpecError, match=r"^exosystem\.groups must be for every .* agent 2 too"):
        agents(exosystem=None, groups=[Group(agents=[1], exosystem=CONSTANT)])


@pytest.mark.parametrize("make", [agents, acting_on_outputs], ids=["states", "outputs"])
def test_a_problem_survives_every_way_of_writing_it(make, tmp_path):
    problem = make(observer=Observer(W=W)) if make is agents else make()
    document = canonical_document(problem)
    assert document["dynamics"]["H"] == [["1", "0"]]
    assert ("acts_on" in document["dynamics"]) is (make is acting_on_outputs)
    assert document["version"] == 4
    assert problem_from_canonical(canonical_bytes(problem)) == problem
    assert written(tmp_path, problem_text(problem)) == problem
    names: dict[str, Any] = {}
    exec(python_source(problem), names)  # noqa: S102 - what the package itself has written
    assert names["problem"] == problem


def test_a_changed_file_keeps_what_is_measured(tmp_path):
    text = changed_file(
        written(tmp_path), {"pinning.gains": {"1": [[5, 5]]}}, text=FILE, folder=tmp_path
    )
    assert "H = [[1, 0]] # an encoder" in text
    assert written(tmp_path, text).dynamics == Dynamics(**POSITION)


def test_parts_that_do_not_know_outputs_say_so():
    """Also where no W is given."""
    problem = agents()
    runs = (dd.analyse, dd.block_lmi, dd.export.python_script)
    for run in runs:
        with pytest.raises(SpecError, match=r"^dynamics\.H: .* does not know outputs"):
            run(problem)


def test_check_says_what_is_measured():
    lines = list(dynamics_lines(agents()))
    assert lines[1].startswith("Measured: y = H x, H = [1 0], 1 output of 2 states;")
    assert lines[1].endswith("act on estimated states.")
    assert list(dynamics_lines(acting_on_outputs()))[1].endswith("act on outputs.")
