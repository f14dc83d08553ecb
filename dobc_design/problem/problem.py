"""The problem: network, couplings, pins, disturbance, and what has to be proved about them.

A Problem is frozen, exact and cannot exist invalid.  It holds no solver's answer and knows no file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, fields
from fractions import Fraction
from functools import partial
from inspect import signature
from itertools import chain, islice
from types import MappingProxyType
from typing import Any

from dobc_design._checks import noun, put
from dobc_design._show.cards import MOST_ITEMS, Card, Shown, listed, plain
from dobc_design._show.text import significant
from dobc_design.coupling.coupling import Coupling, make_coupling
from dobc_design.errors import Mistakes, ShapeError, SpecError, about, misshapen, refused, wrong
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.reading import (
    Document,
    Names,
    Table,
    Texts,
    counted,
    is_list,
    is_scalar_matrix,
    is_text,
    items,
    named,
    read_vector,
    shown,
    some,
)

from .dynamics import Dynamics, check_goal
from .exosystems import Exosystem
from .fixed import Fixed, length_of, place_words, read_fixed, resting
from .groups import (
    Group,
    Grouped,
    Groups,
    Observer,
    are_different,
    group_numbers,
    read_groups,
)
from .known import check_together, require
from .leader import Leader, read_leader
from .network import Arc, Network, Places, sized
from .pinning import GainForm, Pinning, by_label, read_pinning
from .readings import (
    MOST_LOST,
    TIMES,
    Processor,
    Readings,
    check_ticks,
    read_time,
)
from .region import GOALS, Pairs, Region, read_goal, read_region, read_units
from .signs import OPPOSES, REPELS, Signs, repelling, signs_of
from .simulation import Simulation, read_simulation
from .switching import Switching, check_switching
from .tables import (
    LISTED,
    amplitude_words,
    exception_words,
    guarantee_words,
    limit_words,
    observer_words,
    offset_words,
    region_words,
    simulation_words,
    switching_words,
    uncertainty_words,
)
from .uncertainty import Actuators, Uncertainty, read_actuators

#: What is for the package itself; completion and the reference leave it out.
INTERNAL = frozenset(
    (
        "coupling_place",
        "exception_places",
        "has_target",
        "input_at",
        "joint_exosystem",
        "joint_observer",
        "leads",
        "require",
        "sources",
        "signs",
    )
)
LARGEST_DIMENSION = 100  # every gain is an m x m matrix


@noun
class Problem(Grouped, Shown):
    """A disturbance-observer-based consensus problem: equations (1), (12), (13), (19).

    Parameters (all by keyword; numbers are exact, a float means its shortest decimal text):
        network: Network.
        coupling: h as text in y (by component), or m texts in y1..ym; h(0) = 0 is checked exactly.
        exceptions: {(listener index, speaker index): h}, for arcs with a coupling of their own.
        goal: "target" (None stands for it): all agents reach it; "agreement": they agree on a value
            that nobody prescribes, without target, pins or leader; "containment": they end between
            the ``fixed`` nodes.
        fixed: {label: value}, or {label: {"between": [lo, hi]}} where it moves, for every fixed
            node of the network.  With the goal "target" there is one, at rest, which is the target.
        target: xbar, a number for all components or m numbers.
        gains: {label: k} with k >= 0 or an m x m matrix; or one number for all agents.
        exosystem: Exosystem or None (no disturbance).
        observer: Observer or None (W is designed).
        groups: Groups of agents with an exosystem and an observer of their own; ``exosystem`` and
            ``observer`` are then those of the agents in no group, who have no disturbance without
            an ``exosystem``.
        offsets: {label: offset}, the formation: agent i goes to xbar + offset_i.
        region: {"initial_states": ..., "initial_disturbance": ...} or a Region.
        switching, simulation: settings; ``simulation`` is a mapping with t_final, seed, xi0, x0.
        dynamics: Dynamics, of agents that are no integrators; couplings, gains (p x m) and C then
            have p components.
        leader: a Leader, or a mapping with initial and stays_in: the target is a solution of the
            dynamics; it knows no ``target`` then.
        uncertainty, actuators: an Uncertainty and Actuators, or mappings: bounds of model error and
            noise, limits of inputs.
        readings, processor: a Readings and a Processor, or mappings: how late and how often agents
            know what they use; whether everything is computed from samples.
        time: "continuous" (None stands for it), or "discrete": x_i+ = x_i + couplings + u_i + d_i
            and xi+ = A xi; times are counted in steps then.
        name: of the problem; results are saved under it.
        units: of the states, such as "m/s", or one for each component; words and figures show them.
        notes: sentences on what is assumed or stands in; they are shown wherever a result is shown.
    Further attributes:
        pinning: who is pinned, with which gains.
        couplings: the default one and those of the exceptions, each once.
        steps: whether agents move in discrete time.
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
    goal: str
    fixed: Fixed
    target: Vector
    pinning: Pinning
    groups: Groups
    offsets: Mapping[int, Vector]
    region: Region | None
    switching: Switching | None
    simulation: Simulation
    uncertainty: Uncertainty | None
    actuators: Actuators | None
    dynamics: Dynamics | None
    leader: Leader | None
    readings: Readings | None
    processor: Processor | None
    steps: bool
    notes: Texts
    units: Texts
    couplings: tuple[Coupling, ...] = field(init=False, compare=False)
    # the place among them of the coupling of every arc with its own
    exception_places: Places = field(init=False, compare=False)
    # where some agents oppose others; None where nobody does
    signs: Signs | None = field(init=False, compare=False)

    def __init__(
        self,
        *,
        network: Network,
        coupling: str | Names | Coupling,
        exceptions: Mapping[Arc, str | Names | Coupling] | None = None,
        goal: str | None = None,
        fixed: Table | None = None,
        target: Any = 0,
        gains: Any = None,
        mode_gains: Table | None = None,
        exosystem: Exosystem | None = None,
        observer: Observer | None = None,
        groups: Sequence[Group] | None = None,
        offsets: Mapping[Any, Any] | None = None,
        region: Region | Table | None = None,
        switching: Switching | None = None,
        simulation: Simulation | Table | None = None,
        uncertainty: Uncertainty | Table | None = None,
        actuators: Actuators | Table | None = None,
        dynamics: Dynamics | Table | None = None,
        leader: Leader | Table | None = None,
        readings: Readings | Table | None = None,
        processor: Processor | Table | None = None,
        time: str | None = None,
        name: str = "problem",
        notes: Names = (),
        units: str | Names | None = None,
    ) -> None:
        _check_kinds(network=network, exosystem=exosystem, observer=observer, switching=switching)
        _check_groups(groups)
        if network.negative == REPELS:
            # Arcs with -h are known to everything below.
            network, exceptions = _with_repelling(network, coupling, exceptions)
        # Everything below needs to know how many components there are: these two raise at once.
        own = Dynamics(**dynamics) if isinstance(dynamics, Mapping) else dynamics
        first = exosystem
        if exosystem is None and groups:
            first = groups[0].exosystem
        m = dimension_of(first, target or length_of(fixed), coupling, own)
        p = m if own is None else own.inputs
        labels = network.labels
        made = partial(_read_coupling, dimension=m if own is None else own.felt, outputs=p)
        put(self, network=network, dynamics=own)

        def read_gains() -> Pinning:
            form = GainForm.of(m, own, getattr(self, "coupling", None))
            return read_pinning(gains, network=network, form=form, mode_gains=mode_gains)

        def read_runs() -> Simulation | None:
            # With a mistake in the groups nobody knows how long the rows of xi0 have to be.
            known = getattr(self, "groups", None)
            if known is None and groups:
                return None
            orders = _orders(known, labels, exosystem)
            return read_simulation(simulation, n=network.size, orders=orders, m=m)

        # All are read, so that every mistake is told at once.
        parts: dict[str, Callable[[], object]] = {
            "name": lambda: _read_name(name),
            "groups": lambda: read_groups(
                groups,
                exosystem=exosystem,
                observer=observer,
                labels=labels,
                m=p,
                dynamics=own,
            ),
            "goal": lambda: read_goal(goal),
            "fixed": lambda: read_fixed(fixed, names=network.fixed, dimension=m),
            "target": lambda: _read_states(target, key="target", length=m),
            "coupling": lambda: made(coupling, key="coupling.h"),
            "exceptions": lambda: _read_exceptions(exceptions, network, made),
            "pinning": read_gains,
            "offsets": lambda: _read_offsets(offsets, labels=labels, dimension=m),
            "region": lambda: read_region(region, dimension=m, with_exosystem=first is not None),
            "switching": lambda: check_switching(switching, tuple(network.modes)),
            "simulation": read_runs,
            "uncertainty": lambda: Uncertainty.stated(uncertainty),
            "actuators": lambda: read_actuators(actuators, labels),
            "leader": lambda: read_leader(leader, dynamics=own),
            "readings": lambda: Readings.stated(readings),
            "processor": lambda: Processor.stated(processor),
            "steps": lambda: read_time(time),
            "notes": lambda: _read_notes(notes),
            "units": lambda: read_units(units, dimension=m),
        }
        errors = Mistakes()
        for part, read in parts.items():
            with errors:
                put(self, **{part: read()})
        errors.raise_all()
        arcs = chain.from_iterable(network.modes.values())
        opposes = network.negative == OPPOSES
        put(self, signs=signs_of(self.n, arcs, self.pinning.agents) if opposes else None)
        check_together(self)
        self._check_ages()
        self._check_goal()
        self._check_dynamics()
        # Arcs name a coupling by its place, so that equal ones are bounded once.
        couplings = dict.fromkeys((self.coupling, *self.exceptions.values()))
        places = {each: place for place, each in enumerate(couplings)}
        put(self, couplings=tuple(places))
        put(self, exception_places={arc: places[each] for arc, each in self.exceptions.items()})

    def _check_ages(self) -> None:
        """Ages are counted in ticks, of which there are not too many.  Raises: SpecError."""
        for path in ("readings.delay", "readings.own_delay", "actuators.delay"):
            table, _, name = path.partition(".")
            age = getattr(getattr(self, table), name, None) or ZERO
            if self.period is not None and age > MOST_LOST * self.period:
                raise wrong(
                    path,
                    f"must be at most {MOST_LOST} periods, which last {significant(self.period)} s "
                    f"each; got {significant(age)} s.",
                    "Is one of them in another unit?",
                )
            if table == "actuators" and self.processor is not None:
                check_ticks(age, self.processor.period, key="processor.period")

    def _check_goal(self) -> None:
        """Nobody agrees alone; one fixed node at rest is the target.  Raises: SpecError."""
        if self.goal == "agreement" and self.n < 2:
            raise wrong("goal", "needs two agents or more to agree.", "Add agents.")
        if not (self.fixed and self.has_target):
            return
        value = resting(next(iter(self.fixed.values())))
        if len(self.fixed) > 1 or value is None:
            raise wrong(
                "fixed",
                "has several nodes, or one that moves: there is no single target to reach.",
                'Write goal = "containment", or keep one node at rest.',
            )
        if any(self.target) and self.target != value:
            raise wrong(
                "target",
                "is another one than the node in [fixed], which is the target.",
                "Remove it.",
            )
        put(self, target=value)

    def _check_dynamics(self) -> None:
        """With [dynamics] goals have to be equilibria; what is not known for them is refused."""
        own = self.dynamics
        if own is None:
            return
        if self.actuators is not None:
            raise _limits_of_dynamics(self.actuators)
        if self.leader is None:
            check_goal(own, self.target, key="target")
        elif any(self.target):
            raise wrong(
                "target",
                "must be left out, or 0, with a [leader], which is the target.",
                "Remove it.",
            )
        # The slopes of f at the target have to be rational.
        own.about(self.target)
        if self.offsets and own.f is not None:
            raise wrong(
                "formation", "is known for agents with A only, not with f.", "Remove [formation]."
            )
        for agent in self.offsets:
            key = f"formation.offsets.{self.network.labels[agent]}"
            check_goal(own, self.goal_of(agent), key=key)

    def __dir__(self) -> list[str]:
        return [name for name in object.__dir__(self) if name not in INTERNAL]

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
        # A misspelt argument would otherwise be reported by Python, without a cure.
        known = signature(Problem).parameters
        for name in changes:
            if name not in known:
                raise refused(
                    name,
                    f"a problem has no argument {name!r}.",
                    f"Its arguments are {', '.join(known)}.",
                )
        self._check_same_agents(changes)
        for name in ("region", "simulation"):
            old = getattr(self, name)
            if old is None or not isinstance(changes.get(name), Mapping):
                continue
            values = {each.name: getattr(old, each.name) for each in fields(old)}
            given = {key: value for key, value in values.items() if value is not None}
            changes[name] = given | changes[name]
        return Problem(**self._arguments() | changes)

    def _check_same_agents(self, changes: Table) -> None:
        """What belongs to agents has to be given anew for others.  Raises: SpecError."""
        network = changes.get("network")
        if not isinstance(network, Network) or (
            network.names == self.network.names and network.size == self.n
        ):
            return
        # One row serves everybody; a row for each agent belongs to these agents.
        starts = max(len(self.simulation.x0 or ()), len(self.simulation.xi0 or ())) > 1
        own = {
            "gains": self.pinning.gains,
            "mode_gains": self.pinning.modes,
            "exceptions": self.exceptions,
            "simulation": starts,
        }
        missing = [name for name, value in own.items() if value and name not in changes]
        if missing:
            raise wrong(
                "network",
                "has other agents, or the same in another order.",
                f"Give {' and '.join(missing)} for these agents too.",
            )

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(Problem, **self._arguments()), ()  # the read-only mappings cannot be pickled

    def _arguments(self) -> Document:
        """The arguments that make this problem; most are attributes of the same name."""
        labels = self.network.labels
        found = {
            "gains": Pinning(gains=self.pinning.gains),
            "mode_gains": self.pinning.labelled(labels),
            "exceptions": dict(self.exceptions),
            "fixed": {label: {"between": place} for label, place in self.fixed.items()},
            "offsets": {labels[i]: offset for i, offset in self.offsets.items()},
            "groups": None,
            "exosystem": None,
            "observer": None,
            "time": TIMES[1] if self.steps else None,
        }
        if self.is_grouped:  # agents in no group have no disturbance
            found["groups"] = self.groups
            found["observer"] = Observer(rate=self.groups[0].observer.rate)
        elif self.groups:
            found["exosystem"] = self.exosystem
            found["observer"] = self.observer
        for name in signature(Problem).parameters:
            if name not in found:
                found[name] = getattr(self, name)
        return found

    def plot(self, mode: str | None = None, ax: Any = None) -> Any:
        """The network as a picture: every mode, at most six, or ``mode`` alone.  An arrow points to
        the agent that listens; pinned agents and fixed nodes are blue squares; an agent that no
        path of arcs joins to one is dashed.  Up to 24 arcs of a mode have their weights beside
        them, unless all are 1.  Positions say nothing.

        Returns: a Sheet, which shows itself in Jupyter and saves itself, ``save("network.svg")``;
        with Matplotlib's ``ax`` these axes, with ``mode``, by default the first.
        Raises: SpecError for a mode that does not exist, or too many agents or arcs to be drawn.
        Example:
            >>> sheet = dd.load_problem("paper-switching").plot()
            >>> len(sheet.figure.axes)  # one for each mode
            4
        """
        from dobc_design.plotting.networks import network_sheet

        network = self.network
        names = network.modes if mode is None else (network.require_mode(mode),)
        modes = {name: {(i, j): w for i, j, w in network.modes[name]} for name in names}
        pinned = {name: self.sources(name) for name in modes}
        word = "fixed node" if self.fixed else "pinned"
        return network_sheet(
            self.name, modes, labels=network.names, pinned=pinned, word=word, ax=ax
        )

    def sources(self, mode: str) -> tuple[int, ...]:
        """The nodes from which agents have to be reached in a mode: pinned agents, and fixed nodes,
        which are numbered after all agents."""
        fixed = range(self.n, self.n + len(self.fixed))
        return (*self.pinning.of(mode), *fixed)

    def _card(self) -> Card:
        facts = [*self.coupling._card().facts, *self._facts()]
        return Card(title=self.name, text=self._size(), facts=facts)

    def __str__(self) -> str:
        lines = [f"{self.name}: {self._size()}", f"coupling: h = {'; '.join(self.coupling.texts)}"]
        for name, value in self._facts():
            lines.append(f"{name}: {value if isinstance(value, str) else plain(value)}")
        return "\n  ".join(lines)

    def _size(self) -> str:
        return f"{counted(self.n, 'agent')} with {counted(self.m, 'state component')} each"

    def _facts(self) -> Iterator[tuple[str, Any]]:
        """What is stated, as it is; what it means is computed for ``dobc check``."""
        if self.goal == "target":
            yield "target", self.target[0] if self.m == 1 else (self.target,)
        else:
            yield "goal", self.goal
        for label, place in self.fixed.items():
            yield f"fixed {named(label)}", place_words(place, self.unit)
        if self.units:
            yield "units", ", ".join(self.units)
        if self.dynamics is not None:
            for name, value in self.dynamics._card().facts:
                yield f"dynamics.{name}", value
        modes = self.network.modes
        few = islice(modes.items(), MOST_ITEMS + 1)
        arcs = [f"{name} ({counted(len(each), 'arc')})" for name, each in few]
        yield "modes", listed(arcs, count=len(modes))
        pinning = self.pinning
        if pinning.gains or not pinning.modes:
            yield "pinned", self._pins(pinning.gains) or "nobody"
        for mode, gains in islice(pinning.modes.items(), MOST_ITEMS):
            yield f"pinned in {mode}", self._pins(gains)
        for group in self.groups[:MOST_ITEMS]:
            of = f" of group {group.name}" if self.is_grouped else ""
            for name, value in group._card().facts:
                yield f"{name}{of}", value
        if self.undisturbed:
            yield f"disturbance of {some(self.undisturbed, LISTED)}", "none"
        for name in ("leader", "readings", "processor"):
            if getattr(self, name) is not None:
                yield name, getattr(self, name)
        if self.steps:
            yield "time", TIMES[1]
        yield from table_words(self)
        if self.notes:
            yield "notes", "  ".join(self.notes)

    def _pins(self, gains: Mapping[int, Any]) -> str:
        """Some pins with their gains."""
        pins = []
        for i, k in islice(gains.items(), MOST_ITEMS + 1):
            gain = plain(k[0][0]) if is_scalar_matrix(k) else "a matrix"
            pins.append(f"{self.network.labels[i]} (k = {gain})")
        return listed(pins, count=len(gains))

    def __repr__(self) -> str:
        pinned = counted(len(self.pinning.agents), "pinned agent")
        return f"<Problem {self.name}: {self.network!r}, {pinned}>"

    @property
    def gains(self) -> Document:
        """Label of each agent that is pinned in every mode -> its gain k, a Fraction, or rows of an
        m x m (p x m) matrix; in 1/s.  Pins of single modes: ``pinning.modes``.

        Example:
            >>> dd.load_problem("paper-fixed").gains
            {'1': Fraction(5, 1), '6': Fraction(5, 1)}
        """
        labels = self.network.labels
        return {
            labels[i]: k[0][0] if is_scalar_matrix(k) else k for i, k in self.pinning.gains.items()
        }

    @property
    def n(self) -> int:
        """Number of agents."""
        return self.network.size

    @property
    def outputs(self) -> Matrix | None:
        """H of y = H x, where agents measure outputs; else None."""
        return None if self.dynamics is None else self.dynamics.H

    @property
    def has_target(self) -> bool:
        """Whether agents are to reach a target, or a leader."""
        return self.goal == GOALS[0]

    @property
    def agrees(self) -> bool:
        """Whether agents are to agree on a value that nobody prescribes."""
        if self.signs is not None and self.signs.sides is None:
            return False  # by signs that do not balance they can meet at 0 only
        return self.goal == "agreement"

    @property
    def m(self) -> int:
        """Number of state components of one agent."""
        return len(self.target)

    @property
    def unit(self) -> str:
        """The unit that all state components share, "" where they do not or none is given."""
        return self.units[0] if len(set(self.units)) == 1 else ""

    @property
    def period(self) -> Fraction | None:
        """The time between two ticks, at which readings are used (s); 1 step in discrete time; None
        where they always are."""
        if self.steps:
            return ONE
        table = self.processor or self.readings
        return None if table is None else table.period

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
        return are_different(self.groups, self.n)

    @property
    def undisturbed(self) -> Texts:
        """The labels of the agents without a disturbance, where others have one."""
        if not self.groups:
            return ()
        labels, none = self.network.labels, len(self.groups)
        numbers = group_numbers(self.groups, labels)
        return tuple(x for x, number in zip(labels, numbers, strict=True) if number == none)

    @property
    def exosystem(self) -> Exosystem | None:
        """The exosystem that all agents have; None without a disturbance.  Raises: SpecError if
        they differ."""
        self.require("this")
        return self.groups[0].exosystem if self.groups else None

    @property
    def observer(self) -> Observer:
        """The observer that all agents have.  Raises: SpecError if there are several groups."""
        self.require("this")
        return self.groups[0].observer if self.groups else Observer()

    def require(self, what: str) -> None:
        """Refuse a problem that ``what``, a part of the program, does not know (``known.toml``).
        Raises: SpecError."""
        require(self, what)

    @property
    def leads(self) -> Pairs:
        """Where a leader may start, m pairs, which a goal is to be moved by; 0 without one."""
        if self.leader is not None:
            return self.leader.initial
        return ((ZERO, ZERO),) * self.m

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
        """xbar + offset_i, where agent i is to go; -xbar + offset_i on the side that opposes the
        first one."""
        target = self.target
        if self.signs is not None:
            target = tuple(self.signs.side(agent) * x for x in target)
        offset = self.offsets.get(agent)
        if offset is None:
            return target
        return tuple(x + o for x, o in zip(target, offset, strict=True))

    def input_at(self, goal: Vector) -> Vector:
        """u0 (p,), the constant input that holds a goal; beside a leader, which no input holds, its
        offset."""
        # The input that holds a goal is an affair of the dynamics; single integrators need none.
        own = self.dynamics
        if own is not None and not (self.leader and own.f):
            held = own.feedforward(goal)
            if held is not None:
                return held
        return (ZERO,) * self.inputs


