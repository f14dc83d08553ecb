"""Settling times by moving boxes: claims written by hand whose truth is known, and twins that just
fail.

Two agents, so that every row can be worked out on paper: where a face falls fastest is said beside
it.
"""

import json
from collections.abc import Iterator
from typing import Any

from texts import matrix, vector

from checker_files.files import Case, Document, Forger, changed, collected
from checker_files.quadratic import quadratic
from checker_files.separable import (
    BENT,
    COMPOSITE,
    MATRIX,
    _frame_verdict,
    ball,
    box,
    case,
    claim,
    weights,
)


def settling(
    domain: Document, tolerance: str, time: str, tube: Document, last: Document
) -> Document:
    exact = {"tolerance": tolerance, "time": time, "tube": tube, "last": last}
    return claim("settling", domain, None, exact)


def tube(times: str, boxes: str, **more: Any) -> Document:
    """Boxes with equal faces, unless ``lower`` is given."""
    return {"times": vector(times), "upper": matrix(boxes), "lower": matrix(boxes)} | more


def last(kind: str, certificate: Document, level: str, height: str, stretch: str = "1") -> Document:
    return {
        "kind": kind,
        "level": level,
        "height": height,
        "stretch": stretch,
        "certificate": certificate,
    }


def bent(check: Document, **changes: Any) -> Document:
    """The claim with numbers of the tube, of what takes over, of its certificate or of the whole
    changed."""
    copied: Document = json.loads(json.dumps(check))
    exact = copied["exact"]
    for key, value in changes.items():
        certificate = exact["last"]["certificate"]
        parts = (exact["tube"], exact["last"], exact, certificate, copied)
        next(part for part in parts if key in part)[key] = value
    return copied


def moved(check: Document, k: int, i: int, value: str, *faces: str) -> Document:
    """The claim with the entry of agent i in the k-th box changed, on both faces unless they are
    named."""
    copied: Document = json.loads(json.dumps(check))
    for face in faces or ("upper", "lower"):
        copied["exact"]["tube"][face][k][i] = value
    return copied


