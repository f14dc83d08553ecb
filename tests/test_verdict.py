"""The three-valued answer."""

import pytest

from dobc_design.verdict import Verdict

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED


@pytest.mark.parametrize("verdict", list(Verdict))
def test_a_verdict_has_no_truth_value(verdict):
    """Style page: three outcomes; "undecided" must not pass for yes or no."""
    with pytest.raises(TypeError, match="three values"):
        bool(verdict)
    with pytest.raises(TypeError, match=r"is Verdict\.PROVED"):
        _ = not verdict


def test_a_verdict_equals_its_word_of_the_contract_and_no_other_text():
    """Contract: verdict is proved, refuted or undecided."""
    assert [verdict.value for verdict in Verdict] == ["proved", "refuted", "undecided"]
    assert str(PROVED) == "proved"
    assert PROVED == "proved"
    assert PROVED != "refuted"
    assert {"proved": 1}[PROVED] == {PROVED: 1}["proved"] == 1
    assert PROVED != 3
    for slip in ("Proved", "PROVED", "yes", ""):
        with pytest.raises(ValueError, match='"proved", "refuted" or "undecided"'):
            _ = slip == PROVED


@pytest.mark.parametrize(
    ("verdicts", "together"),
    [
        ([], PROVED),
        ([PROVED, PROVED], PROVED),
        ([PROVED, UNDECIDED], UNDECIDED),
        ([UNDECIDED, REFUTED, PROVED], REFUTED),
        ([REFUTED], REFUTED),
    ],
)
def test_one_refuted_refutes_all_and_one_undecided_spoils_a_proof(verdicts, together):
    """Conjunction of Kleene's three-valued logic; of nothing it is true."""
    assert Verdict.all_of(iter(verdicts)) is together
