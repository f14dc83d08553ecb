"""The joint design: W, pins and gains for one request, rounded and certified; the nearest possible
one; trade-offs.

The order is that of the cost: facts of exosystem and graph, rates that no gains reach, the
observer, then pins, gains for the region asked for, or near the consensus.  Every group that
listens to nobody outside gets a pin; further pins go where the region allows the largest rate, as
the slowest direction of J + J' says of many and the rows of the region of the best few.  What is
given up first is what the refutation names; how far is read off a design without that limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cache
from itertools import chain, islice, pairwise, product
from typing import Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.certify import certify
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.pinning import fastest_rate, network_blocks
from dobc_design.conditions.coverage import Progress, asked_radius, covers
from dobc_design.conditions.numbers import claimed, shorten
from dobc_design.conditions.observer.decide import too_large
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.conditions.statement import Statement
from dobc_design.errors import SpecError
from dobc_design.exact.reading import counted, shown
from dobc_design.problem.changes import (
    changed_problem,
    gain_changes,
    typed_matrix,
    typed_number,
    value_text,
)
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.integrators import as_integrators, observed
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint import agents
from dobc_design.synthesis.joint.claim import AXES, Design, DesignRequest, TradeOff, TradePoint
from dobc_design.synthesis.observer.claim import ObserverDesign, ObserverRequest
from dobc_design.synthesis.observer.decide import reduced_exosystem
from dobc_design.synthesis.observer.search import search_groups
from dobc_design.synthesis.pinning.claim import (
    FEWEST,
    Gains,
    PinningDesign,
    PinningRequest,
    Structure,
    typed_gains,
)
from dobc_design.synthesis.pinning.decide import structure_of, too_fast
from dobc_design.synthesis.pinning.propose import slow_directions
from dobc_design.synthesis.pinning.propose_regions import RegionGains, RegionSearch
from dobc_design.synthesis.pinning.search import search_pinning, with_lacking
from dobc_design.verdict import Verdict

NEARLY = 0.98  # of the rate that is aimed at: a proof with less is looked for again
# of the fastest rate, where the one asked for cannot be had; more takes very large gains
NEAREST = Fraction(9, 10)
MOST_TRIES, MOST_QUICK = 4, 15  # proposals that are certified: over a region, near the consensus
SLOWEST, QUICKEST = 0.25, 4.0  # rates of a curve, of the design's own or of its observer's
FASTEST = 1.9  # of a design that aims at half of the fastest rate
SPEEDS = (2, 4)  # of further observers, in units of the slowest that is worth trying
MARGIN = 3  # how much faster than the rate asked the observer is to be
# faster than asked, tried in turn
PADS = (Fraction(1005, 1000), Fraction(102, 100), Fraction(11, 10), Fraction(3, 2))
# of the largest slope: a rate that every network which can do at all can do
START = Fraction(1, 10**6)
COMFORT = 0.75  # of the fastest rate: beyond, one more pin saves very large gains
# parts of the fastest rate near the consensus, where rows do not apply
FALLBACKS = (Fraction(1, 2), Fraction(9, 10))
HALF = Fraction(1, 2)  # of the fastest rate: what is aimed at where none is asked for
# of the fastest rate with any observer: slower ones are left out; where more is aimed at
ENOUGH, ALMOST = 0.6, 0.95
BY_WEIGHTS = (
    " They are chosen for the true rate near the target (V = e'De, a weight for each agent)."
)
SMALL = Fraction(1, 10**4)  # the radius of a region that is one point
# agents compared quickly in one step, by the size of the network
LOOKED_AT = ((60, 60), (400, 12), (10**9, 3))
CLOSER = 4  # of these compared by the rows of the region
EXCHANGES = 120  # quick comparisons spent on exchanges of the first set
ONE_BY_ONE = 4  # pins more than needed that are tried one by one; then twice as many each time
DECISIVE = 1.02  # rates that are closer than this do not decide
SHOWN, BUYS = 6, 3  # gains in a sentence, and agents in the one on what a further pin buys


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """One request and its problem without W and gains; without a rate, ``part`` of the fastest one
    is aimed at."""

    problem: Problem
    request: DesignRequest
    progress: Progress
    changes: Mapping[str, Any]
    decisions: tuple[str, ...]
    structure: Structure
    part: Fraction
    observers: list[ObserverDesign | None] = field(default_factory=list)

    def every_observer(self) -> Iterator[ObserverDesign | None]:
        """All gains worth trying, slow ones first (None: none is needed); the first may say why
        there is no W."""
        if not self.observers:
            self.observers.append(self._first_observer() if self.problem.groups else None)
        first = self.observers[0]
        yield first
        for place, speed in enumerate(SPEEDS, start=1):
            if first is None or first.W is None:
                return
            if place == len(self.observers):
                rate = _three_digits(_pace(first) * speed)
                self.progress("designing a faster observer")
                self.observers.append(
                    observer_at(self.problem, self.request, rate) if rate > 0 else None
                )
            faster = self.observers[place]
            if faster is None or faster.W is None:
                return
            yield faster

    def _first_observer(self) -> ObserverDesign:
        """The slowest observer worth trying: of the usual rate, or faster than the rate asked
        for."""
        self.progress("designing the observer")
        first, asked = observer_at(self.problem, self.request, None), self.request.rate
        if asked is None or first.W is None or _pace(first) >= MARGIN * asked:
            return first
        fast = observer_at(self.problem, self.request, MARGIN * asked)
        return (
            observer_at(self.problem, self.request, asked * Fraction(101, 100))
            if fast.W is None
            else fast
        )

    def pinning(
        self,
        rate: Fraction,
        agents: Sequence[int],
        pins: int | str | None = None,
        *,
        conservative: bool = False,
    ) -> PinningDesign:
        """The cheapest gains on these agents near the consensus."""
        own: dict[str, Any] = {
            "caps": self.request.caps,
            "digits": self.request.digits,
            "pins": pins,
        }
        own["conservative"] = conservative or self.request.conservative
        request = PinningRequest(
            rate=rate, allowed=tuple(agents), costs=(Fraction(1),) * self.problem.n, **own
        )
        return search_pinning(self.problem, request, self.progress)

    def nothing(
        self,
        verdict: Verdict,
        reason: str,
        *statements: Statement,
        observer: ObserverDesign | None = None,
    ) -> Design:
        found: dict[str, Any] = {
            "gains": {},
            "changes": {},
            "statements": statements,
            "observer": observer,
        }
        labels = self.problem.network.labels
        return Design(verdict=verdict, reason=reason, request=self.request, labels=labels, **found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """W and gains (1/s, rounded) on at most the ``pinned`` agents, meant for the rate ``aim``
    (1/s)."""

    observer: ObserverDesign | None
    gains: Gains
    pinned: Sequence[int]
    aim: float
    prices: tuple[str, ...]
    by: str = ""  # what proves the rate near the consensus, in words
    changes: Mapping[str, Any] = field(default_factory=dict)  # of a problem with [dynamics]


def search_design(problem: Problem, request: DesignRequest, progress: Progress) -> Design:
    """Decide a request; one that is refuted or undecided comes with the nearest one that was proved
    possible."""
    slower = list[Design]()
    found = _attempt(problem, request, progress, slower=slower)
    if found.verdict is Verdict.PROVED:
        return found
    for weaker, part in _weaker(problem, request, found):
        progress("looking for the nearest possible request")
        nearest = _attempt(problem, weaker, progress, part=part)
        if nearest.verdict is Verdict.PROVED:
            slower += [nearest]
            break
    if not slower:
        return found
    # but for the rate
    same = [each for each in slower if replace(each.request, rate=request.rate) == request]
    return replace(
        found, nearest=_tightened(request, max(same or slower, key=lambda each: each.rate or 0.0))
    )


def _attempt(
    problem: Problem,
    request: DesignRequest,
    progress: Progress,
    *,
    part: Fraction = HALF,
    slower: list[Design] | None = None,
) -> Design:
    """Decide one request; designs that are proved, but not at the rate asked for, are added to
    ``slower``."""
    progress("looking for what is impossible")
    large = next(filter(None, (too_large(group.exosystem) for group in problem.groups)), None)
    changes, decisions, obstacle = (
        ({}, (), None) if large else reduced_exosystem(problem, reduce=request.reduce)
    )
    bare = changed_problem(problem, {"pinning.gains": None, **changes})
    if bare.groups:
        bare = changed_problem(bare, gain_changes(bare, None))
    structure = structure_of(bare, request.allowed)
    own: dict[str, Any] = {
        "changes": changes,
        "decisions": decisions,
        "structure": structure,
        "part": part,
    }
    ground = Ground(problem=bare, request=request, progress=progress, **own)
    obstacle = obstacle or agents.obstacle(bare, request, structure)
    if obstacle is None and request.rate is not None and bare.dynamics is None:
        limits: dict[str, Any] = {
            "allowed": request.allowed,
            "caps": request.caps,
            "pins": request.pins,
        }
        obstacle = too_fast(bare, request.rate, **limits, propose=slow_directions)
    if obstacle is not None:
        statements = (obstacle,) if obstacle.verdict is Verdict.REFUTED else ()
        return ground.nothing(obstacle.verdict, obstacle.text, *statements)
    if large:
        return ground.nothing(Verdict.UNDECIDED, f"what an observer has to do is {large}")
    observer = next(ground.every_observer())
    if observer is not None and observer.verdict is Verdict.REFUTED:
        first = observer.statements[0]
        return ground.nothing(Verdict.REFUTED, first.text, first, observer=observer)
    if observer is not None and observer.W is None:
        none = (
            "no observer gain was found that does what was asked, and no proof that there is none."
        )
        return ground.nothing(Verdict.UNDECIDED, none)
    reason, tries, best = "", 0, None
    for proposal in islice(of_region(ground), MOST_QUICK if bare.region is None else MOST_TRIES):
        design = _certified(ground, proposal)
        if design.verdict is Verdict.PROVED and part <= HALF:
            return design
        # as fast as possible: while a faster observer still buys much
        if design.verdict is Verdict.PROVED:
            if best is not None and (design.rate or 0.0) <= DECISIVE * (best.rate or 0.0):
                break
            best = design
        reason, tries = design.reason, tries + 1
        proof = design.certificate
        if (
            slower is not None
            and proof is not None
            and proof.verdict is Verdict.PROVED
            and design.rate
        ):
            found = replace(design, verdict=Verdict.PROVED, reason=proof.reason)
            slower.append(replace(found, request=replace(request, rate=None)))
    if best is not None:
        return best
    if tries:
        text = f"{counted(tries, 'design')} were tried, and none was proved; the last: {reason}"
        return ground.nothing(Verdict.UNDECIDED, text)
    asked = "" if request.rate is None else f" at {typed_number(request.rate)} 1/s"
    what = "the consensus" if bare.region is None else "the region asked for"
    text = (
        f"no gains on the allowed agents were found for which {what} is proved{asked}, and no "
        "proof that there"
    )
    return ground.nothing(Verdict.UNDECIDED, f"{text} are none.")


def _certified(ground: Ground, proposal: Proposal) -> Design:
    problem, request = ground.problem, ground.request
    labels = problem.network.labels
    gains = {labels[i]: k for i, k in sorted(proposal.gains.items())}
    W, said = (
        (None, [])
        if proposal.observer is None
        else (proposal.observer.W, observer_words(proposal.observer))
    )
    fixed = request.pins is not None and len(proposal.pinned) >= request.pins
    said.append(pins_words(problem, ground.structure, sorted(proposal.gains), fixed=fixed))
    part = None if request.rate or problem.dynamics is not None else ground.part
    said.append(
        gains_words(problem, proposal.gains, digits=request.digits, part=part) + proposal.by
    )
    wanted: dict[str, Any] = {
        "pinning.gains": {label: typed_number(k) for label, k in gains.items()}
    }
    wanted |= proposal.changes
    if W is not None:
        wanted |= gain_changes(problem, W)
    designed = changed_problem(problem, wanted)
    ground.progress("certifying the design")
    least = (
        max(claimed(shorten(proposal.aim * NEARLY, digits=6)), request.rate or Fraction(0)) or None
    )
    proof, whole = certify(designed, rate=least, progress=ground.progress), ""
    hoped = proposal.aim * NEARLY if request.rate is not None or ground.part > HALF else 0.0
    if (
        proof.verdict is Verdict.PROVED
        and (_rate_of(proof) or 0.0) < hoped
        and designed.is_linear
        and designed.region
    ):
        # A proof of every start came first, with a lower rate.
        proof = certify(designed, rate=least, everything=True, progress=ground.progress)
        whole = " That rate is proved when every condition is run (dobc certify --all)."
    rate = _rate_of(proof)
    verdict = Verdict.PROVED if proof.verdict is Verdict.PROVED else Verdict.UNDECIDED
    reason = proof.reason
    if (
        verdict is Verdict.PROVED
        and request.rate is not None
        and claimed(rate or 0.0) < request.rate
    ):
        verdict, asked = Verdict.UNDECIDED, f"{typed_number(request.rate)} was asked for."
        reason = f"the rate proved is {rate or 0:.4g} 1/s, {asked}"
    return Design(
        verdict=verdict,
        reason=reason,
        request=request,
        labels=labels,
        W=W,
        P=proof.claims.P,
        gains=gains,
        rate=rate,
        cost=sum(gains.values(), Fraction(0)),
        decisions=(
            *ground.decisions,
            *said,
            f"Proved by: {proof.covered_by or 'nothing yet'}.{whole}",
        ),
        prices=agents.prices(designed, rate) if problem.dynamics and rate else proposal.prices,
        changes={**ground.changes, **wanted},
        problem=designed,
        certificate=proof,
        observer=proposal.observer,
    )


def _rate_of(proof: Certificate) -> float | None:
    """The largest rate (1/s) of a check that covers what is asked; the one that carries the
    verdict, with the least time to one percent, may have a smaller one."""
    if proof.rate is None:
        return None
    problem = as_integrators(proof.problem)
    covering = [each for each in proof.checks if covers(problem, each, proof.checks)]
    return max((each.rate for each in covering if each.rate is not None), default=proof.rate)


def _weaker(
    problem: Problem, request: DesignRequest, found: Design
) -> Iterator[tuple[DesignRequest, Fraction]]:
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
    without = replace(request, pins=None), replace(request, caps={}), replace(request, noise=())
    for weaker in (*without[:2], replace(request, allowed=tuple(range(problem.n))), *without[2:]):
        if weaker != request:
            yield weaker, HALF


def _tightened(asked: DesignRequest, found: Design) -> Design:
    """The design with its request restored as far as it keeps it: limits given up become what it
    reaches."""
    request = found.request
    if asked.rate is not None and request.rate is None and found.rate:
        request = replace(request, rate=claimed(shorten(found.rate, digits=3)))
    if asked.pins is not None and request.pins is None:
        request = replace(request, pins=max(asked.pins, len(found.gains)))
    if asked.caps and not request.caps:
        reached = {found.labels.index(label): k for label, k in found.gains.items()}
        # one cap for all was asked for, so one for all is the answer
        if len(set(asked.caps.values())) == 1:
            reached = dict.fromkeys(asked.caps, max(reached.values()))
        request = replace(
            request, caps={i: max(cap, reached.get(i, cap)) for i, cap in asked.caps.items()}
        )
    return replace(found, request=request)


def observer_at(problem: Problem, request: DesignRequest, rate: Fraction | None) -> ObserverDesign:
    """A W for every group within the request's bounds on noise; without a ``rate`` (1/s) for that
    of the file."""
    rate = problem.joint_observer.rate if rate is None else rate
    asked = ObserverRequest(
        rate=rate, noise=request.noise, digits=request.digits, norms=problem.dynamics is None
    )
    return search_groups(observed(problem), asked)


def _pace(observer: ObserverDesign) -> Fraction:
    return claimed(observer.measures.get("rate", 0.0))


def _three_digits(rate: Fraction) -> Fraction:
    return claimed(float(f"{float(rate):.3g}"))


def region_search(problem: Problem, observer: ObserverDesign | None) -> RegionSearch:
    """The rows of the region asked for, or next to the consensus, of a problem without gains."""
    region = problem.region
    radius = Fraction(0) if region is None else max(asked_radius(problem))
    disturbance = Fraction(0) if region is None else region.initial_disturbance or Fraction(0)
    W = None if observer is None else observer.W
    return RegionSearch(problem, W, radius=radius or SMALL, disturbance=disturbance)


def of_region(ground: Ground) -> Iterator[Proposal]:
    """Pins and gains with which max-separable rows cover the region; without one those near the
    consensus."""
    problem, request = ground.problem, ground.request
    if problem.dynamics is not None:
        yield from of_agents(ground, problem.dynamics)
        return
    if problem.region is None or not acts_by_component(problem):
        yield from of_consensus(ground)
        return
    searches: dict[int, RegionSearch] = {}

    def search_with(observer: ObserverDesign | None) -> RegionSearch:
        return searches.setdefault(id(observer), region_search(problem, observer))

    most = len(request.allowed) if request.pins is None else request.pins
    first = search_with(next(ground.every_observer()))
    for pinned in pin_sets(ground.structure, request, search=first, most=most):
        ground.progress(f"looking for gains on {counted(len(pinned), 'agent')}")
        observers = ground.every_observer()
        if request.rate is None:  # from the slowest on that does not hold the network back
            every = list(observers)
            reached = [
                search_with(each).fastest(pinned, request.caps, coarse=True) for each in every
            ]
            least = (ENOUGH if ground.part <= HALF else ALMOST) * max(reached)
            observers = iter(
                every[next(place for place, rate in enumerate(reached) if rate >= least) :]
            )
        for observer in observers:
            yield from _over_region(ground, observer, search_with(observer), pinned)


def of_agents(ground: Ground, dynamics: Dynamics) -> Iterator[Proposal]:
    """Gains, and on request the coupling, of agents with [dynamics]."""
    request = ground.request

    def networks(alone: Problem, rate: float | None, pins: Iterable[int]) -> Iterator[Gains]:
        speed = None if rate is None else claimed(shorten(rate, digits=6))
        asked = replace(
            request, rate=speed, noise=(), coupling=False, allowed=tuple(pins) or request.allowed
        )
        return (
            each.gains
            for each in of_consensus(
                replace(ground, problem=alone, request=asked, observers=[None])
            )
        )

    observer = next(ground.every_observer())
    for gains, changes in agents.designs(ground.problem, dynamics, request, networks):
        by = (
            f" Coupling: h = {value_text(changes['coupling.h'])}."
            if "coupling.h" in changes
            else ""
        )
        own: dict[str, Any] = {"gains": gains, "pinned": tuple(gains), "changes": changes, "by": by}
        yield Proposal(observer=observer, aim=0.0, prices=(), **own)


def search_agents(
    problem: Problem, request: PinningRequest, progress: Progress, *, coupling: bool
) -> PinningDesign:
    """``design_pinning`` for agents with [dynamics]: as a whole design without a disturbance."""
    own: dict[str, Any] = {
        "rate": request.rate,
        "caps": request.caps,
        "digits": request.digits,
        "reduce": False,
    }
    own |= {
        "pins": request.pins if isinstance(request.pins, int) else None,
        "noise": (),
        "coupling": coupling,
    }
    alone = problem.replace(
        exosystem=None, observer=None, groups=None, region=None, simulation=None
    )

    def read(found: Design) -> PinningDesign:
        return PinningDesign(
            verdict=found.verdict,
            request=replace(
                request, rate=found.request.rate or request.rate, allowed=found.request.allowed
            ),
            gains=found.gains,
            rate=found.request.rate if found.gains else None,
            cost=found.cost,
            prices=found.prices,
            problem=changed_problem(problem, found.changes) if found.gains else None,
            nearest=None if found.nearest is None else read(found.nearest),
            statements=found.statements,
            reason=f"{found.reason} {' '.join(found.decisions)}".strip(),
        )

    return read(search_design(alone, DesignRequest(**own, allowed=request.allowed), progress))


def _over_region(
    ground: Ground, observer: ObserverDesign | None, search: RegionSearch, pinned: Sequence[int]
) -> Iterator[Proposal]:
    request, caps = ground.request, ground.request.caps
    if (
        request.rate is not None
        and search.holds(pinned, caps, float(request.rate), coarse=True) is None
    ):
        return
    fastest = search.fastest(pinned, caps)
    target = float(request.rate) if request.rate is not None else float(ground.part) * fastest
    more = request.pins is None and len(pinned) < len(request.allowed)
    if not 0 < target < fastest * (COMFORT if more else 1.0):
        return
    for pad in PADS:
        found = search.smallest(pinned, caps, min(target * float(pad), (target + fastest) / 2))
        if found is None:
            return
        gains = typed_gains(found.gains, digits=request.digits, caps=caps)
        prices = tuple(price_words(ground.problem, found, request.allowed, caps))
        yield Proposal(observer=observer, gains=gains, pinned=pinned, aim=target, prices=prices)


def of_consensus(ground: Ground) -> Iterator[Proposal]:
    """The cheapest gains near the consensus, by the true rate or by V = e'e."""
    request, agents = ground.request, ground.request.allowed
    if request.rate is None:
        agents, rates = _slow_start(ground)
    else:
        # The pair (P, Q) is chosen for nine tenths of what the network alone reaches: hence 9/8.
        rates = [request.rate * pad for pad in sorted((*PADS, Fraction(9, 8)))]
    # A faster observer may do more than a little more gain.
    for observer, rate in chain(
        *(product(ground.every_observer(), part) for part in (rates[:2], rates[2:]))
    ):
        ground.progress("looking for gains near the consensus")
        found = ground.pinning(rate, agents, request.pins or FEWEST)
        if found.verdict is not Verdict.PROVED:
            continue
        found = _with_more_pins(ground, found, rate, agents)
        gains = {ground.problem.network.index[label]: k for label, k in found.gains.items()}
        prices = (*found.prices, *found.ties)
        by = " They are chosen for V = e'e." if found.weights is None else BY_WEIGHTS
        yield Proposal(
            observer=observer,
            gains=gains,
            pinned=tuple(gains),
            aim=float(rate),
            prices=prices,
            by=by,
        )


