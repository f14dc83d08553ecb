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

from .intervals import (
    PI,
    Exact,
    Interval,
    Real,
    Span,
    absolute,
    added,
    arctangent,
    by_decimal,
    divided,
    enclosed,
    hull,
    hyperbolic,
    hyperbolic_tangent,
    inverse_sine,
    like,
    negative,
    power,
    tangent,
    times,
    wave,
)
from .reading import Refused, need, rational

Jet = tuple[Interval[Real], tuple[Interval[Real], ...]]
ZERO: Exact = (Fraction(0), Fraction(0))
Function = Callable[..., Any]
Places = tuple[int, ...]  # of steps
Operation = tuple[Function, Function]


# --- Operations on jets
def variables(box: Sequence[Interval[Real]]) -> list[Jet[Real]]:
    """The variables on a box."""
    jets: list[Jet[Real]] = []
    for own, y in enumerate(box):
        jets.append((y, tuple(like(y, k == own) for k in range(len(box)))))
    return jets


def applied(operation: Operation, *jets: Jet[Real]) -> Jet[Real]:
    """A smooth operation, by the chain rule; the partial derivatives are looked at only where an
    argument varies."""
    function, partials = operation
    arguments = [jet[0] for jet in jets]
    value = function(*arguments)
    # a constant has no slopes, and its operation need not have any
    slopes: tuple[Interval[Real], ...] = ()
    if not any(jet[1] for jet in jets):
        return value, slopes
    for factor, jet in zip(partials(*arguments, value), jets, strict=True):
        own = tuple([times(factor, slope) for slope in jet[1]])
        if own:
            slopes = tuple(map(added, slopes, own)) if slopes else own
    return value, slopes


def least(x: Jet[Real], *others: Jet[Real]) -> Jet[Real]:
    """The minimum; where either may be the smaller one, the slopes of both."""
    for y in others:
        value = (min(x[0][0], y[0][0]), min(x[0][1], y[0][1]))
        if x[0][1] <= y[0][0]:
            slopes = x[1]
        elif y[0][1] <= x[0][0]:
            slopes = y[1]
        else:
            # Clarke's slopes where both may be the least: those of both; a constant has slopes 0
            pairs = zip_longest(x[1], y[1], fillvalue=like(value, 0))
            slopes = tuple(hull(*pair) for pair in pairs)
        x = (value, slopes)
    return x


def greatest(*x: Jet[Real]) -> Jet[Real]:
    """The maximum."""
    return applied(NEGATIVE, least(*(applied(NEGATIVE, each) for each in x)))


def sign(x: Span) -> Span:
    """The slope of |x|."""
    if x[0] >= 0:
        return like(x, 1)
    if x[1] <= 0:
        return like(x, -1)
    return hull(like(x, -1), like(x, 1))


def rest(x: Span) -> Span:
    """1 - x for a number x that is at most 1."""
    lo, hi = added(like(x, 1), negative(x))
    return max(lo, lo * 0), hi


def one_over(x: Span) -> Span:
    """1 / x."""
    return divided(like(x, 1), x)


def one_and_square(x: Span) -> Span:
    """1 + x^2."""
    return added(like(x, 1), power(x, 2))


def of_one(function: Function, slope: Function) -> Operation:
    """An operation with one argument, from its slope."""
    return function, lambda x, f: (slope(x, f),)


sine = partial(wave, quarter=0)
cosine = partial(wave, quarter=1)
sinh = partial(hyperbolic, cosine=False)
cosh = partial(hyperbolic, cosine=True)

