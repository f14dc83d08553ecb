"""Certificates of regions for the lone checker: claims written by hand whose truth is known, and
twins that just fail.

The consensus part of every certificate is what ``certify`` finds; its claims about regions are
replaced by ours.
"""

import base64
import hashlib
import json
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

import mpmath
from certified import consensus_claims

from checker_files.files import FAILS, HOLDS, UNREADABLE, Case, Document, bend, network, scalar
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
    return {
        key: value
        for key, value in check.items()
        if value is not None or key not in ("exact", "witness")
    }


def asked(reach: Any, disturbance: Any = None) -> Document:
    more = {} if disturbance is None else {"initial_disturbance": disturbance}
    return {
        "initial_states": reach if isinstance(reach, list) else [f"-{reach}", f"{reach}"]
    } | more


PAIR_NET, LINE_NET = network(), network([[2, 1]], agents=2)
SQUARE = asked([[-1, 1], [-1, 1]])
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
    cubic, first, plane = (
        "y + y**3",
        {"network": LINE_NET, "gains": {1: 1}},
        {"target": [0, 0], "region": SQUARE},
    )
    heavy = network([[1, 2, "1e307"], [2, 1, "1e307"]])
    crossed = {1: [[2, 1], [-1, 3]], 2: [[2, 1], [-1, 3]]}
    harmonic = {
        "exosystem": Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]]),
        "observer": Observer(W=[["16/5"], ["12/5"]]),
    }
    second = {
        "second, left": {"region": asked(["-1.6", 5])},
        "second, right": {"region": asked([-5, "1.6"])},
        "second": {"region": asked(5)},
        "second, moved": {"target": 10, "region": asked([5, 15])},
        "second, far": {"target": 10, "region": asked(5)},
        "second, unobserved": {"exosystem": scalar(0, 0), "region": asked(5, "1/2")},
    }
    found = {
        "pair": given("exp(y) - 1 + y"),
        "heavy": given("tanh(y)", network=heavy, gains="1e307"),
        "observed": given(cubic, **WATCHED),
        "observed, linear": given("y", **WATCHED),
        "line": given("y", **first),
        "heavy line": given("y", **first | {"network": network([[2, 1, 3]], agents=2)}),
        "curved line": given("exp(y) - 1 + y", **first),
        "no region": {"coupling": "y", **first},
        "sine": given("sin(y)", **first),
        "bent": given("-abs(y)", gains=5),
        "pushed away": given("-max(y, 0)", gains="1/10"),
        "below the target": given("tanh(y)", target=1, region=asked([-5, 0])),
        "loose": given("2*tanh(y)", gains=None),
        "half loose": given(
            "tanh(y)", network=network({"A": [[1, 2]], "B": [[2, 1]]}), gains={1: 1}
        ),
        "matrix": given("tanh(y)", network=LINE_NET, gains=crossed, **plane),
        "linear matrix": given("y", network=LINE_NET, gains=crossed, **plane),
        "cubic": given(cubic, region=asked("0.49")),
        "two kinds": given(cubic, exceptions={(1, 0): "2*y"}, region=asked("0.24")),
        "unused": given(cubic, exceptions={(0, 1): "y", (1, 0): "y"}),
        "flat": given("y - 9*max(y - 1, 0) + 9*max(-y - 1, 0)", region=asked("1/4")),
        "list": given(["y1 + y2**3", "y2"], network=LINE_NET, **plane),
        "straight list": given(["y1 + y2", "y2"], network=LINE_NET, **plane),
        "wavy": given("sin(y)"),
        "wavy, loose": given(
            "sin(y)", network=Network.from_arcs([[1, 2]], arrow="listens_to", optional=[[2, 1]])
        ),
        "wavy, observed": given("sin(y)", **WATCHED | {"region": asked(1, "1/10")}),
        "tangent": given("tan(y)", region=asked(2)),
        "root": given("sqrt(1 + y) - 1"),
        "log": given("log(1 + y)"),
        "pole": given("y/clip(1 + y, 0, 2)"),
        "hidden kink": given("-3*y + abs(y**0) - 1", gains=1),
        "harmonic": given("y", region=asked(1, "1/2"), **harmonic),
        "hidden": given(
            "exp(y) - 1 + y",
            **WATCHED | {"exosystem": scalar(-1, 0), "observer": Observer(W=[[0]])},
        ),
        "unobserved": given(cubic, exosystem=scalar(0, 0), region=asked(1, "1/2")),
        "bad W": given("y", **WATCHED | {"observer": Observer(W=[[-1]])}),
        "unstable": given("-y", gains="1/2"),
        "second, curved list": given(
            ["sin(y1)", "y2"], gains="1/10", target=[0, 0], region=asked([[-5, 5], [-5, 5]])
        ),
        "second, no region": {"network": PAIR_NET, "coupling": "sin(y)", "gains": "1/10"},
    }
    return found | {name: given("sin(y)", gains="1/10", **more) for name, more in second.items()}


