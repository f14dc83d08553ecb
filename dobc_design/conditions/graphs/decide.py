"""What `safety` and `markov` claim, its JSON, and whether it holds (theory, sections 5, 6 and 11).

safety: V = max |e_ic| + kappa E never grows while V <= rho, for every graph, also one that moves;
or decays at a rate. markov, of the Markov chain of [switching] and whatever its first mode; A_p =
J_p - K, g its generator:

almost sure   V as above never grows, and modes that the chain does not leave reach every agent: all
errors decay. mean          w_p > 0 for every mode, A_p'w_p + sum_q g_pq w_q <= -rate w_p, A_p with
what the gains hold at least:
              E[sum w_i |e_i|] decays at the rate (up to what the estimation error adds, which
              decays faster).
mean square   P_p > 0 for every mode, A_p'P_p + P_p A_p + sum_q g_pq P_q + 2 rate P_p < 0: E[e'P e]
at twice the rate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, Final

import numpy as np

from dobc_design.conditions.check import Check, Values, Witness, differs, read_object
from dobc_design.conditions.consensus.claim import state_theorems
from dobc_design.conditions.consensus.decide import linear_part
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.domain import Domain
from dobc_design.conditions.numbers import (
    form_from_json,
    read_rational,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.observer.decide import error_matrix, hurwitz_with_rate
from dobc_design.conditions.reason import pins_obstacle
from dobc_design.conditions.schedule.checks import cycles_from_json, not_as_claimed
from dobc_design.conditions.schedule.claim import Cycles
from dobc_design.conditions.schedule.cycles import first_unreached, holds_observer, rises
from dobc_design.conditions.separable.claim import acts_by_component, holding_gains, observed_in
from dobc_design.exact import matrix as exact
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import spend
from dobc_design.loop.arcs import unreached
from dobc_design.loop.loop import Loop
from dobc_design.problem.canonical import matrix_text
from dobc_design.verdict import Verdict

MOST_MODES: Final = 300  # of a chain, of which both programs say where it ends
SURE: Final = "almost sure"
MEAN: Final = "mean"
SQUARE: Final = "mean square"
HOW: Final = {SURE: "almost surely", MEAN: "in the mean", SQUARE: "in mean square"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """A claim as above: ``kind`` "" for safety; ``box`` has rho and the observer's part; ``w`` or
    ``P`` by mode."""

    kind: str = ""
    rate: Fraction | None = None
    box: Cycles | None = None
    w: Mapping[str, Vector | Doubles] | None = None
    P: Mapping[str, Matrix] | None = None

    def to_json(self) -> dict[str, Any]:
        values: dict[str, Any] = {"kind": self.kind} if self.kind else {}
        if self.box is not None:
            values |= {
                name: value
                for name, value in self.box.to_json().items()
                if name not in ("phases", "rate")
            }
        if self.kind != SURE:
            values["rate"] = None if self.rate is None else number_text(self.rate)
        if self.w is not None:
            values["w"] = {mode: vector_to_json(v) for mode, v in self.w.items()}
        if self.P is not None:
            values["P"] = {mode: matrix_text(P) for mode, P in self.P.items()}
        return values


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Kept | Values:
    """What a check of this topic claims, for this problem; a refutation: modes that are never
    left."""
    exact = check.exact or {}
    if check.verdict is Verdict.REFUTED:
        return Values(exact)
    kind = "" if check.id == "safety" else exact["kind"]
    if kind in ("", SURE):
        values = read_object(exact, ("rho", "kind" if kind else "rate", *observed_in(loop)))
        own = {name: value for name, value in values.items() if name != "kind"} | {
            "rate": None,
            "phases": [],
        }
        rate = values.get("rate")
        box = cycles_from_json(own, loop)
        return Kept(kind=kind, rate=None if rate is None else read_rational(rate), box=box)
    name = {MEAN: "w", SQUARE: "P"}[kind]
    values = read_object(exact, ("kind", "rate", name))
    each = read_object(values[name], loop.modes.keys())
    rate, ordered = (
        read_rational(values["rate"]),
        {mode: each[mode] for mode in loop.modes},
    )
    if kind == MEAN:
        return Kept(
            kind=kind,
            rate=rate,
            w={mode: vector_from_json(v, loop.n) for mode, v in ordered.items()},
        )
    return Kept(kind=kind, rate=rate, P={mode: form_from_json(P) for mode, P in ordered.items()})


def signals_in_words(loop: Loop, check: Check) -> str:
    """For which signals a proof holds, and in which sense: "for ..."; nothing where there is one
    graph."""
    if check.id == "schedule":
        return f"for {loop.guarantee.in_words()}"
    if check.id == "markov":
        how = HOW.get(str((check.exact or {}).get("kind")), HOW[SURE])
        return f"{how} for the Markov signal, whatever its first mode"
    if check.id == "safety":
        return "for every graph and every motion"
    return "under arbitrary switching of the modes" if loop.switches else ""


ZERO = Fraction(0)


def generator_of(loop: Loop) -> Matrix | None:
    """The generator of the Markov chain that proofs may assume; None without one, and where one
    mode is always on."""
    return loop.guarantee.generator


def closed_classes(generator: Matrix) -> list[tuple[int, ...]]:
    """The smallest sets of modes (places) that the chain does not leave; it ends in one of them."""
    size = len(generator)
    leads = np.array(
        [[p == q or rate > 0 for q, rate in enumerate(row)] for p, row in enumerate(generator)]
    )
    for _ in range(size.bit_length()):  # paths of twice the length; the numbers of paths are exact
        steps = leads.astype(np.float64)
        leads = steps @ steps > 0
    closed = [row for p, row in enumerate(leads) if np.all(leads[row, p])]
    return sorted({tuple(np.flatnonzero(row).tolist()) for row in closed})


def absorbing(loop: Loop) -> list[tuple[str, ...]]:
    """The modes of each such set, where proofs may assume a Markov chain; none where there are more
    than MOST_MODES."""
    generator, names = generator_of(loop), list(loop.modes)
    if generator is None or len(names) > MOST_MODES:
        return []
    return [tuple(names[p] for p in each) for each in closed_classes(generator)]


def why_not(loop: Loop, W: Matrix | None, claim: Kept) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return next((words for holds, words in _needs(loop, W, claim) if not holds), None)


def _needs(loop: Loop, W: Matrix | None, claim: Kept) -> Iterator[tuple[bool, str]]:
    yield not loop.pins.curved, str(pins_obstacle(loop))
    generator, exosystem = generator_of(loop), loop.joint_exosystem
    if claim.kind:
        yield generator is not None, 'there is no guarantee = "markov", or only one mode.'
    yield (
        acts_by_component(loop) or claim.P is not None,
        "couplings have to act on each component by itself.",
    )
    if claim.box is not None:
        yield not claim.box.phases and claim.box.rate is None, "it has no weights."
        yield from holds_observer(loop, W, claim.box, claim.rate)
        yield from rises(loop, claim.box.rho, strictly=claim.kind == SURE)
        least = min(holding_gains(loop))
        yield (
            claim.rate is None or claim.rate <= least,
            "not every agent is pinned as much as its rate.",
        )
        names = list(loop.modes)
        for each in closed_classes(generator or ()) if claim.kind else ():
            modes = [names[p] for p in each]
            missed = first_unreached(loop, modes)
            yield (
                missed is None,
                f"while modes {' and '.join(modes)} are on in turn, no pin reaches agent {missed}.",
            )
        return
    yield loop.is_linear, "couplings have to be linear."
    rate = claim.rate or ZERO
    if exosystem is not None:
        decays = W is not None and hurwitz_with_rate(error_matrix(exosystem, W), rate)
        yield decays, "the estimation error does not decay at this rate."
    if claim.w is not None:
        yield from _mean(loop, claim, generator or (), rate)
    else:
        yield from _square(loop, claim, generator or (), rate)


def _mean(loop: Loop, claim: Kept, generator: Matrix, rate: Fraction) -> Iterator[tuple[bool, str]]:
    """A_p'w_p + sum_q g_pq w_q <= -rate w_p, with slopes taken at their worse ends."""
    weights = {mode: tuple(v) for mode, v in (claim.w or {}).items()}
    yield list(weights) == list(loop.modes), "there must be weights for every mode."
    fits = (len(v) == loop.n and min(v) > 0 for v in weights.values())
    yield all(fits), "weights must be > 0, one per agent."
    slopes = [each.jacobian_at_zero()[0][0] for each in loop.functions]
    yield min(slope.lo for slope in slopes) >= 0, "a coupling falls."
    gains = holding_gains(loop)
    for (mode, w), rates in zip(weights.items(), generator, strict=True):
        spend(len(loop.modes[mode]) + loop.n * len(rates))
        rows = [(rate - k) * x for k, x in zip(gains, w, strict=True)]
        for q, other in enumerate(weights.values()):
            if rates[q]:
                rows = [row + rates[q] * x for row, x in zip(rows, other, strict=True)]
        arcs = loop.modes[mode]
        for (i, j, weight), loose in zip(arcs, arcs.uncertain.tolist(), strict=True):
            slope = slopes[loop.place_of(i, j)]
            rows[j] += weight * slope.hi * w[i]
            rows[i] -= ZERO if loose else weight * slope.lo * w[i]
        yield max(rows) <= 0, f"a row does not hold in mode {mode}."


