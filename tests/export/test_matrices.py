"""Matrices of a problem or certificate in NumPy, SymPy, LaTeX, and CasADi."""

import numpy as np
import pytest
import sympy
from certified import certified

import dobc_design as dd
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.errors import SpecError
from dobc_design.export import python_script
from dobc_design.export.matrices import sdpa_text


def planar() -> Problem:
    """m = 2, two modes, a matrix gain, a formation, h as a list."""
    modes = {"one": [["a", "b"], ["b", "c", "1/4"]], "two": [["a", "c", 2]]}
    network = Network.from_arcs(modes, arrow="listens_to", agents=["a", "b", "c"])
    exosystem = Exosystem(A=[[0, 1], [-1, 0]], C=[[1, 0], [0, 1]])
    return Problem(
        network=network,
        coupling=["2*y1 + y2", "y2**3 + y2"],
        target=[1, -2],
        gains={"a": 3, "c": [[2, 1], [-1, 2]]},
        exosystem=exosystem,
        observer=Observer(W=[[2, 0], [0, 2]]),
        offsets={"b": [1, 0]},
        name="planar",
    )


def test_lambda_is_j_plus_its_transpose_minus_twice_the_gains():
    """(10) without its factor 1/2; J = -(L (x) h'(0)) for one coupling."""
    found = dd.export.to_numpy(planar())
    slope = np.array([[2.0, 1.0], [0.0, 1.0]])
    for mode in ("one", "two"):
        J = -np.kron(found[f"L_{mode}"], slope)
        symmetric = J + J.T - found["K"]
        np.testing.assert_allclose(found[f"Lambda_{mode}"], symmetric - found["K"].T)
        np.testing.assert_allclose(found[f"L_{mode}"].sum(axis=1), 0)
    assert found["L_one"][1, 2] == -0.25
    assert found["xbar"].tolist() == [[1.0], [-2.0]]


@pytest.mark.slow
def test_a_certificate_adds_its_pair_and_sympy_keeps_it_exact():
    """Omega0 of paper-fixed for the certificate's own P, Q is negative definite, exactly."""
    certificate = certified("paper-fixed")
    found = dd.export.to_sympy(certificate)
    lyapunov = found["P"] * found["A"] + found["A"].T * found["P"]
    omega = lyapunov - found["C"].T * found["Q"].T - found["Q"] * found["C"]
    assert (-omega).is_positive_definite
    wanted = [[sympy.Rational(16, 5)], [sympy.Rational(12, 5)]]
    assert found["W"] == sympy.Matrix(wanted)
    y = sympy.Symbol("y", real=True)
    closed_form = sympy.exp(y) - 1 + y
    assert sympy.simplify(found["h"][0] - closed_form) == 0


def test_latex_holds_every_matrix_by_its_name():
    text = dd.export.to_latex("paper-fixed")
    assert text.startswith("\\[ h(y) = e^{y} - 1 + y \\]\n")
    assert r"W = \begin{pmatrix} 3.2 \\ 2.4 \end{pmatrix}" in text
    assert r"\[ \Lambda = \begin{pmatrix}" in text
    arcs = [[i, i + 1] for i in range(1, 14)]
    network = Network.from_arcs(arcs, arrow="listens_to")
    wide = Problem(network=network, coupling="y", gains={"1": 1})
    assert r"\[ L \in \mathbb{R}^{14 \times 14} \]" in dd.export.to_latex(wide)
    assert r"L_{\text{one}}" in dd.export.to_latex(planar())


@pytest.mark.parametrize(
    ("write", "n", "limit"),
    [
        (dd.export.to_numpy, 501, "500 rows"),
        (python_script, 20_001, "20000 arcs"),
        (sdpa_text, 4001, "4000 rows"),
    ],
)
def test_what_is_too_large_for_its_form_is_refused(write, n, limit):
    agents = range(1, n + 1)
    arcs = [[i, i % n + 1] for i in agents]
    ring = Network.from_arcs(arcs, arrow="listens_to", agents=n)
    with pytest.raises(SpecError, match=f"at most {limit}"):
        write(Problem(network=ring, coupling="y", gains={"1": 1}))


def test_casadi_functions_come_by_name():
    loop = dd.export.to_casadi("paper-fixed")
    assert loop.name() == "closed_loop"
    assert loop.size1_in(0) == 10
    function = dd.export.to_casadi(planar(), "h", mode="two")
    assert function.size1_out(0) == 6
    with pytest.raises(SpecError, match="function must be one of h, jacobian"):
        dd.export.to_casadi("paper-fixed", "loop")
