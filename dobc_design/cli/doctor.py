"""``dobc doctor``: what is installed, what is missing, what that costs, and the command that installs it.

The packages and their versions are those that this package itself asks for; nothing is listed twice.
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
    (("coqc", "rocq"), "checking the files of dobc export --rocq", "coq", "coq"),
    (("gcc", "cc", "clang"), "compiling the C code of dobc export --c", "gcc", "gcc"),
    (("chromium", "chromium-browser", "google-chrome"), "the tests of the report's page", "chromium", "chromium"),
    (("csdp",), "a second solver for the files of dobc export --sdpa", "coinor-csdp", "csdp"),
)
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)\s*([^;]*)(?:;.*extra\s*==\s*[\"']([a-z]+)[\"'])?")
_BOUND = re.compile(r"(>=|<=|==|!=|<|>|~=)\s*([0-9][0-9.]*)")


class Item(NamedTuple):
    """One package or program: its group ("core", an extra, "programs"), what was found, and what would install it."""

    item: str
    group: str
    detail: str
    ok: bool
    install: str | None = None


def doctor(as_json: Json = False) -> None:
    """Say what is installed, what is missing and how to install it, and whether the main path works."""
    items = examine()
    if as_json:
        ok = all(each.ok for each in items if each.group == CORE)
        print_json({"ok": ok, "items": [each._asdict() for each in items]})
    else:
        say(_words(items))


def examine() -> list[Item]:
    """Everything that is needed, and everything that could be."""
    from importlib import metadata  # slow to import

    items = [Item(item="dobc_design", group=CORE, detail=f"{__version__}, Python {platform.python_version()}", ok=True)]
    try:
        requirements = metadata.requires("dobc_design") or []
    except metadata.PackageNotFoundError:
        detail = "not installed as a package, so its requirements are not known"
        return [*items, Item(item="requirements", group=CORE, detail=detail, ok=False), _main_path(), *_programs()]
    items += [_package(text) for text in requirements]
    items.sort(key=lambda each: each.group != CORE)
    last_core = sum(each.group == CORE for each in items)
    items.insert(last_core, _main_path())
    return [*items, *_programs()]


def _package(text: str) -> Item:
    """One requirement, as the package's own metadata spells it."""
    from importlib import metadata

    found = _REQUIREMENT.match(text)
    name, bounds, extra = (text, "", None) if found is None else found.groups()
    group = extra or CORE
    wanted = bounds.strip().replace(" ", "")
    command = install_command([f"{name}{wanted}"])
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return Item(item=name, group=group, detail="not installed", ok=False, install=command)
    if not fits(version, wanted):
        return Item(item=name, group=group, detail=f"{version}, needs {wanted}", ok=False, install=command)
    return Item(item=name, group=group, detail=version, ok=True)


def fits(version: str, bounds: str) -> bool:
    """Whether a version like 2.4.1 keeps bounds like ">=2.4,<3".  Letters in a version are left out of account."""
    own = _numbers(version)
    for sign, text in _BOUND.findall(bounds):
        other = _numbers(text)
        length = max(len(own), len(other))
        a, b = own + (0,) * (length - len(own)), other + (0,) * (length - len(other))
        holds = {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b, "!=": a != b, "~=": a >= b}
        if not holds[sign]:
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    found = re.match(r"[0-9]+(?:\.[0-9]+)*", version)
    return tuple(int(part) for part in found[0].split(".")) if found else ()


def install_command(requirements: Sequence[str]) -> str:
    """The command that installs these into the Python that is running."""
    if find_spec("pip") is not None:
        return shlex.join([sys.executable, "-m", "pip", "install", *requirements])
    return shlex.join(["uv", "pip", "install", "--python", sys.executable, *requirements])


def _programs() -> Iterator[Item]:
    for names, purpose, debian, brew in PROGRAM_TABLE:
        place = next(filter(None, map(shutil.which, names)), None)
        command = _system_command(debian, brew)
        if place is not None:
            yield Item(item=names[0], group=PROGRAMS, detail=f"{place}: {purpose}", ok=True)
        else:
            yield Item(item=names[0], group=PROGRAMS, detail=f"not found; for {purpose}", ok=False, install=command)


def _system_command(debian: str, brew: str) -> str | None:
    if shutil.which("apt-get"):
        return f"sudo apt-get install {debian}"
    return f"brew install {brew}" if shutil.which("brew") else None


def _main_path() -> Item:
    """Whether the built-in problem is certified and its certificate holds."""
    from dobc_design.certification.certify import certify, verify

    try:
        certificate = certify("paper-fixed")
        works = certificate.verdict.value == "proved" and verify(certificate, "paper-fixed").holds
        detail = f"{certificate.verdict.value}, re-checked" if works else "not proved, or not confirmed"
    except (DobcError, ImportError) as error:
        works, detail = False, str(error)[:200]
    return Item(item="paper-fixed", group=CORE, detail=detail, ok=works)


def _words(items: Sequence[Item]) -> str:
    width = max(len(each.item) for each in items)
    lines: list[str] = []
    for group in dict.fromkeys(each.group for each in items):
        own = [each for each in items if each.group == group]
        title = {CORE: "needed", PROGRAMS: "programs, none of them needed"}.get(group, f"dobc_design[{group}]")
        purpose = PURPOSES.get(group)
        lines += ["", f"{title}: {purpose}" if purpose else title]
        absent = "MISSING" if group == CORE else "absent"
        lines += [f"  {'ok' if each.ok else absent:<7}  {each.item:<{width}}  {each.detail}" for each in own]
    return "\n".join([*lines[1:], "", *_conclusion(items)])


def _conclusion(items: Sequence[Item]) -> Iterator[str]:
    broken = [each for each in items if each.group == CORE and not each.ok]
    if not broken:
        yield "Everything that is needed is there and works."
    else:
        yield f"{len(broken)} of the things that are needed are missing or broken."
    groups = dict.fromkeys(each.group for each in items if not each.ok and each.group not in DEVELOPERS)
    for group in groups:
        missing = [each for each in items if each.group == group and not each.ok and each.install is not None]
        if group == PROGRAMS:
            yield from (f"To install {each.item}:\n  {each.install}" for each in missing)
        elif missing:
            head = "To install what is missing:" if group == CORE else f"To install the extra {group}:"
            yield f"{head}\n  {install_command([_wanted(each) for each in missing])}"


def _wanted(item: Item) -> str:
    """The requirement at the end of an item's command."""
    return shlex.split(item.install or item.item)[-1]
