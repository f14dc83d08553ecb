"""safety and markov: graphs that move in any way, and graphs that a Markov chain draws."""

from fractions import Fraction
from functools import lru_cache, partial
from typing import Any

from .consensus import closed
from .cycles import decays, inside, phases, reached, rises
from .files import Certificate, Problem, reach
from .matrices import ZERO, Matrix, definite, plus, product, stable, transpose
from .reading import (
    MATRIX_BITS,
    an_object,
    matrix,
    maybe,
    need,
    rational,
    read,
    same,
    short,
    text,
    weights,
)
from .separable import observed

MODES = 300


@lru_cache(maxsize=1)  # every refuted check of a mode asks
def generator(p: Problem) -> Matrix:
    """The rates from mode to mode of the Markov chain that proofs may assume."""
    size, table = len(p.modes), p.switching or {}
    need(table.get("guarantee") == "markov" and size > 1, "there is no Markov chain to assume")
    G: Matrix = read(table.get("generator"), matrix(size, size))
    rates = (x for k, row in enumerate(G) for q, x in enumerate(row) if q != k)
    need(min(rates) >= 0 and not any(map(sum, G)), "the generator is none")
    return G


def absorbing(p: Problem) -> list[list[str]]:
    """The modes of each smallest set that the Markov chain never leaves; none without a chain."""
    if (p.switching or {}).get("guarantee") != "markov" or len(p.modes) == 1:
        return []
    G = generator(p)
    need(len(G) <= MODES, "a chain of so many modes is not followed here")
    edges = [[q for q, rate in enumerate(row) if q != k and rate > 0] for k, row in enumerate(G)]
    sets = [reach([k], edges) for k in range(len(G))]
    smallest = [each for each in sets if all(sets[q] == each for q in each)]
    return [[mode for q, mode in enumerate(p.modes) if q in each] for each in smallest]


def may_stay(p: Problem, mode: str) -> bool:
    """Whether a signal that keeps the guarantee may stay in the mode for ever."""
    kind, place = (p.switching or {}).get("guarantee"), list(p.modes).index(mode)
    if len(p.modes) == 1 or kind in (None, "arbitrary"):
        return True
    if kind == "markov":
        return generator(p)[place][place] == 0
    turns = phases(p)
    return all(turn.mode == mode for turn in turns) or any(
        turn.longest is None for turn in turns if turn.mode == mode
    )


def safety(case: Certificate, check: Any) -> None:
    """V never grows, whatever the graph: couplings rise, no gain pushes outward; with a rate every
    agent is held."""
    p = case.problem
    claim = read(check.exact, {"rho": maybe(rational), "rate": maybe(rational)} | observed(p))
    need(
        (check.rate is None) == (claim.rate is None),
        "it claims a rate that it does not have, or has one",
    )
    need(
        check.rate is None or 0 < check.rate <= claim.rate,
        "the rate is not between 0 and that of the claim",
    )
    need(
        claim.rate is None or all(p.least_gain(i) >= claim.rate for i in range(p.n)),
        "an agent is not held as much",
    )
    decays(case, claim, claim.rate or ZERO)
    inside(case, check, claim)
    rises(p, p.couplings, claim.rho, False)


def markov(case: Certificate, check: Any) -> None:
    """Whatever the first mode, all errors decay almost surely, in the mean or in mean square; or
    some stay as they are in modes that are never left."""
    p, G = case.problem, generator(case.problem)
    last = absorbing(p)
    if check.verdict == "refuted":
        lost = ((each, reach(p.gains, p.edges(each, False))) for each in last)
        names, held = next((found for found in lost if len(found[1]) < p.n), ([], set()))
        labels = [label for i, label in enumerate(p.labels) if i not in held]
        need(
            bool(names) and same(check.exact, {"modes": names}),
            "these modes do not keep agents apart",
        )
        need(same(check.witness, {"kind": "agents", "labels": labels}), "the agents are others")
        return
    kind = an_object(check.exact).get("kind")
    need(
        kind == "mean square" or all(coupling.single for coupling in p.couplings),
        "a coupling is a list",
    )
    if kind == "almost sure":
        claim = read(check.exact, {"kind": text, "rho": maybe(rational)} | observed(p))
        need(check.rate is None, "it has no rate to claim")
        decays(case, claim, ZERO)
        inside(case, check, claim)
        rises(p, p.couplings, claim.rho)
        for modes in last:
            reached(p, modes)
        return

    need(kind in ("mean", "mean square"), "it is not said in which sense errors decay")
    name, shape = (
        ("w", partial(weights, p.n)) if kind == "mean" else ("P", matrix(p.n * p.m, p.n * p.m))
    )
    exact = read(check.exact, {"kind": text, "rate": rational, name: an_object})
    each, rate = getattr(exact, name), exact.rate
    need(set(each) == set(p.modes), "there is not one for every mode")
    parts = {mode: read(each[mode], shape) for mode in p.modes}
    need(check.domain == "global" == p.domain, "it is not global, or a coupling is not linear")
    need(
        check.rate is not None and 0 < check.rate <= rate,
        "the rate is not between 0 and that of the claim",
    )
    need(
        p.q == 0 or stable(closed(p, case.W, rate)),
        "the estimation error does not decay at the rate",
    )
    for mode, rates in zip(p.modes, G, strict=True):
        forms = [[parts[other]] if kind == "mean" else parts[other] for other in (*p.modes, mode)]
        rest = plus(forms[0], -1, forms[0])
        for g, X in zip((*rates, rate if kind == "mean" else 2 * rate), forms, strict=True):
            rest = plus(rest, g, X)
        (mean if kind == "mean" else square)(p, mode, parts[mode], rest)


def mean(p: Problem, mode: str, w: list[Fraction], rest: Matrix) -> None:
    """A'w + rest <= 0, with the worse ends of all slopes."""
    (rows,) = rest
    for i, heard in enumerate(p.heard[mode]):
        rows[i] -= p.least_gain(i) * w[i]
        for arc in heard:
            low, high = arc.coupling.slope(0, 0)
            rows[arc.j] += arc.w * high * w[i]
            rows[i] -= ZERO if arc.loose else arc.w * low * w[i]
    need(all(coupling.slope(0, 0)[0] >= 0 for coupling in p.couplings), "a coupling falls")
    need(max(rows) <= 0, f"a row of mode {mode} does not hold")


def square(p: Problem, mode: str, P: Matrix, rest: Matrix) -> None:
    """P > 0 and A'P + P A + rest < 0."""
    short((x for row in P for x in row), MATRIX_BITS)
    need(transpose(P) == P and definite(P), f"P > 0 is not shown in mode {mode}")
    half = product(P, p.jacobian(mode))
    need(
        definite(plus(plus(half, 1, transpose(half)), 1, rest), -1),
        f"the inequality of mode {mode} is not shown",
    )
