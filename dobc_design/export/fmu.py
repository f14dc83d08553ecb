"""One agent's controller as an FMU: FMI 3.0, co-simulation, with the C sources and, where a
compiler is, the library.

Optional: needs a C compiler for the library, and the package fmpy (extra `fmu`) where an FMU is
tried; nothing where sources are enough.

The FMU is a zip file: modelDescription.xml, sources/, binaries/PLATFORM/.  The same controller
gives the same bytes, as far as the compiler does.
"""

import hashlib
import io
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from dobc_design import __version__
from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SolverError

from .c_controller import Controller
from .c_folder import header_text, source_text
from .c_text import string, template, template_text

MODEL = "dobc_agent"
COMPILERS = ("cc", "gcc", "clang")
DATE = (1980, 1, 1, 0, 0, 0)  # of the files in the zip
CURE = "`dobc export --c DIR` writes the sources alone."
OPTIONS = ("-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden")
SOURCES = ("dobc_agent.c", "fmi3_agent.c")
_LISTED = "".join(f'<SourceFile name="{name}"/>' for name in SOURCES)
TIME_LIMIT = 120  # s for the compiler
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
MACHINES = {"AMD64": "x86_64", "arm64": "aarch64"}


BUILD = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{MODEL}">
    <SourceFileSet language="C99">{_LISTED}</SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


@noun
class Fmu(Shown):
    """The bytes of an FMU and the platform its library is for, None where there is no compiler:
    sources only then."""

    data: bytes
    platform: str | None

    def _card(self) -> Card:
        made = "sources only, there is no compiler"
        if self.platform is not None:
            made = f"library for {self.platform}"
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
    # The token says to an importer whether the library is that of the description.
    code = header_text(controller) + source_text(controller)
    token = hashlib.sha256(code.encode("utf-8")).hexdigest()
    files = {}
    for name, text in sources(controller, token).items():
        files[f"sources/{name}"] = text.encode("utf-8")
    library = _compiled(files)
    described = {"modelDescription.xml": description(controller, token).encode("utf-8"), **files}
    if library is not None:
        described[f"binaries/{library.platform}/{library.name}"] = library.data
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in described.items():
            # Date and rights never change, so that the same controller gives the same bytes.
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return Fmu(data=stream.getvalue(), platform=None if library is None else library.platform)


def sources(controller: Controller, token: str) -> dict[str, str]:
    """The C files of the FMU and buildDescription.xml, by name."""
    code = template_text("fmi3_agent.c")
    marks = {
        "TOKEN": string(token),
        "HEARD": str(len(controller.agents[0].neighbours)),
        "STUBS": template("fmi3_stubs.c.j2").render().removesuffix("\n"),
    }
    for mark, text in marks.items():
        code = code.replace(f"@{mark}@", text)
    return {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "fmi3_types.h": template_text("fmi3_types.h"),
        "fmi3_agent.c": code,
        "buildDescription.xml": BUILD,
    }


def variables(controller: Controller) -> list[Variable]:
    """The real variables in the order of their numbers: x, y, u, v, dhat, and what is heard of
    every neighbour."""
    problem = controller.problem
    measured = len(controller.outputs) or problem.m
    wanted = [
        ("x", "input", "what is measured of the state", measured),
        ("y", "output", "the packet for those who listen, less the goal", controller.felt),
        ("u", "output", "input (19), held until the next sample", problem.inputs),
        ("v", "output", "couplings + u, held until the next sample", problem.inputs),
        ("dhat", "output", "estimated disturbance", problem.inputs),
    ]
    for j in controller.agents[0].neighbours:
        label = problem.network.labels[j]
        wanted.append((f"heard[{label}]", "input", f"packet y of agent {label}", controller.felt))
    found: list[Variable] = []
    for name, causality, text, size in wanted:
        for c in range(size):
            full = f"{name}[{c + 1}]" if size > 1 else name
            # Number 0 is time and number 1 is mode.
            found.append(Variable(full, 2 + len(found), causality, text))
    return found


def description(controller: Controller, token: str) -> str:
    """modelDescription.xml."""
    problem, agent = controller.problem, controller.agents[0]
    period = repr(float(controller.period))
    modes = list(problem.network.modes)
    return template("modelDescription.xml.j2").render(
        quoted=quoteattr,
        name=f"{problem.name}: agent {agent.label}",
        token=token,
        about=f"Observer (13) and controller (19) of agent {agent.label}, sampled every {period} "
        "s.",
        version=__version__,
        model=MODEL,
        period=period,
        modes=f"which graph holds: {', '.join(modes[:12])}",
        variables=variables(controller),
    )


class _Library(NamedTuple):
    platform: str  # in FMI's words
    name: str
    data: bytes


def _compiled(files: Mapping[str, bytes]) -> _Library | None:
    """The shared library; None where there is no compiler, or none for shared libraries."""
    compilers = filter(None, map(shutil.which, COMPILERS))
    compiler = next(compilers, None)
    # Sources are enough where there is no compiler: the importer may have one.
    if compiler is None or platform.system() not in SYSTEMS:
        return None
    system, suffix = SYSTEMS[platform.system()]
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            (Path(folder) / Path(name).name).write_bytes(data)
        library = Path(folder) / f"{MODEL}{suffix}"
        command = [compiler, *OPTIONS, *SOURCES, "-o", library.name, "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, check=False, text=True, timeout=TIME_LIMIT
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            message = f"the C compiler could not be run: {error}."
            raise SolverError(message, key="--fmu", cure=CURE) from error
        if done.returncode != 0 or not library.exists():
            # The first line says what is wrong; the others follow from it.
            said = done.stderr.strip().splitlines() or ["no message"]
            message = f"the C compiler refused the FMU's code: {said[0][:200]}."
            raise SolverError(message, key="--fmu", cure=CURE)
        # FMI has names of its own for some processors.
        machine = MACHINES.get(platform.machine(), platform.machine())
        return _Library(f"{machine}-{system}", library.name, library.read_bytes())
