"""What errors are, in words.

Sentences are written for agents with a target, where e_i = x_i - target.  Where agents agree on a
value that nobody prescribes errors are differences of states, and this is where the same sentences
are turned: a new goal is a new table of ``words.toml``.  Only texts of the package pass through
here, never a label, a unit or anything else that a user typed.
"""

import re
import tomllib
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files

from .loop import Loop
from .pairs import FIXED, silent_agent

_TABLES = tomllib.loads((files("dobc_design.loop") / "words.toml").read_text("utf-8"))
#: By goal of a loop.
_TABLE_OF = {
    "agreement": "agreement",
    "differences": "agreement",
    "roots": "agreement",
    "containment": "containment",
}

Said = Callable[[str], str]


def said_of(loop: Loop) -> Said:
    """What turns a sentence about a target into one about what the agents of ``loop`` are to do."""
    table = _TABLE_OF.get(loop.goal)
    if table is None:
        return _unchanged
    # In a formation they agree on e = x - offset.
    return _turned(table, "e" if loop.goals.offsets else "x", _compared_with(loop))


def _unchanged(text: str) -> str:
    return text


def _compared_with(loop: Loop) -> str:
    """The label of the agent whose state all others are compared with; "" where that is each."""
    if loop.goal == "differences":
        return "" if loop.fixed == FIXED else loop.fixed[0]
    leader = silent_agent(loop) if loop.agrees else None
    return "" if leader is None else loop.labels[leader]


@lru_cache(maxsize=64)
def _turned(table: str, state: str, leader: str) -> Said:
    phrases = _TABLES[table]
    longest_first = sorted(phrases, key=len, reverse=True)
    # A phrase ends where its word ends: "the targets" is none.
    found = re.compile(f"(?:{'|'.join(map(re.escape, longest_first))})(?!\\w)")

    def said(text: str) -> str:
        return found.sub(turn, text)

    def turn(match: re.Match[str]) -> str:
        phrase: str = phrases[match[0]]
        other = f"{state}_{leader}"
        if not leader:
            other = f"{state}ⱼ" if "ᵢ" in phrase else f"{state}_j"
        return phrase.format(x=state, j=other, v="v_i" if leader else "v_ij")

    return said
