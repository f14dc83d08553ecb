"""The coupling h of an arc: what agent i feels of x_j - x_i (eq. 1).

h(0) = 0 is shown in exact arithmetic; slopes at 0 are exact where they are rational, else enclosed
outwards.
"""

import re
from collections.abc import Sequence
from dataclasses import InitVar
from fractions import Fraction
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Formula, Shown, cut
from dobc_design.errors import ExpressionError, Mistakes, misshapen, misstated
from dobc_design.exact.interval import Box, Interval, IntervalMatrix, UndefinedError
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import NumberText, Texts, counted, is_list, shown

from .expression import (
    LONGEST,
    ArrayFunction,
    Expression,
    evaluated,
    numpy_function,
    parse_expression,
    polynomial_degree,
    require_last_axis,
    to_text,
    variables_used,
)
from .functions import NONSMOOTH
from .parser import excerpt
from .tree import (
    ZERO,
    Algebra,
    GradientAlgebra,
    IntervalAlgebra,
    Node,
    evaluate,
    names_in_words,
    postorder,
)

T = TypeVar("T")
# Where h has to have a bounded slope: Lipschitz continuity around 0 cannot be seen at 0 alone.
NEARZERO = Interval(Fraction(-1, 2**40), Fraction(1, 2**40))
_LONGEST_SUGGESTION = 100
_LONGEST_NUMBER = 40


@noun
class Coupling(Shown):
    """A coupling of m-dimensional states, h(0) = 0.

    ``components`` is one expression in y, applied to each of the m components (``by_component``),
    or one expression in y1..ym for each input: m of them, but for agents with dynamics.  For m = 1
    both are the same and ``by_component`` is true.
    Raises: ShapeError if the components do not fit, ExpressionError if h is not shown to vanish at
    0 or has no bounded slope around it; ``key`` names the coupling in the message.
    """

    components: tuple[Expression, ...]
    by_component: bool
    dimension: int
    key: InitVar[str] = "coupling.h"

    def __post_init__(self, key: str) -> None:
        dimensions = [expression.dimension for expression in self.components]
        if self.by_component:
            fits = dimensions == [1]
        else:
            fits = set(dimensions) == {self.dimension} and self.dimension > 1
        if not fits:
            raise misshapen(
                key,
                f"must be one expression in y, or {self.dimension} in"
                f" {names_in_words(self.dimension)}; got expressions in {dimensions} "
                "variables.",
            )
        errors = Mistakes()
        for position, expression in enumerate(self.components):
            own_key = key if self.by_component else f"{key}[{position}]"
            with errors:
                _check_at_zero(expression, own_key)
        errors.raise_all()

    @property
    def outputs(self) -> int:
        """How many components h(y) has."""
        return self.dimension if self.by_component else len(self.components)

    @property
    def texts(self) -> Texts:
        """The components as canonical text."""
        return tuple(str(expression) for expression in self.components)

    @property
    def latex(self) -> Texts:
        """The components as LaTeX mathematics."""
        return tuple(expression.latex for expression in self.components)

    @property
    def is_linear(self) -> bool:
        """Whether h is linear as written, which proves that it is; y**2 - y**2 + y is not
        recognised."""
        degrees = [polynomial_degree(expression.node) for expression in self.components]
        return all(degree is not None and degree <= 1 for degree in degrees)

    @property
    def nonsmooth(self) -> Texts:
        """Which of abs, min, max, clip, Lipschitz but not C1, are applied to what is not constant;
        empty if h is C1 wherever it is defined (theory, section 1)."""
        found = set()
        for expression in self.components:
            for part in postorder(expression.node):
                if part.kind == "call" and variables_used(part):
                    found.add(part.own)
        return tuple(name for name in NONSMOOTH if name in found)

    def _card(self) -> Card:
        facts = []
        for place, text in enumerate(self.latex, start=1):
            name = "h" if self.by_component else f"h_{{{place}}}"
            facts.append(("coupling", Formula(f"{name}(y) = {text}")))
        note = ""
        if self.by_component and self.dimension > 1:
            note = f"applied to each of {self.dimension} components"
        return Card(title="Coupling", text=note, facts=facts)

    def __repr__(self) -> str:
        return f"<Coupling {cut('; '.join(self.texts))}>"

    def evaluated(self, y: Sequence[T], algebra: Algebra[T]) -> list[T]:
        """Return the m components of h for differences y, one value of the algebra for each of m
        components."""
        return evaluated(self.components, y, algebra)

    def jacobian_at_zero(self) -> IntervalMatrix:
        """Enclose dh/dy at y = 0; exact (points) where the entries are known to be rational.
        Shapes: (m, m), diagonal if h acts by component.  At a kink: the hull of the slopes."""
        rows = [_gradient(expression, at=ZERO) for expression in self.components]
        if not self.by_component:
            return tuple(rows)
        slope = rows[0][0]
        places = range(self.dimension)  # component by component: a diagonal matrix
        return tuple(tuple(slope if i == j else ZERO for j in places) for i in places)

    def numpy_function(self) -> ArrayFunction:
        """Return h as a function of arrays, (..., m) to (..., m); overflow gives inf, undefined
        places give nan."""
        functions = [numpy_function(expression) for expression in self.components]
        dimension = self.dimension
        by_component = self.by_component

        def function(y: ArrayLike) -> Array:
            array = np.asarray(y, dtype=np.float64)
            require_last_axis(array, dimension)
            if by_component:
                return functions[0](array)
            return np.stack([component(array) for component in functions], axis=-1)

        return function

    def value(self, y: ArrayLike) -> Array:
        """Return h(y) for differences y of shape (..., m)."""
        return self.numpy_function()(y)


