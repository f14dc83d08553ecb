"""Candidates for an observer gain W and for the P of its envelope, in floating point: nothing here
is believed.

With M = P A - Q C = P (A - W C) every condition is affine in (P, Q), W = P^-1 Q:

    Re s <= a      M + M' - 2 a P <= 0                      (Chilali and Gahinet 1996, here and
    below) |s - x| <= r   [[-r P, M - x P], [., -r P]] <= 0 damping z      [[s (M + M'), z (M -
    M')], [., s (M + M')]] <= 0,   s = root of 1 - z^2 H-infinity     [[M + M', B, C'], [., -g I,
    0], [., ., -g I]] <= 0,  B = Q, or P for an input of the exosystem H2             M + M' + C'C
    <= 0 and [[g^2/m I, Q'], [Q, P]] >= 0, or tr P <= g^2

One P for all of them makes it sufficient, not necessary.  Noise on the measured x is not among
them, because its output matrix C (A - W C) is not affine; Kalman gains from fast to slow are tried
for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np
from scipy import linalg

from dobc_design.conditions.observer import propose
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.exact.matrix import Matrix, scale, to_float, zeros
from dobc_design.exact.observability import decide_observable, observable_reduction
from dobc_design.exact.pencil import Pencil, Unknown
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers.conic import solve_directly
from dobc_design.solvers.program import GIVEN_UP, Array, Program, round_matrix
from dobc_design.synthesis.observer import claim
from dobc_design.synthesis.observer.decide import channel
from dobc_design.verdict import Verdict

# how far inside the regions a gain is designed, so that rounding stays inside
SLACKS = (1e-6, 1e-3, 0.01, 0.1)
MORE_DIGITS = (6, 9, 12, 15)
STEPS = 6  # halvings of the default rate
SHIFTS = (1.0, 1.05, 1.5, 2.0)  # of the spectrum for a Kalman gain, in parts of the rate
# of process to measurement noise, from fast to slow
RATIOS = tuple(10.0 ** (k / 2) for k in range(6, -13, -1))
FLOORS = tuple(Fraction(10) ** k / 3**j for k in range(2, -7, -1) for j in (0, 1))  # of P
PARTS = (1.0, 0.9, 0.5)  # of the rate asked, where the border cannot be reached with one P
DIGITS = (4, 6, 9, 14)  # of P


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant:
    """The observable part of (A, C) in floats, T its orthonormal rows, and the regions: W = T'
    W_o."""

    A: Array
    C: Array
    T: Array
    regions: tuple[claim.SpectralRegion, ...]
    sampled: bool


def propose_gains(
    exosystem: Exosystem, request: claim.ObserverRequest
) -> Iterator[tuple[Matrix, str]]:
    """Rational W (q, m) and how each came about; numbers beyond the floats leave only the exact
    placement."""
    with suppress(*GIVEN_UP):
        plant, found = make_plant(exosystem, request), []
        if not len(plant.A):
            yield zeros(exosystem.order, exosystem.outputs), "nothing to correct"
        for W, source in _gains(plant, request) if len(plant.A) else ():
            yield round_matrix(plant.T.T @ W, request.digits), source
            found.append((W, source))
        for digits, (W, source) in product(MORE_DIGITS, found[: 2 * len(SLACKS)]):
            if digits > request.digits:
                yield round_matrix(plant.T.T @ W, digits), f"{source}, with {digits} digits"
    # all observable poles at one real point, in units in which the numbers are near 1
    if request.period is None:
        low, high = claim.common_interval(request.all_regions) or (None, None)
        high = Fraction(0) if high is None else high
        point = high - max(Fraction(1), abs(high) / 10) if low is None else (low + high) / 2
        time, output = propose.natural_units(exosystem, rate=abs(point))
        units = Exosystem(A=scale(1 / time, exosystem.A), C=scale(1 / output, exosystem.C))
        for placed in propose.placed_gains(units, rate=-point / time - 1):
            yield scale(time / output, placed), "exact pole placement"


def make_plant(exosystem: Exosystem, request: claim.ObserverRequest) -> Plant:
    """The pair in floats, sampled if there is a period.  Raises: SpecError if a number is beyond
    the floats."""
    A, C = to_float(exosystem.A), to_float(exosystem.C)
    regions = request.all_regions
    if request.period is not None:
        period = float(request.period)
        q = len(A)
        # Van Loan 1978
        block = linalg.expm(np.block([[A, np.eye(q)], [np.zeros((q, 2 * q))]]) * period)
        rate = float(
            request.rate
            if request.rate is not None
            else propose.half_rate(A, C, propose.kalman_gain(A, C))
        )
        A, C = block[:q, :q], C @ block[:q, q:] / period
        radius = Fraction(math.exp(-rate * period))
        regions = (claim.Disk(centre=0, radius=radius.limit_denominator(10**15)), *request.regions)
    T = np.eye(len(A))
    if decide_observable(exosystem.A, exosystem.C).verdict is not Verdict.PROVED:
        rows = observable_reduction(exosystem.A, exosystem.C)[2]
        T = linalg.qr(to_float(rows).T, mode="economic")[0].T if rows else np.zeros((0, len(A)))
    return Plant(A=T @ A @ T.T, C=C @ T.T, T=T, regions=regions, sampled=request.period is not None)


def _gains(plant: Plant, request: claim.ObserverRequest) -> Iterator[tuple[Array, str]]:
    """Gains for the regions with the smallest |W| of what the methods give first; then those for
    bounds on noise."""
    inequalities = "linear matrix inequalities"
    # A Kalman gain reaches every rate that can be had: with many states and no other region it is
    # enough.
    slacks = SLACKS if len(plant.A) <= propose.LARGEST_PROGRAM or request.regions else ()
    # to be added where none was asked: half that of the Kalman gain, then smaller ones
    rates = [Fraction(0)]
    rate = propose.half_rate(plant.A, plant.C, propose.kalman_gain(plant.A, plant.C))
    if rate and request.rate is None and not plant.sampled:
        rates = [*(rate / 2**k for k in range(STEPS if request.noise else 1)), Fraction(0)]
    for rate in rates:
        regions = (claim.HalfPlane(left_of=-rate), *plant.regions) if rate else plant.regions
        if claim.common_interval(regions) is None:
            continue
        answers = (lmi_gain(plant.A, plant.C, regions, slack=slack) for slack in slacks)
        found = [(W, inequalities) for W in answers if W is not None]
        found += kalman_gains(plant.A, plant.C, regions, sampled=plant.sampled)
        yield from sorted(found, key=lambda each: float(np.linalg.norm(each[0])))
    if request.noise:
        quiet = (
            lmi_gain(plant.A, plant.C, plant.regions, noise=request.noise, slack=slack)
            for slack in SLACKS
        )
        yield from ((W, inequalities) for W in quiet if W is not None)
        for ratio in RATIOS:
            W = propose.kalman_gain(plant.A, plant.C, process=ratio)
            if W is not None:
                yield W, f"Kalman gain, process noise {ratio:.3g} times that of the measurement"


def lmi_gain(
    A: Array,
    C: Array,
    regions: Sequence[claim.SpectralRegion],
    *,
    noise: Sequence[claim.NoiseLimit] = (),
    slack: float = 1e-6,
) -> Array | None:
    """W = P^-1 Q (q, m) with the least tr P + |Q|^2 subject to the inequalities, or None.  Shapes:
    A (q, q) in 1/s, C (m, q).  ``slack`` keeps the answer inside, relative to P.  Time is in units
    of the fastest rate in play, so that an H-infinity norm of the exosystem channel is so many
    times as large."""
    q, m = C.shape[1], C.shape[0]
    ends = [abs(float(x)) for region in regions for x in region.real_ends if x is not None]
    time = max(1e-12, float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0)), *ends)
    unknowns = tuple(
        Unknown(name=name, rows=q, columns=n, symmetric=name == "P")
        for name, n in (("P", q), ("Q", m))
    )

    def blocks(P: Array, Q: Array) -> list[Array]:
        M = P @ (A / time) - Q @ C
        result = [_region_block(M, P, region, time=time, slack=slack) for region in regions]
        return result + [
            block for limit in noise for block in _noise_blocks(M, P, Q, C, limit, time=time)
        ]

    pencils = _pencils(blocks, unknowns)
    # A bound on a norm fixes the scale of P; the largest floor of P that has an answer keeps W =
    # P^-1 Q small.
    for floor in FLOORS if noise else (Fraction(1),):
        answer = solve_directly(Program(pencils=pencils, floor=floor))
        if answer.found:
            W: Array = np.asarray(linalg.lstsq(answer.values["P"], time * answer.values["Q"])[0])
            return W if np.all(np.isfinite(W)) else None
    return None


def _pencils(
    blocks: Callable[..., list[Array]], unknowns: tuple[Unknown, ...]
) -> tuple[Pencil, ...]:
    """The pencils of affine functions of the unknowns' arrays, from their values at 0 and at unit
    entries."""

    def sparse(matrix: Array) -> SparseSymmetric:
        places = zip(*np.nonzero(np.triu(matrix)), strict=True)
        return SparseSymmetric(
            len(matrix), {(int(i), int(j)): Fraction(float(matrix[i, j])) for i, j in places}
        )

    constants = blocks(*(np.zeros((u.rows, u.columns)) for u in unknowns))
    values = {}
    for number, unknown in enumerate(unknowns):
        for place in unknown.places():
            arrays = [np.zeros((u.rows, u.columns)) for u in unknowns]
            arrays[number][place[1], place[2]] = 1.0
            if unknown.symmetric:
                arrays[number][place[2], place[1]] = 1.0
            values[place] = blocks(*arrays)
    result = []
    for k, constant in enumerate(constants):
        coefficients = {place: sparse(value[k] - constant) for place, value in values.items()}
        left = sparse(constant)
        result.append(
            Pencil(name="observer", constant=left, unknowns=unknowns, coefficients=coefficients)
        )
    return tuple(result)


def _region_block(
    M: Array, P: Array, region: claim.SpectralRegion, *, time: float, slack: float
) -> Array:
    if isinstance(region, claim.Disk):
        x, r = float(region.centre) / time, float(region.radius) / time
        return np.block([[(slack - r) * P, M - x * P], [(M - x * P).T, (slack - r) * P]])
    if isinstance(region, claim.Cone):
        z = float(region.damping)
        symmetric, skew = math.sqrt(1 - z * z) * (M + M.T) + slack * P, z * (M - M.T)
        return np.block([[symmetric, skew], [skew.T, symmetric]])
    low, high = region.real_ends
    if high is not None:
        return M + M.T + (slack - 2 * float(high) / time) * P
    return -(M + M.T) + (slack + 2 * float(low or 0) / time) * P


def _noise_blocks(
    M: Array, P: Array, Q: Array, C: Array, limit: claim.NoiseLimit, *, time: float
) -> list[Array]:
    m, bound, exosystem = len(C), float(limit.bound), limit.channel == "exosystem"
    if limit.channel == "measurement":
        return []
    if limit.norm == "hinf":
        border = np.hstack([P if exosystem else Q, C.T])
        rest = -(bound * (time if exosystem else 1.0)) * np.eye(border.shape[1])
        return [np.block([[M + M.T, border], [border.T, rest]])]
    square, gramian = bound**2 * (time if exosystem else 1 / time), M + M.T + C.T @ C
    if exosystem:
        return [gramian, np.array([[np.trace(P) - square]])]
    return [gramian, -np.block([[square / m * np.eye(m), Q.T], [Q, P]])]


def kalman_gains(
    A: Array, C: Array, regions: Sequence[claim.SpectralRegion], *, sampled: bool
) -> Iterator[tuple[Array, str]]:
    """The Kalman gain with unit weights, then those of A + shift I, or of A / radius, which decay
    faster."""
    tried = [(propose.kalman_gain(A, C, sampled=sampled), 1.0, "Kalman gain with unit weights")]
    if sampled:
        radius = min(
            (float(r.radius) for r in regions if isinstance(r, claim.Disk) and not r.centre),
            default=1.0,
        )
        for size in (radius * 1.0, radius * 0.95, radius * 0.7):
            tried.append(
                (
                    propose.kalman_gain(A / size, C, sampled=True),
                    size,
                    "Kalman gain of A / exp(-rate T)",
                )
            )
    else:
        common = claim.common_interval(tuple(regions))
        rate = 0.0 if common is None or common[1] is None else -float(common[1])
        for shift in SHIFTS if rate else ():
            faster = propose.kalman_gain(A + shift * rate * np.eye(len(A)), C)
            tried.append((faster, 1.0, f"Kalman gain of A + {shift:g} rate I"))
    yield from ((size * gain, source) for gain, size, source in tried if gain is not None)


def propose_envelopes(
    exosystem: Exosystem, W: Matrix, rate: Fraction | None
) -> Iterator[claim.Envelope]:
    """P with (F + rate I)'P + P (F + rate I) = -I, rounded, for the ``rate`` (None: half that of F)
    and smaller."""
    with suppress(*GIVEN_UP):
        F = to_float(error_matrix(exosystem, W))
        decay = float(-np.max(np.linalg.eigvals(F).real))
        wanted = min(float(rate), decay) if rate is not None else decay / 2
        for each in (wanted * part for part in PARTS if 0 < wanted * part <= decay * (1 - 1e-9)):
            exact = rate if rate is not None and each == float(rate) else Fraction(f"{each:.6g}")
            P = linalg.solve_continuous_lyapunov(
                (F + float(exact) * np.eye(len(F))).T, -np.eye(len(F))
            )
            for digits in DIGITS:
                rounded = round_matrix((P + P.T) / 2, digits)
                values = np.linalg.eigvalsh(to_float(rounded))
                lower, upper = float(values[0]) * (1 - 1e-9), float(values[-1]) * (1 + 1e-9)
                if lower > 0:
                    bounds = Fraction(f"{lower:.12g}"), Fraction(f"{upper:.12g}")
                    yield claim.Envelope(P=rounded, rate=exact, lower=bounds[0], upper=bounds[1])


def estimate_observer(exosystem: Exosystem, W: Matrix) -> dict[str, float]:
    """Rate (1/s), damping, "hinf <channel>", peak; nothing where floats fail."""
    try:
        F = to_float(error_matrix(exosystem, W))
        poles = np.linalg.eigvals(F)
        sizes = np.where(np.abs(poles) > 0, np.abs(poles), 1.0)
        result = {"rate": float(-np.max(poles.real)), "damping": float(np.min(-poles.real / sizes))}
        result["peak"] = propose.transient_peak(F)
        for name in claim.CHANNELS:
            system = channel(exosystem, W, name)
            result[f"hinf {name}"] = propose.hinf_norm(
                F, to_float(system.B), to_float(system.C), to_float(system.D)
            )
    except GIVEN_UP:
        return {}
    return result
