"""Groups of agents with an exosystem and an observer of their own (eq. 12 and 13 with A, C, W, P by
group).

Every agent is in at most one group; an agent in no group has no disturbance.  Side by side the
groups make one *joint* exosystem with block diagonal A and C.  For block diagonal W, P, Q also A -
W C, Omega0 = P A + A'P - Q C - C'Q' and S = C (-Omega0)^-1 C' are block diagonal, and the Reduction
reads Lambda + blockdiag(S of the agents) < 0.
"""

import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from dobc_design._checks import noun, put, require_square
from dobc_design._show.cards import Card, Shown, listed
from dobc_design.errors import Mistakes, SpecError, about, misshapen, refused, wrong
from dobc_design.exact.matrix import Matrix, zeros
from dobc_design.exact.number import parse_number
from dobc_design.exact.reading import (
    Names,
    Texts,
    check_shape,
    counted,
    is_list,
    named,
    read_matrix,
    shown,
    shown_number,
    some,
)

from .dynamics import Dynamics
from .exosystems import Exosystem, block_diagonal, stacked
from .network import no_agent


@noun
class Observer(Shown):
    """Observer gain W, Lyapunov matrix P, or the decay rate asked of a W that is to be designed.

    Shapes: W (q, m), P (q, q), symmetric.  Units: W and rate in 1/s.
    W absent: it is designed for ``rate``.  P may stand only beside a W; it is then tested as it is.
    P need not be positive definite: whether it is, is part of the test.
    """

    W: Matrix | None
    P: Matrix | None
    rate: Fraction | None

    def __init__(
        self,
        *,
        W: Sequence[Sequence[Any]] | None = None,
        P: Sequence[Sequence[Any]] | None = None,
        rate: Any = None,
    ) -> None:
        errors = Mistakes()
        gain = None if W is None else errors.tried(read_matrix, W, "observer.W")
        lyapunov = None if P is None else errors.tried(read_matrix, P, "observer.P")
        speed = None if rate is None else errors.tried(parse_number, rate, "observer.rate")
        # P alone would be tested for a W that nobody has seen.
        if P is not None and W is None:
            what = "must stand beside observer.W, because P is tested for that W; got P alone."
            cure = "Give W too, or leave P out: a P is then found for you."
            errors.append(wrong("observer.P", what, cure))
        elif lyapunov is not None:
            errors.tried(_check_symmetric, lyapunov)
        if speed is not None and speed <= 0:
            got = shown_number(speed)
            what = f"must be > 0 (1/s), the decay asked of the estimate; got {got}."
            errors.append(wrong("observer.rate", what, "Leave it out for the default."))
        errors.raise_all()
        put(self, W=gain, P=lyapunov, rate=speed)


def _check_symmetric(P: Matrix) -> None:
    """Refuse a P that is not square, or not symmetric.  Raises: ShapeError."""
    require_square(P, "observer.P", because="one row and column per exosystem state")
    for i, row in enumerate(P):
        for j in range(i):
            if row[j] != P[j][i]:
                here, there = shown_number(P[j][i]), shown_number(row[j])
                got = f"{here} at [{j}][{i}] and {there} at [{i}][{j}]"
                raise misshapen(
                    "observer.P",
                    f"must be symmetric, because only x'Px is used; got {got}.",
                    "Replace it by (P + P')/2.",
                )


def check_observer(observer: Observer, exosystem: Exosystem, dynamics: Dynamics | None) -> None:
    """Check the shapes of W and P against the exosystem (q states, m outputs); W may also act on
    all states of the ``dynamics``.  Where outputs are measured, W is the gain of an observer of
    states and exosystem, (m + q, r).  Raises ShapeError."""
    q = exosystem.order
    of_w = "one row per exosystem state, one column per state component"
    of_p = "one row and column per exosystem state"
    columns = exosystem.outputs
    if dynamics is not None and dynamics.H is not None:
        q += dynamics.dimension
        columns = len(dynamics.H)
        of_w = "a row per state and exosystem state, a column per measured output"
        of_p = "one row and column per state and exosystem state"
    elif dynamics is not None and observer.W is not None:
        whole = (q, dynamics.dimension)
        columns = whole[1] if (len(observer.W), len(observer.W[0])) == whole else columns
    if observer.W is not None:
        check_shape(observer.W, "observer.W", (q, columns), of_w)
    if observer.P is not None:
        check_shape(observer.P, "observer.P", (q, q), of_p)


