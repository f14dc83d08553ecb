"""What the tests are run with: the pinned packages of constraints.txt, newer and older ones, other
settings.

    python3 .ci/matrix.py pins [--keep] PYTHON ...  # writes constraints.txt; --keep: versions that
    it has stay python3 .ci/matrix.py newest                    # fast tests, where newer packages
    are out than are pinned python3 .ci/matrix.py table [PYTHON ...]        # the fast tests under
    every setting, with these Pythons, too

Other packages go into temporary environments; this needs pip and a package index.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import defaultdict
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PINS = ROOT / "constraints.txt"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]
#: Installed beside the rest, as the Makefile does, and not downloaded for every build.
BUILDS = PYPROJECT["build-system"]["requires"]
#: The rooms that call other packages most; the table runs all.
MEETING = tuple(
    f"tests/{room}"
    for room in (
        "problem",
        "solvers",
        "model",
        "simulation",
        "plotting",
        "report",
        "export",
        "cli",
        "sweeps",
        "analysis",
    )
)
HEAD = """\
# The versions that the tests run with, of every package that is installed
# with dobc_design and all its extras.
# `make` installs these.  Written by .ci/matrix.py.
"""


def say(text: str) -> None:
    print(text, flush=True)


def environment(folder: str, python: str, *wanted: str) -> str:
    """A new environment with these packages; returns its Python."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    inside = str(Path(folder) / "bin" / "python")
    pip = [inside, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, *wanted, *BUILDS], check=True)
    subprocess.run(
        [*pip, *wanted, "--no-build-isolation", "--editable", f"{ROOT}[dev]"], check=True
    )
    return inside


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def installed(python: str) -> dict[str, str]:
    """Name and version of what an environment holds, without the project itself."""
    command = [
        python,
        "-m",
        "pip",
        "list",
        "--format=json",
        "--exclude",
        "dobc_design",
        "--exclude",
        "pip",
    ]
    listed = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return {normal(each["name"]): each["version"] for each in listed}


def pins(pythons: list[str], *, keep: bool) -> None:
    """Write constraints.txt from what these Pythons install with all extras."""
    extras = ",".join(PROJECT["optional-dependencies"])
    versions: dict[str, dict[str, str]] = defaultdict(dict)  # name -> Python -> version
    known = ("--constraint", str(PINS)) if keep else ()
    for python in pythons:
        with tempfile.TemporaryDirectory() as folder:
            inside = environment(folder, python, *known)
            pip = [inside, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *known]
            subprocess.run(
                [*pip, "--no-build-isolation", "--editable", f"{ROOT}[{extras}]"], check=True
            )
            code = "import sys; print('%d.%d' % sys.version_info[:2])"
            version = subprocess.run(
                [inside, "-c", code], check=True, capture_output=True, text=True
            ).stdout.strip()
            for name, found in installed(inside).items():
                versions[name][version] = found
            say(f"{python}: Python {version}, {len(installed(inside))} packages")
    every = sorted({version for found in versions.values() for version in found}, key=numbers)
    lines = [line for name in sorted(versions) for line in lines_of(name, versions[name], every)]
    PINS.write_text(HEAD + "\n".join(lines) + "\n", "utf-8")


def numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def lines_of(name: str, found: dict[str, str], pythons: list[str]) -> list[str]:
    """One line a version, with the Pythons that take it where these are not all."""
    lines = []
    for version in dict.fromkeys(found[python] for python in pythons if python in found):
        places = [k for k, python in enumerate(pythons) if found.get(python) == version]
        bounds = []
        if places[0] > 0:
            bounds.append(f'python_version >= "{pythons[places[0]]}"')
        if places[-1] < len(pythons) - 1:
            bounds.append(f'python_version < "{pythons[places[-1] + 1]}"')
        lines.append("; ".join([f"{name}=={version}", *([" and ".join(bounds)] if bounds else [])]))
    return lines


def core() -> list[str]:
    """The packages that the project itself asks for."""
    return [normal(re.split(r"[><=~! ]", each)[0]) for each in PROJECT["dependencies"]]


