"""tolerance and actuators: what a max-separable proof leaves to errors of the model, and the inputs
that it needs."""

from fractions import Fraction
from functools import partial
from types import SimpleNamespace
from typing import Any

from .accuracy import shrinks
from .files import Certificate
from .intervals import enclosed
from .matrices import ZERO, Matrix, product, root, transpose
from .reading import an_object, need, rational, read, weights
from .separable import (
    beside,
    composite,
    holds_box,
    observed,
    pace,
    read_separable,
    rows,
    secants,
    starts,
)


def tolerance(case: Certificate, check: Any) -> None:
    """The rows hold for all weights and gains within relative errors: those beside, or at the
    target with a v."""
    p, table = case.problem, case.problem.uncertainty
    shape = dict.fromkeys(("weights", "gains", "alpha", "eta?"), rational) | {
        "v?": partial(weights, p.n)
    }
    exact = read(check.exact, shape)
    errors, v, eta, rate = (exact.weights, exact.gains), exact.v, exact.eta, exact.alpha
    need(p.B is None, "errors of gains are not known for agents with dynamics")
    need(
        all(0 <= error < 1 for error in errors) and rate > 0,
        "an error is not in [0, 1), or alpha is not positive",
    )
    need(
        table is None or (table.weights <= errors[0] and table.gains <= errors[1]),
        "the problem has larger errors",
    )
    need(
        (eta is None) == (table is None or table.known_to_agents),
        "eta is for observers that do not know the weights",
    )
    claim = SimpleNamespace(v=v, rho=None) if v else beside(case, check)
    rows(case, claim, exact.alpha, Fraction(1), errors, local=bool(v))
    if v:
        need(
            eta is None and check.domain == p.domain and not p.kinked,
            "it is no claim about the target",
        )
        need(
            p.q == 0 or check.rate is None, "the rows at the target give no rate of the whole loop"
        )
    elif p.q:
        need(eta is None or bool(pull(case, claim) * errors[0] <= eta), "eta is not shown")
        rate = min(rate - claim.kappa * (eta or 0), pace(case, claim))
    rated = check.rate is not None and 0 < check.rate <= rate
    need(bool(v and p.q) or rated, "the rate is not between 0 and what follows")


def pull(case: Certificate, claim: Any) -> Fraction:
    """max |W|_P max over agents of sum w (v_i + v_j) sup |h(y)/y|: what errors of the weights add
    to eps at most."""
    p, rho, v = case.problem, claim.rho or Fraction(1), claim.v
    roots = [root(product([w], product(claim.P, transpose([w])))[0][0]) for w in transpose(case.W)]
    norm = max(sum(roots[k : k + p.m], ZERO) for k in range(0, len(roots), p.m))
    arcs = [
        (i, arc, v[i] + v[arc.j])
        for heard in p.heard.values()
        for i in range(p.n)
        for arc in heard[i]
    ]
    ends = {
        h: max((y for _, arc, y in arcs if arc.coupling is h), default=ZERO) for h in p.couplings
    }
    slopes = {h: max(secants(h, enclosed(rho * y)[1])) for h, y in ends.items() if y}
    agents = [
        [(arc, v[i] + v[arc.j]) for arc in heard[i]]
        for heard in p.heard.values()
        for i in range(p.n)
    ]
    return norm * max(
        sum((arc.w * y * slopes[arc.coupling] for arc, y in each), ZERO) for each in agents
    )


