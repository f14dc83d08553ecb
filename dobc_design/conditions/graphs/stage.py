"""When `safety` and `markov` are tried, and what they report."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any, Final

import numpy as np
from scipy import linalg, sparse

from dobc_design.conditions.check import Check, limited, undecided_check
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.consensus.propose import decay_rate
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.domain import EVERYWHERE, Box
from dobc_design.conditions.graphs.decide import (
    HOW,
    MEAN,
    SQUARE,
    SURE,
    Kept,
    apart_check,
    confirm,
    generator_of,
    why_not,
)
from dobc_design.conditions.numbers import (
    MANY_AGENTS,
    claimed,
    decimal_below,
    last_found,
    rounded_down,
    rounded_up,
    text_above,
    text_below,
)
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.separable.checks import obstacle
from dobc_design.conditions.separable.claim import ErrorBound, acts_by_component, holding_gains
from dobc_design.conditions.separable.propose_observer import propose_error_bound, with_kappa
from dobc_design.exact.matrix import Matrix, Vector, to_float
from dobc_design.exact.number import root_above
from dobc_design.exact.symmetric import Doubles
from dobc_design.loop.arcs import arc_table
from dobc_design.loop.loop import Loop
from dobc_design.solvers.program import factored, round_matrix
from dobc_design.verdict import Verdict

BISECTIONS: Final = 14
SMALLEST: Final = 1e-9  # rate that counts (1/s)
SAFE: Final = 1 - 1e-6  # of a rate that floats show
STEADY: Final = 0.999  # of the best rate
MOST_ROWS: Final = 12  # n m, for the mean square
MOST_UNKNOWNS: Final = 1000
WEIGHT_DIGITS: Final = 15


def mean_claim(loop: Loop, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Weights of every mode and the rate that they give, about; None where the means do not
    decay."""
    modes, n = loop.modes, loop.n
    slopes = np.array([float(each.jacobian_at_zero()[0][0].midpoint) for each in loop.functions])
    blocks = []
    for mode in modes:
        table = arc_table(loop, mode)
        entries = to_float((table.weights,))[0][table.weight] * slopes[table.coupling]
        A = sparse.csr_array((entries, (table.listeners, table.speakers)), shape=(n, n))
        sure = np.where(modes[mode].uncertain, 0.0, entries)  # what an agent gives away for certain
        away = np.bincount(table.listeners, weights=sure, minlength=n)
        blocks.append((A - sparse.diags_array(away + to_float((holding_gains(loop),))[0])).T)
    chain = sparse.kron(sparse.csr_array(to_float(generator)), sparse.eye_array(n))
    M = sparse.csr_array(-(sparse.block_diag(blocks) + chain))
    w = _weights(M, 0.0)
    if w is None:
        return None
    # The best rate lies between.
    low, high = float(np.min(M @ w / w)), float(np.min(M.diagonal()))
    _, w = last_found(
        lambda rate, _: _weights(M, rate),
        w,
        low,
        high,
        steps=BISECTIONS,
        middle=lambda low, high: math.sqrt(max(low, SMALLEST) * high),
    )
    rate = _observed(loop, W, float(np.min(M @ w / w)) * SAFE)
    if rate <= SMALLEST:
        return None
    each: list[Vector | Doubles] = []
    for part in w.reshape(len(modes), n):
        texts = (
            tuple(Fraction(f"{x:.{WEIGHT_DIGITS}g}") for x in part.tolist())
            if n <= MANY_AGENTS
            else ()
        )
        each.append(texts or Doubles(part))
    return Kept(kind=MEAN, rate=rounded_down(rate), w=dict(zip(modes, each, strict=True)))


def _weights(M: Any, rate: float) -> Any:
    """(M - rate I)^-1 1, up to a factor; None where that is not positive: M does not have the
    rate."""
    try:
        w = factored(M - rate * sparse.eye_array(M.shape[0])).solve(np.ones(M.shape[0]))
    except RuntimeError:  # singular
        return None
    w = w / np.max(np.abs(w))
    return w if np.all(w > 0) else None


