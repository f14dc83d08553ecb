"""The types of the public names; at run time ``_HOMES`` says where they live."""

from typing import Any

from dobc_design import exact as exact
from dobc_design import export as export
from dobc_design.analysis.analysis import Analysis as Analysis
from dobc_design.certificate.certificate import Certificate as Certificate
from dobc_design.certification.certify import certify as certify
from dobc_design.certification.certify import verify as verify
from dobc_design.conditions.check import Check as Check
from dobc_design.conditions.schedule.settling import Settling as Settling
from dobc_design.coupling.coupling import Coupling as Coupling
from dobc_design.description.description import describe as describe
from dobc_design.export import analyse as analyse
from dobc_design.export import build_model as build_model
from dobc_design.falsification.falsify import falsify as falsify
from dobc_design.falsification.suspect import Falsification as Falsification
from dobc_design.falsification.suspect import Suspect as Suspect
from dobc_design.importing.files import problem_from_file as problem_from_file
from dobc_design.importing.grids import from_pandapower as from_pandapower
from dobc_design.model.model import Model as Model
from dobc_design.problem import exosystems as exosystems
from dobc_design.problem.dynamics import Dynamics as Dynamics
from dobc_design.problem.exosystems import Exosystem as Exosystem
from dobc_design.problem.groups import Group as Group
from dobc_design.problem.groups import Observer as Observer
from dobc_design.problem.load import load_problem as load_problem
from dobc_design.problem.network import Network as Network
from dobc_design.problem.pinning import Pinning as Pinning
from dobc_design.problem.problem import Problem as Problem
from dobc_design.problem.readings import Processor as Processor
from dobc_design.problem.readings import Readings as Readings
from dobc_design.problem.region import Region as Region
from dobc_design.problem.switching import Switching as Switching
from dobc_design.report.write import write_comparison as write_comparison
from dobc_design.report.write import write_report as write_report
from dobc_design.simulation import signals as signals
from dobc_design.simulation.breaking import what_breaks_first as what_breaks_first
from dobc_design.simulation.runs import simulate as simulate
from dobc_design.simulation.stress import Failure as Failure
from dobc_design.simulation.stress import Stress as Stress
from dobc_design.simulation.trajectory import Ensemble as Ensemble
from dobc_design.simulation.trajectory import Trajectory as Trajectory
from dobc_design.simulation.trajectory import load_trajectory as load_trajectory
from dobc_design.sweeps.result import SweepResult as SweepResult
from dobc_design.sweeps.running import sweep as sweep
from dobc_design.synthesis.block_lmi import BlockLMI as BlockLMI
from dobc_design.synthesis.block_lmi import block_lmi as block_lmi
from dobc_design.synthesis.designs import design as design
from dobc_design.synthesis.designs import design_observer as design_observer
from dobc_design.synthesis.designs import design_pinning as design_pinning
from dobc_design.synthesis.designs import trade_off as trade_off
from dobc_design.synthesis.joint.claim import Design as Design
from dobc_design.synthesis.joint.claim import TradeOff as TradeOff
from dobc_design.synthesis.observer.claim import ObserverDesign as ObserverDesign
from dobc_design.synthesis.pinning.claim import PinningDesign as PinningDesign
from dobc_design.verdict import Verdict as Verdict

__version__: str

def __getattr__(name: str) -> Any: ...
