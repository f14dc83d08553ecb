"""Where ``dobc`` and ``python -m dobc_design`` begin: first the signal handler, then everything
else.

Importing the command line takes a good tenth of a second, in which an interrupt would show a
traceback.
"""

import gc
import os

try:
    import sys

    from ._signals import end_at_once

    end_at_once(as_json="--json" in sys.argv)
except KeyboardInterrupt:  # in the millisecond before the handler stands
    os.write(2, b"Interrupted.\n")
    os._exit(130)

# Our dense matrices are small: threads that wait for each other, beside other programs, cost more
# than they bring. It has to be said before NumPy is imported, and whoever has chosen a number keeps
# it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Run the command line; see ``cli.main``."""
    # A command makes many objects that live until it ends; looking through them for cycles took an
    # eighth of its time.
    gc.set_threshold(100_000, 20, 100)
    _open_standard_streams()
    from .cli.main import main as run

    run()


def _open_standard_streams() -> None:
    """Let no file of ours get the number of a standard stream that the caller has closed."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free


if __name__ == "__main__":
    main()
