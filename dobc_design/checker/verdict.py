"""The overall verdict: what follows from the claims of a certificate, once all are confirmed."""

from collections.abc import Collection, Iterator
from fractions import Fraction
from typing import Any

from .arcs import stated_errors
from .claims import Case
from .consensus import closed, closed_sets, detectability, observable, takes_long
from .factors import time_to_one_percent
from .graphs import MODES, absorbing
from .intervals import Exact
from .loop import Loop, reach
from .matrices import ZERO, echelon, meets, paired, product, stable
from .pairs import rows_of
from .reading import need, rational
from .sampled import decays

# one around the target answers the local question, too, where that is about more than slopes
BOXES = ("max-separable", "schedule", "markov", "arc-wise", "readings")


def overall(case: Case) -> None:
    """The verdict, the rate with its factor and what covers it follow from the checks."""
    best = covering(case)
    failed = best is None and refuted(case)
    if best is not None:
        best = answered(case, best)
    verdict = "undecided"
    if best:
        verdict = "proved"
    elif failed:
        verdict = "refuted"
    claims = case.claims
    need(claims.verdict == verdict, f"the verdict that follows is {verdict}")
    need(claims.rate == (best and best.rate), "the rate is another one")
    need(claims.factor == (best and best.factor), "the factor is another one")
    need(claims.covered_by == (best and best.id), "it is covered by another check")


# --- proved
def covering(case: Case) -> Any:
    """The check that proves the verdict, the one with the least time to one percent; none if no
    check does."""
    proofs = [check for check in case.checks if check.verdict == "proved" and covers(case, check)]
    # with late readings all others are about another plant
    if any(check.id == "readings" and check.verdict == "refuted" for check in case.checks):
        return None
    # states converge where their estimates do and the errors of these decay
    for residual in case.residuals:
        if residual.sensed is not None and not stable(closed(residual)):
            return None
    proofs = list(filter(knows_readings, proofs)) or proofs
    lemmas = [check for check in proofs if check.id == "lemma1"]
    slowest = None
    # Lemma 1 is about one mode: the slowest stands for all, if all have one
    if len(lemmas) == len(case.modes):
        slowest = min(lemmas, key=lambda check: check.rate or ZERO)
    counted = [check for check in proofs if check.id != "lemma1" or check is slowest]
    # the checks of tables are about the graphs of the modes, not about every graph
    if tables(case):
        counted = [check for check in counted if check.id != "safety"]
    # what holds for every signal comes before what needs a guarantee
    always = [check for check in counted if check.id not in ("schedule", "markov")]

    def order(check: Any) -> tuple[float, Fraction]:
        return time_to_one_percent(check), -(check.rate or ZERO)

    return min(always or counted, key=order, default=None)


def knows_readings(check: Any) -> bool:
    """Whether it is about readings as late as the problem says."""
    return check.id == "readings" or "late" in (check.exact or ())


def tables(loop: Loop) -> list[str]:
    """The checks that have to be proved because of `actuators` and `uncertainty`, or of how
    readings are taken; the last one carries the verdict, unless it is about limits alone."""
    plant = loop.uncertainty
    found = []
    if loop.actuators is not None and loop.actuators.limit:
        found.append("actuators")
    if loop.timing is not None:
        found.append("readings")
    elif plant is None:
        return found
    elif loop.disturbed:
        found.append("accuracy")
    elif plant.weights or plant.gains:
        found.append("tolerance")
    return found


def answered(case: Case, best: Any) -> Any:
    """The check that carries the verdict about the plant with its tables, beside ``best``; None if
    one is open."""
    asked = tables(case)
    for id in asked:
        found = [case.proved(id)]
        if id == "tolerance" and any(stated_errors(case)):
            found.append(case.proved("arc-wise"))
        moving = case.proved("schedule")
        if id == "readings" and moving is not None and knows_readings(moving):
            found.append(moving)
        check = next((each for each in found if each and asked_for(case, each.domain)), None)
        if check is None:
            return None
        if id != "actuators":
            best = check
    # separate checks prove nothing together: errors at the target, and inputs in a box of others
    if asked == ["actuators", "tolerance"] and {"v", "d"} & best.exact.keys():
        exact = case.proved("actuators").exact
        own_box = "v" in exact or "rooms" in exact
        if own_box:
            return best
        return None
    return best


def asked_for(loop: Case, domain: Any) -> bool:
    """True if a domain of these checks holds the starts that are asked for."""
    if domain == "global":
        return True
    if loop.region is not None:
        return holds_region(loop, domain)
    return type(domain) is str or is_open(loop, domain)


def is_open(loop: Loop, domain: Any) -> bool:
    """Whether a box or ball holds all starts near the target."""
    return bool(domain.radius > 0 and (not loop.q or domain.disturbance > 0))


