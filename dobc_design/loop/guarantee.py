"""What is known of the signal that switches the modes: phases, a Markov chain, or nothing.

A signal passes through phases: each lasts between its shortest and its longest time, one mode is on
during it, then a phase of its successors follows (theory, section 11).
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import NamedTuple

from dobc_design._checks import noun
from dobc_design._show.cards import Shown
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import Names
from dobc_design.problem.switching import Switching
from dobc_design.problem.tables import lasting

SHOWN_TURNS = 6  # in a sentence


@noun
class Phase(Shown):
    """A mode that is on for ``shortest`` to ``longest`` (s; None: as long as it likes); then one of
    ``successors`` (places in the list of phases) follows.  ``first``: whether a signal may begin
    with it."""

    mode: str
    shortest: Fraction
    longest: Fraction | None
    successors: tuple[int, ...]
    first: bool


Phases = tuple[Phase, ...]


@noun
class Guarantee:
    """What proofs may assume of the signal.

    ``kind``: "arbitrary", "dwell", "sequence" or "markov", as it is stated.  ``phases``: empty
    where any mode may be on at any time, and where one mode is always on.  ``dwell`` and
    ``longest`` (s): how long a mode lasts, as it is stated.  ``generator`` (M, M) in 1/s of the
    Markov chain, None without one.  ``moves``: the graph follows the positions of the agents, and
    the modes are not all of its graphs.
    """

    kind: str
    phases: Phases = ()
    dwell: Fraction | None = None
    longest: Fraction | None = None
    generator: Matrix | None = None
    moves: bool = False

    @property
    def is_given(self) -> bool:
        """Whether proofs may assume more than that any mode is on at any time."""
        return self.kind != "arbitrary"

    @property
    def round(self) -> Round | None:
        """The phases over and over; None where it is not known which mode is on at which time."""
        # Only a sequence has one first phase: of a dwell time any mode may be the first.
        if sum(phase.first for phase in self.phases) != 1:
            return None
        lengths = (phase.shortest for phase in self.phases)
        return Round(self.phases, tuple(accumulate(lengths, initial=ZERO)))

    def in_words(self) -> str:
        """Which signals a proof is about: "every signal that ..."."""
        if self.kind in ("arbitrary", "dwell"):
            return f"every signal whose modes last {lasting(self.dwell or ZERO, self.longest)}"
        shown = self.phases[:SHOWN_TURNS]
        turns = [f"{phase.mode} for {float(phase.shortest):.6g} s" for phase in shown]
        if len(self.phases) > SHOWN_TURNS:
            turns.append("...")
        return f"the signal {', '.join(turns)}, over and over"

    def modes_on(self, times: Sequence[Fraction]) -> list[str | None]:
        """The mode that is on from each time (s) to the next: "" where any may be, None where it
        changes in between."""
        # Without a round the mode at a time is unknown, which is not the same as a change.
        turns = self.round
        if turns is None:
            return [""] * (len(times) - 1)
        modes = []
        for before, after in pairwise(times):
            turn = turns.at(before)
            modes.append(turns.phases[turn.place].mode if after <= turn.ends else None)
        return modes

    def may_stay(self, mode: str, modes: Names) -> bool:
        """Whether a signal that keeps the guarantee may stay in this one of the modes for ever."""
        if self.kind == "markov" and self.generator is not None:
            # A chain leaves a mode at the rate minus its diagonal entry.
            place = list(modes).index(mode)
            return self.generator[place][place] == 0
        if not self.phases:
            return True
        # Phases of one mode may follow each other, which is the same as to stay in it.
        if {each.mode for each in self.phases} == {mode}:
            return True
        return any(each.mode == mode and each.longest is None for each in self.phases)


class Turn(NamedTuple):
    """Which phase is on: its place among the phases, when it began and when it ends (s)."""

    place: int
    begun: Fraction
    ends: Fraction


class Round(NamedTuple):
    """Phases that follow one another over and over, each of them as long as the guarantee says."""

    phases: Phases
    starts: Vector  # of each phase, and of the next round

    def at(self, time: Fraction) -> Turn:
        """The phase that is on from ``time`` (s) on."""
        round_begun = time - time % self.starts[-1]
        place = bisect.bisect_right(self.starts, time - round_begun) - 1
        begun = round_begun + self.starts[place]
        ends = round_begun + self.starts[place + 1]
        return Turn(place, begun, ends)


def guarantee_of(stated: Switching | None, modes: Names) -> Guarantee:
    """The guarantee of [switching].  A sequence that repeats a shorter one has the phases of the
    shorter one."""
    if stated is None:
        return Guarantee(kind="arbitrary")
    kind = stated.guarantee or "arbitrary"
    phases: Phases = ()
    # With one mode there is nothing to switch, whatever is stated.
    several = len(modes) > 1
    if kind == "dwell" and several:
        phases = _dwelling(stated, modes)
    elif kind == "sequence" and several:
        phases = _in_turn(_turns(stated, modes))
    generator = stated.generator if kind == "markov" and several else None
    moves = stated.signal == "mobile"
    return Guarantee(
        kind=kind,
        phases=phases,
        dwell=stated.dwell,
        longest=stated.longest,
        generator=generator,
        moves=moves,
    )


def _dwelling(stated: Switching, modes: Names) -> Phases:
    """A phase for each mode, with all others after it."""
    every = range(len(modes))
    return tuple(
        Phase(
            mode=mode,
            shortest=stated.dwell or ZERO,
            longest=stated.longest,
            successors=tuple(q for q in every if q != p),
            first=True,
        )
        for p, mode in enumerate(modes)
    )


def _turns(stated: Switching, modes: Names) -> list[tuple[str, Fraction]]:
    """The modes of one round, with how long each is on (s)."""
    if stated.schedule is None:
        order = list(stated.sequence or modes)
        each = stated.dwell
        if each is None:
            each = (stated.period or ZERO) / len(order)
        return [(mode, each) for mode in order]
    instants = [time for time, _ in stated.schedule]
    ends = [*instants[1:], stated.period or ZERO]
    lengths = [end - begin for begin, end in zip(instants, ends, strict=True)]
    # the last mode of a round stays on until the first instant of the next
    lengths[-1] += instants[0]
    return [(mode, length) for (_, mode), length in zip(stated.schedule, lengths, strict=True)]


def _in_turn(turns: Sequence[tuple[str, Fraction]]) -> Phases:
    shortest = turns[: shortest_period(turns)]
    return tuple(
        Phase(
            mode=mode,
            shortest=time,
            longest=time,
            successors=((p + 1) % len(shortest),),
            first=p == 0,
        )
        for p, (mode, time) in enumerate(shortest)
    )


def shortest_period(turns: Sequence[object]) -> int:
    """The least length of a beginning that, over and over, gives the whole."""
    # Fewer phases mean fewer certificates that have to fit together.
    size = len(turns)
    return next(k for k in range(1, size + 1) if size % k == 0 and turns[k:] == turns[:-k])
