"""Lambda < 0 for an enclosed matrix: proved, refuted by a vector, or undecided; and what the graph
alone decides.

The matrix is known up to its irrational slopes (``exact.pencil.Deviation``).  If a set S of agents
listens to nobody outside S and holds no pin, consensus fails, and v' Lambda v = 0 for the indicator
v of S (theory, section 2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np

from dobc_design._checks import noun
from dobc_design.conditions.check import Check, Witness
from dobc_design.conditions.domain import EVERYWHERE
from dobc_design.conditions.numbers import shorten
from dobc_design.exact.definite import decide_positive_definite
from dobc_design.exact.interval import Interval
from dobc_design.exact.matrix import Array, Matrix, Vector, identity, nullspace
from dobc_design.exact.number import ZERO, float_above
from dobc_design.exact.pencil import Deviation
from dobc_design.exact.reading import Texts
from dobc_design.exact.symmetric import (
    Entries,
    IntegerSymmetric,
    SparseSymmetric,
    Symmetric,
    in_integers,
)
from dobc_design.exact.zmatrix import row_bound
from dobc_design.loop.arcs import closed_groups, unreached
from dobc_design.loop.loop import Loop
from dobc_design.problem.network import Arcs
from dobc_design.verdict import Verdict

from .claim import Deviations

TOPS = (1, 2, 3, 5, 9, 20, 99, 9999)  # the largest entry of a rounded direction
LONG = 1024  # bits of entries that are rounded first,
SHORT = 256  # and of what they are rounded to
MOST_WORK = 20_000_000  # products in an elimination of more than 2000 rows, some tens of seconds
LARGEST_SUPPORT = 300  # rows up to which a candidate's rows are eliminated
LARGEST = 500  # rows up to which the agents without a pin are eliminated
SHOWN = 8  # agents, or groups of agents, that a sentence names
MOST_GROUPS = 8  # closed groups whose directions are tried as witnesses

Directions = Sequence[Sequence[float]]


@noun(eq=False)
class Enclosed:
    """middle + a block for each agent (one for all, or those that ``owners`` says) + deviations,
    each with any |t| <= size. ``bound``: a number that is proved to be at least the largest
    eigenvalue of middle + deviations."""

    middle: Symmetric
    deviations: Sequence[Deviation] = ()
    blocks: tuple[Matrix, ...] = ()
    owners: Sequence[int] = ()
    bound: Fraction | None = None

    @property
    def total(self) -> Symmetric:
        """The middle with the blocks."""
        if not self.blocks:
            return self.middle
        m = len(self.blocks[0])
        owners = self.owners or (0,) * (self.middle.size // m)
        entries: Entries = {}
        for agent, owner in enumerate(owners):
            block = self.blocks[owner]
            for i in range(m):
                for j in range(i, m):
                    entries[agent * m + i, agent * m + j] = block[i][j]
        return self.middle + SparseSymmetric(self.middle.size, entries)

    @property
    def radius(self) -> Fraction:
        """A bound of the spectral norm of all deviations together: their largest row sum of
        absolute values."""
        # Very many are summed in floats and rounded up, unless floats do not hold the sum.
        if isinstance(self.deviations, Deviations):
            largest = _radius_in_floats(self.deviations, self.middle.size)
            if math.isfinite(largest):
                return Fraction(largest)
        sums: dict[int, Fraction] = {}
        for each in self.deviations:
            # Twice in its own row: the slope stands beside the diagonal and on it.
            for row in (each.row, each.row, each.speaker, each.listener):
                sums[row] = sums.get(row, ZERO) + each.size
        return max(sums.values(), default=ZERO)

    def value(self, vector: Sequence[Fraction]) -> Interval:
        """Enclose v'Mv: a point where no irrational slope takes part."""
        v = vector
        middle = self.total.quadratic_form(v)
        spread = ZERO
        for d in self.deviations:
            spread += 2 * d.size * abs(v[d.row] * (v[d.speaker] - v[d.listener]))
        return Interval(middle - spread, middle + spread)

    def plus_blocks(self, blocks: Sequence[Matrix], owners: Sequence[int] = ()) -> Enclosed:
        """Add the block of each agent, of its number in ``owners`` or one for all.  Raises:
        ValueError."""
        m = len(blocks[0])
        size = self.middle.size
        agents = len(owners) if owners else size // m
        if agents * m != size or (len(blocks) > 1 and not owners):
            raise ValueError(f"{agents} blocks of {m} rows do not make {size} rows")
        return replace(self, blocks=tuple(blocks), owners=owners)


