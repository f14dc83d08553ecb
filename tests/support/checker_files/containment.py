"""Agents between fixed nodes: true certificates, the same with claims that are true of one target
only, and problem files that nobody may read."""

import json
from collections.abc import Iterator
from functools import cache
from typing import Any

from certified import certified, few_chords, rough_settling

from checker_files.files import FAILS, HOLDS, UNREADABLE, Case
from dobc_design import Exosystem, Network, Observer, Problem, Switching
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes, problem_sha256

PATH = [[1, "a"], [1, 2], [2, 1], [2, 3], [3, 2], [3, "b"]]
#: What is true of a target alone, of the path with both nodes at 0.
OF_TARGETS = ("lemma1", "linearisation", "sampling", "tolerance", "lure")


def between(a: Any, b: Any, coupling: str = "y", arcs: Any = PATH, **more: Any) -> Problem:
    network = Network.from_arcs(arcs, arrow="listens_to", fixed=("a", "b"))
    fixed = {"a": a, "b": b}
    return Problem(network=network, coupling=coupling, goal="containment", fixed=fixed, **more)


def document(problem: Problem, **options: Any) -> dict[str, Any]:
    """Its certificate."""
    found: dict[str, Any] = json.loads(certificate_bytes(certified(problem, **options).claims))
    return found


def of(name: str, made: dict[str, Any], problem: Problem, code: int) -> Case:
    """A certificate that says it is about this problem."""
    claims = made | {"problem_sha256": problem_sha256(problem)}
    return Case(name, json.dumps(claims).encode(), canonical_bytes(problem), code)


def _true() -> Iterator[Case]:
    moving = {"between": [3, 5]}
    settings = {
        "linear": between(0, moving),
        "rising": between(0, moving, "tanh(y)", region={"initial_states": [-1, 6]}),
        "no region": between(0, 1, "tanh(y)"),
        "one place": between(2, 2),
        "apart": between(0, 1, arcs=[*PATH, [4, 5], [5, 4]]),
        "inside": between(0, 4, arcs=[*PATH, [4, 5], [5, 4]], region={"initial_states": [1, 2]}),
    }
    for name, problem in settings.items():
        yield of(f"between: {name}", document(problem), problem, HOLDS)


def _false() -> Iterator[Case]:
    region = {"initial_states": [-1, 1]}
    twin = document(between(0, 0, region=region), everything=True)
    problem = between("-1/10", "1/10", region=region)
    true = document(problem)
    for check in twin["checks"]:
        if check["id"] in OF_TARGETS and check["verdict"] == "proved":
            others = [each for each in true["checks"] if each["id"] != check["id"]]
            forged = true | {"checks": [*others, check]}
            yield of(f"between: {check['id']} of one target", forged, problem, FAILS)
    watched = {"exosystem": Exosystem(A=[[0]], C=[[1]]), "observer": Observer(W=[[2]])}
    twin = document(between(0, 0, **watched))
    problem = between(0, 1, **watched)
    true = document(problem)
    for check in twin["checks"]:
        if check["id"] in ("theorem1", "theorem1-weighted") and check["verdict"] == "proved":
            others = [each for each in true["checks"] if each["id"] != check["id"]]
            forged = true | {"checks": [*others, check], "observer": twin["observer"]}
            yield of(f"between: {check['id']} of one target", forged, problem, FAILS)
    arcs = [[1, "a"], [1, "b"]]
    near = between("-7/10", "7/10", "sin(y)", arcs, region={"initial_states": ["-4/5", "4/5"]})
    far = between(-3, 3, "sin(y)", arcs, region={"initial_states": ["-31/10", "31/10"]})
    yield of("between: sin is far apart", document(near), far, FAILS)
    stays = between(0, 1, exosystem=Exosystem(A=[[0]], C=[[1]]), observer=Observer(W=[[0]]))
    refuted = document(stays) | {"verdict": "refuted"}
    yield of("between: estimates that stay refute nothing", refuted, stays, FAILS)


