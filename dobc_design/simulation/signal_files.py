"""Signals as text: JSON both ways, and the [switching] section of a problem."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from fractions import Fraction
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Switching
from dobc_design.simulation.mobile import Mobile, Waypoints
from dobc_design.simulation.signals import Fixed, Markov, Periodic, RandomDwell, Schedule, Scheduled, plain

Signal = Scheduled | Mobile
DWELL = 0.5  # s, where [switching] gives none
_KINDS: dict[str, type[Any]] = {kind.kind: kind for kind in (Fixed, Periodic, RandomDwell, Markov, Schedule, Mobile)}


def signal_to_json(signal: Signal) -> str:
    """Write a signal as one JSON object; ``signal_from_json`` gives an equal signal back."""
    document: dict[str, Any] = {"signal": signal.kind}
    for field in fields(signal):
        value = getattr(signal, field.name)
        if isinstance(value, Waypoints):
            value = {"times": plain(value.times), "positions": plain(value.positions)}
        document[field.name] = plain(value)
    return json.dumps(document, ensure_ascii=False)


def signal_from_json(text: str) -> Signal:
    """Read a signal back.  Raises: SpecError for anything that is not one."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SpecError(f"the signal is not valid JSON ({error}).", key="signal", cure="Write it anew.") from None
    if not isinstance(document, Mapping) or document.get("signal") not in _KINDS:
        raise SpecError(
            f"signal must be one of {', '.join(_KINDS)}; got {shown(document)}.",
            key="signal",
            cure='For example {"signal": "periodic", "dwell": 0.5}.',
        )
    kind = _KINDS[document["signal"]]
    known = {field.name for field in fields(kind)}
    given = {str(name): _frozen(value) for name, value in document.items() if name != "signal"}
    if not set(given) <= known:
        wrong = sorted(set(given) - known)[0]
        raise SpecError(f"{wrong} is an unknown key of {kind.kind}.", key=wrong, cure=f"Known: {sorted(known)}.")
    try:
        motion = given.get("motion")
        if motion is not None:
            given["motion"] = Waypoints(times=motion["times"], positions=motion["positions"])
        signal: Signal = kind(**given)
    except (TypeError, KeyError, ValueError) as error:
        if isinstance(error, SpecError):
            raise
        raise SpecError(f"the signal cannot be read ({error}).", key="signal", cure="Write it anew.") from None
    return signal


def signal_of(problem: Problem) -> tuple[Signal, str | None]:
    """The signal that a problem's [switching] section describes, and a remark where something had to be chosen.

    Raises: SpecError for numbers beyond the range of floats.
    """
    names, own = tuple(problem.network.modes), problem.switching
    if own is None:
        remark = f"No signal was given: {names[0]} is active throughout." if len(names) > 1 else None
        return Fixed(), remark
    if own.signal in ("schedule", "mobile"):
        unused = None if own.dwell is None else f"switching.dwell is not used by a {own.signal} signal."
        return (_mobile(own) if own.signal == "mobile" else _schedule(own)), unused
    if len(names) == 1:
        return Fixed(), "There is one mode: nothing switches."
    if own.signal == "periodic" and (own.schedule or own.period):
        return _rounds(own, names), None
    if own.generator is not None:
        rows = [[_float(rate, "switching.generator") for rate in row] for row in own.generator]
        return Markov(generator=_frozen(rows)), None
    dwell = DWELL if own.dwell is None else _float(own.dwell, "switching.dwell")
    remark = f"switching.dwell is not given: {DWELL} s." if own.dwell is None else None
    if own.signal == "random":
        return RandomDwell(dwell=dwell), remark
    if own.signal == "periodic":
        return Periodic(dwell=dwell, order=own.sequence), remark
    rate = 1 / (dwell * (len(names) - 1))
    table = tuple(tuple(-1 / dwell if k == other else rate for other in range(len(names))) for k in range(len(names)))
    return Markov(generator=table), "Markov: stays last switching.dwell on average, all other modes are equally likely."


def _mobile(own: Switching) -> Mobile:
    return Mobile(
        radius=None if own.radius is None else _float(own.radius, "switching.radius"),
        neighbours=own.neighbours,
        hysteresis=_float(own.hysteresis or Fraction(0), "switching.hysteresis"),
    )


def _schedule(own: Switching) -> Schedule:
    instants = own.schedule or ()
    times = tuple(_float(time, f"switching.schedule[{k}][0]") for k, (time, _) in enumerate(instants))
    return Schedule(times=times, modes=tuple(mode for _, mode in instants))


def _rounds(own: Switching, names: tuple[str, ...]) -> Periodic:
    """One round in a given time: equal stays, or those of a schedule."""
    whole = own.period or Fraction(0)
    if own.schedule is None:
        order = own.sequence or names
        return Periodic(dwell=_float(whole / len(order), "switching.period"), order=own.sequence)
    ends = [*(time for time, _ in own.schedule[1:]), whole]
    stays = [_float(end - time, "switching.schedule") for (time, _), end in zip(own.schedule, ends, strict=True)]
    return Periodic(dwell=tuple(stays), order=tuple(mode for _, mode in own.schedule))


def _float(value: Fraction, key: str) -> float:
    """Raises: SpecError for a number beyond the range of floats."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if math.isinf(number) or (number == 0 and value):
        raise SpecError(f"{key} is beyond the range of floats.", key=key, cure="Choose other units.")
    return number


def _frozen(value: Any) -> Any:
    return tuple(_frozen(each) for each in value) if isinstance(value, list) else value
