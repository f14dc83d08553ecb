"""Certificates of regions for the lone checker: claims written by hand whose truth is known, and
twins that just fail.

The consensus part of every certificate is what ``certify`` finds; its claims about regions are
replaced by ours.
"""

import hashlib
import json
from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import mpmath
from certified import consensus_claims
from texts import matrix, ranges, vector

from checker_files.files import (
    FAILS,
    HOLDS,
    UNREADABLE,
    Case,
    Document,
    Forger,
    changed,
    collected,
    doubles,
    network,
    scalar,
)
from dobc_design import Exosystem, Network, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem.canonical import canonical_bytes

GLOBAL = "global"
REFUTED: Document = {"verdict": "refuted", "rate": None, "covered_by": None}
UNDECIDED: Document = {"verdict": "undecided", "rate": None, "covered_by": None}


def box(radius: Any, disturbance: Any = 0) -> Document:
    return {"kind": "box", "radius": radius, "disturbance": disturbance}


def ball(radius: Any, disturbance: Any = 0) -> Document:
    return {"kind": "ball", "radius": radius, "disturbance": disturbance}


def claim(id: str, domain: Any, rate: Any, exact: Document | None, **more: Any) -> Document:
    """A check that is proved, unless ``more`` says otherwise."""
    check = {
        "id": id,
        "verdict": "proved",
        "domain": domain,
        "margin": None,
        "rate": rate,
        "reason": "",
        "exact": exact,
    }
    check |= more
    found = {}
    for key, value in check.items():
        if value is not None or key not in ("exact", "witness"):
            found[key] = value
    return found


def weights(v: str, alpha: str, rho: str | None = None, **more: Any) -> Document:
    """What a max-separable claim states."""
    return {"v": vector(v), "alpha": alpha, "rho": rho} | more


def separable(
    domain: Any, rate: Any, v: str, alpha: str, rho: str | None = None, **more: Any
) -> Document:
    return claim("max-separable", domain, rate, weights(v, alpha, rho, **more))


def agents(*labels: str) -> Document:
    """A witness: these agents."""
    return {"kind": "agents", "labels": list(labels)}


def asked(reach: Any, disturbance: Any = None) -> Document:
    more = {} if disturbance is None else {"initial_disturbance": disturbance}
    return {
        "initial_states": reach if isinstance(reach, list) else [f"-{reach}", f"{reach}"]
    } | more


PAIR_NET = network()
LINE_NET = network([[2, 1]], agents=2)
WATCHED: dict[str, Any] = {
    "exosystem": scalar(0),
    "observer": Observer(W=[[2]]),
    "region": asked(1, "1/2"),
}


def given(coupling: Any, **settings: Any) -> Document:
    """Two agents that hear each other, both pinned with 3, starts in [-1, 1], but for
    ``settings``."""
    return {"network": PAIR_NET, "coupling": coupling, "gains": 3, "region": asked(1)} | settings


