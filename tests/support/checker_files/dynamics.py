"""Agents with dynamics for the lone checker: claims and problem files written by hand, and twins
wrong in one place.

Two double integrators, 2 hears 1, h(y) = y1 + 2 y2, agent 1 has the gain 1: G = [[0, 0], [1, 2]]
and M = [[1, 0], [-1, 1]].  With D = (4, 1) and c = 1/2 N = D M + M'D - 2 c D = [[4, -1], [-1, 1]],
N (1, 2) = (2, 1); with c = 3/4 N is singular.  R = [[2, 1], [1, 2]] > 0 has R G = [[1, 2], [2, 4]]
>= 0 and for c = 1/2 A'R + R A - 2 c R G + 2 b R = [[4 b - 1, 2 b], [2 b, 4 b - 2]], < 0 for b = 1/8
and not for b = 1/4.

In coordinates: p'' = h(p_1 - p_2) - 3 p', z = (p, p + p'/2) has z_1' = 2 (z_2 - z_1), and with
gains g of the arc and k of the pin z_2' = -z_2 + (1 - (g + k)/2) z_1 + g/2 z_1j.  For g = 1, k = 1
at agent 1 and v = (4, 3), (8, 7) the rows allow 1/2, 1/3, 1/4 and 1/7; for g >= 3/4 the last one
1/14: tanh(r)/r is 0.7616 at r = 1 and 0.6947 at 1.2, where r = 12 rho.  |e|_inf <= R has N <= R/2.
With d = xi seen by W = 2, T B C = (0, 1/2)'.  Pendulums without pins, v = (4, 3): 1/2 and, for
gains >= 3/4 of the sine, 1/6; sin(r)/r is 0.7767 at r = 1.2 and 0.7412 at 1.3, where r = 4 rho.
For h = (y1 y2 + y1, y2), K = I and v = 1 the worst row allows 1 - 2 r, r = 2 rho.  |w| <= 1/10 adds
1/20 to z_2': with alpha = 1/14 the row of agent 2 asks 1/20 <= level/2, and the box ends with |e|
<= level (4, 14) and level (8, 30).
"""

import json
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from typing import Any

from certified import consensus_claims
from texts import matrix, ranges, vector

from checker_files.files import (
    FAILS,
    GONE,
    HOLDS,
    SAYS_NOTHING,
    UNREADABLE,
    Case,
    Document,
    Forger,
    about,
    bend,
    changed,
    check_of,
    collected,
    conclude,
    fastest_proof,
    network,
    scalar,
)
from checker_files.separable import asked, ball, box, claim, second_box, separable
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.dynamics import Dynamics

LINE = network([[2, 1]], agents=2)
BOTH = network({"A": [[2, 1]], "B": [[2, 1]]}, agents=2)
BOTH_WAYS = network([[1, 2], [2, 1]], agents=2)
WIDE = {"initial_states": [-5, 5]}
DOUBLE: dict[str, Any] = {
    "dynamics": Dynamics(A=matrix("0 1; 0 0"), B=matrix("0; 1")),
    "coupling": "y1 + 2*y2",
}
OWN = (
    "theorem1-weighted",
    "theorem2-weighted",
    "linearisation",
    "max-separable",
    "delay",
    "lure",
    "equilibrium",
    "accuracy",
)
D = vector("4 1")
V = vector("1 2")
R = matrix("2 1; 1 2")
RATE = 0.125
UNIT = matrix("1 0; 0 1")
UNIT_3 = matrix("1 0 0; 0 1 0; 0 0 1")
STRAIGHT = ranges("1 1, 0 0, 0 0; 0 0, 1 1, 0 0; 0 0, 0 0, 0 0")


def alike(rate: Any = RATE, id: str = "theorem1-weighted", **exact: Any) -> Document:
    weights = {"D": D, "w": {"G": V}, "c": "1/2", "R": R}
    return claim(id, "global", rate, weights | exact)


STILL = Dynamics(A=[[0]])


def linear(A: str, B: str | None = None) -> Dynamics:
    return Dynamics(A=matrix(A), B=None if B is None else matrix(B))


def pendulum(f: str) -> Dynamics:
    """x1'' = f and an input."""
    return Dynamics(f=["x2", f], B=matrix("0; 1"))


