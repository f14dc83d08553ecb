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
sys.stderr.write(json.dumps([name for name in {HEAVY!r} if name in sys.modules]) + "\\n")
"""


def heavy_packages_after(*scripts: str) -> list[list[str]]:
    """What is loaded after each of these scripts, run in turn in one fresh interpreter."""
    command = [sys.executable, "-c", "".join(script + REPORT for script in scripts)]
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stderr.splitlines()]


def test_neither_importing_nor_asking_for_help_loads_a_heavy_package():
    look = "import dobc_design, dobc_design.analysis.analysis"
    assert heavy_packages_after(look, HELP, "import networkx") == [[], [], ["networkx"]]