def covers(case: Case, check: Any) -> bool:
    """True if what is proved holds from all starts that are asked for (lemma1: in its mode)."""
    domain = check.domain
    local = (case.theorem, case.theorem + "-printed") if case.q else ("lemma1",)
    if check.id in (*local, case.theorem + "-weighted", "linearisation"):
        return case.region is None or case.domain == "global"
    safe = check.id == "safety" and check.rate is not None
    # it ends in a proof that holds from then on, whatever the signal
    settles = check.id == "settling" and case.region is not None
    settles = settles and case.guarantee.kind in (None, "arbitrary")
    if not safe and not settles and check.id not in (*BOXES, "lure"):
        return False
    if type(domain) is str:
        return bool(domain == "global")
    if case.region is not None:
        return holds_region(case, domain)
    # a box around the target answers the local question: several modes, dynamics, leaders, pairs
    several = case.switches or case.B is not None or case.gap > 0 or case.agrees
    several |= case.timing is not None
    box = several and check.id in BOXES
    ball = check.id == "lure" and case.own is not None and case.leader is not None
    return (safe or box or ball) and is_open(case, domain)


def holds_region(loop: Case, domain: Any) -> bool:
    """True if a box or ball holds the region."""
    region = loop.region
    if region is None or type(domain) is str:
        return False
    farthest = []
    for c, (side, leads) in enumerate(paired(region.initial_states, loop.leads)):
        if loop.agrees:
            goals = [goal[c] for goal in loop.goals]
            farthest.append(side[1] - side[0] + max(goals) - min(goals))
            continue
        ends = [end - start for end in side for start in leads]
        farthest.append(max(abs(end - goal[c]) for goal in loop.goals for end in ends))
    if domain.kind == "box":
        square = max(farthest) ** 2
    else:
        square = rows_of(loop).n * sum(side**2 for side in farthest)
    disturbance = region.initial_disturbance or 0
    return bool(domain.radius**2 >= square and domain.disturbance >= disturbance)


# --- refuted
def refuted(case: Case) -> bool:
    """True if a closed set of nodes, an equilibrium, a residual's own W or an unstable mode shows
    that it fails."""
    found = [check for check in case.checks if check.verdict == "refuted"]
    if stays_apart(case) or case.gap:  # the rest is about one target
        return stays_apart(case)
    # without a region it is about every neighbourhood of the target, where the equilibrium is not
    if case.region is not None and any(check.id == "equilibrium" for check in found):
        return True
    if not all(watched_parts(case)) or any(hidden_states(case)):
        return True
    # instability at the target is about starts near it
    if not starts_around_goals(case):
        return False
    # what grows in the flow need not do so from one period to the next
    held = case.timing is not None and case.timing.period
    growing = ("readings",) if held else ("readings", "schedule")
    if any(check.id in growing for check in found) or drifts(case):
        return True
    if held and case.B is not None:
        return False
    unstable = [check for check in found if check.id in ("lemma1", "linearisation")]
    for check in unstable:
        stays = case.guarantee.may_stay(check.mode or next(iter(case.modes)))
        if stays and rational(check.exact["unstable_roots"]) > 0:
            return True
    return False


def watched_parts(loop: Loop) -> Iterator[bool]:
    """Whether what is seen of A - W C with a W of the problem decays, which it has to; of samples
    whether it is not shown to stay. T (A - W C) = F T, and F is the columns of T (A - W C) in which
    the rows of T begin."""
    if loop.region is not None and not loop.region.initial_disturbance:
        return  # estimates are exact from the start
    for residual in loop.residuals:
        # where estimates diverge states need not
        if residual.W is None or residual.sensed is not None or takes_long(residual):
            continue
        T, columns = observable(residual)
        if loop.sampled:
            A, C = (of(product(T, residual.A), columns), of(residual.C, columns))
            seen = residual._replace(A=A, C=C, W=product(T, residual.W))
            yield not T or decays(seen, loop.timing) is not False
        else:
            yield stable(of(product(T, closed(residual)), columns))


def hidden_states(loop: Loop) -> Iterator[bool]:
    """Whether states of agents may differ for ever and outputs be the same, which no W tells
    apart: what is hidden stays, and not because it is hidden in the exosystem alone."""
    region = loop.exact_region
    if region is not None:
        wide = all(lo < hi for lo, hi in region.initial_states)
        if not wide or not region.initial_disturbance:
            return
    # within a bound they may end all the same; one agent agrees with itself
    if loop.disturbed or (loop.agrees and loop.n == 1):
        return
    m = loop.m
    for residual in loop.residuals:
        seen = residual.observed
        if residual.sensed is None or takes_long(seen) or detectability(seen).holds:
            continue
        A = of(seen.A[m:], list(range(m, len(seen.A))))
        felt = of(seen.A[:m], list(range(m, len(seen.A))))
        yield detectability(residual._replace(A=A, C=felt)).holds


