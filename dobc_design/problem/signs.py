"""Arcs that people mean to be negative: agents that oppose each other, and the change of signs that
removes them.

An arc with the sign -1 couples by h(-x_j - x_i).  Where a division of the agents into two sides
fits all signs (the graph is balanced), x -> -x on one side turns every sign into +1 if h is odd: an
ordinary problem.  Words only.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from dobc_design._show.cards import listed

Signed = tuple[int, int, bool]  # listener, speaker, and whether the two oppose each other


def two_sides(n: int, arcs: Iterable[Signed]) -> tuple[list[int], list[int]] | None:
    """Two sides such that agents oppose each other exactly across them; None if the signs do not
    balance.  The first agent of every connected part is on the first side."""
    linked: list[list[tuple[int, bool]]] = [[] for _ in range(n)]
    for listener, speaker, opposed in arcs:
        linked[listener].append((speaker, opposed))
        linked[speaker].append((listener, opposed))
    side: list[int | None] = [None] * n
    # Breadth first from one agent of every part: each arc says on which side its other end is.
    for first in range(n):
        if side[first] is not None:
            continue
        side[first] = 0
        waiting = deque([first])
        while waiting:
            agent = waiting.popleft()
            for other, opposed in linked[agent]:
                wanted = int(side[agent] != int(opposed))
                if side[other] is None:
                    side[other] = wanted
                    waiting.append(other)
                elif side[other] != wanted:
                    return None
    return [i for i in range(n) if side[i] == 0], [i for i in range(n) if side[i] == 1]


def opposition_advice(labels: Sequence[str], arcs: Iterable[Signed], *, cure: str) -> str:
    """How a signed graph is written today; ``cure``: what makes all its signs positive, as a
    request."""
    sides = two_sides(len(labels), arcs)
    if sides is None:
        return (
            "Its signs do not balance: no two sides of agents oppose each other by them, so the "
            "agents can agree on 0 only. With target 0 and an odd h it can be written with every "
            "agent twice, as a and as a copy that stands for -x of a: where a opposes b, let a "
            "listen to the copy of b and the copy of a to b, with positive signs; give every other "
            "arc and every pin to both."
        )
    here, there = (listed([labels[i] for i in side]) for side in sides)
    return (
        f"Its signs balance: agents {here} oppose agents {there}. Let x stand for -x on one side, "
        f"best on the one without pins, and {cure}: with an odd h this is the same network. That "
        "side then ends at minus the target, and its starts and offsets change sign; with pins on "
        "both sides the target has to be 0."
    )


def turned_text(text: str) -> str:
    """The expression with the other sign: of a sum, or without a minus sign in front, in
    brackets."""
    inner = text.strip().removeprefix("-").strip()
    depth, plain = 0, text.strip().startswith("-")
    # A sum at the top level needs brackets; the sign of an exponent (1e-3) is no sum.
    for before, letter in zip("(" + inner, inner, strict=False):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and letter in "+-" and before not in "eE*/":
            plain = False
    return inner if plain else f"-({text})"
