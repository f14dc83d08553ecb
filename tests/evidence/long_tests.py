"""The tests marked `evidence`, which take a quarter of a minute or more each."""

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
    said = subprocess.run(command, capture_output=True, check=False, text=True, cwd=ROOT).stdout
    failures = re.findall(r"^(?:FAILED|ERROR) .*", said, re.MULTILINE)
    done = sum(map(int, re.findall(r"([0-9]+) (?:passed|failed|skipped)", said.splitlines()[-1])))
    return Row("tests marked evidence: all pass", done, failures, least=count)
