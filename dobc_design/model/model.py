"""The model of one mode as CasADi functions: h and dh/de of (9) and (11), (13), (19), the closed
loop, (22).

Vectors are stacked agent by agent: e = [e_1; ...; e_n] with m components each, xi, z and eps with q
each.  The functions take and return NumPy arrays or CasADi's own types; they are float64 and prove
nothing.
"""

from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Headed
from dobc_design.exact.matrix import Array, to_float
from dobc_design.loop import arrays
from dobc_design.loop.make import errors_of
from dobc_design.problem.problem import Problem

from .couplings import Felt, Named, bent, constant, felt_inputs, function


@noun(eq=False)
class Model(Headed):
    """The equations of one mode; every field below ``W`` is a casadi.Function with named inputs and
    outputs.

    W (q, m) is the observer gain in use; n, m, q count agents, components and exosystem states.
    Where agents have different exosystems, W is block diagonal and q counts the states of all
    groups (``loop.arrays.Disturbance``): those of other groups than an agent's own have to start
    at 0, and stay there.  With [dynamics] x' = A x + B (h + u + d): h, u, which holds u0, and dhat
    have p components for each agent.  Where y = H x is measured, z and ``xihat`` are the estimates
    (xhat, xihat) of an agent, eps their errors, and the observer takes no more of x than y; e and
    the controller's x are those of the estimates where couplings act on them.

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
    problem.require("the model")
    name = arrays.chosen_mode(problem, mode)
    loop = errors_of(problem)
    W = arrays.required_gain(loop, gain)
    groups = arrays.plant_arcs(problem, name)
    own = problem.dynamics
    seen = np.eye(problem.m) if own is None else to_float(own.seen)
    felt = felt_inputs(groups, n=problem.n, p=problem.inputs, seen=seen)
    equations = _Equations(problem, name, felt, arrays.disturbance_arrays(loop, gain))
    return Model(
        problem=problem,
        mode=name,
        n=problem.n,
        m=problem.m,
        q=problem.q,
        W=W if equations.sensed is None else equations.sensed.pairs.W,
        h=felt.h,
        jacobian=felt.jacobian,
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

    def __init__(
        self, problem: Problem, mode: str, felt: Felt, disturbance: arrays.Disturbance
    ) -> None:
        plant = arrays.plant_arrays(problem)
        self.problem = problem
        self.loop = errors_of(problem)
        self.h = felt.h
        self.plant = plant
        self.A = ca.DM(disturbance.A)
        self.C = ca.DM(disturbance.C)
        self.F = ca.DM(disturbance.F)
        self.E = ca.DM(disturbance.C)  # what eps does to the states
        self.W = disturbance.W
        self.sensed = arrays.sensed_arrays(problem, self.loop)
        if problem.joint_exosystem is not None:
            self.A = ca.DM(to_float(problem.joint_exosystem.A))
        self.K = constant(arrays.pinning_matrix(problem, mode))
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
        xihat, dhat, _ = self._known(z, x)
        outputs = {"z_dot": z_dot, "xihat": xihat, "dhat": dhat}
        return function("observer", {"z": z, "x": x, "u": u}, outputs)

    def controller(self) -> Any:
        """u of (19) from x and dhat."""
        x = self._symbol("x")
        dhat = self._symbol("dhat")
        inputs = {"x": x, "dhat": dhat}
        u = self._control(x, dhat)
        return function("controller", inputs | self._led(), {"u": u})

    def closed_loop(self) -> Any:
        """(1), (12), (13) and (19) together."""
        x = self._symbol("x")
        xi = self._symbol("xi")
        z = self._symbol("z")
        d = self._per_agent(self.C, xi)
        _, dhat, known = self._known(z, x)
        u = self._control(known, dhat)
        felt = self.h(known - self.goal) + u - self.u0 + d
        x_dot = self._moved(x - self.goal, felt) + self.drift
        xi_dot = self._per_agent(self.A, xi)
        z_dot = self._observer_slope(z, x, u)
        outputs = {"x_dot": x_dot, "xi_dot": xi_dot, "z_dot": z_dot}
        if self.leader is not None:
            motion = self._led_motion() + self.drift
            outputs["s_dot"] = motion[: self.problem.m]
        inputs = {"x": x, "xi": xi, "z": z}
        return function("closed_loop", inputs | self._led(), outputs)

    def error_dynamics(self) -> Any:
        """(22), the error and the estimation error."""
        e = self._symbol("e")
        eps = self._symbol("eps")
        felt = self.h(e) - self.K @ e
        e_dot = self._moved(e + self._beside(), felt) + self._per_agent(self.E, eps)
        if self.leader is not None:
            e_dot = e_dot - self._led_motion()
        eps_dot = self._per_agent(self.F, eps)
        outputs = {"e_dot": e_dot, "eps_dot": eps_dot}
        inputs = {"e": e, "eps": eps}
        return function("error_dynamics", inputs | self._led(), outputs)

    def _symbol(self, name: str) -> Any:
        """A vector of all agents; its width is that of the states, inputs or exosystem."""
        problem = self.problem
        if name in ("x", "e"):
            width = problem.m
        elif name in ("u", "dhat"):
            width = problem.inputs
        else:
            width = problem.q if name == "xi" else self.loop.q
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

    def _known(self, z: Any, x: Any) -> tuple[Any, Any, Any]:
        """xihat, with xhat where outputs are measured, dhat, and the states that agents act on."""
        sensed = self.sensed
        if sensed is None:
            xihat = z + self._applied(self.W, x)
            return xihat, self._per_agent(self.C, xihat), x
        if sensed.estimated:
            x = self._per_agent(ca.DM(sensed.x), z)
        return z, self._per_agent(ca.DM(sensed.d), z), x

    def _applied(self, gain: Array, y: Any) -> Any:
        """W y of every agent, whose gains are blocks of a large matrix where they differ."""
        if gain.ndim == 2:
            return self._per_agent(ca.DM(gain), y)
        blocks = [sp.csr_array(each) for each in gain]
        return constant(sp.block_diag(blocks)) @ y

    def _moved(self, e: Any, v: Any) -> Any:
        """A x + B v of every agent, or f(x) + B v, for v less the u0 with A goal + B u0 = 0."""
        if self.plant is None:
            return v
        A = constant(self.plant.A)
        B = constant(self.plant.B)
        alone = self._per_agent(A, e) + bent(self.loop, e)
        return alone + self._per_agent(B, v)

    def _led_motion(self) -> Any:
        """What the dynamics make of the leader's state, for every agent: nothing acts on it."""
        nothing = ca.SX(self.problem.n * self.problem.inputs, 1)
        return self._moved(self._beside(), nothing)

    def _observer_slope(self, z: Any, x: Any, u: Any) -> Any:
        """z_dot of (13), or of an observer of states, too."""
        xihat, _, known = self._known(z, x)
        e = known - self.goal
        felt = self.h(e) + u
        if self.sensed is not None:
            moved = self._per_agent(self.F, z) + self._applied(self.sensed.B, felt)
            return moved + self._applied(self.sensed.gain, x)
        x_dot = self._moved(e, felt - self.u0) + self.drift
        return self._per_agent(self.F, xihat) - self._applied(self.W, x_dot)

    def _control(self, x: Any, dhat: Any) -> Any:
        e = x - self.goal - self._beside()
        return -self.K @ e - dhat + self.u0


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
