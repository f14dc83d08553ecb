"""From a request to a PinningDesign: refute what is impossible, prove gains, bound what is cheaper.

Which agents to pin, at most so many: branch and bound in which every bound is exact.  A node fixes
agents that are pinned and agents that are not; all other allowed agents may have a gain, which
costs no more than any set of the node. Its bound is a proved one, or the node is proved impossible.

Over a region: the smallest gains whose max-separable certificate is proved by
``conditions.separable``.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from typing import Any

from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.network import Enclosed, carriers, name_agents
from dobc_design.conditions.coverage import Progress, asked_radius
from dobc_design.conditions.numbers import claimed, rounded_up, shorten
from dobc_design.conditions.separable import decide as separable
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Separable,
    acts_by_component,
    stuck_agents,
)
from dobc_design.conditions.separable.propose_observer import propose_error_bound, radius_needed
from dobc_design.conditions.statement import Statement, proved, refuted, undecided
from dobc_design.conditions.weighted.decide import network_holds, why_not
from dobc_design.conditions.weighted.propose import network_claim
from dobc_design.errors import SpecError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import counted, shown_number
from dobc_design.problem.changes import changed_problem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import read_positive
from dobc_design.synthesis.pinning import decide
from dobc_design.synthesis.pinning.claim import (
    FEWEST,
    Gains,
    PinningDesign,
    PinningRequest,
    Structure,
    prices_in_words,
    typed_gains,
    without_gains,
)
from dobc_design.synthesis.pinning.decide import Ground
from dobc_design.synthesis.pinning.propose import PinningProposer, make_proposer, slow_directions
from dobc_design.synthesis.pinning.propose_regions import propose_for_box
from dobc_design.verdict import Verdict

# of the last digit but two: how much faster a rate is designed for
TILTS = (1, 10, 1000, Fraction(1, 100))
SHOWN = 5  # ties put into words
LONGEST = 400  # entries of a witness that a statement writes out
WORK = 60_000  # nodes times agents, of few agents
# up to so many; then nodes times squared agents, for a node takes a solve
FEW, MOST_WORK = 300, 18_000_000
ALIKE = Fraction(1, 10**7)  # bounds this close (relatively) to the best cost close a node
REPORTED = 20  # nodes between two reports
MOST_RIVALS = 10_000  # sets whose cost is kept
SIX_DIGITS = 1e-6  # costs that differ by less (relatively) are alike
SUPPORT = 1e-7  # gains below this part of the largest pin nobody
MOST_CAPS = 1e6  # times the caps that were asked for
# rates faster than asked
BOX_TILTS = (Fraction(1, 10**7), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
WEIGHTED_TILTS = (Fraction(1, 10**6), Fraction(1, 10**5), Fraction(1, 1000), Fraction(1, 50))
# ways from what every mode needs by itself to gains for V = e'e,
MIXED = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8)
MORE = 4  # or to so many times as much
SLOWER = 6  # halvings of the rate that are tried for the nearest request
SMALLEST = Fraction(1, 10**9)  # radius of a box


def search_pinning(problem: Problem, request: PinningRequest, progress: Progress) -> PinningDesign:
    """Decide a request, with the nearest possible one.  Raises: SpecError for couplings without a
    derivative."""
    bare = changed_problem(problem, {"pinning.gains": None})
    statements = state_theorems(bare)
    proposer = None if statements.inapplicable else make_proposer(bare, request)
    if proposer is None:
        text = (
            "coupling must have a derivative at the consensus that floats can hold, because "
            "gains are designed for"
        )
        text += (
            f" the linearisation; {statements.inapplicable or 'an entry of J + J is too large.'}"
        )
        raise SpecError(text, key="coupling.h", cure="Use a smooth coupling, such as tanh(y).")
    lambdas = {
        name: Enclosed(middle=x.constant, deviations=x.deviations)
        for name, x in statements.lambdas.items()
    }
    ground = Ground(problem=problem, request=request, lambdas=lambdas)
    weighted = (
        not request.conservative
        and why_not(statements) is None
        and not decide.is_undirected(statements)
    )
    attempt = _weighted_attempt if weighted else _attempt
    found = attempt(ground, proposer, progress)
    if found.verdict is Verdict.PROVED:
        return found
    for weaker in _weaker(ground, proposer, found.statements[0].kind if found.statements else None):
        other = make_proposer(bare, weaker) or proposer
        nearest = attempt(replace(ground, request=weaker), other, progress)
        if nearest.verdict is Verdict.PROVED:
            return replace(found, nearest=nearest)
    return found


def _attempt(ground: Ground, proposer: PinningProposer, progress: Progress) -> PinningDesign:
    request = ground.request
    structure = decide.structure_of(ground.problem, request.allowed)
    obstacle = decide.structural_obstacle(ground.problem, request.pins, structure) or _too_fast(
        ground, proposer
    )
    if obstacle is not None:
        return without_gains(ground.request, structure, obstacle)
    choice, statements = None, tuple[Statement, ...]()
    if request.pins is not None:
        choice, statements = _chosen(ground, proposer, structure, progress)
        if choice is None or choice.agents is None:
            none = next((each for each in statements if each.verdict is Verdict.REFUTED), None)
            return without_gains(ground.request, structure, none)
    progress("proving the gains and their bound")
    return _designed(ground, proposer, structure, choice, statements)


def _weighted_attempt(ground: Ground, plain: PinningProposer, progress: Progress) -> PinningDesign:
    """Decide by V = e'De on the agents that either V would choose; gains for V = e'e stand in,
    without their bounds."""
    request, bare = ground.request, plain.problem
    structure = decide.structure_of(bare, request.allowed)
    limits: dict[str, Any] = {
        "allowed": request.allowed,
        "caps": request.caps,
        "propose": slow_directions,
    }
    obstacle = decide.structural_obstacle(bare, request.pins, structure)
    obstacle = obstacle or decide.too_fast(bare, request.rate, pins=request.pins, **limits)
    proposer = make_proposer(bare, request, weighted=True)
    if obstacle is not None or proposer is None:
        return without_gains(request, structure, obstacle)
    found, sets, designs = (
        _attempt(ground, plain, progress),
        [request.allowed],
        list[PinningDesign](),
    )
    if request.pins is not None:
        progress("looking for the agents that a gain helps most")
        most = request.pins if isinstance(request.pins, int) else None
        sets = [tuple(sorted(map(bare.network.index.__getitem__, found.gains)))]
        rate = float(request.rate)
        greedy = proposer.greedy(request.allowed, structure.groups, rate, most)
        sets.append(
            greedy or proposer.cheapest(request.allowed, most or len(request.allowed), rate)
        )
    progress("proving the gains")
    for agents in dict.fromkeys(filter(None, sets)):
        designs += filter(None, [_with_weights(ground, proposer, plain, structure, agents)])
    designs += [_unbounded(found)] if found.verdict is Verdict.PROVED else []
    if not designs:
        return without_gains(request, structure, None)
    count = len if request.pins == FEWEST else (lambda gains: 0)
    best = min(designs, key=lambda design: (count(design.gains), design.cost or 0))
    if request.pins != FEWEST:
        return best
    needed, pins = max(1, structure.least), len(best.gains)
    if pins > needed and decide.too_fast(bare, request.rate, pins=pins - 1, **limits) is not None:
        needed = pins
    return replace(best, statements=(*best.statements, _fewest(pins, needed)))


def _unbounded(design: PinningDesign) -> PinningDesign:
    """A design by V = e'e without what holds for V = e'e alone."""
    reason = design.reason.rpartition(", and nothing that does")[0] + ", by V = e'e."
    kept = tuple(each for each in design.statements if each.kind in ("rate", "structure"))
    return replace(
        design,
        reason=reason,
        statements=kept,
        lower_bound=None,
        bound=None,
        bound_for=(),
        prices=(),
        ties=(),
    )


def _with_weights(
    ground: Ground,
    proposer: PinningProposer,
    plain: PinningProposer,
    structure: Structure,
    agents: Sequence[int],
) -> PinningDesign | None:
    """The smallest gains found on these agents for which weights of V are proved; None if none
    are."""
    request, labels, rate = (
        ground.request,
        ground.problem.network.labels,
        number_text(ground.request.rate),
    )
    several = len(ground.lambdas) > 1

    def proved_with(gains: Gains) -> PinningDesign | None:
        named = {labels[i]: k for i, k in gains.items()}
        held = changed_problem(ground.problem, {"pinning.gains": named})
        claim = network_claim(held, float(request.rate)) if gains else None
        if claim is None or not network_holds(claim, state_theorems(held), rate=request.rate):
            return None
        text = (
            f"V = e'De with a weight for each agent: V' <= -2 ({rate}) V near the target in "
            "every mode, for the"
        )
        statement = proved("rate", f"{text} gains as they are written.", rate=rate)
        design = _with_gains(request, structure, gains, held, " near the target")
        reason = f"{design.reason}, by V = e'De with a weight for each agent (the true local rate)."
        return replace(design, weights=claim, statements=(statement,), reason=reason)

    for tilt in WEIGHTED_TILTS:
        speed = float(request.rate * (1 + tilt))
        least = proposer.relax(agents, speed)[0]
        if least is None:
            continue
        most = (plain.relax(agents, speed)[0] if several else None) or [MORE * k for k in least]

        for part in MIXED if several else MIXED[:1]:
            mixed = {i: least[i] + part * (most[i] - least[i]) for i in agents}
            found = proved_with(typed_gains(mixed, digits=request.digits, caps=request.caps))
            if found is not None:
                return found
    return None


def _too_fast(ground: Ground, proposer: PinningProposer) -> Statement | None:
    """A proof that even gains on all allowed agents, at their caps, do not reach the rate."""
    request = ground.request
    gains, vectors = proposer.relax(request.allowed, float(request.rate))
    obstacle = (
        None
        if gains is not None
        else decide.obstacle_to(ground, request.allowed, request.rate, vectors)
    )
    if obstacle is None:
        return None
    mode, v = obstacle
    moved = carriers(ground.problem, v)
    values = {"v": ", ".join(map(number_text, v))} if len(v) <= LONGEST else {}
    kind = "rate"
    because = (
        "the direction shown moves none of the agents that may be pinned, and decays more "
        "slowly by itself"
    )
    if {ground.problem.network.labels[i] for i in set(request.allowed) & set(request.caps)} & set(
        moved
    ):
        kind, because = (
            "max_gain",
            "even with every gain at its cap the direction shown decays more slowly",
        )
    where = f" in mode {mode}" if len(ground.lambdas) > 1 else ""
    text = f"no gains reach the rate {shown_number(request.rate)}{where}: {because}. It involves"
    return refuted(kind, f"{text} {name_agents(moved)}.", mode=mode, **values)


def _chosen(
    ground: Ground, proposer: PinningProposer, structure: Structure, progress: Progress
) -> tuple[Choice | None, tuple[Statement, ...]]:
    """The agents to pin: at most so many, or the fewest."""
    request, rate, groups = ground.request, float(ground.request.rate), structure.groups
    needed = max(structure.least, decide.pins_needed(ground, request.rate, proposer.slow(rate)))
    if isinstance(request.pins, int):
        if request.pins < needed:
            text = (
                f"{counted(request.pins, 'pin')} cannot do at this rate: at least {needed} are "
                "needed. So many"
            )
            text += (
                " independent directions are slower than that without gains, and each pin "
                "holds one of them."
            )
            return None, (refuted("pins", text, least=str(needed)),)
        start = proposer.greedy(request.allowed, groups, rate, request.pins)
        choice = Choice(ground, proposer, progress, request.pins, groups, start)
        return choice, (choice.statement(),)
    start = proposer.greedy(request.allowed, groups, rate, None)
    enough = len(request.allowed) if start is None else len(start)
    for number in range(max(1, needed), enough):
        progress(f"looking for {counted(number, 'agent')} that will do")
        choice = Choice(ground, proposer, progress, number, groups)
        if choice.agents is not None:
            return choice, (_fewest(len(choice.agents), needed), choice.statement())
        if not choice.impossible:
            break
        needed = number + 1
    start = proposer.greedy(request.allowed, groups, rate, enough) if start is None else start
    choice = Choice(ground, proposer, progress, enough, groups, start)
    return choice, (_fewest(len(choice.agents or ()), needed), choice.statement())


def _fewest(pins: int, needed: int) -> Statement:
    if pins <= needed:
        return proved(
            "pins",
            f"No fewer than {counted(pins, 'pinned agent')} reach this rate.",
            least=str(pins),
        )
    text = (
        f"{pins} pinned agents do; whether fewer do was not decided, but at least {needed} are "
        "needed."
    )
    return undecided("pins", text, least=str(needed))


def _designed(
    ground: Ground,
    proposer: PinningProposer,
    structure: Structure,
    choice: Choice | None,
    more: tuple[Statement, ...],
) -> PinningDesign:
    request, labels = ground.request, ground.problem.network.labels
    agents = request.allowed if choice is None or choice.agents is None else choice.agents
    # gains for a rate a little faster, rounded up, that are proved for the rate asked
    for tilt in TILTS:
        part = max(Fraction(1, 10 ** (request.digits + 2)), Fraction(1, 10**10)) * tilt
        proposed, vectors = proposer.relax(agents, float(request.rate * (1 + part)))
        found = {} if proposed is None else {i: proposed[i] for i in agents}
        gains = typed_gains(found, digits=request.digits, caps=request.caps)
        if found and decide.reaches(ground, gains, request.rate, hints=vectors):
            break
    else:
        return without_gains(request, structure, None)
    vectors = proposer.relax(agents, float(request.rate))[1]
    bound = decide.bound_from(ground, vectors, agents, request.rate)
    least = bound.value if choice is None else claimed(shorten(choice.bound))
    rate, named = number_text(request.rate), {labels[i]: k for i, k in gains.items()}
    text = f"Lambda < -2 ({rate}) I in every mode, for the gains as they are written."
    statements = [proved("rate", text, rate=rate)]
    if structure.exact:
        example = name_agents([labels[i] for i in structure.agents])
        text = (
            f"Structural minimum: {counted(structure.least, 'pin')}, one for each group that "
            "listens to nobody"
        )
        text += f" outside ({len(structure.groups)} over all modes); {example} would do for that."
        statements.append(proved("structure", text, least=str(structure.least)))
    design = _with_gains(
        request, structure, gains, changed_problem(ground.problem, {"pinning.gains": named})
    )
    return replace(
        design,
        lower_bound=least,
        bound=bound,
        bound_for=tuple(labels[i] for i in agents),
        statements=(*statements, *more),
        prices=tuple(prices_in_words(ground.problem, request, bound, set(agents))),
        ties=() if choice is None else _ties(ground, proposer, tuple(gains), choice),
        reason=f"{design.reason}, and nothing that does costs less than "
        f"{shorten(least, digits=6):.6g}.",
    )


def _with_gains(
    request: PinningRequest, structure: Structure, gains: Gains, held: Problem, over: str = ""
) -> PinningDesign:
    named = {held.network.labels[i]: k for i, k in gains.items()}
    cost = sum((request.costs[i] * k for i, k in gains.items()), Fraction(0))
    return PinningDesign(
        verdict=Verdict.PROVED,
        request=request,
        gains=named,
        rate=request.rate,
        cost=cost,
        structural_minimum=structure.least if structure.exact else None,
        problem=held,
        reason=f"gains on {name_agents(tuple(named))} reach the rate "
        f"{shown_number(request.rate)}{over} at the cost"
        f" {float(cost):.6g}",
    )


def _ties(
    ground: Ground, proposer: PinningProposer, chosen: tuple[int, ...], choice: Choice
) -> tuple[str, ...]:
    labels = ground.problem.network.labels
    pairs = proposer.replaceable(chosen, ground.request.allowed, float(ground.request.rate))
    others = {agent: [labels[other] for own, other in pairs if own == agent] for agent, _ in pairs}
    alike = "would cost the same (to six digits)."
    single = [
        f"In place of agent {labels[i]}, {name_agents(names)} {alike}"
        for i, names in others.items()
    ]
    known = {tuple(sorted({*chosen, other} - {agent})) for agent, other in pairs}
    rest = [
        name_agents([labels[i] for i in rival]) for rival in choice.rivals if rival not in known
    ]
    if rest:
        more = f"; and {len(rest) - SHOWN} more." if len(rest) > SHOWN else "."
        single.append(
            f"As good (to six digits) among the sets that were met: {'; '.join(rest[:SHOWN])}{more}"
        )
    return tuple(single)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Node:
    inside: frozenset[int]
    outside: frozenset[int]
    bound: Fraction
    # agents with a gain at the optimum of the node, the largest gain first
    support: tuple[int, ...]


@dataclass(eq=False)
class Choice:
    """The cheapest set of at most ``pins`` allowed agents at the rate asked, with a proved bound.
    ``agents``: the cheapest set found, or None; ``cost`` about.  ``bound``: no set of so many costs
    less (proved). ``impossible``: proved that no such set reaches the rate.  ``rivals``: other sets
    that were met and cost the same to six digits. ``start``: a set to begin with.  ``groups``: each
    needs a pin."""

    ground: Ground
    proposer: PinningProposer
    progress: Progress
    pins: int
    groups: Sequence[Sequence[int]]
    start: Collection[int] | None = None
    agents: tuple[int, ...] | None = None
    cost: float = float("inf")
    # open nodes, the lowest bound first
    _heap: list[tuple[Fraction, int, _Node]] = field(default_factory=list)
    # bounds of closed nodes that are not impossible
    _closed: list[Fraction] = field(default_factory=list)
    _nodes: int = 0
    _met: dict[tuple[int, ...], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.start is not None:
            self._try_set(self.start)
        self._add(frozenset(), frozenset(), Fraction(0))
        n = self.ground.problem.n
        most = max(50, WORK // n) if n <= FEW else max(1, MOST_WORK // n**2)
        while self._heap and self._nodes < most:
            node = heapq.heappop(self._heap)[2]
            if self._is_beaten(node):
                self._closed.append(node.bound)
                continue
            if self._nodes % REPORTED == 0:
                self.progress(
                    f"comparing sets of agents ({self._nodes} parts of the choice so far)"
                )
            agent = next(agent for agent in node.support if agent not in node.inside)
            self._add(node.inside | {agent}, node.outside, node.bound)
            self._add(node.inside, node.outside | {agent}, node.bound)
        bounds = [node.bound for _, _, node in self._heap] + self._closed
        self.bound = min(bounds, default=Fraction(0))
        self.impossible = not bounds and self.agents is None

    @property
    def rivals(self) -> list[tuple[int, ...]]:
        most = self.cost * (1 + SIX_DIGITS)
        return sorted(
            agents for agents, cost in self._met.items() if agents != self.agents and cost <= most
        )

    def statement(self) -> Statement:
        if self.impossible:
            several = f"no {self.pins} of the allowed agents reach"
            none = "none of the allowed agents alone reaches" if self.pins == 1 else several
            text = (
                f"{none} this rate: every choice is excluded, {self._nodes} parts of the "
                "choice one by one, each by"
            )
            text += " a direction that stays too slow or a group without a pin."
            return refuted("pins", text, pins=str(self.pins), nodes=str(self._nodes))
        finished = all(self._is_beaten(node) for _, _, node in self._heap)
        how = "all choices compared" if finished else f"{self._nodes} parts of the choice looked at"
        agents = "one agent" if self.pins == 1 else f"at most {self.pins} agents"
        text = f"No gains on {agents} cost less than {shorten(self.bound, digits=6):.6g} ({how})."
        return proved("choice", text, bound=number_text(claimed(shorten(self.bound))))

    def _try_set(self, agents: Collection[int]) -> None:
        request, agents = self.ground.request, tuple(sorted(agents))
        gains = self.proposer.relax(agents, float(request.rate))[0]
        if gains is not None:
            cost = sum(float(c) * k for c, k in zip(request.costs, gains, strict=True))
            if len(self._met) < MOST_RIVALS:
                self._met[agents] = cost
            if cost < self.cost:
                self.cost, self.agents = cost, agents

    def _add(self, inside: frozenset[int], outside: frozenset[int], above: Fraction) -> None:
        """Open a node with its exact bound, at least its parent's; or close it: impossible, known,
        or not better."""
        request, pins = self.ground.request, self.pins
        unmet = [set(group) - outside for group in self.groups if not set(group) & inside]
        if len(inside) + len(decide.apart(unmet)) > pins:
            return
        self._nodes += 1
        left = inside if len(inside) >= pins else frozenset(request.allowed) - outside
        gains, vectors = self.proposer.relax(left, float(request.rate))
        bound, support = above, tuple[int, ...]()
        if gains is not None:
            bound = max(above, decide.bound_from(self.ground, vectors, left, request.rate).value)
            kept = [agent for agent in left if gains[agent] > SUPPORT * max(gains)]
            support = tuple(sorted(kept, key=lambda agent: (-gains[agent], agent)))
        elif decide.obstacle_to(self.ground, left, request.rate, vectors) is not None:
            return
        node = _Node(inside=inside, outside=outside, bound=bound, support=support)
        free = [agent for agent in support if agent not in inside]
        if support:
            self._try_set(
                inside | set(free[: pins - len(inside)]) if len(support) > pins else support
            )
        if len(support) <= pins or len(inside) >= pins or not free or self._is_beaten(node):
            self._closed.append(bound)
        else:
            heapq.heappush(self._heap, (bound, self._nodes, node))

    def _is_beaten(self, node: _Node) -> bool:
        return self.agents is not None and node.bound >= Fraction(self.cost) * (1 - ALIKE)


def _weaker(
    ground: Ground, proposer: PinningProposer, kind: str | None
) -> Iterator[PinningRequest]:
    """Requests with one thing given up as far as needed, first what the refutation is about
    (``kind``)."""
    request = ground.request
    if kind == "structure":
        request = replace(request, allowed=with_lacking(ground.problem, request.allowed))
        yield request
        yield replace(request, pins=None if request.pins is None else FEWEST)
    if kind == "pins":
        yield replace(request, pins=FEWEST)
    if request.caps and proposer.fastest(request.allowed, MOST_CAPS) > float(request.rate):
        low, high = 1.0, MOST_CAPS  # by how much all caps have to grow, about and a little more
        while high > low * 1.001:
            middle = math.sqrt(low * high)
            enough = proposer.fastest(request.allowed, middle) > float(request.rate)
            low, high = (low, middle) if enough else (middle, high)
        factor = Fraction(high * 1.001)
        yield replace(
            request, caps={i: rounded_up(cap * factor, digits=4) for i, cap in request.caps.items()}
        )
    fastest = proposer.fastest(request.allowed, 1.0)
    for part in (0.99, 0.9) if 0 < fastest < math.inf else ():
        rate = claimed(shorten(fastest * part, digits=3))
        if 0 < rate < request.rate:
            yield replace(request, rate=rate)
    if len(request.allowed) < ground.problem.n:
        yield replace(request, allowed=tuple(range(ground.problem.n)))


def with_lacking(problem: Problem, allowed: Sequence[int]) -> tuple[int, ...]:
    """The ``allowed`` agents, and all of every group that has none of them."""
    groups = decide.structure_of(problem, allowed).groups
    return tuple(
        sorted({*allowed, *(i for group in groups if not set(allowed) & set(group) for i in group)})
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Starts |e|_inf <= radius and |eps_i| <= disturbance.

    ``rho``: the box of the certificate, with room for the observer; None for linear couplings,
    where every start is covered.  ``error`` and ``W``: the observer's part where disturbance > 0.
    """

    radius: Fraction
    rho: Fraction | None
    disturbance: Fraction = Fraction(0)
    error: ErrorBound | None = None
    W: Matrix | None = None

    def __str__(self) -> str:
        errors = f", |eps_i| <= {shown_number(self.disturbance)}" if self.disturbance else ""
        return f"|e_i| <= {shown_number(self.radius)}{errors}"


