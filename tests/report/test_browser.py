"""The page in a real browser: everything has a size, nothing is cut off, an audit by axe-core where
it is at hand.

The page runs no scripts, so a wrapper holds it in an iframe and measures from outside.  axe-core is
not shipped; AXE_SCRIPT names its file (axe.min.js, for example from the package
axe-playwright-python).
"""

import html
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from browser import AXE, CHROMIUM, alone, browser, until
from certified import certified
from reports import POPPLER, Page, compare_html, html_report, texts

from dobc_design.report.write import render_report

# The empty page that a tab begins with is complete, too.
LOADED = "document.readyState === 'complete' && document.title !== ''"
# How far to the right anything reaches, what would have to be scrolled included.
WIDEST = """Math.max(...[...document.querySelectorAll("body *:not(svg *, .hidden)")].map(each => {
  const box = each.getBoundingClientRect(); return Math.max(box.right, box.left +
  each.scrollWidth); }))"""
WRAPPER = """<!DOCTYPE html><meta charset="utf-8"><body style="margin:0">
<iframe id="f" style="border:0;width:{width}px;height:900px" srcdoc="{page}"></iframe><pre
id="result"></pre>
<script>
const frame = document.getElementById("f");
frame.onload = () => {{
  const page = frame.contentDocument, root = page.documentElement;
  const sizes = name => [...page.querySelectorAll(name)].map(e => {{
    const box = e.getBoundingClientRect(); return [box.width, box.height]; }});
  document.getElementById("result").textContent = JSON.stringify({{
    math: sizes("math"), svg: sizes("svg"), scroll: root.scrollWidth, client: root.clientWidth,
    tall: root.scrollHeight,
    font: getComputedStyle(page.body).fontSize}});
}};
</script>"""

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="needs chromium, which is not installed here"
)

pytestmark = pytest.mark.slow
needs_axe = pytest.mark.skipif(not AXE, reason="needs axe-core: AXE_SCRIPT=/path/to/axe.min.js")


@pytest.fixture(scope="module")
def pages(everything: dict[str, Any], asked_for: dict[str, Any]) -> dict[str, str]:
    """A full report with several modes, one on a region, and two certificates side by side."""
    names = ("Ga", "Gb", "Gc")
    Lambda = everything["lambdas"]["Ga"]
    several = dict.fromkeys(names, Lambda)
    full_report = html_report(**everything | {"lambdas": several})
    comparison = compare_html(everything["certificate"], asked_for["certificate"])
    return {"full": full_report, "region": html_report(**asked_for), "comparison": comparison}


