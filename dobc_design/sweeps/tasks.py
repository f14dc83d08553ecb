"""What is done with every case, and which numbers are kept of it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from dobc_design.errors import SpecError
from dobc_design.exact.number import float_above
from dobc_design.exact.reading import shown
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.certificate.certificate import Certificate

#: Columns of the results by task: name, type ("text", "number", "truth" or "count"), what it is.
COLUMNS: dict[str, tuple[tuple[str, str, str], ...]] = {
    "certify": (
        ("verdict", "text", "overall verdict"),
        ("covered_by", "text", "the check that proves it"),
        ("rate", "number", "certified rate in 1/s"),
        ("margin", "number", "least margin at the consensus in 1/s"),
        ("starts", "text", "the largest proved set of starts: everywhere, box, ball, near or none"),
        ("box", "number", "largest proved |e|_inf"),
        ("ball", "number", "largest proved |e|, Euclidean"),
        ("settling_time", "number", "certified settling time in s"),
        ("reason", "text", "the verdict in a sentence"),
    ),
    "simulate": (
        ("diverged", "truth", "whether a run diverged"),
        ("diverged_runs", "count", "runs that diverged"),
        ("final_error", "number", "median of |e|_inf at the end"),
        ("final_error_max", "number", "largest of them"),
        ("settling_time", "number", "median settling time to 1 % in s"),
        ("settling_time_max", "number", "largest of them in s"),
        ("decay_rate", "number", "median fitted decay rate in 1/s"),
        ("decay_rate_min", "number", "least of them in 1/s"),
    ),
}
KINDS = tuple(COLUMNS)
_NEAR = ("theorem2", "theorem1", "lemma1")  # the checks at the consensus, the strongest first
_ORDER = ("everywhere", "box", "ball", "near", "none")


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What is done: "certify", with ``everything`` as there, or "simulate" with ``runs`` runs.

    Raises: SpecError for another kind, or options of the other one.
    """

    kind: str = "certify"
    everything: bool = False
    runs: int = 1

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise SpecError(
                f"task must be one of {', '.join(KINDS)}; got {shown(self.kind)}.", key="task", cure="Choose one."
            )
        if type(self.runs) is not int or self.runs < 1:
            raise SpecError(
                f"runs must be a whole number >= 1; got {shown(self.runs)}.", key="runs", cure="Correct it."
            )
        if self.kind == "certify" and self.runs != 1:
            raise SpecError("runs is for simulations; a proof is made once.", key="runs", cure='Take task="simulate".')
        if self.kind == "simulate" and self.everything:
            raise SpecError("everything (--all) is for certify.", key="everything", cure="Leave it out.")

    @property
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """Name, type and meaning of what is kept of every case."""
        return COLUMNS[self.kind]

    def to_json(self) -> dict[str, Any]:
        """JSON object."""
        own = {"everything": self.everything} if self.kind == "certify" else {"runs": self.runs}
        return {"kind": self.kind, **own}

    def prepare(self) -> None:
        """Import what ``run`` needs, which takes seconds in a new process and is no part of a case."""
        from dobc_design.certification import certify  # noqa: F401 - for its imports
        from dobc_design.simulation import ensemble  # noqa: F401 - likewise

    def run(self, problem: Problem) -> dict[str, Any]:
        """Do it and return the columns."""
        if self.kind == "certify":
            from dobc_design.certification.certify import certify

            return _facts(certify(problem, everything=self.everything))
        from dobc_design.simulation.simulations import simulate

        return _numbers(simulate(problem, runs=None if self.runs == 1 else self.runs).summary())


def _facts(certificate: Certificate) -> dict[str, Any]:
    regions = certificate.regions
    proved = [claim for claim in regions.claims if claim.verdict is Verdict.PROVED]
    kinds = [claim.kind for claim in proved if claim.kind in _ORDER]
    near = next((id for id in _NEAR if any(check.id == id for check in certificate.checks)), None)
    margins = [check.margin for check in certificate.checks if check.id == near and check.margin is not None]
    settling, time = regions.settling, None
    if settling is not None and settling.verdict is Verdict.PROVED and settling.exact is not None:
        time = float_above(Fraction(settling.exact["time"]))
    return {
        "verdict": certificate.verdict.value,
        "covered_by": certificate.covered_by,
        "rate": certificate.rate,
        "margin": min(margins, default=None),
        "starts": min(kinds, key=_ORDER.index, default="none"),
        "box": max((claim.box for claim in proved if claim.box is not None), default=None),
        "ball": max((claim.ball for claim in proved if claim.ball is not None), default=None),
        "settling_time": time,
        "reason": certificate.reason,
    }


def _numbers(summary: dict[str, Any]) -> dict[str, Any]:
    error, settling, rate = summary["final_error"], summary["settling_time"], summary["decay_rate"]
    return {
        "diverged": summary["diverged"],
        "diverged_runs": summary["diverged_runs"],
        "final_error": error["median"],
        "final_error_max": error["max"],
        "settling_time": settling["median"],
        "settling_time_max": settling["max"],
        "decay_rate": rate["median"],
        "decay_rate_min": rate["min"],
    }
