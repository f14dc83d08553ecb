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

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from dobc_design._checks import noun
from dobc_design.certificate.claims import Claims, certified_period
from dobc_design.conditions.consensus.claim import (
    ModeJacobian,
    jacobians_at_consensus,
    linearisation,
)
from dobc_design.conditions.consensus.decide import of_differences
from dobc_design.conditions.domain import EVERYWHERE, Around, Domain
from dobc_design.conditions.kinds import READINGS
from dobc_design.conditions.numbers import bisected, rounded_down
from dobc_design.conditions.statement import Statement, undecided
from dobc_design.errors import refused, wrong
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import IntervalMatrix, UndefinedError, discretise
from dobc_design.exact.matrix import (
    Matrix,
    add,
    dot,
    identity,
    inverse,
    left_inverse,
    matrix,
    multiply,
    scale,
    shape,
    subtract,
    transpose,
    zeros,
)
from dobc_design.exact.number import ONE, ZERO, decimal_text, number_text, parse_number
from dobc_design.exact.polynomial import characteristic_polynomial, decide_images, disk_image
from dobc_design.exact.reading import named, shown
from dobc_design.loop.arrays import Gain, chosen_gain
from dobc_design.loop.make import loop_of, timing_of
from dobc_design.loop.timing import Timing, late_step, timing_words
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.groups import gains_of, group_numbers
from dobc_design.problem.network import one_form
from dobc_design.problem.problem import Problem
from dobc_design.problem.readings import check_ticks
from dobc_design.simulation.sampled import check_sampled_gain
from dobc_design.verdict import Verdict

from .c_text import PRECISIONS, rounded


def certified_sampling(problem: Problem, claims: Claims, period: Fraction) -> Statement:
    """State whether ``period`` (s) is within the one that the certificate proves: PROVED, or
    UNDECIDED; on a processor, whether it is about this loop."""
    timing = timing_of(problem)
    if timing is not None and timing.sampled:
        return _certified_loop(claims, timing)
    longest = certified_period(loop_of(problem), claims)
    if longest is None:
        text = "the certificate has no proved check `sampling`."
        if timing is not None:
            text += " Of the file with a [processor] of this period `readings` decides this loop."
        return undecided("certified-sampling", text)
    domain = next(check.domain for check in claims.checks if check.id == "sampling")
    limit = f"{float(longest):.4g} s{_starts(domain)}"
    if period > longest:
        verdict = Verdict.UNDECIDED
        text = (
            f"the certificate's check `sampling` proves periods up to {limit};"
            f" {float(period):.4g} s is longer."
        )
    else:
        verdict = Verdict.PROVED
        text = (
            "the certificate's check `sampling` covers this period: couplings and pinning may be "
            f"held for {limit} (observer and estimate: those of (13), in continuous time)."
        )
    return _about("certified-sampling", longest, verdict, text)


def _starts(domain: Domain) -> str:
    if domain == EVERYWHERE:
        return ", from every start"
    if not isinstance(domain, Around):
        return ""
    text = f", from every start with |e|_inf <= {domain.radius:g}"
    return f"{text} and |eps_i| <= {domain.disturbance:g}" if domain.disturbance else text


def _certified_loop(claims: Claims, timing: Timing) -> Statement:
    """What the check about readings says of the loop of a processor."""
    for check in claims.checks:
        if check.id == READINGS and check.is_proved:
            text = "the certificate's check `readings` proves the loop of this code, with "
            text += f"{timing_words(timing)}{_starts(check.domain)}."
            return _about("certified-sampling", timing.period, Verdict.PROVED, text)
    return undecided("certified-sampling", "the certificate has no proved check `readings`.")


def _about(kind: str, period: Fraction, verdict: Verdict, text: str) -> Statement:
    return Statement(kind=kind, verdict=verdict, text=text, exact={"period": number_text(period)})


MOST_ROWS = 40  # n m up to which a sampled network is decided by its characteristic polynomial
MOST_SYMMETRIC = 200  # n m up to which a symmetric one is, by definiteness
_TRIED = 32  # fractions of a period that is too long
_HALVINGS = 40
_BISECTIONS = 10


#: What is said of the eigenvalues of the sampled observer.
OBSERVER_WORDS = {
    Verdict.PROVED: "with the numbers as written, every eigenvalue of the sampled observer is "
    "inside the unit disk",
    Verdict.REFUTED: "the sampled observer diverges: an eigenvalue is outside the unit disk",
    Verdict.UNDECIDED: "the error of the sampled observer does not die out: an eigenvalue is on "
    "the unit circle",
}


