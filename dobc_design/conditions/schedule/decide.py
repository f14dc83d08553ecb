"""A tube and the certificate that takes over, decided: every row, the start, the hand-over and the
tolerance.

The statement and its proof are in ``claim``.  Rows are decided in floats with outward bounds,
exponentials are enclosed, all else is rational.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from dobc_design.conditions.arcs import decide as arcs
from dobc_design.conditions.arcs.claim import ArcWise
from dobc_design.conditions.quadratic.claim import Lure, Quadratic
from dobc_design.conditions.quadratic.decide import diagonal_of_inverse, differences, verify_lure
from dobc_design.conditions.quadratic.sectors import relied_differences
from dobc_design.conditions.reason import (
    Need,
    first_missing,
    fixed_obstacle,
    signs_obstacle,
)
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import (
    composite_rate,
    error_bound_obstacle,
    verify_composite,
)
from dobc_design.conditions.separable.timing import verify_readings
from dobc_design.exact.definite import decide_positive_semidefinite
from dobc_design.exact.interval import Interval, sqrt
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.number import ONE, ZERO, float_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.loop import Loop

from .claim import Cycles, Descent, Last, Tube, shrunk
from .cycles import late_obstacle, rises
from .cycles import why_not as why_not_cycles
from .rows import Box, RowsBySize, heard_boxes, heard_from


def why_not(loop: Loop, W: Matrix | None, claim: Descent) -> str | None:
    """None if the claim is proved for the gain W (q, m); else the first thing that is not."""
    return first_missing(_needs(loop, W, claim))


def open_segments(loop: Loop, tube: Tube, *, disturbance: Fraction) -> list[int] | None:
    """The segments of a tube whose rows are not proved; None where rows cannot be decided."""
    boxes = Box.of(tube.upper, tube.lower)
    timing = loop.timing
    heard = None if timing is None else heard_boxes(boxes, tube.times, timing)
    # Near the target rows have little room, and need finer tables than far out.
    rows = RowsBySize(loop, tube.most * (1 + (timing.event if timing else ZERO)))
    load = np.array([float_above(noise(tube, disturbance, time).hi) for time in tube.times])
    left = list[int]()
    for (mode, level), segments in _alike(loop, tube, heard or boxes, rows).items():
        if mode is None:
            # The mode changes on these segments, so no row is about all of one.
            left += segments
            continue
        found = rows.get(mode, level)
        if found is None:
            return None
        left += found.open_segments(boxes, tube.times, load, only=segments, heard=heard)
    return sorted(left)


def _alike(
    loop: Loop, tube: Tube, boxes: Box, rows: RowsBySize
) -> Mapping[tuple[str | None, int], list[int]]:
    """The segments by the mode that is on and by how fine the tables are that serve them."""
    # Of what is heard on a segment, which is no less, or of the boxes at its ends.
    sizes = boxes.above.max(axis=(1, 2))
    groups: dict[tuple[str | None, int], list[int]] = {}
    for k, mode in enumerate(loop.guarantee.modes_on(tube.times)):
        level = rows.level(max(sizes[k : k + 2]))
        groups.setdefault((mode, level), []).append(k)
    return groups


def noise(tube: Tube, disturbance: Fraction, time: Fraction) -> Interval:
    """Enclose the bound of |C eps_i| and E from ``time`` (s) on; 0 without an exosystem."""
    if tube.error is None:
        return Interval.point(ZERO)
    return shrunk(disturbance, tube.error.beta, time) * sqrt(Interval.point(tube.error.size))


def level_at_the_end(loop: Loop, claim: Descent) -> Interval:
    """Enclose the largest size W that the certificate may have at the end of the tube; its square
    if quadratic."""
    tube = claim.tube
    own = claim.certificate
    left = noise(tube, claim.disturbance, tube.ends)
    # Readings may still be those of before.
    late = range(heard_from(tube.times, tube.ends, loop.timing), len(tube.times))
    widths = tuple(map(max, zip(*map(tube.widths, late), strict=True)))
    if isinstance(own, Quadratic):
        return (left * claim.stretch) ** 2 * loop.n + _largest_form(loop, own, widths)
    weights = weights_then(loop, claim)
    size = max(b / v for b, v in zip(widths, weights, strict=True))
    if own.error is None:
        return Interval.point(size)
    return Interval.point(size) + left * own.error.kappa


def _largest_form(loop: Loop, own: Quadratic, widths: Sequence[Fraction]) -> Fraction:
    """A bound of e'P_e e over the box of these widths, by agent."""
    b = [width for width in widths for _ in range(loop.m)]
    sizes = {place: abs(entry) for place, entry in own.P_e.entries.items()}
    return SparseSymmetric(own.P_e.size, sizes).quadratic_form(b)


