"""The lone checker: decides every claim of certificate.json again, from problem.json and nothing
else.

    python -I -S checker certificate.json problem.json

where ``checker`` is this folder, which needs nothing but Python: it uses the standard library and
nothing of the package that it lies in, and was written from docs/certificate-format.md alone, to be
read in an afternoon by somebody who does not trust the rest. The problem is trusted, the
certificate is not. Every decision is made in rational arithmetic or on intervals that are rounded
outward; "not shown" is no claim that something is false.

Exit code 0: every claim holds. 1: one does not, or could not be confirmed. 2: a file cannot be
read.

To read in this order: reading (how files are read, and ``need``, which every check calls),
matrices; intervals and expressions (couplings); files (what the problem and the certificate hold);
examine (what is asked in which order, and the overall verdict); then one topic after the other:
consensus, separable, quadratic, schedule; last factors.
"""

import sys
from pathlib import Path
from types import ModuleType

# Python runs this folder as it is: then it is the package by whose name the modules are imported
if not __package__:
    for name, folders in (
        ("dobc_design", []),
        ("dobc_design.checker", [str(Path(__file__).parent)]),
    ):
        sys.modules[name] = ModuleType(name)
        sys.modules[name].__path__ = folders

from dobc_design.checker.examine import MAX_BYTES, Refused, examine
from dobc_design.checker.reading import need


def main(arguments: list[str]) -> int:
    """Run as a program; the result is the exit code."""
    lines, code = ["usage: python -I -S checker certificate.json problem.json"], 2
    try:
        if len(arguments) == 2:
            need(
                all(Path(name).is_file() or not Path(name).exists() for name in arguments),
                "it is no regular file",
            )
            with open(arguments[0], "rb") as certificate, open(arguments[1], "rb") as problem:
                findings = examine(certificate.read(MAX_BYTES + 1), problem.read(MAX_BYTES + 1))
            lines, code = (
                [("holds  " if holds else "FAILS  ") + what for holds, what in findings],
                0,
            )
            if not all(holds for holds, _ in findings):
                lines, code = [*lines, "NOT CONFIRMED: the certificate proves nothing."], 1
    except (Refused, OSError) as error:
        lines = [f"unreadable: {error}"]

    for line in [*lines, "Every claim holds."] if code == 0 else lines:
        # nothing that could steer a terminal
        shown = "".join(c if c.isprintable() else "?" for c in line)
        sys.stdout.write(shown.encode("ascii", "backslashreplace").decode() + "\n")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
