"""What the checks of a region are asked, and whether a check proves it: the contract, "Coverage".

A proof covers what is asked if its set of starts holds the region; the two are compared exactly.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ZERO, root_above
from dobc_design.loop.loop import Loop

from .case import Case
from .check import Check
from .domain import EVERYWHERE, Around, Box, Domain
from .numbers import claimed, decimal_above


def covers(loop: Loop, check: Check, checks: Sequence[Check]) -> bool:
    """Whether this check proves what the problem asks."""
    # without a rate it is no proof of consensus
    safe = check.kind.role == "safety" and check.rate is not None
    # A settling time ends in a proof that holds from then on, whatever the signal.
    settles = check.id == "settling" and bool(loop.starts) and not loop.guarantee.is_given
    if not check.is_proved or not (check.kind.is_consensus or safe or settles):
        return False
    if check.kind.is_lemma and not _speaks_for_all_modes(loop, check, checks):
        return False
    if loop.starts is not None:
        return holds_region(loop, check.domain)
    # others are about some starts, and the question is about the consensus itself
    if check.kind.role not in ("region", "safety"):
        return True
    return check.domain == EVERYWHERE or _is_near(loop, check)


def covering(loop: Loop, checks: Sequence[Check]) -> list[Check]:
    """Those of the checks that prove what the problem asks."""
    return [check for check in checks if covers(loop, check, checks)]


def _speaks_for_all_modes(loop: Loop, check: Check, checks: Sequence[Check]) -> bool:
    """Whether Lemma 1 is proved for every mode, and this check is the slowest of them."""
    # With an observer Lemma 1 is a part of the theorems, and no proof by itself.
    if loop.groups:
        return False
    lemmas = [other for other in checks if other.kind.is_lemma]
    if {other.mode for other in lemmas} != set(loop.modes):
        return False
    # One V = e'e serves every mode, so all have to hold; the slowest speaks for them.
    if not all(other.is_proved for other in lemmas):
        return False
    return check is min(lemmas, key=lambda other: other.rate or 0.0)


def holds_region(loop: Loop, domain: Domain) -> bool:
    """Whether a domain holds all starts of the [region]."""
    region = loop.starts
    if region is None or not isinstance(domain, Around):
        return domain == EVERYWHERE
    radius = claimed(domain.radius)
    reach = asked_radius(loop)
    if isinstance(domain, Box):
        inside = radius >= max(reach)
    else:
        # A ball has to hold the corners of the box of all starts.
        inside = radius >= 0 and radius**2 >= _corner(loop, reach)
    if region.disturbance is None:
        return inside
    return inside and claimed(domain.disturbance) >= region.disturbance


def is_box_near(loop: Loop, domain: Domain) -> bool:
    """Whether a domain is a box around the target, of errors and, with an exosystem, of estimation
    errors."""
    # Of radius 0 it is the target alone.
    if not isinstance(domain, Around) or domain.radius <= 0:
        return False
    return not loop.groups or domain.disturbance > 0


def _is_near(loop: Loop, check: Check) -> bool:
    """Whether a box around the target is proved: under switching, and for agents with dynamics,
    and of disagreements, that answers the local question, too; so does a ball where the slopes of f
    move with a leader."""
    is_safety = check.kind.role == "safety"
    known = is_safety or check.kind.role == "region"
    if check.kind.topic == "quadratic":
        known = loop.slopes_move
    several = (
        loop.switches
        or is_safety
        or loop.timing is not None
        or loop.drift is not None
        or loop.gap > 0
    )
    return (several or loop.is_apart) and known and is_box_near(loop, check.domain)


def asked_radius(loop: Loop) -> tuple[Fraction, ...]:
    """R_c, per component: the largest |e_ic(0)| that the region allows, wherever a leader
    starts."""
    if loop.starts is None:
        return ()
    goals = loop.goals.different(range(loop.n))
    reach = list[Fraction]()
    states = zip(loop.starts.states, loop.goals.starts, strict=True)
    for c, ((lo, hi), (least, most)) in enumerate(states):
        # An error is largest where the agent and its leader start at opposite ends.
        below = max(abs(lo - goal[c] - most) for goal in goals)
        above = max(abs(hi - goal[c] - least) for goal in goals)
        reach.append(max(below, above))
    return tuple(reach)


def asked_ball(loop: Loop, reach: Sequence[Fraction]) -> float:
    """The radius, rounded up, of the smallest ball that holds every |e_ic| <= ``reach[c]``."""
    return decimal_above(root_above(_corner(loop, reach), unit=10**9))


def _corner(loop: Loop, reach: Sequence[Fraction]) -> Fraction:
    """The largest e'e where every |e_ic| is at most ``reach[c]``."""
    return loop.n * sum((r * r for r in reach), ZERO)


Progress = Callable[[str], None]

#: Both radii of the box that is tried first for the local question of several modes.
NEAR = 1e-3
#: The radius of a region that is a point.
POINT = 1e-6
#: The largest box that is tried where no region is asked for, in the unit of the states.
CAP = Fraction(10)


@noun
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

    @property
    def case(self) -> Case:
        """What a check of it is confirmed for."""
        return Case(loop=self.loop, W=self.W, domain=self.domain)


def read_region(
    loop: Loop, W: Matrix | None, *, domain: Domain, everything: bool, rate: float = 0.0
) -> Asked:
    """Decimals that are not below what is asked; a point counts as a small region."""
    region = loop.starts
    if region is None:
        # Where nothing is asked for, the largest box up to some size is looked for.
        reach = (CAP,) * loop.m
        disturbance = _disturbance_of_runs(loop)
    else:
        reach = asked_radius(loop)
        disturbance = region.disturbance or ZERO
    return Asked(
        loop=loop,
        W=W,
        radius=decimal_above(max(reach)) or POINT,
        ball=asked_ball(loop, reach) or POINT,
        disturbance=decimal_above(disturbance),
        domain=domain,
        wanted=region is not None,
        everything=everything,
        rate=rate,
    )


def _disturbance_of_runs(loop: Loop) -> Fraction:
    """The largest |xi_i(0)| of the simulation, about, where xihat begins at 0."""
    squares = [sum((x * x for x in row), ZERO) for row in loop.xi0 or ()]
    largest = root_above(max(squares, default=ZERO), unit=10**6)
    if loop.groups and not largest and (loop.actuators or loop.uncertainty):
        # a box answers for a table if it holds errors of the estimates, too
        return claimed(NEAR)
    return largest
