"""The expression tree of a coupling in CasADi (any of SX, MX, DM).

Python's math functions on an SX return NaN without a word, so every function here is CasADi's own.
Where an argument of min, max or clip is undefined, CasADi returns the other one.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

_FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "exp": ca.exp,
    "log": ca.log,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "tanh": ca.tanh,
    "atan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "sqrt": ca.sqrt,
    "abs": ca.fabs,
}


class CasadiAlgebra:
    """Algebra (``coupling.tree.Algebra``) of CasADi expressions, element by element on vectors."""

    def constant(self, value: Fraction) -> Any:
        try:
            return ca.DM(value.numerator / value.denominator)
        except OverflowError:  # constants are never negative
            return ca.DM(np.inf)

    def pi(self) -> Any:
        return ca.DM(np.pi)

    def negate(self, operand: Any) -> Any:
        return -operand

    def add(self, left: Any, right: Any) -> Any:
        return left + right

    def subtract(self, left: Any, right: Any) -> Any:
        return left - right

    def multiply(self, left: Any, right: Any) -> Any:
        return left * right

    def divide(self, left: Any, right: Any) -> Any:
        return left / right

    def power(self, base: Any, exponent: int) -> Any:
        return base**exponent

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        if name == "clip":
            value, low, high = arguments
            return ca.fmin(ca.fmax(value, low), high)
        if name in ("min", "max"):
            return reduce(ca.fmin if name == "min" else ca.fmax, arguments)
        return _FUNCTIONS[name](*arguments)