def table_words(problem: Problem) -> Iterator[tuple[str, str]]:
    """What the tables of the file beside network, pins and disturbance say: a name, and the rest of
    a sentence."""
    labels, modes = problem.network.labels, tuple(problem.network.modes)
    if problem.exceptions:
        yield "other couplings", exception_words(problem.exceptions, labels)
    if problem.offsets:
        yield "formation offsets", offset_words(problem.offsets, labels, problem.units)
    for group in problem.groups[:LISTED]:
        of = f" of {some(group.agents, LISTED)}" if problem.is_grouped else ""
        said = observer_words(group.observer)
        W = group.observer.W
        if W is not None and problem.outputs is not None:
            said = f"{len(W)} x {len(W[0])}, for states and disturbance together"
        yield f"observer gain W{of}", said
    if problem.region is not None:
        yield "region asked for", region_words(problem.region, problem.units)
    if problem.actuators is not None:
        said = limit_words(problem.actuators, problem.n)
        if problem.groups or problem.actuators.amplitude is not None:
            said += f"; {amplitude_words(problem.actuators, problem.simulation)}"
        yield "actuators", said
    if problem.uncertainty is not None:
        yield "uncertainty", uncertainty_words(problem.uncertainty)
    if problem.switching is not None:
        yield "switching in simulations", switching_words(problem.switching, modes)
    assumed = guarantee_words(problem.switching, modes)
    if assumed:
        yield "proofs may assume", assumed
    yield "simulations", simulation_words(problem.simulation, "steps" if problem.steps else "s")


