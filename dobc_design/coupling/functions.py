"""The functions of the expression language, one row for each: all that the package knows about a function stands there.

A new function is a row here, one in the checker's expression module, its name in the documentation
(docs/reference/problem-file.md) and a test.  Libraries that no proof may rest on are named by text only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import inf
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact import interval
from dobc_design.exact.interval import Interval, UndefinedError

T = TypeVar("T")
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """A function f of the language.  Names elsewhere are left empty where they are the same; Python texts
    import NumPy's by the name of the language.

    ``interval``: encloses f on an interval, from its monotone pieces; of two intervals for min and max.
    ``slope``: encloses f' on x from x and f(x); ``curvature``: f'' from x, f(x) and f'(x).
    ``steepest``: floats x and far >= |x| give a bound of |f'| as far around x as far - |x|; without it 1.
    ``latex``: a command, or a text with # for the arguments; ``powers``: an exponent may follow directly, or stand
    between the command and its arguments.
    """

    name: str
    interval: Callable[..., Interval]
    slope: Callable[[Interval, Interval], Interval] | None = None
    curvature: Callable[[Interval, Interval, Interval], Interval] | None = None
    steepest: Callable[[Array, Array], Any] | None = None
    latex: str
    powers: bool = False
    numpy: str = ""
    casadi: str = ""
    sympy: str = ""
    c: str = ""
    other_names: tuple[str, ...] = ()  # what users may write for it, to be asked "did you mean"
    arguments: tuple[int, float] = (1, 1)  # the fewest and the most
    is_smooth: bool = True  # else continuous, piecewise rational, not C1

    def found_in(self, module: Any, library: str) -> Callable[..., Any]:
        """Return this function of a module: NumPy for "numpy", CasADi for "casadi", SymPy for "sympy"."""
        found: Callable[..., Any] = getattr(module, getattr(self, library) or self.name)
        return found


def _root_slope(x: Interval, value: Interval) -> Interval:
    if value.lo <= 0:
        raise UndefinedError(f"sqrt has no bounded slope on {x}.")
    return 1 / (2 * value)


def _sign(x: Interval, value: Interval) -> Interval:
    return Interval(Fraction(1 if x.lo > 0 else -1), Fraction(-1 if x.hi < 0 else 1))


_ROWS: Final = (
    Function(
        name="exp",
        interval=interval.exp,
        slope=lambda x, value: value,
        curvature=lambda x, value, slope: value,
        steepest=lambda x, far: np.exp(x + (far - np.abs(x))),
        latex="e^{#}",
    ),
    Function(
        name="log",
        interval=interval.log,
        slope=lambda x, value: 1 / x,
        curvature=lambda x, value, slope: -1 / x**2,
        steepest=lambda x, far: 1 / np.maximum(2 * x - far, 0),
        latex=r"\ln",
        other_names=("ln",),
    ),
    Function(
        name="sin",
        interval=interval.sin,
        slope=lambda x, value: interval.cos(x),
        curvature=lambda x, value, slope: -value,
        latex=r"\sin",
        powers=True,
    ),
    Function(
        name="cos",
        interval=interval.cos,
        slope=lambda x, value: -interval.sin(x),
        curvature=lambda x, value, slope: -value,
        latex=r"\cos",
        powers=True,
    ),
    Function(
        name="tan",
        interval=interval.tan,
        slope=lambda x, value: 1 + value**2,
        curvature=lambda x, value, slope: 2 * value * slope,
        steepest=lambda x, far: 2 * (1 + np.tan(x) ** 2),
        latex=r"\tan",
        powers=True,
        other_names=("tg",),
    ),
    Function(
        name="tanh",
        interval=interval.tanh,
        slope=lambda x, value: 1 - value**2,
        curvature=lambda x, value, slope: -2 * value * slope,
        latex=r"\tanh",
        powers=True,
        other_names=("th",),
    ),
    Function(
        name="atan",
        interval=interval.atan,
        slope=lambda x, value: 1 / (1 + x**2),
        curvature=lambda x, value, slope: -2 * x * slope**2,
        latex=r"\arctan",
        numpy="arctan",
        other_names=("arctan", "arctg"),
    ),
    Function(
        name="sinh",
        interval=interval.sinh,
        slope=lambda x, value: interval.cosh(x),
        curvature=lambda x, value, slope: value,
        steepest=lambda x, far: np.cosh(far),
        latex=r"\sinh",
        powers=True,
        other_names=("sh",),
    ),
    Function(
        name="cosh",
        interval=interval.cosh,
        slope=lambda x, value: interval.sinh(x),
        curvature=lambda x, value, slope: value,
        steepest=lambda x, far: np.cosh(far),
        latex=r"\cosh",
        powers=True,
        other_names=("ch",),
    ),
    Function(
        name="asinh",
        interval=lambda x: interval.increasing("asinh", x),
        slope=lambda x, value: 1 / interval.sqrt(1 + x**2),
        curvature=lambda x, value, slope: -x * slope**3,
        latex=r"\operatorname{arsinh}",
        numpy="arcsinh",
        other_names=("arcsinh", "arsinh"),
    ),
    Function(
        name="sqrt",
        interval=interval.sqrt,
        slope=_root_slope,
        curvature=lambda x, value, slope: -1 / (4 * value**3),
        steepest=lambda x, far: 0.5 / np.sqrt(np.maximum(2 * x - far, 0)),
        latex=r"\sqrt{#}",
        powers=True,
    ),
    Function(
        name="abs",
        interval=interval.absolute,
        slope=_sign,
        latex=r"\left|#\right|",
        powers=True,
        casadi="fabs",
        sympy="Abs",
        other_names=("fabs",),
        is_smooth=False,
    ),
    Function(
        name="min",
        interval=interval.minimum,
        latex=r"\min",
        numpy="minimum",
        casadi="fmin",
        sympy="Min",
        other_names=("minimum",),
        arguments=(2, inf),
        is_smooth=False,
    ),
    Function(
        name="max",
        interval=interval.maximum,
        latex=r"\max",
        numpy="maximum",
        casadi="fmax",
        sympy="Max",
        other_names=("maximum",),
        arguments=(2, inf),
        is_smooth=False,
    ),
    Function(
        name="clip",
        interval=interval.clip,
        latex=r"\operatorname{clip}",
        other_names=("sat", "saturate"),
        arguments=(3, 3),
        is_smooth=False,
    ),
)
FUNCTIONS: Final = {row.name: row for row in _ROWS}
NONSMOOTH: Final = tuple(row.name for row in _ROWS if not row.is_smooth)
OTHER_NAMES: Final = {other: row.name for row in _ROWS for other in row.other_names}


def by_twos(name: str, arguments: tuple[T, ...], call: Callable[..., T]) -> T:
    """Call a function through ``call(name, ...)`` of one argument, or of min or max and two.

    Min and max of several are taken one after the other, clip(x, lo, hi) is min(max(x, lo), hi).
    """
    if name == "clip":
        inner, low, high = arguments
        return call("min", call("max", inner, low), high)
    if len(arguments) == 1:
        return call(name, arguments[0])
    return reduce(lambda left, right: call(name, left, right), arguments)


_INVERSES = [name for name in FUNCTIONS if name[0] == "a" and name[1:] in FUNCTIONS]
_ONLY_INVERSE = f"the only inverse function{' is' if len(_INVERSES) == 1 else 's are'} {' and '.join(_INVERSES)}"
_MISSING_INVERSES = [start + name for name in ("sin", "cos", "sinh", "cosh", "tanh") for start in ("a", "arc")] + [
    "atan2"
]
_STEEP = "a coupling must be continuous; a steep one is tanh(100*y)"
# Names of other languages, and what to write here.
FOREIGN: Final = {
    "e": "the number e is written exp(1), and e**y is exp(y)",
    "log10": "write log(y)/log(10) for log10(y)",
    "log2": "write log(y)/log(2) for log2(y)",
    "expm1": "write exp(y) - 1 for expm1(y)",
    "log1p": "write log(1 + y) for log1p(y)",
    **{name: _ONLY_INVERSE for name in _MISSING_INVERSES if name not in {*FUNCTIONS, *OTHER_NAMES}},
    "sign": _STEEP,
    "sgn": _STEEP,
}
