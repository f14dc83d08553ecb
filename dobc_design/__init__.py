"""Design and certification of disturbance-observer-based consensus control for networks of agents.

    import dobc_design as dd
    problem = dd.load_problem("paper-fixed")
    certificate = dd.certify(problem)
    certificate.save("folder")

Importing this package loads no solver: names are resolved when they are first used (PEP 562).
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # typing takes longer to import than this package
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "Analysis": "analysis.analysis",
    "Certificate": "certificate.certificate",
    "Check": "conditions.check",
    "Cone": "synthesis.observer.claim",
    "Coupling": "coupling.coupling",
    "Design": "synthesis.joint.claim",
    "Designer": "designer.widget",
    "Disk": "synthesis.observer.claim",
    "Ensemble": "simulation.runs",
    "Exosystem": "problem.exosystems",
    "Failure": "simulation.setting",
    "Falsification": "falsification.suspect",
    "Fixed": "simulation.signals",
    "Group": "problem.groups",
    "HalfPlane": "synthesis.observer.claim",
    "Markov": "simulation.signals",
    "Mobile": "simulation.signals",
    "Model": "model.model",
    "Network": "problem.network",
    "NoiseLimit": "synthesis.observer.claim",
    "Observer": "problem.groups",
    "ObserverDesign": "synthesis.observer.claim",
    "Periodic": "simulation.signals",
    "Pinning": "problem.problem",
    "PinningDesign": "synthesis.pinning.claim",
    "Problem": "problem.problem",
    "RandomDwell": "simulation.signals",
    "Region": "problem.settings",
    "Schedule": "simulation.signals",
    "Settling": "conditions.schedule.decide",
    "Stress": "simulation.setting",
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
    "from_pandapower": "importing.grids",
    "load_problem": "problem.load",
    "load_trajectory": "simulation.trajectory",
    "problem_from_file": "importing.files",
    "search_certificate": "certification.search",
    "simulate": "simulation.runs",
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

__all__ = sorted({"__version__", *_HOMES} - {"Designer"})  # noqa: PLE0605 - the widget needs an extra


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
