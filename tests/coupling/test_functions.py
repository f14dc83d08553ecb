"""The table of functions: enclosures against mpmath, the libraries against each other, the
documentation."""

import math
from fractions import Fraction
from pathlib import Path

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy
from known_functions import KNOWN, OF_SEVERAL, SOFTSIGN

from dobc_design.coupling.enclosures import Curve, jet
from dobc_design.coupling.expression import Expression, numpy_function, parse_expression
from dobc_design.coupling.functions import FUNCTIONS, NONSMOOTH
from dobc_design.coupling.tree import GradientAlgebra, evaluate
from dobc_design.exact.interval import Interval
from dobc_design.export.c_text import CAlgebra, Piece
from dobc_design.model.algebras import CasadiAlgebra, to_sympy

ROOT = Path(__file__).resolve().parents[2]
SMOOTH = [name for name in FUNCTIONS if name not in NONSMOOTH]
IN_LIBRARIES = [name for name in SMOOTH if FUNCTIONS[name].formula is None]
POINTS = (Fraction(1, 10), Fraction(2, 3), Fraction(7, 5))


def near(enclosure: Interval, value: mpmath.mpf) -> bool:
    """Whether the enclosure holds a number of 200 bits and is narrow."""
    low = mpmath.mpf(enclosure.lo.numerator) / enclosure.lo.denominator
    high = mpmath.mpf(enclosure.hi.numerator) / enclosure.hi.denominator
    slack = mpmath.mpf(10) ** -20
    inside = low - slack <= value <= high + slack
    return inside and high - low <= slack * (1 + abs(value))


WRITTEN = [f"{name}(y)" for name in KNOWN]
WRITTEN += ["min(y, 1/2, 2 - y)", "max(y, -y, 0.3)", "clip(2*y, 1/3, 1)", "clip(y, 0.5, 0.5)"]
COMPOSED = [
    "log(1 + y**2)/sqrt(4 - y)",
    "sin(y)*cos(3*y) - tan(y/4)",
    "y**-2",
    "y**7 - y**64/1e12",
    "pi*y/3.2",
]
COMPOSED += [
    "-y**2*(y - 0.25)**5/7",
    "(1 + y**2)**0.5 - 1",
    "1e300*y*1e-300",
    "atan(y)**3 - sinh(y)/cosh(y)",
]


def test_every_function_of_the_language_is_tried():
    assert {*KNOWN, *OF_SEVERAL} == set(FUNCTIONS)


@pytest.mark.parametrize("name", KNOWN)
def test_values_slopes_and_numpy_are_those_of_mpmath(name: str):
    h = parse_expression(f"{name}(y)")
    algebra = GradientAlgebra(1, second=True)
    for y in POINTS:
        point = algebra.variables([Interval.point(y)])
        found = evaluate(h.node, point, algebra)
        with mpmath.workprec(200):
            at = mpmath.mpf(y.numerator) / y.denominator
            value = KNOWN[name].value(at)
            assert near(found.value, value)
            assert near(found.slope, KNOWN[name].slope(at))
            if found.curvature is not None:
                curvature = mpmath.diff(KNOWN[name].slope, at)
                assert near(found.curvature, curvature)
        value_found = numpy_function(h)(float(y))
        assert value_found == pytest.approx(float(value), rel=1e-14)


@pytest.mark.parametrize("text", WRITTEN + COMPOSED)
def test_numpy_casadi_and_sympy_agree(text: str):
    expression = parse_expression(text)
    first_row = [float(y) for y in POINTS]
    points = np.array([first_row, [1.6, 2.2, 3.1]])
    values = numpy_function(expression)(points)
    assert values.shape == points.shape
    by_casadi = casadi_function(expression)
    symbolic, (symbol,) = to_sympy(expression)
    for at, value in zip(points.ravel(), values.ravel(), strict=True):
        assert float(by_casadi(at)) == pytest.approx(value, rel=1e-13)
        by_sympy = symbolic.subs(symbol, sympy.Float(at, 30))
        assert float(by_sympy) == pytest.approx(value, rel=1e-12, abs=1e-14)


def casadi_function(expression: Expression) -> ca.Function:
    y = ca.SX.sym("y")
    value = evaluate(expression.node, [y], CasadiAlgebra())
    return ca.Function("h", [y], [value])


@pytest.mark.parametrize("name", IN_LIBRARIES)
def test_c_and_python_know_the_function_by_the_name_that_is_written(name: str):
    """<math.h> has the names of Python's math module."""
    algebra = CAlgebra("double")
    assert algebra.call(name, (Piece("y", 3),)).text == f"{name}(y)"
    assert algebra.library
    own = getattr(math, name)(0.7)
    by_numpy = FUNCTIONS[name].found_in(np, "numpy")
    assert by_numpy(0.7) == pytest.approx(own, rel=1e-15)


@pytest.mark.parametrize("name", SMOOTH)
def test_the_slope_that_errors_are_carried_on_with_is_not_exceeded(name: str):
    row = FUNCTIONS[name]
    for x in (0.3, 0.9):
        bound = 1.0
        if row.steepest is not None:
            after = np.asarray(x + 0.05)
            bound = row.steepest(np.asarray(x), after)
        for y in np.linspace(x - 0.05, x + 0.05, 21):
            slope = float(mpmath.diff(KNOWN[name].value, y))
            assert abs(slope) <= bound + 1e-9


def test_one_row_is_enough_for_a_function_that_libraries_lack(monkeypatch: pytest.MonkeyPatch):
    """Its formula gives softsign(y) = y/(1 + |y|) wherever a library has no name for it."""
    monkeypatch.setitem(FUNCTIONS, "softsign", SOFTSIGN)
    h = parse_expression("softsign(2*y)")
    by_numpy = numpy_function(h)
    found = by_numpy([-1.0, 0.0, 3.0]).tolist()
    expected = [-2 / 3, 0.0, 6 / 7]
    assert found == expected
    by_casadi = float(casadi_function(h)(3))
    assert by_casadi == pytest.approx(6 / 7)
    symbolic, (symbol,) = to_sympy(h)
    by_sympy = symbolic.subs(symbol, -1)
    assert by_sympy == sympy.Rational(-2, 3)
    piece = [Piece("y", 5)]
    in_c = evaluate(h.node, piece, CAlgebra("double"))
    assert in_c.text == "2.0 * y / (1.0 + dobc_abs(2.0 * y))"
    at_zero = jet(Curve(h), Interval.point(0))
    assert at_zero.value == Interval.point(0)
    assert at_zero.slope == Interval.point(2)


def test_every_function_is_documented():
    text = (ROOT / "docs" / "certificate-format.md").read_text("utf-8")
    assert all(name in text for name in FUNCTIONS)
