"""The checks tolerance and actuators: when they are tried, how large an error is found, and what
they report."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.accuracy.decide import Accuracy, Level, Plant
from dobc_design.conditions.accuracy.stage import ROOM, covering_boxes
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Check, limited, undecided_check
from dobc_design.conditions.coverage import NEAR, Asked, Progress
from dobc_design.conditions.domain import EVERYWHERE, Around, Box, Domain
from dobc_design.conditions.margins import decide
from dobc_design.conditions.numbers import (
    claimed,
    decimal_below,
    last_found,
    rounded_down,
    rounded_up,
)
from dobc_design.conditions.separable.checks import why_no_weights
from dobc_design.conditions.separable.claim import (
    ErrorBound,
    Errors,
    Separable,
    acts_by_component,
    stated_errors,
)
from dobc_design.conditions.separable.decide import NOT_BY_COMPONENT, verify_separable
from dobc_design.conditions.separable.propose import field_of, least_above
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.conditions.separable.propose_observer import propose_error_bound
from dobc_design.conditions.separable.stage import IN_HAND, TIMED_ARCS
from dobc_design.conditions.stated import NO_ROOM, stated_in
from dobc_design.conditions.weighted.propose import rounded
from dobc_design.coupling.coupling import make_coupling
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Array
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import are_pairs
from dobc_design.loop.saturation import largest_disturbance, rooms_of
from dobc_design.verdict import Verdict

from .decide import Inputs, LeftRooms, Part, Tolerance, limit_of

LOAD = 1e-6  # of the largest gain: v may be larger by many powers of ten
ALONE = 0.5  # of v without what others add, which is where the search begins


@np.errstate(all="ignore")
def common_vector(loop: Loop, errors: Errors) -> Array | None:
    """v > 0 (n,) with M v >= 1, M = L(w h'(0)) + K, in every mode and for all errors; None if none
    is seen.  Raises: OverflowError beyond the floats."""
    slopes = (float(h.jacobian_at_zero()[0][0].midpoint) for h in loop.functions)
    lines = tuple(make_coupling(f"{slope!r}*y", dimension=loop.m) for slope in slopes)
    field = field_of(replace(loop, functions=lines), rho=1.0, errors=errors)
    size = LOAD * field.limit
    field = replace(field, grid=np.ones(1), load=size)
    # what an agent would need by itself
    alone = -size / field.rows(np.ones(loop.n), alpha=0.0)[1].diagonal()
    if not np.all(alone > 0):
        return None
    v = least_above(field, alpha=0.0, lower=ALONE * alone)
    return None if v is None else v / size


LARGEST = Fraction(999, 1000)  # of the errors that are tried, as parts of 1 or of those stated
HALVINGS = 30  # until one is small enough
STEPS = 12  # of bisection between the last two
KEPT = Fraction(1, 100)  # of the rate, which the largest error leaves; half of that is claimed
LEAST_KEPT = Fraction(1, 10**6)  # the same, where the file states the errors
WIDER = Fraction(21, 20)  # eta, for a second program with wider enclosures
FAR = 1000  # times that v grows until the rows at the target count as lost
MORE = 1 + Fraction(1, 10**9)  # inputs, for roots that another program rounds otherwise
NOT_FINAL = (
    "what [uncertainty] adds acts on the inputs, too, and no final bounds (accuracy) are "
    "proved under it."
)
NO_BOX = "no box is found that holds the starts and is not left under what the file states."
SLOWLY = (0.01, 0.1)  # parts of the largest rate that weights of their own are made for
NO_PROOF = "there is no proved max-separable certificate that it could rest on."


def is_asked(asked: Asked) -> bool:
    """Whether the problem asks something that rests on a max-separable certificate."""
    unknown = _given(asked) is not None and not decide.agents_know(asked.loop)
    return asked.loop.actuators is not None or unknown


def _case(asked: Asked, checks: Iterable[Check]) -> Case:
    return replace(asked.case, checks=tuple(checks))


def margins_stage(asked: Asked, checks: Sequence[Check], report: Progress) -> list[Check]:
    """The tolerance beside ``checks``, where there is one."""
    # Pairs have no tolerance that the file does not ask for.
    is_open = are_pairs(asked.loop) and _given(asked) is None
    if asked.loop.drift is not None or is_open:
        return []
    report("deciding the tolerance")
    # Rows in coordinates say nothing about errors of weights.
    beside = []
    for check in checks:
        if isinstance(check.claim, Separable) and check.claim.T is None:
            beside.append(check)
    case = _case(asked, beside)
    found = limited("tolerance", asked.domain, lambda: _tolerance(asked, case))
    if not found.is_proved and _given(asked) is None:
        return []  # nobody asked for it
    return [found]


def _given(asked: Asked) -> Errors | None:
    """The errors of [uncertainty]; None without any."""
    errors = stated_errors(asked.loop)
    return errors if any(errors) else None


def _tolerance(asked: Asked, case: Case) -> Check:
    """The errors of [uncertainty] if these are tolerated, else about the largest that are; beside
    the max-separable proof of the case, or at the target."""
    loop = asked.loop
    given = _given(asked)
    proof = case.proof(Separable)
    base = case.proved(Separable)
    undecided = partial(undecided_check, "tolerance", asked.domain)
    is_large = loop.arc_count > TIMED_ARCS
    if is_large and given is None:
        return undecided(
            f"left out: the network is large; tolerances are examined up to {TIMED_ARCS} arcs."
        )
    apart = None if given is None else why_no_weights(loop)
    if apart is not None:
        return undecided(apart)
    why = decide.why_not_local(loop)
    is_local = why is None and (not loop.groups or asked.W is not None)
    if (not asked.wanted or proof is None) and is_local:
        # without a region the question is about the target, not about the box that was found
        proof = base = None
        if asked.wanted and asked.domain != EVERYWHERE:
            return undecided(NO_PROOF)
    elif proof is None:
        return undecided(why or NO_PROOF, applies=why is None)
    try:
        find = _at_target(asked) if base is None else _in_region(asked, base)
    except UndefinedError as error:
        return undecided(f"the slopes of the coupling are not bounded: {error}")
    part = ZERO
    claim = None if given is None else find(given)
    if claim is None and not is_large:
        # Weights and gains err together, in the ratio that the file states.
        direction = given or Errors(ONE, ONE)
        part, claim = _largest(lambda part: find(Errors(*(part * x for x in direction))))
    if claim is None:
        return undecided("the errors are too large for the certificate.")
    if given is not None and part:
        return undecided(
            "the errors are too large for the certificate; for "
            f"{float(part):.3g} times these errors it is proved."
        )
    has_rate = base is not None or not loop.groups
    rate = claim.alpha if base is None else decide.tolerated_rate(base, claim)
    check = Check(
        id="tolerance",
        verdict=Verdict.PROVED,
        domain=asked.domain if proof is None else proof.domain,
        rate=decimal_below(rate) if has_rate else None,
        claim=claim,
        reason=_tolerated(claim, is_largest=bool(part), needs_hurwitz=not has_rate),
    )
    return check.unless(decide.confirm(check, case), case.domain)


def _tolerated(claim: Tolerance, *, is_largest: bool, needs_hurwitz: bool) -> str:
    """What is tolerated, in words."""
    w, k = (f"{float(rounded_down(100 * x, digits=4)):.4g} %" for x in claim.errors)
    reason = (
        f"the proof holds for all arc weights that are off by up to {w} and all gains by up to "
        f"{k}, each on its own, constant or varying"
    )
    reason += ", while A - WC is Hurwitz." if needs_hurwitz else "."
    if is_largest:
        reason += " With the same percentage for both, it allows hardly more."
    return reason


def _largest(find: Callable[[Fraction], Tolerance | None]) -> tuple[Fraction, Tolerance | None]:
    """About the largest part <= LARGEST (three digits) for which something is found, and that."""
    # Halved until something is tolerated; then cut between that and the last one that is not.
    low = high = LARGEST
    best = find(low)
    for _ in range(HALVINGS - 1):
        if best is not None:
            break
        low, high = rounded_down(low / 2, digits=3), low
        best = find(low)
    if best is None:
        return ZERO, None

    def middle(low: Fraction, high: Fraction) -> Fraction:
        return rounded_down((low + high) / 2, digits=3)

    def close(low: Fraction, high: Fraction) -> bool:
        return not low < middle(low, high) < high

    return last_found(
        lambda part, _: find(part), best, low, high, steps=STEPS, middle=middle, close=close
    )


def _in_region(asked: Asked, base: Separable) -> Callable[[Errors], Tolerance | None]:
    """The rows of ``base``: for the errors that are given at nearly the largest rate, else at a
    small part of its."""
    loop = asked.loop
    given = _given(asked)
    kappa = ZERO if base.error is None else base.error.kappa
    known = decide.agents_know(loop)
    pull = ZERO if known else decide.observer_pull(loop, asked.W, base)
    kept = base.alpha * (KEPT if given is None else LEAST_KEPT)

    def find(errors: Errors) -> Tolerance | None:
        eta = None if known else rounded_up(errors.weights * pull * WIDER, digits=6)
        alpha = kappa * (eta or ZERO) + kept
        slower = replace(base, alpha=alpha)
        if verify_separable(loop, slower, errors=errors).wrong is not None:
            return None
        alpha -= kept / 2
        if errors == given:
            best = largest_rate(loop, base.v, rho=base.rho, errors=errors) or ZERO
            alpha = max(alpha, best * (1 - IN_HAND))
        return Tolerance(errors=errors, alpha=alpha, eta=eta)

    return find


def _at_target(asked: Asked) -> Callable[[Errors], Tolerance | None]:
    """Rows at the target, with the v that the errors ask for."""
    usual = None
    with suppress(OverflowError):
        usual = common_vector(asked.loop, Errors())

    def find(errors: Errors) -> Tolerance | None:
        v = None if usual is None else common_vector(asked.loop, errors)
        if v is None or usual is None or np.max(v) > FAR * np.max(usual):
            return None
        alpha = rounded_down(Fraction(1 / (2 * float(np.max(v)))), digits=4)
        return Tolerance(errors=errors, alpha=alpha, v=rounded(v))

    return find


def inputs_stage(asked: Asked, checks: Sequence[Check], report: Progress) -> list[Check]:
    """The check ``actuators`` beside all others; none without [actuators]."""
    if asked.loop.actuators is None or asked.loop.drift is not None:
        return []
    report("deciding the inputs")
    return [limited("actuators", asked.domain, lambda: _actuators(asked, checks))]


@noun
class _Plan:
    """A box that is not left, {V <= rho} with room for ``starts``, and what the inputs of every
    agent take of it.  ``starts``: |e_i| and |eps_i| at most; ``disturbances``: |d_i| at most."""

    loop: Loop
    starts: tuple[float, float]
    rho: Fraction
    parts: Sequence[Part]
    disturbances: Sequence[Fraction]
    v: Sequence[Fraction]
    stage: Level | None = None
    error: ErrorBound | None = None

    @property
    def inputs(self) -> list[Fraction]:
        """The largest inputs."""
        found = []
        for (a, b), d in zip(self.parts, self.disturbances, strict=True):
            found.append(rounded_up((a * self.rho + b + d) * MORE, digits=6))
        return found

    @property
    def limits(self) -> list[Fraction | None]:
        """The limits of the agents."""
        return [decide.limit_of(self.loop, label) for label in self.loop.labels]

    @property
    def worst(self) -> Fraction:
        """The largest input as a part of its limit; 0 without limits."""
        worst = ZERO
        for most, limit in zip(self.inputs, self.limits, strict=True):
            if limit is not None:
                worst = max(worst, most / limit)
        return worst

    def smaller_starts(self) -> tuple[float, float]:
        """Starts so much smaller that no input exceeds its limit, if the disturbance leaves
        room."""
        part = ONE
        for (a, b), d, limit in zip(self.parts, self.disturbances, self.limits, strict=True):
            taken = a * self.rho + b
            if limit is not None and taken > 0:
                part = min(part, (limit - d) / taken / 2)
        part = max(part, Fraction(1, 10**9))
        radius, disturbance = (decimal_below(claimed(x) * part) for x in self.starts)
        return radius, disturbance

    def least_rho(self, level: Fraction) -> Fraction:
        """The least rho, about, with the starts of the errors' estimates and the level in
        {V <= rho}."""
        return _level_of(self.v, self.error, (0.0, self.starts[1]), level)


def _actuators(asked: Asked, checks: Sequence[Check]) -> Check:
    loop = asked.loop
    case = _case(asked, checks)
    if loop.saturates or loop.agrees:
        return _left(asked, case)
    undecided = partial(undecided_check, "actuators", asked.domain)
    found = largest_disturbance(loop)
    if found is None:
        why = "simulation.xi0 gives no sum of constants and sines"
        if loop.uncertainty is not None and loop.uncertainty.drift:
            why = "with a drift of the amplitudes simulation.xi0 bounds nothing"
        reason = f"does not apply: {why}: give actuators.amplitude."
        return undecided(reason, applies=False)
    if not acts_by_component(loop):
        return undecided(NOT_BY_COMPONENT, applies=False)
    apart = why_no_weights(loop)
    if apart is not None:
        return undecided(apart)
    stated = stated_in(loop)
    tolerated = case.proved(Tolerance)
    if stated.absolute and case.proof(Accuracy) is None:
        return undecided(NOT_FINAL)
    base = case.proved(Separable)
    if base is not None and base.T is not None:
        base = None
    if base is not None and base.rho is None and not (asked.wanted or stated.limit):
        reason = "does not apply: inputs have no bound from every start: give a [region]."
        return undecided(reason, applies=False)
    # The rows of max-separable count errors where the tolerance has shown that they do.
    at_target = stated.relative and tolerated is not None and tolerated.v is not None
    plans: Iterable[_Plan] = ()
    if base is not None and not stated.absolute and not at_target:
        plans = _box_of_proof(asked, case, base, found)
    plan = None
    least = ZERO
    # The first box in which every input keeps its limit will do, else the one that comes nearest.
    for each in chain(plans, _boxes_of_their_own(asked, case, base, found)):
        worst = each.worst
        if plan is None or worst < least:
            plan = each
            least = worst
        if least <= 1:
            break
    if plan is None:
        return undecided(NO_BOX)
    if least > 1:
        return undecided(_too_large(asked, plan))
    return _bounded(case, plan)


def _left(asked: Asked, case: Case) -> Check:
    """What saturation leaves of every limit for the pins."""
    loop = asked.loop
    undecided = partial(undecided_check, "actuators", asked.domain)
    allowed = None if loop.saturates else claimed(asked.disturbance)
    found = rooms_of(loop, asked.W, allowed=allowed)
    if isinstance(found, str):
        return undecided(found, applies=False)
    if not found.room:
        return undecided("no agent has a limit.", applies=False)
    limits = {agent: limit_of(loop, loop.labels[agent]) or ZERO for agent in found.room}
    worst = min(found.room, key=lambda agent: found.room[agent] / limits[agent])
    told = (
        f"the disturbance and the errors of its estimates take at most "
        f"{float(found.compensation[worst]):.6g} of the limit {float(limits[worst]):.6g} of agent "
        f"{loop.labels[worst]}"
    )
    if found.room[worst] <= 0:
        return undecided(f"{told}: nothing is left{' for its pin' * loop.saturates}, {NO_ROOM}")
    share = float(rounded_down(100 * found.room[worst] / limits[worst], digits=4))
    least = "; of no agent less" if len(limits) > 1 else ""
    pin = " for its pin when it saturates" if loop.saturates else ""
    rooms = {loop.labels[agent]: room for agent, room in found.room.items()}
    check = Check(
        id="actuators",
        verdict=Verdict.PROVED,
        domain=Box(asked.radius, asked.disturbance),
        claim=LeftRooms(rooms=rooms),
        reason=f"{told}: {share:.4g} % are left{pin}{least}.",
    )
    return check.unless(decide.confirm(check, case), case.domain)


def _bounded(case: Case, plan: _Plan) -> Check:
    """The check of a plan whose inputs keep their limits, if it is confirmed."""
    loop = case.loop
    most = dict(zip(loop.labels, plan.inputs, strict=True))
    worst = max(most, key=lambda label: most[label])
    reason = (
        f"from these starts no component of an input exceeds {float(most[worst]):.6g} (agent "
        f"{worst})"
    )
    is_limited = loop.actuators is not None and loop.actuators.limit
    reason += "; no actuator with a limit saturates." if is_limited else "."
    error = None if plan.stage is None else plan.error
    claim = Inputs(rho=plan.rho, inputs=most, stage=plan.stage, error=error)
    domain = Box(*plan.starts)
    check = Check(id="actuators", verdict=Verdict.PROVED, domain=domain, claim=claim, reason=reason)
    return check.unless(decide.confirm(check, case), case.domain)


def _starts(asked: Asked, domain: Domain) -> tuple[float, float]:
    """The starts asked for, if a domain holds them, else its own; without a region the largest that
    are tried."""
    own = asked.radius, asked.disturbance
    if not isinstance(domain, Around):
        return own
    holds = domain.radius >= asked.radius and domain.disturbance >= asked.disturbance
    return own if asked.wanted and holds else (domain.radius, domain.disturbance)


def _level_of(
    v: Sequence[Fraction], error: ErrorBound | None, starts: tuple[float, float], level: Fraction
) -> Fraction:
    """The least rho, about, with these starts and the level in {V <= rho}."""
    radius, disturbance = map(claimed, starts)
    size = ZERO
    if error is not None:
        size = error.kappa * disturbance * root_above(error.size, unit=10**12)
    return rounded_up(max(radius / min(v), level) + size, digits=9)


def _box_of_proof(
    asked: Asked, case: Case, base: Separable, found: Sequence[Fraction]
) -> Iterator[_Plan]:
    """The box of max-separable that holds the starts; without a region a smaller one, where a limit
    asks for it."""
    loop = asked.loop
    v = tuple(base.v)
    proof = case.proof(Separable)
    starts = _starts(asked, asked.domain if proof is None else proof.domain)
    # A second box, for starts so small that limits are kept.
    for _ in range(2):
        rho = _level_of(v, base.error, starts, ZERO)
        if base.rho is not None:
            rho = min(rho, base.rho)
        parts = decide.input_parts(loop, v, base.error, claimed(starts[1]))
        plan = _Plan(
            loop=loop,
            starts=starts,
            rho=rho,
            parts=parts,
            disturbances=found,
            v=v,
            error=base.error,
        )
        yield plan
        if asked.wanted:
            return
        starts = plan.smaller_starts()


def _boxes_of_their_own(
    asked: Asked, case: Case, base: Separable | None, found: Sequence[Fraction]
) -> Iterator[_Plan]:
    """Boxes that hold the starts under all that [uncertainty] states: that of ``accuracy``, and
    those with the least weights, which want the least inputs."""
    loop = asked.loop
    error = None if base is None else base.error
    levels: list[tuple[Level, ErrorBound | None]] = []
    domain: Domain = Box(asked.radius, asked.disturbance)
    peaks = None
    proof = case.proof(Accuracy)
    final = case.proved(Accuracy)
    if proof is not None and final is not None:
        peaks = final.peaks
        error = final.error or error
        domain = proof.domain
        levels = [(stage, error) for stage in final.stages[:1]]
    elif decide.blind(loop):
        return
    exosystem = loop.joint_exosystem
    if error is None and exosystem is not None and asked.W is not None:
        error = propose_error_bound(exosystem, asked.W)
    if exosystem is not None and error is None:
        return
    starts = _starts(asked, domain) if asked.wanted else (NEAR, NEAR * bool(loop.groups))
    box = claimed(starts[0]), claimed(starts[1])
    plant = Plant(loop=loop, peaks=peaks, room=ROOM)
    for part in SLOWLY:
        for level, own in chain(levels, covering_boxes(plant, error, box, slowly=part)):
            levels = []  # those of accuracy are tried once
            plan = _plan_of(plant, level, own, starts, found)
            if plan is not None:
                yield plan


def _plan_of(
    plant: Plant,
    level: Level,
    error: ErrorBound | None,
    starts: tuple[float, float],
    found: Sequence[Fraction],
) -> _Plan | None:
    """The plan of a stage, if its rows hold in a box with these starts."""
    v = tuple(level.v)
    linear = plant.loop.is_linear
    if error is not None and (linear or error.kappa * error.beta * min(v) <= 1):
        # the least kappa, about, for these weights
        kappa = rounded_up(1 / (error.beta * min(v)) * (1 + Fraction(1, 10**5)), digits=9)
        error = replace(error, kappa=kappa)
    rho = _level_of(v, error, starts, level.level)
    if level.rho is not None:
        rho = min(rho, level.rho)
    if rho < level.level:
        return None
    stage = replace(level, rho=None if linear else rho)
    if plant.not_shrinking(stage) is not None:
        return None
    return _Plan(
        loop=plant.loop,
        starts=starts,
        rho=rho,
        parts=decide.loaded_inputs(plant, stage, error, claimed(starts[1])),
        disturbances=found,
        v=v,
        stage=stage,
        error=error,
    )


def _too_large(asked: Asked, plan: _Plan) -> str:
    """Which input may exceed its limit, and what would keep it below."""
    loop = plan.loop
    inputs = plan.inputs
    limits = plan.limits
    over: list[tuple[Fraction, str]] = []  # the rho at which an input keeps its limit
    for place, (limit, most) in enumerate(zip(limits, inputs, strict=True)):
        if limit is not None and most > limit:
            per_rho, rest = plan.parts[place]
            left = limit - rest - plan.disturbances[place]
            over.append((left / per_rho if per_rho else ZERO, loop.labels[place]))
    lower, label = min(over)
    place = loop.index[label]
    allowed = limits[place] or ZERO
    alone = plan.disturbances[place]
    per_rho, rest = plan.parts[place]
    reason = (
        f"the input of agent {label} may reach {float(inputs[place]):.6g}, more than its limit of "
        f"{float(allowed):.6g}."
    )
    if allowed <= alone:
        return f"{reason} The disturbance alone may need {float(alone):.6g}, {NO_ROOM}"
    if allowed - rest - alone <= 0:
        return (
            f"{reason} The disturbance may need {float(alone):.6g}, errors of estimates "
            f"and noise {float(rest):.6g}."
        )
    least = plan.least_rho(plan.stage.level if plan.stage else ZERO)
    if plan.stage is not None and lower < least:  # no smaller box is known to be kept
        if not stated_in(loop).absolute:
            return reason
        bound = float(per_rho * least + rest + alone)
        reason += f" From starts at the target its bound is still {bound:.6g}:"
        return f"{reason} what [uncertainty] states brings it there."
    box = (lower - plan.least_rho(ZERO)) * min(plan.v)
    if box > 0:
        when = f"from starts with |e_i| <= {_told(box)}"
        when += " and the same |eps_i|" if loop.groups else ""
    else:
        when = f"once V of the check max-separable is at most {_told(lower)}"
    reason += f" It never saturates {when}."
    gain = decide.pin_sizes(loop)[place]
    if plan.stage is None and asked.wanted and gain:
        reason += (
            " For the whole region it would need a gain of at most "
            f"{_told(gain * lower / plan.rho)} and a new proof."
        )
    return reason


def _told(x: Fraction) -> str:
    return f"{float(rounded_down(x, digits=4)):.4g}"
