"""Witnesses: multiplied out exactly, made short, and never believed."""

from __future__ import annotations

from fractions import Fraction

import pytest

from dobc_design.errors import CertificateError
from dobc_design.exact.definite import first_refuting, refuted, roundings
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.verdict import Verdict

IDENTITY = SparseSymmetric(2, {(0, 0): Fraction(1), (1, 1): Fraction(1)})
SINGULAR = SparseSymmetric(2, {(0, 0): Fraction(1), (0, 1): Fraction(-1), (1, 1): Fraction(1)})


def test_a_direction_that_does_not_refute_is_never_returned():
    """A mistake in a path surfaces as an error."""
    with pytest.raises(CertificateError, match="nothing is claimed"):
        refuted(IDENTITY, {0: Fraction(1)}, strict=True, method="")
    with pytest.raises(CertificateError, match="nothing is claimed"):
        refuted(SINGULAR, {0: Fraction(1), 1: Fraction(1)}, strict=False, method="")
    assert first_refuting(IDENTITY, ([0, 0], [1, 2]), strict=True, method="") is None


def test_the_witness_is_primitive_and_begins_with_a_positive_entry():
    """(-1/3, -1/3) is told as (1, 1)."""
    decision = refuted(SINGULAR, {0: Fraction(-1, 3), 1: Fraction(-1, 3)}, strict=True, method="m")
    assert (decision.verdict, decision.witness, decision.value, decision.method) == (Verdict.REFUTED, (1, 1), 0, "m")


def test_the_first_candidate_that_refutes_is_taken():
    assert first_refuting(SINGULAR, ([0, 0], [1, 0], [5, 5], [1, 1]), strict=True, method="").witness == (1, 1)


def test_roundings_grow_finer_and_drop_small_entries():
    """1000 : 999 : 1 to 1, 2, 4, 8 bits."""
    assert list(roundings([1000, -999, 1])) == [[2, -2, 0], [4, -4, 0], [16, -16, 0], [256, -256, 0]]
    assert list(roundings([1, 0])) == []
