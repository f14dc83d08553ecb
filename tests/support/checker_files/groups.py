"""Problems with groups of agents for the lone checker: good certificates, and bad ones wrong in one
place each."""

import json
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from typing import Any

import sympy as sp
from certified import certified, consensus_claims
from networks import linked
from texts import matrix, vector

from checker_files.files import (
    FAILS,
    HOLDS,
    NOTHING,
    OPEN,
    UNREADABLE,
    Case,
    Document,
    about,
    bare,
    bend,
    network,
    scalar,
)
from checker_files.quadratic import quadratic
from checker_files.separable import claim
from dobc_design import Exosystem, Group, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

RAMP = Exosystem(A=matrix("0 1; 0 0"), C=matrix("1 0"))
SLOW, GROWING = Observer(W=[[1]]), Observer(W=[[-1]])


def _pair(*groups: Group, **more: Any) -> Problem:
    """Two agents; one in no group has no disturbance."""
    return Problem(**{"network": network(), "coupling": "y", "gains": 1, "groups": groups} | more)


def _one(agent: int, exosystem: Exosystem, observer: Observer | None = None) -> Group:
    return Group(agents=[agent], exosystem=exosystem, observer=observer)


@cache
def problems() -> dict[str, Problem]:
    """One for every rule about groups."""
    given, slow, bad = (
        _one(1, scalar(0), Observer(W=[[2]])),
        _one(2, scalar(-1), SLOW),
        _one(2, scalar(0), GROWING),
    )
    printed = _one(1, scalar(0), Observer(W=[[2]], P=[[1]]))
    pairs = {"printed": 1, "small P": "1/100", "negative P": -1}
    calm, noisy = ({"initial_states": [-1, 1], "initial_disturbance": s} for s in (0, "1/10"))
    line, turned = (
        Exosystem(A=[[0]], C=matrix("1; 2")),
        Exosystem(A=matrix("0 0; 0 -1"), C=matrix("1 0; 0 1")),
    )
    three = [
        Group(agents=[1, 2], exosystem=scalar(0), observer=Observer(W=[[2]])),
        _one(3, scalar(-1), SLOW),
    ]
    made: dict[str, Problem] = {}
    made["given"] = _pair(given, slow)
    made["mixed"] = _pair(given, _one(2, RAMP))
    for name, P in pairs.items():
        made[name] = _pair(printed, _one(2, scalar(-1), Observer(W=[[1]], P=[[P]])))
    made["hidden"] = _pair(given, _one(2, scalar(0, 0)))
    made["bad W"] = _pair(given, bad)
    made["bad W, calm"] = _pair(given, bad, coupling="tanh(y)", region=calm)
    made["bad W beside a designed one"] = _pair(_one(1, RAMP), bad)
    made["loose"] = _pair(given, slow, gains=None)
    made["region"] = _pair(given, slow, coupling="tanh(y)", gains=2, region=noisy)
    made["plane"] = _pair(_one(1, line), _one(2, turned), coupling=["y1 + y2/2", "y2"], gains=2)
    made["one"] = _pair(given)
    made["one, printed"] = _pair(printed)
    made["one, limited"] = _pair(
        given,
        coupling="tanh(y)",
        region=noisy,
        actuators={"limit": 9},
        simulation={"xi0": ["1/20"]},
        uncertainty={"disturbance": "1/100", "weights": "1/100"},
    )
    made["three"] = linked([[1, 2], [2, 3], [3, 1]], gains=1, groups=three)
    return made


@cache
def _originals() -> dict[str, tuple[bytes, bytes]]:
    """What `certify` says of the region, and of the others about the consensus alone."""
    found = {}
    for name, problem in problems().items():
        claims = (
            certified(problem).claims
            if problem.region and name != "bad W, calm"
            else consensus_claims(problem)
        )
        found[name] = certificate_bytes(claims), canonical_bytes(problem)
    return found


@cache
def groups_cases() -> list[Case]:
    """All of them, the good ones first."""
    good = [
        Case(f"groups: {name}", data, problem, HOLDS)
        for name, (data, problem) in _originals().items()
    ]
    return [
        *good,
        *_bent_claims(),
        *_undisturbed(),
        *_bent_matrices(),
        *_bent_obstacles(),
        *_bent_problems(),
    ]


