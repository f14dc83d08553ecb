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

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dobc_design.conditions.numbers import bisected, claimed, largest_proved
from dobc_design.conditions.observer.decide import detectability_check, error_matrix
from dobc_design.conditions.statement import Statement, proved, refuted, undecided
from dobc_design.errors import SpecError
from dobc_design.exact import interval as exponential
from dobc_design.exact import polynomial as roots
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import Interval, exp
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
from dobc_design.exact.number import float_above, number_text
from dobc_design.exact.observability import decide_detectable, observable_reduction
from dobc_design.exact.polynomial import Coefficients, characteristic_polynomial
from dobc_design.exact.reading import shown_number
from dobc_design.problem.changes import value_text
from dobc_design.problem.exosystems import Exosystem
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer import claim
from dobc_design.verdict import Verdict

BISECTIONS = 40
WIDENINGS = (1e-9, 1e-7, 1e-5, 1e-3)
LARGEST_ORDER = 12  # beyond it exact norms take too long to be had by the way


def gain_statements(
    exosystem: Exosystem, W: Matrix, request: claim.ObserverRequest
) -> tuple[Statement, ...]:
    """Everything that the request asks of W (q, m), decided for W exactly."""
    noise = [noise_statement(exosystem, W, limit) for limit in request.noise]
    if request.period is not None:
        asked = sampled_statements(
            exosystem, W, period=request.period, rate=request.rate, regions=request.regions
        )
        return *asked, *noise
    F = error_matrix(exosystem, W)
    rate = (
        [] if request.rate is None else [region_statement(F, request.all_regions[0], kind="rate")]
    )
    regions = [region_statement(F, region) for region in request.regions]
    return hurwitz_statement(F), *rate, *regions, *noise


def image(region: claim.SpectralRegion, polynomial: Coefficients) -> Coefficients:
    """A polynomial that has no root with positive real part iff the roots of a monic one lie in the
    closed region."""
    if isinstance(region, claim.Disk):
        return roots.disk_image(polynomial, centre=region.centre, radius=region.radius)
    if isinstance(region, claim.Cone):
        return roots.cone_image(polynomial, damping=region.damping)
    if region.left_of is not None:
        return roots.shifted(polynomial, region.left_of)
    return roots.reflected(roots.shifted(polynomial, region.right_of or Fraction(0)))


def roots_inside(polynomial: Coefficients, region: claim.SpectralRegion) -> tuple[bool, bool]:
    """Whether every root lies in the closed region, and whether in its interior: exact."""
    degree = (len(polynomial) - 1) * (2 if isinstance(region, claim.Cone) else 1)
    return roots.decide_images((image(region, polynomial),), degree=degree)


def region_statement(F: Matrix, region: claim.SpectralRegion, *, kind: str = "region") -> Statement:
    """State whether the spectrum of F = A - W C lies in a closed region."""
    polynomial = characteristic_polynomial(F)
    inside, strictly = roots_inside(polynomial, region)
    text = f"every eigenvalue of A - WC lies in {region}"
    shown = {"polynomial": roots.polynomial_text(polynomial)}
    if not inside:
        return refuted(kind, f"it is false that {text}.", **shown)
    return proved(kind, f"{text}, {'and none' if strictly else 'with one'} on its border.", **shown)


def hurwitz_statement(F: Matrix) -> Statement:
    """State whether F = A - W C is Hurwitz, by Routh's first column."""
    table = roots.decide_hurwitz(F)
    column = ", ".join(number_text(x) for x in table.first_column)
    if table.verdict is Verdict.PROVED:
        return proved("hurwitz", "A - WC is Hurwitz.", routh=column)
    return refuted(
        "hurwitz",
        "A - WC is not Hurwitz: the estimate does not follow the disturbance.",
        routh=column,
    )


