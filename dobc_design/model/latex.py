r"""The model's equations as LaTeX mathematics, for reports: couplings, (1), (12), (13), (19), (22) and the data.

Only formatting.  Agents' labels are the user's text: they are escaped and stand in \text{}.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dobc_design._render import latex_matrix, latex_number, latex_text
from dobc_design.exact.matrix import Matrix
from dobc_design.model.arrays import Gain, chosen_gain
from dobc_design.spec.coupling import Coupling
from dobc_design.spec.problem import Problem

MAX_ARCS = 6
MAX_EXCEPTIONS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Equations:
    """LaTeX of the equations, without dollar signs; None where the problem has no such equation.

    ``couplings`` has one line per coupling shown, exceptions after the default; ``agents`` is (1),
    ``exosystem`` (12), ``observer`` (13), ``control`` (19), ``errors`` (22); ``data`` the target and A, C, W.
    """

    couplings: tuple[str, ...]
    agents: str
    exosystem: str | None
    observer: tuple[str, ...]
    control: str
    errors: tuple[str, ...]
    data: tuple[str, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """All of them, in the order of the paper."""
        exosystem = () if self.exosystem is None else (self.exosystem,)
        model = (*self.couplings, self.agents, *exosystem, *self.observer, self.control)
        return (*model, *self.errors, *self.data)

    def _repr_latex_(self) -> str:
        return "$$\\begin{gathered}\n" + " \\\\\n".join(self.lines) + "\n\\end{gathered}$$"


def latex(problem: Problem, *, gain: Gain | None = None) -> Equations:
    """Write the equations of the problem as LaTeX; ``gain`` takes the place of problem.observer.W.

    Raises: SpecError or ShapeError for a gain that does not fit.
    """
    W = chosen_gain(problem, gain)
    disturbed = problem.exosystem is not None
    felt = _felt(problem)
    pull = rf"k_i \left(x_i - {_goal(problem)}\right)"
    errors = [r"\dot{e} = h(e) - K e" + (r" + (I_n \otimes C)\, \varepsilon" if disturbed else "")]
    if disturbed:
        errors.append(r"\dot{\varepsilon} = \left(I_n \otimes (A - W C)\right) \varepsilon")
    return Equations(
        couplings=_couplings(problem),
        agents=rf"\dot{{x}}_i = {felt} + u_i{' + d_i' if disturbed else ''}",
        exosystem=r"\dot{\xi}_i = A \xi_i, \quad d_i = C \xi_i" if disturbed else None,
        observer=_observer(felt) if disturbed else (),
        control=rf"u_i = -{pull} - \hat{{d}}_i" if disturbed else f"u_i = -{pull}",
        errors=tuple(errors),
        data=_data(problem, W),
    )


def _observer(felt: str) -> tuple[str, ...]:
    return (
        rf"\dot{{z}}_i = (A - W C)(z_i + W x_i) - W \left({felt} + u_i\right)",
        r"\hat{\xi}_i = z_i + W x_i, \quad \hat{d}_i = C \hat{\xi}_i",
    )


def _felt(problem: Problem) -> str:
    """The coupling sum of (1), with weights and offsets where there are any."""
    weighted = any(weight != 1 for arcs in problem.network.modes.values() for weight in set(arcs.weights))
    name = "h_{ij}" if problem.exceptions else "h"
    difference = "(x_j - r_j) - (x_i - r_i)" if problem.offsets else "x_j - x_i"
    neighbours = "N_i" if len(problem.network.modes) == 1 else "N_i(t)"
    weight = r"w_{ij}\, " if weighted else ""
    return rf"\sum_{{j \in {neighbours}}} {weight}{name}\left({difference}\right)"


def _goal(problem: Problem) -> str:
    return r"\bar{x} - r_i" if problem.offsets else r"\bar{x}"


def _couplings(problem: Problem) -> tuple[str, ...]:
    if not problem.exceptions:
        return (f"h(y) = {_value(problem.coupling)}",)
    arcs: dict[Coupling, list[tuple[int, int]]] = {}
    for arc, coupling in problem.exceptions.items():
        arcs.setdefault(coupling, []).append(arc)
    lines = [rf"h_{{ij}}(y) = {_value(problem.coupling)} \quad \text{{unless stated}}"]
    for coupling, pairs in list(arcs.items())[:MAX_EXCEPTIONS]:
        named = [f"({', '.join(latex_text(problem.network.labels[end]) for end in pair)})" for pair in pairs[:MAX_ARCS]]
        if len(pairs) > MAX_ARCS:
            named.append(r"\ldots")
        lines.append(rf"h_{{ij}}(y) = {_value(coupling)} \quad (i, j) \in \{{{', '.join(named)}\}}")
    if len(arcs) > MAX_EXCEPTIONS:
        lines.append(r"\ldots")
    return tuple(lines)


def _value(coupling: Coupling) -> str:
    r"""h(y): one formula, or a column; by component for m > 1, y stands for each component."""
    if len(coupling.latex) > 1:
        rows = r" \\ ".join(coupling.latex)
        return rf"\begin{{pmatrix}} {rows} \end{{pmatrix}}"
    suffix = r" \quad \text{in every component}" if coupling.dimension > 1 else ""
    return coupling.latex[0] + suffix


def _data(problem: Problem, W: Matrix | None) -> tuple[str, ...]:
    target = latex_number(problem.target[0]) if problem.m == 1 else latex_matrix(tuple((x,) for x in problem.target))
    exosystem = problem.exosystem
    matrices: Mapping[str, Matrix | None] = {
        "A": None if exosystem is None else exosystem.A,
        "C": None if exosystem is None else exosystem.C,
        "W": W,
    }
    shown = {name: latex_matrix(M) for name, M in matrices.items() if M is not None}
    lines = [(r"\bar{x}", target), *shown.items()]
    return tuple(f"{name} = {value}" for name, value in lines if value is not None)
