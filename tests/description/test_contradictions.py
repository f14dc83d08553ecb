"""What a file states that cannot be kept together, or that changes nothing: warnings with their
numbers."""

from typing import Any

import pytest
from networks import network_of

from dobc_design import Group, Observer, Problem, Switching, exosystems
from dobc_design.description.contradictions import warnings
from dobc_design.description.words import describe
from dobc_design.problem.load import builtin_names, load_problem

CHAIN = [(1, 2), (2, 3), (3, 4)]
WITH_SHORTCUT = [*CHAIN, (1, 3)]
TWO_MODES = network_of({"a": CHAIN, "b": WITH_SHORTCUT}, 4)
SINE = exosystems.harmonics(2)
CONSTANT = exosystems.constant()
SOUND: dict[str, Any] = {
    "network": network_of(CHAIN, 4),
    "coupling": "y",
    "gains": {4: 2},
    "target": 1,
    "exosystem": SINE,
    "region": {"initial_states": [0, 3], "initial_disturbance": 1},
}


def warned(*changes: dict[str, Any]) -> tuple[str, ...]:
    """The warnings of the sound problem with changes."""
    given = SOUND
    for each in changes:
        given = given | each
    return warnings(Problem(**given))


def limits(limit: Any, **amplitude: Any) -> dict[str, Any]:
    return {"actuators": {"limit": limit} | amplitude}


def runs(*xi0: Any) -> dict[str, Any]:
    return {"simulation": {"xi0": list(xi0)}}


def uncertain(**given: Any) -> dict[str, Any]:
    return {"uncertainty": given}


def sines(rad_per_s: str) -> dict[str, Any]:
    """A sine of 0.5 Hz, which is 3.14159 rad/s, and another."""
    return {"exosystem": exosystems.of_parts(hz=["1/2"], frequencies=[rad_per_s])}


def observed(**observer: Any) -> dict[str, Any]:
    return {"observer": Observer(**observer)}


def switched(guarantee: str) -> dict[str, Any]:
    switching = Switching(guarantee=guarantee, dwell="1/2")
    return {"network": TWO_MODES, "switching": switching}


def estimated(error: Any) -> dict[str, Any]:
    return {"region": SOUND["region"] | {"initial_disturbance": error}}


CASES: list[Any] = []


def contradiction(name: str, words: str, wrong: dict, right: dict) -> None:
    """What is wrong is warned of in these words; its twin is not."""
    CASES.append(pytest.param(wrong, right, words, id=name))