@cache
def problems() -> dict[str, Problem]:
    def line(**more: Any) -> Problem:
        return Problem(**{"network": LINE, "gains": {1: 1}} | DOUBLE | more)

    def alone(a: Any, coupling: Any = "y", gain: Any = None, **more: Any) -> Problem:
        dynamics = Dynamics(A=[[a]])
        return line(dynamics=dynamics, coupling=coupling, gains=gain and {1: gain}, **more)

    observer = Observer(W=[[2]])
    watched = {"exosystem": scalar(0), "observer": observer}
    flat = "-1 0; 0 -1"
    planar = {"dynamics": linear(flat), "coupling": "y", "target": [0, 0]}
    cubic = {"dynamics": Dynamics(f=["x - x**3"]), "coupling": "3*y", "gains": {1: 4}}
    stays: Document = {"stays_in": [-1, 1]}
    gains = {1: [[1, 0]]}
    drag = {"dynamics": linear("0 1; 0 -3", "0; 1"), "gains": gains, "coupling": "y1"}
    acts = {"uncertainty": {"disturbance": "1/10"}}
    wide = linear("-1 0 0; 0 -1 0; 0 0 -1", "1 0; 0 1; 0 0")
    target = [0, 0, 0]
    three = {"dynamics": wide, "coupling": ["y1", "y2"], "gains": None, "target": target}
    sines = {"network": BOTH_WAYS, "coupling": "sin(y)", "gains": "1/10", "region": WIDE}
    tanh = {"coupling": "tanh(y1)"}
    made: dict[str, Problem] = {}
    made["line"] = line()
    made["two modes"] = line(network=BOTH)
    backwards = {"optional": [[1, 2, "1/4"]], "arrow": "listens_to", "agents": 2}
    arcs = [[2, 1]]
    comes_and_goes = Network.from_arcs(arcs, **backwards)
    made["comes and goes"] = line(network=comes_and_goes)
    doubled = Dynamics(A=[["1/2"]], B=[[2]])
    made["two inputs a unit"] = alone("1/2", "-y", 1).replace(dynamics=doubled)
    made["seen"] = line(**watched)
    seen_by_both = Observer(W=matrix("1/2 2"))
    made["seen by both"] = line(exosystem=scalar(0), observer=seen_by_both)
    slow_observer = Observer(W=[["1/9"]])
    made["seen slowly"] = line(exosystem=scalar(0), observer=slow_observer)
    harmonic = Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0"))
    harmonic_observer = Observer(W=matrix("16/5; 12/5"))
    made["harmonic"] = line(exosystem=harmonic, observer=harmonic_observer)
    made["other gains"] = line(gains={1: [[1, 1]]})
    made["integrators"] = line(dynamics=None, target=[0, 0], coupling=["y1 + y2", "y2"])
    made["repelled"] = alone(1, "-y", [[-1]])
    made["held"] = alone("-3/4", "-y", [[-1]])
    made["irrational"] = alone(-9, "exp(1)*y")
    made["pushed"] = alone(-9, "y", [[-1]])
    falling = {(1, 0): "-y"}
    made["one falls"] = alone(-9, "y", exceptions=falling)
    made["unstable"] = alone("1/2", "y", 4)
    made["calm"] = alone(-2)
    made["kinked"] = alone(-2, "abs(y)")
    made["planar"] = line(**planar)
    made["turned"] = line(**planar | {"dynamics": linear(flat, "1 1; 0 1")})
    made["pendulum"] = line(dynamics=pendulum("-sin(x1) - x2"))
    straight = alone(0, "y", 1)
    bent = Dynamics(f=["-x - x**3"])
    made["bent"] = straight.replace(dynamics=bent)
    cubic_pull = Dynamics(f=["-x**3"])
    made["cubic pull"] = alone(0).replace(dynamics=cubic_pull)
    one_pinned = alone(0, gain=1)
    cubic_push = Dynamics(f=["x**3"])
    made["cubic push"] = one_pinned.replace(dynamics=cubic_push)
    made["second"] = line(**sines, dynamics=Dynamics(f=["-x**3"]))
    half = vector("-1/2 1/2")
    made["led"] = line(**cubic, leader=stays | {"initial": half})
    quarter = vector("-1/4 1/4")
    near_leader = stays | {"initial": quarter}
    made["led near"] = line(**cubic, leader=near_leader, region=asked(quarter))
    moving_leader = {"initial": [-1, 1]}
    made["led, unstable"] = alone("1/2", "y", 4, leader=moving_leader)
    made["second, still"] = line(**sines, dynamics=STILL)
    made["second, led"] = line(**sines, dynamics=STILL, leader={"initial": 0})
    leader_below = {"initial": [0, 3]}
    region_above = asked([1, 2])
    made["pushed off"] = alone(1, leader=leader_below, region=region_above)
    made["pushed elsewhere"] = alone(1, leader={"initial": [3, 4]}, region=asked([1, 2]))
    lone: Document = {"network": BOTH_WAYS, "region": asked([0, 1])}
    start_of_leader = {"initial": [0, 5]}
    made["apart"] = alone(0, **lone, leader=start_of_leader)
    start_of_leader_below = {"initial": [-5, 5]}
    made["apart elsewhere"] = alone(0, **lone, leader=start_of_leader_below, offsets={1: 3})
    made["drag"] = line(**drag)
    made["drag, seen"] = line(**drag, **watched)
    made["drag, pushed"] = line(**drag, **acts)
    made["drag, bent"] = line(**drag | tanh)
    made["drag, bent, seen"] = line(**drag | tanh, **watched)
    swing = pendulum("-sin(x1) - 3*x2")
    made["swinging"] = line(coupling="y1", gains=None, dynamics=swing)
    made["vectors"] = line(coupling=["y1*y2 + y1", "y2"], dynamics=None, target=[0, 0], gains=1)
    made["three"] = line(**three)
    made["three, pushed"] = line(**three, **acts)
    return made


