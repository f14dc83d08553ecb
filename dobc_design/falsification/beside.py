"""Falsification beside a certificate: a search where it was asked, and on the boundary of what is
certified.

What is found by simulation is shown and refutes nothing.  A proved equilibrium inside the region
asked for does: it becomes a check of the certificate, unless a proof or a refutation stands there
already.
"""

from dataclasses import replace
from typing import Final

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design._show.progress import Reports
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.overall import decide_overall, with_verdict
from dobc_design.conditions.check import Check
from dobc_design.loop.make import loop_of
from dobc_design.verdict import Verdict

from .levels import regional_check
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
