"""Settings of simulations, which enter no proof: horizon, seed, and where states and disturbances
start."""

from fractions import Fraction
from typing import Any

from dobc_design._checks import later, noun
from dobc_design.errors import Mistakes, misshapen, wrong
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import (
    counted,
    is_list,
    keyed,
    positive_number,
    read_vector,
    shown,
    whole_number,
)

Rows = tuple[Vector, ...]


@noun
class Simulation:
    """Simulation settings: horizon in s, seed, and starts of the exosystem and of the states, where
    they are given. ``xi0`` (q numbers) and ``x0`` (m numbers): one row for all agents, or n
    rows."""

    t_final: Fraction
    seed: int
    xi0: Rows | None
    x0: Rows | None = later()


def read_simulation(value: Any, *, n: int, orders: tuple[int, ...], m: int) -> Simulation:
    """Read the [simulation] table; ``orders``: that of the exosystem, or n of them where agents
    have different ones."""
    table = {} if value is None else value
    t_final, seed, xi0, x0 = keyed(table, ("t_final", "seed", "xi0", "x0"), key="simulation")
    errors = Mistakes()
    time, start = Fraction(20), 0
    disturbances = states = None
    if t_final is not None:
        with errors:
            time = positive_number(t_final, "simulation.t_final", "s")
    if seed is not None:
        cure = "For example seed = 0."
        with errors:
            start = whole_number(seed, "simulation.seed", least=0, most=2**63 - 1, cure=cure)
    if xi0 is not None:
        with errors:
            disturbances = _read_xi0(xi0, n=n, orders=orders)
    if x0 is not None:
        with errors:
            states = _read_x0(x0, n=n, m=m)
    errors.raise_all()
    return Simulation(t_final=time, seed=start, xi0=disturbances, x0=states)


def _read_xi0(value: Any, *, n: int, orders: tuple[int, ...]) -> Rows:
    """Where the exosystems start: one row for all agents, or one for each."""
    key = "simulation.xi0"
    if len(orders) > 1:
        return _read_different_xi0(value, key, orders)
    q = orders[0]
    if q == 0:
        raise wrong(key, "has no meaning without an [exosystem].", "Remove it.")
    return _rows(value, key=key, n=n, width=q, because="one per exosystem state")


def _read_different_xi0(value: Any, key: str, orders: tuple[int, ...]) -> Rows:
    """Starts of exosystems that differ in order, 0 for agents without a disturbance."""
    # Rows may have different lengths here, so that a plain list is not one row each.
    lists = [is_list(row) for row in value] if is_list(value) else []
    alike = set(orders) - {0}
    if len(alike) == 1 and lists and not any(lists):
        (width,) = alike  # one row for all agents that have a disturbance
        row = read_vector(value, key, length=width, because="one per exosystem state")
        return tuple(row if order else () for order in orders)
    # one row per agent, as long as the order of its own exosystem
    if len(lists) != len(orders) or not all(lists):
        raise misshapen(
            key,
            f"must have {counted(len(orders), 'row')}, one per agent, because the groups of "
            f"exosystem.groups differ in order; got {shown(value)}.",
            "Give every agent a row with one number per state of its own exosystem.",
        )
    because = "one per state of this agent's exosystem"
    rows = []
    for i, (row, q) in enumerate(zip(value, orders, strict=True)):
        rows.append(read_vector(row, f"{key}[{i}]", length=q, because=because))
    return tuple(rows)


def _read_x0(value: Any, *, n: int, m: int) -> Rows:
    """With one state component n plain numbers are one for each agent."""
    key = "simulation.x0"
    if m == 1 and is_list(value) and len(value) > 1 and not any(is_list(row) for row in value):
        if len(value) != n:
            numbers = counted(n, "number")
            raise misshapen(
                key,
                f"must have {numbers}, one per agent, or 1 for all; got {len(value)}.",
                "Give one number per agent.",
            )
        return tuple((parse_number(number, f"{key}[{i}]"),) for i, number in enumerate(value))
    return _rows(value, key=key, n=n, width=m, because="one per state component")


def _rows(value: Any, *, key: str, n: int, width: int, because: str) -> Rows:
    """One list of ``width`` numbers for all agents, or a list for each."""
    if not is_list(value):
        cure = f"Write {[1] + [0] * (width - 1)}." if width <= 6 else "Write [1, 0, ...]."
        raise misshapen(
            key,
            f"must be a list of {counted(width, 'number')}; got {shown(value)}.",
            cure,
        )
    if len(value) == 0 or not all(is_list(row) for row in value):
        return (read_vector(value, key, length=width, because=because),)
    if len(value) not in (1, n):
        raise misshapen(
            key,
            f"must have {counted(n, 'row')}, one per agent, or be one list of "
            f"{counted(width, 'number')}; got {counted(len(value), 'row')}.",
            "Give one row for all agents, or one each.",
        )
    rows = []
    for i, row in enumerate(value):
        rows.append(read_vector(row, f"{key}[{i}]", length=width, because=because))
    return tuple(rows)