def sampled_observer_statement(Ad: Matrix, Cd: Matrix, L: Matrix, *, period: Fraction) -> Statement:
    """State whether the error of the sampled observer, eps_(k+1) = (Ad - L Cd) eps_k, dies out:
    exact.  Shapes: Ad (q, q), Cd (m, q), L (q, m), the numbers as they stand in the code.
    ``period`` in s, for the text."""
    verdict = _in_unit_disk(subtract(Ad, multiply(L, Cd)))
    text = f"{OBSERVER_WORDS[verdict]} (period {float(period):.4g} s)."
    return _about("sampled", period, verdict, text)


@noun
class Step:
    """How a state moves near its goal in one period, without a disturbance: x + motion (x - goal) +
    push v, motion (m, m), push (m, p)."""

    motion: Matrix
    push: Matrix


def sampled_network_statement(
    problem: Problem, period: Fraction, written: Step | None = None
) -> Statement:
    """State whether e_(k+1) = (I + T (J - K)) e_k dies out in every mode: exact, at the consensus;
    with (J - K) e of as many periods ago as inputs act late.  UNDECIDED for n m > 40 (200 where
    J - K is symmetric), for slopes that are not rational, and where an agent that nothing pins
    keeps its error.  ``written``: how agents with [dynamics] move, with the code's numbers."""
    said = partial(_about, "sampled-network", period)
    if problem.n * problem.m > MOST_SYMMETRIC:
        text = f"the sampled network is not decided for more than {MOST_SYMMETRIC} rows."
        return said(Verdict.UNDECIDED, text)
    try:
        modes = jacobians_at_consensus(loop_of(problem)).modes
    except UndefinedError:
        text = "the coupling has no derivative at the consensus."
        return said(Verdict.UNDECIDED, text)
    found = {mode.name: _mode_verdict(problem, mode, period, written) for mode in modes}
    bad = [name for name, verdict in found.items() if verdict is Verdict.REFUTED]
    unknown = [name for name, verdict in found.items() if verdict is Verdict.UNDECIDED]
    which = "I + T (J - K)" if written is None else "its matrix (with the numbers as written)"
    if inputs_late(problem):
        which = "a step whose inputs act late"
    if bad:
        text = (
            f"held over {float(period):.4g} s, couplings and pinning drive the agents apart in "
            f'mode "{bad[0]}": an eigenvalue of {which} lies outside the unit disk.'
        )
        return said(Verdict.REFUTED, text)
    if unknown:
        text = (
            f'in mode "{unknown[0]}" it stays open whether the sampled network converges at '
            "the consensus: an agent that nothing reaches keeps its error, a slope is not "
            f"rational, or there are more than {MOST_ROWS} rows."
        )
        return said(Verdict.UNDECIDED, text)
    under = "" if written is None else "without a disturbance "
    text = (
        f"{under}in every mode the sampled network converges near the consensus: all eigenvalues "
        f"of {which} lie inside the unit disk (period {float(period):.4g} s)."
    )
    return said(Verdict.PROVED, text)


def longest_period(works: Callable[[Fraction], bool], asked: Fraction) -> Fraction | None:
    """The longest period below ``asked`` that works, of those tried, three digits, rounded down;
    None if none does. ``works`` need not be monotone: fractions of ``asked`` are tried from the
    top, then the gap above is halved."""
    trials = [asked * k / _TRIED for k in range(_TRIED - 1, 0, -1)]
    # Below the least fraction by halves: the limit may be orders of magnitude away.
    trials += [asked / _TRIED / 2**k for k in range(1, _HALVINGS)]
    above = asked
    for trial in trials:
        if works(trial):
            break
        above = trial
    else:
        return None
    low = bisected(works, trial, above, steps=_BISECTIONS)[0]
    # Fewer digits where they work as well: the period is told to somebody who types it.
    short = rounded_down(low, digits=3)
    return short if works(short) else low


