"""Killed, interrupted, terminated: at every moment each file is the old one or the new one, and
whole."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from processes import Runs, environment, interrupt_certify, leftovers

import dobc_design as dd
from dobc_design.certificate.files import STALE, write_atomically, write_together
from dobc_design.errors import CertificateError

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of Unix")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_certify_says_so_and_leaves_a_whole_set(tmp_path, number):
    """130 for Ctrl-C, 143 for SIGTERM; no traceback, also in the first moments, while everything is
    imported."""
    outcome = interrupt_certify(2, 3, tmp_path, number=number)
    assert not outcome.wrong
    assert outcome.counts["interrupted"] == 2


@pytest.mark.parametrize("milliseconds", [1, 15, 30, 50])
def test_sigterm_in_the_first_moments_ends_at_once_without_a_word_of_python(
    tmp_path, milliseconds: int
):
    command = [
        sys.executable,
        "-m",
        "dobc_design",
        "certify",
        "paper-fixed",
        "--out",
        str(tmp_path / "out"),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        time.sleep(milliseconds / 1000)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
    assert process.returncode in (-signal.SIGTERM, 128 + signal.SIGTERM)
    assert b"Traceback" not in said
    assert not (tmp_path / "out").exists()


HIT = """
import os, signal, sys
from dobc_design import __main__
from pathlib import Path
from dobc_design.certificate.files import write_together
folder, hit, replace = Path(sys.argv[1]), int(sys.argv[2]), os.replace
count = 0
def struck(*paths):
    global count
    count += 1
    if count == hit:
        signal.raise_signal(signal.SIGINT)
    replace(*paths)
os.replace = struck
write_together({folder / name: b"new" for name in ("a", "b", "c")}, without=[folder / "old"])
print("it went on")
"""


@pytest.mark.parametrize("hit", [1, 2, 3])
def test_a_signal_during_a_write_waits_for_its_end(tmp_path, hit: int):
    """The signal comes between two files that change together, and yet the set is never mixed."""
    for name in ("a", "b", "c", "old"):
        (tmp_path / name).write_bytes(b"old")
    command = [sys.executable, "-c", HIT, str(tmp_path), str(hit)]
    done = subprocess.run(command, capture_output=True, check=False, timeout=120)
    assert done.returncode == 130
    assert done.stdout == b""
    assert done.stderr == b"Interrupted; no file was left half written.\n"
    contents = [(tmp_path / name).read_bytes() for name in ("a", "b", "c")]
    assert contents == [b"new"] * 3
    assert leftovers(tmp_path) == []
    assert not (tmp_path / "old").exists()


@pytest.mark.slow
def test_ctrl_c_of_a_group_reaches_everybody_and_nobody_hangs(tmp_path):
    """A terminal sends it to the whole group; the process has threads of linear algebra by then."""
    runs = Runs(tmp_path, report=False)
    out = tmp_path / "out"
    process = runs.start(1, out, "--json")
    process.stderr.read(1)
    time.sleep(runs.seconds / 3)
    os.killpg(process.pid, signal.SIGINT)
    printed, said = process.communicate(timeout=20)
    if process.returncode == 130:
        assert said == b""
        assert json.loads(printed)["error"]["kind"] == "interrupted"
    # 1: refuted, it was faster; a shell calls both others 130: handled, or while Python was ending
    assert process.returncode in (130, -signal.SIGINT, 1)


@pytest.mark.slow
def test_an_ignored_interrupt_stays_ignored(tmp_path):
    """A shell starts background jobs with Ctrl-C ignored, nohup does so with SIGHUP."""
    command = [
        sys.executable,
        "-m",
        "dobc_design",
        "certify",
        "paper-fixed",
        "--no-report",
        "--out",
        str(tmp_path),
    ]
    with subprocess.Popen(
        ["sh", "-c", 'trap "" INT HUP; exec "$@"', "sh", *command],
        stdout=subprocess.PIPE,
        env=environment(),
    ) as process:
        for _ in range(20):
            time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGHUP)
        process.communicate(timeout=60)
    assert process.returncode == 0
    assert dd.verify((tmp_path / "certificate.json").read_bytes(), "paper-fixed").holds


def test_what_killed_writers_left_is_removed_by_a_later_one(tmp_path):
    """After an hour, when no writer can be at work on it any more; other files are never
    touched."""
    left = [
        f".{name}.dobc-tmp"
        for name in ("certificate.json.0123", "certificate.json.4567", "other.json.0123")
    ]
    names = [*left, ".certificate.json.mine", "certificate.json.dobc-tmp"]
    for name in names:
        (tmp_path / name).write_bytes(b"x")
        if name != ".certificate.json.4567.dobc-tmp":
            os.utime(tmp_path / name, (time.time() - STALE - 60,) * 2)
    write_atomically(tmp_path / "certificate.json", b"new")
    expected = sorted([*names[1:], "certificate.json"])
    assert sorted(path.name for path in tmp_path.iterdir()) == expected


def test_all_files_are_as_before_when_one_cannot_be_written(tmp_path):
    old = {name: name.encode() for name in ("a", "b")}
    for name, data in old.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "c").mkdir()
    with pytest.raises(CertificateError, match="c cannot be written: Is a directory"):
        write_together({tmp_path / name: b"new" for name in ("a", "b", "c")})
    assert {name: (tmp_path / name).read_bytes() for name in old} == old
    assert leftovers(tmp_path) == []


def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path):
    mask = os.umask(0o027)
    try:
        write_atomically(tmp_path / "x", b"")
    finally:
        os.umask(mask)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o640


def test_a_long_name_is_written_like_any_other(tmp_path):
    name = "é" * 120 + ".json"
    write_atomically(tmp_path / name, b"x")
    assert [path.name for path in tmp_path.iterdir()] == [name]
