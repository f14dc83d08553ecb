"""The notebooks with their outputs, each run once from a clean kernel.

A run is kept in docs/_build/notebooks, under a name that holds what it depends on: the notebook,
the package, the versions of constraints.txt and of Python. Tests fill this folder, and so does the
handbook, which runs what is not there.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
KEPT = ROOT / "docs" / "_build" / "notebooks"
LONGEST = 600  # s for a cell, on a slow machine


@cache
def _surroundings() -> bytes:
    """A digest of what every notebook depends on."""
    found = hashlib.sha256(sys.version.encode())
    found.update((ROOT / "constraints.txt").read_bytes())
    for path in sorted((ROOT / "dobc_design").rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            found.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return found.digest()


def kept(path: Path) -> Path:
    """Where the run of this notebook is kept."""
    digest = hashlib.sha256(_surroundings() + path.read_bytes()).hexdigest()
    return KEPT / f"{path.stem}.{digest[:16]}.ipynb"


def _settings() -> dict[str, str]:
    """The kernel's environment: figures go into the notebook, and nobody's own start-up files."""
    own = KEPT / "ipython"
    profile = own / "profile_default"
    profile.mkdir(parents=True, exist_ok=True)
    # Without a warning that kernels talk over TCP: they do so on this machine only.
    quiet = 'c.IPKernelApp.log_level = "ERROR"\n'
    (profile / "ipython_kernel_config.py").write_text(quiet, "utf-8")
    settings = {name: value for name, value in os.environ.items() if name != "MPLBACKEND"}
    return settings | {"IPYTHONDIR": str(own)}


def failure_of(path: Path) -> str:
    """Run every cell and keep the notebook with its outputs; returns the first error, empty without
    one."""
    import nbformat  # takes a second, and tests collect this module
    from nbclient import NotebookClient
    from nbclient.exceptions import CellControlSignal, DeadKernelError

    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=LONGEST)
    try:
        client.execute(cwd=str(path.parent), env=_settings())
    except (CellControlSignal, DeadKernelError) as error:
        return str(error)
    target = kept(path)
    for older in KEPT.glob(f"{path.stem}.*"):
        older.unlink()
    nbformat.write(notebook, target)
    return ""


def run_missing(paths: list[Path]) -> Iterator[str]:
    """Run the notebooks that are not kept, as many at a time as there are processors; says of each
    how long it took.  Raises: RuntimeError with the first error of every notebook that fails."""
    missing = [path for path in paths if not kept(path).exists()]
    if missing:
        yield f"notebooks: {len(missing)} to run; the outputs of others are there"
    failures = []
    started = time.monotonic()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        runs = {pool.submit(failure_of, path): path for path in missing}
        for count, run in enumerate(as_completed(runs), 1):
            name = runs[run].name
            outcome = "ran"
            if run.result():
                failures.append(f"{name}: {run.result()}")
                outcome = "FAILED"
            seconds = time.monotonic() - started
            yield f"notebooks: {count} of {len(missing)}, {name} {outcome} ({seconds:.0f} s)"
    if failures:
        raise RuntimeError("\n".join(failures))
