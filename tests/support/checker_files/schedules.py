"""Signals that keep a guarantee: claims of `schedule` written by hand whose truth is known, and
twins that just fail.

Few segments, so that every row can be worked out on paper: of a linear one both ends of a segment
decide.
"""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from checker_files.files import FAILS, HOLDS, Case, Document, as_written, network, scalar
from checker_files.separable import REFUTED, ball, box, claim, doubles
from checker_files.settling import bent as changed
from checker_files.settling import last, settling, tube
from checker_files.settling import moved as shifted
from checker_files.switching import Frames, bent
from dobc_design import Network
from dobc_design.problem.groups import Observer

GLOBAL = "global"
PAPER = "exp(y) - 1 + y"
TURNS: Document = {"guarantee": "sequence", "sequence": ["A", "B"], "dwell": 1}
CHAIN: Document = {
    "network": network({"A": [[3, 2]], "B": [[2, 1]]}, agents=3),
    "coupling": "y",
    "gains": {1: 1},
}
ONE_OR_BOTH = network({"A": [[2, 1]], "B": [[2, 1], [1, 2]]}, agents=2)
PAIR: Document = {"network": ONE_OR_BOTH, "coupling": "y + y**3", "gains": {1: 5}}
THREE = network({"A": [[2, 1]], "B": [[3, 2]], "C": []}, agents=3)
WATCHED: Document = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}
#: e_1' = e_1/2 - e_2 in A, likewise e_2 in B: over both errors grow 20.09 times in 6 s.
GROWS: Document = {
    "network": network({"A": [[1, 2]], "B": [[2, 1]]}, agents=2),
    "coupling": "-y",
    "gains": "1/2",
}
LOOSE = Network.from_arcs(
    {"A": [[1, 2]], "B": []}, optional={"A": [], "B": [[2, 1]]}, arrow="listens_to", agents=2
)
DWELL: Document = {"guarantee": "dwell", "dwell": 1}
UNEVEN: Document = {"guarantee": "sequence", "schedule": [[0, "A"], [1, "B"]], "period": 2}


def _settings() -> dict[str, tuple[Document, Document]]:
    """Small problems, and their [switching]."""
    plane: Document = {"target": [0, 0], "gains": {1: 1, 2: [[1, 2], [-2, 1]]}}
    return {
        "chain": (CHAIN, TURNS),
        "chain, listed": (CHAIN, TURNS | {"dwell": [1, 1]}),
        "chain, in rounds": (CHAIN, UNEVEN),
        "chain, by period": (CHAIN, TURNS | {"dwell": None, "period": 2}),
        "chain, every mode": (CHAIN, TURNS | {"sequence": None}),
        "chain, any signal": (CHAIN, {"guarantee": "arbitrary", "signal": "random", "dwell": 1}),
        "chain, no guarantee": (CHAIN, {"signal": "random", "dwell": 1}),
        "chain, one of two": (CHAIN, TURNS | {"sequence": ["A"]}),
        "one mode": (
            CHAIN | {"network": network({"A": [[2, 1]]}, agents=2)},
            TURNS | {"sequence": ["A"]},
        ),
        "chain, observed": (CHAIN | WATCHED, TURNS),
        "chain, bad W": (CHAIN | WATCHED | {"observer": Observer(W=[[-1]])}, TURNS),
        "pair": (PAIR, DWELL | {"longest": 2}),
        "pair, linear": (PAIR | {"coupling": "y"}, DWELL | {"longest": 2}),
        "pair, for ever": (PAIR, DWELL),
        "pair, for ever, linear": (PAIR | {"coupling": "y"}, DWELL),
        "curved": (CHAIN | {"coupling": PAPER}, TURNS),
        "curved, observed": (CHAIN | WATCHED | {"coupling": PAPER}, TURNS),
        "sine": (CHAIN | {"coupling": "sin(y)"}, TURNS),
        "chain, uneven": (CHAIN, UNEVEN | {"schedule": [[0, "A"], [1, "B"]], "period": "5/2"}),
        "soft": (PAIR | {"coupling": "y - 2*y**3/25"}, DWELL),
        "flat": (CHAIN | {"coupling": "y**3"}, TURNS),
        "unused": (CHAIN | {"coupling": "-y", "exceptions": {(1, 0): "y", (2, 1): "y"}}, TURNS),
        "three": (CHAIN | {"network": THREE}, DWELL | {"longest": 2}),
        "three, in turn": (CHAIN | {"network": THREE}, TURNS | {"sequence": ["A", "C", "B"]}),
        "two": (CHAIN, DWELL | {"longest": 2}),
        "two, for ever": (CHAIN, DWELL),
        "grows": (GROWS, TURNS | {"dwell": 3}),
        "grows, watched": (GROWS | WATCHED, TURNS | {"dwell": 3}),
        "grows, loose": (GROWS | {"network": LOOSE}, TURNS | {"dwell": 3}),
        "grows, not": (GROWS | {"gains": "11/10"}, TURNS | {"dwell": 3}),
        "grows, curved": (GROWS | {"coupling": "-y - y**3"}, TURNS | {"dwell": 3}),
        "outward": (PAIR | {"coupling": "y"} | plane, DWELL),
        "list": (PAIR | {"coupling": ["y1 + y2", "y2"], "target": [0, 0]}, DWELL),
    }