def _turned() -> Iterator[Case]:
    """max-separable and schedule in coordinates, T = 1."""
    for id, problem in {"max-separable": between(0, 1), "schedule": _in_turn(0, 1)}.items():
        with few_chords():
            true = document(problem)
        (check,) = [each for each in true["checks"] if each["id"] == id]
        ranges = [{"coupling": 0, "gains": [[["1", "1"]]]}]
        turned = check | {"exact": check["exact"] | {"T": [["1"]], "ranges": ranges}}
        others = [each for each in true["checks"] if each["id"] not in (id, "delay")]
        forged = true | {"checks": [*others, turned]}
        yield of(f"between: {id} in coordinates", forged, problem, FAILS)


def _in_turn(a: Any, b: Any, coupling: str = "y", **more: Any) -> Problem:
    """A network of which neither graph reaches both agents."""
    arcs = {"A": [[1, "a"]], "B": [[1, 2], [2, "b"]]}
    switching = Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)
    return between(a, b, coupling, arcs, switching=switching, **more)


def _moving() -> Iterator[Case]:
    """Weights that move, and boxes."""
    near = _in_turn(0, "1/2", "sin(y)", region={"initial_states": ["-1/4", "3/4"]})
    far = _in_turn(-3, 3, "sin(y)", region={"initial_states": ["-13/4", "13/4"]})
    with rough_settling():
        true = document(near, settling="1/10")
    yield of("between: sin in turn", true, near, HOLDS)
    for id in ("schedule", "settling"):
        others = [each for each in true["checks"] if each["id"] not in ("schedule", "settling")]
        (check,) = [each for each in true["checks"] if each["id"] == id]
        forged = true | {"checks": [*others, check]}
        yield of(f"between: {id} of sin far apart", forged, far, FAILS)
    (grows,) = [
        each for each in document(_in_turn(0, 0, "-y"))["checks"] if each["id"] == "schedule"
    ]
    apart = _in_turn(0, 1, "-y")
    true = document(apart)
    others = [each for each in true["checks"] if each["id"] != "schedule"]
    forged = true | {"checks": [*others, grows]}
    yield of("between: errors from one target grow", forged, apart, FAILS)


def _unreadable() -> Iterator[Case]:
    problem = between(0, 1)
    certificate = json.dumps(document(problem)).encode()
    stated = json.loads(canonical_bytes(problem))
    nodes = stated["fixed"]
    errors = dict.fromkeys(("weights", "gains", "disturbance", "drift", "measurement"), "0")
    changes: dict[str, dict[str, Any]] = {
        "one name twice": {"fixed": [nodes[0], nodes[0]]},
        "the name of an agent": {"fixed": [["1", nodes[0][1]], nodes[1]]},
        "bounds in the wrong order": {"fixed": [["a", [["1", "0"]]], nodes[1]]},
        "no node": {"fixed": [], "modes": [{"name": "G", "arcs": [[0, 1, "1"]]}]},
        "agreement": {"goal": "agreement"},
        "dynamics": {"dynamics": {"A": [["0"]], "B": [["1"]]}, "version": 4},
        "a target": {"target": ["1"]},
        "an offset": {"offsets": [[0, ["1"]]]},
        "a gain": {"gains": [[0, [["1"]]]]},
        "signs": {
            "negative": "opposes",
            "modes": [{"name": "G", "arcs": [[0, 3, "1"], [0, 1, "-1"], [1, 0, "1"]]}],
        },
        "actuators": {"actuators": {"limit": "1", "amplitude": None}},
        "uncertainty": {"uncertainty": errors | {"weights": "1/10", "known_to_agents": True}},
    }
    for name, change in changes.items():
        text = json.dumps(stated | change)
        yield Case(f"between: {name}", certificate, text.encode(), UNREADABLE)
    for name, change in {
        "two targets": {},
        "another target": {"fixed": [["a", [["1", "1"]]]], "target": ["2"]},
    }.items():
        bare = {key: value for key, value in (stated | change).items() if key != "goal"}
        yield Case(f"between: {name}", certificate, json.dumps(bare).encode(), UNREADABLE)
    bare = {key: value for key, value in stated.items() if key != "fixed"}
    bare["modes"] = [{"name": "G", "arcs": [[0, 1, "1"]]}]
    yield Case("between: nothing", certificate, json.dumps(bare).encode(), UNREADABLE)


@cache
def containment_cases() -> list[Case]:
    return [*_true(), *_false(), *_turned(), *_moving(), *_unreadable()]
