"""The notebooks, and what comes of running one from a clean kernel."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LONG = ("02", "03", "04", "09", "10")  # a quarter of a minute each, or more
OPTIONS = (
    "--nbmake",
    "--nbmake-timeout=240",
    "-q",
    "-p",
    "no:cacheprovider",
    "--override-ini=addopts=",
)


def failure_of(path: Path) -> str:
    """What nbmake says that executes every cell in a fresh process, up to the first error; empty
    without one."""
    command = [sys.executable, "-m", "pytest", *OPTIONS, "-o", "testpaths=", str(path)]
    environment = {**os.environ, "MPLBACKEND": "Agg", "JUPYTER_PLATFORM_DIRS": "1"}
    done = subprocess.run(
        command, capture_output=True, check=False, text=True, timeout=300, env=environment, cwd=ROOT
    )
    passed = done.returncode == 0 and "1 passed" in done.stdout
    if passed:
        return ""
    return done.stdout[-3000:] + done.stderr[-1000:]
