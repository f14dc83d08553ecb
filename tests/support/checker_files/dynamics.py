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
from fractions import Fraction
from functools import cache
from typing import Any

from certified import consensus_claims
from texts import matrix, vector

from checker_files.files import (
    FAILS,
    GONE,
    HOLDS,
    UNREADABLE,
    Case,
    Document,
    about,
    bend,
    conclude,
    fastest_proof,
    network,
    scalar,
)
from checker_files.separable import claim, second_box
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.dynamics import Dynamics

LINE, BOTH = network([[2, 1]], agents=2), network({"A": [[2, 1]], "B": [[2, 1]]}, agents=2)
BOTH_WAYS, WIDE = network([[1, 2], [2, 1]], agents=2), {"initial_states": [-5, 5]}
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
D, V, R, RATE = vector("4 1"), vector("1 2"), matrix("2 1; 1 2"), 0.125
ALL_ONE = {"D": vector("1 1"), "w": {"G": vector("1 1")}}


def alike(rate: Any = RATE, id: str = "theorem1-weighted", **exact: Any) -> Document:
    return claim(id, "global", rate, {"D": D, "w": {"G": V}, "c": "1/2", "R": R} | exact)


@cache
def problems() -> dict[str, Problem]:
    def line(**more: Any) -> Problem:
        return Problem(**{"network": LINE, "gains": {1: 1}} | DOUBLE | more)

    def alone(a: Any, coupling: Any = "y", gain: Any = None, **more: Any) -> Problem:
        return line(dynamics=Dynamics(A=[[a]]), coupling=coupling, gains=gain and {1: gain}, **more)

    watched = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}
    planar = {"dynamics": Dynamics(A=matrix("-1 0; 0 -1")), "coupling": "y", "target": [0, 0]}
    turned = planar | {"dynamics": Dynamics(A=matrix("-1 0; 0 -1"), B=matrix("1 1; 0 1"))}
    wide = Dynamics(A=matrix("-1 0 0; 0 -1 0; 0 0 -1"), B=matrix("1 0; 0 1; 0 0"))
    cubic = {"dynamics": Dynamics(f=["x - x**3"]), "coupling": "3*y", "gains": {1: 4}}
    cubic["leader"] = {"initial": vector("-1/2 1/2"), "stays_in": [-1, 1]}
    near = {"initial": vector("-1/4 1/4"), "stays_in": [-1, 1]}
    still, at_0 = Dynamics(A=[[0]]), {"leader": {"initial": 0}}
    groups = Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0"))
    drag = {"dynamics": Dynamics(A=matrix("0 1; 0 -3"), B=matrix("0; 1")), "gains": {1: [[1, 0]]}}
    swing = Dynamics(f=["x2", "-sin(x1) - 3*x2"], B=matrix("0; 1"))
    return {
        "line": line(),
        "two modes": line(network=BOTH),
        "comes and goes": line(
            network=Network.from_arcs(
                [[2, 1]], arrow="listens_to", optional=[[1, 2, "1/4"]], agents=2
            )
        ),
        "two inputs a unit": alone("1/2", "-y", 1).replace(dynamics=Dynamics(A=[["1/2"]], B=[[2]])),
        "seen": line(**watched),
        "seen by both": line(exosystem=scalar(0), observer=Observer(W=matrix("1/2 2"))),
        "seen slowly": line(exosystem=scalar(0), observer=Observer(W=[["1/9"]])),
        "harmonic": line(exosystem=groups, observer=Observer(W=matrix("16/5; 12/5"))),
        "other gains": line(gains={1: [[1, 1]]}),
        "integrators": line(dynamics=None, target=[0, 0], coupling=["y1 + y2", "y2"]),
        "repelled": alone(1, "-y", [[-1]]),
        "held": alone("-3/4", "-y", [[-1]]),
        "irrational": alone(-9, "exp(1)*y"),
        "pushed": alone(-9, "y", [[-1]]),
        "one falls": alone(-9, "y", exceptions={(1, 0): "-y"}),
        "unstable": alone("1/2", "y", 4),
        "calm": alone(-2),
        "kinked": alone(-2, "abs(y)"),
        "planar": line(**planar),
        "turned": line(**turned),
        "pendulum": line(dynamics=Dynamics(f=["x2", "-sin(x1) - x2"], B=matrix("0; 1"))),
        "bent": alone(0, "y", 1).replace(dynamics=Dynamics(f=["-x - x**3"])),
        "cubic pull": alone(0).replace(dynamics=Dynamics(f=["-x**3"])),
        "cubic push": alone(0, gain=1).replace(dynamics=Dynamics(f=["x**3"])),
        "second": line(
            network=BOTH_WAYS,
            coupling="sin(y)",
            dynamics=Dynamics(f=["-x**3"]),
            gains="1/10",
            region=WIDE,
        ),
        "led": line(**cubic),
        "led near": line(
            **cubic | {"leader": near, "region": {"initial_states": vector("-1/4 1/4")}}
        ),
        "led, unstable": alone("1/2", "y", 4, leader={"initial": [-1, 1]}),
        "second, still": line(
            network=BOTH_WAYS, coupling="sin(y)", dynamics=still, gains="1/10", region=WIDE
        ),
        "second, led": line(
            network=BOTH_WAYS, coupling="sin(y)", dynamics=still, gains="1/10", region=WIDE, **at_0
        ),
        "pushed off": alone(1, leader={"initial": [0, 3]}, region={"initial_states": [1, 2]}),
        "pushed elsewhere": alone(1, leader={"initial": [3, 4]}, region={"initial_states": [1, 2]}),
        "apart": alone(
            0, network=BOTH_WAYS, leader={"initial": [0, 5]}, region={"initial_states": [0, 1]}
        ),
        "apart elsewhere": alone(
            0,
            network=BOTH_WAYS,
            leader={"initial": [-5, 5]},
            region={"initial_states": [0, 1]},
            offsets={1: 3},
        ),
        "drag": line(coupling="y1", **drag),
        "drag, seen": line(coupling="y1", **drag, **watched),
        "drag, pushed": line(coupling="y1", **drag, uncertainty={"disturbance": "1/10"}),
        "drag, bent": line(coupling="tanh(y1)", **drag),
        "drag, bent, seen": line(coupling="tanh(y1)", **drag, **watched),
        "swinging": line(coupling="y1", gains=None, dynamics=swing),
        "vectors": line(coupling=["y1*y2 + y1", "y2"], dynamics=None, target=[0, 0], gains=1),
        "three, pushed": line(
            dynamics=wide,
            coupling=["y1", "y2"],
            gains=None,
            target=[0, 0, 0],
            uncertainty={"disturbance": "1/10"},
        ),
        "three": line(dynamics=wide, coupling=["y1", "y2"], gains=None, target=[0, 0, 0]),
    }


