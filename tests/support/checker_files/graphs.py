"""Graphs that move or that a Markov chain draws: claims of `safety` and `markov` written by hand
whose truth is known, and twins that just fail."""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from checker_files.files import (
    EACH_OTHER,
    FAILS,
    HOLDS,
    Case,
    Document,
    as_written,
    network,
    scalar,
)
from checker_files.separable import REFUTED, ball, box, claim, doubles, second_box
from checker_files.switching import Frames, bent
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
RISING = "exp(y) - 1 + y"
#: Agent 2 hears agent 1 in mode A and nobody in mode B; agent 1 is pinned.
LINK: Document = {
    "network": network({"A": [[2, 1]], "B": []}, agents=2),
    "coupling": "y",
    "gains": {1: 1},
}
WATCHED: Document = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}
SLOW: Document = {"exosystem": scalar(0), "observer": Observer(W=[["3/8"]])}
BOTH: Document = {"guarantee": "markov", "generator": [[-1, 1], [1, -1]]}
STAYS: Document = {"guarantee": "markov", "generator": [[0, 0], [1, -1]]}  # in A
LOST: Document = {"guarantee": "markov", "generator": [[-1, 1], [0, 0]]}  # in B
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


def _settings() -> dict[str, tuple[Document, Document]]:
    three = network({"A": [[2, 1]], "B": [[3, 2]], "C": []}, agents=3)
    return {
        "link": (LINK, BOTH),
        "link, stays": (LINK, STAYS),
        "link, lost": (LINK, LOST),
        "link, any signal": (LINK, {"signal": "markov", "generator": [[-1, 1], [1, -1]]}),
        "link, one mode": (
            LINK | {"network": network({"A": [[2, 1]]}, agents=2)},
            BOTH | {"generator": [[0]]},
        ),
        "link, observed": (LINK | WATCHED, BOTH),
        "link, slow observer": (LINK | SLOW, BOTH),
        "link, pi": (LINK | {"coupling": "pi*y"}, BOTH),
        "link, falling": (LINK | {"coupling": "-y"}, BOTH),
        "curved": (LINK | {"coupling": RISING}, BOTH),
        "curved, stays": (LINK | {"coupling": RISING}, STAYS),
        "curved, lost": (LINK | {"coupling": RISING}, LOST),
        "curved, observed": (LINK | {"coupling": RISING} | WATCHED, BOTH),
        "flat": (LINK | {"coupling": "y**3"}, BOTH),
        "kinked": (LINK | {"coupling": "y + abs(y)/2"}, BOTH),
        "half": (LINK | {"coupling": "y + abs(y)"}, BOTH),
        "other half": (LINK | {"coupling": "y - abs(y)"}, BOTH),
        "sine": (LINK | {"coupling": "sin(y)"}, BOTH),
        "outward": (LINK | PLANE, BOTH),
        "list": (LINK | {"coupling": ["y1 + y2", "y2"], "target": [0, 0]}, BOTH),
        "two modes of three": (
            LINK | {"network": three},
            BOTH | {"generator": [[-1, 1, 0], [1, -1, 0], [1, 1, -2]]},
        ),
        "two sets": (
            LINK | {"network": three},
            BOTH | {"generator": [[-1, 1, 0], [1, -1, 0], [0, 0, 0]]},
        ),
        "pushed": (PUSHED, BOTH),
        "pushed, stays": (PUSHED, STAYS),
        "pushed, leaves": (PUSHED, LOST),
        "pushed, dwell": (PUSHED, {"guarantee": "dwell", "dwell": 1}),
        "pushed, not long": (PUSHED, {"guarantee": "dwell", "dwell": 1, "longest": 2}),
        "pushed, in turn": (PUSHED, {"guarantee": "sequence", "dwell": 1, "sequence": ["A", "B"]}),
        "pushed, over and over": (PUSHED, {"guarantee": "sequence", "dwell": 1, "sequence": ["A"]}),
        "pushed, arbitrary": (PUSHED, {"guarantee": "arbitrary"}),
        "second, any signal": (SECOND, {"guarantee": "arbitrary"}),
        "second, in turn": (SECOND, {"guarantee": "sequence", "dwell": 1, "sequence": ["A", "B"]}),
        "moving": (LINK, MOVES),
        "moving, falling": (LINK | {"coupling": "-y"}, MOVES),
        "moving, flat": (LINK | {"coupling": "y**3"}, MOVES),
        "moving, half": (LINK | {"coupling": "y + abs(y)"}, MOVES),
        "moving, sine": (LINK | {"coupling": "sin(y)"} | ALL, MOVES),
        "moving, held": (LINK | ALL, MOVES),
        "moving, one mode": (
            LINK | ALL | {"network": network({"A": [[2, 1]]}, agents=2), "coupling": RISING},
            MOVES,
        ),
        "moving, observed": (LINK | {"coupling": RISING} | WATCHED | ALL, MOVES),
        "moving, outward": (LINK | PLANE, MOVES),
        "moving, list": (LINK | {"coupling": ["y1 + y2", "y2"], "target": [0, 0]}, MOVES),
    }


