"""The sentences of the report: what a verdict says, what it does not, and the names of checks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

from dobc_design._show.text import significant, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check, Domain
from dobc_design.conditions.kinds import ids_of
from dobc_design.problem.problem import Problem
from dobc_design.report.document import Mark
from dobc_design.verdict import Verdict

SYMBOLS = {Verdict.PROVED: "✓", Verdict.REFUTED: "✗", Verdict.UNDECIDED: "?"}

MEANINGS = {
    Verdict.PROVED: "Shown by exact arithmetic on rational numbers. No solver and no rounding is trusted: what a solver"
    " proposed was rounded to rationals and then decided. Anybody can repeat the decision.",
    Verdict.REFUTED: "Shown by exact arithmetic to be false, with a witness that can be checked by hand: a vector,"
    " a set of agents, a polynomial. A refuted condition is not yet a failure of consensus: a theorem whose"
    " condition is false says nothing. Only the overall verdict “refuted” says that consensus fails.",
    Verdict.UNDECIDED: "Neither proved nor refuted here: the condition does not apply, or nothing was found that"
    " decides it. It never means that consensus fails.",
}

_POWER = re.compile(r"e([+-]\d+)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_IDEAL = "messages without delay, noise or quantisation"
_TIMED = "messages without noise or quantisation; late messages and sampling as far as their checks say"


def mark_of(verdict: Verdict) -> Mark:
    """A verdict as a sign and a word."""
    return Mark(SYMBOLS[verdict], verdict.value)


def check_name(check: Check) -> str:
    """The name of a check for people."""
    return check.kind.name


def domain_words(domain: Domain) -> str:
    """Where a check holds, in a few words."""
    if isinstance(domain, Mapping):
        radius, disturbance = domain.get("radius"), domain.get("disturbance")
        size = "|e|∞" if domain.get("kind") == "box" else "|e|₂"
        text = f"starts with {size} ≤ {_number(radius)}"
        return text if disturbance is None else f"{text} and every |εᵢ| ≤ {_number(disturbance)}"
    return {"global": "everywhere", "consensus": "near the target"}.get(domain, domain)


def covering_domain(certificate: Certificate) -> Domain | None:
    """The domain of the proof that carries the verdict."""
    for check in certificate.checks:
        if check.id == certificate.covered_by and check.verdict is Verdict.PROVED:
            return check.domain
    return None


def typeset(text: str) -> str:
    """Write a number given as text with a real minus and a power of ten: -1.5e-08 as −1.5·10⁻⁸."""
    return _POWER.sub(lambda match: "·10" + str(int(match.group(1))).translate(_RAISED), text).replace("-", "−")


def number(value: float | None) -> str:
    """A rounded number as people write it."""
    return typeset(significant(None if value is None else value + 0.0))  # no -0


def capitalize_first(text: str) -> str:
    """Make the first letter a capital and leave the others alone."""
    return text[:1].upper() + text[1:]


def what_it_means(certificate: Certificate) -> tuple[list[str], list[str]]:
    """What the overall verdict says, and what it does not."""
    if certificate.verdict is Verdict.PROVED:
        return _proved(certificate)
    if certificate.verdict is Verdict.REFUTED:
        return _refuted(certificate.problem)
    return _undecided(certificate)


def _proved(certificate: Certificate) -> tuple[list[str], list[str]]:
    switching = len(certificate.problem.network.modes) > 1
    domain = covering_domain(certificate)
    yes = [_from_where(domain)]
    if certificate.problem.groups:
        yes.append("The estimates converge to the true disturbances, wherever observer and disturbance start.")
    if switching:
        yes.append("The modes may switch at any times and in any order, arbitrarily fast: one V serves them all.")
    if certificate.rate:
        yes.append(
            f"The errors decay at least like exp(−{_number(certificate.rate)} t), t in seconds."
            " The real decay may be faster."
        )
    no = []
    if domain == "consensus":
        no.append(
            "It is local, a statement at the consensus. It names no radius: nothing is said about starts at a"
            " given distance, not even when simulations from there look well."
        )
    elif isinstance(domain, Mapping):
        no.append("It says nothing about starts outside that set. They may converge or not.")
    timed = [
        check.id for check in certificate.checks if check.kind.role == "timing" and check.verdict is Verdict.PROVED
    ]
    no.append(_about_the_model(certificate.problem, _TIMED if len(timed) == len(ids_of("timing")) else _IDEAL))
    return yes, no


def _about_the_model(problem: Problem, messages: str = _IDEAL) -> str:
    disturbances = "one (A, C) for all agents, " if problem.groups else ""
    disturbances = "one (A, C) for each group of agents, " if problem.is_grouped else disturbances
    return (
        f"It is about the model as given: single integrators, {disturbances}{messages}. Whether the model fits the"
        " plant is not decided here."
    )


def _from_where(domain: Domain | None) -> str:
    if domain == "global":
        return "Every agent goes to its goal from every start, however far: the proof is global."
    if isinstance(domain, Mapping):
        return f"Every agent goes to its goal from all {domain_words(domain)}."
    return "There is a neighbourhood of the target from which every agent goes to its goal."


def _refuted(problem: Problem) -> tuple[list[str], list[str]]:
    yes = [
        "Consensus on the target fails for this network, these pins and this observer, and the checks below say why.",
        "The reason is exact. More accuracy, another solver or more time cannot change it.",
    ]
    no = [
        "It does not say that the task is impossible: another pin, arc, gain or observer may cure it."
        " Where a cure is known, it is named here.",
        "It does not say that every start fails; some may still converge.",
        _about_the_model(problem),
    ]
    return yes, no


def _undecided(certificate: Certificate) -> tuple[list[str], list[str]]:
    proved = sum(check.verdict is Verdict.PROVED for check in certificate.checks)
    yes = [
        "What was asked is neither proved nor refuted.",
        f"{proved} of {len(certificate.checks)} checks are proved, and these hold by themselves.",
    ]
    no = [
        "It does not say that consensus fails. A sufficient condition that is not met says nothing.",
        "It does not say that consensus holds, even if a simulation below shows it.",
        _about_the_model(certificate.problem),
    ]
    return yes, no


def _number(value: object) -> str:
    return typeset(significant_towards_zero(value)) if isinstance(value, (int, float, Fraction)) else "?"
