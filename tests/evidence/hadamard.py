"""Symmetric matrices whose definiteness is known and hard to see, put to every path of
``exact.definite``.

See ``edge_matrices``: one eigenvalue is 0 or +-2^-28 to +-2^-47, and the entries are exact as
floats, so that NumPy is asked the same question.
"""

from collections import Counter
from random import Random

import numpy as np
from definiteness import EXACT, PATHS, POWERS, edge_matrices, numpy_cholesky
from evidence.row import Row

from dobc_design.verdict import Verdict

SIZES = (4, 16, 64)


def run(count: int, seed: int) -> Row:
    failures: list[str] = []
    decided: Counter[str] = Counter()
    asked: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    repeats = -(-count // (3 * len(POWERS) * len(SIZES)))
    matrices = list(edge_matrices(SIZES, seed=seed, repeats=repeats))
    chosen = Random(seed).sample(matrices, min(count, len(matrices)))
    for number, (small, floats) in enumerate(chosen):
        truth = small > 0
        for name, path in PATHS.items():
            verdict = path(floats)
            if verdict is None:
                continue
            asked[name] += 1
            decided[name] += verdict is not Verdict.UNDECIDED
            lie = Verdict.REFUTED if truth else Verdict.PROVED
            if verdict is lie or (verdict is Verdict.UNDECIDED and name in EXACT):
                failures.append(
                    f"seed {seed}, number {number}: {float(small):.3g}, {name}: {verdict.value}"
                )
        lowest = float(np.linalg.eigvalsh(floats)[0])
        opinions = {
            "cholesky": numpy_cholesky(floats),
            "eigvalsh > 0": lowest > 0,
            "eigvalsh > 1e-10": lowest > 1e-10,
        }
        wrong.update(
            f"{name} {'rejects' if truth else 'accepts'}"
            for name, each in opinions.items()
            if each != truth
        )
    return Row(
        "definiteness of Hadamard edge matrices, n = 4, 16, 64, by every path",
        len(chosen),
        failures,
        [
            "decided: " + ", ".join(f"{name} {decided[name]} of {asked[name]}" for name in PATHS),
            "NumPy is wrong: "
            + ", ".join(f"{name} {times}" for name, times in sorted(wrong.items())),
        ],
        least=min(count, 240),
    )
