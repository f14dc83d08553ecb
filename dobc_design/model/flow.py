"""Where a start is after some time, and the derivatives of that by the start: RK4 with fixed steps in CasADi.

For searches that follow a gradient.  Steps are not controlled, so what comes out illustrates and proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from dobc_design.model.model import build_model
from dobc_design.problem.arrays import Array, Gain
from dobc_design.problem.problem import Problem


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
