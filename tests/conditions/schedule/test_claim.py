"""What can be a stage and a chain of stages at all."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
from staging_cases import chain

from dobc_design.errors import SpecError

F = Fraction


NEGATIVE = [(0, {name: F(-1)}, f"{name} of a stage must be >= 0") for name in ("start", "noise")]
ZERO = [
    (k, {name: F(0)}, f"{name} of a stage") for k, name in ((0, "level"), (0, "height"), (1, "stretch"), (3, "factor"))
]
EITHER = ((3, {"factor": None}), (2, {"diagonal": None}), (2, {"factor": F(1)}), (0, {"diagonal": (F(1),) * 3}))


@pytest.mark.parametrize(
    ("k", "fields", "message"), [*NEGATIVE, *ZERO, *((*each, "either a diagonal or a factor") for each in EITHER)]
)
def test_a_stage_that_cannot_be_is_refused(k, fields, message):
    with pytest.raises(SpecError, match=message):
        replace(chain().stages[k], **fields)


def test_a_chain_that_cannot_be_is_refused():
    first, second, third, fourth = chain().stages
    for stages, message in (
        ((), "at least one"),
        ((second,), "must start at 0"),
        ((first, third, second), "in the order|may follow"),
        ((first, fourth), "factor belongs"),
        ((replace(fourth, start=F(0)),), "follows nobody"),
        ((first, replace(second, start=third.start), replace(third, start=second.start)), "in the order"),
        ((first, third, replace(second, start=third.start)), "no max-separable stage may follow"),
    ):
        with pytest.raises(SpecError, match=message):
            replace(chain(), stages=stages)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"radius": F(0)}, "radius must be > 0"),
        ({"tolerance": F(0)}, "tolerance must be > 0"),
        ({"disturbance": F(-1)}, "disturbance must be >= 0"),
        ({"time": F(0)}, "time must not lie before"),
    ],
)
def test_numbers_of_a_chain_that_cannot_be_are_refused(fields, message):
    with pytest.raises(SpecError, match=message):
        replace(chain(), **fields)