def search_region(problem: Problem, request: PinningRequest, region: Any) -> PinningDesign:
    """Decide a request over a radius, or [region] (True); with a slower one.  Raises: SpecError for
    another region."""
    if region is True:
        asked = _file_region(problem, request)
    else:
        cure = "Give the largest |e_i| of a start, or True for the problem's [region]."
        radius = read_positive(region, "region", why=", because it is a radius", cure=cure)
        asked = Region(radius=radius, rho=None if problem.is_linear else radius)
    design = _region_attempt(problem, request, asked)
    slow = {each.kind for each in design.statements} & {"gains", "rate", "max_gain"}
    for halvings in range(1, SLOWER + 1 if slow and design.verdict is not Verdict.PROVED else 1):
        rate = claimed(shorten(request.rate / 2**halvings, digits=3))
        nearest = _region_attempt(problem, replace(request, rate=rate), asked)
        if nearest.verdict is Verdict.PROVED:
            return replace(design, nearest=nearest)
    return design


def _file_region(problem: Problem, request: PinningRequest) -> Region:
    if problem.region is None:
        text = "region = True means the [region] of the problem, and there is none."
        raise SpecError(text, key="region", cure="Give a radius, or a [region].")
    radius, disturbance = (
        max(*asked_radius(problem), SMALLEST),
        problem.region.initial_disturbance or Fraction(0),
    )
    exosystem, W = problem.joint_exosystem, problem.joint_observer.W
    if not disturbance or exosystem is None:
        return Region(radius=radius, rho=None if problem.is_linear else radius)
    if W is None:
        text = "observer.W is needed, because the [region] has an initial_disturbance."
        raise SpecError(text, key="observer.W", cure="Design W first, with design_observer.")
    error = propose_error_bound(exosystem, W, rate=float(request.rate))
    if error is None:
        text = (
            "rate must be below the decay rate of the observer, because V = N + kappa E is to "
            "reach it; got"
        )
        raise SpecError(
            f"{text} {shown_number(request.rate)}.",
            key="rate",
            cure="Ask for less, or for a faster W.",
        )
    rho = None if problem.is_linear else radius_needed(radius, error, disturbance)
    return Region(radius=radius, rho=rho, disturbance=disturbance, error=error, W=W)


