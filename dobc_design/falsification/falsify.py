"""``falsify``: the search for starts that do not converge, of a problem or beside a certificate."""

from __future__ import annotations

from typing import overload

from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.errors import wrong
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import Source, load_problem

from .beside import Searched, search_beside
from .levels import Certified, regional_check
from .search import RUNS, Question, search_starts
from .suspect import Falsification


@overload
def falsify(
    problem: Certificate,
    *,
    runs: int | None = None,
    seed: int | None = None,
    progress: Reports[str] = None,
) -> Searched: ...


@overload
def falsify(
    problem: Source,
    *,
    runs: int | None = None,
    seed: int | None = None,
    radius: float | None = None,
    disturbance: float | None = None,
    certified: Certificate | Certified | None = None,
    t_final: float | None = None,
    progress: Reports[str] = None,
) -> Falsification: ...


@shows_progress
def falsify(
    problem: Source | Certificate,
    *,
    runs: int | None = None,
    seed: int | None = None,
    radius: float | None = None,
    disturbance: float | None = None,
    certified: Certificate | Certified | None = None,
    t_final: float | None = None,
    progress: Reports[str] = None,
) -> Falsification | Searched:
    """Search for starts that do not converge, or that leave a certified set; and prove second
    equilibria.

    Of a ``problem``: the starts of its region; with ``radius`` those of the box |e|_inf <= radius;
    without both |e|_inf <= 1; with ``certified`` those on the boundary of a certified set: that of
    a certificate, of one of its checks, or of a max-separable, arc-wise or Lur'e claim.
    ``disturbance`` bounds |eps_i|.  ``runs`` starts (500) are simulated: corners, edges, random
    ones, and the worst of them after gradient ascent through CasADi.  ``t_final`` in s;
    ``progress``: as in ``certify``.  The same ``seed`` gives the same search.  A missing W is
    designed first, as ``certify`` does.

    Of a certificate in place of the problem: both in the region asked for and on the boundary of
    the certified set, with W of the certificate; ``runs`` are fewer for large networks.  A missing
    region: twice the largest certified box.

    Returns: a Falsification with suspects, which prove nothing, and equilibria, each proved in a
    box by interval arithmetic.  Of a certificate: the ``searches``, and the ``certificate``, which
    a proved equilibrium inside the region asked for refutes where nothing was decided.
    Raises: SpecError for a wrong argument.
    """
    report = report_to(progress)
    if isinstance(problem, Certificate):
        given = {
            "radius": radius,
            "disturbance": disturbance,
            "certified": certified,
            "t_final": t_final,
        }
        for name, value in given.items():
            if value is not None:
                message = "must be left out with a certificate, which says where to start."
                raise wrong(name, message, "Or give the problem in place of its certificate.")
        problem.problem.require("a search for starts that do not converge")
        return search_beside(problem, runs=runs, seed=seed, progress=report)
    problem = load_problem(problem)
    problem.require("a search for starts that do not converge")
    gain = observer_gain(loop_of(problem))
    if isinstance(certified, Certificate):
        # what was certified holds with this gain
        gain = certified.claims.W
        certified = regional_check(certified)
        if certified is None:
            message = "must hold a proved check of a region; this certificate has none."
            cure = "Ask for a [region], or give certify everything=True."
            raise wrong("certified", message, cure)
    question = Question(
        runs=RUNS if runs is None else runs,
        seed=seed,
        radius=radius,
        disturbance=disturbance,
        certified=certified,
        t_final=t_final,
    )
    return search_starts(problem, question, gain=gain, progress=report)