def make_coupling(
    h: Any,
    *,
    dimension: int,
    outputs: int | None = None,
    key: str = "coupling.h",
    longest: int = LONGEST,
) -> Coupling:
    """Read a coupling: one text in y, applied by component, or a text in y1..ym for each of
    ``outputs`` (m of them); if these are one function, each of its own component, they are the same
    as the one text; one text alone may stand without a list.  A SymPy expression stands for its
    text.  ``longest``: characters of each."""
    parsed = partial(parse_expression, longest=longest)
    count = dimension if outputs is None else outputs
    given = _text(h)
    if count == 1 < dimension and not is_list(given):
        given = [given]  # one input needs no list, and reads all components
    if isinstance(given, str) and not isinstance(given, NumberText):  # a number is no text
        if count != dimension:
            expressions = counted(count, "expression")
            raise misshapen(
                key,
                f"must be a list of {expressions}, one per input; got {shown(given)}.",
                f"Give a list in {names_in_words(dimension)}.",
            )
        _refuse_numbered_names(given, dimension=dimension, key=key)
        alone = parsed(given, key=key)
        return Coupling(components=(alone,), by_component=True, dimension=dimension, key=key)
    _check_list(given, count, dimension=dimension, key=key)
    read = []
    errors = Mistakes()  # of all components at once
    for position, text in enumerate(given):
        with errors:
            read.append(parsed(_text(text), dimension=dimension, key=f"{key}[{position}]"))
    errors.raise_all()
    # Written by components, or once for all: the same problem, with the same hash.
    common = _common_text(read) if count == dimension else None
    if common is not None:
        read = [parsed(common, key=key)]
    return Coupling(
        components=tuple(read), by_component=common is not None, dimension=dimension, key=key
    )


def _check_list(given: Any, count: int, *, dimension: int, key: str) -> None:
    """Raises: ExpressionError unless it is a list; ShapeError unless it has ``count`` entries."""
    if not is_list(given):
        raise misstated(
            key,
            f"must be an expression in y, in quotes, or a list of them; got {shown(given)}.",
            'Write for example "tanh(y)".',
        )
    if len(given) == count:
        return
    each = "input"
    cure = f"Give a list in {names_in_words(dimension)}."
    if count == dimension:
        each = "state component"
        cure = "Or give one expression in y, which is applied to each component."
    raise misshapen(
        key,
        f"must have {counted(count, 'expression')}, one per {each}; got {len(given)}.",
        cure,
    )


