"""One agent's controller as an FMU: FMI 3.0, co-simulation, with the C sources and, where a compiler is, the library.

The FMU is a zip file: modelDescription.xml, sources/, binaries/PLATFORM/.  The same controller gives the same bytes,
as far as the compiler does.
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
from dataclasses import dataclass, replace
from importlib import resources
from os import PathLike
from pathlib import Path
from xml.sax.saxutils import quoteattr

from dobc_design import __version__
from dobc_design._show.cards import Card, Shown
from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SolverError, SpecError
from dobc_design.export.c_code import header_text, source_text
from dobc_design.export.c_controller import Controller
from dobc_design.export.c_text import string
from dobc_design.export.fmu_functions import stubs

MODEL = "dobc_agent"
COMPILERS = ("cc", "gcc", "clang")
DATE = (1980, 1, 1, 0, 0, 0)  # of the files in the zip
TIME_LIMIT = 120  # s for the compiler
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib"), "Windows": ("windows", ".dll")}
MACHINES = {"AMD64": "x86_64", "arm64": "aarch64"}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Fmu(Shown):
    """The bytes of an FMU and the platform its library is for, None where there is no compiler: sources only then."""

    data: bytes
    platform: str | None

    def _card(self) -> Card:
        made = "sources only, there is no compiler" if self.platform is None else f"library for {self.platform}"
        return Card(title="FMU (FMI 3.0)", text=f"{len(self.data)} bytes, {made}")

    def __repr__(self) -> str:
        return f"<Fmu: {self._card().text}>"

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file, replacing an older one.  Raises: CertificateError when the machine refuses."""
        write_atomically(Path(path), self.data)
        return Path(path)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A variable of the FMU: its name, number, causality and what it is."""

    name: str
    reference: int
    causality: str
    text: str


def make_fmu(controller: Controller, *, agent: str | None = None) -> Fmu:
    """Build the FMU of one agent: ``agent``, else the first pinned one of the controller's table, else its first.

    Raises: SpecError for an unknown agent; SolverError if the compiler refuses the code.
    """
    one = _of_one_agent(controller, agent)
    token = hashlib.sha256((header_text(one) + source_text(one)).encode("utf-8")).hexdigest()
    files = {f"sources/{name}": text.encode("utf-8") for name, text in sources(one, token).items()}
    library, where = _compiled(files)
    described = {"modelDescription.xml": description(one, token).encode("utf-8"), **files}
    if library is not None and where is not None:
        described[f"binaries/{where}/{MODEL}{_system()[1]}"] = library
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in described.items():
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return Fmu(data=stream.getvalue(), platform=where)


def _of_one_agent(controller: Controller, agent: str | None) -> Controller:
    pinned = [each for each in controller.agents if any(map(any, each.gain))]
    wanted = [each for each in controller.agents if each.label == agent]
    if agent is not None and not wanted:
        raise SpecError(
            f"there is no agent {agent[:60]!r} in the network.",
            key="--agent",
            cure=f"Labels are {', '.join(each.label for each in controller.agents[:6])}, ...",
        )
    return replace(controller, agents=((wanted or pinned or list(controller.agents))[0],))


def sources(controller: Controller, token: str) -> dict[str, str]:
    """The C files of the FMU and buildDescription.xml, by name."""
    folder = resources.files("dobc_design.export") / "templates"
    wrapper = (folder / "fmi3_agent.c").read_text("utf-8")
    heard = len(controller.agents[0].neighbours)
    wrapper = wrapper.replace("@TOKEN@", string(token)).replace("@HEARD@", str(heard)).replace("@STUBS@", stubs())
    listed = "".join(f'<SourceFile name="{name}"/>' for name in ("dobc_agent.c", "fmi3_agent.c"))
    build = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{MODEL}">\n    <SourceFileSet language="C99">{listed}'
        "</SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )
    return {
        "dobc_agent.h": header_text(controller),
        "dobc_agent.c": source_text(controller),
        "fmi3_types.h": (folder / "fmi3_types.h").read_text("utf-8"),
        "fmi3_agent.c": wrapper,
        "buildDescription.xml": build,
    }


def variables(controller: Controller) -> list[Variable]:
    """The real variables in the order of their numbers: x, y, u, v, dhat, and what is heard of every neighbour."""
    m, labels, agent = controller.problem.m, controller.problem.network.labels, controller.agents[0]
    kinds = (
        ("x", "input", "measured state"),
        ("y", "output", "x - goal: the packet for those who listen"),
        ("u", "output", "input (19), held until the next sample"),
        ("v", "output", "couplings + u, held until the next sample"),
        ("dhat", "output", "estimated disturbance"),
    )
    wanted = [(name, causality, text) for name, causality, text in kinds]
    wanted += [(f"heard[{labels[j]}]", "input", f"packet y of agent {labels[j]}") for j in agent.neighbours]
    found: list[Variable] = []
    for name, causality, text in wanted:
        for c in range(m):
            full = f"{name}[{c + 1}]" if m > 1 else name
            found.append(Variable(name=full, reference=2 + len(found), causality=causality, text=text))
    return found


def description(controller: Controller, token: str) -> str:
    """modelDescription.xml."""
    problem, agent, period = controller.problem, controller.agents[0], repr(float(controller.period))
    about = f"Observer (13) and controller (19) of agent {agent.label}, sampled every {period} s."
    found = variables(controller)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(f"{problem.name}: agent {agent.label}")}'
        f' instantiationToken="{token}" description={quoteattr(about)} generationTool="dobc_design {__version__}"'
        ' variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{MODEL}" canHandleVariableCommunicationStepSize="true"'
        f' canGetAndSetFMUState="true" fixedInternalStepSize="{period}"/>',
        f'  <DefaultExperiment startTime="0" stopTime="10" stepSize="{period}"/>',
        "  <ModelVariables>",
        '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>',
        '    <Int32 name="mode" valueReference="1" causality="input" variability="discrete" start="0"'
        f" description={quoteattr('which graph holds: ' + ', '.join(list(problem.network.modes)[:12]))}/>",
    ]
    for each in found:
        ending = 'start="0"' if each.causality == "input" else 'initial="calculated"'
        lines.append(
            f'    <Float64 name={quoteattr(each.name)} valueReference="{each.reference}" causality="{each.causality}"'
            f' variability="discrete" {ending} description={quoteattr(each.text)}/>'
        )
    outputs = [each.reference for each in found if each.causality == "output"]
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    lines += [f'    <Output valueReference="{reference}"/>' for reference in outputs]
    lines += [f'    <InitialUnknown valueReference="{reference}"/>' for reference in outputs]
    return "\n".join([*lines, "  </ModelStructure>", "</fmiModelDescription>", ""])


def _system() -> tuple[str, str]:
    return SYSTEMS.get(platform.system(), ("linux", ".so"))


def _compiled(files: Mapping[str, bytes]) -> tuple[bytes | None, str | None]:
    """The shared library and its FMI platform; nothing where there is no compiler, or none for shared libraries."""
    compiler = next((found for name in COMPILERS if (found := shutil.which(name))), None)
    if compiler is None or platform.system() not in ("Linux", "Darwin"):
        return None, None
    machine = MACHINES.get(platform.machine(), platform.machine())
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            (Path(folder) / Path(name).name).write_bytes(data)
        library = Path(folder) / f"{MODEL}{_system()[1]}"
        command = [
            compiler,
            "-std=c99",
            "-O2",
            "-shared",
            "-fPIC",
            "-fvisibility=hidden",
            "dobc_agent.c",
            "fmi3_agent.c",
            "-o",
            library.name,
            "-lm",
        ]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, check=False, text=True, timeout=TIME_LIMIT)
        except (OSError, subprocess.TimeoutExpired) as error:
            cure = "`dobc export --c DIR` writes the sources alone."
            raise SolverError(f"the C compiler could not be run: {error}.", key="--fmu", cure=cure) from error
        if done.returncode != 0 or not library.exists():
            first = next(iter(done.stderr.strip().splitlines()), "no message")
            raise SolverError(
                f"the C compiler refused the FMU's code: {first[:200]}.",
                key="--fmu",
                cure="`dobc export --c DIR` writes the sources alone.",
            )
        return library.read_bytes(), f"{machine}-{_system()[0]}"
