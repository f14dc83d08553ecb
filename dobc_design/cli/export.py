"""``dobc export``: what each target writes, and what is said about it."""

import shlex
from pathlib import Path

from dobc_design._checks import noun
from dobc_design.errors import refused

from .output import (
    Document,
    Progress,
    Stage,
    check_target,
    load_problem,
    naming_options,
    print_json,
    read_claims,
    refuse_option,
    say,
    write_file,
)

TARGETS = "--c DIR, --fmu FILE, --sdpa FILE, --python-control FILE or --rocq FILE"
#: Which targets have a use for which option.
BELONGS = {
    "period": ("--c", "--fmu"),
    "precision": ("--c",),
    "agent": ("--c", "--fmu"),
    "certificate": ("--c",),
    "problem": ("--rocq",),
    "rate": ("--rocq",),
    "theorem": ("--rocq",),
}


@noun
class Targets:
    """What is written, and where to; exactly one of them."""

    c: Path | None = None
    fmu: Path | None = None
    sdpa: Path | None = None
    python_control: Path | None = None
    rocq: Path | None = None


@noun
class Asked:
    """The options beside the target."""

    period: str | None = None
    precision: str | None = None
    agent: str | None = None
    certificate: Path | None = None
    problem: str | None = None
    rate: bool = False
    theorem: bool = False
    force: bool = False

    def require_for(self, target: str) -> None:
        """Refuse options that the target has no use for: they would be a misunderstanding."""
        for name, targets in BELONGS.items():
            value = getattr(self, name)
            # A flag that is not set and an option that is not given mean nothing.
            if value not in (None, False) and target not in targets:
                key, cure = f"--{name}", f"It is for {' and '.join(targets)}."
                raise refused(key, f"{key} has no meaning with {target}.", cure)


#: What was written: as the document of --json, and in words.
Exported = tuple[Document, str]


def export(
    file: str,
    targets: Targets,
    asked: Asked,
    as_json: bool = False,
) -> None:
    """Write C code, an FMU, the LMI for other solvers, a python-control file, or a proof for Rocq
    (Coq 8.16)."""
    writers = (
        ("--c", targets.c, _c),
        ("--fmu", targets.fmu, _fmu),
        ("--sdpa", targets.sdpa, _sdpa),
        ("--python-control", targets.python_control, _python),
        ("--rocq", targets.rocq, _rocq),
    )
    chosen = [(key, path, write) for key, path, write in writers if path is not None]
    with Progress() as progress:
        if len(chosen) != 1:
            raise refused("export", "exactly one target must be named.", f"{TARGETS}.")
        key, path, write = chosen[0]
        asked.require_for(key)
        # C code is a folder, which has its own rule of what may be replaced.
        if key == "--c":
            refuse_option(path, key)
        else:
            check_target(path, force=asked.force, key=key)
        document, words = write(file, path, asked, progress)
    if as_json:
        print_json(document)
    else:
        say(words)


def _c(file: str, folder: Path, asked: Asked, progress: Stage) -> Exported:
    from dobc_design.export import to_c
    from dobc_design.export.c_folder import COMPILE, check_free

    check_free(folder, force=asked.force)
    problem = load_problem(file)
    claims = None
    if asked.certificate is not None:
        progress("verifying the certificate")
        claims = read_claims(asked.certificate, problem)
    progress("discretising and simulating")
    with naming_options("export"):
        found = to_c(
            problem,
            period=asked.period,
            precision=asked.precision or "double",
            agents=None if asked.agent is None else [asked.agent],
            certificate=claims,
        )
    written = [str(path) for path in found.save(folder, force=asked.force)]
    controller = found.controller
    document = {
        "c": str(folder),
        "files": written,
        "period": float(controller.period),
        "precision": controller.precision,
        "agents": [agent.label for agent in controller.agents],
        "tolerance": found.tolerance,
        "statements": [each.to_json() for each in found.statements],
    }
    lines = [str(found), *(f"wrote {path}" for path in written)]
    lines.append(f"compile and test it: cd {shlex.quote(str(folder))} && {COMPILE}")
    return document, "\n".join(lines)


def _fmu(file: str, target: Path, asked: Asked, progress: Stage) -> Exported:
    from dobc_design.export import to_fmu

    progress("discretising and compiling")
    found = to_fmu(file, period=asked.period, agent=asked.agent)
    write_file(target, found.data, key="--fmu")
    what = "with sources only: no C compiler was found, so the importer has to compile them"
    if found.platform:
        what = f"with a library for {found.platform}"
    document = {"fmu": str(target), "platform": found.platform}
    return document, f"wrote {target}, {what}"


def _sdpa(file: str, target: Path, asked: Asked, progress: Stage) -> Exported:
    from dobc_design.export import to_sdpa

    progress("deciding the theorem")
    write_file(target, to_sdpa(file).encode("ascii"), key="--sdpa")
    solve = shlex.join(["csdp", str(target)])
    words = f"wrote {target}\nsolve it with, say: {solve}"
    return {"sdpa": str(target)}, words


def _python(file: str, target: Path, asked: Asked, progress: Stage) -> Exported:
    from dobc_design.export import python_script

    write_file(target, python_script(file).encode("utf-8"), key="--python-control")
    return {"python_control": str(target)}, f"wrote {target}"


def _rocq(file: str, target: Path, asked: Asked, progress: Stage) -> Exported:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.export.rocq.matrices import rocq_proof
    from dobc_design.export.rocq.motions import motions_proof, proved_in_states

    certificate = Path(file)
    claims = read_claims(certificate)
    folder = certificate if certificate.is_dir() else certificate.parent
    trusted = load_problem(str(folder / "problem.json") if asked.problem is None else asked.problem)
    own = Certificate(problem=trusted, claims=claims)
    progress("looking at the rows piece by piece")
    # What is proved of motions says more, but it has no separate rate.
    motions = proved_in_states(own) is not None and not (asked.theorem or asked.rate)
    # The name of the file is the name of the module in Coq.
    if not target.stem.replace("_", "a").isalnum():
        raise refused(
            "--rocq", "Coq takes file names of letters, digits and _.", "Choose another name."
        )
    text = motions_proof(own) if motions else rocq_proof(own, rate=asked.rate)
    write_file(target, text.encode("ascii"), key="--rocq")
    words = f"wrote {target}\ncheck it with: {shlex.join(['coqc', str(target)])}"
    return {"rocq": str(target)}, words