def largest_square(loop: Loop, own: Lure | ArcWise) -> Fraction | None:
    """Up to which W^2 a quadratic size is known to decay; None without an end."""
    if isinstance(own, ArcWise) or own.radius is None:
        return own.level
    # With a radius it relies on some differences of errors, which its level set has to bound.
    widest = max(differences(own.P_e, relied_differences(loop)), default=ZERO)
    return own.radius**2 / widest if widest else None


def weights_then(loop: Loop, claim: Descent) -> Sequence[Fraction]:
    """The weights v (n,) with which a certificate that is not quadratic takes over."""
    own = claim.certificate
    turns = loop.guarantee.round
    if isinstance(own, Separable):
        return tuple(own.v)
    if isinstance(own, Quadratic) or turns is None or len(own.phases) != len(turns.phases):
        return (ONE,) * loop.n
    # Of weights that move those with which the phase begins.
    place, _, _ = turns.at(claim.tube.ends)
    return own.phases[place].v[0]


def rate_near(certificate: Last) -> Fraction:
    """The rate (1/s) at which the size of a certificate decays; 0 where it is only known to
    stay."""
    if isinstance(certificate, Separable):
        return composite_rate(certificate)
    return certificate.rate or ZERO


def tallest(own: Separable | Cycles) -> Fraction:
    """The largest weight: |e|_inf of errors whose size is 1, at most."""
    return max(own.v) if isinstance(own, Separable) else own.most


def bound_after(claim: Descent, time: Fraction) -> Interval:
    """Enclose a bound of |e|_inf from ``time`` (s) on, not before the end of the tube."""
    # Until it decays the size only does not grow.
    passed = max(ZERO, time - counted_from(claim))
    return shrunk(claim.level, rate_near(claim.certificate), passed) * claim.height


def counted_from(claim: Descent) -> Fraction:
    """When (s) the size begins to decay: weights that move fall phase by phase, and one may have
    begun just now."""
    own = claim.certificate
    if not isinstance(own, Cycles):
        return claim.tube.ends
    return claim.tube.ends + max((each.times[-1] for each in own.phases), default=ZERO)


def _needs(loop: Loop, W: Matrix | None, claim: Descent) -> Iterator[Need]:
    """What has to hold, in turn: what is cheap first, and what later needs rely on."""
    tube = claim.tube
    obstacle = late_obstacle(loop, W)
    yield obstacle is None, str(obstacle)
    yield len(tube.upper[0]) == loop.n, f"a box must have {loop.n} entries, one per agent."
    yield from _observer_holds(loop, W, claim)
    # The starts are a box with equal sides.
    narrowest = min(tube.upper[0] + tube.lower[0])
    yield narrowest >= claim.radius, "its first box does not hold all starts."
    yield from _rows_hold(loop, claim)
    yield from _takes_over(loop, W, claim)
    settles = bound_after(claim, claim.time).hi <= claim.tolerance
    yield settles, "it does not bring |e|_inf down to the tolerance by the time claimed."


def _observer_holds(loop: Loop, W: Matrix | None, claim: Descent) -> Iterator[Need]:
    """The bound of |C eps_i| in the rows of the tube."""
    exosystem = loop.joint_exosystem
    error = claim.tube.error
    belongs = (error is not None) == (exosystem is not None)
    yield belongs, "P, beta and size belong to an [exosystem]."
    if exosystem is None:
        yield claim.disturbance == 0, "without an [exosystem] there is no observer error."
        return
    yield W is not None, "with an [exosystem] it needs an observer gain W."
    if W is not None and error is not None:
        obstacle = error_bound_obstacle(exosystem, W, error)
        falls = obstacle is None and error.beta > 0
        yield falls, f"the observer error of the tube: {obstacle}"


