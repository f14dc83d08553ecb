"""Problem from Python: exact, frozen, and every mistake named by the key of the problem file."""

import copy
import dataclasses
import pickle
from decimal import Decimal
from fractions import Fraction
from typing import Any

import control
import networkx as nx
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import network_of
from random_problems import random_problem

from dobc_design import Exosystem, Observer, Pinning, Problem, load_problem
from dobc_design.coupling.coupling import make_coupling
from dobc_design.errors import ExpressionError, ShapeError, SpecError
from dobc_design.problem.region import Region
from dobc_design.problem.simulation import Simulation
from dobc_design.problem.switching import Switching

CHAIN = network_of([("a", "b"), ("b", "c")])
SINE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
PLANE = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0], [0, 1]])


NAMED = network_of([["b", "lead"]])


def make(**changes: object) -> Problem:
    return Problem(**{"network": CHAIN, "coupling": "tanh(y)"} | changes)


def scalar(value: object) -> tuple[tuple[Fraction, ...], ...]:
    return ((Fraction(value),),)


def test_the_smallest_problem_has_one_component_no_pins_and_no_disturbance():
    problem = make()
    assert problem.n == 3
    assert problem.m == 1
    assert problem.q == 0
    assert problem.target == (0,)
    assert problem.pinning.agents == ()
    assert problem.observer == Observer()
    assert problem.exosystem is None
    assert problem.region is None
    assert problem.switching is None
    assert problem.simulation == Simulation(t_final=Fraction(20), seed=0, xi0=None)
    assert not problem.is_linear


GAINS: list[Any] = [
    (5, 5),
    ("9/16", Fraction(9, 16)),
    (Decimal("0.5"), Fraction(1, 2)),
    (Fraction(1, 3), Fraction(1, 3)),
    ([[2]], 2),
    (np.array([[0.5]]), Fraction(1, 2)),
]


@pytest.mark.parametrize(("value", "expected"), GAINS)
def test_gains_may_be_of_any_exact_kind(value, expected):
    pinning = make(gains={"a": value}).pinning
    assert pinning.gains == {0: scalar(expected)}


def test_one_gain_is_for_all_agents_and_zero_gains_are_no_pins():
    assert make(gains="1/2").pinning.agents == (0, 1, 2)
    assert make(gains=0).pinning.agents == ()
    pinned = make(gains={"a": 0, "c": 1})
    assert pinned.pinning.agents == (2,)
    pinning = make(gains=Pinning(gains={1: scalar(3)})).pinning
    assert pinning.agents == (1,)


def test_matrix_gains_need_a_positive_semidefinite_symmetric_part():
    """k + k' >= 0 (theory, section 0): a rotation alone is allowed, a push is not."""
    gains = {"a": [[0, 1], [-1, 0]]}
    kept = make(coupling="y", exosystem=PLANE, gains=gains)
    found = kept.pinning.gains[0]
    expected = ((0, 1), (-1, 0))
    assert found == expected
    assert not kept.pinning.is_scalar
    said = r"pinning\.gains\.a: a matrix gain k must satisfy k \+ k' >= 0"
    with pytest.raises(SpecError, match=said):
        make(coupling="y", exosystem=PLANE, gains={"a": [[1, 3], [0, 1]]})


DIMENSIONS: list[Any] = []


def dimension(m: int, /, **changes: Any) -> None:
    """A problem with these changes has m state components."""
    DIMENSIONS.append((changes, m))


dimension(2, exosystem=PLANE, target=5)
dimension(3, target=[1, 2, 3])
dimension(2, coupling=["y1", "y2"])
dimension(4, coupling=make_coupling("y", dimension=4))
dimension(1)


@pytest.mark.parametrize(("changes", "m"), DIMENSIONS)
def test_m_is_the_rows_of_c_else_the_length_of_target_else_of_h_else_1(changes, m):
    problem = make(**changes)
    assert problem.m == m
    assert len(problem.target) == m


def test_couplings_are_numbered_in_the_order_of_arcs_however_they_were_given():
    """Certificates refer to them by number, and their readers have the canonical problem only."""
    exceptions = {(1, 2): "3*y", (0, 1): "2*y"}
    problem = make(exceptions=exceptions)
    _, first, second = problem.couplings
    assert first.texts == ("2*y",)
    assert second.texts == ("3*y",)
    other_order = {(0, 1): "2*y", (1, 2): make_coupling("3*y", dimension=1)}
    assert problem == make(exceptions=other_order)
    assert problem.coupling_of(0, 1).texts == ("2*y",)


