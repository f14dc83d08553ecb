"""The quadratic certificates of the region asked for: the ball that V = e'P_e e + sum eps_i'P eps_i
proves.

Theory, section 4.  ``propose`` finds a full P_e; where arc-wise certificates, whose V is diagonal,
do not apply, first a diagonal one; ``verify_lure`` decides.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from fractions import Fraction
from functools import partial

from dobc_design.conditions.check import (
    Check,
    cut_check,
    fastest_in_words,
    surviving,
    undecided_check,
)
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.numbers import bisected, claimed, rounded_down, time_to_one_percent
from dobc_design.conditions.reason import shares_obstacle
from dobc_design.exact.number import ZERO
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted, out_of_time, spend
from dobc_design.loop.loop import Loop

from .claim import Lure, Shape
from .decide import certified_ball, lure_check, quadratic_obstacle, verify_lure
from .propose import (
    condition_of,
    design_lure,
    linear_rate,
    raise_rate,
    sooner_lures,
)

#: Rows n m up to which quadratic certificates are looked for, and up to which with a full P_e; with
#: at most ``SMALL_ROWS`` one is found so soon that it is looked for beside other proofs.
MOST_ROWS = 60
FULL_ROWS = 20
SMALL_ROWS = 15
MOST_MODES = 200  # up to which one V is looked for
#: Where the region is covered: parts of the rate near the consensus that are tried, by bisection;
#: rows n m from which on fewer are.
RATE_STEPS = 5
FEWER_STEPS = 3
MANY_ROWS = 11
LONG_ROWS = 13  # from which on one rate is tried where arc-wise certificates are faster
MODE = 20  # steps of work for the inequality of a mode
SOONER = 5  # rates that are tried for the least time to one percent
FLAT = 1.01  # times are next to that of P_e = I below this part
KEPT = 0.002  # how much faster than wanted, for digits that are cut
# no |e_j - e_i| beyond is looked at, unless the region asks for more
_LARGEST = Fraction(400)


def quadratic_stage(asked: Asked, report: Progress) -> list[Check]:
    """The quadratic certificate: of the ball asked for, with a short time to one percent, else of
    the largest ball."""
    loop = asked.loop
    reason = quadratic_obstacle(loop, asked.W)
    if reason is not None:
        return [undecided_check("lure", asked.domain, reason, applies=False)]
    # Where they apply, arc-wise certificates have a diagonal V.
    tries_diagonal = shares_obstacle(loop) is not None
    reason = _too_large(loop, MOST_ROWS if tries_diagonal else FULL_ROWS)
    if reason is not None:
        return [undecided_check("lure", asked.domain, reason)]
    long = asked.everything or SMALL_ROWS < loop.size <= FULL_ROWS
    work = 3 * STAGE if long else STAGE
    report("deciding the region (quadratic)")
    with at_most(work):
        best = propose(asked, "diagonal") if tries_diagonal else None
        if loop.size <= FULL_ROWS and _ball(asked, best) < asked.ball:
            best = propose(asked, "full", accept=_ball(asked, best)) or best
        cut = exhausted()
    if best is None and cut is not None:
        longer = not long and out_of_time() is None
        return [cut_check("lure", asked.domain, cut, longer=longer)]
    if best is None:
        return [undecided_check("lure", asked.domain, _none_found(asked))]
    remark = ""
    if _ball(asked, best) >= asked.ball:
        report("deciding the region (quadratic, its rate)")
        # What ends for want of time leaves the proof that is there.
        with at_most(work), suppress(WorkLimitError):
            best, remark = _timed(asked, best)
    radius = _ball(asked, best)
    if math.isinf(radius):
        radius = 0.0
    else:
        remark += _remark(asked, radius)
    return [lure_check(asked, best, radius=radius, remark=remark)]


def _too_large(loop: Loop, most: int) -> str | None:
    """Why a network of this size is left out; None if it is not."""
    takes_long = "left out, because it takes long with"
    if loop.size > most:
        return f"{takes_long} {loop.size} rows n m; it is examined up to {most}."
    if len(loop.modes) > MOST_MODES:
        return f"{takes_long} {len(loop.modes)} modes; it is examined up to {MOST_MODES}."
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
    asked: Asked, shape: Shape, *, rate: Fraction = ZERO, accept: float = 0.0
) -> Lure | None:
    """The certificate with the largest ball for a shape of P_e and a rate, proved; None if the ball
    is no larger than ``accept``."""
    loop = asked.loop
    # No |e_j - e_i| far beyond the ball asked for is looked at.
    ball = claimed(asked.ball)
    lure = None
    with surviving("no quadratic proposal", WorkLimitError):
        spend(_steps(loop))
        lure = design_lure(
            loop,
            holds=partial(holds, loop),
            shape=shape,
            W=asked.W,
            rate=rate,
            disturbance=claimed(asked.disturbance),
            largest=max(2 * ball, min(10 * ball, _LARGEST)),
        )
    return lure if _ball(asked, lure) > accept else None


def _ball(asked: Asked, lure: Lure | None) -> float:
    """The ball that a certificate covers together with the disturbance asked for."""
    if lure is None:
        return 0.0
    return certified_ball(asked.loop, lure, disturbance=asked.disturbance)


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


def _timed(asked: Asked, first: Lure) -> tuple[Lure, str]:
    """The same region with the least time to one percent that is found, and what the largest rate
    would be."""
    loop = asked.loop
    seen = _faster(asked, first)
    fastest = seen[-1]
    fast = [each for each in seen if each.rate >= asked.rate] or [fastest]
    # Of equal times the flatter, then the faster one.
    best = min([*_flatter(asked, seen), *reversed(fast)], key=_time)
    with suppress(WorkLimitError):
        best = raise_rate(loop, best, holds=partial(holds, loop))
    if best.rate >= fastest.rate:
        return best, ""
    return best, fastest_in_words(float(fastest.rate), math.sqrt(condition_of(fastest)))


def _time(lure: Lure) -> float:
    """The time to one percent (s) that a certificate promises."""
    return time_to_one_percent(float(lure.rate), math.sqrt(condition_of(lure)))


def _flatter(asked: Asked, seen: Sequence[Lure]) -> list[Lure]:
    """A certificate of the same region with a smaller rate and a flatter P_e than those seen with
    growing rates."""
    timed = [each for each in seen if each.rate]
    first = min(map(_time, timed), default=math.inf)
    if not timed or not math.isfinite(first):
        return []
    # Its P_e is nearly a multiple of I already: a smaller rate gains nothing.
    if first * float(timed[-1].rate) < FLAT * math.log(100):
        return []
    with surviving("no flatter quadratic proposal", WorkLimitError):
        spend(_steps(asked.loop))
        sooner = sooner_lures(
            asked,
            timed,
            holds=partial(holds, asked.loop),
            steps=SOONER,
            least=asked.rate * (1 + KEPT),
        )
        for lure in sooner:
            if _ball(asked, lure) >= asked.ball:
                return [lure]
    return []


def _faster(asked: Asked, best: Lure) -> list[Lure]:
    """The same region at growing rates, as far as a short bisection finds them."""
    top = linear_rate(asked.loop, asked.W)
    rows = asked.loop.size
    steps = FEWER_STEPS if rows >= MANY_ROWS else RATE_STEPS
    if best.shape == "full" and rows >= LONG_ROWS and shares_obstacle(asked.loop) is None:
        steps = 1
    accept = math.nextafter(asked.ball, 0.0)
    seen = [best]

    def covers_at(part: float) -> bool:
        rate = rounded_down(Fraction(top * part), digits=4)
        faster = propose(asked, best.shape, rate=rate, accept=accept)
        if faster is None:
            return False
        seen.append(faster)
        return True

    def next_part(low: float, high: float) -> float:
        # Half of the rate first; where that is too much, it may be a small part of it.
        return (low + high) / 2 if low or high == 1.0 else high / 4

    if top > 0:
        bisected(covers_at, 0.0, 1.0, steps=steps, middle=next_part)
    return seen


def _remark(asked: Asked, radius: float) -> str:
    """Why the ball is no larger."""
    if asked.wanted and radius >= asked.ball:
        return ""
    wish = f"the region needs {asked.ball:.6g}" if asked.wanted else "no region is asked for"
    return (
        f" The ball reaches |e| <= {radius:.6g} (all errors together), {wish}: beyond, no "
        "quadratic V is found."
    )