@cache
def certified(problem: str) -> bytes:
    return certificate_bytes(consensus_claims(problems()[problem]))


def case(
    name: str, problem: str, check: Document | None, code: int, *more: tuple[str, Document]
) -> Case:
    """The certificate of a small problem with this one claim of the topic, and the verdict that
    follows; ``more``: changes of the check with an id."""
    document = json.loads(certified(problem))
    document["checks"] = [each for each in document["checks"] if each["id"] not in OWN]
    if check is not None:
        document["checks"].append(check)
    for id, changes in more:
        bend(next(each for each in document["checks"] if each["id"] == id), changes)

    theorem = "theorem1" if document["observer"]["W"] else "lemma1"
    best = fastest_proof(document, (*OWN[:4], "lure", theorem))
    counts = [(each.get("exact") or {}).get("unstable_roots", "0") for each in document["checks"]]
    refuted = any(count != "0" for count in counts)
    if check is not None and check["verdict"] == "refuted":
        best, refuted = None, True
    # With [uncertainty] the verdict is about the plant that it states.
    if best is not None and check is not None and check["id"] == "accuracy":
        best = check
    conclude(document, best, refuted=refuted)
    if best is check:
        document.pop("factor", None)
    data = canonical_bytes(problems()[problem])
    return Case(f"{problem}: {name}", json.dumps(document).encode(), data, code)


