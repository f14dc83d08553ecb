"""The value on which nodes agree, where their agreement is proved: in which interval it lies, and
for one graph with one linear coupling the weights of the starts.

A node above all others is moved upwards by its residual alone if y h(y) >= 0 as far as nodes are
apart, so that max x rises by at most c, the integral of |C eps|. With pi' L = 0 the sum of pi_i x_i
is moved by the residuals alone, in the end by pi_i C (-F)^-1 eps_i(0).
"""

from itertools import pairwise
from typing import Any

from .accuracy import NAMES, need_peaks, steps_of
from .claims import Case
from .consensus import closed, own
from .curves import CUTS, Curve
from .expressions import Coupling
from .intervals import Exact, enclosed
from .matrices import ZERO, product
from .pairs import shared_starts
from .reading import VECTOR_BITS, json_number, maybe, need, rational, read, short

SHAPE = {
    "lo": maybe([json_number]),
    "hi": maybe([json_number]),
    "peaks": maybe(steps_of(*NAMES, "step")),
    "weights": None,
    "shifts": [[[rational]]],
}


def agreed_value(case: Case) -> None:
    """What is claimed of the value holds."""
    if case.claims.value is None:
        return
    value = read(case.claims.value, SHAPE)
    need(case.agrees and case.claims.verdict == "proved", "agreement is not proved")
    plain = case.drift is None and case.own is None and case.B is None
    need(plain, "nodes move by themselves")
    need(case.timing is None, "sums over ticks are no integrals of the estimation error")
    need(case.problem.stated.negative is None, "some agree on the value, others on its negative")
    need(case.uncertainty is None and case.actuators is None, "something else acts on the nodes")
    need(value.peaks is None or case.q > 0, "there is no observer")
    if value.peaks is not None:
        for name in case.names:
            need_peaks(case, own(case, name), value.peaks)
    interval(case, value)
    weighted(case, value)


def interval(case: Case, value: Any) -> None:
    """Between which ends the value lies, by component."""
    if value.lo is None and value.hi is None:
        return
    need(case.region is not None, "there is no region")
    c = ZERO
    if case.region.initial_disturbance:
        need(value.peaks is not None, "estimation errors act, and no peak gains are shown")
        c = case.region.initial_disturbance * value.peaks.drift
    ends: list[Exact] = [(lo - c, hi + c) for lo, hi in shared_starts(case)]
    same = value.lo is not None and value.hi is not None
    need(same and len(value.lo) == len(value.hi) == case.m, "it has other components")
    for (low, high), lo, hi in zip(ends, value.lo, value.hi, strict=True):
        need(lo <= low and high <= hi, "the value may lie outside of the interval")
    end = enclosed(max(high - low for low, high in ends))[1]
    for h in case.functions:
        attracts(h, end)


def attracts(h: Coupling, end: float) -> None:
    """y h(y) >= 0 on |y| <= end: h has risen from 0 so far, or is positive on the piece."""
    need(h.single, "a coupling is a list")
    if h.straight:
        need(h.slope(0, 0)[0] >= 0, "a coupling repels")
        return
    for mirrored in (False, True):
        curve = Curve(h, mirrored)
        rising = True
        for a, b in pairwise(end * (k / CUTS) for k in range(CUTS + 1)):
            values, slopes = curve.at((a, b))
            rising = rising and slopes[0] >= 0
            need(rising or (a > 0 and values[0] >= 0), "a coupling is not shown to attract")


def weighted(case: Case, value: Any) -> None:
    """pi' L = 0 and pi' 1 = 1; every shift is C (-F)^-1."""
    if value.weights is None:
        need(not value.shifts, "there are shifts without weights")
        return
    one = len(case.functions) == 1 and case.functions[0].straight and not case.switches
    need(one, "there are several graphs, or couplings that are not one linear one")
    need(type(value.weights) is dict, "the weights are no object")
    need(list(value.weights) == list(case.labels), "there is not one weight for every node")
    weights = [rational(value.weights[label]) for label in case.labels]
    short(weights, VECTOR_BITS)
    need(sum(weights) == 1, "the weights do not add up to 1")
    moved = [ZERO] * case.n
    for arc in case.arcs:
        moved[arc.i] += weights[arc.i] * arc.w
        moved[arc.j] -= weights[arc.i] * arc.w
    need(not any(moved), "the weighted sum of the states moves")
    need(len(value.shifts) == len(case.names), "there is not one shift for every observer")
    for name, shift in zip(case.names, value.shifts, strict=True):
        residual = own(case, name)
        F = closed(residual)
        shaped = len(shift) == case.m and all(len(row) == len(F) for row in shift)
        need(shaped, "a shift has another shape")
        opposite = [[-x for x in row] for row in residual.C]
        need(product(shift, F) == opposite, "a shift is not C (-F)^-1")