# h = y, agent 2 hears agent 1, k_1 = 1: -u_1 <= u_1' at the end of a segment, so that 1 falls to
# 2/3 and 4/9 in steps of 1/2; u_1 - u_2 <= u_2' at the start of it, so that 1 stays and then falls
# to 5/6; up to a thousandth.  v = (1, 2) has the rate 1/2: N <= 0.445, and 0.89 exp(-(t - 1)/2) is
# 0.1 at 1 + 2 ln 8.9 = 5.372103.
SLOW = weights("1 2", "1/2")
BOXES = tuple(matrix("1 1; 0.667 1.001; 0.445 0.835"))
LINE = settling(
    box(1),
    "0.1",
    "5.3722",
    tube("0 1/2 1", "1 1; 0.667 1.001; 0.445 0.835"),
    last("max-separable", SLOW, "0.445", "2"),
)
# exp(y) - 1 + y on that arc: the same u_1, and u_2 stays: N <= 0.8008.  v = (1, 5/4) has the rate
# 0.3769 on N <= 1.
CLOSE = last("max-separable", weights("1 5/4", "0.3769", "1"), "0.8008", "5/4")
CURVE = settling(box(1), "0.1", "7", tube("0 1/2", "1 1; 0.667 1.001"), CLOSE)
# y + y^3, k = 3, both ways, u_1 = u_2: -3 u <= u', so that 1 falls to 4/7 and 16/49 in steps of
# 1/4.  Gains 1 to 2 on |y| <= 1, tau = 3: -6 + 1/6 + 2 * 2.9 < 0.  level^2 >= 2 * 0.327^2, and
# 1/2 + ln(4.6245)/2.9 = 1.028060.
WIDE = quadratic("2.9", "1", "2.00001", "1/2", "1", tau="3")
EVEN = weights("1 1", "3", "1")
FALLING = tube("0 1/4 1/2", "1 1; 0.572 0.572; 0.327 0.327")
CUBIC = settling(box(1), "0.1", "1.0281", FALLING, last("quadratic", WIDE, "0.46245", "1"))
# -|y|, k = 5, both ways: -5 u <= u' allows 1 to fall to 2/3 in 1/10; u - 4 l <= l' at the end, so
# that 1 falls to 10.667/14 = 0.76193.  N <= 0.763, and 1/10 + ln(7.63)/2.9999 = 0.777383.
UNEVEN = settling(
    box(1),
    "0.1",
    "0.7774",
    tube("0 1/10", "1 1; 0.667 0.667", lower=matrix("1 1; 0.763 0.763")),
    last("max-separable", BENT["exact"], "0.763", "1"),
)
# Gains that mix components hold with 1: 1 falls to 2/3 in 1/2.
MIXED = settling(
    box(1),
    "0.1",
    "2.398",
    tube("0 1/2", "1 1; 0.667 0.667"),
    last("max-separable", MATRIX["exact"], "0.667", "1"),
)
# With the observer, A - W C = -2, h = y, k = 3: c = exp(-2 t)/2.  -3 u + c <= u' at the end of
# steps of 1/4: 1 falls to 0.614752, and 0.616 to 0.378277.  With N + E <= 0.38 + 0.183940 at rate
# 1: 1/2 + ln 56.394 = 4.532364.  With P_e = 2 I and P = 4: level^2 >= 4 * 0.38^2 + 2 (2 *
# 0.18394)^2 = 0.848272; 1/2 + ln(65.126) = 4.676328.
CALM = weights("1 1", "3") | COMPOSITE
STEEP = quadratic("1", "1", "1", None, None, size="2", P=[["4"]])
WATCHED = {"P": [["1"]], "beta": "2", "size": "1"}
HEARD = tube("0 1/4 1/2", "1 1; 0.616 0.616; 0.38 0.38", **WATCHED)
DISTURBED = box(1, 0.5)
SEEN = settling(DISTURBED, "0.01", "4.5324", HEARD, last("max-separable", CALM, "0.56395", "1"))
DECAYING = last("quadratic", STEEP, "0.92102", "0.707107", "2")
STRETCHED = settling(DISTURBED, "0.01", "4.6764", HEARD, DECAYING)
# E stays for ever: -3 u + 1/2 <= u' allows 1 to fall to 4.5/7; level^2 >= 4 * 0.65^2 + 8/4.
STAYING = tube("0 1/4", "1 1; 0.65 0.65", **WATCHED | {"beta": "1/1000"})
KEPT = last("quadratic", STEEP, "1.921", "0.707107", "2")
STILL = settling(DISTURBED, "0.01", "6", STAYING, KEPT)
# LINE by V = e'e: 2 x (y - x) <= -x^2 + y^2, so that V' <= -V.  level^2 >= 0.445^2 + 0.835^2 =
# 0.89525, and 1 + 2 ln 9.4618 = 5.494527; an arc is decided with a little room.
SHARES = {"d": ["1", "1"], "a": {"G": ["-0.99999"]}, "b": {"G": ["1"]}}
SHARES |= {"level": "0.8953", "rate": "0.49999"}
PAID = bent(LINE, last=last("arc-wise", SHARES, "0.94618", "1"), time="5.4948")
# 12 - 2 rate 2 - 4/8 >= 1 for each arc, which takes 1 of whom it hears.
EACH = {"d": ["2", "2"], "a": {"G": ["0"] * 2}, "b": {"G": ["1.00001"] * 2}, "level": "0.8483"}
PAID_BESIDE = last("arc-wise", EACH | {"rate": "1", "P": [["4"]]}, "0.92102", "0.707107", "2")
PAID_SEEN = bent(STRETCHED, last=PAID_BESIDE)
GOOD = {"line": LINE, "curved line": CURVE, "cubic": CUBIC, "bent": UNEVEN, "linear matrix": MIXED}


@collected
def tube_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    yield from _good()
    yield from _bent_tubes()
    yield from _bent_lasts()
    yield from _bent_observer()


def _made(name: str, code: int, what: str, check: Document) -> Case:
    says = _frame_verdict(name)
    if says["verdict"] == "undecided":  # what settles from the whole region answers for it
        says = {"verdict": "proved", "rate": None, "covered_by": "settling"}
    return case(name, code, f"settling, {what}", check, **says)


_FORGER = Forger(_made, bent)
_holds = _FORGER.holds
_fails = _FORGER.fails
_wrong = _FORGER.wrong
_each_wrong = _FORGER.each_wrong


def _good() -> Iterator[Case]:
    for name, check in GOOD.items():
        yield _holds(name, "true", check)
    yield _holds("line", "arc by arc", PAID)
    of_modes = {name: dict.fromkeys("AB", SHARES[name]["G"]) for name in "ab"}
    signed = last("arc-wise", SHARES | of_modes, "0.94618", "1")
    yield _holds("signed line", "arc by arc", bent(PAID, last=signed))
    for check in (SEEN, STRETCHED, STILL, PAID_SEEN):
        yield _holds("observed, linear", "true", check)
    yield _holds("observed, linear", "no disturbance", SEEN | {"domain": box(1, 0)})
    start = tube("0", "1 1")
    at_once = bent(LINE, tube=start, level="1", time="5.9915")  # 2 exp(-t/2)
    yield _holds("line", "no segment", at_once)
    yield _wrong("line", at_once, "no segment, too early", time="5.9914")
    endless = bent(LINE, time="2e400", tolerance="1e-350")
    yield _holds("line", "a time beyond all exponents", endless)
    # A coupling that no arc has counts: the problem is not linear.
    other = bent(CUBIC, last=last("max-separable", EVEN, "0.327", "1"))
    yield _holds("unused", "rho 1", other)
    yield _wrong("unused", other, "rho None", rho=None)


