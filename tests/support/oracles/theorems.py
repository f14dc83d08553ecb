"""An oracle for certificates that shares no code with the package's theorems, verify or exact.

It reads problem.json and certificate.json as JSON.  Slopes come from SymPy's diff, matrices from
Kronecker products, definiteness from plain elimination over Fractions, "Hurwitz" from Lyapunov's
equation, root counts from SymPy's factors, and Psi is decided as the whole matrix (18), not through
the Reduction.  Irrational slopes are taken to 80 digits, with a slack of 1e-60 where a strict
inequality is claimed.
"""

import hashlib
import json
import re
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from scipy.optimize import linprog

from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.problem import Problem
from oracles.factors import false_factor
from oracles.regions import COVERING, IDS, Regions

Rows = list[list[Fraction]]
SLACK = Fraction(1, 10**60)
FIELDS = {
    "id",
    "mode",
    "verdict",
    "domain",
    "margin",
    "rate",
    "factor",
    "reason",
    "exact",
    "witness",
    "fix",
}
PLAIN = ("observability", "detectability", "hurwitz", "reachability")


# linear algebra over the rationals, written out


def zeros(rows: int, columns: int) -> Rows:
    return [[Fraction(0)] * columns for _ in range(rows)]


def eye(size: int) -> Rows:
    found = []
    for i in range(size):
        unit = [Fraction(int(i == j)) for j in range(size)]
        found.append(unit)
    return found


def plus(*terms: Rows) -> Rows:
    found = []
    for rows in zip(*terms, strict=True):
        columns = zip(*rows, strict=True)
        sums = [sum(xs, Fraction(0)) for xs in columns]
        found.append(sums)
    return found


def times(factor: Fraction | int, M: Rows) -> Rows:
    return [[factor * x for x in row] for row in M]


def dot(M: Rows, N: Rows) -> Rows:
    found = []
    for row in M:
        columns = range(len(N[0]))
        products = [sum((x * N[k][j] for k, x in enumerate(row)), Fraction(0)) for j in columns]
        found.append(products)
    return found


def turned(M: Rows) -> Rows:
    return [list(column) for column in zip(*M, strict=True)]


def kron(M: Rows, N: Rows) -> Rows:
    return [[x * y for x in p for y in q] for p in M for q in N]


def block(rows: Sequence[Sequence[Rows]]) -> Rows:
    found = []
    for row in rows:
        for i in range(len(row[0])):
            found.append([x for part in row for x in part[i]])
    return found


def positive_definite(M: Rows) -> bool:
    """All pivots of an elimination without exchanges are positive."""
    work = [list(row) for row in M]
    for k, row in enumerate(work):
        if row[k] <= 0:
            return False
        for other in work[k + 1 :]:
            factor = other[k] / row[k]
            if factor:
                for j in range(k, len(row)):
                    other[j] -= factor * row[j]
    return True


def negative_definite(M: Rows) -> bool:
    return positive_definite(times(-1, M))


def form(M: Rows, v: Sequence[Fraction]) -> Fraction:
    return sum((x * v[i] * v[j] for i, row in enumerate(M) for j, x in enumerate(row)), Fraction(0))


def solve(M: Rows, right: list[Fraction]) -> list[Fraction] | None:
    """The solution of a square system, None if it is singular."""
    pairs = zip(M, right, strict=True)
    work = [[*row, b] for row, b in pairs]
    for k in range(len(work)):
        rows_below = range(k, len(work))
        pivot = next((i for i in rows_below if work[i][k]), None)
        if pivot is None:
            return None
        work[k], work[pivot] = work[pivot], work[k]
        work[k] = [x / work[k][k] for x in work[k]]
        for i, row in enumerate(work):
            if i != k and row[k]:
                work[i] = [x - row[k] * y for x, y in zip(row, work[k], strict=True)]
    return [row[-1] for row in work]


