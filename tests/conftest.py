"""How many examples Hypothesis draws, and that CI draws the same ones every time."""

from __future__ import annotations

import os

from hypothesis import settings

# No deadline: a first call may import a large package, which is slow and not a defect.
settings.register_profile("fast", max_examples=50, deadline=None)
settings.register_profile("ci", parent=settings.get_profile("fast"), derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "fast")
