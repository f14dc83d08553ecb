"""What breaks first: every stress grows until the loop no longer converges; and the longest period
that still works.

A run converges here if the largest error of the agents that work, over the last tenth of the
horizon, is at most ``tolerance`` times the error at the start.  One seed and one start: an
observation, never a proof.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.random import default_rng

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Headed
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import certified_period
from dobc_design.conditions.numbers import bisected
from dobc_design.conditions.observer.propose import observer_gain, with_observer
from dobc_design.errors import refused, wrong
from dobc_design.exact.matrix import Array
from dobc_design.exact.reading import Document, Texts
from dobc_design.loop.arrays import error_arcs
from dobc_design.loop.make import loop_of
from dobc_design.loop.timing import Timing
from dobc_design.problem.load import Source, load_problem

from ._arguments import positive
from .execution import run_once
from .integrate import fastest_decay, observer_decay
from .setting import Setting, make_setting
from .signals import Signal, signal_of
from .starts import Given
from .stress import Failure, Stress
from .trajectory import Trajectory

UNITS = {
    "noise": "unit of x",
    "disturbance": "unit of x per s",
    "saturation": "unit of x per s",
    "period": "s",
    "delay": "s",
    "loss": "probability",
    "failures": "agents",
}
OPTIONS = tuple(UNITS)
OF_INPUTS = ("disturbance", "saturation")  # which act on u where agents have dynamics
TOLERANCE = 0.1
LATE = 0.9  # part of the horizon after which a run has to be settled
#: What is tried of an option, in multiples of its natural scale.
DOUBLED: Array = np.logspace(-6, 6, 13, base=2)
MULTIPLES = {
    "saturation": 0.5 ** np.arange(13),
    "loss": np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0]),
}
BISECTIONS = 10
SAMPLES = 201
MOST_FAILURES = 12  # numbers of failing agents that are tried
TINY = 1e-300
COARSE = 1e-6  # relative tolerance of the integrator: errors of ten percent are looked for


@noun(eq=False)
class Sweep:
    """One option, from mild to severe, up to the first severity at which the loop no longer
    converges.  Shapes: severity (S,) in ``unit``, relative (S,) in multiples of what is natural
    (see ``what_breaks_first``), late (S,), the late error over the one at the start, inf where the
    run diverged.  ``survives`` and ``breaks``: the last severity that converged and the first that
    did not, or None."""

    option: str
    unit: str
    severity: Array
    relative: Array
    late: Array
    survives: float | None
    breaks: float | None
    relative_break: float | None

    def to_json(self) -> Document:
        """JSON types: late errors are null where a run diverged."""
        return {
            "option": self.option,
            "unit": self.unit,
            "survives": self.survives,
            "breaks": self.breaks,
            "severity": self.severity.tolist(),
            "relative": self.relative.tolist(),
            "late": [late if np.isfinite(late) else None for late in self.late.tolist()],
        }


@noun
class PeriodLimit:
    """Sampling periods in s: the longest that converged, the shortest that did not, the certified
    one; or None."""

    converges: float | None
    fails: float | None
    certified: float | None = None

    def __str__(self) -> str:
        words = "no period tried converges"
        if self.converges is not None:
            words = f"converges at {self.converges:.4g} s"
        if self.fails is not None:
            words += f", no longer at {self.fails:.4g} s"
        if self.certified is not None:
            words += f"; certified up to {self.certified:.4g} s"
        return words


@noun(eq=False)
class Breaking(Headed):
    """The sweeps of one problem, the period limit where the period was among them, and the run
    without stress."""

    name: str
    t_final: float
    tolerance: float
    sweeps: tuple[Sweep, ...]
    period: PeriodLimit | None
    calm: Trajectory  # the run without stress

    @property
    def order(self) -> Texts:
        """The options that broke the loop, the first to break before the others, by relative
        severity."""
        broken = []
        for each in self.sweeps:
            if each.relative_break is not None:
                broken.append((each.relative_break, each.option))
        return tuple(option for _, option in sorted(broken))

    def plot(self, ax: Any = None) -> Any:
        """One panel per option in a Sheet; with Matplotlib's ``ax`` all options in these axes, by
        relative severity."""
        from dobc_design.plotting.sweeps import breaking_sheet, plot_breaking

        if ax is not None:
            return plot_breaking(ax, self.sweeps, tolerance=self.tolerance, name=self.name)
        limit = self.period or PeriodLimit(converges=None, fails=None)
        return breaking_sheet(
            self.sweeps,
            tolerance=self.tolerance,
            name=self.name,
            period=limit.converges,
            certified=limit.certified,
        )

    def _card(self) -> Card:
        errors = f"late errors above {self.tolerance:.0%} of the start, natural units"
        found = ", ".join(self.order) or "nothing in the range tried"
        return Card(
            title=self.name,
            text=f"what breaks first ({errors}): {found}",
            heads=("stress", "holds at", "breaks at", "unit"),
            rows=[(each.option, each.survives, each.breaks, each.unit) for each in self.sweeps],
            lines=() if self.period is None else (f"Sampling period: {self.period}",),
        )

    def to_json(self) -> Document:
        """JSON types: late errors are null where a run diverged."""
        return {
            "tolerance": self.tolerance,
            "order": list(self.order),
            "sweeps": [each.to_json() for each in self.sweeps],
            "period": None if self.period is None else asdict(self.period),
        }


@shows_progress
def what_breaks_first(
    problem: Source,
    *,
    options: Sequence[str] | None = None,
    signal: Signal | None = None,
    start: Given | None = None,
    t_final: float | None = None,
    seed: int | None = None,
    tolerance: float = TOLERANCE,
    certificate: Certificate | None = None,
    progress: Reports[float] = None,
) -> Breaking:
    """Make noise, disturbance, saturation, sampling, delays, packet loss and failures worse, each
    until the loop breaks; what [readings] and [processor] state is there beside.

    ``options``: some of these (default all).  ``certificate``: its certified sampling period, where
    it has one, stands beside the longest that was seen to work.  A run breaks if its late error is
    above ``tolerance`` times that at the start.  ``signal``, ``start``, ``t_final`` (s), ``seed``
    and ``progress`` are as in ``simulate``.

    Natural scales, to which severities are relative: noise, the error at the start; disturbance and
    saturation, the largest |u| without stress (a bound counts as 1 - bound/|u|); period and delay
    (of all readings, of oneself, too), 1 over the fastest decay at the consensus; loss, 1;
    failures, which vanish in a random order at a tenth of the horizon, the number of agents.
    Returns: a Breaking, the data of one figure.  Raises: SpecError for an unknown option, or if the
    loop does not converge without any stress.
    """
    options = _known(OPTIONS if options is None else options)
    tolerance = positive(tolerance, "tolerance", example="0.1")
    report = report_to(progress)
    problem = with_observer(load_problem(problem))
    problem.require("the search for the stress that breaks a loop")
    remark = None
    if signal is None:
        signal, remark = signal_of(problem)
    setting = make_setting(
        problem,
        gain=observer_gain(loop_of(problem)),
        signal=signal,
        start=start,
        t_final=t_final,
        seed=seed,
        samples=SAMPLES,
        tolerance=COARSE,
    )
    loop = _Tried(setting=setting, calm=run_once(setting), tolerance=tolerance)
    if not _late_error(loop.calm, Stress()) <= tolerance:
        message = (
            "the loop must converge without stress before stress is added; it does not converge "
            f"in {loop.calm.t_final:g} s."
        )
        cure = "Choose a longer horizon, or see what `dobc certify` says."
        raise refused("t_final", message, cure)
    sweeps = []
    limit = None
    for number, option in enumerate(options):
        report(number / len(options))
        sweep = loop.sweep(option)
        sweeps.append(sweep)
        if option == "period":
            limit = loop.bisected(sweep.survives, sweep.breaks, certified=_certified(certificate))
    report(1.0)
    # what had to be chosen stands in the notes of the run that is shown
    calm = loop.calm
    if remark is not None:
        calm = replace(calm, notes=(remark, *calm.notes))
    return Breaking(
        name=problem.name,
        t_final=calm.t_final,
        tolerance=tolerance,
        sweeps=tuple(sweeps),
        period=limit,
        calm=calm,
    )


def _known(options: Sequence[str]) -> Sequence[str]:
    """The options.  Raises: SpecError for an unknown one, or for none."""
    unknown = [option for option in options if option not in OPTIONS]
    if unknown or not options:
        got = str(unknown[0])[:40] if unknown else "none"
        message = f"must be among {', '.join(OPTIONS)}; got {got}."
        raise wrong("options", message, "Leave it out for all of them.")
    return options


def _certified(certificate: Certificate | None) -> float | None:
    """The certified sampling period in s, if there is one."""
    if certificate is None:
        return None
    period = certified_period(loop_of(certificate.problem), certificate.claims)
    return None if period is None else float(period)


def _late_error(run: Trajectory, stress: Stress) -> float:
    """The late error of the agents that work, over the error at the start; inf where the run
    diverged."""
    gone = {each.agent for each in stress.failures}
    # of failed agents nothing can be expected
    working = [place for place, label in enumerate(run.labels) if label not in gone]
    if run.diverged or not working:
        return np.inf
    error = np.abs(run.errors())
    late = error[run.times >= LATE * run.t_final][:, working]
    if run.sides.size:  # the disagreement of those that work
        late = late - late.min(axis=1, keepdims=True)
    return float(late.max() / max(float(error[0].max()), TINY))


class _Step(NamedTuple):
    """How severe a stress is: in its unit, and relative to what is natural."""

    severity: float
    relative: float
    stress: Stress
    timing: Timing | None = None  # that of the problem where it is None


@noun(eq=False)
class _Tried:
    """The loop whose stress grows, with its run without any."""

    setting: Setting
    calm: Trajectory
    tolerance: float

    def late(self, step: _Step) -> float:
        """The late error of a run at this step."""
        # with the same seed as the run without stress
        timing = self.setting.exact.timing if step.timing is None else step.timing
        run = run_once(self.setting.under(step.stress, timing))
        return _late_error(run, step.stress)

    def sweep(self, option: str) -> Sweep:
        """One option from mild to severe, up to the first that breaks the loop."""
        done = []
        errors = []
        survives = None
        broken = None
        for step in self.steps(option):
            done.append(step)
            errors.append(self.late(step))
            if not errors[-1] <= self.tolerance:
                broken = step
                break
            survives = step.severity
        unit = UNITS[option]
        if self.setting.problem.dynamics is not None and option in OF_INPUTS:
            unit = "unit of u"
        elif self.setting.problem.unit:
            unit = unit.replace("unit of x", self.setting.problem.unit)
        return Sweep(
            option=option,
            unit=unit,
            severity=np.array([step.severity for step in done]),
            relative=np.array([step.relative for step in done]),
            late=np.array(errors),
            survives=survives,
            breaks=None if broken is None else broken.severity,
            relative_break=None if broken is None else broken.relative,
        )

    def steps(self, option: str) -> Iterator[_Step]:
        """What is tried of an option."""
        if option in ("period", "delay"):
            # short ones cost much and break nothing
            yield from self.times(option, DOUBLED[2:])
        elif option == "failures":
            yield from self.failures()
        else:
            peak = max(float(np.abs(self.calm.u).max()), TINY)
            natural = {"noise": float(self.calm.error()[0]), "loss": 1.0}.get(option, peak)
            for k in MULTIPLES.get(option, DOUBLED):
                size: Any = natural * k
                relative = 1 - k if option == "saturation" else k
                yield _Step(size, relative, Stress(**{option: size}))

    def times(self, option: str, multiples: Array) -> Iterator[_Step]:
        """Periods or delays in multiples of the fastest time constant, four of which fit into the
        horizon."""
        exact = self.setting.exact
        loop = self.setting.loop
        if loop.steps and option == "period":  # a step takes no time
            return
        decays = [fastest_decay(loop, error_arcs(exact, mode)) for mode in exact.modes]
        fastest = max(observer_decay(loop), *decays, 1 / self.calm.t_final)
        for k in multiples:
            time = k / fastest
            if self.calm.t_final >= 4 * time:
                yield self.timed(option, time)._replace(relative=time * fastest)

    def timed(self, option: str, time: float) -> _Step:
        """A period or a delay of so many s."""
        timing = self.setting.exact.timing or Timing()
        exact = Fraction(time)
        if option == "delay":
            late = replace(timing, delay=exact, own_delay=exact)
            return _Step(time, 0.0, Stress(), late)
        if timing.period:
            return _Step(time, 0.0, Stress(), replace(timing, period=exact))
        return _Step(time, 0.0, Stress(period=time))

    def failures(self) -> Iterator[_Step]:
        """Ever more agents vanish, in a random order."""
        labels = self.calm.labels
        order = default_rng([self.calm.seed, 5]).permutation(len(labels))
        gone = [Failure(agent=labels[i], time=0.1 * self.calm.t_final) for i in order]
        if len(gone) < 2:
            return
        counts = np.linspace(1, len(gone) - 1, MOST_FAILURES).round().astype(int)
        for count in np.unique(counts).tolist():
            yield _Step(float(count), count / len(gone), Stress(failures=tuple(gone[:count])))

    def bisected(
        self, low: float | None, high: float | None, *, certified: float | None
    ) -> PeriodLimit:
        """Between a period that converged and one that did not; convergence need not be monotone in
        the period."""

        def converges(period: float) -> bool:
            return self.late(self.timed("period", period)) <= self.tolerance

        if low is not None and high is not None:
            low, high = bisected(converges, low, high, steps=BISECTIONS)
        return PeriodLimit(converges=low, fails=high, certified=certified)
