"""From which starts a certificate proves consensus: its regional claims side by side, with what was
asked for.

Nothing is decided here.  Sizes and rates are rounded down, times and what is asked up: what is
shown stays a claim that holds.  Theory, sections 1, 4 and 5.
"""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from fractions import Fraction

from dobc_design._checks import noun, positional
from dobc_design._show.cards import Card, Headed
from dobc_design._show.text import (
    significant,
    significant_away_from_zero,
    significant_towards_zero,
    with_unit,
)
from dobc_design.conditions.check import Check, Checks
from dobc_design.conditions.coverage import asked_radius, covers
from dobc_design.conditions.domain import EVERYWHERE, Around, Box
from dobc_design.conditions.kinds import KINDS
from dobc_design.conditions.numbers import (
    LARGEST,
    as_json,
    claimed,
    fields_to_json,
    rounded_down,
    rounded_up,
)
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.schedule.claim import SETTLED, Descent
from dobc_design.conditions.separable.claim import Separable, largest_reach
from dobc_design.conditions.stated import knows_readings
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import ZERO, root_above, root_below
from dobc_design.exact.reading import Document
from dobc_design.loop.arcs import tied
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .bounds import Starts, envelope_of, error_share
from .claims import Claims, claim_of, reading_claims


@noun
class Asked:
    """The region of the problem: |e|_inf <= box, which the ball |e| <= ball holds; |eps_i| <=
    disturbance.

    ``interval``: the states x_i(0) asked for where they have one component, else None.
    """

    box: float
    ball: float
    disturbance: float
    interval: tuple[float, float] | None = None


@noun
class RegionClaim:
    """What one condition says about starts.

    ``kind``: "everywhere", "box", "ball", "near" (local, no radius) or "none" (nothing proved).
    Every start with |e|_inf <= box is covered, and every one with |e| <= ball (Euclidean, all
    agents stacked), where |eps_i| <= ``disturbance``.  ``rate`` in 1/s, with its ``factor``.
    ``time`` (s): from then on |e|_inf <= the tolerance. ``limit``: why no more.
    """

    id: str
    variant: str
    verdict: Verdict
    kind: str
    box: float | None = None
    ball: float | None = None
    disturbance: float | None = None
    rate: float | None = None
    factor: float | None = None
    time: float | None = None
    covers: bool = False
    limit: str = ""

    @property
    def starts(self) -> str:
        """What its starts are called."""
        words = {"everywhere": "every start", "near": "near the target, no radius", "none": "–"}
        return words.get(self.kind, self.kind)

    @property
    def method(self) -> str:
        """The name of the method for people."""
        name = KINDS[self.id].short
        return f"{name}, {self.variant.replace('P_e', 'Pₑ')}" if self.variant else name

    def to_json(self) -> Document:
        return {**asdict(self), "verdict": self.verdict.value}


@noun
class AgentBound:
    """One agent of the max-separable certificate: starts with |e_i| <= bound for all agents at once
    are covered.

    ``goal``: where it is to go, None with several state components.
    """

    label: str
    bound: float
    pinned: bool
    goal: float | None = None


@noun
class Regions(Headed):
    """The certified regions of one problem, in the order in which they were tried.

    ``tolerance`` belongs to the times of ``claims`` (same unit as the states); ``agents`` to the
    max-separable certificate, empty without one, above 2000 agents, and where agents ``agree`` on a
    value: |e| is of their differences then.  The others are the checks of these ids.
    """

    name: str
    verdict: Verdict
    reason: str
    asked: Asked | None
    tolerance: float | None
    claims: tuple[RegionClaim, ...]
    agents: tuple[AgentBound, ...]
    delay: Check | None = None
    sampling: Check | None = None
    settling: Check | None = None
    equilibrium: Check | None = None
    unit: str = ""  # of the states, where all components share one
    goal: str = "target"  # as of a loop: what |e| measures

    @property
    def agree(self) -> bool:
        """Whether errors are differences of agents."""
        return self.goal in ("differences", "roots")

    @property
    def tried(self) -> bool:
        """Whether a region was asked for, or anything was said about one."""
        others = any(claim.kind != "near" for claim in self.claims)
        return self.asked is not None or others or self.equilibrium is not None

    @property
    def sized(self) -> bool:
        """Whether there is anything to be drawn: a region asked for, or one that is proved."""
        proved = any(claim.kind not in ("near", "none") for claim in self.claims)
        return self.asked is not None or proved

    @property
    def rest(self) -> float | None:
        """About how far from the goals another equilibrium lies, |e|_inf, where one is proved."""
        found = self.equilibrium
        if found is None or found.verdict is not Verdict.REFUTED or found.witness is None:
            return None
        sizes = [abs(float(Fraction(value))) for value in found.witness.values or ()]
        return max(sizes, default=None)

    def to_json(self) -> Document:
        """JSON object: numbers rounded towards the weaker claim."""
        asked = None
        if self.asked is not None:
            asked = fields_to_json(self.asked, "box", "ball", "disturbance")
        return {
            "asked": asked,
            "tolerance": self.tolerance,
            "regions": as_json(self.claims),
            "agents": [fields_to_json(each, "label", "bound", "pinned") for each in self.agents],
            **fields_to_json(self, *BESIDE),
        }

    def _card(self) -> Card:
        rows: list[list[str]] = []
        for claim in self.claims:
            title = ", ".join(filter(None, [claim.id, claim.variant]))
            box = with_unit(significant_towards_zero(claim.box), self.unit)
            ball = with_unit(significant_towards_zero(claim.ball), self.unit)
            rate = significant_towards_zero(claim.rate)
            factor = significant_away_from_zero(claim.factor)
            covers = "yes" if claim.covers else "no"
            if self.asked is None:
                covers = ""
            rows.append([title, claim.kind, box, ball, rate, factor, covers])
        sizes = ("|e|_inf <=", "|e| <=")
        if self.agree:
            sizes = ("all |x_i - x_j| <=", "Euclidean norm of all <=")
        heads = ("method", "kind", *sizes, "rate 1/s", "factor", "covers")
        verdict = self.verdict.value
        return Card(title=self.name, verdict=verdict, text=self.reason, heads=heads, rows=rows)


