"""constraints.txt is the tested set: of every package that is needed on a Python one version, which
is allowed."""

import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
LINES = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
PINS = [Requirement(line) for line in LINES if not line.startswith("#")]


def pinned_for(python: str) -> dict[str, str]:
    """Name and version of what is pinned for a Python."""
    here = [
        each for each in PINS if not each.marker or each.marker.evaluate({"python_version": python})
    ]
    versions = {each.name: str(each.specifier).removeprefix("==") for each in here}
    assert len(versions) == len(here)
    return versions


def needed(extra: str) -> set[str]:
    """Everything that dobc_design with this extra needs here, directly or not, as the installed
    packages say."""
    found: set[str] = set()
    left = [("dobc_design", frozenset({"", extra}))]
    asked = set(left)
    while left:
        name, extras = left.pop()
        for text in metadata.distribution(name).requires or ():
            each = Requirement(text)
            if each.marker and not any(each.marker.evaluate({"extra": one}) for one in extras):
                continue
            found.add(canonicalize_name(each.name))
            further = (each.name, frozenset({"", *each.extras}))
            if further not in asked:
                asked.add(further)
                left.append(further)
    return found


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_every_dependency_has_one_tested_version_that_is_allowed(python: str):
    versions = pinned_for(python)
    assert not [each for each in PINS if each.url]
    extras = PROJECT["optional-dependencies"]
    asked = [*PROJECT["dependencies"], *(each for group in extras.values() for each in group)]
    for requirement in map(Requirement, asked):
        assert requirement.specifier.contains(versions[canonicalize_name(requirement.name)]), (
            requirement
        )


def test_what_these_need_is_pinned_too():
    """pip would otherwise take whatever is newest on the day."""
    python = ".".join(sys.version.split(".")[:2])
    assert needed("dev") <= pinned_for(python).keys()


def test_the_makefile_installs_the_tested_set():
    """Its stamp is older than constraints.txt as soon as a pin changes."""
    text = (ROOT / "Makefile").read_text("utf-8")
    assert "$(READY): pyproject.toml constraints.txt\n" in text
    assert (
        text.count("--constraint constraints.txt")
        == text.count("$$into --constraint constraints.txt")
        == 2
    )
