"""Symbolic proofs, for small sizes, of the identities that the theorems rest on: (17), (22) and (24).

Every matrix entry, state and input is a free symbol, so a residual that expands to 0 holds for all values of that
size.  h(e) stands as J e with a free J, which is exact with the averaged Jacobian (the mean value that
(21) needs).  Nothing here is about one particular problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import sympy

from dobc_design.coupling.expression import Expression
from dobc_design.coupling.functions import FUNCTIONS, by_twos
from dobc_design.coupling.tree import Operators, evaluate, variable_names


class SympyAlgebra(Operators):
    """Algebra (``coupling.tree.Algebra``) of SymPy expressions."""

    def constant(self, value: Fraction) -> Any:
        return sympy.Rational(value.numerator, value.denominator)

    def pi(self) -> Any:
        return sympy.pi

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return by_twos(name, arguments, lambda name, *operands: FUNCTIONS[name].found_in(sympy, "sympy")(*operands))


def to_sympy(expression: Expression) -> tuple[Any, tuple[Any, ...]]:
    """Return the expression and its variables, real symbols: y, or y1 to ym."""
    variables = tuple(sympy.Symbol(name, real=True) for name in variable_names(expression.dimension))
    return evaluate(expression.node, variables, SympyAlgebra()), variables


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """An identity between expressions in free symbols; it holds if the expanded ``residual`` is 0.

    Sizes: n agents, m components, q exosystem states.  ``residual`` is a column of SymPy polynomials.
    """

    name: str
    n: int
    m: int
    q: int
    residual: Any

    @property
    def holds(self) -> bool:
        """Whether every entry of the residual is identically 0."""
        return all(entry == 0 for entry in self.residual)

    def __str__(self) -> str:
        outcome = "holds" if self.holds else "does not hold"
        return f"{self.name} {outcome} for n = {self.n}, m = {self.m}, q = {self.q}"

    def _repr_latex_(self) -> str | None:
        if sum(len(sympy.Add.make_args(entry)) for entry in self.residual) > 40:
            return None
        return f"$${sympy.latex(self.residual)}$$"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopSymbols:
    """Free symbols of the error system (22); P is symmetric, K block diagonal with one m x m block per agent.

    Shapes: J, K (n m, n m), A, P (q, q), C (m, q), W (q, m), e (n m), eps (n q).
    """

    n: int
    m: int
    q: int
    J: Any
    K: Any
    A: Any
    C: Any
    P: Any
    W: Any
    e: Any
    eps: Any


def loop_symbols(*, n: int, m: int, q: int) -> LoopSymbols:
    """Make the free symbols for n agents with m components and q exosystem states each."""
    pins = [_matrix(f"k{i + 1}", m, m) for i in range(n)]
    return LoopSymbols(
        n=n,
        m=m,
        q=q,
        J=_matrix("J", n * m, n * m),
        K=sympy.diag(*pins),
        A=_matrix("A", q, q),
        C=_matrix("C", m, q),
        P=sympy.Matrix(q, q, lambda i, j: sympy.Symbol(f"P_{min(i, j) + 1}{max(i, j) + 1}", real=True)),
        W=_matrix("W", q, m),
        e=_matrix("e", n * m, 1),
        eps=_matrix("epsilon", n * q, 1),
    )


def block_matrix(symbols: LoopSymbols, *, Q: Any | None = None) -> Any:
    """Write Psi of (18), (n (m + q), n (m + q)); Q is P W unless given."""
    s = symbols
    product = s.P * s.W if Q is None else Q
    agents = sympy.eye(s.n)
    loop = s.J - s.K
    theta = sympy.KroneckerProduct(agents, s.C).doit()
    omega = s.P * s.A + s.A.T * s.P - s.C.T * product.T - product * s.C
    top = (loop + loop.T).row_join(theta)
    return top.col_join(theta.T.row_join(sympy.KroneckerProduct(agents, omega).doit()))


def lyapunov_derivative(symbols: LoopSymbols) -> Any:
    """Differentiate V = e'e + sum eps_i' P eps_i (23) along (22) by the chain rule."""
    s = symbols
    estimates = [s.eps[i * s.q : (i + 1) * s.q, :] for i in range(s.n)]
    e_rate = (s.J - s.K) * s.e
    for i, estimate in enumerate(estimates):
        e_rate[i * s.m : (i + 1) * s.m, :] += s.C * estimate
    eps_rate = sympy.Matrix([(s.A - s.W * s.C) * estimate for estimate in estimates])
    V = (s.e.T * s.e)[0] + sum((estimate.T * s.P * estimate)[0] for estimate in estimates)
    states, rates = [*s.e, *s.eps], [*e_rate, *eps_rate]
    return sum(sympy.diff(V, state) * rate for state, rate in zip(states, rates, strict=True))


def lyapunov_identity(symbols: LoopSymbols, *, psi: Any | None = None) -> Identity:
    """Compare V' with [e; eps]' Psi [e; eps] (24); ``psi`` takes the place of (18) when given."""
    state = symbols.e.col_join(symbols.eps)
    form = (state.T * (block_matrix(symbols) if psi is None else psi) * state)[0]
    residual = sympy.Matrix([sympy.expand(lyapunov_derivative(symbols) - form)])
    return Identity(name="V' = [e; eps]' Psi [e; eps] (24)", n=symbols.n, m=symbols.m, q=symbols.q, residual=residual)


def prove_lyapunov(*, n: int = 2, m: int = 1, q: int = 2) -> Identity:
    """Prove (24) for the given sizes: V' = [e; eps]' Psi [e; eps] with Q = P W.

    Returns: an Identity whose ``holds`` is true; seconds for n (m + q) up to about 10.
    """
    return lyapunov_identity(loop_symbols(n=n, m=m, q=q))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AgentSymbols:
    """Free symbols of one agent: s stands for its coupling sum, g for its goal.

    Shapes: A (q, q), C (m, q), W (q, m), k (m, m); x, u, s, g (m), xi, z (q).
    """

    m: int
    q: int
    A: Any
    C: Any
    W: Any
    k: Any
    x: Any
    u: Any
    s: Any
    g: Any
    xi: Any
    z: Any


def agent_symbols(*, m: int, q: int) -> AgentSymbols:
    """Make the free symbols of one agent with m components and q exosystem states."""
    return AgentSymbols(
        m=m,
        q=q,
        A=_matrix("A", q, q),
        C=_matrix("C", m, q),
        W=_matrix("W", q, m),
        k=_matrix("k", m, m),
        x=_matrix("x", m, 1),
        u=_matrix("u", m, 1),
        s=_matrix("s", m, 1),
        g=_matrix("g", m, 1),
        xi=_matrix("xi", q, 1),
        z=_matrix("z", q, 1),
    )


def observer_rate(symbols: AgentSymbols) -> Any:
    """Write z' of (13)."""
    a = symbols
    return (a.A - a.W * a.C) * (a.z + a.W * a.x) - a.W * (a.s + a.u)


