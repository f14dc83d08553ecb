"""Signals that keep a guarantee: claims of `schedule` written by hand whose truth is known, and
twins that just fail.

Few segments, so that every row can be worked out on paper: of a linear one both ends of a segment
decide.
"""

import json
from collections.abc import Iterator
from typing import Any

from texts import matrix, ranges, vector

from checker_files.files import (
    FAILS,
    HOLDS,
    Case,
    Document,
    Forger,
    as_written,
    changed,
    collected,
    doubles,
    network,
    scalar,
)
from checker_files.graphs import FRAME
from checker_files.separable import REFUTED, agents, ball, box, claim
from checker_files.settling import bent as resettled
from checker_files.settling import last, settling, tube
from checker_files.settling import moved as shifted
from checker_files.switching import Frames
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


FOR_LONG: Document = DWELL | {"longest": 2}
LONG_TURNS: Document = TURNS | {"dwell": 3}


def chain(coupling: Any) -> Document:
    return CHAIN | {"coupling": coupling}


def pair(coupling: Any) -> Document:
    return PAIR | {"coupling": coupling}


def by(*sequence: str) -> Document:
    """These modes, one after the other."""
    return TURNS | {"sequence": list(sequence)}


def _settings() -> dict[str, tuple[Document, Document]]:
    """Small problems, and their [switching]."""
    turned_gain = [[1, 2], [-2, 1]]
    gains = {1: 1, 2: turned_gain}
    plane: Document = {"target": [0, 0], "gains": gains}
    one = {"A": [[2, 1]]}
    one_network = network(one, agents=2)
    one_mode = CHAIN | {"network": one_network}
    random: Document = {"signal": "random", "dwell": 1}
    three = CHAIN | {"network": THREE}
    exceptions = {(1, 0): "y", (2, 1): "y"}
    falling = chain("-y") | {"exceptions": exceptions}
    made: dict[str, tuple[Document, Document]] = {}
    made["chain"] = CHAIN, TURNS
    made["chain, listed"] = CHAIN, TURNS | {"dwell": [1, 1]}
    made["chain, in rounds"] = CHAIN, UNEVEN
    made["chain, by period"] = CHAIN, TURNS | {"dwell": None, "period": 2}
    made["chain, every mode"] = CHAIN, TURNS | {"sequence": None}
    made["chain, any signal"] = CHAIN, random | {"guarantee": "arbitrary"}
    made["chain, no guarantee"] = CHAIN, random
    made["chain, one of two"] = CHAIN, by("A")
    made["one mode"] = one_mode, by("A")
    made["chain, observed"] = CHAIN | WATCHED, TURNS
    bad_observer = {"observer": Observer(W=[[-1]])}
    made["chain, bad W"] = CHAIN | WATCHED | bad_observer, TURNS
    made["pair"] = PAIR, FOR_LONG
    made["pair, linear"] = pair("y"), FOR_LONG
    made["pair, for ever"] = PAIR, DWELL
    made["pair, for ever, linear"] = pair("y"), DWELL
    made["curved"] = chain(PAPER), TURNS
    made["curved, observed"] = chain(PAPER) | WATCHED, TURNS
    made["sine"] = chain("sin(y)"), TURNS
    made["chain, uneven"] = CHAIN, UNEVEN | {"period": "5/2"}
    made["soft"] = pair("y - 2*y**3/25"), DWELL
    made["flat"] = chain("y**3"), TURNS
    made["unused"] = falling, TURNS
    made["three"] = three, FOR_LONG
    made["three, in turn"] = three, by("A", "C", "B")
    made["two"] = CHAIN, FOR_LONG
    made["two, for ever"] = CHAIN, DWELL
    made["grows"] = GROWS, LONG_TURNS
    made["grows, watched"] = GROWS | WATCHED, LONG_TURNS
    made["grows, loose"] = GROWS | {"network": LOOSE}, LONG_TURNS
    made["grows, not"] = GROWS | {"gains": "11/10"}, LONG_TURNS
    made["grows, curved"] = GROWS | {"coupling": "-y - y**3"}, LONG_TURNS
    # 1 and 2 oppose each other by one sign, which balances nothing; 3 and 4 keep their state.
    opposed = {"A": [[1, 2], [3, 4]], "B": [[2, 1, -1], [4, 3]]}
    signed = Network.from_arcs(opposed, arrow="listens_to", agents=4, negative="opposes")
    made["opposed"] = {"network": signed, "coupling": "y", "gains": {3: 1}}, TURNS
    made["opposed, loose"] = {"network": signed, "coupling": "y"}, TURNS
    made["outward"] = pair("y") | plane, DWELL
    two_components = pair(["y1 + y2", "y2"])
    target = {"target": [0, 0]}
    made["list"] = two_components | target, DWELL
    return made


