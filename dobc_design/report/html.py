"""The report as one HTML page: no script, no network, readable on paper, on a phone and in the dark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from dobc_design._show.text import latex_number
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.report import formulas
from dobc_design.report.formulas import math
from dobc_design.report.full_view import full_view
from dobc_design.report.words import capitalize_first, typeset

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory


def html_report(
    certificate: Certificate,
    *,
    analysis: Analysis | None,
    trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None = None,
    timings: Sequence[StageTiming] = (),
    searches: Sequence[Falsification] = (),
) -> str:
    """Return the page.

    ``analysis`` and ``trajectory`` are shown where they are given.  ``lambdas``: mode -> Lambda(J) at the consensus,
    printed up to 12 x 12.  ``timings``: sampling and delays of the stages of a settling time; ``searches`` for
    counterexamples.  The same arguments give the same text.
    """
    environment = Environment(
        loader=PackageLoader("dobc_design.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"capitalize_first": capitalize_first, "typeset": typeset}
    view = full_view(
        certificate,
        analysis=analysis,
        trajectory=trajectory,
        lambdas=lambdas,
        timings=timings,
        searches=searches,
    ) | {"math": math, "formulas": formulas, "latex_number": latex_number}
    return environment.get_template("report.html.j2").render(view) + "\n"
