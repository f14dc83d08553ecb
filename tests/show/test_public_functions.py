"""What public functions take: numbers with a type, and ``progress=True``, a bar where somebody can
see it."""

import inspect
import io
from functools import partial
from types import SimpleNamespace

import pytest
from rich.console import Console

import dobc_design as dd
from dobc_design._show import progress


def parameters(name: str) -> dict[str, inspect.Parameter]:
    """Of a public function; a class has none that matter here."""
    function = getattr(dd, name)
    if not inspect.isfunction(function):
        return {}
    return dict(inspect.signature(function).parameters)


REPORTING = sorted(name for name in dd.__all__ if "progress" in parameters(name))


def test_rates_pins_and_tolerances_have_types():
    """No argument that is a number, pins or labels is Any."""
    for name in ("certify", "design", "design_observer", "design_pinning", "trade_off"):
        for given in parameters(name).values():
            assert given.annotation != "Any", f"{name}({given.name})"


def test_every_function_that_reports_has_a_bar():
    assert {"certify", "design", "simulate", "sweep", "trade_off", "what_breaks_first"} <= set(
        REPORTING
    )
    for name in REPORTING:
        assert hasattr(getattr(dd, name), "__wrapped__")


def drawn(*, terminal: bool) -> str:
    """What a bar writes for a stage, for half of the work, and for 3 of 4 cases."""
    file = io.StringIO()
    bar = progress.Bar(Console(file=file, force_terminal=terminal, width=100))
    with bar.moving:
        for state in ("looking for a P", 0.5, SimpleNamespace(done=3, total=4)):
            bar(state)
            bar.moving.refresh()
        assert bar.moving.tasks[0].percentage == 75
    return file.getvalue()


def test_a_bar_shows_the_stage_and_the_time_left_on_a_terminal_and_nothing_elsewhere():
    for words in ("looking for a P", "left", "after"):
        assert words in drawn(terminal=True)
    assert drawn(terminal=False) == ""


def swept(name: str, progress: object) -> object:
    return dd.sweep(name, {"pinning.gains.gateway": [2]}, jobs=1, progress=progress)


SIMULATED = partial(dd.simulate, runs=3, t_final=1)
RUNS = [(dd.certify, str), (SIMULATED, float), (swept, None)]


@pytest.mark.parametrize(("run", "last"), RUNS)
def test_the_bar_is_told_what_a_function_would_be_told_and_is_closed(monkeypatch, run, last):
    told: list[object] = []
    started: list[bool] = []

    def see(bar: progress.Bar, state: object) -> None:
        started.append(bar.moving.live.is_started)

    monkeypatch.setattr(progress.Bar, "__call__", see)
    run("clock-sync", progress=told.append)
    run("clock-sync", progress=True)
    assert len(started) == len(told) > 0
    assert all(started)
    if last is not None:
        assert isinstance(told[-1], last)
    run("clock-sync", progress=False)
    assert len(started) == len(told)