_SHOWN = 6  # agents in a sentence


@noun
class Group(Shown):
    """Agents, by label, that have this exosystem and this observer.

    ``observer`` defaults to one that is to be designed; the rate asked of a designed W is the same
    for all groups and stands in the observer of the problem.
    Raises: SpecError for a value of another kind, or without agents.
    """

    agents: Texts
    exosystem: Exosystem
    observer: Observer

    def __init__(
        self, *, agents: Sequence[Any], exosystem: Exosystem, observer: Observer | None = None
    ) -> None:
        names = tuple(agents) if is_list(agents) else ()
        if any(isinstance(each, bool) for each in names):
            names = ()
        if not all(type(each) is str for each in names):
            names = tuple(map(str, names))
        if not names:
            raise wrong(
                "agents",
                f"must be a list of labels, at least one; got {shown(agents)}.",
                "For example agents = [1, 2].",
            )
        # A caller may give a mapping or a matrix here: say which noun is meant.
        own = Observer() if observer is None else observer
        for key, value, kind in (("exosystem", exosystem, Exosystem), ("observer", own, Observer)):
            if not isinstance(value, kind):
                raise wrong(
                    key,
                    f"of a group must be an {kind.__name__}; got {shown(value)}.",
                    f"Make one with {kind.__name__}(...).",
                )
        put(self, agents=names, exosystem=exosystem, observer=own)

    def _card(self) -> Card:
        facts = [*self.exosystem._card().facts, *self.observer._card().facts]
        return Card(title="Group", text=f"of agents {listed(self.agents)}", facts=facts)

    @property
    def name(self) -> str:
        """The label of its first agent, by which results refer to the group."""
        return self.agents[0]


Groups = tuple[Group, ...]


def read_groups(
    groups: Sequence[Group] | None,
    *,
    exosystem: Exosystem | None,
    observer: Observer | None,
    labels: Texts,
    m: int,
    dynamics: Dynamics | None,
) -> Groups:
    """Divide the agents into groups: those given, and the others, who have ``exosystem`` and
    ``observer``, or without an ``exosystem`` no disturbance.  Returns: the groups ordered by their
    first agent, agents in the order of the labels; none without a disturbance.  ``m``: how many
    components a disturbance has.
    Raises: SpecError or ShapeError naming the key."""
    # The observer of the problem serves all agents that are in no group.
    common = Observer() if observer is None else observer
    if exosystem is not None and dynamics is not None and exosystem.outputs != m:
        rows = counted(m, "row")
        raise misshapen(
            "exosystem.C",
            f"must have {rows}, one per input of [dynamics]; got {exosystem.outputs}.",
            f"Give {rows}: d = C xi acts through B.",
        )
    if not groups and exosystem is not None:
        check_observer(common, exosystem, dynamics)
        return (Group(agents=labels, exosystem=exosystem, observer=common),)
    if not groups and observer is not None:
        what = "has no meaning without an [exosystem]: there is no disturbance to estimate."
        raise refused("observer", f"[observer] {what}", "Remove it, or give the exosystem.")
    if not groups:
        return ()
    errors = Mistakes()
    owner = _owners(groups, labels, errors)
    for number, group in enumerate(groups):
        with errors:
            _check_group(group, number, m=m, dynamics=dynamics, rate=common.rate)
    # With a mistake above, "in no group" would be said of agents that are meant to be in one.
    errors.raise_all()
    rest = [label for label in labels if label not in owner]
    check_rest(rest, exosystem, common, dynamics)
    every = list(groups)
    if exosystem is not None:
        every.append(Group(agents=rest, exosystem=exosystem, observer=common))
    places = {label: place for place, label in enumerate(labels)}
    result = []
    for group in every:
        agents = sorted(group.agents, key=places.__getitem__)
        own = Observer(W=group.observer.W, P=group.observer.P, rate=common.rate)
        result.append(Group(agents=agents, exosystem=group.exosystem, observer=own))
    # In the order of their first agents, whatever the order in the file.
    result.sort(key=lambda group: places[group.agents[0]])
    _check_all_have_p(result)
    return tuple(result)