_FRAMES = Frames(_settings(), (*FRAME, "linearisation"))
_FORGER = Forger(_FRAMES.case)
certificate = _FRAMES.certificate
_case = _FRAMES.case
_holds = _FORGER.holds
_fails = _FORGER.fails
_wrong = _FORGER.wrong
_each_wrong = _FORGER.each_wrong


def schedule(domain: Any, rate: Any, rho: str | None, *phases: Document) -> Document:
    own = None if rate is None else str(rate)
    exact = {"rate": own, "rho": rho, "phases": list(phases)}
    return claim("schedule", domain, rate, exact)


def phase(times: str, v: str) -> Document:
    return {"times": vector(times), "v": matrix(v)}


def turned(check: Document, T: str = "2", low: str = "1", high: str = "1", **more: Any) -> Document:
    """In coordinates z = T e; a coupling has gains between ``low`` and ``high``."""
    own = {"T": matrix(T), "ranges": ranges(f"{low} {high}")}
    return check | {"exact": check["exact"] | own | more}


def _in_coordinates() -> Iterator[Case]:
    """With z = 2 e the same weights hold, a box of e is half as wide, and P is four times as
    large."""
    error = {"P": [["4"]], "size": "4"}
    seen = OBSERVED | {"exact": OBSERVED["exact"] | error}
    yield _holds("chain", "in coordinates", turned(CHAINED))
    yield _holds("chain", "in coordinates, in a box", turned(changed(BOXED, rho="18")))
    yield _fails("chain", "in coordinates, the box leaves the region", turned(BOXED))
    yield _holds("chain, observed", "in coordinates, observed", turned(seen))
    yield _fails("chain, observed", "in coordinates, P of e", turned(OBSERVED))
    yield _holds("chain, listed", "gains a little wider", turned(CHAINED, low="0.99995", high="2"))
    yield _fails("chain", "gains wider than the rows bear", turned(CHAINED, low="0.99"))
    yield _fails("chain", "gains that it does not have", turned(CHAINED, low="1.01", high="1.01"))
    yield _fails("chain", "no gains", turned(CHAINED, ranges=[]))
    yield _fails("chain", "T is singular", turned(CHAINED, T="0"))
    yield _fails("chain", "T of another size", turned(CHAINED, T="1 0; 0 1"))
    yield _fails("chain", "T without weights", turned(GRAPHS))
    yield _fails("list", "a list by its first expression", turned(GRAPHS, T="1 0; 0 1"))
    yield _turned_with(0, 1, 0, "0.4999")
    yield _turned_with(0, 1, 2, "2.9999")
    yield _turned_with(1, 1, 1, "1.2749")
    yield _turned_with(1, 0, 2, "3.374")
    rests = turned(changed(STANDING, domain=GLOBAL, rho=None), "1")
    yield _fails("pair, for ever, linear", "in coordinates, a phase that stands", rests)
    resting = turned(changed(RESTING, domain=GLOBAL, rho=None), "1")
    yield _holds("pair, for ever, linear", "in coordinates, a phase that rests", resting)


def _turned_with(p: int, k: int, i: int, value: str) -> Case:
    check = turned(moved(CHAINED, p, k, i, value))
    return _fails("chain", f"turned {p}, {k}, {i}: {value}", check)


def _with(name: str, check: Document, p: int, k: int, i: int, value: str) -> Case:
    title = f"phase {p}, time {k}, agent {i}: {value}"
    return _fails(name, title, moved(check, p, k, i, value))


