"""The certificate of one problem: the problem, and what is claimed about it.

It carries no time stamp, so that the same input and versions give the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design._checks import noun
from dobc_design._show.cards import Card, Headed
from dobc_design._show.text import latex_text
from dobc_design.conditions.accuracy.value import Agreed
from dobc_design.conditions.check import Check
from dobc_design.conditions.schedule.claim import Cycles, Weights
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.exact.matrix import Array, Matrix, to_float
from dobc_design.loop.guarantee import Phase
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of
from dobc_design.loop.pairs import rows_of
from dobc_design.problem.canonical import canonical_bytes
from dobc_design.problem.groups import join
from dobc_design.problem.problem import Problem
from dobc_design.verdict import Verdict

from .bounds import (
    CertifiedBound,
    RunLike,
    bound_of_plant,
    certified_bound,
    certified_settling,
    starts_of,
)
from .claims import Claims, claim_of, reading_claims
from .files import REPORTS, make_folder, require_own, write_together
from .regions import Regions, certified_regions
from .text import certificate_bytes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from dobc_design.exact.number import Number


@noun
class Certificate(Headed):
    """A problem and the claims about it; shows itself as text, and as a table in Jupyter.

    ``verdict``, ``reason``, ``rate`` (1/s), ``factor``, ``covered_by`` and ``checks`` are the same
    facts as in ``certify --json``; ``problem`` is what they are about, ``claims``
    holds everything that certificate.json holds.
    """

    problem: Problem
    claims: Claims

    @property
    def _loop(self) -> Loop:
        """What the checks are about."""
        loop = loop_of(self.problem)
        return rows_of(loop, self.claims.W) or loop

    @property
    def size(self) -> int:
        """The number of errors that norms are about, of all agents and components; where agents
        agree, of differences."""
        return self._loop.size

    @property
    def verdict(self) -> Verdict:
        """The overall verdict."""
        return self.claims.verdict

    @property
    def reason(self) -> str:
        """The overall verdict in a sentence."""
        return self.claims.reason

    @property
    def rate(self) -> float | None:
        """Certified decay rate in 1/s, or None."""
        return self.claims.rate

    @property
    def factor(self) -> float | None:
        """The factor of that rate: |e(t)| <= factor |e(0)| exp(-rate t) + what the estimation error
        adds; or None."""
        return self.claims.factor

    @property
    def covered_by(self) -> str | None:
        """The id of the check that proves the verdict, or None."""
        return self.claims.covered_by

    @property
    def checks(self) -> tuple[Check, ...]:
        """Every condition that was examined."""
        return self.claims.checks

    @property
    def W(self) -> Array | None:  # noqa: N802 - the paper's letter
        """The observer gain as floats, (q, m) in 1/s; None without one.  What is proved is about
        ``W_exact``."""
        return None if self.W_exact is None else to_float(self.W_exact)

    @property
    def W_exact(self) -> Matrix | None:  # noqa: N802 - the paper's letter
        """The observer gain as rationals, (q, m) in 1/s; None without one.

        Example:
            >>> certificate = dd.certify("paper-fixed")
            >>> certificate.W.round(1).tolist(), certificate.W_exact[0][0]
            ([[3.2], [2.4]], Fraction(16, 5))
        """
        # Claims about measured outputs are about F = A - W H, in which the gain of the file is.
        if self._loop.sensed:
            return join([group.observer.W for group in self._loop.sensed])
        return self.claims.W

    @property
    def regions(self) -> Regions:
        """From which starts consensus is proved, method by method, beside the region asked for."""
        return certified_regions(self._loop, self.claims)

    @property
    def value(self) -> Agreed | None:
        """What is proved of the value that the agents agree on; None with a target, and where
        agreement is not proved.

        Example:
            >>> network = dd.Network.from_arcs([[1, 2], [2, 1]], arrow="listens_to", agents=2)
            >>> starts = {"initial_states": [0, 5]}
            >>> problem = dd.Problem(network=network, coupling="y", goal="agreement", region=starts)
            >>> value = dd.certify(problem).value
            >>> value.lo, value.hi, str(value.weights["1"])
            ((0.0,), (5.0,), '1/2')
        """
        return self.claims.value

    @property
    def settling(self) -> Settling | None:
        """The certified settling time with its ``envelope(t)`` of |e|_inf; None where no
        ``settling`` is proved.

        Raises: CertificateError for a claim that cannot be read, as in a file that somebody else
        wrote.
        """
        return certified_settling(self._loop, self.claims)

    @property
    def weights(self) -> tuple[tuple[Phase, Weights], ...]:
        """The phases of the guarantee of [switching], each with its proved weights v(t) of max
        |e_i| / v_i; empty where no `schedule` is proved with weights.  Raises: CertificateError for
        a claim that cannot be read."""
        with reading_claims():
            for check in self.checks:
                if check.id != "schedule" or not check.is_proved:
                    continue
                claim = claim_of(check, self._loop, self.claims.W)
                if isinstance(claim, Cycles) and claim.phases and claim.T is None:
                    return tuple(zip(self._loop.guarantee.phases, claim.phases, strict=True))
        return ()

    def bound(
        self, times: ArrayLike, *, radius: Number | None = None, disturbance: Number | None = None
    ) -> Array:
        """The proved bound of |e(t)|_inf at times >= 0 in s, rounded up, same shape.

        At each time it is the least of all proved checks and of the settling time's envelope.  It
        holds for every start with |e(0)|_inf <= ``radius`` and |eps_i(0)| <= ``disturbance``, by
        default the smallest such set that holds the [region]; where the proof is about a guarantee
        of [switching], for signals that keep it.  It is about the plant that the file states: with
        errors of weights or gains it is that of `tolerance`, with a limit it needs starts that keep
        it.
        Raises: SpecError without a [region] and without a radius, and where nothing is proved about
        these starts, as under a disturbance, drift or noise of [uncertainty], which leave errors
        for ever, and with an exosystem where something is held: a ripple remains between samples.
        Example:
            >>> bound = dd.certify("clock-sync").bound([0, 1000], radius=1, disturbance=0)
            >>> bound.round(6).tolist()[1]
            0.0
        """
        starts = starts_of(self._loop, radius, disturbance)
        bound = bound_of_plant(self._loop, self.claims, starts)
        return bound(times)

    def envelope(self, run: RunLike) -> CertifiedBound:
        """The proved bound of |e(t)|_inf from the start of a simulated run (or of all runs of an
        ensemble).

        A function of times in s, the least of what the checks prove; its ``reason`` says why where
        there is none. ``trajectory.plot(certificate=certificate)`` draws it.  Raises: SpecError for
        a run of another problem.
        """
        return certified_bound(self.problem, self.claims, run)

    def plot(self, ax: Any = None) -> Any:
        """The certified regions: how far each method reaches, from where each agent may start; and
        moving weights.

        Returns: a Sheet, which shows itself in Jupyter and saves itself, ``save("region.svg")``;
        with Matplotlib's ``ax`` these axes, with the first picture.
        """
        from dobc_design.plotting.regions import plot_regions, region_sheet

        if ax is not None:
            return plot_regions(ax, self.regions)
        return region_sheet(self.regions, weights=self.weights, labels=self.problem.network.labels)

    def check(self, id: str, mode: str | None = None) -> Check:
        """The check of that id (and mode).  Raises KeyError if there is none.

        Example:
            >>> dd.certify("clock-sync").check("hurwitz").verdict.value
            'proved'
        """
        for each in self.checks:
            if each.id == id and (mode is None or each.mode == mode):
                return each
        known = dict.fromkeys(each.id for each in self.checks)
        raise KeyError(f"no check {id!r}; there are {', '.join(known)}")

    def save(
        self, folder: str | Path, *, beside: Mapping[str, bytes] | None = None, force: bool = False
    ) -> tuple[Path, Path]:
        """Write certificate.json and problem.json into ``folder`` (made if absent), replacing older
        ones; a report of another certificate goes with the older ones.

        ``beside``: more files of the same run by name, such as its report; all are replaced
        together.
        Returns: the two paths.  Raises: SpecError where the folder holds results of a problem of
        another name, unless ``force``; CertificateError when the machine refuses; nothing has
        changed then.
        """
        target = make_folder(require_own(Path(folder), self.problem.name, force=force))
        certificate = target / "certificate.json"
        problem = target / "problem.json"
        files = {
            problem: canonical_bytes(self.problem),
            certificate: certificate_bytes(self.claims),
        }
        for name, data in (beside or {}).items():
            files[target / name] = data
        # Together, so that a certificate never lies beside the problem of another run, nor beside
        # a report that speaks of another certificate.
        kept = certificate.is_file() and certificate.read_bytes() == files[certificate]
        reports = [] if kept else [target / name for name in REPORTS]
        write_together(files, without=reports)
        return certificate, problem

    def _repr_latex_(self) -> str:
        return rf"${latex_text(self.problem.name)}\text{{: {self.verdict.value}}}$"

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str]:
        return {
            "text/plain": str(self),
            "text/html": self._repr_html_(),
            "text/latex": self._repr_latex_(),
        }

    def _card(self) -> Card:
        heads = ("check", "verdict", "reason")
        rows = [(check.title, check.verdict, check.reason) for check in self.checks]
        verdict = self.verdict.value
        name = self.problem.name
        return Card(title=name, verdict=verdict, text=self.reason, heads=heads, rows=rows)