_KNOWN = (
    "reachability",
    "lemma1",
    "theorem1",
    "theorem2",
    "observability",
    "detectability",
    "hurwitz",
)
_FRAMES = Frames(_settings(), (*_KNOWN, "linearisation"))
certificate, _case, _fails = _FRAMES.certificate, _FRAMES.case, _FRAMES.fails


def schedule(
    domain: Any, rate: Any, rho: str | None, *phases: Document, exact: str | None = None
) -> Document:
    """``exact``: the rate of the claim, where that of the check is rounded."""
    own = str(rate) if exact is None and rate is not None else exact
    return claim("schedule", domain, rate, {"rate": own, "rho": rho, "phases": list(phases)}) | {
        "rate": rate
    }


def phase(times: list[str], *v: list[str]) -> Document:
    return {"times": times, "v": list(v)}


def turned(check: Document, T: str = "2", low: str = "1", high: str = "1", **more: Any) -> Document:
    """In coordinates z = T e; a coupling has gains between ``low`` and ``high``."""
    ranges = [{"coupling": 0, "gains": [[[low, high]]]}]
    return check | {"exact": check["exact"] | {"T": [[T]], "ranges": ranges} | more}


def _in_coordinates() -> Iterator[Case]:
    """With z = 2 e the same weights hold, a box of e is half as wide, and P is four times as
    large."""
    boxed = bent(CHAINED, domain=box(9), rho="9")
    seen = OBSERVED | {"exact": OBSERVED["exact"] | {"P": [["4"]], "size": "4"}}
    yield _case("chain", HOLDS, turned(CHAINED), "in coordinates")
    yield _case("chain", HOLDS, turned(bent(boxed, rho="18")), "in coordinates, in a box")
    yield _case("chain", FAILS, turned(boxed), "in coordinates, the box leaves the region")
    yield _case("chain, observed", HOLDS, turned(seen), "in coordinates, observed")
    yield _case("chain, observed", FAILS, turned(OBSERVED), "in coordinates, P of e")
    yield _case(
        "chain, listed", HOLDS, turned(CHAINED, low="0.99995", high="2"), "gains a little wider"
    )
    yield _case("chain", FAILS, turned(CHAINED, low="0.99"), "gains wider than the rows bear")
    yield _case(
        "chain", FAILS, turned(CHAINED, low="1.01", high="1.01"), "gains that it does not have"
    )
    yield _case("chain", FAILS, turned(CHAINED, ranges=[]), "no gains")
    yield _case("chain", FAILS, turned(CHAINED, T="0"), "T is singular")
    yield _case("chain", FAILS, turned(CHAINED, T=[["1", "0"], ["0", "1"]]), "T of another size")
    yield _case("chain", FAILS, turned(GRAPHS), "T without weights")
    yield _case(
        "list", FAILS, turned(GRAPHS, T=[["1", "0"], ["0", "1"]]), "a list by its first expression"
    )
    for p, k, i, value in (
        (0, 1, 0, "0.4999"),
        (0, 1, 2, "2.9999"),
        (1, 1, 1, "1.2749"),
        (1, 0, 2, "3.374"),
    ):
        yield _case(
            "chain", FAILS, turned(moved(CHAINED, p, k, i, value)), f"turned {p}, {k}, {i}: {value}"
        )
    rests = turned(bent(STANDING, domain=GLOBAL, rho=None), "1")
    yield _case("pair, for ever, linear", FAILS, rests, "in coordinates, a phase that stands")
    resting = turned(bent(RESTING, domain=GLOBAL, rho=None), "1")
    yield _case("pair, for ever, linear", HOLDS, resting, "in coordinates, a phase that rests")


