"""A seeded share of what `make evidence` counts (see ``Item.share``), item by item."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from evidence.items import ITEMS, Item

BAD_FILES = 8  # that item asks for all there are


@pytest.mark.slow
@pytest.mark.parametrize("item", [item for item in ITEMS if item.share], ids=lambda item: item.name)
def test_a_share_of_the_evidence_holds(item: Item):
    count = BAD_FILES if item.name == "bad-files" else item.count // item.share
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SciPy's, about the matrices that are bad on purpose
        row = item.run(count, item.seed)
    assert not row.failures, "\n".join(row.failures[:20])
    # Not every problem has an optimum, but half of them do for each of the two objectives.
    assert row.count >= min(count, row.least)
