"""``dobc report``: the report of a certificate again, or two certificates side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Exit

from dobc_design._checks import noun
from dobc_design.errors import CertificateError, refused

from .output import (
    MISTAKE,
    Document,
    Progress,
    Stage,
    check_target,
    fail,
    folder_name,
    load_problem,
    print_json,
    read_certificate,
    refuse_option,
    require_folder,
    require_free,
    require_suffix,
    say,
)

if TYPE_CHECKING:
    from dobc_design.certificate.claims import Claims
    from dobc_design.problem.problem import Problem
    from dobc_design.report.refusal import Checked


@noun
class Asked:
    """How the certificates are shown, and where that goes."""

    problem: list[str] | None = None
    out: Path | None = None
    pdf: Path | None = None
    full: bool = False
    lmi: bool = False
    latex: Path | None = None
    force: bool = False

    def require_possible(self, given: int) -> None:
        """Refuse what can be refused before any of the ``given`` certificates is read.  Raises:
        SpecError."""
        problems = len(self.problem or ())
        if given > 2:
            raise refused(
                "CERT",
                f"one or two certificates can be shown; got {given}.",
                "Leave the others out.",
            )
        if problems and problems != given:
            raise refused(
                "--problem",
                f"--problem must be given once for each certificate; got {problems} for {given}.",
                "Leave it out where problem.json lies beside the certificate.",
            )
        refuse_option(self.out, "--out")
        pdf = self.pdf
        if pdf is not None:
            check_target(pdf, force=self.force, key="--pdf")
            require_suffix(pdf, ".pdf", key="--pdf")
        if self.lmi and given != 1:
            raise refused("--lmi", "--lmi asks a solver about one certificate.", "Name one.")
        if self.latex is not None and given != 1:
            raise refused(
                "--latex", "LaTeX fragments are of one certificate.", "Name one certificate."
            )


def report(
    certificates: list[Path],
    asked: Asked,
    quiet: bool = False,
    verbose: bool = False,
    as_json: bool = False,
) -> None:
    """Write the report of a certificate again, or two certificates side by side, once all their
    claims are verified.

    Exit code 1 where a claim does not hold: the report then says that, and nothing of what the
    certificate claims.
    """
    from dobc_design.certificate.files import make_folder, write_together

    stages = Progress(quiet=quiet, verbose=verbose)
    asked.require_possible(len(certificates))
    with stages as progress:
        try:
            sides = _sides(certificates, asked.problem, progress)
        # unreadable: what was handed in is wrong, not the machine
        except CertificateError as error:
            raise Exit(fail(error, MISTAKE, as_json=as_json)) from error
        pages = _pages(sides, asked, progress)
    folder = require_folder(asked.out or _folder(sides, certificates))
    # Beside its certificate a report may replace itself; anywhere else files are somebody's.
    own = len(sides) == 1 and asked.out is None
    files = _files(pages, folder, asked.pdf, force=asked.force or own)
    holds = all(side.found.holds for side in sides)
    if asked.latex is not None and holds:  # fragments of a paper repeat what is proved, or nothing
        files |= _fragments(sides[0], asked.latex, force=asked.force)
        make_folder(asked.latex)
    make_folder(folder)
    write_together(files)
    written = [str(path) for path in files]
    if as_json:
        print_json(_document(sides, written))
    elif not quiet:
        say("\n".join([*_words(sides), *(f"wrote {path}" for path in written)]))
    if not holds:
        raise Exit(1)


def _sides(
    certificates: Sequence[Path], given: Sequence[str] | None, progress: Stage
) -> list[Checked]:
    """The certificates with their problems, every claim decided again."""
    # Two certificates need names, a single one has none.
    letters = ("",) if len(certificates) == 1 else ("A", "B")
    problems: list[str | None] = [*(given or ())] or [None] * len(letters)
    return [
        _checked(path, problem, letter, progress)
        for path, problem, letter in zip(certificates, problems, letters, strict=True)
    ]


def _pages(sides: Sequence[Checked], asked: Asked, progress: Stage) -> dict[str, bytes]:
    from dobc_design.report.write import render_comparison, render_refusal, render_report

    found, pdf = [side.certificate for side in sides], asked.pdf is not None
    if not all(side.found.holds for side in sides):
        return render_refusal(sides, pdf=pdf)
    if len(found) == 1:
        return render_report(found[0], pdf=pdf, full=asked.full, lmi=asked.lmi, progress=progress)
    return render_comparison(*found, pdf=pdf)


def _folder(sides: Sequence[Checked], certificates: Sequence[Path]) -> Path:
    """Where pages go by default: beside the certificate, those of two into a folder of their
    own."""
    if len(sides) == 1:
        path = certificates[0]
        return path if path.is_dir() else path.parent
    names = dict.fromkeys(folder_name(side.certificate.problem.name) for side in sides)
    return Path(f"{'-'.join(names)}-comparison")


def _files(
    pages: dict[str, bytes], folder: Path, pdf: Path | None, *, force: bool
) -> dict[Path, bytes]:
    """The pages by their places; a PDF goes where --pdf says.  Raises: SpecError where something is
    in the way."""
    # The PDF has a place of its own, which --pdf names.
    files = {folder / name: data for name, data in pages.items() if not name.endswith(".pdf")}
    require_free(folder, [path.name for path in files], force=force)
    if pdf is not None:
        files[pdf] = next(data for name, data in pages.items() if name.endswith(".pdf"))
    return files


def _fragments(side: Checked, folder: Path, *, force: bool) -> dict[Path, bytes]:
    from dobc_design.report.write import render_latex

    fragments = render_latex(side.certificate)
    require_folder(folder, key="--latex")
    require_free(folder, fragments, force=force, key="--latex")
    return {folder / name: data for name, data in fragments.items()}


def _document(sides: Sequence[Checked], written: Sequence[str]) -> Document:
    """What --json prints; a certificate that does not hold has no verdict."""
    verdicts = [side.certificate.verdict.value if side.found.holds else None for side in sides]
    return {
        "problems": [side.certificate.problem.name for side in sides],
        "verdicts": verdicts,
        "failures": [list(side.found.failures) for side in sides],
        "files": list(written),
    }


def _words(sides: Sequence[Checked]) -> Iterator[str]:
    """What became of the certificates; of a single one that holds the files say enough."""
    from dobc_design.report.comparison import conclusion
    from dobc_design.report.refusal import headline

    if not all(side.found.holds for side in sides):
        yield headline(sides)
    elif len(sides) == 2:
        yield conclusion(*(side.certificate for side in sides))
    for side in sides:
        for failure in side.found.failures:
            yield f"  NOT confirmed: {failure}"


def _checked(path: Path, problem: str | None, letter: str, progress: Stage) -> Checked:
    """A certificate with its problem, by default problem.json beside it, every claim decided again.

    Raises: SpecError for a problem that is another one or is not there; CertificateError for what
    is no certificate.
    """
    from dobc_design.certificate.certificate import Certificate
    from dobc_design.certificate.files import another_problem
    from dobc_design.certificate.text import read_claims
    from dobc_design.certification.certify import verify
    from dobc_design.problem.canonical import problem_sha256
    from dobc_design.report.refusal import Checked

    data = read_certificate(path)
    claims = read_claims(data)
    beside = (path if path.is_dir() else path.parent) / "problem.json"
    if problem is None and not beside.exists():
        raise refused(
            "--problem",
            f"there is no problem.json beside {str(path)!r}: its verdict can only be repeated "
            f"unverified, {claims.verdict.value}, and no report is written.",
            "Name the problem that it was made for with --problem FILE.",
        )
    own = load_problem(str(beside) if problem is None else problem)
    if problem_sha256(own) != claims.problem_sha256:
        raise refused(
            "--problem",
            f"the certificate {str(path)!r} is about "
            f"{another_problem(claims.problem_name, own.name)}, and not about this one (its hash "
            "differs).",
            "Name the problem that it was made for, once for each certificate.",
        )
    progress("verifying the certificate")
    found = verify(data, own)
    if found.holds:
        claims = _with_own_sentence(claims, own)
    return Checked(letter=letter, certificate=Certificate(problem=own, claims=claims), found=found)


def _with_own_sentence(claims: Claims, problem: Problem) -> Claims:
    """Claims that hold, with the sentence of a decided verdict made from them: no text in a
    certificate is judged."""
    from dobc_design.certification.overall import decide_overall
    from dobc_design.loop.make import loop_of
    from dobc_design.verdict import Verdict

    # An undecided one says what would help, which its claims do not hold.
    if claims.verdict is Verdict.UNDECIDED:
        return claims
    decided = decide_overall(loop_of(problem), claims.checks, claims.W)
    return replace(claims, why=decided.why)
