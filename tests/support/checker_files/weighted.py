"""Weighted theorems and linearisations for the lone checker: claims written by hand, and just-false
twins."""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from certified import consensus_claims
from texts import matrix, vector

from checker_files.files import (
    Case,
    Document,
    Forger,
    changed,
    collected,
    conclude,
    fastest_proof,
    network,
    scalar,
)
from checker_files.separable import claim
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

LINE = network([[2, 1]], agents=2)
BOTH = network({"A": [[2, 1]], "B": [[2, 1]]}, agents=2)
WATCHED: dict[str, Any] = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}

# Agent 2 hears agent 1, which is pinned with 1; h' = 1.  M = [[1, 0], [-1, 1]], mu = 1.  With D =
# (4, 1) and rate 1/2 N = [[4, -1], [-1, 1]], N (1, 2) = (2, 1); with rate 3/4 N = [[2, -1], [-1,
# 1/2]] is singular.
D = vector("4 1")
V = vector("1 2")
RATE = 0.5


def weighted(rate: Any = RATE, id: str = "theorem1-weighted", **exact: Any) -> Document:
    weights = {"D": D, "w": {"G": V}}
    return claim(id, "global", rate, weights | exact)


# With A = 0, C = 1, W = 2, P = 1 and rate 1/2: S = 1/(4 - 1) = 1/3, and for s D
# N = s [[4, -1], [-1, 1]] - s^2 diag(16, 1)/3: N (1, 2) = (2 s - 16 s^2/3, s - 2 s^2/3),
# positive for s = 1/4 and not for s = 3/8.
SEEN = weighted(D=vector("1 1/4"), P=[["1"]])


def straight(verdict: str = "proved", rate: Any = 0.75, exact: Any = None, **more: Any) -> Document:
    return claim("linearisation", "global", rate, exact, verdict=verdict, **more)


# P of the paper gives S = 9/8 at rate 0, where N = s [[8, -1], [-1, 2]] - s^2 diag(18, 9/8) for s
# D.
HARMONIC: dict[str, Any] = {
    "exosystem": Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0")),
    "observer": Observer(W=matrix("16/5; 12/5")),
}
UNIT = matrix("1 0; 0 1")
PAPER = matrix("1/2 -1/4; -1/4 1/3")
BENT = matrix("1/2 -26/100; -24/100 1/3")


@cache
def problems() -> dict[str, Problem]:
    def line(coupling: Any = "y", **more: Any) -> Problem:
        settings = {"network": LINE, "coupling": coupling, "gains": {1: 1}}
        return Problem(**settings | more)

    gain = [[1, "1/2"], ["-1/2", 1]]
    gains = {1: gain, 2: 1}
    mixed = {"target": [0, 0], "gains": gains}
    made: dict[str, Problem] = {}
    made["line"] = line()
    made["two modes"] = line(network=BOTH)
    made["seen"] = line(**WATCHED)
    made["mixed"] = line(**mixed)
    made["crossed"] = line(["y1 + y2", "y2"], target=[0, 0])
    made["falling"] = line("-y", gains={1: 1, 2: 3})  # M = [[1, 0], [1, 2]]
    made["unstable"] = line("-y", gains={1: 1, 2: "1/2"})  # M = [[1, 0], [1, -1/2]]
    made["kinked"] = line("abs(y)", gains=1)
    slow_observer = {"observer": Observer(W=[["1/2"]])}
    made["slow"] = line(**WATCHED | slow_observer)
    bad_observer = {"observer": Observer(W=[[-1]])}
    made["bad W"] = line(**WATCHED | bad_observer)
    made["harmonic"] = line(**HARMONIC)
    made["irrational"] = line("exp(1)*y")
    arcs = [[2, 1]]
    optional = [[1, 2]]
    made["comes and goes"] = line(
        network=Network.from_arcs(arcs, arrow="listens_to", optional=optional, agents=2)
    )
    return made


def _made(name: str, code: int, what: str, check: Document) -> Case:
    """The certificate of a small problem with this one claim of the topic, and the verdict that
    follows."""
    problem = problems()[name]
    document = json.loads(certificate_bytes(consensus_claims(problem)))
    topics = ("theorem1-weighted", "theorem2-weighted", "linearisation")
    others = [each for each in document["checks"] if each["id"] not in topics]
    document["checks"] = [*others, check]
    theorems = ("theorem1", "theorem2") if document["observer"]["W"] else ("lemma1",)
    best = fastest_proof(document, (*topics, *theorems, "max-separable", "lure"))
    counted = "unstable_roots" in json.dumps(document["checks"])
    conclude(document, best, refuted=check["verdict"] == "refuted" or counted)
    text = json.dumps(document).encode()
    return Case(f"{name}: {what}", text, canonical_bytes(problem), code)


_FORGER = Forger(_made)
holds = _FORGER.holds
fails = _FORGER.fails
wrong = _FORGER.wrong