def group_key(number: int) -> str:
    """The key of a group of a problem file."""
    return f"exosystem.groups[{number}]"


def renamed(error: SpecError, key: str) -> SpecError:
    """An error about A, C, W or P of the group ``key``, which names the key as it stands in the
    file."""

    def changed(text: str) -> str:
        # The nouns know nothing of groups: their messages name [exosystem] and [observer].
        return re.sub(r"\b(?:exosystem|observer)\.([ACWP])\b", rf"{key}.\1", text)

    errors = []
    for each in error.errors:
        own = changed(each.key or key)
        errors.append(type(error)(changed(each.message), key=own, cure=each.cure))
    return SpecError.several(errors)


def _owners(groups: Sequence[Group], labels: Texts, errors: Mistakes) -> dict[str, int]:
    """The number of the group of each agent; what is wrong with them goes to ``errors``."""
    known = set(labels)
    owner: dict[str, int] = {}
    for number, group in enumerate(groups):
        for place, label in enumerate(group.agents):
            key = f"{group_key(number)}.agents[{place}]"
            if label not in known:
                errors.append(no_agent(label, key))
            elif label in owner:
                where = "this group" if owner[label] == number else group_key(owner[label])
                errors.append(in_another(label, where, key))
            owner.setdefault(label, number)
    return owner


def in_another(label: str, where: str, key: str) -> SpecError:
    """Says that an agent is in two groups."""
    return about(
        key,
        f"agent {shown(label)} is in {where} already, and an agent has one exosystem only.",
        "Keep it in one group.",
    )


def _check_group(
    group: Group, number: int, *, m: int, dynamics: Dynamics | None, rate: Fraction | None
) -> None:
    """The sizes of a group fit, and it asks for no rate of its own.  Raises: SpecError."""
    key, outputs = group_key(number), group.exosystem.outputs
    if outputs != m:
        rows = counted(m, "row")
        raise misshapen(
            f"{key}.C",
            f"must have {rows}, one per state component, as every C has; got {outputs}.",
            f"Give {rows}.",
        )
    errors = Mistakes()
    if group.observer.rate not in (None, rate):
        errors.append(
            about(
                key,
                "a group has no rate of its own; the rate asked of a designed W is observer.rate, "
                "for all.",
                "Give the rate in [observer], or W in the group.",
            )
        )
    try:
        check_observer(group.observer, group.exosystem, dynamics)
    except SpecError as error:
        errors.append(renamed(error, key))
    errors.raise_all()


def check_rest(
    rest: Names, exosystem: Exosystem | None, common: Observer, dynamics: Dynamics | None
) -> None:
    """Those in no group have [exosystem]'s own A and C, or no disturbance; of nobody nothing may be
    said."""
    # A, C, W or P that nobody uses is a slip: something is said in vain.
    why = "the agents in no group have no disturbance"
    if not rest:
        why = "every agent is in a group of exosystem.groups"
    nobody = f"apply to no agent, because {why}."
    if exosystem is not None and not rest:
        raise wrong(
            "exosystem.A", f"and exosystem.C {nobody}", "Remove A and C (or kind) from [exosystem]."
        )
    if exosystem is not None:
        check_observer(common, exosystem, dynamics)
        return
    # Their states would be known to nobody.
    if rest and dynamics is not None and dynamics.H is not None:
        what = f"must be for every agent with dynamics.H, for {name_some(rest)} too."
        cure = "Give them one; a disturbance that is none has A = [[-1]] and a C of zeros."
        raise wrong("exosystem.groups", what, cure)
    if common.W is not None or common.P is not None:
        raise wrong("observer.W", f"and observer.P {nobody}", "Give W and P in the groups.")


def _check_all_have_p(groups: Sequence[Group]) -> None:
    """P is given for every group or for none.  Raises: SpecError."""
    # Psi is tested with one P for all: it cannot be half given.
    given = [group.name for group in groups if group.observer.P is not None]
    missing = [group.name for group in groups if group.observer.P is None]
    if given and missing:
        raise refused(
            "exosystem.groups",
            f"P is given for the group of agent {shown(given[0])} and missing for that of agent "
            f"{shown(missing[0])}; Psi holds the P of all groups at once, so that they are tested "
            "together.",
            "Give P (and W) for every group, or for none: a P is then found for you.",
        )


