"""What the checks tolerance and actuators claim (theory, section 12), decided beside a proved
max-separable check.

Tolerance.  For all weights and gains within relative errors the rows of the max-separable
certificate beside it hold at a rate alpha > 0; each row takes the worse ends.  Observers whose
model of the weights is off by as much add

    eps' = (A - W C) eps - W sum_j dw h(y),   |dw| <= delta w,   so   D+ E <= -beta E + eta N, eta =
    max |W|_P delta sum_j w (v_i + v_j) sup |h(y)/y|,   |W|_P = sum of sqrt(c'Pc) over the columns c
    of W,

and V = N + kappa E decreases where kappa eta < alpha.  A claim with a v of its own is about the
slopes at the target.

Actuators.  u_i = -k_i e_i - d_i + C eps_i, so that on {N + kappa E <= rho}, where E never exceeds
its start E0, every |u_ic| is at most rho |k_i|_1 v_i + max(0, 1 - kappa |k_i|_1 v_i) E0 + max
|d_i|, where |k_i|_1 is the largest row sum of sizes with the errors of gains (and E0 is rho/kappa
where errors of the weights act on eps).  What [uncertainty] states of disturbance, drift and noise
acts on everything: then a stage of ``accuracy`` that holds the starts is claimed, with all errors
and inputs in its rows, and to |u_ic| comes what these add by measurements and estimates.  Such a
box of its own may stand there without them, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import NamedTuple

from dobc_design._checks import noun
from dobc_design.conditions.accuracy.decide import Accuracy, Level, Plant, level_of, level_shape
from dobc_design.conditions.accuracy.decide import obstacle as not_final
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import (
    Check,
    Claim,
    not_a_proof,
    read_domain,
    read_parts,
    with_optional,
)
from dobc_design.conditions.domain import Box
from dobc_design.conditions.numbers import (
    fields_to_json,
    follows,
    known_to_json,
    read_rational,
    vector_from_json,
    vector_to_json,
)
from dobc_design.conditions.reason import fixed_obstacle, pins_obstacle
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Errors,
    Separable,
    acts_by_component,
    error_of,
    error_to_json,
    largest_reach,
    observed_in,
    rows,
    stated_errors,
    tied_sizes,
)
from dobc_design.conditions.separable.decide import (
    NOT_BY_COMPONENT,
    FaceRow,
    composite_rate,
    coupling_profiles,
    covers,
    observer_obstacle,
    verify_separable,
)
from dobc_design.conditions.stated import stated_in
from dobc_design.coupling.enclosures import Curve, secant_range
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Matrix, Vector, multiply, row_norm, transpose
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import RESIDUALS, are_pairs, has_matches
from dobc_design.loop.saturation import ROOTS, largest_disturbance, rooms_of


@noun
class Tolerance:
    """The rows hold at the rate ``alpha`` (1/s) for all ``errors``.  ``v``: one entry per agent,
    for the slopes at the target; None for the rows of the certificate beside it.  ``eta`` (1/s):
    where observers do not know the errors."""

    errors: Errors
    alpha: Fraction
    eta: Fraction | None = None
    v: Vector | Doubles | None = None

    def to_json(self) -> Document:
        """The exact values of a proved check."""
        values = fields_to_json(self.errors, "weights", "gains")
        values |= known_to_json(self, "alpha", "eta")
        if self.v is not None:
            values["v"] = vector_to_json(self.v)
        return values


@noun
class Inputs:
    """On {V <= rho}, which holds all starts of the check, every component of u_i is at most
    ``inputs[label]``. ``stage``: a box of its own that is not left, with ``error``, the observer's
    part of its V, which it has under a disturbance, drift or noise of [uncertainty]; None: that of
    max-separable."""

    rho: Fraction
    inputs: Mapping[str, Fraction]
    stage: Level | None = None
    error: ErrorBound | None = None

    def to_json(self) -> Document:
        """The exact values of a proved check."""
        values = fields_to_json(self, "rho", "inputs")
        if self.stage is not None:
            values["v"] = vector_to_json(self.stage.v)
            values |= fields_to_json(self.stage, "alpha", "level")
        return values | error_to_json(self.error)


@noun
class LeftRooms:
    """However far inputs saturate, at least ``rooms[label]`` of the limit of an agent is left for
    its pin beside the compensation of the disturbance.  Agents that agree have no pins: their
    inputs never saturate."""

    rooms: Mapping[str, Fraction]

    def to_json(self) -> Document:
        """The exact values of a proved check."""
        return fields_to_json(self, "rooms")


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Claim:
    """What a proved check of this topic claims, for this problem."""
    exact = check.exact or {}
    if check.id == "actuators":
        return _read_inputs(exact, loop)
    optional = {"eta": read_rational, "v": partial(vector_from_json, size=loop.n)}
    shape = dict.fromkeys(("weights", "gains", "alpha"), read_rational)
    values = read_parts(exact, with_optional(shape, optional, exact))
    errors = Errors(values.pop("weights"), values.pop("gains"))
    if not (all(0 <= error < 1 for error in errors) and values["alpha"] > 0):
        raise ValueError("errors must be >= 0 and < 1, alpha > 0")
    return Tolerance(errors=errors, **values)


def _read_inputs(exact: Document, loop: Loop) -> Inputs | LeftRooms:
    """What a proved check of inputs claims."""
    if loop.saturates or loop.agrees:
        limited = [label for label in loop.labels if limit_of(loop, label) is not None]
        rooms = dict.fromkeys(limited, read_rational)
        return LeftRooms(**read_parts(exact, {"rooms": rooms}))
    shape: Document = {"rho": read_rational, "inputs": dict.fromkeys(loop.labels, read_rational)}
    if not stated_in(loop).absolute and "v" not in exact:
        return Inputs(**read_parts(exact, shape))
    own = level_shape(loop.n)
    values = read_parts(exact, shape | own | observed_in(loop))
    error = error_of(values)
    rho = values["rho"]
    stage = level_of({"rho": rho} | {name: values[name] for name in own})
    if loop.is_linear:
        stage = replace(stage, rho=None)
    return Inputs(rho=rho, inputs=values["inputs"], stage=stage, error=error)


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved check claims is confirmed, beside the proofs max-separable
    and accuracy of the case."""
    loop = case.loop
    W = case.W
    reason = not_a_proof(check)
    if reason is None and loop.drift is not None:
        return "errors of gains, and inputs, are not known for agents with [dynamics]"
    alone = (loop.saturates or loop.agrees) and check.id == "actuators"
    if not alone:
        knows = check.id != "actuators" or tied_sizes(loop) is not None
        known = fixed_obstacle(loop, apart=check.id == "tolerance")
        reason = reason or (known if knows else pins_obstacle(loop))
    if reason is not None:
        return reason
    claim = read_claim(check, loop, W)
    if isinstance(claim, LeftRooms):
        return _not_left(check, loop, W, claim)
    base = case.proved(Separable)
    if base is not None and base.T is not None:
        base = None  # in coordinates
    if isinstance(claim, Inputs):
        if claim.stage is not None:
            return _not_held(check, case, claim, claim.stage)
        if base is None:
            return "it needs a proved max-separable check"
        return _not_inputs(check, loop, base, claim)
    if not isinstance(claim, Tolerance):
        return "it is not known here"
    stated = stated_errors(loop)
    if claim.errors.weights < stated.weights or claim.errors.gains < stated.gains:
        return "the errors of [uncertainty] are larger"
    if claim.errors.weights and are_pairs(loop) and has_matches(loop):
        return "what both agents of a pair hear counts with one weight, unless errors are stated"
    # Observers that know the weights are fed what acts, and their errors decay as before.
    if (claim.eta is None) is not agents_know(loop):
        return "eta belongs to observers that do not know the weights, and to no others"
    if claim.v is not None:
        return _not_tolerated_at_target(check, case, claim, claim.v)
    proof = case.proof(Separable)
    if base is None or proof is None or proof.domain != check.domain:
        return "it needs a proved max-separable check with its domain"
    return _not_tolerated(check, case, claim, base)