def _settings() -> dict[str, Document]:
    """Small problems; what is true of them stands beside their claims."""
    cubic = "y + y**3"
    first: Document = {"network": LINE_NET, "gains": {1: 1}}
    region = asked([[-1, 1], [-1, 1]])
    planar: Document = {"network": LINE_NET, "target": [0, 0], "region": region}
    crossed = {1: [[2, 1], [-1, 3]], 2: [[2, 1], [-1, 3]]}
    heavy = network([[1, 2, "1e307"], [2, 1, "1e307"]])
    arc = [[2, 1, 3]]
    heavy_line = first | {"network": network(arc, agents=2)}
    one_each = network({"A": [[1, 2]], "B": [[2, 1]]})
    arcs = [[1, 2]]
    optional = [[2, 1]]
    loose = Network.from_arcs(arcs, arrow="listens_to", optional=optional)
    blind: Document = {"exosystem": scalar(0, 0), "region": asked(1, "1/2")}
    exosystem = Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0"))
    observer = Observer(W=matrix("16/5; 12/5"))
    harmonic: Document = {"exosystem": exosystem, "observer": observer, "region": asked(1, "1/2")}
    found: dict[str, Document] = {}
    found["pair"] = given("exp(y) - 1 + y")
    found["heavy"] = given("tanh(y)", network=heavy, gains="1e307")
    found["observed"] = given(cubic, **WATCHED)
    found["observed, linear"] = given("y", **WATCHED)
    found["line"] = given("y", **first)
    found["heavy line"] = given("y", **heavy_line)
    found["curved line"] = given("exp(y) - 1 + y", **first)
    found["no region"] = {"coupling": "y", **first}
    found["sine"] = given("sin(y)", **first)
    found["bent"] = given("-abs(y)", gains=5)
    found["pushed away"] = given("-max(y, 0)", gains="1/10")
    below = asked([-5, 0])
    found["below the target"] = given("tanh(y)", target=1, region=below)
    found["loose"] = given("2*tanh(y)", gains=None)
    found["half loose"] = given("tanh(y)", network=one_each, gains={1: 1})
    found["matrix"] = given("tanh(y)", gains=crossed, **planar)
    found["linear matrix"] = given("y", gains=crossed, **planar)
    found["cubic"] = given(cubic, region=asked("0.49"))
    # An arc of both signs: no two sides fit.
    turned = {"A": [[2, 1]], "B": [[2, 1, -1]]}
    signed = partial(Network.from_arcs, arrow="listens_to", agents=2, negative="opposes")
    found["signed line"] = given("y", gains={1: 1}, network=signed(turned))
    both_ways = {mode: [[1, 2], *arcs] for mode, arcs in turned.items()}
    found["signed cubic"] = given(cubic, network=signed(both_ways), region=asked("0.49"))
    another = {(1, 0): "2*y"}
    found["two kinds"] = given(cubic, exceptions=another, region=asked("0.24"))
    unused = {(0, 1): "y", (1, 0): "y"}
    found["unused"] = given(cubic, exceptions=unused)
    found["flat"] = given("y - 9*max(y - 1, 0) + 9*max(-y - 1, 0)", region=asked("1/4"))
    found["list"] = given(["y1 + y2**3", "y2"], **planar)
    found["straight list"] = given(["y1 + y2", "y2"], **planar)
    found["wavy"] = given("sin(y)")
    found["wavy, loose"] = given("sin(y)", network=loose)
    near_region = WATCHED | {"region": asked(1, "1/10")}
    found["wavy, observed"] = given("sin(y)", **near_region)
    found["tangent"] = given("tan(y)", region=asked(2))
    found["root"] = given("sqrt(1 + y) - 1")
    found["log"] = given("log(1 + y)")
    found["pole"] = given("y/clip(1 + y, 0, 2)")
    found["hidden kink"] = given("-3*y + abs(y**0) - 1", gains=1)
    found["harmonic"] = given("y", **harmonic)
    unseen = WATCHED | {"exosystem": scalar(-1, 0), "observer": Observer(W=[[0]])}
    found["hidden"] = given("exp(y) - 1 + y", **unseen)
    found["unobserved"] = given(cubic, **blind)
    bad_observer = {"observer": Observer(W=[[-1]])}
    found["bad W"] = given("y", **WATCHED | bad_observer)
    found["unstable"] = given("-y", gains="1/2")
    weak: Document = {"network": PAIR_NET, "coupling": "sin(y)", "gains": "1/10"}
    found["second, no region"] = weak
    weak = weak | {"region": asked(5)}
    found["second"] = weak
    found["second, left"] = weak | {"region": asked(["-1.6", 5])}
    found["second, right"] = weak | {"region": asked([-5, "1.6"])}
    moved_region = asked([5, 15])
    moved = {"target": 10, "region": moved_region}
    found["second, moved"] = weak | moved
    found["second, far"] = weak | {"target": 10}
    found["second, unobserved"] = weak | blind | {"region": asked(5, "1/2")}
    square = asked([[-5, 5], [-5, 5]])
    mixed: Document = {"coupling": ["sin(y1)", "y2"], "target": [0, 0], "region": square}
    found["second, curved list"] = weak | mixed
    return found


@cache
def problems() -> dict[str, Problem]:
    return {name: Problem(**settings) for name, settings in _settings().items()}


@cache
def _frames() -> dict[str, tuple[bytes, bytes]]:
    """Certificates of what is true at the consensus, or everywhere; and the problems with their
    regions."""
    frames = {}
    for name, settings in _settings().items():
        alone = Problem(**settings | {"region": None})
        document = json.loads(certificate_bytes(consensus_claims(alone)))
        data = canonical_bytes(problems()[name])
        document["problem_sha256"] = hashlib.sha256(data).hexdigest()
        checks = []
        domains = {}
        for check in document["checks"]:
            if KINDS[check["id"]].role != "region":
                checks.append(check)
                domains[check["id"]] = check["domain"]
        document["checks"] = checks
        if "region" in settings and domains.get(document["covered_by"]) != GLOBAL:
            document |= UNDECIDED
        frames[name] = json.dumps(document).encode(), data
    return frames


def certificate(name: str, *checks: Document, **overall: Any) -> bytes:
    """The certificate of a problem with these regional claims; the first gives the verdict unless
    that is given."""
    return claimed_in(_frames()[name][0], *checks, **overall)


