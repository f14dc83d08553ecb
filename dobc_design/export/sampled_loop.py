"""Is a sampled controller stable, with the very numbers that go into its code?  Decided over the rationals.

The observer: Ad - L Cd as rounded, all eigenvalues in the open unit disk.  The network: I + T (J - K) of every mode at
the consensus, couplings and pinning computed at the multiples of T and held between.  Both are exact; the second is
local, and about staying in one mode.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from dobc_design.conditions.consensus.claim import ModeJacobian, jacobians_at_consensus
from dobc_design.conditions.statement import Statement
from dobc_design.exact.definite import decide_positive_definite, decide_positive_semidefinite
from dobc_design.exact.interval import UndefinedError
from dobc_design.exact.matrix import Matrix, add, identity, multiply, subtract, transpose
from dobc_design.exact.number import number_text
from dobc_design.exact.polynomial import characteristic_polynomial
from dobc_design.exact.root_regions import decide_images, disk_image
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

MOST_ROWS = 40  # n m up to which a sampled network is decided by its characteristic polynomial
MOST_SYMMETRIC = 200  # n m up to which a symmetric one is, by definiteness
_TRIED = 32  # fractions of a period that is too long
_HALVINGS = 40
_BISECTIONS = 10


def sampled_observer_statement(Ad: Matrix, Cd: Matrix, L: Matrix, *, period: Fraction) -> Statement:
    """State whether the error of the sampled observer, eps_(k+1) = (Ad - L Cd) eps_k, dies out: exact.

    Shapes: Ad (q, q), Cd (m, q), L (q, m), the numbers as they stand in the code.  ``period`` in s, for the text.
    """
    verdict = _in_unit_disk(subtract(Ad, multiply(L, Cd)))
    words = {
        Verdict.PROVED: "with the numbers as written, every eigenvalue of the sampled observer is inside the unit disk",
        Verdict.REFUTED: "the sampled observer diverges: an eigenvalue is outside the unit disk",
        Verdict.UNDECIDED: "the error of the sampled observer does not die out: an eigenvalue is on the unit circle",
    }[verdict]
    return Statement(
        kind="sampled",
        verdict=verdict,
        text=f"{words} (period {float(period):.4g} s).",
        exact={"period": number_text(period)},
    )


def sampled_network_statement(problem: Problem, period: Fraction) -> Statement:
    """State whether e_(k+1) = (I + T (J - K)) e_k dies out in every mode: exact, at the consensus.

    UNDECIDED for n m > 40 (200 where J - K is symmetric), for slopes that are not rational, and where an agent that
    nothing pins keeps its error.
    """
    kind, exact = "sampled-network", {"period": number_text(period)}

    def answer(verdict: Verdict, text: str) -> Statement:
        return Statement(kind=kind, verdict=verdict, text=text, exact=exact)

    if problem.n * problem.m > MOST_SYMMETRIC:
        return answer(Verdict.UNDECIDED, f"the sampled network is not decided for more than {MOST_SYMMETRIC} rows.")
    try:
        modes = jacobians_at_consensus(problem).modes
    except UndefinedError:
        return answer(Verdict.UNDECIDED, "the coupling has no derivative at the consensus.")
    found = {mode.name: _mode_verdict(problem, mode, period) for mode in modes}
    bad = [name for name, verdict in found.items() if verdict is Verdict.REFUTED]
    if bad:
        return answer(
            Verdict.REFUTED,
            f'held over {float(period):.4g} s, couplings and pinning drive the agents apart in mode "{bad[0]}": an'
            " eigenvalue of I + T (J - K) lies outside the unit disk.",
        )
    open_modes = [name for name, verdict in found.items() if verdict is Verdict.UNDECIDED]
    if open_modes:
        return answer(
            Verdict.UNDECIDED,
            f'in mode "{open_modes[0]}" it stays open whether the sampled network converges at the consensus: an agent'
            f" that nothing reaches keeps its error, a slope is not rational, or there are more than {MOST_ROWS} rows.",
        )
    return answer(
        Verdict.PROVED,
        "in every mode the sampled network converges near the consensus: all eigenvalues of I + T (J - K) lie inside"
        f" the unit disk (period {float(period):.4g} s).",
    )


def longest_period(works: Callable[[Fraction], bool], asked: Fraction) -> Fraction | None:
    """The longest period below ``asked`` that works, of those tried, three digits, rounded down; None if none does.

    ``works`` need not be monotone: fractions of ``asked`` are tried from the top, then the gap above is halved.
    """
    trials = [asked * k / _TRIED for k in range(_TRIED - 1, 0, -1)]
    trials += [asked / _TRIED / 2**k for k in range(1, _HALVINGS)]
    above = asked
    for trial in trials:
        if works(trial):
            break
        above = trial
    else:
        return None
    low = trial
    for _ in range(_BISECTIONS):
        middle = (low + above) / 2
        low, above = (middle, above) if works(middle) else (low, middle)
    short = _rounded_down(low)
    return short if works(short) else low


def _mode_verdict(problem: Problem, mode: ModeJacobian, period: Fraction) -> Verdict:
    if not mode.is_point:
        return Verdict.UNDECIDED
    n, m = problem.n, problem.m
    rows = [[Fraction(int(i == j)) for j in range(n * m)] for i in range(n * m)]
    for (listener, speaker, _), kind in zip(mode.arcs, mode.kind.tolist(), strict=True):
        for c in range(m):
            for d in range(m):
                slope = mode.gains[kind][c][d].lo * period
                rows[listener * m + c][speaker * m + d] += slope
                rows[listener * m + c][listener * m + d] -= slope
    for agent, gain in problem.pinning.gains.items():
        for c in range(m):
            for d in range(m):
                rows[agent * m + c][agent * m + d] -= period * gain[c][d]
    F = tuple(map(tuple, rows))
    if transpose(F) == F:
        return _symmetric_in_unit_disk(F)
    return _in_unit_disk(F) if len(F) <= MOST_ROWS else Verdict.UNDECIDED


def _symmetric_in_unit_disk(F: Matrix) -> Verdict:
    """The same for a symmetric F: all eigenvalues inside iff I - F > 0 and I + F > 0."""
    one = identity(len(F))
    sides = [SparseSymmetric.from_dense(each) for each in (subtract(one, F), add(one, F))]
    if all(decide_positive_definite(each).verdict is Verdict.PROVED for each in sides):
        return Verdict.PROVED
    inside = all(decide_positive_semidefinite(each).verdict is Verdict.PROVED for each in sides)
    return Verdict.UNDECIDED if inside else Verdict.REFUTED


def _in_unit_disk(F: Matrix) -> Verdict:
    """PROVED: all eigenvalues inside the unit disk; REFUTED: one outside; UNDECIDED: one on its border."""
    image = disk_image(characteristic_polynomial(F), centre=Fraction(0), radius=Fraction(1))
    inside, strictly = decide_images([image], degree=len(F))
    return Verdict.PROVED if strictly else Verdict.UNDECIDED if inside else Verdict.REFUTED


def _rounded_down(value: Fraction) -> Fraction:
    """Three significant digits, not above ``value`` > 0."""
    exponent = 0
    while value * 10**exponent < 100:
        exponent += 1
    while value * Fraction(10) ** exponent >= 1000:
        exponent -= 1
    scale = Fraction(10) ** exponent
    return (value * scale).__floor__() / scale
