"""Agents with dynamics of their own: x_i' = A x_i + B (couplings + u_i + d_i), or f(x_i) in place
of A x_i.

Theory, section 13.  Couplings, inputs and disturbances have p components, the inputs; the paper has
A = 0 and B = I.
"""

import re
from fractions import Fraction
from typing import Any

from dobc_design._checks import later, noun, put, require_square
from dobc_design._show.cards import Shown
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.coupling.expression import LONGEST_MADE, Expression, parse_expression
from dobc_design.coupling.parser import excerpt
from dobc_design.coupling.tree import GradientAlgebra, IntervalAlgebra, evaluate, variable_names
from dobc_design.errors import ExpressionError, Mistakes, SpecError, misshapen, misstated, wrong
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import (
    Matrix,
    Vector,
    dot,
    identity,
    inverse,
    left_inverse,
    multiply,
    nullspace,
    rank,
    subtract,
    transpose,
)
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import Names, Texts, counted, is_list, read_matrix, shown

ACTS_ON = ("states", "outputs")
NEAR = Fraction(1, 2**40)  # of a goal, where slopes of f have to be bounded
_EXAMPLE = 'For example f = ["x2", "-sin(x1)"].'


@noun
class Dynamics(Shown):
    """x_i' = A x_i + B (sum_j h_ij(x_j - x_i) + u_i + d_i) of every agent; f(x_i) may stand in
    place of A x_i.

    Shapes: A (m, m) in 1/s, f m expressions in x1..xm, B (m, p) with full column rank; without B it
    is the identity, p = m.  H (r, m), of full row rank: y_i = H x_i is measured; without H all
    states are.  ``acts_on``: couplings and pins act on estimated states ("states", None stands for
    it) or on the measured outputs ("outputs").
    Raises: ShapeError, SpecError or ExpressionError naming dynamics.A, f, B, H or acts_on.
    Example:
        >>> dd.Dynamics(A=[[0, 1], [0, 0]], B=[[0], [1]]).inputs
        1
    """

    A: Matrix | None = later()
    f: Texts | None = later()
    B: Matrix
    H: Matrix | None = later()
    acts_on: str | None = later()

    def __init__(
        self, *, A: Any = None, f: Any = None, B: Any = None, H: Any = None, acts_on: Any = None
    ) -> None:
        if (A is None) is (f is None):
            raise wrong(
                "dynamics",
                "must have either A or f, and one of them only.",
                'Write A = [[0, 1], [0, 0]], or f = ["x2", "-sin(x1)"].',
            )
        # A is linear and exact; f is kept as text, and its slopes are taken where they are needed.
        drift, texts = None, None
        if f is None:
            drift = read_matrix(A, "dynamics.A")
            require_square(drift, "dynamics.A")
        else:
            texts = _read_nodes(f)
        m = len(drift or texts or ())
        enters = identity(m) if B is None else read_matrix(B, "dynamics.B")
        if len(enters) != m:
            raise misshapen(
                "dynamics.B",
                f"must have {counted(m, 'row')}, one per state component; got {len(enters)}.",
                "Row c says how the inputs act on x_c.",
            )
        # Else two inputs could not be told apart, and B+ would not exist.
        if rank(enters) < len(enters[0]):
            raise wrong(
                "dynamics.B",
                "must have full column rank, so that every input acts in a way of its own.",
                "Remove inputs that act like others, or not at all.",
            )
        put(self, A=drift, f=texts, B=enters)
        put(self, H=_read_outputs(H, m, curved=f is not None), acts_on=_read_acts_on(acts_on, H))

    @property
    def felt(self) -> int:
        """How many components couplings and pins act on: states, or measured outputs."""
        return len(self.seen)

    def on_states(self, K: Matrix) -> Matrix:
        """A gain of what couplings and pins act on, as one of the states: K, or K H."""
        return multiply(K, self.seen) if self.acts_on else K

    @property
    def seen(self) -> Matrix:
        """What couplings and pins act on, of the states: H, or the identity."""
        return self.H if self.H is not None and self.acts_on else identity(self.dimension)

    @property
    def dimension(self) -> int:
        """m, the number of state components."""
        return len(self.A or self.f or ())

    @property
    def inputs(self) -> int:
        """p, the number of inputs."""
        return len(self.B[0])

    @property
    def latex(self) -> Texts:
        """LaTeX of every component of f, in x, or x_1 to x_m."""
        return tuple(re.sub(r"\by\b|\by(?=_)", "x", each.latex) for each in expressions_of(self))

    @property
    def left_inverse(self) -> Matrix:
        """(B'B)^-1 B', (p, m): what the observer watches is this times x."""
        return left_inverse(self.B)

    def drift_at(self, goal: Vector) -> Vector | None:
        """A goal or f(goal), (m,); None where that is not rational."""
        if self.A is not None:
            return tuple(dot(row, goal) for row in self.A)
        found = [_at(each, goal) for each in expressions_of(self)]
        rational = tuple(each for each in found if each is not None)
        return rational if len(rational) == len(found) else None

    def about(self, goal: Vector) -> tuple[Matrix, Coupling | None]:
        """The slopes A at 0 of f(goal + e) - f(goal), and this function of e itself, None where it
        is linear.  Raises: SpecError where f or a slope of it is not rational at the goal."""
        if self.A is not None:
            return self.A, None
        m, values, f = self.dimension, self.drift_at(goal), self.f or ()
        if values is None:
            raise wrong(
                "dynamics.f",
                "must be rational at the target.",
                "Move the target, or what f holds, to 0.",
            )
        # The error e drifts by f(goal + e) - f(goal), written as an expression of e.
        moved = []
        for x, name in zip(goal, variable_names(m), strict=True):
            moved.append(f"({number_text(x)} + {name})" if x else name)
        falls = []
        for text, x in zip(f, values, strict=True):
            falls.append(f"({_renamed(text, moved)}) - ({number_text(x)})")
        try:
            fall = falls[0] if m == 1 else falls
            whole = make_coupling(fall, dimension=m, key="dynamics.f", longest=LONGEST_MADE)
        except ExpressionError:
            _check_slopes(self, goal)  # says it of f as it is written
            raise
        slopes = whole.jacobian_at_zero()
        # Proofs need exact slopes at the goal: a kink, or an irrational slope, has none.
        bad = []
        for text, row in zip(f, slopes, strict=True):
            kinked = any(name in text for name in whole.nonsmooth)
            bad.append(kinked or not all(x.is_point for x in row))
        if whole.nonsmooth or any(bad):
            place = bad.index(True) if any(bad) else 0
            raise wrong(
                f"dynamics.f[{place}]",
                f"{excerpt(f[place])} must be smooth, with rational slopes at the target.",
                "Write it another way.",
            )
        return tuple(tuple(x.lo for x in row) for row in slopes), None if whole.is_linear else whole

    def feedforward(self, goal: Vector) -> Vector | None:
        """The constant input u0 (p,) with A goal + B u0 = 0, f(goal) in place of A goal; None if
        there is none, and the goal is no equilibrium."""
        found = self.drift_at(goal)
        if found is None:
            return None
        # The least squares solution holds the goal if any input does.
        u0 = tuple(-dot(row, found) for row in self.left_inverse)
        held = all(x + dot(row, u0) == 0 for x, row in zip(found, self.B, strict=True))
        return u0 if held else None

    def nearest_goal(self, goal: Vector) -> Vector | None:
        """The goal closest to this one (in the Euclidean norm) that some constant input holds,
        (m,); None for f."""
        if self.A is None:
            return None
        nowhere = (Fraction(0),) * self.dimension
        kept = subtract(identity(self.dimension), multiply(self.B, self.left_inverse))
        # Goals that some input holds: (1 - B B+) A x = 0.
        basis = nullspace(multiply(kept, self.A))
        if not any(map(any, basis)):
            return nowhere
        N = transpose(basis)
        seen = tuple(dot(each, goal) for each in basis)
        parts = tuple(dot(row, seen) for row in inverse(multiply(basis, N)))
        return tuple(dot(row, parts) for row in N)


