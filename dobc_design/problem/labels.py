"""Names of agents and modes: short printable text.

Labels are text: 1 and "1" are one label.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dobc_design.errors import SpecError
from dobc_design.exact.reading import NumberText, shown

MOST_AGENTS = 10_000_000
LONGEST_LABEL = 200
WANTED = f"text of 1 to {LONGEST_LABEL} printable characters"


def is_label(value: object) -> bool:
    """Tell whether ``value`` is text that can name an agent or a mode."""
    return isinstance(value, str) and len(value) <= LONGEST_LABEL and value.isprintable() and bool(value.strip())


def label_text(value: object, *, place: str = "network.agents") -> str:
    """Turn a label as given into its text; 1 and "1" are one label."""
    if isinstance(value, (bool, NumberText)) or not isinstance(value, (str, int, np.integer)):
        raise SpecError(
            f"{place}: a label must be text or a whole number; got {shown(value)}.",
            key="network.agents",
            cure="Write it in quotes.",
        )
    try:
        text = str(value)
    except ValueError:  # a whole number with more digits than Python prints
        text = ""
    if not is_label(text):
        raise SpecError(
            f"{place}: a label must be {WANTED}; got {shown(value)}.", key="network.agents", cure="Rename that agent."
        )
    return text


def labels_of(agents: int | Iterable[Any]) -> tuple[str, ...]:
    """Turn a count (labels 1..n) or labels into labels.  Raises SpecError."""
    if isinstance(agents, (int, np.integer)) and not isinstance(agents, bool) and 1 <= agents <= MOST_AGENTS:
        return tuple(map(str, range(1, int(agents) + 1)))
    if isinstance(agents, (int, np.integer, str, Mapping)) or not isinstance(agents, Iterable):
        raise SpecError(
            f"network.agents must be a count from 1 to {MOST_AGENTS} or a list of labels; got {shown(agents)}.",
            key="network.agents",
            cure="For example agents = 10.",
        )
    labels = tuple(
        label if type(label) is str and is_label(label) else label_text(label, place=f"network.agents[{position}]")
        for position, label in enumerate(agents)
    )
    if not labels:
        raise SpecError(
            "network.agents must name at least one agent; got none.",
            key="network.agents",
            cure="Give a count, or a list of labels.",
        )
    return labels


def first_repeated(labels: Sequence[str]) -> str | None:
    """The first label that stands there twice, or None."""
    if len(set(labels)) == len(labels):
        return None
    seen: set[str] = set()
    for label in labels:
        if label in seen:
            return label
        seen.add(label)
    return None
