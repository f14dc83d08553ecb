"""In from other programs, out to other programs and to targets: one function for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import Claims
from dobc_design.conditions.observer.propose import observer_gain, with_observer
from dobc_design.coupling.expression import formula_text
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.errors import refused, wrong
from dobc_design.exact.matrix import Matrix, to_float
from dobc_design.exact.reading import Document, one_of
from dobc_design.loop import arrays
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .c_text import template

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.model.model import Model

    from .c_folder import CCode
    from .fmu import Fmu
    from .python_control import ConsensusLoop

MOST_ARCS = 20_000  # of all modes in a Python file: a few MB


def to_c(
    problem: Source,
    *,
    period: Any = None,
    precision: str = "double",
    agents: Sequence[Any] | str | int | None = None,
    certificate: Certificate | Claims | None = None,
    sampled_gain: Any = None,
) -> CCode:
    """C99 of the sampled observer and controller, with a self-test; ``save(folder)`` writes it.

    ``period`` in s, not needed where the problem has a [processor]: the code is then its recursion,
    with a function for packets of a known age; ``precision`` "double" or "float"; ``agents``:
    labels, or one; default all (at most 200), of one group where they have different exosystems;
    ``certificate``: its check ``sampling`` is compared with the period; ``sampled_gain`` (q, m) in
    place of the discretised W, as ``design_observer(period=...)`` gives it.  A missing W is
    designed first, as ``certify`` does.
    Returns: a CCode.  Raises: SpecError for a certificate of another problem, and for a period at
    which the sampled loop diverges; it then names one that works.
    Example:
        >>> code = dd.export.to_c("clock-sync", period="1/4", agents=["gateway"])
        >>> "dobc_agent.c" in code.files, code.tolerance < 1e-9
        (True, True)
    """
    from .c_controller import certified_sampling
    from .c_folder import Recorder, c_code

    problem = _loaded(problem)
    problem.require("C code")
    claims = certificate.claims if isinstance(certificate, Certificate) else certificate
    # Its period would be that of another loop.
    if claims is not None and claims.problem_sha256 != problem_sha256(problem):
        raise refused(
            "certificate",
            "certificate must be one of this problem; it is about another one.",
            "Certify this problem.",
        )
    gain = observer_gain(loop_of(problem)) if claims is None else claims.W
    recorder = Recorder(problem, gain=gain, sampled_gain=sampled_gain)
    wanted = [agents] if isinstance(agents, (str, int)) else agents
    controller = recorder.controller(period, agents=wanted, precision=precision)
    certified = None if claims is None else certified_sampling(problem, claims, controller.period)
    return c_code(recorder.recorded(controller), certified=certified)


def to_fmu(
    problem: Source, *, period: Any = None, agent: Any = None, sampled_gain: Any = None
) -> Fmu:
    """One agent's sampled controller as an FMU (FMI 3.0, co-simulation); ``save(path)`` writes it.

    ``agent``: its label; default the first pinned one; ``period`` and ``sampled_gain`` as in
    ``to_c``.  Inputs: mode, x, heard[LABEL]; outputs: u, v, dhat and the packet y.
    Returns: an Fmu.  Raises: as ``to_c``; SolverError if the C compiler refuses.
    """
    from .c_folder import Recorder
    from .fmu import make_fmu

    problem = _loaded(problem)
    problem.require("an FMU")
    if agent is None:
        # A pinned agent has everything that the code can do.
        pinned = problem.pinning.agents
        agent = problem.network.labels[pinned[0] if pinned else 0]
    gain = observer_gain(loop_of(problem))
    recorder = Recorder(problem, gain=gain, sampled_gain=sampled_gain)
    return make_fmu(recorder.controller(period, agents=[str(agent)]))


def to_sdpa(problem: Source) -> str:
    """The matrix inequality of Lemma 1, Theorem 1 or 2 in SDPA's sparse format, with P, Q and t as
    unknowns.

    t* < 0 if and only if the theorem holds, for bounds taken from a proved pair.
    Returns: the text.  Raises: SpecError.
    Example:
        >>> text = dd.export.to_sdpa("clock-sync")
        >>> lines = [line for line in text.splitlines() if not line.startswith('"')]
        >>> lines[0], lines[2]  # three unknowns: P, Q and t; Psi has ten rows for e and ten for eps
        ('3', '20 1 1 2')
    """
    from dobc_design.certification.certify import decide

    from .matrices import sdpa_text

    problem = _loaded(problem)
    problem.require("this")  # one exosystem
    problem.require("the matrix inequality in SDPA's format")
    found = decide(loop_of(problem), lambda stage: None)
    # What is written is the inequality of one of these.
    wanted = ("theorem1", "theorem2") if problem.exosystem is not None else ("lemma1",)
    verdicts = [check.verdict for check in found.checks if check.id in wanted]
    pair = None if found.pair is None else (found.pair.P, found.pair.Q)
    return sdpa_text(problem, pair=pair, verdict=Verdict.all_of(verdicts) if verdicts else None)


def to_casadi(problem: Source, function: str = "closed_loop", *, mode: str | None = None) -> Any:
    """One of the problem's casadi.Function objects: h, jacobian, observer, controller, closed_loop,
    error_dynamics.

    ``function``: which of them; ``mode`` defaults to the first.  A missing W is designed first.
    Returns: a casadi.Function with named inputs and outputs.  Raises: SpecError.
    Example:
        >>> dd.export.to_casadi("paper-fixed", "observer").name_out()
        ['z_dot', 'xihat', 'dhat']
    """
    from dobc_design.model.model import build_model

    problem = _loaded(problem)
    model = build_model(problem, mode, gain=observer_gain(loop_of(problem)))
    found = {each.name(): each for each in model.functions}
    return found[one_of(function, found, "function")]


def to_numpy(source: Source | Certificate) -> Document:
    """The matrices of a problem, or of a certificate with its W, P and Q, as float64 arrays by
    name.

    Returns: A, C, W, P, Q, K, xbar, L and Lambda; with several modes L_MODE and Lambda_MODE; with
    [dynamics] Ax and B.
    Raises: SpecError above 500 rows.
    Example:
        >>> dd.export.to_numpy("paper-fixed")["W"].tolist()
        [[3.2], [2.4]]
    """
    return {name: to_float(each) for name, each in _matrices(source)[0].items()}


def to_sympy(source: Source | Certificate) -> Document:
    """The matrices of ``to_numpy`` as SymPy matrices of exact rationals, and the coupling "h".

    Returns: matrices by name.  Raises: SpecError above 500 rows.
    Example:
        >>> matrices = dd.export.to_sympy("paper-fixed")
        >>> matrices["W"].T, matrices["h"]
        (Matrix([[16/5, 12/5]]), Matrix([[y + exp(y) - 1]]))
    """
    from .matrices import sympy_matrices

    return sympy_matrices(*_matrices(source))


def to_latex(source: Source | Certificate) -> str:
    """h and the matrices of ``to_numpy`` as displayed LaTeX equations.

    Returns: the text.  Raises: SpecError above 500 rows.
    """
    from .matrices import latex_of

    return latex_of(*_matrices(source))


def _matrices(source: Source | Certificate) -> tuple[dict[str, Matrix], Problem]:
    from .matrices import exact_matrices

    if isinstance(source, Certificate):
        claims = source.claims
        return exact_matrices(source.problem, W=claims.W, P=claims.P, Q=claims.Q), source.problem
    problem = _loaded(source)
    own = problem.joint_observer
    return exact_matrices(problem, W=own.W, P=own.P), problem


def _loaded(problem: Source) -> Problem:
    problem = arrays.require_floats(load_problem(problem))
    problem.require("an export")
    return with_observer(problem)


def analyse(problem: Source) -> Analysis:
    """Compute the diagnostics shown beside a certificate: spectra, margins, graph facts.  Never a
    proof.

    Returns: an Analysis.  Raises: SpecError for a wrong problem.
    Example:
        >>> dd.analyse("clock-sync").observability.rank
        1
    """
    from dobc_design.analysis.analysis import analyse as run

    problem = arrays.require_floats(load_problem(problem))
    problem.require("a diagnosis")
    return run(problem, gain=observer_gain(loop_of(problem)))


def build_model(problem: Source, *, mode: str | None = None) -> Model:
    """Build the CasADi functions of the problem: h, its Jacobian, observer, controller, closed
    loop.

    A missing W is designed first, as ``certify`` does.  ``mode`` defaults to the first.
    Returns: a Model.  Raises: SpecError for an unknown mode.
    Example:
        >>> dd.build_model("clock-sync").jacobian([0] * 10).shape
        (10, 10)
    """
    from dobc_design.model.model import build_model as run

    problem = _loaded(problem)
    problem.require("the model")
    return run(problem, mode, gain=observer_gain(loop_of(problem)))


def to_control(
    problem: Source,
    *,
    mode: str | None = None,
    signal: Any = None,
    seed: int | None = None,
    sampled: bool | None = None,
) -> ConsensusLoop:
    """The closed loop as a control.NonlinearIOSystem, whose response reproduces the trajectory of
    ``simulate``.

    ``exosystem`` and ``observer`` of the result are control.StateSpace of one agent;
    ``start_of(trajectory)`` is the initial state.  Modes as in ``simulate``: ``mode``, a ``signal``
    that does not depend on the states, else the problem's [switching], up to its t_final; ``seed``
    draws the switches.  ``sampled``: the loop of a [processor] from sample to sample (dt is its
    period), or of agents that move in steps; False: that of (13), in continuous time; by default as
    the problem says.  A missing W is designed first.
    Returns: a ConsensusLoop.  Raises: SpecError.
    """
    from dobc_design.simulation.signals import Mobile, signal_of

    from .python_control import to_control as run

    problem = _loaded(problem)
    problem.require("the model of python-control")
    if signal is None and mode is None:
        signal = signal_of(problem)[0]
    if isinstance(signal, Mobile):
        raise refused(
            "signal",
            "signal must not depend on the states, because python-control keeps no graph "
            "between calls.",
            "Give a mode, or another signal.",
        )
    seed = problem.simulation.seed if seed is None else seed
    loop = loop_of(problem)
    period = 0.0
    if sampled or (sampled is None and loop.is_sampled):
        if loop.timing is None or not loop.is_sampled:
            raise wrong("sampled", "needs a [processor].", "Give it, with its period.")
        problem.require("the sampled model of python-control")
        period = float(loop.timing.period)
    elif problem.steps:
        raise wrong("sampled", "cannot be False: agents move in steps.", "Leave it out.")
    gain = observer_gain(loop)
    return run(problem, mode=mode, signal=signal, seed=seed, gain=gain, period=period)


def python_script(problem: Source) -> str:
    """The closed loop as the text of a Python file that needs NumPy and python-control only.
    Numbers are floats in their shortest exact form, couplings the text of the problem, which is
    Python once its functions are named; text of users appears in strings only.  Raises: SpecError
    for more than 20 000 arcs."""
    problem = _loaded(problem)
    problem.require("the Python file")
    loop = loop_of(problem)
    gain = observer_gain(loop)
    arcs = sum(len(each) for each in problem.network.modes.values())
    if arcs > MOST_ARCS:
        raise refused(
            "--python-control",
            f"a Python file holds at most {MOST_ARCS} arcs; the problem has {arcs}.",
            "Use dobc_design.to_control(problem) in Python: it needs no file.",
        )
    problem.require("this")  # one exosystem
    A, C = arrays.exosystem_arrays(loop)
    W = arrays.required_gain(loop, gain)
    named = {"A": A, "C": C, "W": W, "GOALS": arrays.goals(problem)}
    plant = arrays.plant_arrays(problem)
    if plant is not None:
        named |= {"C": plant.C, "B": plant.B, "U0": plant.u0, "AX": plant.A}
    own = problem.dynamics
    # Only the entries that are there: K of many agents is almost empty.
    K = arrays.pinning_matrix(problem).tocoo()
    return template("loop.py.j2").render(
        title=_inside_docstring(problem.name),
        mode=_inside_docstring(next(iter(problem.network.modes))),
        imports="\n".join(_imports()),
        problem=problem,
        plant=plant,
        nodes=() if own is None else own.f or (),
        named=named,
        gains=zip(K.row.tolist(), K.col.tolist(), K.data.tolist(), strict=True),
        arcs={repr(mode): arrays.plant_arcs(problem, mode) for mode in problem.network.modes},
    )


def _imports() -> list[str]:
    """What makes the text of couplings Python: their functions come from NumPy; min and max of
    several, and what it lacks, have definitions of their own."""
    plain, renamed, defined = ["pi"], [], []
    for row in FUNCTIONS.values():
        # min and max take several numbers, NumPy's minimum and maximum two.
        if row.numpy and row.name not in ("min", "max"):
            renamed.append(f"from numpy import {row.numpy} as {row.name}")
        elif not row.numpy and hasattr(np, row.name):
            plain.append(row.name)
        elif row.formula is not None:
            defined.append(f"\n\ndef {row.name}(y):\n    return {formula_text(row)}")
    return [f"from numpy import {', '.join(sorted(plain))}", *renamed, *defined]


def _inside_docstring(text: str) -> str:
    """User text that cannot end the docstring it stands in."""
    return ascii(text)[1:-1].replace('"', "'").replace("\\", "/")
