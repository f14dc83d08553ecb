"""Whether what `safety` and `markov` claim (``claim``) holds; it searches for nothing.  All is
decided over the rationals."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, Values, Witness, differs
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.domain import Domain
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.conditions.reason import Need, first_missing, fixed_obstacle, signs_obstacle
from dobc_design.conditions.schedule.checks import not_as_claimed
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.schedule.cycles import holds_observer, left_out, rises
from dobc_design.conditions.separable.claim import acts_by_component, holding_gains
from dobc_design.exact import matrix as exact
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ZERO
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import unreached
from dobc_design.loop.loop import Loop
from dobc_design.verdict import Verdict

from .claim import SURE, Kept, read_claim

MOST_MODES = 300  # of a chain, of which both programs say where it ends


def closed_classes(generator: Matrix) -> list[tuple[int, ...]]:
    """The smallest sets of modes (places) that the chain does not leave; it ends in one of them."""
    # Which modes each mode leads to, in one step or none at first.
    leads = np.zeros((len(generator), len(generator)), dtype=bool)
    for p, row in enumerate(generator):
        leads[p] = [p == q or rate > 0 for q, rate in enumerate(row)]
    for _ in range(len(generator).bit_length()):
        # paths of twice the length; the numbers of paths are exact
        steps = leads.astype(np.float64)
        leads = steps @ steps > 0
    # A set is closed where every mode that one of its modes leads to leads back to it.
    closed = [row for p, row in enumerate(leads) if np.all(leads[row, p])]
    return sorted({tuple(np.flatnonzero(row).tolist()) for row in closed})


def absorbing(loop: Loop) -> list[tuple[str, ...]]:
    """The modes of each such set, where proofs may assume a Markov chain; none where there are more
    than MOST_MODES."""
    generator = loop.guarantee.generator
    names = list(loop.modes)
    if generator is None or len(names) > MOST_MODES:
        return []
    return [tuple(names[p] for p in each) for each in closed_classes(generator)]


def why_not(loop: Loop, W: Matrix | None, claim: Kept) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return first_missing(_needs(loop, W, claim))


def _needs(loop: Loop, W: Matrix | None, claim: Kept) -> Iterator[Need]:
    """What has to hold, in turn: what is cheap first, and what later needs rely on."""
    # Where agents agree, roots of the graphs that recur decide; means and one target do not apply.
    by_roots = loop.is_apart and claim.kind == SURE and claim.box is not None
    reason = None if by_roots else fixed_obstacle(loop)
    yield reason is None, str(reason)
    if claim.kind:
        yield not loop.signed, str(signs_obstacle(loop))
        is_drawn = loop.guarantee.generator is not None
        yield is_drawn, 'there is no guarantee = "markov", or only one mode.'
    fits = acts_by_component(loop) or claim.P is not None
    yield fits, "couplings have to act on each component by itself."
    if claim.box is not None:
        yield from _box_is_kept(loop, W, claim, claim.box)
        return
    # Means and mean squares are of linear equations: those of curved ones depend on all moments.
    yield loop.is_linear, "couplings have to be linear."
    rate = claim.rate or ZERO
    exosystem = loop.joint_exosystem
    if exosystem is not None:
        decays = W is not None and hurwitz_with_rate(error_matrix(exosystem, W), rate)
        yield decays, "the estimation error does not decay at this rate."
    generator = loop.guarantee.generator or ()
    if claim.w is not None:
        yield from _mean(loop, claim, generator, rate)
    else:
        yield from _square(loop, claim, generator, rate)


def _box_is_kept(loop: Loop, W: Matrix | None, claim: Kept, box: Cycles) -> Iterator[Need]:
    """V with v = 1 never grows; of a Markov chain also that pins reach everybody in the end."""
    yield not box.phases and box.rate is None, "it has no weights."
    yield from holds_observer(loop, W, box, claim.rate)
    yield from rises(loop, box.rho, strictly=claim.kind == SURE)
    # A graph that moves may leave an agent alone, so that only its pin is sure.
    least = min(holding_gains(loop))
    is_pinned = claim.rate is None or claim.rate <= least
    yield is_pinned, "not every agent is pinned as much as its rate."
    if not claim.kind:
        return
    # In the end the chain stays among few modes, and visits each of them again and again.
    names = list(loop.modes)
    for each in closed_classes(loop.guarantee.generator or ()):
        modes = [names[p] for p in each]
        missed = left_out(loop, modes)
        if missed:
            on = f"while modes {' and '.join(modes)} are on in turn"
            yield False, f"{on}, no pin reaches {name_agents(missed)}."


def _mean(loop: Loop, claim: Kept, generator: Matrix, rate: Fraction) -> Iterator[Need]:
    """A_p'w_p + sum_q g_pq w_q <= -rate w_p, with slopes taken at their worse ends."""
    weights = {mode: tuple(v) for mode, v in (claim.w or {}).items()}
    yield list(weights) == list(loop.modes), "there must be weights for every mode."
    fits = all(len(v) == loop.n and min(v) > 0 for v in weights.values())
    yield fits, "weights must be > 0, one per agent."
    slopes = [each.jacobian_at_zero()[0][0] for each in loop.functions]
    yield min(slope.lo for slope in slopes) >= 0, "a coupling falls."
    # Column by column: what agent i hears of j with |h'| <= hi adds to the row of j, since A_p is
    # transposed, and takes from the row of i at least what lo says.
    gains = holding_gains(loop)
    for (mode, w), rates in zip(weights.items(), generator, strict=True):
        arcs = loop.modes[mode]
        spend(len(arcs) + loop.n * len(rates))
        rows = [(rate - k) * x for k, x in zip(gains, w, strict=True)]
        for g, other in zip(rates, weights.values(), strict=True):
            if g:
                rows = [row + g * x for row, x in zip(rows, other, strict=True)]
        for (i, j, weight), loose in zip(arcs, arcs.uncertain.tolist(), strict=True):
            slope = slopes[loop.place_of(i, j)]
            if j < loop.n:
                rows[j] += weight * slope.hi * w[i]
            if not loose:  # an arc that may be absent takes nothing away for certain
                rows[i] -= weight * slope.lo * w[i]
        yield max(rows) <= 0, f"a row does not hold in mode {mode}."


