"""When `safety` and `markov` are tried, and what they report."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Final

from dobc_design.conditions.check import Check, limited, starts_in, undecided_check
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.graphs import propose
from dobc_design.conditions.graphs.claim import HOW, SURE, Kept
from dobc_design.conditions.graphs.decide import apart_check, confirm, generator_of, why_not
from dobc_design.conditions.numbers import claimed, decimal_below, rounded_down, rounded_up, shorten
from dobc_design.conditions.schedule.cycles import Cycles
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, acts_by_component, holding_gains
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.exact.number import root_above
from dobc_design.verdict import Verdict

logger = logging.getLogger("dobc_design")

SMALLER: Final = 12  # halvings of a box that is too large
DIGITS: Final = 9
EXTRA: Final = Fraction(1, 10**9)


def safety_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `safety`, where the graph moves; PROVED or UNDECIDED."""
    own = asked.problem.switching
    if own is None or own.signal != "mobile":
        return []
    report("deciding whether the box is left")
    return [_limited("safety", asked, _safe)]


def markov_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `markov`, where proofs may assume a Markov chain."""
    if generator_of(asked.problem) is None:
        return []
    report("deciding the Markov signal")
    return [_limited("markov", asked, _random)]


def _limited(id: str, asked: Asked, decide: Callable[[Asked], Check]) -> Check:
    reason = obstacle(asked.problem, asked.W)
    if reason is not None and (id == "safety" or acts_by_component(asked.problem)):
        return undecided_check(id, asked.domain, reason, applies=False)
    try:
        return limited(id, asked.domain, partial(decide, asked))
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no %s: %s", id, error)
        return undecided_check(id, asked.domain, "no proof is found: a numerical library broke down.")


def _boxes(asked: Asked, kind: str, rate: Fraction | None) -> Iterator[tuple[Asked, Kept]]:
    """Claims with v = 1 for the box of starts, or a smaller one."""
    problem, W, exosystem = asked.problem, asked.W, asked.problem.joint_exosystem
    error: ErrorBound | None = None
    if exosystem is not None and W is not None:
        if rate is not None:
            rate = min(rate, rounded_down(decay_rate(exosystem, W) / 2))
        error = propose_error_bound(exosystem, W, rate=float(rate or 0))
        if error is None:
            return
        kappa = 1 / (error.beta - (rate or 0))
        error = replace(error, kappa=Fraction(math.ceil(kappa * 10**6), 10**6))
    for k in range(1 if problem.is_linear else SMALLER + 1):
        sides = asked.radius, asked.disturbance
        radius, disturbance = (decimal_below(claimed(x) / 2**k) if x and k else x for x in sides)
        rho = None
        if not problem.is_linear:
            rho = claimed(radius)
            if error is not None and disturbance:
                noise = error.kappa * claimed(disturbance)
                rho = rounded_up((rho + root_above(noise**2 * error.size, unit=10**12)) * (1 + EXTRA), digits=DIGITS)
        box = Cycles(phases=(), rate=None, rho=rho, error=error)
        yield replace(asked, radius=radius, disturbance=disturbance), Kept(kind=kind, rate=rate, box=box)


def _safe(asked: Asked) -> Check:
    problem, gains = asked.problem, holding_gains(asked.problem)
    loose = [label for label, gain in zip(problem.network.labels, gains, strict=True) if gain <= 0]
    wrong: str | None = "no bound of the estimation error is found."
    for smaller, claim in _boxes(asked, "", None if loose else min(gains)):
        wrong = why_not(problem, asked.W, claim)
        if wrong is None:
            size = "max |e(0)|" + (" and what the estimation error adds" if problem.groups else "")
            if claim.box is not None and claim.box.rho is not None:
                size = f"{float(rounded_up(claim.box.rho, digits=6)):.6g}"
            starts = "every start" if claim.box is None or claim.box.rho is None else f"|e(0)| <= {smaller.radius:.6g}"
            if problem.groups and starts != "every start":
                starts += f" and |eps_i(0)| <= {smaller.disturbance:.6g}"
            reason = f"from {starts} no agent ever leaves the box |e| <= {size}, whatever the graph, its switching and"
            reason += " the motion."
            if claim.rate is None:
                who = f"not pinned, and may lose all neighbours: {name_agents(tuple(loose))}"
                known = problem.switching is not None and problem.switching.guarantee not in (None, "arbitrary")
                helps = "" if known else '; a guarantee on time would help (guarantee = "dwell")'
                reason += f" There is no rate ({who}){helps}."
            else:
                reason += " All agents are pinned, so from there all reach the target for every graph and every motion,"
                reason += f" at least like exp(-{shorten(claim.rate, digits=4):.4g} t)."
            return _check("safety", smaller, claim, reason)
    return undecided_check("safety", asked.domain, str(wrong))


def _random(asked: Asked) -> Check:
    problem, W, generator = asked.problem, asked.W, generator_of(asked.problem) or ()
    signal, wrong = "for the Markov signal, whatever its first mode, every error decays", ""
    if problem.is_linear:
        for how in (propose.square_claim, propose.mean_claim):
            claim = None if how is propose.mean_claim and not acts_by_component(problem) else how(problem, W, generator)
            if claim is not None and why_not(problem, W, claim) is None:
                pace = f"at least like exp(-{shorten(claim.rate or Fraction(0), digits=4):.4g} t)"
                return _check("markov", asked, claim, f"{signal} {HOW[claim.kind]}, {pace}.")
    if (found := apart_check(problem, asked.domain)) is not None:
        return found
    if not acts_by_component(problem):
        return undecided_check("markov", asked.domain, "no matrices P are found, and couplings mix components.")
    for smaller, claim in _boxes(asked, SURE, None):
        wrong = why_not(problem, W, claim) or ""
        if not wrong:
            return _check("markov", smaller, claim, f"{signal} {HOW[SURE]}.")
    return undecided_check("markov", asked.domain, wrong or "no bound of the estimation error is found.")


def _check(id: str, asked: Asked, claim: Kept, reason: str) -> Check:
    """The check of a claim, decided once more as it is written."""
    somewhere = claim.box is not None and claim.box.rho is not None
    check = Check(
        id=id,
        verdict=Verdict.PROVED,
        domain=starts_in("box", asked.radius, asked.disturbance) if somewhere else "global",
        rate=None if claim.rate is None else decimal_below(claim.rate),
        reason=reason,
        claim=claim,
    )
    wrong = confirm(check, asked.problem, asked.W, domain=asked.domain)
    return check if wrong is None else undecided_check(id, asked.domain, wrong)
