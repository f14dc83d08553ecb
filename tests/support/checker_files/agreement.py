"""Agents that agree on a value that nobody prescribes: claims about pairs of agents, and about the
others of a root, written by hand whose truth is known, and twins that just fail.

Pairs are in the order (1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2).
"""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from texts import matrix, vector

from checker_files.files import (
    EACH_OTHER,
    FAILS,
    GONE,
    HOLDS,
    UNREADABLE,
    Case,
    Document,
    Forger,
    about,
    bend,
    changed,
    collected,
    network,
    scalar,
)
from checker_files.graphs import FRAME
from checker_files.separable import GLOBAL, REFUTED, UNDECIDED, agents, box, claim, weights
from checker_files.settling import last, settling, tube
from checker_files.switching import unweighted
from dobc_design import Network, Problem, Switching
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.groups import Observer

OPEN: Document = UNDECIDED | {"factor": None}
RISING = "exp(y) - 1 + y"
RING = network([[1, 2], [2, 3], [3, 1]])
ALL = network([[i, j] for i in (1, 2, 3) for j in (1, 2, 3) if i != j])
CHAIN = network([[2, 1], [3, 2]])  # agent 1 hears nobody
MIDDLE = network([[1, 2], [3, 1]])  # agent 2 hears nobody
APART = network([[2, 1], [1, 2], [4, 3]])
MODES = network({"A": [[1, 2]], "B": [[2, 3]], "C": [[3, 1]]}, agents=3)
LOST = network({"A": [[1, 2], [2, 1]], "B": [[1, 3]]}, agents=4)
GROWING = network({"A": [[2, 1]], "B": [[3, 2]]}, agents=3)
#: Of more agents than pairs are looked at; all but 1 and 2 hear agent 1, these two each other.
MANY = {
    "A": [[1, 2], *([i, 1] for i in range(2, 151))],
    "B": [[1, 2], *([i, 1] for i in range(151, 302))],
}
#: Nobody hears both 1 and 151.
TWO_HEARD = {
    "A": [[i, 1] for i in range(2, 151)],
    "B": [[i, 151] for i in range(152, 302)],
}
ISOLATED = network({"A": [], "B": []}, agents=3)
DRAWN = network({"A": [[2, 1]], "B": []}, agents=2)
LOOSE = Network.from_arcs(
    {"G": [[1, 2], [2, 1], [3, 1], [3, 2]]},
    optional={"G": [[1, 3], [2, 3]]},
    arrow="listens_to",
    agents=3,
)
AT_TIMES = Network.from_arcs(
    {"G": [[1, 2], [2, 1], [2, 3], [3, 1]]},
    optional={"G": [[1, 3]]},
    arrow="listens_to",
    agents=3,
)
WATCHED: Document = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}  # A - W C = -2
IN_TURN: Document = {"guarantee": "sequence", "dwell": 3}


def drawn(*rates: list[int]) -> Switching:
    """By a Markov chain with this generator."""
    return Switching(guarantee="markov", generator=list(rates))


def by_itself(a: Any) -> Document:
    return {"dynamics": Dynamics(A=[[a]], B=[[1]])}


def between(*sides: Any) -> Document:
    """The region."""
    return {"region": {"initial_states": list(sides)}}


