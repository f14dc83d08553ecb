"""Multipliers that bound |W| from below over necessary rows: least distance by nonnegative least squares.

A proposal; ``impossible`` multiplies it out exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from scipy import optimize

from dobc_design.synthesis.observer.spectral_conditions import GainRow


def propose_multipliers(rows: Sequence[GainRow]) -> list[Fraction]:
    """One multiplier >= 0 for each row g.W + a >= 0; zeros if W = 0 satisfies the rows or floats cannot hold them.

    Source: Lawson and Hanson 1974, problem LDP.
    """
    nothing = [Fraction(0)] * len(rows)
    try:
        G = np.array([[float(x) for x in row.gradient] for row in rows], dtype=float)
        h = np.array([-float(row.constant) for row in rows], dtype=float)
        if not len(rows) or np.max(h) <= 0:
            return nothing
        sizes = np.linalg.norm(G, axis=1)
        G, h = G / sizes[:, None], h / sizes
        right = np.zeros(G.shape[1] + 1)
        right[-1] = 1.0
        multipliers, _ = optimize.nnls(np.vstack([G.T, h[None, :] / np.max(h)]), right)
        return [Fraction(f"{float(x):.12g}") for x in multipliers / sizes]
    except (OverflowError, ValueError, RuntimeError):
        return nothing
