"""``progress=True``: a bar with the time left, on a terminal or in a notebook; nothing
elsewhere."""

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import wraps
from inspect import signature
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
    """The function, to which ``progress=True`` hands a bar that lasts as long as it runs; an
    argument that it does not have is answered with the name of the one that was meant."""
    known = tuple(signature(function).parameters)

    @wraps(function)
    def run(*args: P.args, **given: P.kwargs) -> R:
        require_known(function.__name__, given, known)
        if given.get("progress") is not True:
            return function(*args, **given)
        given["progress"] = bar = Bar()
        with bar.moving:
            return function(*args, **given)

    return run


#: What other packages call arguments that have another name here.
ELSEWHERE = {
    "x0": "start",
    "X0": "start",
    "initial_state": "start",
    "T": "t_final",
    "tf": "t_final",
    "t_end": "t_final",
    "horizon": "t_final",
    "rng": "seed",
    "random_state": "seed",
    "n_runs": "runs",
    "timeout": "time_limit",
    "decay": "rate",
    "verbose": "progress",
}


def require_known(function: str, given: Iterable[str], known: Sequence[str]) -> None:
    """Raises: TypeError that names the argument which was probably meant."""
    for name in given:
        if name in known:
            continue
        meant = [each for each in (ELSEWHERE.get(name),) if each in known]
        meant += get_close_matches(name, known, n=1)
        hint = f" Did you mean {meant[0]}?" if meant else ""
        raise TypeError(
            f"{function}() has no argument {name!r}.{hint} Its arguments are {', '.join(known)}."
        )


def report_to(progress: Reports[S]) -> Callable[[S], None]:
    """The function that is called with every state; one that does nothing where none is asked
    for."""
    return progress if callable(progress) else lambda state: None
