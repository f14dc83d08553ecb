"""What is known about every function of the expression language, apart from the package: its value,
its slope and an example for compositions.

A new function gets a row here; the tests of both programs and the random couplings take it from
here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mpmath
import sympy

from dobc_design.coupling.functions import Function
from dobc_design.exact.interval import Interval

Real = Callable[[Any], Any]


@dataclass(frozen=True, kw_only=True)
class Known:
    """A function of one argument and its slope, of mpmath's numbers."""

    value: Real
    slope: Real
    example: str  # defined wherever # lies between -2 and 2
    symbolic: Real | None = None  # for SymPy, where it does not know the name


KNOWN: dict[str, Known] = {
    "exp": Known(value=mpmath.exp, slope=mpmath.exp, example="exp(#)"),
    "log": Known(value=mpmath.log, slope=lambda x: 1 / x, example="log(3 + #)"),
    "sin": Known(value=mpmath.sin, slope=mpmath.cos, example="sin(3*#)"),
    "cos": Known(value=mpmath.cos, slope=lambda x: -mpmath.sin(x), example="cos(2*#)"),
    "tan": Known(value=mpmath.tan, slope=lambda x: 1 + mpmath.tan(x) ** 2, example="tan(#/2)"),
    "tanh": Known(value=mpmath.tanh, slope=lambda x: 1 / mpmath.cosh(x) ** 2, example="tanh(2*#)"),
    "atan": Known(value=mpmath.atan, slope=lambda x: 1 / (1 + x * x), example="atan(#)"),
    "sinh": Known(value=mpmath.sinh, slope=mpmath.cosh, example="sinh(#)"),
    "cosh": Known(value=mpmath.cosh, slope=mpmath.sinh, example="cosh(#)"),
    "sqrt": Known(
        value=mpmath.sqrt, slope=lambda x: 1 / (2 * mpmath.sqrt(x)), example="sqrt(3 + #)"
    ),
    "abs": Known(value=abs, slope=mpmath.sign, example="abs(#)", symbolic=sympy.Abs),
    "asinh": Known(
        value=mpmath.asinh, slope=lambda x: 1 / mpmath.sqrt(1 + x * x), example="asinh(2*#)"
    ),
}
#: A function that no library has, and that the language does not have either.
SOFTSIGN = Function(
    name="softsign",
    interval=lambda x: x / (1 + abs(x)),
    slope=lambda x, f: 1 / (1 + abs(x)) ** 2,
    curvature=lambda x, f, s: Interval(-2, 2) / (1 + abs(x)) ** 3,
    formula=lambda algebra, x: algebra.divide(
        x, algebra.add(algebra.constant(Fraction(1)), algebra.call("abs", (x,)))
    ),
)
#: Examples of those with several arguments.
OF_SEVERAL = {"min": "min(#, 1/2)", "max": "max(#, -1/3)", "clip": "clip(#, -1/2, 3/4)"}
