"""Late, held, lost and triggered readings and processors for the lone checker: claims written by
hand, and twins that just fail.

The known answers are those of the theory: the paper's network with the coupling 2 y, where M v = 1
for the v below and slopes and gains of an agent add up to 7 at most; and exosystems of one state,
whose errors fall by 1 - 2 T from sample to sample.
"""

import json
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from math import e, exp, log
from typing import Any

import numpy as np
from certified import consensus_claims
from texts import matrix, vector

from checker_files.files import (
    GONE,
    UNREADABLE,
    Case,
    Document,
    Forger,
    bend,
    changed,
    check_of,
    collected,
    network,
    scalar,
)
from checker_files.separable import (
    GLOBAL,
    LINE_NET,
    REFUTED,
    UNDECIDED,
    asked,
    box,
    claim,
    claimed_in,
    given,
    separable,
    weights,
)
from checker_files.settling import LINE, PAID, SHARES, bent, last, settling, tube
from dobc_design import Dynamics, Exosystem, Network, Observer, Problem, load_problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem.canonical import canonical_bytes

PAPER = load_problem("paper-fixed")
GAINS = {PAPER.network.labels[i]: gain for i, gain in PAPER.pinning.gains.items()}
V = "1 3 5/2 2 3/2 1 3 5/2 2 3/2"
WAVE: Document = {
    "exosystem": Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0")),
    "observer": Observer(W=matrix("16/5; 12/5")),
}
#: A - W C = -2.
CONSTANT: Document = {"exosystem": scalar(0), "observer": Observer(W=[[2]])}


def readings(domain: Any, rate: Any, v: str, alpha: Any, rho: Any = None, **more: Any) -> Document:
    return claim("readings", domain, rate, weights(v, str(alpha), rho, **more))


def paper(alpha: Any, rate: float, **more: Any) -> Document:
    return readings(GLOBAL, rate, V, alpha, **more)


def late(**table: Any) -> Document:
    return {"readings": table}


def ticks(period: Any, **table: Any) -> Document:
    more = late(**table) if table else {}
    return {"processor": {"period": period}} | more


STEPS: Document = {"time": "discrete"}


#: What takes 1.0000005 of the limit leaves 0.4 or less of it; Q T <= 1 with Q = 4.
CUT = (
    ("saturated, ticks", "1.401", "1/4"),
    ("saturated, less left", "1.4", "1/4"),
    ("saturated, longer", "1.401", "0.2501"),
)


def _limit(limit: Any, **more: Any) -> Document:
    return {"actuators": {"limit": limit, "saturates": True} | more}


def _acting(delay: str, **more: Any) -> Document:
    return {"actuators": {"delay": delay} | more}


def _cut(limit: Any, **more: Any) -> Document:
    known = {"amplitude": "1/2"} if "processor" in more else {}
    return given("tanh(y)", **_limit(limit, **known) | more)


def _rooms(domain: Any, room: Any) -> Document:
    return claim("actuators", domain, None, {"rooms": dict.fromkeys("12", str(room))})


