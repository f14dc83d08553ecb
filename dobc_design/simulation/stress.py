"""A stress: what the theorems leave out, and a simulation can apply.

Noise, a disturbance that no exosystem knows, limits of inputs, sampling, lost packets and failing
agents.  What a run does under it: ``agents.py``, ``stressed.py`` and ``sampled.py``.
"""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from dobc_design._checks import noun, put
from dobc_design._show.cards import Shown, Told
from dobc_design.errors import refused, wrong
from dobc_design.exact.number import nearest
from dobc_design.exact.reading import one_of, shown
from dobc_design.problem.network import one_form
from dobc_design.problem.problem import Problem
from dobc_design.problem.uncertainty import Uncertainty

from ._arguments import NumberRows, finite_array, not_negative, positive, seconds

EXCHANGE = 0.05  # s between two exchanges where neither a period nor an exchange is given
KINDS = ("vanish", "freeze")


@noun
class Failure(Shown):
    """Agent ``agent`` fails at ``time`` s.

    "vanish": its input is 0 and nobody hears it any more.  "freeze": its input and what the others
    hear of it stay as they are at that instant.  It goes on feeling the couplings, which are no
    part of its input in (1).
    """

    agent: str
    time: float = 0.0
    kind: str = "vanish"

    def __post_init__(self) -> None:
        put(self, agent=str(self.agent), time=not_negative(self.time, "failure.time"))
        one_of(self.kind, KINDS, "failure.kind", '"vanish" is the default.')

    def __str__(self) -> str:
        return f"agent {self.agent} fails at {self.time:g} s ({self.kind})"


