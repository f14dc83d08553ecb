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
    "Design": "designing.designed",
    "Designer": "designer.widget",
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
    "SweepResult": "sweep.result",
    "Switching": "spec.switching",
    "TradeOff": "designing.trade_off",
    "Trajectory": "simulate.trajectory",
    "Verdict": "verdict",
    "Waypoints": "simulate.mobile",
    "analyse": "workflow",
    "build_model": "workflow",
    "certify": "workflow",
    "certify_settling": "workflow",
    "design": "workflow",
    "design_observer": "workflow",
    "design_pinning": "workflow",
    "exact": "exact",
    "exosystems": "spec.exosystems",
    "falsify": "workflow",
    "from_pandapower": "interchange",
    "load_problem": "spec.load",
    "load_trajectory": "simulate.storage",
    "plot_regions": "workflow",
    "problem_from_file": "interchange",
    "quadratic_limits": "workflow",
    "search_certificate": "workflow",
    "simulate": "workflow",
    "sweep": "sweep.running",
    "to_c": "interchange",
    "to_casadi": "interchange",
    "to_control": "workflow",
    "to_fmu": "interchange",
    "to_latex": "interchange",
    "to_mat": "interchange",
    "to_numpy": "interchange",
    "to_sdpa": "interchange",
    "to_sympy": "interchange",
    "trade_off": "workflow",
    "verify": "workflow",
    "what_breaks_first": "workflow",
    "write_comparison": "workflow",
    "write_report": "workflow",
}

__all__ = [
    "Analysis", "Certificate", "Check", "Cone", "Coupling", "Design", "Disk", "Ensemble", "Exosystem", "Failure",
    "Falsification", "Fixed", "Group", "HalfPlane", "Markov", "Mobile", "Model", "Network", "NoiseLimit", "Observer",
    "ObserverDesign", "Periodic", "Pinning", "PinningDesign", "Problem", "RandomDwell", "Region", "Schedule",
    "Settling", "Stress", "Suspect", "SweepResult", "Switching", "TradeOff", "Trajectory", "Verdict", "Waypoints",
    "__version__", "analyse", "build_model", "certify", "certify_settling", "design", "design_observer",
    "design_pinning", "exact", "exosystems", "falsify", "from_pandapower", "load_problem", "load_trajectory",
    "plot_regions", "problem_from_file", "quadratic_limits", "search_certificate", "simulate", "sweep", "to_c",
    "to_casadi", "to_control", "to_fmu", "to_latex", "to_mat", "to_numpy", "to_sdpa", "to_sympy", "trade_off",
    "verify", "what_breaks_first", "write_comparison", "write_report",
]  # fmt: skip

# Some rooms carry the names of public functions.  Loading them here, once, and dropping the names keeps
# a later import of dobc_design.verify.check from putting the room where users expect the function.
for _room in ("design", "simulate", "verify", "sweep"):
    import_module(f"{__name__}.{_room}")
    del globals()[_room]

if TYPE_CHECKING:
    from dobc_design import exact
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.designing.designed import Design
    from dobc_design.designing.trade_off import TradeOff
    from dobc_design.falsifying.suspect import Falsification, Suspect
    from dobc_design.interchange import (
        from_pandapower,
        problem_from_file,
        to_c,
        to_casadi,
        to_fmu,
        to_latex,
        to_mat,
        to_numpy,
        to_sdpa,
        to_sympy,
    )
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
    from dobc_design.spec.switching import Switching
    from dobc_design.sweep.result import SweepResult
    from dobc_design.sweep.running import sweep
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
        design,
        design_observer,
        design_pinning,
        falsify,
        plot_regions,
        quadratic_limits,
        search_certificate,
        simulate,
        to_control,
        trade_off,
        verify,
        what_breaks_first,
        write_comparison,
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
    return sorted({*__all__, *_HOMES, *(name for name in globals() if name.startswith("__"))})
