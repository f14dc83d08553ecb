"""settling: |e|_inf is small from a time on, by one certificate after the other.

The size W of a stage is V of max-separable, or the root of V of lure. From the start of the stage on it is at most
level exp(-pace (t - start)), what eps costs at most noise exp(-fade (t - start)), and |e|_inf at most height W.
"""

from fractions import Fraction
from functools import partial
from typing import Any

from .files import Certificate
from .intervals import by_decimal
from .matrices import ZERO, Matrix, identity, nonnegative, plus
from .quadratic import contained, cost, inside, read_quadratic, relied
from .reading import an_object, need, rational, read, text, weights
from .separable import composite, holds_box, pace, read_separable, rows, starts

STAGES = 100  # of a settling time at most
LONGEST = Fraction(16_000)


def settling(case: Certificate, check: Any) -> None:
    """The first stage holds all starts, each one hands over to the next, and the last one comes down in time."""
    need(check.rate is None, "it has no rate to claim")
    starts(case, check.domain, "box")
    shape: dict[str, Any] = dict.fromkeys(("start", "level", "height", "noise", "stretch", "factor?"), rational)
    shape |= {"kind": text, "certificate": an_object, "diagonal?": partial(weights, case.problem.n * case.problem.m)}
    exact = read(check.exact, {"tolerance": rational, "time": rational, "stages": [shape]})
    need(1 <= len(exact.stages) <= STAGES, f"there is not between 1 and {STAGES} stages")

    claims = [stage_claim(case, *pair) for pair in zip(exact.stages, [None, *exact.stages], strict=False)]
    first(case, exact.stages[0], claims[0], check.domain)
    for k in range(1, len(claims)):
        handed(case, (exact.stages[k - 1], claims[k - 1]), (exact.stages[k], claims[k]))
    for stage, claim in zip(exact.stages, claims, strict=True):
        if stage.kind == "max-separable":  # rho > 0 by now
            rows(case, claim, claim.alpha, Fraction(1))

    last = exact.stages[-1]
    need(exact.time >= last.start, "the time is before the start of the last stage")
    top = last.height * last.level * fading(speed(case, last, claims[-1])[0] * (exact.time - last.start))
    need(top <= exact.tolerance, "the tolerance is not reached by then")


def fading(x: Fraction) -> Fraction:
    """An upper bound of exp(-x) for x >= 0; beyond LONGEST it is not followed: it is smaller."""
    return by_decimal("exp", (-min(x, LONGEST),) * 2)[1]


def speed(case: Certificate, stage: Any, claim: Any) -> tuple[Fraction, Fraction]:
    """The rates of the size and of the noise."""
    if stage.kind == "quadratic":
        return claim.rate, claim.rate
    return pace(case, claim), claim.beta if case.problem.q else ZERO


def stage_claim(case: Certificate, stage: Any, last: Any) -> Any:
    """What the certificate of a stage claims, which holds but for its starts and the rows of max-separable."""
    p, quadratic, before = case.problem, stage.kind == "quadratic", last is not None and last.kind == "quadratic"
    need(stage.noise >= 0 and stage.level > 0 and stage.height > 0 and stage.stretch > 0, "a size is negative")
    need(p.q > 0 or (stage.noise == 0 and stage.stretch == 1), "there is no exosystem")
    need(stage.kind in ("max-separable", "quadratic"), "the kind is neither max-separable nor quadratic")
    need(quadratic or not before, "a max-separable stage follows a quadratic one")
    need((stage.diagonal is not None) == (quadratic and not before), "diagonal is there, or is not")
    need((stage.factor is not None) == (quadratic and before), "factor is there, or is not")
    claim = (read_quadratic if quadratic else read_separable)(case, stage.certificate)
    if quadratic:
        high = all(inside(claim.P_e, z, Fraction(1), stage.height) for z in identity(p.n * p.m))
    else:
        need(claim.rho is not None or p.domain == "global", "it has no rho, and the couplings are not all linear")
        composite(case, claim)
        high = stage.height >= max(claim.v)
    need(high, "the height is too small")
    need(speed(case, stage, claim)[0] > 0, "a stage does not decrease")
    return claim


def first(case: Certificate, stage: Any, claim: Any, box: Any) -> None:
    """The first stage holds all starts of the box."""
    need(stage.start == 0 and stage.stretch == 1, "the first stage does not begin at 0, unstretched")
    if stage.kind == "max-separable":
        holds_box(claim, box, stage.level)
        need(claim.rho is None or stage.level <= claim.rho, "the level leaves the region")
        need(not box.disturbance or stage.noise**2 >= claim.size * box.disturbance**2, "the noise is larger")
    else:
        eps = cost(case, claim, box)
        need(below_diagonal(claim.P_e, stage.diagonal), "P_e <= diagonal is not shown")
        need(box.radius**2 * sum(stage.diagonal) + eps <= stage.level**2, "the box of starts leaves the level")
        need(claim.level is None or stage.level**2 <= claim.level, "the level leaves the region")
        need(case.problem.n * stage.noise**2 >= eps, "the noise is larger")


def below_diagonal(P_e: Matrix, D: list[Fraction]) -> bool:
    """P_e <= diag(D)."""
    return nonnegative([[(D[a] if a == b else ZERO) - x for b, x in enumerate(row)] for a, row in enumerate(P_e)])


def at_most(factor: Fraction, old: Matrix, new: Matrix) -> bool:
    """new <= factor old."""
    return nonnegative(plus(plus(identity(len(old), 0), factor, old), -1, new))


def handed(case: Certificate, before: tuple[Any, Any], after: tuple[Any, Any]) -> None:
    """From one stage to the next: where the old one has come to lies inside the new one."""
    p, (last, old), (stage, new) = case.problem, before, after
    stretch, elapsed = stage.stretch, stage.start - last.start
    need(elapsed >= 0, "a stage begins before the one it follows")
    size, fade = (fading(rate * elapsed) for rate in speed(case, last, old))
    c, noise = last.level * size, last.noise * fade
    if p.q:
        need(at_most(stretch**2, old.P, new.P), "P' <= stretch^2 P is not shown")
        need(stage.noise >= stretch * noise, "the noise is larger")

    if stage.kind == "max-separable":
        g = max(a / b for a, b in zip(old.v, new.v, strict=True))
        need(new.rho is None or g * c <= new.rho, "the level leaves the region")
        more = max(ZERO, new.kappa * stretch - g * old.kappa) * min(noise, c / old.kappa) if p.q else ZERO
        need(stage.level >= g * c + more, "the level is larger")
    elif last.kind == "max-separable":
        for a, b in relied(p) if new.radius is not None else ():
            need(c * (old.v[a // p.m] + old.v[b // p.m]) <= new.radius, "the level leaves the region")
        need(below_diagonal(new.P_e, stage.diagonal), "P_e <= diagonal is not shown")
        square = c**2 * sum(x * old.v[k // p.m] ** 2 for k, x in enumerate(stage.diagonal))
        need(stage.level**2 >= square + p.n * stage.noise**2, "the level is larger")
    else:
        contained(p, old.P_e, c**2, new.radius)
        need(at_most(stage.factor, old.P_e, new.P_e), "P_e' <= factor P_e is not shown")
        need(stage.level**2 >= max(stage.factor, stretch**2 if p.q else ZERO) * c**2, "the level is larger")
