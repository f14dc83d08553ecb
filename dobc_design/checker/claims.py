"""What certificate.json claims about a loop: read, and not judged."""

from fractions import Fraction
from typing import Any

from .files import Problem
from .loop import Loop
from .reading import an_object, document, json_number, matrix, maybe, need, read, short_matrix, text


def at_least_one(value: Any) -> Fraction:
    """A factor."""
    factor = json_number(value)
    need(1 <= factor <= 10**300, "a factor is less than 1, or far too large")
    return factor


def read_domain(value: Any) -> Any:
    """The name of a domain, or a box or ball of starts."""
    if type(value) is str:
        return value
    return read(value, STARTS)


STARTS = {"kind": text, "radius": maybe(json_number), "disturbance": maybe(json_number)}
FIX = {"kind": text, "set": an_object, "text": text}
CHECK = dict.fromkeys(("id", "verdict", "reason", "mode?", "group?"), text) | {
    "domain": read_domain,
    "margin": maybe(json_number),
    "rate": maybe(json_number),
    "factor?": maybe(at_least_one),
    "exact?": an_object,
    "witness?": an_object,
    "fix?": FIX,
}
TEXTS = ("format", "problem", "problem_sha256", "verdict", "reason")


def need_rate(check: Any, most: Fraction, message: str) -> None:
    """The check has a rate > 0, and at most this one follows."""
    need(check.rate is not None and 0 < check.rate <= most, message)


class Case(Loop):
    """A loop with the claims of one certificate about it."""

    def __init__(self, data: bytes, problem: Problem) -> None:
        super().__init__(problem)
        self.problem = problem
        gain = maybe(matrix(self.q, len(self.C)))
        form = maybe(matrix(self.q, self.q))
        shape = dict.fromkeys(TEXTS, text) | {
            "version": None,
            "program": {"name": text, "version": text, "options?": [text]},
            "rate": maybe(json_number),
            "factor?": maybe(at_least_one),
            "covered_by": maybe(text),
            "observer": {"W": gain, "source": maybe(text), "P": form, "Q": gain},
            "checks": [CHECK],
            "notes": [text],
            "value?": None,  # judged where it is decided
        }
        # nothing of the problem is taken from here: sizes and names come from the loop
        self.claims = read(document(data, "dobc-certificate"), shape)
        self.checks = self.claims.checks
        self.W = self.claims.observer.W
        self.P = self.claims.observer.P
        # a W of the problem has the size that its author gave it
        short_matrix([] if self.given_W else self.W or [])
        short_matrix(self.P or [])
        self.theorem = "theorem2" if self.switches else "theorem1"
        # of the modes, once they are known (consensus.room)
        self.rooms: dict[str, Fraction | None] = {}

    def proved(self, id: str) -> Any:
        """The check with this id, if it is claimed to be proved: it is confirmed as well, since
        all have to be."""
        found = (check for check in self.checks if (check.id, check.verdict) == (id, "proved"))
        return next(found, None)