def changed(name: str, problem: str, code: int = UNREADABLE, **changes: Any) -> Case:
    """The certificate of a problem beside its file with changes; "observer.W" is W of the
    observer."""
    plain = case("", problem, None, HOLDS)
    file, certificate = json.loads(plain.problem), json.loads(plain.certificate)
    for path, value in changes.items():
        *places, last = path.split("__")
        holder = file
        for place in places:
            holder = holder[place]
        bend(holder, {last: value})
    return about(file, certificate, name=f"{problem}: {name}", code=code)


@cache
def dynamics_cases() -> list[Case]:
    one, negative = (
        {"R": [["1"]]},
        {"D": vector("1 1"), "w": {"G": vector("2 1")}, "c": "-1/2", "R": [["1"]]},
    )
    both = {"A": V, "B": V}
    lines = [
        ("by hand", alike(), HOLDS),
        ("no rate", alike(None), HOLDS),
        ("the rate at which the matrix is singular", alike(0.25), FAILS),
        ("a rate below 0", alike(-0.125), FAILS),
        ("c too large for the network", alike(None, c="3/4"), FAILS),
        ("c too small for R", alike(None, c="1/8"), FAILS),
        ("w too steep", alike(w={"G": vector("1 4")}), FAILS),
        ("w too flat", alike(w={"G": vector("1 1")}), FAILS),
        ("another mode", alike(w={"H": V}), FAILS),
        ("a mode too many", alike(w={"G": V, "H": V}), FAILS),
        ("no positive D", alike(D=vector("4 -1")), FAILS),
        ("weights for every component", alike(D=vector("4 4 1 1")), FAILS),
        ("R is not symmetric", alike(R=matrix("2 1; 11/10 2")), FAILS),
        ("R G is not symmetric", alike(R=matrix("2 1; 1 3")), FAILS),
        ("R of another size", alike(**one), FAILS),
        ("a key too many", alike(P=[["1"]]), FAILS),
        ("a margin", alike() | {"margin": 1}, FAILS),
        ("for several modes", alike(id="theorem2-weighted"), FAILS),
        ("no values", {key: value for key, value in alike().items() if key != "exact"}, FAILS),
        ("no network of integrators", alike(w={"G": ["1"] * 4}, D=["1"] * 4), FAILS),
    ]
    found = [case(name, "line", check, code) for name, check, code in lines]
    # With w = (1, 3) N w = (1, 2), and the arc adds 4 g (2 - 3, -1); g = 1/4 leaves 0.
    for name, w, code in (
        ("by hand", vector("8 17"), HOLDS),
        ("the arc pulls", vector("1 3"), FAILS),
    ):
        found.append(
            case(name, "comes and goes", alike(None, "theorem2-weighted", w={"G": w}), code)
        )
    # Agent 2 has the slope 2 of B h and no gain: e_2' = (1/2 + 2) e_2, and 3/2 if B is left out.
    found.append(case("twice h", "two inputs a unit", None, HOLDS))
    found += [
        case("by hand", "two modes", alike(id="theorem2-weighted", w=both), HOLDS),
        case("one mode is missing", "two modes", alike(id="theorem2-weighted", w={"A": V}), FAILS),
        case(
            "fails in the second",
            "two modes",
            alike(id="theorem2-weighted", w=both | {"B": vector("1 4")}),
            FAILS,
        ),
        case("by hand", "seen", alike(), HOLDS),
        case("by hand", "seen by both", alike(), HOLDS),
        case("faster than the observer", "seen slowly", alike(), FAILS),
        case("as slow as the observer", "seen slowly", alike(0.0625), HOLDS),
        case("by hand", "harmonic", alike(), HOLDS),
        case("no multiples of one matrix", "other gains", alike(), FAILS),
        case("of integrators", "integrators", alike(), FAILS),
        # R < 0 shows that e grows; with R > 0 and R G < 0 nothing follows: there e' = (M - 3/4) e.
        case("R < 0", "repelled", alike(None, R=[["-1"]]), FAILS),
        case("R G < 0", "held", alike(None, **one), FAILS),
        case("a slope that is not rational", "irrational", alike(None, **negative), FAILS),
        case("a gain that pushes", "pushed", alike(None, **negative | {"c": "-2"}), FAILS),
        case("a slope that falls", "one falls", alike(None, **negative | {"c": "-2"}), FAILS),
        case("a kink", "kinked", alike(None, **negative) | {"domain": "consensus"}, FAILS),
        # M = [[7/2, 0], [-1, 1/2]], N = D M + M'D = [[7, -1], [-1, 1]].
        case(
            "gains less than what the agents do",
            "unstable",
            claim("theorem1-weighted", "global", None, ALL_ONE | {"w": {"G": vector("1 2")}}),
            HOLDS,
        ),
        case(
            "reached without a pin",
            "calm",
            None,
            FAILS,
            ("reachability", {"verdict": "proved", "witness": GONE}),
        ),
        case("without a pin", "calm", None, HOLDS),
    ]
    box = {"kind": "box", "radius": 1, "disturbance": 0}
    rows = claim("max-separable", box, 0.25, {"v": vector("1 1"), "alpha": "1/4", "rho": "1"})
    found.append(case("rows do not know what is left of f", "bent", rows, FAILS))
    found.append(case("an equilibrium that f moves", "second", second_box(), FAILS))
    # Nobody is pinned, and x' = -x^3 comes to rest at the target; x' = x^3 - x leaves the box |e|
    # <= 10.
    pulled = case("undecided", "cubic pull", None, HOLDS)
    refuted = json.loads(pulled.certificate) | {"verdict": "refuted"}
    found += [
        pulled,
        Case("cubic pull: refuted", json.dumps(refuted).encode(), pulled.problem, FAILS),
    ]
    held = claim("safety", box | {"radius": 10}, None, {"rho": "10", "rate": None})
    found.append(case("safe", "cubic push", held, FAILS))
    return [*found, *_coordinates(), *_held(), *_files(), *_led()]


