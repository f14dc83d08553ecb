"""Who listens to whom: labels, and one set of arcs per mode (the graphs of section 2 and Theorem
2).

What [a, b] means is said by ``arrow``, without a default: mixed-up directions are the commonest
silent error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from fractions import Fraction
from itertools import chain, islice
from types import MappingProxyType
from typing import Any
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dobc_design._checks import noun, positional, put
from dobc_design._show.cards import MOST_ITEMS, MOST_ROWS, Card, Shown, cut, listed
from dobc_design.errors import Mistakes, SpecError, about, refused, wrong
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import ONE, nearest, number_key, parse_number
from dobc_design.exact.reading import (
    Document,
    Names,
    NumberText,
    Texts,
    counted,
    is_list,
    named,
    one_of,
    repeated_name,
    shown,
    shown_number,
)

from .signs import NEGATIVE

#: What is for the package itself; completion and the reference leave it out.
INTERNAL = frozenset({"arc_codes", "loose", "require_mode"})
MOST_AGENTS = 10_000_000
LONGEST_LABEL = 200
WANTED = f"text of 1 to {LONGEST_LABEL} printable characters"


def is_label(value: object) -> bool:
    """Tell whether ``value`` is text that can name an agent or a mode."""
    if not isinstance(value, str) or len(value) > LONGEST_LABEL:
        return False
    return value.isprintable() and bool(value.strip())


def one_form(text: object) -> str:
    """The text in Unicode's form NFC, in which labels are compared: an accent may be typed in two
    ways."""
    return normalize("NFC", text if isinstance(text, str) else str(text))


def label_text(value: object, place: str = "network.agents") -> str:
    """Turn a label as given into its text; 1 and "1" are one label."""
    # Numbers with a point stay text when a file is read: 1.0 is no label.
    if isinstance(value, (bool, NumberText)) or not isinstance(value, (str, int, np.integer)):
        raise refused(
            "network.agents",
            f"{place}: a label must be text or a whole number; got {shown(value)}.",
            "Write it in quotes.",
        )
    try:
        text = one_form(value)
    except ValueError:  # a whole number with more digits than Python prints
        text = ""
    if not is_label(text):
        raise refused(
            "network.agents",
            f"{place}: a label must be {WANTED}; got {shown(value)}.",
            "Rename that agent.",
        )
    return text


def labels_of(agents: int | Iterable[Any]) -> Texts:
    """Turn a count (labels 1..n) or labels into labels.  Raises SpecError."""
    count = agents if isinstance(agents, (int, np.integer)) else 0
    if 1 <= count <= MOST_AGENTS and not isinstance(agents, bool):
        return tuple(map(str, range(1, int(count) + 1)))
    if isinstance(agents, (str, Mapping)) or not isinstance(agents, Iterable):
        raise wrong(
            "network.agents",
            f"must be a count from 1 to {MOST_AGENTS} or a list of labels; got {shown(agents)}.",
            "For example agents = 10.",
        )
    labels = []
    for position, label in enumerate(agents):
        if type(label) is str and label.isascii() and is_label(label):
            labels.append(label)  # the common case, without a message to prepare
        else:
            labels.append(label_text(label, f"network.agents[{position}]"))
    if not labels:
        raise wrong(
            "network.agents",
            "must name at least one agent; got none.",
            "Give a count, or a list of labels.",
        )
    _check_different(labels)
    return tuple(labels)


def no_agent(label: str, key: str) -> SpecError:
    """Says that the network has no agent of this name."""
    what = f"there is no agent {shown(label)} in network.agents."
    return about(key, what, "Use the label of an agent.")


ARROWS = ("listens_to", "sends_to")
_DROP_ONE = "Remove the arc (Network.from_arcs, from_networkx, from_sparse: with drop_loops=True)."
_ADD_UP = (
    "Remove one of the two, or give one arc with the sum of the weights"
    ' (Network.from_arcs, from_networkx: with merge="sum").'
)
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Index = Mapping[str, int]  # of every label
Arc = tuple[int, int]  # the indices of a listener and a speaker
Places = Mapping[Arc, int]  # of couplings, for arcs that have not the first one
ArcList = Iterable[Sequence[Any]]  # of pairs [a, b] or triples [a, b, weight] of labels
ArcLists = ArcList | Mapping[str, ArcList]  # of one mode, or by mode


@positional(eq=False)
class Arcs:
    """The arcs of one mode: agent ``listeners[a]`` hears agent ``speakers[a]`` with weight
    ``weights[a]``.  Shapes: three sequences of equal length; indices count from 0.  Weights > 0
    multiply h; what negative ones do says ``Network.negative``.  The last ``optional`` arcs come
    and go at any time while the mode is on: what they add is any part, from nothing to
    all, of w h."""

    listeners: IndexArray
    speakers: IndexArray
    weights: Vector
    optional: int = 0

    @property
    def always(self) -> Arcs:
        """The arcs that are there as long as the mode is on."""
        sure = slice(len(self) - self.optional)
        return Arcs(self.listeners[sure], self.speakers[sure], self.weights[sure])

    @property
    def present(self) -> Arcs:
        """All arcs, as if they were there as long as the mode is on."""
        return Arcs(self.listeners, self.speakers, self.weights)

    def where(self, chosen: BoolArray) -> Arcs:
        """The arcs for which ``chosen`` (arcs,) is true."""
        weights = tuple(w for w, kept in zip(self.weights, chosen.tolist(), strict=True) if kept)
        optional = int(np.count_nonzero(chosen & self.uncertain))
        return Arcs(self.listeners[chosen], self.speakers[chosen], weights, optional)

    @property
    def uncertain(self) -> BoolArray:
        """Which arcs come and go, (arcs,)."""
        return np.arange(len(self)) >= len(self) - self.optional

    @property
    def opposes(self) -> BoolArray:
        """Which arcs have a negative weight, (arcs,)."""
        return np.array([weight < 0 for weight in self.weights], dtype=bool)

    def __len__(self) -> int:
        return len(self.weights)

    def __iter__(self) -> Iterator[tuple[int, int, Fraction]]:
        return iter(zip(self.listeners.tolist(), self.speakers.tolist(), self.weights, strict=True))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Arcs):
            return NotImplemented
        if (self.weights, self.optional) != (other.weights, other.optional):
            return False
        # The cheap parts have been compared: arrays of a million arcs come last.
        same = np.array_equal(self.listeners, other.listeners)
        return same and np.array_equal(self.speakers, other.speakers)

    def __hash__(self) -> int:
        # The different weights, and not all of them: a Fraction takes long to hash.
        weights = frozenset({id(weight): weight for weight in self.weights}.values())
        return hash((self.listeners.tobytes(), self.speakers.tobytes(), weights, self.optional))


Modes = Mapping[str, Arcs]


def sized(arcs: Arcs) -> Arcs:
    """The arcs with |w| in place of w."""
    place, different = distinct_weights(arcs.weights)
    sizes = tuple(map(abs, different))
    return replace(arcs, weights=tuple(map(sizes.__getitem__, place.tolist())))


def joined(always: Arcs, optional: Arcs) -> Arcs:
    """The arcs of a mode that has these optional ones."""
    first = np.concatenate([always.listeners, optional.listeners])
    second = np.concatenate([always.speakers, optional.speakers])
    # Arcs of problems know listeners, so that nothing is turned round here.
    every = directed(first, second, always.weights + optional.weights, arrow="listens_to")
    return replace(every, optional=len(optional))


def parse_weights(values: Sequence[Any], key: str) -> Vector:
    """Read weights exactly, each distinct value once."""
    known: dict[object, Fraction] = {number_key(1): ONE}
    result = []
    # A network has few different weights: equal texts are parsed once.
    for position, value in enumerate(values):
        # For Python true equals 1: it must not be taken for a weight that was read already.
        plain = isinstance(value, (str, int, float)) and not isinstance(value, bool)
        token = number_key(value) if plain else object()
        if token not in known:
            known[token] = parse_number(value, f"{key}[{position}][2]")
        result.append(known[token])
    return tuple(result)


def arcs_from_pairs(pairs: Sequence[Sequence[Any]], *, index: Index, arrow: str, key: str) -> Arcs:
    """Turn [a, b] and [a, b, w] of labels into arcs; every wrong arc is reported, up to twenty."""
    errors = Mistakes()
    found = []
    for position, pair in errors.few(enumerate(pairs)):
        with errors:
            found.append(_read_pair(pair, index, key=f"{key}[{position}]"))
    if errors and _is_adjacency(pairs):
        size = len(pairs)
        what = f"must be a list of arcs [a, b]; got {size} rows of {size} numbers, which look like"
        cure = (
            "Write [i, j, w] for each entry w that is not 0; in Python Network.from_sparse reads "
        )
        cure += "the matrix."
        raise wrong(key, f"{what} an adjacency matrix.", cure)
    errors.raise_all()
    first = np.array([arc[0] for arc in found], dtype=np.int64)
    second = np.array([arc[1] for arc in found], dtype=np.int64)
    weights = parse_weights([arc[2] for arc in found], key)
    return directed(first, second, weights, arrow=arrow)


def _is_adjacency(rows: Sequence[Any]) -> bool:
    """Whether refused arcs are the rows of a matrix; two or three rows are so if all is 0 or 1."""
    if not all(is_list(row) and len(row) == len(rows) for row in rows):
        return False
    entries = {str(entry) for row in rows for entry in row}
    return len(rows) > 3 or entries == {"0", "1"}


def directed(first: IndexArray, second: IndexArray, weights: Vector, *, arrow: str) -> Arcs:
    """Apply ``arrow`` to pairs of indices: who of [a, b] is the listener."""
    check_arrow(arrow)
    # Arcs are frozen, and hashed by the bytes of their ends.
    for ends in (first, second):
        ends.setflags(write=False)
    # This is the only place where the meaning of [a, b] counts.
    if arrow == "listens_to":
        return Arcs(first, second, weights)
    return Arcs(second, first, weights)


def check_repairs(merge: object, drop_loops: object, *, key: str) -> None:
    """Refuse anything but "sum" or nothing, and true or false."""
    if merge is not None and merge != "sum":
        raise about(
            key,
            f'merge must be "sum", which adds the weights of parallel arcs; got {shown(merge)}.',
            "Leave it out to refuse parallel arcs.",
        )
    if type(drop_loops) is not bool:
        what = (
            "drop_loops must be true or false: whether arcs from an agent to itself are left out;"
        )
        what += f" got {shown(drop_loops)}."
        raise about(key, what, "Leave it out to refuse them.")


def repeated(first: IndexArray, second: IndexArray) -> IndexArray:
    """The places of arcs that stood there before, in order."""
    if not len(first):
        return np.zeros(0, dtype=np.int64)
    # One number for each pair, so that equal pairs are neighbours once sorted.
    codes = first * (int(second.max()) + 1) + second
    order = np.argsort(codes, kind="stable")
    return np.sort(order[1:][np.diff(codes[order]) == 0])


def summed(arcs: Arcs) -> Arcs:
    """The arcs with the weights of parallel ones added, each at its first place."""
    total: dict[Arc, Fraction] = {}
    for listener, speaker, weight in arcs:
        ends = listener, speaker
        # What parallel arcs of both signs do together, no single arc does.
        if ends in total and (total[ends] < 0) != (weight < 0):
            raise about(
                "network.modes",
                "parallel arcs with weights of both signs are not added up.",
                "Leave one of them out.",
            )
        total[ends] = total[ends] + weight if ends in total else weight
    first, second = np.array(list(total), dtype=np.int64).reshape(-1, 2).T.copy()
    return directed(first, second, tuple(total.values()), arrow="listens_to")


def repaired(arcs: Arcs, *, merge: str | None, drop_loops: bool) -> Arcs:
    """Arcs without loops and with parallel ones added, where that is asked for."""
    if drop_loops:
        kept = np.flatnonzero(arcs.listeners != arcs.speakers)
        weights = tuple(arcs.weights[place] for place in kept.tolist())
        ends = arcs.listeners[kept], arcs.speakers[kept]
        arcs = directed(*ends, weights, arrow="listens_to")
    return arcs if merge is None else summed(arcs)


def check_arrow(arrow: object) -> None:
    """Refuse anything but "listens_to" and "sends_to"."""
    if arrow not in ARROWS:
        what = 'network.arrow must be "listens_to" or "sends_to": it says what [a, b] means;'
        raise refused(
            "network.arrow",
            f"{what} got {shown(arrow)}.",
            '"listens_to": a hears b. "sends_to": a is heard by b.',
        )


def check_arcs(
    modes: Modes, labels: Names, *, mode: str, negative: str | None, fixed: Names = ()
) -> None:
    """Refuse arcs of a mode that leave the graph, self-arcs, duplicates, weights that are 0, and
    negative ones whose meaning is not given, with the first offender; ``fixed`` nodes are numbered
    after the agents."""
    arcs = modes[mode]
    n = len(labels)
    labels = (*labels, *fixed)

    def at(place: int) -> str:
        return f"network.modes.{named(mode)}{place_of(arcs, place)}"

    if type(arcs.optional) is not int or not 0 <= arcs.optional <= len(arcs):
        raise wrong(
            at(0),
            f"has {len(arcs)} arcs; optional cannot be {arcs.optional}.",
            "Give how many come and go.",
        )
    # The order of these checks is the order in which mistakes are told.
    listening = np.flatnonzero((arcs.listeners >= n) & (arcs.listeners < len(labels)))
    if len(listening):
        who = named(labels[int(arcs.listeners[listening[0]])])
        raise about(
            at(listening[0]),
            f"{who} is a fixed node, of [fixed]: it listens to nobody.",
            f"Turn the arc round, or make {who} an agent.",
        )
    for ends in (arcs.listeners, arcs.speakers):
        outside = np.flatnonzero((ends < 0) | (ends >= len(labels)))
        if len(outside):
            raise about(
                at(outside[0]),
                f"index {ends[outside[0]]} leaves the graph; agents are numbered 0 to {n - 1}.",
                "Correct the index.",
            )
    # h(0) = 0: such an arc would do nothing, so that another one is meant.
    loops = np.flatnonzero(arcs.listeners == arcs.speakers)
    if len(loops):
        name = named(labels[int(arcs.listeners[loops[0]])])
        raise about(
            at(loops[0]), f"agent {name} must not listen to itself; got a self-arc.", _DROP_ONE
        )
    again = repeated(arcs.listeners, arcs.speakers)
    if len(again):
        position = int(again[0])
        raise about(
            at(position),
            f"{_sentence(arcs, position, labels)} already; this arc is a duplicate.",
            _ADD_UP,
        )
    # most weights are one and the same object
    position = next((i for i, w in enumerate(arcs.weights) if w is not ONE and w <= 0), -1)
    if negative is not None:
        position = next((i for i, w in enumerate(arcs.weights) if not w), -1)
    if position < 0:
        return
    if arcs.weights[position]:
        raise negative_weight(arcs, labels, mode=mode, place=position)
    what = "a weight must be > 0, because it multiplies h;"
    what += f" {_sentence(arcs, position, labels)} with 0."
    raise about(at(position), what, "Leave the arc out.")


def negative_weight(arcs: Arcs, labels: Names, *, mode: str, place: int) -> SpecError:
    """Says that the file has to say what a negative weight means."""
    listener = named(labels[int(arcs.listeners[place])])
    speaker = named(labels[int(arcs.speakers[place])])
    at = f"network.modes.{named(mode)}{place_of(arcs, place)}"
    return wrong(
        "network.negative",
        f"must say what a negative weight w means; at {at} {listener} listens to {speaker} with "
        f"{shown_number(arcs.weights[place])}.",
        f'"opposes": {listener} follows -x of {speaker}, |w| h(-x_j - x_i), as in signed graphs. '
        f'"repels": {listener} moves away from {speaker}, w h(x_j - x_i). (dobc new: --negative; '
        "Python: negative=)",
    )


def place_of(arcs: Arcs, place: int) -> str:
    """The key of an arc within its mode: [2], .arcs[2], .optional[0]."""
    count = len(arcs) - arcs.optional
    if place >= count:
        return f".optional[{place - count}]"
    return f".arcs[{place}]" if arcs.optional else f"[{place}]"


def _sentence(arcs: Arcs, position: int, labels: Names) -> str:
    """ "a listens to b", of one arc."""
    listener, speaker = labels[int(arcs.listeners[position])], labels[int(arcs.speakers[position])]
    return f"{named(listener)} listens to {named(speaker)}"


def _read_pair(pair: Sequence[Any], index: Index, *, key: str) -> tuple[int, int, Any]:
    """One arc as it is written: the indices of both agents, and the weight.  Raises: SpecError."""
    if not isinstance(pair, (list, tuple)) or len(pair) not in (2, 3):
        raise wrong(
            key,
            f"must be an arc [a, b] or [a, b, weight]; got {shown(pair)}.",
            "Write two labels and, if wanted, a weight.",
        )
    ends = []
    for position, end in enumerate(pair[:2]):
        try:
            text = label_text(end, f"{key}[{position}]")
        except SpecError as error:
            raise refused(f"{key}[{position}]", error.message, error.cure) from None
        if text not in index:
            what = f"arc {shown(list(pair))} leaves the graph;"
            what += f" there is no agent {shown(text)}{_range(index)}."
            raise about(key, what, meant(text, tuple(index)))
        ends.append(index[text])
    return ends[0], ends[1], pair[2] if len(pair) == 3 else 1


def meant(label: str, labels: Names) -> str:
    """What to write in place of a label that does not exist."""
    # Bounded, because the search takes the product of both lengths.
    near = get_close_matches(label[:100], labels[:1000], n=1)
    if near and not label.isdigit():
        return f'Did you mean "{near[0]}"?'
    return "Use the label of an agent."


def _range(index: Index) -> str:
    """Which labels there are, for a message."""
    # Labels that count are shown as a range, others by the first few.
    names = list(index)
    if len(names) > 3 and names[0] == "1" and names[-1] == str(len(names)):
        return f" (agents are numbered 1 to {len(names)})"
    more = ", ..." if len(names) > 6 else ""
    return f" (agents: {', '.join(map(named, names[:6]))}{more})"


@noun(eq=False)
class Network(Shown):
    """Agents by label, and the arcs of every mode.  One mode without optional arcs: fixed topology;
    else switching.

    ``labels``: one text for each agent; ``modes``: the name of a mode -> its ``Arcs``; ``fixed``:
    the labels of nodes that agents may listen to and that listen to nobody, numbered after them.
    ``negative``: what negative weights w mean, None where there are none: "opposes", the listener
    follows -x of the speaker, |w| h(-x_j - x_i); "repels", it moves away, w h(x_j - x_i).
    Two networks are equal when labels, modes and arcs are, in the same order.
    """

    labels: Texts
    modes: Modes
    fixed: Texts = ()
    negative: str | None = None

    def __post_init__(self) -> None:
        # A copy that nobody can change: a Network is hashed, and certificates are about it.
        put(self, modes=MappingProxyType(dict(self.modes)), labels=labels_of(self.labels))
        put(self, fixed=_fixed_labels(self.fixed, self.labels))
        if not self.modes:
            raise wrong(
                "network.modes",
                "must hold at least one mode; got none.",
                "Give one list of arcs for a fixed topology, several for switching.",
            )
        for name in self.modes:
            if not is_label(name):
                raise about(
                    "network.modes",
                    f"the name of a mode must be {WANTED}; got {shown(name)}.",
                    "Name it, for example Ga.",
                )
            check_arcs(self.modes, self.labels, mode=name, negative=self.negative, fixed=self.fixed)
        if self.negative is None:
            return
        cure = "It says what a negative weight means; without one leave it out."
        one_of(self.negative, NEGATIVE, "network.negative", cure)
        # A file may give the key before it has such an arc.
        if all(w > 0 for arcs in self.modes.values() for w in arcs.weights):
            put(self, negative=None)
        elif self.fixed:
            raise wrong("network.negative", "is not known together with [fixed].", "Remove one.")

    def __dir__(self) -> list[str]:
        return [name for name in object.__dir__(self) if name not in INTERNAL]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Network):
            return NotImplemented
        if self.names != other.names or self.size != other.size:
            return False
        if self.negative != other.negative:
            return False
        return list(self.modes.items()) == list(other.modes.items())

    def __hash__(self) -> int:
        return hash((self.labels, tuple(self.modes.items())))

    def _card(self) -> Card:
        rows = []
        for name, arcs in islice(self.modes.items(), MOST_ROWS):
            rows.append((name, len(arcs), cut(_listening(self.names, arcs), 160)))
        return Card(
            title="Network",
            text=f"{counted(self.size, 'agent')}: {listed(self.labels)}",
            heads=("mode", "arcs", "who listens to whom"),
            rows=rows,
            hidden=len(self.modes) - len(rows),
        )

    def __repr__(self) -> str:
        # One more than is shown tells that there are more.
        first = islice(self.modes.items(), MOST_ITEMS + 1)
        few = [f"{name} with {counted(len(arcs), 'arc')}" for name, arcs in first]
        modes = listed(few, count=len(self.modes))
        return f"<Network of {counted(self.size, 'agent')}: {modes}>"

    @property
    def size(self) -> int:
        """The number of agents, n."""
        return len(self.labels)

    @property
    def names(self) -> Texts:
        """The labels of all nodes, of the agents first."""
        return (*self.labels, *self.fixed) if self.fixed else self.labels

    @property
    def index(self) -> dict[str, int]:
        """Label -> index from 0 (built at each call; keep it when you need it often)."""
        return {label: i for i, label in enumerate(self.labels)}

    @property
    def switches(self) -> bool:
        """Whether the graph may change: there are several modes, or arcs that come and go."""
        return len(self.modes) > 1 or self.loose is not None

    @property
    def loose(self) -> str | None:
        """The first mode with optional arcs; None if there is none."""
        return next((name for name, arcs in self.modes.items() if arcs.optional), None)

    @property
    def adjacency(self) -> Document:
        """Mode -> SciPy sparse array (n, n) of float weights: entry (i, j) where agent i listens to
        agent j, counted from 0; fixed nodes have a row and a column after those of the agents.
        ``from_sparse(..., arrow="listens_to")`` reads it back, where there are none.

        Example:
            >>> network = dd.Network.from_arcs([[2, 1, 0.5]], arrow="listens_to", agents=2)
            >>> network.adjacency["G"].toarray().tolist()
            [[0.0, 0.0], [0.5, 0.0]]
        """
        found = {}
        for name, arcs in self.modes.items():
            places = arcs.listeners, arcs.speakers
            weights = np.array([nearest(w) for _, _, w in arcs])
            nodes = len(self.names)
            found[name] = sparse.csr_array((weights, places), shape=(nodes, nodes))
        return found

    def to_networkx(self, mode: str | None = None) -> Any:
        """A networkx.DiGraph of one mode, by default the first: an edge from who listens to whom it
        listens to, with the attribute 'weight'.  ``from_networkx(..., arrow="listens_to")`` reads
        it back.

        Raises: SpecError for a mode that does not exist.
        Example:
            >>> list(dd.load_problem("paper-fixed").network.to_networkx().edges)[0]
            ('1', '2')
        """
        import networkx

        name = next(iter(self.modes)) if mode is None else self.require_mode(mode)
        graph = networkx.DiGraph(name=name)
        names = self.names
        graph.add_nodes_from(names)
        for i, j, weight in self.modes[name]:
            decimal = nearest(weight)
            exact = Fraction(repr(decimal)) == weight
            graph.add_edge(names[i], names[j], weight=decimal if exact else weight)
        return graph

    def require_mode(self, mode: str) -> str:
        """The name of a mode.  Raises: SpecError where there is none of that name."""
        return one_of(mode, self.modes, "mode", "Leave it out for the first one.")

    def arc_codes(self) -> set[int]:
        """listener * number of nodes + speaker of every arc of every mode."""
        codes = set()
        nodes = len(self.names)
        for arcs in self.modes.values():
            codes.update((arcs.listeners * nodes + arcs.speakers).tolist())
        return codes

    @classmethod
    def from_arcs(
        cls,
        arcs: ArcLists,
        *,
        arrow: str,
        agents: int | Sequence[Any] | None = None,
        optional: ArcLists | None = None,
        fixed: Sequence[Any] = (),
        merge: str | None = None,
        drop_loops: bool = False,
        negative: str | None = None,
    ) -> Network:
        """Build a network from pairs [a, b] or triples [a, b, w] of labels.

        ``arcs`` is one list (mode "G") or a mapping of mode name to list.  ``arrow`` says what [a,
        b] means: "listens_to" or "sends_to".  ``agents`` is a count (labels 1..n) or the labels;
        without it the labels are taken from the arcs in the order they appear. ``optional``: the
        same for further arcs, which come and go at any time while their mode is on.  ``fixed``:
        labels of nodes that are no agents: they are listened to and listen to nobody.  ``merge``
        "sum" adds the weights of parallel arcs, which are refused otherwise; ``drop_loops`` leaves
        out arcs from an agent to itself.  ``negative``: what negative weights mean (``Network``).
        Raises: SpecError, naming the arc.
        Example:
            >>> dd.Network.from_arcs([["tail", "head"]], arrow="listens_to").labels
            ('tail', 'head')
        """
        check_repairs(merge, drop_loops, key="arcs")
        lists = _lists_of_arcs(arcs, "arcs")
        more = {} if optional is None else _lists_of_arcs(optional, "optional")
        more = {name: pairs for name, pairs in more.items() if pairs}
        unknown = set(more) - set(lists)
        if unknown:
            what = f"names a mode that arcs does not; got {shown(min(unknown))}"
            raise wrong(
                "optional", f"{what} (a list without names means G).", "Use the names of arcs."
            )
        others = tuple(label_text(each, "fixed") for each in fixed)
        if agents is None:  # malformed arcs are reported later
            pairs = chain(*lists.values(), *more.values())
            ends = (end for arc in pairs if is_list(arc) for end in arc[:2])
            labels = tuple(x for x in dict.fromkeys(map(label_text, ends)) if x not in others)
        else:
            labels = labels_of(agents)
        index = {label: i for i, label in enumerate((*labels, *others))}

        def read(pairs: list[Any], key: str) -> Arcs:
            found = arcs_from_pairs(pairs, index=index, arrow=arrow, key=key)
            return repaired(found, merge=merge, drop_loops=drop_loops)

        modes = {name: read(each, f"network.modes.{named(name)}") for name, each in lists.items()}
        for name, each in more.items():
            loose = read(each, f"network.modes.{named(name)}.optional")
            modes[name] = joined(modes[name], loose)
        return cls(labels=labels, modes=modes, fixed=others, negative=negative)

    @classmethod
    def from_networkx(
        cls,
        graph: Any,
        *,
        arrow: str,
        fixed: Sequence[Any] = (),
        merge: str | None = None,
        drop_loops: bool = False,
        negative: str | None = None,
    ) -> Network:
        """Build a network from a networkx graph, or from a mapping of mode name to graph.

        An edge (a, b) means what ``arrow`` says; an undirected edge gives both arcs; the edge
        attribute 'weight' is w.  All modes must have the same nodes, in any order; those in
        ``fixed`` are no agents, they are listened to and listen to nobody.
        ``merge`` "sum" adds the weights of parallel edges, ``drop_loops`` leaves out self-loops;
        ``negative``: what negative weights mean (``Network``).
        Raises: SpecError for parallel edges and self-loops otherwise, and for different node sets.
        Example:
            >>> import networkx
            >>> dd.Network.from_networkx(networkx.cycle_graph(4), arrow="sends_to").size
            4
        """
        graphs = _modes(graph, isinstance(graph, Mapping) and not hasattr(graph, "edges"))
        # The first graph says in which order agents stand; the others may list them in another.
        labels: Texts = ()
        arcs = {}
        for name, each in graphs.items():
            key = f"network.modes.{named(name)}"
            # Duck typing: networkx is not imported here.
            if not hasattr(each, "edges") or not hasattr(each, "is_directed"):
                cure = "For lists of pairs there is Network.from_arcs,"
                raise wrong(
                    key,
                    f"must be a networkx graph; got {type(each).__name__}.",
                    f"{cure} for matrices Network.from_sparse.",
                )
            try:
                nodes = labels_of(list(each.nodes))
            except SpecError as error:  # grids of networkx have tuples
                raise refused(
                    error.key, error.message, "networkx.relabel_nodes(graph, str) gives text."
                ) from None
            labels = labels or nodes
            if set(nodes) != set(labels):
                raise wrong(
                    key,
                    "must have the same nodes as the first mode.",
                    "Add the missing nodes to the graph; a node without arcs is allowed.",
                )
            pairs = list(each.edges(data="weight", default=1))
            # networkx names an undirected edge once; both of its agents listen.
            if not each.is_directed():
                pairs += [(b, a, w) for a, b, w in pairs]
            arcs[name] = pairs
        agents, others = _agents_and_fixed(labels, fixed)
        listener = 0 if arrow == "listens_to" else 1
        for name, each in graphs.items():
            # A fixed node listens to nobody: of an edge without direction the agent listens.
            if others and not each.is_directed():
                kept = (arc for arc in arcs[name] if label_text(arc[listener]) not in others)
                arcs[name] = list(kept)
        return cls.from_arcs(
            arcs,
            arrow=arrow,
            agents=agents,
            fixed=others,
            merge=merge,
            drop_loops=drop_loops,
            negative=negative,
        )

    @classmethod
    def from_sparse(
        cls,
        matrix: Any,
        *,
        arrow: str,
        labels: Sequence[Any] | None = None,
        fixed: Sequence[Any] = (),
        drop_loops: bool = False,
        negative: str | None = None,
    ) -> Network:
        """Build a network from a SciPy sparse matrix or a NumPy array, or a mapping of mode name to
        matrix.

        Entry (i, j) is the arc [i, j] under ``arrow`` and its value the weight; entries that are
        stored twice are added, stored zeros are no arcs.  ``labels`` defaults to 1..n; those in
        ``fixed`` are no agents, they are listened to and listen to nobody;
        ``drop_loops`` leaves out the diagonal; ``negative``: what negative weights mean
        (``Network``). Shape: (n, n).  Raises: SpecError if it is not
        square, or labels do not fit.
        Example:
            >>> import scipy.sparse
            >>> weights = scipy.sparse.csr_array([[0, 0], [2.5, 0]])
            >>> network = dd.Network.from_sparse(weights, arrow="listens_to")
            >>> list(network.modes["G"])  # the second agent listens to the first, counted from 0
            [(1, 0, Fraction(5, 2))]
        """
        check_repairs(None, drop_loops, key="matrix")
        matrices = _modes(matrix, isinstance(matrix, Mapping) and not hasattr(matrix, "tocoo"))
        # Without labels the first matrix says how many agents there are.
        names = None if labels is None else labels_of(labels)
        size = 0 if names is None else len(names)
        modes = {}
        for name, each in matrices.items():
            key = f"network.modes.{named(name)}"
            # A copy: adding up duplicates works in place, and the matrix is the user's.
            table = _as_coo(each, key)
            table.sum_duplicates()
            rows, columns = table.shape
            if rows != columns or size not in (0, rows):
                wanted = f" ({size} x {size})" if size else ""
                what = f"the matrix must be square, with one row and column per agent{wanted};"
                raise about(
                    key,
                    f"{what} got shape {table.shape}.",
                    "Give an n x n matrix for every mode, and n labels or none.",
                )
            size = rows
            keep = table.data != 0
            if drop_loops:
                keep &= table.row != table.col
            values = table.data[keep]
            # tolist would turn float32 into float64, whose decimal text is another one.
            single = values.dtype == np.float32
            weights = parse_weights(list(values) if single else values.tolist(), key)
            first = table.row[keep].astype(np.int64)
            second = table.col[keep].astype(np.int64)
            modes[name] = directed(first, second, weights, arrow=arrow)
        nodes = labels_of(size) if names is None else names
        agents, others = _agents_and_fixed(nodes, fixed)
        # Fixed nodes are numbered after the agents.
        places = {label: place for place, label in enumerate((*agents, *others))}
        order = np.array([places[label] for label in nodes])
        for name, each in modes.items():
            modes[name] = replace(
                each, listeners=order[each.listeners], speakers=order[each.speakers]
            )
        return cls(labels=agents, modes=modes, fixed=others, negative=negative)


def _agents_and_fixed(nodes: Texts, fixed: Sequence[Any]) -> tuple[Texts, Texts]:
    """The nodes that are agents, and the labels of those that are fixed.  Raises: SpecError for one
    that is no node."""
    others = tuple(label_text(each, "fixed") for each in fixed)
    for label in set(others) - set(nodes):
        raise wrong("fixed", f"names {shown(label)}, which is no node.", "Use labels of nodes.")
    return tuple(label for label in nodes if label not in others), others


def _as_coo(matrix: Any, key: str) -> Any:
    """A copy of a SciPy sparse matrix or of an array (n, n) as a coo_array.  Raises: SpecError."""
    if hasattr(matrix, "tocoo") and len(matrix.shape) == 2:
        return matrix.tocoo(copy=True)
    if isinstance(matrix, np.ndarray) and matrix.ndim == 2 and matrix.dtype.kind in "biuf":
        return sparse.coo_array(matrix)
    raise wrong(
        key,
        f"must be a SciPy sparse matrix or a NumPy array (n, n); got {type(matrix).__name__}.",
        "Wrap it: numpy.array(matrix).",
    )


def _fixed_labels(fixed: Names, labels: Names) -> Texts:
    """The labels of fixed nodes.  Raises: SpecError for one that is an agent, or no label."""
    texts = tuple(label_text(each, "fixed") for each in fixed)
    twice = sorted({*texts} & {*labels}) if texts else []
    if twice:
        raise about(
            f"fixed.{named(twice[0])}",
            f"{shown(twice[0])} is an agent as well, in network.agents.",
            "A fixed node listens to nobody: leave it out of network.agents.",
        )
    _check_different(texts)
    return texts


def _check_different(labels: Names) -> None:
    """Refuse labels of which two are equal.  Raises: SpecError."""
    twice = repeated_name(labels)
    if twice is not None:
        what = f"must be different from one another; {shown(twice)} appears twice"
        what += ' (labels are text: 1 and "1" are one label).'
        raise wrong("network.agents", what, "Rename one of the two.")


def _lists_of_arcs(value: Any, key: str) -> dict[str, list[Any]]:
    """Mode -> its arcs as they are written; one list without a name is mode G.  Raises:
    SpecError."""
    lists = {}
    for name, pairs in _modes(value, isinstance(value, Mapping)).items():
        if not isinstance(pairs, Iterable):
            raise wrong(
                key, f"must be a list of arcs; got {shown(pairs)}.", "For example [[1, 2], [2, 3]]."
            )
        lists[name] = [tuple(arc) if is_list(arc) else arc for arc in pairs]
    return lists


def _listening(labels: Texts, arcs: Arcs) -> str:
    """What the first few agents hear, from the first arcs."""
    heard: dict[int, list[str]] = {}
    for listener, speaker, _ in islice(arcs, 60):
        heard.setdefault(listener, []).append(labels[speaker])
    few = [f"{labels[i]} to {', '.join(names)}" for i, names in islice(heard.items(), 4)]
    if len(heard) > len(few):
        few.append("...")
    return "; ".join(few)


def _modes(value: Any, several: bool) -> Document:
    """What is given for each mode; a single one is called G."""
    if not several:
        return {"G": value}
    return {str(name): each for name, each in value.items()}


def distinct_weights(weights: Sequence[Fraction]) -> tuple[IndexArray, Vector]:
    """For every arc the place of its weight among the different ones, and these; arcs mostly share
    few objects."""
    # Objects first, values of the few different ones then: a Fraction is slow to compare.
    ids = np.fromiter(map(id, weights), dtype=np.int64, count=len(weights))
    if len(ids) and np.all(ids == ids[0]):
        return np.zeros(len(ids), dtype=np.int64), (weights[0],)
    _, first, object_of = np.unique(ids, return_index=True, return_inverse=True)
    place = np.zeros(len(first), dtype=np.int64)
    table: dict[str, int] = {}
    different: list[Fraction] = []
    for k in np.argsort(first):  # in the order in which they are met
        weight = weights[first[k]]
        place[k] = table.setdefault(number_key(weight), len(table))
        if len(table) > len(different):
            different.append(weight)
    return place[object_of], tuple(different)