def _mode_verdict(
    problem: Problem, mode: ModeJacobian, period: Fraction, written: Step | None
) -> Verdict:
    size = problem.n * problem.m
    if not mode.is_point:
        return Verdict.UNDECIDED
    late = inputs_late(problem) // period
    if (written is not None or late) and size * (late + 1) > MOST_ROWS:
        return Verdict.UNDECIDED
    # J - K at the consensus, as a dense matrix.
    entries = linearisation(mode, problem.m)
    rows = range(size)
    loop = tuple(tuple(entries.get((i, j), ZERO) for j in rows) for i in rows)
    F = add(identity(size), scale(period, loop))
    if written is not None and problem.dynamics is not None:
        F = _held(problem, problem.dynamics, loop, written)
    if problem.agrees:
        F = of_differences(F, problem.m)
    F = late_step(F, late)
    # Definiteness decides many more rows than a characteristic polynomial does.
    if transpose(F) == F:
        return _symmetric_in_unit_disk(F)
    return _in_unit_disk(F) if len(F) <= MOST_ROWS else Verdict.UNDECIDED


def _held(problem: Problem, dynamics: Dynamics, loop: Matrix, written: Step) -> Matrix:
    """What becomes of the error in a period over which what neighbours and pins do is held.

    That is the X of loop = I (x) A + (I (x) B) X, times B.
    """
    n = problem.n
    A, _ = dynamics.about(problem.target)
    felt = subtract(loop, block_diagonal([A] * n))
    onto_inputs = multiply(written.push, dynamics.left_inverse)
    alone = add(identity(problem.m), written.motion)
    return add(block_diagonal([alone] * n), multiply(block_diagonal([onto_inputs] * n), felt))


def _symmetric_in_unit_disk(F: Matrix) -> Verdict:
    """The same for a symmetric F: all eigenvalues inside iff I - F > 0 and I + F > 0."""
    one = identity(len(F))
    below = subtract(one, F)
    above = add(one, F)
    strict = [decide_positive_definite(each).verdict for each in (below, above)]
    if all(verdict is Verdict.PROVED for verdict in strict):
        return Verdict.PROVED
    # An eigenvalue on the border proves nothing, and refutes nothing.
    weak = [decide_positive_semidefinite(each).verdict for each in (below, above)]
    on_border = all(verdict is Verdict.PROVED for verdict in weak)
    return Verdict.UNDECIDED if on_border else Verdict.REFUTED


def _in_unit_disk(F: Matrix) -> Verdict:
    """PROVED: all eigenvalues inside the unit disk; REFUTED: one outside; UNDECIDED: one on its
    border."""
    # A Moebius map takes the unit disk to the left half-plane: there Hurwitz' test is exact.
    image = disk_image(characteristic_polynomial(F), centre=ZERO, radius=ONE)
    inside, strictly = decide_images([image], degree=len(F))
    if strictly:
        return Verdict.PROVED
    return Verdict.UNDECIDED if inside else Verdict.REFUTED


def inputs_late(problem: Problem) -> Fraction:
    """How late inputs act, actuators.delay (s)."""
    timing = timing_of(problem)
    return ZERO if timing is None else timing.ahead


SHORTEST, LONGEST = Fraction(1, 10**6), Fraction(10**6)  # periods, s
# in one table; a controller of its own can be written for every agent of a larger network
MOST_AGENTS = 200


@noun
class Hearing:
    """One arc of an agent in one mode: place among its neighbours, place among the couplings,
    weight."""

    neighbour: int
    coupling: int
    weight: Fraction


@noun
class AgentNumbers:
    """One agent: index, label, goal (m), gain (p, m), or (r) and (p, r) where they are of outputs,
    u0 (p) that holds the goal (None for integrators), neighbours by index, and its arcs mode by
    mode."""

    index: int
    label: str
    goal: tuple[Fraction, ...]
    gain: Matrix
    rest: tuple[Fraction, ...] | None
    neighbours: tuple[int, ...]
    modes: tuple[tuple[Hearing, ...], ...]


