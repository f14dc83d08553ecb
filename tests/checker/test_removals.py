"""The lone checker with one of its checks taken away at a time: every removal is noticed by a case."""

from __future__ import annotations

import pytest
from checker_mutants import FILES, removals
from checker_removals import EQUIVALENT, noticed_by


def test_the_checks_are_found():
    texts = {file: [each.text for each in removals(file)] for file in FILES}
    assert len(texts["checker"]) > 100
    assert len(texts["region_checker"]) > 60
    assert len(texts["quadratic_checker"]) > 60
    assert set(EQUIVALENT) <= {text for found in texts.values() for text in found}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("checker", "product(self.P, self.W) == self.Q"),
        ("checker", "claims.problem_sha256 == self.problem.sha256"),
        ("checker", "not p.kinked"),
        ("region_checker", "room >= 0"),
        ("region_checker", "exact.delay >= 0"),
        ("quadratic_checker", "top <= exact.tolerance"),
        ("quadratic_checker", "claim.outer >= claim.level"),
    ],
)
def test_a_removed_check_is_missed(file, text):
    """Five of them at once, in the fast tests."""
    (removal,) = [each for each in removals(file) if each.text == text]
    assert noticed_by(removal) is not None
