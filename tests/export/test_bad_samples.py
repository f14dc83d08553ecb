"""Exported C code skips bad samples and counts them; its answers stay those of a loop that missed
them."""

from types import SimpleNamespace

import numpy as np
import pytest
from agents import double_integrators, pendulums, three_states
from c_code import needs_gcc, planar
from c_code_samples import GOOD, KINDS, Program, wrong_cases
from measured import CARTS

from dobc_design.problem.load import load_problem


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("precision", ["double", "float"])
def test_after_bad_inputs_the_answers_are_those_of_a_run_that_missed_them(precision: str, tmp_path):
    """m = 2, q = 3; a packet, a state or an applied input is bad, and the sanitizers watch."""
    program = Program(planar(), tmp_path, period="1/50", precision=precision)
    rng = np.random.default_rng(5)
    assert wrong_cases("planar", program, rng, 40) == []


@needs_gcc
@pytest.mark.parametrize(
    "problem",
    [
        load_problem("paper-fixed"),
        three_states(),
        pendulums(),
        pytest.param(double_integrators(), marks=pytest.mark.slow),
    ],
    ids=["paper-fixed", "plants", "pendulums", "carts"],
)
def test_a_converged_observer_misses_five_samples_and_expects_them_right(problem, tmp_path):
    """The model is exact for a disturbance that its exosystem generates, so the inputs hardly
    change."""
    program = Program(problem, tmp_path, period="1/20", precision="double")

    def spoil(x, heard, limited, u):
        x[-GOOD:][:5] = np.resize(KINDS, (5, 1))

    (found,) = program.run([SimpleNamespace(spoil=spoil)])
    assert found[-1, -1] == 5
    assert np.abs(program.dhat[-GOOD:]).max() > 0.1
    differences = found[:, : program.p]
    assert np.abs(differences - program.u)[-GOOD:].max() < 1e-4


@needs_gcc
@pytest.mark.parametrize("name", ["estimates", pytest.param("outputs", marks=pytest.mark.slow)])
def test_estimates_of_states_live_through_missing_outputs(name, tmp_path):
    """Of any kind of bad y, at the start and later; the sanitizers watch.  ``test_outputs`` has the
    answers."""
    program = Program(CARTS[name], tmp_path, period="1/20", precision="double")
    bad = np.r_[0:3, 80:85]

    def spoil(x, heard, limited, u):
        x[bad] = np.resize(KINDS, (len(bad), 1))

    (found,) = program.run([SimpleNamespace(spoil=spoil)])
    assert np.isfinite(found).all()
    assert found[-1, -1] == len(bad)
    assert not found[:3, : program.p].any()
    apart = np.abs(found[:, : program.p] - program.u)
    assert apart.max() < 0.5 * np.abs(program.u).max()