def _limits_of_dynamics(actuators: Actuators) -> SpecError:
    """Says that no proof counts the limits of agents with [dynamics] yet, and what simulations say
    of them."""
    what = "is not known for agents with [dynamics]: no proof counts their limits yet."
    # The smallest limit is the one that a run meets first.
    limits = [actuators.limit]
    if isinstance(actuators.limit, Mapping):
        limits = list(actuators.limit.values())
    known = [limit for limit in limits if isinstance(limit, Fraction)]
    if not known:
        return wrong("actuators", what, "Remove [actuators].")
    run = f"dobc stress FILE --saturation {significant(min(known))}"
    return wrong(
        "actuators",
        what,
        f"Remove [actuators], certify without it, and see what the limit does in runs: {run}.",
    )


def dimension_of(
    exosystem: Exosystem | None, target: Any, coupling: Any, dynamics: Dynamics | None = None
) -> int:
    """m: that of the dynamics, else the rows of C, else the length of target, else of h, else 1
    (the contract)."""
    # The noun that is surest of it decides, and its key is named where it is too large.
    key, m = "coupling.h", 1
    if dynamics is not None:
        key, m = "dynamics", dynamics.dimension
    elif exosystem is not None:
        key, m = "exosystem.C", exosystem.outputs
    elif is_list(target):
        key, m = "target", len(target)
    elif isinstance(coupling, Coupling):
        m = coupling.dimension
    elif is_list(coupling):
        m = len(coupling)
    if m > LARGEST_DIMENSION:
        raise about(
            key,
            f"an agent may have at most {LARGEST_DIMENSION} state components; got {m}.",
            "Components that do not act on each other can be problems of their own.",
            kind=ShapeError,
        )
    return max(1, m)