BELOW = (
    "The actuator limit 0.5 of every agent is below the disturbance, which reaches 2 "
    "(actuators.amplitude)"
)
contradiction(
    "a limit below the amplitude that is stated",
    BELOW,
    limits("1/2", amplitude=2),
    limits("2.1", amplitude=2),
)
EQUAL = (
    "The actuator limit 2 of every agent equals the disturbance, which reaches 2 "
    "(actuators.amplitude): cancelling"
)
contradiction(
    "a limit that the disturbance takes to the last",
    EQUAL,
    limits(2, amplitude=2),
    limits("2.001", amplitude=2),
)
BELOW_RUNS = (
    "The actuator limit 4 of every agent is below the disturbance, which reaches 5 "
    "(from simulation.xi0)"
)
contradiction(
    "a limit below the amplitude of the runs",
    BELOW_RUNS,
    limits(4) | runs(3, 4),
    limits("5.1") | runs(3, 4),
)
contradiction(
    "a limit of one agent",
    "The actuator limit 1 of agent 3 is below the disturbance",
    limits({1: 9, 3: 1}, amplitude=2),
    limits({1: 9, 3: 3}, amplitude=2),
)
MORE = "The disturbance that simulation.xi0 starts reaches 5, more than actuators.amplitude = 2"
contradiction(
    "runs with more than the stated amplitude",
    MORE,
    limits(9, amplitude=2) | runs(3, 4),
    limits(9, amplitude=5) | runs(3, 4),
)
FAST = "The observer decays at 101 1/s, 101 times as fast as the network (1 1/s)"
contradiction(
    "an observer far faster than the network", FAST, observed(rate=101), observed(rate=99)
)
FAST_W = "The observer decays at 500 1/s, 500 times as fast as the network (1 1/s)"
contradiction(
    "a gain W far faster than the network",
    FAST_W,
    {"exosystem": CONSTANT} | observed(W=[[500]]),
    {"exosystem": CONSTANT} | observed(W=[[50]]),
)
WEIGHTS = (
    "uncertainty.weights = 0.6 says that every arc weight may be 60 % off, from 0.4 to 1.6 times"
)
contradiction(
    "weights that are mostly error", WEIGHTS, uncertain(weights="0.6"), uncertain(weights="0.5")
)
GAINS = "uncertainty.gains = 0.8 says that every gain may be 80 % off"
contradiction("gains that are mostly error", GAINS, uncertain(gains="0.8"), uncertain(gains="0.08"))
ONE_SINE = (
    "The sines of 3.14 and 3.14159 rad/s (0.499747 and 0.5 Hz) differ only over "
    "3.95e+03 s. Is it one sine"
)
contradiction("one sine in hz and in rad/s", ONE_SINE, sines("3.14"), sines("3.2"))
contradiction(
    "one number in both units",
    "The disturbance has a sine of 0.5 Hz and one of 0.5 rad/s.",
    sines("1/2"),
    sines("0.51"),
)
contradiction(
    "agents that do not know errors which nobody states",
    "uncertainty.known_to_agents = false has no effect",
    uncertain(known_to_agents=False, drift=1),
    uncertain(known_to_agents=False, weights="0.1"),
)
contradiction(
    "a dwell time that no proof uses",
    "switching.dwell = 0.5 s counts in simulations only",
    switched("arbitrary"),
    switched("dwell"),
)
LARGE = (
    "region.initial_disturbance = 2 is as large as the region itself, which reaches 2 "
    "from the target"
)
contradiction("an estimation error as large as the region", LARGE, estimated(2), estimated("1.9"))


@pytest.mark.parametrize(("wrong", "right", "words"), CASES)
def test_a_contradiction_is_named_with_its_numbers_and_its_twin_is_not(
    wrong: dict[str, Any], right: dict[str, Any], words: str
):
    assert words in "\n".join(warned(wrong))
    assert warned(right) == ()


def test_the_bound_of_runs_is_that_of_the_agent_that_is_disturbed_most():
    """Constant 1 and a sine of amplitude 5 (3, 4): 6 together; agents that start at rest reach
    nothing."""
    at_rest = [0, 0, 0]
    started = runs(at_rest, [1, 3, 4], at_rest, at_rest)
    both = exosystems.total(CONSTANT, SINE)
    (warning,) = warned(limits(5), started, {"exosystem": both, "region": None})
    assert "The actuator limit 5 of agent 2 is below the disturbance, which reaches 6" in warning


def test_an_agent_without_a_disturbance_needs_no_room_for_one():
    """Agent 2 alone is disturbed: by the stated amplitude, or from its start, of amplitude 5."""
    groups = [Group(agents=[2], exosystem=SINE)]
    alone: dict[str, Any] = {"exosystem": None, "groups": groups, "region": None}
    below = "The actuator limit 1 of agent 2 is below the disturbance, which reaches "

    (stated,) = warned(alone, limits(1, amplitude=2))
    assert below + "2 (actuators" in stated

    (started,) = warned(alone, limits(1), runs([], [3, 4], [], []))
    assert below + "5 (from" in started


def test_warnings_come_before_remarks():
    problem = Problem(**SOUND | limits(1, amplitude=2) | {"target": 9})
    (warning, *_) = warnings(problem)
    text = describe(problem)
    assert 0 < text.index(f"Warning: {warning}") < text.index("Look at this: ")


def test_numbers_that_no_float_holds_stop_no_warning():
    found = warned(limits("1e-390", amplitude="1e390"), {"gains": {4: "1e400"}})
    assert "The actuator limit 1e-390" in "\n".join(found)


@pytest.mark.parametrize("name", builtin_names())
def test_the_built_in_problems_warn_of_the_dwell_time_of_their_runs_alone(name: str):
    found = warnings(load_problem(name))
    assert all("counts in simulations only" in warning for warning in found)
    assert len(found) == (name == "paper-switching")
