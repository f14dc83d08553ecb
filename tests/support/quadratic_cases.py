"""Quadratic certificates, boxes and settling times for the lone checker: claims written by hand, and just-false twins.

Two agents that hear each other, or the second the first, so that every number can be worked out on paper.
"""

from __future__ import annotations

import json
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


def stage(kind: str, certificate: Document, start: str, level: str, height: str, **more: Any) -> Document:
    numbers = {"start": start, "level": level, "height": height, "noise": "0", "stretch": "1"}
    return {"kind": kind, "certificate": certificate} | numbers | more


def separable(certificate: Document, start: str, level: str, height: str, **more: Any) -> Document:
    return stage("max-separable", certificate, start, level, height, **more)


def settling(domain: Document, tolerance: str, time: str, *stages: Document) -> Document:
    return claim("settling", domain, None, {"tolerance": tolerance, "time": time, "stages": list(stages)})


def ways(check: Document, k: int, **changes: Any) -> Document:
    """The claim with a stage changed; other keys go to its certificate, and None takes diagonal or factor away."""
    copied: Document = json.loads(json.dumps(check))
    part = copied["exact"]["stages"][k]
    for key, value in changes.items():
        (part if key in part or key not in part["certificate"] else part["certificate"])[key] = value
        if value is None and key in ("diagonal", "factor"):
            del part[key]
    return copied


def timed(check: Document, **changes: Any) -> Document:
    copied: Document = json.loads(json.dumps(check))
    copied["exact"] |= changes
    return copied


# h = y, agent 2 hears agent 1, k_1 = 1: v = (1, 2) gives 1/2, v = (1, 4) gives 3/4; both hold everywhere.
SLOW, FAST = ({"v": ["1", top], "alpha": alpha, "rho": None} for top, alpha in (("2", "1/2"), ("4", "3/4")))
# N <= exp(-t/2), so |e| <= 2 exp(-t/2): 0.1 at 2 ln 20 = 5.991465.
FIRST = separable(SLOW, "0", "1", "2")
ONCE = settling(box(1), "0.1", "5.991466", FIRST)
# At t = 2 N is at most exp(-1) = 0.367879, and so is the new N; then 4 * 0.36788 exp(-3/4 (t - 2)): 0.1 at 5.585177.
TWICE = settling(box(1), "0.1", "5.58519", FIRST, separable(FAST, "2", "0.36788", "4"))
# exp(y) - 1 + y: v = (1, 5/4) gives 0.37695 on N <= 1 and 0.38347 on N <= 7/10; exp(-0.3769 t) = 0.7 at 0.946339.
CLOSE = {"v": ["1", "5/4"], "alpha": "0.3769", "rho": "1"}
CLOSER = {"v": ["1", "5/4"], "alpha": "0.3834", "rho": "7/10"}
CURVE = settling(box(1), "0.1", "7", separable(CLOSE, "0", "1", "5/4"), separable(CLOSER, "0.94634", "0.7", "5/4"))
# y + y^3, k = 3, both ways.  v = (1, 1) gives 3 for every rho; then 2 exp(-3 t) <= radius = 1 at 0.231050, where
# |e|^2 <= 2 N^2 <= 1/2: level 0.70711.  Gains 1 to 2: 9 - sqrt(10) = 2 * 2.918. |e| <= 0.1 from 0.905535 on.
EVEN = {"v": ["1", "1"], "alpha": "3", "rho": "1"}
WIDE = quadratic("2.9", "1", "2.00001", "1/2", "1")
SQUARE = ["1", "1"]
BESIDE = stage("quadratic", WIDE, "0.23105", "0.70711", "1", diagonal=SQUARE)
MIXED = settling(box(1), "0.1", "0.9056", separable(EVEN, "0", "1", "1"), BESIDE)
# From |e_i| <= 0.49: |e| <= 0.692965, below sqrt(1/2) = 0.707107.  Then radius 1/2, gains 1 to 5/4, P_e = 2 I: |e|
# has to be below 0.353553, 0.693 exp(-2.9 t) is at 0.232069; level sqrt(2) * 0.35355 = 0.5; |e| = sqrt(V/2) is 0.01
# at 1.424539.
NARROW = quadratic("2.99", "1", "1.25001", "1/4", "1/2", size="2")
BALLS = settling(
    box(0.49),
    "0.01",
    "1.4246",
    stage("quadratic", WIDE, "0", "0.693", "1", diagonal=SQUARE),
    stage("quadratic", NARROW, "0.23208", "0.500001", "0.707107", factor="2"),
)
# With the observer, A - W C = -2, h = y, k = 3: beta = 2.  kappa 1: pace 1, level 1 + 1/2.  At t = 1: 1.5/e =
# 0.551820 and noise exp(-2)/2 = 0.067668; P = 4 takes a stretch of 2, noise 0.135336, level 0.551820 + (2 * 2 - 1) *
# 0.067668 = 0.754823. At t = 2 pace 3/2 has made 0.168424 of it, noise 0.018316 with P = 4, half of it with P = 1:
# level^2 >= 2 * 0.028367 + 2 * 0.000084, so 0.238540; at t = 3, rate 1: 0.087755, noise 0.003369; P_e = 2 I, P = 4:
# level 0.175509, noise 0.006738.
CALM, TENSE = (
    {"v": ["1", "1"], "alpha": "3", "rho": None, "P": [[size]], "beta": "2", "kappa": kappa, "size": size}
    for size, kappa in (("1", "1"), ("4", "2"))
)
LEVEL = quadratic("1", "1", "1", None, None, P=[["1"]])
STEEP = quadratic("1", "1", "1", None, None, size="2", P=[["4"]])
OBSERVED = settling(
    box(1, 0.5),
    "0.01",
    "6",
    separable(CALM, "0", "3/2", "1", noise="1/2"),
    separable(TENSE, "1", "0.754824", "1", noise="0.135336", stretch="2"),
    stage("quadratic", LEVEL, "2", "0.23854", "1", noise="0.0091579", stretch="1/2", diagonal=SQUARE),
    stage("quadratic", STEEP, "3", "0.17551", "0.707107", noise="0.0067381", stretch="2", factor="2"),
)
# A quadratic stage alone: |e|^2 <= 2 and 2 * 1/4: level sqrt(2.5) = 1.581139, noise 1/2.
LONE = stage("quadratic", LEVEL, "0", "1.58114", "1", noise="1/2", diagonal=SQUARE)
ALONE = settling(box(1, 0.5), "0.01", "6", LONE)


