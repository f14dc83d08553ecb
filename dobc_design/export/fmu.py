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
from collections.abc import Iterator, Mapping
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

_VALUES = "const fmi3ValueReference references[], size_t count"
_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "Boolean", "String")
_START = (
    "fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,"
    " fmi3InstanceEnvironment environment, fmi3LogMessageCallback log"
)
_SEED = (
    "const fmi3ValueReference unknowns[], size_t unknown_count, const fmi3ValueReference knowns[], size_t known_count,"
    " const fmi3Float64 seed[], size_t seed_count, fmi3Float64 sensitivity[], size_t sensitivity_count"
)

# Name -> parameters after the instance.
PLAIN: dict[str, str] = {
    "EnterEventMode": "",
    "EnterConfigurationMode": "",
    "ExitConfigurationMode": "",
    "EnterContinuousTimeMode": "",
    "EvaluateDiscreteStates": "",
    "CompletedIntegratorStep": "fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate",
    "SetTime": "fmi3Float64 time",
    "SetContinuousStates": "const fmi3Float64 states[], size_t count",
    "GetContinuousStateDerivatives": "fmi3Float64 derivatives[], size_t count",
    "GetEventIndicators": "fmi3Float64 indicators[], size_t count",
    "GetContinuousStates": "fmi3Float64 states[], size_t count",
    "GetNominalsOfContinuousStates": "fmi3Float64 nominals[], size_t count",
    "GetNumberOfEventIndicators": "size_t *count",
    "GetNumberOfContinuousStates": "size_t *count",
    "GetOutputDerivatives": f"{_VALUES}, const fmi3Int32 orders[], fmi3Float64 values[], size_t size",
    "ActivateModelPartition": "fmi3ValueReference clock, fmi3Float64 time",
    "GetNumberOfVariableDependencies": "fmi3ValueReference reference, size_t *count",
    "GetVariableDependencies": (
        "fmi3ValueReference dependent, size_t dependents[], fmi3ValueReference independents[],"
        " size_t elements[], fmi3DependencyKind kinds[], size_t count"
    ),
    "SerializedFMUStateSize": "fmi3FMUState state, size_t *size",
    "SerializeFMUState": "fmi3FMUState state, fmi3Byte bytes[], size_t size",
    "DeserializeFMUState": "const fmi3Byte bytes[], size_t size, fmi3FMUState *state",
    "GetDirectionalDerivative": _SEED,
    "GetAdjointDerivative": _SEED,
    "GetBinary": f"{_VALUES}, size_t sizes[], fmi3Binary values[], size_t size",
    "SetBinary": f"{_VALUES}, const size_t sizes[], const fmi3Binary values[], size_t size",
    "GetClock": f"{_VALUES}, fmi3Clock values[]",
    "SetClock": f"{_VALUES}, const fmi3Clock values[]",
    "GetIntervalDecimal": f"{_VALUES}, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]",
    "GetIntervalFraction": (
        f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]"
    ),
    "GetShiftDecimal": f"{_VALUES}, fmi3Float64 shifts[]",
    "GetShiftFraction": f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[]",
    "SetIntervalDecimal": f"{_VALUES}, const fmi3Float64 intervals[]",
    "SetIntervalFraction": f"{_VALUES}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]",
    "SetShiftDecimal": f"{_VALUES}, const fmi3Float64 shifts[]",
    "SetShiftFraction": f"{_VALUES}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]",
    "UpdateDiscreteStates": (
        "fmi3Boolean *needed, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values,"
        " fmi3Boolean *next_defined, fmi3Float64 *next"
    ),
}
OTHER_KINDS: dict[str, str] = {
    "InstantiateModelExchange": _START,
    "InstantiateScheduledExecution": (
        f"{_START}, fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,"
        " fmi3UnlockPreemptionCallback unlock"
    ),
}


def stubs() -> str:
    """C definitions of them all."""
    return "\n".join(_definitions())


def _definitions() -> Iterator[str]:
    for name, parameters in PLAIN.items():
        whole = ", ".join(filter(None, ["fmi3Instance instance", parameters]))
        yield _definition("fmi3Status", name, whole, "fmi3Error")
    for kind in _TYPES:
        for verb, const in (("Get", ""), ("Set", "const ")):
            values = f"fmi3Instance instance, {_VALUES}, {const}fmi3{kind} values[], size_t size"
            yield _definition("fmi3Status", f"{verb}{kind}", values, "fmi3Error")
    for name, parameters in OTHER_KINDS.items():
        yield _definition("fmi3Instance", name, parameters, "0")


def _definition(returns: str, name: str, parameters: str, answer: str) -> str:
    names = [each.split()[-1].strip("*").removesuffix("[]") for each in parameters.split(",")]
    unused = "".join(f"    (void){each};\n" for each in names)
    return f"FMI3_EXPORT {returns} fmi3{name}({parameters})\n{{\n{unused}    return {answer};\n}}\n"


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
        cure = f"Labels are {', '.join(each.label for each in controller.agents[:6])}, ..."
        raise SpecError(f"there is no agent {agent[:60]!r} in the network.", key="--agent", cure=cure)
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
            message = f"the C compiler refused the FMU's code: {first[:200]}."
            raise SolverError(message, key="--fmu", cure="`dobc export --c DIR` writes the sources alone.")
        return library.read_bytes(), f"{machine}-{_system()[0]}"