#: The nouns among the arguments of a Problem, and how somebody makes one.
_KINDS = {
    "network": (Network, "Make one with Network.from_arcs, from_networkx or from_sparse."),
    "exosystem": (
        Exosystem,
        "Make one with Exosystem(A, C) or Exosystem(system), with a control.StateSpace.",
    ),
    "observer": (Observer, "Make one with Observer(W=..., P=...) or Observer(rate=...)."),
    "switching": (Switching, "Make one with Switching(signal=..., dwell=...)."),
}


def _check_kinds(**given: object) -> None:
    """Refuse what is no noun of its kind; only a network has to be given."""
    for key, value in given.items():
        kind, cure = _KINDS[key]
        if isinstance(value, kind) or (value is None and kind is not Network):
            continue
        a = "an" if kind.__name__[0] in "EO" else "a"
        raise wrong(key, f"must be {a} {kind.__name__}; got {shown(value)}.", cure)


def _check_groups(groups: object) -> None:
    if groups is None:
        return
    if not isinstance(groups, list | tuple) or not all(isinstance(x, Group) for x in groups):
        raise wrong(
            "groups",
            f"must be a list of Groups; got {shown(groups)}.",
            "Make one with Group(agents=[...], exosystem=Exosystem(...)).",
        )


def is_name(name: object) -> bool:
    """Tell whether ``name`` can name a problem."""
    if not isinstance(name, str) or not is_text(name):
        return False
    return len(name) <= 100 and name.isprintable() and bool(name.strip())