def _radius_in_floats(deviations: Deviations, size: int) -> float:
    """The largest row sum, rounded up; infinite or nan where floats do not hold it."""
    sizes = np.array([float_above(x) for x in deviations.sizes])[deviations.kinds]
    row_sums = np.zeros(size)
    counts = np.zeros(size)
    for rows in (deviations.rows, deviations.rows, deviations.speakers, deviations.listeners):
        row_sums += np.bincount(rows, sizes, size)
        counts += np.bincount(rows, minlength=size)
    # Every addition may have lost half a unit in the last place.
    return float(np.max(row_sums * (1 + (counts + 8) * 2.0**-52)))


def shown_bound(matrix: Enclosed, vector: Array) -> Fraction | None:
    """A number that v > 0 (rows,) proves to be at least the largest eigenvalue of all but the
    blocks; None if none."""
    middle = matrix.middle
    # Row sums of integers are exact.
    integers = middle if isinstance(middle, IntegerSymmetric) else in_integers(middle)
    if integers is None:
        return None
    bound = row_bound(integers, vector)
    if not math.isfinite(bound):
        return None
    return Fraction(bound) + matrix.radius


def is_negative(matrix: Enclosed, *, shift: Fraction = ZERO) -> bool:
    """Whether matrix + shift I < 0 is proved for everything enclosed; a matrix with a ``bound`` is
    decided by it."""
    if matrix.bound is not None:
        # The largest eigenvalue of a sum is at most the sum of the largest: every block has to
        # fit into what the bound leaves.
        room = -matrix.bound - shift
        nothing = ((ZERO,),)
        for block in matrix.blocks or (nothing,):
            upper = SparseSymmetric.from_dense(block).negated().shifted(room)
            if not decide_positive_definite(upper).is_proved:
                return False
        return True
    whole = matrix.total.shifted(matrix.radius + shift).negated()
    # Elimination multiplies digits: a matrix of short entries below it is tried first.
    tried: list[Symmetric] = [whole]
    if not isinstance(whole, IntegerSymmetric):
        short = _shorter(whole)
        if short is not None:
            tried.insert(0, short)
    return any(decide_positive_definite(each, most_work=MOST_WORK).is_proved for each in tried)


def _shorter(matrix: SparseSymmetric) -> SparseSymmetric | None:
    """A matrix below it (in the sense of <=) with short entries, where they are long, because
    elimination multiplies digits; else None.  Rounding to multiples of u changes the matrix by at
    most u/2 times its longest row."""
    values = matrix.entries.values()
    sizes = [max(x.numerator.bit_length(), x.denominator.bit_length()) for x in values]
    if max(sizes, default=0) <= LONG:
        return None
    lengths: dict[int, int] = {}
    for i, j in matrix.entries:
        for row in {i, j}:
            lengths[row] = lengths.get(row, 0) + 1
    largest = max(abs(x) for x in values)
    exponent = largest.numerator.bit_length() - largest.denominator.bit_length()
    unit = Fraction(2) ** (exponent - SHORT)
    rounded = {place: round(x / unit) * unit for place, x in matrix.entries.items()}
    return SparseSymmetric(matrix.size, rounded).shifted(-unit / 2 * max(lengths.values()))


