"""Problems with groups of agents for the lone checker: good certificates, and bad ones wrong in one
place each."""

import json
from collections.abc import Iterator
from dataclasses import replace
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
    as_rationals,
    as_texts,
    bare,
    bend,
    collected,
    network,
    scalar,
)
from checker_files.quadratic import quadratic
from checker_files.separable import claim
from dobc_design import Exosystem, Group, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

RAMP = Exosystem(A=matrix("0 1; 0 0"), C=matrix("1 0"))
SLOW = Observer(W=[[1]])
GROWING = Observer(W=[[-1]])


def _pair(*groups: Group, **more: Any) -> Problem:
    """Two agents; one in no group has no disturbance."""
    settings = {"network": network(), "coupling": "y", "gains": 1, "groups": groups}
    return Problem(**settings | more)


def _one(agent: int, exosystem: Exosystem, observer: Observer | None = None) -> Group:
    return Group(agents=[agent], exosystem=exosystem, observer=observer)


@cache
def problems() -> dict[str, Problem]:
    """One for every rule about groups."""
    given = _one(1, scalar(0), Observer(W=[[2]]))
    slow = _one(2, scalar(-1), SLOW)
    bad = _one(2, scalar(0), GROWING)
    own_observer = Observer(W=[[2]], P=[[1]])
    printed = _one(1, scalar(0), own_observer)
    pairs = {"printed": 1, "small P": "1/100", "negative P": -1}
    starts = {"initial_states": [-1, 1]}
    calm = starts | {"initial_disturbance": 0}
    noisy = starts | {"initial_disturbance": "1/10"}
    line = Exosystem(A=[[0]], C=matrix("1; 2"))
    turned = Exosystem(A=matrix("0 0; 0 -1"), C=matrix("1 0; 0 1"))
    observer = Observer(W=[[2]])
    first_two = Group(agents=[1, 2], exosystem=scalar(0), observer=observer)
    three = [first_two, _one(3, scalar(-1), SLOW)]
    made: dict[str, Problem] = {}
    made["given"] = _pair(given, slow)
    made["mixed"] = _pair(given, _one(2, RAMP))
    for name, P in pairs.items():
        observer_of_second = Observer(W=[[1]], P=[[P]])
        second = _one(2, scalar(-1), observer_of_second)
        made[name] = _pair(printed, second)
    made["hidden"] = _pair(given, _one(2, scalar(0, 0)))
    made["bad W"] = _pair(given, bad)
    made["bad W, calm"] = _pair(given, bad, coupling="tanh(y)", region=calm)
    made["bad W beside a designed one"] = _pair(_one(1, RAMP), bad)
    made["loose"] = _pair(given, slow, gains=None)
    made["region"] = _pair(given, slow, coupling="tanh(y)", gains=2, region=noisy)
    made["plane"] = _pair(_one(1, line), _one(2, turned), coupling=["y1 + y2/2", "y2"], gains=2)
    made["one"] = _pair(given)
    made["one, printed"] = _pair(printed)
    simulation = {"xi0": ["1/20"]}
    uncertainty = {"disturbance": "1/100", "weights": "1/100"}
    made["one, limited"] = _pair(
        given,
        coupling="tanh(y)",
        region=noisy,
        actuators={"limit": 9},
        simulation=simulation,
        uncertainty=uncertainty,
    )
    arcs = [[1, 2], [2, 3], [3, 1]]
    made["three"] = linked(arcs, gains=1, groups=three)
    return made


@cache
def _originals() -> dict[str, tuple[bytes, bytes]]:
    """What `certify` says of the region, and of the others about the consensus alone."""
    found = {}
    for name, problem in problems().items():
        if problem.region and name != "bad W, calm":
            claims = certified(problem).claims
        else:
            claims = consensus_claims(problem)
        found[name] = certificate_bytes(claims), canonical_bytes(problem)
    return found


@collected
def groups_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    for name, (data, problem) in _originals().items():
        yield Case(f"groups: {name}", data, problem, HOLDS)
    yield from _bent_claims()
    yield from _undisturbed()
    yield from _bent_matrices()
    yield from _bent_obstacles()
    yield from _bent_problems()


