"""Two certificates side by side: verdicts, checks, certified starts, and what differs between the problems.

A comparison shows what the two certificates claim; it decides nothing and proves nothing anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dobc_design._show.text import significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.problem.canonical import canonical_document
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report.pictures import network_pictures
from dobc_design.report.region_words import region_rows
from dobc_design.report.words import (
    covering_domain,
    domain_words,
    mark_of,
    pin_sentence,
    shortened,
    size_sentence,
    typeset,
)
from dobc_design.verdict import Verdict

SIDES = ("A", "B")
ABSENT = "–"
MOST_ROWS = 150
MOST_PICTURES = 4
MOST_NOTES = 20
MOST_DIFFERENCES = 60
MOST_ARCS = 8  # arcs of one mode that are named one by one
LONGEST_NAME = 30  # characters, in the footer
LONGEST = 160  # characters of a value
TABLES = ("exosystem", "observer", "region", "switching", "simulation")


def comparison_document(first: Certificate, second: Certificate) -> doc.Document:
    """Both certificates as one document."""
    both = (first, second)
    a, b = (each.problem.name for each in both)
    changed, count = differences(first.problem, second.problem)
    told = _difference_sentence(count)
    summary = doc.table_of(
        "Facts about both certificates",
        FACTS,
        (doc.Column(head=""), lambda fact: fact[0]),
        (doc.Column(head="A"), lambda fact: fact[1](first)),
        (doc.Column(head="B"), lambda fact: fact[1](second)),
    )
    keys = doc.table_of(
        "Keys of the problem file whose values differ",
        changed,
        (doc.Column(head="key", width=1.2), lambda each: each.key),
        (doc.Column(head="A", style="why"), lambda each: shortened(each.first, LONGEST)),
        (doc.Column(head="B", style="why"), lambda each: shortened(each.second, LONGEST)),
    )
    verdicts = tuple(
        (doc.Strong(letter), f", {each.problem.name}: {mark_of(each.verdict)}. {each.reason}")
        for letter, each in zip(SIDES, both, strict=True)
    )
    blocks: tuple[doc.Block, ...] = (
        doc.Only(("markdown",), (doc.List(verdicts), summary)),
        doc.Only(
            doc.PAGES,
            (
                doc.Section(
                    name="certificates",
                    title="The two certificates",
                    short="Facts",
                    blocks=(
                        doc.Beside(tuple((_box(letter, each),) for letter, each in zip(SIDES, both, strict=True))),
                        replace(summary, marked=_different(summary)),
                        doc.Only(("html",), (doc.Text("Marked rows differ. Rates are cut towards zero.", "caption"),)),
                        *_notes(both),
                    ),
                ),
            ),
        ),
        doc.Section(
            name="differences",
            title="What differs between the problems",
            short="Problems",
            blocks=(doc.Text(told), *((keys,) if changed else ()), *comparison_pictures(first, second)),
        ),
        _checks(first, second),
        *_regions(first, second),
        doc.Only(doc.PAGES, (_recheck(),)),
    )
    return doc.Document(
        kind="Two certificates of consensus, side by side",
        name=f"{a} and {b}, compared",
        title=f"{a} and {b}, compared",
        verdict=doc.Box(mark=doc.Mark("", "compared"), word=conclusion(first, second), reason=told),
        identity=tuple(row for letter, each in zip(SIDES, both, strict=True) for row in _identity(letter, each)),
        footer=f"A: {shortened(a, LONGEST_NAME)} · B: {shortened(b, LONGEST_NAME)}, compared",
        blocks=blocks,
    )


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


def _carrier(certificate: Certificate) -> str:
    covering = next((check for check in certificate.checks if check.id == certificate.covered_by), None)
    return ABSENT if covering is None else covering.kind.name


def _holds_for(certificate: Certificate) -> str:
    domain = covering_domain(certificate)
    return ABSENT if domain is None else domain_words(domain)


def _proved(certificate: Certificate) -> str:
    return f"{sum(check.verdict is Verdict.PROVED for check in certificate.checks)} of {len(certificate.checks)}"


FACTS: tuple[tuple[str, Callable[[Certificate], str]], ...] = (
    ("verdict", lambda each: each.verdict.value),
    ("holds for", _holds_for),
    ("certified rate in 1/s", lambda each: _rate(each.rate)),
    ("carried by", _carrier),
    ("agents", lambda each: str(each.problem.n)),
    ("modes", lambda each: str(len(each.problem.network.modes))),
    ("pinned agents", lambda each: str(len(each.problem.pinning.agents))),
    ("checks proved", _proved),
)


def _different(table: doc.Table) -> frozenset[int]:
    """Rows of a table of names and two values, where these differ."""
    return frozenset(place for place, (_, a, b) in enumerate(table.rows) if a != b)


def _box(letter: str, certificate: Certificate) -> doc.Box:
    return doc.Box(
        mark=mark_of(certificate.verdict),
        word=certificate.verdict.value.capitalize(),
        reason=certificate.reason,
        title=f"{letter}: {certificate.problem.name}",
        note=f"{size_sentence(certificate.problem)} {pin_sentence(certificate.problem)}",
    )


def _notes(both: Sequence[Certificate]) -> Iterator[doc.Block]:
    for letter, each in zip(SIDES, both, strict=True):
        if each.claims.notes:
            yield doc.Section(title=f"Notes of {letter}", blocks=(doc.List(each.claims.notes[:MOST_NOTES]),))


def _checks(first: Certificate, second: Certificate) -> doc.Section:
    """Every check that one of them has, in the order of A, then those that only B has; marked where they differ."""
    sides = [{(check.id, check.mode): check for check in each.checks} for each in (first, second)]
    pairs = [(sides[0].get(key), sides[1].get(key)) for key in dict.fromkeys([*sides[0], *sides[1]])]
    told = (
        "Margins and rates are in 1/s and cut towards zero. An en dash: the condition is not among the checks, or has"
    )
    hidden = len(pairs) - MOST_ROWS
    columns = (
        doc.Column(head="condition", width=2.2),
        *(doc.Column(head=side, width=0) for side in SIDES),
        *(doc.Column(head=f"{what} {side}", style="number") for what in ("margin", "rate") for side in SIDES),
    )
    rows = tuple(
        (_name(pair), *(part(each) for part in (_verdict, _margin, _check_rate) for each in pair))
        for pair in pairs[:MOST_ROWS]
    )
    marked = frozenset(place for place, (_, *cells) in enumerate(rows) if cells[::2] != cells[1::2])
    caption = "Checks of both certificates with verdict, margin and rate"
    return doc.Section(
        name="checks",
        title="What was checked",
        short="Checks",
        blocks=(
            doc.Table(caption=caption, columns=columns, rows=rows, marked=marked),
            *((doc.Only(doc.PAGES, (doc.Text(f"And {hidden} more, in the certificates."),)),) if hidden > 0 else ()),
            doc.Only(doc.PAGES, (doc.Text(f"{told} no such number.", "caption"),)),
        ),
    )


def _name(pair: Sequence[Check | None]) -> doc.Name:
    check = next(each for each in pair if each is not None)
    return doc.Name((check.kind.name,) if check.mode is None else (check.kind.name, f"mode {check.mode}"))


def _verdict(check: Check | None) -> doc.Cell:
    return ABSENT if check is None else mark_of(check.verdict)


def _margin(check: Check | None) -> str:
    return ABSENT if check is None else _rate(check.margin)


def _check_rate(check: Check | None) -> str:
    return ABSENT if check is None else _rate(check.rate)


def _rate(value: float | None) -> str:
    return typeset(significant_towards_zero(value))


def _regions(first: Certificate, second: Certificate) -> Iterator[doc.Section]:
    """The certified starts of every method that says something about starts."""
    starts = [
        {row.name: row.starts for row in region_rows(each.regions)} if each.regions.tried else {}
        for each in (first, second)
    ]
    names = dict.fromkeys([*starts[0], *starts[1]])
    if names:
        table = doc.table_of(
            "Certified starts, method by method",
            names,
            (doc.Column(head="method"), lambda name: name),
            (doc.Column(head="A", width=1.3), lambda name: starts[0].get(name, ABSENT)),
            (doc.Column(head="B", width=1.3), lambda name: starts[1].get(name, ABSENT)),
        )
        marked = replace(table, marked=_different(table))
        yield doc.Section(name="starts", title="From which starts", short="Starts", blocks=(marked,))


def _recheck() -> doc.Section:
    told = (
        "These pages show what the two certificates claim. For each of them, dobc verify certificate.json --problem"
        " problem.json decides every claim again in exact arithmetic."
    )
    return doc.Section(name="recheck", title="Check it yourself", short="Check it yourself", blocks=(doc.Text(told),))


def _identity(letter: str, certificate: Certificate) -> Iterator[tuple[str, str]]:
    yield letter, f"{certificate.problem.name}, decided by dobc_design {certificate.claims.version}"
    yield f"SHA-256 of problem {letter}", certificate.claims.problem_sha256


def _difference_sentence(count: int) -> str:
    if not count:
        return "The two problems are the same."
    text = f"The two problems differ in {count} {'place' if count == 1 else 'places'}."
    return text if count <= MOST_DIFFERENCES else f"{text} The first {MOST_DIFFERENCES} are listed."


def comparison_pictures(first: Certificate, second: Certificate) -> Iterator[doc.Block]:
    """The networks of A and of B beside each other; none where they are the same or too large."""
    if first.problem.network == second.problem.network and first.problem.pinning == second.problem.pinning:
        return
    sides = [
        tuple(_renamed(picture, letter) for picture in network_pictures(each)[0][:MOST_PICTURES])
        for letter, each in zip(SIDES, (first, second), strict=True)
    ]
    if all(sides):
        yield doc.Only(doc.PAGES, (doc.Beside(tuple((doc.Pictures(side, small=True),) for side in sides)),))


def _renamed(picture: doc.Picture, letter: str) -> doc.Picture:
    """The same drawing with identifiers of its own, since both stand on one page."""
    return replace(picture, name=f"{letter}-{picture.name}", title=f"{letter}: {picture.title}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One key whose value is not the same: as it stands in the first and in the second problem."""

    key: str
    first: str
    second: str