def _bent_tubes() -> Iterator[Case]:
    for face in ("upper", "lower"):
        yield _fails("line", f"{face} 0.6665", moved(LINE, 1, 0, "0.6665", face))
        yield _fails("line", f"{face} 0.444", moved(LINE, 2, 0, "0.444", face))
        yield _fails("line", f"{face} 0.833", moved(LINE, 2, 1, "0.833", face))
        for k in (0, 1):
            yield _fails("line", f"{face} 0.999", moved(LINE, k, k, "0.999", face))
    yield _fails("curved line", "agent 2 falls at once", moved(CURVE, 1, 1, "0.999"))
    for k, value in ((1, "0.571"), (2, "0.326")):
        yield _fails("cubic", f"agent 1 {value}", moved(CUBIC, k, 0, value))
    yield _fails("bent", "upper", moved(UNEVEN, 1, 0, "0.666", "upper"))
    yield _fails("bent", "lower", moved(UNEVEN, 1, 1, "0.761", "lower"))
    faces = UNEVEN["exact"]["tube"]
    yield _wrong("bent", UNEVEN, upper=faces["lower"], lower=faces["upper"])
    lower_box = moved(MIXED, 1, 1, "0.668", "lower")
    apart = bent(lower_box, level="0.668", time="3")
    yield _fails("linear matrix", "faces that differ, and mixed components", apart)
    yield _fails("linear matrix", "agent 2", moved(MIXED, 1, 1, "0.666"))
    yield _wrong("line", LINE, times=vector("0 0.49 1"))
    yield _wrong("line", LINE, times=vector("0 1/2 0.99"))
    yield _wrong("line", LINE, times=vector("1/10 0.6 1.1"), time="6")
    yield from _each_wrong("line", LINE, times=[vector("0 1/2 1/2"), vector("0 1"), []])
    yield from _each_wrong("line", LINE, times=[vector("0 1 1/2"), [0, 1, 2], None])
    yield _wrong("line", LINE, lower=[*BOXES, BOXES[2]])
    first, _, third = BOXES
    flat = [["1"] * 3] * 3
    falling = [first, vector("0 1"), third]
    no_box = [first, first, {}]
    for upper in (BOXES[:2], flat, falling, no_box):
        yield _wrong("line", LINE, upper=upper)
    long = bent(LINE, time="99", level="1")
    yield _wrong("line", long, times=[], upper=[], lower=[])
    times = [f"{k}/1000" for k in range(2001)]
    many = [first] * 2001
    yield _wrong("line", long, times=times, upper=many, lower=many)
    yield from _each_wrong("line", LINE, domain=[box(1.001), ball(1), box(1, 0.1)])
    yield _wrong("line", LINE, "a rate", rate=0.5)
    yield _wrong("line", LINE, "refuted", verdict="refuted", domain="global")
    yield _fails("list", "of a list", MIXED)
    yield _fails("unobserved", "no W", LINE)
    kept = last("max-separable", EVEN, "1", "1")
    outside = settling(box(1), "9", "1", tube("0 1/2", "1 1; 1 1"), kept)
    yield _fails("log", "a box that leaves the domain of h", outside)

    # Rows do not see signs, where both faces are alike.
    yield _holds("signed line", "of both signs", LINE)
    unlike = moved(LINE, 1, 1, "1.002", "upper")
    yield _holds("line", "faces that differ", unlike)
    yield _fails("signed line", "faces that differ, of both signs", unlike)


