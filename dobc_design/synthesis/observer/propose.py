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

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
from scipy import linalg

from dobc_design._checks import noun
from dobc_design.conditions.observer import propose
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.exact.matrix import Array, Matrix, largest_entry, scale, to_float, zeros
from dobc_design.exact.number import ONE, ZERO
from dobc_design.exact.observability import decide_observable, observable_reduction
from dobc_design.loop.timing import middle_of, sampled
from dobc_design.problem.exosystems import Exosystem
from dobc_design.solvers import conic
from dobc_design.solvers.program import GIVEN_UP, round_matrix

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
from .decide import channel

# how far inside the regions a gain is designed, so that rounding stays inside
SLACKS = (1e-6, 1e-3, 0.01, 0.1)
MORE_DIGITS = (6, 9, 12, 15)
STEPS = 6  # halvings of the default rate
TIME_LIMIT = 60.0  # s, of one of Clarabel's answers
INEQUALITIES = "linear matrix inequalities"
SHIFTS = (1.0, 1.05, 1.5, 2.0)  # of the spectrum for a Kalman gain, in parts of the rate
# of process to measurement noise, from fast to slow
RATIOS = tuple(10.0 ** (k / 2) for k in range(6, -13, -1))
FLOORS = tuple(10.0**k / 3**j for k in range(2, -7, -1) for j in (0, 1))  # of P
PARTS = (1.0, 0.9, 0.5)  # of the rate asked, where the border cannot be reached with one P
DIGITS = (4, 6, 9, 14)  # of P


Proposals = Iterator[tuple[Array, str]]  # W (q, m), and how each came about


@noun(eq=False)
class Plant:
    """The observable part of (A, C) in floats, T its orthonormal rows, and the regions: W = T'
    W_o."""

    A: Array
    C: Array
    T: Array
    regions: tuple[SpectralRegion, ...]
    sampled: bool


def propose_gains(exosystem: Exosystem, request: ObserverRequest) -> Iterator[tuple[Matrix, str]]:
    """Rational W (q, m) and how each came about; numbers beyond the floats leave only the exact
    placement."""
    with suppress(*GIVEN_UP):
        plant = make_plant(exosystem, request)
        if not len(plant.A):
            yield zeros(exosystem.order, exosystem.outputs), "nothing to correct"
        found = []
        for W, source in _gains(plant, request) if len(plant.A) else ():
            yield round_matrix(plant.T.T @ W, request.digits), source
            found.append((W, source))
        # Rounding may break what holds only just: the first ones with more digits.
        for digits, (W, source) in product(MORE_DIGITS, found[: 2 * len(SLACKS)]):
            if digits > request.digits:
                yield round_matrix(plant.T.T @ W, digits), f"{source}, with {digits} digits"
    if request.period is None:
        for placed in _placed(exosystem, request):
            yield placed, "exact pole placement"


def _placed(exosystem: Exosystem, request: ObserverRequest) -> Iterator[Matrix]:
    """Gains that put all observable poles at one real point, which lies in all regions."""
    low, high = common_interval(request.all_regions) or (None, None)
    if high is None:
        high = ZERO
    if low is None:
        low = high - 2 * max(ONE, abs(high) / 10)
    point = (low + high) / 2
    # in units in which the numbers are near 1
    time, output = propose.natural_units(exosystem, rate=abs(point))
    units = Exosystem(A=scale(1 / time, exosystem.A), C=scale(1 / output, exosystem.C))
    for placed in propose.placed_gains(units, rate=-point / time - 1):
        yield scale(time / output, placed)


