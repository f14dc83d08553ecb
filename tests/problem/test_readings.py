"""[readings], [processor] and dynamics.time: what a file may say, none of which is lost."""

import pickle
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dobc_design import Problem
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.changes import changed_problem, problem_text
from dobc_design.problem.load import read_problem_text

FILE = """
[network]
agents = 2
arrow = "listens_to"
modes.G = [[2, 1], [1, 2]]
[coupling]
h = "y"
[pinning]
gains = { 1 = "1/4" }
[exosystem]
A = [[0, 1], [-1, 0]]
C = [[1, 0]]
[observer]
W = [[1], [0]]
"""

PARTS = st.fractions(min_value=0, max_value=Fraction(9, 10), max_denominator=1000)
PERIODS = st.fractions(min_value=Fraction(1, 1000), max_value=3, max_denominator=1000)
READINGS = {
    "delay": PARTS,
    "own_delay": PARTS,
    "lost": st.integers(min_value=0, max_value=1000),
    "event": PARTS,
}
#: Without a period no reading is lost.
ALWAYS = {key: part for key, part in READINGS.items() if key != "lost"}
#: One of the three ways in which time may go: always, held, or on a processor; and in steps.
TABLES = st.one_of(
    st.fixed_dictionaries({"readings": st.fixed_dictionaries({}, optional=ALWAYS)}),
    st.fixed_dictionaries(
        {"readings": st.fixed_dictionaries({"period": PERIODS}, optional=READINGS)}
    ),
    st.fixed_dictionaries(
        {"processor": st.fixed_dictionaries({"period": PERIODS})},
        optional={"readings": st.fixed_dictionaries({}, optional=READINGS)},
    ),
    st.fixed_dictionaries(
        {"dynamics": st.just({"time": "discrete"})},
        optional={"readings": st.fixed_dictionaries({}, optional=READINGS)},
    ),
)


def text_of(tables) -> str:
    lines = [FILE]
    for table, keys in tables.items():
        lines.append(f"[{table}]")
        for key, value in keys.items():
            number = str(value) if isinstance(value, int) else f'"{value}"'
            lines.append(f"{key} = {number}")
    return "\n".join(lines)


def read(tables) -> Problem:
    return read_problem_text(text_of(tables).encode(), folder=None)


@given(tables=TABLES)
@settings(max_examples=60, deadline=None)
def test_every_way_to_write_a_problem_keeps_its_readings_and_its_time(tables):
    problem = read(tables)
    data = canonical_bytes(problem)
    again = (
        problem_from_canonical(data),
        read_problem_text(problem_text(problem).encode(), folder=None),
        pickle.loads(pickle.dumps(problem)),
        problem.replace(name=problem.name),
        changed_problem(problem, {}),
    )
    for other in again:
        assert other == problem
        assert canonical_bytes(other) == data
    bare = problem.replace(readings=None, processor=None, time=None)
    assert bare == read({})
    assert canonical_bytes(bare) != data


HELD = {"readings": {"period": "1/10"}}
TICKS = {"processor": {"period": "1/10"}}
STEPS = {"dynamics": {"time": "discrete"}}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"readings": {"lost": 2}}, r"readings\.lost is counted in periods, and there is none"),
        (HELD | TICKS, r"readings\.period is that of the \[processor\]"),
        (STEPS | TICKS, r"processor is not known with dynamics\.time"),
        (STEPS | HELD, r"readings\.period is not known with dynamics\.time"),
    ],
)
def test_two_periods_and_readings_lost_at_no_tick_are_refused(tables, message):
    with pytest.raises(SpecError, match=message):
        read(tables)
    for ticks in (TICKS, STEPS):
        read(ticks | {"readings": {"lost": 2}})
