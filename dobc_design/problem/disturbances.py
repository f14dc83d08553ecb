"""[exosystem] of a problem file: the disturbances of all agents, given by A and C or in words, and
the groups of agents that have one of their own, or none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design.errors import Mistakes, SpecError, wrong
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import Names, is_list, is_text, shown

from .bands import KEYS, Band, bands_of, nodes, pairs_of
from .dynamics import Dynamics
from .exosystems import PARTS, Exosystem, of_parts
from .groups import Group, Groups, Observer, check_rest, group_key, in_another, renamed
from .network import no_agent
from .readings import TIMES
from .schema import EXAMPLES
from .schema_errors import Given


@noun
class Disturbances:
    """What [exosystem] says: the exosystem of the agents in no group (None: they have no
    disturbance), the groups, the bands of sines of unknown frequencies, and the lists of agents
    without a disturbance, with their keys."""

    exosystem: Exosystem | None = None
    groups: Groups = ()
    bands: tuple[Band, ...] = ()
    without: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    for_bands: bool = False  # whether ``exosystem`` is there for the bands alone

    @property
    def first(self) -> Exosystem | None:
        """That of [exosystem] itself, else of the first group."""
        if self.exosystem is None and self.groups:
            return self.groups[0].exosystem
        return self.exosystem

    def divided(
        self, labels: Names, observer: Observer | None, dynamics: Dynamics | None
    ) -> Disturbances:
        """The exosystem and the groups of a Problem, in which agents in no group have no
        disturbance where there is no exosystem: agents that share it then are a group like others.
        Raises: SpecError, also for agents
        without a disturbance that are not there, or in a group."""
        self._check_without(labels)
        listed = {str(agent) for agents in self.without.values() for agent in agents}
        others = {agent for group in self.groups for agent in group.agents} | listed
        rest = [label for label in labels if label not in others]
        if self.for_bands and self.groups and not rest:
            return Disturbances(groups=self.groups, bands=self.bands)
        if not listed or self.exosystem is None:
            return self
        own = Observer() if observer is None else Observer(W=observer.W, P=observer.P)
        check_rest(rest, self.exosystem, own, dynamics)
        group = Group(agents=rest, exosystem=self.exosystem, observer=own)
        return Disturbances(groups=(*self.groups, group), bands=self.bands)

    def _check_without(self, labels: Names) -> None:
        owner: dict[str, str] = {}
        for number, group in enumerate(self.groups):
            owner |= dict.fromkeys(group.agents, group_key(number))
        for key, agents in self.without.items():
            for place, agent in enumerate(map(str, agents)):
                own = f"{key}.agents[{place}]"
                if agent not in labels:
                    raise no_agent(agent, own)
                if agent in owner:
                    raise in_another(agent, owner[agent], own)
                owner[agent] = key


def read_exosystem(tables: Given, dimension_of: Callable[[Exosystem | None], int]) -> Disturbances:
    """The disturbances of all agents.  Raises: SpecError naming the keys.  ``dimension_of``: how
    many state components there are, for the first exosystem given by A and C, or None; one given in
    words has that many."""
    table = tables.exosystem
    if table is None:
        return Disturbances()
    errors = Mistakes()
    steps = tables.dynamics is not None and tables.dynamics.time == TIMES[1]
    # [exosystem] itself and its groups are read alike, each under its own key.
    places: dict[str, Given] = {"exosystem": table}
    for number, group in enumerate(table.groups or ()):
        places[group_key(number)] = group
    found = {place: _explicit(each, place, errors) for place, each in places.items()}
    bands: tuple[Band, ...] = ()
    pairs = 1
    with errors:
        bands = bands_of(table)
        pairs = pairs_of(table)
    errors.raise_all()
    # Disturbances in words have one part for each component, so how many there are comes first.
    m = dimension_of(next((each for each in found.values() if each is not None), None))
    for place, each in places.items():
        if found[place] is None:
            banded = bands if place == "exosystem" else ()
            poles = [w for band in banded for w in nodes(band.low, band.high, pairs)]
            found[place] = _in_words(each, place, m, errors, poles)
            if steps and found[place] is not None:
                what = "is known by its parts in continuous time only."
                cure = "Give A and C; a constant in discrete time is A = [[1]]."
                errors.append(wrong(place, what, cure))
    groups = []
    without = {}
    for number, group in enumerate(table.groups or ()):
        place = group_key(number)
        exosystem = found[place]
        try:
            observer = Observer(W=group.W, P=group.P)
            if exosystem is not None:
                agents = _labels(group.agents, f"{place}.agents")
                groups.append(Group(agents=agents, exosystem=exosystem, observer=observer))
            elif group.none:
                without[place] = _labels(group.agents, f"{place}.agents")
        except SpecError as error:
            errors.append(renamed(error, place))
    errors.raise_all()
    own = [name for name in ("A", *PARTS) if getattr(table, name) is not None]
    return Disturbances(
        exosystem=found["exosystem"],
        groups=tuple(groups),
        bands=bands,
        without=without,
        for_bands=not own,
    )


def _labels(agents: Any, key: str) -> list[Any]:
    """The agents of a group.  Raises: SpecError."""
    known = is_list(agents) and len(agents) > 0
    if not known or not all(is_text(x) or isinstance(x, str | int) for x in agents):
        raise wrong(
            key,
            f"must be a list of labels, at least one; got {shown(agents)}.",
            "For example agents = [1, 2].",
        )
    return list(agents)


def _explicit(table: Given, place: str, errors: Mistakes) -> Exosystem | None:
    """The exosystem of A and C; None where a kind stands in their place, or where groups alone are
    given."""
    matrices = [name for name in ("A", "C") if getattr(table, name) is not None]
    parts = [name for name in PARTS if getattr(table, name) is not None]
    if getattr(table, "none", None) is not None:
        _check_none(table, place, [*matrices, *parts], errors)
        return None
    if parts and matrices:
        errors.append(
            wrong(
                f"{place}.{parts[0]}",
                f"stands beside {' and '.join(matrices)}; only one of them can be used.",
                f"Give either A and C or {' and '.join(parts)}.",
            )
        )
    if parts:
        return None
    # [exosystem] may be there for its groups alone; bands alone are given poles.
    if hasattr(table, "groups") and not matrices:
        banded = any(getattr(table, key) is not None for key in KEYS)
        if table.groups or banded:
            return None
    for name in ("A", "C"):
        if name not in matrices:
            example = EXAMPLES[f"exosystem.{name}"]
            errors.append(wrong(f"{place}.{name}", "is required and missing.", f"Write {example}."))
    if len(matrices) < 2:
        return None
    try:
        return Exosystem(A=table.A, C=table.C)
    except SpecError as error:
        found = renamed(error, place)
        if "pi" in str(table.A):  # the commonest reason for pi is a sine
            cure = (
                f"For a sine write hz = [0.5] or frequencies = [3.14159265] in [{place}], in place "
                "of A and C."
            )
            found = type(found)(str(found).partition("\n")[0], key=found.key, cure=cure)
        errors.append(found)
        return None


def _check_none(table: Given, place: str, given: Names, errors: Mistakes) -> None:
    """``none`` is true, and says all that there is to say of the disturbance of its agents."""
    key = f"{place}.none"
    observed = [name for name in ("W", "P") if getattr(table, name) is not None]
    beside = " and ".join([*given, *observed])
    if table.none is not True:
        errors.append(
            wrong(
                key,
                f"must be true, for agents without a disturbance; got {shown(table.none)}.",
                "Write none = true, or leave it out and give A and C, or a part.",
            )
        )
    elif beside:
        errors.append(
            wrong(
                key,
                f"stands beside {beside}: agents without a disturbance need no observer.",
                f"Remove none, or {beside}.",
            )
        )


def _in_words(
    table: Given,
    place: str,
    components: int,
    errors: Mistakes,
    poles: Sequence[Fraction],
) -> Exosystem | None:
    """The exosystem of parts that are named, such as hz, and of sines at the ``poles`` of bands
    (rad/s); None where there are none."""
    parts = {name: getattr(table, name) for name in PARTS}
    if poles:
        given = parts["frequencies"]
        stated = list(given) if is_list(given) else [given] * (given is not None)
        # A pole that is there already makes little of the band as it is.
        there = set()
        for x in stated:
            with suppress(SpecError):  # which ``of_parts`` says
                there.add(parse_number(x, place))
        fresh = dict.fromkeys(w for w in poles if w not in there)
        parts["frequencies"] = [*stated, *fresh]
    if all(value is None for value in parts.values()):
        return None
    try:
        return of_parts(**parts, components=components)
    except SpecError as error:
        for each in error.errors:
            was = each.key or ""
            # ``of_parts`` knows one table; the key is that of the table it was read from.
            own = (was or "constant").removeprefix("exosystem").removeprefix(".")
            key = f"{place}.{own}".rstrip(".")
            message = each.message.replace(was, key, 1)
            errors.append(type(each)(message, key=key, cure=each.cure))
        return None
