"""The exhaustive proof of the region asked for, for small networks: boxes around a quadratic certificate.

Theory, section 4.  ``grow_shell`` cuts up the set between two levels of V, ``decide`` looks at every box again.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.boxes import decide
from dobc_design.conditions.boxes.decide import LARGEST, LEAF, Boxes, Form, Shell, exhaustive_check
from dobc_design.conditions.check import Check, surviving, undecided_check
from dobc_design.conditions.coverage import Asked, Progress
from dobc_design.conditions.numbers import claimed, rounded_down
from dobc_design.conditions.quadratic.claim import Lure, Shape
from dobc_design.conditions.quadratic.decide import border_of, certified_ball, eigenvalue_bound, quadratic_obstacle
from dobc_design.conditions.quadratic.propose import linear_rate
from dobc_design.conditions.quadratic.stage import propose
from dobc_design.conditions.separable.claim import acts_by_component
from dobc_design.coupling.expression import numpy_function
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.work import STAGE, WorkLimitError, at_most, exhausted
from dobc_design.problem.problem import Problem
from dobc_design.solvers.program import Array

RAYS: Final = 4000
STEPS: Final = 60
HALVINGS: Final = 12
WIDTHS: Final = (0.3, 0.1, 0.03, 0.01)  # of the cones of directions around the worst, in turn
KEPT, TRIALS = 20, 25
MOST_OPEN: Final = 100_000  # boxes that may be open at once, or left in the end
MOST_DEPTH: Final = 90
SHORT_OF: Final = (0.998, 0.993, 0.985, 0.95, 0.8)  # of the radius at which V' >= 0 was seen, in turn
STRETCHED: Final = 8  # how many times the largest start a coordinate may become
SLACK: Final = 1e-7  # of the terms, for whoever looks at the boxes again


def grow_shell(
    problem: Problem,
    lure: Lure,
    *,
    S: Matrix | None = None,
    largest: Fraction = Fraction(20),
    most: int = MOST_OPEN,
    least: Fraction = Fraction(0),
) -> Shell | None:
    """The shell around a proved certificate; None if no box proof reaches beyond its level.

    ``S`` (m, m): the observer's border at the certificate's rate, exact; None without a pair.  ``largest``: no start
    with |e| beyond it is looked at.  ``most``: boxes that may be open at once, and that may be left in the end.
    ``least``: no smaller ``outer`` is worth the time.  The rate is the certificate's.
    Raises: SpecError for more than 6 rows n m or couplings of vectors.
    """
    if lure.level is None:
        return None
    forms = list(decide.build_forms(problem, lure, S=S, rate=lure.rate).values())
    P_e, level = forms[0].P_e, float(lure.level) * (1 - 1e-12)
    top = _seen(forms, P_e, level, float(np.linalg.eigvalsh(P_e)[-1]) * float(largest) ** 2)
    widest = math.sqrt(float(np.max(np.diag(np.linalg.inv(P_e)))))
    for part in SHORT_OF:
        outer = top * part**2
        if outer <= max(level, float(least)) * (1 + 1e-6) or widest * math.sqrt(outer) > STRETCHED * float(largest):
            continue
        reach = widest * math.sqrt(outer) * (1 + 1e-9)
        unit = 2.0 ** (math.frexp(reach)[1] - 12)  # 12 bits are kept, rounded up
        half = Fraction(math.ceil(reach / unit)) * Fraction(unit)
        box, last = decide.first_box(len(P_e), half), part == SHORT_OF[-1]
        found = _cut(forms, P_e, box, level, outer, most=most, last=last)
        exact = Fraction(0) if found is None else rounded_down(found[1] * (1 - 1e-9), digits=9)
        if found is not None and exact > lure.level:
            return Shell(lure=lure, outer=exact, half=half, tree=found[0])
    return None


def _seen(forms: list[Form], P_e: Array, level: float, limit: float) -> float:
    """About the smallest e'P_e e above the level at which V' >= 0 is met; the limit if it is not met up to there."""
    rng = np.random.default_rng(0)
    scale = np.asarray(np.linalg.inv(np.linalg.cholesky(P_e)).T, dtype=np.float64)  # e = scale v has e'P_e e = v'v
    size = len(P_e)
    directions = np.concatenate([rng.standard_normal((RAYS, size)), np.eye(size), -np.eye(size)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    low, high = level, limit
    for value in np.geomspace(level, limit, STEPS)[1:].tolist():
        if np.any(_rises(forms, math.sqrt(value) * directions @ scale.T) >= 0):
            high = value
            break
    best = directions
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        highest, best = _steepest(forms, scale, middle, np.concatenate([best, directions[:RAYS:8]]), rng)
        low, high = (low, middle) if highest >= 0 else (middle, high)
    return high


def _steepest(
    forms: list[Form], scale: Array, value: float, directions: Array, rng: np.random.Generator
) -> tuple[float, Array]:
    """The largest V' found on {e'P_e e = value}, by random steps around the best directions, and those."""
    for width in WIDTHS:
        rises = _rises(forms, math.sqrt(value) * directions @ scale.T)
        best = directions[np.argsort(-rises)[:KEPT]]
        near = np.repeat(best, TRIALS, axis=0)
        near = near + width * rng.standard_normal(near.shape)
        directions = np.concatenate([best, near / np.linalg.norm(near, axis=1, keepdims=True)])
    rises = _rises(forms, math.sqrt(value) * directions @ scale.T)
    order = np.argsort(-rises)[:KEPT]
    return float(rises[order[0]]), directions[order]


def _rises(forms: list[Form], e: Array) -> Array:
    """The largest V' of any mode at points, in floats; inf where a coupling is not defined."""
    found = []
    for form in forms:
        total, y, p = np.sum((e @ form.M) * e, axis=1), e[:, form.plus] - e[:, form.target], (e @ form.P_e)
        for k, target in enumerate(form.target.tolist()):
            h = numpy_function(form.ranges.curves[int(form.curve[k])].expression)
            with np.errstate(all="ignore"):
                total = total + 2 * form.weight[k] * p[:, target] * h(y[:, k])
        found.append(np.where(np.isfinite(total), total, np.inf))
    return np.asarray(np.max(found, axis=0))


