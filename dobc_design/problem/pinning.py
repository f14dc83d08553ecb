"""Pinned agents and their gains k_i (eq. 4 and 19).

A gain is a number k >= 0 or an m x m matrix with k + k' >= 0.  Absent agents have k = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any

from dobc_design._show.cards import Card, Shown, plain
from dobc_design.errors import SpecError, about, kept, raise_all, wrong
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.matrix import Matrix, add, identity, scale, transpose
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import (
    MOST_ERRORS,
    counted,
    is_list,
    is_scalar_matrix,
    named,
    read_matrix,
    shown,
    shown_number,
)
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Pinning(Shown):
    """Gains by agent index (from 0), each an m x m matrix; zero gains are left out."""

    gains: Mapping[int, Matrix]

    def __post_init__(self) -> None:
        for gain in {id(k): k for k in self.gains.values()}.values():  # agents often share one matrix
            _check_gain(gain, key="pinning.gains")
        kept = {i: k for i, k in sorted(self.gains.items()) if any(any(row) for row in k)}
        object.__setattr__(self, "gains", MappingProxyType(kept))

    def _card(self) -> Card:
        return Card(title="Pinning", text=f"of {counted(len(self.gains), 'agent')}, by index", facts=self._gains())

    def __repr__(self) -> str:
        return f"Pinning(gains={plain({int(i): k for i, k in self._gains()})})"

    def _gains(self) -> list[tuple[str, Any]]:
        return [(str(i), k[0][0] if is_scalar_matrix(k) else k) for i, k in self.gains.items()]

    def __hash__(self) -> int:
        return hash(tuple(self.gains.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return _remake, (dict(self.gains),)  # the read-only mapping itself cannot be pickled

    @property
    def agents(self) -> tuple[int, ...]:
        """Indices of the agents with a gain that is not zero."""
        return tuple(self.gains)

    @property
    def is_scalar(self) -> bool:
        """Whether every gain is a multiple of the identity."""
        return all(is_scalar_matrix(k) for k in self.gains.values())


def _remake(gains: dict[int, Matrix]) -> Pinning:
    return Pinning(gains=gains)


def read_pinning(gains: Any, *, labels: Sequence[str], dimension: int) -> Pinning:
    """Read label -> gain, or one number for all agents, into a Pinning.

    Raises: SpecError, with every wrong gain by its key pinning.gains.LABEL.
    """
    if gains is None:
        return Pinning(gains={})
    if is_list(gains):
        raise wrong(
            "pinning.gains",
            f"must be a table of label = gain, or one number for all agents; got {shown(gains)}.",
            "For example gains = { 1 = 5.0, 6 = 2 }.",
        )
    if not isinstance(gains, Mapping):
        gain = _read_gain(gains, key="pinning.gains", dimension=dimension)
        return Pinning(gains=dict.fromkeys(range(len(labels)), gain))
    index = {label: i for i, label in enumerate(labels)}
    known: dict[Any, Matrix] = {}
    result: dict[int, Matrix] = {}
    errors: list[SpecError] = []
    for label, value in gains.items():
        key = f"pinning.gains.{named(str(label))}"
        with kept(errors):
            place = index.get(str(label))
            if place is None or isinstance(label, bool):
                raise about(
                    key, f"there is no agent {shown(str(label))} in network.agents.", "Use the label of an agent."
                )
            if place in result:
                raise wrong(key, "stands there twice (labels are text).", "Keep one.")
            token = value if isinstance(value, (str, int, Fraction)) and not isinstance(value, bool) else None
            if token is None or token not in known:
                gain = _read_gain(value, key=key, dimension=dimension)
                if token is not None:
                    known[token] = gain
            result[place] = known[token] if token is not None else gain
        if len(errors) >= MOST_ERRORS:
            break
    raise_all(errors)
    return Pinning(gains=result)


def _read_gain(value: Any, *, key: str, dimension: int) -> Matrix:
    if not is_list(value):
        number = parse_number(value, key=key)
        if number < 0:
            raise wrong(
                key,
                f"must be >= 0, because u_i = -k_i (x_i - xbar) has to pull towards the target;"
                f" got {shown_number(number)}.",
                "Use a positive gain, or leave the agent out.",
            )
        return scale(number, identity(dimension))
    gain = read_matrix(value, key=key, shape=(dimension, dimension), because="one row and column per state component")
    _check_gain(gain, key=key)
    return gain


def _check_gain(gain: Matrix, *, key: str) -> None:
    symmetric = SparseSymmetric.from_dense(add(gain, transpose(gain)))
    if decide_positive_semidefinite(symmetric).verdict is not Verdict.PROVED:
        raise about(
            key,
            "a matrix gain k must satisfy k + k' >= 0, so that it never pushes away from the target;"
            " this one does not.",
            "Make its symmetric part positive semidefinite.",
        )
