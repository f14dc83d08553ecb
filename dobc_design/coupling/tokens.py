"""Words of the expression language, each with its place in the text, and what to say when one is wrong.

A ``Fault`` is what the tokenizer and the parser raise; ``expression`` turns it into an ExpressionError.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from dobc_design._show.text import visible


class Kind(Enum):
    """The kinds of words."""

    NUMBER = "a number"
    NAME = "a name"
    SIGN = "an operator"
    END = "the end"


@dataclass(frozen=True, slots=True)
class Token:
    """One word and the index of its first character."""

    kind: Kind
    text: str
    start: int

    @property
    def end(self) -> int:
        """Index of the character after it."""
        return self.start + len(self.text)


@dataclass(frozen=True, slots=True)
class Repair:
    """Replace text[start:end] by ``replacement``: the guess behind "did you mean"."""

    start: int
    end: int
    replacement: str


class Fault(Exception):
    """The text is not in the language: what was found where, why that is wrong, perhaps a repair."""

    def __init__(self, start: int, found: str, why: str, *, repair: Repair | None = None) -> None:
        super().__init__(why)
        self.start, self.found, self.why, self.repair = start, found, why, repair


LONGEST_QUOTE = 40
_WORD = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<sign>\*\*|[-+*/(),])"
)
_BLANK = re.compile(r"[ \t\r\n]*")
_LOOKALIKES = {
    "^": ("**", "a power is written y**2"),
    "[": ("(", "only round parentheses are used"),
    "]": (")", "only round parentheses are used"),
    "{": ("(", "only round parentheses are used"),
    "}": (")", "only round parentheses are used"),
    "|": (None, "the absolute value is written abs(y)"),
    "=": (None, "give the right-hand side only"),
    ".": (None, "functions are written without a module, as in exp(y)"),
    "\u2212": ("-", "it only looks like a minus"),
    "\u2013": ("-", "it only looks like a minus"),
    "\u00d7": ("*", "a product is written *"),
    "\u00b7": ("*", "a product is written *"),
    "\u22c5": ("*", "a product is written *"),
    "\u00f7": ("/", "a quotient is written /"),
    "\u03c0": ("pi", "the number is written pi"),
    "\u00b2": ("**2", "a power is written y**2"),
    "\u00b3": ("**3", "a power is written y**3"),
    "\u221a": ("sqrt", "the square root is written sqrt(y)"),
    "\u00a0": (" ", "it only looks like a space"),
}
_ALLOWED = "only numbers, names, + - * / ** ( ) and commas are allowed, in ASCII"


def tokenize(text: str) -> list[Token]:
    """Split the text into words; the last one is of kind END.

    Raises: Fault at the first character that begins no word.
    """
    words: list[Token] = []
    place = _skip_blank(text, 0)
    while place < len(text):
        match = _WORD.match(text, place)
        if match is None:
            raise _stranger(text, place)
        words.append(Token(Kind[str(match.lastgroup).upper()], match.group(), place))
        place = _skip_blank(text, match.end())
    words.append(Token(Kind.END, "", len(text)))
    return words


def _skip_blank(text: str, place: int) -> int:
    match = _BLANK.match(text, place)
    return place if match is None else match.end()


def _stranger(text: str, place: int) -> Fault:
    character = text[place]
    replacement, why = _LOOKALIKES.get(character, (None, _ALLOWED))
    repair = None if replacement is None else Repair(place, place + 1, replacement)
    found = "a quotation mark" if character == '"' else f'"{visible(character)}"'
    return Fault(place, found, why, repair=repair)


def quote(token: Token) -> str:
    """Quote a word for a message, cut to a length that fits in a sentence."""
    return "the end" if token.kind is Kind.END else f'"{token.text[:LONGEST_QUOTE]}"'


def excerpt(text: str, place: int | None = None, *, width: int = 70) -> str:
    """Quote the text, or of a long one the part about ``place`` (the beginning without one)."""
    if len(text) <= width:
        return f'"{visible(text)}"'
    first = min(max(0, (place or 0) - width // 2), len(text) - width)
    shown = visible(text[first : first + width])
    return f'"{"..." if first else ""}{shown}{"..." if first + width < len(text) else ""}"'