def _settings() -> dict[str, Document]:
    slower: Document = {"exceptions": {(1, 2): "2*y/2"}}
    wide: Document = {"coupling": "tanh(y)"} | between(-1, 1)
    ring_of_sines: Document = {"network": RING, "coupling": "sin(y)"} | between("-1/2", "1/2")
    pair: Document = {"network": network(EACH_OTHER)}
    some = Dynamics(A=matrix("-1 0; 0 1"), B=matrix("1 0; 0 1"))
    flat = between([-1, 1], [0, 0])
    alone: Document = {"network": network([], agents=2)}
    turns = Switching(**IN_TURN)
    made: dict[str, Document] = {}
    made["ring"] = {"network": RING}
    made["ring, rising"] = {"network": RING, "coupling": RISING} | between(-1, 1)
    made["ring, wider"] = {"network": RING, "coupling": RISING} | between(-1, "1.1")
    made["ring, formed"] = ring_of_sines | {"offsets": {1: 1}}
    made["ring, watched"] = {"network": RING} | WATCHED
    made["all"] = {"network": ALL}
    made["all, uncertain"] = {"network": ALL, "uncertainty": {"weights": "1/10"}}
    made["all, two functions"] = {"network": ALL} | slower
    made["all, loose"] = {"network": LOOSE}
    made["all, heavier"] = {"network": network([[1, 3], [2, 3, 2], [3, 1]])}
    made["all, a little heavier"] = {"network": network([[1, 3], [2, 3, "3/2"], [3, 1]], agents=3)}
    made["all, rising"] = {"network": ALL} | wide
    made["heard at times"] = {"network": AT_TIMES}
    made["pair, rising"] = pair | {"coupling": RISING} | between(-1, 1)
    made["chain"] = {"network": CHAIN}
    made["chain, tanh"] = {"network": CHAIN} | wide
    made["chain, watched"] = {"network": CHAIN} | WATCHED
    made["middle"] = {"network": MIDDLE}
    made["apart"] = {"network": APART}
    made["apart, one point"] = {"network": APART} | between(1, 1)
    made["apart, wide"] = {"network": APART} | between(2, 3)
    made["unstable"] = pair | {"coupling": "-y"}
    made["unstable, elsewhere"] = pair | {"coupling": "-y"} | between(2, 3)
    made["unstable, one point"] = pair | {"coupling": "-y"} | between(2, 2)
    made["moving"] = pair | {"coupling": "3*y"} | by_itself(1)
    made["moving, ring"] = {"network": RING, "coupling": "3*y"} | by_itself(1)
    made["moving, led"] = {"network": CHAIN, "coupling": "3*y"} | by_itself(1)
    made["still"] = pair | by_itself(-1)
    made["alone, falling"] = alone | by_itself(-1)
    made["alone, growing"] = alone | by_itself(1)
    made["alone, some"] = alone | {"dynamics": some, "target": [0, 0]} | flat
    made["modes"] = {"network": MODES, "switching": turns}
    made["modes, lost"] = {"network": LOST, "switching": turns}
    made["growing, led"] = {"network": GROWING, "coupling": "-y", "switching": turns}
    made["drawn"] = {"network": DRAWN, "switching": drawn([-1, 1], [1, -1])}
    made["drawn, lost"] = {"network": DRAWN, "switching": drawn([-1, 1], [0, 0])}
    made["many"] = {"network": network(MANY, agents=301), "switching": turns}
    made["many, apart"] = {"network": network(TWO_HEARD, agents=301), "switching": turns}
    isolated = network({"A": [], "B": []}, agents=301)
    made["many, falling"] = {"network": isolated, "switching": turns} | by_itself(-1)
    made["few, falling"] = {"network": ISOLATED, "switching": turns} | by_itself(-1)
    made["growing, pairs"] = {"network": MODES, "coupling": "-y", "switching": turns}
    return {name: {"coupling": "y", "goal": "agreement"} | own for name, own in made.items()}


@cache
def problem(name: str) -> Problem:
    return Problem(**_settings()[name])


@cache
def _frame(name: str) -> str:
    """What is found without regions."""
    document = json.loads(certificate_bytes(unweighted(problem(name))))
    document["checks"] = [each for each in document["checks"] if each["id"] in FRAME]
    if document["verdict"] == "proved":
        document |= OPEN
    return json.dumps(document)


def certificate(name: str, *checks: Document, **overall: Any) -> Document:
    """With these checks; the first one decides, if it is proved."""
    document: Document = json.loads(_frame(name))
    document["checks"] += checks
    if checks and checks[0]["verdict"] == "proved":
        first = checks[0]
        decides = {"rate": first["rate"], "covered_by": first["id"], "verdict": "proved"}
        document |= decides | {"factor": first.get("factor")}
    bend(document, overall)
    return document


