"""What can be a stage and a chain of stages at all."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
from staging_cases import chain

from dobc_design.errors import SpecError

F = Fraction


@pytest.mark.parametrize(
    ("k", "fields", "message"),
    [
        (0, {"start": F(-1)}, "start of a stage must be >= 0"),
        (0, {"noise": F(-1)}, "noise of a stage must be >= 0"),
        (0, {"level": F(0)}, "level of a stage must be > 0"),
        (0, {"height": F(0)}, "height of a stage must be > 0"),
        (1, {"stretch": F(0)}, "stretch of a stage must be > 0"),
        (3, {"factor": F(0)}, "factor of a stage must be > 0"),
        (3, {"factor": None}, "either a diagonal or a factor"),
        (2, {"diagonal": None}, "either a diagonal or a factor"),
        (2, {"factor": F(1)}, "either a diagonal or a factor"),
        (0, {"diagonal": (F(1),) * 3}, "either a diagonal or a factor"),
    ],
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
