"""Two certificates side by side: their verdicts, checks and certified starts, and what differs
between the problems.

Problems are compared as one program writes them: what counts is the meaning of a file and not how
it is written.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from dobc_design._show.text import lower, upper
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import time_to_one_percent
from dobc_design.exact.reading import counted
from dobc_design.problem.changes import problem_text
from dobc_design.problem.load import parse_toml
from dobc_design.problem.problem import Problem
from dobc_design.report import words
from dobc_design.verdict import Verdict

from .document import (
    Beside,
    Block,
    Blocks,
    Box,
    Cell,
    Column,
    Document,
    Fact,
    List,
    Mark,
    Name,
    Only,
    Pictures,
    Section,
    Table,
    Text,
    on_pages,
)
from .pictures import network_pictures
from .region_words import starts_words
from .words import (
    FIXED,
    mark_of,
    pin_sentence,
    seconds,
    sentence,
    shortened,
    size_sentence,
)

SIDES = ("A", "B")
ABSENT = "–"
MOST_ROWS = 150
MOST_PICTURES = 4
MOST_NOTES = 20
MOST_DIFFERENCES = 60
MOST_ARCS = 8  # arcs of one mode that are named one by one
LONGEST_NAME = 30  # characters of a name in the footer
LONGEST = 160  # and of a value

Difference = tuple[str, str, str]  # a key, and its value in the first and in the second problem
Sides = Mapping[str, Certificate]  # by their letters


def comparison_document(first: Certificate, second: Certificate) -> Document:
    """Both certificates as one document."""
    sides = dict(zip(SIDES, (first, second), strict=True))
    changed, count = differences(first.problem, second.problem)
    told = "The two problems are the same."
    if count:
        told = f"The two problems differ in {counted(count, 'place')}."
    if count > MOST_DIFFERENCES:
        told += f" The first {MOST_DIFFERENCES} are listed."
    identity: list[Fact] = []
    for letter, each in sides.items():
        decided = f"{each.problem.name}, decided by dobc_design {each.claims.version}"
        identity.append((letter, decided))
        identity.append((f"SHA-256 of problem {letter}", each.claims.problem_sha256))
    a, b = first.problem.name, second.problem.name
    compared = f"{a} and {b}, compared"
    if a == b:
        compared = f"{a} (A) and {b} (B), compared"
    again = Text(FIXED["compared"])
    return Document(
        kind="Two certificates of consensus, side by side",
        name=compared,
        title=compared,
        verdict=Box(mark=Mark("", "compared"), word=conclusion(first, second), reason=told),
        identity=identity,
        footer=f"A: {shortened(a, LONGEST_NAME)} · B: {shortened(b, LONGEST_NAME)}, compared",
        blocks=(
            _certificates(sides),
            _problems(sides, changed, told),
            _checks(sides),
            *_starts(sides),
            Section("Check it yourself", (again,), "recheck"),
        ),
    )


def conclusion(first: Certificate, second: Certificate) -> str:
    """The comparison in a sentence or two."""
    if first.verdict is not second.verdict:
        return f"A is {first.verdict.value}, B is {second.verdict.value}."
    if first.verdict is not Verdict.PROVED:
        return f"Both are {first.verdict.value}."
    a, b = (time_to_one_percent(each.rate, each.factor) for each in (first, second))
    # A larger rate with a much larger factor may be the slower one: times are compared first.
    if math.isfinite(a) and math.isfinite(b) and a != b:
        better, worse = SIDES if a < b else SIDES[::-1]
        early, late = seconds(min(a, b)), seconds(max(a, b))
        return (
            f"Both are proved. {better} is certified to reach one percent after {early}, "
            f"{worse} after {late}."
        )
    a, b = first.rate or 0.0, second.rate or 0.0
    if a == b:
        return "Both are proved, at the same certified rate."
    better, worse = SIDES if a > b else SIDES[::-1]
    high, low = lower(max(a, b)), lower(min(a, b))
    return (
        f"Both are proved. {better} has the larger certified rate, {high} against {low} 1/s of "
        f"{worse}."
    )


def _certificates(sides: Sides) -> Section:
    """Both verdicts, and below them facts and notes."""
    boxes = [(_box(letter, each),) for letter, each in sides.items()]
    one, other = map(_facts, sides.values())
    rows = [(name, one[name], other[name]) for name in one]
    heads = [Column(head) for head in ("", *SIDES)]
    how = "Marked rows differ. Rates are rounded towards zero."
    blocks: list[Block] = [
        Beside(boxes),
        _marked("Facts about both certificates", heads, rows),
        Only(("html",), (Text(how, "caption"),)),
    ]
    for letter, each in sides.items():
        notes = each.claims.notes[:MOST_NOTES]
        if notes:
            blocks.append(Section(f"Notes of {letter}", (List(notes),)))
    return Section("The two certificates", blocks, "certificates", "Facts")


def _box(letter: str, certificate: Certificate) -> Box:
    problem = certificate.problem
    return Box(
        mark=mark_of(certificate.verdict),
        word=certificate.verdict.value.capitalize(),
        reason=sentence(certificate.reason),
        title=f"{letter}: {problem.name}",
        note=f"{size_sentence(problem)} {pin_sentence(problem)}",
    )


def _facts(certificate: Certificate) -> dict[str, str]:
    """A certificate in a few words by name, with its pins and checks counted."""
    facts = {"Verdict": certificate.verdict.value, **words.facts(certificate)}
    facts["Pinned agents"] = str(len(certificate.problem.pinning.agents))
    proved = sum(check.is_proved for check in certificate.checks)
    facts["Checks proved"] = f"{proved} of {len(certificate.checks)}"
    return facts


def _marked(caption: str, columns: Sequence[Column], rows: Sequence[Sequence[Cell]]) -> Table:
    """A table of names and of pairs of values, those of A and of B; rows are marked where a pair
    differs."""
    # cells come in pairs: A, B, A, B, ...
    marked = frozenset(place for place, (_, *cells) in enumerate(rows) if cells[::2] != cells[1::2])
    return Table(caption=caption, columns=columns, rows=rows, marked=marked)


def _problems(sides: Sides, changed: Sequence[Difference], told: str) -> Section:
    """What differs between the problems, and their networks."""
    blocks: list[Block] = [Text(told)]
    if changed:
        columns = [Column("key", width=1.2)]
        columns += [Column(side, style="why") for side in SIDES]
        caption = "Keys of the problem file whose values differ"
        rows = [(key, shortened(a, LONGEST), shortened(b, LONGEST)) for key, a, b in changed]
        blocks.append(Table(caption=caption, columns=columns, rows=rows))
    blocks += _networks(sides)
    return Section("What differs between the problems", blocks, "differences", "Problems")


def _networks(sides: Sides) -> Blocks:
    """The networks of A and of B beside each other; none where they are the same or too large."""
    a, b = (each.problem for each in sides.values())
    # Two drawings that are the same would look as if they differed.
    if (a.network, a.pinning.agents) == (b.network, b.pinning.agents):
        return
    drawn = []
    for letter, each in sides.items():
        pictures, _ = network_pictures(each)
        if not pictures:
            return
        # Both stand on one page, where identifiers must not be the same.
        named = [
            replace(own, name=f"{letter}-{own.name}", title=f"{letter}: {own.title}")
            for own in pictures[:MOST_PICTURES]
        ]
        drawn.append((Pictures(named, small=True),))
    yield on_pages(Beside(drawn))


def _checks(sides: Sides) -> Section:
    """Every check that one of them has, in the order of A, then those that only B has; marked where
    they differ."""
    a, b = ({(check.id, check.mode): check for check in each.checks} for each in sides.values())
    keys = list(a | b)
    columns = [Column("condition", width=2.2)]
    columns += [Column(side, width=0) for side in SIDES]
    for what in ("margin", "rate", "factor"):
        columns += [Column(f"{what} {side}", style="number") for side in SIDES]
    rows = [_compared(a.get(key), b.get(key)) for key in keys[:MOST_ROWS]]
    caption = "Checks of both certificates with verdict, margin, rate and factor"
    blocks: list[Block] = [_marked(caption, columns, rows)]
    hidden = len(keys) - MOST_ROWS
    if hidden > 0:
        blocks.append(Text(f"And {hidden} more, in the certificates."))
    blocks.append(Text(FIXED["compared_checks"], "caption"))
    return Section("What was checked", blocks, "checks", "Checks")


def _compared(a: Check | None, b: Check | None) -> tuple[Cell, ...]:
    """One row: the condition, then each value of A beside that of B."""
    # What only one of them has still has a name.
    either = next(each for each in (a, b) if each is not None)
    parts = [either.kind.name]
    if either.mode is not None:
        parts.append(f"mode {either.mode}")
    beside = zip(_values(a), _values(b), strict=True)
    return (Name(tuple(parts)), *chain.from_iterable(beside))


def _values(check: Check | None) -> tuple[Cell, ...]:
    """Verdict, margin, rate and factor of a check; nothing is known of one that was not made."""
    if check is None:
        return (ABSENT, lower(None), lower(None), upper(None))
    numbers = (lower(check.margin), lower(check.rate), upper(check.factor))
    return (mark_of(check.verdict), *numbers)


def _starts(sides: Sides) -> Iterator[Section]:
    """The certified starts of every method that says something about starts."""
    a, b = map(_starts_of, sides.values())
    rows = [(name, a.get(name, ABSENT), b.get(name, ABSENT)) for name in a | b]
    if rows:
        columns = [Column("method"), *(Column(side, width=1.3) for side in SIDES)]
        table = _marked("Certified starts, method by method", columns, rows)
        yield Section("From which starts", (table,), "starts", "Starts")


def _starts_of(certificate: Certificate) -> dict[str, str]:
    regions = certificate.regions
    claims = regions.claims if regions.tried else ()
    return {claim.method: starts_words(claim, regions.unit) for claim in claims}


def differences(first: Problem, second: Problem) -> tuple[list[Difference], int]:
    """The differences in the order of the file, cut after 60 of them, and how many there are in
    all."""
    # As one program writes them: how a file was typed makes no difference.
    one, other = (parse_toml(problem_text(each).encode("utf-8")) for each in (first, second))
    # Arcs are compared as sets: their order in a file means nothing.
    rows = list(_network(one.pop("network"), other.pop("network")))
    rows += _keys(dict(_flat(one)), dict(_flat(other)))
    return rows[:MOST_DIFFERENCES], len(rows)


def _keys(a: Mapping[str, str], b: Mapping[str, str]) -> Iterator[Difference]:
    for key in {**a, **b}:
        if a.get(key) != b.get(key):
            yield key, a.get(key, ABSENT), b.get(key, ABSENT)


def _network(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[Difference]:
    """Agents, modes, and arcs: a few one by one, many as two lists."""
    key = "network.agents"
    yield from _keys({key: _text(one["agents"])}, {key: _text(other["agents"])})
    for name in {**one["modes"], **other["modes"]}:
        key = f"network.modes.{name}"
        first, second = one["modes"].get(name), other["modes"].get(name)
        if first is None or second is None:
            yield key, _count(first), _count(second)
        else:
            yield from _mode(key, _arcs(first), _arcs(second))


def _count(mode: Any) -> str:
    return ABSENT if mode is None else f"{len(_arcs(mode))} arcs"


def _mode(key: str, first: Mapping[str, str], second: Mapping[str, str]) -> Iterator[Difference]:
    """The arcs of a mode that only one of them has, or with another weight."""
    found = list(_keys(first, second))
    if len(found) <= MOST_ARCS:
        for arc, a, b in found:
            yield f"{key}: {arc}", a, b
        return
    only_first = [arc for arc in first if second.get(arc) != first[arc]]
    only_second = [arc for arc in second if first.get(arc) != second[arc]]
    yield f"{key}: arcs that differ", _listed(only_first), _listed(only_second)


def _arcs(mode: Any) -> dict[str, str]:
    """The arcs of a mode by the names of their ends; a mode with optional ones is a table."""
    sure, optional = mode, []
    if isinstance(mode, Mapping):
        sure, optional = mode["arcs"], mode["optional"]
    named: dict[str, str] = {}
    for arcs, there in ((sure, "there"), (optional, "optional")):
        for listener, speaker, *weight in arcs:
            what = [f"weight {weight[0]}"] if weight else []
            if not what or there == "optional":
                what.insert(0, there)
            named[f"{listener} listens to {speaker}"] = ", ".join(what)
    return named


def _listed(names: Sequence[str]) -> str:
    return f"{len(names)}: {', '.join(names)}" if names else "none"


def _flat(tables: Mapping[str, Any], path: str = "") -> Iterator[Fact]:
    """Every other key of a problem file with its value as text."""
    for name, value in tables.items():
        key = f"{path}{name}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{key}.")
        # Arc by arc, so that one arc that differs is one row.
        elif name == "exceptions":
            for each in value:
                for arc in _arcs(each["arcs"]):
                    yield f"{key}: {arc}", _text(each["h"])
        # Names and notes are no part of what a problem means.
        elif path or name not in ("schema", "name", "notes"):
            yield key, _text(value)


def _text(value: Any) -> str:
    """A value of a file as people write it: a list of one entry is that entry."""
    if isinstance(value, list) and len(value) == 1:
        return _text(value[0])
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return "; ".join(f"{key} {_text(each)}" for key, each in value.items() if each is not None)
    return str(value)
