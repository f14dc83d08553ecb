"""max-separable in coordinates z_i = T e_i: N = max |z_ic| / v_ic decreases while N <= rho, where
gains are bounded.

By the mean value theorem h_ij = J (e_j - e_i) with J in the gains of the arc, and what f adds to A
is F e_i. The worst corner of J and F counts in every row, and the worst signs of the agent's other
components.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cache, partial
from operator import mul
from typing import Any

from .expressions import Coupling
from .files import Certificate, Problem
from .matrices import ZERO, Matrix, diagonal, echelon, identity, integers, product
from .quadratic import Ranges, read_ranges
from .reading import MATRIX_BITS, integer, matrix, maybe, need, rational, read, short, weights
from .separable import composite, holds_box, max_separable, observed, starts

MOST = 6  # components of an agent; gains of a coupling that vary


def boxes(case: Certificate, check: Any) -> None:
    """A claim of max-separable, in coordinates or without."""
    p, own = case.problem, check.exact is not None and "T" in check.exact
    need(
        own or (not p.nodes and all(h.single for h in p.couplings)),
        "a coupling is a list, or nodes are curved",
    )
    (in_coordinates if own else max_separable)(case, check)


def in_coordinates(case: Certificate, check: Any) -> None:
    """V decreases in the region, at the rate of the check."""
    p, m = case.problem, case.problem.m
    shape = {
        "T": matrix(m, m),
        "v": partial(weights, p.n * m),
        "alpha": rational,
        "rho": maybe(rational),
    }
    claim = read(check.exact, shape | {"ranges": gains(m)} | observed(p))
    S = inverse(claim.T)

    need(p.q == 0 or claim.kappa > 0, "kappa is not positive")
    second = claim.beta - 1 / (claim.kappa * min(claim.v)) if p.q else claim.alpha
    need(
        check.rate is not None and 0 < check.rate <= min(claim.alpha, second),
        "the rate does not follow",
    )
    composite(case, claim, outputs(p, claim.T))
    if claim.rho is None:
        need(check.domain == "global" == p.domain, "it has no rho and is not global")
    else:
        starts(case, check.domain, "box")
        holds_box(claim, check.domain, claim.rho, spread(claim.T, claim.v))
    shown(case, claim, S)


def gains(m: int) -> Any:
    """The shape of the ranges of a claim."""
    return [{"coupling": integer, "gains": (((rational, rational),) * m,) * m}]


def outputs(p: Problem, T: Matrix) -> Matrix:
    """T C of every group."""
    return product(diagonal([T] * len(p.groups)), p.C) if p.q else p.C


def spread(T: Matrix, v: Sequence[Fraction]) -> Fraction:
    """The largest N of errors with |e| <= 1."""
    return max(Fraction(sum(map(abs, row))) / min(v[c :: len(T)]) for c, row in enumerate(T))


def sizes(S: Matrix, v: Sequence[Fraction]) -> Iterator[list[Fraction]]:
    """The largest |e_ic| of every agent where N <= 1."""
    for k in range(0, len(v), len(S)):
        yield [
            sum((abs(s) * x for s, x in zip(row, v[k : k + len(S)], strict=True)), ZERO)
            for row in S
        ]


def far(case: Certificate, S: Matrix, claim: Any) -> dict[Coupling, Any]:
    """How far the arguments of every coupling go where N <= rho, by component."""
    p, m = case.problem, case.problem.m
    reach = list(sizes(S, claim.v))
    found = {h: [ZERO] * m for h in p.couplings}
    for arc in (arc for arcs in p.modes.values() for arc in arcs):
        both = (x + y for x, y in zip(reach[arc.i], reach[arc.j], strict=True))
        found[arc.coupling] = list(map(max, found[arc.coupling], both))
    for nodes in p.couplings[len(p.couplings) - p.nodes :]:
        found[nodes] = [max(column) for column in zip(*reach, strict=True)]
    return {
        h: None if claim.rho is None else [claim.rho * x for x in each] for h, each in found.items()
    }


def inverse(T: Matrix) -> Matrix:
    """T^-1, of few bits and not too large."""
    m = len(T)
    need(m <= MOST, f"there are more than {MOST} components")
    short((x for row in T for x in row), MATRIX_BITS)
    rows, pivots = echelon([[*own, *unit] for own, unit in zip(T, identity(m), strict=True)])
    need(pivots == [*range(m)], "T is singular")
    return [row[m:] for row in rows]


def shown(case: Certificate, claim: Any, S: Matrix, load: Sequence[Fraction] = ()) -> None:
    """The gains are those of the couplings, and the rows hold at the rate alpha with ``load`` (n
    m,) added."""
    outward = [claim.alpha * x for x in claim.v]
    added = [x + y for x, y in zip(outward, load, strict=True)] if load else outward
    judge(case, claim, S, read_ranges(case.problem, claim, far(case, S, claim)))(
        claim.v, added, case.problem.modes
    )


def judge(
    case: Certificate, claim: Any, S: Matrix, ranges: Ranges
) -> Callable[[Any, Any, Iterable[str]], None]:
    """What shows, for weights v, a load (n m,) and modes: for every row c of G = T J S, all x with
    x_c = v_ic and |x_d| = v_id, in every one of the modes: sum of w (|G| v_j - G x) + T (F - B K) S
    x + load_ic <= 0."""
    p, m = case.problem, case.problem.m
    beside = (ranges[h] for h in p.couplings[len(p.couplings) - p.nodes :])  # A, which gains hold
    F = [
        [(lo - a, hi - a) for (lo, hi), a in zip(*rows, strict=True)]
        for h in beside
        for rows in zip(h, p.drift, strict=True)
    ]
    H = [product(product(claim.T, p.gains.get(i, identity(m, 0))), S) for i in range(p.n)]

    @cache
    def corners(h: Coupling) -> list[tuple[list[list[int]], int]]:
        ends = [sorted(set(pair)) for row in ranges[h] for pair in row]
        need(sum(len(each) > 1 for each in ends) <= MOST, "too many gains of a coupling vary")
        matrices = (
            [list(J[k : k + m]) for k in range(0, m * m, m)] for J in itertools.product(*ends)
        )
        every = [product(product(claim.T, J), S) for J in matrices]
        flat = [integers([x for G in every for x in G[c]]) for c in range(m)]
        return [([g[k : k + m] for k in range(0, len(g), m)], unit) for g, unit in flat]

    def hold(weights: Any, load: Any, modes: Iterable[str]) -> None:
        v, bottom = integers(weights)

        @cache
        def pull(h: Coupling, c: int, j: int) -> list[int]:
            return [
                sum(abs(g) * y for g, y in zip(G, v[j * m : j * m + m], strict=True))
                for G in corners(h)[c][0]
            ]

        def heard(h: Coupling, c: int, j: int, x: list[int], loose: bool) -> Fraction:
            rows, unit = corners(h)[c]
            worst = max(y - sum(map(mul, G, x)) for y, G in zip(pull(h, c, j), rows, strict=True))
            return Fraction(max(0, worst) if loose else worst, unit)

        for i in range(p.n):
            for c, x in faces(v[i * m : i * m + m]):
                e = [sum(map(mul, row, x)) for row in S]
                alone = load[i * m + c] * bottom - sum(map(mul, H[i][c], x))
                for t, row in zip(claim.T[c] if F else (), F, strict=True):
                    alone += sum(
                        max(t * y * lo, t * y * hi) for y, (lo, hi) in zip(e, row, strict=True)
                    )
                for arcs in (p.heard[mode][i] for mode in modes):
                    others = sum(
                        (arc.w * heard(arc.coupling, c, arc.j, x, arc.loose) for arc in arcs), alone
                    )
                    need(others <= 0, f"the row of agent {p.labels[i]} is not shown")

    return hold


def faces(v: list[int]) -> Iterator[tuple[int, list[int]]]:
    """The corners of the box |x| <= v on its faces x_c = v_c, with c."""
    for c in range(len(v)):
        for signs in itertools.product((1, -1), repeat=len(v)):
            if signs[c] > 0:
                yield c, [sign * x for sign, x in zip(signs, v, strict=True)]
