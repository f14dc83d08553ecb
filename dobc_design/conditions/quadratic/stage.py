"""The quadratic certificates of the region asked for: the ball that V = e'P_e e + sum eps_i'P eps_i
proves.

Theory, section 4.  ``propose`` proposes P_e = I, a diagonal and a full P_e, cheapest first;
``verify`` decides.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design._checks import positional
from dobc_design.conditions.check import (
    Check,
    cut_check,
    fastest_in_words,
    surviving,
    undecided_check,
)
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.numbers import bisected, claimed, rounded_down, time_to_one_percent
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted, out_of_time, spend
from dobc_design.loop.loop import Loop

from .claim import Lure, Shape
from .decide import (
    IN_WORDS,
    certified_ball,
    lure_check,
    quadratic_obstacle,
    verify_lure,
)
from .propose import (
    Wanted,
    bound_lure,
    condition_of,
    design_lure,
    linear_rate,
    raise_rate,
    sooner_lures,
)

#: Rows n m up to which quadratic certificates are looked for, and up to which with a full P_e; with
#: at most ``SMALL_ROWS`` a full one is found so soon that it is looked for beside other proofs.
MOST_ROWS = 60
FULL_ROWS = 20
SMALL_ROWS = 15
MOST_MODES = 200  # up to which one V is looked for
# of a mode, up to which the corners of all gains are tried with the P_e found
CORNER_CHANNELS = 6
#: Where the region is covered: parts of the rate near the consensus that are tried, by bisection;
#: rows n m from which on fewer are.
RATE_STEPS = 5
FEWER_STEPS = 3
MANY_ROWS = 11
MODE = 20  # steps of work for the inequality of a mode
SOONER = 5  # rates that are tried for the least time to one percent
FLAT = 1.01  # times are next to that of P_e = I below this part
KEPT = 0.002  # how much faster than wanted, for digits that are cut
# no |e_j - e_i| beyond is looked at, unless the region asks for more
_LARGEST = Fraction(400)


@positional
class Found:
    """A certificate and the ball that it covers together with the disturbance asked for."""

    name: str
    lure: Lure
    radius: float


def quadratic_stage(asked: Asked, report: Progress) -> list[Check]:
    """The quadratic certificate: the first that covers the ball asked for, else the one with the
    largest ball."""
    loop = asked.loop
    rows = loop.size
    reason = quadratic_obstacle(loop, asked.W)
    if reason is not None:
        return [undecided_check("lure", asked.domain, reason, applies=False)]
    reason = _too_large(rows, len(loop.modes))
    if reason is not None:
        return [undecided_check("lure", asked.domain, reason)]
    # shapes and interval bounds; or a large full P_e
    many = asked.everything or SMALL_ROWS < rows <= FULL_ROWS
    work = 3 * STAGE if many else STAGE
    with at_most(work):
        found = _ladder(asked, report)
        cut = exhausted()
    if not found and cut is not None:
        longer = not many and out_of_time() is None
        return [cut_check("lure", asked.domain, cut, longer=longer)]
    if not found:
        return [undecided_check("lure", asked.domain, _none_found(asked))]
    # Only the Lur'e inequalities know how to raise the rate.
    enough = [each for each in found if each.radius >= asked.ball and each.lure.method == "lure"]
    best = max(enough or found, key=lambda each: each.radius)
    remark = ""
    if best.radius >= asked.ball:
        report("deciding the region (quadratic, its rate)")
        # What ends for want of time leaves the proof that is there.
        with at_most(work), suppress(WorkLimitError):
            best, remark = _timed(asked, best)
    remark += _remark(asked, best, found)
    radius = 0.0 if math.isinf(best.radius) else best.radius
    return [lure_check(asked, best.lure, radius=radius, remark=remark)]


def _too_large(rows: int, modes: int) -> str | None:
    """Why a network of this size is left out; None if it is not."""
    if rows > MOST_ROWS:
        return (
            f"left out, because it takes long with {rows} rows n m; it is examined up to "
            f"{MOST_ROWS}."
        )
    if modes > MOST_MODES:
        return (
            f"left out, because it takes long with {modes} modes; it is examined up to "
            f"{MOST_MODES}."
        )
    return None


def _none_found(asked: Asked) -> str:
    """That no ball at all is covered, in words."""
    if not asked.disturbance:
        return "no quadratic V is found, not even close to the target."
    return (
        "no quadratic V is found for any ball together with "
        f"|eps_i| <= {asked.disturbance:.6g}: a smaller initial disturbance may help."
    )


def propose(
    asked: Asked, shape: Shape, *, rate: Fraction = Fraction(0), accept: float = 0.0
) -> Found | None:
    """The largest ball for a shape of P_e and a rate, proved; None if it is no larger than
    ``accept``."""
    noise = claimed(asked.disturbance)
    search = partial(design_lure, asked.loop, shape=shape, W=asked.W, rate=rate, disturbance=noise)
    return _found(asked, search, shape, IN_WORDS[shape], accept)


def _found(
    asked: Asked, search: Callable[..., Lure | None], what: str, name: str, accept: float = 0.0
) -> Found | None:
    """What a search among proved certificates finds, if it is larger than ``accept``."""
    # No |e_j - e_i| far beyond the ball asked for is looked at.
    ball = claimed(asked.ball)
    largest = max(2 * ball, min(10 * ball, _LARGEST))
    lure = None
    with surviving(f"no quadratic proposal ({what})", WorkLimitError):
        spend(_steps(asked.loop))
        lure = search(holds=partial(holds, asked.loop), largest=largest)
    if lure is None:
        return None
    radius = certified_ball(asked.loop, lure, disturbance=asked.disturbance)
    return Found(name, lure, radius) if radius > accept else None


def holds(loop: Loop, lure: Lure) -> bool:
    """Whether a certificate is proved.  Raises: WorkLimitError."""
    spend(_steps(loop))
    return verify_lure(loop, lure).is_proved


def _steps(loop: Loop) -> int:
    """What an exact inverse of the order of the exosystems takes, 27 s for order 200, and a matrix
    for every mode."""
    steps = MODE * len(loop.modes)
    if loop.joint_exosystem is not None:
        steps += loop.joint_exosystem.order**3 // 8
    return steps


def _ladder(asked: Asked, report: Progress) -> list[Found]:
    """What every shape of P_e covers, until the ball asked for is covered; all of them on
    request."""
    rows = asked.loop.size
    found: list[Found] = []
    shapes: list[Shape] = ["identity", "diagonal"]
    if rows <= FULL_ROWS:
        shapes.append("full")
    for shape in shapes:
        report(f"deciding the region (quadratic, {IN_WORDS[shape]})")
        proposal = propose(asked, shape)
        if proposal is None:
            continue
        found.append(proposal)
        if proposal.radius >= asked.ball and not asked.everything:
            return found
    # Linear couplings have no range of gains that other bounds could use better.
    if found and not asked.loop.is_linear:
        found += _bounds(asked, found[-1].lure)
    return found


def _bounds(asked: Asked, lure: Lure) -> list[Found]:
    """Without multipliers: the corners of all gains where those are few; on request, as a baseline,
    interval bounds."""
    search = partial(bound_lure, asked.loop, P=lure.P, Q=lure.Q)
    found: list[Found | None] = []
    ranges = [sum(map(bool, taus)) for taus in lure.multipliers.values()]
    if max(ranges) <= CORNER_CHANNELS:
        corners = partial(search, method="vertices", P_e=lure.P_e)
        found.append(_found(asked, corners, "vertices", "the corners of all gains"))
    if asked.everything:
        interval = partial(search, method="interval")
        found.append(_found(asked, interval, "interval", "interval bounds"))
    return [each for each in found if each is not None]


def _timed(asked: Asked, first: Found) -> tuple[Found, str]:
    """The same region with the least time to one percent that is found, and what the largest rate
    would be."""
    loop = asked.loop
    seen = _faster(asked, first)
    fastest = seen[-1]
    fast = [each for each in seen if each.lure.rate >= asked.rate] or [fastest]
    # Of equal times the flatter, then the faster one.
    best = min([*_flatter(asked, seen), *reversed(fast)], key=_time)
    with suppress(WorkLimitError):
        best = replace(best, lure=raise_rate(loop, best.lure, holds=partial(holds, loop)))
    if best.lure.rate >= fastest.lure.rate:
        return best, ""
    return best, fastest_in_words(float(fastest.lure.rate), math.sqrt(condition_of(fastest.lure)))


def _time(found: Found) -> float:
    """The time to one percent (s) that a certificate promises."""
    return time_to_one_percent(float(found.lure.rate), math.sqrt(condition_of(found.lure)))


def _flatter(asked: Asked, seen: Sequence[Found]) -> list[Found]:
    """A certificate of the same region with a smaller rate and a flatter P_e than those seen with
    growing rates."""
    timed = [each for each in seen if each.lure.rate]
    first = min(map(_time, timed), default=math.inf)
    if not timed or not math.isfinite(first):
        return []
    # Its P_e is nearly a multiple of I already: a smaller rate gains nothing.
    if first * float(timed[-1].lure.rate) < FLAT * math.log(100):
        return []
    wanted = Wanted(ball=claimed(asked.ball), disturbance=claimed(asked.disturbance), W=asked.W)
    with surviving("no flatter quadratic proposal", WorkLimitError):
        spend(_steps(asked.loop))
        sooner = sooner_lures(
            asked.loop,
            [each.lure for each in timed],
            wanted,
            holds=partial(holds, asked.loop),
            steps=SOONER,
            least=asked.rate * (1 + KEPT),
        )
        for lure in sooner:
            radius = certified_ball(asked.loop, lure, disturbance=asked.disturbance)
            if radius >= asked.ball:
                return [Found(timed[-1].name, lure, radius)]
    return []


def _faster(asked: Asked, best: Found) -> list[Found]:
    """The same region at growing rates, as far as a short bisection finds them."""
    top = linear_rate(asked.loop, asked.W)
    steps = FEWER_STEPS if asked.loop.size >= MANY_ROWS else RATE_STEPS
    accept = math.nextafter(asked.ball, 0.0)
    seen = [best]

    def covers_at(part: float) -> bool:
        rate = rounded_down(Fraction(top * part), digits=4)
        faster = propose(asked, best.lure.shape, rate=rate, accept=accept)
        if faster is None:
            return False
        seen.append(faster)
        return True

    def next_part(low: float, high: float) -> float:
        # Half of the rate first; where that is too much, it may be a small part of it.
        return (low + high) / 2 if low or high == 1.0 else high / 4

    if best.lure.method == "lure" and top > 0:
        bisected(covers_at, 0.0, 1.0, steps=steps, middle=next_part)
    return seen


def _remark(asked: Asked, best: Found, found: Sequence[Found]) -> str:
    """Why the ball is no larger, and what the others reach."""
    if math.isinf(best.radius):
        return ""
    reached = ""
    if len(found) > 1:
        others = ", ".join(f"{each.name}: {each.radius:.4g}" for each in found)
        reached = f" Largest |e| by method: {others}."
    if asked.wanted and best.radius >= asked.ball:
        return reached
    wish = f"the region needs {asked.ball:.6g}" if asked.wanted else "no region is asked for"
    return (
        f" The ball reaches |e| <= {best.radius:.6g} (all errors together), {wish}: beyond, no "
        f"quadratic V is found.{reached}"
    )
