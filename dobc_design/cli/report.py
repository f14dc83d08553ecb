"""``dobc report``: the report of a certificate again, or two certificates side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dobc_design.cli import output
from dobc_design.errors import CertificateError, SpecError

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate


def report(
    certificates: Annotated[
        list[Path], typer.Argument(metavar="CERT [CERT]", help="certificate.json, or its folder; one or two.")
    ],
    problem: Annotated[
        list[str] | None, typer.Option(help="The problem, once for each; default problem.json beside it.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default that of CERT, or for two ./NAME-NAME-comparison.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option("--pdf", help="Also write a PDF; needs dobc_design[pdf].")] = None,
    full: Annotated[bool, typer.Option("--full", help="With all details open, also in the PDF.")] = False,
    latex: Annotated[
        Path | None, typer.Option("--latex", metavar="DIR", help="Also as LaTeX fragments and BibTeX, into DIR.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files there.")] = False,
    quiet: output.Quiet = False,
    verbose: output.Verbose = False,
    as_json: output.Json = False,
) -> None:
    """Write the report of a certificate again, or two certificates side by side."""
    from dobc_design.certificate.files import make_folder, write_together
    from dobc_design.report.comparison import conclusion
    from dobc_design.report.write import render_comparison, render_latex, render_report

    stages = output.Progress(quiet=quiet, verbose=verbose)
    _check_options(certificates, problem or [], out=out, pdf=pdf, latex=latex, force=force)
    try:
        named: list[str | None] = [*problem] if problem else [None] * len(certificates)
        found = [_read(path, trusted) for path, trusted in zip(certificates, named, strict=True)]
    except CertificateError as error:  # unreadable: what was handed in is wrong, not the machine
        raise typer.Exit(output.fail(output.error_bodies(error), output.MISTAKE, as_json=as_json)) from error
    with stages as progress:
        if len(found) == 1:
            beside = certificates[0] if certificates[0].is_dir() else certificates[0].parent
            pages, folder = render_report(found[0], pdf=pdf is not None, full=full, progress=progress), beside
        else:
            names = dict.fromkeys(output.folder_name(each.problem.name) for each in found)
            pages, folder = render_comparison(*found, pdf=pdf is not None), Path(f"{'-'.join(names)}-comparison")
    folder = output.require_folder(folder if out is None else out)
    document = next((pages.pop(name) for name in ("report.pdf", "comparison.pdf") if name in pages), None)
    own = len(found) == 1 and out is None  # beside its certificate a report is replaced
    output.require_free(folder, pages, force=own or force)
    files = {folder / name: data for name, data in pages.items()}
    if pdf is not None and document is not None:
        files[pdf] = document
    if latex is not None:
        fragments = render_latex(found[0])
        output.require_free(output.require_folder(latex, key="--latex"), fragments, force=force, key="--latex")
        files |= {latex / name: data for name, data in fragments.items()}
        make_folder(latex)
    make_folder(folder)
    write_together(files)
    written = [str(path) for path in files]
    if as_json:
        problems, verdicts = [each.problem.name for each in found], [each.verdict.value for each in found]
        output.print_json({"problems": problems, "verdicts": verdicts, "files": written})
    elif not quiet:
        first = [conclusion(*found)] if len(found) == 2 else []
        output.say("\n".join([*first, *(f"wrote {path}" for path in written)]))


def _check_options(
    given: list[Path], problems: list[str], *, out: Path | None, pdf: Path | None, latex: Path | None, force: bool
) -> None:
    """Refuse what can be refused before anything is read.  Raises: SpecError."""
    if len(given) > 2:
        cure = "Leave the others out."
        raise SpecError(f"one or two certificates can be shown; got {len(given)}.", key="CERT", cure=cure)
    if problems and len(problems) != len(given):
        message = f"--problem must be given once for each certificate; got {len(problems)} for {len(given)}."
        raise SpecError(message, key="--problem", cure="Leave it out where problem.json lies beside the certificate.")
    output.refuse_option(out, key="--out")
    if pdf is not None:
        output.check_target(pdf, force=force, key="--pdf")
        if pdf.suffix.lower() != ".pdf":
            raise SpecError(f"{str(pdf)!r} must end in .pdf.", key="--pdf", cure=f"For example {pdf.name}.pdf.")
    if latex is not None and len(given) != 1:
        raise SpecError("LaTeX fragments are of one certificate.", key="--latex", cure="Name one certificate.")


def _read(path: Path, problem: str | None) -> Certificate:
    """A certificate with its problem, by default problem.json beside it.  Raises: SpecError for a problem that is
    another one; CertificateError for what is no certificate."""
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.text import read_claims
    from dobc_design.problem.canonical import problem_sha256
    from dobc_design.problem.load import load_problem

    claims = read_claims(output.read_certificate(path))
    folder = path if path.is_dir() else path.parent
    own = load_problem(str(folder / "problem.json") if problem is None else problem)
    if problem_sha256(own) != claims.problem_sha256:
        message = f"the certificate {str(path)!r} is about another problem (its hash differs)."
        cure = "Name the problem that it was made for, once for each certificate."
        raise SpecError(message, key="--problem", cure=cure)
    return Certificate(problem=own, claims=claims)