def _region_attempt(problem: Problem, request: PinningRequest, asked: Region) -> PinningDesign:
    structure, most = decide.structure_of(problem, request.allowed), request.pins
    bare = changed_problem(problem, {"pinning.gains": None})
    limits: dict[str, Any] = {"allowed": request.allowed, "caps": request.caps, "pins": most}
    obstacle = decide.structural_obstacle(problem, most, structure) or _unordered(bare, request)
    obstacle = obstacle or decide.too_fast(problem, request.rate, **limits, propose=slow_directions)
    if obstacle is not None:
        return without_gains(request, structure, obstacle, radius=asked.radius)
    found = _on(bare, request, asked, structure, request.allowed)
    if (
        found.verdict is not Verdict.PROVED
        or most is None
        or (most != FEWEST and len(found.gains) <= int(most))
    ):
        return found

    def on_heaviest(pins: int) -> PinningDesign:
        """On the agents that carry most of the gains without the limit; each group needs one."""
        gains = [found.gains.get(label, 0) for label in bare.network.labels]
        order = sorted(request.allowed, key=lambda i: (-gains[i], i))
        chosen: list[int] = []
        for group in (*structure.groups, *([i] for i in order)):
            if not set(group) & set(chosen):
                chosen.append(next(i for i in order if i in group))
        return _on(bare, request, asked, structure, chosen[:pins])

    if most != FEWEST:
        fewer = on_heaviest(int(most))
        text = (
            f"no {most} of the allowed agents were found with which the certificate reaches "
            "the rate"
        )
        text += f" {shown_number(request.rate)} over the region; {len(found.gains)} agents do."
        none = without_gains(request, structure, undecided("pins", text), radius=asked.radius)
        return fewer if fewer.verdict is Verdict.PROVED else none
    low, least = max(1, structure.least), str(structure.least)
    while low < len(found.gains):
        middle = (low + len(found.gains)) // 2
        fewer = on_heaviest(middle)
        low, found = (low, fewer) if fewer.verdict is Verdict.PROVED else (middle + 1, found)
    pins = len(found.gains)
    if pins <= max(1, structure.least):
        fewest = proved(
            "pins", f"No fewer than {counted(pins, 'pinned agent')} can do.", least=least
        )
    else:
        text = (
            f"{pins} pinned agents do; at least {least} are needed, and fewer than {pins} were "
            "not found."
        )
        fewest = undecided("pins", text, least=least)
    return replace(found, statements=(*found.statements, fewest))


