"""The certified bound of |e(t)|_inf that belongs to a simulated run: what a certificate proves about its start.

Nothing is decided here; the claims are taken as they are, ``dobc verify`` decides them.  A run counts only if it is a
run of the loop that the claims are about.
"""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Protocol

from dobc_design.certificate.claims import Claims
from dobc_design.certificate.gathering import certified_settling, reading_claims
from dobc_design.conditions.schedule.envelopes import ROUNDING, CertifiedBound, Starts, envelopes_of
from dobc_design.conditions.schedule.settling import Settling
from dobc_design.errors import SpecError
from dobc_design.problem.canonical import loop_sha256
from dobc_design.problem.problem import Problem


class RunLike(Protocol):
    """See ``simulation.trajectory.Trajectory`` and ``simulation.ensemble.Ensemble``."""

    @property
    def name(self) -> str: ...
    @property
    def labels(self) -> tuple[str, ...]: ...
    @property
    def signal(self) -> str: ...
    @property
    def stress(self) -> str: ...
    @property
    def observer(self) -> str: ...
    @property
    def loop_sha256(self) -> str: ...
    def start_size(self) -> tuple[float, float, float]: ...


def certified_bound(problem: Problem, claims: Claims, run: RunLike) -> CertifiedBound:
    """What ``claims``, which are about ``problem``, prove about |e(t)|_inf of a run, or of all runs of an ensemble.

    Returns: a CertifiedBound, a function of times; without a bound its ``reason`` says why.
    Raises: SpecError for a run of another problem or with another W, CertificateError for claims that cannot be read.
    """
    reason = _other_loop(run)
    if reason:
        return CertifiedBound(reason=reason)
    other = (run.name, run.labels) != (problem.name, problem.network.labels)
    if other or run.loop_sha256 != loop_sha256(problem, claims.W):
        raise SpecError(
            f"the run must be one of {problem.name!r}, which the certificate is about; it is one of"
            f" {repr(run.name) if other else 'another problem of that name, or with another gain W'}.",
            key="certificate",
            cure="Certify the problem that was simulated, or simulate this one.",
        )
    reach, length, disturbance = map(Fraction, run.start_size())
    starts = Starts(box=reach, ball=length, disturbance=disturbance)
    settling = certified_settling(problem, claims)
    if settling is not None and not _begins_in(settling, starts):
        settling = None
    with reading_claims():
        found = envelopes_of(problem, claims.W, claims.checks, starts)
    bound = CertifiedBound(envelopes=found, settling=settling)
    return bound if bound.sources else CertifiedBound(reason=_nothing(claims, starts))


def _other_loop(run: RunLike) -> str:
    """Why a run is not one of the loop that certificates are about; "" if it is."""
    if run.stress:
        return "no certificate is about a loop under stress"
    if not run.loop_sha256:
        return "the run does not record of which problem and W it is (too large a network, or an older file)"
    if run.observer == "off":
        return "certificates are about the loop with its observer, and here it is off"
    if run.signal and json.loads(run.signal).get("signal") == "mobile":
        return "certificates are about the arcs of the modes, and here the graph follows from positions"
    return ""


def _begins_in(settling: Settling, starts: Starts) -> bool:
    room = 1 + ROUNDING
    return starts.box <= settling.radius * room and starts.disturbance <= settling.disturbance * room


def _nothing(claims: Claims, starts: Starts) -> str:
    """Why no check bounds these starts."""
    where = f"|e|_inf = {float(starts.box):.4g} and |eps_i| = {float(starts.disturbance):.4g}"
    regions = [check.domain for check in claims.checks if not isinstance(check.domain, str)]
    if not regions:
        return "the certificate proves nothing about starts away from the target; ask for a [region]"
    held = max(regions, key=lambda domain: (domain["kind"] == "box", domain["radius"]))
    edge = "|e|_inf" if held["kind"] == "box" else "|e|"
    return (
        f"the run starts outside what is certified: {where}, and proved is {edge} <= {held['radius']:.6g} with"
        f" |eps_i| <= {held['disturbance']:.6g}"
    )
