"""Whether a box holds an equilibrium of one mode other than the target; it searches for nothing.

With eps = 0 the error system (22) is e' = f(e) = h(e) - K e, whatever the gain W.  Krawczyk's test
shows an e* != 0 with f(e*) = 0 in a box X with the middle c: if c - Y f(c) + (I - Y F)(X - c) lies
in the interior of X, where F encloses the slopes of f on X (Clarke's at kinks), x - Y f(x) maps X
into itself and Y is invertible, so X holds exactly one zero.  A proved one inside the region asked
for is the start of a motion that never reaches the target.
"""

from collections.abc import Mapping
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Witness, read_parts
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.numbers import (
    VECTOR_BITS,
    fields_to_json,
    has_short_denominator,
    read_rational,
)
from dobc_design.conditions.reason import fixed_obstacle, saturation_obstacle, signs_obstacle
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.tree import GradientAlgebra, IntervalAlgebra, evaluate
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Box, Interval, UndefinedError
from dobc_design.exact.matrix import (
    Matrix,
    Vector,
    dot,
    from_float,
    identity,
    multiply,
    subtract,
)
from dobc_design.exact.number import ONE, ZERO, nearest, number_text
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

Slopes = Mapping[tuple[int, int], Interval]

LARGEST = 60  # rows n m
NOTHING = Interval.point(0)
SHOWN = 6  # components of an equilibrium that a sentence names


@noun
class Equilibrium:
    """A claim: the box, n m intervals for e, agent by agent, holds an equilibrium of h(e) - K e in
    ``mode`` and not 0. A box of points is one itself: then others may lie beside it.  Raises:
    ShapeError or SpecError for no claim."""

    mode: str
    box: Box

    def __post_init__(self) -> None:
        if not self.box:
            raise ShapeError("box must have one interval per component of e; got none.", key="box")
        if len({side.is_point for side in self.box}) > 1:
            raise SpecError("every side of the box must be longer than 0, or none.", key="box")

    @property
    def is_point(self) -> bool:
        """Whether the equilibrium is known exactly."""
        return self.box[0].is_point

    @property
    def middle(self) -> Vector:
        """The middle of the box, (n m,)."""
        return tuple(side.midpoint for side in self.box)

    def to_json(self) -> dict[str, Any]:
        return fields_to_json(self, "mode", "box")


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Equilibrium:
    """What a proved check of this topic claims, for this problem."""
    if loop.size > LARGEST:
        raise ValueError(f"the box must have at most {LARGEST} intervals")
    sides = ((read_rational,) * 2,) * loop.size
    values = read_parts(check.exact, {"mode": None, "box": sides})
    if values["mode"] not in list(loop.modes):
        raise ValueError("it needs a mode of this problem")
    if not has_short_denominator(chain.from_iterable(values["box"]), VECTOR_BITS):
        raise ValueError("the box needs too long a common denominator")
    return Equilibrium(mode=values["mode"], box=tuple(Interval(*ends) for ends in values["box"]))


def field_at(loop: Loop, mode: str, point: Vector) -> Box:
    """Enclose f(e) = h(e) - K e at one rational point, (n m,).  Raises: UndefinedError."""
    m = loop.m
    total = [NOTHING] * loop.size
    point = (*point, *[ZERO] * m * len(loop.fixed))
    for listener, speaker, weight in loop.modes[mode]:
        heard = point[speaker * m : (speaker + 1) * m]
        own = point[listener * m : (listener + 1) * m]
        y = tuple(Interval.point(b - a) for a, b in zip(own, heard, strict=True))
        values = _values(loop.function_of(listener, speaker), y)
        for c, value in enumerate(values):
            total[listener * m + c] += value * weight
    for agent, gain in loop.pulls.gains.items():
        own = point[agent * m : (agent + 1) * m]
        for c, row in enumerate(gain):
            total[agent * m + c] -= dot(row, own)
    return tuple(total)


def _values(h: Coupling, y: Box) -> list[Interval]:
    """Enclose h(y), component by component."""
    algebra = IntervalAlgebra()
    if h.by_component:
        node = h.components[0].node
        return [evaluate(node, (each,), algebra) for each in y]
    return [evaluate(each.node, y, algebra) for each in h.components]


