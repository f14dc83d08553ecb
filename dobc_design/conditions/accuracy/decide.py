"""Final bounds of the error under [uncertainty]: what a proved ``accuracy`` claims (theory, section 12).

The plant is x_i' = sum_j w h_ij(x_j - x_i) + u_i + d_i + w_i with |w_i| <= omega, xi_i' = A xi_i + g_i with |g_i| <=
gamma, and every measured state may be off by nubar (by component, all).  Then every start of the domain ends with
|e_i| <= bounds_i, for arbitrary switching, and no start of it leaves the box |e_i| <= rho v_i of the first stage.

With F = A - WC and H_i = sum_j w sup |h'|, what acts on agent i besides its row and a part of the estimation error
that decays by itself is at most (theory, What the model leaves out)

    b_i = omega (1 + peak of W) + gamma (peak of I) + nubar (|k_i| + |C W| + peak of F W) + 2 nubar H_i (1 + peak of W)

and where rows with b_i added stay <= -alpha s v_i for all s in [level, rho], N reaches the level in finite time and
stays below it, if kappa beta min v > 1 for the part of V that is the observer's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from typing import Any, Final

from dobc_design.conditions.check import Check, Domain, read_domain, read_object, undecided_check
from dobc_design.conditions.numbers import read_rational, rounded_up, vector_from_json, vector_to_json
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.separable import claim as separable
from dobc_design.conditions.separable.checks import obstacle as not_applicable
from dobc_design.conditions.separable.claim import FACES, OBSERVED, ErrorBound, Row, Separable, error_from_json
from dobc_design.conditions.separable.decide import (
    coupling_profiles,
    covers,
    decide_row,
    error_bound_obstacle,
    linear_bound,
)
from dobc_design.coupling.enclosures import Profile, jet
from dobc_design.coupling.tree import ZERO
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, multiply
from dobc_design.exact.number import number_text
from dobc_design.exact.peaks import peak_gains, row_norm
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.problem.groups import gains_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

MOST_STAGES: Final = 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One stage: for all s in [level, rho] the box |e_i| <= s v_i shrinks, N = max |e_i|/v_i falling at least at the
    rate alpha.  ``rho`` None: for all s >= level (linear couplings).  All numbers > 0."""

    v: Vector | Doubles
    alpha: Fraction
    level: Fraction
    rho: Fraction | None

    def to_json(self) -> dict[str, Any]:
        """The exact values as text."""
        numbers = {name: number_text(getattr(self, name)) for name in ("alpha", "level")}
        return {"v": vector_to_json(self.v), **numbers, "rho": None if self.rho is None else number_text(self.rho)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Peaks:
    """How far the observer passes on what the model leaves out, F = A - WC: upper bounds of the integrals of
    |C exp(F t) W| (``disturbance``), |C exp(F t)| (``drift``), and of |C exp(F t) F W|, plus |C W| (``measurement``),
    row sums, in every group of agents.  Shown in ``steps`` steps of ``step`` (s)."""

    disturbance: Fraction
    drift: Fraction
    measurement: Fraction
    step: Fraction
    steps: int

    def to_json(self) -> dict[str, Any]:
        """The exact values as text."""
        names = ("disturbance", "drift", "measurement", "step")
        return {**{name: number_text(getattr(self, name)) for name in names}, "steps": self.steps}


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Stages from the outside inwards, and ``bounds``: label -> final bound of |e_i|.  ``peaks``: with an exosystem;
    ``error``: with one, where the couplings are not linear."""

    stages: tuple[Level, ...]
    bounds: Mapping[str, Fraction]
    peaks: Peaks | None = None
    error: ErrorBound | None = None

    def to_json(self) -> dict[str, Any]:
        """The exact values of a proved check."""
        values: dict[str, Any] = {"stages": [stage.to_json() for stage in self.stages]}
        values["bounds"] = {label: number_text(bound) for label, bound in self.bounds.items()}
        if self.peaks is not None:
            values["peaks"] = self.peaks.to_json()
        return values if self.error is None else values | self.error.to_json()


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Accuracy:
    """What a proved check of this topic claims, for this problem."""
    curved = bool(problem.groups) and not problem.is_linear
    names = ("stages", "bounds", *(("peaks",) if problem.groups else ()), *(OBSERVED if curved else ()))
    values = read_object(check.exact, names)
    if not isinstance(values["stages"], list) or not 1 <= len(values["stages"]) <= MOST_STAGES:
        raise ValueError(f"it needs between 1 and {MOST_STAGES} stages")
    stages = tuple(_read_level(each, problem) for each in values["stages"])
    bounds = read_object(values["bounds"], problem.network.labels)
    peaks = None
    if problem.groups:
        found = read_object(values["peaks"], ("disturbance", "drift", "measurement", "step", "steps"))
        if type(found["steps"]) is not int:
            raise TypeError("steps must be an integer")
        numbers = {name: read_rational(found[name]) for name in found if name != "steps"}
        peaks = Peaks(**numbers, steps=found["steps"])
    return Accuracy(
        stages=stages,
        bounds={label: read_rational(bounds[label]) for label in problem.network.labels},
        peaks=peaks,
        error=error_from_json(values, problem) if curved else None,
    )


def _read_level(data: object, problem: Problem) -> Level:
    values = read_object(data, ("v", "alpha", "level", "rho"))
    if (values["rho"] is None) != problem.is_linear:
        raise ValueError("rho must be null exactly where every coupling is linear")
    rho = None if values["rho"] is None else read_rational(values["rho"])
    v = vector_from_json(values["v"], problem.n)
    stage = Level(v=v, alpha=read_rational(values["alpha"]), level=read_rational(values["level"]), rho=rho)
    if min(stage.alpha, stage.level, least(v)) <= 0 or (rho is not None and rho < stage.level):
        raise ValueError("v, alpha and level must be > 0, and rho at least level")
    return stage


ID: Final = "accuracy"
MOST_AGENTS: Final = 500
INPUTS: Final = ("disturbance", "drift", "measurement")
_SHOWN: Final = 6  # bounds told in the reason


def obstacle(problem: Problem, W: Matrix | None) -> str | None:
    """Why no final bounds can be shown for the loop with the gain W (q, m); None if they may be."""
    if problem.n > MOST_AGENTS:
        return f"does not apply: final bounds are decided for at most {MOST_AGENTS} agents."
    return not_applicable(problem, W)


def observer_peaks(problem: Problem, W: Matrix, *, step: Fraction, steps: int) -> Peaks | None:
    """The peak gains, the worst of all groups, for the gain W (q, m); None where they are not shown."""
    worst = dict.fromkeys(INPUTS, Fraction(0))
    for group, gain in zip(problem.groups, gains_of(problem.groups, W), strict=True):
        F, C = error_matrix(group.exosystem, gain), group.exosystem.C
        found = peak_gains(F, C, [gain, multiply(F, gain)], step=step, steps=steps)
        if found is None:
            return None
        drift, disturbance, measurement = found
        own = {"disturbance": disturbance, "drift": drift, "measurement": measurement + row_norm(multiply(C, gain))}
        worst = {name: max(value, own[name]) for name, value in worst.items()}
    return Peaks(**worst, step=step, steps=steps)


def loads(problem: Problem, peaks: Peaks | None, stage: Level) -> Iterator[tuple[str, int, Row, Fraction]]:
    """Every row of a stage: mode, agent, row, b_i.  Raises: UndefinedError where a slope has no bound as far out."""
    plant = problem.uncertainty
    if plant is None:
        return
    nubar, curves = plant.measurement, coupling_profiles(problem, stage.v, rho=stage.rho)
    passed = Fraction(0) if peaks is None else peaks.disturbance

    @cache
    def steepest(coupling: int, reach: Fraction) -> Fraction:
        Y = ZERO if stage.rho is None else Interval(Fraction(-1), Fraction(1)) * (stage.rho * reach + 2 * nubar)
        return jet(curves[coupling].curve, Y).slope.magnitude

    for mode in problem.network.modes:
        for agent in range(problem.n):
            ((row, _),) = separable.rows(problem, stage.v, modes=[mode], agents=[agent])
            b = plant.disturbance * (1 + passed)
            b += Fraction(0) if peaks is None else plant.drift * peaks.drift + nubar * peaks.measurement
            if nubar:
                H = sum((term.weight * steepest(term.coupling, term.reach) for term in row.terms), Fraction(0))
                k = problem.pinning.gains.get(agent)
                b += nubar * ((Fraction(0) if k is None else row_norm(k)) + 2 * H * (1 + passed))
            yield mode, agent, row, b


def not_shrinking(problem: Problem, peaks: Peaks | None, stage: Level) -> str | None:
    """Which row of a stage is not proved for all s in [level, rho], in words; None if all are."""
    try:
        profiles = coupling_profiles(problem, stage.v, rho=stage.rho)
        holds = cache(partial(_row_holds, profiles=profiles, stage=stage))
        for mode, agent, row, load in loads(problem, peaks, stage):
            face = next((face for face in FACES if not holds(row, load, face)), None)
            if face is not None:
                who = f"agent {problem.network.labels[agent]} in mode {mode}"
                return f"the {FACES[face]} row of {who} is not shown for all s from {float(stage.level):.6g} on."
    except UndefinedError as error:
        return f"does not apply: {error}"
    return None


def _row_holds(row: Row, load: Fraction, face: int, *, profiles: tuple[Profile, ...], stage: Level) -> bool:
    if stage.rho is None:
        return linear_bound(row, face, profiles) + load / stage.level <= (row.gain - stage.alpha) * row.own
    verdict, _ = decide_row(row, face, profiles, alpha=stage.alpha, rho=stage.rho, start=stage.level, load=load)
    return verdict is Verdict.PROVED


def accuracy_check(problem: Problem, W: Matrix | None, claim: Accuracy, *, domain: Domain, local: str) -> Check:
    """Decide ``claim`` for the starts of ``domain``: PROVED or UNDECIDED; ``local`` is the domain of Lemma 1."""
    check = Check(id=ID, verdict=Verdict.PROVED, domain=domain, claim=claim, reason=_told(problem, claim, domain))
    wrong = confirm(check, problem, W, domain=local)
    return check if wrong is None else undecided_check(ID, local, wrong)


def _told(problem: Problem, claim: Accuracy, domain: Domain) -> str:
    """The final bounds in words, agents with the same bound together."""
    agents: dict[Fraction, list[str]] = {}
    for label, bound in claim.bounds.items():
        agents.setdefault(rounded_up(bound, digits=4), []).append(label)
    told = []
    for bound, who in sorted(agents.items()):
        names = ", ".join(who[:_SHOWN]) + (" and others" if len(who) > _SHOWN else "")
        told.append(f"{float(bound):.6g} (agent{'s' if len(who) > 1 else ''} {names})")
    if len(told) > _SHOWN:
        told[1:-1] = ["..."]
    starts = "every start"
    if not isinstance(domain, str):
        starts += f" with |e_i| <= {domain['radius']:.6g}"
        starts += f" and |eps_i| <= {domain['disturbance']:.6g}" if problem.groups else ""
    inputs = ", ".join(f"{name} {float(x):.6g}" for name in INPUTS if (x := getattr(problem.uncertainty, name)))
    bounds = ", ".join(told).replace(", ..., ", " ... ")
    return f"{starts} ends with |e_i| <= {bounds}, whatever acts within the bounds of [uncertainty]: {inputs}."


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything that a proved check of this topic claims is confirmed, else what is not."""
    if (reason := obstacle(problem, W)) is not None:
        return reason
    if check.verdict is not Verdict.PROVED or check.witness is not None or check.rate is not None:
        return "it can only be proved or undecided, and has no witness and no rate"
    if problem.uncertainty is None:
        return "the problem has no [uncertainty]"
    claim = check.claim if isinstance(check.claim, Accuracy) else read_claim(check, problem, W)
    if not 1 <= len(claim.stages) <= MOST_STAGES:
        return f"it needs between 1 and {MOST_STAGES} stages"
    if claim.peaks is not None and W is not None:
        own = observer_peaks(problem, W, step=claim.peaks.step, steps=claim.peaks.steps)
        if own is None:
            return "the peak gains of the observer are not shown with these steps."
        for name in INPUTS:
            if getattr(own, name) > getattr(claim.peaks, name):
                return f"the peak gain of {name} is not shown to be at most {float(getattr(claim.peaks, name)):.6g}."
    if (wrong := _wrong_starts(check, problem, W, claim, domain)) is not None:
        return wrong
    for before, stage in zip(claim.stages, claim.stages[1:], strict=False):
        if stage.rho is None or any(before.level * x >= stage.rho * y for x, y in zip(before.v, stage.v, strict=True)):
            return "a stage does not hold the box in which the one before ends."
    last = claim.stages[-1]
    if any(bound < last.level * x for bound, x in zip(claim.bounds.values(), last.v, strict=True)):
        return "a bound is below that of the last stage."
    return next((why for stage in claim.stages if (why := not_shrinking(problem, claim.peaks, stage))), None)


def _wrong_starts(check: Check, problem: Problem, W: Matrix | None, claim: Accuracy, domain: str) -> str | None:
    """Whether the first stage holds all starts of the domain until their estimates are right."""
    first, error = claim.stages[0], claim.error
    if first.rho is None:
        return None if check.domain == "global" == domain else "without rho the domain must be global"
    radius, disturbance = read_domain(check.domain, problem, kind="box")
    as_separable = Separable(v=first.v, alpha=first.alpha, rho=first.rho, error=error)
    exosystem = problem.joint_exosystem
    if exosystem is not None:
        if error is None or W is None:
            return "with an [exosystem] it needs P, beta, kappa and size."
        if (why := error_bound_obstacle(exosystem, W, error)) is not None:
            return why
        if not error.kappa * error.beta * as_separable.least > 1:
            return "kappa must exceed 1/(beta min v), or the observer error can raise V."
    start = max(radius, first.level * as_separable.least)
    if not covers(as_separable, radius=start, disturbance=disturbance):
        return "the box of starts, or the level, is not inside the invariant set."
    return None
