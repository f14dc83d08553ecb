"""The Designer on a real Jupyter server, driven in Chromium without a screen, by the browser's own
protocol."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest
from browser import AXE, CHROMIUM, Page, browser, until

from dobc_design.problem.load import load_problem

pytest.importorskip(
    "anywidget", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)
pytest.importorskip(
    "jupyterlab", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)
pytest.importorskip(
    "websocket", reason="needs websocket-client, which comes with the extra `notebook`"
)

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")]


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """A Jupyter server with one notebook; gives the notebook's address."""
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = nbformat.v4.new_notebook(metadata=kernel)
    notebook.cells = [
        nbformat.v4.new_code_cell(
            'import dobc_design as dd\ndesigner = dd.Designer("paper-fixed")\ndesigner'
        ),
        nbformat.v4.new_code_cell("designer.gains"),
    ]
    nbformat.write(notebook, tmp_path / "design.ipynb")
    log = tmp_path / "server.log"
    environment = os.environ | {
        f"JUPYTER_{name}_DIR": str(tmp_path / name) for name in ("CONFIG", "DATA", "RUNTIME")
    }
    address = (
        "--port=0",
        "--ip=127.0.0.1",
        "--IdentityProvider.token=secret",
        f"--notebook-dir={tmp_path}",
    )
    how = ("--no-browser", "--allow-root", "--LabApp.expose_app_in_browser=True")
    command = [sys.executable, "-m", "jupyterlab", *how, *address]
    with log.open("w") as out:
        process = subprocess.Popen(
            command, stdout=out, stderr=subprocess.STDOUT, env=environment, cwd=tmp_path
        )
    try:
        port = until(
            "the server's port",
            lambda: re.search(r"http://127\.0\.0\.1:(\d+)/lab", log.read_text()),
        )[1]
        yield f"http://127.0.0.1:{port}/lab/tree/design.ipynb?token=secret"
    finally:
        process.terminate()
        process.wait(timeout=30)


@pytest.fixture
def page(tmp_path: Path, server: str) -> Iterator[Page]:
    with browser(tmp_path, server, wanted="design.ipynb") as opened:
        yield opened


def test_a_click_pins_an_agent_and_the_exact_verdict_follows(page: Page, tmp_path: Path):
    until(
        "JupyterLab",
        lambda: page.run("!!(window.jupyterapp && window.jupyterapp.shell.currentWidget)"),
    )
    idle = (
        "window.jupyterapp.shell.currentWidget?.sessionContext?.session?.kernel?.status === 'idle'"
    )
    until("the kernel", lambda: page.run(idle))
    page.run("void window.jupyterapp.commands.execute('notebook:run-all-cells')")
    until("the widget", lambda: page.run("document.querySelectorAll('.dobc-agent').length === 10"))
    said = "document.querySelector('.dobc-verdict').textContent"
    first = until("the first verdict", lambda: "PROVED" in (text := page.run(said) or "") and text)
    rate = page.run("document.querySelector('.dobc-numbers').textContent")
    pinned = (
        "[...document.querySelectorAll('.dobc-agent.dobc-pinned')].map(x => "
        "x.dataset.agent).sort().join(' ')"
    )
    assert page.run(pinned) == "1 6"
    click = (
        "document.querySelector('.dobc-agent[data-agent=\"{}\"]').dispatchEvent(new "
        "MouseEvent('click'))"
    )
    page.run(click.format(3))
    until("the pin", lambda: page.run(pinned) == "1 3 6")
    until(
        "new estimates",
        lambda: page.run("document.querySelector('.dobc-numbers').textContent") != rate,
    )
    second = until(
        "a new verdict",
        lambda: "PROVED" in (text := page.run(said) or "") and text != first and text,
    )
    for agent in (1, 3, 6):
        page.run(click.format(agent))
    until("no pin", lambda: page.run(pinned) == "")
    last = until("the refusal", lambda: "REFUTED" in (text := page.run(said) or "") and text)
    assert "no agent is pinned" in last
    assert float(re.search(r"rate ([0-9.]+) ", second)[1]) > float(
        re.search(r"rate ([0-9.]+) ", first)[1]
    )
    page.run(click.format(2))
    until("a pin again", lambda: page.run(pinned) == "2")
    selected = "window.jupyterapp.shell.currentWidget.content.activeCellIndex"
    page.run(f"{selected} = 0; document.querySelector('.dobc-gains input[type=range]').focus()")
    # of the slider, not of JupyterLab, which would go to the next cell
    for kind in ("keyDown", "keyUp"):
        page.ask(
            "Input.dispatchKeyEvent",
            type=kind,
            key="ArrowDown",
            code="ArrowDown",
            windowsVirtualKeyCode=40,
        )
    gain = "Number(document.querySelector('.dobc-gains input[type=number]').value)"
    until("a smaller gain", lambda: 4.9 < page.run(gain) < 5, seconds=30)
    assert page.run(selected) == 0
    page.run("document.querySelector('.dobc-save').click()")
    until("the file", (tmp_path / "paper-fixed-designed.toml").exists)
    saved = load_problem(tmp_path / "paper-fixed-designed.toml")
    assert [saved.network.labels[i] for i in saved.pinning.agents] == ["2"]
    for theme in ("Dark", "Light"):
        page.run(
            "window.jupyterapp.commands.execute('apputils:change-theme', {theme: "
            f"'JupyterLab {theme}'}})"
        )
        is_light = f"document.body.dataset.jpThemeLight === '{str(theme == 'Light').lower()}'"
        until("the theme", lambda script=is_light: page.run(script))
        page.screenshot(
            Path(os.environ.get("DOBC_SCREENSHOTS", tmp_path)) / f"designer-{theme.lower()}.png"
        )
        if AXE:
            found = page.audit("'.dobc-designer'")
            assert found["rules"] > 10
            assert found["wrong"] == [], theme