def claimed_in(frame: bytes, *checks: Document, **overall: Any) -> bytes:
    """The same in any certificate."""
    document = dict(json.loads(frame))
    document["checks"] += checks
    first = checks[0] if checks else {}
    is_proved = first.get("verdict") == "proved"
    if is_proved and (first["rate"] or 0) > (document["rate"] or 0):
        document |= {"verdict": "proved", "rate": first["rate"], "covered_by": first["id"]}
    return json.dumps(document | overall).encode()


def case(name: str, code: int, what: str, *checks: Document, **overall: Any) -> Case:
    claimed = certificate(name, *checks, **overall)
    problem = _frames()[name][1]
    return Case(f"{name}: {what}", claimed, problem, code)


FORGER = Forger(case, title=lambda check: f"{check['id']} with")
holds = FORGER.holds
fails = FORGER.fails
wrong = FORGER.wrong
each_wrong = FORGER.each_wrong


# What is true.  All agents pinned with 3 and v = 1: alpha = 3, whatever the nondecreasing coupling.
PAIR = separable(box(1), 3, "1 1", "3", "1")
# A - W C = -2, so beta = 2 and P = 1 are sharp; kappa = 1: rate at most 2 - 1, and R + s = 3/2 =
# rho.
COMPOSITE = {"P": [["1"]], "beta": "2", "kappa": "1", "size": "1"}
OBSERVED = separable(box(1, 0.5), 1, "1 1", "3", "3/2", **COMPOSITE)
# -1 + 2 alpha <= 0.
LINE = separable(GLOBAL, 0.5, "1 2", "1/2")
LINE_BOX = separable(box(1), 0.5, "1 2", "1/2", "1")
# exp(-s/4) - 1 - s/4 <= -5/4 alpha s at s = 1, and the lower face 1 - exp(s/4) - s/4: alpha <= (5/4
# - exp(-1/4))/(5/4).
CURVED = separable(box(1), 0.37, "1 5/4", "0.3769", "1")
# On [-5/2 s, -s/2] the sine is largest at the left end from s = pi/3 on: alpha = sin 3 / 1.8 =
# 0.0784 at rho = 6/5.
SINE = separable(box(1), 0.07, "1 3/2", "0.0784", "6/5")
# The lower face of -|y|: 2 s <= (5 - alpha) s.
BENT = separable(box(1), 2, "1 1", "2.9999", "1")
BOTH = agents("1", "2")
STUCK = claim("max-separable", "consensus", None, None, verdict="refuted", witness=BOTH)
# 4 P of the paper: 4 Omega0 + P = [[-2, 1/3], [1/3, -8/3]] for beta = 1/2; P - c'c and 3 - P are
# positive.
SHARP = {"P": matrix("2 -1; -1 4/3"), "beta": "1/2", "kappa": "4", "size": "3"}
HARMONIC = separable(GLOBAL, 0.25, "1 1", "3", **SHARP)
# kbar = min(2 - 1, 3 - 1) = 1 for both agents.
MATRIX = separable(box(1), 1, "1 1", "1", "1")
# theta - 2 <= -1/4 2, theta = exp(T/4): T <= 4 ln 1.5 = 1.62186.
LATE = claim("delay", GLOBAL, 0.25, {"delay": "1.6218", "rate": "1/4"})
# Slopes 1, gain 1: T = 1; then f = 1 - T alpha.
HELD = claim("sampling", GLOBAL, None, {"period": "0.9999", "factor": "0.50005"})
# kmax = 3, h' = 1 + exp, v = 1: L = 1 + mean of exp(k/4), k = 1..8, = 4.61, so T <= 0.1314; f = 1 -
# 3 T.
HELD_PAIR = claim("sampling", box(1), None, {"period": "0.12", "factor": "0.64"})
# Agent 1: exp(s/2) - 1 + s/2 <= (3 - alpha) s, so alpha <= 1.8512; on its way h' has the mean 1 +
# (e^2.5 - e^0.5)/2.
UNEVEN = separable(box(1), 1.85, "1 3/2", "1.85", "1")
# The weights of PAIR beside those: as for HELD_PAIR.
HELD_OWN = changed(HELD_PAIR, certificate=PAIR["exact"])
# h' = 1 + 3 y^2 on slices up to 3 k/8: L = 11.77, kmax = 3, so T <= 0.0677; kappa beta > 1 even so,
# 1 + 3/10 <= rho.
OWN_PART = OBSERVED["exact"] | {"kappa": "3/5"}
HELD_OBSERVED = changed(
    HELD_PAIR, domain=box(1, 0.5), period="0.06", factor="0.82", certificate=OWN_PART
)
# 1 + y^2 on |y| <= 1: gains [1, 2], and a little room.  2 level = radius^2, R^2 <= level.
# The inequality on (1, 1): -7.5 + 2 + 2 rate < 0.
CUBIC_FORM: Document = {
    "method": "lure",
    "P_e": [[0, 0, "1"], [1, 1, "1"]],
    "level": "1/2",
    "radius": "1",
    "ranges": ranges("1 2.00001"),
    "multipliers": {"G": vector("1 1")},
    "rate": "2.7",
}
CUBIC = claim("lure", ball(0.7071), 2.7, CUBIC_FORM)


