"""The loop: what a proof about a problem is about (theory, section 14).

A Problem is what somebody wrote; a Loop is its error system, in the same form for every kind of
network.  Free nodes i have errors e_i (m components) and estimation errors eps_i:

    e_i' = sum_j w_ij h_ij(e_j - e_i) - K_i e_i + drift(e_i) + C eps_i,    eps_i' = (A - W C) eps_i

Its parts are arcs between free nodes, arcs to a fixed node whose error is 0 (pins), what a node
does by itself (drift), and the residual of the observer.  ``loop_of`` makes it of a Problem; no
proof looks at how agents, leaders or goals are stated.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import TypeVar

from dobc_design._checks import noun
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.interval import Box, Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, left_inverse
from dobc_design.exact.reading import Texts, is_scalar_matrix
from dobc_design.problem.bands import Band
from dobc_design.problem.groups import (
    Group,
    Grouped,
    Groups,
    Observer,
    are_different,
    gains_of,
)
from dobc_design.problem.network import Modes, Places
from dobc_design.problem.region import Pairs
from dobc_design.problem.uncertainty import Actuators, Uncertainty

from .guarantee import Guarantee
from .timing import Timing

Pair = tuple[Fraction, Fraction]
Made = TypeVar("Made")


@noun(eq=False)
class Pins:
    """What pulls nodes in every mode, linearly: -gains[i] e_i, (m, m) in 1/s; zero gains are left
    out."""

    gains: Mapping[int, Matrix]

    @property
    def nodes(self) -> tuple[int, ...]:
        """The nodes with a gain, rising."""
        return tuple(sorted(self.gains))

    def each(self, made: Callable[[Matrix], Made]) -> dict[int, Made]:
        """What ``made`` makes of every gain; nodes often share one matrix, which is looked at
        once."""
        known = {}
        for gain in self.gains.values():
            if id(gain) not in known:
                known[id(gain)] = made(gain)
        return {node: known[id(gain)] for node, gain in self.gains.items()}

    @property
    def is_scalar(self) -> bool:
        """Whether every gain is a multiple of the identity."""
        return all(is_scalar_matrix(gain) for gain in self.gains.values())


def pins_of(gains: Mapping[int, Matrix]) -> Pins:
    """Linear pins; gains that are 0 are no arcs."""
    # By node, whatever the order in which the file names them.
    kept = {i: gain for i, gain in sorted(gains.items()) if any(map(any, gain))}
    return Pins(gains=MappingProxyType(kept))


@noun(eq=False)
class Drift:
    """What every node does by itself: e_i' = A e_i + ..., or f(e_i) in place of A e_i.

    ``A`` (m, m) in 1/s: the slopes at e = 0.  ``place``: of f in ``functions`` of the loop, None
    where it is A e.  ``B`` (m, p): how couplings, inputs and disturbances act on the states.
    """

    A: Matrix
    B: Matrix
    place: int | None

    @property
    def inputs(self) -> int:
        """p, the number of inputs of a node."""
        return len(self.B[0])

    @property
    def left_inverse(self) -> Matrix:
        """(B'B)^-1 B', (p, m): the inputs that act as a change of the states does."""
        return left_inverse(self.B)


@noun(eq=False)
class Goals:
    """How an error is read back as a state: x_i = target + offset_i + e_i.

    ``moves``: the target is a leader, which starts anywhere in ``starts`` (m pairs); then the drift
    depends on where it is, and its slopes are those on the box ``stays_in``.  None: no box is
    known, for the reason ``unbounded``.
    """

    target: Vector
    offsets: Mapping[int, Vector]
    moves: bool
    starts: Pairs
    stays_in: Box | None
    unbounded: str

    def leaders_box(self) -> Box:
        """The box that the leader never leaves; 0 without one.  Raises: UndefinedError where none
        is known."""
        # A proof must not go on with slopes at one point: it is stopped here.
        if self.stays_in is None:
            raise UndefinedError(self.unbounded)
        return self.stays_in

    def of(self, node: int) -> Vector:
        """Where a node is to go, (m,)."""
        offset = self.offsets.get(node)
        if offset is None:
            return self.target
        return tuple(x + o for x, o in zip(self.target, offset, strict=True))

    def different(self, nodes: Iterable[int]) -> set[Vector]:
        """The goals of these nodes, each once."""
        # Without a formation n agents need not be gone through.
        if not self.offsets:
            return {self.target}
        return {self.of(node) for node in nodes}


def zero_goals(m: int) -> Goals:
    """Every node goes to 0, where errors are states."""
    zero = Fraction(0)
    return Goals(
        target=(zero,) * m,
        offsets={},
        moves=False,
        starts=((zero, zero),) * m,
        stays_in=(Interval.point(zero),) * m,
        unbounded="",
    )


@noun(eq=False)
class Starts:
    """The starts that a proof has to hold for: every component of every x_i(0) in ``states`` (m
    pairs), and |eps_i(0)| <= ``disturbance`` (None without an exosystem).  ``off``: what of the
    width of ``states`` is there only because estimates start that far off."""

    states: Pairs
    disturbance: Fraction | None
    off: Fraction = Fraction(0)

    @property
    def exact(self) -> Pairs:
        """Where nodes may start with eps_i = 0: what fails from there refutes."""
        return tuple((lo + self.off, hi - self.off) for lo, hi in self.states)


@noun(eq=False)
class Loop(Grouped):
    """The error system of a problem; frozen and exact.  Two loops are equal if they are the same.

    ``labels``: the free nodes in the user's words. ``fixed``: names of further nodes, numbered
    from n on, that hear nobody and whose error is 0. ``modes``: the arcs by mode; listeners are
    free nodes. ``functions``: of arcs, the first one unless ``exceptions`` has another place
    for (listener, speaker); the last ones may belong to the drift. ``pulls``: what is linear
    and of a node alone, pins less the slopes of the drift; it need not pull towards 0.
    ``groups``: nodes that share an exosystem and an observer, which act on the states.
    ``goal``: "target"; "agreement" where nodes have none, and no pins; "differences" where
    errors are those between such nodes (``pairs.rows_of``), "roots" where these are too many to
    have rows; "containment" where errors are the
    distances to a box in which the fixed nodes rest or move.  ``gap``: its widest side, 0 for all
    other goals; a state and what it hears may differ by that much without any error. ``starts``:
    None where no region is asked for. ``xi0``: where disturbances start in simulations, rows by
    node. ``unit``: for words and figures, the one that all components of the states share; ""
    without one. ``signed``: arcs of negative weight couple by |w| h(-e_j - e_i), which
    rows do not see: in their loop all weights are positive (``pairs.rows_of``), and ``signs`` has
    the arcs as they were.
    ``sensed``: the groups with the pairs and gains that their observers work with, where these are
    others than those of ``groups`` (``outputs``); ``estimated``: errors are those of estimates.
    ``turned``: errors are s_i e_i (``signs``). ``timing``: how late and how often nodes know what
    they use; None where they always do.
    """

    name: str
    labels: Texts
    fixed: Texts
    m: int
    modes: Modes
    functions: tuple[Coupling, ...]
    exceptions: Places
    pins: Pins
    pulls: Pins
    drift: Drift | None
    groups: Groups
    goal: str
    gap: Fraction
    goals: Goals
    starts: Starts | None
    guarantee: Guarantee
    uncertainty: Uncertainty | None
    actuators: Actuators | None
    xi0: tuple[Vector, ...] | None
    unit: str
    signed: bool = False
    signs: Modes | None = None
    turned: bool = False
    timing: Timing | None = None
    sensed: Groups = ()
    estimated: bool = False

    @property
    def n(self) -> int:
        """The number of free nodes."""
        return len(self.labels)

    @property
    def nodes(self) -> int:
        """The number of all nodes, fixed ones too."""
        return self.n + len(self.fixed)

    @property
    def size(self) -> int:
        """n m, the number of errors."""
        return self.n * self.m

    @property
    def arc_count(self) -> int:
        """How many arcs all modes have."""
        return sum(map(len, self.modes.values()))

    @property
    def q(self) -> int:
        """The states of all exosystems together."""
        return sum(group.exosystem.order for group in self.groups)

    @property
    def agrees(self) -> bool:
        """Whether nodes are to agree on a value that nobody prescribes."""
        return self.goal == "agreement"

    @property
    def has_roots(self) -> bool:
        """Whether agents that all others hear decide, as pins do elsewhere."""
        return self.goal in ("agreement", "roots")

    @property
    def is_apart(self) -> bool:
        """Whether errors are disagreements: of pairs, with one agent, or of too many agents."""
        return self.goal in ("differences", "roots")

    @property
    def is_pulled(self) -> bool:
        """Whether anything but other nodes acts on an error: a pin, a drift, or a fixed node."""
        return bool(self.pulls.nodes or self.fixed)

    @property
    def switches(self) -> bool:
        """Whether there are several modes, or arcs that come and go."""
        # What may come and go at any time switches among all graphs in between.
        return len(self.modes) > 1 or self.loose is not None

    @property
    def loose(self) -> str | None:
        """The first mode with optional arcs, None without any."""
        return next((name for name, arcs in self.modes.items() if arcs.optional), None)

    @property
    def drift_place(self) -> int | None:
        """The place in ``functions`` of what a node does by itself, where that is not linear."""
        return None if self.drift is None else self.drift.place

    @property
    def slopes_move(self) -> bool:
        """Whether the slopes of the drift change with the leader: those at one point prove nothing
        then."""
        return self.goals.moves and self.drift_place is not None

    @property
    def slopes(self) -> Matrix:
        """The A of the drift, () without one: it is in the gains of ``pulls``."""
        return () if self.drift is None else self.drift.A

    @property
    def bands(self) -> tuple[Band, ...]:
        """The bands in which sines of an unknown frequency lie; () without any."""
        return () if self.uncertainty is None else self.uncertainty.bands or ()

    @property
    def saturates(self) -> bool:
        """Whether inputs may reach their limits (``saturation``)."""
        return self.actuators is not None and bool(self.actuators.saturates)

    @property
    def is_sampled(self) -> bool:
        """Whether everything is computed from samples and held."""
        return self.timing is not None and self.timing.sampled

    @property
    def is_linear(self) -> bool:
        """Whether every function is exactly linear, so that J does not depend on e."""
        # Pins are linear near the target only, where inputs saturate.
        return not self.saturates and all(function.is_linear for function in self.functions)

    @property
    def is_grouped(self) -> bool:
        """Whether nodes differ in their exosystems."""
        return are_different(self.groups, self.n)

    @property
    def observers(self) -> Groups:
        """The groups with what their observers work with."""
        return self.sensed or self.groups

    @property
    def observer(self) -> Observer:
        """The observer of the first group."""
        return self.groups[0].observer if self.groups else Observer()

    @property
    def index(self) -> dict[str, int]:
        """Label -> node."""
        return {label: node for node, label in enumerate(self.labels)}

    def observed(self, W: Matrix) -> Iterator[tuple[Group, Matrix]]:
        """Every group with its block of the gain W (q, G m)."""
        return zip(self.groups, gains_of(self.groups, W), strict=True)

    def place_of(self, listener: int, speaker: int) -> int:
        """The place in ``functions`` of one arc."""
        return self.exceptions.get((listener, speaker), 0)

    def function_of(self, listener: int, speaker: int) -> Coupling:
        """The function of one arc."""
        return self.functions[self.place_of(listener, speaker)]

    def may_stay(self, mode: str) -> bool:
        """Whether a signal that keeps the guarantee may stay in this mode for ever."""
        return self.guarantee.may_stay(mode, tuple(self.modes))

    def named(self, nodes: Iterable[int]) -> Iterator[str]:
        """The labels of some nodes."""
        return (self.labels[node] for node in nodes)
