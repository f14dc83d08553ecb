"""Where every check comes from and where it is decided: paper or theory, this package, the lone checker."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dobc_design.certificate import text as certificate_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.explanations import EXPLANATIONS
from dobc_design.problem import canonical
from dobc_design.report.formulas import rational
from dobc_design.report.words import CHECKS
from dobc_design.verdict import Verdict

_TARGET, _REGIONS, _QUADRATIC = "checker/consensus.py", "checker/separable.py", "checker/quadratic.py"
_OBSERVER, _CONSENSUS, _SEPARABLE = (
    "conditions/observer/decide.py",
    "conditions/consensus/decide.py",
    "conditions/separable/checks.py",
)

# id -> (modules: the one that makes the claim, then those whose decision it is; file of the lone checker)
DECIDED_IN: Final[dict[str, tuple[tuple[str, ...], str]]] = {
    "observability": ((_OBSERVER, "exact/observability.py"), _TARGET),
    "detectability": ((_OBSERVER, "exact/observability.py"), _TARGET),
    "hurwitz": ((_OBSERVER, "exact/polynomial.py"), _TARGET),
    "reachability": (("conditions/consensus/network.py",), _TARGET),
    "lemma1": ((_CONSENSUS, "exact/definite.py"), _TARGET),
    "theorem1": ((_CONSENSUS, "exact/definite.py"), _TARGET),
    "theorem2": ((_CONSENSUS, "exact/definite.py"), _TARGET),
    "theorem1-printed": ((_CONSENSUS, "exact/definite.py"), _TARGET),
    "theorem2-printed": ((_CONSENSUS, "exact/definite.py"), _TARGET),
    "max-separable": ((_SEPARABLE, "conditions/separable/decide.py", "conditions/separable/observer.py"), _REGIONS),
    "delay": ((_SEPARABLE, "conditions/separable/timing.py"), _REGIONS),
    "sampling": ((_SEPARABLE, "conditions/separable/timing.py"), _REGIONS),
    "equilibrium": (("conditions/equilibrium/decide.py",), "checker/equilibrium.py"),
    "lure": (("conditions/quadratic/checks.py", "conditions/quadratic/decide.py"), _QUADRATIC),
    "exhaustive": (("conditions/boxes/checks.py", "conditions/boxes/decide.py"), _QUADRATIC),
    "settling": (("conditions/schedule/checks.py", "conditions/schedule/decide.py"), "checker/schedule.py"),
}
#: Options of `dobc certify` that change a certificate or its report; what a file says beside them is not repeated.
SWITCHES: Final = ("--all", "--search")
SETTLING: Final = "--settling "
#: People who sign a printed report.
ROLES: Final = ("Prepared by", "Checked by", "Approved by")
SIGNED: Final = ("Name", "Date", "Signature")
TRACED: Final = (
    "Every condition that was checked: what it says, where it stands in the paper or in the theory beside it, which"
    " module of dobc_design decided it here, and which file of the lone checker decides it once more, in plain Python"
    " that shares nothing with the package."
)
MADE_WITH: Final = (
    "The command has the options that the certificate was made with. The fingerprint is that of the file as dobc_design"
    " writes it."
)
SIGNING: Final = (
    "Who signs says which problem and which certificate it is about: the fingerprints above. What is proved needs no"
    " signature; that the model fits the plant does."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceRow:
    """One condition: what it is in words, where it stands, who decides it; everything is plain text."""

    id: str
    name: str
    meaning: str
    source: str
    modules: tuple[str, ...]
    checker: str
    found: str

    @property
    def cells(self) -> tuple[str, ...]:
        """In the order of TRACE_HEADS."""
        name = f"{self.name} ({self.id})"
        return (name, self.meaning, self.source, ", ".join(self.modules), self.checker, self.found)


TRACE_HEADS: Final = ("check", "condition in words", "where it stands", "decided in", "decided again in", "found here")


def trace_rows(checks: Sequence[Check]) -> list[TraceRow]:
    """One row per condition of the certificate, in its order, without those that this version does not know."""
    return [_row(id, checks) for id in dict.fromkeys(check.id for check in checks) if id in DECIDED_IN]


def _row(id: str, checks: Sequence[Check]) -> TraceRow:
    modules, checker = DECIDED_IN[id]
    known = EXPLANATIONS[id]
    counts = [(each, sum(check.id == id and check.verdict is each for check in checks)) for each in Verdict]
    found = [each.value if count == 1 else f"{count} × {each.value}" for each, count in counts if count]
    return TraceRow(
        id=id,
        name=CHECKS[id][0],
        meaning=known.meaning,
        source=known.source,
        modules=modules,
        checker=checker,
        found=", ".join(found),
    )


def reproduction(certificate: Certificate) -> dict[str, Any]:
    """What somebody needs to make and to check the same certificate again: fingerprints, versions, commands."""
    claims = certificate.claims
    data = certificate_text.certificate_bytes(claims)
    return {
        "fingerprints": [
            ("problem.json", claims.problem_sha256),
            ("certificate.json", hashlib.sha256(data).hexdigest()),
        ],
        "versions": [
            ("program", f"dobc_design {claims.version}"),
            ("certificate format", f"{certificate_text.FORMAT} {certificate_text.VERSION}"),
            ("problem format", f"{canonical.FORMAT} {canonical.VERSION}"),
        ],
        "certify": _certify_command(claims.options, certificate.checks),
        "verify": "dobc verify certificate.json --problem problem.json",
        "alone": "python -I -S dobc_design/checker certificate.json problem.json",
    }


def _certify_command(options: Sequence[str], checks: Sequence[Check]) -> str:
    """The command that decides the same conditions: options that are known here, and the settling time proved."""
    asked = [option.removeprefix(SETTLING) for option in options if option.startswith(SETTLING)]
    proved = [
        str((check.exact or {}).get("tolerance"))
        for check in checks
        if check.id == "settling" and check.verdict is Verdict.PROVED and "--all" not in options
    ]
    tolerances = [number for number in map(rational, (*asked, *proved)) if number is not None]
    known = [option for option in SWITCHES if option in options]
    return " ".join(["dobc certify problem.json", *known, *(f"{SETTLING}{x}" for x in tolerances[:1]), "--out again"])


def title_block(certificate: Certificate, again: dict[str, Any]) -> list[tuple[str, str]]:
    """What identifies a signed report, on its first page."""
    prints = [(f"SHA-256 of {name}", value) for name, value in again["fingerprints"]]
    program, file_format, _ = again["versions"]
    return [
        ("Problem", certificate.claims.problem_name),
        ("Verdict", certificate.verdict.value),
        *prints,
        ("Decided by", f"{program[1]}, {file_format[1]}"),
    ]