def differences(first: Problem, second: Problem) -> tuple[list[Difference], int]:
    """The differences in the order of the file, cut after 60 of them, and how many there are in all."""
    one, other = canonical_document(first), canonical_document(second)
    rows = [*_network(one, other), *_keys(dict(_flat(one)), dict(_flat(other)))]
    return rows[:MOST_DIFFERENCES], len(rows)


def _keys(a: Mapping[str, str], b: Mapping[str, str]) -> Iterator[Difference]:
    for key in dict.fromkeys([*a, *b]):
        if a.get(key) != b.get(key):
            yield Difference(key=key, first=a.get(key, ABSENT), second=b.get(key, ABSENT))


def _network(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[Difference]:
    """Agents, modes, and arcs: a few one by one, many as two lists."""
    both = (one, other)
    yield from _keys(*({"network.agents": ", ".join(each["labels"])} for each in both))
    modes = [{mode["name"]: _arcs(mode["arcs"], each["labels"]) for mode in each["modes"]} for each in both]
    for name in dict.fromkeys([*modes[0], *modes[1]]):
        key = f"network.modes.{name}"
        a, b = modes[0].get(name), modes[1].get(name)
        if a is None or b is None:
            told = [ABSENT if arcs is None else f"{len(arcs)} arcs" for arcs in (a, b)]
            yield Difference(key=key, first=told[0], second=told[1])
            continue
        found = [Difference(key=f"{key}: {each.key}", first=each.first, second=each.second) for each in _keys(a, b)]
        if len(found) <= MOST_ARCS:
            yield from found
        else:
            own = [[arc for arc in left if right.get(arc) != left[arc]] for left, right in ((a, b), (b, a))]
            yield Difference(key=f"{key}: arcs that differ", first=_listed(own[0]), second=_listed(own[1]))


def _arcs(arcs: Sequence[Any], labels: Sequence[str]) -> dict[str, str]:
    """Arcs by the names of their ends."""
    return {
        f"{labels[i]} listens to {labels[j]}": "there" if weight == "1" else f"weight {weight}" for i, j, weight in arcs
    }


def _listed(names: Sequence[str]) -> str:
    return f"{len(names)}: {', '.join(names)}" if names else "none"


def _flat(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Every other key with its value as text; arcs by the names of their ends."""
    labels: list[str] = document["labels"]
    yield "target", _text(document["target"])
    yield "coupling.h", _text(document["coupling"]["h"])
    for each in document["coupling"]["exceptions"]:
        i, j = each["arc"]
        yield f"coupling.exceptions: {labels[i]} listens to {labels[j]}", _text(each["h"])
    for i, gain in document["gains"]:
        yield f"pinning.gains.{labels[i]}", _text(gain)
    for i, offset in document["offsets"]:
        yield f"formation.offsets.{labels[i]}", _text(offset)
    for table in TABLES:
        for key, value in (document[table] or {}).items():
            if value is not None:
                yield f"{table}.{key}", _text(value)


def _text(value: Any) -> str:
    """A value of problem.json as people write it: a list of one entry is that entry."""
    if isinstance(value, list):
        while isinstance(value, list) and len(value) == 1:
            value = value[0]
        if isinstance(value, list):
            return "[" + ", ".join(_text(each) for each in value) + "]"
    if isinstance(value, dict):
        return "; ".join(f"{key} {_text(each)}" for key, each in value.items() if each is not None)
    return str(value)
