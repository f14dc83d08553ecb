"""V' < 0 on a shell around the consensus, box by box: what a quadratic certificate leaves open in small networks.

A ``Lure`` settles {V <= level}.  On e'P_e e <= outer, V' <= -2 rate V follows from phi(e) < 0, where in every mode

    phi(e) = e'M e + sum over channels of 2 w (P_e e)_i h(e_j - e_i),
    M = -(P_e K + K'P_e) + P_e (I (x) S) P_e + 2 rate P_e        (theory, sections 2 and 4; S: the observer's border).

On a box phi is at most its value in the middle plus half widths times bounds of its slopes.  h and h' are enclosed
exactly; the rest is float64 with a bound of all rounding.  The inner certificate is decided first, then every box.
docs/certificate-claims.md, "Regions", fixes the form of the check `exhaustive`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dobc_design.conditions.check import Check, read_object, starts_in, undecided_check
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic import decide as quadratic
from dobc_design.conditions.quadratic.claim import Lure, held_matrix
from dobc_design.conditions.quadratic.decide import LureDecision, border_of, covers, diagonal_of_inverse, verify_lure
from dobc_design.coupling.enclosures import Curve, slope_form, value_form
from dobc_design.errors import ShapeError, SpecError
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_above, float_below, number_text
from dobc_design.exact.work import spend
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LARGEST: Final = 6  # rows n m up to which boxes are counted out; their number grows like a power of n m
#: Numbers outside of this range are refused, so that no product of theirs is subnormal or infinite.
SMALLEST, LARGEST_NUMBER = Fraction(1, 10**100), Fraction(10**100)
LEAF: Final = "."
UNIT_ROUNDOFF: Final = 2.0**-53
UNDERFLOW: Final = 1e-290  # more than products too small for a double can add up to


@dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """A claim: {V <= outer} is invariant and V' <= -2 rate V in it; V and rate are of ``lure``, whose level is smaller.

    ``half``: the first box is |e_k| <= half.  ``tree``: how it is cut up, breadth first: a digit halves the box along
    that coordinate (the lower half comes first), "." leaves it.
    Raises: SpecError for what cannot be a claim.
    """

    lure: Lure
    outer: Fraction
    half: Fraction
    tree: str

    def __post_init__(self) -> None:
        level = self.lure.level
        if level is None or self.outer < level or self.half <= 0:
            raise SpecError("outer must be at least the level of the inner certificate, and half > 0.", key="outer")

    @property
    def whole(self) -> Lure:
        """Its V with the outer level; not a certificate by itself."""
        return replace(self.lure, level=self.outer)

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        outer = {"outer": number_text(self.outer), "half": number_text(self.half), "tree": self.tree}
        return self.lure.to_json() | outer


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Form:
    """Phi of one mode in floats, nearest to the exact: M, P_e (N, N); h(e[plus] - e[target]) acts on row ``target``."""

    M: Array
    P_e: Array
    target: Indices
    plus: Indices
    weight: Array
    curve: Indices
    ranges: Ranges


@dataclass(slots=True, eq=False)
class Ranges:
    """Enclosures of h and h' on intervals with float ends, each computed once.  Infinite where undefined."""

    curves: tuple[Curve, ...]
    known: dict[tuple[int, float, float], tuple[float, ...]] = field(default_factory=dict)

    def look_up(self, curve: Indices, low: Array, high: Array) -> tuple[Array, Array, Array, Array]:
        """H from, h to, h' from, h' to, outwards; shapes (boxes, channels), ``curve`` (channels,)."""
        keys = np.stack([np.broadcast_to(curve.astype(float), low.shape), low, high], axis=-1).reshape(-1, 3)
        unique, places = np.unique(keys, axis=0, return_inverse=True)
        table = np.array([self._of(int(k), a, b) for k, a, b in unique.tolist()]).reshape(-1, 4)
        found = table[places.ravel()].reshape(*low.shape, 4)
        return found[..., 0], found[..., 1], found[..., 2], found[..., 3]

    def _of(self, curve: int, low: float, high: float) -> tuple[float, ...]:
        key = (curve, low, high)
        if key not in self.known:
            h, Y = self.curves[curve], Interval(Fraction(low), Fraction(high))
            spend(2 * h.programs.cost)
            try:
                self.known[key] = (*value_form(h, Y).floats(), *slope_form(h, Y).floats())
            except UndefinedError:
                self.known[key] = (-np.inf, np.inf, -np.inf, np.inf)
        return self.known[key]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boxes:
    """Boxes by their centres and half widths, both (boxes, N), exact in float64."""

    centres: Array
    halves: Array

    def __len__(self) -> int:
        return len(self.centres)

    def chosen(self, mask: NDArray[np.bool_]) -> Boxes:
        return Boxes(centres=self.centres[mask], halves=self.halves[mask])

    def split(self, along: Indices) -> Boxes:
        """Every box in two along one coordinate each, the lower half first."""
        rows = np.arange(len(self))
        halves = self.halves.copy()
        halves[rows, along] /= 2
        step = np.zeros_like(halves)
        step[rows, along] = halves[rows, along]
        centres = np.stack([self.centres - step, self.centres + step], axis=1)
        return Boxes(centres=centres.reshape(-1, self.centres.shape[1]), halves=np.repeat(halves, 2, axis=0))