def _cut(
    forms: list[Form], P_e: Array, boxes: Boxes, level: float, outer: float, *, most: int, last: bool
) -> tuple[str, float] | None:
    """Halve boxes until V' < 0 is shown in all of the shell; (tree, outer).  None if that takes more than ``most``
    boxes.  In the last try ``outer`` is lowered to what is shown with the open ones."""
    tree: list[str] = []
    left = 0
    for depth in range(MOST_DEPTH):
        if not len(boxes):
            return "".join(tree), outer
        lowest, highest = decide.energy_bounds(P_e, boxes)
        opened = (highest > level) & (lowest < outer)
        if depth == MOST_DEPTH - 1 or int(np.count_nonzero(opened)) > most:
            if not last:
                return None
            outer = float(np.min(lowest[opened]))  # what is still open is left outside
            tree.append(LEAF * len(boxes))
            return ("".join(tree), outer) if outer > level else None
        along, places = np.zeros(len(boxes), dtype=np.intp), np.flatnonzero(opened)
        rest = boxes.chosen(opened)
        open_still = np.zeros(len(rest), dtype=bool)
        for form in forms:
            bound, size, spread = decide.upper_bounds(form, rest)
            bad = ~(bound + SLACK * size < 0)
            along[places[bad]] = np.argmax(spread[bad], axis=1)
            open_still |= bad
        opened[places] = open_still
        left += len(boxes) - int(np.count_nonzero(opened))
        if left > most:
            return None
        signs = zip(along.tolist(), opened.tolist(), strict=True)
        tree.append("".join(str(k) if split else LEAF for k, split in signs))
        boxes = boxes.chosen(opened).split(along[opened])
    return None


SMALL: Final = 4  # rows n m up to which boxes are counted out without being asked for
MOST_BOXES: Final = 50_000  # that a certificate may hold, so that a checker in plain Python gets through them
#: Starts up to this many times the ball asked for, or that of the inner certificate, are looked at.
BEYOND: Final = 2
RATES: Final = (Fraction(1, 2), Fraction(1, 10))  # of that near the consensus, tried where the region is covered