def document(name: str) -> Document:
    return dict(json.loads(_originals()[name][0]))


def problem_of(name: str) -> Document:
    """The problem file, as a document."""
    return dict(json.loads(_originals()[name][1]))


def check(document: Document, id: str, group: str | None = None) -> Document:
    """The check of that id and group."""
    for each in document["checks"]:
        if each["id"] == id and each.get("group") == group:
            found: Document = each
            return found
    raise LookupError(f"{id} of {group}")


def _case(name: str, what: str, copied: Document, code: int = FAILS) -> Case:
    data = json.dumps(copied).encode()
    return Case(f"groups: {name}: {what}", data, _originals()[name][1], code)


def bent(
    name: str,
    what: str,
    id: str,
    in_group: str | None = None,
    /,
    *,
    code: int = FAILS,
    **changes: Any,
) -> Case:
    """A certificate with changes of the check with that id and group, or of the whole ("")."""
    copied = document(name)
    bend(check(copied, id, in_group) if id else copied, changes)
    return _case(name, what, copied, code)


def with_one_more(name: str, what: str, added: Document, code: int = FAILS) -> Case:
    """A certificate with one check more."""
    copied = document(name)
    copied["checks"].append(added)
    return _case(name, what, copied, code)


def _bent_claims() -> Iterator[Case]:
    yield bent("given", "one group twice", "hurwitz", "2", group="1")
    yield bent("given", "a group that is not there", "hurwitz", "2", group="3")
    yield bent("given", "a group on Lemma 1", "lemma1", group="1")
    yield bent("given", "a group on the theorem", "theorem1", group="1")
    yield bent("given", "a rate above 2", "hurwitz", "1", rate=2.5)
    routh = {"routh": vector("1 3")}
    yield bent("given", "another Routh column", "hurwitz", "1", exact=routh)
    yield bent("given", "a rate below 2", "hurwitz", "1", rate=1.99, code=HOLDS)
    yield from _bent_printed_pairs()
    yield bent("region", "a rate that does not follow", "max-separable", rate=3)
    # At the rate b = 1/10, S = diag(1/38, 1/(3.8 p)) for P = diag(10, p), and [[-4, 2], [2, -4]] +
    # 2 b I + S < 0 iff (3.8 - 1/38) (3.8 - 1/(3.8 p)) > 4, that is p > 0.09603: each agent has its
    # own S.
    for p, code in (("0.0961", HOLDS), ("0.0959", FAILS)):
        lure = _quadratic(matrix(f"10 0; 0 {p}"))
        title = f"groups: a quadratic certificate with p = {p}"
        yield replace(with_one_more("given", "", lure, code), name=title)


def _quadratic(P: list[list[str]]) -> Document:
    form = quadratic("1/10", "1", "1", None, None, P=P)
    return claim("lure", "global", 0.1, form)


def _bent_printed_pairs() -> Iterator[Case]:
    """Lambda = [[-4, 2], [2, -4]], lambda_max = -2; S = 1/(4 p) and 1/(4 p'): the margin is below
    2.  In "small P" S = diag(1/4, 25): the first agent's block alone would do."""
    id = "theorem1-printed"
    second = {"kind": "vector", "labels": ["2"], "values": vector("0 1")}
    first = {"kind": "vector", "labels": ["1"], "values": vector("1 0")}
    yield bent("printed", "the margin 2 - 1/4", id, margin=1.75)
    yield bent("printed", "just below the margin", id, margin=1.7499, code=HOLDS)
    yield bent("small P", "its own agent", id, witness=second, margin=-20, code=HOLDS)
    yield bent("small P", "too much", id, witness=second, margin=-22)
    both = second | {"labels": ["1", "2"]}
    yield bent("small P", "labels", id, witness=both, margin=None)
    yield bent("small P", "kind", id, witness=second | {"kind": "agents"}, margin=None)
    yield bent("small P", "the other agent", id, witness=first, margin=None)
    yield bent("negative P", "P", id, witness={"kind": "vector", "values": vector("1 0")})


