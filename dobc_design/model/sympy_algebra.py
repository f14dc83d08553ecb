"""The expression tree of a coupling in SymPy, number for number: 3.2 arrives as 16/5.

The tree is walked; no text is ever handed to SymPy's own parser.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import sympy

from dobc_design.coupling.expression import Expression, evaluate

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "exp": sympy.exp,
    "log": sympy.log,
    "sin": sympy.sin,
    "cos": sympy.cos,
    "tan": sympy.tan,
    "tanh": sympy.tanh,
    "atan": sympy.atan,
    "sinh": sympy.sinh,
    "cosh": sympy.cosh,
    "sqrt": sympy.sqrt,
    "abs": sympy.Abs,
    "min": sympy.Min,
    "max": sympy.Max,
}


class SympyAlgebra:
    """Algebra (``coupling.tree.Algebra``) of SymPy expressions."""

    def constant(self, value: Fraction) -> Any:
        return sympy.Rational(value.numerator, value.denominator)

    def pi(self) -> Any:
        return sympy.pi

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
            return sympy.Min(sympy.Max(value, low), high)
        return _FUNCTIONS[name](*arguments)


def to_sympy(expression: Expression) -> tuple[Any, tuple[Any, ...]]:
    """Return the expression and its variables, real symbols: y, or y1 to ym."""
    m = expression.dimension
    names = ("y",) if m == 1 else tuple(f"y{index + 1}" for index in range(m))
    variables = tuple(sympy.Symbol(name, real=True) for name in names)
    return evaluate(expression.node, variables, SympyAlgebra()), variables
