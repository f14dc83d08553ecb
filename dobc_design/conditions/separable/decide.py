"""The max-separable certificate, decided: its rows for every agent, mode and face, all s in (0,
rho], and the observer.

PROVED means that N(e) = max_i |e_i|/v_i obeys D+ N <= -alpha N + max_i |C eps_i|/v_i while N <=
rho, for arbitrary switching.  Divided by s a row asks  sum_j w phi_j(s) <= (pull - alpha) v_i,
phi(s) = sup { h(s t)/s : -reach <= t <= step }: where h is nondecreasing, step g(s step) with the
secant gain g; else h's turning points count as well.  Intervals of s are halved until every one is
decided; the largest alpha that holds is looked for in ``propose_limits``.

With (A-WC)'P + P(A-WC) <= -2 beta P and c'c <= P for each row c of C (of all groups), E = max_i
sqrt(eps_i' P eps_i) has |C eps_i| <= E and D+ E <= -beta E; with kappa > 1/(beta min v), {N + kappa
E <= rho} is invariant and attracted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

from dobc_design._checks import noun, positional
from dobc_design.conditions.numbers import text_below
from dobc_design.coupling.enclosures import Cell, Curve, Profile, jet, profile, secant
from dobc_design.coupling.tree import ZERO
from dobc_design.errors import SpecError
from dobc_design.exact import matrix as exact
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.floats import Floats
from dobc_design.exact.interval import (
    Interval,
    IntervalMatrix,
    UndefinedError,
    interval_product,
    middle,
    points,
)
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import float_below
from dobc_design.exact.symmetric import Doubles
from dobc_design.exact.work import spend
from dobc_design.loop.loop import Loop
from dobc_design.loop.timing import Timing, predicted, sampled
from dobc_design.problem.exosystems import Exosystem
from dobc_design.verdict import Verdict

from .claim import (
    EXACT,
    FACES,
    ErrorBound,
    Errors,
    Place,
    Row,
    Separable,
    Term,
    acts_by_component,
    largest_reach,
    rows,
)
from .coordinates import rows_obstacle, seen_through
from .large import (
    ArcRows,
    Kinds,
    arc_rows,
    float_kinds,
    open_rows,
)

#: From this many arcs on, floats with outward bounds go first (fewer where a coupling falls, whose
#: exact rows take longer); and how many rows they may leave.
MANY_ARCS = 1000
MANY_FALLING = 200
MOST_LEFT = 200
_FOR = "couplings that act on each state component by itself"
NOT_BY_COMPONENT = f"does not apply: the max-separable certificate is for {_FOR}."
MOST_PIECES = 3000  # of (0, rho] looked at per row before the answer is "undecided"
_ZERO = Fraction(0)
_ONE = Fraction(1)


@noun
class SeparableAnswer:
    """Whether a Separable holds, and why; where it fails: agent (index), mode, face ("upper",
    "lower") and s."""

    verdict: Verdict
    reason: str
    agent: int | None = None
    mode: str | None = None
    face: str | None = None
    s: Fraction | None = None

    @property
    def wrong(self) -> str | None:
        """What is not proved; None if it is."""
        return None if self.verdict is Verdict.PROVED else self.reason


def proved(reason: str) -> SeparableAnswer:
    """It holds."""
    return SeparableAnswer(verdict=Verdict.PROVED, reason=reason)


def refuted(reason: str) -> SeparableAnswer:
    """These numbers fail, which says nothing against others."""
    return SeparableAnswer(verdict=Verdict.REFUTED, reason=reason)


def undecided(reason: str) -> SeparableAnswer:
    """It is not known whether it holds."""
    return SeparableAnswer(verdict=Verdict.UNDECIDED, reason=reason)


@noun
class Question:
    """Rows to be decided: the loop, v, rho (None: linear couplings), the stretch of v_j, the
    errors of weights."""

    loop: Loop
    v: Vector | Doubles
    rho: Fraction | None
    stretch: Fraction | int
    profiles: tuple[Profile, ...]
    errors: Errors

    @property
    def radius(self) -> Fraction:
        """How far out rows look; without rho couplings are linear, and every radius says the
        same."""
        return self.rho or _ONE


LINEAR = 2  # steps of work for a row of linear couplings, and
BATCH = 20  # for the rows of a mode


def verify_separable(
    loop: Loop, claim: Separable, *, stretch: Fraction | int = 1, errors: Errors = EXACT
) -> SeparableAnswer:
    """Decide the rows of ``claim`` in every mode.  REFUTED says that these numbers fail at the
    place shown, not that consensus fails.  ``stretch`` >= 1: the v_j of those who are listened to
    are multiplied by it (``timing``). ``errors``: for all weights and gains that are off by as
    much.  Raises: ShapeError, as ``rows``."""
    question = ask(loop, claim.v, rho=claim.rho, stretch=stretch, errors=errors)
    if isinstance(question, str):
        return undecided(question)
    left = None
    many = in_arrays(question)
    if many is not None:
        left = open_rows(many.arcs, many.kinds, alpha=claim.alpha, rho=question.radius)
    answer = first_failure(question, claim, left)
    if answer is not None:
        return answer
    where = "everywhere" if claim.rho is None else f"while it is at most {float(claim.rho):.6g}"
    return proved(
        "every box |e_i| <= s v_i is invariant and shrinks: max_i |e_i|/v_i decays at least like "
        f"exp(-{text_below(claim.alpha)} t) {where}, up to what the observer error adds."
    )


def coupling_profiles(
    loop: Loop, v: Vector | Doubles, *, rho: Fraction | None, stretch: Fraction | int = 1
) -> tuple[Profile, ...]:
    """Where each coupling rises and falls, as far out as the rows look.  Raises: UndefinedError
    naming the interval, or a coupling that falls between fixed nodes that differ."""
    reach = largest_reach(loop, v, stretch=stretch)
    found = []
    for coupling, most in zip(loop.functions, reach, strict=True):
        # A state between the fixed nodes has no error, but is up to ``gap`` from what it hears.
        radius = loop.gap + (_ZERO if rho is None else rho * most)
        kind = profile(Curve(coupling.components[0]), radius)
        # Then only a coupling that rises is largest where the row looks.
        if loop.gap and most and not kind.is_nondecreasing:
            raise UndefinedError(
                f'h = "{coupling.texts[0]}" is not shown to rise on |y| <= {float(radius):.6g}, as '
                "it has to between fixed nodes that differ or move."
            )
        found.append(kind)
    return tuple(found)


def ask(
    loop: Loop,
    v: Vector | Doubles,
    *,
    rho: Fraction | None,
    stretch: Fraction | int = 1,
    errors: Errors = EXACT,
) -> Question | str:
    """The question, or why the certificate does not apply."""
    if not acts_by_component(loop):
        return NOT_BY_COMPONENT
    if rho is None and not loop.is_linear:
        return (
            "does not apply: without a radius rho the rows are decided for linear couplings only."
        )
    try:
        profiles = coupling_profiles(loop, v, rho=rho, stretch=stretch)
    except UndefinedError as error:
        return f"does not apply: {error}"
    return Question(loop=loop, v=v, rho=rho, stretch=stretch, profiles=profiles, errors=errors)


class Many(NamedTuple):
    """A question of many arcs, in arrays and tables."""

    arcs: ArcRows
    kinds: Kinds


def in_arrays(question: Question) -> Many | None:
    """The question in arrays where there are many arcs; None for few, and for couplings that turn
    often."""
    loop = question.loop
    rho = question.rho
    is_rising = all(kind.is_nondecreasing for kind in question.profiles)
    if rho is None and not is_rising:
        return None
    arcs = loop.arc_count
    if arcs < (MANY_ARCS if is_rising else MANY_FALLING):
        return None
    arrays = arc_rows(loop, question.v, stretch=question.stretch, errors=question.errors)
    try:
        kinds = float_kinds(question.profiles, arrays, rho=question.radius)
    except UndefinedError:  # rows one by one may do
        return None
    return None if kinds is None else Many(arrays, kinds)


@positional
class _Batch:
    """Rows of one mode that are decided together: the faces, and the agents (None: all)."""

    mode: str
    faces: tuple[int, ...]
    agents: list[int] | None


def _batches(loop: Loop, left: Sequence[tuple[int, int]] | None) -> Iterator[_Batch]:
    """All rows, or the (row, face) in ``left``, of which row k n + i is agent i in the k-th
    mode."""
    modes = tuple(loop.modes)
    if left is None:
        for mode in modes:
            yield _Batch(mode, tuple(FACES), None)
        return
    agents: dict[tuple[int, int], list[int]] = {}
    for row, face in left:
        mode_number, agent = divmod(row, loop.n)
        # the upper face, 1, comes first
        agents.setdefault((mode_number, -face), []).append(agent)
    for (mode_number, side), chosen in sorted(agents.items()):
        for start in range(0, len(chosen), MOST_LEFT):
            yield _Batch(modes[mode_number], (-side,), chosen[start : start + MOST_LEFT])


def first_failure(
    question: Question, claim: Separable, left: Sequence[tuple[int, int]] | None
) -> SeparableAnswer | None:
    """Decide rows exactly: all, or the (row, face) that floats left; None if they are proved."""
    for batch in _batches(question.loop, left):
        spend(BATCH)
        found = rows(
            question.loop,
            question.v,
            modes=[batch.mode],
            agents=batch.agents,
            stretch=question.stretch,
            errors=question.errors,
        )
        # Both faces have the same terms, so that a row is made once for the two.
        for row, place in found:
            for face in batch.faces:
                answer = _decide(question, claim, row, place, face)
                if answer is not None:
                    return answer
    return None


def _decide(
    question: Question, claim: Separable, row: Row, place: Place, face: int
) -> SeparableAnswer | None:
    """None if the row is proved."""
    s = None
    on_face = FaceRow(row, face, question.profiles)
    if claim.rho is None:
        if on_face.linear_bound() <= (row.pull - claim.alpha) * row.own:
            return None
        # a slope that is enclosed only leaves open whether the row fails
        verdict = Verdict.REFUTED if _slopes_are_exact(question.loop) else Verdict.UNDECIDED
    else:
        verdict, s = on_face.decide(alpha=claim.alpha, rho=claim.rho)
        if verdict is Verdict.PROVED:
            return None
    if verdict is Verdict.REFUTED:
        what = "fails"
    else:
        what = "is too close to failing for the enclosures to decide"
    at = "" if s is None else f" at s = {float(s):.6g}"
    who = question.loop.labels[place.agent]
    if place.count > 1:
        who += f" (and {place.count - 1} more alike)"
    return SeparableAnswer(
        verdict=verdict,
        reason=f"the {FACES[face]} row of agent {who} in mode {place.mode} {what}{at}: try a "
        "smaller alpha or rho, or another v.",
        agent=place.agent,
        mode=place.mode,
        face=FACES[face],
        s=s,
    )


def _slopes_are_exact(loop: Loop) -> bool:
    """Whether every slope at 0 is a known number."""
    for coupling in loop.functions:
        for row in coupling.jacobian_at_zero():
            if not all(slope.is_point for slope in row):
                return False
    return True


@positional
class FaceRow:
    """A row on one face, with how its couplings rise and fall."""

    row: Row
    face: int
    profiles: Sequence[Profile]

    @property
    def price(self) -> int:
        """Steps of work that one piece takes, about."""
        return sum(self.profiles[term.coupling].curve.programs.cost for term in self.row.terms)

    def decide(
        self, *, alpha: Fraction, rho: Fraction, start: Fraction = _ZERO, load: Fraction = _ZERO
    ) -> tuple[Verdict, Fraction | None]:
        """Decide the row for all s in (0, rho]: proved, refuted or undecided at one s.  Floats
        prove what they can.  With a ``load`` >= 0, which is added to the row before it is divided
        by s: for all s in [start, rho], start > 0."""
        limit = (self.row.pull - alpha) * self.row.own
        whole = Interval(start, rho)
        if self._by_floats(limit, whole, load):
            return Verdict.PROVED, None
        sides = self.sides(whole)
        price = self.price
        waiting = [whole]
        count = 0
        while waiting:
            S = waiting.pop()
            spend(price)
            count += 1
            if _with_load(sides, S, load).hi <= limit:
                continue
            first, last = S.ends()
            # without a load the first end may be s = 0, where nothing is divided by s
            for s in (first, last, S.middle()) if load else (last, S.middle()):
                added = load / s.lo if load else 0
                if lower_bound(sides, s) + added > limit:
                    return Verdict.REFUTED, s.lo
            if count >= MOST_PIECES:
                return Verdict.UNDECIDED, S.midpoint
            waiting += S.halves()
        return Verdict.PROVED, None

    def _by_floats(self, limit: Fraction, whole: Interval, load: Fraction) -> bool:
        """Whether intervals of floats prove the row; where its sides are nearly equal the exact
        ones are left to decide."""
        try:
            price = self.price
            waiting = [Floats.around(whole)]
            count = 0
            most = float_below(limit)
            # what is closer than that at one s is not told from the limit by smaller pieces
            near = float_below(limit - abs(limit) / 10**9)
            sides = self.sides(waiting[0])
            while waiting:
                S = waiting.pop()
                spend(price)
                if _with_load(sides, S, load).top <= most:
                    continue
                count += 1
                if count >= MOST_PIECES or _with_load(sides, S.middle(), load).top > near:
                    return False
                waiting += S.halves()
        except UndefinedError:
            return False
        return True

    def linear_bound(self) -> Fraction:
        """An upper bound of sum w phi for linear couplings, where phi does not depend on s; exact
        if slopes are."""
        spend(LINEAR)
        total = _ZERO
        for term in self.row.terms:
            slope = jet(self.profiles[term.coupling].curve, ZERO).slope
            total += term.weight * max((slope * term.step).hi, (slope * -term.reach).hi)
        return total

    def sides(self, S: Interval) -> list[Side]:
        """The terms, in the arithmetic of S."""
        found = []
        for term in self.row.terms:
            whole = Interval(-term.reach, term.step)
            side = Side(
                term=term,
                kind=self.profiles[term.coupling],
                face=self.face,
                weight=S.like(term.weight),
                left=S.like(-term.reach),
                right=S.like(term.step),
                weighted=S.like(term.weight * term.step),
                whole=S.like(whole * self.face),
                bend=S.like(self.face * term.weight * term.step**2),
            )
            found.append(side)
        return found


def _with_load(sides: Sequence[Side], S: Interval, load: Fraction) -> Interval:
    return upper_bound(sides, S) + S.like(load) / S if load else upper_bound(sides, S)


class Side(NamedTuple):
    """A term on one face: y = s t between ``left`` and ``right``, both in ``whole``; ``bend``:
    weight times step^2."""

    term: Term
    kind: Profile
    face: int
    weight: Interval
    left: Interval
    right: Interval
    weighted: Interval  # right, times the weight
    whole: Interval
    bend: Interval

    def mirrored(self, y: Interval) -> Interval:
        return y if self.face > 0 else -y

    @property
    def turns(self) -> tuple[Cell, ...]:
        """Where phi may have a maximum."""
        return self.kind.tops if self.face > 0 else self.kind.bottoms


def upper_bound(sides: Sequence[Side], S: Interval) -> Interval:
    """An interval whose upper end sum w phi(s) does not exceed for s in S, s > 0."""
    rising: list[Side] = []
    total = change = others = ZERO
    smooth = not S.is_point
    # Where h rises, phi is what it takes at the right end; else all of its maxima count.
    for side in sides:
        if not _rises(side, S):
            others = others + _largest(side, S) * side.weight
        elif not side.right.is_zero:
            rising.append(side)
            found = secant(side.kind.curve, side.mirrored(S * side.right))
            total = total + found.value * side.weighted
            if smooth and found.slope is not None:
                change = change + found.slope * side.bend
            else:
                smooth = False
    if smooth and rising:
        # By the mean value theorem; from the end where it is largest, if it only rises or falls.
        at = S.ends()[change.sign > 0] if change.sign else S.middle()
        value = ZERO
        for side in rising:
            there = secant(side.kind.curve, side.mirrored(at * side.right)).value
            value = value + there * side.weighted
        total = total.meet(value + change * (S - at))
    return total + others


def lower_bound(sides: Sequence[Side], s: Interval) -> Fraction:
    """A bound that sum w phi(s) is at least at this s > 0, a point: phi is no less than what h
    takes at the ends."""
    total = _ZERO
    for side in sides:
        ends = [_secant_times(side, end, s).lo for end in (side.right, side.left)]
        asked = s * side.whole
        inside = (
            cell.values.lo / s.lo if side.face > 0 else -cell.values.hi / s.lo
            for cell in side.turns
            if asked.lo <= cell.place.lo and cell.place.hi <= asked.hi
        )
        total += side.term.weight * max(*ends, *inside)
    return total


def _secant_times(side: Side, t: Interval, S: Interval) -> Interval:
    """t g(s t) for s in S, for h or for -h(-y): the value h(s t)/s."""
    return ZERO if t.is_zero else secant(side.kind.curve, side.mirrored(S * t)).value * t


def _rises(side: Side, S: Interval) -> bool:
    """Whether h (or -h(-y)) is nondecreasing on all of -s reach <= y <= s step, s in S."""
    if side.kind.is_nondecreasing:
        return True
    asked = S * side.whole
    return all(cell.direction > 0 or not _overlap(cell.place, asked) for cell in side.kind.cells)


def _largest(side: Side, S: Interval) -> Interval:
    """An interval whose upper end phi does not exceed on S: both ends, and wherever it may have a
    maximum."""
    natural = secant(side.kind.curve, S * side.whole).value * side.whole * side.face
    # next to s = 0 every piece holds a turn at 0
    if not S.bottom and any(cell.place.contains(0) for cell in side.turns):
        return natural
    bounds = [_secant_times(side, side.right, S)]
    left = side.mirrored(S * side.left)
    if any(cell.direction < 0 and _overlap(cell.place, left) for cell in side.kind.cells):
        bounds.append(_secant_times(side, side.left, S))
    for cell in side.turns:
        when = _within(cell.place * side.face, side.term, S)
        if when is not None:
            bounds.append(cell.values * side.face / when)
    highest = max(bounds, key=lambda bound: bound.top)
    return natural if natural.top <= highest.top else highest


def _within(place: Interval, term: Term, S: Interval) -> Interval | None:
    """The s > 0 of S for which ``place`` may meet -s reach <= y <= s step; None if there are
    none."""
    lo = S.lo
    hi = S.hi
    if place.lo > 0:
        if term.step <= 0:
            return None
        lo = max(lo, place.lo / term.step)
    elif place.hi < 0:
        lo = max(lo, -place.hi / term.reach)
        if term.step < 0:
            hi = min(hi, place.lo / term.step)
    return S.like(Interval(lo, hi)) if lo <= hi else None


def _overlap(left: Interval, right: Interval) -> bool:
    return left.lo <= right.hi and right.lo <= left.hi


def verify_composite(loop: Loop, W: Matrix | None, claim: Separable) -> SeparableAnswer:
    """Decide a whole certificate: its rows and, with an exosystem, the observer's part for the gain
    W (q, m).  PROVED: V = N + kappa E (V = N without an exosystem) decays at least at
    ``composite_rate`` from every start with V <= rho, for arbitrary switching."""
    if loop.groups and (W is None or claim.error is None):
        return undecided(
            "with an [exosystem] the certificate needs an observer gain W and P, beta and kappa."
        )
    wrong = observer_obstacle(loop, W, claim)
    if wrong is not None:
        return refuted(wrong)
    if claim.T is None:
        return verify_separable(loop, claim)
    wrong = rows_obstacle(loop, claim)
    if wrong is not None:
        return undecided(wrong)
    return proved("every set |(T e_i)_c| <= s v_ic is invariant and shrinks.")


def observer_obstacle(loop: Loop, W: Matrix | None, claim: Separable) -> str | None:
    """Why the observer's part of a claim does not hold with the gain W (q, m); None if it is
    proved, and without an exosystem."""
    exosystem, W = seen_through(loop, claim.T, W)
    if exosystem is None:
        return None
    error = claim.error
    if W is None or error is None:
        return "with an [exosystem] it needs P, beta, kappa and size."
    wrong = error_bound_obstacle(exosystem, W, error)
    if wrong is None and not (error.beta > 0 and error.kappa * error.beta * claim.least > 1):
        return "kappa must exceed 1/(beta min v), or the observer error can raise V."
    return wrong


def error_bound_obstacle(
    exosystem: Exosystem, W: Matrix, error: ErrorBound, timing: Timing | None = None
) -> str | None:
    """Why ``error`` does not hold for W, in words; None if it is proved.  Exact: there is no third
    answer.  With a ``timing`` that is sampled beta is a rate per tick, and C the mean output."""
    P = error.P
    q = exosystem.order
    if exact.shape(P) != (q, q) or not exact.is_symmetric(P):
        return f"P must be a symmetric {q}x{q} matrix."
    if not decide_positive_definite(P).is_proved:
        return "P is not positive definite."
    decay, outputs = _sides(exosystem, W, error, timing)
    if not decide_positive_semidefinite(decay).is_proved:
        return (
            f"the observer error does not decay at the rate beta = {float(error.beta):.6g} in "
            "the norm of P."
        )
    for number, square in enumerate(outputs):
        if not decide_positive_semidefinite(exact.subtract(P, square)).is_proved:
            return f"P does not bound row {number + 1} of C: c'c <= P fails."
    room = exact.subtract(exact.scale(error.size, exact.identity(q)), P)
    if not decide_positive_semidefinite(room).is_proved:
        return f"P exceeds {float(error.size):.6g} times the identity."
    return None


def _sides(
    exosystem: Exosystem, W: Matrix, error: ErrorBound, timing: Timing | None
) -> tuple[Matrix, list[Matrix]]:
    """What has to be >= 0 for beta, and c'c of every output, or a matrix above it."""
    P = error.P
    if timing is None or not timing.sampled:
        PE = exact.multiply(P, exact.subtract(exosystem.A, exact.multiply(W, exosystem.C)))
        decay = exact.add(exact.add(exact.transpose(PE), PE), exact.scale(2 * error.beta, P))
        return exact.scale(-1, decay), _squares(predicted(exosystem, timing))
    found = sampled(exosystem, timing)
    F = found.error(W, timing.period)
    turned = tuple(zip(*F, strict=True))
    moved = middle(interval_product(interval_product(turned, points(P)), F))
    left = exact.scale((1 - timing.period * error.beta) ** 2, P)
    decay = exact.subtract(left, exact.add(moved.centre, moved.room))
    return decay, _squares(predicted(exosystem, timing))


