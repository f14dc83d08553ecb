"""The body of ``dobc report``: the report of a certificate again, or two certificates side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dobc_design.certificate.files import make_folder, write_together
from dobc_design.cli.output import (
    MISTAKE,
    Manner,
    Progress,
    check_target,
    fail_with,
    folder_name,
    print_json,
    read_certificate,
    refuse_option,
    say,
)
from dobc_design.errors import CertificateError, SpecError
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.load import load_problem

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate

PROBLEM, PDF = "problem.json", "report.pdf"


def run_report(
    given: Sequence[Path],
    *,
    problems: Sequence[str],
    out: Path | None,
    force: bool,
    manner: Manner,
    as_json: bool,
    pdf: Path | None = None,
    latex: Path | None = None,
) -> int:
    """Write the pages; return the exit code.  Raises: SpecError, also for a problem that is not the certificate's."""
    if len(given) > 2:
        raise SpecError(
            f"one or two certificates can be shown; got {len(given)}.", key="CERT", cure="Leave the others out."
        )
    if problems and len(problems) != len(given):
        raise SpecError(
            f"--problem must be given once for each certificate; got {len(problems)} for {len(given)}.",
            key="--problem",
            cure="Leave it out where problem.json lies beside the certificate.",
        )
    if out is not None:
        refuse_option(out, key="--out")
    if pdf is not None:
        _check_pdf(pdf, force=force)
    if latex is not None and len(given) != 1:
        raise SpecError("LaTeX fragments are of one certificate.", key="--latex", cure="Name one certificate.")
    try:
        named: list[str | None] = [*problems] if problems else [None] * len(given)
        certificates = [read(path, problem) for path, problem in zip(given, named, strict=True)]
    except CertificateError as error:  # unreadable: what was handed in is wrong, not the machine
        return fail_with(error, MISTAKE, as_json=as_json)
    with Progress(manner) as progress:
        pages, folder = _pages(certificates, given, out, progress, pdf=pdf is not None)
    if folder.exists() and not folder.is_dir():
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--out", cure="Choose another with --out.")
    own = len(certificates) == 1 and out is None  # beside its certificate a report is replaced
    document = next((pages.pop(name) for name in (PDF, "comparison.pdf") if name in pages), None)
    _check_free(folder, pages, key="--out", force=own or force)
    files = {folder / name: data for name, data in pages.items()}
    if pdf is not None and document is not None:
        files[pdf] = document
    if latex is not None:
        files |= _fragments(certificates[0], latex, force=force)
        make_folder(latex)
    make_folder(folder)
    write_together(files)
    written = [str(path) for path in files]
    if as_json:
        names = [each.problem.name for each in certificates]
        print_json({"problems": names, "verdicts": [each.verdict.value for each in certificates], "files": written})
    elif manner is not Manner.QUIET:
        say("\n".join([*_words(certificates), *(f"wrote {path}" for path in written)]))
    return 0


def _fragments(certificate: Certificate, folder: Path, *, force: bool) -> dict[Path, bytes]:
    from dobc_design.report.write import render_latex

    if folder.exists() and not folder.is_dir():
        raise SpecError(f"{str(folder)!r} is not a folder.", key="--latex", cure="Choose another with --latex.")
    pages = render_latex(certificate)
    _check_free(folder, pages, key="--latex", force=force)
    return {folder / name: data for name, data in pages.items()}


def _check_free(folder: Path, names: Iterable[str], *, key: str, force: bool) -> None:
    """Refuse a folder that holds one of the files, unless ``force``.  Raises: SpecError."""
    there = [name for name in names if (folder / name).exists()]
    if there and not force:
        raise SpecError(f"{str(folder / there[0])!r} exists already.", key=key, cure="Add --force to replace it.")


def _check_pdf(path: Path, *, force: bool) -> None:
    """Refuse a PDF that would replace a file.  Raises: SpecError."""
    check_target(path, force=force, key="--pdf")
    if path.suffix.lower() != ".pdf":
        raise SpecError(f"{str(path)!r} must end in .pdf.", key="--pdf", cure=f"For example {path.name}.pdf.")


def _pages(
    certificates: Sequence[Certificate],
    given: Sequence[Path],
    out: Path | None,
    progress: Callable[[str], None],
    *,
    pdf: bool,
) -> tuple[dict[str, bytes], Path]:
    """The files by name, and the folder they go to."""
    from dobc_design.report.write import render_comparison, render_report

    if len(certificates) == 1:
        beside = given[0] if given[0].is_dir() else given[0].parent
        return render_report(certificates[0], pdf=pdf, progress=progress), beside if out is None else out
    first, second = certificates
    names = dict.fromkeys(folder_name(each.problem.name) for each in certificates)
    folder = Path(f"{'-'.join(names)}-comparison") if out is None else out
    return render_comparison(first, second, pdf=pdf), folder


def _words(certificates: Sequence[Certificate]) -> list[str]:
    if len(certificates) == 1:
        return []
    from dobc_design.report.comparison import conclusion

    return [conclusion(*certificates)]


def read(path: Path, problem: str | None) -> Certificate:
    """A certificate with its problem, by default problem.json beside it.

    Raises: SpecError for a problem that is another one; CertificateError for what is no certificate.
    """
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.text import read_claims

    claims = read_claims(read_certificate(path))
    folder = path if path.is_dir() else path.parent
    own = load_problem(str(folder / PROBLEM) if problem is None else problem)
    if problem_sha256(own) != claims.problem_sha256:
        raise SpecError(
            f"the certificate {str(path)!r} is about another problem (its hash differs).",
            key="--problem",
            cure="Name the problem that it was made for, once for each certificate.",
        )
    return Certificate(problem=own, claims=claims)
