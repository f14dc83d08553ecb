"""Final bounds of the error, decided: peak gains of the observer, rows with a constant part, one stage in the next.

With F = A - WC and H_i = sum_j w sup |h'|, what acts on agent i besides its row and a part of the estimation error
that decays by itself is at most (theory, What the model leaves out)

    b_i = omega (1 + peak of W) + gamma (peak of I) + nubar (|k_i| + |C W| + peak of F W) + 2 nubar H_i (1 + peak of W)

and where rows with b_i added stay <= -alpha s v_i for all s in [level, rho], N reaches the level in finite time and
stays below it, if kappa beta min v > 1 for the part of V that is the observer's.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import cache, partial
from typing import Final

from dobc_design.conditions.accuracy.claim import MOST_STAGES, Accuracy, Level, Peaks, read_claim
from dobc_design.conditions.check import Check, Domain, read_domain, undecided_check
from dobc_design.conditions.numbers import rounded_up
from dobc_design.conditions.observer.decide import error_matrix
from dobc_design.conditions.separable import claim as separable
from dobc_design.conditions.separable.checks import obstacle as not_applicable
from dobc_design.conditions.separable.claim import FACES, Row, Separable
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
from dobc_design.exact.matrix import Matrix, multiply
from dobc_design.exact.peaks import peak_gains, row_norm
from dobc_design.problem.groups import gains_of
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

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
    """Every row of a stage with its b_i: mode, agent, row, b_i.  Raises: UndefinedError where the slope of a coupling
    has no bound as far out as noise may take its argument."""
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
    """None if everything a proved ``accuracy`` claims is confirmed, else what is not.  ``W`` (q, m): the gain of the
    loop; ``domain``: that of Lemma 1.  Raises what a malformed claim raises."""
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
