"""C99 as text: literals in either precision, strings, comments, arrays, and functions from
expression trees.

Text of users appears in strings and comments only, escaped, so that no label can end either.
"""

import re
from collections.abc import Sequence
from fractions import Fraction
from functools import cache

import numpy as np
from jinja2 import Template

from dobc_design._files import own_text
from dobc_design.coupling.expression import (
    ATOM,
    Expression,
    Infix,
    Piece,
    evaluated,
    variables_used,
)
from dobc_design.coupling.functions import FUNCTIONS, applied
from dobc_design.errors import refused

PRECISIONS = ("double", "float")
HELPERS = ("abs", "min", "max")  # functions that templates/agent.c.j2 has, beside power


@cache
def template(name: str) -> Template:
    """A file of ``templates/``: text with places for text that is C already: nothing is escaped
    here."""
    made: Template = Template(
        template_text(name), trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    return made


def template_text(name: str) -> str:
    """A file of ``templates/`` as it stands."""
    return own_text(f"export/templates/{name}")


def rounded(value: Fraction, precision: str) -> Fraction:
    """The number of this precision that stands for ``value`` in the code, exactly.  Raises:
    SpecError if too large."""
    try:
        near = np.float64(value.numerator / value.denominator)
        with np.errstate(over="ignore"):
            written = near if precision == "double" else np.float32(near)
            return Fraction(float(written))
    except OverflowError:
        digits = len(str(abs(value.numerator))) - len(str(value.denominator))
        message = f"every number of the code must fit into a {precision}; one of the problem's "
        message += f"does not (about 10^{digits})."
        cure = "Use other units." if precision == "double" else "Use --precision double."
        raise refused("export", message, cure) from None


def literal(value: Fraction, precision: str) -> str:
    """A C literal that reads back as ``rounded(value)``; negative ones stand in parentheses."""
    number = rounded(value, precision)
    # The shortest text that reads back as the same number in its precision.
    text = repr(float(number)) if precision == "double" else str(np.float32(float(number)))
    # 2 would be an int, and 1/2 then 0.
    if "." not in text and "e" not in text:
        text += ".0"
    text += "" if precision == "double" else "f"
    return f"({text})" if text.startswith("-") else text


def array(rows: Sequence[Sequence[Fraction]], precision: str) -> str:
    """A two-dimensional initializer, one row a line."""
    inside = ",\n".join(f"    {row(each, precision)}" for each in rows)
    return "{\n" + inside + "\n}"


def row(values: Sequence[Fraction], precision: str) -> str:
    """A one-dimensional initializer."""
    return "{" + ", ".join(bare(value, precision) for value in values) + "}"


def bare(value: Fraction, precision: str) -> str:
    """A literal where no sign can be misread, without parentheses."""
    return literal(value, precision).strip("()")


def string(text: str) -> str:
    """A C string literal of the UTF-8 bytes of ``text``; octal escapes end by themselves and make
    no trigraphs."""
    # No question mark: two of them begin a trigraph.
    plain = set(range(32, 127)) - {ord('"'), ord("\\"), ord("?")}
    written = [chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode("utf-8")]
    return '"' + "".join(written) + '"'


def comment(text: str) -> str:
    """``text`` for the inside of a comment: ASCII, on one line, without what could end or extend
    it."""
    # No backslash and no question mark: they continue lines, and trigraphs spell backslashes.
    safe = "".join(each if 32 <= ord(each) < 127 and each not in "\\?" else "_" for each in text)
    return safe.replace("*/", "* /").replace("/*", "/ *")


class CAlgebra(Infix):
    """Algebra (``Algebra``) of C expressions; ``used`` collects helpers, ``library``: <math.h> is
    needed."""

    def __init__(self, precision: str) -> None:
        self.precision = precision
        self.suffix = "" if precision == "double" else "f"
        self.used: set[str] = set()
        self.library = False

    def constant(self, value: Fraction) -> Piece:
        return Piece(literal(value, self.precision), ATOM)

    def pi(self) -> Piece:
        return Piece("3.14159265358979323846" + self.suffix, ATOM)

    def power(self, base: Piece, exponent: int) -> Piece:
        self.used.add("power")
        return Piece(f"dobc_power({base.text}, {exponent})", ATOM)

    def call(self, name: str, arguments: tuple[Piece, ...]) -> Piece:
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Piece) -> Piece:
        inside = ", ".join(each.text for each in operands)
        if name in HELPERS:
            self.used.add(name)
            return Piece(f"dobc_{name}({inside})", ATOM)
        self.library = True
        return Piece(f"{FUNCTIONS[name].c or name}{self.suffix}({inside})", ATOM)


def function(
    head: str,
    expressions: Sequence[Expression],
    texts: Sequence[str],
    algebra: CAlgebra,
    *,
    m: int,
) -> str:
    """A C function whose ``head`` is "NAME(y, h)": it writes h(y), for y with m components."""
    name, y, h = re.findall(r"\w+", head)
    lines = [f"/* {h}({y}) = {comment(', '.join(texts))} */"]
    parameters = f"const dobc_real *{y}, dobc_real *{h}"
    lines += [f"static void {name}({parameters})", "{"]
    # Or the compiler warns of a parameter that nothing uses.
    if not any(variables_used(each.node) for each in expressions):
        lines.append(f"    (void){y};")
    components = [Piece(f"{y}[{c}]", ATOM) for c in range(m)]
    for c, value in enumerate(evaluated(expressions, components, algebra)):
        lines.append(f"    {h}[{c}] = {value.text};")
    return "\n".join([*lines, "}", ""])
