"""The lone checker with one of its checks taken away at a time: every removal is noticed by a case."""

from __future__ import annotations

import pytest
from checker_mutants import FILES, removals
from checker_removals import EQUIVALENT, noticed_by


def test_the_checks_are_found():
    texts = {file: [each.text for each in removals(file)] for file in FILES}
    assert sum(map(len, texts.values())) > 250
    assert all(len(texts[file]) > 25 for file in ("reading", "consensus", "separable", "quadratic", "schedule"))
    assert set(EQUIVALENT) <= {text for found in texts.values() for text in found}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("consensus", "product(P, W) == Q"),
        ("examine", "claims.problem_sha256 == p.sha256"),
        ("consensus", "not case.problem.kinked"),
        ("separable", "left >= 0"),
        ("separable", "exact.delay >= 0"),
        ("schedule", "top <= exact.tolerance"),
        ("quadratic", "claim.outer >= claim.level"),
    ],
)
def test_a_removed_check_is_missed(file, text):
    (removal,) = [each for each in removals(file) if each.text == text]
    assert noticed_by(removal) is not None
