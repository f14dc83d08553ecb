"""Enclosed matrices proved or refuted for all that they enclose, and who carries a direction that
is not held, in labels and in words; every vector multiplied out by the oracle."""

from fractions import Fraction
from random import Random

import numpy as np
from networks import linked
from oracles.theorems import Oracle, form

from dobc_design import Verdict, certify
from dobc_design.conditions.check import Check, Fix, main_cure, other_cures
from dobc_design.conditions.consensus import network
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import enclosed_lambda
from dobc_design.conditions.consensus.network import (
    Enclosed,
    find_witness,
    is_negative,
    refuted_margin,
    refutes,
)
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.numbers import claimed
from dobc_design.exact.pencil import Deviation
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of


def random_enclosed(seed):
    r = Random(seed)
    n = r.randint(1, 5)
    entries = {
        (i, j): Fraction(r.randint(-6, 2 if i != j else -1)) for i in range(n) for j in range(i, n)
    }
    places = []
    for _ in range(r.randint(0, 4)):
        places.append((r.randrange(n), r.randrange(n), r.randrange(n)))
    deviations = tuple(Deviation(*place, Fraction(1, r.randint(1, 30))) for place in places)
    return Enclosed(middle=SparseSymmetric(n, entries), deviations=deviations)


def corners(matrix):
    """The matrix at every choice t = +-size, as floats."""
    n = matrix.middle.size
    base = np.array(matrix.middle.to_dense(), dtype=float)
    for signs in np.ndindex(*(2,) * len(matrix.deviations)):
        total = base.copy()
        for sign, d in zip(signs, matrix.deviations, strict=True):
            t = float(d.size) * (2 * sign - 1)
            J = np.zeros((n, n))
            J[d.row, d.speaker] += t
            J[d.row, d.listener] -= t
            total += J + J.T
        yield total


def test_proofs_and_witnesses_hold_at_every_corner():
    decided = 0
    for seed in range(200):
        matrix = random_enclosed(seed)
        tops = [float(np.linalg.eigvalsh(each)[-1]) for each in corners(matrix)]
        if is_negative(matrix):
            assert max(tops) < 1e-9
            decided += 1
        vector = find_witness(matrix, [])
        if vector is not None:
            v = np.array(vector, dtype=float)
            for each in corners(matrix):
                assert v @ each @ v >= -1e-9 * (v @ v)
            assert -refuted_margin(matrix, vector) <= min(tops) + 1e-9
            decided += 1
        assert not (is_negative(matrix) and vector is not None)
        exact = Enclosed(middle=matrix.middle)  # without deviations there is always an answer
        assert is_negative(exact) is (find_witness(exact, []) is None)
    assert decided > 130


def test_values_enclose_every_corner_tightly_and_the_radius_bounds_the_norm_of_all_deviations():
    """v'Mv is affine in each t, so that its range is spanned by the corners."""
    for seed in range(200):
        matrix = random_enclosed(seed)
        r = Random(-seed)
        base = np.array(matrix.middle.to_dense(), dtype=float)
        for each in corners(matrix):
            answer = np.linalg.norm(each - base, 2)
            assert answer <= float(matrix.radius) + 1e-9
        vector = [Fraction(r.randint(-3, 3)) for _ in range(matrix.middle.size)]
        v = np.array(vector, dtype=float)
        values = [v @ each @ v for each in corners(matrix)]
        found = matrix.value(vector)
        assert np.isclose(min(values), float(found.lo))
        assert np.isclose(max(values), float(found.hi))


def test_zero_short_and_long_vectors_refute_nothing():
    entries = {(0, 0): Fraction(1)}
    middle = SparseSymmetric(2, entries)
    matrix = Enclosed(middle=middle)
    one = Fraction(1)
    zero = Fraction(0)
    assert refutes(matrix, (one, zero))
    assert refutes(matrix, (zero, one))  # v'Mv = 0 is not < 0
    assert not refutes(matrix, (zero, zero))
    assert not refutes(matrix, (one,))
    assert not refutes(matrix, (one, zero, zero))


def test_a_refuted_margin_never_says_more_than_the_vector_shows():
    """-margin <= v'Mv / v'v, read as the decimal text that is written; 3/10 - 10^-40 rounds down,
    not to 0.3."""
    values = ("3/10", "1/3", "0", "1e320", "1e-330")
    cases = (*map(Fraction, values), Fraction(3, 10) - Fraction(1, 10**40))
    for value in cases:
        entries = {(0, 0): value}
        middle = SparseSymmetric(1, entries)
        matrix = Enclosed(middle=middle)
        margin = refuted_margin(matrix, (Fraction(7),))
        assert margin <= 0
        assert -claimed(margin) <= network.lowest_quotient(matrix, (Fraction(7),)) == value
    # candidates are preferred when they refute and ignored when not
    entries = {(0, 1): Fraction(1), (1, 1): Fraction(-1)}
    middle = SparseSymmetric(2, entries)
    matrix = Enclosed(middle=middle)
    found = find_witness(matrix, [[1.0, 1.0]])
    assert found == (1, 1)
    candidates = [[1.0, -1.0], [float("nan"), 1.0], [float("inf"), 1.0], [0.0, 0.0]]
    vector = find_witness(matrix, candidates)
    assert refutes(
        matrix,
        vector,
    )


