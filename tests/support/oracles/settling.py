"""The oracle's part for the check ``settling``: the tube row by row, and what takes over, as the
page states them.

Rows are sampled on every segment, in floats; certificates are looked at by the rows and by the
quadratic part; exponentials by mpmath at 200 bits.
"""

from fractions import Fraction
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np

from oracles.couplings import FINE, curve, exact, fmpq, mp, positive, rational
from oracles.quadratic import Quadratic, fraction

PARTS = np.linspace(0, 1, 17)  # of a segment
ROOM = 1e-9  # relative, what floats leave


class Tube:
    """The boxes, their times and the bound of |C eps_i|; raises ValueError where they are none."""

    def __init__(self, regions: Any, own: dict[str, Any], s: Fraction) -> None:
        self.regions = regions
        self.own = own
        self.times = [exact(t) for t in own["times"]]
        self.faces = [[[exact(x) for x in box] for box in own[face]] for face in ("upper", "lower")]
        sizes = {len(box) for face in self.faces for box in face}
        counts = {len(self.times), *map(len, self.faces)}
        if (
            sizes != {regions.n}
            or len(counts) != 1
            or not 1 <= len(self.times) <= 2000
            or self.times[0] != 0
        ):
            raise ValueError("times or boxes")
        if (
            any(b <= a for a, b in pairwise(self.times))
            or min(min(box) for face in self.faces for box in face) <= 0
        ):
            raise ValueError("times or boxes")
        self.size = (
            mpmath.mpf(0) if regions.A is None else mpmath.sqrt(mp(exact(own["size"]))) * mp(s)
        )
        self.beta = mpmath.mpf(0) if regions.A is None else mp(exact(own["beta"]))

    def noise(self, t: Fraction) -> Any:
        return self.size * mpmath.exp(-self.beta * mp(t))

    def widths(self) -> list[Fraction]:
        """Of the last box."""
        found = []
        for pair in zip(self.faces[0][-1], self.faces[1][-1], strict=True):
            found.append(max(pair))
        return found

    def false_rows(self) -> bool:
        """Whether some sample of a row pushes a face outward faster than it moves."""
        r = self.regions
        (upper, lower) = (np.array(face, dtype=float) for face in self.faces)
        held = np.array([float(r.held(i)) for i in range(r.n)])
        times = np.array(self.times, dtype=float)
        for k in range(len(times) - 1):
            c = float(self.noise(self.times[k])) * np.exp(
                -float(self.beta) * PARTS * (times[k + 1] - times[k])
            )
            for face, own, other in ((1, upper, lower), (-1, lower, upper)):
                speed = []
                for a, b in self._ends(k, face):
                    speed.append(float((b - a) / (self.times[k + 1] - self.times[k])))
                u, low = (
                    (1 - PARTS) * x[k][:, None] + PARTS * x[k + 1][:, None] for x in (own, other)
                )
                for arcs in r.modes.values():
                    total = c - held[:, None] * u - np.array(speed)[:, None]
                    size = np.abs(c) + held[:, None] * u + np.abs(np.array(speed))[:, None]
                    for i, j, w in arcs:
                        h = curve(r.h[i, j])
                        turns = h.turns(2.0 * float(max(upper.max(), lower.max())))
                        value = float(w) * h.highest(-(u[i] + low[j]), u[j] - u[i], face, turns)
                        total[i] += value
                        size[i] += np.abs(value)
                    if not np.all(np.isfinite(total) & (total <= ROOM * size)):
                        return True
        return False

    def _ends(self, k: int, face: int) -> Any:
        own = self.faces[0 if face > 0 else 1]
        return zip(own[k], own[k + 1], strict=True)


def false_settling(regions: Any, check: dict[str, Any]) -> list[str]:
    """What is not as the page says; ValueError for what cannot be read."""
    e = check["exact"]
    domain = check["domain"]
    R, s = (Fraction(repr(domain[name])) for name in ("radius", "disturbance"))
    if check["rate"] is not None or domain["kind"] != "box" or not isinstance(e["time"], str):
        return ["rate, domain or time"]
    tube = Tube(regions, e["tube"], s)
    last = e["last"]
    if min(x for face in tube.faces for x in face[0]) < R:
        return ["the first box"]
    mixes = any(
        x
        for k in regions.gains.values()
        for c, row in enumerate(k)
        for d, x in enumerate(row)
        if c != d
    )
    if mixes and tube.faces[0] != tube.faces[1]:
        return ["faces"]
    if regions.A is not None and (wrong := regions.false_observer(e["tube"])):
        return wrong
    if tube.false_rows():
        return ["rows"]
    level, height, stretch, time, tolerance = (
        *(exact(last[name]) for name in ("level", "height", "stretch")),
        *(exact(e[name]) for name in ("time", "tolerance")),
    )
    if min(level, height, stretch, tolerance) <= 0:
        return ["a number"]
    part = _separable if last["kind"] == "max-separable" else _quadratic
    rate, wrong = part(regions, tube, last["certificate"], (level, height, stretch))
    if wrong or rate <= 0 or last["kind"] not in ("max-separable", "quadratic"):
        return [wrong or "rate or kind"]
    left = mp(height * level) * mpmath.exp(-mp(rate * (time - tube.times[-1])))
    if time >= tube.times[-1] and left <= mp(tolerance) * (1 + mp(FINE)):
        return []
    return ["the tolerance"]


def _separable(
    regions: Any, tube: Tube, own: dict[str, Any], sizes: tuple[Fraction, ...]
) -> tuple[Fraction, str]:
    (level, height, stretch), v = sizes, regions.vector(own["v"])
    rate = regions.rate_of(own, v)
    most = mp(max(x / y for x, y in zip(tube.widths(), v, strict=True)))
    if regions.A is not None:
        if rational(own["P"]) != rational(tube.own["P"]) or any(
            exact(own[name]) != exact(tube.own[name]) for name in ("beta", "size")
        ):
            return rate, "another P"
        most += mp(exact(own["kappa"])) * tube.noise(tube.times[-1])
    inside = regions.all_linear() if own["rho"] is None else level <= exact(own["rho"])
    if stretch != 1 or height < max(v) or not inside:
        return rate, "stretch, height or rho"
    return rate, "" if most <= mp(level) * (1 + mp(FINE)) else "the level"


def _quadratic(
    regions: Any, tube: Tube, own: dict[str, Any], sizes: tuple[Fraction, ...]
) -> tuple[Fraction, str]:
    (level, height, stretch), claim, n = sizes, Quadratic(regions, own), regions.n
    wrong = claim.false_certificate("global" if regions.all_linear() else "consensus")
    inverse = claim.P_e.inv()
    rows = range(n * regions.m)
    if wrong or height**2 < max(fraction(inverse[k, k]) for k in rows):
        return claim.rate, "; ".join(wrong) or "height"
    wide = [tube.widths()[k // regions.m] for k in rows]
    most = mp(sum(abs(fraction(claim.P_e[a, b])) * wide[a] * wide[b] for a in rows for b in rows))
    if claim.P is not None:
        if not positive(fmpq(stretch**2) * rational(tube.own["P"]) - claim.P, strict=False):
            return claim.rate, "stretch"
        most += n * (mp(stretch) * tube.noise(tube.times[-1])) ** 2
    if claim.radius is not None:
        spread = max(
            (fraction((z.transpose() * inverse * z)[0, 0]) for z in claim.relied()),
            default=Fraction(0),
        )
        if level**2 * spread > claim.radius**2:
            return claim.rate, "the radius"
    return claim.rate, "" if most <= mp(level) ** 2 * (1 + mp(FINE)) else "the level"
