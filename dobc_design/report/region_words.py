"""Certified regions in words and rows, for the page, the Markdown text and the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_UP, Context, Decimal
from fractions import Fraction
from typing import Any

from dobc_design._show.text import significant_towards_zero
from dobc_design.certificate.regions import RegionClaim, Regions
from dobc_design.conditions.check import Check
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem.problem import Problem
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


def region_view(problem: Problem, regions: Regions) -> dict[str, Any] | None:
    """What the page and the Markdown text show; None where nothing is said about a region."""
    if not regions.tried:
        return None
    return {
        "rows": region_rows(regions),
        "asked": asked_sentence(regions),
        "norms": norms_sentence(problem),
        "time_head": time_head(regions),
        "disturbed": bool(problem.groups),
        "timing": timing_sentences(regions),
        "rest": rest_sentence(regions),
        "agents": agents_sentence(regions) if regions.agents else None,
    }


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
    shown = Context(prec=4, rounding=ROUND_UP).plus(Decimal(repr(value)))
    return typeset(f"{float(shown):.4g}")


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