def _with_more_pins(
    ground: Ground, found: PinningDesign, rate: Fraction, agents: Sequence[int]
) -> PinningDesign:
    """The design, or a cheaper one on the agents that V = e'e needs, where these are more."""
    plain = (
        ground.pinning(rate, agents, FEWEST, conservative=True)
        if found.weights and not ground.request.pins
        else found
    )
    if len(plain.gains) <= len(found.gains):
        return found
    more = ground.pinning(rate, [ground.problem.network.index[label] for label in plain.gains])
    cheaper = more.verdict is Verdict.PROVED and (more.cost or 0) < (found.cost or 0)
    return more if cheaper else found


def _slow_start(ground: Ground) -> tuple[tuple[int, ...], list[Fraction]]:
    """Agents that do at a very low rate, and parts of their fastest, by V = e'e: the true rate asks
    too much there."""
    problem, request = ground.problem, ground.request
    blocks = network_blocks(problem)
    scale = (
        Fraction(1) if blocks is None or not blocks.scale else claimed(float(f"{blocks.scale:.1g}"))
    )
    start = ground.pinning(
        scale * START, request.allowed, request.pins or FEWEST, conservative=True
    )
    if start.verdict is not Verdict.PROVED:
        return request.allowed, [scale * START]
    pinned = tuple(sorted(problem.network.index[label] for label in start.gains))
    fastest, high = Fraction(0), scale
    # by bisection, since caps and modes are in it; the first steps may lie above
    for _ in range(24):
        middle = (fastest + high) / 2
        reached = (
            ground.pinning(_three_digits(middle), pinned, conservative=True).verdict
            is Verdict.PROVED
        )
        fastest, high = (middle, high) if reached else (fastest, middle)
        if fastest and high - fastest <= fastest / 20:
            break
    parts = (
        ground.part,
        *(part for part in FALLBACKS if part > ground.part and problem.region is not None),
    )
    return pinned, [_three_digits(fastest * part) for part in parts]


