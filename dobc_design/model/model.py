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
from itertools import product
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from dobc_design._show.cards import Card, Headed
from dobc_design.coupling.expression import Expression
from dobc_design.coupling.functions import FUNCTIONS, applied
from dobc_design.coupling.tree import Operators, evaluate, variable_names
from dobc_design.exact.matrix import to_float
from dobc_design.exact.number import nearest
from dobc_design.loop import arrays
from dobc_design.loop.matrices import Array
from dobc_design.problem.integrators import as_integrators, slopes_of_nodes
from dobc_design.problem.problem import Problem

Named = dict[str, Any]  # symbols and expressions, by the names that users see


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

    names = variable_names(expression.dimension)
    variables = tuple(sympy.Symbol(name, real=True) for name in names)
    found = evaluate(expression.node, variables, SympyAlgebra())
    return found, variables


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Model(Headed):
    """The equations of one mode; every field below ``W`` is a casadi.Function with named inputs and
    outputs.

    W (q, m) is the observer gain in use; n, m, q count agents, components and exosystem states.
    Where agents have different exosystems, W is block diagonal and q counts the states of all
    groups (``loop.arrays.Disturbance``): those of other groups than an agent's own have to start
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
        return (
            self.h,
            self.jacobian,
            self.observer,
            self.controller,
            self.closed_loop,
            self.error_dynamics,
        )

    def _card(self) -> Card:
        sizes = f"n = {self.n}, m = {self.m}, q = {self.q}"
        return Card(
            title=f'{self.problem.name}, mode "{self.mode}": {sizes}',
            heads=("function", "takes", "returns"),
            rows=[_signature(each) for each in self.functions],
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
    # Agents with [dynamics] have the observer of the integrators with the same errors.
    integrators = as_integrators(problem)
    W = arrays.required_gain(integrators, gain)
    h, jacobian = _couplings(problem, name)
    equations = _Equations(problem, h, arrays.disturbance_arrays(integrators, gain))
    return Model(
        problem=problem,
        mode=name,
        n=problem.n,
        m=problem.m,
        q=problem.q,
        W=W,
        h=h,
        jacobian=jacobian,
        observer=equations.observer(),
        controller=equations.controller(),
        closed_loop=equations.closed_loop(),
        error_dynamics=equations.error_dynamics(),
    )


class _Equations:
    """The numbers of a problem as CasADi matrices, and the equations that they make.

    ``u0`` holds the goals, without a leader.  ``leader`` is its state s (m,), None without one, and
    ``drift`` what moves it, for all agents.  ``plant`` is None for single integrators.
    """

    def __init__(self, problem: Problem, h: Any, disturbance: arrays.Disturbance) -> None:
        plant = arrays.plant_arrays(problem)
        self.problem = problem
        self.h = h
        self.plant = plant
        self.A = ca.DM(disturbance.A)
        self.C = ca.DM(disturbance.C)
        self.F = ca.DM(disturbance.F)
        self.W = disturbance.W
        self.K = _constant(arrays.pinning_matrix(problem))
        self.goal = ca.DM(arrays.goals(problem).ravel())
        self.u0 = ca.DM(0)
        if plant is not None:  # whose disturbances and inputs are those of [dynamics]
            self.C = ca.DM(plant.C)
            self.u0 = ca.DM(plant.u0.ravel())
        self.leader: Any = None
        self.drift: Any = 0
        if problem.leader is not None:
            drift = ca.DM(arrays.leaders_drift(problem))
            self.leader = ca.SX.sym("s", problem.m)
            self.drift = ca.repmat(drift, problem.n, 1)

    def observer(self) -> Any:
        """z_dot, xihat and dhat of (13) from z, x and u."""
        z = self._symbol("z")
        x = self._symbol("x")
        u = self._symbol("u")
        z_dot = self._observer_slope(z, x, u)
        xihat = z + self._corrected(x)
        dhat = self._per_agent(self.C, xihat)
        outputs = {"z_dot": z_dot, "xihat": xihat, "dhat": dhat}
        return _function("observer", {"z": z, "x": x, "u": u}, outputs)

    def controller(self) -> Any:
        """u of (19) from x and dhat."""
        x = self._symbol("x")
        dhat = self._symbol("dhat")
        inputs = {"x": x, "dhat": dhat}
        u = self._control(x, dhat)
        return _function("controller", inputs | self._led(), {"u": u})

    def closed_loop(self) -> Any:
        """(1), (12), (13) and (19) together."""
        x = self._symbol("x")
        xi = self._symbol("xi")
        z = self._symbol("z")
        d = self._per_agent(self.C, xi)
        xihat = z + self._corrected(x)
        dhat = self._per_agent(self.C, xihat)
        u = self._control(x, dhat)
        e = x - self.goal
        felt = self.h(e) + u - self.u0 + d
        x_dot = self._moved(e, felt) + self.drift
        xi_dot = self._per_agent(self.A, xi)
        z_dot = self._observer_slope(z, x, u)
        outputs = {"x_dot": x_dot, "xi_dot": xi_dot, "z_dot": z_dot}
        if self.leader is not None:
            motion = self._led_motion() + self.drift
            outputs["s_dot"] = motion[: self.problem.m]
        inputs = {"x": x, "xi": xi, "z": z}
        return _function("closed_loop", inputs | self._led(), outputs)

    def error_dynamics(self) -> Any:
        """(22), the error and the estimation error."""
        e = self._symbol("e")
        eps = self._symbol("eps")
        unknown = self._per_agent(self.C, eps)
        felt = self.h(e) - self.K @ e + unknown
        e_dot = self._moved(e + self._beside(), felt)
        if self.leader is not None:
            e_dot = e_dot - self._led_motion()
        eps_dot = self._per_agent(self.F, eps)
        outputs = {"e_dot": e_dot, "eps_dot": eps_dot}
        inputs = {"e": e, "eps": eps}
        return _function("error_dynamics", inputs | self._led(), outputs)

    def _symbol(self, name: str) -> Any:
        """A vector of all agents; its width is that of the states, inputs or exosystem."""
        problem = self.problem
        if name in ("x", "e"):
            width = problem.m
        elif name in ("u", "dhat"):
            width = problem.inputs
        else:
            width = problem.q
        return ca.SX.sym(name, problem.n * width)

    def _led(self) -> Named:
        """The last input of functions that a leader enters."""
        return {} if self.leader is None else {"s": self.leader}

    def _beside(self) -> Any:
        """The leader's state for every agent, beside which they have their goals; else 0."""
        if self.leader is None:
            return 0
        return ca.repmat(self.leader, self.problem.n, 1)

    def _per_agent(self, factor: Any, stacked: Any) -> Any:
        """(I_n (x) factor) stacked."""
        columns = ca.reshape(stacked, factor.size2(), self.problem.n)
        return ca.vec(factor @ columns)

    def _corrected(self, y: Any) -> Any:
        """W y of every agent, whose gains are blocks of a large matrix where they differ."""
        if self.W.ndim == 2:
            return self._per_agent(ca.DM(self.W), y)
        blocks = [sp.csr_array(each) for each in self.W]
        return _constant(sp.block_diag(blocks)) @ y

    def _moved(self, e: Any, v: Any) -> Any:
        """A x + B v of every agent, or f(x) + B v, for v less the u0 with A goal + B u0 = 0."""
        if self.plant is None:
            return v
        A = _constant(self.plant.A)
        B = _constant(self.plant.B)
        alone = self._per_agent(A, e) + _bent(self.problem, e)
        return alone + self._per_agent(B, v)

    def _led_motion(self) -> Any:
        """What the dynamics make of the leader's state, for every agent: nothing acts on it."""
        nothing = ca.SX(self.problem.n * self.problem.inputs, 1)
        return self._moved(self._beside(), nothing)

    def _observer_slope(self, z: Any, x: Any, u: Any) -> Any:
        """z_dot of (13)."""
        e = x - self.goal
        felt = self.h(e) + u - self.u0
        x_dot = self._moved(e, felt) + self.drift
        xihat = z + self._corrected(x)
        return self._per_agent(self.F, xihat) - self._corrected(x_dot)

    def _control(self, x: Any, dhat: Any) -> Any:
        e = x - self.goal - self._beside()
        return -self.K @ e - dhat + self.u0


