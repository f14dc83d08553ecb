"""Signals as text: JSON both ways, and the [switching] section of a problem."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.simulate.mobile import Mobile, Waypoints
from dobc_design.simulate.signals import Fixed, Markov, Periodic, RandomDwell, Schedule, Scheduled, plain
from dobc_design.spec.problem import Problem
from dobc_design.spec.reading import shown

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
            f"signal must be one of {', '.join(_KINDS)}; got {shown(document)}.", key="signal",
            cure='For example {"signal": "periodic", "dwell": 0.5}.',
        )  # fmt: skip
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

    Raises: SpecError where the section names a signal whose numbers a problem file cannot hold yet.
    """
    names = tuple(problem.network.modes)
    if problem.switching is None:
        remark = f"No signal was given: {names[0]} is active throughout." if len(names) > 1 else None
        return Fixed(), remark
    kind, given = problem.switching.signal, problem.switching.dwell
    if kind in ("schedule", "mobile"):
        needed = "the instants and modes" if kind == "schedule" else "a radius or a number of neighbours"
        example = "Schedule(times=..., modes=...)" if kind == "schedule" else "Mobile(radius=...)"
        raise SpecError(
            f'switching.signal = "{kind}" needs {needed}, which a problem file cannot hold yet.',
            key="switching.signal", cure=f"In Python: simulate(problem, signal={example}); on the command line --mode.",
        )  # fmt: skip
    if len(names) == 1:
        return Fixed(), "There is one mode: nothing switches."
    dwell = DWELL if given is None else float(given)
    remark = f"switching.dwell is not given: {DWELL} s." if given is None else None
    if kind == "random":
        return RandomDwell(dwell=dwell), remark
    if kind == "periodic":
        return Periodic(dwell=dwell), remark
    rate = 1 / (dwell * (len(names) - 1))
    rows = tuple(tuple(-1 / dwell if k == other else rate for other in range(len(names))) for k in range(len(names)))
    return Markov(generator=rows), "Markov: stays last switching.dwell on average, all other modes are equally likely."


def _frozen(value: Any) -> Any:
    return tuple(_frozen(each) for each in value) if isinstance(value, list) else value
