"""Graphs that move or that a Markov chain draws: claims of `safety` and `markov` written by hand
whose truth is known, and twins that just fail."""

import json
from collections.abc import Iterator
from typing import Any

from texts import matrix, vector

from checker_files.files import (
    EACH_OTHER,
    FAILS,
    GONE,
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
from checker_files.separable import REFUTED, agents, ball, box, claim, second_box
from checker_files.switching import Frames
from dobc_design.problem.groups import Observer

GLOBAL = "global"
FRAME = (
    "reachability",
    "lemma1",
    "theorem1",
    "theorem2",
    "observability",
    "detectability",
    "hurwitz",
)


def drawn(*rates: list[int]) -> Document:
    """By a Markov chain with this generator."""
    return {"guarantee": "markov", "generator": list(rates)}


RISING = "exp(y) - 1 + y"
#: Agent 2 hears agent 1 in mode A and nobody in mode B; agent 1 is pinned.
LINK: Document = {
    "network": network({"A": [[2, 1]], "B": []}, agents=2),
    "coupling": "y",
    "gains": {1: 1},
}
WATCHED: Document = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}
SLOW: Document = {"exosystem": scalar(0), "observer": Observer(W=[["3/8"]])}
BOTH = drawn([-1, 1], [1, -1])
STAYS = drawn([0, 0], [1, -1])  # in A
LOST = drawn([-1, 1], [0, 0])  # in B
MOVES: Document = {"signal": "mobile", "radius": 1}
#: Agent 1 is pushed away from agent 2 in mode A: e_1' = e_1/2 - e_2.
PUSHED: Document = {
    "network": network({"A": [[1, 2]], "B": [[2, 1]]}, agents=2),
    "coupling": "-y",
    "gains": {1: "1/2", 2: 3},
}
#: In mode A the agents can rest at -y/2 and y/2 with 2 sin y + y/10 = 0, near y = 3.3.
SECOND: Document = {
    "network": network({"A": EACH_OTHER, "B": [[2, 1]]}, agents=2),
    "coupling": "sin(y)",
    "gains": "1/10",
    "region": {"initial_states": [-5, 5]},
}
PLANE: Document = {"target": [0, 0], "gains": {1: 1, 2: [[1, 2], [-2, 1]]}}
ALL: Document = {"gains": {1: 1, 2: "1/2"}}


ONE_MODE: Document = {"network": network({"A": [[2, 1]]}, agents=2)}
DWELL: Document = {"guarantee": "dwell", "dwell": 1}
LIST: Document = {"coupling": ["y1 + y2", "y2"], "target": [0, 0]}


def link(coupling: str) -> Document:
    return LINK | {"coupling": coupling}


def in_turn(*modes: str) -> Document:
    return {"guarantee": "sequence", "dwell": 1, "sequence": list(modes)}


def _settings() -> dict[str, tuple[Document, Document]]:
    in_a = {"A": [[2, 1]], "B": [[3, 2]], "C": []}
    modes = network(in_a, agents=3)
    three = LINK | {"network": modes}
    made: dict[str, tuple[Document, Document]] = {}
    made["link"] = LINK, BOTH
    made["link, stays"] = LINK, STAYS
    made["link, lost"] = LINK, LOST
    made["link, any signal"] = LINK, {"signal": "markov", "generator": BOTH["generator"]}
    made["link, one mode"] = LINK | ONE_MODE, drawn([0])
    made["link, observed"] = LINK | WATCHED, BOTH
    made["link, slow observer"] = LINK | SLOW, BOTH
    made["link, pi"] = link("pi*y"), BOTH
    made["link, falling"] = link("-y"), BOTH
    made["curved"] = link(RISING), BOTH
    made["curved, stays"] = link(RISING), STAYS
    made["curved, lost"] = link(RISING), LOST
    made["curved, observed"] = link(RISING) | WATCHED, BOTH
    made["flat"] = link("y**3"), BOTH
    made["kinked"] = link("y + abs(y)/2"), BOTH
    made["half"] = link("y + abs(y)"), BOTH
    made["other half"] = link("y - abs(y)"), BOTH
    made["sine"] = link("sin(y)"), BOTH
    made["outward"] = LINK | PLANE, BOTH
    made["list"] = LINK | LIST, BOTH
    first_rates = [-1, 1, 0]
    second_rates = [1, -1, 0]
    rates = drawn(first_rates, second_rates, [1, 1, -2])
    made["two modes of three"] = three, rates
    made["two sets"] = three, drawn([-1, 1, 0], [1, -1, 0], [0, 0, 0])
    made["pushed"] = PUSHED, BOTH
    made["pushed, stays"] = PUSHED, STAYS
    made["pushed, leaves"] = PUSHED, LOST
    made["pushed, dwell"] = PUSHED, DWELL
    made["pushed, not long"] = PUSHED, DWELL | {"longest": 2}
    made["pushed, in turn"] = PUSHED, in_turn("A", "B")
    made["pushed, over and over"] = PUSHED, in_turn("A")
    made["pushed, arbitrary"] = PUSHED, {"guarantee": "arbitrary"}
    made["second, any signal"] = SECOND, {"guarantee": "arbitrary"}
    made["second, in turn"] = SECOND, in_turn("A", "B")
    made["moving"] = LINK, MOVES
    made["moving, falling"] = link("-y"), MOVES
    made["moving, flat"] = link("y**3"), MOVES
    made["moving, half"] = link("y + abs(y)"), MOVES
    made["moving, sine"] = link("sin(y)") | ALL, MOVES
    made["moving, held"] = LINK | ALL, MOVES
    made["moving, one mode"] = link(RISING) | ALL | ONE_MODE, MOVES
    made["moving, observed"] = link(RISING) | WATCHED | ALL, MOVES
    made["moving, outward"] = LINK | PLANE, MOVES
    made["moving, list"] = LINK | LIST, MOVES
    return made


