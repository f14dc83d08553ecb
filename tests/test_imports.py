"""Importing the package, and asking the command line for help, must not load the heavy packages.

`import control` and `import cvxpy` alone cost about a second each; a first look should not.
"""

import json
import subprocess
import sys

HEAVY = ("cvxpy", "control", "casadi", "matplotlib", "networkx", "sympy")

HELP = """
import sys
from dobc_design.cli.main import main
sys.argv = ["dobc", "--help"]
try:
    main()
except SystemExit as stop:
    if stop.code not in (0, None):
        raise
"""

REPORT = f"""
import json, sys
sys.stderr.write(json.dumps([name for name in {HEAVY!r} if name in sys.modules]))
"""


def run(script: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a fresh interpreter."""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done


def heavy_packages_after(script: str) -> list[str]:
    return json.loads(run(script + REPORT).stderr)


def test_neither_importing_nor_asking_for_help_loads_a_heavy_package():
    assert heavy_packages_after("import dobc_design, dobc_design.analysis.analysis") == []
    assert heavy_packages_after(HELP) == []
    assert heavy_packages_after("import sympy") == ["sympy"]
