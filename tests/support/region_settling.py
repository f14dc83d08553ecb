"""The oracle's part for the check ``settling``: every stage and every hand-over as the page states them.

The stages themselves are looked at by the rows and by the quadratic part; exponentials by mpmath at 200 bits.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

import mpmath
from region_curves import FINE, diagonal, exact, fmpq, mp, positive, rational, top
from region_quadratic import Quadratic, fraction


class Stage:
    """One stage, its claim held by its own certificate; raises ValueError where that is not so."""

    def __init__(self, regions: Any, stage: dict[str, Any]) -> None:
        self.kind, self.own = stage["kind"], stage["certificate"]
        for name in ("start", "level", "height", "noise", "stretch"):
            setattr(self, name, exact(stage[name]))
        self.diagonal = None if "diagonal" not in stage else [exact(x) for x in stage["diagonal"]]
        self.factor = None if "factor" not in stage else exact(stage["factor"])
        self.P = None if regions.A is None else rational(self.own["P"])
        self.need(min(self.level, self.height, self.stretch) > 0 <= self.noise, "a number of a stage")
        if self.kind == "max-separable":
            self.v = regions.vector(self.own["v"])
            self.rho = None if self.own["rho"] is None else exact(self.own["rho"])
            self.rate = regions.rate_of(self.own, self.v)
            self.beta = None if regions.A is None else exact(self.own["beta"])
            self.kappa = None if regions.A is None else exact(self.own["kappa"])
            self.need(self.height >= max(self.v), "height")
        else:
            self.need(self.kind == "quadratic", "kind")
            self.quadratic = Quadratic(regions, self.own)
            wrong = self.quadratic.false_certificate("global" if regions.all_linear() else "consensus")
            self.need(not wrong, "; ".join(wrong))
            self.rate = self.beta = exact(self.own["rate"])
            inverse = self.quadratic.P_e.inv()
            least = max(fraction(inverse[k, k]) for k in range(inverse.nrows()))
            self.need(self.height**2 >= least, "height")
        self.need(self.rate > 0, "rate")

    def need(self, holds: bool, what: str) -> None:
        if not holds:
            raise ValueError(what)


def false_settling(regions: Any, check: dict[str, Any]) -> list[str]:
    """What is not as the page says; ValueError for what a stage claims falsely."""
    e, domain = check["exact"], check["domain"]
    R, s = (Fraction(repr(domain[name])) for name in ("radius", "disturbance"))
    if check["rate"] is not None or domain["kind"] != "box" or not 1 <= len(e["stages"]) <= 100:
        return ["rate, domain or stages"]
    stages = [Stage(regions, each) for each in e["stages"]]
    if stages[0].start != 0 or stages[0].stretch != 1 or not _first(regions, stages[0], R, s):
        return ["the first stage"]
    for k, (before, after) in enumerate(pairwise(stages)):
        if not _handed_over(regions, before, after):
            return [f"the hand-over to stage {k + 2}"]
    last, time, tolerance = stages[-1], exact(e["time"]), exact(e["tolerance"])
    left = mp(last.height * last.level) * mpmath.exp(-mp(last.rate * (time - last.start)))
    return [] if time >= last.start and left <= mp(tolerance) * (1 + mp(FINE)) else ["the tolerance"]


def _first(regions: Any, stage: Stage, R: Fraction, s: Fraction) -> bool:
    if stage.kind == "max-separable":
        left = stage.level - R / min(stage.v)
        if left < 0 or (stage.rho is not None and stage.level > stage.rho):
            return False
        size = Fraction(0) if stage.P is None else exact(stage.own["size"])
        return (stage.kappa or 0) ** 2 * s**2 * size <= left**2 and stage.noise**2 >= size * s**2
    most = mpmath.mpf(0) if stage.P is None else top(stage.P)
    slack = 1 + mp(FINE)
    taken = mp(R) ** 2 * mp(sum(stage.diagonal or [])) + regions.n * mp(s) ** 2 * most
    limit = stage.quadratic.level
    inside = limit is None or stage.level**2 <= limit
    noisy = mp(s) ** 2 * most <= mp(stage.noise) ** 2 * slack
    return bool(inside and _above(stage) and taken <= mp(stage.level) ** 2 * slack and noisy)


def _above(stage: Stage) -> bool:
    return positive(diagonal(map(fmpq, stage.diagonal or [])) - stage.quadratic.P_e, strict=False)


def _handed_over(regions: Any, before: Stage, after: Stage) -> bool:
    T, slack = after.start - before.start, 1 + mp(FINE)
    if T < 0 or (before.kind == "quadratic" and after.kind == "max-separable"):
        return False
    c = mp(before.level) * mpmath.exp(-mp(before.rate * T))
    d, stretch = mpmath.mpf(0), mp(after.stretch)
    if before.P is not None:
        d = mp(before.noise) * mpmath.exp(-mp(before.beta * T))
        stretched = positive(fmpq(after.stretch**2) * before.P - after.P, strict=False)
        if not stretched or mp(after.noise) * slack < stretch * d:
            return False
    if after.kind == "max-separable":
        g = max(x / y for x, y in zip(before.v, after.v, strict=True))
        wanted = mp(g) * c
        if after.rho is not None and wanted > mp(after.rho) * slack:
            return False
        if before.P is not None:
            more = max(mpmath.mpf(0), mp(after.kappa) * stretch - mp(g * before.kappa))
            wanted += more * min(d, c / mp(before.kappa))
        return bool(wanted <= mp(after.level) * slack)
    relied, radius = after.quadratic.relied(), after.quadratic.radius
    if before.kind == "max-separable":
        m, D = regions.m, after.diagonal or []
        heights = [before.v[k // m] for k in range(regions.n * m)]
        reach = max([Fraction(0), *(sum(x * abs(fraction(z[k, 0])) for k, x in enumerate(heights)) for z in relied)])
        total = c**2 * sum(mp(x * h * h) for x, h in zip(D, heights, strict=True)) + regions.n * mp(after.noise) ** 2
        inside = radius is None or c * mp(reach) <= mp(radius) * slack
        return bool(inside and _above(after) and total <= mp(after.level) ** 2 * slack)
    inverse, f = before.quadratic.P_e.inv(), after.factor or Fraction(0)
    spread = max((fraction((z.transpose() * inverse * z)[0, 0]) for z in relied), default=Fraction(0))
    inside = radius is None or c**2 * mp(spread) <= mp(radius) ** 2 * slack
    most = mp(f) if before.P is None else max(mp(f), stretch**2)
    above = positive(fmpq(f) * before.quadratic.P_e - after.quadratic.P_e, strict=False)
    return bool(inside and above and most * c**2 <= mp(after.level) ** 2 * slack)