#: By the name of the problem.
TRUE = {
    "pair": PAIR,
    "observed": OBSERVED,
    "line": LINE,
    "curved line": CURVED,
    "sine": SINE,
    "bent": BENT,
    "matrix": MATRIX,
    "cubic": CUBIC,
}


def second_box(radius: Any = "1e-6", *, shift: Any = 0, components: int = 1) -> Document:
    """e_2 = -e_1 = y/2 with 2 sin y + y/10 = 0 and y near 3.3; other components 0."""
    with mpmath.workdps(40):
        root = mpmath.findroot(lambda y: 2 * mpmath.sin(y) + y / 10, 3.3) / 2
        half = mpmath.mpf(radius)
        middles = []
        for first in (-root, root):
            first_middle = first + mpmath.mpf(shift)
            others = [mpmath.mpf(0)] * (components - 1)
            middles += [first_middle, *others]
        sides = []
        for middle in middles:
            lower = mpmath.nstr(middle - half, 30)
            upper = mpmath.nstr(middle + half, 30)
            sides.append([lower, upper])
        values = [mpmath.nstr(middle, 30) for middle in middles]
    witness = {"kind": "start", "values": values}
    found = claim("equilibrium", "consensus", None, {"mode": "G", "box": sides})
    return found | {"verdict": "refuted", "witness": witness}


@collected
def region_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    yield from _good()
    yield from _bent_separable()
    yield from _bent_numbers()
    yield from _bent_domains()
    yield from _bent_stuck()
    yield from _bent_timing()
    yield from _bent_lure()
    yield from _bent_gains()
    yield from _bent_forms()
    yield from _bent_equilibria()
    yield from _bent_frames()


def _good() -> Iterator[Case]:
    yield holds("pair", "doubles", changed(PAIR, v=doubles(1.0, 1.0)))
    yield holds("heavy", "weights beyond what floats multiply", PAIR)
    yield wrong("heavy", PAIR, "alpha beyond what floats multiply", alpha="1.001e307")
    for name in ("pair", "observed", "line", "curved line", "sine", "bent", "matrix", "cubic"):
        yield holds(name, "true", TRUE[name])
    yield holds("line", "in a box", LINE_BOX)
    yield holds("line", "late and held", LINE, LATE, HELD)
    yield holds("pair", "held", PAIR, HELD_PAIR)
    sharp = changed(HELD_PAIR, period="1", factor="1/2")
    yield holds("line", "held for exactly 1 / slope", LINE_BOX, sharp)
    yield holds("pair", "held by weights of its own", UNEVEN, HELD_OWN)
    yield holds("observed", "held by an observer's part of its own", OBSERVED, HELD_OBSERVED)
    third = changed(HELD, period="1/3", factor="5/6")
    yield holds("heavy line", "held for 1 / (3 slope)", LINE, third)
    yield fails("heavy line", "held for longer", LINE, changed(third, period="0.334"))
    late = changed(HELD_PAIR, period="0.4", factor="0.9")
    yield fails("matrix", "held for longer than 1 / max k_cc = 1/3", MATRIX, late)
    yield holds("loose", "stuck", STUCK, **REFUTED)
    alone = changed(STUCK, witness=agents("2"))
    yield holds("half loose", "stuck in mode A", alone, **UNDECIDED)
    yield fails("half loose", "one of them is pinned", STUCK, **UNDECIDED)
    yield holds("no region", "covers nothing", LINE_BOX, **_frame_verdict("no region"))
    yield holds("no region", "from every start", LINE)
    yield holds("second", "another equilibrium", second_box(), **REFUTED)


def _frame_verdict(name: str) -> Document:
    frame = json.loads(_frames()[name][0])
    return {key: frame[key] for key in ("verdict", "rate", "covered_by")}


#: A number whose square has more digits than are read.
LONG = "1" + "0" * 4900 + "7"


