"""The lone checker on final bounds that are changed a little; the package agrees on every one."""

import json

import pytest
from accuracy_cases import ALL, BOX
from checker_cases import accepted_by
from margins_cases import SEEN, two
from mutants import mutate

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify


@pytest.mark.parametrize("id", ["accuracy", "actuators", "tolerance"])
def test_what_one_program_refuses_the_other_refuses(id):
    table = ALL if id == "accuracy" else {"weights": "1/1000"}
    problem = two(coupling="tanh(y)", uncertainty=table, actuators={"amplitude": 1}, region=BOX, **SEEN)
    document = json.loads(certificate_bytes(certify(problem).claims))
    check = next(each for each in document["checks"] if each["id"] == id)
    assert check["verdict"] == "proved"
    refused = 0
    for seed in range(12):
        changed = mutate({"it": check}, seed, other={"it": document["checks"][0]}).get("it")
        if isinstance(changed, dict) and changed != check:
            checks = [changed if each is check else each for each in document["checks"]]
            package, lone = accepted_by(document | {"checks": checks}, problem)
            assert package is lone, (seed, changed)
            refused += not package
    assert refused > 5
