"""Starts on the boundary of proved sets, at random, at corners and at edges: none may leave
or be slower."""

import itertools
from collections.abc import Iterator
from fractions import Fraction
from random import Random
from statistics import median

import regional_problems
from evidence.row import Row
from networks import MONOTONE, PAPER, TURNING, random_problem

from dobc_design import Observer, Problem
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.propose import design_lure, raise_rate
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.propose import (
    Cover,
    first_certificate,
    propose_separable,
    rounded_vectors,
)
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.falsification.search import Question, search_starts
from dobc_design.loop.make import loop_of

PROBLEMS = 24  # at least 20 are wanted
HORIZON = 15.0  # s
LEAST = 20
KINDS = ("monotone", "turning", "observer", "quadratic")
W = regional_problems.PAPER_GAIN


def run(count: int, seed: int) -> Row:
    """``count`` starts, shared evenly among PROBLEMS problems at most."""
    failures: list[str] = []
    ratios: dict[str, list[float]] = {kind: [] for kind in KINDS}
    tried = unfinished = 0
    each = max(10, -(-count // PROBLEMS))
    problems = -(-count // each)
    for number, (name, problem, certified) in enumerate(_proved(seed)):
        question = Question(runs=each, seed=seed + number, certified=certified, t_final=HORIZON)
        gain = None if problem.exosystem is None else W
        found = search_starts(problem, question, gain=gain)
        tried = tried + found.tried
        unfinished = unfinished + found.unfinished
        failures += [f"{name}: {suspect}" for suspect in found.suspects]
        if found.observed_rate is None or not found.certified_rate:
            failures.append(f"{name}: no rate was seen")
            continue
        ratios[name.split()[0]].append(found.certified_rate / found.observed_rate)
        if number + 1 == problems:
            break
    seen = sum(map(len, ratios.values()))
    if seen < LEAST * problems // PROBLEMS:
        failures.append(f"only {seen} problems had a certificate and a rate")
    notes = (
        f"{seen} problems; certified rate / slowest observed rate, median (least to "
        "largest) by kind:",
        *(
            f"{kind}: {median(own):.3f} ({min(own):.3f} to {max(own):.3f})"
            for kind, own in ratios.items()
            if own
        ),
        f"{unfinished} runs took too many steps",
    )
    what = "starts on the boundary of certified sets: none leaves, all decay at least as certified"
    return Row(what, tried - unfinished, failures, notes, least=count * 99 // 100)


def _proved(seed: int) -> Iterator[tuple[str, Problem, Separable | Lure]]:
    """Random problems with a proved certificate, of four kinds in turn; draws without one are
    passed over."""
    made = dict(zip(KINDS, (_monotone, _turning, _observed, _quadratic), strict=True))
    for turn in itertools.count():
        kind = KINDS[turn % 4]
        problem, certified = made[kind](seed + turn)
        if certified is not None:
            yield f"{kind} {seed + turn}", problem, certified


def _monotone(seed: int) -> tuple[Problem, Separable | None]:
    problem = random_problem(seed, couplings=MONOTONE, modes=2, held=True)
    return problem, _box(problem, Random(seed).choice((Fraction(1, 2), Fraction(1), Fraction(2))))


def _turning(seed: int) -> tuple[Problem, Separable | None]:
    problem = random_problem(seed, couplings=TURNING, modes=2, held=True)
    return problem, _box(problem, Fraction(1, 4))


def _observed(seed: int) -> tuple[Problem, Separable | None]:
    problem = random_problem(
        seed,
        couplings=MONOTONE,
        modes=2,
        n=4,
        held=True,
        exosystem=regional_problems.HARMONIC,
        observer=Observer(W=W),
    )
    cover = Cover(loop=loop_of(problem), radius=Fraction(1), disturbance=Fraction(1, 2), W=W)
    plan = cover.fastest()
    return problem, None if plan is None else first_certificate(loop_of(problem), W, plan)


def _quadratic(seed: int) -> tuple[Problem, Lure | None]:
    r = Random(f"quadratic {seed}")
    problem = regional_problems.random_problem(
        seed, coupling=r.choice(("tanh(y)", "sin(y)", PAPER)), modes=r.choice((1, 2))
    )
    lure = design_lure(
        loop_of(problem),
        holds=lambda each: regional_problems.is_proved(problem, each),
        shape=r.choice(("diagonal", "full")),
        largest=Fraction(3),
    )
    if lure is None:
        return problem, None
    faster = raise_rate(
        loop_of(problem), lure, holds=lambda each: regional_problems.is_proved(problem, each)
    )
    return problem, faster if faster.rate > 0 else None


def _box(problem: Problem, rho: Fraction) -> Separable | None:
    proposal = propose_separable(loop_of(problem), rho=float(rho))
    if proposal is None:
        return None
    v = list(rounded_vectors(proposal))[2]
    alpha = largest_rate(loop_of(problem), v, rho=rho)
    if alpha is None:
        return None
    return Separable(v=v, alpha=alpha, rho=rho)