def test_of_unreached_agents_those_are_shown_that_suffice_and_all_are_named():
    """4 hears 5 hears 6 hears nobody: moving 6 alone is enough."""
    arcs = [[2, 1], [3, 2], [4, 5], [5, 6]]
    problem = linked(arcs, gains={1: 5})
    lemma = certify(problem).check("lemma1")
    assert lemma.reason.startswith(
        "no pinned agent reaches agents 4, 5 and 6, so nothing pulls them to the target:"
    )
    assert lemma.witness.labels == ("6",)
    expected = ("0", "0", "0", "0", "0", "1")
    assert lemma.witness.values == expected


def test_a_direction_that_gains_leave_free_is_that_of_the_group():
    arcs = [[1, 2], [2, 1]]
    gains = {1: [[0, 0], [0, 1]]}
    problem = linked(arcs, target=[0, 0], gains=gains)
    (direction,) = network.group_directions(loop_of(problem), problem.network.modes["G"])
    assert direction == [1, 0, 1, 0]
    found = certify(problem).check("lemma1")
    assert found.witness.values == ("1", "0", "1", "0")
    arcs = [[1, 2], [2, 1]]
    held = loop_of(linked(arcs, gains={1: 1}))
    found = network.group_directions(held, problem.network.modes["G"])
    assert found == []


def test_how_many_groups_a_sentence_names_does_not_limit_the_witnesses(monkeypatch):
    """Six agents that hear nobody, none of them pinned: each is a group of its own."""
    problem = linked([[7, k] for k in range(1, 7)])
    loop = loop_of(problem)
    arcs = loop.modes["G"]
    monkeypatch.setattr(network, "SHOWN", 1)
    assert "one of each of 5 more groups" in network.cure_in_words(loop, [arcs])
    moved = {tuple(direction) for direction in network.group_directions(loop, arcs)}
    assert len(moved) == 6


def test_that_no_gains_on_the_present_pins_can_do_is_shown_by_agents_without_a_pin():
    arcs = [[1, 2], [2, 3]]
    problem = linked(arcs, gains={1: 5})
    matrices = {"G": enclosed_lambda(state_theorems(loop_of(problem)), "G")}
    mode, vector = network.unpinned_witness(loop_of(problem), matrices, {})
    assert mode == "G"
    assert network.carriers(loop_of(problem), vector) == ("3",)
    found = form(Oracle(problem).lambda_("G"), list(vector))
    assert found >= 0
    # 1 hears 2 with weight 3: Lambda = [[-6, 3], [3, -1]] fails, but k_2 > 3/4 does, so there is no
    # such witness
    arcs = [[1, 2, 3]]
    problem = linked(arcs, gains={2: "1/2"})
    matrices = {"G": enclosed_lambda(state_theorems(loop_of(problem)), "G")}
    directions = {"G": [[1.0, 2.0]]}
    found = network.unpinned_witness(loop_of(problem), matrices, directions)
    assert found is None
    found = certify(problem).check("lemma1")
    assert found.witness.labels == ("1", "2")


def check(id, verdict=Verdict.REFUTED, **changes):
    fix = Fix(kind="pinning", set=changes, text=id) if changes else None
    return Check(id=id, verdict=verdict, domain=EVERYWHERE, reason="", fix=fix)


def test_the_main_cure_is_that_of_the_theorem_and_parts_of_it_are_not_told_again():
    small = check("lemma1", a=1)
    whole = check("theorem1", a=1, b=2)
    other = check("observability", c=3)
    checks = [check("hurwitz"), other, small, whole]
    assert main_cure(checks) is whole
    assert other_cures(checks) == [other]
    cases = ([], [check("theorem1")], [check("observability", a=1)])
    for none in cases:
        assert main_cure(none) is None


def test_a_matrix_with_shorter_entries_lies_below():
    """Entries of 2000 bits; the difference is decided by its minors, and is no more than rounding
    makes it."""
    a, b, c = (Fraction(k * 3**800 + 1, 2**1300) for k in (2, -1, 3))
    entries = {(0, 0): a, (0, 1): b, (1, 1): c}
    M = SparseSymmetric(2, entries)
    below = network._shorter(M)
    (p, q), (_, r) = (M + below.negated()).to_dense()
    assert p >= 0
    assert r >= 0
    assert p * r >= q * q
    assert max(p, r) < c / 2**250
    assert max(x.numerator.bit_length() for x in below.entries.values()) < 300