def make_plant(exosystem: Exosystem, request: ObserverRequest) -> Plant:
    """The pair in floats, sampled if there is a period.  Raises: SpecError if a number is beyond
    the floats."""
    A = to_float(exosystem.A)
    C = to_float(exosystem.C)
    regions = request.all_regions
    if request.period is not None:
        period = float(request.period)
        rate = request.rate
        # Without a rate half that of the Kalman gain, in continuous time or of steps.
        if rate is None and request.sampling.steps:
            rate = _half_of_steps(A, C)
        elif rate is None:
            rate = propose.half_rate(A, C, propose.kalman_gain(A, C))
        radius = Fraction(math.exp(-float(rate) * period))
        disk = Disk(centre=0, radius=radius.limit_denominator(10**15))
        found = sampled(exosystem, request.sampling)
        unit = period if request.timing else 1.0
        A, C = to_float(middle_of(found.A)), unit * to_float(middle_of(found.C))
        regions = (disk, *request.regions)
    T = np.eye(len(A))
    if not decide_observable(exosystem.A, exosystem.C).is_proved:
        # Orthonormal rows that span what C sees of the exosystem.
        rows = observable_reduction(exosystem.A, exosystem.C)[2]
        T = np.zeros((0, exosystem.order))
        if rows:
            T = linalg.qr(to_float(rows).T, mode="economic")[0].T
    held = request.period is not None
    return Plant(A=T @ A @ T.T, C=C @ T.T, T=T, regions=regions, sampled=held)


def _half_of_steps(A: Array, C: Array) -> Fraction:
    gain = propose.kalman_gain(A, C, sampled=True)
    largest = 1.0 if gain is None else largest_entry(np.linalg.eigvals(A - gain @ C))
    return Fraction(-math.log(min(1.0, largest)) / 2) if largest else ONE


def _gains(plant: Plant, request: ObserverRequest) -> Proposals:
    """Gains for the regions with the smallest |W| of what the methods give first; then those for
    bounds on noise."""
    A = plant.A
    # A Kalman gain reaches every rate that can be had: with many states and no other region it is
    # enough.
    small = len(A) <= propose.LARGEST_PROGRAM
    slacks = SLACKS if small or request.regions else ()
    for rate in _rates(plant, request):
        own = plant
        if rate:
            # The smallest |W| alone would be too slow to be of use.
            own = replace(plant, regions=(HalfPlane(left_of=-rate), *plant.regions))
        if common_interval(own.regions) is None:
            continue
        found = []
        for slack in slacks:
            W = lmi_gain(own, slack=slack)
            if W is not None:
                found.append((W, INEQUALITIES))
        # Then those of A + shift I, or of A / radius, which decay faster.
        gain = propose.kalman_gain(A, plant.C, sampled=plant.sampled)
        if gain is not None:
            found.append((gain, "Kalman gain with unit weights"))
        found += _faster_sampled(own) if plant.sampled else _faster(own)
        # A small W passes on little noise.
        yield from sorted(found, key=lambda each: float(np.linalg.norm(each[0])))
    if not request.noise:
        return
    for slack in SLACKS:
        W = lmi_gain(plant, noise=request.noise, slack=slack)
        if W is not None:
            yield W, INEQUALITIES
    # Kalman gains from fast to slow.
    for ratio in RATIOS:
        W = propose.kalman_gain(A, plant.C, process=ratio)
        if W is not None:
            yield W, f"Kalman gain, process noise {ratio:.3g} times that of the measurement"


def _rates(plant: Plant, request: ObserverRequest) -> list[Fraction]:
    """Rates (1/s) to be added where none was asked: half that of the Kalman gain, then smaller
    ones; 0 in the end."""
    rate = propose.half_rate(plant.A, plant.C, propose.kalman_gain(plant.A, plant.C))
    # A rate that was asked for is among the regions of the plant already.
    if not rate or request.rate is not None or plant.sampled:
        return [ZERO]
    halvings = STEPS if request.noise else 1
    return [*(rate / 2**k for k in range(halvings)), ZERO]


