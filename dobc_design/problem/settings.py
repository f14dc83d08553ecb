"""Settings of simulations.  They never enter a proof."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import counted, is_list, read_vector, shown
from dobc_design.problem.switching import positive_number

Rows = tuple[Vector, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """Simulation settings: horizon in s, seed, and starts of the exosystem and of the states, where they are given.

    ``xi0`` (q numbers) and ``x0`` (m numbers): one row for all agents, or n rows.
    """

    t_final: Fraction
    seed: int
    xi0: Rows | None
    x0: Rows | None = None

    @property
    def horizon(self) -> float:
        """``t_final`` as a float, in s."""
        return float(self.t_final)


def read_simulation(
    t_final: Any, seed: Any, xi0: Any, x0: Any = None, *, n: int, orders: tuple[int, ...], m: int = 1
) -> Simulation:
    """Read the [simulation] table.  Defaults: 20 s, seed 0, xi0 = None (ones are then used), x0 = None (drawn).

    ``orders``: that of the exosystem, or n of them where agents have different ones.
    """
    time = Fraction(20) if t_final is None else positive_number(t_final, key="simulation.t_final", unit="s")
    if seed is None:
        seed = 0
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise SpecError(
            f"simulation.seed must be a whole number from 0 to 2^63 - 1; got {shown(seed)}.",
            key="simulation.seed",
            cure="For example seed = 0.",
        )
    return Simulation(
        t_final=time,
        seed=seed,
        xi0=None if xi0 is None else _read_xi0(xi0, n=n, orders=orders),
        x0=None if x0 is None else _read_x0(x0, n=n, m=m),
    )


def _read_xi0(value: Any, *, n: int, orders: tuple[int, ...]) -> Rows:
    key, q = "simulation.xi0", orders[0]
    if len(orders) > 1:
        return _rows_of_orders(value, key=key, orders=orders)
    if q == 0:
        raise SpecError(f"{key} has no meaning without an [exosystem].", key=key, cure="Remove it.")
    return _rows(value, key=key, n=n, width=q, because="one per exosystem state")


def _read_x0(value: Any, *, n: int, m: int) -> Rows:
    """With one state component n plain numbers are one for each agent."""
    key = "simulation.x0"
    if m == 1 and is_list(value) and len(value) > 1 and not any(is_list(row) for row in value):
        if len(value) != n:
            raise ShapeError(
                f"{key} must have {counted(n, 'number')}, one per agent, or 1 for all; got {len(value)}.",
                key=key,
                cure="Give one number per agent.",
            )
        return tuple((parse_number(number, key=f"{key}[{i}]"),) for i, number in enumerate(value))
    return _rows(value, key=key, n=n, width=m, because="one per state component")


def _rows(value: Any, *, key: str, n: int, width: int, because: str) -> Rows:
    """One list of ``width`` numbers for all agents, or a list for each."""
    if is_list(value) and len(value) > 0 and all(is_list(row) for row in value):
        if len(value) not in (1, n):
            raise ShapeError(
                f"{key} must have {counted(n, 'row')}, one per agent, or be one list of {counted(width, 'number')};"
                f" got {counted(len(value), 'row')}.",
                key=key,
                cure="Give one row for all agents, or one each.",
            )
        return tuple(read_vector(row, key=f"{key}[{i}]", length=width, because=because) for i, row in enumerate(value))
    if not is_list(value):
        raise ShapeError(
            f"{key} must be a list of {counted(width, 'number')}; got {shown(value)}.",
            key=key,
            cure=f"Write {[1] + [0] * (width - 1)}." if width <= 6 else "Write [1, 0, ...].",
        )
    return (read_vector(value, key=key, length=width, because=because),)


def _rows_of_orders(value: Any, *, key: str, orders: tuple[int, ...]) -> Rows:
    """One row per agent, as long as the order of its own exosystem."""
    if not is_list(value) or len(value) != len(orders) or not all(is_list(row) for row in value):
        raise ShapeError(
            f"{key} must have {counted(len(orders), 'row')}, one per agent, because the groups of exosystem.groups"
            f" differ in order; got {shown(value)}.",
            key=key,
            cure="Give every agent a row with one number per state of its own exosystem.",
        )
    because = "one per state of this agent's exosystem"
    return tuple(
        read_vector(row, key=f"{key}[{i}]", length=order, because=because)
        for i, (row, order) in enumerate(zip(value, orders, strict=True))
    )
