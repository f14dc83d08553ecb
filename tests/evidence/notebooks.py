"""All notebooks from a clean kernel; the slow tests run the short ones."""

from clean_kernel import NOTEBOOKS, failure_of
from evidence.row import Row


def run(count: int, seed: int) -> Row:
    """The first ``count`` of them; nothing is drawn."""
    found = {path.stem: failure_of(path) for path in NOTEBOOKS[:count]}
    failures = [f"{name}: {said}" for name, said in found.items() if said]
    return Row("notebooks: every cell runs from a clean kernel", len(found), failures, least=count)
