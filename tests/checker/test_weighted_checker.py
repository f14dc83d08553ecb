"""The lone checker on weighted theorems and linearisations written by hand; the package agrees on every one."""

from __future__ import annotations

from checker_cases import FAILS, HOLDS, accepted_by_package, misjudged
from weighted_cases import problems, weighted_cases


def test_every_case_is_judged_as_it_is():
    assert misjudged(weighted_cases()) == []
    assert {case.code for case in weighted_cases()} == {HOLDS, FAILS}
    assert {case.name.partition(":")[0] for case in weighted_cases()} == set(problems())


def test_the_package_says_the_same():
    assert [case.name for case in weighted_cases() if accepted_by_package(case) != (case.code == HOLDS)] == []