def hurwitz(A: Rows) -> bool:
    """Lyapunov: A'X + XA = -I has a unique solution, and it is positive definite."""
    q = len(A)
    if not q:
        return True
    left = kron(turned(A), eye(q))
    right = kron(eye(q), turned(A))
    operator = plus(left, right)
    solution = solve(operator, [-x for row in eye(q) for x in row])
    return solution is not None and positive_definite(
        [solution[i * q : (i + 1) * q] for i in range(q)]
    )


# the problem, read from problem.json


class Oracle:
    """What is true of one problem."""

    def __init__(self, problem: Problem) -> None:
        self.bytes = canonical_bytes(problem)
        self.document = d = json.loads(self.bytes)
        self.labels: list[str] = d["labels"]
        self.n, self.m = len(self.labels), int(d["dimension"])
        self.modes: dict[str, list[Any]] = {mode["name"]: mode["arcs"] for mode in d["modes"]}
        exosystem = d["exosystem"]
        self.A: Rows | None = None if exosystem is None else numbers(exosystem["A"])
        self.C: Rows | None = None if exosystem is None else numbers(exosystem["C"])
        without_W = d["observer"]["W"] is None
        self.W: Rows | None = None if without_W else numbers(d["observer"]["W"])
        without_P = d["observer"]["P"] is None
        self.P: Rows | None = None if without_P else numbers(d["observer"]["P"])
        default = d["coupling"]["h"]
        exceptions = d["coupling"]["exceptions"]
        special = {tuple(item["arc"]): item["h"] for item in exceptions}
        modes = self.modes.values()
        self.h = {(i, j): special.get((i, j), default) for arcs in modes for i, j, _ in arcs}
        texts = [default, *special.values()]
        has_kinks = any(word in str(h) for h in texts for word in ("abs", "min", "max", "clip"))
        self.smooth = not has_kinks
        self.linear = self.smooth and all(slope(key(h), self.m)[1] for h in texts)
        self.K = zeros(self.n * self.m, self.n * self.m)
        self.pinned = [i for i, _ in d["gains"]]
        for i, gain in d["gains"]:
            for c, row in enumerate(numbers(gain)):
                self.K[i * self.m + c][i * self.m : (i + 1) * self.m] = row
        self.counted: dict[str, int] = {}
        self.exact = all(map(self.exact_in, self.modes))

    def exact_in(self, mode: str) -> bool:
        """Whether every slope of the mode is rational."""
        return self.smooth and all(
            slope(key(self.h[i, j]), self.m)[2] for i, j, _ in self.modes[mode]
        )

    @property
    def domain(self) -> str:
        return "global" if self.linear else "consensus"

    def loop(self, mode: str) -> Rows:
        """J - K, from sums of Kronecker products of (e_i e_j' - e_i e_i') and the slopes."""
        total = times(-1, self.K)
        for i, j, weight in self.modes[mode]:
            place = zeros(self.n, self.n)
            place[i][j] += 1
            place[i][i] -= 1
            text = key(self.h[i, j])
            slopes = slope(text, self.m)
            gain = times(Fraction(weight), slopes[0])
            total = plus(total, kron(place, gain))
        return total

    def lambda_(self, mode: str) -> Rows:
        return plus(self.loop(mode), turned(self.loop(mode)))

    def psi(self, mode: str, P: Rows, Q: Rows, *, margin: Fraction, rate: Fraction) -> Rows:
        """The matrix (18), with 2 rate diag(I, I (x) P) and margin diag(I, 0) added."""
        assert self.A is not None
        assert self.C is not None
        free = dot(P, self.A)
        injected = times(-1, dot(Q, self.C))
        half = plus(free, injected)
        omega = plus(half, turned(half))
        one = eye(self.n * self.m)
        shift = times(margin + 2 * rate, one)
        corner = plus(self.lambda_(mode), shift)
        border = kron(eye(self.n), self.C)
        shifted = plus(omega, times(2 * rate, P))
        corner_of_errors = kron(eye(self.n), shifted)
        lower = [turned(border), corner_of_errors]
        return block([[corner, border], lower])

    def slack(self) -> Fraction:
        return Fraction(0) if self.exact else SLACK

    def unreached(self, modes: Sequence[str]) -> list[int]:
        reached = set(self.pinned)
        for _ in range(self.n):
            reached |= {i for mode in modes for i, j, _ in self.modes[mode] if j in reached}
        return [i for i in range(self.n) if i not in reached]

    def listened_to_from(self, agent: int) -> set[int]:
        """The agent, whom it listens to in any mode, whom those listen to, and so on: closed by
        construction."""
        found = {agent}
        for _ in range(self.n):
            modes = self.modes.values()
            found |= {j for arcs in modes for i, j, _ in arcs if i in found}
        return found

    def error(self, W: Rows) -> Rows:
        assert self.A is not None
        assert self.C is not None
        return plus(self.A, times(-1, dot(W, self.C)))

    def hidden(self) -> sp.Matrix:
        """A restricted to what C never sees, by SymPy."""
        A = sp.Matrix(self.A)
        C = sp.Matrix(self.C)
        seen = sp.Matrix.vstack(*(C * A**k for k in range(A.rows)))
        N = seen.nullspace()
        if not N:
            return sp.zeros(0, 0)
        N = sp.Matrix.hstack(*N)
        return (N.T * N).inv() * N.T * A * N

    def detectable(self) -> bool:
        return hurwitz(fractions(self.hidden()))

    def seen_error_decays(self, W: Rows) -> bool:
        """The spectrum of A - WC on the quotient by what C never sees: its characteristic
        polynomial divides."""
        s = sp.Symbol("s")
        whole = sp.Matrix(self.error(W)).charpoly(s).as_expr()
        polynomial = self.hidden().charpoly(s)
        quotient = whole / polynomial.as_expr()
        rest = sp.Poly(sp.cancel(quotient), s)
        return right_half_plane(rest) == 0 and not on_axis(rest)

    def unstable_roots(self, mode: str) -> int:
        if mode not in self.counted and self.lemma(mode):
            self.counted[mode] = 0  # e'e decreases
        if mode not in self.counted:
            matrix = sp.Matrix(self.loop(mode))
            characteristic = matrix.charpoly(sp.Symbol("s"))
            self.counted[mode] = right_half_plane(characteristic)
        return self.counted[mode]

    def lemma(self, mode: str) -> bool:
        one = eye(self.n * self.m)
        slack = times(self.slack(), one)
        return negative_definite(plus(self.lambda_(mode), slack))

    def verdicts(self, W: Rows | None) -> set[str]:
        """What may be said overall: "undecided" always, "proved" or "refuted" where the rules give
        it."""
        found = {"undecided"}
        region = self.document["region"]
        held = self.smooth and all(self.lemma(mode) for mode in self.modes)
        heard = self.error_decays(W)
        if held and heard and (region is None or self.linear):
            found.add("proved")
        one_mode = len(self.modes) == 1
        one = one_mode and self.exact and all(hurwitz(self.loop(mode)) for mode in self.modes)
        if one and heard and (region is None or self.linear):
            found.add("proved")
        if self._fails(region):
            found.add("refuted")
        assert found != {"undecided", "proved", "refuted"}
        return found

    def _fails(self, region: Any) -> bool:
        goals = {i: numbers([self.document["target"]])[0] for i in range(self.n)}
        for i, offset in self.document["offsets"]:
            offsets = numbers([offset])[0]
            goals[i] = [x + y for x, y in zip(goals[i], offsets, strict=True)]
        pairs = [] if region is None else numbers(region["initial_states"])
        for agent in range(self.n):
            alone = self.listened_to_from(agent)
            gains = [
                self.K[i * self.m + c][i * self.m : (i + 1) * self.m]
                for i in alone
                for c in range(self.m)
            ]
            common = [
                (max(lo - goals[i][c] for i in alone), min(hi - goals[i][c] for i in alone))
                for c, (lo, hi) in enumerate(pairs)
            ]
            if moves_within(sp.Matrix(gains).nullspace(), common, whole=region is None):
                return True
        quiet = region is not None and not Fraction(region["initial_disturbance"] or 0)
        if (
            self.A is not None
            and self.W is not None
            and not quiet
            and not self.seen_error_decays(self.W)
        ):
            return True
        inside = all(
            lo < goal[c] < hi for c, (lo, hi) in enumerate(pairs) for goal in goals.values()
        )
        return inside and any(
            self.exact_in(mode) and self.unstable_roots(mode) for mode in self.modes
        )

    # certificates

    def false_claims(self, document: dict[str, Any]) -> list[str]:
        """Every claim of a certificate that is not true, in words; sentences and advice are not
        read."""
        false = []
        if document["problem"] != self.document["name"]:
            false.append("name")
        if document["problem_sha256"] != hashlib.sha256(self.bytes).hexdigest():
            false.append("hash")
        observer = document["observer"]
        names = ("W", "P", "Q")
        W, P, Q = (None if observer[name] is None else numbers(observer[name]) for name in names)
        if self.W is not None and W != self.W:
            false.append("W")
        if observer["source"] != (
            None if W is None else "given" if self.W is not None else "designed"
        ):
            false.append("source of W")
        one_of_two = (P is None) != (Q is None)
        if one_of_two or (P is not None and (turned(P) != P or dot(P, W or []) != Q)):
            false.append("P, Q")
        for check in document["checks"]:
            title = f"{check['id']} {check.get('mode')}"
            if check["id"] in IDS:
                regions = Regions(self.document, observer["W"])
                false += [
                    f"{title}: {what}" for what in regions.false(check, document, self.domain)
                ]
            else:
                false += [f"{title}: {what}" for what in self._false_in(check, W, P, Q)]
            false += [f"{title}: {what}" for what in false_factor(check, document["checks"])]
        return false + self._false_overall(document, W)

    def _false_overall(self, document: dict[str, Any], W: Rows | None) -> list[str]:
        verdict = document["verdict"]
        checks = document["checks"]
        regions = Regions(self.document, document["observer"]["W"])
        covering = []
        for c in checks:
            if c["id"] in IDS and c["verdict"] == "proved" and regions.covers(c):
                covering.append(c)
        carrying = []
        for c in covering:
            if c["id"] == document["covered_by"] and c["id"] in COVERING:
                carrying.append(c)
        if verdict == "proved" and carrying:
            if document["rate"] == carrying[0]["rate"]:
                return []
            return ["rate"]
        own = []
        for c in checks:
            if c["id"] == document["covered_by"] and c["id"].endswith(
                ("weighted", "linearisation")
            ):
                own.append(c)
        if verdict == "proved" and own and (self.document["region"] is None or self.linear):
            found = (document["rate"], own[0]["verdict"])
            wanted = (own[0]["rate"], "proved")
            said = found == wanted
            if said and self.error_decays(W):
                return []
            return ["rate or the check of a proved verdict"]
        has_region = self.document["region"] is not None
        beside = has_region and any(
            c["id"] == "equilibrium" and c["verdict"] == "refuted" for c in checks
        )
        if verdict == "refuted" and beside:
            if document["rate"] is None and document["covered_by"] is None:
                return []
            return ["a rate without proof"]
        if verdict not in self.verdicts(W):
            return [f"verdict {verdict}"]
        if verdict != "proved":
            if document["rate"] is None and document["covered_by"] is None:
                return []
            return ["a rate without proof"]
        carrying = []
        for c in checks:
            if c["id"] == document["covered_by"] and c["verdict"] == "proved":
                carrying.append(c)
        theorem = "lemma1" if self.A is None else f"theorem{min(2, len(self.modes))}"
        if not carrying or document["covered_by"] not in (theorem, f"{theorem}-printed"):
            return ["covered_by"]
        rates = [c["rate"] for c in carrying]
        if document["rate"] in ((None,) if None in rates else (min(rates),)):
            return []
        return ["rate"]

    def _false_in(
        self, check: dict[str, Any], W: Rows | None, P: Rows | None, Q: Rows | None
    ) -> list[str]:
        if not set(check) <= FIELDS:
            return ["unknown fields"]
        id = check["id"]
        verdict = check["verdict"]
        if (check.get("mode") is not None) != (id in ("reachability", "lemma1")):
            return ["mode"]
        if check["domain"] != ("global" if id in PLAIN else self.domain):
            return ["domain"]
        if verdict == "undecided":
            claims = [check["margin"], check["rate"], check.get("exact"), check.get("witness")]
            if claims == [None] * 4:
                return []
            return ["claims of an undecided check"]
        if id in PLAIN:
            return self._false_plain(check, W)
        if not self.smooth:
            return ["no theorem applies"]
        if id.endswith("weighted"):
            return self._false_weights(check, W)
        if id == "linearisation":
            return self._false_linearisation(check, W)
        if id.endswith("printed"):
            if self.P is None or self.W is None:
                return ["no printed pair"]
            P = self.P
            Q = dot(self.P, self.W)
        return (self._false_proof if verdict == "proved" else self._false_refutation)(
            check, W, P, Q
        )

    def _false_plain(self, check: dict[str, Any], W: Rows | None) -> list[str]:
        id = check["id"]
        exact = check.get("exact")
        s = sp.Symbol("s")
        if check["margin"] is not None or (check["rate"] is not None and id != "hurwitz"):
            return ["number"]
        if id == "reachability":
            unreached = self.unreached([check["mode"]])
            alone = [self.labels[i] for i in unreached]
            witness = {"kind": "agents", "labels": alone} if alone else None
            true = not alone
            said = exact is None and check.get("witness") == witness
        elif id == "observability":
            rank = len(self.A or []) - self.hidden().rows
            true = rank == len(self.A or [])
            said = set(exact) == {"rank"} and number(exact["rank"]) == rank
        elif id == "detectability":
            if self.hidden().rows:
                characteristic = self.hidden().charpoly(s)
                polynomial = sp.Poly(characteristic.as_expr(), s)
            else:
                polynomial = sp.Poly(1, s)
            true = self.detectable()
            said = sp.Poly(read(exact["unobservable_polynomial"]), s) == polynomial
        else:
            if W is None:
                return ["no W"]
            true = hurwitz(self.error(W))
            said = True
            if check["rate"] is not None:
                given_rate = Fraction(repr(check["rate"]))
                shift = times(given_rate, eye(len(W)))
                shifted = plus(self.error(W), shift)
                said = check["rate"] > 0 and hurwitz(shifted)
        if true != (check["verdict"] == "proved"):
            return ["verdict"]
        return [] if said else ["exact"]

    def _false_proof(
        self, check: dict[str, Any], W: Rows | None, P: Rows | None, Q: Rows | None
    ) -> list[str]:
        margin, rate = (Fraction(repr(check[name] or 0.0)) for name in ("margin", "rate"))
        if check["margin"] is None or margin < 0 or rate < 0 or check.get("witness") is not None:
            return ["margin, rate or witness of a proof"]
        if check["id"] == "lemma1":
            larger = max(margin, 2 * rate) + self.slack()
            one = eye(self.n * self.m)
            shift = times(larger, one)
            nothing_exact = check.get("exact") is None
            true = nothing_exact and negative_definite(plus(self.lambda_(check["mode"]), shift))
            return [] if true else ["Lambda < 0"]
        if P is None or Q is None or not positive_definite(P):
            return ["P"]
        for mode in self.modes:
            for extra, pace in ((margin, Fraction(0)), (Fraction(0), rate)):
                more = extra + self.slack()
                matrix = self.psi(mode, P, Q, margin=more, rate=pace)
                if not negative_definite(matrix):
                    return [f"Psi < 0 in {mode}"]
        return self._false_exact(check["exact"], P, Q)

    def _false_weights(self, check: dict[str, Any], W: Rows | None) -> list[str]:
        """V = e'De + sum eps_i' P eps_i along (22), as one matrix."""
        rate = Fraction(repr(check["rate"] or 0.0))
        exact = check.get("exact") or {}
        positive = check["rate"] is None or rate > 0
        if (
            check["verdict"] != "proved"
            or not positive
            or check["margin"] is not None
            or check.get("witness")
        ):
            return ["margin, rate or witness"]
        D = [number(x) for x in exact["D"]]
        P = numbers(exact["P"]) if self.A is not None else []
        if (
            min(D) <= 0
            or (P and (turned(P) != P or not positive_definite(P)))
            or (self.A is not None and W is None)
        ):
            return ["D or P"]
        V = []
        for i in range(len(D)):
            columns = range(len(D))
            row = [D[i] if i == j else Fraction(0) for j in columns]
            V.append(row)
        corner = zeros(len(D), self.n * len(P))
        if P:
            errors = kron(eye(self.n), P)
            lower = [turned(corner), errors]
            V = block([[V, corner], lower])
        for mode in self.modes:
            loop = self.loop(mode)
            if W is not None and self.C is not None:
                own = kron(eye(self.n), self.error(W))
                upper = [loop, kron(eye(self.n), self.C)]
                loop = block([upper, [turned(corner), own]])
            transposed = turned(dot(V, loop))
            growth = times(2 * rate, V)
            if not negative_definite(plus(dot(V, loop), transposed, growth)):
                return [f"V' <= -2 rate V in {mode}"]
        return []

    def _false_linearisation(self, check: dict[str, Any], W: Rows | None) -> list[str]:
        (mode,) = self.modes
        if check["margin"] is not None or check.get("witness") or not self.exact:
            return ["margin or witness"]
        if check["verdict"] == "refuted":
            roots = number((check.get("exact") or {})["unstable_roots"])
            if check["rate"] is None and 0 < roots <= self.unstable_roots(mode):
                return []
            return ["unstable_roots"]
        rate = Fraction(repr(check["rate"] or 0.0))
        loops = [
            self.loop(mode),
            *([self.error(W)] if self.A is not None and W is not None else []),
        ]
        shifted = []
        for x in loops:
            shifted.append(plus(x, times(rate, eye(len(x)))))
        decays = (check["rate"] is None or rate > 0) and all(map(hurwitz, shifted))
        if decays and (self.A is None or W is not None):
            return []
        return ["rate"]

    def error_decays(self, W: Rows | None) -> bool:
        return self.A is None or (W is not None and hurwitz(self.error(W)))

    def _false_exact(self, exact: dict[str, Any], P: Rows, Q: Rows) -> list[str]:
        S = self._schur(P, Q)
        same_P = numbers(exact["P"]) == P
        true = same_P and numbers(exact["Q"]) == Q and numbers(exact["S"]) == S
        scalar = times(S[0][0], eye(len(S))) == S
        bound = number(exact["bound"]) if "bound" in exact else None
        if true and bound == (-S[0][0] if scalar else None):
            return []
        return ["exact"]

    def _schur(self, P: Rows, Q: Rows) -> Rows:
        omega = self._omega(P, Q)
        inverse = sp.Matrix(omega).inv()
        seen = -sp.Matrix(self.C) * inverse
        columns = sp.Matrix(self.C).T
        return fractions(seen * columns)

    def _omega(self, P: Rows, Q: Rows) -> Rows:
        parts = (self.A, self.C, P, Q)
        A, C, P_, Q_ = (sp.Matrix(x) for x in parts)
        free = P_ * A + A.T * P_ - Q_ * C
        injected = C.T * Q_.T
        return fractions(free - injected)

    def _false_refutation(
        self, check: dict[str, Any], W: Rows | None, P: Rows | None, Q: Rows | None
    ) -> list[str]:
        id = check["id"]
        exact = check.get("exact") or {}
        mode = check.get("mode")
        rate_is_given = check["rate"] is not None
        if rate_is_given or (check["margin"] is not None and check["margin"] > 0):
            return ["number"]
        part = exact.get("block")
        if part in ("detectability", "hurwitz"):
            true = self.W is not None and not hurwitz(self.error(self.W))
            if part == "detectability":
                true = not self.detectable()
            not_printed = not id.endswith("printed")
            alone = not_printed and check["margin"] is None and len(exact) == 1
            return [] if true and alone else ["obstacle"]
        v = [number(text) for text in check["witness"]["values"]]
        if check["witness"]["kind"] != "vector" or not any(v):
            return ["witness"]
        if id == "lemma1" or part == "Lambda":
            mode = mode or exact["mode"]
            labels = []
            for i in range(self.n):
                if any(v[i * self.m : (i + 1) * self.m]):
                    labels.append(self.labels[i])
            if check["witness"].get("labels") != labels:
                return ["labels"]
            value = form(self.lambda_(mode), v)
            if value < -self.slack() or not self._reaches(check, value, v):
                return ["v' Lambda v"]
            if id == "lemma1":
                roots = self.unstable_roots(mode) if self.exact_in(mode) else 0
                claimed = number(exact["unstable_roots"])
                if claimed.denominator != 1 or not 0 <= claimed <= roots:
                    return ["unstable_roots"]
                if number(exact.get("value", str(value))) > value + self.slack():
                    return ["exact"]
            if set(exact) <= {"value", "unstable_roots", "block", "mode"}:
                return []
            return ["exact"]
        if not id.endswith("printed") or P is None or Q is None:
            return ["one pair refutes nothing"]
        if part in ("P", "Omega0"):
            matrix = times(-1, P) if part == "P" else self._omega(P, Q)
            alone = (
                check["margin"] is None
                and len(exact) == 1
                and check["witness"].get("labels") is None
            )
            if form(matrix, v) >= 0 and alone:
                return []
            return [part]
        # With eps_i = (-Omega)^-1 C' e_i the whole Psi takes the value that the Reduction gives.
        inverse = sp.Matrix(self._omega(P, Q)).inv()
        seen = -sp.Matrix(self.C).T
        tails = inverse * seen
        parts = []
        for i in range(self.n):
            parts.append(sp.Matrix(v[i * self.m : (i + 1) * self.m]))
        whole = [*v, *(x for part in parts for x in fractions((tails * part).T)[0])]
        value = form(self.psi(exact["mode"], P, Q, margin=Fraction(0), rate=Fraction(0)), whole)
        if value < -self.slack() or not self._reaches(check, value, v):
            return ["v' Psi v"]
        return self._false_exact(exact, P, Q)

    def _reaches(self, check: dict[str, Any], value: Fraction, v: list[Fraction]) -> bool:
        if check["margin"] is None:
            return True
        square = sum((x * x for x in v), Fraction(0))
        least = -Fraction(repr(check["margin"])) * square
        allowed = value + self.slack() * square
        return least <= allowed


