"""Certificates of ``claim`` decided: the inner one, then every box of the shell; and the check ``exhaustive``.

Theory, section 4.  docs/certificate-claims.md, "Regions", fixes the form of the check.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.boxes.claim import LEAF, Boxes, Shell, build_forms, energy_bounds, first_box, upper_bounds
from dobc_design.conditions.check import Check, read_object, starts_in, undecided_check
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic import decide as quadratic
from dobc_design.conditions.quadratic.decide import LureDecision, border_of, covers, diagonal_of_inverse, verify_lure
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import float_above, float_below
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: The keys of ``exact`` beside those of ``lure``.
NAMES: Final = ("outer", "half", "tree")
CHUNK: Final = 20_000  # boxes looked at together
MOST_BOXES: Final = 4_000_000
MOST_HALVINGS: Final = 30  # of one component: then all ends of boxes are exact in float64


def verify_shell(problem: Problem, shell: Shell) -> LureDecision:
    """Decide whether {V <= outer} is invariant and V' <= -2 rate V in it, for every mode.  Refuted: the inner
    certificate is, or the boxes do not fit.  Undecided: a box is not shown to be harmless; the step is then "boxes".
    Raises: SpecError for more than 6 rows n m or couplings of vectors."""
    inner = verify_lure(problem, shell.lure)
    if inner.verdict is not Verdict.PROVED:
        return inner
    # Outer (P_e^-1)_kk <= half^2 for every k.
    if not all(shell.outer * square <= shell.half**2 for square in diagonal_of_inverse(shell.lure.P_e)):
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="{V <= outer} reaches beyond the first box.")
    leaves = _leaves(shell, problem.n * problem.m)
    if leaves is None:
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="the tree does not describe boxes.")
    S = border_of(problem, shell.lure, shell.lure.rate)
    if shell.lure.P is not None and S is None:  # cannot be: it was proved
        return LureDecision(verdict=Verdict.UNDECIDED, step="observer", reason="Omega0 + 2 rate P < 0 is not shown.")
    forms = build_forms(problem, shell.lure, S=S, rate=shell.lure.rate)
    P_e = next(iter(forms.values())).P_e
    inside, outside = float_below(shell.lure.level or Fraction(0)), float_above(shell.outer)
    for start in range(0, len(leaves), CHUNK):
        boxes = Boxes(centres=leaves.centres[start : start + CHUNK], halves=leaves.halves[start : start + CHUNK])
        least, most = energy_bounds(P_e, boxes)
        rest = boxes.chosen(~((most <= inside) | (least >= outside)))  # a bound that is no number leaves the box in
        for mode, form in forms.items():
            if len(rest) and not np.all(upper_bounds(form, rest)[0] < 0):
                reason = f"V' < 0 is not shown in some box of the shell in mode {mode}."
                return LureDecision(verdict=Verdict.UNDECIDED, step="boxes", mode=mode, reason=reason)
    return LureDecision(
        verdict=Verdict.PROVED,
        reason=f"V decreases, V' <= -2 ({float(shell.lure.rate):.4g}) V, while V <= {float(shell.outer):.6g}:"
        f" {len(leaves)} boxes around {{V <= {float(shell.lure.level or 0):.6g}}}.",
    )


def _leaves(shell: Shell, size: int) -> Boxes | None:
    """The boxes that the tree leaves; None if it is no tree."""
    codes = np.frombuffer(shell.tree.encode("ascii", errors="replace"), dtype=np.uint8)
    if len(codes) > MOST_BOXES:
        return None
    start, level, kept = 0, first_box(size, shell.half), list[Boxes]()
    while len(level):
        part = codes[start : start + len(level)]
        along = part.astype(np.intp) - ord("0")
        stays = part == ord(LEAF)
        if len(part) < len(level) or not np.all(stays | ((along >= 0) & (along < size))):
            return None
        start += len(level)
        kept.append(level.chosen(stays))
        level = level.chosen(~stays).split(along[~stays])
        if len(level) and float(np.min(level.halves)) < float(shell.half) * 2.0**-MOST_HALVINGS:
            return None
    if start != len(codes):
        return None
    centres, halves = zip(*((each.centres, each.halves) for each in kept), strict=True)
    return Boxes(centres=np.concatenate(centres), halves=np.concatenate(halves))


def exhaustive_check(
    problem: Problem,
    W: Matrix | None,
    shell: Shell,
    *,
    radius: float,
    disturbance: float,
    domain: str,
    remark: str = "",
) -> Check:
    """Decide ``shell`` as a proof for every start with |e| <= radius and |eps_i| <= disturbance; see ``lure_check``."""
    reason = quadratic.quadratic_obstacle(problem, W)
    if reason is not None:
        return undecided_check("exhaustive", domain, reason, applies=False)
    decision = verify_shell(problem, shell)
    if decision.verdict is not Verdict.PROVED:
        return undecided_check("exhaustive", domain, decision.reason)
    if not covers(problem, shell.whole, radius=claimed(radius), disturbance=claimed(disturbance)):
        return undecided_check("exhaustive", domain, "the ball asked for is not inside the invariant set.")
    decrease = quadratic.decrease_in_words(problem, shell.whole, radius, disturbance)
    return Check(
        id="exhaustive",
        verdict=Verdict.PROVED,
        rate=quadratic.rate_of(shell.lure),
        domain=starts_in("ball", radius, disturbance),
        claim=shell,
        reason=f"{decrease}: near the target by a quadratic certificate, farther out in {shell.tree.count('.')} boxes,"
        f" one by one{quadratic.in_every_mode(problem)}.{remark}",
    )


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a proved ``exhaustive`` claims is confirmed, else what is not.  ``domain`` is not needed:
    boxes are always about a ball.  Raises what a malformed claim raises."""
    del domain
    reason = quadratic.wrong_outside(check, problem, W)
    if reason is not None:
        return reason
    shell = read_claim(check, problem, W)
    if not quadratic.ball_is_inside(problem, shell.whole, check.domain):
        return "the ball is not inside the invariant set"
    return quadratic.not_shown(check, problem, shell.lure, verify_shell(problem, shell))


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Shell:
    """What a proved check claims, for this problem and the gain W (q, m); raises as ``lure_from_json``."""
    names = quadratic.names_of(problem)
    values = read_object(check.exact, (*names, *NAMES))
    lure = quadratic.lure_from_json({name: values[name] for name in names}, problem, W)
    if not isinstance(values["tree"], str):
        raise TypeError("tree must be text")
    outer, half = read_rational(values["outer"]), read_rational(values["half"])
    return Shell(lure=lure, outer=outer, half=half, tree=values["tree"])
