"""The lone checker on weighted theorems and linearisations written by hand; the package agrees on every one."""

from __future__ import annotations

import pytest
from checker_cases import FAILS, HOLDS, Case, misjudged
from weighted_cases import problems, weighted_cases

from dobc_design.certification.recheck import recheck
from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import problem_from_canonical


def test_every_case_is_judged_as_it_is():
    assert misjudged(weighted_cases()) == []
    assert {case.code for case in weighted_cases()} == {HOLDS, FAILS}
    assert {case.name.partition(":")[0] for case in weighted_cases()} == set(problems())


@pytest.mark.parametrize("case", weighted_cases(), ids=lambda case: case.name)
def test_the_package_says_the_same(case: Case):
    try:
        holds = recheck(case.certificate, problem_from_canonical(case.problem)).holds
    except CertificateError:
        holds = False
    assert holds == (case.code == HOLDS)
