"""Pins: the agents that know the target, and their gains, as somebody writes them by label.

u_i = -k_i (x_i - xbar) pulls a pinned agent to the target; zero gains are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from itertools import islice
from types import MappingProxyType
from typing import Any, TypeVar

from dobc_design._checks import noun, put
from dobc_design._show.cards import Card, Facts, Shown, plain
from dobc_design.coupling.coupling import Coupling
from dobc_design.errors import Mistakes, SpecError, about, wrong
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.matrix import Matrix, add, identity, scale, transpose, zeros
from dobc_design.exact.number import number_key, parse_number
from dobc_design.exact.reading import (
    Names,
    counted,
    is_list,
    is_scalar_matrix,
    items,
    named,
    read_matrix,
    shown,
    shown_number,
)
from dobc_design.exact.symmetric import SparseSymmetric

from .dynamics import Dynamics
from .network import Network, meant, one_form

T = TypeVar("T")
SHOWN_MODES = 6  # with pins of their own, in a message


@noun
class Pinning(Shown):
    """Gains by agent index (from 0), each an m x m matrix, p x m with [dynamics]; zero gains are
    left out."""

    gains: Mapping[int, Matrix]

    def __post_init__(self) -> None:
        # By agent, so that equal pins are equal in whatever order they are written.
        acting = {i: k for i, k in sorted(self.gains.items()) if any(map(any, k))}
        put(self, gains=MappingProxyType(acting))

    def _card(self) -> Card:
        text = f"of {counted(len(self.gains), 'agent')}, by index"
        return Card(title="Pinning", text=text, facts=self._gains())

    def __repr__(self) -> str:
        gains = {int(i): k for i, k in self._gains()}
        return f"Pinning(gains={plain(gains)})"

    def _gains(self) -> Facts:
        return [(str(i), k[0][0] if is_scalar_matrix(k) else k) for i, k in self.gains.items()]

    def __hash__(self) -> int:
        return hash(tuple(self.gains.items()))

    @property
    def agents(self) -> tuple[int, ...]:
        """Indices of the agents with a gain that is not zero."""
        return tuple(self.gains)

    @property
    def is_scalar(self) -> bool:
        """Whether every gain is a multiple of the identity."""
        return all(map(is_scalar_matrix, self.gains.values()))


@noun
class GainForm:
    """What gains may be: ``unit`` is what the number 1 stands for, None where a number says
    nothing."""

    unit: Matrix | None
    shape: tuple[int, int]
    pulling: bool  # k + k' >= 0 is asked

    @classmethod
    def of(cls, m: int, dynamics: Dynamics | None, coupling: Coupling | None) -> GainForm:
        """The form for m states; ``coupling`` is None where it was refused, and then nothing is
        said of gains."""
        # With as many inputs as states a number is a multiple of the identity.
        if dynamics is None or dynamics.inputs == m:
            return cls(unit=identity(m), shape=(m, m), pulling=dynamics is None)
        shape = (dynamics.inputs, m)
        if coupling is None:
            return cls(unit=zeros(*shape), shape=shape, pulling=False)
        if not coupling.is_linear:
            return cls(unit=None, shape=shape, pulling=False)
        # With fewer inputs than states 1 is the coupling itself, which is linear.
        slopes = coupling.jacobian_at_zero()
        unit = tuple(tuple(x.midpoint for x in row) for row in slopes)
        return cls(unit=unit, shape=shape, pulling=False)

    def check(self, gain: Matrix, key: str) -> None:
        """Refuse a gain that may push away from the target.  Raises: SpecError."""
        if not self.pulling:
            return
        # e'ke = e'(k + k')e/2: only the symmetric part pulls.
        symmetric = SparseSymmetric.from_dense(add(gain, transpose(gain)))
        if decide_positive_semidefinite(symmetric).is_proved:
            return
        raise about(
            key,
            "a matrix gain k must satisfy k + k' >= 0, so that it never pushes away from the "
            "target; this one does not.",
            "Make its symmetric part positive semidefinite.",
        )

    def read(self, value: Any, key: str) -> Matrix:
        """A gain, given as a number or as a matrix.  Raises: SpecError, ShapeError."""
        if not is_list(value):
            return self._read_number(value, key)
        p, m = self.shape
        because = "one row per input, one column per component"
        if p == m:
            because = "one row and column per state component"
        gain = read_matrix(value, key, shape=self.shape, because=because)
        self.check(gain, key)
        return gain

    def _read_number(self, value: Any, key: str) -> Matrix:
        """A gain given as a number, a multiple of ``unit``."""
        if self.unit is None:
            p, m = self.shape
            what = f"must be a {p} x {m} matrix, because the coupling is not linear;"
            raise wrong(
                key,
                f"{what} got {shown(value)}.",
                "It acts on x_i - xbar: one row per input, one column per state component.",
            )
        number = parse_number(value, key)
        if number < 0:
            what = "must be >= 0, because u_i = -k_i (x_i - xbar) has to pull towards the target;"
            raise wrong(
                key,
                f"{what} got {shown_number(number)}.",
                "Use a positive gain, or leave the agent out.",
            )
        return scale(number, self.unit)


def read_pinning(gains: Any, *, network: Network, form: GainForm) -> Pinning:
    """Read label -> gain, or one number for all agents.  Raises: SpecError with every wrong gain by
    its key."""
    labels = network.labels
    if gains is None:
        return Pinning(gains={})
    if isinstance(gains, Pinning):
        # agents often share one
        for gain in {id(k): k for k in gains.gains.values()}.values():
            form.check(gain, "pinning.gains")
        return gains
    if is_list(gains):
        raise wrong(
            "pinning.gains",
            f"must be a table of label = gain, or one number for all agents; got {shown(gains)}.",
            "For example gains = { 1 = 5.0, 6 = 2 }: a list does not say whose gains they are.",
        )
    if not isinstance(gains, Mapping):
        gain = form.read(gains, "pinning.gains")
        return Pinning(gains=dict.fromkeys(range(len(labels)), gain))
    # The commonest wrong key: gains by mode, as weights are.
    modes = [mode for mode in map(str, gains) if mode in network.modes and mode not in labels]
    if modes:
        raise _pins_of_modes(gains, modes, network, form)
    known = {}

    def read(value: Any, key: str) -> Matrix:
        """The gain; of equal numbers the same object."""
        if isinstance(value, bool) or not isinstance(value, (str, int, Fraction)):
            return form.read(value, key)
        token = number_key(value)
        if token not in known:
            known[token] = form.read(value, key)
        return known[token]

    return Pinning(gains=by_label(gains, read, labels=labels, key="pinning.gains"))


def _pins_of_modes(
    gains: Mapping[Any, Any], modes: Names, network: Network, form: GainForm
) -> SpecError:
    """Says how pins of single modes are written today: as arcs to an agent that stands for the
    target."""
    names = ("target", "goal", f"target-{network.size}")
    goal = next(name for name in names if name not in network.labels)
    arcs = [f"in {named(mode)} {_as_arcs(gains[mode])}" for mode in modes[:SHOWN_MODES]]
    p, m = form.shape
    linear = ""
    if p == m:
        linear = '; give these arcs h = "y" in [[coupling.exceptions]]'
    return about(
        f"pinning.gains.{named(modes[0])}",
        f"{named(modes[0])} is a mode; gains are given by agent, and pins of single modes are not "
        "supported yet.",
        f"Today an agent can stand for the target: add {goal} to network.agents, pin it alone "
        f"(gains = {{ {goal} = 1 }}), and let agents listen to it: {'; '.join(arcs)}{linear}.",
    )


def _as_arcs(pins: Any) -> str:
    """The pins of one mode as arcs with weights."""
    if not isinstance(pins, Mapping) or not pins:
        return "its pinned agents"
    each = []
    for label, k in islice(pins.items(), SHOWN_MODES):
        weight = shown(k).strip("'")
        each.append(f"agent {named(str(label))} with weight {weight}")
    return ", ".join(each)


def by_label(value: Any, read: Callable[[Any, str], T], *, labels: Names, key: str) -> dict[int, T]:
    """Agent index -> what ``read(value, key)`` makes of a table by label; every wrong entry is
    named."""
    index = {label: i for i, label in enumerate(labels)}
    result = {}
    errors = Mistakes()
    for label, entry in errors.few(items(value, key)):
        own = f"{key}.{named(str(label))}"
        with errors:
            place = None if isinstance(label, bool) else index.get(one_form(label))
            if place is None:
                raise _no_agent(label, labels, key=own)
            if place in result:
                raise wrong(own, "appears twice (labels are text).", "Keep one.")
            result[place] = read(entry, own)
    errors.raise_all()
    return result


def _no_agent(label: object, labels: Names, *, key: str) -> SpecError:
    what = f"there is no agent {shown(str(label))} in network.agents."
    return about(key, what, meant(str(label), labels))
