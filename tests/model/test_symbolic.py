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
    s = SimpleNamespace(n=n, m=m, q=q)
    s.A = free("A", q, q)
    s.C = free("C", m, q)
    s.W = free("W", q, m)
    upper = free("P", q, q)
    s.P = sympy.Matrix(q, q, lambda i, j: upper[min(i, j), max(i, j)])
    s.J = free("J", n * m, n * m)
    gains = [free(f"k{i}", m, m) for i in range(n)]
    s.K = sympy.diag(*gains)
    s.e = free("e", n * m)
    s.eps = free("eps", n * q)
    return s


def psi_of(s: SimpleNamespace, *, Q: Any = None) -> sympy.Matrix:
    """Psi of (18), (n (m + q), n (m + q)); Q is P W unless given."""
    if Q is None:
        Q = s.P * s.W
    transposed = s.A.T * s.P
    lyapunov = s.P * s.A + transposed
    of_one = lyapunov - s.C.T * Q.T - Q * s.C
    theta = sympy.diag(*[s.C] * s.n)
    omega = sympy.diag(*[of_one] * s.n)
    top = s.J - s.K
    corner = top + top.T
    upper = corner.row_join(theta)
    lower = theta.T.row_join(omega)
    return upper.col_join(lower)


def derivative_of_v(s: SimpleNamespace) -> Any:
    """V = e'e + sum eps_i' P eps_i (23) along (22), by the chain rule."""
    (V,) = s.e.T * s.e
    unknown = []
    eps_rate = []
    for i in range(s.n):
        first = i * s.q
        eps = s.eps[first : first + s.q, :]
        V += (eps.T * s.P * eps)[0]
        unknown += [*(s.C * eps)]
        eps_rate += [*((s.A - s.W * s.C) * eps)]
    e_rate = (s.J - s.K) * s.e + sympy.Matrix(unknown)

    states = [*s.e, *s.eps]
    rates = [*e_rate, *eps_rate]
    total = sympy.Integer(0)
    for state, rate in zip(states, rates, strict=True):
        total += sympy.diff(V, state) * rate
    return total


def is_form(s: SimpleNamespace, psi: sympy.Matrix) -> bool:
    """Whether V' = [e; eps]' psi [e; eps] (24)."""
    state = s.e.col_join(s.eps)
    (form,) = state.T * psi * state
    residual = derivative_of_v(s) - form
    return sympy.expand(residual) == 0


SIZES = [(1, 1, 1), (2, 1, 2), (2, 2, 1), (3, 1, 2), (1, 2, 3), (2, 2, 2)]


@pytest.mark.parametrize(("n", "m", "q"), SIZES)
def test_the_derivative_of_v_is_the_quadratic_form_of_psi(n: int, m: int, q: int):
    """(24)."""
    s = loop(n=n, m=m, q=q)
    assert is_form(s, psi_of(s))


def test_with_a_mistake_in_psi_it_is_not():
    """The wrong sign of Theta; Q = W P; K once in Lambda, where (10) has K + K'."""
    s = loop(n=1, m=2, q=2)
    turned = psi_of(s)
    turned[:2, 2:] *= -1
    turned[2:, :2] *= -1
    once = psi_of(s)
    once[:2, :2] += s.K
    other_order = psi_of(s, Q=s.W * s.P)
    for wrong in (turned, other_order, once):
        assert not is_form(s, wrong)


def test_the_papers_numbers_give_its_omega():
    """Example 1: Omega0 = [[-1, 1/3], [1/3, -1]]."""
    s = loop(n=1, m=1, q=2)
    third = sympy.Rational(1, 3)
    values: dict[sympy.Symbol, Any] = {}

    def given(symbols: sympy.Matrix, *numbers: Any) -> None:
        values.update(zip(symbols, map(sympy.Rational, numbers), strict=True))

    given(s.A, 0, 2, -2, 0)
    given(s.C, 1, 0)
    given(s.P, "1/2", "-1/4", "-1/4", "1/3")
    given(s.W, "16/5", "12/5")
    omega = psi_of(s)[1:, 1:].subs(values)
    assert omega == sympy.Matrix([[-1, third], [third, -1]])


def agent(*, m: int, q: int) -> SimpleNamespace:
    """One agent: s stands for its coupling sum, g for its goal; its rates by (1), (12), (13), its u
    by (19)."""
    a = SimpleNamespace()
    a.A = free("A", q, q)
    a.C = free("C", m, q)
    a.W = free("W", q, m)
    a.k = free("k", m, m)
    for name in ("x", "u", "s", "g"):
        setattr(a, name, free(name, m))
    a.xi = free("xi", q)
    a.z = free("z", q)
    a.decay = a.A - a.W * a.C
    estimate = a.z + a.W * a.x
    a.x_rate = a.s + a.u + a.C * a.xi
    a.z_rate = a.decay * estimate - a.W * (a.s + a.u)
    a.eps = a.xi - estimate
    distance = a.x - a.g
    pull = -a.k * distance
    a.control = pull - a.C * estimate
    return a


def observer_residual(a: SimpleNamespace, z_rate: sympy.Matrix) -> sympy.Matrix:
    """eps' - (A - W C) eps (17)."""
    eps_rate = a.A * a.xi - (z_rate + a.W * a.x_rate)
    return (eps_rate - a.decay * a.eps).expand()


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1), (2, 3)])
def test_the_observer_error_does_not_feel_couplings_or_inputs(m: int, q: int):
    """(17); an observer that is not told the input, or has the sign of the couplings turned, errs
    by just that."""
    a = agent(m=m, q=q)
    assert observer_residual(a, a.z_rate) == sympy.zeros(q, 1)
    untold = a.W * a.u
    turned = 2 * a.W * a.s
    for mistake in (untold, turned):
        residual = observer_residual(a, a.z_rate + mistake)
        assert residual == (-mistake).expand()


@pytest.mark.parametrize(("m", "q"), [(1, 2), (2, 1)])
def test_the_error_feels_the_disturbance_through_the_estimation_error_only(m: int, q: int):
    """(20) from (1), (12), (19); with the sign of u as printed in (6) it does not follow."""
    a = agent(m=m, q=q)
    error = a.x - a.g
    wanted = a.s - a.k * error + a.C * a.eps
    disturbed = a.s + a.C * a.xi
    moved = disturbed + a.control - wanted
    turned = disturbed - a.control - wanted
    assert moved.expand() == sympy.zeros(m, 1)
    assert turned.expand() != sympy.zeros(m, 1)
