"""Formulas of the report: LaTeX for Markdown, MathML for the page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction

from dobc_design._show.text import Fragment, latex_matrix, mathml
from dobc_design.certificate.certificate import Certificate
from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.matrix import Matrix
from dobc_design.problem.problem import Problem
from dobc_design.report.document import ShownMatrix

LONGEST_RATIONAL = 4000  # characters
_RATIONAL = re.compile(r"-?[0-9]+(/0*[1-9][0-9]*)?")
_MATRIX = re.compile(r"<mo>&#x00028;</mo><mtable>(.*?)</mtable><mo>&#x00029;</mo>", re.DOTALL)

LOOP = (
    ("each agent", r"\dot x_i = \sum_{j \in N_i} w_{ij}\, h_{ij}(x_j - x_i) + u_i", "(1)"),
    ("control", r"u_i = -k_i (x_i - \bar{x})", "(4)"),
)
LOOP_DISTURBED = (
    ("each agent", r"\dot x_i = \sum_{j \in N_i} w_{ij}\, h_{ij}(x_j - x_i) + u_i + d_i", "(1)"),
    ("its disturbance", r"\dot \xi_i = A \xi_i, \quad d_i = C \xi_i", "(12)"),
    (
        "its observer",
        r"\dot z_i = (A - WC)(z_i + W x_i) - W \left( \sum_{j \in N_i} w_{ij}\, h_{ij}(x_j - x_i) + u_i \right)",
        "(13)",
    ),
    ("the estimate", r"\hat{\xi}_i = z_i + W x_i, \quad \hat{d}_i = C \hat{\xi}_i", "(13)"),
    ("control", r"u_i = -k_i (x_i - \bar{x}) - \hat{d}_i", "(19)"),
)
PSI = r"\Psi = \begin{pmatrix} \Lambda(J) & I_n \otimes C \\ (I_n \otimes C)' & I_n \otimes \Omega_0 \end{pmatrix} < 0"
LAMBDA = r"\Lambda(J) = J + J' - (K + K'), \quad K = \operatorname{blockdiag}(k_1 I_m, \dots, k_n I_m)"
OMEGA = r"\Omega_0 = P A + A' P - C' Q' - Q C"
REDUCED = (
    r"\Psi < 0 \;\iff\; \Omega_0 < 0 \text{ and } \Lambda(J) + I_n \otimes S < 0, \qquad S = C (-\Omega_0)^{-1} C'"
)
BY_EXISTENCE = r"\text{some } P, Q \text{ exist} \;\iff\; \Lambda(J) < 0 \text{ and } (A, C) \text{ is detectable}"


def math(latex: str, *, display: bool = False) -> Fragment:
    """MathML as a safe fragment; only for LaTeX made by this package, never for user text."""
    text = mathml(latex.replace("'", r"^{\top}"), display=display)
    # Parentheses grow with a matrix only in fonts made for mathematics; the page draws them as borders instead.
    return Fragment(_MATRIX.sub(r'<mtable class="matrix">\1</mtable>', text))


def matrices_of(certificate: Certificate) -> list[ShownMatrix]:
    """A, C, W, and P, Q, S where the theorem is proved, S of a printed P beside them."""
    problem, claims = certificate.problem, certificate.claims
    exosystem = problem.joint_exosystem
    if exosystem is None:
        return []
    source = f" ({claims.gain_source})" if claims.gain_source else ""
    wanted: list[tuple[str, str, Matrix | None]] = [
        ("A", "generator of the disturbance", exosystem.A),
        ("C", "what of it acts on an agent", exosystem.C),
        ("W", f"observer gain{source}", claims.W),
        ("P", "Lyapunov matrix of the estimation error, found and proved", claims.P),
        ("Q", "P W", claims.Q),
        ("S", "what the observer costs: Λ + I ⊗ S has to be negative definite", _block(certificate, printed=False)),
        (r"P_{\text{given}}", "the P of the problem file, tested as it stands", problem.joint_observer.P),
        (r"S_{\text{given}}", "its S", _block(certificate, printed=True)),
    ]
    return [ShownMatrix(name=name, what=what, matrix=matrix) for name, what, matrix in wanted if matrix is not None]


def bounds_of(certificate: Certificate) -> dict[str, Fraction]:
    """What the largest eigenvalue of Lambda must stay below, exactly, by the name of the P."""
    found = {}
    for check in certificate.checks:
        if check.id.startswith("theorem") and check.exact is not None and "bound" in check.exact:
            name = "the P given" if check.id.endswith("printed") else "the P found"
            bound = rational(check.exact["bound"])
            if bound is not None:
                found[name] = bound
    return found


def rational(value: object) -> Fraction | None:
    """The number that a certificate holds as text; None for anything else, since certificates come from files."""
    if not isinstance(value, str) or len(value) > LONGEST_RATIONAL or not _RATIONAL.fullmatch(value):
        return None
    return Fraction(value)


def _block(certificate: Certificate, *, printed: bool) -> Matrix | None:
    for check in certificate.checks:
        if check.id.startswith("theorem") and check.id.endswith("printed") is printed and check.exact is not None:
            rows = check.exact.get("S")
            if not isinstance(rows, Sequence) or not all(isinstance(row, Sequence) for row in rows):
                continue
            entries = [[rational(entry) for entry in row] for row in rows]
            known = tuple(tuple(entry for entry in row if entry is not None) for row in entries)
            if known and all(len(row) == len(known) for row in known):
                return known
    return None


def lambda_matrices(lambdas: Mapping[str, Matrix], *, most: int = 6) -> list[ShownMatrix]:
    """Lambda of the first modes, those that are small enough to be read."""
    shown = [
        ShownMatrix(name=r"\Lambda", what=f"at the target, mode {mode}", matrix=matrix)
        for mode, matrix in list(lambdas.items())[:most]
    ]
    return [each for each in shown if each.latex is not None]


def coupling_latex(coupling: Coupling) -> str:
    """LaTeX of h: one function of y, or a column of functions of y_1 to y_m."""
    if coupling.by_component:
        return f"h_{{ij}}(y) = {coupling.latex[0]}"
    return r"h_{ij}(y) = \begin{pmatrix} " + r" \\ ".join(coupling.latex) + r" \end{pmatrix}"


def target_latex(problem: Problem) -> str:
    """LaTeX of the target."""
    return vector_latex(r"\bar{x}", problem.target)


def vector_latex(name: str, vector: Sequence[Fraction]) -> str:
    """LaTeX of a vector, as a number if it has one entry, else as a transposed row."""
    if len(vector) > 12:
        return rf"{name} \in \mathbb{{R}}^{{{len(vector)}}}"
    entries = latex_matrix((tuple(vector),)) or ""
    if len(vector) == 1:
        return f"{name} = " + entries.removeprefix(r"\begin{pmatrix} ").removesuffix(r" \end{pmatrix}")
    return f"{name} = {entries}'"