def pin_sets(
    structure: Structure,
    request: DesignRequest,
    *,
    search: RegionSearch,
    most: int,
    one_by_one: bool = False,
) -> Iterator[tuple[int, ...]]:
    """Growing sets of at most ``most`` allowed agents, each with the one before it; ``one_by_one``:
    one agent more."""
    blocks, allowed, caps = network_blocks(search.problem), request.allowed, request.caps

    @cache
    def quick(agents: frozenset[int]) -> float:
        return 0.0 if blocks is None else round(fastest_rate(blocks, agents), 9)

    def best(rest: Sequence[int], others: Sequence[int], first: int) -> int:
        """Of ``others`` the one that allows the fastest rate over the region, besides ``rest``;
        ``first`` in doubt."""
        order = sorted(others, key=lambda i: (-quick(frozenset([*rest, i])), i))
        found, rate = first, 0.0
        close = order[:CLOSER] if first in order[:CLOSER] else [first, *order[: CLOSER - 1]]
        for agent in sorted(close, key=order.index):
            reached = search.fastest([*rest, agent], caps, coarse=True)
            if reached > rate * DECISIVE:
                found, rate = agent, reached
        return found

    chosen, work = list(structure.agents), 0
    for place, agent in enumerate(chosen):  # each replaced by the best that meets the same groups
        rest = chosen[:place] + chosen[place + 1 :]
        missed = [group for group in structure.groups if not set(group) & set(rest)]
        others = [i for i in allowed if i not in rest and all(i in group for group in missed)]
        if len(others) > 1 and work + len(others) <= EXCHANGES:
            work += len(others)
            chosen[place] = best(rest, others, agent)
    yield tuple(sorted(chosen))
    looked_at = next(count for size, count in LOOKED_AT if search.problem.n <= size)
    wanted, step = len(chosen), 1
    while len(chosen) < min(most, len(allowed)):
        step = 1 if one_by_one or wanted < len(structure.agents) + ONE_BY_ONE else 2 * step
        wanted = min(wanted + step, most, len(allowed))
        while len(chosen) < wanted:
            left = [i for i in allowed if i not in chosen]
            v = search.holds(chosen, caps, 0.0, coarse=True)
            if v is not None:  # whoever is held least has the largest v
                left.sort(key=lambda i, v=v: (-float(v[i]), i))  # type: ignore[misc]
            chosen.append(best(chosen, left[:looked_at], left[0]))
        yield tuple(sorted(chosen))


