"""The tables of what goes together: every path in them is one of a problem, every part is asked."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import dobc_design
from dobc_design import Dynamics, Network, Problem, Switching
from dobc_design.problem.known import _has
from dobc_design.problem.region import GOALS

PACKAGE = Path(dobc_design.__file__).parent
TABLES = tomllib.loads((PACKAGE / "problem" / "known.toml").read_text("utf-8"))
SIGNED = Network.from_arcs(
    [[1, 2, -1], [2, 3], [3, 1]], arrow="listens_to", negative="opposes", agents=3
)
#: Between them they have all tables of a problem, so that a path is walked to its end.
WHOLE = (
    Problem(
        network=SIGNED,
        coupling="y",
        gains={1: 2},
        region={"initial_states": [-1, 1]},
        actuators={"limit": 9, "amplitude": 1},
    ),
    Problem(
        network=Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"),
        coupling="y",
        gains={1: 2},
        dynamics=Dynamics(A=[[0]]),
        switching=Switching(signal="periodic", dwell=1),
        uncertainty={"gains": 0, "disturbance": "1/10"},
        readings={"period": "1/10", "lost": 1},
    ),
)


def paths() -> Iterator[str]:
    for about_such, rules in TABLES["together"].items():
        if about_such not in GOALS:
            yield about_such
        for rule in rules:
            yield from [rule["has"]] if "has" in rule else rule["keys"]
            if "lacks" in rule:
                yield rule["lacks"]
    for unknown in TABLES["unknown"].values():
        yield from unknown


@pytest.mark.parametrize("path", sorted(set(paths())))
def test_every_path_ends_in_a_problem(path: str):
    """A name that is none raises AttributeError; where the last but one is None nothing is read."""
    parent = path.rpartition(".")[0]
    walked = [problem for problem in WHOLE if not parent or _has(problem, parent)]
    assert walked
    for problem in walked:
        _has(problem, path)


def test_a_slip_in_a_path_is_no_silent_leave():
    with pytest.raises(AttributeError, match="saturate"):
        _has(WHOLE[0], "actuators.saturate")


def test_every_part_that_asks_has_its_line_and_every_line_somebody_who_asks():
    asked = set()
    for file in PACKAGE.rglob("*.py"):
        asked |= set(re.findall(r'\.require\(\s*"([^"]+)"', file.read_text("utf-8")))
    assert asked == set(TABLES["unknown"])
    assert set(TABLES["refused"]) == {path for each in TABLES["unknown"].values() for path in each}
