"""The flow of a loop: its error system over a horizon as CasADi functions, with gradients."""

from typing import Any

import casadi as ca
import numpy as np

from dobc_design._checks import noun
from dobc_design.loop.arrays import Gain, disturbance_arrays
from dobc_design.loop.loop import Loop
from dobc_design.loop.matrices import Array, pull_matrix

from .couplings import constant, felt_errors, function


@noun(eq=False)
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
    loop: Loop,
    mode: str,
    *,
    horizon: float,
    steps: int,
    gain: Gain | None = None,
) -> Flow:
    """The flow of one mode of a loop without a leader, with W = ``gain`` (q, m).  Raises:
    SpecError."""
    rows = loop.size
    size = rows + loop.n * loop.q
    state = ca.SX.sym("state", size)
    slopes = _slopes(loop, mode, gain, state)
    nothing = ca.SX.sym("nothing", 0)  # the parameters that simpleRK wants
    dynamics = ca.Function("slope", [state, nothing], [slopes])
    # A fixed number of steps, so that the end is a smooth function of the start.
    runge_kutta = ca.simpleRK(dynamics, steps)
    start = ca.MX.sym("start", size)
    weight = ca.MX.sym("weight", size)
    end = runge_kutta(start, [], horizon)
    # True: the transposed Jacobian, in one sweep back through the steps.
    gradient = ca.jtimes(end, start, weight, True)
    to_end = function("end", {"start": start}, {"end": end})
    inputs = {"start": start, "weight": weight}
    back = function("pull", inputs, {"end": end, "gradient": gradient})
    return Flow(rows=rows, size=size, end_function=to_end, pull_function=back)


def _slopes(loop: Loop, mode: str, gain: Gain | None, state: Any) -> Any:
    """e' and eps' of (22) where [e; eps] is ``state``."""
    residual = disturbance_arrays(loop, gain)
    e = state[: loop.size]
    eps = ca.reshape(state[loop.size :], loop.q, loop.n)  # a column for every node
    unknown = ca.vec(ca.DM(residual.C) @ eps)
    pulled = constant(pull_matrix(loop)) @ e
    e_dot = felt_errors(loop, mode).h(e) - pulled + unknown
    eps_dot = ca.vec(ca.DM(residual.F) @ eps)
    return ca.densify(ca.vertcat(e_dot, eps_dot))
