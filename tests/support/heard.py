"""Signals that the programs under test hear, although whoever started the tests ignores them."""

import signal


def let_children_hear() -> None:
    """A shell starts background jobs with Ctrl-C ignored, nohup does so with SIGHUP, and children
    inherit that.

    What a handler catches they do not inherit: programs under test hear signals again, and the
    tests ignore them still.
    """
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