def moved(check: Document, p: int, k: int, i: int, value: str) -> Document:
    """The weight of agent i at the k-th time of phase p changed."""
    copied = bent(check)
    copied["exact"]["phases"][p]["v"][k][i] = value
    return copied


def retimed(
    check: Document, times: list[str], *v: list[str], p: int = 0, **changes: Any
) -> Document:
    """Phase p replaced."""
    copied = bent(check, **changes)
    copied["exact"]["phases"][p] = phase(times, *v)
    return copied


# h = y, k_1 = 1. Where an agent hears nobody it stays; agent 1: b - a >= -b, so that it halves;
# agent 3 in A: b_3 - a_3 >= b_2 - b_3, so that (2, 4) falls to 3; agent 2 in B: 9/4 falls to (0.3 +
# 9/4)/2. 2 and 3 are handed over to 9/4 and 27/8: exp(rate) = 9/8, the rate 0.117783; up to some
# ten thousandths.
A_STARTS, A_ENDS = ["1", "2", "4"], ["0.5001", "2.0001", "3.0001"]
B_STARTS, B_ENDS = ["3/5", "9/4", "27/8"], ["0.3001", "1.2752", "3.3751"]
CHAINED = schedule(
    GLOBAL, 0.1177, None, phase(["0", "1"], A_STARTS, A_ENDS), phase(["0", "1"], B_STARTS, B_ENDS)
)
# A - W C = -2: beta = 2; kappa (2 - 0.1177) 0.3001 >= 1 from 1.7703 on. From 1 and 1/2: 1 + 1.771/2
# = 1.8855.
PART: Document = {"P": [["1"]], "beta": "2", "kappa": "1.771", "size": "1"}
OBSERVED: Document = CHAINED | {"exact": CHAINED["exact"] | PART}
NEAR: Document = OBSERVED | {"domain": box(1, 0.5), "exact": OBSERVED["exact"] | {"rho": "1.8855"}}
# y + y^3, k_1 = 5, rho = 1. Agent 2 hears agent 1: -(v_2 - v_1) as s goes to 0, so that 2, 5/4, 3/4
# beside 1, 1/2, 1/4. Agent 1 in B: d + d^3 - k_1 v_1 with d = v_2 - v_1: -3, -1.328, and -0.625 at
# the end, where it falls by 1/4. 5/4 is handed over until 2 s: 2 exp(-2 rate).
BOTH = phase(["0", "1", "2"], ["1", "2"], ["1/2", "1.2501"], ["1/4", "0.7502"])
CUBIC = schedule(box(1), 0.2349, "1", BOTH, BOTH)
# Without an end: 5/4 <= 2 exp(-rate), and (1/2, 5/4) falls at 3/5 at rest.
REST = phase(["0", "1"], ["1", "2"], ["1/2", "1.2501"])
RESTING = schedule(box(1), 0.4699, "1", REST, REST)
# Agent 2 does not fall at rest beside an agent 1 as far away; everything else holds up to ln(4/3)/3
# = 0.0958.
LEVEL = phase(
    ["0", "1", "2", "3"], ["1", "2"], ["1/2", "1.2501"], ["1/4", "0.7502"], ["0.7502", "0.7502"]
)
STANDING = schedule(box(1), 0.05, "1", LEVEL, LEVEL)
GRAPHS = schedule(GLOBAL, None, None)
CURVED = schedule(box(1), None, "1")
# kappa 2 >= 1, and 1 + 1/2 * 1/2 = 5/4.
SEEN: Document = bent(CURVED, domain=box(1, 0.5), rho="5/4")
SEEN["exact"] |= PART | {"kappa": "1/2"}


@cache
def cycles_cases() -> list[Case]:
    """All of them, the good ones first."""
    weights = (
        *_good(),
        *_bent_weights(),
        *_bent_dwell(),
        *_bent_observer(),
        *_bent_graphs(),
        *_bent_problems(),
    )
    return [*weights, *_growing(), *_settled()]


