"""What is asked: the region of starts; and settings of simulations, which never enter a proof."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import Any

from dobc_design._checks import LATER, put
from dobc_design._show.cards import Card, Shown, listed
from dobc_design.errors import ShapeError, SpecError, kept, raise_all, wrong
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import MAX_CHARACTERS, number_text, parse_number
from dobc_design.exact.reading import (
    counted,
    is_list,
    is_text,
    named,
    read_matrix,
    read_vector,
    shown,
    shown_number,
)

Pair = tuple[Fraction, Fraction]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Region(Shown):
    """Starts asked for: lo_c <= x_ic(0) <= hi_c for every agent i, and |xi_i(0) - xihat_i(0)| <=
    disturbance.

    ``initial_states`` holds m pairs; ``initial_disturbance`` is Euclidean, None without an
    exosystem.
    """

    initial_states: tuple[Pair, ...]
    initial_disturbance: Fraction | None

    def _card(self) -> Card:
        pairs = [f"[{shown_number(lo)}, {shown_number(hi)}]" for lo, hi in self.initial_states]
        facts: list[tuple[str, Any]] = [("initial states", listed(pairs))]
        if self.initial_disturbance is not None:
            facts.append(("|xi_i - xihat_i| at most", self.initial_disturbance))
        return Card(title="Region", text="asked for", facts=facts)


def items(value: Any, *, key: str) -> Iterable[tuple[Any, Any]]:
    """The items of a mapping.  Raises: SpecError for anything else."""
    if not isinstance(value, Mapping):
        raise wrong(key, f"must be a table; got {shown(value)}.", "Give a mapping, as a dict.")
    return value.items()


def keyed(value: Any, keys: Sequence[str], *, key: str) -> list[Any]:
    """What a table, which may have no other keys than these, or a noun has under them; None where
    it has nothing."""
    if type(value).__name__.lower() == key:
        return [getattr(value, name) for name in keys]
    for name, _ in items(value, key=key):
        if name not in keys:
            cure = f"Known keys: {', '.join(keys)}."
            raise wrong(f"{key}.{named(str(name))}", "is an unknown key.", cure)
    return [value.get(name) for name in keys]


def read_region(value: Any, *, dimension: int, with_exosystem: bool) -> Region | None:
    """Read the [region] table, with one pair for all components or m pairs.  Raises SpecError
    naming the key."""
    if value is None:
        return None
    keys = ("initial_states", "initial_disturbance")
    states, disturbance = keyed(value, keys, key="region")
    errors: list[SpecError] = []
    with kept(errors):
        states = read_pairs(states, key=f"region.{keys[0]}", dimension=dimension)
    with kept(errors):
        disturbance = _read_disturbance(disturbance, with_exosystem=with_exosystem)
    raise_all(errors)
    return Region(initial_states=states, initial_disturbance=disturbance)


def read_pairs(value: Any, *, key: str, dimension: int) -> tuple[Pair, ...]:
    """One pair for all components, or one for each.  Raises: SpecError naming the key."""
    lists = [is_list(entry) for entry in value] if is_list(value) else [False, True]
    nested = all(lists)
    rows = list(value) if nested else [value] * dimension
    if len(rows) != dimension or (any(lists) and not nested):
        several = ""
        if dimension > 1:
            several = f" for all state components, or {dimension} such pairs"
        what = f"must be a pair [lo, hi]{several}; got {shown(value)}."
        raise wrong(key, what, "For example [0, 5].", kind=ShapeError)
    pairs = []
    for position, row in enumerate(rows):
        place = f"{key}[{position}]" if nested else key
        if len(row) != 2:
            what = f"must be a pair [lo, hi]; got {shown(row)}."
            raise wrong(place, what, "For example [0, 5].", kind=ShapeError)
        lo = parse_number(row[0], key=f"{place}[0]")
        hi = parse_number(row[1], key=f"{place}[1]")
        if lo > hi:
            got = f"[{shown_number(lo)}, {shown_number(hi)}]"
            what = f"must be a pair [lo, hi] with lo <= hi; got {got}."
            raise wrong(place, what, "Exchange the two numbers.")
        pairs.append((lo, hi))
    return tuple(pairs)


def _read_disturbance(value: Any, *, with_exosystem: bool) -> Fraction | None:
    """The largest estimation error at the start; required with an exosystem, refused without."""
    key = "region.initial_disturbance"
    if value is None and with_exosystem:
        what = (
            "is required when there is an [exosystem]: a large estimation error can push the "
            "states out of it."
        )
        cure = "Give the largest |xi_i(0) - xihat_i(0)|, for example 0.5; 0 if it is known."
        raise wrong(key, what, cure)
    if value is None:
        return None
    number = parse_number(value, key=key)
    if number < 0:
        what = f"must be >= 0, because it is a length; got {shown_number(number)}."
        raise wrong(key, what, "Give 0 or more.")
    if not with_exosystem:
        what = "has no meaning without an [exosystem]."
        raise wrong(key, what, "Remove it, or give the exosystem.")
    return number


Rows = tuple[Vector, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """Simulation settings: horizon in s, seed, and starts of the exosystem and of the states, where
    they are given. ``xi0`` (q numbers) and ``x0`` (m numbers): one row for all agents, or n
    rows."""

    t_final: Fraction
    seed: int
    xi0: Rows | None
    x0: Rows | None = field(default=None, metadata=LATER)


def read_simulation(value: Any, *, n: int, orders: tuple[int, ...], m: int = 1) -> Simulation:
    """Read the [simulation] table; ``orders``: that of the exosystem, or n of them where agents
    have different ones."""
    table = {} if value is None else value
    t_final, seed, xi0, x0 = keyed(table, ("t_final", "seed", "xi0", "x0"), key="simulation")
    time = Fraction(20)
    if t_final is not None:
        time = positive_number(t_final, key="simulation.t_final", unit="s")
    seed = 0 if seed is None else seed
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        what = f"must be a whole number from 0 to 2^63 - 1; got {shown(seed)}."
        raise wrong("simulation.seed", what, "For example seed = 0.")
    disturbances = None if xi0 is None else _read_xi0(xi0, n=n, orders=orders)
    states = None if x0 is None else _read_x0(x0, n=n, m=m)
    return Simulation(t_final=time, seed=seed, xi0=disturbances, x0=states)


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
    lists = [is_list(row) for row in value] if is_list(value) else []
    alike = set(orders) - {0}
    if len(alike) == 1 and lists and not any(lists):
        (width,) = alike  # one row for all agents that have a disturbance
        row = read_vector(value, key=key, length=width, because="one per exosystem state")
        return tuple(row if order else () for order in orders)
    # one row per agent, as long as the order of its own exosystem
    if len(lists) != len(orders) or not all(lists):
        what = (
            f"must have {counted(len(orders), 'row')}, one per agent, because the groups of "
            f"exosystem.groups differ in order; got {shown(value)}."
        )
        cure = "Give every agent a row with one number per state of its own exosystem."
        raise wrong(key, what, cure, kind=ShapeError)
    because = "one per state of this agent's exosystem"
    rows = []
    for i, (row, q) in enumerate(zip(value, orders, strict=True)):
        rows.append(read_vector(row, key=f"{key}[{i}]", length=q, because=because))
    return tuple(rows)


def _read_x0(value: Any, *, n: int, m: int) -> Rows:
    """With one state component n plain numbers are one for each agent."""
    key = "simulation.x0"
    if m == 1 and is_list(value) and len(value) > 1 and not any(is_list(row) for row in value):
        if len(value) != n:
            numbers = counted(n, "number")
            what = f"must have {numbers}, one per agent, or 1 for all; got {len(value)}."
            raise wrong(key, what, "Give one number per agent.", kind=ShapeError)
        return tuple((parse_number(number, key=f"{key}[{i}]"),) for i, number in enumerate(value))
    return _rows(value, key=key, n=n, width=m, because="one per state component")


def _rows(value: Any, *, key: str, n: int, width: int, because: str) -> Rows:
    """One list of ``width`` numbers for all agents, or a list for each."""
    if not is_list(value):
        cure = f"Write {[1] + [0] * (width - 1)}." if width <= 6 else "Write [1, 0, ...]."
        what = f"must be a list of {counted(width, 'number')}; got {shown(value)}."
        raise wrong(key, what, cure, kind=ShapeError)
    if len(value) == 0 or not all(is_list(row) for row in value):
        return (read_vector(value, key=key, length=width, because=because),)
    if len(value) not in (1, n):
        what = (
            f"must have {counted(n, 'row')}, one per agent, or be one list of "
            f"{counted(width, 'number')}; got {counted(len(value), 'row')}."
        )
        raise wrong(key, what, "Give one row for all agents, or one each.", kind=ShapeError)
    rows = []
    for i, row in enumerate(value):
        rows.append(read_vector(row, key=f"{key}[{i}]", length=width, because=because))
    return tuple(rows)


Schedule = tuple[tuple[Fraction, str], ...]

#: Which keys each signal may have besides ``signal`` and ``dwell``.
KEYS: Mapping[str, tuple[str, ...]] = {
    "random": (),
    "periodic": ("sequence", "period", "schedule"),
    "markov": ("generator",),
    "schedule": ("schedule",),
    "mobile": ("radius", "neighbours", "hysteresis"),
}
SIGNALS = tuple(KEYS)
#: What proofs may assume, and the signal that is simulated unless another is named.
GUARANTEES: Mapping[str, str] = {
    "arbitrary": "random",
    "dwell": "random",
    "sequence": "periodic",
    "markov": "markov",
}
_EXAMPLES = {
    "sequence": 'sequence = ["Ga", "Gb"]',
    "period": "period = 2.0",
    "generator": "generator = [[-1, 1], [1, -1]]",
    "schedule": 'schedule = [[0, "Ga"], [1.5, "Gb"]]',
    "radius": "radius = 2.0",
    "neighbours": "neighbours = 3",
    "hysteresis": "hysteresis = 0.1",
}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Switching(Shown):
    """Which signal drives the modes; None stands for what was not given.

    Simulations:
        signal: "random", "periodic", "markov", "schedule" or "mobile".
        dwell: s; the time between two changes of "random" and "periodic", the mean one of "markov".
        sequence: modes of one round of "periodic", by default all; period: s, how long it takes.
        generator: (M, M) in 1/s; "markov": the rate from the k-th mode to the l-th, rows adding up
            to 0.
        schedule: (instant in s, mode) of "schedule"; of "periodic" those of one round, which ends
            with ``period``.
        radius or neighbours: "mobile", who hears whom; hysteresis: both distances are in the unit
            of x.
    Proofs:
        guarantee: what they may assume. "arbitrary" (as None), any signal; "dwell", a mode lasts at
            least ``dwell``, and at most ``longest`` where it is given; "sequence", the modes of
            "periodic" over and over; "markov", the Markov chain of ``generator``.  Its signal is
            then "random", "periodic" or "markov" unless another is given; a list as ``dwell`` says
            how long each mode of a sequence lasts.
    Raises: SpecError that names every wrong key.
    """

    signal: str
    dwell: Fraction | None = None
    sequence: tuple[str, ...] | None = field(default=None, metadata=LATER)
    period: Fraction | None = field(default=None, metadata=LATER)
    generator: Matrix | None = field(default=None, metadata=LATER)
    schedule: Schedule | None = field(default=None, metadata=LATER)
    radius: Fraction | None = field(default=None, metadata=LATER)
    neighbours: int | None = field(default=None, metadata=LATER)
    hysteresis: Fraction | None = field(default=None, metadata=LATER)
    guarantee: str | None = field(default=None, metadata=LATER)
    longest: Fraction | None = field(default=None, metadata=LATER)

    def __init__(
        self,
        *,
        signal: Any = None,
        dwell: Any = None,
        sequence: Any = None,
        period: Any = None,
        generator: Any = None,
        schedule: Any = None,
        radius: Any = None,
        neighbours: Any = None,
        hysteresis: Any = None,
        guarantee: Any = None,
        longest: Any = None,
    ) -> None:
        if guarantee is not None:
            if not isinstance(guarantee, str) or guarantee not in GUARANTEES:
                what = f"must be one of {', '.join(GUARANTEES)}; got {shown(guarantee)}."
                raise wrong("switching.guarantee", what, 'For example guarantee = "dwell".')
            # Simulations show a signal that keeps the guarantee, unless another is asked for.
            signal = GUARANTEES[guarantee] if signal is None else signal
            # Modes of different length are a schedule that begins anew.
            if guarantee == "sequence" and is_list(dwell):
                for name, other in (("period", period), ("schedule", schedule)):
                    if other is not None:
                        what = "has no meaning beside a list as dwell."
                        raise wrong(f"switching.{name}", what, "Remove it.")
                schedule, period = _instants(sequence, dwell)
                sequence = None
                dwell = None
        if not isinstance(signal, str) or signal not in SIGNALS:
            what = f"must be one of {', '.join(SIGNALS)}; got {shown(signal)}."
            raise wrong("switching.signal", what, 'For example signal = "random".')
        given = {
            "dwell": dwell,
            "sequence": sequence,
            "period": period,
            "generator": generator,
            "schedule": schedule,
            "radius": radius,
            "neighbours": neighbours,
            "hysteresis": hysteresis,
            "guarantee": guarantee,
            "longest": longest,
        }
        errors: list[SpecError] = []
        # Every field is there before the first is read, whatever of them is refused.
        put(self, signal=signal, **dict.fromkeys(given))
        for name, value in given.items():
            if value is not None:
                with kept(errors):
                    put(self, **{name: _read(signal, name, value)})
        raise_all(errors or _misfits(self))

    @property
    def is_guaranteed(self) -> bool:
        """Whether proofs may assume more than that any mode is on at any time."""
        return self.guarantee not in (None, "arbitrary")


def check_switching(switching: Switching | None, modes: Sequence[str]) -> Switching | None:
    """Check what refers to the network's modes.  Raises: SpecError that names every wrong entry."""
    if switching is None:
        return None
    errors: list[SpecError] = []
    named_modes: dict[str, str] = {}  # by their keys
    for k, mode in enumerate(switching.sequence or ()):
        named_modes[f"switching.sequence[{k}]"] = mode
    for k, (_, mode) in enumerate(switching.schedule or ()):
        named_modes[f"switching.schedule[{k}][1]"] = mode
    names = ", ".join(modes[:6]) + (", ..." if len(modes) > 6 else "")
    for key, mode in named_modes.items():
        if mode not in modes:
            what = f"must be a mode of [network.modes]; got {shown(mode)}."
            errors.append(wrong(key, what, f"One of {names}."))
    rows = 0 if switching.generator is None else len(switching.generator)
    if rows and rows != len(modes):
        what = f"must have {counted(len(modes), 'row')}, one per mode; got {rows}."
        cure = "Give rows and columns in the order of [network.modes]."
        errors.append(wrong("switching.generator", what, cure, kind=ShapeError))
    raise_all(errors)
    return switching


