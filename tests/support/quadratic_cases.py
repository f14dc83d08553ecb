"""Quadratic certificates and boxes for the lone checker: claims written by hand, and just-false twins.

Two agents that hear each other, or the second the first, so that every number can be worked out on paper.
"""

from collections.abc import Iterator
from functools import cache
from typing import Any

from checker_cases import FAILS, HOLDS, Case, Document
from region_cases import UNDECIDED, _frame_verdict, ball, box, case, changed, claim


def grid(size: int, depth: int) -> str:
    """The tree that halves all boxes, component after component."""
    return "".join(str(k % size) * 2**k for k in range(depth)) + "." * 2**depth


def chain(halvings: int) -> str:
    """The tree that halves the lowest box across component 0 again and again."""
    return "0" + "0." * (halvings - 1) + ".."


def bounds(low: str, high: str) -> list[Document]:
    return [{"coupling": 0, "gains": [[[low, high]]]}]


def quadratic(rate: str, low: str, high: str, level: Any, radius: Any, size: str = "1", **more: Any) -> Document:
    """P_e = size I of two agents, by vertices."""
    form = {"method": "vertices", "P_e": [[0, 0, size], [1, 1, size]], "multipliers": {}, "rate": rate}
    return form | {"level": level, "radius": radius, "ranges": bounds(low, high)} | more


# sin on both arcs, k = 3, y = e_2 - e_1, P_e = I: phi = (2 rate - 6) |e|^2 - 2 y sin y.  With |e|^2 >= y^2/2 it is
# below 0 for rate < 3 + 2 min sin(y)/y = 2.565533, and at y = 4.4934, |e|^2 = 10.095 that is sharp.  Near the target
# gains from 1/5 to 1 hold on |y| <= 5/2, that is on |e|^2 <= 25/8.  sqrt(12) = 3.4641.
SHELL = quadratic("5/2", "1/5", "1.00001", "25/8", "5/2", outer="12", half="7/2", tree=grid(2, 6))
WAVY = claim("exhaustive", ball(3.464), 2.5, SHELL)
SHARP = changed(WAVY, rate=2.56)
SHARP["exact"]["rate"] = "2.56"
# With the observer, W = 2, A = 0: S = 1/((4 - 2 rate) P), and rate = 1 needs S < 3.131066, so P > 0.159690.
SEEN = changed(WAVY, rate=1, domain=ball(3.463, 0.1), P=[["0.16"]])
SEEN["exact"]["rate"] = "1"


@cache
def quadratic_cases() -> list[Case]:
    """All of them, the good ones first."""
    return [*_good(), *_bent_boxes(), *_bent_trees()]


def _claimed(name: str, code: int, check: Document, what: str) -> Case:
    """A claim that is not about the verdict."""
    return case(name, code, check, what=what, **_frame_verdict(name))


def _good() -> Iterator[Case]:
    yield case("wavy", HOLDS, WAVY, what="boxes")
    yield case("wavy", HOLDS, changed(WAVY, tree="."), what="one box, cut further by the checker")
    yield case("wavy", HOLDS, SHARP, what="boxes, a sharp rate")
    yield case("wavy, observed", HOLDS, SEEN, what="boxes and an observer")
    small = changed(WAVY, domain=ball(1.41))
    yield case("wavy", HOLDS, small, **UNDECIDED, what="boxes that do not cover")
    yield case("wavy", FAILS, small, what="boxes that do not cover, and say so")


def _bent_boxes() -> Iterator[Case]:
    fast = changed(SHARP, rate=2.566)
    fast["exact"]["rate"] = "2.566"
    yield case("wavy", FAILS, fast, what="rate where it is sharp")
    yield case("wavy", FAILS, changed(WAVY, rate=2.51), what="rate")
    yield case("wavy", FAILS, changed(WAVY, domain=ball(3.465)), what="ball")
    yield case("wavy", FAILS, changed(WAVY, domain=box(1)), what="a box")
    yield case("wavy", FAILS, changed(WAVY, outer="3", domain=ball(1.5)), what="outer below level")
    yield case("wavy", FAILS, changed(WAVY, level="3.126"), what="level")
    yield case("wavy", FAILS, changed(WAVY, outer="12.5"), what="outer")
    for half in ("0", "-7/2", "3.45", "55/16", "3.5001", f"{7 * 2**20 + 1}/{2**21}", str(2**2000), f"7/{2**2000}"):
        yield case("wavy", FAILS, changed(WAVY, half=half), what=f"half {half[:20]}")
    yield case("wavy, loose", FAILS, WAVY, what="boxes where an arc comes and goes")
    yield case("wavy, observed", FAILS, changed(SEEN, P=[["0.1596"]]), what="S")
    yield case("wavy, observed", FAILS, changed(SEEN, domain=ball(3.4638, 0.1)), what="ball with a disturbance")
    shell = quadratic("2/5", "1", "1", None, None, outer="2", half="2", tree=".")
    everywhere = claim("exhaustive", "global", 0.4, shell)
    yield _claimed("line", FAILS, everywhere, "boxes without level")
    yield _claimed("line", FAILS, everywhere | {"domain": ball(1)}, "boxes around no level")
    listed = claim("exhaustive", ball(1), 1, quadratic("1", "1", "1", "1", "1", outer="2", half="2", tree="."))
    yield _claimed("straight list", FAILS, listed, "boxes of a list")
    yield case("wavy", FAILS, changed(WAVY, verdict="refuted"), **UNDECIDED, what="boxes refuted")
    backward = claim("lure", "global", 1, quadratic("1", "1", "1", "1", "-1"))
    for radius, code in (("1", HOLDS), ("-1", FAILS)):
        check = changed(backward, radius=radius, domain=ball(1))
        check["exact"]["P"] = [["1"]]
        yield _claimed("observed, linear", code, check | {"rate": None}, f"radius {radius}")
    check["exact"] |= {"level": None, "radius": "1"}
    yield _claimed("observed, linear", FAILS, check | {"rate": None, "domain": "global"}, "a radius without level")


def _bent_trees() -> Iterator[Case]:
    yield case("wavy", HOLDS, changed(WAVY, tree=chain(30)), what="30 halvings")
    for tree in ("2..", "", "0.", "0...", "x..", ". ", "\u0660..", "00.", chain(31), "01.", 5):
        yield case("wavy", FAILS, changed(WAVY, tree=tree), what=f"tree {str(tree)[:8]!r}")
    # A coupling that no arc has counts: the problem is not linear.
    linear = quadratic("1", "1", "1", None, None, ranges=[{"coupling": 1, "gains": [[["1", "1"]]]}])
    yield case("unused", FAILS, claim("lure", "global", 1, linear), what="lure everywhere")
    linear |= {"level": "2", "radius": "1"}
    yield case("unused", HOLDS, claim("lure", ball(1.414), 1, linear), **UNDECIDED, what="lure in a ball")
