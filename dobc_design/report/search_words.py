"""A search for counterexamples in words and rows: what was tried, what is suspect, what is proved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dobc_design.falsification.suspect import LEAVES, RESTS, STAYS_AWAY, Falsification, Suspect
from dobc_design.report import document as doc
from dobc_design.report.region_words import lower
from dobc_design.report.words import capitalize_first, names_in_words, number, typeset

HEADS: Final = ("what", "|e|∞ at the start", "|e|∞ at the end", "after", "farthest from the target", "mode")
MOST_ROWS: Final = 8
MOST_STATES: Final = 6  # agents whose states a sentence tells
_SEVERAL: Final = 3  # modes that are named
WARNING: Final = (
    "A suspect is a simulated run in floating point. It refutes nothing: the run may be too short, or the integrator"
    " wrong. It says where a proof will be hard to find."
)
_WHAT: Final = {STAYS_AWAY: "does not converge", LEAVES: "leaves the certified set", RESTS: "rests there (proved)"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SuspectRow:
    """One suspect, ready to be shown; everything is plain text."""

    what: str
    first: str
    last: str
    after: str
    who: str
    modes: str

    @property
    def cells(self) -> tuple[str, ...]:
        """In the order of HEADS."""
        return (self.what, self.first, self.last, self.after, self.who, self.modes)


def search_view(searches: Sequence[Falsification]) -> list[dict[str, Any]]:
    """What the page, the Markdown text and the terminal show of every search."""
    return [
        {
            "title": f"Search: {search.target}",
            "tried": tried_sentence(search),
            "found": found_sentence(search),
            "proved": equilibrium_sentences(search),
            "warning": WARNING if any(each.kind != RESTS for each in search.suspects) else None,
            "heads": HEADS,
            "rows": suspect_rows(search),
            "notes": list(search.notes),
        }
        for search in searches
    ]


def search_sections(
    searches: Sequence[Falsification], pictures: Sequence[doc.Picture | None]
) -> tuple[doc.Section, ...]:
    """One section for each search."""
    found = []
    for view, picture in zip(search_view(searches), pictures, strict=True):
        blocks: list[doc.Block] = [doc.Text(f"{view['tried']} {view['found']}")]
        if view["proved"]:
            blocks.append(doc.List(tuple(view["proved"])))
        if picture is not None:
            blocks.append(doc.Only(doc.PAGES, (doc.Pictures((picture,)),)))
        if view["rows"]:
            columns = tuple(doc.Column(head=head) for head in HEADS)
            blocks.append(doc.Table(caption="Suspects", columns=columns, rows=tuple(row.cells for row in view["rows"])))
        if view["warning"]:
            blocks.append(doc.Text(view["warning"], "warning"))
        found.append(doc.Section(title=view["title"], blocks=(*blocks, *map(doc.Text, view["notes"]))))
    return tuple(found)


def tried_sentence(search: Falsification) -> str:
    """How much was looked at."""
    return (
        f"{search.tried} starts from {_set(search)} were simulated for {number(search.horizon)} s (seed"
        f" {search.seed}): corners, edges, random ones, and the worst of them made worse by following the gradient."
    )


def found_sentence(search: Falsification) -> str:
    """What came out, in one sentence."""
    runs = [each for each in search.suspects if each.kind != RESTS]
    if runs:
        return f"{len(runs)} suspect{'s' if len(runs) > 1 else ''} stayed."
    if search.proved:
        return "No run is suspect but those that rest at another equilibrium."
    text = "No suspect was found, which proves nothing."
    if search.certified_rate and search.observed_rate is not None:
        text += (
            f" V fell at {number(search.observed_rate)} 1/s or faster in every run; certified are"
            f" {lower(search.certified_rate)} 1/s."
        )
    return text


def equilibrium_sentences(search: Falsification) -> list[str]:
    """The proved equilibria, each with its place, and what follows from them."""
    told = []
    for claim in search.proved:
        size = max(abs(float(x)) for x in claim.middle)
        resting = next((each for each in search.suspects if each.equilibrium is claim), None)
        place = "" if resting is None else f", x = {_states(resting)}"
        told.append(f"Proved: in mode {claim.mode} the agents may also rest at |e|∞ ≈ {number(size)}{place}.")
    if not told:
        return []
    told.append("No proof of consensus can reach there, and none of this certificate does.")
    if search.check is not None:
        told.append("The region asked for holds such a place and is therefore refuted.")
    return told


def _states(suspect: Suspect) -> str:
    """The first states, agent by agent."""
    shown = [", ".join(number(x) for x in row) for row in suspect.start[:MOST_STATES].tolist()]
    more = ", …" if len(suspect.start) > MOST_STATES else ""
    return f"({'; '.join(shown)}{more})"


def suspect_rows(search: Falsification) -> list[SuspectRow]:
    """The worst first, at most eight."""
    return [_row(each) for each in search.suspects[:MOST_ROWS]]


def _row(suspect: Suspect) -> SuspectRow:
    names = list(dict.fromkeys(name for _, name in suspect.modes))
    last = "unbounded" if math.isinf(suspect.final_error) else number(suspect.final_error)
    return SuspectRow(
        what=_WHAT[suspect.kind],
        first=number(float(suspect.error[0])),
        last=last,
        after=f"{typeset(number(float(suspect.times[-1])))} s",
        who=names_in_words(list(suspect.labels), 6),
        modes=", ".join(names) if len(names) <= _SEVERAL else f"{len(names)} modes in turn",
    )


def _set(search: Falsification) -> str:
    return search.target.replace("|e|_inf", "|e|∞").replace("<=", "≤")


def search_alt(search: Falsification) -> str:
    """The picture of a search in words."""
    told = "; ".join(
        f"{_WHAT[each.kind]}, from {number(float(each.error[0]))} to"
        f" {'infinity' if math.isinf(each.final_error) else number(each.final_error)}"
        for each in search.suspects[:MOST_ROWS]
    )
    return capitalize_first(f"largest error over time of {len(search.suspects[:MOST_ROWS])} run(s): {told}.")