_FRAMES = Frames(_settings(), FRAME)
_case, _fails = _FRAMES.case, _FRAMES.fails


def markov(domain: Any, pace: Any, kind: str, **exact: Any) -> Document:
    return claim("markov", domain, pace, {"kind": kind, **exact})


def safety(domain: Any, rate: Any, rho: str | None, **exact: Any) -> Document:
    own = None if rate is None else str(rate)
    return claim("safety", domain, rate, {"rho": rho, "rate": own, **exact})


def entered(check: Document, name: str, mode: str, *places: int, to: str) -> Document:
    """An entry of a vector or matrix of a mode changed."""
    copied = bent(check)
    part = copied["exact"][name][mode]
    for place in places[:-1]:
        part = part[place]
    part[places[-1]] = to
    return copied


# Agent 1: -1 w - w + w' + w_2 (in A), agent 2 in A: -w - w + w', in B: -w + w'. With 8/5, 1 and
# 8/5, 8/5 the rows of agent 1 in A, -3/5 = -3/8 8/5, and of agent 2 in B, 1 - 8/5 = -3/8 8/5, have
# no room.
MEAN = markov(GLOBAL, 0.375, "mean", rate="3/8", w={"A": ["8/5", "1"], "B": ["8/5", "8/5"]})
# P = diag(1, 1) and diag(1, 2): in A [[2 r - 2, 1], [1, 2 r - 1]], up to r = 0.19098; in B 2 r - 2
# and 4 r - 1.
SQUARE = markov(
    GLOBAL,
    0.19,
    "mean square",
    rate="0.19",
    P={"A": [["1", "0"], ["0", "1"]], "B": [["1", "0"], ["0", "2"]]},
)
SURE = markov(box(1), None, "almost sure", rho="1")
EVERYWHERE = markov(GLOBAL, None, "almost sure", rho=None)
PART: Document = {"P": [["1"]], "beta": "2", "kappa": "1/2", "size": "1"}  # A - W C = -2
# kappa 2 = 1, and 1 + 1/2 1/2 = 5/4.
SEEN = markov(box(1, 0.5), None, "almost sure", rho="5/4", **PART)
APART = claim("markov", GLOBAL, None, {"modes": ["B"]}, verdict="refuted") | {
    "witness": {"kind": "agents", "labels": ["2"]}
}
SAFE = safety(GLOBAL, None, None)
HELD = safety(GLOBAL, 0.5, None)
NEAR = safety(box(1), 0.5, "1")
# kappa (2 - 1/2) = 1 with kappa = 2/3, and 1 + 2/3 1/2 = 4/3.
FOLLOWED = safety(box(1, 0.5), 0.5, "4/3", **PART | {"kappa": "2/3"})


@cache
def graphs_cases() -> list[Case]:
    """All of them, the good ones first."""
    return [
        *_good(),
        *_bent_means(),
        *_bent_sure(),
        *_bent_apart(),
        *_bent_safety(),
        *_unstable(),
        *_bent_problems(),
    ]


def _factors() -> Iterator[Case]:
    """P_A = I, and P_B has the eigenvalues 0.9901 and 2.0099: the factor of all pairs is
    sqrt(2.0300) = 1.42479, that beside P_A alone sqrt(2.0099) = 1.41771."""
    forms = {"A": [["1", "0"], ["0", "1"]], "B": [["1", "1/10"], ["1/10", "2"]]}
    for factor, code in ((1.43, HOLDS), (1.42, FAILS)):
        check = bent(SQUARE, P=forms, rate=0.1, own="1/10") | {"factor": factor}
        yield _case("link", code, check, f"a factor of {factor}", factor=factor)


