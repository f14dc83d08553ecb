"""From which starts a certificate proves consensus: its regional claims side by side, with what was
asked for.

Nothing is decided here.  Sizes and rates are rounded down, times and what is asked up: what is
shown stays a claim that holds.  Theory, sections 1, 4 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import Any, Final

from dobc_design._show.cards import Card, Headed
from dobc_design._show.text import significant, significant_away_from_zero, significant_towards_zero
from dobc_design.certificate.bounds import Starts, envelope_of, error_share
from dobc_design.certificate.claims import Claims, claim_of, reading_claims
from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import asked_radius, covers
from dobc_design.conditions.kinds import KINDS
from dobc_design.conditions.numbers import LARGEST, claimed, rounded_down, rounded_up
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.schedule.claim import SETTLED, Descent
from dobc_design.conditions.separable.claim import Separable, largest_reach
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import root_above, root_below
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """The region of the problem: |e|_inf <= box, which the ball |e| <= ball holds; |eps_i| <=
    disturbance.

    ``interval``: the states x_i(0) asked for where they have one component, else None.
    """

    box: float
    ball: float
    disturbance: float
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
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

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "verdict": self.verdict.value}


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentBound:
    """One agent of the max-separable certificate: starts with |e_i| <= bound for all agents at once
    are covered.

    ``goal``: where it is to go, None with several state components.
    """

    label: str
    bound: float
    pinned: bool
    goal: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Regions(Headed):
    """The certified regions of one problem, in the order in which they were tried.

    ``tolerance`` belongs to the times of ``claims`` (same unit as the states); ``agents`` to the
    max-separable certificate, empty without one or above 2000 agents.  The others are the checks of
    these ids.
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

    @property
    def tried(self) -> bool:
        """Whether a region was asked for, or anything was said about one."""
        others = any(claim.kind != "near" for claim in self.claims)
        return self.asked is not None or others or self.equilibrium is not None

    @property
    def sized(self) -> bool:
        """Whether there is anything to be drawn: a region asked for, or one that is proved."""
        return self.asked is not None or any(
            claim.kind not in ("near", "none") for claim in self.claims
        )

    @property
    def rest(self) -> float | None:
        """About how far from the goals another equilibrium lies, |e|_inf, where one is proved."""
        found = self.equilibrium
        if found is None or found.verdict is not Verdict.REFUTED or found.witness is None:
            return None
        return max(
            (abs(float(Fraction(value))) for value in found.witness.values or ()), default=None
        )

    def to_json(self) -> dict[str, Any]:
        """JSON object: numbers rounded towards the weaker claim."""
        a, checks = self.asked, {name: getattr(self, name) for name in BESIDE}
        return {
            "asked": None
            if a is None
            else {"box": a.box, "ball": a.ball, "disturbance": a.disturbance},
            "tolerance": self.tolerance,
            "regions": [claim.to_json() for claim in self.claims],
            "agents": [
                {"label": a.label, "bound": a.bound, "pinned": a.pinned} for a in self.agents
            ],
            **{name: None if check is None else check.to_json() for name, check in checks.items()},
        }

    def _card(self) -> Card:
        rows = []
        for claim in self.claims:
            sizes = [significant_towards_zero(claim.box), significant_towards_zero(claim.ball)]
            yes = "yes" if claim.covers else "no" if self.asked is not None else ""
            title = ", ".join(filter(None, [claim.id, claim.variant]))
            bound = [significant_towards_zero(claim.rate), significant_away_from_zero(claim.factor)]
            rows.append([title, claim.kind, *sizes, *bound, yes])
        heads = ("method", "kind", "|e|_inf <=", "|e| <=", "rate 1/s", "factor", "covers")
        return Card(
            title=self.name, verdict=self.verdict.value, text=self.reason, heads=heads, rows=rows
        )


# checks that stand beside the regions
BESIDE: Final = ("settling", "delay", "sampling", "equilibrium")
#: Agents up to which the bound of each is listed.
MOST_AGENTS: Final = 2000
_DIGITS, _UNIT = 6, 10**9


