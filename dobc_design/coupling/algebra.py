"""Algebras for the expression tree: arrays, intervals, and intervals with their gradients.

The interval algebras are rigorous: what they return contains every value on the given box, or they raise
UndefinedError.  CasADi and SymPy have theirs in ``model``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from dobc_design.exact import interval
from dobc_design.exact.interval import Interval, UndefinedError

Array = NDArray[np.float64]

_NUMPY_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "sqrt": np.sqrt,
    "abs": np.abs,
}


class NumpyAlgebra:
    """Float64 arrays with broadcasting; a constant beyond the floats is infinite."""

    def constant(self, value: Fraction) -> Array:
        try:
            return np.asarray(value.numerator / value.denominator, dtype=np.float64)
        except OverflowError:
            return np.asarray(np.inf if value > 0 else -np.inf)

    def pi(self) -> Array:
        return np.asarray(np.pi)

    def negate(self, operand: Array) -> Array:
        return np.asarray(-operand)

    def add(self, left: Array, right: Array) -> Array:
        return np.asarray(left + right)

    def subtract(self, left: Array, right: Array) -> Array:
        return np.asarray(left - right)

    def multiply(self, left: Array, right: Array) -> Array:
        return np.asarray(left * right)

    def divide(self, left: Array, right: Array) -> Array:
        return np.asarray(left / right)

    def power(self, base: Array, exponent: int) -> Array:
        return np.asarray(base**exponent)

    def call(self, name: str, arguments: tuple[Array, ...]) -> Array:
        if name == "clip":
            return np.asarray(np.clip(*arguments))
        if name in ("min", "max"):
            return reduce(np.minimum if name == "min" else np.maximum, arguments)
        return np.asarray(_NUMPY_FUNCTIONS[name](*arguments))


class IntervalAlgebra:
    """Enclosures of the value; exact rationals stay points as long as they are short."""

    def constant(self, value: Fraction) -> Interval:
        return Interval.point(value)

    def pi(self) -> Interval:
        return interval.pi()

    def negate(self, operand: Interval) -> Interval:
        return -operand

    def add(self, left: Interval, right: Interval) -> Interval:
        return left + right

    def subtract(self, left: Interval, right: Interval) -> Interval:
        return left - right

    def multiply(self, left: Interval, right: Interval) -> Interval:
        return left * right

    def divide(self, left: Interval, right: Interval) -> Interval:
        return left / right

    def power(self, base: Interval, exponent: int) -> Interval:
        return base**exponent

    def call(self, name: str, arguments: tuple[Interval, ...]) -> Interval:
        function = interval.FUNCTIONS[name]
        return reduce(function, arguments) if name in ("min", "max") else function(*arguments)


_ZERO, _ONE, _MINUS_ONE = Interval.point(0), Interval.point(1), Interval.point(-1)


@dataclass(frozen=True, slots=True)
class Gradient:
    """Enclosures of a value and of its partial derivatives (Clarke's, where it has a kink) on a box."""

    value: Interval
    partials: tuple[Interval, ...]


class GradientAlgebra:
    """Forward differentiation with intervals, for ``variable_count`` variables.

    Where abs, min, max or clip may have a kink, the hull of the slopes on both sides is taken, which
    contains Clarke's generalized gradient.
    Raises: UndefinedError where a value or a slope is not bounded on the box (sqrt at 0).
    """

    def __init__(self, variable_count: int) -> None:
        self.no_slope = (_ZERO,) * variable_count

    def variables(self, box: Sequence[Interval]) -> tuple[Gradient, ...]:
        """Return the variables themselves, y_i in box[i]."""
        indices = range(len(self.no_slope))
        return tuple(
            Gradient(side, tuple(_ONE if i == j else _ZERO for j in indices))
            for i, side in zip(indices, box, strict=True)
        )

    def constant(self, value: Fraction) -> Gradient:
        return Gradient(Interval.point(value), self.no_slope)

    def pi(self) -> Gradient:
        return Gradient(interval.pi(), self.no_slope)

    def negate(self, operand: Gradient) -> Gradient:
        return Gradient(-operand.value, tuple(_times(partial, _MINUS_ONE) for partial in operand.partials))

    def add(self, left: Gradient, right: Gradient) -> Gradient:
        pairs = zip(left.partials, right.partials, strict=True)
        return Gradient(left.value + right.value, tuple(_plus(u, v) for u, v in pairs))

    def subtract(self, left: Gradient, right: Gradient) -> Gradient:
        pairs = zip(left.partials, right.partials, strict=True)
        return Gradient(left.value - right.value, tuple(u if v is _ZERO else u - v for u, v in pairs))

    def multiply(self, left: Gradient, right: Gradient) -> Gradient:
        partials = tuple(
            _plus(_times(u, right.value), _times(v, left.value))
            for u, v in zip(left.partials, right.partials, strict=True)
        )
        return Gradient(left.value * right.value, partials)

    def divide(self, left: Gradient, right: Gradient) -> Gradient:
        quotient = left.value / right.value
        partials = tuple(
            _ZERO if u is v is _ZERO else (u - _times(v, quotient)) / right.value
            for u, v in zip(left.partials, right.partials, strict=True)
        )
        return Gradient(quotient, partials)

    def power(self, base: Gradient, exponent: int) -> Gradient:
        value = base.value**exponent
        return self._chain(base, value, lambda: base.value ** (exponent - 1) * exponent if exponent else _ZERO)

    def call(self, name: str, arguments: tuple[Gradient, ...]) -> Gradient:
        if name == "clip":
            inner, low, high = arguments
            return _extreme("min", _extreme("max", inner, low), high)
        if name in ("min", "max"):
            return reduce(lambda left, right: _extreme(name, left, right), arguments)
        (argument,) = arguments
        value = interval.FUNCTIONS[name](argument.value)
        return self._chain(argument, value, lambda: _slope(name, argument.value, value))

    def _chain(self, inner: Gradient, value: Interval, slope: Callable[[], Interval]) -> Gradient:
        # A constant has slope 0 even where the function has none, as in sqrt(0)*y.
        if all(partial == _ZERO for partial in inner.partials):
            return Gradient(value, self.no_slope)
        factor = slope()
        return Gradient(value, tuple(_times(partial, factor) for partial in inner.partials))


def _plus(u: Interval, v: Interval) -> Interval:
    # Most partial derivatives of a long expression in many variables are this very zero.
    if u is _ZERO:
        return v
    return u if v is _ZERO else u + v


def _times(partial: Interval, factor: Interval) -> Interval:
    return _ZERO if partial is _ZERO else partial * factor


def _extreme(name: str, left: Gradient, right: Gradient) -> Gradient:
    below, above = (left, right) if name == "min" else (right, left)
    if below.value.hi < above.value.lo:
        return left
    if above.value.hi < below.value.lo:
        return right
    pairs = zip(left.partials, right.partials, strict=True)
    value = interval.FUNCTIONS[name](left.value, right.value)
    return Gradient(value, tuple(u.hull(v) for u, v in pairs))


def _slope(name: str, x: Interval, value: Interval) -> Interval:
    """Enclose the derivative of a function of one variable on x, where its values lie in ``value``."""
    match name:
        case "exp":
            return value
        case "log":
            return 1 / x
        case "sin":
            return interval.cos(x)
        case "cos":
            return -interval.sin(x)
        case "tan":
            return 1 + value**2
        case "tanh":
            return 1 - value**2
        case "atan":
            return 1 / (1 + x**2)
        case "sinh":
            return interval.cosh(x)
        case "cosh":
            return interval.sinh(x)
        case "sqrt":
            if value.lo <= 0:
                raise UndefinedError(f"sqrt has no bounded slope on {x}.")
            return 1 / (2 * value)
        case _:
            return Interval(Fraction(1 if x.lo > 0 else -1), Fraction(-1 if x.hi < 0 else 1))
