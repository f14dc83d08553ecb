"""A max-separable certificate as a file in which Coq proves: every motion of the loop stays below
the bound.

The file states the loop as the paper prints it, equations (1), (12), (13) and (19), with real
functions of time, and proves the bound for every motion under any switching (theory, section 5).
Its library is ``theory/``, written once; what belongs to one certificate are numbers, couplings,
and where a row is looked at piece by piece: Coq bounds real functions (package Interval) on pieces
that are found here.  Nothing here is trusted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from itertools import pairwise, product

from dobc_design._checks import noun, positional
from dobc_design._files import own_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of, reading_claims
from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.domain import Around
from dobc_design.conditions.kinds import MAX_SEPARABLE
from dobc_design.conditions.numbers import claimed, rounded_up
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.separable.claim import ErrorBound, Separable, holding_gains
from dobc_design.coupling.coupling import Coupling
from dobc_design.coupling.enclosures import Curve, jet
from dobc_design.coupling.expression import ATOM, POWER, Infix, Piece
from dobc_design.coupling.tree import evaluate
from dobc_design.errors import refused
from dobc_design.exact.cholesky import squares_of
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, transpose
from dobc_design.exact.number import ONE, ZERO, root_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.c_text import template
from dobc_design.loop.make import loop_of
from dobc_design.problem.groups import gains_of
from dobc_design.problem.problem import Problem

from .matrices import comment, matrix, require_own

THEORY = ("Statement", "Comparison", "Consensus", "Rows")
MOST_ARCS, MOST_STATES = 400, 6  # of all modes together, and of one exosystem
DEEPEST = 12  # halvings of a piece, until a row is seen to hold
MOST_PARTS = 200  # of one row
VERIFY = "`dobc verify` checks the certificate."
CUTS = 64  # of a range of arguments, where a turn is looked for
#: Functions of the expression language in Coq; {0} is the argument, in brackets where it needs
#: them.
CALLS = {name: f"{name} {{0}}" for name in ("exp", "sin", "cos", "atan", "sqrt")} | {
    "log": "ln {0}",
    "tan": "(sin {0} / cos {0})",
    "tanh": "(1 - 2 / (exp (2 * {0}) + 1))",
    "sinh": "((exp {0} - exp (- {0})) / 2)",
    "cosh": "((exp {0} + exp (- {0})) / 2)",
    "asinh": "ln ({0} + sqrt ({0} ^ 2 + 1))",
}


Heard = tuple[int, Fraction, int]  # the speaker, the weight, the place of the coupling
Cell = tuple[Interval, Interval, Interval]  # of arguments, with h and h' there; or h, h', h''


def real(x: Fraction | int) -> str:
    """A rational as a real number: 3, (- 3), (3 / 7)."""
    value = Fraction(x)
    text = str(abs(value.numerator))
    if value.denominator != 1:
        text += f" / {value.denominator}"
    if value < 0:
        return f"(- ({text}))"
    return text if value.denominator == 1 else f"({text})"


class RocqAlgebra(Infix):
    """Expressions as real functions."""

    def constant(self, value: Fraction) -> Piece:
        return Piece(real(value), ATOM)

    def pi(self) -> Piece:
        return Piece("PI", ATOM)

    def power(self, base: Piece, exponent: int) -> Piece:
        text = f"{self.inside(base, ATOM)} ^ {abs(exponent)}"
        return Piece(text, POWER) if exponent >= 0 else Piece(f"(/ {text})", ATOM)

    def call(self, name: str, arguments: tuple[Piece, ...]) -> Piece:
        if name not in CALLS:
            raise refused(
                "coupling.h",
                f"a coupling has {name}, which has no derivative everywhere or is not known "
                "to Coq's Interval.",
                VERIFY,
            )
        inside = (x.text if x.text.isalnum() else f"({x.text})" for x in arguments)
        return Piece(CALLS[name].format(*inside), ATOM)


@noun
class Arc:
    """What an agent hears on a part of a row, for arguments in [low, high], and why its coupling is
    at most h(s step): it rises (everywhere, or here: rising), falls, or has its peak there, rising
    from ``turn`` on and below it at most ``bound``; without ``step`` it is bounded by ``bound``."""

    who: int
    weight: Fraction
    law: int
    kind: str  # rises, rising, falling, peak, bounded
    low: Fraction
    high: Fraction
    step: Fraction | None = None
    bound: Fraction = ZERO
    turn: Fraction = ZERO


@noun
class Part:
    """A row for s in [low, high]; ``near`` 0 its slope decides."""

    low: Fraction
    high: Fraction
    near: bool
    arcs: tuple[Arc, ...]


@positional
class Law:
    """A coupling on a face, 1 or -1 (the lower: couplings are mirrored, -h(-y))."""

    curve: Curve
    face: int

    def jet(self, Y: Interval) -> Cell:
        """h, h' and h'' on Y."""
        found = jet(self.curve, Y if self.face > 0 else -Y)
        if found.curvature is None:
            raise UndefinedError("it has a kink.")
        value = found.value if self.face > 0 else -found.value
        return value, found.slope, found.curvature * self.face

    def cells(self, low: Fraction, high: Fraction) -> list[Cell]:
        """A range of arguments in cells, with h and h' on each."""
        cuts = [low + (high - low) * k / CUTS for k in range(CUTS + 1)]
        cells = [Interval(a, b) for a, b in pairwise(cuts)]
        return [(cell, *self.jet(cell)[:2]) for cell in cells]

    def most(self, cells: Sequence[Cell]) -> Fraction:
        """What the coupling does not exceed on cells, rounded up: where it is monotone, at an
        end."""
        tops = []
        for cell, _, slope in cells:
            where = _highest_end(cell, slope) if slope.sign else cell
            tops.append(self.jet(where)[0].hi)
        return Fraction(math.ceil(max(tops) * 2**20) + 1, 2**20)


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a claim, and their parts."""

    problem: Problem
    claim: Separable
    rho: Fraction

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        return tuple(Curve(each.components[0]) for each in self.problem.couplings)

    @cached_property
    def far(self) -> dict[int, Fraction]:
        """How far the argument of every coupling that an arc has may be from 0."""
        found: dict[int, Fraction] = {}
        for arcs in self.problem.network.modes.values():
            for i, j, _ in arcs:
                place = self.problem.coupling_place(i, j)
                reach = self.rho * (self.claim.v[i] + self.claim.v[j])
                found[place] = max(found.get(place, ZERO), reach)
        return found

    @cached_property
    def rising(self) -> dict[int, bool]:
        """Whether a coupling rises as far as that."""
        found = {}
        for place, far in self.far.items():
            cells = Law(self.curves[place], 1).cells(-far, far)
            found[place] = all(slope.lo >= 0 for *_, slope in cells)
        return found

    def all(self) -> Iterator[Row]:
        """Every row, mode by mode, agent by agent.  Raises: SpecError if one has too little room,
        UndefinedError."""
        gains = holding_gains(loop_of(self.problem))
        network = self.problem.network
        modes = list(network.modes)
        for face, mode, i in product((1, -1), range(len(modes)), range(self.problem.n)):
            room = (gains[i] - self.claim.alpha) * self.claim.v[i]
            row = Row(rows=self, mode=mode, agent=i, face=face, room=room)
            if not row.parts:
                raise refused(
                    "checks",
                    f"the row of agent {network.labels[i]} in mode {modes[mode]}"
                    " has too little room for Coq.",
                    VERIFY,
                )
            yield row


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """An agent in a mode on a face, and what its pin leaves."""

    rows: Rows
    mode: int
    agent: int
    face: int
    room: Fraction

    @property
    def name(self) -> str:
        return f"{'upper' if self.face > 0 else 'lower'}_{self.mode}_{self.agent}"

    def _law(self, place: int) -> Law:
        return Law(self.rows.curves[place], self.face)

    @cached_property
    def _heard(self) -> list[Heard]:
        problem = self.rows.problem
        arcs = list(problem.network.modes.values())[self.mode]
        place = problem.coupling_place
        return [(j, weight, place(i, j)) for i, j, weight in arcs if i == self.agent]

    @cached_property
    def parts(self) -> list[Part]:
        """Parts of (0, rho] on which the row is seen to be at most ``room`` s; none if they are
        not found."""
        high = self.rows.rho
        found: list[Part] = []
        waiting: list[tuple[Fraction, Fraction]] = []
        # Near 0, where a row is 0, its slope has to decide: how far that is enough ...
        for _ in range(DEEPEST):
            near = self._part(ZERO, high)
            exact = all(arc.kind in ("rises", "rising", "falling") for arc in near.arcs)
            if exact and self._holds(near):
                found.append(near)
                if high < self.rows.rho:
                    waiting.append((high, self.rows.rho))
                break
            high /= 2
        # ... and beyond, the row itself, on pieces as short as it takes.
        while waiting:
            low, high = waiting.pop()
            part = self._part(low, high)
            middle = Fraction(round((low + high) * 2**19), 2**20)
            if self._holds(part):
                found.append(part)
            elif len(found) + len(waiting) < MOST_PARTS and low < middle < high:
                waiting += [(middle, high), (low, middle)]
            else:
                return []
        return found

    def _part(self, low: Fraction, high: Fraction) -> Part:
        found = tuple(self._arc(each, low, high) for each in self._heard)
        return Part(low=low, high=high, near=low == 0, arcs=found)

    def _arc(self, heard: Heard, low: Fraction, high: Fraction) -> Arc:
        j, weight, place = heard
        v = self.rows.claim.v
        step, reach = v[j] - v[self.agent], v[j] + v[self.agent]
        arc = Arc(
            who=j,
            weight=Fraction(weight),
            law=place,
            kind="rises",
            low=-high * reach,
            high=max(low * step, high * step),
            step=step,
        )
        if self.rows.rising[place]:
            return arc
        # Else look where in its range the coupling rises, and where it falls.
        law = self._law(place)
        cells = law.cells(arc.low, arc.high)
        falling = [k for k, (*_, slope) in enumerate(cells) if slope.lo < 0]
        if not falling:
            return replace(arc, kind="rising")
        if all(slope.hi <= 0 for *_, slope in cells):
            return replace(arc, kind="falling", step=-reach)
        # Behind the last cell in which it may fall it rises: is it above all before at both ends?
        turn = falling[-1] + 1
        most = law.most(cells[:turn])
        ends = [law.jet(Interval.point(s * step))[0].lo for s in (low, high)]
        if turn < len(cells) and most <= min(ends):
            return replace(arc, kind="peak", bound=most, turn=cells[turn][0].lo)
        return replace(arc, kind="bounded", step=None, bound=law.most(cells))

    def _holds(self, part: Part) -> bool:
        exact = all(arc.step is not None for arc in part.arcs)
        # A bound is a constant, however short the piece: halving it does not help for long.
        depth = DEEPEST if exact else 4
        return self._below(part, Interval(part.low, part.high), depth)

    def _below(self, part: Part, S: Interval, depth: int) -> bool:
        """Whether the row (near 0: its slope) is at most what the pin leaves, on S or in halves of
        it."""
        value, slope = self._beyond(part, S)
        if value.hi <= 0:
            return True
        # A row that rises or falls is largest at an end.
        if slope.sign and self._beyond(part, _highest_end(S, slope))[0].hi <= 0:
            return True
        return depth > 0 and all(self._below(part, half, depth - 1) for half in S.halves())

    def _beyond(self, part: Part, S: Interval) -> tuple[Interval, Interval]:
        """What the row (near 0: its slope) has beyond what the pin leaves, and its derivative by
        s."""
        none = Interval.point(ZERO)
        value, slope = -S * self.room, none - self.room
        if part.near:
            value, slope = slope, none
        for arc in part.arcs:
            if arc.step is None:
                value = value + (none + arc.bound) * arc.weight
                continue
            h, first, second = self._law(arc.law).jet(S * arc.step)
            if part.near:
                value = value + first * arc.step * arc.weight
                slope = slope + second * arc.step * (arc.step * arc.weight)
            else:
                value = value + h * arc.weight
                slope = slope + first * (arc.step * arc.weight)
        return value, slope


def _highest_end(S: Interval, slope: Interval) -> Interval:
    """The end of S at which a function with this slope, of one sign, is largest."""
    low, high = S.ends()
    return high if slope.lo >= 0 else low


def proved_in_states(certificate: Certificate) -> tuple[Check, Separable] | None:
    """The max-separable check that is proved, in the states themselves, with its claim; None
    without one."""
    problem = certificate.problem
    if problem.dynamics is not None:
        return None
    # Coordinates T change what a row is: the library is about the states themselves.
    for check in certificate.checks:
        proved = check.is_proved and check.rate is not None
        if check.id == MAX_SEPARABLE and proved:
            with reading_claims():
                claim = claim_of(check, loop_of(problem), certificate.claims.W)
            if isinstance(claim, Separable) and claim.T is None:
                return check, claim
    return None


def motions_proof(certificate: Certificate) -> str:
    """Return the text of a Coq file that proves: every motion of the loop that starts in the box of
    the certificate's max-separable check stays below rho v_i exp(-rate t), under any switching.
    One certificate gives one text.
    Raises: SpecError if no such check is proved, or where the file cannot be made (dynamics, lists
    of couplings, optional arcs, functions that Interval does not know, large networks).  Tested
    with Coq 8.16, Coquelicot 3.2 and Interval 4.6."""
    problem, claims = certificate.problem, certificate.claims
    require_own(certificate)
    found = proved_in_states(certificate)
    if found is None:
        raise refused(
            "checks",
            "no max-separable proof is in this certificate.",
            "Give a [region], or certify with --all.",
        )
    check, claim = found
    _refuse_what_is_not_written(problem)
    radius, off = ONE, Fraction(bool(problem.q))
    if isinstance(check.domain, Around):
        radius, off = claimed(check.domain.radius), claimed(check.domain.disturbance)
    rate = claimed(check.rate or 0)
    error = claim.error
    if error is None:  # nothing is observed
        error = ErrorBound(P=(), beta=rate + 1, kappa=1 / claim.least, size=ZERO)
    share = root_above(error.size * off**2, unit=10**15)
    # A claim for every start has no rho of its own: as far as the box that is stated.
    rho = claim.rho or rounded_up(radius / claim.least + error.kappa * share, digits=6)
    rows = Rows(problem, claim, rho)
    try:
        listed = list(rows.all())
    except UndefinedError as undefined:
        raise refused(
            "coupling.h", f"a coupling is not smooth as far out: {undefined}"
        ) from undefined
    groups = [] if claims.W is None else _groups(problem, claims.W, error)
    group = {label: g for g, each in enumerate(problem.groups) for label in each.agents}
    return template("rocq_motions.v.j2").render(
        problem=problem,
        claims=claims,
        claim=claim,
        error=error,
        share=share,
        rho=rho,
        radius=radius,
        off=off,
        rate=rate,
        rows=listed,
        far=rows.far,
        rising=rows.rising,
        comment=comment,
        matrix=partial(matrix, number=real),
        real=real,
        theory=[_theory(name) for name in THEORY],
        laws=[_law(h) for h in problem.couplings],
        group=[group.get(label, len(groups)) for label in problem.network.labels],
        groups=groups,
        k=holding_gains(loop_of(problem)),
        asked=_asked(problem, radius, off),
    )


def _refuse_what_is_not_written(problem: Problem) -> None:
    """Raise SpecError for what the library does not know, or what Coq would take too long for."""
    arcs = problem.network.modes.values()
    # Whatever is first found is told: one reason is enough.
    unknown = None
    if any(each.optional for each in arcs):
        unknown = "arcs that come and go"
    elif sum(map(len, arcs)) > MOST_ARCS:
        unknown = f"more than {MOST_ARCS} arcs"
    elif any(len(each.exosystem.A) > MOST_STATES for each in problem.groups):
        unknown = f"exosystems of more than {MOST_STATES}"
    if unknown is not None:
        raise refused("--rocq", f"a proof about motions is not made for {unknown}.", VERIFY)


def _law(coupling: Coupling) -> str:
    """h(y) as Coq writes it."""
    return evaluate(coupling.components[0].node, [Piece("y", ATOM)], RocqAlgebra()).text


def _asked(problem: Problem, radius: Fraction, off: Fraction) -> tuple[Fraction, Fraction] | None:
    """The interval of states that the problem asks for, where it is one for all components and the
    box holds it."""
    region = problem.region
    if region is None or max(asked_radius(loop_of(problem))) > radius:
        return None
    intervals = set(region.initial_states)
    if (region.initial_disturbance or 0) > off or len(intervals) != 1:
        return None
    return intervals.pop()


def _theory(name: str) -> str:
    """A file of the library without what it requires."""
    text = own_text(f"export/rocq/theory/{name}.v")
    required = r"^(Require|From|Import|Open Scope) .*\n"
    return re.sub(required, "", text, flags=re.MULTILINE).strip() + "\n"


@noun
class _Group:
    """Exosystem and observer of agents, and inequalities about P as sums of squares, by name."""

    A: Matrix
    C: Matrix
    W: Matrix
    P: Matrix
    facts: dict[str, list[str]]


def _groups(problem: Problem, W: Matrix, error: ErrorBound) -> list[_Group]:
    """Every group of agents; its P is a block of the joint one."""
    found = []
    above = 0
    for each, gain in zip(problem.groups, gains_of(problem.groups, W), strict=True):
        exosystem, q = each.exosystem, len(each.exosystem.A)
        P = tuple(tuple(row[above : above + q]) for row in error.P[above : above + q])
        above += q
        PF = multiply(P, error_matrix(exosystem, gain))
        decrease = scale(-1, add(add(PF, transpose(PF)), scale(2 * error.beta, P)))
        facts = {
            "contracts": _squares(decrease),
            "sized": _squares(subtract(scale(error.size, identity(q)), P)),
        }
        for c, row in enumerate(exosystem.C):
            facts[f"seen{c}"] = _squares(subtract(P, multiply(transpose((row,)), (row,))))
        found.append(_Group(A=exosystem.A, C=exosystem.C, W=gain, P=P, facts=facts))
    return found


def _squares(M: Matrix) -> list[str]:
    """The squares that M is the sum of.  Raises: SpecError if M is not positive semidefinite."""
    found = squares_of(SparseSymmetric.from_dense(M), strict=False)
    if found is None:
        raise refused(
            "observer", "the numbers of the observer do not prove what the certificate claims."
        )
    texts = []
    for each in found:
        terms = [f"a {each.pivot}%nat"]
        terms += [f"{real(factor)} * a {i}%nat" for i, factor in each.others.items()]
        texts.append(f"{real(each.weight)} * ({' + '.join(terms)}) ^ 2")
    return texts