@noun
class Stress(Told):
    """Options that can be combined; what is left out does not happen.

    ``noise``: standard deviation of every measured component, in the unit of x, drawn anew at every
    exchange (every 0.05 s without). ``disturbance``: amplitude, in units of x per s (of u with
    [dynamics]), of a sine of ``frequency`` rad/s with random phases that acts besides d and that no
    exosystem knows (frequency 0: a constant).  ``saturation``: bound on every component of u, in
    the same units; the observer is told the input that is applied.  ``period`` (s): couplings,
    input and observer are computed at its multiples and held between (see ``sampled``);
    ``sampled_gain`` (q, m) is then the observer's, as ``design_observer(period=...)`` gives it, in
    place of the discretised W.  ``loss``: probability that a packet is lost, on every arc and at
    every exchange; the listener keeps the last.  ``exchange`` (s): time between exchanges, the
    period where there is one, else 0.05 s.  ``failures``: agents that fail.  ``worst``: noise and
    disturbance take the values + and - only, the disturbance so that it drives one agent, the seed
    modulo n, as far as the linearised loop can be driven; agents have the limits of [actuators].
    ``bands``: (low, high, amplitude), low and high in rad/s, of sines beside d in every component,
    each of a frequency and a phase by chance; at the worst of those that drive that agent most.
    """

    noise: float = 0.0
    disturbance: float = 0.0
    frequency: float = 1.0
    saturation: float | None = None
    period: float | None = None
    sampled_gain: NumberRows | None = None
    loss: float = 0.0
    exchange: float | None = None
    failures: tuple[Failure, ...] = ()
    worst: bool = False
    bands: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("noise", "disturbance", "frequency", "loss"):
            put(self, **{name: not_negative(getattr(self, name), name)})
        if self.loss > 1:
            message = f"must be a probability, 0 to 1; got {self.loss:g}."
            raise wrong("loss", message, "Such as 0.1.")
        if self.saturation is not None:
            put(self, saturation=positive(self.saturation, "saturation"))
        self._read_times()
        if self.sampled_gain is not None:
            self._read_gain(self.sampled_gain)
        self._read_failures(self.failures)

    def _read_times(self) -> None:
        if self.period is not None:
            put(self, period=seconds(self.period, "period", example="0.05"))
        if self.exchange is not None:
            put(self, exchange=seconds(self.exchange, "exchange", example="0.05"))
        if self.period is not None and self.exchange not in (None, self.period):
            message = (
                "must be left out when a period is given, because a sampled agent exchanges "
                "when it samples."
            )
            raise wrong("exchange", message, "Leave one of them out.")

    def _read_failures(self, given: Any) -> None:
        failures = (given,) if isinstance(given, Failure) else tuple(given)
        if not all(isinstance(each, Failure) for each in failures):
            message = "must be a list of Failure."
            raise wrong("failures", message, 'Such as [Failure(agent="3", time=2.0)].')
        for agent, count in Counter(each.agent for each in failures).items():
            if count > 1:
                message = f"agent {shown(agent)} fails twice."
                raise refused("failures", message, "Leave one of them out.")
        put(self, failures=failures)

    def _read_gain(self, given: Any) -> None:
        if self.period is None:
            message = "needs a period, because it is the gain of a sampled observer."
            raise wrong("sampled_gain", message, "Give the period it was designed for.")
        try:
            shape = np.shape(given)
        except ValueError:  # rows of different lengths, which the next line refuses
            shape = (0, 0)
        because = "one row per exosystem state"
        gain = finite_array(given, "sampled_gain", shape=shape, because=because)
        put(self, sampled_gain=tuple(map(tuple, np.atleast_2d(gain).tolist())))

    @property
    def is_calm(self) -> bool:
        """Whether nothing happens: the frequency of no disturbance does not count."""
        return replace(self, frequency=1.0) == Stress()

    @property
    def acts(self) -> bool:
        """Whether something acts beside the disturbance of the exosystem."""
        return bool(self.disturbance or self.bands)

    @property
    def exchanges(self) -> float | None:
        """Time in s between two exchanges; None where states are heard continuously."""
        if self.period is not None:
            return self.period
        # packets can only be lost where there are any
        if self.exchange is None and self.loss:
            return EXCHANGE
        return self.exchange

    @property
    def draws(self) -> float | None:
        """Time in s between two draws of the measurement noise; None where nothing is ever drawn or
        exchanged."""
        return EXCHANGE if self.noise and self.exchanges is None else self.exchanges

    def failing(self, problem: Problem) -> dict[int, Failure]:
        """Failures by the agent's index.  Raises: SpecError for an agent that is not there."""
        places = {label: place for place, label in enumerate(problem.network.labels)}
        found = {}
        for failure in self.failures:
            place = places.get(one_form(failure.agent))
            if place is None:
                message = f"names {shown(failure.agent)}, and no agent has this label."
                cure = f"Labels are {', '.join(problem.network.labels[:6])}, ..."
                raise wrong("failures", message, cure)
            found[place] = failure
        return found

    def __str__(self) -> str:
        words = []
        if self.noise:
            most = "of at most " if self.worst else ""
            words.append(f"measurement noise {most}{self.noise:g}")
        if self.disturbance:
            how = f"at {self.frequency:g} rad/s"
            if self.worst:
                how = "switched to be as bad as it can be"
            words.append(f"unmodelled disturbance {self.disturbance:g} {how}")
        for low, high, amplitude in self.bands:
            chosen = "the worst frequency and phase" if self.worst else "frequencies by chance"
            words.append(f"a sine of {amplitude:g} in {low:g} to {high:g} rad/s, {chosen}")
        if self.saturation is not None:
            words.append(f"|u| at most {self.saturation:g}")
        if self.exchanges is not None:
            what = "exchanges" if self.period is None else "sampled"
            words.append(f"{what} every {self.exchanges:g} s")
        if self.loss:
            words.append(f"{self.loss:.3g} of the packets lost")
        words += map(str, self.failures)
        return "; ".join(words) or "no stress"


def worst_stress(problem: Problem) -> Stress:
    """What [uncertainty] and [actuators] allow, at its worst; no stress where they allow
    nothing."""
    allowed = problem.uncertainty or Uncertainty()
    bands = stated_bands(problem)
    noise = float(allowed.measurement)
    disturbance = float(allowed.disturbance)
    limit = None if problem.actuators is None else problem.actuators.limit
    if not (noise or disturbance or bands) and limit is None and problem.readings is None:
        return Stress()
    # limits by agent are those of [actuators], which the run looks up
    common = None if limit is None or isinstance(limit, Mapping) else float(limit)
    return Stress(noise=noise, disturbance=disturbance, saturation=common, worst=True, bands=bands)


def stated_bands(problem: Problem) -> tuple[tuple[float, float, float], ...]:
    """Those of [exosystem], which act in every run."""
    table = problem.uncertainty
    bands = () if table is None else table.bands or ()
    return tuple((nearest(low), nearest(high), nearest(size)) for low, high, size in bands)


def stress_to_json(stress: Stress) -> str:
    """A stress as one JSON object."""
    given = asdict(stress)
    # left out where it says nothing
    for name in ("worst", "bands"):
        if not given[name]:
            del given[name]
    return json.dumps(given, ensure_ascii=False)
