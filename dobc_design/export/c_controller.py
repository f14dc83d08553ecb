"""What goes into the C code of an agent: the exactly discretised observer, rounded, and every
agent's own numbers.

Paper: (13), (19), sampled as in ``simulation.sampled``.  Ad = exp(A T), Cd = C (1/T) int_0^T exp(A
s) ds and L = int_0^T exp((A - W C) s) ds W are enclosed by Arb and rounded once; the rounded
numbers are what is proved about: all eigenvalues of Ad - L Cd in the open unit disk, and those of I
+ T (J - K) of every mode at the consensus, which is local and about staying in one mode.  The error
of an observer of agents with [dynamics] obeys the same, with Cd as ``simulation.sampled`` has it,
with f up to what changes of f(x) - A x in a period; their sampled network is decided without a
disturbance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

from dobc_design.certificate.claims import Claims, certified_period
from dobc_design.conditions.consensus.claim import (
    ModeJacobian,
    jacobians_at_consensus,
    linearisation,
)
from dobc_design.conditions.numbers import bisected, rounded_down
from dobc_design.conditions.statement import Statement, undecided
from dobc_design.errors import SpecError
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import IntervalMatrix, UndefinedError, discretise
from dobc_design.exact.matrix import (
    Matrix,
    add,
    identity,
    inverse,
    matrix,
    multiply,
    scale,
    shape,
    subtract,
    transpose,
)
from dobc_design.exact.number import number_text, parse_number
from dobc_design.exact.polynomial import characteristic_polynomial, decide_images, disk_image
from dobc_design.exact.reading import named, shown
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.export.c_text import PRECISIONS, rounded
from dobc_design.problem.arrays import Gain, chosen_gain
from dobc_design.problem.exosystems import Exosystem, block_diagonal
from dobc_design.problem.groups import gains_of, group_numbers
from dobc_design.problem.integrators import as_integrators, slopes_of_nodes
from dobc_design.problem.network import one_form
from dobc_design.problem.problem import Problem
from dobc_design.simulation.sampled import check_sampled_gain
from dobc_design.verdict import Verdict


def certified_sampling(problem: Problem, claims: Claims, period: Fraction) -> Statement:
    """State whether ``period`` (s) is within the one that the certificate proves: PROVED, or
    UNDECIDED."""
    longest = certified_period(problem, claims)
    if longest is None:
        return undecided("certified-sampling", "the certificate has no proved check `sampling`.")
    domain = next(check.domain for check in claims.checks if check.id == "sampling")
    where = ", from every start" if domain == "global" else ""
    if isinstance(domain, dict) and "radius" in domain:
        rest = f" and |eps_i| <= {domain['disturbance']:g}" if domain.get("disturbance") else ""
        where = f", from every start with |e|_inf <= {domain['radius']:g}{rest}"
    verdict, limit = Verdict.PROVED, f"{float(longest):.4g} s{where}"
    text = (
        "the certificate's check `sampling` covers this period: couplings and pinning may be "
        "held for"
    )
    text += f" {limit} (observer and estimate: those of (13), in continuous time)."
    if period > longest:
        verdict, text = (
            Verdict.UNDECIDED,
            f"the certificate's check `sampling` proves periods up to {limit};",
        )
        text += f" {float(period):.4g} s is longer."
    return Statement(
        kind="certified-sampling",
        verdict=verdict,
        text=text,
        exact={"period": number_text(longest)},
    )


MOST_ROWS = 40  # n m up to which a sampled network is decided by its characteristic polynomial
MOST_SYMMETRIC = 200  # n m up to which a symmetric one is, by definiteness
_TRIED = 32  # fractions of a period that is too long
_HALVINGS = 40
_BISECTIONS = 10


def sampled_observer_statement(Ad: Matrix, Cd: Matrix, L: Matrix, *, period: Fraction) -> Statement:
    """State whether the error of the sampled observer, eps_(k+1) = (Ad - L Cd) eps_k, dies out:
    exact.  Shapes: Ad (q, q), Cd (m, q), L (q, m), the numbers as they stand in the code.
    ``period`` in s, for the text."""
    verdict = _in_unit_disk(subtract(Ad, multiply(L, Cd)))
    words = {
        Verdict.PROVED: "with the numbers as written, every eigenvalue of "
        "the sampled observer is inside "
        "the unit disk",
        Verdict.REFUTED: "the sampled observer diverges: an eigenvalue is outside the unit disk",
        Verdict.UNDECIDED: "the error of the sampled observer does not die "
        "out: an eigenvalue is on the unit "
        "circle",
    }[verdict]
    text = f"{words} (period {float(period):.4g} s)."
    return Statement(
        kind="sampled", verdict=verdict, text=text, exact={"period": number_text(period)}
    )


def sampled_network_statement(problem: Problem, period: Fraction, *written: Matrix) -> Statement:
    """State whether e_(k+1) = (I + T (J - K)) e_k dies out in every mode: exact, at the consensus.
    UNDECIDED for n m > 40 (200 where J - K is symmetric), for slopes that are not rational, and
    where an agent that nothing pins keeps its error.  ``written``: motion and push, with which
    agents with [dynamics] move near it (no disturbance)."""
    answer = partial(Statement, kind="sampled-network", exact={"period": number_text(period)})
    if problem.n * problem.m > MOST_SYMMETRIC:
        text = f"the sampled network is not decided for more than {MOST_SYMMETRIC} rows."
        return answer(verdict=Verdict.UNDECIDED, text=text)
    try:
        modes = jacobians_at_consensus(as_integrators(problem)).modes
    except UndefinedError:
        return answer(
            verdict=Verdict.UNDECIDED, text="the coupling has no derivative at the consensus."
        )
    which = "its matrix (with the numbers as written)" if written else "I + T (J - K)"
    found = {
        mode.name: _mode_verdict(as_integrators(problem), mode, period, written) for mode in modes
    }
    bad, unknown = (
        [n for n, each in found.items() if each is v] for v in (Verdict.REFUTED, Verdict.UNDECIDED)
    )
    if bad:
        text = (
            f"held over {float(period):.4g} s, couplings and pinning drive the agents apart in "
            f'mode "{bad[0]}": an'
        )
        return answer(
            verdict=Verdict.REFUTED,
            text=f"{text} eigenvalue of {which} lies outside the unit disk.",
        )
    if unknown:
        text = (
            f'in mode "{unknown[0]}" it stays open whether the sampled network converges at '
            "the consensus: an agent"
        )
        text += (
            " that nothing reaches keeps its error, a slope is not rational, or there are more than"
        )
        return answer(verdict=Verdict.UNDECIDED, text=f"{text} {MOST_ROWS} rows.")
    text = (
        f"{'without a disturbance ' * bool(written)}in every mode the sampled network "
        "converges near the consensus: all"
    )
    text += f" eigenvalues of {which} lie inside the unit disk (period {float(period):.4g} s)."
    return answer(verdict=Verdict.PROVED, text=text)


def longest_period(works: Callable[[Fraction], bool], asked: Fraction) -> Fraction | None:
    """The longest period below ``asked`` that works, of those tried, three digits, rounded down;
    None if none does. ``works`` need not be monotone: fractions of ``asked`` are tried from the
    top, then the gap above is halved."""
    trials = [asked * k / _TRIED for k in range(_TRIED - 1, 0, -1)]
    trials += [asked / _TRIED / 2**k for k in range(1, _HALVINGS)]
    above = asked
    for trial in trials:
        if works(trial):
            break
        above = trial
    else:
        return None
    low = bisected(works, trial, above, steps=_BISECTIONS)[0]
    short = rounded_down(low, digits=3)
    return short if works(short) else low


def _mode_verdict(
    problem: Problem, mode: ModeJacobian, period: Fraction, written: Sequence[Matrix]
) -> Verdict:
    size, origin = problem.n * problem.m, problem.origin
    if not mode.is_point or (written and size > MOST_ROWS):
        return Verdict.UNDECIDED
    loop, rows = linearisation(mode, problem.pinning, problem.m), range(size)
    F = tuple(tuple((i == j) + period * loop.get((i, j), Fraction(0)) for j in rows) for i in rows)
    if written and origin is not None and origin.dynamics is not None:
        # loop = I (x) A + (I (x) B) X
        A, left = slopes_of_nodes(problem), origin.dynamics.left_inverse
        X = subtract(
            scale(1 / period, subtract(F, identity(size))), block_diagonal([A] * problem.n)
        )
        held = multiply(block_diagonal([multiply(written[1], left)] * problem.n), X)
        F = add(block_diagonal([add(identity(problem.m), written[0])] * problem.n), held)
    if transpose(F) == F:
        return _symmetric_in_unit_disk(F)
    return _in_unit_disk(F) if len(F) <= MOST_ROWS else Verdict.UNDECIDED


def _symmetric_in_unit_disk(F: Matrix) -> Verdict:
    """The same for a symmetric F: all eigenvalues inside iff I - F > 0 and I + F > 0."""
    one = identity(len(F))
    sides = [SparseSymmetric.from_dense(each) for each in (subtract(one, F), add(one, F))]
    if all(decide_positive_definite(each).verdict is Verdict.PROVED for each in sides):
        return Verdict.PROVED
    inside = all(decide_positive_semidefinite(each).verdict is Verdict.PROVED for each in sides)
    return Verdict.UNDECIDED if inside else Verdict.REFUTED


def _in_unit_disk(F: Matrix) -> Verdict:
    """PROVED: all eigenvalues inside the unit disk; REFUTED: one outside; UNDECIDED: one on its
    border."""
    image = disk_image(characteristic_polynomial(F), centre=Fraction(0), radius=Fraction(1))
    inside, strictly = decide_images([image], degree=len(F))
    return Verdict.PROVED if strictly else Verdict.UNDECIDED if inside else Verdict.REFUTED


SHORTEST, LONGEST = Fraction(1, 10**6), Fraction(10**6)  # periods, s
# in one table; a controller of its own can be written for every agent of a larger network
MOST_AGENTS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Hearing:
    """One arc of an agent in one mode: place among its neighbours, place among the couplings,
    weight."""

    neighbour: int
    coupling: int
    weight: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentNumbers:
    """One agent: index, label, goal (m), gain (p, m), u0 (p) that holds the goal (None for
    integrators), neighbours by index, and its arcs mode by mode."""

    index: int
    label: str
    goal: tuple[Fraction, ...]
    gain: Matrix
    rest: tuple[Fraction, ...] | None
    neighbours: tuple[int, ...]
    modes: tuple[tuple[Hearing, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """A sampled controller with the numbers of its code.  Shapes: Ad (q, q), Cd (p, q), L (q, p),
    rounded to ``precision``; () without an exosystem.  ``motion`` (m, m), ``push`` (m, p),
    ``watch`` (p, m): of [dynamics], where a state becomes x + motion x + push v in a period without
    a disturbance, or x + motion f(x) + push v. ``period`` in s. ``statements``: what is decided
    about these numbers.  ``states``: where its exosystem's states stand in a simulation, which
    holds those of all groups of agents side by side."""

    problem: Problem
    period: Fraction
    precision: str
    Ad: Matrix
    Cd: Matrix
    L: Matrix
    agents: tuple[AgentNumbers, ...]
    statements: tuple[Statement, ...]
    states: range
    motion: Matrix = ()
    push: Matrix = ()
    watch: Matrix = ()

    @property
    def q(self) -> int:
        """Order of the exosystem that the code's agents have; 0 without one."""
        return len(self.states)


