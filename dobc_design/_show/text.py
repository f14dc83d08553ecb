"""Showing exact things to people: HTML escapes, LaTeX of rationals and matrices, MathML.

Only formatting: nothing is computed here beyond rounding for display.
"""

import html
import math
import re
from collections.abc import Iterable, Sequence
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, ROUND_UP, Context, Decimal
from fractions import Fraction

MAX_SHOWN = 12
NEGLIGIBLE = 1e-9  # 1/s: thirty years
Real = float | Fraction
_POWER = re.compile(r"e([+-]\d+)")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Written outside \text{}: inside, converters to MathML take a backslash literally and end at the
# first brace.
_SPECIAL = {"\\": r"\backslash", "^": r"\wedge", "~": r"\sim", "<": "<", ">": ">"} | {
    c: rf"\{c}" for c in "{}$&#%_"
}


def escape_html(text: object) -> str:
    """Escape user text for HTML, attributes included."""
    return html.escape(str(text), quote=True)


class Fragment(str):
    """HTML, SVG or MathML made by this package, with user text escaped already: templates insert it
    as it is."""

    __slots__ = ()

    def __html__(self) -> str:
        """Tell template engines that nothing is to be escaped."""
        return str(self)


def significant(value: Real | None, digits: int = 4) -> str:
    """Format a number with ``digits`` significant digits; None gives an en dash."""
    if value is None:
        return "–"
    if isinstance(value, Fraction):  # a float may be too small for it: 1e400 is a legal number
        exact = _rounded(value, digits, ROUND_HALF_EVEN)
        if abs(exact.adjusted()) > 300:
            return f"{exact.normalize():.{digits}g}"
        return f"{float(exact):.{digits}g}"
    return f"{value:.{digits}g}"


def significant_towards_zero(value: Real | None, digits: int = 4) -> str:
    """Format a number with ``digits`` significant digits, never larger in size than it is; None
    gives an en dash.

    Certified margins and rates stay claims that hold when they are shown.
    """
    return _directed(value, digits, ROUND_DOWN)


def significant_away_from_zero(value: Real | None, digits: int = 4) -> str:
    """The same, never smaller in size than it is: for upper bounds and times after which something
    holds."""
    return _directed(value, digits, ROUND_UP)


def rate_text(rate: float | None, digits: int = 4) -> str:
    """A certified rate, cut towards zero; of one that only says that errors decay no digits."""
    if rate is not None and 0 < rate < NEGLIGIBLE:
        return "> 0"
    return significant_towards_zero(rate, digits)


def _directed(value: Real | None, digits: int, rounding: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, float):
        # The number that is meant is its shortest text, as in a certificate.
        value = Fraction(repr(value))
    return f"{float(_rounded(value, digits, rounding)):.{digits}g}"


def _rounded(value: Fraction, digits: int, rounding: str) -> Decimal:
    """The quotient in decimals; a float would be rounded to the nearest first."""
    context = Context(prec=digits, rounding=rounding)
    return context.divide(Decimal(value.numerator), Decimal(value.denominator))


def typeset(text: str) -> str:
    """Write a number given as text with a real minus and a power of ten: -1.5e-08 as −1.5·10⁻⁸."""
    return _POWER.sub(
        lambda match: "·10" + str(int(match.group(1))).translate(RAISED), text
    ).replace("-", "−")


def lower(value: Real | None, unit: str = "") -> str:
    """A certified size or rate, cut towards zero, with its unit if there is one."""
    return with_unit(typeset(significant_towards_zero(value)), unit)


def upper(value: float | None, unit: str = "") -> str:
    """A certified time or bound, rounded up to four digits, with its unit if there is one."""
    return with_unit(typeset(significant_away_from_zero(value)), unit)


def with_unit(text: str, unit: str) -> str:
    """A number as text with its unit; an en dash is no number."""
    return f"{text} {unit}" if unit and text != "–" else text


def latex_number(value: Fraction) -> str:
    """LaTeX of a rational, exactly where it is short: a decimal, else a fraction; long ones as a
    rounded decimal."""
    top, bottom, longest = value.numerator, value.denominator, 12
    if 10**longest % bottom == 0 and Fraction(significant(value, 6)) == value:
        return latex_decimal(value, 6)
    if max(top.bit_length(), bottom.bit_length()) <= 4 * longest:
        if bottom == 1 and len(str(top)) <= longest:
            return str(top)
        if len(str(top)) + len(str(bottom)) <= longest:
            return rf"{'-' if top < 0 else ''}\frac{{{abs(top)}}}{{{bottom}}}"
    return latex_decimal(value)


def latex_decimal(value: Real, digits: int = 5) -> str:
    """LaTeX of a rounded decimal, powers of ten written out."""
    mantissa, _, exponent = significant(value, digits).partition("e")
    return rf"{mantissa}\cdot 10^{{{int(exponent)}}}" if exponent else mantissa


def latex_text(text: str) -> str:
    r"""The user's text inside \text{}; characters that LaTeX would act on stand beside it,
    escaped."""
    inside = "".join(rf"}}{_SPECIAL[each]} \text{{" if each in _SPECIAL else each for each in text)
    return rf"\text{{{inside}}}".replace(r"\text{}", "").strip()


def latex_matrix(matrix: Sequence[Sequence[Real]]) -> str | None:
    """LaTeX of a matrix, or None above 12 x 12."""
    if len(matrix) > MAX_SHOWN or (matrix and len(matrix[0]) > MAX_SHOWN):
        return None
    return latex_rows(" & ".join(map(_entry, row)) for row in matrix)


def latex_rows(rows: Iterable[str]) -> str:
    """LaTeX of a matrix, or of a column of functions, from its rows."""
    inside = r" \\ ".join(rows)
    return rf"\begin{{pmatrix}} {inside} \end{{pmatrix}}"


def _entry(x: Real) -> str:
    return rf"\text{{{x}}}" if isinstance(x, float) and not math.isfinite(x) else latex_decimal(x)


def mathml(latex: str, *, display: bool = False) -> str:
    """MathML of a LaTeX formula."""
    from latex2mathml.converter import convert  # costs 40 ms; only reports need it

    return str(convert(latex, display="block" if display else "inline"))


def visible(text: str) -> str:
    """Show control characters and lone surrogates as escapes."""
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode("ascii")
        for each in text
    )


def capitalize_first(text: str) -> str:
    """Make the first letter a capital and leave the others alone."""
    return text[:1].upper() + text[1:]
