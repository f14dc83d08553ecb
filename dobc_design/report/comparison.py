"""Two certificates side by side: their verdicts, checks and certified starts, and what differs
between the problems.

Problems are compared as one program writes them: what counts is the meaning of a file and not how
it is written.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from dobc_design._show.text import lower
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import time_to_one_percent
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import parse_toml
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report import words
from dobc_design.report.pictures import network_pictures
from dobc_design.report.region_words import starts_words
from dobc_design.verdict import Verdict

SIDES, ABSENT = ("A", "B"), "–"
MOST_ROWS, MOST_PICTURES, MOST_NOTES, MOST_DIFFERENCES = 150, 4, 20, 60
MOST_ARCS = 8  # arcs of one mode that are named one by one
LONGEST_NAME, LONGEST = 30, 160  # characters of a name in the footer, and of a value

Difference = tuple[str, str, str]  # a key, and its value in the first and in the second problem


def comparison_document(first: Certificate, second: Certificate) -> doc.Document:
    """Both certificates as one document."""
    sides = list(zip(SIDES, (first, second), strict=True))
    a, b = first.problem.name, second.problem.name
    changed, count = differences(first.problem, second.problem)
    told = "The two problems are the same."
    if count:
        told = f"The two problems differ in {count} {'place' if count == 1 else 'places'}."
        told += f" The first {MOST_DIFFERENCES} are listed." if count > MOST_DIFFERENCES else ""
    one, other = _facts(first), _facts(second)
    summary = _marked(
        "Facts about both certificates",
        ("", *SIDES),
        [(name, one[name], other[name]) for name in one],
    )
    certificates = (
        doc.Beside([(_box(letter, each),) for letter, each in sides]),
        summary,
        doc.Only(
            ("html",), (doc.Text("Marked rows differ. Rates are rounded towards zero.", "caption"),)
        ),
        *(
            doc.Section(f"Notes of {letter}", (doc.List(each.claims.notes[:MOST_NOTES]),))
            for letter, each in sides
            if each.claims.notes
        ),
    )
    columns = (doc.Column("key", width=1.2), *(doc.Column(side, style="why") for side in SIDES))
    values = [(key, *(words.shortened(each, LONGEST) for each in pair)) for key, *pair in changed]
    keys = doc.Table(
        caption="Keys of the problem file whose values differ", columns=columns, rows=values
    )
    problems = (doc.Text(told), *((keys,) if changed else ()), *_networks(sides))
    again = doc.Text(words.TEXTS["fixed"]["compared"])
    identity = []
    for letter, each in sides:
        identity.append(
            (letter, f"{each.problem.name}, decided by dobc_design {each.claims.version}")
        )
        identity.append((f"SHA-256 of problem {letter}", each.claims.problem_sha256))
    return doc.Document(
        kind="Two certificates of consensus, side by side",
        name=f"{a} and {b}, compared",
        title=f"{a} and {b}, compared",
        verdict=doc.Box(mark=doc.Mark("", "compared"), word=conclusion(first, second), reason=told),
        identity=identity,
        footer=f"A: {words.shortened(a, LONGEST_NAME)} · B: {words.shortened(b, LONGEST_NAME)}, "
        "compared",
        blocks=(
            doc.Section("The two certificates", certificates, "certificates", "Facts"),
            doc.Section("What differs between the problems", problems, "differences", "Problems"),
            _checks(first, second),
            *_starts(first, second),
            doc.Section("Check it yourself", (again,), "recheck"),
        ),
    )


def conclusion(first: Certificate, second: Certificate) -> str:
    """The comparison in a sentence or two."""
    if first.verdict is not second.verdict:
        return f"A is {first.verdict.value}, B is {second.verdict.value}."
    if first.verdict is not Verdict.PROVED:
        return f"Both are {first.verdict.value}."
    times = [time_to_one_percent(each.rate, each.factor) for each in (first, second)]
    if all(map(math.isfinite, times)) and times[0] != times[1]:
        better, worse = ("A", "B") if times[0] < times[1] else ("B", "A")
        early, late = words.seconds(min(times)), words.seconds(max(times))
        return (
            f"Both are proved. {better} is certified to reach one percent after {early}, "
            f"{worse} after {late}."
        )
    a, b = first.rate or 0.0, second.rate or 0.0
    if a == b:
        return "Both are proved, at the same certified rate."
    better, worse = ("A", "B") if a > b else ("B", "A")
    high, low = lower(max(a, b)), lower(min(a, b))
    return (
        f"Both are proved. {better} has the larger certified rate, {high} against {low} 1/s of "
        f"{worse}."
    )


def _facts(certificate: Certificate) -> dict[str, str]:
    proved = sum(check.verdict is Verdict.PROVED for check in certificate.checks)
    facts = {"Verdict": certificate.verdict.value, **words.facts(certificate)}
    facts["Pinned agents"] = str(len(certificate.problem.pinning.agents))
    return facts | {"Checks proved": f"{proved} of {len(certificate.checks)}"}


def _marked(
    caption: str, columns: Iterable[str | doc.Column], rows: Sequence[Sequence[doc.Cell]]
) -> doc.Table:
    """A table of names and of pairs of values, those of A and of B; rows are marked where a pair
    differs."""
    marked = frozenset(place for place, (_, *cells) in enumerate(rows) if cells[::2] != cells[1::2])
    heads = [doc.Column(each) if isinstance(each, str) else each for each in columns]
    return doc.Table(caption=caption, columns=heads, rows=rows, marked=marked)


def _box(letter: str, certificate: Certificate) -> doc.Box:
    return doc.Box(
        mark=words.mark_of(certificate.verdict),
        word=certificate.verdict.value.capitalize(),
        reason=words.sentence(certificate.reason),
        title=f"{letter}: {certificate.problem.name}",
        note=f"{words.size_sentence(certificate.problem)} "
        f"{words.pin_sentence(certificate.problem)}",
    )


def _checks(first: Certificate, second: Certificate) -> doc.Section:
    """Every check that one of them has, in the order of A, then those that only B has; marked where
    they differ."""
    a, b = ({(check.id, check.mode): check for check in each.checks} for each in (first, second))
    pairs = [(a.get(key), b.get(key)) for key in {**a, **b}]
    hidden = len(pairs) - MOST_ROWS
    columns = (
        doc.Column("condition", width=2.2),
        *(doc.Column(side, width=0) for side in SIDES),
        *(
            doc.Column(f"{what} {side}", style="number")
            for what in ("margin", "rate", "factor")
            for side in SIDES
        ),
    )
    rows = [_compared(pair) for pair in pairs[:MOST_ROWS]]
    blocks = (
        _marked("Checks of both certificates with verdict, margin, rate and factor", columns, rows),
        *((doc.Text(f"And {hidden} more, in the certificates."),) if hidden > 0 else ()),
        doc.Text(words.TEXTS["fixed"]["compared_checks"], "caption"),
    )
    return doc.Section("What was checked", blocks, "checks", "Checks")


def _compared(pair: Sequence[Check | None]) -> tuple[doc.Cell, ...]:
    check = next(each for each in pair if each is not None)
    mode = () if check.mode is None else (f"mode {check.mode}",)
    verdicts = [ABSENT if each is None else words.mark_of(each.verdict) for each in pair]
    margins = [None if each is None else each.margin for each in pair]
    rates = [None if each is None else each.rate for each in pair]
    factors = [None if each is None else each.factor for each in pair]
    numbers = (*map(lower, (*margins, *rates)), *map(words.factor_words, factors))
    return (doc.Name((check.kind.name, *mode)), *verdicts, *numbers)


def _starts(first: Certificate, second: Certificate) -> Iterator[doc.Section]:
    """The certified starts of every method that says something about starts."""
    a, b = (
        {claim.method: starts_words(claim) for claim in each.regions.claims}
        if each.regions.tried
        else {}
        for each in (first, second)
    )
    rows = [(name, a.get(name, ABSENT), b.get(name, ABSENT)) for name in {**a, **b}]
    if rows:
        columns = [doc.Column("method"), *(doc.Column(side, width=1.3) for side in SIDES)]
        table = _marked("Certified starts, method by method", columns, rows)
        yield doc.Section("From which starts", (table,), "starts", "Starts")


def _networks(sides: Sequence[tuple[str, Certificate]]) -> Iterator[doc.Block]:
    """The networks of A and of B beside each other; none where they are the same or too large."""
    first, second = (each.problem for _, each in sides)
    if (first.network, first.pinning) == (second.network, second.pinning):
        return
    drawn = [(letter, network_pictures(each)[0][:MOST_PICTURES]) for letter, each in sides]
    if all(each for _, each in drawn):
        # the same drawings with identifiers of their own, since both stand on one page
        named = [
            [
                replace(each, name=f"{letter}-{each.name}", title=f"{letter}: {each.title}")
                for each in own
            ]
            for letter, own in drawn
        ]
        yield doc.on_pages(doc.Beside([(doc.Pictures(each, small=True),) for each in named]))


def differences(first: Problem, second: Problem) -> tuple[list[Difference], int]:
    """The differences in the order of the file, cut after 60 of them, and how many there are in
    all."""
    one, other = (parse_toml(problem_text(each).encode("utf-8")) for each in (first, second))
    rows = [
        *_network(one.pop("network"), other.pop("network")),
        *_keys(dict(_flat(one)), dict(_flat(other))),
    ]
    return rows[:MOST_DIFFERENCES], len(rows)


def _keys(a: Mapping[str, str], b: Mapping[str, str]) -> Iterator[Difference]:
    for key in {**a, **b}:
        if a.get(key) != b.get(key):
            yield key, a.get(key, ABSENT), b.get(key, ABSENT)


def _network(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[Difference]:
    """Agents, modes, and arcs: a few one by one, many as two lists."""
    yield from _keys(
        {"network.agents": _text(one["agents"])}, {"network.agents": _text(other["agents"])}
    )
    for name in {**one["modes"], **other["modes"]}:
        key, both = f"network.modes.{name}", [each["modes"].get(name) for each in (one, other)]
        if None in both:
            a, b = (ABSENT if arcs is None else f"{len(arcs)} arcs" for arcs in both)
            yield key, a, b
            continue
        first, second = map(_arcs, both)
        found = [(f"{key}: {arc}", x, y) for arc, x, y in _keys(first, second)]
        if len(found) > MOST_ARCS:
            own = [
                [arc for arc in x if y.get(arc) != x[arc]]
                for x, y in ((first, second), (second, first))
            ]
            found = [(f"{key}: arcs that differ", _listed(own[0]), _listed(own[1]))]
        yield from found


def _arcs(arcs: Sequence[Any]) -> dict[str, str]:
    """Arcs by the names of their ends."""
    return {
        f"{a} listens to {b}": f"weight {weight[0]}" if weight else "there"
        for a, b, *weight in arcs
    }


def _listed(names: Sequence[str]) -> str:
    return f"{len(names)}: {', '.join(names)}" if names else "none"


def _flat(tables: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, str]]:
    """Every other key of a problem file with its value as text."""
    for name, value in tables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}{name}.")
        elif name == "exceptions":
            yield from (
                (f"{path}{name}: {arc}", _text(each["h"]))
                for each in value
                for arc in _arcs(each["arcs"])
            )
        elif path or name not in ("schema", "name", "notes"):
            yield f"{path}{name}", _text(value)


def _text(value: Any) -> str:
    """A value of a file as people write it: a list of one entry is that entry."""
    if isinstance(value, list):
        return _text(value[0]) if len(value) == 1 else "[" + ", ".join(map(_text, value)) + "]"
    if isinstance(value, dict):
        return "; ".join(f"{key} {_text(each)}" for key, each in value.items() if each is not None)
    return str(value)
