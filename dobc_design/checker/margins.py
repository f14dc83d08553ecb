"""tolerance and actuators: what a max-separable proof leaves to errors of the model, and the inputs
that it needs."""

from fractions import Fraction
from functools import partial
from types import SimpleNamespace
from typing import Any

from .accuracy import NAMES, Added, holds_starts, shrinks
from .claims import Case, need_rate
from .curves import secants
from .expressions import Coupling
from .intervals import enclosed
from .matrices import ZERO, form, root, transpose
from .reading import Object, an_object, matrix, need, rational, read, weights
from .saturation import allowed, amplitude, left
from .separable import Errors, beside, holds_box, observed, pace, read_separable, rows, starts

RATE = "the rate is not between 0 and what follows"


def tolerance(case: Case, check: Any) -> Any:
    """The rows hold for all weights and gains within relative errors: those beside, or at the
    target with a v."""
    shape = dict.fromkeys(("weights", "gains", "alpha", "eta?"), rational)
    exact = read(check.exact, shape | {"v?": partial(weights, case.n)})
    need(case.B is None, "errors of gains are not known for agents with dynamics")
    in_range = 0 <= exact.weights < 1 and 0 <= exact.gains < 1 and exact.alpha > 0
    need(in_range, "an error is not in [0, 1), or alpha is not positive")
    plant = case.uncertainty
    if plant is not None:
        wide_enough = plant.weights <= exact.weights and plant.gains <= exact.gains
        need(wide_enough, "the problem has larger errors")
    need(not case.matched or exact.weights == 0, "shared weights of pairs are exact")
    told = plant is None or plant.known_to_agents
    need((exact.eta is None) == told, "eta is for observers that do not know the weights")
    errors = Errors(weights=exact.weights, gains=exact.gains)
    if exact.v:
        claim = SimpleNamespace(v=exact.v, rho=None)
        rows(case, claim, exact.alpha, errors=errors, local=True)
        at_target = exact.eta is None and check.domain == case.domain and not case.kinked
        need(at_target, "it is no claim about the target")
        if case.q:
            need(check.rate is None, "the rows at the target give no rate of the whole loop")
        else:
            need_rate(check, exact.alpha, RATE)
        return claim
    return in_region(case, check, exact, errors)


def in_region(case: Case, check: Any, exact: Any, errors: Errors) -> Any:
    """A claim about the domain of the max-separable beside."""
    claim = beside(case, check)
    rows(case, claim, exact.alpha, errors=errors)
    rate = exact.alpha
    if case.q:
        eta = exact.eta or ZERO
        shown = exact.eta is None or pull(case, claim) * exact.weights <= eta
        need(shown, "eta is not shown")
        rate = min(rate - claim.kappa * eta, pace(case, claim))
    need_rate(check, rate, RATE)
    return claim


def pull(case: Case, claim: Any) -> Fraction:
    """max |W|_P max over agents of sum w (v_i + v_j) sup |h(y)/y|: what errors of the weights add
    to eps at most."""
    v = case.with_fixed(claim.v)
    # outward roots: |W|_P is not underestimated
    roots = [root(form(w, claim.P, w)) for w in transpose(case.W)]
    norm = max(sum(roots[k : k + case.m], ZERO) for k in range(0, len(roots), case.m))
    ends: dict[Coupling, Fraction] = {}
    for arc in case.arcs:
        width = v[arc.i] + v[arc.j]
        ends[arc.coupling] = max(width, ends.get(arc.coupling, ZERO))
    if case.differences:  # where W counts half
        norm *= 2
    rho = claim.rho or Fraction(1)
    slopes = {h: max(secants(h, enclosed(rho * y)[1])) for h, y in ends.items()}
    most = ZERO
    for i, arcs in case.rows:
        own = ZERO
        for arc in arcs:
            own += arc.w * (v[i] + v[arc.j]) * slopes[arc.coupling]
        most = max(most, own)
    return norm * most


