"""What a check is decided and confirmed for: a loop with a gain, and the checks beside it.

A condition may rest on another one that is proved already.  It asks for it by the noun that is
claimed, not by an id: ``case.proved(Separable)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from dobc_design._checks import noun
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import gain_of_rows, rows_of

from .check import Check, read_domain
from .domain import EVERYWHERE, Around, Box, Domain

Noun = TypeVar("Noun")


@noun(eq=False)
class Case:
    """The loop, the gain W (q, m) of its observer, the domain of Lemma 1,
    and the ``checks`` that are known beside.

    The claims of these checks are nouns where they were just decided.  Checks that were read from a
    file hold values until somebody reads them for a trusted problem, and are found by their id.
    """

    loop: Loop
    W: Matrix | None
    domain: Domain
    checks: tuple[Check, ...] = ()

    @property
    def of_rows(self) -> Case | None:
        """The same for the loop whose errors rows bound; None where it has too many nodes."""
        rows = rows_of(self.loop, self.W)
        if rows is None:
            return None
        return replace(self, loop=rows, W=gain_of_rows(self.loop, self.W))

    def and_(self, more: Iterable[Check]) -> Case:
        """The same case with more checks."""
        return replace(self, checks=(*self.checks, *more))

    def named(self, id: str) -> Check | None:
        """The first check with this id, whatever its verdict."""
        return next((check for check in self.checks if check.id == id), None)

    def proof(self, noun: type[object]) -> Check | None:
        """The first proved check whose claim is such a noun."""
        for check in self.checks:
            if check.is_proved and isinstance(check.claim, noun):
                return check
        return None

    def proved(self, noun: type[Noun]) -> Noun | None:
        """What that check claims."""
        check = self.proof(noun)
        claim = None if check is None else check.claim
        return claim if isinstance(claim, noun) else None


def not_all_starts(
    check: Check, case: Case, holds: Callable[..., bool] | None, *, kind: type[Around] = Box
) -> str | None:
    """None if a claim is about all starts of its check, else what is wrong: those of a domain of
    this kind, by ``holds``, or (None) every start of a linear loop.  Raises as ``read_domain``."""
    if holds is None:
        if check.domain == EVERYWHERE == case.domain:
            return None
        return "without a radius the domain must be global, and every coupling linear"
    radius, disturbance = read_domain(check.domain, case.loop, kind=kind)
    if holds(radius=radius, disturbance=disturbance):
        return None
    return "the starts are not inside the invariant set"
