"""What the tests of several commands share."""

import pytest

from dobc_design.plotting.look import Sheet


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are made, and their files hold no drawing."""
    monkeypatch.setattr(Sheet, "file", lambda self, kind: f"a figure as {kind}".encode())
