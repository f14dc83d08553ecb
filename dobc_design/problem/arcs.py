"""The arcs of one mode: who listens to whom, with which weight.

Inside the toolbox an arc always means "listener hears speaker", the paper's (i, j). What the user's
pair [a, b] means is said once, by ``arrow``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import MOST_ERRORS, named, shown, shown_number
from dobc_design.problem.labels import label_text

ARROWS = ("listens_to", "sends_to")
ONE = Fraction(1)
IndexArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """The arcs of one mode: agent ``listeners[a]`` hears agent ``speakers[a]`` with weight ``weights[a]``.

    Shapes: three sequences of equal length; indices count from 0; weights are > 0 and multiply h.
    """

    listeners: IndexArray
    speakers: IndexArray
    weights: tuple[Fraction, ...]

    def __len__(self) -> int:
        return len(self.weights)

    def __iter__(self) -> Iterator[tuple[int, int, Fraction]]:
        return iter(zip(self.listeners.tolist(), self.speakers.tolist(), self.weights, strict=True))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Arcs):
            return NotImplemented
        return (
            np.array_equal(self.listeners, other.listeners)
            and np.array_equal(self.speakers, other.speakers)
            and self.weights == other.weights
        )

    def __hash__(self) -> int:
        return hash((self.listeners.tobytes(), self.speakers.tobytes(), self.weights))

    def has(self, listener: int, speaker: int) -> bool:
        """Tell whether ``listener`` hears ``speaker`` in this mode."""
        return bool(np.any((self.listeners == listener) & (self.speakers == speaker)))


def parse_weights(values: Sequence[Any], *, key: str) -> tuple[Fraction, ...]:
    """Read weights exactly, each distinct value once."""
    known: dict[Any, Fraction] = {1: ONE}
    result = []
    for position, value in enumerate(values):
        hashable = isinstance(value, (str, int, float)) and not isinstance(value, bool)
        weight = known.get(value) if hashable else None
        if weight is None:
            weight = parse_number(value, key=f"{key}[{position}][2]")
            if hashable:
                known[value] = weight
        result.append(weight)
    return tuple(result)


def arcs_from_pairs(pairs: Sequence[Sequence[Any]], *, index: Mapping[str, int], arrow: str, key: str) -> Arcs:
    """Turn [a, b] and [a, b, w] of labels into arcs; every wrong arc is reported, up to twenty."""
    errors: list[SpecError] = []
    first: list[int] = []
    second: list[int] = []
    weights: list[Any] = []
    for position, pair in enumerate(pairs):
        try:
            a, b, weight = _read_pair(pair, index, key=f"{key}[{position}]")
        except SpecError as error:
            errors.append(error)
            if len(errors) >= MOST_ERRORS:
                break
            continue
        first.append(a)
        second.append(b)
        weights.append(weight)
    if errors:
        raise SpecError.several(errors)
    listener, speaker = np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)
    return directed(listener, speaker, parse_weights(weights, key=key), arrow=arrow)


def directed(first: IndexArray, second: IndexArray, weights: tuple[Fraction, ...], *, arrow: str) -> Arcs:
    """Apply ``arrow`` to pairs of indices: who of [a, b] is the listener."""
    check_arrow(arrow)
    listener, speaker = (first, second) if arrow == "listens_to" else (second, first)
    listener.setflags(write=False)
    speaker.setflags(write=False)
    return Arcs(listener, speaker, weights)


def check_arrow(arrow: object) -> None:
    """Refuse anything but "listens_to" and "sends_to"."""
    if arrow not in ARROWS:
        raise SpecError(
            f'network.arrow must be "listens_to" or "sends_to": it says what [a, b] means; got {shown(arrow)}.',
            key="network.arrow",
            cure='"listens_to": a hears b. "sends_to": a is heard by b.',
        )


def check_arcs(arcs: Arcs, labels: Sequence[str], *, mode: str) -> None:
    """Refuse arcs that leave the graph, self-arcs, duplicates and weights <= 0, with the first offender."""
    key, n = f"network.modes.{named(mode)}", len(labels)
    for ends in (arcs.listeners, arcs.speakers):
        outside = np.flatnonzero((ends < 0) | (ends >= n))
        if len(outside):
            raise SpecError(
                f"{key}[{outside[0]}]: index {ends[outside[0]]} leaves the graph; agents are numbered 0 to {n - 1}.",
                key=f"{key}[{outside[0]}]",
                cure="Correct the index.",
            )
    loops = np.flatnonzero(arcs.listeners == arcs.speakers)
    if len(loops):
        name = named(labels[int(arcs.listeners[loops[0]])])
        raise SpecError(
            f"{key}[{loops[0]}]: agent {name} must not listen to itself; got a self-arc.",
            key=f"{key}[{loops[0]}]",
            cure="Remove the arc.",
        )
    codes = arcs.listeners * n + arcs.speakers
    order = np.argsort(codes, kind="stable")
    again = np.flatnonzero(np.diff(codes[order]) == 0)
    if len(again):
        position = int(order[again + 1].min())
        raise SpecError(
            f"{key}[{position}]: {_sentence(arcs, position, labels)} already; this arc is a duplicate.",
            key=f"{key}[{position}]",
            cure="Remove one of the two, or give one arc with the sum of the weights.",
        )
    if any(w is not ONE and w <= 0 for w in arcs.weights):
        position = next(i for i, w in enumerate(arcs.weights) if w <= 0)
        raise SpecError(
            f"{key}[{position}]: a weight must be > 0, because it multiplies h;"
            f" {_sentence(arcs, position, labels)} with {shown_number(arcs.weights[position])}.",
            key=f"{key}[{position}]",
            cure="Leave the arc out, or put the sign into h.",
        )


def _sentence(arcs: Arcs, position: int, labels: Sequence[str]) -> str:
    listener, speaker = labels[int(arcs.listeners[position])], labels[int(arcs.speakers[position])]
    return f"{named(listener)} listens to {named(speaker)}"


def _read_pair(pair: Sequence[Any], index: Mapping[str, int], *, key: str) -> tuple[int, int, Any]:
    if not isinstance(pair, (list, tuple)) or len(pair) not in (2, 3):
        raise SpecError(
            f"{key} must be an arc [a, b] or [a, b, weight]; got {shown(pair)}.",
            key=key,
            cure="Write two labels and, if wanted, a weight.",
        )
    ends = []
    for position, end in enumerate(pair[:2]):
        try:
            text = label_text(end, place=f"{key}[{position}]")
        except SpecError as error:
            raise SpecError(error.message, key=f"{key}[{position}]", cure=error.cure) from None
        if text not in index:
            raise SpecError(
                f"{key}: arc {shown(list(pair))} leaves the graph; there is no agent {shown(text)}{_range(index)}.",
                key=key,
                cure="Use a label from network.agents.",
            )
        ends.append(index[text])
    return ends[0], ends[1], pair[2] if len(pair) == 3 else 1


def _range(index: Mapping[str, int]) -> str:
    names = list(index)
    if len(names) > 3 and names[0] == "1" and names[-1] == str(len(names)):
        return f" (agents are numbered 1 to {len(names)})"
    return f" (agents: {', '.join(map(named, names[:6]))}{', ...' if len(names) > 6 else ''})"
