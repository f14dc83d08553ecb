"""Weighted theorems and linearisations for the lone checker: claims written by hand, and just-false
twins."""

import json
from functools import cache
from typing import Any

from certified import consensus_claims
from texts import matrix, vector

from checker_files.files import (
    FAILS,
    HOLDS,
    Case,
    Document,
    conclude,
    fastest_proof,
    network,
    scalar,
)
from checker_files.separable import claim
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

LINE, BOTH = network([[2, 1]], agents=2), network({"A": [[2, 1]], "B": [[2, 1]]}, agents=2)
WATCHED: dict[str, Any] = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}

# Agent 2 hears agent 1, which is pinned with 1; h' = 1.  M = [[1, 0], [-1, 1]], mu = 1.  With D =
# (4, 1) and rate 1/2 N = [[4, -1], [-1, 1]], N (1, 2) = (2, 1); with rate 3/4 N = [[2, -1], [-1,
# 1/2]] is singular.
D, V, RATE = vector("4 1"), vector("1 2"), 0.5


def weighted(rate: Any = RATE, id: str = "theorem1-weighted", **exact: Any) -> Document:
    return claim(id, "global", rate, {"D": D, "w": {"G": V}} | exact)


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
PAPER = matrix("1/2 -1/4; -1/4 1/3")
BENT = matrix("1/2 -26/100; -24/100 1/3")


@cache
def problems() -> dict[str, Problem]:
    def line(coupling: Any = "y", **more: Any) -> Problem:
        return Problem(**{"network": LINE, "coupling": coupling, "gains": {1: 1}} | more)

    mixed = {"target": [0, 0], "gains": {1: [[1, "1/2"], ["-1/2", 1]], 2: 1}}
    return {
        "line": line(),
        "two modes": line(network=BOTH),
        "seen": line(**WATCHED),
        "mixed": line(**mixed),
        "crossed": line(["y1 + y2", "y2"], target=[0, 0]),
        "falling": line("-y", gains={1: 1, 2: 3}),  # M = [[1, 0], [1, 2]]
        "unstable": line("-y", gains={1: 1, 2: "1/2"}),  # M = [[1, 0], [1, -1/2]]
        "kinked": line("abs(y)", gains=1),
        "slow": line(**WATCHED | {"observer": Observer(W=[["1/2"]])}),
        "bad W": line(**WATCHED | {"observer": Observer(W=[[-1]])}),
        "harmonic": line(**HARMONIC),
        "irrational": line("exp(1)*y"),
        "comes and goes": line(
            network=Network.from_arcs([[2, 1]], arrow="listens_to", optional=[[1, 2]], agents=2)
        ),
    }


def case(name: str, problem: str, check: Document, code: int) -> Case:
    """The certificate of a small problem with this one claim of the topic, and the verdict that
    follows."""
    document = json.loads(certificate_bytes(consensus_claims(problems()[problem])))
    topics = ("theorem1-weighted", "theorem2-weighted", "linearisation")
    document["checks"] = [each for each in document["checks"] if each["id"] not in topics] + [check]
    theorems = ("theorem1", "theorem2") if document["observer"]["W"] else ("lemma1",)
    best = fastest_proof(document, (*topics, *theorems, "max-separable", "lure"))
    counted = "unstable_roots" in json.dumps(document["checks"])
    conclude(document, best, refuted=check["verdict"] == "refuted" or counted)
    data = canonical_bytes(problems()[problem])
    return Case(f"{problem}: {name}", json.dumps(document).encode(), data, code)


