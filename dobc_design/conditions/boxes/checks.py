"""The check ``exhaustive``, from a claim that is decided here to what a certificate holds, and back.

Theory, section 4: a quadratic certificate for a ball, and boxes around it, for small networks.
docs/certificate-format.md, "Regions", fixes the form.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from dobc_design.conditions.boxes.claim import Shell
from dobc_design.conditions.boxes.decide import verify_shell
from dobc_design.conditions.check import Check, read_object, starts_in, undecided_check
from dobc_design.conditions.numbers import claimed, read_rational
from dobc_design.conditions.quadratic.decide import (
    ball_is_inside,
    covers,
    decrease_in_words,
    in_every_mode,
    lure_from_json,
    names_of,
    not_shown,
    quadratic_obstacle,
    rate_of,
    wrong_outside,
)
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

#: The keys of ``exact`` beside those of ``lure``.
NAMES: Final = ("outer", "half", "tree")


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
    reason = quadratic_obstacle(problem, W)
    if reason is not None:
        return undecided_check("exhaustive", domain, reason, applies=False)
    decision = verify_shell(problem, shell)
    if decision.verdict is not Verdict.PROVED:
        return undecided_check("exhaustive", domain, decision.reason)
    outer = replace(shell.lure, level=shell.outer)
    if not covers(problem, outer, radius=claimed(radius), disturbance=claimed(disturbance)):
        return undecided_check("exhaustive", domain, "the ball asked for is not inside the invariant set.")
    return Check(
        id="exhaustive",
        verdict=Verdict.PROVED,
        rate=rate_of(shell.lure),
        domain=starts_in("ball", radius, disturbance),
        claim=shell,
        reason=f"{decrease_in_words(problem, outer, radius, disturbance)}: near the target by a quadratic certificate,"
        " farther out in"
        f" {shell.tree.count('.')} boxes, one by one{in_every_mode(problem)}.{remark}",
    )


def confirm(check: Check, problem: Problem, W: Matrix | None, *, domain: str) -> str | None:
    """None if everything a proved ``exhaustive`` claims is confirmed, else what is not.

    ``domain`` is not needed: boxes are always about a ball.  Raises what a malformed claim raises.
    """
    del domain
    reason = wrong_outside(check, problem, W)
    if reason is not None:
        return reason
    shell = read_claim(check, problem, W)
    if not ball_is_inside(problem, replace(shell.lure, level=shell.outer), check.domain):
        return "the ball is not inside the invariant set"
    return not_shown(check, problem, shell.lure, verify_shell(problem, shell))


def read_claim(check: Check, problem: Problem, W: Matrix | None) -> Shell:
    """What a proved check claims, for this problem and the gain W (q, m); raises as ``lure_from_json``."""
    values = read_object(check.exact, (*names_of(problem), *NAMES))
    lure = lure_from_json({name: values[name] for name in names_of(problem)}, problem, W)
    if not isinstance(values["tree"], str):
        raise TypeError("tree must be text")
    return Shell(
        lure=lure,
        outer=read_rational(values["outer"]),
        half=read_rational(values["half"]),
        tree=values["tree"],
        rate=lure.rate,
    )
