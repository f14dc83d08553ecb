"""C and FMU of a problem with [processor]: the recursion of the theory, also where packets are
late, lost or no numbers and measurements fail."""

from fractions import Fraction

import pytest
from c_code import needs_gcc
from processor_code import differences, problem

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.export import to_c, to_fmu


@needs_gcc
@pytest.mark.parametrize(
    ("limit", "clean", "delay"), [(0.0, False, 0), (0.0, True, 2), (2.0, False, 0), (2.0, False, 1)]
)
def test_the_code_is_the_recursion_in_long_double(tmp_path, limit, clean, delay):
    """u to 1e-12, and eps+ = (Ad - W C Gamma) eps; bad and late inputs are counted alike, and
    commands that act some samples late are those that the observer counts on."""
    found = differences(tmp_path, steps=20_000, seed=1, limit=limit, clean=clean, delay=delay)
    assert found.u < 1e-12
    assert found.estimate < 1e-12
    assert found.late > 1000
    assert found.skipped > 100


def test_the_code_has_the_gain_and_the_period_of_the_file():
    code = to_c(problem("1/40"))
    W = problem().observer.W
    L = [[float(x) / 40 for x in row] for row in W]
    assert code.controller.period == Fraction(1, 40)
    assert to_float(code.controller.L).tolist() == L
    assert b"#define DOBC_OLDEST 4 " in code.files["dobc_agent.h"]
    assert to_c(problem("1/40"), period="0.025").files == code.files


def test_a_certificate_says_that_it_is_about_this_loop():
    region = dd.Region(initial_states=["9/10", "11/10"], initial_disturbance="1/100")
    own = problem().replace(region=region)
    statement = to_c(own, certificate=dd.certify(own)).statements[-1]
    assert statement.is_proved
    assert "check `readings` proves the loop of this code" in statement.text


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"period": "1/10"}, r"--period must be that of \[processor\], 0.02 s; got 1/10"),
        ({"sampled_gain": [[1], [1]]}, "sampled_gain is period times observer.W"),
    ],
)
@pytest.mark.parametrize("export", [to_c, to_fmu])
def test_what_the_file_says_is_not_said_otherwise(export, asked, says):
    with pytest.raises(SpecError, match=says):
        export(problem(), **asked)


def test_a_period_at_which_the_recursion_diverges_is_refused_by_its_key():
    with pytest.raises(SpecError, match=r"processor.period of 1 s is too long: the sampled"):
        to_c(problem("1"))


def test_agents_in_steps_have_no_code():
    steps = dd.Problem(
        network=dd.Network.from_arcs([[1, 2, "1/4"]], arrow="listens_to"),
        coupling="y",
        gains={2: "1/2"},
        time="discrete",
    )
    with pytest.raises(SpecError, match="C code does not know agents that move in steps"):
        to_c(steps)