def _bent_lasts() -> Iterator[Case]:
    tau = ["3", "3"]
    for_both = WIDE | {"multipliers": {"A": tau, "B": tau}}
    formed = bent(CUBIC, last=last("quadratic", for_both, "0.46245", "1"))
    yield _fails("signed cubic", "a form of rows without signs", formed)
    yield _wrong("line", LINE, time="5.372")
    yield _wrong("line", LINE, tolerance="0.09999")
    yield _wrong("line", LINE, level="0.4449")
    yield _wrong("line", LINE, height="1.9999")
    loose = bent(LINE, tolerance="9")
    yield _wrong("line", loose, time="0.99")
    yield _wrong("line", loose, stretch="2")
    yield _wrong("line", loose, kind="vertices")
    growing = bent(LINE, tolerance="9", time="1")
    yield _holds("line", "the end of the tube", growing)
    yield from _each_wrong("line", growing, alpha=["0", "-1", "0.5001"])
    yield _wrong("line", growing, v=vector("1 1.999"))
    yield _wrong("line", LINE, level="-1")
    yield _wrong("line", LINE, tolerance="0")
    yield from _each_wrong("line", LINE, time=["-1", 6])
    yield _wrong("line", LINE, tube=None)
    yield from _each_wrong("line", LINE, certificate=[None, {}])
    yield _wrong("line", LINE, last=WIDE)
    yield _wrong("line", PAID, time="5.494")
    yield from _each_wrong("line", PAID, level=["0.94617", "0.94622"], height=["0.9999"])
    for part in (
        {"b": {"G": ["0.999"]}},
        {"a": {"G": ["-0.999"]}},
        {"rate": "0.5001"},
        {"rate": "-1"},
        {"level": "0.8952"},
    ):
        yield _wrong("line", PAID, last=last("arc-wise", SHARES | part, "0.94618", "1"))
    yield _wrong("line", PAID, kind="quadratic")
    wide = bent(CURVE, time="9")
    yield _holds("curved line", "level rho", bent(wide, level="1"))
    yield from _each_wrong("curved line", wide, level=["1.0001", "0.8007"])
    yield _wrong("curved line", wide, rho=None)
    yield _wrong("curved line", wide, alpha="0.3771")
    yield _wrong("cubic", CUBIC, time="1.028")
    yield _wrong("cubic", CUBIC, level="0.46243")
    yield _wrong("cubic", CUBIC, height="0.9999")
    yield _wrong("cubic", CUBIC, rate="2.92")
    yield _wrong("cubic", CUBIC, radius="0.65")
    yield _wrong("cubic", CUBIC, level="-0.46245")
    yield _wrong("cubic", CUBIC, height="-1")
    yield _wrong("cubic", CUBIC, stretch="-1")
    yield _wrong("cubic", CUBIC, kind="lure")
    wide = bent(CUBIC, time="3")
    yield _holds("cubic", "level at the radius", bent(wide, level="0.7071"))
    yield _wrong("cubic", wide, level="0.70711")
    yield _wrong("cubic", wide, certificate=EVEN)
    for part in ({"level": "-1"}, {"level": None, "radius": None}):
        yield _wrong("cubic", wide, last=last("quadratic", WIDE | part, "0.46245", "1"))
    yield from _each_wrong("cubic", bent(wide, tolerance="9", time="1/2"), rate=["0", "-1"])


def _bent_observer() -> Iterator[Case]:
    name = "observed, linear"
    for check, too_large in ((SEEN, "1.1"), (STRETCHED, "1.2"), (PAID_SEEN, "1.2")):
        for k, value in ((1, "0.614"), (2, "0.378")):
            yield _fails(name, f"agent 1 {value}", moved(check, k, 0, value))
        yield from _each_wrong(name, check, domain=[box(1, 0.51), box(1.001, 0.5)])
        yield _wrong(name, check, beta="2.0001")
        yield from _each_wrong(name, check, size=["0.9999", too_large])
        yield _wrong(name, check, "time", time="4.53")
    for P in ([["0.9999"]], [["-1"]], matrix("1; 1")):
        tubed = bent(SEEN, time="9")
        for part in (tubed["exact"]["tube"], tubed["exact"]["last"]["certificate"]):
            part["P"] = P
        yield _fails(name, f"P {P}", tubed)
    for part in ({"size": "1.1"}, {"beta": "1.9"}):
        other = last("max-separable", CALM | part, "0.56395", "1")
        yield _wrong(name, SEEN, last=other, time="9")
    yield _wrong(name, SEEN, level="0.5639")
    yield from _each_wrong(name, SEEN, kappa=["0.99", "-1"])
    yield _wrong(name, SEEN, alpha="3.01")
    yield _wrong(name, STRETCHED, level="0.921")
    yield from _each_wrong(name, STRETCHED, stretch=["1.9999", "-2"])
    yield _wrong(name, STRETCHED, height="0.7071")
    yield _wrong(name, STRETCHED, rate="1.9")
    yield from _each_wrong(name, STILL, beta=["0", "-1/1000"])
    yield _wrong(name, STILL, size="1.5")
    blind = changed(STRETCHED)
    del blind["exact"]["tube"]["P"]
    yield _fails(name, "no P", blind)
