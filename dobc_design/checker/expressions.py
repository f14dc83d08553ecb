"""The reader of couplings: Python parses the text (it runs nothing), and whatever is not in the
grammar is refused.

An expression becomes a list of steps on jets. A jet is a value with its slopes along the variables
(none: constant), all of them intervals; at a kink the slopes are Clarke's. The same steps give the
exact slopes at 0, on rationals, and enclosures on whole intervals of floating-point numbers.
"""

import ast
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache, partial
from itertools import zip_longest
from operator import add
from typing import Any, NamedTuple

from . import intervals
from .intervals import (
    PI,
    Exact,
    Interval,
    Real,
    added,
    divided,
    enclosed,
    like,
    negative,
    power,
    times,
)
from .reading import Refused, need, rational

Jet = tuple[Interval[Real], tuple[Interval[Real], ...]]
Operation = tuple[Callable[..., Any], Callable[..., Any]]


# --- Operations on jets
# -----------------------------------------------------------------------------------------------
def variables(box: Sequence[Interval[Real]]) -> list[Jet[Real]]:
    """The variables on a box."""
    return [(y, tuple(like(y, k == own) for k in range(len(box)))) for own, y in enumerate(box)]


def applied(operation: Operation, *jets: Jet[Real]) -> Jet[Real]:
    """A smooth operation, by the chain rule; the partial derivatives are looked at only where an
    argument varies."""
    function, partials = operation
    arguments, slopes = [jet[0] for jet in jets], tuple[Interval[Real], ...]()
    value = function(*arguments)
    if any(jet[1] for jet in jets):
        for factor, jet in zip(partials(*arguments, value), jets, strict=True):
            own = tuple([times(factor, slope) for slope in jet[1]])
            slopes = tuple(map(added, slopes, own)) if slopes and own else slopes or own
    return value, slopes


def least(x: Jet[Real], *others: Jet[Real]) -> Jet[Real]:
    """The minimum; where either may be the smaller one, the slopes of both."""
    for y in others:
        value = min(x[0][0], y[0][0]), min(x[0][1], y[0][1])
        if x[0][1] <= y[0][0] or y[0][1] <= x[0][0]:
            x = (value, x[1] if x[0][1] <= y[0][0] else y[1])
        else:
            pairs = zip_longest(x[1], y[1], fillvalue=like(value, 0))
            x = (value, tuple(intervals.hull(*pair) for pair in pairs))
    return x


def greatest(*x: Jet[Real]) -> Jet[Real]:
    """The maximum."""
    return applied(NEGATIVE, least(*(applied(NEGATIVE, each) for each in x)))


def sign(x: Interval[Real]) -> Interval[Real]:
    """The slope of |x|."""
    return (
        like(x, 1)
        if x[0] >= 0
        else like(x, -1)
        if x[1] <= 0
        else intervals.hull(like(x, -1), like(x, 1))
    )


def rest(x: Interval[Real]) -> Interval[Real]:
    """1 - x for a number x that is at most 1."""
    lo, hi = added(like(x, 1), negative(x))
    return max(lo, lo * 0), hi


