"""Exact pole placement: a gain whenever (A, C) is detectable, found without floating point."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest

from dobc_design.conditions.observer.ackermann import placed_gains
from dobc_design.conditions.observer.gain import design_gain
from dobc_design.exact.matrix import multiply, subtract
from dobc_design.exact.observability import decide_detectable
from dobc_design.exact.polynomial import characteristic_polynomial, decide_hurwitz
from dobc_design.problem.exosystems import Exosystem
from dobc_design.verdict import Verdict


def random_exosystem(seed: int) -> Exosystem:
    """Sparse small integers, so that defective, hidden and repeated modes are common."""
    r = Random(seed)
    q, m = r.randint(1, 7), r.randint(1, 2)
    A = [[r.randint(-2, 2) * (r.random() < 0.5) for _ in range(q)] for _ in range(q)]
    return Exosystem(A=A, C=[[r.randint(-1, 1) * (r.random() < 0.5) for _ in range(q)] for _ in range(m)])


@pytest.mark.parametrize("seed", [pytest.param(k, marks=pytest.mark.slow if k == 19 else ()) for k in range(60)])
def test_a_detectable_pair_has_a_placed_gain_and_an_undetectable_one_has_none(seed: int):
    """Theory, section 2: some W makes A - WC Hurwitz iff (A, C) is detectable."""
    exosystem = random_exosystem(seed)
    *_, W = placed_gains(exosystem, rate=Fraction(0))
    found = decide_hurwitz(subtract(exosystem.A, multiply(W, exosystem.C))).verdict
    assert found is decide_detectable(exosystem.A, exosystem.C).verdict
    assert (design_gain(exosystem).W is not None) == (found is Verdict.PROVED)


def test_all_poles_stand_at_one_place():
    """One output, all observable: det(sI - A + WC) = (s + 3)^4 for the rate 2."""
    chain = Exosystem(A=[[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], C=[[1, 0, 0, 0]])
    *_, W = placed_gains(chain, rate=Fraction(2))
    assert characteristic_polynomial(subtract(chain.A, multiply(W, chain.C))) == (1, 12, 54, 108, 81)


def test_where_c_sees_nothing_the_gain_is_zero():
    *_, W = placed_gains(Exosystem(A=[[-1]], C=[[0]]), rate=Fraction(0))
    assert W == ((0,),)
