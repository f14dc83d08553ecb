"""What the two files hold: the problem, which is trusted, and the claims of the certificate, read
and not judged.

Agents with the same exosystem are a group; a problem with one exosystem has one group of all
agents. Where there are groups, an agent in none of them has no disturbance. A, C, W and P of the
problem are those of the joint exosystem: block diagonal, with the blocks of the groups. Without
exosystem q = 0.
"""

import hashlib
import math
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from functools import cached_property, partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

from .expressions import LONGEST, LONGEST_MADE, Coupling, Expression, read_coupling
from .intervals import Exact, enclosed, times
from .matrices import (
    ZERO,
    Matrix,
    Rows,
    diagonal,
    echelon,
    identity,
    meets,
    plus,
    product,
    stable,
    transpose,
)
from .reading import (
    MATRIX_BITS,
    Refused,
    an_object,
    as_hashed,
    document,
    index,
    integer,
    json_number,
    matrix,
    maybe,
    need,
    one_of,
    rational,
    read,
    short,
    text,
)

ROOTS_SIZE = 60  # largest matrix whose eigenvalues are counted


class Arc(NamedTuple):
    """Agent i listens to agent j."""

    i: int
    j: int
    w: Fraction
    coupling: Coupling
    loose: bool = False  # it comes and goes: w times any number from 0 to 1