# checks that stand beside the regions
BESIDE = ("settling", "delay", "sampling", "equilibrium")
#: Agents up to which the bound of each is listed.
MOST_AGENTS = 2000
_DIGITS, _UNIT = 6, 10**9


def certified_regions(loop: Loop, claims: Claims) -> Regions:
    """Gather what ``claims``, which are about ``problem``, say about starts, taken as they are.

    Raises: CertificateError for claims that cannot be read, as in a file that somebody else wrote.
    """
    asked = _asked(loop)
    beside = {check.id: check for check in claims.checks if check.id in BESIDE}
    with reading_claims():
        known: list[Check] = []
        for check in claims.checks:
            known.append(replace(check, claim=claim_of(check, loop, claims.W)))
        tolerance = _tolerance(known, asked)
        gatherer = _Gatherer(loop, known, asked, tolerance)
        chosen = list(_chosen(loop, known))
        separable = [check for check in chosen if isinstance(check.claim, Separable)]
        apart = loop.is_apart
        return Regions(
            name=loop.name,
            verdict=claims.verdict,
            reason=claims.reason,
            asked=asked,
            tolerance=tolerance,
            claims=tuple(map(gatherer.claim, chosen)),
            agents=_agents(loop, separable[0]) if separable and not apart else (),
            goal=loop.goal,
            settling=beside.get("settling"),
            delay=beside.get("delay"),
            sampling=beside.get("sampling"),
            equilibrium=beside.get("equilibrium"),
            unit=loop.unit,
        )


def _tolerance(checks: Checks, asked: Asked | None) -> float | None:
    """That of a proved settling time, so that all times are about the same; else a part of the
    radius."""
    # Whoever asked for a settling time named the tolerance.
    for check in checks:
        if check.is_proved and isinstance(check.claim, Descent):
            return _down(check.claim.tolerance)
    radii: list[Fraction] = []
    for check in checks:
        proved = check.is_proved and check.kind.is_consensus
        if proved and isinstance(check.domain, Around):
            radii.append(claimed(check.domain.radius))
    size = min(radii, default=None) if asked is None else claimed(asked.box)
    return _down(size * SETTLED) if size else None


def _chosen(loop: Loop, checks: Checks) -> Iterator[Check]:
    """The checks of Lemma 1 (once for all modes, only without disturbance), of the theorems and of
    regions."""
    lemmas = [check for check in checks if check.kind.is_lemma]
    open_lemmas = [check for check in lemmas if not check.is_proved]
    speaker: Check | None = None  # for all modes: the first that is not proved, or the slowest
    if open_lemmas:
        speaker = open_lemmas[0]
    elif lemmas:
        speaker = min(lemmas, key=lambda check: check.rate or 0.0)
    for check in checks:
        if check.kind.is_lemma and (loop.groups or check is not speaker):
            continue
        if check.kind.role in ("paper", "region"):
            yield check


def _asked(loop: Loop) -> Asked | None:
    if loop.starts is None:
        return None
    reach = asked_radius(loop)
    square = sum((r * r for r in reach), ZERO)
    length = root_above(loop.n * square, unit=_UNIT)
    interval: tuple[float, float] | None = None
    if loop.m == 1 and not loop.goals.moves and not loop.gap:
        low, high = loop.starts.states[0]
        interval = _nearest(low), _nearest(high)
    return Asked(
        box=_up(max(reach)),
        ball=_up(length, digits=9),
        disturbance=_up(loop.starts.disturbance or ZERO),
        interval=interval,
    )