def observer_words(found: ObserverDesign, whose: str = "") -> list[str]:
    """W, how fast its error decays, how it came about; a sentence for every group of agents."""
    if found.groups:
        own = (
            observer_words(each, f" of the group of agent {name}")
            for name, each in found.groups.items()
        )
        return [sentence for sentences in own for sentence in sentences]
    rate, gain, noise = (found.measures.get(name) for name in ("rate", "gain", "hinf measurement"))
    pace = f" at {rate:.4g} 1/s" if rate else ""
    loud = (
        f", noise on the measured x reaches dhat with a gain of at most {noise:.4g} 1/s"
        if noise
        else ""
    )
    size = f" |W| = {gain:.4g}." if gain else ""
    rows = value_text(typed_matrix(found.W or ()))
    return [
        f"Observer{whose}: W = {rows} ({found.source}): the error of the estimate "
        f"decays{pace}{loud}.{size}"
    ]


def pins_words(
    problem: Problem, structure: Structure, pinned: Sequence[int], *, fixed: bool
) -> str:
    """Which agents are pinned, and why so many."""
    labels, groups = problem.network.labels, structure.groups
    if len(pinned) == structure.least:
        if problem.dynamics is not None:  # which may settle by themselves
            why = "the network is held where it listens to nobody outside"
        elif len(groups) > 1:
            why = f"{len(groups)} groups listen to nobody outside, and each needs a pin"
            if (
                problem.switching is not None
                and problem.switching.is_guaranteed
                and len(problem.network.modes) > 1
            ):
                why += (
                    " under arbitrary switching; fewer may do under the guarantee, which "
                    "designs ignore"
                )
        elif len(groups[0]) == problem.n:
            why = "at least one is needed, or the group can drift as a whole. No more were needed"
        else:
            hears = "listens" if len(groups[0]) == 1 else "listen"
            who = name_agents([labels[i] for i in groups[0]])
            why = f"{who} {hears} to nobody outside, so there has to be a pin"
    elif fixed:
        why = "as many as were allowed"
    else:
        least = (
            f"{structure.least} {'is' if structure.least == 1 else 'are'} the least that the "
            "arcs allow"
        )
        why = f"{least}, but with fewer than {len(pinned)} very large gains or no proof were left"
    return f"Pinned: {name_agents([labels[i] for i in pinned])}; {why}."