@noun
class Controller:
    """A sampled controller with the numbers of its code.  Shapes: Ad (q, q), Cd (p, q), L (q, p),
    rounded to ``precision``; () without an exosystem.  ``motion`` (m, m), ``push`` (m, p),
    ``watch`` (p, m): of [dynamics], where a state becomes x + motion x + push v in a period without
    a disturbance, or x + motion f(x) + push v.  ``outputs`` (r, q): where y = H x is measured, of
    what Ad, Cd, push (q, p) and L (q, r) are then of, states and exosystem; ``begin`` (q, r) makes
    the first estimate.  ``period`` in s. ``statements``: what is decided
    about these numbers.  ``oldest``: samples that a packet may be old, None where nobody says.
    ``told`` (p, q): Cd of the time at which an answer acts.
    ``states``: where its exosystem's states stand in a simulation, which holds those of all groups
    of agents side by side."""

    problem: Problem
    period: Fraction
    precision: str
    Ad: Matrix
    Cd: Matrix
    L: Matrix
    agents: tuple[AgentNumbers, ...]
    statements: tuple[Statement, ...]
    states: range
    told: Matrix
    oldest: int | None = None
    motion: Matrix = ()
    push: Matrix = ()
    watch: Matrix = ()
    outputs: Matrix = ()
    begin: Matrix = ()

    @property
    def late(self) -> int:
        """How many samples later an answer acts."""
        return inputs_late(self.problem) // self.period

    @property
    def q(self) -> int:
        """Order of the observer of the code's agents; 0 without one."""
        return len(self.Ad)

    @property
    def felt(self) -> int:
        """How many numbers couplings and pins act on."""
        return len(self.agents[0].goal)

    @property
    def estimated(self) -> bool:
        """Whether couplings and pins act on estimated states."""
        return loop_of(self.problem).estimated


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
        raise refused(
            "precision",
            f"precision must be double or float; got {shown(precision)}.",
            "double is the default.",
        )
    W = chosen_gain(loop_of(problem), gain)
    if problem.groups and W is None:
        raise refused(
            "observer.W", "observer.W must be known to write the observer.", "Give or design W."
        )
    L = None if sampled_gain is None else matrix(sampled_gain, name="sampled_gain")
    if L is not None:
        problem.require("a sampled gain")
        check_sampled_gain(shape(L), q=problem.q, m=problem.inputs, grouped=problem.is_grouped)
    asked = _read_period(problem, period, L)
    chosen = _chosen(problem, agents)
    plant = problem.dynamics or Dynamics(A=zeros(problem.m, problem.m))
    numbers = tuple(_numbers(problem, plant.seen, agent) for agent in chosen)
    observed = _observed(problem, W, chosen)
    plan = _Plan(
        problem=problem,
        plant=plant,
        precision=precision,
        agents=numbers,
        observed=observed,
        sampled_gain=L,
    )
    # What is wrong with the arguments is said before anything is discretised or simulated.
    controller = plan.at(asked)
    failed = _obstacle(controller, objection)
    if failed and problem.processor is not None:
        message = f"of {float(asked):.4g} s is too long: {failed}"
        raise wrong("processor.period", message, "Choose a shorter one, or another observer.W.")
    if failed:
        ahead = inputs_late(problem)
        works = longest_period(
            lambda value: not ahead % value and not _obstacle(plan.at(value), objection), asked
        )
        cure = "No shorter period that was tried works either: look at the gains and at W."
        if works is not None:
            cure = f"The longest of those tried that works: --period {decimal_text(works)}."
        raise refused("--period", f"a period of {float(asked):.4g} s is too long: {failed}", cure)
    return controller


@noun
class _Observed:
    """The exosystem (A, C) and the W (q, p) that agents share, () without a disturbance, and the
    places of its states among those of all groups.  ``drift`` and ``seen``: A and C, or the pair
    that W is of where outputs are measured."""

    A: Matrix = ()
    C: Matrix = ()
    W: Matrix = ()
    states: range = range(0)
    drift: Matrix = ()
    seen: Matrix = ()


def _observed(problem: Problem, W: Matrix | None, agents: Sequence[int]) -> _Observed:
    """What these agents observe.  Raises: SpecError where they do not share it."""
    if W is None:
        return _Observed()
    numbers = group_numbers(problem.groups, problem.network.labels)
    # One folder of code has one transition matrix.
    found = {numbers[agent] for agent in agents}
    if len(found) > 1:
        names = ", ".join(named(group.name) for group in problem.groups[:6])
        raise refused(
            "--agent",
            "the code of one folder is for agents with one exosystem, and these have "
            "different ones (exosystem.groups).",
            "Name an agent, --agent LABEL, or in Python agents=[...] of one group, and write a "
            f"folder for each group; the groups begin with agent {names}.",
        )
    place = found.pop()
    if place == len(problem.groups):  # agents in no group
        return _Observed()
    exosystem = problem.groups[place].exosystem
    loop = loop_of(problem)
    own = gains_of(loop.groups, W)[place]
    pair = exosystem
    if loop.sensed:
        pair = loop.sensed[place].exosystem
        own = loop.sensed[place].observer.W or own
    # In a simulation the states of all groups stand side by side.
    before = sum(group.exosystem.order for group in problem.groups[:place])
    states = range(before, before + exosystem.order)
    A, C = exosystem.A, exosystem.C
    return _Observed(A=A, C=C, W=own, states=states, drift=pair.A, seen=pair.C)


