"""From exceptions to messages and exit codes: no traceback reaches a user, and every failure has one code.

2 the caller's mistake, 4 the machine failed, 130 interrupted; an uncaught exception is never 1, which means refuted.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable
from typing import Any

from dobc_design._signals import SENTENCE
from dobc_design.cli.completion import COMPLETING
from dobc_design.cli.output import INTERRUPTED, MACHINE, MISTAKE, NoOutput, fail_as, fail_with
from dobc_design.errors import DobcError, SpecError

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.EPIPE)


def guarded(run: Callable[[], Any], *, as_json: bool) -> int:
    """Run it and return the exit code, having said what went wrong.  Raises: NoOutput when that cannot be said."""
    from typer.exceptions import TyperException

    def failed(kind: str, message: str, cure: str | None, code: int) -> int:
        return fail_as(kind, None, message, cure, code, as_json=as_json)

    try:
        code = run()
    except TyperException as error:  # a wrong option or a missing argument
        context = getattr(error, "ctx", None)
        command = "dobc" if context is None else context.command_path
        return failed("usage", error.format_message(), f"See `{command} --help`.", MISTAKE)
    except SpecError as error:
        return fail_with(error, MISTAKE, as_json=as_json)
    except DobcError as error:
        return fail_with(error, MACHINE, as_json=as_json)
    except KeyboardInterrupt:
        return failed("interrupted", SENTENCE, None, INTERRUPTED)
    except SystemExit as error:  # help, too, goes to standard output
        if error.code in (0, None) or COMPLETING in os.environ:  # typer's way to end after completion
            return error.code if isinstance(error.code, int) else 0
        raise NoOutput("nobody reads it") from error
    except NoOutput:
        raise
    except MemoryError:
        return failed("memory", "The machine ran out of memory.", "Try a smaller problem.", MACHINE)
    except OSError as error:
        if error.filename is None and error.errno in _NO_ROOM:  # typer's own output; our files are named
            raise NoOutput(error.strerror) from error
        place = None if error.filename is None else str(error.filename)
        message = f"{error.strerror or error}{'' if place is None else f' ({place})'}."
        return fail_as("io", place, message, "Check disk, paths and permissions.", MACHINE, as_json=as_json)
    except Exception as error:  # noqa: BLE001 - the last line of defence: no traceback reaches a user
        if os.environ.get("DOBC_TRACEBACK"):
            import traceback

            traceback.print_exc()
        text = f"Internal error ({type(error).__name__}: {str(error)[:200]})."
        return failed("internal", text, "Set DOBC_TRACEBACK=1 to see where, and report it.", MACHINE)
    if code == INTERRUPTED:  # typer turns the interrupt into this
        return failed("interrupted", SENTENCE, None, INTERRUPTED)
    return code if isinstance(code, int) else 0


def abandon_output() -> None:
    """Keep Python from complaining at exit about what can no longer be written."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError, AttributeError):
        return