def _growing() -> Iterator[Case]:
    """tr M = exp(3) + exp(-3) = 20.14 > 2; with gains of 11/10 the spectral radius of M is 0.99."""
    grows = claim("schedule", GLOBAL, None, {"power": "1"}, verdict="refuted")
    yield _case("grows", HOLDS, grows, "errors grow", **REFUTED)
    yield _case("grows", HOLDS, grows | {"exact": {"power": "64"}}, "errors grow", **REFUTED)
    yield _case("grows, watched", HOLDS, grows, "errors grow", **REFUTED)
    yield _case("grows, loose", FAILS, grows, "an arc that comes and goes", **REFUTED)
    yield _case("grows, not", FAILS, grows, "they do not grow", **REFUTED)
    for power in ("2/2", "1.0", "1e0"):
        yield _case(
            "grows", HOLDS, grows | {"exact": {"power": power}}, f"power {power} is 1", **REFUTED
        )
    for power in ("0", "-1", "3/2", "65"):
        yield _case(
            "grows", FAILS, grows | {"exact": {"power": power}}, f"power {power}", **REFUTED
        )
    yield _case(
        "grows",
        FAILS,
        grows | {"witness": {"kind": "agents", "labels": ["1"]}},
        "a witness",
        **REFUTED,
    )
    yield _case("grows", FAILS, grows | {"rate": 0.1}, "a rate", **REFUTED)
    yield _case("grows, curved", FAILS, grows | {"domain": "consensus"}, "a curve", **REFUTED)
    yield _case("chain", FAILS, grows, "a chain that decays", **REFUTED)
    yield _case("pair, linear", FAILS, grows, "another guarantee", **REFUTED)


def _good() -> Iterator[Case]:
    for name in (
        "chain",
        "chain, listed",
        "chain, in rounds",
        "chain, by period",
        "chain, every mode",
    ):
        yield _case(name, HOLDS, CHAINED, "true")
    yield _case("chain", HOLDS, moved(CHAINED, 0, 1, 0, "0.5001"), "agent 1 slower")
    # 4 until 1 s: 4 exp(0.1177) = 4.49963, beside 27/8 exp(0.1177) of the second phase.
    for factor, code in ((4.4997, HOLDS), (4.4996, FAILS)):
        yield _case(
            "chain", code, CHAINED | {"factor": factor}, f"a factor of {factor}", factor=factor
        )
    slower = retimed(CHAINED, ["0", "3/2"], B_STARTS, B_ENDS, p=1, rate=0.113)
    slower["rate"] = 0.113
    slower["exact"]["rate"] = "0.113"
    yield _case("chain, uneven", HOLDS, slower, "true")
    # h = y - 2 y^3/25 rises on |y| <= 2.04 only.  At first v_2 falls at 0.88: for s <= 9/10 sup h
    # is h(-0.9) = -0.8417, for s = 1 it is h(-3) = -0.84.
    fast = phase(["0", "1/10", "1"], ["1", "2"], ["19/20", "239/125"], ["1/2", "7/5"])
    yield _case("soft", HOLDS, schedule(box(0.9), 0.35, "9/10", fast, fast), "below where h falls")
    yield _case("soft", FAILS, schedule(box(1), 0.35, "1", fast, fast), "h falls there")
    yield from _in_coordinates()
    yield _case(
        "chain",
        HOLDS,
        bent(
            CHAINED,
            phases=[phase(["0", "1"], doubles(1, 2, 4), A_ENDS), CHAINED["exact"]["phases"][1]],
        ),
        "doubles",
    )
    yield _case("chain", HOLDS, bent(CHAINED, domain=box(9), rho="9"), "in a box")
    yield _case("chain, observed", HOLDS, OBSERVED, "true")
    yield _case("chain, observed", HOLDS, NEAR, "in a box")
    yield _case("pair", HOLDS, CUBIC, "true")
    yield _case("pair, for ever", HOLDS, RESTING, "true")
    yield _case("chain", HOLDS, GRAPHS, "by the graphs")
    yield _case("chain, in rounds", HOLDS, GRAPHS, "by the graphs")
    yield _case("two", HOLDS, GRAPHS, "by the graphs")
    yield _case("three, in turn", HOLDS, GRAPHS, "by the graphs")
    yield _case("pair, for ever", HOLDS, schedule(box(1), None, "1"), "by the graphs")
    yield _case("curved", HOLDS, CURVED, "by the graphs")
    yield _case(
        "sine", HOLDS, bent(CURVED, domain=box(0.7), rho="0.78"), "by the graphs, below pi/2"
    )
    yield _case("curved, observed", HOLDS, SEEN, "by the graphs")