def _read(signal: str, name: str, value: Any) -> Any:
    """The value of one key, which this signal has to know.  Raises: SpecError."""
    key = f"switching.{name}"
    if name == "guarantee":
        return value
    if name not in ("dwell", "longest") and name not in KEYS[signal]:
        owners = [f'"{each}"' for each, names in KEYS.items() if name in names]
        what = f'has no meaning for signal = "{signal}"; it belongs to {" and ".join(owners)}.'
        raise wrong(key, what, f"Remove it, or write signal = {owners[-1]}.")
    if name == "radius":
        return positive_number(value, key=key, unit="a distance in the unit of x")
    if name in ("dwell", "longest", "period"):
        return positive_number(value, key=key, unit="s")
    if name == "hysteresis":
        number = parse_number(value, key=key)
        if number < 0:
            what = f"must be >= 0 (a distance in the unit of x); got {shown_number(number)}."
            raise wrong(key, what, f"Write {_EXAMPLES[name]}.")
        return number
    if name == "neighbours":
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value < 2**31:
            what = f"must be a whole number >= 1; got {shown(value)}."
            raise wrong(key, what, f"Write {_EXAMPLES[name]}.")
        return value
    readers = {"sequence": _read_sequence, "generator": _read_generator, "schedule": _read_schedule}
    return readers[name](value, key)