@cache
def certified(problem: str) -> bytes:
    return certificate_bytes(consensus_claims(problems()[problem]))


def _made(
    name: str,
    code: int,
    what: str,
    check: Document | None,
    *,
    whole: Document = SAYS_NOTHING,
    **others: Document,
) -> Case:
    """The certificate of a small problem with this one claim of the topic, and the verdict that
    follows; ``whole``: changes of it, ``others``: of the check with an id."""
    document = json.loads(certified(name))
    document["checks"] = [each for each in document["checks"] if each["id"] not in OWN]
    if check is not None:
        document["checks"].append(check)
    for id, changes in others.items():
        bend(check_of(document, id), changes)

    theorem = "theorem1" if document["observer"]["W"] else "lemma1"
    best = fastest_proof(document, (*OWN[:4], "lure", theorem))
    refuted = False
    for each in document["checks"]:
        exact = each.get("exact") or {}
        refuted = refuted or exact.get("unstable_roots", "0") != "0"
    if check is not None and check["verdict"] == "refuted":
        best = None
        refuted = True
    # With [uncertainty] the verdict is about the plant that it states.
    if best is not None and check is not None and check["id"] == "accuracy":
        best = check
    conclude(document, best, refuted=refuted)
    if best is check:
        document.pop("factor", None)
    document |= whole
    data = canonical_bytes(problems()[name])
    return Case(f"{name}: {what}", json.dumps(document).encode(), data, code)


_FORGER = Forger(_made)
holds = _FORGER.holds
fails = _FORGER.fails
wrong = _FORGER.wrong


def unreadable(what: str, name: str, **changes: Any) -> Case:
    """The certificate of a problem beside its file with changes, so that it cannot be read;
    ``observer__W`` is W of the observer."""
    plain = holds(name, "", None)
    file = json.loads(plain.problem)
    for path, value in changes.items():
        *places, last = path.split("__")
        holder = file
        for place in places:
            holder = holder[place]
        bend(holder, {last: value})
    certificate = json.loads(plain.certificate)
    return about(file, certificate, name=f"{name}: {what}", code=UNREADABLE)


