"""The closed loop as a Python file of its own, which needs NumPy and python-control and nothing of this package.

Numbers are floats in their shortest exact form, couplings the text of the problem, which is Python once its functions
are named.  Text of users appears in strings only.  The same problem gives the same text.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.errors import SpecError
from dobc_design.problem.arrays import Gain, arc_groups, exosystem_arrays, goals, pinning_matrix, required_gain
from dobc_design.problem.problem import Problem

MOST_ARCS = 20_000  # of all modes: a file of a few MB

HEAD = '''\
"""{title}: closed loop (1), (12), (13), (19) as python-control objects.

    system = make_system("{mode}")
    response = control.input_output_response(system, times, 0, start(x0, xi0))

States: x, xi, z agent by agent; inputs: a disturbance besides d; outputs: x, dhat and u.
Written by dobc_design; needs NumPy and python-control only.
"""

import functools

import control
import numpy as np
{imports}


def min(*values):
    return functools.reduce(np.minimum, values)


def max(*values):
    return functools.reduce(np.maximum, values)

'''

BODY = '''\


def felt(mode, e):
    """h(e) of (9); e has the shape (n, m)."""
    total = np.zeros_like(e)
    for h, listeners, speakers, weights in ARCS[mode]:
        np.add.at(total, listeners, weights[:, None] * h(e[speakers] - e[listeners]))
    return total


def control_law(e, dhat):
    """u of (19)."""
    return -(K @ e[..., None])[..., 0] - dhat


def derivative(mode, state, w):
    """x', xi' and z' of the flat state; w (n m) acts besides d."""
    x, xi, z = cut(state)
    e, xihat = x - GOALS, z + x @ W.T
    v = felt(mode, e) + control_law(e, xihat @ C.T)
    z_dot = xihat @ (A - W @ C).T - v @ W.T
    return np.concatenate([(v + xi @ C.T).ravel() + w, (xi @ A.T).ravel(), z_dot.ravel()])


def outputs(state):
    x, _, z = cut(state)
    dhat = (z + x @ W.T) @ C.T
    return np.concatenate([x.ravel(), dhat.ravel(), control_law(x - GOALS, dhat).ravel()])


def cut(state):
    """x (n, m), xi and z (n, q) of a flat state."""
    return (
        state[: N * M].reshape(N, M), state[N * M : N * M + N * Q].reshape(N, Q), state[N * M + N * Q :].reshape(N, Q)
    )


def start(x, xi=None, xihat=0.0):
    """The flat state for x (n, m), xi (n, q) and the estimate xihat."""
    x = np.asarray(x, dtype=float).reshape(N, M)
    xi = np.zeros((N, Q)) if xi is None else np.asarray(xi, dtype=float).reshape(N, Q)
    return np.concatenate([x.ravel(), xi.ravel(), (xihat - x @ W.T).ravel()])


def make_system(mode):
    """The closed loop in one mode: control.NonlinearIOSystem."""
    return control.NonlinearIOSystem(
        lambda t, state, w, params: derivative(mode, state, w), lambda t, state, w, params: outputs(state),
        states=N * (M + 2 * Q), inputs=N * M, outputs=3 * N * M, dt=0, name="loop",
    )


def make_exosystem():
    """(12) of one agent: output d; its input does nothing."""
    return control.ss(A, np.zeros((Q, 1)), C, np.zeros((M, 1)))


def make_observer():
    """(13) of one agent: inputs x and v = couplings + u, output dhat."""
    F = A - W @ C
    return control.ss(F, np.hstack([F @ W, -W]), C, np.hstack([C @ W, np.zeros((M, M))]))
'''


def python_script(problem: Problem, *, gain: Any = None) -> str:
    """The text of the file.  ``gain`` (q, m) takes the place of problem.observer.W.

    Raises: SpecError for a network of more than 20 000 arcs, or if there is an exosystem and no W.
    """
    arcs = sum(len(each) for each in problem.network.modes.values())
    if arcs > MOST_ARCS:
        message = f"a Python file holds at most {MOST_ARCS} arcs; the problem has {arcs}."
        cure = "Use dobc_design.to_control(problem) in Python: it needs no file."
        raise SpecError(message, key="--python-control", cure=cure)
    mode = next(iter(problem.network.modes))
    title = _inside_docstring(problem.name)
    text = HEAD.replace("{title}", title).replace("{mode}", _inside_docstring(mode)).replace("{imports}", _imports())
    couplings = list(problem.couplings)
    text += "".join(_function(number, each) for number, each in enumerate(couplings))
    return text + _numbers(problem, gain) + _arcs(problem, couplings) + BODY


def _imports() -> str:
    """The functions of couplings, from NumPy; min and max of several have definitions of their own."""
    plain = sorted(["pi", *(row.name for row in FUNCTIONS.values() if not row.numpy)])
    renamed = [row for row in FUNCTIONS.values() if row.numpy and row.name not in ("min", "max")]
    lines = [f"from numpy import {row.numpy} as {row.name}" for row in renamed]
    return "\n".join([f"from numpy import {', '.join(plain)}", *lines])


def _function(number: int, coupling: Coupling) -> str:
    """h of (9) on differences y (arcs, m)."""
    head = f"\n\ndef h{number}(y):\n"
    if coupling.by_component:
        return f"{head}    return {coupling.components[0]} + 0 * y\n"
    m = len(coupling.components)
    names = ", ".join(f"y{c + 1}" for c in range(m))
    parts = ", ".join(f"{each} + 0 * y1" for each in coupling.components)
    return f"{head}    {names}{',' if m == 1 else ''} = y.T\n    return np.stack([{parts}], axis=1)\n"


def _numbers(problem: Problem, gain: Gain | None) -> str:
    A, C = exosystem_arrays(problem)
    n, m, q = problem.n, problem.m, problem.q
    K = pinning_matrix(problem).tocoo()
    lines = [f"\n\nN, M, Q = {n}, {m}, {q}", f"LABELS = {list(problem.network.labels)!r}"]
    for name, array in (("A", A), ("C", C), ("W", required_gain(problem, gain)), ("GOALS", goals(problem))):
        lines.append(f"{name} = np.array({array.tolist()!r}, dtype=float).reshape{array.shape}")
    lines.append(f"K = np.zeros(({n}, {m}, {m}))  # 1/s, one matrix per agent")
    entries = zip(K.row.tolist(), K.col.tolist(), K.data.tolist(), strict=True)
    lines += [f"K[{row // m}, {row % m}, {column % m}] = {value!r}" for row, column, value in entries]
    return "\n".join(lines) + "\n"


def _arcs(problem: Problem, couplings: list[Coupling]) -> str:
    """By mode and coupling: listeners, speakers and weights."""
    lines = ["ARCS = {  # mode: (coupling, listeners, speakers, weights)"]
    for mode in problem.network.modes:
        lines.append(f"    {mode!r}: [")
        for group in arc_groups(problem, mode):
            weights = np.asarray(group.weights).tolist()
            lines.append(
                f"        (h{couplings.index(group.coupling)}, np.array({group.listeners.tolist()}),"
                f" np.array({group.speakers.tolist()}), np.array({weights})),"
            )
        lines.append("    ],")
    return "\n".join([*lines, "}", ""])


def _inside_docstring(text: str) -> str:
    """User text that cannot end the docstring it stands in."""
    return ascii(text)[1:-1].replace('"', "'").replace("\\", "/")
