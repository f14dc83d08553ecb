"""The model of one mode as CasADi functions: h and dh/de of (9) and (11), (13), (19), the closed loop, (22).

Vectors are stacked agent by agent: e = [e_1; ...; e_n] with m components each, xi, z and eps with q each.
Without an exosystem q = 0 and these are empty.  The functions take and return NumPy arrays or CasADi's own types;
they are float64 and prove nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from dobc_design._show.cards import Card, Shown
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.functions import FUNCTIONS, by_twos
from dobc_design.coupling.tree import Operators, evaluate
from dobc_design.problem.arrays import (
    ArcGroup,
    Array,
    Disturbance,
    Gain,
    arc_groups,
    chosen_mode,
    difference_matrix,
    disturbance_arrays,
    gathering_matrix,
    goals,
    pinning_matrix,
    required_gain,
)
from dobc_design.problem.problem import Problem


class CasadiAlgebra(Operators):
    """Algebra (``coupling.tree.Algebra``) of CasADi expressions, element by element on vectors."""

    def constant(self, value: Fraction) -> Any:
        try:
            return ca.DM(value.numerator / value.denominator)
        except OverflowError:  # constants are never negative
            return ca.DM(np.inf)

    def pi(self) -> Any:
        return ca.DM(np.pi)

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return by_twos(name, arguments, lambda name, *operands: FUNCTIONS[name].found_in(ca, "casadi")(*operands))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Model(Shown):
    """The equations of one mode; every field below ``W`` is a casadi.Function with named inputs and outputs.

    W (q, m) is the observer gain in use; n, m, q count agents, components and exosystem states.  Where agents have
    different exosystems, W is block diagonal and q counts the states of all groups (``problem.arrays.Disturbance``):
    those of other groups than an agent's own have to start at 0, and stay there.

    - h: e -> h, the couplings of (9), without the pins.
    - jacobian: e -> dh_de, exact and sparse (11); at a kink one of the slopes.
    - observer: z, x, u -> z_dot, xihat, dhat (13).
    - controller: x, dhat -> u (19).
    - closed_loop: x, xi, z -> x_dot, xi_dot, z_dot; (1), (12), (13), (19).
    - error_dynamics: e, eps -> e_dot, eps_dot (22).
    """

    problem: Problem
    mode: str
    n: int
    m: int
    q: int
    W: Array
    h: Any
    jacobian: Any
    observer: Any
    controller: Any
    closed_loop: Any
    error_dynamics: Any

    @property
    def functions(self) -> tuple[Any, ...]:
        """All casadi.Function objects, in the order above."""
        return (self.h, self.jacobian, self.observer, self.controller, self.closed_loop, self.error_dynamics)

    def __str__(self) -> str:
        rows = [f"  {name:<15} {inputs} -> {outputs}" for name, inputs, outputs in map(_signature, self.functions)]
        return "\n".join([self._title, *rows])

    def __repr__(self) -> str:
        return f"<Model of {self._title}>"

    def _card(self) -> Card:
        return Card(
            title=self._title,
            heads=("function", "takes", "returns"),
            rows=[_signature(each) for each in self.functions],
        )

    @property
    def _title(self) -> str:
        return f'{self.problem.name}, mode "{self.mode}": n = {self.n}, m = {self.m}, q = {self.q}'


def build_model(problem: Problem, mode: str | None = None, *, gain: Gain | None = None) -> Model:
    """Build the CasADi functions of one mode, the first one unless ``mode`` names another.

    ``gain`` (q, m) takes the place of problem.observer.W.  In a formation, couplings act on x - offset.
    Raises: SpecError for an unknown mode, or if there is an exosystem and no W; ShapeError for a wrong gain.
    """
    name = chosen_mode(problem, mode)
    W = required_gain(problem, gain)
    h, jacobian = _couplings(problem, name)
    loop = _Loop(problem=problem, h=h, disturbance=disturbance_arrays(problem, gain))
    return Model(
        problem=problem,
        mode=name,
        n=problem.n,
        m=problem.m,
        q=problem.q,
        W=W,
        h=h,
        jacobian=jacobian,
        observer=loop.observer(),
        controller=loop.controller(),
        closed_loop=loop.closed_loop(),
        error_dynamics=loop.error_dynamics(),
    )


class _Loop:
    """Builds the functions that need more than the couplings; matrices have one column per agent."""

    def __init__(self, *, problem: Problem, h: Any, disturbance: Disturbance) -> None:
        self.n, self.m, self.q = problem.n, problem.m, problem.q
        self.h = h
        self.A, self.C, self.F = ca.DM(disturbance.A), ca.DM(disturbance.C), ca.DM(disturbance.F)
        W = disturbance.W
        self.W = _constant(sp.csr_array(sp.block_diag(list(W)))) if W.ndim == 3 else ca.DM(W)
        self.K = _constant(pinning_matrix(problem))
        self.goal = ca.DM(goals(problem).reshape(-1))

    def observer(self) -> Any:
        z, x, u = self._symbol("z", self.q), self._symbol("x", self.m), self._symbol("u", self.m)
        outputs = [*self._observe(z, x, u), self._disturbance(self._estimate(z, x))]
        return _function("observer", {"z": z, "x": x, "u": u}, outputs, ["z_dot", "xihat", "dhat"])

    def controller(self) -> Any:
        x, dhat = self._symbol("x", self.m), self._symbol("dhat", self.m)
        return _function("controller", {"x": x, "dhat": dhat}, [self._control(x, dhat)], ["u"])

    def closed_loop(self) -> Any:
        x, xi, z = self._symbol("x", self.m), self._symbol("xi", self.q), self._symbol("z", self.q)
        u = self._control(x, self._disturbance(self._estimate(z, x)))
        x_dot = self.h(x - self.goal) + u + self._disturbance(xi)
        outputs = [x_dot, self._per_agent(self.A, xi, self.q), self._observe(z, x, u)[0]]
        return _function("closed_loop", {"x": x, "xi": xi, "z": z}, outputs, ["x_dot", "xi_dot", "z_dot"])

    def error_dynamics(self) -> Any:
        e, eps = self._symbol("e", self.m), self._symbol("eps", self.q)
        e_dot = self.h(e) - self.K @ e + self._disturbance(eps)
        eps_dot = self._per_agent(self.F, eps, self.q)
        return _function("error_dynamics", {"e": e, "eps": eps}, [e_dot, eps_dot], ["e_dot", "eps_dot"])

    def _observe(self, z: Any, x: Any, u: Any) -> tuple[Any, Any]:
        """z_dot and xihat of (13)."""
        xihat = self._estimate(z, x)
        felt = self.h(x - self.goal) + u
        return self._per_agent(self.F, xihat, self.q) - self._correction(felt), xihat

    def _estimate(self, z: Any, x: Any) -> Any:
        return z + self._correction(x)

    def _correction(self, y: Any) -> Any:
        """W y of every agent, whose gains are blocks of a large matrix where they differ."""
        grouped = self.W.size1() != self.q
        return self.W @ y if grouped else self._per_agent(self.W, y, self.m)

    def _disturbance(self, xi: Any) -> Any:
        return self._per_agent(self.C, xi, self.q)

    def _control(self, x: Any, dhat: Any) -> Any:
        return -self.K @ (x - self.goal) - dhat

    def _per_agent(self, factor: Any, stacked: Any, width: int) -> Any:
        """(I_n (x) factor) stacked, for ``width`` entries per agent."""
        return ca.vec(factor @ ca.reshape(stacked, width, self.n))

    def _symbol(self, name: str, width: int) -> Any:
        return ca.SX.sym(name, self.n * width)


def _couplings(problem: Problem, mode: str) -> tuple[Any, Any]:
    """h and dh/de of (9) as functions of e; arcs of one coupling are one vector operation."""
    n, m = problem.n, problem.m
    e = ca.SX.sym("e", n * m)
    h, jacobian = ca.SX(n * m, 1), ca.SX(n * m, n * m)
    for group in arc_groups(problem, mode):
        differences = [_component_columns(difference_matrix(group, n), c, m) for c in range(m)]
        gather = [_component_rows(gathering_matrix(group, n), c, m) for c in range(m)]
        values, slopes = _on_arcs(group, [difference @ e for difference in differences])
        for c in range(m):
            h += gather[c] @ values[c]
            for d in range(m):
                if slopes[c][d] is not None:
                    jacobian += gather[c] @ ca.diag(slopes[c][d]) @ differences[d]
    return _function("h", {"e": e}, [h], ["h"]), ca.Function("jacobian", [e], [jacobian], ["e"], ["dh_de"])


def _on_arcs(group: ArcGroup, y: Sequence[Any]) -> tuple[list[Any], list[list[Any | None]]]:
    """Components of h, and slopes[c][d] = dh_c/dy_d (None where it is 0), on every arc; y[c] has one row per arc."""
    count, m = len(group.weights), len(y)
    variables = [ca.SX.sym(f"y{c + 1}", count) for c in range(m)]
    values = _evaluated(group.coupling, variables, count)
    ones = ca.DM.ones(count, 1)
    pairs = [(c, d) for c in range(m) for d in range(m) if c == d or not group.coupling.by_component]
    # Each arc's value depends on that arc's y alone, so J times a vector of ones is the diagonal of J.
    slopes = [ca.jtimes(values[c], variables[d], ones) for c, d in pairs]
    found = ca.Function("arcs", variables, [*values, *slopes])(*y)
    table: list[list[Any | None]] = [[None] * m for _ in range(m)]
    for (c, d), slope in zip(pairs, found[m:], strict=True):
        table[c][d] = slope
    return list(found[:m]), table


def _evaluated(coupling: Coupling, variables: Sequence[Any], count: int) -> list[Any]:
    algebra = CasadiAlgebra()
    if coupling.by_component:
        values = [evaluate(coupling.components[0].node, [variable], algebra) for variable in variables]
    else:
        values = [evaluate(expression.node, variables, algebra) for expression in coupling.components]
    return [ca.SX.zeros(count, 1) + value for value in values]  # a component may be a constant 0


def _component_columns(matrix: sp.csr_array, component: int, m: int) -> Any:
    return _constant(sp.kron(matrix, np.eye(m)[[component]]))


def _component_rows(matrix: sp.csr_array, component: int, m: int) -> Any:
    return _constant(sp.kron(matrix, np.eye(m)[:, [component]]))


def _constant(matrix: sp.sparray) -> Any:
    """A SciPy sparse array as a casadi.DM without stored zeros."""
    return ca.sparsify(ca.DM(sp.csc_matrix(matrix)))


def _function(name: str, inputs: dict[str, Any], outputs: Sequence[Any], names: Sequence[str]) -> Any:
    return ca.Function(name, [*inputs.values()], [ca.densify(each) for each in outputs], [*inputs], [*names])


def _signature(function: Any) -> tuple[str, str, str]:
    """Name, inputs and outputs with their shapes, for showing."""
    inputs = ", ".join(f"{function.name_in(i)} {_shape(function.size_in(i))}" for i in range(function.n_in()))
    outputs = ", ".join(f"{function.name_out(i)} {_shape(function.size_out(i))}" for i in range(function.n_out()))
    return function.name(), inputs, outputs


def _shape(size: tuple[int, int]) -> str:
    return f"({size[0]})" if size[1] == 1 else f"({size[0]}, {size[1]})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flow:
    """The error system (22) of one mode from 0 to ``horizon`` (s) in ``steps`` equal steps.

    States are [e; eps], stacked agent by agent, ``rows`` numbers of e and ``size`` in all.
    """

    mode: str
    horizon: float
    steps: int
    rows: int
    size: int
    end_function: Any
    pull_function: Any

    def end(self, start: Array) -> Array:
        """The state at the horizon, (size,); not finite where the steps are too long for the loop."""
        return np.asarray(self.end_function(start)).ravel()

    def pull(self, start: Array, weight: Array) -> tuple[Array, Array]:
        """The state at the horizon and the gradient of weight'end by the start, both (size,)."""
        end, gradient = self.pull_function(start, weight)
        return np.asarray(end).ravel(), np.asarray(gradient).ravel()


