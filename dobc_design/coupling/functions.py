"""The functions of the expression language: all that the package knows about a function stands in
its row here.

A new function is a row here, one in checker/expressions.py, its name in docs/certificate-format.md
and a row of what is known about it in tests/support/known_functions.py.  Libraries that no proof
may rest on are named by text only.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import reduce
from math import inf
from operator import methodcaller
from typing import Any, TypeVar

import numpy as np

from dobc_design._checks import noun
from dobc_design.exact import interval
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Array

T = TypeVar("T")


@noun
class Function:
    """A function f of the language.

    What proofs use: ``interval`` encloses f on an interval, from its monotone pieces; of two
    intervals for min and max. ``slope`` encloses f' on x from x and f(x), ``curvature`` f'' from x,
    f(x) and f'(x); without it f is continuous and piecewise rational, but not C1.

    What libraries use: names elsewhere (``numpy``, ``casadi``, ``sympy``, ``c`` for <math.h>) are
    left empty where they are the same; Python texts import NumPy's by the name of the language. A
    function that a library lacks has a ``formula``: an algebra and the arguments give the value by
    other functions. ``steepest`` bounds |f'| in floats between x - r and x + r, asked with x and
    |x| + r; without it the bound is 1.
    """

    name: str
    interval: Callable[..., Interval]
    slope: Callable[[Interval, Interval], Interval] | None = None
    curvature: Callable[[Interval, Interval, Interval], Interval] | None = None
    steepest: Callable[[Array, Array], Any] | None = None
    formula: Callable[..., Any] | None = None
    numpy: str = ""
    casadi: str = ""
    sympy: str = ""
    c: str = ""
    arguments: tuple[int, float] = (1, 1)  # the fewest and the most
    #: Another command than the name, or a text with # for the arguments.
    latex: str = ""
    #: Whether in LaTeX an exponent may follow, at the end or between the command and its arguments.
    takes_powers: bool = True
    #: What users may write for it, to be asked "did you mean".
    others: str = ""

    def found_in(self, module: Any, library: str) -> Callable[..., Any]:
        """Return this function of a module: NumPy for "numpy", CasADi for "casadi", SymPy for
        "sympy"."""
        name = getattr(self, library) or self.name
        found: Callable[..., Any] = getattr(module, name)
        return found


def _root_slope(x: Interval, value: Interval) -> Interval:
    if value.lo <= 0:
        raise UndefinedError(f"sqrt has no bounded slope on {x}.")
    return 1 / (2 * value)


def _sign(x: Interval, value: Interval) -> Interval:
    """The slopes of |x|: both where x may be 0."""
    low = 1 if x.lo > 0 else -1
    high = -1 if x.hi < 0 else 1
    return Interval(Fraction(low), Fraction(high))


def _cosh(x: Array, far: Array) -> Any:
    return np.cosh(far)


def _clip(algebra: Any, x: T, low: T, high: T) -> Any:
    above = algebra.call("max", (x, low))
    return algebra.call("min", (above, high))


_ROWS = (
    Function(
        name="exp",
        interval=interval.exp,
        slope=lambda x, f: f,
        curvature=lambda x, f, s: f,
        steepest=lambda x, far: np.exp(x + (far - np.abs(x))),
        latex="e^{#}",
        takes_powers=False,
    ),
    Function(
        name="log",
        interval=interval.log,
        slope=lambda x, f: 1 / x,
        curvature=lambda x, f, s: -1 / x**2,
        steepest=lambda x, far: 1 / np.maximum(2 * x - far, 0),
        latex=r"\ln",
        takes_powers=False,
        others="ln",
    ),
    Function(
        name="sin",
        interval=interval.sin,
        slope=lambda x, f: interval.cos(x),
        curvature=lambda x, f, s: -f,
    ),
    Function(
        name="cos",
        interval=interval.cos,
        slope=lambda x, f: -interval.sin(x),
        curvature=lambda x, f, s: -f,
    ),
    Function(
        name="tan",
        interval=interval.tan,
        slope=lambda x, f: 1 + f**2,
        curvature=lambda x, f, s: 2 * f * s,
        steepest=lambda x, far: 2 * (1 + np.tan(x) ** 2),
        others="tg",
    ),
    Function(
        name="tanh",
        interval=methodcaller("increasing", "tanh"),
        slope=lambda x, f: 1 - f**2,
        curvature=lambda x, f, s: -2 * f * s,
        others="th",
    ),
    Function(
        name="atan",
        interval=methodcaller("increasing", "atan"),
        slope=lambda x, f: 1 / (1 + x**2),
        curvature=lambda x, f, s: -2 * x * s**2,
        numpy="arctan",
        latex=r"\arctan",
        takes_powers=False,
        others="arctan arctg",
    ),
    Function(
        name="sinh",
        interval=interval.sinh,
        slope=lambda x, f: interval.cosh(x),
        curvature=lambda x, f, s: f,
        steepest=_cosh,
        others="sh",
    ),
    Function(
        name="cosh",
        interval=interval.cosh,
        slope=lambda x, f: interval.sinh(x),
        curvature=lambda x, f, s: f,
        steepest=_cosh,
        others="ch",
    ),
    Function(
        name="asinh",
        interval=methodcaller("increasing", "asinh"),
        slope=lambda x, f: 1 / interval.sqrt(1 + x**2),
        curvature=lambda x, f, s: -x * s**3,
        numpy="arcsinh",
        latex=r"\operatorname{arsinh}",
        takes_powers=False,
        others="arcsinh arsinh",
    ),
    Function(
        name="sqrt",
        interval=interval.sqrt,
        slope=_root_slope,
        curvature=lambda x, f, s: -1 / (4 * f**3),
        steepest=lambda x, far: 0.5 / np.sqrt(np.maximum(2 * x - far, 0)),
        latex=r"\sqrt{#}",
    ),
    Function(
        name="abs",
        interval=abs,
        slope=_sign,
        casadi="fabs",
        sympy="Abs",
        latex=r"\left|#\right|",
        others="fabs",
    ),
    Function(
        name="min",
        interval=interval.minimum,
        numpy="minimum",
        casadi="fmin",
        sympy="Min",
        arguments=(2, inf),
        takes_powers=False,
        others="minimum",
    ),
    Function(
        name="max",
        interval=interval.maximum,
        numpy="maximum",
        casadi="fmax",
        sympy="Max",
        arguments=(2, inf),
        takes_powers=False,
        others="maximum",
    ),
    Function(
        name="clip",
        interval=interval.clip,
        formula=_clip,
        arguments=(3, 3),
        latex=r"\operatorname{clip}",
        takes_powers=False,
        others="sat saturate saturation",
    ),
)
FUNCTIONS = {row.name: row for row in _ROWS}
NONSMOOTH = tuple(row.name for row in _ROWS if row.curvature is None)
OTHER_NAMES = {other: row.name for row in _ROWS for other in row.others.split()}


def applied(name: str, arguments: tuple[T, ...], algebra: Any, call: Callable[..., T]) -> T:
    """Apply a function in an algebra whose library has the others as ``call(name, ...)``, of one
    argument, or of min or max and two: min and max of several are taken one after the other."""
    formula = FUNCTIONS[name].formula
    if formula is not None:
        found: T = formula(algebra, *arguments)
        return found
    if len(arguments) == 1:
        return call(name, arguments[0])
    return reduce(lambda left, right: call(name, left, right), arguments)