def _settings() -> dict[str, Document]:
    whole: Document = {"network": PAPER.network, "coupling": "2*y", "gains": GAINS}
    cubes = given("exp(y) - 1 + y")
    near: Document = {"region": asked(1, "1/2")}
    planar = given("tanh(y)", target=[0, 0], region=asked([[-1, 1], [-1, 1]]))
    crossed = {1: [[2, 1], [-1, 3]], 2: [[2, 1], [-1, 3]]}
    one_each = network({"A": [[1, 2]], "B": [[2, 1]]})
    turned = Network.from_arcs(
        {"A": [[2, 1]], "B": [[2, 1, -1]]}, arrow="listens_to", agents=2, negative="opposes"
    )
    ring = network([[1, 2], [2, 3], [3, 1]])
    agree: Document = {"network": ring, "coupling": "y", "goal": "agreement"}
    led = {"leader": {"initial": ["-1/2", "1/2"]}}
    alone: Document = {"network": network([], agents=1), "coupling": "y", "gains": 1}
    found: dict[str, Document] = {}
    for name, tables in TIMES.items():
        found[name] = whole | tables
    found["no tables"] = whole
    waves = whole | WAVE
    found["wave, own"] = waves | late(own_delay="1/50")
    found["wave, now"] = waves | late()
    found["wave, held"] = waves | late(own_delay="1/28", period="1/28")
    for name, period in RADII:
        found[name] = alone | WAVE | ticks(period)
    found["calm wave"] = alone | WAVE | ticks("3") | {"region": asked(1, 0), "coupling": "tanh(y)"}
    found["constant"] = alone | CONSTANT | near | ticks("1/10")
    found["constant, line"] = given("tanh(y)", gains=1, **CONSTANT, **near, **ticks("1/20"))
    found["constant, late"] = alone | CONSTANT | ticks("1/10", own_delay="1/10")
    bad = {"observer": Observer(W=[[21]])}
    found["constant, bad W"] = alone | CONSTANT | bad | ticks("1/10")
    stepped = {"exosystem": scalar(1), "observer": Observer(W=[["1/2"]])}
    found["steps"] = alone | stepped | {"gains": "1/4"} | STEPS
    for a in ("1/2", "-2", "-1/2"):
        seen = {"exosystem": scalar(a, 0), "observer": Observer(W=[[0]])}
        found[f"unseen {a}"] = alone | seen | {"gains": "1/4"} | STEPS
    found["unseen 1/2, flow"] = (
        alone
        | {
            "exosystem": scalar("1/2", 0),
            "observer": Observer(W=[[0]]),
        }
        | late()
    )
    found["pair"] = cubes | late(own_delay="0.0322")
    found["pair, later"] = cubes | late(own_delay="0.0324")
    found["pair, held"] = cubes | late(period="3/25")
    found["pair, held longer"] = cubes | late(period="0.1315")
    found["sine"] = given("sin(y)", **late(own_delay="1/20"))
    found["falling"] = given("-y/4", **late(own_delay="1/20"))
    found["planar"] = planar | {"gains": crossed} | late(own_delay="1/100")
    found["planar, held"] = planar | {"gains": crossed} | late(period="1/10")
    found["planar, event"] = planar | {"gains": crossed} | late(event="1/10")
    found["nodes"] = given("y", dynamics=Dynamics(A=[[-1]]), **late(delay="1/10"))
    found["nodes, own"] = given("y", dynamics=Dynamics(A=[[-1]]), **late(own_delay="1/100"))
    found["nodes, held"] = given("y", dynamics=Dynamics(A=[[-1]]), **late(period="1/100"))
    moves = given("y", dynamics=Dynamics(A=[[-1]]), region=None, **led)
    found["led"] = moves | late()
    found["led, late"] = moves | late(delay="1/10")
    for name, table in UNCERTAIN.items():
        found[name] = alone | {"uncertainty": table} | late(own_delay="1/5")
    blind = {"uncertainty": UNCERTAIN["gains"] | {"known_to_agents": False}}
    found["blind"] = found["gains"] | blind
    found["watched"] = found["gains"] | CONSTANT
    found["blind, watched"] = found["watched"] | blind
    found["limited"] = given("tanh(y)", actuators={"limit": 9}, **late())
    found["saturated"] = _cut(1, **late(own_delay="0.0919"))
    found["saturated, later"] = _cut(1, **late(own_delay="0.0921"))
    half = CONSTANT | {"region": asked("1/2", "1/2")}
    for name, limit, period in CUT:
        found[name] = _cut(limit, **half, **ticks(period))
    known = {"simulation": {"xi0": [0]}, "observer": Observer(W=[["1/2"]])}
    found["saturated, steps"] = _cut(9, **half | known | {"gains": "1/4"} | STEPS)
    for delay in ("0.0919", "0.092"):
        found[f"acting {delay} late"] = given("tanh(y)", **_acting(delay))
    for own in ("0.0418", "0.042"):
        found[f"acting late, own {own}"] = given(
            "tanh(y)", **_acting("1/20"), **late(own_delay=own)
        )
    growing = {
        "exosystem": scalar(1),
        "observer": Observer(W=[[3]]),
        "region": asked("1/2", "1/10"),
    }
    found["acting late, watched"] = given("tanh(y)", **growing | _acting("1/20", amplitude="1/2"))
    found["acting late, drifting"] = given("tanh(y)", **growing | _acting("1/20", amplitude="0.51"))
    found["acting late, unknown"] = given("tanh(y)", **growing | _acting("1/20"))
    for period in ("1/16", "0.0626"):
        found[f"acting at {period}"] = given("tanh(y)", **_acting(period), **ticks(period))
    watched = growing | _acting("1/20", amplitude="1/2") | ticks("1/40")
    found["acting two ticks late"] = given("tanh(y)", **watched)
    # c F = (0, 2) and F^2 = 0
    rising = {"exosystem": Exosystem(A=matrix("0 2; 0 0"), C=matrix("1 0"))}
    rising |= {"observer": Observer(W=matrix("0; 0")), "region": asked("1/2", "1/10")}
    found["saturated, rising"] = given("tanh(y)", **_limit(1, amplitude="1/2"), **rising, **STEPS)
    found["saturated, far"] = given("0*y", **_limit(9, amplitude=9), **half, **late(period=1))
    found["nodes, far"] = given("y", dynamics=Dynamics(A=[[-1]]), **late(period=3))
    unstable = {"dynamics": Dynamics(A=[[1]]), "gains": {1: "1/2"}, "region": None}
    found["growing nodes, held"] = given("y", **unstable, **late(period="1/100"))
    found["growing nodes, late"] = given("y", **unstable, **late(delay="1/100"))
    found["unstable"] = given("-y", gains="1/10", region=None, **late(delay=1))
    two = {"network": network([], agents=2), "gains": 1, "region": None}
    for period in ("0.99", "1.01"):
        found[f"one step of {period} late"] = given("y", **two, **_acting(period), **ticks(period))
    found["twice"] = given("y", **two, **late(delay=2, own_delay=2))
    found["amplitude"] = given("tanh(y)", actuators={"amplitude": 1}, **late())
    found["at once"] = alone | {"gains": 10} | ticks("1/10")
    found["designed"] = alone | {"exosystem": scalar(0)} | ticks("1/10")
    found["on the circle"] = alone | CONSTANT | {"observer": Observer(W=[[20]])} | ticks("1/10")
    found["modes"] = given("y", network=one_each, gains=1, **late(own_delay="1/10"))
    found["modes, far"] = given("y", network=one_each, gains=1, **late(period=3))
    found["line, far"] = given("y", network=LINE_NET, gains=1, **late(period="2.1"))
    found["line, late"] = given("y", network=LINE_NET, gains=1, **late(delay="1/10"))
    found["curved, far"] = given("tanh(y)", network=LINE_NET, gains=1, **late(period="2.1"))
    found["signs"] = given("y", network=turned, gains={1: 1}, **late(own_delay="1/10"))
    found["signs, far"] = given("y", network=turned, gains={1: 1}, **late(period=3))
    found["agreeing, held"] = agree | late(period="1/2")
    found["agreeing, held longer"] = agree | late(period="0.51")
    found["agreeing, late"] = agree | late(event="1/100")
    found["agreeing, watched"] = agree | CONSTANT | ticks("1/10")
    found["no region"] = given("tanh(y)", region=None, **late(own_delay="1/20"))
    apart = {"network": network([], agents=2), "gains": {1: 1}}
    found["apart, processor"] = given("y", **apart, **ticks("1/10"))
    return found


