"""The whitelist parser of coupling expressions: text to tree, Python's precedence, never ``eval``;
all is bounded."""

from __future__ import annotations

import operator
import re
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from fractions import Fraction
from typing import NamedTuple

from dobc_design._files import own_table
from dobc_design._show.text import visible
from dobc_design.errors import SpecError
from dobc_design.exact.interval import Interval
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import Texts, counted

from .functions import FUNCTIONS, NONSMOOTH, OTHER_NAMES
from .tree import LARGEST_EXPONENT, IntervalAlgebra, Node, names_in_words, variable_names

Kind = Enum("Kind", "NUMBER NAME SIGN END")


class Token(NamedTuple):
    """One word and the index of its first character."""

    kind: Kind
    text: str
    start: int

    @property
    def end(self) -> int:
        """Index of the character after it."""
        return self.start + len(self.text)

    def fault(self, why: str, repair: Repair | None = None) -> Fault:
        """The fault of a text that has this word here."""
        return Fault(self.start, quote(self), why, repair)


class Repair(NamedTuple):
    """Replace text[start:end] by ``replacement``: the guess behind "did you mean"."""

    start: int
    end: int
    replacement: str


@dataclass(eq=False)
class Fault(Exception):
    """The text is not in the language: what was found where, why that is wrong, perhaps a
    repair."""

    start: int
    found: str
    why: str
    repair: Repair | None = None


LONGEST_QUOTE = 40
_WORD = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<sign>\*\*|[-+*/(),])"
)
_BLANKS = " \t\r\n"
_STRANGERS = own_table("coupling/strangers.toml")
#: Why a character is not taken, and what may stand for it.
_CHARACTERS = {
    character: why
    for characters, why in _STRANGERS["characters"].items()
    for character in characters
}
#: Names of other languages, and what to write here.
_FOREIGN = {name: why for names, why in _STRANGERS["names"].items() for name in names.split()}
_ALLOWED = "only numbers, names, + - * / ** ( ) and commas are allowed, in ASCII"


def tokenize(text: str) -> list[Token]:
    """Split the text into words; the last one is of kind END.  Raises: Fault where no word
    begins."""
    words = []
    place = 0
    while place < len(text):
        if text[place] in _BLANKS:
            place += 1
            continue
        match = _WORD.match(text, place)
        if match is None:
            raise _stranger(text, place)
        kind = Kind[str(match.lastgroup).upper()]
        words.append(Token(kind, match.group(), place))
        place = match.end()
    return [*words, Token(Kind.END, "", len(text))]


def _stranger(text: str, place: int) -> Fault:
    character = text[place]
    # A character that looks like one of the language was meant as that one.
    why, *replacements = _CHARACTERS.get(character, [_ALLOWED])
    repair = Repair(place, place + 1, replacements[0]) if replacements else None
    found = "a quotation mark" if character == '"' else f'"{visible(character)}"'
    return Fault(place, found, why, repair)


def quote(token: Token) -> str:
    """Quote a word for a message, cut to a length that fits in a sentence."""
    return "the end" if token.kind is Kind.END else f'"{token.text[:LONGEST_QUOTE]}"'