def _good() -> Iterator[Case]:
    yield from _factors()
    for name in ("link", "link, observed"):
        yield _case(name, HOLDS, MEAN, "in the mean")
        yield _case(name, HOLDS, SQUARE, "in mean square")
    steep: Document = {"A": ["10", "1"], "B": ["10", "8/5"]}
    yield _case("link, pi", HOLDS, bent(MEAN, rate=0.25, own="1/4", w=steep), "in the mean")
    yield _case("link, stays", HOLDS, MEAN, "in the mean")
    yield _case("two modes of three", HOLDS, EVERYWHERE, "almost surely")
    third: Document = {
        "exact": {"modes": ["C"]},
        "witness": {"kind": "agents", "labels": ["2", "3"]},
    }
    yield _case("two sets", HOLDS, APART | third, "apart", **REFUTED)
    yield _case(
        "link", HOLDS, bent(MEAN, w={"A": doubles(1.625, 1), "B": doubles(1.625, 1.625)}), "doubles"
    )
    for name in ("curved", "curved, stays", "sine", "kinked"):
        yield _case(name, HOLDS, bent(SURE, domain=box(0.7), rho="0.7"), "almost surely")
    yield _case("curved, observed", HOLDS, SEEN, "almost surely")
    yield _case("link", HOLDS, EVERYWHERE, "almost surely")
    yield _case("link, lost", HOLDS, APART, "apart", **REFUTED)
    yield _case("curved, lost", HOLDS, bent(APART, domain="consensus"), "apart", **REFUTED)
    for name in ("moving", "moving, held", "link"):
        yield _case(name, HOLDS, SAFE, "safe")
    yield _case("moving, flat", HOLDS, safety(box(1), None, "1"), "safe")
    yield _case("moving, half", HOLDS, safety(box(1), None, "1"), "safe")
    yield _case("moving, held", HOLDS, HELD, "held")
    yield _case("moving, one mode", HOLDS, NEAR, "held")
    yield _case("moving, sine", HOLDS, bent(NEAR, domain=box(0.78), rho="0.785"), "below pi/4")
    yield _case("moving, observed", HOLDS, FOLLOWED, "held")


