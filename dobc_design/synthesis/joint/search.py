"""The joint design: W, pins and gains for one request, rounded and certified; the nearest possible
one.

The order is that of the cost: facts of exosystem and graph, rates that no gains reach, the
observer, then pins (``pins``), gains for the region asked for, or near the consensus.  What is
given up first is what the refutation names; how far is read off a design without that limit.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field, replace
from fractions import Fraction
from itertools import islice, product

from dobc_design._checks import noun
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.certify import certify
from dobc_design.certification.cures import missing_arcs
from dobc_design.conditions.consensus.pinning import network_blocks
from dobc_design.conditions.coverage import Progress, asked_radius, covering
from dobc_design.conditions.numbers import bisected, claimed, shorten, text_below
from dobc_design.conditions.observer.decide import too_large
from dobc_design.conditions.observer.propose import filter_rate, pace_of, with_observer
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.conditions.statement import Statement, undecided
from dobc_design.exact.number import ONE, ZERO, typed_number
from dobc_design.exact.reading import Document, Table, counted
from dobc_design.loop.make import loop_of, observed
from dobc_design.loop.saturation import Rooms, rooms_of
from dobc_design.problem.changes import changed_problem, gain_changes
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.joint import agents
from dobc_design.synthesis.observer.claim import ObserverDesign, ObserverRequest
from dobc_design.synthesis.observer.decide import Reduction, reduced_exosystem
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

from .claim import (
    Design,
    DesignRequest,
    Grounds,
    RegionPrices,
    total_gain,
)
from .pins import DECISIVE, FEW, PinSets

NEARLY = 0.98  # of the rate that is aimed at: a proof with less is looked for again
# of the fastest rate, where the one asked for cannot be had; more takes very large gains
NEAREST = Fraction(9, 10)
MOST_TRIES, MOST_QUICK = 4, 15  # proposals that are certified: over a region, near the consensus
SPEEDS = (2, 4)  # of further observers, in units of the slowest that is worth trying
MARGIN = 3  # how much faster than the rate asked the observer is to be
# faster than asked, tried in turn
PADS = (Fraction(1005, 1000), Fraction(102, 100), Fraction(11, 10), Fraction(3, 2))
# of the largest slope: a rate that every network which can do at all can do
START = Fraction(1, 10**6)
# beyond, one more pin saves very large gains: percent of gain for one percent of rate, and in large
# networks, where a proof takes long, a part of the fastest rate
STEEP, COMFORT = 10, 0.75
# parts of the fastest rate near the consensus, where rows do not apply
FALLBACKS = (Fraction(1, 2), Fraction(9, 10))
HALF = Fraction(1, 2)  # of the fastest rate: what is aimed at where none is asked for
# of the fastest rate with any observer: slower ones are left out; where more is aimed at
ENOUGH, ALMOST = 0.6, 0.95
SMALL = Fraction(1, 10**4)  # the radius of a region that is one point
# pins more than the fewest, tried where these take more gain than the problem's own
MORE_PINS = 3
BUYS = 3  # agents in the sentence on what a further pin buys
NO_OBSERVER = (
    "no observer gain was found that does what was asked, and no proof that there is none."
)


@noun
class Ground:
    """One request and its problem without W and gains; without a rate, ``part`` of the fastest one
    is aimed at.  ``reduction``: what became of the exosystem.  ``least``: over a region no fewer
    pins are tried.  ``headline``: the rate has to be that of the check that carries the verdict."""

    problem: Problem
    request: DesignRequest
    progress: Progress
    reduction: Reduction
    structure: Structure
    part: Fraction
    least: int = 0
    headline: bool = False
    observers: list[ObserverDesign | None] = field(default_factory=list)

    def every_observer(self) -> Iterator[ObserverDesign | None]:
        """All gains worth trying, slow ones first (None: none is needed); the first may say why
        there is no W."""
        if not self.observers:
            self.observers.append(self._first_observer() if self.problem.groups else None)
        first = self.observers[0]
        yield first
        if first is None or first.W is None:
            return
        for place, speed in enumerate(SPEEDS, start=1):
            if place == len(self.observers):
                self.progress("designing a faster observer")
                rate = _three_digits(_pace(first) * speed)
                found = observer_at(self.problem, self.request, rate) if rate > 0 else None
                self.observers.append(found)
            faster = self.observers[place]
            if faster is None or faster.W is None:
                return
            yield faster

    def _first_observer(self) -> ObserverDesign:
        """The slowest observer worth trying: of the usual rate, or faster than the rate asked
        for; with bands so fast that little is left of their sines."""
        self.progress("designing the observer")
        first = observer_at(self.problem, self.request, filter_rate(loop_of(self.problem)))
        asked = self.request.rate
        if asked is None or first.W is None or _pace(first) >= MARGIN * asked:
            return first
        fast = observer_at(self.problem, self.request, MARGIN * asked)
        if fast.W is not None:
            return fast
        return observer_at(self.problem, self.request, asked * Fraction(101, 100))

    def pinning(
        self,
        rate: Fraction,
        agents: Sequence[int],
        pins: int | str | None = None,
        *,
        conservative: bool = False,
    ) -> PinningDesign:
        """The cheapest gains on these agents near the consensus."""
        request = PinningRequest(
            rate=rate,
            allowed=tuple(agents),
            costs=(ONE,) * self.problem.n,
            caps=self.request.caps,
            pins=pins,
            digits=self.request.digits,
            conservative=conservative or self.request.conservative,
        )
        return search_pinning(self.problem, request, self.progress)

    def fails(self, obstacle: Statement, observer: ObserverDesign | None = None) -> Design:
        """No design, because of the obstacle."""
        refuted = obstacle.verdict is Verdict.REFUTED
        return Design(
            verdict=obstacle.verdict,
            request=self.request,
            labels=self.problem.network.labels,
            gains={},
            changes={},
            obstacle=obstacle,
            statements=(obstacle,) if refuted else (),
            observer=observer,
        )


@noun
class Proposal:
    """W and gains (1/s, rounded) on at most the ``pinned`` agents, meant for the rate ``aim``
    (1/s): from a design ``near`` the consensus, from rows over the ``region``, or for agents with
    [dynamics], with ``changes`` of the problem; where agents agree, with the ``arcs`` that were
    missing, in words."""

    observer: ObserverDesign | None
    gains: Gains
    pinned: Sequence[int] = ()
    aim: float = 0.0
    near: PinningDesign | None = None
    region: RegionPrices | None = None
    changes: Table = field(default_factory=dict)
    arcs: str | None = None


def search_design(problem: Problem, request: DesignRequest, progress: Progress) -> Design:
    """Decide a request; one that is refuted or undecided comes with the nearest one that was proved
    possible."""
    slower = list[Design]()
    found = attempt(problem, request, progress, slower=slower)
    if found.is_proved:
        return found
    for weaker, part in _weaker(problem, request, found):
        progress("looking for the nearest possible request")
        nearest = attempt(problem, weaker, progress, part=part)
        if nearest.is_proved:
            slower.append(nearest)
            break
    if not slower:
        return found
    # Designs that keep all limits but for the rate are nearer than others.
    same = [each for each in slower if replace(each.request, rate=request.rate) == request]
    fastest = max(same or slower, key=lambda each: each.rate or 0.0)
    return replace(found, nearest=_tightened(request, fastest))


def further_pins(
    problem: Problem, found: Design, most: int, progress: Progress, *, headline: bool = False
) -> Iterator[Design]:
    """Designs with one to ``most`` pins more, for the same rate, where their number was free."""
    request = found.request
    if request.pins is not None or not found.rate or problem.agrees:
        return
    rate = request.rate or claimed(shorten(found.rate, digits=4))
    count = len(found.gains)
    for pins in range(count + 1, min(count + most, len(request.allowed)) + 1):
        progress(f"pricing {pins} pins")
        wider = replace(request, rate=rate, pins=pins)
        each = attempt(problem, wider, progress, least=pins, headline=headline)
        # The cheapest gains may leave pins unused: more of them buy nothing.
        if not each.is_proved or each.grounds is None or len(each.gains) < pins:
            return
        yield replace(each, request=request, grounds=replace(each.grounds, limited=False))


def no_slower(
    problem: Problem, request: DesignRequest, given: Certificate, progress: Progress
) -> Design | None:
    """A design that is as fast as the problem's own gains, whose certificate is ``given``; with a
    few more pins where fewer take a larger total gain.  None where none was proved."""
    if given.verdict is not Verdict.PROVED or not given.rate:
        return None
    progress("looking for gains that are as fast as those of the problem")
    asked = replace(request, rate=claimed(given.rate))
    # What ``certify`` says of both files in its first line is compared.
    found = attempt(problem, asked, progress, headline=True)
    if not found.is_proved:
        return None
    total = total_gain(problem)
    best = found
    if total is not None and (found.cost or 0) > total:
        wider = further_pins(problem, found, MORE_PINS, progress, headline=True)
        best = next((each for each in wider if (each.cost or 0) <= total), found)
    return replace(best, request=request)


def attempt(
    problem: Problem,
    request: DesignRequest,
    progress: Progress,
    *,
    part: Fraction = HALF,
    least: int = 0,
    headline: bool = False,
    slower: list[Design] | None = None,
) -> Design:
    """Decide one request; designs that are proved, but not at the rate asked for, are added to
    ``slower``."""
    progress("looking for what is impossible")
    reasons = (too_large(group.exosystem) for group in problem.groups)
    # Exact arithmetic with such an exosystem would take too long, its reduction included.
    large = next(filter(None, reasons), None)
    reduction = Reduction() if large else reduced_exosystem(problem, reduce=request.reduce)
    bare = changed_problem(problem, {"pinning.gains": None, **reduction.changes})
    if bare.groups:
        bare = changed_problem(bare, gain_changes(bare, None))
    # Where outputs are measured there is no loop without a W; every proposal has its own.
    bare = with_observer(bare).replace(notes=bare.notes)
    ground = Ground(
        problem=bare,
        request=request,
        progress=progress,
        reduction=reduction,
        structure=structure_of(bare, request.allowed),
        part=part,
        least=least,
        headline=headline,
    )
    obstacle = reduction.obstacle
    # Agents that agree have no pins.
    if obstacle is None and not bare.agrees:
        obstacle = agents.obstacle(bare, request, ground.structure)
    # What no gains reach is known of agents that are integrators, and know themselves at once.
    is_late = loop_of(bare).timing is not None
    if obstacle is None and not bare.agrees and bare.dynamics is None and not is_late:
        obstacle = too_fast(bare, request, slow_directions)
    if obstacle is None and large:
        obstacle = undecided("exosystem", f"what an observer has to do is {large}")
    if obstacle is not None:
        return ground.fails(obstacle)
    observer = next(ground.every_observer())
    if observer is not None and observer.verdict is Verdict.REFUTED:
        return ground.fails(observer.statements[0], observer)
    if observer is not None and observer.W is None:
        return ground.fails(undecided("observer", NO_OBSERVER))
    return _first_proved(ground, slower)


def _first_proved(ground: Ground, slower: list[Design] | None) -> Design:
    """The first proposal that is proved; where more than half of the fastest rate is aimed at, the
    last one while a faster observer still buys much."""
    best: Design | None = None
    last: Design | None = None
    tries = 0
    most = MOST_QUICK if ground.problem.region is None else MOST_TRIES
    for proposal in islice(of_region(ground), most):
        design = _certified(ground, proposal)
        if design.is_proved:
            if ground.part <= HALF:
                return design
            if best is not None and (design.rate or 0.0) <= DECISIVE * (best.rate or 0.0):
                break
            best = design
        last = design
        tries += 1
        # What is proved at a lower rate is a candidate for the nearest request.
        proof = design.certificate
        proved = proof is not None and proof.verdict is Verdict.PROVED
        if slower is not None and proved and design.rate:
            without = replace(design.request, rate=None)
            slower.append(replace(design, verdict=Verdict.PROVED, request=without))
    if best is not None:
        return best
    return ground.fails(_none_proved(ground, tries, last))


def _none_proved(ground: Ground, tries: int, last: Design | None) -> Statement:
    if last is not None:
        tried = f"{counted(tries, 'design')} were tried, and none was proved"
        return undecided("proof", f"{tried}; the last: {last.reason}")
    what = "the consensus" if ground.problem.region is None else "the region asked for"
    asked = ""
    if ground.request.rate is not None:
        asked = f" at {typed_number(ground.request.rate)} 1/s"
    none = f"no gains on the allowed agents were found for which {what} is proved{asked}"
    timing = loop_of(ground.problem).timing
    if timing is not None and timing.steepest is not None:
        most = text_below(float(timing.steepest))
        none += f" (slopes and gains of an agent may add up to {most} 1/s with these readings)"
    return undecided("gains", f"{none}, and no proof that there are none.")


def _certified(ground: Ground, proposal: Proposal) -> Design:
    """The proposal, certified: PROVED if the certificate holds and has the rate asked for."""
    problem = ground.problem
    request = ground.request
    labels = problem.network.labels
    gains = {labels[i]: k for i, k in sorted(proposal.gains.items())}
    W = None if proposal.observer is None else proposal.observer.W
    changes: Document = {}
    if not problem.agrees:
        changes["pinning.gains"] = {label: typed_number(k) for label, k in gains.items()}
    changes |= proposal.changes
    if W is not None:
        changes |= gain_changes(problem, W, observed(problem))
    designed = changed_problem(problem, changes)
    certificate, everything = _proof(ground, designed, proposal.aim)
    rate = certificate.rate if ground.headline else _rate_of(certificate)
    holds = certificate.verdict is Verdict.PROVED
    if holds and request.rate is not None:
        holds = claimed(rate or 0.0) >= request.rate
    count = len(proposal.pinned or proposal.gains)
    has_dynamics = designed.dynamics is not None
    return Design(
        verdict=Verdict.PROVED if holds else Verdict.UNDECIDED,
        request=request,
        labels=labels,
        W=W,
        P=certificate.claims.P,
        gains=gains,
        rate=rate,
        cost=sum(gains.values(), ZERO),
        changes={**ground.reduction.changes, **changes},
        problem=designed,
        certificate=certificate,
        observer=proposal.observer,
        grounds=Grounds(
            structure=ground.structure,
            limited=request.pins is not None and count >= request.pins,
            part=ground.part if request.rate is None and not has_dynamics else None,
            reduction=ground.reduction.words,
            arcs=proposal.arcs,
            everything=everything,
            near=proposal.near,
            region=proposal.region,
            weaker=agents.weaker(designed, rate) if has_dynamics and rate else None,
        ),
    )


def _proof(ground: Ground, designed: Problem, aim: float) -> tuple[Certificate, bool]:
    """Certify a design that is meant for the rate ``aim`` (1/s); and whether every condition was
    run for it."""
    request = ground.request
    ground.progress("certifying the design")
    nearly = aim * NEARLY
    # Proofs with at least this rate are looked for.
    least = max(claimed(shorten(nearly, digits=6)), request.rate or ZERO) or None
    first = certify(designed, rate=least, progress=ground.progress)
    hoped = nearly if request.rate is not None or ground.part > HALF else 0.0
    falls_short = first.verdict is Verdict.PROVED and (_rate_of(first) or 0.0) < hoped
    # A proof of every start came first, with a lower rate; there is none where inputs saturate.
    of_all = designed.is_linear and not loop_of(designed).saturates
    if not falls_short or not of_all or not designed.region:
        return first, False
    return certify(designed, rate=least, everything=True, progress=ground.progress), True


def _rate_of(proof: Certificate) -> float | None:
    """The largest rate (1/s) of a check that covers what is asked; the one that carries the
    verdict, with the least time to one percent, may have a smaller one."""
    loop = loop_of(proof.problem)
    # Beside readings other checks have rates that are none of theirs.
    if proof.rate is None or loop.timing is not None:
        return proof.rate
    proofs = covering(loop, proof.checks)
    return max((each.rate for each in proofs if each.rate is not None), default=proof.rate)


def _weaker(
    problem: Problem, request: DesignRequest, found: Design
) -> Iterator[tuple[DesignRequest, Fraction]]:
    """Requests with one limit given up, the binding one first; then a rate as near as possible.
    Each with the part of the fastest rate that is aimed at."""
    kind = found.statements[0].kind if found.statements else None
    slower = None if request.rate is None else replace(request, rate=None)
    any_pins = replace(request, pins=None)
    any_gain = replace(request, caps={})
    # Without a reduction nothing else can help,
    if kind == "detectable":
        yield replace(request, reduce=True), HALF
        return
    # nor without an agent of every group.
    if kind == "structure":
        wider = with_lacking(problem, request)
        yield wider, HALF
        yield replace(wider, pins=None), HALF
        return
    if kind in ("gain", "noise"):
        other = None if found.observer is None else found.observer.nearest
        yield replace(request, noise=() if other is None else other.request.noise), HALF
    elif kind == "pins" or (kind is None and slower is None and request.pins is not None):
        yield any_pins, HALF
    elif kind == "max_gain":
        yield any_gain, HALF
    # A slower loop within the same limits is what most can live with.
    if slower is not None:
        yield slower, NEAREST
    all_agents = replace(request, allowed=tuple(range(problem.n)))
    for weaker in (any_pins, any_gain, all_agents, replace(request, noise=())):
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
        caps = {i: max(cap, reached.get(i, cap)) for i, cap in asked.caps.items()}
        request = replace(request, caps=caps)
    return replace(found, request=request)


def observer_at(problem: Problem, request: DesignRequest, rate: Fraction | None) -> ObserverDesign:
    """A W for every group within the request's bounds on noise; without a ``rate`` (1/s) for that
    of the file."""
    asked = ObserverRequest(
        rate=problem.joint_observer.rate if rate is None else rate,
        noise=request.noise,
        digits=request.digits,
        norms=problem.dynamics is None,
    )
    return search_groups(problem, asked)


def _pace(observer: ObserverDesign) -> Fraction:
    return claimed(observer.measures.get("rate", 0.0))


def _three_digits(rate: Fraction) -> Fraction:
    return claimed(float(f"{float(rate):.3g}"))


def region_search(
    problem: Problem, request: DesignRequest, observer: ObserverDesign | None
) -> RegionSearch:
    """The rows of the region asked for, or next to the consensus, of a problem without gains."""
    region = problem.region
    loop = loop_of(problem)
    W = None if observer is None else observer.W
    radius = max(asked_radius(loop), default=SMALL) or SMALL
    caps = dict(request.caps)
    rooms = rooms_of(loop, W) if loop.saturates else ""
    if isinstance(rooms, Rooms):
        # At the edge of the box a larger gain pulls no harder.
        for agent, room in rooms.room.items():
            caps[agent] = min(caps.get(agent, room / radius), room / radius)
    return RegionSearch(
        problem=problem,
        W=W,
        caps=caps,
        radius=radius,
        disturbance=(region and region.initial_disturbance) or ZERO,
    )


def of_region(ground: Ground) -> Iterator[Proposal]:
    """Pins and gains with which max-separable rows cover the region; without one those near the
    consensus."""
    problem = ground.problem
    request = ground.request
    if problem.agrees:
        found = missing_arcs(problem)
        changes = found.set if found else {}
        arcs = found.text if found else None
        for observer in ground.every_observer():
            yield Proposal(observer=observer, gains={}, changes=changes, arcs=arcs)
        return
    if problem.dynamics is not None:
        yield from of_agents(ground, problem.dynamics)
        return
    loop = loop_of(problem)
    # With readings only rows say something, next to the consensus, too.
    is_near = problem.region is None and loop.timing is None
    if is_near or not acts_by_component(loop):
        yield from of_consensus(ground)
        return
    searches = dict[int, RegionSearch]()

    def search_with(observer: ObserverDesign | None) -> RegionSearch:
        if id(observer) not in searches:
            searches[id(observer)] = region_search(problem, request, observer)
        return searches[id(observer)]

    most = len(request.allowed) if request.pins is None else request.pins
    fewest = ground.least
    # As fast as possible: all pins that are allowed, of which the cheapest gains leave out some.
    if ground.part > HALF:
        fewest = min(most, len(request.allowed))
    first = None if problem.n <= FEW else next(ground.every_observer())
    sets = PinSets(structure=ground.structure, allowed=request.allowed, search=search_with(first))
    rate = None if request.rate is None else float(request.rate)
    # Few pins come first: a set is left when no observer makes it do.
    for pinned in sets.best(fewest, most, rate):
        ground.progress(f"looking for gains on {counted(len(pinned), 'agent')}")
        observers = ground.every_observer()
        if request.rate is None:
            every = list(observers)
            rates = [search_with(each).fastest(pinned, coarse=True) for each in every]
            # Slower ones hold the network back.
            least = (ENOUGH if ground.part <= HALF else ALMOST) * max(rates)
            place = next(place for place, rate in enumerate(rates) if rate >= least)
            observers = iter(every[place:])
        for observer in observers:
            yield from _over_region(ground, observer, search_with(observer), pinned)


def of_agents(ground: Ground, dynamics: Dynamics) -> Iterator[Proposal]:
    """Gains, and on request the coupling, of agents with [dynamics]."""
    request = ground.request

    def networks(alone: Problem, rate: float | None, pins: Iterable[int]) -> Iterator[Gains]:
        asked = replace(
            request,
            rate=None if rate is None else claimed(shorten(rate, digits=6)),
            noise=(),
            coupling=False,
            allowed=tuple(pins) or request.allowed,
        )
        # a network of integrators, which has no disturbance: no observer is designed
        network = replace(ground, problem=alone, request=asked, observers=[None])
        return (each.gains for each in of_consensus(network))

    observer = next(ground.every_observer())
    find = agents.with_couplings if request.coupling else agents.with_strengths
    for gains, changes in find(ground.problem, dynamics, request, networks):
        if dynamics.H is not None and request.rate is None:
            # Agents that know estimates are no faster than these.
            pace = pace_of(changed_problem(ground.problem, changes))
            paced = observer_at(ground.problem, request, pace)
            observer = observer if paced.W is None else paced
        yield Proposal(observer=observer, gains=gains, changes=changes)


def search_agents(
    problem: Problem, request: PinningRequest, progress: Progress, *, coupling: bool
) -> PinningDesign:
    """``design_pinning`` for agents with [dynamics], or readings: as a whole design without a
    disturbance."""
    alone = problem.replace(region=None, simulation=None)
    # What outputs show of the states is estimated together with the disturbance.
    if problem.outputs is None:
        alone = alone.replace(exosystem=None, observer=None, groups=None)
    asked = DesignRequest(
        rate=request.rate,
        allowed=request.allowed,
        caps=request.caps,
        pins=request.pins if isinstance(request.pins, int) else None,
        noise=(),
        digits=request.digits,
        reduce=False,
        coupling=coupling,
    )
    return _pinning_of(problem, request, search_design(alone, asked, progress))


def _pinning_of(problem: Problem, request: PinningRequest, found: Design) -> PinningDesign:
    """The pins and gains of a whole design, as an answer to a request for these alone."""
    own = replace(request, rate=found.request.rate or request.rate, allowed=found.request.allowed)
    design = PinningDesign(
        verdict=found.verdict,
        request=own,
        gains=found.gains,
        cost=found.cost,
        statements=found.statements,
        obstacle=found.obstacle,
        whole=found,
    )
    if found.gains:
        held = changed_problem(problem, found.changes)
        design = replace(design, rate=found.request.rate, problem=held)
    if found.nearest is not None:
        design = replace(design, nearest=_pinning_of(problem, request, found.nearest))
    return design


def _over_region(
    ground: Ground, observer: ObserverDesign | None, search: RegionSearch, pinned: Sequence[int]
) -> Iterator[Proposal]:
    """Gains on these agents for the whole region, for rates that are faster and faster."""
    request = ground.request
    rate = None if request.rate is None else float(request.rate)
    # Many sets fall here, so that few points of s have to do.
    if rate is not None and search.holds(pinned, rate, coarse=True) is None:
        return
    fastest = search.fastest(pinned)
    target = float(ground.part) * fastest if rate is None else rate
    most = min(request.pins or ground.problem.n, len(request.allowed))
    may_grow = rate is not None and len(pinned) < most
    is_large = ground.problem.n > FEW
    comfort = COMFORT if may_grow and is_large else 1.0
    if not 0 < target < fastest * comfort:
        return
    # Rounded v and gains may prove a little less than they are meant for.
    for pad in PADS:
        found = search.smallest(pinned, min(target * float(pad), (target + fastest) / 2))
        if found is None:
            return
        prices = _region_prices(ground, found)
        if may_grow and not is_large and prices is not None and prices.share > STEEP:
            return
        yield Proposal(
            observer=observer,
            gains=typed_gains(found.gains, request),
            pinned=pinned,
            aim=target,
            region=prices,
        )


def _region_prices(ground: Ground, found: RegionGains) -> RegionPrices | None:
    """What more rate costs, and where a further pin buys most; None without gains."""
    labels = ground.problem.network.labels
    caps = ground.request.caps
    total = sum(found.gains.values())
    if not total or not found.rate:
        return None
    capped = list[str]()
    for i, k in found.gains.items():
        if i in caps and k >= 0.999 * float(caps[i]):
            capped.append(labels[i])
    others = [i for i in range(ground.problem.n) if i not in found.gains]
    prices = found.prices.tolist()
    # Prices that differ by less than the solver's accuracy are alike.
    best = sorted(others, key=lambda i: (-round(prices[i], 6), i))[:BUYS]
    dear = [i for i in best if prices[i] > 1]
    return RegionPrices(
        rate=found.rate,
        share=found.rate_price * found.rate / total,
        capped=tuple(capped),
        savings={labels[i]: prices[i] for i in dear} if others else None,
        barred=tuple(labels[i] for i in dear if i not in ground.request.allowed),
    )


def of_consensus(ground: Ground) -> Iterator[Proposal]:
    """The cheapest gains near the consensus, by the true rate or by V = e'e."""
    request = ground.request
    index = ground.problem.network.index
    agents = request.allowed
    if request.rate is None:
        agents, rates = _slow_start(ground)
    else:
        # The pair (P, Q) is chosen for nine tenths of what the network alone reaches: hence 9/8.
        rates = [request.rate * pad for pad in sorted((*PADS, Fraction(9, 8)))]
    # A faster observer may do more than a little more gain.
    for few in (rates[:2], rates[2:]):
        for observer, rate in product(ground.every_observer(), few):
            ground.progress("looking for gains near the consensus")
            found = ground.pinning(rate, agents, request.pins or FEWEST)
            if found.is_proved:
                best = _with_more_pins(ground, found, rate, agents)
                gains = {index[label]: k for label, k in best.gains.items()}
                yield Proposal(observer=observer, gains=gains, aim=float(rate), near=best)


