"""What a file states that cannot be kept together, or that changes nothing: warnings with their
numbers."""

from typing import Any

import pytest

from dobc_design import Exosystem, Group, Network, Observer, Problem, Switching, exosystems
from dobc_design.description.contradictions import warnings
from dobc_design.description.words import describe
from dobc_design.problem.load import builtin_names, load_problem

CHAIN = [(1, 2), (2, 3), (3, 4)]
TWO_MODES = Network.from_arcs({"a": CHAIN, "b": [*CHAIN, (1, 3)]}, arrow="listens_to", agents=4)
SINE = exosystems.harmonics(2)
SOUND: dict[str, Any] = {
    "network": Network.from_arcs(CHAIN, arrow="listens_to", agents=4),
    "coupling": "y",
    "gains": {4: 2},
    "target": 1,
    "exosystem": SINE,
    "region": {"initial_states": [0, 3], "initial_disturbance": 1},
}
HZ_AND_RAD = exosystems.of_parts(hz=["1/2"], frequencies=["1/2"])
TWICE = exosystems.of_parts(hz=["1/2"], frequencies=["3.14"])
CASES: list[Any] = []


def contradiction(name: str, words: str, wrong: dict, right: dict) -> None:
    CASES.append(pytest.param(wrong, right, words, id=name))


contradiction(
    "a limit below the amplitude that is stated",
    "The actuator limit 0.5 of every agent is below the disturbance, which reaches 2 "
    "(actuators.amplitude)",
    {"actuators": {"limit": "1/2", "amplitude": 2}},
    {"actuators": {"limit": "2.1", "amplitude": 2}},
)
contradiction(
    "a limit that the disturbance takes to the last",
    "The actuator limit 2 of every agent equals the disturbance, which reaches 2 "
    "(actuators.amplitude): cancelling",
    {"actuators": {"limit": 2, "amplitude": 2}},
    {"actuators": {"limit": "2.001", "amplitude": 2}},
)
contradiction(
    "a limit below the amplitude of the runs",
    "The actuator limit 4 of every agent is below the disturbance, which reaches 5 "
    "(from simulation.xi0)",
    {"actuators": {"limit": 4}, "simulation": {"xi0": [3, 4]}},
    {"actuators": {"limit": "5.1"}, "simulation": {"xi0": [3, 4]}},
)
contradiction(
    "a limit of one agent",
    "The actuator limit 1 of agent 3 is below the disturbance",
    {"actuators": {"limit": {1: 9, 3: 1}, "amplitude": 2}},
    {"actuators": {"limit": {1: 9, 3: 3}, "amplitude": 2}},
)
contradiction(
    "runs with more than the stated amplitude",
    "The disturbance that simulation.xi0 starts reaches 5, more than actuators.amplitude = 2",
    {"actuators": {"limit": 9, "amplitude": 2}, "simulation": {"xi0": [3, 4]}},
    {"actuators": {"limit": 9, "amplitude": 5}, "simulation": {"xi0": [3, 4]}},
)
contradiction(
    "an observer far faster than the network",
    "The observer decays at 101 1/s, 101 times as fast as the network (1 1/s)",
    {"observer": Observer(rate=101)},
    {"observer": Observer(rate=99)},
)
contradiction(
    "a gain W far faster than the network",
    "The observer decays at 500 1/s, 500 times as fast as the network (1 1/s)",
    {"exosystem": Exosystem(A=[[0]], C=[[1]]), "observer": Observer(W=[[500]])},
    {"exosystem": Exosystem(A=[[0]], C=[[1]]), "observer": Observer(W=[[50]])},
)
contradiction(
    "weights that are mostly error",
    "uncertainty.weights = 0.6 says that every arc weight may be 60 % off, from 0.4 to 1.6 times",
    {"uncertainty": {"weights": "0.6"}},
    {"uncertainty": {"weights": "0.5"}},
)
contradiction(
    "gains that are mostly error",
    "uncertainty.gains = 0.8 says that every gain may be 80 % off",
    {"uncertainty": {"gains": "0.8"}},
    {"uncertainty": {"gains": "0.08"}},
)
contradiction(
    "one sine in hz and in rad/s",
    "The sines of 3.14 and 3.14159 rad/s (0.499747 and 0.5 Hz) differ only over "
    "3.95e+03 s. Is it one sine",
    {"exosystem": TWICE},
    {"exosystem": exosystems.of_parts(hz=["1/2"], frequencies=["3.2"])},
)
contradiction(
    "one number in both units",
    "The disturbance has a sine of 0.5 Hz and one of 0.5 rad/s.",
    {"exosystem": HZ_AND_RAD},
    {"exosystem": exosystems.of_parts(hz=["1/2"], frequencies=["0.51"])},
)
contradiction(
    "agents that do not know errors which nobody states",
    "uncertainty.known_to_agents = false has no effect",
    {"uncertainty": {"known_to_agents": False, "drift": 1}},
    {"uncertainty": {"known_to_agents": False, "weights": "0.1"}},
)
contradiction(
    "a dwell time that no proof uses",
    "switching.dwell = 0.5 s counts in simulations only",
    {"network": TWO_MODES, "switching": Switching(guarantee="arbitrary", dwell="1/2")},
    {"network": TWO_MODES, "switching": Switching(guarantee="dwell", dwell="1/2")},
)
contradiction(
    "an estimation error as large as the region",
    "region.initial_disturbance = 2 is as large as the region itself, which reaches 2 "
    "from the target",
    {"region": {"initial_states": [0, 3], "initial_disturbance": 2}},
    {"region": {"initial_states": [0, 3], "initial_disturbance": "1.9"}},
)