def _bent_means() -> Iterator[Case]:
    yield from _fails(
        "link",
        MEAN,
        {"own": "0.3751"},
        {"rate": 0.3751},
        {"rate": 0},
        {"rate": None},
        {"rate": -0.1},
    )
    yield from _fails(
        "link", MEAN, {"own": "-3/8"}, {"own": None}, {"domain": box(1)}, {"kind": "median"}
    )
    yield from _fails(
        "link", MEAN, {"w": {"A": ["8/5", "1"]}}, {"w": {"A": ["8/5"], "B": ["8/5"]}}, {"w": []}
    )
    yield from _fails(
        "link",
        MEAN,
        {"kind": "mean square"},
        {"kind": "almost sure"},
        {"kind": None},
        {"verdict": "refuted"},
    )
    yield from _fails("link", MEAN, {"w": {**MEAN["exact"]["w"], "C": ["1", "1"]}})
    for mode, place, to in (
        ("A", 0, "1.5999"),
        ("B", 0, "1.6001"),
        ("B", 1, "1.5999"),
        ("A", 1, "1.0001"),
        ("A", 1, "0"),
    ):
        yield _case("link", FAILS, entered(MEAN, "w", mode, place, to=to), f"{mode}, {place}: {to}")
    yield _case(
        "link", FAILS, entered(entered(MEAN, "w", "A", 1, to="-1"), "w", "B", 1, to="-1"), "below 0"
    )
    yield _case("link, slow observer", FAILS, MEAN, "an observer no faster")
    yield _case(
        "link, slow observer", HOLDS, bent(MEAN, rate=0.3749, own="0.3749"), "a faster observer"
    )
    yield _case("link, slow observer", FAILS, bent(SQUARE, own="3/8"), "a slower observer")
    for name in ("curved", "link, any signal", "link, one mode", "list"):
        yield _case(name, FAILS, MEAN, "in the mean")
    # Without a weight nothing is said of agent 2, and no row asks for one.
    yield _case("link", FAILS, bent(MEAN, w={"A": ["1", "0"], "B": ["1", "0"]}), "a weight of 0")
    # -y: agent 2 grows in A, unless the sign is overlooked: -w_A2 counts +1.
    yield _case("link, falling", FAILS, MEAN, "falling")
    falls: Document = {"A": ["1", "1e-9"], "B": ["1", "1"]}
    yield _case("link, falling", FAILS, bent(MEAN, w=falls, own="1e-9", rate=1e-10), "falling")
    for mode, row, column, to in (
        ("B", 1, 1, "1.6"),
        ("A", 1, 1, "0.95"),
        ("A", 0, 0, "0.99"),
        ("A", 0, 1, "0.001"),
    ):
        yield _case(
            "link",
            FAILS,
            entered(SQUARE, "P", mode, row, column, to=to),
            f"{mode}: {row}, {column}: {to}",
        )
    negative = {"A": [["-1", "0"], ["0", "-1"]], "B": [["-1", "0"], ["0", "-2"]]}
    long = {
        **SQUARE["exact"]["P"],
        "A": [["1", "0"], ["0", "1" + "0" * 5000 + "/" + "1" + "0" * 4999 + "7"]],
    }
    yield from _fails(
        "link",
        SQUARE,
        {"own": "0.1911"},
        {"P": negative},
        {"domain": box(1)},
        {"rate": 0.2},
        {"P": long},
    )
    grows = {"A": [["-1", "0"], ["0", "-1"]], "B": [["-1", "0"], ["0", "-1"]]}
    yield _case("pushed", FAILS, bent(SQUARE, P=grows, own="1e-3", rate=1e-3), "negative")
    yield _case("link", FAILS, bent(SQUARE, kind="median"), "of another kind")
    # A saddle in A: [[-1, 1], [1, -6]]; in B [[-3, -1], [-1, -4]].
    saddle = {"A": [["-1", "0"], ["0", "1"]], "B": [["1", "0"], ["0", "1"]]}
    yield _case(
        "pushed, stays",
        FAILS,
        bent(SQUARE, P=saddle, own="1e-3", rate=1e-3),
        "not positive definite",
    )
    # Agents that push each other apart: with the sign of their slopes every row would hold.
    apart: Document = {"A": ["1", "1"], "B": ["2/5", "1/2"]}
    yield _case("pushed", FAILS, bent(MEAN, w=apart, own="1e-3", rate=1e-3), "falling")
    yield _case("link, any signal", FAILS, SQUARE, "no guarantee")
    yield _case("curved", FAILS, SQUARE, "not linear")


def _bent_sure() -> Iterator[Case]:
    yield from _fails(
        "curved",
        SURE,
        {"rho": "0.999"},
        {"domain": box(1.001)},
        {"rho": None},
        {"rate": 0.1},
        {"own": "1"},
    )
    yield from _fails(
        "curved",
        SURE,
        {"domain": ball(1)},
        {"domain": GLOBAL},
        {"rho": "-1"},
        {"domain": box(1, 0.1)},
    )
    yield from _fails("link", EVERYWHERE, {"domain": box(1)}, {"rate": 0.1})
    yield _case("curved", FAILS, EVERYWHERE, "no rho")
    for name in ("curved, lost", "link, any signal", "flat", "half", "other half", "list"):
        yield _case(name, FAILS, SURE, "almost surely")
    for name in ("link, lost", "outward", "two sets", "link, falling"):
        yield _case(name, FAILS, EVERYWHERE, "almost surely")
    yield _case("sine", FAILS, bent(SURE, domain=box(0.7), rho="0.79"), "it falls")
    name = "curved, observed"
    sizes: tuple[Document, ...] = (
        {"kappa": "0.4999"},
        {"beta": "2.0001"},
        {"size": "0.9999"},
        {"P": [["0.9999"]]},
    )
    yield from _fails(
        name,
        SEEN,
        *sizes,
        {"kappa": "-1/2", "beta": "-2"},
        {"rho": "1.2499"},
        {"domain": box(1, 0.501)},
    )
    yield from _fails(name, SEEN, {"rho": "0.9"}, {"beta": "1.9999"})
    yield _case(name, FAILS, SURE, "no P")
    yield _case("curved", FAILS, SEEN, "P without an exosystem")


