"""The problem as objects of other libraries: diagnostics, CasADi functions, python-control.  Nothing is proved here."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.errors import SpecError
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.export.python_control import ConsensusLoop
    from dobc_design.model.model import Model


def analyse(problem: Problem | str | PathLike[str]) -> Analysis:
    """Compute the diagnostics shown beside a certificate: spectra, margins, graph facts.  Never a proof.

    Returns: an Analysis.  Raises: SpecError for a wrong problem.
    Example:
        >>> dd.analyse("clock-sync").observability.rank
        1
    """
    from dobc_design.analysis.analysis import analyse as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, gain=observer_gain(problem))


def build_model(problem: Problem | str | PathLike[str], *, mode: str | None = None) -> Model:
    """Build the CasADi functions of the problem: h, its Jacobian, observer, controller, closed loop.

    A missing W is designed first, as ``certify`` does.  ``mode`` defaults to the first.
    Returns: a Model.  Raises: SpecError for an unknown mode.
    Example:
        >>> dd.build_model("clock-sync").jacobian([0] * 10).shape
        (10, 10)
    """
    from dobc_design.model.model import build_model as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, mode, gain=observer_gain(problem))


def to_control(
    problem: Problem | str | PathLike[str], *, mode: str | None = None, signal: Any = None, seed: int | None = None
) -> ConsensusLoop:
    """The closed loop as a control.NonlinearIOSystem, whose response reproduces the trajectory of ``simulate``.

    ``exosystem`` and ``observer`` of the result are control.StateSpace of one agent; ``start_of(trajectory)`` is the
    initial state.  Modes as in ``simulate``: ``mode``, a ``signal`` that does not depend on the states, else the
    problem's [switching], up to its t_final; ``seed`` draws the switches.  A missing W is designed first.
    Returns: a ConsensusLoop.  Raises: SpecError.
    """
    from dobc_design.export.python_control import to_control as run
    from dobc_design.simulation.mobile import Mobile
    from dobc_design.simulation.signal_files import signal_of

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    if signal is None and mode is None:
        signal = signal_of(problem)[0]
    if isinstance(signal, Mobile):
        raise SpecError(
            "signal must not depend on the states, because python-control keeps no graph between calls.",
            key="signal",
            cure="Give a mode, or another signal.",
        )
    settings = problem.simulation
    return run(
        problem,
        mode=mode,
        signal=signal,
        horizon=float(settings.horizon),
        seed=settings.seed if seed is None else seed,
        gain=observer_gain(problem),
    )


def python_script(problem: Problem | str | PathLike[str]) -> str:
    """The closed loop as the text of a Python file that needs NumPy and python-control only.  Raises: SpecError."""
    from dobc_design.export.python_script import python_script as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    return run(problem, gain=observer_gain(problem))
