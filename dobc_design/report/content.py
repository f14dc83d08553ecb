"""What a report says about a certificate, as one document for all forms.

A report is made of parts, listed in their order at the end of this file.  A part is a function that
takes what was found and gives its section, or nothing where it has nothing to say; to add one,
write it and list it.  Handed everything, computes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Final

from dobc_design.certificate import text as certificate_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.report import checks, pictures, words
from dobc_design.report import document as doc
from dobc_design.report.condition import condition_section
from dobc_design.report.diagnostics import bound_section, eigenvalue_section, simulation_section
from dobc_design.report.findings import Findings
from dobc_design.report.plant import plant_section
from dobc_design.report.region_words import region_section, search_sections, settling_section
from dobc_design.report.system import loop_section, network_section, problem_section
from dobc_design.verdict import Verdict

LONGEST_NAME = 70  # characters, in the footer of a printed page
_REGION = "dobc region problem.json"
_DESIGN = "dobc design problem.json --out designed.toml"

Part = Callable[[Findings], Iterator[doc.Block]]


def _identity(found: Findings) -> tuple[tuple[str, str], ...]:
    """Which certificate this is, and what decided it."""
    version = found.certificate.claims.version
    file_format = f"{certificate_text.FORMAT} {certificate_text.VERSION}"
    return (*found.prints, ("Decided by", f"dobc_design {version}, {file_format}"))


def _facts(found: Findings) -> list[tuple[str, str]]:
    """What is certified in a few words; of an undecided certificate only what is known."""
    facts = words.facts(found.certificate).items()
    return [(name, told) for name, told in facts if found.proved or told != "–"]


def _summary(found: Findings) -> Iterator[doc.Block]:
    """Identity and facts as a table: pages have them in their frames."""
    yield doc.in_markdown(doc.Facts((*_identity(found), *_facts(found))))


def _meaning(found: Findings) -> Iterator[doc.Block]:
    meaning = words.what_it_means(found.certificate)
    says = doc.Section("It says", (doc.List(meaning.says),))
    says_not = doc.Section("It does not say", (doc.List(meaning.says_not),))
    # Beside each other, so that nobody reads the first without the second.
    both = doc.Beside(((says,), (says_not,)))
    yield doc.Section("What this says, and what it does not", (both,), "meaning")


def _plant(found: Findings) -> Iterator[doc.Block]:
    return plant_section(found.certificate)


def _loop(found: Findings) -> Iterator[doc.Block]:
    yield loop_section(found.certificate)


def _next_step(found: Findings) -> Iterator[doc.Block]:
    """What to do now: how a reviewer checks what is proved, else the cure, or what would settle
    it."""
    certificate = found.certificate
    if found.proved:
        yield _review(certificate)
        return
    # A cure that is known is worth more than advice, and both may be there.
    cures = tuple(checks.cure_section(certificate.checks))
    yield from cures
    advice = certificate.claims.why.advice
    if advice:
        title = "What would decide it"
        told = f"{words.sentence(advice)} This command shows from which starts consensus is proved:"
        command = _REGION
    # ``dobc design`` needs a problem of its own kind for agents with dynamics.
    elif not cures and found.problem.dynamics is None:
        title = "What to do next"
        told = (
            "This command searches for pins and gains that are proved for the problem, or "
            "proves that there are none:"
        )
        command = _DESIGN
    else:
        return
    yield doc.Section(title, (doc.Text(told), doc.command(command)), "next")


def _review(certificate: Certificate) -> doc.Section:
    """How somebody else checks a proof, and where the controller comes from."""
    told = (
        "Send certificate.json and problem.json with this report. A reviewer decides every "
        "claim again with"
    )
    blocks = (
        doc.Text(told),
        doc.command(checks.VERIFY),
        doc.Text(words.deployment_words(certificate)),
    )
    return doc.Section("What to do next", blocks, "next")


def _problem(found: Findings) -> Iterator[doc.Block]:
    yield problem_section(found.problem)


def _network(found: Findings) -> Iterator[doc.Block]:
    yield network_section(found.problem, found.analysis)


def _regions(found: Findings) -> Iterator[doc.Block]:
    regions = found.certificate.regions
    drawn = tuple(pictures.region_pictures(regions))
    return region_section(found.problem, regions, drawn)


def _settling(found: Findings) -> Iterator[doc.Block]:
    settling = found.certificate.settling
    drawn = tuple(pictures.envelope_pictures(settling))
    return settling_section(settling, drawn)


def _searches(found: Findings) -> Iterator[doc.Block]:
    if found.searches:
        drawn = [pictures.search_picture(each, k) for k, each in enumerate(found.searches)]
        sections = search_sections(found.searches, drawn)
        yield doc.Section("What a search for counterexamples found", sections, "search", "Search")


def _optional_changes(found: Findings) -> Iterator[doc.Block]:
    """Cures of checks that the proof did not need; those of a failure stand above."""
    if found.proved:
        for section in checks.cure_section(found.certificate.checks):
            yield replace(section, title="Optional changes")


def _checks(found: Findings) -> Iterator[doc.Block]:
    yield checks.checks_section(found.certificate.checks, proved=found.proved)


def _condition(found: Findings) -> Iterator[doc.Block]:
    yield condition_section(found.certificate, found.lambdas)


def _traceability(found: Findings) -> Iterator[doc.Block]:
    yield checks.trace_section(found.certificate.checks)


def _recheck(found: Findings) -> Iterator[doc.Block]:
    yield checks.recheck_section(found.certificate, found.prints, found.kernel)


def _glossary(found: Findings) -> Iterator[doc.Block]:
    verdicts = [(words.mark_of(each), words.TEXTS["verdicts"][each.value]) for each in Verdict]
    terms = doc.Terms(tuple(words.TEXTS["words"].items()))
    yield doc.Section("Words", (doc.Terms(verdicts), doc.on_pages(terms)), "glossary")


def _signatures(found: Findings) -> Iterator[doc.Block]:
    heads = ("Name", "Date", "Signature")
    roles = ("Prepared by", "Checked by", "Approved by")
    blocks = (doc.Text(words.TEXTS["fixed"]["signing"]), doc.Signatures(heads, roles))
    yield doc.Section("Signatures", blocks, "signatures")


#: What everybody reads, in this order.
OPEN: Final[tuple[Part, ...]] = (
    _summary,
    _meaning,
    _plant,
    _loop,
    bound_section,
    _next_step,
)
#: What is closed on a page, and printed only where the whole report is asked for.
DETAILS: Final[tuple[Part, ...]] = (
    _problem,
    _network,
    _regions,
    _settling,
    _searches,
    _optional_changes,
    _checks,
    _condition,
    eigenvalue_section,
    simulation_section,
    _traceability,
    _recheck,
    _glossary,
    _signatures,
)


def _shown(parts: Iterable[Part], found: Findings) -> tuple[doc.Block, ...]:
    return tuple(block for part in parts for block in part(found))


def report_document(found: Findings) -> doc.Document:
    """The report of a certificate, with whatever was computed to be shown beside it."""
    certificate = found.certificate
    name, verdict = found.problem.name, certificate.verdict
    # What would help stands in a section of its own.
    reason = certificate.claims.why.head
    # that of certificate.json, by which a printed page is known again
    fingerprint = found.prints[1][1]
    return doc.Document(
        kind="Certificate of consensus",
        name=name,
        title=f"{name}: {verdict.value}",
        verdict=doc.Box(
            mark=words.mark_of(verdict),
            word=verdict.value.capitalize(),
            reason=words.sentence(reason.strip()),
            facts=_facts(found),
        ),
        identity=_identity(found),
        footer=f"{words.shortened(name, LONGEST_NAME)}: {verdict.value} · certificate "
        f"{fingerprint[:16]}…",
        blocks=_shown(OPEN, found),
        details=_shown(DETAILS, found),
    )
