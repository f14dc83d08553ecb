"""Arcs with a negative weight: what it means, and who opposes whom.

"opposes": |w| h(-x_j - x_i), the sign of a signed graph.  Where a division of the agents into two
sides fits all signs (the graph is balanced), x -> -x on one side turns every sign into +1.
"repels": w h(x_j - x_i), which is an arc with -h.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun
from dobc_design._show.cards import listed
from dobc_design.coupling.coupling import Coupling

Arc = tuple[int, int]
Texts = tuple[str, ...]
OPPOSES, REPELS = NEGATIVE = ("opposes", "repels")


@noun
class Signs:
    """Who opposes whom: ``sides`` has +1 or -1 for every agent so that agents oppose each other
    exactly across the two sides; None where no division fits, and then ``breaks`` is an arc
    (listener, speaker) that others do not allow."""

    sides: tuple[int, ...] | None
    breaks: Arc | None = None

    def side(self, agent: int) -> int:
        """+1 or -1; +1 where no division fits."""
        return 1 if self.sides is None else self.sides[agent]


def signs_of(
    n: int, arcs: Iterable[tuple[int, int, Fraction]], pinned: Iterable[int] = ()
) -> Signs:
    """The sides of n agents whose arcs of negative weight oppose.  In every connected part the
    first pinned agent, or the first one if none is, has +1."""
    known = tuple(arcs)
    near: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    for listener, speaker, weight in known:
        sign = 1 if weight > 0 else -1
        near[listener].append((speaker, sign))
        near[speaker].append((listener, sign))
    sides = [0] * n
    for first in (*pinned, *range(n)):
        waiting = [] if sides[first] else [first]
        sides[first] = sides[first] or 1
        while waiting:
            agent = waiting.pop()
            for other, sign in near[agent]:
                if not sides[other]:
                    sides[other] = sign * sides[agent]
                    waiting.append(other)
    for listener, speaker, weight in known:
        if sides[listener] * sides[speaker] * weight < 0:
            return Signs(sides=None, breaks=(listener, speaker))
    return Signs(sides=tuple(sides))


def signs_words(signs: Signs, labels: Sequence[str]) -> str:
    """Who opposes whom, in a sentence without its end."""
    if signs.sides is None:
        listener, speaker = (labels[agent] for agent in signs.breaks or ())
        return (
            f"the signs do not balance ({listener} listens to {speaker} fits no two sides of "
            "agents that oppose each other), so that agents can meet at 0 only"
        )
    one, other = (
        listed([label for label, own in zip(labels, signs.sides, strict=True) if own == side])
        for side in (1, -1)
    )
    return (
        f"agents {one} oppose agents {other}, by signs that balance: sentences about agents "
        f"{other} are about -x of them, which goes where x of the others does"
    )


def repelling(
    coupling: Any, exceptions: Mapping[Arc, Any] | None, arcs: Iterable[Arc]
) -> dict[Arc, Any]:
    """The exceptions with -h on these arcs; couplings in any form that a problem takes."""
    found = dict(exceptions or {})
    for arc in arcs:
        h = found.get(arc, coupling)
        texts = h.texts if isinstance(h, Coupling) else h
        if isinstance(texts, str):
            texts = (texts,)
        turned = tuple(map(turned_text, texts))
        found[arc] = turned[0] if len(turned) == 1 else turned
    return found


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