def document(name: str) -> Document:
    return dict(json.loads(_originals()[name][0]))


def check(document: Document, id: str, group: str | None = None) -> Document:
    """The check of that id and group."""
    return next(
        each for each in document["checks"] if each["id"] == id and each.get("group") == group
    )


def bent(
    name: str, *changes: tuple[str, str | None, Document], what: str, code: int = FAILS
) -> Case:
    """A certificate with changes of checks by id and group, or of the whole ("")."""
    copied = document(name)
    for id, group, values in changes:
        bend(check(copied, id, group) if id else copied, values)
    return Case(f"groups: {name}: {what}", json.dumps(copied).encode(), _originals()[name][1], code)


def _bent_claims() -> Iterator[Case]:
    for change, what in (
        (("hurwitz", "2", {"group": "1"}), "one group twice"),
        (("hurwitz", "2", {"group": "3"}), "a group that is not there"),
        (("lemma1", None, {"group": "1"}), "a group on Lemma 1"),
        (("theorem1", None, {"group": "1"}), "a group on the theorem"),
        (("hurwitz", "1", {"rate": 2.5}), "a rate above 2"),
        (("hurwitz", "1", {"exact": {"routh": vector("1 3")}}), "another Routh column"),
    ):
        yield bent("given", change, what=what)
    yield bent("given", ("hurwitz", "1", {"rate": 1.99}), what="a rate below 2", code=HOLDS)
    # Lambda = [[-4, 2], [2, -4]], lambda_max = -2; S = 1/(4 p) and 1/(4 p'): the margin is below 2.
    # In "small P" S = diag(1/4, 25): the first agent's block alone would do.
    second = {"kind": "vector", "labels": ["2"], "values": vector("0 1")}
    first = {"kind": "vector", "labels": ["1"], "values": vector("1 0")}
    for name, code, values, what in (
        ("printed", FAILS, {"margin": 1.75}, "the margin 2 - 1/4"),
        ("printed", HOLDS, {"margin": 1.7499}, "just below the margin"),
        ("small P", HOLDS, {"witness": second, "margin": -20}, "its own agent"),
        ("small P", FAILS, {"witness": second, "margin": -22}, "too much"),
        ("small P", FAILS, {"witness": second | {"labels": ["1", "2"]}, "margin": None}, "labels"),
        ("small P", FAILS, {"witness": second | {"kind": "agents"}, "margin": None}, "kind"),
        ("small P", FAILS, {"witness": first, "margin": None}, "the other agent"),
        ("negative P", FAILS, {"witness": {"kind": "vector", "values": vector("1 0")}}, "P"),
    ):
        yield bent(name, ("theorem1-printed", None, values), what=what, code=code)
    yield bent("region", ("max-separable", None, {"rate": 3}), what="a rate that does not follow")
    # At the rate b = 1/10, S = diag(1/38, 1/(3.8 p)) for P = diag(10, p), and [[-4, 2], [2, -4]] +
    # 2 b I + S < 0 iff (3.8 - 1/38) (3.8 - 1/(3.8 p)) > 4, that is p > 0.09603: each agent has its
    # own S.
    for p, code in (("0.0961", HOLDS), ("0.0959", FAILS)):
        copied, P = document("given"), [vector("10 0"), ["0", p]]
        copied["checks"].append(
            claim("lure", "global", 0.1, quadratic("1/10", "1", "1", None, None, P=P))
        )
        name = f"groups: a quadratic certificate with p = {p}"
        yield Case(name, json.dumps(copied).encode(), _originals()["given"][1], code)


