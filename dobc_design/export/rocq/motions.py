"""A max-separable certificate as a file in which Coq proves: every motion of the loop stays below the bound.

The file states the loop as the paper prints it, equations (1), (12), (13) and (19), with real functions of time, and
proves the bound for every motion under any switching (theory, section 5).  Its library is ``theory/``, written once;
what belongs to one certificate are numbers, couplings, and where a row is looked at piece by piece: Coq bounds real
functions (package Interval) on pieces that are found here.  Nothing here is trusted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from importlib.resources import files
from itertools import pairwise
from typing import Any, Final

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import claim_of, reading_claims
from dobc_design.conditions.check import Check
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.numbers import claimed, rounded_up
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.separable.claim import ErrorBound, Separable, holding_gains
from dobc_design.coupling.enclosures import Curve, jet
from dobc_design.coupling.expression import ATOM, POWER, Infix, Piece
from dobc_design.coupling.tree import evaluate
from dobc_design.errors import SpecError
from dobc_design.exact.cholesky import squares_of
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, add, identity, multiply, scale, subtract, transpose
from dobc_design.exact.number import root_above
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.c_text import template
from dobc_design.export.rocq.matrices import comment, require_own, wrapped_list
from dobc_design.problem.canonical import problem_sha256
from dobc_design.problem.groups import gains_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

THEORY: Final = ("statement", "comparison", "consensus", "rows")
MOST_ARCS, MOST_STATES = 400, 6  # of all modes together, and of one exosystem
DEEPEST: Final = 12  # halvings of a piece, until a row is seen to hold
MOST_PIECES: Final = 200  # of one row
CUTS: Final = 64  # of a range of arguments, where a turn is looked for
#: Functions of the expression language in Coq; {0} is the argument, in brackets where it needs them.
CALLS: Final = {name: f"{name} {{0}}" for name in ("exp", "sin", "cos", "atan", "sqrt")} | {
    "log": "ln {0}",
    "tan": "(sin {0} / cos {0})",
    "tanh": "(1 - 2 / (exp (2 * {0}) + 1))",
    "sinh": "((exp {0} - exp (- {0})) / 2)",
    "cosh": "((exp {0} + exp (- {0})) / 2)",
    "asinh": "ln ({0} + sqrt ({0} ^ 2 + 1))",
}


def real(x: Fraction | int) -> str:
    """A rational as a real number: 3, (- 3), (3 / 7)."""
    top = str(abs(Fraction(x).numerator)) + ("" if Fraction(x).denominator == 1 else f" / {Fraction(x).denominator}")
    return f"(- ({top}))" if x < 0 else f"({top})" if " " in top else top


def matrix(M: Matrix) -> str:
    """A matrix by its rows."""
    return "matrix [" + "; ".join("[" + "; ".join(map(real, row)) + "]" for row in M) + "]"


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
            message = f"a coupling has {name}, which has no derivative everywhere or is not known to Coq's Interval."
            raise SpecError(message, key="coupling.h", cure="`dobc verify` checks the certificate.")
        inside = (x.text if x.text.isalnum() else f"({x.text})" for x in arguments)
        return Piece(CALLS[name].format(*inside), ATOM)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """What an agent hears on a piece, for arguments in [low, high], and why its coupling is at most h(s step): it rises
    (everywhere, or here), falls, or has its peak there, rising from ``turn`` on and below it at most ``bound``; without
    ``step`` it is bounded by ``bound``."""

    who: int
    weight: Fraction
    law: int
    kind: str  # rises, rising, falling, peak, bounded
    low: Fraction
    high: Fraction
    step: Fraction | None = None
    bound: Fraction = Fraction(0)
    turn: Fraction = Fraction(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A row for s in [low, high]; ``near`` 0 its slope decides."""

    low: Fraction
    high: Fraction
    near: bool
    arcs: tuple[Arc, ...]


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a claim and their pieces; both faces: of the lower one couplings are mirrored, -h(-y)."""

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
                found[place] = max(found.get(place, Fraction(0)), self.rho * (self.claim.v[i] + self.claim.v[j]))
        return found

    @cached_property
    def rising(self) -> dict[int, bool]:
        """Whether a coupling rises as far as that."""
        return {place: self._way(place, 1, Interval(-far, far)) > 0 for place, far in self.far.items()}

    def _jet(self, place: int, face: int, Y: Interval) -> tuple[Interval, Interval, Interval]:
        """h, h' and h'' on Y, mirrored on the lower face."""
        found = jet(self.curves[place], Y if face > 0 else -Y)
        if found.curvature is None:
            raise UndefinedError("a coupling has a kink.")
        value, curvature = (found.value, found.curvature) if face > 0 else (-found.value, -found.curvature)
        return value, found.slope, curvature

    def _way(self, place: int, face: int, Y: Interval, depth: int = 6) -> int:
        """1 where the coupling rises on Y, -1 where it falls, 0 where neither is seen."""
        slope = self._jet(place, face, Y)[1]
        if slope.lo >= 0 or slope.hi <= 0:
            return 1 if slope.lo >= 0 else -1
        ways = {self._way(place, face, half, depth - 1) for half in Y.halves()} if depth else {0}
        return ways.pop() if len(ways) == 1 else 0

    def pieces(self, mode: str, agent: int, face: int, room: Fraction) -> list[Part]:
        """Parts of (0, rho] on which the row is seen to be at most ``room`` s.  Raises: SpecError if none are found."""
        arcs = [(j, w, self.problem.coupling_place(i, j)) for i, j, w in self.problem.network.modes[mode] if i == agent]
        high = self.rho
        for _ in range(DEEPEST):
            near = self._near(arcs, agent, face, high)
            if near is not None and self._falls(near, face, room, Interval(Fraction(0), high)):
                break
            high /= 2
        else:
            raise self._tight(agent, mode)
        found, waiting = [near], [(high, self.rho)] if high < self.rho else []
        while waiting:
            low, high = waiting.pop()
            piece = Part(low=low, high=high, near=False, arcs=tuple(self._arc(x, agent, face, low, high) for x in arcs))
            exact = all(arc.step is not None for arc in piece.arcs)
            if self._below(piece, face, room, Interval(low, high), DEEPEST if exact else 4):
                found.append(piece)
                continue
            middle = Fraction(round((low + high) * 2**19), 2**20)
            if len(found) + len(waiting) > MOST_PIECES or not low < middle < high:
                raise self._tight(agent, mode)
            waiting += [(middle, high), (low, middle)]
        return found

    def _tight(self, agent: int, mode: str) -> SpecError:
        message = f"the row of agent {self.problem.network.labels[agent]} in mode {mode} has too little room for Coq."
        return SpecError(message, key="checks", cure="`dobc verify` checks the certificate.")

    def _arc(self, heard: tuple[int, Fraction, int], agent: int, face: int, low: Fraction, high: Fraction) -> Arc:
        j, w, place = heard
        v = self.claim.v
        step, reach = v[j] - v[agent], v[j] + v[agent]
        ends = -high * reach, max(low * step, high * step)
        shared: dict[str, Any] = {"who": j, "weight": w, "law": place, "low": ends[0], "high": ends[1]}
        if self.rising[place]:
            return Arc(kind="rises", step=step, **shared)
        way = self._way(place, face, Interval(*ends))
        if way:
            return Arc(kind="rising" if way > 0 else "falling", step=step if way > 0 else -reach, **shared)
        turn = next((x for x in _grid(*ends) if self._way(place, face, Interval(x, ends[1])) > 0), ends[1])
        most = self._most(place, face, ends[0], turn)
        least = min(self._jet(place, face, Interval.point(s * step))[0].lo for s in (low, high))
        if ends[0] < turn < ends[1] and most <= least:
            return Arc(kind="peak", step=step, bound=most, turn=turn, **shared)
        return Arc(kind="bounded", bound=self._most(place, face, *ends), **shared)

    def _most(self, place: int, face: int, low: Fraction, high: Fraction) -> Fraction:
        """What the coupling does not exceed on [low, high], rounded up."""
        found = Fraction(-(2**200))
        for part in _parts(low, high):
            value, slope, _ = self._jet(place, face, part)
            if slope.sign:  # largest at one of the ends
                value = self._jet(place, face, part.ends()[slope.lo > 0])[0]
            found = max(found, value.hi)
        return Fraction(math.ceil(found * 2**20) + 1, 2**20)

    def _near(self, arcs: Sequence[Any], agent: int, face: int, high: Fraction) -> Part | None:
        found = tuple(self._arc(each, agent, face, Fraction(0), high) for each in arcs)
        if any(arc.kind in ("bounded", "peak") for arc in found):
            return None
        return Part(low=Fraction(0), high=high, near=True, arcs=found)

    def _falls(self, piece: Part, face: int, room: Fraction, S: Interval, depth: int = DEEPEST) -> bool:
        """Whether the derivative of the row by s is at most ``room`` on S."""
        value, slope = Interval.point(-room), Interval.point(Fraction(0))
        ends = [Interval.point(Fraction(0))] * 2
        for arc in piece.arcs:
            step = arc.step or Fraction(0)
            _, first, second = self._jet(arc.law, face, S * step)
            value, slope = value + first * (arc.weight * step), slope + second * (arc.weight * step**2)
            at = (self._jet(arc.law, face, end * step)[1] * (arc.weight * step) for end in S.ends())
            ends = [x + y for x, y in zip(ends, at, strict=True)]
        return self._shown(value, slope, [x - room for x in ends]) or (
            depth > 0 and all(self._falls(piece, face, room, half, depth - 1) for half in S.halves())
        )

    def _below(self, piece: Part, face: int, room: Fraction, S: Interval, depth: int) -> bool:
        """Whether the row is at most ``room`` s on S."""
        value, slope = -S * room, Interval.point(-room)
        ends = [-end * room for end in S.ends()]
        for arc in piece.arcs:
            if arc.step is None:
                value, ends = value + arc.weight * arc.bound, [x + arc.weight * arc.bound for x in ends]
                continue
            h, first, _ = self._jet(arc.law, face, S * arc.step)
            value, slope = value + h * arc.weight, slope + first * (arc.weight * arc.step)
            at = (self._jet(arc.law, face, end * arc.step)[0] * arc.weight for end in S.ends())
            ends = [x + y for x, y in zip(ends, at, strict=True)]
        return self._shown(value, slope, ends) or (
            depth > 0 and all(self._below(piece, face, room, half, depth - 1) for half in S.halves())
        )

    @staticmethod
    def _shown(value: Interval, slope: Interval, ends: Sequence[Interval]) -> bool:
        """Whether a function with this value, slope and ends is at most 0, by itself or at its largest end."""
        rises, falls = slope.lo >= 0 and ends[1].hi <= 0, slope.hi <= 0 and ends[0].hi <= 0
        return value.hi <= 0 or rises or falls


