"""Sweeps in real processes that are killed on the way, and what has to be the same in the end."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

# s that anything here may take, on a machine that is busy, before it counts as hanging
LONGEST = 1800.0


def axes(count: int) -> list[str]:
    """A grid with draws of about ``count`` cases: proved, refuted, undecided and failing ones among
    them."""
    samples = max(1, count // 20)
    return [
        "pinning.gains.3=0:4:5",
        "coupling.h=y,tanh(y),-y,y+1",
        "network.modes.G[0][2]=~uniform(0.1,2)",
        "--samples",
        str(samples),
        "--seed",
        "3",
    ]


def command(file: Path, out: Path, *options: str, count: int) -> list[str]:
    return [
        sys.executable,
        "-m",
        "dobc_design",
        "sweep",
        str(file),
        *axes(count),
        "--out",
        str(out),
        *options,
    ]


def start(file: Path, out: Path, *options: str, count: int) -> subprocess.Popen[bytes]:
    """Begin a sweep in a session of its own."""
    return subprocess.Popen(
        command(file, out, *options, count=count),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )


def lines(out: Path) -> list[dict[str, Any]]:
    """The journal as it stands, without a torn last line."""
    path = out / "results.jsonl"
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_bytes().split(b"\n")[:-1]]


def wait_for(out: Path, least: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until so many cases are finished, or the process ends."""
    end = time.monotonic() + LONGEST
    while len(lines(out)) < least and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)


def kill(process: subprocess.Popen[bytes]) -> None:
    """kill -9, of the driver alone."""
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=LONGEST)


def finish(process: subprocess.Popen[bytes]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=LONGEST)
    return process.returncode, out.decode(), err.decode()


def children(pid: int) -> list[int]:
    """Processes that descend from this one (Linux)."""
    found: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, ValueError):  # it has just ended
                continue
            found.setdefault(parent, []).append(int(entry.name))
    queue, all_of_them = [pid], []
    while queue:
        own = found.get(queue.pop(), [])
        all_of_them += own
        queue += own
    return all_of_them


def words_of(pid: int) -> str:
    """The command line of a process."""
    try:
        return (
            Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        )
    except OSError:
        return ""


def without_times(given: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Lines in the order of the cases, without how long they took."""
    return [
        {key: x for key, x in line.items() if key != "seconds"}
        for line in sorted(given, key=lambda x: x["case"])
    ]