def _bent_separable() -> Iterator[Case]:
    faster = {"pair": "3.0001", "curved line": "0.3771", "sine": "0.0786"}
    faster |= {"bent": "3.0001", "matrix": "1.0001"}
    for name, alpha in faster.items():
        yield wrong(name, TRUE[name], "alpha", alpha=alpha)
    yield wrong("sine", SINE, "a summit inside", rho="1.9", alpha="0.01", rate=0.01)
    yield wrong("line", LINE, alpha="0.5001")
    yield wrong("line", LINE, v=vector("1 1.9999"))
    yield wrong("line", LINE, "v is 0", v=doubles(0.0, 0.0))
    for name in ("root", "log", "pole"):  # they are not defined on [-2, 0]
        yield fails(name, "it leaves the domain of h", PAIR)
    yield wrong("tangent", PAIR, "a pole inside", rho="2", domain=box(2))
    yield wrong("hidden kink", PAIR, "a kink in a linear coupling", alpha="1/2", rate=0.5)


def _bent_numbers() -> Iterator[Case]:
    yield wrong("pair", PAIR, "rate", rate=3.01)
    yield from each_wrong("pair", PAIR, rate=[0, None], says=UNDECIDED)
    yield wrong("pair", PAIR, margin=0)
    yield from each_wrong("pair", PAIR, v=[["1"], vector("1 -1"), vector("0 0")])
    nan = float("nan")
    infinite = float("inf")
    for values in ([1.0], [1.0, nan], [1.0, infinite], [1.0, -1.0]):
        v = doubles(*values)
        yield wrong("pair", PAIR, f"v = {v}", v=v)
    yield from each_wrong("pair", PAIR, v=[{"float64": "?" * 24}, {"float64": 5}])
    yield wrong("pair", PAIR, "long v", v=["1", f"1/{LONG * 2}"])
    yield wrong("pair", PAIR, "far apart", v=vector("1e300 1e-300"))
    yield wrong("pair", PAIR, v=vector("1e400 1e400"), rho="1")
    yield wrong("pair", PAIR, domain=box(1e-9), rho="1e390")
    yield wrong("pair", PAIR, "rho beyond the numbers followed", domain=box(1e-9), rho="400")
    yield wrong("pair", PAIR, "rho beyond all numbers", domain=box(1e-9), rho="1e9")
    yield fails("pair", "slopes beyond the numbers followed", changed(PAIR, rho="400"), HELD_PAIR)
    yield wrong("pair", PAIR, alpha="0")
    yield wrong("pair", PAIR, alpha=3)
    yield from each_wrong("pair", PAIR, v=[[1, 1], vector("1 0")])
    yield from each_wrong("pair", PAIR, rho=["0", "-1", 1, "0.9999"])
    yield wrong("pair", PAIR, beta="1")
    yield wrong("pair", PAIR, extra="1")


def _bent_domains() -> Iterator[Case]:
    yield wrong("line", LINE, domain=box(1))
    yield wrong("line", LINE, rho="1")
    far = [box(1.0001), GLOBAL, ball(1), box(None), box(-1), box(1, 0.1)]
    yield from each_wrong("pair", PAIR, domain=far)
    yield wrong("pair", PAIR, domain=GLOBAL, rho=None)
    yield wrong("observed", OBSERVED, "negative disturbance", domain=box(1, -0.5), says=UNDECIDED)
    # The observer's part.
    yield wrong("observed", OBSERVED, beta="2.0001")
    yield from each_wrong("observed", OBSERVED, P=[[["0.9999"]], [["-1"]]])
    yield wrong("observed", OBSERVED, size="0.9999")
    yield from each_wrong("observed", OBSERVED, kappa=["0.9999", "-1"])
    yield wrong("observed", OBSERVED, rate=1.0001)
    yield from each_wrong("observed", OBSERVED, domain=[box(1.0001, 0.5), box(1, 0.5001)])
    yield wrong("observed", OBSERVED, "long P", P=[[f"{LONG[:-1]}1/{LONG}"]])
    known = _frame_verdict("harmonic")
    yield holds("harmonic", "true", HARMONIC, **known)
    skew = matrix("2 -1; -1.01 4/3")
    yield wrong("harmonic", HARMONIC, "P is not symmetric", P=skew, says=known)
    yield wrong("hidden", OBSERVED, "P = 0", P=[["0"]])
    yield fails("unobserved", "no W", OBSERVED)
    # Shape of the claim.
    yield wrong("pair", PAIR, "verdict", verdict="perhaps", says=UNDECIDED)
    yield wrong("pair", PAIR, "a witness", witness=agents("1"))
    yield wrong("pair", PAIR, "a mode", mode="G")
    yield fails("pair", "twice", PAIR, PAIR)
    yield wrong("list", MATRIX, "a list", rate=1, v=vector("1 1"), alpha="1")


