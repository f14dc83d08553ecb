"""The tests marked `evidence`, which take long."""

import re
import subprocess
import sys
from pathlib import Path

from evidence.row import Row

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = ("-q", "-m", "evidence", "-rfE", "-p", "no:cacheprovider", "--benchmark-disable")


def run(count: int, seed: int) -> Row:
    """All of them; nothing is drawn."""
    command = [sys.executable, "-m", "pytest", *OPTIONS, "-n", "2", "--dist", "worksteal"]
    ran = subprocess.run(command, capture_output=True, check=False, text=True, cwd=ROOT)
    failures = re.findall(r"^(?:FAILED|ERROR) .*", ran.stdout, re.MULTILINE)
    failures += [ran.stdout[-1000:] + ran.stderr[-1000:]] if ran.returncode and not failures else []
    done = sum(map(int, re.findall(r"([0-9]+) (?:passed|failed)", ran.stdout)))
    return Row("tests marked evidence: all pass", done, failures, least=count)
