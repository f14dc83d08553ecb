"""Every bad problem file of tests/support/bad_files.py through the command line, as a user would run it.

Each must end with exit code 2 and one JSON error that names the key; no traceback, no file written.
"""

import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from typing import Any

from bad_files import BAD_FILES, BadFile, listing, write_case
from evidence.row import Row

PROGRAM = "from dobc_design.cli.main import main; main()"


def run(count: int, seed: int) -> Row:
    """All of them, or a seeded choice of ``count``."""
    cases = BAD_FILES if count >= len(BAD_FILES) else Random(seed).sample(BAD_FILES, count)
    with ThreadPoolExecutor(max_workers=2) as pool:
        results = list(pool.map(_wrong, cases))
    skipped = results.count("skipped")
    failures = tuple(
        f"{case.id}: {text}" for case, text in zip(cases, results, strict=True) if text not in ("", "skipped")
    )
    return Row(
        "bad problem files through `dobc certify --json`: exit 2, the key, nothing written",
        len(cases) - skipped,
        failures,
        [f"{skipped} skipped for want of symbolic links"],
    )


def _wrong(case: BadFile) -> str:
    """What is wrong with the answer to a file, "" if nothing."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            write_case(case, folder)
        except OSError:  # no symbolic links
            return "skipped"
        before = listing(folder)
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, "certify", "problem.toml", "--json"],
            cwd=folder,
            check=False,
            capture_output=True,
            timeout=120,
        )
        if done.returncode != 2:
            return f"exit code {done.returncode}"
        if b"Traceback" in done.stderr or b"Traceback" in done.stdout:
            return "a traceback"
        if listing(folder) != before:
            return "something was written"
        return _wrong_text(done.stdout, case.expect_key)


def _wrong_text(output: bytes, key: str) -> str:
    try:
        error: dict[str, Any] = json.loads(output)["error"]
    except (ValueError, KeyError, TypeError):
        return "no JSON error on standard output"
    if set(error) - {"all"} != {"kind", "key", "message", "cure"}:
        return f"fields {sorted(error)}"
    keys = [each["key"] for each in error.get("all", [error])]
    return "" if not key or key in keys else f"the key {key} is not among {keys}"
