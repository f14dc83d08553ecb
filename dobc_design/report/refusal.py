"""The report of certificates that do not hold: what they say, what is not confirmed, and nothing of
the rest.

Nothing that such a certificate states is repeated as a fact: no rate, no bound, no picture of
certified starts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dobc_design._checks import noun
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import failing_words

from .checks import certify_command
from .document import Block, Box, Document, List, Mark, Section, Text, command
from .findings import fingerprints
from .words import shortened

if TYPE_CHECKING:
    from dobc_design.certification.recheck import Recheck

MOST = 200  # claims that are listed
LONGEST_NAME = 70  # characters, in the footer of a printed page
MARK = Mark("✗", "refuted")  # for its colour; the word beside it says "not confirmed"
UNCONFIRMED = "not confirmed"


@noun
class Checked:
    """A certificate with what became of its claims when they were decided again; ``letter``: A or B
    of two, else ""."""

    letter: str
    certificate: Certificate
    found: Recheck

    @property
    def name(self) -> str:
        """What it is called in sentences."""
        return self.letter or "The certificate"


def headline(sides: Sequence[Checked]) -> str:
    """What holds and what does not, in a sentence for each."""
    return " ".join(_sentence(each) for each in sides)


def _sentence(side: Checked) -> str:
    claimed = side.certificate.verdict.value
    if side.found.holds:
        return f"{side.name} holds: {claimed}."
    fails = failing_words(side.found.failures)
    return f"{side.name} says {claimed} and is {UNCONFIRMED}: {fails} for this problem."


def refusal_document(sides: Sequence[Checked]) -> Document:
    """One certificate, or two of which at least one does not hold."""
    # Two certificates of one problem have one name.
    names = " and ".join(dict.fromkeys(each.certificate.problem.name for each in sides))
    identity = []
    blocks: list[Block] = []
    for side in sides:
        for title, value in fingerprints(side.certificate):
            identity.append((f"{title} {side.letter}".strip(), value))
        blocks += _sections(side)
    kind = "Certificates of consensus"
    if len(sides) == 1:
        kind = "Certificate of consensus that is not confirmed"
    return Document(
        kind=kind,
        name=names,
        title=f"{names}: {UNCONFIRMED}",
        verdict=Box(mark=MARK, word=UNCONFIRMED.capitalize(), reason=headline(sides)),
        identity=identity,
        footer=f"{shortened(names, LONGEST_NAME)}: {UNCONFIRMED}",
        blocks=(*blocks, _advice(sides)),
    )


def _sections(side: Checked) -> Iterator[Section]:
    """What does not hold of one certificate, and what does."""
    of = f" of {side.letter}" if side.letter else ""
    failures, confirmed = side.found.failures[:MOST], side.found.confirmed[:MOST]
    if failures:
        yield Section(f"What does not hold{of}", (List(failures),))
    if confirmed:
        yield Section(f"Checks{of} that are confirmed", (List(confirmed),))


def _advice(sides: Sequence[Checked]) -> Section:
    told = "Make the certificate again from the problem that you mean:"
    failed = [side.certificate for side in sides if not side.found.holds]
    commands = command(*map(certify_command, failed))
    return Section("What to do next", (Text(told), commands), "next")
