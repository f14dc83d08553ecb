"""Candidates for an observer gain W, rounded to digits, in the order in which they are to be tried.

"lmi": the smallest |W| for the regions, begun from the answer of the inequalities and polished; then, with bounds on
norms or peak, the inequalities' own answers and Kalman gains from fast to slow; at last exact pole placement.
"kalman" and "place": the textbook methods.  Nothing here is believed: ``verify`` decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import exp, isfinite
from typing import Any

import numpy as np
from scipy import linalg

from dobc_design.conditions.observer.propose import natural_units, placed_gains
from dobc_design.errors import SpecError
from dobc_design.exact.matrix import Matrix, scale, to_float
from dobc_design.exact.observability import decide_observable, observable_reduction
from dobc_design.problem.exosystem import Exosystem
from dobc_design.solvers.program import Array, Solution
from dobc_design.solvers.rounding import round_matrix
from dobc_design.synthesis.observer.gain_optimum import Optimum, smallest_gain
from dobc_design.synthesis.observer.lmi import solve_lmi
from dobc_design.synthesis.observer.methods import RATIOS, kalman_gain, kalman_gains, placed_candidates
from dobc_design.synthesis.observer.noise_search import excess, quiet_gain
from dobc_design.synthesis.observer.request import ObserverRequest
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, HalfPlane, SpectralRegion, common_interval
from dobc_design.verdict import Verdict

# How far inside the regions a candidate is designed, so that rounding does not lead out.
SLACKS = (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3)
MORE_DIGITS = (6, 9, 12, 15)
BISECTIONS = 40
STURDY = 0.03  # slack from which on candidates are sorted by their size
DOUBT = 0.02  # eigenvalues that meet are not known better than this in floats
STEPS = 6  # halvings of the default rate
RANDOM_STARTS = 6  # at order 6 or below; fewer above, because they cost more


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant:
    """The observable part of (A, C) in floats, T its orthonormal rows, and the regions: W = T' W_o."""

    A: Array
    C: Array
    T: Array
    regions: tuple[SpectralRegion, ...]
    sampled: bool


def propose_gains(exosystem: Exosystem, request: ObserverRequest) -> Iterator[tuple[Matrix, str]]:
    """Rational W (q, m) and how each came about, for a request that has a rate or leaves it open.

    Never raises for numbers that floats cannot hold: then only the exact placement is left.
    """
    try:
        plant = make_plant(exosystem, request)
        yield from _from_floats(exosystem, plant, request)
    except (SpecError, linalg.LinAlgError, ValueError, ArithmeticError):
        pass
    if request.period is None:
        for W in _placed(exosystem, _inner_point(request)):
            yield W, "exact pole placement"


def make_plant(exosystem: Exosystem, request: ObserverRequest) -> Plant:
    """The pair in floats, sampled if there is a period.  Raises: SpecError if a number is beyond the floats."""
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    regions = request.all_regions
    if request.period is not None:
        period = float(request.period)
        q = len(A)
        block = linalg.expm(np.block([[A, np.eye(q)], [np.zeros((q, 2 * q))]]) * period)  # Van Loan 1978
        rate = float(request.rate if request.rate is not None else _default_of(A, C))
        A, C = block[:q, :q], C @ block[:q, q:] / period
        radius = Fraction(exp(-rate * period))
        regions = (Disk(centre=0, radius=radius.limit_denominator(10**15)), *request.regions)
    T = np.eye(len(A))
    if decide_observable(exosystem.A, exosystem.C).verdict is not Verdict.PROVED:
        rows = observable_reduction(exosystem.A, exosystem.C)[2]
        T = linalg.qr(to_float(rows).T, mode="economic")[0].T if rows else np.zeros((0, len(A)))
    return Plant(A=T @ A @ T.T, C=C @ T.T, T=T, regions=regions, sampled=request.period is not None)


def optimal_gain(
    plant: Plant, *, regions: Sequence[SpectralRegion] | None = None, near: Array | None = None
) -> Optimum | None:
    """The W of least |W| for the regions, of the observable part; ``near`` is a gain to begin from, alone."""
    regions = plant.regions if regions is None else tuple(regions)
    if near is not None:
        found = smallest_gain(plant.A, plant.C, regions, starts=[near], random=0)
        if found is not None:
            return found
    start = _unpolished(plant, regions)
    starts = [] if start is None else [start]
    random = RANDOM_STARTS if len(plant.A) <= 6 else 2
    return smallest_gain(plant.A, plant.C, regions, starts=starts, random=random)


def _unpolished(plant: Plant, regions: Sequence[SpectralRegion]) -> Array | None:
    """W from the inequalities for the regions, as the solver has it."""
    time = max(1e-12, float(np.max(np.abs(np.linalg.eigvals(plant.A)), initial=0.0)))
    return _gain_of(solve_lmi(plant.A, plant.C, regions, time=time), time=time)


