"""A problem as Python: the script builds an equal problem, without the packages of notebooks."""

import pytest

from dobc_design import Problem, load_problem
from dobc_design.designer.source import python_source

TABLES = {
    "uncertainty": {"disturbance": "1/10", "weights": "1/3", "known_to_agents": False},
    "actuators": {"limit": {"1": 20, "3": "1/3"}, "amplitude": "1/2"},
}


def written(problem: Problem) -> object:
    names: dict[str, object] = {}
    exec(python_source(problem), names)  # noqa: S102 - what the package itself has written
    return names["problem"]


@pytest.mark.parametrize("name", ["paper-fixed", "paper-switching", "uav-swarm"])
def test_the_script_builds_the_same_problem(name: str):
    problem = load_problem(name)
    assert written(problem) == problem


def test_the_tables_about_the_plant_are_written_too():
    problem = load_problem("paper-fixed").replace(**TABLES)
    assert written(problem) == problem
    assert written(problem.replace(actuators={"limit": 30})) != problem


def test_readings_processor_and_time_are_written_too():
    problem = load_problem("clock-sync")
    readings = {"delay": "1/10", "own_delay": "1/100", "lost": 2, "event": "1/3"}
    on_a_processor = problem.replace(readings=readings, processor={"period": "1/50"})
    assert written(on_a_processor) == on_a_processor
    in_steps = problem.replace(time="discrete")
    assert written(in_steps) == in_steps
    assert written(in_steps) != problem
