"""[dynamics]: agents that are no integrators, as they are read, refused and written (theory,
section 13)."""

import json
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np
import pytest
from networks import linked, network_of

from dobc_design import (
    Dynamics,
    Exosystem,
    Group,
    Observer,
    Problem,
    Verdict,
    certify,
    load_problem,
    verify,
)
from dobc_design.errors import ExpressionError, ShapeError, SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)

ZERO = [[0, 0], [0, 0]]
LAST = [[0], [1]]
DOUBLE = Dynamics(A=[[0, 1], [0, 0]], B=LAST)
NET = network_of([[2, 1], [3, 2]], 3)
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
FILE = """
target = [1, 0]
[network]
agents = 3
arrow = "listens_to"
[network.modes]
G = [[2, 1], [3, 2]]
[coupling]
h = "y1 + 2*y2"
[pinning]
gains = { 1 = 3 }
[dynamics]
A = [[0, 1], [0, 0]]
B = [[0], [1]]
"""


def agents(**given) -> Problem:
    sound = {"network": NET, "coupling": "y1 + 2*y2", "gains": {1: 3}, "dynamics": DOUBLE}
    return Problem(**sound | given)


def pair(coupling: str = "y", **given) -> Problem:
    """Agent 2 listens to agent 1, which is pinned."""
    arcs = [[2, 1]]
    return linked(arcs, 2, coupling, gains={1: 5}, **given)


def written(tmp_path, text: str) -> Problem:
    path = tmp_path / "problem.toml"
    path.write_text(text, "utf-8")
    return load_problem(path)


def test_a_file_is_read_as_it_is_written_in_python(tmp_path):
    assert written(tmp_path, FILE) == agents(target=[1, 0])


def test_one_expression_needs_no_list_and_a_number_is_so_many_times_the_coupling():
    problem = agents(target=[1, 0])
    assert problem.m == 2
    assert problem.coupling.outputs == 1
    assert problem.pinning.gains == {0: ((3, 6),)}


def test_with_as_many_inputs_as_components_a_number_is_a_multiple_of_the_identity():
    turning = {"A": [[0, 1], [-1, 0]]}
    problem = agents(dynamics=turning, coupling="y", gains={1: "1/2"})
    half = Fraction(1, 2)
    expected = ((half, 0), (0, half))
    assert problem.pinning.gains == {0: expected}


def test_gains_may_push_away():
    gains = {1: [[-3, 6]]}
    expected = {0: ((-3, 6),)}
    assert agents(gains=gains).pinning.gains == expected


NO_DYNAMICS: list[Any] = []


def no_dynamics(kind: Any, message: str, /, **given: Any) -> None:
    NO_DYNAMICS.append((given, message, kind))


no_dynamics(ShapeError, "dynamics.A must be square", A=[[0, 1]])
ONE_ROW = "dynamics.B must have 1 row, one per state component; got 2."
no_dynamics(ShapeError, ONE_ROW, A=[[0]], B=[[1], [0]])
FULL = "dynamics.B must have full column rank"
no_dynamics(SpecError, FULL, A=ZERO, B=[[1, 2], [1, 2]])
no_dynamics(SpecError, FULL, A=ZERO, B=[[0], [0]])
no_dynamics(SpecError, FULL, A=ZERO, B=[[1, 0, 1], [0, 1, 0]])
EITHER = "dynamics must have either A or f"
no_dynamics(SpecError, EITHER)
no_dynamics(SpecError, EITHER, A=[[0]], f=["x"])


@pytest.mark.parametrize(("given", "message", "kind"), NO_DYNAMICS)
def test_what_cannot_be_dynamics_is_named(given, message, kind):
    with pytest.raises(kind) as caught:
        Dynamics(**given)
    assert message in str(caught.value)


MISTAKES: list[Any] = []


def mistake(key: str, *words: str, **given: Any) -> None:
    MISTAKES.append((given, key, words))


