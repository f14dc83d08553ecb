"""The sentences of the report: what a verdict says and what it does not, the network and the pins,
numbers."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from importlib.resources import files
from typing import Any, Final

from dobc_design._show.cards import SIGNS
from dobc_design._show.text import (
    significant,
    significant_away_from_zero,
    significant_towards_zero,
    typeset,
    upper,
)
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check, Domain
from dobc_design.conditions.graphs.decide import signals_in_words
from dobc_design.conditions.kinds import KINDS, ids_of
from dobc_design.conditions.numbers import read_rational, time_to_one_percent
from dobc_design.exact.matrix import Matrix, Vector, matrix
from dobc_design.exact.number import decimal_text, number_text
from dobc_design.exact.reading import counted, is_scalar_matrix
from dobc_design.problem.meaning import disturbance_words, time_words
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.problem.settings import Region
from dobc_design.problem.tables import switching_words
from dobc_design.problem.words import leader_words
from dobc_design.report import document as doc
from dobc_design.verdict import Verdict

NO_DELAY = (
    "No delay is certified: for agents with [dynamics] only some max-separable proofs "
    "state one. `dobc stress FILE` "
    "looks for the longest sampling period at which runs converge (all readings, also of "
    "oneself, are then up to a "
    "period old); `dobc stress FILE --period 0.03` makes one run."
)
NO_DELAY_OF_LEADERS = (
    "No delay is certified: for agents with [dynamics] only some max-separable proofs state one. "
    "Delays are not simulated for a target that moves, either."
)
MOST_LISTED = 40  # agents listed one by one
MOST_MODES = 6
MOST_NAMES = 12
MOST_EIGENVALUES = 8
GIVEN, FOUND = "the P given", "the P found"
_TEXT = (files("dobc_design.report") / "templates" / "texts.toml").read_text("utf-8")
TEXTS: Final[dict[str, Any]] = tomllib.loads(_TEXT)
#: Letters and signs as certificates write them.  Lambda and Psi may be labels, too: only where
#: mathematics follows.
_SIGNS = tuple(
    (re.compile(pattern), sign)
    for pattern, sign in (
        (r"\blambda_max\b", "λmax"),
        (r"\b(?<!agent )Lambda(?= [v+]|[()]| is not\b| <)", "Λ"),
        (r"\b(?<!agent )Psi(?= is not\b| <)", "Ψ"),
        (r"\beps_i\b", "εᵢ"),
        (r"\b([evx])_i\b", r"\1ᵢ"),
        (r"\bmax_i\b", "maxᵢ"),
        (r"\bdhat\b", "d̂"),
        (r"\|_P\b", "|ₚ"),
        (r"\|_inf\b", "|∞"),
        (r"\b([A-Zev]|εᵢ)'(?!s\b)", r"\1′"),
        (r"\bA - W", "A − W"),
        (r"(?<![\w.])-(?= ?\d)", "−"),
        ("<=", "≤"),
        (">=", "≥"),
        (r"\(x\)", "⊗"),
    )
)


def mark_of(verdict: Verdict) -> doc.Mark:
    """A verdict as a sign and a word."""
    return doc.Mark(SIGNS[verdict.value], verdict.value)


def domain_words(domain: Domain) -> str:
    """Where a check holds, in a few words."""
    if isinstance(domain, Mapping):
        disturbance = domain.get("disturbance")
        text = (
            f"starts with {'|e|∞' if domain.get('kind') == 'box' else '|e|₂'} ≤ "
            f"{_number(domain.get('radius'))}"
        )
        return text if disturbance is None else f"{text} and every |εᵢ| ≤ {_number(disturbance)}"
    return {"global": "every start", "consensus": "near the target"}.get(domain, domain)


def covering_domain(certificate: Certificate) -> Domain | None:
    """The domain of the proof that carries the verdict."""
    return next((each.domain for each in _covering(certificate)), None)


def _covering(certificate: Certificate) -> list[Check]:
    proved = [each for each in certificate.checks if each.verdict is Verdict.PROVED]
    return [each for each in proved if each.id == certificate.covered_by]


def facts(certificate: Certificate) -> dict[str, str]:
    """A certificate in a few words by name; an en dash where it says nothing."""
    domain, rate, proof = covering_domain(certificate), certificate.rate, certificate.covered_by
    return {
        "Holds for": "–" if domain is None else domain_words(domain),
        "Certified decay rate": "–" if rate is None else f"{_number(rate)} 1/s",
        "Factor": factor_words(certificate.factor),
        "To one percent within": one_percent_words(certificate),
        "Shown by": KINDS[proof].name if proof in KINDS else "–",
        "Agents": str(certificate.problem.n),
        "Modes": str(len(certificate.problem.network.modes)),
    }


def factor_words(factor: float | None) -> str:
    """A factor of a bound, rounded up; an en dash where there is none."""
    return upper(factor)


def one_percent_words(certificate: Certificate) -> str:
    """The certified time to one percent of the first error."""
    return seconds(time_to_one_percent(certificate.rate, certificate.factor))


def seconds(time: float) -> str:
    """A certified time as the verdict states it, rounded up to three digits; an en dash where there
    is none."""
    return f"{typeset(significant_away_from_zero(time, 3))} s" if math.isfinite(time) else "–"


def number(value: float | None) -> str:
    """A rounded number as people write it."""
    return typeset(significant(None if value is None else value + 0.0))  # no -0


def _number(value: object) -> str:
    return (
        typeset(significant_towards_zero(value))
        if isinstance(value, (int, float, Fraction))
        else "?"
    )


def rational(value: object) -> Fraction | None:
    """The number that a certificate holds as text; None for anything else, since certificates come
    from files."""
    try:
        return read_rational(value)
    except ValueError:
        return None


def bounds_of(certificate: Certificate) -> dict[str, Fraction]:
    """What the largest eigenvalue of Lambda must stay below, exactly, by the name of the P."""
    known = {name: rational(bound) for name, bound in _of_theorems(certificate, "bound")}
    return {name: bound for name, bound in known.items() if bound is not None}


def observer_blocks(certificate: Certificate) -> dict[str, Matrix]:
    """S, what the observer costs, by the name of the P; only what can be read."""
    found: dict[str, Matrix] = {}
    for name, rows in _of_theorems(certificate, "S"):
        try:
            found.setdefault(
                name, matrix([[read_rational(entry) for entry in row] for row in rows])
            )
        except (TypeError, ValueError):
            continue
    return found


def _of_theorems(certificate: Certificate, key: str) -> Iterator[tuple[str, Any]]:
    for check in certificate.checks:
        values = (check.exact or {}) if check.id.startswith("theorem") else {}
        if key in values:
            yield GIVEN if check.id.endswith("printed") else FOUND, values[key]


def verdict_counts(checks: Iterable[Check], order: Iterable[Verdict] = Verdict) -> str:
    """How many checks have each verdict, as far as there are any."""
    found = [check.verdict for check in checks]
    return ", ".join(f"{found.count(each)} {each.value}" for each in order if each in found)


def eigenvalues(values: Sequence[complex]) -> str:
    """The first eigenvalues, and how many more there are."""
    shown = [
        number(v.real) + (f" {'−' if v.imag < 0 else '+'} {number(abs(v.imag))}i" if v.imag else "")
        for v in map(complex, values[:MOST_EIGENVALUES])
    ]
    hidden = len(values) - len(shown)
    return ", ".join(shown) + (f" and {hidden} more" if hidden else "")


def shortened(text: str, longest: int = 1200) -> str:
    """The text, or its beginning and an ellipsis."""
    return text if len(text) <= longest else text[: longest - 1] + "…"


def sentence(text: str) -> str:
    """A reason of a certificate, which is ASCII, as people write it: capital, minus signs, Greek
    letters, indices."""
    for pattern, sign in _SIGNS:
        text = pattern.sub(sign, text)
    return capitalize_first(text)


def capitalize_first(text: str) -> str:
    """Make the first letter a capital and leave the others alone."""
    return text[:1].upper() + text[1:]


def what_it_means(certificate: Certificate) -> tuple[list[str], list[str]]:
    """What the overall verdict says, and what it does not."""
    checks = certificate.checks
    safe = [
        each.reason for each in checks if each.id == "safety" and each.verdict is Verdict.PROVED
    ]
    if certificate.verdict is Verdict.PROVED:
        yes, no = _proved(certificate)
        return [*yes, *map(capitalize_first, safe)], no
    counts = {
        "proved": sum(check.verdict is Verdict.PROVED for check in checks),
        "all": len(checks),
    }
    yes, no = (list(TEXTS[certificate.verdict.value][part]) for part in ("says", "says_not"))
    yes = [text.format(**counts) for text in yes]
    return [*yes, *map(capitalize_first, safe)], [
        *no,
        _about_the_model(certificate.problem, TEXTS["fixed"]["ideal"]),
    ]


def _proved(certificate: Certificate) -> tuple[list[str], list[str]]:
    problem, domain, no = certificate.problem, covering_domain(certificate), []
    final = certificate.covered_by == "accuracy"
    goes = "ends near its goal, within the final bounds below," if final else "goes to its goal"
    if domain == "global":
        yes = [f"Every agent {goes} from every start, however far: the proof is global."]
    elif isinstance(domain, Mapping):
        yes = [f"Every agent {goes} from all {domain_words(domain)}: {_norms(domain)}."]
        no = ["It says nothing about starts outside that set. They may converge or not."]
    else:
        yes = [f"There is a neighbourhood of the target from which every agent {goes}."]
    if domain == "consensus":
        no = [TEXTS["fixed"]["local"]]
    if problem.groups and not final:
        yes.append(
            "The estimates converge to the true disturbances, wherever observer and "
            "disturbance start."
        )
    if certificate.covered_by in ("schedule", "markov", "safety"):
        yes += [f"It holds {signals_in_words(problem, each)}." for each in _covering(certificate)]
        no += ["It says nothing about other signals."] if certificate.covered_by != "safety" else []
    elif len(problem.network.modes) > 1:
        yes.append(
            "The modes may switch at any times and in any order, arbitrarily fast: one V "
            "holds for all modes."
        )
    if certificate.rate:
        rate = _number(certificate.rate)
        bound = f"The errors decay at least like exp(−{rate} t), t in seconds"
        if certificate.factor is not None:
            beside = " plus what the estimation error adds" if problem.groups else ""
            bound = (
                f"The errors stay below {factor_words(certificate.factor)} |e(0)| exp(−{rate} "
                f"t){beside}, t in seconds"
            )
            bound += f": one percent after {one_percent_words(certificate)}"
        yes.append(f"{bound}. The real decay may be faster.")
    proved = [
        each
        for each in certificate.checks
        if each.kind.role == "timing" and each.verdict is Verdict.PROVED
    ]
    messages = TEXTS["fixed"]["timed" if len(proved) == len(ids_of("timing")) else "ideal"]
    return yes, [*no, _about_the_model(problem, messages)]


def deployment_words(certificate: Certificate) -> str:
    """How fast the code has to be, as far as that is proved, and where the code is."""
    exact = {
        each.id: each.exact or {} for each in certificate.checks if each.verdict is Verdict.PROVED
    }
    late, held = (
        rational(exact.get(id, {}).get(key))
        for id, key in (("delay", "delay"), ("sampling", "period"))
    )
    allowed = [f"communication delays of up to {_number(late)} s"] if late else []
    allowed += (
        [f"couplings and pins that are held for up to {_number(held)} s between samples"]
        if held
        else []
    )
    covered = f"The proof allows {' or '.join(allowed)}. " if allowed else ""
    if certificate.problem.dynamics is not None:
        return f"{covered}dobc_design.to_control gives the loop to python-control."
    return (
        f"{covered}Use dobc export to write the controller of an agent in C, as an FMU or for "
        "python-control."
    )


def _norms(domain: Mapping[str, Any]) -> str:
    """What the norms of a domain measure."""
    box = domain.get("kind") == "box"
    what = (
        "|e|∞ is the largest distance of an agent from its goal"
        if box
        else "|e|₂² is the sum of all squared distances"
    )
    return what + (
        " and |εᵢ| the error of its disturbance estimate"
        if domain.get("disturbance") is not None
        else ""
    )


def _about_the_model(problem: Problem, messages: str) -> str:
    disturbances = "one (A, C) for all agents, " if problem.groups else ""
    disturbances = "one (A, C) for each group of agents, " if problem.is_grouped else disturbances
    disturbances += "none for the others, " if problem.undisturbed else ""
    agents = (
        "single integrators"
        if problem.dynamics is None
        else "agents with the dynamics given, the same for all"
    )
    text = (
        f"It is about the model as given: {agents}, {disturbances}{messages}. Whether the "
        "model fits the"
    )
    return text + " plant is not decided here."


def shown_notes(certificate: Certificate) -> tuple[str, ...]:
    """What is assumed, and what the proof leaves open that people look for."""
    notes = certificate.claims.notes
    proved = certificate.verdict is Verdict.PROVED
    if (
        not proved
        or certificate.problem.dynamics is None
        or any(each.id == "delay" for each in certificate.checks)
    ):
        return notes
    return (*notes, NO_DELAY if certificate.problem.leader is None else NO_DELAY_OF_LEADERS)


def loop_facts(certificate: Certificate) -> list[tuple[str, str]]:
    """What acts on the agents and what was designed against it, numbers in decimals."""
    problem, W = certificate.problem, certificate.claims.W
    facts = [
        (
            f"Disturbance of {names_in_words(group.agents, 4)}"
            if problem.is_grouped
            else "Disturbance",
            told,
        )
        for group in problem.groups[:MOST_MODES]
        for told in [disturbance_words(problem, group)]
    ]
    if problem.undisturbed:
        facts.append((f"Disturbance of {names_in_words(problem.undisturbed, 4)}", "none"))
    facts += [("Agents", told) for told in dynamics_words(problem)]
    facts += [
        ("Coupling", f"h(y) = {', '.join(problem.coupling.texts).replace('-', '−')}"),
        ("Target", target_words(problem)),
    ]
    if problem.region is not None:
        facts.append(("Starts asked for", _starts(problem.region)))
    if W is not None and len(W) * len(W[0]) <= MOST_NAMES:
        rows = ["; ".join(decimal(x) for x in row) for row in W]
        facts.append(
            (
                "Observer gain W",
                f"({', '.join(rows)})′, {certificate.claims.gain_source or 'given'}",
            )
        )
    facts.append(("Pinning gains", _pins(problem)))
    facts += [("Time scales", times)] if (times := time_words(problem)) else []
    return facts


def dynamics_words(problem: Problem) -> list[str]:
    """What agents with [dynamics] are; the constant inputs that hold their goals, where these are
    not 0."""
    own = problem.dynamics
    if own is None:
        return []
    rows = [
        [decimal_text(x) for x in problem.input_at(problem.goal_of(i))] for i in range(problem.n)
    ]
    by_input: dict[str, list[str]] = {}
    for agent, row in enumerate(rows):
        by_input.setdefault(f"({', '.join(row)})", []).append(problem.network.labels[agent])
    told = [
        f"{u0} on {names_in_words(names, 4)}" for u0, names in list(by_input.items())[:MOST_MODES]
    ]
    what = (
        f"x′ = {'Aₓ x' if own.f is None else 'f(x)'} + B (couplings + u + d), "
        f"{counted(own.inputs, 'input')} each"
    )
    if not any(x != "0" for row in rows for x in row):
        return [what]
    return [f"{what}; constant inputs u⁰ that hold the goals: {'; '.join(told)}"]


def _starts(region: Region) -> str:
    pairs = [f"[{decimal(lo)}, {decimal(hi)}]" for lo, hi in region.initial_states]
    inside = pairs[0] if len(set(pairs)) == 1 else " × ".join(pairs)
    errors = region.initial_disturbance
    return f"every state in {inside}" + (
        "" if errors is None else f", every estimation error up to {decimal(errors)}"
    )


def _pins(problem: Problem) -> str:
    """Who is pinned with which gain; agents of one gain together."""
    by_gain: dict[str, list[str]] = {}
    for agent, gain in problem.pinning.gains.items():
        by_gain.setdefault(_gain(gain), []).append(problem.network.labels[agent])
    unit = "" if problem.dynamics is not None else " 1/s"
    shown = [
        f"{gain}{unit} on {names_in_words(names, 6)}"
        for gain, names in list(by_gain.items())[:MOST_MODES]
    ]
    return "; ".join(shown) + ("; …" if len(by_gain) > MOST_MODES else "") or "nobody is pinned"


def decimal(value: Fraction) -> str:
    """A number of the problem or of the design, rounded to five digits; the files hold it
    exactly."""
    return typeset(significant(value, 5))


def agents_table(problem: Problem) -> doc.Table | None:
    """One row per agent: its gain, goal, and whom it hears in each listed mode; None for networks
    too large to list."""
    if problem.n > MOST_LISTED:
        return None
    labels, gains = problem.network.labels, problem.pinning.gains
    heard = [
        (name, _heard(arcs, labels))
        for name, arcs in list(problem.network.modes.items())[:MOST_MODES]
    ]
    return doc.table_of(
        f"Gain k of the pins{', goals' if problem.offsets else ''}, and whom each agent listens to",
        range(problem.n),
        doc.Column("agent", lambda i: labels[i], 1.2),
        doc.Column(
            "k in 1/s" if problem.dynamics is None else "K",
            lambda i: _gain(gains[i]) if i in gains else "–",
            0.8,
        ),
        doc.Column(
            "goal",
            lambda i: _goal(problem, i),
            only=doc.EVERY if problem.offsets else ("markdown",),
        ),
        *(doc.Column(f"listens to in {name}", each.__getitem__, 2) for name, each in heard),
    )


def _heard(arcs: Arcs, labels: Sequence[str]) -> list[str]:
    """Whom each agent listens to, with what weight."""
    heard: list[list[tuple[int, str]]] = [[] for _ in labels]
    for listener, speaker, weight in arcs:
        heard[listener].append(
            (speaker, labels[speaker] + ("" if weight == 1 else f" ({number_text(weight)}×)"))
        )
    named = [[name for _, name in sorted(own)] for own in heard]
    more = [f" and {len(own) - MOST_NAMES} more" if len(own) > MOST_NAMES else "" for own in named]
    return [
        (", ".join(own[:MOST_NAMES]) + rest) or "–" for own, rest in zip(named, more, strict=True)
    ]


def _gain(gain: Matrix) -> str:
    if is_scalar_matrix(gain):
        return decimal(gain[0][0])
    return "[" + "; ".join(", ".join(map(decimal, row)) for row in gain) + "]"


def mode_sentences(problem: Problem) -> list[str]:
    """A sentence on each of the first modes; a rest is counted by the caller."""
    shown = list(problem.network.modes.items())[: 2 * MOST_MODES]
    return [f"{name}: {_mode_sentence(arcs, problem)}" for name, arcs in shown]


def _mode_sentence(arcs: Arcs, problem: Problem) -> str:
    weights = {(listener, speaker): weight for listener, speaker, weight in arcs}
    if not weights:
        return "nobody listens to anybody."
    count = counted(len(weights), "arc") + (
        "" if set(weights.values()) == {1} else ", with weights"
    )
    steps = common_offsets(weights, problem.n)
    if steps is not None and problem.n > 2 and len(steps) <= 4 and len(steps) < problem.n - 1:
        whom = names_in_words(
            [f"i + {s}" if 2 * s <= problem.n else f"i − {problem.n - s}" for s in steps]
        )
        return f"{count}; every agent i listens to {whom}, counted around a circle of {problem.n}."
    if all((j, i) in weights for i, j in weights):
        alike = all(weights[i, j] == weights[j, i] for i, j in weights) and not problem.exceptions
        return f"{count}; whoever listens is also listened to{' (undirected)' if alike else ''}."
    return f"{count}."


def common_offsets(pairs: Iterable[tuple[int, int]], n: int) -> tuple[int, ...] | None:
    """The steps s with "every agent i listens to i + s (mod n)" when they are all there is, else
    None."""
    known = list(pairs)
    steps = {(speaker - listener) % n for listener, speaker in known}
    return tuple(sorted(steps)) if known and len(known) == n * len(steps) else None


def problem_words(problem: Problem) -> str:
    """The size of the problem, its pins, its region and its switching, each in a sentence."""
    told = [size_sentence(problem), pin_sentence(problem)]
    if problem.region is not None:
        told.append(f"The proof has to cover all starts with {_starts(problem.region)}.")
    if problem.switching is not None:
        allowed = (
            "are about the arcs of the modes"
            if problem.switching.signal == "mobile"
            else "allow any signal"
        )
        run = "stays in one mode"
        if problem.switching.is_guaranteed:
            allowed = f"{allowed}, except those that say for which signals they hold"
        if problem.switching.guarantee in ("dwell", "sequence"):
            run = "switches like that"
        simulated = switching_words(problem.switching, tuple(problem.network.modes))
        told.append(f"Switching in simulations: {simulated}.")
        told.append(f"The run shown here {run}, and the proofs {allowed}.")
    return " ".join(told)


def _goal(problem: Problem, agent: int) -> str:
    goal = vector_text(problem.goal_of(agent))
    return goal if problem.leader is None else f"s + {goal}" if agent in problem.offsets else "s"


def size_sentence(problem: Problem) -> str:
    """n, m, q and the number of modes."""
    modes, disturbance = len(problem.network.modes), "no disturbance"
    if problem.is_grouped:
        disturbed = problem.n - len(problem.undisturbed)
        whom = f"{disturbed} of {problem.n} agents" if problem.undisturbed else "every agent"
        kinds = f", of {len(problem.groups)} kinds" if len(problem.groups) > 1 else ""
        disturbance = f"a disturbance on {whom}{kinds}"
    elif problem.groups:
        disturbance = (
            f"a disturbance on every agent, generated by {counted(problem.q, 'exosystem state')}"
        )
    topology = (
        "one fixed topology" if modes == 1 else f"{modes} modes between which the topology switches"
    )
    size = f"{counted(problem.n, 'agent')}; {counted(problem.m, 'state component')} each"
    size += (
        ""
        if problem.dynamics is None
        else f", {counted(problem.inputs, 'input')} and dynamics of their own"
    )
    return f"{size}; {topology}; {disturbance}."


def pin_sentence(problem: Problem) -> str:
    """Who is pinned."""
    pinned = problem.pinning.agents
    if not pinned:
        return "No agent is pinned."
    if len(pinned) == problem.n:
        return "Every agent is pinned." if problem.n > 1 else "The agent is pinned."
    names = names_in_words([problem.network.labels[i] for i in pinned])
    return (
        f"{len(pinned)} of {problem.n} agents {'is' if len(pinned) == 1 else 'are'} pinned: "
        f"{names}."
    )


def group_sentences(problem: Problem) -> list[str]:
    """Which agents have which exosystem, where they have different ones."""
    told = [
        f"group of agent {group.name}: {names_in_words(group.agents)};"
        f" {counted(group.exosystem.order, 'exosystem state')}"
        for group in problem.groups
    ]
    if problem.undisturbed:
        told.append(f"without a disturbance: {names_in_words(problem.undisturbed)}")
    return _first(told) if problem.is_grouped else []


def exception_sentences(problem: Problem) -> list[str]:
    """Arcs with a coupling of their own, in words."""
    labels = problem.network.labels
    return _first(
        [
            f"{labels[i]} listening to {labels[j]}: h = {', '.join(coupling.texts)}"
            for (i, j), coupling in problem.exceptions.items()
        ]
    )


def _first(rows: list[str]) -> list[str]:
    return (
        rows
        if len(rows) <= MOST_NAMES
        else [*rows[:MOST_NAMES], f"and {len(rows) - MOST_NAMES} more"]
    )


def unreached_agents(certificate: Certificate, mode: str) -> set[int]:
    """Agents that no pin reaches in this mode, as the refuted check names them."""
    for check in certificate.checks:
        if check.id == "reachability" and check.mode == mode and check.verdict is Verdict.REFUTED:
            named = set(check.witness.labels or ()) if check.witness is not None else set()
            return {
                i for i, label in enumerate(certificate.problem.network.labels) if label in named
            }
    return set()


def names_in_words(names: Sequence[str], most: int = MOST_NAMES) -> str:
    """List names: "1", "1 and 6", "1, 2, 3 and 40 more"."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return (
        names[0]
        if len(names) == 1
        else f"{', '.join(names[:-1])} and {names[-1]}"
        if names
        else "nobody"
    )


def target_words(problem: Problem) -> str:
    """The target, a vector or a leader."""
    return typeset(leader_words(problem)).replace(" x [", " × [").replace(
        "s'", "s′"
    ) or vector_text(problem.target)


def vector_text(vector: Vector) -> str:
    """A vector as text."""
    entries = [decimal_text(x) for x in vector[:MOST_NAMES]]
    return (
        entries[0]
        if len(vector) == 1
        else f"({', '.join(entries)}{', …' if len(vector) > MOST_NAMES else ''})"
    )
