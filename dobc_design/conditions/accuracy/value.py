"""The value that agents agree on, where nobody prescribes one (theory, section 16).

While all couplings attract (y h(y) >= 0), an agent that is above all others is pushed upwards by
nothing but the estimation error, which moves it by at most c, the integral of |C eps|: the value
lies between min x_i(0) - c and max x_i(0) + c.  With one linear function and one graph the sum of
pi_i x_i, pi' L = 0, is moved by the estimation error alone: the value is

    sum_i pi_i (x_i(0) + C (-F)^-1 eps_i(0)),    F = A - W C

In a formation x is x - offset.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Shown
from dobc_design.conditions.check import number_or_none, read_parts
from dobc_design.conditions.numbers import (
    LARGEST,
    claimed,
    decimal_above,
    decimal_below,
    fields_to_json,
    is_writable,
    matrix_from_json,
    read_rational,
    rounded_down,
    rounded_up,
)
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.enclosures import Curve, secant_range
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import (
    Array,
    Matrix,
    Vector,
    inverse,
    multiply,
    nullspace,
    scale,
    to_float,
)
from dobc_design.exact.number import ZERO
from dobc_design.exact.reading import Document
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import shared_starts

from .decide import Peaks, peaks_from_json, wrong_peaks

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

KEYS = ("lo", "hi", "peaks", "weights", "shifts")
DIGITS = 5  # of an end
SHOWN = 6  # weights in a sentence
MOST_WEIGHTS = 100  # agents of which pi is computed


@noun
class Agreed(Shown):
    """What is known of the value that the agents agree on; of formations, of x - offset.

    ``lo``, ``hi``: by component the interval in which it lies from every start of the [region],
    rounded outwards; None without one. ``peaks``: what bounds the integral of |C eps|.
    ``weights``: with one graph and one linear coupling, label -> pi_i, with which the value is
    sum_i pi_i (x_i(0) + shift_i eps_i(0)); ``shifts`` holds C (-F)^-1 (m, q) of every group.
    """

    lo: tuple[float, ...] | None = None
    hi: tuple[float, ...] | None = None
    peaks: Peaks | None = None
    weights: Mapping[str, Fraction] | None = None
    shifts: tuple[Matrix, ...] = ()

    def _card(self) -> Card:
        return Card(title="Value agreed upon", text=self.in_words("") or "not known")

    def to_json(self) -> Document:
        """As a certificate has it."""
        return fields_to_json(self, *KEYS)

    def in_words(self, unit: str) -> str:
        """Sentences for people; ``unit``: of the states."""
        told = []
        if self.lo is not None and self.hi is not None:
            sides = [f"[{lo:.9g}, {hi:.9g}]" for lo, hi in zip(self.lo, self.hi, strict=True)]
            told.append(f"The value they agree on lies in {' x '.join(sides)} {unit}".rstrip())
        if self.weights is not None:
            pi = self.weights.items()
            mean = "the average of the starts"
            if len(set(self.weights.values())) > 1:
                some = [f"{label}: {float(x):.4g}" for label, x in list(pi)[:SHOWN]]
                more = ", ..." if len(pi) > SHOWN else ""
                mean = f"the mean of the starts with the weights {', '.join(some)}{more}"
            moved = ", plus what the estimation error adds" if self.shifts else ""
            told.append(f"{'It' if told else 'The value they agree on'} is {mean}{moved}")
        return "".join(f" {each}." for each in told).strip()

    def reached(self, x0: ArrayLike, eps0: ArrayLike | None = None) -> Array:
        """The value from the states x0 (n, m), of formations x - offset, and the estimation errors
        xi - xihat eps0 (n, q), by default 0; agents of one exosystem.

        Returns: (m,).  Raises: ValueError where there are no weights, or several exosystems.
        Example:
            >>> network = dd.Network.from_arcs([[1, 2], [2, 1, 3]], arrow="listens_to", agents=2)
            >>> problem = dd.Problem(network=network, coupling="y", goal="agreement")
            >>> dd.certify(problem).value.reached([[0], [1]]).tolist()  # weights 3/4 and 1/4
            [0.25]
        """
        if self.weights is None or len(self.shifts) > 1:
            raise ValueError("a formula is known for one graph, one linear coupling, one exosystem")
        pi = np.array([float(x) for x in self.weights.values()])
        moved = np.asarray(x0, dtype=float).reshape(len(pi), -1)
        if eps0 is not None and self.shifts:
            moved = moved + np.asarray(eps0, dtype=float) @ to_float(self.shifts[0]).T
        return np.asarray(pi @ moved, dtype=np.float64)

    def ends(self, x0: ArrayLike, eps0: ArrayLike) -> Array | None:
        """By component between which numbers a run from x0 (n, m) and eps0 (n, q) ends, (2, m), in
        floating point; None where that is not known."""
        if self.weights is not None and len(self.shifts) <= 1:
            return np.stack([self.reached(x0, eps0)] * 2)
        if self.lo is None or self.hi is None:
            return None
        c = 0.0 if self.peaks is None else float(self.peaks.drift)
        moved = c * np.linalg.norm(eps0, axis=1).max(initial=0.0)
        found = np.stack([np.min(x0, axis=0) - moved, np.max(x0, axis=0) + moved])
        # Couplings attract over no more than the widths of the region.
        known = found[1] - found[0] <= np.subtract(self.hi, self.lo)
        return found if known.all() else None


def value_from_json(data: Any) -> Agreed:
    """Read it back.  Raises: KeyError, TypeError or ValueError."""
    shape = {
        "lo": _end_from_json,
        "hi": _end_from_json,
        "peaks": lambda peaks: None if peaks is None else peaks_from_json(peaks),
        "weights": lambda pi: pi and {label: read_rational(x) for label, x in pi.items()},
        "shifts": [matrix_from_json],
    }
    return Agreed(**read_parts(data, shape))


def _end_from_json(end: Any) -> tuple[float, ...] | None:
    if end is None:
        return None
    numbers = tuple(number for x in end if (number := number_or_none(x)) is not None)
    if len(numbers) != len(end):
        raise TypeError("an end of value must be numbers")
    return numbers


def interval_of(loop: Loop, peaks: Peaks | None) -> tuple[tuple[Fraction, Fraction], ...] | None:
    """By component between which ends the value lies; None where that is not shown."""
    if not _is_known(loop) or loop.starts is None:
        return None
    c = ZERO
    if loop.starts.disturbance:
        if peaks is None:
            return None
        c = loop.starts.disturbance * peaks.drift
    found = tuple((lo - c, hi + c) for lo, hi in shared_starts(loop))
    reach = max(hi - lo for lo, hi in found)
    if not all(_attracts(h, reach) for h in loop.functions):
        return None
    return found


def _is_known(loop: Loop) -> bool:
    """Whether nothing acts on the agents but couplings and estimation errors, and all agree on one
    value, not on one and its negative."""
    return loop.agrees and not (loop.drift or loop.uncertainty or loop.actuators or loop.turned)


def _attracts(h: Coupling, reach: Fraction) -> bool:
    """Whether y h(y) >= 0 for |y| <= reach, by component."""
    if not h.by_component or reach > LARGEST:
        return False
    if h.is_linear:
        return all(row[c].lo >= 0 for c, row in enumerate(h.jacobian_at_zero()))
    try:
        known = secant_range(Curve(h.components[0]), Interval(-reach, reach))
    except UndefinedError:
        return False
    return known.lo >= 0


def weights_of(loop: Loop) -> dict[str, Fraction] | None:
    """pi with pi' L = 0 and the sum 1; None where the sum of pi_i x_i is not known to stay."""
    if not _is_weighted(loop) or loop.n > MOST_WEIGHTS:
        return None
    found = nullspace(tuple(zip(*_laplacian(loop), strict=True)))
    if len(found) != 1 or not is_writable(found):
        return None
    total = sum(found[0], ZERO)
    return {label: x / total for label, x in zip(loop.labels, found[0], strict=True)}