mistake("target", "A x + B u0 = 0", "The nearest one is [0, 0].", target=[0, 1])
mistake("target", "The nearest one is [3, 0].", target=[3, 1])
mistake("formation.offsets.2", "The nearest one is [0, 0].", offsets={2: [0, 1]})
mistake("uncertainty.weights", "Remove it, or give 0.", uncertainty={"weights": "1/10"})
STRESS = "dobc stress FILE --saturation 3"
mistake("actuators", "Remove [actuators], certify", STRESS, actuators={"limit": 3})
mistake("coupling.h", "1 expression", "one per input", coupling=["y1", "y2"])
mistake("coupling.h[0]", 'did you mean "y1"', coupling="y")
TWO_INPUTS = {"A": [[0] * 3] * 3, "B": [[1, 0], [0, 1], [0, 0]]}
IN_SPACE = {"dynamics": TWO_INPUTS, "target": [0] * 3, "coupling": "y"}
mistake("coupling.h", "a list of 2 expressions, one per input", "y1 to y3", **IN_SPACE)
SQUARE = {1: [[1, 0], [0, 1]]}
mistake("pinning.gains.1", "one row per input", "shape (2, 2)", gains=SQUARE)
mistake("pinning.gains.1", ">= 0", gains={1: -1})
mistake("pinning.gains.1", "1 x 2 matrix", "the coupling is not linear", coupling="sin(y1)")
TWO_ROWS = Exosystem(A=[[0]], C=[[1], [0]])
mistake("exosystem.C", "1 row, one per input of [dynamics]", exosystem=TWO_ROWS)
WIDE = Observer(W=[[1, 0, 0], [0, 1, 0]])
mistake("observer.W", "column", exosystem=HARMONIC, observer=WIDE)
LARGE = {"A": [[0] * 101] * 101}
mistake("dynamics", "at most 100 state components", dynamics=LARGE, coupling="y")


@pytest.mark.parametrize(("given", "key", "words"), MISTAKES)
def test_mistakes_are_named_with_key_and_cure(given, key, words):
    with pytest.raises(SpecError) as caught:
        agents(**given)
    assert caught.value.key == key
    for each in words:
        assert each in str(caught.value)


def both_programs_prove(problem: Problem) -> None:
    certificate = certify(problem)
    assert certificate.verdict is Verdict.PROVED
    assert verify(certificate, problem).lone_checker == "it accepts every claim"


def test_f_may_fill_its_2000_characters_and_both_programs_decide_it():
    """f = -x - ... - x is -999 x: what is made of f to decide it is longer than f, which is no
    reason to refuse it."""
    long = "-" + "-".join(["x"] * 999)
    assert len(long) == 1998
    problem = pair(dynamics={"f": [long]}, target=0)
    slope = problem.dynamics.about((Fraction(0),))
    expected = (((-999,),), None)
    assert slope == expected
    both_programs_prove(problem)
    with pytest.raises(SpecError, match="must have at most 2000 characters"):
        pair(dynamics={"f": [long + "-x-x"]}, target=0)


def test_h_may_fill_its_2000_characters_beside_a_b_as_well():
    long = "+".join(["y"] * 1000)
    dynamics = {"A": [[-1]], "B": [["5/2"]]}
    both_programs_prove(pair(long, dynamics=dynamics))


def moving(force: str) -> Problem:
    """x1' = x2, x2' = force + u, with the target at 0."""
    dynamics = {"f": ["x2", force], "B": LAST}
    return agents(dynamics=dynamics, target=[0, 0])


def test_an_f_without_slopes_at_the_target_is_named_as_it_is_written():
    """sqrt(x) at 0; from 1 on it has slopes, and there is nothing to be refused."""
    root = {"f": ["sqrt(x)"]}
    dynamics = pair(dynamics=root, target=1).dynamics
    slopes, _ = dynamics.about((Fraction(1),))
    assert slopes == ((0.5,),)
    with pytest.raises(ExpressionError) as caught:
        pair(dynamics=root, target=0)
    assert caught.value.key == "dynamics.f[0]"
    said = str(caught.value)
    assert 'dynamics.f[0] "sqrt(x)" must be defined' in said
    assert "target, x = 0" in said
    undefined = r'dynamics.f\[1\] "sqrt\(x1\)" .* around the target, \(x1, x2\) = \(0, 0\)'
    with pytest.raises(ExpressionError, match=undefined):
        moving("sqrt(x1)")
    with pytest.raises(SpecError, match=r'f\[1\] "1/x1" is not defined at the goal \[0, 0\]'):
        moving("1/x1")
    with pytest.raises(SpecError, match=r'dynamics.f\[1\] "abs\(x1\)" must be smooth'):
        moving("abs(x1)")
    irrational = r'dynamics.f\[1\] "sin\(x1\)\*exp\(1\)" must be smooth, with rational slopes'
    with pytest.raises(SpecError, match=irrational):
        moving("sin(x1)*exp(1)")