def _read_outputs(H: Any, m: int, *, curved: bool) -> Matrix | None:
    """What is measured.  Raises: SpecError, ShapeError."""
    if H is None:
        return None
    key = "dynamics.H"
    if curved:
        what = "is known for linear agents only: the observer of all states needs A."
        raise wrong(key, what, "Give A in place of f, or measure all states.")
    read = read_matrix(H, key)
    if len(read[0]) != m:
        what = f"must have {counted(m, 'column')}, one per state component; got {len(read[0])}."
        raise misshapen(key, what, "Row k says how y_k is made of the states.")
    if rank(read) < len(read):
        what = "must have full row rank, so that no output repeats others."
        raise wrong(key, what, "Remove rows that others give.")
    return read


def _read_acts_on(value: Any, H: Any) -> str | None:
    """None for estimated states.  Raises: SpecError."""
    if value is None or value == ACTS_ON[0]:
        return None
    key = "dynamics.acts_on"
    if value != ACTS_ON[1]:
        raise wrong(key, f'must be "states" or "outputs"; got {shown(value)}.', "Choose one.")
    if H is None:
        raise wrong(key, "needs H, which says what the outputs are.", "Give dynamics.H.")
    return ACTS_ON[1]


def expressions_of(dynamics: Dynamics) -> tuple[Expression, ...]:
    """The components of f, with the variables of couplings in place of x1..xm."""
    m = dynamics.dimension
    texts = [_renamed(text, variable_names(m)) for text in dynamics.f or ()]
    return tuple(parse_expression(text, dimension=m) for text in texts)