def moved(check: Document, p: int, k: int, i: int, value: str) -> Document:
    """The weight of agent i at the k-th time of phase p changed."""
    copied = changed(check)
    copied["exact"]["phases"][p]["v"][k][i] = value
    return copied


def retimed(
    check: Document, times: list[str], *v: list[str], p: int = 0, **changes: Any
) -> Document:
    """Phase p replaced."""
    copied = changed(check, **changes)
    copied["exact"]["phases"][p] = {"times": times, "v": list(v)}
    return copied


# h = y, k_1 = 1. Where an agent hears nobody it stays; agent 1: b - a >= -b, so that it halves;
# agent 3 in A: b_3 - a_3 >= b_2 - b_3, so that (2, 4) falls to 3; agent 2 in B: 9/4 falls to (0.3 +
# 9/4)/2. 2 and 3 are handed over to 9/4 and 27/8: exp(rate) = 9/8, the rate 0.117783; up to some
# ten thousandths.
FIRST = phase("0 1", "1 2 4; 0.5001 2.0001 3.0001")
SECOND = phase("0 1", "3/5 9/4 27/8; 0.3001 1.2752 3.3751")
A_STARTS, A_ENDS = FIRST["v"]
B_STARTS, B_ENDS = SECOND["v"]
CHAINED = schedule(GLOBAL, 0.1177, None, FIRST, SECOND)
BOXED = changed(CHAINED, domain=box(9), rho="9")
# A - W C = -2: beta = 2; kappa (2 - 0.1177) 0.3001 >= 1 from 1.7703 on. From 1 and 1/2: 1 + 1.771/2
# = 1.8855.
PART: Document = {"P": [["1"]], "beta": "2", "kappa": "1.771", "size": "1"}
OBSERVED = changed(CHAINED, **PART)
NEAR = changed(OBSERVED, domain=box(1, 0.5), rho="1.8855")
# y + y^3, k_1 = 5, rho = 1. Agent 2 hears agent 1: -(v_2 - v_1) as s goes to 0, so that 2, 5/4, 3/4
# beside 1, 1/2, 1/4. Agent 1 in B: d + d^3 - k_1 v_1 with d = v_2 - v_1: -3, -1.328, and -0.625 at
# the end, where it falls by 1/4. 5/4 is handed over until 2 s: 2 exp(-2 rate).
BOTH = phase("0 1 2", "1 2; 1/2 1.2501; 1/4 0.7502")
CUBIC = schedule(box(1), 0.2349, "1", BOTH, BOTH)
# Without an end: 5/4 <= 2 exp(-rate), and (1/2, 5/4) falls at 3/5 at rest.
REST = phase("0 1", "1 2; 1/2 1.2501")
RESTING = schedule(box(1), 0.4699, "1", REST, REST)
# Agent 2 does not fall at rest beside an agent 1 as far away; everything else holds up to ln(4/3)/3
# = 0.0958.
LEVEL = phase("0 1 2 3", "1 2; 1/2 1.2501; 1/4 0.7502; 0.7502 0.7502")
STANDING = schedule(box(1), 0.05, "1", LEVEL, LEVEL)
GRAPHS = schedule(GLOBAL, None, None)
CURVED = schedule(box(1), None, "1")
# kappa 2 >= 1, and 1 + 1/2 * 1/2 = 5/4.
SEEN = changed(CURVED, domain=box(1, 0.5), rho="5/4", **PART | {"kappa": "1/2"})


@collected
def cycles_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    yield from _good()
    yield from _bent_weights()
    yield from _bent_times()
    yield from _bent_dwell()
    yield from _bent_observer()
    yield from _bent_graphs()
    yield from _bent_problems()
    yield from _growing()
    yield from _settled()