def exhaustive_stage(asked: Asked, report: Progress) -> list[Check]:
    """Boxes around the quadratic certificates, for small networks, where they may cover the region asked for."""
    problem = asked.problem
    largest = LARGEST if asked.everything else SMALL
    if not (asked.everything or asked.wanted) or problem.n * problem.m > largest or asked.domain == "global":
        return []
    reason = quadratic_obstacle(problem, asked.W)
    if reason is None and not acts_by_component(problem):
        reason = "does not apply: the exhaustive method needs couplings that act on each state component by itself."
    if reason is None and problem.network.loose is not None:
        reason = f"does not apply: arcs of mode {problem.network.loose} come and go."
    if reason is not None:
        return [undecided_check("exhaustive", asked.domain, reason, applies=False)] if asked.everything else []
    report("deciding the region (exhaustive)")
    needed = 0.0 if asked.everything else math.nextafter(asked.ball, 0.0)
    with at_most(STAGE * (2 if asked.everything else 1)):  # for each shape
        best = _shell(asked, "identity", beyond=needed)
        if best is None or asked.everything:
            best = _shell(asked, "full", beyond=needed if best is None else _ball(asked, best)) or best
        cut = exhausted()
    if best is None and cut is not None:
        return [undecided_check("exhaustive", asked.domain, cut)]
    if best is None:
        where = "reach beyond the quadratic certificate" if asked.everything else f"cover |e| <= {asked.ball:.6g}"
        many = f"too many would be needed (at most {MOST_BOXES})"
        reason = f"no boxes are found that {where}: V' < 0 fails closer in, or {many}."
        return [undecided_check("exhaustive", asked.domain, reason)]
    radius, remark = _ball(asked, best), ""
    if not asked.wanted or radius < asked.ball:
        wish = f"the region asks for {asked.ball:.6g}" if asked.wanted else "no region is asked for"
        remark = f" The ball reaches |e| <= {radius:.6g}, {wish}: beyond, this V rises somewhere, or more than"
        remark += f" {MOST_BOXES} boxes would be needed."
    starts = {"radius": radius, "disturbance": asked.disturbance}
    return [exhaustive_check(problem, asked.W, best, **starts, domain=asked.domain, remark=remark)]


def _shell(asked: Asked, shape: Shape, *, beyond: float) -> Shell | None:
    """Boxes around the largest ball of a shape; None if they prove no larger ball than ``beyond``."""
    slow = _grown(asked, shape, Fraction(0), beyond=beyond)
    if slow is None or not asked.wanted or _ball(asked, slow) < asked.ball:
        return slow
    top, whole = linear_rate(asked.problem, asked.W), math.nextafter(asked.ball, 0.0)
    rates = (rounded_down(Fraction(top) * part, digits=4) for part in RATES if top > 0)
    faster = (_grown(asked, shape, rate, beyond=max(beyond, whole)) for rate in rates)
    return next((shell for shell in faster if shell is not None), slow)


def _grown(asked: Asked, shape: Shape, rate: Fraction, *, beyond: float) -> Shell | None:
    """None also where no box proof reaches beyond the inner certificate, or a numerical library breaks down."""
    inner, shell = propose(asked, shape, rate=rate), None
    if inner is None:
        return None
    with surviving(f"no boxes ({shape})", WorkLimitError):
        shell = grow_shell(
            asked.problem,
            inner.lure,
            S=border_of(asked.problem, inner.lure, inner.lure.rate),
            largest=BEYOND * claimed(max(asked.ball, inner.radius)),
            most=MOST_BOXES,
            least=eigenvalue_bound(inner.lure.P_e) * claimed(beyond) ** 2,
        )
    return shell if shell is not None and _ball(asked, shell) > beyond else None


def _ball(asked: Asked, shell: Shell) -> float:
    return certified_ball(asked.problem, shell.whole, disturbance=asked.disturbance)
