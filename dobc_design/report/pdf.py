"""The report as a PDF on A4, set by Typst: tagged, with text alternatives, without a date, the same bytes every time.

Needs the package typst (extra `pdf`).  Nothing is read from the network.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import matplotlib
from matplotlib.ft2font import FT2Font

from dobc_design.certificate.certificate import Certificate
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.report.full_view import full_view
from dobc_design.report.pdf_blocks import blocks
from dobc_design.report.pdf_parts import soft

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

STANDARD: Final[Literal["ua-1"]] = "ua-1"  # PDF/UA-1: readable by assistive technology
_LONGEST_FOOTER = 70
_INVISIBLE: Final = "\u200b\n"


def pdf_report(
    certificate: Certificate,
    *,
    analysis: Analysis | None,
    trajectory: Trajectory | None,
    lambdas: Mapping[str, Matrix] | None = None,
    timings: Sequence[StageTiming] = (),
    searches: Sequence[Falsification] = (),
) -> bytes:
    """Return the bytes of the PDF; arguments as in ``html_report``.  Raises: SpecError without the package typst."""
    require_typst()
    view = full_view(
        certificate,
        analysis=analysis,
        trajectory=trajectory,
        lambdas=lambdas,
        timings=timings,
        searches=searches,
    )
    return compile_pdf(document(view))


def require_typst() -> None:
    """Raises: SpecError that names the extra, where typst is not installed."""
    try:
        import typst  # noqa: F401 - only whether it is there
    except ImportError as error:
        raise SpecError(
            "a PDF needs the package typst, which is not installed.",
            key="pdf",
            cure="Install it (pip install dobc_design[pdf]), or print report.html from a browser.",
        ) from error


def document(view: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the template shows, as JSON: strings, lists and numbers' digits."""
    name = soft(view["problem"].name, 24)
    short = name if len(name) <= _LONGEST_FOOTER else name[: _LONGEST_FOOTER - 1] + "…"
    print_ = view["again"]["fingerprints"][1][1]
    return {
        "title": f"{name}: {view['verdict']}",
        "name": name,
        "footer": f"{short}: {view['verdict']} · certificate {print_[:16]}…",
        "verdict": view["verdict"],
        "word": f"{view['symbol']} {view['verdict'].capitalize()}",
        "reason": soft(view["claims"].reason, 40),
        "identity": [[key, soft(value, 70)] for key, value in view["title_block"]],
        "facts": [[key, soft(value)] for key, value in view["facts"]],
        "blocks": blocks(view),
    }


def compile_pdf(content: Mapping[str, Any]) -> bytes:
    """Set the document.  Fonts of the system are used only for letters that the shipped ones do not have."""
    import typst

    text = json.dumps(content, ensure_ascii=False)
    source = (files("dobc_design.report") / "templates" / "report.typ").read_bytes()
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    known = FT2Font(str(folder / "DejaVuSans.ttf")).get_charmap()
    shipped = all(ord(each) in known or each in _INVISIBLE for each in text)

    def compiled(standard: Literal["ua-1"] | None) -> bytes:
        made: bytes = typst.compile(
            source,
            sys_inputs={"data": text},
            font_paths=[str(folder)],
            format="pdf",
            pdf_standards=standard,
            ignore_system_fonts=shipped,
        )
        return made

    try:
        return compiled(STANDARD)
    except typst.TypstError:  # the standard forbids some letters that a label may have; the report is still wanted
        return compiled(None)
