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
    "Coupling": "coupling.coupling",
    "Design": "synthesis.joint.claim",
    "Designer": "designer.widget",
    "Ensemble": "simulation.runs",
    "Exosystem": "problem.exosystems",
    "Failure": "simulation.setting",
    "Falsification": "falsification.suspect",
    "Group": "problem.groups",
    "Model": "model.model",
    "Network": "problem.network",
    "Observer": "problem.groups",
    "ObserverDesign": "synthesis.observer.claim",
    "Pinning": "problem.problem",
    "PinningDesign": "synthesis.pinning.claim",
    "Problem": "problem.problem",
    "Region": "problem.settings",
    "Settling": "conditions.schedule.decide",
    "Stress": "simulation.setting",
    "Suspect": "falsification.suspect",
    "SweepResult": "sweeps.result",
    "Switching": "problem.settings",
    "TradeOff": "synthesis.joint.claim",
    "Trajectory": "simulation.trajectory",
    "Verdict": "verdict",
    "analyse": "export",
    "build_model": "export",
    "certify": "certification.certify",
    "certify_settling": "certification.certify",
    "design": "synthesis.designs",
    "design_observer": "synthesis.designs",
    "design_pinning": "synthesis.designs",
    "exact": "exact",
    "exosystems": "problem.exosystems",
    "export": "export",
    "falsify": "falsification.search",
    "from_pandapower": "importing.grids",
    "load_problem": "problem.load",
    "load_trajectory": "simulation.trajectory",
    "poles": "synthesis.observer.claim",
    "problem_from_file": "importing.files",
    "search_certificate": "certification.search",
    "signals": "simulation.signals",
    "simulate": "simulation.runs",
    "sweep": "sweeps.running",
    "trade_off": "synthesis.designs",
    "verify": "certification.certify",
    "what_breaks_first": "simulation.breaking",
    "write_comparison": "report.write",
    "write_report": "report.write",
}

#: Types that functions return (the widget needs an extra): here for annotations, and no part of ``__all__``.
_TYPES = (
    "Analysis Designer Falsification Model ObserverDesign Pinning PinningDesign Settling Suspect SweepResult TradeOff"
)
__all__ = sorted({"__version__", *_HOMES} - set(_TYPES.split()))  # noqa: PLE0605

#: Old names and where they are now.
_MOVED = {
    **dict.fromkeys(("Fixed", "Markov", "Mobile", "Periodic", "RandomDwell", "Schedule", "Waypoints"), "signals"),
    **dict.fromkeys(("Cone", "Disk", "HalfPlane", "NoiseLimit"), "poles"),
    **dict.fromkeys(("to_c", "to_casadi", "to_control", "to_fmu", "to_latex"), "export"),
    **dict.fromkeys(("to_mat", "to_numpy", "to_sdpa", "to_sympy"), "export"),
    "plot_regions": "Certificate",
}


def __getattr__(name: str) -> Any:
    if name in _MOVED:
        from warnings import warn

        new = name.removesuffix("_regions")
        warn(f"dobc_design.{name} is now dobc_design.{_MOVED[name]}.{new}", DeprecationWarning, stacklevel=2)
        return getattr(__getattr__(_MOVED[name]), new)
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{home}")
    value = getattr(module, name, module)  # "exact", "export", "poles" and the like are modules
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_HOMES, *(name for name in globals() if name.startswith("__"))})