UNCERTAIN: dict[str, Document] = {
    "gains": {"gains": "1/10"},
    "pushed": {"disturbance": "1/10"},
    "noisy": {"measurement": "1/10"},
    "drifting": {"drift": "1/10"},
}
LATER = {"delay": "1/4", "period": "1/10", "lost": 2, "event": "1/100"}
#: Problems of the paper's network.
TIMES: dict[str, Document] = {
    "now": late(),
    "half a second": late(delay="1/2"),
    "three seconds": late(delay=3),
    "tenths": late(event="1/10"),
    "lost": late(**LATER),
    "own": late(own_delay="0.052553"),
    "own, later": late(own_delay="0.052555"),
    "held": late(period="1/7"),
    "held, later": late(period="0.142858"),
    "processor": ticks("1/7"),
    "processor, later": ticks("0.142858"),
    "one tick": ticks("1/28", own_delay="1/28"),
    "one tick, more": ticks("1/28", own_delay="0.0358"),
    "two ticks": late(period="4/189", own_delay="0.03"),
    "two ticks, later": late(period="0.021165", own_delay="0.03"),
    "margin": late(delay="0.22286", own_delay=1),
    "less than the margin": late(delay="0.2228", own_delay=1),
    "neighbours alone": late(delay=5),
    "held, margin": late(period="0.28372"),
    "held, less than the margin": late(period="0.283718"),
}
#: By name the period; and the largest eigenvalue in size of the paper's observer, sampled.
RADII = (
    ("wave 0.05", "1/20"),
    ("wave 0.1", "1/10"),
    ("wave 0.2", "1/5"),
    ("wave 0.5585", "0.5585"),
    ("wave 0.5587", "0.5587"),
    ("wave 3", "3"),
    ("wave 3.3", "33/10"),
    ("wave 3.7001", "3.7001"),
    ("wave 3.7003", "3.7003"),
)
SIZES = {"wave 0.05": 0.919925, "wave 0.1": 0.840267, "wave 0.2": 0.686773, "wave 3.3": 0.7492}
STAYS = ("wave 0.5587", "wave 3", "wave 3.7003")


@cache
def _frames() -> dict[str, tuple[bytes, bytes]]:
    """Certificates of what is true at the target, and the problems."""
    frames = {}
    for name, settings in _settings().items():
        problem = Problem(**settings)
        document = json.loads(certificate_bytes(consensus_claims(problem)))
        document["checks"] = [
            check for check in document["checks"] if KINDS[check["id"]].role != "region"
        ]
        if document["verdict"] == "proved":
            document |= UNDECIDED | {"factor": None}
        frames[name] = json.dumps(document).encode(), canonical_bytes(problem)
    return frames


def made(name: str, code: int, what: str, *checks: Document, **overall: Any) -> Case:
    data, problem = _frames()[name]
    return Case(f"{name}: {what}", claimed_in(data, *checks, **overall), problem, code)


FORGER = Forger(made, title=lambda check: "with")
holds, fails, wrong, each_wrong = FORGER.holds, FORGER.fails, FORGER.wrong, FORGER.each_wrong


