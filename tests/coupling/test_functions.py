"""The table of functions: enclosures against mpmath, the libraries against each other, the documentation."""

import math
from fractions import Fraction
from pathlib import Path

import casadi as ca
import mpmath
import numpy as np
import pytest
import sympy

from dobc_design.coupling.enclosures import Curve, profile, slope_form, tight_range, value_form
from dobc_design.coupling.expression import numpy_function, parse_expression
from dobc_design.coupling.functions import FUNCTIONS, NONSMOOTH
from dobc_design.coupling.tree import GradientAlgebra, evaluate
from dobc_design.exact.interval import Interval
from dobc_design.export.c_text import CAlgebra, Piece
from dobc_design.model.model import CasadiAlgebra, to_sympy

ROOT = Path(__file__).resolve().parents[2]
SMOOTH = [name for name in FUNCTIONS if name not in NONSMOOTH]
POINTS = (Fraction(1, 10), Fraction(2, 3), Fraction(7, 5))


def near(enclosure: Interval, value: mpmath.mpf) -> bool:
    """Whether the enclosure holds a number of 200 bits and is narrow."""
    low, high = (mpmath.mpf(x.numerator) / x.denominator for x in (enclosure.lo, enclosure.hi))
    slack = mpmath.mpf(10) ** -20
    return low - slack <= value <= high + slack and high - low <= slack * (1 + abs(value))


@pytest.mark.parametrize("name", SMOOTH)
def test_value_slope_and_curvature_are_those_of_mpmath(name: str):
    function, algebra = getattr(mpmath, name), GradientAlgebra(1, second=True)
    node = parse_expression(f"{name}(y)").node
    with mpmath.workprec(200):
        for y in POINTS:
            found = evaluate(node, algebra.variables((Interval.point(y),)), algebra)
            at = mpmath.mpf(y.numerator) / y.denominator
            assert near(found.value, function(at))
            assert near(found.slope, mpmath.diff(function, at))
            assert near(found.curvature, mpmath.diff(function, at, 2))


@pytest.mark.parametrize("name", SMOOTH)
def test_an_interval_holds_every_value_and_slope_on_it(name: str):
    """At eleven points of [0.1, 1.4]; the ranges are tight at their ends."""
    curve, Y = Curve(parse_expression(f"{name}(y)")), Interval(POINTS[0], POINTS[-1])
    values, slopes = tight_range(curve, value_form, Y), tight_range(curve, slope_form, Y)
    grid = [float(Y.lo + k * Y.width / 10) for k in range(11)]
    function = getattr(mpmath, name)
    truth = [float(function(y)) for y in grid], [float(mpmath.diff(function, y)) for y in grid]
    for enclosed, seen in zip((values, slopes), truth, strict=True):
        assert float(enclosed.lo) - 1e-5 <= min(seen) <= max(seen) <= float(enclosed.hi) + 1e-5
        assert float(enclosed.width) <= (max(seen) - min(seen)) * 1.2 + 1e-4


@pytest.mark.parametrize("name", FUNCTIONS)
def test_numpy_casadi_and_sympy_agree(name: str):
    text = {"min": "min(y, 1/2, 2 - y)", "max": "max(y, 1/2, 2 - y)", "clip": "clip(y, 1/3, 1)"}.get(name, f"{name}(y)")
    expression = parse_expression(text)
    points = np.array([float(y) for y in POINTS])
    values = numpy_function(expression)(points)
    y = ca.SX.sym("y")
    by_casadi = ca.Function("h", [y], [evaluate(expression.node, [y], CasadiAlgebra())])
    symbolic, (symbol,) = to_sympy(expression)
    for at, value in zip(points, values, strict=True):
        assert float(by_casadi(at)) == pytest.approx(value, rel=1e-14)
        assert float(symbolic.subs(symbol, sympy.Float(at, 30))) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("name", SMOOTH)
def test_c_and_python_know_the_function_by_the_name_that_is_written(name: str):
    """<math.h> has the names of Python's math module."""
    algebra = CAlgebra("double")
    assert algebra.call(name, (Piece("y", 3),)).text == f"{name}(y)"
    assert algebra.library
    own = getattr(math, name)(0.7)
    assert FUNCTIONS[name].found_in(np, "numpy")(0.7) == pytest.approx(own, rel=1e-15)


@pytest.mark.parametrize("name", SMOOTH)
def test_the_slope_that_errors_are_carried_on_with_is_not_exceeded(name: str):
    row = FUNCTIONS[name]
    for x in (0.3, 0.9):
        around = np.linspace(x - 0.05, x + 0.05, 21)
        most = max(abs(float(mpmath.diff(getattr(mpmath, name), y))) for y in around)
        assert most <= (1.0 if row.steepest is None else row.steepest(np.asarray(x), np.asarray(x + 0.05))) + 1e-9


@pytest.mark.parametrize("name", ["tanh", "atan", "sinh", "asinh", "tan"])
def test_increasing_functions_are_found_increasing(name: str):
    assert profile(Curve(parse_expression(f"{name}(y)")), Fraction(1)).is_nondecreasing


def test_every_function_is_documented():
    text = (ROOT / "docs" / "certificate-format.md").read_text("utf-8")
    assert all(name in text for name in FUNCTIONS)
