"""The lone checker's part about signals that keep a guarantee: hostile claims."""

from typing import Any

import pytest
from checker_files.files import FAILS, changed, outcome
from checker_files.schedules import A_ENDS, A_STARTS, CHAINED, GRAPHS, certificate, moved, retimed

Document = dict[str, Any]


MANY = [f"{k}/5000" for k in range(5001)]


@pytest.mark.parametrize(
    "check",
    [
        changed(CHAINED, own="1e400"),
        changed(CHAINED, own="-1e400"),
        changed(CHAINED, own={}),
        changed(CHAINED, phases={}),
        changed(CHAINED, phases=[CHAINED["exact"]["phases"]] * 2),
        changed(GRAPHS, phases=[{}]),
        changed(GRAPHS, rho="1e400"),
        retimed(CHAINED, MANY, *[A_STARTS] * 5001),
        retimed(CHAINED, ["0", "1e-400", "1"], A_STARTS, A_ENDS, A_ENDS),
        retimed(CHAINED, ["0", "1"], {"float64": "AAAA"}, A_ENDS),
        moved(CHAINED, 0, 1, 0, "1e400"),
        moved(CHAINED, 0, 1, 0, "1e-400"),
        moved(CHAINED, 1, 0, 1, "1" + "0" * 9000 + "1"),
    ],
)
def test_hostile_claims_are_refused(check: Document):
    assert outcome(*certificate("chain", check)) == FAILS