def _undisturbed() -> Iterator[Case]:
    """Agent 2 of "one" has no disturbance: S = diag(1/(3.8 p), 0) and, with the above, p > 0.09579
    is needed; with the block of agent 1 for both p > 0.1462.  S = diag(1/4, 0) leaves Lambda + S
    the margin 1.871098."""
    for p, code in (("0.0958", HOLDS), ("0.0957", FAILS)):
        copied = document("one")
        copied["checks"].append(
            claim("lure", "global", 0.1, quadratic("1/10", "1", "1", None, None, P=[[p]]))
        )
        name = f"groups: one: a quadratic certificate with p = {p}"
        yield Case(name, json.dumps(copied).encode(), _originals()["one"][1], code)
    for margin, code in ((1.871, HOLDS), (1.8711, FAILS)):
        yield bent(
            "one, printed",
            ("theorem1-printed", None, {"margin": margin}),
            what=f"margin {margin}",
            code=code,
        )
    inputs = dict(check(document("one, limited"), "actuators")["exact"]["inputs"])
    for label, less in (("1", "1/20"), ("2", "1/1000")):  # of |d_1| = 1/20 and d_2 = 0
        exact = check(document("one, limited"), "actuators")["exact"]
        exact = exact | {"inputs": inputs | {label: str(Fraction(inputs[label]) - Fraction(less))}}
        yield bent(
            "one, limited",
            ("actuators", None, {"exact": exact}),
            what=f"a smaller input of agent {label}",
        )
    for id in ("observability", "hurwitz"):
        copied = document("one")
        copied["checks"].append(check(copied, id, "1") | {"group": "2"})
        yield Case(
            f"groups: one: {id} of agent 2",
            json.dumps(copied).encode(),
            _originals()["one"][1],
            FAILS,
        )
    copied = document("one")
    for each in copied["checks"]:
        each.pop("group", None)
    yield Case(
        "groups: one: no group named", json.dumps(copied).encode(), _originals()["one"][1], FAILS
    )


def _texts(M: sp.Matrix) -> list[list[str]]:
    return [[str(x) for x in M.row(i)] for i in range(M.rows)]


def _rational(rows: list[list[str]]) -> sp.Matrix:
    return sp.Matrix([[sp.Rational(x) for x in row] for row in rows])


def _with_matrices(
    name: str, W: sp.Matrix, P: sp.Matrix, *changes: tuple[str, str, Document], what: str
) -> Case:
    """The certificate with these W and P, and everything that follows from them."""
    copied, parts = bare(document(name)), json.loads(_originals()[name][1])["exosystem"]["groups"]
    A, C = (sp.diag(*(_rational(part[key]) for part in parts)) for key in "AC")
    F = A - W * C
    S = C * (-(P * F + F.T * P)).inv() * C.T
    copied["observer"] |= {"W": _texts(W), "P": _texts(P), "Q": _texts(P * W)}
    exact = {"P": _texts(P), "Q": _texts(P * W), "S": _texts(S)}
    exact |= {"bound": str(-S[0, 0])} if S[0, 0] * sp.eye(S.rows) == S else {}
    bend(check(copied, "theorem1"), {"exact": exact, "margin": 0, "rate": None})
    bend(copied, {"rate": None, "covered_by": "theorem1"})
    for id, group, values in changes:
        bend(check(copied, id, group), values)
    return Case(
        f"groups: {name}: {what}", json.dumps(copied).encode(), _originals()[name][1], FAILS
    )


def _bent_matrices() -> Iterator[Case]:
    data = document("mixed")
    W, P = _rational(data["observer"]["W"]), 20 * _rational(data["observer"]["P"])
    slanted, joined = W.copy(), P.copy()
    slanted[0, 1] = sp.Rational(1, 1000)
    joined[0, 1] = joined[1, 0] = sp.Rational(1, 1000)
    yield _with_matrices("mixed", slanted, P, what="W between two groups")
    yield _with_matrices("mixed", W, joined, what="P between two groups")
    faster = W.copy()
    faster[0, 0] = 3
    routh = ("hurwitz", "1", {"exact": {"routh": vector("1 3")}})
    yield _with_matrices("mixed", faster, P, routh, what="another W of a group that has one")


