"""All diagnostics together, and the eigenvalues at the consensus (theory, known answers)."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from dobc_design.analysis.analysis import MAX_DENSE, analyse, mode_spectrum
from dobc_design.errors import ShapeError
from dobc_design.model.model import build_model
from dobc_design.problem.load import load_problem
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def cycle(gains) -> Problem:
    network = Network.from_arcs([[i + 1, (i + 1) % 10 + 1] for i in range(10)], arrow="listens_to", agents=10)
    return Problem(network=network, coupling="exp(y) - 1 + y", gains=gains)


@pytest.mark.parametrize(
    ("gains", "wanted"),
    [
        ({"1": 3}, -0.153544),
        ({"1": 10**9}, 4 * (math.cos(math.pi / 10) - 1)),
        ({"1": 10, "6": 10}, -0.6637),
        ({str(i): 5 for i in range(1, 10, 2)}, -2.5969),
        (3, -6),
        (None, 0),
    ],
)
def test_lambda_max_on_the_directed_cycle(gains, wanted: float):
    """The table of known answers."""
    assert mode_spectrum(cycle(gains), "G").lambda_max == pytest.approx(wanted, abs=6e-5 if wanted else 1e-12)


def test_lambda_max_of_the_stand_in_modes():
    analysis = analyse(load_problem("paper-switching"))
    wanted = [-0.582300, -0.924166, -1.055728, -1.055728]
    assert [mode.lambda_max for mode in analysis.modes] == pytest.approx(wanted, abs=1e-6)
    assert [facts.mode for facts in analysis.graphs] == ["Ga", "Gb", "Gc", "Gd"]


def test_the_linearised_loop_is_that_of_the_symbolic_model():
    """J(0) - K by CasADi, a complex vector coupling included."""
    network = Network.from_arcs([[1, 2, 3], [2, 3], [3, 1], [1, 3]], arrow="listens_to")
    problem = Problem(
        network=network, coupling=["sin(y1) + y2", "exp(y2) - 1 - y1"], target=[0, 0], gains={"2": [[2, 1], [-1, 1]]}
    )
    spectrum = mode_spectrum(problem, "G")
    error_dynamics = build_model(problem).error_dynamics
    step = 1e-6
    columns = [
        (error_dynamics(step * unit, [])[0] - error_dynamics(-step * unit, [])[0]).full().ravel() / (2 * step)
        for unit in np.eye(6)
    ]
    loop = np.column_stack(columns)
    np.testing.assert_allclose(spectrum.lambda_eigenvalues, np.linalg.eigvalsh(loop + loop.T), atol=1e-8)
    np.testing.assert_allclose(sum(spectrum.loop_eigenvalues), np.trace(loop), atol=1e-8)
    assert spectrum.decay_rate == pytest.approx(-np.linalg.eigvals(loop).real.max(), abs=1e-7)


def test_the_slowest_eigenvalue_of_the_loop_comes_first():
    reals = [s.real for s in mode_spectrum(cycle({"1": 3}), "G").loop_eigenvalues]
    assert reals == sorted(reals, reverse=True)


def test_large_problems_get_no_eigenvalues():
    network = Network.from_arcs([[1, 2]], arrow="listens_to", agents=MAX_DENSE + 1)
    spectrum = mode_spectrum(Problem(network=network, coupling="y"), "G")
    assert spectrum.lambda_eigenvalues is spectrum.loop_eigenvalues is None
    assert spectrum.lambda_max is spectrum.decay_rate is None
    assert "not computed" in str(spectrum)


def test_a_kink_at_zero_gets_no_eigenvalues():
    network = Network.from_arcs([[1, 2]], arrow="listens_to")
    assert mode_spectrum(Problem(network=network, coupling="y + abs(y)"), "G").lambda_max is None


def test_without_an_exosystem_there_is_nothing_to_observe():
    analysis = analyse(cycle(3))
    assert analysis.observability is analysis.spectrum is None


def test_without_a_gain_there_is_no_spectrum_and_a_gain_can_be_handed_over():
    problem = load_problem("clock-sync")
    assert analyse(problem).spectrum is None
    assert analyse(problem, gain=[[2]]).spectrum.rate == pytest.approx(2)
    assert analyse(problem, gain=[[2]]).observability.rank == 1
    with pytest.raises(ShapeError, match="gain must have shape"):
        analyse(problem, gain=[[1, 2]])


def test_an_analysis_says_that_it_proves_nothing():
    analysis = analyse(load_problem("paper-fixed"))
    text = str(analysis)
    assert text.startswith("paper-fixed (diagnostics, not proofs)\n")
    assert "lambda_max(Lambda) = -0.5823, small errors decay at 0.5099 1/s" in text
    assert "diagnostics, not proofs" in analysis._repr_html_()


def test_html_escapes_the_users_names():
    network = Network.from_arcs({"<b>": [["<i>", "x"]]}, arrow="listens_to")
    html = analyse(Problem(network=network, coupling="y", name="<u>"))._repr_html_()
    assert not any(tag in html for tag in ("<u>", "<i>"))
    assert html.count("<b>") == 1


def test_importing_the_diagnostics_loads_no_heavy_package():
    script = """
import sys
import dobc_design.analysis.analysis
sys.exit(" ".join(name for name in ("control", "networkx", "casadi", "matplotlib") if name in sys.modules) or None)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
