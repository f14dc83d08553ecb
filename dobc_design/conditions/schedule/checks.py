"""The checks `settling` and `schedule` as a certificate holds them, and back
(docs/certificate-claims.md)."""

from dataclasses import replace
from fractions import Fraction
from functools import partial

from dobc_design.conditions.arcs import claim as arcs
from dobc_design.conditions.case import Case, not_all_starts
from dobc_design.conditions.check import (
    Check,
    Values,
    not_a_proof,
    read_domain,
    read_parts,
    undecided_check,
    with_optional,
)
from dobc_design.conditions.coverage import Asked as Region
from dobc_design.conditions.domain import EVERYWHERE, Box, Domain
from dobc_design.conditions.numbers import (
    claimed,
    decimal_below,
    follows,
    rational_or_none,
    read_rational,
    vector_from_json,
)
from dobc_design.conditions.quadratic.decide import lure_from_json
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import (
    TURNED,
    coordinates_of,
    error_of,
    observed_in,
    separable_from_json,
)
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ONE
from dobc_design.exact.reading import Document
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import timing_words
from dobc_design.verdict import Verdict

from .claim import (
    ARC_WISE,
    QUADRATIC,
    SCHEDULE,
    SEPARABLE,
    Cycles,
    Descent,
    Last,
    Tube,
    Weights,
)
from .cycles import holds_starts
from .cycles import why_not as why_not_cycles
from .decide import why_not
from .rounds import confirm_growth
from .settling import Settling, guarantee_of, proved_reason

MOST_TIMES = 2000


def settling_check(loop: Loop, W: Matrix | None, settling: Settling, *, domain: Domain) -> Check:
    """Decide a settling time once more, for the decimals that its box domain shows: PROVED or
    UNDECIDED."""
    if settling.claim is None:
        return undecided_check("settling", domain, settling.reason)
    # The domain is written in decimals, rounded down: the claim has to be about that box.
    radius = decimal_below(settling.radius)
    disturbance = decimal_below(settling.disturbance)
    claim = replace(settling.claim, radius=claimed(radius), disturbance=claimed(disturbance))
    check = Check(
        id="settling",
        verdict=Verdict.PROVED,
        domain=Box(radius, disturbance),
        reason=proved_reason(loop, settling.claim),
        claim=claim,
    )
    case = Case(loop=loop, W=W, domain=domain)
    return check.unless(confirm(check, case), domain)


