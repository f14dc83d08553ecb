"""Enclosures of h, h' and h(y)/y on a random interval, held against random points at 200 bits."""

from collections.abc import Callable
from fractions import Fraction
from random import Random

from random_couplings import near_kink, true_values

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
    Y = Interval(
        start, min(start + Fraction(r.randint(1, 9), 3) / 10 ** r.choice((0, 0, 1, 3)), Fraction(2))
    )
    enclosures = (
        (*_tried(lambda: value_form(curve, Y)), tight_range(curve, value_form, Y, tolerance=CLOSE)),
        (*_tried(lambda: jet(curve, Y).slope), tight_range(curve, slope_form, Y, tolerance=CLOSE)),
        (*_tried(lambda: secant(curve, Y).value), secant_range(curve, Y, tolerance=CLOSE)),
    )
    wrong = []
    for _ in range(points):
        y = Y.lo + Y.width * Fraction(r.getrandbits(48) | 1, 2**48)
        for name, known, value in zip(NAMES, enclosures, true_values(text, y), strict=True):
            if not all(holds(each, value) for each in known) and not (
                name == NAMES[1] and near_kink(text, y)
            ):
                wrong.append(f"{name} of {text} at {y} on {Y}")
    return wrong


def _tried(form: Callable[[], Interval]) -> tuple[Interval, ...]:
    """One evaluation on a wide interval may not see that a function is defined; the ranges
    subdivide."""
    try:
        return (form(),)
    except UndefinedError:
        return ()
