"""Peak gains: bounds of the integral over t > 0 of |C exp(F t) B|, in integers.

exp(F h) of one step is a matrix of integers in units of 2^-bits whose entries miss at most ``off``
units; what the products of a run of steps miss is followed by one number.
"""

import math
from fractions import Fraction
from itertools import accumulate, pairwise
from operator import mul
from typing import Any, NamedTuple

from .matrices import (
    ZERO,
    Matrix,
    Vector,
    combined,
    identity,
    integers,
    norm,
    paired,
    plus,
    product,
    transpose,
)
from .reading import need

STEPS = 20_000
GROWTH = 2000  # of |F| h steps


class Step(NamedTuple):
    """exp(F h) in units of 2^-bits."""

    phi: Any
    off: int  # what an entry may miss, in units
    grown: Fraction  # an upper bound of exp(|F| h)
    bits: int


def one_step(F: Matrix, h: Fraction, steps: int) -> Step:
    """exp(F h) by its series, with as many bits as that many steps need."""
    q = len(F)
    size = norm(F)
    euler = float(norm(plus(identity(q), h, F)) + (size * h) ** 2)  # not below |exp(F h)|, about
    # a guess: too few bits only make the bounds larger
    bits = 192 + 2 * math.ceil(steps * max(0.0, math.log(euler)))
    power = identity(q)
    total = identity(q)
    rest = Fraction(1)  # (size h)^k / k!, a bound of the next term
    terms = 0
    grown = ZERO
    while rest * 2**bits > 1:  # what is left is at most rest exp(size h)
        terms += 1
        grown += rest
        power = [[x * h / terms for x in row] for row in product(power, F)]
        total = plus(total, 1, power)
        rest = rest * size * h / terms
    # not below exp(size h), rounded up to few bits
    grown = Fraction(math.ceil((grown + rest / (1 - size * h)) * 2**64), 2**64)
    off = math.ceil(rest * 2**bits * grown) + 1  # of the series, and of rounding
    return Step(in_units(total, bits), off, grown, bits)


def in_units(X: Matrix, bits: int) -> Any:
    """A matrix in units of 2^-bits, each entry within one unit."""
    return [[round(x * 2**bits) for x in row] for row in X]


class Run:
    """Z(t) = exp(F t) [I, B, ...] from step to step, each entry within ``error`` units."""

    def __init__(self, step: Step, blocks: list[Matrix]) -> None:
        self.step = step
        columns = [column for block in blocks for column in transpose(block)]
        self.Z: Any = transpose(in_units(columns, step.bits))
        self.error = 1
        ends = list(accumulate((len(block[0]) for block in blocks), initial=0))
        #: The columns of each block.
        self.cuts = [range(*pair) for pair in pairwise(ends)]

    def masses(self) -> Vector:
        """A bound of the largest row sum of |Z| in each block."""
        found = []
        for cut in self.cuts:
            most = max(sum(abs(row[j]) for j in cut) for row in self.Z)
            found.append(Fraction(most + len(cut) * self.error))
        return found

    def go_on(self) -> None:
        """One step further."""
        phi = self.step.phi
        off = self.step.off
        bits = self.step.bits
        q = len(phi)
        largest = max(abs(x) for row in self.Z for x in row)
        # (phi + off)(Z + error): what is missed, shifted down, and one unit for each rounding
        missed = (norm(phi) + q * off) * self.error + q * off * largest
        self.error = (missed >> bits) + 2
        columns = transpose(self.Z)
        self.Z = [[sum(map(mul, row, column)) >> bits for column in columns] for row in phi]


class Outputs:
    """Sums over time of |C Z|, by row of C and by block."""

    def __init__(self, C: Matrix, run: Run) -> None:
        q = len(C[0])
        top, self.unit = integers([x for row in C for x in row])
        self.weight = norm(C)
        self.rows = []
        for i in range(len(C)):
            row = top[i * q : (i + 1) * q]
            self.rows.append([(k, x) for k, x in enumerate(row) if x])
        self.totals = [[ZERO] * len(run.cuts) for _ in C]

    def add(self, run: Run, share: Fraction) -> None:
        """This share of the values of the run as it stands."""
        columns = transpose(run.Z)
        for total, row in paired(self.totals, self.rows):
            values: Any = [abs(sum(x * column[k] for k, x in row)) for column in columns]
            for block, cut in enumerate(run.cuts):
                seen = Fraction(sum(values[j] for j in cut), self.unit)
                total[block] += share * (seen + len(cut) * self.weight * run.error)


def gains_by_row(F: Matrix, C: Matrix, inputs: list[Matrix], followed: Any) -> list[Vector]:
    """Bounds of the integrals over t > 0 of the row sums of |C exp(F t) B|, by row of C, for I and
    every B of inputs. On a step of length h the integral of |f| is at most h (|f(t)| + |f(t +
    h)|)/2 + (h^3/12) sup |f''|; what is left after the last step is a part r < 1 of the whole."""
    h = followed.step
    steps = followed.steps
    size = norm(F)
    need(
        0 < h * size < Fraction(1, 2) and steps > 0 and size * h * steps <= GROWTH,
        "the peak gains are not followed here with these steps",
    )
    step = one_step(F, h, steps)
    # the identity comes along: its integral bounds what is left of all others
    run = Run(step, [identity(len(F)), *inputs])
    outputs = Outputs(C, run)
    masses = [ZERO] * len(run.cuts)
    outputs.add(run, Fraction(1, 2))  # the trapezoidal rule takes half of both ends
    for number in range(1, steps + 1):
        masses = combined(masses, 1, run.masses())
        run.go_on()
        outputs.add(run, Fraction(1, 1 + (number == steps)))
    unit = 2**step.bits
    left = [x / unit for x in run.masses()]
    # |exp(F T)| < 1: what is left after T is a part of the whole, a geometric series
    need(left[0] < 1, "the peak gains are not shown to be finite")
    # |f''| = |C F^2 exp(F t) B|, and exp(|F| h) times more within a step
    bend = h**3 / 12 * step.grown
    found = []
    for curved, total in paired(product(C, product(F, F)), outputs.totals):
        curving = bend * sum(map(abs, curved))
        sums = [(h * x + curving * y) / unit for x, y in paired(total, masses)]
        # the whole of the identity: its own sum, and the part left[0] of the whole again
        whole = sums[0] / (1 - left[0])
        found.append([x + whole * y for x, y in paired(sums, left)])
    return found
