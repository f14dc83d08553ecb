"""Coupling functions compiled for many calls on arrays.

The same tree as everywhere (``coupling.tree``), turned once into a list of NumPy calls: constants are converted
beforehand and small powers are products, which is what a right-hand side that is called a million times needs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dobc_design.coupling.algebra import NumpyAlgebra
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
    Pi,
    Power,
    Subtract,
    Variable,
    postorder,
)

Array = NDArray[np.float64]
LARGEST_PRODUCT = 8  # exponents up to which a power is computed by multiplication

_BINARY: dict[type[Node], Callable[..., Any]] = {
    Add: np.add,
    Subtract: np.subtract,
    Multiply: np.multiply,
    Divide: np.divide,
}
_VARIABLE, _CONSTANT = -1, 0  # in place of a number of operands


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