def _grid(low: Fraction, high: Fraction) -> list[Fraction]:
    return [low + (high - low) * k / CUTS for k in range(CUTS + 1)]


def _parts(low: Fraction, high: Fraction) -> Iterator[Interval]:
    return (Interval(a, b) for a, b in pairwise(_grid(low, high)))


def proved_in_states(certificate: Certificate) -> tuple[Check, Separable] | None:
    """The max-separable check that is proved, in the states themselves, with its claim; None without one."""
    for check in certificate.checks:
        known = check.verdict is Verdict.PROVED and check.rate is not None and certificate.problem.dynamics is None
        if check.id == "max-separable" and known:
            with reading_claims():
                claim = claim_of(check, certificate.problem, certificate.claims.W)
            if isinstance(claim, Separable) and claim.T is None:
                return check, claim
    return None


def motions_proof(certificate: Certificate) -> str:
    """Return the text of a Coq file that proves: every motion of the loop that starts in the box of the certificate's
    max-separable check stays below rho v_i exp(-rate t), under any switching.  One certificate gives one text.
    Raises: SpecError if no such check is proved, or where the file cannot be made (dynamics, lists of couplings,
    optional arcs, functions that Interval does not know, large networks).  Tested with Coq 8.16, Coquelicot 3.2 and
    Interval 4.6."""
    problem, claims = certificate.problem, certificate.claims
    require_own(certificate)
    found = proved_in_states(certificate)
    if found is None:
        message = "no max-separable proof is in this certificate."
        raise SpecError(message, key="checks", cure="Give a [region], or certify with --all.")
    check, claim = found
    for wrong, what in (
        (any(arcs.optional for arcs in problem.network.modes.values()), "arcs that come and go"),
        (sum(map(len, problem.network.modes.values())) > MOST_ARCS, f"more than {MOST_ARCS} arcs"),
        (any(len(each.exosystem.A) > MOST_STATES for each in problem.groups), f"exosystems of more than {MOST_STATES}"),
    ):
        if wrong:
            message = f"a proof about motions is not made for {what}."
            raise SpecError(message, key="--rocq", cure="`dobc verify` checks the certificate.")
    box = check.domain if not isinstance(check.domain, str) else {"radius": 1.0, "disturbance": float(bool(problem.q))}
    radius, off = claimed(box["radius"]), claimed(box["disturbance"])
    rate = claimed(check.rate or 0)
    error = claim.error or ErrorBound(P=(), beta=rate + 1, kappa=1 / claim.least, size=Fraction(0))
    share = root_above(error.size * off**2, unit=10**15)
    rho = claim.rho or rounded_up(radius / claim.least + error.kappa * share, digits=6)
    rows = Rows(problem, claim, rho)
    try:
        listed = list(_rows(rows, holding_gains(problem)))
    except UndefinedError as undefined:
        raise SpecError(f"a coupling is not smooth as far out: {undefined}", key="coupling.h") from undefined
    far = {place: real(x) for place, x in rows.far.items()}
    laws = [
        {
            "text": coupling.texts[0],
            "rocq": evaluate(coupling.components[0].node, [Piece("y", ATOM)], RocqAlgebra()).text,
            "far": far.get(place),
            "rises": rows.rising.get(place, False),
            "unfolds": f"h{place + 1}" + (f" h{place + 1}' h{place + 1}_derivative" if place in far else ""),
        }
        for place, coupling in enumerate(problem.couplings)
    ]
    groups = [*_groups(problem, claims.W, error)]
    group = {label: g for g, each in enumerate(problem.groups) for label in each.agents}
    region, span = problem.region, f"{float(radius):.6g}"
    asked = None if region is None or max(asked_radius(problem)) > radius else region.initial_states
    same = asked is not None and len(set(asked)) == 1
    loud = f"|x_i(t) - goal_i| <= {float(rho):.6g} v_i exp(-{float(rate):.6g} t) in every component, for all t >= 0"
    seen = f", and with |xi_i - xihat_i| <= {float(off):.6g} (Euclidean)" if groups else ""
    if region is not None and groups and (region.initial_disturbance or 0) > off:
        same = False
    return template("rocq_motions.v.j2").render(
        head=_head(certificate, loud),
        theory=[_theory(name) for name in THEORY],
        problem=problem,
        n=problem.n,
        m=problem.m,
        laws=laws,
        labels=", ".join(f"{i} ({label})" for i, label in enumerate(problem.network.labels)),
        graphs=[{"name": mode, "arcs": _arcs(problem, mode)} for mode in problem.network.modes],
        gains=problem.pinning.gains,
        target=[real(x) for x in problem.target],
        offsets={i: [real(x) for x in offset] for i, offset in problem.offsets.items()},
        groups=groups,
        group=_chosen([group.get(label, len(groups)) for label in problem.network.labels]),
        v=[real(x) for x in claim.v],
        k=[real(x) for x in holding_gains(problem)],
        alpha=real(claim.alpha),
        kappa=real(error.kappa),
        beta=real(error.beta),
        size=real(error.size),
        rho=real(rho),
        error=real(share),
        everywhere=claim.rho is None,
        radius=real(radius),
        off=real(off),
        rate=real(rate),
        rows=listed,
        uppers=[row["name"] for row in listed if row["face"] == "upper"],
        lowers=[row["name"] for row in listed if row["face"] == "lower"],
        seen=[f"exact (seen{c}_{g} a)" for g in range(len(groups)) for c in range(problem.m)],
        claim=[
            "Every motion of the loop, under any switching of its modes, that starts with"
            f" |x_i(0) - goal_i| <= {span} in every component{seen}, has {loud}."
        ],
        states=None
        if asked is None or not same
        else {
            "low": real(asked[0][0]),
            "high": real(asked[0][1]),
            "words": [
                "The same for the starts that were asked for: every component of every x_i(0) is in"
                f" {list(map(float, asked[0]))}."
            ],
        },
        **{each.__name__: each for each in (comment, matrix, wrapped_list)},
    )