@collected
def dynamics_cases() -> Iterator[Case]:
    good = alike()
    yield holds("line", "by hand", good)
    yield holds("line", "no rate", alike(None))
    yield wrong("line", good, "the rate at which the matrix is singular", rate=0.25)
    yield wrong("line", good, "a rate below 0", rate=-0.125)
    yield wrong("line", good, "c too large for the network", rate=None, c="3/4")
    yield wrong("line", good, "c too small for R", rate=None, c="1/8")
    yield wrong("line", good, "w too steep", w={"G": vector("1 4")})
    yield wrong("line", good, "w too flat", w={"G": vector("1 1")})
    yield wrong("line", good, "another mode", w={"H": V})
    yield wrong("line", good, "a mode too many", w={"G": V, "H": V})
    yield wrong("line", good, "no positive D", D=vector("4 -1"))
    yield wrong("line", good, "weights for every component", D=vector("4 4 1 1"))
    yield wrong("line", good, "R is not symmetric", R=matrix("2 1; 11/10 2"))
    yield wrong("line", good, "R G is not symmetric", R=matrix("2 1; 1 3"))
    yield wrong("line", good, "R of another size", R=[["1"]])
    yield fails("line", "a key too many", alike(P=[["1"]]))
    yield wrong("line", good, "a margin", margin=1)
    yield wrong("line", good, "for several modes", id="theorem2-weighted")
    yield fails("line", "no values", claim("theorem1-weighted", "global", RATE, None))
    yield wrong("line", good, "no network of integrators", w={"G": ["1"] * 4}, D=["1"] * 4)
    # With w = (1, 3) N w = (1, 2), and the arc adds 4 g (2 - 3, -1); g = 1/4 leaves 0.
    pulled = alike(None, "theorem2-weighted", w={"G": vector("8 17")})
    yield holds("comes and goes", "by hand", pulled)
    yield wrong("comes and goes", pulled, "the arc pulls", w={"G": vector("1 3")})
    # Agent 2 has the slope 2 of B h and no gain: e_2' = (1/2 + 2) e_2, and 3/2 if B is left out.
    yield holds("two inputs a unit", "twice h", None)
    both = alike(id="theorem2-weighted", w={"A": V, "B": V})
    yield holds("two modes", "by hand", both)
    yield wrong("two modes", both, "one mode is missing", w={"A": V})
    yield wrong("two modes", both, "fails in the second", w={"A": V, "B": vector("1 4")})
    yield holds("seen", "by hand", good)
    yield holds("seen by both", "by hand", good)
    yield fails("seen slowly", "faster than the observer", good)
    yield holds("seen slowly", "as slow as the observer", changed(good, rate=0.0625))
    yield holds("harmonic", "by hand", good)
    yield fails("other gains", "no multiples of one matrix", good)
    yield fails("integrators", "of integrators", good)
    # R < 0 shows that e grows; with R > 0 and R G < 0 nothing follows: there e' = (M - 3/4) e.
    slow = changed(good, rate=None)
    yield wrong("repelled", slow, "R < 0", R=[["-1"]])
    yield wrong("held", slow, "R G < 0", R=[["1"]])
    weights = {"G": vector("2 1")}
    negative = changed(slow, D=vector("1 1"), w=weights, c="-1/2", R=[["1"]])
    yield fails("irrational", "a slope that is not rational", negative)
    yield wrong("pushed", negative, "a gain that pushes", c="-2")
    yield wrong("one falls", negative, "a slope that falls", c="-2")
    yield wrong("kinked", negative, "a kink", domain="consensus")
    # M = [[7/2, 0], [-1, 1/2]], N = D M + M'D = [[7, -1], [-1, 1]].
    even = claim("theorem1-weighted", "global", None, {"D": vector("1 1"), "w": {"G": V}})
    yield holds("unstable", "gains less than what the agents do", even)
    reached = {"verdict": "proved", "witness": GONE}
    yield fails("calm", "reached without a pin", None, reachability=reached)
    yield holds("calm", "without a pin", None)
    plain_rows = separable(box(1), 0.25, "1 1", "1/4", "1")
    yield fails("bent", "rows do not know what is left of f", plain_rows)
    yield fails("second", "an equilibrium that f moves", second_box())
    # Nobody is pinned, and x' = -x^3 comes to rest at the target; x' = x^3 - x leaves the box |e|
    # <= 10.
    yield holds("cubic pull", "undecided", None)
    yield fails("cubic pull", "refuted", None, whole={"verdict": "refuted"})
    rate_of_nothing = {"rho": "10", "rate": None}
    held = claim("safety", box(10), None, rate_of_nothing)
    yield fails("cubic push", "safe", held)
    yield from _coordinates()
    yield from _held()
    yield from _files()
    yield from _led()