_FRAMES = Frames(_settings(), FRAME)
_FORGER = Forger(_FRAMES.case)
_case = _FRAMES.case
_holds = _FORGER.holds
_fails = _FORGER.fails
_wrong = _FORGER.wrong
_each_wrong = _FORGER.each_wrong


def markov(domain: Any, pace: Any, kind: str, **exact: Any) -> Document:
    return claim("markov", domain, pace, {"kind": kind, **exact})


def safety(domain: Any, rate: Any, rho: str | None, **exact: Any) -> Document:
    own = None if rate is None else str(rate)
    return claim("safety", domain, rate, {"rho": rho, "rate": own, **exact})


def weights(A: str, B: str) -> Document:
    """Of the agents, by mode."""
    return {"A": vector(A), "B": vector(B)}


def forms(A: str, B: str) -> Document:
    """A matrix for every mode."""
    return {"A": matrix(A), "B": matrix(B)}


def entered(check: Document, name: str, mode: str, *places: int, to: str) -> Document:
    """An entry of a vector or matrix of a mode changed."""
    copied = changed(check)
    part = copied["exact"][name][mode]
    for place in places[:-1]:
        part = part[place]
    part[places[-1]] = to
    return copied


# Agent 1: -1 w - w + w' + w_2 (in A), agent 2 in A: -w - w + w', in B: -w + w'. With 8/5, 1 and
# 8/5, 8/5 the rows of agent 1 in A, -3/5 = -3/8 8/5, and of agent 2 in B, 1 - 8/5 = -3/8 8/5, have
# no room.
MEAN = markov(GLOBAL, 0.375, "mean", rate="3/8", w=weights("8/5 1", "8/5 8/5"))
# P = diag(1, 1) and diag(1, 2): in A [[2 r - 2, 1], [1, 2 r - 1]], up to r = 0.19098; in B 2 r - 2
# and 4 r - 1.
FORMS = forms("1 0; 0 1", "1 0; 0 2")
SQUARE = markov(GLOBAL, 0.19, "mean square", rate="0.19", P=FORMS)
SURE = markov(box(1), None, "almost sure", rho="1")
EVERYWHERE = markov(GLOBAL, None, "almost sure", rho=None)
PART: Document = {"P": [["1"]], "beta": "2", "kappa": "1/2", "size": "1"}  # A - W C = -2
# kappa 2 = 1, and 1 + 1/2 1/2 = 5/4.
SEEN = markov(box(1, 0.5), None, "almost sure", rho="5/4", **PART)
APART = claim("markov", GLOBAL, None, {"modes": ["B"]}, verdict="refuted", witness=agents("2"))
SAFE = safety(GLOBAL, None, None)
HELD = safety(GLOBAL, 0.5, None)
NEAR = safety(box(1), 0.5, "1")
# kappa (2 - 1/2) = 1 with kappa = 2/3, and 1 + 2/3 1/2 = 4/3.
FOLLOWED = safety(box(1, 0.5), 0.5, "4/3", **PART | {"kappa": "2/3"})