@pytest.mark.parametrize(("wrong", "right", "words"), CASES)
def test_a_contradiction_is_named_with_its_numbers_and_its_twin_is_not(
    wrong: dict[str, Any], right: dict[str, Any], words: str
):
    assert any(words in warning for warning in warnings(Problem(**SOUND | wrong)))
    assert warnings(Problem(**SOUND | right)) == ()


def test_the_bound_of_runs_is_that_of_the_agent_that_is_disturbed_most():
    """Constant 1 and a sine of amplitude 5 (3, 4): 6 together; agents that start at rest reach
    nothing."""
    exosystem = exosystems.total(exosystems.constant(), SINE)
    rows = [[0, 0, 0], [1, 3, 4], [0, 0, 0], [0, 0, 0]]
    given = {
        "exosystem": exosystem,
        "simulation": {"xi0": rows},
        "actuators": {"limit": 5},
        "region": None,
    }
    (warning,) = warnings(Problem(**SOUND | given))
    assert "The actuator limit 5 of agent 2 is below the disturbance, which reaches 6" in warning


def test_an_agent_without_a_disturbance_needs_no_room_for_one():
    """Agent 2 alone is disturbed: by the stated amplitude, or from its start, of amplitude 5."""
    given: dict[str, Any] = {
        "exosystem": None,
        "groups": [Group(agents=[2], exosystem=SINE)],
        "region": None,
    }
    (stated,) = warnings(Problem(**SOUND | given | {"actuators": {"limit": 1, "amplitude": 2}}))
    assert (
        "The actuator limit 1 of agent 2 is below the disturbance, which reaches 2 (actuators"
        in stated
    )
    started = given | {"actuators": {"limit": 1}, "simulation": {"xi0": [[], [3, 4], [], []]}}
    (warning,) = warnings(Problem(**SOUND | started))
    assert (
        "The actuator limit 1 of agent 2 is below the disturbance, which reaches 5 (from" in warning
    )


def test_warnings_come_before_remarks():
    problem = Problem(**SOUND | {"actuators": {"limit": 1, "amplitude": 2}, "target": 9})
    (warning, *_) = warnings(problem)
    text = describe(problem)
    assert 0 < text.index(f"Warning: {warning}") < text.index("Look at this: ")


def test_numbers_that_no_float_holds_stop_no_warning():
    given = {"gains": {4: "1e400"}, "actuators": {"limit": "1e-390", "amplitude": "1e390"}}
    assert any(
        "The actuator limit 1e-390" in warning for warning in warnings(Problem(**SOUND | given))
    )


@pytest.mark.parametrize("name", builtin_names())
def test_the_built_in_problems_warn_of_the_dwell_time_of_their_runs_alone(name: str):
    found = warnings(load_problem(name))
    assert all("counts in simulations only" in warning for warning in found)
    assert len(found) == (name == "paper-switching")
