"""Reports and comparisons as their forms, from what a test has at hand."""

from __future__ import annotations

from typing import Any

from dobc_design.certificate.certificate import Certificate
from dobc_design.report.comparison import comparison_document
from dobc_design.report.content import report_document
from dobc_design.report.html import html_page
from dobc_design.report.latex import latex_fragments
from dobc_design.report.markdown import markdown_page
from dobc_design.report.pdf import content


def html_report(certificate: Certificate, **shown: Any) -> str:
    return html_page(report_document(certificate, **shown))


def markdown_report(certificate: Certificate, **shown: Any) -> str:
    return markdown_page(report_document(certificate, **shown))


def pdf_content(certificate: Certificate, **shown: Any) -> dict[str, Any]:
    """What reaches the Typst template."""
    return content(report_document(certificate, **shown))


def latex_report(certificate: Certificate, **shown: Any) -> dict[str, str]:
    """The fragments as text, by file name."""
    document = report_document(certificate, **shown)
    return {name: data.decode("utf-8") for name, data in latex_fragments(document, certificate.claims.version).items()}


def compare_html(first: Certificate, second: Certificate) -> str:
    return html_page(comparison_document(first, second))


def compare_markdown(first: Certificate, second: Certificate) -> str:
    return markdown_page(comparison_document(first, second))