def make_controller(
    problem: Problem,
    *,
    period: Any,
    precision: str = "double",
    agents: Sequence[Any] | None = None,
    gain: Gain | None = None,
    sampled_gain: Gain | None = None,
    objection: Callable[[Controller], str] | None = None,
) -> Controller:
    """Discretise the observer of ``problem`` and collect the numbers of ``agents`` (labels; default
    all, at most 200). Where agents have different exosystems, ``agents`` have to be of one group.
    ``period`` in s; ``gain`` (q, m) takes the place of observer.W; ``sampled_gain`` (q, m) that of
    L. ``objection``: asked about every controller that could be returned; "" accepts it. Raises:
    SpecError for a wrong argument, and for a period at which the sampled loop is proved to diverge,
    or the observer's error does not die out, or to which there is an objection; the message says
    which period works."""
    if precision not in PRECISIONS:
        cure = "double is the default."
        raise SpecError(
            f"precision must be double or float; got {shown(precision)}.",
            key="--precision",
            cure=cure,
        )
    W = chosen_gain(as_integrators(problem), gain)
    if problem.groups and W is None:
        raise SpecError(
            "observer.W must be known to write the observer.",
            key="observer.W",
            cure="Give or design W.",
        )
    L = None if sampled_gain is None else matrix(sampled_gain, name="sampled_gain")
    if L is not None:
        check_sampled_gain(shape(L), q=problem.q, m=problem.inputs, grouped=problem.is_grouped)
    asked, chosen = _read_period(period), _chosen(problem, agents)
    numbers = tuple(_numbers(problem, agent) for agent in chosen)
    exosystem, own, states = _observed(problem, W, chosen)

    def made(value: Fraction) -> Controller:
        decided = _decided(problem, exosystem, own, L, value, precision)
        return Controller(
            problem=problem,
            period=value,
            precision=precision,
            agents=numbers,
            states=states,
            **decided,
        )

    controller = made(asked)
    failed = _obstacle(controller, objection)
    if failed:
        works = longest_period(lambda value: _obstacle(made(value), objection) == "", asked)
        cure = "No shorter period that was tried works either: look at the gains and at W."
        if works is not None:
            cure = f"The longest of those tried that works: --period {float(works):.4g}."
        raise SpecError(
            f"a period of {float(asked):.4g} s is too long: {failed}", key="--period", cure=cure
        )
    return controller