def _read_name(name: str) -> str:
    if not is_name(name):
        raise wrong(
            "name",
            f"must be text of 1 to 100 printable characters; got {shown(name)}.",
            'For example name = "my-network".',
        )
    return name


_read_states = partial(read_vector, because="one per state component")


def _read_notes(notes: Any) -> Texts:
    texts = tuple(notes) if is_list(notes) else (notes,)
    for position, text in enumerate(texts):
        if not is_text(text) or len(text) > 1000 or not text.replace("\n", "").isprintable():
            raise wrong(
                f"notes[{position}]",
                f"must be text of at most 1000 printable characters; got {shown(text)}.",
                "Write a list of sentences.",
            )
    return texts


def _read_coupling(value: Any, *, dimension: int, outputs: int, key: str) -> Coupling:
    """A coupling of the right size, or the one that a text says."""
    if not isinstance(value, Coupling):
        return make_coupling(value, dimension=dimension, outputs=outputs, key=key)
    if (value.dimension, value.outputs) == (dimension, outputs):
        return value
    what = f"must have dimension {dimension}, one per state component; got {value.dimension}."
    if outputs != dimension:
        what = f"must take {dimension} components to {outputs};"
        what += f" it takes {value.dimension} to {value.outputs}."
    raise misshapen(key, what, "Make it with the right dimension.")