class Problem:
    """problem.json: agents, arcs, couplings, gains, exosystems, and the region that is asked
    for."""

    def __init__(self, data: bytes) -> None:
        source = document(data, "dobc-problem")
        self.sha256, self.labels = (
            hashlib.sha256(as_hashed(source)).hexdigest(),
            read(source.get("labels"), [text]),
        )
        self.n, self.m = n, m = len(self.labels), integer(source.get("dimension"))
        need(0 < n == len(set(self.labels)), "labels have to be different, and at least one")
        need(1 <= m <= 100, "the dimension is not between 1 and 100")
        self.read_dynamics(source.get("dynamics"))
        p = len(self.left)

        agent = partial(index, n)
        shape = dict.fromkeys(("version", "labels", "dimension", "switching", "dynamics?")) | {
            "format": text,
            "name": text,
            "notes": [text],
            "target": (rational,) * m,
            "modes": [
                {"name": text} | {key: [(agent, agent, rational)] for key in ("arcs", "optional?")}
            ],
            "coupling": {
                "h": self.read_h,
                "exceptions": [{"arc": (agent, agent), "h": self.read_h}],
            },
            "gains": [(agent, matrix(p, m))],
            "exosystem": maybe(an_object),
            "offsets": [(agent, (rational,) * m)],
            "observer": {"W": None, "P": None, "rate": maybe(rational)},
            "uncertainty?": dict.fromkeys(
                ("weights", "gains", "disturbance", "drift", "measurement"), rational
            )
            | {"known_to_agents": partial(one_of, (bool,))},
            "actuators?": {"limit": self.read_limit, "amplitude": maybe(rational)},
            "leader?": {"initial": matrix(m, 2), "stays_in?": matrix(m, 2)},
            "simulation": an_object,
            "region": maybe(
                {"initial_states": matrix(m, 2), "initial_disturbance": maybe(rational)}
            ),
        }
        file = read(source, shape)
        offsets = dict(file.offsets)
        self.goals = [plus([file.target], 1, [offsets.get(i, [ZERO] * m)])[0] for i in range(n)]
        self.read_leader(file.leader, file.target)
        nodes = self.rests(file.target, offsets)
        self.name, self.notes, self.region = file.name, file.notes, file.region
        self.uncertainty, self.actuators, self.simulation = (
            file.uncertainty,
            file.actuators,
            file.simulation,
        )
        self.gains: dict[int, Matrix] = self.felt(dict(file.gains))
        h, exceptions = (
            file.coupling.h,
            {tuple(each.arc): each.h for each in file.coupling.exceptions},
        )
        known = {each: read_coupling(each, m, LONGEST_MADE) for each in (h, *exceptions.values())}
        # all different, h first; then what every agent feels of its own
        self.couplings = [*known.values(), *nodes]
        self.nodes = len(nodes)
        # theorems are about slopes at one point: there are none at a kink, nor where a leader takes
        # them along
        self.kinked = any(coupling.kinked for coupling in self.couplings) or bool(
            self.nodes and self.leader
        )
        self.domain = (
            "global" if all(coupling.straight for coupling in self.couplings) else "consensus"
        )
        self.switching = read(file.switching, maybe(an_object))
        self.modes = {
            mode.name: [
                Arc(i, j, w, known[exceptions.get((i, j), h)], loose)
                for loose, arcs in ((False, mode.arcs), (True, mode.optional or []))
                for i, j, w in arcs
            ]
            for mode in file.modes
        }
        need(0 < len(file.modes) == len(self.modes), "modes have to be different, and at least one")
        self.loose = any(arc.loose for arcs in self.modes.values() for arc in arcs)
        self.switches = self.loose or len(self.modes) > 1
        self.heard: dict[str, list[list[Arc]]] = {
            mode: [[] for _ in range(n)] for mode in self.modes
        }
        for mode, arc in ((mode, arc) for mode, arcs in self.modes.items() for arc in arcs):
            self.heard[mode][arc.i].append(arc)

        self.groups = self.read_groups(file.exosystem, file.observer)
        self.place = {i: k for k, group in enumerate(self.groups) for i in group.agents}
        apart = len(self.groups) > 1 or len(self.place) < self.n
        self.names = [self.labels[group.agents[0]] if apart else None for group in self.groups]
        self.A = diagonal([group.A for group in self.groups])
        self.C = diagonal([group.C for group in self.groups]) or [[] for _ in range(m)]
        own = ([group.W for group in self.groups], [group.P for group in self.groups])
        self.W, self.P = (
            diagonal(blocks) if blocks and None not in blocks else None for blocks in own
        )
        self.q = len(self.A)

    def read_h(self, value: Any) -> tuple[str, ...]:
        """One expression, or one per component: of B h, which the states feel."""
        h = (value,) if type(value) is str else tuple(read(value, (text,) * len(self.left)))
        need(all(len(each) <= LONGEST for each in h), "an expression of a coupling is too long")
        if self.B is None:
            return h
        if len(h) == 1 and identity(self.m, b := self.B[0][0]) == self.B:
            return h if b == 1 else (f"({b})*({h[0]})",)
        if len(h) == 1 < len(self.left):
            need(len(self.left) == self.m, "there is not one expression for each input")
            h = tuple(re.sub(r"\by\b", f"y{c + 1}", h[0]) for c in range(self.m))
        rows = [[f"({b})*({each})" for b, each in zip(row, h, strict=True) if b] for row in self.B]
        return tuple(" + ".join(row) or "0" for row in rows)

    # --- dynamics: x' = A x + B (h + u + d) has the errors of integrators with B h, B K - A, B C
    # and W B+, B+ B = I
    def read_dynamics(self, value: Any) -> None:
        """A and B of the agents; B+."""
        m = self.m
        self.drift: Any = None  # A and B: matrices, where there are dynamics
        self.B: Any = None
        self.left = identity(m)
        if value is not None:
            rows = an_object(value).get("B") or [0]
            columns = len(rows[0]) if type(rows) is list and type(rows[0]) is list else 0
            need(1 <= columns <= m, "B has to have 1 to m columns")
            file = read(value, {"A?": matrix(m, m), "f?": (text,) * m, "B": matrix(m, columns)})
            need((file.A is None) is not (file.f is None), "there has to be either A or f")
            self.drift, self.f, self.B = file.A, file.f, file.B
            need(len(echelon(file.B)[0]) == columns, "B has dependent columns")
            turned = transpose(file.B)
            both = [
                [*own, *right] for own, right in zip(product(turned, file.B), turned, strict=True)
            ]
            self.left = [row[columns:] for row in echelon(both)[0]]

    def read_leader(self, value: Any, target: list[Fraction]) -> None:
        """Where a leader starts, and the box with f that it stays in; without one it stands still
        at 0."""
        self.leader, self.leads = value, [[ZERO, ZERO]] * self.m
        if value is not None:
            need(
                self.B is not None and not any(target),
                "a leader needs dynamics, and the target has to be 0",
            )
            self.leads = value.initial
            need(
                all(lo <= hi for lo, hi in self.leads),
                "a leader starts between bounds in the wrong order",
            )

    def encloses(self) -> list[Any]:
        """The box of the leader: it starts there, and on no face f points outwards, so that it
        stays (Nagumo)."""
        need(self.leader.stays_in is not None, "the leader's solution is not enclosed")
        box = [(lo, hi) for lo, hi in self.leader.stays_in]
        need(
            all(a <= lo and hi <= b for (lo, hi), (a, b) in zip(self.leads, box, strict=True)),
            "it starts outside",
        )
        for c, f in enumerate(self.flow):
            for sign, end in zip((1, -1), box[c], strict=True):
                face = [*box[:c], (end, end), *box[c + 1 :]]
                need(
                    points(f, sign, face),
                    "f is not shown to point inwards on a face of the leader's box",
                )
        return [(enclosed(lo)[0], enclosed(hi)[1]) for lo, hi in box]

    def rests(self, target: list[Fraction], offsets: Any) -> list[Coupling]:
        """Goals are equilibria for some constant input; A are the slopes of f(target + e) -
        f(target), which is there unless it is straight."""
        if self.B is None:
            return []
        found, m = [], self.m
        goals = transpose([target, *([] if self.drift is None else self.goals)])
        if self.drift is None:
            need(not any(map(any, offsets.values())), "a formation goes with A, not with f")
            names = ["y"] if m == 1 else [f"y{d + 1}" for d in range(m)]
            moved = [
                name if not x else f"({x} + {name})" for x, name in zip(target, names, strict=True)
            ]
            own = {name.replace("y", "x") for name in names}
            need(
                all(set(re.findall(r"\b[xy][0-9]*\b", each)) <= own for each in self.f),
                "f is written in x1 to xm",
            )
            need(all(len(each) <= LONGEST for each in self.f), "an expression is too long")
            f = [
                re.sub(r"\bx([0-9]*)\b", lambda x: moved[int(x[1] or 1) - 1], each)
                for each in self.f
            ]
            values = [self.at_target(each, names) for each in f]
            self.flow = [Expression(each, names, LONGEST_MADE) for each in f]
            falls = tuple(f"({each}) - ({x})" for each, x in zip(f, values, strict=True))
            whole = read_coupling(falls, m, LONGEST_MADE)
            slopes = [[whole.slope(c, d) for d in range(m)] for c in range(m)]
            need(
                not whole.kinked and all(lo == hi for row in slopes for lo, hi in row),
                "f has no exact slopes",
            )
            self.drift, goals = [[lo for lo, _ in row] for row in slopes], [[x] for x in values]
            found = [] if whole.straight else [whole]
            pulled = goals if self.leader is None else []
        else:
            pulled = product(self.drift, goals)
        held = not pulled or product(self.B, product(self.left, pulled)) == pulled
        need(held, "a goal is no equilibrium for a constant input")
        return found

    @staticmethod
    def at_target(text: str, names: list[str]) -> Fraction:
        """The exact value of an expression where its variables are 0."""
        part = Expression(text, names, LONGEST_MADE)
        value = part.run(part.steps, [((ZERO, ZERO), ()) for _ in names])[0]
        need(value[0] == value[1], "f is not rational at the target")
        return Fraction(value[0])

    def felt(self, gains: dict[int, Matrix]) -> dict[int, Matrix]:
        """What the gains do to the states; with dynamics B K - A of every agent, unless it is 0."""
        self.pinned = {i for i, k in gains.items() if any(map(any, k))}
        if self.B is None:
            return gains
        none = [[ZERO] * self.m for _ in self.left]
        each = (
            (i, plus(product(self.B, gains.get(i, none)), -1, self.drift)) for i in range(self.n)
        )
        return {i: k for i, k in each if any(map(any, k))}

    def read_limit(self, value: Any) -> dict[int, Fraction]:
        """The limits of the inputs: one for all agents, or one for some."""
        each = (
            value
            if type(value) is dict
            else {}
            if value is None
            else dict.fromkeys(self.labels, value)
        )
        need(set(each) <= set(self.labels), "there is no such agent")
        return {self.labels.index(label): rational(limit) for label, limit in each.items()}

    # --- exosystems
    def read_groups(self, exosystem: Any, observer: Any) -> list[Any]:
        """One group of all agents, or those that the file has."""
        if exosystem is None or "groups" in exosystem:
            need(
                observer.W is None and observer.P is None,
                "W and P belong to the groups, or to no exosystem",
            )
        if exosystem is None:
            return []
        if "groups" not in exosystem:
            read(exosystem, {"A": None, "C": None})
            return [
                self.read_group(
                    exosystem | {"agents": list(range(self.n)), "W": observer.W, "P": observer.P}
                )
            ]

        groups = [
            self.read_group(value) for value in read(exosystem, {"groups": [an_object]}).groups
        ]
        need(
            bool(groups) and len(groups[0].agents) < self.n,
            "there is no group, or one that has all agents",
        )
        everyone = [i for group in groups for i in group.agents]
        need(len(set(everyone)) == len(everyone), "an agent is in two groups")
        need(
            all(a.agents[0] < b.agents[0] for a, b in pairwise(groups)),
            "the groups are not in the order of agents",
        )
        need(
            len({group.P is None for group in groups}) == 1,
            "some groups have a P and some have none",
        )
        return groups

    def read_group(self, value: Any) -> Any:
        """The agents of one exosystem, and its A, C, W and P."""
        rows, p, wide = value.get("A"), len(self.left), value.get("W")
        q = len(rows) if type(rows) is list else 0
        need(q > 0, "an exosystem has no state")
        of_states = type(wide) is list and wide and type(wide[0]) is list and len(wide[0]) == self.m
        gain, P = maybe(matrix(q, self.m if of_states else p)), maybe(matrix(q, q))
        shape = {
            "agents": [partial(index, self.n)],
            "A": matrix(q, q),
            "C": matrix(p, q),
            "W": gain,
            "P": P,
        }
        group = read(value, shape)
        if self.B is not None:
            W = group.W if of_states or group.W is None else product(group.W, self.left)
            group = SimpleNamespace(**vars(group) | {"C": product(self.B, group.C), "W": W})
        need(
            bool(group.agents) and group.agents == sorted(set(group.agents)),
            "the agents of a group are not in order",
        )
        need(group.P is None or group.W is not None, "there is a P without a W")
        return group

    def block(self, S: Matrix, i: int) -> Matrix:
        """The block of S = C X C' that belongs to the group of agent i; 0 without a disturbance."""
        if self.groups and i not in self.place:
            return identity(self.m, 0)
        k = self.place.get(i, 0) * self.m
        return [row[k : k + self.m] for row in S[k : k + self.m]]

    # --- gains
    def least_gain(self, i: int, error: Fraction = ZERO) -> Fraction:
        """The least of k_cc - sum over d != c of |k_cd|, 0 without a pin; for all relative errors
        of the entries."""
        k, sides = self.gains.get(i, []), (1 - error, 1 + error)
        rows = ((row[c], sum(map(abs, row[:c] + row[c + 1 :]))) for c, row in enumerate(k))
        return min((sides[0] * own - sides[1] * others for own, others in rows), default=ZERO)

    def largest_gain(self, i: int) -> Fraction:
        """The largest k_cc, 0 without a pin."""
        return max((row[c] for c, row in enumerate(self.gains.get(i, []))), default=ZERO)

    def gain_matrix(self) -> Matrix:
        """K of all agents."""
        return diagonal([self.gains.get(i, [[ZERO] * self.m] * self.m) for i in range(self.n)])

    # --- Lambda = J + J' - (K + K'), where J - K is the linearization at the target
    def terms(self, mode: str) -> Iterator[tuple[int, int, int, Exact]]:
        """(a, b, c, G): row a of J - K has +G in column b and -G in column c, the agent's own. A
        gain is an arc from the target, where the error is 0: it has the column n m, which is
        dropped in the end."""
        m = self.m
        for i, j, w, coupling, loose in self.modes[mode]:
            for (c, d), slope in coupling.slopes.items():
                yield i * m + c, j * m + d, i * m + d, times(slope, (ZERO if loose else w, w))
        for i, k in self.gains.items():
            yield from (
                (i * m + c, self.n * m, i * m + d, (k[c][d], k[c][d]))
                for c in range(m)
                for d in range(m)
            )

    @cached_property
    def bounds(self) -> dict[str, Rows]:
        """In every mode a rational U with Lambda <= U for every slope in its enclosure: one that is
        off by r moves v'Lambda v by at most 2 r |v_a| |v_b - v_c| <= r (2 v_a^2 + v_b^2 +
        v_c^2)."""
        size, found = self.n * self.m, dict[str, Rows]()
        for mode in self.modes:
            rows: Rows = [{i: ZERO} for i in range(size + 1)]
            for a, b, c, (lo, hi) in self.terms(mode):
                x, r = (lo + hi) / 2, (hi - lo) / 2
                wide = ((a, a, 2 * r), (b, b, r), (c, c, r)) if r else ()
                for i, j, y in ((a, b, x), (b, a, x), (a, c, -x), (c, a, -x), *wide):
                    rows[i][j] = rows[i].get(j, ZERO) + y
            found[mode] = [{j: x for j, x in row.items() if j < size} for row in rows[:-1]]
        return found

    def low(self, mode: str, v: list[Fraction]) -> Fraction:
        """A lower bound of v'Lambda v, exact where the slopes that take part are; v ends with a
        0."""
        weights = ((2 * v[a] * (v[b] - v[c]), slope) for a, b, c, slope in self.terms(mode))
        return sum((weight * (lo if weight > 0 else hi) for weight, (lo, hi) in weights), ZERO)

    def jacobian(self, mode: str) -> Matrix:
        """J - K, if every slope is exact."""
        size = self.n * self.m
        need(size <= ROOTS_SIZE, f"unstable roots are counted up to size {ROOTS_SIZE} only")
        X = [[ZERO] * (size + 1) for _ in range(size)]
        for a, b, c, (lo, hi) in self.terms(mode):
            need(lo == hi, "unstable roots are counted for exact slopes only")
            X[a][b] += lo
            X[a][c] -= lo
        return [row[:-1] for row in X]

    def is_symmetric(self, mode: str) -> bool:
        """Whether J - K is known exactly, and symmetric."""
        X: dict[tuple[int, int], Fraction] = {}
        for a, b, c, (lo, hi) in self.terms(mode):
            if lo != hi:
                return False
            X[a, b] = X.get((a, b), ZERO) + lo
            X[a, c] = X.get((a, c), ZERO) - lo
        size = self.n * self.m  # the node that nobody is, which gains and pins name, comes last
        return all(x == X.get((b, a), ZERO) for (a, b), x in X.items() if max(a, b) < size)

    # --- who hears whom
    def edges(self, modes: Iterable[str], hears: bool, loose: bool = False) -> list[list[int]]:
        """Whom every agent listens to, or who listens to it, by arcs that are always there, or by
        all (``loose``)."""
        found: list[list[int]] = [[] for _ in self.labels]
        for arc in (arc for mode in modes for arc in self.modes[mode] if loose or not arc.loose):
            found[arc.i if hears else arc.j].append(arc.j if hears else arc.i)
        return found

    def escapes(self, modes: Collection[str], loose: bool) -> bool:
        """A closed set of agents (they listen to nobody outside; ``loose``: not even by arcs that
        come and go) can stay away from the target in these modes, inside the region. The smallest
        closed set around an agent has the fewest gains; a nonsingular gain in it holds it."""
        if self.nodes:  # curved ones may pull where neither gains nor their slopes do
            return False
        nonsingular = [i for i, k in self.gains.items() if len(echelon(k)[0]) == self.m]
        hears, held = (
            self.edges(modes, True, loose),
            reach(nonsingular, self.edges(modes, False, loose)),
        )
        return any(self.leaves_free(reach([i], hears)) for i in range(self.n) if i not in held)

    def drifts(self) -> bool:
        """A closed set of agents without a pin, whose common error follows e' = A e, does not come
        to rest."""
        if self.drift is None or self.nodes or stable(self.drift):
            return False
        return len(reach(self.pinned, self.edges(self.modes, False, True))) < self.n

    def leaves_free(self, group: set[int]) -> bool:
        """No gain of the group acts on some shift c other than 0, and the region holds such a
        shift."""
        rows, pivots = echelon([row for i in group for row in self.gains.get(i, [])])
        if self.region is None or len(pivots) == self.m:
            return bool(len(pivots) < self.m)

        sides = zip(
            self.region.initial_states, self.leads, *(self.goals[i] for i in group), strict=True
        )
        rooms = [(lo - min(goals), hi - max(goals), *leads) for (lo, hi), leads, *goals in sides]
        box: list[Exact] = [(lo - last, hi - first) for lo, hi, first, last in rooms]
        boxes: list[Any] = [box]
        # then size does not matter: some entry may be 1 or -1
        if all(lo <= 0 <= hi for lo, hi in box):
            cone = [(lo and -math.inf, hi and math.inf) for lo, hi in box]
            ones = (
                (k, Fraction(x))
                for k, (lo, hi) in enumerate(cone)
                for x in (-1, 1)
                if lo <= x <= hi
            )
            boxes = [[*cone[:k], (x, x), *cone[k + 1 :]] for k, x in ones]
        return all(lo <= hi for lo, hi, *_ in rooms) and any(
            meets(rows, pivots, each) for each in boxes
        )