def _undisturbed() -> Iterator[Case]:
    """Agent 2 of "one" has no disturbance: S = diag(1/(3.8 p), 0) and, with the above, p > 0.09579
    is needed; with the block of agent 1 for both p > 0.1462.  S = diag(1/4, 0) leaves Lambda + S
    the margin 1.871098."""
    for p, code in (("0.0958", HOLDS), ("0.0957", FAILS)):
        yield with_one_more("one", f"a quadratic certificate with p = {p}", _quadratic([[p]]), code)
    id = "theorem1-printed"
    yield bent("one, printed", "margin 1.871", id, margin=1.871, code=HOLDS)
    yield bent("one, printed", "margin 1.8711", id, margin=1.8711)
    exact = check(document("one, limited"), "actuators")["exact"]
    inputs = exact["inputs"]
    for label, less in (("1", "1/20"), ("2", "1/1000")):  # of |d_1| = 1/20 and d_2 = 0
        less_input = Fraction(inputs[label]) - Fraction(less)
        smaller = inputs | {label: str(less_input)}
        title = f"a smaller input of agent {label}"
        yield bent("one, limited", title, "actuators", exact=exact | {"inputs": smaller})
    for id in ("observability", "hurwitz"):
        again = check(document("one"), id, "1") | {"group": "2"}
        yield with_one_more("one", f"{id} of agent 2", again)
    copied = document("one")
    for each in copied["checks"]:
        each.pop("group", None)
    yield _case("one", "no group named", copied)


def _with_matrices(
    name: str, what: str, W: sp.Matrix, P: sp.Matrix, *, routh: Document | None = None
) -> Case:
    """The certificate with these W and P, and everything that follows from them; ``routh``: what
    is said of the matrix of group 1."""
    copied = bare(document(name))
    parts = problem_of(name)["exosystem"]["groups"]
    A, C = (sp.diag(*(as_rationals(part[key]) for part in parts)) for key in "AC")
    F = A - W * C
    decay = -(P * F + F.T * P)
    inverse = decay.inv()
    S = C * inverse * C.T
    pair = {"P": as_texts(P), "Q": as_texts(P * W)}
    copied["observer"] |= {"W": as_texts(W)} | pair
    exact = pair | {"S": as_texts(S)}
    if S[0, 0] * sp.eye(S.rows) == S:
        exact["bound"] = str(-S[0, 0])
    changes = {"exact": exact, "margin": 0, "rate": None}
    bend(check(copied, "theorem1"), changes)
    bend(copied, {"rate": None, "covered_by": "theorem1"})
    if routh is not None:
        bend(check(copied, "hurwitz", "1"), {"exact": routh})
    return _case(name, what, copied)


def _bent_matrices() -> Iterator[Case]:
    observer = document("mixed")["observer"]
    W = as_rationals(observer["W"])
    P = 20 * as_rationals(observer["P"])
    slanted = W.copy()
    slanted[0, 1] = sp.Rational(1, 1000)
    yield _with_matrices("mixed", "W between two groups", slanted, P)
    joined = P.copy()
    joined[0, 1] = joined[1, 0] = sp.Rational(1, 1000)
    yield _with_matrices("mixed", "P between two groups", W, joined)
    faster = W.copy()
    faster[0, 0] = 3
    routh = {"routh": vector("1 3")}
    yield _with_matrices("mixed", "another W of a group that has one", faster, P, routh=routh)


