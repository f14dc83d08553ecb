"""Shapes of disturbances: exact matrices, observable, and the signals they are named after."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy import linalg

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.exact.observability import decide_observable
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.problem import exosystems as shapes
from dobc_design.verdict import Verdict


def signal(exosystem, xi0, t):
    return (
        to_float(exosystem.C) @ linalg.expm(to_float(exosystem.A) * t) @ np.array(xi0, dtype=float)
    )


@pytest.mark.parametrize(
    "exosystem",
    [
        shapes.ramp(),
        shapes.polynomial(4),
        shapes.harmonics([1, 2, 3]),
        shapes.periodic(2, harmonics_kept=3),
        shapes.total(shapes.ramp(), shapes.harmonics([1, "1.5"])),
        shapes.stacked(shapes.constant(), shapes.harmonics(1), shapes.ramp()),
    ],
)
def test_every_shape_is_observable(exosystem):
    assert decide_observable(exosystem.A, exosystem.C).verdict is Verdict.PROVED


def test_shapes_make_the_signals_they_are_named_after():
    t = 0.7
    assert signal(shapes.constant(), [3], t) == pytest.approx([3])
    assert signal(shapes.ramp(), [3, 2], t) == pytest.approx([3 + 2 * t])
    assert signal(shapes.polynomial(3), [1, 2, 3, 4], t) == pytest.approx(
        [1 + 2 * t + 3 * t**2 / 2 + 4 * t**3 / 6]
    )
    assert signal(shapes.harmonics("3/2"), [1, 0.5], t) == pytest.approx(
        [np.cos(1.5 * t) + 0.5 * np.sin(1.5 * t)]
    )
    two = shapes.periodic(2, harmonics_kept=2)
    assert signal(two, [1, 0, 1, 0, 1], t) == pytest.approx([1 + np.sin(2 * t) + np.sin(4 * t)])


def test_numbers_stay_exact():
    A = shapes.harmonics("0.1").A
    assert ((0, Fraction(1, 10)), (Fraction(-1, 10), 0)) == A
    assert characteristic_polynomial(shapes.harmonics([1, 2]).A) == (1, 0, 5, 0, 4)
    assert shapes.periodic("1/3", harmonics_kept=1, mean=False) == shapes.harmonics("1/3")
    assert shapes.total(shapes.constant(), shapes.harmonics(2)) == shapes.periodic(
        2, harmonics_kept=1
    )


def test_stacked_gives_every_part_its_own_component():
    two = shapes.stacked(shapes.constant(), shapes.ramp())
    assert (two.order, two.outputs) == (3, 2)
    assert two.C == ((1, 0, 0), (0, 1, 0))
    assert two.A == ((0, 0, 0), (0, 0, 1), (0, 0, 0))


NO_SHAPES: list[Any] = []


def no_shape(match: str, call: Any) -> None:
    NO_SHAPES.append((call, match))


no_shape(r"frequencies\[1\] must differ", lambda: shapes.harmonics([1, 1]))
no_shape(r"frequencies\[0\] must be > 0", lambda: shapes.harmonics([0]))
no_shape("degree must be an integer from 0 to 20", lambda: shapes.polynomial(-1))
no_shape("fundamental must be > 0", lambda: shapes.periodic(0, harmonics_kept=1))
no_shape("harmonics_kept must be an integer >= 1", lambda: shapes.periodic(1, harmonics_kept=0))
no_shape("at least one Exosystem", shapes.total)
no_shape(
    "equally many",
    lambda: shapes.total(shapes.constant(), shapes.stacked(shapes.constant(), shapes.ramp())),
)
no_shape("at least one Exosystem", lambda: shapes.stacked(3))


@pytest.mark.parametrize(
    ("call", "match"),
    NO_SHAPES,
)
def test_what_is_no_shape_is_refused(call, match):
    with pytest.raises(SpecError, match=match):
        call()
