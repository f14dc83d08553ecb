"""What expressions are evaluated with to become those of CasADi and SymPy."""

from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from dobc_design.coupling.expression import Expression
from dobc_design.coupling.tree import Library, evaluate, variable_names
from dobc_design.exact.number import nearest


class CasadiAlgebra(Library):
    """Algebra (``coupling.tree.Algebra``) of CasADi expressions, element by element on vectors."""

    module = ca
    names = "casadi"

    def constant(self, value: Fraction) -> Any:
        return ca.DM(nearest(value))

    def pi(self) -> Any:
        return ca.DM(np.pi)


class SympyAlgebra(Library):
    """The same of SymPy expressions, number for number: 3.2 arrives as 16/5."""

    names = "sympy"

    def __init__(self) -> None:
        import sympy  # which nothing else here needs

        self.module = sympy

    def constant(self, value: Fraction) -> Any:
        return self.module.Rational(value.numerator, value.denominator)

    def pi(self) -> Any:
        return self.module.pi


def to_sympy(expression: Expression) -> tuple[Any, tuple[Any, ...]]:
    """Return the expression in SymPy and its variables, real symbols: y, or y1 to ym.  No text is
    parsed."""
    import sympy

    names = variable_names(expression.dimension)
    variables = tuple(sympy.Symbol(name, real=True) for name in names)
    found = evaluate(expression.node, variables, SympyAlgebra())
    return found, variables
