"""What the tests of several exports share."""

import pytest

from dobc_design.export import c_folder


@pytest.fixture
def recorded_briefly(monkeypatch, request):
    """The runs whose samples are the test vectors of C code last 1 s, but in slow tests."""
    if request.node.get_closest_marker("slow") is None:
        monkeypatch.setattr(c_folder, "SECONDS", 1.0)
