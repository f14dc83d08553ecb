"""What breaks first: every stress grows until the loop no longer converges; and the longest period
that still works.

A run converges here if the largest error of the agents that work, over the last tenth of the
horizon, is at most ``tolerance`` times the error at the start.  One seed and one start: an
observation, never a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dobc_design._show.cards import Card, Headed
from dobc_design._show.progress import Reports, report_to, shows_progress
from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.claims import certified_period
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.errors import SpecError, wrong
from dobc_design.problem.arrays import Array, arc_groups
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.load import Source, load_problem
from dobc_design.problem.problem import Problem
from dobc_design.simulation._arguments import positive
from dobc_design.simulation.field import Loop
from dobc_design.simulation.integrate import fastest_decay, observer_decay
from dobc_design.simulation.runs import run_once
from dobc_design.simulation.setting import Failure, Given, Stress, make_setting
from dobc_design.simulation.signals import Signal, signal_of
from dobc_design.simulation.trajectory import Trajectory

Late = Callable[[Stress], float]
UNITS = {
    "noise": "unit of x",
    "disturbance": "unit of x per s",
    "saturation": "unit of x per s",
    "period": "s",
    "loss": "probability",
    "failures": "agents",
}
OPTIONS = tuple(UNITS)
TOLERANCE = 0.1
LATE = 0.9  # part of the horizon after which a run has to be settled
HALVINGS, DOUBLINGS = 6, 6  # of the natural scale of an option, below and above it
BISECTIONS = 10
SAMPLES = 201
COARSE = 1e-6  # relative tolerance of the integrator: errors of ten percent are looked for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodLimit:
    """Sampling periods in s: the longest that converged, the shortest that did not, the certified
    one; or None."""

    converges: float | None
    fails: float | None
    certified: float | None = None

    def __str__(self) -> str:
        words = (
            "no period tried converges"
            if self.converges is None
            else f"converges at {self.converges:.4g} s"
        )
        words += "" if self.fails is None else f", no longer at {self.fails:.4g} s"
        return words + (
            "" if self.certified is None else f"; certified up to {self.certified:.4g} s"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
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
    def order(self) -> tuple[str, ...]:
        """The options that broke the loop, the first to break before the others, by relative
        severity."""
        broken = [
            (each.relative_break, each.option)
            for each in self.sweeps
            if each.relative_break is not None
        ]
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
            period=limit.converges,
            certified=limit.certified,
            name=self.name,
        )

    def _card(self) -> Card:
        text = (
            f"what breaks first (late errors above {self.tolerance:.0%} of the start, natural "
            "units): "
        )
        return Card(
            title=self.name,
            text=text + (", ".join(self.order) or "nothing in the range tried"),
            heads=("stress", "holds at", "breaks at", "unit"),
            rows=[(each.option, each.survives, each.breaks, each.unit) for each in self.sweeps],
            lines=() if self.period is None else (f"Sampling period: {self.period}",),
        )

    def to_json(self) -> dict[str, Any]:
        """JSON types: late errors are null where a run diverged."""
        words = ("option", "unit", "survives", "breaks")
        sweeps = [
            {name: getattr(each, name) for name in words}
            | {"severity": each.severity.tolist(), "relative": each.relative.tolist()}
            | {"late": [late if np.isfinite(late) else None for late in each.late.tolist()]}
            for each in self.sweeps
        ]
        period = None if self.period is None else asdict(self.period)
        return {
            "tolerance": self.tolerance,
            "order": list(self.order),
            "sweeps": sweeps,
            "period": period,
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
    """Make noise, disturbance, saturation, sampling, packet loss and failures worse, each until the
    loop breaks.

    ``options``: some of these (default all).  ``certificate``: its certified sampling period, where
    it has one, stands beside the longest that was seen to work.  A run breaks if its late error is
    above ``tolerance`` times that at the start.  ``signal``, ``start``, ``t_final`` (s), ``seed``
    and ``progress`` are as in ``simulate``.

    Natural scales, to which severities are relative: noise, the error at the start; disturbance and
    saturation, the largest |u| without stress (a bound counts as 1 - bound/|u|); period, 1 over the
    fastest decay at the consensus; loss, 1; failures, which vanish in a random order at a tenth of
    the horizon, the number of agents.
    Returns: a Breaking, the data of one figure.  Raises: SpecError for an unknown option, or if the
    loop does not converge without any stress.
    """
    options, report = OPTIONS if options is None else options, report_to(progress)
    unknown = [option for option in options if option not in OPTIONS]
    if unknown or not options:
        message = (
            f"must be among {', '.join(OPTIONS)}; got "
            f"{str(unknown[0])[:40] if unknown else 'none'}."
        )
        raise wrong("options", message, "Leave it out for all of them.")
    tolerance = positive(tolerance, "tolerance", example="0.1")
    problem = as_integrators(load_problem(problem))
    problem.require_no_leader("the search for the stress that breaks a loop")
    chosen, remark = (signal, None) if signal is not None else signal_of(problem)
    given: dict[str, Any] = {"signal": chosen, "start": start, "t_final": t_final, "seed": seed}
    setting = make_setting(
        problem, gain=observer_gain(problem), samples=SAMPLES, tolerance=COARSE, **given
    )

    def late(stress: Stress) -> float:
        return _late(run_once(replace(setting, stress=None if stress.is_calm else stress)), stress)

    calm = run_once(setting)
    if not _late(calm, Stress()) <= tolerance:
        message = (
            "the loop must converge without stress before stress is added; it does not converge in"
        )
        cure = "Choose a longer horizon, or see what `dobc certify` says."
        raise SpecError(f"{message} {calm.t_final:g} s.", key="t_final", cure=cure)
    sweeps, limit = [], None
    for number, option in enumerate(options):
        report(number / len(options))
        sweeps.append(
            sweep := _sweep(late, tolerance, option, _grid(problem, option, calm, setting.loop))
        )
        if problem.origin is not None and option in ("disturbance", "saturation"):
            sweeps[-1] = replace(sweep, unit="unit of u")
        if option == "period":
            certified = (
                None
                if certificate is None
                else certified_period(certificate.problem, certificate.claims)
            )
            limit = _bisect(late, tolerance, sweep.survives, sweep.breaks)
            limit = limit if certified is None else replace(limit, certified=float(certified))
    report(1.0)
    calm = calm if remark is None else replace(calm, notes=(remark, *calm.notes))
    found: dict[str, Any] = {"sweeps": tuple(sweeps), "period": limit, "calm": calm}
    return Breaking(name=problem.name, t_final=calm.t_final, tolerance=tolerance, **found)


def _late(run: Trajectory, stress: Stress) -> float:
    """The late error of the agents that work, over the error at the start; inf where the run
    diverged."""
    gone = {each.agent for each in stress.failures}
    working = [place for place, label in enumerate(run.labels) if label not in gone]
    if run.diverged or not working:
        return np.inf
    error = np.abs(run.errors())
    return float(
        error[run.times >= LATE * run.t_final][:, working].max()
        / max(float(error[0].max()), 1e-300)
    )


def _grid(
    problem: Problem, option: str, calm: Trajectory, loop: Loop
) -> Iterator[tuple[float, float, Stress]]:
    """Severity, the same in natural units, and the stress; from mild to severe."""
    error, peak = float(calm.error()[0]), max(float(np.abs(calm.u).max()), 1e-300)
    doublings = 2.0 ** np.arange(-HALVINGS, DOUBLINGS + 1)
    if option == "noise":
        yield from ((error * k, k, Stress(noise=error * k)) for k in doublings)
    elif option == "disturbance":
        yield from ((peak * k, k, Stress(disturbance=peak * k)) for k in doublings)
    elif option == "saturation":
        bounds = 0.5 ** np.arange(HALVINGS + DOUBLINGS + 1)
        yield from ((peak * k, 1 - k, Stress(saturation=peak * k)) for k in bounds)
    elif option == "period":
        modes = (fastest_decay(loop, arc_groups(problem, name)) for name in problem.network.modes)
        fastest = max(observer_decay(loop), *modes, 1 / calm.t_final)
        periods = (k / fastest for k in doublings[2:])  # short ones cost much and break nothing
        yield from ((T, T * fastest, Stress(period=T)) for T in periods if calm.t_final >= 4 * T)
    elif option == "loss":
        yield from (
            (p, p, Stress(loss=p))
            for p in (*np.linspace(0.1, 0.9, 9).round(1).tolist(), 0.95, 0.99, 1.0)
        )
    else:
        order = np.random.default_rng([calm.seed, 5]).permutation(len(calm.labels))
        gone = [Failure(agent=calm.labels[i], time=0.1 * calm.t_final) for i in order]
        for count in (
            np.unique(np.linspace(1, len(gone) - 1, 12).round().astype(int)).tolist()
            if len(gone) > 1
            else ()
        ):
            yield float(count), count / len(gone), Stress(failures=tuple(gone[:count]))


def _sweep(
    late: Late, tolerance: float, option: str, grid: Iterator[tuple[float, float, Stress]]
) -> Sweep:
    rows: list[tuple[float, float, float]] = []
    found: dict[str, float | None] = dict.fromkeys(("survives", "breaks", "relative_break"))
    for severity, relative, stress in grid:
        rows.append((severity, relative, late(stress)))
        if not rows[-1][2] <= tolerance:
            found |= {"breaks": severity, "relative_break": relative}
            break
        found["survives"] = severity
    severities, relatives, errors = np.array(rows).reshape(-1, 3).T
    return Sweep(
        option=option,
        unit=UNITS[option],
        severity=severities,
        relative=relatives,
        late=errors,
        **found,
    )


def _bisect(late: Late, tolerance: float, low: float | None, high: float | None) -> PeriodLimit:
    """Between a period that converged and one that did not; convergence need not be monotone in the
    period."""
    if low is not None and high is not None:
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            low, high = (
                (middle, high) if late(Stress(period=middle)) <= tolerance else (low, middle)
            )
    return PeriodLimit(converges=low, fails=high)
