"""The condition that is decided, in the letters of the paper, and the matrices of a certificate."""

from collections.abc import Iterator

from dobc_design._show.text import latex_decimal
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.reading import counted
from dobc_design.loop.make import loop_of
from dobc_design.problem.problem import Problem
from dobc_design.report import words

from .document import (
    IN_TEXT,
    Blocks,
    Formula,
    Matrices,
    Only,
    ShownMatrix,
    Text,
    on_pages,
    section,
    to_read,
    worded,
)
from .findings import Findings

MOST_LAMBDAS = 6
_LATEX = words.TEXTS["condition"]


@section("The condition and its matrices", "condition", "Condition")
def condition_section(found: Findings) -> Blocks:
    """The condition, the matrices that it is about, and what was found."""
    certificate, problem = found.certificate, found.problem
    yield from _about_errors(problem)
    yield from _asked(problem)
    yield from _size(found)
    matrices = Matrices(tuple(_matrices(certificate)))
    if matrices.items:
        yield matrices
        rounded = (
            "Entries with a decimal point are rounded for this page; certificate.json holds them "
            "exactly."
        )
        yield on_pages(Text(rounded, "caption"))
    for name, bound in words.bounds_of(certificate).items():
        latex = rf"\lambda_{{\max}}(\Lambda) < {latex_decimal(bound)}"
        # Pages say it in a sentence with the number typeset; text forms as a formula.
        yield Only(IN_TEXT, (Text(f"For {name}:"), Formula(latex)))
        yield on_pages(Formula(latex, f"condition for {name}", typst=bound))
    lambdas = found.lambdas if problem.has_target else {}
    for mode, matrix in list(lambdas.items())[:MOST_LAMBDAS]:
        # Lambda above 12 x 12 is left out without a word: its eigenvalues stand below.
        shown = ShownMatrix(r"\Lambda", f"at the target, mode {mode}", matrix)
        if shown.latex is not None:
            yield Matrices((shown,))


def _about_errors(problem: Problem) -> Blocks:
    """For agents with [dynamics]: which letters of the condition mean something else."""
    dynamics = problem.dynamics
    if dynamics is None:
        return
    slopes = ""
    if dynamics.f is not None and problem.leader is not None:
        slopes = " The slopes of f are bounded over a box that the leader never leaves."
    elif dynamics.f is not None:
        slopes = " Aₓ holds the slopes of f at the target."
    yield Text(words.FIXED["by_errors" if dynamics.H is None else "by_outputs"] + slopes)


def _asked(problem: Problem) -> Blocks:
    """What the paper's theorem asks for, and the smaller condition that is decided in its place."""
    if problem.agrees:
        yield Text(words.FIXED["agreement"])
    if not problem.has_target:
        return
    if not problem.groups:
        yield on_pages(Text("Without a disturbance, Lemma 1 asks in every mode for"))
        yield Formula(_LATEX["lambda"] + " < 0", typst="lemma 1")
        yield on_pages(Text(worded("where $J$ is the Jacobian of the couplings.")))
        return
    asks = (
        "Theorems 1 and 2 ask for matrices $P > 0$ and $Q$, with $W = P^{-1} Q$, such that in "
        "every mode"
    )
    yield on_pages(Text(worded(asks)))
    yield Formula(_LATEX["psi"], number="(18)", typst="psi")
    for name in ("lambda", "omega"):
        yield Formula(_LATEX[name], typst=name)
    smaller = (
        "where $J$ is the Jacobian of the couplings. An equivalent condition of smaller size is "
        "used:"
    )
    yield on_pages(Text(worded(smaller)))
    yield Formula(_LATEX["reduced"], typst="reduced")
    yield on_pages(Text("and, if P and Q are free,"))
    yield Formula(_LATEX["existence"], typst="existence")
    if problem.is_grouped:
        yield Text(words.FIXED["by_group"])


def _size(found: Findings) -> Blocks:
    """How large the inequality is as it is printed, what is decided instead, and what a solver says
    of it where one was asked."""
    loop = loop_of(found.problem)
    # Of measured outputs P alone is free: their gain is in F.
    if not found.problem.has_target or loop.sensed:
        return
    if len(loop.groups) == 1 and not loop.is_grouped:
        m, q = loop.m, loop.groups[0].exosystem.order
        rows, unknowns = loop.n * (m + q), q * (q + 1) // 2 + q * m
        told = (
            f"As printed, (18) is a linear matrix inequality of {counted(len(loop.modes), 'block')}"
            f" of {rows} rows in {unknowns} unknowns (dobc_design.block_lmi). The equivalent "
            f"condition is decided with matrices of {loop.n * m} rows (Λ + I ⊗ S) and {q} (Ω₀); "
            "P and Q are sought for one agent, whatever the number of agents."
        )
        yield to_read(Text(told))
    if found.lmi:
        yield to_read(Text(f"Beside the proof, in floating point: {found.lmi}"))


def _matrices(certificate: Certificate) -> Iterator[ShownMatrix]:
    """A, C, W, and P, Q, S where the theorem is proved, S of a printed P beside them."""
    problem, claims = certificate.problem, certificate.claims
    exosystem = problem.joint_exosystem
    # what the condition is about: with [dynamics] the disturbance enters through B
    felt = loop_of(problem).joint_exosystem
    if exosystem is None or felt is None:
        return
    yield ShownMatrix("A", "generator of the disturbance", exosystem.A)
    yield ShownMatrix("C", "output matrix: d = C ξ acts on the agent", exosystem.C)
    if loop_of(problem).sensed:
        yield ShownMatrix("F", "how the estimation errors of x and ξ move", felt.A)
        yield ShownMatrix("E", "what of them acts on the errors, in place of C", felt.C)
    elif problem.dynamics is not None:
        yield ShownMatrix("B C", "what takes the place of C in the condition", felt.C)
    found = words.observer_blocks(certificate)
    effect = "effect of the observer: Λ + I ⊗ S has to be negative definite"
    # Any of these may be missing: it depends on what was given and on what is proved.
    for name, what, matrix in (
        ("W", "observer gain", certificate.W_exact),
        ("P", "Lyapunov matrix of the estimation error, found and proved", claims.P),
        ("Q", "P W", claims.Q),
        ("S", effect, found.get(words.FOUND)),
        (
            r"P_{\text{given}}",
            "the P of the problem file, tested as it stands",
            problem.joint_observer.P,
        ),
        (r"S_{\text{given}}", "its S", found.get(words.GIVEN)),
    ):
        if matrix is not None:
            yield ShownMatrix(name, what, matrix)