def fastest_gain(plant: Plant, *, limit: float) -> tuple[float, Optimum] | None:
    """The largest rate (1/s) that |W| <= limit allows, by bisection on the smallest gain, and its W.

    In continuous time; the least gain grows with the rate.  None if not even convergence is cheap enough.
    """
    low = 0.0
    found = optimal_gain(plant)
    if found is None or found.size > limit:
        return None
    best = (low, found)
    trace = float(np.linalg.norm(plant.C)) * limit - float(np.trace(plant.A))
    high = max(trace / len(plant.A), 1e-12)  # tr(A - WC) = -q rate at most
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        regions = (HalfPlane(left_of=-middle), *plant.regions)
        found = optimal_gain(plant, regions=regions, near=best[1].W)
        if found is not None and found.size <= limit:
            low, best = middle, (middle, found)
        else:
            high = middle
        if high - low <= 1e-7 * high:
            break
    return best


def contracted(regions: Sequence[SpectralRegion], slack: float) -> tuple[SpectralRegion, ...]:
    """The regions a little smaller, relative to their own numbers; the same for slack 0."""
    if not slack:
        return tuple(regions)
    ends = [abs(x) for region in regions for x in region.real_ends if x is not None]
    step = max(ends, default=Fraction(1)) * Fraction(slack)
    result: list[SpectralRegion] = []
    for region in regions:
        if isinstance(region, Disk):
            result.append(Disk(centre=region.centre, radius=_short(region.radius * (1 - Fraction(slack)))))
        elif isinstance(region, Cone):
            result.append(Cone(damping=_short(region.damping + (1 - region.damping) * Fraction(slack))))
        elif region.left_of is not None:
            result.append(HalfPlane(left_of=_short(region.left_of - (step if region.left_of else 0))))
        else:
            result.append(HalfPlane(right_of=_short((region.right_of or Fraction(0)) + step)))
    return tuple(result)


def _from_floats(exosystem: Exosystem, plant: Plant, request: ObserverRequest) -> Iterator[tuple[Matrix, str]]:
    if not len(plant.A):
        yield tuple((Fraction(0),) * exosystem.outputs for _ in range(exosystem.order)), "nothing to correct"
        return
    makers = {"lmi": _by_inequalities, "kalman": _by_kalman, "place": _by_placement}
    second: list[tuple[Array, str]] = []
    for W, source in makers[request.method](plant, request):
        rounded = round_matrix(plant.T.T @ W, request.digits)
        if _may_hold(plant, to_float(rounded)):
            yield rounded, source
        if len(second) < 2 * len(SLACKS):
            second.append((W, source))
    for digits in MORE_DIGITS:
        if digits > request.digits:
            for W, source in second:
                yield round_matrix(plant.T.T @ W, digits), f"{source}, with {digits} digits"


def _may_hold(plant: Plant, W: Array) -> bool:
    """Whether a rounded W is worth an exact test: its spectrum in floats is in the regions or not far out."""
    poles: Any = np.linalg.eigvals(plant.A - plant.T @ W @ plant.C)
    size = float(np.max(np.abs(poles), initial=0.0))
    return all(excess(region, complex(s)) <= DOUBT * size for region in plant.regions for s in poles)


def _by_inequalities(plant: Plant, request: ObserverRequest) -> Iterator[tuple[Array, str]]:
    source = "linear matrix inequalities, polished to the smallest gain"
    if request.rate is None and request.max_gain is not None and not plant.sampled:
        fastest = fastest_gain(plant, limit=float(request.max_gain))
        if fastest is not None:
            yield from _slower(plant, fastest, request)
    polished = False
    for rate in _open_rates(plant, request):
        regions = (HalfPlane(left_of=-rate), *plant.regions) if rate else plant.regions
        near: Array | None = None
        if common_interval(regions) is None:
            continue
        sturdy: list[tuple[Array, str]] = []  # far inside, or with poles apart: what rounding does not upset
        missed = 0
        for slack in SLACKS:
            found = optimal_gain(plant, regions=contracted(regions, slack), near=near)
            missed = missed + 1 if found is None else 0
            if missed > 1:  # smaller regions are not easier
                break
            if found is not None:
                near, polished = found.W, True
                if slack < STURDY:
                    yield found.W, source
                else:
                    sturdy.append((found.W, source))
        for slack in (1e-3, STURDY, 0.1):
            W = _unpolished(plant, contracted(regions, slack))
            if W is not None:
                sturdy.append((W, "linear matrix inequalities"))
        sturdy += kalman_gains(plant.A, plant.C, regions, sampled=plant.sampled)
        yield from sorted(sturdy, key=lambda each: float(np.linalg.norm(each[0])))
    if request.noise or request.peak is not None or not polished:
        yield from _with_bounds(plant, request)


