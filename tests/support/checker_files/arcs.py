"""Arc-wise certificates for the lone checker: claims written by hand, and twins that just fail.

Gains of sin and tanh are at most 1, and largest at 0: with a = 0 an arc of weight w takes b = d_i w
/ 2 of whom it hears, and no less. So 0.501 holds, 0.499 does not, and what is left of an agent with
k = 3 that one other hears is 6 - 0.501 = 2 rate.
"""

import json
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cache, partial
from typing import Any

from certified import consensus_claims
from texts import vector

from checker_files.files import (
    GONE,
    Case,
    Document,
    Forger,
    changed,
    collected,
    network,
    scalar,
)
from checker_files.separable import (
    LINE_NET,
    UNDECIDED,
    WATCHED,
    agents,
    asked,
    ball,
    box,
    claim,
    claimed_in,
    given,
)
from checker_files.settling import last, settling, tube
from dobc_design import Group, Network, Observer, Problem, Switching
from dobc_design.certificate.text import certificate_bytes
from dobc_design.conditions.kinds import KINDS
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.dynamics import Dynamics

HALF = "0.501"
BALL = ball(2.2)  # in V <= 4.9
RATE = 2.7495
#: From the page of the theory: the directed cycle of ten, agent 1 pinned with 3, in thousandths.
TAKEN = {
    "a": (1512, -1535, -1899, -1984, -2011, -2026, -2049, -2087, -2169, -2418),
    "b": (1527, 1892, 1977, 2004, 2019, 2041, 2080, 2162, 2410, 4481),
}


def shares(domain: Any, rate: float, a: Any, b: Any, level: str = "4.9", **more: Any) -> Document:
    """A claim; one text for the single mode, or an object for several."""
    both = {"a": a, "b": b}
    for name, each in both.items():
        texts = each if isinstance(each, dict) else {"G": each}
        both[name] = {mode: vector(text) for mode, text in texts.items()}
    exact = {"d": ["1", "1"], "level": level, "rate": str(rate)} | both | more
    return claim("arc-wise", domain, rate, exact)


def thousandths(numbers: Sequence[int]) -> str:
    return " ".join(str(Fraction(x, 1000)) for x in numbers)


TEN = shares(ball(2.8), 0.003, *map(thousandths, TAKEN.values()), "7.84", d=["1"] * 10)
SINES = shares(BALL, RATE, "0 0", f"{HALF} {HALF}")
ONE_ARC = shares(BALL, RATE, "0", HALF)
# The bounds of d_i (K_i + K_i') - S - ... are worked out beside each problem.
WATCHED_ONE = shares(ball(2.2, 0.1), 1, "0 0", f"{HALF} {HALF}", P=[["0.1429"]])