def points(f: Expression, sign: int, face: list[Exact], pieces: int = 4096) -> bool:
    """sign f >= 0 on a face, shown on its parts; exactly, since f may be 0 there."""
    parts = [face]
    while parts and pieces:
        part, pieces = parts.pop(), pieces - 1
        with suppress(Refused):  # it may be defined on the halves
            value = f.at(*((side, ()) for side in part))[0]
            if (value[0] if sign > 0 else -value[1]) >= 0:
                continue
        lo, hi = side = max(part, key=lambda each: each[1] - each[0])
        if lo == hi:  # a single point has no halves
            return False
        k, middle = part.index(side), (lo + hi) / 2
        parts += [[*part[:k], half, *part[k + 1 :]] for half in ((lo, middle), (middle, hi))]
    return not parts


def reach(starts: Collection[int], edges: list[list[int]]) -> set[int]:
    """Everybody who is reached along the edges."""
    found, stack = set(starts), list(starts)
    while stack:
        fresh = set(edges[stack.pop()]) - found
        found |= fresh
        stack += fresh
    return found


# --- certificate.json
# -------------------------------------------------------------------------------------------------
def at_least_one(value: Any) -> Fraction:
    """A factor."""
    factor = json_number(value)
    need(1 <= factor <= 10**300, "a factor is less than 1, or far too large")
    return factor