def _not_tolerated_at_target(
    check: Check, case: Case, claim: Tolerance, v: Vector | Doubles
) -> str | None:
    """None if the rows at the target hold for all errors of the claim."""
    loop = case.loop
    if check.domain != case.domain or (loop.groups and (case.W is None or check.rate is not None)):
        return (
            f"the domain must be '{case.domain}'; with an observer, which is needed, rows give no "
            "rate of the loop"
        )
    wrong = _not_local(loop, claim, v)
    # with an observer the rows say nothing about the rate of the whole loop
    if wrong is None and not loop.groups and not follows(check.rate, claim.alpha):
        return "the rate does not follow"
    return wrong


def _not_tolerated(check: Check, case: Case, claim: Tolerance, base: Separable) -> str | None:
    """None if the rows of ``base`` hold for all errors of the claim, and V falls."""
    loop = case.loop
    errors = claim.errors
    wrong = verify_separable(loop, replace(base, alpha=claim.alpha), errors=errors).wrong
    if wrong is not None:
        return wrong
    if claim.eta is not None and errors.weights * observer_pull(loop, case.W, base) > claim.eta:
        return (
            "eta is not shown to bound what the errors of the weights add to the estimation error"
        )
    if not follows(check.rate, tolerated_rate(base, claim)):
        return f"the rate {check.rate} does not follow"
    return None