def _settings() -> dict[str, Document]:
    ten = [[i, i % 10 + 1] for i in range(1, 11)]
    sines = partial(given, "sin(y)")
    one_each = network({"A": [[1, 2]], "B": [[2, 1]]})
    loose = Network.from_arcs([[1, 2]], arrow="listens_to", optional=[[2, 1]])
    turned = Network.from_arcs(
        {"A": [[2, 1]], "B": [[2, 1, -1]]}, arrow="listens_to", agents=2, negative="opposes"
    )
    to_post = [[1, "post", 3], [2, "post", 3]]
    post = Network.from_arcs([*to_post, [1, 2], [2, 1]], arrow="listens_to", fixed=["post"])
    away = Network.from_arcs(
        [to_post[1], [1, 2]], optional=to_post[:1], arrow="listens_to", fixed=["post"]
    )
    held: Document = {"gains": None, "fixed": {"post": 0}}
    all_of_three = network([[i, j] for i in (1, 2, 3) for j in (1, 2, 3) if i != j])
    agree: Document = {"coupling": "tanh(y)", "gains": None, "goal": "agreement"}
    doubled = {"exceptions": {(0, 1): "2*tanh(y)"}}
    square = asked([[-1, 1], [-1, 1]])
    led = {"leader": {"initial": ["-1/2", "1/2"], "stays_in": [-1, 1]}}
    group = Group(agents=[1], exosystem=scalar(0), observer=Observer(W=[[2]]))
    near = asked("1/10", "1/100")
    planar: Document = {"target": [0, 0], "region": square}
    moved = Network.from_arcs(
        [[1, "p"], [2, "q"], [1, 2], [2, 1]], arrow="listens_to", fixed=["p", "q"]
    )
    found: dict[str, Document] = {}
    wide = asked("22/25")
    found["ten"] = given("exp(y) - 1 + y", network=network(ten), gains={1: 3}, region=wide)
    found["sines"] = sines()
    found["no region"] = sines(region=None)
    found["one sine"] = sines(network=LINE_NET)
    found["mixed"] = sines(exceptions={(1, 0): "y"})
    found["two modes"] = sines(network=one_each)
    dwelling = Switching(guarantee="dwell", dwell=1)
    found["dwelling"] = sines(network=one_each, switching=dwelling)
    found["loose"] = sines(network=loose)
    found["planar"] = sines(gains={1: [[3, 1], [0, 3]], 2: 3}, **planar)
    found["list"] = given(["sin(y1)", "tanh(y2)"], gains=3, **planar)
    found["observed"] = sines(**WATCHED | {"region": asked(1, "1/10")})
    found["observed, held"] = sines(**WATCHED | {"gains": 9})
    found["grouped"] = sines(groups=[group], region=asked(1, "1/10"))
    found["nodes"] = sines(dynamics=Dynamics(f=["x + x**3/100"]))
    found["led nodes"] = sines(dynamics=Dynamics(f=["x**3/100 - x"]), **led)
    found["pins of modes"] = sines(gains=None, mode_gains={"G": {1: 3, 2: 3}})
    found["post"] = given("tanh(y)", network=post, **held)
    found["post, loose"] = given("tanh(y)", network=away, **held)
    found["log post"] = given("log(1 + y)", network=post, **held, region=asked("1/10"))
    found["saturated"] = sines(actuators={"limit": 3, "saturates": True})
    found["agreeing"] = {"network": all_of_three, "region": asked("1/5"), **agree, **doubled}
    chain = [[2, 1], [3, 2]]
    found["agreeing, led"] = {"network": network(chain), "region": asked("7/20"), **agree}
    found["agreeing, modes"] = {"network": network({"A": chain, "B": chain}), **agree}
    found["agreeing, watched"] = {"network": network(chain), **WATCHED, **agree, "region": near}
    found["signs"] = sines(network=turned)
    tenth = {"weights": "1/10", "gains": "1/10"}
    found["off"] = sines(uncertainty=tenth)
    found["post, off"] = given("tanh(y)", network=post, **held, uncertainty={"gains": "1/10"})
    found["planar, off"] = sines(
        gains={1: [[3, 1], [0, 3]], 2: 3}, **planar, uncertainty={"gains": "1/10"}
    )
    not_told = tenth | {"known_to_agents": False}
    found["not told"] = sines(**WATCHED | {"region": asked(1, "1/10")}, uncertainty=not_told)
    found["apart"] = {
        "network": moved,
        "coupling": "sin(y)",
        "goal": "containment",
        "fixed": {"p": 0, "q": 1},
        "region": asked(1),
    }
    return found


@cache
def _frames() -> dict[str, tuple[bytes, bytes]]:
    """Certificates of what is true at the target, and the problems; all ask for a region."""
    frames = {}
    for name, settings in _settings().items():
        problem = Problem(**settings)
        document = json.loads(certificate_bytes(consensus_claims(problem))) | UNDECIDED
        document["checks"] = [
            check for check in document["checks"] if KINDS[check["id"]].role != "region"
        ]
        frames[name] = json.dumps(document).encode(), canonical_bytes(problem)
    return frames


def made(name: str, code: int, what: str, *checks: Document, **overall: Any) -> Case:
    data, problem = _frames()[name]
    return Case(f"{name}: {what}", claimed_in(data, *checks, **overall), problem, code)


