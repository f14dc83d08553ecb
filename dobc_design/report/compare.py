"""Two certificates side by side: verdicts, checks, certified starts, and what differs between the problems.

A comparison shows what the two certificates claim; it decides nothing and proves nothing anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from dobc_design._show.text import Fragment, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.report.differences import MOST, differences
from dobc_design.report.markdown import escape
from dobc_design.report.network_words import pin_sentence, size_sentence
from dobc_design.report.pictures import Picture, network_pictures
from dobc_design.report.region_words import region_rows
from dobc_design.report.words import SYMBOLS, capitalize_first, check_name, covering_domain, domain_words, typeset
from dobc_design.verdict import Verdict

SIDES = ("A", "B")
ABSENT = "–"
MOST_ROWS = 150
MOST_PICTURES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One check of one certificate: verdict (or an en dash), its sign, margin and rate as text."""

    verdict: str
    symbol: str
    margin: str
    rate: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One check in both; ``differs`` if its verdict, margin or rate does."""

    name: str
    id: str
    mode: str | None
    cells: tuple[Cell, Cell]

    @property
    def differs(self) -> bool:
        """Whether the two say something else."""
        return self.cells[0] != self.cells[1]


def compare_html(first: Certificate, second: Certificate) -> str:
    """The comparison as one HTML page: no script, no network, readable on paper and in the dark."""
    environment = Environment(
        loader=PackageLoader("dobc_design.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"capitalize_first": capitalize_first, "typeset": typeset}
    view = comparison_view(first, second) | {"pictures": comparison_pictures(first, second)}
    return environment.get_template("compare.html.j2").render(view) + "\n"


def comparison_view(first: Certificate, second: Certificate) -> dict[str, Any]:
    """What the page and the Markdown text have in common."""
    both = (first, second)
    changed, count = differences(first.problem, second.problem)
    rows = check_pairs(first, second)
    return {
        "sides": [_side(letter, each) for letter, each in zip(SIDES, both, strict=True)],
        "conclusion": conclusion(first, second),
        "facts": _facts(both),
        "rows": rows[:MOST_ROWS],
        "rows_hidden": max(0, len(rows) - MOST_ROWS),
        "regions": region_pairs(first, second),
        "differences": changed,
        "difference_sentence": _difference_sentence(count),
    }


def conclusion(first: Certificate, second: Certificate) -> str:
    """The comparison in a sentence or two."""
    if first.verdict is not second.verdict:
        return f"A is {first.verdict.value}, B is {second.verdict.value}."
    if first.verdict is not Verdict.PROVED:
        return f"Both are {first.verdict.value}."
    a, b = first.rate or 0.0, second.rate or 0.0
    if a == b:
        return "Both are proved, at the same certified rate."
    better, worse = ("A", "B") if a > b else ("B", "A")
    high, low = (_rate(value) for value in (max(a, b), min(a, b)))
    return f"Both are proved. {better} has the larger certified rate, {high} against {low} 1/s of {worse}."


def check_pairs(first: Certificate, second: Certificate) -> list[Row]:
    """Every check that one of them has, in the order of A, then those that only B has."""
    left = {(check.id, check.mode): check for check in first.checks}
    right = {(check.id, check.mode): check for check in second.checks}
    return [
        Row(
            name=check_name(left.get(key) or right[key]),
            id=key[0],
            mode=key[1],
            cells=(_cell(left.get(key)), _cell(right.get(key))),
        )
        for key in dict.fromkeys([*left, *right])
    ]


def region_pairs(first: Certificate, second: Certificate) -> list[tuple[str, tuple[str, str]]]:
    """(method, (starts in A, starts in B)) of every method that says something about starts."""
    tables = [
        {row.name: row.starts for row in region_rows(each.regions)} if each.regions.tried else {}
        for each in (first, second)
    ]
    names = dict.fromkeys([*tables[0], *tables[1]])
    return [(name, (tables[0].get(name, ABSENT), tables[1].get(name, ABSENT))) for name in names]


def compare_markdown(first: Certificate, second: Certificate) -> str:
    """The comparison as Markdown."""
    view = comparison_view(first, second)
    return "\n".join(_markdown(view)).rstrip() + "\n"


def _markdown(view: dict[str, Any]) -> Iterator[str]:
    a, b = view["sides"]
    yield f"# {escape(a['name'])} and {escape(b['name'])}, compared\n"
    yield f"**{escape(view['conclusion'])}** {escape(view['difference_sentence'])}\n"
    for side in (a, b):
        verdict = f"{side['symbol']} {side['verdict']}. {escape(side['reason'])}"
        yield f"- **{side['letter']}**, {escape(side['name'])}: {verdict}"
    yield ""
    yield from _table(["", "A", "B"], [[name, *values] for name, values in view["facts"]])
    yield "## What differs between the problems\n"
    yield escape(view["difference_sentence"]) + "\n"
    if view["differences"]:
        yield from _table(["key", "A", "B"], [[each.key, each.first, each.second] for each in view["differences"]])
    yield "## What was checked\n"
    yield from _table(
        ["condition", "A", "B", "margin A", "margin B", "rate A", "rate B"],
        [
            [
                row.name if row.mode is None else f"{row.name}, mode {row.mode}",
                *(f"{cell.symbol} {cell.verdict}".strip() for cell in row.cells),
                *(cell.margin for cell in row.cells),
                *(cell.rate for cell in row.cells),
            ]
            for row in view["rows"]
        ],
    )
    if view["regions"]:
        yield "## From which starts\n"
        yield from _table(["method", "A", "B"], [[name, *starts] for name, starts in view["regions"]])


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    yield from (f"| {' | '.join(escape(cell) for cell in row)} |" for row in rows)
    yield ""


def _side(letter: str, certificate: Certificate) -> dict[str, Any]:
    return {
        "letter": letter,
        "name": certificate.problem.name,
        "verdict": certificate.verdict.value,
        "symbol": SYMBOLS[certificate.verdict],
        "reason": certificate.reason,
        "problem": f"{size_sentence(certificate.problem)} {pin_sentence(certificate.problem)}",
        "sha256": certificate.claims.problem_sha256,
        "version": certificate.claims.version,
        "notes": certificate.claims.notes[:20],
    }


def _facts(both: Sequence[Certificate]) -> list[tuple[str, tuple[str, ...]]]:
    domains = [covering_domain(each) for each in both]
    covering = [next((check for check in each.checks if check.id == each.covered_by), None) for each in both]
    return [
        ("verdict", tuple(each.verdict.value for each in both)),
        ("holds for", tuple(ABSENT if domain is None else domain_words(domain) for domain in domains)),
        ("certified rate in 1/s", tuple(_rate(each.rate) for each in both)),
        ("carried by", tuple(ABSENT if check is None else check_name(check) for check in covering)),
        ("agents", tuple(str(each.problem.n) for each in both)),
        ("modes", tuple(str(len(each.problem.network.modes)) for each in both)),
        ("pinned agents", tuple(str(len(each.problem.pinning.agents)) for each in both)),
        ("checks proved", tuple(_proved(each) for each in both)),
    ]


def _proved(certificate: Certificate) -> str:
    return f"{sum(check.verdict is Verdict.PROVED for check in certificate.checks)} of {len(certificate.checks)}"


def _difference_sentence(count: int) -> str:
    if not count:
        return "The two problems are the same."
    text = f"The two problems differ in {count} {'place' if count == 1 else 'places'}."
    return text if count <= MOST else f"{text} The first {MOST} are listed."


def _cell(check: Check | None) -> Cell:
    if check is None:
        return Cell(verdict=ABSENT, symbol="", margin=ABSENT, rate=ABSENT)
    return Cell(
        verdict=check.verdict.value,
        symbol=SYMBOLS[check.verdict],
        margin=typeset(significant_towards_zero(check.margin)),
        rate=_rate(check.rate),
    )


def _rate(value: float | None) -> str:
    return typeset(significant_towards_zero(value))


def comparison_pictures(first: Certificate, second: Certificate) -> list[list[Picture]]:
    """The networks of A and of B; none where they are the same."""
    if first.problem.network == second.problem.network and first.problem.pinning == second.problem.pinning:
        return []
    found = []
    for letter, each in zip(SIDES, (first, second), strict=True):
        pictures, _ = network_pictures(each)
        found.append(
            [
                Picture(svg=_renamed(each.svg, letter), title=f"{letter}: {each.title}", caption=each.caption)
                for each in pictures[:MOST_PICTURES]
            ]
        )
    return found if all(found) else []


def _renamed(svg: Fragment, letter: str) -> Fragment:
    """The same drawing with identifiers of its own, since both stand on one page."""
    return Fragment(svg.replace('"network-', f'"{letter}-network-').replace("#network-", f"#{letter}-network-"))