def rows(low: str = "1", domain: Any = "global", rate: Any = 0.142, **exact: Any) -> Document:
    """Max-separable in coordinates, for gains of the arc between ``low`` and 1."""
    own: Document = {"T": matrix("1 0; 1 1/2"), "v": vector("4 3 8 7"), "alpha": "1/7"}
    own |= {"rho": None, "ranges": ranges(f"0 0, 0 0; {low} 1, 0 0")}
    return claim("max-separable", domain, rate, own | exact)


def ends(
    level: str = "1/10",
    first: Any = "2/5 7/5",
    second: Any = "4/5 3",
    *,
    domain: Any = "global",
    alpha: str = "1/14",
    **more: Any,
) -> Document:
    """Final bounds of both agents in these coordinates."""
    coordinates = rows()["exact"]
    stage = {"v": coordinates["v"], "alpha": alpha, "level": level, "rho": None}
    stage["ranges"] = coordinates["ranges"]
    bounds = {"1": vector(first), "2": vector(second)}
    exact = {"stages": [stage], "bounds": bounds, "T": coordinates["T"]}
    return claim("accuracy", domain, None, exact | more)


def bent_rows(
    radius: Any = 0.166, s: Any = 0, rho: str | None = "1/12", low: str = "3/4", **exact: Any
) -> Document:
    """Where tanh has at least the gain ``low``."""
    own = {"rate": 0.071, "alpha": "1/14", "rho": rho} | exact
    return rows(low, box(radius, s), **own)


def swings(
    low: str = "-3/4", one: str = "1", rho: str = "3/10", alpha: str = "3/20", **exact: Any
) -> Document:
    """Of pendulums; f has the gains ``one``, -1 to ``low``, and -3."""
    found = rows("1", box(0.6), 0.15, v=vector("4 3 4 3"), alpha=alpha, rho=rho, **exact)
    found["exact"]["ranges"] += ranges(f"0 0, {one} {one}; -1 {low}, -3 -3", 1)
    return found


def mixed(low: str = "37/50", high: str = "63/50", rho: str = "1/8") -> Document:
    """Of h = (y1 y2 + y1, y2), whose first slope is between ``low`` and ``high``."""
    gains = ranges(f"{low} {high}, -13/50 13/50; 0 0, 1 1")
    own = {"v": vector("1 1 1 1"), "alpha": "12/25", "rho": rho, "T": UNIT}
    return rows("1", box(0.125), 0.48, **own, ranges=gains)


def plane(second: str) -> Document:
    """Final bounds of three components with the weight ``second`` of the second."""
    v = vector(f"1 {second} 1")
    stage = {"v": v * 2, "alpha": "1/4", "level": "1/5", "rho": None, "ranges": STRAIGHT}
    ends = [str(Fraction(x) / 5) for x in v]
    bounds = {"1": ends, "2": ends}
    exact = {"stages": [stage], "bounds": bounds, "T": UNIT_3}
    return claim("accuracy", "global", None, exact)


