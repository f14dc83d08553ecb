"""What a problem means in words, and slips: each is named, and a sound problem draws no remark."""

import re
from typing import Any

import pytest
from slips import CONSTANT, DAMPED, REMARKED, SINE, UNSEEN, Remarked, sound

from dobc_design import Exosystem, exosystems
from dobc_design.description.meaning import disturbance_words, remarks, time_words
from dobc_design.problem.load import builtin_names, load_problem

DISTURBANCES: list[Any] = []


def disturbance(words: str, exosystem: Exosystem) -> None:
    DISTURBANCES.append((exosystem, words))


disturbance("constant", CONSTANT)
disturbance("constant and ramp", exosystems.ramp())
disturbance("polynomial of degree 2", exosystems.polynomial(2))
disturbance("sine of 2 rad/s (0.3183 Hz, period 3.142 s)", SINE)
HALF_HERTZ = exosystems.harmonics("3.14159265358979")
BOTH = exosystems.total(CONSTANT, HALF_HERTZ)
disturbance("constant + sine of 3.142 rad/s (0.5 Hz, period 2 s)", BOTH)
disturbance("constant and ramp", exosystems.stacked(exosystems.ramp(), CONSTANT))
disturbance("sine of 2 rad/s (0.3183 Hz, period 3.142 s, decaying like exp(-1 t))", DAMPED)
disturbance("a part growing like exp(3 t)", Exosystem(A=[[3]], C=[[1]]))
disturbance("none: no mode of the exosystem appears in d", UNSEEN)


@pytest.mark.parametrize(("exosystem", "words"), DISTURBANCES)
def test_the_disturbance_in_words(exosystem: Exosystem, words: str):
    problem = sound(exosystem=exosystem)
    assert disturbance_words(problem, problem.groups[0]) == words


@pytest.mark.parametrize("slip", REMARKED, ids=lambda slip: slip.id)
def test_a_slip_is_named(slip: Remarked):
    assert slip.words in "\n".join(remarks(sound(**slip.changes)))


STARTS = []
# sqrt(0.3^2 + 0.4^2)
STARTS.append((["3/10", "2/5"], "period 3.142 s, amplitude 0.5 in simulations)"))
OF_EACH = [[0, 0], [0, "1/4"], [0, 0], ["1/8", 0]]
STARTS.append((OF_EACH, "amplitude 0.25 in simulations)"))


@pytest.mark.parametrize(("xi0", "words"), STARTS)
def test_the_amplitude_is_said_where_it_is_known(xi0: Any, words: str):
    problem = sound(simulation={"xi0": xi0})
    assert words in disturbance_words(problem, problem.groups[0])


def test_close_sines_have_amplitudes_of_their_own():
    close = exosystems.harmonics(["1e-7", 10**6, "1000000.5"])
    exosystem = exosystems.total(CONSTANT, close)
    problem = sound(exosystem=exosystem, simulation={"xi0": [3, 1, 0, 1, 0, 5, 0]})
    words = disturbance_words(problem, problem.groups[0])
    assert re.findall(r"(\d+) in simulations", words) == ["3", "1", "1", "5"]


def test_the_time_scales_of_a_chain_are_those_of_its_diagonal():
    """J of the chain is triangular: -1 for who listens, -2 for the pin; the sine has 2 rad/s."""
    words = (
        "fastest 0.5 s (network), slowest 1 s (network); sample and integrate with steps of at "
        "most 0.05 s"
    )
    assert time_words(sound(exosystem=exosystems.harmonics(1))) == words


def test_a_sound_problem_draws_no_remark():
    assert remarks(sound()) == ()


def test_numbers_that_no_float_holds_stop_no_remark():
    exosystem = Exosystem(A=[["1e400"]], C=[[1]])
    run_to = {"t_final": "1e400"}
    huge = sound(exosystem=exosystem, gains={4: "1e400"}, target="1e400", simulation=run_to)
    assert "A sign missing in exosystem.A?" in "".join(remarks(huge))


@pytest.mark.parametrize("name", builtin_names())
def test_the_built_in_problems_draw_no_remark(name: str):
    assert remarks(load_problem(name)) == ()