def _unordered(bare: Problem, request: PinningRequest) -> Statement | None:
    """A proof that no v exists for any radius, whatever the gains: agents that no order serves."""
    if not acts_by_component(bare):
        return None
    labels = bare.network.labels
    held = changed_problem(
        bare, {"pinning.gains": {labels[i]: Fraction(1) for i in request.allowed}}
    )
    stuck = stuck_agents(held)
    if not stuck:
        return None
    names = [labels[i] for i in stuck]
    modes = f" ({', '.join(dict.fromkeys(stuck.values()))})" if len(bare.network.modes) > 1 else ""
    text = "no gains on the allowed agents have a max-separable certificate, of any radius: each of"
    text += (
        f" {name_agents(names)} may not be pinned and in one of the modes hears nobody but "
        f"these{modes}."
    )
    return refuted("ordering", text, agents=", ".join(names[:50]))


def _on(
    bare: Problem,
    request: PinningRequest,
    asked: Region,
    structure: Structure,
    agents: Sequence[int],
) -> PinningDesign:
    """Cheap gains on these agents with a certificate of the whole region, for every switching; or
    why not."""
    without = partial(without_gains, request, structure, radius=asked.radius)
    if not acts_by_component(bare):
        text = (
            "does not apply: the max-separable certificate is for couplings that act on each "
            "state component by"
        )
        return without(undecided("method", f"{text} itself."))
    try:  # whatever v is, |e_j - e_i| reaches 2 rho at least
        separable.coupling_profiles(bare, (Fraction(1),) * bare.n, rho=asked.rho)
    except UndefinedError as error:
        return without(undecided("method", f"does not apply: {error}"))
    labels, limited = bare.network.labels, replace(request, allowed=tuple(sorted(agents)))
    for tilt in BOX_TILTS:
        for v, proposed in propose_for_box(
            bare, limited, rho=asked.rho, rate=float(request.rate * (1 + tilt))
        ):
            gains = typed_gains(
                dict(enumerate(proposed.tolist())), digits=request.digits, caps=request.caps
            )
            held = changed_problem(
                bare, {"pinning.gains": {labels[i]: k for i, k in gains.items()}}
            )
            claim = Separable(v=v, alpha=request.rate, rho=asked.rho)
            if gains and separable.verify_separable(held, claim).verdict is Verdict.PROVED:
                return _covered(
                    request, asked, structure, gains, held, replace(claim, error=asked.error)
                )
    where = "" if asked.rho is None else f" over |e_i| <= {shown_number(asked.rho)}"
    text = (
        "no gains on the allowed agents were found with which the max-separable certificate "
        "reaches the rate"
    )
    text += f" {shown_number(request.rate)}{where}, and no proof that there are none."
    return without(undecided("gains", text))


