"""Certificates made once in a run, for tests that look at them and not at how they come about.

The workers of a run share them through a folder that lives as long as the run: what one has made
the other reads.
"""

import copyreg
import hashlib
import os
import pickle
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from dobc_design import Certificate, Problem, certify, load_problem
from dobc_design.certificate.claims import Claims
from dobc_design.certification import certify as certification
from dobc_design.problem.canonical import canonical_bytes

#: The environment variable that names the folder; ``conftest.py`` makes it.
FOLDER = "DOBC_TESTS_OF_THIS_RUN"
#: Set where it is asked which tests walk which lines: then nothing is shared.
FRESH = "DOBC_TESTS_FRESH"
LONGEST = 120.0  # seconds that one worker waits for what another makes

MADE: dict[tuple[object, ...], Certificate] = {}


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


def made_once(key: str, make: Callable[[], Any]) -> Any:
    """What ``make`` returns, made by the first worker that asks for ``key``."""
    folder = os.environ.get(FOLDER)
    if folder is None:
        return make()
    path = Path(folder) / hashlib.sha256(key.encode()).hexdigest()
    lock, end = path.with_suffix(".lock"), time.monotonic() + LONGEST
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


def certify_once(
    problem: Any, *, time_limit: object = None, progress: object = None, **options: Any
) -> Certificate:
    """``certify``, to be put in its place."""
    rate = options.pop("rate", None)
    if time_limit is not None or rate is not None:
        return certify(problem, time_limit=time_limit, rate=rate, **options)
    return certified(problem, **options)


def consensus_claims(problem: Problem) -> Claims:
    """What ``certify`` claims of network, observer, theorems and linearisation alone: nothing is
    searched for, and no factors are stated, so that the largest rate counts."""
    return claimed_afresh(problem) if FRESH in os.environ else _claimed(problem)


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
        patch.setattr(
            certification, "with_cures", lambda problem, checks, *arguments, **options: checks
        )
        patch.setattr(certification, "agreed", lambda claims, problem: claims)
        patch.setattr(certification, "with_factors", lambda problem, checks, W: checks)
        return certify(problem).claims


_claimed = cache(claimed_afresh)