# A smooth operation: its value, and its partial derivatives from the arguments and the value f.
NEGATIVE = of_one(negative, lambda x, f: like(x, -1))
# Of two arguments also the degree, from theirs.
OPERATIONS: dict[type, tuple[Operation, Callable[[float, float], float]]] = {
    ast.Add: ((added, lambda x, y, f: (like(x, 1), like(y, 1))), max),
    ast.Sub: (
        (lambda x, y: added(x, negative(y)), lambda x, y, f: (like(x, 1), like(y, -1))),
        max,
    ),
    ast.Mult: ((times, lambda x, y, f: (y, x)), add),
    ast.Div: (
        (divided, lambda x, y, f: (one_over(y), negative(divided(f, y)))),
        lambda a, b: math.inf if b else a,
    ),
}
SMOOTH: dict[str, Operation] = {
    "exp": of_one(partial(by_decimal, "exp"), lambda x, f: f),
    "log": of_one(partial(by_decimal, "ln"), lambda x, f: one_over(x)),
    "sqrt": of_one(partial(by_decimal, "sqrt"), lambda x, f: divided(like(x, 0.5), f)),
    "sin": of_one(sine, lambda x, f: cosine(x)),
    "cos": of_one(cosine, lambda x, f: negative(sine(x))),
    "tan": of_one(tangent, lambda x, f: one_and_square(f)),
    "atan": of_one(arctangent, lambda x, f: one_over(one_and_square(x))),
    "asinh": of_one(inverse_sine, lambda x, f: one_over(cosh(f))),
    "tanh": of_one(hyperbolic_tangent, lambda x, f: rest(power(f, 2))),
    "sinh": of_one(sinh, lambda x, f: cosh(x)),
    "cosh": of_one(cosh, lambda x, f: sinh(x)),
    "abs": of_one(absolute, lambda x, f: sign(x)),
}


FUNCTIONS: dict[str, Function] = {
    "min": least,
    "max": greatest,
    "clip": lambda y, lo, hi: greatest(lo, least(y, hi)),
}
FUNCTIONS |= {name: partial(applied, each) for name, each in SMOOTH.items()}
#: How many arguments a function takes at least and at most, if not one.
ARGUMENTS = {"min": (2, math.inf), "max": (2, math.inf), "clip": (3, 3)}
KINKS = ("abs", *ARGUMENTS)


# --- Expressions
class Step(NamedTuple):
    """An operation on the jets with these numbers; a variable or a constant has none, a constant
    has a value."""

    operation: Function | None
    arguments: Places
    degree: float  # as a polynomial; inf if it is none
    varies: bool  # whether a variable occurs in it
    value: Any = None


LONGEST = 2000  # characters of an expression of the problem
LONGEST_MADE = 20 * LONGEST  # and of one that is made of it, f(target + e) - f(target)