def _observed(
    problem: Problem, W: Matrix | None, agents: Sequence[int]
) -> tuple[Exosystem | None, Matrix | None, range]:
    """The exosystem and the W of these agents, who have to share them, and the places of its states
    among all."""
    if not problem.is_grouped or W is None:
        return problem.joint_exosystem, W, range(problem.q)
    numbers = group_numbers(problem.groups, problem.network.labels)
    found = {numbers[agent] for agent in agents}
    if len(found) > 1:
        names = ", ".join(named(group.name) for group in problem.groups[:6])
        message = (
            "the code of one folder is for agents with one exosystem, and these have different ones"
        )
        cure = (
            "Name an agent, --agent LABEL, or in Python agents=[...] of one group, and write a "
            "folder for each group"
        )
        cure += f"; the groups begin with agent {names}."
        raise SpecError(f"{message} (exosystem.groups).", key="--agent", cure=cure)
    place = found.pop()
    if place == len(problem.groups):
        return None, None, range(0)
    before = sum(group.exosystem.order for group in problem.groups[:place])
    exosystem = problem.groups[place].exosystem
    return (
        exosystem,
        gains_of(as_integrators(problem).groups, W)[place],
        range(before, before + exosystem.order),
    )


def _decided(
    problem: Problem,
    exosystem: Exosystem | None,
    W: Matrix | None,
    L: Matrix | None,
    period: Fraction,
    precision: str,
) -> dict[str, Any]:
    """The rounded matrices of this period, and what is decided about them and about the network."""
    dynamics, m, p = problem.dynamics, problem.m, problem.inputs
    moves, B, left = scale(0, identity(m)), identity(m), identity(m)
    if dynamics is not None:
        moves, B, left = dynamics.about(problem.target)[0], dynamics.B, dynamics.left_inverse
    A, C = ((), ((),) * p) if exosystem is None or W is None else (exosystem.A, exosystem.C)
    rows = [
        a + b + c
        for a, b, c in zip(moves, identity(m), multiply(B, C) if A else ((),) * m, strict=True)
    ]
    rows += [(Fraction(0),) * (2 * m + len(A))] * m + [(Fraction(0),) * 2 * m + row for row in A]
    flow = _middle(discretise(tuple(rows), period).transition)  # of x, a speed that is held, and xi
    hold = tuple(row[m : 2 * m] for row in flow[:m])
    push, nodes = multiply(hold, B), dynamics is not None and dynamics.f is not None
    parts = {
        "motion": hold if nodes else subtract(tuple(row[:m] for row in flow[:m]), identity(m)),
        "push": push,
    }
    parts["watch"] = watch = multiply(inverse(multiply(left, push)), left)
    parts |= {"Ad": (), "Cd": (), "L": ()}
    if A and W is not None:
        parts["Ad"] = tuple(row[2 * m :] for row in flow[2 * m :])
        parts["Cd"] = multiply(watch, tuple(row[2 * m :] for row in flow[:m]))
        W = multiply(W, B)
        error = discretise(subtract(A, multiply(W, C)), period).mean if L is None else ()
        parts["L"] = multiply(scale(period, _middle(error)), W) if L is None else L
    found: dict[str, Any] = {
        name: tuple(tuple(rounded(x, precision) for x in row) for row in each)
        for name, each in parts.items()
    }
    motion = multiply(found["motion"], moves) if nodes else found["motion"]
    network = sampled_network_statement(
        problem, period, *((motion, found["push"]) if dynamics else ())
    )
    observer = (
        [sampled_observer_statement(found["Ad"], found["Cd"], found["L"], period=period)]
        if A
        else []
    )
    return found | {"statements": (*observer, network)}