def lmi_gain(plant: Plant, *, noise: Sequence[NoiseLimit] = (), slack: float) -> Array | None:
    """W = P^-1 Q (q, m) with the least tr P + |Q|^2 subject to the inequalities, or None.
    ``slack`` keeps the answer inside, relative to P.  Time is in units of the fastest rate in play,
    so that an H-infinity norm of the exosystem channel is so many times as large."""
    asked = _Inequalities(plant=plant, noise=noise, time=_time_unit(plant), slack=slack)
    m, q = plant.C.shape
    # The unknowns are the entries of a symmetric P and of Q.
    units = [(P, np.zeros((q, m))) for P in conic.symmetric_basis(q)]
    units += [(np.zeros((q, q)), Q) for Q in np.eye(q * m).reshape(-1, q, m)]
    cones = asked.cones(units)
    cost = np.array([np.trace(P) for P, _ in units])
    # |Q|^2 keeps W = P^-1 Q small; half of x'diag(squares)x is minimised, hence 2.
    squares = np.array([2 * np.sum(Q) for _, Q in units])
    # A bound on a norm fixes the scale of P; the largest floor of P that has an answer keeps W =
    # P^-1 Q small.
    for floor in FLOORS if noise else (1.0,):
        above = conic.affine_cone([P for P, _ in units], -floor * np.eye(q))
        answer = conic.solve_cones(cost, [*cones, above], squares=squares, time_limit=TIME_LIMIT)
        if answer.found:
            P, Q = (np.tensordot(answer.x, part, 1) for part in zip(*units, strict=True))
            W: Array = np.asarray(linalg.lstsq(P, asked.time * Q)[0])
            return W if np.all(np.isfinite(W)) else None
    return None


def _time_unit(plant: Plant) -> float:
    """The fastest rate in play, in 1/s."""
    fastest = largest_entry(np.linalg.eigvals(plant.A))
    for region in plant.regions:
        for end in region.real_ends:
            if end is not None:
                fastest = max(fastest, abs(float(end)))
    return max(1e-12, fastest)


@noun(eq=False)
class _Inequalities:
    """What (P, Q) have to meet (module docstring), with ``time`` (1/s) as the unit of rates."""

    plant: Plant
    noise: Sequence[NoiseLimit]
    time: float
    slack: float

    def cones(self, units: Sequence[tuple[Array, Array]]) -> list[conic.Cone]:
        """The conditions as cones, for these (P, Q).  They are affine, so that their values at 0
        and at the units give them."""
        m, q = self.plant.C.shape
        constants = self._blocks(np.zeros((q, q)), np.zeros((q, m)))
        values = [self._blocks(*unit) for unit in units]
        found = []
        for k, constant in enumerate(constants):
            slopes = [constant - each[k] for each in values]
            found.append(conic.affine_cone(slopes, -constant))
        return found

    def _blocks(self, P: Array, Q: Array) -> list[Array]:
        """The matrices that are negative semidefinite where (P, Q) meet what is asked."""
        M = P @ (self.plant.A / self.time) - Q @ self.plant.C
        found = [self._of_region(M, P, region) for region in self.plant.regions]
        for limit in self.noise:
            found += self._of_noise(M, P, Q, limit)
        return found

    def _of_region(self, M: Array, P: Array, region: SpectralRegion) -> Array:
        """Of the region, for P^-1 M."""
        time, slack = self.time, self.slack
        twice = M + M.T
        if isinstance(region, Disk):
            radius = float(region.radius) / time
            moved = M - float(region.centre) / time * P
            corner = (slack - radius) * P
            return np.block([[corner, moved], [moved.T, corner]])
        if isinstance(region, Cone):
            z = float(region.damping)
            symmetric = math.sqrt(1 - z * z) * twice + slack * P
            skew = z * (M - M.T)
            return np.block([[symmetric, skew], [skew.T, symmetric]])
        low, high = region.real_ends
        if high is not None:
            return twice + (slack - 2 * float(high) / time) * P
        return -twice + (slack + 2 * float(low or 0) / time) * P

    def _of_noise(self, M: Array, P: Array, Q: Array, limit: NoiseLimit) -> list[Array]:
        """Of the bound on a norm."""
        time = self.time
        # C (A - W C) is not affine in Q.
        if limit.channel == "measurement":
            return []
        C = self.plant.C
        bound = float(limit.bound)
        of_exosystem = limit.channel == "exosystem"
        if limit.norm == "hinf":
            border = np.hstack([P if of_exosystem else Q, C.T])
            if of_exosystem:
                bound = bound * time
            rest = -bound * np.eye(border.shape[1])
            return [np.block([[M + M.T, border], [border.T, rest]])]
        gramian = M + M.T + C.T @ C
        if of_exosystem:
            return [gramian, np.array([[np.trace(P) - bound**2 * time]])]
        square = bound**2 * (1 / time)
        m = len(C)
        return [gramian, -np.block([[square / m * np.eye(m), Q.T], [Q, P]])]


