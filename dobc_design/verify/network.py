"""What the graph alone decides: which agents no pinned agent reaches.

If a set S of agents listens to nobody outside S and holds no pin, e_S = c is an equilibrium for every
c, so consensus fails; and the indicator of S is a vector v with v' Lambda v = 0 (theory, section 2).
"""

from __future__ import annotations

from collections.abc import Sequence

from dobc_design.spec.problem import Problem
from dobc_design.spec.reaching import unreached
from dobc_design.verdict import Verdict
from dobc_design.verify.check import Check, Witness

SHOWN = 8


def reachability_check(problem: Problem, mode: str) -> Check:
    """Decide for one mode whether every agent is reached from a pinned one."""
    missing = unreached(problem, [problem.network.modes[mode]])
    if not missing:
        return Check(
            id="reachability", mode=mode, verdict=Verdict.PROVED, domain="global",
            reason="every agent is reached from a pinned agent.",
        )  # fmt: skip
    labels = tuple(problem.network.labels[i] for i in missing)
    pins = "there is no pinned agent" if not problem.pinning.agents else "no pinned agent reaches them"
    return Check(
        id="reachability", mode=mode, verdict=Verdict.REFUTED, domain="global",
        reason=f"{name_agents(labels)} {'hears' if len(labels) == 1 else 'hear'} no pinned agent: {pins}."
        f" Pin one of them, or let {'it' if len(labels) == 1 else 'one of them'} listen to a reached agent.",
        witness=Witness(kind="agents", labels=labels),
    )  # fmt: skip


def name_agents(labels: Sequence[str]) -> str:
    """Agents in words: "agent 4", "agents 4, 5 and 6", long lists cut."""
    if len(labels) == 1:
        return f"agent {labels[0]}"
    if len(labels) > SHOWN:
        return f"agents {', '.join(labels[:SHOWN])} and {len(labels) - SHOWN} more"
    return f"agents {', '.join(labels[:-1])} and {labels[-1]}"