def _couplings(problem: Problem, mode: str) -> tuple[Any, Any]:
    """h and dh/de of (9) as functions of e; arcs of one coupling are one vector operation."""
    n = problem.n
    e = ca.SX.sym("e", n * problem.m)
    h = ca.SX(n * problem.inputs, 1)
    jacobian = ca.SX(n * problem.inputs, n * problem.m)
    # Of the integrators that stand for agents with an f, h also holds what f has beside its slopes.
    if problem.node is not None:
        h += _bent(problem, e)
        jacobian += ca.jacobian(h, e)
    for group in arrays.arc_groups(problem, mode):
        # A row of a difference takes one component of e_j - e_i for an arc (i, j) ...
        along = arrays.difference_matrix(group, n)
        differences = [_constant(sp.kron(along, row)) for row in _rows(problem.m)]
        # ... and a gathering adds up what every agent feels there, with the weights of its arcs.
        onto = arrays.gathering_matrix(group, n)
        gathering = [_constant(sp.kron(onto, row.T)) for row in _rows(problem.inputs)]
        found = _on_arcs(group, [difference @ e for difference in differences])
        for c, gathered in enumerate(gathering):
            h += gathered @ found.values[c]
            for d, difference in enumerate(differences):
                slope = found.slopes.get((c, d))
                if slope is not None:
                    jacobian += gathered @ ca.diag(slope) @ difference
    sparse = ca.Function("jacobian", [e], [jacobian], ["e"], ["dh_de"])
    return _function("h", {"e": e}, {"h": h}), sparse


