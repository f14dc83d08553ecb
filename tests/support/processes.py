"""Real processes, runs and sweeps, that are killed or interrupted at random moments, and what has
to be true of their folders.

A folder always holds the complete files of a first run before a second run, of another problem,
begins to replace them.  So every file can be compared with the two it may be."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from problem_texts import without_region_text

import dobc_design as dd

# One byte on standard error says that the first line of the program's own entry module has run.
MARKED = "import os; from dobc_design.__main__ import main; os.write(2, b'.'); main()"

LOOP = """
import hashlib, sys
from pathlib import Path
from dobc_design.certificate.files import write_together
folder, size = Path(sys.argv[1]), int(sys.argv[2])
def content(name, k):
    body = f"{name} {k} ".encode() * size
    return hashlib.sha256(body).hexdigest().encode() + body
print(flush=True)
k = 0
while True:
    k += 1
    names = ("problem.json", "certificate.json", "report.html")
    write_together({folder / name: content(name, k) for name in names})
"""

NAMES = ("problem.json", "certificate.json", "report.html", "report.md")
PIN = "gains = { 1 = 5, 6 = 5 }"


@dataclass
class Outcome:
    """What was found, counted; ``wrong`` has one text per violation."""

    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def environment() -> dict[str, str]:
    """One thread for linear algebra: many processes run at once."""
    return os.environ | dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
    )


def kill_writers(count: int, seed: int, folder: Path) -> Outcome:
    """kill -9 a process that does nothing but replace three files, at a random moment, ``count``
    times."""
    outcome = Outcome()
    r = Random(seed)
    for k in range(count):
        with subprocess.Popen(
            [sys.executable, "-c", LOOP, str(folder), str(r.choice((10, 1000, 50_000)))],
            stdout=subprocess.PIPE,
        ) as process:
            process.stdout.readline()  # its imports are done
            time.sleep(r.uniform(0.002, 0.06))
            process.kill()
        numbers = []
        for name in ("problem.json", "certificate.json", "report.html"):
            path = folder / name
            if not path.exists():
                numbers.append(0)
                continue
            data = path.read_bytes()
            if hashlib.sha256(data[64:]).hexdigest().encode() != data[:64]:
                outcome.wrong.append(f"kill {k}: {name} is broken")
            numbers.append(int(data[64:].split(maxsplit=2)[1]))
        outcome.counts["mixed sets"] += len(set(numbers)) > 1
        outcome.counts["kills in the middle of a write"] += bool(leftovers(folder))
        for name in leftovers(folder):
            (folder / name).unlink()
    return outcome


def leftovers(folder: Path) -> list[str]:
    """Temporary files of ours."""
    return sorted(path.name for path in folder.glob(".*.dobc-tmp"))


class Runs:
    """Two problems with other answers, the files a whole run writes for each, and how long a run
    takes."""

    def __init__(self, folder: Path, *, report: bool) -> None:
        self.folder = folder
        self.options = () if report else ("--no-report",)
        self.names = NAMES if report else NAMES[:2]
        self.problems: list[Path] = []
        folder.mkdir(exist_ok=True)
        self.whole: list[dict[str, bytes]] = []
        self.seconds = 0.0
        short = without_region_text("paper-fixed")
        texts = [short, short.replace(PIN, "gains = {}")]
        for k, text in enumerate(texts):
            self.problems.append(folder / f"{k}.toml")
            self.problems[k].write_text(text, encoding="utf-8")
            started = time.perf_counter()
            with self.start(k, folder / "whole") as process:
                process.communicate()
            self.seconds = time.perf_counter() - started
            self.whole.append({name: (folder / "whole" / name).read_bytes() for name in self.names})

    def start(self, which: int, out: Path, *options: str) -> subprocess.Popen[bytes]:
        """Begin to certify one of the problems, replacing what is in ``out``."""
        command = ["certify", str(self.problems[which]), "--out", str(out), *self.options, *options]
        return subprocess.Popen(
            [sys.executable, "-c", MARKED, *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment(),
            start_new_session=True,
        )

    def fill(self, which: int, out: Path) -> None:
        """The complete files of one problem."""
        out.mkdir(exist_ok=True)
        for name, data in self.whole[which].items():
            (out / name).write_bytes(data)

    def which(self, out: Path) -> list[int]:
        """Of which run every file is; -1 for none of them."""
        found = []
        for name in self.names:
            data = (out / name).read_bytes() if (out / name).exists() else b""
            found.append(next((k for k, files in enumerate(self.whole) if files[name] == data), -1))
        return found

    def judge(self, out: Path, outcome: Outcome, label: str) -> None:
        """Every file is old or new and complete; the certificate holds for its own problem and for
        no other."""
        found = self.which(out)
        outcome.wrong += [
            f"{label}: {name} is broken" for name, k in zip(self.names, found, strict=True) if k < 0
        ]
        if -1 in found:
            return
        certificate = (out / "certificate.json").read_bytes()
        mixed = found[0] != found[1]
        outcome.counts["mixed sets"] += len(set(found)) > 1
        outcome.counts["new"] += set(found) == {1}
        outcome.counts["old"] += set(found) == {0}
        own = dd.verify(certificate, self.problems[found[1]])
        beside = dd.verify(certificate, out / "problem.json")
        if not own.holds:
            outcome.wrong.append(f"{label}: the certificate that stands there does not hold")
        if beside.holds is mixed:
            outcome.wrong.append(f"{label}: verify takes the problem beside it wrongly")
        if mixed and not any("another problem" in text for text in beside.failures):
            outcome.wrong.append(f"{label}: the mixed pair is not called one")


def kill_certify(count: int, seed: int, folder: Path, *, report: bool) -> Outcome:
    """kill -9 a certify that replaces the files of another problem; half of the kills aim at its
    writing.

    Two at a time: most of the time is the programs' own.
    """
    runs = Runs(folder, report=report)
    with ThreadPoolExecutor(max_workers=2) as pool:
        outcomes = pool.map(lambda k: _kill_one(runs, k, Random(seed + k)), range(count))
        total = Outcome()
        for outcome in outcomes:
            total.counts += outcome.counts
            total.wrong += outcome.wrong
    # Whatever stands there, another run puts it right.
    with runs.start(1, folder / "killed0") as process:
        process.communicate()
    if runs.which(folder / "killed0") != [1] * len(runs.names):
        total.wrong.append("running again does not put it right")
    return total


def _kill_one(runs: Runs, k: int, r: Random) -> Outcome:
    outcome = Outcome()
    out = runs.folder / f"killed{k}"
    runs.fill(0, out)
    with runs.start(1, out) as process:
        if k % 2:
            while not leftovers(out) and process.poll() is None:
                time.sleep(0.0002)
            time.sleep(r.choice((0, 0, 0, r.uniform(0, 0.003))))
        else:
            time.sleep(r.uniform(0, 1.1 * runs.seconds))
        process.kill()
        process.communicate()
    outcome.counts["kills in the middle of a write"] += bool(leftovers(out))
    runs.judge(out, outcome, f"kill {k}")
    return outcome


def interrupt_certify(
    count: int, seed: int, folder: Path, *, number: int = signal.SIGINT, report: bool = False
) -> Outcome:
    """Interrupt certify at random moments after its first line, until it was ``count`` times before
    its end.

    A third of the moments lie in the first 0.1 s, while everything is imported.
    """
    outcome = Outcome()
    r = Random(seed)
    runs = Runs(folder, report=report)
    longest = runs.seconds
    for k in range(5 * count):
        if outcome.counts["interrupted"] == count:
            break
        out = folder / f"interrupted{k}"
        runs.fill(0, out)
        options = ("--json",) if k % 2 else ()
        with runs.start(1, out, *options) as process:
            process.stderr.read(1)
            time.sleep(r.uniform(0, 0.1) if k % 3 == 0 else r.uniform(0, longest))
            process.send_signal(number)
            try:
                printed, said = process.communicate(timeout=60)
            except subprocess.TimeoutExpired:
                process.kill()
                printed, said = process.communicate()
                outcome.wrong.append(f"signal {k}: it hangs")
        if process.returncode == 128 + number:
            outcome.counts["interrupted"] += 1
            if b"Interrupted; no file was left half written." not in (
                printed if options and printed else said
            ):
                outcome.wrong.append(f"signal {k}: it does not say so")
        # it came after the answer; other loads, other times
        elif process.returncode in (0, 1, -number):
            outcome.counts["had ended"] += 1
            longest *= 0.8
        else:
            outcome.wrong.append(f"signal {k}: exit code {process.returncode}")
        if b"Traceback" in said or b"Traceback" in printed or b"Exception ignored" in said:
            outcome.wrong.append(f"signal {k}: a traceback: {said[-300:]!r}")
        if leftovers(out):
            outcome.wrong.append(f"signal {k}: it left {leftovers(out)}")
        if len(set(runs.which(out))) > 1:
            outcome.wrong.append(f"signal {k}: a set that is mixed")
        runs.judge(out, outcome, f"signal {k}")
    return outcome


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
    found = []
    for line in path.read_bytes().split(b"\n")[:-1]:
        found.append(json.loads(line))
    return found


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
                stat = (entry / "stat").read_text().rpartition(")")
                parent = int(stat[2].split()[1])
            except (OSError, ValueError):  # it has just ended
                continue
            found.setdefault(parent, []).append(int(entry.name))
    queue = [pid]
    all_of_them = []
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
    found = []
    for line in sorted(given, key=lambda x: x["case"]):
        facts = {key: x for key, x in line.items() if key != "seconds"}
        found.append(facts)
    return found