def _growing() -> Iterator[Case]:
    """tr M = exp(3) + exp(-3) = 20.14 > 2; with gains of 11/10 the spectral radius of M is 0.99."""
    grows = claim("schedule", GLOBAL, None, {"power": "1"}, verdict="refuted")
    yield _holds("grows", "errors grow", grows, **REFUTED)
    yield _holds("grows", "errors grow", changed(grows, power="64"), **REFUTED)
    yield _holds("grows, watched", "errors grow", grows, **REFUTED)
    yield _fails("grows, loose", "an arc that comes and goes", grows, **REFUTED)
    yield _fails("grows, not", "they do not grow", grows, **REFUTED)
    for power in ("2/2", "1.0", "1e0"):
        yield _holds("grows", f"power {power} is 1", changed(grows, power=power), **REFUTED)
    for power in ("0", "-1", "3/2", "65"):
        yield _wrong("grows", grows, f"power {power}", power=power, says=REFUTED)
    yield _wrong("grows", grows, "a witness", witness=agents("1"), says=REFUTED)
    yield _wrong("grows", grows, "a rate", rate=0.1, says=REFUTED)
    yield _wrong("grows, curved", grows, "a curve", domain="consensus", says=REFUTED)
    yield _fails("chain", "a chain that decays", grows, **REFUTED)
    yield _fails("pair, linear", "another guarantee", grows, **REFUTED)


def _good() -> Iterator[Case]:
    for how in ("", ", listed", ", in rounds", ", by period", ", every mode"):
        yield _holds(f"chain{how}", "true", CHAINED)
    yield _holds("chain", "agent 1 slower", moved(CHAINED, 0, 1, 0, "0.5001"))
    # 4 until 1 s: 4 exp(0.1177) = 4.49963, beside 27/8 exp(0.1177) of the second phase.
    for factor, code in ((4.4997, HOLDS), (4.4996, FAILS)):
        check = changed(CHAINED, factor=factor)
        yield _case("chain", code, f"a factor of {factor}", check, factor=factor)
    slower = retimed(CHAINED, vector("0 3/2"), B_STARTS, B_ENDS, p=1, rate=0.113, own="0.113")
    yield _holds("chain, uneven", "true", slower)
    # h = y - 2 y^3/25 rises on |y| <= 2.04 only.  At first v_2 falls at 0.88: for s <= 9/10 sup h
    # is h(-0.9) = -0.8417, for s = 1 it is h(-3) = -0.84.
    fast = phase("0 1/10 1", "1 2; 19/20 239/125; 1/2 7/5")
    yield _holds("soft", "below where h falls", schedule(box(0.9), 0.35, "9/10", fast, fast))
    yield _fails("soft", "h falls there", schedule(box(1), 0.35, "1", fast, fast))
    yield from _in_coordinates()
    packed = retimed(CHAINED, vector("0 1"), doubles(1, 2, 4), A_ENDS)
    yield _holds("chain", "doubles", packed)
    yield _holds("chain", "in a box", BOXED)
    yield _holds("chain, observed", "true", OBSERVED)
    yield _holds("chain, observed", "in a box", NEAR)
    yield _holds("pair", "true", CUBIC)
    yield _holds("pair, for ever", "true", RESTING)
    yield _holds("chain", "by the graphs", GRAPHS)
    yield _holds("chain, in rounds", "by the graphs", GRAPHS)
    yield _holds("two", "by the graphs", GRAPHS)
    yield _holds("opposed", "by the double cover", GRAPHS)
    yield _holds("three, in turn", "by the graphs", GRAPHS)
    yield _holds("pair, for ever", "by the graphs", schedule(box(1), None, "1"))
    yield _holds("curved", "by the graphs", CURVED)
    yield _holds("sine", "by the graphs, below pi/2", changed(CURVED, domain=box(0.7), rho="0.78"))
    yield _holds("curved, observed", "by the graphs", SEEN)


