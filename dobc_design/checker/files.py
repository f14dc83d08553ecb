"""What problem.json states: read and refused, nothing computed from it. The problem is trusted.

What the claims are about is made of it in loop.py.

Agents with the same exosystem are a group; a problem with one exosystem has one group of all
agents. Where there are groups, an agent in none of them has no disturbance.
"""

import hashlib
from collections.abc import Collection
from functools import partial
from itertools import pairwise
from typing import Any

from .expressions import LONGEST
from .matrices import echelon
from .reading import (
    Object,
    an_object,
    as_hashed,
    document,
    index,
    integer,
    matrix,
    maybe,
    need,
    one_of,
    rational,
    read,
    text,
)

#: The numbers of `uncertainty`.
ERRORS = ("weights", "gains", "disturbance", "drift", "measurement")
#: Those of `readings`.
AGES = ("delay", "own_delay", "event")
LOST = 1000


class Problem:
    """problem.json: ``stated`` has its parts as they are written, numbers as Fractions."""

    def __init__(self, data: bytes) -> None:
        source = document(data, "dobc-problem")
        self.sha256 = hashlib.sha256(as_hashed(source)).hexdigest()
        self.labels = read(source.get("labels"), [text])
        self.n = len(self.labels)
        self.m = integer(source.get("dimension"))
        # limits and bounds are looked up by labels
        need(0 < self.n == len(set(self.labels)), "labels have to be different, and at least one")
        need(1 <= self.m <= 100, "the dimension is not between 1 and 100")
        self.dynamics = self.read_dynamics(source.get("dynamics"))
        #: The fixed nodes: a name, and where each may be.
        self.fixed = read(source.get("fixed", []), [(text, matrix(self.m, 2))])
        names = [name for name, _ in self.fixed]
        need(len({*names, *self.labels}) == len(names) + self.n, "two nodes have one name")
        ordered = all(lo <= hi for _, place in self.fixed for lo, hi in place)
        need(ordered, "a fixed node has bounds in the wrong order")
        #: How many inputs an agent has: what couplings, gains and disturbances act on.
        self.inputs = self.m if self.dynamics is None else len(self.dynamics.B[0])
        #: What couplings and pins act on: states, or measured outputs.
        self.felt = self.m
        if self.dynamics is not None and self.dynamics.acts_on is not None:
            self.felt = len(self.dynamics.H)
        self.stated = read(source, self.shape())
        self.read_leader()
        self.read_fixed("fixed" in source)
        self.read_agreement()
        self.read_times()
        modes = self.stated.modes
        different = 0 < len(modes) == len({mode.name for mode in modes})
        need(different, "modes have to be different, and at least one")
        self.groups = self.read_groups(self.stated.exosystem, self.stated.observer)
        self.read_bands()
        self.read_outputs()

    def shape(self) -> Object:
        """The shape of the file."""
        agent = partial(index, self.n)
        node = partial(index, self.n + len(self.fixed))
        states = (rational,) * self.m
        sides = matrix(self.m, 2)
        arcs = [(agent, node, rational)]
        exception = {"arc": (agent, node), "h": self.read_h}
        gains = [(agent, matrix(self.inputs, self.felt))]
        uncertainty: Object = dict.fromkeys(ERRORS, rational)
        uncertainty["known_to_agents"] = partial(one_of, (bool,))
        uncertainty["bands?"] = [(rational,) * 3]
        region = {"initial_states": sides, "initial_disturbance": maybe(rational)}
        return {
            "version": None,
            "labels": None,
            "dimension": None,
            "switching": maybe(an_object),
            "dynamics?": None,
            "format": text,
            "name": text,
            "notes": [text],
            "goal?": partial(word, ("agreement", "containment")),
            "fixed?": None,
            "negative?": partial(word, ("opposes",)),
            "units?": (text,) * self.m,  # for words and figures; no claim depends on them
            "target": states,
            "modes": [{"name": text, "arcs": arcs, "optional?": arcs, "gains?": gains}],
            "coupling": {"h": self.read_h, "exceptions": [exception]},
            "gains": gains,
            "exosystem": maybe(an_object),
            "offsets": [(agent, states)],
            "observer": {"W": None, "P": None, "rate": maybe(rational)},
            "uncertainty?": uncertainty,
            "actuators?": {
                "limit": self.read_limit,
                "amplitude": maybe(rational),
                "saturates?": partial(one_of, (bool,)),
                "delay?": rational,
            },
            "readings?": {**dict.fromkeys(AGES, rational), "period?": rational, "lost": integer},
            "processor?": {"period": rational},
            "time?": partial(word, ("discrete",)),
            "leader?": {"initial": sides, "stays_in?": sides},
            "simulation": an_object,
            "region": maybe(region),
        }

    def read_h(self, value: Any) -> tuple[str, ...]:
        """One expression, or one per input."""
        h = (value,) if type(value) is str else tuple(read(value, (text,) * self.inputs))
        need(all(len(each) <= LONGEST for each in h), "an expression of a coupling is too long")
        return h

    def read_dynamics(self, value: Any) -> Any:
        """A or f, and B, of the agents; none for integrators."""
        if value is None:
            return None
        rows = an_object(value).get("B") or [0]
        columns = len(rows[0]) if type(rows) is list and type(rows[0]) is list else 0
        need(1 <= columns <= self.m, "B has to have 1 to m columns")
        shape = {"A?": matrix(self.m, self.m), "f?": (text,) * self.m, "B": matrix(self.m, columns)}
        measured = an_object(value).get("H")
        r = len(measured) if type(measured) is list else 1
        shape |= {"H?": matrix(r, self.m), "acts_on?": partial(word, ("outputs",))}
        dynamics = read(value, shape)
        if dynamics.H is not None:
            independent = 0 < r == len(echelon(dynamics.H)[0])
            need(independent, "H has dependent rows, or none")
            need(dynamics.A is not None, "outputs are known for linear agents")
        need(dynamics.H is not None or dynamics.acts_on is None, "there are no outputs to act on")
        # `A` and `f` say the same thing in two ways
        need((dynamics.A is None) is not (dynamics.f is None), "there has to be either A or f")
        # else B+ = (B'B)^-1 B' does not exist
        need(len(echelon(dynamics.B)[0]) == columns, "B has dependent columns")
        return dynamics

    def read_leader(self) -> None:
        """A leader has dynamics, and starts between bounds."""
        leader = self.stated.leader
        if leader is None:
            return
        about_leader = self.dynamics is not None and not any(self.stated.target)
        need(about_leader, "a leader needs dynamics, and the target has to be 0")
        ordered = all(lo <= hi for lo, hi in leader.initial)
        need(ordered, "a leader starts between bounds in the wrong order")

    def read_fixed(self, given: bool) -> None:
        """Fixed nodes are between what agents end, or one of them, at rest, is the target."""
        stated = self.stated
        goal = stated.goal
        need(bool(self.fixed) is given, "there is no fixed node")
        need(goal != "containment" or given, "there is no fixed node to end between")
        if not given:
            return
        alone = goal != "agreement" and self.dynamics is None and stated.negative is None
        need(alone, "fixed nodes are known for a target, or to end between, without dynamics")
        if goal is None:
            rests = [[x, x] for x in stated.target]
            need([place for _, place in self.fixed] == [rests], "the target is not the fixed node")
            return
        tables = (stated.uncertainty, stated.actuators)
        need(tables == (None, None), "tables of the plant are about one target")
        pins = stated.gains or any(mode.gains for mode in stated.modes)
        pulled = any(stated.target) or stated.offsets or pins
        need(not pulled, "there is a target beside the fixed nodes")

    def read_agreement(self) -> None:
        """Nobody prescribes the value on which agents agree."""
        stated = self.stated
        if stated.goal != "agreement":
            return
        need(self.n > 1, "agreement needs two agents")
        pins = [stated.gains, *(mode.gains for mode in stated.modes)]
        free = not any(pins) and not any(stated.target) and stated.leader is None
        need(free, "agents that agree have no pins, no target and no leader")
        linear = self.dynamics is None or self.dynamics.f is None
        # f(x_i) - f(x_j) is no function of x_i - x_j
        need(linear, "agents that agree have no f")

    def read_times(self) -> None:
        """How late and how often agents know what they use."""
        late = self.stated.readings
        periods = [self.stated.processor, late]
        periods = [each.period for each in periods if each is not None and each.period is not None]
        ticks = len(periods) + (self.stated.time is not None)
        need(ticks <= 1 and min(periods, default=1) > 0, "there are two periods, or one is not > 0")
        sampled = self.stated.processor is not None or self.stated.time is not None
        need(self.dynamics is None or not sampled, "agents move by themselves between samples")
        if late is not None:
            need(min(late.delay, late.own_delay, late.event) >= 0, "an age is negative")
            need(late.event < 1, "the threshold of an event is a part")
            need(0 <= late.lost <= LOST, "so many readings are not lost")
            need(ticks == 1 or not late.lost, "readings are lost at the ticks of a period")
        table = self.stated.actuators
        if table is not None and table.delay is not None:
            alone = not (self.dynamics or self.fixed or self.stated.goal)
            known = alone and not table.saturates and table.delay > 0
            need(known, "inputs that act late do so uncut, and towards a target")
            processor = self.stated.processor
            at_ticks = processor is not None and table.delay % processor.period == 0
            need(at_ticks or not ticks, "inputs that act late do so at all times, or at ticks")

    def read_bands(self) -> None:
        """Sines of unknown frequencies, of which observers in continuous time make little."""
        bands = (self.stated.uncertainty and self.stated.uncertainty.bands) or []
        ordered = all(0 <= low <= high > 0 and size > 0 for low, high, size in bands)
        need(ordered, "a band has bounds in the wrong order, or no amplitude")
        observed = bool(self.groups) and self.stated.time is None
        need(observed or not bands, "there are bands, and no observer in continuous time")

    def read_outputs(self) -> None:
        """States are estimated with the disturbance, by agents whose inputs are what they ask."""
        if self.dynamics is None or self.dynamics.H is None:
            return
        observed = sum(len(group.agents) for group in self.groups) == self.n
        need(observed, "an agent whose outputs are measured has no exosystem")
        stated = self.stated
        alone = stated.readings is None and stated.actuators is None
        need(alone, "nothing is known of measured outputs with this table")

    def read_limit(self, value: Any) -> dict[int, Any]:
        """The limits of the inputs: one for all agents, or one for some."""
        if value is None:
            return {}
        each = value if type(value) is dict else dict.fromkeys(self.labels, value)
        need(set(each) <= set(self.labels), "there is no such agent")
        return {self.labels.index(label): rational(limit) for label, limit in each.items()}

    # --- exosystems
    def read_groups(self, exosystem: Any, observer: Any) -> list[Any]:
        """One group of all agents, or those that the file has."""
        if exosystem is None or "groups" in exosystem:
            none_given = observer.W is None and observer.P is None
            need(none_given, "W and P belong to the groups, or to no exosystem")
        if exosystem is None:
            return []
        if "groups" not in exosystem:
            read(exosystem, {"A": None, "C": None})
            own = {"agents": list(range(self.n)), "W": observer.W, "P": observer.P}
            return [self.read_group(exosystem | own)]

        # a group is read once its size is known
        values = read(exosystem, {"groups": [an_object]}).groups
        groups = [self.read_group(value) for value in values]
        some = bool(groups) and len(groups[0].agents) < self.n
        need(some, "there is no group, or one that has all agents")
        everyone = [i for group in groups for i in group.agents]
        # an agent in two groups would have two disturbances; only one would be in the loop
        need(len(set(everyone)) == len(everyone), "an agent is in two groups")
        ordered = all(a.agents[0] < b.agents[0] for a, b in pairwise(groups))
        need(ordered, "the groups are not in the order of agents")
        all_or_none = len({group.P is None for group in groups}) == 1
        need(all_or_none, "some groups have a P and some have none")
        return groups

    def read_group(self, value: Any) -> Any:
        """The agents of one exosystem, and its A, C, W and P."""
        rows = value.get("A")
        q = len(rows) if type(rows) is list else 0
        need(q > 0, "an exosystem has no state")
        estimated = q
        columns = self.columns_of(value.get("W"))
        measured = self.dynamics and self.dynamics.H
        if measured:
            estimated += self.m
            columns = len(measured)
        shape = {
            "agents": [partial(index, self.n)],
            "A": matrix(q, q),
            "C": matrix(self.inputs, q),
            "W": maybe(matrix(estimated, columns)),
            "P": maybe(matrix(estimated, estimated)),
        }
        group = read(value, shape)
        ordered = bool(group.agents) and group.agents == sorted(set(group.agents))
        need(ordered, "the agents of a group are not in order")
        need(group.P is None or group.W is not None, "there is a P without a W")
        need(not measured or group.W is not None, "what is measured needs a W")
        return group

    def columns_of(self, W: Any) -> int:
        """W acts on states or on inputs: on states where it has as many columns."""
        first = W[0] if type(W) is list and W else None
        return self.m if type(first) is list and len(first) == self.m else self.inputs


def word(known: Collection[str], value: Any) -> str:
    """One of these words."""
    need(value in known, f"{value} is no word that is known here")
    return str(value)
