"""Couplings h with h(0) = 0: theory, sections 0, 1 and 3; contract, "One expression tree".

Oracles: closed forms, SymPy.
"""

import time
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import parse_expression
from dobc_design.errors import ExpressionError, ShapeError, SpecError
from dobc_design.exact.interval import Interval

ZERO = Interval.point(0)


def test_a_single_expression_acts_on_each_component():
    coupling = make_coupling("exp(y) - 1 + y", dimension=3)
    assert coupling.by_component
    assert coupling.dimension == 3
    two = Interval.point(2)
    first_row = (two, ZERO, ZERO)
    assert coupling.jacobian_at_zero() == (first_row, (ZERO, two, ZERO), (ZERO, ZERO, two))
    y = np.array([[0.5, -1.0, 2.0], [0.0, 1e-9, 3.0]])
    expected = np.expm1(y) + y
    np.testing.assert_allclose(coupling.value(y), expected, rtol=1e-6)
    assert coupling.texts == ("exp(y) - 1 + y",)
    assert coupling.latex == ("e^{y} - 1 + y",)
    assert make_coupling(["2*y1"], dimension=1) == make_coupling("2*y", dimension=1)
    assert make_coupling(("2*y",), dimension=1).by_component


def test_a_list_couples_the_components():
    coupling = make_coupling(["y1*y2 + 2*y2", "tanh(y1) - y2/3"], dimension=2)
    assert not coupling.by_component
    assert coupling.texts == ("y1*y2 + 2*y2", "tanh(y1) - y2/3")
    point = Interval.point
    slopes = ((ZERO, point(2)), (point(1), point(Fraction(-1, 3))))
    assert coupling.jacobian_at_zero() == slopes
    y = np.array([[[0.5, -1.0]], [[2.0, 3.0]]])
    first = y[..., 0]
    second = y[..., 1]
    first_part = first * second + 2 * second
    second_part = np.tanh(first) - second / 3
    components = [first_part, second_part]
    expected = np.stack(components, axis=-1)
    np.testing.assert_allclose(coupling.value(y), expected, rtol=1e-14)


LINEAR: list[Any] = [
    (["y1 - y2", "y2"], True),
    (["y1 - y2", "y2*y1"], False),
    ("2*y - y/3", True),
    ("sin(1)*y", True),
    ("0", True),
    ("y + 0*y**2", False),
]


@pytest.mark.parametrize(("h", "linear"), LINEAR)
def test_linear_couplings_are_known_by_their_degree(h, linear):
    assert make_coupling(h, dimension=2).is_linear is linear


def test_kinks_are_named_over_all_components():
    """Theory, section 3: the paper's lemma does not apply to them, the secant statement does."""
    coupling = make_coupling(["max(y1, 0)", "abs(y1) + y2"], dimension=2)
    assert coupling.nonsmooth == ("abs", "max")
    assert make_coupling("exp(y) - 1", dimension=2).nonsmooth == ()
    clip = make_coupling("clip(y, -1, 1)", dimension=1)
    assert clip.jacobian_at_zero() == ((Interval.point(1),),)
    both_sides = Interval(Fraction(-1), Fraction(1))
    size = make_coupling("abs(y)", dimension=1)
    assert size.jacobian_at_zero() == ((both_sides,),)


NO_COUPLINGS: list[Any] = [
    (
        "exp(y) + y",
        r'^coupling\.h "exp\(y\) \+ y" must vanish .* equals 1; did you mean "exp\(y\) '
        r'\+ y - 1"\?$',
    ),
    ("exp(y - 1)", r"must vanish at y = 0 but is about 0\.368\. .* offsets, a goal by"),
    (
        "exp(1 + y) - exp(1)",
        r"cannot be shown to vanish at y = 0 .*rewrite it\. For example exp\(1\)\*",
    ),
    ("log(y)", r"but is undefined there: log is not defined on the whole of \[0, 0\]"),
    ("exp(exp(99 + y)) - 1", "is undefined there: exp of .* too large"),
    (
        "sqrt(y)",
        r"around y = 0 \(seen on \|y\| <= 2\^-40\): sqrt is not defined on .* \[-1/10995116",
    ),
    ("sqrt(abs(y))", "bounded slope around y = 0 .*: sqrt has no bounded slope on"),
]


@pytest.mark.parametrize(("h", "message"), NO_COUPLINGS)
def test_a_coupling_must_vanish_at_zero_and_be_lipschitz_around_it(h, message):
    """Theory, section 0: h_ij(0) = 0 is required and must be checked exactly."""
    with pytest.raises(ExpressionError, match=message) as caught:
        make_coupling(h, dimension=1)
    assert caught.value.key == "coupling.h"