def _bent_stuck() -> Iterator[Case]:
    """Agents that no gain reaches."""
    yield wrong("loose", STUCK, domain=box(1), says=REFUTED)
    yield wrong("loose", STUCK, rate=1, says=REFUTED)
    yield wrong("loose", STUCK, verdict="perhaps", says=REFUTED)
    yield fails("loose", "exact", STUCK | {"exact": {}}, **REFUTED)
    witnesses = [BOTH | {"kind": "vector"}]
    for labels in ("", "1", "3", "1 3", "1 2 2"):
        witnesses.append(agents(*labels.split()))
    yield from each_wrong("loose", STUCK, witness=witnesses, says=REFUTED)
    yield fails("pair", "nobody is stuck", STUCK, **UNDECIDED)


def _bent_timing() -> Iterator[Case]:
    # h' = 1 + exp(y) is the largest at the right end of every slice: at 0.135 the slopes at the
    # left ends would do.
    held = changed(HELD_PAIR, period="0.135", factor="0.595")
    yield fails("pair", "held a little too long", PAIR, held)
    # The region [-5, 0] reaches 6 from the target 1.
    near = changed(PAIR, domain=box(5), rho="5")
    yield fails("below the target", "it does not reach the far end", near)
    yield holds("below the target", "it reaches the far end", changed(near, domain=box(6), rho="6"))
    yield from each_wrong("line", LATE, delay=["1.6219", "-1", "1e9"], beside=[LINE])
    yield from each_wrong("line", LATE, rate=[0.251, 0, None], beside=[LINE])
    yield wrong("line", LATE, domain=box(1), beside=[LINE])
    yield fails("line", "delay alone", LATE, **_frame_verdict("line"))
    refuted: Document = {"verdict": "refuted", "rate": None, "domain": GLOBAL}
    yield wrong("line", LATE, "refuted", beside=[LINE], **refuted)
    slow = changed(OBSERVED, beta="5/4", rate=0.25)
    exact = {"delay": "0", "rate": "1.25"}
    delay = claim("delay", box(1, 0.5), 1.25, exact)
    yield holds("observed", "late", slow, delay)
    yield wrong("observed", delay, "late faster than the observer", own="1.26", beside=[slow])
    yield wrong("line", HELD, period="1.0001", beside=[LINE])
    yield wrong("line", HELD, factor="0.50004", beside=[LINE])
    yield wrong("pair", HELD_PAIR, "held too long for these weights", factor="0.8", beside=[UNEVEN])
    known = _frame_verdict("pair")
    yield fails("pair", "weights of its own with nothing beside", HELD_OWN, **known)
    yield _own_weights(alpha="3.01")
    yield _own_weights(alpha="0")
    yield _own_weights(rho="0.9")
    yield _own_weights(rho=None)
    yield _own_weights(v=vector("1 0"))
    yield _own_weights(v=["1"])
    yield _own_weights(rate=1)
    yield wrong("pair", HELD_OWN, "no weights of its own", certificate=None, beside=[UNEVEN])
    yield _own_observer(kappa="1/2")
    yield _own_observer(kappa="1.01")
    yield _own_observer(beta="2.01")
    yield _own_observer(P=[["0.99"]])
    yield _own_observer(size="0.99")
    yield wrong("line", HELD, factor="1", beside=[LINE])
    yield wrong("line", HELD, rate=1, beside=[LINE])
    yield wrong("line", HELD, verdict="refuted", beside=[LINE])
    yield wrong("pair", HELD_PAIR, "period", period="0.14", factor="0.58", beside=[PAIR])


def _own_weights(**changes: Any) -> Case:
    own = PAIR["exact"] | changes
    title = f"weights of its own with {changes}"
    return wrong("pair", HELD_OWN, title, certificate=own, beside=[UNEVEN])


def _own_observer(**changes: Any) -> Case:
    title = f"an observer's part of its own with {changes}"
    own = OWN_PART | changes
    return wrong("observed", HELD_OBSERVED, title, certificate=own, beside=[OBSERVED])