def _with_repelling(
    network: Network, coupling: Any, exceptions: Mapping[Arc, Any] | None
) -> tuple[Network, Mapping[Arc, Any]]:
    """The network with positive weights only, and -h as the coupling of arcs that repel."""
    signs: dict[Arc, bool] = {}
    for i, j, weight in chain.from_iterable(network.modes.values()):
        if signs.setdefault((i, j), weight < 0) != (weight < 0):
            listener, speaker = (named(network.labels[agent]) for agent in (i, j))
            raise about(
                "network.modes",
                f"{listener} listens to {speaker} with weights of both signs; an arc that repels "
                "does so in every mode.",
                "Give it one sign, or leave it out of a mode.",
            )
    modes = {name: sized(arcs) for name, arcs in network.modes.items()}
    arcs = (arc for arc, is_negative in signs.items() if is_negative)
    return Network(labels=network.labels, modes=modes), repelling(coupling, exceptions, arcs)


def _read_exceptions(
    value: Any, network: Network, made: Callable[..., Coupling]
) -> Mapping[Arc, Coupling]:
    """The couplings of single arcs, by the indices of listener and speaker, in their order."""
    codes, n = network.arc_codes() if value else set(), len(network.names)
    result = {}
    errors = Mistakes()
    given = items(value or {}, "coupling.exceptions")
    for position, (arc, h) in errors.few(enumerate(given)):
        key = f"coupling.exceptions[{position}]"
        with errors:
            if not _is_arc(arc, n) or arc[0] * n + arc[1] not in codes:
                raise about(
                    key,
                    f"no mode has the arc with the indices (listener, speaker) = {shown(arc)}.",
                    "Correct the arc, or remove the exception; indices count from 0.",
                )
            result[int(arc[0]), int(arc[1])] = made(h, key=f"{key}.h")
    errors.raise_all()
    # Certificates number couplings in the order of the canonical problem, which is that of the
    # arcs.
    return MappingProxyType(dict(sorted(result.items())))


def _is_arc(arc: Any, n: int) -> bool:
    """Whether it is a pair of indices of agents."""
    if not is_list(arc) or len(arc) != 2:
        return False
    return all(type(i) is int and 0 <= i < n for i in arc)


def _read_offsets(value: Any, *, labels: Names, dimension: int) -> Mapping[int, Vector]:
    """Where agents go from the target, by index; 0 is left out."""

    def read(offset: Any, key: str) -> Vector:
        return _read_states(offset, key=key, length=dimension)

    if value is None:
        return MappingProxyType({})
    found = by_label(value, read, labels=labels, key="formation.offsets")
    return MappingProxyType({i: offset for i, offset in sorted(found.items()) if any(offset)})


def _orders(groups: Groups | None, labels: Names, exosystem: Exosystem | None) -> tuple[int, ...]:
    """The order of every agent's exosystem; one number if it is the same for all."""
    if groups is None:
        return (0 if exosystem is None else exosystem.order,)
    # the last one: agents without a disturbance
    orders = [*(group.exosystem.order for group in groups), 0]
    own = tuple(orders[g] for g in group_numbers(groups, labels))
    return own if len(set(own)) > 1 else own[:1]
