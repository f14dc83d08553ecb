"""Claims about the target: facts of exosystems, observer and graph, Lemma 1 (e'e decreases), and
the theorems.

The theorems are about e and the observer's error together, by a pair P, Q. Psi < 0 in a mode iff
Omega(0) < 0 and Lambda + the blocks of S(0) of the agents < 0.
"""

from fractions import Fraction
from functools import partial
from operator import mul
from typing import Any

from .files import Certificate, Problem, reach
from .intervals import outward
from .matrices import (
    ZERO,
    Matrix,
    characteristic,
    definite,
    diagonal,
    echelon,
    form,
    identity,
    integers,
    nullspace,
    plus,
    polynomial_text,
    positive,
    product,
    routh,
    semidefinite,
    stable,
    transpose,
    unstable,
)
from .reading import (
    MATRIX_BITS,
    an_object,
    direction,
    matrix,
    need,
    rational,
    read,
    same,
    short,
    text,
    weights,
)

# whether it is so, the exact value that stands there, and the witness if it is not so
Fact = tuple[bool, Any, Any]


# --- Facts
# --------------------------------------------------------------------------------------------------
def observable(group: Any) -> tuple[Matrix, list[int]]:
    """T, a basis of what is seen of the exosystem, and the columns of its leading ones."""
    rows, part = Matrix(), group.C
    for _ in group.A:
        rows, part = rows + part, product(part, group.A)
    return echelon(rows)