def why_undecided(loop: Loop, matrix: Enclosed) -> str:
    """What to say where neither M < 0 nor a witness against it was found."""
    if loop.loose is not None:
        return (
            "is not shown to be < 0 where the gain of every optional arc is any number from 0 "
            "to w h'(0)."
        )
    if matrix.deviations:
        return (
            "is too close to 0 for the enclosures of the irrational slopes of h; change a gain "
            "a little."
        )
    return (
        f"is not known to differ from 0: with {matrix.middle.size} rows exact elimination "
        "takes too long. Change a gain a little, or use couplings that act by component with "
        "slopes >= 0, which need no elimination."
    )


def refutes(matrix: Enclosed, vector: Sequence[Fraction]) -> bool:
    """Whether v has as many entries as the matrix rows, is not 0, and v'Mv >= 0 for everything
    enclosed."""
    return len(vector) == matrix.middle.size and any(vector) and matrix.value(vector).lo >= 0


def lowest_quotient(matrix: Enclosed, vector: Sequence[Fraction]) -> Fraction:
    """A lower bound of v'Mv / v'v, hence of lambda_max, for everything enclosed.  v is not 0."""
    return matrix.value(vector).lo / sum((x * x for x in vector), ZERO)


def refuted_margin(matrix: Enclosed, vector: Sequence[Fraction]) -> float:
    """Minus the lowest quotient, rounded towards 0: lambda_max is at least minus this number.  At
    most 0."""
    return 0.0 - shorten(lowest_quotient(matrix, vector))


def find_witness(
    matrix: Enclosed, candidates: Iterable[Sequence[float]], *, rows: Sequence[int] | None = None
) -> Vector | None:
    """A rational v != 0 with v'Mv >= 0 proved, or None if M < 0 (or the deviations hide the answer,
    or M is too large). ``candidates`` come first, those with few entries before others, rounded to
    small integers, because they read better; last comes the elimination of ``rows`` (None: all),
    which none may leave."""
    size = matrix.middle.size
    rows = range(size) if rows is None else rows
    allowed = set(rows)
    supports = [([row for row, x in enumerate(each) if x], each) for each in candidates]
    for support, candidate in sorted(supports, key=lambda pair: len(pair[0])):
        if not support or len(candidate) != size or not allowed >= set(support):
            continue
        for vector in rounded(candidate):
            if refutes(matrix, vector):
                return vector
        # No rounding of it does: the same agents in exact proportions may.
        if len(support) < size and len(support) <= LARGEST_SUPPORT:
            found = _eliminated(matrix, support)
            if found is not None:
                return found
    return _eliminated(matrix, rows)


def _eliminated(matrix: Enclosed, rows: Sequence[int]) -> Vector | None:
    """The elimination's own witness on these rows, zero elsewhere: v'(middle)v >= radius v'v."""
    size = matrix.middle.size
    shifted = matrix.total.shifted(-matrix.radius).negated()
    if len(rows) == size:
        return decide_positive_definite(shifted, most_work=MOST_WORK).witness
    found = decide_positive_definite(shifted.restricted(rows), most_work=MOST_WORK).witness
    if found is None:
        return None
    values = dict(zip(rows, found, strict=True))
    return tuple(values.get(row, ZERO) for row in range(size))


def rounded(candidate: Sequence[float], *, finest: Sequence[int] = ()) -> Iterable[Vector]:
    """A direction in small integers, the coarsest first; 0 is left out.  ``finest``: further
    largest entries."""
    largest = max(map(abs, candidate), default=0.0)
    if 0 < largest < math.inf:
        for top in (*TOPS, *finest):
            vector = tuple(Fraction(round(x / largest * top)) for x in candidate)
            if any(vector):
                yield vector


