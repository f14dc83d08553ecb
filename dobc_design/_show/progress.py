"""``progress=True``: a bar with the time left, on a terminal or in a notebook; nothing
elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
Reports = Callable[[S], None] | bool | None  # True: a bar; else what is called with every state


class Bar:
    """Shows what it is called with: the name of a stage, the part that is done (0 to 1), or a state
    with ``done`` and ``total``.  The time left is known where a part is."""

    def __init__(self, console: Any = None) -> None:
        from rich import progress as rich
        from rich.console import Console

        console = console or Console(stderr=True)
        if not console.is_jupyter:
            # A log file is no place for a line that moves.
            console.quiet = not console.is_terminal
        left = (
            rich.TextColumn("left"),
            rich.TimeRemainingColumn(),
            rich.TextColumn("after"),
            rich.TimeElapsedColumn(),
        )
        self.moving = rich.Progress(
            rich.BarColumn(), *left, rich.TextColumn("{task.description}"), console=console
        )
        self.task = self.moving.add_task("starting", total=None)

    def __call__(self, state: Any) -> None:
        if isinstance(state, str):
            self.moving.update(self.task, description=state)
        elif isinstance(state, float):
            self.moving.update(self.task, description="", total=1.0, completed=state)
        else:
            self.moving.update(
                self.task, description=str(state), total=state.total, completed=state.done
            )


def shows_progress(function: Callable[P, R]) -> Callable[P, R]:
    """The function, to which ``progress=True`` hands a bar that lasts as long as it runs."""

    @wraps(function)
    def run(*args: P.args, **given: P.kwargs) -> R:
        if given.get("progress") is not True:
            return function(*args, **given)
        given["progress"] = bar = Bar()
        with bar.moving:
            return function(*args, **given)

    return run


def report_to(progress: Reports[S]) -> Callable[[S], None]:
    """The function that is called with every state; one that does nothing where none is asked
    for."""
    return progress if callable(progress) else lambda state: None