FORGER = Forger(made, title=lambda check: "with")
holds, fails, wrong = FORGER.holds, FORGER.fails, FORGER.wrong


@collected
def arcs_cases() -> Iterator[Case]:
    """All of them."""
    yield from _pages()
    yield from _plain()
    yield from _others()


def moved(name: str, k: int, step: int) -> Case:
    """The certificate of the page with one of its twenty numbers moved by thousandths."""
    some = list(TAKEN[name])
    some[k] += step
    return wrong(
        "ten", TEN, f"{name} {k + 1} by {step}", **{name: {"G": vector(thousandths(some))}}
    )


def _pages() -> Iterator[Case]:
    yield holds("ten", "the certificate of the page", TEN)
    for step in (-50, 50):
        yield moved("a", 9, step)
    swapped = {"a": TEN["exact"]["b"], "b": TEN["exact"]["a"]}
    yield wrong("ten", TEN, "a and b swapped", **swapped)
    yield wrong("ten", TEN, "a larger level", level="8.4", domain=ball(2.89))
    yield wrong("ten", TEN, "a faster rate", rate=0.0041, own="0.0041")
    yield wrong("ten", TEN, "another d", d=["1"] * 9 + ["1.01"])
    yield wrong("ten", TEN, "d of nine", d=["1"] * 9)


def _plain() -> Iterator[Case]:
    yield holds("sines", "a sharp rate", SINES)
    yield holds("sines", "a box", changed(SINES, domain=box(1.565)))
    small = changed(SINES, domain=ball(1.41))
    yield holds("sines", "a ball that does not cover", small, **UNDECIDED)
    yield fails("sines", "a ball that does not cover, and says so", small)
    first = changed(SINES, factor=1)
    yield fails("no region", "a ball answers for the target", first, factor=1)
    yield wrong("sines", SINES, "the ball", domain=ball(2.22))
    yield wrong("sines", SINES, "the box", domain=box(1.566))
    yield wrong("sines", SINES, "everywhere", domain="global")
    yield wrong("sines", SINES, "a disturbance", domain=ball(2.2, 0.1))
    yield wrong("sines", SINES, "the rate of the check", rate=2.7496)
    yield wrong("sines", SINES, "the rate", rate=2.7496, own="2.7496")
    yield wrong("sines", SINES, "no rate", rate=None)
    yield wrong("sines", SINES, "sin where it falls too far", level="10")
    yield wrong("sines", SINES, "the other end", b={"G": ["0.501", "0.499"]}, rate=1, own="1")
    yield wrong("sines", SINES, "too little of its own", a={"G": ["-2", "0"]}, rate=1, own="1")
    yield wrong("sines", SINES, "three arcs", a={"G": ["0", "0", "0"]})
    yield wrong("sines", SINES, "no mode", a={})
    yield wrong("sines", SINES, "another mode", b=SINES["exact"]["b"] | {"H": ["0", "0"]})
    yield wrong("sines", SINES, "a d that is negative", d=["1", "-1"])
    yield wrong("sines", SINES, "a radius", radius="1")
    yield wrong("sines", SINES, "refuted", verdict="refuted", says=UNDECIDED)
    yield wrong("sines", SINES, "a witness", witness=agents("1"))
    # d = 2 for agent 2: it takes 1.002 of agent 1
    uneven = changed(SINES, d=["1", "2"], b={"G": [HALF, "1.002"]}, rate=2.499, own="2.499")
    uneven |= {"domain": ball(1.56), "factor": 1.41422}
    yield holds("sines", "two d", uneven, factor=1.41422)
    yield wrong("sines", uneven, "a factor", factor=1.4142, says={"factor": 1.4142})
    yield wrong("sines", uneven, "a ball for two d", domain=ball(1.57), says={"factor": 1.41422})


