"""On a terminal and off it: colours, --quiet, --verbose, and Ctrl-C during a sweep."""

import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from problem_texts import CHAIN
from processes import LONGEST

from dobc_design._signals import _DOCUMENT, _escaped
from dobc_design.cli.main import main

pytestmark = pytest.mark.skipif(os.name == "nt", reason="terminals of Unix")
COLOUR = re.compile(r"\x1b\[[0-9;]*?(?:3[0-7]|9[0-7])m")


def on_a_terminal(
    *arguments: str, cwd: Path, interrupt: Path | None = None, **environment: str
) -> tuple[int, str]:
    """Run dobc with a pseudo terminal as its input and outputs: exit code, all that it wrote.

    ``interrupt``: Ctrl-C is typed as soon as this file holds something.
    """
    import pty

    pid, terminal = pty.fork()
    if pid == 0:
        try:
            os.chdir(cwd)
            known = {**os.environ, "TERM": "xterm-256color", **environment}
            command = [sys.executable, "-m", "dobc_design", *arguments]
            os.execve(sys.executable, command, {key: x for key, x in known.items() if x})
        finally:
            os._exit(99)
    written = b""
    typed = False
    end = time.monotonic() + LONGEST
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.05)[0]:
            try:
                piece = os.read(terminal, 65536)
            except OSError:  # the other side is closed
                break
            if not piece:
                break
            written += piece
        if interrupt is not None and not typed and interrupt.exists() and interrupt.stat().st_size:
            os.write(terminal, b"\x03")
            typed = True
    else:
        os.kill(pid, signal.SIGKILL)
    os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), written.decode(
        "utf-8", errors="replace"
    )


@pytest.fixture
def chain(tmp_path) -> Path:
    path = tmp_path / "chain.toml"
    path.write_text(CHAIN, encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_terminal_gets_colours_unless_no_color_is_set(chain):
    code, shown = on_a_terminal(
        "certify", "chain.toml", "--no-report", cwd=chain.parent, NO_COLOR=""
    )
    assert code == 0
    assert COLOUR.search(shown)
    assert "PROVED" in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
    for environment in ({"NO_COLOR": "1"}, {"NO_COLOR": "", "TERM": "dumb"}):
        code, shown = on_a_terminal(
            "certify", "chain.toml", "--no-report", cwd=chain.parent, **environment
        )
        assert code == 0
        assert not COLOUR.search(shown), environment
        assert "PROVED" in shown


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dobc_design", *arguments]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, timeout=LONGEST
    )


@pytest.mark.slow
def test_a_pipe_gets_no_escape_sequences_quiet_nothing_and_verbose_the_stages(chain):
    plain = run("certify", "chain.toml", "--no-report", cwd=chain.parent)
    assert "\x1b" not in plain.stdout
    assert plain.returncode == 0
    assert plain.stderr == ""
    quiet = run("certify", "chain.toml", "--no-report", "-q", cwd=chain.parent)
    assert quiet.returncode == 0
    assert quiet.stdout == ""
    assert quiet.stderr == ""
    verbose = run("certify", "chain.toml", "--no-report", "-v", cwd=chain.parent)
    assert verbose.stdout == plain.stdout
    stages = verbose.stderr.splitlines()
    assert len(stages) >= 2
    for line in stages:
        assert re.fullmatch(r" +\d+\.\d s  \S.*", line)


@pytest.mark.parametrize(
    "command", [["certify"], ["region"], ["simulate"], ["sweep", "coupling.h=y"]]
)
def test_quiet_and_verbose_exclude_each_other(chain, command, capsys, monkeypatch):
    monkeypatch.chdir(chain.parent)
    with pytest.raises(SystemExit) as caught:
        main([command[0], "chain.toml", *command[1:], "-q", "-v", "--json"])
    error = json.loads(capsys.readouterr().out)["error"]
    assert caught.value.code == 2
    assert error["key"] == "--quiet"
    assert [path.name for path in chain.parent.iterdir()] == ["chain.toml"]


@pytest.mark.slow
def test_ctrl_c_ends_a_sweep_with_130_and_says_how_to_go_on(chain):
    """Typed at the terminal, so that it reaches the workers as well: none of them says a word, none
    stays."""
    options = ("sweep", "chain.toml", "pinning.gains.3=1:5:4000", "--jobs", "2", "--out", "out")
    code, shown = on_a_terminal(
        *options, cwd=chain.parent, interrupt=chain.parent / "out/results.jsonl"
    )
    words = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
    assert code == 130
    assert "Interrupted; the finished cases are kept in 'out'." in words
    assert "dobc sweep chain.toml pinning.gains.3=1:5:4000 --jobs 2 --out out" in words
    assert "Traceback" not in words
    assert "leaked" not in words
    kept = (chain.parent / "out/results.jsonl").read_bytes()
    assert 1 <= len(kept.splitlines()) < 4000


def test_the_document_of_an_interrupt_is_json_whatever_it_has_to_say():
    """It is put together by hand, because a signal handler may not ask the json module."""
    sentence = "kept in 'a\"b\\c'.\nThe same command goes on:\n  dobc sweep ä"
    error = json.loads(_DOCUMENT.format(_escaped(sentence)))["error"]
    assert error["kind"] == "interrupted"
    assert error["message"] == sentence
    assert json.loads(_DOCUMENT.format(_escaped("\x00\x1b")))["error"]["message"] == "??"
