"""The expression tree of a coupling function h, and the one walk over it.

Every use of h (NumPy, intervals, CasADi, SymPy, text, LaTeX) is an ``Algebra`` handed to ``evaluate``; the
tree itself knows no number type.  It is what the user wrote: nothing is folded, reordered or simplified.
The walk keeps its own stack, so a sum of a thousand terms is no deeper for Python than y.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol, TypeVar

from dobc_design.coupling.functions import FUNCTIONS

T = TypeVar("T")

LARGEST_EXPONENT = 64


class Node:
    """A node of the tree; two are equal when the whole trees below them are."""

    __slots__ = ()

    @property
    def children(self) -> tuple[Node, ...]:
        """The operands, from left to right."""
        return ()

    @property
    def content(self) -> tuple[object, ...]:
        """What the node holds besides its operands, for comparison."""
        return ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Node):
            return NotImplemented
        return self is other or _signature(self) == _signature(other)

    def __hash__(self) -> int:
        return hash(_signature(self))


@dataclass(frozen=True, slots=True, eq=False)
class Constant(Node):
    """An exact number, at least 0 (a negative one is Negate(Constant))."""

    value: Fraction

    def __post_init__(self) -> None:
        if self.value < 0:
            raise ValueError(f"a Constant must be at least 0; got {self.value}: use Negate(Constant(...)).")

    @property
    def content(self) -> tuple[object, ...]:
        return (self.value,)


@dataclass(frozen=True, slots=True, eq=False)
class Pi(Node):
    """The number pi."""


@dataclass(frozen=True, slots=True, eq=False)
class Variable(Node):
    """y_(index + 1); the index counts from 0."""

    index: int

    @property
    def content(self) -> tuple[object, ...]:
        return (self.index,)


@dataclass(frozen=True, slots=True, eq=False)
class Negate(Node):
    """-operand."""

    operand: Node

    @property
    def children(self) -> tuple[Node, ...]:
        return (self.operand,)


@dataclass(frozen=True, slots=True, eq=False)
class _Binary(Node):
    left: Node
    right: Node

    @property
    def children(self) -> tuple[Node, ...]:
        return (self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False)
class Add(_Binary):
    """left + right."""


@dataclass(frozen=True, slots=True, eq=False)
class Subtract(_Binary):
    """left - right."""


@dataclass(frozen=True, slots=True, eq=False)
class Multiply(_Binary):
    """left * right."""


@dataclass(frozen=True, slots=True, eq=False)
class Divide(_Binary):
    """left / right."""


@dataclass(frozen=True, slots=True, eq=False)
class Power(Node):
    """base ** exponent with an integer exponent; y**0.5 is Call("sqrt", (y,))."""

    base: Node
    exponent: int

    def __post_init__(self) -> None:
        if abs(self.exponent) > LARGEST_EXPONENT:
            raise ValueError(f"an exponent must be at most {LARGEST_EXPONENT} in size; got {self.exponent}.")

    @property
    def children(self) -> tuple[Node, ...]:
        return (self.base,)

    @property
    def content(self) -> tuple[object, ...]:
        return (self.exponent,)


@dataclass(frozen=True, slots=True, eq=False)
class Call(Node):
    """One of the whitelisted functions applied to its arguments."""

    name: str
    arguments: tuple[Node, ...]

    def __post_init__(self) -> None:
        fewest, most = FUNCTIONS[self.name].arguments if self.name in FUNCTIONS else (1, 0)
        if not fewest <= len(self.arguments) <= most:
            raise ValueError(f"{self.name} with {len(self.arguments)} argument(s) is not in the whitelist.")

    @property
    def children(self) -> tuple[Node, ...]:
        return self.arguments

    @property
    def content(self) -> tuple[object, ...]:
        return (self.name, len(self.arguments))


class Algebra(Protocol[T]):
    """The operations on one kind of value.

    ``power`` gets integer exponents of at most 64 in size; ``call`` gets the names in ``functions``: min and max
    with two or more arguments, clip with (x, lo, hi), all others with one.
    """

    def constant(self, value: Fraction) -> T: ...
    def pi(self) -> T: ...
    def negate(self, operand: T) -> T: ...
    def add(self, left: T, right: T) -> T: ...
    def subtract(self, left: T, right: T) -> T: ...
    def multiply(self, left: T, right: T) -> T: ...
    def divide(self, left: T, right: T) -> T: ...
    def power(self, base: T, exponent: int) -> T: ...
    def call(self, name: str, arguments: tuple[T, ...]) -> T: ...


class Operators:
    """The arithmetic of an algebra whose values have Python's operators."""

    def negate(self, operand: Any) -> Any:
        return -operand

    def add(self, left: Any, right: Any) -> Any:
        return left + right

    def subtract(self, left: Any, right: Any) -> Any:
        return left - right

    def multiply(self, left: Any, right: Any) -> Any:
        return left * right

    def divide(self, left: Any, right: Any) -> Any:
        return left / right

    def power(self, base: Any, exponent: int) -> Any:
        return base**exponent


def variable_names(dimension: int) -> tuple[str, ...]:
    """Return ("y",) for one variable, else ("y1", ..., "ym")."""
    return ("y",) if dimension == 1 else tuple(f"y{index + 1}" for index in range(dimension))


def names_in_words(dimension: int) -> str:
    """Say which names the variables have: "y", or "y1 to y3"."""
    return "y" if dimension == 1 else f"y1 to y{dimension}"


def postorder(node: Node) -> tuple[Node, ...]:
    """List the nodes so that each follows its operands, left operand first."""
    order: list[Node] = []
    waiting = [node]
    while waiting:
        current = waiting.pop()
        order.append(current)
        waiting.extend(current.children)
    return tuple(reversed(order))


def evaluate(node: Node, variables: Sequence[T], algebra: Algebra[T]) -> T:
    """Evaluate the tree with ``variables[i]`` for y_(i + 1).

    Raises: whatever the algebra raises; IndexError if there are fewer variables than the tree uses.
    """
    return run(postorder(node), variables, algebra)


def run(order: Sequence[Node], variables: Sequence[T], algebra: Algebra[T]) -> T:
    """Evaluate a tree given in postorder; for callers that evaluate the same tree many times."""
    stack: list[T] = []
    for node in order:
        if isinstance(node, Variable):
            stack.append(variables[node.index])
            continue
        count = len(node.children)
        operands = tuple(stack[len(stack) - count :])
        del stack[len(stack) - count :]
        stack.append(_apply(node, operands, algebra))
    return stack.pop()


def _apply(node: Node, operands: tuple[T, ...], algebra: Algebra[T]) -> T:
    match node:
        case Constant():
            return algebra.constant(node.value)
        case Pi():
            return algebra.pi()
        case Power():
            return algebra.power(operands[0], node.exponent)
        case Call():
            return algebra.call(node.name, operands)
    operation: Callable[..., T] = getattr(algebra, type(node).__name__.lower())
    return operation(*operands)


def _signature(node: Node) -> tuple[object, ...]:
    return tuple((type(part), *part.content) for part in postorder(node))