def _bent_weights() -> Iterator[Case]:
    fewer = (
        (0, 1, 0, "0.4999"),
        (0, 1, 1, "1.9999"),
        (0, 1, 2, "2.9999"),
        (0, 0, 2, "4.001"),
        (1, 1, 0, "0.2999"),
    )
    handed = (
        (1, 0, 1, "2.249"),
        (1, 0, 2, "3.374"),
        (0, 1, 1, "2.001"),
        (1, 1, 2, "4"),
        (1, 0, 0, "0.56"),
    )
    for p, k, i, value in (*fewer, (1, 1, 1, "1.2749"), (1, 1, 2, "3.3749"), *handed):
        yield _case(
            "chain",
            FAILS,
            moved(CHAINED, p, k, i, value),
            f"phase {p}, time {k}, agent {i}: {value}",
        )
    yield from _fails(
        "chain",
        CHAINED,
        {"own": "0.1178"},
        {"rate": 0.12},
        {"rate": -0.1},
        {"rate": 0},
        {"own": None},
    )
    yield from _fails(
        "chain", CHAINED, {"own": "0"}, {"own": "-1"}, {"rate": None}, {"domain": box(1)}
    )
    yield from _fails(
        "chain", CHAINED, {"rho": "1"}, {"verdict": "refuted"}, {"phases": []}, {"phases": None}
    )
    yield from _fails(
        "chain", CHAINED, {"phases": CHAINED["exact"]["phases"][:1]}, {"own": "1e300"}
    )
    yield from _fails(
        "chain",
        bent(CHAINED, domain=box(9), rho="9"),
        {"rho": "8.999"},
        {"rho": "-9"},
        {"rho": None},
    )
    yield from _fails(
        "chain", bent(CHAINED, domain=box(9), rho="9"), {"domain": ball(9)}, {"domain": box(1, 0.1)}
    )
    slow: Document = {"own": "0.05", "rate": 0.05}
    for what, times, v in (
        ("before 0", ["-1", "1"], [A_STARTS, A_ENDS]),
        ("at last", ["0", "1", "2"], [A_STARTS, A_ENDS, A_ENDS]),
        ("back", ["0", "1", "1/2", "1"], [A_STARTS, A_ENDS, A_ENDS, A_ENDS]),
        ("twice", ["0", "1", "1"], [A_STARTS, A_ENDS, A_ENDS]),
        ("too early", ["0", "0.99"], [A_STARTS, A_ENDS]),
        ("none", [], []),
        ("three weights", ["0", "1"], [A_STARTS, A_ENDS, A_ENDS]),
        ("one weight", ["0", "1"], [A_STARTS]),
        ("two agents", ["0", "1"], [["1", "2"], ["1/2", "2"]]),
        ("0", ["0", "1"], [["0", "2", "4"], A_ENDS]),
    ):
        yield _case(
            "chain", FAILS, retimed(CHAINED, times, *v, **slow), f"times or weights: {what}"
        )
    long = [f"{k}/2001" for k in range(2001)] + ["1"]
    yield _case("chain", FAILS, retimed(CHAINED, long, *[A_STARTS] * 2001, A_ENDS), "many times")
    yield _case("curved", FAILS, CHAINED, "no rho where couplings are not linear")
    yield _case("list", FAILS, bent(RESTING, rho="9"), "of a list")
    for name in ("chain, any signal", "chain, no guarantee"):
        yield _case(name, FAILS, CHAINED, "weights")
    one = phase(["0", "1"], ["1", "2"], ["1/2", "5/4"])
    ruled: Document = {"rate": 0.499999999, "covered_by": "lemma1"}
    yield _case("one mode", FAILS, schedule(GLOBAL, 0.4, None, one), "no guarantee needed", **ruled)