def _common_text(read: Sequence[Expression]) -> str | None:
    """The one function that every component applies to its own variable, as a text in y; None if
    there is none."""
    texts = set()
    for component, expression in enumerate(read):
        if not set(variables_used(expression.node)) <= {component}:
            return None
        texts.add(re.sub(r"\by[0-9]+\b", "y", str(expression)))
    return texts.pop() if len(texts) == 1 else None


def _text(h: Any) -> Any:
    """The text of a SymPy expression, whose Abs, Max and Min are ours in lower case and E is
    exp(1); anything else as it is."""
    if isinstance(h, str) or not hasattr(h, "free_symbols"):
        return h
    text = re.sub(r"\b(Abs|Max|Min)\b", lambda found: found[0].lower(), str(h))
    return re.sub(r"\bE\b", "exp(1)", text)


def _refuse_numbered_names(text: str, *, dimension: int, key: str) -> None:
    found = re.search(r"\by[0-9]+\b", text) if dimension > 1 else None
    if found is not None:
        raise misstated(
            key,
            f'{excerpt(text, found.start())}: found "{found.group()[:20]}" in column'
            f" {found.start() + 1}; a single expression is applied to each component and uses y.",
            f"For couplings between components give a list of {dimension} expressions in"
            f" {names_in_words(dimension)}.",
        )


def _check_at_zero(expression: Expression, key: str) -> None:
    quoted = excerpt(expression.text)
    origin = (ZERO,) * expression.dimension
    try:
        value = evaluate(expression.node, origin, IntervalAlgebra())
    except UndefinedError as error:
        what = f"{quoted} must vanish at y = 0 but is undefined there: {error}"
        raise misstated(key, what) from error
    if value != ZERO:
        raise _not_zero(expression, value, key=key)
    try:
        _gradient(expression, at=NEARZERO)
    except UndefinedError as error:
        raise misstated(
            key,
            f"{quoted} must be defined and have a bounded slope around y = 0 (seen on |y| <= "
            f"2^-40): {error}",
        ) from error


def _not_zero(expression: Expression, value: Interval, *, key: str) -> ExpressionError:
    quoted = excerpt(expression.text)
    if value.contains(0):  # irrational constants may cancel, but rounding hides it
        return misstated(
            key,
            f"{quoted} cannot be shown to vanish at y = 0 (all that is known is {value}); "
            "rewrite it.",
            "For example exp(1)*(exp(y) - 1) instead of exp(y + 1) - exp(1).",
        )
    exact = number_text(value.lo)
    if not value.is_point or len(exact) > _LONGEST_NUMBER:
        return misstated(
            key,
            f"{quoted} must vanish at y = 0 but is about {value.floats()[0]:.3g}.",
            "Agents that agree must feel nothing. A distance that they are to keep is stated "
            "by [formation] offsets, a goal by target.",
        )
    if not variables_used(expression.node):
        return misstated(
            key,
            f"{quoted} must vanish at y = 0 but is the constant {exact}.",
            'Write for example "tanh(y)".',
        )
    # h - h(0) vanishes: that is the guess behind "did you mean".
    better = to_text(_lowered(expression.node, value.lo), dimension=expression.dimension)
    cure = f'did you mean "{better}"?' if len(better) <= _LONGEST_SUGGESTION else None
    return misstated(key, f"{quoted} must vanish at y = 0 but equals {exact}", cure)


def _lowered(node: Node, value: Fraction) -> Node:
    """Return the tree of node - value; where the value is the last term itself, without that
    term."""
    if node.kind in ("add", "subtract"):
        rest, last = node.operands
        if not variables_used(last):
            term = evaluate(last, (), IntervalAlgebra())
            if (term if node.kind == "add" else -term) == Interval.point(value):
                return rest
    kind = "subtract" if value > 0 else "add"
    return Node(kind, (node, Node("constant", own=abs(value))))


@lru_cache(maxsize=256)
def _gradient(expression: Expression, *, at: Interval) -> Box:
    """Enclose the partial derivatives where every variable lies in ``at``; remembered, since every
    problem with this coupling asks for them."""
    algebra = GradientAlgebra(expression.dimension)
    variables = algebra.variables((at,) * expression.dimension)
    return evaluate(expression.node, variables, algebra).partials
