"""Claims about the target: facts of exosystems, observer and graph, Lemma 1 (e'e decreases), and
the theorems.

J - K is the linearisation, made of the slopes of couplings, and Lambda = J + J' - (K + K') what e'e
changes by. A slope that is not rational is an interval that holds it, and what is said here holds
for every value in it.

The theorems are about e and the observer's error together, by a pair P, Q. Psi < 0 in a mode iff
Omega(0) < 0 and Lambda + the blocks of S(0) of the agents < 0.
"""

from collections.abc import Collection, Iterable, Iterator
from fractions import Fraction
from functools import lru_cache, partial
from operator import mul
from typing import Any, NamedTuple

from .claims import Case
from .intervals import Exact, by_decimal, outward, times
from .loop import Loop, Residual, extend, reach
from .matrices import (
    ZERO,
    Matrix,
    Rows,
    Vector,
    both_ways,
    characteristic,
    definite,
    diagonal,
    echelon,
    form,
    identity,
    integers,
    is_form,
    norm,
    nullspace,
    opposite,
    paired,
    plus,
    polynomial_text,
    positive,
    product,
    routh,
    semidefinite,
    solved,
    stable,
    transpose,
    unstable,
)
from .pairs import rows_of
from .reading import (
    Object,
    an_object,
    direction,
    matrix,
    need,
    rational,
    read,
    same,
    short_matrix,
    text,
    weights,
)
from .sampled import decays, inside
from .signs import cover

ROOTS_SIZE = 60  # largest matrix whose eigenvalues are counted


# --- Slopes at the target


class Term(NamedTuple):
    """Row a of J - K has the slope in column b, and less it in column c, the node's own."""

    a: int
    b: int
    c: int
    slope: Exact


def terms(loop: Loop, mode: str) -> Iterator[Term]:
    """Those of arcs and pins in a mode. A pin is an arc from the target, where the error is 0: it
    has the column n m, which is dropped in the end, as arcs to other fixed nodes have."""
    m = loop.m
    target = loop.n * m
    for i, j, w, coupling, loose in loop.modes[mode]:
        ends = [ZERO if loose else w, w]
        factor = (min(ends), max(ends))
        for (c, d), slope in coupling.slopes.items():
            column = min(j * m + d, target)
            yield Term(i * m + c, column, i * m + d, times(slope, factor))
            if w < 0:  # |w| h'(-x_j - x_i) is w h'(x_j - x_i) and a pin of 2 |w| h'
                twice = (-2 * factor[1], -2 * factor[0])
                yield Term(i * m + c, target, i * m + d, times(slope, twice))
    for i, k in loop.hold.items():
        for c, row in enumerate(k):
            for d, gain in enumerate(row):
                yield Term(i * m + c, target, i * m + d, (gain, gain))


@lru_cache(maxsize=1)  # every check of a mode asks
def upper_bounds(loop: Loop) -> dict[str, Rows]:
    """In every mode a rational U with Lambda <= U for every slope in its enclosure: one that is
    off by r moves v'Lambda v by at most 2 r |v_a| |v_b - v_c| <= r (2 v_a^2 + v_b^2 + v_c^2)."""
    return {mode: upper_bound(loop, mode) for mode in loop.modes}


def upper_bound(loop: Loop, mode: str) -> Rows:
    """U of one mode."""
    size = loop.size
    rows: Rows = [{i: ZERO} for i in range(size + 1)]

    def add(i: int, j: int, x: Fraction) -> None:
        rows[i][j] = rows[i].get(j, ZERO) + x

    for a, b, c, (lo, hi) in terms(loop, mode):
        middle = (lo + hi) / 2
        add(a, b, middle)
        add(b, a, middle)
        add(a, c, -middle)
        add(c, a, -middle)
        r = (hi - lo) / 2
        if r:
            add(a, a, 2 * r)
            add(b, b, r)
            add(c, c, r)
    # the target has no error: its row and column go
    return [{j: x for j, x in row.items() if j < size} for row in rows[:-1]]


