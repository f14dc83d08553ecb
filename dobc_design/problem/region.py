"""The region of starts that a proof has to hold for."""

from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Facts, Shown, listed
from dobc_design.errors import Mistakes, misshapen, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import (
    Texts,
    is_list,
    is_text,
    keyed,
    least_number,
    one_of,
    shown,
    shown_number,
)

from .network import is_label

GOALS = ("target", "agreement", "containment")  # the first one by default
LONGEST_UNIT = 20  # characters
Pair = tuple[Fraction, Fraction]
Pairs = tuple[Pair, ...]  # one for each state component


def read_goal(goal: object) -> str:
    """What agents are to reach; None stands for the target.  Raises: SpecError."""
    return GOALS[0] if goal is None else one_of(goal, GOALS, "goal", 'For example "agreement".')


@noun
class Region(Shown):
    """Starts asked for: lo_c <= x_ic(0) <= hi_c for every agent i, and |xi_i(0) - xihat_i(0)| <=
    disturbance.

    ``initial_states`` holds m pairs; ``initial_disturbance`` is Euclidean, None without an
    exosystem.
    """

    initial_states: Pairs
    initial_disturbance: Fraction | None = None

    @property
    def is_even(self) -> bool:
        """Whether the states are the same on both sides of 0."""
        return all(lo == -hi for lo, hi in self.initial_states)

    def _card(self) -> Card:
        pairs = [f"[{shown_number(lo)}, {shown_number(hi)}]" for lo, hi in self.initial_states]
        facts: Facts = [("initial states", listed(pairs))]
        if self.initial_disturbance is not None:
            facts.append(("|xi_i - xihat_i| at most", self.initial_disturbance))
        return Card(title="Region", text="asked for", facts=facts)


def read_region(value: Any, *, dimension: int, with_exosystem: bool) -> Region | None:
    """Read the [region] table, with one pair for all components or m pairs.  Raises SpecError
    naming the key."""
    if value is None:
        return None
    keys = ("initial_states", "initial_disturbance")
    states, disturbance = keyed(value, keys, key="region")
    errors = Mistakes()
    with errors:
        states = read_pairs(states, key=f"region.{keys[0]}", dimension=dimension)
    with errors:
        disturbance = _read_disturbance(disturbance, with_exosystem=with_exosystem)
    errors.raise_all()
    return Region(initial_states=states, initial_disturbance=disturbance)


def read_units(value: Any, *, dimension: int) -> Texts:
    """The unit of every state component; one text is for all of them, None for no units.  Raises:
    SpecError."""
    if value is None or value == ():
        return ()
    texts = (value,) * dimension if is_text(value) else value
    fits = is_list(texts) and len(texts) == dimension
    if not fits or not all(map(_is_unit, texts)):
        several = f", or {dimension} of them, one per state component" if dimension > 1 else ""
        raise wrong(
            "units",
            f"must be a text of 1 to {LONGEST_UNIT} printable characters{several}; got "
            f"{shown(value)}.",
            'For example units = "m/s".',
        )
    return tuple(texts)


def _is_unit(value: object) -> bool:
    return is_text(value) and is_label(value) and len(str(value)) <= LONGEST_UNIT


def read_pairs(value: Any, *, key: str, dimension: int) -> Pairs:
    """One pair for all components, or one for each.  Raises: SpecError naming the key."""
    # [False, True] is neither plain nor nested, and so refused below.
    lists = [is_list(entry) for entry in value] if is_list(value) else [False, True]
    nested = all(lists)
    rows = list(value) if nested else [value] * dimension
    if len(rows) != dimension or (any(lists) and not nested):
        several = ""
        if dimension > 1:
            several = f" for all state components, or {dimension} such pairs"
        raise misshapen(
            key,
            f"must be a pair [lo, hi]{several}; got {shown(value)}.",
            "For example [0, 5]: every start from 0 to 5.",
        )
    pairs = []
    for position, row in enumerate(rows):
        place = f"{key}[{position}]" if nested else key
        if len(row) != 2:
            raise misshapen(
                place,
                f"must be a pair [lo, hi]; got {shown(row)}.",
                "For example [0, 5].",
            )
        lo = parse_number(row[0], f"{place}[0]")
        hi = parse_number(row[1], f"{place}[1]")
        if lo > hi:
            got = f"[{shown_number(lo)}, {shown_number(hi)}]"
            raise wrong(
                place,
                f"must be a pair [lo, hi] with lo <= hi; got {got}.",
                "Exchange the two numbers.",
            )
        pairs.append((lo, hi))
    return tuple(pairs)


def _read_disturbance(value: Any, *, with_exosystem: bool) -> Fraction | None:
    """The largest estimation error at the start; required with an exosystem, refused without."""
    key = "region.initial_disturbance"
    if value is None and with_exosystem:
        raise wrong(
            key,
            "is required when there is an [exosystem]: a large estimation error can push the "
            "states out of the region.",
            "Give the largest |xi_i(0) - xihat_i(0)|, for example 0.5; 0 if it is known.",
        )
    if value is None:
        return None
    number = least_number(value, key, ">= 0, because it is a length", "Give 0 or more.")
    if not with_exosystem:
        raise wrong(
            key, "has no meaning without an [exosystem].", "Remove it, or give the exosystem."
        )
    return number
