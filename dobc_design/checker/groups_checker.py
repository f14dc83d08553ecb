"""The lone checker's part about groups: agents with different exosystems and observers.

It lies beside checker.py, which loads it when problem.json holds several groups. Standard library only, nothing of the
package but checker.py: written from docs/certificate-format.md, section "Groups of agents", alone.
Side by side the groups are one exosystem with block diagonal A, C, W, P; what is decided agent by agent takes the block
of the agent's own group. Everything else is decided by checker.py and region_checker.py as for one exosystem.
"""

from __future__ import annotations

import hashlib
import json
from copy import copy
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

# The length of this file is counted, so its lines are set by hand.

# isort: off
from .checker import (
    FACTS,
    ZERO,
    Examination as Single,
    Matrix,
    Problem as Undisturbed,
    Rows,
    direction,
    document,
    form,
    matrix,
    maybe,
    need,
    number,
    of,
    plus,
    positive,
    product,
    rational,
    read,
    stable,
    text,
)

__all__ = ["KINDS"]


def diagonal(blocks: list[Any]) -> Matrix:
    """Blocks along the diagonal, zeros elsewhere."""
    width, before, rows = sum(len(block[0]) for block in blocks), 0, Matrix()
    for block in blocks:
        rows += [[ZERO] * before + list(row) + [ZERO] * (width - before - len(row)) for row in block]
        before += len(block[0])
    return rows


def parts(X: Matrix, shapes: list[tuple[int, int]]) -> list[Matrix]:
    """The diagonal blocks of X, which must be zero elsewhere."""
    blocks, row, column = list[Matrix](), 0, 0
    for rows, columns in shapes:
        blocks.append([line[column : column + columns] for line in X[row : row + rows]])
        row, column = row + rows, column + columns
    need(diagonal(blocks) == X, "a matrix is not block diagonal")
    return blocks


class Problem(Undisturbed):
    """problem.json: read as if there were no disturbance, and the groups beside it; A, C, W and P block diagonal."""

    def __init__(self, data: bytes) -> None:
        source = document(data, "dobc-problem")
        plain = dict(source, exosystem=None, observer={"W": None, "P": None, "rate": None})
        plain |= {key: None for key in ("switching", "simulation") if key in source}  # never part of a proof
        super().__init__(json.dumps(plain, default=str).encode())
        self.sha256, m = hashlib.sha256(data).hexdigest(), self.m
        common = read(source.get("observer"), {"W": maybe(text), "P": maybe(text), "rate": maybe(rational)})
        need(common.W is None and common.P is None, "W and P belong to the groups")
        given = read(source.get("exosystem"), {"groups": [of(dict)]}).groups
        self.parts = [self.group(value) for value in given]
        need(len(given) > 1, "there are fewer than two groups")
        need(sorted(i for part in self.parts for i in part.agents) == list(range(self.n)), "an agent has not one group")
        firsts = [part.agents[0] for part in self.parts]
        need(firsts == sorted(firsts), "the groups are not ordered by their first agents")
        need(len({part.P is None for part in self.parts}) == 1, "some groups have a P and some have none")
        self.orders = [len(part.A) for part in self.parts]
        self.q, self.names = sum(self.orders), [self.labels[first] for first in firsts]
        self.A, self.C = diagonal([part.A for part in self.parts]), diagonal([part.C for part in self.parts])
        self.W = None if any(part.W is None for part in self.parts) else diagonal([part.W for part in self.parts])
        self.P = None if self.parts[0].P is None else diagonal([part.P for part in self.parts])
        place = {i: g * m for g, part in enumerate(self.parts) for i in part.agents}
        self.place = [place[i] for i in range(self.n)]

    def group(self, value: Any) -> Any:
        """One group: its agents, A, C, W and P."""
        rows = value.get("A")
        q, m = len(rows) if type(rows) is list else 0, self.m
        need(q > 0, "an exosystem has no state")
        part = read(
            value,
            {
                "agents": [of(int)],
                "A": matrix(q, q),
                "C": matrix(m, q),
                "W": maybe(matrix(q, m)),
                "P": maybe(matrix(q, q)),
            },
        )
        need(bool(part.agents) and part.agents == sorted(set(part.agents)), "the agents of a group are not in order")
        need(part.P is None or part.W is not None, "a group has a P without a W")
        return part