def _coordinates() -> Iterator[Case]:
    good = rows()
    yield holds("drag", "by hand", good)
    yield wrong("drag", good, "alpha beyond the last row", alpha="1/6")
    yield wrong("drag", good, "a rate above alpha", rate=0.143)
    yield wrong("drag", good, "a rate of 0", rate=0)
    yield wrong("drag", good, "no rate", rate=None)
    yield wrong("drag", good, "v too flat", v=vector("4 3 8 8"))
    yield wrong("drag", good, "v of agents only", v=vector("4 8"))
    yield wrong("drag", good, "T is singular", T=matrix("1 0; 1 0"))
    yield wrong("drag", good, "T is the identity", T=matrix("1 0; 0 1"))
    yield wrong("drag", good, "T of another size", T=[["1"]])
    yield fails("drag", "gains that it does not have", rows(low="2"))
    yield fails("drag", "wider gains than the rows bear", rows(low="1/2"))
    yield holds("drag", "wider gains", rows(low="3/4", rate=0.07, alpha="1/14"))
    yield wrong("drag", good, "no gains", ranges=[])
    yield wrong("drag", good, "a box", domain=box(1))
    yield wrong("drag", good, "a rho, everywhere", rho="1")
    yield holds("drag", "a box with rho", rows(domain=box(2), rho="1"))
    yield wrong("drag", good, "the box leaves the set", domain=box(2.1), rho="1")
    yield fails("drag", "final bounds where nothing acts", ends())
    yield wrong("drag", good, "refuted", verdict="refuted")
    yield fails("drag", "a key too many", rows(P=[["1"]]))
    error = {"P": [["1/4"]], "beta": "2", "kappa": "1/4", "size": "1/4"}
    seen = rows(**error)
    yield holds("drag, seen", "by hand", seen)
    yield wrong("drag, seen", seen, "P is too small for T C", P=[["1/5"]])
    yield wrong("drag, seen", seen, "kappa is too small", kappa="1/6")
    yield wrong("drag, seen", seen, "kappa is negative", kappa="-1")
    yield fails("drag, seen", "no observer's part", good)
    yield holds("drag, bent", "by hand", bent_rows())
    yield wrong("drag, bent", bent_rows(), "everywhere", domain="global")
    yield wrong("drag, bent", bent_rows(), "without rho", rho=None, domain="global")
    yield fails("drag, bent", "gains that hold nearer only", bent_rows(rho="1/10"))
    flat = bent_rows(rho="1/10", low="69/100", rate=0.05, alpha="1/19")
    yield holds("drag, bent", "gains from 0.7 on", flat)
    yield fails("drag, bent", "the box leaves the set", bent_rows(0.167))
    yield holds("drag, bent, seen", "by hand", bent_rows(0.1, 0.26, **error))
    far = bent_rows(0.1, 0.27, **error)
    yield fails("drag, bent, seen", "the disturbance leaves the set", far)
    yield holds("swinging", "by hand", swings(alpha="1/6"))
    yield fails("swinging", "a larger gain of what is linear", swings(one="101/100"))
    yield fails("swinging", "a smaller gain of what is linear", swings(one="99/100"))
    yield fails("swinging", "gains of the sine that hold nearer only", swings(rho="13/40"))
    # agent 2 reaches 1.32, where sin(r)/r is 0.7338
    farther = vector("4 3 22/5 33/10")
    one = "gains of the sine that hold for agent 1 only"
    yield wrong("swinging", swings(), one, v=farther)
    yield fails("swinging", "alpha beyond the rows", swings(alpha="1/5"))
    yield fails("swinging", "no gains of f", swings(ranges=[]))
    yield fails("swinging", "the slope at the target for all", swings(low="-1"))
    yield holds("drag, pushed", "by hand", ends())
    yield fails("drag, pushed", "a level below what the rows bear", ends("99/1000"))
    above = ends("101/1000", "404/1000 1414/1000", "808/1000 303/100")
    yield holds("drag, pushed", "a level above", above)
    yield fails("drag, pushed", "bounds of a lower level", ends("101/1000"))
    yield fails("drag, pushed", "alpha that leaves no room", ends(alpha="1/13"))
    yield fails("drag, pushed", "a bound too small", ends(first="2/5 139/100"))
    single = {"1": "3", "2": vector("4/5 3")}
    yield wrong("drag, pushed", ends(), "one bound for both components", bounds=single)
    yield fails("drag, pushed", "a box", ends(domain=box(1)))
    yield fails("drag, pushed", "T is the identity", ends(T=matrix("1 0; 0 1")))
    free = ranges("0 1, 0 0, 0 0; 0 0, 0 1, 0 0; 0 0, 0 0, 0 0")
    three = rows(T=UNIT_3, v=vector("1 1 1 1 1 1"), alpha="1", rate=1, ranges=free)
    yield holds("three", "by hand", three)
    many = ranges("0 1, 0 1/99, 0 1/99; 0 1/99, 0 1, 0 1/99; 0 1/99, 0 0, 0 0")
    slow = {"alpha": "1/2", "rate": 0.5}
    yield wrong("three", three, "too many gains vary", ranges=many, **slow)
    # e_ic' = -e_ic + w_c for c = 1, 2 of agent 1, and w_3 = 0: level v_c > 1/10 there.
    yield holds("three, pushed", "by hand", plane("1"))
    yield fails("three, pushed", "the second component is pushed, too", plane("1/10"))
    yield holds("vectors", "by hand", mixed())
    yield fails("vectors", "slopes that it does not have", mixed("7/8", "9/8"))
    yield fails("vectors", "gains that hold nearer only", mixed(rho="1/7"))
    by_component = separable(box(1), 1, "1 1", "1", "1")
    yield fails("vectors", "no coordinates", by_component)


