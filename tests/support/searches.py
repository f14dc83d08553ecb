"""Searches that look less far than `certify` does, for tests that ask what is found and not how
close it comes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from dobc_design.certification import certify
from dobc_design.conditions.schedule import propose, propose_cycles, rows
from dobc_design.conditions.separable import propose_coordinates

#: Of weights that move: half the rate of the fastest ones, in chords that may bend.
HALF_AS_FAST = ((0.5, 0.005, 0.005), (0.25, 0.02, 0.02), (0.04, 0.2, 0.2))
#: Of boxes that move: the first three are for signals with a guarantee, the last one for all
#: others.
BENT_BOXES = ((0.02, 0.02), (0.05, 0.1), (0.05, 0.1), (0.05, 0.1))


@contextmanager
def _in_place(*changes: tuple[Any, str, object]) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for place, name, value in changes:
            patch.setattr(place, name, value)
        yield


def coarse_tables() -> Any:
    """Tables of couplings, in rows that move, have an eighth of their cells.  A context, or a
    decorator of a test."""
    return _in_place((rows, "CELLS", 256))


def few_chords(tried: object = HALF_AS_FAST) -> Any:
    """Weights and boxes that move do so in few chords.  A context, or a decorator of a test."""
    return _in_place((propose_cycles, "TRIED", tried), (propose, "TRIED", BENT_BOXES))


def few_coordinates() -> Any:
    """Coordinates are looked for at every fifth place.  A context, or a decorator of a test."""
    return _in_place((propose_coordinates, "PARTS", propose_coordinates.PARTS[1::5]))


def rough_settling() -> Any:
    """Few chords and coarse tables, and quadratic certificates of one radius.  A context, or a
    decorator of a test."""
    return _in_place(
        (rows, "CELLS", 256), (propose, "TRIED", BENT_BOXES), (propose, "RADII", propose.RADII[:1])
    )


def only(*stages: Callable[..., Any]) -> Any:
    """`certify` looks for regions by these stages alone.  A context, or a decorator of a test."""
    return _in_place((certify, "STAGES", stages))
