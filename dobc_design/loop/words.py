"""What errors are, in words.

Sentences are written for agents with a target, where e_i = x_i - target.  Where agents agree on a
value that nobody prescribes errors are differences of states, and this is where the same sentences
are turned: a new goal is a new table of ``words.toml``.

Why they are turned, and not made with these words: some 200 sentences in 45 files of the topics and
of the report speak of errors, whatever these are, and each would ask a noun for its words; what is
proved is the same sentence with another e.  Where agents do something else, and not the same with
other errors, the sentence is made there by ``loop.goal``.  Two things keep this honest: nothing
that a user typed is turned, and a test finds every phrase in a text of the package, so that no
phrase is left behind by a sentence that changes.
"""

import re
from collections.abc import Callable, Iterable
from functools import lru_cache

from dobc_design._files import own_table

from .loop import Loop
from .pairs import FIXED, silent_agent

_TABLES = own_table("loop/words.toml")
#: By goal of a loop.
_TABLE_OF = {
    "agreement": "agreement",
    "differences": "agreement",
    "roots": "agreement",
    "containment": "containment",
}

Said = Callable[[str], str]


@lru_cache(maxsize=16)
def said_of(loop: Loop, *typed: str) -> Said:
    """What turns a sentence about a target into one about what the agents of ``loop`` are to do;
    ``typed``: texts of users, besides those of the loop, that sentences may repeat."""
    table = _TABLE_OF.get(loop.goal)
    if table is None:
        return _unchanged
    # In a formation they agree on e = x - offset.
    state = "e" if loop.goals.offsets else "x"
    of_loop = (loop.name, loop.unit, *loop.labels, *loop.fixed, *loop.modes)
    return _turned(table, state, _compared_with(loop), (*of_loop, *typed))


def _unchanged(text: str) -> str:
    return text


def _compared_with(loop: Loop) -> str:
    """The label of the agent whose state all others are compared with; "" where that is each."""
    if loop.goal == "differences":
        return "" if loop.fixed == FIXED else loop.fixed[0]
    leader = silent_agent(loop) if loop.agrees else None
    return "" if leader is None else loop.labels[leader]


def _any_of(texts: Iterable[str]) -> re.Pattern[str]:
    """Finds the longest of some texts.  It ends where its word ends: "the targets" is no phrase."""
    longest_first = sorted(texts, key=len, reverse=True)
    return re.compile(f"(?:{'|'.join(map(re.escape, longest_first))})(?!\\w)")


def _turned(table: str, state: str, leader: str, typed: Iterable[str]) -> Said:
    turns = _TABLES[table]
    # What a user typed is found first, and stays, where a phrase stands in it; a name that is a
    # phrase itself cannot be told from it.  There may be very many that have none.
    held = filter(_any_of(turns).search, typed)
    found = _any_of({*turns, *held})

    def said(text: str) -> str:
        return found.sub(turn, text)

    def turn(match: re.Match[str]) -> str:
        phrase: str | None = turns.get(match[0])
        if phrase is None:
            return match[0]
        other = f"{state}_{leader}"
        if not leader:
            other = f"{state}ⱼ" if "ᵢ" in phrase else f"{state}_j"
        return phrase.format(x=state, j=other, v="v_i" if leader else "v_ij")

    return said