def _covered(
    request: PinningRequest,
    asked: Region,
    structure: Structure,
    gains: Gains,
    held: Problem,
    claim: Separable,
) -> PinningDesign:
    """The design whose rows are proved, if the observer's part is as well and the box holds the
    region."""
    wrong = ""
    if asked.error is not None:
        decided = separable.verify_composite(held, asked.W, claim)
        wrong = "" if decided.verdict is Verdict.PROVED else f": {decided.reason}"
    reaches = separable.covers(claim, radius=asked.radius, disturbance=asked.disturbance)
    if wrong or not reaches or separable.composite_rate(claim) < request.rate:
        obstacle = undecided("observer", f"the observer's part is not proved{wrong or '.'}")
        return without_gains(request, structure, obstacle, radius=asked.radius)
    part = " plus the observer's part" if asked.error is not None else ""
    still = ", with eps = 0" if asked.error is None else ""
    rate, radius = number_text(request.rate), number_text(asked.radius)
    text = (
        f"max_i |e_i|/v_i (v from 1 to {float(max(claim.v)):.4g}){part} decays from every "
        f"start {asked}{still}, at"
    )
    text += f" the rate {rate}, for the gains as they are written."
    design, region = (
        _with_gains(request, structure, gains, held, f" over {asked}"),
        {"rate": rate, "radius": radius},
    )
    found = replace(
        design,
        statements=(proved("region", text, **region),),
        certificate=claim,
        radius=asked.radius,
    )
    return replace(found, reason=f"{design.reason}.")