def _square(loop: Loop, claim: Kept, generator: Matrix, rate: Fraction) -> Iterator[Need]:
    """P_p > 0 and A_p'P_p + P_p A_p + sum_q g_pq P_q + 2 rate P_p < 0."""
    forms = claim.P or {}
    size = loop.size
    statements = state_theorems(loop)
    yield list(forms) == list(loop.modes), "there must be a P for every mode."
    fits = all(exact.shape(P) == (size, size) and exact.is_symmetric(P) for P in forms.values())
    yield fits, f"every P must be a symmetric {size}x{size} matrix."
    for (mode, P), rates in zip(forms.items(), generator, strict=True):
        A = linear_part(statements, mode)
        yield A is not None, "the slopes are not rational, or the network is too large."
        # The derivative of E[e'P e] in this mode, and where the chain goes from it.
        half = exact.multiply(P, A or ())
        total = exact.add(exact.add(half, exact.transpose(half)), exact.scale(2 * rate, P))
        for g, other in zip(rates, forms.values(), strict=True):
            total = exact.add(total, exact.scale(g, other))
        holds = decide_positive_definite(P).is_proved
        if holds:
            holds = decide_positive_definite(exact.scale(-1, total)).is_proved
        yield holds, f"P > 0 or its inequality fails in mode {mode}."


def apart_check(loop: Loop, domain: Domain) -> Check | None:
    """REFUTED, with the agents that hear no pin in modes that the chain never leaves; None if there
    are none."""
    for modes in () if loop.signed or loop.is_apart else absorbing(loop):
        arcs = [loop.modes[mode] for mode in modes]
        labels = tuple(loop.labels[i] for i in unreached(loop, arcs))
        if not labels:
            continue
        sure = " by arcs that are always there" if any(each.optional for each in arcs) else ""
        reason = (
            f"the Markov signal never leaves {', '.join(modes)}, and there no pinned agent "
            f"reaches {name_agents(labels)}{sure}: starts in which all of these have the same "
            "error stay as they are."
        )
        return Check(
            id="markov",
            verdict=Verdict.REFUTED,
            domain=domain,
            reason=reason,
            claim=Values({"modes": list(modes)}),
            witness=Witness(kind="agents", labels=labels),
        )
    return None


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved or refuted check of this topic claims is confirmed, else
    what is not."""
    loop, W = case.loop, case.W
    if check.verdict is Verdict.REFUTED:
        own = apart_check(loop, case.domain)
        if own is None or check.id != own.id or check.rate is not None:
            return "the chain leaves no agents apart"
        return differs(check, own)
    claim = read_claim(check, loop, W)
    if not isinstance(claim, Kept) or check.witness is not None:
        return "a proof has no witness"
    wrong = not_as_claimed(check, case, claim.rate, claim.box)
    return wrong or why_not(loop, W, claim)
