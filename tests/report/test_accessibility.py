"""The page for people who do not see it, or see little: an audit by axe-core where it is at hand, and its own rules.

axe-core is not shipped; AXE_SCRIPT names its file (axe.min.js, for example from the package axe-playwright-python).
"""

from __future__ import annotations

import itertools
import os
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from chromium import CHROMIUM, browser, until
from shown import compare_html, html_report

AXE = os.environ.get("AXE_SCRIPT", "")
RULES = '["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]'
AUDIT = f"""axe.run(document, {{runOnly: {{type: "tag", values: {RULES}}}}}).then(found => ({{
  rules: found.passes.length,
  wrong: found.violations.map(each => each.id + ": " + each.nodes.map(node => node.target.join(" ")).join(", ")),
}}))"""
# The empty page that a tab begins with is complete, too.
LOADED = "document.readyState === 'complete' && document.title !== ''"
# How far to the right anything reaches, what would have to be scrolled included.
WIDEST = """Math.max(...[...document.querySelectorAll("body *:not(svg *, .hidden)")].map(each => {
  const box = each.getBoundingClientRect(); return Math.max(box.right, box.left + each.scrollWidth); }))"""
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium, which is not installed here")

needs_axe = pytest.mark.skipif(not AXE, reason="needs axe-core: AXE_SCRIPT=/path/to/axe.min.js")


@pytest.fixture
def pages(everything: dict[str, Any], asked_for: dict[str, Any]) -> dict[str, str]:
    """A full report with several modes, one on a region, and two certificates side by side."""
    several = dict.fromkeys(("Ga", "Gb", "Gc"), everything["lambdas"]["Ga"])
    return {
        "full": html_report(**everything | {"lambdas": several}),
        "region": html_report(**asked_for),
        "comparison": compare_html(everything["certificate"], asked_for["certificate"]),
    }


def audit(text: str, folder: Path, *, scheme: str) -> dict[str, Any]:
    """How many rules hold, and which do not, as the browser shows the page in ``scheme``."""
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    with browser(folder, file.as_uri(), wanted="page.html") as page:
        page.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        until("the page", lambda: page.run(LOADED))
        page.run(Path(AXE).read_text("utf-8") + "; true")
        found: dict[str, Any] = page.run(AUDIT)
    return found


@pytest.mark.slow
@needs_chromium
@needs_axe
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("which", ["full", "region", "comparison"])
def test_an_audit_by_axe_finds_nothing(pages: dict[str, str], which: str, scheme: str, tmp_path: Path):
    found = audit(pages[which], tmp_path, scheme=scheme)
    assert found["rules"] > 15
    assert found["wrong"] == []


@pytest.mark.slow
@needs_chromium
@needs_axe
@pytest.mark.parametrize(("scheme", "good", "bad"), [("light", "#555e6a", "#c8c8c8"), ("dark", "#a8b1bc", "#404040")])
def test_an_audit_finds_pale_text_and_a_heading_that_jumps(
    everything: dict[str, Any], scheme: str, good: str, bad: str, tmp_path: Path
):
    text = html_report(**everything | {"analysis": None, "trajectory": None})
    spoiled = text.replace(f"--muted: {good}", f"--muted: {bad}").replace("h2>", "h5>")
    wrong = " ".join(audit(spoiled, tmp_path, scheme=scheme)["wrong"])
    assert "color-contrast" in wrong
    assert "heading-order" in wrong


@pytest.mark.slow
@needs_chromium
def test_the_browser_asks_the_network_for_nothing(pages: dict[str, str], tmp_path: Path):
    file = tmp_path / "page.html"
    file.write_text(pages["full"], encoding="utf-8")
    with browser(tmp_path, file.as_uri(), wanted="page.html") as page:
        until("the page", lambda: page.run(LOADED))
        page.ask("Network.enable")
        page.ask("Page.enable")
        page.ask("Page.reload")
        until("the page", lambda: page.run(f"{LOADED} && document.fonts.status === 'loaded'"))
        sent = [each["params"] for each in page.events if each["method"] == "Network.requestWillBeSent"]
    assert [each["request"]["url"] for each in sent] == [file.as_uri()]


@pytest.mark.slow
@needs_chromium
def test_printed_on_a4_nothing_is_cut_off(pages: dict[str, str], tmp_path: Path):
    """210 mm less two margins of 10 mm are 718 CSS pixels; what is wider would not be on the paper."""
    spoiled = pages["region"].replace("</h1>", "</h1><pre style='white-space: pre'>" + "x" * 300 + "</pre>")
    assert spoiled != pages["region"]
    (tmp_path / "page.html").write_text("", encoding="utf-8")
    with browser(tmp_path, (tmp_path / "page.html").as_uri(), wanted="page.html") as page:
        page.ask("Emulation.setDeviceMetricsOverride", width=718, height=1046, deviceScaleFactor=1, mobile=False)
        page.ask("Emulation.setEmulatedMedia", media="print")
        frame = page.ask("Page.getFrameTree")["frameTree"]["frame"]["id"]
        for name, text, fits in [*((name, text, True) for name, text in pages.items()), ("spoiled", spoiled, False)]:
            page.ask("Page.setDocumentContent", frameId=frame, html=text)
            widest = page.run(WIDEST)
            assert (widest <= 718) is fits, f"{name} is {widest} px wide"


class Parts(HTMLParser):
    """Headings, pictures, tables and regions of a page, in their order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def having(self, *tags: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.found if tag in tags]


@pytest.fixture(params=["region", "comparison"])
def parts(request: pytest.FixtureRequest, asked_for: dict[str, Any], certificate) -> Parts:
    if request.param == "comparison":
        return Parts(compare_html(certificate, asked_for["certificate"]))
    return Parts(html_report(**asked_for))


def test_headings_do_not_jump(parts: Parts):
    levels = [int(tag[1]) for tag, _ in parts.found if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))


def test_no_two_regions_have_the_same_words(everything: dict[str, Any]):
    several = dict.fromkeys(("Ga", "Gb"), everything["lambdas"]["Ga"])
    without = {"analysis": None, "trajectory": None, "lambdas": several}
    page = Parts(html_report(**everything | without))
    words = [each["aria-label"] for _, each in page.found if each.get("role") == "region"]
    assert len(words) > 5
    assert len(set(words)) == len(words)


def test_pictures_and_regions_have_words_and_tables_have_heads(parts: Parts):
    assert all(len(each.get("aria-label") or each.get("alt") or "") > 10 for each in parts.having("svg", "img"))
    regions = [each for _, each in parts.found if each.get("role") == "region"]
    assert all(each.get("aria-label") and each.get("tabindex") == "0" for each in regions)
    assert len(parts.having("table")) == len(parts.having("caption"))
    assert all(each.get("scope") for each in parts.having("th"))
    assert parts.having("html") == [{"lang": "en"}]


def test_what_scrolls_can_be_reached_by_keyboard_and_links_say_where_they_go(parts: Parts):
    assert all(each.get("tabindex") == "0" for _, each in parts.found if "scroll" in (each.get("class") or "").split())
    assert all((each.get("href") or "").startswith("#") for each in parts.having("a"))
