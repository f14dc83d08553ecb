"""Broken input at random for every reader, and the inputs that once did harm.

``fuzzing`` has the targets and the mutants; `make evidence` runs them for a minute of CPU time, and
`tests/evidence/run.py --fuzz-minutes 10` for ten.
"""

from itertools import islice

import pytest
from broken_input import TARGETS, Target, as_text, defect, mutants

CASES = 12


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_mutants_of_valid_files_are_read_or_refused(target: Target):
    for data in islice(mutants(target, 1), CASES):
        assert defect(target, data) == ""
        assert as_text(data) == as_text(data)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_seeds_themselves_are_read(target: Target):
    """Else the mutants would be mutants of nothing."""
    understood = sum(target.run(data) for data in target.seeds())
    needed = len(target.seeds()) // 3
    assert understood >= needed


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_a_defect_would_be_seen(target: Target):
    """The same harness with a reader that crashes, one that hangs and one that is right."""

    def crash(data: bytes) -> bool:
        raise KeyError("x")

    def hang(data: bytes) -> bool:
        while True:
            pass

    data = target.seeds()[0]
    crashing = Target(name="x", run=crash, seeds=target.seeds)
    assert defect(crashing, data).startswith("KeyError")
    assert defect(target, data) == ""
    if target is TARGETS[0]:  # once is enough, it takes its two seconds
        hanging = Target(name="x", run=hang, seeds=target.seeds)
        assert defect(hanging, data).startswith("more than")


# What was found: in a seed of which target to replace what by what.
FOUND = [
    # The message about an unknown field quoted it, and with it what turns the writing direction
    # round.
    ("certificate.json", b'"exact"', b'"exa\xe2\x80\xaect"'),
    ("certificate.json", b'"exact"', b'"\\u001b[2J"'),
    # An exponent beyond those of decimal.Decimal is no ValueError.
    ("checker, problem", b'"dimension":1', b'"dimension":1e9999999999999999999'),
    ("checker, certificate", b'"version": 1', b'"version": 1e9999999999999999999'),
]


@pytest.mark.parametrize(("name", "old", "new"), FOUND)
def test_what_once_did_harm_does_none(name, old, new):
    (target,) = (each for each in TARGETS if each.name == name)
    data = target.seeds()[0]
    assert old in data
    assert defect(target, data.replace(old, new, 1)) == ""
