"""Random coupling functions of y as text, and their enclosures held against their true values.

The oracle is SymPy for the derivative and mpmath at 200 bits for the values; nothing of the package
takes part in the values."""

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from random import Random
from typing import Any

import mpmath
import sympy
from known_functions import KNOWN, OF_SEVERAL
from sympy.printing.pycode import MpmathPrinter

from dobc_design.coupling.enclosures import (
    Curve,
    jet,
    secant,
    secant_range,
    slope_form,
    tight_range,
    value_form,
)
from dobc_design.coupling.expression import parse_expression
from dobc_design.exact.interval import Interval, UndefinedError

BITS = 200
# "#" is an argument that stays within about +-2.
OUTER = (
    *(known.example for known in KNOWN.values()),
    *OF_SEVERAL.values(),
    "(#)**2",
    "(#)**3",
    "(4 + #)**-2",
    "1/(3 - #)",
    "pi*(#)",
    "(#)*exp(-(#))",
    "min(#, 2*(#), 1)",
    "(1 + (#)**2)**(1/2)",
)
INNER = (
    "y",
    "y",
    "y/2",
    "sin(y)",
    "tanh(2*y)",
    "clip(y, -1, 1)",
    "y/(1 + y**2)",
    "cos(y) - 1",
    "atan(2*y)",
    "abs(y) - 1",
)
JOINTS = ("{} + {}", "{} - {}", "({})*({})", "{} + y/3 - {}")


def coupling_text(seed: int) -> str:
    """h with h(0) = 0: one function of the grammar in turn, alone, composed or joined with
    another."""
    r = Random(seed)
    first = OUTER[seed % len(OUTER)].replace("#", f"({r.choice(INNER)})")
    if r.random() < 0.5:
        joint = r.choice(JOINTS)
        second = r.choice(OUTER).replace("#", f"({r.choice(INNER)})")
        first = joint.format(first, second)
    # No name of the grammar contains a y, so this is f(y) - f(0).
    return f"{first} - ({first.replace('y', '0')})"


class _Printer(MpmathPrinter):
    """Integers as mpmath numbers: max(-1, min(1, y)) may be the integer 1, and 5**-2 would be a
    float."""

    def _print_Integer(self, number: Any) -> str:  # noqa: N802 - SymPy's name
        return f"{self._module_format('mpmath.mpf')}({int(number)})"


PRINTER = _Printer(
    {"fully_qualified_modules": False, "inline": True, "allow_unknown_functions": True}
)


def names(variables: dict[str, Any]) -> dict[str, Any]:
    """What SymPy reads a coupling with."""
    found = {
        **variables,
        "min": sympy.Min,
        "max": sympy.Max,
        "clip": lambda x, lo, hi: sympy.Max(lo, sympy.Min(x, hi)),
    }
    for name, known in KNOWN.items():
        if known.symbolic is not None:
            found[name] = known.symbolic
    return found


@cache
def truth(text: str) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """h and h' as functions of mpmath numbers; to be called at BITS bits."""
    y = sympy.symbols("y", real=True)
    names_of_y = names({"y": y})
    h = sympy.sympify(text, locals=names_of_y, rational=True)
    value = sympy.lambdify(y, h, "mpmath", printer=PRINTER)
    derivative = sympy.diff(h, y)
    slope = sympy.lambdify(y, derivative, "mpmath", printer=PRINTER)
    return value, slope


def true_values(text: str, y: Fraction) -> tuple[Fraction, Fraction, Fraction]:
    """h, h' and h(y)/y at a rational y != 0, within about 1e-50."""
    h, slope = truth(text)
    with mpmath.workprec(BITS):
        at = mpmath.mpf(y.numerator) / y.denominator
        value = mpmath.mpf(h(at))
        slope_at = exact(mpmath.mpf(slope(at)))
        return exact(value), slope_at, exact(value / at)


def exact(value: Any) -> Fraction:
    """The rational number that an mpmath number is."""
    sign, mantissa, exponent, _ = value._mpf_
    return (-1) ** sign * Fraction(int(mantissa)) * Fraction(2) ** exponent


def near_kink(text: str, y: Fraction) -> bool:
    """Whether the slope of a coupling with kinks changes abruptly within 1e-9 of y."""
    if not any(name in text for name in ("abs", "min", "max", "clip")):
        return False
    gap = Fraction(1, 10**9)
    _, right, _ = true_values(text, y + gap)
    _, left, _ = true_values(text, y - gap)
    return abs(right - left) > Fraction(1, 10**4)


NAMES = ("h", "h'", "h(y)/y")
CLOSE = Fraction(1, 100)
SLACK = Fraction(1, 10**45)  # of the 200 bits


def holds(enclosure: Interval, value: Fraction) -> bool:
    slack = SLACK * (1 + abs(value))
    return enclosure.lo - slack <= value <= enclosure.hi + slack


def outside(text: str, r: Random, points: int) -> list[str]:
    """The points whose value, slope or gain lies outside, in words."""
    curve = Curve(parse_expression(text))
    start = Fraction(r.randint(-2000, 1500), 1000)
    scaled = Fraction(r.randint(1, 9), 3)
    powers = (0, 0, 1, 3)
    length = scaled / 10 ** r.choice(powers)
    Y = Interval(start, min(start + length, Fraction(2)))
    by_values = (
        *_tried(lambda: value_form(curve, Y)),
        tight_range(curve, value_form, Y, tolerance=CLOSE),
    )
    by_slopes = (
        *_tried(lambda: jet(curve, Y).slope),
        tight_range(curve, slope_form, Y, tolerance=CLOSE),
    )
    by_secants = (*_tried(lambda: secant(curve, Y).value), secant_range(curve, Y, tolerance=CLOSE))
    enclosures = (by_values, by_slopes, by_secants)
    wrong = []
    for _ in range(points):
        odd = r.getrandbits(48) | 1
        share = Fraction(odd, 2**48)
        y = Y.lo + Y.width * share
        for name, known, value in zip(NAMES, enclosures, true_values(text, y), strict=True):
            left = not all(holds(each, value) for each in known)
            if left and not (name == NAMES[1] and near_kink(text, y)):
                wrong.append(f"{name} of {text} at {y} on {Y}")
    return wrong


def _tried(form: Callable[[], Interval]) -> tuple[Interval, ...]:
    """One evaluation on a wide interval may not see that a function is defined; the ranges
    subdivide."""
    try:
        return (form(),)
    except UndefinedError:
        return ()