# A smooth operation: its value, and its partial derivatives from the arguments and the value f.
NEGATIVE: Operation = (negative, lambda x, f: (like(x, -1),))
OPERATIONS: dict[type, Operation] = {
    ast.Add: (added, lambda x, y, f: (like(x, 1), like(y, 1))),
    ast.Sub: (lambda x, y: added(x, negative(y)), lambda x, y, f: (like(x, 1), like(y, -1))),
    ast.Mult: (times, lambda x, y, f: (y, x)),
    ast.Div: (divided, lambda x, y, f: (divided(like(y, 1), y), negative(divided(f, y)))),
}
DEGREES: dict[type, Callable[[float, float], float]] = {
    **dict.fromkeys((ast.Add, ast.Sub), max),
    **{ast.Mult: add, ast.Div: lambda a, b: math.inf if b else a},
}
SMOOTH: dict[str, Operation] = {
    "exp": (partial(intervals.by_decimal, "exp"), lambda x, f: (f,)),
    "log": (partial(intervals.by_decimal, "ln"), lambda x, f: (divided(like(x, 1), x),)),
    "sqrt": (partial(intervals.by_decimal, "sqrt"), lambda x, f: (divided(like(x, 0.5), f),)),
    "sin": (lambda x: intervals.wave(x, 0), lambda x, f: (intervals.wave(x, 1),)),
    "cos": (lambda x: intervals.wave(x, 1), lambda x, f: (negative(intervals.wave(x, 0)),)),
    "tan": (intervals.tangent, lambda x, f: (added(like(x, 1), power(f, 2)),)),
    "atan": (
        intervals.arctangent,
        lambda x, f: (divided(like(x, 1), added(like(x, 1), power(x, 2))),),
    ),
    "asinh": (
        intervals.inverse_sine,
        lambda x, f: (divided(like(x, 1), intervals.hyperbolic(f, True)),),
    ),
    "tanh": (intervals.hyperbolic_tangent, lambda x, f: (rest(power(f, 2)),)),
    "sinh": (
        lambda x: intervals.hyperbolic(x, False),
        lambda x, f: (intervals.hyperbolic(x, True),),
    ),
    "cosh": (
        lambda x: intervals.hyperbolic(x, True),
        lambda x, f: (intervals.hyperbolic(x, False),),
    ),
    "abs": (intervals.absolute, lambda x, f: (sign(x),)),
}
# Functions of jets: what they do, and how many arguments they take; those with kinks.
FUNCTIONS: dict[str, tuple[Callable[..., Any], float, float]] = {
    **{name: (partial(applied, operation), 1, 1) for name, operation in SMOOTH.items()},
    "min": (least, 2, math.inf),
    "max": (greatest, 2, math.inf),
    "clip": (lambda y, lo, hi: greatest(lo, least(y, hi)), 3, 3),
}
KINKS = ("abs", "min", "max", "clip")


# --- Expressions
# --------------------------------------------------------------------------------------------------
class Step(NamedTuple):
    """An operation on the jets with these numbers; a variable or a constant has none, a constant
    has a value."""

    operation: Callable[..., Any] | None
    arguments: tuple[int, ...]
    degree: float  # as a polynomial; inf if it is none
    varies: bool  # whether a variable occurs in it
    value: Any = None


LONGEST = 2000  # characters of an expression of the problem
LONGEST_MADE = 20 * LONGEST  # and of one that is made of it, f(target + e) - f(target)


