"""What is asked of a certificate, and in which order."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from .accuracy import accuracy
from .claims import Certificate
from .consensus import OF_GROUPS, consensus, fact, linearisation, observer, weighted
from .coordinates import boxes
from .cycles import schedule
from .factors import bounded
from .files import Problem
from .graphs import markov, safety
from .margins import actuators, tolerance
from .quadratic import lure
from .reading import MAX_BYTES, UNTIL, OutOfTime, Refused, need
from .schedule import settling
from .separable import delay, equilibrium, sampling
from .verdict import overall

__all__ = ["MAX_BYTES", "Refused", "examine"]


FACTS = (*OF_GROUPS, "reachability")
Decider = Callable[[Certificate, Any], None]
REGIONAL: dict[str, Decider] = {
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
# of these the claims themselves say for which couplings they hold
OF_ANY_COUPLING = ("max-separable", "lure", "equilibrium", "markov", "accuracy", "schedule")
REFUTABLE = ("max-separable", "equilibrium", "markov", "schedule")
Task = tuple[str, partial[None]]


def examine(certificate: bytes, problem: bytes, until: float = math.inf) -> list[tuple[bool, str]]:
    """Every claim of a certificate: does it hold, what it is, and why it fails. It is confirmed iff
    all of them hold.

    ``until``: a time of ``time.monotonic``, after which no further claim is examined; the list is
    then shorter.
    Raises: Refused if one of the two files is not what the format page describes.
    """
    token = UNTIL.set(until)
    try:
        case = Certificate(certificate, Problem(problem))
        return list(findings_of(case))
    except OutOfTime:
        return []
    finally:
        UNTIL.reset(token)


def findings_of(case: Certificate) -> Iterator[tuple[bool, str]]:
    """What holds and what does not, stage by stage: a later stage relies on those before it."""
    for stage in stages(case):
        failed = False
        for title, task in stage:
            try:
                task()
                yield True, title
            except OutOfTime:
                return
            except Refused as error:
                failed = True
                yield False, f"{title}: {error}"
        if failed:
            return


def stages(case: Certificate) -> list[list[Task]]:
    """What is examined."""
    about = [
        ("it belongs to this problem", partial(belonging, case)),
        ("its list of checks", partial(completeness, case)),
    ]
    gain = [("its observer gain and pair (P, Q)", partial(observer, case))]
    claims = []
    for check in case.checks:
        title = f"{check.id} {check.mode or ''}: {check.verdict}"
        claims.append((title, partial(confirm, case, check)))
    last = [(f"overall verdict: {case.claims.verdict}", partial(overall, case))]
    return [about, gain, claims, last]


def belonging(case: Certificate) -> None:
    """The certificate is about this problem."""
    claims = case.claims
    stated = case.problem.stated
    need(claims.problem == stated.name, "the problem has another name")
    need(claims.problem_sha256 == case.problem.sha256, "the problem file has another hash")
    need(
        claims.notes[: len(stated.notes)] == stated.notes,
        "the notes of the problem are not repeated",
    )


def completeness(case: Certificate) -> None:
    """Every check that has to be there is there, once, and none that is not known."""
    loop = case.loop
    wanted: list[Any] = [
        (id, mode, None) for mode in loop.modes for id in ("reachability", "lemma1")
    ]
    wanted += [(id, None, group) for id in OF_GROUPS for group in loop.names]
    if loop.q:
        wanted.append((case.theorem, None, None))
    if loop.P is not None:
        wanted.append((case.theorem + "-printed", None, None))
    more = (*REGIONAL, case.theorem + "-weighted", "linearisation")
    known = {*wanted, *((id, None, None) for id in more)}
    found = [(check.id, check.mode, check.group) for check in case.checks]
    # an id, a mode or a group that is not known could not be decided
    need(set(found) <= known, "there is a check that nobody asked for")
    need(len(set(found)) == len(found), "a check stands there twice")
    need(set(wanted) <= set(found), "a check is missing")


def confirm(case: Certificate, check: Any) -> None:
    """Decide one claim."""
    open_claim = check.verdict == "undecided"
    about_region = check.id in REGIONAL and not open_claim
    domain = "global" if check.id in FACTS else case.loop.domain
    need(about_region or check.domain == domain, "the domain is wrong")
    if open_claim:
        claimed = (check.margin, check.rate, check.factor, check.exact, check.witness)
        need(claimed == (None,) * 5, "it is undecided and claims something")
        return
    need(
        check.verdict in ("proved", "refuted"),
        "the verdict is none of proved, refuted and undecided",
    )
    # by now id, mode and group are known, and the observer is the one of the problem
    decide = regional if about_region else decider(case, check.id)
    decide(case, check)
    bounded(case, check)


def decider(case: Certificate, id: str) -> Decider:
    """What decides a check that is not about a region."""
    if id in FACTS:
        return fact
    if id == case.theorem + "-weighted":
        return weighted
    return linearisation if id == "linearisation" else consensus


def regional(case: Certificate, check: Any) -> None:
    """A claim about a region that is proved or refuted."""
    loop = case.loop
    need(check.margin is None, "it has no margin to claim")
    need(loop.q == 0 or case.W is not None, "there is no observer gain")
    need(check.id in OF_ANY_COUPLING or loop.single, "a coupling is a list, or nodes are curved")
    need(loop.own is None or check.id not in ("equilibrium", "markov"), "nodes are curved")
    need(
        loop.leader is None or check.id not in ("equilibrium", "delay", "sampling"),
        "the leader moves on",
    )
    if check.verdict == "proved":
        need(check.witness is None, "it is proved and carries a witness")
    else:
        need(check.domain == loop.domain, "the domain is wrong")
        # what is refuted has no decay to state
        need(check.rate is None, "it is refuted and claims a rate")
        need(check.id in REFUTABLE, "it cannot be refuted")
    REGIONAL[check.id](case, check)
    if check.id == "equilibrium":
        need(
            loop.guarantee.may_stay(check.exact["mode"]),
            "the guarantee does not let that mode stay on",
        )