def case(name: str, code: int, what: str, *checks: Document, **overall: Any) -> Case:
    document = json.loads(canonical_bytes(problem(name)))
    made = certificate(name, *checks, **overall)
    return about(document, made, name=f"agreement, {name}: {what}", code=code)


_FORGER = Forger(case)
_holds = _FORGER.holds
_fails = _FORGER.fails
_wrong = _FORGER.wrong
_each_wrong = _FORGER.each_wrong


def rows(
    rate: Any, v: str, factor: float = 1, domain: Any = GLOBAL, rho: str | None = None, **more: Any
) -> Document:
    """A max-separable whose alpha is its rate."""
    exact = weights(v, str(rate), rho, **more)
    return claim("max-separable", domain, rate, exact, factor=factor)


ONES = "1 1 1 1 1 1"
# Pair (1, 2): agent 1 hears agent 2, a pin, and agent 2 hears agent 3, (1, 3).  All six alike.
RINGED = rows(1, ONES)
# h(-s)/s = -(1 + (1 - e^-s)/s), largest at s = 2: -1.432332
CURVED = rows(1.4323, ONES, domain=box(2), rho="2")
# 2 C: P >= 4; min(alpha, beta - 1/(kappa min v)) = min(1, 2 - 1).
PART: Document = {"P": [["4"]], "beta": "2", "kappa": "1", "size": "4"}
SEEN = rows(1, ONES, **PART)
# Agents 2 and 3 of the chain: -1 and (1 - 2)/2.
LED = rows(0.5, "1 2", 2)
LED_SEEN = rows(0.5, "1 2", 2, **PART)
SAMPLED = claim("sampling", GLOBAL, None, {"period": "1/2", "factor": "1/2"})
LATE = claim("delay", GLOBAL, 0.1, {"delay": "1/100", "rate": "1/10"})
BY_GRAPHS = claim("schedule", GLOBAL, None, {"rate": None, "rho": None, "phases": []})
GROWS = claim("schedule", GLOBAL, None, {"power": "1"}, verdict="refuted")
LINEAR = claim("linearisation", GLOBAL, 1.49, None)
ROOTS = claim("linearisation", GLOBAL, None, {"unstable_roots": "1"}, verdict="refuted")
SAFE = claim("safety", GLOBAL, None, {"rho": None, "rate": None})


def full(rate: Any) -> Document:
    """Of three agents that all hear each other."""
    return rows(rate, ONES)


@collected
def agreement_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    yield from _good()
    yield from _bent_rows()
    yield from _bent_shares()
    yield from _bent_frames()
    yield from _bent_dynamics()
    yield from _bent_others()
    yield from _bent_problems()
    yield from _of_many()


def _of_many() -> Iterator[Case]:
    """Graphs of 301 agents alone are looked at; frames are those of three, but for the agents."""
    # exp(-3/10) = 0.7408
    phase = {"times": ["0", "3"], "v": [["1"] * 301, ["0.74"] * 301]}
    falls = claim("schedule", GLOBAL, 0.1, {"rate": "1/10", "rho": None, "phases": [phase, phase]})
    holds = {"A": ["1", "2", *_labels(151, 302)], "B": _labels(2, 151)}
    yield _many("many", HOLDS, BY_GRAPHS, holds)
    fails = {"A": ["1", *_labels(151, 302)], "B": _labels(1, 152)}
    yield _many("many, apart", FAILS, BY_GRAPHS, fails)
    # It is true: every agent decays alone.
    yield _many("many, falling", FAILS, falls, dict.fromkeys("AB", _labels(1, 302)))


def _labels(first: int, end: int) -> list[str]:
    return [str(label) for label in range(first, end)]