def _bent_weights() -> Iterator[Case]:
    yield _with("chain", CHAINED, 0, 1, 0, "0.4999")
    yield _with("chain", CHAINED, 0, 1, 1, "1.9999")
    yield _with("chain", CHAINED, 0, 1, 2, "2.9999")
    yield _with("chain", CHAINED, 0, 0, 2, "4.001")
    yield _with("chain", CHAINED, 1, 1, 0, "0.2999")
    yield _with("chain", CHAINED, 1, 1, 1, "1.2749")
    yield _with("chain", CHAINED, 1, 1, 2, "3.3749")
    # What is handed over.
    yield _with("chain", CHAINED, 1, 0, 1, "2.249")
    yield _with("chain", CHAINED, 1, 0, 2, "3.374")
    yield _with("chain", CHAINED, 0, 1, 1, "2.001")
    yield _with("chain", CHAINED, 1, 1, 2, "4")
    yield _with("chain", CHAINED, 1, 0, 0, "0.56")
    yield from _each_wrong("chain", CHAINED, own=["0.1178", None])
    yield from _each_wrong("chain", CHAINED, rate=[0.12, -0.1, 0])
    yield from _each_wrong("chain", CHAINED, own=["0", "-1"])
    yield _wrong("chain", CHAINED, rate=None)
    yield _wrong("chain", CHAINED, domain=box(1))
    yield _wrong("chain", CHAINED, rho="1")
    yield _wrong("chain", CHAINED, verdict="refuted")
    yield from _each_wrong("chain", CHAINED, phases=[[], None])
    yield _wrong("chain", CHAINED, phases=CHAINED["exact"]["phases"][:1])
    yield _wrong("chain", CHAINED, own="1e300")
    yield from _each_wrong("chain", BOXED, rho=["8.999", "-9", None])
    yield from _each_wrong("chain", BOXED, domain=[ball(9), box(1, 0.1)])
    yield _fails("curved", "no rho where couplings are not linear", CHAINED)
    yield _wrong("list", RESTING, "of a list", rho="9")
    for name in ("chain, any signal", "chain, no guarantee"):
        yield _fails(name, "weights", CHAINED)
    one = phase("0 1", "1 2; 1/2 5/4")
    ruled: Document = {"rate": 0.499999999, "covered_by": "lemma1"}
    yield _fails("one mode", "no guarantee needed", schedule(GLOBAL, 0.4, None, one), **ruled)


def _bent_times() -> Iterator[Case]:
    def times(what: str, times: str, *v: Any) -> Case:
        check = retimed(CHAINED, vector(times), *v, own="0.05", rate=0.05)
        return _fails("chain", f"times or weights: {what}", check)

    yield times("before 0", "-1 1", A_STARTS, A_ENDS)
    yield times("at last", "0 1 2", A_STARTS, A_ENDS, A_ENDS)
    yield times("back", "0 1 1/2 1", A_STARTS, A_ENDS, A_ENDS, A_ENDS)
    yield times("twice", "0 1 1", A_STARTS, A_ENDS, A_ENDS)
    yield times("too early", "0 0.99", A_STARTS, A_ENDS)
    yield times("none", "")
    yield times("three weights", "0 1", A_STARTS, A_ENDS, A_ENDS)
    yield times("one weight", "0 1", A_STARTS)
    yield times("two agents", "0 1", vector("1 2"), vector("1/2 2"))
    yield times("0", "0 1", vector("0 2 4"), A_ENDS)
    long = [f"{k}/2001" for k in range(2001)]
    many = retimed(CHAINED, [*long, "1"], *[A_STARTS] * 2001, A_ENDS)
    yield _fails("chain", "many times", many)


def _bent_dwell() -> Iterator[Case]:
    yield _wrong("pair", CUBIC, own="0.235")
    yield _wrong("pair", CUBIC, domain=box(1.001))
    yield from _each_wrong("pair", CUBIC, rho=["0.999", "2"])
    yield from _each_wrong("pair", CUBIC, phases=[[REST, REST], [BOTH, REST], [BOTH] * 3])
    yield _with("pair", CUBIC, 1, 2, 0, "0.2")
    yield _with("pair", CUBIC, 1, 2, 1, "0.94")
    yield _with("pair", CUBIC, 0, 0, 0, "0.999")
    yield _with("pair", CUBIC, 0, 0, 1, "1.99")
    linear = changed(CUBIC, domain=GLOBAL, rho=None)
    yield _holds("pair, linear", "true", linear)
    lower_first = (1, 1, "1.2499")
    lower_second = (2, 1, "0.7499")
    for k, i, value in (lower_first, lower_second, (1, 0, "0.5003")):
        check = moved(linear, 0, k, i, value)
        yield _fails("pair, linear", f"time {k}, agent {i}: {value}", check)
    late = phase("0 2", "1 2; 1/2 1")
    yield _wrong("pair", CUBIC, "no weights at the shortest time", phases=[late, late])
    name = "pair, for ever"
    yield _wrong(name, RESTING, own="0.47")
    yield _wrong(name, RESTING, domain=box(1.001))
    yield _wrong(name, RESTING, rho="2.1")
    standing = changed(STANDING, domain=GLOBAL, rho=None)
    yield _fails(f"{name}, linear", "no fall at rest", standing)
    yield _holds(name, "a fall at rest", changed(STANDING, phases=[BOTH, BOTH]))


