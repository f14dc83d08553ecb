"""The public names: a contract with users, so a change here needs a changelog entry."""

from __future__ import annotations

import inspect
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dobc_design

PUBLIC = [
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
    "quadratic_limits",
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

FUNCTIONS = [
    "analyse", "build_model", "certify", "design", "load_problem", "simulate", "sweep", "verify", "write_report",
]  # fmt: skip


def test_the_public_names_are_these_and_sorted():
    assert sorted(PUBLIC) == PUBLIC
    assert list(dobc_design.__all__) == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_can_be_imported_and_explains_itself(name: str):
    public = getattr(dobc_design, name)
    if name != "__version__":
        assert vars(public).get("__doc__") if inspect.isclass(public) else public.__doc__


def test_a_function_named_like_a_folder_stays_a_function():
    """Importing dobc_design.verify.check sets dobc_design.verify to the folder unless that is prevented."""
    script = f"""
import sys
import dobc_design.simulate, dobc_design.verify.check, dobc_design.design.gain
import dobc_design as dd
sys.exit(" ".join(name for name in {FUNCTIONS} if not callable(getattr(dd, name))) or None)
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_dir_shows_the_public_names():
    assert set(PUBLIC) <= set(dir(dobc_design))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        dobc_design.no_such_name  # noqa: B018  the access itself is what is tested


def test_the_version_is_the_one_in_pyproject():
    project = Path(__file__).resolve().parents[1] / "pyproject.toml"
    assert tomllib.loads(project.read_text("utf-8"))["project"]["version"] == dobc_design.__version__
