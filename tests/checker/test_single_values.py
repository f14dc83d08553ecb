"""One value of a good certificate or problem replaced by another: the second program accepts or
refuses, cleanly."""

import json
from collections.abc import Iterator
from functools import cache
from random import Random
from typing import Any

import pytest
from checker_files.files import FAILS, HOLDS, UNREADABLE, Case, about
from checker_files.removals import EVERY, outcome
from checker_files.schedules import cycles_cases

from dobc_design.checker import examine

VALUES: tuple[Any, ...] = (
    None,
    [],
    {},
    "",
    0,
    -1,
    "0",
    "-1",
    "1e400",
    "-1e400",
    10**300,
    True,
    [None],
    {"a": None},
)
LARGEST = 40_000  # bytes of a file that is changed
Place = tuple[Any, Any]  # what holds the value, and its key or index


def places(tree: Any) -> Iterator[Place]:
    """Every place of a value in JSON."""
    keys: Any = ()
    if isinstance(tree, dict):
        keys = list(tree)
    elif isinstance(tree, list):
        keys = range(len(tree))
    for key in keys:
        yield tree, key
        yield from places(tree[key])


@cache
def good() -> tuple[Case, ...]:
    found: list[Case] = []
    for some in EVERY:
        found += some()
    return tuple(case for case in found if case.code == HOLDS and len(case.certificate) < LARGEST)


@cache
def of_each_kind() -> dict[str, Case]:
    """The shortest good certificate with a claim of this id."""
    found: dict[str, Case] = {}
    for case in sorted(good(), key=lambda case: len(case.certificate)):
        for check in json.loads(case.certificate)["checks"]:
            if check["verdict"] != "undecided":
                found.setdefault(check["id"], case)
    return found


def rehashed(case: Case, problem: Any) -> Case:
    """The certificate beside another problem file, with its hash."""
    read = json.loads(case.certificate)
    return about(problem, read, name=case.name, code=case.code)


def said_of(case: Case) -> int | str:
    return outcome(examine.examine, examine.Refused, case)


IDS = (
    pytest.param("max-separable", marks=pytest.mark.slow),
    "delay",
    "sampling",
    "tolerance",
    "actuators",
    "equilibrium",
    "lure",
    "schedule",
    "markov",
    "safety",
    "settling",
    "accuracy",
    "theorem1",
    "theorem1-weighted",
    "linearisation",
    "hurwitz",
    "lemma1",
)


@pytest.mark.parametrize("id", IDS)
def test_null_in_place_of_an_exact_value_is_refused(id: str):
    case = of_each_kind()[id]
    document = json.loads(case.certificate)
    check = next(
        each for each in document["checks"] if each["id"] == id and each["verdict"] != "undecided"
    )
    parts = {}
    for part in ("exact", "witness"):
        if part in check:
            parts[part] = check[part]
    listed = list(places(parts))[:60]
    changed = [(holder, key) for holder, key in listed if holder[key] is not None]
    for holder, key in changed:
        value = holder[key]
        holder[key] = None
        # The parts themselves belong to the check.
        bent = document if holder is not parts else _with_parts(document, check, parts)
        read = json.dumps(bent).encode()
        bent_case = Case(case.name, read, case.problem, FAILS)
        code = said_of(bent_case)
        # rho null says more of linear couplings, and is true there.
        assert code in (FAILS, UNREADABLE) or (code == HOLDS and key == "rho")
        holder[key] = value


def _with_parts(
    document: dict[str, Any], check: dict[str, Any], parts: dict[str, Any]
) -> dict[str, Any]:
    checks = [each | parts if each is check else each for each in document["checks"]]
    return document | {"checks": checks}


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (2, 3))]
)
def test_another_value_ends_in_a_finding_or_in_a_refusal(seed: int):
    """Three of four changes are of the certificate, the others of the problem."""
    draw = Random(seed)
    codes = set()
    for number in range(100):
        case = draw.choice(good())
        of_problem = number % 4 == 0
        document = json.loads(case.problem if of_problem else case.certificate)
        holder, key = draw.choice(list(places(document)))
        holder[key] = draw.choice(VALUES)
        read = json.dumps(document).encode()
        changed = Case(case.name, read, case.problem, FAILS)
        if of_problem:
            changed = rehashed(case, document)
        code = said_of(changed)
        outcomes = (HOLDS, FAILS, UNREADABLE)
        assert code in outcomes, (case.name, key, holder[key], code)
        codes.add(code)
    assert codes >= {FAILS, UNREADABLE}


@pytest.mark.parametrize(
    "changes",
    [
        {"sequence": [["A"], ["B"]]},
        {"sequence": 7},
        {"schedule": [7]},
        {"schedule": [{}]},
        {"schedule": ""},
        {"dwell": None, "period": None},
        {"schedule": [["0", "A"], ["1", "B"]], "period": None},
    ],
)
def test_a_switching_table_that_is_none_is_refused(changes: dict[str, Any]):
    case = next(case for case in cycles_cases() if case.name == "chain: true")
    document = json.loads(case.problem)
    document["switching"] |= changes
    assert said_of(rehashed(case, document)) in (FAILS, UNREADABLE)
