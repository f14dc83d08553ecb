"""``dobc doctor``: what is installed, what is missing, what that costs, and the command that
installs it.

The packages and their versions are those that this package itself asks for; nothing is listed
twice.
"""

import platform
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import NamedTuple

from dobc_design import __version__
from dobc_design._files import own_table
from dobc_design.errors import DobcError

from .output import print_json, say

CORE, PROGRAMS = "core", "programs"
DEVELOPERS = ("dev", "docs")  # extras that users do not miss
_TABLES = own_table("cli/doctor.toml")
PURPOSES: dict[str, str] = _TABLES["extras"]


class Item(NamedTuple):
    """One package or program: its group ("core", an extra, "programs"), what was found, and what
    would install it."""

    item: str
    group: str
    detail: str
    ok: bool
    install: str | None = None


def doctor(as_json: bool = False) -> None:
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
    # What is needed comes first; the rest stays in the order of the package.
    items.sort(key=lambda each: each.group != CORE)
    items.insert(sum(each.group == CORE for each in items), _main_path())
    return [*items, *_programs()]


def _package(text: str) -> Item:
    """One requirement, as the package's own metadata spells it."""
    from importlib import metadata

    from packaging.requirements import Requirement
    from packaging.version import InvalidVersion

    required = Requirement(text)
    # As it is typed after pip install: without its marker.
    typed = text.partition(";")[0].replace(" ", "")
    extra = re.search(r"extra == ['\"]([a-z]+)", str(required.marker))
    group = extra[1] if extra else CORE
    missing = Item(required.name, group, "not installed", False, install_command([typed]))
    try:
        version = metadata.version(required.name)
        fits = required.specifier.contains(version, prereleases=True)
    except metadata.PackageNotFoundError:
        return missing
    except InvalidVersion:  # none that PEP 440 knows
        fits = False
    if not fits:
        return missing._replace(detail=f"{version}, needs {typed.removeprefix(required.name)}")
    return Item(required.name, group, version, True)


def install_command(requirements: Sequence[str]) -> str:
    """The command that installs these into the Python that is running."""
    if find_spec("pip") is not None:
        return shlex.join([sys.executable, "-m", "pip", "install", *requirements])
    return shlex.join(["uv", "pip", "install", "--python", sys.executable, *requirements])


def _programs() -> Iterator[Item]:
    for purpose, (names, debian, brew) in _TABLES["programs"].items():
        place = next(filter(None, map(shutil.which, names)), None)
        if place is not None:
            yield Item(names[0], PROGRAMS, f"{place}: {purpose}", True)
            continue
        command = None
        # A command that the machine does not have would be no advice.
        if shutil.which("apt-get"):
            command = f"sudo apt-get install {debian}"
        elif shutil.which("brew"):
            command = f"brew install {brew}"
        yield Item(names[0], PROGRAMS, f"not found; for {purpose}", False, command)


def _main_path() -> Item:
    """Whether the built-in problem is certified and its certificate holds."""
    from dobc_design.certification.certify import certify, verify

    try:
        certificate = certify("paper-fixed")
        verdict = certificate.verdict.value
        works = verdict == "proved" and verify(certificate, "paper-fixed").holds
        detail = f"{verdict}, re-checked" if works else "not proved, or not confirmed"
    except (DobcError, ImportError) as error:
        works, detail = False, str(error)[:200]
    return Item("paper-fixed", CORE, detail, works)


def _words(items: Sequence[Item]) -> str:
    width = max(len(each.item) for each in items)
    titles = {CORE: "needed", PROGRAMS: "programs, none of them needed"}
    paragraphs = []
    for group in dict.fromkeys(each.group for each in items):
        lines = [titles.get(group, f"dobc_design[{group}]")]
        if group in PURPOSES:
            lines[0] += f": {PURPOSES[group]}"
        absent = "MISSING" if group == CORE else "absent"
        for each in items:
            if each.group == group:
                state = "ok" if each.ok else absent
                lines.append(f"  {state:<7}  {each.item:<{width}}  {each.detail}")
        paragraphs.append("\n".join(lines))
    conclusion = "\n".join(_conclusion(items))
    return "\n\n".join([*paragraphs, conclusion])


def _conclusion(items: Sequence[Item]) -> Iterator[str]:
    """Whether everything that is needed is there, and how the rest is installed."""
    broken = sum(each.group == CORE and not each.ok for each in items)
    if broken:
        yield f"{broken} of the things that are needed are missing or broken."
    else:
        yield "Everything that is needed is there and works."
    missing: dict[str, list[tuple[str, str]]] = {}  # group -> items and what installs them
    for each in items:
        if not each.ok and each.install is not None and each.group not in DEVELOPERS:
            missing.setdefault(each.group, []).append((each.item, each.install))
    for group, commands in missing.items():
        if group == PROGRAMS:
            for item, command in commands:
                yield f"To install {item}:\n  {command}"
        else:
            # the requirement stands at the end of a command
            wanted = [shlex.split(command)[-1] for _, command in commands]
            what = "what is missing" if group == CORE else f"the extra {group}"
            yield f"To install {what}:\n  {install_command(wanted)}"