def takes_long(group: Any) -> bool:
    """The limit on the order and the bits of (A, C), to the seventh and second power, of the whole
    format."""
    sizes, bottom = integers([abs(x) for row in (*group.A, *group.C) for x in row])
    return bool(
        len(group.A) ** 7 * (bottom.bit_length() + (-(-max(sizes) // bottom)).bit_length()) ** 2
        > 5 * 10**13
    )


def closed(system: Any, W: Matrix | None, b: Fraction = ZERO) -> Matrix:
    """A - W C + b I, of a group or of the whole problem."""
    need(W is not None, "there is no observer gain")
    return plus(plus(system.A, -1, product(W or [], system.C)), 1, identity(len(system.A), b))


def observability(group: Any, W: Matrix | None) -> Fact:
    """C, C A, C A^2, ... have full rank."""
    T, q = observable(group)[0], len(group.A)
    return (
        len(T) == q,
        {"rank": Fraction(len(T))},
        {"kind": "vector", "values": [*nullspace(T, q)[0], []][0]},
    )


def detectability(group: Any, W: Matrix | None) -> Fact:
    """What C does not see decays."""
    basis, free = nullspace(observable(group)[0], len(group.A))
    images = product(basis, transpose(group.A))
    R = transpose([[image[k] for k in free] for image in images])
    p = polynomial_text(characteristic(R))
    return stable(R), {"unobservable_polynomial": p}, {"kind": "polynomial", "values": [p]}


def hurwitz(group: Any, W: Matrix | None) -> Fact:
    """Every eigenvalue of A - W C has a negative real part."""
    column = routh(characteristic(closed(group, W)))
    end = next((k for k, entry in enumerate(column) if entry <= 0), 0)
    return (
        end == 0,
        None if end else {"routh": column},
        {"kind": "routh_row", "values": column[: end + 1]},
    )


OF_GROUPS = {"observability": observability, "detectability": detectability, "hurwitz": hurwitz}


def fact(case: Certificate, check: Any) -> None:
    """A fact of one group, or reachability in one mode, is as the check says."""
    if check.id in OF_GROUPS:
        group, W = own(case, check.group)
        found, exact, witness = OF_GROUPS[check.id](group, W)
    else:  # every agent is pinned, or hears a pinned one, directly or through others
        p, group, W = case.problem, None, None
        reached = reach(p.pinned, p.edges([check.mode], False))
        rest = [label for i, label in enumerate(p.labels) if i not in reached]
        found, exact, witness = not rest, None, {"kind": "agents", "labels": rest}
    need(check.margin is None, "it has no margin to claim")
    need(check.rate is None or check.id == "hurwitz", "it has no rate to claim")
    need(
        check.rate is None or (check.rate > 0 and stable(closed(group, W, check.rate))),
        "the rate is not shown",
    )
    need((check.verdict == "proved") == found, f"it is {'proved' if found else 'refuted'} here")
    need(same(check.exact, exact), "the exact value is another one here")
    need(same(check.witness, None if found else witness), "the witness is another one here")


# --- Observer
# --------------------------------------------------------------------------------------------------
def own(case: Certificate, name: str | None) -> tuple[Any, Matrix | None]:
    """A group by its name, and its block of W."""
    k = case.problem.names.index(name)
    return case.problem.groups[k], None if case.W is None else parts(
        case.problem, case.W, case.problem.m
    )[k]


def parts(p: Problem, X: Matrix, width: int) -> list[Matrix]:
    """The blocks of X that belong to the groups, of this width (0: square); X must be zero
    elsewhere."""
    blocks, row, column = list[Matrix](), 0, 0
    for group in p.groups:
        rows, columns = len(group.A), width or len(group.A)
        blocks.append([line[column : column + columns] for line in X[row : row + rows]])
        row, column = row + rows, column + columns
    need(diagonal(blocks) == X, "a matrix is not block diagonal")
    return blocks


def observer(case: Certificate) -> None:
    """The claimed W, P and Q are those of the problem, where it has any, and belong together."""
    p, W, P, Q = case.problem, case.W, case.P, case.claims.observer.Q
    source = None if W is None else "designed" if p.W is None else "given"
    need(case.claims.observer.source == source, "the source of the observer gain is wrong")
    need(W is None or p.q > 0, "there is an observer, but no exosystem")
    need(p.W is None or W == p.W, "the observer gain is not the one of the problem")
    for group, gain in zip(p.groups, parts(p, W, p.m), strict=True) if W is not None else ():
        need(group.W in (None, gain), "the observer gain of a group is not that of the problem")
    proved = any(check.id == case.theorem and check.verdict == "proved" for check in case.checks)
    need(
        (P is not None) == (Q is not None) == proved, "P and Q belong beside a proved theorem, both"
    )
    if P is not None:
        parts(p, P, 0)
        need(transpose(P) == P, "P is not symmetric")
        need(W is not None and product(P, W) == Q, "Q is not P W")


def omega(case: Certificate, P: Matrix, b: Fraction) -> Matrix:
    """P A + A'P - Q C - C'Q' + 2 b P, with Q = P W, of all groups together."""
    half = product(P, closed(case.problem, case.W, b))
    return plus(half, 1, transpose(half))


def schur(case: Certificate, P: Matrix, b: Fraction) -> Matrix:
    """S = C (-Omega)^-1 C', once Omega < 0 is shown."""
    Omega, C = omega(case, P, b), case.problem.C
    need(definite(Omega, -1), "Omega < 0 is not shown")
    rows, _ = echelon(
        [[-x for x in row] + column for row, column in zip(Omega, transpose(C), strict=True)]
    )
    return product(C, [row[len(Omega) :] for row in rows])


# --- Lemma 1 and the theorems: proofs
# ---------------------------------------------------------------------------------
def consensus(case: Certificate, check: Any) -> None:
    """Decide lemma1, theorem1, theorem2 and the printed pairs."""
    need(not case.problem.kinked, "a coupling has a kink, so the theorems do not apply")
    if check.verdict == "proved":
        need(check.witness is None, "it is proved and carries a witness")
        need(check.margin is not None and check.margin >= 0, "a proof needs a margin of at least 0")
        need(check.rate is None or check.rate > 0, "a rate has to be positive")
        proof(case, check)
    else:
        need(check.rate is None, "it is refuted and claims a rate")
        need(
            check.margin is None or check.margin <= 0, "it is refuted and claims a positive margin"
        )
        {"lemma1": lemma_refuted, case.theorem: theorem_refuted}.get(check.id, pair_refuted)(
            case, check
        )


def proof(case: Certificate, check: Any) -> None:
    """Lambda < 0 in the mode, or Psi < 0 for the pair in every mode, with the margin and the
    rate."""
    lemma, P = check.id == "lemma1", (case.P if check.id == case.theorem else case.problem.P) or []
    need(lemma or definite(P), "P > 0 is not shown")
    need(lemma or same(check.exact, values(case, P)), "P, Q, S or the bound is another one here")
    modes = [check.mode] if lemma else list(case.problem.modes)
    for b, shift in [(ZERO, check.margin)] + (
        [(check.rate, 2 * check.rate)] if check.rate is not None else []
    ):
        S = None if lemma else schur(case, P, b)
        need(
            all(decreases(case, mode, shift, S) for mode in modes),
            "the margin or the rate is not shown",
        )


def values(case: Certificate, P: Matrix) -> dict[str, Any]:
    """What is listed for a pair: P, Q, S, and the bound -s if S = s I."""
    S = schur(case, P, ZERO)
    bound = {"bound": -S[0][0]} if identity(len(S), S[0][0]) == S else {}
    return {"P": P, "Q": product(P, case.W or []), "S": S} | bound


def decreases(case: Certificate, mode: str, shift: Fraction, S: Matrix | None) -> bool:
    """Lambda + the blocks of S of the agents + shift I < 0 in that mode; if a vector stands beside
    Lemma 1, it has to show this, with room for every block."""
    p, m = case.problem, case.problem.m
    blocks: dict[int | None, Matrix] = {}
    for i in range(p.n):
        if p.place.get(i) not in blocks:
            blocks[p.place.get(i)] = p.block(S, i) if S else identity(m, 0)
    left = case.rooms[mode] if mode in case.rooms else case.rooms.setdefault(mode, room(case, mode))
    if left is not None:
        return all(definite(plus(identity(m, left - shift), -1, each)) for each in blocks.values())

    rows = [{j: -x for j, x in row.items()} for row in p.bounds[mode]]
    for i, row in enumerate(rows):
        row[i] -= shift
        for d, x in enumerate(blocks[p.place.get(i // m)][i % m] if S else []):
            (lo, hi), j = outward(x, x), i - i % m + d
            row[j] = row.get(j, ZERO) - (lo + hi) / 2
            row[i] -= hi - lo
    return positive(rows)


def room(case: Certificate, mode: str) -> Fraction | None:
    """The least -(U v)_i / v_i for the vector v beside a proved Lemma 1, if there is one, where U
    >= Lambda has its entries beside the diagonal taken by their sizes: every eigenvalue of Lambda
    is at most minus that."""
    p, lemma = (
        case.problem,
        next(each for each in case.checks if (each.id, each.mode) == ("lemma1", mode)),
    )
    if lemma.verdict != "proved" or lemma.exact is None:
        return None
    v, _ = integers(read(lemma.exact, {"v": partial(weights, p.n * p.m)}).v)
    need(type(lemma.exact["v"]) is dict, "the vector is no block of doubles")
    rows = enumerate(p.bounds[mode])
    return min(
        sum((-abs(x) * v[j] for j, x in row.items() if j != i), -row[i] * v[i]) / v[i]
        for i, row in rows
    )


def weighted(case: Certificate, check: Any) -> None:
    """V = e'De + sum eps_i'P eps_i decreases at the rate: in every mode N w > 0 for N = D M + M'D -
    2 rate D - s D^2, M = K - J, which has no positive entry beside the diagonal; s is the largest
    row sum of the agent's block of S."""
    p, b, m = case.problem, check.rate or ZERO, case.problem.m
    size = p.n * m
    need(not p.kinked, "a coupling has a kink, so the theorem does not apply")
    need(
        check.verdict == "proved" and check.witness is None,
        "it is proved, without a witness, or undecided",
    )
    need(
        check.margin is None and (check.rate is None or b > 0),
        "it claims a margin, or a rate that is not positive",
    )
    known = partial(weights, size)
    if p.B is not None and "R" in (check.exact or {}):
        alike(case, check)
        return
    claim = read(
        check.exact, {"D": known, "w": an_object} | ({"P": matrix(p.q, p.q)} if p.q else {})
    )
    need(set(claim.w) == set(p.modes), "there is no vector for each mode")
    if p.q:
        parts(p, claim.P, 0)
    need(not p.q or (transpose(claim.P) == claim.P and definite(claim.P)), "P > 0 is not shown")
    S = schur(case, claim.P, b) if p.q else []
    worst = [max(sum(map(abs, row)) for row in p.block(S, i)) if S else ZERO for i in range(p.n)]
    for mode in p.modes:
        D, w = claim.D, [*known(claim.w[mode]), ZERO]
        left = [-(2 * b + worst[i // m] * D[i]) * D[i] * w[i] for i in range(size)] + [ZERO]
        for i, j, own, (lo, hi) in p.terms(mode):
            need(own == i or lo == hi == 0, "a coupling or a gain mixes components")
            # what dynamics do to an agent itself may have any sign
            need(lo >= 0 or j == size, "a slope is negative")
            pull = 2 * w[i] - w[j]
            left[i] += D[i] * pull * (lo if pull > 0 else hi) if own == i else 0
            left[j] -= D[i] * hi * w[i] if own == i else 0
        need(min(left[:size]) > 0, "the weights do not show it")


def alike(case: Certificate, check: Any) -> None:
    """V = e'(D (x) R)e of agents with dynamics decreases at the rate: slopes are g G, gains B K = k
    G, g, k >= 0, and N w > 0 for N = D M + M'D - 2 c D, R > 0, R G = G'R >= 0, A'R + R A - 2 c R G
    + 2 rate R < 0, M = L(g) + diag(k)."""
    p, b, vector = case.problem, check.rate or ZERO, partial(weights, case.problem.n)
    claim = read(check.exact, {"D": vector, "w": an_object, "c": rational, "R": matrix(p.m, p.m)})
    need(set(claim.w) == set(p.modes), "there is no vector for each mode")
    R, c, every = claim.R, claim.c, range(p.m)
    short((x for row in R for x in row), MATRIX_BITS)
    known = p.couplings[: len(p.couplings) - p.nodes]
    slopes = [[[coupling.slope(i, j) for j in every] for i in every] for coupling in known]
    need(all(lo == hi for each in slopes for row in each for lo, hi in row), "a slope is not exact")
    exact = [[[lo for lo, _ in row] for row in each] for each in slopes]
    G = next((each for each in exact if any(map(any, each))), identity(p.m))
    parts = dict(zip(known, (multiple(each, G) for each in exact), strict=True))
    none = identity(p.m, 0)
    gains = [multiple(plus(p.gains.get(i, none), 1, p.drift), G) for i in range(p.n)]
    RG, RA = product(R, G), product(R, p.drift)
    F = plus(plus(plus(RA, 1, transpose(RA)), -2 * c, RG), 2 * b, R)
    need(transpose(R) == R and transpose(RG) == RG, "R or R G is not symmetric")
    need(definite(R) and semidefinite(RG) and definite(F, -1), "R does not show it")
    need(not p.q or stable(closed(p, case.W, b)), "A - W C + rate I is not Hurwitz")
    for mode, arcs in p.modes.items():
        D, w = claim.D, vector(claim.w[mode])
        left = [2 * D[i] * w[i] * (k - c) for i, k in enumerate(gains)]
        for i, j, weight, coupling, loose in arcs:
            g = weight * parts[coupling] * D[i]
            left[i] += min(ZERO, g * (2 * w[i] - w[j])) if loose else g * (2 * w[i] - w[j])
            left[j] -= g * w[i]
        need(min(left) > 0, "the weights do not show it")


def multiple(X: Matrix, G: Matrix) -> Fraction:
    """The number g >= 0 with X = g G."""
    pairs = [(x, y) for rows in zip(X, G, strict=True) for x, y in zip(*rows, strict=True)]
    g = next((x / y for x, y in pairs if y), ZERO)
    need(
        g >= 0 and all(x == g * y for x, y in pairs),
        "couplings and gains are not multiples of one matrix",
    )
    return g


def linearisation(case: Certificate, check: Any) -> None:
    """J - K (of one mode) and A - W C have all eigenvalues left of minus the rate, or J - K has
    some right of 0."""
    p, b = case.problem, check.rate or ZERO
    need(not p.kinked and not p.switches, "it is about a smooth loop with one graph")
    need(
        check.margin is None and check.witness is None and (check.rate is None or b > 0),
        "it claims something else",
    )
    (X,) = map(p.jacobian, p.modes)
    if check.verdict == "proved":
        need(check.exact is None, "it claims exact values")
        need(stable(plus(X, 1, identity(len(X), b))), "J - K + rate I is not Hurwitz")
        need(not p.q or stable(closed(p, case.W, b)), "A - W C + rate I is not Hurwitz")
    else:
        count = read(check.exact, {"unstable_roots": rational}).unstable_roots
        need(
            check.rate is None and count.denominator == 1 and count > 0,
            "it is refuted by a number of roots",
        )
        need(unstable(X, int(count)), "unstable roots are not shown")


# --- Lemma 1 and the theorems: refutations
# ----------------------------------------------------------------------------
def by_vector(case: Certificate, check: Any, mode: str, S: Matrix | None = None) -> Fraction:
    """The witness v shows that X = Lambda + the blocks of S has v'Xv >= max(0, -M v'v); a lower
    bound of v'Xv."""
    p, m = case.problem, case.problem.m
    witness = read(
        check.witness, {"kind": text, "labels": [text], "values": partial(direction, p.n * p.m)}
    )
    v, each = witness.values, [witness.values[i * m : i * m + m] for i in range(p.n)]
    need(witness.kind == "vector", "the witness is no vector")
    support = [label for label, part in zip(p.labels, each, strict=True) if any(part)]
    need(witness.labels == support, "the labels are not the agents where the vector is not 0")
    low = p.low(mode, [*v, ZERO]) + sum(
        form(part, p.block(S, i), part) for i, part in enumerate(each) if S
    )
    need(
        low >= max(ZERO, -(check.margin or ZERO) * sum(map(mul, v, v))),
        "the vector does not show it",
    )
    return low


def lemma_refuted(case: Certificate, check: Any) -> None:
    """A vector shows that Lambda < 0 fails; unstable roots are counted besides."""
    exact = read(check.exact, {"unstable_roots": rational, "value?": rational})
    low, count = by_vector(case, check, check.mode), exact.unstable_roots
    need(
        exact.value is None or exact.value <= low,
        "v'Lambda v is less than the value that is claimed",
    )
    need(count >= 0 and count.denominator == 1, "unstable_roots is no number of roots")
    # Where J - K is symmetric, Lambda = 2 (J - K), and v shows an eigenvalue > 0.
    shown = count == 0 or (count == 1 and low > 0 and case.problem.is_symmetric(check.mode))
    need(
        shown or unstable(case.problem.jacobian(check.mode), int(count)),
        "unstable roots are not shown",
    )


def theorem_refuted(case: Certificate, check: Any) -> None:
    """No pair does, because of Lambda in a mode, or of the exosystem or the own gain of a group."""
    exact, p = read(check.exact, {"block": text, "mode?": text, "group?": text}), case.problem
    if exact.block == "Lambda":
        need(exact.mode in p.modes and exact.group is None, "there is no such mode")
        by_vector(case, check, exact.mode)
        return
    need(
        exact.mode is None and check.margin is None,
        "a cause in the exosystem has no mode and no margin",
    )
    need(
        exact.block in ("detectability", "hurwitz") and exact.group in p.names,
        "the cause is none that is known",
    )
    group, W = own(case, exact.group)
    need(exact.block == "detectability" or group.W is not None, "a designed W refutes nothing")
    found, _, witness = OF_GROUPS[exact.block](group, W)
    need(
        not found and same(check.witness, witness),
        "the cause is not there, or it has another witness",
    )


def pair_refuted(case: Certificate, check: Any) -> None:
    """The pair of the problem does not do: P > 0, Omega < 0 or, in a mode, Lambda + the blocks of S
    < 0 fails."""
    p, exact, P = case.problem, check.exact or {}, case.problem.P or []
    if exact in ({"block": "P"}, {"block": "Omega0"}):
        witness = read(check.witness, {"kind": text, "values": partial(direction, p.q)})
        v, X = (
            witness.values,
            P if exact["block"] == "P" else [[-x for x in row] for row in omega(case, P, ZERO)],
        )
        need(
            witness.kind == "vector" and check.margin is None,
            "the witness is no vector, or it claims a margin",
        )
        need(form(v, X, v) <= 0, "the vector does not show it")
    else:
        listed, mode = values(case, P), exact.get("mode")
        need(type(mode) is str and mode in p.modes, "there is no such mode")
        need(same(exact, listed | {"mode": mode}), "P, Q, S or the bound is another one here")
        by_vector(case, check, str(mode), listed["S"])
