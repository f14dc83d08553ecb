"""The checks tolerance and actuators: when they are tried, how large an error is found, and what they report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import sparse

from dobc_design.conditions.check import Check, limited, undecided_check
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.margins import decide
from dobc_design.conditions.margins.decide import Inputs, Tolerance
from dobc_design.conditions.numbers import claimed, decimal_below, rounded_down, rounded_up
from dobc_design.conditions.separable.claim import Errors, Separable, holding_gains
from dobc_design.conditions.separable.decide import largest_rate, verify_separable
from dobc_design.conditions.separable.stage import IN_HAND, TIMED_ARCS
from dobc_design.conditions.weighted.propose import rounded
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.number import root_above
from dobc_design.problem.arrays import coupling_places
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array, factored
from dobc_design.verdict import Verdict

ROUNDS, CLOSE = 100, 1e-9


@np.errstate(all="ignore")
def common_vector(problem: Problem, errors: Errors) -> Array | None:
    """v > 0 (n,) with M v >= 1, M = L(w h'(0)) + K, in every mode and for all errors; None if none is seen.  Policy
    iteration: given v every agent takes the mode and the ends of its weights that pull it out most.
    Raises: OverflowError beyond the floats."""
    n, spread, v = problem.n, float(errors.weights), np.ones(problem.n)
    slopes = np.array([float(coupling.jacobian_at_zero()[0][0].midpoint) for coupling in problem.couplings])
    gains, modes = np.array([float(k) for k in holding_gains(problem, error=errors.gains)]), []
    for arcs in problem.network.modes.values():
        weights = np.array([float(w) for w in arcs.weights]) * slopes[coupling_places(problem, arcs)]
        modes.append(sparse.csr_array((weights, (arcs.listeners, arcs.speakers)), shape=(n, n)))
    for _ in range(ROUNDS):
        tables = []
        for mode in modes:
            steps = v[mode.indices] - np.repeat(v, np.diff(mode.indptr))
            ends = mode.data * np.where(steps > 0, 1 + spread, 1 - spread)
            table = sparse.csr_array((ends, mode.indices, mode.indptr), shape=(n, n))
            tables.append(sparse.csr_array(sparse.diags_array(gains + table.sum(axis=1)) - table))
        worst = np.argmin([table @ v for table in tables], axis=0)
        M = sum(sparse.diags_array((worst == k).astype(float)) @ table for k, table in enumerate(tables))
        try:
            found = factored(M).solve(np.ones(n))
        except RuntimeError:  # singular
            return None
        if not np.all(np.isfinite(found)) or not np.all(found > 0):
            return None
        if np.all(np.abs(found - v) <= CLOSE * found):
            return np.asarray(found)
        v = found
    return None


LARGEST, HALVINGS, STEPS = Fraction(999, 1000), 30, 12  # of the errors that are tried
KEPT = Fraction(1, 100)  # of the rate, which the largest error leaves; half of that is claimed
WIDER = Fraction(21, 20)  # eta, for a second program with wider enclosures
FAR = 1000  # times that v grows until the rows at the target count as lost
MORE = 1 + Fraction(1, 10**9)  # inputs, for roots that another program rounds otherwise
UNCOUNTED = (
    " Errors of weights and gains are counted where `tolerance` is proved; what [uncertainty] adds to disturbance,"
    " drift and measurement is not."
)
NO_PROOF = "there is no proved max-separable certificate that it could rest on."
_ZERO = Fraction(0)


def is_asked(asked: Asked) -> bool:
    """Whether the problem asks something that rests on a max-separable certificate."""
    unknown = _given(asked) is not None and not decide.agents_know(asked.problem)
    return asked.problem.actuators is not None or unknown


def margins_stage(asked: Asked, checks: Sequence[Check], report: Progress) -> list[Check]:
    """What the problem asks beside ``checks``, and the tolerance where there is one."""
    if asked.problem.origin is not None:
        return []
    known = (check for check in checks if isinstance(check.claim, Separable) and check.claim.T is None)
    proof, found = next((check for check in known if check.verdict is Verdict.PROVED), None), list[Check]()
    report("deciding the tolerance")
    check = limited("tolerance", asked.domain, lambda: _tolerance(asked, proof))
    found += [check] if check.verdict is Verdict.PROVED or _given(asked) is not None else []
    if asked.problem.actuators is not None:
        report("deciding the inputs")
        found.append(_actuators(asked, proof))
    return found


def _given(asked: Asked) -> Errors | None:
    """The errors of [uncertainty]; None without any."""
    table = asked.problem.uncertainty
    return Errors(table.weights, table.gains) if table is not None and (table.weights or table.gains) else None


def _tolerance(asked: Asked, proof: Check | None) -> Check:
    problem, given, why = asked.problem, _given(asked), decide.why_not_local(asked.problem)
    if sum(map(len, problem.network.modes.values())) > TIMED_ARCS:
        reason = f"left out: the network is large; tolerances are examined up to {TIMED_ARCS} arcs."
        return undecided_check("tolerance", asked.domain, reason)
    if (not asked.wanted or proof is None) and why is None and (not problem.groups or asked.W is not None):
        proof = None  # without a region the question is about the target, not about the box that was found
        if asked.wanted and asked.domain != "global":
            return undecided_check("tolerance", asked.domain, NO_PROOF)
    elif proof is None:
        return undecided_check("tolerance", asked.domain, why or NO_PROOF, applies=why is None)
    base = proof.claim if proof is not None and isinstance(proof.claim, Separable) else None
    try:
        find = _at_target(asked) if base is None else _in_region(asked, base)
    except UndefinedError as error:
        return undecided_check("tolerance", asked.domain, f"the slopes of the coupling are not bounded: {error}")
    claim, part = (find(given), _ZERO) if given is not None else (None, _ZERO)
    if claim is None:
        direction = given or Errors(Fraction(1), Fraction(1))
        part, claim = _largest(lambda part: find(Errors(*(part * x for x in direction))))
    if claim is None or (given is not None and part):
        less = f"; for {float(part):.3g} times these errors it is proved" if claim is not None else ""
        return undecided_check("tolerance", asked.domain, f"the errors are too large for the certificate{less}.")
    w, k = (f"{float(rounded_down(100 * x, digits=4)):.4g} %" for x in claim.errors)
    reason = f"the proof holds for all arc weights that are off by up to {w} and all gains by up to {k}, each on its"
    reason += " own, constant or varying" + (", while A - WC is Hurwitz." if base is None and problem.groups else ".")
    reason += " These are about the largest common errors that it allows." if part else ""
    rate = claim.alpha if base is None else decide.tolerated_rate(base, claim)
    check = Check(
        id="tolerance",
        verdict=Verdict.PROVED,
        domain=asked.domain if proof is None else proof.domain,
        rate=None if base is None and problem.groups else decimal_below(rate),
        claim=claim,
        reason=reason,
    )
    return _confirmed(asked, check, proof)


def _confirmed(asked: Asked, check: Check, proof: Check | None) -> Check:
    wrong = decide.confirm(check, asked.problem, asked.W, domain=asked.domain, proof=proof)
    return check if wrong is None else undecided_check(check.id, asked.domain, wrong)


def _largest(find: Callable[[Fraction], Tolerance | None]) -> tuple[Fraction, Tolerance | None]:
    """About the largest part <= LARGEST (three digits) for which something is found, and that."""
    low = high = LARGEST
    for _ in range(HALVINGS):
        if (best := find(low)) is not None:
            break
        low, high = rounded_down(low / 2, digits=3), low
    for _ in range(STEPS if best is not None else 0):
        middle = rounded_down((low + high) / 2, digits=3)
        better = find(middle) if low < middle < high else None
        low, high, best = (low, middle, best) if better is None else (middle, high, better)
    return low, best


def _in_region(asked: Asked, base: Separable) -> Callable[[Errors], Tolerance | None]:
    """The rows of ``base``: for the errors that are given at nearly the largest rate, else at a small part of its."""
    problem, kappa = asked.problem, _ZERO if base.error is None else base.error.kappa
    known = decide.agents_know(problem)
    pull = _ZERO if known else decide.observer_pull(problem, asked.W, base)

    def find(errors: Errors) -> Tolerance | None:
        eta = None if known else rounded_up(errors.weights * pull * WIDER, digits=6)
        alpha = kappa * (eta or _ZERO) + base.alpha * KEPT
        if verify_separable(problem, replace(base, alpha=alpha), errors=errors).verdict is not Verdict.PROVED:
            return None
        alpha -= base.alpha * KEPT / 2
        best = (
            largest_rate(problem, base.v, rho=base.rho, errors=errors) if errors == _given(asked) else None
        ) or _ZERO
        return Tolerance(errors=errors, alpha=max(alpha, best * (1 - IN_HAND)), eta=eta)

    return find


def _at_target(asked: Asked) -> Callable[[Errors], Tolerance | None]:
    """Rows at the target, with the v that the errors ask for."""
    usual = None
    with suppress(OverflowError):
        usual = common_vector(asked.problem, Errors())

    def find(errors: Errors) -> Tolerance | None:
        v = None if usual is None else common_vector(asked.problem, errors)
        if v is None or usual is None or np.max(v) > FAR * np.max(usual):
            return None
        alpha = rounded_down(Fraction(1 / (2 * float(np.max(v)))), digits=4)
        return Tolerance(errors=errors, alpha=alpha, v=rounded(v))

    return find


def _actuators(asked: Asked, proof: Check | None) -> Check:
    problem, base = asked.problem, None if proof is None else proof.claim
    if proof is None or not isinstance(base, Separable) or problem.actuators is None:
        return undecided_check("actuators", asked.domain, NO_PROOF)
    asks: Mapping[str, Any] = {"kind": "box", "radius": asked.radius, "disturbance": asked.disturbance}
    domain = proof.domain if isinstance(proof.domain, Mapping) else asks
    radius, noise = (claimed(domain[name]) for name in ("radius", "disturbance"))
    noise *= _ZERO if base.error is None else base.error.kappa * root_above(base.error.size, unit=10**12)
    level = rounded_up(radius / base.least + noise, digits=9) if base.rho is None else base.rho
    found = decide.largest_disturbance(problem)
    if found is None or (base.rho is None and not asked.wanted):
        cure = "simulation.xi0 gives no sum of constants and sines: give actuators.amplitude."
        reason = cure if found is None else "inputs have no bound from every start: give a [region]."
        return undecided_check("actuators", asked.domain, f"does not apply: {reason}", applies=False)
    slopes, labels = decide.input_slopes(problem, base), problem.network.labels
    pairs = dict(zip(labels, zip(slopes, found, strict=True), strict=True))
    most = {label: rounded_up((slope * level + d) * MORE, digits=6) for label, (slope, d) in pairs.items()}
    worst, over = max(most, key=lambda label: most[label]), list[tuple[Fraction, str, Fraction]]()
    for label, (slope, d) in pairs.items():
        limit = problem.actuators.limit_of(label)
        if limit is not None and most[label] > limit:
            over.append(((limit - d) / slope if slope else _ZERO, label, limit - d))
    if over:
        lower, label, room = min(over)
        box = (lower - noise) * base.least
        allowed = float(problem.actuators.limit_of(label) or 0)
        reason = f"the input of agent {label} may reach {float(most[label]):.6g}, more than its limit of {allowed:.6g}."
        if room <= 0:
            alone = float(pairs[label][1])
            reason += f" The disturbance alone may need {alone:.6g}, so that no region and no gain would do."
        else:
            starts = f"from starts with |e_i| <= {_told(box)} and the same |eps_i|"
            late = f"once V of the check max-separable is at most {_told(lower)}"
            reason += f" It never saturates {starts if box > 0 else late}. For the whole region it would need a gain of"
            reason += f" at most {_told(room / (level * base.v[problem.network.index[label]]))} and a new proof."
        return undecided_check("actuators", asked.domain, reason)
    reason = f"from these starts no component of an input exceeds {float(most[worst]):.6g} (agent {worst})"
    reason += "; no actuator with a limit saturates." if problem.actuators.limit is not None else "."
    reason += UNCOUNTED if problem.uncertainty is not None else ""
    claim = Inputs(rho=level, inputs=most)
    return _confirmed(
        asked, Check(id="actuators", verdict=Verdict.PROVED, domain=domain, claim=claim, reason=reason), proof
    )


def _told(x: Fraction) -> str:
    return f"{float(rounded_down(x, digits=4)):.4g}"
