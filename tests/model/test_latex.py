"""The equations as LaTeX: what is there, what is left out, and that it can become MathML."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from dobc_design._render import latex_text, mathml
from dobc_design.model.latex import latex
from dobc_design.spec.builtin import builtin_names
from dobc_design.spec.load import load_problem
from dobc_design.spec.network import Network
from dobc_design.spec.problem import Problem


def pair(**settings) -> Problem:
    return Problem(**({"network": Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to"), "coupling": "y"} | settings))


def test_the_papers_equations():
    equations = latex(load_problem("paper-fixed"))
    assert equations.couplings == ("h(y) = e^{y} - 1 + y",)
    assert equations.agents == r"\dot{x}_i = \sum_{j \in N_i} h\left(x_j - x_i\right) + u_i + d_i"
    assert equations.exosystem == r"\dot{\xi}_i = A \xi_i, \quad d_i = C \xi_i"
    assert equations.observer[0].startswith(r"\dot{z}_i = (A - W C)(z_i + W x_i) - W \left(\sum")
    assert equations.control == r"u_i = -k_i \left(x_i - \bar{x}\right) - \hat{d}_i"
    assert equations.data[-1] == r"W = \begin{pmatrix} \frac{16}{5} \\ \frac{12}{5} \end{pmatrix}"


@pytest.mark.parametrize("name", builtin_names())
def test_every_line_of_the_built_in_problems_becomes_mathml(name: str):
    for line in latex(load_problem(name)).lines:
        assert ElementTree.fromstring(mathml(line)).tag.endswith("math")


def test_without_an_exosystem_there_is_no_observer():
    equations = latex(pair(gains=1))
    assert equations.exosystem is None
    assert equations.observer == ()
    assert "d" not in equations.agents.replace(r"\dot", "").replace(r"\left", "").replace(r"\right", "")
    assert equations.control == r"u_i = -k_i \left(x_i - \bar{x}\right)"


def test_a_formation_shows_its_offsets():
    equations = latex(pair(offsets={"1": 2}))
    assert r"h\left((x_j - r_j) - (x_i - r_i)\right)" in equations.agents
    assert r"x_i - \bar{x} - r_i" in equations.control


def test_weights_and_switching_are_shown_where_there_are_any():
    network = Network.from_arcs({"a": [[1, 2, 3]], "b": [[2, 1]]}, arrow="listens_to")
    assert r"\sum_{j \in N_i(t)} w_{ij}\, h\left(" in latex(pair(network=network)).agents


def test_exceptions_name_their_arcs():
    equations = latex(pair(exceptions={(0, 1): "sin(y)"}))
    assert len(equations.couplings) == 2
    assert equations.couplings[1].endswith(r"\quad (i, j) \in \{(\text{1}, \text{2})\}")


def test_vector_couplings_stand_in_a_column():
    equations = latex(pair(coupling=["y1*y2 + y1", "y2"], target=[0, 0]))
    assert equations.couplings == (r"h(y) = \begin{pmatrix} y_{1} \, y_{2} + y_{1} \\ y_{2} \end{pmatrix}",)


def test_a_gain_handed_over_is_shown():
    lines = latex(load_problem("uav-swarm"), gain=[[1, 0, 0]] * 6).lines
    assert any(line.startswith("W = ") for line in lines)
    assert not any(line.startswith("W = ") for line in latex(load_problem("uav-swarm")).lines)


def test_labels_are_escaped():
    assert latex_text("uav-1") == r"\text{uav-1}"
    assert latex_text("a_b}") == r"\text{a}\_ \text{b}\}"
    assert latex_text("\\input") == r"\backslash \text{input}"
    assert "<b>" not in mathml(latex_text("<b>"))


def test_the_equations_show_themselves():
    assert latex(pair())._repr_latex_().startswith("$$\\begin{gathered}")