def _theory(name: str) -> str:
    """A file of the library without what it requires."""
    text = (files("dobc_design.export.rocq") / "theory" / f"{name}.v").read_text("utf-8")
    return re.sub(r"^(Require|From|Import|Open Scope) .*\n", "", text, flags=re.MULTILINE).strip() + "\n"


def _head(certificate: Certificate, loud: str) -> list[str]:
    problem, claims = certificate.problem, certificate.claims
    return [
        f"Every motion converges: the problem {problem.name}, to be checked by Coq.",
        f"Claim: {loud}; the theorem every_motion_converges in part 4.",
        "Check it by: coqc FILE.v (Coq 8.16 with Coquelicot and Interval; in Debian the packages coq, libcoq-coquelicot"
        " and libcoq-interval).",
        "To be read: the definitions down to `converges` in part 1, part 2, and the theorem. The rest are proofs.",
        f"Made by dobc_design {claims.version}. SHA-256 of the problem: {problem_sha256(problem)}.",
        *(f"Note: {note}" for note in problem.notes),
    ]


def _arcs(problem: Problem, mode: str) -> list[str]:
    found = []
    for i, j, w in problem.network.modes[mode]:
        h = f"h{problem.coupling_place(i, j) + 1}"
        found.append(f"Arc {i} {j} {h}" if w == 1 else f"Arc {i} {j} (fun y => {real(Fraction(w))} * {h} y)")
    return found


