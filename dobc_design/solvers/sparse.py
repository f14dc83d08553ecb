"""Factors of sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import structural_rank
from scipy.sparse.linalg import splu


def factored(matrix: Any, **options: Any) -> Any:
    """L U of a square sparse matrix, with `solve`; options as for SciPy's splu.  Raises: RuntimeError if the matrix is
    singular or not finite, also where its places alone show it: there SuperLU itself ends the whole process."""
    columns = sparse.csc_array(matrix)
    if not np.all(np.isfinite(columns.data)):
        raise RuntimeError("not finite")
    if np.any(columns.diagonal() == 0) and structural_rank(columns) < columns.shape[0]:
        raise RuntimeError("singular by its places")
    return splu(columns, **options)
