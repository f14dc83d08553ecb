"""Long vectors of doubles are the rationals that they are."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from dobc_design.exact.symmetric import Doubles, least


def test_entries_are_exact_binary_fractions():
    v = Doubles(np.array([0.1, 2.0, -(2.0**-1074)]))
    assert list(v) == [Fraction(0.1), 2, Fraction(-1, 2**1074)]
    assert v[0] == v[-3] == Fraction(0.1) != Fraction(1, 10)
    assert v[1:] == (2, Fraction(-1, 2**1074))
    assert (len(v), least(v), least(tuple(v))) == (3, v[2], v[2])


def test_the_array_can_neither_be_changed_nor_changes_with_its_source():
    source = np.array([1.0, 2.0])
    v = Doubles(source)
    source[0] = 9.0
    assert v[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        v.array[0] = 3.0


def test_equal_vectors_are_equal_and_hash_alike():
    one, same, other = (Doubles(np.array(x)) for x in ([1.0, 2.0], [1.0, 2.0], [1.0, 3.0]))
    assert (one == same, one == other, hash(one) == hash(same)) == (True, False, True)


@pytest.mark.parametrize("array", [np.array([1.0, np.nan]), np.array([np.inf]), np.ones((2, 2))])
def test_what_is_no_finite_vector_is_refused(array):
    with pytest.raises(ValueError, match="one dimension and finite entries"):
        Doubles(array)