#: Boxes that stay as they are hold with late readings, too; what takes over is of the same instant.
#: |e|^2 <= 2, and 1 + 2 ln 14.15 = 6.299; or V never rises.
STILL = tube("0 1", "1 1; 1 1")
ARCS = last("arc-wise", SHARES | {"level": "2.1"}, "1.415", "1")
GRAPHS = last("schedule", {"phases": [], "rate": None, "rho": None}, "1", "1")
RESTING = {
    "arcs": bent(PAID, tube=STILL, last=ARCS, time="6.3"),
    "graphs": settling(box(1), "1", "1", STILL, GRAPHS),
}


@collected
def readings_cases() -> Iterator[Case]:
    """All of them."""
    yield from _pages()
    yield from _refuted()
    yield from _observed()
    yield from _observers()
    yield from _curved()
    yield from _others()
    yield from _saturated()
    yield from _acting_late()
    yield from _frames_of_others()
    yield from _unreadable()


THIRD = paper("1/3", 0.3333)


def _pages() -> Iterator[Case]:
    """lambda: 2 (5/2 theta - 3) = -3 lambda at agent 2."""
    yield holds("now", "a third", THIRD)
    yield wrong("now", THIRD, alpha="0.333334")
    yield wrong("now", THIRD, rate=0.33334)
    yield wrong("now", THIRD, rate=None, says=UNDECIDED)
    yield wrong("now", THIRD, rate=0, says=UNDECIDED)
    for k, factor in ((1, "0.999999"), (2, "1.000001"), (6, "0.999999"), (7, "1.000001")):
        entries = V.split()
        entries[k] = str(Fraction(entries[k]) * Fraction(factor))
        yield wrong("now", THIRD, f"v {k} times {factor}", v=entries)
    yield fails("no tables", "nothing is stated", THIRD)
    slowest = ((0.0490401, "three seconds"), (0.1781041, "half a second"))
    for rate, name in slowest:
        alpha = f"{rate:.6f}"
        beyond = f"{rate + 1e-6:.6f}"
        yield holds(name, "known", paper(alpha, rate - 1e-4))
        yield fails(name, "beyond", paper(beyond, rate - 1e-4))
    yield holds("tenths", "an event", paper("1/6", 0.1666))
    yield fails("tenths", "beyond", paper("0.166668", 0.1666))
    # ceil(5/2) + 2 ticks: the root of 5.05 (1 - alpha/10)^-5 = 6 - 3 alpha
    yield holds("lost", "five ticks", paper("0.1679", 0.16))
    yield fails("lost", "beyond", paper("0.168", 0.16))
    for name in ("own", "held", "processor", "one tick", "two ticks"):
        yield holds(name, "free", THIRD)
    for name in ("own, later", "held, later", "processor, later", "two ticks, later"):
        yield fails(name, "it overshoots", THIRD)
    yield fails("one tick, more", "two ticks", THIRD)
    yield holds("at once", "a tenth of a thousandth", readings(GLOBAL, 9, "1", "9.999"))
    yield fails("at once", "nothing is left", readings(GLOBAL, 9, "1", "10"))


def _refuted() -> Iterator[Case]:
    """The exact margins of one delay in everything, and of holding."""
    for name, code in (("margin", 0), ("less than the margin", 1), ("neighbours alone", 1)):
        yield made(name, code, "diverges", diverging(*first_to_turn()), **REFUTED)
    x, y = first_to_turn()
    bent = (
        ("elsewhere", diverging(x + 5, y)),
        ("no place", diverging()),
        ("a place of three", diverging(x, y, y)),
        ("a rate", diverging(x, y) | {"rate": 0.1}),
        ("a value", diverging(x, y) | {"exact": {"tau": "1/2"}}),
        ("another kind", diverging(x, y, kind="start")),
    )
    for what, check in bent:
        yield fails("margin", what, check, **REFUTED)
    yield fails("margin", "says nothing", diverging(x, y), **UNDECIDED)
    yield holds("held, margin", "overshoots", diverging(), **REFUTED)
    yield fails("held, margin", "a place", diverging(x, y), **REFUTED)
    yield fails("held, less than the margin", "overshoots", diverging(), **REFUTED)
    yield holds("line, far", "overshoots", diverging(), **REFUTED)
    for name in ("modes, far", "signs, far", "agreeing, held longer", "nodes, far"):
        yield fails(name, "overshoots", diverging(), **REFUTED)
    near = diverging() | {"domain": "consensus"}
    yield fails("curved, far", "overshoots", near, **REFUTED)
    yield fails("unstable", "known at once", diverging(-1.9, 0), **REFUTED)
    for x, code in ((1, 0), (1.000001, 0), (-1, 1)):
        yield made("twice", code, f"a double one near {x}", diverging(x, 0), **REFUTED)
    yield holds("growing nodes, held", "of the flow", **UNDECIDED)
    yield holds("growing nodes, late", "of the flow", **REFUTED)


@cache
def first_to_turn() -> tuple[float, float]:
    """The eigenvalue of M with the least margin."""
    rows = np.zeros((10, 10))
    for i, j, w in PAPER.network.modes["Ga"]:
        rows[i, i] += 2 * float(w)
        rows[i, j] -= 2 * float(w)
    for i, gain in PAPER.pinning.gains.items():
        rows[i, i] += float(gain[0][0])
    roots = np.linalg.eigvals(rows)
    least = min(roots, key=lambda mu: (np.pi / 2 - abs(np.angle(mu))) / abs(mu))
    return float(least.real), float(least.imag)


