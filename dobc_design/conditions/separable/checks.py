"""The checks max-separable, delay and sampling, from a claim that is decided to what a certificate
holds, and back.

docs/certificate-claims.md, "Regions", fixes the form.  A check is proved for the very numbers that
it shows.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import partial

from dobc_design.conditions.case import Case, not_all_starts
from dobc_design.conditions.check import Check, Witness, not_a_proof, read_domain, undecided_check
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.coverage import Asked
from dobc_design.conditions.domain import EVERYWHERE, Box, Domain
from dobc_design.conditions.kinds import MAX_SEPARABLE, READINGS
from dobc_design.conditions.numbers import (
    decimal_below,
    follows,
    rounded_down,
    shorten,
    text_below,
)
from dobc_design.conditions.reason import observer_obstacle
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import number_text
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import Timing, timing_words
from dobc_design.verdict import Verdict

from .claim import (
    DelayBound,
    ReadingsBound,
    SamplingBound,
    Separable,
    acts_by_component,
    is_stuck,
    pins_that_order,
    read_claim,
    separable_from_json,
    stuck_agents,
)
from .decide import (
    NOT_BY_COMPONENT,
    composite_rate,
    covers,
    verify_composite,
)
from .timing import (
    EIGENVALUE,
    covers_late,
    largest_period,
    late_witness_obstacle,
    overshoots,
    rest_matrix,
    turns_too_far,
    verify_delay,
    verify_readings,
    verify_sampling,
)

SHORTEST = Fraction(1, 10**30)  # sampling periods below are no use to anybody (s)
# of a sampling period, for a second program with wider enclosures
IN_HAND = Fraction(1, 1000)
_SHOWN = 6  # stuck agents that a sentence tells with the mode that blocks them
_LARGEST = 1000  # agents of a network in which the pins that would help are looked for


def obstacle(loop: Loop, W: Matrix | None, *, turned: bool = False) -> str | None:
    """Why the max-separable certificate (``turned``: in coordinates) does not apply to the loop
    with the gain W (q, m); None if it does."""
    if not turned and not acts_by_component(loop):
        return NOT_BY_COMPONENT
    return observer_obstacle(loop, W)


def max_separable_check(
    asked: Asked, claim: Separable, *, radius: float, remark: str = ""
) -> Check:
    """Decide ``claim`` as a proof for every start with |e|_inf <= radius and |eps_i| as asked.  A
    claim without rho is about all starts.  ``remark`` is added to the reason.  Returns: a Check,
    PROVED or UNDECIDED; that one claim fails says nothing against the others."""
    loop = asked.loop
    rate = decimal_below(composite_rate(claim))
    domain, starts = _starts(asked, claim, radius)
    measure = "max_i |e_i|/v_i" if claim.T is None else "max_ic |(T e_i)_c|/v_ic"
    if claim.error is not None:
        measure += f" + {float(claim.error.kappa):.4g} max_i |eps_i|_P"
    everywhere = ", in every mode" if len(loop.modes) > 1 else ""
    check = Check(
        id=MAX_SEPARABLE,
        verdict=Verdict.PROVED,
        domain=domain,
        rate=rate,
        claim=claim,
        reason=f"{starts} reaches the target: V = {measure} decays at least like "
        f"exp(-{text_below(rate)} t)"
        f"{everywhere} (max-separable Lyapunov function).{remark}",
    )
    return check.unless(confirm(check, asked.case), asked.domain)


def _starts(asked: Asked, claim: Separable, radius: float) -> tuple[Domain, str]:
    """What a claim about this box holds for, also in words."""
    if claim.rho is None:
        return EVERYWHERE, "every start"
    starts = f"every start with |e_i| <= {radius:.6g}"
    if asked.loop.groups:
        starts += f" and |eps_i| <= {asked.disturbance:.6g}"
    return Box(radius, asked.disturbance), starts


def why_no_weights(loop: Loop) -> str | None:
    """Why no weights v exist whatever the couplings, the gains and the errors are; None if nothing
    speaks against them."""
    if not acts_by_component(loop) or not stuck_agents(loop):
        return None
    if len(loop.modes) == 1:
        return "no weights v exist, because no pinned agent reaches every other one."
    return "this is decided for arbitrary switching, where no common weights v exist."


def stuck_check(loop: Loop, W: Matrix | None, *, domain: Domain) -> Check | None:
    """REFUTED, with the agents that no common v can hold, if there are such agents; else None."""
    stuck = stuck_agents(loop)
    if obstacle(loop, W) is not None or not stuck:
        return None
    labels = tuple(loop.named(stuck))
    held = "pinned" if loop.m == 1 else "held by a pin in every component"
    one, many = f"is not {held} and ", f"are not {held} and "
    if loop.gap:  # no pins: a fixed node is somebody who is heard
        one = many = ""
    reason = (
        f"no weights v exist because of {name_agents(labels)}: each agent named has a mode in "
        f"which it {one}hears nobody outside this group."
    )
    if len(loop.modes) > 1 and len(labels) <= _SHOWN:
        modes = zip(labels, stuck.values(), strict=True)
        told = ", ".join(f"{label} in {mode}" for label, mode in modes)
        reason = f"no common weights v exist: these agents {many}hear only each other: {told}."
    # Of agents with dynamics it may be a component that is not held, of one that is pinned.
    advised = loop.drift is None and loop.goal != "differences"
    if advised and len(labels) <= _SHOWN and loop.n <= _LARGEST:
        pins = name_agents(tuple(loop.named(pins_that_order(loop))))
        cure = f"An arc from a fixed node to {pins}" if loop.gap else f"Pinning {pins}"
        reason += f" {cure} would remove this obstacle; larger gains would not."
    witness = Witness(kind="agents", labels=labels)
    return Check(
        id=MAX_SEPARABLE, verdict=Verdict.REFUTED, domain=domain, reason=reason, witness=witness
    )


def delay_check(
    loop: Loop, claim: Separable, bound: DelayBound, beside: Check, *, domain: Domain
) -> Check:
    """Decide what ``claim``, proved by the check ``beside``, says about delays up to
    ``bound.delay`` (s)."""
    answer = verify_delay(loop, claim, bound)
    rate = decimal_below(bound.rate)
    if answer.wrong is not None or not rate:
        return undecided_check("delay", domain, answer.reason)
    reason = (
        "stable for every bounded communication delay; for delays up to "
        f"{float(bound.delay):.4g} s, constant or"
        f" varying, the error decays at every rate below {text_below(rate)} 1/s."
    )
    if bound.own_delay:
        reason += f" Own readings may be {float(bound.own_delay):.4g} s old at the same time."
    if bound.event:
        part = float(100 * bound.event)
        reason += (
            f" In place of late readings they may be off by {part:.4g} % (event triggers, "
            "quantisers)."
        )
    return Check(
        id="delay",
        verdict=Verdict.PROVED,
        domain=beside.domain,
        rate=rate,
        claim=bound,
        reason=reason,
    )


def readings_check(asked: Asked, claim: Separable, *, radius: float) -> Check:
    """Decide ``claim`` as a proof with the readings and the processor that the problem states, for
    every start with |e|_inf <= radius and |eps_i| as asked."""
    rate = decimal_below(claim.alpha)
    domain, starts = _starts(asked, claim, radius)
    timing = asked.loop.timing or Timing()
    when = ", at the samples" if timing.period else ""
    if timing.ahead:
        when += f", t from {float(timing.ahead):.6g} s on, when the first input acts"
    check = Check(
        id=READINGS,
        verdict=Verdict.PROVED,
        domain=domain,
        rate=rate,
        claim=ReadingsBound(rows=claim),
        reason=f"{starts} reaches the target with {timing_words(asked.loop.timing)}: max_i "
        f"|e_i|/v_i stays below a multiple of exp(-{text_below(rate)} t){when}.",
    )
    return check.unless(confirm(check, asked.case), asked.domain)


def diverging_check(loop: Loop, near: Sequence[complex], *, domain: Domain) -> Check | None:
    """REFUTED where linear couplings diverge with what the problem states; None where that is not
    shown.  ``near``: eigenvalues of M, about."""
    M = rest_matrix(loop)
    timing = loop.timing
    if M is None or timing is None:
        return None
    refuted = partial(Check, id=READINGS, verdict=Verdict.REFUTED, domain=domain)
    if timing.period:
        if not overshoots(loop, M):
            return None
        acting = f", acting {float(timing.ahead):.6g} s late," if timing.ahead else ""
        step = "a step" if acting else "I - T M"
        reason = (
            f"held over {float(timing.period):.6g} s{acting} the loop does not converge: an "
            f"eigenvalue of {step} is not inside the unit disk."
        )
        return refuted(reason=reason, witness=Witness(kind=EIGENVALUE, values=()))
    for root in near:
        x, y = Fraction(root.real), Fraction(root.imag)
        if turns_too_far(loop, M, (x, y)):
            late = float(min(timing.delay, timing.own_delay))
            reason = (
                f"with one constant delay of {late:.6g} s in everything the loop diverges: M has "
                f"an eigenvalue mu near {root:.6g}, and |mu| tau > pi/2 - |arg mu|."
            )
            values = (number_text(x), number_text(y))
            return refuted(reason=reason, witness=Witness(kind=EIGENVALUE, values=values))
    return None


def sampling_check(
    case: Case, claim: Separable, beside: Check, *, own: Separable | None = None
) -> Check:
    """Decide how long couplings and pinning may be held, for the ``claim`` of ``beside``, or its
    ``own`` for other v."""
    loop = case.loop
    if own is not None and _not_proved(own, beside, case) is not None:
        own = None
    claim = own or claim
    longest = largest_period(loop, claim)
    if longest is None or longest.period < SHORTEST:
        reason = "the slopes of the coupling are too steep in the box for a sampling period."
        return undecided_check("sampling", case.domain, reason)
    # what is proved holds for shorter ones
    period = rounded_down(longest.period * (1 - IN_HAND), digits=4)
    bound = SamplingBound(period=period, factor=1 - period * claim.alpha, own=own)
    fall = shorten(100 * (1 - bound.factor), digits=4)
    held = left = ""
    if loop.groups:
        held = "; dhat acts continuously"
        left = ", up to what the estimation error adds"
    reason = (
        f"stable with couplings and pinning held for up to {float(period):.4g} s (zero-order "
        f"hold{held}); at that period the largest weighted error falls by at least {fall:.4g} % "
        f"a sample{left}."
    )
    return Check(
        id="sampling", verdict=Verdict.PROVED, domain=beside.domain, claim=bound, reason=reason
    )


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved or refuted check claims is confirmed, else what is not.
    Rows, observer and box are decided again from the loop; delays and sampling rest on the
    max-separable proof of the case.  Raises what a malformed claim raises."""
    loop = case.loop
    is_main = check.id == MAX_SEPARABLE
    turned = is_main and "T" in (check.exact or ())
    reason = obstacle(loop, case.W, turned=turned)
    if reason is not None:
        return reason
    if check.id == READINGS:
        return _not_read(check, case)
    if not is_main:
        return _not_timed(check, case)
    if check.verdict is Verdict.REFUTED:
        return _not_stuck(check, loop)
    claim = separable_from_json(check.exact, loop, turned=turned)
    if check.witness is not None:
        return "a proof has no witness"
    return _not_proved(claim, check, case) or _too_fast(check, composite_rate(claim))