def _chosen(values: Sequence[int]) -> str:
    """The group of agent i."""
    if len(set(values)) <= 1:
        return f"{values[0]}%nat"
    return "match i with " + " ".join(f"| {i} => {x}%nat" for i, x in enumerate(values)) + " | _ => 0%nat end"


def _rows(rows: Rows, gains: Sequence[Fraction]) -> Iterator[dict[str, Any]]:
    """Every row as the template wants it."""
    problem, claim = rows.problem, rows.claim
    for p, mode in enumerate(problem.network.modes):
        for i, label in enumerate(problem.network.labels):
            room = (gains[i] - claim.alpha) * claim.v[i]
            for face, name in ((1, "upper"), (-1, "lower")):
                pieces = rows.pieces(mode, i, face, room)
                yield {
                    "name": f"{name}_{p}_{i}",
                    "face": name,
                    "mode": p,
                    "agent": i,
                    "room": real(room),
                    "words": f"Agent {label}, mode {mode}, {name} face.",
                    "pieces": [_piece(rows, each, face) for each in pieces],
                }


def _piece(rows: Rows, piece: Part, face: int) -> dict[str, Any]:
    return {
        "low": real(piece.low),
        "high": real(piece.high),
        "near": piece.near,
        "far": real(max((rows.far[arc.law] for arc in piece.arcs), default=Fraction(1))),
        "arcs": [_arc(arc, face) for arc in piece.arcs],
    }