def build_forms(problem: Problem, lure: Lure, *, S: Matrix | None, rate: Fraction) -> Mapping[str, Form]:
    """Phi of every mode.  Raises: SpecError for more than LARGEST rows, or couplings that do not act by component."""
    size, m = problem.n * problem.m, problem.m
    if size > LARGEST:
        raise SpecError(f"the exhaustive method takes at most {LARGEST} rows n m; got {size}.", key="network.agents")
    if (loose := problem.network.loose) is not None:
        raise SpecError(f"the exhaustive method does not apply: arcs of mode {loose} come and go.", key="network.modes")
    if problem.node is not None or not all(coupling.by_component for coupling in problem.couplings):
        raise SpecError("the exhaustive method needs couplings that act by component.", key="coupling.h")
    if lure.P_e.size != size:
        raise ShapeError(f"P_e must have {size} rows; got {lure.P_e.size}.", key="P_e")
    M = _floats(held_matrix(problem, lure.P_e, rate=rate, S=S).to_dense())
    P_e = _floats(lure.P_e.to_dense())
    ranges = Ranges(tuple(Curve(coupling.components[0]) for coupling in problem.couplings))
    forms = {}
    for name, arcs in problem.network.modes.items():
        weights = _floats(tuple((weight,) for _, _, weight in arcs)).reshape(-1)
        ends = [(i * m + c, j * m + c, problem.coupling_place(i, j)) for i, j, _ in arcs for c in range(m)]
        target, plus, curve = np.array(ends, dtype=np.intp).reshape(-1, 3).T
        weight = np.repeat(weights, m)
        forms[name] = Form(M=M, P_e=P_e, target=target, plus=plus, weight=weight, curve=curve, ranges=ranges)
    return forms


def upper_bounds(form: Form, boxes: Boxes) -> tuple[Array, Array, Array]:
    """A number that is at least phi on each box (boxes,), the size of its terms, and the width that each side adds.
    Infinite where a coupling is not defined on the whole of its interval."""
    c, w = boxes.centres, boxes.halves
    M, P = form.M, form.P_e
    y = c[:, form.plus] - c[:, form.target]
    reach = w[:, form.plus] + w[:, form.target]
    with np.errstate(invalid="ignore", over="ignore"):
        low, high, *_ = form.ranges.look_up(form.curve, y, y)
        p, p_size = (c @ P)[:, form.target], (np.abs(c) @ np.abs(P))[:, form.target]
        terms = 2 * form.weight * np.maximum(p * low, p * high)
        middle = np.sum((c @ M) * c, axis=1) + np.sum(terms, axis=1)
        sizes = 2 * form.weight * p_size * np.maximum(np.abs(low), np.abs(high))
        size = np.sum((np.abs(c) @ np.abs(M)) * np.abs(c), axis=1) + np.sum(sizes, axis=1)
        bottom, top, slopes = _slopes(form, boxes, y - reach, y + reach)
        steepest = np.sum(w * np.maximum(np.abs(bottom), np.abs(top)), axis=1)
        size = size + np.sum(w * slopes, axis=1)
        spread = w * (top - bottom)
        # Every term passes at most this many roundings, those of the coefficients included.
        roundings = 8 * (len(M) + len(form.target)) + 64
        bound = middle + steepest + 2 * roundings * UNIT_ROUNDOFF * size + UNDERFLOW
    return np.where(np.isfinite(bound), bound, np.inf), size, np.where(np.isfinite(spread), spread, w)


