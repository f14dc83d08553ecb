"""The expression tree in CasADi and in SymPy; coupling/test_functions.py compares their values with
NumPy's."""

import casadi as ca
import numpy as np
import pytest
import sympy

from dobc_design.coupling.expression import parse_expression
from dobc_design.coupling.tree import evaluate
from dobc_design.model.algebras import CasadiAlgebra, to_sympy


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_every_kind_of_casadi_symbol_will_do(kind: type):
    y = kind.sym("y", 2)
    node = parse_expression("clip(tanh(y), -1/2, 1/2) + sqrt(1 + y**2)").node
    symbolic = evaluate(node, [y], CasadiAlgebra())
    function = ca.Function("f", [y], [symbolic])
    value = np.asarray(function([0, 3]))
    expected = [1, 0.5 + np.sqrt(10)]
    np.testing.assert_allclose(value.ravel(), expected)


def test_a_constant_beyond_the_floats_is_infinite_as_in_numpy():
    point = [ca.DM(3)]
    value = evaluate(parse_expression("min(y, 1e400)").node, point, CasadiAlgebra())
    assert float(value) == 3


def test_sympy_gets_exact_numbers():
    value, (y,) = to_sympy(parse_expression("3.2*y + pi*y"))
    assert value == sympy.Rational(16, 5) * y + sympy.pi * y


def test_sympy_gets_every_component():
    value, variables = to_sympy(parse_expression("y1*y3 - sin(y2)", dimension=3))
    assert [str(v) for v in variables] == ["y1", "y2", "y3"]
    assert value == variables[0] * variables[2] - sympy.sin(variables[1])