def _held() -> Iterator[Case]:
    """What would be true of integrators: values that are held, gains that are wrong by a part.  2
    hears 1, k = 5/2, A = 1/2: the rows hold for v = (1, 2) and alpha = 1/4, and so would those of a
    period of 1/4."""
    plain = holds("unstable", "rows", FAST)
    yield plain
    yield _beside(plain, "unstable: delay", HOLDS, LATE)
    held = claim("sampling", "global", None, {"period": "1/8", "factor": "31/32"})
    yield _beside(plain, "unstable: sampling", FAILS, held)
    off = {"weights": "1/100", "gains": "1/100", "alpha": "1/8"}
    yield _beside(plain, "unstable: tolerance", FAILS, claim("tolerance", "global", 0.125, off))


def _beside(plain: Case, name: str, code: int, check: Document) -> Case:
    """The certificate with one check more."""
    document = json.loads(plain.certificate)
    document["checks"].append(check)
    return Case(name, json.dumps(document).encode(), plain.problem, code)


FAST = separable("global", 0.25, "1 4", "1/4")
LATE = claim("delay", "global", 0.125, {"delay": "1/8", "rate": "1/8"})


def cubic(low: str = "-12", high: str = "11/10", **more: Any) -> Document:
    """Of "led": f' = 1 - 3 x^2 is in [-11, 1] for s in [-1, 1] and |e| <= 1.  With A = 1 and gains
    between -12 and 11/10 g0 = -6.45, D = 6.55, and with tau = 1/(2 D) the inequality has [[-5.8,
    3], [3, -3.8]] + 2 rate I."""
    form = {"method": "lure", "P_e": [[0, 0, "1"], [1, 1, "1"]], "level": "1", "radius": "1"}
    form |= {"ranges": ranges("3 3") + ranges(f"{low} {high}", 1)}
    form |= {"multipliers": {"G": vector("0 10/131 10/131")}, "rate": "1/4"}
    return claim("lure", ball(1), 0.25, form | more)


def _led() -> Iterator[Case]:
    """A leader that moves: claims for every s, and what would be true for one that rests."""
    yield holds("led", "by hand", cubic())
    yield fails("led", "slopes without the errors", cubic("-2"))
    yield fails("led", "slopes beyond", cubic(high="9/10"))
    yield fails("led", "a wider region of errors", cubic(radius="2", level="4"))
    everywhere = cubic(radius=None, level=None) | {"domain": "global"}
    yield fails("led", "everywhere", everywhere)
    yield holds("led near", "by hand", cubic())
    unstable = holds("led, unstable", "rows", FAST)
    yield unstable
    yield _beside(unstable, "led, unstable: late", FAILS, LATE)
    yield holds("second, still", "an equilibrium", second_box())
    yield fails("second, led", "an equilibrium", second_box())
    yield holds("pushed off", "the leader may start there", None)
    yield fails("pushed elsewhere", "refuted, though it starts elsewhere", None)
    yield fails("apart", "undecided, though nothing pulls", None)
    yield holds("apart elsewhere", "no common start", None)
    # Slopes at 0 alone: J - K = [[-3, 0], [3, -2]].
    yield fails("led", "at one point", claim("linearisation", "consensus", 0.5, None))
    weights = {"D": vector("1 1"), "w": {"G": V}}
    even = claim("theorem1-weighted", "consensus", None, weights)
    yield fails("led", "at one point", even)
    proved = {"verdict": "proved", "margin": 0.1, "reason": ""}
    yield fails("led", "at one point", cubic(), lemma1=proved)
    yield _led_by("no box", "led", stays_in=GONE)
    yield _led_by("a box without all starts", "led", initial=matrix("-3/2 1/2"))
    yield _led_by("a box that is left above", "led", stays_in=matrix("-1 1/2"))
    yield _led_by("a box that is left below", "led", stays_in=matrix("-1/2 1"))
    yield _led_by("a larger box", "led", stays_in=matrix("-2 2"))
    yield _led_by("starts farther away", "led near", initial=matrix("-1/2 1/2"))