def rows(low: str = "1", domain: Any = "global", rate: Any = 0.142, **exact: Any) -> Document:
    """Max-separable in coordinates, for gains of the arc between ``low`` and 1."""
    T, gains = matrix("1 0; 1 1/2"), [matrix("0 0; 0 0"), [[low, "1"], vector("0 0")]]
    own: Document = {"T": T, "v": vector("4 3 8 7"), "alpha": "1/7", "rho": None}
    return claim(
        "max-separable", domain, rate, own | {"ranges": [{"coupling": 0, "gains": gains}]} | exact
    )


def ends(
    level: str = "1/10", *bounds: Any, domain: Any = "global", alpha: str = "1/14", **more: Any
) -> Document:
    """Final bounds in these coordinates."""
    exact = rows("1")["exact"]
    stage = {
        "v": exact["v"],
        "alpha": alpha,
        "level": level,
        "rho": None,
        "ranges": exact["ranges"],
    }
    told = {"1": vector("2/5 7/5"), "2": vector("4/5 3")} | dict(zip("12", bounds, strict=False))
    return claim(
        "accuracy", domain, None, {"stages": [stage], "bounds": told, "T": exact["T"]} | more
    )


def _coordinates() -> list[Case]:
    def box(radius: Any, disturbance: Any = 0) -> Document:
        return {"kind": "box", "radius": radius, "disturbance": disturbance}

    def bent(
        radius: Any = 0.166,
        s: Any = 0,
        rho: str = "1/12",
        rate: Any = 0.071,
        low: str = "3/4",
        **exact: Any,
    ) -> Document:
        return rows(low, box(radius, s), rate, **{"alpha": "1/14", "rho": rho} | exact)

    def swings(
        rho: str = "3/10", alpha: str = "3/20", low: str = "-3/4", one: str = "1", **exact: Any
    ) -> Document:
        found = rows("1", box(0.6), 0.15, v=vector("4 3") * 2, alpha=alpha, rho=rho, **exact)
        own = [[vector("0 0"), [one, one]], [["-1", low], vector("-3 -3")]]
        found["exact"]["ranges"] = [*found["exact"]["ranges"], {"coupling": 1, "gains": own}]
        return found

    def mixed(low: str = "37/50", high: str = "63/50", rho: str = "1/8") -> Document:
        gains = [[[low, high], vector("-13/50 13/50")], matrix("0 0; 1 1")]
        one = {"v": ["1"] * 4, "alpha": "12/25", "rho": rho, "T": matrix("1 0; 0 1")}
        return rows("1", box(0.125), 0.48, **one, ranges=[{"coupling": 0, "gains": gains}])

    nothing, error = matrix("0 0") * 3, {"P": [["1/4"]], "beta": "2", "kappa": "1/4", "size": "1/4"}
    free = [
        {
            "coupling": 0,
            "gains": [
                [vector("0 1"), *nothing[:2]],
                [nothing[0], vector("0 1"), nothing[0]],
                nothing,
            ],
        }
    ]
    many = [
        {
            "coupling": 0,
            "gains": [
                [vector("0 1"), *matrix("0 1/99") * 2],
                matrix("0 1/99; 0 1; 0 1/99"),
                [vector("0 1/99"), *nothing[:2]],
            ],
        }
    ]
    unit = [["1" if a == b else "0" for b in range(3)] for a in range(3)]
    straight = [
        {
            "coupling": 0,
            "gains": [
                [vector("1 1"), *nothing[:2]],
                [nothing[0], vector("1 1"), nothing[0]],
                nothing,
            ],
        }
    ]

    farther = swings()  # agent 2 reaches 1.32, where sin(r)/r is 0.7338
    farther["exact"]["v"] = vector("4 3 22/5 33/10")

    def plane(second: str) -> Document:
        v = ["1", second, "1"]
        stage = {"v": v * 2, "alpha": "1/4", "level": "1/5", "rho": None, "ranges": straight}
        ends = [str(Fraction(x) / 5) for x in v]
        return claim(
            "accuracy",
            "global",
            None,
            {"stages": [stage], "bounds": {"1": ends, "2": ends}, "T": unit},
        )

    found = {
        "drag": [
            ("by hand", rows(), HOLDS),
            ("alpha beyond the last row", rows(alpha="1/6"), FAILS),
            ("a rate above alpha", rows(rate=0.143), FAILS),
            ("a rate of 0", rows(rate=0), FAILS),
            ("no rate", rows(rate=None), FAILS),
            ("v too flat", rows(v=vector("4 3 8 8")), FAILS),
            ("v of agents only", rows(v=vector("4 8")), FAILS),
            ("T is singular", rows(T=matrix("1 0; 1 0")), FAILS),
            ("T is the identity", rows(T=matrix("1 0; 0 1")), FAILS),
            ("T of another size", rows(T=[["1"]]), FAILS),
            ("gains that it does not have", rows(low="2"), FAILS),
            ("wider gains than the rows bear", rows(low="1/2"), FAILS),
            ("wider gains", rows(low="3/4", rate=0.07, alpha="1/14"), HOLDS),
            ("no gains", rows(ranges=[]), FAILS),
            ("a box", rows(domain=box(1)), FAILS),
            ("a rho, everywhere", rows(rho="1"), FAILS),
            ("a box with rho", rows(domain=box(2), rho="1"), HOLDS),
            ("the box leaves the set", rows(domain=box(2.1), rho="1"), FAILS),
            ("final bounds where nothing acts", ends(), FAILS),
            ("refuted", rows() | {"verdict": "refuted"}, FAILS),
            ("a key too many", rows(P=[["1"]]), FAILS),
        ],
        "drag, seen": [
            ("by hand", rows(**error), HOLDS),
            ("P is too small for T C", rows(**error | {"P": [["1/5"]]}), FAILS),
            ("kappa is too small", rows(**error | {"kappa": "1/6"}), FAILS),
            ("kappa is negative", rows(**error | {"kappa": "-1"}), FAILS),
            ("no observer's part", rows(), FAILS),
        ],
        "drag, bent": [
            ("by hand", bent(), HOLDS),
            ("everywhere", bent() | {"domain": "global"}, FAILS),
            ("without rho", bent(rho=None) | {"domain": "global"}, FAILS),
            ("gains that hold nearer only", bent(rho="1/10"), FAILS),
            ("gains from 0.7 on", bent(rho="1/10", low="69/100", rate=0.05, alpha="1/19"), HOLDS),
            ("the box leaves the set", bent(0.167), FAILS),
        ],
        "drag, bent, seen": [
            ("by hand", bent(0.1, 0.26, **error), HOLDS),
            ("the disturbance leaves the set", bent(0.1, 0.27, **error), FAILS),
        ],
        "swinging": [
            ("by hand", swings(alpha="1/6"), HOLDS),
            ("a larger gain of what is linear", swings(one="101/100"), FAILS),
            ("a smaller gain of what is linear", swings(one="99/100"), FAILS),
            ("gains of the sine that hold nearer only", swings(rho="13/40"), FAILS),
            ("gains of the sine that hold for agent 1 only", farther, FAILS),
            ("alpha beyond the rows", swings(alpha="1/5"), FAILS),
            ("no gains of f", swings(ranges=[]), FAILS),
            ("the slope at the target for all", swings(low="-1"), FAILS),
        ],
        "drag, pushed": [
            ("by hand", ends(), HOLDS),
            ("a level below what the rows bear", ends("99/1000"), FAILS),
            (
                "a level above",
                ends("101/1000", vector("404/1000 1414/1000"), vector("808/1000 303/100")),
                HOLDS,
            ),
            ("bounds of a lower level", ends("101/1000"), FAILS),
            ("alpha that leaves no room", ends(alpha="1/13"), FAILS),
            ("a bound too small", ends("1/10", vector("2/5 139/100")), FAILS),
            ("one bound for both components", ends("1/10", "3"), FAILS),
            ("a box", ends(domain=box(1)), FAILS),
            ("T is the identity", ends(T=matrix("1 0; 0 1")), FAILS),
        ],
        "three": [
            ("by hand", rows(T=unit, v=["1"] * 6, alpha="1", rate=1, ranges=free), HOLDS),
            (
                "too many gains vary",
                rows(T=unit, v=["1"] * 6, alpha="1/2", rate=0.5, ranges=many),
                FAILS,
            ),
        ],
        # e_ic' = -e_ic + w_c for c = 1, 2 of agent 1, and w_3 = 0: level v_c > 1/10 there.
        "three, pushed": [
            ("by hand", plane("1"), HOLDS),
            ("the second component is pushed, too", plane("1/10"), FAILS),
        ],
        "vectors": [
            ("by hand", mixed(), HOLDS),
            ("slopes that it does not have", mixed("7/8", "9/8"), FAILS),
            ("gains that hold nearer only", mixed(rho="1/7"), FAILS),
            (
                "no coordinates",
                claim("max-separable", box(1), 1, {"v": vector("1 1"), "alpha": "1", "rho": "1"}),
                FAILS,
            ),
        ],
    }
    return [
        case(name, problem, check, code)
        for problem, some in found.items()
        for name, check, code in some
    ]


