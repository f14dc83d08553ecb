"""Arcs that people mean to be negative: agents that oppose each other, and the change of signs that
removes them.

An arc with the sign -1 couples by h(-x_j - x_i).  Where a division of the agents into two sides
fits all signs (the graph is balanced), x -> -x on one side turns every sign into +1 if h is odd: an
ordinary problem.  Words only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dobc_design._show.cards import listed

Signed = tuple[int, int, bool]  # listener, speaker, and whether the two oppose each other


def two_sides(n: int, arcs: Iterable[Signed]) -> tuple[list[int], list[int]] | None:
    """Two sides such that agents oppose each other exactly across them; None if the signs do not
    balance.  The first agent of every connected part is on the first side."""
    from scipy.sparse import coo_array  # only where signs are mixed
    from scipy.sparse.csgraph import connected_components

    # Every agent twice, as itself and as its opposite: opposed agents are linked to opposites.
    begins = []
    ends = []
    for listener, speaker, opposed in arcs:
        begins += [listener, listener + n]
        ends += [speaker + n, speaker] if opposed else [speaker, speaker + n]
    links = np.ones(len(begins)), (begins, ends)
    graph = coo_array(links, shape=(2 * n, 2 * n))
    part = connected_components(graph, directed=False)[1]
    if np.any(part[:n] == part[n:]):
        return None
    # Parts are numbered as they are met, so that the first agent of each is on the first side.
    first = part[:n] < part[n:]
    return np.flatnonzero(first).tolist(), np.flatnonzero(~first).tolist()


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
