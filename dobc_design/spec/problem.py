"""The problem: network, couplings, pins, disturbance, and what has to be proved about them.

A Problem is frozen, exact and cannot exist invalid.  It holds no solver's answer and knows no file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any, TypeVar

from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import Vector
from dobc_design.spec.coupling import Coupling, make_coupling
from dobc_design.spec.exosystem import Exosystem
from dobc_design.spec.network import Network
from dobc_design.spec.observer import Observer, check_observer
from dobc_design.spec.pinning import Pinning, read_pinning
from dobc_design.spec.reading import NumberText, is_list, read_vector, shown
from dobc_design.spec.region import Region, read_region
from dobc_design.spec.settings import Simulation, Switching, read_simulation

T = TypeVar("T")
Arc = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A disturbance-observer-based consensus problem: equations (1), (12), (13), (19).

    Parameters (all by keyword; numbers are exact, a float means its shortest decimal text):
        network: Network.
        coupling: h as text in y (by component), or m texts in y1..ym; h(0) = 0 is checked exactly.
        exceptions: {(listener index, speaker index): h}, for arcs with a coupling of their own.
        target: xbar, a number for all components or m numbers.
        gains: {label: k} with k >= 0 or an m x m matrix; or one number for all agents.
        exosystem: Exosystem or None (no disturbance).
        observer: Observer or None (W is designed).
        offsets: {label: offset}, the formation: agent i goes to xbar + offset_i.
        region: {"initial_states": ..., "initial_disturbance": ...} or a Region.
        switching, simulation: settings; ``simulation`` is a mapping with t_final, seed, xi0.
        notes: sentences on what is assumed or stands in; they are shown wherever a result is shown.
    Raises: SpecError (or ShapeError, ExpressionError) that names every wrong key.
    """

    name: str
    network: Network
    coupling: Coupling
    exceptions: Mapping[Arc, Coupling]
    target: Vector
    pinning: Pinning
    exosystem: Exosystem | None
    observer: Observer
    offsets: Mapping[int, Vector]
    region: Region | None
    switching: Switching | None
    simulation: Simulation
    notes: tuple[str, ...]

    def __init__(
        self,
        *,
        network: Network,
        coupling: str | Sequence[str] | Coupling,
        exceptions: Mapping[Arc, str | Sequence[str] | Coupling] | None = None,
        target: Any = 0,
        gains: Any = None,
        exosystem: Exosystem | None = None,
        observer: Observer | None = None,
        offsets: Mapping[Any, Any] | None = None,
        region: Region | Mapping[str, Any] | None = None,
        switching: Switching | None = None,
        simulation: Simulation | Mapping[str, Any] | None = None,
        name: str = "problem",
        notes: Sequence[str] = (),
    ) -> None:
        errors: list[SpecError] = []
        keep = _Keeper(self, errors)
        m = dimension_of(exosystem, target, coupling)
        n, q = network.size, 0 if exosystem is None else exosystem.order
        keep("name", lambda: _read_name(name))
        keep("network", lambda: network)
        keep("exosystem", lambda: exosystem)
        keep("target", lambda: read_vector(target, key="target", length=m, because="one per state component"))
        keep("coupling", lambda: _read_coupling(coupling, dimension=m, key="coupling.h"))
        keep("exceptions", lambda: _read_exceptions(exceptions or {}, network=network, dimension=m))
        keep("pinning", lambda: _read_pinning(gains, network=network, dimension=m))
        keep("observer", lambda: _read_observer(observer, exosystem=exosystem))
        keep("offsets", lambda: _read_offsets(offsets or {}, network=network, dimension=m))
        keep("region", lambda: _read_region(region, dimension=m, exosystem=exosystem))
        keep("switching", lambda: switching)
        keep("simulation", lambda: _read_simulation(simulation, n=n, q=q))
        keep("notes", lambda: _read_notes(notes))
        if errors:
            raise SpecError.several(errors)

    def __hash__(self) -> int:
        return hash((self.name, self.network, self.coupling, self.target, self.pinning))

    @property
    def n(self) -> int:
        """Number of agents."""
        return self.network.size

    @property
    def m(self) -> int:
        """Number of state components of one agent."""
        return len(self.target)

    @property
    def q(self) -> int:
        """Order of the exosystem; 0 without one."""
        return 0 if self.exosystem is None else self.exosystem.order

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """The default coupling and those of the exceptions, each once."""
        return tuple(dict.fromkeys((self.coupling, *self.exceptions.values())))

    @property
    def is_linear(self) -> bool:
        """Whether every coupling is exactly linear, so that J does not depend on e."""
        return all(coupling.is_linear for coupling in self.couplings)

    def coupling_of(self, listener: int, speaker: int) -> Coupling:
        """The coupling of one arc."""
        return self.exceptions.get((listener, speaker), self.coupling)

    def goal_of(self, agent: int) -> Vector:
        """xbar + offset_i, where agent i is to go."""
        offset = self.offsets.get(agent)
        return self.target if offset is None else tuple(x + o for x, o in zip(self.target, offset, strict=True))