def _bent_dwell() -> Iterator[Case]:
    yield from _fails(
        "pair", CUBIC, {"own": "0.235"}, {"domain": box(1.001)}, {"rho": "0.999"}, {"rho": "2"}
    )
    yield from _fails(
        "pair", CUBIC, {"phases": [REST, REST]}, {"phases": [BOTH, REST]}, {"phases": [BOTH] * 3}
    )
    for p, k, i, value in (
        (1, 2, 0, "0.2"),
        (1, 2, 1, "0.94"),
        (0, 0, 0, "0.999"),
        (0, 0, 1, "1.99"),
    ):
        yield _case(
            "pair", FAILS, moved(CUBIC, p, k, i, value), f"phase {p}, time {k}, agent {i}: {value}"
        )
    linear = bent(CUBIC, domain=GLOBAL, rho=None)
    yield _case("pair, linear", HOLDS, linear, "true")
    for k, i, value in ((1, 1, "1.2499"), (2, 1, "0.7499"), (1, 0, "0.5003")):
        yield _case(
            "pair, linear", FAILS, moved(linear, 0, k, i, value), f"time {k}, agent {i}: {value}"
        )
    late = phase(["0", "2"], ["1", "2"], ["1/2", "1"])
    yield _case("pair", FAILS, bent(CUBIC, phases=[late, late]), "no weights at the shortest time")
    name = "pair, for ever"
    yield from _fails(name, RESTING, {"own": "0.47"}, {"domain": box(1.001)}, {"rho": "2.1"})
    standing = bent(STANDING, domain=GLOBAL, rho=None)
    yield _case(f"{name}, linear", FAILS, standing, "no fall at rest")
    yield _case(
        name, HOLDS, retimed(bent(STANDING, phases=[BOTH, BOTH]), *_split(BOTH)), "a fall at rest"
    )


def _split(one: Document) -> tuple[Any, ...]:
    return one["times"], *one["v"]


def _bent_observer() -> Iterator[Case]:
    name = "chain, observed"
    sizes: tuple[Document, ...] = (
        {"kappa": "1.77"},
        {"beta": "2.0001"},
        {"size": "0.9999"},
        {"P": [["0.9999"]]},
    )
    yield from _fails(
        name, OBSERVED, *sizes, {"P": [["-1"]]}, {"kappa": "-1.771"}, {"beta": "0.1177"}
    )
    yield from _fails(
        name,
        NEAR,
        *sizes,
        {"rho": "1.8854"},
        {"domain": box(1, 0.501)},
        {"domain": box(1.001, 0.5)},
    )
    yield from _fails(name, NEAR, {"kappa": "1.7711"}, {"rho": "0.1"})
    # Twice negative: an observer whose error grows.
    yield _case("chain, bad W", FAILS, bent(OBSERVED, beta="-1", kappa="-5"), "a negative kappa")
    yield _case(name, FAILS, CHAINED, "no P")
    yield _case("chain", FAILS, OBSERVED, "P without an exosystem")
    name = "curved, observed"
    yield from _fails(
        name, SEEN, {"kappa": "0.4999"}, {"rho": "1.2499"}, {"beta": "1.9999"}, {"beta": "2.0001"}
    )


def _bent_graphs() -> Iterator[Case]:
    yield from _fails(
        "chain", GRAPHS, {"rate": 0.1}, {"domain": box(1)}, {"phases": CHAINED["exact"]["phases"]}
    )
    yield _case("chain, one of two", FAILS, GRAPHS, "one mode over and over")
    for name in ("three", "two, for ever", "chain, any signal"):
        yield _case(name, FAILS, GRAPHS, "not every agent is reached")
    yield _case("outward", FAILS, GRAPHS, "a gain pushes outward")
    yield _case("flat", FAILS, CURVED, "slope 0")
    yield _case("unused", FAILS, GRAPHS, "a coupling that no arc has falls")
    yield _case("sine", FAILS, CURVED, "it falls")
    yield _case("sine", FAILS, bent(CURVED, domain=box(0.7), rho="0.79"), "it falls, at the end")
    yield _case("curved", FAILS, GRAPHS, "no rho")
    yield from _fails(
        "curved",
        CURVED,
        {"domain": box(1.001)},
        {"rho": "0.999"},
        {"own": "0"},
        {"verdict": "refuted"},
    )