@positional
class _Gatherer:
    loop: Loop
    checks: Checks
    asked: Asked | None
    tolerance: float | None

    def claim(self, check: Check) -> RegionClaim:
        """What a check says about starts."""
        kind = "none"
        box = ball = disturbance = rate = None
        domain = check.domain
        if check.is_proved:
            rate = check.rate
            kind = {"global": "everywhere", "consensus": "near"}.get(str(domain), "none")
            if isinstance(domain, Around):
                kind = str(domain.kind)
                disturbance = float(domain.disturbance)
                box = ball = float(domain.radius)
                if kind == "ball":  # the corners of a box are the farthest from its middle
                    states = self.loop.n * self.loop.m
                    box = _down(root_below(claimed(ball) ** 2 / states, unit=_UNIT))
        variant = ""
        # which quadratic certificate a ``lure`` check holds
        lure = check.claim
        if isinstance(lure, Lure):
            variant = f"P_e {lure.shape}"
        # Without a region nothing is asked that could be covered.
        covering = False
        late = self.loop.timing is not None and not knows_readings(check)
        if kind != "none" and self.asked is not None and not late:
            covering = covers(self.loop, check, self.checks)
        limit = "" if covering else self._limit(check, kind)
        if late and check.is_proved:
            limit = "It is about readings of the same instant."
        return RegionClaim(
            id=check.id,
            variant=variant,
            verdict=check.verdict,
            kind=kind,
            box=box,
            ball=ball,
            disturbance=disturbance,
            rate=rate,
            factor=check.factor,
            time=None if late else self._time(check),
            covers=covering,
            limit=limit,
        )

    def _time(self, check: Check) -> float | None:
        """When |e|_inf <= tolerance at the latest, by the bound of the check alone; None where it
        gives none."""
        asked = self.asked
        domain = check.domain
        starts = None
        if isinstance(domain, Around):
            radius = claimed(domain.radius)
            ball = radius
            if isinstance(domain, Box):  # whose corners are farther away
                ball = root_above(self.loop.size * radius**2, unit=_UNIT)
            starts = Starts(radius, ball, claimed(domain.disturbance))
        elif asked is not None and domain == EVERYWHERE:
            starts = Starts(claimed(asked.box), claimed(asked.ball), claimed(asked.disturbance))
        if not check.is_proved or starts is None or self.tolerance is None:
            return None
        # In floating point, and a little more: a time that is shown has to be late enough.
        bound = None
        with suppress(ValueError):  # too close to a singular matrix
            bound = envelope_of(self.loop, check, check.claim, starts)
        # A bound that does not fall never reaches the tolerance.
        if bound is None or not bound.rate:
            return None
        steps = math.log(bound.height / claimed(self.tolerance)) / float(bound.rate)
        return _up(Fraction(max(0.0, steps) * (1 + 1e-9)), digits=4)

    def _limit(self, check: Check, kind: str) -> str:
        """Why it says no more."""
        if kind in ("box", "ball"):
            return " ".join(filter(None, [check.remark, self._turning(check)]))
        if kind == "near":
            return "It is local: it holds close enough to the target and states no radius."
        return check.reason if kind == "none" else ""

    def _turning(self, check: Check) -> str:
        """Where a coupling does not rise with the distance, neighbours pull less the farther they
        are."""
        claim = check.claim
        if not isinstance(claim, Separable) or claim.T is not None or claim.rho is None:
            return ""
        reaches = largest_reach(self.loop, claim.v)
        # Only where both agents of an arc stand at opposite faces is the difference that large.
        for coupling, reach in zip(self.loop.functions, reaches, strict=True):
            if not reach or not coupling.by_component:
                continue
            try:
                if profile(Curve(coupling.components[0]), claim.rho * reach).is_nondecreasing:
                    continue
            except UndefinedError:
                return ""
            far = significant(float(claim.rho * reach))
            return (
                f"Two agents in this box may differ by {far}, and on such distances "
                f"h = {coupling.texts[0]} does not rise throughout: a neighbour farther "
                "away pulls less."
            )
        return ""


def _agents(loop: Loop, check: Check) -> tuple[AgentBound, ...]:
    claim = check.claim
    domain = check.domain
    if not isinstance(domain, Around) or not isinstance(claim, Separable):
        return ()
    if claim.T or claim.rho is None or loop.n > MOST_AGENTS:
        return ()
    # What estimation errors may take of V is not there for |e_i| <= room v_i.
    room = claim.rho - error_share(claim, claimed(domain.disturbance), unit=_UNIT)
    radius = float(domain.radius)
    # Goals of several components, that move with a leader, or between fixed nodes, are no single
    # number.
    pinned = tied(loop) | set(loop.pulls.nodes)
    has_goals = loop.m == 1 and not loop.goals.moves and not loop.gap
    found: list[AgentBound] = []
    for agent, (label, weight) in enumerate(zip(loop.labels, claim.v, strict=True)):
        goal = _nearest(loop.goals.of(agent)[0]) if has_goals else None
        bound = max(radius, _down(room * weight))  # rounding may not take back the domain
        found.append(AgentBound(label=label, bound=bound, pinned=agent in pinned, goal=goal))
    return tuple(found)


def _down(value: Fraction) -> float:
    return float(rounded_down(min(value, LARGEST), digits=_DIGITS))


def _up(value: Fraction, digits: int = _DIGITS) -> float:
    return float(rounded_up(min(value, LARGEST), digits=digits))  # no region is as large


def _nearest(value: Fraction) -> float:
    return float(max(-LARGEST, min(value, LARGEST)))
