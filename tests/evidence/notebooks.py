"""All notebooks from a clean kernel; the slow tests run the short ones."""

from evidence.row import Row
from notebook_runs import NOTEBOOKS, failure_of


def run(count: int, seed: int) -> Row:
    """The first ``count`` of them; nothing is drawn."""
    found = {path.stem: failure_of(path) for path in NOTEBOOKS[:count]}
    failures = [f"{name}: {said}" for name, said in found.items() if said]
    return Row("notebooks: every cell runs from a clean kernel", len(found), failures, least=count)