def _middle(found: IntervalMatrix) -> Matrix:
    return tuple(tuple(entry.midpoint for entry in row) for row in found)


def _read_period(given: Any) -> Fraction:
    if given is None:
        message = "a period must be given: the code computes at its multiples and holds in between."
        cure = "For example --period 0.05; one that is too long is refused with one that works."
        raise SpecError(message, key="--period", cure=cure)
    period = parse_number(given, key="--period")
    if not SHORTEST <= period <= LONGEST:
        message = f"--period must be a positive number of seconds, 1e-6 to 1e6; got {shown(given)}."
        raise SpecError(message, key="--period", cure="For example --period 0.05.")
    return period


def _obstacle(controller: Controller, objection: Callable[[Controller], str] | None) -> str:
    """Why a period cannot be used, or ""."""
    for each in controller.statements:
        if each.verdict is Verdict.REFUTED or (
            each.kind == "sampled" and each.verdict is not Verdict.PROVED
        ):
            return each.text
    return "" if objection is None else objection(controller)


def _chosen(problem: Problem, agents: Sequence[Any] | None) -> list[int]:
    index = problem.network.index
    if agents is None:
        if problem.n > MOST_AGENTS:
            message = (
                f"the code holds the numbers of at most {MOST_AGENTS} agents; the problem has "
                f"{problem.n}."
            )
            raise SpecError(
                message, key="--agent", cure="Name the agent whose code you want: --agent LABEL."
            )
        return list(range(problem.n))
    names = list(map(one_form, agents))
    unknown = [name for name in names if name not in index]
    if unknown or not names:
        first = ", ".join(map(named, problem.network.labels[:6]))
        message = f"there is no agent {shown(unknown[0] if unknown else '')} in the network."
        raise SpecError(
            message, key="--agent", cure=f"Labels are {first}{', ...' if problem.n > 6 else ''}."
        )
    return [index[name] for name in names]


def _numbers(problem: Problem, agent: int) -> AgentNumbers:
    neighbours: dict[int, int] = {}
    modes = []
    for arcs in problem.network.modes.values():
        own = (arcs.listeners == agent).nonzero()[0].tolist()
        hearings = []
        for arc in own:
            speaker = int(arcs.speakers[arc])
            place = neighbours.setdefault(speaker, len(neighbours))
            coupling = problem.coupling_place(agent, speaker)
            hearings.append(Hearing(neighbour=place, coupling=coupling, weight=arcs.weights[arc]))
        modes.append(tuple(hearings))
    m = problem.m
    nothing = tuple((Fraction(0),) * m for _ in range(problem.inputs))
    dynamics, goal = problem.dynamics, problem.goal_of(agent)
    return AgentNumbers(
        index=agent,
        label=problem.network.labels[agent],
        goal=goal,
        rest=None if dynamics is None else dynamics.feedforward(goal),
        gain=problem.pinning.gains.get(agent, nothing),
        neighbours=tuple(neighbours),
        modes=tuple(modes),
    )
