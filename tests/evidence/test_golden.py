"""Comparing recordings names every difference, and what is recorded varies with answers only."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from evidence import golden, golden_problems

from dobc_design import load_problem
from dobc_design.errors import SpecError
from dobc_design.problem.load import builtin_names

INPUTS = golden_problems.inputs()


def recorded(folder: Path, *, text: str, place: str = "certificate/certificate.json") -> Path:
    path = folder / "pair-00" / place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return folder


def test_the_files_are_many_of_every_kind_and_no_two_share_a_name():
    assert len({each.name for each in INPUTS}) == len(INPUTS) > 300
    assert {each.source for each in INPUTS if each.kind == "builtin"} == set(builtin_names())
    assert {each.kind for each in INPUTS} > {"found", "large", "malformed"}


def test_every_file_is_read_but_for_the_malformed_ones(tmp_path: Path):
    for each in INPUTS:
        if not each.text or (each.kind == "large" and each.number):
            continue
        path = tmp_path / each.source
        golden.write_input(each, tmp_path)
        if each.kind == "malformed":
            with pytest.raises(SpecError, match=r"\S"):
                load_problem(str(path))
        else:
            tomllib.loads(each.text)
            load_problem(str(path))


def test_a_slice_holds_most_kinds():
    kinds = {each.kind for each in INPUTS}
    fifth = golden.Choice((), 5).inputs()
    assert len({each.kind for each in fifth if each is not None}) > 0.8 * len(kinds)


def test_the_same_recording_has_no_difference(tmp_path: Path):
    base, new = (recorded(tmp_path / name, text="1\n2\n") for name in ("base", "new"))
    assert list(golden.differences(base, new, ["pair-00"])) == []
    assert golden.compare(base, new, ["pair-00"]) == 0


def test_a_changed_line_is_shown_before_and_after(tmp_path: Path):
    base = recorded(tmp_path / "base", text="1\n2\n3\n")
    new = recorded(tmp_path / "new", text="1\n2.5\n3\n")
    (found,) = golden.differences(base, new, ["pair-00"])
    assert found == ("pair-00/certificate/certificate.json", ["@@ -2 +2 @@", "-2", "+2.5"])
    assert golden.compare(base, new, ["pair-00"]) == 1


def test_a_white_space_that_no_line_shows_is_a_difference(tmp_path: Path):
    base = recorded(tmp_path / "base", text="1\n")
    new = recorded(tmp_path / "new", text="1")
    assert golden.compare(base, new, ["pair-00"]) == 1


def test_long_lines_are_shown_where_they_part(tmp_path: Path):
    base = recorded(tmp_path / "base", text="x" * 5000 + "before")
    new = recorded(tmp_path / "new", text="x" * 5000 + "after")
    ((_, lines),) = golden.differences(base, new, ["pair-00"])
    assert lines[1].endswith("xbefore")
    assert lines[2].endswith("xafter")
    assert max(map(len, lines)) < 200


def test_files_and_problems_that_are_missing_are_named(tmp_path: Path):
    base = recorded(tmp_path / "base", text="1")
    new = recorded(tmp_path / "new", text="1")
    recorded(base, text="1", place="again/problem.json")
    recorded(new, text="1", place="designed.toml")
    (base / "other-00").mkdir()
    found = dict(golden.differences(base, new, ["other-00", "pair-00"]))
    assert found == {
        "other-00": ["is not recorded in BASE"],
        "pair-00/again/problem.json": ["is in BASE only"],
        "pair-00/designed.toml": ["is in NEW only"],
    }


def test_nothing_compared_is_no_success(tmp_path: Path):
    assert golden.compare(tmp_path, tmp_path, []) == 1


def test_folder_version_and_fingerprint_are_replaced_and_nothing_else(tmp_path: Path):
    folder = tmp_path / "work"
    target = tmp_path / "kept"
    certificate = folder / "certificate" / "certificate.json"
    certificate.parent.mkdir(parents=True)
    certificate.write_text('{"version": "0.1.0", "rate": 0.1}')
    fingerprint = golden.hashlib.sha256(certificate.read_bytes()).hexdigest()
    said = f"in {folder}/x by dobc_design 0.1.0 and dobc\\_design 0.1.0: {fingerprint}, 0.1.0 1/s"
    (folder / "certify.out").write_text(said)
    golden.keep(folder, target, version="0.1.0")
    word = golden.VERSION
    assert (target / "certify.out").read_text() == (
        f"in {golden.FOLDER}/x by dobc_design {word} and dobc\\_design {word}:"
        f" {golden.FINGERPRINT}, 0.1.0 1/s"
    )
    kept = (target / "certificate" / "certificate.json").read_text()
    assert kept == f'{{"version": "{word}", "rate": 0.1}}'


@pytest.mark.slow
def test_a_recording_is_repeated_byte_for_byte(tmp_path: Path):
    """In other processes, with another order of sets; a certificate and its report are among it."""
    only = ("--only", "labelled-00", "--only", "malformed-loop")
    for name in ("base", "new"):
        command = (sys.executable, golden.__file__, "record", str(tmp_path / name), *only)
        seeded = golden.os.environ | {"PYTHONHASHSEED": str(len(name))}
        ran = subprocess.run(command, env=seeded, capture_output=True, text=True, check=True)
        assert re.search(r"^all +2 +1 +1$", ran.stdout, re.MULTILINE)
    names = ["labelled-00", "malformed-loop"]
    assert golden.compare(tmp_path / "base", tmp_path / "new", names) == 0
    assert (tmp_path / "base" / "labelled-00" / "certificate" / "report.md").exists()
