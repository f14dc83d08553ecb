"""Bad inputs of exported C code, counted."""

import tempfile
from pathlib import Path

import numpy as np
from c_code_samples import EACH, programs, wrong_cases
from evidence.row import Row


def run(count: int, seed: int) -> Row:
    """``EACH`` cases of a program; half of the programs are in single precision."""
    rng = np.random.default_rng(seed)
    failures = []
    names = []
    with tempfile.TemporaryDirectory() as folder:
        for name, program in programs(Path(folder), seed):
            failures += wrong_cases(name, program, rng, EACH)
            names.append(name)
            if len(names) * EACH >= count:
                break
    what = (
        "bad inputs of exported C code: skipped, counted, and the answers are those of a run "
        "that missed them"
    )
    return Row(what, len(names) * EACH, failures, [f"{len(names)} programs under the sanitizers"])
