"""One agent's controller as an FMU: FMI 3.0, co-simulation, with the C sources and, where a
compiler is, the library.

The FMU is a zip file: modelDescription.xml, sources/, binaries/PLATFORM/.  The same controller
gives the same bytes, as far as the compiler does.
"""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from dobc_design import __version__
from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SolverError
from dobc_design.export.c_controller import Controller
from dobc_design.export.c_folder import header_text, source_text
from dobc_design.export.c_text import string, template

MODEL = "dobc_agent"
COMPILERS = ("cc", "gcc", "clang")
DATE = (1980, 1, 1, 0, 0, 0)  # of the files in the zip
TIME_LIMIT = 120  # s for the compiler
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
MACHINES = {"AMD64": "x86_64", "arm64": "aarch64"}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Fmu(Shown):
    """The bytes of an FMU and the platform its library is for, None where there is no compiler:
    sources only then."""

    data: bytes
    platform: str | None

    def _card(self) -> Card:
        made = (
            "sources only, there is no compiler"
            if self.platform is None
            else f"library for {self.platform}"
        )
        return Card(title="FMU (FMI 3.0)", text=f"{len(self.data)} bytes, {made}")

    def __repr__(self) -> str:
        return f"<Fmu: {self._card().text}>"

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file, replacing an older one.  Raises: CertificateError when the machine
        refuses."""
        write_atomically(Path(path), self.data)
        return Path(path)


class Variable(NamedTuple):
    """A variable of the FMU: its name, number, causality and what it is."""

    name: str
    reference: int
    causality: str
    text: str


def make_fmu(controller: Controller) -> Fmu:
    """Build the FMU of the controller's only agent.  Raises: SolverError if the compiler refuses
    the code."""
    token = hashlib.sha256(
        (header_text(controller) + source_text(controller)).encode("utf-8")
    ).hexdigest()
    files = {
        f"sources/{name}": text.encode("utf-8") for name, text in sources(controller, token).items()
    }
    library = _compiled(files)
    described = {"modelDescription.xml": description(controller, token).encode("utf-8"), **files}
    if library is not None:
        described[f"binaries/{library.platform}/{library.name}"] = library.data
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in described.items():
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return Fmu(data=stream.getvalue(), platform=None if library is None else library.platform)


def sources(controller: Controller, token: str) -> dict[str, str]:
    """The C files of the FMU and buildDescription.xml, by name."""
    folder = resources.files("dobc_design.export") / "templates"
    code, heard = (folder / "fmi3_agent.c").read_text("utf-8"), len(controller.agents[0].neighbours)
    for mark, text in {
        "TOKEN": string(token),
        "HEARD": str(heard),
        "STUBS": template("fmi3_stubs.c.j2").render(),
    }.items():
        code = code.replace(f"@{mark}@", text.removesuffix("\n"))
    listed = "".join(f'<SourceFile name="{name}"/>' for name in ("dobc_agent.c", "fmi3_agent.c"))
    build = '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
    build += (
        f'  <BuildConfiguration modelIdentifier="{MODEL}">\n    <SourceFileSet '
        f'language="C99">{listed}'
    )
    build += "</SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    return {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "fmi3_types.h": (folder / "fmi3_types.h").read_text("utf-8"),
        "fmi3_agent.c": code,
        "buildDescription.xml": build,
    }


def variables(controller: Controller) -> list[Variable]:
    """The real variables in the order of their numbers: x, y, u, v, dhat, and what is heard of
    every neighbour."""
    problem, labels, agent = (
        controller.problem,
        controller.problem.network.labels,
        controller.agents[0],
    )
    wanted = [
        ("x", "input", "measured state"),
        ("y", "output", "x - goal: the packet for those who listen"),
        ("u", "output", "input (19), held until the next sample"),
        ("v", "output", "couplings + u, held until the next sample"),
        ("dhat", "output", "estimated disturbance"),
    ]
    wanted += [
        (f"heard[{labels[j]}]", "input", f"packet y of agent {labels[j]}") for j in agent.neighbours
    ]
    sizes = {
        name: problem.inputs if name in ("u", "v", "dhat") else problem.m for name, _, _ in wanted
    }
    rows = [
        (f"{name}[{c + 1}]" if sizes[name] > 1 else name, causality, text)
        for name, causality, text in wanted
        for c in range(sizes[name])
    ]
    return [
        Variable(name, 2 + place, causality, text)
        for place, (name, causality, text) in enumerate(rows)
    ]


def description(controller: Controller, token: str) -> str:
    """modelDescription.xml."""
    problem, agent, period = (
        controller.problem,
        controller.agents[0],
        repr(float(controller.period)),
    )
    return template("modelDescription.xml.j2").render(
        quoted=quoteattr,
        name=f"{problem.name}: agent {agent.label}",
        token=token,
        about=f"Observer (13) and controller (19) of agent {agent.label}, sampled every {period} "
        "s.",
        version=__version__,
        model=MODEL,
        period=period,
        modes=f"which graph holds: {', '.join(list(problem.network.modes)[:12])}",
        variables=variables(controller),
    )


class _Library(NamedTuple):
    platform: str  # in FMI's words
    name: str
    data: bytes


def _compiled(files: Mapping[str, bytes]) -> _Library | None:
    """The shared library; None where there is no compiler, or none for shared libraries."""
    compiler = next((found for name in COMPILERS if (found := shutil.which(name))), None)
    if compiler is None or platform.system() not in SYSTEMS:
        return None
    system, suffix = SYSTEMS[platform.system()]
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            (Path(folder) / Path(name).name).write_bytes(data)
        library = Path(folder) / f"{MODEL}{suffix}"
        options = [
            "-std=c99",
            "-O2",
            "-shared",
            "-fPIC",
            "-fvisibility=hidden",
            "dobc_agent.c",
            "fmi3_agent.c",
            "-o",
        ]
        command = [compiler, *options, library.name, "-lm"]
        cure = "`dobc export --c DIR` writes the sources alone."
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, check=False, text=True, timeout=TIME_LIMIT
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SolverError(
                f"the C compiler could not be run: {error}.", key="--fmu", cure=cure
            ) from error
        if done.returncode != 0 or not library.exists():
            first = next(iter(done.stderr.strip().splitlines()), "no message")
            raise SolverError(
                f"the C compiler refused the FMU's code: {first[:200]}.", key="--fmu", cure=cure
            )
        machine = MACHINES.get(platform.machine(), platform.machine())
        return _Library(f"{machine}-{system}", library.name, library.read_bytes())