class Examination(Single):
    """One certificate against one problem with groups. A view is what the checks of one group are decided with."""

    problem: Problem

    def __init__(self, certificate: bytes, problem: Problem) -> None:
        super().__init__(certificate, problem)
        self.views: dict[Any, Any] = {}
        self.parts = problem.names

    def observer(self) -> None:
        """W and P are block diagonal, and the blocks of W are the gains that groups have."""
        p = self.problem
        super().observer()
        gains = [None] * len(p.parts) if self.W is None else parts(self.W, [(q, p.m) for q in p.orders])
        if self.P is not None:
            parts(self.P, [(q, q) for q in p.orders])
        for name, part, W in zip(p.names, p.parts, gains, strict=True):
            need(W is None or part.W is None or W == part.W, "the observer gain of a group is not that of the problem")
            view: Any = copy(self)
            view.problem, view.W = SimpleNamespace(A=part.A, C=part.C, W=part.W, q=len(part.A)), W
            self.views[name] = view

    def confirm(self, check: Any) -> None:
        Single.confirm(self.views[check.group] if check.id in FACTS[:3] else self, check)

    def negative(self, mode: str, shift: Fraction, S: Matrix | None = None) -> bool:
        """Lambda + the blocks of S of the agents + shift I < 0 in that mode."""
        p = self.problem
        lemma = next(each for each in self.checks if (each.id, each.mode) == ("lemma1", mode))
        if lemma.verdict == "proved" and lemma.exact is not None:  # its vector bounds Lambda, whatever the blocks are
            blocks = parts(S, [(p.m, p.m)] * len(p.parts)) if S else [None]
            return all(Single.negative(self, mode, shift, block) for block in blocks)
        rows: Rows = [{j: -x for j, x in row.items()} for row in p.bound(mode)]
        for i, row in enumerate(rows):
            row[i] -= shift
            for d in range(p.m if S else 0):
                start, j = p.place[i // p.m], i - i % p.m + d
                x = S[start + i % p.m][start + d] if S else ZERO
                short = number(x, x)
                row[j] = row.get(j, ZERO) - (short.lo + short.hi) / 2
                row[i] -= short.hi - short.lo
        return positive(rows)

    def vector(self, check: Any, mode: str, S: Matrix | None = None) -> Fraction:
        """The witness v shows that X = Lambda + the blocks of S has v'Xv >= max(0, -M v'v); a lower bound of v'Xv."""
        if S is None:
            return super().vector(check, mode)
        p = self.problem
        v = read(check.witness, {"kind": text, "labels": [text], "values": direction(p.n * p.m)}).values
        blocks = parts(S, [(p.m, p.m)] * len(p.parts))
        own = [(v[i * p.m : i * p.m + p.m], blocks[place // p.m]) for i, place in enumerate(p.place)]
        extra = sum((form(part, block, part) for part, block in own), ZERO)
        wanted = max(ZERO, -(check.margin or ZERO) * sum((x * x for x in v), ZERO))
        low = p.low(mode, [*v, ZERO]) + extra
        need(low >= wanted, "the vector does not show it")
        self.named(check, v)
        return low

    def named(self, check: Any, v: list[Fraction]) -> None:
        """The witness is a vector, and its labels are the agents where it is not 0."""
        p, witness = self.problem, read(check.witness, {"kind": text, "labels": [text], "values": [rational]})
        need(witness.kind == "vector", "the witness is no vector")
        support = [label for i, label in enumerate(p.labels) if any(v[i * p.m : i * p.m + p.m])]
        need(witness.labels == support, "the labels are not the agents where the vector is not 0")

    def theorem_refuted(self, check: Any) -> None:
        """By Lambda of a mode, or by the exosystem or the gain of one group."""
        exact = read(check.exact, {"block": text, "mode?": text, "group?": text})
        if exact.group is None:
            need(exact.block == "Lambda", "it does not say which group is the cause")
            super().theorem_refuted(check)
            return
        need(exact.block in FACTS[1:3] and exact.group in self.views, "the cause is no group and none of its checks")
        cause = copy(check)
        cause.exact = {key: value for key, value in check.exact.items() if key != "group"}
        Single.theorem_refuted(self.views[exact.group], cause)

    def refuted(self) -> bool:
        """Also if the own gain of one group leaves an error that reaches its agents and does not decay."""
        region = self.problem.region
        disturbed = region is None or (region.initial_disturbance or 0) > 0
        return (disturbed and any(lasting(view) for view in self.views.values())) or super().refuted()


def lasting(view: Any) -> bool:
    """True if the group has a gain of its own and the observable part of A - W C is not Hurwitz with it."""
    part, (T, columns) = view.problem, view.observable()
    if part.W is None:
        return False
    closed = plus(part.A, -1, product(part.W, part.C))
    return not stable([[row[k] for k in columns] for row in product(T, closed)])


KINDS = (Problem, Examination)
