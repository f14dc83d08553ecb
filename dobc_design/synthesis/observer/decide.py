"""Exact decisions about an observer gain W: the spectrum of F = A - W C, norms, envelopes, what is
impossible.

Spectrum: Routh's test and exact counts of the mapped characteristic polynomial.  For a sampled
observer exp(A T) is enclosed by Arb, and what is proved holds for every matrix of the enclosure.
The square of an H2 norm is rational, C X C' with F X + X F' + B B' = 0.  For F Hurwitz the
H-infinity norm is below gamma iff gamma^2 I - D'D > 0 and the Hamiltonian matrix has no imaginary
eigenvalue, a Sturm count in s^2 (Boyd, Balakrishnan, Kabamba 1989).

Impossible: without a bound on noise the answer is complete.  The regions (closed, convex,
symmetric) and Re s < 0 share a real point or nothing, W can put all observable eigenvalues there
(Ackermann), and the hidden ones are where they are.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from functools import partial

from dobc_design._checks import noun
from dobc_design.conditions.numbers import bisected, claimed, largest_proved
from dobc_design.conditions.observer.decide import detectability_check, error_matrix
from dobc_design.conditions.statement import Statement, proved, refuted, undecided
from dobc_design.exact import polynomial as roots
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import (
    Interval,
    exp,
    interval_characteristic_polynomial,
    interval_routh,
)
from dobc_design.exact.matrix import (
    Matrix,
    add,
    identity,
    inverse,
    is_symmetric,
    multiply,
    scale,
    solve_lyapunov,
    subtract,
    transpose,
    zeros,
)
from dobc_design.exact.number import ONE, ZERO, float_above, number_text
from dobc_design.exact.observability import decide_detectable, observable_reduction
from dobc_design.exact.polynomial import Coefficients, characteristic_polynomial
from dobc_design.exact.reading import Table, counted, one_of, shown_number
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import sampled
from dobc_design.problem.changes import value_text
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .claim import (
    CHANNELS,
    Cone,
    Disk,
    Envelope,
    HalfPlane,
    NoiseLimit,
    ObserverRequest,
    SpectralRegion,
    common_interval,
)

BISECTIONS = 40
WIDENINGS = (1e-9, 1e-7, 1e-5, 1e-3)
LARGEST_ORDER = 12  # beyond it exact norms take too long to be had by the way
LEAVE_OUT = "It does not act on the agents either: leave it out."
STAYS_OUTSIDE = "so no gain moves its eigenvalues, and they lie outside."
ONLY_ALIKE = "This is automatic only if all agents have one exosystem."


def gain_statements(
    exosystem: Exosystem, W: Matrix, request: ObserverRequest
) -> tuple[Statement, ...]:
    """Everything that the request asks of W (q, m), decided for W exactly."""
    noise = [noise_statement(exosystem, W, limit) for limit in request.noise]
    if request.period is not None:
        return *sampled_statements(exosystem, W, request), *noise
    F = error_matrix(exosystem, W)
    # Convergence is proved even where a rate or a region implies it: everything else rests on it.
    found = [hurwitz_statement(F)]
    if request.rate is not None:
        found.append(region_statement(F, request.all_regions[0], kind="rate"))
    found += [region_statement(F, region) for region in request.regions]
    return *found, *noise


def image(region: SpectralRegion, polynomial: Coefficients) -> Coefficients:
    """A polynomial that has no root with positive real part iff the roots of a monic one lie in the
    closed region."""
    if isinstance(region, Disk):
        return roots.disk_image(polynomial, centre=region.centre, radius=region.radius)
    if isinstance(region, Cone):
        return roots.cone_image(polynomial, damping=region.damping)
    if region.left_of is not None:
        return roots.shifted(polynomial, region.left_of)
    return roots.reflected(roots.shifted(polynomial, region.right_of or ZERO))


def roots_inside(polynomial: Coefficients, region: SpectralRegion) -> tuple[bool, bool]:
    """Whether every root lies in the closed region, and whether in its interior: exact."""
    degree = len(polynomial) - 1
    if isinstance(region, Cone):
        degree = 2 * degree  # so large is that of its image
    return roots.decide_images((image(region, polynomial),), degree=degree)


def region_statement(F: Matrix, region: SpectralRegion, *, kind: str = "region") -> Statement:
    """State whether the spectrum of F = A - W C lies in a closed region."""
    polynomial = characteristic_polynomial(F)
    inside, strictly = roots_inside(polynomial, region)
    text = f"every eigenvalue of A - WC lies in {region}"
    shown = {"polynomial": roots.polynomial_text(polynomial)}
    if not inside:
        return refuted(kind, f"it is false that {text}.", **shown)
    border = "and none" if strictly else "with one"
    return proved(kind, f"{text}, {border} on its border.", **shown)


def hurwitz_statement(F: Matrix) -> Statement:
    """State whether F = A - W C is Hurwitz, by Routh's first column."""
    table = roots.decide_hurwitz(F)
    column = ", ".join(number_text(x) for x in table.first_column)
    if table.is_proved:
        return proved("hurwitz", "A - WC is Hurwitz.", routh=column)
    return refuted(
        "hurwitz",
        "A - WC is not Hurwitz: the estimate does not follow the disturbance.",
        routh=column,
    )


