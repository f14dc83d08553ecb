"""The statements of the regional certificates against the block inequality of theory, section 4, in
NumPy."""

import itertools
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from regional_problems import HARMONIC, PAPER_GAIN, cycle, identity, pins, random_problem
from texts import exact_matrix

from dobc_design.conditions.consensus.claim import Pair
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.quadratic.claim import Lure, lure_matrix
from dobc_design.conditions.quadratic.sectors import Sectors, build_sectors, enclose_ranges
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.matrix import matrix, multiply, to_float
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem

ONE = Fraction(1)


def random_metric(size: int, shape: str, seed: int) -> SparseSymmetric:
    """A positive definite matrix of small fractions."""
    r = Random(seed)
    if shape == "diagonal":
        entries = {}
        for i in range(size):
            numerator = r.randint(1, 9)
            entries[i, i] = Fraction(numerator, r.randint(1, 5))
        return SparseSymmetric(size, entries)
    rows = []
    for _ in range(size):
        row = [Fraction(r.randint(-3, 3)) for _ in range(size)]
        rows.append(row)
    rows_exact = tuple(map(tuple, rows))
    columns = tuple(zip(*rows, strict=True))
    square = multiply(rows_exact, columns)
    return SparseSymmetric.from_dense(square) + identity(size)


def random_taus(r: Random, count: int) -> list[Fraction]:
    numbers = []
    for _ in range(count):
        numbers.append(Fraction(r.randint(1, 9), r.randint(1, 9)))
    return numbers


def floats(M: SparseSymmetric) -> np.ndarray:
    return to_float(M.to_dense())


def at_radius(problem: Problem, radius: Fraction = ONE) -> Sectors:
    """The channels of a problem at a radius."""
    loop = loop_of(problem)
    return build_sectors(loop, enclose_ranges(loop, radius=radius), radius=radius)