def _held() -> list[Case]:
    """What would be true of integrators: values that are held, gains that are wrong by a part.  2
    hears 1, k = 5/2, A = 1/2: the rows hold for v = (1, 2) and alpha = 1/4, and so would those of a
    period of 1/4."""
    plain = case(
        "rows",
        "unstable",
        claim("max-separable", "global", 0.25, {"v": vector("1 4"), "alpha": "1/4", "rho": None}),
        HOLDS,
    )
    found = [plain]
    for more in (
        claim("delay", "global", 0.125, {"delay": "1/8", "rate": "1/8"}),
        claim("sampling", "global", None, {"period": "1/8", "factor": "31/32"}),
        claim("tolerance", "global", 0.125, {"weights": "1/100", "gains": "1/100", "alpha": "1/8"}),
    ):
        document = json.loads(plain.certificate)
        document["checks"].append(more)
        code = HOLDS if more["id"] == "delay" else FAILS
        found.append(
            Case(f"unstable: {more['id']}", json.dumps(document).encode(), plain.problem, code)
        )
    return found


def cubic(low: str = "-12", high: str = "11/10", **more: Any) -> Document:
    """Of "led": f' = 1 - 3 x^2 is in [-11, 1] for s in [-1, 1] and |e| <= 1.  With A = 1 and gains
    between -12 and 11/10 g0 = -6.45, D = 6.55, and with tau = 1/(2 D) the inequality has [[-5.8,
    3], [3, -3.8]] + 2 rate I."""
    ranges = [{"coupling": 0, "gains": [matrix("3 3")]}, {"coupling": 1, "gains": [[[low, high]]]}]
    form = {
        "method": "lure",
        "P_e": [[0, 0, "1"], [1, 1, "1"]],
        "level": "1",
        "radius": "1",
        "ranges": ranges,
    }
    taus = {"multipliers": {"G": vector("0 10/131 10/131")}, "rate": "1/4"}
    return claim("lure", {"kind": "ball", "radius": 1, "disturbance": 0}, 0.25, form | taus | more)


