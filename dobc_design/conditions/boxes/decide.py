"""Decides certificates of ``claim``: the inner certificate, then every box of the shell around it."""

from __future__ import annotations

from fractions import Fraction
from typing import Final

import numpy as np

from dobc_design.conditions.boxes.claim import LEAF, Boxes, Shell, build_forms, energy_bounds, first_box, upper_bounds
from dobc_design.conditions.consensus.claim import Pair
from dobc_design.conditions.consensus.decide import schur_block
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.quadratic.decide import LureDecision, verify_lure
from dobc_design.conditions.quadratic.sectors import Enclose, gains_on
from dobc_design.exact.matrix import Matrix, inverse
from dobc_design.exact.number import float_above, float_below
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

CHUNK: Final = 20_000  # boxes looked at together
MOST_BOXES: Final = 4_000_000
MOST_HALVINGS: Final = 30  # of one component: then all ends of boxes are exact in float64


def verify_shell(problem: Problem, shell: Shell, *, enclose: Enclose = gains_on) -> LureDecision:
    """Decide whether {V <= outer} is invariant and V' <= -2 rate V in it, for every mode.

    Refuted: the inner certificate is, or the boxes do not fit.  Undecided: a box is not shown to be harmless.
    Steps beside those of ``verify_lure``: "boxes".
    Raises: SpecError for more than 6 rows n m or couplings of vectors, and as ``verify_lure``.
    """
    inner = verify_lure(problem, shell.lure, enclose=enclose)
    if inner.verdict is not Verdict.PROVED:
        return inner
    if not _contained(shell):
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="{V <= outer} reaches beyond the first box.")
    leaves = _leaves(shell, problem.n * problem.m)
    if leaves is None:
        return LureDecision(verdict=Verdict.REFUTED, step="boxes", reason="the tree does not describe boxes.")
    forms = build_forms(problem, shell.lure, S=border_of(problem, shell.lure, shell.rate), rate=shell.rate)
    P_e = next(iter(forms.values())).P_e
    inside, outside = float_below(shell.lure.level or Fraction(0)), float_above(shell.outer)
    for start in range(0, len(leaves), CHUNK):
        boxes = Boxes(centres=leaves.centres[start : start + CHUNK], halves=leaves.halves[start : start + CHUNK])
        least, most = energy_bounds(P_e, boxes)
        rest = boxes.chosen(~((most <= inside) | (least >= outside)))  # a bound that is no number leaves the box in
        for mode, form in forms.items():
            if len(rest) and not np.all(upper_bounds(form, rest)[0] < 0):
                return LureDecision(
                    verdict=Verdict.UNDECIDED,
                    step="boxes",
                    mode=mode,
                    reason=f"V' < 0 is not shown in some box of the shell in mode {mode}.",
                )
    return LureDecision(
        verdict=Verdict.PROVED,
        reason=f"V decreases, V' <= -2 ({float(shell.rate):.4g}) V, while V <= {float(shell.outer):.6g}:"
        f" {len(leaves)} boxes around {{V <= {float(shell.lure.level or 0):.6g}}}.",
    )


def border_of(problem: Problem, lure: Lure, rate: Fraction) -> Matrix | None:
    """S of the observer's pair at a rate, exactly; None without one."""
    exosystem = problem.joint_exosystem
    if lure.P is None or lure.Q is None or exosystem is None:
        return None
    return schur_block(Pair(P=lure.P, Q=lure.Q), exosystem, rate=rate)


def _contained(shell: Shell) -> bool:
    """Outer (P_e^-1)_kk <= half^2 for every k."""
    Y = inverse(shell.lure.P_e.to_dense())
    return all(shell.outer * Y[k][k] <= shell.half**2 for k in range(len(Y)))


def _leaves(shell: Shell, size: int) -> Boxes | None:
    """The boxes that the tree leaves; None if it is no tree."""
    codes = np.frombuffer(shell.tree.encode("ascii", errors="replace"), dtype=np.uint8)
    if len(codes) > MOST_BOXES:
        return None
    half, start = shell.half, 0
    level = first_box(size, half)
    kept: list[Boxes] = []
    while len(level):
        part = codes[start : start + len(level)]
        along = part.astype(np.intp) - ord("0")
        stays = part == ord(LEAF)
        if len(part) < len(level) or not np.all(stays | ((along >= 0) & (along < size))):
            return None
        start += len(level)
        kept.append(level.chosen(stays))
        level = level.chosen(~stays).split(along[~stays])
        if len(level) and float(np.min(level.halves)) < float(half) * 2.0**-MOST_HALVINGS:
            return None
    if start != len(codes):
        return None
    return Boxes(
        centres=np.concatenate([each.centres for each in kept]), halves=np.concatenate([each.halves for each in kept])
    )