def lower_form(found: Iterable[Term], v: Vector) -> Fraction:
    """A lower bound of v'Lambda v, exact where the slopes that take part are; v ends with a 0."""
    low = ZERO
    for a, b, c, (lo, hi) in found:
        weight = 2 * v[a] * (v[b] - v[c])
        # the end that makes the form smaller
        low += weight * (lo if weight > 0 else hi)
    return low


def jacobian(loop: Loop, mode: str) -> Matrix:
    """J - K, if every slope is exact."""
    size = loop.size
    # exact characteristic polynomials take long
    need(size <= ROOTS_SIZE, f"unstable roots are counted up to size {ROOTS_SIZE} only")
    X = identity(size + 1, 0)
    for a, b, c, (lo, hi) in terms(loop, mode):
        need(lo == hi, "unstable roots are counted for exact slopes only")
        X[a][b] += lo
        X[a][c] -= lo
    return [row[:-1] for row in X[:-1]]


def is_symmetric(loop: Loop, mode: str) -> bool:
    """Whether J - K is known exactly, and symmetric."""
    X: dict[tuple[int, int], Fraction] = {}
    for a, b, c, (lo, hi) in terms(loop, mode):
        if lo != hi:
            return False
        X[a, b] = X.get((a, b), ZERO) + lo
        X[a, c] = X.get((a, c), ZERO) - lo
    size = loop.size  # the node that nobody is, which pins name, comes last
    return all(x == X.get((b, a), ZERO) for (a, b), x in X.items() if max(a, b) < size)


# --- Facts
class Fact(NamedTuple):
    """Whether it is so, the exact value that stands there, and the witness if it is not so."""

    holds: bool
    exact: Any
    witness: Any


def observable(residual: Residual) -> tuple[Matrix, list[int]]:
    """T, a basis of what is seen of the exosystem, and the columns of its leading ones."""
    # C, C A, C A^2, ...: what is never seen is where all of them are 0
    rows = Matrix()
    part = residual.C
    for _ in residual.A:
        rows = rows + part
        part = product(part, residual.A)
    return echelon(rows)


