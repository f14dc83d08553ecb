"""Checks in the report: what was decided, with which numbers and why, where it stands, how to
decide it once more."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

from dobc_design._show.text import capitalize_first, rate_text, significant_towards_zero, upper
from dobc_design.certificate import text as certificate_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check, Checks, Fix, Witness, main_cure, other_cures
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem import canonical
from dobc_design.problem.changes import change_lines
from dobc_design.verdict import Verdict

from .document import (
    IN_TEXT,
    PAGES,
    READ,
    Block,
    Blocks,
    Code,
    Column,
    Fact,
    Facts,
    Name,
    Own,
    Reason,
    Section,
    Text,
    command,
    section,
    table_of,
    to_read,
)
from .findings import Findings
from .words import (
    FIXED,
    decimal,
    domain_words,
    mark_of,
    names_in_words,
    rational,
    sentence,
    shortened,
    verdict_counts,
)

CURE_COMMAND = "dobc certify problem.json --apply-fix cured.toml"
MOST_ROWS = 150
MOST_ENTRIES = 24  # of a vector
MOST_LINES = 20  # of a cure
POINTER = "named above."  # where the cure of a check is part of the main one
_ORDER = (Verdict.REFUTED, Verdict.UNDECIDED, Verdict.PROVED)
_EXACT = {
    "bound": "λmax(Λ) must be below",
    "value": "v′Λv",
    "routh": "first column of Routh’s table",
}
_READING = """\
“Proved” and “refuted” rest on exact arithmetic alone.
Margins and rates are in 1/s and rounded towards zero, factors up: they hold as printed.
Rate and factor: |e(t)| ≤ factor · |e(0)| · exp(−rate t) + what the estimation error adds."""
#: Options of `dobc certify` that change a certificate or its report; what a file says beside them
#: is not repeated.
_OPTION = re.compile(
    "--(?:all|search|(?:settling|settling-radius|settling-disturbance|rate|time-limit) (.+))"
)
VERIFY = "dobc verify certificate.json --problem problem.json"
ALONE = "python -I -S dobc_design/checker certificate.json problem.json"


def cure_section(found: Findings) -> Iterator[Section]:
    """The cure that everything else waits for, in words and as lines of the problem file; nothing
    without one."""
    check = main_cure(found.certificate.checks)
    if check is None or check.fix is None:
        return
    if check.verdict is not Verdict.REFUTED:
        # Nothing failed that could be cured: it was not decided.
        head = f"What would help {check.id}"
    elif check.kind.role == "paper":
        head = "What would cure it"
    else:
        head = f"What would cure {check.id}"
    blocks: list[Block] = [Text(shortened(check.fix.text))]
    lines = _fix_lines(check.fix)
    if lines:
        blocks += [Text("In the problem file:"), Code(lines)]
    blocks += [Text(FIXED["cured"]), command(CURE_COMMAND)]
    yield Section(head, blocks, "cure", "Cure")


def checks_section(found: Findings) -> Iterator[Section]:
    """Every check with its verdict, numbers and reason."""
    checks = found.certificate.checks
    counts = verdict_counts(checks) or "none"
    failed = sum(not check.is_proved for check in checks)
    # Beside a proof a failed check is no failure: it was tried and is not needed.
    if found.proved and failed:
        counts = f"{len(checks) - failed} proved, {failed} not needed"
    blocks = (to_read(Text(Own(_READING))), *_checks_table(checks, found.problem.unit))
    yield Section(f"Checks: {counts}", blocks, "checks", "Checks")


def _checks_table(checks: Checks, unit: str) -> Blocks:
    """The checks as rows; of very many, those not proved first, and a sentence about the others."""
    own_cures = {id(each) for each in other_cures(checks)}

    # Of very many checks those that are not proved are the ones to be seen.
    ordered = sorted(range(len(checks)), key=lambda i: _ORDER.index(checks[i].verdict))
    yield table_of(
        "Checks with verdict, domain, margin, rate, factor and reason",
        # shown in the order in which they were made
        [checks[i] for i in sorted(ordered[:MOST_ROWS])],
        Column("verdict", lambda check: mark_of(check.verdict), 0),
        Column("condition", _name, 1.5),
        Column("id", lambda check: check.id, only=("markdown",)),
        Column("where", lambda check: domain_words(check.domain, unit), 1.1),
        Column(
            "margin",
            lambda check: significant_towards_zero(check.margin),
            0.8,
            unit="1/s",
            style="number",
        ),
        Column("rate", lambda check: rate_text(check.rate), 0.8, unit="1/s", style="number"),
        Column("factor", lambda check: upper(check.factor), 0.8, style="number"),
        Column(
            "reason",
            lambda check: _reason(check, own_cure=id(check) in own_cures),
            3,
            style="why",
            only=READ,
        ),
        Column("reason", _brief_reason, 3, only=("latex",)),
        cards=True,
    )
    hidden = [checks[i] for i in ordered[MOST_ROWS:]]
    if hidden:
        told = verdict_counts(hidden, _ORDER)
        note = (
            f"{len(checks)} checks were made; {len(hidden)} of them ({told}) are in "
            "certificate.json only."
        )
        yield Text(note)


def _name(check: Check) -> Name:
    parts = [check.kind.name]
    if check.mode is not None:
        parts.append(f"mode {check.mode}")
    if check.group is not None:
        parts.append(f"group of agent {check.group}")
    return Name(tuple(parts), id=check.id)


def _reason(check: Check, *, own_cure: bool) -> Reason:
    """Everything that is said about a check; a cure that stands above the table or in another row
    is pointed to."""
    text = sentence(shortened(check.reason))
    details = list(_exact(check))
    if check.witness is not None:
        details.append(_witness(check.witness, check.id))
    fix = check.fix
    if fix is None:
        return Reason(text=text, details=details)
    # The same cure is not told twice.
    if not own_cure:
        return Reason(text=text, details=details, cure=POINTER)
    cure = shortened(fix.text)
    return Reason(text=text, details=details, cure=cure, lines=_fix_lines(fix))


def _brief_reason(check: Check) -> str:
    parts = [capitalize_first(shortened(check.reason))]
    for name, value in _exact(check):
        parts.append(f"{name}: {value}.")
    return " ".join(parts)


def _exact(check: Check) -> Iterator[Fact]:
    """Exact values by what they are called; others stand in the reason, or among the matrices."""
    for key, value in (check.exact or {}).items():
        if key not in _EXACT:
            continue
        # A row of Routh's table is a list, a bound a number.
        listed = isinstance(value, (list, tuple))
        yield _EXACT[key], _entries(value) if listed else _number(str(value))


def _witness(witness: Witness, id: str) -> Fact:
    """What a witness is, and its values."""
    who = f" (agents {names_in_words(witness.labels)})" if witness.labels else ""
    values = _entries(witness.values) if witness.values else ""
    match witness.kind:
        case "vector" if id == "observability":
            return "A state that C never sees, ξ", values
        case "vector":
            return f"A direction v in which V does not decrease{who}, v", values
        case "agents":
            return "Agents that no pin reaches", names_in_words(witness.labels or (), 30)
        case "polynomial":
            factor = ", ".join(witness.values or ())
            return "The factor that does not decay", shortened(factor)
        case "routh_row":
            return "First column of Routh’s table", values
        case kind:
            return f"Witness ({shortened(kind, 40)}){who}", values


def _fix_lines(fix: Fix) -> tuple[str, ...]:
    """The lines of the problem file that a cure sets, each on one line."""
    lines = change_lines(fix.set)[:MOST_LINES]
    return tuple(shortened(" ".join(line.split())) for line in lines)


def _entries(values: Sequence[Any]) -> str:
    """A number, or a vector of which the first entries are shown."""
    # A vector of thousands of entries would hide the sentence beside it.
    shown = [_number(str(value)) for value in values[:MOST_ENTRIES]]
    if len(values) == 1:
        return shown[0]
    text = ", ".join(shown)
    if len(values) <= MOST_ENTRIES:
        return f"({text})"
    return f"({text}, …), {len(values)} entries"


def _number(text: str) -> str:
    """A rational in decimals, five digits of it; other texts are only cut.  The exact one is in
    certificate.json."""
    value = rational(text)
    return shortened(text, 80) if value is None else decimal(value)


@section("Traceability", "traceability")
def trace_section(found: Findings) -> Blocks:
    """One row per condition of the certificate, in its order."""
    ids = dict.fromkeys(check.id for check in found.certificate.checks)
    yield to_read(Text(Own(FIXED["traced"])))
    yield table_of(
        "Every condition, its source, and where it is decided",
        [KINDS[id] for id in ids],
        Column("check", lambda kind: f"{kind.name} ({kind.id})", 1.2, only=IN_TEXT),
        Column("check", lambda kind: Name((kind.name,), id=kind.id), 1.2, only=PAGES),
        Column("condition in words", lambda kind: sentence(kind.meaning), 1.9),
        Column("where it stands", lambda kind: kind.source, 1.2),
        Column("decided in", lambda kind: ", ".join(kind.decided_in), 1.4, style="code"),
        Column("decided again in", lambda kind: kind.checker, 1.1, style="code"),
        cards=True,
    )


@section("Check it yourself", "recheck")
def recheck_section(found: Findings) -> Blocks:
    """The commands that decide the certificate again and make it again, and what it was made
    from."""
    certificate, claims = found.certificate, found.certificate.claims
    yield Text(FIXED["both_files"])
    yield command(VERIFY)
    yield Text(FIXED["trusts"])
    yield command(ALONE)
    if found.kernel:
        yield Text(f"{found.kernel} {FIXED['kernel']}")
        yield command("coqc proof.v")
    versions = (
        ("program", f"dobc_design {claims.version}"),
        ("certificate format", f"{certificate_text.FORMAT} {certificate_text.VERSION}"),
        ("problem format", f"{canonical.FORMAT} {canonical.VERSION}"),
    )
    yield Text("To make the certificate again, byte for byte with the same version:")
    yield command(certify_command(certificate))
    yield Text(Own(FIXED["made_with"]))
    yield Text("Compare the problem with the one you meant. The fingerprints and versions are")
    yield Facts((("problem", claims.problem_name), *found.prints, *versions))


def certify_command(certificate: Certificate) -> str:
    """The command that decides the same conditions, with the options that are known here."""
    # A certificate comes from a file: of its texts only numbers become part of a command.
    found = map(_OPTION.fullmatch, certificate.claims.options)
    typed = [each[0] for each in found if each and rational(each[1] or "0") is not None]
    return " ".join(["dobc certify problem.json", *typed, "--out again"])
