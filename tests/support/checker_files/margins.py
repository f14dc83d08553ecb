"""Tolerances and inputs for the lone checker: certificates that `certify` makes, and just-false
twins."""

import json
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, partial
from typing import Any

from certified import few_steps, made_once
from texts import matrix, vector

from checker_files.files import (
    FAILS,
    HOLDS,
    OPEN,
    UNREADABLE,
    Case,
    Document,
    about,
    check_of,
    collected,
    scalar,
)
from dobc_design import Network, Observer, Problem, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import Exosystem, harmonics

REGION = {"initial_states": [-1, 1]}
SEEN = {"exosystem": harmonics([2]), "observer": Observer(W=matrix("16/5; 12/5"))}
WIDE = {"actuators": {"amplitude": 9}, "region": REGION | {"initial_disturbance": "1/2"}}
#: Observers with two poles at -1; A^2 is diag(-2, -1) and more, and 0.
SWELLING = {
    "exosystem": Exosystem(A=matrix("0 2; -1 1"), C=matrix("1 0")),
    "observer": Observer(W=matrix("3; 1")),
}
RISING = {
    "exosystem": Exosystem(A=matrix("0 1; 0 0"), C=matrix("1 0")),
    "observer": Observer(W=matrix("2; 1")),
}


def one(**more: Any) -> Problem:
    network = Network.from_arcs([], arrow="listens_to", agents=1)
    settings = {"network": network, "coupling": "sinh(y)", "gains": {1: 3}, "target": 0}
    return Problem(**settings | more)


@cache
def _made(problem: Problem) -> tuple[bytes, bytes]:
    text = canonical_bytes(problem)
    return text, made_once(f"margins {text.decode()}", partial(_certified, problem))


def _certified(problem: Problem) -> bytes:
    with few_steps():
        return certificate_bytes(certify(problem).claims)


def claimed(problem: Problem, id: str) -> Document:
    """What `certify` claims in the check with that id."""
    exact = check_of(json.loads(_made(problem)[1]), id)["exact"]
    return dict(exact)


def _slower(problem: Problem, part: str) -> Document:
    """alpha = kappa eta + r/2 of a tolerance, r the rate that max-separable gives, and this part of
    r as the rate: at most 1/2 follows."""
    beside = claimed(problem, "max-separable")
    beta = Fraction(beside["beta"])
    kappa = Fraction(beside["kappa"])
    lightest = min(map(Fraction, beside["v"]))
    rate = min(Fraction(beside["alpha"]), beta - 1 / (kappa * lightest))
    eta = Fraction(claimed(problem, "tolerance")["eta"])
    slower = float(rate * Fraction(part))
    alpha = str(kappa * eta + rate / 2)
    return {"alpha": alpha, "rate": float(f"{slower:.6g}"), "factor": None}


def bent(
    problem: Problem,
    id: str,
    *,
    table: Any = None,
    code: int = FAILS,
    without: str = "",
    **changes: Any,
) -> Case:
    """The certificate with other parts of a check or of ``exact``; ``limit``, ``table``: other
    [actuators] and xi0."""
    document, claims = map(json.loads, _made(problem))
    check = check_of(claims, id)
    for key, value in changes.items():
        place = check["exact"]
        if key == "limit":
            place = document["actuators"]
        elif key in ("rate", "domain", "factor"):
            place = check
        place[key] = value
    if check["rate"] is None:
        check["factor"] = None
    # which covers no region
    if changes.get("domain") == "consensus" and document["region"] is not None:
        claims |= OPEN
    elif claims["covered_by"] == id:
        claims |= {"rate": check["rate"], "factor": check["factor"]}
    if without == "accuracy":  # what rests on it falls, too
        claims |= OPEN
    if without == "actuators":
        del document[without]
    elif without:
        _take_away(claims, without)
    if table is not None:
        document["actuators"]["amplitude"] = None
        document["simulation"]["xi0"] = table
    name = f"margins {id} {sorted(changes)} {table} {without}"
    return about(document, claims, name=name, code=code)


def _take_away(claims: Document, id: str) -> None:
    claims["checks"] = [each for each in claims["checks"] if each["id"] != id]


def blindfolded(problem: Problem) -> Case:
    """The same inputs, but of observers that do not know the weights; without the tolerance, which
    would fail, too."""
    document, claims = map(json.loads, _made(problem))
    document["uncertainty"]["known_to_agents"] = False
    _take_away(claims, "tolerance")
    return about(document, claims | OPEN, name="margins of blind observers", code=FAILS)