def diverging(*values: float, kind: str = "eigenvalue") -> Document:
    texts = [str(Fraction(x)) for x in values]
    witness = {"kind": kind, "values": texts}
    return claim("readings", GLOBAL, None, None, verdict="refuted", witness=witness)


# P of the page on regions, for beta = 1/2
SHARP: Document = {"P": matrix("2 -1; -1 4/3"), "beta": "1/2", "size": "3"}
ONE: Document = {"P": [["1.000001"]], "size": "1.000001"}


def _observed() -> Iterator[Case]:
    """kappa min v (beta - alpha - Q (g - 1)) = 1, Q = 7 and alpha = 1/10."""
    beta, T = 0.5, 1 / 28
    lefts = {
        "wave, now": beta - 0.1,
        "wave, own": beta - 0.1 - 7 * (exp(beta / 50) - 1),
        "wave, held": (1 - exp(-beta * T)) / T - 0.1 - 7 * (exp(beta * T) - 1),
    }
    for name, left in lefts.items():
        enough = paper("1/10", 0.1, **SHARP, kappa=f"{1 / left + 1e-6:.9f}")
        yield holds(name, "kappa", enough)
        yield wrong(name, enough, "less", kappa=f"{1 / left - 1e-6:.9f}")
        yield from each_wrong(
            name,
            enough,
            size=["2.3"],
            beta=["1.6"],
            alpha=["0.101"],
            P=[matrix("2 -1; -1 1/4"), matrix("2 -1; 0 4/3"), matrix("1 -1/2; -1/2 2/3")],
        )
        yield wrong(name, enough, "no P", P=GONE)
    # F = 4/5, alpha = 1/2: kappa (2 - 1/2) = 1
    sampled = readings(
        box(1, 0.5), 0.5, "1", "1/2", "1.34", **ONE, beta="1.999999", kappa="0.66667"
    )
    yield holds("constant", "sampled", _everywhere(sampled))
    yield from each_wrong(
        "constant",
        _everywhere(sampled),
        kappa=["0.66666"],
        beta=["2.000001", "19"],
        size=["0.99"],
        P=[[["0.99"]]],
    )
    # within rho: 1 + kappa / 2
    box_of = sampled | {"exact": sampled["exact"] | {"v": vector("1 1")}}
    yield holds("constant, line", "a box", box_of)
    yield wrong("constant, line", box_of, rho="1.333")
    yield wrong("constant, line", box_of, domain=box(1.01, 0.5))
    yield wrong("constant, line", box_of, domain=box(1, 0.52))
    # one tick: g = 1/(1 - T beta) = 5/4, Q = 1
    after = _everywhere(sampled, kappa="0.8001")
    yield holds("constant, late", "a tick", after)
    yield wrong("constant, late", after, "less", kappa="0.7999")
    # x+ = x - x/4 + C eps, F = 1/2
    steps = _everywhere(sampled, beta="1/2", alpha="1/8", rate=0.125, kappa="8/3")
    steps["exact"] |= {"P": [["1"]], "size": "1"}
    yield holds("steps", "exactly", steps)
    yield from each_wrong(
        "steps", steps, kappa=["2.6666"], beta=["0.5001"], size=["0.999"], P=[[["0.999"]]]
    )


def _everywhere(check: Document, rate: float = 0.5, **more: str) -> Document:
    exact = check["exact"] | {"rho": None} | more
    return check | {"domain": GLOBAL, "rate": rate, "exact": exact}


def _observers() -> Iterator[Case]:
    """Jury's table."""
    for name, period in RADII:
        document = json.loads(_frames()[name][0])
        found = check_of(document, "hurwitz")
        stays = name in STAYS
        assert found["verdict"] == ("refuted" if stays else "proved")
        yield holds(name, "as it is", **REFUTED if stays else UNDECIDED)
        if stays:
            turned = {"verdict": "proved", "reason": ""}
            yield _with(name, "hurwitz", turned, **UNDECIDED)
            yield fails(name, "open", **UNDECIDED)
            continue
        yield _with(name, "hurwitz", {"verdict": "refuted", "rate": None}, **REFUTED)
        yield _with(name, "hurwitz", {"verdict": "refuted", "rate": 9})
        if name in SIZES:
            rate = -log(SIZES[name]) / float(Fraction(period))
            near = 1e-4 if name != "wave 3.3" else 1e-3
            yield _with(name, "hurwitz", {"rate": round(rate - near, 6)}, code=0)
            yield _with(name, "hurwitz", {"rate": round(rate + near, 6)})
        yield _with(name, "hurwitz", {"exact": {"routh": ["1"]}})
        flow = {"verdict": "proved", "margin": 0, "rate": 0.5, "mode": "G"}
        yield _with(name, "lemma1", flow)
    yield holds("calm wave", "exact from the start", **UNDECIDED)
    yield holds("constant, bad W", "1 - 21/10", **REFUTED)
    yield holds("on the circle", "open", **UNDECIDED)
    yield _with("on the circle", "hurwitz", {"verdict": "refuted"})
    yield _with("designed", "hurwitz", {}, code=0)
    yield _with("designed", "hurwitz", {}, observer=dict.fromkeys(("W", "source", "P", "Q")))
    # unseen: |a| < 1
    for a, code in (("1/2", 0), ("-1/2", 0), ("-2", 1)):
        document = json.loads(_frames()[f"unseen {a}"][0])
        told = check_of(document, "detectability")["verdict"]
        assert told == ("refuted" if code else "proved")
        yield holds(f"unseen {a}", "as it is", **UNDECIDED)
    fades = {"verdict": "proved", "witness": GONE, "exact": {"unobservable_polynomial": "s + 2"}}
    yield _with("unseen -2", "detectability", fades)
    yield holds("unseen 1/2, flow", "it grows", **UNDECIDED)