def audit(text: str, folder: Path, *, scheme: str) -> dict[str, Any]:
    """How many rules hold, and which do not, as the browser shows the page in ``scheme``."""
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    with browser(folder, file.as_uri(), wanted="page.html") as page:
        page.ask(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        until("the page", lambda: page.run(LOADED))
        return page.audit()


@needs_chromium
@needs_axe
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("which", ["full", "region", "comparison"])
def test_an_audit_by_axe_finds_nothing(
    pages: dict[str, str], which: str, scheme: str, tmp_path: Path
):
    found = audit(pages[which], tmp_path, scheme=scheme)
    assert found["rules"] > 15
    assert found["wrong"] == []


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
        sent = [
            each["params"] for each in page.events if each["method"] == "Network.requestWillBeSent"
        ]
    requested = [each["request"]["url"] for each in sent]
    expected = [file.as_uri()]
    assert requested == expected


@needs_chromium
def test_printed_on_a4_nothing_is_cut_off(pages: dict[str, str], tmp_path: Path):
    """210 mm less two margins of 10 mm are 718 CSS pixels; what is wider would not be on the
    paper."""
    spoiled = pages["region"].replace(
        "</h1>", "</h1><pre style='white-space: pre'>" + "x" * 300 + "</pre>"
    )
    assert spoiled != pages["region"]
    (tmp_path / "page.html").write_text("", encoding="utf-8")
    with browser(tmp_path, (tmp_path / "page.html").as_uri(), wanted="page.html") as page:
        page.ask(
            "Emulation.setDeviceMetricsOverride",
            width=718,
            height=1046,
            deviceScaleFactor=1,
            mobile=False,
        )
        page.ask("Emulation.setEmulatedMedia", media="print")
        frame = page.ask("Page.getFrameTree")["frameTree"]["frame"]["id"]
        bad_page = ("spoiled", spoiled, False)
        for name, text, fits in [
            *((name, text, True) for name, text in pages.items()),
            bad_page,
        ]:
            page.ask("Page.setDocumentContent", frameId=frame, html=text)
            widest = page.run(WIDEST)
            assert (widest <= 718) is fits, f"{name} is {widest} px wide"


def measure(page: str, folder: Path, *, width: int) -> tuple[dict[str, Any], str]:
    """Sizes on the page laid out at ``width`` CSS pixels, and what the browser logged."""
    file = folder / "wrapper.html"
    written = WRAPPER.format(width=width, page=html.escape(page))
    file.write_text(written, encoding="utf-8")
    places = (
        f"--user-data-dir={folder / 'profile'}",
        f"--window-size={max(width, 600)},900",
        "--hide-scrollbars",
    )
    command = alone(*places, "--virtual-time-budget=5000", "--dump-dom", file.as_uri())
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="result">(.*?)</pre>', run.stdout, re.DOTALL)
    assert found is not None, run.stderr[-2000:]
    return json.loads(html.unescape(found.group(1))), run.stderr


@pytest.fixture(scope="module")
def opened(
    everything: dict[str, Any], wide: dict[str, Any], asked_for: dict[str, Any]
) -> list[tuple[str, int]]:
    """Pages with all details open, and how many pictures they have at least."""
    found = []
    for arguments, pictures in ((everything, 6), (wide, 6), (asked_for, 3)):
        page = html_report(**arguments).replace("<details ", "<details open ")
        found.append((page, pictures))
    return found


@needs_chromium
@pytest.mark.parametrize("width", [320, 1200])
def test_everything_has_a_size_and_nothing_scrolls_sideways(
    opened: list[tuple[str, int]], tmp_path: Path, width: int
):
    for page, pictures in opened:
        sizes, log = measure(page, tmp_path, width=width)
        assert len(sizes["math"]) > 10
        for w, h in sizes["math"]:
            assert w > 0
            assert h > 0
        assert len(sizes["svg"]) >= pictures
        assert all(w > 150 and h > 60 for w, h in sizes["svg"])
        assert sizes["scroll"] <= sizes["client"], (
            f"{sizes['scroll']} px wide on a screen of {sizes['client']}"
        )
        console = [line for line in log.splitlines() if "CONSOLE" in line]
        assert console == []


@pytest.fixture(scope="module")
def paper_fixed() -> str:
    return render_report(certified("paper-fixed"))["report.html"].decode("utf-8")


def test_what_is_in_sight_of_a_report_is_at_most_900_words(paper_fixed: str):
    closed = re.sub(
        r"(<details[^>]*>\s*<summary>.*?</summary>).*?</details>",
        r"\1</details>",
        paper_fixed,
        flags=re.DOTALL,
    )
    page = Page(re.sub(r"<style>.*?</style>", "", closed, flags=re.DOTALL))
    assert page.wrong == []
    assert 200 < len(page.text.split()) <= 900
    # a check that failed is no alarm where the verdict is proved
    assert "theorem1-printed" not in page.text
    for words in (
        "Proved",
        "0.204 1/s",
        "sine of 2 rad/s",
        "(3.2, 2.4)′",
        "5 1/s on 1 and 6",
        "dobc verify",
    ):
        assert words in page.text


@needs_chromium
def test_a_report_is_three_screens_high_and_printed_with_all_that_is_signed(
    paper_fixed: str, tmp_path: Path
):
    """Details that are closed on the screen: checks, matrices, region and lines to sign are on
    paper, eigenvalues and the simulation are not."""
    sizes, _ = measure(paper_fixed, tmp_path, width=1280)
    assert sizes["tall"] <= 3500
    pages = {}
    opened = ("open", paper_fixed.replace("<details ", "<details open "))
    for name, text in (
        ("closed", paper_fixed),
        opened,
    ):
        (tmp_path / f"{name}.html").write_text(text, encoding="utf-8")
        target = tmp_path / f"{name}.pdf"
        source = (tmp_path / f"{name}.html").as_uri()
        profile = f"--user-data-dir={tmp_path / 'printing'}"
        command = alone(profile, f"--print-to-pdf={target}", source)
        subprocess.run(command, capture_output=True, timeout=120, check=True)
        counts = re.findall(rb"/Count\s+(\d+)", target.read_bytes())
        pages[name] = max(map(int, counts))
    assert pages["closed"] <= 7 < pages["open"]
    if POPPLER is None:
        pytest.skip("what is on the pages needs pdftotext (poppler-utils)")
    text = texts((tmp_path / "closed.pdf").read_bytes(), tmp_path)
    for words in ("Checks:", "max-separable", "Lyapunov matrix", "certified starts", "Approved by"):
        assert words in text
    # What is signed stands beside the lines for it, with its fingerprints.
    signed = text[text.rindex("Signatures") :]
    for words in ("paper-fixed: proved. All agents reach", "SHA-256 of problem.json"):
        assert words in signed
    assert "Eigenvalues" not in text
    assert "A simulation" not in text
