"""What the user says about the disturbance observer (13): its gain, a Lyapunov matrix, or a rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._checks import require_square
from dobc_design._show.cards import Shown
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import read_matrix, rows_of, shown_number


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Observer(Shown):
    """Observer gain W, Lyapunov matrix P, or the decay rate asked of a W that is to be designed.

    Shapes: W (q, m), P (q, q), symmetric.  Units: W and rate in 1/s.
    W absent: it is designed for ``rate``.  P may stand only beside a W; it is then tested as it is.
    P need not be positive definite: whether it is, is part of the test.
    """

    W: Matrix | None
    P: Matrix | None
    rate: Fraction | None

    def __init__(
        self, *, W: Sequence[Sequence[Any]] | None = None, P: Sequence[Sequence[Any]] | None = None, rate: Any = None
    ) -> None:
        gain = None if W is None else read_matrix(W, key="observer.W")
        lyapunov = None if P is None else read_matrix(P, key="observer.P")
        speed = None if rate is None else parse_number(rate, key="observer.rate")
        if lyapunov is not None and gain is None:
            raise SpecError(
                "observer.P must stand beside observer.W, because P is tested for that W; got P alone.",
                key="observer.P",
                cure="Give W too, or leave P out: a P is then found for you.",
            )
        if lyapunov is not None:
            _check_symmetric(lyapunov)
        if speed is not None and speed <= 0:
            raise SpecError(
                f"observer.rate must be > 0 (1/s), the decay asked of the estimate; got {shown_number(speed)}.",
                key="observer.rate",
                cure="Leave it out for the default.",
            )
        object.__setattr__(self, "W", gain)
        object.__setattr__(self, "P", lyapunov)
        object.__setattr__(self, "rate", speed)


def _check_symmetric(P: Matrix) -> None:
    require_square(P, name="observer.P", because="one row and column per exosystem state")
    for i, row in enumerate(P):
        for j in range(i):
            if row[j] != P[j][i]:
                raise ShapeError(
                    f"observer.P must be symmetric, because x'Px is its only use;"
                    f" got {shown_number(P[j][i])} at [{j}][{i}] and {shown_number(row[j])} at [{i}][{j}].",
                    key="observer.P",
                    cure="Replace it by (P + P')/2.",
                )


def check_observer(observer: Observer, *, q: int, m: int) -> None:
    """Check the shapes of W and P against the exosystem.  Raises ShapeError."""
    for name, matrix, shape, because in (
        ("W", observer.W, (q, m), "one row per exosystem state, one column per state component"),
        ("P", observer.P, (q, q), "one row and column per exosystem state"),
    ):
        if matrix is not None and (len(matrix), len(matrix[0])) != shape:
            raise ShapeError(
                f"observer.{name} must have shape {shape}, {because}; got shape ({len(matrix)}, {len(matrix[0])}).",
                key=f"observer.{name}",
                cure=f"Give {rows_of(shape)}.",
            )