def moves_within(
    free: list[sp.Matrix], box: list[tuple[Fraction, Fraction]], *, whole: bool
) -> bool:
    """Whether some c != 0 spanned by ``free`` lies in the box: c = F t, one linear program for each
    end of each c_k."""
    if whole or not free:
        return bool(free)
    columns = sp.Matrix.hstack(*free).tolist()
    F = np.array(columns, dtype=float)
    upper = [float(hi) for _, hi in box]
    lower = [-float(lo) for lo, _ in box]
    limits = upper + lower
    ends = []
    for row in F:
        for sign in (1, -1):
            both = np.vstack([F, -F])
            answer = linprog(sign * row, A_ub=both, b_ub=limits, bounds=(None, None))
            ends.append(answer)
    return any(end.status == 0 and abs(end.fun) > 1e-9 for end in ends)


def key(h: Any) -> tuple[str, ...]:
    if isinstance(h, str):
        return (h,)
    return tuple(h)


def read(text: str) -> sp.Expr:
    """A polynomial in s as the package writes it: "s^2 - 1/2 s + 4"."""
    spaced = re.sub(r"(\d) s", r"\1*s", text)
    powers = spaced.replace("^", "**")
    return sp.sympify(powers, rational=True)


@cache
def slope(h: tuple[str, ...], m: int) -> tuple[Rows, bool, bool]:
    """dh/dy at 0 by SymPy (m x m, to 80 digits), whether h is linear, whether the slopes are
    rational."""
    y = sp.symbols(f"y1:{m + 1}")
    names = {f"y{i + 1}": symbol for i, symbol in enumerate(y)}
    if len(h) == 1:
        texts = []
        for c in range(m):
            texts.append(sp.sympify(h[0], locals={**names, "y": y[c]}, rational=True))
    else:
        texts = [sp.sympify(text, locals=names, rational=True) for text in h]
    partials = [[sp.diff(text, symbol) for symbol in y] for text in texts]
    values = []
    for row in partials:
        values.append([entry.subs(dict.fromkeys(y, 0)) for entry in row])
    linear = not any(sp.expand(entry).free_symbols for row in partials for entry in row)
    rational = all(value.is_Rational for row in values for value in row)
    return [[number_of(value) for value in row] for row in values], linear, rational


