"""Products of exponentials of rational matrices, enclosed by the balls of python-flint, and whether
they expand."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Final

from .interval import FLINT
from .matrix import Matrix, scale
from .peaks import balls

BITS: Final = 256


def expanding_product(
    parts: Sequence[tuple[Matrix, Fraction]], power: int
) -> list[list[float]] | None:
    """M = exp(A_p T_p) ... exp(A_1 T_1) in floats, about, where |tr M^power| > size is proved, so
    that an eigenvalue of M is larger than 1 in size; None elsewhere.  ``parts``: A (size, size) and
    T, in the order in which they act."""
    from flint import ctx

    size = len(parts[0][0])
    with FLINT, ctx.workprec(BITS):
        known = {(A, time): balls(scale(time, A)).exp() for A, time in set(parts)}
        # What acts later stands on the left.
        whole = known[parts[0]]
        for each in parts[1:]:
            whole = known[each] * whole
        found = whole
        for _ in range(power - 1):
            found = found * whole
        if not bool(abs(found.trace()) > size):  # balls compare only where it is certain
            return None
        return [[float(whole[i, j].mid()) for j in range(size)] for i in range(size)]