@cache
def problems() -> dict[str, Problem]:
    return {name: Problem(**settings) for name, settings in _settings().items()}


@cache
def _frames() -> dict[str, tuple[bytes, bytes]]:
    """Certificates of what is true at the consensus, or everywhere; and the problems with their
    regions."""
    frames = {}
    for name, settings in _settings().items():
        document = json.loads(
            certificate_bytes(consensus_claims(Problem(**settings | {"region": None})))
        )
        data = canonical_bytes(problems()[name])
        document["problem_sha256"] = hashlib.sha256(data).hexdigest()
        document["checks"] = [
            check for check in document["checks"] if KINDS[check["id"]].role != "region"
        ]
        domains = {check["id"]: check["domain"] for check in document["checks"]}
        if "region" in settings and domains.get(document["covered_by"]) != GLOBAL:
            document |= UNDECIDED
        frames[name] = json.dumps(document).encode(), data
    return frames


def certificate(name: str, *checks: Document, **overall: Any) -> bytes:
    """The certificate of a problem with these regional claims; the first gives the verdict unless
    that is given."""
    document = dict(json.loads(_frames()[name][0]))
    document["checks"] += checks
    first = checks[0] if checks else {}
    if first.get("verdict") == "proved" and (first["rate"] or 0) > (document["rate"] or 0):
        document |= {"verdict": "proved", "rate": first["rate"], "covered_by": first["id"]}
    return json.dumps(document | overall).encode()


def case(name: str, code: int, *checks: Document, what: str, **overall: Any) -> Case:
    return Case(f"{name}: {what}", certificate(name, *checks, **overall), _frames()[name][1], code)


def changed(check: Document, **changes: Any) -> Document:
    """The check with changes; keys of ``exact`` go there."""
    copied = json.loads(json.dumps(check))
    own = {key: value for key, value in changes.items() if key in check}
    bend(copied, own)
    if set(changes) - set(own):
        bend(copied["exact"], {key: value for key, value in changes.items() if key not in own})
    return dict(copied)


def bents(
    name: str, check: Document, *changes: Document, beside: Any = (), **overall: Any
) -> Iterator[Case]:
    """The check after those of ``beside``, with one of the changes at a time, of which none
    holds."""
    for change in changes:
        what = f"{check['id']} with {str(change)[:60]}"
        yield case(name, FAILS, *beside, changed(check, **change), what=what, **overall)


