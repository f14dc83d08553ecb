"""Intervals with first and second derivatives over the expression tree, in one variable.

Theory, sections 1 and 5: the signs of h' and h'' on an interval say where h and its secant gain are monotone, and
then end points give their ranges.  What is returned contains every true value; a kink leaves h'' open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Final

from dobc_design.exact import interval
from dobc_design.exact.interval import Interval, UndefinedError

ZERO: Final = Interval.point(0)
ONE: Final = Interval.point(1)

Derivatives = tuple[Interval, Interval]  # of a function of one variable: first, second


@dataclass(frozen=True, slots=True)
class Jet:
    """Enclosures of a value, of its derivative (Clarke's at a kink) and of its second derivative on an interval.

    ``curvature`` is None where there may be a kink: the second derivative is then not defined everywhere.
    """

    value: Interval
    slope: Interval
    curvature: Interval | None


class JetAlgebra:
    """Forward differentiation, twice, with intervals.

    ``restricted``: derivatives are those of the function on this interval only, so that a kink at an end point
    does not count.  Otherwise a kink at an end point counts with the slopes of both its sides.
    Raises: UndefinedError where a value or a slope is not bounded (sqrt at 0).
    """

    def __init__(self, *, restricted: bool = False) -> None:
        self.restricted = restricted

    def constant(self, value: Fraction) -> Jet:
        return Jet(Interval.point(value), ZERO, ZERO)

    def pi(self) -> Jet:
        return Jet(interval.pi(), ZERO, ZERO)

    def negate(self, operand: Jet) -> Jet:
        curvature = None if operand.curvature is None else -operand.curvature
        return Jet(-operand.value, -operand.slope, curvature)

    def add(self, left: Jet, right: Jet) -> Jet:
        curvature = None if left.curvature is None or right.curvature is None else left.curvature + right.curvature
        return Jet(left.value + right.value, left.slope + right.slope, curvature)

    def subtract(self, left: Jet, right: Jet) -> Jet:
        return self.add(left, self.negate(right))

    def multiply(self, left: Jet, right: Jet) -> Jet:
        curvature = None
        if left.curvature is not None and right.curvature is not None:
            twice = left.slope * right.slope * 2
            curvature = _times(left.curvature, right.value) + twice + _times(right.curvature, left.value)
        slope = _times(left.slope, right.value) + _times(right.slope, left.value)
        return Jet(left.value * right.value, slope, curvature)

    def divide(self, left: Jet, right: Jet) -> Jet:
        quotient = left.value / right.value
        slope = (left.slope - _times(right.slope, quotient)) / right.value
        curvature = None
        if left.curvature is not None and right.curvature is not None:
            twice = _times(right.slope, slope) * 2
            curvature = (left.curvature - twice - _times(right.curvature, quotient)) / right.value
        return Jet(quotient, slope, curvature)

    def power(self, base: Jet, exponent: int) -> Jet:
        value = base.value**exponent
        if exponent in (0, 1):
            return self.constant(Fraction(1)) if exponent == 0 else base
        return _chain(
            base,
            value,
            lambda: (
                base.value ** (exponent - 1) * exponent,
                base.value ** (exponent - 2) * (exponent * (exponent - 1)),
            ),
        )

    def call(self, name: str, arguments: tuple[Jet, ...]) -> Jet:
        if name == "clip":
            inner, low, high = arguments
            return self._extreme("min", self._extreme("max", inner, low), high)
        if name in ("min", "max"):
            return reduce(lambda left, right: self._extreme(name, left, right), arguments)
        (argument,) = arguments
        if name == "abs":
            found = self._extreme("max", argument, self.negate(argument))
            return Jet(interval.absolute(argument.value), found.slope, found.curvature)
        value = interval.FUNCTIONS[name](argument.value)
        return _chain(argument, value, lambda: _derivatives(name, argument.value, value))

    def _extreme(self, name: str, left: Jet, right: Jet) -> Jet:
        below, above = (left, right) if name == "min" else (right, left)
        if self._is_below(below, above):
            return left
        if self._is_below(above, below):
            return right
        both = left.curvature == ZERO == right.curvature and left.slope == right.slope == ZERO
        value = interval.FUNCTIONS[name](left.value, right.value)
        return Jet(value, left.slope.hull(right.slope), ZERO if both else None)

    def _is_below(self, left: Jet, right: Jet) -> bool:
        if left.value.hi < right.value.lo:
            return True
        return self.restricted and left.value.hi == right.value.lo


def _times(derivative: Interval, factor: Interval) -> Interval:
    return ZERO if derivative is ZERO else derivative * factor


def _chain(inner: Jet, value: Interval, outer: Callable[[], Derivatives]) -> Jet:
    # A constant has slope 0 even where the function has none, as in sqrt(0)*y.
    if inner.slope == ZERO and inner.curvature == ZERO:
        return Jet(value, ZERO, ZERO)
    first, second = outer()
    if inner.curvature is None:
        return Jet(value, first * inner.slope, None)
    return Jet(value, first * inner.slope, second * inner.slope**2 + _times(inner.curvature, first))


def _derivatives(name: str, x: Interval, value: Interval) -> Derivatives:
    """Enclose the first two derivatives of a function on x, where its values lie in ``value``."""
    match name:
        case "exp":
            return value, value
        case "log":
            return 1 / x, -1 / x**2
        case "sin":
            return interval.cos(x), -value
        case "cos":
            return -interval.sin(x), -value
        case "tan":
            slope = 1 + value**2
            return slope, 2 * value * slope
        case "tanh":
            slope = 1 - value**2
            return slope, -2 * value * slope
        case "atan":
            slope = 1 / (1 + x**2)
            return slope, -2 * x * slope**2
        case "sinh":
            return interval.cosh(x), value
        case "cosh":
            return interval.sinh(x), value
        case _:
            if value.lo <= 0:
                raise UndefinedError(f"sqrt has no bounded slope on {x}.")
            return 1 / (2 * value), -1 / (4 * value**3)