def _check_slopes(dynamics: Dynamics, goal: Vector) -> None:
    """Refuse an f that is not defined, or has no bounded slope, near a goal.  Raises:
    ExpressionError."""
    # At a single point every kink looks smooth: a neighbourhood shows it.
    near = [Interval(x - NEAR, x + NEAR) for x in goal]
    algebra = GradientAlgebra(dynamics.dimension)
    for place, expression in enumerate(expressions_of(dynamics)):
        try:
            evaluate(expression.node, algebra.variables(near), algebra)
        except UndefinedError as error:
            names = ", ".join(_variables(dynamics.dimension))
            at = _listed(goal)
            if len(goal) > 1:
                names, at = f"({names})", f"({at})"
            raise misstated(
                f"dynamics.f[{place}]",
                f"{excerpt((dynamics.f or ())[place])} must be defined and have a bounded slope "
                f"around the target, {names} = {at} (as far as 2^-40 from it): {error}",
                "Move the target to where f is smooth, or write f in another way.",
            ) from error


def check_goal(dynamics: Dynamics, goal: Vector, *, key: str) -> None:
    """Refuse a goal that no constant input holds.  Raises: SpecError that names the nearest one
    that some does."""
    for place, expression in enumerate(expressions_of(dynamics)):
        try:
            evaluate(expression.node, tuple(map(Interval.point, goal)), IntervalAlgebra())
        except UndefinedError as error:
            text = excerpt((dynamics.f or ())[place])
            raise wrong(
                f"dynamics.f[{place}]",
                f"{text} is not defined at the goal [{_listed(goal)}]: {error}",
                "Move the target to where f is defined.",
            ) from error
    if dynamics.feedforward(goal) is None:
        near = dynamics.nearest_goal(goal)
        drift = "A x"
        cure = f"The nearest one is [{_listed(near or ())}]."
        if near is None:
            drift = "f(x)"
            cure = "Choose one where f(x) is rational and in the range of B."
        raise wrong(
            key,
            f"must be an equilibrium, {drift} + B u0 = 0 for some constant input u0; it is not.",
            cure,
        )


def _read_nodes(f: Any) -> Texts:
    """Expressions in x1..xm (x alone where m = 1) as canonical text; the language is that of
    couplings, in y."""
    if not is_list(f) or not f:
        raise wrong(
            "dynamics.f",
            "must be a list of expressions in text, one per state component.",
            _EXAMPLE,
        )
    found = []
    errors = Mistakes()
    for place, text in enumerate(f):
        with errors:
            found.append(_read_node(text, len(f), key=f"dynamics.f[{place}]"))
    errors.raise_all()
    return tuple(found)


def _read_node(text: Any, m: int, *, key: str) -> str:
    """One component of f as canonical text in x1..xm.  Raises: SpecError, ExpressionError."""
    # The parser of couplings reads y: an x of the file becomes one, so that a y cannot be meant.
    if not isinstance(text, str) or re.search(r"\by[0-9]*\b", text):
        names = "x" if m == 1 else f"x1 to x{m}"
        raise wrong(key, f"must be an expression in {names}; got {shown(text)}.", _EXAMPLE)
    try:
        inside = re.sub(r"\bx([0-9]*)\b", r"y\1", text)
        return _in_x(str(parse_expression(inside, dimension=m, key=key)))
    except SpecError as error:
        cure = error.cure and _in_x(error.cure)
        raise type(error)(_in_x(error.message), key=key, cure=cure) from None


def _in_x(text: str) -> str:
    """The text with x in place of y, the variable of couplings."""
    return re.sub(r"\by([0-9]*)\b", r"x\1", text)


def _variables(m: int) -> list[str]:
    return ["x"] if m == 1 else [f"x{c + 1}" for c in range(m)]


def _renamed(text: str, names: Names) -> str:
    """The text with other names in place of x1..xm (or x)."""
    return re.sub(r"\bx([0-9]*)\b", lambda found: names[int(found[1] or 1) - 1], text)


def _at(expression: Expression, goal: Vector) -> Fraction | None:
    """The value of an expression at a point; None where it is not rational, or undefined."""
    try:
        value = evaluate(expression.node, tuple(map(Interval.point, goal)), IntervalAlgebra())
    except UndefinedError:
        return None
    return value.lo if value.is_point else None


def _listed(goal: Vector) -> str:
    return ", ".join(map(number_text, goal))