def _many(name: str, code: int, check: Document, closed: dict[str, list[str]]) -> Case:
    """``closed``: by mode the agents of smallest sets that hear nobody outside."""
    made = certificate("few, falling", check)
    for each in made["checks"]:
        if each["id"] == "reachability":
            each["witness"] = agents(*closed[each["mode"]])
    document = json.loads(canonical_bytes(problem(name)))
    return about(document, made, name=f"agreement, {name}", code=code)


def _good() -> Iterator[Case]:
    yield _holds("ring", "rows", RINGED)
    yield _holds("ring", "held", RINGED, SAMPLED)
    yield _holds("ring", "eigenvalues", LINEAR)
    yield _holds("ring, rising", "rows", CURVED)
    yield _holds("ring, watched", "rows", SEEN)
    yield _holds("all", "matched", full(3))
    yield _holds("chain", "led", LED)
    yield _holds("chain, watched", "led", LED_SEEN)
    yield _holds("middle", "led", LED)
    for name in ("apart", "apart, wide"):
        yield _holds(name, "stay apart", **REFUTED)
    yield _holds("apart, one point", "open", **UNDECIDED)
    for name in ("unstable", "unstable, elsewhere"):
        yield _holds(name, "roots", ROOTS, **REFUTED)
    yield _holds("unstable, one point", "roots", ROOTS, **UNDECIDED)
    yield _holds("moving", "rows", rows(5, "1 1"))
    yield _holds("moving", "open", **UNDECIDED)
    # -3 + 1, and 3 (1 - 2)/2 + 1
    yield _holds("moving, led", "rows", rows(0.5, "1 2", 2))
    yield _holds("alone, falling", "rows", rows(1, "1 1"))
    yield _holds("alone, falling", "open", **UNDECIDED)
    yield _holds("alone, growing", "stay apart", **REFUTED)
    yield _holds("alone, some", "open", **UNDECIDED)
    yield _holds("modes", "by graphs", BY_GRAPHS)
    yield _holds("growing, led", "grows", GROWS, **REFUTED)


def _bent_rows() -> Iterator[Case]:
    for more in ({"alpha": "1.001", "rate": 1.001}, {"v": vector("1 1 1 1 1 99/100")}):
        yield _wrong("ring", RINGED, **more)
    yield from _each_wrong("ring", RINGED, v=[vector("1 1 1"), vector("1 1 1 1 1")])
    yield _wrong("ring, rising", CURVED, alpha="1.4324", rate=1.4324)
    yield _wrong("ring, rising", CURVED, domain=box(2.1), rho="2.1")
    # (2, 1) hears (3, 1), and (1, 2) hears (1, 3)
    for v in ("1 1 1 1 2 1", "1 2 1 1 1 1"):
        yield _wrong("ring", RINGED, v=vector(v), factor=2)
    # not the whole region
    yield _wrong("ring, wider", CURVED)
    sines = rows(0.66, ONES, domain=box(1.5), rho="1.5")
    yield _wrong("ring, formed", sines, "the offset is forgotten")
    yield _holds("ring, formed", "open", sines, **OPEN)
    for name, check in (("ring, watched", SEEN), ("chain, watched", LED_SEEN)):
        yield from _each_wrong(name, check, P=[[["1"]], [["399/100"]]])
        yield _wrong(name, check, size="399/100")
        yield _wrong(name, check, beta="2.01")
    yield _wrong("chain", LED, alpha="0.501", rate=0.501)
    yield _wrong("chain", LED, v=vector("2 1"))
    yield _wrong("chain", LED, v=vector("1 2 3"))
    yield _wrong("middle", LED, v=vector("2 1"))


