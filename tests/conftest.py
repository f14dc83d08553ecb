"""How many examples Hypothesis draws, that CI draws the same ones every time, and what all workers
of a run share."""

import gc
import json
import os
import shutil
import tempfile
import time
from random import Random
from typing import Any, NamedTuple

import pytest
from machine import let_children_hear

# Two processes of tests fill two cores; threads of linear algebra inside each would only wait for
# one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from certified import FOLDER
from hypothesis import settings
from machine import kernels, versions

from dobc_design import Exosystem, Network, Problem

# No deadline: a first call may import a large package, which is slow and not a defect.
settings.register_profile("fast", max_examples=40, deadline=None)
settings.register_profile(
    "ci", parent=settings.get_profile("fast"), derandomize=True, print_blob=True
)
settings.load_profile("ci" if os.environ.get("CI") else "fast")

let_children_hear()

_SHARED, _BEGAN = pytest.StashKey[str](), pytest.StashKey[float]()
_TOOK = "dobc/seconds of the fast tests"
_FAST = "not slow and not evidence"  # of pyproject.toml


def pytest_configure(config: pytest.Config) -> None:
    """The process that begins a run makes the folder that its workers share."""
    if FOLDER not in os.environ:
        config.stash[_SHARED] = os.environ[FOLDER] = tempfile.mkdtemp(prefix="dobc-tests-")


def pytest_unconfigure(config: pytest.Config) -> None:
    if folder := config.stash.get(_SHARED, None):
        shutil.rmtree(folder, ignore_errors=True)
        os.environ.pop(FOLDER)


def pytest_report_header(config: pytest.Config) -> list[str]:
    """What is tested with, and how long it takes here: known after the first run."""
    lines = [versions(), kernels()]
    if _is_whole(config):
        cache = getattr(config, "cache", None)  # None with -p no:cacheprovider
        took = cache and cache.get(_TOOK, None)
        known = f"{took:.0f} s here the last time" if took else "one to three minutes on two cores"
        lines.append(f"The fast tests: {known}.")
    return lines


def pytest_sessionstart(session: pytest.Session) -> None:
    session.config.stash[_BEGAN] = time.monotonic()


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    config = session.config
    cache = getattr(config, "cache", None)
    if cache and _is_whole(config) and exitstatus == pytest.ExitCode.OK:
        cache.set(_TOOK, time.monotonic() - config.stash[_BEGAN])


def _is_whole(config: pytest.Config) -> bool:
    """All fast tests, asked for by the process that begins the run."""
    option = config.option
    chosen = (
        option.keyword or option.collectonly or option.markexpr != _FAST or config.args != ["tests"]
    )
    return not chosen and not hasattr(config, "workerinput")


def pytest_collection_finish() -> None:
    """What has been imported stays: the garbage collector need not look at it again and again, nor
    at the fractions of exact arithmetic, which go without it."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)


# The regions of these built-in problems take seconds to certify and to check.
_LONG = ("karate-club", "microgrid-ieee14", "uav-swarm")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of problems that take long as slow, wherever all built-in problems are gone
    through."""
    for item in items:
        if any(name in item.name for name in _LONG):
            item.add_marker(pytest.mark.slow)


class Ran(NamedTuple):
    """What one call of the command line left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as the one JSON document that it must be."""
        return json.loads(self.out)


@pytest.fixture
def command_line(capsys, tmp_path, monkeypatch):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    from dobc_design.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Ran:
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        assert isinstance(caught.value.code, int)
        return Ran(caught.value.code, captured.out, captured.err)

    return run


# Problems and exosystems that the tests of several rooms share.
HARMONIC = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])


@pytest.fixture
def harmonic() -> Exosystem:
    """The paper's pair (A, C): a sine of 2 rad/s."""
    return HARMONIC


@pytest.fixture
def cycle():
    """A directed cycle of n agents, the paper's coupling, chosen pins."""

    def make(
        n: int = 4,
        *,
        pins: Any = None,
        exosystem: Exosystem = HARMONIC,
        coupling: Any = "exp(y) - 1 + y",
    ) -> Problem:
        return Problem(
            network=Network.from_arcs(
                [[i, i % n + 1] for i in range(1, n + 1)], arrow="listens_to", agents=n
            ),
            coupling=coupling,
            gains={1: 3} if pins is None else pins,
            exosystem=exosystem,
            target=[0] * exosystem.outputs,
        )

    return make


@pytest.fixture
def separable():
    """Random problems with m = 1, or Lambda = Lambda_n (x) I_m: one h for all components, gains
    that are numbers."""

    def make(seed: int, *, modes: int, m: int = 1) -> Problem:
        r = Random(f"{seed} {modes} {m}")
        n = r.randint(2, 4)
        arcs = {
            f"G{k}": [
                [i, j, r.choice((1, "1/2", 2))]
                for i in range(1, n + 1)
                for j in range(1, n + 1)
                if i != j
            ]
            for k in range(modes)
        }
        arcs = {name: [arc for arc in every if r.random() < 0.7] for name, every in arcs.items()}
        C = [[1 if j == 2 * i else 0 for j in range(2 * m)] for i in range(m)]
        A = [[0] * (2 * m) for _ in range(2 * m)]
        for i in range(m):
            A[2 * i][2 * i + 1], A[2 * i + 1][2 * i] = r.choice((1, 2)), -1
        return Problem(
            network=Network.from_arcs(arcs, arrow="listens_to", agents=n),
            coupling=r.choice(("y", "tanh(2*y)", "exp(y) - 1 + y", "y/3 + y**3")),
            gains={i: r.choice((2, 3, 5, "9/2")) for i in range(1, n + 1) if r.random() < 0.8},
            exosystem=Exosystem(A=A, C=C),
            target=[0] * m,
        )

    return make
