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

__version__ = "0.2.0"

#: Module -> its public names; exact, export, exosystems, poles and signals are modules themselves.
_NAMES = {
    "analysis.analysis": "Analysis",
    "certificate.certificate": "Certificate",
    "certification.certify": "certify verify",
    "conditions.check": "Check",
    "conditions.schedule.settling": "Settling",
    "coupling.coupling": "Coupling",
    "description.description": "describe",
    "designer.widget": "Designer",
    "exact": "exact",
    "export": "analyse build_model export",
    "falsification.falsify": "falsify",
    "falsification.suspect": "Falsification Suspect",
    "importing.files": "problem_from_file",
    "importing.grids": "from_pandapower",
    "model.model": "Model",
    "problem.dynamics": "Dynamics",
    "problem.exosystems": "Exosystem exosystems",
    "problem.groups": "Group Observer",
    "problem.load": "load_problem",
    "problem.network": "Network",
    "problem.pinning": "Pinning",
    "problem.problem": "Problem",
    "problem.readings": "Processor Readings",
    "problem.region": "Region",
    "problem.switching": "Switching",
    "report.write": "write_comparison write_report",
    "simulation.breaking": "what_breaks_first",
    "simulation.runs": "simulate",
    "simulation.signals": "signals",
    "simulation.stress": "Failure Stress",
    "simulation.trajectory": "Ensemble Trajectory load_trajectory",
    "sweeps.result": "SweepResult",
    "sweeps.running": "sweep",
    "synthesis.block_lmi": "BlockLMI block_lmi",
    "synthesis.designs": "design design_observer design_pinning trade_off",
    "synthesis.joint.claim": "Design TradeOff",
    "synthesis.observer.bands": "BandDesign design_bands",
    "synthesis.observer.claim": "ObserverDesign poles",
    "synthesis.pinning.claim": "PinningDesign",
    "verdict": "Verdict",
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}

#: Types that functions return (the widget needs an extra): here for annotations, and no part of
#: ``__all__``.
_TYPES = (
    "Analysis BandDesign BlockLMI Designer Falsification Model ObserverDesign Pinning "
    "PinningDesign Settling Suspect SweepResult TradeOff"
)
__all__ = sorted({"__version__", *_HOMES} - set(_TYPES.split()))  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{home}")
    value = getattr(module, name, module)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_HOMES, *(name for name in globals() if name.startswith("__"))})
