"""The expression language: contract, "Expressions: a whitelist parser" and "One expression tree".

Oracles: Python's own precedence on exact fractions, SymPy (on the canonical text), mpmath.
"""

import contextlib
import copy
import pickle
import re
import time
from fractions import Fraction
from functools import cache
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy
from couplings import names
from hypothesis import given, settings
from hypothesis import strategies as st
from known_functions import KNOWN
from latex2mathml.converter import convert

from dobc_design.coupling import tree
from dobc_design.coupling.coupling import make_coupling
from dobc_design.coupling.expression import (
    Expression,
    numpy_function,
    parse_expression,
    polynomial_degree,
    to_latex,
    to_text,
    variables_used,
)
from dobc_design.coupling.tree import Node
from dobc_design.errors import ExpressionError, ShapeError
from dobc_design.exact.interval import Interval, UndefinedError

Y, PI = Node("variable", own=0), Node("pi")


def number(value):
    return Node("constant", own=Fraction(value))


def made(kind, *operands):
    return Node(kind, operands)


def power(base, exponent):
    return Node("power", (base,), exponent)


def call(name, *arguments):
    return Node("call", arguments, name)


TREES: list[Any] = [
    ("y", Y),
    ("pi", PI),
    ("y1", Y),
    ("3.2", number("16/5")),
    (".5", number("1/2")),
    ("-y**2", made("negate", power(Y, 2))),
    ("2**-1", power(number(2), -1)),
    ("y**+3", power(Y, 3)),
    ("y**(2)", power(Y, 2)),
    ("(y**2)**3", power(power(Y, 2), 3)),
    ("y**0.5", call("sqrt", Y)),
    ("y**(1/2)", call("sqrt", Y)),
    ("y - 1 - 2", made("subtract", made("subtract", Y, number(1)), number(2))),
    ("y - (1 - 2)", made("subtract", Y, made("subtract", number(1), number(2)))),
    ("y + 2*y", made("add", Y, made("multiply", number(2), Y))),
    ("-y*y", made("multiply", made("negate", Y), Y)),
    ("y*-y", made("multiply", Y, made("negate", Y))),
    (
        "clip(y, -1, 1/2)",
        call("clip", Y, made("negate", number(1)), made("divide", number(1), number(2))),
    ),
    (" \t\r\n( y )\n", Y),
]


@pytest.mark.parametrize(("text", "node"), TREES)
def test_the_language_has_pythons_precedence_and_exact_numbers(text, node):
    """Contract: Python precedence; 3.2 is 16/5."""
    assert parse_expression(text).node == node


def test_vector_expressions_number_their_variables_from_one():
    expression = parse_expression("y3 - y1", dimension=3)
    assert expression.node == made("subtract", Node("variable", own=2), Y)
    assert str(expression) == "y3 - y1"


class _Rational(tree.Operators):
    """Algebra of Fraction, for comparison with Python's own evaluation."""

    def constant(self, value):
        return value

    def call(self, name, arguments):
        return {"abs": abs, "min": min, "max": max}[name](*arguments)


_small = st.integers(0, 12).map(str)


def _grow(inner):
    """Larger expressions of an inner one."""
    in_brackets = inner.map("({})".format)
    joined_parts = st.tuples(inner, st.sampled_from("+-*/"), inner)
    joined = joined_parts.map("".join)
    base = st.one_of(in_brackets, _small, st.just("y"))
    exponents = st.integers(-3, 3)
    powers = st.tuples(base, exponents).map(lambda pair: "{}**{}".format(*pair))
    extreme = st.tuples(st.sampled_from(["min", "max"]), inner, inner)
    extremes = extreme.map(lambda parts: "{}({}, {})".format(*parts))
    negated = inner.map("-{}".format)
    absolute = inner.map("abs({})".format)
    return st.one_of(joined, negated, in_brackets, powers, extremes, absolute)


rational_texts = st.recursive(st.one_of(st.just("y"), _small), _grow, max_leaves=12)