@noun
class _Plan:
    """What a controller is at every period: whose it is, and what its numbers come from; the
    ``plant`` of integrators has A = 0 and B = I."""

    problem: Problem
    plant: Dynamics
    precision: str
    agents: tuple[AgentNumbers, ...]
    observed: _Observed
    sampled_gain: Matrix | None

    def at(self, period: Fraction) -> Controller:
        """The controller of this period, with what is decided about it."""
        problem, A = self.problem, self.observed.A
        m, own = problem.m, 2 * problem.m
        left = self.plant.left_inverse
        # Of a state x, its speed that is held, and xi, over one period.
        flow = _middle(discretise(self._held_motion(), period).transition)
        hold = tuple(row[m:own] for row in flow[:m])
        exact_push = multiply(hold, self.plant.B)
        # What the disturbance did is read off the state: the left inverse of how inputs move it.
        exact_watch = multiply(inverse(multiply(left, exact_push)), left)
        # Of an f the code computes f(x) itself and holds it for a period, as a speed.
        motion = self._rounded(self._moved(flow) if self.plant.f is None else hold)
        push = self._rounded(exact_push)
        watch = self._rounded(exact_watch)
        Ad: Matrix = ()
        Cd: Matrix = ()
        L: Matrix = ()
        told: Matrix = ()
        late = inputs_late(problem)
        statements = [sampled_network_statement(problem, period, self._step(motion, push))]
        outputs: Matrix = ()
        begin: Matrix = ()
        if A:
            L = self._rounded(self._sampled_gain(period))
            Ad = self._rounded(tuple(row[own:] for row in flow[own:]))
            output = multiply(exact_watch, tuple(row[own:] for row in flow[:m]))
            Cd = told = self._rounded(output)
            if late:
                told = self._rounded(multiply(output, _middle(discretise(A, late).transition)))
            seen = Cd
            if self.plant.H:  # of states, too
                Ad = self._rounded(tuple(row[:m] + row[own:] for row in flow[:m] + flow[own:]))
                Cd = told = tuple((ZERO,) * m + row for row in Cd)
                push += zeros(len(A), self.plant.inputs)
                begin = self._rounded(transpose(left_inverse(transpose(self.observed.seen))))
                seen = outputs = self._rounded(self.observed.seen)
            # What is decided is about the numbers as they are written, after rounding.
            statements.insert(0, sampled_observer_statement(Ad, seen, L, period=period))
        return Controller(
            problem=problem,
            period=period,
            precision=self.precision,
            Ad=Ad,
            Cd=Cd,
            L=L,
            agents=self.agents,
            statements=tuple(statements),
            states=self.observed.states,
            told=told,
            oldest=self._oldest(period),
            motion=motion,
            push=push,
            watch=watch,
            outputs=outputs,
            begin=begin,
        )

    def _oldest(self, period: Fraction) -> int | None:
        timing = timing_of(self.problem)
        if timing is None:
            return None
        return math.ceil(timing.at_once.delay / period) + timing.lost

    def _slopes(self) -> Matrix:
        """A of the plant, or the slopes of f at the target, (m, m)."""
        return self.plant.about(self.problem.target)[0]

    def _held_motion(self) -> Matrix:
        """x' = A x + v + B C xi, v' = 0, xi' = A_xi xi, as one matrix."""
        m, A = self.problem.m, self.observed.A
        felt: Matrix = ((),) * m
        if A:
            felt = multiply(self.plant.B, self.observed.C)
        moved = zip(self._slopes(), identity(m), felt, strict=True)
        rows = [slopes + speeds + disturbance for slopes, speeds, disturbance in moved]
        rows += zeros(m, 2 * m + len(A))
        rows += [nothing + row for nothing, row in zip(zeros(len(A), 2 * m), A, strict=True)]
        return tuple(rows)

    def _moved(self, flow: Matrix) -> Matrix:
        """What a period adds to a state by itself, (m, m)."""
        m = self.problem.m
        return subtract(tuple(row[:m] for row in flow[:m]), identity(m))

    def _sampled_gain(self, period: Fraction) -> Matrix:
        """L (q, p): the one that was given, else the mean of exp((A - W C) s) over a period times
        it and W."""
        if self.sampled_gain is not None:
            return self.sampled_gain
        own = self.observed
        if self.problem.processor is not None:
            return scale(period, own.W)
        # W corrects from states; from what the inputs explain of them it is W B.
        gain = own.W if self.plant.H else multiply(own.W, self.plant.B)
        error = discretise(subtract(own.drift, multiply(gain, own.seen)), period).mean
        return multiply(scale(period, _middle(error)), gain)

    def _step(self, motion: Matrix, push: Matrix) -> Step | None:
        """How a state moves near its goal; None of integrators."""
        if self.problem.dynamics is None:
            return None
        # Of an f, ``motion`` is what it is multiplied with: at the target it has these slopes.
        near = motion if self.plant.f is None else multiply(motion, self._slopes())
        return Step(motion=near, push=push)

    def _rounded(self, exact: Matrix) -> Matrix:
        return tuple(tuple(rounded(x, self.precision) for x in row) for row in exact)


