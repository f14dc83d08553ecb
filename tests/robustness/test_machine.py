"""A machine that refuses: full disks, folders that may not be written, files of a wrong kind,
closed streams.

Where streams, limits or permissions count, a case starts a real process.  It has to leave with the
exit code of the contract (2: what was handed in is wrong, 4: the machine failed), name the key and
the cure, show no traceback, and leave every old file as it was.
"""

import gzip
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from bad_files import listing
from certified import certified

import dobc_design as dd

# About fifty processes, one second each.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="limits, pipes and permissions of Unix"),
]

DOBC = [sys.executable, "-m", "dobc_design"]
# Root may write everywhere, whatever the permissions say; without these two capabilities it may
# not.
AS_ANYBODY = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]


def dobc(
    *arguments: object, before: Sequence[str] = (), **options: Any
) -> subprocess.CompletedProcess[str]:
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    command = [*before, *DOBC, *map(str, arguments)]
    ran = subprocess.run(command, text=True, encoding="utf-8", timeout=60, check=False, **streams)
    for text in (ran.stdout, ran.stderr):
        assert "Traceback" not in (text or "")
        assert "Exception ignored" not in (text or "")
    return ran


def certify(out: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    return dobc("certify", "clock-sync", "--no-report", "--json", "--out", out, **options)


def refusal(ran: subprocess.CompletedProcess[str], code: int) -> dict[str, Any]:
    """The one JSON document on standard output, which is an error with a key and a cure."""
    assert ran.returncode == code
    assert ran.stderr == ""
    error = json.loads(ran.stdout)["error"]
    assert error["key"]
    assert error["cure"]
    return error


@pytest.fixture
def dobc_here(command_line):
    """The same in this process, within a minute, for files that need no process of their own."""

    def late(*_: object) -> None:
        raise TimeoutError

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        before = signal.signal(signal.SIGALRM, late)
        signal.alarm(60)
        try:
            ran = command_line(*arguments)
        finally:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)
        return subprocess.CompletedProcess(arguments, ran.code, ran.out, ran.err)

    return run


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    certified("clock-sync").save(folder)
    return folder


@pytest.fixture
def folder(made, tmp_path) -> Path:
    """A folder of its own with older files: those of a run that said something else."""
    target = tmp_path / "out"
    shutil.copytree(made, target)
    (target / "certificate.json").write_text("old certificate", encoding="utf-8")
    return target


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def unprivileged() -> list[str]:
    if os.geteuid() != 0:
        return []
    if (
        shutil.which("setpriv") is None
        or subprocess.run([*AS_ANYBODY, "true"], check=False).returncode
    ):
        pytest.skip("root may write everywhere, and setpriv is not there or may not take that away")
    return AS_ANYBODY


@pytest.mark.parametrize("size", [0, 1000])
def test_no_room_for_a_file_leaves_the_old_ones(folder, size):
    """A limit on the size of files does to a process what a full disk does; the write fails after
    ``size`` bytes."""
    before = contents(folder)
    told = certify(
        folder, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    )
    error = refusal(told, 4)
    assert ".json cannot be written: File too large" in error["message"]
    assert "--out" in error["cure"]
    assert contents(folder) == before


def test_a_folder_that_may_not_be_written_is_left_alone(folder):
    before = contents(folder)
    folder.chmod(0o555)
    try:
        ran = certify(folder, before=unprivileged())
        error = refusal(ran, 4)
        assert "cannot be written: Permission denied" in error["message"]
        assert contents(folder) == before
        ran = certify(folder / "new", before=unprivileged())
        assert "cannot be made: Permission denied" in refusal(ran, 4)["message"]
    finally:
        folder.chmod(0o755)


@pytest.mark.parametrize("kind", ["file", "link to nowhere", "link to itself", "pipe"])
def test_what_is_no_folder_in_place_of_the_folder_is_a_mistake_told_at_once(
    tmp_path, dobc_here, kind
):
    place = tmp_path / "out"
    if kind == "file":
        place.write_text("mine", encoding="utf-8")
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(place if kind == "link to itself" else tmp_path / "nowhere")
    ran = dobc_here("certify", "clock-sync", "--no-report", "--json", "--out", place)
    error = refusal(ran, 2)
    assert error["key"] == "--out"
    assert "is not a folder" in error["message"]
    assert listing(tmp_path) == ["out"]


def test_a_link_in_place_of_a_file_is_replaced_and_its_target_left_alone(folder, tmp_path):
    mine = tmp_path / "mine.json"
    mine.write_text("mine", encoding="utf-8")
    for name, target in (("certificate.json", mine), ("problem.json", tmp_path / "nowhere")):
        (folder / name).unlink()
        (folder / name).symlink_to(target)
    # whose results are these?
    assert dobc("certify", "clock-sync", "--no-report", "--out", folder).returncode == 2
    assert dobc("certify", "clock-sync", "--no-report", "--out", folder, "--force").returncode == 0
    assert mine.read_text(encoding="utf-8") == "mine"
    assert not (folder / "certificate.json").is_symlink()
    certificate = (folder / "certificate.json").read_bytes()
    assert dd.verify(certificate, folder / "problem.json").holds