@cache
def weighted_cases() -> list[Case]:
    D_doubles = {"float64": "AAAAAAAAEEAAAAAAAADwPw=="}  # 4 and 1
    good, both = weighted(), {"A": V, "B": V}
    second = {"id": "theorem2-weighted", "w": both}
    mixed = {"D": ["1"] * 4, "w": {"G": ["1"] * 4}}
    lines = [
        ("by hand", good, HOLDS),
        ("in doubles", weighted(D=D_doubles), HOLDS),
        ("no rate", weighted(None), HOLDS),
        ("the rate of a singular matrix", weighted(0.75), FAILS),
        ("a rate below 0", weighted(-0.5), FAILS),
        ("a rate of 0", weighted(0), FAILS),
        ("the weights of V = e'e", weighted(D=vector("1 1")), FAILS),
        ("w too steep", weighted(w={"G": vector("1 4")}), FAILS),
        ("w too flat", weighted(w={"G": vector("1 1")}), FAILS),
        ("no positive D", weighted(D=vector("4 -1")), FAILS),
        ("no positive w", weighted(w={"G": vector("-1 -2")}), FAILS),
        ("another mode", weighted(w={"H": V}), FAILS),
        ("a mode too many", weighted(w={"G": V, "H": V}), FAILS),
        ("one weight", weighted(D=["4"]), FAILS),
        ("a P without an exosystem", weighted(P=[["1"]]), FAILS),
        ("a key too many", weighted(more="1"), FAILS),
        ("a margin", good | {"margin": 1}, FAILS),
        ("a witness", good | {"witness": {"kind": "vector"}}, FAILS),
        ("refuted", good | {"verdict": "refuted", "rate": None}, FAILS),
        ("another domain", good | {"domain": "consensus"}, FAILS),
        ("a mode of its own", good | {"mode": "G"}, FAILS),
        ("for several modes", weighted(id="theorem2-weighted"), FAILS),
    ]
    found = [case(name, "line", check, code) for name, check, code in lines]
    # With D = (1/2, 1) N w = (w_1 - w_2, 2 w_2 - w_1), and the arc adds (w_1 - w_2/2, -w_1/2) or
    # nothing.
    for name, w, code in (
        ("by hand", vector("5 4"), HOLDS),
        ("the arc is not always there", vector("1/2 1/2"), FAILS),
    ):
        check = weighted(None, "theorem2-weighted", D=vector("1/2 1"), w={"G": w})
        found.append(case(name, "comes and goes", check, code))
    found += [
        case(name, "two modes", weighted(**second | more), code)
        for name, more, code in (
            ("by hand", {}, HOLDS),
            ("one mode is missing", {"w": {"A": V}}, FAILS),
            ("fails in the second mode", {"w": {"A": V, "B": vector("1 4")}}, FAILS),
            ("for one mode", {"id": "theorem1-weighted"}, FAILS),
        )
    ]
    found += [
        case(name, "seen", SEEN | {"exact": SEEN["exact"] | more}, code)
        for name, more, code in (
            ("by hand", {}, HOLDS),
            ("weights too large for the observer", {"D": vector("3/2 3/8")}, FAILS),
            ("a small P", {"P": [["1/3"]]}, FAILS),  # S = 1
            ("a negative P", {"P": [["-1"]]}, FAILS),
            ("a P of another size", {"P": matrix("1 0; 0 1")}, FAILS),
        )
    ]
    found += [
        case("the rate of the observer", "seen", SEEN | {"rate": 2}, FAILS),
        case("the paper's P", "harmonic", weighted(None, D=vector("1 1/4"), P=PAPER), HOLDS),
        case("not symmetric", "harmonic", weighted(None, D=vector("1 1/4"), P=BENT), FAILS),
        case("P < 0", "bad W", weighted(None, D=vector("1 1/4"), P=[["-1"]]), FAILS),
        case("no P", "seen", weighted(D=vector("1 1/4")), FAILS),
        case("a gain mixes components", "mixed", weighted(None, **mixed), FAILS),
        case("a coupling mixes components", "crossed", weighted(None, **mixed), FAILS),
        case(
            "a falling slope",
            "falling",
            weighted(None, D=vector("1 1"), w={"G": vector("1 1")}),
            FAILS,
        ),
        case(
            "a kink",
            "kinked",
            weighted(D=vector("1 1"), w={"G": vector("1 1")}) | {"domain": "consensus"},
            FAILS,
        ),
    ]
    found += [
        case(name, problem, check, code)
        for name, problem, check, code in (
            ("proved", "falling", straight(), HOLDS),
            ("no rate", "falling", straight(rate=None), HOLDS),
            ("the rate of an eigenvalue", "falling", straight(rate=1), FAILS),
            ("a rate below 0", "falling", straight(rate=-1), FAILS),
            ("a margin", "falling", straight(margin=1), FAILS),
            ("a witness", "falling", straight(witness={"kind": "vector"}), FAILS),
            ("exact values", "falling", straight(exact={"unstable_roots": "0"}), FAILS),
            (
                "refuted, and stable",
                "falling",
                straight("refuted", None, {"unstable_roots": "1"}),
                FAILS,
            ),
            ("several modes", "two modes", straight(), FAILS),
            ("with the observer", "seen", straight(), HOLDS),
            ("faster than the observer", "slow", straight(), FAILS),
            ("as slow as the observer", "slow", straight(rate=0.4), HOLDS),
            ("a kink", "kinked", straight() | {"domain": "consensus"}, FAILS),
            ("irrational slopes", "irrational", straight(), FAILS),
            ("proved, and unstable", "unstable", straight(rate=None), FAILS),
            ("refuted", "unstable", straight("refuted", None, {"unstable_roots": "1"}), HOLDS),
            ("two roots", "unstable", straight("refuted", None, {"unstable_roots": "2"}), FAILS),
            ("no root", "unstable", straight("refuted", None, {"unstable_roots": "0"}), FAILS),
            (
                "half a root",
                "unstable",
                straight("refuted", None, {"unstable_roots": "1/2"}),
                FAILS,
            ),
            (
                "refuted at a rate",
                "unstable",
                straight("refuted", 1, {"unstable_roots": "1"}),
                FAILS,
            ),
        )
    ]
    return found
