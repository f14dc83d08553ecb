"""Weighted Theorems 1 and 2: when they are tried and what they report."""

from collections.abc import Iterator
from dataclasses import replace

from dobc_design.conditions.check import (
    Check,
    cut_check,
    fastest_in_words,
    limited,
    undecided_check,
)
from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.observer.decide import too_large
from dobc_design.conditions.reason import Reason
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.work import out_of_time
from dobc_design.loop.arcs import unreached
from dobc_design.loop.loop import Loop

from .checks import id_for, weighted_check
from .decide import Weighted, why_not
from .network import Alike, Network, network_of
from .propose import disagreeing, promised_factor, proposals
from .propose_alike import MOST_STATES, alike_proposals

KEPT = 0.002  # how much faster than wanted, for digits that are cut
CLOSE = 0.01  # rates that differ by a smaller part are the same


def _with_fastest(
    check: Check, rate: float, fastest: tuple[Weighted | Alike, float] | None
) -> Check:
    """The check with a sentence about the fastest claim, if that is another one."""
    if fastest is None or fastest[1] < rate * (1 + CLOSE):
        return check
    return replace(
        check, reason=check.reason + fastest_in_words(fastest[1], promised_factor(fastest[0]))
    )


def weighted_stage(statements: Statements, W: Matrix | None, *, rate: float = 0.0) -> list[Check]:
    """The check of the weighted theorem for the gain W (q, m); none where it says no more than
    other checks.  ``rate`` (1/s): of the claims with at least this rate the one with the least time
    to one percent is looked for."""
    loop = statements.loop
    modes = loop.modes
    id = id_for(loop)
    # Where gains are not diagonal, agents may still feel their neighbours alike.
    network = network_of(statements) if why_not(statements) is not None else None
    if isinstance(network, Reason):
        # Where agents agree the theorem has no other form.
        why = undecided_check(id, statements.domain, str(network), applies=False)
        return [why] if loop.agrees and loop.drift else []
    alone = loop if network is None else network.statements.loop
    if any(unreached(alone, [arcs]) for arcs in modes.values()):
        return []
    late = out_of_time()
    if late is not None:
        return [cut_check(id, statements.domain, late)]
    reason = _too_large(loop, network)
    if reason is not None:
        return [undecided_check(id, statements.domain, reason)]

    def decided() -> Check:
        least = rate * (1 + KEPT)
        found: Iterator[tuple[Weighted | Alike, float]]
        if network is None:
            found = proposals(statements, W, least=least)
        else:
            found = alike_proposals(loop, network, W, least=least)
        # The first that exact arithmetic proves; the next one tells how fast it could be.
        for claim, speed in found:
            check = weighted_check(statements, W, claim, rate=speed)
            if check.is_proved:
                return _with_fastest(check, speed, next(found, None))
        check = weighted_check(statements, W, None, rate=0.0)
        pair = disagreeing(alone) if len(modes) > 1 else None
        if pair is None:
            return check
        reason = f"no weights D are found that serve the modes {pair[0]} and {pair[1]} together."
        return replace(check, reason=reason)

    return [limited(id, statements.domain, decided)]


def _too_large(loop: Loop, network: Network | None) -> str | None:
    """Why a loop of this size is left out; None if it is not."""
    for group in loop.groups:
        reason = too_large(group.exosystem)
        if reason is not None:
            return reason
    if network is not None and loop.m > MOST_STATES:
        return (
            f"left out, because it takes long with {loop.m} states per agent; it is "
            f"examined up to {MOST_STATES}."
        )
    return None
