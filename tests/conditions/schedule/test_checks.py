"""The check `settling`: written, read and confirmed again; both programs refuse what is changed by
hand."""

from dataclasses import replace

import pytest
from certified import coarse_tables, confirmed, through_json
from checker_files.files import Document
from checker_files.separable import problems
from checker_files.settling import GOOD, LINE, SEEN, STRETCHED, bent
from texts import exact_matrix

from dobc_design.conditions.case import Case
from dobc_design.conditions.check import check_from_json
from dobc_design.conditions.domain import NEAR_TARGET
from dobc_design.conditions.schedule.checks import (
    MOST_TIMES,
    confirm,
    read_claim,
    settling_check,
    settling_of,
)
from dobc_design.loop.make import loop_of
from dobc_design.verdict import Verdict

ALL = [*GOOD.items(), ("observed, linear", SEEN), ("observed, linear", STRETCHED)]


@pytest.mark.parametrize(("name", "document"), ALL)
@coarse_tables()
def test_a_claim_is_read_decided_once_more_and_written_as_it_was(name: str, document: Document):
    problem = problems()[name]
    W = None if problem.observer is None else problem.observer.W
    claim = read_claim(check_from_json(document), loop_of(problem), W)
    settling = settling_of(loop_of(problem), claim, "")
    check = settling_check(loop_of(problem), W, settling, domain=NEAR_TARGET)
    assert check.verdict == Verdict.PROVED
    assert check.domain.to_json() == document["domain"]
    assert read_claim(through_json(check), loop_of(problem), W) == claim
    case = Case(loop=loop_of(problem), W=W, domain=NEAR_TARGET)
    found = confirm(check, case)
    assert found is None


def test_the_tube_of_a_slower_observer_is_not_confirmed():
    """A - W C = -2 is what both claims count on."""
    problem = problems()["observed, linear"]
    for check in map(check_from_json, (SEEN, STRETCHED)):
        assert confirmed(check, problem, W=exact_matrix("2")) is None
        assert confirmed(check, problem, W=exact_matrix("19/10")) is not None
        assert confirmed(check, problem) is not None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tube": {}}, "times"),
        ({"last": {}}, "kind"),
        ({"kind": "vertices"}, "kind must be"),
        ({"times": ["0"] * (MOST_TIMES + 1)}, "at most 2000"),
        ({"upper": [["1"]] * 3}, "2"),
        ({"upper": [["1", "0"]] * 3}, "."),
        ({"time": "0"}, "time must not lie before"),
        ({"level": "0"}, "level must be > 0"),
        ({"times": ["0", "1/2", "1/2"]}, "times must rise"),
    ],
)
def test_what_cannot_be_such_a_claim_raises(changes: Document, words: str):
    check = check_from_json(bent(LINE, **changes))
    loop = loop_of(problems()["line"])
    with pytest.raises((KeyError, TypeError, ValueError), match=words):
        read_claim(check, loop, None)


def test_an_undecided_settling_claims_nothing():
    problem = problems()["line"]
    claim = read_claim(check_from_json(LINE), loop_of(problem), None)
    settled = settling_of(loop_of(problem), claim, "")
    open_one = replace(settled, verdict=Verdict.UNDECIDED, reason="none was found.", claim=None)
    check = settling_check(loop_of(problem), None, open_one, domain=NEAR_TARGET)
    assert check.verdict == Verdict.UNDECIDED
    assert check.domain == NEAR_TARGET
    assert check.exact is None
