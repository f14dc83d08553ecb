"""Random problems whose outputs are measured, against eigenvalues of their whole loops."""

from collections import Counter
from itertools import count as every
from itertools import islice

from evidence.row import Row
from measured import mistaken, random_problems

from dobc_design import certify


def run(count: int, seed: int) -> Row:
    """``count`` of them."""
    failures = []
    verdicts = Counter[str]()
    for number, problem in islice(random_problems(every(seed)), count):
        certificate = certify(problem)
        verdicts[certificate.verdict.value] += 1
        wrong = mistaken(certificate, problem)
        if wrong is not None:
            failures.append(f"{number}: {wrong}")
    notes = [", ".join(f"{n} {verdict}" for verdict, n in sorted(verdicts.items()))]
    what = "measured outputs: verdicts and rates beside the eigenvalues of the whole loop"
    return Row(what, count, failures, notes)