@collected
def graphs_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    yield from _good()
    yield from _bent_means()
    yield from _bent_squares()
    yield from _bent_sure()
    yield from _bent_apart()
    yield from _bent_safety()
    yield from _unstable()
    yield from _bent_problems()


def _factors() -> Iterator[Case]:
    """P_A = I, and P_B has the eigenvalues 0.9901 and 2.0099: the factor of all pairs is
    sqrt(2.0300) = 1.42479, that beside P_A alone sqrt(2.0099) = 1.41771."""
    both = forms("1 0; 0 1", "1 1/10; 1/10 2")
    for factor, code in ((1.43, HOLDS), (1.42, FAILS)):
        check = changed(SQUARE, P=both, rate=0.1, own="1/10", factor=factor)
        yield _case("link", code, f"a factor of {factor}", check, factor=factor)


def _good() -> Iterator[Case]:
    yield from _factors()
    for name in ("link", "link, observed"):
        yield _holds(name, "in the mean", MEAN)
        yield _holds(name, "in mean square", SQUARE)
    steep = weights("10 1", "10 8/5")
    yield _holds("link, pi", "in the mean", changed(MEAN, rate=0.25, own="1/4", w=steep))
    yield _holds("link, stays", "in the mean", MEAN)
    yield _holds("two modes of three", "almost surely", EVERYWHERE)
    third = changed(APART, modes=["C"], witness=agents("2", "3"))
    yield _holds("two sets", "apart", third, **REFUTED)
    packed = {"A": doubles(1.625, 1), "B": doubles(1.625, 1.625)}
    yield _holds("link", "doubles", changed(MEAN, w=packed))
    for name in ("curved", "curved, stays", "sine", "kinked"):
        yield _holds(name, "almost surely", changed(SURE, domain=box(0.7), rho="0.7"))
    yield _holds("curved, observed", "almost surely", SEEN)
    yield _holds("link", "almost surely", EVERYWHERE)
    yield _holds("link, lost", "apart", APART, **REFUTED)
    yield _holds("curved, lost", "apart", changed(APART, domain="consensus"), **REFUTED)
    for name in ("moving", "moving, held", "link"):
        yield _holds(name, "safe", SAFE)
    yield _holds("moving, flat", "safe", safety(box(1), None, "1"))
    yield _holds("moving, half", "safe", safety(box(1), None, "1"))
    yield _holds("moving, held", "held", HELD)
    yield _holds("moving, one mode", "held", NEAR)
    yield _holds("moving, sine", "below pi/4", changed(NEAR, domain=box(0.78), rho="0.785"))
    yield _holds("moving, observed", "held", FOLLOWED)


def _bent_means() -> Iterator[Case]:
    yield _wrong("link", MEAN, own="0.3751")
    yield from _each_wrong("link", MEAN, rate=[0.3751, 0, None, -0.1])
    yield from _each_wrong("link", MEAN, own=["-3/8", None])
    yield _wrong("link", MEAN, domain=box(1))
    yield _wrong("link", MEAN, kind="median")
    single = {"A": ["8/5"], "B": ["8/5"]}
    yield from _each_wrong("link", MEAN, w=[{"A": vector("8/5 1")}, single, []])
    yield from _each_wrong("link", MEAN, kind=["mean square", "almost sure", None])
    yield _wrong("link", MEAN, verdict="refuted")
    more = MEAN["exact"]["w"] | {"C": vector("1 1")}
    yield _wrong("link", MEAN, w=more)
    yield _mean_with("A", 0, "1.5999")
    yield _mean_with("B", 0, "1.6001")
    yield _mean_with("B", 1, "1.5999")
    yield _mean_with("A", 1, "1.0001")
    yield _mean_with("A", 1, "0")
    negative = entered(MEAN, "w", "A", 1, to="-1")
    yield _fails("link", "below 0", entered(negative, "w", "B", 1, to="-1"))
    yield _fails("link, slow observer", "an observer no faster", MEAN)
    slower = changed(MEAN, rate=0.3749, own="0.3749")
    yield _holds("link, slow observer", "a faster observer", slower)
    for name in ("curved", "link, any signal", "link, one mode", "list"):
        yield _fails(name, "in the mean", MEAN)
    # Without a weight nothing is said of agent 2, and no row asks for one.
    yield _wrong("link", MEAN, "a weight of 0", w=weights("1 0", "1 0"))
    # -y: agent 2 grows in A, unless the sign is overlooked: -w_A2 counts +1.
    yield _fails("link, falling", "falling", MEAN)
    falls = weights("1 1e-9", "1 1")
    yield _wrong("link, falling", MEAN, "falling", w=falls, own="1e-9", rate=1e-10)
    # Agents that push each other apart: with the sign of their slopes every row would hold.
    apart = weights("1 1", "2/5 1/2")
    yield _wrong("pushed", MEAN, "falling", w=apart, own="1e-3", rate=1e-3)