def _bent_obstacles() -> Iterator[Case]:
    def obstacle(name: str, what: str, **exact: str) -> Case:
        return bent(name, what, "theorem1", exact=exact)

    yield obstacle("hidden", "no group named", block="detectability")
    yield obstacle("hidden", "the other group", block="detectability", group="1")
    yield obstacle("hidden", "no such group", block="detectability", group="3")
    yield obstacle("hidden", "no W of its own", block="hurwitz", group="2")
    yield obstacle("bad W", "no group named", block="hurwitz")
    yield obstacle("bad W", "the good gain", block="hurwitz", group="1")
    yield obstacle("loose", "a group on Lambda", block="Lambda", mode="G", group="1")
    for name in ("bad W", "bad W beside a designed one"):
        yield bent(name, "refuted, and it says undecided", "", **OPEN)
    yield bent("bad W, calm", "undecided, and it says refuted", "", verdict="refuted")
    yield bent("bad W", "the theorem left open", "theorem1", code=HOLDS, **NOTHING)


def _unreadable(name: str, what: str, problem: Document, certificate: Document) -> Case:
    return about(problem, certificate, name=f"groups: {name}: {what}", code=UNREADABLE)


def _with_group(what: str, place: int, **values: Any) -> Case:
    """Of "given", with values of one of its groups changed."""
    problem = problem_of("given")
    problem["exosystem"]["groups"][place] |= values
    return _unreadable("given", what, problem, document("given"))


def _bent_problems() -> Iterator[Case]:
    for key in "WP":
        problem = problem_of("given")
        problem["observer"][key] = "2"
        yield _unreadable("given", f"a {key} for nobody", problem, document("given"))
    one = [["1"]]
    yield _with_group("a P for one group", 0, P=one)
    yield _with_group("an agent in no group", 0, agents=[])
    yield _with_group("an agent in two groups", 0, agents=[0, 1])
    yield _with_group("an agent that is not there", 1, agents=[1, 2])
    yield _with_group("no state", 0, A=[], C=[[]], W=[])
    problem = problem_of("given")
    first, second = problem["exosystem"]["groups"]
    first |= {"W": None, "P": one}
    second["P"] = one
    yield _unreadable("given", "P without W", problem, document("given"))
    turned = document("three")
    for each in turned["checks"]:
        if each.get("group") == "1":
            each["group"] = "2"
    problem = problem_of("three")
    problem["exosystem"]["groups"][0]["agents"] = [1, 0]
    yield _unreadable("three", "agents out of order", problem, turned)
    yield _backwards()
    of_version = ("version 1", {"version": 1})
    of_group = ("no group", {"exosystem": {"groups": []}})
    for what, parts in (of_version, of_group):
        yield _unreadable("one", what, problem_of("one") | parts, document("one"))
    problem = problem_of("one")
    problem["exosystem"]["groups"][0]["agents"] = [0, 1]
    yield _unreadable("one", "all agents", problem, document("one"))
    crowded = problem_of("given")
    nobody = {"agents": [], "A": [["0"]], "C": one, "W": one, "P": None}
    crowded["exosystem"]["groups"].append(nobody)
    yield _unreadable("given", "a group of nobody", crowded, document("given"))
    yield _alone()


def _backwards() -> Case:
    """The second group before the first, in the problem and in all matrices."""
    problem = problem_of("given")
    problem["exosystem"]["groups"].reverse()
    claims = document("given")
    exact = check(claims, "theorem1")["exact"]
    for holder, names in ((claims["observer"], "WPQ"), (exact, "PQS")):
        for name in names:
            turned = reversed(holder[name])
            holder[name] = [row[::-1] for row in turned]
    return _unreadable("given", "groups out of order", problem, claims)


def _alone() -> Case:
    """One group of all agents: a certificate of the plain problem with the group's name on its
    checks."""
    observer = Observer(W=[[2]])
    same = _pair(exosystem=scalar(0), observer=observer)
    certificate = json.loads(certificate_bytes(consensus_claims(same)))
    for each in certificate["checks"]:
        if each["id"] in ("observability", "detectability", "hurwitz"):
            each["group"] = "1"
    problem = json.loads(canonical_bytes(same))
    changes = {"agents": [0, 1], "W": [["2"]], "P": None}
    all_agents = problem["exosystem"] | changes
    problem["exosystem"] = {"groups": [all_agents]}
    problem["observer"] = {"W": None, "P": None, "rate": None}
    return about(problem, certificate, name="groups: one group of all", code=UNREADABLE)
