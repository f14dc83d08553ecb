"""The coupling h of an arc: what agent i feels of x_j - x_i (eq. 1).

h(0) = 0 is shown in exact arithmetic; slopes at 0 are exact where they are rational, else enclosed
outwards.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass
from fractions import Fraction
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dobc_design._show.cards import Card, Formula, Shown, cut
from dobc_design.coupling import expression as language
from dobc_design.coupling import tree
from dobc_design.coupling.expression import LONGEST, Expression, parse_expression
from dobc_design.coupling.functions import NONSMOOTH
from dobc_design.coupling.parser import excerpt
from dobc_design.errors import ExpressionError, ShapeError, SpecError, kept, raise_all, wrong
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import NumberText, counted, is_list, shown

T = TypeVar("T")
NEARZERO = Interval(Fraction(-1, 2**40), Fraction(1, 2**40))
_LONGEST_SUGGESTION = 100
_LONGEST_NUMBER = 40


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
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
        count = 1 if self.by_component else self.dimension
        dimensions = [expression.dimension for expression in self.components]
        alike = dimensions == [count] * (1 if self.by_component else len(dimensions)) and dimensions
        if not alike or (self.dimension == 1 and not self.by_component):
            what = (
                f"must be one expression in y, or {self.dimension} in"
                f" {tree.names_in_words(self.dimension)}; got expressions in {dimensions} "
                "variables."
            )
            raise wrong(key, what, kind=ShapeError)
        errors: list[SpecError] = []
        for position, expression in enumerate(self.components):
            with kept(errors):
                _check_at_zero(expression, key=key if self.by_component else f"{key}[{position}]")
        raise_all(errors)

    @property
    def outputs(self) -> int:
        """How many components h(y) has."""
        return self.dimension if self.by_component else len(self.components)

    @property
    def texts(self) -> tuple[str, ...]:
        """The components as canonical text."""
        return tuple(str(expression) for expression in self.components)

    @property
    def latex(self) -> tuple[str, ...]:
        """The components as LaTeX mathematics."""
        return tuple(expression.latex for expression in self.components)

    @property
    def is_linear(self) -> bool:
        """Whether h is linear as written, which proves that it is; y**2 - y**2 + y is not
        recognised."""
        degrees = [language.polynomial_degree(expression.node) for expression in self.components]
        return all(degree is not None and degree <= 1 for degree in degrees)

    @property
    def nonsmooth(self) -> tuple[str, ...]:
        """Which of abs, min, max, clip, Lipschitz but not C1, are applied to what is not constant;
        empty if h is C1 wherever it is defined (theory, section 1)."""
        parts = (part for expression in self.components for part in tree.postorder(expression.node))
        found = {
            part.own for part in parts if part.kind == "call" and language.variables_used(part)
        }
        return tuple(name for name in NONSMOOTH if name in found)

    def _card(self) -> Card:
        names = ["h"] if self.by_component else [f"h_{{{k + 1}}}" for k in range(self.outputs)]
        shown = [
            ("coupling", Formula(f"{h}(y) = {text}"))
            for h, text in zip(names, self.latex, strict=True)
        ]
        every = (
            f"applied to each of {self.dimension} components"
            if self.by_component and self.dimension > 1
            else ""
        )
        return Card(title="Coupling", text=every, facts=shown)

    def __repr__(self) -> str:
        return f"<Coupling {cut('; '.join(self.texts))}>"

    def evaluated(self, y: Sequence[T], algebra: tree.Algebra[T]) -> list[T]:
        """Return the m components of h for differences y, one value of the algebra for each of m
        components."""
        return language.evaluated(self.components, y, algebra)

    def jacobian_at_zero(self) -> tuple[tuple[Interval, ...], ...]:
        """Enclose dh/dy at y = 0; exact (points) where the entries are known to be rational.
        Shapes: (m, m), diagonal if h acts by component.  At a kink: the hull of the slopes."""
        rows = [_gradient(expression, at=tree.ZERO) for expression in self.components]
        if not self.by_component:
            return tuple(rows)
        m = range(self.dimension)
        return tuple(tuple(rows[0][0] if i == j else tree.ZERO for j in m) for i in m)

    def numpy_function(self) -> Callable[[ArrayLike], NDArray[np.float64]]:
        """Return h as a function of arrays, (..., m) to (..., m); overflow gives inf, undefined
        places give nan."""
        functions = [language.numpy_function(expression) for expression in self.components]
        dimension, by_component = self.dimension, self.by_component

        def function(y: ArrayLike) -> NDArray[np.float64]:
            array = np.asarray(y, dtype=np.float64)
            if array.ndim == 0 or array.shape[-1] != dimension:
                raise ShapeError(
                    f"the last axis of y must have length {dimension}; got shape {array.shape}."
                )
            if by_component:
                return functions[0](array)
            return np.stack([component(array) for component in functions], axis=-1)

        return function

    def value(self, y: ArrayLike) -> NDArray[np.float64]:
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
    h, count = _text(h), dimension if outputs is None else outputs
    h = [h] if count == 1 < dimension and not is_list(h) else h
    if isinstance(h, str) and not isinstance(h, NumberText):
        if count != dimension:
            what = (
                f"must be a list of {counted(count, 'expression')}, one per input; got {shown(h)}."
            )
            raise wrong(
                key, what, f"Give a list in {tree.names_in_words(dimension)}.", kind=ShapeError
            )
        _refuse_numbered_names(h, dimension=dimension, key=key)
        return Coupling(
            components=(parsed(h, key=key),), by_component=True, dimension=dimension, key=key
        )
    if not is_list(h):
        what = f"must be an expression in y, in quotes, or a list of them; got {shown(h)}."
        raise wrong(key, what, 'Write for example "tanh(y)".', kind=ExpressionError)
    if len(h) != count:
        each = "state component" if count == dimension else "input"
        what = f"must have {counted(count, 'expression')}, one per {each}; got {len(h)}."
        more = f"Give a list in {tree.names_in_words(dimension)}."
        cure = (
            "Or give one expression in y, which is applied to each component."
            if count == dimension
            else more
        )
        raise wrong(key, what, cure, kind=ShapeError)
    read: list[Expression] = []
    errors: list[SpecError] = []
    for position, text in enumerate(h):
        with kept(errors):
            read.append(parsed(_text(text), dimension=dimension, key=f"{key}[{position}]"))
    raise_all(errors)
    own = count == dimension and all(
        set(language.variables_used(x.node)) <= {c} for c, x in enumerate(read)
    )
    functions = {re.sub(r"\by[0-9]+\b", "y", str(each)) for each in read}
    alike = own and len(functions) == 1  # one function of its own component each
    read = [parsed(functions.pop(), key=key)] if alike else read
    return Coupling(components=tuple(read), by_component=alike, dimension=dimension, key=key)


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
        raise ExpressionError(
            f'{key} {excerpt(text, found.start())}: found "{found.group()[:20]}" in column'
            f" {found.start() + 1}; a single expression is applied to each component and uses y.",
            key=key,
            cure=f"For couplings between components give a list of {dimension} expressions in"
            f" {tree.names_in_words(dimension)}.",
        )


def _check_at_zero(expression: Expression, *, key: str) -> None:
    quoted = f"{key} {excerpt(expression.text)}"
    try:
        value = tree.evaluate(
            expression.node, (tree.ZERO,) * expression.dimension, tree.IntervalAlgebra()
        )
    except UndefinedError as error:
        raise ExpressionError(
            f"{quoted} must vanish at y = 0 but is undefined there: {error}", key=key
        ) from error
    if value != tree.ZERO:
        raise _not_zero(expression, value, key=key)
    try:
        _gradient(expression, at=NEARZERO)
    except UndefinedError as error:
        what = (
            f"{quoted} must be defined and have a bounded slope around y = 0 (seen on |y| <= "
            f"2^-40): {error}"
        )
        raise ExpressionError(what, key=key) from error


def _not_zero(expression: Expression, value: Interval, *, key: str) -> ExpressionError:
    quoted = f"{key} {excerpt(expression.text)}"
    if value.contains(0):
        return ExpressionError(
            f"{quoted} cannot be shown to vanish at y = 0 (all that is known is {value}); "
            "rewrite it.",
            key=key,
            cure="For example exp(1)*(exp(y) - 1) instead of exp(y + 1) - exp(1).",
        )
    exact = number_text(value.lo)
    if not value.is_point or len(exact) > _LONGEST_NUMBER:
        return ExpressionError(
            f"{quoted} must vanish at y = 0 but is about {value.floats()[0]:.3g}.", key=key
        )
    if not language.variables_used(expression.node):
        what = f"{quoted} must vanish at y = 0 but is the constant {exact}."
        return ExpressionError(what, key=key, cure='Write for example "tanh(y)".')
    better = language.to_text(_lowered(expression.node, value.lo), dimension=expression.dimension)
    cure = f'did you mean "{better}"?' if len(better) <= _LONGEST_SUGGESTION else None
    return ExpressionError(f"{quoted} must vanish at y = 0 but equals {exact}", key=key, cure=cure)


def _lowered(node: tree.Node, value: Fraction) -> tree.Node:
    """Return the tree of node - value; where the value is the last term itself, without that
    term."""
    if node.kind in ("add", "subtract") and not language.variables_used(node.operands[1]):
        last = tree.evaluate(node.operands[1], (), tree.IntervalAlgebra())
        if (last if node.kind == "add" else -last) == Interval.point(value):
            return node.operands[0]
    return tree.Node(
        "subtract" if value > 0 else "add", (node, tree.Node("constant", own=abs(value)))
    )


@lru_cache(maxsize=256)
def _gradient(expression: Expression, *, at: Interval) -> tuple[Interval, ...]:
    """Enclose the partial derivatives where every variable lies in ``at``."""
    algebra = tree.GradientAlgebra(expression.dimension)
    variables = algebra.variables((at,) * expression.dimension)
    return tree.evaluate(expression.node, variables, algebra).partials
