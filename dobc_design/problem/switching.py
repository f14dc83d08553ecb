"""What [switching] states: the signal of simulations, and the guarantee that proofs may assume.

What a proof makes of a guarantee is in ``loop/guarantee.py``.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from fractions import Fraction
from functools import partial
from itertools import accumulate, pairwise
from typing import Any

from dobc_design._checks import later, noun, put, require_square
from dobc_design._show.cards import Shown
from dobc_design.errors import Mistakes, SpecError, misshapen, wrong
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import MAX_CHARACTERS, ZERO, number_text, parse_number
from dobc_design.exact.reading import (
    Names,
    Texts,
    counted,
    is_list,
    is_text,
    least_number,
    one_of,
    positive_number,
    read_matrix,
    shown,
    shown_number,
    whole_number,
)

Schedule = tuple[tuple[Fraction, str], ...]
#: Which keys each signal may have besides ``signal`` and ``dwell``.
KEYS = {
    "random": (),
    "periodic": ("sequence", "period", "schedule"),
    "markov": ("generator",),
    "schedule": ("schedule",),
    "mobile": ("radius", "neighbours", "hysteresis"),
}
SIGNALS = tuple(KEYS)
OF_ALL = ("guarantee", "dwell", "longest")
#: What proofs may assume, and the signal that is simulated unless another is named.
GUARANTEES = {
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


@noun
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
    sequence: Texts | None = later()
    period: Fraction | None = later()
    generator: Matrix | None = later()
    schedule: Schedule | None = later()
    radius: Fraction | None = later()
    neighbours: int | None = later()
    hysteresis: Fraction | None = later()
    guarantee: str | None = later()
    longest: Fraction | None = later()

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
        errors = Mistakes()
        if guarantee is not None:
            cure = 'For example guarantee = "dwell".'
            guarantee = errors.tried(one_of, guarantee, GUARANTEES, "switching.guarantee", cure)
            # Simulations show a signal that keeps the guarantee, unless another is asked for.
            signal = GUARANTEES.get(guarantee, "random") if signal is None else signal
        # Modes of different length are a schedule that begins anew.
        if guarantee == "sequence" and is_list(dwell):
            for name, other in (("period", period), ("schedule", schedule)):
                if other is not None:
                    raise wrong(
                        f"switching.{name}", "has no meaning beside a list as dwell.", "Remove it."
                    )
            schedule, period = _instants(sequence, dwell)
            sequence = None
            dwell = None
        with errors:
            if signal is None:
                raise wrong(
                    "switching.signal",
                    "is required and missing; a guarantee may stand in its place.",
                    'Write guarantee = "dwell" if proofs may rely on the dwell time, or signal = '
                    '"random" for simulations.',
                )
            one_of(signal, SIGNALS, "switching.signal", 'For example signal = "random".')
        if signal not in SIGNALS:
            raise SpecError.several(errors)
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
        # Every field is there before the first is read, whatever of them is refused.
        put(self, signal=signal, **dict.fromkeys(given))
        for name, value in given.items():
            if value is not None:
                with errors:
                    put(self, **{name: _read(signal, name, value)})
        if not errors:
            errors.extend(_misfits(self))
        errors.raise_all()

    @property
    def is_guaranteed(self) -> bool:
        """Whether proofs may assume more than that any mode is on at any time."""
        return self.guarantee not in (None, "arbitrary")


def check_switching(switching: Switching | None, modes: Names) -> Switching | None:
    """Check what refers to the network's modes.  Raises: SpecError that names every wrong entry."""
    if switching is None:
        return None
    errors = Mistakes()
    named_modes = {}  # by their keys
    for k, mode in enumerate(switching.sequence or ()):
        named_modes[f"switching.sequence[{k}]"] = mode
    for k, (_, mode) in enumerate(switching.schedule or ()):
        named_modes[f"switching.schedule[{k}][1]"] = mode
    names = ", ".join(modes[:6]) + (", ..." if len(modes) > 6 else "")
    for key, mode in named_modes.items():
        if mode not in modes:
            errors.append(
                wrong(
                    key,
                    f"must be a mode of [network.modes]; got {shown(mode)}.",
                    f"One of {names}.",
                )
            )
    # The generator has no names: its rows are the modes in their order.
    rows = 0 if switching.generator is None else len(switching.generator)
    if rows and rows != len(modes):
        errors.append(
            misshapen(
                "switching.generator",
                f"must have {counted(len(modes), 'row')}, one per mode; got {rows}.",
                "Give rows and columns in the order of [network.modes].",
            )
        )
    errors.raise_all()
    return switching


