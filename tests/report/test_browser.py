"""The page in a real browser: formulas and figures have a size, a phone does not scroll sideways, no errors.

The page runs no scripts, so a wrapper holds it in an iframe and measures from outside.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from shown import html_report

from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.network import Network

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--enable-logging=stderr",
)
WRAPPER = """<!DOCTYPE html><meta charset="utf-8"><body style="margin:0">
<iframe id="f" style="border:0;width:{width}px;height:900px" srcdoc="{page}"></iframe><pre id="result"></pre>
<script>
const frame = document.getElementById("f");
frame.onload = () => {{
  const page = frame.contentDocument, root = page.documentElement;
  const sizes = name => [...page.querySelectorAll(name)].map(e => {{
    const box = e.getBoundingClientRect(); return [box.width, box.height]; }});
  document.getElementById("result").textContent = JSON.stringify({{
    math: sizes("math"), svg: sizes("svg"), scroll: root.scrollWidth, client: root.clientWidth,
    font: getComputedStyle(page.body).fontSize}});
}};
</script>"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs chromium, which is not installed here"),
]


def measure(page: str, folder: Path, *, width: int) -> tuple[dict[str, Any], str]:
    """Sizes on the page laid out at ``width`` CSS pixels, and what the browser logged."""
    file = folder / "wrapper.html"
    file.write_text(WRAPPER.format(width=width, page=html.escape(page)), encoding="utf-8")
    command = [
        str(BROWSER),
        *OPTIONS,
        f"--user-data-dir={folder / 'profile'}",
        f"--window-size={max(width, 600)},900",
        "--virtual-time-budget=5000",
        "--dump-dom",
        file.as_uri(),
    ]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="result">(.*?)</pre>', run.stdout, re.DOTALL)
    assert found is not None, run.stderr[-2000:]
    return json.loads(html.unescape(found.group(1))), run.stderr


@pytest.fixture
def wide_page(problem_with, certificate_of, analysis_of, trajectory_of) -> str:
    """Long names, six exosystem states, several modes: what is likely to be too wide for a phone."""
    labels = [f"station-of-a-very-long-name-{i}" for i in range(12)]
    arcs = [(labels[i], labels[(i + 1) % 12]) for i in range(12)]
    network = Network.from_arcs({"m" * 60: arcs, "b": arcs[:-1], "c": arcs[3:]}, arrow="listens_to", agents=labels)
    A = [[f"{i + 1}/{j + 7}" for j in range(6)] for i in range(6)]
    problem = problem_with(
        name="a-name-without-any-space-" * 4,
        network=network,
        gains={labels[0]: 1},
        observer=None,
        exosystem=Exosystem(A=A, C=[[1, 0, 0, 0, 0, "123456/654321"]]),
    )
    certificate = certificate_of(problem, problem_sha256="f" * 64)
    return html_report(certificate, analysis=analysis_of(problem), trajectory=trajectory_of(problem))


@pytest.mark.parametrize("width", [320, 390, 760, 1200])
def test_everything_has_a_size_and_nothing_scrolls_sideways(
    everything: dict[str, Any], wide_page: str, tmp_path: Path, width: int
):
    for page in (html_report(**everything), wide_page):
        sizes, log = measure(page, tmp_path, width=width)
        assert len(sizes["math"]) > 10
        assert all(w > 0 and h > 0 for w, h in sizes["math"])
        assert len(sizes["svg"]) >= 6
        assert all(w > 150 and h > 60 for w, h in sizes["svg"])
        assert sizes["scroll"] <= sizes["client"], f"{sizes['scroll']} px wide on a screen of {sizes['client']}"
        console = [line for line in log.splitlines() if "CONSOLE" in line]
        assert console == []


@pytest.mark.parametrize("width", [320, 760])
def test_a_region_with_its_pictures_and_table_fits(asked_for: dict[str, Any], tmp_path: Path, width: int):
    sizes, log = measure(html_report(**asked_for), tmp_path, width=width)
    assert len(sizes["svg"]) == 3  # network, methods, agents
    assert all(w > 150 and h > 60 for w, h in sizes["svg"])
    assert sizes["scroll"] <= sizes["client"]
    assert "CONSOLE" not in log
