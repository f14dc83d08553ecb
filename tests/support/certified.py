"""Certificates made once by each process of tests, for tests that look at them, and not at how they come about."""

from functools import cache

from dobc_design import Certificate, certify

MADE: dict[tuple[object, bool, object], Certificate] = {}


@cache
def certified(name: str) -> Certificate:
    """What ``certify(name)`` gives."""
    return certify(name)


def certify_once(
    problem: object,
    *,
    everything: bool = False,
    settling: object = None,
    time_limit: object = None,
    progress: object = None,
) -> Certificate:
    """``certify``, to be put in its place."""
    key = (problem, everything, settling)
    if time_limit is not None:
        return certify(problem, everything=everything, settling=settling, time_limit=time_limit)
    if key not in MADE:
        MADE[key] = certify(problem, everything=everything, settling=settling)
    return MADE[key]
