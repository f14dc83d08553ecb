"""The oracle's part for the quadratic check, lure: the page's conditions and samples of the field.

Matrix inequalities are decided over flint's rationals, gains at the extremes of h(y)/y, and V' is
looked at besides at random points of the level set: the page itself is tested with it.
"""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import product
from typing import Any

import flint
import numpy as np

from oracles.couplings import (
    FINE,
    curve,
    exact,
    field_part,
    fmpq,
    mp,
    positive,
    rational,
    top,
)

POINTS = 2000
NEAR = 1e-9


def zeros(size: int) -> Any:
    return flint.fmpq_mat(size, size)


def part(M: Any, rows: Iterable[int], columns: Iterable[int]) -> Any:
    """The rows and columns of a matrix."""
    rows_of_block = [[M[i, j] for j in columns] for i in rows]
    return flint.fmpq_mat(rows_of_block)


class Quadratic:
    """One claim (the ``exact`` of a check) about V = e'P_e e + sum eps_i'P eps_i."""

    def __init__(self, regions: Any, e: dict[str, Any]) -> None:
        self.r = regions
        self.e = e
        self.size = regions.n * regions.m
        self.P_e = zeros(self.size)
        for a, b, value in e["P_e"]:
            self.P_e[a, b] = self.P_e[b, a] = fmpq(exact(value))
        self.rate = exact(e["rate"])
        self.level, self.radius = (
            None if e[name] is None else exact(e[name]) for name in ("level", "radius")
        )
        self.P = None if regions.A is None else rational(e["P"])

    def false(self, check: dict[str, Any], domain: str) -> list[str]:
        wrong = self.false_certificate(domain)
        if wrong:
            return wrong
        rate = check["rate"]
        level = self.level
        if rate is not None and not 0 < Fraction(repr(rate)) <= self.rate:
            return ["rate"]
        if check["domain"] == "global":
            return [] if level is None else ["domain"]
        if level is None or check["domain"]["kind"] != "ball":
            return ["domain"]
        R, s = (Fraction(repr(check["domain"][name])) for name in ("radius", "disturbance"))
        of_states = mp(R) ** 2 * top(self.P_e)
        taken = of_states + (0 if self.P is None else self.r.n * mp(s) ** 2 * top(self.P))
        if taken <= mp(level) * (1 + mp(FINE)):
            return []
        return ["the ball"]

    def false_certificate(self, domain: str) -> list[str]:
        """All of lure but what is said of the domain."""
        if not positive(self.P_e) or self.rate < 0:
            return ["P_e or rate"]
        one_missing = (self.level is None) != (self.radius is None)
        if one_missing or (self.level is None and domain != "global"):
            return ["level and radius"]
        if self.level is not None and min(self.level, self.radius) <= 0:
            return ["level and radius"]
        if self.P is not None and not (positive(self.P) and positive(-self._omega())):
            return ["P"]
        if not self._gains_hold():
            return ["gains"]
        if not all(self._negative(mode) for mode in self.r.modes):
            return ["inequality"]
        if self.level is not None:
            inverse = self.P_e.inv()
            for z in self.relied():
                spread = (z.transpose() * inverse * z)[0, 0]
                allowed = fmpq(self.level) * spread
                if allowed > fmpq(self.radius**2):
                    return ["the level set leaves the gains"]
        if self._grows(self.level or Fraction(1), Fraction(0)):
            return ["V grows"]
        return []

    def _omega(self) -> Any:
        F = self.r.F
        lyapunov = F.transpose() * self.P + self.P * F
        growth = 2 * fmpq(self.rate) * self.P
        return lyapunov + growth

    def relied(self) -> list[Any]:
        """The difference e_jd - e_id of every arc whose coupling is not linear, for the d that it
        is about."""
        found = {}
        for arcs in self.r.modes.values():
            for i, j, _ in arcs:
                h = self.r.h[i, j]
                m = self.r.m
                if isinstance(h, str):
                    is_linear = self.r.linear((i, j), 0)
                    curved = [] if is_linear else list(range(m))
                else:
                    own = []
                    for c, text in enumerate(h):
                        if not self.r.linear((i, j), c):
                            own.append(text)
                    curved = []
                    for d in range(m):
                        if any(f"y{d + 1}" in text for text in own):
                            curved.append(d)
                found |= {(i, j, d): self._unit(j, d) - self._unit(i, d) for d in curved}
        return list(found.values())

    def _unit(self, i: int, c: int) -> Any:
        unit = [[flint.fmpq(int(k == i * self.r.m + c))] for k in range(self.size)]
        return flint.fmpq_mat(unit)

    # gains

    def _tables(self) -> dict[int, Any]:
        found = {}
        for each in self.e["ranges"]:
            found[each["coupling"]] = [
                [tuple(map(exact, pair)) for pair in row] for row in each["gains"]
            ]
        return found

    def _number_of(self, h: Any) -> int:
        numbered = enumerate(self.r.special)
        others = [each for k, each in numbered if each not in self.r.special[:k]]
        if h == self.r.default:
            return 0
        other = [each for each in others if each != self.r.default]
        return 1 + other.index(h)

    def _gains_hold(self) -> bool:
        tables = self._tables()
        for arc in self.r.h:
            h = self.r.h[arc]
            table = tables[self._number_of(self.r.h[arc])]
            if any(lo > hi for row in table for lo, hi in row):
                return False
            if isinstance(h, str):
                reach = Fraction(1) if self.radius is None else self.radius
                if not all(
                    lo <= 0 <= hi
                    for c, row in enumerate(table)
                    for d, (lo, hi) in enumerate(row)
                    if c != d
                ):
                    return False
                components = range(self.r.m)
                if not all(curve(h).gains_within(*table[c][c], reach) for c in components):
                    return False
            elif not self._mean_slopes_hold(tuple(h), table):
                return False
        return True

    def _mean_slopes_hold(self, h: tuple[str, ...], table: Any) -> bool:
        """The mean of the Jacobian between 0 and y, by Gauss's rule, at random y, faces and corners
        of the box."""
        nodes, weights = np.polynomial.legendre.leggauss(24)
        r = np.random.default_rng(0)
        shape = (len(h), POINTS)
        drawn = r.uniform(-1.3, 1.3, size=shape)
        scaled = np.clip(drawn, -1, 1)
        y = scaled * float(self.radius or 1)
        rule = zip(nodes, weights, strict=True)
        mean = sum(w / 2 * field_part(h)[1](y * (x + 1) / 2) for x, w in rule)
        lo, hi = (
            np.array([[float(pair[k]) for pair in row] for row in table])[..., None] for k in (0, 1)
        )
        slack = NEAR * (1 + np.abs(lo) + np.abs(hi))
        inside = (mean >= lo - slack) & (mean <= hi + slack)
        return bool(np.all(inside))

    # the inequality of one mode

    def _channels(self, mode: str) -> Iterator[tuple[Any, Any, Any, Any]]:
        """(b, z, w lo, w hi) in the order arcs, those that come and go last, rows, columns."""
        tables = self._tables()
        (own,) = (each for each in self.r.document["modes"] if each["name"] == mode)
        links = [(*arc, False) for arc in self.r.modes[mode]]
        links += [(i, j, exact(w), True) for i, j, w in own.get("optional", ())]
        for i, j, w, loose in links:
            number = self._number_of(self.r.h.get((i, j), self.r.default))
            for c, row in enumerate(tables[number]):
                for d, (lo, hi) in enumerate(row):
                    if (lo, hi) != (0, 0):
                        # without the arc the gain is 0
                        ends = (min(lo, 0), max(hi, 0)) if loose else (lo, hi)
                        yield (
                            self._unit(i, c),
                            self._unit(j, d) - self._unit(i, d),
                            fmpq(w * ends[0]),
                            fmpq(w * ends[1]),
                        )

    def _negative(self, mode: str) -> bool:
        if self.e["method"] != "lure":
            return False
        M = self._base()
        multipliers = [exact(x) for x in self.e["multipliers"][mode]]
        for (b, z, lo, hi), tau in zip(self._channels(mode), multipliers, strict=True):
            Pb = self.P_e * b
            X = Pb * z.transpose()
            M = M + (X + X.transpose()) * ((lo + hi) / 2)
            if lo < hi:
                if tau <= 0:
                    return False
                t = fmpq(tau)
                D = (hi - lo) / 2
                squares = Pb * Pb.transpose()
                M = M + squares * (1 / (2 * t)) + z * z.transpose() * (2 * t * D * D)
        return positive(-M)

    def _base(self) -> Any:
        """-(P_e K + K'P_e) + 2 rate P_e + P_e (I (x) S) P_e."""
        size = self.size
        m = self.r.m
        K = zeros(size)
        S = zeros(size)
        for i, k in self.r.gains.items():
            for c, d in product(range(m), repeat=2):
                entry = k[c][d]
                K[i * m + c, i * m + d] = fmpq(entry)
        if self.P is not None:
            for i, (first, states) in enumerate(self.r.own):
                C = part(self.r.C, range(first, first + m), states)
                N = part(-self._omega(), states, states)
                border = C * N.inv() * C.transpose()
                for c, d in product(range(m), repeat=2):
                    S[i * m + c, i * m + d] = border[c, d]
        lyapunov = -(self.P_e * K + K.transpose() * self.P_e)
        growth = 2 * fmpq(self.rate) * self.P_e
        return lyapunov + growth + self.P_e * S * self.P_e

    # samples

    def _grows(self, high: Fraction, low: Fraction) -> bool:
        """Whether V' > -2 rate V at a random point with low <= V <= high; eps takes part in some of
        them."""
        rng = np.random.default_rng(0)
        r = self.r
        P_e = in_floats(self.P_e)
        e = rng.normal(size=(self.size, POINTS))
        # few agents away from the target
        shape = (self.size, POINTS // 2)
        e[:, : POINTS // 2] *= rng.integers(0, 2, size=shape)
        eps = np.zeros((r.n, 0, POINTS))
        value = np.einsum("ap,ab,bp->p", e, P_e, e)
        if self.P is not None:
            parts = (self.P, r.F, r.C)
            P, F, C = map(in_floats, parts)
            # of every group; what is not an agent's own is 0
            blocks = C.reshape(-1, r.m, len(P))
            C = blocks.sum(axis=0)
            noise = rng.normal(size=(r.n, len(P), POINTS))
            sizes = [0, 0, 1e-3, 1]
            eps = noise * rng.choice(sizes, size=POINTS)
            for i, (_, states) in enumerate(r.own):
                eps[i, [k for k in range(len(P)) if k not in states]] = 0
            value = value + np.einsum("iap,ab,ibp->p", eps, P, eps)
        ok = value > 0
        span = float(high) - float(low)
        shares = [1e-3, 0.1, 0.3, 0.6, 0.9, 1.0]
        share = rng.choice(shares, size=POINTS)
        wanted = float(low) + span * share
        safe = np.where(ok, value, 1)
        factor = np.sqrt(wanted / safe)
        scale = np.where(ok, factor, 0)
        e = e * scale
        eps = eps * scale
        for mode in r.modes:
            d = r.field(mode, e.reshape(r.n, r.m, -1))
            change = np.zeros(POINTS)
            if self.P is not None:
                d = d + np.einsum("ca,iap->icp", C, eps)
                change = 2 * np.einsum("iap,ab,ibp->p", eps, P @ F, eps)
            flat = d.reshape(self.size, -1)
            terms = 2 * np.einsum("ap,ab,bp->p", e, P_e, flat)
            growth = 2 * float(self.rate) * wanted
            left = change + terms + growth * ok
            allowed = NEAR * (np.abs(change) + np.abs(terms))
            if np.any(left > allowed):
                return True
        return False


def fraction(x: Any) -> Fraction:
    return Fraction(int(x.p), int(x.q))


def in_floats(M: Any) -> Any:
    rows = [[float(fraction(x)) for x in row] for row in M.tolist()]
    return np.array(rows)
