"""Whether the claims of `safety` and `markov` hold, exactly; and their checks."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import partial

from dobc_design.conditions.check import Check, Values, Witness, differs
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.graphs.claim import SURE, Kept, read_claim
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.conditions.schedule.checks import not_as_claimed
from dobc_design.conditions.schedule.cycles import first_unreached, holds_observer, rises
from dobc_design.conditions.separable.claim import acts_by_component, holding_gains
from dobc_design.exact import matrix as exact
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.work import spend
from dobc_design.problem.arrays import unreached
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

ZERO = Fraction(0)


def generator_of(problem: Problem) -> Matrix | None:
    """The generator of the Markov chain that proofs may assume; None without one, and where one mode is always on."""
    own = problem.switching
    several = own is not None and own.guarantee == "markov" and len(problem.network.modes) > 1
    return own.generator if own is not None and several else None


def closed_classes(generator: Matrix) -> list[tuple[int, ...]]:
    """The smallest sets of modes (places) that the chain does not leave; it ends in one of them."""
    reached = [{p} for p in range(len(generator))]
    for _ in generator:
        steps = [{q for p in each for q, rate in enumerate(generator[p]) if rate > 0} for each in reached]
        reached = [each | new for each, new in zip(reached, steps, strict=True)]
    return sorted({tuple(sorted(each)) for each in reached if all(reached[q] == each for q in each)})


def why_not(problem: Problem, W: Matrix | None, claim: Kept) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return next((words for holds, words in _needs(problem, W, claim) if not holds), None)


def _needs(problem: Problem, W: Matrix | None, claim: Kept) -> Iterator[tuple[bool, str]]:
    generator, exosystem = generator_of(problem), problem.joint_exosystem
    if claim.kind:
        yield generator is not None, 'there is no guarantee = "markov", or only one mode.'
    yield acts_by_component(problem) or claim.P is not None, "couplings have to act on each component by itself."
    if claim.box is not None:
        yield not claim.box.phases and claim.box.rate is None, "it has no weights."
        yield from holds_observer(problem, W, claim.box, claim.rate)
        yield from rises(problem, claim.box.rho, strictly=claim.kind == SURE)
        least = min(holding_gains(problem))
        yield claim.rate is None or claim.rate <= least, "not every agent is pinned as much as its rate."
        names = list(problem.network.modes)
        for each in closed_classes(generator or ()) if claim.kind else ():
            modes = [names[p] for p in each]
            missed = first_unreached(problem, modes)
            yield missed is None, f"while modes {' and '.join(modes)} are on in turn, no pin reaches agent {missed}."
        return
    yield problem.is_linear, "couplings have to be linear."
    rate = claim.rate or ZERO
    if exosystem is not None:
        decays = W is not None and hurwitz_with_rate(error_matrix(exosystem, W), rate)
        yield decays, "the estimation error does not decay at this rate."
    if claim.w is not None:
        yield from _mean(problem, claim, generator or (), rate)
    else:
        yield from _square(problem, claim, generator or (), rate)


def _mean(problem: Problem, claim: Kept, generator: Matrix, rate: Fraction) -> Iterator[tuple[bool, str]]:
    """A_p'w_p + sum_q g_pq w_q <= -rate w_p, with slopes taken at their worse ends."""
    weights = {mode: tuple(v) for mode, v in (claim.w or {}).items()}
    yield list(weights) == list(problem.network.modes), "there must be weights for every mode."
    fits = (len(v) == problem.n and min(v) > 0 for v in weights.values())
    yield all(fits), "weights must be > 0, one per agent."
    slopes = [each.jacobian_at_zero()[0][0] for each in problem.couplings]
    yield min(slope.lo for slope in slopes) >= 0, "a coupling falls."
    gains = holding_gains(problem)
    for (mode, w), rates in zip(weights.items(), generator, strict=True):
        spend(len(problem.network.modes[mode]) + problem.n * len(rates))
        rows = [(rate - k) * x for k, x in zip(gains, w, strict=True)]
        for q, other in enumerate(weights.values()):
            if rates[q]:
                rows = [row + rates[q] * x for row, x in zip(rows, other, strict=True)]
        for i, j, weight in problem.network.modes[mode]:
            slope = slopes[problem.coupling_place(i, j)]
            rows[j] += weight * slope.hi * w[i]
            rows[i] -= weight * slope.lo * w[i]
        yield max(rows) <= 0, f"a row does not hold in mode {mode}."


def _square(problem: Problem, claim: Kept, generator: Matrix, rate: Fraction) -> Iterator[tuple[bool, str]]:
    """P_p > 0 and A_p'P_p + P_p A_p + sum_q g_pq P_q + 2 rate P_p < 0."""
    forms, size, statements = claim.P or {}, problem.n * problem.m, state_theorems(problem)
    yield list(forms) == list(problem.network.modes), "there must be a P for every mode."
    symmetric = (exact.shape(P) == (size, size) and exact.is_symmetric(P) for P in forms.values())
    yield all(symmetric), f"every P must be a symmetric {size}x{size} matrix."
    for (mode, P), rates in zip(forms.items(), generator, strict=True):
        A = linear_part(statements, mode)
        yield A is not None, "the slopes are not rational, or the network is too large."
        half = exact.multiply(P, A or ())
        total = exact.add(exact.add(half, exact.transpose(half)), exact.scale(2 * rate, P))
        for g, other in zip(rates, forms.values(), strict=True):
            total = exact.add(total, exact.scale(g, other))
        falls = (decide_positive_definite(M).verdict is Verdict.PROVED for M in (P, exact.scale(-1, total)))
        yield all(falls), f"P > 0 or its inequality fails in mode {mode}."


def apart_check(problem: Problem, domain: str) -> Check | None:
    """REFUTED, with the agents that hear no pin in modes that the chain never leaves; None if there are none."""
    names = list(problem.network.modes)
    for each in closed_classes(generator_of(problem) or ()):
        modes = [names[p] for p in each]
        labels = tuple(problem.network.labels[i] for i in unreached(problem, [problem.network.modes[x] for x in modes]))
        if labels:
            reason = f"the Markov signal never leaves {', '.join(modes)}, and there no pinned agent reaches"
            reason += f" {name_agents(labels)}: starts in which all of these have the same error stay as they are."
            lost = partial(Check, claim=Values({"modes": modes}), witness=Witness(kind="agents", labels=labels))
            return lost(id="markov", verdict=Verdict.REFUTED, domain=domain, reason=reason)
    return None


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a proved or refuted check claims is confirmed, else what is not; ``domain``: that of Lemma 1.
    Raises what a malformed claim raises."""
    if check.verdict is Verdict.REFUTED:
        own = apart_check(problem, domain) if check.id == "markov" and check.rate is None else None
        return "the chain leaves no agents apart" if own is None else differs(check, own)
    claim = read_claim(check, problem, W)
    if not isinstance(claim, Kept) or check.witness is not None:
        return "a proof has no witness"
    return not_as_claimed(check, problem, claim.rate, claim.box, domain) or why_not(problem, W, claim)
