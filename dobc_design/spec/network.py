"""Who listens to whom: labels, and one set of arcs per mode (the graphs of section 2 and Theorem 2).

Inside the toolbox an arc always means "listener hears speaker", the paper's (i, j). What the user's
pair [a, b] means is said once, by ``arrow``, and there is no default: mixed-up directions are the
commonest silent error with directed graphs. This module never guesses and never symmetrises.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.errors import SpecError
from dobc_design.exact.number import parse_number
from dobc_design.spec.reading import NumberText

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """Agents by label, and the arcs of every mode.  One mode: fixed topology; several: switching."""

    labels: tuple[str, ...]
    modes: Mapping[str, Arcs]

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", MappingProxyType(dict(self.modes)))
        if not self.labels:
            raise SpecError(
                "network.agents must name at least one agent; got none.", key="network.agents",
                cure="Give a count, or a list of labels.",
            )  # fmt: skip
        repeated = _first_repeated(self.labels)
        if repeated is not None:
            raise SpecError(
                f"network.agents must be different from one another; {repeated!r} stands there twice"
                " (labels are text: 1 and \"1\" are one label).",
                key="network.agents", cure="Rename one of the two.",
            )  # fmt: skip
        if not self.modes:
            raise SpecError(
                "network.modes must hold at least one mode; got none.", key="network.modes",
                cure="Give one list of arcs for a fixed topology, several for switching.",
            )  # fmt: skip
        for name, arcs in self.modes.items():
            if not name.strip():
                raise SpecError(
                    "network.modes: a mode must have a name; got an empty one.", key="network.modes",
                    cure="Name it, for example Ga.",
                )  # fmt: skip
            check_arcs(arcs, self.labels, mode=name)

    def __hash__(self) -> int:
        return hash((self.labels, tuple(self.modes.items())))

    @property
    def size(self) -> int:
        """The number of agents, n."""
        return len(self.labels)

    @property
    def index(self) -> dict[str, int]:
        """Label -> index from 0 (built at each call; keep it when you need it often)."""
        return {label: i for i, label in enumerate(self.labels)}

    @classmethod
    def from_arcs(
        cls,
        arcs: Iterable[Sequence[Any]] | Mapping[str, Iterable[Sequence[Any]]],
        *,
        arrow: str,
        agents: int | Sequence[Any] | None = None,
    ) -> Network:
        """Build a network from pairs [a, b] or triples [a, b, w] of labels.

        ``arcs`` is one list (mode "G") or a mapping of mode name to list.  ``arrow`` says what [a, b]
        means: "listens_to" or "sends_to".  ``agents`` is a count (labels 1..n) or the labels;
        without it the labels are taken from the arcs in the order they appear.
        Raises: SpecError, naming the arc.
        """
        named = dict(arcs) if isinstance(arcs, Mapping) else {"G": arcs}
        lists = {str(name): [tuple(arc) for arc in pairs] for name, pairs in named.items()}
        if agents is None:
            seen = dict.fromkeys(label_text(end) for pairs in lists.values() for arc in pairs for end in arc[:2])
            labels = tuple(seen)
        else:
            labels = labels_of(agents)
        index = {label: i for i, label in enumerate(labels)}
        return cls(
            labels=labels,
            modes={
                name: arcs_from_pairs(pairs, index=index, arrow=arrow, key=f"network.modes.{name}")
                for name, pairs in lists.items()
            },
        )

    @classmethod
    def from_networkx(cls, graph: Any, *, arrow: str) -> Network:
        """Build a network from a networkx graph, or from a mapping of mode name to graph.

        An edge (a, b) means what ``arrow`` says; an undirected edge gives both arcs; the edge
        attribute 'weight' is w.  All modes must have the same nodes, in any order.
        Raises: SpecError for parallel edges, self-loops or different node sets.
        """
        graphs = dict(graph) if isinstance(graph, Mapping) and not hasattr(graph, "edges") else {"G": graph}
        nodes = list(next(iter(graphs.values())).nodes) if graphs else []
        for name, each in graphs.items():
            if set(each.nodes) != set(nodes):
                raise SpecError(
                    f'mode "{name}" must have the same nodes as the first mode.', key=f"network.modes.{name}",
                    cure="Add the missing nodes to the graph; a node without arcs is allowed.",
                )  # fmt: skip
        arcs = {}
        for name, each in graphs.items():
            pairs = [(a, b, w) for a, b, w in each.edges(data="weight", default=1)]
            if not each.is_directed():
                pairs += [(b, a, w) for a, b, w in pairs]
            arcs[str(name)] = pairs
        return cls.from_arcs(arcs, arrow=arrow, agents=nodes)

    @classmethod
    def from_sparse(cls, matrix: Any, *, arrow: str, labels: Sequence[Any] | None = None) -> Network:
        """Build a network from a SciPy sparse matrix, or a mapping of mode name to matrix.

        Entry (i, j) is the arc [i, j] under ``arrow`` and its value the weight.  Stored zeros are no arcs.
        Shape: (n, n).  Raises: SpecError if it is not square.
        """
        matrices = dict(matrix) if isinstance(matrix, Mapping) else {"G": matrix}
        modes = {}
        size = 0
        for name, each in matrices.items():
            table = each.tocoo()
            rows, columns = table.shape
            if rows != columns or (size and rows != size):
                raise SpecError(
                    f'mode "{name}": the matrix must be square, one row and column per agent'
                    f"{f' ({size})' if size else ''}; got shape {table.shape}.",
                    key=f"network.modes.{name}", cure="Give an n x n matrix for every mode.",
                )  # fmt: skip
            size = rows
            keep = table.data != 0
            first, second = table.row[keep].astype(np.int64), table.col[keep].astype(np.int64)
            weights = parse_weights(table.data[keep].tolist(), key=f"network.modes.{name}")
            modes[str(name)] = directed(first, second, weights, arrow=arrow)
        return cls(labels=labels_of(labels if labels is not None else size), modes=modes)


def label_text(value: object) -> str:
    """Turn a label as given into its text; 1 and "1" are one label."""
    wrong = isinstance(value, (bool, NumberText)) or not isinstance(value, (str, int, np.integer))
    if wrong:
        raise SpecError(
            f"a label must be text or a whole number; got {value!r}.", key="network.agents",
            cure="Write it in quotes.",
        )  # fmt: skip
    text = str(value)
    if not text.strip() or len(text) > 200 or not text.isprintable():
        raise SpecError(
            f"a label must be 1 to 200 printable characters; got {text[:60]!r}.", key="network.agents",
            cure="Shorten or name it.",
        )  # fmt: skip
    return text


def labels_of(agents: int | Sequence[Any]) -> tuple[str, ...]:
    """Turn a count (labels 1..n) or a sequence of labels into labels."""
    if isinstance(agents, bool) or (isinstance(agents, int) and not 1 <= agents <= 10_000_000):
        raise SpecError(
            f"network.agents must be a count from 1 to 10000000 or a list of labels; got {agents!r}.",
            key="network.agents", cure="For example agents = 10.",
        )  # fmt: skip
    if isinstance(agents, int):
        return tuple(str(i) for i in range(1, agents + 1))
    labels = tuple(label_text(label) for label in agents)
    if not labels:
        raise SpecError(
            "network.agents must name at least one agent; got none.", key="network.agents",
            cure="Give a count, or a list of labels.",
        )  # fmt: skip
    return labels


def parse_weights(values: Sequence[Any], *, key: str) -> tuple[Fraction, ...]:
    """Read weights exactly, each distinct value once."""
    known: dict[Any, Fraction] = {1: ONE}
    result = []
    for position, value in enumerate(values):
        token = value if isinstance(value, (str, int, float)) and not isinstance(value, bool) else None
        weight = known.get(token)
        if weight is None:
            weight = parse_number(value, key=f"{key}[{position}][2]")
            known[token] = weight
            known.pop(None, None)
        result.append(weight)
    return tuple(result)


def arcs_from_pairs(
    pairs: Sequence[Sequence[Any]], *, index: Mapping[str, int], arrow: str, key: str
) -> Arcs:
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
            if len(errors) >= 20:
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
    if arrow not in ARROWS:
        raise SpecError(
            f'network.arrow must be "listens_to" or "sends_to": it says what [a, b] means; got {arrow!r}.',
            key="network.arrow",
            cure='"listens_to": a hears b. "sends_to": a is heard by b.',
        )
    listener, speaker = (first, second) if arrow == "listens_to" else (second, first)
    listener.setflags(write=False)
    speaker.setflags(write=False)
    return Arcs(listener, speaker, weights)


def check_arcs(arcs: Arcs, labels: Sequence[str], *, mode: str) -> None:
    """Refuse arcs that leave the graph, self-arcs, duplicates and weights <= 0, with the first offender."""
    key, n = f"network.modes.{mode}", len(labels)
    for ends in (arcs.listeners, arcs.speakers):
        outside = np.flatnonzero((ends < 0) | (ends >= n))
        if len(outside):
            raise SpecError(
                f'mode "{mode}": arc {outside[0]} leaves the graph; agents are numbered 0 to {n - 1}.',
                key=f"{key}[{outside[0]}]", cure="Correct the index.",
            )  # fmt: skip
    loops = np.flatnonzero(arcs.listeners == arcs.speakers)
    if len(loops):
        name = labels[int(arcs.listeners[loops[0]])]
        raise SpecError(
            f'mode "{mode}": agent {name} must not listen to itself; got a self-arc at position {loops[0]}.',
            key=f"{key}[{loops[0]}]", cure="Remove the arc.",
        )  # fmt: skip
    codes = arcs.listeners * n + arcs.speakers
    order = np.argsort(codes, kind="stable")
    again = np.flatnonzero(np.diff(codes[order]) == 0)
    if len(again):
        position = int(order[again + 1].min())
        a, b = labels[int(arcs.listeners[position])], labels[int(arcs.speakers[position])]
        raise SpecError(
            f'mode "{mode}": an arc may stand there once; {a} listens to {b} is a duplicate at position {position}.',
            key=f"{key}[{position}]",
            cure="Remove one of the two, or give one arc with the sum of the weights.",
        )
    if any(w is not ONE and w <= 0 for w in arcs.weights):
        position = next(i for i, w in enumerate(arcs.weights) if w <= 0)
        raise SpecError(
            f'mode "{mode}": a weight must be > 0, because it multiplies h; arc {position} has {arcs.weights[position]}.',
            key=f"{key}[{position}]", cure="Leave the arc out, or put the sign into h.",
        )  # fmt: skip


def _read_pair(pair: Sequence[Any], index: Mapping[str, int], *, key: str) -> tuple[int, int, Any]:
    if not isinstance(pair, (list, tuple)) or len(pair) not in (2, 3):
        raise SpecError(
            f"{key} must be an arc [a, b] or [a, b, weight]; got {str(pair)[:60]}.", key=key,
            cure="Write two labels and, if wanted, a weight.",
        )  # fmt: skip
    ends = []
    for position, end in enumerate(pair[:2]):
        try:
            text = label_text(end)
        except SpecError as error:
            raise SpecError(f"{key}[{position}]: {error.message}", key=f"{key}[{position}]", cure=error.cure) from None
        if text not in index:
            raise SpecError(
                f"{key}: arc {list(pair)!s:.60} leaves the graph; there is no agent {text!r}{_range(index)}.",
                key=key, cure="Use a label from network.agents.",
            )  # fmt: skip
        ends.append(index[text])
    return ends[0], ends[1], pair[2] if len(pair) == 3 else 1


def _range(index: Mapping[str, int]) -> str:
    names = list(index)
    if len(names) > 3 and names[0] == "1" and names[-1] == str(len(names)):
        return f" (agents are numbered 1 to {len(names)})"
    return f" (agents: {', '.join(names[:6])}{', ...' if len(names) > 6 else ''})"


def _first_repeated(labels: Sequence[str]) -> str | None:
    if len(set(labels)) == len(labels):
        return None
    seen: set[str] = set()
    for label in labels:
        if label in seen:
            return label
        seen.add(label)
    return None