def _mean_with(mode: str, agent: int, to: str) -> Case:
    return _fails("link", f"{mode}, {agent}: {to}", entered(MEAN, "w", mode, agent, to=to))


def _square_with(mode: str, row: int, column: int, to: str) -> Case:
    check = entered(SQUARE, "P", mode, row, column, to=to)
    return _fails("link", f"{mode}: {row}, {column}: {to}", check)


def _bent_squares() -> Iterator[Case]:
    yield _wrong("link, slow observer", SQUARE, "a slower observer", own="3/8")
    yield _square_with("B", 1, 1, "1.6")
    yield _square_with("A", 1, 1, "0.95")
    yield _square_with("A", 0, 0, "0.99")
    yield _square_with("A", 0, 1, "0.001")
    number = "1" + "0" * 5000 + "/" + "1" + "0" * 4999 + "7"
    long = forms(f"1 0; 0 {number}", "1 0; 0 2")
    negative = forms("-1 0; 0 -1", "-1 0; 0 -2")
    yield _wrong("link", SQUARE, own="0.1911")
    yield from _each_wrong("link", SQUARE, P=[negative, long])
    yield _wrong("link", SQUARE, domain=box(1))
    yield _wrong("link", SQUARE, rate=0.2)
    grows = forms("-1 0; 0 -1", "-1 0; 0 -1")
    yield _wrong("pushed", SQUARE, "negative", P=grows, own="1e-3", rate=1e-3)
    yield _wrong("link", SQUARE, "of another kind", kind="median")
    # A saddle in A: [[-1, 1], [1, -6]]; in B [[-3, -1], [-1, -4]].
    saddle = forms("-1 0; 0 1", "1 0; 0 1")
    yield _wrong("pushed, stays", SQUARE, "not positive definite", P=saddle, own="1e-3", rate=1e-3)
    yield _fails("link, any signal", "no guarantee", SQUARE)
    yield _fails("curved", "not linear", SQUARE)


def _bent_sure() -> Iterator[Case]:
    yield from _each_wrong("curved", SURE, rho=["0.999", None])
    yield _wrong("curved", SURE, domain=box(1.001))
    yield _wrong("curved", SURE, rate=0.1)
    yield _wrong("curved", SURE, own="1")
    yield from _each_wrong("curved", SURE, domain=[ball(1), GLOBAL, box(1, 0.1)])
    yield _wrong("curved", SURE, rho="-1")
    yield _wrong("link", EVERYWHERE, domain=box(1))
    yield _wrong("link", EVERYWHERE, rate=0.1)
    yield _fails("curved", "no rho", EVERYWHERE)
    for name in ("curved, lost", "link, any signal", "flat", "half", "other half", "list"):
        yield _fails(name, "almost surely", SURE)
    for name in ("link, lost", "outward", "two sets", "link, falling"):
        yield _fails(name, "almost surely", EVERYWHERE)
    yield _wrong("sine", SURE, "it falls", domain=box(0.7), rho="0.79")
    name = "curved, observed"
    yield _wrong(name, SEEN, kappa="0.4999")
    yield _wrong(name, SEEN, beta="2.0001")
    yield _wrong(name, SEEN, size="0.9999")
    yield _wrong(name, SEEN, P=[["0.9999"]])
    yield _wrong(name, SEEN, kappa="-1/2", beta="-2")
    yield _wrong(name, SEEN, rho="1.2499")
    yield _wrong(name, SEEN, domain=box(1, 0.501))
    yield _wrong(name, SEEN, rho="0.9")
    yield _wrong(name, SEEN, beta="1.9999")
    yield _fails(name, "no P", SURE)
    yield _fails("curved", "P without an exosystem", SEEN)