class Expression:
    """An expression in the given variables, as it is written."""

    def __init__(self, source: str, names: list[str], longest: int = LONGEST) -> None:
        own = re.fullmatch(rf"[a-zE0-9.+*/(), -]{{1,{longest}}}", source)
        need(own is not None, "it is no expression, or it is too long")
        self.source, self.names, self.kinked = source.strip(), names, False
        self.steps = [Step(None, (), 1, True) for _ in names]
        try:
            self.result = self.read(ast.parse(self.source, mode="eval").body)
        except (SyntaxError, MemoryError, RecursionError):
            raise Refused(
                "an expression does not follow the grammar, or is nested too deeply"
            ) from None
        self.degree = self.steps[self.result].degree

    def read(self, node: ast.expr) -> int:
        """The number of the step that gives a part of the expression."""
        match node:
            case ast.Constant():
                number = rational(self.source[node.col_offset : node.end_col_offset])
                return self.append(None, (), 0, (number, number))
            case ast.Name(id="pi"):
                return self.append(None, (), 0, PI)
            case ast.Name(id=name):
                need(
                    name in self.names, "an expression holds a name that the grammar does not know"
                )
                return self.names.index(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.read(operand)
                return self.append(partial(applied, NEGATIVE), (inner,), self.steps[inner].degree)
            case ast.BinOp(
                left=left, op=ast.Pow(), right=ast.expr(col_offset=start, end_col_offset=end)
            ):
                return self.read_power(left, self.source[start:end])
            case ast.BinOp():
                return self.read_chain(node)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self.read_call(name, tuple(map(self.read, arguments)))
        raise Refused("an expression holds something that the grammar does not know")

    def read_power(self, base: ast.expr, exponent: str) -> int:
        """An expression to an integer power."""
        need(
            bool(re.fullmatch(r"-?[0-9]{1,2}", exponent)) and abs(int(exponent)) <= 64,
            "an exponent is no integer up to 64",
        )
        n, place = int(exponent), self.read(base)
        degree = self.steps[place].degree
        polynomial = degree < math.inf and (n >= 0 or degree == 0)
        raised: Operation = (
            lambda x: power(x, n),
            lambda x, f: (times(like(x, n), power(x, n - 1 if n else 0)),),
        )
        return self.append(
            partial(applied, raised), (place,), degree * n if polynomial else math.inf
        )

    def read_chain(self, node: ast.BinOp) -> int:
        """Sums and products: a long one leans to the left, deeper than Python follows calls."""
        chain, first = [node], node.left
        while isinstance(first, ast.BinOp) and not isinstance(first.op, ast.Pow):
            chain.append(first)
            first = first.left

        place = self.read(first)
        for part in reversed(chain):
            need(
                type(part.op) in OPERATIONS,
                "an expression holds an operation that the grammar does not know",
            )
            right = self.read(part.right)
            degree = DEGREES[type(part.op)](self.steps[place].degree, self.steps[right].degree)
            place = self.append(partial(applied, OPERATIONS[type(part.op)]), (place, right), degree)
        return place

    def read_call(self, name: str, arguments: tuple[int, ...]) -> int:
        """A function; it has a kink if it is applied to something in which a variable occurs."""
        need(name in FUNCTIONS, "an expression holds a function that the grammar does not know")
        function, fewest, most = FUNCTIONS[name]
        need(fewest <= len(arguments) <= most, "a function has the wrong number of arguments")
        self.kinked = self.kinked or (
            name in KINKS and any(self.steps[k].varies for k in arguments)
        )
        return self.append(
            function, arguments, math.inf if any(self.steps[k].degree for k in arguments) else 0
        )

    def append(
        self, operation: Any, arguments: tuple[int, ...], degree: float, value: Exact | None = None
    ) -> int:
        """A new step; one that depends on constants only is done at once."""
        varies = any(self.steps[k].varies for k in arguments)
        if operation and not varies:
            operation, (value, _) = None, operation(*((self.steps[k].value, ()) for k in arguments))
        self.steps.append(Step(operation, arguments, degree, varies, value))
        return len(self.steps) - 1

    @cached_property
    def rounded(self) -> list[Step]:
        """The steps with constants between floating-point numbers."""
        return [
            each._replace(value=each.value and intervals.hull(*map(enclosed, each.value)))
            for each in self.steps
        ]

    def run(self, steps: list[Step], given: Sequence[Jet[Real]]) -> Jet[Real]:
        """Value and slopes, from those of the variables, by the steps in the arithmetic of the
        variables."""
        jets: list[Jet[Real]] = list(given)
        for operation, arguments, _, _, value in steps[len(given) :]:
            jets.append(operation(*[jets[k] for k in arguments]) if operation else (value, ()))
        return jets[self.result]

    def at(self, *given: Jet[Any]) -> Jet[Any]:
        """Value and slopes, exactly on rationals, with rounded constants on intervals of
        floating-point numbers."""
        return self.run(self.rounded if isinstance(given[0][0][0], float) else self.steps, given)


# --- Couplings
# --------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Coupling:
    """h: a single expression for every component, or m expressions."""

    h: tuple[str, ...]
    parts: list[Expression]
    kinked: bool  # as it is written
    straight: bool  # linear as it is written, and not kinked
    # those at 0 that are not 0: dh_c/dy_d (none if it is kinked)
    slopes: dict[tuple[int, int], Exact]

    @property
    def single(self) -> bool:
        """Whether h acts by component."""
        return len(self.h) == 1

    def slope(self, c: int, d: int) -> Exact:
        """dh_c/dy_d at 0."""
        return self.slopes.get((c, d), (Fraction(0), Fraction(0)))


@lru_cache(maxsize=1000)
def read_coupling(h: tuple[str, ...], m: int, longest: int = LONGEST) -> Coupling:
    """The coupling of these expressions between agents with m components."""
    names = ["y"] if len(h) == 1 else [f"y{d + 1}" for d in range(m)]
    parts, zero = [Expression(each, names, longest) for each in h], (Fraction(0), Fraction(0))
    vanishing = all(part.run(part.steps, [(zero, ())] * len(names))[0] == zero for part in parts)
    need(vanishing, "a coupling is not shown to vanish at 0")

    kinked = any(part.kinked for part in parts)
    rows = (
        []
        if kinked
        else [part.run(part.steps, variables([zero] * len(names)))[1] for part in parts]
    )
    slopes = {(c, d): slope for c, row in enumerate(rows) for d, slope in enumerate(row)}
    if len(h) == 1:
        slopes = {(c, c): slope for c in range(m) for slope in slopes.values()}
    straight = not kinked and all(part.degree <= 1 for part in parts)
    return Coupling(
        h,
        parts,
        kinked,
        straight,
        {place: slope for place, slope in slopes.items() if slope != zero},
    )