def _bent_shares() -> Iterator[Case]:
    """What both hear of the third is w (x_3 - x_1) - w (x_3 - x_2) = -w (x_1 - x_2)."""
    yield _fails("all", "more than matched", full(3.001))
    # What is shared counts whatever the weights are.
    yield _holds("all", "uneven", rows(3, "1 2 2 2 2 2", 2))
    yield _holds("all, uncertain", "apart", full(2), **OPEN)
    yield _fails("all, uncertain", "matched", full(2.001), **OPEN)
    for dw, code in (("0", HOLDS), ("1/100", FAILS)):
        errors = {"weights": dw, "gains": "1/100", "alpha": "2", "v": vector(ONES)}
        off = claim("tolerance", GLOBAL, 2, errors, factor=1)
        yield case("all", code, f"off by {dw}", full(3), off)
    # Agents 1 and 2 hear each other always and agent 3 at times: the latter is not matched.
    for name in ("all, two functions", "all, loose"):
        yield _holds(name, "apart", full(2))
        yield _fails(name, "matched", full(2.001))
    # 2 tanh(2)/2 = 0.964, and not 3 of them
    once = rows(0.96, ONES, domain=box(2), rho="2")
    yield _holds("all, rising", "apart", once)
    yield _wrong("all, rising", once, "matched", alpha="1.2", rate=1.2)
    # Pair (1, 2) falls at 2, less v_32 - v_12 while agent 1 hears agent 3, and less v_13 - v_12.
    at_times = rows(0.8, "1 1 1 6/5 1 6/5", factor=1.2)
    yield _holds("heard at times", "rows", at_times)
    low = vector("1/2 1 1/2 6/5 1 6/5")
    yield _wrong("heard at times", at_times, "an arc is forgotten", v=low, factor=2.4)
    # h(-s) + h*(-s) = h(-s) - h(s): -(2 s + 2 sinh s), 4 s at least.
    both = rows(3.99, "1 1", domain=box(2), rho="2")
    yield _holds("pair, rising", "rows", both)
    yield _wrong("pair, rising", both, alpha="4.01", rate=4.01)
    # Of the weights 1 and 2 the lesser is shared: pairs (1, 2) and (2, 1) have 1, and 1 is left.
    large = rows(2, "2 1 2 1 1 1", 2)
    yield _holds("all, loose", "uneven", large)
    yield _wrong("all, loose", large, alpha="2.5", rate=2.5)
    # 1/2 is left of 3/2: v_12 falls at 1, less (v_13 - v_12)/2.
    half_left = rows(0.5, "1 2 1 1 2 1", 2)
    yield _holds("all, a little heavier", "rows", half_left)
    yield _wrong("all, a little heavier", half_left, alpha="0.6", rate=0.6)
    yield _holds("all, heavier", "rows", full(1))
    yield _fails("all, heavier", "too fast", full(1.001))


def _bent_frames() -> Iterator[Case]:
    """Who hears nobody, and what follows."""
    document: Document = json.loads(_frame("apart"))
    found = next(each for each in document["checks"] if each["id"] == "reachability")
    checks = [each for each in document["checks"] if each is not found]
    for labels in (("1", "2"), ("1", "2", "4"), ("3",), ("1", "2", "3", "4")):
        bent = [*checks, changed(found, witness=agents(*labels))]
        yield _fails("apart", f"closed are {labels}", checks=bent)
    proved = [*checks, changed(found, verdict="proved", witness=GONE)]
    yield _fails("apart", "no closed set", checks=proved)
    yield _fails("apart", "open", **UNDECIDED)
    for name in ("apart, one point", "ring", "moving", "alone, falling", "alone, some"):
        yield _fails(name, "refuted", **REFUTED)
    yield _fails("unstable, one point", "refuted", ROOTS, **REFUTED)
    for id in ("lemma1", "theorem1-weighted"):
        yield _about_a_target(id)


def _about_a_target(id: str) -> Case:
    """Claims that are true of the errors from any target where they are."""
    name = "still"
    document: Document = json.loads(_frame(name))
    checks = [each for each in document["checks"] if each["id"] != id]
    exact: Document | None = None
    if id != "lemma1":
        exact = {"D": vector("1 1"), "w": {next(iter(problem(name).network.modes)): vector("1 1")}}
    check = claim(id, GLOBAL, 0.5, exact)
    if id == "lemma1":
        check |= {"mode": next(iter(problem(name).network.modes)), "margin": 0}
    decides = {"verdict": "proved", "rate": 0.5, "covered_by": id}
    return _fails(name, id, checks=[*checks, check], **decides)


