"""Tolerances and inputs for the lone checker: certificates that `certify` makes, and just-false
twins."""

import hashlib
import json
from fractions import Fraction
from functools import cache
from typing import Any

from certified import certified
from texts import matrix, vector

from checker_files.files import FAILS, HOLDS, UNREADABLE, Case, scalar
from dobc_design import Network, Observer, Problem
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
    return Problem(
        **{"network": network, "coupling": "sinh(y)", "gains": {1: 3}, "target": 0} | more
    )


@cache
def _made(problem: Problem) -> tuple[bytes, bytes]:
    return canonical_bytes(problem), certificate_bytes(certified(problem).claims)


def _inputs(problem: Problem) -> dict[str, str]:
    """The largest inputs that `certify` claims."""
    checks = json.loads(_made(problem)[1])["checks"]
    actuators = next(each for each in checks if each["id"] == "actuators")
    return dict(actuators["exact"]["inputs"])


def _slower(problem: Problem, part: str) -> dict[str, Any]:
    """alpha = kappa eta + r/2 of a tolerance, r the rate that max-separable gives, and this part of
    r as the rate: at most 1/2 follows."""
    checks = {each["id"]: each for each in json.loads(_made(problem)[1])["checks"]}
    exact, beside = checks["tolerance"]["exact"], checks["max-separable"]["exact"]
    beta, kappa = Fraction(beside["beta"]), Fraction(beside["kappa"])
    rate = min(Fraction(beside["alpha"]), beta - 1 / (kappa * min(map(Fraction, beside["v"]))))
    alpha = kappa * Fraction(exact["eta"]) + rate / 2
    return {
        "alpha": str(alpha),
        "rate": float(f"{float(rate * Fraction(part)):.6g}"),
        "factor": None,
    }


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
    check = next(each for each in claims["checks"] if each["id"] == id)
    for key, value in changes.items():
        place = (
            document["actuators"]
            if key == "limit"
            else check
            if key in ("rate", "domain", "factor")
            else check["exact"]
        )
        place[key] = value
    if check["rate"] is None:
        check["factor"] = None
    # which covers no region
    if changes.get("domain") == "consensus" and document["region"] is not None:
        claims |= {"verdict": "undecided", "rate": None, "factor": None, "covered_by": None}
    elif claims["covered_by"] == id:
        claims |= {"rate": check["rate"], "factor": check["factor"]}
    if without == "accuracy":  # what rests on it falls, too
        claims |= {"verdict": "undecided", "rate": None, "factor": None, "covered_by": None}
    if without in ("max-separable", "accuracy"):
        claims["checks"] = [each for each in claims["checks"] if each["id"] != without]
    if without == "actuators":
        del document[without]
    if table is not None:
        document["actuators"]["amplitude"], document["simulation"]["xi0"] = None, table
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    data = f"{text}\n".encode()
    claims["problem_sha256"] = hashlib.sha256(data).hexdigest()
    return Case(
        f"margins {id} {sorted(changes)} {table} {without}", json.dumps(claims).encode(), data, code
    )


def blindfolded(problem: Problem) -> Case:
    """The same inputs, but of observers that do not know the weights; without the tolerance, which
    would fail, too."""
    document, claims = map(json.loads, _made(problem))
    document["uncertainty"]["known_to_agents"] = False
    claims["checks"] = [each for each in claims["checks"] if each["id"] != "tolerance"]
    claims |= {"verdict": "undecided", "rate": None, "factor": None, "covered_by": None}
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    data = f"{text}\n".encode()
    claims["problem_sha256"] = hashlib.sha256(data).hexdigest()
    return Case("margins of blind observers", json.dumps(claims).encode(), data, FAILS)