def _read(signal: str, name: str, value: Any) -> Any:
    """The value of one key, which this signal has to know.  Raises: SpecError."""
    key = f"switching.{name}"
    if name not in (*OF_ALL, *KEYS[signal]):
        owners = [f'"{each}"' for each, names in KEYS.items() if name in names]
        raise wrong(
            key,
            f'has no meaning for signal = "{signal}"; it belongs to {" and ".join(owners)}.',
            f"Remove it, or write signal = {owners[-1]}.",
        )
    return _READERS[name](value, key)


def _misfits(own: Switching) -> Iterator[SpecError]:
    """Keys that are missing, or that say the same thing twice."""
    has = {each.name for each in fields(own) if getattr(own, each.name) is not None}
    signal = own.signal
    rounds = signal == "periodic" and "schedule" in has
    yield from _unfit_guarantee(own)
    # Why a key is needed, or (beside another one) has to be left out.
    rules = {}
    if signal == "schedule":
        rules["schedule", ""] = "it says which mode is active at which time"
    if not {"radius", "neighbours"} & has:
        rules["radius", ""] = "it says how far an agent hears (or neighbours: how many)"
    rules["neighbours", "radius"] = "each of the two defines the neighbours"
    if signal == "markov":
        rules["dwell", "generator"] = "its diagonal sets the mean dwell times"
    if rounds:
        rules["dwell", "schedule"] = "the schedule sets the times"
        rules["sequence", "schedule"] = "the schedule sets the modes"
        rules["period", ""] = "it says when the schedule begins anew"
    elif signal == "periodic":
        rules["period", "dwell"] = "each of the two sets how long a mode lasts"
    for (name, other), why in rules.items():
        if not other and name not in has and name in KEYS[signal]:
            yield wrong(
                f"switching.{name}",
                f'is required and missing: with signal = "{signal}" {why}.',
                f"Write {_EXAMPLES[name]}.",
            )
        if {name, other} <= has:
            yield wrong(
                f"switching.{name}",
                f"must be left out where switching.{other} is given, because {why}.",
                "Keep one of them.",
            )
    if rounds and own.schedule and own.period is not None and own.period <= own.schedule[-1][0]:
        last, got = shown_number(own.schedule[-1][0]), shown_number(own.period)
        yield wrong(
            "switching.period",
            f"must be > {last} s, the last instant of the schedule; got {got}.",
            "Choose a longer one.",
        )


def _unfit_guarantee(own: Switching) -> Iterator[SpecError]:
    """What a guarantee needs, and what has no meaning without it."""
    guarantee, dwell, longest = own.guarantee, own.dwell, own.longest
    timed = own.signal == "periodic" and (dwell is not None or own.period is not None)
    if guarantee == "sequence" and not timed:
        yield wrong(
            "switching.guarantee",
            "needs the modes in their order and how long each lasts.",
            'Write sequence = ["Ga", "Gb"] and dwell = [1, 2].',
        )
    if guarantee == "markov" and own.generator is None:
        yield wrong(
            "switching.generator",
            'is required and missing: guarantee = "markov" says at which rates the modes change.',
            f"Write {_EXAMPLES['generator']}.",
        )
    if guarantee == "dwell" and dwell is None:
        what = 'is required and missing: guarantee = "dwell" says that a mode lasts at least so'
        yield wrong("switching.dwell", f"{what} long.", "Write dwell = 0.5.")
    if longest is not None and guarantee != "dwell":
        yield wrong(
            "switching.longest",
            'has no meaning without guarantee = "dwell".',
            'Remove it, or write guarantee = "dwell".',
        )
    elif longest is not None and dwell is not None and longest < dwell:
        least, got = shown_number(dwell), shown_number(longest)
        yield wrong(
            "switching.longest",
            f"must be >= switching.dwell = {least} s; got {got}.",
            "Give a longer time, or leave it out.",
        )


