"""What the agents feel of each other, h(e) of (9), fast enough for a million agents and for thousands of runs.

Arcs are sorted by listener and worked through in blocks that fit into the processor's cache.  Within a block they lie
slot by slot: the first arcs of all agents, then the second ones; so everything is plain arithmetic on long arrays.
All runs of a stack share the arcs: a run is one more column of the same arrays.  Couplings are the trees of everywhere
(``coupling.tree``), turned once into a list of NumPy calls: constants are converted beforehand and small powers are
products, which is what a right-hand side that is called a million times needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.functions import FUNCTIONS
from dobc_design.coupling.tree import (
    Add,
    Call,
    Constant,
    Divide,
    Multiply,
    Negate,
    Node,
    NumpyAlgebra,
    Pi,
    Power,
    Subtract,
    Variable,
    postorder,
)
from dobc_design.problem.arrays import ArcGroup, gathering_matrix

Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BLOCK = 1 << 15  # differences held at once: a quarter of a MiB per array
MOST_SLOTS = 32  # arcs of one agent up to which a block is worked through slot by slot
LARGEST_PRODUCT = 8  # exponents up to which a power is computed by multiplication

_BINARY: dict[type[Node], Callable[..., Any]] = {
    Add: np.add,
    Subtract: np.subtract,
    Multiply: np.multiply,
    Divide: np.divide,
}
_VARIABLE, _CONSTANT = -1, 0  # in place of a number of operands


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """Some arcs of one coupling.  Agents ``rows`` listen; ``speakers`` (arcs,) slot by slot.

    ``slots`` holds begin and end of every slot; the i-th arc of a slot ends at the i-th of ``rows``.  ``factor``
    is the common weight, or one for every arc, (arcs,).
    """

    h: Callable[[Array], Array]
    vector: bool  # whether h needs to see the m components of a difference together
    rows: slice | IndexArray
    speakers: IndexArray
    slots: tuple[tuple[int, int], ...]
    factor: float | Array

    def add(self, total: Array, e: Array, m: int) -> None:
        """Add what the listeners feel; ``e`` and ``total`` have a row for every agent."""
        own = e[self.rows]
        y = e.take(self.speakers, axis=0)
        for begin, end in self.slots:
            y[begin:end] -= own[: end - begin]
        felt = self.h(y.reshape(len(y), m, -1)).reshape(y.shape) if self.vector else self.h(y)
        if isinstance(self.factor, np.ndarray):
            felt = felt * (self.factor if felt.ndim == 1 else self.factor[:, None])
        first = self.slots[0][1]
        found = felt[:first].copy()
        for begin, end in self.slots[1:]:
            found[: end - begin] += felt[begin:end]
        if not isinstance(self.factor, np.ndarray) and self.factor != 1:
            found *= self.factor
        total[self.rows] += found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hubs:
    """Arcs of agents with very many of them: ``counts[i]`` arcs end at the i-th of ``rows``, ``gather`` adds them."""

    h: Callable[[Array], Array]
    vector: bool
    rows: slice
    counts: IndexArray
    speakers: IndexArray
    gather: sp.csr_array

    def add(self, total: Array, e: Array, m: int) -> None:
        """As in ``_Block``."""
        y = e.take(self.speakers, axis=0)
        y -= np.repeat(e[self.rows], self.counts, axis=0)
        felt = self.h(y.reshape(len(y), m, -1)).reshape(y.shape) if self.vector else self.h(y)
        total[self.rows] += self.gather @ felt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Graph:
    """The couplings of one graph as a function of the errors of n agents with m components."""

    n: int
    m: int
    blocks: tuple[_Block | _Hubs, ...]

    def __call__(self, e: Array) -> Array:
        """h(e) of (9), in a new array.

        Shapes: e (n m,) or (n m, R) with one column for each of R runs; rows agent by agent.
        """
        rows = np.ascontiguousarray(e).reshape((self.n, -1) if e.size > self.n else (self.n,))
        total = np.zeros_like(rows)
        for block in self.blocks:
            block.add(total, rows, self.m)
        return total.reshape(e.shape)


def graph_of(groups: Sequence[ArcGroup], *, n: int, m: int, runs: int = 1) -> Graph:
    """Prepare arcs that are grouped by coupling."""
    size = max(1, BLOCK // (m * runs))
    return Graph(n=n, m=m, blocks=tuple(block for group in groups for block in _blocks(group, size)))


def _blocks(group: ArcGroup, size: int) -> Iterator[_Block | _Hubs]:
    """Cut the arcs of one coupling into blocks of about ``size``."""
    order = np.argsort(group.listeners, kind="stable")
    listeners, speakers, weights = group.listeners[order], group.speakers[order], group.weights[order]
    h, vector = compile_coupling(group.coupling), not group.coupling.by_component
    first = 0
    while first < len(listeners):
        last = min(first + size, len(listeners))
        if last < len(listeners):  # at the end of an agent's arcs, unless it has more than a block of them
            end = int(np.searchsorted(listeners, listeners[last], side="left"))
            last = end if end > first else last
        ends, part = listeners[first:last], slice(first, last)
        lowest, rows = int(ends[0]), int(ends[-1] - ends[0]) + 1
        counts = np.bincount(ends - lowest, minlength=rows)
        if counts.max() > MOST_SLOTS:
            places = np.concatenate([[0], np.cumsum(counts)])
            gather = sp.csr_array((weights[part], np.arange(len(ends)), places), shape=(rows, len(ends)))
            yield _Hubs(
                h=h,
                vector=vector,
                rows=slice(lowest, lowest + rows),
                counts=counts,
                speakers=speakers[part].copy(),
                gather=gather,
            )
        else:
            yield _by_slots(h, vector, lowest, counts, speakers[part], weights[part])
        first = last


def _by_slots(
    h: Callable[[Array], Array], vector: bool, lowest: int, counts: IndexArray, speakers: IndexArray, weights: Array
) -> _Block:
    """Order agents by their number of arcs, and the arcs by slots."""
    agents = np.argsort(-counts, kind="stable")
    begins = np.cumsum(counts) - counts
    having = [int(np.count_nonzero(counts > slot)) for slot in range(int(counts.max()))]
    arcs = np.concatenate([begins[agents[:many]] + slot for slot, many in enumerate(having)])
    edges = np.concatenate([[0], np.cumsum(having)]).tolist()
    listeners = lowest + agents[: having[0]]
    in_order = having[0] == len(counts) and bool((np.diff(agents) == 1).all())
    factor = weights[arcs] if (weights != weights[0]).any() else float(weights[0])
    return _Block(
        h=h,
        vector=vector,
        rows=slice(lowest, lowest + len(counts)) if in_order else listeners,
        speakers=speakers[arcs],
        slots=tuple(pairwise(edges)),
        factor=factor,
    )


def hears(groups: Sequence[ArcGroup], n: int) -> sp.csr_array:
    """Mark who may influence whose derivative: neighbours, and every agent itself."""
    own = np.arange(n)
    rows = np.concatenate([own, *(group.listeners for group in groups)])
    columns = np.concatenate([own, *(group.speakers for group in groups)])
    marks: Any = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    return sp.csr_array(marks != 0).astype(np.float64)


class Links:
    """The arcs of one graph as in (9), evaluated arc by arc: every arc may hold an older value of its speaker."""

    def __init__(self, groups: Sequence[ArcGroup], n: int, m: int) -> None:
        self.groups, self.n, self.m = groups, n, m
        self.parts = [
            (compile_coupling(group.coupling), group.coupling.by_component, gathering_matrix(group, n))
            for group in groups
        ]
        empty = [np.zeros(0, dtype=np.int64)]
        self.listeners = np.concatenate([*empty, *(group.listeners for group in groups)])
        self.speakers = np.concatenate([*empty, *(group.speakers for group in groups)])
        self.codes = self.listeners * n + self.speakers

    def felt(self, own: Array, heard: Array) -> Array:
        """Sum of h(heard - own) over the arcs of each listener; an arc that holds nan is silent.

        Shapes: own (n, m, R), heard (arcs, m, R) for R runs.  Returns: as ``own``.
        """
        difference = heard - own[self.listeners]
        silent: Any = np.isnan(heard).any(axis=1)
        total = np.zeros_like(own)
        begin = 0
        for h, by_component, gather in self.parts:
            end = begin + gather.shape[1]
            y = difference[begin:end]
            value = np.array(h(y) if by_component else h(np.ascontiguousarray(y)))
            np.moveaxis(value, 1, -1)[silent[begin:end]] = 0.0
            total += (gather @ value.reshape(len(value), -1)).reshape(own.shape)
            begin = end
        return total


def compile_coupling(coupling: Coupling) -> Callable[[Array], Array]:
    """Return h as a function of differences y of shape (arcs, m, ...), or any shape where h acts by component.

    Overflow gives inf and undefined places nan; silence NumPy around it with ``np.errstate(all="ignore")``.
    """
    programs = [_program(expression.node) for expression in coupling.components]
    if coupling.by_component:
        program = programs[0]

        def by_component(y: Array) -> Array:
            value = _run(program, (y,))
            return value if value.shape == y.shape else np.broadcast_to(value, y.shape)

        return by_component

    def by_vector(y: Array) -> Array:
        variables = [y[:, c] for c in range(len(programs))]
        result = np.empty_like(y)
        for c, program in enumerate(programs):
            result[:, c] = _run(program, variables)
        return result

    return by_vector


_Program = list[tuple[Any, int, int]]


def _program(node: Node) -> _Program:
    """(what to call or push, number of operands, which operand the result may overwrite or -1), in postorder.

    A ufunc overwrites an operand that is an array of its own: not one of the variables, and no constant.
    """
    program: _Program = []
    own: list[bool] = []  # of the values on the stack
    varies: list[bool] = []
    for part in postorder(node):
        what, count = _step(part)
        place = -1
        if count == _VARIABLE:
            own.append(False)
            varies.append(True)
        elif count == _CONSTANT:
            own.append(False)
            varies.append(False)
        else:
            if isinstance(what, np.ufunc) and True in own[-count:]:
                place = own[-count:].index(True)
            depends = any(varies[-count:])
            del own[-count:], varies[-count:]
            own.append(depends)
            varies.append(depends)
        program.append((what, count, place))
    return program


def _step(node: Node) -> tuple[Any, int]:
    """(what to call or push, number of operands)."""
    match node:
        case Variable():
            return node.index, _VARIABLE
        case Constant():
            return np.float64(NumpyAlgebra().constant(node.value)), _CONSTANT
        case Pi():
            return np.float64(np.pi), _CONSTANT
        case Negate():
            return np.negative, 1
        case Power():
            return _power(node.exponent), 1
        case Call():
            return _function(node.name), len(node.arguments)
        case _:
            return _BINARY[type(node)], 2


def _power(exponent: int) -> Callable[[Any], Any]:
    if exponent == 1:
        return np.positive  # a copy: what follows may overwrite it, and must not overwrite the variable
    if not 1 <= exponent <= LARGEST_PRODUCT:
        return lambda base: base**exponent

    def product(base: Any) -> Any:
        result, square, rest = None, base, exponent
        while rest:
            if rest & 1:
                result = square if result is None else result * square
            rest >>= 1
            square = square * square if rest else square
        return result

    return product


def _function(name: str) -> Callable[..., Any]:
    function = FUNCTIONS[name].found_in(np, "numpy")
    return (lambda *operands: reduce(function, operands)) if name in ("min", "max") else function


def _run(program: _Program, variables: Sequence[Array]) -> Any:
    stack: list[Any] = []
    for what, count, place in program:
        if count == _VARIABLE:
            stack.append(variables[what])
        elif count == _CONSTANT:
            stack.append(what)
        else:
            operands = stack[-count:]
            del stack[-count:]
            stack.append(what(*operands) if place < 0 else what(*operands, out=operands[place]))
    return np.asarray(stack[0])
