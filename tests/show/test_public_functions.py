"""What public functions take: numbers with a type, and ``progress=True``, a bar where somebody can
see it."""

import inspect
import io
from types import SimpleNamespace

import pytest
from rich.console import Console

import dobc_design as dd
from dobc_design._show import progress

REPORTING = sorted(
    name
    for name in dd.__all__
    if inspect.isfunction(getattr(dd, name))
    and "progress" in inspect.signature(getattr(dd, name)).parameters
)


def test_rates_pins_and_tolerances_have_types():
    """No argument that is a number, pins or labels is Any."""
    loose = {
        f"{name}({given.name})"
        for name in (
            "certify",
            "design",
            "design_observer",
            "design_pinning",
            "trade_off",
        )
        for given in inspect.signature(getattr(dd, name)).parameters.values()
        if given.annotation == "Any"
    }
    assert loose == set()


def test_every_function_that_reports_has_a_bar():
    assert {"certify", "design", "simulate", "sweep", "trade_off", "what_breaks_first"} <= set(
        REPORTING
    )
    assert all(hasattr(getattr(dd, name), "__wrapped__") for name in REPORTING)


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
    assert all(words in drawn(terminal=True) for words in ("looking for a P", "left", "after"))
    assert drawn(terminal=False) == ""


@pytest.mark.parametrize(
    ("run", "last"),
    [
        (lambda how: dd.certify("clock-sync", progress=how), str),
        (lambda how: dd.simulate("clock-sync", runs=3, t_final=1, progress=how), float),
        (
            lambda how: dd.sweep(
                "clock-sync", {"pinning.gains.gateway": [2]}, jobs=1, progress=how
            ),
            None,
        ),
    ],
)
def test_the_bar_is_told_what_a_function_would_be_told_and_is_closed(monkeypatch, run, last):
    told, seen = [], []
    monkeypatch.setattr(
        progress.Bar,
        "__call__",
        lambda self, state: seen.append((state, self.moving.live.is_started)),
    )
    run(told.append)
    run(True)
    assert len(seen) == len(told) > 0
    assert all(started for _, started in seen)
    assert last is None or isinstance(told[-1], last)
    run(False)
    assert len(seen) == len(told)
