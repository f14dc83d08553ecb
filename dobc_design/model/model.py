"""The model of one mode as CasADi functions: h and dh/de of (9) and (11), (13), (19), the closed
loop, (22).

Vectors are stacked agent by agent: e = [e_1; ...; e_n] with m components each, xi, z and eps with q
each.  The functions take and return NumPy arrays or CasADi's own types; they are float64 and prove
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from dobc_design._show.cards import Card, Headed
from dobc_design.coupling.expression import Expression
from dobc_design.coupling.functions import FUNCTIONS, applied
from dobc_design.coupling.tree import Operators, evaluate, variable_names
from dobc_design.exact.matrix import to_float
from dobc_design.exact.number import nearest
from dobc_design.problem import arrays
from dobc_design.problem.integrators import as_integrators, slopes_of_nodes
from dobc_design.problem.problem import Problem


class CasadiAlgebra(Operators):
    """Algebra (``coupling.tree.Algebra``) of CasADi expressions, element by element on vectors."""

    def constant(self, value: Fraction) -> Any:
        return ca.DM(nearest(value))

    def pi(self) -> Any:
        return ca.DM(np.pi)

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Any) -> Any:
        return FUNCTIONS[name].found_in(ca, "casadi")(*operands)


class SympyAlgebra(Operators):
    """The same of SymPy expressions, number for number: 3.2 arrives as 16/5."""

    def __init__(self) -> None:
        import sympy  # which nothing else here needs

        self.library: Any = sympy

    def constant(self, value: Fraction) -> Any:
        return self.library.Rational(value.numerator, value.denominator)

    def pi(self) -> Any:
        return self.library.pi

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Any) -> Any:
        return FUNCTIONS[name].found_in(self.library, "sympy")(*operands)


def to_sympy(expression: Expression) -> tuple[Any, tuple[Any, ...]]:
    """Return the expression in SymPy and its variables, real symbols: y, or y1 to ym.  No text is
    parsed."""
    import sympy

    variables = tuple(
        sympy.Symbol(name, real=True) for name in variable_names(expression.dimension)
    )
    return evaluate(expression.node, variables, SympyAlgebra()), variables


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Model(Headed):
    """The equations of one mode; every field below ``W`` is a casadi.Function with named inputs and
    outputs.

    W (q, m) is the observer gain in use; n, m, q count agents, components and exosystem states.
    Where agents have different exosystems, W is block diagonal and q counts the states of all
    groups (``problem.arrays.Disturbance``): those of other groups than an agent's own have to start
    at 0, and stay there.  With [dynamics] x' = A x + B (h + u + d): h, u, which holds u0, and dhat
    have p components for each agent.  Of the integrators that stand for these h also holds what f
    has beside its slopes.

    - h: e -> h, the couplings of (9), without the pins.
    - jacobian: e -> dh_de, exact and sparse (11); at a kink one of the slopes.
    - observer: z, x, u -> z_dot, xihat, dhat (13).
    - controller: x, dhat -> u (19).
    - closed_loop: x, xi, z -> x_dot, xi_dot, z_dot; (1), (12), (13), (19).
    - error_dynamics: e, eps -> e_dot, eps_dot (22).

    With a leader controller, closed_loop and error_dynamics take s (m,) last, and closed_loop
    returns s_dot, too.
    """

    problem: Problem
    mode: str
    n: int
    m: int
    q: int
    W: arrays.Array
    h: Any
    jacobian: Any
    observer: Any
    controller: Any
    closed_loop: Any
    error_dynamics: Any

    @property
    def functions(self) -> tuple[Any, ...]:
        """All casadi.Function objects, in the order above."""
        return (
            self.h,
            self.jacobian,
            self.observer,
            self.controller,
            self.closed_loop,
            self.error_dynamics,
        )

    def _card(self) -> Card:
        title = f'{self.problem.name}, mode "{self.mode}": n = {self.n}, m = {self.m}, q = {self.q}'
        return Card(
            title=title,
            heads=("function", "takes", "returns"),
            rows=[*map(_signature, self.functions)],
        )


def build_model(
    problem: Problem, mode: str | None = None, *, gain: arrays.Gain | None = None
) -> Model:
    """Build the CasADi functions of one mode, the first one unless ``mode`` names another.

    ``gain`` (q, m) takes the place of problem.observer.W.  In a formation, couplings act on x -
    offset.
    Raises: SpecError for an unknown mode, or if there is an exosystem and no W; ShapeError for a
    wrong gain.
    """
    name = arrays.chosen_mode(problem, mode)
    integrators = as_integrators(problem)
    W = arrays.required_gain(integrators, gain)
    h, jacobian = _couplings(problem, name)
    found = _loop(problem, h, arrays.disturbance_arrays(integrators, gain)) | {
        "W": W,
        "h": h,
        "jacobian": jacobian,
    }
    return Model(problem=problem, mode=name, n=problem.n, m=problem.m, q=problem.q, **found)


def _loop(problem: Problem, h: Any, disturbance: arrays.Disturbance) -> dict[str, Any]:
    n, widths, plant = (
        problem.n,
        {"m": problem.m, "p": problem.inputs, "q": problem.q},
        arrays.plant_arrays(problem),
    )
    A, C, F = (
        ca.DM(each)
        for each in (disturbance.A, disturbance.C if plant is None else plant.C, disturbance.F)
    )
    K, goal = _constant(arrays.pinning_matrix(problem)), ca.DM(arrays.goals(problem).reshape(-1))
    u0 = ca.DM(0 if plant is None else plant.u0.reshape(-1))

    def per_agent(factor: Any, stacked: Any) -> Any:
        """(I_n (x) factor) stacked."""
        return ca.vec(factor @ ca.reshape(stacked, factor.size2(), n))

    def correction(y: Any) -> Any:
        """W y of every agent, whose gains are blocks of a large matrix where they differ."""
        W = disturbance.W
        return (
            per_agent(ca.DM(W), y)
            if W.ndim == 2
            else _constant(sp.block_diag([*map(sp.csr_array, W)])) @ y
        )

    s = ca.SX.sym("s", problem.m)
    led, beside = ({}, 0) if problem.leader is None else ({"s": s}, ca.repmat(s, n, 1))
    # else u0 holds the goal
    drift = ca.repmat(ca.DM(arrays.leaders_drift(problem)), n, 1) if led else 0

    def moved(e: Any, v: Any) -> Any:
        """A x + B v of every agent, or f(x) + B v, for v less the u0 with A goal + B u0 = 0."""
        if plant is None:
            return v
        return (
            per_agent(_constant(plant.A), e) + _bent(problem, e) + per_agent(_constant(plant.B), v)
        )

    def observe(z: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
        """z_dot, xihat and dhat of (13)."""
        xihat = z + correction(x)
        x_dot = moved(x - goal, h(x - goal) + u - u0) + drift
        return per_agent(F, xihat) - correction(x_dot), xihat, per_agent(C, xihat)

    def control(x: Any, dhat: Any) -> Any:
        return -K @ (x - goal - beside) - dhat + u0

    kinds = {"z": "q", "x": "m", "u": "p", "xi": "q", "dhat": "p", "e": "m", "eps": "q"}
    z, x, u, xi, dhat, e, eps = (ca.SX.sym(name, n * widths[kind]) for name, kind in kinds.items())
    applied = control(x, per_agent(C, z + correction(x)))
    x_dot = moved(x - goal, h(x - goal) + applied - u0 + per_agent(C, xi)) + drift
    none = ca.SX(n * problem.inputs, 1)
    e_dot = moved(e + beside, h(e) - K @ e + per_agent(C, eps)) - (
        moved(beside, none) if led else 0
    )
    z_dot, xihat, estimate = observe(z, x, u)
    closed = {"x_dot": x_dot, "xi_dot": per_agent(A, xi), "z_dot": observe(z, x, applied)[0]}
    closed |= {"s_dot": (moved(beside, none) + drift)[: problem.m]} if led else {}
    rows = {
        "observer": ({"z": z, "x": x, "u": u}, {"z_dot": z_dot, "xihat": xihat, "dhat": estimate}),
        "controller": ({"x": x, "dhat": dhat, **led}, {"u": control(x, dhat)}),
        "closed_loop": ({"x": x, "xi": xi, "z": z, **led}, closed),
        "error_dynamics": (
            {"e": e, "eps": eps, **led},
            {"e_dot": e_dot, "eps_dot": per_agent(F, eps)},
        ),
    }
    return {name: _function(name, *each) for name, each in rows.items()}


def _couplings(problem: Problem, mode: str) -> tuple[Any, Any]:
    """h and dh/de of (9) as functions of e; arcs of one coupling are one vector operation."""
    n, m, p = problem.n, problem.m, problem.inputs
    e = ca.SX.sym("e", n * m)
    h, jacobian = ca.SX(n * p, 1), ca.SX(n * p, n * m)
    if problem.node is not None:
        h += _bent(problem, e)
        jacobian += ca.jacobian(h, e)
    for group in arrays.arc_groups(problem, mode):
        differences = [
            _constant(sp.kron(arrays.difference_matrix(group, n), np.eye(m)[[c]])) for c in range(m)
        ]
        gather = [
            _constant(sp.kron(arrays.gathering_matrix(group, n), np.eye(p)[:, [c]]))
            for c in range(p)
        ]
        values, slopes = _on_arcs(group, [difference @ e for difference in differences])
        for c in range(p):
            h += gather[c] @ values[c]
            for d in range(m):
                if slopes[c][d] is not None:
                    jacobian += gather[c] @ ca.diag(slopes[c][d]) @ differences[d]
    return _function("h", {"e": e}, {"h": h}), ca.Function(
        "jacobian", [e], [jacobian], ["e"], ["dh_de"]
    )


def _bent(problem: Problem, e: Any) -> Any:
    """f(goal + e) - f(goal) less its slopes at e = 0, of every agent whose [dynamics] are
    nonlinear; else 0."""
    own = as_integrators(problem) if problem.origin is None else problem
    result = ca.SX(problem.n * problem.m, 1)
    if own.node is not None:
        parts = [e[c :: problem.m] for c in range(problem.m)]
        values = own.couplings[own.node].evaluated(parts, CasadiAlgebra())
        for c, row in enumerate(to_float(slopes_of_nodes(own))):
            result[c :: problem.m] = values[c] - sum(
                slope * part for slope, part in zip(row, parts, strict=True)
            )
    return result


def _on_arcs(group: arrays.ArcGroup, y: Sequence[Any]) -> tuple[list[Any], list[list[Any | None]]]:
    """Components of h, and slopes[c][d] = dh_c/dy_d (None where it is 0), on every arc; y[c] has
    one row per arc."""
    count, m, p = len(group.weights), len(y), group.coupling.outputs
    variables = [ca.SX.sym(f"y{c + 1}", count) for c in range(m)]
    found = group.coupling.evaluated(variables, CasadiAlgebra())
    values = [ca.SX.zeros(count, 1) + value for value in found]  # a component may be a constant 0
    ones = ca.DM.ones(count, 1)
    pairs = [
        (c, d) for c in range(p) for d in range(m) if c == d or not group.coupling.by_component
    ]
    # Each arc's value depends on that arc's y alone, so J times a vector of ones is the diagonal of
    # J.
    slopes = [ca.jtimes(values[c], variables[d], ones) for c, d in pairs]
    arcs = ca.Function("arcs", variables, [*values, *slopes])(*y)
    table: list[list[Any | None]] = [[None] * m for _ in range(p)]
    for (c, d), slope in zip(pairs, arcs[p:], strict=True):
        table[c][d] = slope
    return list(arcs[:p]), table


def _constant(matrix: sp.sparray) -> Any:
    """A SciPy sparse array as a casadi.DM without stored zeros."""
    return ca.sparsify(ca.DM(sp.csc_matrix(matrix)))


def _function(name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> Any:
    return ca.Function(
        name, [*inputs.values()], [*map(ca.densify, outputs.values())], [*inputs], [*outputs]
    )


def _signature(function: Any) -> tuple[str, str, str]:
    """Name, inputs and outputs with their shapes, for showing."""
    inputs = ((function.name_in(i), *function.size_in(i)) for i in range(function.n_in()))
    outputs = ((function.name_out(i), *function.size_out(i)) for i in range(function.n_out()))
    shown = (
        ", ".join(
            f"{name} ({rows})" if columns == 1 else f"{name} ({rows}, {columns})"
            for name, rows, columns in each
        )
        for each in (inputs, outputs)
    )
    return function.name(), *shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flow:
    """The error system (22) of one mode over a horizon: states [e; eps], ``rows`` numbers of e and
    ``size`` in all."""

    rows: int
    size: int
    end_function: Any
    pull_function: Any

    def end(self, start: arrays.Array) -> arrays.Array:
        """The state at the horizon, (size,); not finite where the steps are too long for the
        loop."""
        return np.asarray(self.end_function(start)).ravel()

    def pull(self, start: arrays.Array, weight: arrays.Array) -> tuple[arrays.Array, arrays.Array]:
        """The state at the horizon and the gradient of weight'end by the start, both (size,)."""
        end, gradient = self.pull_function(start, weight)
        return np.asarray(end).ravel(), np.asarray(gradient).ravel()


def build_flow(
    problem: Problem,
    mode: str | None = None,
    *,
    horizon: float,
    steps: int,
    gain: arrays.Gain | None = None,
) -> Flow:
    """The flow of one mode, the first unless ``mode`` names another, with W = ``gain`` (q, m).
    Raises: SpecError."""
    model = build_model(problem, mode, gain=gain)
    rows, size = model.n * model.m, model.n * (model.m + model.q)
    state = ca.SX.sym("state", size)
    slope = ca.vertcat(*model.error_dynamics(state[:rows], state[rows:]))
    runge_kutta = ca.simpleRK(
        ca.Function("slope", [state, ca.SX.sym("nothing", 0)], [slope]), steps
    )
    start, weight = ca.MX.sym("start", size), ca.MX.sym("weight", size)
    end = runge_kutta(start, [], horizon)
    pull = [end, ca.jtimes(end, start, weight, True)]
    return Flow(
        rows=rows,
        size=size,
        end_function=ca.Function("end", [start], [end], ["start"], ["end"]),
        pull_function=ca.Function(
            "pull", [start, weight], pull, ["start", "weight"], ["end", "gradient"]
        ),
    )
