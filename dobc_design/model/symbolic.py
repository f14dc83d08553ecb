"""The expression tree of a coupling in SymPy, number for number: 3.2 arrives as 16/5.

The tree is walked; no text is ever handed to SymPy's own parser.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import sympy

from dobc_design.coupling.expression import Expression
from dobc_design.coupling.functions import FUNCTIONS, by_twos
from dobc_design.coupling.tree import Operators, evaluate, variable_names


class SympyAlgebra(Operators):
    """Algebra (``coupling.tree.Algebra``) of SymPy expressions."""

    def constant(self, value: Fraction) -> Any:
        return sympy.Rational(value.numerator, value.denominator)

    def pi(self) -> Any:
        return sympy.pi

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return by_twos(name, arguments, lambda name, *operands: FUNCTIONS[name].found_in(sympy, "sympy")(*operands))


def to_sympy(expression: Expression) -> tuple[Any, tuple[Any, ...]]:
    """Return the expression and its variables, real symbols: y, or y1 to ym."""
    variables = tuple(sympy.Symbol(name, real=True) for name in variable_names(expression.dimension))
    return evaluate(expression.node, variables, SympyAlgebra()), variables
