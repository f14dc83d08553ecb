"""The expression tree as text: canonical (parses back to the same tree) and LaTeX.

Both are algebras whose values are pieces of text with the precedence of their outermost operator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.coupling.tree import Node, evaluate

LARGEST_DECIMAL_EXPONENT = 400  # of a number in a problem file
_LONGEST_PLAIN_NUMBER = 21

SUM, SIGN, PRODUCT, UNARY, POWER, ATOM = range(6)


@dataclass(frozen=True, slots=True)
class _Piece:
    text: str
    level: int
    head: str = ""  # LaTeX of a named function, before its arguments: the place for an exponent
    number: bool = False


def variable_names(dimension: int) -> tuple[str, ...]:
    """Return ("y",) for one variable, else ("y1", ..., "ym")."""
    return ("y",) if dimension == 1 else tuple(f"y{index + 1}" for index in range(dimension))


def to_text(node: Node, *, dimension: int = 1, compact: bool = False) -> str:
    """Write the tree in the language of the parser, with no parenthesis more than it needs.

    ``compact`` leaves out the spaces and takes the shortest form of every number.
    """
    variables = [_Piece(name, ATOM) for name in variable_names(dimension)]
    return evaluate(node, variables, _TextAlgebra(compact=compact)).text


def to_latex(node: Node, *, dimension: int = 1) -> str:
    r"""Write the tree as LaTeX mathematics: exp(y) - 1 + y becomes e^{y} - 1 + y."""
    names = ["y"] if dimension == 1 else [f"y_{{{index + 1}}}" for index in range(dimension)]
    return evaluate(node, [_Piece(name, ATOM) for name in names], _LatexAlgebra()).text


def decimal_text(value: Fraction, *, compact: bool = False) -> str | None:
    """Write a number >= 0 as an exact decimal; None if it has none (1/3)."""
    plain = _plain(value)
    if plain is None:
        return None
    if not compact and len(plain) <= _LONGEST_PLAIN_NUMBER:
        return plain
    scientific = _scientific(plain)
    if not compact:
        return scientific
    shortest = min(plain, scientific, key=len)
    return shortest[1:] if shortest.startswith("0.") else shortest


def _plain(value: Fraction) -> str | None:
    rest, twos, fives = value.denominator, 0, 0
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    if rest != 1:
        return None
    places = max(twos, fives)
    digits = str(value.numerator * 10**places // value.denominator).rjust(places + 1, "0")
    return digits if places == 0 else f"{digits[:-places]}.{digits[-places:]}"


def _scientific(plain: str) -> str:
    whole, _, decimals = plain.partition(".")
    digits = (whole + decimals).lstrip("0")
    if not digits:
        return "0"
    mantissa = digits.rstrip("0")
    exponent = len(digits) - len(mantissa) - len(decimals)
    limited = max(-LARGEST_DECIMAL_EXPONENT, min(LARGEST_DECIMAL_EXPONENT, exponent))
    moved = _plain(int(mantissa) * Fraction(10) ** (exponent - limited))
    return f"{moved}e{limited}" if limited else str(moved)


class _TextAlgebra:
    """Algebra of canonical text; see ``tree.Algebra``."""

    def __init__(self, *, compact: bool) -> None:
        self.compact = compact
        self.space = "" if compact else " "

    def constant(self, value: Fraction) -> _Piece:
        text = decimal_text(value, compact=self.compact)
        return _Piece(f"{value.numerator}/{value.denominator}", PRODUCT) if text is None else _Piece(text, ATOM)

    def pi(self) -> _Piece:
        return _Piece("pi", ATOM)

    def negate(self, operand: _Piece) -> _Piece:
        return _Piece("-" + _inside(operand, UNARY), UNARY)

    def add(self, left: _Piece, right: _Piece) -> _Piece:
        return self._sum(left, "+", right)

    def subtract(self, left: _Piece, right: _Piece) -> _Piece:
        return self._sum(left, "-", right)

    def multiply(self, left: _Piece, right: _Piece) -> _Piece:
        return _Piece(f"{_inside(left, PRODUCT)}*{_inside(right, UNARY)}", PRODUCT)

    def divide(self, left: _Piece, right: _Piece) -> _Piece:
        return _Piece(f"{_inside(left, PRODUCT)}/{_inside(right, UNARY)}", PRODUCT)

    def power(self, base: _Piece, exponent: int) -> _Piece:
        return _Piece(f"{_inside(base, ATOM)}**{exponent}", POWER)

    def call(self, name: str, arguments: tuple[_Piece, ...]) -> _Piece:
        inside = f",{self.space}".join(argument.text for argument in arguments)
        return _Piece(f"{name}({inside})", ATOM)

    def _sum(self, left: _Piece, sign: str, right: _Piece) -> _Piece:
        return _Piece(f"{left.text}{self.space}{sign}{self.space}{_inside(right, PRODUCT)}", SUM)


_LATEX_NAMES = {
    "log": r"\ln",
    "sin": r"\sin",
    "cos": r"\cos",
    "tan": r"\tan",
    "tanh": r"\tanh",
    "atan": r"\arctan",
    "sinh": r"\sinh",
    "cosh": r"\cosh",
    "min": r"\min",
    "max": r"\max",
    "clip": r"\operatorname{clip}",
}


class _LatexAlgebra:
    """Algebra of LaTeX; see ``tree.Algebra``."""

    def constant(self, value: Fraction) -> _Piece:
        text = decimal_text(value)
        if text is None:
            return _Piece(_fraction(str(value.numerator), str(value.denominator)), POWER)
        mantissa, _, exponent = text.partition("e")
        if not exponent:
            return _Piece(text, ATOM, number=True)
        power = f"10^{{{exponent}}}"
        return _Piece(power, POWER) if mantissa == "1" else _Piece(rf"{mantissa} \cdot {power}", PRODUCT)

    def pi(self) -> _Piece:
        return _Piece(r"\pi", ATOM)

    def negate(self, operand: _Piece) -> _Piece:
        return _Piece("-" + _latex_inside(operand, PRODUCT), SIGN)

    def add(self, left: _Piece, right: _Piece) -> _Piece:
        return _Piece(f"{left.text} + {_latex_inside(right, PRODUCT)}", SUM)

    def subtract(self, left: _Piece, right: _Piece) -> _Piece:
        return _Piece(f"{left.text} - {_latex_inside(right, PRODUCT)}", SUM)

    def multiply(self, left: _Piece, right: _Piece) -> _Piece:
        factor = _latex_inside(right, PRODUCT)
        if factor[0].isdigit() or (factor.startswith(r"\left(") and not left.number):
            dot = r" \cdot "
        else:
            dot = " " if left.number else r" \, "
        return _Piece(_latex_inside(left, SIGN) + dot + factor, SIGN if left.level == SIGN else PRODUCT)

    def divide(self, left: _Piece, right: _Piece) -> _Piece:
        return _Piece(_fraction(left.text, right.text), POWER)

    def power(self, base: _Piece, exponent: int) -> _Piece:
        if base.head and exponent > 0:
            return _Piece(f"{base.head}^{{{exponent}}}{base.text.removeprefix(base.head)}", POWER)
        if base.head:
            return _Piece(rf"\left({base.text}\right)^{{{exponent}}}", POWER)
        return _Piece(f"{_latex_inside(base, ATOM)}^{{{exponent}}}", POWER)

    def call(self, name: str, arguments: tuple[_Piece, ...]) -> _Piece:
        inside = ", ".join(argument.text for argument in arguments)
        if name == "exp":
            return _Piece(f"e^{{{inside}}}", POWER)
        if name == "sqrt":
            return _Piece(rf"\sqrt{{{inside}}}", ATOM)
        if name == "abs":
            return _Piece(rf"\left|{inside}\right|", ATOM)
        command = _LATEX_NAMES[name]
        # Between the name and its argument an exponent is usual for these, and misleading for the others.
        head = command if name in ("sin", "cos", "tan", "sinh", "cosh", "tanh") else ""
        return _Piece(rf"{command}\left({inside}\right)", ATOM if head else POWER, head=head)


def _inside(piece: _Piece, level: int) -> str:
    return piece.text if piece.level >= level else f"({piece.text})"


def _latex_inside(piece: _Piece, level: int) -> str:
    return piece.text if piece.level >= level else rf"\left({piece.text}\right)"


def _fraction(numerator: str, denominator: str) -> str:
    return rf"\frac{{{numerator}}}{{{denominator}}}"


def names_in_words(dimension: int) -> str:
    """Say which names the variables have: "y", or "y1 to y3"."""
    names: Sequence[str] = variable_names(dimension)
    return "y" if dimension == 1 else f"{names[0]} to {names[-1]}"
