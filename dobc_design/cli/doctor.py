"""``dobc doctor``: what is installed, what is missing, what that costs, and the command that
installs it.

The packages and their versions are those that this package itself asks for; nothing is listed
twice.
"""

from __future__ import annotations

import platform
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import NamedTuple

from dobc_design import __version__
from dobc_design.cli.output import Json, print_json, say
from dobc_design.errors import DobcError

CORE, PROGRAMS = "core", "programs"
DEVELOPERS = ("dev", "docs")  # extras that users do not miss
#: What an extra is for.
PURPOSES = {
    "notebook": "Jupyter: the Designer and the notebooks",
    "pdf": "reports as PDF",
    "cluster": "dobc sweep --cluster",
    "store": "results as Parquet, tables of pandas",
    "grid": "pandapower networks",
    "fmu": "simulating FMUs",
    "docs": "building the handbook",
    "dev": "tests, linter, type checker",
}
#: Programs that some commands lead to: names, what for, package of Debian, formula of Homebrew.
PROGRAM_TABLE = (
    (
        ("coqc", "rocq"),
        "checking proofs: dobc verify --rocq",
        "coq libcoq-coquelicot libcoq-interval",
        "coq",
    ),
    (("gcc", "cc", "clang"), "compiling the C code of dobc export --c", "gcc", "gcc"),
    (
        ("chromium", "chromium-browser", "google-chrome"),
        "the tests of the report's page",
        "chromium",
        "chromium",
    ),
    (("csdp",), "a second solver for the files of dobc export --sdpa", "coinor-csdp", "csdp"),
)


class Item(NamedTuple):
    """One package or program: its group ("core", an extra, "programs"), what was found, and what
    would install it."""

    item: str
    group: str
    detail: str
    ok: bool
    install: str | None = None


def doctor(as_json: Json = False) -> None:
    """Say what is installed, what is missing and how to install it, and whether the main path
    works."""
    items = examine()
    if as_json:
        ok = all(each.ok for each in items if each.group == CORE)
        print_json({"ok": ok, "items": [each._asdict() for each in items]})
    else:
        say(_words(items))


def examine() -> list[Item]:
    """Everything that is needed, and everything that could be."""
    from importlib import metadata  # slow to import

    items = [Item("dobc_design", CORE, f"{__version__}, Python {platform.python_version()}", True)]
    try:
        requirements = metadata.requires("dobc_design") or []
    except metadata.PackageNotFoundError:
        detail = "not installed as a package, so its requirements are not known"
        return [*items, Item("requirements", CORE, detail, False), _main_path(), *_programs()]
    items += [_package(text) for text in requirements]
    items.sort(key=lambda each: each.group != CORE)
    items.insert(sum(each.group == CORE for each in items), _main_path())
    return [*items, *_programs()]


def _package(text: str) -> Item:
    """One requirement, as the package's own metadata spells it."""
    from importlib import metadata

    from packaging.requirements import Requirement
    from packaging.version import InvalidVersion

    required, typed = Requirement(text), text.partition(";")[0].replace(" ", "")
    extra = re.search(r"extra == ['\"]([a-z]+)", str(required.marker))
    missing = Item(
        required.name, extra[1] if extra else CORE, "not installed", False, install_command([typed])
    )
    try:
        version = metadata.version(required.name)
        fits = required.specifier.contains(version, prereleases=True)
    except metadata.PackageNotFoundError:
        return missing
    except InvalidVersion:  # none that PEP 440 knows
        fits = False
    if not fits:
        return missing._replace(detail=f"{version}, needs {typed.removeprefix(required.name)}")
    return missing._replace(detail=version, ok=True, install=None)


def install_command(requirements: Sequence[str]) -> str:
    """The command that installs these into the Python that is running."""
    if find_spec("pip") is not None:
        return shlex.join([sys.executable, "-m", "pip", "install", *requirements])
    return shlex.join(["uv", "pip", "install", "--python", sys.executable, *requirements])


def _programs() -> Iterator[Item]:
    for names, purpose, debian, brew in PROGRAM_TABLE:
        place = next(filter(None, map(shutil.which, names)), None)
        if place is not None:
            yield Item(names[0], PROGRAMS, f"{place}: {purpose}", True)
            continue
        command = f"brew install {brew}" if shutil.which("brew") else None
        command = f"sudo apt-get install {debian}" if shutil.which("apt-get") else command
        yield Item(names[0], PROGRAMS, f"not found; for {purpose}", False, command)


def _main_path() -> Item:
    """Whether the built-in problem is certified and its certificate holds."""
    from dobc_design.certification.certify import certify, verify

    try:
        certificate = certify("paper-fixed")
        works = certificate.verdict.value == "proved" and verify(certificate, "paper-fixed").holds
        detail = (
            f"{certificate.verdict.value}, re-checked" if works else "not proved, or not confirmed"
        )
    except (DobcError, ImportError) as error:
        works, detail = False, str(error)[:200]
    return Item("paper-fixed", CORE, detail, works)


def _words(items: Sequence[Item]) -> str:
    width = max(len(each.item) for each in items)
    lines: list[str] = []
    for group in dict.fromkeys(each.group for each in items):
        own = [each for each in items if each.group == group]
        title = {CORE: "needed", PROGRAMS: "programs, none of them needed"}.get(
            group, f"dobc_design[{group}]"
        )
        purpose = PURPOSES.get(group)
        lines += ["", f"{title}: {purpose}" if purpose else title]
        absent = "MISSING" if group == CORE else "absent"
        lines += [
            f"  {'ok' if each.ok else absent:<7}  {each.item:<{width}}  {each.detail}"
            for each in own
        ]
    return "\n".join([*lines[1:], "", *_conclusion(items)])


def _conclusion(items: Sequence[Item]) -> Iterator[str]:
    broken = sum(each.group == CORE and not each.ok for each in items)
    bad = f"{broken} of the things that are needed are missing or broken."
    yield bad if broken else "Everything that is needed is there and works."
    for group in dict.fromkeys(
        each.group for each in items if not each.ok and each.group not in DEVELOPERS
    ):
        missing = [
            each
            for each in items
            if each.group == group and not each.ok and each.install is not None
        ]
        if group == PROGRAMS:
            yield from (f"To install {each.item}:\n  {each.install}" for each in missing)
        elif missing:
            head = (
                "To install what is missing:" if group == CORE else f"To install the extra {group}:"
            )
            # the requirement stands at the end of an item's command
            yield (
                f"{head}\n  "
                f"{install_command([shlex.split(each.install or '')[-1] for each in missing])}"
            )