def rate_holds(F: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of F has a real part <= -rate, the border included."""
    return roots_inside(characteristic_polynomial(F), HalfPlane(left_of=-rate))[0]


def damping_holds(F: Matrix, damping: Fraction) -> bool:
    """Whether the damping ratio of F is at least ``damping``: exact; false outside (0, 1)."""
    if not 0 < damping < 1:
        return False
    return roots_inside(characteristic_polynomial(F), Cone(damping=damping))[0]


@noun
class SampledDisk:
    """Where all eigenvalues of the sampled error are asked to lie; the radius is enclosed."""

    kind: str
    text: str
    centre: Fraction
    radius: Interval

    def decided(self, polynomial: Sequence[Interval], **shown: str) -> Statement:
        """The statement about the roots of a polynomial with enclosed coefficients."""
        text = self.text
        kind = self.kind
        # It is proved for the smallest disk that the radius may mean, refuted for the largest.
        small = roots.disk_image(polynomial, centre=self.centre, radius=self.radius.lo)
        if interval_routh(small) is Verdict.PROVED:
            return proved(kind, f"{text}.", **shown)
        large = roots.disk_image(polynomial, centre=self.centre, radius=self.radius.hi)
        if interval_routh(large) is Verdict.REFUTED:
            return refuted(kind, f"it is false that {text}.", **shown)
        return undecided(kind, f"it is not decided whether {text}.", **shown)


def sampled_statements(
    exosystem: Exosystem, W: Matrix, request: ObserverRequest
) -> tuple[Statement, ...]:
    """Schur stability of the sampled error, its rate (|z| <= exp(-rate T)) and disks; UNDECIDED
    close to a border."""
    timing = request.sampling
    period = timing.period
    own = W if request.timing else scale(1 / period, W)
    closed = sampled(exosystem, timing).error(own, period)
    polynomial = interval_characteristic_polynomial(closed)
    widest = max(x.width for x in polynomial)
    shown = {"period": number_text(period), "width": f"{float_above(widest):.1e}"}
    asked = _sampled_disks(request, period)
    return tuple(disk.decided(polynomial, **shown) for disk in asked)


def _sampled_disks(request: ObserverRequest, period: Fraction) -> Iterator[SampledDisk]:
    """The unit disk, that of the rate, and the disks asked for."""
    rate = request.rate
    text = "the sampled error converges: every eigenvalue lies inside the unit disk"
    yield SampledDisk(kind="sampled", text=text, centre=ZERO, radius=Interval.point(1))
    if rate is not None:
        radius = exp(Interval.point(-rate * period))
        text = f"the sampled error decays at the rate {shown_number(rate)} 1/s or faster"
        yield SampledDisk(kind="rate", text=text, centre=ZERO, radius=radius)
    for region in request.regions:
        if isinstance(region, Disk):
            radius = Interval.point(region.radius)
            text = f"every eigenvalue of the sampled error lies in {region.in_letter('z')}"
            yield SampledDisk(kind="region", text=text, centre=region.centre, radius=radius)


@noun
class StateSpace:
    """Exact C (sI - F)^-1 B + D: F (q, q), B (q, u), C (y, q), D (y, u)."""

    F: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def channel(exosystem: Exosystem, W: Matrix, name: str) -> StateSpace:
    """The transfer function of one channel, exactly.  Raises: SpecError for a name that is none of
    CHANNELS."""
    one_of(name, CHANNELS, "channel")
    F = error_matrix(exosystem, W)
    C = exosystem.C
    if name == "measurement":
        return StateSpace(F=F, B=W, C=multiply(C, F), D=multiply(C, W))
    B = W if name == "disturbance" else identity(exosystem.order)
    return StateSpace(F=F, B=B, C=C, D=zeros(len(C), len(B[0])))


def h2_squared(system: StateSpace) -> Fraction | None:
    """The square of the H2 norm, exactly; None if it is infinite (F not Hurwitz or D not 0)."""
    passes_at_once = any(x for row in system.D for x in row)
    if passes_at_once or not roots.decide_hurwitz(system.F).is_proved:
        return None
    X = solve_lyapunov(transpose(system.F), multiply(system.B, transpose(system.B)))
    if X is None:  # cannot be for a Hurwitz F
        return None
    variance = multiply(multiply(system.C, X), transpose(system.C))
    return sum((row[i] for i, row in enumerate(variance)), ZERO)


def hinf_below(system: StateSpace, gamma: Fraction) -> bool:
    """Whether F is Hurwitz and the H-infinity norm is < gamma: exact both ways."""
    if gamma <= 0 or not roots.decide_hurwitz(system.F).is_proved:
        return False
    F, B, C, D = system.F, system.B, system.C, system.D
    # The norm is not below the gain at infinite frequency, the norm of D.
    room = subtract(scale(gamma * gamma, identity(len(B[0]))), multiply(transpose(D), D))
    if not decide_positive_definite(room).is_proved:
        return False
    R = inverse(room)
    BR = multiply(B, R)
    closed = add(F, multiply(BR, multiply(transpose(D), C)))
    inner = add(identity(len(C)), multiply(multiply(D, R), transpose(D)))
    upper = multiply(BR, transpose(B))
    lower = scale(-1, multiply(multiply(transpose(C), inner), C))
    hamiltonian = []
    for left, right in ((closed, upper), (lower, scale(-1, transpose(closed)))):
        hamiltonian += [p + s for p, s in zip(left, right, strict=True)]
    # Eigenvalues come in pairs s, -s, so that it is a polynomial in s^2.
    in_squares = characteristic_polynomial(tuple(hamiltonian))[::2]
    return not roots.has_root_up_to_zero(in_squares)


def root_above(square: Fraction) -> float:
    """A float that is not below the root of a rational >= 0."""
    if not square:
        return 0.0
    # A float's root is rounded to the nearest; a few steps up make it a bound.
    root = math.sqrt(float_above(square))
    while math.isfinite(root) and Fraction(root) ** 2 < square:
        root = math.nextafter(root, math.inf)
    return root


def noise_statement(exosystem: Exosystem, W: Matrix, limit: NoiseLimit) -> Statement:
    """State whether a norm keeps its limit (H-infinity: stays below it)."""
    system = channel(exosystem, W, limit.channel)
    exact = {}
    if limit.norm == "h2":
        square = h2_squared(system)
        holds = square is not None and square <= limit.bound**2
        exact["h2_squared"] = "infinite" if square is None else number_text(square)
    else:
        holds = hinf_below(system, limit.bound)
    if holds:
        return proved("noise", f"{limit}.", **exact)
    return refuted("noise", f"it is false that the {limit}.", **exact)


def size_above(W: Matrix) -> float:
    """|W|, rounded up: the root of the sum of the squares of its entries."""
    return root_above(sum((x * x for row in W for x in row), ZERO))


def envelope_statement(exosystem: Exosystem, W: Matrix, envelope: Envelope) -> Statement | None:
    """|eps(t)| <= root(upper / lower) exp(-rate t) |eps(0)|, if F'P + P F + 2 rate P <= 0 and the
    bounds of P hold."""
    P = envelope.P
    rate = envelope.rate
    lower = envelope.lower
    upper = envelope.upper
    if lower <= 0 or not is_symmetric(P):
        return None
    unit = identity(exosystem.order)
    product = multiply(P, error_matrix(exosystem, W))
    decay = scale(-1, add(add(product, transpose(product)), scale(2 * rate, P)))
    above = subtract(P, scale(lower, unit))
    below = subtract(scale(upper, unit), P)
    for part in (above, below, decay):
        if not decide_positive_semidefinite(part).is_proved:
            return None
    stretch = root_above(upper / lower)
    return proved(
        "lyapunov",
        f"P proves |eps(t)| <= {stretch:.4g} exp(-{float(rate):.4g} t) |eps(0)|.",
        rate=number_text(rate),
        lower=number_text(lower),
        upper=number_text(upper),
    )


def proved_measures(
    exosystem: Exosystem, W: Matrix, estimates: Mapping[str, float], *, norms: bool
) -> dict[str, float]:
    """Gain, rate (1/s), damping and the ``norms`` of three channels, "hinf measurement" and so on,
    for W (q, m)."""
    F = error_matrix(exosystem, W)
    result = {"gain": size_above(W)}
    rate = _proved_near(estimates.get("rate", 0.0), partial(rate_holds, F))
    if rate:
        result["rate"] = rate
    damping = _proved_near(estimates.get("damping", 0.0), partial(damping_holds, F))
    if damping:
        result["damping"] = damping
    if "peak" in estimates:
        result["peak_seen"] = estimates["peak"]
    if not norms or exosystem.order > LARGEST_ORDER:
        return result
    for name in CHANNELS:
        system = channel(exosystem, W, name)
        square = h2_squared(system)
        result[f"h2 {name}"] = math.inf if square is None else root_above(square)
        # The estimate itself may be the norm, and the norm has to stay below the bound.
        for widening in WIDENINGS:
            bound = estimates.get(f"hinf {name}", math.inf) * (1 + widening)
            if 0 < bound < math.inf and hinf_below(system, claimed(bound)):
                result[f"hinf {name}"] = bound
                break
    return result


def _proved_near(estimate: float, holds: Callable[[Fraction], bool]) -> float | None:
    """A number that is proved to hold: the estimate to nine digits, else less; None or 0 without
    one."""
    found = float(f"{estimate:.9g}")
    # The border is included, so that a number that is hit exactly stands.
    if found and math.isfinite(found) and holds(claimed(found)):
        return found
    return largest_proved(estimate, lambda x: x == 0 or holds(x))


def why_impossible(exosystem: Exosystem, request: ObserverRequest) -> Statement | None:
    """A proof that no W meets a request, or None; its kind says what fails: detectable, rate,
    region or noise."""
    if request.timing is not None and request.timing.steps:
        return None
    found = decide_detectable(exosystem.A, exosystem.C)
    hidden = found.unobservable_text
    if not found.is_proved:
        never = f"its part {hidden} does not appear in d and does not decay."
        return refuted(
            "detectable",
            f"no W exists: (A, C) is not detectable; {never} {LEAVE_OUT}",
            polynomial=hidden,
        )
    if request.period is not None:
        return None
    regions = request.all_regions
    # A polynomial of degree 0 has no hidden eigenvalues.
    if len(found.unobservable_polynomial) > 1:
        for position, region in enumerate(regions):
            if not roots_inside(found.unobservable_polynomial, region)[0]:
                unseen = f"C does not see the part {hidden} of the exosystem"
                # The first half plane is that of the rate.
                kind = "region" if position else "rate"
                return refuted(
                    kind, f"no W meets {region}: {unseen}, {STAYS_OUTSIDE}", polynomial=hidden
                )
    common = common_interval(regions)
    if common is None or (common[0] is not None and common[0] >= 0):
        names = " and ".join(str(region) for region in regions)
        return refuted("region", f"no W exists: no point with Re s < 0 lies in {names}.")
    return _too_quiet(exosystem, request, -(common[1] or ZERO))


@noun
class Reduction:
    """What becomes of an exosystem that C does not see whole: ``changes`` of the problem that leave
    its observable part, and the ``words`` for them; or why there is no W at all."""

    changes: Table = field(default_factory=dict)
    words: str | None = None
    obstacle: Statement | None = None


def reduced_exosystem(problem: Problem, *, reduce: bool) -> Reduction:
    """The observable part of an undetectable exosystem; or why there is no W at all."""
    if problem.is_grouped:
        return Reduction(obstacle=next(_undetectable_groups(problem, reduce=reduce), None))
    # What outputs do not show may be a state, which no other exosystem cures.
    if problem.exosystem is None or problem.outputs is not None:
        return Reduction()
    check = detectability_check(problem.exosystem, loop_of(problem))
    if check.is_proved:
        return Reduction()
    # What C never sees does not act on the agents, so that it may be left out.
    if check.fix is not None and reduce:
        return Reduction(changes=check.fix.set, words=check.fix.text)
    exact = {name: str(value) for name, value in (check.exact or {}).items()}
    text = f"no W exists: {_inside_a_sentence(check.reason)}"
    return Reduction(obstacle=refuted("detectable", text, **exact))


def _inside_a_sentence(text: str) -> str:
    return f"{text[0].lower()}{text[1:]}"


def _undetectable_groups(problem: Problem, *, reduce: bool) -> Iterator[Statement]:
    for group in problem.groups:
        check = detectability_check(group.exosystem)
        if check.is_proved:
            continue
        why = _inside_a_sentence(check.reason)
        text = f"no W exists for the group of agent {group.name}: {why}"
        if not reduce or check.fix is None:
            yield refuted("detectable", text)
            continue
        # The reduction of one group is advice; it is not made here.
        kept = []
        for key, value in check.fix.set.items():
            if value:
                kept.append(f"{key.rpartition('.')[2]} = {value_text(value)}")
        part = f"its observable part ({'; '.join(kept)})" if kept else "its observable part"
        cure = f"Replace it by {part}, and design again. {ONLY_ALIKE}"
        yield undecided("detectable", f"{text} {cure}")


def largest_hidden_rate(polynomial: Coefficients) -> Fraction | None:
    """A rate (1/s) that the hidden eigenvalues reach, proved, close to the largest; None if there
    is none."""
    if len(polynomial) < 2 or not roots.routh(polynomial).is_proved:
        return None

    def reached(rate: Fraction) -> bool:
        return roots.count_right_half_plane(roots.shifted(polynomial, -rate)) == 0

    most = 1 + sum((abs(x) for x in polynomial), ZERO)  # Cauchy's bound
    low, high = bisected(reached, ZERO, most, steps=BISECTIONS)
    # A short number that the bisection closes in on is shown rather than its lower end.
    short = high.limit_denominator(1000)
    if short >= low > 0 and reached(short):
        return short
    return low or None


def _too_quiet(exosystem: Exosystem, request: ObserverRequest, rate: Fraction) -> Statement | None:
    """At an eigenvalue s of A with C v != 0 the estimate follows exactly: C (sI - F)^-1 W C v = C
    v.  So for Re s >= 0 (maximum principle) no W has a disturbance channel of norm below 1, or a
    measurement channel below |s|.  At high frequencies the latter is C W (m, m), and trace(C W) =
    trace(A) - trace(F) >= trace(A) + q rate (1/s)."""
    A = observable_reduction(exosystem.A, exosystem.C)[0]
    total = sum((row[i] for i, row in enumerate(A)), len(A) * rate)
    least = total / len(exosystem.C)  # |C W| >= |trace(C W)| / m
    for limit in request.noise:
        if (limit.norm, limit.channel) == ("hinf", "measurement") and limit.bound <= least:
            must = f"at least {shown_number(least)} 1/s at high frequencies (|C W|)"
            many = counted(len(A), "eigenvalue")
            why = f"with {many} of A - W C at Re s <= {shown_number(-rate)}"
            cure = " Lower observer.rate." if rate else ""
            return refuted("noise", f"no W makes the {limit}: {why} it is {must}.{cure}")
    polynomial = characteristic_polynomial(A) if A else (ONE,)
    if len(polynomial) < 2 or roots.routh(polynomial).is_proved:
        return None
    for limit in request.noise:
        because = _follows_exactly(polynomial, limit)
        if because is not None:
            follows = f"an estimate that converges follows the exosystem's {because}."
            return refuted("noise", f"no W makes the {limit}: {follows}")
    return None


def _follows_exactly(polynomial: Coefficients, limit: NoiseLimit) -> str | None:
    """What every estimate that converges follows, and the limit does not allow; None without such.
    ``polynomial``: of the observable part of A."""
    if limit.norm != "hinf":
        return None
    if limit.channel == "disturbance" and limit.bound <= 1:
        return "own disturbances exactly, which takes the gain 1"
    if limit.channel != "measurement":
        return None
    # If none decays, all eigenvalues count, and one of them is not inside the open disk of the
    # bound.
    none_decays = roots.count_right_half_plane(roots.reflected(polynomial)) == 0
    disk = Disk(centre=0, radius=limit.bound)
    if none_decays and not roots_inside(polynomial, disk)[1]:
        return "fastest frequency exactly, which takes at least that gain"
    return None