def gains_words(problem: Problem, gains: Gains, *, digits: int, part: Fraction | None) -> str:
    """The gains, rounded up, and what they are for."""
    labels = problem.network.labels
    each = ", ".join(
        f"k = {typed_number(k)} for agent {labels[i]}" for i, k in islice(gains.items(), SHOWN)
    )
    more = f" and {len(gains) - SHOWN} more" if len(gains) > SHOWN else ""
    total = f", in total {typed_number(sum(gains.values(), Fraction(0)))}" if len(gains) > 1 else ""
    aim = (
        ""
        if part is None
        else f" They are meant for {float(part):.0%} of the fastest rate that pins there allow."
    )
    unit = "(1/s)" if problem.dynamics is None else "(times the coupling)"
    return f"Gains: {each}{more}{total} {unit}, rounded up to {counted(digits, 'digit')}.{aim}"


def price_words(
    problem: Problem, found: RegionGains, allowed: Sequence[int], caps: Gains
) -> Iterator[str]:
    """The multipliers of a design over a region: what more rate costs, and where a further pin buys
    most."""
    labels, total = problem.network.labels, sum(found.gains.values())
    if not total or not found.rate:
        return
    share = found.rate_price * found.rate / total
    yield (
        f"Price of the rate: near {found.rate:.4g} 1/s, each 1 % more takes about {share:.3g} "
        "% more gain."
    )
    capped = [
        labels[i] for i, k in found.gains.items() if i in caps and k >= 0.999 * float(caps[i])
    ]
    if capped:
        stand = "has" if len(capped) == 1 else "have"
        yield f"Price of the caps: {name_agents(capped)} {stand} the largest gain allowed."
    others = [i for i in range(problem.n) if i not in found.gains]
    best = sorted(others, key=lambda i: (-round(float(found.prices[i]), 6), i))[:BUYS]
    if best and found.prices[best[0]] > 1:
        named = ", ".join(
            f"agent {labels[i]} {found.prices[i]:.3g}" for i in best if found.prices[i] > 1
        )
        kept = (
            ""
            if best[0] in set(allowed)
            else f" (pins there are not allowed on agent {labels[best[0]]})"
        )
        most = (
            f"agent {labels[best[0]]} would save most. Gain saved elsewhere (1/s) for each 1/s "
            "of gain there"
        )
        yield f"Price of so few pins: {most}: {named}{kept}."
    elif others:
        yield "Price of so few pins: none; a gain on any other agent would cost more than it saves."