def agents_know(loop: Loop) -> bool:
    """Whether the observers use the true weights."""
    return loop.uncertainty is None or loop.uncertainty.known_to_agents


def tolerated_rate(base: Separable, claim: Tolerance) -> Fraction:
    """The rate of V with the errors: min(alpha - kappa eta, beta - 1/(kappa min v))."""
    if base.error is None:
        return claim.alpha
    return min(claim.alpha - base.error.kappa * (claim.eta or ZERO), composite_rate(base))


def observer_pull(loop: Loop, W: Matrix | None, base: Separable) -> Fraction:
    """An upper bound of eta/delta for the gain W (q, m); 0 without an observer.  Raises:
    UndefinedError."""
    if base.error is None or W is None:
        return ZERO
    # |W|_P, of which each column is a vector in the norm of P.
    columns = transpose(W)
    squares = [multiply((c,), multiply(base.error.P, transpose((c,))))[0][0] for c in columns]
    roots = [root_above(square, unit=ROOTS) for square in squares]
    m = loop.m
    rho = base.rho or ONE
    norm = max(sum(roots[k : k + m], ZERO) for k in range(0, len(roots), m))  # of every group
    if loop.is_apart:
        norm *= RESIDUALS  # W counts half there
    steepest = []
    for coupling, reach in zip(loop.functions, largest_reach(loop, base.v), strict=True):
        y = rho * reach
        curve = Curve(coupling.components[0])
        steepest.append(secant_range(curve, Interval(-y, y)).magnitude)
    sums = (
        sum(x.weight * x.reach * steepest[x.coupling] for x in row.terms)
        for row, _ in rows(loop, base.v)
    )
    return norm * max(sums, default=ZERO)


def why_not_local(loop: Loop) -> str | None:
    """Why the rows at the target say nothing; None if they do."""
    reason = fixed_obstacle(loop, apart=True)
    if reason is not None:
        return reason
    if not acts_by_component(loop):
        return NOT_BY_COMPONENT
    if any(coupling.nonsmooth for coupling in loop.functions):
        return "does not apply: a coupling may have a kink at the target."
    if agents_know(loop):
        return None
    return (
        "does not apply: observers that do not know the weights need a max-separable "
        "certificate ([region])."
    )


def _not_local(loop: Loop, claim: Tolerance, v: Vector | Doubles) -> str | None:
    """The rows for the slopes at the target: sum w h'(0) (v_j - v_i) <= (k_i - alpha) v_i."""
    if least(v) <= 0:
        return "v must be > 0"
    reason = why_not_local(loop)
    if reason is not None:
        return reason
    profiles = coupling_profiles(loop, v, rho=None)
    for row, place in rows(loop, v, errors=claim.errors):
        if FaceRow(row, 1, profiles).linear_bound() > (row.pull - claim.alpha) * row.own:
            return (
                f"the row of agent {loop.labels[place.agent]} in mode {place.mode} "
                "fails at the target"
            )
    return None


def blind(loop: Loop) -> bool:
    """Whether errors of the weights act on the estimates."""
    plant = loop.uncertainty
    return plant is not None and bool(loop.groups and plant.weights) and not plant.known_to_agents


def limit_of(loop: Loop, label: str) -> Fraction | None:
    """The limit of an agent's inputs; None without one."""
    return None if loop.actuators is None else loop.actuators.limit_of(label)


def pin_sizes(loop: Loop) -> Vector:
    """|k_i|_1, the largest row sum of sizes, of each agent, in its worst mode and with the errors
    of gains."""
    more = 1 + stated_errors(loop).gains
    sizes = loop.pulls.each(lambda k: more * row_norm(k))
    tied = tied_sizes(loop) or {}
    return tuple(sizes.get(i, ZERO) + tied.get(i, ZERO) for i in range(loop.n))


class Part(NamedTuple):
    """|u_i - d_i| <= ``per_rho`` rho + ``rest`` on {V <= rho}."""

    per_rho: Fraction
    rest: Fraction