def square_claim(loop: Loop, W: Matrix | None, generator: Matrix) -> Kept | None:
    """Matrices of every mode for nearly the best rate; None for larger networks, and where none are
    found."""
    size, modes, statements = loop.n * loop.m, loop.modes, state_theorems(loop)
    if size > MOST_ROWS or len(modes) * size**2 > MOST_UNKNOWNS:
        return None
    parts = [linear_part(statements, mode) for mode in modes]
    known = [to_float(part) for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    unit = np.eye(size)
    blocks = [np.kron(A.T, unit) + np.kron(unit, A.T) for A in known]
    T: Any = linalg.block_diag(*blocks) + np.kron(to_float(generator), np.eye(size**2))
    rate = _observed(loop, W, -float(np.max(np.linalg.eigvals(T).real)) / 2 * STEADY)
    if rate <= SMALLEST:
        return None
    P = np.linalg.solve(T + 2 * rate * np.eye(len(T)), -np.tile(unit.ravel(), len(known))).reshape(
        -1, size, size
    )
    forms = [round_matrix((each + each.T) / 2, 12) for each in P]
    return Kept(kind=SQUARE, rate=rounded_down(rate), P=dict(zip(modes, forms, strict=True)))


def _observed(loop: Loop, W: Matrix | None, rate: float) -> float:
    """The rate, below that of the estimation error."""
    exosystem = loop.joint_exosystem
    return rate if exosystem is None or W is None else min(rate, decay_rate(exosystem, W) * SAFE)


logger = logging.getLogger("dobc_design")

SMALLER: Final = 12  # halvings of a box that is too large
DIGITS: Final = 9
EXTRA: Final = Fraction(1, 10**9)


def safety_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `safety`, where the graph moves; PROVED or UNDECIDED."""
    if not asked.loop.guarantee.moves:
        return []
    report("deciding whether the box is left")
    return [_limited("safety", asked, _safe)]


def markov_stage(asked: Asked, report: Progress) -> list[Check]:
    """The check `markov`, where proofs may assume a Markov chain."""
    if generator_of(asked.loop) is None:
        return []
    report("deciding the Markov signal")
    return [_limited("markov", asked, _random)]


def _limited(id: str, asked: Asked, decide: Callable[[Asked], Check]) -> Check:
    reason = obstacle(asked.loop, asked.W)
    if reason is not None and (id == "safety" or acts_by_component(asked.loop)):
        return undecided_check(id, asked.domain, reason, applies=False)
    try:
        return limited(id, asked.domain, partial(decide, asked))
    except (ArithmeticError, RuntimeError, ValueError) as error:
        logger.warning("no %s: %s", id, error)
        return undecided_check(
            id, asked.domain, "no proof is found: a numerical library broke down."
        )


def _boxes(asked: Asked, kind: str, rate: Fraction | None) -> Iterator[tuple[Asked, Kept]]:
    """Claims with v = 1 for the box of starts, or a smaller one."""
    loop, W, exosystem = asked.loop, asked.W, asked.loop.joint_exosystem
    error: ErrorBound | None = None
    if exosystem is not None and W is not None:
        if rate is not None:
            rate = min(rate, rounded_down(decay_rate(exosystem, W) / 2))
        error = propose_error_bound(exosystem, W, rate=float(rate or 0))
        if error is None:
            return
        error = with_kappa(error, rate=rate or 0)
    for k in range(1 if loop.is_linear else SMALLER + 1):
        sides = asked.radius, asked.disturbance
        radius, disturbance = (decimal_below(claimed(x) / 2**k) if x and k else x for x in sides)
        rho = None
        if not loop.is_linear:
            rho = claimed(radius)
            if error is not None and disturbance:
                noise = error.kappa * claimed(disturbance)
                rho = rounded_up(
                    (rho + root_above(noise**2 * error.size, unit=10**12)) * (1 + EXTRA),
                    digits=DIGITS,
                )
        box = Cycles(phases=(), rate=None, rho=rho, error=error)
        yield (
            replace(asked, radius=radius, disturbance=disturbance),
            Kept(kind=kind, rate=rate, box=box),
        )


def _safe(asked: Asked) -> Check:
    loop, gains = asked.loop, holding_gains(asked.loop)
    loose = [label for label, gain in zip(loop.labels, gains, strict=True) if gain <= 0]
    wrong: str | None = "no bound of the estimation error is found."
    for smaller, claim in _boxes(asked, "", None if loose else min(gains)):
        wrong = why_not(loop, asked.W, claim)
        if wrong is None:
            size = "max |e(0)|" + (" and what the estimation error adds" if loop.groups else "")
            if claim.box is not None and claim.box.rho is not None:
                size = text_above(claim.box.rho, digits=6)
            starts = (
                "every start"
                if claim.box is None or claim.box.rho is None
                else f"|e(0)| <= {smaller.radius:.6g}"
            )
            if loop.groups and starts != "every start":
                starts += f" and |eps_i(0)| <= {smaller.disturbance:.6g}"
            reason = (
                f"from {starts} no agent ever leaves the box |e| <= {size}, whatever the "
                "graph, its switching and"
            )
            reason += " the motion."
            if claim.rate is None:
                who = f"not pinned, and may lose all neighbours: {name_agents(tuple(loose))}"
                known = loop.guarantee.is_given
                helps = "" if known else '; a guarantee on time would help (guarantee = "dwell")'
                reason += f" There is no rate ({who}){helps}."
            else:
                reason += (
                    " All agents are pinned, so from there all reach the target for every "
                    "graph and every motion,"
                )
                reason += f" at least like exp(-{text_below(claim.rate)} t)."
            return _check("safety", smaller, claim, reason)
    return undecided_check("safety", asked.domain, str(wrong))


def _random(asked: Asked) -> Check:
    loop, W, generator = asked.loop, asked.W, generator_of(asked.loop) or ()
    signal, wrong = "for the Markov signal, whatever its first mode, every error decays", ""
    if loop.is_linear:
        for how in (square_claim, mean_claim):
            claim = (
                None
                if how is mean_claim and not acts_by_component(loop)
                else how(loop, W, generator)
            )
            if claim is not None and why_not(loop, W, claim) is None:
                pace = f"at least like exp(-{text_below(claim.rate or Fraction(0))} t)"
                return _check("markov", asked, claim, f"{signal} {HOW[claim.kind]}, {pace}.")
    if (found := apart_check(loop, asked.domain)) is not None:
        return found
    if not acts_by_component(loop):
        return undecided_check(
            "markov", asked.domain, "no matrices P are found, and couplings mix components."
        )
    for smaller, claim in _boxes(asked, SURE, None):
        wrong = why_not(loop, W, claim) or ""
        if not wrong:
            return _check("markov", smaller, claim, f"{signal} {HOW[SURE]}.")
    return undecided_check(
        "markov", asked.domain, wrong or "no bound of the estimation error is found."
    )


def _check(id: str, asked: Asked, claim: Kept, reason: str) -> Check:
    """The check of a claim, decided once more as it is written."""
    somewhere = claim.box is not None and claim.box.rho is not None
    check = Check(
        id=id,
        verdict=Verdict.PROVED,
        domain=Box(asked.radius, asked.disturbance) if somewhere else EVERYWHERE,
        rate=None if claim.rate is None else decimal_below(claim.rate),
        reason=reason,
        claim=claim,
    )
    wrong = confirm(check, asked.loop, asked.W, domain=asked.domain)
    return check if wrong is None else undecided_check(id, asked.domain, wrong)
