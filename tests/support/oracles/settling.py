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
        boxes = [*self.faces[0], *self.faces[1]]
        sizes = {len(box) for box in boxes}
        counts = {len(self.times), *map(len, self.faces)}
        other_sizes = sizes != {regions.n}
        if other_sizes or len(counts) != 1 or not 1 <= len(self.times) <= 2000:
            raise ValueError("times or boxes")
        falls_back = any(b <= a for a, b in pairwise(self.times))
        if self.times[0] != 0 or falls_back or min(map(min, boxes)) <= 0:
            raise ValueError("times or boxes")
        self.size = self.beta = mpmath.mpf(0)
        if regions.A is not None:
            size = exact(own["size"])
            root = mpmath.sqrt(mp(size))
            self.size = root * mp(s)
            self.beta = mp(exact(own["beta"]))

    def noise(self, t: Fraction) -> Any:
        return self.size * mpmath.exp(-self.beta * mp(t))

    def widths(self) -> list[Fraction]:
        """Of the last box."""
        found = []
        upper = self.faces[0][-1]
        lower = self.faces[1][-1]
        for pair in zip(upper, lower, strict=True):
            found.append(max(pair))
        return found

    def false_rows(self) -> bool:
        """Whether some sample of a row pushes a face outward faster than it moves."""
        r = self.regions
        (upper, lower) = (np.array(face, dtype=float) for face in self.faces)
        gains = [float(r.held(i)) for i in range(r.n)]
        held = np.array(gains)
        times = np.array(self.times, dtype=float)
        for k in range(len(times) - 1):
            length = times[k + 1] - times[k]
            noise = float(self.noise(self.times[k]))
            decay = np.exp(-float(self.beta) * PARTS * length)
            c = noise * decay
            upper_face = (1, upper, lower)
            lower_face = (-1, lower, upper)
            for face, own, other in (upper_face, lower_face):
                speed = self._speeds(k, face)
                u = _between(own, k)
                low = _between(other, k)
                for arcs in r.modes.values():
                    total = c - held[:, None] * u - speed
                    pull = held[:, None] * u
                    sizes = np.abs(c) + pull
                    size = sizes + np.abs(speed)
                    for i, j, w in arcs:
                        h = curve(r.h[i, j])
                        reach = max(upper.max(), lower.max())
                        turns = h.turns(2.0 * float(reach))
                        lower_end = -(u[i] + low[j])
                        upper_end = u[j] - u[i]
                        felt = h.highest(lower_end, upper_end, face, turns)
                        value = float(w) * felt
                        total[i] += value
                        size[i] += np.abs(value)
                    if not np.all(np.isfinite(total) & (total <= ROOM * size)):
                        return True
        return False

    def _speeds(self, k: int, face: int) -> Any:
        """Of every agent's face in the k-th segment, in a column."""
        own = self.faces[0 if face > 0 else 1]
        length = self.times[k + 1] - self.times[k]
        ends = zip(own[k], own[k + 1], strict=True)
        speeds = [[float((b - a) / length)] for a, b in ends]
        return np.array(speeds)


def _between(face: Any, k: int) -> Any:
    before = (1 - PARTS) * face[k][:, None]
    after = PARTS * face[k + 1][:, None]
    return before + after


def _mixes(gain: list[list[Fraction]]) -> bool:
    """Whether a gain has an entry beside its diagonal."""
    return any(any(row[:c]) or any(row[c + 1 :]) for c, row in enumerate(gain))


