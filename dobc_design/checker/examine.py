"""What is asked of a certificate, and in which order."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from .accuracy import accuracy
from .arcs import arc_wise
from .claims import Case
from .consensus import OF_GROUPS, consensus, fact, linearisation, observer, weighted
from .coordinates import boxes
from .cycles import schedule
from .factors import bounded
from .files import Problem
from .graphs import markov, safety
from .margins import actuators, tolerance
from .matrices import paired
from .pairs import rows_of
from .quadratic import lure
from .reading import MAX_BYTES, UNTIL, OutOfTime, Refused, need
from .saturation import allowed, cut, saturates
from .schedule import settling
from .separable import delay, equilibrium, readings, sampling
from .value import agreed_value
from .verdict import overall

__all__ = ["MAX_BYTES", "Refused", "examine"]


FACTS = (*OF_GROUPS, "reachability")
Decider = Callable[[Case, Any], Any]  # what is read of the claim, if it may have a factor
REGIONAL: dict[str, Decider] = {
    "max-separable": boxes,
    "delay": delay,
    "sampling": sampling,
    "readings": readings,
    "tolerance": tolerance,
    "actuators": actuators,
    "equilibrium": equilibrium,
    "lure": lure,
    "arc-wise": arc_wise,
    "schedule": schedule,
    "markov": markov,
    "safety": safety,
    "settling": settling,
    "accuracy": accuracy,
}
# What of these claims knows nodes and arcs beyond integrators that hear each other, by component,
# and one target.
KNOWN_TO = {
    "couplings that are lists": "max-separable lure arc-wise equilibrium markov accuracy schedule",
    "nodes that are curved": "max-separable delay sampling readings tolerance actuators "
    "lure arc-wise schedule safety settling accuracy",
    "leaders that move on": "max-separable readings tolerance actuators lure arc-wise schedule "
    "markov safety settling accuracy",
    # what is left bounds a pin from below: it says nothing of rest
    "inputs that saturate": "max-separable delay sampling readings tolerance actuators lure "
    "arc-wise schedule markov safety settling accuracy",
    "pins that are cut": "max-separable arc-wise delay sampling readings schedule settling",
    "fixed nodes that differ or move": "max-separable delay schedule settling",
    # delay: a late state and one of now make no difference that is followed
    "differences of agents": "max-separable arc-wise sampling readings schedule settling markov "
    "tolerance accuracy",
    "agents with too many pairs": "schedule markov actuators",
    # rows hold whatever the signs
    "signs that fit no two sides": "max-separable delay sampling readings tolerance actuators "
    "safety settling accuracy schedule arc-wise",
}
REFUTABLE = ("readings", "max-separable", "equilibrium", "markov", "schedule")
Finding = tuple[bool, str]  # whether it holds, and what
Task = tuple[str, partial[None]]


def examine(certificate: bytes, problem: bytes, until: float = math.inf) -> list[Finding]:
    """Every claim of a certificate: does it hold, what it is, and why it fails. It is confirmed iff
    all of them hold.

    ``until``: a time of ``time.monotonic``, after which no further claim is examined; the list is
    then shorter.
    Raises: Refused if one of the two files is not what the format page describes.
    """
    token = UNTIL.set(until)
    found: list[Finding] = []
    try:
        for stage in stages(Case(certificate, Problem(problem))):
            for title, task in stage:
                found.append(finding(title, task))
            # a later stage relies on those before it
            if not all(holds for holds, _ in found):
                break
    except OutOfTime:
        return found
    finally:
        UNTIL.reset(token)
    return found


def finding(title: str, task: partial[None]) -> Finding:
    """Whether a claim holds, and what it is, or why it fails."""
    try:
        task()
    except Refused as error:
        return False, f"{title}: {error}"
    return True, title


def stages(case: Case) -> list[list[Task]]:
    """What is examined."""
    about = [
        ("its problem", partial(belonging, case)),
        ("its list of checks", partial(completeness, case)),
    ]
    gain = [("its observer gain and pair (P, Q)", partial(observer, case))]
    claims = []
    for check in case.checks:
        title = f"{check.id} {check.mode or ''}: {check.verdict}"
        claims.append((title, partial(confirm, case, check)))
    last = [(f"overall verdict: {case.claims.verdict}", partial(overall, case))]
    if case.claims.value is not None:
        last.append(("the value agreed upon", partial(agreed_value, case)))
    return [about, gain, claims, last]


def belonging(case: Case) -> None:
    """The certificate is about this problem."""
    claims = case.claims
    stated = case.problem.stated
    need(claims.problem == stated.name, "the problem file has another name")
    need(claims.problem_sha256 == case.problem.sha256, "the problem file has another hash")
    repeated = claims.notes[: len(stated.notes)] == stated.notes
    need(repeated, "the notes of the problem are not repeated")


def completeness(case: Case) -> None:
    """Every check that has to be there is there, once, and none that is not known."""
    # what the problem asks for, whatever became of it
    wanted: list[Any] = [
        (id, mode, None) for mode in case.modes for id in ("reachability", "lemma1")
    ]
    wanted += [(id, None, group) for id in OF_GROUPS for group in case.names]
    if case.q:
        wanted.append((case.theorem, None, None))
    if case.given_P is not None:
        wanted.append((case.theorem + "-printed", None, None))
    more = (*REGIONAL, case.theorem + "-weighted", "linearisation")
    known = {*wanted, *((id, None, None) for id in more)}
    found = [(check.id, check.mode, check.group) for check in case.checks]
    # an id, a mode or a group that is not known could not be decided
    need(set(found) <= known, "there is a check that nobody asked for")
    need(len(set(found)) == len(found), "a check stands there twice")
    need(set(wanted) <= set(found), "a check is missing")


def confirm(case: Case, check: Any) -> None:
    """Decide one claim."""
    open_claim = check.verdict == "undecided"
    about_region = check.id in REGIONAL and not open_claim
    domain = "global" if check.id in FACTS else case.domain
    need(about_region or check.domain == domain, "the domain is wrong")
    if open_claim:
        claimed = (check.margin, check.rate, check.factor, check.exact, check.witness)
        need(claimed == (None,) * 5, "it is undecided and claims something")
        return
    need(
        check.verdict in ("proved", "refuted"),
        "the verdict is none of proved, refuted and undecided",
    )
    rooms = saturates(case) and check.id == "actuators"
    about_flow = check.id not in (*FACTS, "readings", "equilibrium") and not rooms
    need(not (case.sampled and about_flow), "all is computed from samples, and it is about a flow")
    # by now id, mode and group are known, and the observer is the one of the problem
    decide = regional if about_region else decider(case, check.id)
    bounded(case, check, decide(case, check))


def decider(case: Case, id: str) -> Decider:
    """What decides a check that is not about a region."""
    if id in FACTS:
        return fact
    if id == case.theorem + "-weighted":
        return weighted
    if id == "linearisation":
        return linearisation
    return consensus


def regional(agents: Case, check: Any) -> Any:
    """A claim about a region that is proved or refuted."""
    # inputs are those of agents
    own = agents.agrees and check.id == "actuators"
    case = agents if own else rows_of(agents)
    rooms = saturates(agents) and check.id == "actuators"
    if saturates(agents) and not rooms:
        case = cut(agents)
    need(check.margin is None, "it has no margin to claim")
    need(case.q == 0 or case.W is not None, "there is no observer gain")
    such = (
        not (case.single or rooms),
        case.own is not None,
        case.leader is not None,
        saturates(agents),
        case.fixed and saturates(case),
        case.gap,
        case.differences,
        case.agrees,
        agents.signed,
    )
    for (what, ids), is_such in paired(KNOWN_TO.items(), such):
        need(not is_such or check.id in ids.split(), f"{what} are not known to it")
    if saturates(agents):
        counted = type(check.domain) is str or (check.domain.disturbance or 0) <= allowed(agents)
        need(counted, "what saturation leaves is known for smaller errors of the estimates")
    # of signs, rows alone are refuted
    rows = check.verdict == "proved" or check.id == "max-separable"
    need(rows or not agents.signed, "signs that fit no two sides are not known to it")
    if check.verdict == "proved":
        need(check.witness is None, "it is proved and carries a witness")
    else:
        need(check.domain == case.domain, "the domain is wrong")
        # what is refuted has no decay to state
        need(check.rate is None, "it is refuted and claims a rate")
        need(check.id in REFUTABLE, "it cannot be refuted")
    claim = REGIONAL[check.id](case, check)
    if check.id == "equilibrium":
        need(
            case.guarantee.may_stay(check.exact["mode"]),
            "the guarantee does not let that mode stay on",
        )
    return claim