# What is true.  All agents pinned with 3 and v = 1: alpha = 3, whatever the nondecreasing coupling.
PAIR = claim("max-separable", box(1), 3, {"v": ["1", "1"], "alpha": "3", "rho": "1"})
# A - W C = -2, so beta = 2 and P = 1 are sharp; kappa = 1: rate at most 2 - 1, and R + s = 3/2 =
# rho.
COMPOSITE = {"P": [["1"]], "beta": "2", "kappa": "1", "size": "1"}
OBSERVED = claim(
    "max-separable", box(1, 0.5), 1, {"v": ["1", "1"], "alpha": "3", "rho": "3/2"} | COMPOSITE
)
# -1 + 2 alpha <= 0.
LINE = claim("max-separable", GLOBAL, 0.5, {"v": ["1", "2"], "alpha": "1/2", "rho": None})
LINE_BOX = claim("max-separable", box(1), 0.5, {"v": ["1", "2"], "alpha": "1/2", "rho": "1"})
# exp(-s/4) - 1 - s/4 <= -5/4 alpha s at s = 1, and the lower face 1 - exp(s/4) - s/4: alpha <= (5/4
# - exp(-1/4))/(5/4).
CURVED = claim("max-separable", box(1), 0.37, {"v": ["1", "5/4"], "alpha": "0.3769", "rho": "1"})
# On [-5/2 s, -s/2] the sine is largest at the left end from s = pi/3 on: alpha = sin 3 / 1.8 =
# 0.0784 at rho = 6/5.
SINE = claim("max-separable", box(1), 0.07, {"v": ["1", "3/2"], "alpha": "0.0784", "rho": "6/5"})
# The lower face of -|y|: 2 s <= (5 - alpha) s.
BENT = claim("max-separable", box(1), 2, {"v": ["1", "1"], "alpha": "2.9999", "rho": "1"})
BOTH = {"kind": "agents", "labels": ["1", "2"]}
STUCK = claim("max-separable", "consensus", None, None, verdict="refuted", witness=BOTH)
# 4 P of the paper: 4 Omega0 + P = [[-2, 1/3], [1/3, -8/3]] for beta = 1/2; P - c'c and 3 - P are
# positive.
SHARP = {"P": [["2", "-1"], ["-1", "4/3"]], "beta": "1/2", "kappa": "4", "size": "3"}
HARMONIC = claim(
    "max-separable", GLOBAL, 0.25, {"v": ["1", "1"], "alpha": "3", "rho": None} | SHARP
)
# kbar = min(2 - 1, 3 - 1) = 1 for both agents.
MATRIX = claim("max-separable", box(1), 1, {"v": ["1", "1"], "alpha": "1", "rho": "1"})
# theta - 2 <= -1/4 2, theta = exp(T/4): T <= 4 ln 1.5 = 1.62186.
LATE = claim("delay", GLOBAL, 0.25, {"delay": "1.6218", "rate": "1/4"})
# Slopes 1, gain 1: T = 1; then f = 1 - T alpha.
HELD = claim("sampling", GLOBAL, None, {"period": "0.9999", "factor": "0.50005"})
# kmax = 3, h' = 1 + exp, v = 1: L = 1 + mean of exp(k/4), k = 1..8, = 4.61, so T <= 0.1314; f = 1 -
# 3 T.
HELD_PAIR = claim("sampling", box(1), None, {"period": "0.12", "factor": "0.64"})
# Agent 1: exp(s/2) - 1 + s/2 <= (3 - alpha) s, so alpha <= 1.8512; on its way h' has the mean 1 +
# (e^2.5 - e^0.5)/2.
UNEVEN = claim("max-separable", box(1), 1.85, {"v": ["1", "3/2"], "alpha": "1.85", "rho": "1"})
# The weights of PAIR beside those: as for HELD_PAIR.
HELD_OWN = changed(HELD_PAIR, certificate=PAIR["exact"])
# h' = 1 + 3 y^2 on slices up to 3 k/8: L = 11.77, kmax = 3, so T <= 0.0677; kappa beta > 1 even so,
# 1 + 3/10 <= rho.
OWN_PART = OBSERVED["exact"] | {"kappa": "3/5"}
HELD_OBSERVED = claim(
    "sampling", box(1, 0.5), None, {"period": "0.06", "factor": "0.82", "certificate": OWN_PART}
)
# 1 + y^2 on |y| <= 1: gains [1, 2], and a little room.  2 level = radius^2, R^2 <= level.
# Inequalities on (1, 1): lure -7.5 + 2 + 2 rate < 0, interval -9 + 2 + 3 + 2 rate < 0; vertices
# with gains 1 and 2: -9 + sqrt(10) + 2 rate < 0.
CUBIC = claim(
    "lure",
    ball(0.7071),
    2.7,
    {
        "method": "lure",
        "P_e": [[0, 0, "1"], [1, 1, "1"]],
        "level": "1/2",
        "radius": "1",
        "ranges": [{"coupling": 0, "gains": [[["1", "2.00001"]]]}],
        "multipliers": {"G": ["1", "1"]},
        "rate": "2.7",
    },
)


def second_box(radius: Any = "1e-6", *, shift: Any = 0, components: int = 1) -> Document:
    """e_2 = -e_1 = y/2 with 2 sin y + y/10 = 0 and y near 3.3; other components 0."""
    with mpmath.workdps(40):
        root = mpmath.findroot(lambda y: 2 * mpmath.sin(y) + y / 10, 3.3) / 2
        half, shift = mpmath.mpf(radius), mpmath.mpf(shift)
        zeros = [mpmath.mpf(0)] * (components - 1)
        middles = [-root + shift, *zeros, root + shift, *zeros]
        texts = [[mpmath.nstr(middle + side * half, 30) for side in (-1, 1)] for middle in middles]
        values = [mpmath.nstr(middle, 30) for middle in middles]
    witness = {"kind": "start", "values": values}
    return claim(
        "equilibrium",
        "consensus",
        None,
        {"mode": "G", "box": texts},
        verdict="refuted",
        witness=witness,
    )


@cache
def region_cases() -> list[Case]:
    """All of them, the good ones first."""
    return [
        *_good(),
        *_bent_separable(),
        *_bent_timing(),
        *_bent_lure(),
        *_bent_equilibria(),
        *_bent_frames(),
    ]


def doubles(*values: float) -> Document:
    return {"float64": base64.b64encode(struct.pack(f"<{len(values)}d", *values)).decode()}