def _with_more_pins(
    ground: Ground, found: PinningDesign, rate: Fraction, agents: Sequence[int]
) -> PinningDesign:
    """The design, or a cheaper one on the agents that V = e'e needs, where these are more."""
    if not found.weights or ground.request.pins:
        return found
    # Fewer pins need larger gains: the set of V = e'e may be the better bargain.
    plain = ground.pinning(rate, agents, FEWEST, conservative=True)
    if len(plain.gains) <= len(found.gains):
        return found
    index = ground.problem.network.index
    more = ground.pinning(rate, [index[label] for label in plain.gains])
    cheaper = more.is_proved and (more.cost or 0) < (found.cost or 0)
    return more if cheaper else found


def _slow_start(ground: Ground) -> tuple[tuple[int, ...], list[Fraction]]:
    """Agents that do at a very low rate, and parts of their fastest, by V = e'e: the true rate asks
    too much there."""
    problem = ground.problem
    request = ground.request
    blocks = network_blocks(loop_of(problem))
    scale = ONE
    if blocks is not None and blocks.scale:
        scale = claimed(float(f"{blocks.scale:.1g}"))
    slow = scale * START
    start = ground.pinning(slow, request.allowed, request.pins or FEWEST, conservative=True)
    if not start.is_proved:
        return request.allowed, [slow]
    pinned = tuple(sorted(problem.network.index[label] for label in start.gains))
    fastest = _fastest_near(ground, pinned, scale)
    parts = [ground.part]
    if problem.region is not None:
        parts += [part for part in FALLBACKS if part > ground.part]
    return pinned, [_three_digits(fastest * part) for part in parts]


def _fastest_near(ground: Ground, pinned: Sequence[int], high: Fraction) -> Fraction:
    """The fastest rate (1/s) by V = e'e, by bisection, since caps and modes are in it; the first
    steps may lie above."""

    def does(rate: Fraction) -> bool:
        found = ground.pinning(_three_digits(rate), pinned, conservative=True)
        return found.is_proved

    fastest, _ = bisected(
        does,
        ZERO,
        high,
        steps=24,
        close=lambda low, high: low > 0 and high - low <= low / 20,
    )
    return fastest
