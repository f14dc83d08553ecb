"""Beside a certificate: starts that do not converge, and how far quadratic certificates can reach at most."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING

from dobc_design.certificate.certificate import Certificate
from dobc_design.spec.load import load_problem
from dobc_design.spec.problem import Problem
from dobc_design.workflow.certificates import observer_gain

if TYPE_CHECKING:
    from dobc_design.falsifying.levels import Certified
    from dobc_design.falsifying.suspect import Falsification
    from dobc_design.searching import Searched
    from dobc_design.theorems.duals import QuadraticDual

Progress = Callable[[str], None]


def falsify(
    problem: Problem | str | PathLike[str], *, runs: int = 500, seed: int | None = None, radius: float | None = None,
    disturbance: float | None = None, certified: Certificate | Certified | None = None,
    t_final: float | None = None, progress: Progress | None = None,
) -> Falsification:  # fmt: skip
    """Search for starts that do not converge, or that leave a certified set; and prove second equilibria.

    Starts: the region asked for; with ``radius`` the box |e|_inf <= radius; without both |e|_inf <= 1; with
    ``certified`` the boundary of a certified set: that of a certificate, of one of its checks, or of a claim of
    theorems.separable, theorems.lure or theorems.shell.  ``disturbance`` bounds |eps_i|.  ``runs`` starts are
    simulated: corners, edges, random ones, and the worst of them after gradient ascent through CasADi.  ``t_final``
    in s; ``progress`` is called with the name of each stage.  The same ``seed`` gives the same search.  A missing W is
    designed first, as ``certify`` does.
    Returns: a Falsification with suspects, which prove nothing, and equilibria, each proved in a box by interval
    arithmetic.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.falsifying.falsify import falsify as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    gain = observer_gain(problem)
    if isinstance(certified, Certificate):
        from dobc_design.searching import needed_check

        gain, certified = certified.claims.W, needed_check(certified)
    return run(
        problem, runs=runs, seed=seed, radius=radius, disturbance=disturbance, certified=certified, t_final=t_final,
        gain=gain, progress=progress,
    )  # fmt: skip


def search_certificate(
    certificate: Certificate, *, runs: int | None = None, seed: int | None = None, progress: Progress | None = None
) -> Searched:
    """Look for starts that contradict: in the region asked for, and on the boundary of the certified set.

    ``runs`` starts each, by default 500, fewer for large networks; the same ``seed`` (the problem's by default) gives
    the same search.  ``progress`` is called with the name of each stage.
    Returns: the searches, and the certificate, which a proved equilibrium inside the region asked for refutes where
    nothing was decided.  A missing region: twice the largest certified box.  Raises: SpecError for a wrong argument.
    """
    from dobc_design.searching import search_certificate as run

    return run(certificate, runs=runs, seed=seed, progress=progress)


def quadratic_limits(
    certificate: Certificate, *, progress: Progress | None = None
) -> tuple[QuadraticDual, ...]:  # fmt: skip
    """Prove how far no quadratic certificate reaches, for every shape of P_e, beside a proved `lure`.

    Each is an exact dual: no P_e of its shape decreases for all gains while |e_j - e_i| <= its ``radius``, so certified
    balls stay below its ``ball``.  ``progress`` is called with the name of each stage.
    Returns: a QuadraticDual for each shape where one is found.  Source: theory, section 4.
    """
    from dobc_design.covering.limits import quadratic_limits as run

    lure = next((check for check in certificate.checks if check.id == "lure"), None)
    return run(certificate.problem, lure, report=progress or (lambda stage: None))
