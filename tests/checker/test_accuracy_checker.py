"""The lone checker on final bounds that are changed a little; the package agrees on every one."""

import json
from typing import Any

import pytest
from broken_certificates import mutate
from certified import certified
from checker_files.accuracy import ALL, BOTH, BOX, WATCHED, bent
from checker_files.files import accepted_by
from checker_files.margins import SEEN, one, two

from dobc_design import Problem
from dobc_design.certificate.text import certificate_bytes

DRAWN = two(coupling="tanh(y)", uncertainty=ALL, region=BOX, **WATCHED)
SINES = {"bands": [["9/5", "11/5", "1/10"]]}
HUMMING = two(coupling="tanh(y)", uncertainty=SINES, region=BOX, **SEEN)
HELD = one(uncertainty={"weights": "1/1000"}, actuators={"amplitude": 1}, region=BOX, **WATCHED)


@pytest.mark.parametrize(
    ("id", "problem"),
    [("accuracy", DRAWN), ("accuracy", HUMMING), ("actuators", HELD), ("tolerance", HELD)],
)
def test_what_one_program_refuses_the_other_refuses(id: str, problem: Problem):
    """Final bounds by hand; tolerances and inputs as `certify` finds them."""
    by_hand = problem is DRAWN
    data = (
        bent(problem, BOTH, "by hand").certificate
        if by_hand
        else certificate_bytes(certified(problem).claims)
    )
    document: dict[str, Any] = json.loads(data)
    check = next(each for each in document["checks"] if each["id"] == id)
    assert check["verdict"] == "proved"
    refused = 0
    for seed in range(12):
        first = {"it": document["checks"][0]}
        mutated = mutate({"it": check}, seed, other=first)
        changed = mutated.get("it")
        if isinstance(changed, dict) and changed != check:
            checks = [changed if each is check else each for each in document["checks"]]
            package, lone = accepted_by(document | {"checks": checks}, problem)
            assert package is lone, (seed, changed)
            refused += not package
    assert refused > 5
