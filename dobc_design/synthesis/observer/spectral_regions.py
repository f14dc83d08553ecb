"""Regions of the complex plane in which the eigenvalues of A - W C are to lie: half plane, disk, cone.

All are closed, convex and symmetric about the real axis (they are LMI regions). So an intersection of
them that is not empty contains a real point, and whether it is empty is seen on the real axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, shown, shown_number

Ends = tuple[Fraction | None, Fraction | None]  # None is infinite


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class HalfPlane(Shown):
    """Re s <= left_of, or Re s >= right_of (1/s); exactly one of them is given.

    HalfPlane(left_of=-2) asks for decay at the rate 2 or more, HalfPlane(right_of=-50) for none above 50.
    Example:
        >>> design = dd.design_observer("paper-fixed", region=[dd.HalfPlane(left_of=-2), dd.Disk(centre=-4, radius=3)])
        >>> design.verdict.value
        'proved'
    """

    left_of: Fraction | None
    right_of: Fraction | None

    def __init__(self, *, left_of: Any = None, right_of: Any = None) -> None:
        if (left_of is None) == (right_of is None):
            raise SpecError(
                "a HalfPlane must have one side, left_of or right_of; got "
                + ("both." if left_of is not None else "neither."),
                key="region",
                cure="For a strip give two half planes in a list.",
            )
        for name, value in (("left_of", left_of), ("right_of", right_of)):
            number = None if value is None else parse_number(value, key=f"region.{name}")
            object.__setattr__(self, name, number)

    def _card(self) -> Card:
        return Card(title="HalfPlane", text=str(self))

    def __str__(self) -> str:
        if self.left_of is not None:
            return f"Re s <= {shown_number(self.left_of)}"
        return f"Re s >= {shown_number(self.right_of or Fraction(0))}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return self.right_of, self.left_of


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Disk(Shown):
    """|s - centre| <= radius, with a real centre; both in 1/s."""

    centre: Fraction
    radius: Fraction

    def __init__(self, *, centre: Any, radius: Any) -> None:
        object.__setattr__(self, "centre", parse_number(centre, key="region.centre"))
        object.__setattr__(self, "radius", parse_number(radius, key="region.radius"))
        if self.radius <= 0:
            raise SpecError(
                f"region.radius must be > 0, so that the disk holds something; got {shown_number(self.radius)}.",
                key="region.radius",
                cure="Give a positive radius (1/s).",
            )

    def _card(self) -> Card:
        return Card(title="Disk", text=str(self))

    def __str__(self) -> str:
        return f"|s - ({shown_number(self.centre)})| <= {shown_number(self.radius)}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return self.centre - self.radius, self.centre + self.radius


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Cone(Shown):
    """Damping ratio at least ``damping``: Re s <= 0 and -Re s >= damping |s|; 0 < damping < 1."""

    damping: Fraction

    def __init__(self, *, damping: Any) -> None:
        object.__setattr__(self, "damping", parse_number(damping, key="region.damping"))
        if not 0 < self.damping < 1:
            raise SpecError(
                f"region.damping must lie between 0 and 1, as the cosine of the cone's half angle;"
                f" got {shown_number(self.damping)}.",
                key="region.damping",
                cure="For real eigenvalues only, ask for 0.999.",
            )

    def _card(self) -> Card:
        return Card(title="Cone", text=str(self))

    def __str__(self) -> str:
        return f"damping >= {shown_number(self.damping)}"

    @property
    def real_ends(self) -> Ends:
        """Where the region begins and ends on the real axis."""
        return None, Fraction(0)


SpectralRegion = HalfPlane | Disk | Cone


def read_regions(value: Any) -> tuple[SpectralRegion, ...]:
    """One region or a list of them; None is no region.  Raises: SpecError for anything else."""
    if value is None:
        return ()
    regions = tuple(value) if is_list(value) else (value,)
    for region in regions:
        if not isinstance(region, (HalfPlane, Disk, Cone)):
            raise SpecError(
                f"region must be a HalfPlane, a Disk or a Cone, or a list of them; got {shown(region)}.",
                key="region",
                cure="For example region=dd.Cone(damping=0.7).",
            )
    return regions


def common_interval(regions: tuple[SpectralRegion, ...]) -> Ends | None:
    """The common part of the regions on the real axis; None if it is empty, and then the regions have no common point.

    A common point z would bring its conjugate and, by convexity, Re z along.
    """
    low: Fraction | None = None
    high: Fraction | None = None
    for left, right in (region.real_ends for region in regions):
        low = left if low is None or (left is not None and left > low) else low
        high = right if high is None or (right is not None and right < high) else high
    return None if low is not None and high is not None and low > high else (low, high)