def test_zero_offsets_are_left_out():
    problem = make(offsets={"a": 0, "b": 2})
    assert problem.offsets == {1: (2,)}
    assert problem.goal_of(0) == (0,)
    assert problem.goal_of(1) == (2,)


def test_regions_and_xi0_for_every_component_and_agent():
    given = {"initial_states": [[0, 1], [2, 3]], "initial_disturbance": "1/2"}
    simulation = {"xi0": np.eye(3, 2)}
    problem = make(exosystem=PLANE, region=given, simulation=simulation)
    states = ((0, 1), (2, 3))
    region = Region(initial_states=states, initial_disturbance=Fraction(1, 2))
    assert problem.region == region
    expected = ((1, 0), (0, 1), (0, 0))
    assert problem.simulation.xi0 == expected
    again = make(exosystem=PLANE, region=region, simulation=problem.simulation)
    assert again.region == region
    assert again.simulation == problem.simulation


def test_a_problem_is_frozen_hashable_and_its_mappings_cannot_be_changed():
    exceptions = {(0, 1): "y"}
    given = {"gains": {"a": 1}, "offsets": {"b": 1}, "exceptions": exceptions}
    problem = make(**given)
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.target = (1,)  # type: ignore[misc]
    mappings: list[Any] = [problem.offsets, problem.exceptions]
    mappings += [problem.pinning.gains, problem.network.modes]
    for mapping in mappings:
        with pytest.raises(TypeError):
            mapping["x"] = 1
    twin = make(**given)
    assert twin == problem
    assert hash(twin) == hash(problem)
    assert make() != problem


def test_a_state_space_system_is_an_exosystem():
    A = [[0, 2], [-2, 0]]
    B = [[0], [0]]
    C = [[1, 0]]
    system = control.ss(A, B, C, [[0]])
    exosystem = Exosystem(system)
    assert exosystem == SINE
    decimal = Exosystem(control.ss([[0.1]], [[1]], [[0.3]], [[0]]))
    assert scalar("1/10") == decimal.A


def test_a_system_in_discrete_time_or_without_a_state_is_refused():
    """x[k + 1] = A x[k] would be taken for x' = A x in silence."""
    for step in (0.1, True):
        with pytest.raises(SpecError, match="must be in continuous time"):
            Exosystem(control.ss([[0.5]], [[1]], [[1]], [[0]], step))
    with pytest.raises(SpecError, match="got TransferFunction"):
        Exosystem(control.tf([1], [1, 1]))


MISTAKES: list[Any] = []


def mistake(key: str, message: str, /, **changes: Any) -> None:
    MISTAKES.append((changes, key, message))