def _arc(arc: Arc, face: int) -> dict[str, Any]:
    h = f"h{arc.law + 1}"
    facing, slope = (h, f"{h}'") if face > 0 else (f"(mirrored {h})", f"(fun y => {h}' (- y))")
    return {
        "who": arc.who,
        "weight": real(Fraction(arc.weight)),
        "law": h,
        "facing": facing,
        "slope": slope,
        "fact": h if face > 0 else f"{h}m",
        "kind": arc.kind,
        "low": real(arc.low),
        "high": real(arc.high),
        "step": None if arc.step is None else real(arc.step),
        "bound": real(arc.bound),
        "turn": real(arc.turn),
        "most": real(arc.bound) if arc.step is None else f"{facing} (s * {real(arc.step)})",
    }


def _groups(problem: Problem, W: Matrix | None, error: ErrorBound) -> Iterator[dict[str, Any]]:
    """A, C, W, P of every group of agents, and their inequalities as sums of squares."""
    above = 0
    if W is None:
        return
    for g, (each, gain) in enumerate(zip(problem.groups, gains_of(problem.groups, W), strict=True)):
        A, C, q = each.exosystem.A, each.exosystem.C, len(each.exosystem.A)
        P = tuple(tuple(row[above : above + q]) for row in error.P[above : above + q])
        above += q
        F = error_matrix(each.exosystem, gain)
        PF = multiply(P, F)
        falls = scale(-1, add(add(PF, transpose(PF)), scale(2 * error.beta, P)))
        own = f"(fun r c => exosystem_A {g} r c - sum {problem.m} (fun d => exosystem_W {g} r d * exosystem_C {g} d c))"
        facts = [
            ("contracts", f"form_slope {q} (P {g}) {own} a", f"- 2 * beta * form {q} (P {g}) a", falls),
            (
                "sized",
                f"form {q} (P {g}) a",
                f"size * sum {q} (fun h => a h ^ 2)",
                subtract(scale(error.size, identity(q)), P),
            ),
        ]
        for c, row in enumerate(C):
            left = f"(sum {q} (fun h => exosystem_C {g} {c} h * a h)) ^ 2"
            facts.append((f"seen{c}", left, f"form {q} (P {g}) a", subtract(P, multiply(transpose((row,)), (row,)))))
        listed = [{"name": n, "left": x, "right": y, "squares": _squares(M)} for n, x, y, M in facts]
        yield {"A": A, "C": C, "W": gain, "P": P, "facts": listed}


def _squares(M: Matrix) -> list[str]:
    """The squares that M is the sum of.  Raises: SpecError if M is not positive semidefinite."""
    found = squares_of(SparseSymmetric.from_dense(M), strict=False)
    if found is None:
        raise SpecError("the numbers of the observer do not prove what the certificate claims.", key="observer")
    sums = (" + ".join([f"a {x.pivot}%nat", *(f"{real(y)} * a {i}%nat" for i, y in x.others.items())]) for x in found)
    return [f"{real(x.weight)} * ({text}) ^ 2" for x, text in zip(found, sums, strict=True)]
