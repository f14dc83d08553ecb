"""Lambda of large networks in arrays: the same matrix as entry by entry, or one that encloses the same."""

from __future__ import annotations

import tracemalloc
from fractions import Fraction

import pytest
from random_problems import random_problem
from separable_problems import cycle

from dobc_design.conditions.consensus.claim import (
    LARGE_ROWS,
    Deviations,
    jacobians_at_consensus,
    lemma1,
    lemma1_in_arrays,
    state_theorems,
)
from dobc_design.exact.symmetric import IntegerSymmetric, SparseSymmetric
from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def both_forms(problem):
    """Every mode entry by entry and in arrays."""
    for mode in jacobians_at_consensus(problem).modes:
        sizes = {"size": problem.n, "dimension": problem.m}
        yield lemma1(mode, problem.pinning, **sizes), lemma1_in_arrays(mode, problem.pinning, **sizes)


def reach(pencil):
    """The largest size of what the deviations add at each place."""
    found: dict[tuple[int, int], Fraction] = {}
    for d in pencil.deviations:
        for other, factor in ((d.speaker, 1), (d.listener, 2 if d.listener == d.row else 1)):
            place = min(d.row, other), max(d.row, other)
            found[place] = found.get(place, Fraction(0)) + factor * d.size
    return found


@pytest.mark.parametrize("seed", range(30))
def test_both_forms_enclose_the_same_matrix(seed):
    """Weights, exceptions, matrix gains, vectors, irrational slopes: every entry agrees up to the deviations."""
    for plain, lean in both_forms(random_problem(seed)):
        first, second = plain.constant.entries, lean.constant.entries
        wide = [reach(plain), reach(lean)]
        for place in {*first, *second}:
            room = sum((each.get(place, Fraction(0)) for each in wide), Fraction(0))
            assert abs(first.get(place, Fraction(0)) - second.get(place, Fraction(0))) <= room
        if not plain.deviations:
            assert lean.constant.to_sparse() == plain.constant
            assert not lean.deviations


def test_slopes_without_a_common_denominator_become_floats_with_deviations():
    """Weights 1/p for 200 odd p: the exact ones need over 512 bits together."""
    arcs = [[1, i, f"1/{2 * i + 1}"] for i in range(2, 202)]
    problem = Problem(network=Network.from_arcs(arcs, arrow="listens_to", agents=201), coupling="y", gains={1: 3})
    ((plain, lean),) = both_forms(problem)
    assert isinstance(lean.deviations, Deviations)
    assert lean.constant.denominator.bit_length() < 100
    room = reach(lean)
    for place, value in plain.constant.entries.items():
        assert abs(lean.constant.entries.get(place, 0) - value) <= room.get(place, 0)
    assert lean.deviations[0].size < Fraction(1, 2**50)
    assert len(lean.deviations[:3]) == 3


def test_gains_without_a_common_denominator_are_left_to_the_other_form():
    problem = cycle(200, gains={i: f"1/{2 * i + 1}" for i in range(1, 201)})
    ((plain, lean),) = both_forms(problem)
    assert lean is None
    assert isinstance(plain.constant, SparseSymmetric)


@pytest.mark.parametrize("n", [LARGE_ROWS, LARGE_ROWS + 1])
def test_networks_beyond_the_limit_are_stated_in_arrays(n):
    (pencil,) = state_theorems(cycle(n)).lambdas.values()
    assert isinstance(pencil.constant, IntegerSymmetric) is (n > LARGE_ROWS)
    assert pencil.constant.entries[0, 0] == -14
    assert pencil.constant.entries[0, 1] == 2


def test_the_memory_of_the_statement_is_linear_in_the_arcs():
    """Entry by entry it is about 1000 bytes for each."""
    peaks = []
    for n in (5000, 10_000):
        problem = cycle(n)
        tracemalloc.start()
        state_theorems(problem)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.3 * peaks[0]
    assert peaks[1] < 500 * 10_000