def trade_off_of(
    problem: Problem,
    request: DesignRequest,
    curve: str,
    *,
    design: Design | None,
    points: object,
    progress: Progress,
) -> TradeOff:
    """The curve of that name.  Raises: SpecError for another name or number of points, and where
    there is no curve."""
    if curve not in AXES:
        text = f"curve must be one of {', '.join(AXES)}; got {shown(curve)}."
        raise SpecError(text, key="curve", cure='"gain" is the sum of the gains against the rate.')
    if isinstance(points, bool) or not isinstance(points, int) or not 2 <= points <= 200:
        text = f"points must be an integer from 2 to 200; got {shown(points)}."
        raise SpecError(text, key="points", cure="Ten are a good choice.")
    if curve == "noise" and not problem.groups:
        text = "the noise curve needs an exosystem: without one there is no observer."
        raise SpecError(text, key="curve", cure='Ask for "gain" or "pins".')
    bare = changed_problem(problem, {"pinning.gains": None})
    own = _attempt(bare, request, progress) if design is None and curve == "gain" else design
    observer = None if own is None else own.observer
    if observer is None and bare.groups:
        observer = observer_at(bare, request, None)
    said: Iterable[str] = ()
    if curve == "gain" and own is not None:
        found, said = (
            _gain_points(bare, request, own, points, progress),
            own.prices if own.gains else (own.reason,),
        )
    elif curve == "pins":
        found = _pin_points(bare, request, observer, points, progress)
        said = _largest_step(found)
    else:
        rates = _spread(
            1.0 if observer is None else observer.measures.get("rate", 1.0), QUICKEST, points
        )
        found = sorted(
            (p for r in rates for p in _noise_point(observer_at(bare, request, r))),
            key=lambda p: p.x,
        )
    chosen: TradePoint | None = None
    if design is not None and curve == "noise" and observer is not None:
        chosen = next(iter(_noise_point(observer)), None)
    elif design is not None and design.rate and design.cost is not None:
        x, y = (
            (design.rate, float(design.cost))
            if curve == "gain"
            else (float(len(design.gains)), design.rate)
        )
        chosen = TradePoint(x=x, y=y, pinned=tuple(design.gains), proved=True)
    return TradeOff(
        name=problem.name, curve=curve, points=tuple(found), chosen=chosen, sensitivity=tuple(said)
    )


