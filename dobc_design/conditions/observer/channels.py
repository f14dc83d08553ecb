"""How observers pass on what their model leaves out: a disturbance d of the inputs, a drift g of
the exosystem's state and measurement noise nu.

What an observer leaves acts on its agents by a signal, in every group with its own

    z = C eps + D d + (what noise adds at once),    eps' = F eps + G_d d + G_g g + G_nu nu,

eps being how far estimates are from what is true.  Where states are measured, z = d - dhat enters
by the inputs.  Of measured outputs (``loop.outputs``) eps = (x - xhat, xi - xihat); where couplings
and pins act on outputs the same enters; where they act on estimates, z = y - H xhat enters by W_x,
and rows below give x - xhat.
"""

from collections.abc import Iterator
from fractions import Fraction

from dobc_design._checks import noun
from dobc_design.exact.matrix import Matrix, identity, multiply, scale, zeros
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import RESIDUALS

from .decide import error_matrix


@noun
class Channel:
    """One group's: F (q, q), C (r, q), D (r, p), the inputs G_d (q, p), G_g (q, any) and G_nu (q,
    any), and ``at_once`` (r, any), what noise adds by itself.  The first ``acting`` rows act on
    agents, the others are x - xhat."""

    F: Matrix
    C: Matrix
    D: Matrix
    disturbance: Matrix
    drift: Matrix
    noise: Matrix
    at_once: Matrix
    acting: int


def channels(loop: Loop, W: Matrix) -> Iterator[Channel]:
    """That of every group, for the gain W (q, p)."""
    if loop.estimated:
        yield from _of_estimates(loop)
        return
    own = loop.drift
    for group, gain in loop.observed(W):
        F = error_matrix(group.exosystem, gain)
        C = group.exosystem.C
        drift = identity(len(F))
        entering = gain
        if own is not None:  # what acts, and what is asked, is in the inputs
            C = multiply(own.left_inverse, C)
            entering = multiply(gain, own.B)
        passed = scale(-1, entering)
        if loop.sensed:
            passed, drift = _entries(loop, len(F))
        yield Channel(
            F=F,
            C=C,
            D=identity(len(C)),
            disturbance=passed,
            drift=drift,
            noise=multiply(F, entering),
            at_once=multiply(C, entering),
            acting=len(C),
        )


def _of_estimates(loop: Loop) -> Iterator[Channel]:
    """Those of measured outputs, where estimates are acted on."""
    m = loop.m
    double = _sides(loop)
    for group in loop.sensed:
        W = group.observer.W or ()
        F = error_matrix(group.exosystem, W)
        H = group.exosystem.C
        disturbance, drift = _entries(loop, len(F))
        off = tuple(row[: len(F)] for row in identity(len(F))[:m])
        r = len(H)
        yield Channel(
            F=F,
            C=scale(double, (*H, *off)),
            D=zeros(r + m, len(disturbance[0])),
            disturbance=disturbance,
            drift=drift,
            noise=scale(-1 / double, W),
            at_once=(*identity(r), *zeros(m, r)),
            acting=r,
        )


def _entries(loop: Loop, size: int) -> tuple[Matrix, Matrix]:
    """How d and g enter eps = (x - xhat, xi - xihat) of ``size`` numbers."""
    m = loop.m
    B = () if loop.drift is None else loop.drift.B
    below = identity(size - m)
    disturbance = (*B, *zeros(size - m, len(B[0])))
    return scale(1 / _sides(loop), disturbance), (*zeros(m, size - m), *below)


def _sides(loop: Loop) -> Fraction:
    """Of the difference of two agents the estimation errors of both count: C is twice as large, as
    in ``loop.pairs``, and what enters half."""
    return RESIDUALS if loop.is_apart else Fraction(1)


def entries(loop: Loop) -> tuple[Matrix, ...]:
    """By which matrix the signal enters the errors of every agent: B, W_x, or I (m, any)."""
    every: Matrix = identity(loop.m) if loop.drift is None else loop.drift.B
    if not loop.estimated:
        return (every,) * loop.n
    gains = [group.observer.W or () for group in loop.sensed]
    if len(gains) == 1:
        return (gains[0][: loop.m],) * loop.n
    own: dict[str, Matrix] = {}
    for group, W in zip(loop.sensed, gains, strict=True):
        own |= dict.fromkeys(group.agents, W[: loop.m])
    return tuple(own[label] for label in loop.labels)
