"""Everything that a report with pictures shows: the common view and all figures, for the page and the PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.report import pictures, region_pictures
from dobc_design.report.search_figures import search_pictures
from dobc_design.report.view import common_view

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory


def full_view(
    certificate: Certificate,
    *,
    analysis: Analysis | None,
    trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None,
    timings: Sequence[StageTiming],
    searches: Sequence[Falsification],
) -> dict[str, Any]:
    """Names and values of ``common_view``, and the figures."""
    network, legend = pictures.network_pictures(certificate)
    return common_view(
        certificate,
        analysis=analysis,
        trajectory=trajectory,
        lambdas=lambdas,
        timings=timings,
        searches=searches,
    ) | {
        "network_pictures": network,
        "network_legend": legend,
        "region_pictures": region_pictures.region_pictures(certificate.regions),
        "envelope_picture": region_pictures.envelope_picture(certificate.settling),
        "search_pictures": search_pictures(searches),
        "eigenvalue_pictures": pictures.eigenvalue_pictures(certificate, analysis),
        "simulation_pictures": pictures.simulation_pictures(certificate, trajectory),
    }
