"""Fixed nodes, [fixed]: agents listen to them, and they listen to nobody.

Each rests, or moves as it likes between bounds.  One at rest is a target; of several, or of one
that moves, nothing but the interval is known in which they are (theory, section 14).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dobc_design._show.cards import listed
from dobc_design.errors import Mistakes, about, wrong
from dobc_design.exact.matrix import Vector
from dobc_design.exact.reading import Texts, items, named, read_vector, shown, shown_number

from .network import one_form
from .region import Pairs, read_pairs

Fixed = Mapping[str, Pairs]  # where each fixed node may be, by component
_CURE = "Write a value, as left = 0, or bounds, as left = { between = [-1, 1] }."


def read_fixed(value: Any, *, names: Texts, dimension: int) -> Fixed:
    """Label -> where that node may be, in the order of ``names``, the fixed nodes of the network.
    Raises: SpecError with every wrong value by its key."""
    found = {}
    errors = Mistakes()
    for label, place in errors.few(items({} if value is None else value, "fixed")):
        key = f"fixed.{named(str(label))}"
        with errors:
            name = one_form(label)
            if name not in names:
                raise about(
                    key,
                    f"the network has no fixed node {shown(str(label))}.",
                    "Name it there: Network.from_arcs(..., fixed=[...]).",
                )
            found[name] = _read_place(place, key, dimension)
    errors.raise_all()
    missing = [name for name in names if name not in found]
    if missing:
        raise wrong(f"fixed.{named(missing[0])}", "has no value.", _CURE)
    return MappingProxyType({name: found[name] for name in names})


def _read_place(value: Any, key: str, m: int) -> Pairs:
    """Where one fixed node may be, m pairs."""
    if not isinstance(value, Mapping):
        vector = read_vector(value, key, length=m, because="one per state component")
        return tuple((x, x) for x in vector)
    if set(value) != {"between"}:
        raise wrong(key, f"must be a value, or have the key between; got {shown(value)}.", _CURE)
    return read_pairs(value["between"], key=f"{key}.between", dimension=m)


def resting(place: Pairs) -> Vector | None:
    """The value of a node at rest, None of one that moves."""
    if any(lo != hi for lo, hi in place):
        return None
    return tuple(lo for lo, _ in place)


def place_words(place: Pairs, unit: str = "") -> str:
    """Where a fixed node is, or between what it moves."""
    value = resting(place)
    sides = [f"[{shown_number(lo)}, {shown_number(hi)}]" for lo, hi in place]
    if value is None:
        return f"moves in {listed(sides)} {unit}".rstrip()
    return f"rests at {listed(map(shown_number, value))} {unit}".rstrip()


def hull(fixed: Fixed) -> Pairs:
    """The least box that no fixed node leaves."""
    sides = zip(*fixed.values(), strict=True)
    return tuple((min(lo for lo, _ in side), max(hi for _, hi in side)) for side in sides)


def length_of(fixed: Any) -> Any:
    """A value that has as many components as the first fixed node, as it is written."""
    first = next(iter(fixed.values()), 0) if isinstance(fixed, Mapping) else 0
    if not isinstance(first, Mapping):
        return first
    between = first.get("between")
    nested = (
        isinstance(between, (list, tuple)) and between and isinstance(between[0], (list, tuple))
    )
    return between if nested else 0