@settings(max_examples=20, deadline=None)
@given(text=rational_texts, y=st.fractions(-3, 3, max_denominator=20))
def test_values_agree_with_pythons_evaluation_in_exact_arithmetic(text, y):
    exact = re.sub(r"(\d+)", r"Fraction(\1)", text)
    known = {"Fraction": Fraction, "y": y, "min": min, "max": max, "abs": abs}
    try:
        expected = eval(exact, known)  # noqa: S307 (the oracle, on text made here)
    except ZeroDivisionError:
        with pytest.raises((ZeroDivisionError, ExpressionError), match=r"zero|Fraction"):
            tree.evaluate(parse_expression(text).node, [y], _Rational())
        return
    try:
        node = parse_expression(text).node
    except ExpressionError as error:
        assert "4096 bits" in str(error)
        return
    assert tree.evaluate(node, [y], _Rational()) == expected


_functions = st.sampled_from(sorted(KNOWN))
_integers = st.integers(1, 10**30).map(str)
_decimals = st.decimals("0.0000000001", "1e20", allow_nan=False, places=8).map(str)
_scientific = st.tuples(st.integers(1, 99), st.integers(-400, 400))
_literals = st.one_of(
    _integers, _decimals, _scientific.map(lambda pair: "{}e{}".format(*pair)), st.just("pi")
)


def _grow_any(inner):
    functions_of = st.tuples(_functions, inner)
    calls = functions_of.map(lambda pair: "{}({})".format(*pair))
    roots = inner.map("({})**0.5".format)
    clipped = inner.map("clip({}, -1, 2.50)".format)
    return st.one_of(_grow(inner), calls, roots, clipped)


_variables = st.sampled_from(["y1", "y2", "y3"])
texts = st.recursive(st.one_of(_variables, _literals), _grow_any, max_leaves=15)


def _parse_or_none(text, dimension=3):
    numbered = text.replace("y**", "y1**").replace("y ", "y1 ")
    try:
        return parse_expression(numbered, dimension=dimension)
    except ExpressionError:
        return None


@settings(max_examples=20, deadline=None)
@given(text=texts)
def test_canonical_and_compact_text_parse_back_to_the_same_tree_and_latex_becomes_mathml(text):
    """Contract: problem.json holds expressions as text."""
    expression = _parse_or_none(text)
    if expression is None:
        return
    again = parse_expression(str(expression), dimension=3)
    assert again.node == expression.node
    assert again == expression
    assert hash(again) == hash(expression)
    assert str(again) == str(expression)
    compact = to_text(expression.node, dimension=3, compact=True)
    assert parse_expression(compact, dimension=3) == expression
    assert len(compact) <= len(str(expression))
    assert "<math" in convert(expression.latex)


CANONICAL: list[Any] = [
    ("exp( y )-1+y", "exp(y) - 1 + y"),
    ("y*(2*3)", "y*(2*3)"),
    ("0.50*y", "0.5*y"),
    ("1e-30*y", "1e-30*y"),
    ("y**.5", "sqrt(y)"),
]


@pytest.mark.parametrize(("text", "canonical"), CANONICAL)
def test_canonical_text_has_no_parenthesis_more_than_it_needs(text, canonical):
    assert str(parse_expression(text)) == canonical


def test_fractions_without_decimals_are_written_as_quotients():
    assert to_text(made("subtract", Y, number("1/3"))) == "y - 1/3"
    assert to_text(power(number("1/3"), 2)) == "(1/3)**2"
    assert to_latex(made("subtract", Y, number("1/3"))) == r"y - \frac{1}{3}"


LATEX: list[Any] = [
    ("exp(y) - 1 + y", "e^{y} - 1 + y"),
    ("y/2", r"\frac{y}{2}"),
    ("2*y", "2 y"),
    ("y*(1 + y)", r"y \cdot \left(1 + y\right)"),
    ("2*(1 + y)", r"2 \left(1 + y\right)"),
    ("sin(y)**2", r"\sin^{2}\left(y\right)"),
    ("log(y)**2", r"\left(\ln\left(y\right)\right)^{2}"),
    ("sin(y)**-2", r"\left(\sin\left(y\right)\right)^{-2}"),
    ("exp(y)**2", r"\left(e^{y}\right)^{2}"),
    ("(1 + y)**3", r"\left(1 + y\right)^{3}"),
    ("1 - -y", r"1 - \left(-y\right)"),
    ("-y*y", r"-y \, y"),
    ("sqrt(abs(y))", r"\sqrt{\left|y\right|}"),
    ("clip(y, -1, 1)", r"\operatorname{clip}\left(y, -1, 1\right)"),
    ("atan(y)*pi", r"\arctan\left(y\right) \, \pi"),
    ("1e-30*y", r"10^{-30} \, y"),
]