@cache
def quadratic_cases() -> list[Case]:
    """All of them, the good ones first."""
    return [*_good(), *_bent_boxes(), *_bent_trees(), *_bent_stages(), *_bent_handing(), *_bent_observer()]


def _claimed(name: str, code: int, check: Document, what: str) -> Case:
    """A claim that is not about the verdict."""
    return case(name, code, check, what=what, **_frame_verdict(name))


def _bent(name: str, check: Document, k: int, *changes: tuple[str, Any]) -> Iterator[Case]:
    """Stage k of a settling time changed, one number at a time."""
    for key, value in changes:
        yield _claimed(name, FAILS, ways(check, k, **{key: value}), f"{key} {value} of stage {k}")


def _good() -> Iterator[Case]:
    yield case("wavy", HOLDS, WAVY, what="boxes")
    yield case("wavy", HOLDS, changed(WAVY, tree="."), what="one box, cut further by the checker")
    yield case("wavy", HOLDS, SHARP, what="boxes, a sharp rate")
    yield case("wavy, observed", HOLDS, SEEN, what="boxes and an observer")
    small = changed(WAVY, domain=ball(1.41))
    yield case("wavy", HOLDS, small, **UNDECIDED, what="boxes that do not cover")
    yield case("wavy", FAILS, small, what="boxes that do not cover, and say so")
    for name, check in (("line", ONCE), ("line", TWICE), ("curved line", CURVE), ("cubic", MIXED), ("cubic", BALLS)):
        yield _claimed(name, HOLDS, check, f"settling, {len(check['exact']['stages'])} stages")
    for check in (OBSERVED, ALONE):
        yield _claimed("observed, linear", HOLDS, check, f"settling, {len(check['exact']['stages'])} stages")


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


