"""When `safety` and `markov` are tried, and what they report."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design.conditions.check import Check, limited, surviving, undecided_check
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.domain import EVERYWHERE, Box
from dobc_design.conditions.numbers import (
    claimed,
    decimal_below,
    rounded_down,
    rounded_up,
    text_above,
    text_below,
)
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, acts_by_component, holding_gains
from dobc_design.conditions.separable.propose_observer import propose_error_bound, with_kappa
from dobc_design.exact.number import root_above
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .claim import HOW, SURE, Kept
from .decide import apart_check, confirm, why_not
from .propose import mean_claim, square_claim

SMALLER = 12  # halvings of a box that is too large
DIGITS = 9
EXTRA = Fraction(1, 10**9)
NO_BOUND = "no bound of the estimation error is found."


def safety_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `safety`, where the graph moves; PROVED or UNDECIDED."""
    if not asked.loop.guarantee.moves:
        return []
    report("deciding whether the box is left")
    return [_limited("safety", asked, _safe)]


def markov_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `markov`, where proofs may assume a Markov chain."""
    if asked.loop.guarantee.generator is None:
        return []
    report("deciding the Markov signal")
    return [_limited("markov", asked, _random)]


def _limited(id: str, asked: Asked, decide: Callable[[Asked], Check]) -> Check:
    reason = obstacle(asked.loop, asked.W)
    if reason is not None and (id == "safety" or acts_by_component(asked.loop)):
        return undecided_check(id, asked.domain, reason, applies=False)
    words = "no proof is found: a numerical library broke down."
    found = undecided_check(id, asked.domain, words)
    with surviving(f"no {id}"):
        found = limited(id, asked.domain, partial(decide, asked))
    return found


def _boxes(asked: Asked, kind: str, rate: Fraction | None) -> Iterator[tuple[Asked, Kept]]:
    """Claims with v = 1 for the box of starts, or a smaller one."""
    loop = asked.loop
    exosystem = loop.joint_exosystem
    error = None
    if exosystem is not None and asked.W is not None:
        if rate is not None:
            rate = min(rate, rounded_down(decay_rate(exosystem, asked.W) / 2))
        error = propose_error_bound(exosystem, asked.W, rate=float(rate or 0))
        if error is None:
            return
        error = with_kappa(error, rate=rate or 0)
    if loop.is_linear:
        # Where every start is proved there is nothing to gain from fewer.
        everywhere = Cycles(phases=(), rate=None, rho=None, error=error)
        yield asked, Kept(kind=kind, rate=rate, box=everywhere)
        return
    # Curved couplings may fall far out: smaller boxes of starts look less far.
    for k in range(SMALLER + 1):
        radius, disturbance = (_halved(x, k) for x in (asked.radius, asked.disturbance))
        smaller = replace(asked, radius=radius, disturbance=disturbance)
        box = Cycles(phases=(), rate=None, rho=_reach(smaller, error), error=error)
        yield smaller, Kept(kind=kind, rate=rate, box=box)


def _halved(value: float, times: int) -> float:
    """A decimal not above the value after so many halvings."""
    return decimal_below(claimed(value) / 2**times) if value and times else value


def _reach(asked: Asked, error: ErrorBound | None) -> Fraction:
    """How far V = max |e_i| + kappa E may reach at the start, rounded up where E adds to it."""
    radius = claimed(asked.radius)
    if error is None or not asked.disturbance:
        return radius
    noise = error.kappa * claimed(asked.disturbance)
    added = root_above(noise**2 * error.size, unit=10**12)
    return rounded_up((radius + added) * (1 + EXTRA), digits=DIGITS)


def _safe(asked: Asked) -> Check:
    loop = asked.loop
    gains = holding_gains(loop)
    loose = [label for label, gain in zip(loop.labels, gains, strict=True) if gain <= 0]
    wrong: str | None = NO_BOUND
    for smaller, claim in _boxes(asked, "", None if loose else min(gains)):
        wrong = why_not(loop, asked.W, claim)
        if wrong is None:
            kept = _kept_in_words(loop, smaller, claim)
            reason = f"{kept} {_pace_in_words(loop, claim, loose)}"
            return _check("safety", smaller, claim, reason)
    return undecided_check("safety", asked.domain, str(wrong))


def _kept_in_words(loop: Loop, asked: Asked, claim: Kept) -> str:
    """Which box is never left, and from which starts."""
    rho = None if claim.box is None else claim.box.rho
    if rho is None:
        starts = "every start"
        size = "max |e(0)|" + (" and what the estimation error adds" if loop.groups else "")
    else:
        starts = f"|e(0)| <= {asked.radius:.6g}"
        size = text_above(rho, digits=6)
        if loop.groups:
            starts += f" and |eps_i(0)| <= {asked.disturbance:.6g}"
    return (
        f"from {starts} no agent ever leaves the box |e| <= {size}, whatever the "
        "graph, its switching and the motion."
    )


def _pace_in_words(loop: Loop, claim: Kept, loose: list[str]) -> str:
    """Whether all reach the target, and how fast; ``loose``: the agents without a pin."""
    # Only pins of all agents give a rate that no graph can take away.
    if claim.rate is not None:
        return (
            "All agents are pinned, so from there all reach the target for every "
            f"graph and every motion, at least like exp(-{text_below(claim.rate)} t)."
        )
    who = f"not pinned, and may lose all neighbours: {name_agents(tuple(loose))}"
    helps = '; a guarantee on time would help (guarantee = "dwell")'
    if loop.guarantee.is_given:
        helps = ""
    return f"There is no rate ({who}){helps}."


def _random(asked: Asked) -> Check:
    loop = asked.loop
    signal = "for the Markov signal, whatever its first mode, every error decays"
    claim = None if loop.is_apart else _linear_claim(asked)
    if claim is not None:
        pace = f"at least like exp(-{text_below(claim.rate or 0)} t)"
        return _check("markov", asked, claim, f"{signal} {HOW[claim.kind]}, {pace}.")
    found = apart_check(loop, asked.domain)
    if found is not None:
        return found
    if not acts_by_component(loop):
        mixed = "no matrices P are found, and couplings mix components."
        return undecided_check("markov", asked.domain, mixed)
    wrong: str | None = None
    for smaller, kept in _boxes(asked, SURE, None):
        wrong = why_not(loop, asked.W, kept)
        if wrong is None:
            return _check("markov", smaller, kept, f"{signal} {HOW[SURE]}.")
    return undecided_check("markov", asked.domain, wrong or NO_BOUND)


def _linear_claim(asked: Asked) -> Kept | None:
    """A proved claim in mean square, else in the mean; None where couplings are not linear."""
    loop = asked.loop
    if not loop.is_linear:
        return None
    generator = loop.guarantee.generator or ()
    # The mean square says more than the mean, and is tried first.
    searches = [square_claim]
    if acts_by_component(loop):
        searches.append(mean_claim)
    for search in searches:
        claim = search(loop, asked.W, generator)
        if claim is not None and why_not(loop, asked.W, claim) is None:
            return claim
    return None


def _check(id: str, asked: Asked, claim: Kept, reason: str) -> Check:
    """The check of a claim, decided once more as it is written."""
    somewhere = claim.box is not None and claim.box.rho is not None
    check = Check(
        id=id,
        verdict=Verdict.PROVED,
        domain=Box(asked.radius, asked.disturbance) if somewhere else EVERYWHERE,
        rate=None if claim.rate is None else decimal_below(claim.rate),
        reason=reason,
        claim=claim,
    )
    return check.unless(confirm(check, asked.case), asked.domain)