def cycles_check(claim: Cycles, asked: Region) -> Check:
    """The check of weights that move under a guarantee, decided once more as it is written."""
    rate = None
    pace = ""
    if claim.rate is not None:
        rate = decimal_below(claim.rate)
        pace = f", at least like exp(-{float(claim.rate):.4g} t)"
    domain: Domain = EVERYWHERE
    if claim.rho is not None:
        domain = Box(asked.radius, asked.disturbance)
    when = "couplings rise, and an agent is heard by all others, directly or through others: "
    if asked.loop.signed:
        when = "couplings rise, and all who hear nobody outside have a pin, or unbalanced signs: "
    if asked.loop.guarantee.phases:
        when = f"for {asked.loop.guarantee.in_words()}: "
    if claim.late:
        when += f"with {timing_words(asked.loop.timing)} "
    check = Check(
        id="schedule",
        verdict=Verdict.PROVED,
        domain=domain,
        rate=rate,
        reason=f"{when}every error decays{pace}.",
        claim=claim,
    )
    return check.unless(confirm(check, asked.case), asked.domain)


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved or refuted check of this topic claims is confirmed, else
    what is not."""
    loop, W = case.loop, case.W
    if check.id == "schedule" and check.verdict is Verdict.REFUTED:
        # Only linear couplings are refuted, by a power and without weights.
        return confirm_growth(check, loop, case.domain)
    claim = read_claim(check, loop, W)
    turned = isinstance(claim, Cycles) and claim.T is not None
    reason = obstacle(loop, W, turned=turned) or not_a_proof(check)
    if reason is not None:
        return reason
    if isinstance(claim, Values):
        return "a settling time is never refuted"
    if isinstance(claim, Cycles):
        wrong = not_as_claimed(check, case, claim.rate, claim)
        if claim.late and not claim.phases:
            wrong = "what the graphs alone show is about readings of the same instant"
        return wrong or why_not_cycles(loop, W, claim)
    if loop.goal == "roots":
        return "of so many pairs no settling time is looked at"
    if check.rate is not None:
        # Its claim says a time, and nothing of how errors fall before.
        return "a settling time has no rate"
    return why_not(loop, W, claim)


def not_as_claimed(
    check: Check, case: Case, rate: Fraction | None, claim: Cycles | None
) -> str | None:
    """What rate and domain of a check say beyond a rate and a claim (None: about every start); None
    if nothing."""
    if (check.rate is None) != (rate is None):
        return "it has a rate iff its claim has one"
    if rate is not None and not follows(check.rate, rate):
        return "its rate is not between 0 and that of its claim"
    if claim is None or claim.rho is None:
        return not_all_starts(check, case, None)
    return not_all_starts(check, case, partial(holds_starts, case.loop, claim))


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Descent | Cycles | Values:
    """What a check of this topic claims, for this problem."""
    if check.verdict is Verdict.REFUTED:
        return Values(check.exact or {})
    if check.id == "schedule":
        return cycles_from_json(check.exact, loop, turned="T" in (check.exact or ()))
    radius, disturbance = read_domain(check.domain, loop, kind=Box)
    shape = {
        "tolerance": read_rational,
        "time": read_rational,
        "tube": partial(tube_from_json, loop=loop),
        "last": dict.fromkeys(("level", "height", "stretch"), read_rational)
        | {"kind": None, "certificate": None},
    }
    values = read_parts(check.exact, shape)
    last = values.pop("last")
    certificate = _last_from_json(last.pop("kind"), last.pop("certificate"), loop, W)
    return Descent(
        certificate=certificate, radius=radius, disturbance=disturbance, **values, **last
    )


def _last_from_json(kind: object, data: object, loop: Loop, W: Matrix | None) -> Last:
    """Read the certificate that takes over back; raises as ``read_claim``."""
    if kind == QUADRATIC:
        return lure_from_json(data, loop, W)
    if kind == ARC_WISE:
        return arcs.claim_from_json(data, loop, W)
    if kind == SCHEDULE:
        return cycles_from_json(data, loop)
    if kind == SEPARABLE:
        return separable_from_json(data, loop)
    raise ValueError(f"kind must be {SEPARABLE}, {QUADRATIC}, {ARC_WISE} or {SCHEDULE}")


def tube_from_json(data: object, loop: Loop) -> Tube:
    """Read ``Tube.to_json`` back for this problem; raises as ``read_claim``."""
    boxes = [partial(vector_from_json, size=loop.n)]
    shape = {"times": [read_rational], "upper": boxes, "lower": boxes} | observed_in(loop)
    # The observer's part of a tube has no kappa; any will do.
    shape.pop("kappa", None)
    values = _timed(read_parts(data, shape))
    if loop.groups:
        values["kappa"] = ONE
    return Tube(error=error_of(values), **values)


def cycles_from_json(data: object, loop: Loop, *, turned: bool = False) -> Cycles:
    """Read ``Cycles.to_json`` back for this problem, ``turned`` with T; raises as
    ``read_claim``."""
    size = loop.size if turned else loop.n
    phase = {"times": [read_rational], "v": [partial(vector_from_json, size=size)]}
    # In coordinates z = T e the rows need the gains, enclosed.
    own = TURNED if turned else {}
    shape = {"rate": rational_or_none, "rho": rational_or_none, "phases": [phase]} | own
    shape = with_optional(shape | observed_in(loop), {"late": None}, data)
    values = coordinates_of(read_parts(data, shape), loop)
    if values.get("late", True) is not True:
        raise ValueError("late must be true, or left out")
    values["phases"] = tuple(Weights(**_timed(each)) for each in values["phases"])
    return Cycles(error=error_of(values), **values)


def _timed(values: Document) -> Document:
    """The same values, whose vectors may be no more than ``MOST_TIMES``."""
    if len(values["times"]) > MOST_TIMES:
        raise ValueError(f"there may be at most {MOST_TIMES} times")
    return values


def settling_of(loop: Loop, claim: Descent, reason: str) -> Settling:
    """The settling time and the envelope of a proved claim, which is taken as it is; ``confirm``
    decides it."""
    return Settling(
        verdict=Verdict.PROVED,
        reason=reason,
        problem_name=loop.name,
        radius=claim.radius,
        disturbance=claim.disturbance,
        tolerance=claim.tolerance,
        claim=claim,
        guarantee=guarantee_of(loop, claim),
        unit=loop.unit,
    )