def _open_rates(plant: Plant, request: ObserverRequest) -> list[Fraction]:
    """Rates to be added where none was asked: half that of the Kalman gain, then smaller ones; 0 adds nothing."""
    if request.rate is not None or plant.sampled:
        return [Fraction(0)]
    rate = default_rate(plant)
    limits = request.max_gain is not None or request.noise or request.peak is not None
    return [*(rate / 2**k for k in range(STEPS if limits else 1) if rate), Fraction(0)]


def _slower(plant: Plant, fastest: tuple[float, Optimum], request: ObserverRequest) -> Iterator[tuple[Array, str]]:
    """The fastest gain, then slower ones, whose rounded |W| stays below the limit."""
    rate, found = fastest
    source = "linear matrix inequalities, polished to the fastest gain within max_gain"
    yield found.W, source
    for slack in SLACKS[2:]:
        slower = (HalfPlane(left_of=_short(Fraction(-rate * (1 - slack)))), *plant.regions)
        answer = optimal_gain(plant, regions=slower, near=found.W)
        if answer is not None:
            yield answer.W, source


def _with_bounds(plant: Plant, request: ObserverRequest) -> Iterator[tuple[Array, str]]:
    """The inequalities with the bounds on gain, peak and norms in them, Kalman gains, and direct search."""
    time = max(1e-12, float(np.max(np.abs(np.linalg.eigvals(plant.A)), initial=0.0)), float(request.rate or 0))
    gain = None if request.max_gain is None else float(request.max_gain)
    peak = None if request.peak is None else float(request.peak)
    for slack in (1e-6, 1e-3, 1e-2):
        answer = solve_lmi(
            plant.A, plant.C, plant.regions, time=time, gain=gain, peak=peak, noise=request.noise, slack=slack
        )
        W = _gain_of(answer, time=time)
        if W is not None:
            yield W, "linear matrix inequalities"
    kalman = [(ratio, kalman_gain(plant.A, plant.C, process=ratio, sampled=plant.sampled)) for ratio in RATIOS]
    for ratio, W in kalman:
        if W is not None:
            yield W, f"Kalman gain, process noise {ratio:.3g} times that of the measurement"
    if request.noise:
        smallest = optimal_gain(plant, regions=contracted(plant.regions, 0.01))
        starts = [] if smallest is None else [smallest.W]
        starts += [W for ratio, W in kalman[::6] if W is not None]
        W = quiet_gain(plant.A, plant.C, plant.regions, request.noise, starts=starts, gain=gain)
        if W is not None:
            yield W, "direct search for the bounds on noise"


def _gain_of(answer: Solution, *, time: float) -> Array | None:
    """time P^-1 Q, or None."""
    if not answer.found:
        return None
    try:
        W = np.asarray(time * np.linalg.solve(answer.values["P"], answer.values["Q"]), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return W if np.all(np.isfinite(W)) else None


def _by_kalman(plant: Plant, request: ObserverRequest) -> Iterator[tuple[Array, str]]:
    yield from kalman_gains(plant.A, plant.C, plant.regions, sampled=plant.sampled)


def _by_placement(plant: Plant, request: ObserverRequest) -> Iterator[tuple[Array, str]]:
    regions = plant.regions
    if request.rate is None and not plant.sampled:  # no rate: half that of the slowest Kalman pole
        rate = default_rate(plant)
        regions = (HalfPlane(left_of=-rate), *regions) if rate else regions
    yield from placed_candidates(plant.A, plant.C, regions)


def default_rate(plant: Plant) -> Fraction:
    """Half the decay rate of the Kalman gain with unit weights, to three digits; 0 if that fails."""
    return _default_of(plant.A, plant.C)


def _default_of(A: Array, C: Array) -> Fraction:
    gain = kalman_gain(A, C)
    if gain is None:
        return Fraction(0)
    decay = float(-np.max(np.linalg.eigvals(A - gain @ C).real))
    return Fraction(f"{decay / 2:.3g}") if decay > 0 and isfinite(decay) else Fraction(0)


def _placed(exosystem: Exosystem, point: Fraction) -> Iterator[Matrix]:
    """All observable poles at one real point, exactly; in units in which the numbers are near 1."""
    time, output = natural_units(exosystem, rate=abs(point))
    units = Exosystem(A=scale(1 / time, exosystem.A), C=scale(1 / output, exosystem.C))
    for W in placed_gains(units, rate=-point / time - 1):
        yield scale(time / output, W)


def _inner_point(request: ObserverRequest) -> Fraction:
    """A real point of all regions, away from their ends where there is room."""
    common = common_interval(request.all_regions)
    low, high = common or (None, None)
    high = Fraction(0) if high is None else high
    if low is None:
        return high - max(Fraction(1), abs(high) / 10)
    return (low + high) / 2


def _short(value: Fraction) -> Fraction:
    return value.limit_denominator(10**15)
