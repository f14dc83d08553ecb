"""How many examples Hypothesis draws, that CI draws the same ones every time, and signals for child processes."""

from __future__ import annotations

import os
import signal

import pytest

# Two processes of tests fill two cores; threads of linear algebra inside each would only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

# No deadline: a first call may import a large package, which is slow and not a defect.
settings.register_profile("fast", max_examples=50, deadline=None)
settings.register_profile("ci", parent=settings.get_profile("fast"), derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "fast")

# A shell starts background jobs with Ctrl-C ignored, nohup does so with SIGHUP, and children inherit that.  What a
# handler catches they do not inherit: programs under test hear signals again, and the tests still ignore them.
for _number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, lambda number, frame: None)

# The regions of these built-in problems take seconds to certify and to check.
_LONG = (
    "karate-club",
    "microgrid-ieee14",
    "uav-swarm",
    "01_example",
    "02_regions",
    "03_simulation",
    "04_design",
    "05_switching",
    "06_from_grid",
    "07_infeasible",
    "08_sweep",
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of problems that take long as slow, wherever all built-in problems are gone through."""
    for item in items:
        if any(name in item.name for name in _LONG):
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def command_line(capsys, tmp_path, monkeypatch):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    from dobc_design.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return int(str(caught.value.code)), captured.out, captured.err

    return run