def _others() -> Iterator[Case]:
    # 1.002 b >= 1 for a = -0.998
    mixed = changed(SINES, a={"G": ["0", "-0.998"]}, b={"G": [HALF, "0.999"]}, rate=2.5005)
    mixed["exact"]["rate"] = "2.5005"
    yield holds("mixed", "a linear arc", mixed)
    yield wrong("mixed", mixed, "a linear arc", b={"G": [HALF, "0.997"]})

    both = dict.fromkeys("AB", "0")
    two = shares(BALL, RATE, both, dict.fromkeys(both, HALF))
    yield holds("two modes", "both", two)
    yield wrong("two modes", two, "one of them", a={"A": ["0"]})
    yield wrong("two modes", two, "too little in B", b={"A": [HALF], "B": ["0.499"]})
    yield holds("loose", "an arc that comes and goes", SINES)
    less = {"a": {"G": ["0", "-0.01"]}, "b": {"G": [HALF, "0.51"]}, "rate": 1, "own": "1"}
    yield holds("sines", "it gives back", changed(SINES, **less))
    yield wrong("loose", SINES, "it gives back while it is away", **less)

    # K + K' = [6 1; 1 6] >= 5 I
    planar = changed(SINES, domain=box(1.1), rate=2.2495, own="2.2495")
    yield holds("planar", "two components", planar)
    yield wrong("planar", planar, "the rate", rate=2.2496, own="2.2496")
    yield wrong("planar", planar, "a box of two components", domain=box(1.107))
    yield wrong("list", planar, "components", rate=1, own="1")

    # S = 1/((4 - 2 rate) P): 3.499 >= 1/(2 P) for rate = 1
    for name in ("observed", "grouped"):
        yield holds(name, "an observer", WATCHED_ONE)
        yield wrong(name, WATCHED_ONE, "S", P=[["0.1428"]])
        yield wrong(name, WATCHED_ONE, "no P", P=GONE)
        yield wrong(name, WATCHED_ONE, "a large disturbance", domain=ball(2.2, 0.5))
    slow = changed(WATCHED_ONE, rate=2.5, own="2.5", P=[["-1"]])
    yield fails("observed, held", "P < 0", changed(slow, domain=ball(2.2, 0.5)))

    # sup f(y)/y - 1 = 4.9/100: 4 - 0.501 - 0.098 = 2 rate
    nodes = changed(SINES, rate=1.7004, own="1.7004")
    yield holds("nodes", "f", nodes)
    yield wrong("nodes", nodes, "f", rate=1.7006, own="1.7006")
    # slopes of f up to 3 (1 + sqrt(4.9))^2/100 - 1: 8 - 0.501 - 0.6196 = 2 rate
    nodes = changed(SINES, rate=3.438, own="3.438")
    yield holds("led nodes", "slopes of f", nodes)
    yield wrong("led nodes", nodes, "slopes of f", rate=3.441, own="3.441")

    yield holds("pins of modes", "linear ones", SINES)
    yield wrong("pins of modes", SINES, "the rate", rate=2.7496, own="2.7496")
    # 6 tanh(r)/r - 0.501 = 2 rate, r = sqrt(4.9); 6/r - 0.501 for clip(3 y, -3, 3)
    rooms = {"1": "3", "2": "3"}
    inputs = claim("actuators", box(1), None, {"rooms": rooms})
    for name, rate, *others in (("post", 1.0727), ("saturated", 1.1047, inputs)):
        curved = changed(SINES, rate=rate, own=str(rate))
        yield holds(name, "the end of the gain", curved, *others)
        faster = rate + 0.0002
        more = {"rate": faster, "own": str(faster)}
        yield wrong(name, curved, "the end of the gain", **more)
    # agent 1 has nothing but what it gets back
    away = shares(BALL, 0.1, "-0.2", "0.56")
    yield holds("post, loose", "a pin that comes and goes", away)
    yield wrong("post, loose", away, "its pin", rate=0.11, own="0.11")
    yield wrong("log post", SINES, "beyond the pole", rate=1, own="1")

    # 6 (1 - 1/10) - (1 + 1/10) 0.501 = 2 rate
    off = changed(SINES, b={"G": ["0.5511"] * 2}, rate=2.4244, own="2.4244")
    yield holds("off", "weights and gains off", off)
    yield wrong("off", off, "gains off", rate=2.4246, own="2.4246")
    yield wrong("off", off, "weights off", b={"G": [HALF] * 2}, rate=1, own="1")
    # 5.4 tanh(r)/r - 0.501
    off = changed(SINES, rate=0.9403, own="0.9403")
    yield holds("post, off", "a pin that is an arc", off)
    yield wrong("post, off", off, "a pin that is an arc", rate=0.9406, own="0.9406")
    # 5 I less (4 + 4) / 10
    off = changed(planar, rate=1.8495, own="1.8495")
    yield holds("planar, off", "entries of gains", off)
    yield wrong("planar, off", off, "entries of gains", rate=1.8496, own="1.8496")
    # it says nothing of estimates that are off
    yield holds("not told", "of the model alone", WATCHED_ONE, **UNDECIDED)
    yield fails("not told", "as if it answered", WATCHED_ONE)

    # pairs: six arcs by which (i, j) listens, six by which (j, i) does; the first is doubled
    heavy = " ".join(["1.002", *[HALF] * 5] * 2)
    pairs = shares(ball(0.99), 0.7716, " ".join("0" * 12), heavy, "1", d=["1"] * 6)
    yield holds("agreeing", "pairs", pairs)
    yield wrong("agreeing", pairs, "the rate", rate=0.7718, own="0.7718")
    between = ["1.002", "1.002", *[HALF] * 10]
    yield wrong("agreeing", pairs, "the order of arcs", b={"G": between}, rate=0.1, own="0.1")
    # six differences of up to 0.4
    yield wrong("agreeing", pairs, "a ball of three", domain=ball(0.7))
    led = shares(ball(0.995), 0.1, "-0.2", "0.56", "1")
    yield holds("agreeing, led", "differences to a root", led)
    near = shares(ball(0.1), 0.1, dict.fromkeys("AB", "-0.2"), dict.fromkeys("AB", "0.56"), "1")
    yield holds("agreeing, modes", "near agreement", near)
    yield wrong("agreeing, modes", near, "a ball of no size", domain=ball(0))
    both_errors = led["exact"] | {"rate": "0.05", "P": [["1000"]]}
    seen = led | {"domain": ball(0.85, 0.01), "rate": 0.05, "exact": both_errors}
    yield fails("agreeing, watched", "two errors of estimates", seen)
    both_signs = shares(BALL, RATE, both, dict.fromkeys(both, HALF))
    yield holds("signs", "of both signs", both_signs)
    yield wrong("signs", both_signs, "the rate", rate=2.7496, own="2.7496")
    yield fails("apart", "between fixed nodes", changed(SINES, rate=0.1, own="0.1"))
    near = SINES["exact"] | {"level": "0.5", "rate": "0.6"}
    at_once = last("arc-wise", near, "0.57", "1")
    settled = settling(box(0.4), "0.4", "5", tube("0", "0.4 0.4"), at_once)
    yield fails("apart", "between fixed nodes it settles", settled, **UNDECIDED)
    yield holds("sines", "it settles", settled, **UNDECIDED)
    # it carries the verdict where it is about all starts, and about every signal
    says = {"verdict": "proved", "rate": None, "covered_by": "settling"}
    ends = last("arc-wise", SINES["exact"], "1.4143", "1")
    whole = settling(box(1), "0.4", "5", tube("0", "1 1"), ends)
    yield holds("sines", "it settles from the region", whole, **says)
    yield fails("sines", "it settles, and says nothing", whole, **UNDECIDED)
    yield fails("sines", "it settles from a part of the region", settled, **says)
    ends = last("arc-wise", two["exact"], "1.4143", "1")
    whole = settling(box(1), "0.4", "5", tube("0", "1 1"), ends)
    yield holds("two modes", "it settles in both", whole, **says)
    yield holds("dwelling", "it settles under a guarantee", whole, **UNDECIDED)
    yield fails("dwelling", "it settles under a guarantee", whole, **says)
