"""Certificates of the built-in problems, made once by each process of tests."""

from __future__ import annotations

from functools import cache

from dobc_design.certificate.certificate import Certificate
from dobc_design.certification.certify import certify


@cache
def certified(name: str) -> Certificate:
    """What ``certify(name)`` gives; for tests that look at it, and not at how it comes about."""
    return certify(name)