def _misfits(own: Switching) -> list[SpecError]:
    """Keys that are missing, or that say the same thing twice."""
    has = {each.name for each in fields(own) if getattr(own, each.name) is not None}
    signal = own.signal
    rounds = signal == "periodic" and "schedule" in has
    found = _unfit_guarantee(own)

    def need(name: str, why: str) -> None:
        if name not in has and name in KEYS[signal]:
            what = f'is required and missing: with signal = "{signal}" {why}.'
            found.append(wrong(f"switching.{name}", what, f"Write {_EXAMPLES[name]}."))

    def refuse(name: str, other: str, why: str) -> None:
        if {name, other} <= has:
            what = f"must be left out where switching.{other} is given, because {why}."
            found.append(wrong(f"switching.{name}", what, "Keep one of them."))

    if signal == "schedule":
        need("schedule", "it says which mode is active at which time")
    if not {"radius", "neighbours"} & has:
        need("radius", "it says how far an agent hears (or neighbours: how many)")
    refuse("neighbours", "radius", "each of the two defines the neighbours")
    if signal == "markov":
        refuse("dwell", "generator", "its diagonal sets the mean dwell times")
    if rounds:
        refuse("dwell", "schedule", "the schedule sets the times")
        refuse("sequence", "schedule", "the schedule sets the modes")
        need("period", "it says when the schedule begins anew")
    elif signal == "periodic":
        refuse("period", "dwell", "each of the two sets how long a mode lasts")
    if rounds and own.schedule and own.period is not None and own.period <= own.schedule[-1][0]:
        last, got = shown_number(own.schedule[-1][0]), shown_number(own.period)
        what = f"must be > {last} s, the last instant of the schedule; got {got}."
        found.append(wrong("switching.period", what, "Choose a longer one."))
    return found