def _bent_apart() -> Iterator[Case]:
    for modes in (["A"], ["A", "B"], [], ["B", "B"], ["X"]):
        exact = {"modes": modes}
        yield _wrong("link, lost", APART, str(exact), exact=exact, says=REFUTED)
    yield _wrong("link, lost", APART, "{}", exact={}, says=REFUTED)
    for labels in (["1"], ["1", "2"], [], ["2", "2"], ["3"]):
        title = str(labels)
        yield _wrong("link, lost", APART, title, witness=agents(*labels), says=REFUTED)
    vectored = agents("2") | {"kind": "vector"}
    yield _wrong("link, lost", APART, "a vector", witness=vectored, says=REFUTED)
    yield _wrong("link, lost", APART, "no witness", witness=GONE, says=REFUTED)
    yield _wrong("link, lost", APART, rate=0.1)
    yield _wrong("link, lost", APART, domain="consensus")
    yield _wrong("link, lost", APART, verdict="proved")
    for name in ("link", "link, stays", "link, any signal"):
        yield _fails(name, "apart", APART)
    yield _wrong("link", APART, "apart", modes=["A", "B"])
    yield _wrong("link", APART, "none", modes=[], witness=agents("1", "2"))


def _bent_safety() -> Iterator[Case]:
    yield _wrong("moving", SAFE, rate=0.1)
    yield _wrong("moving", SAFE, own="1/2")
    yield _wrong("moving", SAFE, domain=box(1))
    yield _wrong("moving", SAFE, rho="1")
    yield _fails("moving", "agent 2 is not pinned", HELD)
    proof = {"verdict": "proved", "covered_by": "safety", "rate": None}
    yield _fails("moving", "no proof of consensus", SAFE, **proof)
    yield from _each_wrong("moving, held", HELD, own=["0.501", None])
    yield from _each_wrong("moving, held", HELD, rate=[0.501, None, 0])
    yield _wrong("moving, held", HELD, own="-1")
    yield _wrong("moving, held", HELD, verdict="refuted")
    yield from _each_wrong("moving, one mode", NEAR, rho=["0.999", None])
    yield from _each_wrong("moving, one mode", NEAR, domain=[box(1.001), ball(1)])
    yield _wrong("moving, sine", NEAR, "beyond pi/4", domain=box(0.78), rho="0.786")
    name = "moving, observed"
    yield _wrong(name, FOLLOWED, kappa="0.666")
    yield _wrong(name, FOLLOWED, beta="2.0001")
    yield _wrong(name, FOLLOWED, size="0.9999")
    yield _wrong(name, FOLLOWED, P=[["0.9999"]])
    yield _wrong(name, FOLLOWED, kappa="-2/3", beta="-1")
    yield _wrong(name, FOLLOWED, rho="1.333")
    yield _wrong(name, FOLLOWED, domain=box(1, 0.501))
    yield _fails(name, "no P", NEAR)
    yield _fails("moving, falling", "it falls", SAFE)
    yield _fails("moving, outward", "a gain pushes outward", SAFE)
    yield _fails("moving, list", "a list", SAFE)


def _unstable() -> Iterator[Case]:
    """An unstable mode in which no signal may stay refutes nothing, nor does a place of rest."""
    place = second_box()
    place["exact"]["mode"] = "A"
    yield _holds("second, any signal", "another equilibrium", place, **REFUTED)
    yield _fails("second, in turn", "another equilibrium", place, **REFUTED)
    left: Document = {"verdict": "undecided"}
    for name in ("pushed", "pushed, leaves", "pushed, not long", "pushed, in turn"):
        yield _holds(name, "left open", None, **left)
        yield _fails(name, "refuted", None)
    for name in ("pushed, stays", "pushed, dwell", "pushed, over and over", "pushed, arbitrary"):
        yield _holds(name, "refuted", None)
        yield _fails(name, "left open", None, **left)


def _bent_problems() -> Iterator[Case]:
    """Problem files that the package does not write."""
    # Means would decay.
    slow = changed(MEAN, rate=0.001, own="1/1000")
    for rates in (matrix("-1 1; 1/2 -1"), matrix("1 -1; 1 -1"), [["0"]], None):
        document = json.loads(_FRAMES.problem("link"))
        document["switching"]["generator"] = rates
        yield _fails("link", f"bent problem, {rates}", slow, as_written(document))
