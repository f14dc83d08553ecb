"""What is asked of a certificate, in which order, and the verdict that follows from its confirmed
claims."""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

from .accuracy import accuracy
from .consensus import (
    OF_GROUPS,
    closed,
    consensus,
    fact,
    linearisation,
    observable,
    observer,
    takes_long,
    weighted,
)
from .coordinates import boxes
from .cycles import allowed, schedule
from .factors import bounded, time_to_one_percent
from .files import Certificate, Problem
from .graphs import MODES, absorbing, markov, may_stay, safety
from .margins import actuators, tolerance
from .matrices import product, stable
from .quadratic import lure
from .reading import MAX_BYTES, UNTIL, OutOfTime, Refused, need, rational
from .schedule import settling
from .separable import delay, equilibrium, sampling

__all__ = ["MAX_BYTES", "Refused", "examine"]


FACTS = (*OF_GROUPS, "reachability")
REGIONAL: dict[str, Callable[[Certificate, Any], None]] = {
    "max-separable": boxes,
    "delay": delay,
    "sampling": sampling,
    "tolerance": tolerance,
    "actuators": actuators,
    "equilibrium": equilibrium,
    "lure": lure,
    "schedule": schedule,
    "markov": markov,
    "safety": safety,
    "settling": settling,
    "accuracy": accuracy,
}


def examine(certificate: bytes, problem: bytes, until: float = math.inf) -> list[tuple[bool, str]]:
    """Every claim of a certificate: does it hold, what it is, and why it fails. It is confirmed iff
    all of them hold.

    ``until``: a time of ``time.monotonic``, after which no further claim is examined; the list is
    then shorter.
    Raises: Refused if one of the two files is not what the format page describes.
    """
    token = UNTIL.set(until)
    try:
        return _examined(certificate, problem)
    finally:
        UNTIL.reset(token)


def _examined(certificate: bytes, problem: bytes) -> list[tuple[bool, str]]:
    try:
        case = Certificate(certificate, Problem(problem))
    except OutOfTime:
        return []
    first: list[tuple[str, Callable[[], None]]] = [
        ("it belongs to this problem", partial(belonging, case)),
        ("its list of checks", partial(completeness, case)),
    ]
    gain = [("its observer gain and pair (P, Q)", partial(observer, case))]
    each = [
        (f"{check.id} {check.mode or ''}: {check.verdict}", partial(confirm, case, check))
        for check in case.checks
    ]
    last = [(f"overall verdict: {case.claims.verdict}", partial(overall, case))]
    findings: list[tuple[bool, str]] = []
    for title, step in (
        step
        for stage in (first, gain, each, last)
        if all(ok for ok, _ in findings)
        for step in stage
    ):
        try:
            step()
            findings.append((True, title))
        except OutOfTime:
            break
        except Refused as error:
            findings.append((False, f"{title}: {error}"))
    return findings


def belonging(case: Certificate) -> None:
    """The certificate is about this problem."""
    claims, p = case.claims, case.problem
    need(claims.problem == p.name, "the problem has another name")
    need(claims.problem_sha256 == p.sha256, "the problem file has another hash")
    need(claims.notes[: len(p.notes)] == p.notes, "the notes of the problem are not repeated")


def completeness(case: Certificate) -> None:
    """Every check that has to be there is there, once, and none that is not known."""
    p = case.problem
    wanted: list[Any] = [(id, mode, None) for mode in p.modes for id in ("reachability", "lemma1")]
    wanted += [(id, None, group) for id in OF_GROUPS for group in p.names]
    wanted += [(case.theorem, None, None)] * (p.q > 0) + [
        (case.theorem + "-printed", None, None)
    ] * (p.P is not None)
    found = [(check.id, check.mode, check.group) for check in case.checks]
    more = (*REGIONAL, case.theorem + "-weighted", "linearisation")
    need(
        set(found) <= {*wanted, *((id, None, None) for id in more)},
        "there is a check that nobody asked for",
    )
    need(len(set(found)) == len(found), "a check stands there twice")
    need(set(wanted) <= set(found), "a check is missing")