def rate_holds(F: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of F has a real part <= -rate, the border included."""
    return (
        roots.count_right_half_plane(
            image(claim.HalfPlane(left_of=-rate), characteristic_polynomial(F))
        )
        == 0
    )


def damping_holds(F: Matrix, damping: Fraction) -> bool:
    """Whether the damping ratio of F is at least ``damping``: exact; false outside (0, 1)."""
    cone = claim.Cone(damping=damping) if 0 < damping < 1 else None
    return (
        cone is not None
        and roots.count_right_half_plane(image(cone, characteristic_polynomial(F))) == 0
    )


def sampled_matrix(exosystem: Exosystem, W: Matrix, period: Fraction) -> exponential.IntervalMatrix:
    """Enclose Ad - W Cd, Ad = exp(A T), Cd = C (1/T) int_0^T exp(A s) ds, of the observer of means
    over T."""
    found = exponential.discretise(exosystem.A, period)
    q = exosystem.order
    zero = Interval.point(0)
    Cd = [
        [sum((found.mean[r][j] * c for r, c in enumerate(row) if c), zero) for j in range(q)]
        for row in exosystem.C
    ]
    gains = [[(c, w) for c, w in enumerate(row) if w] for row in W]
    table = enumerate(found.transition)
    return tuple(
        tuple(row[j] - sum((Cd[c][j] * w for c, w in gains[i]), zero) for j in range(q))
        for i, row in table
    )


def sampled_statements(
    exosystem: Exosystem,
    W: Matrix,
    *,
    period: Fraction,
    rate: Fraction | None,
    regions: Sequence[claim.SpectralRegion],
) -> tuple[Statement, ...]:
    """Schur stability of the sampled error, its rate (|z| <= exp(-rate T)) and disks; UNDECIDED
    close to a border."""
    polynomial = exponential.interval_characteristic_polynomial(
        sampled_matrix(exosystem, W, period)
    )
    text = "the sampled error converges: every eigenvalue lies inside the unit disk"
    asked = [("sampled", text, Fraction(0), Interval.point(1))]
    if rate is not None:
        text = f"the sampled error decays at the rate {shown_number(rate)} 1/s or faster"
        asked.append(("rate", text, Fraction(0), exp(Interval.point(-rate * period))))
    for region in regions:
        if isinstance(region, claim.Disk):
            text = f"every eigenvalue of the sampled error lies in {region}".replace("|s", "|z")
            asked.append(("region", text, region.centre, Interval.point(region.radius)))
    shown = {
        "period": number_text(period),
        "width": f"{float_above(max(x.width for x in polynomial)):.1e}",
    }

    # the radius is enclosed as well
    def state(kind: str, text: str, centre: Fraction, radius: Interval) -> Statement:
        if (
            exponential.interval_routh(
                roots.disk_image(polynomial, centre=centre, radius=radius.lo)
            )
            is Verdict.PROVED
        ):
            return proved(kind, f"{text}.", **shown)
        if (
            exponential.interval_routh(
                roots.disk_image(polynomial, centre=centre, radius=radius.hi)
            )
            is Verdict.REFUTED
        ):
            return refuted(kind, f"it is false that {text}.", **shown)
        return undecided(kind, f"it is not decided whether {text}.", **shown)

    return tuple(state(*each) for each in asked)


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSpace:
    """Exact C (sI - F)^-1 B + D: F (q, q), B (q, u), C (y, q), D (y, u)."""

    F: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def channel(exosystem: Exosystem, W: Matrix, name: str) -> StateSpace:
    """The transfer function of one channel, exactly.  Raises: SpecError for a name that is none of
    CHANNELS."""
    if name not in claim.CHANNELS:
        raise SpecError(
            f"channel must be one of {', '.join(claim.CHANNELS)}; got {name!r}.", key="channel"
        )
    F, C = error_matrix(exosystem, W), exosystem.C
    if name == "measurement":
        return StateSpace(F=F, B=W, C=multiply(C, F), D=multiply(C, W))
    B = W if name == "disturbance" else identity(exosystem.order)
    return StateSpace(F=F, B=B, C=C, D=zeros(len(C), len(B[0])))


def h2_squared(system: StateSpace) -> Fraction | None:
    """The square of the H2 norm, exactly; None if it is infinite (F not Hurwitz or D not 0)."""
    if (
        any(x for row in system.D for x in row)
        or roots.decide_hurwitz(system.F).verdict is not Verdict.PROVED
    ):
        return None
    X = solve_lyapunov(transpose(system.F), multiply(system.B, transpose(system.B)))
    if X is None:  # cannot be for a Hurwitz F
        return None
    return sum(
        (row[i] for i, row in enumerate(multiply(multiply(system.C, X), transpose(system.C)))),
        Fraction(0),
    )


def hinf_below(system: StateSpace, gamma: Fraction) -> bool:
    """Whether F is Hurwitz and the H-infinity norm is < gamma: exact both ways."""
    if gamma <= 0 or roots.decide_hurwitz(system.F).verdict is not Verdict.PROVED:
        return False
    F, B, C, D = system.F, system.B, system.C, system.D
    room = subtract(scale(gamma * gamma, identity(len(B[0]))), multiply(transpose(D), D))
    if decide_positive_definite(room).verdict is not Verdict.PROVED:
        return False
    R = inverse(room)
    closed = add(F, multiply(multiply(B, R), multiply(transpose(D), C)))
    inner = add(identity(len(C)), multiply(multiply(D, R), transpose(D)))
    upper = multiply(multiply(B, R), transpose(B))
    lower = scale(-1, multiply(multiply(transpose(C), inner), C))
    halves = ((closed, upper), (lower, scale(-1, transpose(closed))))
    hamiltonian = tuple(p + s for left, right in halves for p, s in zip(left, right, strict=True))
    # a polynomial in s^2
    return not roots.has_root_up_to_zero(characteristic_polynomial(hamiltonian)[::2])


def root_above(square: Fraction) -> float:
    """A float that is not below the root of a rational >= 0."""
    if not square:
        return 0.0
    root = math.sqrt(float_above(square))
    while math.isfinite(root) and Fraction(root) ** 2 < square:
        root = math.nextafter(root, math.inf)
    return root


def noise_statement(exosystem: Exosystem, W: Matrix, limit: claim.NoiseLimit) -> Statement:
    """State whether a norm keeps its limit (H-infinity: stays below it)."""
    system, exact = channel(exosystem, W, limit.channel), dict[str, str]()
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
    return root_above(sum((x * x for row in W for x in row), Fraction(0)))


def envelope_statement(
    exosystem: Exosystem, W: Matrix, envelope: claim.Envelope
) -> Statement | None:
    """|eps(t)| <= root(upper / lower) exp(-rate t) |eps(0)|, if F'P + P F + 2 rate P <= 0 and the
    bounds of P hold."""
    P, F, q = envelope.P, error_matrix(exosystem, W), exosystem.order
    if envelope.lower <= 0 or not is_symmetric(P):
        return None
    product = multiply(P, F)
    decay = scale(-1, add(add(product, transpose(product)), scale(2 * envelope.rate, P)))
    parts = (
        subtract(P, scale(envelope.lower, identity(q))),
        subtract(scale(envelope.upper, identity(q)), P),
        decay,
    )
    if any(decide_positive_semidefinite(part).verdict is not Verdict.PROVED for part in parts):
        return None
    stretch = root_above(envelope.upper / envelope.lower)
    values = {"rate": envelope.rate, "lower": envelope.lower, "upper": envelope.upper}
    text = f"P proves |eps(t)| <= {stretch:.4g} exp(-{float(envelope.rate):.4g} t) |eps(0)|."
    return proved("lyapunov", text, **{name: number_text(value) for name, value in values.items()})


def proved_measures(
    exosystem: Exosystem, W: Matrix, estimates: Mapping[str, float], *, norms: bool
) -> dict[str, float]:
    """Gain, rate (1/s), damping and the ``norms`` of three channels, "hinf measurement" and so on,
    for W (q, m)."""
    F = error_matrix(exosystem, W)
    result = {"gain": size_above(W)}
    for name, holds in (("rate", rate_holds), ("damping", damping_holds)):
        estimate = estimates.get(name, 0.0)
        found: float | None = float(f"{estimate:.9g}")
        # the border is included; else less
        if not (found and math.isfinite(found) and holds(F, claimed(found))):
            found = largest_proved(estimate, lambda x, holds=holds: x == 0 or holds(F, x))  # type: ignore[misc]
        if found:
            result[name] = found
    if "peak" in estimates:
        result["peak_seen"] = estimates["peak"]
    for name in claim.CHANNELS if norms and exosystem.order <= LARGEST_ORDER else ():
        system = channel(exosystem, W, name)
        square = h2_squared(system)
        result[f"h2 {name}"] = math.inf if square is None else root_above(square)
        bounds = (
            estimates.get(f"hinf {name}", math.inf) * (1 + widening) for widening in WIDENINGS
        )
        found = next(
            (x for x in bounds if 0 < x < math.inf and hinf_below(system, claimed(x))), None
        )
        if found is not None:
            result[f"hinf {name}"] = found
    return result


def why_impossible(exosystem: Exosystem, request: claim.ObserverRequest) -> Statement | None:
    """A proof that no W meets a request, or None; its kind says what fails: detectable, rate,
    region or noise."""
    found = decide_detectable(exosystem.A, exosystem.C)
    hidden, regions = found.unobservable_text, request.all_regions
    if found.verdict is not Verdict.PROVED:
        text = (
            f"no W exists: (A, C) is not detectable; the part {hidden} never reaches d = C xi "
            "and does not decay."
        )
        text += " It does not act on the agents either: leave it out."
        return refuted("detectable", text, polynomial=hidden)
    if request.period is not None:
        return None
    for position, region in enumerate(regions if len(found.unobservable_polynomial) > 1 else ()):
        if not roots_inside(found.unobservable_polynomial, region)[0]:
            text = (
                f"no W meets {region}: C does not see the part {hidden} of the exosystem, so "
                "no gain moves its"
            )
            text += " eigenvalues, and they lie outside."
            return refuted("region" if position else "rate", text, polynomial=hidden)
    common = claim.common_interval(regions)
    if common is None or (common[0] is not None and common[0] >= 0):
        names = " and ".join(str(region) for region in regions)
        return refuted("region", f"no W exists: no point with Re s < 0 lies in {names}.")
    return _too_quiet(exosystem, request)


def reduced_exosystem(
    problem: Problem, *, reduce: bool
) -> tuple[Mapping[str, Any], tuple[str, ...], Statement | None]:
    """The observable part of an undetectable exosystem as changes, with a sentence; or why there is
    no W at all."""
    if problem.is_grouped:
        return {}, (), next(_undetectable_groups(problem, reduce=reduce), None)
    check = None if problem.exosystem is None else detectability_check(problem.exosystem, problem)
    if check is None or check.verdict is Verdict.PROVED:
        return {}, (), None
    if check.fix is None or not reduce:
        exact = (
            {} if check.exact is None else {name: str(value) for name, value in check.exact.items()}
        )
        text = check.reason[0].lower() + check.reason[1:]
        return {}, (), refuted("detectable", f"no W exists: {text}", **exact)
    return check.fix.set, (f"Exosystem: {check.fix.text}",), None


def _undetectable_groups(problem: Problem, *, reduce: bool) -> Iterator[Statement]:
    for group in problem.groups:
        check = detectability_check(group.exosystem)
        if check.verdict is Verdict.PROVED:
            continue
        text = (
            f"no W exists for the group of agent {group.name}: "
            f"{check.reason[0].lower() + check.reason[1:]}"
        )
        if not reduce or check.fix is None:
            yield refuted("detectable", text)
            continue
        kept = [
            (key.rpartition(".")[2], value_text(value))
            for key, value in check.fix.set.items()
            if value
        ]
        rest = f" ({'; '.join(f'{name} = {value}' for name, value in kept)})" if kept else ""
        cure = (
            f"Replace it by its observable part{rest}, and design again. This is automatic "
            "only if all"
        )
        yield undecided("detectable", f"{text} {cure} agents have one exosystem.")


def largest_hidden_rate(polynomial: Coefficients) -> Fraction | None:
    """A rate (1/s) that the hidden eigenvalues reach, proved, close to the largest; None if there
    is none."""
    if len(polynomial) < 2 or roots.routh(polynomial).verdict is not Verdict.PROVED:
        return None

    def reached(rate: Fraction) -> bool:
        return roots.count_right_half_plane(roots.shifted(polynomial, -rate)) == 0

    most = 1 + sum((abs(x) for x in polynomial), Fraction(0))  # Cauchy's bound
    low, high = bisected(reached, Fraction(0), most, steps=BISECTIONS)
    short = high.limit_denominator(1000)
    return short if short >= low > 0 and reached(short) else low or None


def _too_quiet(exosystem: Exosystem, request: claim.ObserverRequest) -> Statement | None:
    """At an eigenvalue s of A with C v != 0 the estimate follows exactly: C (sI - F)^-1 W C v = C
    v.  So for Re s >= 0 (maximum principle) no W has a disturbance channel of norm below 1, or a
    measurement channel below |s|."""
    A = observable_reduction(exosystem.A, exosystem.C)[0]
    polynomial = characteristic_polynomial(A) if A else (Fraction(1),)
    if len(polynomial) < 2 or roots.routh(polynomial).verdict is Verdict.PROVED:
        return None
    # If none decays, all eigenvalues count, and one of them is not inside the open disk of the
    # bound.
    none_decays = roots.count_right_half_plane(roots.reflected(polynomial)) == 0
    for limit in (each for each in request.noise if each.norm == "hinf"):
        because, disk = "", claim.Disk(centre=0, radius=limit.bound)
        if limit.channel == "disturbance" and limit.bound <= 1:
            because = "own disturbances exactly, which takes the gain 1"
        elif (
            limit.channel == "measurement" and none_decays and not roots_inside(polynomial, disk)[1]
        ):
            because = "fastest frequency exactly, which takes at least that gain"
        if because:
            text = (
                f"no W makes the {limit}: an estimate that converges follows the exosystem's "
                f"{because}."
            )
            return refuted("noise", text)
    return None
