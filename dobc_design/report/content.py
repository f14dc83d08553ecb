"""What a report says about a certificate, as one document for all forms.  Handed everything,
computes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dobc_design._show.text import latex_decimal, latex_matrix, latex_number
from dobc_design.certificate import text as certificate_text
from dobc_design.certificate.certificate import Certificate
from dobc_design.exact.matrix import Matrix
from dobc_design.plotting.look import thinned_rows
from dobc_design.problem.dynamics import Dynamics
from dobc_design.problem.integrators import as_integrators
from dobc_design.problem.problem import Problem
from dobc_design.problem.words import caution_lines
from dobc_design.report import checks, pictures, words
from dobc_design.report import document as doc
from dobc_design.report.plant import plant_section
from dobc_design.report.region_words import region_section, search_sections, settling_section
from dobc_design.report.words import number
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    from dobc_design.analysis.analysis import Analysis
    from dobc_design.falsification.suspect import Falsification
    from dobc_design.simulation.trajectory import Trajectory

MOST_NOTES = 60
LONGEST_NAME = 70  # characters, in the footer of a printed page
MOST_GRAPHS, MOST_SPECTRA = 12, 40  # rows
MOST_SAMPLES, MOST_LAMBDAS = 9, 6
LONGEST_VECTOR = 12
_ALSO = "Optional changes"
_REGION, _DESIGN = "dobc region problem.json", "dobc design problem.json --out designed.toml"
_HELP = "What would help: "  # in the reason of an undecided certificate
_SHARED = {latex for _, latex, _ in words.TEXTS["loop"]["disturbed"]}


def report_document(
    certificate: Certificate,
    *,
    analysis: Analysis | None = None,
    trajectory: Trajectory | None = None,
    worst: Trajectory | None = None,
    lambdas: Mapping[str, Matrix] | None = None,
    searches: Sequence[Falsification] = (),
    kernel: str = "",
) -> doc.Document:
    """The document.  ``analysis``, ``trajectory`` and ``worst``, a run with a slow signal, are
    shown where given. ``lambdas``: mode -> Lambda(J) at the consensus, printed up to 12 x 12;
    ``searches`` for counterexamples; ``kernel``: what Coq says."""
    problem, prints, verdict = (
        certificate.problem,
        checks.fingerprints(certificate),
        certificate.verdict,
    )
    mark, proved = words.mark_of(verdict), verdict is Verdict.PROVED
    facts = [
        (name, told) for name, told in words.facts(certificate).items() if proved or told != "–"
    ]
    file_format = f"{certificate_text.FORMAT} {certificate_text.VERSION}"
    identity = (*prints, ("Decided by", f"dobc_design {certificate.claims.version}, {file_format}"))
    yes, no = words.what_it_means(certificate)
    says, says_not = (
        doc.Section("It says", (doc.List(yes),)),
        doc.Section("It does not say", (doc.List(no),)),
    )
    signs = doc.Signatures(
        ("Name", "Date", "Signature"), ("Prepared by", "Checked by", "Approved by")
    )
    verdicts = doc.Terms(
        [(words.mark_of(each), words.TEXTS["verdicts"][each.value]) for each in Verdict]
    )
    return doc.Document(
        kind="Certificate of consensus",
        name=problem.name,
        title=f"{problem.name}: {verdict.value}",
        verdict=doc.Box(
            mark=mark,
            word=verdict.value.capitalize(),
            reason=words.sentence(
                certificate.reason.removeprefix("Undecided: ").partition(_HELP)[0].strip()
            ),
            facts=facts,
        ),
        identity=identity,
        footer=f"{words.shortened(problem.name, LONGEST_NAME)}: {verdict.value} · certificate "
        f"{prints[1][1][:16]}…",
        blocks=(
            doc.in_markdown(doc.Facts((*identity, *facts))),
            doc.Section(
                "What this says, and what it does not",
                (doc.Beside(((says,), (says_not,))),),
                "meaning",
            ),
            *plant_section(certificate),
            _loop(certificate),
            *_bound(certificate, trajectory, worst),
            *_next_step(certificate),
        ),
        details=(
            _problem(problem),
            _network(certificate, analysis),
            *region_section(
                problem, certificate.regions, tuple(pictures.region_pictures(certificate.regions))
            ),
            *settling_section(
                certificate.settling, tuple(pictures.envelope_pictures(certificate.settling))
            ),
            *_searches(searches),
            *(
                replace(each, title=_ALSO)
                for each in checks.cure_section(certificate.checks)
                if proved
            ),
            checks.checks_section(certificate.checks, proved=proved),
            _condition(certificate, lambdas or {}),
            *_eigenvalues(certificate, analysis),
            *_simulation(certificate, trajectory),
            checks.trace_section(certificate.checks),
            checks.recheck_section(certificate, prints, kernel),
            doc.Section(
                "Words",
                (verdicts, doc.on_pages(doc.Terms([*words.TEXTS["words"].items()]))),
                "glossary",
            ),
            doc.Section(
                "Signatures", (doc.Text(words.TEXTS["fixed"]["signing"]), signs), "signatures"
            ),
        ),
    )


def _loop(certificate: Certificate) -> doc.Section:
    """The network as a drawing, beside it what the engineer has designed, in decimals; what looks
    like a slip."""
    drawn, legend = pictures.network_pictures(certificate)
    notes = words.shown_notes(certificate)[:MOST_NOTES]
    shown: tuple[doc.Block, ...] = (doc.Pictures(drawn, small=True), doc.Text(legend, "caption"))
    facts: tuple[doc.Block, ...] = (doc.Facts(words.loop_facts(certificate)),)
    facts += tuple(
        doc.Text(words.sentence(each), "warning") for each in caution_lines(certificate.problem)
    )
    given = (doc.Section("Given and assumed", (doc.List(notes),)),) if notes else ()
    both = (
        (doc.Beside((shown, (*facts, *given)), second_wider=True),)
        if len(drawn) == 1
        else (*shown, *facts, *given)
    )
    return doc.Section("The loop", (doc.on_pages(*both), doc.in_markdown(*facts, *given)), "loop")


def _bound(
    certificate: Certificate, trajectory: Trajectory | None, worst: Trajectory | None
) -> Iterator[doc.Block]:
    """One picture: what is proved about the largest error, and one simulated run, or two."""
    if trajectory is not None and len(trajectory.times) > 1:
        picture = pictures.error_picture(certificate, trajectory, worst)
        title = (
            "Certified bound and simulation"
            if certificate.envelope(trajectory).sources
            else "Simulated error"
        )
        drawn = (picture, *pictures.weight_pictures(certificate))
        yield doc.on_pages(doc.Section(title, (doc.Pictures(drawn),), "bound"))


def _next_step(certificate: Certificate) -> Iterator[doc.Section]:
    """What to do now: how a reviewer checks what is proved, else the cure, or what would settle
    it."""
    if certificate.verdict is Verdict.PROVED:
        told = (
            "Send certificate.json and problem.json with this report. A reviewer decides every "
            "claim again with"
        )
        blocks = (
            doc.Text(told),
            doc.Code((checks.VERIFY,), command=True),
            doc.Text(words.deployment_words(certificate)),
        )
        yield doc.Section("What to do next", blocks, "next")
        return
    cures, advice = (
        tuple(checks.cure_section(certificate.checks)),
        certificate.reason.partition(_HELP)[2],
    )
    yield from cures
    if advice:
        told = f"{words.sentence(advice)} This command shows from which starts consensus is proved:"
        yield doc.Section(
            "What would decide it", (doc.Text(told), doc.Code((_REGION,), command=True)), "next"
        )
    elif not cures and certificate.problem.dynamics is None:
        told = (
            "This command searches for pins and gains that are proved for the problem, or "
            "proves that there are none:"
        )
        yield doc.Section(
            "What to do next", (doc.Text(told), doc.Code((_DESIGN,), command=True)), "next"
        )


def _problem(problem: Problem) -> doc.Section:
    """The problem in a few sentences, and its equations with the numbers of the paper."""
    disturbed, own = ", disturbed" if problem.groups else "", problem.dynamics
    kind = (
        disturbed if own is None else f"{disturbed}, {'dynamic' if own.f is None else 'nonlinear'}"
    )
    kind += "" if problem.leader is None else ", led in formation" if problem.offsets else ", led"
    agents = "" if own is None else "dynamic"
    equations = words.TEXTS["loop"][
        f"{agents}{' disturbed' if problem.groups else ''}".strip() or "plain"
    ]
    coupling, target = _coupling(problem), _target(problem)
    letters = "h(y)" if problem.coupling.by_component else "h(y) by components"
    plain = [("coupling", f"{letters} = {', '.join(problem.coupling.texts)}")]
    plain += (
        [] if own is None or own.f is None else [("own dynamics", f"f(x) = ({', '.join(own.f)})")]
    )
    blocks: list[doc.Block] = [
        doc.Text(words.problem_words(problem)),
        *(
            doc.Formula(
                _own(latex, problem),
                name,
                equation,
                name + (disturbed if latex in _SHARED else kind),
            )
            for name, latex, equation in equations
        ),
        *(() if own is None else (doc.Matrices(tuple(_plant(problem))),)),
        doc.Only(
            ("html", *doc.TEXTS),
            (*_nodes(own), doc.Formula(coupling, "coupling"), doc.Formula(target, "target")),
        ),
        doc.Only(("pdf",), (doc.Facts((*plain, ("target", words.target_words(problem)))),)),
        doc.Text(_letters(problem)),
    ]
    for head, sentences in (
        ("Each agent has the A, C and W of its group:", words.group_sentences(problem)),
        ("Arcs with a coupling of their own:", words.exception_sentences(problem)),
    ):
        if sentences:
            blocks += [doc.Text(head), doc.List(sentences)]
    return doc.Section("The problem", blocks, "problem", "Problem")


def _own(latex: str, problem: Problem) -> str:
    """An equation of the loop, with f(x) in place of A x where that is given, and with a leader as
    the target."""
    dynamics = problem.dynamics
    if problem.leader is not None and problem.offsets:
        latex = latex.replace(r"x_i - \bar x_i", "x_i - s - o_i").replace(r"\bar x_i", "o_i")
    elif problem.leader is not None:
        latex = latex.replace(r"x_i - \bar x_i", "x_i - s").replace(
            r" + u^0_i, \quad A_x \bar x_i + B u^0_i = 0", ""
        )
    if dynamics is None or dynamics.f is None:
        return latex
    return latex.replace("A_x x_i", "f(x_i)").replace(r"A_x \bar x_i", r"f(\bar x_i)")


def _nodes(dynamics: Dynamics | None) -> Iterator[doc.Block]:
    """LaTeX of f, a function of x or a column of functions of x_1 to x_m."""
    if dynamics is not None and dynamics.f is not None:
        rows = r" \\ ".join(dynamics.latex)
        column = rows if dynamics.dimension == 1 else rf"\begin{{pmatrix}} {rows} \end{{pmatrix}}"
        yield doc.Formula(f"f(x) = {column}", "own dynamics")


def _plant(problem: Problem) -> Iterator[doc.ShownMatrix]:
    """A_x and B of agents with [dynamics]."""
    if problem.dynamics is not None:
        if problem.dynamics.A is not None:
            yield doc.ShownMatrix(
                "A_x",
                "how the state of an agent moves by itself, A of [dynamics]",
                problem.dynamics.A,
            )
        yield doc.ShownMatrix(
            "B", "how inputs, couplings and disturbance act on it", problem.dynamics.B
        )


def _coupling(problem: Problem) -> str:
    """LaTeX of h: one function of y, or a column of functions of y_1 to y_m."""
    latex = problem.coupling.latex
    column = r"\begin{pmatrix} " + r" \\ ".join(latex) + r" \end{pmatrix}"
    return f"h_{{ij}}(y) = {latex[0] if problem.coupling.by_component else column}"


def _target(problem: Problem) -> str:
    """LaTeX of the target, as a number if it has one entry, else as a transposed row."""
    target, leader, own = problem.target, problem.leader, problem.dynamics
    if leader is not None and own is not None:
        box = r" \times ".join(
            f"[{latex_number(lo)}, {latex_number(hi)}]"
            for lo, hi in leader.initial[:LONGEST_VECTOR]
        )
        starts = rf",\quad s(0) \in {box}" if len(target) <= LONGEST_VECTOR else ""
        return rf"\dot s = {'A_x s' if own.f is None else 'f(s)'}{starts}"
    if len(target) > LONGEST_VECTOR:
        return rf"\bar{{x}} \in \mathbb{{R}}^{{{len(target)}}}"
    return (
        rf"\bar{{x}} = {latex_number(target[0])}"
        if len(target) == 1
        else rf"\bar{{x}} = {latex_matrix([target])}'"
    )


def _letters(problem: Problem) -> doc.Words:
    """What the letters of the equations mean."""
    neighbours = ("Here ", doc.Math("N_i", "N_i"), " are the agents that i listens to, ")
    heard = (*neighbours, doc.Math("w_ij", "w_{ij}"), " weights (1 unless said), ")
    if problem.dynamics is not None:
        led, held = problem.leader is not None, problem.leader is None or bool(problem.offsets)
        knows = " (pinned agents know s, the others do not)" if led else ""
        constant = (
            doc.Math("u⁰_i", "u^0_i"),
            " the constant input that holds the agent at its goal.",
        )
        whom = (
            f"the {'leader s' if led else 'target'}{' plus its offset' if problem.offsets else ''}"
        )
        return (
            *heard,
            doc.Math("e_i", "e_i"),
            f" how far agent i is from {whom}, ",
            doc.Math("K_i", "K_i"),
            f" the gain of a pin, 0 without one{knows}{', and ' if held else '.'}",
            *(constant if held else ()),
        )
    formation = (
        " Agents keep their formation: ",
        doc.Math("x_i", "x_i"),
        " is measured from the offset of agent i.",
    )
    return (
        *heard,
        doc.Math("k_i", "k_i"),
        " the gain of a pin (a number or a matrix), 0 without one.",
        *(formation if problem.offsets else ()),
    )


def _network(certificate: Certificate, analysis: Analysis | None) -> doc.Section:
    problem = certificate.problem
    sentences, agents = words.mode_sentences(problem), words.agents_table(problem)
    hidden = len(problem.network.modes) - len(sentences)
    blocks = (
        doc.List(sentences),
        *((doc.on_pages(doc.Text(f"And {hidden} more modes.")),) if hidden else ()),
        *(() if agents is None else (agents,)),
        *_graphs(analysis),
    )
    return doc.Section("Who listens to whom", blocks, "network", "Network")


def _graphs(analysis: Analysis | None) -> Iterator[doc.Block]:
    if analysis is not None and analysis.graphs:
        yield doc.table_of(
            "Facts about the graph of each mode; eigenvalues in floating point, for orientation",
            list(zip(analysis.graphs, analysis.modes, strict=False))[:MOST_GRAPHS],
            doc.Column("mode", lambda each: each[0].mode, 1.4),
            doc.Column("arcs", lambda each: str(each[0].arcs)),
            doc.Column(
                "strong components",
                lambda each: (
                    "one" if each[0].is_strongly_connected else str(len(each[0].components))
                ),
                1.2,
            ),
            doc.Column("balanced", lambda each: "yes" if each[0].balanced else "no"),
            doc.Column("not reached", lambda each: words.names_in_words(each[0].unreached, 6), 1.2),
            doc.Column(
                "λmax(Λ) in 1/s", lambda each: number(each[1].lambda_max), 1.2, style="number"
            ),
            doc.Column(
                "decay in 1/s", lambda each: number(each[1].decay_rate), 1.2, style="number"
            ),
            cards=True,
        )


def _searches(searches: Sequence[Falsification]) -> Iterator[doc.Block]:
    if searches:
        drawn = [pictures.search_picture(search, place) for place, search in enumerate(searches)]
        sections = search_sections(searches, drawn)
        yield doc.Section("What a search for counterexamples found", sections, "search", "Search")


def _condition(certificate: Certificate, lambdas: Mapping[str, Matrix]) -> doc.Section:
    """The condition that is decided, and the matrices of the certificate."""
    rounded = (
        "Entries with a decimal point are rounded for this page; certificate.json holds them "
        "exactly."
    )
    matrices = doc.Matrices(tuple(_matrices(certificate)))
    own = certificate.problem.dynamics
    slopes = "" if own is None or own.f is None else " Aₓ holds the slopes of f at the target."
    if slopes and certificate.problem.leader is not None:
        slopes = " The slopes of f are bounded over a box that the leader never leaves."
    blocks: list[doc.Block] = (
        [] if own is None else [doc.Text(words.TEXTS["fixed"]["by_errors"] + slopes)]
    )
    blocks += list(_asked(certificate.problem))
    if matrices.items:
        blocks += [matrices, doc.on_pages(doc.Text(rounded, "caption"))]
    for name, bound in words.bounds_of(certificate).items():
        latex = rf"\lambda_{{\max}}(\Lambda) < {latex_decimal(bound)}"
        blocks.append(doc.Only(doc.TEXTS, (doc.Text(f"For {name}:"), doc.Formula(latex))))
        blocks.append(doc.on_pages(doc.Formula(latex, f"condition for {name}", typst=bound)))
    shown = [
        doc.ShownMatrix(r"\Lambda", f"at the target, mode {mode}", matrix)
        for mode, matrix in list(lambdas.items())[:MOST_LAMBDAS]
    ]
    blocks += [doc.Matrices((each,)) for each in shown if each.latex is not None]
    return doc.Section("The condition and its matrices", blocks, "condition", "Condition")


def _matrices(certificate: Certificate) -> Iterator[doc.ShownMatrix]:
    """A, C, W, and P, Q, S where the theorem is proved, S of a printed P beside them."""
    problem, claims = certificate.problem, certificate.claims
    exosystem, own = problem.joint_exosystem, problem.dynamics
    felt = as_integrators(problem).joint_exosystem
    if exosystem is None or felt is None:
        return
    source = f" ({claims.gain_source})" if claims.gain_source else ""
    blocks = words.observer_blocks(certificate)
    for name, what, matrix in (
        ("A", "generator of the disturbance", exosystem.A),
        ("C", "output matrix: d = C ξ acts on the agent", exosystem.C),
        *(() if own is None else (("B C", "what takes the place of C in the condition", felt.C),)),
        ("W", f"observer gain{source}", claims.W),
        ("P", "Lyapunov matrix of the estimation error, found and proved", claims.P),
        ("Q", "P W", claims.Q),
        (
            "S",
            "effect of the observer: Λ + I ⊗ S has to be negative definite",
            blocks.get(words.FOUND),
        ),
        (
            r"P_{\text{given}}",
            "the P of the problem file, tested as it stands",
            problem.joint_observer.P,
        ),
        (r"S_{\text{given}}", "its S", blocks.get(words.GIVEN)),
    ):
        if matrix is not None:
            yield doc.ShownMatrix(name, what, matrix)


def _asked(problem: Problem) -> Iterator[doc.Block]:
    if not problem.groups:
        yield doc.on_pages(doc.Text("Without a disturbance, Lemma 1 asks in every mode for"))
        yield doc.Formula(words.TEXTS["condition"]["lambda"] + " < 0", typst="lemma 1")
        yield doc.on_pages(
            doc.Text(("where ", doc.Math("J", "J"), " is the Jacobian of the couplings."))
        )
        return
    P, Q, W = doc.Math("P > 0", "P > 0"), doc.Math("Q", "Q"), doc.Math("W = P⁻¹ Q", "W = P^{-1} Q")
    asks = (
        "Theorems 1 and 2 ask for matrices ",
        P,
        " and ",
        Q,
        ", with ",
        W,
        ", such that in every mode",
    )
    exactly = " is the Jacobian of the couplings. An equivalent condition of smaller size is used:"
    yield doc.on_pages(doc.Text(asks))
    yield doc.Formula(words.TEXTS["condition"]["psi"], number="(18)", typst="psi")
    yield from (
        doc.Formula(words.TEXTS["condition"][name], typst=name) for name in ("lambda", "omega")
    )
    yield doc.on_pages(doc.Text(("where ", doc.Math("J", "J"), exactly)))
    yield doc.Formula(words.TEXTS["condition"]["reduced"], typst="reduced")
    yield doc.on_pages(doc.Text("and, if P and Q are free,"))
    yield doc.Formula(words.TEXTS["condition"]["existence"], typst="existence")
    if problem.is_grouped:
        yield doc.Text(words.TEXTS["fixed"]["by_group"])


def _eigenvalues(certificate: Certificate, analysis: Analysis | None) -> Iterator[doc.Section]:
    """As pictures on pages, as numbers in Markdown."""
    if analysis is None:
        return
    told = (
        "Computed in floating point, to show how large the margins are. No verdict depends on them."
    )
    drawn = doc.Pictures(tuple(pictures.eigenvalue_pictures(certificate, analysis)))
    table = doc.table_of(
        "Eigenvalues",
        list(_spectra(analysis))[:MOST_SPECTRA],
        doc.Column("matrix", lambda row: row[0]),
        doc.Column(
            "eigenvalues in 1/s, the rightmost first", lambda row: words.eigenvalues(row[1])
        ),
    )
    blocks = (
        doc.Text(told + _observability(analysis)),
        doc.in_markdown(table),
        doc.on_pages(drawn),
    )
    yield doc.Section("Eigenvalues", blocks, "eigenvalues")


def _spectra(analysis: Analysis) -> Iterator[tuple[str, Sequence[complex]]]:
    if analysis.spectrum is not None:
        yield "A − WC", analysis.spectrum.eigenvalues
    for mode in analysis.modes:
        if mode.lambda_eigenvalues is not None:
            yield f"Λ(J), mode {mode.mode}", mode.lambda_eigenvalues[::-1]
        if mode.loop_eigenvalues is not None:
            yield f"J − K, mode {mode.mode}", mode.loop_eigenvalues


def _observability(analysis: Analysis) -> str:
    found = analysis.observability
    if found is None:
        return ""
    seen = [each for each in found.modes if each.eigenvalue.imag >= 0]
    margins = ", ".join(
        f"{number(each.margin)} at {_eigenvalue(each.eigenvalue)}" for each in seen[:12]
    )
    text = (
        f" In floating point the observability matrix has rank {found.rank} of {found.order}. "
        "The smallest singular"
    )
    return (
        text + f" value of [A − λI; C] at the eigenvalues λ of A, 0 means unobservable: {margins}."
    )


def _eigenvalue(value: complex) -> str:
    real = number(value.real) if value.real or not value.imag else ""
    return f"{real}{' ± ' if real else '±'}{number(value.imag)}i" if value.imag else real


def _simulation(certificate: Certificate, trajectory: Trajectory | None) -> Iterator[doc.Section]:
    """As pictures on pages, as a few samples in Markdown."""
    if trajectory is None or len(trajectory.times) == 0:
        return
    error, times = trajectory.error(), trajectory.times
    first, last, end = float(error[0]), float(error[-1]), number(float(times[-1]))
    told = (
        f"An illustration, not a proof. One run of {end} s in mode {trajectory.mode}, seed "
        f"{trajectory.seed}:"
    )
    told += (
        f" the largest error {'falls' if last < first else 'grows'} from {number(first)} to "
        f"{number(last)}."
    )
    if trajectory.diverged:
        told += f" The run diverged and could not be carried to {number(trajectory.t_final)} s."
    table = doc.table_of(
        "Largest error over time",
        thinned_rows(len(times), MOST_SAMPLES).tolist(),
        doc.Column("time in s", lambda i: number(float(times[i]))),
        doc.Column("largest error", lambda i: number(float(error[i]))),
    )
    told += " One run shows one start; the verdict above does not use it."
    drawn = doc.Pictures(tuple(pictures.simulation_pictures(certificate, trajectory)))
    blocks = (doc.Text(told), doc.in_markdown(table), doc.on_pages(drawn))
    yield doc.Section("A simulation", blocks, "simulation", "Simulation")
