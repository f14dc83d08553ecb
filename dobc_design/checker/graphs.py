"""safety and markov: graphs that move in any way, and graphs that a Markov chain draws."""

from functools import partial
from typing import Any

from .claims import Case, need_rate
from .consensus import closed, jacobian
from .cycles import claims_rate, decays, inside, reached, rises
from .loop import Loop, reach
from .matrices import (
    ZERO,
    Matrix,
    Vector,
    both_ways,
    definite,
    is_form,
    paired,
    plus,
    product,
    stable,
)
from .reading import (
    an_object,
    matrix,
    maybe,
    need,
    rational,
    read,
    same,
    short_matrix,
    text,
    weights,
)
from .separable import observed

MODES = 300


def absorbing(loop: Loop) -> list[list[str]]:
    """The modes of each smallest set that the Markov chain never leaves; none without a chain."""
    guarantee = loop.guarantee
    if guarantee.kind != "markov" or not guarantee.several:
        return []
    G = guarantee.chain
    need(len(G) <= MODES, "a chain of so many modes is not followed here")
    edges = [[q for q, rate in enumerate(row) if q != k and rate > 0] for k, row in enumerate(G)]
    sets = [reach([k], edges) for k in range(len(G))]
    found = []
    # where all members reach the same set it is never left, and no smaller one is in it
    for each in sets:
        if all(sets[q] == each for q in each):
            found.append([mode for q, mode in enumerate(loop.modes) if q in each])
    return found


def safety(case: Case, check: Any) -> None:
    """V never grows, whatever the graph: couplings rise, no gain pushes outward; with a rate every
    agent is held."""
    shape = {"rho": maybe(rational), "rate": maybe(rational)}
    claim = read(check.exact, shape | observed(case))
    claims_rate(check, claim)
    if claim.rate is not None:
        held = all(case.least_gain(i) >= claim.rate for i in case.nodes)
        need(held, "an agent is not held as much")
    # the arcs do not matter: they only pull errors together
    decays(case, claim, claim.rate or ZERO)
    inside(case, check, claim)
    rises(case, claim.rho, strictly=False)


def markov(case: Case, check: Any) -> Any:
    """Whatever the first mode, all errors decay almost surely, in the mean or in mean square; or
    some stay as they are in modes that are never left."""
    chain = case.guarantee.chain
    last = absorbing(case)
    kind = an_object(check.exact).get("kind")
    # nor is what is refuted, which has no kind
    known = kind == "almost sure" or not case.differences
    need(known, "means of differences are not known to it")
    if check.verdict == "refuted":
        lost(case, check, last)
        return None
    need(kind == "mean square" or all(h.single for h in case.functions), "a coupling is a list")
    if kind == "almost sure":
        claim = read(check.exact, {"kind": text, "rho": maybe(rational)} | observed(case))
        need(check.rate is None, "it has no rate to claim")
        decays(case, claim, ZERO)
        inside(case, check, claim)
        rises(case, claim.rho)
        for modes in last:
            reached(case, modes)
        return claim
    need(kind in ("mean", "mean square"), "it is not said in which sense errors decay")
    return on_average(case, check, chain, kind == "mean")


def lost(loop: Loop, check: Any, last: list[list[str]]) -> None:
    """In the first closed class that does it, some agents are not reached from one with a gain."""
    sets = ((names, pulled(loop, names)) for names in last)
    names, held = next((each for each in sets if len(each[1]) < loop.n), ([], set()))
    apart = bool(names) and same(check.exact, {"modes": names})
    need(apart, "these modes do not keep agents apart")
    labels = [label for i, label in enumerate(loop.labels) if i not in held]
    witness = {"kind": "agents", "labels": labels}
    need(same(check.witness, witness), "the agents are others")


def pulled(loop: Loop, names: list[str]) -> set[int]:
    """The nodes that a pin reaches while these modes are on in turn."""
    return reach({*loop.hold, *loop.tied(names)}, loop.edges(names, False))


def on_average(case: Case, check: Any, chain: Matrix, linear: bool) -> Any:
    """V decays in the mean, of e'w (``linear``) or of e'P e, w or P of the present mode."""
    size = case.size
    name = "w" if linear else "P"
    shape = partial(weights, case.n) if linear else matrix(size, size)
    exact = read(check.exact, {"kind": text, "rate": rational, name: an_object})
    each = getattr(exact, name)
    rate = exact.rate
    need(set(each) == set(case.modes), "there is not one for every mode")
    exact.parts = parts = {mode: read(each[mode], shape) for mode in case.modes}
    need(check.domain == "global" == case.domain, "it is not global, or a coupling is not linear")
    need_rate(check, rate, "the rate is not between 0 and that of the claim")
    forgets = case.q == 0 or stable(closed(case, rate))
    need(forgets, "the estimation error does not decay at the rate")
    # one inequality for each mode; a chain adds what the others hand over
    for mode, rates in paired(case.modes, chain):
        if linear:
            mean(case, mode, parts, [*rates, rate])
        else:
            square(case, mode, parts, [*rates, 2 * rate])
    return exact


def chained(mode: str, parts: dict[str, Matrix], rates: Vector) -> Matrix:
    """The sum over q of g_pq times the part of mode q, and the last rate times that of p
    itself."""
    forms = [*parts.values(), parts[mode]]
    rest = plus(forms[0], -1, forms[0])
    for g, X in paired(rates, forms):
        rest = plus(rest, g, X)
    return rest


def mean(loop: Loop, mode: str, parts: dict[str, Vector], rates: Vector) -> None:
    """A'w + sum of g w + rate w <= 0, with the worse ends of all slopes."""
    w = parts[mode]
    (rows,) = chained(mode, {key: [each] for key, each in parts.items()}, rates)
    for i, heard in enumerate(loop.heard[mode]):
        rows[i] -= loop.least_gain(i) * w[i]
        for arc in heard:
            low, high = arc.coupling.slope(0, 0)
            # each slope at the end that makes the row larger
            if arc.j < loop.n:
                rows[arc.j] += arc.w * high * w[i]
            # an arc that may be away must not be counted on
            if not arc.loose:
                rows[i] -= arc.w * low * w[i]
    need(all(h.slope(0, 0)[0] >= 0 for h in loop.functions), "a coupling falls")
    need(max(rows) <= 0, f"a row of mode {mode} does not hold")


def square(loop: Loop, mode: str, parts: dict[str, Matrix], rates: Vector) -> None:
    """P > 0 and A'P + P A + sum of g P + 2 rate P < 0."""
    P = parts[mode]
    rest = chained(mode, parts, rates)
    short_matrix(P)
    need(is_form(P), f"P > 0 is not shown in mode {mode}")
    pulled = both_ways(product(P, jacobian(loop, mode)))
    shown = definite(plus(pulled, 1, rest), -1)
    need(shown, f"the inequality of mode {mode} is not shown")