@pytest.mark.parametrize(("text", "latex"), LATEX)
def test_latex_is_what_one_would_write_by_hand(text, latex):
    assert parse_expression(text).latex == latex


REFUSED: list[Any] = [
    ("", r'^coupling\.h "": found an empty text; write a function of y'),
    (" \n", "found an empty text"),
    ("y^2", r'found "\^" in column 2; a power is written y\*\*2; did you mean "y\*\*2"\?'),
    (
        "2y + 3y",
        r'found "y" in column 2; here an operator is needed.*did you mean "2\*y \+ 3\*y"\?',
    ),
    ("sin", "found the end in column 4; sin needs its argument"),
    ("ln(y)", r'found "ln" in column 1; it is called log here; did you mean "log\(y\)"\?'),
    ("x + x**2", r'did you mean "y \+ y\*\*2"\?'),
    ("e**y", r"the number e is written exp\(1\)"),
    ("arcsin(y)", "the only inverse functions are atan and asinh"),
    ("arcsinh(y)", r'did you mean "asinh\(y\)"\?'),
    ("sign(y)", "must be continuous"),
    ("y2", "the only variable is y$"),
    ("Y", 'the only variable is y; did you mean "y"'),
    ("(y", r'the "\(" in column 1 is not closed; did you mean "y"\?'),
    ("y)", r'found "\)" in column 2; there is no \( that it closes'),
    ("sin(y, y)", r'"sin" with 2 argument\(s\) in column 1; sin takes 1 argument$'),
    ("clip(y, 1, 0)", "needs lo <= hi"),
    ("clip(y, -pi, pi)", "must be rational constants; for others use min and max"),
    (
        "y**y",
        r'found "y" in column 4; an exponent must be a literal integer from -64 to 64, or 1/2',
    ),
    ("y**2**3", r'found "\*\*" in column 5.*write \(y\*\*2\)\*\*3'),
    ("y**65", 'found "65" in column 4; an exponent'),
    ("y**2.5", 'found "2.5"'),
    ("y**(1+1)", r'found "\+" in column 6; an exponent'),
    ("y**-0.5", r"written 1/sqrt\(y\)"),
    ("y**", "found the end in column 4; an exponent"),
    ("((9**64)**64)*y", r'found "\*\*" in column 9; this constant needs more than 4096 bits'),
    ("1/0*y", 'found "/" in column 2; this divides by zero'),
    ("y/(1 - 1)", "divides by zero"),
    ("0**-1*y", "a negative power of zero has no value"),
    ("1e401*y", 'found "1e401" in column 1; a number has at most 200 characters'),
    ("1.2.3", r'found "\.3" in column 4'),
    ("1_000*y", 'found "_000" in column 2'),
    ("|y|", r"written abs\(y\)"),
    ("y\x00", r'found "\\x00" in column 2; only numbers, names'),
    ("\ud800", r'found "\\ud800" in column 1'),
    ("lambda: y", 'found ":"|operator'),
    ("y" * 2000, "the names are y"),
    (
        "(" * 51 + "y" + ")" * 51,
        'found "\\(" in column 51; parentheses may be nested at most 50 deep',
    ),
    ("(" * 2000, "nested at most 50 deep"),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_what_is_not_in_the_language_is_refused_with_place_and_advice(text, message):
    with pytest.raises(ExpressionError, match=message) as caught:
        parse_expression(text)
    assert caught.value.key == "coupling.h"
    assert len(str(caught.value)) < 500


WRONG_NAMES: list[Any] = [
    ("y", r'the variables are y1 to y3; did you mean "y1"'),
    ("y4", "the variables are y1 to y3$"),
    ("y0", "the variables are y1 to y3$"),
    ("y_2", 'did you mean "y2"'),
    ("", "write a function of y1 to y3"),
]


@pytest.mark.parametrize(("text", "message"), WRONG_NAMES)
def test_vector_expressions_say_which_variables_there_are(text, message):
    with pytest.raises(ExpressionError, match=message):
        parse_expression(text, dimension=3)


def test_more_than_2000_characters_are_refused_unread_and_when_written_out():
    with pytest.raises(ExpressionError, match=r"must have at most 2000 characters.*has 2001"):
        parse_expression("+".join(["y"] * 1001))
    with pytest.raises(ExpressionError, match="must fit into 2000 characters"):
        parse_expression("+".join(["y**.5"] * 333))
    with pytest.raises(ExpressionError, match="50 nested parentheses when"):
        parse_expression("1/(1 + " * 50 + "y**.5" + ")" * 50)


def test_no_guess_is_made_where_too_much_would_have_to_be_repaired():
    with pytest.raises(ExpressionError, match=r"a product is written with \*$"):
        parse_expression("+".join(["2y"] * 13))
    with pytest.raises(ExpressionError, match=r"a power is written y\*\*2$"):
        parse_expression("y^2" + " + y" * 40)


def test_fifty_nested_parentheses_are_read():
    assert parse_expression("(" * 50 + "y" + ")" * 50).node == Y
    nested = parse_expression("sin(" * 50 + "y" + ")" * 50)
    assert len(tree.postorder(nested.node)) == 51
    assert len(tree.postorder(parse_expression("-" * 1999 + "y").node)) == 2000


HOSTILE = [
    "(" * 50 + "9**64" + ")**64" * 50,
    "*".join(["(9**64)"] * 250),
    "/".join(["7**64"] * 300) + "*y",
    "(" * 2000,
]
HOSTILE += ["9**64" + "**64" * 400, "-" * 2000, "y" * 2000, "+".join(["y"] * 1000), "2y" * 1000]
HOSTILE += ["min(" * 500, "1e" * 1000, "y^" * 1000, "1e400" * 400]


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_takes_bounded_time(text):
    start = time.perf_counter()
    with contextlib.suppress(ExpressionError):
        parse_expression(text)
    assert time.perf_counter() - start < 10


def test_a_sum_of_a_thousand_terms_is_no_deeper_than_y():
    """Contract: the limit of 50 is on nesting as the user sees it."""
    expression = parse_expression("+".join(["y"] * 1000))
    assert len(str(expression)) <= 2000
    assert parse_expression(str(expression)) == expression
    assert pickle.loads(pickle.dumps(expression)) == expression
    assert copy.deepcopy(expression) == expression
    assert hash(copy.deepcopy(expression)) == hash(expression)
    assert numpy_function(expression)(2.0) == 2000
    assert polynomial_degree(expression.node) == 1
    assert "y + y" in expression.latex
    assert "y + y" in repr(expression) or "y+y" in repr(expression)


def test_expressions_are_equal_by_tree_and_keep_their_text():
    assert parse_expression("y+1") == parse_expression("(y) + 1.0")
    assert parse_expression("y+1") != parse_expression("1+y")
    assert parse_expression("y") != "y"
    assert Y != "y"
    assert parse_expression("3", dimension=1) != parse_expression("3", dimension=2)
    assert len({parse_expression("y+1"), parse_expression("y + 1")}) == 1
    expression = parse_expression(" 2 * y")
    assert expression.text == " 2 * y"
    assert repr(expression) == "parse_expression('2*y', dimension=1)"
    assert isinstance(expression, Expression)


def test_nodes_cannot_exist_invalid():
    with pytest.raises(ValueError, match="at least 0"):
        number(-1)
    with pytest.raises(ValueError, match="at most 64"):
        power(Y, 65)
    with pytest.raises(ValueError, match="not in the whitelist"):
        call("eval", Y)
    with pytest.raises(ValueError, match="not in the whitelist"):
        call("clip", Y, Y)


DEGREES: list[Any] = [
    ("3*pi", 0),
    ("exp(2)*y - y/3", 1),
    ("(y**3 + 1)**2", 6),
    ("sin(y)", None),
    ("y - sin(y)", None),
    ("sin(y)**2", None),
    ("-y", 1),
    ("y**2 - y**2 + y", 2),
]


@pytest.mark.parametrize(("text", "degree"), DEGREES)
def test_polynomial_degree_is_that_of_the_expression_as_written(text, degree):
    assert polynomial_degree(parse_expression(text).node) == degree


def test_functions_that_are_not_c1_and_variables_are_named():
    """Theory, section 3: |y|, min, max, clip are not C1."""
    assert make_coupling("max(y, 1) + abs(y)/2 - abs(-1)", dimension=1).nonsmooth == ("abs", "max")
    assert make_coupling("-clip(sin(y), -1, 1)**2*min(y, 1)", dimension=1).nonsmooth == (
        "min",
        "clip",
    )
    assert make_coupling("max(1, 2)*y + abs(pi)*y - sqrt(1 + y**2)*y", dimension=1).nonsmooth == ()
    node = parse_expression("y3 + y1*y3", dimension=4).node
    assert variables_used(node) == (0, 2)
    assert variables_used(parse_expression("2").node) == ()


def test_numpy_functions_take_arrays_of_any_shape_and_overflow_without_a_warning():
    scalar = numpy_function(parse_expression("2"))
    vector = numpy_function(parse_expression("y1*y2", dimension=2))
    zeros = np.zeros((2, 3))
    assert scalar(zeros).tolist() == [[2, 2, 2], [2, 2, 2]]
    assert scalar(0).shape == ()
    rows = [[1, 2], [3, 4], [5, 6]]
    assert vector(rows).tolist() == [2, 12, 30]
    with pytest.raises(ShapeError, match=r"last axis of y must have length 2; got shape \(3,\)"):
        vector([1, 2, 3])
    assert numpy_function(parse_expression("exp(y)"))(1e4) == np.inf
    assert np.isnan(numpy_function(parse_expression("log(y)"))(-1.0))
    assert numpy_function(parse_expression("1e400*y - 1e400"))(1.0) != 0
    assert numpy_function(parse_expression("1e-400*y"))(1.0) == 0


mpmath_context = mpmath.mp.clone()
mpmath_context.prec = 400


class _Mpmath(tree.Operators):
    """Algebra of 400-bit floats, the independent oracle for enclosures."""

    def constant(self, value):
        return mpmath_context.mpf(value.numerator) / value.denominator

    def pi(self):
        return +mpmath_context.pi

    def call(self, name, arguments):
        if name == "clip":
            value, low, high = arguments
            return min(max(value, low), high)
        if name in ("min", "max"):
            return min(arguments) if name == "min" else max(arguments)
        (argument,) = arguments
        if name == "abs":
            return abs(argument)
        function = getattr(mpmath_context, name)
        return function(argument)


def _as_mpf(value):
    return mpmath_context.mpf(value.numerator) / value.denominator


def _contains(enclosure, value, slack="1e-80"):
    room = mpmath_context.mpf(slack)
    above = _as_mpf(enclosure.lo) - room
    return above <= value <= _as_mpf(enclosure.hi) + room


SMOOTH = ["y1*y2 - y2**3/(3 + y1**2)", "exp(-y1**2)*sin(y2) + tanh(3*y1 - y2)"]
SMOOTH.append("sqrt(1 + y1**2 + y2**2) - cosh(y2/2)*sinh(y1/3)")
SMOOTH.append("log(7 + y1*y2/2)*tan(y1/4) + (4 + y2)**-3*pi")
WITH_KINKS = ["max(y1, y2, 1/3)*min(y1, -y2) - abs(y1 - y2)"]
WITH_KINKS.append("clip(y1 + y2, -1/2, 1.5) + atan(y1/(2 + cos(y2)))")
_fraction = st.fractions(-2, 2, max_denominator=50)


def _box(ends, at):
    """A box, and points in it: two fractions of its sides for each."""
    first_side = Interval(*sorted(ends[:2]))
    second_side = Interval(*sorted(ends[2:]))
    box = [first_side, second_side]
    points = []
    second_ends = at[1::2]
    for parts in zip(at[::2], second_ends, strict=True):
        points.append([side.lo + t * side.width for side, t in zip(box, parts, strict=True)])
    return box, points


@cache
def derivatives(text):
    """SymPy's variables and the derivatives by them."""
    symbols = sympy.symbols("y1 y2")
    oracle = sympy.sympify(text, locals=names({}), rational=True)
    return symbols, [sympy.diff(oracle, symbol) for symbol in symbols]


_ends = st.tuples(*[_fraction] * 4)
_part = st.fractions(0, 1, max_denominator=9)


@pytest.mark.parametrize("text", SMOOTH)
@settings(max_examples=10, deadline=None)
@given(ends=_ends, at=st.tuples(*[_part] * 2))
def test_gradients_contain_sympys_derivatives_on_the_box(text, ends, at):
    expression = parse_expression(text, dimension=2)
    symbols, wanted = derivatives(text)
    box, (point,) = _box(ends, at)
    algebra = tree.GradientAlgebra(2)
    gradient = tree.evaluate(expression.node, algebra.variables(box), algebra)
    values = {}
    for symbol, x in zip(symbols, point, strict=True):
        values[symbol] = sympy.Rational(x.numerator, x.denominator)
    for derivative, partial in zip(wanted, gradient.partials, strict=True):
        value = derivative.subs(values).evalf(80)
        assert _contains(partial, mpmath_context.mpf(str(value)), slack="1e-70")
    expected = tree.evaluate(expression.node, box, tree.IntervalAlgebra())
    assert gradient.value == expected


@pytest.mark.parametrize("text", WITH_KINKS)
@settings(max_examples=10, deadline=None)
@given(ends=_ends, at=st.tuples(*[_part] * 4))
def test_gradients_with_kinks_contain_a_mean_value_of_every_difference(text, ends, at):
    """Lebourg: f(a) - f(b) = g (a - b) with g in the generalized gradient on the segment."""
    node = parse_expression(text, dimension=2).node
    box, (first, second) = _box(ends, at)
    algebra = tree.GradientAlgebra(2)
    partials = tree.evaluate(node, algebra.variables(box), algebra).partials
    reachable = Interval.point(0)
    for partial, a, b in zip(partials, first, second, strict=True):
        reachable = reachable + partial * (a - b)
    first_point = [_as_mpf(x) for x in first]
    here = tree.evaluate(node, first_point, _Mpmath())
    second_point = [_as_mpf(x) for x in second]
    there = tree.evaluate(node, second_point, _Mpmath())
    assert _contains(reachable, here - there)


def _slope_of(text, low, high):
    algebra = tree.GradientAlgebra(1)
    interval = Interval(Fraction(low), Fraction(high))
    variables = algebra.variables([interval])
    return tree.evaluate(parse_expression(text).node, variables, algebra).slope


SLOPES: list[Any] = []


def slope(text: str, ends: tuple, slope: tuple) -> None:
    SLOPES.append((text, ends, slope))


slope("tanh(y)", (0, 0), (1, 1))
slope("y + y**3", (-2, 2), (1, 13))
slope("y**-2", (1, 2), (-2, "-1/4"))
slope("y**0 + 3", (-1, 1), (0, 0))
slope("abs(y)", (0, 0), (-1, 1))
slope("clip(y, -1, 1)", ("-1/2", "1/2"), (1, 1))
slope("clip(y, -1, 1)", (-2, 2), (0, 1))
slope("min(2*y, y, 7)", (1, "3/2"), (1, 1))
slope("y*abs(y)", (0, 0), (0, 0))
slope("sqrt(y)", (4, 9), ("1/6", "1/4"))
slope("sqrt(0)*y - abs(0)", (0, 1), (0, 0))


@pytest.mark.parametrize(("text", "ends", "slope"), SLOPES)
def test_slopes_are_exact_where_they_are_rational(text, ends, slope):
    """Contract: h'(0) exact where rational; theory, section 3: Clarke bounds at kinks."""
    found = _slope_of(text, *ends)
    expected = Interval(Fraction(slope[0]), Fraction(slope[1]))
    assert found == expected


STEEP = ["(" * 10 + "3*y" + ")**64" * 10, "exp(" * 20 + "y" + ")" * 20]
STEEP.append("sin(1e400*y)*9**64")


@pytest.mark.parametrize("text", STEEP)
@pytest.mark.parametrize("ends", [(Fraction(1, 3),) * 2, (Fraction(-2), Fraction(2))])
def test_intervals_of_hostile_expressions_take_bounded_time(text, ends):
    start = time.perf_counter()
    node = parse_expression(text).node
    with contextlib.suppress(UndefinedError):
        box = [Interval(*ends)]
        tree.evaluate(node, box, tree.IntervalAlgebra())
    assert time.perf_counter() - start < 10
