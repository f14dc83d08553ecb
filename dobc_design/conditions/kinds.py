"""The register of checks, kinds.toml: one table per id, in the order in which they are tried; words
and flags only.

What reads a claim and what confirms it are found by the topic, in ``certificate/topics.py``.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Final, Literal

from dobc_design._checks import noun
from dobc_design._files import own_table
from dobc_design._show.cards import Card, Shown
from dobc_design.exact.reading import Texts

#: What a proof is worth.  "part": a fact of the network or of the exosystem alone, the same for
#: every coupling. "paper": Lemma 1 and the theorems.  "given": a theorem with the P of the problem
#: file.  "region": for a set of starts.  "timing": carries a region over to late or held messages.
#: "rest": refutes a region.  "settling": a time. "plant": what the model leaves out, bounded.
#: "safety": a set that is not left, and with a rate for a set of starts.
Role = Literal["part", "paper", "given", "region", "timing", "rest", "settling", "plant", "safety"]


#: The only proof of consensus that every mode has for itself.
LEMMA: Final = "lemma1"
#: Whether every agent is reached from a pinned one, in one mode.
REACHABILITY: Final = "reachability"
#: The box that shrinks, on which other checks rest.
MAX_SEPARABLE: Final = "max-separable"
#: The same with late, held and lost readings, and with a processor, as the file states them.
READINGS: Final = "readings"


@noun
class Kind(Shown):
    """One kind of check.  ``topic``: its folder in ``conditions/``.  ``name`` and ``decides`` are
    the words of reports, the fields from ``title`` to ``source`` those of `dobc explain`;
    ``means`` is the question in plain words, ``statement`` is LaTeX.  ``decided_in``: its modules,
    ``checker``: the file of the second checker that decides it again.  ``signals``: whether its
    proof is about every switching signal or only about some, those of a guarantee or of a Markov
    chain.  ``own_letters``: those that mean something else here than in ``letters.toml``."""

    id: str
    topic: str
    role: Role
    name: str
    decides: str
    title: str
    means: str
    statement: str
    plain: str
    proved: str
    refuted: str
    source: str
    decided_in: Sequence[str]
    checker: str
    signals: Literal["every", "some"] = "every"
    own_letters: Mapping[str, str] = field(default_factory=dict)

    def _card(self) -> Card:
        facts = [("proved", self.proved), ("refuted", self.refuted), ("source", self.source)]
        return Card(title=self.title, text=f"{self.plain}. {self.meaning}", facts=facts)

    @property
    def meaning(self) -> str:
        """What it decides, in one sentence."""
        return f"It decides {self.decides}."

    @property
    def letters(self) -> dict[str, str]:
        """What the letters of the condition, and of what is proved, stand for, in the order in
        which they occur."""
        found: dict[str, str] = {}
        # "A" begins sentences, too, so only the condition itself is searched for it.
        beside = [word for word in _WORD.findall(self.proved) if word not in ("A", "I")]
        waiting = [*_WORD.findall(self.plain), *beside]
        known = LETTERS | dict(self.own_letters)
        while waiting:
            letter = waiting.pop(0)
            if letter in known and letter not in found:
                found[letter] = known[letter]
                waiting += _WORD.findall(_UNIT.sub("", known[letter]))
        return found

    @property
    def is_consensus(self) -> bool:
        """Whether its proof is a proof of consensus."""
        return self.role in ("paper", "given", "region")

    @property
    def is_of_paper(self) -> bool:
        """Whether it decides a condition of the paper as it is printed: V = e'e, without weights,
        with sum eps_i'P eps_i where there is an observer."""
        return self.topic == "consensus" and self.is_consensus

    @property
    def is_lemma(self) -> bool:
        """Whether it decides Lemma 1, in one mode."""
        return self.id == LEMMA

    @property
    def is_theorem(self) -> bool:
        """Whether it asks for any pair P, Q: Theorem 1 or 2, without weights."""
        return self.topic == "consensus" and self.role == "paper" and not self.is_lemma

    @property
    def short(self) -> str:
        """The name where there is little room: "Lemma 1", "Lur’e"."""
        return self.name.partition(":")[0].removesuffix(" certificate").removesuffix(" proof")


_UNIT: Final = re.compile(r", (1/)?s$")  # at the end of a definition, no letter
_WORD: Final = re.compile(r"[A-Za-z]\w*(?:'s\b)?")  # the s of "one's" is no letter
LETTERS: Final[dict[str, str]] = own_table("conditions/letters.toml")
KINDS: Final = {id: Kind(id=id, **row) for id, row in own_table("conditions/kinds.toml").items()}


def ids_of(*roles: Role) -> Texts:
    """The ids of the checks with one of these roles, in the order in which they are tried."""
    return tuple(kind.id for kind in KINDS.values() if kind.role in roles)


def ids_in(topic: str) -> Texts:
    """The ids of the checks of a topic, in the order in which they are tried."""
    return tuple(kind.id for kind in KINDS.values() if kind.topic == topic)
