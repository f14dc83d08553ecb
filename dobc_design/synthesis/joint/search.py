"""The joint design: a request decided, and where it is not possible, the nearest request that is; trade-offs of both.

The order is that of the cost: facts of exosystem and graph, rates that no gains reach, the observer, then pins and
gains for the region asked for, or near the consensus where none is.  Whatever is proposed is rounded and certified.
Then what is given up first is what the refutation names; how far is found by designing without that limit and reading
off what the design reaches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import islice, pairwise
from typing import Any

from dobc_design.certification.certify import certify
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.statement import Statement
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import counted, shown
from dobc_design.problem.changes import changed_problem, gain_changes, typed_number
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint.claim import AXES, Design, DesignRequest, TradeOff, TradePoint
from dobc_design.synthesis.joint.propose import (
    HALF,
    Ground,
    Progress,
    Proposal,
    observer_at,
    of_consensus,
    of_region,
    pin_sets,
    region_search,
)
from dobc_design.synthesis.observer.claim import ObserverDesign
from dobc_design.synthesis.observer.decide import reduced_exosystem
from dobc_design.synthesis.pinning.decide import structural_obstacle, structure_of, too_fast
from dobc_design.synthesis.pinning.propose import slow_directions
from dobc_design.synthesis.pinning.search import with_lacking
from dobc_design.verdict import Verdict

NEARLY = 0.98  # of the rate that is aimed at: a proof with less is looked for again
NEAREST = Fraction(9, 10)  # of the fastest rate, where the one asked for cannot be had; more takes very large gains
MOST_TRIES = 4  # proposals that are certified
SLOWEST, QUICKEST = 0.25, 4.0  # rates of a curve, of the design's own or of its observer's
FASTEST = 1.9  # of a design that aims at half of the fastest rate


def search_design(problem: Problem, request: DesignRequest, progress: Progress) -> Design:
    """Decide a request; one that is refuted or undecided comes with the nearest one that was proved possible."""
    found = _attempt(problem, request, progress)
    if found.verdict is Verdict.PROVED:
        return found
    for weaker, part in _weaker(problem, request, found):
        progress("looking for the nearest possible request")
        nearest = _attempt(problem, weaker, progress, part=part)
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=_tightened(request, nearest))
    return found


def _attempt(problem: Problem, request: DesignRequest, progress: Progress, *, part: Fraction = HALF) -> Design:
    """Decide one request: PROVED with a certificate, REFUTED with a statement, or UNDECIDED with the reason."""
    progress("looking for what is impossible")
    changes, decisions, obstacle = reduced_exosystem(problem, reduce=request.reduce)
    bare = changed_problem(problem, {"pinning.gains": None, **changes})
    if bare.groups:
        bare = changed_problem(bare, gain_changes(bare, None))
    structure = structure_of(bare, request.allowed)
    ground = Ground(
        problem=bare,
        request=request,
        progress=progress,
        changes=changes,
        decisions=decisions,
        structure=structure,
        part=part,
        observers=[],
    )
    obstacle = obstacle or structural_obstacle(bare, request.pins, structure)
    if obstacle is None and request.rate is not None:
        limits: dict[str, Any] = {"allowed": request.allowed, "caps": request.caps, "pins": request.pins}
        obstacle = too_fast(bare, request.rate, **limits, propose=slow_directions)
    if obstacle is not None:
        statements = (obstacle,) if obstacle.verdict is Verdict.REFUTED else ()
        return _without_gains(ground, obstacle.verdict, obstacle.text, *statements)
    observer = next(ground.every_observer())
    if observer is not None and observer.verdict is Verdict.REFUTED:
        first = observer.statements[0]
        return _without_gains(ground, Verdict.REFUTED, first.text, first, observer=observer)
    if observer is not None and observer.W is None:
        none = "no observer gain was found that does what was asked, and no proof that there is none."
        return _without_gains(ground, Verdict.UNDECIDED, none)
    return _searched(ground, of_region(ground) if bare.region is not None else of_consensus(ground))


def _without_gains(
    ground: Ground, verdict: Verdict, reason: str, *statements: Statement, observer: ObserverDesign | None = None
) -> Design:
    return Design(
        verdict=verdict,
        reason=reason,
        request=ground.request,
        labels=ground.problem.network.labels,
        gains={},
        changes={},
        statements=statements,
        observer=observer,
    )


def _searched(ground: Ground, proposals: Iterator[Proposal]) -> Design:
    """The first proposal that is certified for what the problem asks; else how far the best of them came."""
    reason, tries = "", 0
    for proposal in islice(proposals, MOST_TRIES):
        design = _certified(ground, proposal)
        if design.verdict is Verdict.PROVED:
            return design
        reason, tries = design.reason, tries + 1
    text = f"{counted(tries, 'design')} were tried, none was proved to do; the last: {reason}"
    if not tries:
        rate = ground.request.rate
        asked = "" if rate is None else f" at {typed_number(rate)} 1/s"
        what = "the region asked for" if ground.problem.region is not None else "the consensus"
        text = (
            f"no gains on the allowed agents were found that a proof of {what} reaches{asked}, and no proof that there"
            " are none."
        )
    return _without_gains(ground, Verdict.UNDECIDED, text)


def _certified(ground: Ground, proposal: Proposal) -> Design:
    problem, request = ground.problem, ground.request
    labels = problem.network.labels
    gains = {labels[i]: k for i, k in sorted(proposal.gains.items())}
    W: Matrix | None = None if proposal.observer is None else proposal.observer.W
    wanted: dict[str, Any] = {"pinning.gains": {label: typed_number(k) for label, k in gains.items()}}
    if W is not None:
        wanted |= gain_changes(problem, W)
    changes, designed = {**ground.changes, **wanted}, changed_problem(problem, wanted)
    ground.progress("certifying the design")
    proof, whole = certify(designed), ""
    hoped = proposal.aim * NEARLY if request.rate is not None or ground.part > HALF else 0.0
    if proof.verdict is Verdict.PROVED and (proof.rate or 0.0) < hoped and designed.is_linear and designed.region:
        proof = certify(designed, everything=True)  # a proof of every start came first, with a lower rate
        whole = " That rate is proved when every condition is run (dobc certify --all)."
    slow = request.rate is not None and (proof.rate is None or claimed(proof.rate) < request.rate)
    verdict = Verdict.PROVED if proof.verdict is Verdict.PROVED and not slow else Verdict.UNDECIDED
    reason = proof.reason
    if proof.verdict is Verdict.PROVED and slow and request.rate is not None:
        reason = f"the rate proved is {proof.rate or 0:.4g} 1/s, {typed_number(request.rate)} was asked for."
    by = f"Proved by: {proof.covered_by}." if proof.covered_by else "Proved by: nothing yet."
    return Design(
        verdict=verdict,
        reason=reason,
        request=request,
        labels=labels,
        W=W,
        P=proof.claims.P,
        gains=gains,
        rate=proof.rate,
        cost=sum(gains.values(), Fraction(0)),
        decisions=(*proposal.decisions, by + whole),
        prices=proposal.prices,
        changes=changes,
        problem=designed,
        certificate=proof,
        observer=proposal.observer,
    )


def _weaker(problem: Problem, request: DesignRequest, found: Design) -> Iterator[tuple[DesignRequest, Fraction]]:
    """Requests with one limit given up, the binding one first; then a rate as near as possible."""
    kind = found.statements[0].kind if found.statements else None
    slower = None if request.rate is None else replace(request, rate=None)
    if kind == "detectable":
        yield replace(request, reduce=True), HALF
        return
    if kind == "structure":
        request = replace(request, allowed=with_lacking(problem, request.allowed))
        yield request, HALF
        yield replace(request, pins=None), HALF
        return
    if kind in ("gain", "noise"):
        other = None if found.observer is None else found.observer.nearest
        yield replace(request, noise=() if other is None else other.request.noise), HALF
    elif kind == "pins" or (kind is None and slower is None and request.pins is not None):
        yield replace(request, pins=None), HALF
    elif kind == "max_gain":
        yield replace(request, caps={}), HALF
    if slower is not None:
        yield slower, NEAREST
    for name, weaker in (
        ("pins", replace(request, pins=None)),
        ("caps", replace(request, caps={})),
        ("allowed", replace(request, allowed=tuple(range(problem.n)))),
        ("noise", replace(request, noise=())),
    ):
        if getattr(weaker, name) != getattr(request, name):
            yield weaker, HALF


def _tightened(asked: DesignRequest, found: Design) -> Design:
    """The design with its request restored as far as it keeps it: limits given up become what it reaches."""
    request = found.request
    if asked.rate is not None and request.rate is None and found.rate:
        request = replace(request, rate=claimed(shorten(found.rate, digits=3)))
    if asked.pins is not None and request.pins is None:
        request = replace(request, pins=max(asked.pins, len(found.gains)))
    if asked.caps and not request.caps and found.problem is not None:
        index = found.problem.network.index
        reached = {index[label]: k for label, k in found.gains.items()}
        if len(set(asked.caps.values())) == 1:  # one cap for all was asked for, so one for all is the answer
            reached = dict.fromkeys(asked.caps, max(reached.values()))
        request = replace(request, caps={i: max(cap, reached.get(i, cap)) for i, cap in asked.caps.items()})
    return replace(found, request=request)


def trade_off_of(
    problem: Problem, request: DesignRequest, curve: str, *, design: Design | None, points: object, progress: Progress
) -> TradeOff:
    """The curve of that name.  Raises: SpecError for another name or number of points, and where there is no curve."""
    if curve not in AXES:
        raise SpecError(
            f"curve must be one of {', '.join(AXES)}; got {shown(curve)}.",
            key="curve",
            cure='"gain" is the sum of the gains against the rate.',
        )
    if isinstance(points, bool) or not isinstance(points, int) or not 2 <= points <= 200:
        raise SpecError(
            f"points must be an integer from 2 to 200; got {shown(points)}.",
            key="points",
            cure="Ten are a good choice.",
        )
    if curve == "noise" and not problem.groups:
        raise SpecError(
            "the noise curve needs an exosystem: without one there is no observer.",
            key="curve",
            cure='Ask for "gain" or "pins".',
        )
    bare = changed_problem(problem, {"pinning.gains": None})
    own = design
    if own is None and curve == "gain":
        own = _attempt(bare, request, progress)
    observer = None if own is None else own.observer
    if observer is None and bare.groups:
        observer = observer_at(bare, request, None)
    said: Sequence[str] = ()
    if curve == "gain" and own is not None:
        found, said = _gain_points(bare, request, own, points, progress), own.prices if own.gains else (own.reason,)
    elif curve == "pins":
        found = _pin_points(bare, request, observer, points, progress)
        said = _largest_step(found)
    else:
        middle = 1.0 if observer is None else observer.measures.get("rate", 1.0)
        rates = _spread(middle, SLOWEST, QUICKEST, points)
        found = sorted((p for r in rates for p in _noise_point(observer_at(bare, request, r))), key=lambda p: p.x)
    chosen: TradePoint | None = None
    if design is not None and curve == "noise" and observer is not None:
        chosen = next(iter(_noise_point(observer)), None)
    elif design is not None and design.rate and design.cost is not None:
        x, y = (design.rate, float(design.cost)) if curve == "gain" else (float(len(design.gains)), design.rate)
        chosen = TradePoint(x=x, y=y, pinned=tuple(design.gains), proved=True)
    return TradeOff(name=problem.name, curve=curve, points=tuple(found), chosen=chosen, sensitivity=tuple(said))


def _gain_points(
    problem: Problem, request: DesignRequest, own: Design, points: int, progress: Progress
) -> list[TradePoint]:
    """Designs for many rates, all with the pins of one."""
    index = problem.network.index
    pinned = tuple(sorted(index[label] for label in own.gains)) or request.allowed
    found: list[TradePoint] = []
    for rate in _spread(own.rate or 0.0, SLOWEST, FASTEST, points):
        each = _attempt(problem, replace(request, rate=rate, allowed=pinned), progress)
        if each.verdict is Verdict.PROVED and each.cost is not None:
            found.append(TradePoint(x=float(rate), y=float(each.cost), pinned=tuple(each.gains), proved=True))
    return found


def _pin_points(
    problem: Problem, request: DesignRequest, observer: ObserverDesign | None, points: int, progress: Progress
) -> list[TradePoint]:
    """The rate that gains approach on growing sets of agents, as floating point sees it."""
    structure, labels = structure_of(problem, request.allowed), problem.network.labels
    if structure.unmet is not None:
        raise SpecError(
            "allowed must leave every group that listens to nobody outside an agent to pin.",
            key="allowed",
            cure="dobc_design.design says which agents are missing.",
        )
    search = region_search(problem, observer)
    most = min(len(request.allowed) if request.pins is None else request.pins, len(structure.agents) + points - 1)
    found: list[TradePoint] = []
    for pinned in pin_sets(structure, request.allowed, search=search, caps=request.caps, most=most, one_by_one=True):
        progress(f"{len(pinned)} pinned agents")
        rate = search.fastest(pinned, request.caps)
        if 0 < rate < math.inf:
            found.append(TradePoint(x=float(len(pinned)), y=rate, pinned=tuple(labels[i] for i in pinned)))
    return found


def _largest_step(points: Sequence[TradePoint]) -> list[str]:
    """Which further pin buys most."""
    if len(points) < 2:
        return []
    before, after = max(pairwise(points), key=lambda step: step[1].y / step[0].y)
    new = ", ".join(label for label in after.pinned if label not in before.pinned)
    return [
        f"The step that buys most: from {before.x:g} to {after.x:g} pins, with agent {new} the rate grows"
        f" {after.y / before.y:.3g} times."
    ]


def _noise_point(observer: ObserverDesign) -> list[TradePoint]:
    noise, pace = observer.measures.get("hinf measurement"), observer.measures.get("rate")
    return [] if noise is None or pace is None else [TradePoint(x=pace, y=noise, proved=True)]


def _spread(middle: float, first: float, last: float, count: int) -> list[Fraction]:
    """Rates (1/s) of four digits around one; none around 0."""
    parts = (first + (last - first) * k / (count - 1) for k in range(count))
    return [claimed(float(f"{middle * part:.4g}")) for part in parts] if middle > 0 else []
