"""A problem as a MATLAB file (.mat, version 5): the variables that ``importing.matlab`` reads.

Numbers become doubles, so a rational such as 1/3 is not exact there.  Arcs with a coupling of their own have no place
in a Laplacian and are refused.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.exact.matrix import to_float
from dobc_design.problem.arrays import exosystem_arrays, goals
from dobc_design.problem.problem import Problem

MOST_AGENTS = 2000  # L is dense


def mat_bytes(problem: Problem) -> bytes:
    """The bytes of a .mat file with A, C, L, W, P, k, xbar, offsets, h, labels, modes, name.

    Raises: SpecError for couplings of single arcs, and above 2000 agents.
    """
    from scipy.io import savemat

    if problem.exceptions:
        raise SpecError(
            "a .mat file has no place for arcs with a coupling of their own; this problem has"
            f" {len(problem.exceptions)}.",
            key="to_mat",
            cure="Write the problem file instead.",
        )
    if problem.n > MOST_AGENTS:
        raise SpecError(
            f"L is written for at most {MOST_AGENTS} agents; the problem has {problem.n}.",
            key="to_mat",
            cure="Write the problem file instead.",
        )
    stream = io.BytesIO()
    savemat(stream, _variables(problem), do_compression=True)
    return stream.getvalue()


def _variables(problem: Problem) -> dict[str, Any]:
    n, m = problem.n, problem.m
    layers = np.zeros((n, n, len(problem.network.modes)))
    for number, arcs in enumerate(problem.network.modes.values()):
        weights = to_float((arcs.weights,))[0]
        layers[arcs.listeners, arcs.speakers, number] = -weights
        layers[np.arange(n), np.arange(n), number] = np.bincount(arcs.listeners, weights=weights, minlength=n)
    gains = np.zeros((m, m, n))
    for agent, gain in problem.pinning.gains.items():
        gains[:, :, agent] = to_float(gain)
    target = to_float((problem.target,))
    found: dict[str, Any] = {
        "L": layers[:, :, 0] if layers.shape[2] == 1 else layers,
        "k": gains[0, 0][:, None] if problem.pinning.is_scalar and (m == 1 or n != 1) else gains,
        "xbar": target,
        "offsets": goals(problem) - target,
        "h": _cells(problem.coupling.texts),
        "labels": _cells(problem.network.labels),
        "modes": _cells(tuple(problem.network.modes)),
        "name": problem.name,
    }
    if problem.exosystem is not None:
        found["A"], found["C"] = exosystem_arrays(problem)
        for name, matrix in (("W", problem.observer.W), ("P", problem.observer.P)):
            if matrix is not None:
                found[name] = to_float(matrix)
    return found


def _cells(texts: tuple[str, ...]) -> Any:
    cells = np.empty((len(texts), 1), dtype=object)
    cells[:, 0] = texts
    return cells
