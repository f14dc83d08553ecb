"""The lone checker's part about groups of agents: files side by side, changed certificates."""

import json
from fractions import Fraction

import pytest
from campaigns.certificates import mutant_campaign, recheck_campaign
from certified import certify_once, without_region
from checker_files.files import HOLDS, alone, outcome, second_loop
from checker_files.groups import document, problems
from oracles.groups import GroupsOracle, random_grouped_problem

from dobc_design import Exosystem, Network, Observer, Problem, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.recheck import recheck
from dobc_design.checker import examine as checker
from dobc_design.problem.canonical import canonical_bytes


def test_a_group_on_a_check_of_a_plain_problem_is_refused():
    problem = without_region("paper-fixed")
    data = json.loads(certificate_bytes(certify(problem).claims))
    next(each for each in data["checks"] if each["id"] == "hurwitz")["group"] = "1"
    read = json.dumps(data).encode()
    findings = checker.examine(read, canonical_bytes(problem))
    assert not recheck(json.dumps(data).encode(), problem).holds
    assert any("there is a check that" in text for holds, text in findings if not holds)


def test_the_lone_folder_confirms_groups(tmp_path):
    read = json.dumps(document("mixed")).encode()
    file = canonical_bytes(problems()["mixed"])
    done = alone(tmp_path, read, file)
    assert done.returncode == HOLDS
    assert done.stderr == ""


def test_a_plain_problem_whose_texts_speak_of_groups_has_none():
    """A name, a note and a label "groups" are no groups."""
    network = Network.from_arcs([["groups", 2]], arrow="listens_to")
    exosystem = Exosystem(A=[[0]], C=[[1]])
    observer = Observer(W=[[1]])
    problem = Problem(
        network=network,
        coupling="y",
        gains=1,
        name='"groups":',
        notes=["'groups'"],
        exosystem=exosystem,
        observer=observer,
    )
    certified_bytes = certificate_bytes(certify(problem).claims)
    assert outcome(certified_bytes, canonical_bytes(problem)) == HOLDS


def test_an_agent_has_the_block_of_its_own_group():
    """Two components: S of two groups has four rows."""
    loop = second_loop(problems()["plane"])
    S = []
    for i in range(4):
        S.append([Fraction(10 * i + j) for j in range(4)])
    blocks = [loop.block(S, i) for i in (0, 1)]
    assert blocks == [[[0, 1], [10, 11]], [[22, 23], [32, 33]]]


QUICK = (3, 5)  # seeds of a problem that is proved, in three components, and of one that is refuted


@pytest.fixture
def certified_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("campaigns.certificates.certify", certify_once)


@pytest.mark.usefixtures("certified_once")
def test_certificates_of_random_groups_are_accepted_by_both_and_true_for_the_oracle():
    tally = recheck_campaign(QUICK, make=random_grouped_problem, know=GroupsOracle)
    assert tally.wrong == []
    assert tally.counts == {"proved": 1, "refuted": 1}


@pytest.mark.usefixtures("certified_once")
def test_changed_certificates_of_groups_are_refused_or_true():
    tally = mutant_campaign(QUICK, each=9, make=random_grouped_problem, know=GroupsOracle)
    assert tally.wrong == []
    assert tally.counts["refused"] >= 5