class _Keeper:
    """Sets fields of a frozen instance one by one and collects what goes wrong."""

    def __init__(self, instance: object, errors: list[SpecError]) -> None:
        self.instance, self.errors = instance, errors

    def __call__(self, field: str, read: Callable[[], T]) -> None:
        try:
            object.__setattr__(self.instance, field, read())
        except SpecError as error:
            self.errors.extend(error.errors)


def dimension_of(exosystem: Exosystem | None, target: Any, coupling: Any) -> int:
    """m: the rows of C, else the length of target, else of h, else 1 (the contract's order)."""
    if exosystem is not None:
        return exosystem.outputs
    if is_list(target):
        return max(1, len(target))
    if isinstance(coupling, Coupling):
        return coupling.dimension
    return len(coupling) if is_list(coupling) and len(coupling) else 1


def _read_name(name: object) -> str:
    if not isinstance(name, str) or isinstance(name, NumberText) or not 1 <= len(name) <= 100 or not name.isprintable() or not name.strip():
        raise SpecError(
            f"name must be text of 1 to 100 printable characters; got {shown(name)}.", key="name",
            cure='For example name = "my-network".',
        )  # fmt: skip
    return name


def _read_notes(notes: Any) -> tuple[str, ...]:
    texts = tuple(notes) if is_list(notes) else (notes,)
    for position, text in enumerate(texts):
        if not isinstance(text, str) or isinstance(text, NumberText) or len(text) > 1000:
            raise SpecError(
                f"notes[{position}] must be text of at most 1000 characters; got {shown(text)}.",
                key=f"notes[{position}]", cure="Write a list of sentences.",
            )  # fmt: skip
    return texts


def _read_coupling(value: Any, *, dimension: int, key: str) -> Coupling:
    if isinstance(value, Coupling):
        if value.dimension != dimension:
            raise ShapeError(
                f"{key} must have dimension {dimension}, one per state component; got {value.dimension}.",
                key=key, cure="Make it with the right dimension.",
            )  # fmt: skip
        return value
    return make_coupling(value, dimension=dimension, key=key)


def _read_exceptions(value: Mapping[Arc, Any], *, network: Network, dimension: int) -> Mapping[Arc, Coupling]:
    n = network.size
    exist = {
        code
        for arcs in (network.modes.values() if value else ())
        for code in (arcs.listeners * n + arcs.speakers).tolist()
    }
    result: dict[Arc, Coupling] = {}
    errors: list[SpecError] = []
    for position, ((listener, speaker), h) in enumerate(value.items()):
        key = f"coupling.exceptions[{position}]"
        try:
            if listener * n + speaker not in exist:
                names = [network.labels[i] if 0 <= i < n else str(i) for i in (listener, speaker)]
                raise SpecError(
                    f"{key}: no mode has the arc in which {names[0]} listens to {names[1]}.", key=key,
                    cure="Correct the arc, or remove the exception.",
                )  # fmt: skip
            result[listener, speaker] = _read_coupling(h, dimension=dimension, key=f"{key}.h")
        except SpecError as error:
            errors.extend(error.errors)
    if errors:
        raise SpecError.several(errors)
    return MappingProxyType(result)


def _read_pinning(gains: Any, *, network: Network, dimension: int) -> Pinning:
    return gains if isinstance(gains, Pinning) else read_pinning(gains, labels=network.labels, dimension=dimension)


def _read_observer(observer: Observer | None, *, exosystem: Exosystem | None) -> Observer:
    if observer is None:
        return Observer()
    if exosystem is None:
        raise SpecError(
            "[observer] has no meaning without an [exosystem]: there is no disturbance to estimate.",
            key="observer", cure="Remove it, or give the exosystem.",
        )  # fmt: skip
    check_observer(observer, q=exosystem.order, m=exosystem.outputs)
    return observer


def _read_offsets(value: Mapping[Any, Any], *, network: Network, dimension: int) -> Mapping[int, Vector]:
    index = network.index if value else {}
    result: dict[int, Vector] = {}
    errors: list[SpecError] = []
    for label, offset in value.items():
        key = f"formation.offsets.{label}"
        try:
            if isinstance(label, bool) or str(label) not in index:
                raise SpecError(
                    f"{key}: there is no agent {str(label)[:60]!r} in network.agents.", key=key,
                    cure="Use the label of an agent.",
                )  # fmt: skip
            result[index[str(label)]] = read_vector(
                offset, key=key, length=dimension, because="one per state component"
            )
        except SpecError as error:
            errors.extend(error.errors)
    if errors:
        raise SpecError.several(errors)
    return MappingProxyType({i: offset for i, offset in sorted(result.items()) if any(offset)})


def _read_region(value: Any, *, dimension: int, exosystem: Exosystem | None) -> Region | None:
    if value is None:
        return None
    if isinstance(value, Region):
        value = {"initial_states": value.initial_states, "initial_disturbance": value.initial_disturbance}
    return read_region(
        value.get("initial_states"),
        value.get("initial_disturbance"),
        dimension=dimension,
        with_exosystem=exosystem is not None,
    )


def _read_simulation(value: Any, *, n: int, q: int) -> Simulation:
    if isinstance(value, Simulation):
        return read_simulation(value.t_final, value.seed, value.xi0, n=n, q=q)
    table = value or {}
    return read_simulation(table.get("t_final"), table.get("seed"), table.get("xi0"), n=n, q=q)
