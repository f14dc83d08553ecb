"""Design and certification of disturbance-observer-based consensus control for networks of agents.

    import dobc_design as dd
    problem = dd.load_problem("paper-fixed")
    certificate = dd.certify(problem)
    certificate.save("folder")

Importing this package loads no solver: names are resolved when they are first used (PEP 562).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "Analysis": "analysis.analysis",
    "Certificate": "certificate.certificate",
    "Check": "verify.check",
    "Coupling": "spec.coupling",
    "Exosystem": "spec.exosystem",
    "Model": "model.model",
    "Network": "spec.network",
    "Observer": "spec.observer",
    "Pinning": "spec.pinning",
    "Problem": "spec.problem",
    "Region": "spec.region",
    "Trajectory": "simulate.trajectory",
    "Verdict": "verdict",
    "analyse": "workflow",
    "build_model": "workflow",
    "certify": "workflow",
    "exact": "exact",
    "load_problem": "spec.load",
    "simulate": "workflow",
    "verify": "workflow",
    "write_report": "workflow",
}

__all__ = [
    "Analysis", "Certificate", "Check", "Coupling", "Exosystem", "Model", "Network", "Observer", "Pinning", "Problem",
    "Region", "Trajectory", "Verdict", "__version__", "analyse", "build_model", "certify", "exact", "load_problem",
    "simulate", "verify", "write_report",
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
    from dobc_design.model.model import Model
    from dobc_design.simulate.trajectory import Trajectory
    from dobc_design.spec.coupling import Coupling
    from dobc_design.spec.exosystem import Exosystem
    from dobc_design.spec.load import load_problem
    from dobc_design.spec.network import Network
    from dobc_design.spec.observer import Observer
    from dobc_design.spec.pinning import Pinning
    from dobc_design.spec.problem import Problem
    from dobc_design.spec.region import Region
    from dobc_design.verdict import Verdict
    from dobc_design.verify.check import Check
    from dobc_design.workflow import analyse, build_model, certify, simulate, verify, write_report


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{home}")
    value = module if home == name else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