def _good() -> Iterator[Case]:
    yield case("pair", HOLDS, changed(PAIR, v=doubles(1.0, 1.0)), what="doubles")
    yield case("heavy", HOLDS, PAIR, what="weights beyond what floats multiply")
    yield case(
        "heavy", FAILS, changed(PAIR, alpha="1.001e307"), what="alpha beyond what floats multiply"
    )
    true = {
        "pair": PAIR,
        "observed": OBSERVED,
        "line": LINE,
        "curved line": CURVED,
        "sine": SINE,
        "bent": BENT,
    }
    for name, check in (true | {"matrix": MATRIX, "cubic": CUBIC}).items():
        yield case(name, HOLDS, check, what="true")
    yield case("line", HOLDS, LINE_BOX, what="in a box")
    yield case("line", HOLDS, LINE, LATE, HELD, what="late and held")
    yield case("pair", HOLDS, PAIR, HELD_PAIR, what="held")
    sharp = claim("sampling", box(1), None, {"period": "1", "factor": "1/2"})
    yield case("line", HOLDS, LINE_BOX, sharp, what="held for exactly 1 / slope")
    yield case("pair", HOLDS, UNEVEN, HELD_OWN, what="held by weights of its own")
    yield case(
        "observed", HOLDS, OBSERVED, HELD_OBSERVED, what="held by an observer's part of its own"
    )
    third = changed(HELD, period="1/3", factor="5/6")
    yield case("heavy line", HOLDS, LINE, third, what="held for 1 / (3 slope)")
    yield case("heavy line", FAILS, LINE, changed(third, period="0.334"), what="held for longer")
    late = claim("sampling", box(1), None, {"period": "0.4", "factor": "0.9"})
    yield case("matrix", FAILS, MATRIX, late, what="held for longer than 1 / max k_cc = 1/3")
    yield case("loose", HOLDS, STUCK, **REFUTED, what="stuck")
    alone = {"kind": "agents", "labels": ["2"]}
    yield case("half loose", HOLDS, STUCK | {"witness": alone}, **UNDECIDED, what="stuck in mode A")
    yield case("half loose", FAILS, STUCK, **UNDECIDED, what="one of them is pinned")
    yield case("no region", HOLDS, LINE_BOX, what="covers nothing", **_frame_verdict("no region"))
    yield case("no region", HOLDS, LINE, what="from every start")
    for method, rate in (("interval", "1.99"), ("vertices", "2.9")):
        other = changed(CUBIC, method=method, multipliers={}, rate=float(rate))
        other["exact"]["rate"] = rate
        yield case("cubic", HOLDS, other, what=method)
    yield case("second", HOLDS, second_box(), **REFUTED, what="another equilibrium")


def _frame_verdict(name: str) -> Document:
    frame = json.loads(_frames()[name][0])
    return {key: frame[key] for key in ("verdict", "rate", "covered_by")}