def _with(name: str, id: str, changes: Document, *, code: int = 1, **overall: Any) -> Case:
    """A check of the frame, changed."""
    data, problem = _frames()[name]
    document = json.loads(data)
    bend(check_of(document, id), changes)
    document |= UNDECIDED | {"factor": None} | overall
    what = f"{name}: {id} with {str(changes)[:50]}"
    return Case(what, json.dumps(document).encode(), problem, code)


def _curved() -> Iterator[Case]:
    """h' = 1 + exp(y) <= 1 + e^2 on |y| <= 2, k = 3: 1/(e Q) = 0.032301; held, 4.61 + 3."""
    assert 0.0322 < 1 / (e * (4 + exp(2))) < 0.0324
    three = readings(box(1), 3, "1 1", "3", "1")
    for name in ("pair", "pair, held"):
        yield holds(name, "free", three)
        yield wrong(name, three, alpha="3.0001")
        yield wrong(name, three, domain=box(1.001))
        yield wrong(name, three, domain="global")
        yield wrong(name, three, rho="0.999")
        yield wrong(name, three, "a witness", witness={"kind": "eigenvalue", "values": []})
        yield wrong(name, three, v=["1", "2"])
    for name in ("pair, later", "pair, held longer"):
        yield fails(name, "it overshoots", three)
    # on |y| <= 2 the sine turns
    yield fails("sine", "it falls", three)
    small = readings(box(0.7), 3, "1 1", "3", "0.7")
    yield holds("sine", "it rises", small, **UNDECIDED)
    yield fails("falling", "linear and falling", readings(GLOBAL, 1, "1 1", "1"))
    near = readings(box(0.7), 3, "1 1", "3", "0.7")
    yield holds("no region", "near the target", near)
    # k_cc - |k_cd| = 1
    crossed = readings(box(1), 1, "1 1", "1", "1")
    yield holds("planar, held", "a step", crossed)
    slower = readings(box(1), 0.7, "1 1", "0.7", "1")
    yield holds("planar, event", "neighbours", slower)
    yield fails("planar", "one's own", crossed)


def _others() -> Iterator[Case]:
    free = readings(GLOBAL, 1, "1 1", "1")
    for name in ("nodes", "modes", "signs"):
        rate = {"nodes": 3.5, "modes": 0.9, "signs": 0.5}[name]
        v = "1 2" if name == "signs" else "1 1"
        good = readings(GLOBAL, rate, v, str(rate))
        yield holds(name, "free", good)
        yield wrong(name, good, "too fast", alpha="4.1", rate=rate)
    for name in ("nodes, own", "nodes, held"):
        yield fails(name, "they move by themselves", free)
    yield holds("led", "now", free)
    yield fails("led, late", "it moves on", free)
    # rows with 9/10; 11/10/5 <= 1/e
    less = readings(GLOBAL, 0.9, "1", "9/10")
    yield holds("gains", "less", less)
    yield wrong("gains", less, alpha="0.9001")
    for name in UNCERTAIN:
        if name != "gains":
            yield fails(name, "not counted", readings(GLOBAL, 0.5, "1", "1/2"))
    yield holds("blind", "nobody watches", less)
    # 2 - 1/2 - 11/10 (exp(2/5) - 1) = 0.959
    seen = readings(GLOBAL, 0.5, "1", "1/2")
    seen["exact"] |= {"P": [["1"]], "beta": "2", "kappa": "1.05", "size": "1"}
    yield holds("watched", "counted", seen)
    yield fails("blind, watched", "not counted", seen)
    wide = readings(box(1), 2.9, "1 1", "2.9", "1")
    yield holds("amplitude", "no limit", wide)
    late_nodes = claim("delay", GLOBAL, 1, {"delay": "1/10", "rate": "1", "own_delay": "1/100"})
    flow = separable(GLOBAL, 3.5, "1 1", "3.5")
    there = readings(GLOBAL, 3.5, "1 1", "3.5")
    yield holds("nodes", "neighbours", there, flow, changed(late_nodes, own_delay="0"))
    yield fails("nodes", "their own", there, flow, late_nodes)
    yield fails("limited", "not counted", wide, **UNDECIDED)
    yield fails("line, late", "a tube", LINE, **UNDECIDED)
    for what, check in RESTING.items():
        yield fails("line, late", f"boxes at rest, then {what}", check, **UNDECIDED)
    # pairs: 1 of each agent
    ones = "1 1 1 1 1 1"
    rings = readings(GLOBAL, 1, ones, "1")
    yield holds("agreeing, held", "pairs", rings)
    for name in ("agreeing, held longer", "agreeing, late"):
        yield fails(name, "pairs", rings)
    both: Document = {"P": [["4.0001"]], "beta": "1.999", "size": "4.0001", "kappa": "1.0011"}
    watched = readings(GLOBAL, 1, ones, "1", **both)
    yield holds("agreeing, watched", "two errors", watched)
    yield from each_wrong("agreeing, watched", watched, P=[[["3.99"]]], kappa=["0.999"])
    yield holds("apart, processor", "agent 2 hears nobody", **REFUTED)


