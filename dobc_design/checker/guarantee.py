"""Which mode may be on when: what `switching` of problem.json lets a proof assume.

Without a guarantee, or with "arbitrary", any mode may be on at any time. "dwell" and "sequence"
lead through phases, "markov" means a chain that draws the modes. Nothing is read before a claim
asks for it: other claims do not depend on it.
"""

from bisect import bisect_right
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, combinations, pairwise
from typing import NamedTuple

from .matrices import ZERO, Matrix, paired
from .reading import Object, matrix, maybe, need, rational, read, text

TIMES = ("dwell", "period", "longest")
Cycles = list[tuple[str, ...]]  # modes that may be on in turn for ever
PHASES = 40  # of a guarantee whose cycles of modes are looked at one by one


class Phase(NamedTuple):
    """A mode that is on for ``shortest`` to ``longest`` (None: for ever), then a phase of
    ``following``."""

    mode: str
    shortest: Fraction
    longest: Fraction | None
    following: list[int]
    first: bool  # whether a signal may begin with it


class Turn(NamedTuple):
    """A timed phase that is on from ``begun`` to ``end``; ``place``: its number in a round."""

    place: int
    begun: Fraction
    end: Fraction


class Guarantee:
    """The signals that a proof has to hold for."""

    def __init__(self, table: Object | None, modes: list[str]) -> None:
        self.table = table or {}
        self.modes = modes
        self.kind = self.table.get("guarantee")
        self.several = len(modes) > 1

    # --- phases
    @cached_property
    def phases(self) -> list[Phase]:
        """Those of "dwell" or "sequence"."""
        phased = self.kind in ("dwell", "sequence") and self.several
        there = [key for key in TIMES if self.table.get(key) is not None]
        number = {key: rational(self.table[key]) for key in there}
        need(phased, "there is no guarantee")
        if self.kind == "dwell":
            return self.dwelling(number)
        return self.repeated(number)

    def dwelling(self, number: dict[str, Fraction]) -> list[Phase]:
        """One phase for each mode; any other may follow, and any may be the first."""
        dwell = number.get("dwell", ZERO)
        need(dwell > 0, "it is not said how long a mode lasts at least")
        found = []
        for k, mode in enumerate(self.modes):
            others = [q for q in range(len(self.modes)) if q != k]
            found.append(Phase(mode, dwell, number.get("longest"), others, True))
        return found

    def repeated(self, number: dict[str, Fraction]) -> list[Phase]:
        """A list of modes and lengths, over and over."""
        order = read(self.table.get("sequence"), maybe([text])) or self.modes
        listed = read(self.table.get("schedule"), maybe([(rational, text)])) or []
        lengths_known = "period" in number or ("dwell" in number and not listed)
        need(lengths_known, "it is not said how long a phase lasts")
        # instants and modes: the last one lasts until the first of the next round
        if listed:
            begins = [time for time, _ in listed]
            order = [mode for _, mode in listed]
            lengths = [b - a for a, b in pairwise([*begins, number["period"] + begins[0]])]
        else:
            each = number["dwell"] if "dwell" in number else number["period"] / len(order)
            lengths = [each] * len(order)
        need(set(order) <= set(self.modes) and min(lengths) > 0, "the sequence is none of modes")
        # a list that repeats itself has fewer phases than entries
        turns = shortest_round(list(paired(order, lengths)))
        found = []
        for k, (mode, time) in enumerate(turns):
            found.append(Phase(mode, time, time, [(k + 1) % len(turns)], k == 0))
        return found

    @cached_property
    def timed(self) -> list[Phase]:
        """The phases where it is said which one is on at every time, else none."""
        if self.several and self.kind == "sequence":
            return self.phases
        return []

    def turn_at(self, time: Fraction) -> Turn:
        """The timed phase that is on from a time on."""
        ends = list(accumulate(turn.shortest for turn in self.timed))
        begun = time - time % ends[-1]  # of the round
        place = bisect_right(ends, time - begun)
        before = ends[place - 1] if place else ZERO
        return Turn(place, begun + before, begun + ends[place])

    def cycles(self) -> Cycles:
        """Modes that may be on over and over, and no other; no longer cycle lacks all of them."""
        turns = self.phases
        found: Cycles = [(turn.mode,) for turn in turns if turn.longest is None]
        every = tuple(dict.fromkeys(turn.mode for turn in turns))
        # dwell: two modes may alternate for ever, whatever the others are
        if len(turns) > 1 and all(turn.first for turn in turns):
            found += combinations(every, 2)
        else:
            found.append(every)
        return found

    def allowed(self) -> Cycles:
        """All modes, whatever arcs are there, and the cycles that a guarantee allows of at most
        PHASES phases."""
        found = [tuple(self.modes)]
        if self.several and self.kind in ("dwell", "sequence") and len(self.phases) <= PHASES:
            found += self.cycles()
        return found

    # --- the Markov chain
    @cached_property
    def chain(self) -> Matrix:
        """The rates from mode to mode of the Markov chain that proofs may assume."""
        size = len(self.modes)
        need(self.kind == "markov" and size > 1, "there is no Markov chain to assume")
        G: Matrix = read(self.table.get("generator"), matrix(size, size))
        rates = (x for k, row in enumerate(G) for q, x in enumerate(row) if q != k)
        # a chain has rates >= 0, and what leaves a mode arrives elsewhere
        need(min(rates) >= 0 and not any(map(sum, G)), "the generator is none")
        return G

    def may_stay(self, mode: str) -> bool:
        """Whether a signal that keeps the guarantee may stay in the mode for ever."""
        if not self.several or self.kind in (None, "arbitrary"):
            return True
        # with a rate out of the mode it is left with probability 1
        if self.kind == "markov":
            place = self.modes.index(mode)
            return self.chain[place][place] == 0
        if all(turn.mode == mode for turn in self.phases):
            return True
        return any(turn.longest is None for turn in self.phases if turn.mode == mode)


def shortest_round(turns: list[tuple[str, Fraction]]) -> list[tuple[str, Fraction]]:
    """The shortest beginning that, over and over, gives the whole."""
    whole = len(turns)
    for size in range(1, whole):
        if whole % size == 0 and turns[size:] == turns[: whole - size]:
            return turns[:size]
    return turns
