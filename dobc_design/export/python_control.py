"""The closed loop as python-control objects: a NonlinearIOSystem, and observer and exosystem as
StateSpace.

Paper: (1), (12), (13), (19).  Couplings are those of ``simulation.field``;
``control.input_output_response`` reproduces a simulated trajectory.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import control
import numpy as np
from numpy.typing import ArrayLike

from dobc_design.exact.matrix import Array
from dobc_design.loop.arrays import Gain, error_arcs
from dobc_design.loop.make import errors_of
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import (
    Active,
    ClosedLoop,
    Network,
    applied,
    make_closed_loop,
    network_of,
)
from dobc_design.simulation.sampled import discretised, transition
from dobc_design.simulation.signals import Fixed, Scheduled
from dobc_design.simulation.switches import scheduled_switches
from dobc_design.simulation.trajectory import Trajectory


class ConsensusLoop(control.NonlinearIOSystem):  # type: ignore[misc]  # control is not typed
    """The closed loop of all agents.  States: x, xi, z, each agent by agent, n m + 2 n q of them.
    Inputs: a disturbance that acts besides d, n m, in units of x per s; 0 gives the loop as
    printed.  Outputs: x, dhat and u, n m each.  Agents with [dynamics] have p inputs: w, dhat
    and u are n p numbers.  ``exosystem`` (12) has no input but a zero one; ``observer`` (13) of
    one agent has the inputs x_i and v_i = couplings + u_i and the output dhat_i; both are None
    without an exosystem, and the observer where [dynamics] has an f, which no StateSpace holds.
    Where y = H x is measured, z are the estimates (xhat, xihat), m + q numbers for each agent,
    and y_i takes the place of x_i in ``observer``.  The m numbers of a leader are states, too,
    after the others.  On a processor, and of agents that move in steps, all of them are systems
    from sample to sample, and d and dhat means over a period."""

    def __init__(
        self,
        loop: ClosedLoop,
        update: Callable[..., Array],
        output: Callable[..., Array],
        name: str,
        period: float = 0,
    ) -> None:
        n, m = loop.n, loop.m
        p, q = loop.output.shape
        agents = [*_names("x", n, m), *_names("xi", n, q), *_names("z", n, loop.q)]
        leader = _names("s", loop.rows // m - n, m)
        outputs = [*_names("x", n, m), *_names("dhat", n, p), *_names("u", n, p)]
        super().__init__(
            update,
            output,
            states=[*agents, *leader],
            inputs=_names("w", n, p),
            outputs=outputs,
            name=name,
            dt=period,
        )
        self.loop = loop
        self.exosystem = None
        self.observer = None
        if loop.q > 0:
            self.exosystem = exosystem_of(loop, period)
            if period or loop.bend is None:
                self.observer = observer_of(loop, period)

    def start_of(self, trajectory: Trajectory, xhat: ArrayLike | None = None) -> Array:
        """The state at which a trajectory begins: x, xi and z = xihat - W x at its first sample.
        ``xhat`` (n, m): the estimated states where outputs are measured, which no trajectory has;
        default x."""
        x, xi = trajectory.x[0], trajectory.xi[0]
        z = trajectory.xihat[0]
        if self.loop.sensed is None:
            z = z - x @ self.loop.W.T
        else:
            z = np.hstack([x if xhat is None else np.asarray(xhat), z])
        s = trajectory.leader[0] if self.loop.lead else ()
        return _flat(x, xi, z, s)


def to_control(
    problem: Problem,
    *,
    mode: str | None,
    signal: Scheduled | None,
    seed: int,
    gain: Gain | None,
    period: float = 0,
) -> ConsensusLoop:
    """Build the loop in one mode (the first, or ``mode``), or under a switching ``signal`` up to
    the problem's t_final.

    ``seed`` draws the switches as ``simulate`` does; python-control's integrators do not stop at
    them, so a switched response is less accurate than a trajectory.  ``gain`` (q, m) takes the
    place of problem.observer.W.  ``period`` (s): everything is computed at its multiples.
    Raises: SpecError for an unknown mode, or if there is an exosystem and no W.
    """
    problem.require("this")  # one exosystem
    names = tuple(problem.network.modes)
    exact = errors_of(problem)
    loop = make_closed_loop(problem, gain)
    if loop.sensed is not None:
        loop = replace(loop, A=loop.sensed.pairs.A[loop.m :, loop.m :])
    signal = Fixed(mode=mode) if signal is None else signal
    switches = scheduled_switches(signal, names, float(problem.simulation.t_final), seed)
    # Networks of modes that never are on need not be built.
    used = np.unique(switches.modes).tolist()
    networks = {number: network_of(loop, error_arcs(exact, names[number])) for number in used}

    def active_at(time: float) -> Active:
        return Active(names, switches.at(np.array([time])))

    return _system(problem, loop, networks, active_at, period)


def _system(
    problem: Problem,
    loop: ClosedLoop,
    networks: Mapping[int, Network],
    active_at: Callable[[float], Active],
    period: float,
) -> ConsensusLoop:
    C, Ad, F = loop.output, loop.A, loop.F
    if period:
        C = discretised(loop, period).Cd
        Ad = transition(loop, period)
        F = Ad - period * loop.W @ C
    sensed = loop.sensed
    size = loop.n * (loop.m + loop.output.shape[1] + loop.q)

    def errors(x: Array, z: Array, s: Array) -> Array:
        if sensed is not None and sensed.estimated:
            x = z @ sensed.x.T
        return np.asarray(x - loop.goal - (s if len(s) else 0.0))

    @np.errstate(all="ignore")  # trial steps far from the target overflow
    def update(time: float, state: Array, w: Array, params: Any) -> Array:
        x, xi, z = loop.split(state[:size])
        s = state[size:]
        e = errors(x, z, s)
        (mode,) = active_at(max(0.0, float(time))).modes.tolist()
        slopes = networks[mode](_flat(e, s))
        # The slopes of a leader, if there is one, come after those of the agents.
        felt, s_dot = np.split(slopes, [e.size])
        x_dot = felt.reshape(x.shape)
        if len(s):  # goals move with the leader
            x_dot = x_dot + s_dot
        xi_dot = xi @ loop.A.T
        if sensed is not None:
            eps = np.hstack([x, xi]) - z
            x_dot = x_dot + eps @ loop.C.T
            if sensed.estimated:
                x_dot = x_dot + eps @ (sensed.x @ F).T
            z_dot = np.hstack([x_dot, xi_dot]) - eps @ F.T
        else:
            xihat = z + applied(loop.W, x)
            x_dot = x_dot - xihat @ loop.C.T
            z_dot = xihat @ F.T - applied(loop.W, x_dot)
            x_dot = x_dot + xi @ loop.C.T
        if loop.plant is not None:
            w = (w.reshape(loop.n, -1) @ loop.plant.B.T).ravel()
        return _flat(_flat(x_dot) + w, xi_dot, z_dot, s_dot)

    @np.errstate(all="ignore")
    def step(time: float, state: Array, w: Array, params: Any) -> Array:
        x, xi, z = loop.split(state)
        (mode,) = active_at(max(0.0, float(time))).modes.tolist()
        xihat = z + x @ loop.W.T
        v = networks[mode](_flat(x - loop.goal)).reshape(x.shape) - xihat @ C.T
        z = xihat @ F.T - (x + period * v) @ loop.W.T
        x = x + period * (v + xi @ C.T + w.reshape(x.shape))
        return _flat(x, xi @ Ad.T, z)

    @np.errstate(all="ignore")
    def output(time: float, state: Array, w: Array, params: Any) -> Array:
        x, _, z = loop.split(state[:size])
        xihat = z + x @ loop.W.T if sensed is None else z[:, loop.of_xi]
        dhat = xihat @ C.T
        e = errors(x, z, state[size:])
        u = loop.control(e, dhat, active_at(max(0.0, float(time))))
        return _flat(x, dhat, u)

    name = "".join(c if c.isalnum() else "_" for c in problem.name)
    return ConsensusLoop(loop, step if period else update, output, name, period)


def exosystem_of(loop: ClosedLoop, period: float = 0) -> Any:
    """(12) of one agent as control.StateSpace: output d_i; the input is a dummy that does
    nothing."""
    p, q = loop.output.shape
    A = transition(loop, period) if period else loop.A
    C = discretised(loop, period).Cd if period else loop.output
    states = _names("xi", q, 1)
    outputs = _names("d", p, 1)
    # control.ss takes no system without an input.
    B, D = np.zeros((q, 1)), np.zeros((p, 1))
    names = {"states": states, "inputs": ["none"], "outputs": outputs}
    return control.ss(A, B, C, D, period, name="exosystem", **names)


def observer_of(loop: ClosedLoop, period: float = 0) -> Any:
    """(13) of one agent as control.StateSpace: inputs x_i and v_i = couplings + u_i, output
    dhat_i; from sample to sample z+ = F (z + W x) - W (x + T v), F = Ad - T W Cd."""
    C, W = loop.output, loop.W
    p = len(C)
    F = loop.F
    seen = "x"
    # z = xihat - W x takes the place of the estimate: no derivative of x is needed.
    by_x, by_v = F @ W, -W
    if loop.sensed is not None:
        seen, C, W = "y", loop.sensed.d, 0 * loop.sensed.pairs.W
        by_x, by_v = loop.sensed.pairs.W, loop.sensed.B
    elif period:
        C = discretised(loop, period).Cd
        F = transition(loop, period) - period * W @ C
        by_x, by_v = F @ W - W, -period * W
    elif loop.plant is not None:
        by_x = by_x - W @ loop.plant.A
        by_v = by_v @ loop.plant.B
    B = np.hstack([by_x, by_v])
    D = np.hstack([C @ W, np.zeros((p, p))])
    inputs = _names(seen, by_x.shape[1], 1) + _names("v", p, 1)
    names = {"states": _names("z", loop.q, 1), "inputs": inputs, "outputs": _names("dhat", p, 1)}
    return control.ss(F, B, C, D, period, name="observer", **names)


def _flat(*parts: ArrayLike) -> Array:
    """The numbers of all these parts, one after the other."""
    return np.concatenate([np.ravel(each) for each in parts])


def _names(letter: str, n: int, width: int) -> list[str]:
    """Signals agent by agent, counted from 1: x[3], or x[3,2] with several components."""
    places = [f"{i + 1}" for i in range(n)]
    if width != 1:
        places = [f"{i},{c + 1}" for i in places for c in range(width)]
    return [f"{letter}[{place}]" for place in places]
