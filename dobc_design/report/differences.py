"""What differs between two problems, key by key of the problem file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dobc_design.problem.canonical import canonical_document
from dobc_design.problem.problem import Problem

MOST = 60  # differences that are listed
MOST_ARCS = 8  # arcs of one mode that are named one by one
LONGEST = 160  # characters of a value
ABSENT = "–"
TABLES = ("exosystem", "observer", "region", "switching", "simulation")


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
    cut = [Difference(key=each.key, first=_cut(each.first), second=_cut(each.second)) for each in rows[:MOST]]
    return cut, len(rows)


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


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