def _bent_separable() -> Iterator[Case]:
    long = "1" + "0" * 4900 + "7"
    # Rows.
    more = {"pair": (PAIR, "3.0001"), "curved line": (CURVED, "0.3771"), "sine": (SINE, "0.0786")}
    for name, (check, alpha) in (
        more | {"bent": (BENT, "3.0001"), "matrix": (MATRIX, "1.0001")}
    ).items():
        yield case(name, FAILS, changed(check, alpha=alpha), what="alpha")
    yield case(
        "sine", FAILS, changed(SINE, rho="1.9", alpha="0.01", rate=0.01), what="a summit inside"
    )
    yield from bents("line", LINE, {"alpha": "0.5001"}, {"v": ["1", "1.9999"]})
    yield case("line", FAILS, changed(LINE, v=doubles(0.0, 0.0)), what="v is 0")
    for name in ("root", "log", "pole"):  # they are not defined on [-2, 0]
        yield case(name, FAILS, PAIR, what="it leaves the domain of h")
    yield case("tangent", FAILS, changed(PAIR, rho="2", domain=box(2)), what="a pole inside")
    yield case(
        "hidden kink",
        FAILS,
        changed(PAIR, alpha="1/2", rate=0.5),
        what="a kink in a linear coupling",
    )
    # Numbers.
    yield case("pair", FAILS, changed(PAIR, rate=3.01), what="rate")
    yield from bents("pair", PAIR, {"rate": 0}, {"rate": None}, **UNDECIDED)
    yield from bents(
        "pair", PAIR, {"margin": 0}, {"v": ["1"]}, {"v": ["1", "-1"]}, {"v": ["0", "0"]}
    )
    for v in (
        doubles(1.0),
        doubles(1.0, float("nan")),
        doubles(1.0, float("inf")),
        doubles(1.0, -1.0),
    ):
        yield case("pair", FAILS, changed(PAIR, v=v), what=f"v = {v}")
    yield from bents("pair", PAIR, {"v": {"float64": "?" * 24}}, {"v": {"float64": 5}})
    yield case("pair", FAILS, changed(PAIR, v=["1", f"1/{long * 2}"]), what="long v")
    yield case("pair", FAILS, changed(PAIR, v=["1e300", "1e-300"]), what="far apart")
    yield from bents(
        "pair", PAIR, {"v": ["1e400", "1e400"], "rho": "1"}, {"domain": box(1e-9), "rho": "1e390"}
    )
    yield case(
        "pair",
        FAILS,
        changed(PAIR, domain=box(1e-9), rho="400"),
        what="rho beyond the numbers followed",
    )
    yield case(
        "pair", FAILS, changed(PAIR, domain=box(1e-9), rho="1e9"), what="rho beyond all numbers"
    )
    yield case(
        "pair",
        FAILS,
        changed(PAIR, rho="400"),
        HELD_PAIR,
        what="slopes beyond the numbers followed",
    )
    wrong = [
        {"v": [1, 1]},
        {"v": ["1", "0"]},
        {"alpha": "0"},
        {"alpha": 3},
        {"rho": "0"},
        {"rho": "-1"},
        {"rho": 1},
    ]
    yield from bents("pair", PAIR, *wrong, {"beta": "1"}, {"extra": "1"}, {"rho": "0.9999"})
    # Domains.
    yield from bents("line", LINE, {"domain": box(1)}, {"rho": "1"})
    places = (box(1.0001), GLOBAL, ball(1), box(None), box(-1), box(1, 0.1))
    yield from bents(
        "pair", PAIR, *({"domain": place} for place in places), {"domain": GLOBAL, "rho": None}
    )
    yield case(
        "observed",
        FAILS,
        changed(OBSERVED, domain=box(1, -0.5)),
        **UNDECIDED,
        what="negative disturbance",
    )
    # The observer's part.
    yield from bents(
        "observed",
        OBSERVED,
        {"beta": "2.0001"},
        {"P": [["0.9999"]]},
        {"P": [["-1"]]},
        {"size": "0.9999"},
    )
    yield from bents("observed", OBSERVED, {"kappa": "0.9999"}, {"kappa": "-1"}, {"rate": 1.0001})
    yield from bents("observed", OBSERVED, {"domain": box(1.0001, 0.5)}, {"domain": box(1, 0.5001)})
    yield case("observed", FAILS, changed(OBSERVED, P=[[f"{long[:-1]}1/{long}"]]), what="long P")
    yield case("harmonic", HOLDS, HARMONIC, what="true", **_frame_verdict("harmonic"))
    skew = changed(HARMONIC, P=[["2", "-1"], ["-1.01", "4/3"]])
    yield case("harmonic", FAILS, skew, what="P is not symmetric", **_frame_verdict("harmonic"))
    yield case("hidden", FAILS, changed(OBSERVED, P=[["0"]]), what="P = 0")
    yield case("unobserved", FAILS, OBSERVED, what="no W")
    # Shape of the claim.
    yield case("pair", FAILS, changed(PAIR, verdict="perhaps"), **UNDECIDED, what="verdict")
    yield case(
        "pair", FAILS, PAIR | {"witness": {"kind": "agents", "labels": ["1"]}}, what="a witness"
    )
    yield case("pair", FAILS, PAIR | {"mode": "G"}, what="a mode")
    yield case("pair", FAILS, PAIR, PAIR, what="twice")
    yield case("list", FAILS, changed(MATRIX, rate=1, v=["1", "1"], alpha="1"), what="a list")
    # Stuck agents.
    yield from bents(
        "loose", STUCK, {"domain": box(1)}, {"rate": 1}, {"verdict": "perhaps"}, **REFUTED
    )
    yield case("loose", FAILS, STUCK | {"exact": {}}, **REFUTED, what="exact")
    groups = [
        {"kind": "agents", "labels": labels}
        for labels in ([], ["1"], ["3"], ["1", "3"], ["1", "2", "2"])
    ]
    yield from bents(
        "loose",
        STUCK,
        *({"witness": each} for each in (*groups, BOTH | {"kind": "vector"})),
        **REFUTED,
    )
    yield case("pair", FAILS, STUCK, **UNDECIDED, what="nobody is stuck")


