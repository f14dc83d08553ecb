"""Identities (17), (20), (24) in free symbols; every proof has a twin with one mistake, which
fails.

Every matrix entry, state and input is a free symbol, so a residual that expands to 0 holds for all
values of that size.  h(e) stands as J e with a free J, which is exact with the averaged Jacobian
(mean value theorem).
"""

from types import SimpleNamespace
from typing import Any

import pytest
import sympy


def free(name: str, rows: int, columns: int = 1) -> sympy.Matrix:
    return sympy.Matrix(rows, columns, lambda i, j: sympy.Symbol(f"{name}_{i}_{j}", real=True))


def loop(*, n: int, m: int, q: int) -> SimpleNamespace:
    """The error system (22): P is symmetric, K block diagonal with one m x m block per agent."""
    s = SimpleNamespace(n=n, m=m, q=q, A=free("A", q, q), C=free("C", m, q), W=free("W", q, m))
    s.P = sympy.Matrix(q, q, lambda i, j: sympy.Symbol(f"P_{min(i, j)}_{max(i, j)}", real=True))
    s.J, s.K = free("J", n * m, n * m), sympy.diag(*(free(f"k{i}", m, m) for i in range(n)))
    s.e, s.eps = free("e", n * m), free("eps", n * q)
    return s


def psi_of(s: SimpleNamespace, *, Q: Any = None) -> sympy.Matrix:
    """Psi of (18), (n (m + q), n (m + q)); Q is P W unless given."""
    Q = s.P * s.W if Q is None else Q
    many = [s.C] * s.n, [s.P * s.A + s.A.T * s.P - s.C.T * Q.T - Q * s.C] * s.n
    theta, omega = (sympy.diag(*blocks) for blocks in many)
    top = s.J - s.K
    return (top + top.T).row_join(theta).col_join(theta.T.row_join(omega))


def derivative_of_v(s: SimpleNamespace) -> Any:
    """V = e'e + sum eps_i' P eps_i (23) along (22), by the chain rule."""
    estimates = [s.eps[i * s.q : (i + 1) * s.q, :] for i in range(s.n)]
    e_rate = (s.J - s.K) * s.e + sympy.Matrix([s.C * each for each in estimates])
    eps_rate = sympy.Matrix([(s.A - s.W * s.C) * each for each in estimates])
    V = (s.e.T * s.e)[0] + sum((each.T * s.P * each)[0] for each in estimates)
    rates = zip([*s.e, *s.eps], [*e_rate, *eps_rate], strict=True)
    return sum(sympy.diff(V, state) * rate for state, rate in rates)


def is_form(s: SimpleNamespace, psi: sympy.Matrix) -> bool:
    """Whether V' = [e; eps]' psi [e; eps] (24)."""
    state = s.e.col_join(s.eps)
    return sympy.expand(derivative_of_v(s) - (state.T * psi * state)[0]) == 0


@pytest.mark.parametrize(
    ("n", "m", "q"), [(1, 1, 1), (2, 1, 2), (2, 2, 1), (3, 1, 2), (1, 2, 3), (2, 2, 2)]
)
def test_the_derivative_of_v_is_the_quadratic_form_of_psi(n: int, m: int, q: int):
    """(24)."""
    s = loop(n=n, m=m, q=q)
    assert is_form(s, psi_of(s))


def test_with_a_mistake_in_psi_it_is_not():
    """The wrong sign of Theta; Q = W P; K once in Lambda, where (10) has K + K'."""
    s = loop(n=1, m=2, q=2)
    turned, once = psi_of(s), psi_of(s)
    turned[:2, 2:] *= -1
    turned[2:, :2] *= -1
    once[:2, :2] += s.K
    assert not any(is_form(s, psi) for psi in (turned, psi_of(s, Q=s.W * s.P), once))


def test_the_papers_numbers_give_its_omega():
    """Example 1: Omega0 = [[-1, 1/3], [1/3, -1]]."""
    s = loop(n=1, m=1, q=2)
    half, quarter, third = sympy.Rational(1, 2), sympy.Rational(1, 4), sympy.Rational(1, 3)
    values = dict(zip(s.A, (0, 2, -2, 0), strict=True)) | dict(zip(s.C, (1, 0), strict=True))
    values |= dict(zip(s.P, (half, -quarter, -quarter, third), strict=True))
    values |= dict(zip(s.W, (sympy.Rational(16, 5), sympy.Rational(12, 5)), strict=True))
    assert psi_of(s)[1:, 1:].subs(values) == sympy.Matrix([[-1, third], [third, -1]])


def agent(*, m: int, q: int) -> SimpleNamespace:
    """One agent: s stands for its coupling sum, g for its goal; its rates by (1), (12), (13), its u
    by (19)."""
    a = SimpleNamespace(A=free("A", q, q), C=free("C", m, q), W=free("W", q, m), k=free("k", m, m))
    a.x, a.u, a.s, a.g = (free(name, m) for name in ("x", "u", "s", "g"))
    a.xi, a.z = free("xi", q), free("z", q)
    a.x_rate = a.s + a.u + a.C * a.xi
    a.z_rate = (a.A - a.W * a.C) * (a.z + a.W * a.x) - a.W * (a.s + a.u)
    a.eps = a.xi - (a.z + a.W * a.x)
    a.control = -a.k * (a.x - a.g) - a.C * (a.z + a.W * a.x)
    return a


def observer_residual(a: SimpleNamespace, z_rate: sympy.Matrix) -> sympy.Matrix:
    """eps' - (A - W C) eps (17)."""
    return (a.A * a.xi - (z_rate + a.W * a.x_rate) - (a.A - a.W * a.C) * a.eps).expand()


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1), (2, 3)])
def test_the_observer_error_does_not_feel_couplings_or_inputs(m: int, q: int):
    """(17); an observer that is not told the input, or has the sign of the couplings turned, errs
    by just that."""
    a = agent(m=m, q=q)
    assert observer_residual(a, a.z_rate) == sympy.zeros(q, 1)
    assert observer_residual(a, a.z_rate + a.W * a.u) == (-a.W * a.u).expand()
    assert observer_residual(a, a.z_rate + 2 * a.W * a.s) == (-2 * a.W * a.s).expand()


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1)])
def test_the_error_feels_the_disturbance_through_the_estimation_error_only(m: int, q: int):
    """(20) from (1), (12), (19); with the sign of u as printed in (6) it does not follow."""
    a = agent(m=m, q=q)
    wanted = a.s - a.k * (a.x - a.g) + a.C * a.eps
    assert (a.s + a.control + a.C * a.xi - wanted).expand() == sympy.zeros(m, 1)
    assert (a.s - a.control + a.C * a.xi - wanted).expand() != sympy.zeros(m, 1)
