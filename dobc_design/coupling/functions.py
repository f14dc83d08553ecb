"""The functions of the expression language: all that the package knows about a function stands in
its row here.

A new function is a row here (its LaTeX and other names in the tables below), one in the checker's
expression module, its name in docs/reference/problem-file.md and a test.  Libraries that no proof
may rest on are named by text only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import inf
from operator import methodcaller
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact import interval
from dobc_design.exact.interval import Interval, UndefinedError

T = TypeVar("T")
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Function:
    """A function f of the language.  Names elsewhere are left empty where they are the same; Python
    texts import NumPy's by the name of the language.

    ``interval``: encloses f on an interval, from its monotone pieces; of two intervals for min and
    max. ``slope``: encloses f' on x from x and f(x); ``curvature``: f'' from x, f(x) and f'(x);
    without it f is continuous and piecewise rational, but not C1. ``steepest``: floats x and far >=
    |x| give a bound of |f'| as far around x as far - |x|; without it 1.
    """

    name: str
    interval: Callable[..., Interval]
    slope: Callable[[Interval, Interval], Interval] | None = None
    curvature: Callable[[Interval, Interval, Interval], Interval] | None = None
    steepest: Callable[[Array, Array], Any] | None = None
    numpy: str = ""
    casadi: str = ""
    sympy: str = ""
    c: str = ""
    arguments: tuple[int, float] = (1, 1)  # the fewest and the most

    def found_in(self, module: Any, library: str) -> Callable[..., Any]:
        """Return this function of a module: NumPy for "numpy", CasADi for "casadi", SymPy for
        "sympy"."""
        found: Callable[..., Any] = getattr(module, getattr(self, library) or self.name)
        return found


def _root_slope(x: Interval, value: Interval) -> Interval:
    if value.lo <= 0:
        raise UndefinedError(f"sqrt has no bounded slope on {x}.")
    return 1 / (2 * value)


def _sign(x: Interval, value: Interval) -> Interval:
    return Interval(Fraction(1 if x.lo > 0 else -1), Fraction(-1 if x.hi < 0 else 1))


def _cosh(x: Array, far: Array) -> Any:
    return np.cosh(far)


_ROWS: Final = (
    Function(
        "exp",
        interval.exp,
        lambda x, f: f,
        lambda x, f, s: f,
        lambda x, far: np.exp(x + (far - np.abs(x))),
    ),
    Function(
        "log",
        interval.log,
        lambda x, f: 1 / x,
        lambda x, f, s: -1 / x**2,
        lambda x, far: 1 / np.maximum(2 * x - far, 0),
    ),
    Function("sin", interval.sin, lambda x, f: interval.cos(x), lambda x, f, s: -f),
    Function("cos", interval.cos, lambda x, f: -interval.sin(x), lambda x, f, s: -f),
    Function(
        "tan",
        interval.tan,
        lambda x, f: 1 + f**2,
        lambda x, f, s: 2 * f * s,
        lambda x, far: 2 * (1 + np.tan(x) ** 2),
    ),
    Function(
        "tanh",
        methodcaller("increasing", "tanh"),
        lambda x, f: 1 - f**2,
        lambda x, f, s: -2 * f * s,
    ),
    Function(
        "atan",
        methodcaller("increasing", "atan"),
        lambda x, f: 1 / (1 + x**2),
        lambda x, f, s: -2 * x * s**2,
        numpy="arctan",
    ),
    Function("sinh", interval.sinh, lambda x, f: interval.cosh(x), lambda x, f, s: f, _cosh),
    Function("cosh", interval.cosh, lambda x, f: interval.sinh(x), lambda x, f, s: f, _cosh),
    Function(
        "asinh",
        methodcaller("increasing", "asinh"),
        lambda x, f: 1 / interval.sqrt(1 + x**2),
        lambda x, f, s: -x * s**3,
        numpy="arcsinh",
    ),
    Function(
        "sqrt",
        interval.sqrt,
        _root_slope,
        lambda x, f, s: -1 / (4 * f**3),
        lambda x, far: 0.5 / np.sqrt(np.maximum(2 * x - far, 0)),
    ),
    Function("abs", abs, _sign, casadi="fabs", sympy="Abs"),
    Function(
        "min", interval.minimum, numpy="minimum", casadi="fmin", sympy="Min", arguments=(2, inf)
    ),
    Function(
        "max", interval.maximum, numpy="maximum", casadi="fmax", sympy="Max", arguments=(2, inf)
    ),
    Function("clip", interval.clip, arguments=(3, 3)),
)
FUNCTIONS: Final = {row.name: row for row in _ROWS}
NONSMOOTH: Final = tuple(row.name for row in _ROWS if row.curvature is None)
# In LaTeX, where it is not the name as a command: another command, or a text with # for the
# arguments.
LATEX: Final = {
    "exp": "e^{#}",
    "sqrt": r"\sqrt{#}",
    "abs": r"\left|#\right|",
    "log": r"\ln",
    "atan": r"\arctan",
} | {
    "asinh": r"\operatorname{arsinh}",
    "clip": r"\operatorname{clip}",
}
# After which in LaTeX no exponent may follow, neither at the end nor between the command and its
# arguments.
WITHOUT_POWERS: Final = ("exp", "log", "atan", "asinh", "min", "max", "clip")
# What users may write for a function, to be asked "did you mean".
_OTHERS = (
    "ln:log tg:tan th:tanh sh:sinh ch:cosh arctan:atan arctg:atan arcsinh:asinh arsinh:asinh "
    "fabs:abs"
)
_OTHERS += " minimum:min maximum:max sat:clip saturate:clip"
OTHER_NAMES: Final[dict[str, str]] = dict(pair.split(":") for pair in _OTHERS.split())


def by_twos(name: str, arguments: tuple[T, ...], call: Callable[..., T]) -> T:
    """Call a function through ``call(name, ...)`` of one argument, or of min or max and two.  Min
    and max of several are taken one after the other, clip(x, lo, hi) is min(max(x, lo), hi)."""
    if len(arguments) == 1:
        return call(name, arguments[0])
    if name == "clip":
        inner, low, high = arguments
        return call("min", call("max", inner, low), high)
    return reduce(lambda left, right: call(name, left, right), arguments)


_INVERSES = [name for name in FUNCTIONS if name[0] == "a" and name[1:] in FUNCTIONS]
_ONLY_INVERSE = (
    f"the only inverse function{' is' if len(_INVERSES) == 1 else 's are'} "
    f"{' and '.join(_INVERSES)}"
)
_INVERSES_ELSEWHERE = [
    "atan2",
    *(a + name for name in ("sin", "cos", "sinh", "cosh", "tanh") for a in ("a", "arc")),
]
_STEEP = "a coupling must be continuous; a steep one is tanh(100*y)"
# Names of other languages, and what to write here.
FOREIGN: Final = {
    "e": "the number e is written exp(1), and e**y is exp(y)",
    "log10": "write log(y)/log(10) for log10(y)",
    "log2": "write log(y)/log(2) for log2(y)",
    "expm1": "write exp(y) - 1 for expm1(y)",
    "log1p": "write log(1 + y) for log1p(y)",
    **{
        name: _ONLY_INVERSE
        for name in _INVERSES_ELSEWHERE
        if name not in {*FUNCTIONS, *OTHER_NAMES}
    },
    "sign": _STEEP,
    "sgn": _STEEP,
}
