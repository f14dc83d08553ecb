"""Numbers, matrices, lists and comments as Coq writes them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from fractions import Fraction

from dobc_design.exact.matrix import Matrix
from dobc_design.export.squares import Square

WIDTH = 110  # characters of a line, where numbers allow it


def section(title: str) -> str:
    """A heading between the parts of a file."""
    return f"\n(* ---- {title} ---- *)\n"


def comment(*paragraphs: str) -> str:
    """A comment, whatever the text: it can neither end the comment nor open a comment or string in it."""
    lines = [line for text in paragraphs for line in textwrap.wrap(_harmless(text), WIDTH - 6)]
    return "\n(* " + "\n   ".join(lines) + " *)"


def number(x: Fraction) -> str:
    """A rational: 3, (-3), (3 # 7)."""
    if x.denominator == 1:
        return str(x.numerator) if x >= 0 else f"({x.numerator})"
    return f"({x.numerator} # {x.denominator})"


def matrix(M: Matrix) -> str:
    """A matrix by its rows."""
    return "matrix [" + "; ".join("[" + "; ".join(number(x) for x in row) + "]" for row in M) + "]"


def wrapped_list(items: Iterable[str]) -> str:
    """A list over as many lines as it needs."""
    lines: list[str] = []
    for item in items:
        if lines and len(lines[-1]) + len(item) + 6 <= WIDTH:
            lines[-1] += f"; {item}"
        else:
            lines.append(item)
    return "  [" + ";\n   ".join(lines) + "]"


def square_list(squares: Iterable[Square]) -> str:
    """The columns of L with their entries of D, in the order of elimination."""
    items = []
    for each in squares:
        terms = [f"Term {i} {number(x)}" for i, x in each.others.items()]
        items.append(f"Square {number(each.weight)} {each.pivot}" + ("\n  " + wrapped_list(terms) if terms else " []"))
    return "  [" + ";\n   ".join(items) + "]"


def _harmless(text: str) -> str:
    text = text.replace('"', "'").replace("(*", "( *").replace("*)", "* )")
    return text.encode("ascii", "backslashreplace").decode("ascii")