def build_flow(
    problem: Problem, mode: str | None = None, *, horizon: float, steps: int, gain: Gain | None = None
) -> Flow:
    """Prepare the flow of one mode, the first one unless ``mode`` names another.

    ``gain`` (q, m) takes the place of problem.observer.W.
    Raises: SpecError as ``build_model`` does.
    """
    model = build_model(problem, mode, gain=gain)
    rows, size = model.n * model.m, model.n * (model.m + model.q)
    state, step = ca.SX.sym("state", size), horizon / steps

    def slope(at: Any) -> Any:
        return ca.vertcat(*model.error_dynamics(at[:rows], at[rows:]))

    first = slope(state)
    second = slope(state + step / 2 * first)
    third = slope(state + step / 2 * second)
    fourth = slope(state + step * third)
    one = ca.Function("step", [state], [state + step / 6 * (first + 2 * second + 2 * third + fourth)])
    start, weight = ca.MX.sym("start", size), ca.MX.sym("weight", size)
    end = one.fold(steps)(start)
    return Flow(
        mode=model.mode,
        horizon=horizon,
        steps=steps,
        rows=rows,
        size=size,
        end_function=ca.Function("end", [start], [end], ["start"], ["end"]),
        pull_function=ca.Function(
            "pull",
            [start, weight],
            [end, ca.jtimes(end, start, weight, True)],
            ["start", "weight"],
            ["end", "gradient"],
        ),
    )
