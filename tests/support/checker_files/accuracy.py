"""Final bounds for the lone checker: claims of one or two agents written by hand, and just-false
twins.

On every agent acts 1/10, and 1/50 of noise: on what its gain holds, on both sides of an arc, and
through the observer. One agent, h = y, k = 3: 1/10 + 3/50 = 4/25, so that alpha = 1 leaves 2 level
>= 4/25. tanh on the arc of two: 4/25 on agent 1, 1/10 + 1/25 on agent 2, tanh((v_2 - v_1) s) >=
0.14 + alpha v_2 s at both ends. y + y^3 on the arc of two, k = 2, noise 1/50: with v = (1/2, 1) an
argument reaches 3/2 + 1/25 and the slope 1 + 3 1.54^2 = 8.1148, so that 8.1148/25 = 0.324592 acts
on agent 2; s/2 + s^3/8 = 0.327 at s = 3/5 but 0.311 at s = 23/40. With A - W C = -2 the peak gains
are 1, 1/2 and 2 + 2; in steps of 1/20 h^2/6 of them more: tanh(2 s) >= 0.38541 + ...
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cache
from itertools import permutations
from typing import Any

from certified import consensus_claims
from texts import matrix, ranges, vector

from checker_files.files import FAILS, HOLDS, Case, Document, collected, scalar
from checker_files.margins import REGION, SEEN, one, two
from checker_files.separable import GLOBAL, asked, box, claim, given
from dobc_design import Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical
from dobc_design.problem.dynamics import Dynamics

Change = Callable[[Any, Any], None]
PEAKS = ("disturbance", "drift", "measurement")
RELATIVE = ("weights", "gains")
ALL = {"disturbance": "1/10", "drift": "1/20", "measurement": "1/50"}
BOX = REGION | {"initial_disturbance": "1/10"}
WATCHED: dict[str, Any] = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}


def stage(*v: str, level: str, alpha: str, rho: str | None = None) -> Document:
    return {"v": list(v), "alpha": alpha, "level": level, "rho": rho}


def peaks(*values: str, steps: int) -> Document:
    return {"peaks": dict(zip(PEAKS, values, strict=True)) | {"step": "1/20", "steps": steps}}


def accuracy(domain: Any, bounds: list[Any], *stages: Document, **exact: Any) -> Document:
    told = {str(k + 1): bound for k, bound in enumerate(bounds)}
    stages_and_bounds = {"stages": list(stages), "bounds": told}
    return claim("accuracy", domain, None, stages_and_bounds | exact)


LONE = accuracy(GLOBAL, ["2/25"], stage("1", level="2/25", alpha="1"))
WIDE = stage("1", "2", level="1/4", alpha="1/20", rho="1")
NEAR = stage("1", "3", level="0.08", alpha="1/20", rho="0.26")
CURVED = accuracy(box(1), vector("0.08 0.24"), WIDE, NEAR)
STEEP: dict[str, Any] = {
    "coupling": "y + y**3",
    "gains": {1: 2},
    "uncertainty": {"measurement": "1/50"},
}
STEEP_STAGE = stage("1/2", "1", level="3/5", alpha="1/1000000", rho="1")
PASSED_ON = accuracy(box(0.5), vector("3/10 3/5"), STEEP_STAGE)
# With B = 2 w acts twice: e' = 2 (w - e) ends at 1/10.  Of (y1 + 5 y2, y2) the second component
# pulls the first.
TWICE = {
    "coupling": "y",
    "gains": 1,
    "dynamics": Dynamics(A=[[0]], B=[[2]]),
    "uncertainty": {"disturbance": "1/10"},
}
MIXED = {
    "coupling": ["y1 + 5*y2", "y2"],
    "gains": 1,
    "target": [0, 0],
    "uncertainty": {"disturbance": "1/10"},
}
# Row 1 of agent 2: 1 + 1/10 - 1 + 1/10 - 1 + alpha + (1/10)/level <= 0.
SLANTED = MIXED | {"coupling": ["y1 + y2/10", "y2"]}
SLOPES = ranges("1 1, 1/10 1/10; 0 0, 1 1")
UNIT = matrix("1 0; 0 1")
# Where agent 1 alone is pinned the integrals of the responses of agent 2 are 1 + 5 + 1 + 20 exp(-2)
# in its first component, whose response to w_12 is 5 (t - t^2/2) exp(-t), and 1 + 1 in the second:
# 0.97067 and 1/5, a little more in steps.
PULLED = MIXED | {"gains": {1: 1}}
WHOLE = {"1": vector("0.1003 0.1003"), "2": vector("0.973 0.2005")}
# The peak gains of the paper's observer are 1.33276, 0.70728 and 7.62999, a little more in these
# steps: 0.48227 acts, and 2 level has to be as large.
HARMONIC = peaks("1.3389", "0.7098", "7.6441", steps=150)
SHARP = accuracy(GLOBAL, ["0.2412"], stage("1", level="0.2412", alpha="1"), **HARMONIC)
# k = 3, noise 1/50, weights and gains off by 1/100, agent 2 hears 1 with w = 10 in mode A and
# nobody in B, and v = (1/2, 1). An observer has seen 2/50 10 1.01 1.0019 in mode A, which acts in
# B, too: (3.03 + 4.0037)/50 + 0.40477 = 0.54545, and 2.97 level has to be as large: 0.18366.
HELD = peaks("1.0019", "0.501", "4.0037", steps=100)
SWITCHED = accuracy(
    GLOBAL, vector("0.0925 0.185"), stage("1/2", "1", level="0.185", alpha="1/1000"), **HELD
)
# Agent 2 hears 1 with w = 1, off by 1/10, k = 3, v = (1, 1): 0.20019 acts, and the observer adds
# 1.0019/10 2 s: (3 - 0.20038) s >= 0.20019 from 0.07151 on; it would be 0.06673 if it knew.
UNKNOWN = accuracy(
    GLOBAL, vector("0.0716 0.0716"), stage("1", "1", level="0.0716", alpha="1/1000"), **HELD
)
# kappa (beta - 0) v > 1, and 1 + 3/5 1/10 <= rho.  0.38541 + 0.12 * 0.225 <= tanh(0.45) = 0.42190.
PART = {"P": [["1"]], "beta": "2", "kappa": "3/5", "size": "1"} | peaks(
    "1.0019", "0.501", "4.0037", steps=100
)
BOTH = accuracy(
    box(1, 0.1),
    vector("0.225 0.675"),
    stage("1", "3", level="0.225", alpha="1/25", rho="1.06"),
    **PART,
)


def followed(bounds: Document, *, step: str = "1/100", steps: int, **exact: Any) -> Document:
    """The form of a claim for linear loops in one mode."""
    response = {"step": step, "steps": steps}
    return claim("accuracy", GLOBAL, None, {"bounds": bounds, "response": response} | exact)


# sin on both arcs of two with k = 3: 6 - 0.501 = 2 rate, and V falls to 2/100/rate^2 under 1/10, so
# that |e_i| ends at 0.051436.
ROUND = {"d": ["1", "1"], "a": {"G": ["0", "0"]}, "b": {"G": ["0.501", "0.501"]}}
ROUND |= {"level": "4.9", "rate": "2.7495"}


def round_ones(domain: Any, bounds: list[str], **more: Any) -> Document:
    """One ball; ``more`` of it, and peaks."""
    seen = {"peaks": more.pop("peaks")} if "peaks" in more else {}
    told = {str(k + 1): bound for k, bound in enumerate(bounds)}
    return claim("accuracy", domain, None, {"balls": [ROUND | more], "bounds": told} | seen)


@cache
def _frame(problem: Problem) -> tuple[str, str]:
    """The problem file, and what is claimed of the consensus."""
    return canonical_bytes(problem).decode(), certificate_bytes(consensus_claims(problem)).decode()


def bent(
    problem: Problem,
    claimed: Document,
    name: str,
    *changes: Change,
    code: int = FAILS,
    answers: bool = True,
) -> Case:
    """The certificate with this claim, after ``changes`` of it and of the document of the problem;
    ``answers``: it carries the verdict."""
    document, claims = (json.loads(text) for text in _frame(problem))
    check = json.loads(json.dumps(claimed))
    claims["checks"] = [*(each for each in claims["checks"] if each["id"] != "accuracy"), check]
    # what is asked: the verdict follows from it
    if answers and (problem.region is None or check["domain"] == GLOBAL):
        claims |= {"verdict": "proved", "rate": None, "covered_by": "accuracy"}
    for change in changes:
        change(check, document)
    data = canonical_bytes(problem_from_canonical(json.dumps(document).encode()))
    claims["problem_sha256"] = hashlib.sha256(data).hexdigest()
    return Case(f"accuracy {name}", json.dumps(claims).encode(), data, code)


def _put_into(place: Any, path: str, value: Any) -> None:
    """A function as the value is applied to what is there."""
    *steps, last = path.split(".")
    for step in steps:
        place = place[int(step)] if isinstance(place, list) else place[step]
    key = int(last) if isinstance(place, list) else last
    place[key] = value(place[key]) if callable(value) else value


def put(value: Any, path: str) -> Change:
    """Put a value at a path into the check."""
    return lambda check, _: _put_into(check, path, value)


def stated(value: Any, path: str) -> Change:
    """Put a value at a path into the problem."""
    return lambda _, document: _put_into(document, path, value)


def scaled(factor: str, path: str) -> Change:
    """Multiply a number of the check."""
    return put(lambda number: str(Fraction(factor) * Fraction(number)), path)


def _level(level: str) -> Change:
    """Another level of a claim with one stage for two agents, with its bounds."""

    def change(check: Any, _: Any) -> None:
        stage = check["exact"]["stages"][0]
        stage["level"] = level
        first, second = (str(Fraction(level) * Fraction(x)) for x in stage["v"])
        check["exact"]["bounds"] = {"1": first, "2": second}

    return change


def whole_loops() -> Iterator[Case]:
    """Claims by the response of a whole loop."""
    mixed = two(**PULLED), followed(WHOLE, steps=1200)
    # e' = -3 e + w + C eps, on which 0.1 (1 + 1.0019) + 0.05 0.501 = 0.22524 acts: 0.07508.
    inputs = {"disturbance": "1/10", "drift": "1/20"}
    problem = one(coupling="y", uncertainty=inputs, **WATCHED)
    told = followed({"1": ["0.0751"]}, steps=600, **HELD)
    watched = (problem, told)
    # e' = 2 (w - e).
    twice = one(**TWICE), followed({"1": ["0.1001"]}, steps=800)
    once = [[2, 1]]
    modes = {"A": once, "B": [[2, 1, 2]]}
    switching = Network.from_arcs(modes, arrow="listens_to", agents=2)
    double = one(network=switching, coupling="y", gains=1, uncertainty={"disturbance": "1/10"})
    idle = one(coupling="y", uncertainty={"drift": "1/10"})
    eleven = Network.from_arcs([], arrow="listens_to", agents=11)
    alone = one(network=eleven, coupling="y", gains=3, uncertainty={"disturbance": "1/10"})
    followed_long = followed({str(k + 1): ["1"] for k in range(11)}, steps=20_000)
    good = {"mixed": mixed, "watched": watched, "twice": twice}
    for name, each in good.items():
        yield bent(*each, f"response: {name}", code=HOLDS)
    yield bent(*mixed, "response: a bound", put("0.9706", "exact.bounds.2.0"))
    yield bent(*mixed, "response: a bound of agent 1", put("0.1002", "exact.bounds.1.1"))
    yield bent(*watched, "response: a bound with an observer", put("0.075", "exact.bounds.1.0"))
    yield bent(*watched, "response: a peak gain", scaled("0.999", "exact.peaks.disturbance"))
    yield bent(*twice, "response: half of B", put("0.0999", "exact.bounds.1.0"))
    yield bent(*mixed, "response: one step", put(1, "exact.response.steps"))
    yield bent(*mixed, "response: long steps", put("1/20", "exact.response.step"))
    yield bent(*mixed, "response: a stranger", put(vector("1 1"), "exact.bounds.3"))
    yield bent(*mixed, "response: one component", put(["1"], "exact.bounds.1"))
    yield bent(*mixed, "response: stages beside", put([], "exact.stages"))
    yield bent(*mixed, "response: somewhere", put("consensus", "domain"))
    yield bent(idle, followed({"1": ["0"]}, steps=800), "response: nothing acts", answers=False)
    yield bent(*mixed, "response: rate", put(0.1, "rate"))
    yield bent(
        two(**PULLED | {"coupling": ["tanh(y1)", "y2"]}),
        mixed[1],
        "response: a curved coupling",
    )
    yield bent(
        double, followed({"1": ["0.101"], "2": ["0.101"]}, steps=1200), "response: two modes"
    )
    for x in RELATIVE:
        yield bent(*mixed, f"response: {x}", stated("1/100", f"uncertainty.{x}"))
    yield bent(*mixed, "response: noise", stated("1/100", "uncertainty.measurement"))
    yield bent(alone, followed_long, "response: steps that take long")


def in_balls() -> Iterator[Case]:
    """Claims by arc-wise balls, from which boxes may take over."""
    tenth = {"disturbance": "1/10"}

    def sines(**more: Any) -> Problem:
        return Problem(**given("sin(y)", uncertainty=tenth) | more)

    ball, bound = "exact.balls.0", "exact.bounds.2"
    plain = sines(), round_ones(box(1.565), ["0.0515"] * 2)
    smaller = put([ROUND, ROUND | {"level": "0.00265"}], "exact.balls")
    less = {"rate": "1", "P": [["0.1429"]]}
    watched = (
        sines(**WATCHED | {"region": BOX}),
        round_ones(box(1.56, 0.1), ["0.2832"] * 2, **less, **HELD),
    )
    noisy = sines(uncertainty={"measurement": "1/50"}), plain[1]
    curved = Dynamics(f=["x + x**3/100"])
    nodes = sines(dynamics=curved), round_ones(box(1), ["0.0832"] * 2, rate="1.7004")
    # 14 - 1.002 = 2 rate, and B w = 1/5
    twice = Dynamics(A=[[-1]], B=[[2]])
    heavy = round_ones(box(1), ["0.0436"] * 2, rate="6.4985", b={"G": ["1.002"] * 2})
    entered = sines(dynamics=twice), heavy
    plane = {"target": [0, 0], "gains": {1: [[3, 1], [0, 3]], 2: 3}}
    planar = sines(**plane), round_ones(box(1.1), ["0.089"] * 2, rate="2.2495")
    two_d = {"d": ["1", "2"], "b": {"G": ["0.501", "1.002"]}, "rate": "2.499"}
    uneven = sines(), round_ones(box(1), ["0.0694", "0.0491"], **two_d)
    straight = sines(coupling="y", region=asked(2)), round_ones(box(1), ["0.0515"] * 2)
    relative = tenth | {"weights": "1/10", "gains": "1/10"}
    more = {"b": {"G": ["0.5511"] * 2}, "rate": "2.4244"}
    off = sines(uncertainty=relative), round_ones(box(1), ["0.0584"] * 2, **more)
    # six differences, on each of which 2/10 act: V falls to 6 (2/10)^2/rate^2
    thrice = Network.from_arcs([*permutations((1, 2, 3), 2)], arrow="listens_to", agents=3)
    apart = {"network": thrice, "gains": None, "goal": "agreement", "region": asked("1/5")}
    pairs = [f"({i}, {j})" for i, j in permutations((1, 2, 3), 2)]
    six = {"d": ["1"] * 6, "a": {"G": ["0"] * 12}, "b": {"G": ["0.501"] * 12}}
    agreeing = round_ones(box(0.4), ["0.545"] * 6, **six | {"rate": "0.9", "level": "1"})
    agreeing["exact"]["bounds"] = dict.fromkeys(pairs, "0.545")
    good = {
        "agreeing": (sines(coupling="tanh(y)", **apart), agreeing),
        "plain": plain,
        "watched": watched,
        "noisy": noisy,
    }
    good |= {"nodes": nodes, "through B": entered, "planar": planar, "two d": uneven}
    good |= {"straight": straight, "off": off}
    for name, each in good.items():
        end = f"exact.bounds.{list(each[1]['exact']['bounds'])[-1]}"
        yield bent(*each, f"balls: {name}", code=HOLDS)
        yield bent(*each, f"balls: a bound, {name}", scaled("0.998", end))
    yield bent(*plain, "balls: below nothing", put("-1", bound))
    yield bent(*plain, "balls: two", smaller, code=HOLDS)
    yield bent(*plain, "balls: the second", smaller, put("0.00264", "exact.balls.1.level"))
    # what is left may be 0.00529 for d = 2
    second = ROUND | two_d | {"level": "0.00482"}
    wider = put({"1": "0.0694", "2": "0.0491"}, "exact.bounds")
    yield bent(*plain, "balls: another d", put([ROUND, second], "exact.balls"), wider)
    yield bent(*plain, "balls: none", put([], "exact.balls"))
    yield bent(*watched, "balls: none that are watched", put([], "exact.balls"))
    yield bent(*plain, "balls: thirty-one", put([ROUND] * 31, "exact.balls"))
    yield bent(*plain, "balls: starts in a ball", put("ball", "domain.kind"))
    yield bent(*plain, "balls: wider", put(1.566, "domain.radius"))
    yield bent(*plain, "balls: everywhere", put(GLOBAL, "domain"))
    yield bent(*plain, "balls: the rate", put("2.7496", f"{ball}.rate"))
    yield bent(*plain, "balls: a rate below 0", put("-2.7495", f"{ball}.rate"))
    yield bent(*plain, "balls: an arc", put("0.499", f"{ball}.b.G.0"))
    loose = [put("2.213", "exact.bounds.1"), put("2.213", bound)]
    acts = "uncertainty.disturbance"
    yield bent(*plain, "balls: 4.3 act", *loose, stated("4.3", acts), code=HOLDS)
    yield bent(*plain, "balls: 4.31 act", *loose, stated("4.31", acts))
    yield bent(*watched, "balls: P", put("0.1428", f"{ball}.P.0.0"))
    yield bent(*watched, "balls: a peak gain", scaled("0.999", "exact.peaks.disturbance"))
    yield bent(*watched, "balls: more disturbance", put(0.5, "domain.disturbance"))
    unknown = sines(**WATCHED | {"region": BOX}, uncertainty=relative | {"known_to_agents": False})
    yield bent(unknown, watched[1], "balls: observers that do not know", *loose)
    yield bent(
        *straight, "balls: stages", put([stage("1", "1", level="1", alpha="1")], "exact.stages")
    )
    shrunk = put({"1": ["0.0001"], "2": ["0.0001"]}, "exact.bounds")
    yield bent(*plain, "balls: coordinates", put([["1000"]], "exact.T"), shrunk)
    yield bent(
        *straight, "balls: a response", put({"step": "1/100", "steps": 600}, "exact.response")
    )
    listed = sines(**plane, coupling=["sin(y1)", "tanh(y2)"])
    yield bent(listed, planar[1], "balls: different components", *loose)


@collected
def accuracy_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    lone = one(coupling="y", uncertainty=ALL), LONE
    curved = two(coupling="tanh(y)", uncertainty=ALL, region=REGION), CURVED
    seen = one(coupling="y", uncertainty=ALL, **SEEN), SHARP
    both = two(coupling="tanh(y)", uncertainty=ALL, region=BOX, **WATCHED), BOTH
    steep = two(**STEEP), PASSED_ON
    by_rows = stage("1", "1", "1", "1", level="1/4", alpha="1/4")
    plane = by_rows | {"ranges": SLOPES}
    claimed = accuracy(GLOBAL, matrix("1/4 1/4") * 2, plane, T=UNIT)
    turned = two(**SLANTED), claimed
    small_stage = stage("1", "1", level="2/25", alpha="1/10")
    by_component = accuracy(GLOBAL, vector("2/25 2/25"), small_stage)
    wide_stage = stage("1", "1", level="1/5", alpha="1/10")
    wider = accuracy(GLOBAL, vector("1/5 1/5"), wide_stage)
    level, bound = "exact.stages.-1.level", "exact.bounds.1"
    loose = [scaled("1000", level), scaled("1000", bound)]
    loose += [scaled("100", f"exact.peaks.{x}") for x in PEAKS]
    sharp = stated("sqrt(y + 1) - 1", "coupling.h")
    lower_level = put({"1": "1/2", "2": "3/2"}, "exact.bounds")
    beyond = [put("1/2", "exact.stages.1.level"), lower_level]
    strong = [[2, 1, 10]]
    arcs = {"A": strong, "B": []}
    modes = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    noise = {"measurement": "1/50", "weights": "1/100", "gains": "1/100"}
    switching = one(network=modes, coupling="y", gains=3, uncertainty=noise, **WATCHED), SWITCHED
    unsure = {"disturbance": "1/10", "weights": "1/10", "known_to_agents": False}
    unknown = two(coupling="y", gains=3, uncertainty=unsure, **WATCHED), UNKNOWN
    yield from whole_loops()
    yield from in_balls()
    for k, each in enumerate((switching, unknown)):
        yield bent(*each, f"good with errors {k}", code=HOLDS)
    for k, each in enumerate((lone, curved, seen, both, steep, turned)):
        yield bent(*each, f"good {k}", code=HOLDS)
    yield bent(*seen, "loose", *loose, code=HOLDS)
    for x in PEAKS:
        yield bent(*seen, f"smaller peak gain of {x}", scaled("0.999", f"exact.peaks.{x}"))
    for x in PEAKS:
        yield bent(*both, f"a peak gain of {x} below", scaled("0.999", f"exact.peaks.{x}"))
    yield bent(*lone, "no table", lambda _, document: document.pop("uncertainty"))
    yield bent(*lone, "rate", put(0.1, "rate"))
    yield bent(*seen, "long steps", *loose, put("1/4", "exact.peaks.step"))
    yield bent(*seen, "one step", *loose, put(1, "exact.peaks.steps"))
    yield bent(*lone, "no stage", put([], "exact.stages"))
    yield bent(*curved, "growth", put("-1", "exact.stages.0.alpha"))
    yield bent(*lone, "level below 0", put("-1", "exact.stages.0.level"))
    yield bent(*lone, "rho of linear couplings", put("2", "exact.stages.0.rho"))
    yield bent(*curved, "rho below level", *beyond)
    yield bent(*curved, "a ball", put("ball", "domain.kind"))
    yield bent(*curved, "wider", put(1.1, "domain.radius"))
    yield bent(*lone, "somewhere", put("consensus", "domain"))
    yield bent(*both, "kappa", put("1/10", "exact.kappa"))
    yield bent(*both, "P", put("1/2", "exact.P.0.0"))
    yield bent(*both, "size", put("0.999", "exact.size"))
    yield bent(*both, "more disturbance", put(0.101, "domain.disturbance"))
    yield bent(*lone, "twice", put(lambda stages: stages * 2, "exact.stages"))
    yield bent(*curved, "a gap", put("0.261", "exact.stages.0.level"))
    yield bent(*lone, "a stranger", put("1", "exact.bounds.2"))
    yield bent(*lone, "bound", scaled("0.9999", "exact.bounds.1"))
    for k, each in enumerate((lone, curved, seen, both)):
        yield bent(*each, f"lower {k}", scaled("9/10", level))
    yield bent(*curved, "a slope without bound", sharp)
    for k in (0, 1):
        yield bent(*curved, f"no rho in stage {k}", put(None, f"exact.stages.{k}.rho"))
    yield bent(*steep, "noise that shortens the reach", _level("23/40"))
    yield bent(*steep, "half of the noise of an arc", _level("3/10"))
    yield bent(two(**TWICE), by_component, "dynamics by component")
    yield bent(two(**MIXED), wider, "a list by component")
    yield bent(*switching, "what was seen in another mode", _level("0.15"))
    yield bent(*switching, "off by more", stated("1/3", "uncertainty.weights"))
    yield bent(*switching, "gains off by more", stated("1/2", "uncertainty.gains"))
    yield bent(
        *unknown,
        "observers that know",
        stated(True, "uncertainty.known_to_agents"),
        code=HOLDS,
    )
    yield bent(*unknown, "what blind observers pass on", _level("0.0714"))
    yield bent(*turned, "noise in coordinates", stated("1", "uncertainty.measurement"))
    for x in RELATIVE:
        yield bent(*turned, f"{x} in coordinates", stated("1/100", f"uncertainty.{x}"))