def input_parts(
    loop: Loop,
    v: Sequence[Fraction],
    error: ErrorBound | None,
    disturbance: Fraction,
    *,
    own_box: bool = False,
) -> tuple[Part, ...]:
    """What inputs take of each agent, from |eps_i| <= ``disturbance``."""
    sizes = [k * x for k, x in zip(pin_sizes(loop), v, strict=True)]
    if error is None:
        return tuple(Part(size, ZERO) for size in sizes)
    if not own_box and not agents_know(loop):  # errors of the weights act on E
        return tuple(Part(max(size, 1 / error.kappa), ZERO) for size in sizes)
    # E never exceeds its start, and where N is large little of V is left for E.
    first = root_above(error.size * disturbance**2, unit=ROOTS)
    return tuple(Part(size, max(ZERO, 1 - error.kappa * size) * first) for size in sizes)


def loaded_inputs(
    plant: Plant, stage: Level, error: ErrorBound | None, disturbance: Fraction
) -> tuple[Part, ...]:
    """The same under a disturbance, drift and noise, in the box of a stage of ``accuracy``.
    Raises: UndefinedError."""
    parts = list(input_parts(plant.loop, stage.v, error, disturbance, own_box=True))
    added = {load.agent: load for load in plant.loads(stage)}
    for agent, (per_rho, rest) in enumerate(parts):
        load = added[agent]
        parts[agent] = Part(per_rho + load.growing, rest + load.by_input)
    return tuple(parts)


def _not_left(check: Check, loop: Loop, W: Matrix | None, claim: LeftRooms) -> str | None:
    """None if as much is left of every limit."""
    _, disturbance = read_domain(check.domain, loop, kind=Box)
    found = rooms_of(loop, W, allowed=None if loop.saturates else disturbance)
    if isinstance(found, str):
        return found
    if check.rate is not None:
        return "it claims a rate that this check does not have"
    for agent, room in found.room.items():
        label = loop.labels[agent]
        if not 0 < claim.rooms[label] <= room:
            return f"less is left of the limit of agent {label}"
    return None


def _not_inputs(check: Check, loop: Loop, base: Separable, claim: Inputs) -> str | None:
    """None if every input is bounded by ``claim``, below every limit."""
    table = loop.actuators
    found = largest_disturbance(loop)
    if table is None or found is None or check.rate is not None:
        return "it needs [actuators], a bound of the disturbance, and no rate"
    radius, noise = read_domain(check.domain, loop, kind=Box)
    # A smaller set {V <= rho} than that of the certificate is not left either.
    inside = 0 < claim.rho <= (base.rho or claim.rho)
    if not inside or not covers(replace(base, rho=claim.rho), radius=radius, disturbance=noise):
        return "its box is not inside {V <= rho}, or rho is larger than that of the certificate"
    return _too_small(loop, claim, input_parts(loop, tuple(base.v), base.error, noise), found)


def _too_small(
    loop: Loop, claim: Inputs, parts: Sequence[Part], found: Sequence[Fraction]
) -> str | None:
    """None if no input is larger than ``claim`` says, nor a bound above its limit."""
    for label, part, largest in zip(loop.labels, parts, found, strict=True):
        limit = limit_of(loop, label)
        most = claim.inputs[label]
        is_below = limit is None or most <= limit
        if not is_below or part.per_rho * claim.rho + part.rest + largest > most:
            return f"the input of agent {label} may be larger, or exceed its limit"
    return None


def _not_held(check: Check, case: Case, claim: Inputs, stage: Level) -> str | None:
    """None if, under everything that [uncertainty] states, no start leaves the box and no input
    exceeds its bound."""
    loop = case.loop
    found = largest_disturbance(loop)
    if loop.actuators is None or found is None or check.rate is not None:
        return (
            "it needs [actuators], a bound of the disturbance (with a drift: amplitude), and "
            "no rate"
        )
    reason = not_final(loop, case.W)
    if reason is not None:
        return reason
    peaks = None
    # What acts on the plant for ever is bounded by the stages and peak gains of accuracy.
    if stated_in(loop).absolute:
        final = case.proved(Accuracy)
        if final is None:
            return "it needs a proved check of accuracy"
        peaks = final.peaks
    elif blind(loop):
        return "observers that do not know the weights need the box of max-separable"
    radius, noise = read_domain(check.domain, loop, kind=Box)
    box = Separable(v=stage.v, alpha=stage.alpha, rho=claim.rho, error=claim.error)
    wrong = observer_obstacle(loop, case.W, box)
    if wrong is not None:
        return wrong
    if not covers(box, radius=max(radius, stage.level * box.least), disturbance=noise):
        return "its box, or the level, is not inside {V <= rho}"
    plant = Plant(loop=loop, peaks=peaks)
    wrong = plant.not_shrinking(stage)
    if wrong is not None:
        return wrong
    return _too_small(loop, claim, loaded_inputs(plant, stage, claim.error, noise), found)
