"""[readings], [processor] and dynamics.time: what a file may say, none of which is lost."""

import pickle
from collections.abc import Callable
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dobc_design as dd
from dobc_design import Problem
from dobc_design.description.words import describe, facts
from dobc_design.errors import SpecError
from dobc_design.export import python_script
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
ALWAYS = {"delay": PARTS, "own_delay": PARTS, "event": PARTS}
READINGS = {**ALWAYS, "lost": st.integers(min_value=0, max_value=1000)}
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


def of_text(text: str, file: str = FILE) -> Problem:
    return read_problem_text((file + text).encode(), folder=None)


HELD = "[readings]\nperiod = 0.1\n"
WRONG = [
    ("[readings]\ndelay = -1", r"readings.delay must be >= 0 \(s\); got -1"),
    ("[readings]\nperiod = 0", r"readings.period must be > 0 \(s\); got 0"),
    (f"{HELD}lost = 1.5", "readings.lost must be an integer from 0 to 1000; got 1.5"),
    (f"{HELD}lost = true", "readings.lost must be an integer"),
    (f"{HELD}lost = 1001", "readings.lost must be an integer from 0 to 1000; got 1001"),
    ("[readings]\nevent = 1", r"a relative threshold, >= 0 and < 1; got 1. 25 % is 0.25"),
    ("[readings]\ndelay = '100 ms'", "Write 0.1, without the unit"),
    ("[readings]\nlost = 2", "without a period there is none to be lost"),
    (f"{HELD}own_delay = 101", "readings.own_delay must be at most 1000 periods"),
    ("[processor]", "processor.period is required and missing. Write period = 0.02"),
    ("[processor]\nperiod = -1", r"processor.period must be > 0 \(s\); got -1"),
    (f"[processor]\nperiod = 0.02\n{HELD}", "readings.period is not known together with"),
    ("[processor]\nperiod = 1\n[dynamics]\nA = [[0]]", "dynamics is not known together with"),
    ("[dynamics]\ntime = 'steps'", "dynamics.time must be one of continuous, discrete"),
    ("[dynamics]\ntime = 'discrete'\nA = [[0]]", 'dynamics.time is not known as "discrete"'),
    (f"[dynamics]\ntime = 'discrete'\n{HELD}", "readings.period has no meaning with"),
    ("[dynamics]\ntime = 'discrete'\n[processor]\nperiod = 1", "processor has no meaning with"),
]


@pytest.mark.parametrize(("text", "told"), WRONG)
def test_what_cannot_be_is_refused_by_its_key_with_a_cure(text, told):
    with pytest.raises(SpecError, match=told) as caught:
        of_text(text)
    assert caught.value.cure


def test_disturbances_in_words_are_those_of_continuous_time():
    """In discrete time xi+ = A xi with the A of a constant, 0, would end after one step."""
    file = FILE.partition("[exosystem]")[0]
    steps = '[dynamics]\ntime = "discrete"'
    with pytest.raises(SpecError, match=r"exosystem is known .* in continuous time only"):
        of_text(f"[exosystem]\nconstant = true\n{steps}", file)


PROCESSOR = "[processor]\nperiod = 0.1"
PARTS_OF_THE_PROGRAM: list[Callable[[Problem], object]] = [
    dd.analyse,
    dd.build_model,
    dd.falsify,
    dd.trade_off,
    dd.export.to_sdpa,
    lambda problem: dd.design_pinning(problem, rate=1, cost=2),
    python_script,
]


@pytest.mark.parametrize("part", PARTS_OF_THE_PROGRAM)
def test_what_would_speak_of_another_loop_refuses(part):
    steps = '[dynamics]\ntime = "discrete"'
    cases = {PROCESSOR: "processor", steps: "dynamics.time", "[readings]\ndelay = 0.1": "readings"}
    for text, key in cases.items():
        with pytest.raises(SpecError, match="does not know") as caught:
            part(of_text(text))
        assert caught.value.key == key
        assert caught.value.cure


SAID = [
    ("[readings]", "Warning: [readings] states nothing"),
    ("[readings]\ndelay = 30", "readings.delay = 30 s is longer than the simulation, 20 s."),
    (f"{HELD}delay = 0.05", "readings.delay = 0.05 s is shorter than the period of 0.1 s"),
    ("[readings]\nown_delay = 0.3", "add up to 1.25 1/s; with these readings of itself"),
    ("[processor]\nperiod = 0.9", "proofs allow 1.111 1/s at most"),
    ('[dynamics]\ntime = "discrete"', "proofs allow 1 per step at most"),
    ("[processor]\nperiod = 3.1", "hardly show the sine of 1 rad/s, half a period of which is"),
    ("[processor]\nperiod = 3.3", "(an eigenvalue of A_d - W C Gamma lies outside"),
]


@pytest.mark.parametrize(("text", "told"), SAID)
def test_check_tells_what_may_be_a_slip(text, told):
    assert told in describe(of_text(text))


def test_check_tells_nothing_of_times_that_fit():
    said = describe(of_text(f"{HELD}delay = 0.25\nlost = 2\nevent = 0.1"))
    assert "Look at this" not in said
    assert "Warning" not in said
    timing = (
        "readings of neighbours up to 0.25 s old, 2 readings of a neighbour lost in a row, "
        "readings off by up to 10 % and couplings and pins computed every 0.1 s and held"
    )
    assert f"Timing: {timing}." in said
    assert facts(of_text(f"{HELD}delay = 0.25\nlost = 2\nevent = 0.1"))["timing"] == timing


def test_a_matrix_p_of_continuous_time_has_no_effect_on_a_processor():
    said = describe(of_text(f"P = [[1, 0], [0, 1]]\n{PROCESSOR}"))
    assert "Warning: observer.P has no effect" in said


def test_in_discrete_time_a_disturbance_neither_grows_nor_decays_on_the_unit_circle():
    """A = [[0, 2], [-2, 0]], a sine of 2 rad/s in continuous time, doubles from step to step."""
    steps = '[dynamics]\ntime = "discrete"'
    told = "The eigenvalues of exosystem.A have sizes from 2 to 2"
    assert told in describe(of_text(steps, FILE.replace("1], [-1", "2], [-2")))
    said = describe(of_text(steps))
    assert "The eigenvalues" not in said
    assert "Simulations: 20 steps" in said


def test_a_problem_shows_its_readings_and_its_processor():
    shown = str(of_text(f"{PROCESSOR}\n[readings]\nlost = 3"))
    assert "lost=3" in shown
    assert "Processor(period=1/10)" in shown
    assert "time: discrete" in str(of_text('[dynamics]\ntime = "discrete"'))


def test_a_processor_is_made_by_position_too():
    assert dd.Processor(0.5) == dd.Processor(period="1/2")
    with pytest.raises(SpecError, match="processor needs a period"):
        dd.Processor()


def test_a_settling_time_knows_late_readings_and_no_processor():
    with pytest.raises(SpecError, match="a settling time does not know loops that a processor"):
        dd.certify(of_text(PROCESSOR), settling="1/100")
