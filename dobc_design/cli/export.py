"""The body of ``dobc export``: what each target writes, and what is said about it."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.cli.output import check_target, read_certificate, refuse_option, write_file
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.load import load_problem

if TYPE_CHECKING:
    from dobc_design.certificate.claims import Claims
    from dobc_design.problem.problem import Problem

TARGETS = "--c DIR, --fmu FILE, --sdpa FILE, --python-control FILE or --rocq FILE"


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """The options of ``dobc export``; exactly one of the first five is given."""

    c: Path | None
    fmu: Path | None
    sdpa: Path | None
    python_control: Path | None
    rocq: Path | None
    period: str | None
    precision: str | None
    agent: str | None
    certificate: Path | None
    problem: str | None
    rate: bool
    force: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """What was written: the document of --json, and the same in words."""

    document: dict[str, Any]
    text: str


def run_export(file: str, asked: Asked, *, progress: Callable[[str], None]) -> Exported:
    """Write the one target that is asked for.  Raises: SpecError for wrong options, before anything is written."""
    named = {
        "--c": asked.c,
        "--fmu": asked.fmu,
        "--sdpa": asked.sdpa,
        "--python-control": asked.python_control,
        "--rocq": asked.rocq,
    }
    chosen = [key for key, value in named.items() if value is not None]
    if len(chosen) != 1:
        raise SpecError("exactly one target must be named.", key="export", cure=f"{TARGETS}.")
    _check_options(asked, chosen[0])
    if asked.c is not None:
        return _c(file, asked.c, asked, progress)
    if asked.fmu is not None:
        return _fmu(file, asked.fmu, asked, progress)
    if asked.sdpa is not None:
        return _sdpa(file, asked.sdpa, asked, progress)
    if asked.python_control is not None:
        return _python(file, asked.python_control, asked)
    return _rocq(Path(file), asked.rocq or Path(), asked)


def _check_options(asked: Asked, target: str) -> None:
    """Refuse options that the target has no use for: they would be a misunderstanding."""
    belongs = {
        "--period": (asked.period, ("--c", "--fmu")),
        "--precision": (asked.precision, ("--c",)),
        "--agent": (asked.agent, ("--c", "--fmu")),
        "--certificate": (asked.certificate, ("--c",)),
        "--problem": (asked.problem, ("--rocq",)),
        "--rate": (asked.rate or None, ("--rocq",)),
    }
    for key, (value, targets) in belongs.items():
        if value is not None and target not in targets:
            raise SpecError(f"{key} has no meaning with {target}.", key=key, cure=f"It is for {' and '.join(targets)}.")


def _c(file: str, folder: Path, asked: Asked, progress: Callable[[str], None]) -> Exported:
    from dobc_design.export.c_folder import COMPILE, check_free
    from dobc_design.export.interchange import to_c

    refuse_option(folder, key="--c")
    check_free(folder, force=asked.force)
    problem = load_problem(file)
    claims = None if asked.certificate is None else _checked_claims(asked.certificate, problem, progress)
    progress("discretising and simulating")
    found = to_c(
        problem,
        period=asked.period,
        precision=asked.precision or "double",
        agents=None if asked.agent is None else [asked.agent],
        certificate=claims,
    )
    written = found.save(folder, force=asked.force)
    controller = found.controller
    document = {
        "c": str(folder),
        "files": [str(path) for path in written],
        "period": float(controller.period),
        "precision": controller.precision,
        "agents": [agent.label for agent in controller.agents],
        "tolerance": found.tolerance,
        "statements": [each.to_json() for each in found.statements],
    }
    test = f"compile and test it: cd {shlex.quote(str(folder))} && {COMPILE}"
    lines = [str(found), *(f"wrote {path}" for path in written), test]
    return Exported(document=document, text="\n".join(lines))


def _fmu(file: str, target: Path, asked: Asked, progress: Callable[[str], None]) -> Exported:
    from dobc_design.export.interchange import to_fmu

    check_target(target, force=asked.force, key="--fmu")
    problem = load_problem(file)
    progress("discretising and compiling")
    found = to_fmu(problem, period=asked.period, agent=asked.agent)
    write_file(target, found.data, key="--fmu")
    words = (
        f"with a library for {found.platform}"
        if found.platform
        else "with sources only: no C compiler was found, so the importer has to compile them"
    )
    return Exported(document={"fmu": str(target), "platform": found.platform}, text=f"wrote {target}, {words}")


def _sdpa(file: str, target: Path, asked: Asked, progress: Callable[[str], None]) -> Exported:
    from dobc_design.export.interchange import to_sdpa

    check_target(target, force=asked.force, key="--sdpa")
    problem = load_problem(file)
    progress("deciding the theorem")
    write_file(target, to_sdpa(problem).encode("ascii"), key="--sdpa")
    text = f"wrote {target}\nsolve it with, say: {shlex.join(['csdp', str(target)])}"
    return Exported(document={"sdpa": str(target)}, text=text)


def _python(file: str, target: Path, asked: Asked) -> Exported:
    from dobc_design.export.interchange import python_script

    check_target(target, force=asked.force, key="--python-control")
    write_file(target, python_script(file).encode("utf-8"), key="--python-control")
    return Exported(document={"python_control": str(target)}, text=f"wrote {target}")


def _rocq(certificate: Path, target: Path, asked: Asked) -> Exported:
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.files import write_atomically
    from dobc_design.export.rocq import rocq_proof

    check_target(target, force=asked.force, key="--rocq")
    folder = certificate if certificate.is_dir() else certificate.parent
    claims = _claims(certificate)
    trusted = load_problem(str(folder / "problem.json") if asked.problem is None else asked.problem)
    text = rocq_proof(Certificate(problem=trusted, claims=claims), rate=asked.rate)
    write_atomically(target, text.encode("ascii"))
    return Exported(
        document={"rocq": str(target)}, text=f"wrote {target}\ncheck it with: {shlex.join(['coqc', str(target)])}"
    )


def _claims(certificate: Path) -> Claims:
    """The claims of a certificate.  Raises: SpecError when it cannot be read: what was handed in is wrong."""
    from dobc_design.certificate.text import read_claims

    try:
        return read_claims(read_certificate(certificate))
    except CertificateError as error:
        raise SpecError(error.message, key=error.key, cure=error.cure) from error


def _checked_claims(certificate: Path, problem: Problem, progress: Callable[[str], None]) -> Claims:
    """The claims, after every one of them was decided again for this problem.  Raises: SpecError otherwise."""
    from dobc_design.certification.certify import verify

    claims = _claims(certificate)
    progress("checking the certificate")
    if not verify(claims, problem).holds:
        raise SpecError(
            "--certificate must be one of this problem that holds; this one does not.",
            key="--certificate",
            cure="`dobc verify` says why; `dobc certify` makes a new one.",
        )
    return claims