def name_some(agents: Names) -> str:
    """Some agents in words."""
    return f"agent{'' if len(agents) == 1 else 's'} {some([*map(named, agents)], _SHOWN)}"


# --- the groups side by side


def join(matrices: Sequence[Matrix | None]) -> Matrix | None:
    """One matrix per group, block diagonal; None if one is missing."""
    known = [each for each in matrices if each is not None]
    return block_diagonal(known) if known and len(known) == len(matrices) else None


def are_different(groups: Groups, n: int) -> bool:
    """Whether n agents differ in their exosystems: those in no group have no disturbance."""
    if len(groups) == 1:
        return len(groups[0].agents) < n
    return len(groups) > 1


class Grouped:
    """What has groups: their exosystems and observers as one of each."""

    __slots__ = ()
    groups: Groups

    @property
    def joint_exosystem(self) -> Exosystem | None:
        """The exosystems of all groups side by side, A (q, q) and C (G m, q) block diagonal; of one
        group its own."""
        systems = [group.exosystem for group in self.groups]
        if len(systems) < 2:
            return systems[0] if systems else None
        return stacked(*systems)

    @property
    def joint_observer(self) -> Observer:
        """W (q, G m) and P (q, q) of all groups, block diagonal, None where not every group has
        one; of one group its own."""
        own = [group.observer for group in self.groups]
        if len(own) < 2:
            return own[0] if own else Observer()
        W, P = join([each.W for each in own]), join([each.P for each in own])
        return Observer(W=W, P=P, rate=own[0].rate)


def blocks_of(matrix: Matrix, shapes: Sequence[tuple[int, int]]) -> tuple[Matrix, ...] | None:
    """The blocks of these shapes of a block diagonal matrix; None if it is not block diagonal in
    them."""
    blocks = []
    row = 0
    column = 0
    for rows, columns in shapes:
        band = matrix[row : row + rows]
        blocks.append(tuple(tuple(each[column : column + columns]) for each in band))
        row += rows
        column += columns
    # Whatever stands outside of the blocks is 0, or it is another matrix.
    if block_diagonal(blocks) != tuple(map(tuple, matrix)):
        return None
    return tuple(blocks)


def gains_of(groups: Groups, W: Matrix) -> tuple[Matrix, ...]:
    """The gain of each group, W (q, G m) being block diagonal.  Raises: SpecError for a W that is
    not."""
    orders = [group.exosystem.order for group in groups]
    m = groups[0].exosystem.outputs if groups else 0
    found = blocks_of(W, [(order, m) for order in orders])
    if found is None:
        raise wrong(
            "gain",
            "must be block diagonal, with one block per group of agents, because no agent feels "
            "the disturbance of another group.",
            "Set the entries outside of the blocks to 0.",
        )
    return found


def group_numbers(groups: Groups, labels: Names) -> list[int]:
    """For each agent the number of its group; ``len(groups)`` for an agent without a
    disturbance."""
    number = {label: place for place, group in enumerate(groups) for label in group.agents}
    return [number.get(label, len(groups)) for label in labels]


def agent_blocks(S: Matrix, groups: Groups, labels: Names) -> list[Matrix]:
    """For each agent the block (m, m) of its group, 0 without a disturbance: S (G m, G m), or (m,
    m) for one group or none."""
    # S of a single group is the block of everybody, also where it leaves agents out.
    blocks = group_blocks(S, max(1, len(groups)))
    m = len(blocks[0])
    with_nothing = (*blocks, zeros(m, m))
    return [with_nothing[number] for number in group_numbers(groups, labels)]


def group_blocks(S: Matrix, groups: int) -> tuple[Matrix, ...]:
    """The block of each group: S (G m, G m) -> G matrices (m, m)."""
    m = len(S) // groups
    blocks = []
    for first in range(0, groups * m, m):
        blocks.append(tuple(tuple(row[first : first + m]) for row in S[first : first + m]))
    return tuple(blocks)
