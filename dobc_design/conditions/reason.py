"""Why a verdict is what it is, in parts: what stands there, and what would help.

The text is made here, and a text of a stored certificate is taken apart here, nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from dobc_design._checks import noun
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.loop import Loop

OPEN = "Undecided: "
APART = "does not apply: "
HELP = " What would help: "


@noun
class Reason:
    """Sentences that say why, and where something is known to help, the ``advice``; ``is_open``:
    nothing was decided, which the text says first; ``applies``: False where a condition is not
    about such a problem at all."""

    head: str
    advice: str = ""
    is_open: bool = False
    applies: bool = True

    def __str__(self) -> str:
        return f"{OPEN}{self.told}" if self.is_open else self.told

    @property
    def told(self) -> str:
        """The text for a place where the verdict stands already."""
        text = f"{self.head}{HELP}{self.advice}" if self.advice else self.head
        return text if self.applies else f"{APART}{text}"

    def followed_by(self, words: str) -> Reason:
        """The same with more words at its end."""
        if self.advice:
            return replace(self, advice=f"{self.advice}{words}")
        return replace(self, head=f"{self.head}{words}")

    def turned(self, said: Callable[[str], str]) -> Reason:
        """The same in other words."""
        return replace(self, head=said(self.head), advice=said(self.advice))


def open_reason(head: str, advice: str = "") -> Reason:
    """Why nothing was decided."""
    return Reason(head=head, advice=advice, is_open=True)


#: What a claim needs: whether it holds, and the words if it does not.
Need = tuple[bool, str]


def first_missing(needs: Iterable[Need]) -> str | None:
    """The words of the first need that does not hold, None if all do; later ones are not asked."""
    for holds, words in needs:
        if not holds:
            return words
    return None


def pins_obstacle(loop: Loop) -> str | None:
    """Why a proof that knows each pin by one gain matrix, the same in every mode, does not apply;
    None where all pins are such."""
    if not loop.fixed:
        return None
    return f"{APART}it is for pins that are linear, and the same in every mode."


def fixed_obstacle(loop: Loop, *, apart: bool = False) -> str | None:
    """Why a proof that knows arcs to the target does not apply; None where no other nodes are
    fixed.  ``apart``: of a proof that holds for differences of agents, too."""
    is_known = loop.goal == "target" or (apart and loop.goal == "differences")
    if is_known and not loop.gap and not loop.saturates:
        return None
    return pins_obstacle(loop)


def gap_obstacle(loop: Loop) -> str | None:
    """Why a proof about errors from one target does not apply; None where they are such."""
    if not loop.gap:
        return None
    return f"{APART}it is about one target, and the fixed nodes differ or move."


def shares_obstacle(loop: Loop) -> str | None:
    """Why the decrease of V = sum d_i e_i'e_i cannot be shared out among arcs; None if it can."""
    if loop.is_apart and loop.groups:
        return f"{APART}two agents that differ have two estimation errors."
    curve = loop.drift_place
    alone = None if curve is None else loop.functions[curve]
    couplings = (h for h in loop.functions if h is not alone)
    if (alone is not None and loop.m > 1) or not all(h.by_component for h in couplings):
        return f"{APART}it is for one function that acts on every component by itself."
    return None


def observer_obstacle(loop: Loop, W: Matrix | None) -> str | None:
    """Why no proof that counts the estimation error applies; None where it is bounded, or there is
    none."""
    if not loop.groups or W is not None:
        return None
    return (
        f"{APART}there is no observer gain W, and without one the estimation error is not bounded."
    )


def saturation_obstacle(loop: Loop) -> str | None:
    """Why what holds for exact pins only does not apply; None where inputs do not saturate."""
    if not loop.saturates:
        return None
    return f"{APART}inputs saturate, and what is left of a pin is known from below only."


def signs_obstacle(loop: Loop) -> str | None:
    """Why a proof that needs to know who opposes whom does not apply to rows, which do not say
    it."""
    if not loop.signed:
        return None
    return f"{APART}it is for agents that oppose nobody, or oppose each other across two sides."


def read_reason(text: str) -> Reason:
    """The parts of a text; ``str`` of them is the text again."""
    told = text.removeprefix(OPEN)
    said = told.removeprefix(APART)
    head, _, advice = said.partition(HELP)
    # Words after which no advice follows belong to the head.
    if not advice:
        head = said
    return Reason(head=head, advice=advice, is_open=told != text, applies=said == told)