def _bent_dynamics() -> Iterator[Case]:
    for rate in (5.001, 6):
        yield _fails("moving", f"at {rate}", rows(rate, "1 1"))
    # Of the first three pairs -2.25 and more, of the last ones -1.7, -2 and -1.4.
    uneven = rows(1.4, "6/5 11/10 11/10 1 1 1", 1.2)
    yield _holds("moving, ring", "rows", uneven)
    yield _wrong("moving, ring", uneven, alpha="2", rate=2)
    led = rows(0.501, "1 2", 2)
    yield _fails("moving, led", "too fast", led)
    falling = rows(1.001, "1 1")
    yield _fails("alone, falling", "too fast", falling)


def _bent_others() -> Iterator[Case]:
    for rate in (1.5, 1.51):
        yield _fails("ring", f"eigenvalues at {rate}", changed(LINEAR, rate=rate))
    yield _wrong("ring", SAMPLED, beside=[RINGED], period="0.501", factor="0.501")
    yield _fails("ring", "late", RINGED, LATE)
    yield _fails("chain", "late", LED, LATE)
    yield _fails("chain", "safe", LED, SAFE)
    yield _fails("modes, lost", "by graphs", BY_GRAPHS)
    yield _fails("growing, pairs", "grows", GROWS, **REFUTED)
    surely = claim("markov", GLOBAL, None, {"kind": "almost sure", "rho": None})
    yield _holds("drawn", "almost surely", surely)
    yield _fails("drawn, lost", "almost surely", surely)
    # Both are true: of differences they are not known.
    apart = claim("markov", GLOBAL, None, {"modes": ["B"]}, verdict="refuted", witness=agents("2"))
    yield _fails("drawn, lost", "apart", apart, **REFUTED)
    own = {"A": vector("1"), "B": vector("6/5")}
    mean = claim("markov", GLOBAL, 0.1, {"kind": "mean", "rate": "1/10", "w": own})
    yield _fails("drawn", "in the mean", mean)
    quadratic: Document = {
        "method": "lure",
        "P_e": [[0, 0, "1"], [1, 1, "4"]],
        "level": None,
        "radius": None,
        "ranges": [{"coupling": 0, "gains": [[["1", "1"]]]}],
        "multipliers": {"G": ["0", "0"]},
        "rate": "1/10",
    }
    held = settling(box(1), "1", "9", tube("0", "1 1"), last("quadratic", quadratic, "3", "1"))
    yield _fails("chain", "a form takes over", LED, held)
    own = last("max-separable", LED["exact"], "1", "2")
    waits = settling(box(1), "1/10", "7", tube("0", "1 1"), own)
    yield _holds("chain", "settles", LED, waits)
    yield _fails("chain", "settles too early", LED, changed(waits, time="5"))


def _bent_problems() -> Iterator[Case]:
    """Problem files that the package does not write."""
    document = json.loads(canonical_bytes(problem("ring")))
    made = certificate("ring", RINGED)
    arc = document["modes"][0]
    pinned = arc | {"gains": [[0, [["1"]]]]}
    bent: dict[str, Document] = {}
    bent["pins"] = {"gains": [[0, [["1"]]]]}
    bent["pins of a mode"] = {"modes": [pinned]}
    bent["a target"] = {"target": ["1"]}
    bent["another goal"] = {"goal": "disagreement"}
    bent["an f"] = {"dynamics": {"f": ["0*x"], "B": [["1"]]}}
    bent["a leader"] = {
        "dynamics": {"A": [["0"]], "B": [["1"]]},
        "leader": {"initial": [["0", "0"]]},
    }
    for name, changes in bent.items():
        title = f"agreement: {name}"
        yield about(document | changes, made, name=title, code=UNREADABLE)
    one = {"labels": ["1"], "modes": [arc | {"arcs": []}]}
    yield about(document | one, made, name="agreement: one agent", code=UNREADABLE)
