"""The oracle for problems in which agents have different exosystems, and random problems of that
kind.

What is true of one group is asked of the oracle for a problem in which all agents have that group's
exosystem.  Psi is written out as one matrix with every agent's own C and Omega0 in its place, from
the agents' lists in problem.json; the Reduction does not enter.
"""

import json
from fractions import Fraction
from random import Random
from typing import Any

import sympy as sp
from random_problems import _exosystem, _observer, random_linear_problem, random_problem

from dobc_design import Exosystem, Group, Observer, Problem, Verdict
from dobc_design.exact.observability import decide_observable
from dobc_design.problem.canonical import canonical_bytes
from oracles.theorems import (
    PLAIN,
    Oracle,
    Rows,
    dot,
    eye,
    form,
    fractions,
    number,
    numbers,
    plus,
    times,
    turned,
    zeros,
)


def random_grouped_problem(seed: int) -> Problem:
    """The next random problem of two agents or more, divided into two or three groups; W and P
    given or not."""
    r = Random(f"groups {seed}")
    make = random_linear_problem if r.random() < 0.4 else random_problem
    friendly = r.random() < 0.6  # all pinned, nothing hidden, W designed: most of these are proved
    drawn = map(make, range(1000 * seed, 1000 * seed + 1000))
    base = next(p for p in drawn if p.n > 1 and (not friendly or len(p.pinning.gains) == p.n))
    labels = list(base.network.labels)
    own = {}
    for label in labels:
        own[label] = r.randrange(3 if len(labels) > 2 else 2)
    own[labels[0]], own[labels[-1]] = 0, 1
    chosen = {}
    for g in sorted(set(own.values())):
        chosen[g] = [label for label in labels if own[label] == g]
    systems = {g: _exosystem(r, base.m) for g in chosen}
    while friendly and {decide_observable(each.A, each.C).verdict for each in systems.values()} != {
        Verdict.PROVED
    }:
        systems = {g: _exosystem(r, base.m) for g in chosen}
    observers = {g: _observer(r, systems[g]) for g in chosen}
    if friendly and r.random() < 0.7:
        observers = dict.fromkeys(chosen, Observer())
    if any(each.P is None for each in observers.values()):
        observers = {g: Observer(W=each.W) for g, each in observers.items()}
    groups = []
    for g, agents in chosen.items():
        groups.append(Group(agents=agents, exosystem=systems[g], observer=observers[g]))
    return with_groups(base, groups, disturbance=r.choice((0, 0.5, 3)))


def with_groups(base: Problem, groups: list[Group], *, disturbance: Any = 0.5) -> Problem:
    """The network of a problem with these groups in place of what it has."""
    given = dict(base.__reduce__()[0].keywords)
    given |= {"exosystem": None, "observer": None, "groups": groups}
    if base.region is not None:
        given["region"] = {
            "initial_states": base.region.initial_states,
            "initial_disturbance": disturbance,
        }
    return Problem(**given)


