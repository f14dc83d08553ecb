"""The loop with everything computed at the multiples of a period T and held between: solved
exactly, step by step.

At k T every agent computes v_k = couplings + input and holds it; between samples x' = v_k + d,
which is integrated in closed form.  The observer is the exact discretisation: with Ad = exp(A T)
and the mean output Cd = C (1/T) int_0^T exp(A s) ds, the measured mean (x_(k+1) - x_k)/T - v_k is
Cd xi_k exactly, and

    xihat_(k+1) = Ad xihat_k + L ((x_(k+1) - x_k)/T - v_k - Cd xihat_k),     dhat_k = Cd xihat_k.

So eps_(k+1) = (Ad - L Cd) eps_k, free of the network as (17) is, and the mean of d - dhat over a
period is Cd eps_k. L = int_0^T exp((A - W C) s) ds W, unless it is given; T W where the problem
states a [processor].  Between samples d - dhat keeps a ripple that shrinks with T.  Agents that
move in steps, x_(k+1) = x_k + v_k + d_k and xi_(k+1) = A xi_k, have T = 1, Ad = A and Cd = C.
Where v_k acts l periods late, dhat_k = Cd exp(A l T) xihat_k; observers count on the v that acts.

Agents with linear [dynamics] move by x_(k+1) = Phi x_k + G v_k + N xi_k, exactly, G = R B, R =
int_0^T exp(A_x s) ds; with watch G = I the same holds of watch (x_(k+1) - Phi x_k) - v_k and Cd =
watch N.  What N xi_k does beside G Cd xi_k, a ripple of higher order in T, is not cancelled.  Phi x
+ G v is x + R (A_x x + B v): with f(x) in place of A_x x, A_x its slopes at the target, f(x) - A_x
x is held over a period, an error of order T^2.  That is the model of the observer; the agents
themselves are integrated between samples.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from dobc_design._checks import noun
from dobc_design.errors import misshapen, wrong
from dobc_design.exact.matrix import Array
from dobc_design.problem.network import BoolArray, IndexArray

from .agents import Agents, StressedRuns
from .columns import March, RightHandSide
from .field import ClosedLoop, act, largest
from .integrate import FARTHEST, Outcome, Progress, Run, Samples
from .outputs import moved, with_disturbances
from .stressed import LEAST_STEPS, StressedColumns, sample_instants
from .switches import constant_signals
from .trajectory import SAMPLED, STEPS

REPORTED = 64  # one of so many steps is reported


def flow(loop: ClosedLoop, times: float | Array) -> Array:
    """What so much time (s) adds to x with v held: a matrix (..., m, m + q) of x' - d at its begin,
    and of xi."""
    m = loop.m
    if loop.steps:
        return np.multiply.outer(times, np.hstack([np.eye(m), loop.C]))
    # x' is a state, too, which drives x and does not change
    block = np.zeros((2 * m + loop.q, 2 * m + loop.q))
    if loop.plant is not None:
        block[:m, :m] = loop.plant.A
    block[:m, m : 2 * m] = np.eye(m)
    block[:m, 2 * m :] = loop.C
    block[2 * m :, 2 * m :] = loop.A
    spans = np.asarray(times, dtype=np.float64)[..., None, None]
    return np.asarray(expm(block * spans)[..., :m, m:])


def flown(added: Array, x: Array, speed: Array, xi: Array) -> Array:
    """x (n, m, R) after that time."""
    return x + act(added, np.concatenate([speed, xi], axis=1))


class Discrete(NamedTuple):
    """The observer of a sampled loop: watch (p, m), Cd (p, q), and L (q, p) or (n, q, p)."""

    watch: Array
    Cd: Array
    L: Array


def discretised(loop: ClosedLoop, period: float, gain: Array | None = None) -> Discrete:
    """The observer for ``period`` in s.  Raises: ShapeError for a wrong gain."""
    added = flow(loop, period)
    B = np.eye(loop.m) if loop.plant is None else loop.plant.B
    if gain is None:
        gain = integral(loop.F, period)[1] @ loop.W @ B
    else:
        check_sampled_gain(gain.shape, q=loop.q, m=B.shape[1], grouped=loop.own is not None)
    # of the states that the inputs drive: B has full column rank
    left = np.linalg.pinv(B)
    watch = np.linalg.solve(left @ added[:, : loop.m] @ B, left)
    return Discrete(watch, watch @ added[:, loop.m :], gain)


def check_sampled_gain(shape: tuple[int, ...], *, q: int, m: int, grouped: bool) -> None:
    """Refuse a gain of another shape than (q, m), or one for agents with different exosystems.
    Raises: ShapeError."""
    if grouped:
        message = (
            "is one gain for all agents, and the groups of exosystem.groups have different ones."
        )
        raise wrong("sampled_gain", message, "Leave it out: the W of every group is discretised.")
    if shape != (q, m):
        message = f"must have shape ({q}, {m}), one row per exosystem state; got {shape}."
        cure = "design_observer(problem, period=...).W has it."
        raise misshapen("sampled_gain", message, cure)


def integral(A: Array, times: float | Array) -> tuple[Array, Array]:
    """exp(A t) and its integral from 0 to t, (..., q, q) each (Van Loan 1978)."""
    q = len(A)
    spans = np.asarray(times, dtype=np.float64)[..., None, None]
    block = np.zeros((2 * q, 2 * q))
    block[:q, :q] = A
    block[:q, q:] = np.eye(q)
    # SciPy refuses matrices without rows
    both = expm(block * spans) if q else np.zeros((*np.shape(times), 0, 0))
    return both[..., :q, :q], both[..., :q, q:]


def transition(loop: ClosedLoop, period: float) -> Array:
    """Ad, (q, q)."""
    return loop.A if loop.steps else integral(loop.A, period)[0]


class Between(StressedColumns):
    """The agents between two samples: couplings ``felt`` (n, m, R) and inputs ``u`` (n, p, R) are
    held, z is xihat."""

    felt: Array
    u: Array

    def part(self, mode: int, runs: IndexArray) -> RightHandSide:
        """The derivative of runs, whatever the mode."""
        loop = self.loop
        chosen = self.alive[runs]
        felt = self.felt[..., chosen]
        u = self.u[..., chosen]

        def derivative(y: Array, force: Array) -> Array:
            x, xi, z = loop.split(y)
            d = act(loop.output, xi)
            if len(force):
                d = d + force.reshape(u.shape)
            x_dot = felt + loop.moved(u + d, x - self.goal)
            return self.joined(x_dot, act(loop.A, xi), 0 * z)

        return derivative


def run_sampled_alone(runs: StressedRuns, progress: Progress) -> Outcome:
    """Step a stack of one run from sample to sample."""
    seen = []
    stepper = Stepper(runs, lambda number, sample: seen.append(sample), progress)
    stepper.run()
    count = int(stepper.counts[0])

    def over_time(part: str) -> Array:
        return np.stack([getattr(sample, part)[..., 0] for sample in seen[:count]])

    run = Run(
        times=stepper.times[:count].copy(),
        states=np.zeros((count, 0)),
        reason=stepper.reasons.get(0, ""),
        method=stepper.method,
        evaluations=len(stepper.instants),
    )
    samples = Samples(*map(over_time, SAMPLED))
    return Outcome(run=run, samples=samples)


@noun(eq=False)
class Hold:
    """What holds from an instant (s) on in all runs: measured states (n, m, R), couplings (n, m,
    R), inputs (n, p, R), and the estimate of d that they use."""

    begin: float
    measured: Array
    felt: Array
    u: Array
    dhat: Array


class Stepper:
    """Steps all runs; ``visit`` gets the place of a time, and what is seen of the runs then.

    ``counts`` (R,): how many samples each run reached; ``reasons``: why some ended early.
    """

    def __init__(
        self, runs: StressedRuns, visit: Callable[[int, Samples], None], report: Progress
    ) -> None:
        setting = runs.setting
        count = len(runs.seeds)
        self.loop = with_disturbances(setting.loop)
        self.times = setting.times
        self.tolerance = setting.tolerance
        self.nearby = runs.nearby
        self.visit = visit
        self.report = report
        self.period = float(runs.stress.period or 0.0)
        self.instants = sample_instants(self.period, setting.horizon)
        # the step that a sample lies in
        self.owner = np.searchsorted(self.instants, self.times, side="right") - 1
        self.flow = flow(self.loop, self.period)
        gain = runs.stress.sampled_gain
        own = None if gain is None else np.asarray(gain)
        self.observer = discretised(self.loop, self.period, own)
        timing = setting.exact.timing
        if timing is not None and timing.sampled:
            B = np.eye(self.loop.m) if self.loop.plant is None else self.loop.plant.B
            self.observer = self.observer._replace(L=self.period * self.loop.W @ B)
        self.Ad = transition(self.loop, self.period)
        self.sensed = self.loop.sensed
        if self.sensed is not None:
            if own is not None:
                setting.problem.require("a sampled gain")
            A, entry = integral(self.sensed.pairs.A, self.period)
            self.sensed = replace(
                self.sensed,
                pairs=replace(self.sensed.pairs, A=A),
                entry=entry @ self.sensed.entry,
                gain=integral(self.loop.F, self.period)[1] @ self.sensed.gain,
            )
        # what is commanded acts so many periods later, the oldest first
        ahead = 0.0 if timing is None else float(timing.ahead)
        self.late = round(ahead / self.period)
        self.commands = deque[Hold]()
        self.predicted = self.observer.Cd @ expm(self.loop.A * ahead)
        # nothing is heard between the instants
        self.agents = Agents(runs, self.instants, keep=False)
        self.between: Between | None = None
        self.method = STEPS if self.loop.steps else f"exact steps of {self.period:g} s"
        # with dynamics, what agents do between samples need not have a closed form
        bent = self.loop.bend is not None or runs.stress.acts
        if self.loop.plant is not None and bent:
            self.between = Between(runs, self.agents)
            self.method = f"DOP853 between samples, every {self.period:g} s"
        self.steps = np.full(count, self.period)
        # the state of all runs, and what the observer compares it with
        self.x, self.xi, self.xihat = runs.begin()
        self.before = self.x
        self.held = np.zeros_like(self.x)
        self.goal = self.loop.goal[..., None]
        self.farthest = FARTHEST * np.maximum(1.0, self.size())
        self.counts = np.full(count, len(self.times))
        self.reasons: dict[int, str] = {}
        self.going: BoolArray = np.ones(count, dtype=bool)

    def size(self) -> Array:
        """|e|_inf of all runs, (R,)."""
        return largest(self.x - self.goal)

    def run(self) -> None:
        """From instant to instant, up to the horizon.  Raises: SpecError for too many."""
        # one matrix exponential for all samples, which lie anywhere between instants
        # samples need not lie at instants, and a period may hold several
        since = self.times - self.instants[self.owner]
        transition = integral(self.loop.A, since)[0]
        added = flow(self.loop, since)
        done = 0
        for k, instant in enumerate(self.instants.tolist()):
            hold = self.compute(k, instant)
            last = int(np.searchsorted(self.owner, k, side="right"))
            following = self.instants[k + 1 : k + 2].tolist()
            # the samples of this period, then the next instant
            times = [*self.times[done:last].tolist(), *following]
            path = self.path(hold, times, [*added[done:last], self.flow])
            for sample, x in zip(range(done, last), path, strict=False):
                # a run that ended keeps its start at least
                bad = self.going & ~np.isfinite(x).all(axis=(0, 1))
                reason = f"a coupling overflows or is undefined at t = {instant:.6g} s"
                self.end(bad, max(1, done), reason)
                self.show(sample, hold, self.x if sample == 0 else x, transition[sample])
            done = last
            # samples may end before the next instant
            if following:
                self.go_on(hold, next(path), following[0], done)
            if not self.going.any():
                break
            if k % REPORTED == 0:
                self.report(instant / float(self.times[-1]))
        self.report(1.0)

    def path(self, hold: Hold, times: list[float], flows: list[Array]) -> Iterator[Array]:
        """x (n, m, R) at times after the instant, and at the next."""
        if self.between is None:
            return self.exact(hold, times, flows)
        return iter(self.integrated(self.between, hold, np.array(times)))

    def show(self, sample: int, hold: Hold, x: Array, transition: Array) -> None:
        """Visit a sample, to which ``transition`` takes xi."""
        xi = act(transition, self.xi)
        d = act(self.loop.output, xi) + self.agents.extra(float(self.times[sample]))
        seen = Samples(
            x=x,
            xi=xi[:, self.loop.of_xi],
            xihat=self.agents.believed(self.xihat[:, self.loop.of_xi]),
            d=d,
            dhat=self.agents.believed(hold.dhat),
            u=hold.u,
        )
        self.visit(sample, seen)

    def go_on(self, hold: Hold, x: Array, time: float, done: int) -> None:
        """The runs stand at the next instant, where so many samples are done."""
        # what the observer compares the next measurement with
        self.before = hold.measured
        e = hold.measured - self.goal
        # what outputs are measured of is predicted by the estimates
        self.held = hold.felt + self.loop.moved(hold.u, e * (self.sensed is None))
        self.x = x
        self.xi = act(self.Ad, self.xi)
        far = self.going & ~(self.size() <= self.farthest)
        self.end(far, done, f"|e|_inf exceeded {FARTHEST:.0e} times its start at t = {time:.6g} s")

    def exact(self, hold: Hold, times: list[float], flows: list[Array]) -> Iterator[Array]:
        """The path in closed form: ``flows`` say what time adds."""
        x = self.x
        speed = hold.felt + self.loop.moved(hold.u, x - self.goal)
        for time, added in zip(times, flows, strict=False):
            extra = self.agents.extra_integral(hold.begin, time)
            yield flown(added, x, speed, self.xi) + extra

    def integrated(self, columns: Between, hold: Hold, times: Array) -> Array:
        """The path (T, n, m, R), integrated; nan after a run has ended, and of those that had ended
        before."""
        begin = hold.begin
        alive = np.flatnonzero(self.going)
        state = columns.joined(self.x, self.xi, self.xihat)
        columns.felt = hold.felt
        columns.u = hold.u
        columns.alive = alive
        # what is not reached stays unknown
        path = np.full((len(times), *self.x.shape), np.nan)
        path[times == begin] = self.x

        def visit(sample: IndexArray, run: IndexArray, y: Array) -> None:
            path[sample, :, :, alive[run]] = np.moveaxis(self.loop.split(y)[0], 2, 0)

        if not len(times) or times[-1] <= begin:
            return path
        # couplings are held, so that switches of the graph do not matter here
        found = March(
            columns=columns,
            start=state[:, alive],
            begin=begin,
            end=times[-1],
            switches=constant_signals(0 * alive),
            farthest=self.farthest[alive],
            first=self.steps[alive],
            most=LEAST_STEPS,
            tolerance=self.tolerance,
            samples=times,
            visit=visit,
        ).run()
        # the next period begins with the step that this one ended with
        self.steps[alive] = found.steps
        stiff = (
            f"agents are too stiff for {LEAST_STEPS} steps to the sample after t = {begin:.6g} s"
        )
        for place, reason in found.reasons().items():
            which = np.arange(len(self.going)) == alive[place]
            kept = int(np.count_nonzero(self.times <= found.times[place]))
            self.end(which & self.going, kept, reason or stiff)
        return path

    def compute(self, k: int, instant: float) -> Hold:
        """What is measured, exchanged, estimated and commanded at the k-th instant."""
        agents = self.agents
        # positions decide who hears whom, once in a period
        if self.nearby is not None:
            mode = self.nearby.look(instant, self.x[..., 0])
            agents.heard.move(mode, k)
        measured = self.x + agents.noise(k)
        watch, Cd, L = self.observer
        # at the first instant there is nothing to compare with
        if k and self.sensed is not None:
            self.xihat = moved(self.sensed, self.xihat, self.held, self.before - self.goal)
        elif k:
            expected = flown(self.flow, self.before, self.held, np.zeros_like(self.xihat))
            innovation = act(watch, measured - expected) - act(Cd, self.xihat)
            self.xihat = act(self.Ad, self.xihat) + act(L, innovation)
        e = measured - self.goal
        if self.sensed is not None and self.sensed.estimated:
            e = act(self.sensed.x, self.xihat)
        dhat = act(self.predicted, self.xihat)
        modes = agents.heard.modes[:, k]
        agents.fail(instant, e, dhat, modes)
        felt = np.zeros_like(e)
        exchanged = agents.heard.exchange(k, agents.said(e))
        known = agents.heard.own(e)
        for links, runs, held in exchanged:
            felt[..., runs] = links.felt(known[..., runs], held)
        u = agents.control(agents.pulled(known, modes), dhat)
        if not k:  # nothing acts before the first command does
            nothing = Hold(begin=0.0, measured=e, felt=0 * felt, u=0 * u, dhat=0 * dhat)
            self.commands.extend([nothing] * self.late)
        self.commands.append(Hold(begin=instant, measured=measured, felt=felt, u=u, dhat=dhat))
        return replace(self.commands.popleft(), begin=instant, measured=measured)

    def end(self, which: BoolArray, count: int, reason: str) -> None:
        """Runs that end here keep their first ``count`` samples."""
        for run in np.flatnonzero(which).tolist():
            self.counts[run] = count
            self.reasons[run] = reason
        self.going = self.going & ~which
