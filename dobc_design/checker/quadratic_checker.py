"""The lone checker's part about quadratic certificates and what stands on them: lure, exhaustive and settling.

It lies beside checker.py and region_checker.py; the first loads it when a certificate holds such claims. Standard
library only, nothing of the package but those two files: written from docs/certificate-format.md, section "Regions".
Matrices are decided in rational numbers, boxes on intervals of floating-point numbers that are rounded outward.
"Not shown" is no claim that something is false.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any, NamedTuple

# The length of this file is counted, so its lines are set by hand.

# isort: off
from .checker import (
    MATRIX_BITS,
    Expression,
    Matrix,
    Number,
    Refused,
    an_object,
    by_decimal,
    definite,
    matrix,
    maybe,
    need,
    of,
    plus,
    product,
    rational,
    read,
    short,
    text,
    transpose,
)
from .region_checker import (
    CELLS,
    NOTHING,
    ZERO,
    Curve,
    Decisions as Regional,
    Interval,
    added,
    below,
    enclosed,
    follow,
    identity,
    negative,
    positive_vector,
    semidefinite,
    throughout,
    times,
    total,
    variables,
)

__all__ = ["Decisions"]
ROWS, COMPONENTS, STAGES = 100, 6, 100  # of a quadratic certificate, of a tree of boxes; of a settling time, at most
LETTERS = 100_000  # of a tree at most: twice as many as it leaves boxes
HALVINGS, FURTHER, PIECES = 30, 12, 20_000  # of a component; of a box that is not shown, and of all such boxes
LONGEST = Fraction(16_000)  # beyond it exp(-x) is not followed: it is smaller


# --- Matrices, and the exponential ------------------------------------------------------------------------------------
def largest(X: Matrix) -> Fraction:
    """An upper bound of the eigenvalues of a positive definite X, by bisection."""
    lo, hi = ZERO, max(sum(map(abs, row), ZERO) for row in X)
    for _ in range(40):
        middle = (lo + hi) / 2
        lo, hi = (lo, middle) if definite(plus(identity(len(X), middle), -1, X), 1) else (middle, hi)
    return hi


def nonnegative(X: Matrix) -> bool:
    """True only if X is positive semidefinite: positive definite beside its rows of zeros, or else by elimination."""
    kept = [k for k, row in enumerate(X) if any(row)]
    X = [[X[a][b] for b in kept] for a in kept]
    return not X or definite(X, 1) or (len(X) <= 20 and semidefinite(X))


def inside(P_e: Matrix, z: list[Fraction], square: Fraction, limit: Fraction) -> bool:
    """square z'P_e^-1 z <= limit^2: |z'e| <= limit where e'P_e e <= square."""
    return nonnegative(plus(P_e, -square / limit**2, product(transpose([z]), [z])))


def below_diagonal(P_e: Matrix, D: list[Fraction]) -> bool:
    """P_e <= diag(D)."""
    return nonnegative([[(D[a] if a == b else ZERO) - x for b, x in enumerate(row)] for a, row in enumerate(P_e)])


def fading(x: Fraction) -> Fraction:
    """An upper bound of exp(-x) for x >= 0."""
    x = -min(x, LONGEST)
    return by_decimal("exp", Number(x, x)).hi


def dot(x: Iterable[Interval], y: Iterable[Interval]) -> Interval:
    return total(map(times, x, y))


# --- Boxes ------------------------------------------------------------------------------------------------------------
Box = tuple[tuple[float, ...], tuple[float, ...]]  # the lower and the upper ends


def halves(box: Box, k: int) -> tuple[Box, Box]:
    """Both halves across component k. The number between is rounded, so that together they are the box."""
    lo, hi = box
    middle = (lo[k] + hi[k]) / 2
    return (lo, (*hi[:k], middle, *hi[k + 1 :])), ((*lo[:k], middle, *lo[k + 1 :]), hi)


