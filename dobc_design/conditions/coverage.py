"""What the checks of a region are asked, and whether a check proves it: the contract, "Coverage".

A proof covers what is asked if its set of starts holds the region; the two are compared exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import EVERYWHERE, Around, Box, Domain
from dobc_design.conditions.numbers import claimed, decimal_above
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import root_above
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict


def covers(loop: Loop, check: Check, checks: Sequence[Check]) -> bool:
    """Whether this check proves what the problem asks."""
    # without a rate it is no proof of consensus
    safe = check.kind.role == "safety" and check.rate is not None
    if check.verdict is not Verdict.PROVED or not (check.kind.is_consensus or safe):
        return False
    if check.kind.is_lemma:
        if loop.groups:
            return False
        lemmas = [other for other in checks if other.kind.is_lemma]
        if {other.mode for other in lemmas} != set(loop.modes):
            return False
        # One V = e'e serves every mode, so all have to hold; the slowest speaks for them.
        if not all(other.verdict is Verdict.PROVED for other in lemmas):
            return False
        if check is not min(lemmas, key=lambda other: other.rate or 0.0):
            return False
    # others are about some starts, and the question is about the consensus itself
    if loop.starts is None:
        return (
            check.kind.role not in ("region", "safety")
            or check.domain == EVERYWHERE
            or _is_near(loop, check)
        )
    return holds_region(loop, check.domain)


def holds_region(loop: Loop, domain: Domain) -> bool:
    """Whether a domain holds all starts of the [region]."""
    region = loop.starts
    if region is None or not isinstance(domain, Around):
        return domain == EVERYWHERE
    radius, reach = claimed(domain.radius), asked_radius(loop)
    if isinstance(domain, Box):
        inside = radius >= max(reach)
    else:
        square = loop.n * sum((r * r for r in reach), Fraction(0))
        inside = radius >= 0 and radius**2 >= square
    if region.disturbance is None:
        return inside
    return inside and claimed(domain.disturbance) >= region.disturbance


def is_box_near(loop: Loop, domain: Domain) -> bool:
    """Whether a domain is a box around the target, of errors and, with an exosystem, of estimation
    errors."""
    if not isinstance(domain, Around) or domain.radius <= 0:
        return False
    return not loop.groups or domain.disturbance > 0


def _is_near(loop: Loop, check: Check) -> bool:
    """Whether a box around the target is proved: under switching, and for agents with dynamics,
    that answers the local question, too; so does a ball where the slopes of f move with a
    leader."""
    is_safety = check.kind.role == "safety"
    if check.kind.topic == "quadratic":
        known = loop.slopes_move
    else:
        known = is_safety or check.kind.role == "region"
    several = loop.switches or is_safety or loop.drift is not None
    return several and known and is_box_near(loop, check.domain)


def asked_radius(loop: Loop) -> tuple[Fraction, ...]:
    """R_c, per component: the largest |e_ic(0)| that the region allows, wherever a leader
    starts."""
    pairs = loop.starts.states if loop.starts is not None else ()
    goals = (
        {loop.goals.of(agent) for agent in range(loop.n)}
        if loop.goals.offsets
        else {loop.goals.target}
    )
    return tuple(
        max(max(abs(lo - goal[c] - leads[1]), abs(hi - goal[c] - leads[0])) for goal in goals)
        # no pairs without a region
        for c, ((lo, hi), leads) in enumerate(zip(pairs, loop.goals.starts, strict=False))
    )


Progress = Callable[[str], None]

#: Both radii of the box that is tried first for the local question of several modes.
NEAR = 1e-3
#: The largest box that is tried where no region is asked for, in the unit of the states.
CAP = Fraction(10)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is to be covered: |e|_inf <= radius and |eps_i| <= disturbance, by the loop with the
    gain W (q, m).

    ``ball``: |e| <= ball holds all of these starts, and no less of the region does.  ``wanted`` is
    False where no region was asked for and the largest up to ``radius`` is looked for.  ``domain``:
    that of Lemma 1.  ``everything``: go on where the region is covered already.  ``rate`` (1/s): of
    those with at least this rate the proof with the least time to one percent is looked for.
    """

    loop: Loop
    W: Matrix | None
    radius: float
    ball: float
    disturbance: float
    domain: Domain
    wanted: bool
    everything: bool
    rate: float = 0.0


def read_region(
    loop: Loop, W: Matrix | None, *, domain: Domain, everything: bool, rate: float = 0.0
) -> Asked:
    """Decimals that are not below what is asked; a point counts as a small region."""
    region = loop.starts
    reach = (CAP,) * loop.m if region is None else asked_radius(loop)
    if region is None:  # the largest |xi_i(0)| of the simulation, about, where xihat begins at 0
        rows = loop.xi0 or ()
        largest = max((sum((x * x for x in row), Fraction(0)) for row in rows), default=Fraction(0))
        disturbance = root_above(largest, unit=10**6)
        if loop.groups and not disturbance and (loop.actuators or loop.uncertainty):
            # a box answers for a table if it holds errors of the estimates, too
            disturbance = claimed(NEAR)
    else:
        disturbance = region.disturbance or Fraction(0)
    square = loop.n * sum((r * r for r in reach), Fraction(0))
    return Asked(
        loop=loop,
        W=W,
        radius=decimal_above(max(reach)) or 1e-6,
        ball=decimal_above(root_above(square, unit=10**9)) or 1e-6,
        disturbance=decimal_above(disturbance),
        domain=domain,
        wanted=region is not None,
        everything=everything,
        rate=rate,
    )
