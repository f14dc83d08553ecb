"""The expression tree of a coupling in CasADi (any of SX, MX, DM).

Python's math functions on an SX return NaN without a word, so every function here is CasADi's own.
Where an argument of min, max or clip is undefined, CasADi returns the other one.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from dobc_design.coupling.functions import FUNCTIONS, by_twos
from dobc_design.coupling.tree import Operators


class CasadiAlgebra(Operators):
    """Algebra (``coupling.tree.Algebra``) of CasADi expressions, element by element on vectors."""

    def constant(self, value: Fraction) -> Any:
        try:
            return ca.DM(value.numerator / value.denominator)
        except OverflowError:  # constants are never negative
            return ca.DM(np.inf)

    def pi(self) -> Any:
        return ca.DM(np.pi)

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return by_twos(name, arguments, lambda name, *operands: FUNCTIONS[name].found_in(ca, "casadi")(*operands))