def leaves(tree: str, root: Box) -> list[Box]:
    """The boxes that a tree leaves, by its letters, depth by depth."""
    need(len(tree) <= LETTERS, f"trees of at most {LETTERS} letters are followed")
    size, found, boxes, letters = len(root[0]), list[Box](), [root], iter(tree)
    least = (root[1][0] - root[0][0]) / 2**HALVINGS
    while boxes:
        deeper: list[Box] = []
        for box in boxes:
            letter = next(letters, "")
            if letter == ".":
                found.append(box)
                continue
            k = "012345"[:size].find(letter) if letter else -1
            need(k >= 0, "the tree ends too early, or holds a letter that is no component")
            need(box[1][k] - box[0][k] > least, f"a component is halved more than {HALVINGS} times")
            deeper += halves(box, k)
        boxes = deeper
    need(next(letters, "") == "", "the tree goes on after its last box")
    return found


class Field(NamedTuple):
    """phi in one mode: M and P_e, and the arcs a (listens to) b with their couplings and weights."""

    M: list[list[Interval]]
    P: list[list[Interval]]
    arcs: list[tuple[Curve, Interval, int, int]]

    def at(self, box: Box) -> tuple[Interval, list[Interval]]:
        """phi on a box, and half its slopes there (Clarke's at a kink)."""
        e = list(zip(*box, strict=True))
        F, J = [NOTHING] * len(e), [[NOTHING] * len(e) for _ in e]
        for curve, w, a, b in self.arcs:
            value, slope = (times(w, x) for x in curve.at(added(e[b], negative(e[a]))))
            F[a], J[a][b], J[a][a] = added(F[a], value), added(J[a][b], slope), added(J[a][a], negative(slope))
        Pe, Me, PF = ([dot(row, x) for row in X] for X, x in ((self.P, e), (self.M, e), (self.P, F)))
        JPe = [dot(column, Pe) for column in zip(*J, strict=True)]
        phi = added(dot(e, Me), times((2.0, 2.0), dot(Pe, F)))
        return phi, [total(parts) for parts in zip(Me, PF, JPe, strict=True)]

    def falls(self, box: Box) -> bool:
        """True only if phi < 0 on the box: phi in the middle, plus half widths times slopes."""
        middle = tuple((lo + hi) / 2 for lo, hi in zip(*box, strict=True))
        _, slopes = self.at(box)
        phi, _ = self.at((middle, middle))
        sides = [added(side, (-x, -x)) for side, x in zip(zip(*box, strict=True), middle, strict=True)]
        return added(phi, times((2.0, 2.0), dot(slopes, sides)))[1] < 0


def beyond(P: list[list[Interval]], box: Box, level: float) -> bool:
    """True only if e'P_e e >= level on the box: it is convex, so it lies above its tangent at any point. The point
    where it is least is a good one; rounding errors in finding it do no harm."""
    e = [max(lo, min(0.0, hi)) for lo, hi in zip(*box, strict=True)]
    for k in [*range(len(e))] * 8:
        rest = sum(P[k][j][0] * x for j, x in enumerate(e) if j != k)
        e[k] = max(box[0][k], min(-rest / P[k][k][0], box[1][k]))
    at = [(x, x) for x in e]
    Pe = [dot(row, at) for row in P]
    steps = [added(side, (-x, -x)) for side, x in zip(zip(*box, strict=True), e, strict=True)]
    return added(dot(at, Pe), times((2.0, 2.0), dot(Pe, steps)))[0] >= level


def within(P: list[list[Interval]], box: Box, level: float) -> bool:
    """True only if e'P_e e <= level on the box: the value in the middle, slopes there, and squares."""
    middle = [((lo + hi) / 2,) * 2 for lo, hi in zip(*box, strict=True)]
    steps = [added(side, negative(x)) for side, x in zip(zip(*box, strict=True), middle, strict=True)]
    slopes = [added(times((2.0, 2.0), dot(row, middle)), dot(row, steps)) for row in P]
    return total([dot(middle, [dot(row, middle) for row in P]), dot(slopes, steps)])[1] <= level


