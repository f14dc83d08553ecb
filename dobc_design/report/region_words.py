"""Certified regions, settling times and searches for counterexamples in words and tables, for
report and terminal.

Handed over by whoever has proved or found them; nothing is computed but what a number needs to be
shown.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import zip_longest

from dobc_design._show.text import lower, upper, with_unit
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import Around
from dobc_design.conditions.numbers import read_rational
from dobc_design.conditions.schedule.settling import Settling, Stage
from dobc_design.exact.number import float_above, float_below
from dobc_design.exact.reading import counted
from dobc_design.falsification.suspect import LEAVES, RESTS, STAYS_AWAY, Falsification, Suspect
from dobc_design.problem.problem import Problem

from .document import (
    READ,
    Block,
    Blocks,
    Column,
    Forms,
    List,
    Name,
    Picture,
    Pictures,
    Section,
    Table,
    Text,
    in_markdown,
    on_pages,
    section,
    table_of,
    to_read,
)
from .words import FIXED, mark_of, names_in_words, number, sentence

NONE = "–"
MOST_SUSPECTS = 8
MOST_STATES = 6  # agents whose states a sentence tells
_SEVERAL = 3  # modes that are named
_FAST = 100  # samples a second from which a certified period is called pessimistic
WARNING: str = FIXED["suspects"]
_WHAT = {
    STAYS_AWAY: "does not converge",
    LEAVES: "leaves the certified set",
    RESTS: "rests there (proved)",
}


@section("From which starts it is proved", "region", "Region")
def region_section(
    size: int, problem: Problem, regions: Regions, pictures: Sequence[Picture]
) -> Blocks:
    """From which starts each method proves consensus, ``size`` being the number of errors; nothing
    where nothing is said about a region."""
    if not regions.tried:
        return
    norms = FIXED["norms"].format(size=size)
    yield Text(asked_sentence(regions))
    yield on_pages(Pictures(pictures))
    yield regions_table(regions, disturbed=bool(problem.groups))
    yield to_read(Text(norms, "caption"))
    if regions.agents:
        yield in_markdown(Text(agents_sentence(regions)))
    rest = rest_sentence(regions)
    if rest is not None:
        yield to_read(Text(rest))
    timing = timing_sentences(regions)
    if timing:
        told = Section("Time, communication delay and sampling", (List(timing),))
        yield to_read(told)


def regions_table(regions: Regions, *, disturbed: bool) -> Table:
    """One row per method; Markdown has sizes in columns of their own."""
    # Text can be searched for one number; a page has one column of words instead.
    markdown: Forms = ("markdown",)
    settled, unit = "settled after", regions.unit
    if regions.tolerance is not None:
        size = "" if regions.agree else "|e|∞ "  # too long on a phone
        settled = f"{size}≤ {lower(regions.tolerance, unit)} after"

    def covers(claim: RegionClaim) -> str:
        if regions.asked is None:
            return NONE
        return "yes" if claim.covers else "no"

    return table_of(
        "Certified regions, method by method",
        regions.claims,
        Column("method", lambda claim: Name((claim.method,), id=claim.id), 1.1),
        Column("verdict", lambda claim: mark_of(claim.verdict), 0),
        Column("certified", lambda claim: claim.starts, only=markdown),
        Column("|e|∞ ≤", lambda claim: size_words(claim, claim.box, unit), only=markdown),
        Column("|e|₂ ≤", lambda claim: size_words(claim, claim.ball, unit), only=markdown),
        Column(
            "|εᵢ| ≤", lambda claim: lower(claim.disturbance), only=markdown if disturbed else ()
        ),
        Column(
            "certified starts",
            lambda claim: starts_words(claim, unit),
            1.3,
            only=("html", "pdf", "latex"),
        ),
        Column("rate in 1/s", lambda claim: lower(claim.rate), 0.8, style="number"),
        Column("factor", lambda claim: upper(claim.factor), 0.8, style="number"),
        Column(settled, lambda claim: _in_seconds(claim.time), 0.8, style="number"),
        Column("covers it", covers, 0.7),
        Column("why not further", limit_words, 1.7, style="why", only=READ),
        cards=True,
    )


def _in_seconds(time: float | None) -> str:
    return NONE if time is None else f"{upper(time)} s"


def starts_words(claim: RegionClaim, unit: str) -> str:
    """The certified starts in a few words."""
    errors = f", every |εᵢ| ≤ {lower(claim.disturbance)}" if claim.disturbance else ""
    box, ball = f"box |e|∞ ≤ {lower(claim.box, unit)}", f"ball |e|₂ ≤ {lower(claim.ball, unit)}"
    if claim.kind == "box":
        return f"{box}{errors}"
    if claim.kind == "ball":
        # A ball is hard to imagine in many dimensions; its box is what one agent may be off by.
        return f"{ball}{errors}; it holds the {box}"
    return claim.starts


def size_words(claim: RegionClaim, value: float | None, unit: str) -> str:
    """A certified size."""
    return "any" if claim.kind == "everywhere" else lower(value, unit)


def limit_words(claim: RegionClaim) -> str:
    """Why no more is certified."""
    if claim.limit:
        return sentence(claim.limit)
    if claim.kind == "everywhere":
        return "No limit: it holds for every start."
    return "It covers what was asked for; more was not tried." if claim.covers else NONE


def asked_sentence(regions: Regions) -> str:
    """What was asked for, as one number for boxes and one for balls, and what times mean."""
    # Everybody compares these times with the time to one percent of the verdict.
    if any(each.time and each.disturbance for each in regions.claims):
        return f"{_asked(regions)} {FIXED['with_estimation_errors']}"
    return _asked(regions)


def _asked(regions: Regions) -> str:
    asked, unit = regions.asked, regions.unit
    if asked is None:
        if any(claim.box for claim in regions.claims):
            return "No region was asked for: the largest that was found is shown."
        return "No region was asked for."
    errors = ""
    if asked.disturbance:
        errors = f" and |εᵢ| ≤ {upper(asked.disturbance)} for every agent i"
    return (
        f"Asked for: every start with |e|∞ ≤ {upper(asked.box, unit)}{errors}. A ball covers "
        f"these only if its radius is at least {upper(asked.ball, unit)}."
    )


def timing_sentences(regions: Regions) -> list[str]:
    """What the proof says about the time it takes, about communication delays and about
    sampling."""
    settling, sentences = regions.settling, list[str]()
    # a proved one is told stage by stage
    if settling is not None and not settling.is_proved:
        sentences.append(sentence(f"Settling: {settling.reason}"))
    for check, words in ((regions.delay, _delay), (regions.sampling, _sampling)):
        if check is None:
            continue
        if check.is_proved:
            sentences.append(words(check))
        else:
            sentences.append(sentence(f"{check.id}: {check.reason}"))
    return sentences


def _delay(check: Check) -> str:
    text: str = FIXED["late"]
    late = _exact(check, "delay")
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
        fall = lower(100 * (1 - factor))
        text += f": the largest weighted error falls by at least {fall} % a sample"
        disturbed = isinstance(check.domain, Around) and check.domain.disturbance
        text += ", up to what the estimation error adds." if disturbed else "."
    # A reader would take a period of microseconds for a fault.
    if 0 < period * _FAST < 1:
        text += FIXED["short_period"]
    return text


def _exact(check: Check, key: str) -> Fraction:
    """A number of a check, 0 where it has none."""
    return read_rational((check.exact or {}).get(key, "0"))


def rest_sentence(regions: Regions) -> str | None:
    """Where else the agents may come to rest."""
    if regions.rest is None:
        return None
    return (
        f"There is another equilibrium, at |e|∞ ≈ {with_unit(number(regions.rest), regions.unit)}."
        " No proof of consensus can reach it."
    )


def agents_sentence(regions: Regions, *, drawn: int | None = None) -> str:
    """What the picture of single agents shows; ``drawn``: how many of them, if not all."""
    bounds, unit = [agent.bound for agent in regions.agents], regions.unit
    reach, most = lower(min(bounds), unit), lower(max(bounds), unit)
    if reach != most:
        # in coordinates or with weights agents differ
        reach += f", for some agents up to {most}"
    text = (
        "By the max-separable certificate each agent may start anywhere in its bar, "
        f"independently of the others: |eᵢ| may be up to {reach}."
    )
    return text if drawn is None else f"{text} {drawn} of {len(bounds)} agents are drawn."


@section("How fast it is proved to settle", "settling", "Settling")
def settling_section(settling: Settling | None, pictures: Sequence[Picture]) -> Blocks:
    """The proved settling time, and what proves it from when on; nothing without one."""
    if settling is None or settling.time is None:
        return
    how = "One certificate covers the whole time."
    if len(settling.stages) > 1:
        how = FIXED["moving_box"]
    yield Text(settling_sentence(settling))
    yield on_pages(Pictures(pictures))
    yield Text(how)
    yield stages_table(settling)


def stages_table(settling: Settling) -> Table:
    """What proves the settling time, in the order in which it takes over."""

    def rate(stage: Stage) -> str:
        return NONE if stage.rate is None else lower(float_below(stage.rate))

    def bound(stage: Stage) -> str:
        return upper(float_above(stage.bound), settling.unit)

    return table_of(
        "What proves the settling time",
        settling.stages,
        Column("proof", lambda stage: stage.kind),
        Column("from t =", lambda stage: _in_seconds(float_above(stage.start)), style="number"),
        Column("where |e|∞ ≤", bound, style="number"),
        Column("rate in 1/s", rate, style="number"),
    )


def settling_sentence(settling: Settling) -> str:
    """The whole claim; a time is never shown shorter than it is, nor the box of starts larger."""
    whose = "From" if settling.guarantee is None else f"For {settling.guarantee}, from"
    errors = ""
    if settling.disturbance:
        errors = f" and |εᵢ| ≤ {lower(settling.disturbance)} for every i"
    tolerance = upper(float_above(settling.tolerance), settling.unit)
    proof = "a moving box and a certificate" if len(settling.stages) != 1 else "one certificate"
    radius = lower(settling.radius, settling.unit)
    return (
        f"{whose} every start with |e|∞ ≤ {radius}{errors} it is proved that "
        f"|e(t)|∞ ≤ {tolerance} for all t ≥ {upper(settling.time or 0.0)} s, by {proof}."
    )


def envelope_alt(settling: Settling) -> str:
    """The picture of the envelope in words."""
    first = upper(float(settling.envelope(0.0)))
    last = lower(settling.tolerance, settling.unit)
    return (
        f"Certified bound of |e|∞ over time: from {first} down to {last} at "
        f"{upper(settling.time)} s."
    )


def search_sections(
    searches: Sequence[Falsification], pictures: Sequence[Picture | None] = ()
) -> tuple[Section, ...]:
    """One section for each search; ``pictures``: one for each, where they are shown."""
    both = zip_longest(searches, pictures)
    return tuple(_search_section(search, picture) for search, picture in both)


def _search_section(search: Falsification, picture: Picture | None) -> Section:
    """What was tried and found, what is proved, the worst suspects, a warning, notes."""
    blocks: list[Block] = [Text(f"{_tried(search)} {found_sentence(search)}")]
    proved = equilibrium_sentences(search)
    if proved:
        blocks.append(List(proved))
    if picture is not None:
        blocks.append(on_pages(Pictures((picture,))))
    if search.suspects:
        blocks.append(suspects_table(search))
    if any(each.kind != RESTS for each in search.suspects):
        blocks.append(Text(WARNING, "warning"))
    blocks += [Text(note) for note in search.notes]
    return Section(f"Search: {search.target}", blocks)


def _tried(search: Falsification) -> str:
    """How much was looked at."""
    # A target is ASCII, as in the certificate.
    where = search.target.replace("|e|_inf", "|e|∞").replace("<=", "≤")
    return (
        f"{search.tried} starts from {where} were simulated for {number(search.horizon)} s (seed"
        f" {search.seed}): corners, edges and random ones."
    )


def found_sentence(search: Falsification) -> str:
    """What came out, in one sentence."""
    runs = sum(each.kind != RESTS for each in search.suspects)
    if runs:
        return f"{counted(runs, 'suspect')} remained."
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
        # The claim encloses an equilibrium; a run that rests there gives its states.
        place = "" if resting is None else f", x = ({_states(resting)})"
        told.append(
            f"Proved: in mode {claim.mode} the agents may also rest at |e|∞ ≈ "
            f"{number(size)}{place}."
        )
    if told:
        told.append("No proof of consensus can include it, and none in this certificate does.")
    if told and search.check is not None:
        told.append("The region asked for contains such an equilibrium and is therefore refuted.")
    return told


def _states(suspect: Suspect) -> str:
    """Where the first agents are."""
    rows = suspect.start[:MOST_STATES].tolist()
    shown = "; ".join(", ".join(map(number, row)) for row in rows)
    return f"{shown}, …" if len(suspect.start) > MOST_STATES else shown


def suspects_table(search: Falsification) -> Table:
    """The worst suspects first, at most eight."""
    return table_of(
        "Suspects",
        search.suspects[:MOST_SUSPECTS],
        Column("what", lambda each: _WHAT[each.kind]),
        Column("|e|∞ at the start", _first_error),
        Column("|e|∞ at the end", lambda each: _last_error(each, "unbounded")),
        Column("after", lambda each: f"{number(each.times[-1])} s"),
        Column("farthest from the target", lambda each: names_in_words(list(each.labels), 6)),
        Column("mode", _modes),
    )


def _first_error(suspect: Suspect) -> str:
    return number(suspect.error[0])


def _last_error(suspect: Suspect, unbounded: str) -> str:
    return unbounded if math.isinf(suspect.final_error) else number(suspect.final_error)


def _modes(suspect: Suspect) -> str:
    # Modes in the order in which they were on, each once.
    names = list(dict.fromkeys(name for _, name in suspect.modes))
    return ", ".join(names) if len(names) <= _SEVERAL else f"{len(names)} modes in turn"


def search_alt(search: Falsification) -> str:
    """The picture of a search in words."""
    shown = search.suspects[:MOST_SUSPECTS]
    told = [
        f"{_WHAT[each.kind]}, from {_first_error(each)} to {_last_error(each, 'infinity')}"
        for each in shown
    ]
    return f"Largest error over time of {len(shown)} run(s): {'; '.join(told)}."