def _bent_obstacles() -> Iterator[Case]:
    for name, exact, what in (
        ("hidden", {"block": "detectability"}, "no group named"),
        ("hidden", {"block": "detectability", "group": "1"}, "the other group"),
        ("hidden", {"block": "detectability", "group": "3"}, "no such group"),
        ("hidden", {"block": "hurwitz", "group": "2"}, "no W of its own"),
        ("bad W", {"block": "hurwitz"}, "no group named"),
        ("bad W", {"block": "hurwitz", "group": "1"}, "the good gain"),
        ("loose", {"block": "Lambda", "mode": "G", "group": "1"}, "a group on Lambda"),
    ):
        yield bent(name, ("theorem1", None, {"exact": exact}), what=what)
    yield bent("bad W", ("", None, OPEN), what="refuted, and it says undecided")
    yield bent(
        "bad W, calm", ("", None, {"verdict": "refuted"}), what="undecided, and it says refuted"
    )
    yield bent(
        "bad W beside a designed one", ("", None, OPEN), what="refuted, and it says undecided"
    )
    yield bent("bad W", ("theorem1", None, NOTHING), what="the theorem left open", code=HOLDS)


def _bent_problems() -> Iterator[Case]:
    def changed(name: str, certificate: Document, code: int, *, what: str, **parts: Any) -> Case:
        problem = json.loads(_originals()[name][1])
        for place, values in parts.items():
            bend(
                problem[place]
                if place == "observer"
                else problem["exosystem"]["groups"][int(place[1:])],
                values,
            )
        return about(problem, certificate, name=f"groups: {name}: {what}", code=code)

    plain = document("given")
    for what, parts in {
        "a W for nobody": {"observer": {"W": "2"}},
        "a P for nobody": {"observer": {"P": "2"}},
        "a P for one group": {"g0": {"P": [["1"]]}},
        "P without W": {"g0": {"W": None, "P": [["1"]]}, "g1": {"P": [["1"]]}},
        "an agent in no group": {"g0": {"agents": []}},
        "an agent in two groups": {"g0": {"agents": [0, 1]}},
        "an agent that is not there": {"g1": {"agents": [1, 2]}},
        "no state": {"g0": {"A": [], "C": [[]], "W": []}},
    }.items():
        yield changed("given", plain, UNREADABLE, what=what, **parts)
    turned = document("three")
    for each in turned["checks"]:
        each.update({"group": "2"} if each.get("group") == "1" else {})
    yield changed("three", turned, UNREADABLE, what="agents out of order", g0={"agents": [1, 0]})
    backwards, problem = document("given"), json.loads(_originals()["given"][1])
    problem["exosystem"]["groups"].reverse()
    for holder, names in (
        (backwards["observer"], "WPQ"),
        (check(backwards, "theorem1")["exact"], "PQS"),
    ):
        holder |= {name: [row[::-1] for row in holder[name][::-1]] for name in names}
    yield about(problem, backwards, name="groups: given: groups out of order", code=UNREADABLE)
    for what, parts in {
        "version 1": {"version": 1},
        "no group": {"exosystem": {"groups": []}},
        "all agents": {
            "exosystem": {
                "groups": [
                    json.loads(_originals()["one"][1])["exosystem"]["groups"][0]
                    | {"agents": [0, 1]}
                ]
            }
        },
    }.items():
        file = json.loads(_originals()["one"][1]) | parts
        yield about(file, document("one"), name=f"groups: one: {what}", code=UNREADABLE)
    crowded = json.loads(_originals()["given"][1])
    crowded["exosystem"]["groups"].append(
        {"agents": [], "A": [["0"]], "C": [["1"]], "W": [["1"]], "P": None}
    )
    yield about(crowded, plain, name="groups: given: a group of nobody", code=UNREADABLE)
    yield _alone()


def _alone() -> Case:
    """One group of all agents: a certificate of the plain problem with the group's name on its
    checks."""
    same = Problem(
        network=network(), coupling="y", gains=1, exosystem=scalar(0), observer=Observer(W=[[2]])
    )
    certificate, problem = (
        json.loads(certificate_bytes(consensus_claims(same))),
        json.loads(canonical_bytes(same)),
    )
    for each in certificate["checks"]:
        each.update(
            {"group": "1"} if each["id"] in ("observability", "detectability", "hurwitz") else {}
        )
    problem["exosystem"] = {
        "groups": [problem["exosystem"] | {"agents": [0, 1], "W": [["2"]], "P": None}]
    }
    problem["observer"] = {"W": None, "P": None, "rate": None}
    return about(problem, certificate, name="groups: one group of all", code=UNREADABLE)