def test_mistakes_of_a_file_name_its_key(tmp_path):
    with pytest.raises(SpecError, match=r"dynamics\.B must have 2 rows"):
        written(tmp_path, FILE.replace("B = [[0], [1]]", "B = [[0]]"))


def test_a_constant_input_holds_the_goal():
    """A x + B u0 = 0: a spring that is held 3 out needs u0 = 3 k."""
    A = [[0, 1], [-4, -1]]
    B = [[0], [2]]
    spring = Dynamics(A=A, B=B)
    at_rest = (Fraction(3), Fraction(0))
    moving = (Fraction(3), Fraction(1))
    assert spring.feedforward(at_rest) == (6,)
    assert spring.feedforward(moving) is None
    assert spring.nearest_goal(moving) == at_rest
    assert spring.left_inverse == ((0, Fraction(1, 2)),)


def drawn(r: Random, rows: int, columns: int) -> list[list[int]]:
    return [[r.randint(-2, 2) for _ in range(columns)] for _ in range(rows)]


def test_the_nearest_goal_is_the_projection_that_numpy_finds():
    for number in range(40):
        r = Random(number)
        m = r.randint(2, 4)
        p = r.randint(1, 2)
        A = drawn(r, m, m)
        try:
            dynamics = Dynamics(A=A, B=drawn(r, m, p))
        except SpecError:
            continue
        goal = [Fraction(r.randint(-5, 5)) for _ in range(m)]
        near = dynamics.nearest_goal(tuple(goal))
        assert dynamics.feedforward(near) is not None
        # goals that inputs can hold: B B+ A x = A x
        B = to_float(dynamics.B)
        projection = B @ np.linalg.pinv(B)
        kept = (np.eye(m) - projection) @ np.array(A)
        _, sizes, rows = np.linalg.svd(kept)
        free = rows[np.sum(sizes > 1e-9) :]
        projected = free.T @ free @ np.array(goal, dtype=float)
        assert np.allclose(np.array(near, dtype=float), projected)


WRITTEN: list[Any] = []


def written_back(**given: Any) -> None:
    WRITTEN.append(given)


written_back()
BOX = {"initial_states": [-1, 2]}
written_back(target=[1, 0], offsets={2: [1, 0]}, region=BOX)
written_back(coupling="sin(y1) + y2", gains={1: [[1, 2]]}, exceptions={(1, 0): "y1"})
written_back(exosystem=HARMONIC, observer=Observer(W=[[3], [1]]))
written_back(exosystem=HARMONIC, observer=Observer(W=[[3, 1], [1, 2]]))
SECOND = Group(agents=[2], exosystem=Exosystem(A=[[0]], C=[[1]]))
written_back(exosystem=HARMONIC, groups=[SECOND])
TRIANGULAR = {"A": [[-1, 1], [0, -1]], "B": [[1, 1], [0, 2]]}
written_back(dynamics=TRIANGULAR, coupling="tanh(y)", gains=2)
written_back(dynamics={"f": ["x2", "-sin(x1)"], "B": LAST})


@pytest.mark.parametrize("given", WRITTEN)
def test_what_is_written_is_read_back(given):
    problem = agents(**given)
    data = canonical_bytes(problem)
    assert json.loads(data)["version"] == 2
    again = problem_from_canonical(data)
    assert again == problem
    assert canonical_bytes(again) == data


def test_version_2_and_dynamics_belong_together():
    old = canonical_document(load_problem("paper-fixed"))
    new = canonical_document(agents())
    assert old["version"] == 1
    assert "dynamics" not in old
    for document in (old | {"version": 2}, new | {"version": 1}):
        with pytest.raises(SpecError, match="version"):
            problem_from_canonical(json.dumps(document).encode())
