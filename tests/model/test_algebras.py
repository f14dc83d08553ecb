"""The expression tree in CasADi and in SymPy means what it means in NumPy."""

import re

import casadi as ca
import numpy as np
import pytest
import sympy

from dobc_design.coupling.expression import numpy_function, parse_expression
from dobc_design.coupling.tree import evaluate
from dobc_design.model.model import CasadiAlgebra, to_sympy

TEXTS = re.split(
    r";\s",
    """exp(y) - 1 + y; log(1 + y**2); sin(y)*cos(3*y); tan(y/4); 2*tanh(y/2); atan(y)**3; sinh(y); cosh(y) - 1;
sqrt(1 + y**2); abs(y); min(y, 2*y, 1); max(y, -1, -y/3); clip(y, -1, 1/2); y**-2; y**7 - y**64/1e12; -y**2;
pi*y/3.2; (1 + y**2)**0.5 - 1; (y**2)**(1/2); 1e300*y*1e-300; y - 2/3*y/(4 + y**2)""",
)
POINTS = np.array([-1.9, -1.0, -0.3, 0.2, 0.5, 1.0, 1.7])


@pytest.mark.parametrize("text", TEXTS)
def test_casadi_agrees_with_numpy(text: str):
    expression = parse_expression(text)
    y = ca.SX.sym("y", len(POINTS))
    value = ca.Function("f", [y], [evaluate(expression.node, [y], CasadiAlgebra())])(POINTS)
    np.testing.assert_allclose(np.asarray(value).ravel(), numpy_function(expression)(POINTS), rtol=1e-13)


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_every_kind_of_casadi_symbol_will_do(kind: type):
    y = kind.sym("y", 2)
    node = parse_expression("clip(tanh(y), -1/2, 1/2) + sqrt(1 + y**2)").node
    value = ca.Function("f", [y], [evaluate(node, [y], CasadiAlgebra())])([0, 3])
    np.testing.assert_allclose(np.asarray(value).ravel(), [1, 0.5 + np.sqrt(10)])


def test_a_constant_beyond_the_floats_is_infinite_as_in_numpy():
    value = evaluate(parse_expression("min(y, 1e400)").node, [ca.DM(3)], CasadiAlgebra())
    assert float(value) == 3


@pytest.mark.parametrize("text", TEXTS)
def test_sympy_agrees_with_numpy(text: str):
    expression = parse_expression(text)
    value, (y,) = to_sympy(expression)
    exact = [float(value.subs(y, sympy.Rational(str(point))).evalf(30)) for point in POINTS]
    np.testing.assert_allclose(exact, numpy_function(expression)(POINTS), rtol=1e-12)


def test_sympy_gets_exact_numbers():
    value, (y,) = to_sympy(parse_expression("3.2*y + pi*y"))
    assert value == sympy.Rational(16, 5) * y + sympy.pi * y


def test_sympy_gets_every_component():
    value, variables = to_sympy(parse_expression("y1*y3 - sin(y2)", dimension=3))
    assert [str(v) for v in variables] == ["y1", "y2", "y3"]
    assert value == variables[0] * variables[2] - sympy.sin(variables[1])