def _instants(sequence: Any, dwell: Any) -> tuple[Any, Any]:
    """The schedule of a round and its period, for modes that last differently long."""
    # A list of times needs a list of modes beside it, one for one.
    modes = _read_sequence(sequence, "switching.sequence")
    if len(dwell) != len(modes):
        raise misshapen(
            "switching.dwell",
            f"must be one number, or {counted(len(modes), 'number')}, one for each of "
            f"switching.sequence; got {len(dwell)}.",
            "Give one for each.",
        )
    lengths = []
    for k, x in enumerate(dwell):
        lengths.append(positive_number(x, f"switching.dwell[{k}]", "s"))
    # Sums of allowed numbers may be too long to be written down again.
    begins = [ZERO, *accumulate(lengths)]
    if any(len(number_text(begin)) > MAX_CHARACTERS for begin in begins):
        short, long = shown_number(min(lengths)), shown_number(max(lengths))
        raise wrong(
            "switching.dwell",
            f"holds times from {short} to {long} s, whose sum has more than {MAX_CHARACTERS} "
            "digits.",
            "Give times that are closer to each other, or with fewer digits.",
        )
    return tuple(zip(begins, modes, strict=False)), begins[-1]


def _read_sequence(value: Any, key: str) -> Texts:
    """The modes of one round."""
    if not is_list(value) or not len(value):
        raise _no_list(key, "a list of modes", value, "sequence")
    return tuple(_mode(mode, f"{key}[{k}]") for k, mode in enumerate(value))


def _read_generator(value: Any, key: str) -> Matrix:
    """The rates of a Markov chain: a square matrix whose rows add up to 0."""
    matrix = read_matrix(value, key)
    require_square(matrix, key, "one row and one column per mode")
    for k, row in enumerate(matrix):
        for other, rate in enumerate(row):
            if other != k and rate < 0:
                raise wrong(
                    f"{key}[{k}][{other}]",
                    f"must be >= 0, because it is a rate (1/s); got {shown_number(rate)}.",
                    "Only the diagonal is negative.",
                )
        total = sum(row, ZERO)
        if total:
            what = "must add up to 0: the diagonal entry is minus the sum of the others;"
            raise wrong(
                f"{key}[{k}]",
                f"{what} got {shown_number(total)}.",
                f"Write {shown_number(row[k] - total)} at place {k} of that row.",
            )
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
        instant = parse_number(row[0], f"{place}[0]")
        rows.append((instant, _mode(row[1], f"{place}[1]")))
    first = rows[0][0]
    if first != 0:
        what = "must be 0, because a mode must be active from 0 s on;"
        raise wrong(
            f"{key}[0][0]",
            f"{what} got {shown_number(first)}.",
            "Say which mode is active from 0 s on.",
        )
    for k, ((before, _), (after, _)) in enumerate(pairwise(rows), start=1):
        if after <= before:
            what = f"must be > {shown_number(before)}, because instants increase;"
            what += f" got {shown_number(after)}."
            raise wrong(f"{key}[{k}][0]", what, "Sort the instants.")
    return tuple(rows)


def _mode(value: Any, key: str) -> str:
    if not is_text(value):
        raise wrong(
            key, f"must be the name of a mode; got {shown(value)}.", 'In quotes, such as "Ga".'
        )
    return str(value)


def _no_list(key: str, what: str, value: Any, name: str) -> SpecError:
    return wrong(key, f"must be {what}; got {shown(value)}.", f"For example {_EXAMPLES[name]}.")


_seconds = partial(positive_number, unit="s")
_LENGTH = "a distance in the unit of x"
_READERS: dict[str, Callable[[Any, str], Any]] = {
    "guarantee": lambda value, key: value,
    "dwell": _seconds,
    "longest": _seconds,
    "period": _seconds,
    "sequence": _read_sequence,
    "generator": _read_generator,
    "schedule": _read_schedule,
    "radius": partial(positive_number, unit=_LENGTH),
    "hysteresis": partial(
        least_number, what=f">= 0 ({_LENGTH})", cure=f"Write {_EXAMPLES['hysteresis']}."
    ),
    "neighbours": partial(
        whole_number, least=1, most=2**31 - 1, cure=f"Write {_EXAMPLES['neighbours']}."
    ),
}