def reachability_check(loop: Loop, mode: str) -> Check:
    """Decide for one mode whether every agent is reached from a pinned one."""
    check = partial(Check, id="reachability", mode=mode, domain=EVERYWHERE)
    arcs = [loop.modes[mode]]
    labels = tuple(loop.named(unreached(loop, arcs, pins=loop.pins)))
    if loop.agrees:
        return _roots_check(loop, mode, labels)
    if not labels:
        reason = f"every agent is reached from {source_in_words(loop)}."
        if loop.signed:
            reason = "every group that hears nobody outside has a pin or unbalanced signs."
        return check(verdict=Verdict.PROVED, reason=reason)
    reason = "there is no pinned agent"
    if loop.signed:
        reason = resting_words(labels)
    elif loop.fixed:
        reason = f"no path of arcs leads from {source_in_words(loop)} to {name_agents(labels)}"
    elif loop.pins.nodes:
        reason = f"no pinned agent reaches {name_agents(labels)}"
        if arcs[0].optional:
            reason += " by arcs that are always there"
    if loop.drift is not None:
        reason += ", so that agents there have only their own dynamics"
    reason += f". {cure_in_words(loop, arcs)}"
    return check(
        verdict=Verdict.REFUTED, reason=reason, witness=Witness(kind="agents", labels=labels)
    )


def _roots_check(loop: Loop, mode: str, labels: Texts) -> Check:
    """Decide for one mode whether an agent is heard by all others, directly or through others."""
    check = partial(Check, id="reachability", mode=mode, domain=EVERYWHERE)
    if not labels:
        return check(
            verdict=Verdict.PROVED,
            reason="an agent is heard by all others, directly or through others.",
        )
    return check(
        verdict=Verdict.REFUTED,
        reason=apart_in_words(loop, [loop.modes[mode]]),
        witness=Witness(kind="agents", labels=labels),
    )


def resting_words(labels: Sequence[str]) -> str:
    """Why agents whose signs balance need not go to 0."""
    return (
        f"no pinned agent is heard by {name_agents(labels)}, directly or through others, and their "
        "signs balance: they can rest at c on one side and at -c on the other"
    )


def apart_in_words(loop: Loop, arcs: Sequence[Arcs]) -> str:
    """Two groups that hear nobody outside of themselves, and an arc that joins them."""
    first, second = closed_groups(loop, arcs)[:2]
    one, other = loop.labels[first[0]], loop.labels[second[0]]
    here, there = (name_agents(list(loop.named(group))) for group in (first, second))
    return (
        f"nobody outside of their group is heard by {here}, nor by {there}, so that each group "
        f"keeps its own value. Let agent {other} listen to agent {one}, or the other way round."
    )


def unheld_groups(
    loop: Loop, arcs: Iterable[Arcs]
) -> Iterator[tuple[tuple[int, ...], tuple[Vector, ...]]]:
    """Smallest sets S of agents that listen to nobody outside, in ``arcs``, with directions c != 0,
    k_i c = 0 on S: then e_S = c, eps = 0 is an equilibrium.  With scalar gains: S has no pin, c is
    any."""
    known = loop.pulls.gains
    for group in closed_groups(loop, arcs):
        rows = tuple(row for i in group if i in known for row in known[i])
        free = nullspace(rows) if rows else identity(loop.m)
        if free:
            yield group, free


def source_in_words(loop: Loop) -> str:
    """From what agents have to be reached."""
    if not loop.fixed:
        return "a pinned agent"
    return "a fixed node" if loop.gap else "the target"


def cure_in_words(loop: Loop, arcs: Sequence[Arcs]) -> str:
    """Which agents have to be pinned, or listen to a fixed node, so that everybody is reached: one
    of each closed group without a pin."""
    pinned = set(loop.pins.nodes)
    groups = [group for group in closed_groups(loop, arcs) if not pinned & set(group)]
    named = []
    for group in groups[:SHOWN]:
        agents = " or ".join(loop.labels[i] for i in group[:3])
        if len(group) > 3:
            agents += " or another of that group"
        named.append(agents)
    text = f"Pin agent {', and agent '.join(named)}"
    if loop.gap:
        text = f"Let agent {', and agent '.join(named)} listen to a fixed node"
    if len(groups) > SHOWN:
        text += f", and one of each of {len(groups) - SHOWN} more groups"
    return text + "."