def _square(
    loop: Loop, claim: Kept, generator: Matrix, rate: Fraction
) -> Iterator[tuple[bool, str]]:
    """P_p > 0 and A_p'P_p + P_p A_p + sum_q g_pq P_q + 2 rate P_p < 0."""
    forms, size, statements = claim.P or {}, loop.n * loop.m, state_theorems(loop)
    yield list(forms) == list(loop.modes), "there must be a P for every mode."
    symmetric = (exact.shape(P) == (size, size) and exact.is_symmetric(P) for P in forms.values())
    yield all(symmetric), f"every P must be a symmetric {size}x{size} matrix."
    for (mode, P), rates in zip(forms.items(), generator, strict=True):
        A = linear_part(statements, mode)
        yield A is not None, "the slopes are not rational, or the network is too large."
        half = exact.multiply(P, A or ())
        total = exact.add(exact.add(half, exact.transpose(half)), exact.scale(2 * rate, P))
        for g, other in zip(rates, forms.values(), strict=True):
            total = exact.add(total, exact.scale(g, other))
        falls = (
            decide_positive_definite(M).verdict is Verdict.PROVED
            for M in (P, exact.scale(-1, total))
        )
        yield all(falls), f"P > 0 or its inequality fails in mode {mode}."


def apart_check(loop: Loop, domain: Domain) -> Check | None:
    """REFUTED, with the agents that hear no pin in modes that the chain never leaves; None if there
    are none."""
    for each in absorbing(loop):
        modes = list(each)
        arcs = [loop.modes[mode] for mode in modes]
        labels = tuple(loop.labels[i] for i in unreached(loop, arcs))
        if labels:
            reason = (
                f"the Markov signal never leaves {', '.join(modes)}, and there no pinned agent "
                "reaches"
            )
            sure = " by arcs that are always there" if any(each.optional for each in arcs) else ""
            reason += (
                f" {name_agents(labels)}{sure}: starts in which all of these have the same "
                "error stay as they are."
            )
            lost = partial(
                Check, claim=Values({"modes": modes}), witness=Witness(kind="agents", labels=labels)
            )
            return lost(id="markov", verdict=Verdict.REFUTED, domain=domain, reason=reason)
    return None


def confirm(check: Check, loop: Loop, W: Matrix | None, *, domain: Domain) -> str | None:
    """None if everything that a proved or refuted check of this topic claims is confirmed, else
    what is not."""
    if check.verdict is Verdict.REFUTED:
        own = apart_check(loop, domain) if check.id == "markov" and check.rate is None else None
        return "the chain leaves no agents apart" if own is None else differs(check, own)
    claim = read_claim(check, loop, W)
    if not isinstance(claim, Kept) or check.witness is not None:
        return "a proof has no witness"
    return not_as_claimed(check, loop, claim.rate, claim.box, domain) or why_not(loop, W, claim)
