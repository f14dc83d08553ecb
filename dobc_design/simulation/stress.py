"""What the theorems leave out, as one value: noise, unmodelled disturbance, saturation, sampling, loss, failures.

Everything that an agent computes uses measured states and what it has received.  A stress and a seed give the same run
every time; a stress says nothing about a proof.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dobc_design._show.cards import Card, Shown
from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import finite_array, not_negative, positive, seconds

EXCHANGE = 0.05  # s between two exchanges where neither a period nor an exchange is given
KINDS = ("vanish", "freeze")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Failure(Shown):
    """Agent ``agent`` fails at ``time`` s.

    "vanish": its input is 0 and nobody hears it any more.  "freeze": its input and what the others hear of it stay as
    they are at that instant.  It goes on feeling the couplings, which are no part of its input in (1).
    """

    agent: str
    time: float = 0.0
    kind: str = "vanish"

    def __post_init__(self) -> None:
        object.__setattr__(self, "agent", str(self.agent))
        object.__setattr__(self, "time", not_negative(self.time, "failure.time"))
        if self.kind not in KINDS:
            raise SpecError(
                f"failure.kind must be one of {', '.join(KINDS)}; got {shown(self.kind)}.",
                key="failure.kind",
                cure='"vanish" is the default.',
            )

    def __str__(self) -> str:
        return f"agent {self.agent} fails at {self.time:g} s ({self.kind})"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Stress(Shown):
    """Options that can be combined; what is left out does not happen.

    ``noise``: standard deviation of every measured component, in the unit of x, drawn anew at every exchange (every
    0.05 s without).
    ``disturbance``: amplitude, in units of x per s, of a sine of ``frequency`` rad/s with random phases that acts
    besides d and that no exosystem knows (frequency 0: a constant).  ``saturation``: bound on every component of u, in
    units of x per s; the observer is told the input that is applied.  ``period`` (s): couplings, input and observer are
    computed at its multiples and held between (see ``sampled``); ``sampled_gain`` (q, m) is then the observer's, as
    ``design_observer(period=...)`` gives it, in place of the discretised W.  ``loss``: probability that a packet is
    lost, on every arc and at every exchange; the listener keeps the last one it got.  ``exchange`` (s): time between
    exchanges, the period where there is one, else 0.05 s.  ``failures``: agents that fail.
    """

    noise: float = 0.0
    disturbance: float = 0.0
    frequency: float = 1.0
    saturation: float | None = None
    period: float | None = None
    sampled_gain: tuple[tuple[float, ...], ...] | None = None
    loss: float = 0.0
    exchange: float | None = None
    failures: tuple[Failure, ...] = ()

    def __post_init__(self) -> None:
        for name in ("noise", "disturbance", "frequency", "loss"):
            object.__setattr__(self, name, not_negative(getattr(self, name), name))
        if self.loss > 1:
            raise SpecError(f"loss must be a probability, 0 to 1; got {self.loss:g}.", key="loss", cure="Such as 0.1.")
        if self.saturation is not None:
            object.__setattr__(self, "saturation", positive(self.saturation, "saturation"))
        for name in ("period", "exchange"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, seconds(getattr(self, name), name, example="0.05"))
        if self.period is not None and self.exchange not in (None, self.period):
            raise SpecError(
                "exchange must be left out when a period is given, because a sampled agent exchanges when it samples.",
                key="exchange",
                cure="Leave one of them out.",
            )
        self._check_gain()
        self._check_failures()

    def _check_gain(self) -> None:
        if self.sampled_gain is None:
            return
        if self.period is None:
            raise SpecError(
                "sampled_gain needs a period, because it is the gain of a sampled observer.",
                key="sampled_gain",
                cure="Give the period it was designed for.",
            )
        try:
            shape = np.shape(self.sampled_gain)
        except ValueError:  # rows of different lengths, which the next line refuses
            shape = (0, 0)
        gain = finite_array(self.sampled_gain, "sampled_gain", shape=shape, because="one row per exosystem state")
        object.__setattr__(self, "sampled_gain", tuple(map(tuple, np.atleast_2d(gain).tolist())))

    def _check_failures(self) -> None:
        given: Any = self.failures
        failures = (given,) if isinstance(given, Failure) else tuple(given)
        if not all(isinstance(each, Failure) for each in failures):
            raise SpecError(
                "failures must be a list of Failure.", key="failures", cure='Such as [Failure(agent="3", time=2.0)].'
            )
        agents = [each.agent for each in failures]
        for agent in agents:
            if agents.count(agent) > 1:
                raise SpecError(f"agent {shown(agent)} fails twice.", key="failures", cure="Leave one of them out.")
        object.__setattr__(self, "failures", failures)

    def _card(self) -> Card:
        return Card(title="Stress", text=str(self))

    @property
    def is_calm(self) -> bool:
        """Whether nothing happens at all."""
        return not (
            self.noise
            or self.disturbance
            or self.saturation is not None
            or self.period is not None
            or self.loss
            or self.exchange is not None
            or self.failures
        )

    @property
    def exchanges(self) -> float | None:
        """Time in s between two exchanges; None where states are heard continuously."""
        if self.period is not None:
            return self.period
        if self.exchange is not None:
            return self.exchange
        return EXCHANGE if self.loss else None

    @property
    def draws(self) -> float | None:
        """Time in s between two draws of the measurement noise; None where nothing is ever drawn or exchanged."""
        return EXCHANGE if self.noise and self.exchanges is None else self.exchanges

    def failing(self, problem: Problem) -> dict[int, Failure]:
        """Failures by the agent's index.  Raises: SpecError for an agent that is not there."""
        places = {label: place for place, label in enumerate(problem.network.labels)}
        for each in self.failures:
            if each.agent not in places:
                raise SpecError(
                    f"failures names {shown(each.agent)}, and no agent has this label.",
                    key="failures",
                    cure=f"Labels are {', '.join(problem.network.labels[:6])}, ...",
                )
        return {places[each.agent]: each for each in self.failures}

    def __str__(self) -> str:
        words = []
        if self.noise:
            words.append(f"measurement noise {self.noise:g}")
        if self.disturbance:
            words.append(f"unmodelled disturbance {self.disturbance:g} at {self.frequency:g} rad/s")
        if self.saturation is not None:
            words.append(f"|u| at most {self.saturation:g}")
        if self.period is not None:
            words.append(f"sampled every {self.period:g} s")
        elif self.exchanges is not None:
            words.append(f"exchanges every {self.exchanges:g} s")
        if self.loss:
            words.append(f"{self.loss:.3g} of the packets lost")
        return "; ".join([*words, *map(str, self.failures)]) or "no stress"


def stress_to_json(stress: Stress) -> str:
    """A stress as one JSON object."""
    return json.dumps(asdict(stress), ensure_ascii=False)
