"""The lone checker's part about groups of agents: cases of known outcome, files side by side, changed certificates."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from campaigns import mutant_campaign, recheck_campaign
from checker_cases import FAILS, HOLDS, UNREADABLE
from checker_mutants import removals
from checker_removals import noticed_by, outcome
from groups_cases import document, groups_cases, problems
from groups_oracle import GroupsOracle, random_grouped_problem
from regions import without_region

from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
from dobc_design.certification.recheck import recheck
from dobc_design.checker import checker
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.groups import Observer
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def outcome_alone(folder: Path, data: bytes, problem: bytes, files: tuple[str, ...]) -> tuple[int, str]:
    """Exit code and output of copies of the files, without site packages and the package."""
    for file in files:
        shutil.copy(Path(checker.__file__).with_name(file), folder)
    (folder / "certificate.json").write_bytes(data)
    (folder / "problem.json").write_bytes(problem)
    command = [sys.executable, "-I", "-S", "checker.py", "certificate.json", "problem.json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_every_case_gets_its_exit_code():
    cases = groups_cases()
    wrong = [case.name for case in cases if outcome(checker.examine, checker.Refused, case) != case.code]
    assert wrong == []
    assert sum(case.code == HOLDS for case in cases) >= 13
    assert sum(case.code == FAILS for case in cases) >= 25
    assert sum(case.code == UNREADABLE for case in cases) >= 10


def test_the_package_says_the_same_of_every_readable_case():
    by_bytes = {canonical_bytes(problem): problem for problem in problems().values()}
    cases = [case for case in groups_cases() if case.problem in by_bytes]
    wrong = [
        case.name
        for case in cases
        if recheck(case.certificate, by_bytes[case.problem]).holds is not (case.code == HOLDS)
    ]
    assert wrong == []


def test_a_group_on_a_check_of_a_plain_problem_is_refused():
    problem = without_region("paper-fixed")
    data = json.loads(certificate_bytes(certify(problem).claims))
    next(each for each in data["checks"] if each["id"] == "hurwitz")["group"] = "1"
    findings = checker.examine(json.dumps(data).encode(), canonical_bytes(problem))
    assert not recheck(json.dumps(data).encode(), problem).holds
    assert any("there is a check that" in text for holds, text in findings if not holds)


def test_the_two_files_work_alone_and_the_first_says_that_it_needs_the_second(tmp_path: Path):
    data, problem = json.dumps(document("mixed")).encode(), canonical_bytes(problems()["mixed"])
    code, said = outcome_alone(tmp_path, data, problem, ("checker.py",))
    assert code == UNREADABLE
    assert "checker.py needs groups_checker.py beside it" in said
    assert outcome_alone(tmp_path, data, problem, ("groups_checker.py",))[0] == HOLDS


def test_a_plain_problem_whose_texts_speak_of_groups_needs_one_file_only(tmp_path: Path):
    """A name, a note and a label "groups" are no groups."""
    problem = Problem(
        network=Network.from_arcs([["groups", 2]], arrow="listens_to"),
        coupling="y",
        gains=1,
        name='"groups":',
        notes=["'groups'"],
        exosystem=Exosystem(A=[[0]], C=[[1]]),
        observer=Observer(W=[[1]]),
    )
    data = certificate_bytes(certify(problem).claims)
    assert outcome_alone(tmp_path, data, canonical_bytes(problem), ("checker.py",))[0] == HOLDS


def test_certificates_of_random_groups_are_accepted_by_both_and_true_for_the_oracle():
    tally = recheck_campaign(range(3, 6), make=random_grouped_problem, know=GroupsOracle)
    assert tally.wrong == []
    assert tally.counts["proved"] >= 1


def test_changed_certificates_of_groups_are_refused_or_true():
    tally = mutant_campaign(range(3, 5), each=9, make=random_grouped_problem, know=GroupsOracle)
    assert tally.wrong == []
    assert tally.counts["refused"] >= 5


@pytest.mark.slow
def test_every_removed_check_about_groups_is_missed():
    found = removals("groups_checker")
    assert len(found) > 15
    assert [str(each) for each in found if noticed_by(each) is None] == []
