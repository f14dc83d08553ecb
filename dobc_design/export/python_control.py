"""The closed loop as python-control objects: a NonlinearIOSystem, and observer and exosystem as
StateSpace.

Paper: (1), (12), (13), (19).  Couplings are those of ``simulation.field``;
``control.input_output_response`` reproduces a simulated trajectory.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control
import numpy as np

from dobc_design.problem.arrays import Array, Gain, arc_groups
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.problem import Problem
from dobc_design.simulation.field import Loop, Network, applied, make_loop, network_of
from dobc_design.simulation.signals import Fixed, Scheduled
from dobc_design.simulation.switches import scheduled_switches
from dobc_design.simulation.trajectory import Trajectory


class ConsensusLoop(control.NonlinearIOSystem):  # type: ignore[misc]  # control is not typed
    """The closed loop of all agents.  States: x, xi, z, each agent by agent, n m + 2 n q of them.
    Inputs: a disturbance that acts besides d, n m, in units of x per s; 0 gives the loop as
    printed.  Outputs: x, dhat and u, n m each.  Agents with [dynamics] have p inputs: w, dhat and u
    are n p numbers.  ``exosystem`` (12) has no input but a zero one; ``observer`` (13) of one agent
    has the inputs x_i and v_i = couplings + u_i and the output dhat_i; both are None without an
    exosystem, and the observer where [dynamics] has an f, which no StateSpace holds.  The m numbers
    of a leader are states, too, after the others."""

    def __init__(
        self, loop: Loop, update: Callable[..., Array], output: Callable[..., Array], name: str
    ) -> None:
        n, m, q, p = loop.n, loop.m, loop.q, len(loop.output)
        states = [
            *_names("x", n, m),
            *_names("xi", n, q),
            *_names("z", n, q),
            *_names("s", loop.rows // m - n, m),
        ]
        outputs = [*_names("x", n, m), *_names("dhat", n, p), *_names("u", n, p)]
        super().__init__(
            update,
            output,
            states=states,
            inputs=_names("w", n, p),
            outputs=outputs,
            name=name,
            dt=0,
        )
        self.loop = loop
        self.exosystem = None if q == 0 else exosystem_of(loop)
        self.observer = None if q == 0 or loop.bend is not None else observer_of(loop)

    def start_of(self, trajectory: Trajectory) -> Array:
        """The state at which a trajectory begins: x, xi and z = xihat - W x at its first sample."""
        z = trajectory.xihat[0] - trajectory.x[0] @ self.loop.W.T
        s = trajectory.leader[0] if self.loop.lead else ()
        return np.concatenate([trajectory.x[0].ravel(), trajectory.xi[0].ravel(), z.ravel(), s])


def to_control(
    problem: Problem, *, mode: str | None, signal: Scheduled | None, seed: int, gain: Gain | None
) -> ConsensusLoop:
    """Build the loop in one mode (the first, or ``mode``), or under a switching ``signal`` up to
    the problem's t_final.

    ``seed`` draws the switches as ``simulate`` does; python-control's integrators do not stop at
    them, so a switched response is less accurate than a trajectory.  ``gain`` (q, m) takes the
    place of problem.observer.W.
    Raises: SpecError for an unknown mode, or if there is an exosystem and no W.
    """
    problem.require_one_exosystem()
    problem = as_integrators(problem)
    names, loop = tuple(problem.network.modes), make_loop(problem, gain)
    signal = Fixed(mode=mode) if signal is None else signal
    switches = scheduled_switches(signal, names, float(problem.simulation.t_final), seed)
    used = np.unique(switches.modes).tolist()
    networks = {number: network_of(loop, arc_groups(problem, names[number])) for number in used}
    return _system(problem, loop, lambda time: networks[int(switches.at(np.array([time]))[0])])


def _system(problem: Problem, loop: Loop, network_at: Callable[[float], Network]) -> ConsensusLoop:
    size = loop.n * (loop.m + 2 * loop.q)

    @np.errstate(all="ignore")  # trial steps far from the target overflow
    def update(time: float, state: Array, w: Array, params: Any) -> Array:
        (x, xi, z), s = loop.split(state[:size]), state[size:]
        xihat = z + applied(loop.W, x)
        e = (x - loop.goal - (s if len(s) else 0.0)).ravel()
        felt, s_dot = np.split(network_at(max(0.0, float(time)))(np.concatenate([e, s])), [len(e)])
        felt = (felt.reshape(x.shape) + (s_dot if len(s) else 0.0)).ravel() - (
            xihat @ loop.C.T
        ).ravel()
        z_dot = xihat @ loop.F.T - applied(loop.W, felt.reshape(x.shape))
        w = w if loop.plant is None else (w.reshape(loop.n, -1) @ loop.plant.B.T).ravel()
        return np.concatenate(
            [felt + (xi @ loop.C.T).ravel() + w, (xi @ loop.A.T).ravel(), z_dot.ravel(), s_dot]
        )

    @np.errstate(all="ignore")
    def output(time: float, state: Array, w: Array, params: Any) -> Array:
        (x, _, z), s = loop.split(state[:size]), state[size:]
        dhat = (z + x @ loop.W.T) @ loop.output.T
        e = x - loop.goal - (s if len(s) else 0.0)
        return np.concatenate([x.ravel(), dhat.ravel(), loop.control(e, dhat).ravel()])

    return ConsensusLoop(
        loop, update, output, "".join(c if c.isalnum() else "_" for c in problem.name)
    )


def exosystem_of(loop: Loop) -> Any:
    """(12) of one agent as control.StateSpace: output d_i; the input is a dummy that does
    nothing."""
    states, outputs = (
        [f"{letter}[{k + 1}]" for k in range(size)]
        for letter, size in (("xi", loop.q), ("d", len(loop.output)))
    )
    nothing = np.zeros((loop.q, 1)), np.zeros((len(loop.output), 1))
    names = {"name": "exosystem", "states": states, "inputs": ["none"], "outputs": outputs}
    return control.ss(loop.A, nothing[0], loop.output, nothing[1], **names)


def observer_of(loop: Loop) -> Any:
    """(13) of one agent as control.StateSpace: inputs x_i and v_i = couplings + u_i, output
    dhat_i."""
    F, m, C, p, plant = loop.A - loop.W @ loop.C, loop.m, loop.output, len(loop.output), loop.plant
    by_x, by_v = (
        (F @ loop.W, -loop.W)
        if plant is None
        else (F @ loop.W - loop.W @ plant.A, -loop.W @ plant.B)
    )
    B, D = np.hstack([by_x, by_v]), np.hstack([C @ loop.W, np.zeros((p, p))])
    inputs = [f"{name}[{c + 1}]" for name, width in (("x", m), ("v", p)) for c in range(width)]
    states, outputs = [f"z[{k + 1}]" for k in range(loop.q)], [f"dhat[{c + 1}]" for c in range(p)]
    return control.ss(F, B, C, D, name="observer", states=states, inputs=inputs, outputs=outputs)


def _names(letter: str, n: int, width: int) -> list[str]:
    """Signals agent by agent, counted from 1: x[3], or x[3,2] with several components."""
    endings = [f",{c + 1}" for c in range(width)] if width > 1 else [""] * width
    return [f"{letter}[{i + 1}{ending}]" for i in range(n) for ending in endings]