JUST_PASSING = ["exp(1)*(exp(y) - 1)", "sqrt(1 + y) - 1", "y*sin(pi)"]
JUST_PASSING += ["log(1 + y)", "y/(1 + y)", "0*pi"]


@pytest.mark.parametrize("h", JUST_PASSING)
def test_the_twins_that_just_pass(h):
    coupling = make_coupling(h, dimension=1)
    assert coupling.value([0.0]).tolist() == [0.0]


def test_suggestions_are_themselves_accepted():
    for h in ["exp(y) + y", "cos(y) - 3/2", "y - 1/3", "2/3 + y", "cosh(y)/3"]:
        with pytest.raises(ExpressionError, match="did you mean") as caught:
            make_coupling(h, dimension=1)
        cure = str(caught.value).split('did you mean "')[1]
        make_coupling(cure.rstrip('"?'), dimension=1)


MISTYPED: list[Any] = []


def mistyped(error: type, key: str, h: Any, message: str) -> None:
    MISTYPED.append((h, error, key, message))


mistyped(
    ExpressionError, "coupling.h", "y1", r'"y1" in column 1; a single .* list of 2 .* y1 to y2'
)
mistyped(ExpressionError, "coupling.h", "y + y2", 'found "y2" in column 5')
mistyped(
    ShapeError, "coupling.h", ["y1"], r"must have 2 expressions, one per state component; got 1"
)
mistyped(
    ExpressionError,
    "coupling.h",
    3,
    "must be an expression in y, in quotes, or a list of them; got 3",
)
mistyped(ExpressionError, "coupling.h[1]", ["y1", 2], r"must be an expression in text; got int")
mistyped(
    ExpressionError, "coupling.h[1]", ["y1", "y1 + 1"], r'^coupling\.h\[1\] "y1 \+ 1" must vanish'
)
mistyped(ExpressionError, "coupling.h[0]", ["y", "y1"], 'did you mean "y1"')


@pytest.mark.parametrize(("h", "error", "key", "message"), MISTYPED)
def test_errors_name_the_key_as_the_user_typed_it(h, error, key, message):
    with pytest.raises(error, match=message) as caught:
        make_coupling(h, dimension=2)
    assert caught.value.key == key


def test_all_errors_of_a_list_come_at_once():
    with pytest.raises(SpecError, match=r"(?s)h\[0\].*h\[2\]") as caught:
        make_coupling(["y1^2", "y2", "y7"], dimension=3)
    keys = [error.key for error in caught.value.errors]
    assert keys == ["coupling.h[0]", "coupling.h[2]"]
    with pytest.raises(SpecError, match=r"(?s)arcs\[0\].*must vanish.*arcs\[1\].*undefined"):
        make_coupling(["1 + y1", "1/y2"], dimension=2, key="arcs")


def test_a_coupling_cannot_exist_invalid():
    h = parse_expression("2*y")
    bad = parse_expression("2*y + 1")
    pair = tuple(parse_expression(text, dimension=2) for text in ("y1", "y2"))
    assert Coupling(components=pair, by_component=False, dimension=2).dimension == 2
    with pytest.raises(ExpressionError, match="must vanish"):
        Coupling(components=(bad,), by_component=True, dimension=1)
    said = "must be one expression in y, or"
    same = ((h, h), True)
    parsed_twice = ((h, h), False)
    for components, by_component in (same, parsed_twice, (pair, True)):
        with pytest.raises(ShapeError, match=said):
            Coupling(components=components, by_component=by_component, dimension=2)
    with pytest.raises(ShapeError, match=said):
        Coupling(components=(), by_component=True, dimension=1)


def test_many_components_take_bounded_time():
    texts = []
    for i in range(1, 31):
        terms = [f"y{j}*y{i}" for j in range(1, 31)]
        texts.append(" + ".join(terms))
    start = time.process_time()
    make_coupling(texts, dimension=30)
    assert time.process_time() - start < 20


def test_values_have_the_shape_of_their_argument():
    coupling = make_coupling(["0", "y1"], dimension=2)
    y = np.ones((4, 5, 2))
    values = coupling.value(y)
    assert values.shape == (4, 5, 2)
    assert coupling.numpy_function()([1, 2]).tolist() == [0, 1]
    for wrong in (1.0, [1.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(ShapeError, match="last axis of y must have length 2"):
            coupling.value(wrong)