def _saturated() -> Iterator[Case]:
    """min(3 s, room) where s = 1; slopes and gain of an agent add up to 4, whatever is cut."""
    slow = readings(box(1), 0.99, "1 1", "0.99", "1")
    all_of_it = _rooms(box(1), 1)
    yield holds("saturated", "a part of its pin", slow, all_of_it)
    yield fails("saturated", "nothing is said of its limit", slow)
    yield fails("saturated", "its whole pin", changed(slow, alpha="1.01"), all_of_it)
    yield fails("saturated, later", "1/(4 e)", slow, all_of_it)
    held = claim("sampling", box(1), None, {"period": "1/4", "factor": "0.7525"})
    flow = separable(box(1), 0.99, "1 1", "0.99", "1")
    yield holds("saturated", "a step", slow, all_of_it, flow, held)
    far = changed(held, period="0.2501")
    yield fails("saturated", "a step that is too long", slow, all_of_it, flow, far)
    # eps+ = (1 - 2 T) eps: 1/2 + 1/2 of the limit compensates
    seen: Document = {"P": [["1.0001"]], "beta": "1.99", "kappa": "0.63", "size": "1.0001"}
    there = box(0.5, 0.5)
    ticking = readings(there, 0.4, "1 1", "0.4", "1", **seen)
    room = _rooms(there, "0.399999")
    for name, limit, _ in CUT:
        good = name == "saturated, ticks"
        left = room if limit != "1.4" else _rooms(there, "0.3999994")
        yield made(name, 0 if good else 1, "an observer", ticking, left)
    yield fails("saturated, ticks", "more than is left", ticking, _rooms(there, "0.42"))
    yield fails("saturated, steps", "no amplitude", _rooms(there, "0.1"))
    # 1 - 1/2 - 2/10
    for room, code in (("0.2999", 0), ("0.3", 1)):
        rooms = _rooms(box(0.5, 0.1), room)
        yield made("saturated, rising", code, "the second sample", rooms, **UNDECIDED)
    overshooting = diverging() | {"domain": "consensus"}
    yield fails("saturated, far", "about the target", overshooting, **REFUTED)


def _acting_late() -> Iterator[Case]:
    """Slopes and gain add up to 4, and 4 (delay + own_delay) <= 1/e; exp(2.5/20) = 1.13315."""
    slow = readings(box(1), 2, "1 1", "2", "1")
    yield holds("acting 0.0919 late", "1/(4 e)", slow)
    yield fails("acting 0.092 late", "1/(4 e)", slow)
    faster = readings(box(1), 2.5, "1 1", "2.5", "1")
    kept = {"factor": 1.1332}
    yield made("acting late, own 0.0418", 0, "ages add up", faster | kept, **kept)
    yield fails("acting late, own 0.0418", "before it acts", faster | {"factor": 1.133})
    yield fails("acting late, own 0.042", "ages add up", faster)
    # F = -2, c = exp(1/20), g = exp(0.095), so that 1.9 - 1/2 - 4 (g - 1) = 1.0013
    seen: Document = {"P": [["1.1053"]], "beta": "1.9", "kappa": "1", "size": "1.1053"}
    there = box(0.5, 0.1)
    # 1/2 + 1/40 + 0.1 sqrt(1.1053) + 4 g/40 = 0.7401
    good = readings(there, 0.5, "1 1", "1/2", "0.7403", **seen)
    yield holds("acting late, watched", "c exp(A delay)", good)
    drifting = good | {"factor": 1000}
    yield fails("acting late, watched", "no factor of what drifts", drifting, factor=1000)
    smaller: Document = {"rho": ["0.74"], "kappa": ["0.9986"], "beta": ["1.898"]}
    yield from each_wrong("acting late, watched", good, P=[[["1.1051"]]], **smaller)
    for name in ("drifting", "unknown"):
        yield fails(f"acting late, {name}", "as far as it drifts before", good)
    # a tick, 4 T <= 1/4; z^2 - z + T has a root of size sqrt(T)
    yield holds("acting at 1/16", "a quarter", slow)
    yield fails("acting at 0.0626", "a quarter", slow)
    yield holds("one step of 1.01 late", "the product of its roots", diverging(), **REFUTED)
    yield fails("one step of 0.99 late", "the product of its roots", diverging(), **REFUTED)
    # (1 - F)/T = 2.0252, c = 1.06453, g = (1 - T beta)^-2 = 1.1095: 2.025 - 1/2 - 4 (g - 1) = 1.087
    ticking: Document = {"P": [["1.1333"]], "beta": "2.025", "kappa": "0.9201", "size": "1.1333"}
    # 1/2 + 1/40 + 0.1 sqrt(1.1333) kappa + 4 g kappa/40 = 0.72504
    good = readings(there, 0.5, "1 1", "1/2", "0.7251", **ticking)
    yield holds("acting two ticks late", "c exp(A delay)", good)
    less: Document = {"rho": ["0.725"], "kappa": ["0.9199"], "beta": ["2.0253"]}
    yield from each_wrong("acting two ticks late", good, P=[[["1.1332"]]], **less)