def _led() -> list[Case]:
    """A leader that moves: claims for every s, and what would be true for one that rests."""
    found = [
        case("by hand", "led", cubic(), HOLDS),
        case("slopes without the errors", "led", cubic("-2"), FAILS),
        case("slopes beyond", "led", cubic(high="9/10"), FAILS),
        case("a wider region of errors", "led", cubic(radius="2", level="4"), FAILS),
        case("everywhere", "led", cubic(radius=None, level=None) | {"domain": "global"}, FAILS),
        case("by hand", "led near", cubic(), HOLDS),
        case(
            "rows",
            "led, unstable",
            claim(
                "max-separable", "global", 0.25, {"v": vector("1 4"), "alpha": "1/4", "rho": None}
            ),
            HOLDS,
        ),
        case("an equilibrium", "second, still", second_box(), HOLDS),
        case("an equilibrium", "second, led", second_box(), FAILS),
        case("the leader may start there", "pushed off", None, HOLDS),
        case("refuted, though it starts elsewhere", "pushed elsewhere", None, FAILS),
        case("undecided, though nothing pulls", "apart", None, FAILS),
        case("no common start", "apart elsewhere", None, HOLDS),
        # Slopes at 0 alone: J - K = [[-3, 0], [3, -2]].
        case("at one point", "led", claim("linearisation", "consensus", 0.5, None), FAILS),
        case(
            "at one point",
            "led",
            claim("theorem1-weighted", "consensus", None, ALL_ONE | {"w": {"G": V}}),
            FAILS,
        ),
        case(
            "at one point",
            "led",
            cubic(),
            FAILS,
            ("lemma1", {"verdict": "proved", "margin": 0.1, "reason": ""}),
        ),
    ]
    late = json.loads(found[6].certificate)
    late["checks"].append(claim("delay", "global", 0.125, {"delay": "1/8", "rate": "1/8"}))
    found.append(Case("led, unstable: late", json.dumps(late).encode(), found[6].problem, FAILS))
    for name, problem, changes in (
        ("no box", "led", {"stays_in": GONE}),
        ("a box without all starts", "led", {"initial": matrix("-3/2 1/2")}),
        ("a box that is left above", "led", {"stays_in": matrix("-1 1/2")}),
        ("a box that is left below", "led", {"stays_in": matrix("-1/2 1")}),
        ("a larger box", "led", {"stays_in": matrix("-2 2")}),
        ("starts farther away", "led near", {"initial": matrix("-1/2 1/2")}),
    ):
        plain = case("", problem, cubic(), HOLDS)
        file = json.loads(plain.problem)
        bend(file["leader"], changes)
        found.append(
            about(file, json.loads(plain.certificate), name=f"{problem}: {name}", code=FAILS)
        )
    return found


