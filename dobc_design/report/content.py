"""What a report says about a certificate, as one document for all forms.

A report is made of parts, listed in their order at the end of this file.  A part is a function that
takes what was found and gives its section, or nothing where it has nothing to say; to add one,
write it and list it.  Handed everything, computes nothing.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

from dobc_design.certificate import text as certificate_text
from dobc_design.report import pictures, words
from dobc_design.verdict import Verdict

from .arcs import arcs_section
from .bands import bands_section
from .checks import (
    VERIFY,
    checks_section,
    cure_section,
    recheck_section,
    trace_section,
)
from .condition import condition_section
from .diagnostics import bound_section, eigenvalue_section, simulation_section
from .document import (
    Beside,
    Block,
    Blocks,
    Box,
    Document,
    Fact,
    Facts,
    List,
    Section,
    Signatures,
    Terms,
    Text,
    command,
    in_markdown,
    on_pages,
    section,
    turned,
)
from .findings import Findings
from .plant import plant_section
from .readings import readings_section
from .region_words import region_section, search_sections, settling_section
from .system import loop_section, network_section, problem_section

LONGEST_NAME = 70  # characters, in the footer of a printed page
_REGION = "dobc region problem.json"
_DESIGN = "dobc design problem.json --out designed.toml"

Part = Callable[[Findings], Blocks]


def _identity(found: Findings) -> tuple[Fact, ...]:
    """Which certificate this is, and what decided it."""
    version = found.certificate.claims.version
    file_format = f"{certificate_text.FORMAT} {certificate_text.VERSION}"
    return (*found.prints, ("Decided by", f"dobc_design {version}, {file_format}"))


def _facts(found: Findings) -> list[Fact]:
    """What is certified in a few words; without a certified rate, as where errors do not vanish,
    only what is known."""
    certificate = found.certificate
    facts = words.facts(certificate).items()
    return [(name, told) for name, told in facts if certificate.rate is not None or told != "–"]


def _summary(found: Findings) -> Blocks:
    """Identity and facts as a table: pages have them in their frames."""
    yield in_markdown(Facts((*_identity(found), *_facts(found))))


@section("What this says, and what it does not", "meaning")
def _meaning(found: Findings) -> Blocks:
    meaning = words.what_it_means(found.certificate)
    says = Section("It says", (List(meaning.says),))
    says_not = Section("Its limits", (List(meaning.says_not),))
    # Beside each other, so that nobody reads the first without the second.
    yield Beside(((says,), (says_not,)))


def _next_step(found: Findings) -> Blocks:
    """What to do now: how a reviewer checks what is proved, else the cure, or what would settle
    it."""
    if found.proved:
        told = (
            "Send certificate.json and problem.json with this report. A reviewer decides every "
            "claim again with"
        )
        deployment = Text(words.deployment_words(found.certificate))
        blocks = (Text(told), command(VERIFY), deployment)
        yield Section("What to do next", blocks, "next")
        return
    # A cure that is known is worth more than advice, and both may be there.
    cures = tuple(cure_section(found))
    yield from cures
    advice = found.certificate.claims.why.advice
    if advice:
        title = "What would decide it"
        told = f"{words.sentence(advice)} This command shows from which starts consensus is proved:"
        typed = _REGION
    # ``dobc design`` needs a problem of its own kind for agents with dynamics.
    elif not cures and found.problem.dynamics is None:
        title = "What to do next"
        told = (
            "This command searches for pins and gains that are proved for the problem, or "
            "proves that there are none:"
        )
        typed = _DESIGN
    else:
        return
    yield Section(title, (Text(told), command(typed)), "next")


def _regions(found: Findings) -> Blocks:
    regions = found.certificate.regions
    drawn = tuple(pictures.region_pictures(regions))
    return region_section(found.certificate.size, found.problem, regions, drawn)


def _settling(found: Findings) -> Blocks:
    settling = found.certificate.settling
    drawn = tuple(pictures.envelope_pictures(settling))
    return settling_section(settling, drawn)


@section("What a search for counterexamples found", "search", "Search")
def _searches(found: Findings) -> Blocks:
    unit = found.problem.unit
    drawn = [pictures.search_picture(each, k, unit=unit) for k, each in enumerate(found.searches)]
    yield from search_sections(found.searches, drawn)


def _optional_changes(found: Findings) -> Blocks:
    """Cures of checks that the proof did not need; those of a failure stand above."""
    if found.proved:
        for cure in cure_section(found):
            yield replace(cure, title="Optional changes")


@section("Words", "glossary")
def _glossary(found: Findings) -> Blocks:
    # All three, also those that this report does not have: the sign alone explains nothing.
    verdicts = [(words.mark_of(each), words.TEXTS["verdicts"][each.value]) for each in Verdict]
    yield Terms(verdicts)
    told = dict(words.TEXTS["words"])
    if not found.problem.has_target:
        del told["pin"]
    yield on_pages(Terms(tuple(told.items())))


@section("Signatures", "signatures")
def _signatures(found: Findings) -> Blocks:
    heads = ("Name", "Date", "Signature")
    roles = ("Prepared by", "Checked by", "Approved by")
    # On paper the signatures may stand on a page of their own.
    certificate = found.certificate
    signed = f"{certificate.problem.name}: {certificate.verdict.value}."
    yield Text(f"{signed} {words.sentence(certificate.reason)}")
    yield Text(words.FIXED["signing"])
    yield Signatures(heads, roles)


#: What everybody reads, in this order.
OPEN: tuple[Part, ...] = (
    _summary,
    _meaning,
    plant_section,
    bands_section,
    readings_section,
    loop_section,
    bound_section,
    _next_step,
)
#: What is closed on a page, and printed only where the whole report is asked for.
DETAILS: tuple[Part, ...] = (
    problem_section,
    network_section,
    _regions,
    arcs_section,
    _settling,
    _searches,
    _optional_changes,
    checks_section,
    condition_section,
    eigenvalue_section,
    simulation_section,
    trace_section,
    recheck_section,
    _glossary,
    _signatures,
)


def _shown(parts: Iterable[Part], found: Findings) -> tuple[Block, ...]:
    return tuple(block for part in parts for block in part(found))


def report_document(found: Findings) -> Document:
    """The report of a certificate, with whatever was computed to be shown beside it."""
    certificate = found.certificate
    name, verdict = found.problem.name, certificate.verdict
    # What would help stands in a section of its own.
    reason = certificate.claims.why.head
    # that of certificate.json, by which a printed page is known again
    fingerprint = found.prints[1][1]
    document = Document(
        kind="Certificate of consensus",
        name=name,
        title=f"{name}: {verdict.value}",
        verdict=Box(
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
    # Every part is written for a target; here it becomes what the agents of this problem do.
    problem = found.problem
    return document if problem.has_target else turned(document, words.said_here(problem))
