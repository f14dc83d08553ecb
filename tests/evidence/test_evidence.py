"""A seeded share of what `make evidence` counts (see ``Item.share``), item by item."""

import json
import math
import sys
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from evidence import agreement
from evidence.items import ITEMS, Item

import dobc_design.certification.recheck as rechecks
from dobc_design.checker.examine import examine


@pytest.mark.slow
@pytest.mark.parametrize("item", [item for item in ITEMS if item.share], ids=lambda item: item.name)
def test_a_share_of_the_evidence_holds(item: Item):
    count = item.count // item.share
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SciPy's, about the matrices that are bad on purpose
        row = item.run(count, item.seed)
    assert not row.failures, "\n".join(row.failures[:20])
    assert row.count >= min(count, row.least)


PROVED_REGION = 8508  # a seed whose problem is proved with a max-separable


@pytest.mark.parametrize(("name", "number"), [("alpha", "9"), ("rho", "1/9"), ("v", ["1", "-1"])])
def test_one_spoilt_number_is_counted_as_a_disagreement(
    name: str, number, monkeypatch: pytest.MonkeyPatch
):
    """The certificate that is checked is the one that was made but for one number."""
    assert not agreement.run(1, PROVED_REGION).failures

    def spoilt(claims: object) -> bytes:
        document = json.loads(honest(claims))
        next(check["exact"] for check in document["checks"] if check["id"] == "max-separable")[
            name
        ] = number
        return json.dumps(document).encode()

    honest = agreement.certificate_bytes
    monkeypatch.setattr(agreement, "certificate_bytes", spoilt)
    assert agreement.run(1, PROVED_REGION).failures


def test_a_claim_that_one_program_refuses_is_counted_as_a_disagreement(
    monkeypatch: pytest.MonkeyPatch,
):
    def refuses(data: bytes, document: bytes, until: float = math.inf):
        return [
            (holds and "max-separable" not in text, text)
            for holds, text in examine(data, document, until)
        ]

    monkeypatch.setattr(rechecks.checker, "examine", refuses)
    assert agreement.run(1, PROVED_REGION).failures
