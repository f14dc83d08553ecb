"""`make evidence`: the full counts, one summary table; exit code 1 if any count fails.

`run.py --fuzz-minutes 10` fuzzes for ten minutes of CPU time instead of one; `--only NAME` runs one
item.
"""

import argparse
import os
import sys
import time
import warnings
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "support")]

from evidence.items import FUZZ, ITEMS  # noqa: E402 - found through the paths above
from machine import let_children_hear  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description="The full counts, as one table.")
    parser.add_argument(
        "--fuzz-minutes", type=float, metavar="N", help="minutes of CPU time for fuzzing; default 1"
    )
    parser.add_argument(
        "--only", choices=[item.name for item in ITEMS], action="append", help="run only this item"
    )
    options = parser.parse_args()
    let_children_hear()
    warnings.simplefilter("ignore")  # SciPy's, about the matrices that are bad on purpose
    started = time.perf_counter()
    rows = []
    for item in ITEMS:
        if options.only and item.name not in options.only:
            continue
        before = time.perf_counter()
        longer = item.name == FUZZ and options.fuzz_minutes is not None
        row = item.run(int(60 * options.fuzz_minutes) if longer else item.count, item.seed)
        rows.append(row)
        outcome = "ok    " if row.ok else "FAILED"
        seconds = time.perf_counter() - before
        print(
            f"{outcome} {row.count:>5}  {len(row.failures):>3} wrong  {seconds:>5.0f} s  {row.what}"
        )
        few = [f"too few: at least {row.least} are wanted"] if row.count < row.least else []
        for note in (*row.notes, *few, *(f"WRONG {failure}" for failure in row.failures[:20])):
            print(f"{'':>14}{note}")
        sys.stdout.flush()
    bad = sum(not row.ok for row in rows)
    total = sum(row.count for row in rows)
    seconds = time.perf_counter() - started
    print(f"\n{len(rows)} items, {total} cases, {bad} item(s) failed, {seconds:.0f} s")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
