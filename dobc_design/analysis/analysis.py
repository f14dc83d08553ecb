"""All diagnostics of a problem in one noun: observability, spectrum, graphs, eigenvalues at the consensus.

Everything here is floating point (but for the graphs) and explains; verdicts come from ``verify``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dobc_design._show.cards import Card, Shown
from dobc_design.analysis.graph import GraphFacts, graph_facts
from dobc_design.analysis.observability import ObservabilityResult, check_observability
from dobc_design.analysis.spectrum import SpectrumResult, check_spectrum
from dobc_design.problem.arrays import Gain, chosen_gain, consensus_jacobian, pinning_matrix
from dobc_design.problem.problem import Problem

MAX_DENSE = 2000  # rows of the largest matrix whose eigenvalues are computed


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeSpectrum:
    """Eigenvalues at the consensus of one mode, in 1/s: of Lambda(J(0)), ascending, and of J(0) - K, slowest first.

    None for both beyond 2000 rows, and where a coupling has a kink at 0.
    """

    mode: str
    lambda_eigenvalues: tuple[float, ...] | None
    loop_eigenvalues: tuple[complex, ...] | None

    @property
    def lambda_max(self) -> float | None:
        """The largest eigenvalue of Lambda(J(0)); below 0 the network part of (18) is met at the consensus."""
        return self.lambda_eigenvalues[-1] if self.lambda_eigenvalues else None

    @property
    def decay_rate(self) -> float | None:
        """-max Re of the eigenvalues of J(0) - K, the decay of small errors when the disturbance is known."""
        return -self.loop_eigenvalues[0].real if self.loop_eigenvalues else None

    def __str__(self) -> str:
        if self.lambda_max is None or self.decay_rate is None:
            return f'mode "{self.mode}": eigenvalues at the consensus not computed'
        return (
            f'mode "{self.mode}": lambda_max(Lambda) = {self.lambda_max:.4g},'
            f" small errors decay at {self.decay_rate:.4g} 1/s"
        )


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Analysis(Shown):
    """Diagnostics of a problem, one entry per mode in ``graphs`` and ``modes``.

    ``observability`` is None without an exosystem, ``spectrum`` also without an observer gain.
    """

    name: str
    observability: ObservabilityResult | None
    spectrum: SpectrumResult | None
    graphs: tuple[GraphFacts, ...]
    modes: tuple[ModeSpectrum, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """The facts in words, one line each."""
        observer = [] if self.observability is None else [f"observability of (A, C): {self.observability}"]
        observer += [] if self.spectrum is None else [str(self.spectrum)]
        return (*observer, *map(str, self.graphs), *map(str, self.modes))

    def __str__(self) -> str:
        return "\n".join([f"{self.name} (diagnostics, not proofs)", *(f"  {line}" for line in self.lines)])

    def _card(self) -> Card:
        return Card(title=self.name, text="(diagnostics, not proofs)", lines=self.lines)

    def __repr__(self) -> str:
        return f"<Analysis of {self.name}, {len(self.modes)} modes>"


def analyse(problem: Problem, *, gain: Gain | None = None) -> Analysis:
    """Collect the diagnostics of a problem; ``gain`` (q, m) takes the place of problem.observer.W.

    Raises: SpecError or ShapeError for a gain that does not fit.
    """
    W = chosen_gain(problem, gain)
    exosystem = problem.joint_exosystem
    modes = tuple(problem.network.modes)
    return Analysis(
        name=problem.name,
        observability=None if exosystem is None else check_observability(exosystem.A, exosystem.C),
        spectrum=None if exosystem is None or W is None else check_spectrum(exosystem.A, exosystem.C, W),
        graphs=tuple(graph_facts(problem, mode) for mode in modes),
        modes=tuple(mode_spectrum(problem, mode) for mode in modes),
    )


def mode_spectrum(problem: Problem, mode: str) -> ModeSpectrum:
    """Compute the eigenvalues of Lambda(J(0)) and of J(0) - K of one mode, up to 2000 rows."""
    jacobian = consensus_jacobian(problem, mode) if problem.n * problem.m <= MAX_DENSE else None
    if jacobian is None:
        return ModeSpectrum(mode=mode, lambda_eigenvalues=None, loop_eigenvalues=None)
    loop = (jacobian - pinning_matrix(problem)).toarray()
    eigenvalues = np.linalg.eigvals(loop)
    slowest_first = np.lexsort((eigenvalues.imag, -eigenvalues.real))
    return ModeSpectrum(
        mode=mode,
        lambda_eigenvalues=tuple(np.linalg.eigvalsh(loop + loop.T).tolist()),
        loop_eigenvalues=tuple(complex(s) for s in eigenvalues[slowest_first]),
    )
