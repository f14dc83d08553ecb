"""Chromium without a screen, driven by its own protocol; for tests that need a real page."""

import base64
import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
PATIENCE = 240  # s
AXE = os.environ.get("AXE_SCRIPT", "")  # axe-core is not shipped
RULES = '["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]'
AUDIT = f"""axe.run({{part}}, {{{{runOnly: {{{{type: "tag", values: {RULES}}}}}}}}}).then(found =>
({{{{
  rules: found.passes.length,
  wrong: found.violations.map(each => each.id + ": " + each.nodes.map(node => node.target.join("
  ")).join(", ")),
}}}}))"""


def alone(*options: str) -> list[str]:
    """The command for one page without a screen, whose console is on standard error."""
    usual = "--headless --no-sandbox --disable-gpu --disable-background-networking --no-first-run"
    return [
        str(CHROMIUM),
        *usual.split(),
        "--disable-dev-shm-usage",
        "--enable-logging=stderr",
        *options,
    ]


def until(what: str, look: Callable[[], Any], *, seconds: float = PATIENCE) -> Any:
    """The first true answer."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := look():
            return found
        time.sleep(0.3)
    raise AssertionError(f"{what}: not within {seconds} s")


class Page:
    """One page of the browser."""

    def __init__(self, address: str) -> None:
        websocket = pytest.importorskip(
            "websocket", reason="needs websocket-client, of the extra `notebook`"
        )
        self.socket = websocket.create_connection(address, timeout=PATIENCE, suppress_origin=True)
        self.count = 0
        self.events: list[dict[str, Any]] = []

    def ask(self, method: str, **values: Any) -> dict[str, Any]:
        """The answer to one command; what the page reports meanwhile is kept in ``events``."""
        self.count += 1
        request = {"id": self.count, "method": method, "params": values}
        self.socket.send(json.dumps(request))
        while True:
            answer = json.loads(self.socket.recv())
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def run(self, script: str) -> Any:
        """The value of an expression; None while there is no page that could say it."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        return answer["result"].get("value")

    def audit(self, part: str = "document") -> dict[str, Any]:
        """How many rules of axe-core hold in a part of the page, and which do not."""
        self.run(Path(AXE).read_text("utf-8") + "; true")
        found: dict[str, Any] = self.run(AUDIT.format(part=part))
        return found

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot")["data"]))


@contextmanager
def browser(
    folder: Path, address: str, *, wanted: str, window: str = "1400,1100"
) -> Iterator[Page]:
    """A browser that shows ``address``; gives the page whose address contains ``wanted``."""
    profile = folder / "profile"
    command = [
        str(CHROMIUM),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--window-size={window}",
        "--remote-debugging-port=0",
        f"--user-data-dir={profile}",
        address,
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = until(
            "the browser",
            lambda: (p := profile / "DevToolsActivePort").exists() and p.read_text().split()[0],
        )

        def tab() -> str | None:
            with urlopen(f"http://127.0.0.1:{port}/json") as answer:
                return next(
                    (t["webSocketDebuggerUrl"] for t in json.load(answer) if wanted in t["url"]),
                    None,
                )

        page = Page(until("the page", tab))
        try:
            yield page
        finally:
            page.socket.close()
    finally:
        process.terminate()
        process.wait(timeout=30)