def _files() -> list[Case]:
    flat = {"A": matrix("-1 0; 0 -1")}
    return [
        changed("version 1", "line", version=1),
        changed("a version 2 of integrators", "integrators", version=2),
        changed("dynamics are no object", "line", dynamics=[]),
        changed("no B", "line", dynamics__B=GONE),
        changed("B is no list", "line", dynamics__B={"0": 1}),
        changed("B is a row", "line", dynamics__B=vector("1 0")),
        changed("A and f", "line", dynamics__f=["x2", "0"]),
        changed("f in y", "pendulum", dynamics__f=["y2", "-sin(x1) - x2"]),
        changed("f of x3", "pendulum", dynamics__f=["x2", "-sin(x3) - x2"]),
        changed("f of x0", "pendulum", dynamics__f=["x2", "-sin(x0) - x2"]),
        changed("f is one text", "pendulum", dynamics__f="x2"),
        changed("f is too long", "pendulum", dynamics__f=["x2" + " + 0*x1" * 300, "-sin(x1) - x2"]),
        changed("f is not rational at the target", "pendulum", target=vector("1 0")),
        changed("f has a kink", "pendulum", dynamics__f=["x2", "1 - abs(x1 - 1) - x2"]),
        changed("f has an irrational slope", "pendulum", dynamics__f=["x2", "-exp(1)*x1 - x2"]),
        changed(
            "f does not rest at the target", "pendulum", dynamics__f=["x2 + 1", "-sin(x1) - x2"]
        ),
        changed("a formation of pendulums", "pendulum", offsets=[[1, vector("1 0")]]),
        changed("a leader of integrators", "integrators", leader={"initial": matrix("0 0; 0 0")}),
        changed("a leader and a target", "led", target=["1"]),
        changed("a leader is null", "led", leader=None),
        changed("a leader without a start", "led", leader__initial=GONE),
        changed("a leader between wrong ends", "led", leader__initial=matrix("1/2 -1/2")),
        changed("a key too many of a leader", "led", leader__box=matrix("-1 1")),
        changed(
            "no inputs beside a leader",
            "led",
            dynamics={"f": ["x - x**3"], "B": [[]]},
            coupling__h=[],
            gains=[],
        ),
        changed("A is not square", "line", dynamics__A=matrix("0 1")),
        changed("a key too many", "line", dynamics__C=[["1"]]),
        changed("no inputs", "planar", dynamics=flat | {"B": [[], []]}, coupling__h=[], gains=[]),
        changed("dependent columns", "planar", dynamics=flat | {"B": matrix("1 1; 0 0")}),
        changed("a goal that nothing holds", "line", target=vector("0 1")),
        changed("an offset that nothing holds", "line", offsets=[[1, vector("0 1")]]),
        changed("two expressions for one input", "line", coupling__h=["y1", "y2"]),
        changed("one expression in y for two inputs", "three", coupling__h="y"),
        changed("a gain of all components", "line", gains=[[0, matrix("1 0; 0 1")]]),
        changed("W is a number", "seen", observer__W=2),
        changed("W is an object", "seen", observer__W={"0": ["1"]}),
        changed("W of neither width", "seen", observer__W=matrix("1 0 0")),
        changed("C of all components", "seen", exosystem__C=matrix("1; 0")),
    ]
