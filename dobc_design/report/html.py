"""The report as one HTML page: no script, no network, readable on paper, on a phone and in the dark."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from dobc_design._render import latex_number
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.report import formulas, pictures, region_pictures
from dobc_design.report.formulas import math
from dobc_design.report.view import common_view
from dobc_design.report.words import capitalize_first, typeset

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.simulate.trajectory import Trajectory


def html_report(
    certificate: Certificate, *, analysis: Analysis | None, trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None = None,
) -> str:  # fmt: skip
    """Return the page.

    ``analysis`` and ``trajectory`` are shown where they are given.  ``lambdas``: mode -> Lambda(J) at the consensus,
    printed up to 12 x 12.  The same arguments give the same text.
    """
    environment = Environment(
        loader=PackageLoader("dobc_design.report"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"capitalize_first": capitalize_first, "typeset": typeset}
    network, legend = pictures.network_pictures(certificate)
    view: dict[str, Any] = common_view(certificate, analysis=analysis, trajectory=trajectory, lambdas=lambdas) | {
        "math": math,
        "network_pictures": network,
        "network_legend": legend,
        "region_pictures": region_pictures.region_pictures(certificate.regions),
        "eigenvalue_pictures": pictures.eigenvalue_pictures(certificate, analysis),
        "simulation_pictures": pictures.simulation_pictures(certificate, trajectory),
        "formulas": formulas,
        "latex_number": latex_number,
    }
    return environment.get_template("report.html.j2").render(view) + "\n"