GRAPH = nx.DiGraph([(1, 2)])
mistake("network", r"must be a Network; got.*Network\.from_arcs, from_networkx", network=GRAPH)
mistake("exosystem", "must be an Exosystem", exosystem={"A": [[0]], "C": [[1]]})
SYSTEM = control.ss([[0]], [[1]], [[1]], [[0]])
mistake("exosystem", r"Exosystem\(system\)", exosystem=SYSTEM)
mistake("observer", "must be an Observer", exosystem=SINE, observer={"W": [[1], [1]]})
mistake("switching", "must be a Switching", switching="random")
mistake("name", "1 to 100 printable", name="")
mistake("notes[0]", "must be text of at most 1000", notes=[5])
ONE_NUMBER = "must have 1 number, one per state component; got 2"
mistake("target", ONE_NUMBER, target=[1, 2], exosystem=SINE)
mistake("target", "at most 100 state components; got 101", target=[0] * 101)
mistake("coupling.h", "must vanish", coupling="y + 1")
mistake("coupling.h", "must have 1 expression", coupling=["y1", "y2"], exosystem=SINE)
IN_PLANE = make_coupling("y", dimension=2)
mistake("coupling.h", "must have dimension 1", coupling=IN_PLANE, exosystem=SINE)
mistake("coupling.exceptions[0]", "no mode has the arc", exceptions={(0, 2): "y"})
mistake("coupling.exceptions[0].h", "must vanish", exceptions={(0, 1): "y + 1"})
mistake("coupling.exceptions[0]", "indices count from 0", exceptions={("a", "b"): "y"})
mistake("pinning.gains.z", "there is no agent 'z'.*Use the label of an agent", gains={"z": 1})
mistake("pinning.gains.laed", 'Did you mean "lead"', network=NAMED, gains={"laed": 1})
mistake("pinning.gains", "must be >= 0", gains=-1)
mistake("pinning.gains", "must be a table of label = gain", gains=[1, 2, 3])
mistake("pinning.gains.a", r"must have shape \(1, 1\)", gains={"a": [[1, 2]]})
mistake("observer", "no meaning without an", observer=Observer(W=[[1]]))
mistake("observer.W", r"must have shape \(2, 1\)", exosystem=SINE, observer=Observer(W=[[1]]))
SMALL = Observer(W=[[1], [1]], P=[[1]])
mistake("observer.P", r"must have shape \(2, 2\)", exosystem=SINE, observer=SMALL)
mistake("formation.offsets.z", "there is no agent 'z'", offsets={"z": 1})
mistake("region.initial_states", r"must be a pair \[lo, hi\]; got None", region={})
mistake("region.initial_state", "is an unknown key", region={"initial_state": [0, 1]})
UNIT = {"initial_states": [0, 1]}
mistake("region.initial_disturbance", "no meaning", region=UNIT | {"initial_disturbance": 1})
mistake("region.initial_disturbance", "is required when", exosystem=SINE, region=UNIT)
mistake("region", "must be", region=Simulation(t_final=Fraction(1), seed=0, xi0=None))
INTERVAL = (Fraction(0), Fraction(1))
REGION = Region(initial_states=(INTERVAL,), initial_disturbance=None)
mistake("simulation", "must be", simulation=REGION)
mistake("simulation.seed", "integer from 0 to", simulation={"seed": 2**63})
mistake("simulation.xi0", "must have 2 numbers", exosystem=SINE, simulation={"xi0": [1]})
mistake("simulation.xi0", "must have 3 rows", exosystem=SINE, simulation={"xi0": [[1, 0]] * 2})


@pytest.mark.parametrize(("changes", "key", "message"), MISTAKES)
def test_a_mistake_is_named_by_its_key(changes, key, message):
    with pytest.raises(SpecError, match=message) as caught:
        make(**changes)
    assert key in [error.key for error in caught.value.errors]


PARTS: list[Any] = []


def wrong_part(key: str, message: str, kind: type, **given: Any) -> None:
    PARTS.append((kind, given, key, message))


wrong_part("exosystem.A", "must be square", Exosystem, A=[[0, 1]], C=[[1]])
ONE_COLUMN = r"must have 1 column, one per exosystem state"
wrong_part("exosystem.C", ONE_COLUMN, Exosystem, A=[[0]], C=[[1, 2]])
wrong_part("exosystem.A[0]", "at least one number", Exosystem, A=[[]], C=[[1]])
wrong_part("exosystem.A[0][0]", "must be a number", Exosystem, A=np.array([[np.nan]]), C=[[1]])
wrong_part("observer.P", "must stand beside observer.W", Observer, P=[[1]])
SKEW = r"got 2 at \[0\]\[1\] and 3 at \[1\]\[0\]"
wrong_part("observer.P", SKEW, Observer, W=[[1], [1]], P=[[1, 2], [3, 4]])
wrong_part("observer.rate", r"must be > 0 \(1/s\)", Observer, rate=0)
wrong_part("switching.signal", "must be one of random, periodic", Switching, signal="sometimes")
wrong_part("switching.dwell", "must be > 0", Switching, signal="random", dwell=-1)


@pytest.mark.parametrize(("kind", "given", "key", "message"), PARTS)
def test_the_parts_of_a_problem_are_checked_when_they_are_made(kind, given, key, message):
    with pytest.raises(SpecError, match=message) as caught:
        kind(**given)
    assert caught.value.key == key


def test_all_mistakes_are_told_at_once_and_are_value_errors():
    gains = {"z": 1, "a": -1}
    with pytest.raises(ValueError, match=r"(?s)target.*coupling.h.*pinning.gains.z") as caught:
        make(target="x", coupling="y + 1", gains=gains, name="")
    assert isinstance(caught.value, SpecError)
    keys = [error.key for error in caught.value.errors]
    assert keys == ["name", "target", "coupling.h", "pinning.gains.z", "pinning.gains.a"]
    assert type(caught.value.errors[2]) is ExpressionError
    with pytest.raises(ShapeError):
        make(target=[1, 2], exosystem=SINE)


