"""The public names: a contract with users, so a change here needs a changelog entry."""

import doctest
import inspect
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import pytest

import dobc_design

_NAMES = """
Certificate Check Coupling Design Dynamics Ensemble Exosystem Failure Group Network Observer
Problem Processor Readings Region Stress
Switching Trajectory Verdict __version__ analyse block_lmi build_model certify
describe design design_bands design_observer
design_pinning exact exosystems export falsify from_pandapower load_problem load_trajectory poles
problem_from_file
signals simulate sweep trade_off verify what_breaks_first write_comparison
write_report
"""
#: Types that functions return, and what the modules among the names hold for users.
TYPES = (
    "Analysis BandDesign BlockLMI Falsification Model ObserverDesign Pinning PinningDesign "
    "Settling Suspect SweepResult TradeOff"
)
INSIDE = """
export.to_c export.to_casadi export.to_control export.to_fmu export.to_latex export.to_numpy
export.to_sdpa export.to_sympy poles.Cone poles.Disk poles.HalfPlane poles.NoiseLimit signals.Fixed
signals.Markov
signals.Mobile signals.Periodic signals.RandomDwell signals.Schedule signals.Waypoints
"""
PUBLIC = _NAMES.split()
FUNCTIONS = [
    "analyse",
    "build_model",
    "certify",
    "design",
    "load_problem",
    "simulate",
    "sweep",
    "verify",
    "write_report",
]


def test_the_public_names_are_these_and_sorted():
    assert sorted(PUBLIC) == PUBLIC
    assert list(dobc_design.__all__) == PUBLIC


@pytest.mark.parametrize("name", [*PUBLIC, *TYPES.split(), *INSIDE.split()])
def test_every_public_name_can_be_imported_and_explains_itself(name: str):
    public = attrgetter(name)(dobc_design)
    if name != "__version__":
        assert vars(public).get("__doc__") if inspect.isclass(public) else public.__doc__


@pytest.mark.slow
def test_public_functions_stay_functions_whatever_room_is_loaded_first():
    """Importing a room sets an attribute of the package, which would hide a function of the same
    name."""
    script = f"""
import sys
import dobc_design.simulation.runs, dobc_design.certification.certify, dobc_design.sweeps.running
import dobc_design as dd
sys.exit(" ".join(name for name in {FUNCTIONS} if not callable(getattr(dd, name))) or None)
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


REFERENCE = sorted((Path(__file__).resolve().parents[1] / "docs/reference").glob("python*.md"))
MODULES = {"exact": "dobc_design.exact", "exosystems": "dobc_design.problem.exosystems"}


def documented() -> list[str]:
    """What the pages of the reference show with its docstring, as it is reached from the
    package."""
    text = "".join(page.read_text("utf-8") for page in REFERENCE)
    shown = re.findall(r"^\.\. auto(?:function|class|module):: (\S+)$", text, re.MULTILINE)
    return [
        name.removeprefix("dobc_design.") if name.removeprefix("dobc_design.") in INSIDE else name
        for name in shown
    ]


def test_the_reference_shows_every_public_name_once_and_no_other():
    names = documented()
    wanted = [
        MODULES.get(name, name)
        for name in PUBLIC
        if name not in ("__version__", "export", "poles", "signals")
    ]
    wanted += [*TYPES.split(), *INSIDE.split()]
    # The widget needs an extra, so it is public but no part of __all__; the errors are reached by
    # their module.
    assert sorted(
        name for name in names if not name.startswith("dobc_design.") or name in MODULES.values()
    ) == sorted([*wanted, "Designer"])
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("path", [name for name in documented() if name.startswith("dobc_design.")])
def test_what_the_reference_shows_besides_exists_and_explains_itself(path: str):
    module, _, name = path.rpartition(".")
    found = sys.modules.get(path) or getattr(__import__(module, fromlist=[name]), name)
    assert found.__doc__


@pytest.mark.parametrize("name", [*PUBLIC, *INSIDE.split()])
def test_a_public_function_says_what_it_returns_and_what_every_argument_means_that_is_given_by_name(
    name: str,
):
    function = attrgetter(name)(dobc_design)
    if inspect.isfunction(function):
        text = inspect.getdoc(function)
        arguments = inspect.signature(function).parameters.values()
        by_name = [each.name for each in arguments if each.kind is each.KEYWORD_ONLY]
        assert [each for each in by_name if f"``{each}``" not in text] == []
        assert re.search(r"\bReturns: |\breturn the ", text)


def examples() -> Iterator[doctest.DocTest]:
    """The examples in the docstrings of everything public, methods included."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    for name in [*PUBLIC, *TYPES.split(), *INSIDE.split()]:
        public = attrgetter(name)(dobc_design)
        inside = getattr(public, "__all__", ()) if inspect.ismodule(public) else ()
        parts = {f"{name}.{each}": getattr(public, each) for each in inside}
        for title, part in (parts or {name: public}).items():
            yield from finder.find(part, title, module=False, globs={}) if callable(part) else ()


@pytest.mark.slow
def test_the_examples_in_docstrings_are_true():
    """What several of them begin with is certified once."""
    names = {name: getattr(dobc_design, name) for name in PUBLIC}
    dd = SimpleNamespace(**names | {"certify": cache(dobc_design.certify)})
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    failed: list[str] = []
    for each in examples():
        each.globs = {"dd": dd}
        runner.run(each, out=failed.append)
    assert "".join(failed) == ""
    assert runner.tries >= 40


def test_dir_shows_the_public_names():
    assert set(PUBLIC) <= set(dir(dobc_design))


@pytest.fixture(scope="module")
def shown_nouns():
    problem = dobc_design.load_problem("clock-sync")
    return problem, problem.network, dobc_design.certify(problem)


def completed(noun: object) -> list[str]:
    """The names that completion shows of a value."""
    return [name for name in dir(noun) if not name.startswith("_")]


def test_every_name_that_completion_shows_is_explained(shown_nouns):
    """By its own docstring, or, of a field, in that of its class."""
    for noun in shown_nouns:
        known = inspect.getdoc(type(noun))
        for name in completed(noun):
            own = inspect.getattr_static(type(noun), name).__doc__
            assert own or re.search(rf"``{name}``|\b{name}(, \w+)*: ", known), name


def test_completion_and_reference_leave_out_what_is_for_the_package_itself(shown_nouns):
    problem, network, _ = shown_nouns
    assert {"gains", "plot", "replace", "network", "m"} <= set(completed(problem))
    assert {"modes", "from_arcs", "adjacency", "to_networkx"} <= set(completed(network))
    page = next(page for page in REFERENCE if page.name == "python-problems.md").read_text("utf-8")
    for noun in (problem, network):
        name = type(noun).__name__
        left_out = re.search(rf":: {name}\n.*\n +:exclude-members: (.*)", page)[1].split(", ")
        assert not set(left_out) & set(completed(noun))
        # Everything else is shown, and what is left out is still there.
        everything = {name for name in object.__dir__(noun) if not name.startswith("_")}
        assert everything == {*left_out, *completed(noun)}


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        dobc_design.no_such_name  # noqa: B018  the access itself is what is tested


def test_the_version_is_the_one_in_pyproject():
    project = Path(__file__).resolve().parents[1] / "pyproject.toml"
    assert (
        tomllib.loads(project.read_text("utf-8"))["project"]["version"] == dobc_design.__version__
    )