# --- Inputs
def actuators(case: Case, check: Any) -> None:
    """On {V <= rho} |u_i| <= rho |k_i| v_i + max(0, 1 - kappa |k_i| v_i) E0 + |d_i|, which no limit
    is below; under what `uncertainty` adds the box is shown here, and more comes to |u_i|."""
    asked = case.actuators is not None and check.rate is None
    need(asked, "it is not asked for, or has a rate")
    starts(case, check.domain, "box")
    if case.actuators.saturates or case.agrees:
        rooms(case, check)
        return
    acts = case.disturbed
    own_box = acts or "v" in an_object(check.exact)
    shape: Object = {"rho": rational, "inputs": an_object}
    if own_box:
        shape |= {"v": partial(weights, case.n), "alpha": rational, "level": rational}
        shape |= observed(case)
    exact = read(check.exact, shape)
    if own_box:
        claim = exact
        added = loaded(case, check, exact, acts)
    else:
        claim = of_proof(case, check, exact.rho)
        added = [Added()] * case.n
    need(set(exact.inputs) == set(case.labels), "there is not one input for each agent")
    start = estimates(case, check, claim, exact.rho, own_box)
    plant = case.uncertainty
    more = 1 + (plant.gains if plant else 0)
    error = max(plant.weights, plant.gains) if plant else ZERO
    noise = plant.measurement if plant else ZERO
    for i, label in enumerate(case.labels):
        tied = case.tied_size(i, error)
        k = (more * case.gain_size(i) + tied) * claim.v[i]
        level = exact.rho * (k + added[i].part) + added[i].number + noise * tied
        if case.q:
            # N and E share V: what E has is missing in N, so that only one of them is large
            level += start * max(ZERO, 1 - claim.kappa * k)
        most = rational(exact.inputs[label])
        largest = level + amplitude(case, i)
        need(largest <= most, f"the input of agent {label} may be larger")
        limit = case.actuators.limit.get(i, most)
        # of an agent without a limit any input will do
        need(most <= limit, f"the input of agent {label} may exceed its limit")


def rooms(case: Case, check: Any) -> None:
    """As much is left of each limit for the pin, however far inputs saturate; of agents that agree,
    which have no pin, for all of the domain."""
    claimed = read(check.exact, {"rooms": an_object}).rooms
    found = dict(left(case, check.domain.disturbance if case.agrees else allowed(case)))
    limited = {case.labels[i]: room for i, room in found.items()}
    need(set(claimed) == set(limited), "there is not one room for each agent with a limit")
    for label, room in limited.items():
        need(0 < rational(claimed[label]) <= room, f"less is left of the limit of agent {label}")


def of_proof(case: Case, check: Any, rho: Fraction) -> Any:
    """The max-separable beside, whose box of size rho holds the starts."""
    proof = case.proved("max-separable")
    need(proof is not None, "there is no proof")
    # its own check decides that it decreases there
    claim = read_separable(case, proof.exact)
    need(0 < rho <= (claim.rho or rho), "rho is not that of the proof")
    holds_box(claim, check.domain.radius, check.domain.disturbance, rho)
    return claim


def estimates(case: Case, check: Any, claim: Any, rho: Fraction, own_box: bool) -> Fraction:
    """E0: a bound of the estimation errors, from their starts, or from V where errors of the
    weights act on them."""
    if case.q == 0:
        return ZERO
    plant = case.uncertainty
    if plant is not None and not plant.known_to_agents and not own_box:
        return Fraction(rho / claim.kappa)
    s = check.domain.disturbance
    if s:
        return root(claim.size * s**2)
    return ZERO


def loaded(case: Case, check: Any, claim: Any, acts: bool) -> list[Added]:
    """No start leaves {V <= rho} under everything in `uncertainty`; what it adds to every input: a
    part of rho, and a number. The peak gains are those of the accuracy beside, where something
    acts."""
    proof = case.proved("accuracy")
    need(proof is not None or not acts, "there is no proof of accuracy")
    plant = case.uncertainty
    told = plant is None or plant.known_to_agents or plant.weights == 0
    need(acts or case.q == 0 or told, "errors of the weights act on the estimates")
    given = dict.fromkeys(NAMES, "0")
    if case.q and acts:
        given = an_object(an_object(proof.exact).get("peaks"))
    peaks = SimpleNamespace(**{name: rational(given.get(name, "0")) for name in NAMES})
    peaks.bands = read(given.get("bands", []), [matrix(case.m, case.m)])
    need(claim.alpha > 0 and claim.level > 0, "a number of the box is not positive")
    holds_starts(case, check.domain, claim)
    rho = None if case.domain == "global" else claim.rho
    return shrinks(case, SimpleNamespace(**vars(claim) | {"rho": rho}), peaks)
