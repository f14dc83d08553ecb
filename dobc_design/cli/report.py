"""``dobc report``: the report of a certificate again, or two certificates side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dobc_design.cli import output
from dobc_design.errors import CertificateError, SpecError

if TYPE_CHECKING:
    from dobc_design.certificate.claims import Claims
    from dobc_design.problem.problem import Problem
    from dobc_design.report.refusal import Checked


def report(
    certificates: Annotated[
        list[Path],
        typer.Argument(metavar="CERT [CERT]", help="certificate.json, or its folder; one or two."),
    ],
    problem: Annotated[
        list[str] | None,
        typer.Option(help="The problem, once for each; default problem.json beside it."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder; default that of CERT, or for two ./NAME-NAME-comparison."),
    ] = None,
    pdf: Annotated[
        Path | None, typer.Option("--pdf", help="Also write a PDF; needs dobc_design[pdf].")
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="With all details open, also in the PDF.")
    ] = False,
    latex: Annotated[
        Path | None,
        typer.Option(
            "--latex", metavar="DIR", help="Also as LaTeX fragments and BibTeX, into DIR."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files there.")] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Write the report of a certificate again, or two certificates side by side, once all their
    claims are verified.

    Exit code 1 where a claim does not hold: the report then says that, and nothing of what the
    certificate claims.
    """
    from dobc_design.certificate.files import make_folder, write_together
    from dobc_design.report.comparison import conclusion
    from dobc_design.report.refusal import headline
    from dobc_design.report.write import (
        render_comparison,
        render_latex,
        render_refusal,
        render_report,
    )

    stages = output.Progress(quiet=quiet, verbose=verbose)
    _check_options(certificates, problem or [], out=out, pdf=pdf, latex=latex, force=force)
    named: list[str | None] = [*problem] if problem else [None] * len(certificates)
    letters = ("",) if len(certificates) == 1 else ("A", "B")
    with stages as progress:
        try:
            sides = [
                _checked(path, trusted, letter, progress)
                for path, trusted, letter in zip(certificates, named, letters, strict=True)
            ]
        # unreadable: what was handed in is wrong, not the machine
        except CertificateError as error:
            raise typer.Exit(
                output.fail(output.error_bodies(error), output.MISTAKE, as_json=as_json)
            ) from error
        holds, found = all(each.found.holds for each in sides), [each.certificate for each in sides]
        if len(found) == 1:
            folder = certificates[0] if certificates[0].is_dir() else certificates[0].parent
        else:
            names = dict.fromkeys(output.folder_name(each.problem.name) for each in found)
            folder = Path(f"{'-'.join(names)}-comparison")
        if not holds:
            pages = render_refusal(sides, pdf=pdf is not None)
        elif len(found) == 1:
            pages = render_report(found[0], pdf=pdf is not None, full=full, progress=progress)
        else:
            pages = render_comparison(*found, pdf=pdf is not None)
    folder = output.require_folder(folder if out is None else out)
    document = next(
        (pages.pop(name) for name in ("report.pdf", "comparison.pdf") if name in pages), None
    )
    own = len(found) == 1 and out is None  # beside its certificate a report is replaced
    output.require_free(folder, pages, force=own or force)
    files = {folder / name: data for name, data in pages.items()}
    if pdf is not None and document is not None:
        files[pdf] = document
    if latex is not None and holds:  # fragments of a paper repeat what is proved, or nothing
        fragments = render_latex(found[0])
        output.require_free(
            output.require_folder(latex, key="--latex"), fragments, force=force, key="--latex"
        )
        files |= {latex / name: data for name, data in fragments.items()}
        make_folder(latex)
    make_folder(folder)
    write_together(files)
    written = [str(path) for path in files]
    if as_json:
        failures = [list(each.found.failures) for each in sides]
        verdicts = [each.certificate.verdict.value if each.found.holds else None for each in sides]
        problems = [each.problem.name for each in found]
        output.print_json(
            {"problems": problems, "verdicts": verdicts, "failures": failures, "files": written}
        )
    elif not quiet:
        first = [headline(sides)] if not holds else [conclusion(*found)] if len(found) == 2 else []
        failed = [f"  NOT confirmed: {text}" for each in sides for text in each.found.failures]
        output.say("\n".join([*first, *failed, *(f"wrote {path}" for path in written)]))
    if not holds:
        raise typer.Exit(1)


def _check_options(
    given: list[Path],
    problems: list[str],
    *,
    out: Path | None,
    pdf: Path | None,
    latex: Path | None,
    force: bool,
) -> None:
    """Refuse what can be refused before anything is read.  Raises: SpecError."""
    if len(given) > 2:
        cure = "Leave the others out."
        raise SpecError(
            f"one or two certificates can be shown; got {len(given)}.", key="CERT", cure=cure
        )
    if problems and len(problems) != len(given):
        message = (
            f"--problem must be given once for each certificate; got {len(problems)} for "
            f"{len(given)}."
        )
        raise SpecError(
            message,
            key="--problem",
            cure="Leave it out where problem.json lies beside the certificate.",
        )
    output.refuse_option(out, key="--out")
    if pdf is not None:
        output.check_target(pdf, force=force, key="--pdf")
        if pdf.suffix.lower() != ".pdf":
            raise SpecError(
                f"{str(pdf)!r} must end in .pdf.", key="--pdf", cure=f"For example {pdf.name}.pdf."
            )
    if latex is not None and len(given) != 1:
        raise SpecError(
            "LaTeX fragments are of one certificate.", key="--latex", cure="Name one certificate."
        )


def _checked(
    path: Path, problem: str | None, letter: str, progress: Callable[[str], None]
) -> Checked:
    """A certificate with its problem, by default problem.json beside it, every claim decided again.

    Raises: SpecError for a problem that is another one or is not there; CertificateError for what
    is no certificate.
    """
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.text import read_claims
    from dobc_design.certification.certify import verify
    from dobc_design.problem.canonical import problem_sha256
    from dobc_design.problem.load import load_problem
    from dobc_design.report.refusal import Checked

    data = output.read_certificate(path)
    claims = read_claims(data)
    beside = (path if path.is_dir() else path.parent) / "problem.json"
    if problem is None and not beside.exists():
        message = (
            f"there is no problem.json beside {str(path)!r}: its verdict can only be repeated "
            "unverified, "
        )
        message += f"{claims.verdict.value}, and no report is written."
        raise SpecError(
            message,
            key="--problem",
            cure="Name the problem that it was made for with --problem FILE.",
        )
    own = load_problem(str(beside) if problem is None else problem)
    if problem_sha256(own) != claims.problem_sha256:
        message = f"the certificate {str(path)!r} is about another problem (its hash differs)."
        cure = "Name the problem that it was made for, once for each certificate."
        raise SpecError(message, key="--problem", cure=cure)
    progress("verifying the certificate")
    found = verify(data, own)
    if found.holds:
        claims = _with_own_sentence(claims, own)
    return Checked(letter=letter, certificate=Certificate(problem=own, claims=claims), found=found)


def _with_own_sentence(claims: Claims, problem: Problem) -> Claims:
    """Claims that hold, with the sentence of a decided verdict made from them: no text in a
    certificate is judged."""
    from dobc_design.certification.overall import decide_overall
    from dobc_design.problem.integrators import as_integrators
    from dobc_design.verdict import Verdict

    if claims.verdict is Verdict.UNDECIDED:
        return claims
    return replace(
        claims, reason=decide_overall(as_integrators(problem), claims.checks, claims.W).reason
    )
