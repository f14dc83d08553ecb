"""Certified regions and settling times in words and rows, for the report and the terminal.

Handed over by whoever has proved them; nothing is computed but what a number needs to be shown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.check import Check
from dobc_design.conditions.kinds import KINDS
from dobc_design.conditions.schedule.checks import StageTiming
from dobc_design.conditions.schedule.decide import Settling, stage_rate
from dobc_design.exact.number import float_above, float_below
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report.words import SYMBOLS, capitalize_first, typeset
from dobc_design.verdict import Verdict

_FAST = 100  # samples a second from which a certified period is called pessimistic


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionRow:
    """One method, ready to be shown; everything is plain text."""

    id: str
    name: str
    verdict: str
    symbol: str
    kind: str
    starts: str
    box: str
    ball: str
    disturbance: str
    rate: str
    time: str
    covers: str
    limit: str


def region_section(problem: Problem, regions: Regions, pictures: tuple[doc.Picture, ...]) -> Iterator[doc.Section]:
    """From which starts each method proves consensus; nothing where nothing is said about a region."""
    if not regions.tried:
        return
    asked, norms, rest = asked_sentence(regions), norms_sentence(problem), rest_sentence(regions)
    bounds = () if rest is None else (doc.Text(rest),)
    timing = doc.List(tuple(timing_sentences(regions)))
    told = doc.Section(title="Time, late messages and sampling", blocks=(timing,))
    yield doc.Section(
        name="region",
        title="From which starts it is proved",
        short="Region",
        blocks=(
            doc.Only(("markdown",), (doc.Text(f"{asked} {norms}"),)),
            doc.Only(("html", "pdf", "latex"), (doc.Text(asked),)),
            doc.Only(doc.PAGES, (doc.Pictures(pictures),)),
            regions_table(regions, disturbed=bool(problem.groups)),
            doc.Only(doc.PAGES, (doc.Text(norms, "caption"),)),
            doc.Only(("markdown",), (doc.Text(agents_sentence(regions)),) if regions.agents else ()),
            doc.Only(doc.READ, bounds),
            doc.Only(doc.PAGES, (told,) if timing.items else ()),
            doc.Only(("markdown",), (timing,)),
        ),
    )


def regions_table(regions: Regions, *, disturbed: bool) -> doc.Table:
    """One row per method; Markdown has sizes in columns of their own."""
    markdown: tuple[doc.Form, ...] = ("markdown",)
    return doc.table_of(
        "Certified regions, method by method",
        region_rows(regions),
        (doc.Column(head="method", width=1.1), lambda row: doc.Name((row.name,), id=row.id)),
        (doc.Column(head="verdict", width=0), lambda row: doc.Mark(row.symbol, row.verdict)),
        (doc.Column(head="certified", only=markdown), lambda row: row.kind),
        (doc.Column(head="|e|∞ ≤", only=markdown), lambda row: row.box),
        (doc.Column(head="|e|₂ ≤", only=markdown), lambda row: row.ball),
        (doc.Column(head="|εᵢ| ≤", only=markdown if disturbed else ()), lambda row: row.disturbance),
        (doc.Column(head="certified starts", width=1.3, only=("html", "pdf", "latex")), lambda row: row.starts),
        (doc.Column(head="rate in 1/s", width=0.8, style="number"), lambda row: row.rate),
        (doc.Column(head=time_head(regions), width=0.8, style="number"), lambda row: row.time),
        (doc.Column(head="covers it", width=0.7), lambda row: row.covers),
        (doc.Column(head="why not further", width=1.7, style="why", only=doc.READ), lambda row: row.limit),
        cards=True,
    )


def region_rows(regions: Regions) -> list[RegionRow]:
    """One row per method, in the order in which they were tried."""
    return [
        RegionRow(
            id=claim.id,
            name=method_name(claim),
            verdict=claim.verdict.value,
            symbol=SYMBOLS[claim.verdict],
            kind=_KINDS[claim.kind],
            starts=_starts(claim),
            box=_size(claim, claim.box),
            ball=_size(claim, claim.ball),
            disturbance=lower(claim.disturbance),
            rate=lower(claim.rate),
            time="–" if claim.time is None else f"{upper(claim.time)} s",
            covers=_covers(claim, regions),
            limit=capitalize_first(claim.limit) or _no_limit(claim),
        )
        for claim in regions.claims
    ]


_KINDS = {"everywhere": "every start", "box": "box", "ball": "ball", "near": "near the target, no radius", "none": "–"}


def method_name(claim: RegionClaim) -> str:
    """The name of a method for people."""
    name = KINDS[claim.id].short
    return f"{name}, {claim.variant.replace('P_e', 'Pₑ')}" if claim.variant else name


def _starts(claim: RegionClaim) -> str:
    """The certified starts in a few words."""
    errors = f", every |εᵢ| ≤ {lower(claim.disturbance)}" if claim.disturbance else ""
    match claim.kind:
        case "box":
            return f"box |e|∞ ≤ {lower(claim.box)}{errors}"
        case "ball":
            return f"ball |e|₂ ≤ {lower(claim.ball)}{errors}; it holds the box |e|∞ ≤ {lower(claim.box)}"
        case kind:
            return _KINDS[kind]


def _size(claim: RegionClaim, value: float | None) -> str:
    return "any" if claim.kind == "everywhere" else lower(value)


def _covers(claim: RegionClaim, regions: Regions) -> str:
    if regions.asked is None:
        return "–"
    return "yes" if claim.covers else "no"


def _no_limit(claim: RegionClaim) -> str:
    if claim.kind == "everywhere":
        return "There is none: it holds for every start."
    return "It covers what was asked for; more was not tried." if claim.covers else "–"


def lower(value: float | Fraction | None) -> str:
    """A certified size or rate, cut towards zero."""
    return typeset(significant_towards_zero(value))


def upper(value: float) -> str:
    """A certified time, rounded up to four digits."""
    return typeset(significant_away_from_zero(value))


def asked_sentence(regions: Regions) -> str:
    """What was asked for, as one number for boxes and one for balls."""
    if regions.asked is None:
        found = any(claim.box for claim in regions.claims)
        return "No region was asked for" + (": the largest that was found is shown." if found else ".")
    asked = regions.asked
    text = f"Asked for: every start with |e|∞ ≤ {upper(asked.box)}"
    text += f" and |εᵢ| ≤ {upper(asked.disturbance)} for every agent i" if asked.disturbance else ""
    return f"{text}. A ball covers these only if its radius is at least {upper(asked.ball)}."


def norms_sentence(problem: Problem) -> str:
    """Why a ball and a box are hard to compare."""
    size = problem.n * problem.m
    return (
        "|e|∞ is the largest error of all agents, |e|₂ the root of the sum of all squares. A box |e|∞ ≤ R holds the"
        f" ball |e|₂ ≤ R. A ball |e|₂ ≤ R holds only the box |e|∞ ≤ R/√{size}, where all {size} components may be off"
        " at once."
    )


def time_head(regions: Regions) -> str:
    """The head of the column of times."""
    return "settled after" if regions.tolerance is None else f"|e|∞ ≤ {lower(regions.tolerance)} after"


def timing_sentences(regions: Regions) -> list[str]:
    """What the proof says about the time it takes, about late messages and about sampling."""
    settling, sentences = regions.settling, list[str]()
    if settling is not None and settling.verdict is not Verdict.PROVED:  # a proved one is told stage by stage
        sentences.append(f"Settling: {settling.reason}")
    for check, words in ((regions.delay, _delay), (regions.sampling, _sampling)):
        if check is not None:
            proved = check.verdict is Verdict.PROVED
            sentences.append(words(check) if proved else f"{capitalize_first(check.id)}: {check.reason}")
    return sentences


def rest_sentence(regions: Regions) -> str | None:
    """Where else the agents may come to rest."""
    if regions.equilibrium is None or regions.rest is None:
        return None
    return f"There is another equilibrium, at |e|∞ ≈ {regions.rest:.4g}. No proof of consensus can reach it."


def _delay(check: Check) -> str:
    late = _exact(check, "delay")
    text = (
        "Information may be late by any bounded time: from every start in the max-separable box the agents still reach"
    )
    text += " the target."
    if late and check.rate:
        text += f" Late by up to {lower(late)} s, the error still decays at every rate below {lower(check.rate)} 1/s."
    return text


def _sampling(check: Check) -> str:
    period, factor = _exact(check, "period"), _exact(check, "factor")
    text = f"With couplings and pinning measured and held every {lower(period)} s, the proof still holds"
    if factor < 1:
        text += f": the largest weighted error falls by at least {lower(100 * (1 - factor))} % a sample"
        disturbed = isinstance(check.domain, Mapping) and check.domain.get("disturbance")
        text += ", up to what the estimation error adds." if disturbed else "."
    if 0 < period * _FAST < 1:
        text += (
            " That is short because the coupling is steep between agents that are far apart, and the bound holds for"
            " all of the region; closer to the target longer periods work."
        )
    return text


def _exact(check: Check, key: str) -> Fraction:
    return Fraction(str((check.exact or {}).get(key, "0")))


def agents_sentence(regions: Regions, *, drawn: int | None = None) -> str:
    """What the picture of single agents shows; ``drawn``: how many of them, if not all."""
    bounds = [agent.bound for agent in regions.agents]
    text = (
        "By the max-separable certificate every agent may start anywhere in its bar, all of them at once:"
        f" |eᵢ| may be up to {_between(lower(min(bounds)), lower(max(bounds)))}."
    )
    return text if drawn is None else f"{text} {drawn} of {len(bounds)} agents are drawn."


def _between(least: str, most: str) -> str:
    return least if least == most else f"{least}, for some agents up to {most}"


STAGE_HEADS: Final = (
    "stage",
    "certificate",
    "from t =",
    "level V ≤",
    "so |e|∞ ≤",
    "rate in 1/s",
    "held for",
    "late by",
)
NONE: Final = "–"
_STAGES: Final = {False: "max-separable", True: "quadratic"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRow:
    """One stage, ready to be shown; everything is plain text."""

    number: str
    kind: str
    start: str
    level: str
    bound: str
    rate: str
    held: str
    late: str

    @property
    def cells(self) -> tuple[str, ...]:
        """In the order of STAGE_HEADS."""
        return (self.number, self.kind, self.start, self.level, self.bound, self.rate, self.held, self.late)


def stage_rows(settling: Settling, timings: Sequence[StageTiming]) -> list[StageRow]:
    """The stages in the order in which they take over; ``timings``: one per stage, or none at all."""
    timings = timings or [StageTiming()] * len(settling.stages)
    return [
        StageRow(
            number=str(place + 1),
            kind=_STAGES[stage.is_quadratic],
            start=f"{upper(float_above(stage.start))} s",
            level=upper(float_above(stage.level)),
            bound=upper(float_above(stage.level * stage.height)),
            rate=lower(float_below(stage_rate(stage.certificate))),
            held=NONE if timing.sampling is None else f"{lower(timing.sampling.period)} s",
            late=NONE if timing.delay is None else f"{lower(timing.delay.delay)} s",
        )
        for place, (stage, timing) in enumerate(zip(settling.stages, timings, strict=True))
    ]


def settling_section(
    settling: Settling | None, timings: Sequence[StageTiming], pictures: tuple[doc.Picture, ...]
) -> Iterator[doc.Section]:
    """The proved settling time, stage by stage; nothing without one."""
    view = settling_view(settling, timings)
    if view is None:
        return
    sentence, stages = view["sentence"], view["stages"]
    columns = tuple(
        doc.Column(head=head, style="number" if place > 1 else "plain") for place, head in enumerate(STAGE_HEADS)
    )
    yield doc.Section(
        name="settling",
        title="How fast it is proved to settle",
        short="Settling",
        blocks=(
            doc.Only(("markdown",), (doc.Text(f"{sentence} {stages}"),)),
            doc.Only(doc.PAGES, (doc.Text(sentence), doc.Pictures(pictures), doc.Text(stages))),
            doc.Table(
                caption="Stages of the certified settling time",
                columns=columns,
                rows=tuple(row.cells for row in view["rows"]),
            ),
            *((doc.Text(view["timing"], "caption"),) if view["timing"] else ()),
        ),
    )


def settling_view(settling: Settling | None, timings: Sequence[StageTiming]) -> dict[str, Any] | None:
    """What the page and the Markdown text show; None without a proved settling time."""
    if settling is None or settling.time is None:
        return None
    return {
        "heads": STAGE_HEADS,
        "rows": stage_rows(settling, timings),
        "sentence": settling_sentence(settling),
        "stages": _stages_sentence(settling),
        "timing": timing_sentence(timings),
    }


def settling_sentence(settling: Settling) -> str:
    """The whole claim; a time is never shown shorter than it is, nor the box of starts larger."""
    errors = f" and |εᵢ| ≤ {lower(settling.disturbance)} for every i" if settling.disturbance else ""
    count = len(settling.stages)
    return (
        f"From every start with |e|∞ ≤ {lower(settling.radius)}{errors} it is proved that |e(t)|∞ ≤"
        f" {upper(float_above(settling.tolerance))} for all t ≥ {upper(settling.time or 0.0)} s,"
        f" {'by one certificate' if count == 1 else f'by {count} certificates in turn'}."
    )


def _stages_sentence(settling: Settling) -> str:
    if len(settling.stages) == 1:
        return "One certificate serves all the way."
    return (
        "Each stage is a certificate of its own. It takes over at the time given, when the one before has brought the"
        " error so far down that this is inside its own region; every bound goes on to hold afterwards."
    )


def timing_sentence(timings: Sequence[StageTiming]) -> str | None:
    """What the last two columns mean, and how far they are proved; None where nothing is said."""
    if not any(timing.sampling or timing.delay for timing in timings):
        return None
    return (
        "Held for: couplings and pinning may be held so long between samples while the error is in that stage’s box."
        " Late by: messages may be late by so much, and half of that stage’s rate is left. Both hold for a loop that is"
        " in the box and were decided exactly when this was written; the certificate holds them for its whole region"
        " only. Quadratic stages say nothing about either."
    )


def envelope_alt(settling: Settling) -> str:
    """The picture of the envelope in words."""
    time = settling.time
    return (
        f"Certified bound of |e|∞ over time: from {upper(float(settling.envelope(0.0)))} down to"
        f" {lower(settling.tolerance)} at {'–' if time is None else upper(time)} s, in {len(settling.stages)} stage(s)."
    )