def _rows(size: int) -> list[Array]:
    """The rows (1, size) of the identity."""
    return np.split(np.eye(size), size)


def _bent(problem: Problem, e: Any) -> Any:
    """f(goal + e) - f(goal) less its slopes at e = 0, of every agent whose [dynamics] are
    nonlinear; else 0."""
    own = as_integrators(problem) if problem.origin is None else problem
    result = ca.SX(problem.n * problem.m, 1)
    if own.node is None:
        return result
    parts = [e[c :: problem.m] for c in range(problem.m)]
    values = own.couplings[own.node].evaluated(parts, CasadiAlgebra())
    # The slopes are in A already.
    slopes = to_float(slopes_of_nodes(own))
    for c, value in enumerate(values):
        terms = zip(slopes[c], parts, strict=True)
        linear = sum(slope * part for slope, part in terms)
        result[c :: problem.m] = value - linear
    return result


class _OnArcs(NamedTuple):
    """Components of h, and dh_c/dy_d by (c, d) where it is not 0, on every arc."""

    values: list[Any]
    slopes: dict[tuple[int, int], Any]


def _on_arcs(group: arrays.ArcGroup, y: Sequence[Any]) -> _OnArcs:
    """h and its slopes at the arguments of the arcs; y[c] has one row per arc."""
    count, m = len(group.weights), len(y)
    p = group.coupling.outputs
    variables = [ca.SX.sym(f"y{c + 1}", count) for c in range(m)]
    components = group.coupling.evaluated(variables, CasadiAlgebra())
    # A component may be a constant, which has to be one for every arc.
    zeros = ca.SX.zeros(count, 1)
    values = [zeros + value for value in components]
    if group.coupling.by_component:
        pairs = [(c, c) for c in range(p)]
    else:
        pairs = list(product(range(p), range(m)))
    # Each arc's value depends on that arc's y alone, so J times a vector of ones is the diagonal of
    # J.
    ones = ca.DM.ones(count, 1)
    slopes = [ca.jtimes(values[c], variables[d], ones) for c, d in pairs]
    function = ca.Function("arcs", variables, [*values, *slopes])
    found = function(*y)
    by_pair = dict(zip(pairs, found[p:], strict=True))
    return _OnArcs(values=found[:p], slopes=by_pair)


def _constant(matrix: sp.sparray) -> Any:
    """A SciPy sparse array as a casadi.DM without stored zeros."""
    return ca.sparsify(ca.DM(sp.csc_matrix(matrix)))


def _function(name: str, inputs: Named, outputs: Named) -> Any:
    # Users see full arrays; only the Jacobian stays sparse.
    dense = [ca.densify(each) for each in outputs.values()]
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))


def _signature(function: Any) -> tuple[str, str, str]:
    """Name, inputs and outputs with their shapes, for showing."""
    inputs = [_sized(name, function.size_in(name)) for name in function.name_in()]
    outputs = [_sized(name, function.size_out(name)) for name in function.name_out()]
    return function.name(), ", ".join(inputs), ", ".join(outputs)


def _sized(name: str, size: tuple[int, int]) -> str:
    rows, columns = size
    if columns == 1:
        return f"{name} ({rows})"
    return f"{name} ({rows}, {columns})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flow:
    """The error system (22) of one mode over a horizon: states [e; eps], ``rows`` numbers of e and
    ``size`` in all."""

    rows: int
    size: int
    end_function: Any
    pull_function: Any

    def end(self, start: Array) -> Array:
        """The state at the horizon, (size,); not finite where the steps are too long for the
        loop."""
        return np.asarray(self.end_function(start)).ravel()

    def pull(self, start: Array, weight: Array) -> tuple[Array, Array]:
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
    rows = model.n * model.m
    size = rows + model.n * model.q
    state = ca.SX.sym("state", size)
    slopes = ca.vertcat(*model.error_dynamics(state[:rows], state[rows:]))
    nothing = ca.SX.sym("nothing", 0)  # the parameters that simpleRK wants
    dynamics = ca.Function("slope", [state, nothing], [slopes])
    # A fixed number of steps, so that the end is a smooth function of the start.
    runge_kutta = ca.simpleRK(dynamics, steps)
    start = ca.MX.sym("start", size)
    weight = ca.MX.sym("weight", size)
    end = runge_kutta(start, [], horizon)
    # True: the transposed Jacobian, in one sweep back through the steps.
    gradient = ca.jtimes(end, start, weight, True)
    to_end = _function("end", {"start": start}, {"end": end})
    inputs = {"start": start, "weight": weight}
    back = _function("pull", inputs, {"end": end, "gradient": gradient})
    return Flow(rows=rows, size=size, end_function=to_end, pull_function=back)