def name_agents(labels: Sequence[str]) -> str:
    """Agents in words: "agent 4", "agents 4, 5 and 6", long lists cut."""
    if len(labels) == 1:
        return f"agent {labels[0]}"
    if len(labels) > SHOWN:
        return f"agents {', '.join(labels[:SHOWN])} and {len(labels) - SHOWN} more"
    return f"agents {', '.join(labels[:-1])} and {labels[-1]}"


def group_directions(loop: Loop, arcs: Arcs) -> list[list[float]]:
    """For closed groups of one mode whose gains leave a direction c free, of few agents first: the
    group moved along c. The group listens to nobody outside and k_i c = 0 in it, so J e = 0 and e'K
    e = 0: the value is exactly 0.  A few are enough, some of them without pins."""
    pinned = set(loop.pulls.nodes)
    groups = sorted(unheld_groups(loop, [arcs.present]), key=lambda found: len(found[0]))
    loose = [(group, free) for group, free in groups if not pinned & set(group)]
    directions = []
    for group, free in [*groups[:MOST_GROUPS], *loose[:MOST_GROUPS]]:
        vector = np.zeros((loop.n, loop.m))
        vector[list(group)] = [float(x) for x in free[0]]
        directions.append(vector.ravel().tolist())
    return directions


def unpinned_witness(
    loop: Loop, matrices: Mapping[str, Enclosed], directions: Mapping[str, Directions]
) -> tuple[str, Vector] | None:
    """A mode and v, v' Lambda v >= 0, that moves no pinned agent: the present pins cannot do.
    None: none is found."""
    pinned = set(loop.pulls.nodes)
    rows = [row for row in range(loop.size) if row // loop.m not in pinned]
    if len(rows) > LARGEST:  # too many to eliminate: only the candidates are tried
        rows = []
    for mode, matrix in matrices.items():
        candidates = [*group_directions(loop, loop.modes[mode]), *directions.get(mode, ())]
        found = find_witness(matrix, candidates, rows=rows)
        if found is not None:
            return mode, found
    return None


def carriers(loop: Loop, vector: Sequence[Fraction]) -> Texts:
    """Labels of the agents that a direction moves."""
    m = loop.m
    return tuple(label for i, label in enumerate(loop.labels) if any(vector[i * m : (i + 1) * m]))


def refutation(loop: Loop, vector: Vector, *, alone: Sequence[int], roots: int) -> str:
    """Why Lambda < 0 fails, in words; ``alone`` are the agents that hear no pinned one in this
    mode."""
    moved = carriers(loop, vector)
    labels = tuple(loop.labels[i] for i in alone)
    # Where the vector moves only agents that hear no pin, the graph is the reason.
    if labels and set(moved) <= set(labels):
        text = _unheard(loop, labels, moved)
    else:
        text = (
            f"for the error vector shown, nonzero at {name_agents(moved)}, V = e'e does not "
            "decrease."
        )
        pinned = {loop.labels[i] for i in loop.pulls.nodes}
        if pinned and not pinned & set(moved):
            text += " No gain on the pinned agents changes that."
    if roots:
        text += (
            f" The linearisation has {roots} eigenvalue(s) with positive real part: the target "
            "is unstable."
        )
    return text


def _unheard(loop: Loop, labels: Sequence[str], moved: Sequence[str]) -> str:
    """That these agents hear no pinned one, and which of them the vector moves."""
    them = "it" if len(labels) == 1 else "them"
    moving = name_agents(moved)
    if moved == labels:
        moving = them
        if len(labels) == 1:
            moving += " alone"
    pulls = "nothing" if loop.drift is None else "no gain"
    return (
        f"no pinned agent reaches {name_agents(labels)}, so {pulls} pulls {them} to the target:"
        f" v' Lambda v >= 0 for the vector that moves {moving}."
    )
