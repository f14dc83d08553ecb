"""What happens when somebody wants the program to stop: Ctrl-C, SIGTERM, SIGHUP.

The command line ends at once, from the signal handler, with one line and 128 + the number of the
signal: unwinding by KeyboardInterrupt gets lost inside a destructor, a callback or a library that
is just being imported.  Nothing is lost, because files are replaced as a whole
(``certificate.files``), and while that happens the signal waits (``Postponed``).

Python runs signal handlers in the main thread; called from another thread, all of this does
nothing.  The imports are few and light, because this is loaded before anything else.
"""

from __future__ import annotations

import os
import signal

TYPE_CHECKING = False  # typing takes longer to import than all of this
if TYPE_CHECKING:
    from types import FrameType
    from typing import Any

STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
SENTENCE = "Interrupted; no file was left half written."
_DOCUMENT = """{{
  "error": {{
    "kind": "interrupted",
    "key": null,
    "message": "{}",
    "cure": null
  }}
}}
"""


class Ending:
    """A signal handler that says so and leaves, by os.write and os._exit only: the interpreter may
    be anywhere.

    ``as_json``: the error is a document on standard output, else a line on standard error.
    """

    def __init__(self, *, as_json: bool) -> None:
        self.as_json, self.sentence = as_json, SENTENCE

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """End the process."""
        try:
            text = (
                _DOCUMENT.format(_escaped(self.sentence)) if self.as_json else f"{self.sentence}\n"
            )
            if not self.as_json and os.isatty(2):
                text = f"\x1b[?25h\n{text}"  # a progress line hides the cursor
            os.write(1 if self.as_json else 2, text.encode("utf-8", errors="replace"))
        finally:  # whether or not somebody listens
            os._exit(128 + number)


def end_at_once(*, as_json: bool) -> None:
    """From now on a stopping signal ends this process with 128 + its number: 130 for Ctrl-C.

    A signal that the caller has told us to ignore (nohup, a background job of a shell) stays
    ignored.
    """
    for number in STOPPING:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            _set(number, Ending(as_json=as_json))


def _endings() -> list[Ending]:
    return [each for each in map(signal.getsignal, STOPPING) if isinstance(each, Ending)]


def answer_begins() -> None:
    """From now on a signal puts nothing more on standard output, where the answer stands or begins
    to."""
    for handler in _endings():
        handler.as_json = False


def say_on_ending(sentence: str) -> None:
    """From now on a signal says this instead; nothing without ``end_at_once``."""
    for handler in _endings():
        handler.sentence = sentence


def _escaped(text: str) -> str:
    """The text inside a JSON string."""
    special = {'"': '\\"', "\\": "\\\\", "\n": "\\n"}
    return "".join(special.get(each, each if each.isprintable() else "?") for each in text)


class Postponed:
    """A context in which stopping signals wait until it is left.  A second one of the same kind
    does not wait."""

    def __init__(self) -> None:
        self.before: dict[int, Any] = {}
        self.came: list[int] = []

    def __enter__(self) -> None:
        for number in STOPPING:
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):
                self.before[number] = handler
                _set(number, self._wait)

    def _wait(self, number: int, frame: FrameType | None) -> None:
        if number in self.came:
            signal.signal(number, self.before[number])
            signal.raise_signal(number)
        self.came.append(number)

    def __exit__(self, *error: object) -> None:
        for number, handler in self.before.items():
            _set(number, handler)
        for number in self.came:
            signal.raise_signal(number)


def _set(number: int, handler: Any) -> None:
    try:
        signal.signal(number, handler)
    except ValueError:  # not the main thread, to which signals do not come
        return