def confirm(case: Certificate, check: Any) -> None:
    """Decide one claim."""
    about_region = check.id in REGIONAL and check.verdict != "undecided"
    domain = "global" if check.id in FACTS else case.problem.domain
    need(about_region or check.domain == domain, "the domain is wrong")
    if check.verdict == "undecided":
        claimed = (check.margin, check.rate, check.factor, check.exact, check.witness)
        need(claimed == (None,) * 5, "it is undecided and claims something")
    else:
        need(
            check.verdict in ("proved", "refuted"),
            "the verdict is none of proved, refuted and undecided",
        )
        named = {
            **dict.fromkeys(FACTS, fact),
            case.theorem + "-weighted": weighted,
            "linearisation": linearisation,
        }
        (regional if about_region else named.get(check.id, consensus))(case, check)
        bounded(case, check)


def regional(case: Certificate, check: Any) -> None:
    """A claim about a region that is proved or refuted."""
    p = case.problem
    need(check.margin is None, "it has no margin to claim")
    need(p.q == 0 or case.W is not None, "there is no observer gain")
    if check.id not in ("max-separable", "lure", "equilibrium", "markov", "accuracy", "schedule"):
        need(
            not p.nodes and all(coupling.single for coupling in p.couplings),
            "a coupling is a list, or nodes are curved",
        )
    need(not p.nodes or check.id not in ("equilibrium", "markov"), "nodes are curved")
    need(
        p.leader is None or check.id not in ("equilibrium", "delay", "sampling"),
        "the leader moves on",
    )
    if check.verdict == "proved":
        need(check.witness is None, "it is proved and carries a witness")
    else:
        need(check.domain == p.domain, "the domain is wrong")
        need(check.rate is None, "it is refuted and claims a rate")
        need(
            check.id in ("max-separable", "equilibrium", "markov", "schedule"),
            "it cannot be refuted",
        )
    REGIONAL[check.id](case, check)
    need(
        check.id != "equilibrium" or may_stay(p, check.exact["mode"]),
        "the guarantee does not let that mode stay on",
    )


# --- the overall verdict, once all checks are confirmed
def overall(case: Certificate) -> None:
    """The verdict, the rate with its factor and what covers it follow from the checks."""
    claims = case.claims

    def rate(check: Any) -> Fraction:
        return check.rate or Fraction(0)

    proofs = [check for check in case.checks if check.verdict == "proved" and covers(case, check)]
    lemmas = [check for check in proofs if check.id == "lemma1"]
    slowest = (
        min(lemmas, key=rate, default=None) if len(lemmas) == len(case.problem.modes) else None
    )
    counted = [check for check in proofs if check.id != "lemma1" or check is slowest]
    # the checks of tables are about the graphs of the modes, not about every graph
    if tables(case.problem):
        counted = [check for check in counted if check.id != "safety"]
    always = [check for check in counted if check.id not in ("schedule", "markov")]
    best: Any = min(
        always or counted,
        key=lambda check: (time_to_one_percent(check), -rate(check)),
        default=None,
    )
    failed = best is None and refuted(case)
    best = best and answered(case, best)
    verdict = "proved" if best else "refuted" if failed else "undecided"
    need(claims.verdict == verdict, f"the verdict that follows is {verdict}")
    need(claims.rate == (best and best.rate), "the rate is another one")
    need(claims.factor == (best and best.factor), "the factor is another one")
    need(claims.covered_by == (best and best.id), "it is covered by another check")


def tables(p: Problem) -> list[str]:
    """The checks that have to be proved because of `actuators` and `uncertainty`; the last one
    carries the verdict, unless it is about limits alone."""
    plant = p.uncertainty
    acts = plant is not None and (plant.disturbance or plant.measurement or (plant.drift and p.q))
    off = plant is not None and (plant.weights or plant.gains)
    limits = p.actuators is not None and p.actuators.limit
    return ["actuators"] * bool(limits) + (["accuracy"] if acts else ["tolerance"] if off else [])


