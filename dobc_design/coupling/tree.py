"""The expression tree of a coupling function h, the one walk over it, and its algebras.

Every use of h (NumPy, intervals, CasADi, SymPy, text, LaTeX) is an ``Algebra`` handed to
``evaluate``.  The tree is what the user wrote; the walk keeps its own stack, so a sum of a thousand
terms is no deeper for Python than y.  The interval algebras here are rigorous: they return what
contains every value on the given box, or raise UndefinedError.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from dobc_design._checks import positional
from dobc_design.exact import interval
from dobc_design.exact.interval import Box, Interval
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import nearest, number_key

from .functions import FUNCTIONS, applied

T = TypeVar("T")

LARGEST_EXPONENT = 64


@positional(eq=False)
class Node:
    """An operation of ``Algebra`` by its name, or a variable; two are equal when the whole trees
    below them are.

    ``own`` is what it holds besides its operands: the value of a constant, at least 0 (a negative
    one is negated), the index of a variable, from 0, the integer exponent of a power (y**0.5 is a
    call of sqrt), the name of a function.
    """

    kind: str
    operands: tuple[Node, ...] = ()  # from left to right
    own: Any = None

    def __post_init__(self) -> None:
        if self.kind == "constant" and self.own < 0:
            raise ValueError(f"a constant must be at least 0; got {self.own}: negate it.")
        if self.kind == "power" and abs(self.own) > LARGEST_EXPONENT:
            raise ValueError(
                f"an exponent must be at most {LARGEST_EXPONENT} in size; got {self.own}."
            )
        if self.kind == "call" and not _is_known(self.own, len(self.operands)):
            raise ValueError(
                f"{self.own} with {len(self.operands)} argument(s) is not in the whitelist."
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Node):
            return NotImplemented
        return self is other or _signature(self) == _signature(other)

    def __hash__(self) -> int:
        return hash(_signature(self))


def _is_known(name: str, count: int) -> bool:
    """Whether the language has the function, with so many arguments."""
    if name not in FUNCTIONS:
        return False
    fewest, most = FUNCTIONS[name].arguments
    return fewest <= count <= most


class Algebra(Protocol[T]):
    """The operations on one kind of value.  ``power`` gets integer exponents of at most 64 in size;
    ``call`` gets the names in ``functions``: min and max with two or more arguments, clip with (x,
    lo, hi), all others with one."""

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

    negate = staticmethod(operator.neg)
    add = staticmethod(operator.add)
    subtract = staticmethod(operator.sub)
    multiply = staticmethod(operator.mul)
    divide = staticmethod(operator.truediv)
    power = staticmethod(operator.pow)


def variable_names(dimension: int) -> tuple[str, ...]:
    """Return ("y",) for one variable, else ("y1", ..., "ym")."""
    return ("y",) if dimension == 1 else tuple(f"y{index + 1}" for index in range(dimension))


def names_in_words(dimension: int) -> str:
    """Say which names the variables have: "y", or "y1 to y3"."""
    return "y" if dimension == 1 else f"y1 to y{dimension}"


def postorder(node: Node) -> tuple[Node, ...]:
    """List the nodes so that each follows its operands, left operand first."""
    order = []
    waiting = [node]
    while waiting:
        current = waiting.pop()
        order.append(current)
        waiting.extend(current.operands)
    return tuple(reversed(order))


def evaluate(node: Node, variables: Sequence[T], algebra: Algebra[T]) -> T:
    """Evaluate the tree with ``variables[i]`` for y_(i + 1).  Raises: whatever the algebra
    raises."""
    return run(program(node, algebra), variables)


# An operation with how many operands it takes from the stack; without one the index of a variable.
Step = tuple[Callable[..., T] | None, int]


def program(node: Node, algebra: Algebra[T]) -> tuple[Step[T], ...]:
    """Return the steps that evaluate the tree, for callers that evaluate it many times."""
    return tuple(_step(each, algebra) for each in postorder(node))


def run(steps: Sequence[Step[T]], variables: Sequence[T]) -> T:
    """Evaluate a tree by its ``program``.  Raises: whatever the algebra raises."""
    stack = []
    for operation, number in steps:
        if operation is None:
            stack.append(variables[number])
        # Nearly all operations have one operand or two: these are not taken as slices.
        elif number == 1:
            stack[-1] = operation(stack[-1])
        elif number == 2:
            right = stack.pop()
            stack[-1] = operation(stack[-1], right)
        else:
            first = len(stack) - number
            stack[first:] = [operation(*stack[first:])]
    return stack.pop()


def _step(node: Node, algebra: Algebra[T]) -> Step[T]:
    match node.kind:
        case "variable":
            return None, node.own
        case "constant":
            value = algebra.constant(node.own)
            return lambda: value, 0
        case "power":  # the exponent is no operand: it is a number of the tree itself
            return lambda base: algebra.power(base, node.own), 1
        case "call":
            return lambda *operands: algebra.call(node.own, operands), len(node.operands)
    # The others are called as the operations of an algebra are.
    return getattr(algebra, node.kind), len(node.operands)


def _signature(node: Node) -> tuple[object, ...]:
    """What two trees have in common iff they are equal, without recursion."""
    signature: list[object] = []
    for part in postorder(node):
        signature += (part.kind, len(part.operands), number_key(part.own))
    return tuple(signature)


ZERO = Interval.point(0)
ONE = Interval.point(1)


class Library(Operators):
    """The algebra of a library, whose functions are those of ``module``; ``names``: the column of
    ``functions`` in which they are called as there."""

    module: Any
    names: str

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Any) -> Any:
        return FUNCTIONS[name].found_in(self.module, self.names)(*operands)


class NumpyAlgebra(Library):
    """Float64 arrays with broadcasting; a constant beyond the floats is infinite."""

    module = np
    names = "numpy"

    def constant(self, value: Fraction) -> Array:
        return np.asarray(nearest(value))

    def pi(self) -> Array:
        return np.asarray(np.pi)


class IntervalAlgebra(Operators):
    """Enclosures of the value; exact rationals stay points as long as they are short."""

    def constant(self, value: Fraction) -> Interval:
        return Interval.point(value)

    def pi(self) -> Interval:
        return interval.pi()

    def call(self, name: str, arguments: Box) -> Interval:
        if len(arguments) == 1:  # at once, being asked most often
            return FUNCTIONS[name].interval(arguments[0])
        return applied(name, arguments, self, self._called)

    def _called(self, name: str, *operands: Interval) -> Interval:
        return FUNCTIONS[name].interval(*operands)


class Jet(NamedTuple):
    """Enclosures of a value and its partial derivatives (Clarke's at a kink) on a box, in one
    variable also of h''. ``curvature`` is None where it is not asked for, or where there may be a
    kink and h'' is not defined everywhere."""

    value: Interval
    partials: Box
    curvature: Interval | None

    @property
    def slope(self) -> Interval:
        """The derivative in the only variable."""
        return self.partials[0]


class GradientAlgebra:
    """Forward differentiation with intervals, for ``variable_count`` variables; ``second``: of one,
    twice.

    Theory, sections 1 and 5: the signs of h' and h'' on an interval say where h and its secant gain
    are monotone. Where abs, min, max or clip may have a kink, the hull of the slopes on both sides
    is taken, which contains Clarke's generalized gradient.  ``restricted``: derivatives are those
    of the function on this box only, so that a kink at an end point does not count.
    Raises: UndefinedError where a value or a slope is not bounded on the box (sqrt at 0).
    """

    def __init__(
        self, variable_count: int, *, second: bool = False, restricted: bool = False
    ) -> None:
        self.no_slope = (ZERO,) * variable_count
        self.second = second
        self.restricted = restricted

    def variables(self, box: Sequence[Interval]) -> tuple[Jet, ...]:
        """Return the variables themselves, y_i in box[i]."""
        count = len(self.no_slope)
        curvature = ZERO if self.second else None
        found = []
        for own, side in zip(range(count), box, strict=True):
            partials = tuple(ONE if own == each else ZERO for each in range(count))
            found.append(Jet(side, partials, curvature))
        return tuple(found)

    def constant(self, value: Fraction) -> Jet:
        return self._still(Interval.point(value))

    def pi(self) -> Jet:
        return self._still(interval.pi())

    def negate(self, operand: Jet) -> Jet:
        partials = tuple(u if u is ZERO else -u for u in operand.partials)
        curvature = None if operand.curvature is None else -operand.curvature
        return Jet(-operand.value, partials, curvature)

    def add(self, left: Jet, right: Jet) -> Jet:
        u, v = left.curvature, right.curvature
        curvature = None if u is None or v is None else _plus(u, v)
        pairs = zip(left.partials, right.partials, strict=True)
        partials = tuple(_plus(u, v) for u, v in pairs)
        return Jet(left.value + right.value, partials, curvature)

    def subtract(self, left: Jet, right: Jet) -> Jet:
        return self.add(left, self.negate(right))

    def multiply(self, left: Jet, right: Jet) -> Jet:
        x, y = left.value, right.value
        if left.partials is self.no_slope and left.curvature is ZERO:  # a constant
            return self._scaled(x, right)
        pairs = zip(left.partials, right.partials, strict=True)
        partials = tuple(_plus(_times(u, y), _times(v, x)) for u, v in pairs)
        curvature = None
        if left.curvature is not None and right.curvature is not None:  # x''y + 2 x'y' + xy''
            twice = ZERO
            if left.slope is not ZERO and right.slope is not ZERO:
                twice = _times(left.slope, right.slope) * 2
            first = _plus(_times(left.curvature, y), twice)
            curvature = _plus(first, _times(right.curvature, x))
        return Jet(x * y, partials, curvature)

    def _scaled(self, factor: Interval, jet: Jet) -> Jet:
        partials = tuple(_times(u, factor) for u in jet.partials)
        curvature = None if jet.curvature is None else _times(jet.curvature, factor)
        return Jet(factor * jet.value, partials, curvature)

    def divide(self, left: Jet, right: Jet) -> Jet:
        y = right.value  # division by an interval with 0 inside raises
        quotient = left.value / y
        partials = tuple(
            ZERO if u is v is ZERO else (u - _times(v, quotient)) / y
            for u, v in zip(left.partials, right.partials, strict=True)
        )
        curvature = None
        if left.curvature is not None and right.curvature is not None:  # of x = quotient y
            twice = _times(right.slope, partials[0]) * 2
            curvature = (left.curvature - twice - _times(right.curvature, quotient)) / y
        return Jet(quotient, partials, curvature)

    def power(self, base: Jet, exponent: int) -> Jet:
        x = base.value
        value = x**exponent
        if exponent == 0:
            return self._still(value)
        if exponent == 1:
            return base

        def slope() -> Interval:
            return x ** (exponent - 1) * exponent

        def curvature(first: Interval) -> Interval:
            return x ** (exponent - 2) * (exponent * (exponent - 1))

        return self._chain(base, value, slope, curvature)

    def call(self, name: str, arguments: tuple[Jet, ...]) -> Jet:
        if len(arguments) > 1:
            return applied(name, arguments, self, self._extreme)
        (argument,) = arguments
        row = FUNCTIONS[name]
        x = argument.value
        value = row.interval(x)
        slope, curvature = row.slope, row.curvature
        if slope is None or curvature is None:  # abs(y) is max(y, -y), with both slopes at 0
            found = self._extreme("max", argument, self.negate(argument))
            return Jet(value, found.partials, found.curvature)
        return self._chain(
            argument, value, lambda: slope(x, value), lambda first: curvature(x, value, first)
        )

    def _still(self, value: Interval) -> Jet:
        return Jet(value, self.no_slope, ZERO if self.second else None)

    def _chain(
        self,
        inner: Jet,
        value: Interval,
        outer: Callable[[], Interval],
        curved: Callable[[Interval], Interval],
    ) -> Jet:
        """The chain rule for f(inner) with this ``value``: ``outer`` gives f' there, and ``curved``
        from it f''; both are asked only where they are needed."""
        if inner.curvature is ZERO and inner.slope is ONE:  # of y itself, which is asked most often
            first = outer()
            return Jet(value, (first,), curved(first))
        # A constant has slope 0 even where the function has none, as in sqrt(0)*y.
        flat = not self.second or (inner.curvature is not None and inner.curvature.is_zero)
        if flat and inner.slope is not ONE and all(u.is_zero for u in inner.partials):
            return self._still(value)
        first = outer()
        partials = tuple(_times(u, first) for u in inner.partials)
        if inner.curvature is None:
            return Jet(value, partials, None)
        square = ONE if inner.slope is ONE else inner.slope**2
        curvature = _plus(_times(square, curved(first)), _times(inner.curvature, first))
        return Jet(value, partials, curvature)

    def _extreme(self, name: str, left: Jet, right: Jet) -> Jet:
        """min or max of two: one of them where that is sure, else the hull of both slopes."""
        below, above = (left, right) if name == "min" else (right, left)
        if self._is_below(below, above):
            return left
        if self._is_below(above, below):
            return right
        value = FUNCTIONS[name].interval(left.value, right.value)
        pairs = zip(left.partials, right.partials, strict=True)
        partials = tuple(u.hull(v) for u, v in pairs)
        still = left.curvature == ZERO == right.curvature and left.slope == right.slope == ZERO
        return Jet(value, partials, ZERO if still else None)

    def _is_below(self, left: Jet, right: Jet) -> bool:
        """Whether the left one is the smaller one on the whole box."""
        if left.value.hi < right.value.lo:
            return True
        return self.restricted and left.value.hi == right.value.lo


def _plus(u: Interval, v: Interval) -> Interval:
    # Most partial derivatives of a long expression in many variables are this very zero.
    if u is ZERO:
        return v
    return u if v is ZERO else u + v


def _times(derivative: Interval, factor: Interval) -> Interval:
    # And many others are the slope 1 of a variable, which no product has to round.
    if derivative is ZERO:
        return ZERO
    return factor if derivative is ONE else derivative * factor