def _unfit_guarantee(own: Switching) -> list[SpecError]:
    """What a guarantee needs, and what has no meaning without it."""
    found = []
    guarantee, dwell, longest = own.guarantee, own.dwell, own.longest
    timed = own.signal == "periodic" and (dwell is not None or own.period is not None)
    if guarantee == "sequence" and not timed:
        what = "needs the modes in their order and how long each lasts."
        cure = 'Write sequence = ["Ga", "Gb"] and dwell = [1, 2].'
        found.append(wrong("switching.guarantee", what, cure))
    if guarantee == "markov" and own.generator is None:
        what = 'is required and missing: guarantee = "markov" says at which rates the modes change.'
        found.append(wrong("switching.generator", what, f"Write {_EXAMPLES['generator']}."))
    if guarantee == "dwell" and dwell is None:
        what = 'is required and missing: guarantee = "dwell" says that a mode lasts at least so'
        found.append(wrong("switching.dwell", f"{what} long.", "Write dwell = 0.5."))
    if longest is not None and guarantee != "dwell":
        what = 'has no meaning without guarantee = "dwell".'
        found.append(wrong("switching.longest", what, 'Remove it, or write guarantee = "dwell".'))
    elif longest is not None and dwell is not None and longest < dwell:
        least, got = shown_number(dwell), shown_number(longest)
        what = f"must be >= switching.dwell = {least} s; got {got}."
        found.append(wrong("switching.longest", what, "Give a longer time, or leave it out."))
    return found