def _bent_apart() -> Iterator[Case]:
    for exact in (
        {"modes": ["A"]},
        {"modes": ["A", "B"]},
        {"modes": []},
        {"modes": ["B", "B"]},
        {"modes": ["X"]},
        {},
    ):
        yield _case("link, lost", FAILS, APART | {"exact": exact}, str(exact), **REFUTED)
    for labels in (["1"], ["1", "2"], [], ["2", "2"], ["3"]):
        yield _case(
            "link, lost",
            FAILS,
            APART | {"witness": {"kind": "agents", "labels": labels}},
            str(labels),
            **REFUTED,
        )
    yield _case(
        "link, lost",
        FAILS,
        APART | {"witness": {"kind": "vector", "labels": ["2"]}},
        "a vector",
        **REFUTED,
    )
    bare = {key: value for key, value in APART.items() if key != "witness"}
    yield _case("link, lost", FAILS, bare, "no witness", **REFUTED)
    yield from _fails(
        "link, lost", APART, {"rate": 0.1}, {"domain": "consensus"}, {"verdict": "proved"}
    )
    for name in ("link", "link, stays", "link, any signal"):
        yield _case(name, FAILS, APART, "apart")
    yield _case("link", FAILS, APART | {"exact": {"modes": ["A", "B"]}}, "apart")
    yield _case(
        "link",
        FAILS,
        APART | {"exact": {"modes": []}, "witness": {"kind": "agents", "labels": ["1", "2"]}},
        "none",
    )


def _bent_safety() -> Iterator[Case]:
    yield from _fails(
        "moving", SAFE, {"rate": 0.1}, {"own": "1/2"}, {"domain": box(1)}, {"rho": "1"}
    )
    yield _case("moving", FAILS, HELD, "agent 2 is not pinned")
    yield _case(
        "moving",
        FAILS,
        SAFE,
        "no proof of consensus",
        verdict="proved",
        covered_by="safety",
        rate=None,
    )
    yield from _fails(
        "moving, held",
        HELD,
        {"own": "0.501"},
        {"rate": 0.501},
        {"rate": None},
        {"rate": 0},
        {"own": None},
    )
    yield from _fails("moving, held", HELD, {"own": "-1"}, {"verdict": "refuted"})
    yield from _fails(
        "moving, one mode",
        NEAR,
        {"rho": "0.999"},
        {"domain": box(1.001)},
        {"domain": ball(1)},
        {"rho": None},
    )
    yield _case("moving, sine", FAILS, bent(NEAR, domain=box(0.78), rho="0.786"), "beyond pi/4")
    name = "moving, observed"
    sizes: tuple[Document, ...] = (
        {"kappa": "0.666"},
        {"beta": "2.0001"},
        {"size": "0.9999"},
        {"P": [["0.9999"]]},
    )
    yield from _fails(
        name,
        FOLLOWED,
        *sizes,
        {"rho": "1.333"},
        {"domain": box(1, 0.501)},
        {"kappa": "-2/3", "beta": "-1"},
    )
    yield _case(name, FAILS, NEAR, "no P")
    yield _case("moving, falling", FAILS, SAFE, "it falls")
    yield _case("moving, outward", FAILS, SAFE, "a gain pushes outward")
    yield _case("moving, list", FAILS, SAFE, "a list")


def _unstable() -> Iterator[Case]:
    """An unstable mode in which no signal may stay refutes nothing, nor does a place of rest."""
    place = second_box()
    place["exact"]["mode"] = "A"
    yield _case("second, any signal", HOLDS, place, "another equilibrium", **REFUTED)
    yield _case("second, in turn", FAILS, place, "another equilibrium", **REFUTED)
    left: Document = {"verdict": "undecided"}
    for name in ("pushed", "pushed, leaves", "pushed, not long", "pushed, in turn"):
        yield _case(name, HOLDS, None, "left open", **left)
        yield _case(name, FAILS, None, "refuted")
    for name in ("pushed, stays", "pushed, dwell", "pushed, over and over", "pushed, arbitrary"):
        yield _case(name, HOLDS, None, "refuted")
        yield _case(name, FAILS, None, "left open", **left)


def _bent_problems() -> Iterator[Case]:
    """Problem files that the package does not write."""
    for rates in ([["-1", "1"], ["1/2", "-1"]], [["1", "-1"], ["1", "-1"]], [["0"]], None):
        document = json.loads(_FRAMES.problem("link"))
        document["switching"]["generator"] = rates
        # Means would decay.
        check = markov(
            GLOBAL, 0.001, "mean", rate="1/1000", w={"A": ["8/5", "1"], "B": ["8/5", "8/5"]}
        )
        yield _case("link", FAILS, check, f"bent problem, {rates}", as_written(document))