class Expression:
    """An expression in the given variables, as it is written."""

    def __init__(self, source: str, names: list[str], longest: int = LONGEST) -> None:
        plain = re.fullmatch(rf"[a-zE0-9.+*/(), -]{{1,{longest}}}", source)
        need(plain is not None, "it is no expression, or it is too long")
        self.source = source.strip()
        self.names = names
        self.kinked = False
        # the first steps are the variables
        self.steps = [Step(None, (), 1, True) for _ in names]
        try:
            tree = ast.parse(self.source, mode="eval")
            self.result = self.read(tree.body)
        except (SyntaxError, MemoryError, RecursionError):
            message = "an expression does not follow the grammar, or is nested too deeply"
            raise Refused(message) from None
        self.degree = self.steps[self.result].degree

    def read(self, node: ast.expr) -> int:
        """The number of the step that gives a part of the expression."""
        match node:
            case ast.Constant():
                # the text, since Python has rounded the value
                number = rational(self.written(node))
                return self.constant((number, number))
            case ast.Name(id="pi"):
                return self.constant(PI)
            case ast.Name(id=name):
                need(
                    name in self.names, "an expression holds a name that the grammar does not know"
                )
                return self.names.index(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.read(operand)
                return self.append(partial(applied, NEGATIVE), (inner,), self.steps[inner].degree)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return self.read_power(left, self.written(right))
            case ast.BinOp():
                return self.read_chain(node)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self.read_call(name, tuple(map(self.read, arguments)))
        raise Refused("an expression holds something that the grammar does not know")

    def written(self, node: ast.expr) -> str:
        """A part as it is written."""
        return self.source[node.col_offset : node.end_col_offset]

    def read_power(self, base: ast.expr, exponent: str) -> int:
        """An expression to an integer power."""
        short = bool(re.fullmatch(r"-?[0-9]{1,2}", exponent)) and abs(int(exponent)) <= 64
        need(short, "an exponent is no integer up to 64")
        n = int(exponent)
        place = self.read(base)
        degree = self.steps[place].degree
        polynomial = degree < math.inf and (n >= 0 or degree == 0)
        # n x^(n-1), and 0 x^0 for n = 0, so that 1/x is not asked at 0
        lower = n - 1 if n else 0
        raised = of_one(lambda x: power(x, n), lambda x, f: times(like(x, n), power(x, lower)))
        operation = partial(applied, raised)
        return self.append(operation, (place,), degree * n if polynomial else math.inf)

    def read_chain(self, node: ast.BinOp) -> int:
        """Sums and products: a long one leans to the left, deeper than Python follows calls."""
        # without recursion along the left side: y + y + ... may be long
        chain = [node]
        first = node.left
        while isinstance(first, ast.BinOp) and not isinstance(first.op, ast.Pow):
            chain.append(first)
            first = first.left

        place = self.read(first)
        for part in reversed(chain):
            kind = type(part.op)
            need(
                kind in OPERATIONS,
                "an expression holds an operation that the grammar does not know",
            )
            right = self.read(part.right)
            operation, degree_of = OPERATIONS[kind]
            degree = degree_of(self.steps[place].degree, self.steps[right].degree)
            place = self.append(partial(applied, operation), (place, right), degree)
        return place

    def read_call(self, name: str, arguments: Places) -> int:
        """A function; it has a kink if it is applied to something in which a variable occurs."""
        # a name that is not in this table is refused, whatever Python knows by it
        need(name in FUNCTIONS, "an expression holds a function that the grammar does not know")
        fewest, most = ARGUMENTS.get(name, (1, 1))
        need(fewest <= len(arguments) <= most, "a function has the wrong number of arguments")
        if name in KINKS and self.vary(arguments):
            self.kinked = True
        # degrees are those of the text: 0*y has 1, and a function of it is no polynomial
        of_constants = not any(self.steps[k].degree for k in arguments)
        return self.append(FUNCTIONS[name], arguments, 0 if of_constants else math.inf)

    def vary(self, arguments: Places) -> bool:
        """Whether a variable occurs in the arguments."""
        return any(self.steps[k].varies for k in arguments)

    def constant(self, value: Exact) -> int:
        """A new step that is a number."""
        self.steps.append(Step(None, (), 0, False, value))
        return len(self.steps) - 1

    def append(self, operation: Any, arguments: Places, degree: float) -> int:
        """A new step; one that depends on constants only is done at once."""
        varies = self.vary(arguments)
        value = None
        if not varies:
            value, _ = operation(*((self.steps[k].value, ()) for k in arguments))
            operation = None
        self.steps.append(Step(operation, arguments, degree, varies, value))
        return len(self.steps) - 1

    @cached_property
    def rounded(self) -> list[Step]:
        """The steps with constants between floating-point numbers."""
        steps = []
        for step in self.steps:
            if step.value:
                step = step._replace(value=hull(*map(enclosed, step.value)))  # noqa: PLW2901
            steps.append(step)
        return steps

    def run(self, steps: list[Step], given: Sequence[Jet[Real]]) -> Jet[Real]:
        """Value and slopes, from those of the variables, by the steps in the arithmetic of the
        variables."""
        jets: list[Jet[Real]] = list(given)
        for operation, arguments, _, _, value in steps[len(given) :]:
            if operation:
                jets.append(operation(*[jets[k] for k in arguments]))
            else:
                jets.append((value, ()))
        return jets[self.result]

    def at(self, *given: Jet[Any]) -> Jet[Any]:
        """Value and slopes, exactly on rationals, with rounded constants on intervals of
        floating-point numbers."""
        floating = isinstance(given[0][0][0], float)
        return self.run(self.rounded if floating else self.steps, given)


# --- Couplings
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
        return self.slopes.get((c, d), ZERO)


@lru_cache(maxsize=1000)
def read_coupling(h: tuple[str, ...], m: int, longest: int = LONGEST) -> Coupling:
    """The coupling of these expressions between agents with m components."""
    single = len(h) == 1
    names = ["y"] if single else [f"y{d + 1}" for d in range(m)]
    parts = [Expression(each, names, longest) for each in h]
    at_zero = [(ZERO, ())] * len(names)
    vanishes = all(part.run(part.steps, at_zero)[0] == ZERO for part in parts)
    need(vanishes, "a coupling is not shown to vanish at 0")

    kinked = any(part.kinked for part in parts)
    straight = not kinked and all(part.degree <= 1 for part in parts)
    slopes: dict[tuple[int, int], Exact] = {}
    for c, part in enumerate(parts):
        if kinked:  # there are no slopes to ask for
            break
        _, row = part.run(part.steps, variables([ZERO] * len(names)))
        for d, slope in enumerate(row):
            if slope != ZERO:
                slopes[c, d] = slope
    if single and slopes:
        slopes = dict.fromkeys(((c, c) for c in range(m)), slopes[0, 0])
    return Coupling(h, parts, kinked, straight, slopes)