def slopes_on(loop: Loop, mode: str, box: Box) -> Slopes:
    """Enclose the entries of df/de on a box; those that are not there are 0.  Raises:
    UndefinedError."""
    m = loop.m
    found: dict[tuple[int, int], Interval] = {}

    def add(row: int, column: int, slope: Interval) -> None:
        found[row, column] = found.get((row, column), NOTHING) + slope

    box = (*box, *[NOTHING] * m * len(loop.fixed))
    for listener, speaker, weight in loop.modes[mode]:
        heard = box[speaker * m : (speaker + 1) * m]
        own = box[listener * m : (listener + 1) * m]
        y = tuple(b - a for a, b in zip(own, heard, strict=True))
        for (c, d), slope in _partials(loop.function_of(listener, speaker), y):
            if speaker < loop.n:
                add(listener * m + c, speaker * m + d, slope * weight)
            add(listener * m + c, listener * m + d, -(slope * weight))
    for agent, gain in loop.pulls.gains.items():
        for c, row in enumerate(gain):
            for d, k in enumerate(row):
                add(agent * m + c, agent * m + d, Interval.point(-k))
    return found


def _partials(h: Coupling, y: Box) -> list[tuple[tuple[int, int], Interval]]:
    """Enclose dh_c/dy_d on a box, by (c, d), where it is not 0 by its form."""
    found = list[tuple[tuple[int, int], Interval]]()
    for c in range(len(y)):
        places = range(len(y))
        component = h.components[0 if h.by_component else c]
        if h.by_component:
            places = range(c, c + 1)
        algebra = GradientAlgebra(len(places))
        variables = algebra.variables([y[d] for d in places])
        partials = evaluate(component.node, variables, algebra).partials
        for d, slope in zip(places, partials, strict=True):
            found.append(((c, d), slope))
    return found


def why_not(loop: Loop, claim: Equilibrium, *, part: Fraction = ONE) -> str | None:
    """None if the box is proved, by Krawczyk's test on a ``part`` of each half width, to hold an
    equilibrium other than 0; else why that is not shown.  Raises: ShapeError; SpecError for an
    unknown mode."""
    sides = len(claim.box)
    if sides != loop.size:
        what = f"box must have {loop.size} sides, one per component of e; got {sides}."
        raise ShapeError(what, key="box")
    if claim.mode not in loop.modes:
        raise SpecError(f"mode must be one of the problem's; got {claim.mode[:60]!r}.", key="mode")
    if loop.agrees:
        return "agents without a target may rest anywhere."
    reason = saturation_obstacle(loop) or fixed_obstacle(loop) or signs_obstacle(loop)
    if reason is not None:
        return reason
    if not loop.may_stay(claim.mode):
        return "the guarantee does not let that mode stay on."
    if sides > LARGEST:
        return f"equilibria are proved for at most {LARGEST} rows n m."
    if all(side.contains(0) for side in claim.box):
        return "the box holds the target itself."
    try:
        value = field_at(loop, claim.mode, claim.middle)
        # A point is one itself: others may lie around it, so that no test of a box would hold.
        if claim.is_point:
            exactly = all(each == NOTHING for each in value)
            return None if exactly else "the point is not shown to be an equilibrium exactly."
        slopes = slopes_on(loop, claim.mode, claim.box)
    except UndefinedError as error:
        return f"the couplings are not bounded on the box: {error}"
    # Any Y makes a valid test; a good one makes it succeed.
    Y = _preconditioner(slopes, sides)
    if Y is None or not krawczyk_holds(claim, value, slopes, Y, part):
        return "Krawczyk's test does not show an equilibrium in the box."
    return None


def lies_in_region(loop: Loop, claim: Equilibrium) -> bool:
    """Whether every x = e + goal in the box is a start that the region asks for; true without a
    region."""
    if loop.starts is None:
        return True
    pairs = list(loop.starts.exact) * loop.n
    goals = [goal for agent in range(loop.n) for goal in loop.goals.of(agent)]
    sides = zip(pairs, goals, claim.box, strict=True)
    return all(lo <= side.lo + goal and side.hi + goal <= hi for (lo, hi), goal, side in sides)