class Decisions(Regional):
    """The regional claims of one certificate, quadratic ones included."""

    # --- lure
    def lure(self, check: Any) -> None:
        """V = e'P_e e + sum eps_i'P eps_i decreases where the gains of all arcs are inside their ranges."""
        claim = self.inequality(check.exact)
        self.slower(check, claim)
        if claim.level is None:
            need(check.domain == "global", "it has no level and is not global")
        else:
            self.ball(check.domain, claim, claim.level)

    def slower(self, check: Any, claim: Any) -> None:
        good = check.rate is None or 0 < check.rate <= claim.rate
        need(good, "the rate is not between 0 and that of the inequality")

    def ball(self, domain: Any, claim: Any, level: Fraction) -> None:
        """Every start of the ball lies in {V <= level}."""
        self.start(domain, "ball")
        s = domain.disturbance
        top = largest(claim.form) * domain.radius**2 + (self.problem.n * s**2 * largest(claim.P) if s else 0)
        need(top <= level, "the ball leaves the level set")

    def inequality(self, source: Any, more: Any = None) -> Any:
        """All that a quadratic certificate claims but for its domain; ``form`` is P_e, ``S`` what eps costs."""
        p, m, size = self.problem, self.problem.m, self.problem.n * self.problem.m
        need(size <= ROWS, f"quadratic certificates are decided up to {ROWS} rows")

        def place(value: Any) -> int:
            need(type(value) is int and 0 <= value < size, f"an integer from 0 to {size - 1} was expected")
            return int(value)

        exact = read(
            source,
            {
                "method": text,
                "P_e": [(place, place, rational)],
                "level": maybe(rational),
                "radius": maybe(rational),
                "ranges": [{"coupling": of(int), "gains": (((rational, rational),) * m,) * m}],
                "multipliers": an_object,
                "rate": rational,
            }
            | ({"P": matrix(p.q, p.q)} if p.q else {})
            | (more or {}),
        )
        need(exact.rate >= 0, "the rate is negative")
        short((x for _, _, x in exact.P_e), MATRIX_BITS)
        need(all(a <= b and x != 0 for a, b, x in exact.P_e), "P_e does not list its entries that are not 0, a <= b")
        need(len({(a, b) for a, b, _ in exact.P_e}) == len(exact.P_e), "an entry of P_e stands there twice")
        P_e = identity(size, ZERO)
        for a, b, x in exact.P_e:
            P_e[a][b] = P_e[b][a] = x
        need(definite(P_e, 1), "P_e > 0 is not shown")
        S = identity(m, ZERO)
        if p.q:
            need(transpose(exact.P) == exact.P and definite(exact.P, 1), "P > 0 is not shown")
            S = self.case.schur(exact.P, exact.rate)
        need((exact.level is None) == (exact.radius is None), "level and radius are not both there")
        ranges = self.ranges(exact)
        need(set(exact.multipliers) == set(p.modes if exact.method == "lure" else ()), "there are other multipliers")
        for mode in p.modes:
            need(all(definite(X, -1) for X in self.forms(exact, mode, P_e, S, ranges)), "V is not shown to decrease")
        exact.form, exact.S = P_e, S
        if exact.level is not None:
            need(exact.level > 0 and exact.radius > 0, "the level or the radius is not positive")
            self.contained(P_e, exact.level, exact.radius)
        else:
            need(p.domain == "global", "it has no level, and the couplings are not all linear")
        return exact

    def contained(self, P_e: Matrix, square: Fraction, radius: Any) -> None:
        """{e'P_e e <= square} lies inside the radius (none: there is no limit)."""
        for a, b in self.relied() if radius is not None else ():
            z = [Fraction((k == b) - (k == a)) for k in range(len(P_e))]
            need(inside(P_e, z, square, radius), "the level set leaves the radius")

    def ranges(self, exact: Any) -> dict[Any, Any]:
        """The gains of every coupling that an arc has, shown on |y_c| <= radius."""
        known = list(dict.fromkeys([self.problem.file.coupling.h, *self.exceptions.values()]))
        used = {h for heard in self.heard.values() for arcs in heard for h, _, _ in arcs}
        wanted = [k for k, h in enumerate(known) if h in used]
        need(sorted(each.coupling for each in exact.ranges) == wanted, "the ranges are not those of the couplings")
        found = {known[each.coupling]: each.gains for each in exact.ranges}
        need(all(self.gains_hold(h, gains, exact.radius) for h, gains in found.items()), "the gains are not shown")
        return found

    def gains_hold(self, h: Any, gains: Any, radius: Fraction | None) -> bool:
        m, places = self.problem.m, [(c, d) for c in range(self.problem.m) for d in range(self.problem.m)]
        if self.straight(h):
            slopes = ((gains[c][d], self.slope(h, c, d)) for c, d in places)
            return all(lo <= slope.lo and slope.hi <= hi for (lo, hi), slope in slopes)
        if radius is None or radius <= 0:
            return False
        r = enclosed(radius)[1]
        if len(h) > 1:
            return self.within(h, gains, [(-r, r)] * m, CELLS)
        beside = [gains[c][d] for c, d in places if c != d]
        return all(lo <= 0 <= hi for lo, hi in beside) and all(self.secant(h, gains[c][c], r) for c in range(m))

    def secant(self, h: Any, gain: list[Fraction], r: float) -> bool:
        """lo y <= h(y) <= hi y for 0 < y <= r, and the other way round for -r <= y < 0."""

        def shown(curve: Curve, side: float, slope: Interval) -> bool:
            def settled(a: float, b: float) -> bool:
                bound = follow(curve, (side, side), a, b)
                at = lambda s: added((bound.at(s),) * 2, times((s, s), slope))[1]  # noqa: E731
                return below(a, b, at, added(bound.slope, slope))

            return throughout(r, settled)

        sides = [(1.0, enclosed(-gain[1])), (-1.0, enclosed(gain[0]))]
        return all(shown(self.curve(h, face), *side) for face in (False, True) for side in sides)

    def within(self, h: Any, gains: Any, box: list[Interval], halvings: int) -> bool:
        """All slopes lie inside the gains on the box, or on both halves of it."""
        m = len(box)
        rows = [self.formula(h, c).at(*variables(box))[1] or (NOTHING,) * m for c in range(m)]
        shown = all(
            low <= Fraction(x) and Fraction(y) <= high
            for row, gain in zip(rows, gains, strict=True)
            for (x, y), (low, high) in zip(row, gain, strict=True)
        )
        lo, hi = side = max(box, key=lambda each: each[1] - each[0])
        k, middle = box.index(side), (lo + hi) / 2
        halves = [[*box[:k], half, *box[k + 1 :]] for half in ((lo, middle), (middle, hi))]
        return shown or (halvings > 0 and all(self.within(h, gains, half, halvings - 1) for half in halves))

    def relied(self) -> Iterator[tuple[int, int]]:
        """The rows of e_id and e_jd for each difference e_jd - e_id that a coupling depends on, if it is not linear."""
        p, seen = self.problem, set[tuple[int, int]]()
        arcs = [(i, j, h) for heard in self.heard.values() for i, arcs in enumerate(heard) for h, _, j in arcs]
        for i, j, h in arcs:
            for d in range(p.m):
                names = [f"y{k + 1}" for k in range(p.m)]
                bent = [each for each in h if len(h) == 1 or Expression(each, names).value.degree > 1]
                used = not self.straight(h) and (len(h) == 1 or any(re.search(rf"y{d + 1}(?![0-9])", x) for x in bent))
                if used and (i * p.m + d, j * p.m + d) not in seen:
                    seen.add((i * p.m + d, j * p.m + d))
                    yield i * p.m + d, j * p.m + d

    def border(self, S: Matrix, i: int) -> Matrix:
        """The block of S of agent i: all of it, but where agents have different exosystems."""
        start = getattr(self.problem, "place", [0] * self.problem.n)[i]
        return [row[start : start + self.problem.m] for row in S[start : start + self.problem.m]]

    def forms(self, exact: Any, mode: str, P_e: Matrix, S: Matrix, ranges: Any) -> Iterator[Matrix]:
        """The matrices that have to be negative definite in a mode."""
        p, m, size = self.problem, self.problem.m, len(P_e)
        A, M, extra = (identity(size, ZERO) for _ in range(3))
        for i, c, d in ((i, c, d) for i in range(p.n) for c in range(m) for d in range(m)):
            A[i * m + c][i * m + d] -= p.gains[i][c][d] if i in p.gains else 0
            M[i * m + c][i * m + d] += self.border(S, i)[c][d]
        channels = []  # row, column of the agent, column of the other one, g0, D
        for i, j, w, c, d in ((*arc, c, d) for arc in p.modes[mode] for c in range(m) for d in range(m)):
            lo, hi = ranges[self.exceptions.get((i, j), p.file.coupling.h)][c][d]
            channels += [(i * m + c, i * m + d, j * m + d, w * (lo + hi) / 2, w * (hi - lo) / 2)] if lo or hi else []
        taus = read(exact.multipliers.get(mode, []), (rational,) * (len(channels) if exact.method == "lure" else 0))
        for k, (b, own, other, g0, D) in enumerate(channels):
            A[b][other], A[b][own] = A[b][other] + g0, A[b][own] - g0
            if exact.method == "lure":
                need(taus[k] > 0 if D else taus[k] == 0, "a multiplier is not positive")
                M[b][b] += 1 / (2 * taus[k]) if D else 0
                for x, y, sign in ((own, own, 1), (other, other, 1), (own, other, -1), (other, own, -1)):
                    extra[x][y] += sign * 2 * taus[k] * D**2
            elif exact.method == "interval" and D:
                z = {own: -1, other: 1}
                for x in range(size):
                    extra[x][x] += D * sum(abs(P_e[x][b] * z.get(y, 0) + z.get(x, 0) * P_e[y][b]) for y in range(size))
        need(exact.method in ("lure", "interval", "vertices"), "the method is none of lure, interval and vertices")
        free = [channel for channel in channels if channel[-1] and exact.method == "vertices"]
        need(len(free) <= 12, "there are too many vertices")
        for signs in itertools.product((-1, 1), repeat=len(free)):
            corner = [list(row) for row in A]
            for sign, (b, own, other, _, D) in zip(signs, free, strict=True):
                corner[b][other], corner[b][own] = corner[b][other] + sign * D, corner[b][own] - sign * D
            half = plus(product(P_e, corner), exact.rate, P_e)
            yield plus(plus(plus(half, 1, transpose(half)), 1, product(product(P_e, M), P_e)), 1, extra)

    # --- exhaustive
    def exhaustive(self, check: Any) -> None:
        """V decreases near the target as lure says, and farther out in every box of a tree."""
        p, size = self.problem, self.problem.n * self.problem.m
        need(size <= COMPONENTS, f"boxes are followed for up to {COMPONENTS} components")
        claim = self.inequality(check.exact, {"outer": rational, "half": rational, "tree": text})
        self.slower(check, claim)
        need(claim.level is not None, "there is no level")
        need(claim.outer >= claim.level, "the outer level is below the level")
        self.ball(check.domain, claim, claim.outer)
        top, bottom = claim.half.numerator, claim.half.denominator
        need(top > 0, "half is not positive")
        few = (top // (top & -top)).bit_length()
        need(few <= 20 and bottom & (bottom - 1) == 0, "half is no integer of 20 bits times a power of 2")
        need(claim.half < 2**200, "half leaves the range of numbers followed here")
        need(
            all(inside(claim.form, z, claim.outer, claim.half) for z in identity(size, Fraction(1))),
            "the outer level set leaves the box",
        )
        half = float(claim.half)
        boxes = leaves(claim.tree, ((-half,) * size, (half,) * size))
        fields, room = [self.field(mode, claim) for mode in p.modes], PIECES
        for box in boxes:
            room -= self.pieces(fields, box, enclosed(claim.level)[0], enclosed(claim.outer)[1])
            need(room > 0, "too many boxes have to be cut further")

    def pieces(self, fields: list[Field], whole: Box, level: float, outer: float) -> int:
        """V is shown to decrease in a box, cut further where that is needed: into how many pieces more."""
        left, cuts = [(whole, FURTHER)], 0
        while left:
            box, halvings = left.pop()
            if not self.settled(fields, box, level, outer):
                need(halvings > 0, "V is not shown to decrease in a box")
                widths = [hi - lo for lo, hi in zip(*box, strict=True)]
                left += [(part, halvings - 1) for part in halves(box, widths.index(max(widths)))]
                cuts += 1
        return cuts

    def settled(self, fields: list[Field], box: Box, level: float, outer: float) -> bool:
        P = fields[0].P
        try:
            return within(P, box, level) or beyond(P, box, outer) or all(field.falls(box) for field in fields)
        except Refused:
            return False  # a coupling is not defined on all of it, perhaps on its parts

    def field(self, mode: str, claim: Any) -> Field:
        p, m, P_e = self.problem, self.problem.m, claim.form
        K, S = identity(len(P_e), ZERO), identity(len(P_e), ZERO)
        for i, c, d in ((i, c, d) for i in range(p.n) for c in range(m) for d in range(m)):
            K[i * m + c][i * m + d] += p.gains[i][c][d] if i in p.gains else 0
            S[i * m + c][i * m + d] += self.border(claim.S, i)[c][d]
        half = plus(product(P_e, K), -claim.rate, P_e)
        M = plus(product(product(P_e, S), P_e), -1, plus(half, 1, transpose(half)))
        arcs = [
            (self.curve(h, False), enclosed(w), i * m + c, j * m + c)
            for i, heard in enumerate(self.heard[mode])
            for h, w, j in heard
            for c in range(m)
        ]
        return Field([[enclosed(x) for x in row] for row in M], [[enclosed(x) for x in row] for row in P_e], arcs)

    # --- settling
    def settling(self, check: Any) -> None:
        """|e|_inf is small from a time on, by one certificate after the other."""
        p: Any = self.problem
        last: Any = None
        need(check.rate is None, "it has no rate to claim")
        self.start(check.domain, "box")
        exact = read(
            check.exact,
            {
                "tolerance": rational,
                "time": rational,
                "stages": [
                    {
                        "kind": text,
                        "start": rational,
                        "level": rational,
                        "height": rational,
                        "noise": rational,
                        "stretch": rational,
                        "certificate": an_object,
                        "diagonal?": positive_vector(p.n * p.m),
                        "factor?": rational,
                    }
                ],
            },
        )
        need(1 <= len(exact.stages) <= STAGES, f"there is not between 1 and {STAGES} stages")
        for stage in exact.stages:
            need(stage.noise >= 0 and stage.level > 0 and stage.height > 0 and stage.stretch > 0, "a size is negative")
            need(p.q > 0 or (stage.noise == 0 and stage.stretch == 1), "there is no exosystem")
            self.open(stage, last)
            if last is None:
                need(stage.start == 0 and stage.stretch == 1, "the first stage does not begin at 0, unstretched")
                (self.first_quadratic if stage.quadratic else self.first_separable)(stage, check.domain)
            else:
                self.handed(last, stage)
            if not stage.quadratic:  # rho > 0 by now
                self.rows(stage.claim, stage.claim.alpha, Fraction(1))
            last = stage
        need(exact.time >= last.start, "the time is before the start of the last stage")
        top = last.height * last.level * fading(last.pace * (exact.time - last.start))
        need(top <= exact.tolerance, "the tolerance is not reached by then")

    def open(self, stage: Any, last: Any) -> None:
        """What the certificate of a stage claims: pace is the rate of its size, fade that of the noise."""
        p = self.problem
        need(stage.kind in ("max-separable", "quadratic"), "the kind is neither max-separable nor quadratic")
        stage.quadratic, before = stage.kind == "quadratic", last is not None and last.quadratic
        need(stage.quadratic or not before, "a max-separable stage follows a quadratic one")
        need((stage.diagonal is not None) == (stage.quadratic and not before), "diagonal is there, or is not")
        need((stage.factor is not None) == (stage.quadratic and before), "factor is there, or is not")
        if stage.diagonal is not None:
            tops, bottom = stage.diagonal
            stage.diagonal = [Fraction(x, bottom) for x in tops]
        if stage.quadratic:
            stage.claim = claim = self.inequality(stage.certificate)
            stage.pace = stage.fade = claim.rate
            good = all(inside(claim.form, z, Fraction(1), stage.height) for z in identity(p.n * p.m, Fraction(1)))
        else:
            stage.claim = claim = self.separable(stage.certificate)
            stage.pace, stage.fade = claim.pace, claim.beta if p.q else ZERO
            need(claim.rho is not None or p.domain == "global", "it has no rho, and the couplings are not all linear")
            if p.q:
                self.composite(claim)
            claim.v = [Fraction(x, claim.bottom) for x in claim.tops]
            good = stage.height >= max(claim.v)
        need(good, "the height is too small")
        need(stage.pace > 0, "a stage does not decrease")

    def first_separable(self, stage: Any, domain: Any) -> None:
        claim, s = stage.claim, domain.disturbance
        room = stage.level - domain.radius / claim.lowest
        need(room >= 0, "the box of starts leaves the level")
        need(s == 0 or (claim.kappa * s) ** 2 * claim.size <= room**2, "the disturbance leaves the level")
        need(claim.rho is None or stage.level <= claim.rho, "the level leaves the region")
        need(s == 0 or stage.noise**2 >= claim.size * s**2, "the noise is larger")

    def first_quadratic(self, stage: Any, domain: Any) -> None:
        claim, s, square = stage.claim, domain.disturbance, stage.level**2
        need(below_diagonal(claim.form, stage.diagonal), "P_e <= diagonal is not shown")
        cost = s**2 * largest(claim.P) if s else ZERO
        size = domain.radius**2 * sum(stage.diagonal) + self.problem.n * cost
        need(size <= square, "the box of starts leaves the level")
        need(claim.level is None or square <= claim.level, "the level leaves the region")
        need(stage.noise**2 >= cost, "the noise is larger")

    def handed(self, last: Any, stage: Any) -> None:
        """From one stage to the next: where the old one has come to lies inside the new one."""
        p, old, new, stretch = self.problem, last.claim, stage.claim, stage.stretch
        elapsed = stage.start - last.start
        need(elapsed >= 0, "a stage begins before the one it follows")
        c, noise = (x * fading(r * elapsed) for x, r in ((last.level, last.pace), (last.noise, last.fade)))
        if p.q:
            need(
                nonnegative(
                    plus(identity(p.q, ZERO), 1, plus([[stretch**2 * x for x in row] for row in old.P], -1, new.P))
                ),
                "P' <= stretch^2 P is not shown",
            )
            need(stage.noise >= stretch * noise, "the noise is larger")
        if not stage.quadratic:
            g = max(a / b for a, b in zip(old.v, new.v, strict=True))
            need(new.rho is None or g * c <= new.rho, "the level leaves the region")
            more = max(ZERO, new.kappa * stretch - g * old.kappa) * min(noise, c / old.kappa) if p.q else ZERO
            need(stage.level >= g * c + more, "the level is larger")
        elif not last.quadratic:
            for a, b in self.relied() if new.radius is not None else ():
                need(c * (old.v[a // p.m] + old.v[b // p.m]) <= new.radius, "the level leaves the region")
            need(below_diagonal(new.form, stage.diagonal), "P_e <= diagonal is not shown")
            square = c**2 * sum(x * old.v[k // p.m] ** 2 for k, x in enumerate(stage.diagonal))
            need(stage.level**2 >= square + p.n * stage.noise**2, "the level is larger")
        else:
            self.contained(old.form, c**2, new.radius)
            need(
                nonnegative(plus([[stage.factor * x for x in row] for row in old.form], -1, new.form)),
                "P_e' <= factor P_e is not shown",
            )
            need(stage.level**2 >= max(stage.factor, stretch**2 if p.q else ZERO) * c**2, "the level is larger")
