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
    "Check": "verify.check",
    "Cone": "spec.spectral_regions",
    "Coupling": "spec.coupling",
    "Disk": "spec.spectral_regions",
    "Ensemble": "simulate.ensemble",
    "Exosystem": "spec.exosystem",
    "Failure": "simulate.stress",
    "Falsification": "falsifying.suspect",
    "Fixed": "simulate.signals",
    "Group": "spec.groups",
    "HalfPlane": "spec.spectral_regions",
    "Markov": "simulate.signals",
    "Mobile": "simulate.mobile",
    "Model": "model.model",
    "Network": "spec.network",
    "NoiseLimit": "spec.observer_request",
    "Observer": "spec.observer",
    "ObserverDesign": "verify.observer_design",
    "Periodic": "simulate.signals",
    "Pinning": "spec.pinning",
    "PinningDesign": "verify.pinning_design",
    "Problem": "spec.problem",
    "RandomDwell": "simulate.signals",
    "Region": "spec.region",
    "Schedule": "simulate.signals",
    "Settling": "verify.settling",
    "Stress": "simulate.stress",
    "Suspect": "falsifying.suspect",
    "Trajectory": "simulate.trajectory",
    "Verdict": "verdict",
    "Waypoints": "simulate.mobile",
    "analyse": "workflow",
    "build_model": "workflow",
    "certify": "workflow",
    "certify_settling": "workflow",
    "design_observer": "workflow",
    "design_pinning": "workflow",
    "exact": "exact",
    "exosystems": "spec.exosystems",
    "falsify": "workflow",
    "load_problem": "spec.load",
    "load_trajectory": "simulate.storage",
    "plot_regions": "workflow",
    "simulate": "workflow",
    "to_control": "workflow",
    "verify": "workflow",
    "what_breaks_first": "workflow",
    "write_report": "workflow",
}

__all__ = [
    "Analysis", "Certificate", "Check", "Cone", "Coupling", "Disk", "Ensemble", "Exosystem", "Failure",
    "Falsification", "Fixed", "Group", "HalfPlane", "Markov", "Mobile", "Model", "Network", "NoiseLimit", "Observer",
    "ObserverDesign", "Periodic", "Pinning", "PinningDesign", "Problem", "RandomDwell", "Region", "Schedule",
    "Settling", "Stress", "Suspect", "Trajectory", "Verdict", "Waypoints", "__version__", "analyse", "build_model",
    "certify", "certify_settling", "design_observer", "design_pinning", "exact", "exosystems", "falsify",
    "load_problem", "load_trajectory", "plot_regions", "simulate", "to_control", "verify", "what_breaks_first",
    "write_report",
]  # fmt: skip

# Two rooms carry the names of public functions.  Loading them here, once, and dropping the names keeps
# a later import of dobc_design.verify.check from putting the room where users expect the function.
for _room in ("simulate", "verify"):
    import_module(f"{__name__}.{_room}")
    del globals()[_room]

if TYPE_CHECKING:
    from dobc_design import exact
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.falsifying.suspect import Falsification, Suspect
    from dobc_design.model.model import Model
    from dobc_design.simulate.ensemble import Ensemble
    from dobc_design.simulate.mobile import Mobile, Waypoints
    from dobc_design.simulate.signals import Fixed, Markov, Periodic, RandomDwell, Schedule
    from dobc_design.simulate.storage import load_trajectory
    from dobc_design.simulate.stress import Failure, Stress
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.spec import exosystems
    from dobc_design.spec.coupling import Coupling
    from dobc_design.spec.exosystem import Exosystem
    from dobc_design.spec.groups import Group
    from dobc_design.spec.load import load_problem
    from dobc_design.spec.network import Network
    from dobc_design.spec.observer import Observer
    from dobc_design.spec.observer_request import NoiseLimit
    from dobc_design.spec.pinning import Pinning
    from dobc_design.spec.problem import Problem
    from dobc_design.spec.region import Region
    from dobc_design.spec.spectral_regions import Cone, Disk, HalfPlane
    from dobc_design.verdict import Verdict
    from dobc_design.verify.check import Check
    from dobc_design.verify.observer_design import ObserverDesign
    from dobc_design.verify.pinning_design import PinningDesign
    from dobc_design.verify.settling import Settling
    from dobc_design.workflow import (
        analyse,
        build_model,
        certify,
        certify_settling,
        design_observer,
        design_pinning,
        falsify,
        plot_regions,
        simulate,
        to_control,
        verify,
        what_breaks_first,
        write_report,
    )


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{home}")
    value = module if home.rpartition(".")[2] == name else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