def _faster_sampled(plant: Plant) -> Proposals:
    """A / radius has its poles in the unit disk where those of A lie in the disk of the radius."""
    disks = [each for each in plant.regions if isinstance(each, Disk) and not each.centre]
    radius = min((float(disk.radius) for disk in disks), default=1.0)
    for size in (radius, radius * 0.95, radius * 0.7):
        gain = propose.kalman_gain(plant.A / size, plant.C, sampled=True)
        if gain is not None:
            yield size * gain, "Kalman gain of A / exp(-rate T)"


def _faster(plant: Plant) -> Proposals:
    """A + shift I decays where A decays faster than the shift."""
    common = common_interval(plant.regions)
    if common is None or not common[1]:
        return
    rate = -float(common[1])
    for shift in SHIFTS:
        gain = propose.kalman_gain(plant.A + shift * rate * np.eye(len(plant.A)), plant.C)
        if gain is not None:
            yield gain, f"Kalman gain of A + {shift:g} rate I"


def propose_envelopes(exosystem: Exosystem, W: Matrix, rate: Fraction | None) -> Iterator[Envelope]:
    """P with (F + rate I)'P + P (F + rate I) = -I, rounded, for the ``rate`` (None: half that of F)
    and smaller."""
    with suppress(*GIVEN_UP):
        F = to_float(error_matrix(exosystem, W))
        decay = float(-np.max(np.linalg.eigvals(F).real))
        wanted = decay / 2 if rate is None else min(float(rate), decay)
        for part in PARTS:
            each = wanted * part
            if not 0 < each <= decay * (1 - 1e-9):
                continue
            exact = Fraction(f"{each:.6g}")
            if rate is not None and each == float(rate):
                exact = rate
            yield from _envelopes_at(F, exact)


def _envelopes_at(F: Array, rate: Fraction) -> Iterator[Envelope]:
    """P of one rate with more and more digits, and bounds of its eigenvalues."""
    unit = np.eye(len(F))
    # F + rate I is stable, so that P is positive definite.
    P = linalg.solve_continuous_lyapunov((F + float(rate) * unit).T, -unit)
    for digits in DIGITS:
        rounded = round_matrix((P + P.T) / 2, digits)
        values = np.linalg.eigvalsh(to_float(rounded))
        lower = float(values[0]) * (1 - 1e-9)
        upper = float(values[-1]) * (1 + 1e-9)
        if lower > 0:
            yield Envelope(
                P=rounded,
                rate=rate,
                lower=Fraction(f"{lower:.12g}"),
                upper=Fraction(f"{upper:.12g}"),
            )


def estimate_observer(exosystem: Exosystem, W: Matrix) -> dict[str, float]:
    """Rate (1/s), damping, "hinf <channel>", peak; nothing where floats fail."""
    try:
        F = to_float(error_matrix(exosystem, W))
        poles = np.linalg.eigvals(F)
        sizes = np.abs(poles)
        sizes = np.where(sizes > 0, sizes, 1.0)
        found = {
            "rate": float(-np.max(poles.real)),
            "damping": float(np.min(-poles.real / sizes)),
            "peak": propose.transient_peak(F),
        }
        for name in CHANNELS:
            system = channel(exosystem, W, name)
            B, C, D = to_float(system.B), to_float(system.C), to_float(system.D)
            found[f"hinf {name}"] = propose.hinf_norm(F, B, C, D)
    except GIVEN_UP:
        return {}
    return found