@cache
def margins_cases() -> list[Case]:
    """All of them, the good ones first."""
    table = {"weights": "1/10", "gains": "1/10"}
    near, seen = one(uncertainty=table, region=REGION), one(uncertainty=table, **SEEN)
    fast = {"exosystem": scalar(0), "observer": Observer(W=[[4]]), "gains": 3}
    loose = {"weights": "1/1000", "known_to_agents": False}
    unknown = two(
        uncertainty=loose,
        coupling="y + y**3/9",
        **fast,
        region=REGION | {"initial_disturbance": "1/10"},
    )
    kinked = one(uncertainty=table, region=REGION, coupling="y + abs(y)/2")
    limited = one(region=REGION, actuators={"limit": 9})
    start = matrix("1/2 1/2")
    sine = one(**SEEN, **WIDE)
    # agent 2 has no gain: its input is the estimate alone
    led = two(**SEEN, **WIDE, coupling="tanh(y)")
    # What the errors need, and sqrt(1/2) of the sine that starts at (1/2, 1/2): |C xi0|^2 + |C A
    # xi0|^2 / 4.
    beside = Fraction(_inputs(sine)["1"]) - 9
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
    blind = two(
        **fast, coupling="y + y**3/9", uncertainty=acts | {"known_to_agents": False}, **WIDE
    )
    ring = Network.from_arcs([[2, 1], [3, 2], [1, 3]], arrow="listens_to", agents=3)
    tight = {
        "network": ring,
        "coupling": "y + y**3/9",
        "gains": {1: 3, 2: 2},
        "uncertainty": {"weights": "1/100"},
    }
    own_box = one(**fast | tight, region=WIDE["region"], actuators={"limit": 8, "amplitude": 2})
    return [
        bent(own_box, "actuators", code=HOLDS),
        bent(own_box, "actuators", v=vector("1 2 1")),
        blindfolded(own_box),
        *(bent(each, "actuators", code=HOLDS) for each in (heavy, straight, drifts, blind)),
        *(bent(each, "accuracy", code=HOLDS) for each in (heavy, straight, drifts, blind)),
        bent(heavy, "actuators", without="accuracy"),
        bent(heavy, "actuators", alpha="-1"),
        bent(heavy, "actuators", level="1/1000"),
        bent(straight, "actuators", level="-1"),
        bent(straight, "actuators", inputs={"1": "3.2"}),
        bent(drifts, "actuators", kappa="1/1000", inputs={"1": "9000"}),
        bent(drifts, "actuators", beta="1000", inputs={"1": "9000"}),
        bent(drifts, "actuators", table=start, inputs={"1": "9000"}),
        bent(drifts, "actuators", rho="1/10"),
        *(bent(each, "tolerance", code=HOLDS) for each in (near, seen, unknown)),
        bent(limited, "actuators", code=HOLDS),
        bent(sine, "actuators", code=HOLDS, table=start, inputs={"1": "90"}),
        bent(
            sine,
            "actuators",
            code=HOLDS,
            table=start,
            inputs={"1": str(beside + Fraction("0.7072"))},
        ),
        bent(sine, "actuators", table=start, inputs={"1": str(beside + Fraction("0.7"))}),
        bent(sine, "actuators", table=start, inputs={"1": str(beside)}),
        bent(led, "actuators", code=HOLDS),
        bent(
            led,
            "actuators",
            inputs=_inputs(led) | {"2": str(Fraction(_inputs(led)["2"]) - Fraction(1, 100))},
        ),
        bent(near, "tolerance", weights="1/20"),
        bent(near, "tolerance", gains="1/20"),
        bent(near, "tolerance", weights="2"),
        bent(one(region=REGION), "tolerance", gains="-1/10"),
        bent(near, "tolerance", rate=None),
        bent(near, "tolerance", eta="0"),
        bent(near, "tolerance", v=["1"], alpha="2", rate=1, domain="consensus", code=HOLDS),
        bent(near, "tolerance", v=["0"], alpha="2", rate=1, domain="consensus"),
        bent(kinked, "tolerance", v=["1"], domain="consensus"),
        bent(unknown, "tolerance", v=vector("1 2"), alpha="1/10", rate=None, domain="consensus"),
        bent(limited, "actuators", without="max-separable"),
        bent(limited, "actuators", without="actuators"),
        bent(near, "tolerance", rate=4),
        bent(seen, "tolerance", alpha="-1"),
        bent(seen, "tolerance", domain="global"),
        bent(seen, "tolerance", rate=0.001),
        bent(unknown, "tolerance", eta="0"),
        bent(unknown, "tolerance", **_slower(unknown, "2/5"), code=HOLDS),
        bent(unknown, "tolerance", **_slower(unknown, "9/10")),
        bent(limited, "actuators", limit={"1": "9", "2": "9"}, code=UNREADABLE),
        bent(limited, "actuators", rate=0.1),
        bent(limited, "actuators", rho="1000", inputs={"1": "9"}),
        bent(one(region=REGION, actuators={}), "actuators", rho="1000", inputs={"1": "9000"}),
        bent(limited, "actuators", inputs={"1": "9", "2": "9"}),
        bent(limited, "actuators", inputs={"1": "2"}),
        bent(limited, "actuators", inputs={"1": "10"}),
        bent(sine, "actuators", table=[["1"]], inputs={"1": "90"}),
        bent(one(**SWELLING, **WIDE), "actuators", table=matrix("1 0"), inputs={"1": "9000"}),
        bent(one(**RISING, **WIDE), "actuators", table=matrix("1 1"), inputs={"1": "9000"}),
    ]


def two(**more: Any) -> Problem:
    """The second agent hears the first."""
    return one(**more | {"network": Network.from_arcs([[2, 1]], arrow="listens_to", agents=2)})
