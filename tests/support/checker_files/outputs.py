"""Agents whose outputs are measured, for the lone checker: certificates of their loops, and twins
wrong in one place.

Carts with y = x1 and a force of 2 rad/s: W = (8, 20, 0, w) makes s^4 + 8 s^3 + 24 s^2 + 32 s + 80 +
2 w of F, which is Hurwitz for -40 < w < 0.  Points with y = x and a constant force: W = (6, 5) has
-1 and -5, and E = (6, 0) where couplings act on estimates, (0, 1) where they act on outputs.  Of a
force that does not act (C = 0) F keeps a 0 that E does not see.  h = y - 25/9 y^3 vanishes at 3/5.
"""

import json
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

from certified import certified, consensus_claims
from texts import matrix

from checker_files.files import (
    FAILS,
    HOLDS,
    UNREADABLE,
    Case,
    Document,
    about,
    check_of,
    collected,
    network,
    scalar,
)
from dobc_design import Exosystem, Group, Observer, Problem
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes

LINE = network([[2, 1]], agents=2)
CART: Document = {"A": matrix("0 1; 0 0"), "B": matrix("0; 1"), "H": matrix("1 0")}
CARTS: Document = {
    "network": LINE,
    "dynamics": CART,
    "coupling": "2*y1 + 3*y2",
    "gains": {1: matrix("4 4")},
    "exosystem": Exosystem(A=matrix("0 2; -2 0"), C=matrix("1 0")),
    "observer": Observer(W=matrix("8; 20; 0; -32")),
}
POINT: Document = {"A": [[0]], "B": [[1]], "H": [[1]]}
POINTS: Document = {
    "network": LINE,
    "dynamics": POINT,
    "coupling": "y",
    "gains": {1: 3, 2: 3},
    "exosystem": scalar(0),
    "observer": Observer(W=matrix("6; 5")),
}
Change = Callable[[Document, Document], None]


def stated(value: Any, *path: Any) -> Change:
    """Put a value into the problem."""
    return lambda problem, _: _put(problem, value, *path)


def claimed(value: Any, *path: Any, id: str = "") -> Change:
    """Put a value into the certificate, or into its check of this name."""

    def change(_: Document, claims: Document) -> None:
        _put(check_of(claims, id) if id else claims, value, *path)

    return change


def _put(place: Any, value: Any, *path: Any) -> None:
    *steps, last = path
    for step in steps:
        place = place[step]
    place[last] = value


def bent(
    problem: Problem, name: str, *changes: Change, code: int = FAILS, whole: bool = False
) -> Case:
    """The certificate of a problem, and its file, with changes of both."""
    document = json.loads(canonical_bytes(problem))
    claims = certified(problem).claims if whole else consensus_claims(problem)
    certificate = json.loads(certificate_bytes(claims))
    for change in changes:
        change(document, certificate)
    return about(document, certificate, name=f"outputs: {name}", code=code)


def _proved_by(id: str) -> list[Change]:
    """The verdict that somebody would conclude who does not ask about the estimates."""

    def change(_: Document, claims: Document) -> None:
        rate = check_of(claims, id)["rate"]
        claims |= {"verdict": "proved", "rate": rate, "covered_by": id}

    return [change]


def in_region(width: Any, off: Any, **more: Any) -> Problem:
    region = {"initial_states": [f"-{width}", width], "initial_disturbance": off}
    return Problem(**POINTS | {"region": region} | more)


@collected
def outputs_cases() -> Iterator[Case]:
    """All of them, the good ones first."""
    carts = Problem(**CARTS)
    points = Problem(**POINTS)
    acting = Problem(**POINTS | {"dynamics": POINT | {"acts_on": "outputs"}})
    idle = Problem(**POINTS | {"exosystem": scalar(0, 0)})
    three = Problem(
        **CARTS
        | {
            "dynamics": {"A": matrix("-1 0; 0 -2"), "B": matrix("1; 1"), "H": matrix("1 1; 0 1")},
            "observer": Observer(W=matrix("1 2; 3 4; 5 6; 0 1")),
        }
    )
    both = Observer(W=matrix("6; 5"))
    groups = [
        Group(agents=[1], exosystem=scalar(0), observer=both),
        Group(agents=[2], exosystem=scalar(-1), observer=both),
    ]
    grouped = Problem(**POINTS | {"exosystem": None, "observer": None, "groups": groups})
    for name, problem in {
        "carts": carts,
        "points": points,
        "outputs": acting,
        "idle": idle,
        "two outputs": three,
        "groups": grouped,
    }.items():
        yield bent(problem, name, code=HOLDS)
    # Of F and E.
    for row, value in enumerate(("9", "21", "1", "-31")):
        yield bent(carts, f"row {row} of W", stated(value, "observer", "W", row, 0))
    yield bent(carts, "on the axis", stated("-40", "observer", "W", 3, 0))
    yield bent(points, "another E", stated("outputs", "dynamics", "acts_on"))
    yield bent(acting, "an E of estimates", lambda problem, _: problem["dynamics"].pop("acts_on"))
    yield bent(points, "another H", stated("2", "dynamics", "H", 0, 0))
    yield bent(carts, "another plant", stated("-1/10", "dynamics", "A", 1, 1))
    yield bent(idle, "estimates that stay off", *_proved_by("linearisation"))
    # Of what is seen.
    yield bent(carts, "a rank", claimed("3", "exact", "rank", id="observability"))
    yield bent(idle, "detectable", claimed("proved", "verdict", id="detectability"))
    yield bent(idle, "decaying", claimed("proved", "verdict", id="hurwitz"))
    yield bent(carts, "a rate of estimates", claimed(2.01, "rate", id="hurwitz"))
    # Where estimates start.
    near = in_region("0.25", "0.25", coupling="tanh(y)")
    yield bent(near, "a region", code=HOLDS, whole=True)
    wider = stated(["-1/2", "1/2"], "region", "initial_states", 0)
    yield bent(near, "the starts of estimates", wider, whole=True)
    hardly = stated(["-1/4", "251/1000"], "region", "initial_states", 0)
    yield bent(near, "hardly more", hardly, whole=True)
    falling = {"coupling": "y - 25/9*y**3", "gains": {1: 2}}
    resting = in_region("0.7", "0.25", **falling)
    yield bent(resting, "a rest", code=HOLDS, whole=True)
    inside = stated(["-1/2", "1/2"], "region", "initial_states", 0)
    yield bent(resting, "a rest of estimates alone", inside, whole=True)
    yield from _disturbed(points, acting)
    yield from _unreadable(points, grouped)