def certified_regions(problem: Problem, claims: Claims) -> Regions:
    """Gather what ``claims``, which are about ``problem``, say about starts, taken as they are.

    Raises: CertificateError for claims that cannot be read, as in a file that somebody else wrote.
    """
    asked, beside = (
        _asked(problem),
        dict[str, Any]((check.id, check) for check in claims.checks if check.id in BESIDE),
    )
    with reading_claims():
        known = tuple(
            replace(check, claim=claim_of(check, problem, claims.W)) for check in claims.checks
        )
        tolerance = _tolerance(known, asked)
        gatherer = _Gatherer(problem, known, asked, tolerance)
        chosen = list(_chosen(problem, known))
        return Regions(
            name=problem.name,
            verdict=claims.verdict,
            reason=claims.reason,
            asked=asked,
            tolerance=tolerance,
            claims=tuple(gatherer.claim(check) for check in chosen),
            agents=next(
                (_agents(problem, check) for check in chosen if isinstance(check.claim, Separable)),
                (),
            ),
            **beside,
        )


def _tolerance(checks: Sequence[Check], asked: Asked | None) -> float | None:
    """That of a proved settling time, so that all times are about the same; else a part of the
    radius."""
    for check in checks:
        if check.verdict is Verdict.PROVED and isinstance(check.claim, Descent):
            return _down(check.claim.tolerance)
    proved = [
        check for check in checks if check.verdict is Verdict.PROVED and check.kind.is_consensus
    ]
    radii = [
        claimed(check.domain["radius"]) for check in proved if isinstance(check.domain, Mapping)
    ]
    size = min(radii, default=None) if asked is None else claimed(asked.box)
    return _down(size * SETTLED) if size else None


def _chosen(problem: Problem, checks: Sequence[Check]) -> Iterator[Check]:
    """The checks of Lemma 1 (once for all modes, only without disturbance), of the theorems and of
    regions."""
    lemmas = [check for check in checks if check.id == "lemma1"]
    for check in checks:
        if check.kind.role not in ("paper", "region"):
            continue
        if check.id == "lemma1":
            worst = [each for each in lemmas if each.verdict is not Verdict.PROVED]
            speaker = worst[0] if worst else min(lemmas, key=lambda each: each.rate or 0.0)
            if problem.groups or check is not speaker:
                continue
        yield check


def _asked(problem: Problem) -> Asked | None:
    if problem.region is None:
        return None
    reach = asked_radius(problem)
    low, high = problem.region.initial_states[0]
    length = root_above(problem.n * sum((r * r for r in reach), Fraction(0)), unit=_UNIT)
    return Asked(
        box=_up(max(reach)),
        ball=_up(length, digits=9),
        disturbance=_up(problem.region.initial_disturbance or Fraction(0)),
        interval=None if problem.m > 1 or problem.leader else (_nearest(low), _nearest(high)),
    )


