"""Sines that act on agents beside the disturbance of the exosystem, each at a frequency of its
own."""

from collections.abc import Sequence

import numpy as np

from dobc_design._checks import noun
from dobc_design.exact.matrix import Array
from dobc_design.problem.network import IndexArray

Band = tuple[float, float, Array]  # low, high (rad/s), amplitude by agent (n, 1, 1)


@noun(eq=False)
class Sines:
    """size sin(frequency t + phase) by agent, input and run: ``frequency`` (rad/s) and ``phase``
    are (n, p, R); ``size`` is one, or (n, 1, 1)."""

    size: float | Array
    frequency: Array
    phase: Array

    def at(self, times: float | Array, chosen: IndexArray | slice) -> Array:
        """At times (k,) of the runs ``chosen``, as many or one: (n, p, k)."""
        angle = self.frequency[..., chosen] * times + self.phase[..., chosen]
        return np.asarray(self.size * np.sin(angle))

    def integral(self, begin: float, end: float) -> Array:
        """Their integrals between two times, (n, p, R)."""
        half = (end - begin) / 2
        # The mean value times the length: no cancellation where the frequency is small.
        shrink = np.sinc(self.frequency * half / np.pi)
        middle = np.sin(self.frequency * (begin + half) + self.phase)
        return np.asarray(self.size * 2 * half * shrink * middle)


def drawn_sines(
    band: Band, streams: Sequence[np.random.Generator], ports: tuple[int, int]
) -> Sines:
    """A sine of each agent and input (n, p), of a frequency in the band and a phase by chance."""
    low, high, size = band
    frequencies = []
    phases = []
    for rng in streams:
        frequencies.append(rng.uniform(low, high, size=ports))
        phases.append(rng.uniform(0, 2 * np.pi, size=ports))
    return Sines(size=size, frequency=np.stack(frequencies, axis=2), phase=np.stack(phases, axis=2))
