"""The matrices of a problem, with those of its certificate, by name: exact, in NumPy, in SymPy, in LaTeX, for MATLAB.

    A, C, W, P, Q   exosystem, observer gain, Lyapunov matrix, P W       K   pinning gains, (n m, n m)
    L   Laplacian of the weights, (n, n)      Lambda   J + J' - (K + K') at the consensus, where slopes are rational
    xbar   the target, (m, 1)

With several modes L and Lambda stand once for each, as L_MODE and Lambda_MODE.  In a MATLAB file numbers are doubles;
arcs with a coupling of their own have no place in a Laplacian and are refused there.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design._show.text import latex_matrix, latex_text
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.coupling.coupling import Coupling
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.arrays import exosystem_arrays, goals
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem

MOST_ROWS = 500  # of a dense matrix
_LATEX_NAMES = {"xbar": r"\bar{x}", "Lambda": r"\Lambda"}


def exact_matrices(
    problem: Problem, *, W: Matrix | None = None, P: Matrix | None = None, Q: Matrix | None = None
) -> dict[str, Matrix]:
    """All matrices by name, as rationals; W, P and Q are those of the problem or certificate, where there are any.

    Raises: SpecError for more than 500 rows.
    """
    n, m = problem.n, problem.m
    if n * m > MOST_ROWS:
        message = f"dense matrices are written for at most {MOST_ROWS} rows; this problem has {n * m}."
        raise SpecError(message, key="problem", cure="model.arrays has them as SciPy sparse matrices.")
    found: dict[str, Matrix] = {}
    exosystem = problem.joint_exosystem  # of several groups: block diagonal, as in certificates
    if exosystem is not None:
        found |= {"A": exosystem.A, "C": exosystem.C}
    found |= {name: each for name, each in (("W", W), ("P", P), ("Q", Q)) if each is not None}
    found["K"] = _pins(problem)
    found["xbar"] = tuple((x,) for x in problem.target)
    for mode, arcs in problem.network.modes.items():
        found[_of_mode("L", mode, problem)] = _laplacian(arcs, n)
    for mode, pencil in state_theorems(problem).lambdas.items():
        if isinstance(pencil.constant, SparseSymmetric) and not pencil.deviations:
            found[_of_mode("Lambda", mode, problem)] = pencil.constant.to_dense()
    return found


def numpy_matrices(found: Mapping[str, Matrix]) -> dict[str, NDArray[np.float64]]:
    """The same as float64 arrays."""
    return {name: to_float(each) for name, each in found.items()}


def sympy_matrices(found: Mapping[str, Matrix], problem: Problem) -> dict[str, Any]:
    """The same as SymPy matrices of rationals, and the default coupling "h" as a column in y, or y1 to ym."""
    import sympy

    from dobc_design.model.symbolic import to_sympy

    def rational(value: Fraction) -> Any:
        return sympy.Rational(value.numerator, value.denominator)

    result: dict[str, Any] = {
        name: sympy.Matrix([[rational(x) for x in row] for row in each]) for name, each in found.items()
    }
    result["h"] = sympy.Matrix([to_sympy(each)[0] for each in problem.coupling.components])
    return result


def latex_of(found: Mapping[str, Matrix], problem: Problem) -> str:
    """h and the matrices as displayed LaTeX equations, one after the other; above 12 rows only their size.

    Rationals of more than 12 digits are rounded to four.
    """
    lines = [_coupling(problem.coupling)]
    for name, each in found.items():
        head, _, mode = name.partition("_")
        shown = _LATEX_NAMES.get(head, head) + (rf"_{{{latex_text(mode)}}}" if mode else "")
        entries = latex_matrix(each)
        size = rf" \in \mathbb{{R}}^{{{len(each)} \times {len(each[0])}}}"
        lines.append(shown + (size if entries is None else f" = {entries}"))
    return "\n".join(f"\\[ {line} \\]" for line in lines) + "\n"


def _coupling(coupling: Coupling) -> str:
    if coupling.by_component:
        return f"h(y) = {coupling.latex[0]}"
    return r"h(y) = \begin{pmatrix} " + r" \\ ".join(coupling.latex) + r" \end{pmatrix}"


def _of_mode(name: str, mode: str, problem: Problem) -> str:
    return name if len(problem.network.modes) == 1 else f"{name}_{mode}"


def _pins(problem: Problem) -> Matrix:
    m = problem.m
    rows = [[Fraction(0)] * (problem.n * m) for _ in range(problem.n * m)]
    for agent, gain in problem.pinning.gains.items():
        for c in range(m):
            for d in range(m):
                rows[agent * m + c][agent * m + d] = gain[c][d]
    return tuple(map(tuple, rows))


def _laplacian(arcs: Arcs, n: int) -> Matrix:
    rows = [[Fraction(0)] * n for _ in range(n)]
    for listener, speaker, weight in arcs:
        rows[listener][speaker] -= weight
        rows[listener][listener] += weight
    return tuple(map(tuple, rows))


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
        message = f"L is written for at most {MOST_AGENTS} agents; the problem has {problem.n}."
        raise SpecError(message, key="to_mat", cure="Write the problem file instead.")
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