def _gain_points(
    problem: Problem, request: DesignRequest, own: Design, points: int, progress: Progress
) -> list[TradePoint]:
    """Designs for many rates, all with the pins of one."""
    pinned = tuple(sorted(problem.network.index[label] for label in own.gains)) or request.allowed
    found: list[TradePoint] = []
    for rate in _spread(own.rate or 0.0, FASTEST, points):
        each = _attempt(problem, replace(request, rate=rate, allowed=pinned), progress)
        if each.verdict is Verdict.PROVED and each.cost is not None:
            found.append(
                TradePoint(x=float(rate), y=float(each.cost), pinned=tuple(each.gains), proved=True)
            )
    return found


def _pin_points(
    problem: Problem,
    request: DesignRequest,
    observer: ObserverDesign | None,
    points: int,
    progress: Progress,
) -> list[TradePoint]:
    """The rate that gains approach on growing sets of agents, as floating point sees it."""
    structure, labels = structure_of(problem, request.allowed), problem.network.labels
    if structure.unmet is not None:
        text = "allowed must leave every group that listens to nobody outside an agent to pin."
        raise SpecError(
            text, key="allowed", cure="dobc_design.design says which agents are missing."
        )
    search = region_search(problem, observer)
    most = min(
        len(request.allowed) if request.pins is None else request.pins,
        len(structure.agents) + points - 1,
    )
    found: list[TradePoint] = []
    for pinned in pin_sets(structure, request, search=search, most=most, one_by_one=True):
        progress(f"{len(pinned)} pinned agents")
        rate = search.fastest(pinned, request.caps)
        if 0 < rate < math.inf:
            found.append(
                TradePoint(x=float(len(pinned)), y=rate, pinned=tuple(labels[i] for i in pinned))
            )
    return found


def _largest_step(points: Sequence[TradePoint]) -> Iterator[str]:
    """Which further pin buys most."""
    if len(points) > 1:
        before, after = max(pairwise(points), key=lambda step: step[1].y / step[0].y)
        new = ", ".join(label for label in after.pinned if label not in before.pinned)
        step, times = f"from {before.x:g} to {after.x:g} pins", f"{after.y / before.y:.3g} times"
        yield f"The most useful step: {step}. With agent {new} the rate grows {times}."


def _noise_point(observer: ObserverDesign) -> list[TradePoint]:
    pace, noise = (observer.measures.get(name) for name in ("rate", "hinf measurement"))
    return [] if noise is None or pace is None else [TradePoint(x=pace, y=noise, proved=True)]


def _spread(middle: float, last: float, count: int) -> list[Fraction]:
    """Rates (1/s) of four digits around one; none around 0."""
    parts = (SLOWEST + (last - SLOWEST) * k / (count - 1) for k in range(count))
    return [claimed(float(f"{middle * part:.4g}")) for part in parts] if middle > 0 else []
