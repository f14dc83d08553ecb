"""Problems by their arcs, the way a test writes them."""

from __future__ import annotations

from typing import Any

from dobc_design.problem.network import Network
from dobc_design.problem.problem import Problem


def linked(arcs: Any, n: int | None = None, **given: Any) -> Problem:
    """[i, j] is agent i listening to agent j; h = y unless another ``coupling`` is given."""
    return Problem(**{"network": Network.from_arcs(arcs, arrow="listens_to", agents=n), "coupling": "y"} | given)