def _rows_hold(loop: Loop, claim: Descent) -> Iterator[Need]:
    """No run leaves the tube through a face."""
    tube = claim.tube
    # Where a gain mixes components, or an agent opposes another, what is added to one face depends
    # on the other.
    mixing = loop.signed or any(map(_mixes_components, loop.pulls.gains.values()))
    faces_fit = not mixing or tube.upper == tube.lower
    yield faces_fit, "with gains that mix components, or signs, its faces have to be alike."
    if len(tube.times) == 1:
        return
    if loop.gap:
        yield from rises(loop, tube.most, strictly=False)
    left = open_segments(loop, tube, disturbance=claim.disturbance)
    cannot = "its rows cannot be decided: a coupling is not defined, or turns too often."
    yield left is not None, cannot
    if left:
        begins = float(tube.times[left[0]])
        yield False, f"a row does not hold between {begins:.6g} s and the next time."


def _mixes_components(gain: Matrix) -> bool:
    return any(any(row[:c]) or any(row[c + 1 :]) for c, row in enumerate(gain))


def _takes_over(loop: Loop, W: Matrix | None, claim: Descent) -> Iterator[Need]:
    """The certificate that takes over, and that the last box lies in its level set."""
    own = claim.certificate
    size = claim.level
    late = loop.timing is not None
    if isinstance(own, Quadratic):
        yield not late, "a quadratic certificate is about readings of the same instant."
        yield from _quadratic_holds(loop, W, claim, own)
        size = claim.level**2
    else:
        yield claim.stretch == 1, "stretch is 1 unless the certificate is quadratic."
        if isinstance(own, Separable):
            verify = verify_readings if late else verify_composite
            wrong = verify(loop, W, own).wrong
            yield wrong is None, str(wrong)
        else:
            yield own.late is late, "weights that move must be late where readings are."
            yield from _cycles_hold(loop, W, claim, own)
        yield from _weights_hold(claim, own)
    # Of a quadratic certificate squares are compared, which need no root.
    lies_in_it = size >= level_at_the_end(loop, claim).hi
    yield lies_in_it, "the last box of the tube does not lie in its level set."


def _cycles_hold(loop: Loop, W: Matrix | None, claim: Descent, own: Cycles) -> Iterator[Need]:
    """Weights that move, which are known where a phase begins."""
    reason = why_not_cycles(loop, W, own)
    yield reason is None, f"the weights under the guarantee: {reason}"
    begins = not own.phases
    turns = loop.guarantee.round
    if turns is not None and own.phases:
        # The claim is about errors where a phase begins.
        _, begun, _ = turns.at(claim.tube.ends)
        begins = begun == claim.tube.ends
    yield begins, "weights that move take over only where a phase begins."


def _weights_hold(claim: Descent, own: Separable | Cycles) -> Iterator[Need]:
    """What a size N + kappa E asks of a claim."""
    error = claim.tube.error
    if own.error is not None and error is not None:
        same = own.error == replace(error, kappa=own.error.kappa)
        yield same, "the certificate and the tube have different P."
    yield claim.height >= tallest(own), "height must be at least max v."
    within = own.rho is None or claim.level <= own.rho
    yield within, "its level set reaches beyond the box of its rows."


def _quadratic_holds(
    loop: Loop, W: Matrix | None, claim: Descent, own: Lure | ArcWise
) -> Iterator[Need]:
    """What a quadratic size asks of a claim."""
    yield own.rate > 0, "its rate must be > 0."
    if isinstance(own, ArcWise):
        reason = arcs.obstacle(loop, W) or arcs.why_not(loop, own)
        yield reason is None, str(reason)
    else:
        yield not loop.signed, str(signs_obstacle(loop))
        obstacle = fixed_obstacle(loop)
        yield obstacle is None, str(obstacle)
        decision = verify_lure(loop, own)
        yield decision.is_proved, decision.reason
    error = claim.tube.error
    has_pair = (own.P is not None) == (error is not None)
    yield has_pair, "with an [exosystem] the certificate needs a pair P, Q."
    if own.P is not None and own.Q is not None and W is not None and error is not None:
        belongs = multiply(own.P, W) == own.Q
        yield belongs, "its pair (P, Q) belongs to another W: Q must equal P W."
        gap = SparseSymmetric.from_dense(error.P).scaled(claim.stretch**2)
        gap += SparseSymmetric.from_dense(own.P).negated()
        fits = decide_positive_semidefinite(gap).is_proved
        yield fits, "stretch^2 P (of the tube) - P is not semidefinite."
    high_enough = claim.height**2 >= max(diagonal_of_inverse(own.P_e))
    yield high_enough, "height^2 must be at least every diagonal entry of P_e^-1."
    most = largest_square(loop, own)
    yield most is None or claim.level**2 <= most, "its level set reaches beyond its radius."
