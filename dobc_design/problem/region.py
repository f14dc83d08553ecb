"""What a certificate has to cover: the starts of the states and of the observer error."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design._show.cards import Card, Shown, listed
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import is_list, shown, shown_number

Pair = tuple[Fraction, Fraction]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Region(Shown):
    """Starts asked for: lo_c <= x_ic(0) <= hi_c for every agent i, and |xi_i(0) - xihat_i(0)| <= disturbance.

    ``initial_states`` holds m pairs; ``initial_disturbance`` is Euclidean, None without an exosystem.
    """

    initial_states: tuple[Pair, ...]
    initial_disturbance: Fraction | None

    def _card(self) -> Card:
        pairs = [f"[{shown_number(low)}, {shown_number(high)}]" for low, high in self.initial_states]
        error = [] if self.initial_disturbance is None else [("|xi_i - xihat_i| at most", self.initial_disturbance)]
        return Card(title="Region", text="asked for", facts=[("initial states", listed(pairs)), *error])


def read_region(initial_states: Any, initial_disturbance: Any, *, dimension: int, with_exosystem: bool) -> Region:
    """Read one pair for all components, or m pairs.  Raises SpecError naming the key."""
    key = "region.initial_states"
    errors: list[SpecError] = []
    pairs: tuple[Pair, ...] = ()
    disturbance = None
    try:
        pairs = _read_pairs(initial_states, key=key, dimension=dimension)
    except SpecError as error:
        errors.append(error)
    try:
        disturbance = _read_disturbance(initial_disturbance, with_exosystem=with_exosystem)
    except SpecError as error:
        errors.append(error)
    if errors:
        raise SpecError.several(errors)
    return Region(initial_states=pairs, initial_disturbance=disturbance)


def _read_pairs(value: Any, *, key: str, dimension: int) -> tuple[Pair, ...]:
    nested = is_list(value) and all(is_list(entry) for entry in value)
    rows = list(value) if nested else [value] * dimension
    if not is_list(value) or len(rows) != dimension or (not nested and any(is_list(entry) for entry in value)):
        several = "" if dimension == 1 else f" for all state components, or {dimension} such pairs"
        raise ShapeError(
            f"{key} must be a pair [lo, hi]{several}; got {shown(value)}.", key=key, cure="For example [0, 5]."
        )
    pairs = []
    for position, row in enumerate(rows):
        place = f"{key}[{position}]" if nested else key
        if len(row) != 2:
            raise ShapeError(
                f"{place} must be a pair [lo, hi]; got {shown(row)}.", key=place, cure="For example [0, 5]."
            )
        lo, hi = (parse_number(entry, key=f"{place}[{i}]") for i, entry in enumerate(row))
        if lo > hi:
            raise SpecError(
                f"{place} must be a pair [lo, hi] with lo <= hi; got [{shown_number(lo)}, {shown_number(hi)}].",
                key=place,
                cure="Exchange the two numbers.",
            )
        pairs.append((lo, hi))
    return tuple(pairs)


def _read_disturbance(value: Any, *, with_exosystem: bool) -> Fraction | None:
    key = "region.initial_disturbance"
    if value is None:
        if with_exosystem:
            raise SpecError(
                f"{key} is required when there is an [exosystem]: an e-ball alone is not invariant,"
                " because a large estimation error pushes the states out of it.",
                key=key,
                cure="Give the largest |xi_i(0) - xihat_i(0)|, for example 0.5; 0 if it is known.",
            )
        return None
    number = parse_number(value, key=key)
    if number < 0:
        raise SpecError(
            f"{key} must be >= 0, because it is a length; got {shown_number(number)}.", key=key, cure="Give 0 or more."
        )
    if not with_exosystem:
        raise SpecError(
            f"{key} has no meaning without an [exosystem].", key=key, cure="Remove it, or give the exosystem."
        )
    return number
