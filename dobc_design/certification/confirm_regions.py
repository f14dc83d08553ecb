"""Confirming a claimed check of a region against the trusted problem (docs/certificate-format.md, "Regions").

Nothing of the claim is believed: the rows, the observer's part and the box are decided again from the problem.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from dobc_design.conditions.boxes.checks import confirm_exhaustive
from dobc_design.conditions.check import Check
from dobc_design.conditions.equilibrium.decide import confirm_equilibrium
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic.checks import confirm_lure
from dobc_design.conditions.schedule.checks import confirm_settling
from dobc_design.conditions.separable.checks import OWN, obstacle, read_domain, read_object, separable_from_json
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.observer import composite_rate, covers, verify_composite
from dobc_design.conditions.separable.ordering import is_stuck
from dobc_design.conditions.separable.timing import DelayBound, SamplingBound, verify_delay, verify_sampling
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """What a regional check is confirmed with: the problem, W, the domain of Lemma 1, the max-separable check."""

    problem: Problem
    W: Matrix | None
    domain: str
    separable: Check | None


def confirm_region(check: Check, beside: Beside) -> str | None:
    """None if everything a regional check claims is confirmed, else what is not.

    An id that is not known here is refused.  Raises what a malformed claim raises; ``recheck`` turns it into words.
    """
    if check.id not in (*REGIONAL, *QUADRATIC):
        return f"{check.title} is not known here"
    if check.mode is not None or check.margin is not None:
        return "a regional check has no mode and no margin"
    if check.verdict is not Verdict.PROVED and check.domain != beside.domain:
        return f"the domain must be {beside.domain!r}"
    if check.verdict is Verdict.UNDECIDED:
        claims = (check.rate, check.exact, check.witness)
        return None if all(part is None for part in claims) else "an undecided check must claim nothing"
    if check.id in QUADRATIC:
        return QUADRATIC[check.id](check, beside.problem, beside.W, beside.domain)
    reason = obstacle(beside.problem, beside.W)
    return reason if reason is not None else REGIONAL[check.id](check, beside)


def _max_separable(check: Check, beside: Beside) -> str | None:
    if check.verdict is Verdict.REFUTED:
        return _stuck(check, beside.problem)
    claim = separable_from_json(check.exact, beside.problem)
    if check.witness is not None:
        return "a proof has no witness"
    wrong = _not_proved(claim, check, beside)
    if wrong is not None:
        return wrong
    if check.rate is None or check.rate <= 0 or claimed(check.rate) > composite_rate(claim):
        return f"the rate {check.rate} does not follow"
    return None


def _not_proved(claim: Separable, check: Check, beside: Beside) -> str | None:
    """None if the claim is proved and holds all starts of the domain of the check, else what is wrong."""
    if claim.rho is None:
        if check.domain != "global" or beside.domain != "global":
            return "without rho the domain must be global, and every coupling linear"
    else:
        radius, disturbance = read_domain(check.domain, beside.problem, kind="box")
        if not covers(claim, radius=radius, disturbance=disturbance):
            return "the box is not inside the invariant set"
    answer = verify_composite(beside.problem, beside.W, claim)
    return None if answer.verdict is Verdict.PROVED else answer.reason


def _stuck(check: Check, problem: Problem) -> str | None:
    """Some agents that no common v can hold."""
    witness = check.witness
    if check.rate is not None or check.exact is not None:
        return "a refuted check must claim no rate and no exact values"
    if witness is None or witness.kind != "agents" or witness.values is not None or not witness.labels:
        return "it needs agents as its witness"
    places = {label: agent for agent, label in enumerate(problem.network.labels)}
    agents = [places[label] for label in witness.labels if label in places]
    if len(agents) != len(witness.labels) or len(set(agents)) != len(agents):
        return "the witness must name different agents of the problem"
    if not is_stuck(problem, agents):
        return "one of the agents is pinned or hears another agent in every mode"
    return None


def _delay(check: Check, beside: Beside) -> str | None:
    claim, exact = _claim_beside(check, beside), read_object(check.exact, ("delay", "rate"))
    bound = DelayBound(delay=read_rational(exact["delay"]), rate=read_rational(exact["rate"]))
    answer = verify_delay(beside.problem, claim, bound)
    if answer.verdict is not Verdict.PROVED:
        return answer.reason
    if check.rate is None or check.rate <= 0 or claimed(check.rate) > bound.rate:
        return f"the rate {check.rate} does not follow"
    return None


def _sampling(check: Check, beside: Beside) -> str | None:
    claim = _claim_beside(check, beside)
    own = isinstance(check.exact, Mapping) and OWN in check.exact
    exact = read_object(check.exact, ("period", "factor", *([OWN] if own else [])))
    if check.rate is not None:
        return "it claims a number that this check does not have"
    if own:
        claim = separable_from_json(exact[OWN], beside.problem)
        wrong = _not_proved(claim, check, beside)
        if wrong is not None:
            return f"its own certificate: {wrong}"
    bound = SamplingBound(period=read_rational(exact["period"]), factor=read_rational(exact["factor"]))
    answer = verify_sampling(beside.problem, claim, bound)
    return None if answer.verdict is Verdict.PROVED else answer.reason


def _claim_beside(check: Check, beside: Beside) -> Separable:
    """The max-separable claim that a check of delays or sampling rests on.  Raises: ValueError if it has none."""
    proof = beside.separable
    if check.verdict is not Verdict.PROVED or check.witness is not None:
        raise ValueError("it can only be proved or undecided, and has no witness")
    if proof is None or proof.verdict is not Verdict.PROVED or proof.domain != check.domain:
        raise ValueError("it needs a proved max-separable check with its domain")
    if check.domain != "global":
        read_domain(check.domain, beside.problem, kind="box")  # true equals 1 and is no number
    return separable_from_json(proof.exact, beside.problem)


#: How the proof or refutation of each regional check is confirmed.
REGIONAL: Final[dict[str, Callable[[Check, Beside], str | None]]] = {
    "max-separable": _max_separable,
    "delay": _delay,
    "sampling": _sampling,
}

#: The same for what needs neither the max-separable check nor couplings that act by component.
QUADRATIC: Final[dict[str, Callable[[Check, Problem, Matrix | None, str], str | None]]] = {
    "lure": confirm_lure,
    "exhaustive": confirm_exhaustive,
    "settling": confirm_settling,
    "equilibrium": confirm_equilibrium,
}
