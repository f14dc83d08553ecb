"""Quadratic certificates for the lone checker: claims written by hand, and just-false twins.

Two agents that hear each other, or the second the first, so that every number can be worked out on
paper.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

from texts import matrix

from checker_files.files import FAILS, HOLDS, Case, Document, changed
from checker_files.separable import (
    UNDECIDED,
    _frame_verdict,
    ball,
    box,
    case,
    claim,
    fails,
    holds,
    wrong,
)


def bounds(low: str, high: str) -> list[Document]:
    return [{"coupling": 0, "gains": [[[low, high]]]}]


def quadratic(
    rate: str,
    low: str,
    high: str,
    level: Any,
    radius: Any,
    size: str = "1",
    tau: str = "0",
    **more: Any,
) -> Document:
    """P_e = size I of two agents and two arcs, with one multiplier for both."""
    P_e = [[0, 0, size], [1, 1, size]]
    multipliers = {"G": [tau, tau]}
    form = {"method": "lure", "P_e": P_e, "multipliers": multipliers, "rate": rate}
    level_and_ranges = {"level": level, "radius": radius, "ranges": bounds(low, high)}
    return form | level_and_ranges | more


# sin on both arcs, k = 3, P_e = I: gains from 1/5 to 1 hold on |y| <= 5/2, that is on |e|^2 <=
# 25/8. On (1, 1) the inequality is -6 + 2 rate + t < 0 with t = 1/(2 tau), on (1, -1) it is -6 +
# 2 rate - 4 g0 + t + 4 D^2/t < 0: t = 4/15 leaves 2.86665.
BY_MULTIPLIERS = quadratic("2.8666", "1/5", "1.00001", "25/8", "5/2", tau="15/8")
WAVY = claim("lure", ball(1.7677), 2.8666, BY_MULTIPLIERS)
# With the observer, W = 2, A = 0: S = 1/((4 - 2 rate) P), and rate = 1 needs S < 2 (2.86665 - 1),
# so P > 0.13393.
SEEN = changed(WAVY, rate=1, domain=ball(1.7670, 0.1), P=[["0.134"]])
SEEN["exact"]["rate"] = "1"


@cache
def quadratic_cases() -> list[Case]:
    """All of them, the good ones first."""
    return [*_good(), *_bent()]


def _claimed(name: str, code: int, check: Document, what: str) -> Case:
    """A claim that is not about the verdict."""
    return case(name, code, what, check, **_frame_verdict(name))


def _good() -> Iterator[Case]:
    yield holds("wavy", "a sharp ball and rate", WAVY)
    # with 0 in place of 1/5 on the second arc and t = 1/2: of agent 2 -7.00001 + 1/2 + 1.100025 +
    # 2 rate < 0
    for rate, code in (("2.6999", HOLDS), ("2.7001", FAILS)):
        loose = changed(WAVY, rate=1, multipliers={"G": ["15/8", "1"]})
        loose["exact"]["rate"] = rate
        yield case("wavy, loose", code, f"an arc that comes and goes, {rate}", loose)
    yield holds("wavy, observed", "an observer", SEEN)
    small = changed(WAVY, domain=ball(1.41))
    yield holds("wavy", "a ball that does not cover", small, **UNDECIDED)
    yield fails("wavy", "a ball that does not cover, and says so", small)


def _bent() -> Iterator[Case]:
    fast = changed(WAVY, rate=2)
    fast["exact"]["rate"] = "2.8667"
    yield fails("wavy", "rate where it is sharp", fast)
    yield wrong("wavy", WAVY, "rate", rate=2.867)
    yield wrong("wavy", WAVY, "ball", domain=ball(1.7678))
    yield wrong("wavy", WAVY, "a box", domain=box(1))
    yield wrong("wavy", WAVY, "level", level="3.126")
    yield wrong("wavy, observed", SEEN, "S", P=[["0.1339"]])
    yield wrong("wavy, observed", SEEN, "ball with a disturbance", domain=ball(1.7671, 0.1))
    yield wrong("wavy", WAVY, "refuted", verdict="refuted", says=UNDECIDED)
    turned = quadratic("1", "1", "1", "1", "-1")
    backward = claim("lure", "global", 1, turned)
    for radius, code in (("1", HOLDS), ("-1", FAILS)):
        check = changed(backward, radius=radius, domain=ball(1))
        check["exact"]["P"] = [["1"]]
        yield _claimed("observed, linear", code, check | {"rate": None}, f"radius {radius}")
    check["exact"] |= {"level": None, "radius": "1"}
    yield _claimed(
        "observed, linear",
        FAILS,
        check | {"rate": None, "domain": "global"},
        "a radius without level",
    )

    # A coupling that no arc has counts: the problem is not linear.
    ranges_of_another = [{"coupling": 1, "gains": [matrix("1 1")]}]
    linear = quadratic("1", "1", "1", None, None, ranges=ranges_of_another)
    yield fails("unused", "lure everywhere", claim("lure", "global", 1, linear))
    linear |= {"level": "2", "radius": "1"}
    yield holds("unused", "lure in a ball", claim("lure", ball(1.414), 1, linear), **UNDECIDED)
