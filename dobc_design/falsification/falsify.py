"""``falsify``: the search for starts that do not converge, of a problem or beside a certificate.

What is found by simulation is shown and refutes nothing.  A proved equilibrium inside the region
asked for does: it becomes a check of the certificate, unless a proof or a refutation stands there
already.
"""

from dataclasses import replace
from typing import Final, overload

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.overall import decide_overall, with_verdict
from dobc_design.conditions.check import Check
from dobc_design.conditions.observer.propose import observer_gain, with_observer
from dobc_design.errors import wrong
from dobc_design.loop.make import loop_of
from dobc_design.problem.load import Source, load_problem
from dobc_design.verdict import Verdict

from .levels import Certified, regional_check
from .search import RUNS, Question, search_starts
from .suspect import Falsification

#: Starts of the default search: rows n m times starts are at most so many, but there are a few
#: starts at least.
MOST_ROWS: Final = 200_000
LEAST_RUNS: Final = 5
#: Where no region is asked for, starts up to this many times the largest certified box are looked
#: at.
BEYOND: Final = 2


@noun
class Searched(Shown):
    """The certificate after a search, and what the search brought up: asked for first, then the
    certified set."""

    certificate: Certificate
    searches: tuple[Falsification, ...]

    def _card(self) -> Card:
        return replace(self.certificate._card(), lines=[str(each) for each in self.searches])

    def __repr__(self) -> str:
        return f"<Searched {self.certificate!r}, {len(self.searches)} searches>"


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
    ``disturbance`` bounds |eps_i|.  ``runs`` starts (500) are simulated: corners, edges and random
    ones.  ``t_final`` in s; ``progress``: as in ``certify``.  The same ``seed`` gives the same
    search.  A missing W is designed first, as ``certify`` does.

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
    problem = with_observer(load_problem(problem))
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


def search_beside(
    certificate: Certificate,
    *,
    runs: int | None = None,
    seed: int | None = None,
    progress: Reports[str] = None,
) -> Searched:
    """Look for starts that contradict: in the region asked for, or up to twice the largest
    certified box; and on the boundary of the certified set."""
    # as `dobc certify --search` makes it
    options = tuple(dict.fromkeys((*certificate.claims.options, "--search")))
    certificate = replace(certificate, claims=replace(certificate.claims, options=options))
    problem = certificate.problem
    W = certificate.claims.W
    if problem.groups and W is None:
        return Searched(certificate=certificate, searches=())
    if runs is None:
        # fewer runs of large networks, which take longer
        runs = max(LEAST_RUNS, min(RUNS, MOST_ROWS // (problem.n * problem.m)))
    questions = [Question(runs=runs, seed=seed, radius=_radius(certificate))]
    check = regional_check(certificate)
    if check is not None:
        questions.append(Question(runs=runs, seed=seed, certified=check))
    found = [search_starts(problem, each, gain=W, progress=progress) for each in questions]
    refuting = found[0].check
    if refuting is not None:
        certificate = _refuted(certificate, refuting)
    return Searched(certificate=certificate, searches=tuple(found))


def _radius(certificate: Certificate) -> float | None:
    """How far from the target starts are looked at where no region is asked for."""
    if certificate.problem.region is not None:
        return None
    boxes = [claim.box or 0.0 for claim in certificate.regions.claims]
    return BEYOND * max(boxes, default=0.0) or None


def _refuted(certificate: Certificate, refuting: Check) -> Certificate:
    """The certificate with one more check, where nothing was decided and this is news."""
    # a proof or refutation that stands there is not overruled by another one
    known = refuting.id in {each.id for each in certificate.checks}
    if known or certificate.verdict is not Verdict.UNDECIDED:
        return certificate
    checks = (*certificate.checks, refuting)
    problem = certificate.problem
    overall = decide_overall(loop_of(problem), checks, certificate.claims.W)
    claims = with_verdict(replace(certificate.claims, checks=checks), overall)
    return replace(certificate, claims=claims)