def refuting_check(loop: Loop, claim: Equilibrium) -> Check | None:
    """The check that consensus fails in the region; None unless the equilibrium is proved and lies
    there."""
    # Without a region only what happens near the target is asked.
    if loop.starts is None or not lies_in_region(loop, claim):
        return None
    if why_not(loop, claim) is not None:
        return None
    return Check(
        id="equilibrium",
        verdict=Verdict.REFUTED,
        domain=EVERYWHERE if loop.is_linear else NEAR_TARGET,
        reason=_reason(loop, claim),
        claim=claim,
        witness=Witness(kind="start", values=tuple(map(number_text, claim.middle))),
    )


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a refuted check of this topic claims is confirmed, else what is
    not."""
    loop, W = case.loop, case.W
    if check.verdict is not Verdict.REFUTED or check.domain != case.domain:
        return f"an equilibrium can only refute, with the domain '{case.domain}'"
    if loop.groups and W is None:
        return "without W there is no loop that could rest"
    if loop.drift_place is not None or loop.goals.moves:
        return (
            "it is not known for agents whose own dynamics are curved, nor with a leader, "
            "beside which nobody rests"
        )
    if check.margin is not None or check.rate is not None or check.mode is not None:
        return "it claims a number that this check does not have"
    witness = check.witness
    if witness is None or witness.kind != "start" or witness.labels is not None:
        return "it needs a start"
    claim = read_claim(check, loop, W)
    if tuple(map(read_rational, witness.values or ())) != claim.middle:
        return "the start is not the middle of the box"
    if not lies_in_region(loop, claim):
        return "the box leaves the region asked for"
    return why_not(loop, claim)


def _preconditioner(slopes: Slopes, size: int) -> Matrix | None:
    """Any invertible rational Y would do; the inverse of the middle slopes, by floating point,
    makes the test sharp."""
    middle = np.zeros((size, size))
    for place, slope in slopes.items():
        middle[place] = nearest(slope.midpoint)
    if not np.isfinite(middle).all():
        return None
    try:
        with np.errstate(all="ignore"):
            Y = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(Y).all():
        return None
    return from_float(Y, None)


def krawczyk_holds(
    claim: Equilibrium, value: Box, slopes: Slopes, Y: Matrix, part: Fraction
) -> bool:
    """Whether c - Y f(c) + (I - Y F)(X - c) lies inside X; F = M +- R adds |I - Y M| w + |Y| R w to
    half widths w."""
    half = tuple(side.width / 2 for side in claim.box)
    M = [[ZERO] * len(Y) for _ in Y]
    spread = [ZERO] * len(Y)
    for (row, column), slope in slopes.items():
        # A short middle keeps the rationals short; R is what the enclosure reaches beyond it.
        middle = Fraction(nearest(slope.midpoint))
        M[row][column] = middle
        spread[row] += max(slope.hi - middle, middle - slope.lo) * half[column]
    rest = subtract(identity(len(Y)), multiply(Y, tuple(map(tuple, M))))
    centres = tuple(each.midpoint for each in value)
    blurs = tuple(each.width / 2 + s for each, s in zip(value, spread, strict=True))
    for own, left, width in zip(Y, rest, half, strict=True):
        # How far the image of X reaches from the middle, in this row.
        moved = abs(dot(own, centres))
        blur = dot(tuple(map(abs, own)), blurs)
        linear = dot(tuple(map(abs, left)), half)
        if moved + blur + linear >= part * width:
            return False
    return True


def _reason(loop: Loop, claim: Equilibrium) -> str:
    m = loop.m
    named = list[str]()
    for k, e in enumerate(claim.middle[:SHOWN]):
        agent, c = divmod(k, m)
        place = loop.labels[agent] + ("" if m == 1 else f".{c + 1}")
        named.append(f"{place}: {nearest(e + loop.goals.of(agent)[c]):.6g}")
    more = ", ..." if len(claim.middle) > SHOWN else ""
    advice = "Ask for a smaller region, or raise the gains until it is gone."
    if claim.is_point:
        advice = "Others may lie between it and the target: pin more agents."
    return (
        f"Consensus fails: in mode {claim.mode} the agents can rest away from the target, at x = "
        f"({', '.join(named)}{more}). This start lies in the region asked for. {advice}"
    )
