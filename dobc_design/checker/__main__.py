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
matrices; intervals and expressions (couplings); files (what the problem states), guarantee and loop
(what is proved about it); claims (what a certificate holds); examine (what is asked in which
order) and verdict; then one topic after the other: consensus (the target) and sampled, curves and
separable, quadratic, coordinates, cycles, schedule, graphs, accuracy, margins; last factors.
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

from dobc_design.checker.examine import MAX_BYTES, Finding, Refused, examine
from dobc_design.checker.reading import need

LAST = ("Every claim holds.", "NOT CONFIRMED: the certificate proves nothing.")  # by exit code


def main(arguments: list[str]) -> int:
    """Run as a program; the result is the exit code."""
    code = 2
    lines = ["usage: python -I -S checker certificate.json problem.json"]
    if len(arguments) == 2:
        try:
            findings = examined(*arguments)
        except (Refused, OSError) as error:
            lines = [f"unreadable: {error}"]
        else:
            lines = [("holds  " if holds else "FAILS  ") + what for holds, what in findings]
            code = 0 if all(holds for holds, _ in findings) else 1
            lines.append(LAST[code])

    for line in lines:
        # nothing that could steer a terminal
        shown = "".join(c if c.isprintable() else "?" for c in line)
        sys.stdout.write(shown.encode("ascii", "backslashreplace").decode() + "\n")
    return code


def examined(*names: str) -> list[Finding]:
    """The findings about two files, read no further than they may be long."""
    for name in names:
        # a pipe would make it wait for ever
        regular = Path(name).is_file() or not Path(name).exists()
        need(regular, "it is no regular file")
    certificate, problem = names
    with open(certificate, "rb") as claims, open(problem, "rb") as stated:
        return examine(claims.read(MAX_BYTES + 1), stated.read(MAX_BYTES + 1))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