def _led_by(what: str, name: str, **changes: Any) -> Case:
    """A certificate that held before the leader was changed."""
    plain = holds(name, "", cubic())
    file = json.loads(plain.problem)
    bend(file["leader"], changes)
    return about(file, json.loads(plain.certificate), name=f"{name}: {what}", code=FAILS)


def _files() -> Iterator[Case]:
    flat = {"A": matrix("-1 0; 0 -1")}
    yield unreadable("version 1", "line", version=1)
    yield unreadable("a version 2 of integrators", "integrators", version=2)
    yield unreadable("dynamics are no object", "line", dynamics=[])
    yield unreadable("no B", "line", dynamics__B=GONE)
    yield unreadable("B is no list", "line", dynamics__B={"0": 1})
    yield unreadable("B is a row", "line", dynamics__B=vector("1 0"))
    yield unreadable("A and f", "line", dynamics__f=["x2", "0"])
    yield unreadable("f in y", "pendulum", dynamics__f=["y2", "-sin(x1) - x2"])
    yield unreadable("f of x3", "pendulum", dynamics__f=["x2", "-sin(x3) - x2"])
    yield unreadable("f of x0", "pendulum", dynamics__f=["x2", "-sin(x0) - x2"])
    yield unreadable("f is one text", "pendulum", dynamics__f="x2")
    yield unreadable(
        "f is too long", "pendulum", dynamics__f=["x2" + " + 0*x1" * 300, "-sin(x1) - x2"]
    )
    yield unreadable("f is not rational at the target", "pendulum", target=vector("1 0"))
    yield unreadable("f has a kink", "pendulum", dynamics__f=["x2", "1 - abs(x1 - 1) - x2"])
    yield unreadable("f has an irrational slope", "pendulum", dynamics__f=["x2", "-exp(1)*x1 - x2"])
    yield unreadable(
        "f does not rest at the target", "pendulum", dynamics__f=["x2 + 1", "-sin(x1) - x2"]
    )
    yield unreadable("a formation of pendulums", "pendulum", offsets=[[1, vector("1 0")]])
    yield unreadable(
        "a leader of integrators", "integrators", leader={"initial": matrix("0 0; 0 0")}
    )
    yield unreadable("a leader and a target", "led", target=["1"])
    yield unreadable("a leader is null", "led", leader=None)
    yield unreadable("a leader without a start", "led", leader__initial=GONE)
    yield unreadable("a leader between wrong ends", "led", leader__initial=matrix("1/2 -1/2"))
    yield unreadable("a key too many of a leader", "led", leader__box=matrix("-1 1"))
    yield unreadable(
        "no inputs beside a leader",
        "led",
        dynamics={"f": ["x - x**3"], "B": [[]]},
        coupling__h=[],
        gains=[],
    )
    yield unreadable("A is not square", "line", dynamics__A=matrix("0 1"))
    yield unreadable("a key too many", "line", dynamics__C=[["1"]])
    yield unreadable(
        "no inputs", "planar", dynamics=flat | {"B": [[], []]}, coupling__h=[], gains=[]
    )
    yield unreadable("dependent columns", "planar", dynamics=flat | {"B": matrix("1 1; 0 0")})
    yield unreadable("a goal that nothing holds", "line", target=vector("0 1"))
    yield unreadable("an offset that nothing holds", "line", offsets=[[1, vector("0 1")]])
    yield unreadable("two expressions for one input", "line", coupling__h=["y1", "y2"])
    yield unreadable("one expression in y for two inputs", "three", coupling__h="y")
    yield unreadable("a gain of all components", "line", gains=[[0, matrix("1 0; 0 1")]])
    yield unreadable("W is a number", "seen", observer__W=2)
    yield unreadable("W is an object", "seen", observer__W={"0": ["1"]})
    yield unreadable("W of neither width", "seen", observer__W=matrix("1 0 0"))
    yield unreadable("C of all components", "seen", exosystem__C=matrix("1; 0"))
