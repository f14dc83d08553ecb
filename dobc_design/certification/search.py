"""Falsification beside a certificate: a search where it was asked, and on the boundary of what is
certified.

What is found by simulation is shown and refutes nothing.  A proved equilibrium inside the region
asked for does: it becomes a check of the certificate, unless a proof or a refutation stands there
already.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Final

from dobc_design._show.cards import Card, Shown
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.overall import decide_overall
from dobc_design.falsification.search import RUNS, search_starts
from dobc_design.falsification.starts import regional_check
from dobc_design.falsification.suspect import Falsification
from dobc_design.problem.integrators import as_integrators
from dobc_design.verdict import Verdict

#: Starts of the default search: rows n m times starts are at most so many, but there are a few
#: starts at least.
MOST_ROWS: Final = 200_000
LEAST_RUNS: Final = 5
#: Where no region is asked for, starts up to this many times the largest certified box are looked
#: at.
BEYOND: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Searched(Shown):
    """The certificate after a search, and what the search brought up: asked for first, then the
    certified set."""

    certificate: Certificate
    searches: tuple[Falsification, ...]

    def _card(self) -> Card:
        return replace(self.certificate._card(), lines=[str(each) for each in self.searches])

    def __repr__(self) -> str:
        return f"<Searched {self.certificate!r}, {len(self.searches)} searches>"


@shows_progress
def search_certificate(
    certificate: Certificate,
    *,
    runs: int | None = None,
    seed: int | None = None,
    progress: Reports[str] = None,
) -> Searched:
    """Look for starts that contradict: in the region asked for, and on the boundary of the
    certified set.

    ``runs`` starts each, by default 500, fewer for large networks; the same ``seed`` (the problem's
    by default) gives the same search.  ``progress``: as in ``certify``.
    Returns: the searches, and the certificate, which a proved equilibrium inside the region asked
    for refutes where nothing was decided.  A missing region: twice the largest certified box.
    Raises: SpecError for a wrong argument.
    """
    # as `dobc certify --search` makes it
    options = tuple(dict.fromkeys((*certificate.claims.options, "--search")))
    certificate = replace(certificate, claims=replace(certificate.claims, options=options))
    problem, W = as_integrators(certificate.problem), certificate.claims.W
    if runs is None:
        runs = max(LEAST_RUNS, min(RUNS, MOST_ROWS // (problem.n * problem.m)))
    if problem.groups and W is None:
        return Searched(certificate=certificate, searches=())
    check, radius = regional_check(certificate), None
    if problem.region is None:
        radius = (
            BEYOND * max((claim.box or 0.0 for claim in certificate.regions.claims), default=0.0)
            or None
        )
    search = partial(
        search_starts, problem, runs=runs, seed=seed, gain=W, progress=report_to(progress)
    )
    found = [search(radius=radius), *([] if check is None else [search(certified=check)])]
    refuting = found[0].check
    is_new = refuting is not None and refuting.id not in {each.id for each in certificate.checks}
    if refuting is not None and is_new and certificate.verdict is Verdict.UNDECIDED:
        checks = (*certificate.checks, refuting)
        overall = decide_overall(problem, checks, W)
        certificate = replace(
            certificate, claims=replace(certificate.claims, checks=checks, **asdict(overall))
        )
    return Searched(certificate=certificate, searches=tuple(found))