def takes_long(residual: Residual) -> bool:
    """The limit on the order and the bits of (A, C), to the seventh and second power, of the whole
    format."""
    entries = [abs(x) for row in (*residual.A, *residual.C) for x in row]
    sizes, bottom = integers(entries)
    largest = -(-max(sizes) // bottom)  # rounded up
    bits = bottom.bit_length() + largest.bit_length()
    return len(residual.A) ** 7 * bits**2 > 5 * 10**13


def closed(system: Any, b: Fraction = ZERO) -> Matrix:
    """A - W C + b I, of a residual or of the whole loop."""
    need(system.W is not None, "there is no observer gain")
    F = plus(system.A, -1, product(system.W, system.C))
    return plus(F, 1, identity(len(F), b))


def observability(residual: Residual) -> Fact:
    """C, C A, C A^2, ... have full rank."""
    T, _ = observable(residual)
    basis, _ = nullspace(T, len(residual.A))
    unseen = basis[0] if basis else []
    holds = len(T) == len(residual.A)
    return Fact(holds, {"rank": Fraction(len(T))}, {"kind": "vector", "values": unseen})


def detectability(residual: Residual, steps: bool = False) -> Fact:
    """What C does not see decays; in ``steps`` its eigenvalues are inside the unit circle."""
    T, _ = observable(residual)
    basis, free = nullspace(T, len(residual.A))
    # A N = N R, and N is 1 at its free columns: R is A N there
    images = product(basis, transpose(residual.A))
    R = transpose([[image[k] for k in free] for image in images])
    polynomial = characteristic(R)
    p = polynomial_text(polynomial)
    witness = {"kind": "polynomial", "values": [p]}
    fades = inside([(c, c) for c in polynomial]) if steps else stable(R)
    return Fact(bool(fades), {"unobservable_polynomial": p}, witness)


def hurwitz(residual: Residual) -> Fact:
    """Every eigenvalue of A - W C has a negative real part."""
    column = routh(characteristic(closed(residual)))
    end = next((k for k, entry in enumerate(column) if entry <= 0), 0)  # it begins with 1
    exact = None if end else {"routh": column}
    return Fact(end == 0, exact, {"kind": "routh_row", "values": column[: end + 1]})


def from_tick_to_tick(case: Case, check: Any) -> Fact:
    """The same of samples: every eigenvalue is smaller than exp(-rate T) in size."""
    wait = case.timing.period * (check.rate or ZERO)
    found = decays(own(case, check.group), case.timing, by_decimal("exp", (wait, wait))[1])
    need(found is not None, "it is not decided here")
    return Fact(bool(found), None, None)


OF_GROUPS = {"observability": observability, "detectability": detectability, "hurwitz": hurwitz}


def reachability(loop: Loop, mode: str) -> Fact:
    """Every node has a pin, or hears one that has, directly or through others; without a target:
    some node is heard by all others; with signs: no closed set whose signs balance has no pin."""
    if loop.agrees:
        apart = closed_sets(loop, [mode], False)
        members = sorted(i for group in apart for i in group) if len(apart) > 1 else []
        labels = [loop.labels[i] for i in members]
        return Fact(not labels, None, {"kind": "agents", "labels": labels})
    if loop.signed:
        pinned = loop.pinned([mode])
        sets = [each for each in closed_sets(loop, [mode], False) if not each & set(pinned)]
        labels = [loop.labels[i] for i in sorted(i for each in sets for i in each)]
        return Fact(not labels, None, {"kind": "agents", "labels": labels})
    reached = reach(loop.pinned([mode]), loop.edges([mode], False))
    rest = [label for i, label in enumerate(loop.labels) if i not in reached]
    return Fact(not rest, None, {"kind": "agents", "labels": rest})


def closed_sets(loop: Loop, modes: Collection[str], loose: bool) -> list[set[int]]:
    """The smallest sets of nodes that hear nobody outside, in these modes together; with signs only
    those that hold no node of the cover together with its opposite."""
    if loop.signed:
        hears, heard_by = cover(loop, modes, loose)
    else:
        hears = loop.edges(modes, True, loose)
        heard_by = loop.edges(modes, False, loose)
    # The first one met of a smallest set is not reached from any before. Whoever is in none is
    # reached from one of these, which was met later.
    firsts = heads(range(len(hears)), heard_by)
    found = [reach([i], hears) for i in heads(firsts[::-1], heard_by)]
    if not loop.signed:
        return found
    sets = [{i % loop.n for i in each} for each in found]
    balanced = [nodes for nodes, each in zip(sets, found, strict=True) if len(nodes) == len(each)]
    # each of them twice, for x and for -x
    return [nodes for k, nodes in enumerate(balanced) if nodes not in balanced[:k]]


def heads(order: Iterable[int], edges: list[list[int]]) -> list[int]:
    """Those that are not reached from one before them."""
    found = []
    seen = set[int]()
    for i in order:
        if i not in seen:
            found.append(i)
            extend(seen, [i], edges)
    return found


def fact(case: Case, check: Any) -> None:
    """A fact of one group, or reachability in one mode, is as the check says."""
    if check.id == "hurwitz" and case.sampled:
        found = from_tick_to_tick(case, check)
    elif check.id == "detectability":
        steps = case.timing is not None and case.timing.steps
        found = detectability(own(case, check.group).observed, steps)
    elif check.id in OF_GROUPS:
        found = OF_GROUPS[check.id](own(case, check.group).observed)
    else:
        found = reachability(case, check.mode)
    need(check.margin is None, "it has no margin to claim")
    if check.rate is not None:
        need(check.id == "hurwitz", "it has no rate to claim")
        # of samples it is part of what was found
        shown = found.holds
        if not case.sampled:
            shown = stable(closed(own(case, check.group).observed, check.rate))
        need(check.rate > 0 and shown, "the rate is not shown")
    here = "proved" if found.holds else "refuted"
    need((check.verdict == "proved") == found.holds, f"it is {here} here")
    need(same(check.exact, found.exact), "the exact value is another one here")
    witness = None if found.holds else found.witness
    need(same(check.witness, witness), "the witness is another one here")


# --- Observer
def own(case: Case, name: str | None) -> Residual:
    """A residual by its name, with its block of the W that is claimed."""
    k = case.names.index(name)
    W = None if case.W is None else parts(case, case.W, case.m)[k]
    return case.residuals[k]._replace(W=W)


def parts(loop: Loop, X: Matrix, width: int) -> list[Matrix]:
    """The blocks of X that belong to the residuals, of this width (0: square); X must be zero
    elsewhere."""
    blocks = list[Matrix]()
    row = 0
    column = 0
    for residual in loop.residuals:
        rows = len(residual.A)
        columns = width or rows
        lines = X[row : row + rows]
        blocks.append([line[column : column + columns] for line in lines])
        row += rows
        column += columns
    # eps of one group would feel that of another, which no observer does
    need(diagonal(blocks) == X, "a matrix is not block diagonal")
    return blocks


def observer(case: Case) -> None:
    """The claimed W, P and Q are those of the problem, where it has any, and belong together."""
    W = case.W
    source = None
    if W is not None:
        source = "designed" if case.given_W is None else "given"
    need(case.claims.observer.source == source, "the source of the observer gain is wrong")
    need(W is None or case.q > 0, "there is an observer, but no exosystem")
    # the claim is about the observer that the problem states
    need(case.given_W in (None, W), "the observer gain is not the one of the problem")
    if W is not None:
        for residual, gain in paired(case.residuals, parts(case, W, case.m)):
            as_given = residual.W in (None, gain)
            need(as_given, "the observer gain of a group is not that of the problem")
    P = case.P
    Q = case.claims.observer.Q
    proved = case.proved(case.theorem) is not None
    together = (P is not None) == (Q is not None) == proved
    need(together, "P and Q belong beside a proved theorem, both")
    if P is not None:
        parts(case, P, 0)
        need(transpose(P) == P, "P is not symmetric")
        need(W is not None and product(P, W) == Q, "Q is not P W")


def omega(case: Case, P: Matrix, b: Fraction) -> Matrix:
    """P A + A'P - Q C - C'Q' + 2 b P, with Q = P W, of all groups together."""
    return both_ways(product(P, closed(case, b)))


def schur(case: Case, P: Matrix, b: Fraction) -> Matrix:
    """S = C (-Omega)^-1 C', once Omega < 0 is shown."""
    Omega = omega(case, P, b)
    C = case.C
    # else S does not exist, or says nothing
    need(definite(Omega, -1), "Omega < 0 is not shown")
    return product(C, solved(opposite(Omega), transpose(C)))


# --- Lemma 1 and the theorems: proofs
def consensus(case: Case, check: Any) -> None:
    """Decide lemma1, theorem1, theorem2 and the printed pairs."""
    need(not case.kinked, "a coupling has a kink, so the theorems do not apply")
    need(not (case.agrees or case.gap), "there is no target, so the theorems do not apply")
    margin = check.margin
    if check.verdict == "proved":
        need(check.witness is None, "it is proved and carries a witness")
        need(margin is not None and margin >= 0, "a proof needs a margin of at least 0")
        need(check.rate is None or check.rate > 0, "a rate has to be positive")
        proof(case, check)
        return
    need(check.rate is None, "it is refuted and claims a rate")
    need(margin is None or margin <= 0, "it is refuted and claims a positive margin")
    if check.id == "lemma1":
        lemma_refuted(case, check)
    elif check.id == case.theorem:
        theorem_refuted(case, check)
    else:
        pair_refuted(case, check)


def proof(case: Case, check: Any) -> None:
    """Lambda < 0 in the mode, or Psi < 0 for the pair in every mode, with the margin and the
    rate."""
    lemma = check.id == "lemma1"
    P = (case.P if check.id == case.theorem else case.given_P) or []
    modes = [check.mode] if lemma else list(case.modes)
    if not lemma:
        need(definite(P), "P > 0 is not shown")
        need(same(check.exact, values(case, P)), "P, Q, S or the bound is another one here")
    # the margin is about S(0), a rate b about S(b) and room for 2 b
    claims = [(ZERO, check.margin)]
    if check.rate is not None:
        claims.append((check.rate, 2 * check.rate))
    for b, shift in claims:
        S = None if lemma else schur(case, P, b)
        shown = all(decreases(case, mode, shift, S) for mode in modes)
        need(shown, "the margin or the rate is not shown")


def values(case: Case, P: Matrix) -> Object:
    """What is listed for a pair: P, Q, S, and the bound -s if S = s I."""
    S = schur(case, P, ZERO)
    listed: Object = {"P": P, "Q": product(P, case.W or []), "S": S}
    if identity(len(S), S[0][0]) == S:
        listed["bound"] = -S[0][0]
    return listed


def decreases(case: Case, mode: str, shift: Fraction, S: Matrix | None) -> bool:
    """Lambda + the blocks of S of the agents + shift I < 0 in that mode; if a vector stands beside
    Lemma 1, it has to show this, with room for every block."""
    m = case.m
    blocks: dict[int | None, Matrix] = {}
    for i in case.nodes:
        group = case.place.get(i)
        if group not in blocks:
            blocks[group] = case.block(S, i) if S else identity(m, 0)
    if mode not in case.rooms:
        case.rooms[mode] = room(case, mode)
    left = case.rooms[mode]
    # one vector for all: -Lambda >= left I, so that left - shift has to be more than each block
    if left is not None:
        gaps = [plus(identity(m, left - shift), -1, each) for each in blocks.values()]
        return all(map(definite, gaps))

    rows = [{j: -x for j, x in row.items()} for row in upper_bounds(case)[mode]]
    for i, row in enumerate(rows):
        row[i] -= shift
        if not S:
            continue
        first = i - i % m
        for d, x in enumerate(blocks[case.place.get(i // m)][i % m]):
            # fewer bits: the middle of an enclosure, and its width taken off the diagonal
            lo, hi = outward(x, x)
            j = first + d
            row[j] = row.get(j, ZERO) - (lo + hi) / 2
            row[i] -= hi - lo
    return positive(rows)


def room(case: Case, mode: str) -> Fraction | None:
    """The least -(U v)_i / v_i for the vector v beside a proved Lemma 1, if there is one, where U
    >= Lambda has its entries beside the diagonal taken by their sizes: every eigenvalue of Lambda
    is at most minus that."""
    lemma = next(each for each in case.checks if (each.id, each.mode) == ("lemma1", mode))
    # its own check decides that the vector is good; here it only has to be there
    if lemma.verdict != "proved" or lemma.exact is None:
        return None
    vector = read(lemma.exact, {"v": partial(weights, case.size)}).v
    need(type(lemma.exact["v"]) is dict, "the vector is no block of doubles")
    v, _ = integers(vector)
    found = []
    for i, row in enumerate(upper_bounds(case)[mode]):
        others = sum(abs(x) * v[j] for j, x in row.items() if j != i)
        found.append((-row[i] * v[i] - others) / v[i])
    return min(found)


# --- Weighted forms
def weighted(case: Case, check: Any) -> Any:
    """V = e'De + sum eps_i'P eps_i decreases at the rate."""
    need(not case.kinked, "a coupling has a kink, so the theorem does not apply")
    components_alike = case.B is not None and "R" in (check.exact or {})
    need(not case.gap and (components_alike or not case.agrees), "there is no single target")
    if case.signed:
        case = rows_of(case)
    proved = check.verdict == "proved" and check.witness is None
    need(proved, "it is proved, without a witness, or undecided")
    modest = check.margin is None and (check.rate is None or check.rate > 0)
    need(modest, "it claims a margin, or a rate that is not positive")
    vector = partial(weights, case.n if components_alike else case.size)
    shape: Object = {} if case.agrees else {"D": vector, "w": an_object}
    if components_alike:
        shape |= {"c": rational, "R": matrix(case.m, case.m)}
    elif case.q:
        shape["P"] = matrix(case.q, case.q)
    claim = read(check.exact, shape)
    need(case.agrees or set(claim.w) == set(case.modes), "there is no vector for each mode")
    decide = alike if components_alike else by_diagonal
    decide(case, claim, check.rate or ZERO)
    return claim


def by_diagonal(case: Case, claim: Any, b: Fraction) -> None:
    """In every mode N w > 0 for N = D M + M'D - 2 rate D - s D^2, M = K - J, which has no positive
    entry beside the diagonal; s is the largest row sum of the agent's block of S."""
    size = case.size
    worst = [ZERO] * case.n
    if case.q:
        parts(case, claim.P, 0)
        need(is_form(claim.P), "P > 0 is not shown")
        S = schur(case, claim.P, b)
        worst = [norm(case.block(S, i)) for i in case.nodes]
    D = claim.D
    for mode in case.modes:
        w = [*weights(size, claim.w[mode]), ZERO]
        left = []
        for i in range(size):
            cost = 2 * b + worst[i // case.m] * D[i]
            left.append(-cost * D[i] * w[i])
        left.append(ZERO)
        for i, j, own_column, (lo, hi) in terms(case, mode):
            need(own_column == i or lo == hi == 0, "a coupling or a gain mixes components")
            # what dynamics do to an agent itself may have any sign
            need(lo >= 0 or j == size, "a slope is negative")
            # other components of the own error have slope 0 here, as was just asked
            if own_column == i:
                spend(left, w, (i, j), (D[i] * lo, D[i] * hi))
        need(min(left[:size]) > 0, "the weights do not show it")


def alike(case: Case, claim: Any, b: Fraction) -> None:
    """V = e'(D (x) R)e of agents with dynamics decreases at the rate: slopes are g G, gains B K = k
    G, g, k >= 0, and N w > 0 for N = D M + M'D - 2 c D, R > 0, R G = G'R >= 0, A'R + R A - 2 c R G
    + 2 rate R < 0, M = L(g) + diag(k)."""
    short_matrix(claim.R)
    slopes = {h: exact_slopes(h, case.m) for h in case.functions if h is not case.own}
    G = next((each for each in slopes.values() if any(map(any, each))), identity(case.m))
    factors = {h: multiple(each, G) for h, each in slopes.items()}
    gains = [multiple(plus(case.gain(i), 1, case.drift), G) for i in case.nodes]
    falls(case, claim, G, b)
    if case.agrees:
        apart(case, claim.c, factors)
        return
    D = claim.D
    for mode, arcs in case.modes.items():
        w = [*weights(case.n, claim.w[mode]), ZERO]
        left = [2 * D[i] * w[i] * (k - claim.c) for i, k in enumerate(gains)]
        left.append(ZERO)  # of all fixed nodes, to which nothing is asked
        for i, speaker, weight, coupling, loose in arcs:
            j = min(speaker, case.n)
            g = weight * factors[coupling] * D[i]
            # an arc that may be away must not be needed
            spend(left, w, (i, j), (ZERO if loose else g, g))
        need(min(left[: case.n]) > 0, "the weights do not show it")


def apart(case: Case, c: Fraction, factors: Any) -> None:
    """Of agents that agree, V = e'((D - pi pi') (x) R)e: in every mode D L + L'D - 2 c (D - pi pi')
    > 0 without the row and the column of the first agent, where pi > 0, pi'L = 0, pi'1 = 1 and D =
    diag(pi) are the same in all modes."""
    need(case.domain == "global", "couplings are not linear")
    graphs = []
    for arcs in case.modes.values():
        L = identity(case.n, 0)
        for i, j, weight, coupling, loose in arcs:
            need(weight > 0 and not loose, "an arc is not positive, or not sure")
            g = weight * factors[coupling]
            L[i][i] += g
            L[i][j] -= g
        graphs.append(L)
    kept, _ = nullspace([row for L in graphs for row in transpose(L)], case.n)
    need(len(kept) == 1, "there is no pi, or not one alone")
    pi = [x / sum(kept[0]) for x in kept[0]]
    need(min(pi) > 0, "a graph is not strongly connected")
    D = diagonal([[[x]] for x in pi])
    spread = plus(D, -1, product(transpose([pi]), [pi]))
    for L in graphs:
        left = plus(both_ways(product(D, L)), -2 * c, spread)
        need(definite([row[1:] for row in left[1:]]), "differences do not decrease with that c")


def spend(left: Any, w: Any, arc: tuple[int, int], slope: Any) -> None:
    """Add to N w what an arc [i, j] has in it, with the worse end of its slope (times D_i)."""
    i, j = arc
    lo, hi = slope
    # its own row has the slope twice (D M + M'D), that of the neighbour once
    pull = 2 * w[i] - w[j]
    left[i] += pull * (lo if pull > 0 else hi)
    left[j] -= hi * w[i]


def falls(case: Case, claim: Any, G: Matrix, b: Fraction) -> None:
    """What ``alike`` asks of R, and of the observer."""
    R = claim.R
    RG = product(R, G)
    # definite and semidefinite are about symmetric matrices only
    need(transpose(R) == R and transpose(RG) == RG, "R or R G is not symmetric")
    pulled = both_ways(product(R, case.drift))
    F = plus(plus(pulled, -2 * claim.c, RG), 2 * b, R)
    need(definite(R) and semidefinite(RG) and definite(F, -1), "R does not show it")
    need(case.q == 0 or stable(closed(case, b)), "A - W C + rate I is not Hurwitz")


def exact_slopes(h: Any, m: int) -> Matrix:
    """The slopes of a coupling at 0, if they are rational."""
    rows = []
    for c in range(m):
        slopes = [h.slope(c, d) for d in range(m)]
        need(all(lo == hi for lo, hi in slopes), "a slope is not exact")
        rows.append([lo for lo, _ in slopes])
    return rows


def multiple(X: Matrix, G: Matrix) -> Fraction:
    """The number g >= 0 with X = g G."""
    pairs: list[Any] = []
    for rows in paired(X, G):
        pairs += paired(*rows)
    # any entry that is not 0 gives g; all others have to agree
    g = next((x / y for x, y in pairs if y), ZERO)
    multiples = g >= 0 and all(x == g * y for x, y in pairs)
    need(multiples, "couplings and gains are not multiples of one matrix")
    return g


def linearisation(case: Case, check: Any) -> None:
    """J - K (of one mode) and A - W C have all eigenvalues left of minus the rate, or J - K has
    some right of 0."""
    b = check.rate or ZERO
    need(not case.kinked and not case.switches, "it is about a smooth loop with one graph")
    positive_rate = check.rate is None or b > 0
    need(
        check.margin is None and check.witness is None and positive_rate, "it claims something else"
    )
    # of several modes eigenvalues say nothing together: there is one mode here
    (X,) = [jacobian(case, mode) for mode in case.modes]
    need(not case.gap, "there is no single target")
    if case.agrees:
        X = of_differences(X, case.m)
    if check.verdict == "proved":
        need(check.exact is None, "it claims exact values")
        need(stable(plus(X, 1, identity(len(X), b))), "J - K + rate I is not Hurwitz")
        need(case.q == 0 or stable(closed(case, b)), "A - W C + rate I is not Hurwitz")
        return
    count = read(check.exact, {"unstable_roots": rational}).unstable_roots
    counted = check.rate is None and count.denominator == 1 and count > 0
    need(counted, "it is refuted by a number of roots")
    need(unstable(X, int(count)), "unstable roots are not shown")


def of_differences(X: Matrix, m: int) -> Matrix:
    """The matrix of x_i - x_n, i < n, for x' = X x where the rows of X add up to 0."""
    kept = range(len(X) - m)
    return [[X[i][j] - X[len(kept) + i % m][j] for j in kept] for i in kept]


# --- Lemma 1 and the theorems: refutations
def by_vector(case: Case, check: Any, mode: str, S: Matrix | None = None) -> Fraction:
    """The witness v shows that X = Lambda + the blocks of S has v'Xv >= max(0, -M v'v); a lower
    bound of v'Xv."""
    m = case.m
    shape = {"kind": text, "labels": [text], "values": partial(direction, case.n * m)}
    witness = read(check.witness, shape)
    v = witness.values
    need(witness.kind == "vector", "the witness is no vector")
    low = lower_form(terms(case, mode), [*v, ZERO])
    support = []
    for i, label in enumerate(case.labels):
        part = v[i * m : i * m + m]
        if any(part):
            support.append(label)
        if S:
            low += form(part, case.block(S, i), part)
    # what a reader is told has to be what was decided
    need(witness.labels == support, "the labels are not the agents where the vector is not 0")
    least = -(check.margin or ZERO) * sum(map(mul, v, v))
    # v'Xv >= 0 refutes X < 0, and a margin -M claims no more than v shows
    need(low >= max(ZERO, least), "the vector does not show it")
    return low


def lemma_refuted(case: Case, check: Any) -> None:
    """A vector shows that Lambda < 0 fails; unstable roots are counted besides."""
    exact = read(check.exact, {"unstable_roots": rational, "value?": rational})
    low = by_vector(case, check, check.mode)
    shown = exact.value is None or exact.value <= low
    need(shown, "v'Lambda v is less than the value that is claimed")
    count = exact.unstable_roots
    need(count >= 0 and count.denominator == 1, "unstable_roots is no number of roots")
    if count == 0:
        return
    # Where J - K is symmetric, Lambda = 2 (J - K), and v shows an eigenvalue > 0.
    if count == 1 and low > 0 and is_symmetric(case, check.mode):
        return
    counted = unstable(jacobian(case, check.mode), int(count))
    need(counted, "unstable roots are not shown")


def theorem_refuted(case: Case, check: Any) -> None:
    """No pair does, because of Lambda in a mode, or of the exosystem or the own gain of a group."""
    exact = read(check.exact, {"block": text, "mode?": text, "group?": text})
    if exact.block == "Lambda":
        need(exact.mode in case.modes and exact.group is None, "there is no such mode")
        by_vector(case, check, exact.mode)
        return
    plain = exact.mode is None and check.margin is None
    need(plain, "a cause in the exosystem has no mode and no margin")
    known = exact.block in ("detectability", "hurwitz") and exact.group in case.names
    need(known, "the cause is none that is known")
    residual = case.residuals[case.names.index(exact.group)]
    need(exact.block == "detectability" or residual.W is not None, "a designed W refutes nothing")
    found = OF_GROUPS[exact.block](own(case, exact.group))
    there = not found.holds and same(check.witness, found.witness)
    need(there, "the cause is not there, or it has another witness")


def pair_refuted(case: Case, check: Any) -> None:
    """The pair of the problem does not do: P > 0, Omega < 0 or, in a mode, Lambda + the blocks of S
    < 0 fails."""
    # the parts in the order in which they are needed: P > 0, Omega < 0, then the modes
    exact = check.exact or {}
    P = case.given_P or []
    if exact == {"block": "P"}:
        no_form(check, P)
    elif exact == {"block": "Omega0"}:
        no_form(check, opposite(omega(case, P, ZERO)))
    else:
        listed = values(case, P)
        mode = exact.get("mode")
        need(type(mode) is str and mode in case.modes, "there is no such mode")
        need(same(exact, listed | {"mode": mode}), "P, Q, S or the bound is another one here")
        by_vector(case, check, str(mode), listed["S"])


def no_form(check: Any, X: Matrix) -> None:
    """The witness v shows that X > 0 fails."""
    witness = read(check.witness, {"kind": text, "values": partial(direction, len(X))})
    is_vector = witness.kind == "vector" and check.margin is None
    need(is_vector, "the witness is no vector, or it claims a margin")
    need(form(witness.values, X, witness.values) <= 0, "the vector does not show it")
