"""Coupling functions as text: ``parse_expression`` is the only way to a tree; nothing here uses
``eval`` or SymPy."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import field
from fractions import Fraction
from functools import partial
from itertools import accumulate
from math import inf
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dobc_design._checks import positional
from dobc_design.errors import ShapeError, SpecError, misstated
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import decimal_parts, with_exponent, without_exponent

from .functions import FUNCTIONS, Function
from .parser import DEEPEST, Fault, Repair, excerpt, parse
from .tree import Algebra, Node, NumpyAlgebra, evaluate, postorder, program, run, variable_names

_LONGEST_PLAIN_NUMBER = 21
T = TypeVar("T")
ArrayFunction = Callable[[ArrayLike], Array]

SUM, SIGN, PRODUCT, UNARY, POWER, ATOM = range(6)


class Piece(NamedTuple):
    """Text and how tightly its last operation binds."""

    text: str
    level: int
    head: str = ""  # LaTeX of a named function, before its arguments: the place for an exponent
    number: bool = False


def evaluated(expressions: Sequence[Expression], y: Sequence[T], algebra: Algebra[T]) -> list[T]:
    """Return their values at y, one value of the algebra for each component; one in a single
    variable acts on each."""
    # One function of y stands for all components; with one component both ways are the same.
    if [each.dimension for each in expressions] == [1]:
        return [evaluate(expressions[0].node, [each], algebra) for each in y]
    return [evaluate(each.node, y, algebra) for each in expressions]


def to_text(node: Node, *, dimension: int = 1, compact: bool = False) -> str:
    """Write the tree in the parser's language, with the fewest parentheses; ``compact``: in the
    fewest characters."""
    variables = [Piece(name, ATOM) for name in variable_names(dimension)]
    return evaluate(node, variables, _TextAlgebra(compact=compact)).text


def to_latex(node: Node, *, dimension: int = 1) -> str:
    r"""Write the tree as LaTeX mathematics: exp(y) - 1 + y becomes e^{y} - 1 + y."""
    names = ["y"] if dimension == 1 else [f"y_{{{index + 1}}}" for index in range(dimension)]
    variables = [Piece(name, ATOM) for name in names]
    return evaluate(node, variables, _LatexAlgebra()).text


def formula_text(function: Function) -> str:
    """Write what a function of y that libraries lack is by other functions."""
    formula = function.formula
    if formula is None:
        raise ValueError(f"{function.name} has no formula.")
    algebra = _TextAlgebra(compact=False)
    written: Piece = formula(algebra, Piece("y", ATOM))
    return written.text


def decimal_text(value: Fraction, *, compact: bool = False) -> str | None:
    """Write a number >= 0 as an exact decimal; None if it has none (1/3)."""
    parts = decimal_parts(value)
    if parts is None:
        return None
    plain = without_exponent(*parts)
    scientific = with_exponent(*parts).removesuffix("e0")
    if not compact:
        return plain if len(plain) <= _LONGEST_PLAIN_NUMBER else scientific
    shortest = min(plain, scientific, key=len)
    return shortest[1:] if shortest.startswith("0.") else shortest


class Infix:
    """The operations of ``tree.Algebra`` that programming languages write alike."""

    space = times = " "  # around + and -, and around * and /
    brackets = "({})"
    # what a minus sign may stand before, and how tightly both then bind
    negated, negative = ATOM, UNARY

    def inside(self, piece: Piece, level: int) -> str:
        """The text where something that binds at least as tightly is wanted."""
        return piece.text if piece.level >= level else self.brackets.format(piece.text)

    def negate(self, operand: Piece) -> Piece:
        return Piece("-" + self.inside(operand, self.negated), self.negative)

    def add(self, left: Piece, right: Piece) -> Piece:
        return self._sum(left, "+", right)

    def subtract(self, left: Piece, right: Piece) -> Piece:
        return self._sum(left, "-", right)

    def multiply(self, left: Piece, right: Piece) -> Piece:
        return self._product(left, "*", right)

    def divide(self, left: Piece, right: Piece) -> Piece:
        return self._product(left, "/", right)

    def _sum(self, left: Piece, sign: str, right: Piece) -> Piece:
        last = self.inside(right, PRODUCT)
        return Piece(f"{left.text}{self.space}{sign}{self.space}{last}", SUM)

    def _product(self, left: Piece, sign: str, right: Piece) -> Piece:
        first = self.inside(left, PRODUCT)
        last = self.inside(right, UNARY)
        return Piece(f"{first}{self.times}{sign}{self.times}{last}", PRODUCT)


class _TextAlgebra(Infix):
    """Algebra of canonical text; see ``tree.Algebra``."""

    times, negated = "", UNARY

    def __init__(self, *, compact: bool) -> None:
        self.compact = compact
        self.space = "" if compact else " "

    def constant(self, value: Fraction) -> Piece:
        text = decimal_text(value, compact=self.compact)
        if text is None:
            return Piece(f"{value.numerator}/{value.denominator}", PRODUCT)
        return Piece(text, ATOM)

    def pi(self) -> Piece:
        return Piece("pi", ATOM)

    def power(self, base: Piece, exponent: int) -> Piece:
        return Piece(f"{self.inside(base, ATOM)}**{exponent}", POWER)

    def call(self, name: str, arguments: tuple[Piece, ...]) -> Piece:
        inside = f",{self.space}".join(argument.text for argument in arguments)
        return Piece(f"{name}({inside})", ATOM)


class _LatexAlgebra(Infix):
    """Algebra of LaTeX; see ``tree.Algebra``."""

    brackets = r"\left({}\right)"
    negated, negative = PRODUCT, SIGN

    def constant(self, value: Fraction) -> Piece:
        text = decimal_text(value)
        if text is None:
            return Piece(rf"\frac{{{value.numerator}}}{{{value.denominator}}}", POWER)
        mantissa, _, exponent = text.partition("e")  # 1e-30 is 10^{-30}, 2e-30 a product
        if not exponent:
            return Piece(text, ATOM, number=True)
        power = f"10^{{{exponent}}}"
        if mantissa == "1":
            return Piece(power, POWER)
        return Piece(rf"{mantissa} \cdot {power}", PRODUCT)

    def pi(self) -> Piece:
        return Piece(r"\pi", ATOM)

    def multiply(self, left: Piece, right: Piece) -> Piece:
        factor = self.inside(right, PRODUCT)
        # A number beside a number would read as one, and f beside (y) as f of y.
        if factor[0].isdigit() or (factor.startswith(r"\left(") and not left.number):
            dot = r" \cdot "
        else:
            dot = " " if left.number else r" \, "
        level = SIGN if left.level == SIGN else PRODUCT
        return Piece(self.inside(left, SIGN) + dot + factor, level)

    def divide(self, left: Piece, right: Piece) -> Piece:
        return Piece(rf"\frac{{{left.text}}}{{{right.text}}}", POWER)

    def power(self, base: Piece, exponent: int) -> Piece:
        # sin^{2}(y), but (sin(y))^{-2}: sin^{-1} would be read as the inverse function.
        if base.head and exponent > 0:
            return Piece(f"{base.head}^{{{exponent}}}{base.text.removeprefix(base.head)}", POWER)
        if base.head:
            return Piece(rf"\left({base.text}\right)^{{{exponent}}}", POWER)
        return Piece(f"{self.inside(base, ATOM)}^{{{exponent}}}", POWER)

    def call(self, name: str, arguments: tuple[Piece, ...]) -> Piece:
        row = FUNCTIONS[name]
        latex = row.latex or f"\\{name}"
        level = ATOM if row.takes_powers else POWER
        inside = ", ".join(argument.text for argument in arguments)
        if "#" in latex:
            return Piece(latex.replace("#", inside), level)
        # Between the name and its argument an exponent is usual for some, and misleading for the
        # others.
        head = latex if row.takes_powers else ""
        return Piece(rf"{latex}\left({inside}\right)", level, head=head)


LONGEST = 2000  # characters of what a user writes
LONGEST_MADE = 20 * LONGEST  # and of what is made of it, such as f(target + e) - f(target)
_MOST_REPAIRS = 12
_LONGEST_SUGGESTION = 100


@positional
class Expression:
    """A function of y (dimension 1) or of y1..ym; made by ``parse_expression``.  ``text`` is what
    the user typed, ``node`` the tree, ``str()`` the canonical text, which parses back to the same
    tree.  Two expressions are equal when their trees and dimensions are."""

    text: str = field(compare=False)
    node: Node
    dimension: int

    def __str__(self) -> str:
        pretty = to_text(self.node, dimension=self.dimension)
        if len(pretty) <= LONGEST:
            return pretty
        return to_text(self.node, dimension=self.dimension, compact=True)

    def __repr__(self) -> str:
        return f"parse_expression({str(self)!r}, dimension={self.dimension})"

    def __reduce__(self) -> tuple[Callable[..., Expression], tuple[str]]:
        # Long sums are deep trees, on which pickle and deepcopy would meet Python's recursion
        # limit.
        read_again = partial(parse_expression, dimension=self.dimension, longest=LONGEST_MADE)
        return read_again, (self.text,)

    @property
    def latex(self) -> str:
        """The function as LaTeX mathematics."""
        return to_latex(self.node, dimension=self.dimension)


def parse_expression(
    text: str, *, dimension: int = 1, key: str = "coupling.h", longest: int = LONGEST
) -> Expression:
    """Read a function of y (dimension 1; y1 is the same) or of y1..ym.  Raises: ExpressionError.

    The language: + - * / with Python's precedence, ** with a literal integer from -64 to 64 or 1/2
    (written 0.5 or (1/2); it becomes sqrt), numbers, pi, and the functions of ``functions``: min
    and max of two or more, clip(y, lo, hi) with rational constants lo <= hi.  At most 2000
    characters, 50 nested parentheses.
    """
    if not isinstance(text, str):
        raise misstated(
            key,
            f"must be an expression in text; got {type(text).__name__}.",
            'Write for example "tanh(y)".',
        )
    if len(text) > longest:
        raise misstated(
            key,
            f"must have at most {longest} characters; {excerpt(text, width=30)} has {len(text)}.",
        )
    try:
        expression = Expression(text, parse(text, dimension), dimension)
    except Fault as fault:
        raise _refusal(text, fault, dimension=dimension, key=key) from None
    # The canonical text has to be read again: from a file, and where it is pickled.
    canonical = str(expression)
    nesting = max(accumulate((character == "(") - (character == ")") for character in canonical))
    if len(canonical) > longest or nesting > DEEPEST:
        raise misstated(
            key,
            f"{excerpt(text, width=30)} must fit into {longest} characters and {DEEPEST} nested"
            " parentheses when **0.5 is written as sqrt.",
        )
    return expression


def numpy_function(expression: Expression) -> ArrayFunction:
    """Return the expression as a function of arrays; overflow gives inf, undefined places nan,
    without warnings."""
    steps = program(expression.node, NumpyAlgebra())
    dimension = expression.dimension

    def function(y: ArrayLike) -> Array:
        array = np.asarray(y, dtype=np.float64)
        variables = [array]
        if dimension > 1:
            require_last_axis(array, dimension)
            variables = [array[..., index] for index in range(dimension)]
        with np.errstate(all="ignore"):  # inf and nan are answers here
            result = run(steps, variables)
        return np.array(np.broadcast_to(result, variables[0].shape), dtype=np.float64)

    return function


def require_last_axis(array: Array, length: int) -> None:
    """Raise ShapeError unless the last axis, that of components, has this length."""
    if array.ndim == 0 or array.shape[-1] != length:
        raise ShapeError(f"the last axis of y must have length {length}; got shape {array.shape}.")


def polynomial_degree(node: Node) -> int | None:
    """Return a bound on the degree as written (y**2 - y**2 counts 2), so that 0 and 1 are proofs;
    None without one."""
    count = 1 + max(variables_used(node), default=-1)
    degree = evaluate(node, (1.0,) * count, _DegreeAlgebra())
    return None if degree == inf else int(degree)


def variables_used(node: Node) -> tuple[int, ...]:
    """Return the indices, from 0 and increasing, of the variables that occur."""
    found = {part.own for part in postorder(node) if part.kind == "variable"}
    return tuple(sorted(found))


def _refusal(text: str, fault: Fault, *, dimension: int, key: str) -> SpecError:
    place = f"column {fault.start + 1}" if text.strip() else "an empty text"
    found = f"{fault.found} in {place}" if text.strip() else place
    guess = _repaired(text, fault.repair, dimension=dimension)
    cure = None if guess is None else f'did you mean "{guess}"?'
    return misstated(key, f"{excerpt(text, fault.start)}: found {found}; {fault.why}", cure)


def _repaired(text: str, repair: Repair | None, *, dimension: int) -> str | None:
    """Apply repairs until the text can be read; None if it cannot, or is too long to show."""
    for _ in range(_MOST_REPAIRS):  # one repair may show the next fault
        if repair is None or len(text) > _LONGEST_SUGGESTION:
            return None
        text = text[: repair.start] + repair.replacement + text[repair.end :]
        try:
            return to_text(parse(text, dimension), dimension=dimension)
        except Fault as fault:
            repair = fault.repair
    return None


class _DegreeAlgebra:
    """Algebra of degrees; infinite is "not a polynomial"."""

    multiply = staticmethod(operator.add)
    add = subtract = staticmethod(max)

    def constant(self, value: Fraction) -> float:
        return 0

    def pi(self) -> float:
        return 0

    def negate(self, operand: float) -> float:
        return operand

    def divide(self, left: float, right: float) -> float:
        return left if right == 0 else inf

    def power(self, base: float, exponent: int) -> float:
        if base in (0, inf):  # a constant stays one, and what is no polynomial does not become one
            return base
        return base * exponent if exponent >= 0 else inf

    def call(self, name: str, arguments: tuple[float, ...]) -> float:
        return inf if any(arguments) else 0
