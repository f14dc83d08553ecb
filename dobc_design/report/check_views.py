"""Checks as rows for people: names, numbers that stay true when shortened, witnesses and cures in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dobc_design._show.text import significant_towards_zero
from dobc_design.conditions.check import Check, Fix, Witness, main_cure, other_cures
from dobc_design.problem.changes import change_lines
from dobc_design.report.network_words import names_in_words
from dobc_design.report.words import SYMBOLS, capitalize_first, check_name, domain_words
from dobc_design.verdict import Verdict

MOST_ROWS = 150
MOST_ENTRIES = 24  # of a vector
LONGEST_NUMBER = 24
LONGEST_TEXT = 1200
POINTER = "named above."  # where the cure of a check is part of the main one
_ORDER = {Verdict.REFUTED: 0, Verdict.UNDECIDED: 1, Verdict.PROVED: 2}


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckRow:
    """One check, ready to be shown; everything is plain text."""

    id: str
    name: str
    mode: str | None
    group: str | None
    verdict: str
    symbol: str
    domain: str
    margin: str
    rate: str
    reason: str
    exact: tuple[tuple[str, str], ...]
    witness: tuple[str, str] | None  # what it is, its value
    fix: str | None
    fix_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cure:
    """The cure that everything else waits for: in words, and as lines of the problem file."""

    head: str
    text: str
    lines: tuple[str, ...]


def cure_view(checks: Sequence[Check]) -> Cure | None:
    """The main cure, or None."""
    check = main_cure(checks)
    if check is None or check.fix is None:
        return None
    head = "What would cure it" if check.kind.role == "paper" else f"What would cure {check.id}"
    if check.verdict is not Verdict.REFUTED:
        head = f"What would help {check.id}"
    return Cure(head=head, text=_cut(check.fix.text), lines=_fix_lines(check.fix))


def check_rows(checks: Sequence[Check], *, most: int = MOST_ROWS) -> tuple[list[CheckRow], str | None]:
    """Rows of the checks; of very many, those not proved first, and a sentence about the others."""
    elsewhere = {id(each) for each in other_cures(checks)}
    rows = [check_row(check, pointed=id(check) not in elsewhere) for check in checks]
    if len(checks) <= most:
        return rows, None
    chosen = sorted(range(len(checks)), key=lambda i: (_ORDER[checks[i].verdict], i))[:most]
    hidden = [check for i, check in enumerate(checks) if i not in set(chosen)]
    counts = [
        f"{sum(check.verdict is verdict for check in hidden)} {verdict.value}"
        for verdict in _ORDER
        if any(check.verdict is verdict for check in hidden)
    ]
    note = f"{len(checks)} checks were made; {len(hidden)} of them ({', '.join(counts)}) are in certificate.json only."
    return [rows[i] for i in sorted(chosen)], note


def check_row(check: Check, *, pointed: bool = False) -> CheckRow:
    """One check as a row; ``pointed``: its cure stands above the table or in another row."""
    return CheckRow(
        id=check.id,
        name=check_name(check),
        mode=check.mode,
        group=check.group,
        verdict=check.verdict.value,
        symbol=SYMBOLS[check.verdict],
        domain=domain_words(check.domain),
        margin=significant_towards_zero(check.margin),
        rate=significant_towards_zero(check.rate),
        reason=_sentence(check.reason),
        exact=tuple(_exact(check.exact or {})),
        witness=None if check.witness is None else _witness(check.witness, check.id),
        fix=None if check.fix is None else POINTER if pointed else _cut(check.fix.text),
        fix_lines=() if check.fix is None or pointed else _fix_lines(check.fix),
    )


def _exact(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    names = {"bound": "λmax(Λ) must be below", "value": "v′Λv", "routh": "first column of Routh’s table"}
    rows = []
    for key, value in values.items():
        if key in names:  # the other values stand in the reason, or among the matrices
            text = _entries(value) if isinstance(value, (list, tuple)) else _number(str(value))
            rows.append((names[key], text))
    return rows


def _witness(witness: Witness, id: str) -> tuple[str, str]:
    who = "" if not witness.labels else f" (agents {names_in_words(witness.labels)})"
    values = "" if not witness.values else _entries(witness.values)
    match witness.kind:
        case "vector" if id == "observability":
            return "A state that C never sees, ξ", values
        case "vector":
            return f"A direction v that is not held{who}, v", values
        case "agents":
            return "Agents that no pin reaches", names_in_words(witness.labels or (), 30)
        case "polynomial":
            return "The factor that does not decay", _cut(", ".join(witness.values or ()))
        case "routh_row":
            return "First column of Routh’s table", values
        case kind:
            return f"Witness ({_cut(kind, 40)}){who}", values


def _fix_lines(fix: Fix) -> tuple[str, ...]:
    return tuple(_cut(" ".join(line.split())) for line in change_lines(fix.set)[:20])


def _entries(values: Sequence[Any]) -> str:
    shown = [_number(str(value)) for value in values[:MOST_ENTRIES]]
    if len(values) == 1:
        return shown[0]
    return f"({', '.join(shown)})" if len(values) <= MOST_ENTRIES else f"({', '.join(shown)}, …), {len(values)} entries"


def _number(text: str) -> str:
    """A long rational is shortened and marked as such; other texts are only cut."""
    if len(text) <= LONGEST_NUMBER:
        return text
    numerator, _, denominator = text.partition("/")
    try:
        return f"≈ {int(numerator) / int(denominator or 1):.6g}"
    except (ValueError, OverflowError, ZeroDivisionError):
        return _cut(text, 80)


def _sentence(text: str) -> str:
    return capitalize_first(_cut(text))


def _cut(text: str, longest: int = LONGEST_TEXT) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