def excerpt(text: str, place: int | None = None, *, width: int = 70) -> str:
    """Quote the text, or of a long one the part about ``place`` (the beginning without one)."""
    if len(text) <= width:
        return f'"{visible(text)}"'
    first = min(max(0, (place or 0) - width // 2), len(text) - width)
    end = first + width
    before = "..." if first else ""
    after = "..." if end < len(text) else ""
    return f'"{before}{visible(text[first:end])}{after}"'


def unknown_name(token: Token, *, dimension: int, called: bool) -> Fault:
    """Return the fault of a name that means nothing; ``called`` tells that ( follows it."""
    names = variable_names(dimension)
    word = token.text.lower()
    if word in _FOREIGN:
        return token.fault(_FOREIGN[word])
    number = word[1:].strip("_")  # of y_2
    if word[0] == "y" and (number.isdigit() or word == "y"):
        why = "the only variable is y"
        if dimension > 1:
            why = f"the variables are {names_in_words(dimension)}"
        guess = "y" if word == "y" and dimension == 1 else f"y{number or 1}"
        repair = Repair(token.start, token.end, guess) if guess in names else None
        return token.fault(why, repair)
    variables, functions = names_in_words(dimension), " ".join(FUNCTIONS)
    why = f"the names are {variables}, pi, and the functions {functions}"
    if word in OTHER_NAMES:
        why = f"it is called {OTHER_NAMES[word]} here"
    elif word == "x":
        why = f"the difference x_j - x_i is called {variables} here"
    repair = _guess_name(token, names=names, called=called)
    return token.fault(why, repair)


def _guess_name(token: Token, *, names: Texts, called: bool) -> Repair | None:
    word = token.text.lower()
    allowed = ["pi", *FUNCTIONS]
    # Of one or two letters everything is close to something.
    close = get_close_matches(word[:LONGEST_QUOTE], allowed, cutoff=0.7) if len(word) > 2 else []
    if word in ("x", "z") and not called:
        guess: str | None = names[0]
    elif word in allowed or word in OTHER_NAMES:
        guess = OTHER_NAMES.get(word, word)
    else:
        # Of several, the one with the same letters: tahn is tanh, not tan.
        guess = max(close, key=lambda name: sorted(name) == sorted(word), default=None)
    return None if guess is None else Repair(token.start, token.end, guess)


DEEPEST = 50
LARGEST_CONSTANT_BITS = 4096  # 9**64**64 would fill the memory

_BINARY = {
    "+": ("add", operator.add),
    "-": ("subtract", operator.sub),
    "*": ("multiply", operator.mul),
    "/": ("divide", operator.truediv),
}
_HALF = Fraction(1, 2)
_INTEGERS = f"integer from -{LARGEST_EXPONENT} to {LARGEST_EXPONENT}"
_EXPONENTS = f"an exponent must be a literal {_INTEGERS}, or 1/2 (written 0.5)"


class _Operand(NamedTuple):
    node: Node
    # the exact value of a constant, where it is rational by arithmetic alone
    value: Fraction | None


def parse(text: str, dimension: int) -> Node:
    """Parse an expression in ``dimension`` variables.  Raises: Fault, which says where the text
    leaves the language."""
    return _Parser(text, dimension).parse()


class _Parser:
    """Recursive descent; the only recursion is into parentheses, which are counted."""

    def __init__(self, text: str, dimension: int) -> None:
        self.tokens = tokenize(text)
        self.dimension = dimension
        self.place = 0  # of the next token
        self.depth = 0  # of open parentheses
        self.names = {name: index for index, name in enumerate(variable_names(dimension))}
        if dimension == 1:
            self.names["y1"] = 0

    @property
    def token(self) -> Token:
        return self.tokens[self.place]

    def parse(self) -> Node:
        if self._at_end():
            raise Fault(0, "nothing", f"write a function of {names_in_words(self.dimension)}")
        operand = self._sum()
        if not self._at_end():
            raise self._misplaced()
        return operand.node

    def _at_end(self) -> bool:
        return self.token.kind is Kind.END

    def _advance(self) -> Token:
        self.place += 1
        return self.tokens[self.place - 1]

    def _at(self, *signs: str) -> bool:
        return self.token.kind is Kind.SIGN and self.token.text in signs

    def _skip(self, sign: str) -> bool:
        found = self._at(sign)
        self.place += found
        return found

    def _sum(self) -> _Operand:
        left = self._product()
        while self._at("+", "-"):
            left = _join(left, self._advance(), self._product())
        return left

    def _product(self) -> _Operand:
        left = self._signed()
        while self._at("*", "/"):
            left = _join(left, self._advance(), self._signed())
        return left

    def _signed(self) -> _Operand:
        # A loop, since two thousand signs in a row are deeper than Python follows calls.
        minuses = 0
        while self._at("+", "-"):
            minuses += self._advance().text == "-"
        operand = self._power()
        for _ in range(minuses):
            negated = None if operand.value is None else -operand.value
            operand = _Operand(Node("negate", (operand.node,)), negated)
        return operand

    def _power(self) -> _Operand:
        base = self._atom()
        sign = self.token
        if not self._skip("**"):
            return base
        exponent = self._exponent()
        if self._at("**"):
            raise self.token.fault(f"{_EXPONENTS}; for a power of a power write (y**2)**3")
        if exponent == _HALF:  # a root is no power: its slope is not bounded at 0
            return _Operand(Node("call", (base.node,), "sqrt"), None)
        node = Node("power", (base.node,), exponent.numerator)
        if base.value is None:
            return _Operand(node, None)
        # Constants are computed at once: what has no value, or too long a one, is refused here.
        if base.value == 0 and exponent < 0:
            raise sign.fault("a negative power of zero has no value")
        return _Operand(node, _bounded(base.value**exponent.numerator, sign))

    def _exponent(self) -> Fraction:
        first = self.token
        parenthesised = self._skip("(")
        negative = self._skip("-")
        if not negative:
            self._skip("+")
        value = self._exponent_number()
        if parenthesised:
            divisor = self._exponent_number() if self._skip("/") else Fraction(1)
            value = value / divisor if divisor else Fraction(LARGEST_EXPONENT + 1)
            if not self._skip(")"):
                raise self.token.fault(_EXPONENTS)
        value = -value if negative else value
        if value != _HALF and (value.denominator != 1 or abs(value) > LARGEST_EXPONENT):
            hint = "; y**-0.5 is written 1/sqrt(y)" if value == -_HALF else ""
            read = self.tokens[: self.place]
            used = "".join(token.text for token in read if token.start >= first.start)
            raise Fault(first.start, f'"{used[:LONGEST_QUOTE]}"', _EXPONENTS + hint)
        return value

    def _exponent_number(self) -> Fraction:
        if self.token.kind is not Kind.NUMBER:
            raise self.token.fault(_EXPONENTS)
        return _number(self._advance())

    def _atom(self) -> _Operand:
        token = self.token
        if token.kind is Kind.NUMBER:
            value = _number(self._advance())
            return _Operand(Node("constant", own=value), value)
        if token.kind is Kind.NAME:
            return self._name()
        if self._at("("):
            self._open()
            inner = self._sum()
            self._close(token)
            return inner
        raise self.token.fault("here a number, a name or ( is needed")

    def _name(self) -> _Operand:
        token = self._advance()
        if token.text in FUNCTIONS:
            return self._call(token)
        if token.text == "pi":
            return _Operand(Node("pi"), None)
        if token.text in self.names:
            return _Operand(Node("variable", own=self.names[token.text]), None)
        raise unknown_name(token, dimension=self.dimension, called=self._at("("))

    def _call(self, name: Token) -> _Operand:
        if not self._at("("):
            follower = self.token
            wrapped = Repair(follower.start, follower.end, f"({follower.text})")
            repair = wrapped if follower.kind in (Kind.NAME, Kind.NUMBER) else None
            raise self.token.fault(f"{name.text} needs its argument in parentheses", repair)
        parenthesis = self._open()
        arguments = [] if self._at(")") else [self._sum()]
        while self._skip(","):
            arguments.append(self._sum())
        self._close(parenthesis)
        _check_arguments(name, arguments, end=self.tokens[self.place - 1].start)
        # Where all arguments are known numbers, min, max, clip and abs of them are, too.
        node = Node("call", tuple(argument.node for argument in arguments), name.text)
        return _Operand(node, _fold(name.text, [argument.value for argument in arguments]))

    def _open(self) -> Token:
        self.depth += 1
        if self.depth > DEEPEST:
            raise self.token.fault(f"parentheses may be nested at most {DEEPEST} deep")
        return self._advance()

    def _close(self, opened: Token) -> None:
        self.depth -= 1
        if self._skip(")"):
            return
        if self._at_end():
            repair = Repair(self.token.start, self.token.start, ")")
            raise self.token.fault(f'the "(" in column {opened.start + 1} is not closed', repair)
        raise self._misplaced()

    def _misplaced(self) -> Fault:
        """The fault of a word that cannot follow a complete operand."""
        token = self.token
        if self._at(")"):
            return self.token.fault("there is no ( that it closes")
        if self._at(","):
            return self.token.fault(
                "a comma only separates the arguments of min, max and clip; 0.5 has a point"
            )
        repair = Repair(token.start, token.start, "*")
        return self.token.fault("here an operator is needed; a product is written with *", repair)


def _number(token: Token) -> Fraction:
    mantissa, mark, exponent = token.text.lower().partition("e")
    if mantissa.startswith("."):  # numbers of files have a digit there
        mantissa = "0" + mantissa
    try:
        return parse_number(mantissa.removesuffix(".") + mark + exponent, "number")
    except SpecError as error:
        why = "a number has at most 200 characters, and an exponent of at most 400 in size"
        raise token.fault(why) from error


def _join(left: _Operand, sign: Token, right: _Operand) -> _Operand:
    kind, compute = _BINARY[sign.text]
    node = Node(kind, (left.node, right.node))
    if sign.text == "/" and right.value == 0:
        raise sign.fault("this divides by zero")
    if left.value is None or right.value is None:
        return _Operand(node, None)
    return _Operand(node, _bounded(compute(left.value, right.value), sign))


def _bounded(value: Fraction, token: Token) -> Fraction:
    if max(value.numerator.bit_length(), value.denominator.bit_length()) > LARGEST_CONSTANT_BITS:
        why = f"this constant needs more than {LARGEST_CONSTANT_BITS} bits (about 1233 digits)"
        raise token.fault(why)
    return value


def _check_arguments(name: Token, arguments: list[_Operand], *, end: int) -> None:
    fewest, most = FUNCTIONS[name.text].arguments
    if not fewest <= len(arguments) <= most:
        found = f"{quote(name)} with {len(arguments)} argument(s)"
        more = "" if most == fewest else " or more"
        wanted = counted(fewest, "argument") + more
        # sat(y), of other languages, has the bounds -1 and 1.
        bounds = (
            Repair(end, end, ", -1, 1") if name.text == "clip" and len(arguments) == 1 else None
        )
        raise Fault(name.start, found, f"{name.text} takes {wanted}", bounds)
    if name.text != "clip":
        return
    low, high = arguments[1].value, arguments[2].value
    if low is None or high is None:
        why = "the bounds of clip(y, lo, hi) must be rational constants; for others use min and max"
        raise name.fault(why)
    if low > high:
        raise name.fault("clip(y, lo, hi) needs lo <= hi")


def _fold(name: str, values: list[Fraction | None]) -> Fraction | None:
    """The exact value of a function of constants; None where it may be irrational."""
    points = tuple(Interval.point(value) for value in values if value is not None)
    if name not in NONSMOOTH or len(points) < len(values):
        return None
    return IntervalAlgebra().call(name, points).lo
