"""certificate.json of built-in problems: the same bytes for every hash seed, number of threads, and
under -O."""

import os
import subprocess
import sys

from evidence.row import Row

from dobc_design.problem.load import builtin_names

LONG = ("karate-club", "microgrid-ieee14", "uav-swarm")
NAMES = sorted(builtin_names(), key=lambda name: (name in LONG, name))
#: What Python is told, the hash seed, and the threads of linear algebra: each differs from the
#: first in one thing.
VARIANTS = (((), "0", "1"), ((), "1", "1"), ((), "0", "2"), (("-O",), "0", "1"))
CERTIFY = """
import hashlib, sys
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.certify import certify
for name in sys.argv[1:]:
    print(name, hashlib.sha256(certificate_bytes(certify(name).claims)).hexdigest())
"""


def run(count: int, seed: int) -> Row:
    """The first ``count`` problems, the long ones last; one process for each variant."""
    failures, known = [], None
    for options, hashes, threads in VARIANTS:
        told = {
            "PYTHONHASHSEED": hashes,
            "OPENBLAS_NUM_THREADS": threads,
            "OMP_NUM_THREADS": threads,
        }
        command = (sys.executable, *options, "-c", CERTIFY, *NAMES[:count])
        ran = subprocess.run(
            command, env=os.environ | told, capture_output=True, text=True, check=False
        )
        lines = ran.stdout.splitlines()
        known = known or lines
        if ran.returncode or len(lines) != count:
            failures.append(f"{options} {told}: {ran.stderr[-300:]}")
        failures += [
            f"{options} {told}: {line}"
            for line, other in zip(lines, known, strict=False)
            if line != other
        ]
    return Row(
        "certificate.json: the same bytes for other hash seeds, threads, and under -O",
        count,
        failures,
    )