def observer_identity(symbols: AgentSymbols, *, z_rate: Any | None = None) -> Identity:
    """Compare eps' with (A - W C) eps (17), for any coupling sum s and any input u.

    ``z_rate`` takes the place of (13) when given.
    """
    a = symbols
    x_rate = a.s + a.u + a.C * a.xi  # (1)
    estimate_rate = (observer_rate(a) if z_rate is None else z_rate) + a.W * x_rate
    eps = a.xi - (a.z + a.W * a.x)
    residual = (a.A * a.xi - estimate_rate - (a.A - a.W * a.C) * eps).expand()
    return Identity(name="eps' = (A - W C) eps (17)", n=1, m=a.m, q=a.q, residual=residual)


def prove_observer(*, m: int = 1, q: int = 2) -> Identity:
    """Prove that (17) follows from (1), (12) and (13), whatever the couplings and the input are."""
    return observer_identity(agent_symbols(m=m, q=q))


def control(symbols: AgentSymbols) -> Any:
    """Write u of (19), with the goal g."""
    a = symbols
    return -a.k * (a.x - a.g) - a.C * (a.z + a.W * a.x)


def error_identity(symbols: AgentSymbols, *, u: Any | None = None) -> Identity:
    """Compare e' = x' with s - k e + C eps, the first line of (20); ``u`` takes the place of (19) when given."""
    a = symbols
    eps = a.xi - (a.z + a.W * a.x)
    e_rate = a.s + (control(a) if u is None else u) + a.C * a.xi
    residual = (e_rate - (a.s - a.k * (a.x - a.g) + a.C * eps)).expand()
    return Identity(name="e' = h(e) - K e + (I (x) C) eps (20)", n=1, m=a.m, q=a.q, residual=residual)


def prove_error(*, m: int = 1, q: int = 2) -> Identity:
    """Prove that (20) follows from (1), (12) and (19)."""
    return error_identity(agent_symbols(m=m, q=q))


def _matrix(name: str, rows: int, columns: int) -> Any:
    def symbol(i: int, j: int) -> Any:
        index = f"{i + 1}" if columns == 1 else f"{i + 1},{j + 1}"
        return sympy.Symbol(f"{name}_{{{index}}}", real=True)

    return sympy.Matrix(rows, columns, symbol)
