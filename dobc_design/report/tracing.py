"""Where every check comes from and where it is decided: paper or theory, this package, the lone checker."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dobc_design.certificate import text as certificate_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem import canonical
from dobc_design.report import document as doc
from dobc_design.report.formulas import rational
from dobc_design.verdict import Verdict

#: Options of `dobc certify` that change a certificate or its report; what a file says beside them is not repeated.
SWITCHES: Final = ("--all", "--search")
SETTLING: Final = "--settling "
_TRACED: Final = (
    "Every condition that was checked: what it says, where it stands in the paper or in the theory beside it, which"
    " module of dobc_design decided it here, and which file of the lone checker decides it once more, in plain Python"
    " that shares nothing with the package."
)
_MADE_WITH: Final = (
    "The command has the options that the certificate was made with. The fingerprint is that of the file as dobc_design"
    " writes it."
)
_BOTH_FILES: Final = (
    "The files certificate.json and problem.json lie beside this page. This decides every claim again in exact"
    " arithmetic:"
)
_TRUSTS: Final = (
    "It trusts the problem file and believes nothing of the certificate: margins, rates, witnesses and the overall"
    " verdict are all proved anew. With nothing but Python, and none of this package, the lone checker (checker.py with"
    " region_checker.py, quadratic_checker.py and groups_checker.py beside it) does the same:"
)
_DECIDES: Final = (
    "This decides every claim again in exact arithmetic, against the problem file, which it trusts.\n"
    "With nothing but Python, and none of this package, the lone checker (four files) does the same:"
)
_SIGNING: Final = (
    "Who signs says which problem and which certificate it is about: the fingerprints above. What is proved needs no"
    " signature; that the model fits the plant does."
)


def trace_section(checks: Sequence[Check]) -> doc.Section:
    """One row per condition of the certificate, in its order."""
    table = doc.table_of(
        "Every condition, its source, and where it is decided",
        [KINDS[id] for id in dict.fromkeys(check.id for check in checks)],
        (doc.Column(head="check", width=1.2, only=doc.TEXTS), lambda kind: f"{kind.name} ({kind.id})"),
        (doc.Column(head="check", width=1.2, only=doc.PAGES), lambda kind: doc.Name((kind.name,), id=kind.id)),
        (doc.Column(head="condition in words", width=1.9), lambda kind: kind.meaning),
        (doc.Column(head="where it stands", width=1.2), lambda kind: kind.source),
        (doc.Column(head="decided in", width=1.4, style="code"), lambda kind: ", ".join(kind.decided_in)),
        (doc.Column(head="decided again in", width=1.1, style="code"), lambda kind: kind.checker),
        (doc.Column(head="found here", width=0.8), lambda kind: _found(kind.id, checks)),
    )
    blocks = (doc.Only(doc.READ, (doc.Text(doc.Own(_TRACED)),)), table)
    return doc.Section(name="traceability", title="Traceability", short="Traceability", blocks=blocks)


def _found(id: str, checks: Sequence[Check]) -> str:
    counts = [(each, sum(check.id == id and check.verdict is each for check in checks)) for each in Verdict]
    return ", ".join(each.value if count == 1 else f"{count} × {each.value}" for each, count in counts if count)


def recheck_section(certificate: Certificate, again: Reproduction) -> doc.Section:
    """The commands that decide the certificate again and make it again, and what it was made from."""
    verify, alone, certify = (doc.Code((line,), command=True) for line in (again.verify, again.alone, again.certify))
    identity = (("problem", certificate.claims.problem_name), *again.prints, *again.versions)
    return doc.Section(
        name="recheck",
        title="Check it yourself",
        short="Check it yourself",
        blocks=(
            doc.Only(doc.PAGES, (doc.Text(_BOTH_FILES),)),
            verify,
            doc.Only(("markdown",), (doc.Text(doc.Own(_DECIDES)),)),
            doc.Only(doc.PAGES, (doc.Text(_TRUSTS),)),
            alone,
            doc.Text("To make the certificate again, byte for byte with the same version:"),
            certify,
            doc.Text(doc.Own(_MADE_WITH)),
            doc.Only(
                doc.PAGES, (doc.Text("Compare the problem with the one you meant. The fingerprints and versions are"),)
            ),
            doc.Facts(identity),
        ),
    )


def signatures_section() -> doc.Section:
    """Lines for the people who sign a printed report."""
    lines = doc.Signatures(("Name", "Date", "Signature"), ("Prepared by", "Checked by", "Approved by"))
    return doc.Section(name="signatures", title="Signatures", short="Signatures", blocks=(doc.Text(_SIGNING), lines))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """What somebody needs to make and to check a certificate again: fingerprints, versions, commands."""

    prints: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    certify: str
    verify: str = "dobc verify certificate.json --problem problem.json"
    alone: str = "python -I -S checker.py certificate.json problem.json"


def reproduction(certificate: Certificate) -> Reproduction:
    """How to make and to check the same certificate again."""
    claims = certificate.claims
    data = certificate_text.certificate_bytes(claims)
    return Reproduction(
        prints=(
            ("SHA-256 of problem.json", claims.problem_sha256),
            ("SHA-256 of certificate.json", hashlib.sha256(data).hexdigest()),
        ),
        versions=(
            ("program", f"dobc_design {claims.version}"),
            ("certificate format", f"{certificate_text.FORMAT} {certificate_text.VERSION}"),
            ("problem format", f"{canonical.FORMAT} {canonical.VERSION}"),
        ),
        certify=_certify_command(claims.options, certificate.checks),
    )


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


def title_block(certificate: Certificate, again: Reproduction) -> tuple[tuple[str, str], ...]:
    """What identifies a signed report, on its first page."""
    (_, program), (_, file_format), _ = again.versions
    return (
        ("Problem", certificate.claims.problem_name),
        ("Verdict", certificate.verdict.value),
        *again.prints,
        ("Decided by", f"{program}, {file_format}"),
    )
