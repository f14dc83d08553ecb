"""Coupling functions as text: read safely, evaluated anywhere.

``parse_expression`` is the only way from text to a tree; nothing here uses ``eval`` or SymPy.  What the
function means for the network (h(0) = 0, its slope) is the business of ``coupling``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dobc_design.coupling.algebra import NumpyAlgebra
from dobc_design.coupling.notation import to_latex, to_text
from dobc_design.coupling.parser import DEEPEST, parse
from dobc_design.coupling.tokens import Fault, Repair, excerpt
from dobc_design.coupling.tree import NONSMOOTH, Algebra, Node, Variable, evaluate, postorder, run
from dobc_design.errors import ExpressionError, ShapeError

__all__ = [
    "Algebra",
    "Expression",
    "Node",
    "evaluate",
    "nonsmooth_functions",
    "numpy_function",
    "parse_expression",
    "polynomial_degree",
    "to_latex",
    "to_text",
    "variables_used",
]

LONGEST = 2000
_MOST_REPAIRS = 12
_LONGEST_SUGGESTION = 100


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Expression:
    """A function of y (dimension 1) or of y1..ym; made by ``parse_expression``.

    ``text`` is what the user typed, ``node`` the tree, ``str()`` the canonical text, which parses back to
    the same tree.  Two expressions are equal when their trees and dimensions are.
    """

    text: str
    node: Node
    dimension: int

    def __str__(self) -> str:
        pretty = to_text(self.node, dimension=self.dimension)
        if len(pretty) <= LONGEST:
            return pretty
        return to_text(self.node, dimension=self.dimension, compact=True)

    def __repr__(self) -> str:
        return f"parse_expression({str(self)!r}, dimension={self.dimension})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Expression):
            return NotImplemented
        return self.dimension == other.dimension and self.node == other.node

    def __hash__(self) -> int:
        return hash((self.dimension, self.node))

    def __reduce__(self) -> tuple[Callable[..., Expression], tuple[str, int]]:
        # Long sums are deep trees, on which pickle and deepcopy would meet Python's recursion limit.
        return _read_again, (self.text, self.dimension)

    @property
    def latex(self) -> str:
        """The function as LaTeX mathematics."""
        return to_latex(self.node, dimension=self.dimension)


def parse_expression(text: str, *, dimension: int = 1, key: str = "coupling.h") -> Expression:
    """Read a function of y (dimension 1; y1 is the same) or of y1..ym.

    The language: + - * / with Python's precedence, ** with a literal integer from -64 to 64 or 1/2 (written
    0.5 or (1/2); it becomes sqrt), numbers, pi, exp log sin cos tan tanh atan sinh cosh sqrt abs, min and
    max of two or more, clip(y, lo, hi) with rational constants lo <= hi.  At most 2000 characters, 50 nested
    parentheses.
    Raises: ExpressionError that quotes the text, says what was found in which column, what is allowed and,
    where it can be guessed, what was meant.
    """
    if not isinstance(text, str):
        raise ExpressionError(
            f"{key} must be an expression in text; got {type(text).__name__}.",
            key=key,
            cure='Write for example "tanh(y)".',
        )
    if len(text) > LONGEST:
        raise ExpressionError(
            f"{key} must have at most {LONGEST} characters; {excerpt(text, width=30)} has {len(text)}.", key=key
        )
    try:
        expression = Expression(text, parse(text, dimension=dimension), dimension)
    except Fault as fault:
        raise _refusal(text, fault, dimension=dimension, key=key) from None
    canonical = str(expression)
    if len(canonical) > LONGEST or _nesting(canonical) > DEEPEST:
        raise ExpressionError(
            f"{key} {excerpt(text, width=30)} must fit into {LONGEST} characters and {DEEPEST} nested"
            " parentheses when **0.5 is written as sqrt.",
            key=key,
        )
    return expression


def numpy_function(expression: Expression) -> Callable[[ArrayLike], NDArray[np.float64]]:
    """Return the expression as a function of arrays.

    Shapes: with dimension 1 any shape, element by element; else (..., m) gives (...).
    Overflow gives inf and undefined places give nan, without warnings.
    """
    order, dimension = postorder(expression.node), expression.dimension
    algebra = NumpyAlgebra()

    def function(y: ArrayLike) -> NDArray[np.float64]:
        array = np.asarray(y, dtype=np.float64)
        if dimension > 1 and (array.ndim == 0 or array.shape[-1] != dimension):
            raise ShapeError(f"the last axis of y must have length {dimension}; got shape {array.shape}.")
        variables = [array] if dimension == 1 else [array[..., index] for index in range(dimension)]
        with np.errstate(all="ignore"):
            result = run(order, variables, algebra)
        return np.array(np.broadcast_to(result, variables[0].shape), dtype=np.float64)

    return function


def polynomial_degree(node: Node) -> int | None:
    """Return a bound on the degree as written: 0 constant, 1 affine; None if it is not a polynomial.

    Nothing is expanded or cancelled: y**2 - y**2 counts 2.  So 0 and 1 are proofs, larger values are not.
    """
    return evaluate(node, (1,) * _variable_count(node), _DegreeAlgebra())


def nonsmooth_functions(node: Node) -> tuple[str, ...]:
    """Return which of abs, min, max, clip are applied to something that is not constant.

    These are Lipschitz but not C1, so the secant form applies and the pointwise Jacobian does not (theory,
    section 1).  sqrt is not among them: where it is not smooth, intervals refuse it.
    """
    nothing = (True, frozenset[str]())
    found = evaluate(node, (nothing,) * _variable_count(node), _KinkAlgebra())[1]
    return tuple(name for name in NONSMOOTH if name in found)


def variables_used(node: Node) -> tuple[int, ...]:
    """Return the indices, from 0 and increasing, of the variables that occur."""
    return tuple(sorted({part.index for part in postorder(node) if isinstance(part, Variable)}))


def _variable_count(node: Node) -> int:
    return max(variables_used(node), default=-1) + 1


def _read_again(text: str, dimension: int) -> Expression:
    return parse_expression(text, dimension=dimension)


def _nesting(text: str) -> int:
    depth = deepest = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        deepest = max(deepest, depth)
    return deepest


def _refusal(text: str, fault: Fault, *, dimension: int, key: str) -> ExpressionError:
    place = f"column {fault.start + 1}" if text.strip() else "an empty text"
    found = f"{fault.found} in {place}" if text.strip() else place
    guess = _repaired(text, fault.repair, dimension=dimension)
    return ExpressionError(
        f"{key} {excerpt(text, fault.start)}: found {found}; {fault.why}",
        key=key,
        cure=None if guess is None else f'did you mean "{guess}"?',
    )


def _repaired(text: str, repair: Repair | None, *, dimension: int) -> str | None:
    """Apply repairs until the text can be read; None if it cannot, or is too long to show."""
    for _ in range(_MOST_REPAIRS):
        if repair is None or len(text) > _LONGEST_SUGGESTION:
            return None
        text = text[: repair.start] + repair.replacement + text[repair.end :]
        try:
            return to_text(parse(text, dimension=dimension), dimension=dimension)
        except Fault as fault:
            repair = fault.repair
    return None


class _DegreeAlgebra:
    """Algebra of degrees; None is "not a polynomial"."""

    def constant(self, value: Fraction) -> int | None:
        return 0

    def pi(self) -> int | None:
        return 0

    def negate(self, operand: int | None) -> int | None:
        return operand

    def add(self, left: int | None, right: int | None) -> int | None:
        return None if left is None or right is None else max(left, right)

    def subtract(self, left: int | None, right: int | None) -> int | None:
        return self.add(left, right)

    def multiply(self, left: int | None, right: int | None) -> int | None:
        return None if left is None or right is None else left + right

    def divide(self, left: int | None, right: int | None) -> int | None:
        return left if right == 0 else None

    def power(self, base: int | None, exponent: int) -> int | None:
        if base is None or (exponent < 0 and base > 0):
            return None
        return base * max(exponent, 0)

    def call(self, name: str, arguments: tuple[int | None, ...]) -> int | None:
        return 0 if all(argument == 0 for argument in arguments) else None


_Kinks = tuple[bool, frozenset[str]]  # whether a variable occurs, and the functions that are not C1


class _KinkAlgebra:
    """Algebra that collects the functions that are not C1."""

    def constant(self, value: Fraction) -> _Kinks:
        return False, frozenset()

    def pi(self) -> _Kinks:
        return False, frozenset()

    def negate(self, operand: _Kinks) -> _Kinks:
        return operand

    def add(self, left: _Kinks, right: _Kinks) -> _Kinks:
        return left[0] or right[0], left[1] | right[1]

    subtract = multiply = divide = add

    def power(self, base: _Kinks, exponent: int) -> _Kinks:
        return base

    def call(self, name: str, arguments: tuple[_Kinks, ...]) -> _Kinks:
        varies = any(argument[0] for argument in arguments)
        own = {name} if varies and name in NONSMOOTH else set()
        return varies, frozenset(own).union(*(argument[1] for argument in arguments))
