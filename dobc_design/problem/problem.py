"""The problem: network, couplings, pins, disturbance, and what has to be proved about them.

A Problem is frozen, exact and cannot exist invalid.  It holds no solver's answer and knows no file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from fractions import Fraction
from functools import partial
from inspect import signature
from itertools import islice
from types import MappingProxyType
from typing import Any, TypeVar

from dobc_design._checks import put
from dobc_design._show.cards import MOST_ITEMS, Card, Shown, listed, plain
from dobc_design._show.text import significant
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.errors import ShapeError, SpecError, about, kept, raise_all, wrong
from dobc_design.exact import reading
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.matrix import Matrix, Vector, add, identity, scale, transpose, zeros
from dobc_design.exact.number import number_key, parse_number
from dobc_design.exact.reading import (
    counted,
    is_list,
    is_scalar_matrix,
    is_text,
    named,
    shown,
    shown_number,
)
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem import settings
from dobc_design.problem.dynamics import Dynamics, check_goal
from dobc_design.problem.exosystems import Exosystem, block_diagonal
from dobc_design.problem.groups import Group, Observer, group_numbers, join, read_groups
from dobc_design.problem.leader import Leader, read_leader
from dobc_design.problem.network import Network, one_form
from dobc_design.problem.settings import Region, Simulation, Switching
from dobc_design.problem.uncertainty import Actuators, Uncertainty, read_actuators, read_uncertainty
from dobc_design.verdict import Verdict

T = TypeVar("T")
Arc = tuple[int, int]
LARGEST_DIMENSION = 100  # every gain is an m x m matrix
SHOWN_MODES = 6  # with pins of their own, in a message


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Pinning(Shown):
    """Gains by agent index (from 0), each an m x m matrix, p x m with [dynamics]; zero gains are
    left out."""

    gains: Mapping[int, Matrix]

    def __post_init__(self) -> None:
        kept = {i: k for i, k in sorted(self.gains.items()) if any(any(row) for row in k)}
        put(self, gains=MappingProxyType(kept))

    def _card(self) -> Card:
        return Card(
            title="Pinning",
            text=f"of {counted(len(self.gains), 'agent')}, by index",
            facts=self._gains(),
        )

    def __repr__(self) -> str:
        return f"Pinning(gains={plain({int(i): k for i, k in self._gains()})})"

    def _gains(self) -> list[tuple[str, Any]]:
        return [(str(i), k[0][0] if is_scalar_matrix(k) else k) for i, k in self.gains.items()]

    def __hash__(self) -> int:
        return hash(tuple(self.gains.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        # the read-only mapping itself cannot be pickled
        return partial(Pinning, gains=dict(self.gains)), ()

    @property
    def agents(self) -> tuple[int, ...]:
        """Indices of the agents with a gain that is not zero."""
        return tuple(self.gains)

    @property
    def is_scalar(self) -> bool:
        """Whether every gain is a multiple of the identity."""
        return all(is_scalar_matrix(k) for k in self.gains.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Gains:
    """What gains may be: ``unit`` is what the number 1 stands for, None where a number says
    nothing."""

    unit: Matrix | None
    shape: tuple[int, int]
    pulling: bool  # k + k' >= 0 is asked

    @classmethod
    def of(cls, m: int, dynamics: Dynamics | None, coupling: Coupling | None) -> _Gains:
        if dynamics is None or dynamics.inputs == m:
            return cls(unit=identity(m), shape=(m, m), pulling=dynamics is None)
        # where the coupling is refused, nothing is said of gains
        unit: Matrix | None = zeros(dynamics.inputs, m)
        if coupling is not None:
            slopes = coupling.jacobian_at_zero() if coupling.is_linear else ()
            unit = tuple(tuple(x.midpoint for x in row) for row in slopes) or None
        return cls(unit=unit, shape=(dynamics.inputs, m), pulling=False)

    def check(self, gain: Matrix, *, key: str) -> None:
        if not self.pulling:
            return
        symmetric = SparseSymmetric.from_dense(add(gain, transpose(gain)))
        if decide_positive_semidefinite(symmetric).verdict is not Verdict.PROVED:
            what = (
                "a matrix gain k must satisfy k + k' >= 0, so that it never pushes away from "
                "the target;"
            )
            raise about(
                key, f"{what} this one does not.", "Make its symmetric part positive semidefinite."
            )


def read_pinning(gains: Any, *, network: Network, form: _Gains) -> Pinning:
    """Read label -> gain, or one number for all agents.  Raises: SpecError with every wrong gain by
    its key."""
    labels = network.labels
    if gains is None or isinstance(gains, Pinning):
        # agents often share one
        for gain in {id(k): k for k in gains.gains.values()}.values() if gains else ():
            form.check(gain, key="pinning.gains")
        return gains or Pinning(gains={})
    if is_list(gains):
        what = f"must be a table of label = gain, or one number for all agents; got {shown(gains)}."
        raise wrong("pinning.gains", what, "For example gains = { 1 = 5.0, 6 = 2 }.")
    if not isinstance(gains, Mapping):
        gain = _read_gain(gains, key="pinning.gains", form=form)
        return Pinning(gains=dict.fromkeys(range(len(labels)), gain))
    modes = [mode for mode in map(str, gains) if mode in network.modes and mode not in labels]
    if modes:
        raise _pins_of_modes(gains, modes, network, form)
    known: dict[str, Matrix] = {}

    def read(value: Any, key: str) -> Matrix:
        """The gain; of equal numbers the same object."""
        if isinstance(value, bool) or not isinstance(value, (str, int, Fraction)):
            return _read_gain(value, key=key, form=form)
        token = number_key(value)
        if token not in known:
            known[token] = _read_gain(value, key=key, form=form)
        return known[token]

    return Pinning(gains=_by_label(gains, read, labels=labels, key="pinning.gains"))


def _pins_of_modes(
    gains: Mapping[Any, Any], modes: Sequence[str], network: Network, form: _Gains
) -> SpecError:
    """Says how pins of single modes are written today: as arcs to an agent that stands for the
    target."""
    goal = next(
        name for name in ("target", "goal", f"target-{network.size}") if name not in network.labels
    )
    arcs = []
    for mode in modes[:SHOWN_MODES]:
        pins = gains[mode] if isinstance(gains[mode], Mapping) else {}
        each = []
        for label, k in islice(pins.items(), SHOWN_MODES):
            weight = shown(k).strip("'")
            each.append(f"agent {named(str(label))} with weight {weight}")
        arcs.append(f"in {named(mode)} {', '.join(each) or 'its pinned agents'}")
    p, m = form.shape
    linear = '; give these arcs h = "y" in [[coupling.exceptions]]' if p == m else ""
    what = (
        f"{named(modes[0])} is a mode; gains are given by agent, and pins of single modes are "
        "not supported yet."
    )
    cure = (
        f"Today an agent can stand for the target: add {goal} to network.agents, pin it alone "
        f"(gains = {{ {goal} = 1 }}), and let agents listen to it: {'; '.join(arcs)}{linear}."
    )
    return about(f"pinning.gains.{named(modes[0])}", what, cure)


def _by_label(
    value: Any, read: Callable[[Any, str], T], *, labels: Sequence[str], key: str
) -> dict[int, T]:
    """Agent index -> what ``read(value, key)`` makes of a table by label; every wrong entry is
    named."""
    index = {label: i for i, label in enumerate(labels)}
    result: dict[int, T] = {}
    errors: list[SpecError] = []
    for label, entry in settings.items(value, key=key):
        own = f"{key}.{named(str(label))}"
        with kept(errors):
            place = None if isinstance(label, bool) else index.get(one_form(label))
            if place is None:
                what = f"there is no agent {shown(str(label))} in network.agents."
                near = get_close_matches(str(label)[:100], labels[:1000], n=1)
                raise about(
                    own,
                    what,
                    f'Did you mean "{near[0]}"?' if near else "Use the label of an agent.",
                )
            if place in result:
                raise wrong(own, "appears twice (labels are text).", "Keep one.")
            result[place] = read(entry, own)
        if len(errors) >= reading.MOST_ERRORS:
            break
    raise_all(errors)
    return result


def _read_gain(value: Any, *, key: str, form: _Gains) -> Matrix:
    p, m = form.shape
    if not is_list(value) and form.unit is None:
        what = (
            f"must be a {p} x {m} matrix, because the coupling is not linear; got {shown(value)}."
        )
        raise wrong(
            key, what, "It acts on x_i - xbar: one row per input, one column per state component."
        )
    if not is_list(value):
        number = parse_number(value, key=key)
        if number < 0:
            what = (
                f"must be >= 0, because u_i = -k_i (x_i - xbar) has to pull towards the target;"
                f" got {shown_number(number)}."
            )
            raise wrong(key, what, "Use a positive gain, or leave the agent out.")
        return scale(number, form.unit or ())
    because = (
        "one row and column per state component"
        if p == m
        else "one row per input, one column per component"
    )
    gain = reading.read_matrix(value, key=key, shape=form.shape, because=because)
    form.check(gain, key=key)
    return gain


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Problem(Shown):
    """A disturbance-observer-based consensus problem: equations (1), (12), (13), (19).

    Parameters (all by keyword; numbers are exact, a float means its shortest decimal text):
        network: Network. coupling: h as text in y (by component), or m texts in y1..ym; h(0) = 0 is
        checked exactly. exceptions: {(listener index, speaker index): h}, for arcs with a coupling
        of their own. target: xbar, a number for all components or m numbers. gains: {label: k} with
        k >= 0 or an m x m matrix; or one number for all agents. exosystem: Exosystem or None (no
        disturbance). observer: Observer or None (W is designed). groups: Groups of agents with an
        exosystem and an observer of their own; ``exosystem`` and ``observer`` are
            then those of the agents in no group, who have no disturbance without an ``exosystem``.
        offsets: {label: offset}, the formation: agent i goes to xbar + offset_i. region:
        {"initial_states": ..., "initial_disturbance": ...} or a Region. switching, simulation:
        settings; ``simulation`` is a mapping with t_final, seed, xi0, x0. dynamics: Dynamics, of
        agents that are no integrators; couplings, gains (p x m) and C then have p components.
        leader: a Leader, or a mapping with initial and stays_in: the target is a solution of the
        dynamics; it knows no
            ``target`` then.
        uncertainty, actuators: an Uncertainty and Actuators, or mappings: what the plant may add,
        what it can give. notes: sentences on what is assumed or stands in; they are shown wherever
        a result is shown.
    Further attributes: couplings, the default one and those of the exceptions, each once;
    exception_places, the place among them of the coupling of every arc with its own; origin, the
    problem with [dynamics] whose errors this one has (``as_integrators``), else None, and node, the
    place of what every agent feels of its own error.
    Raises: SpecError (or ShapeError, ExpressionError) that names every wrong key.
    Example:
        >>> network = dd.Network.from_arcs([["tail", "head"]], arrow="listens_to")
        >>> problem = dd.Problem(network=network, coupling="tanh(y)", gains={"head": "3/2"})
        >>> problem.n, problem.m, problem.q
        (2, 1, 0)
    """

    name: str
    network: Network
    coupling: Coupling
    exceptions: Mapping[Arc, Coupling]
    target: Vector
    pinning: Pinning
    groups: tuple[Group, ...]
    offsets: Mapping[int, Vector]
    region: Region | None
    switching: Switching | None
    simulation: Simulation
    uncertainty: Uncertainty | None
    actuators: Actuators | None
    dynamics: Dynamics | None
    leader: Leader | None
    notes: tuple[str, ...]
    couplings: tuple[Coupling, ...] = field(init=False, compare=False)
    exception_places: Mapping[Arc, int] = field(init=False, compare=False)
    origin: Problem | None = field(init=False)
    node: int | None = field(init=False, compare=False)

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
        groups: Sequence[Group] | None = None,
        offsets: Mapping[Any, Any] | None = None,
        region: Region | Mapping[str, Any] | None = None,
        switching: Switching | None = None,
        simulation: Simulation | Mapping[str, Any] | None = None,
        uncertainty: Uncertainty | Mapping[str, Any] | None = None,
        actuators: Actuators | Mapping[str, Any] | None = None,
        dynamics: Dynamics | Mapping[str, Any] | None = None,
        leader: Leader | Mapping[str, Any] | None = None,
        name: str = "problem",
        notes: Sequence[str] = (),
    ) -> None:
        errors: list[SpecError] = []

        def keep(field: str, read: Callable[[], Any]) -> None:
            with kept(errors):
                put(self, **{field: read()})

        _check_kinds(
            network=network,
            exosystem=exosystem,
            observer=observer,
            switching=switching,
            groups=groups,
        )
        own = Dynamics(**dynamics) if isinstance(dynamics, Mapping) else dynamics
        put(self, dynamics=own)
        first = exosystem if exosystem is not None or not groups else groups[0].exosystem
        m = dimension_of(first, target, coupling, own)
        p, states = (m, None) if own is None else (own.inputs, m)
        keep("name", lambda: _read_name(name))
        keep("network", lambda: network)
        parts = partial(
            read_groups, groups, exosystem=exosystem, observer=observer, labels=network.labels
        )
        keep("groups", lambda: parts(m=p, states=states))
        # None: there is a mistake in them
        divided: tuple[Group, ...] | None = getattr(self, "groups", None)
        keep(
            "target",
            lambda: reading.read_vector(
                target, key="target", length=m, because="one per state component"
            ),
        )
        keep("coupling", lambda: _read_coupling(coupling, dimension=m, outputs=p, key="coupling.h"))
        keep(
            "exceptions",
            lambda: _read_exceptions(exceptions, network=network, dimension=m, outputs=p),
        )
        form = _Gains.of(m, own, getattr(self, "coupling", None))
        keep("pinning", lambda: read_pinning(gains, network=network, form=form))
        keep("offsets", lambda: _read_offsets(offsets, labels=network.labels, dimension=m))
        keep(
            "region",
            lambda: settings.read_region(region, dimension=m, with_exosystem=first is not None),
        )
        keep("switching", lambda: settings.check_switching(switching, tuple(network.modes)))
        # else nobody knows how long the rows of xi0 have to be
        if divided is not None or not groups:
            orders = _orders(divided, network.labels, exosystem)
            keep(
                "simulation",
                lambda: settings.read_simulation(simulation, n=network.size, orders=orders, m=m),
            )
        keep("uncertainty", lambda: read_uncertainty(uncertainty))
        keep("actuators", lambda: read_actuators(actuators, labels=network.labels))
        keep("leader", lambda: read_leader(leader, dynamics=own))
        keep("notes", lambda: _read_notes(notes))
        raise_all(errors)
        self._check_dynamics()
        places = {
            each: place
            for place, each in enumerate(dict.fromkeys((self.coupling, *self.exceptions.values())))
        }
        special = {arc: places[each] for arc, each in self.exceptions.items()}
        put(self, couplings=tuple(places), exception_places=special, origin=None, node=None)

    def _check_dynamics(self) -> None:
        """With [dynamics] goals have to be equilibria; what is not known for them is refused."""
        if self.dynamics is None:
            return
        if self.actuators is not None:
            raise _limits_of_dynamics(self.actuators)
        for key in ("weights", "gains", "measurement"):
            if getattr(self.uncertainty, key, 0):
                raise wrong(
                    f"uncertainty.{key}",
                    "is not known for agents with [dynamics].",
                    "Remove it, or give 0.",
                )
        if self.leader is None:
            check_goal(self.dynamics, self.target, key="target")
        elif any(self.target):
            raise wrong(
                "target",
                "must be left out, or 0, with a [leader], which is the target.",
                "Remove it.",
            )
        self.dynamics.about(self.target)
        if self.offsets and self.dynamics.f is not None:
            raise wrong(
                "formation", "is known for agents with A only, not with f.", "Remove [formation]."
            )
        for agent in self.offsets:
            check_goal(
                self.dynamics,
                self.goal_of(agent),
                key=f"formation.offsets.{self.network.labels[agent]}",
            )

    def __hash__(self) -> int:
        return hash((self.name, self.network, self.coupling, self.target, self.pinning))

    def replace(self, **changes: Any) -> Problem:
        """The problem with other arguments, named and written as those of ``Problem``; of
        ``region`` and ``simulation`` as a mapping only the keys named change.

        Example:
            >>> problem = dd.load_problem("paper-fixed")
            >>> problem.replace(gains={1: 7, 6: 7}, region={"initial_states": [0, 4]}).name
            'paper-fixed'

        Raises: SpecError for an unknown argument, and where a new network has other agents, or
        another order, and what belongs to them is not given.
        """
        known = signature(Problem).parameters
        if unknown := [name for name in changes if name not in known]:
            what = f"a problem has no argument {unknown[0]!r}."
            raise SpecError(what, key=unknown[0], cure=f"Its arguments are {', '.join(known)}.")
        network = changes.get("network")
        if isinstance(network, Network) and network.labels != self.network.labels:
            starts = max(len(self.simulation.x0 or ()), len(self.simulation.xi0 or ())) > 1
            own = (
                ("gains", self.pinning.gains),
                ("exceptions", self.exceptions),
                ("simulation", starts),
            )
            if missing := [name for name, value in own if value and name not in changes]:
                what = "has other agents, or the same in another order."
                raise wrong("network", what, f"Give {' and '.join(missing)} for these agents too.")
        for name in ("region", "simulation"):
            old = getattr(self, name)
            if old is not None and isinstance(changes.get(name), Mapping):
                kept_keys = {each.name: getattr(old, each.name) for each in fields(old)}
                changes[name] = {
                    key: value for key, value in kept_keys.items() if value is not None
                } | changes[name]
        return Problem(**self._arguments() | changes)

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(Problem, **self._arguments()), ()  # the read-only mappings cannot be pickled

    def _arguments(self) -> dict[str, Any]:
        names = (
            "name",
            "network",
            "coupling",
            "target",
            "region",
            "switching",
            "simulation",
            "notes",
        )
        found = {
            name: getattr(self, name)
            for name in (*names, "uncertainty", "actuators", "dynamics", "leader")
        }
        found |= {"gains": self.pinning, "exceptions": dict(self.exceptions)}
        if self.is_grouped:  # agents in no group have no disturbance
            found |= {
                "groups": self.groups,
                "observer": Observer(rate=self.groups[0].observer.rate),
            }
        else:
            found |= {
                "exosystem": self.exosystem,
                "observer": self.observer if self.groups else None,
            }
        found["offsets"] = {self.network.labels[i]: offset for i, offset in self.offsets.items()}
        return found

    def _card(self) -> Card:
        labels, modes = self.network.labels, self.network.modes
        facts: list[tuple[str, Any]] = list(self.coupling._card().facts)
        facts.append(("target", self.target[0] if self.m == 1 else (self.target,)))
        facts += (
            []
            if self.dynamics is None
            else [(f"dynamics.{name}", value) for name, value in self.dynamics._card().facts]
        )
        arcs = [
            f"{name} ({counted(len(each), 'arc')})"
            for name, each in islice(modes.items(), MOST_ITEMS + 1)
        ]
        facts.append(("modes", listed(arcs, count=len(modes))))
        pins = islice(self.pinning.gains.items(), MOST_ITEMS + 1)
        named_pins = [
            f"{labels[i]} (k = {plain(k[0][0]) if is_scalar_matrix(k) else 'a matrix'})"
            for i, k in pins
        ]
        facts.append(("pinned", listed(named_pins, count=len(self.pinning.gains)) or "nobody"))
        for group in self.groups[:MOST_ITEMS]:
            of = f" of group {group.name}" if self.is_grouped else ""
            facts += [(f"{name}{of}", value) for name, value in group._card().facts]
        # They are about problems.
        from dobc_design.problem.contradictions import warnings
        from dobc_design.problem.meaning import remarks, time_words
        from dobc_design.problem.words import disturbance_facts, table_words

        facts += disturbance_facts(self)
        facts += [("time scales", times)] if (times := time_words(self)) else []
        facts += [("leader", self.leader)] if self.leader else []
        facts += table_words(self)
        facts += [("notes", "  ".join(self.notes))] if self.notes else []
        facts += [("warning", warning) for warning in warnings(self)]
        facts += [("look at this", remark) for remark in remarks(self)]
        text = f"{counted(self.n, 'agent')} with {counted(self.m, 'state component')} each"
        return Card(title=self.name, text=text, facts=facts)

    def __str__(self) -> str:
        from dobc_design.problem.words import describe  # it is about problems

        return describe(self)

    def __repr__(self) -> str:
        return (
            f"<Problem {self.name}: {self.network!r}, "
            f"{counted(len(self.pinning.gains), 'pinned agent')}>"
        )

    @property
    def n(self) -> int:
        """Number of agents."""
        return self.network.size

    @property
    def m(self) -> int:
        """Number of state components of one agent."""
        return len(self.target)

    @property
    def inputs(self) -> int:
        """p, the number of inputs of one agent: m but for agents with [dynamics]."""
        return self.m if self.dynamics is None else self.dynamics.inputs

    @property
    def q(self) -> int:
        """Order of the exosystem; 0 without one.  Of several groups: the sum of their orders."""
        return sum(group.exosystem.order for group in self.groups)

    @property
    def is_grouped(self) -> bool:
        """Whether agents differ in their exosystems: there are several groups, or agents without a
        disturbance."""
        return len(self.groups) > 1 or (
            len(self.groups) == 1 and len(self.groups[0].agents) < self.n
        )

    @property
    def undisturbed(self) -> tuple[str, ...]:
        """The labels of the agents without a disturbance, where others have one."""
        labels, numbers = self.network.labels, group_numbers(self.groups, self.network.labels)
        none = len(self.groups)
        return (
            tuple(x for x, number in zip(labels, numbers, strict=True) if number == none)
            if none
            else ()
        )

    @property
    def exosystem(self) -> Exosystem | None:
        """The exosystem that all agents have; None without a disturbance.  Raises: SpecError if
        they differ."""
        self.require_one_exosystem()
        return self.groups[0].exosystem if self.groups else None

    @property
    def observer(self) -> Observer:
        """The observer that all agents have.  Raises: SpecError if there are several groups."""
        self.require_one_exosystem()
        return self.groups[0].observer if self.groups else Observer()

    @property
    def joint_exosystem(self) -> Exosystem | None:
        """The exosystems of all groups side by side, A (q, q) and C (G m, q) block diagonal; of one
        group its own."""
        systems = [group.exosystem for group in self.groups]
        if len(systems) < 2:
            return systems[0] if systems else None
        return Exosystem(
            A=block_diagonal([each.A for each in systems]),
            C=block_diagonal([each.C for each in systems]),
        )

    @property
    def joint_observer(self) -> Observer:
        """W (q, G m) and P (q, q) of all groups, block diagonal, None where not every group has
        one; of one group its own."""
        own = [group.observer for group in self.groups]
        if len(own) < 2:
            return own[0] if own else Observer()
        return Observer(
            W=join([each.W for each in own]), P=join([each.P for each in own]), rate=own[0].rate
        )

    def require_integrators(self, what: str) -> None:
        """Refuse a problem with [dynamics], or optional arcs, where ``what`` does not know it.
        Raises: SpecError."""
        self.require_fixed_arcs(what)
        if self.dynamics is not None:
            cure = (
                "Use certify, verify, design, simulate, falsify, sweep, analyse, to_control or "
                "to_c, which know it."
            )
            raise about(
                "dynamics",
                f"{what} is not available yet for agents with dynamics of their own.",
                cure,
            )

    def require_fixed_arcs(self, what: str) -> None:
        """Refuse a problem with optional arcs where ``what`` does not know them.  Raises:
        SpecError."""
        if (loose := self.network.loose) is not None:
            cure = (
                "Use certify, verify, simulate, falsify, sweep or analyse, which know them; or "
                "list graphs as modes."
            )
            raise about(
                f"network.modes.{named(loose)}.optional",
                f"{what} does not know arcs that come and go.",
                cure,
            )

    def require_no_leader(self, what: str) -> None:
        """Refuse a problem with a [leader] where ``what`` does not know it.  Raises: SpecError."""
        if self.leader is not None:
            cure = (
                "Use certify, verify, simulate, sweep, analyse, build_model or to_control, "
                "which know it."
            )
            raise about("leader", f"{what} is not available yet for a target that moves.", cure)

    def require_one_exosystem(self) -> None:
        """Refuse a problem with several groups.  Raises: SpecError."""
        if self.is_grouped:
            raise about(
                "exosystem.groups",
                "this is not available yet for agents with different exosystems; it knows one"
                " exosystem that all agents share.",
                "Use certify, verify, design, simulate, falsify or to_c, which know "
                "groups; or give every agent"
                " the same A and C.",
            )

    @property
    def slopes_move(self) -> bool:
        """Whether the slopes of f move with a leader (``as_integrators``): those at one point prove
        nothing then."""
        return self.node is not None and self.leader is not None

    @property
    def leads(self) -> tuple[settings.Pair, ...]:
        """Where a leader may start, m pairs, which a goal is to be moved by; 0 without one."""
        return (
            ((Fraction(0), Fraction(0)),) * self.m if self.leader is None else self.leader.initial
        )

    @property
    def is_linear(self) -> bool:
        """Whether every coupling is exactly linear, so that J does not depend on e."""
        return all(coupling.is_linear for coupling in self.couplings)

    def coupling_place(self, listener: int, speaker: int) -> int:
        """The place of the coupling of one arc in ``couplings``."""
        return self.exception_places.get((listener, speaker), 0)

    def coupling_of(self, listener: int, speaker: int) -> Coupling:
        """The coupling of one arc."""
        return self.exceptions.get((listener, speaker), self.coupling)

    def goal_of(self, agent: int) -> Vector:
        """xbar + offset_i, where agent i is to go."""
        offset = self.offsets.get(agent)
        return (
            self.target
            if offset is None
            else tuple(x + o for x, o in zip(self.target, offset, strict=True))
        )

    def input_at(self, goal: Vector) -> Vector:
        """u0 (p,), the constant input that holds a goal; beside a leader, which no input holds, its
        offset."""
        own = None if self.dynamics is None or (self.leader and self.dynamics.f) else self.dynamics
        return (own and own.feedforward(goal)) or (Fraction(0),) * self.inputs


def _limits_of_dynamics(actuators: Actuators) -> SpecError:
    """Says that no proof counts the limits of agents with [dynamics] yet, and what simulations say
    of them."""
    limits = actuators.limit.values() if isinstance(actuators.limit, Mapping) else [actuators.limit]
    least = min((limit for limit in limits if limit is not None), default=None)
    cure = "Remove [actuators]"
    if least is not None:
        run = f"dobc stress FILE --saturation {significant(least)}"
        cure += f", certify without it, and see what the limit does in runs: {run}"
    return wrong(
        "actuators",
        "is not known for agents with [dynamics]: no proof counts their limits yet.",
        f"{cure}.",
    )


def dimension_of(
    exosystem: Exosystem | None, target: Any, coupling: Any, dynamics: Dynamics | None = None
) -> int:
    """m: that of the dynamics, else the rows of C, else the length of target, else of h, else 1
    (the contract)."""
    if dynamics is not None:
        key, m = "dynamics", dynamics.dimension
    elif exosystem is not None:
        key, m = "exosystem.C", exosystem.outputs
    elif is_list(target):
        key, m = "target", len(target)
    elif isinstance(coupling, Coupling):
        key, m = "coupling.h", coupling.dimension
    else:
        key, m = "coupling.h", len(coupling) if is_list(coupling) else 1
    if m > LARGEST_DIMENSION:
        what = f"an agent may have at most {LARGEST_DIMENSION} state components; got {m}."
        cure = "Components that do not act on each other can be problems of their own."
        raise about(key, what, cure, kind=ShapeError)
    return max(1, m)


def _check_kinds(
    *, network: object, exosystem: object, observer: object, switching: object, groups: object
) -> None:
    for key, value, kind, cure in (
        (
            "network",
            network,
            Network,
            "Make one with Network.from_arcs, from_networkx or from_sparse.",
        ),
        (
            "exosystem",
            exosystem,
            Exosystem,
            "Make one with Exosystem(A=..., C=...) or Exosystem.from_control(system).",
        ),
        (
            "observer",
            observer,
            Observer,
            "Make one with Observer(W=..., P=...) or Observer(rate=...).",
        ),
        ("switching", switching, Switching, "Make one with Switching(signal=..., dwell=...)."),
    ):
        if not isinstance(value, kind) and (value is not None or kind is Network):
            name = kind.__name__
            raise wrong(
                key, f"must be {'an' if name[0] in 'EO' else 'a'} {name}; got {shown(value)}.", cure
            )
    if groups is not None and not (
        isinstance(groups, list | tuple) and all(isinstance(x, Group) for x in groups)
    ):
        cure = "Make one with Group(agents=[...], exosystem=Exosystem(...))."
        raise wrong("groups", f"must be a list of Groups; got {shown(groups)}.", cure)


def is_name(name: object) -> bool:
    """Tell whether ``name`` can name a problem."""
    return (
        isinstance(name, str)
        and is_text(name)
        and len(name) <= 100
        and name.isprintable()
        and bool(name.strip())
    )


def _read_name(name: str) -> str:
    if not is_name(name):
        what = f"must be text of 1 to 100 printable characters; got {shown(name)}."
        raise wrong("name", what, 'For example name = "my-network".')
    return name


def _read_notes(notes: Any) -> tuple[str, ...]:
    texts = tuple(notes) if is_list(notes) else (notes,)
    for position, text in enumerate(texts):
        if not is_text(text) or len(text) > 1000 or not text.replace("\n", "").isprintable():
            what = f"must be text of at most 1000 printable characters; got {shown(text)}."
            raise wrong(f"notes[{position}]", what, "Write a list of sentences.")
    return texts


def _read_coupling(value: Any, *, dimension: int, outputs: int, key: str) -> Coupling:
    if isinstance(value, Coupling):
        if (value.dimension, value.outputs) != (dimension, outputs):
            what = (
                f"must have dimension {dimension}, one per state component; got {value.dimension}."
            )
            if outputs != dimension:
                what = (
                    f"must take {dimension} components to {outputs}; it takes "
                    f"{value.dimension} to {value.outputs}."
                )
            raise wrong(key, what, "Make it with the right dimension.", kind=ShapeError)
        return value
    return make_coupling(value, dimension=dimension, outputs=outputs, key=key)


def _read_exceptions(
    value: Any, *, network: Network, dimension: int, outputs: int
) -> Mapping[Arc, Coupling]:
    codes, n = network.arc_codes() if value else set(), network.size
    result: dict[Arc, Coupling] = {}
    errors: list[SpecError] = []
    for position, (arc, h) in enumerate(settings.items(value or {}, key="coupling.exceptions")):
        key = f"coupling.exceptions[{position}]"
        with kept(errors):
            inside = (
                is_list(arc) and len(arc) == 2 and all(type(i) is int and 0 <= i < n for i in arc)
            )
            if not inside or arc[0] * n + arc[1] not in codes:
                what = f"no mode has the arc with the indices (listener, speaker) = {shown(arc)}."
                raise about(
                    key, what, "Correct the arc, or remove the exception; indices count from 0."
                )
            result[int(arc[0]), int(arc[1])] = _read_coupling(
                h, dimension=dimension, outputs=outputs, key=f"{key}.h"
            )
        if len(errors) >= reading.MOST_ERRORS:
            break
    raise_all(errors)
    # Certificates number couplings in the order of the canonical problem, which is that of the
    # arcs.
    return MappingProxyType(dict(sorted(result.items())))


def _read_offsets(value: Any, *, labels: Sequence[str], dimension: int) -> Mapping[int, Vector]:
    def read(offset: Any, key: str) -> Vector:
        return reading.read_vector(
            offset, key=key, length=dimension, because="one per state component"
        )

    found = {} if value is None else _by_label(value, read, labels=labels, key="formation.offsets")
    return MappingProxyType({i: offset for i, offset in sorted(found.items()) if any(offset)})


def _orders(
    groups: tuple[Group, ...] | None, labels: Sequence[str], exosystem: Exosystem | None
) -> tuple[int, ...]:
    """The order of every agent's exosystem; one number if it is the same for all."""
    if groups is None:
        return (0 if exosystem is None else exosystem.order,)
    # the last one: agents without a disturbance
    orders = [*(group.exosystem.order for group in groups), 0]
    own = tuple(orders[g] for g in group_numbers(groups, labels))
    return own if len(set(own)) > 1 else own[:1]