@collected
def margins_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    table = {"weights": "1/10", "gains": "1/10"}
    near = one(uncertainty=table, region=REGION)
    seen = one(uncertainty=table, **SEEN)
    observer = Observer(W=[[4]])
    fast = {"exosystem": scalar(0), "observer": observer, "gains": 3}
    loose = {"weights": "1/1000", "known_to_agents": False}
    region = REGION | {"initial_disturbance": "1/10"}
    unknown = two(uncertainty=loose, coupling="y + y**3/9", **fast, region=region)
    kinked = one(uncertainty=table, region=REGION, coupling="y + abs(y)/2")
    limited = one(region=REGION, actuators={"limit": 9})
    saturating = one(region=REGION, actuators={"limit": 9, "amplitude": 1, "saturates": True})
    start = matrix("1/2 1/2")
    sine = one(**SEEN, **WIDE)
    # agent 2 has no gain: its input is the estimate alone
    led = two(**SEEN, **WIDE, coupling="tanh(y)")
    # What the errors need, and sqrt(1/2) of the sine that starts at (1/2, 1/2): |C xi0|^2 + |C A
    # xi0|^2 / 4.
    beside = Fraction(claimed(sine, "actuators")["inputs"]["1"]) - 9
    acts = {
        "disturbance": "1/10",
        "drift": "1/10",
        "measurement": "1/50",
        "weights": "1/20",
        "gains": "1/20",
    }
    heavy = one(region=REGION, uncertainty=acts, actuators={"limit": 9})
    straight = heavy.replace(coupling="y")
    drifts = one(**SEEN, **WIDE, uncertainty=acts)
    acting = acts | {"known_to_agents": False}
    blind = two(**fast, coupling="y + y**3/9", uncertainty=acting, **WIDE)
    arcs = [[2, 1], [3, 2], [1, 3]]
    ring = Network.from_arcs(arcs, arrow="listens_to", agents=3)
    gains = {1: 3, 2: 2}
    tight = {
        "network": ring,
        "coupling": "y + y**3/9",
        "gains": gains,
        "uncertainty": {"weights": "1/100"},
    }
    actuators = {"limit": 8, "amplitude": 2}
    own_box = one(**fast | tight, region=WIDE["region"], actuators=actuators)
    yield bent(own_box, "actuators", code=HOLDS)
    yield bent(own_box, "actuators", v=vector("1 2 1"))
    yield blindfolded(own_box)
    for each in (heavy, straight, drifts, blind):
        yield bent(each, "actuators", code=HOLDS)
    for each in (heavy, straight, drifts, blind):
        yield bent(each, "accuracy", code=HOLDS)
    yield bent(heavy, "actuators", without="accuracy")
    yield bent(heavy, "actuators", alpha="-1")
    yield bent(heavy, "actuators", level="1/1000")
    yield bent(straight, "actuators", level="-1")
    yield bent(straight, "actuators", inputs={"1": "3.2"})
    yield bent(drifts, "actuators", kappa="1/1000", inputs={"1": "9000"})
    yield bent(drifts, "actuators", beta="1000", inputs={"1": "9000"})
    yield bent(drifts, "actuators", table=start, inputs={"1": "9000"})
    yield bent(drifts, "actuators", rho="1/10")
    for each in (near, seen, unknown):
        yield bent(each, "tolerance", code=HOLDS)
    yield bent(limited, "actuators", code=HOLDS)
    yield bent(sine, "actuators", code=HOLDS, table=start, inputs={"1": "90"})
    enough = {"1": str(beside + Fraction("0.7072"))}
    yield bent(sine, "actuators", code=HOLDS, table=start, inputs=enough)
    less = {"1": str(beside + Fraction("0.7"))}
    yield bent(sine, "actuators", table=start, inputs=less)
    yield bent(sine, "actuators", table=start, inputs={"1": str(beside)})
    yield bent(led, "actuators", code=HOLDS)
    inputs = claimed(led, "actuators")["inputs"]
    inputs["2"] = str(Fraction(inputs["2"]) - Fraction(1, 100))
    yield bent(led, "actuators", inputs=inputs)
    yield bent(near, "tolerance", weights="1/20")
    yield bent(near, "tolerance", gains="1/20")
    yield bent(near, "tolerance", weights="2")
    yield bent(one(region=REGION), "tolerance", gains="-1/10")
    yield bent(near, "tolerance", rate=None)
    yield bent(near, "tolerance", eta="0")
    yield bent(near, "tolerance", v=["1"], alpha="2", rate=1, domain="consensus", code=HOLDS)
    yield bent(near, "tolerance", v=["0"], alpha="2", rate=1, domain="consensus")
    yield bent(kinked, "tolerance", v=["1"], domain="consensus")
    yield bent(unknown, "tolerance", v=vector("1 2"), alpha="1/10", rate=None, domain="consensus")
    yield bent(limited, "actuators", without="max-separable")
    yield bent(limited, "actuators", without="actuators")
    yield bent(near, "tolerance", rate=4)
    yield bent(seen, "tolerance", alpha="-1")
    yield bent(seen, "tolerance", domain="global")
    yield bent(seen, "tolerance", rate=0.001)
    yield bent(unknown, "tolerance", eta="0")
    yield bent(unknown, "tolerance", **_slower(unknown, "2/5"), code=HOLDS)
    yield bent(unknown, "tolerance", **_slower(unknown, "9/10"))
    yield bent(limited, "actuators", limit={"1": "9", "2": "9"}, code=UNREADABLE)
    yield bent(limited, "actuators", rate=0.1)
    yield bent(limited, "actuators", rho="1000", inputs={"1": "9"})
    yield bent(one(region=REGION, actuators={}), "actuators", rho="1000", inputs={"1": "9000"})
    yield bent(limited, "actuators", inputs={"1": "9", "2": "9"})
    yield bent(limited, "actuators", inputs={"1": "2"})
    yield bent(limited, "actuators", inputs={"1": "10"})
    # 1 of 9 compensates
    yield bent(saturating, "actuators", rooms={"1": "7.999"}, code=HOLDS)
    for room in ("8.001", "0", "-1"):
        yield bent(saturating, "actuators", rooms={"1": room})
    yield bent(saturating, "actuators", rooms={"1": "7.999", "2": "7.999"})
    yield bent(sine, "actuators", table=[["1"]], inputs={"1": "90"})
    yield bent(one(**SWELLING, **WIDE), "actuators", table=matrix("1 0"), inputs={"1": "9000"})
    yield bent(one(**RISING, **WIDE), "actuators", table=matrix("1 1"), inputs={"1": "9000"})


def two(**more: Any) -> Problem:
    """The second agent hears the first."""
    arcs = [[2, 1]]
    network = Network.from_arcs(arcs, arrow="listens_to", agents=2)
    return one(**more | {"network": network})