def bound_socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the path of a socket must be short
    try:
        socket.socket(socket.AF_UNIX).bind(path.name)
    finally:
        os.chdir(here)


KINDS: dict[str, Callable[[Path], object]] = {
    "nothing": lambda path: None,
    "directory": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "link to nowhere": lambda path: path.symlink_to(path.with_name("nowhere")),
    "link to itself": lambda path: path.symlink_to(path),
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "socket": bound_socket,
    "empty": lambda path: path.touch(),
    "noise": lambda path: path.write_bytes(bytes(range(256)) * 100),
    # nobody unpacks it
    "a gzip bomb": lambda path: path.write_bytes(gzip.compress(b"0" * 50_000_000)),
}


@pytest.mark.parametrize(
    ("suffix", "kind"), [*product(["toml"], KINDS), ("json", "pipe"), ("json", "endless")]
)
def test_what_is_no_problem_file_is_refused_at_once(tmp_path, dobc_here, kind, suffix):
    path = tmp_path / f"problem.{suffix}"
    KINDS[kind](path)
    before = listing(tmp_path)
    ran = dobc_here("certify", path, "--json")
    assert ran.returncode == 2
    error = json.loads(ran.stdout)["error"]
    assert error["kind"] == "spec"
    assert error["cure"]
    assert listing(tmp_path) == before


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_certificate_is_refused_at_once(tmp_path, dobc_here, made, kind):
    path = tmp_path / "certificate.json"
    KINDS[kind](path)
    ran = dobc_here("verify", path, "--problem", made / "problem.json", "--json")
    assert ran.returncode == 2
    error = json.loads(ran.stdout)["error"]
    assert error["cure"]


def test_files_that_may_not_be_read_are_mistakes(folder, tmp_path):
    for name in ("certificate.json", "problem.json"):
        (folder / name).chmod(0)
    before = unprivileged()
    told = dobc("check", folder / "problem.json", "--json", before=before)
    error = refusal(told, 2)
    assert "cannot be read: Permission denied" in error["message"]
    error = refusal(dobc("verify", folder, "--problem", "clock-sync", "--json", before=before), 2)
    assert "cannot be read: Permission denied" in error["message"]


COMMANDS = [
    ("check", "clock-sync"),
    ("check", "clock-sync", "--json"),
    ("--help",),
    ("certify", "clock-sync", "--no-report"),
    ("certify", "clock-sync", "--no-report", "--json"),
    ("verify", "made", "--problem", "clock-sync"),
]
MORE = [("problems",), ("schema",), ("explain", "theorem1"), ("--version",)]


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        *product(["full"], COMMANDS),
        *product(["closed", "nobody reads"], COMMANDS[-3::2]),
        *(pytest.param("full", each, marks=pytest.mark.evidence) for each in MORE),
    ],
)
def test_an_answer_that_cannot_be_written_is_the_machines_failure(tmp_path, made, command, kind):
    """Exit 1 and 3 are answers, so they must not come from a pipe that broke."""
    arguments = [made if word == "made" else word for word in command]
    if kind == "full":
        if not Path("/dev/full").exists():
            pytest.skip("there is no full device")
        with Path("/dev/full").open("w", encoding="utf-8") as full:
            ran = dobc(*arguments, cwd=tmp_path, stdout=full)
    elif kind == "closed":
        ran = dobc(
            *arguments, cwd=tmp_path, stdout=None, before=["sh", "-c", 'exec "$@" >&-', "sh"]
        )
    else:
        reading, writing = os.pipe()
        os.close(reading)
        ran = dobc(*arguments, cwd=tmp_path, stdout=writing)
        os.close(writing)
    if kind == "nobody reads":  # as of other programs: 128 + SIGPIPE, and not a word
        assert ran.returncode == 141
        assert ran.stderr == ""
    else:
        assert ran.returncode == 4
        assert "error: standard output cannot be written" in ran.stderr
    for path in tmp_path.glob("*/certificate.json"):
        assert dd.verify(path.read_bytes(), "clock-sync").holds


def test_a_reader_that_takes_one_line_sees_no_traceback(tmp_path):
    command = ["sh", "-c", '"$@" | head -1', "sh", *DOBC, "schema"]
    ran = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True, check=False)
    assert ran.stdout == "{\n"
    assert ran.stderr == ""


@pytest.mark.parametrize(
    ("command", "code", "redirection"),
    [
        (("certify", "clock-sync", "--no-report"), 0, "<&- 2>&-"),
        (("--wrong",), 2, "2>/dev/full"),
        *((("check", "nowhere"), 2, each) for each in ("2>&-", "2>/dev/full", "<&- 2>&-")),
    ],
)
def test_nobody_listening_on_standard_error_changes_no_exit_code(
    tmp_path, redirection, command, code
):
    ran = dobc(*command, cwd=tmp_path, before=["sh", "-c", f'exec "$@" {redirection}', "sh"])
    assert ran.returncode == code
    for path in tmp_path.glob("*/certificate.json"):
        assert dd.verify(path.read_bytes(), "clock-sync").holds