def _bent_observer() -> Iterator[Case]:
    name = "chain, observed"
    for check in (OBSERVED, NEAR):
        yield _wrong(name, check, kappa="1.77")
        yield _wrong(name, check, beta="2.0001")
        yield _wrong(name, check, size="0.9999")
        yield _wrong(name, check, P=[["0.9999"]])
    yield _wrong(name, OBSERVED, P=[["-1"]])
    yield _wrong(name, OBSERVED, kappa="-1.771")
    yield _wrong(name, OBSERVED, beta="0.1177")
    yield _wrong(name, NEAR, rho="1.8854")
    yield from _each_wrong(name, NEAR, domain=[box(1, 0.501), box(1.001, 0.5)])
    yield _wrong(name, NEAR, kappa="1.7711")
    yield _wrong(name, NEAR, rho="0.1")
    # Twice negative: an observer whose error grows.
    yield _wrong("chain, bad W", OBSERVED, "a negative kappa", beta="-1", kappa="-5")
    yield _fails(name, "no P", CHAINED)
    yield _fails("chain", "P without an exosystem", OBSERVED)
    name = "curved, observed"
    yield _wrong(name, SEEN, kappa="0.4999")
    yield _wrong(name, SEEN, rho="1.2499")
    yield from _each_wrong(name, SEEN, beta=["1.9999", "2.0001"])


def _bent_graphs() -> Iterator[Case]:
    yield _wrong("chain", GRAPHS, rate=0.1)
    yield _wrong("chain", GRAPHS, domain=box(1))
    yield _wrong("chain", GRAPHS, phases=CHAINED["exact"]["phases"])
    yield _fails("chain, one of two", "one mode over and over", GRAPHS)
    for name in ("three", "two, for ever", "chain, any signal"):
        yield _fails(name, "not every agent is reached", GRAPHS)
    yield _fails("opposed, loose", "a set with signs that balance", GRAPHS)
    yield _fails("outward", "a gain pushes outward", GRAPHS)
    yield _fails("flat", "slope 0", CURVED)
    yield _fails("unused", "a coupling that no arc has falls", GRAPHS)
    yield _fails("sine", "it falls", CURVED)
    yield _wrong("sine", CURVED, "it falls, at the end", domain=box(0.7), rho="0.79")
    yield _fails("curved", "no rho", GRAPHS)
    yield _wrong("curved", CURVED, domain=box(1.001))
    yield _wrong("curved", CURVED, rho="0.999")
    yield _wrong("curved", CURVED, own="0")
    yield _wrong("curved", CURVED, verdict="refuted")


def _bent_problems() -> Iterator[Case]:
    """Problem files that the package does not write."""
    start = {"times": ["0"], "v": [A_STARTS]}
    times = changed(CHAINED, phases=[start, start])
    yield _switching("chain", CHAINED, sequence=["A", "X"])
    yield _switching("chain", times, dwell="0")
    yield _switching("chain", times, dwell=None)
    yield _switching("chain, in rounds", times, period=None, dwell="1")
    at_once = [["0", "A"], ["0", "B"]]
    yield _switching("chain, in rounds", times, schedule=at_once)
    yield _switching("two", GRAPHS, dwell="0")
    yield _switching("two", GRAPHS, dwell=None)


