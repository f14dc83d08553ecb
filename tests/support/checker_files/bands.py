"""Sines of unknown frequencies for the lone checker: claims of one or two agents written by hand,
and just-false twins.

h = y, k = 3, and a sine of 1/2 in [9/5, 11/5]: the paper's observer leaves 0.103995 of it, so that
alpha = 1 leaves 2 level >= 0.0519975. Of two agents without gains that agree, both may leave it, in
opposite phases. What [uncertainty] states beside, peak gains pass on: 0.25892 act then.
"""

import json
from collections.abc import Iterator
from fractions import Fraction

from texts import matrix

from checker_files import margins
from checker_files.accuracy import BOX, accuracy, bent, peaks, put, scaled, stage, stated
from checker_files.files import HOLDS, UNREADABLE, Case, collected, scalar
from checker_files.margins import SEEN, one
from checker_files.separable import GLOBAL
from dobc_design import Observer, Problem
from dobc_design.problem.exosystems import stacked

BAND = ["9/5", "11/5", "1/2"]
GAIN = [["0.103995"]]
LEFT = {"peaks": {"bands": [GAIN]}}
SINE = accuracy(GLOBAL, ["0.026"], stage("1", level="0.026", alpha="1"), **LEFT)
#: [19/10, 21/10] beside, of which 0.051079 is left: 0.0775370 acts.
TWO = [BAND, ["19/10", "21/10", "1/2"]]
SINES = accuracy(
    GLOBAL,
    ["0.0388"],
    stage("1", level="0.0388", alpha="1"),
    peaks={"bands": [GAIN, [["0.051079"]]]},
)
#: 0.48227 act on the paper's observer without sines, and 0.0519975 more with one.
ALL = {"disturbance": "1/10", "drift": "1/20", "measurement": "1/50"}
PASSED = peaks("1.3389", "0.7098", "7.6441", steps=150)["peaks"] | LEFT["peaks"]
BESIDE = accuracy(GLOBAL, ["0.2672"], stage("1", level="0.2672", alpha="1"), peaks=PASSED)
#: Both components are felt by both: S = s/((s + 2)^2 - 1) [[s + 2, 1], [1, s + 2]], of which at
#: w = 1 |S_11| = sqrt(5)/sqrt(20) = 1/2 and |S_12| = 1/sqrt(20) are left.
PLANE = {
    "coupling": "y",
    "target": [0, 0],
    "exosystem": stacked(scalar(0), scalar(0)),
    "observer": Observer(W=matrix("2 -1; -1 2")),
}
MIXED = accuracy(
    GLOBAL,
    ["0.181"],
    stage("1", level="0.181", alpha="1"),
    peaks={"bands": [matrix("1/2 0.2236068; 0.2236068 1/2")]},
)


def about(problem: Problem, *bands: list[str], **more: str) -> Problem:
    return problem.replace(uncertainty={"bands": list(bands), **more})


def unreadable(problem: Problem, name: str, *changes: tuple[str, object]) -> Iterator[Case]:
    """The file with each of these values in turn, which no problem has."""
    good = bent(problem, SINE, name)
    for path, value in changes:
        document = json.loads(good.problem)
        stated(value, path)(None, document)
        data = json.dumps(document).encode()
        yield Case(f"bands: {name} {path} {value}", good.certificate, data, UNREADABLE)


@collected
def bands_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    plain = one(coupling="y", **SEEN)
    sine = about(plain, BAND), SINE
    sines = about(plain, *TWO), SINES
    beside = about(plain, BAND, **ALL), BESIDE
    plane = about(one(**PLANE), ["1", "1", "1/2"]), MIXED
    good = {"one": sine, "two": sines, "beside": beside, "plane": plane}
    for name, each in good.items():
        yield bent(*each, f"bands: {name}", code=HOLDS)
    gain = "exact.peaks.bands.0.0.0"
    level = "exact.stages.0.level"
    yield bent(
        *sine,
        "bands: more than is left",
        put("1/9", gain),
        put("0.0278", level),
        put("0.0278", "exact.bounds.1"),
        code=HOLDS,
    )
    for name, each in good.items():
        yield bent(*each, f"bands: {name}, a gain", scaled("0.99999", gain))
        yield bent(*each, f"bands: {name}, a level", scaled("0.99", level))
    yield bent(*sines, "bands: the second gain", scaled("0.9999", "exact.peaks.bands.1.0.0"))
    yield bent(*plane, "bands: an entry beside", scaled("0.999", "exact.peaks.bands.0.0.1"))
    yield bent(*sine, "bands: a negative gain", put("-0.103995", gain))
    yield bent(*sine, "bands: nothing is left", put("0", gain))
    yield bent(*sine, "bands: no gain", put([], "exact.peaks.bands"))
    yield bent(*sines, "bands: one gain for two", put([GAIN], "exact.peaks.bands"))
    yield bent(*sine, "bands: a gain too many", put([GAIN, GAIN], "exact.peaks.bands"))
    yield bent(*sine, "bands: a row", put([GAIN[0][0]], "exact.peaks.bands"))
    yield bent(
        *sine, "bands: gains of two components", put([matrix("1 1; 1 1")], "exact.peaks.bands")
    )
    yield bent(*sine, "bands: integrals of nothing", put("1", "exact.peaks.drift"))
    for place, value in (("0", "17/10"), ("1", "221/100"), ("2", "101/200")):
        yield bent(*sine, f"bands: wider {place}", stated(value, f"uncertainty.bands.0.{place}"))
    yield bent(*sine, "bands: a slower observer", stated("8/5", "observer.W.0.0"))
    yield bent(*sine, "bands: another pole", stated("21/10", "exosystem.A.0.1"))
    yield bent(plain.replace(uncertainty=ALL), SINE, "bands: none stated")
    table = {"limit": 9, "amplitude": 1}
    held = about(one(coupling="tanh(y)", region=BOX, actuators=table, **SEEN), BAND)
    least = Fraction(margins.claimed(held, "actuators")["inputs"]["1"])
    yield margins.bent(held, "actuators", code=HOLDS)
    # the sine of 1/2 that is compensated, and what is left of it
    for less in ("1/2", "1/20"):
        yield margins.bent(held, "actuators", inputs={"1": str(least - Fraction(less))})
    undamped = plain.replace(observer=Observer(W=matrix("0; 0")))
    yield bent(about(undamped, BAND), _all_left(), "bands: nothing decays", answers=False)
    blind = about(plain.replace(observer=None), BAND)
    yield from unreadable(blind, "no observer", ("exosystem", None))
    yield from unreadable(
        sine[0],
        "stated",
        ("uncertainty.bands.0.0", "23/10"),
        ("uncertainty.bands.0.0", "-1"),
        ("uncertainty.bands.0.2", "0"),
        ("uncertainty.bands.0", ["0", "0", "1/2"]),
        ("uncertainty.bands.0", ["9/5", "11/5"]),
        ("uncertainty.bands", None),
        ("time", "discrete"),
        ("version", 1),
    )


def _all_left() -> dict[str, object]:
    whole = {"bands": [[["1"]]]}
    return accuracy(GLOBAL, ["1/4"], stage("1", level="1/4", alpha="1"), peaks=whole)
