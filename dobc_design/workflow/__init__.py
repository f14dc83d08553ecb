"""The order of the stages: the only room that knows it.

One function per stage; each of them takes nouns and returns a noun.
"""

from __future__ import annotations

import logging

from dobc_design.workflow.certificates import certify, certify_settling, observer_gain, other_equilibria, verify
from dobc_design.workflow.designs import design, design_observer, design_pinning, trade_off
from dobc_design.workflow.models import analyse, build_model, python_script, to_control
from dobc_design.workflow.reports import (
    PAGE,
    plot_regions,
    render_comparison,
    render_latex,
    render_report,
    search_sheet,
    write_comparison,
    write_report,
)
from dobc_design.workflow.searches import falsify, quadratic_limits, search_certificate
from dobc_design.workflow.simulations import certified_period, simulate, what_breaks_first

__all__ = [
    "PAGE", "analyse", "build_model", "certified_period", "certify", "certify_settling", "design",
    "design_observer", "design_pinning", "falsify", "observer_gain", "other_equilibria", "plot_regions",
    "python_script", "quadratic_limits", "render_comparison", "render_latex", "render_report", "search_certificate",
    "search_sheet", "simulate", "to_control", "trade_off", "verify", "what_breaks_first", "write_comparison",
    "write_report",
]  # fmt: skip

logging.getLogger("dobc_design").addHandler(logging.NullHandler())
