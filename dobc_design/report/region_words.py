"""Certified regions, settling times and searches for counterexamples in words and tables, for
report and terminal.

Handed over by whoever has proved or found them; nothing is computed but what a number needs to be
shown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import zip_longest
from typing import Final

from dobc_design._show.text import lower, upper
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.check import Check
from dobc_design.conditions.numbers import read_rational
from dobc_design.conditions.schedule.decide import Settling
from dobc_design.exact.number import float_above, float_below
from dobc_design.falsification.suspect import LEAVES, RESTS, STAYS_AWAY, Falsification, Suspect
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report.words import TEXTS, mark_of, names_in_words, number, sentence
from dobc_design.verdict import Verdict

NONE: Final = "–"
MOST_SUSPECTS: Final = 8
MOST_STATES: Final = 6  # agents whose states a sentence tells
_SEVERAL: Final = 3  # modes that are named
_FAST: Final = 100  # samples a second from which a certified period is called pessimistic
WARNING: Final[str] = TEXTS["fixed"]["suspects"]
_WHAT: Final = {
    STAYS_AWAY: "does not converge",
    LEAVES: "leaves the certified set",
    RESTS: "rests there (proved)",
}


def region_section(
    problem: Problem, regions: Regions, pictures: Sequence[doc.Picture]
) -> Iterator[doc.Section]:
    """From which starts each method proves consensus; nothing where nothing is said about a
    region."""
    if not regions.tried:
        return
    asked, rest = asked_sentence(regions), rest_sentence(regions)
    norms = TEXTS["fixed"]["norms"].format(size=problem.n * problem.m)
    timing = timing_sentences(regions)
    told = (
        (doc.Section("Time, communication delay and sampling", (doc.List(timing),)),)
        if timing
        else ()
    )
    blocks = (
        doc.Text(asked),
        doc.on_pages(doc.Pictures(pictures)),
        regions_table(regions, disturbed=bool(problem.groups)),
        doc.Only(doc.READ, (doc.Text(norms, "caption"),)),
        doc.in_markdown(*((doc.Text(agents_sentence(regions)),) if regions.agents else ())),
        doc.Only(doc.READ, () if rest is None else (doc.Text(rest),)),
        doc.Only(doc.READ, told),
    )
    yield doc.Section("From which starts it is proved", blocks, "region", "Region")


def regions_table(regions: Regions, *, disturbed: bool) -> doc.Table:
    """One row per method; Markdown has sizes in columns of their own."""
    markdown: tuple[doc.Form, ...] = ("markdown",)
    settled = (
        "settled after" if regions.tolerance is None else f"|e|∞ ≤ {lower(regions.tolerance)} after"
    )
    covered = {True: "yes", False: "no"} if regions.asked is not None else {}
    return doc.table_of(
        "Certified regions, method by method",
        regions.claims,
        doc.Column("method", lambda claim: doc.Name((claim.method,), id=claim.id), 1.1),
        doc.Column("verdict", lambda claim: mark_of(claim.verdict), 0),
        doc.Column("certified", lambda claim: claim.starts, only=markdown),
        doc.Column("|e|∞ ≤", lambda claim: size_words(claim, claim.box), only=markdown),
        doc.Column("|e|₂ ≤", lambda claim: size_words(claim, claim.ball), only=markdown),
        doc.Column(
            "|εᵢ| ≤", lambda claim: lower(claim.disturbance), only=markdown if disturbed else ()
        ),
        doc.Column("certified starts", starts_words, 1.3, only=("html", "pdf", "latex")),
        doc.Column("rate in 1/s", lambda claim: lower(claim.rate), 0.8, style="number"),
        doc.Column("factor", lambda claim: upper(claim.factor), 0.8, style="number"),
        doc.Column(
            settled,
            lambda claim: NONE if claim.time is None else f"{upper(claim.time)} s",
            0.8,
            style="number",
        ),
        doc.Column("covers it", lambda claim: covered.get(claim.covers, NONE), 0.7),
        doc.Column("why not further", limit_words, 1.7, style="why", only=doc.READ),
        cards=True,
    )


def starts_words(claim: RegionClaim) -> str:
    """The certified starts in a few words."""
    errors = f", every |εᵢ| ≤ {lower(claim.disturbance)}" if claim.disturbance else ""
    if claim.kind == "box":
        return f"box |e|∞ ≤ {lower(claim.box)}{errors}"
    if claim.kind == "ball":
        return (
            f"ball |e|₂ ≤ {lower(claim.ball)}{errors}; it holds the box |e|∞ ≤ {lower(claim.box)}"
        )
    return claim.starts


def size_words(claim: RegionClaim, value: float | None) -> str:
    """A certified size."""
    return "any" if claim.kind == "everywhere" else lower(value)


def limit_words(claim: RegionClaim) -> str:
    """Why no more is certified."""
    if claim.limit or claim.kind != "everywhere":
        none = "It covers what was asked for; more was not tried." if claim.covers else NONE
        return sentence(claim.limit) or none
    return "No limit: it holds for every start."


def asked_sentence(regions: Regions) -> str:
    """What was asked for, as one number for boxes and one for balls."""
    asked = regions.asked
    if asked is None:
        found = any(claim.box for claim in regions.claims)
        return "No region was asked for" + (
            ": the largest that was found is shown." if found else "."
        )
    errors = (
        f" and |εᵢ| ≤ {upper(asked.disturbance)} for every agent i" if asked.disturbance else ""
    )
    text = f"Asked for: every start with |e|∞ ≤ {upper(asked.box)}{errors}."
    return f"{text} A ball covers these only if its radius is at least {upper(asked.ball)}."


def timing_sentences(regions: Regions) -> list[str]:
    """What the proof says about the time it takes, about communication delays and about
    sampling."""
    settling, sentences = regions.settling, list[str]()
    # a proved one is told stage by stage
    if settling is not None and settling.verdict is not Verdict.PROVED:
        sentences.append(sentence(f"Settling: {settling.reason}"))
    for check, words in ((regions.delay, _delay), (regions.sampling, _sampling)):
        if check is not None:
            proved = check.verdict is Verdict.PROVED
            sentences.append(words(check) if proved else sentence(f"{check.id}: {check.reason}"))
    return sentences


def _delay(check: Check) -> str:
    late, text = _exact(check, "delay"), str(TEXTS["fixed"]["late"])
    if late and check.rate:
        text += (
            f" For delays up to {lower(late)} s the error decays at every rate below "
            f"{lower(check.rate)} 1/s."
        )
    return text


def _sampling(check: Check) -> str:
    period, factor = _exact(check, "period"), _exact(check, "factor")
    text = (
        f"With couplings and pinning measured and held every {lower(period)} s, the proof "
        "still holds"
    )
    if factor < 1:
        text += (
            f": the largest weighted error falls by at least {lower(100 * (1 - factor))} % a sample"
        )
        disturbed = isinstance(check.domain, Mapping) and check.domain.get("disturbance")
        text += ", up to what the estimation error adds." if disturbed else "."
    if 0 < period * _FAST < 1:
        text += TEXTS["fixed"]["short_period"]
    return text


def _exact(check: Check, key: str) -> Fraction:
    return read_rational((check.exact or {}).get(key, "0"))


def rest_sentence(regions: Regions) -> str | None:
    """Where else the agents may come to rest."""
    if regions.rest is None:
        return None
    return (
        f"There is another equilibrium, at |e|∞ ≈ {regions.rest:.4g}. No proof of consensus "
        "can reach it."
    )


def agents_sentence(regions: Regions, *, drawn: int | None = None) -> str:
    """What the picture of single agents shows; ``drawn``: how many of them, if not all."""
    bounds = [agent.bound for agent in regions.agents]
    least, most = lower(min(bounds)), lower(max(bounds))
    text = (
        "By the max-separable certificate each agent may start anywhere in its bar, "
        "independently of the others:"
    )
    text += (
        " |eᵢ| may be up to "
        f"{least if least == most else f'{least}, for some agents up to {most}'}."
    )
    return text if drawn is None else f"{text} {drawn} of {len(bounds)} agents are drawn."


def settling_section(
    settling: Settling | None, pictures: Sequence[doc.Picture]
) -> Iterator[doc.Section]:
    """The proved settling time, and what proves it from when on; nothing without one."""
    if settling is None or settling.time is None:
        return
    how = "One certificate covers the whole time."
    if len(settling.stages) > 1:
        how = TEXTS["fixed"]["moving_box"]
    pictured = doc.on_pages(doc.Pictures(pictures))
    blocks = (
        doc.Text(settling_sentence(settling)),
        pictured,
        doc.Text(how),
        stages_table(settling),
    )
    yield doc.Section("How fast it is proved to settle", blocks, "settling", "Settling")


def stages_table(settling: Settling) -> doc.Table:
    """What proves the settling time, in the order in which it takes over."""
    return doc.table_of(
        "What proves the settling time",
        settling.stages,
        doc.Column("proof", lambda stage: stage.kind),
        doc.Column(
            "from t =", lambda stage: f"{upper(float_above(stage.start))} s", style="number"
        ),
        doc.Column("where |e|∞ ≤", lambda stage: upper(float_above(stage.bound)), style="number"),
        doc.Column(
            "rate in 1/s",
            lambda stage: NONE if stage.rate is None else lower(float_below(stage.rate)),
            style="number",
        ),
    )


def settling_sentence(settling: Settling) -> str:
    """The whole claim; a time is never shown shorter than it is, nor the box of starts larger."""
    errors = (
        f" and |εᵢ| ≤ {lower(settling.disturbance)} for every i" if settling.disturbance else ""
    )
    starts = (
        f"rom every start with |e|∞ ≤ {lower(settling.radius)}{errors} it is proved that |e(t)|∞ ≤"
    )
    text = f"F{starts}" if settling.guarantee is None else f"For {settling.guarantee}, f{starts}"
    text += (
        f" {upper(float_above(settling.tolerance))} for all t ≥ {upper(settling.time or 0.0)} s,"
    )
    alone = len(settling.stages) == 1
    return f"{text} {'by one certificate' if alone else 'by a moving box and a certificate'}."


def envelope_alt(settling: Settling) -> str:
    """The picture of the envelope in words."""
    text = f"Certified bound of |e|∞ over time: from {upper(float(settling.envelope(0.0)))} down to"
    return text + f" {lower(settling.tolerance)} at {upper(settling.time)} s."


def search_sections(
    searches: Sequence[Falsification], pictures: Sequence[doc.Picture | None] = ()
) -> tuple[doc.Section, ...]:
    """One section for each search: what was tried and found, what is proved, the worst suspects, a
    warning, notes."""
    sections = []
    for search, picture in zip_longest(searches, pictures):
        proved, suspects = equilibrium_sentences(search), suspects_table(search)
        warned = any(each.kind != RESTS for each in search.suspects)
        blocks = (
            doc.Text(f"{_tried(search)} {found_sentence(search)}"),
            *((doc.List(proved),) if proved else ()),
            *((doc.on_pages(doc.Pictures((picture,))),) if picture is not None else ()),
            *((suspects,) if suspects.rows else ()),
            *((doc.Text(WARNING, "warning"),) if warned else ()),
            *map(doc.Text, search.notes),
        )
        sections.append(doc.Section(f"Search: {search.target}", blocks))
    return tuple(sections)


def _tried(search: Falsification) -> str:
    """How much was looked at."""
    where = search.target.replace("|e|_inf", "|e|∞").replace("<=", "≤")
    return (
        f"{search.tried} starts from {where} were simulated for {number(search.horizon)} s (seed"
        f" {search.seed}): corners, edges, random ones, and the worst of them, moved along "
        "the gradient."
    )


def found_sentence(search: Falsification) -> str:
    """What came out, in one sentence."""
    runs = sum(each.kind != RESTS for each in search.suspects)
    if runs:
        return f"{runs} suspect{'s' if runs > 1 else ''} remained."
    if search.proved:
        return "The only suspects are runs that rest at another equilibrium."
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
        place = ""
        if resting is not None:
            shown = [", ".join(map(number, row)) for row in resting.start[:MOST_STATES].tolist()]
            place = f", x = ({'; '.join(shown)}{', …' if len(resting.start) > MOST_STATES else ''})"
        told.append(
            f"Proved: in mode {claim.mode} the agents may also rest at |e|∞ ≈ "
            f"{number(size)}{place}."
        )
    if told:
        told.append("No proof of consensus can include it, and none in this certificate does.")
        if search.check is not None:
            told.append(
                "The region asked for contains such an equilibrium and is therefore refuted."
            )
    return told


def suspects_table(search: Falsification) -> doc.Table:
    """The worst suspects first, at most eight."""
    return doc.table_of(
        "Suspects",
        search.suspects[:MOST_SUSPECTS],
        doc.Column("what", lambda each: _WHAT[each.kind]),
        doc.Column("|e|∞ at the start", lambda each: number(float(each.error[0]))),
        doc.Column(
            "|e|∞ at the end",
            lambda each: "unbounded" if math.isinf(each.final_error) else number(each.final_error),
        ),
        doc.Column("after", lambda each: f"{number(float(each.times[-1]))} s"),
        doc.Column("farthest from the target", lambda each: names_in_words(list(each.labels), 6)),
        doc.Column("mode", _modes),
    )


def _modes(suspect: Suspect) -> str:
    names = list(dict.fromkeys(name for _, name in suspect.modes))
    return ", ".join(names) if len(names) <= _SEVERAL else f"{len(names)} modes in turn"


def search_alt(search: Falsification) -> str:
    """The picture of a search in words."""
    shown = search.suspects[:MOST_SUSPECTS]
    told = "; ".join(
        f"{_WHAT[each.kind]}, from {number(float(each.error[0]))} to"
        f" {'infinity' if math.isinf(each.final_error) else number(each.final_error)}"
        for each in shown
    )
    return f"Largest error over time of {len(shown)} run(s): {told}."
