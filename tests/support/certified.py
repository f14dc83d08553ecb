"""Certificates made once in a run, for tests that look at them and not at how they come about.

The workers of a run share them through a folder that lives as long as the run: what one has made
the other reads.
"""

import hashlib
import json
import os
import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest

from dobc_design import Certificate, Problem, certify, load_problem
from dobc_design.certificate.claims import Claims
from dobc_design.certificate.topics import Trusted
from dobc_design.certification import certify as certification
from dobc_design.certification.recheck import confirm
from dobc_design.conditions.accuracy import stage as accuracy
from dobc_design.conditions.check import Check, check_from_json
from dobc_design.conditions.consensus.claim import Statements
from dobc_design.conditions.coverage import asked_radius
from dobc_design.conditions.domain import NEAR_TARGET, Domain
from dobc_design.conditions.observer.propose import observer_gain
from dobc_design.conditions.schedule import propose, propose_cycles, rows
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.conditions.schedule.stage import settle, starts_given
from dobc_design.conditions.separable import propose_coordinates
from dobc_design.conditions.weighted import propose as weighted_network
from dobc_design.conditions.weighted import propose_alike as weighted_alike
from dobc_design.exact.matrix import Matrix
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import (
    canonical_bytes,
    canonical_document,
    problem_from_canonical,
)

#: The environment variable that names the folder; ``conftest.py`` makes it.
FOLDER = "DOBC_TESTS_OF_THIS_RUN"
#: Set where it is asked which tests walk which lines: then nothing is shared.
FRESH = "DOBC_TESTS_FRESH"
LONGEST = 120.0  # seconds that one worker waits for what another makes

MADE: dict[tuple[object, ...], Certificate] = {}


def made_once(key: str, make: Callable[[], Any]) -> Any:
    """What ``make`` returns, made by the first worker that asks for ``key``."""
    folder = os.environ.get(FOLDER)
    if folder is None or FRESH in os.environ:
        return make()
    path = Path(folder) / hashlib.sha256(key.encode()).hexdigest()
    lock = path.with_suffix(".lock")
    end = time.monotonic() + LONGEST
    while not path.exists():
        try:
            lock.touch(exist_ok=False)
        # another worker makes it; one that is gone is not waited for for ever
        except FileExistsError:
            if time.monotonic() > end:
                lock.unlink(missing_ok=True)
            time.sleep(0.01)
            continue
        try:
            result = make()
            part = path.with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(result))
            part.replace(path)
        finally:
            lock.unlink(missing_ok=True)
        return result
    return pickle.loads(path.read_bytes())


def certified(
    problem: Problem | str, *, everything: bool = False, settling: object = None
) -> Certificate:
    """What ``certify`` gives, of a built-in problem or another one."""
    problem = load_problem(problem)
    make = partial(certify, problem, everything=everything, settling=settling)
    if FRESH in os.environ:
        return make()
    key = (problem, everything, settling)
    if key not in MADE:
        text = canonical_bytes(problem).decode()
        MADE[key] = made_once(f"certificate {everything} {settling} {text}", make)
    return MADE[key]


def certify_once(problem: Any, *, progress: object = None, **options: Any) -> Certificate:
    """``certify``, to be put in its place; what is asked beside the usual is made anew."""
    asked = {name: value for name, value in options.items() if value is not None}
    if asked.keys() <= {"everything", "settling"}:
        return certified(problem, **asked)
    return certify(problem, **asked)


def consensus_claims(problem: Problem) -> Claims:
    """What ``certify`` claims of network, observer, theorems and linearisation alone: nothing is
    searched for, and no factors are stated, so that the largest rate counts."""
    if FRESH in os.environ:
        return claimed_afresh(problem)
    return _claimed(problem)


def claimed_afresh(problem: Problem) -> Claims:
    """The same, made anew."""
    with pytest.MonkeyPatch.context() as patch:
        for stage in (
            "region_checks",
            "safety_stage",
            "accuracy_stage",
            "inputs_stage",
            "other_equilibria",
        ):
            patch.setattr(certification, stage, lambda *arguments, **options: [])
        patch.setattr(certification, "with_cures", lambda problem, found, **options: found.checks)
        patch.setattr(certification, "agreed", lambda claims, problem: claims)
        patch.setattr(certification, "with_factors", lambda case: case.checks)
        # without factors no smaller rate is sooner
        patch.setattr(weighted_network, "soonest_weights", lambda *arguments: None)
        patch.setattr(weighted_alike, "_soonest", lambda *arguments: iter(()))
        return certify(problem).claims