def newest() -> int:
    """Resolve without pins; run fast tests if a package that the project asks for is newer than the
    tested one."""
    with tempfile.TemporaryDirectory() as folder:
        made = subprocess.run([sys.executable, "-m", "venv", folder], check=False)  # for its pip
        if made.returncode:
            say(
                "Skipped: this Python cannot make an environment with pip, which tells "
                "what is the newest."
            )
            return 0
        ask = [
            f"{folder}/bin/python",
            "-m",
            "pip",
            "install",
            "--dry-run",
            "--quiet",
            "--report",
            "-",
        ]
        answer = subprocess.run([*ask, f"{ROOT}[dev]"], check=False, capture_output=True, text=True)
        if answer.returncode:
            say(f"The newest versions cannot be found out:\n{answer.stderr[-1000:]}")
            # not a failure of the index, but of pyproject.toml
            return int("ResolutionImpossible" in answer.stderr)
        report = json.loads(answer.stdout)["install"]
        found = {normal(each["metadata"]["name"]): each["metadata"]["version"] for each in report}
        tested = {name: metadata.version(name) for name in core()}
        newer = [
            f"{name} {tested[name]} -> {found[name]}"
            for name in core()
            if found[name] != tested[name]
        ]
        if not newer:
            say(
                f"No newer version is allowed of any of the {len(tested)} packages that "
                "the project asks for."
            )
            return 0
    say("Newer than tested: " + ", ".join(newer))
    with tempfile.TemporaryDirectory() as folder:
        ran = fast_tests(environment(folder, sys.executable), *MEETING)
    say(ran.stdout[-5000:])
    return ran.returncode


def lowest() -> list[str]:
    """The lowest allowed versions of the packages that the project asks for."""
    return [re.sub(r">=([\d.]+).*", r"==\1", each) for each in PROJECT["dependencies"]]


def fast_tests(python: str, *rooms: str, **more: str) -> subprocess.CompletedProcess[str]:
    """Run those of these rooms, or all; what they print is kept."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [
        python,
        "-m",
        "pytest",
        *rooms,
        "-n",
        "2",
        "--dist",
        "worksteal",
        "--benchmark-disable",
    ]
    return subprocess.run(
        command, check=False, cwd=ROOT, env=clean | more, capture_output=True, text=True
    )


def settings() -> dict[str, dict[str, str]]:
    """By name, what differs from the usual run."""
    cores = ["Haswell", "Sandybridge"]
    # elsewhere its first instruction ends the process
    if "avx512f" in Path("/proc/cpuinfo").read_text("utf-8"):
        cores.append("SkylakeX")
    return {
        "as it is": {},
        **{f"OpenBLAS for {core}": {"OPENBLAS_CORETYPE": core} for core in cores},
        "NumPy without X86_V3, X86_V4": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"},
        "two threads": {"OPENBLAS_NUM_THREADS": "2"},
        **{f"PYTHONHASHSEED {seed}": {"PYTHONHASHSEED": seed} for seed in ("1", "2")},
    }


def table(pythons: list[str]) -> int:
    """One row for every setting and environment; what failed stands below its row."""
    failures = 0

    def row(name: str, python: str, **more: str) -> None:
        nonlocal failures
        began = time.monotonic()
        ran = fast_tests(python, **more)
        kernels = next(
            (line for line in ran.stdout.splitlines() if line.startswith("OpenBLAS")), ""
        )
        said = ran.stdout.strip().rpartition("\n")[2].strip("= ")
        say(f"| {name} | {kernels} | {said} | {time.monotonic() - began:.0f} s |")
        if ran.returncode:
            failures += 1
            say(
                "\n".join(
                    line
                    for line in ran.stdout.splitlines()
                    if line.startswith(("FAILED", "ERROR", "E  "))
                )
            )

    for name, more in settings().items():
        row(name, sys.executable, **more)
    for python in pythons:
        with tempfile.TemporaryDirectory() as folder:
            row(python, environment(folder, python, "--constraint", str(PINS)))
    with tempfile.TemporaryDirectory() as folder:
        low = Path(folder) / "lowest.txt"
        low.write_text("\n".join(lowest()), "utf-8")
        row(
            "lowest versions",
            environment(str(Path(folder) / "venv"), sys.executable, "--constraint", str(low)),
        )
    with tempfile.TemporaryDirectory() as folder:
        row("newest versions", environment(folder, sys.executable))
    return failures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="What the tests are run with.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("newest")
    writes = commands.add_parser("pins")
    writes.add_argument("--keep", action="store_true")
    writes.add_argument("pythons", nargs="+", metavar="PYTHON")
    commands.add_parser("table").add_argument("pythons", nargs="*", metavar="PYTHON")
    given = parser.parse_args()
    if given.command == "pins":
        pins(given.pythons, keep=given.keep)
    else:
        sys.exit(newest() if given.command == "newest" else table(given.pythons))
