"""Final bounds for the lone checker: certificates of one or two agents that `certify` makes, and just-false twins."""

import hashlib
import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

from checker_cases import FAILS, HOLDS, Case
from margins_cases import REGION, SEEN, one, two

from dobc_design import Problem, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.problem.canonical import canonical_bytes, problem_from_canonical

Change = Callable[[Any, Any], None]
PEAKS = ("disturbance", "drift", "measurement")
ALL = {"disturbance": "1/10", "drift": "1/20", "measurement": "1/50"}
BOX = REGION | {"initial_disturbance": "1/10"}


@cache
def _made(problem: Problem) -> tuple[str, str]:
    return canonical_bytes(problem).decode(), certificate_bytes(certify(problem).claims).decode()


def bent(problem: Problem, name: str, *changes: Change, code: int = FAILS) -> Case:
    """The certificate after ``changes`` of the check accuracy and of the document of the problem."""
    document, claims = (json.loads(text) for text in _made(problem))
    check = next(each for each in claims["checks"] if each["id"] == "accuracy")
    for change in changes:
        change(check, document)
    data = canonical_bytes(problem_from_canonical(json.dumps(document).encode()))
    claims["problem_sha256"] = hashlib.sha256(data).hexdigest()
    return Case(f"accuracy {name}", json.dumps(claims).encode(), data, code)


def put(value: Any, *path: Any, of: str = "check") -> Change:
    """Put a value, or what a function makes of the one that is there, at a path into the check or the problem."""

    def change(check: Any, document: Any) -> None:
        place = check if of == "check" else document
        for step in path[:-1]:
            place = place[step]
        place[path[-1]] = value(place[path[-1]]) if callable(value) else value

    return change


def scaled(factor: str, *path: Any) -> Change:
    """Multiply a number of the check."""
    return put(lambda number: str(Fraction(factor) * Fraction(number)), *path)


@cache
def accuracy_cases() -> list[Case]:
    """All of them, the good ones first."""
    lone, curved = one(coupling="y", uncertainty=ALL), two(coupling="tanh(y)", uncertainty=ALL, region=REGION)
    seen = one(coupling="y", uncertainty=ALL, **SEEN)
    both = two(coupling="tanh(y)", uncertainty=ALL, region=BOX, **SEEN)
    far = ("exact", "stages", -1, "level"), ("exact", "bounds", "1")
    loose = [scaled("1000", *path) for path in far] + [scaled("100", "exact", "peaks", x) for x in PEAKS]
    sharp = put("sqrt(y + 1) - 1", "coupling", "h", of="problem")
    return [
        *(bent(each, f"good {k}", code=HOLDS) for k, each in enumerate((lone, curved, seen, both))),
        bent(seen, "loose", *loose, code=HOLDS),
        *(bent(seen, f"smaller peak gain of {x}", scaled("0.999", "exact", "peaks", x)) for x in PEAKS),
        bent(lone, "no table", lambda _, document: document.pop("uncertainty")),
        bent(lone, "rate", put(0.1, "rate")),
        bent(seen, "long steps", *loose, put("1/4", "exact", "peaks", "step")),
        bent(seen, "one step", *loose, put(1, "exact", "peaks", "steps")),
        bent(lone, "no stage", put([], "exact", "stages")),
        bent(curved, "growth", put("-1", "exact", "stages", 0, "alpha")),
        bent(lone, "level below 0", put("-1", "exact", "stages", 0, "level")),
        bent(lone, "rho of linear couplings", put("2", "exact", "stages", 0, "rho")),
        bent(curved, "rho below level", put("1", "exact", "stages", 1, "rho")),
        bent(curved, "a ball", put("ball", "domain", "kind")),
        bent(curved, "wider", put(1.1, "domain", "radius")),
        bent(lone, "somewhere", put("consensus", "domain")),
        bent(both, "kappa", put("1/10", "exact", "kappa")),
        bent(both, "P", put("1", "exact", "P", 0, 0)),
        bent(both, "size", put("1", "exact", "size")),
        bent(lone, "twice", lambda check, _: check["exact"]["stages"].append(check["exact"]["stages"][0])),
        bent(curved, "a gap", put("1", "exact", "stages", 0, "level")),
        bent(lone, "a stranger", put("1", "exact", "bounds", "2")),
        bent(lone, "bound", scaled("0.9999", "exact", "bounds", "1")),
        *(bent(each, f"lower {k}", scaled("9/10", *far[0])) for k, each in enumerate((lone, curved, seen, both))),
        bent(curved, "a slope without bound", sharp),
    ]