_claimed = cache(claimed_afresh)


def through_json(check: Check) -> Check:
    """The check as a file holds it."""
    return check_from_json(json.loads(json.dumps(check.to_json())))


def confirmed(
    check: Check,
    problem: Problem,
    *,
    W: Matrix | None = None,
    domain: Domain = NEAR_TARGET,
    beside: Check | None = None,
) -> str | None:
    """None, or what is wrong with a regional check; errors count as refusals.  ``beside``: the
    max-separable check."""
    read = through_json(check)
    statements = Statements(
        loop=loop_of(problem), domain=domain, jacobians=None, lambdas={}, inapplicable=None
    )
    trusted = Trusted(
        loop=loop_of(problem),
        W=W,
        domain=domain,
        checks=(beside or read,),
        statements=statements,
        pair=None,
    )
    try:
        return confirm(read, trusted)
    except (ValueError, TypeError, KeyError, ArithmeticError) as error:
        return str(error) or type(error).__name__


REGIONAL = ("max-separable", "delay", "sampling", "lure", "equilibrium")


def without_region(problem: Problem | str) -> Problem:
    """The same problem, asked about the consensus itself."""
    document = canonical_document(load_problem(problem) if isinstance(problem, str) else problem)
    return problem_from_canonical(json.dumps(document | {"region": None}).encode("utf-8"))


def at_the_consensus(checks: Iterable[Check]) -> list[Check]:
    """The checks that speak of the consensus."""
    return [check for check in checks if check.id not in REGIONAL]


#: Of weights that move: half the rate of the fastest ones, in chords that may bend.
HALF_AS_FAST = ((0.5, 0.005, 0.005), (0.25, 0.02, 0.02), (0.04, 0.2, 0.2))
#: Of boxes that move: the first three are for signals with a guarantee, the last one for all
#: others.
BENT_BOXES = ((0.02, 0.02), (0.05, 0.1), (0.05, 0.1), (0.05, 0.1))


@contextmanager
def _in_place(*changes: tuple[Any, str, object]) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for place, name, value in changes:
            patch.setattr(place, name, value)
        yield


def coarse_tables() -> Any:
    """Tables of couplings, in rows that move, have an eighth of their cells.  A context, or a
    decorator of a test."""
    return _in_place((rows, "CELLS", 256))


def few_chords(tried: object = HALF_AS_FAST) -> Any:
    """Weights and boxes that move do so in few chords.  A context, or a decorator of a test."""
    return _in_place((propose_cycles, "TRIED", tried), (propose, "TRIED", BENT_BOXES))


def few_coordinates() -> Any:
    """Coordinates are looked for at every fifth place.  A context, or a decorator of a test."""
    return _in_place((propose_coordinates, "PARTS", propose_coordinates.PARTS[1::5]))


def rough_settling() -> Any:
    """Few chords and coarse tables, and quadratic certificates of one radius.  A context, or a
    decorator of a test."""
    fewer_cells = (rows, "CELLS", 256)
    one_radius = (propose, "RADII", propose.RADII[:1])
    return _in_place(fewer_cells, (propose, "TRIED", BENT_BOXES), one_radius)


def few_steps() -> Any:
    """The response of an observer is followed in few steps.  A context, or a decorator of a
    test."""
    return _in_place((accuracy, "FINENESS", accuracy.FINENESS[:1]))


def only(*stages: Callable[..., Any]) -> Any:
    """`certify` looks for regions by these stages alone.  A context, or a decorator of a test."""
    return _in_place((certification, "STAGES", stages))


def settling_alone(
    problem: Problem | str,
    *,
    tolerance: object = "1/1000",
    radius: object = None,
    disturbance: object = None,
) -> Settling:
    """The settling time that `certify` proves, without its other conditions; by default from the
    [region]."""
    loop = loop_of(load_problem(problem) if isinstance(problem, str) else problem)
    asked = starts_given(
        loop,
        tolerance=tolerance,
        radius=max(asked_radius(loop)) if radius is None else radius,
        disturbance=disturbance,
    )
    return settle(loop, observer_gain(loop), asked, progress=lambda stage: None)