def _instants(sequence: Any, dwell: Any) -> tuple[Any, Any]:
    """The schedule of a round and its period, for modes that last differently long."""
    modes = _read_sequence(sequence, "switching.sequence")
    if len(dwell) != len(modes):
        what = (
            f"must be one number, or {counted(len(modes), 'number')}, one for each of "
            f"switching.sequence; got {len(dwell)}."
        )
        raise wrong("switching.dwell", what, "Give one for each.", kind=ShapeError)
    lengths: list[Fraction] = []
    for k, x in enumerate(dwell):
        lengths.append(positive_number(x, key=f"switching.dwell[{k}]", unit="s"))
    # Sums of allowed numbers may be too long to be written down again.
    begins = [Fraction(0), *accumulate(lengths)]
    if any(len(number_text(begin)) > MAX_CHARACTERS for begin in begins):
        short, long = shown_number(min(lengths)), shown_number(max(lengths))
        what = (
            f"holds times from {short} to {long} s, whose sum has more than {MAX_CHARACTERS} "
            "digits."
        )
        cure = "Give times that are closer to each other, or with fewer digits."
        raise wrong("switching.dwell", what, cure)
    return tuple(zip(begins, modes, strict=False)), begins[-1]


def _read_sequence(value: Any, key: str) -> tuple[str, ...]:
    """The modes of one round."""
    if not is_list(value) or not len(value):
        raise _no_list(key, "a list of modes", value, "sequence")
    return tuple(_mode(mode, f"{key}[{k}]") for k, mode in enumerate(value))