def arrays(sectors: Sectors, mode: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """B (n m, channels), C_E (channels, n m), low and high gains."""
    channels = sectors.modes[mode]
    shape = (sectors.size, len(channels))
    B = np.zeros(shape)
    shape = (len(channels), sectors.size)
    C = np.zeros(shape)
    for k, channel in enumerate(channels):
        B[channel.target, k] = 1
        C[k, channel.plus] += 1
        C[k, channel.minus] -= 1
    low = np.array([float(channel.low) for channel in channels])
    high = np.array([float(channel.high) for channel in channels])
    return B, C, low, high


@pytest.mark.parametrize("shape", ["diagonal", "full"])
@pytest.mark.parametrize("seed", [*range(8), 11])  # 11 has eight rows
def test_the_reduced_inequality_is_the_schur_complement_of_the_one_in_theory(seed, shape):
    """[[-P K - K'P - 2 C'mMTC + 2 beta P, P B + C'(m+M)T, P(I (x) C)], [., -2T, 0], [., ., I (x)
    Omega(beta)]]."""
    problem = random_problem(seed, m=1 + seed % 2)
    sectors = at_radius(problem)
    B, C_E, low, high = arrays(sectors, "G0")
    size = sectors.size
    m = problem.m
    r = Random(seed)
    tau = random_taus(r, len(low))
    P_e = random_metric(size, shape, seed)
    beta = Fraction(r.randint(0, 5), 7)
    S = tuple(tuple(Fraction(3 if i == j else 1, 2) for j in range(m)) for i in range(m))
    P = floats(P_e)
    K = pins(problem)
    T = np.diag([float(t) for t in tau])
    decay = -P @ K - K.T @ P
    product = 2 * C_E.T @ np.diag(low * high) @ T @ C_E
    first = decay - product + 2 * float(beta) * P
    second = P @ B + C_E.T @ np.diag(low + high) @ T
    one = np.eye(problem.n)
    border = P @ np.kron(one, np.eye(m))
    # C = I, so C (-Omega)^-1 C' = S
    S_inverse = np.linalg.inv(to_float(S))
    omega = -np.kron(np.eye(problem.n), S_inverse)
    none = np.zeros((len(low), border.shape[1]))
    middle = [second.T, -2 * T, none]
    bottom = [border.T, none.T, omega]
    top = [[first, second, border], middle, bottom]
    block = np.block(top)
    beside = block[:size, size:]
    rest = block[size:, size:]
    eliminated = np.linalg.solve(rest, beside.T)
    schur = first - beside @ eliminated
    ours = floats(lure_matrix(sectors, "G0", P_e, tau, rate=beta, S=S))
    atol = 1e-9 * np.max(np.abs(schur))
    assert np.allclose(ours, schur, rtol=1e-9, atol=atol)


def test_the_border_of_the_observer_enters_as_the_paper_has_it():
    """S = 9/8 for the printed pair (theory, section 9): P_e = I then adds 9/8 I."""
    problem = cycle(3, 2, exosystem=HARMONIC)
    sectors = at_radius(problem)
    P = exact_matrix("1/2 -1/4; -1/4 1/3")
    pair = Pair(P=P, Q=multiply(P, PAPER_GAIN))
    S = schur_block(pair, HARMONIC)
    assert S is not None
    assert S[0][0] == Fraction(9, 8)
    with_it = lure_matrix(sectors, "G", identity(3), (ONE,) * 3, S=S)
    without = lure_matrix(sectors, "G", identity(3), (ONE,) * 3)
    difference = with_it + without.negated()
    assert difference == identity(3).scaled(Fraction(9, 8))


@pytest.mark.parametrize("seed", range(8))
def test_the_form_of_the_multipliers_lies_above_the_derivative_for_all_gains(seed):
    """P J + J'P with J = B diag(g) C - K is affine in each gain: for any tau, at all corners."""
    problem = random_problem(seed)
    sectors = at_radius(problem)
    B, C_E, low, high = arrays(sectors, "G0")
    P_e = random_metric(sectors.size, "full", seed)
    P = floats(P_e)
    K = pins(problem)
    beta = Fraction(1, 3)
    taus = random_taus(Random(seed), len(low))
    bound = floats(lure_matrix(sectors, "G0", P_e, taus, rate=beta))
    for corner in itertools.product((0, 1), repeat=len(low)):
        slopes = np.where(corner, high, low)
        felt = B @ np.diag(slopes)
        J = felt @ C_E - K
        derivative = P @ J + J.T @ P + 2 / 3 * P
        least = np.linalg.eigvalsh(bound - derivative)[0]
        assert least > -1e-9 * np.max(np.abs(bound))


def test_a_linear_channel_needs_no_multiplier_and_moves_into_the_linear_part():
    sectors = at_radius(cycle(4, 2, coupling="3*y"))
    forward = np.roll(np.eye(4), 1, axis=1)
    pinned = 2 * np.eye(4)
    J = 3 * (forward - np.eye(4)) - pinned
    multipliers = (Fraction(0),) * 4
    ours = lure_matrix(sectors, "G", identity(4), multipliers)
    assert np.array_equal(floats(ours), J + J.T)


def test_multipliers_have_to_be_as_many_as_channels_and_positive():
    sectors = at_radius(cycle(3, 1))
    with pytest.raises(ShapeError, match="must have 3 entries, one per channel; got 2"):
        lure_matrix(sectors, "G", identity(3), (ONE, ONE))
    multipliers = (ONE, ONE, Fraction(0))
    with pytest.raises(ShapeError, match="must be > 0 where the gain has a range"):
        lure_matrix(sectors, "G", identity(3), multipliers)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": Fraction(-1)}, "rate must be >= 0"),
        ({"level": Fraction(0)}, "level > 0"),
        ({"P": ((ONE,),)}, "P and Q must both be given"),
    ],
)
def test_what_cannot_be_a_claim_is_refused(change, words):
    given = {"P_e": identity(2), "ranges": (), "radius": ONE, "level": ONE}
    with pytest.raises(SpecError, match=words):
        Lure(**(given | change))


@pytest.mark.parametrize(
    ("dense", "shape"),
    [
        ([[2, 0], [0, 3]], "diagonal"),
        ([[2, 1], [1, 2]], "full"),
    ],
)
def test_a_certificate_says_what_shape_its_p_has(dense, shape):
    P_e = SparseSymmetric.from_dense(matrix(dense))
    lure = Lure(P_e=P_e, ranges=(), radius=ONE, level=ONE)
    assert lure.shape == shape