def _bent_stages() -> Iterator[Case]:
    early = (
        ("line", ONCE, "5.991464"),
        ("line", TWICE, "5.58517"),
        ("cubic", MIXED, "0.9055"),
        ("cubic", BALLS, "1.4245"),
    )
    for name, check, time in early:
        yield _claimed(name, FAILS, timed(check, time=time), f"time {time}")
    yield _claimed("line", FAILS, timed(ONCE, tolerance="0.099999"), "tolerance")
    yield _claimed("line", FAILS, timed(TWICE, time="1.9", tolerance="9"), "time before the last stage")
    yield _claimed("line", FAILS, ONCE | {"rate": 0.5}, "a rate of a settling time")
    yield _claimed("line", FAILS, changed(ONCE, domain=ball(1)), "a ball")
    yield _claimed("line", FAILS, changed(ONCE, domain=box(1, 0.1)), "a disturbance without exosystem")
    yield _claimed("line", FAILS, timed(ONCE, stages=[]), "no stages")
    again = ways(TWICE, 1, start="0", level="1")["exact"]["stages"][1]
    yield _claimed("line", FAILS, timed(ONCE, stages=[FIRST] + [again] * 100), "101 stages")
    yield _claimed("line", FAILS, ONCE | {"verdict": "refuted", "domain": "global"}, "a settling time refuted")
    yield from _bent("line", ONCE, 0, ("start", "0.1"), ("level", "0.999999"), ("height", "1.999999"), ("noise", "-1"))
    yield from _bent("line", ONCE, 0, ("noise", "0.1"), ("stretch", "2"), ("kind", "vertex"), ("alpha", "0.500001"))
    yield from _bent("line", ONCE, 0, ("v", ["1", "1.999"]), ("diagonal", SQUARE))
    yield from _bent("line", TWICE, 1, ("stretch", "2"), ("noise", "0.1"), ("factor", "1"))
    yield _claimed("line", FAILS, timed(ways(ONCE, 0, start="0.1"), tolerance="0.2"), "a late first stage")
    sinking = ways(ONCE, 0, alpha="-1", level="1e-9")
    yield _claimed("line", FAILS, timed(ways(ONCE, 0, alpha="-1"), tolerance="1e9"), "a stage that grows")
    yield _claimed("line", FAILS, sinking, "a stage that grows, low")
    yield _claimed("curved line", FAILS, ways(CURVE, 0, rho=None), "no rho")
    alone = timed(CURVE, stages=CURVE["exact"]["stages"][:1])
    yield _claimed("curved line", HOLDS, alone, "the first stage alone")
    yield _claimed("curved line", FAILS, ways(alone, 0, level="1.0001"), "level above rho")
    yield from (
        *_bent("curved line", CURVE, 0, ("alpha", "0.3771")),
        *_bent("curved line", CURVE, 1, ("alpha", "0.3836")),
    )
    yield _claimed("cubic", FAILS, ways(BALLS, 0, level="0.6929"), "level below the starts")
    alone = timed(BALLS, stages=BALLS["exact"]["stages"][:1], time="1.6")
    yield _claimed("cubic", HOLDS, alone, "the first stage alone")
    yield _claimed("cubic", FAILS, ways(alone, 0, level="0.70711"), "level above the certificate's")
    yield from _bent("cubic", BALLS, 0, ("diagonal", ["0.9999", "1"]), ("diagonal", None), ("factor", "1"))
    yield from _bent("cubic", BALLS, 0, ("height", "0.9999"), ("rate", "2.92"))
    yield _claimed("cubic", FAILS, timed(ways(BALLS, 1, height="-1"), time="0.24"), "negative height")
    yield _claimed("cubic", FAILS, ways(BALLS, 0, certificate=WIDE | {"level": None, "radius": None}), "no level")
    yield _claimed("list", FAILS, ONCE, "settling of a list")
    # A coupling that no arc has counts: the problem is not linear.
    spread = timed(ONCE, time="3")
    for rho, code in (("1", HOLDS), (None, FAILS)):
        yield _claimed("unused", code, ways(spread, 0, v=SQUARE, alpha="3", rho=rho, height="1"), f"rho {rho}")
    linear = quadratic("1", "1", "1", None, None, ranges=[{"coupling": 1, "gains": [[["1", "1"]]]}])
    yield case("unused", FAILS, claim("lure", "global", 1, linear), what="lure everywhere")
    linear |= {"level": "2", "radius": "1"}
    yield case("unused", HOLDS, claim("lure", ball(1.414), 1, linear), **UNDECIDED, what="lure in a ball")


