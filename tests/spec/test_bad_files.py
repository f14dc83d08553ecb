"""Every wrong problem file is refused with its key and a cure, in little time, and nothing is left behind.

The cases stand in ``bad_files``; the reader is given each as a file in a folder of its own.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from dobc_design.errors import SpecError
from dobc_design.spec.canonical import canonical_bytes, problem_from_canonical
from dobc_design.spec.file import read_problem_file


def _neighbour(name: str) -> ModuleType:
    """Load a module that lies beside this one (tests are no package)."""
    path = Path(__file__).with_name(f"{name}.py")
    spec = importlib.util.spec_from_file_location(f"_{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


cases = _neighbour("bad_files")


def write(case, folder: Path) -> Path:
    """Write a case and the files beside it; skip it where the system cannot have them."""
    for name, content in case.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    for name, target in case.links.items():
        try:
            os.symlink(target, folder / name)
        except OSError:  # Windows without the right to make links
            pytest.skip("symbolic links cannot be made here")
    path = folder / "problem.toml"
    path.write_bytes(case.data())
    return path


def listing(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.parametrize("case", cases.BAD_FILES, ids=lambda case: case.id)
def test_a_bad_file_is_refused_by_key_and_in_words(case, tmp_path):
    """Contract: one clear error that names the key, says what it must be and what it was; nothing written."""
    path = write(case, tmp_path)
    before, start = listing(tmp_path), time.process_time()
    with pytest.raises(SpecError) as caught:
        read_problem_file(path)
    spent = time.process_time() - start
    assert listing(tmp_path) == before
    errors = caught.value.errors
    if case.expect_key:
        assert case.expect_key in [error.key for error in errors]
    text = "\n".join(str(error) for error in errors).lower()
    for word in case.expect_words:
        assert word.lower() in text
    for error in errors:
        assert len(str(error)) < 1500
        assert not any(ord(character) < 32 and character != "\n" for character in str(error))
    assert spent < 5


def test_there_are_hundreds_of_bad_files_and_no_two_share_a_name():
    names = [case.id for case in (*cases.BAD_FILES, *cases.VALID_BUT_NASTY)]
    assert len(cases.BAD_FILES) >= 340
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", cases.VALID_BUT_NASTY, ids=lambda case: case.id)
def test_a_nasty_but_valid_file_loads_and_survives_the_canonical_form(case, tmp_path):
    path = write(case, tmp_path)
    before = listing(tmp_path)
    problem = read_problem_file(path)
    assert listing(tmp_path) == before
    data = canonical_bytes(problem)
    assert problem_from_canonical(data) == problem
    json.loads(data.decode("utf-8"))
