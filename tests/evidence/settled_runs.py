"""Certified settling times of the paper's examples against simulated runs: no run may cross the envelope."""

from __future__ import annotations

import json
from collections.abc import Iterator
from fractions import Fraction

from evidence.row import Row
from settled import compare

from dobc_design.certificate.certificate import Certificate
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify, verify
from dobc_design.problem.load import load_problem

PROBLEMS = ("paper-fixed", "paper-switching")


def run(count: int, seed: int) -> Row:
    """``count`` random starts, shared by the two problems, and corners of their boxes."""
    failures: list[str] = []
    notes = []
    runs = 0
    for name in PROBLEMS:
        problem = load_problem(name)
        certificate = certify(name, settling="1/1000")
        settling = certificate.settling
        if settling is None or settling.time is None:
            failures.append(f"{name}: {certificate.check('settling').reason}")
            continue
        found = compare(problem, settling, runs=max(1, count // len(PROBLEMS)), seed=seed)
        runs += found.runs
        failures += [f"{name}: {text}" for text in found.crossings]
        failures += [f"{name}: {text}" for text in _wrong_in_the_certificate(certificate, name)]
        notes.append(
            f"{name}: certified {settling.time:.1f} s by {len(settling.stages)} stages,"
            f" slowest simulated {found.settled:.1f} s, ratio {settling.time / found.settled:.2f}"
        )
    what = "certified settling times: no simulated run crosses the envelope"
    return Row(what, runs, failures, notes, least=count)


def _wrong_in_the_certificate(certificate: Certificate, name: str) -> Iterator[str]:
    """Both programs accept the check of the certificate, and refuse a hand-over that is claimed a hundredth lower."""
    if not verify(certificate, name).holds:
        yield "the certificate with the settling time is not accepted"
    data = json.loads(certificate_bytes(certificate.claims))
    (check,) = [each for each in data["checks"] if each["id"] == "settling"]
    for stage in check["exact"]["stages"][1:]:
        own = stage["level"]
        stage["level"] = str(Fraction(own) * Fraction(99, 100))
        twin = verify(json.dumps(data).encode(), name)
        if twin.holds or "settling" not in str(twin.lone_checker):
            yield "a level that is too low for what is handed over is accepted"
        stage["level"] = own
