"""What a report says about a certificate, as one document for all forms.  Handed everything, computes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from dobc_design._show.text import latex_number, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.plotting.axes import thinned_rows
from dobc_design.problem.problem import Problem
from dobc_design.report import formulas, pictures
from dobc_design.report import network_words as nw
from dobc_design.report.checks import checks_section, cure_section
from dobc_design.report.document import (
    PAGES,
    TEXTS,
    Beside,
    Block,
    Box,
    Column,
    Document,
    Facts,
    Formula,
    List,
    Math,
    Matrices,
    Only,
    Pictures,
    Section,
    Terms,
    Text,
    Words,
    table_of,
)
from dobc_design.report.region_words import region_section, settling_section
from dobc_design.report.search_words import search_sections
from dobc_design.report.tracing import recheck_section, reproduction, signatures_section, title_block, trace_section
from dobc_design.report.words import (
    CHECKS,
    MEANINGS,
    covering_domain,
    domain_words,
    mark_of,
    number,
    typeset,
    what_it_means,
)
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.quadratic.duals import QuadraticDual
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

MOST_NOTES = 60
MOST_GRAPHS, MOST_SPECTRA = 12, 40  # rows
MOST_EIGENVALUES, MOST_SAMPLES = 8, 9
_WORDS = (
    (
        "margin",
        "",
        "How much may be added to the diagonal of the network block before the condition fails; for a refuted"
        " condition, by how much it is missed at least, with a minus.",
    ),
    ("rate", "", "A number β in 1/s for which exp(−βt) is proved to bound the decay."),
    ("near the target", "", "In some neighbourhood of the consensus, of unknown size."),
    (
        "pin",
        "",
        "An agent with a gain k > 0 knows the target and is pulled there; the others know their neighbours only.",
    ),
)


def report_document(
    certificate: Certificate,
    *,
    analysis: Analysis | None = None,
    trajectory: Trajectory | None = None,
    lambdas: Mapping[str, Matrix] | None = None,
    timings: Sequence[StageTiming] = (),
    searches: Sequence[Falsification] = (),
    limits: Sequence[QuadraticDual] = (),
) -> Document:
    """The document.

    ``analysis`` and ``trajectory`` are shown where they are given.  ``lambdas``: mode -> Lambda(J) at the consensus,
    printed up to 12 x 12.  ``timings``: sampling and delays of the stages of a settling time; ``searches`` for
    counterexamples; ``limits`` of quadratic certificates.
    """
    problem, again, verdict = certificate.problem, reproduction(certificate), certificate.verdict
    box = Box(
        mark=mark_of(verdict), word=verdict.value.capitalize(), reason=certificate.reason, facts=_facts(certificate)
    )
    identity = title_block(certificate, again)
    blocks: list[Block] = [
        Only(("markdown",), (Facts((*identity, *box.facts)),)),
        *cure_section(certificate.checks),
        *_meaning(certificate),
        _problem(problem),
        _network(certificate, analysis),
        *region_section(
            problem, certificate.regions, limits, tuple(pictures.region_pictures(certificate.regions, limits))
        ),
        *settling_section(certificate.settling, timings, tuple(pictures.envelope_pictures(certificate.settling))),
        *_searches(searches),
        checks_section(certificate.checks),
        _condition(certificate, lambdas or {}),
        *_eigenvalues(certificate, analysis),
        *_simulation(certificate, trajectory),
        trace_section(certificate.checks),
        recheck_section(certificate, again),
        _glossary(),
        signatures_section(),
    ]
    return Document(
        kind="Certificate of consensus",
        name=problem.name,
        title=f"{problem.name}: {verdict.value}",
        verdict=box,
        identity=identity,
        footer=f"{verdict.value} · certificate {again.prints[1][1][:16]}…",
        blocks=tuple(blocks),
    )


def _facts(certificate: Certificate) -> tuple[tuple[str, str], ...]:
    facts = []
    if certificate.verdict is Verdict.PROVED:
        domain = covering_domain(certificate)
        facts.append(("Holds", domain_words(domain) if domain is not None else "–"))
        rate = certificate.rate
        facts.append(("Certified rate", "–" if rate is None else f"{typeset(significant_towards_zero(rate))} 1/s"))
        facts.append(("Carried by", CHECKS.get(certificate.covered_by or "", ("–", ""))[0]))
    counts = [(v, sum(check.verdict is v for check in certificate.checks)) for v in Verdict]
    facts.append(("Checks", ", ".join(f"{count} {v.value}" for v, count in counts if count) or "none"))
    facts.append(("Agents", str(certificate.problem.n)))
    facts.append(("Modes", str(len(certificate.problem.network.modes))))
    return tuple(facts)


def _meaning(certificate: Certificate) -> Iterator[Section]:
    yes, no = what_it_means(certificate)
    says = Section(title="It says", blocks=(List(tuple(yes)),))
    says_not = Section(title="It does not say", blocks=(List(tuple(no)),))
    title = "What this says, and what it does not"
    yield Section(name="meaning", title=title, short="Meaning", blocks=(Beside(((says,), (says_not,))),))
    notes = certificate.claims.notes[:MOST_NOTES] or ("Nothing was assumed or designed beyond the problem file.",)
    title = "What was given, assumed and designed"
    yield Section(name="assumptions", title=title, short="Assumptions", blocks=(List(notes),))


def _problem(problem: Problem) -> Section:
    """The problem in a few sentences, and its equations with the numbers of the paper."""
    given = (
        nw.size_sentence(problem),
        nw.pin_sentence(problem),
        nw.region_sentence(problem),
        nw.switching_sentence(problem),
    )
    disturbed = ", disturbed" if problem.groups else ""
    loop = formulas.LOOP_DISTURBED if problem.groups else formulas.LOOP
    coupling, target = formulas.coupling_latex(problem.coupling), formulas.target_latex(problem)
    letters = "h(y)" if problem.coupling.by_component else "h(y) by components"
    plain = f"{letters} = {', '.join(problem.coupling.texts)}"
    lists: list[Block] = []
    for head, sentences in (
        ("Each agent has the A, C and W of its group:", nw.group_sentences(problem)),
        ("Arcs with a coupling of their own:", nw.exception_sentences(problem)),
    ):
        if sentences:
            lists += [Text(head), List(tuple(sentences))]
    return Section(
        name="problem",
        title="The problem",
        short="Problem",
        blocks=(
            Text(" ".join(filter(None, given))),
            *(Formula(latex=latex, label=name, number=number, typst=name + disturbed) for name, latex, number in loop),
            Only(("markdown",), (Text("Coupling and target:"),)),
            Only(TEXTS, (Formula(latex=coupling), Formula(latex=target))),
            Only(("html",), (Formula(latex=coupling, label="coupling"), Formula(latex=target, label="target"))),
            Only(("pdf",), (Facts((("coupling", plain), ("target", nw.vector_text(problem.target)))),)),
            Text(_letters(problem)),
            *lists,
        ),
    )


def _letters(problem: Problem) -> Words:
    """What the letters of the equations mean."""
    formation = (" Agents keep their formation: ", Math("x_i", "x_i"), " is measured from the offset of agent i.")
    return (
        "Here ",
        Math("N_i", "N_i"),
        " are the agents that i listens to, ",
        Math("w_ij", "w_{ij}"),
        " weights (1 unless said), ",
        Math("k_i", "k_i"),
        " the gain of a pin (a number or a matrix), 0 without one.",
        *(formation if problem.offsets else ()),
    )


def _network(certificate: Certificate, analysis: Analysis | None) -> Section:
    problem = certificate.problem
    sentences, agents = nw.mode_sentences(problem), nw.agents_table(problem)
    hidden = len(problem.network.modes) - len(sentences)
    drawn, legend = pictures.network_pictures(certificate)
    shown = Only(PAGES, (Pictures(drawn, small=True), Text(legend, "caption")))
    table = () if agents is None else (agents,)
    return Section(
        name="network",
        title="Who listens to whom",
        short="Network",
        blocks=(
            List(tuple(f"{name}: {sentence}" for name, sentence in sentences)),
            *((Only(PAGES, (Text(f"And {hidden} more modes."),)),) if hidden else ()),
            *((Beside(((shown,), table), second_wider=True),) if len(drawn) == 1 and table else (shown, *table)),
            *_graphs(analysis),
        ),
    )


def _graphs(analysis: Analysis | None) -> Iterator[Block]:
    if analysis is not None and analysis.graphs:
        yield table_of(
            "Facts about the graph of each mode; eigenvalues in floating point, for orientation",
            list(zip(analysis.graphs, analysis.modes, strict=False))[:MOST_GRAPHS],
            (Column(head="mode", width=1.4), lambda each: each[0].mode),
            (Column(head="arcs"), lambda each: str(each[0].arcs)),
            (
                Column(head="strong components", width=1.2),
                lambda each: "one" if each[0].is_strongly_connected else str(len(each[0].components)),
            ),
            (Column(head="balanced"), lambda each: "yes" if each[0].balanced else "no"),
            (Column(head="not reached", width=1.2), lambda each: nw.names_in_words(each[0].unreached, 6)),
            (Column(head="λmax(Λ) in 1/s", width=1.2, style="number"), lambda each: number(each[1].lambda_max)),
            (Column(head="decay in 1/s", width=1.2, style="number"), lambda each: number(each[1].decay_rate)),
        )


def _searches(searches: Sequence[Falsification]) -> Iterator[Block]:
    if searches:
        drawn = [pictures.search_picture(search, place) for place, search in enumerate(searches)]
        sections = search_sections(searches, drawn)
        yield Only(("markdown",), sections)
        title = "What a search for counterexamples found"
        yield Only(PAGES, (Section(name="search", title=title, short="Search", blocks=sections),))


def _condition(certificate: Certificate, lambdas: Mapping[str, Matrix]) -> Section:
    """The condition that is decided, and the matrices of the certificate."""
    problem = certificate.problem
    rounded = "Entries with a decimal point are rounded for this page; certificate.json holds them exactly."
    matrices = Matrices(tuple(formulas.matrices_of(certificate)))
    blocks = [*_disturbed(problem)] if problem.groups else [*_undisturbed()]
    if matrices.items:
        blocks += [matrices, Only(PAGES, (Text(rounded, "caption"),))]
    for name, bound in formulas.bounds_of(certificate).items():
        latex = rf"\lambda_{{\max}}(\Lambda) < {latex_number(bound)}"
        blocks.append(Only(TEXTS, (Text(f"For {name}:"), Formula(latex=latex))))
        blocks.append(Only(PAGES, (Formula(latex=latex, label=f"for {name}", typst=bound),)))
    blocks += [Matrices((each,)) for each in formulas.lambda_matrices(lambdas)]
    title = "The condition and its matrices"
    return Section(name="condition", title=title, short="Condition", blocks=tuple(blocks))


def _undisturbed() -> Iterator[Block]:
    yield Only(PAGES, (Text("Without a disturbance, Lemma 1 asks in every mode for"),))
    yield Formula(latex=formulas.LAMBDA + " < 0", typst="lemma 1")
    yield Only(PAGES, (Text(("where ", Math("J", "J"), " is the Jacobian of the couplings.")),))


def _disturbed(problem: Problem) -> Iterator[Block]:
    asks: Words = (
        "Theorems 1 and 2 ask for matrices ",
        Math("P > 0", "P > 0"),
        " and ",
        Math("Q", "Q"),
        ", with ",
        Math("W = P⁻¹ Q", "W = P^{-1} Q"),
        ", such that in every mode",
    )
    jacobian: Words = (
        "where ",
        Math("J", "J"),
        " is the Jacobian of the couplings. The size of the condition does not matter, because exactly",
    )
    yield Only(PAGES, (Text(asks),))
    yield Formula(latex=formulas.PSI, number="(18)", typst="psi")
    yield Formula(latex=formulas.LAMBDA, typst="lambda")
    yield Formula(latex=formulas.OMEGA, typst="omega")
    yield Only(PAGES, (Text(jacobian),))
    yield Formula(latex=formulas.REDUCED, typst="reduced")
    yield Only(PAGES, (Text("and, when nothing is said about P and Q,"),))
    yield Formula(latex=formulas.BY_EXISTENCE, typst="existence")
    if problem.is_grouped:
        yield Text(nw.BY_GROUP)


def _eigenvalues(certificate: Certificate, analysis: Analysis | None) -> Iterator[Section]:
    """As pictures on pages, as numbers in Markdown."""
    if analysis is None:
        return
    seen = _observability(analysis)
    drawn = tuple(pictures.eigenvalue_pictures(certificate, analysis))
    computed = "Computed in floating point, to show how far things are from the edge. No verdict rests on them."
    table = table_of(
        "Eigenvalues",
        list(_spectra(analysis))[:MOST_SPECTRA],
        (Column(head="matrix"), lambda row: row[0]),
        (Column(head="eigenvalues in 1/s, the rightmost first"), lambda row: _values(row[1])),
    )
    blocks = (
        Only(
            ("markdown",),
            (
                Text("Computed in floating point, for orientation. No verdict rests on them."),
                *((Text(seen),) if seen else ()),
                table,
            ),
        ),
        Only(PAGES, (Text(" ".join(filter(None, (computed, seen)))), Pictures(drawn)) if drawn else ()),
    )
    yield Section(name="eigenvalues", title="Eigenvalues", short="Eigenvalues", blocks=blocks)


def _spectra(analysis: Analysis) -> Iterator[tuple[str, Sequence[complex]]]:
    if analysis.spectrum is not None:
        yield "A − WC", analysis.spectrum.eigenvalues
    for mode in analysis.modes:
        if mode.lambda_eigenvalues is not None:
            yield f"Λ(J), mode {mode.mode}", mode.lambda_eigenvalues[::-1]
        if mode.loop_eigenvalues is not None:
            yield f"J − K, mode {mode.mode}", mode.loop_eigenvalues


def _values(values: Sequence[complex]) -> str:
    shown = [
        number(v.real) + (f" {'−' if v.imag < 0 else '+'} {number(abs(v.imag))}i" if v.imag else "")
        for v in map(complex, values[:MOST_EIGENVALUES])
    ]
    hidden = len(values) - len(shown)
    return ", ".join(shown) + (f" and {hidden} more" if hidden else "")


def _observability(analysis: Analysis) -> str | None:
    found = analysis.observability
    if found is None:
        return None
    margins = [
        f"{number(each.margin)} at {_eigenvalue(each.eigenvalue)}" for each in found.modes if each.eigenvalue.imag >= 0
    ]
    return (
        f"In floating point the observability matrix has rank {found.rank} of {found.order}. The smallest singular"
        f" value of [A − λI; C] at the eigenvalues λ of A, 0 meaning unseen: {', '.join(margins[:12])}."
    )


def _eigenvalue(value: complex) -> str:
    real = number(value.real) if value.real or not value.imag else ""
    return f"{real}{' ± ' if real else '±'}{number(value.imag)}i" if value.imag else real


def _simulation(certificate: Certificate, trajectory: Trajectory | None) -> Iterator[Section]:
    """As pictures on pages, as a few samples in Markdown."""
    if trajectory is None or len(trajectory.times) == 0:
        return
    told = f"An illustration, not a proof. {_run_sentence(trajectory)}"
    error = trajectory.error()
    table = table_of(
        "Largest error over time",
        thinned_rows(len(trajectory.times), MOST_SAMPLES).tolist(),
        (Column(head="time in s"), lambda i: number(float(trajectory.times[i]))),
        (Column(head="largest error"), lambda i: number(float(error[i]))),
    )
    drawn = tuple(pictures.simulation_pictures(certificate, trajectory))
    note = Text(f"{told} One run shows one start; the verdict above does not use it.")
    blocks = (Only(("markdown",), (Text(told), table)), Only(PAGES, (note, Pictures(drawn)) if drawn else ()))
    yield Section(name="simulation", title="A simulation", short="Simulation", blocks=blocks)


def _run_sentence(trajectory: Trajectory) -> str:
    error = trajectory.error()
    first, last = float(error[0]), float(error[-1])
    text = f"One run of {number(float(trajectory.times[-1]))} s in mode {trajectory.mode}, seed {trajectory.seed}:"
    text += f" the largest error {'falls' if last < first else 'grows'} from {number(first)} to {number(last)}."
    if trajectory.diverged:
        text += f" The run diverged and could not be carried to {number(trajectory.t_final)} s."
    return text


def _glossary() -> Section:
    verdicts = Terms(tuple((mark_of(verdict), "", MEANINGS[verdict]) for verdict in Verdict))
    blocks = (verdicts, Only(PAGES, (Terms(_WORDS),)))
    return Section(name="glossary", title="Glossary", short="Glossary", blocks=blocks)
