"""From which starts a certificate proves consensus: its regional claims gathered, with what was asked for.

Nothing is decided here, and nothing is shown that does not follow from the proved claims.  Theory, sections 1, 4 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from typing import Any, Final

from dobc_design._show.text import significant
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.regions import AgentBound, Asked, RegionClaim, Regions
from dobc_design.conditions.check import CONSENSUS_IDS, Check
from dobc_design.conditions.coverage import asked_radius, covers
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic.decide import eigenvalue_bound
from dobc_design.conditions.schedule.checks import settling_of
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.separable.checks import separable_from_json
from dobc_design.conditions.separable.claim import Separable, largest_reach
from dobc_design.coupling.enclosures import Curve, profile
from dobc_design.errors import CertificateError
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import root_above, root_below
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: Checks that are about one P of the problem file, or about one mode only, are left to the list of checks.
_LEFT_OUT: Final = ("theorem1-printed", "theorem2-printed")
#: Quadratic certificates, with the name of the largest level of V that they prove.
_LEVELS: Final = {"lure": "level", "exhaustive": "outer"}
#: A start counts as settled when every |e_ic| is below this part of the radius.
SETTLED: Final = Fraction(1, 100)
#: Agents up to which the bound of each is listed.
MOST_AGENTS: Final = 2000
_DIGITS: Final = 6
_UNIT: Final = 10**9


def certified_regions(problem: Problem, claims: Claims) -> Regions:
    """Gather what ``claims``, which are about ``problem``, say about starts.

    The claims are taken as they are; ``dobc verify`` decides them.
    Raises: CertificateError for claims that cannot be read, as in a file that somebody else wrote.
    """
    with reading_claims():
        return _gathered(problem, claims)


def certified_settling(problem: Problem, claims: Claims) -> Settling | None:
    """The settling time that ``claims`` prove, with its envelope; None without one.  Raises: CertificateError."""
    with reading_claims():
        found = next((check for check in claims.checks if check.id == "settling"), None)
        return settling_of(found, problem, claims.W)


@contextmanager
def reading_claims() -> Iterator[None]:
    """Turn what malformed claims raise into a CertificateError."""
    try:
        yield
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise CertificateError(
            f"a regional check of this certificate cannot be read ({type(error).__name__}: {str(error)[:100]}).",
            key="checks",
            cure="dobc verify says which.",
        ) from error


def _gathered(problem: Problem, claims: Claims) -> Regions:
    asked = _asked(problem)
    tolerance = _tolerance(claims.checks, asked)
    gatherer = _Gatherer(problem, claims.checks, asked, tolerance)
    chosen = list(_chosen(problem, claims.checks))
    separable = next((check for check in chosen if check.id == "max-separable" and check.exact), None)
    by_id = {check.id: check for check in claims.checks}
    return Regions(
        name=problem.name,
        verdict=claims.verdict,
        reason=claims.reason,
        asked=asked,
        tolerance=tolerance,
        claims=tuple(gatherer.claim(check) for check in chosen),
        agents=() if separable is None else _agents(problem, separable),
        delay=by_id.get("delay"),
        sampling=by_id.get("sampling"),
        settling=by_id.get("settling"),
        equilibrium=by_id.get("equilibrium"),
    )


def _tolerance(checks: Sequence[Check], asked: Asked | None) -> float | None:
    """That of a proved settling time, so that all times are about the same; else a part of the radius."""
    for check in checks:
        if check.id == "settling" and check.verdict is Verdict.PROVED and check.exact is not None:
            return _down(read_rational(check.exact["tolerance"]))
    size = _smallest_radius(checks) if asked is None else claimed(asked.box)
    return _down(size * SETTLED) if size else None


def _smallest_radius(checks: Sequence[Check]) -> Fraction | None:
    proved = [check for check in checks if check.verdict is Verdict.PROVED and check.id in CONSENSUS_IDS]
    radii = [claimed(check.domain["radius"]) for check in proved if isinstance(check.domain, Mapping)]
    return min(radii, default=None)


def _chosen(problem: Problem, checks: Sequence[Check]) -> Iterator[Check]:
    """The checks that can prove consensus; Lemma 1 once for all modes, and only where there is no disturbance."""
    lemmas = [check for check in checks if check.id == "lemma1"]
    for check in checks:
        if check.id not in CONSENSUS_IDS or check.id in _LEFT_OUT:
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
    return Asked(
        box=_up(max(reach)),
        ball=_up(root_above(problem.n * sum((r * r for r in reach), Fraction(0)), unit=_UNIT), digits=9),
        disturbance=_up(problem.region.initial_disturbance or Fraction(0)),
        interval=None if problem.m > 1 else _floats(problem.region.initial_states[0]),
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
                    box = _down(root_below(claimed(ball) ** 2 / (self.problem.n * self.problem.m), unit=_UNIT))
        covering = kind != "none" and self.asked is not None and covers(self.problem, check, self.checks)
        return RegionClaim(
            id=check.id,
            variant=_variant(check),
            verdict=check.verdict,
            kind=kind,
            box=box,
            ball=ball,
            disturbance=disturbance,
            rate=check.rate if check.verdict is Verdict.PROVED else None,
            time=self._time(check),
            covers=covering,
            limit=self._limit(check, kind, covering=covering),
        )

    def _time(self, check: Check) -> float | None:
        """When |e|_inf <= tolerance at the latest, by the rate of the check alone; None where it is not known."""
        exact = check.exact or {}
        domain = check.domain
        if check.verdict is not Verdict.PROVED or not check.rate or self.tolerance is None:
            return None
        if check.id == "max-separable":
            start = domain if isinstance(domain, Mapping) else self._asked_box()
            if start is None:
                return None
            claim = separable_from_json(exact, self.problem)
            first = claimed(start["radius"]) / claim.least + _share(claim, claimed(start["disturbance"]))
            ratio, slowness = first * max(claim.v) / claimed(self.tolerance), 1.0
        elif exact.get(_LEVELS.get(check.id, "")) is not None:
            least = -eigenvalue_bound(_weights(exact, self.problem.n * self.problem.m).negated())
            if least <= 0:
                return None
            ratio, slowness = read_rational(exact[_LEVELS[check.id]]) / (least * claimed(self.tolerance) ** 2), 0.5
        else:
            return None
        return _up(Fraction(max(0.0, math.log(ratio)) * slowness / check.rate * (1 + 1e-9)), digits=4)

    def _asked_box(self) -> Mapping[str, float] | None:
        return None if self.asked is None else {"radius": self.asked.box, "disturbance": self.asked.disturbance}

    def _limit(self, check: Check, kind: str, *, covering: bool) -> str:
        if covering or kind == "everywhere":
            return ""
        if kind == "near":
            return "It is local: it holds close enough to the target and names no radius."
        if kind == "none":
            return check.reason
        remark = check.reason.partition(". ")[2]  # the first sentence says what is proved
        return " ".join(filter(None, [remark, self._turning(check)]))

    def _turning(self, check: Check) -> str:
        """Where a coupling does not rise with the distance, neighbours pull less the farther they are."""
        if check.id != "max-separable" or not check.exact:
            return ""
        claim = separable_from_json(check.exact, self.problem)
        reaches = largest_reach(self.problem, claim.v, modes=list(self.problem.network.modes))
        for coupling, reach in zip(self.problem.couplings, reaches, strict=True):
            if claim.rho is None or not reach or not coupling.by_component:
                continue
            try:
                if profile(Curve(coupling.components[0]), claim.rho * reach).is_nondecreasing:
                    continue
            except UndefinedError:
                return ""
            return (
                f"Two agents in this box may differ by {significant(float(claim.rho * reach))}, and on such distances"
                f" h = {coupling.texts[0]} does not rise throughout: a neighbour farther away pulls less."
            )
        return ""


def _variant(check: Check) -> str:
    """Which quadratic certificate a ``lure`` check holds."""
    exact = check.exact or {}
    if check.id != "lure" or "P_e" not in exact:
        return ""
    entries = exact["P_e"]
    full = any(a != b for a, b, _ in entries)
    shape = "full" if full else "diagonal" if len({value for _, _, value in entries}) > 1 else "= c I"
    method = {"interval": "interval bound", "vertices": "corners"}.get(str(exact.get("method")), "")
    return ", ".join(filter(None, [method, f"P_e {shape}"]))


def _weights(exact: Mapping[str, Any], size: int) -> SparseSymmetric:
    return SparseSymmetric(size, {(a, b): read_rational(value) for a, b, value in exact["P_e"]})


def _share(claim: Separable, disturbance: Fraction) -> Fraction:
    """What |eps_i| <= disturbance may take of V: kappa s sqrt(size), rounded up."""
    if claim.error is None:
        return Fraction(0)
    return root_above((claim.error.kappa * disturbance) ** 2 * claim.error.size, unit=_UNIT)


def _agents(problem: Problem, check: Check) -> tuple[AgentBound, ...]:
    if problem.n > MOST_AGENTS or not isinstance(check.domain, Mapping) or check.exact is None:
        return ()
    claim = separable_from_json(check.exact, problem)
    if claim.rho is None:
        return ()
    room = claim.rho - _share(claim, claimed(check.domain["disturbance"]))
    pinned = set(problem.pinning.agents)
    # Rounding may not take back what the domain claims.
    least = float(check.domain["radius"])
    return tuple(
        AgentBound(
            label=label,
            bound=max(least, _down(room * weight)),
            pinned=agent in pinned,
            goal=None if problem.m > 1 else float(problem.goal_of(agent)[0]),
        )
        for agent, (label, weight) in enumerate(zip(problem.network.labels, claim.v, strict=True))
    )


def _floats(pair: tuple[Fraction, Fraction]) -> tuple[float, float]:
    return float(pair[0]), float(pair[1])


def _down(value: Fraction) -> float:
    return _decimal(value, _DIGITS, math.floor)


def _up(value: Fraction, digits: int = _DIGITS) -> float:
    return _decimal(value, digits, ceil)


def _decimal(value: Fraction, digits: int, rounded: Callable[[Fraction], int]) -> float:
    """``value`` > 0 rounded to a decimal of at most ``digits`` digits; 0.0 for others."""
    if value <= 0:
        return 0.0
    unit = Fraction(10) ** (math.floor(math.log10(value)) - digits + 1)
    return float(rounded(value / unit) * unit)