def _bent_handing() -> Iterator[Case]:
    yield _claimed("line", FAILS, ways(TWICE, 1, level="0.367879"), "level of the second stage")
    turned = timed(ways(TWICE, 0, start="0"), stages=TWICE["exact"]["stages"][::-1])
    yield _claimed("line", FAILS, turned, "the second stage first")
    back = timed(TWICE, stages=[*TWICE["exact"]["stages"], FIRST | {"start": "1", "level": "9"}], tolerance="99")
    yield _claimed("line", FAILS, back, "a stage before the one it follows")
    yield from _bent("line", TWICE, 1, ("v", ["1/2", "2"]))
    yield _claimed("curved line", FAILS, ways(CURVE, 1, start="0.946", level="0.7001"), "level above the second rho")
    near = timed(ways(MIXED, 1, level="0.708"), time="1")
    yield _claimed("cubic", HOLDS, near, "a larger level")
    yield _claimed("cubic", FAILS, ways(near, 1, start="0.231"), "level above the radius")
    yield from _bent("cubic", MIXED, 1, ("level", "0.7071"), ("diagonal", ["1", "0.9999"]), ("diagonal", None))
    yield from _bent("cubic", MIXED, 1, ("factor", "1"))
    yield from _bent(
        "cubic", BALLS, 1, ("start", "0.232"), ("level", "0.49997"), ("factor", "1.9999"), ("factor", None)
    )
    yield from _bent("cubic", BALLS, 1, ("diagonal", ["2", "2"]), ("height", "0.7071"), ("rate", "2.9931"))
    yield _claimed("cubic", FAILS, ways(BALLS, 1, certificate=NARROW | {"level": "-1"}), "negative level")
    after = MIXED["exact"]["stages"][0] | {"start": "1/2", "level": "9"}
    late = timed(BALLS, stages=[BALLS["exact"]["stages"][0], after], time="9")
    yield _claimed("cubic", FAILS, late, "max-separable after quadratic")


def _bent_observer() -> Iterator[Case]:
    name = "observed, linear"
    first = ("level", "1.49999"), ("noise", "0.49999"), ("size", "0.9999"), ("beta", "2.0001"), ("P", [["0.9999"]])
    yield from _bent(name, OBSERVED, 0, *first, *(("kappa", kappa) for kappa in ("1.001", "0.999", "-1", "1/2")))
    second = ("stretch", "1.9999"), ("stretch", "-2"), ("noise", "0.135335"), ("level", "0.754822"), ("kappa", "2.001")
    yield from _bent(name, OBSERVED, 1, *second)
    yield from _bent(
        name, OBSERVED, 2, ("stretch", "0.49999"), ("noise", "0.0091577"), ("level", "0.23853"), ("rate", "0")
    )
    last = ("stretch", "1.9999"), ("noise", "0.0067379"), ("level", "0.17550"), ("factor", "1.9999")
    yield from _bent(name, OBSERVED, 3, *last)
    for change in ({"level": "1.58113"}, {"noise": "0.49999"}, {"level": "-1.59"}, {"P": [["0.1"]]}, {"stretch": "2"}):
        yield _claimed(name, FAILS, ways(ALONE, 0, **change), f"{change} of a quadratic stage")
    sinking = ways(OBSERVED, 1, stretch="-2", noise="-0.2", level="0.5519")
    yield _claimed(name, FAILS, sinking, "a negative stretch")
    calm = ways(OBSERVED, 0, noise="-1/2")
    yield _claimed(name, FAILS, ways(calm, 1, level="0.5519"), "negative noise")
    yield _claimed(name, FAILS, OBSERVED | {"domain": box(1.0001, 0.5)}, "radius")
    yield _claimed(name, FAILS, OBSERVED | {"domain": box(1, 0.50001)}, "disturbance")
    yield _claimed(name, HOLDS, OBSERVED | {"domain": box(1, 0)}, "no disturbance")
    yield _claimed("unobserved", FAILS, ONCE, "no W")