def actuators(case: Certificate, check: Any) -> None:
    """On {V <= rho} |u_i| <= rho |k_i| v_i + max(0, 1 - kappa |k_i| v_i) E0 + |d_i|, which no limit
    is below; under what `uncertainty` adds the box is shown here, and more comes to |u_i|."""
    p, plant = case.problem, case.problem.uncertainty
    need(p.actuators is not None and check.rate is None, "it is not asked for, or has a rate")
    starts(case, check.domain, "box")
    acts = plant is not None and (plant.disturbance or plant.measurement or (plant.drift and p.q))
    shape: dict[str, Any] = {"rho": rational, "inputs": an_object}
    own_box = acts or "v" in an_object(check.exact)
    if own_box:
        shape |= {"v": partial(weights, p.n), "alpha": rational, "level": rational} | observed(p)
    exact = read(check.exact, shape)
    if own_box:
        added, claim = loaded(case, check, exact, bool(acts)), exact
    else:
        proofs = [
            each for each in case.checks if (each.id, each.verdict) == ("max-separable", "proved")
        ]
        need(bool(proofs), "there is no proof")
        claim, added = read_separable(case, proofs[0].exact), [(ZERO, ZERO)] * p.n
        need(0 < exact.rho <= (claim.rho or exact.rho), "rho is not that of the proof")
        holds_box(claim, check.domain, exact.rho)
    need(set(exact.inputs) == set(p.labels), "there is not one input for each agent")
    more = 1 + (plant.gains if plant else 0)
    unknown = plant is not None and not plant.known_to_agents and not own_box
    first = (
        root(claim.size * check.domain.disturbance**2) if p.q and check.domain.disturbance else ZERO
    )
    for i, label in enumerate(p.labels):
        k = (
            more
            * max((sum(map(abs, row)) for row in p.gains.get(i, [])), default=ZERO)
            * claim.v[i]
        )
        level = exact.rho * (k + added[i][0]) + added[i][1]
        if p.q:
            level += (exact.rho / claim.kappa if unknown else first) * max(
                ZERO, 1 - claim.kappa * k
            )
        most = rational(exact.inputs[label])
        need(level + amplitude(case, i) <= most, f"the input of agent {label} may be larger")
        need(
            most <= p.actuators.limit.get(i, most),
            f"the input of agent {label} may exceed its limit",
        )


def loaded(
    case: Certificate, check: Any, claim: Any, acts: bool
) -> list[tuple[Fraction, Fraction]]:
    """No start leaves {V <= rho} under everything in `uncertainty`; what it adds to every input: a
    part of rho, and a number. The peak gains are those of the accuracy beside, where something
    acts."""
    p, found = (
        case.problem,
        [each for each in case.checks if (each.id, each.verdict) == ("accuracy", "proved")],
    )
    need(bool(found) or not acts, "there is no proof of accuracy")
    blind = (
        p.q > 0
        and p.uncertainty is not None
        and p.uncertainty.weights > 0
        and not p.uncertainty.known_to_agents
    )
    need(acts or not blind, "errors of the weights act on the estimates")
    names = ("disturbance", "drift", "measurement")
    given = an_object(found[0].exact).get("peaks") if p.q and acts else dict.fromkeys(names, "0")
    peaks = SimpleNamespace(**{name: rational(an_object(given).get(name)) for name in names})
    need(claim.alpha > 0 and claim.level > 0, "a number of the box is not positive")
    need(p.q == 0 or claim.kappa * claim.beta * min(claim.v) > 1, "kappa is too small")
    composite(case, claim)
    radius = max(check.domain.radius, claim.level * min(claim.v))
    holds_box(
        claim, SimpleNamespace(radius=radius, disturbance=check.domain.disturbance), claim.rho
    )
    stage = SimpleNamespace(**vars(claim) | {"rho": None if p.domain == "global" else claim.rho})
    return shrinks(p, stage, peaks)


def amplitude(case: Certificate, i: int) -> Fraction:
    """A bound of every component of d_i: given, or of the sines that xi0 starts; there A^2 has to
    be diagonal."""
    p = case.problem
    if p.actuators.amplitude is not None or not p.q:
        return Fraction(p.actuators.amplitude or 0)
    if i not in p.place:
        return ZERO
    need(p.uncertainty is None or p.uncertainty.drift == 0, "amplitudes drift, and none is given")
    group, given = p.groups[p.place[i]], read(p.simulation.get("xi0") or [], [[rational]])
    x: Matrix = transpose(given[min(i, len(given) - 1) :][:1])
    need(len(x) == len(group.A), "there is no start of the disturbance")
    square, slopes, sums = product(group.A, group.A), product(group.A, x), [ZERO] * p.m
    need(
        all(j == k or not y for j, row in enumerate(square) for k, y in enumerate(row)),
        "d is no sum of sines",
    )
    for w in {-row[k] for k, row in enumerate(square)}:
        for c, row in enumerate(group.C):
            alike = [[y if square[k][k] == -w else ZERO for k, y in enumerate(row)]]
            value, slope = product(alike, x)[0][0], product(alike, slopes)[0][0]
            need(w > 0 or w == slope == 0, "the disturbance may grow")
            sums[c] += root(value**2 + slope**2 / w) if w else abs(value)
    return max(sums)