def _bent_timing() -> Iterator[Case]:
    # h' = 1 + exp(y) is the largest at the right end of every slice: at 0.135 the slopes at the
    # left ends would do.
    held = changed(HELD_PAIR, period="0.135", factor="0.595")
    yield case("pair", FAILS, PAIR, held, what="held a little too long")
    # The region [-5, 0] reaches 6 from the target 1.
    near = changed(PAIR, domain=box(5), rho="5")
    yield case("below the target", FAILS, near, what="it does not reach the far end")
    yield case(
        "below the target",
        HOLDS,
        changed(near, domain=box(6), rho="6"),
        what="it reaches the far end",
    )
    yield from bents(
        "line", LATE, {"delay": "1.6219"}, {"delay": "-1"}, {"delay": "1e9"}, beside=[LINE]
    )
    rates = ({"rate": rate} for rate in (0.251, 0, None))
    yield from bents("line", LATE, *rates, {"domain": box(1)}, beside=[LINE])
    yield case("line", FAILS, LATE, what="delay alone", **_frame_verdict("line"))
    yield case(
        "line",
        FAILS,
        LINE,
        changed(LATE, verdict="refuted", rate=None, domain=GLOBAL),
        what="refuted",
    )
    slow = changed(OBSERVED, beta="5/4", rate=0.25)
    delay = claim("delay", box(1, 0.5), 1.25, {"delay": "0", "rate": "1.25"})
    yield case("observed", HOLDS, slow, delay, what="late")
    delay["exact"]["rate"] = "1.26"
    yield case("observed", FAILS, slow, delay, what="late faster than the observer")
    yield from bents("line", HELD, {"period": "1.0001"}, {"factor": "0.50004"}, beside=[LINE])
    yield case(
        "pair",
        FAILS,
        UNEVEN,
        changed(HELD_PAIR, factor="0.8"),
        what="held too long for these weights",
    )
    yield case(
        "pair",
        FAILS,
        HELD_OWN,
        what="weights of its own with nothing beside",
        **_frame_verdict("pair"),
    )
    others = (
        {"alpha": "3.01"},
        {"alpha": "0"},
        {"rho": "0.9"},
        {"rho": None},
        {"v": ["1", "0"]},
        {"v": ["1"]},
    )
    for own in (*others, {"rate": 1}):
        bent = changed(HELD_OWN, certificate=PAIR["exact"] | own)
        yield case("pair", FAILS, UNEVEN, bent, what=f"weights of its own with {own}")
    yield case(
        "pair", FAILS, UNEVEN, changed(HELD_OWN, certificate=None), what="no weights of its own"
    )
    for own in (
        {"kappa": "1/2"},
        {"kappa": "1.01"},
        {"beta": "2.01"},
        {"P": [["0.99"]]},
        {"size": "0.99"},
    ):
        bent = changed(HELD_OBSERVED, certificate=HELD_OBSERVED["exact"]["certificate"] | own)
        yield case(
            "observed", FAILS, OBSERVED, bent, what=f"an observer's part of its own with {own}"
        )
    yield from bents(
        "line", HELD, {"factor": "1"}, {"rate": 1}, {"verdict": "refuted"}, beside=[LINE]
    )
    yield case("pair", FAILS, PAIR, changed(HELD_PAIR, period="0.14", factor="0.58"), what="period")


def _gains(gains: Any, coupling: int = 0) -> list[Document]:
    return [{"coupling": coupling, "gains": gains}]


