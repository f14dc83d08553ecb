"""What was certified: the loop at a glance, the problem with its equations, who listens to whom."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from dobc_design._show.text import latex_matrix, latex_number, latex_rows
from dobc_design.description.words import caution_lines
from dobc_design.loop.make import errors_of
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.leader import Leader
from dobc_design.problem.problem import Problem
from dobc_design.report import pictures, words

from .document import (
    IN_TEXT,
    Beside,
    Block,
    Blocks,
    Column,
    Fact,
    Facts,
    Formula,
    List,
    Matrices,
    Only,
    Pictures,
    Section,
    ShownMatrix,
    Table,
    Text,
    Words,
    in_markdown,
    on_pages,
    section,
    table_of,
    worded,
)
from .findings import Findings
from .words import number

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis, GraphFacts, ModeSpectrum

MOST_NOTES = 60
MOST_GRAPHS = 12  # rows
LONGEST_VECTOR = 12  # entries that are printed
#: Equations that are the same for all kinds of agents.
#: The control with its pins, which agents that agree do not have.
_PINS = re.compile(r"u_i = -(k_i|K_i).*")
_SHARED = {latex for _, latex, _ in words.TEXTS["loop"]["disturbed"]}


@section("The loop", "loop")
def loop_section(found: Findings) -> Blocks:
    """The network as a drawing, beside it what the engineer has designed, in decimals; what looks
    like a slip."""
    certificate = found.certificate
    drawn, legend = pictures.network_pictures(certificate)
    picture = (Pictures(drawn, small=True), Text(legend, "caption"))
    told: list[Block] = [Facts(tuple(words.loop_facts(certificate)))]
    for line in caution_lines(found.problem):
        told.append(Text(words.sentence(line), "warning"))
    notes = words.shown_notes(certificate)[:MOST_NOTES]
    if notes:
        told.append(Section("Given and assumed", (List(notes),)))
    # Several drawings need the whole width.
    if len(drawn) == 1:
        yield on_pages(Beside((picture, told), second_wider=True))
    else:
        yield on_pages(*picture, *told)
    yield in_markdown(*told)


@section("The problem", "problem", "Problem")
def problem_section(found: Findings) -> Blocks:
    """The problem in a few sentences, and its equations with the numbers of the paper."""
    problem = found.problem
    yield Text(words.problem_words(problem))
    yield from _equations(problem)
    if problem.dynamics is not None:
        yield Matrices(tuple(_matrices(problem.dynamics)))
    yield Only(("html", *IN_TEXT), tuple(_functions(problem)))
    yield Only(("pdf",), (Facts(tuple(_plain_functions(problem))),))
    yield Text(_letters(problem))
    for head, sentences in (
        ("Each agent has the A, C and W of its group:", words.group_sentences(problem)),
        ("Arcs with a coupling of their own:", words.exception_sentences(problem)),
    ):
        if sentences:
            yield Text(head)
            yield List(sentences)


def _equations(problem: Problem) -> Iterator[Formula]:
    """The equations of the loop, under the names that the template of the PDF has for them."""
    dynamics = problem.dynamics
    # The key of texts.toml, and what the template of the PDF adds to it.
    loop, disturbed, measured = [], "", ""
    if dynamics is not None:
        loop.append("dynamic")
    if problem.groups:
        loop.append("disturbed")
        disturbed = ", disturbed"
    if dynamics is not None and dynamics.H is not None:
        loop[-1] = "measured"
        measured = f", {dynamics.acts_on or 'states'}"
    kind = disturbed
    if dynamics is not None:
        kind += ", dynamic" if dynamics.f is None else ", nonlinear"
    if problem.leader is not None:
        kind += ", led in formation" if problem.offsets else ", led"
    for name, latex, equation in words.TEXTS["loop"][" ".join(loop) or "plain"]:
        # The template of the PDF has the shared equations once.
        ending = disturbed if latex in _SHARED else kind
        if latex not in _SHARED:
            ending = measured + ending
        if not problem.has_target and name == "control":
            ending = f"{disturbed}, agreeing"
        yield Formula(_own(latex, problem), name, equation, name + ending)


def _own(latex: str, problem: Problem) -> str:
    """An equation of the loop, with f(x) in place of A x where that is given, and with a leader as
    the target."""
    dynamics = problem.dynamics
    if dynamics is not None and dynamics.acts_on:
        latex = latex.replace(r"e_i = \hat x_i", "e_i = x_i").replace("K_i e_i", "K_i H e_i")
        latex = latex.replace("e_j - e_i", "H e_j - H e_i")
    if not problem.has_target:
        latex = _PINS.sub(r"u_i = -\\hat{d}_i" if problem.groups else "u_i = 0", latex)
    if problem.leader is not None and problem.offsets:
        latex = latex.replace(r"x_i - \bar x_i", "x_i - s - o_i").replace(r"\bar x_i", "o_i")
    elif problem.leader is not None:
        held = r" + u^0_i, \quad A_x \bar x_i + B u^0_i = 0"
        latex = latex.replace(r"x_i - \bar x_i", "x_i - s").replace(held, "")
    if dynamics is None or dynamics.f is None:
        return latex
    return latex.replace("A_x x_i", "f(x_i)").replace(r"A_x \bar x_i", r"f(\bar x_i)")


def _matrices(dynamics: Dynamics) -> Iterator[ShownMatrix]:
    """A_x and B of agents with [dynamics]."""
    if dynamics.A is not None:
        what = "how the state of an agent moves by itself, A of [dynamics]"
        yield ShownMatrix("A_x", what, dynamics.A)
    yield ShownMatrix("B", "how inputs, couplings and disturbance act on it", dynamics.B)
    if dynamics.H is not None:
        yield ShownMatrix("H", "what is measured: y = H x", dynamics.H)


def _functions(problem: Problem) -> Iterator[Formula]:
    """What the problem itself gives, typeset: f, h and the target."""
    dynamics = problem.dynamics
    if dynamics is not None and dynamics.f is not None:
        f = _column(dynamics.latex, alone=dynamics.dimension == 1)
        yield Formula(f"f(x) = {f}", "own dynamics")
    coupling = problem.coupling
    h = _column(coupling.latex, alone=coupling.by_component)
    yield Formula(f"h_{{ij}}(y) = {h}", "coupling")
    if problem.has_target:
        yield Formula(_target(problem), "target")


def _column(latex: Sequence[str], *, alone: bool) -> str:
    """A function, or a column of functions."""
    return latex[0] if alone else latex_rows(latex)


def _plain_functions(problem: Problem) -> Iterator[Fact]:
    """The same as it was typed, for the PDF, which does not read LaTeX."""
    coupling, dynamics = problem.coupling, problem.dynamics
    h = "h(y)" if coupling.by_component else "h(y) by components"
    yield "coupling", f"{h} = {', '.join(coupling.texts)}"
    if dynamics is not None and dynamics.f is not None:
        yield "own dynamics", f"f(x) = ({', '.join(dynamics.f)})"
    yield ("target" if problem.has_target else "goal"), words.target_words(problem)


def _target(problem: Problem) -> str:
    """LaTeX of the target, as a number if it has one entry, else as a transposed row."""
    target, leader, dynamics = problem.target, problem.leader, problem.dynamics
    if leader is not None and dynamics is not None:
        return _leader(leader, dynamics)
    # Only the space is named where the entries would fill the page.
    if len(target) > LONGEST_VECTOR:
        return rf"\bar{{x}} \in \mathbb{{R}}^{{{len(target)}}}"
    if len(target) == 1:
        return rf"\bar{{x}} = {latex_number(target[0])}"
    return rf"\bar{{x}} = {latex_matrix([target])}'"


def _leader(leader: Leader, dynamics: Dynamics) -> str:
    """LaTeX of a target that moves as an agent would, and of where it starts."""
    moves = "A_x s" if dynamics.f is None else "f(s)"
    if len(leader.initial) > LONGEST_VECTOR:
        return rf"\dot s = {moves}"
    sides = [f"[{latex_number(lo)}, {latex_number(hi)}]" for lo, hi in leader.initial]
    starts = r" \times ".join(sides)
    return rf"\dot s = {moves},\quad s(0) \in {starts}"


def _letters(problem: Problem) -> Words:
    """What the letters of the equations mean."""
    heard = "Here $N_i$ are the agents that i listens to, $w_{ij}$ weights (1 unless said), "
    if problem.dynamics is not None:
        return worded(heard + _letters_of_errors(problem))
    said = "$k_i$ the gain of a pin (a number or a matrix), 0 without one."
    if not problem.has_target:
        said = "$x_i$ the states on which agents agree." if problem.agrees else "$x_i$ the states."
    if problem.offsets:
        said += " Agents keep their formation: $x_i$ is measured from the offset of agent i."
    return worded(heard + said)


def _letters_of_errors(problem: Problem) -> str:
    """The letters that only agents with [dynamics] have, in their errors."""
    leader = problem.leader
    goal = "target" if leader is None else "leader s"
    if problem.offsets:
        goal += " plus its offset"
    who = "the estimate of agent i" if errors_of(problem).estimated else "agent i"
    said = f"$e_i$ how far {who} is from the {goal}, $K_i$ the gain of a pin, 0 without one"
    if leader is not None:
        said += " (pinned agents know s, the others do not)"
    # Beside a leader an agent without an offset is held by no constant input.
    if leader is None or problem.offsets:
        said += ", and $u^0_i$ the constant input that holds the agent at its goal"
    return f"{said}."


@section("Who listens to whom", "network", "Network")
def network_section(found: Findings) -> Blocks:
    """Every mode in a sentence, the agents as a table, and facts about the graphs."""
    problem, analysis = found.problem, found.analysis
    sentences = words.mode_sentences(problem)
    yield List(sentences)
    hidden = len(problem.network.modes) - len(sentences)
    if hidden:
        yield on_pages(Text(f"And {hidden} more modes."))
    agents = words.agents_table(problem)
    if agents is not None:
        yield agents
    if analysis is not None and analysis.graphs:
        yield _graphs(analysis, agrees=problem.agrees)


def _graphs(analysis: Analysis, *, agrees: bool) -> Table:
    def components(row: tuple[GraphFacts, ModeSpectrum]) -> str:
        graph = row[0]
        return "one" if graph.is_strongly_connected else str(len(graph.components))

    rows = list(zip(analysis.graphs, analysis.modes, strict=False))[:MOST_GRAPHS]
    # Without a target one eigenvalue is 0: that of a common motion.
    rates = (
        []
        if agrees
        else [
            Column("λmax(Λ) in 1/s", lambda row: number(row[1].lambda_max), 1.2, style="number"),
            Column("decay in 1/s", lambda row: number(row[1].decay_rate), 1.2, style="number"),
        ]
    )
    return table_of(
        "Facts about the graph of each mode; eigenvalues in floating point, for orientation",
        rows,
        Column("mode", lambda row: row[0].mode, 1.4),
        Column("arcs", lambda row: str(row[0].arcs)),
        Column("strong components", components, 1.2),
        Column("balanced", lambda row: "yes" if row[0].balanced else "no"),
        Column("not reached", lambda row: words.names_in_words(row[0].unreached, 6), 1.2),
        *rates,
        cards=True,
    )
