"""Pins: the agents that know the target, and their gains, as somebody writes them by label.

u_i = -k_i (x_i - xbar) pulls a pinned agent to the target; zero gains are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from fractions import Fraction
from itertools import chain, islice
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

from .dynamics import Dynamics
from .network import Network, meant, one_form

T = TypeVar("T")
SHOWN_MODES = 6  # with pins of their own, in a message


@noun
class Pinning(Shown):
    """Gains by agent index (from 0), each an m x m matrix, p x m with [dynamics]; zero gains are
    left out.  ``modes``: further ones of single modes, by mode."""

    gains: Mapping[int, Matrix]
    modes: Mapping[str, Mapping[int, Matrix]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        of_modes = {mode: _acting(gains) for mode, gains in self.modes.items()}
        kept = {mode: gains for mode, gains in of_modes.items() if gains}
        put(self, gains=_acting(self.gains), modes=MappingProxyType(kept))

    def _card(self) -> Card:
        text = f"of {counted(len(self.agents), 'agent')}, by index"
        facts = self._gains(self.gains)
        for mode, gains in self.modes.items():
            facts += [(f"{i} in {mode}", k) for i, k in self._gains(gains)]
        return Card(title="Pinning", text=text, facts=facts)

    def __repr__(self) -> str:
        parts = [f"gains={self._plain(self.gains)}"]
        if self.modes:
            modes = (f"{mode!r}: {self._plain(gains)}" for mode, gains in self.modes.items())
            parts.append(f"modes={{{', '.join(modes)}}}")
        return f"Pinning({', '.join(parts)})"

    def _plain(self, gains: Mapping[int, Matrix]) -> str:
        return plain({int(i): k for i, k in self._gains(gains)})

    @staticmethod
    def _gains(gains: Mapping[int, Matrix]) -> Facts:
        return [(str(i), k[0][0] if is_scalar_matrix(k) else k) for i, k in gains.items()]

    def __hash__(self) -> int:
        return hash((tuple(self.gains.items()), tuple(self.modes)))

    @property
    def agents(self) -> tuple[int, ...]:
        """Indices of the agents with a gain that is not zero in some mode."""
        return tuple(sorted({*self.gains, *chain.from_iterable(self.modes.values())}))

    def of(self, mode: str | None) -> Mapping[int, Matrix]:
        """The gains in one mode; None: those of all modes."""
        return {**self.gains, **self.modes.get(mode or "", {})}

    def labelled(self, labels: Names) -> dict[str, dict[str, Matrix]]:
        """``modes`` as somebody writes them: mode -> label -> gain."""
        modes = self.modes.items()
        return {mode: {labels[i]: k for i, k in gains.items()} for mode, gains in modes}

    @property
    def is_scalar(self) -> bool:
        """Whether every gain is a multiple of the identity."""
        every = chain(self.gains.values(), *(gains.values() for gains in self.modes.values()))
        return all(map(is_scalar_matrix, every))


def _acting(gains: Mapping[int, Matrix]) -> Mapping[int, Matrix]:
    """Those that are not 0, by agent, so that equal pins are equal in whatever order they are
    written."""
    return MappingProxyType({i: k for i, k in sorted(gains.items()) if any(map(any, k))})


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
        felt = m if dynamics is None else dynamics.felt
        if dynamics is None or dynamics.inputs == felt:
            return cls(unit=identity(felt), shape=(felt, felt), pulling=dynamics is None)
        shape = (dynamics.inputs, felt)
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
        if decide_positive_semidefinite(add(gain, transpose(gain))).is_proved:
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


def read_pinning(
    gains: Any, *, network: Network, form: GainForm, mode_gains: Any = None
) -> Pinning:
    """Read label -> gain, or one number for all agents; ``mode_gains``: mode -> the same.  Raises:
    SpecError with every wrong gain by its key."""
    always = _read_gains(gains, network, form)
    if mode_gains is None:
        mode_gains = always.labelled(network.labels)
    if not mode_gains:
        return Pinning(gains=always.gains)
    modes: dict[str, Mapping[int, Matrix]] = {}

    def read(value: Any, key: str) -> Matrix:
        return form.read(value, key=key)

    errors = Mistakes()
    for mode, own in errors.few(items(mode_gains, "pinning.modes")):
        key = f"pinning.modes.{named(str(mode))}"
        with errors:
            if mode not in network.modes:
                raise wrong(key, "names no mode of the network.", _modes_in_words(network))
            modes[mode] = by_label(own, read, labels=network.labels, key=key)
            twice = sorted(set(always.gains) & set(modes[mode]))
            if twice:
                raise wrong(
                    f"{key}.{named(network.labels[twice[0]])}",
                    "names an agent that has a gain in every mode, in pinning.gains.",
                    "Keep one of the two.",
                )
    errors.raise_all()
    return Pinning(gains=always.gains, modes=modes)


def _modes_in_words(network: Network) -> str:
    modes = list(network.modes)
    more = ", ..." if len(modes) > SHOWN_MODES else ""
    return f"The modes are {', '.join(modes[:SHOWN_MODES])}{more}."


def _read_gains(gains: Any, network: Network, form: GainForm) -> Pinning:
    """The gains of all modes."""
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
        raise about(
            f"pinning.gains.{named(modes[0])}",
            f"{named(modes[0])} is a mode; gains are given by agent here.",
            f"Write pins of single modes below [pinning.modes]: {_of_mode(modes[0], gains)}.",
        )
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


def _of_mode(mode: str, gains: Mapping[Any, Any]) -> str:
    """The pins of one mode as a line of a file."""
    own = gains[mode]
    pins = ["1 = 5.0"]
    if isinstance(own, Mapping) and own:
        pins = [f"{label} = {shown(k)}" for label, k in islice(own.items(), SHOWN_MODES)]
    return f"{mode} = {{ {', '.join(pins)} }}"


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