def _bent_lure() -> Iterator[Case]:
    # The gains are in [-1, 0], and an agent alone decays at 1/10.
    alone = changed(CUBIC, rate=None, ranges=_gains([[["-1", "0"]]]), multipliers={"G": []})
    alone["exact"]["rate"] = "1/20"
    yield case("pushed away", FAILS, alone, what="a gain that is 0 at most is left out")
    yield from bents(
        "cubic", CUBIC, {"domain": ball(0.70711)}, {"level": "0.5001"}, {"radius": "0.9999"}
    )
    yield from bents(
        "cubic", CUBIC, {"radius": "-1"}, {"level": None}, {"level": None, "domain": GLOBAL}
    )
    free = {"level": None, "radius": None, "rate": "0", "method": "vertices", "multipliers": {}}
    everywhere = claim(
        "lure", GLOBAL, None, CUBIC["exact"] | free | {"ranges": _gains([[["1", "1"]]])}
    )
    seen = changed(everywhere, P=[["1/2", "-1/4"], ["-1/4", "1/3"]])
    yield case("harmonic", HOLDS, seen, what="everywhere", **_frame_verdict("harmonic"))
    skew = changed(seen, P=[["1/2", "-1/4"], ["-0.26", "1/3"]])
    yield case(
        "harmonic", FAILS, skew, what="P of lure is not symmetric", **_frame_verdict("harmonic")
    )
    local = changed(seen, domain=ball(1, 0.5))
    yield case("harmonic", FAILS, local, what="a ball without level", **_frame_verdict("harmonic"))
    blind = changed(everywhere, P=[["-1"]])
    yield case(
        "bad W", FAILS, blind, verdict="proved", rate=None, covered_by="lure", what="P < 0 of lure"
    )
    saddle = changed(everywhere, P_e=[[0, 1, "2"]], ranges=_gains([[["-1", "-1"]]]))
    yield case(
        "unstable",
        FAILS,
        saddle,
        verdict="proved",
        rate=None,
        covered_by="lure",
        what="P_e is a saddle",
    )
    yield from bents(
        "cubic", CUBIC, {"level": None, "radius": None, "domain": GLOBAL}, {"domain": box(0.5)}
    )
    for gains in (["1", "1.9999"], ["1.0001", "2"]):
        yield case(
            "cubic",
            FAILS,
            changed(CUBIC, ranges=[{"coupling": 0, "gains": [[gains]]}]),
            what=f"gains {gains}",
        )
    # sin y <= y/2 holds at y = 5/2, not at 1; an off-diagonal gain; the slope of y2^3 on |y2| <=
    # 1/2 is at most 3/4.
    wavy = changed(
        CUBIC, radius="5/2", level="25/8", domain=ball(1.5), ranges=_gains([[["1/5", "1/2"]]])
    )
    yield case("wavy", FAILS, wavy, what="a gain that is passed in between")
    wavy = changed(wavy, ranges=_gains([[["1/5", "1.00001"]]]), rate=1.0)
    wavy["exact"]["rate"] = "1"
    yield case("wavy", HOLDS, wavy, what="true")
    plane = {
        "P_e": [[k, k, "1"] for k in range(4)],
        "rate": "0",
        "multipliers": {},
        "method": "interval",
    }
    both = [[["0.7", "1.00001"], ["0", "0"]], [["0", "0"], ["0.7", "1.00001"]]]
    for off, code in ((["0", "0"], HOLDS), (["0.1", "0.1"], FAILS)):
        gains = [[both[0][0], off], both[1]]
        exact = CUBIC["exact"] | plane | {"ranges": _gains(gains)}
        check = claim("lure", ball(0.7), None, exact)
        yield case("matrix", code, check, **UNDECIDED, what=f"a gain {off[0]} beside the diagonal")
    for top, code in (("0.2501", HOLDS), ("0.2499", FAILS)):
        gains = [[["1", "1.00001"], ["0", top]], [["0", "0"], ["1", "1.00001"]]]
        gains[0][0][0] = gains[1][1][0] = "0.99999"
        exact = CUBIC["exact"] | plane | {"ranges": _gains(gains), "radius": "1/2", "level": "1/8"}
        check = claim("lure", ball(0.35), None, exact)
        yield case("list", code, check, **UNDECIDED, what=f"a gain of {top}")
    # h is y on |y| <= 1 only: the radius counts though the gain is one number.
    flat = changed(CUBIC, ranges=_gains([[["0.99999", "1.00001"]]]), rate=1.0)
    flat["exact"]["rate"] = "1"
    yield case("flat", HOLDS, flat, what="true")
    yield case("flat", FAILS, changed(flat, level="0.5001"), what="level")
    mixed = [*_gains([[["1", "1.2501"]]]), *_gains([[["2", "2"]]], 1)]
    two = changed(CUBIC, ranges=mixed, radius="1/2", level="1/8", domain=ball(0.353), rate=1.0)
    two["exact"] |= {"rate": "1", "multipliers": {"G": ["1", "0"]}}
    yield case("two kinds", HOLDS, two, what="true")
    for gains in (["1.9999", "1.9999"], ["2.0001", "2.0001"]):
        ranges = [mixed[0], *_gains([[gains]], 1)]
        yield case("two kinds", FAILS, changed(two, ranges=ranges), what=f"gains {gains}")
    tau = changed(two, multipliers={"G": ["1", "1"]})
    yield case("two kinds", FAILS, tau, what="a multiplier of one gain")
    yield from bents(
        "cubic",
        CUBIC,
        {"ranges": []},
        {"ranges": CUBIC["exact"]["ranges"] * 2},
        {"ranges": {}},
        {"P_e": "I"},
    )
    yield from bents(
        "cubic", CUBIC, {"ranges": [CUBIC["exact"]["ranges"][0] | {"coupling": False}]}
    )
    taus = (
        {"G": ["1", "0"]},
        {"G": ["1", "-1"]},
        {"G": ["1"]},
        {"H": ["1", "1"]},
        {"G": ["1", "1"], "H": []},
    )
    yield from bents(
        "cubic", CUBIC, *({"multipliers": tau} for tau in taus), {"method": "vertices"}
    )
    yield from bents("cubic", CUBIC, {"method": "circle", "multipliers": {}}, {"rate": 2.71})
    yield case("cubic", FAILS, changed(CUBIC, rate=0), **UNDECIDED, what="rate 0")
    for method, sharp in (("lure", "2.75"), ("interval", "2"), ("vertices", "3")):
        other = changed(
            CUBIC, method=method, multipliers={"G": ["1", "1"]} if method == "lure" else {}
        )
        other["exact"]["rate"] = sharp
        yield case("cubic", FAILS, other, what=f"rate of {method}")
    negative = changed(CUBIC, rate=None)
    negative["exact"]["rate"] = "-1"
    yield case(
        "cubic",
        FAILS,
        negative,
        verdict="proved",
        rate=None,
        covered_by="lure",
        what="negative rate",
    )
    indefinite = changed(CUBIC, P_e=[[0, 0, "1"], [1, 1, "-1"]])
    yield case("cubic", FAILS, indefinite, what="P_e")
    for P_e in ([[1, 0, "1/10"]], [[0, 0, "1"]], [[0, 1, "0"]]):
        yield case(
            "cubic", FAILS, changed(CUBIC, P_e=[*CUBIC["exact"]["P_e"], *P_e]), what=f"{P_e} in P_e"
        )
    for place in (-1, 2, True, "0"):
        yield case(
            "cubic", FAILS, changed(CUBIC, P_e=[[place, place, "1"]]), what=f"P_e at {place!r}"
        )