def _is_weighted(loop: Loop) -> bool:
    """Whether there is one graph, and one linear function."""
    return _is_known(loop) and loop.is_linear and len(loop.functions) == 1 and not loop.switches


def _laplacian(loop: Loop) -> Matrix:
    (arcs,) = loop.modes.values()
    rows = [[ZERO] * loop.n for _ in range(loop.n)]
    for i, j, w in arcs:
        rows[i][i] += w
        rows[i][j] -= w
    return tuple(map(tuple, rows))


def shifts_of(loop: Loop, W: Matrix | None) -> tuple[Matrix, ...]:
    """C (-F)^-1 (m, q) of every group."""
    if W is None:
        return ()
    found = []
    for group, gain in loop.observed(W):
        F = error_matrix(group.exosystem, gain)
        found.append(multiply(group.exosystem.C, scale(-1, inverse(F))))
    return tuple(found)


def wrong_value(loop: Loop, W: Matrix | None, value: Agreed) -> str | None:
    """None if what is claimed of the value follows, where the agents do agree."""
    if loop.timing is not None:
        return "sums over ticks are no integrals of the estimation error"
    if value.peaks is not None:
        wrong = "it needs an observer"
        if W is not None and loop.groups:
            wrong = wrong_peaks(loop, W, value.peaks) or ""
        if wrong:
            return wrong
    if value.lo is not None or value.hi is not None:
        ends = interval_of(loop, value.peaks)
        if ends is None or value.lo is None or value.hi is None or len(value.lo) != loop.m:
            return "no interval of the value is shown"
        both = zip(ends, value.lo, value.hi, strict=True)
        if not all(claimed(lo) <= low and claimed(hi) >= high for (low, high), lo, hi in both):
            return "the value may lie outside of the interval"
    if value.weights is None:
        return "shifts without weights say nothing" if value.shifts else None
    pi: Vector = tuple(value.weights.values())
    if not _is_weighted(loop) or tuple(value.weights) != loop.labels:
        return "no weights of the value are known"
    if sum(pi) != 1 or any(multiply((pi,), _laplacian(loop))[0]):
        return "the weights are not pi' L = 0 with the sum 1"
    if value.shifts != shifts_of(loop, W):
        return "the shifts are not C (-F)^-1"
    return None


def above(x: Fraction) -> float:
    """A decimal number of few digits that is not below x; not above -x is minus that."""
    short = rounded_up(x, digits=DIGITS) if x >= 0 else -rounded_down(-x, digits=DIGITS)
    return decimal_above(short) if x >= 0 else -decimal_below(-short)
