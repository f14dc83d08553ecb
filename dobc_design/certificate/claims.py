"""What a certificate file claims: everything in it but the problem, which is never taken from
there.

Also how the values of a check become the noun of its topic again, for a trusted problem; nothing is
decided by that.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design._show.text import visible
from dobc_design.conditions.accuracy.value import Agreed
from dobc_design.conditions.check import Check, Checks, Claim, Values
from dobc_design.conditions.kinds import MAX_SEPARABLE
from dobc_design.conditions.reason import Reason
from dobc_design.conditions.separable.claim import SamplingBound, Separable
from dobc_design.errors import CertificateError, reason_of
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.reading import Texts, counted
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .topics import TOPICS


@noun
class Overall:
    """The verdict in one word and one sentence, the certified rate (1/s) with its factor, and the
    check that carries it."""

    verdict: Verdict
    why: Reason
    rate: float | None = None
    factor: float | None = None
    covered_by: str | None = None

    @property
    def reason(self) -> str:
        """The verdict in one sentence."""
        return str(self.why)


@noun
class Claims(Overall):
    """Verdict, checks and the matrices they rest on.

    ``reason`` is the verdict in one sentence, ``why`` its parts; ``rate`` (1/s), its ``factor`` and
    ``covered_by`` belong to the best proof. ``W`` (q, m) is the observer gain every check is about,
    ``gain_source`` says "given" or "designed"; ``P`` (q, q) and ``Q`` (q, m) belong to Theorem 1 or
    2 where it is proved.  Where agents have different exosystems, these are block diagonal, one
    block per group, and "designed" says that at least one block of W is. ``notes`` list what was
    assumed, designed or stood in.  ``options`` are those of `dobc certify` that it was made with,
    for whoever makes it again; nothing follows from them.  ``value``: of agents that agree, what is
    proved of the value on which they do.
    """

    problem_name: str
    problem_sha256: str
    checks: tuple[Check, ...]
    W: Matrix | None
    gain_source: str | None
    P: Matrix | None
    Q: Matrix | None
    notes: Texts
    version: str
    options: Texts = ()
    value: Agreed | None = None


def claim_of(check: Check, loop: Loop, W: Matrix | None) -> Claim | None:
    """What a check claims about ``problem`` with the gain W (q, m), as the noun of its topic; None
    if nothing.

    Raises what a malformed claim raises: KeyError, TypeError, ValueError, ArithmeticError or a
    DobcError.
    """
    topic = TOPICS[check.kind.topic]
    if topic.read is None or not isinstance(check.claim, Values):
        return check.claim
    return topic.read(check, *topic.about(check.id, loop, W))


def box_of(checks: Checks, loop: Loop, W: Matrix | None) -> Separable | None:
    """What the proved max-separable certificate claims, on which others rest; None without one.
    Raises: as ``claim_of``."""
    for check in checks:
        if check.id == MAX_SEPARABLE and check.is_proved:
            claim = claim_of(check, loop, W)
            return claim if isinstance(claim, Separable) else None
    return None


def failing_words(failures: Sequence[str]) -> str:
    """How many claims do not hold."""
    claims = counted(len(failures), "claim")
    return f"{claims} {'does' if len(failures) == 1 else 'do'} not hold"


@contextmanager
def reading_claims() -> Iterator[None]:
    """Turn what malformed claims raise into a CertificateError."""
    try:
        yield
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        what = (
            "a regional check of this certificate cannot be read "
            f"({visible(reason_of(error)[:100])})."
        )
        raise CertificateError(what, key="checks", cure="dobc verify says which.") from error


def certified_period(loop: Loop, claims: Claims) -> Fraction | None:
    """The sampling period (s) that a proved check of ``claims``, which are about ``problem``,
    states; None without one.

    Raises: CertificateError for claims that cannot be read.
    """
    with reading_claims():
        for check in claims.checks:
            bound = claim_of(check, loop, claims.W)
            if check.is_proved and isinstance(bound, SamplingBound):
                return bound.period
    return None
