"""Certificates, diagnostics and runs made by hand, so that nothing but the report is under test."""

import dataclasses
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from reports import HOSTILE

from dobc_design import (
    Certificate,
    Exosystem,
    Network,
    Observer,
    Problem,
    Region,
    Trajectory,
    Verdict,
)
from dobc_design.analysis.analysis import (
    Analysis,
    GraphFacts,
    ModeMargin,
    ModeSpectrum,
    ObservabilityResult,
    SpectrumResult,
)
from dobc_design.certificate.claims import Claims
from dobc_design.conditions.check import Check, Fix, Values, Witness
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Ball, Box
from dobc_design.conditions.quadratic.claim import Lure
from dobc_design.conditions.reason import Reason
from dobc_design.exact.matrix import matrix
from dobc_design.exact.symmetric import SparseSymmetric
from dobc_design.loop.make import loop_of
from dobc_design.report import pages
from dobc_design.report.pictures import Picture, svg_of


def ring_problem(n: int = 10, **changes: Any) -> Problem:
    """The paper's Example 1 on a directed ring."""
    network = Network.from_arcs(
        {"Ga": [(i + 1, (i + 1) % n + 1) for i in range(n)]}, arrow="listens_to", agents=n
    )
    exosystem = Exosystem(A=[[0, 2], [-2, 0]], C=[[1, 0]])
    observer = Observer(W=[["16/5"], ["12/5"]], P=[["1/2", "-1/4"], ["-1/4", "1/3"]])
    settings: dict[str, Any] = {
        "name": "ring",
        "network": network,
        "coupling": "exp(y) - 1 + y",
        "target": 1,
        "gains": {1: 5, n // 2 + 1: 5},
        "exosystem": exosystem,
        "observer": observer,
    }
    return Problem(**settings | changes)


def ring_checks(problem: Problem) -> tuple[Check, ...]:
    """One check of every kind of content: numbers, exact values, witnesses, cures, all three
    verdicts."""
    mode = next(iter(problem.network.modes))
    labels = problem.network.labels
    proved = Verdict.PROVED
    refuted = Verdict.REFUTED
    undecided = Verdict.UNDECIDED
    cure = {"pinning.gains.2": 1, "observer.W": None}
    routh = Values({"routh": ["1", "16/5", "44/5"]})
    hurwitz = one("hurwitz", proved, EVERYWHERE, "A - WC is Hurwitz.", rate=1.59999, claim=routh)
    witness = Witness(kind="agents", labels=labels[1:3])
    fix = Fix(kind="pin", set=cure, text="Pin one of them.")
    lonely = one(
        "reachability",
        refuted,
        EVERYWHERE,
        "somebody is alone.",
        mode=mode,
        witness=witness,
        fix=fix,
    )
    lemma1 = one(
        "lemma1", proved, NEAR_TARGET, "Lambda(J) < 0.", mode=mode, margin=0.58229999, rate=0.29
    )
    claim = Values({"bound": "-9/8", "S": [["9/8"]]})
    values = tuple(map(str, range(30)))
    witness_vector = Witness(kind="vector", values=values)
    printed = one(
        "theorem1-printed",
        refuted,
        NEAR_TARGET,
        "Psi is not negative definite for this P.",
        margin=-0.53678,
        claim=claim,
        witness=witness_vector,
    )
    claim_of_theorem1 = Values({"bound": "-1/20", "S": [["1/20"]]})
    theorem1 = one(
        "theorem1",
        proved,
        NEAR_TARGET,
        "Psi < 0 holds exactly for a rational P.",
        margin=0.5319,
        rate=0.2618,
        claim=claim_of_theorem1,
    )
    box = Box(4.0, 0.5)
    observable = one("observability", proved, EVERYWHERE, "(A, C) is observable.")
    unasked = one("max-separable", undecided, box, "does not apply: nobody asked.")
    return (observable, hurwitz, lonely, lemma1, printed, theorem1, unasked)


def one(id: str, verdict: Verdict, domain: Any, reason: str, **more: Any) -> Check:
    return Check(id=id, verdict=verdict, domain=domain, reason=reason, **more)


def make_certificate(problem: Problem | None = None, **changes: Any) -> Certificate:
    problem = ring_problem() if problem is None else problem
    W = matrix([["16/5"], ["12/5"]])
    P = matrix([[3, "-1/4"], ["-1/4", 2]])
    Q = matrix([[9], [4]])
    claims = Claims(
        problem_name=problem.name,
        problem_sha256="ab" * 32,
        verdict=Verdict.PROVED,
        why=Reason(head="All agents reach the target."),
        rate=0.26189,
        covered_by="theorem1",
        checks=ring_checks(problem),
        W=W,
        gain_source="given",
        P=P,
        Q=Q,
        notes=("The observer gain W was given.",),
        version="9.9.9",
    )
    return Certificate(problem=problem, claims=dataclasses.replace(claims, **changes))


def make_analysis(problem: Problem) -> Analysis:
    """Made-up eigenvalues of the right shapes."""
    n = problem.n * problem.m
    labels = problem.network.labels
    lambdas = tuple(np.linspace(-8, -0.5, n).tolist())
    loops = tuple(complex(-0.5 - i / n, (-1) ** i) for i in range(n))
    graphs, modes = [], []
    for mode, arcs in problem.network.modes.items():
        heard = (1,) * problem.n
        hearing = (1,) * problem.n
        graph = GraphFacts(
            mode=mode,
            arcs=len(arcs),
            unreached=labels[1:3],
            components=(labels,),
            sources=(labels,),
            heard=heard,
            hearing=hearing,
            balanced=True,
        )
        graphs.append(graph)
        spectrum = ModeSpectrum(mode=mode, lambda_eigenvalues=lambdas, loop_eigenvalues=loops)
        modes.append(spectrum)
    margins = tuple(ModeMargin(eigenvalue=value, margin=0.7) for value in (2j, -2j))
    seen = ObservabilityResult(order=2, rank=2, singular_values=(2.0, 1.0), modes=margins)
    eigenvalues = (-1.6 + 2.5j, -1.6 - 2.5j)
    return Analysis(
        name=problem.name,
        loop=loop_of(problem),
        W=None,
        observability=seen,
        spectrum=SpectrumResult(eigenvalues=eigenvalues, rate=1.6),
        graphs=tuple(graphs),
        modes=tuple(modes),
    )


def make_trajectory(problem: Problem, *, diverged: bool = False) -> Trajectory:
    """Errors that decay like exp(-t), estimates that converge."""
    n = problem.n
    m = problem.m
    q = problem.q
    times = np.linspace(0, 10, 401)
    goal = np.ones((n, m))
    line = np.linspace(-1, 4, n * m)
    starts = line.reshape(n, m)
    x = goal + np.exp(-times)[:, None, None] * starts
    wave = np.cos(2 * times)
    d = np.broadcast_to(wave[:, None, None], x.shape).copy()
    xi = np.zeros((len(times), n, q))
    mode = next(iter(problem.network.modes))
    settled = 1 - np.exp(-times)
    return Trajectory(
        name=problem.name,
        mode=mode,
        labels=problem.network.labels,
        t_final=10.0,
        seed=3,
        diverged=diverged,
        times=times,
        x=x,
        goal=goal,
        u=0 * x,
        d=d,
        dhat=d * settled[:, None, None],
        xi=xi,
        xihat=xi.copy(),
    )


@pytest.fixture
def drawn_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Of the pictures of a page only those of these names are drawn; the others are empty."""

    def drawn(picture: Picture) -> pages.Fragment:
        return svg_of(picture) if picture.name in names else pages.Fragment("<svg></svg>")

    names: list[str] = []

    def draw(*chosen: str) -> None:
        names[:] = chosen
        # The page's environment is kept, with the filter that it was made with.
        monkeypatch.setitem(pages._html_template().environment.filters, "svg", drawn)

    return draw


@pytest.fixture
def undrawn(drawn_only: Callable[..., None]) -> None:
    """The pictures of a page are empty."""
    drawn_only()


@pytest.fixture(scope="session")
def certificate() -> Certificate:
    return make_certificate()


@pytest.fixture(scope="session")
def problem_with() -> Callable[..., Problem]:
    return ring_problem


@pytest.fixture(scope="session")
def certificate_of() -> Callable[..., Certificate]:
    return make_certificate


@pytest.fixture(scope="session")
def analysis_of() -> Callable[[Problem], Analysis]:
    return make_analysis


@pytest.fixture(scope="session")
def trajectory_of() -> Callable[..., Trajectory]:
    return make_trajectory


@pytest.fixture(scope="session")
def everything(certificate: Certificate) -> dict[str, Any]:
    """The arguments of a full report on the ring."""
    problem = certificate.problem
    Lambda = []
    for _ in range(problem.n):
        Lambda.append([Fraction(1, 3)] * problem.n)
    for i, row in enumerate(Lambda):
        row[i] = Fraction(-2)
        row[i - 1] = row[(i + 1) % problem.n] = Fraction(1)
    lambdas = {"Ga": matrix(Lambda)}
    return {
        "certificate": certificate,
        "analysis": make_analysis(problem),
        "trajectory": make_trajectory(problem),
        "lambdas": lambdas,
    }


@pytest.fixture(scope="session")
def asked_for(problem_with, certificate_of) -> dict[str, Any]:
    """A report on the ring with a region, whose certificates are made by hand."""
    region = Region(initial_states=[[0, 5]], initial_disturbance="1/2")
    problem = problem_with(region=region)
    box = Box(4.0, 0.5)
    v = ["1", *["3/2"] * 9]
    P = [["1", "0"], ["0", "1"]]
    values = {"v": v, "P": P, "size": "1"}
    values |= {"alpha": "1/5", "beta": "3/2", "rho": "9/2", "kappa": "7/10"}
    proved, decays = Verdict.PROVED, "from every start V decays."
    separable = one("max-separable", proved, box, decays, rate=0.2, claim=Values(values))
    late = Values({"delay": "1/50", "rate": "1/10"})
    delay = one("delay", proved, box, "late.", rate=0.1, claim=late)
    diagonal = {(i, i): Fraction(1 + i) for i in range(10)}
    P_e = SparseSymmetric(10, diagonal)
    claim = Lure(P_e=P_e, ranges=(), radius=Fraction(1), level=Fraction(2))
    ball = Ball(1.079, 0.5)
    why = (
        "from every start in a ball V decays. Beyond, and this takes several lines, no "
        "quadratic V is found."
    )
    lure = one("lure", proved, ball, why, rate=0.0001234, claim=claim)
    checks = (separable, lure, delay)
    certificate = certificate_of(problem, checks=checks, covered_by="max-separable", rate=0.2)
    return {"certificate": certificate, "analysis": None, "trajectory": None}


@pytest.fixture(scope="session")
def wide(problem_with, certificate_of, analysis_of, trajectory_of) -> dict[str, Any]:
    """Long names, hostile ones, six exosystem states, several modes: what is likely to be too
    wide."""
    labels = [f"station-of-a-very-long-name-{i}-{HOSTILE[1 + i % 5][:40]}" for i in range(12)]
    arcs = []
    for i in range(12):
        arcs.append((labels[i], labels[(i + 1) % 12]))
    network = Network.from_arcs(
        {"m" * 60: arcs, "#b": arcs[:-1], "$c": arcs[3:]}, arrow="listens_to", agents=labels
    )
    A = [[f"{i + 1}/{j + 7}" for j in range(6)] for i in range(6)]
    gains = {labels[0]: 1}
    C = [[1, 0, 0, 0, 0, "123456/654321"]]
    exosystem = Exosystem(A=A, C=C)
    problem = problem_with(
        name="a-name-without-any-space-" * 4,
        network=network,
        gains=gains,
        observer=None,
        exosystem=exosystem,
    )
    notes = ("W" * 200, *HOSTILE)
    certificate = certificate_of(problem, problem_sha256="f" * 64, notes=notes)
    return {
        "certificate": certificate,
        "analysis": analysis_of(problem),
        "trajectory": trajectory_of(problem),
    }
