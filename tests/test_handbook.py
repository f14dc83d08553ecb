"""The handbook in a browser, built without running the notebooks: no page is too long, and nothing
is cut off."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from browser import CHROMIUM, browser, until

ROOT = Path(__file__).resolve().parents[1]
TALLEST = 8000  # pixels of a page in a window of 1280
# Notebooks, and pages on which a name is looked up by the search or the table of contents.
LONG_PAGES = ("gallery", "reference/python-")
LOOK = """({tall: document.documentElement.scrollHeight, wide: document.documentElement.scrollWidth,
  cut: [...document.querySelectorAll("article pre, article table")]
    .filter(each => each.scrollWidth > each.clientWidth + 1).map(each => each.innerText.slice(0,
    60))})"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium, which is not installed here"),
    pytest.mark.skipif(
        not all(map(importlib.util.find_spec, ("sphinx", "myst_nb", "pydata_sphinx_theme"))),
        reason="needs the extra `docs`, which is not installed here",
    ),
]


@pytest.fixture(scope="module")
def handbook(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of its pages, without a warning."""
    out = tmp_path_factory.mktemp("handbook")
    options = [
        "-W",
        "--keep-going",
        "--quiet",
        "-b",
        "html",
        "-D",
        "run_notebooks=0",
        "-d",
        str(out / "trees"),
    ]
    command = [sys.executable, "-m", "sphinx", *options, "docs", str(out / "html")]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=False,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return out / "html"


@pytest.mark.parametrize("width", [1280, 390])
def test_no_page_is_too_long_or_wider_than_the_window_and_no_code_is_cut_off(
    width: int, handbook: Path, tmp_path: Path
):
    pages = [page for page in sorted(handbook.rglob("*.html")) if "_static" not in page.parts]
    assert len(pages) > 40
    wrong = []
    with browser(tmp_path, (handbook / "index.html").as_uri(), wanted="index.html") as tab:
        tab.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        for page in pages:
            name = page.relative_to(handbook).as_posix()
            there = json.dumps(page.as_uri())
            tab.ask("Page.navigate", url=page.as_uri())
            until(
                name,
                lambda there=there: tab.run(
                    f"document.readyState === 'complete' && location.href === {there}"
                ),
            )
            found = tab.run(LOOK)
            may_be_long = name.startswith(LONG_PAGES)
            if width == 1280 and not may_be_long and found["tall"] > TALLEST:
                wrong.append(f"{name} is {found['tall']} pixels high")
            if found["wide"] > width:
                wrong.append(f"{name} is {found['wide']} pixels wide")
            wrong += [f"{name} cuts off {text!r}" for text in found["cut"] if width == 1280]
    assert wrong == []


def test_the_first_page_has_one_picture_three_lines_and_four_doors(handbook: Path):
    article = (
        (handbook / "index.html")
        .read_text("utf-8")
        .partition("<article")[2]
        .partition("</article>")[0]
    )
    assert re.findall(r'<img [^>]*src="([^"]+)"', article) == ["_images/mine.svg"]
    (code,) = re.findall(r"<pre>(.*?)</pre>", article, re.DOTALL)
    assert code.strip().count("\n") == 2
    doors = re.findall(
        r'<a class="reference internal" href="([^"]+)">', article.partition('class="doors')[2]
    )
    assert doors == [
        "learn.html",
        "howto/index.html",
        "reference/index.html",
        "explanation/index.html",
    ]
    for door in doors:
        assert (handbook / door).is_file()