def _middle(found: IntervalMatrix) -> Matrix:
    return tuple(tuple(entry.midpoint for entry in row) for row in found)


def _read_period(problem: Problem, given: Any, L: Matrix | None) -> Fraction:
    if problem.processor is not None:
        stated = problem.processor.period
        if given is not None and parse_number(given, "--period") != stated:
            message = f"--period must be that of [processor], {float(stated):.6g} s; got {given}."
            raise refused("--period", message, "Leave it out, or change the problem.")
        if L is not None:
            message = "is period times observer.W where the problem has a [processor]."
            raise wrong("sampled_gain", message, "Leave it out, or change observer.W.")
        given = stated
    if given is None:
        raise refused(
            "--period",
            "a period must be given: the code computes at its multiples and holds in between.",
            "For example --period 0.05; one that is too long is refused with one that works.",
        )
    period = parse_number(given, "--period")
    if not SHORTEST <= period <= LONGEST:
        raise refused(
            "--period",
            f"--period must be a positive number of seconds, 1e-6 to 1e6; got {shown(given)}.",
            "For example --period 0.05.",
        )
    check_ticks(inputs_late(problem), period, key="--period")
    return period


def _obstacle(controller: Controller, objection: Callable[[Controller], str] | None) -> str:
    """Why a period cannot be used, or ""."""
    for each in controller.statements:
        # The observer must be proved to converge; the network need only not be refuted.
        undecided = each.kind == "sampled" and not each.is_proved
        if undecided or each.verdict is Verdict.REFUTED:
            return each.text
    return "" if objection is None else objection(controller)


def _chosen(problem: Problem, agents: Sequence[Any] | None) -> list[int]:
    index = problem.network.index
    if agents is None:
        if problem.n > MOST_AGENTS:
            raise refused(
                "--agent",
                f"the code holds the numbers of at most {MOST_AGENTS} agents; the problem "
                f"has {problem.n}.",
                "Name the agent whose code you want: --agent LABEL.",
            )
        return list(range(problem.n))
    names = [one_form(agent) for agent in agents]
    unknown = [name for name in names if name not in index]
    if unknown or not names:
        which = shown(unknown[0] if unknown else "")
        first = ", ".join(map(named, problem.network.labels[:6]))
        more = ", ..." if problem.n > 6 else ""
        raise refused(
            "--agent", f"there is no agent {which} in the network.", f"Labels are {first}{more}."
        )
    return [index[name] for name in names]


def _numbers(problem: Problem, seen: Matrix, agent: int) -> AgentNumbers:
    neighbours: dict[int, int] = {}  # index -> place in the code
    modes = []
    for arcs in problem.network.modes.values():
        own = (arcs.listeners == agent).nonzero()[0].tolist()
        # Neighbours are numbered as they are met, over all modes: one packet is heard in each.
        hearings = []
        for arc in own:
            speaker = int(arcs.speakers[arc])
            place = neighbours.setdefault(speaker, len(neighbours))
            coupling = problem.coupling_place(agent, speaker)
            hearings.append(Hearing(neighbour=place, coupling=coupling, weight=arcs.weights[arc]))
        modes.append(tuple(hearings))
    dynamics = problem.dynamics
    goal = problem.goal_of(agent)
    return AgentNumbers(
        index=agent,
        label=problem.network.labels[agent],
        goal=tuple(dot(row, goal) for row in seen),
        rest=None if dynamics is None else dynamics.feedforward(goal),
        gain=problem.pinning.gains.get(agent, zeros(problem.inputs, len(seen))),
        neighbours=tuple(neighbours),
        modes=tuple(modes),
    )