def number_of(value: sp.Expr) -> Fraction:
    if value.is_Rational:
        return Fraction(int(value.p), int(value.q))
    near = sp.Rational(str(sp.N(value, 80)))
    return Fraction(int(near.p), int(near.q))


def number(text: Any) -> Fraction:
    assert isinstance(text, str)
    top, _, bottom = text.partition("/")
    return Fraction(top) / Fraction(bottom or "1")


def numbers(rows: Any) -> Rows:
    return [[number(entry) for entry in row] for row in rows]


def fractions(M: sp.Matrix) -> Rows:
    found = []
    for i in range(M.rows):
        row = [Fraction(int(x.p), int(x.q)) for x in M.row(i)]
        found.append(row)
    return found


def right_half_plane(polynomial: sp.Poly) -> int:
    """Roots with positive real part, counted on irreducible factors: their roots are simple, hence
    accurate."""
    axis = mpmath.mpf(10) ** -25
    return sum(
        multiplicity * sum(root.real > axis for root in roots)
        for roots, multiplicity in _roots(polynomial)
    )


def on_axis(polynomial: sp.Poly) -> bool:
    return any(
        abs(root.real) <= mpmath.mpf(10) ** -25 for roots, _ in _roots(polynomial) for root in roots
    )


def _roots(polynomial: sp.Poly) -> list[tuple[list[Any], int]]:
    found = []
    with mpmath.workdps(60):
        factors = sp.factor_list(polynomial.as_expr(), sp.Symbol("s"))
        for factor, multiplicity in factors[1]:
            coefficients = []
            for c in sp.Poly(factor, sp.Symbol("s")).all_coeffs():
                numerator = mpmath.mpf(int(c.p))
                quotient = numerator / int(c.q)
                coefficients.append(quotient)
            roots = mpmath.polyroots(coefficients, maxsteps=500, extraprec=400)
            found.append(([mpmath.mpc(root) for root in roots], multiplicity))
    return found