def _too_fast(check: Check, proved: Fraction) -> str | None:
    return None if follows(check.rate, proved) else f"the rate {check.rate} does not follow"


def _not_stuck(check: Check, loop: Loop) -> str | None:
    """None if no common v can hold the agents that a refutation names."""
    if check.rate is not None or check.exact is not None:
        return "a refuted check must claim no rate and no exact values"
    witness = check.witness or Witness(kind="")
    if witness.kind != "agents" or witness.values is not None or not witness.labels:
        return "it needs agents as its witness"
    places = loop.index
    agents = {places[label] for label in witness.labels if label in places}
    if len(agents) != len(witness.labels):
        return "the witness must name different agents of the problem"
    if not is_stuck(loop, agents):
        return "one of the agents is pinned or hears another agent in every mode"
    return None


def _not_proved(claim: Separable, check: Check, case: Case) -> str | None:
    """None if the claim is proved and holds all starts of the domain of the check, else what is
    wrong."""
    holds = None if claim.rho is None else partial(covers, claim)
    return not_all_starts(check, case, holds) or verify_composite(case.loop, case.W, claim).wrong


def _not_read(check: Check, case: Case) -> str | None:
    """None if a proof or refutation with the stated readings is confirmed, else what is wrong."""
    loop = case.loop
    if loop.timing is None:
        return "the problem states no readings and no processor"
    if check.verdict is Verdict.REFUTED:
        return late_witness_obstacle(loop, check)
    wrong = not_a_proof(check)
    if wrong is not None:
        return wrong
    claim = separable_from_json(check.exact, loop)
    holds = None if claim.rho is None else partial(covers_late, loop, claim)
    wrong = not_all_starts(check, case, holds) or verify_readings(loop, case.W, claim).wrong
    return wrong or _too_fast(check, claim.alpha)


def _not_timed(check: Check, case: Case) -> str | None:
    """Delays and sampling, beside the proof that they rest on."""
    loop = case.loop
    wrong = not_a_proof(check)
    if wrong is not None:
        return wrong
    proof = case.proof(Separable)
    claim = case.proved(Separable)
    # rows in coordinates say nothing about delays and sampling
    if proof is None or claim is None or claim.T is not None or proof.domain != check.domain:
        return "it needs a proved max-separable check with its domain"
    if check.domain != EVERYWHERE:
        read_domain(check.domain, loop, kind=Box)  # true equals 1 and is no number
    bound = read_claim(check, loop, case.W)
    if isinstance(bound, DelayBound):
        return verify_delay(loop, claim, bound).wrong or _too_fast(check, bound.rate)
    if not isinstance(bound, SamplingBound):
        return "it is not known here"
    if check.rate is not None:
        return "it claims a number that this check does not have"
    wrong = None if bound.own is None else _not_proved(bound.own, check, case)
    if wrong is not None:
        return f"its own certificate: {wrong}"
    return verify_sampling(loop, bound.own or claim, bound).wrong