def _bent_lure() -> Iterator[Case]:
    # The gains are in [-1, 0], and an agent alone decays at 1/10.
    alone = changed(CUBIC, rate=None, ranges=ranges("-1 0"), multipliers={"G": []}, own="1/20")
    yield fails("pushed away", "a gain that is 0 at most is left out", alone)
    yield wrong("cubic", CUBIC, domain=ball(0.70711))
    yield from each_wrong("cubic", CUBIC, level=["0.5001", None])
    yield from each_wrong("cubic", CUBIC, radius=["0.9999", "-1"])
    yield wrong("cubic", CUBIC, level=None, domain=GLOBAL)
    form = CUBIC_FORM | {"level": None, "radius": None, "rate": "0"}
    form |= {"multipliers": {"G": vector("0 0")}, "ranges": ranges("1 1")}
    everywhere = claim("lure", GLOBAL, None, form)
    known = _frame_verdict("harmonic")
    seen = changed(everywhere, P=matrix("1/2 -1/4; -1/4 1/3"))
    yield holds("harmonic", "everywhere", seen, **known)
    skew = matrix("1/2 -1/4; -0.26 1/3")
    yield wrong("harmonic", seen, "P of lure is not symmetric", P=skew, says=known)
    yield wrong("harmonic", seen, "a ball without level", domain=ball(1, 0.5), says=known)
    covered: Document = {"verdict": "proved", "rate": None, "covered_by": "lure"}
    yield wrong("bad W", everywhere, "P < 0 of lure", P=[["-1"]], says=covered)
    P_e = [[0, 1, "2"]]
    saddle = changed(everywhere, P_e=P_e, ranges=ranges("-1 -1"))
    yield fails("unstable", "P_e is a saddle", saddle, **covered)
    yield wrong("cubic", CUBIC, "negative rate", rate=None, own="-1", says=covered)
    yield wrong("cubic", CUBIC, level=None, radius=None, domain=GLOBAL)
    yield wrong("cubic", CUBIC, domain=box(0.5))


def _bent_gains() -> Iterator[Case]:
    def gains(name: str, check: Document, *ends: str, coupling: int = 0) -> Case:
        """With a pair of ends that the last coupling has not."""
        others = check["exact"]["ranges"][:coupling]
        title = f"gains {list(ends)}"
        all_ranges = others + ranges(" ".join(ends), coupling)
        return wrong(name, check, title, ranges=all_ranges)

    yield gains("cubic", CUBIC, "1", "1.9999")
    yield gains("cubic", CUBIC, "1.0001", "2")
    # sin y <= y/2 holds at y = 5/2, not at 1; an off-diagonal gain; the slope of y2^3 on |y2| <=
    # 1/2 is at most 3/4.
    wide: Document = {"radius": "5/2", "level": "25/8", "domain": ball(1.5)}
    wavy = changed(CUBIC, ranges=ranges("1/5 1/2"), **wide)
    yield fails("wavy", "a gain that is passed in between", wavy)
    wavy = changed(wavy, ranges=ranges("1/5 1.00001"), rate=1.0, own="1")
    yield holds("wavy", "true", wavy)
    P_e = [[k, k, "1"] for k in range(4)]
    planar = changed(CUBIC, P_e=P_e, rate=None, own="0")
    planar = changed(planar, domain=ball(0.7))
    for off, taus, code in (("0", "1 1", HOLDS), ("0.1", "1 0 1", FAILS)):
        own = ranges(f"0.7 1.00001, {off} {off}; 0 0, 0.7 1.00001")
        check = changed(planar, ranges=own, multipliers={"G": vector(taus)})
        yield case("matrix", code, f"a gain {off} beside the diagonal", check, **UNDECIDED)
    planar = changed(planar, radius="1/2", level="1/8", domain=ball(0.35))
    for top, code in (("0.2501", HOLDS), ("0.2499", FAILS)):
        own = ranges(f"0.99999 1.00001, 0 {top}; 0 0, 0.99999 1.00001")
        check = changed(planar, ranges=own, multipliers={"G": vector("1 1 1")})
        yield case("list", code, f"a gain of {top}", check, **UNDECIDED)
    # h is y on |y| <= 1 only: the radius counts though the gain is one number.
    flat = changed(CUBIC, ranges=ranges("0.99999 1.00001"), rate=1.0, own="1")
    yield holds("flat", "true", flat)
    yield wrong("flat", flat, "level", level="0.5001")
    mixed = ranges("1 1.2501") + ranges("2 2", 1)
    near: Document = {"radius": "1/2", "level": "1/8", "domain": ball(0.353)}
    two = changed(CUBIC, ranges=mixed, rate=1.0, own="1", **near)
    two["exact"]["multipliers"] = {"G": vector("1 0")}
    yield holds("two kinds", "true", two)
    yield gains("two kinds", two, "1.9999", "1.9999", coupling=1)
    yield gains("two kinds", two, "2.0001", "2.0001", coupling=1)
    ones = {"G": vector("1 1")}
    yield wrong("two kinds", two, "a multiplier of one gain", multipliers=ones)