@dataclass(frozen=True, slots=True)
class _Gatherer:
    problem: Problem
    checks: Sequence[Check]
    asked: Asked | None
    tolerance: float | None

    def claim(self, check: Check) -> RegionClaim:
        kind = "none"
        box = ball = disturbance = None
        if check.verdict is Verdict.PROVED:
            kind = {"global": "everywhere", "consensus": "near"}.get(str(check.domain), "none")
            if isinstance(check.domain, Mapping):
                kind, disturbance = str(check.domain["kind"]), float(check.domain["disturbance"])
                box = ball = float(check.domain["radius"])
                if kind == "ball":  # the corners of a box are the farthest from its middle
                    box = _down(
                        root_below(
                            claimed(ball) ** 2 / (self.problem.n * self.problem.m), unit=_UNIT
                        )
                    )
        covering = (
            kind != "none" and self.asked is not None and covers(self.problem, check, self.checks)
        )
        return RegionClaim(
            id=check.id,
            variant=_variant(check),
            verdict=check.verdict,
            kind=kind,
            box=box,
            ball=ball,
            disturbance=disturbance,
            rate=check.rate if check.verdict is Verdict.PROVED else None,
            factor=check.factor,
            time=self._time(check),
            covers=covering,
            limit=self._limit(check, kind, covering=covering),
        )

    def _time(self, check: Check) -> float | None:
        """When |e|_inf <= tolerance at the latest, by the bound of the check alone; None where it
        gives none."""
        asked, starts = self.asked, None
        if isinstance(check.domain, Mapping):
            starts = Starts(
                *(claimed(check.domain[name]) for name in ("radius", "radius", "disturbance"))
            )
        elif asked is not None and check.domain == "global":
            starts = Starts(claimed(asked.box), claimed(asked.ball), claimed(asked.disturbance))
        if check.verdict is not Verdict.PROVED or starts is None or self.tolerance is None:
            return None
        bound = None
        with suppress(ValueError):  # too close to a singular matrix
            bound = envelope_of(self.problem, check, check.claim, starts)
        if bound is None or not bound.rate:
            return None
        steps = math.log(bound.height / claimed(self.tolerance)) / float(bound.rate)
        return _up(Fraction(max(0.0, steps) * (1 + 1e-9)), digits=4)

    def _limit(self, check: Check, kind: str, *, covering: bool) -> str:
        if kind in ("box", "ball") and not covering:
            return " ".join(filter(None, [check.remark, self._turning(check)]))
        near = "It is local: it holds close enough to the target and states no radius."
        return "" if covering else {"near": near, "none": check.reason}.get(kind, "")

    def _turning(self, check: Check) -> str:
        """Where a coupling does not rise with the distance, neighbours pull less the farther they
        are."""
        claim = check.claim
        if not isinstance(claim, Separable) or claim.T is not None or claim.rho is None:
            return ""
        reaches = largest_reach(self.problem, claim.v)
        for coupling, reach in zip(self.problem.couplings, reaches, strict=True):
            if not reach or not coupling.by_component:
                continue
            try:
                if profile(Curve(coupling.components[0]), claim.rho * reach).is_nondecreasing:
                    continue
            except UndefinedError:
                return ""
            far = (
                "Two agents in this box may differ by "
                f"{significant(float(claim.rho * reach))}, and on such distances"
            )
            return (
                f"{far} h = {coupling.texts[0]} does not rise throughout: a neighbour farther "
                "away pulls less."
            )
        return ""


def _variant(check: Check) -> str:
    """Which quadratic certificate a ``lure`` check holds."""
    if not isinstance(check.claim, Lure):
        return ""
    method = {"interval": "interval bound, ", "vertices": "corners, "}.get(check.claim.method, "")
    return f"{method}P_e {'= c I' if check.claim.shape == 'identity' else check.claim.shape}"


def _agents(problem: Problem, check: Check) -> tuple[AgentBound, ...]:
    claim, domain = check.claim, check.domain
    if (
        not isinstance(domain, Mapping)
        or not isinstance(claim, Separable)
        or claim.T
        or claim.rho is None
    ):
        return ()
    if problem.n > MOST_AGENTS:
        return ()
    room = claim.rho - error_share(claim, claimed(domain["disturbance"]), unit=_UNIT)
    pinned = set(problem.pinning.agents)
    # Rounding may not take back what the domain claims.
    bounds = [max(float(domain["radius"]), _down(room * weight)) for weight in claim.v]
    moving = problem.m > 1 or problem.leader is not None
    goals = [None if moving else _nearest(problem.goal_of(agent)[0]) for agent in range(problem.n)]
    rows = enumerate(zip(problem.network.labels, bounds, goals, strict=True))
    return tuple(
        AgentBound(label=a, bound=bound, pinned=k in pinned, goal=goal)
        for k, (a, bound, goal) in rows
    )


def _down(value: Fraction) -> float:
    return float(rounded_down(min(value, LARGEST), digits=_DIGITS))


def _up(value: Fraction, digits: int = _DIGITS) -> float:
    return float(rounded_up(min(value, LARGEST), digits=digits))  # no region is as large


def _nearest(value: Fraction) -> float:
    return float(max(-LARGEST, min(value, LARGEST)))
