"""What a report says about a certificate, as one document for all forms.  Handed everything, computes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from dobc_design._show.text import latex_number, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.kinds import KINDS
from dobc_design.exact.matrix import Matrix
from dobc_design.plotting.look import thinned_rows
from dobc_design.problem.problem import Problem
from dobc_design.report import document as doc
from dobc_design.report import formulas, pictures, words
from dobc_design.report.checks import (
    checks_section,
    cure_section,
    recheck_section,
    reproduction,
    signatures_section,
    title_block,
    trace_section,
)
from dobc_design.report.region_words import region_section, settling_section
from dobc_design.report.search_words import search_sections
from dobc_design.report.words import number, shortened, typeset
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.conditions.schedule.checks import StageTiming
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

MOST_NOTES = 60
LONGEST_NAME = 70  # characters, in the footer of a printed page
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
) -> doc.Document:
    """The document.

    ``analysis`` and ``trajectory`` are shown where they are given.  ``lambdas``: mode -> Lambda(J) at the consensus,
    printed up to 12 x 12.  ``timings``: sampling and delays of the stages of a settling time; ``searches`` for
    counterexamples.
    """
    problem, again, verdict = certificate.problem, reproduction(certificate), certificate.verdict
    box = doc.Box(
        mark=words.mark_of(verdict),
        word=verdict.value.capitalize(),
        reason=certificate.reason,
        facts=_facts(certificate),
    )
    identity = title_block(certificate, again)
    blocks: list[doc.Block] = [
        doc.Only(("markdown",), (doc.Facts((*identity, *box.facts)),)),
        *cure_section(certificate.checks),
        *_meaning(certificate),
        _problem(problem),
        _network(certificate, analysis),
        *region_section(problem, certificate.regions, tuple(pictures.region_pictures(certificate.regions))),
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
    return doc.Document(
        kind="Certificate of consensus",
        name=problem.name,
        title=f"{problem.name}: {verdict.value}",
        verdict=box,
        identity=identity,
        footer=f"{shortened(problem.name, LONGEST_NAME)}: {verdict.value} · certificate {again.prints[1][1][:16]}…",
        blocks=tuple(blocks),
    )


def _facts(certificate: Certificate) -> tuple[tuple[str, str], ...]:
    facts = []
    if certificate.verdict is Verdict.PROVED:
        domain = words.covering_domain(certificate)
        facts.append(("Holds", words.domain_words(domain) if domain is not None else "–"))
        rate = certificate.rate
        facts.append(("Certified rate", "–" if rate is None else f"{typeset(significant_towards_zero(rate))} 1/s"))
        facts.append(("Carried by", KINDS[certificate.covered_by].name if certificate.covered_by in KINDS else "–"))
    counts = [(v, sum(check.verdict is v for check in certificate.checks)) for v in Verdict]
    facts.append(("Checks", ", ".join(f"{count} {v.value}" for v, count in counts if count) or "none"))
    facts.append(("Agents", str(certificate.problem.n)))
    facts.append(("Modes", str(len(certificate.problem.network.modes))))
    return tuple(facts)


def _meaning(certificate: Certificate) -> Iterator[doc.Section]:
    yes, no = words.what_it_means(certificate)
    says = doc.Section(title="It says", blocks=(doc.List(tuple(yes)),))
    says_not = doc.Section(title="It does not say", blocks=(doc.List(tuple(no)),))
    title = "What this says, and what it does not"
    yield doc.Section(name="meaning", title=title, short="Meaning", blocks=(doc.Beside(((says,), (says_not,))),))
    notes = certificate.claims.notes[:MOST_NOTES] or ("Nothing was assumed or designed beyond the problem file.",)
    title = "What was given, assumed and designed"
    yield doc.Section(name="assumptions", title=title, short="Assumptions", blocks=(doc.List(notes),))


def _problem(problem: Problem) -> doc.Section:
    """The problem in a few sentences, and its equations with the numbers of the paper."""
    given = (
        words.size_sentence(problem),
        words.pin_sentence(problem),
        words.region_sentence(problem),
        words.switching_sentence(problem),
    )
    disturbed = ", disturbed" if problem.groups else ""
    loop = formulas.LOOP_DISTURBED if problem.groups else formulas.LOOP
    coupling, target = formulas.coupling_latex(problem.coupling), formulas.target_latex(problem)
    letters = "h(y)" if problem.coupling.by_component else "h(y) by components"
    plain = f"{letters} = {', '.join(problem.coupling.texts)}"
    lists: list[doc.Block] = []
    for head, sentences in (
        ("Each agent has the A, C and W of its group:", words.group_sentences(problem)),
        ("Arcs with a coupling of their own:", words.exception_sentences(problem)),
    ):
        if sentences:
            lists += [doc.Text(head), doc.List(tuple(sentences))]
    return doc.Section(
        name="problem",
        title="The problem",
        short="Problem",
        blocks=(
            doc.Text(" ".join(filter(None, given))),
            *(
                doc.Formula(latex=latex, label=name, number=equation, typst=name + disturbed)
                for name, latex, equation in loop
            ),
            doc.Only(("markdown",), (doc.Text("Coupling and target:"),)),
            doc.Only(doc.TEXTS, (doc.Formula(latex=coupling), doc.Formula(latex=target))),
            doc.Only(
                ("html",), (doc.Formula(latex=coupling, label="coupling"), doc.Formula(latex=target, label="target"))
            ),
            doc.Only(("pdf",), (doc.Facts((("coupling", plain), ("target", words.vector_text(problem.target)))),)),
            doc.Text(_letters(problem)),
            *lists,
        ),
    )


def _letters(problem: Problem) -> doc.Words:
    """What the letters of the equations mean."""
    formation = (" Agents keep their formation: ", doc.Math("x_i", "x_i"), " is measured from the offset of agent i.")
    return (
        "Here ",
        doc.Math("N_i", "N_i"),
        " are the agents that i listens to, ",
        doc.Math("w_ij", "w_{ij}"),
        " weights (1 unless said), ",
        doc.Math("k_i", "k_i"),
        " the gain of a pin (a number or a matrix), 0 without one.",
        *(formation if problem.offsets else ()),
    )


def _network(certificate: Certificate, analysis: Analysis | None) -> doc.Section:
    problem = certificate.problem
    sentences, agents = words.mode_sentences(problem), words.agents_table(problem)
    hidden = len(problem.network.modes) - len(sentences)
    drawn, legend = pictures.network_pictures(certificate)
    shown = doc.Only(doc.PAGES, (doc.Pictures(drawn, small=True), doc.Text(legend, "caption")))
    table = () if agents is None else (agents,)
    return doc.Section(
        name="network",
        title="Who listens to whom",
        short="Network",
        blocks=(
            doc.List(tuple(f"{name}: {sentence}" for name, sentence in sentences)),
            *((doc.Only(doc.PAGES, (doc.Text(f"And {hidden} more modes."),)),) if hidden else ()),
            *((doc.Beside(((shown,), table), second_wider=True),) if len(drawn) == 1 and table else (shown, *table)),
            *_graphs(analysis),
        ),
    )


def _graphs(analysis: Analysis | None) -> Iterator[doc.Block]:
    if analysis is not None and analysis.graphs:
        yield doc.table_of(
            "Facts about the graph of each mode; eigenvalues in floating point, for orientation",
            list(zip(analysis.graphs, analysis.modes, strict=False))[:MOST_GRAPHS],
            (doc.Column(head="mode", width=1.4), lambda each: each[0].mode),
            (doc.Column(head="arcs"), lambda each: str(each[0].arcs)),
            (
                doc.Column(head="strong components", width=1.2),
                lambda each: "one" if each[0].is_strongly_connected else str(len(each[0].components)),
            ),
            (doc.Column(head="balanced"), lambda each: "yes" if each[0].balanced else "no"),
            (doc.Column(head="not reached", width=1.2), lambda each: words.names_in_words(each[0].unreached, 6)),
            (
                doc.Column(head="λmax(Λ) in 1/s", width=1.2, style="number"),
                lambda each: number(each[1].lambda_max),
            ),
            (doc.Column(head="decay in 1/s", width=1.2, style="number"), lambda each: number(each[1].decay_rate)),
        )


def _searches(searches: Sequence[Falsification]) -> Iterator[doc.Block]:
    if searches:
        drawn = [pictures.search_picture(search, place) for place, search in enumerate(searches)]
        sections = search_sections(searches, drawn)
        yield doc.Only(("markdown",), sections)
        title = "What a search for counterexamples found"
        yield doc.Only(doc.PAGES, (doc.Section(name="search", title=title, short="Search", blocks=sections),))


def _condition(certificate: Certificate, lambdas: Mapping[str, Matrix]) -> doc.Section:
    """The condition that is decided, and the matrices of the certificate."""
    problem = certificate.problem
    rounded = "Entries with a decimal point are rounded for this page; certificate.json holds them exactly."
    matrices = doc.Matrices(tuple(formulas.matrices_of(certificate)))
    blocks = [*_disturbed(problem)] if problem.groups else [*_undisturbed()]
    if matrices.items:
        blocks += [matrices, doc.Only(doc.PAGES, (doc.Text(rounded, "caption"),))]
    for name, bound in formulas.bounds_of(certificate).items():
        latex = rf"\lambda_{{\max}}(\Lambda) < {latex_number(bound)}"
        blocks.append(doc.Only(doc.TEXTS, (doc.Text(f"For {name}:"), doc.Formula(latex=latex))))
        blocks.append(doc.Only(doc.PAGES, (doc.Formula(latex=latex, label=f"condition for {name}", typst=bound),)))
    blocks += [doc.Matrices((each,)) for each in formulas.lambda_matrices(lambdas)]
    title = "The condition and its matrices"
    return doc.Section(name="condition", title=title, short="Condition", blocks=tuple(blocks))


def _undisturbed() -> Iterator[doc.Block]:
    yield doc.Only(doc.PAGES, (doc.Text("Without a disturbance, Lemma 1 asks in every mode for"),))
    yield doc.Formula(latex=formulas.LAMBDA + " < 0", typst="lemma 1")
    yield doc.Only(doc.PAGES, (doc.Text(("where ", doc.Math("J", "J"), " is the Jacobian of the couplings.")),))


def _disturbed(problem: Problem) -> Iterator[doc.Block]:
    asks: doc.Words = (
        "Theorems 1 and 2 ask for matrices ",
        doc.Math("P > 0", "P > 0"),
        " and ",
        doc.Math("Q", "Q"),
        ", with ",
        doc.Math("W = P⁻¹ Q", "W = P^{-1} Q"),
        ", such that in every mode",
    )
    jacobian: doc.Words = (
        "where ",
        doc.Math("J", "J"),
        " is the Jacobian of the couplings. The size of the condition does not matter, because exactly",
    )
    yield doc.Only(doc.PAGES, (doc.Text(asks),))
    yield doc.Formula(latex=formulas.PSI, number="(18)", typst="psi")
    yield doc.Formula(latex=formulas.LAMBDA, typst="lambda")
    yield doc.Formula(latex=formulas.OMEGA, typst="omega")
    yield doc.Only(doc.PAGES, (doc.Text(jacobian),))
    yield doc.Formula(latex=formulas.REDUCED, typst="reduced")
    yield doc.Only(doc.PAGES, (doc.Text("and, when nothing is said about P and Q,"),))
    yield doc.Formula(latex=formulas.BY_EXISTENCE, typst="existence")
    if problem.is_grouped:
        yield doc.Text(words.BY_GROUP)


def _eigenvalues(certificate: Certificate, analysis: Analysis | None) -> Iterator[doc.Section]:
    """As pictures on pages, as numbers in Markdown."""
    if analysis is None:
        return
    seen = _observability(analysis)
    drawn = tuple(pictures.eigenvalue_pictures(certificate, analysis))
    computed = "Computed in floating point, to show how far things are from the edge. No verdict rests on them."
    table = doc.table_of(
        "Eigenvalues",
        list(_spectra(analysis))[:MOST_SPECTRA],
        (doc.Column(head="matrix"), lambda row: row[0]),
        (doc.Column(head="eigenvalues in 1/s, the rightmost first"), lambda row: _values(row[1])),
    )
    blocks = (
        doc.Only(
            ("markdown",),
            (
                doc.Text("Computed in floating point, for orientation. No verdict rests on them."),
                *((doc.Text(seen),) if seen else ()),
                table,
            ),
        ),
        doc.Only(doc.PAGES, (doc.Text(" ".join(filter(None, (computed, seen)))), doc.Pictures(drawn)) if drawn else ()),
    )
    yield doc.Section(name="eigenvalues", title="Eigenvalues", short="Eigenvalues", blocks=blocks)


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


def _simulation(certificate: Certificate, trajectory: Trajectory | None) -> Iterator[doc.Section]:
    """As pictures on pages, as a few samples in Markdown."""
    if trajectory is None or len(trajectory.times) == 0:
        return
    told = f"An illustration, not a proof. {_run_sentence(trajectory)}"
    error = trajectory.error()
    table = doc.table_of(
        "Largest error over time",
        thinned_rows(len(trajectory.times), MOST_SAMPLES).tolist(),
        (doc.Column(head="time in s"), lambda i: number(float(trajectory.times[i]))),
        (doc.Column(head="largest error"), lambda i: number(float(error[i]))),
    )
    drawn = tuple(pictures.simulation_pictures(certificate, trajectory))
    note = doc.Text(f"{told} One run shows one start; the verdict above does not use it.")
    blocks = (
        doc.Only(("markdown",), (doc.Text(told), table)),
        doc.Only(doc.PAGES, (note, doc.Pictures(drawn)) if drawn else ()),
    )
    yield doc.Section(name="simulation", title="A simulation", short="Simulation", blocks=blocks)


def _run_sentence(trajectory: Trajectory) -> str:
    error = trajectory.error()
    first, last = float(error[0]), float(error[-1])
    text = f"One run of {number(float(trajectory.times[-1]))} s in mode {trajectory.mode}, seed {trajectory.seed}:"
    text += f" the largest error {'falls' if last < first else 'grows'} from {number(first)} to {number(last)}."
    if trajectory.diverged:
        text += f" The run diverged and could not be carried to {number(trajectory.t_final)} s."
    return text


def _glossary() -> doc.Section:
    verdicts = doc.Terms(tuple((words.mark_of(verdict), "", words.MEANINGS[verdict]) for verdict in Verdict))
    blocks = (verdicts, doc.Only(doc.PAGES, (doc.Terms(_WORDS),)))
    return doc.Section(name="glossary", title="Glossary", short="Glossary", blocks=blocks)