def _read_generator(value: Any, key: str) -> Matrix:
    """The rates of a Markov chain: a square matrix whose rows add up to 0."""
    matrix = read_matrix(value, key=key)
    rows, columns = len(matrix), len(matrix[0])
    if rows != columns:
        what = f"must be square, one row and one column per mode; got shape ({rows}, {columns})."
        raise wrong(key, what, f"For two modes {_EXAMPLES['generator']}.", kind=ShapeError)
    for k, row in enumerate(matrix):
        for other, rate in enumerate(row):
            if other != k and rate < 0:
                what = f"must be >= 0, because it is a rate (1/s); got {shown_number(rate)}."
                raise wrong(f"{key}[{k}][{other}]", what, "Only the diagonal is negative.")
        total = sum(row, Fraction(0))
        if total:
            what = "must add up to 0: the diagonal entry is minus the sum of the others;"
            cure = f"Write {shown_number(row[k] - total)} at place {k} of that row."
            raise wrong(f"{key}[{k}]", f"{what} got {shown_number(total)}.", cure)
    return matrix


def _read_schedule(value: Any, key: str) -> Schedule:
    """Instants, which increase from 0 s, with the mode that begins there."""
    if not is_list(value) or not len(value):
        raise _no_list(key, "a list of [instant in s, mode]", value, "schedule")
    rows = []
    for k, row in enumerate(value):
        place = f"{key}[{k}]"
        if not is_list(row) or len(row) != 2:
            raise _no_list(place, "[instant in s, mode]", row, "schedule")
        instant = parse_number(row[0], key=f"{place}[0]")
        rows.append((instant, _mode(row[1], f"{place}[1]")))
    first = rows[0][0]
    if first != 0:
        what = "must be 0, because a mode must be active from 0 s on;"
        cure = "Say which mode is active from 0 s on."
        raise wrong(f"{key}[0][0]", f"{what} got {shown_number(first)}.", cure)
    for k, ((before, _), (after, _)) in enumerate(pairwise(rows), start=1):
        if after <= before:
            what = f"must be > {shown_number(before)}, because instants increase;"
            what += f" got {shown_number(after)}."
            raise wrong(f"{key}[{k}][0]", what, "Sort the instants.")
    return tuple(rows)


def positive_number(value: Any, *, key: str, unit: str) -> Fraction:
    """Read a number > 0 in ``unit``.  Raises: SpecError."""
    number = parse_number(value, key=key)
    if number <= 0:
        cure = "Give a positive time." if unit == "s" else "Give a positive number."
        raise wrong(key, f"must be > 0 ({unit}); got {shown_number(number)}.", cure)
    return number


def _mode(value: Any, key: str) -> str:
    if not is_text(value):
        what = f"must be the name of a mode; got {shown(value)}."
        raise wrong(key, what, 'In quotes, such as "Ga".')
    return str(value)


def _no_list(key: str, what: str, value: Any, name: str) -> SpecError:
    return wrong(key, f"must be {what}; got {shown(value)}.", f"For example {_EXAMPLES[name]}.")
