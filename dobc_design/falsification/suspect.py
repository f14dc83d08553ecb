"""What a search against the region, or against a certified set, brought up.

A Suspect is a start with its simulated motion: an illustration, never a refutation.  Only a proved
equilibrium is one.
"""

import numpy as np

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Headed, Told
from dobc_design.conditions.check import Check
from dobc_design.conditions.equilibrium.decide import Equilibrium
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import number_text
from dobc_design.exact.reading import Document, Texts

STAYS_AWAY = "does not converge"
LEAVES = "leaves the certified set"
RESTS = "equilibrium"
MOST_WRITTEN = 10  # suspects of a JSON document
MOST_NAMED = 6  # agents of a suspect in words


@noun(eq=False)
class Suspect(Told):
    """One start and what became of it.

    Shapes: start (n, m), x at t = 0; eps (n, q), xi - xihat there; times (T,) in s; error (T,),
    |e|_inf, nan from where the run had ended.  ``final_error`` is the last of them.  ``labels``
    name the agents that are farthest from the target at the end, ``modes`` the active mode by the
    time from which it is (s). ``equilibrium``: the proved box where there is one.
    """

    kind: str
    start: Array
    eps: Array
    final_error: float
    times: Array
    error: Array
    labels: Texts
    modes: tuple[tuple[float, str], ...]
    equilibrium: Equilibrium | None = None

    def __post_init__(self) -> None:
        for array in (self.start, self.eps, self.times, self.error):
            array.setflags(write=False)

    def to_json(self) -> Document:
        """JSON object: where it starts and what becomes of it; infinite errors and runs that ended
        are null."""
        return {
            "kind": self.kind,
            "proved": self.equilibrium is not None,
            "start": self.start.tolist(),
            "eps": self.eps.tolist(),
            "final_error": _finite(self.final_error),
            "times": self.times.tolist(),
            "error": [_finite(error) for error in self.error.tolist()],
            "labels": list(self.labels),
            "modes": [list(each) for each in self.modes],
        }

    def __str__(self) -> str:
        proved = " (proved)" if self.equilibrium is not None else ""
        names = ", ".join(self.labels[:MOST_NAMED])
        if len(self.labels) > MOST_NAMED:
            names += ", ..."
        first = self.error[0]
        last = self.final_error
        errors = f"|e|_inf from {first:.4g} to {last:.4g} after {self.times[-1]:.4g} s"
        return f"{self.kind}{proved}: {errors}, farthest: {names}"

    def __repr__(self) -> str:
        return f"<Suspect: {self}>"


@noun(eq=False)
class Falsification(Headed):
    """The outcome of a search.

    ``tried``: starts that were simulated; ``unfinished``: those among them whose runs took too many
    steps. ``suspects``: the worst first; ``proved``: equilibria other than the target, each a box
    that holds one. ``check``: the one that refutes the region asked for, None if no proved
    equilibrium lies there. ``target`` says in words what was searched.  With a certified set
    ``certified_rate`` (1/s) is its rate and ``observed_rate`` the slowest decay of its function V
    that was seen; both None without one.
    """

    name: str
    target: str
    tried: int
    unfinished: int
    suspects: tuple[Suspect, ...]
    proved: tuple[Equilibrium, ...]
    check: Check | None
    horizon: float
    seed: int
    certified_rate: float | None = None
    observed_rate: float | None = None
    notes: Texts = ()

    def to_json(self) -> Document:
        """JSON object.  ``proved`` lists boxes that each hold an equilibrium, ends as exact
        rationals."""
        shown = self.suspects[:MOST_WRITTEN]
        return {
            "target": self.target,
            "tried": self.tried,
            "unfinished": self.unfinished,
            "horizon": self.horizon,
            "seed": self.seed,
            "suspects": [each.to_json() for each in shown],
            "proved": [_box(claim) for claim in self.proved],
            "refutes": self.check is not None,
            "certified_rate": self.certified_rate,
            "observed_rate": self.observed_rate,
            "notes": list(self.notes),
        }

    def _card(self) -> Card:
        found = f"{len(self.suspects)} suspect(s)" if self.suspects else "no suspect"
        words = [f"{self.tried} starts from {self.target}", found]
        words.append(f"{len(self.proved)} proved equilibria")
        if self.certified_rate and self.observed_rate is not None:
            words.append(f"certified rate {self.certified_rate:.4g} 1/s")
            words.append(f"slowest seen {self.observed_rate:.4g}")
        lines = [*self.notes, *map(str, self.suspects)]
        return Card(title=self.name, text=", ".join(words), lines=lines)


def _finite(number: float) -> float | None:
    """A number as JSON has it."""
    return number if np.isfinite(number) else None


def _box(claim: Equilibrium) -> Document:
    """Where a proved equilibrium lies."""
    sides = [[number_text(side.lo), number_text(side.hi)] for side in claim.box]
    return {"mode": claim.mode, "box": sides}