def test_the_same_agent_under_two_spellings_is_refused():
    numbered = network_of([(1, 2)])
    with pytest.raises(SpecError, match=r"pinning\.gains\.1 appears twice"):
        make(network=numbered, gains={1: 1, "1": 2})
    with pytest.raises(SpecError, match=r"formation\.offsets\.1 appears twice"):
        make(network=numbered, offsets={1: 1, "1": 2})


def test_at_most_twenty_mistakes_of_a_kind_are_told():
    wrong = {f"z{i}": 1 for i in range(1000)}
    loops = {(i, i): "y" for i in range(1000)}
    for changes in ({"gains": wrong}, {"offsets": wrong}, {"exceptions": loops}):
        with pytest.raises(SpecError) as caught:
            make(**changes)
        assert len(caught.value.errors) == 20


LONG_NUMBER = 10**5000
LONG: dict[str, Any] = {"long text": "x" * 10**6, "escape sequence": "\x1b[31m\n"}
LONG["long list"] = [[["x"] * 100] * 100] * 100
LONG["long number"] = LONG_NUMBER
LONG["long number in a table"] = {"k": LONG_NUMBER}


@pytest.mark.parametrize("value", LONG.values(), ids=LONG)
def test_what_was_given_is_shown_shortly_and_without_control_characters(value):
    with pytest.raises(SpecError) as caught:
        make(simulation={"seed": value})
    assert len(str(caught.value)) < 200
    assert str(caught.value).isprintable()


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_copies_of_a_problem_are_equal(seed):
    """Sweeps send problems to other processes."""
    problem = random_problem(seed)
    pickled = pickle.loads(pickle.dumps(problem))
    for again in (copy.copy(problem), copy.deepcopy(problem), pickled):
        assert again == problem
        assert list(again.network.modes) == list(problem.network.modes)


def test_replace_changes_what_is_named_and_of_a_region_only_the_keys_given():
    problem = load_problem("paper-fixed")
    wider = {"initial_states": [0, 4]}
    changed = problem.replace(gains={1: 7}, region=wider, simulation={"seed": 5})
    for kept in ("network", "coupling", "exosystem", "observer", "name"):
        assert getattr(changed, kept) == getattr(problem, kept)
    assert changed.pinning.gains == {0: ((7,),)}
    expected = Region(initial_states=((0, 4),), initial_disturbance=Fraction(1, 2))
    assert changed.region == expected
    assert changed.simulation == dataclasses.replace(problem.simulation, seed=5)
    assert problem.replace() == problem
    with pytest.raises(SpecError, match=r"region\.initial"):
        problem.replace(region={"initial": 3})
    said = r"no argument 'pinning'\. Its arguments are network, coupling, .*gains"
    with pytest.raises(SpecError, match=said):
        problem.replace(pinning={1: 2})


IN_SYMPY: list[Any] = []


def in_sympy(text: str, expression: Any) -> None:
    IN_SYMPY.append((expression, text))


in_sympy("y/3 + tanh(y)", lambda y: sympy.tanh(y) + sympy.Rational(1, 3) * y)
in_sympy("y*abs(y) + 0.3*y", lambda y: 0.3 * y + sympy.Abs(y) * y)
in_sympy("max(y, 2*y)", lambda y: sympy.Max(y, 2 * y))
in_sympy("exp(1)*y", lambda y: sympy.exp(1) * y)
in_sympy("exp(y) - 1", lambda y: sympy.exp(y) - 1)


@pytest.mark.parametrize(("expression", "text"), IN_SYMPY)
def test_a_coupling_may_be_given_as_a_sympy_expression(expression: Any, text: str):
    problem = load_problem("paper-fixed")
    in_sympy = problem.replace(coupling=expression(sympy.Symbol("y")))
    in_text = problem.replace(coupling=text)
    assert in_sympy.coupling == in_text.coupling


def test_a_network_with_other_agents_needs_gains_of_its_own():
    """Gains stand by agent: with the labels in another order they would move to others."""
    problem = Problem(network=NAMED, coupling="y", gains={"lead": 1})
    turned = network_of([["b", "lead"]], NAMED.labels[::-1])
    with pytest.raises(SpecError, match=r"or the same in another order\. Give gains"):
        problem.replace(network=turned)
    pinned = problem.replace(network=turned, gains={"lead": 1})
    assert pinned.pinning.agents == (turned.labels.index("lead"),)
