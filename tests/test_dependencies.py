"""constraints.txt is a set that pyproject.toml allows, of every package that it names, on every Python."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_every_dependency_has_one_tested_version_that_is_allowed(python: str):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    pinned = [Requirement(line) for line in lines if not line.startswith("#")]
    assert not [each for each in pinned if each.url]
    here = [each for each in pinned if not each.marker or each.marker.evaluate({"python_version": python})]
    tested = {each.name: str(each.specifier).removeprefix("==") for each in here}
    assert len(tested) == len(here)
    asked = [*project["dependencies"], *(x for group in project["optional-dependencies"].values() for x in group)]
    for requirement in map(Requirement, asked):
        assert requirement.specifier.contains(tested.pop(requirement.name.lower())), requirement
    assert not tested
