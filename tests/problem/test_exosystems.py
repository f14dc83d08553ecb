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

T = 0.7
CONSTANT, RAMP = shapes.constant(), shapes.ramp()


def signal(exosystem, xi0):
    """d(t) at t = 0.7."""
    grown = linalg.expm(to_float(exosystem.A) * T)
    outputs = to_float(exosystem.C) @ grown
    start = np.array(xi0, dtype=float)
    (value,) = outputs @ start
    return value


SHAPES = [RAMP, shapes.polynomial(4), shapes.harmonics([1, 2, 3])]
SHAPES.append(shapes.periodic(2, harmonics_kept=3))
SHAPES.append(shapes.total(RAMP, shapes.harmonics([1, "1.5"])))
SHAPES.append(shapes.stacked(CONSTANT, shapes.harmonics(1), RAMP))


@pytest.mark.parametrize("exosystem", SHAPES)
def test_every_shape_is_observable(exosystem):
    assert decide_observable(exosystem.A, exosystem.C).verdict is Verdict.PROVED


def test_shapes_make_the_signals_they_are_named_after():
    assert signal(CONSTANT, [3]) == pytest.approx(3)
    assert signal(RAMP, [3, 2]) == pytest.approx(3 + 2 * T)
    cubic = 1 + 2 * T + 3 * T**2 / 2 + 4 * T**3 / 6
    found = signal(shapes.polynomial(3), [1, 2, 3, 4])
    assert found == pytest.approx(cubic)
    sine = np.cos(1.5 * T) + 0.5 * np.sin(1.5 * T)
    found = signal(shapes.harmonics("3/2"), [1, 0.5])
    assert found == pytest.approx(sine)
    sines = 1 + np.sin(2 * T) + np.sin(4 * T)
    two = shapes.periodic(2, harmonics_kept=2)
    start = [1, 0, 1, 0, 1]
    assert signal(two, start) == pytest.approx(sines)


def test_numbers_stay_exact():
    tenth = Fraction(1, 10)
    slow = shapes.harmonics("0.1")
    assert ((0, tenth), (-tenth, 0)) == slow.A
    polynomial = characteristic_polynomial(shapes.harmonics([1, 2]).A)
    expected = (1, 0, 5, 0, 4)
    assert polynomial == expected
    assert shapes.periodic("1/3", harmonics_kept=1, mean=False) == shapes.harmonics("1/3")
    total = shapes.total(CONSTANT, shapes.harmonics(2))
    assert total == shapes.periodic(2, harmonics_kept=1)


def test_stacked_gives_every_part_its_own_component():
    two = shapes.stacked(CONSTANT, RAMP)
    assert two.order == 3
    assert two.outputs == 2
    assert two.C == ((1, 0, 0), (0, 1, 0))
    assert two.A == ((0, 0, 0), (0, 0, 1), (0, 0, 0))


NO_SHAPES: list[Any] = []


def no_shape(match: str, make: Any, *given: Any, **more: Any) -> None:
    NO_SHAPES.append((make, given, more, match))


no_shape(r"frequencies\[1\] must differ", shapes.harmonics, [1, 1])
no_shape(r"frequencies\[0\] must be > 0", shapes.harmonics, [0])
no_shape("degree must be an integer from 0 to 20", shapes.polynomial, -1)
no_shape("fundamental must be > 0", shapes.periodic, 0, harmonics_kept=1)
no_shape("harmonics_kept must be an integer >= 1", shapes.periodic, 1, harmonics_kept=0)
no_shape("at least one Exosystem", shapes.total)
IN_PLANE = shapes.stacked(CONSTANT, RAMP)
no_shape("equally many", shapes.total, CONSTANT, IN_PLANE)
no_shape("at least one Exosystem", shapes.stacked, 3)


@pytest.mark.parametrize(("make", "given", "more", "match"), NO_SHAPES)
def test_what_is_no_shape_is_refused(make, given, more, match):
    with pytest.raises(SpecError, match=match):
        make(*given, **more)
