"""Settings of switching signals and of simulations.  They never enter a proof at the consensus."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Vector
from dobc_design.exact.number import parse_number
from dobc_design.spec.reading import counted, is_list, read_vector, shown, shown_number

SIGNALS = ("random", "periodic", "markov", "schedule", "mobile")


@dataclass(frozen=True, slots=True, kw_only=True)
class Switching:
    """Which signal drives the modes, and its dwell time in s (None: not given)."""

    signal: str
    dwell: Fraction | None = None

    def __init__(self, *, signal: Any, dwell: Any = None) -> None:
        if signal not in SIGNALS:
            raise SpecError(
                f"switching.signal must be one of {', '.join(SIGNALS)}; got {shown(signal)}.",
                key="switching.signal", cure='For example signal = "random".',
            )  # fmt: skip
        object.__setattr__(self, "signal", signal)
        object.__setattr__(self, "dwell", None if dwell is None else _positive(dwell, key="switching.dwell", unit="s"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """Simulation settings: horizon in s, seed, and the exosystem's start (one row for all agents, or n rows)."""

    t_final: Fraction
    seed: int
    xi0: tuple[Vector, ...] | None

    @property
    def horizon(self) -> float:
        """``t_final`` as a float, in s."""
        return float(self.t_final)


def read_simulation(t_final: Any, seed: Any, xi0: Any, *, n: int, orders: tuple[int, ...]) -> Simulation:
    """Read the [simulation] table.  Defaults: 20 s, seed 0, xi0 = None (a vector of ones is then used).

    ``orders``: that of the exosystem, or n of them where agents have different ones.
    """
    time = Fraction(20) if t_final is None else _positive(t_final, key="simulation.t_final", unit="s")
    if seed is None:
        seed = 0
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise SpecError(
            f"simulation.seed must be a whole number from 0 to 2^63 - 1; got {shown(seed)}.", key="simulation.seed",
            cure="For example seed = 0.",
        )  # fmt: skip
    return Simulation(t_final=time, seed=seed, xi0=None if xi0 is None else _read_xi0(xi0, n=n, orders=orders))


def _read_xi0(value: Any, *, n: int, orders: tuple[int, ...]) -> tuple[Vector, ...]:
    key, q = "simulation.xi0", orders[0]
    if len(orders) > 1:
        return _read_rows(value, key=key, orders=orders)
    if q == 0:
        raise SpecError(f"{key} has no meaning without an [exosystem].", key=key, cure="Remove it.")
    if is_list(value) and len(value) > 0 and all(is_list(row) for row in value):
        if len(value) not in (1, n):
            raise ShapeError(
                f"{key} must have {counted(n, 'row')}, one per agent, or be one list of {counted(q, 'number')};"
                f" got {counted(len(value), 'row')}.",
                key=key, cure="Give one row for all agents, or one each.",
            )  # fmt: skip
        return tuple(
            read_vector(row, key=f"{key}[{i}]", length=q, because="one per exosystem state")
            for i, row in enumerate(value)
        )
    if not is_list(value):
        raise ShapeError(
            f"{key} must be a list of {counted(q, 'number')}; got {shown(value)}.",
            key=key,
            cure=f"Write {[1] + [0] * (q - 1)}." if q <= 6 else "Write [1, 0, ...].",
        )
    return (read_vector(value, key=key, length=q, because="one per exosystem state"),)


def _read_rows(value: Any, *, key: str, orders: tuple[int, ...]) -> tuple[Vector, ...]:
    """One row per agent, as long as the order of its own exosystem."""
    if not is_list(value) or len(value) != len(orders) or not all(is_list(row) for row in value):
        raise ShapeError(
            f"{key} must have {counted(len(orders), 'row')}, one per agent, because the groups of exosystem.groups"
            f" differ in order; got {shown(value)}.",
            key=key, cure="Give every agent a row with one number per state of its own exosystem.",
        )  # fmt: skip
    because = "one per state of this agent's exosystem"
    return tuple(
        read_vector(row, key=f"{key}[{i}]", length=order, because=because)
        for i, (row, order) in enumerate(zip(value, orders, strict=True))
    )


def _positive(value: Any, *, key: str, unit: str) -> Fraction:
    number = parse_number(value, key=key)
    if number <= 0:
        raise SpecError(
            f"{key} must be > 0 ({unit}); got {shown_number(number)}.", key=key, cure="Give a positive time."
        )
    return number