class GroupsOracle(Oracle):
    """What is true of one problem with groups."""

    def __init__(self, problem: Problem) -> None:
        document = json.loads(canonical_bytes(problem))
        given = document["exosystem"]["groups"]
        plain = [_alike(problem, part) for part in given]
        super().__init__(plain[0])
        names = [document["labels"][min(part["agents"])] for part in given]
        both = zip(names, plain, strict=True)
        self.parts = {name: Oracle(each) for name, each in both}
        self.bytes = canonical_bytes(problem)
        self.document = document
        self.members = [part["agents"] for part in given]
        self.systems = [(numbers(part["A"]), numbers(part["C"])) for part in given]
        A_parts = diagonal([A for A, _ in self.systems])
        C_parts = diagonal([C for _, C in self.systems])
        self.A, self.C = (A_parts, C_parts)
        given_all = all(part["W"] for part in given)
        self.W = diagonal([numbers(part["W"]) for part in given]) if given_all else None
        self.P = (
            diagonal([numbers(part["P"]) for part in given])
            if all(part["P"] for part in given)
            else None
        )
        # What regions are asked about: the rows of all C, with the joint A.
        own, before = {}, 0
        groups_and_systems = zip(self.members, self.systems, strict=True)
        for g, (agents, (A, _)) in enumerate(groups_and_systems):
            places = list(range(before, before + len(A)))
            owner = (g * self.m, places)
            own |= dict.fromkeys(agents, owner)
            before += len(A)
        owners = [own[i] for i in range(self.n)]
        joint = {"A": _texts(self.A), "C": _texts(self.C), "own": owners}
        self.document = document | {"exosystem": joint}

    def blocks(self, M: Rows, widths: list[int]) -> list[Rows]:
        """The diagonal blocks, one per group."""
        found = []
        row = 0
        column = 0
        for (A, _), width in zip(self.systems, widths, strict=True):
            rows = M[row : row + len(A)]
            columns = [line[column : column + width] for line in rows]
            found.append(columns)
            row = row + len(A)
            column = column + width
        return found

    def psi(self, mode: str, P: Rows, Q: Rows, *, margin: Fraction, rate: Fraction) -> Rows:
        """(18) with the blocks of every agent's own group, written entry by entry."""
        m = self.m
        top = self.n * self.m
        own = {i: g for g, agents in enumerate(self.members) for i in agents}
        orders = [len(self.systems[own[i]][0]) for i in range(self.n)]
        whole = zeros(top + sum(orders), top + sum(orders))
        shift = times(margin + 2 * rate, eye(top))
        corner = plus(self.lambda_(mode), shift)
        for i in range(top):
            whole[i][:top] = corner[i]
        widths = [len(A) for A, _ in self.systems]
        Ps = self.blocks(P, widths)
        Qs = self.blocks(Q, [m] * len(self.systems))
        start = top
        for i in range(self.n):
            system = self.systems[own[i]]
            P_block = Ps[own[i]]
            Q_block = Qs[own[i]]
            (A, C), own_P, own_Q = system, P_block, Q_block
            injected = times(-1, dot(own_Q, C))
            half = plus(dot(own_P, A), injected, times(rate, own_P))
            omega = plus(half, turned(half))
            for k in range(orders[i]):
                whole[start + k][start : start + orders[i]] = omega[k]
                for c in range(m):
                    whole[i * m + c][start + k] = whole[start + k][i * m + c] = C[c][k]
            start += orders[i]
        return whole

    def false_claims(self, document: dict[str, Any]) -> list[str]:
        observer = document["observer"]
        false = []
        orders = [len(A) for A, _ in self.systems]
        of_gain = ("W", [self.m] * len(orders))
        for name, widths in (of_gain, ("P", orders)):
            M = [] if observer[name] is None else numbers(observer[name])
            blocks = self.blocks(M, widths) if M else []
            false += [] if not M or diagonal(blocks) == M else [f"{name} is not block diagonal"]
            pairs = zip(self.parts.values(), blocks, strict=True) if M and name == "W" else ()
            false += ["W of a group" for part, block in pairs if part.W not in (None, block)]
        return false + super().false_claims(document)

    def _false_in(
        self, check: dict[str, Any], W: Rows | None, P: Rows | None, Q: Rows | None
    ) -> list[str]:
        group = check.get("group")
        if (group is not None) != (check["id"] in PLAIN[:3]):
            return ["group"]
        if group is not None:
            part, own = self._part(group, W)
            plain = {key: x for key, x in check.items() if key != "group"}
            return part._false_in(plain, own, None, None)
        return super()._false_in(check, W, P, Q)

    def _part(self, group: str, W: Rows | None) -> tuple[Oracle, Rows | None]:
        place = list(self.parts).index(group)
        own = None if W is None else self.blocks(W, [self.m] * len(self.systems))[place]
        return self.parts[group], own

    def _false_refutation(
        self, check: dict[str, Any], W: Rows | None, P: Rows | None, Q: Rows | None
    ) -> list[str]:
        exact = check.get("exact") or {}
        if exact.get("block") in ("detectability", "hurwitz"):
            if exact.get("group") not in self.parts:
                return ["group"]
            part, own = self._part(exact["group"], W)
            plain = {key: x for key, x in exact.items() if key != "group"}
            named = check | {"exact": plain}
            return part._false_refutation(named, own, None, None)
        if "group" in exact:
            return ["group"]
        if not check["id"].endswith("printed") or exact.get("block") in ("P", "Omega0"):
            return super()._false_refutation(check, W, P, Q)
        rate_is_given = check["rate"] is not None
        if rate_is_given or (check["margin"] is not None and check["margin"] > 0):
            return ["number"]
        assert P is not None
        assert Q is not None
        v = [number(text) for text in check["witness"]["values"]]
        m = self.m
        own = {i: g for g, agents in enumerate(self.members) for i in agents}
        widths = [len(A) for A, _ in self.systems]
        Ps = self.blocks(P, widths)
        Qs = self.blocks(Q, [m] * len(self.systems))
        tails = []
        for (A, C), one, other in zip(self.systems, Ps, Qs, strict=True):
            injected = times(-1, dot(other, C))
            half = plus(dot(one, A), injected)
            symmetric = plus(half, turned(half))
            inverse = sp.Matrix(symmetric).inv()
            tails.append(-inverse * sp.Matrix(C).T)
        whole = list(v)
        for i in range(self.n):
            tail = tails[own[i]] * sp.Matrix(v[i * m : (i + 1) * m])
            whole += fractions(tail.T)[0]
        matrix = self.psi(exact["mode"], P, Q, margin=Fraction(0), rate=Fraction(0))
        value = form(matrix, whole)
        if not any(v) or value < -self.slack() or not self._reaches(check, value, v):
            return ["v' Psi v"]
        return self._false_exact(exact, P, Q)

    def _fails(self, region: Any) -> bool:
        quiet = region is not None and not Fraction(region["initial_disturbance"] or 0)
        parts = self.parts.values()
        lasting = (part.W is not None and not part.seen_error_decays(part.W) for part in parts)
        return super()._fails(region) or (not quiet and any(lasting))


def diagonal(blocks: list[Rows]) -> Rows:
    """Blocks along the diagonal."""
    height = sum(map(len, blocks))
    width = sum(len(block[0]) for block in blocks)
    whole = zeros(height, width)
    row = column = 0
    for block in blocks:
        for k, line in enumerate(block):
            whole[row + k][column : column + len(line)] = line
        row = row + len(block)
        column = column + len(block[0])
    return whole


def _texts(M: Rows) -> list[list[str]]:
    return [[str(x) for x in row] for row in M]


def _alike(problem: Problem, part: dict[str, Any]) -> Problem:
    """The same network with the exosystem and the observer of one group for every agent."""
    given = dict(problem.__reduce__()[0].keywords)
    settings = problem.simulation
    exosystem = Exosystem(A=part["A"], C=part["C"])
    given |= {"groups": None, "exosystem": exosystem}
    observer = Observer(W=part["W"], P=part["P"])
    simulation = {"seed": settings.seed}
    given |= {"observer": observer, "simulation": simulation}
    return Problem(**given)
