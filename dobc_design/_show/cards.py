"""How nouns and results show themselves: one look in notebooks, light or dark, and small whatever
their size.

A class that derives from ``Shown`` says with ``_card`` what is shown of it; without it, its fields
are.  HTML and LaTeX are made of the same card.  Text is escaped, mathematics is MathML, matrices
end at 12 x 12, lists and tables are cut. Nothing is computed here.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import fields
from enum import Enum
from fractions import Fraction
from itertools import islice
from typing import Any

from dobc_design._checks import noun

from .text import (
    MAX_SHOWN,
    Fragment,
    escape_html,
    latex_matrix,
    latex_number,
    latex_text,
    mathml,
    significant,
)

Fact = tuple[str, Any]  # of a card: a name and a value
Facts = list[Fact]
MOST_ITEMS, MOST_ROWS, MOST_FACTS = 12, 40, 60
LONGEST_TEXT, LONGEST_REPR = 600, 900  # characters
SIGNS = {"proved": "✓", "refuted": "✗", "undecided": "?"}

# Colours of lines are readable on white and on black; letters keep the colour of the page they
# stand on.
STYLE = Fragment(
    "<style>.dobc-shown{overflow-x:auto;max-width:70em}.dobc-shown p{margin:.35em 0}"
    ".dobc-shown table{border-collapse:collapse;margin:.4em 0;color:inherit}"
    ".dobc-shown :is(th,td){text-align:left!important;vertical-align:top;padding:.25em "
    ".8em .25em .3em;"
    "border:0;border-bottom:1px solid #8886;font-weight:400;color:inherit;max-width:46em}"
    ".dobc-shown thead th{font-weight:600}.dobc-shown tbody th{white-space:nowrap}"
    ".dobc-shown .dobc-verdict{font-weight:600;padding:0 .45em;border:2px solid "
    "#87c;border-radius:4px;"
    "white-space:nowrap}.dobc-shown .dobc-proved{border-color:#0a9e6e}.dobc-shown "
    ".dobc-refuted{border-color:#d55e00}"
    "</style>"
)


class Formula(str):
    """LaTeX mathematics, made by this package."""

    __slots__ = ()


@noun
class Card:
    """What is shown of one value.

    ``facts``: pairs of a name and a value of any kind; ``heads`` and ``rows``: one table,
    ``hidden`` of whose rows are left out already; ``lines``: sentences below it.
    """

    title: str
    verdict: str | None = None
    text: str = ""
    facts: Sequence[Fact] = ()
    heads: Sequence[str] = ()
    rows: Sequence[Sequence[Any]] = ()
    hidden: int = 0
    lines: Sequence[str] = ()


class Shown:
    """Shows itself in Jupyter and at the prompt."""

    __slots__ = ()

    def _card(self) -> Card:
        return Card(
            title=type(self).__name__,
            facts=[(name.replace("_", " "), x) for name, x in own_fields(self)],
        )

    def _repr_html_(self) -> str:
        return html_of(self._card())

    def _repr_latex_(self) -> str | None:
        return latex_of(self._card())

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={plain(value)}" for name, value in own_fields(self))
        return cut(f"{type(self).__name__}({inside})", LONGEST_REPR)


class Told(Shown):
    """Shows itself by its sentence."""

    __slots__ = ()

    def _card(self) -> Card:
        return Card(title=type(self).__name__, text=str(self))


class Headed(Shown):
    """Shows itself at the prompt by the first line of its text, which is the text of its card."""

    __slots__ = ()

    def __str__(self) -> str:
        return text_of(self._card())

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {cut(str(self).partition(chr(10))[0])}>"


def own_fields(value: object) -> Iterator[Fact]:
    """Names and values of the fields of a dataclass that say something: not None and not empty."""
    for each in fields(value):  # type: ignore[arg-type]  # any dataclass
        found = getattr(value, each.name)
        if (
            each.repr
            and found is not None
            and not (isinstance(found, (str, tuple, Mapping)) and not found)
        ):
            yield each.name, found


def html_of(card: Card) -> str:
    """The card as HTML, with its style, for any page."""
    badge = "" if card.verdict is None else f" {verdict_html(card.verdict)}"
    text = f" {escape_html(cut(card.text))}" if card.text else ""
    parts = [f"<p><b>{escape_html(cut(card.title))}</b>{badge}{text}</p>"]
    if card.facts:
        parts.append(_facts_html(card.facts))
    if card.rows or card.hidden:
        heads = "".join(f'<th scope="col">{escape_html(head)}</th>' for head in card.heads)
        rows = [
            "".join(f"<td>{value_html(cell)}</td>" for cell in row) for row in card.rows[:MOST_ROWS]
        ]
        body = "".join(f"<tr>{cells}</tr>" for cells in rows)
        parts.append(f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>")
        parts.append(_more(card.hidden + max(0, len(card.rows) - MOST_ROWS)))
    parts += [f"<p>{escape_html(cut(line))}</p>" for line in card.lines[:MOST_ITEMS]]
    parts.append(_more(len(card.lines) - MOST_ITEMS))
    return f'<div class="dobc-shown">{STYLE}{"".join(parts)}</div>'


def text_of(card: Card) -> str:
    """The card as text: title, verdict and words; below them facts, the table in columns, and
    sentences."""
    verdict = "" if card.verdict is None else f" {card.verdict.upper()}."
    head = f"{card.title}:{verdict} {card.text}" if card.verdict or card.text else card.title
    facts = (
        f"{name}: {value if isinstance(value, str) else plain(value, quoted=False)}"
        for name, value in card.facts
    )
    cells = [
        ["–" if x is None else x if isinstance(x, str) else plain(x) for x in row]
        for row in card.rows
    ]
    rows = [*([list(card.heads)] if any(card.heads) else []), *cells]
    # Columns as wide as their longest cell; no cell is cut.
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n  ".join([head, *facts, *table, *card.lines])


def latex_of(card: Card) -> str | None:
    """The mathematics of the card as displayed equations; None if there is none."""
    lines = []
    for name, value in card.facts:
        if isinstance(value, Formula):
            lines.append(str(value))
        elif is_matrix(value) and (entries := latex_matrix(value)) is not None:
            lines.append(f"{name if len(name) == 1 else latex_text(name)} = {entries}")
    return "\n".join(f"$$ {line} $$" for line in lines) or None


def verdict_html(verdict: object) -> str:
    """A verdict with its sign, framed in its colour."""
    word, sign = escape_html(verdict), SIGNS.get(str(verdict), "")
    return (
        f'<span class="dobc-verdict dobc-{word}"><span aria-hidden="true">{sign}</span> '
        f"{word}</span>"
    )


def cut(text: str, longest: int = LONGEST_TEXT) -> str:
    """The text, or its beginning."""
    return text if len(text) <= longest else f"{text[: longest - 2]} …"


def listed(items: Iterable[Any], *, count: int | None = None) -> str:
    """Items as text, the first few of them; ``count`` is how many there are where ``items`` has no
    length."""
    shown = [plain(item, quoted=False) for item in islice(items, MOST_ITEMS)]
    # What has no length is an iterator, of which only the first items are taken.
    known = len(items) if isinstance(items, (Sequence, AbstractSet, Mapping)) else len(shown)
    more = (known if count is None else count) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def is_matrix(value: object) -> bool:
    """Whether it is a tuple of equally long tuples of numbers."""
    return (
        isinstance(value, tuple)
        and bool(value)
        and all(
            isinstance(row, tuple) and len(row) == len(value[0]) and len(row) > 0 for row in value
        )
        and all(isinstance(x, (Fraction, int, float)) for x in value[0])
    )


def plain(value: object, *, quoted: bool = True) -> str:
    """A value as short text: rationals as they are typed, long lists cut."""
    if isinstance(value, Enum):
        return str(value)
    if isinstance(value, str):
        return repr(cut(value, 80)) if quoted else cut(value, 80)
    if isinstance(value, Fraction):
        return significant(value, 6) if len(str(value)) > 2 * MAX_SHOWN else str(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (Mapping, tuple, list, frozenset, set)):
        first = list(islice(value, MOST_ITEMS))
        items = [plain(item, quoted=quoted) for item in first]
        if isinstance(value, Mapping):
            items = [
                f"{key}: {plain(value[own], quoted=quoted)}"
                for key, own in zip(items, first, strict=True)
            ]
        if len(value) > MOST_ITEMS:
            items.append(f"and {len(value) - MOST_ITEMS} more")
        return f"{{{', '.join(items)}}}" if isinstance(value, Mapping) else f"[{', '.join(items)}]"
    return cut(repr(value) if quoted else str(value), 200)


def value_html(value: Any) -> str:
    """One value as HTML: mathematics as MathML, a nested card as a table, everything else as
    escaped text."""
    if value is None:
        return "–"
    if isinstance(value, Fragment):
        return str(value)
    if isinstance(value, Formula):
        return mathml(value)
    if isinstance(value, Enum) and value.value in SIGNS:
        return verdict_html(value.value)
    if isinstance(value, Fraction):
        return mathml(latex_number(value))
    if is_matrix(value):
        entries = latex_matrix(value)
        if entries is None:
            return f"{len(value)} × {len(value[0])} matrix, too large to be shown"
        return mathml(entries)
    if isinstance(value, Shown):
        card = value._card()
        return _facts_html(card.facts) if card.facts else escape_html(cut(card.text or card.title))
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (tuple, list)):
        return escape_html(listed(value))
    return escape_html(cut(plain(value, quoted=False) if not isinstance(value, str) else value))


def _facts_html(facts: Sequence[Fact]) -> str:
    rows = [
        f'<tr><th scope="row">{escape_html(x)}</th><td>{value_html(y)}</td></tr>'
        for x, y in facts[:MOST_FACTS]
    ]
    return f"<table><tbody>{''.join(rows)}</tbody></table>{_more(len(facts) - MOST_FACTS)}"


def _more(count: int) -> str:
    return f"<p>and {count} more</p>" if count > 0 else ""