def false_settling(regions: Any, check: dict[str, Any]) -> list[str]:
    """What is not as the page says; ValueError for what cannot be read."""
    e = check["exact"]
    domain = check["domain"]
    R, s = (Fraction(repr(domain[name])) for name in ("radius", "disturbance"))
    rate_is_given = check["rate"] is not None
    if rate_is_given or domain["kind"] != "box" or not isinstance(e["time"], str):
        return ["rate, domain or time"]
    tube = Tube(regions, e["tube"], s)
    last = e["last"]
    if min(x for face in tube.faces for x in face[0]) < R:
        return ["the first box"]
    gains = regions.gains.values()
    mixed = any(map(_mixes, gains))
    # what a gain mixes in, and an agent that is opposed, may be on either side
    if (mixed or regions.signed) and tube.faces[0] != tube.faces[1]:
        return ["faces"]
    if regions.signed and last["kind"] == "quadratic":
        return ["signs"]
    wrong = [] if regions.A is None else regions.false_observer(e["tube"])
    if wrong:
        return wrong
    if tube.false_rows():
        return ["rows"]
    names = ("level", "height", "stretch")
    level, height, stretch = (exact(last[name]) for name in names)
    time = exact(e["time"])
    tolerance = exact(e["tolerance"])
    if min(level, height, stretch, tolerance) <= 0:
        return ["a number"]
    part = _separable if last["kind"] == "max-separable" else _quadratic
    bounds = (level, height, stretch)
    rate, why = part(regions, tube, last["certificate"], bounds)
    if why or rate <= 0 or last["kind"] not in ("max-separable", "quadratic"):
        return [why or "rate or kind"]
    exponent = mp(rate * (time - tube.times[-1]))
    decay = mpmath.exp(-exponent)
    left = mp(height * level) * decay
    late = time >= tube.times[-1]
    if late and left <= mp(tolerance) * (1 + mp(FINE)):
        return []
    return ["the tolerance"]


def _separable(
    regions: Any, tube: Tube, own: dict[str, Any], sizes: tuple[Fraction, ...]
) -> tuple[Fraction, str]:
    level, height, stretch = sizes
    v = regions.vector(own["v"])
    rate = regions.rate_of(own, v)
    pairs = zip(tube.widths(), v, strict=True)
    ratio = max(x / y for x, y in pairs)
    most = mp(ratio)
    if regions.A is not None:
        for name in ("beta", "size"):
            if exact(own[name]) != exact(tube.own[name]):
                return rate, "another P"
        if rational(own["P"]) != rational(tube.own["P"]):
            return rate, "another P"
        kappa = mp(exact(own["kappa"]))
        noise = tube.noise(tube.times[-1])
        most += kappa * noise
    inside = regions.all_linear() if own["rho"] is None else level <= exact(own["rho"])
    if stretch != 1 or height < max(v) or not inside:
        return rate, "stretch, height or rho"
    return rate, "" if most <= mp(level) * (1 + mp(FINE)) else "the level"


def _quadratic(
    regions: Any, tube: Tube, own: dict[str, Any], sizes: tuple[Fraction, ...]
) -> tuple[Fraction, str]:
    level, height, stretch = sizes
    claim = Quadratic(regions, own)
    n = regions.n
    wrong = claim.false_certificate("global" if regions.all_linear() else "consensus")
    inverse = claim.P_e.inv()
    rows = range(n * regions.m)
    if wrong or height**2 < max(fraction(inverse[k, k]) for k in rows):
        return claim.rate, "; ".join(wrong) or "height"
    wide = [tube.widths()[k // regions.m] for k in rows]
    corner = Fraction(0)
    for a in rows:
        for b in rows:
            entry = claim.P_e[a, b]
            size = abs(fraction(entry))
            corner += size * wide[a] * wide[b]
    most = mp(corner)
    if claim.P is not None:
        P = rational(tube.own["P"])
        scaled = fmpq(stretch**2) * P
        if not positive(scaled - claim.P, strict=False):
            return claim.rate, "stretch"
        noise = tube.noise(tube.times[-1])
        most += n * (mp(stretch) * noise) ** 2
    if claim.radius is not None:
        spreads = []
        for z in claim.relied():
            spreads.append(fraction((z.transpose() * inverse * z)[0, 0]))
        spread = max(spreads, default=Fraction(0))
        if level**2 * spread > claim.radius**2:
            return claim.rate, "the radius"
    allowed = mp(level) ** 2 * (1 + mp(FINE))
    return claim.rate, "" if most <= allowed else "the level"