def _bent_equilibria() -> Iterator[Case]:
    good = second_box()
    for shift in ("2e-6", "-2e-6"):
        yield case("second", FAILS, second_box(shift=shift), **REFUTED, what="beside it")
    for name in ("second, left", "second, right", "second, far"):
        yield case(name, FAILS, good, **REFUTED, what="outside the region")
    yield case("second, moved", HOLDS, good, **REFUTED, what="a target that is not 0")
    alone = _frame_verdict("second, no region")
    yield case("second, no region", HOLDS, good, what="the question is about the target", **alone)
    yield case("second, curved list", HOLDS, second_box(components=2), **REFUTED, what="a list")
    target = [["-1e-6", "1e-6"]] * 2
    witness = {"kind": "start", "values": ["0", "0"]}
    yield case(
        "second", FAILS, changed(good, box=target, witness=witness), **REFUTED, what="the target"
    )
    yield case("second", FAILS, second_box("1.7"), **REFUTED, what="the target in the box")
    yield case("second", FAILS, good, **UNDECIDED, what="the verdict")
    yield case("second, unobserved", FAILS, good, **REFUTED, what="no observer gain")
    yield from bents(
        "second", good, {"rate": 1}, {"margin": 0}, {"mode": "H"}, {"domain": box(1)}, **REFUTED
    )
    yield case("second", FAILS, changed(good, verdict="proved"), **UNDECIDED, what="proved")
    witness = good["witness"] | {"values": [x[:-1] for x in good["witness"]["values"]]}
    yield case("second", FAILS, changed(good, witness=witness), **REFUTED, what="not the middle")
    empty = [[hi, lo] for lo, hi in good["exact"]["box"]]
    yield case("second", FAILS, changed(good, box=empty), **REFUTED, what="an empty box")
    yield from bents(
        "second",
        good,
        {"box": good["exact"]["box"][:1]},
        {"box": "text"},
        {"box": [["1"]] * 2},
        **REFUTED,
    )
    yield from bents(
        "second",
        good,
        {"witness": {"kind": "vector", "values": good["witness"]["values"]}},
        **REFUTED,
    )


def _bent_frames() -> Iterator[Case]:
    yield case("pair", FAILS, PAIR, **UNDECIDED, what="the verdict")
    small = changed(PAIR, domain=box(0.9999))
    yield case("pair", FAILS, small, what="it does not cover")
    yield case("pair", HOLDS, small, **UNDECIDED, what="it does not cover, and says so")
    calm = changed(OBSERVED, domain=box(1, 0.4999))
    yield case("observed", FAILS, calm, what="it covers less disturbance")
    yield case("observed", HOLDS, calm, **UNDECIDED, what="less disturbance")
    yield case("cubic", FAILS, changed(CUBIC, domain=ball(0.69)), what="a ball that does not cover")
    for domain in ({"kind": "box", "radius": 1}, box("1"), 5):
        yield case("pair", UNREADABLE, PAIR | {"domain": domain}, what=f"the domain {domain}")
    yield case(
        "line",
        FAILS,
        LINE,
        verdict="proved",
        rate=0.5,
        covered_by="delay",
        what="covered by a delay",
    )
