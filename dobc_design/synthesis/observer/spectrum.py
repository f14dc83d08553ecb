"""Where the eigenvalues of A - W C lie, decided over the rationals: half planes, disks, cones; sampled observers.

Routh's test and exact counts of the mapped characteristic polynomial (``exact.polynomial``). For a sampled observer
exp(A T) is enclosed by Arb, and what is proved holds for every matrix of the enclosure.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from dobc_design.conditions.statement import Statement, decided
from dobc_design.exact.interval import Interval, exp
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract
from dobc_design.exact.matrix_exponential import (
    IntervalMatrix,
    discretise,
    interval_characteristic_polynomial,
    interval_routh,
)
from dobc_design.exact.number import number_text
from dobc_design.exact.polynomial import (
    characteristic_polynomial,
    decide_hurwitz,
    decide_images,
    disk_image,
    polynomial_text,
)
from dobc_design.exact.reading import shown_number
from dobc_design.problem.exosystems import Exosystem
from dobc_design.synthesis.observer.spectral_conditions import images
from dobc_design.synthesis.observer.spectral_regions import Cone, Disk, HalfPlane, SpectralRegion
from dobc_design.verdict import Verdict


def error_matrix(exosystem: Exosystem, W: Matrix) -> Matrix:
    """F = A - W C, (q, q): the dynamics of the observer error (17)."""
    return subtract(exosystem.A, multiply(W, exosystem.C))


def spectrum_inside(F: Matrix, region: SpectralRegion) -> tuple[bool, bool]:
    """Whether every eigenvalue of F (q, q) lies in the closed region, and whether in its interior: exact.

    Raises: ShapeError if F is not square.
    """
    degree = len(F) * (2 if isinstance(region, Cone) else 1)
    return decide_images(images(region, characteristic_polynomial(F)), degree=degree)


def region_statement(F: Matrix, region: SpectralRegion, *, kind: str = "region") -> Statement:
    """State whether the spectrum of F = A - W C lies in a closed region."""
    inside, strictly = spectrum_inside(F, region)
    where = "and none on its border" if strictly else "with one on its border"
    text = f"every eigenvalue of A - WC lies in {region}"
    return Statement(
        kind=kind,
        verdict=decided(inside),
        text=f"{text}, {where}." if inside else f"it is false that {text}.",
        exact={"polynomial": polynomial_text(characteristic_polynomial(F))},
    )


def hurwitz_statement(F: Matrix) -> Statement:
    """State whether F = A - W C is Hurwitz, by Routh's first column."""
    table = decide_hurwitz(F)
    holds = table.verdict is Verdict.PROVED
    return Statement(
        kind="hurwitz",
        verdict=table.verdict,
        text="A - WC is Hurwitz." if holds else "A - WC is not Hurwitz: the estimate does not follow the disturbance.",
        exact={"routh": ", ".join(number_text(x) for x in table.first_column)},
    )


def rate_holds(F: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of F has a real part <= -rate: exact, the border included."""
    return spectrum_inside(F, HalfPlane(left_of=-rate))[0]


def rate_holds_strictly(F: Matrix, rate: Fraction) -> bool:
    """Whether every eigenvalue of F has a real part < -rate: exact."""
    return decide_hurwitz(add(F, scale(rate, identity(len(F))))).verdict is Verdict.PROVED


def damping_holds(F: Matrix, damping: Fraction) -> bool:
    """Whether the damping ratio of F is at least ``damping``: exact; false outside (0, 1)."""
    return 0 < damping < 1 and spectrum_inside(F, Cone(damping=damping))[0]


def sampled_matrix(exosystem: Exosystem, W: Matrix, period: Fraction) -> IntervalMatrix:
    """Enclose Ad - W Cd, with Ad = exp(A T) and Cd = C (1/T) int_0^T exp(A s) ds.

    The sampled observer works with means over a period: (x_(k+1) - x_k)/T less the mean of couplings and inputs is
    Cd xi_k.
    """
    found = discretise(exosystem.A, period)
    q = exosystem.order
    output = [[_sum([found.mean[r][j] * c for r, c in enumerate(row) if c]) for j in range(q)] for row in exosystem.C]
    return tuple(
        tuple(found.transition[i][j] - _sum([output[c][j] * w for c, w in enumerate(W[i]) if w]) for j in range(q))
        for i in range(q)
    )


def sampled_statements(
    exosystem: Exosystem, W: Matrix, *, period: Fraction, rate: Fraction | None, regions: Sequence[SpectralRegion]
) -> tuple[Statement, ...]:
    """Schur stability of the sampled error, its rate (|z| <= exp(-rate T)) and disks of the z-plane.

    Decided for every matrix in an enclosure of the exact one; UNDECIDED where an eigenvalue is too close to the border.
    """
    polynomial = interval_characteristic_polynomial(sampled_matrix(exosystem, W, period))
    asked: list[tuple[str, str, Fraction, Interval]] = [
        (
            "sampled",
            "the sampled error converges: every eigenvalue lies inside the unit disk",
            Fraction(0),
            Interval.point(1),
        )
    ]
    if rate is not None:
        asked.append(
            (
                "rate",
                f"the sampled error decays at the rate {shown_number(rate)} 1/s or faster",
                Fraction(0),
                exp(Interval.point(-rate * period)),
            )
        )
    for region in regions:
        if isinstance(region, Disk):
            text = f"every eigenvalue of the sampled error lies in {region}".replace("|s", "|z")
            asked.append(("region", text, region.centre, Interval.point(region.radius)))
    result = []
    for kind, text, centre, radius in asked:
        verdict = _in_disk(polynomial, centre, radius)
        words = {Verdict.REFUTED: "it is false that ", Verdict.UNDECIDED: "it stays open whether "}.get(verdict, "")
        shown = {"period": number_text(period), "width": f"{float(max(x.width for x in polynomial)):.1e}"}
        result.append(Statement(kind=kind, text=f"{words}{text}.", verdict=verdict, exact=shown))
    return tuple(result)


def _in_disk(polynomial: Sequence[Interval], centre: Fraction, radius: Interval) -> Verdict:
    """Whether all roots lie in the open disk; the radius itself is enclosed."""
    if interval_routh(disk_image(polynomial, centre=centre, radius=radius.lo)) is Verdict.PROVED:
        return Verdict.PROVED
    answer = interval_routh(disk_image(polynomial, centre=centre, radius=radius.hi))
    return Verdict.REFUTED if answer is Verdict.REFUTED else Verdict.UNDECIDED


def _sum(terms: Sequence[Interval]) -> Interval:
    total = Interval.point(0)
    for term in terms:
        total = total + term
    return total
