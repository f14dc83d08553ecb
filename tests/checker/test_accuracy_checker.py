"""The lone checker on final bounds that are changed a little; the package agrees on every one."""

from __future__ import annotations

import pytest
from accuracy_cases import accuracy_cases
from checker_cases import HOLDS, Case, misjudged

from dobc_design.certification.recheck import recheck
from dobc_design.errors import CertificateError
from dobc_design.problem.canonical import problem_from_canonical


def test_every_case_is_judged_as_it_is():
    assert misjudged(accuracy_cases()) == []


@pytest.mark.parametrize("case", accuracy_cases(), ids=lambda case: case.name)
def test_the_package_says_the_same(case: Case):
    try:
        holds = recheck(case.certificate, problem_from_canonical(case.problem)).holds
    except CertificateError:
        holds = False
    assert holds == (case.code == HOLDS)