def _switching(name: str, check: Document, **changes: Any) -> Case:
    """The claim beside a problem with another [switching]."""
    document = json.loads(_FRAMES.problem(name))
    document["switching"] |= changes
    return _fails(name, f"bent problem, {changes}", check, as_written(document))


# From 1 the chain in A, B, A, up to a thousandth: agent 1 halves; agent 2 in B falls by 3/8 (1 - b
# <= 1/4 - b at its end), agent 3 in the second A from 1 to 13/16 (b - 1 >= 5/8 - b).  Then V stays;
# or at 2 s weights take over: N <= 0.626/2, and 4 * 0.313 exp(-0.1177 (t - 3)) is 1/2 at 3 +
# ln(2.504)/0.1177 = 10.798565.
FALLING = "1 1 1; 0.501 1 1; 0.251 0.626 1"
FALLEN = tube("0 1 2 3", f"{FALLING}; 0.126 0.626 0.814")
KEPT = last("schedule", GRAPHS["exact"], "0.814", "1")
STAYS = settling(box(1), "0.814", "3", FALLEN, KEPT)
DECAYING = last("schedule", CHAINED["exact"], "0.313", "4")
GOES_ON = settling(box(1), "1/2", "10.7986", tube("0 1 2", FALLING), DECAYING)
#: Boxes that stay as they are.
EVEN = last("schedule", CHAINED["exact"], "5/3", "4")
WIDE = settling(box(1), "9", "9", tube("0 1", "1 1 1; 1 1 1"), EVEN)


def _settled() -> Iterator[Case]:
    """Settling times under a guarantee."""

    def settled(name: str, code: int, what: str, check: Document) -> Case:
        frame = json.loads(_FRAMES.frame(name))
        kept = {key: frame[key] for key in ("verdict", "rate", "covered_by")}
        return Case(f"{name}: settling, {what}", *certificate(name, check, **kept), code)

    forger = Forger(settled, resettled)
    holds = forger.holds
    fails = forger.fails
    wrong = forger.wrong
    each_wrong = forger.each_wrong
    for check in (STAYS, GOES_ON, WIDE):
        yield holds("chain", "true", check)
    first_place = (1, 0, "0.499")
    second_place = (2, 1, "0.624")
    for k, i, value in (first_place, second_place, (3, 2, "0.812")):
        yield fails("chain", f"time {k}, agent {i}: {value}", shifted(STAYS, k, i, value))
    for k in (1, 2):
        yield fails("chain", f"time {k}, agent {k}: 0.999", shifted(STAYS, k, k, "0.999"))
    yield fails("chain, any signal", "without its guarantee", STAYS)
    yield fails("two", "when modes may be on at any time", STAYS)
    yield wrong("chain", STAYS, level="0.813")
    yield wrong("chain", STAYS, height="0.999")
    yield wrong("chain", STAYS, tolerance="0.813")
    yield wrong("chain", STAYS, stretch="2")
    yield wrong("chain", STAYS, time="2.9")
    yield wrong("chain", STAYS, rate="0.1")
    yield wrong("chain", STAYS, kind="cycles")
    yield wrong("chain", STAYS, phases=WIDE["exact"])
    yield wrong("chain", GOES_ON, time="10.798")
    yield wrong("chain", GOES_ON, level="0.312")
    yield wrong("chain", GOES_ON, height="3.999")
    faster = resettled(GOES_ON)
    faster["exact"]["last"]["certificate"]["rate"] = "0.1178"
    yield fails("chain", "a rate that weights do not have", faster)
    yield from each_wrong("chain", WIDE, times=[vector("0 2"), vector("0 1/2")])
    yield wrong("chain", WIDE, level="1.66")
    start = tube("0", "1 1")
    last_part = last("schedule", CUBIC["exact"], "1", "2")
    at_once = settling(box(1), "9", "9", start, last_part)
    yield fails("pair", "at the beginning of a phase that is not known", at_once)
    start = tube("0", "1 1 1")
    near = settling(box(1), "1", "1", start, last("schedule", CURVED["exact"], "1", "1"))
    yield holds("curved", "at once", near)
    yield from each_wrong("curved", near, rho=["0.999", None])
    yield wrong("curved", near, level="1.001")
