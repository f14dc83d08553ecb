"""Design and certification of disturbance-observer-based consensus control for networks of agents.

    import dobc_design as dd
    problem = dd.load_problem("paper-fixed")
    certificate = dd.certify(problem)
    certificate.save("folder")

Importing this package loads no solver: names are resolved when they are first used (PEP 562).
"""

from __future__ import annotations

import logging
from importlib import import_module

TYPE_CHECKING = False  # typing takes longer to import than this package
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

logging.getLogger(__name__).addHandler(logging.NullHandler())

_HOMES = {
    "Analysis": "analysis.analysis",
    "Certificate": "certificate.certificate",
    "Check": "conditions.check",
    "Cone": "synthesis.observer.request",
    "Coupling": "coupling.coupling",
    "Design": "synthesis.joint.claim",
    "Designer": "designer.widget",
    "Disk": "synthesis.observer.request",
    "Ensemble": "simulation.ensemble",
    "Exosystem": "problem.exosystems",
    "Failure": "simulation.stress",
    "Falsification": "falsification.suspect",
    "Fixed": "simulation.signals",
    "Group": "problem.groups",
    "HalfPlane": "synthesis.observer.request",
    "Markov": "simulation.signals",
    "Mobile": "simulation.signals",
    "Model": "model.model",
    "Network": "problem.network",
    "NoiseLimit": "synthesis.observer.request",
    "Observer": "problem.groups",
    "ObserverDesign": "synthesis.observer.claim",
    "Periodic": "simulation.signals",
    "Pinning": "problem.pinning",
    "PinningDesign": "synthesis.pinning.claim",
    "Problem": "problem.problem",
    "RandomDwell": "simulation.signals",
    "Region": "problem.settings",
    "Schedule": "simulation.signals",
    "Settling": "conditions.schedule.decide",
    "Stress": "simulation.stress",
    "Suspect": "falsification.suspect",
    "SweepResult": "sweeps.result",
    "Switching": "problem.settings",
    "TradeOff": "synthesis.joint.claim",
    "Trajectory": "simulation.trajectory",
    "Verdict": "verdict",
    "Waypoints": "simulation.signals",
    "analyse": "export.interchange",
    "build_model": "export.interchange",
    "certify": "certification.certify",
    "certify_settling": "certification.certify",
    "design": "synthesis.designs",
    "design_observer": "synthesis.designs",
    "design_pinning": "synthesis.designs",
    "exact": "exact",
    "exosystems": "problem.exosystems",
    "falsify": "falsification.search",
    "from_pandapower": "export.interchange",
    "load_problem": "problem.load",
    "load_trajectory": "simulation.trajectory",
    "plot_regions": "report.write",
    "problem_from_file": "export.interchange",
    "search_certificate": "certification.search",
    "simulate": "simulation.simulations",
    "sweep": "sweeps.running",
    "to_c": "export.interchange",
    "to_casadi": "export.interchange",
    "to_control": "export.interchange",
    "to_fmu": "export.interchange",
    "to_latex": "export.interchange",
    "to_mat": "export.interchange",
    "to_numpy": "export.interchange",
    "to_sdpa": "export.interchange",
    "to_sympy": "export.interchange",
    "trade_off": "synthesis.designs",
    "verify": "certification.certify",
    "what_breaks_first": "simulation.breaking",
    "write_comparison": "report.write",
    "write_report": "report.write",
}

__all__ = [
    "Analysis",
    "Certificate",
    "Check",
    "Cone",
    "Coupling",
    "Design",
    "Disk",
    "Ensemble",
    "Exosystem",
    "Failure",
    "Falsification",
    "Fixed",
    "Group",
    "HalfPlane",
    "Markov",
    "Mobile",
    "Model",
    "Network",
    "NoiseLimit",
    "Observer",
    "ObserverDesign",
    "Periodic",
    "Pinning",
    "PinningDesign",
    "Problem",
    "RandomDwell",
    "Region",
    "Schedule",
    "Settling",
    "Stress",
    "Suspect",
    "SweepResult",
    "Switching",
    "TradeOff",
    "Trajectory",
    "Verdict",
    "Waypoints",
    "__version__",
    "analyse",
    "build_model",
    "certify",
    "certify_settling",
    "design",
    "design_observer",
    "design_pinning",
    "exact",
    "exosystems",
    "falsify",
    "from_pandapower",
    "load_problem",
    "load_trajectory",
    "plot_regions",
    "problem_from_file",
    "search_certificate",
    "simulate",
    "sweep",
    "to_c",
    "to_casadi",
    "to_control",
    "to_fmu",
    "to_latex",
    "to_mat",
    "to_numpy",
    "to_sdpa",
    "to_sympy",
    "trade_off",
    "verify",
    "what_breaks_first",
    "write_comparison",
    "write_report",
]

if TYPE_CHECKING:
    from dobc_design import exact
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certification.certify import certify, certify_settling, verify
    from dobc_design.certification.search import search_certificate
    from dobc_design.conditions.check import Check
    from dobc_design.conditions.schedule.decide import Settling
    from dobc_design.coupling.coupling import Coupling
    from dobc_design.export.interchange import (
        analyse,
        build_model,
        from_pandapower,
        problem_from_file,
        to_c,
        to_casadi,
        to_control,
        to_fmu,
        to_latex,
        to_mat,
        to_numpy,
        to_sdpa,
        to_sympy,
    )
    from dobc_design.falsification.search import falsify
    from dobc_design.falsification.suspect import Falsification, Suspect
    from dobc_design.model.model import Model
    from dobc_design.problem import exosystems
    from dobc_design.problem.exosystems import Exosystem
    from dobc_design.problem.groups import Group, Observer
    from dobc_design.problem.load import load_problem
    from dobc_design.problem.network import Network
    from dobc_design.problem.pinning import Pinning
    from dobc_design.problem.problem import Problem
    from dobc_design.problem.settings import Region, Switching
    from dobc_design.report.write import plot_regions, write_comparison, write_report
    from dobc_design.simulation.breaking import what_breaks_first
    from dobc_design.simulation.ensemble import Ensemble
    from dobc_design.simulation.signals import Fixed, Markov, Mobile, Periodic, RandomDwell, Schedule, Waypoints
    from dobc_design.simulation.simulations import simulate
    from dobc_design.simulation.stress import Failure, Stress
    from dobc_design.simulation.trajectory import Trajectory, load_trajectory
    from dobc_design.sweeps.result import SweepResult
    from dobc_design.sweeps.running import sweep
    from dobc_design.synthesis.designs import design, design_observer, design_pinning, trade_off
    from dobc_design.synthesis.joint.claim import Design, TradeOff
    from dobc_design.synthesis.observer.claim import ObserverDesign
    from dobc_design.synthesis.observer.request import Cone, Disk, HalfPlane, NoiseLimit
    from dobc_design.synthesis.pinning.claim import PinningDesign
    from dobc_design.verdict import Verdict


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{home}")
    value = getattr(module, name, module)  # "exact" and "exosystems" are modules
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_HOMES, *(name for name in globals() if name.startswith("__"))})