def _bent_problems() -> Iterator[Case]:
    """Problem files that the package does not write."""
    times = bent(CHAINED, phases=[phase(["0"], A_STARTS)] * 2)
    for name, change, check in (
        ("chain", {"sequence": ["A", "X"]}, CHAINED),
        ("chain", {"dwell": "0"}, times),
        ("chain", {"dwell": None}, times),
        ("chain, in rounds", {"period": None, "dwell": "1"}, times),
        ("chain, in rounds", {"schedule": [["0", "A"], ["0", "B"]]}, times),
        ("two", {"dwell": "0"}, GRAPHS),
        ("two", {"dwell": None}, GRAPHS),
    ):
        document = json.loads(_FRAMES.problem(name))
        document["switching"] |= change
        yield _case(name, FAILS, check, f"bent problem, {change}", as_written(document))


# From 1 the chain in A, B, A, up to a thousandth: agent 1 halves; agent 2 in B falls by 3/8 (1 - b
# <= 1/4 - b at its end), agent 3 in the second A from 1 to 13/16 (b - 1 >= 5/8 - b).  Then V stays;
# or at 2 s weights take over: N <= 0.626/2, and 4 * 0.313 exp(-0.1177 (t - 3)) is 1/2 at 3 +
# ln(2.504)/0.1177 = 10.798565.
FALLING = ["1", "1", "1"], ["0.501", "1", "1"], ["0.251", "0.626", "1"], ["0.126", "0.626", "0.814"]
STAYS = settling(
    box(1),
    "0.814",
    "3",
    tube(["0", "1", "2", "3"], *FALLING),
    last("schedule", GRAPHS["exact"], "0.814", "1"),
)
GOES_ON = settling(
    box(1),
    "1/2",
    "10.7986",
    tube(["0", "1", "2"], *FALLING[:3]),
    last("schedule", CHAINED["exact"], "0.313", "4"),
)
#: Boxes that stay as they are.
WIDE = settling(
    box(1),
    "9",
    "9",
    tube(["0", "1"], ["1"] * 3, ["1"] * 3),
    last("schedule", CHAINED["exact"], "5/3", "4"),
)


def _settled() -> Iterator[Case]:
    """Settling times under a guarantee."""

    def settled(name: str, code: int, check: Document, what: str) -> Case:
        frame = json.loads(_FRAMES.frame(name))
        kept = {key: frame[key] for key in ("verdict", "rate", "covered_by")}
        return Case(f"{name}: settling, {what}", *certificate(name, check, **kept), code)

    def fails(name: str, check: Document, *changes: Document) -> Iterator[Case]:
        return (
            settled(name, FAILS, changed(check, **each), f"with {str(each)[:60]}")
            for each in changes
        )

    for check in (STAYS, GOES_ON, WIDE):
        yield settled("chain", HOLDS, check, "true")
    for k, i, value in (
        (1, 0, "0.499"),
        (2, 1, "0.624"),
        (3, 2, "0.812"),
        (1, 1, "0.999"),
        (2, 2, "0.999"),
    ):
        yield settled("chain", FAILS, shifted(STAYS, k, i, value), f"time {k}, agent {i}: {value}")
    yield settled("chain, any signal", FAILS, STAYS, "without its guarantee")
    yield settled("two", FAILS, STAYS, "when modes may be on at any time")
    yield from fails(
        "chain",
        STAYS,
        {"level": "0.813"},
        {"height": "0.999"},
        {"tolerance": "0.813"},
        {"stretch": "2"},
    )
    yield from fails(
        "chain",
        STAYS,
        {"time": "2.9"},
        {"rate": "0.1"},
        {"kind": "cycles"},
        {"phases": WIDE["exact"]},
    )
    yield from fails("chain", GOES_ON, {"time": "10.798"}, {"level": "0.312"}, {"height": "3.999"})
    faster = changed(GOES_ON)
    faster["exact"]["last"]["certificate"]["rate"] = "0.1178"
    yield settled("chain", FAILS, faster, "a rate that weights do not have")
    yield from fails(
        "chain", WIDE, {"times": ["0", "2"]}, {"times": ["0", "1/2"]}, {"level": "1.66"}
    )
    at_once = settling(
        box(1), "9", "9", tube(["0"], ["1", "1"]), last("schedule", CUBIC["exact"], "1", "2")
    )
    yield settled("pair", FAILS, at_once, "at the beginning of a phase that is not known")
    near = settling(
        box(1), "1", "1", tube(["0"], ["1"] * 3), last("schedule", CURVED["exact"], "1", "1")
    )
    yield settled("curved", HOLDS, near, "at once")
    yield from fails("curved", near, {"rho": "0.999"}, {"rho": None}, {"level": "1.001"})
