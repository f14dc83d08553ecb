"""What a report is made from: a certificate, and what was computed beside it to be shown."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from dobc_design.certificate import text
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .document import Fact

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory


Prints = tuple[Fact, ...]


def fingerprints(certificate: Certificate) -> Prints:
    """Of the problem and of the certificate, as files."""
    data = text.certificate_bytes(certificate.claims)
    return (
        ("SHA-256 of problem.json", certificate.claims.problem_sha256),
        ("SHA-256 of certificate.json", hashlib.sha256(data).hexdigest()),
    )


@dataclass(frozen=True, kw_only=True)
class Findings:
    """A certificate with what its report shows; what is None or empty is left out."""

    certificate: Certificate
    analysis: Analysis | None = None  # graphs and eigenvalues, in floating point
    trajectory: Trajectory | None = None  # one simulated run
    worst: Trajectory | None = None  # the run with a slow signal that keeps the guarantee
    lambdas: Mapping[str, Matrix] = field(default_factory=dict)  # mode -> Lambda at the target
    searches: Sequence[Falsification] = ()  # for starts that do not converge
    lmi: str = ""  # what a solver says of the block matrix inequality
    kernel: str = ""  # what Coq says of the motions

    @property
    def problem(self) -> Problem:
        """The problem that was certified."""
        return self.certificate.problem

    @property
    def proved(self) -> bool:
        """Whether the overall verdict is."""
        return self.certificate.verdict is Verdict.PROVED

    # Hashing writes the whole certificate, which takes time where it is large.
    @cached_property
    def prints(self) -> Prints:
        """The fingerprints of the problem and of the certificate."""
        return fingerprints(self.certificate)
