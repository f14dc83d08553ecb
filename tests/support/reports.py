"""Reports and comparisons in their forms, from what a test has at hand, and a page taken apart."""

import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.report.comparison import comparison_document
from dobc_design.report.content import report_document
from dobc_design.report.findings import Findings
from dobc_design.report.latex import latex_fragments
from dobc_design.report.pages import html_page, markdown_page
from dobc_design.report.pdf import content

#: What a user may write that means something to HTML, Markdown, Typst or LaTeX, or that a font does
#: not have.
HOSTILE = (
    r"\input{/etc/passwd} \write18{x} \end{document} \\ ^^41",
    "#panic(1) #1 <label> @reference // no comment /* none */ = heading",
    "$ x_1 $ a_b^c *bold* _slanted_ `code` ~tilde [bracket](link)",
    "back\\slash\\ & % { } ~ -- ``quoted'' |<>|",
    'say "quoted" it\'s',
    "ünïcödé ∞ λ ✓ ≤ ⁻¹⁸ 時計 🕰",
    "\u202eright",
    "a\nb\n\nc",
    "x" * 200,
)
POPPLER = shutil.which("pdftotext")
VOID = {"meta", "br", "link", "img", "hr", "input", "col", "wbr", "mspace"}


def texts(data: bytes, folder: Path, *options: str) -> str:
    """What pdftotext reads of a PDF."""
    path = folder / "report.pdf"
    path.write_bytes(data)
    command = [str(POPPLER), *options, str(path), "-"]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout


def html_report(certificate: Certificate, **shown: Any) -> str:
    return html_page(report_document(Findings(certificate=certificate, **shown)))


def markdown_report(certificate: Certificate, **shown: Any) -> str:
    return markdown_page(report_document(Findings(certificate=certificate, **shown)))


def pdf_content(certificate: Certificate, **shown: Any) -> dict[str, Any]:
    """What reaches the Typst template."""
    return content(report_document(Findings(certificate=certificate, **shown)), full=True)


def latex_report(certificate: Certificate, **shown: Any) -> dict[str, str]:
    """The fragments as text, by file name."""
    document = report_document(Findings(certificate=certificate, **shown))
    fragments = latex_fragments(document, certificate.claims.version)
    return {name: data.decode("utf-8") for name, data in fragments.items()}


def compare_html(first: Certificate, second: Certificate) -> str:
    return html_page(comparison_document(first, second))


def compare_markdown(first: Certificate, second: Certificate) -> str:
    return markdown_page(comparison_document(first, second))


class Page(HTMLParser):
    """Balance of tags, attributes, headings and texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.wrong: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()
        self.wrong += [f"never closed: {tag}" for tag in self.open]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(f"</{tag}> at {self.getpos()}")

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())

    def having(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]