def _bent_forms() -> Iterator[Case]:
    own = CUBIC_FORM["ranges"]
    yield from each_wrong("cubic", CUBIC, ranges=[[], own * 2, {}])
    yield wrong("cubic", CUBIC, ranges=[own[0] | {"coupling": False}])
    yield wrong("cubic", CUBIC, P_e="I")
    ones = vector("1 1")
    for tau in (vector("1 0"), vector("1 -1"), ["1"]):
        yield wrong("cubic", CUBIC, multipliers={"G": tau})
    yield wrong("cubic", CUBIC, multipliers={"H": ones})
    yield wrong("cubic", CUBIC, multipliers={"G": ones, "H": []})
    for method in ("vertices", "interval", "circle"):
        yield wrong("cubic", CUBIC, method=method)
        yield wrong("cubic", CUBIC, "no multipliers", method=method, multipliers={})
    yield wrong("cubic", CUBIC, rate=2.71)
    yield wrong("cubic", CUBIC, "rate 0", rate=0, says=UNDECIDED)
    yield wrong("cubic", CUBIC, "rate of lure", own="2.75")
    yield wrong("cubic", CUBIC, "P_e", P_e=[[0, 0, "1"], [1, 1, "-1"]])
    form = CUBIC_FORM["P_e"]
    below_the_diagonal = [1, 0, "1/10"]
    twice = [0, 0, "1"]
    for entry in (below_the_diagonal, twice, [0, 1, "0"]):
        yield wrong("cubic", CUBIC, f"{[entry]} in P_e", P_e=[*form, entry])
    for place in (-1, 2, True, "0"):
        yield wrong("cubic", CUBIC, f"P_e at {place!r}", P_e=[[place, place, "1"]])


def _bent_equilibria() -> Iterator[Case]:
    good = second_box()
    for shift in ("2e-6", "-2e-6"):
        yield fails("second", "beside it", second_box(shift=shift), **REFUTED)
    for name in ("second, left", "second, right", "second, far"):
        yield fails(name, "outside the region", good, **REFUTED)
    yield holds("second, moved", "a target that is not 0", good, **REFUTED)
    alone = _frame_verdict("second, no region")
    yield holds("second, no region", "the question is about the target", good, **alone)
    yield holds("second, curved list", "a list", second_box(components=2), **REFUTED)
    target = matrix("-1e-6 1e-6; -1e-6 1e-6")
    zeros = {"kind": "start", "values": vector("0 0")}
    yield wrong("second", good, "the target", box=target, witness=zeros, says=REFUTED)
    yield fails("second", "the target in the box", second_box("1.7"), **REFUTED)
    yield fails("second", "the verdict", good, **UNDECIDED)
    yield fails("second, unobserved", "no observer gain", good, **REFUTED)
    yield wrong("second", good, rate=1, says=REFUTED)
    yield wrong("second", good, margin=0, says=REFUTED)
    yield wrong("second", good, mode="H", says=REFUTED)
    yield wrong("second", good, domain=box(1), says=REFUTED)
    yield wrong("second", good, "proved", verdict="proved", says=UNDECIDED)
    witness = good["witness"]
    sides = good["exact"]["box"]
    values = [x[:-1] for x in witness["values"]]
    rounded = witness | {"values": values}
    yield wrong("second", good, "not the middle", witness=rounded, says=REFUTED)
    empty = [[high, low] for low, high in sides]
    yield wrong("second", good, "an empty box", box=empty, says=REFUTED)
    for box_of_none in (sides[:1], "text", [["1"], ["1"]]):
        yield wrong("second", good, box=box_of_none, says=REFUTED)
    yield wrong("second", good, witness=witness | {"kind": "vector"}, says=REFUTED)


def _bent_frames() -> Iterator[Case]:
    yield fails("pair", "the verdict", PAIR, **UNDECIDED)
    small = changed(PAIR, domain=box(0.9999))
    yield fails("pair", "it does not cover", small)
    yield holds("pair", "it does not cover, and says so", small, **UNDECIDED)
    calm = changed(OBSERVED, domain=box(1, 0.4999))
    yield fails("observed", "it covers less disturbance", calm)
    yield holds("observed", "less disturbance", calm, **UNDECIDED)
    yield wrong("cubic", CUBIC, "a ball that does not cover", domain=ball(0.69))
    for domain in ({"kind": "box", "radius": 1}, box("1"), 5):
        yield case("pair", UNREADABLE, f"the domain {domain}", PAIR | {"domain": domain})
    yield fails("line", "covered by a delay", LINE, verdict="proved", rate=0.5, covered_by="delay")