def _slopes(form: Form, boxes: Boxes, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """The range of every partial derivative of phi on each box, and the size of its terms; (boxes, N) each."""
    c, w = boxes.centres, boxes.halves
    M, P = form.M, form.P_e
    from_, to, slope_from, slope_to = form.ranges.look_up(form.curve, low, high)
    linear, width = 2 * (c @ M), 2 * (w @ np.abs(M))
    bottom, top = linear - width, linear + width
    size = 2 * (np.abs(c) @ np.abs(M)) + width
    p, q = (c @ P)[:, form.target], (w @ np.abs(P))[:, form.target]
    p_size = (np.abs(c) @ np.abs(P))[:, form.target] + q
    corners = np.stack([(p + s * q) * d for s in (-1, 1) for d in (slope_from, slope_to)])
    least, most = 2 * form.weight * np.min(corners, axis=0), 2 * form.weight * np.max(corners, axis=0)
    largest = 2 * form.weight * p_size * np.maximum(np.abs(slope_from), np.abs(slope_to))
    for k in range(len(form.target)):
        # d/de of 2 w (P_e e)_i h(e_j - e_i): the row of P_e times h, and (P_e e)_i h' at the two ends
        row, weight = P[form.target[k]], 2 * form.weight[k]
        ends = np.stack([weight * from_[:, k, None] * row, weight * to[:, k, None] * row])
        bottom, top = bottom + np.min(ends, axis=0), top + np.max(ends, axis=0)
        size = size + np.max(np.abs(ends), axis=0)
        plus, minus = form.plus[k], form.target[k]
        bottom[:, plus] += least[:, k]
        top[:, plus] += most[:, k]
        bottom[:, minus] -= most[:, k]
        top[:, minus] -= least[:, k]
        size[:, plus] += largest[:, k]
        size[:, minus] += largest[:, k]
    return bottom, top, size


def energy_bounds(P_e: Array, boxes: Boxes) -> tuple[Array, Array]:
    """Numbers that are at most and at least e'P_e e on each box, for a positive definite P_e, nearest floats given."""
    c, w = boxes.centres, boxes.halves
    middle, step = np.sum((c @ P_e) * c, axis=1), 2 * np.sum(np.abs(c @ P_e) * w, axis=1)
    size = np.sum(((np.abs(c) + w) @ np.abs(P_e)) * (np.abs(c) + w), axis=1)
    slack = 2 * (8 * len(P_e) + 64) * UNIT_ROUNDOFF * size
    least = middle - step  # the tangent lies below a convex function
    if np.count_nonzero(P_e - np.diag(np.diag(P_e))) == 0:
        near = np.maximum(np.abs(c) - w, 0.0)
        least = np.maximum(least, np.sum(near * near * np.diag(P_e), axis=1))
    most = middle + step + np.sum((w @ np.abs(P_e)) * w, axis=1)
    return least - slack - UNDERFLOW, most + slack + UNDERFLOW


def first_box(size: int, half: Fraction) -> Boxes:
    """|e_k| <= half.  Raises: SpecError if half is no short float of a moderate size."""
    odd = half.numerator // max(1, half.numerator & -half.numerator)
    if not SMALLEST < half < LARGEST_NUMBER or Fraction(float(half)) != half or odd.bit_length() > 20:
        raise SpecError("half must be a dyadic number of at most 20 bits, between 1e-100 and 1e100.", key="half")
    return Boxes(centres=np.zeros((1, size)), halves=np.full((1, size), float(half)))


def _floats(M: Matrix) -> Array:
    """Nearest floats.  Raises: SpecError for a number so large or small that products of such would lose accuracy."""
    if not all(SMALLEST < abs(x) < LARGEST_NUMBER for row in M for x in row if x):
        raise SpecError("the boxes are tested in floating point: numbers must lie between 1e-100 and 1e100.")
    return np.array([[float(x) for x in row] for row in M], dtype=np.float64)


#: The keys of ``exact`` beside those of ``lure``.
NAMES: Final = ("outer", "half", "tree")
CHUNK: Final = 20_000  # boxes looked at together
MOST_BOXES: Final = 4_000_000
MOST_HALVINGS: Final = 30  # of one component: then all ends of boxes are exact in float64


def verify_shell(problem: Problem, shell: Shell) -> LureDecision:
    """Decide whether {V <= outer} is invariant and V' <= -2 rate V in it, for every mode.  Refuted: the inner
    certificate is, or the boxes do not fit.  Undecided: a box is not shown to be harmless; the step is then "boxes".
    Raises: SpecError for more than 6 rows n m or couplings of vectors."""
    inner = verify_lure(problem, shell.lure)
    if inner.verdict is not Verdict.PROVED:
        return inner
    # Outer (P_e^-1)_kk <= half^2 for every k.
    if not all(shell.outer * square <= shell.half**2 for square in diagonal_of_inverse(shell.lure.P_e)):
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="{V <= outer} reaches beyond the first box.")
    leaves = _leaves(shell, problem.n * problem.m)
    if leaves is None:
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="the tree does not describe boxes.")
    S = border_of(problem, shell.lure, shell.lure.rate)
    if shell.lure.P is not None and S is None:  # cannot be: it was proved
        return LureDecision(verdict=Verdict.UNDECIDED, step="observer", reason="Omega0 + 2 rate P < 0 is not shown.")
    forms = build_forms(problem, shell.lure, S=S, rate=shell.lure.rate)
    P_e = next(iter(forms.values())).P_e
    inside, outside = float_below(shell.lure.level or Fraction(0)), float_above(shell.outer)
    for start in range(0, len(leaves), CHUNK):
        boxes = Boxes(centres=leaves.centres[start : start + CHUNK], halves=leaves.halves[start : start + CHUNK])
        least, most = energy_bounds(P_e, boxes)
        rest = boxes.chosen(~((most <= inside) | (least >= outside)))  # a bound that is no number leaves the box in
        for mode, form in forms.items():
            if len(rest) and not np.all(upper_bounds(form, rest)[0] < 0):
                reason = f"V' < 0 is not shown in some box of the shell in mode {mode}."
                return LureDecision(verdict=Verdict.UNDECIDED, step="boxes", mode=mode, reason=reason)
    return LureDecision(
        verdict=Verdict.PROVED,
        reason=f"V decreases, V' <= -2 ({float(shell.lure.rate):.4g}) V, while V <= {float(shell.outer):.6g}:"
        f" {len(leaves)} boxes around {{V <= {float(shell.lure.level or 0):.6g}}}.",
    )


