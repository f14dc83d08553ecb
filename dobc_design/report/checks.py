"""Checks in the report: names, numbers that stay true when shortened, witnesses and cures in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from dobc_design._show.text import significant_towards_zero
from dobc_design.conditions.check import Check, Fix, Witness, main_cure, other_cures
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem.changes import change_lines
from dobc_design.report import document as doc
from dobc_design.report.network_words import names_in_words
from dobc_design.report.words import capitalize_first, check_name, domain_words, mark_of
from dobc_design.verdict import Verdict

CURE_COMMAND = "dobc certify problem.json --apply-fix cured.toml"
MOST_ROWS = 150
MOST_ENTRIES = 24  # of a vector
LONGEST_NUMBER = 24
LONGEST_TEXT = 1200
POINTER = "named above."  # where the cure of a check is part of the main one
_ORDER = {Verdict.REFUTED: 0, Verdict.UNDECIDED: 1, Verdict.PROVED: 2}
_EXACT = {"bound": "λmax(Λ) must be below", "value": "v′Λv", "routh": "first column of Routh’s table"}


def cure_section(checks: Sequence[Check]) -> Iterator[doc.Section]:
    """The cure that everything else waits for, in words and as lines of the problem file; nothing without one."""
    check = main_cure(checks)
    if check is None or check.fix is None:
        return
    head = "What would cure it" if check.kind.role == "paper" else f"What would cure {check.id}"
    if check.verdict is not Verdict.REFUTED:
        head = f"What would help {check.id}"
    lines = _fix_lines(check.fix)
    told = f"Proved with the very conditions that failed. To write the cured problem: `{CURE_COMMAND}`"
    decided = "The cured problem was decided by the very conditions that failed. This command writes it to a file:"
    yield doc.Section(
        name="cure",
        title=head,
        short="Cure",
        blocks=(
            doc.Text(_cut(check.fix.text)),
            *((doc.Text("In the problem file:"), doc.Code(lines)) if lines else ()),
            doc.Only(("markdown",), (doc.Text(doc.Own(told)),)),
            doc.Only(doc.PAGES, (doc.Text(decided), doc.Code((CURE_COMMAND,), command=True))),
        ),
    )


def checks_section(checks: Sequence[Check]) -> doc.Section:
    """Every check with its verdict, numbers and reason, and what the conditions decide."""
    table, hidden = checks_table(checks)
    present = [KINDS[id] for id in dict.fromkeys(check.id for check in checks)]
    rests = "“Proved” and “refuted” rest on exact arithmetic alone.\n"
    cut = "Margins and rates are in 1/s and cut towards zero: they hold as printed."
    terms = doc.Terms(tuple((kind.name, kind.id, f"{kind.decides}.") for kind in present))
    return doc.Section(
        name="checks",
        title="What was checked",
        short="Checks",
        blocks=(
            doc.Only(doc.READ, (doc.Text(doc.Own(rests + cut)),)),
            table,
            *((doc.Text(hidden),) if hidden else ()),
            doc.Only(("html", "markdown"), (doc.Section(title="What the conditions decide", blocks=(terms,)),)),
        ),
    )


def checks_table(checks: Sequence[Check], *, most: int = MOST_ROWS) -> tuple[doc.Table, str | None]:
    """The checks as rows; of very many, those not proved first, and a sentence about the others."""
    own_cures = {id(each) for each in other_cures(checks)}
    chosen = sorted(sorted(range(len(checks)), key=lambda i: (_ORDER[checks[i].verdict], i))[:most])
    hidden = [check for i, check in enumerate(checks) if i not in set(chosen)]
    counts = [(verdict, sum(check.verdict is verdict for check in hidden)) for verdict in _ORDER]
    told = ", ".join(f"{count} {verdict.value}" for verdict, count in counts if count)
    note = f"{len(checks)} checks were made; {len(hidden)} of them ({told}) are in certificate.json only."
    table = doc.table_of(
        "Checks with verdict, domain, margin, rate and reason",
        [checks[i] for i in chosen],
        (doc.Column(head="verdict", width=0), lambda check: mark_of(check.verdict)),
        (doc.Column(head="condition", width=1.5), _name),
        (doc.Column(head="id", only=("markdown",)), lambda check: check.id),
        (doc.Column(head="where", width=1.1), lambda check: domain_words(check.domain)),
        (
            doc.Column(head="margin", unit="1/s", width=0.8, style="number"),
            lambda check: significant_towards_zero(check.margin),
        ),
        (
            doc.Column(head="rate", unit="1/s", width=0.8, style="number"),
            lambda check: significant_towards_zero(check.rate),
        ),
        (
            doc.Column(head="reason", width=3, style="why", only=doc.READ),
            lambda check: _reason(check, id(check) in own_cures),
        ),
        (doc.Column(head="reason", width=3, only=("latex",)), _brief_reason),
        cards=True,
    )
    return table, note if hidden else None


def _name(check: Check) -> doc.Name:
    mode = () if check.mode is None else (f"mode {check.mode}",)
    group = () if check.group is None else (f"group of agent {check.group}",)
    return doc.Name((check_name(check), *mode, *group), id=check.id)


def _reason(check: Check, own_cure: bool) -> doc.Reason:
    """Everything that is said about a check; a cure that stands above the table or in another row is pointed to."""
    details = [*_exact(check)] + ([] if check.witness is None else [_witness(check.witness, check.id)])
    fix = check.fix
    return doc.Reason(
        text=capitalize_first(_cut(check.reason)),
        details=tuple(details),
        cure=None if fix is None else _cut(fix.text) if own_cure else POINTER,
        lines=_fix_lines(fix) if fix is not None and own_cure else (),
    )


def _brief_reason(check: Check) -> str:
    return " ".join([capitalize_first(_cut(check.reason)), *(f"{key}: {value}." for key, value in _exact(check))])


def _exact(check: Check) -> Iterator[tuple[str, str]]:
    for key, value in (check.exact or {}).items():
        if key in _EXACT:  # the other values stand in the reason, or among the matrices
            yield _EXACT[key], _entries(value) if isinstance(value, (list, tuple)) else _number(str(value))


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


def _cut(text: str, longest: int = LONGEST_TEXT) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
