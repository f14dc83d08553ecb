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
from dobc_design.export.c_text import template
from dobc_design.problem.arrays import Gain, arc_groups, exosystem_arrays, goals, pinning_matrix, required_gain
from dobc_design.problem.problem import Problem

MOST_ARCS = 20_000  # of all modes: a file of a few MB


def python_script(problem: Problem, *, gain: Any = None) -> str:
    """The text of the file.  ``gain`` (q, m) takes the place of problem.observer.W.

    Raises: SpecError for a network of more than 20 000 arcs, or if there is an exosystem and no W.
    """
    arcs = sum(len(each) for each in problem.network.modes.values())
    if arcs > MOST_ARCS:
        message = f"a Python file holds at most {MOST_ARCS} arcs; the problem has {arcs}."
        cure = "Use dobc_design.to_control(problem) in Python: it needs no file."
        raise SpecError(message, key="--python-control", cure=cure)
    # The functions of couplings come from NumPy; min and max of several have definitions of their own.
    plain = sorted(["pi", *(row.name for row in FUNCTIONS.values() if not row.numpy)])
    renamed = [row for row in FUNCTIONS.values() if row.numpy and row.name not in ("min", "max")]
    imports = [f"from numpy import {', '.join(plain)}", *(f"from numpy import {r.numpy} as {r.name}" for r in renamed)]
    couplings = list(problem.couplings)
    return template("loop.py.j2").render(
        title=_inside_docstring(problem.name),
        mode=_inside_docstring(next(iter(problem.network.modes))),
        imports="\n".join(imports),
        couplings="".join(_function(number, each) for number, each in enumerate(couplings)),
        numbers=_numbers(problem, gain),
        arcs=_arcs(problem, couplings),
    )


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