def _leaves(shell: Shell, size: int) -> Boxes | None:
    """The boxes that the tree leaves; None if it is no tree."""
    codes = np.frombuffer(shell.tree.encode("ascii", errors="replace"), dtype=np.uint8)
    if len(codes) > MOST_BOXES:
        return None
    start, level, kept = 0, first_box(size, shell.half), list[Boxes]()
    while len(level):
        part = codes[start : start + len(level)]
        along = part.astype(np.intp) - ord("0")
        stays = part == ord(LEAF)
        if len(part) < len(level) or not np.all(stays | ((along >= 0) & (along < size))):
            return None
        start += len(level)
        kept.append(level.chosen(stays))
        level = level.chosen(~stays).split(along[~stays])
        if len(level) and float(np.min(level.halves)) < float(shell.half) * 2.0**-MOST_HALVINGS:
            return None
    if start != len(codes):
        return None
    centres, halves = zip(*((each.centres, each.halves) for each in kept), strict=True)
    return Boxes(centres=np.concatenate(centres), halves=np.concatenate(halves))


def exhaustive_check(
    problem: Problem,
    W: Matrix | None,
    shell: Shell,
    *,
    radius: float,
    disturbance: float,
    domain: str,
    remark: str = "",
) -> Check:
    """Decide ``shell`` as a proof for every start with |e| <= radius and |eps_i| <= disturbance; see ``lure_check``."""
    reason = quadratic.quadratic_obstacle(problem, W)
    if reason is not None:
        return undecided_check("exhaustive", domain, reason, applies=False)
    decision = verify_shell(problem, shell)
    if decision.verdict is not Verdict.PROVED:
        return undecided_check("exhaustive", domain, decision.reason)
    if not covers(problem, shell.whole, radius=claimed(radius), disturbance=claimed(disturbance)):
        return undecided_check("exhaustive", domain, "the ball asked for is not inside the invariant set.")
    decrease = quadratic.decrease_in_words(problem, shell.whole, radius, disturbance)
    return Check(
        id="exhaustive",
        verdict=Verdict.PROVED,
        rate=quadratic.rate_of(shell.lure),
        domain=starts_in("ball", radius, disturbance),
        claim=shell,
        reason=f"{decrease}: near the target by a quadratic certificate, farther out in {shell.tree.count('.')} boxes,"
        f" one by one{quadratic.in_every_mode(problem)}.{remark}",
    )


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything that a proved check of this topic claims is confirmed, else what is not."""
    del domain
    reason = quadratic.wrong_outside(check, problem, W)
    if reason is not None:
        return reason
    shell = read_claim(check, problem, W)
    if not quadratic.ball_is_inside(problem, shell.whole, check.domain):
        return "the ball is not inside the invariant set"
    return quadratic.not_shown(check, problem, shell.lure, verify_shell(problem, shell))


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Shell:
    """What a proved check claims, for this problem and the gain W (q, m); raises as ``lure_from_json``."""
    names = quadratic.names_of(problem)
    values = read_object(check.exact, (*names, *NAMES))
    lure = quadratic.lure_from_json({name: values[name] for name in names}, problem, W)
    if not isinstance(values["tree"], str):
        raise TypeError("tree must be text")
    outer, half = read_rational(values["outer"]), read_rational(values["half"])
    return Shell(lure=lure, outer=outer, half=half, tree=values["tree"])
