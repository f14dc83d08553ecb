"""What the tests of several commands share."""

from pathlib import Path

import pytest
from certified import certified
from problem_texts import RING

from dobc_design import load_problem
from dobc_design.plotting.look import Sheet


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are made, and their files hold no drawing."""
    monkeypatch.setattr(Sheet, "file", lambda self, kind: f"a figure as {kind}".encode())


@pytest.fixture
def proved(command_line, tmp_path):
    """ring.toml and its certificate, with everything that is cheap to prove."""
    Path("ring.toml").write_text(RING, encoding="utf-8")
    certified(load_problem("ring.toml")).save(tmp_path / "proof")
    return tmp_path / "proof"