@collected
def weighted_cases() -> Iterator[Case]:
    """On the line by theorem 1, then of several modes, with observers, and linearisations."""
    good = weighted()
    yield holds("line", "by hand", good)
    yield holds("line", "in doubles", changed(good, D={"float64": "AAAAAAAAEEAAAAAAAADwPw=="}))
    yield holds("line", "no rate", changed(good, rate=None))
    yield wrong("line", good, "the rate of a singular matrix", rate=0.75)
    yield wrong("line", good, "a rate below 0", rate=-0.5)
    yield wrong("line", good, "a rate of 0", rate=0)
    yield wrong("line", good, "the weights of V = e'e", D=vector("1 1"))
    yield wrong("line", good, "w too steep", w={"G": vector("1 4")})
    yield wrong("line", good, "w too flat", w={"G": vector("1 1")})
    yield wrong("line", good, "no positive D", D=vector("4 -1"))
    yield wrong("line", good, "no positive w", w={"G": vector("-1 -2")})
    yield wrong("line", good, "another mode", w={"H": V})
    yield wrong("line", good, "a mode too many", w={"G": V, "H": V})
    yield wrong("line", good, "one weight", D=["4"])
    yield fails("line", "a P without an exosystem", weighted(P=[["1"]]))
    yield fails("line", "a key too many", weighted(more="1"))
    yield wrong("line", good, "a margin", margin=1)
    yield wrong("line", good, "a witness", witness={"kind": "vector"})
    yield wrong("line", good, "refuted", verdict="refuted", rate=None)
    yield wrong("line", good, "another domain", domain="consensus")
    yield wrong("line", good, "a mode of its own", mode="G")
    yield wrong("line", good, "for several modes", id="theorem2-weighted")
    yield from _several_modes()
    yield from _observed()
    yield from _straight()


def _several_modes() -> Iterator[Case]:
    # With D = (1/2, 1) N w = (w_1 - w_2, 2 w_2 - w_1), and the arc adds (w_1 - w_2/2, -w_1/2) or
    # nothing.
    weights = {"G": vector("5 4")}
    pulled = weighted(None, "theorem2-weighted", D=vector("1/2 1"), w=weights)
    yield holds("comes and goes", "by hand", pulled)
    flat = {"G": vector("1/2 1/2")}
    yield wrong("comes and goes", pulled, "the arc is not always there", w=flat)
    both = weighted(id="theorem2-weighted", w={"A": V, "B": V})
    yield holds("two modes", "by hand", both)
    yield wrong("two modes", both, "one mode is missing", w={"A": V})
    yield wrong("two modes", both, "fails in the second mode", w={"A": V, "B": vector("1 4")})
    yield wrong("two modes", both, "for one mode", id="theorem1-weighted")


def _observed() -> Iterator[Case]:
    yield holds("seen", "by hand", SEEN)
    yield wrong("seen", SEEN, "weights too large for the observer", D=vector("3/2 3/8"))
    yield wrong("seen", SEEN, "a small P", P=[["1/3"]])  # S = 1
    yield wrong("seen", SEEN, "a negative P", P=[["-1"]])
    yield wrong("seen", SEEN, "a P of another size", P=UNIT)
    yield wrong("seen", SEEN, "the rate of the observer", rate=2)
    slow = changed(SEEN, rate=None)
    yield holds("harmonic", "the paper's P", changed(slow, P=PAPER))
    yield wrong("harmonic", slow, "not symmetric", P=BENT)
    yield wrong("bad W", slow, "P < 0", P=[["-1"]])
    yield fails("seen", "no P", weighted(D=vector("1 1/4")))
    weights = {"G": vector("1 1 1 1")}
    mixed = weighted(None, D=vector("1 1 1 1"), w=weights)
    yield fails("mixed", "a gain mixes components", mixed)
    yield fails("crossed", "a coupling mixes components", mixed)
    even = weighted(D=vector("1 1"), w={"G": vector("1 1")})
    yield wrong("falling", even, "a falling slope", rate=None)
    yield wrong("kinked", even, "a kink", domain="consensus")


def _straight() -> Iterator[Case]:
    good = straight()
    yield holds("falling", "proved", good)
    yield holds("falling", "no rate", straight(rate=None))
    yield wrong("falling", good, "the rate of an eigenvalue", rate=1)
    yield wrong("falling", good, "a rate below 0", rate=-1)
    yield wrong("falling", good, "a margin", margin=1)
    yield fails("falling", "a witness", straight(witness={"kind": "vector"}))
    yield fails("falling", "exact values", straight(exact={"unstable_roots": "0"}))
    one_root = straight("refuted", None, {"unstable_roots": "1"})
    yield fails("falling", "refuted, and stable", one_root)
    yield fails("two modes", "several modes", good)
    yield holds("seen", "with the observer", good)
    yield fails("slow", "faster than the observer", good)
    yield holds("slow", "as slow as the observer", straight(rate=0.4))
    yield wrong("kinked", good, "a kink", domain="consensus")
    yield fails("irrational", "irrational slopes", good)
    yield fails("unstable", "proved, and unstable", straight(rate=None))
    yield holds("unstable", "refuted", one_root)
    yield wrong("unstable", one_root, "two roots", unstable_roots="2")
    yield wrong("unstable", one_root, "no root", unstable_roots="0")
    yield wrong("unstable", one_root, "half a root", unstable_roots="1/2")
    yield wrong("unstable", one_root, "refuted at a rate", rate=1)
