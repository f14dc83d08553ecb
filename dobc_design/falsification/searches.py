"""Beside a certificate: starts that do not converge, or that leave a certified set."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING

from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.observer.gain import observer_gain
from dobc_design.errors import SpecError
from dobc_design.problem.load import load_problem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.falsification.levels import Certified
    from dobc_design.falsification.suspect import Falsification

Progress = Callable[[str], None]


def falsify(
    problem: Problem | str | PathLike[str],
    *,
    runs: int = 500,
    seed: int | None = None,
    radius: float | None = None,
    disturbance: float | None = None,
    certified: Certificate | Certified | None = None,
    t_final: float | None = None,
    progress: Progress | None = None,
) -> Falsification:
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
    from dobc_design.falsification.search import falsify as run

    problem = problem if isinstance(problem, Problem) else load_problem(problem)
    gain = observer_gain(problem)
    if isinstance(certified, Certificate):
        gain, certified = certified.claims.W, needed_check(certified)
    return run(
        problem,
        runs=runs,
        seed=seed,
        radius=radius,
        disturbance=disturbance,
        certified=certified,
        t_final=t_final,
        gain=gain,
        progress=progress,
    )


def regional_check(certificate: Certificate) -> Check | None:
    """The proved check of a region that covers what is asked, else the first one; None without one."""
    proved = [check for check in certificate.checks if check.verdict is Verdict.PROVED and check.kind.role == "region"]
    first = proved[0] if proved else None
    return next((check for check in proved if check.id == certificate.claims.covered_by), first)


def needed_check(certificate: Certificate) -> Check:
    """The same.  Raises: SpecError without one."""
    found = regional_check(certificate)
    if found is None:
        raise SpecError(
            "certified must hold a proved check of a region; this certificate has none.",
            key="certified",
            cure="Ask for a [region], or give certify everything=True.",
        )
    return found
