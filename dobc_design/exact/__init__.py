"""Exact arithmetic: rational numbers and matrices, definiteness, Routh, observability, intervals.

Everything that decides a claim ends here, over the rationals; no solver and no tolerance.
The modules ``interval`` (``interval.exp``, ...) and ``matrix`` (``matrix.matrix`` reads one) keep
their names: a function of the same name is not exported here.
"""

from dobc_design.exact import interval

from .definite import (
    Definiteness,
    decide_positive_definite,
    decide_positive_semidefinite,
    decide_quickly,
    definiteness,
)
from .interval import Interval, UndefinedError
from .matrix import (
    Matrix,
    Vector,
    add,
    from_float,
    identity,
    inverse,
    is_symmetric,
    kronecker,
    multiply,
    nullspace,
    rank,
    row_echelon,
    scale,
    shape,
    subtract,
    to_float,
    transpose,
    zeros,
)
from .number import float_above, float_below, number_text, parse_number
from .observability import (
    Detectability,
    Observability,
    decide_detectable,
    decide_observable,
    observability_matrix,
    observable_reduction,
)
from .polynomial import (
    RouthTable,
    characteristic_polynomial,
    count_right_half_plane,
    decide_hurwitz,
    polynomial_text,
    routh,
)
from .symmetric import IntegerSymmetric, SparseSymmetric

__all__ = [
    "Definiteness",
    "Detectability",
    "IntegerSymmetric",
    "Interval",
    "Matrix",
    "Observability",
    "RouthTable",
    "SparseSymmetric",
    "UndefinedError",
    "Vector",
    "add",
    "characteristic_polynomial",
    "count_right_half_plane",
    "decide_detectable",
    "decide_hurwitz",
    "decide_observable",
    "decide_positive_definite",
    "decide_positive_semidefinite",
    "decide_quickly",
    "definiteness",
    "float_above",
    "float_below",
    "from_float",
    "identity",
    "interval",
    "inverse",
    "is_symmetric",
    "kronecker",
    "multiply",
    "nullspace",
    "number_text",
    "observability_matrix",
    "observable_reduction",
    "parse_number",
    "polynomial_text",
    "rank",
    "routh",
    "row_echelon",
    "scale",
    "shape",
    "subtract",
    "to_float",
    "transpose",
    "zeros",
]