def _squares(C: IntervalMatrix) -> list[Matrix]:
    """c'c of every row, or a matrix above it."""
    squares = []
    for c in C:
        square = middle(tuple(tuple(x * y for y in c) for x in c))
        squares.append(exact.add(square.centre, square.room))
    return squares


def composite_rate(claim: Separable) -> Fraction:
    """The rate of V = N + kappa E: min(alpha, beta - 1/(kappa min v)); alpha without an
    observer."""
    if claim.error is None:
        return claim.alpha
    return min(claim.alpha, claim.error.beta - 1 / (claim.error.kappa * claim.least))


def covers(claim: Separable, *, radius: Fraction, disturbance: Fraction) -> bool:
    """Whether every start with |e|_inf <= radius and |eps_i| <= disturbance lies in {V <= rho};
    exact.  radius spread + kappa disturbance sqrt(size) <= rho, decided by squares.  Raises:
    SpecError for a negative radius or disturbance."""
    if radius < 0 or disturbance < 0:
        raise SpecError(
            "radius and disturbance must be >= 0.", key="radius" if radius < 0 else "disturbance"
        )
    if claim.rho is None:
        return True
    # What the errors leave of rho has to be enough for those of the estimates.
    room = claim.rho - radius * claim.spread
    return room >= 0 if claim.error is None else claim.error.fits(disturbance, room)