def _frames_of_others() -> Iterator[Case]:
    """What else is claimed, and what it answers."""
    boxed = separable(box(1), 3, "1 1", "3", "1")
    three = readings(box(1), 3, "1 1", "3", "1")
    yield holds("pair", "another plant", boxed, **UNDECIDED)
    yield fails("pair", "another plant answers", boxed)
    yield holds("pair", "both", three, boxed)
    # the sooner one is not about late readings
    slow = readings(box(1), 0.5, "1 1", "1/2", "1")
    yield holds("pair", "the slower one counts", slow, boxed, rate=0.5, covered_by="readings")
    yield fails("pair", "the faster one counts", slow, boxed, rate=3, covered_by="max-separable")
    beside = claim("delay", box(1), 0.1, {"delay": "1/10", "rate": "1/10", "own_delay": "1/50"})
    yield holds("pair", "beside", three, boxed, beside)
    for more in ({"own_delay": "1/20"}, {"event": "9"}, {"own_delay": "-1"}, {"event": "-1/10"}):
        yield wrong("pair", beside, beside=(three, boxed), **more)
    everywhere = separable(GLOBAL, 0.3, V, "0.3")
    yield fails("processor", "a flow", THIRD, everywhere)
    yield holds("held", "beside", THIRD, everywhere)


def _late_inputs(delay: str, **more: Any) -> Document:
    return {"actuators": {"limit": None, "amplitude": None, "delay": delay} | more}


def _unreadable() -> Iterator[Case]:
    """What a problem may not say."""
    now = {"delay": "0", "own_delay": "0", "lost": 0, "event": "0"}
    bent: dict[str, Document] = {
        "a negative delay": {"readings": now | {"delay": "-1"}},
        "a negative own delay": {"readings": now | {"own_delay": "-1"}},
        "a negative event": {"readings": now | {"event": "-1/2"}},
        "an event of all": {"readings": now | {"event": "1"}},
        "no event": {"readings": {key: now[key] for key in ("delay", "own_delay", "lost")}},
        "another key": {"readings": now | {"jitter": "1"}},
        "a negative count": {"readings": now | {"lost": -1, "period": "1"}},
        "half a reading": {"readings": now | {"lost": "1/2", "period": "1"}},
        "too many": {"readings": now | {"lost": 1001, "period": "1"}},
        "older than 1000 ticks": {"readings": now | {"own_delay": "1001", "period": "1"}},
        "lost at no tick": {"readings": now | {"lost": 1}},
        "a period of 0": {"readings": now | {"period": "0"}},
        "no period": {"processor": {}},
        "a processor of 0": {"processor": {"period": "0"}},
        "two periods": {"readings": now | {"period": "1"}, "processor": {"period": "1"}},
        "steps and ticks": {"processor": {"period": "1"}, "time": "discrete"},
        "another time": {"time": "now"},
        "dynamics of a processor": {
            "dynamics": {"A": [["1"]], "B": [["1"]]},
            "processor": {"period": "1"},
        },
        "an old version": {"version": 3},
        "inputs that act before": _late_inputs("-1"),
        "inputs that act at once": _late_inputs("0"),
        "inputs that act late and saturate": _late_inputs("1", limit="1", saturates=True),
        "inputs that act late, held": _late_inputs("1") | {"readings": now | {"period": "1"}},
        "inputs that act between ticks": _late_inputs("1") | {"processor": {"period": "2/3"}},
        "inputs that act late, to no target": _late_inputs("1") | {"goal": "agreement"},
    }
    data, problem = _frames()["now"]
    for what, changes in bent.items():
        document = json.loads(problem) | changes
        yield Case(f"now: {what}", data, json.dumps(document).encode(), UNREADABLE)