STARTS = {"kind": text, "radius": maybe(json_number), "disturbance": maybe(json_number)}
CHECK = dict.fromkeys(("id", "verdict", "reason", "mode?", "group?"), text) | {
    "domain": lambda value: value if type(value) is str else read(value, STARTS),
    "margin": maybe(json_number),
    "rate": maybe(json_number),
    "factor?": maybe(at_least_one),
    "exact?": an_object,
    "witness?": an_object,
    "fix?": {"kind": text, "set": an_object, "text": text},
}


class Certificate:
    """The claims of one certificate about one problem."""

    def __init__(self, data: bytes, problem: Problem) -> None:
        self.problem = problem
        gain, P = maybe(matrix(problem.q, len(problem.C))), maybe(matrix(problem.q, problem.q))
        shape = dict.fromkeys(
            ("format", "problem", "problem_sha256", "verdict", "reason"), text
        ) | {
            "version": None,
            "program": {"name": text, "version": text, "options?": [text]},
            "rate": maybe(json_number),
            "factor?": maybe(at_least_one),
            "covered_by": maybe(text),
            "observer": {"W": gain, "source": maybe(text), "P": P, "Q": gain},
            "checks": [CHECK],
            "notes": [text],
        }
        self.claims = read(document(data, "dobc-certificate"), shape)
        self.checks, self.W, self.P = (
            self.claims.checks,
            self.claims.observer.W,
            self.claims.observer.P,
        )
        for X in ([] if problem.W else self.W, self.P):
            short((x for row in X or [] for x in row), MATRIX_BITS)
        self.theorem = "theorem2" if problem.switches else "theorem1"
        # of the modes, once they are known (consensus.room)
        self.rooms: dict[str, Fraction | None] = {}
