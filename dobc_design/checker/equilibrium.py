"""equilibrium: a box that holds an equilibrium of h(e) - K e other than 0, by the test of Krawczyk."""

from fractions import Fraction
from typing import Any

from .expressions import variables
from .files import Certificate, Problem
from .intervals import NOTHING, ONE, Floats, added, dot, enclosed, hull, negative, times, total
from .matrices import Matrix, echelon, identity
from .reading import need, rational, read, same, text

EQUATIONS = 60  # of an equilibrium at most


def equilibrium(case: Certificate, check: Any) -> None:
    """c - Y f(c) + (I - Y F'(X)) (X - c) lies inside X, so that f vanishes somewhere in X."""
    p, size = case.problem, case.problem.n * case.problem.m
    need(size <= EQUATIONS, f"an equilibrium is looked at up to {EQUATIONS} equations")
    exact = read(check.exact, {"mode": text, "box": ((rational, rational),) * size})
    mode, box = exact.mode, exact.box
    need(mode in p.modes, "there is no such mode")
    middle = [(lo + hi) / 2 for lo, hi in box]
    need(same(check.witness, {"kind": "start", "values": middle}), "the witness is not the middle of the box")
    need(any(lo > 0 or hi < 0 for lo, hi in box), "the box contains the target")
    if p.region is not None:
        sides = [(side, goal[c]) for goal in p.goals for c, side in enumerate(p.region.initial_states)]
        for (lo, hi), ((low, high), goal) in zip(box, sides, strict=True):
            need(low <= lo + goal and hi + goal <= high, "the box leaves the region")

    (_, slopes), (values, _) = forces(p, mode, box), forces(p, mode, [[x, x] for x in middle])
    rough = [[Fraction(round(sum(row.get(k, NOTHING)) * 2**30), 2**31) for k in range(size)] for row in slopes]
    rows, _ = echelon([x + unit for x, unit in zip(rough, identity(size), strict=True)])
    for a, (lo, hi) in enumerate(box):
        factors = [enclosed(-x) for x in rows[a][size:]]
        rest = {k: [ONE] * (k == a) for k in range(size)}
        for factor, row in zip(factors, slopes, strict=True):
            for k, slope in row.items():
                rest[k].append(times(factor, slope))
        halves = [enclosed((hi - lo) / 2)[1] for lo, hi in box]
        spread = dot(map(total, rest.values()), ((-half, half) for half in halves))
        image = total([enclosed(middle[a]), dot(factors, values), spread])
        need(lo < Fraction(image[0]) and Fraction(image[1]) < hi, "the box is not shown to hold an equilibrium")


def forces(p: Problem, mode: str, e: Matrix) -> tuple[list[Floats], list[dict[int, Floats]]]:
    """h(e) - K e and its slopes for all e in a box."""
    m, values = p.m, [NOTHING] * len(e)
    slopes: list[dict[int, Floats]] = [{} for _ in e]

    def act(row: int, w: Floats, value: Floats, parts: list[tuple[int, Floats]]) -> None:
        values[row] = added(values[row], times(w, value))
        for column, slope in parts:
            slopes[row][column] = added(slopes[row].get(column, NOTHING), times(w, slope))

    for arc, c in ((arc, c) for arc in p.modes[mode] for c in range(m)):
        own, other = ([i * m + d for d in ([c] if arc.coupling.single else range(m))] for i in (arc.i, arc.j))
        y = [(enclosed(e[b][0] - e[a][1])[0], enclosed(e[b][1] - e[a][0])[1]) for a, b in zip(own, other, strict=True)]
        value, found = arc.coupling.parts[c % len(arc.coupling.parts)].at(*variables(y))
        parts = found or (NOTHING,) * len(y)
        act(arc.i * m + c, enclosed(arc.w), value, list(zip(other, parts, strict=True)))
        act(arc.i * m + c, enclosed(arc.w), NOTHING, list(zip(own, map(negative, parts), strict=True)))
    for i, c, d in ((i, c, d) for i in p.gains for c in range(m) for d in range(m)):
        a = i * m + d
        act(i * m + c, enclosed(-p.gains[i][c][d]), hull(*map(enclosed, e[a])), [(a, ONE)])
    return values, slopes