def _disturbed(points: Problem, acting: Problem) -> Iterator[Case]:
    """Final bounds: of states where estimates or outputs are acted on."""
    bands = [["9/10", "11/10", "1/10"]]
    acts = {"disturbance": "1/10", "drift": "1/20", "measurement": "1/100", "bands": bands}
    noisy = points.replace(uncertainty=acts)
    felt = acting.replace(uncertainty=acts | {"measurement": "0"})
    yield bent(noisy, "all that acts", code=HOLDS, whole=True)
    yield bent(felt, "what acts beside outputs", code=HOLDS, whole=True)
    exact = ("exact", "peaks")
    for name, path in {
        "x off xhat": (*exact, "off", 0),
        "a peak of a disturbance": (*exact, "disturbance"),
        "a peak of a drift": (*exact, "drift"),
        "a peak of noise": (*exact, "measurement"),
        "what enters of a band": (*exact, "bands", 0, 0, 0),
        "x off xhat in a band": (*exact, "bands", 0, 1, 0),
        "a bound": ("exact", "bounds", "1", 0),
    }.items():
        yield bent(noisy, name, _less(*path), whole=True)
    yield bent(felt, "a bound beside outputs", _less("exact", "bounds", "2", 0), whole=True)
    noise = stated("1/1000", "uncertainty", "measurement")
    yield bent(felt, "noise in couplings", noise, whole=True)


def _less(*path: Any) -> Change:
    """A number of the final bounds, a thousandth smaller."""

    def change(_: Document, claims: Document) -> None:
        *steps, last = path
        place = check_of(claims, "accuracy")
        for step in steps:
            place = place[step]
        place[last] = str(Fraction(place[last]) * Fraction(999, 1000))

    return change


def fewer(problem: Document, _: Document) -> None:
    """One group less."""
    problem["exosystem"]["groups"].pop()


def _unreadable(points: Problem, grouped: Problem) -> Iterator[Case]:
    """What no problem is."""
    ages = {"delay": "1/10", "own_delay": "0", "event": "0", "lost": 0}
    limits = {"limit": "100", "amplitude": "1"}
    for name, change in {
        "no W": stated(None, "observer", "W"),
        "a W of the exosystem": stated([["5"]], "observer", "W"),
        "a W of states": stated([["6", "0"], ["5", "0"]], "observer", "W"),
        "a P of the exosystem": stated([["1"]], "observer", "P"),
        "an empty H": stated([], "dynamics", "H"),
        "an H of 0": stated([["0"]], "dynamics", "H"),
        "an H of two states": stated([["1", "0"]], "dynamics", "H"),
        "dependent rows": stated([["1"], ["2"]], "dynamics", "H"),
        "another word": stated("states", "dynamics", "acts_on"),
        "readings": stated(ages, "readings"),
        "actuators": stated(limits, "actuators"),
        "an old version": stated(2, "version"),
    }.items():
        yield bent(points, name, change, code=UNREADABLE)
    alone = stated([0], "exosystem", "groups", 0, "agents")
    yield bent(grouped, "an agent without exosystem", alone, fewer, code=UNREADABLE)
    plain = Problem(network=LINE, dynamics={"A": [[0]]}, coupling="y", gains={1: 3, 2: 3})
    seen = stated([["1"]], "dynamics", "H")
    new = stated(4, "version")
    yield bent(plain, "nobody has an exosystem", seen, new, code=UNREADABLE)
    curved = stated({"f": ["-x"], "B": [["1"]], "H": [["1"]]}, "dynamics")
    yield bent(points, "f", curved, code=UNREADABLE)
    nothing = stated({"A": [["0"]], "B": [["1"]], "acts_on": "outputs"}, "dynamics")
    old = stated(2, "version")
    yield bent(points, "outputs without H", nothing, old, code=UNREADABLE)
    known = stated({"A": [["0"]], "B": [["1"]]}, "dynamics")
    yield bent(points, "a W of measured outputs", known, old, code=UNREADABLE)
    none = stated({"W": None, "P": None, "rate": None}, "observer")
    unseen = stated(None, "exosystem")
    yield bent(points, "no exosystem", none, unseen, code=UNREADABLE)