def of(rows: Any, columns: list[int]) -> list[Any]:
    """These columns."""
    return [[row[k] for k in columns] for row in rows]


def starts_around_goals(loop: Loop) -> bool:
    """Whether the region, if there is one, holds starts on all sides of the goals, for some start
    of the leader: then instability at the target is seen."""
    if loop.exact_region is None:
        return True
    sides = paired(loop.exact_region.initial_states, loop.leads)
    for c, ((lo, hi), (first, last)) in enumerate(sides):
        low = max(lo - goal[c] for goal in loop.goals)
        high = min(hi - goal[c] for goal in loop.goals)
        if not low < high:
            return False
        # agents that agree may do so anywhere
        if not (loop.agrees or (low < last and first < high)):
            return False
    return True


def stays_apart(loop: Loop) -> bool:
    """Whether a closed set of nodes can stay away from the target: in all modes together,
    whatever arcs are there, or in modes that may be on over and over."""
    last = absorbing(loop) if len(loop.modes) <= MODES else []
    all_modes, *cycles = loop.guarantee.allowed()
    if loop.agrees:
        wide = [True]
        if loop.exact_region is not None:
            wide = [lo < hi for lo, hi in loop.exact_region.initial_states]
        # what agents do by themselves may bring them together
        kept = loop.drift is None or (all(wide) and not stable(loop.drift))
        if not (any(wide) and kept):
            return False
        sets = [closed_sets(loop, all_modes, True)]
        sets += [closed_sets(loop, cycle, False) for cycle in [*cycles, *last]]
        return any(len(each) > 1 for each in sets)
    if loop.signed:
        turns = (rests(loop, cycle, False) for cycle in [*cycles, *last])
        return rests(loop, all_modes, True) or any(turns)
    if escapes(loop, all_modes, True):
        return True
    return any(escapes(loop, cycle, False) for cycle in [*cycles, *last])


def escapes(loop: Loop, modes: Collection[str], loose: bool) -> bool:
    """A closed set of nodes (they listen to nobody outside; ``loose``: not even by arcs that
    come and go) can stay away from the target in these modes, inside the region. The smallest
    closed set around a node has the fewest gains; a nonsingular gain in it holds it."""
    if loop.own is not None:  # it may pull where neither gains nor slopes do
        return False
    nonsingular = [i for i, k in loop.hold.items() if len(echelon(k)[0]) == loop.m]
    hears = loop.edges(modes, True, loose)
    # who hears a fixed node is in no closed set
    nonsingular += loop.tied(modes, loose)
    held = reach(nonsingular, loop.edges(modes, False, loose))
    apart = (i for i in loop.nodes if i not in held)
    return any(leaves_free(loop, reach([i], hears)) for i in apart)


def rests(loop: Loop, modes: Collection[str], loose: bool) -> bool:
    """The same with signs: a closed set whose signs balance can stay at c on one side and -c on the
    other."""
    tied = set(loop.tied(modes, loose))
    sets = closed_sets(loop, modes, loose)
    return any(leaves_free(loop, each) for each in sets if not each & tied)


def drifts(loop: Loop) -> bool:
    """A closed set of nodes without a pin, whose common error follows e' = A e, does not come
    to rest."""
    # agents that agree may move on together
    if loop.agrees or loop.drift is None or loop.own is not None or stable(loop.drift):
        return False
    return len(reach(loop.pinned(loop.modes, True), loop.edges(loop.modes, False, True))) < loop.n


def leaves_free(loop: Loop, group: set[int]) -> bool:
    """No gain of the group acts on some shift c other than 0, and the region holds such a
    shift."""
    # the shift c has to be 0 for all gains of the group
    rows, pivots = echelon([row for i in group for row in loop.hold.get(i, [])])
    if len(pivots) == loop.m:
        return False
    if loop.exact_region is None:
        return True

    box: list[Exact] = []
    for c, (lo, hi) in enumerate(loop.exact_region.initial_states):
        low = lo - min(loop.goals[i][c] for i in group)
        high = hi - max(loop.goals[i][c] for i in group)
        if low > high:
            return False
        first, last = loop.leads[c]
        box.append((low - last, high - first))
    return any(meets(rows, pivots, each) for each in shifts(box))


def shifts(box: list[Exact]) -> Iterator[list[Exact]]:
    """Boxes, one of which holds a shift c with some rows c = 0 iff the given box holds one that
    is not 0."""
    if not all(lo <= 0 <= hi for lo, hi in box):
        yield box
        return
    # around 0 the longest multiple of a shift ends at a side
    for k, side in enumerate(box):
        for end in filter(None, side):
            yield [*box[:k], (end, end), *box[k + 1 :]]