def answered(case: Certificate, best: Any) -> Any:
    """The check that carries the verdict about the plant with its tables, beside ``best``; None if
    one is open."""
    p = case.problem
    for id in tables(p):
        found = [check for check in case.checks if (check.id, check.verdict) == (id, "proved")]
        if not found or not asked_for(case, found[0].domain):
            return None
        best = best if id == "actuators" else found[0]
    # errors at the target, and inputs in a box
    if tables(p) == ["actuators", "tolerance"] and "v" in best.exact:
        own = (
            check.exact
            for check in case.checks
            if (check.id, check.verdict) == ("actuators", "proved")
        )
        return best if all("v" in exact for exact in own) else None
    return best


def asked_for(case: Certificate, domain: Any) -> bool:
    """True if a domain of these checks holds the starts that are asked for."""
    p = case.problem
    if p.region is not None or type(domain) is str:
        return (
            domain == "global"
            or (p.region is None and type(domain) is str)
            or holds_region(p, domain)
        )
    return bool(domain.radius > 0 and (not p.q or domain.disturbance > 0))


def covers(case: Certificate, check: Any) -> bool:
    """True if what is proved holds from all starts that are asked for (lemma1: in its mode)."""
    p, domain = case.problem, check.domain
    local = (case.theorem, case.theorem + "-printed") if p.q else ("lemma1",)
    if check.id in (*local, case.theorem + "-weighted", "linearisation"):
        return p.region is None or p.domain == "global"
    safe = check.id == "safety" and check.rate is not None
    if not safe and check.id not in ("max-separable", "lure", "schedule", "markov"):
        return False
    if type(domain) is str:
        return bool(domain == "global")
    # a box around the target answers the local question: several modes, dynamics, leaders
    if p.region is None:
        near = domain.radius > 0 and (not p.q or domain.disturbance > 0)
        box = check.id in ("max-separable", "schedule", "markov") and (
            p.switches or p.B is not None
        )
        return bool((safe or box or (check.id == "lure" and p.nodes and p.leader)) and near)
    return holds_region(p, domain)


def holds_region(p: Problem, domain: Any) -> bool:
    """True if a box or ball holds the region."""
    if p.region is None or type(domain) is str:
        return False
    sides = list(zip(p.region.initial_states, p.leads, strict=True))
    ends = [[end - s for end in side for s in leads] for side, leads in sides]
    farthest = [
        max(abs(end - goal[c]) for goal in p.goals for end in each) for c, each in enumerate(ends)
    ]
    square = max(farthest) ** 2 if domain.kind == "box" else p.n * sum(side**2 for side in farthest)
    return bool(
        domain.radius**2 >= square and domain.disturbance >= (p.region.initial_disturbance or 0)
    )


def refuted(case: Certificate) -> bool:
    """True if a closed set of agents, an equilibrium, a group's own W or an unstable mode shows
    that it fails."""
    p, found = case.problem, [check for check in case.checks if check.verdict == "refuted"]
    asked = p.groups if p.region is None or p.region.initial_disturbance else []
    parts = (  # what is seen of an error has to decay
        [[row[k] for k in columns] for row in product(T, closed(group, group.W))]
        for group in asked
        if group.W is not None and not takes_long(group)
        for T, columns in [observable(group)]
    )
    last = absorbing(p) if len(p.modes) <= MODES else []
    apart = any(p.escapes(cycle, k == 0) for k, cycle in enumerate([*allowed(p), *last]))
    if (
        apart
        or (p.region and any(check.id == "equilibrium" for check in found))
        or not all(map(stable, parts))
    ):
        return True
    sides = enumerate(
        [] if p.region is None else zip(p.region.initial_states, p.leads, strict=True)
    )
    rooms = (
        (max(lo - x[c] for x in p.goals), min(hi - x[c] for x in p.goals), *s)
        for c, ((lo, hi), s) in sides
    )
    inside = (lo < hi and lo < last and first < hi for lo, hi, first, last in rooms)
    unstable = (check for check in found if check.id in ("lemma1", "linearisation"))
    rooted = (check.exact for check in unstable if may_stay(p, check.mode or next(iter(p.modes))))
    grows = any(check.id == "schedule" for check in found)
    return all(inside) and (
        grows or p.drifts() or any(rational(exact["unstable_roots"]) > 0 for exact in rooted)
    )
