"""Identities (17), (20), (24) in free symbols; every proof has a twin with one mistake, which fails."""

from __future__ import annotations

import pytest
import sympy

from dobc_design.model.symbolic import (
    agent_symbols,
    block_matrix,
    control,
    error_identity,
    loop_symbols,
    lyapunov_derivative,
    lyapunov_identity,
    observer_identity,
    observer_rate,
    prove_error,
    prove_lyapunov,
    prove_observer,
)

SIZES = [(1, 1, 1), (2, 1, 2), (2, 2, 1), (3, 1, 2), (1, 2, 3), (2, 2, 2)]


@pytest.mark.parametrize(("n", "m", "q"), SIZES)
def test_the_derivative_of_v_is_the_quadratic_form_of_psi(n: int, m: int, q: int):
    """(24)."""
    identity = prove_lyapunov(n=n, m=m, q=q)
    assert identity.holds
    assert identity.residual == sympy.zeros(1, 1)


def test_with_the_wrong_sign_in_theta_it_is_not():
    symbols = loop_symbols(n=2, m=1, q=2)
    psi = block_matrix(symbols)
    psi[:2, 2:] *= -1
    psi[2:, :2] *= -1
    assert not lyapunov_identity(symbols, psi=psi).holds


def test_with_q_equal_to_w_p_it_is_not():
    """W = P^-1 Q means Q = P W; for m = q the other order has the same shape."""
    symbols = loop_symbols(n=1, m=2, q=2)
    assert not lyapunov_identity(symbols, psi=block_matrix(symbols, Q=symbols.W * symbols.P)).holds


def test_with_k_once_in_lambda_it_is_not():
    """F in (10) has K + K', 2 K for numbers."""
    symbols = loop_symbols(n=2, m=1, q=1)
    psi = block_matrix(symbols)
    psi[:2, :2] += symbols.K
    assert not lyapunov_identity(symbols, psi=psi).holds


def test_the_papers_numbers_give_its_omega():
    """Example 1: Omega0 = [[-1, 1/3], [1/3, -1]]."""
    symbols = loop_symbols(n=1, m=1, q=2)
    half, quarter, third = sympy.Rational(1, 2), sympy.Rational(1, 4), sympy.Rational(1, 3)
    values = dict(zip(symbols.A, (0, 2, -2, 0), strict=True)) | dict(zip(symbols.C, (1, 0), strict=True))
    values |= dict(zip(symbols.P, (half, -quarter, -quarter, third), strict=True))
    values |= dict(zip(symbols.W, (sympy.Rational(16, 5), sympy.Rational(12, 5)), strict=True))
    omega = block_matrix(symbols)[1:, 1:].subs(values)
    assert omega == sympy.Matrix([[-1, third], [third, -1]])


def test_the_derivative_of_v_for_one_scalar_agent_by_hand():
    """(23) for n = m = q = 1: 2 (j - k) e^2 + 2 c e eps + 2 p (a - w c) eps^2."""
    s = loop_symbols(n=1, m=1, q=1)
    j, k, a, c, p, w, e, eps = (matrix[0] for matrix in (s.J, s.K, s.A, s.C, s.P, s.W, s.e, s.eps))
    by_hand = 2 * (j - k) * e**2 + 2 * c * e * eps + 2 * p * (a - w * c) * eps**2
    assert sympy.expand(lyapunov_derivative(s) - by_hand) == 0


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1), (2, 3)])
def test_the_observer_error_does_not_feel_couplings_or_inputs(m: int, q: int):
    """(17) from (1), (12), (13)."""
    identity = prove_observer(m=m, q=q)
    assert identity.holds
    assert identity.residual == sympy.zeros(q, 1)


def test_an_observer_that_is_not_told_the_input_errs():
    a = agent_symbols(m=1, q=2)
    identity = observer_identity(a, z_rate=observer_rate(a) + a.W * a.u)
    assert not identity.holds
    assert identity.residual == -(a.W * a.u)


def test_an_observer_with_the_couplings_sign_turned_errs():
    a = agent_symbols(m=2, q=1)
    assert not observer_identity(a, z_rate=observer_rate(a) + 2 * a.W * a.s).holds


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1)])
def test_the_error_feels_the_disturbance_through_the_estimation_error_only(m: int, q: int):
    """(20) from (1), (12), (19)."""
    assert prove_error(m=m, q=q).holds


def test_the_sign_printed_in_equation_6_does_not_give_equation_20():
    a = agent_symbols(m=1, q=1)
    assert not error_identity(a, u=-control(a)).holds


def test_an_identity_says_in_words_what_was_found():
    symbols = loop_symbols(n=1, m=1, q=1)
    assert str(prove_lyapunov(n=1, m=1, q=1)) == "V' = [e; eps]' Psi [e; eps] (24) holds for n = 1, m = 1, q = 1"
    assert "does not hold" in str(lyapunov_identity(symbols, psi=2 * block_matrix(symbols)))
    assert prove_observer(m=1, q=1)._repr_latex_().startswith("$$")
