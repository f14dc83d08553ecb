"""The sentences of the report: what a verdict says and what it does not, the network and the pins,
numbers."""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any

from dobc_design._checks import noun
from dobc_design._files import own_table
from dobc_design._show.cards import SIGNS
from dobc_design._show.text import (
    capitalize_first,
    lower,
    significant,
    significant_away_from_zero,
    typeset,
    upper,
)
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Check
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Around, Domain
from dobc_design.conditions.graphs.claim import signals_in_words
from dobc_design.conditions.kinds import KINDS, REACHABILITY, ids_of
from dobc_design.conditions.numbers import read_rational, time_to_one_percent
from dobc_design.conditions.stated import knows_readings
from dobc_design.description.meaning import disturbance_words, time_words
from dobc_design.description.words import leader_words, limit_words
from dobc_design.exact.matrix import Matrix, Vector, matrix
from dobc_design.exact.number import decimal_text, number_text
from dobc_design.exact.reading import Document, Names, Texts, counted, is_scalar_matrix, some
from dobc_design.loop.limits import mean_weights, reached_from
from dobc_design.loop.make import loop_of
from dobc_design.loop.words import Said, said_of
from dobc_design.problem.fixed import place_words
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.problem.region import Region
from dobc_design.problem.tables import in_units, switching_words
from dobc_design.verdict import Verdict

from .document import EVERY, Column, Fact, Mark, Table, table_of

NO_DELAY = (
    "No delay is certified. For agents with [dynamics] only some max-separable proofs allow one."
)
LONGEST_PERIOD = (
    " `dobc stress FILE` looks for the longest sampling period at which runs converge (all "
    "readings, also of oneself, are then up to a period old); `dobc stress FILE --period 0.03` "
    "makes one run."
)
NO_DELAY_OF_LEADERS = " Delays are not simulated for a target that moves, either."
MOST_LISTED = 40  # agents listed one by one
MOST_MODES = 6
MOST_NAMES = 12
MOST_EIGENVALUES = 8
MOST_STEPS = 4  # around a circle
#: Conditions whose proofs are about some signals, and not about all.
OF_SIGNALS = ("schedule", "markov", "safety")
GIVEN, FOUND = "the P given", "the P found"
TEXTS: Document = own_table("report/templates/texts.toml")
FIXED: Document = TEXTS["fixed"]
_SIGNS, _OF_PAIRS = (
    tuple((re.compile(pattern), sign) for pattern, sign in TEXTS[name].items())
    for name in ("signs", "signs_of_pairs")
)


def mark_of(verdict: Verdict) -> Mark:
    """A verdict as a sign and a word."""
    return Mark(SIGNS[verdict.value], verdict.value)


def domain_words(domain: Domain, unit: str) -> str:
    """Where a check holds, in a few words; ``unit``: of the states, "" without one."""
    if not isinstance(domain, Around):
        said = {"global": "every start", "consensus": "near the target"}
        return said.get(str(domain), str(domain))
    # A box bounds every component by itself, a ball all of them together.
    norm = "|e|∞" if domain.kind == "box" else "|e|₂"
    errors = f"every |εᵢ| ≤ {lower(domain.disturbance)}"
    return f"starts with {norm} ≤ {lower(domain.radius, unit)} and {errors}"


def covering_domain(certificate: Certificate) -> Domain | None:
    """The domain of the proof that carries the verdict."""
    return next((each.domain for each in _covering(certificate)), None)


def _covering(certificate: Certificate) -> list[Check]:
    """The proved checks that carry the verdict."""
    return [each for each in _proved_of(certificate) if each.id == certificate.covered_by]


def _proved_of(certificate: Certificate) -> list[Check]:
    return [each for each in certificate.checks if each.is_proved]


def facts(certificate: Certificate) -> dict[str, str]:
    """A certificate in a few words by name; an en dash where it says nothing."""
    domain, rate = covering_domain(certificate), certificate.rate
    proof, unit = certificate.covered_by, certificate.problem.unit
    return {
        "Holds for": "–" if domain is None else domain_words(domain, unit),
        "Certified decay rate": "–" if rate is None else f"{lower(rate)} 1/s",
        "Factor": upper(certificate.factor),
        "To one percent within": one_percent_words(certificate),
        "Shown by": KINDS[proof].name if proof in KINDS else "–",
        "Agents": str(certificate.problem.n),
        "Modes": str(len(certificate.problem.network.modes)),
    }


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
            S = matrix([[read_rational(entry) for entry in row] for row in rows])
        except (TypeError, ValueError):
            continue
        found.setdefault(name, S)
    return found


def _of_theorems(certificate: Certificate, key: str) -> Iterator[tuple[str, Any]]:
    """An exact value of Theorems 1 and 2, by the name of the P that it is about."""
    for check in certificate.checks:
        exact = check.exact or {}
        if check.id.startswith("theorem") and key in exact:
            yield GIVEN if check.id.endswith("printed") else FOUND, exact[key]


def verdict_counts(checks: Iterable[Check], order: Iterable[Verdict] = Verdict) -> str:
    """How many checks have each verdict, as far as there are any."""
    found = [check.verdict for check in checks]
    return ", ".join(f"{found.count(each)} {each.value}" for each in order if each in found)


def eigenvalues(values: Sequence[complex]) -> str:
    """The first eigenvalues, and how many more there are."""
    shown = ", ".join(map(_eigenvalue, values[:MOST_EIGENVALUES]))
    hidden = len(values) - MOST_EIGENVALUES
    return f"{shown} and {hidden} more" if hidden > 0 else shown


def _eigenvalue(value: complex) -> str:
    if not value.imag:
        return number(value.real)
    sign = "−" if value.imag < 0 else "+"
    return f"{number(value.real)} {sign} {number(abs(value.imag))}i"


def shortened(text: str, longest: int = 1200) -> str:
    """The text, or its beginning and an ellipsis."""
    return text if len(text) <= longest else text[: longest - 1] + "…"


def said_here(problem: Problem) -> Said:
    """Turns a sentence of a report, which is typeset, into one about what these agents do."""
    said = said_of(loop_of(problem), *problem.notes)

    def typeset_again(text: str) -> str:
        for pattern, sign in _OF_PAIRS:
            text = pattern.sub(sign, text)
        return text

    return lambda text: typeset_again(said(text))


def sentence(text: str) -> str:
    """A reason of a certificate, which is ASCII, as people write it: capital, minus signs, Greek
    letters, indices."""
    for pattern, sign in _SIGNS:
        text = pattern.sub(sign, text)
    return capitalize_first(text)


@noun
class Meaning:
    """What the overall verdict says, and what it does not, in sentences."""

    says: Sequence[str]
    says_not: Sequence[str]


def what_it_means(certificate: Certificate) -> Meaning:
    """What the overall verdict says, and what it does not."""
    checks = certificate.checks
    proved = _proved_of(certificate)
    messages = FIXED["ideal"]
    if certificate.verdict is Verdict.PROVED:
        says, says_not = [*_proved(certificate)], [*_left_open(certificate)]
        timing = [each for each in proved if each.kind.role == "timing"]
        # The model has delays and sampling only where both are proved.
        if len(timing) == len(ids_of("timing")):
            messages = FIXED["timed"]
        if any(map(knows_readings, _covering(certificate))):
            messages = FIXED["read"]
    else:
        own = TEXTS[certificate.verdict.value]
        says = [text.format(proved=len(proved), all=len(checks)) for text in own["says"]]
        says_not = own["says_not"]
    # What is proved of graphs that move holds whatever the verdict is.
    says += [capitalize_first(each.reason) for each in proved if each.kind.role == "safety"]
    model = _about_the_model(certificate.problem, messages)
    return Meaning(says=says, says_not=[*says_not, model])


def _proved(certificate: Certificate) -> Iterator[str]:
    """What a proof says: from where agents go where, for which signals, how fast."""
    problem, domain = certificate.problem, covering_domain(certificate)
    final = certificate.covered_by == "accuracy"
    goes = "ends near its goal, within the final bounds below," if final else "goes to its goal"
    if domain == EVERYWHERE:
        yield f"Every agent {goes} from every start, however far: the proof is global."
    elif isinstance(domain, Around):
        yield f"Every agent {goes} from all {domain_words(domain, problem.unit)}: {_norms(domain)}."
    else:
        yield f"There is a neighbourhood of the target from which every agent {goes}."
    if problem.groups and not final:
        yield (
            "The estimates converge to the true disturbances, wherever observer and "
            "disturbance start."
        )
    if certificate.covered_by in OF_SIGNALS:
        for each in _covering(certificate):
            yield f"It holds {signals_in_words(loop_of(problem), each)}."
    elif len(problem.network.modes) > 1:
        yield (
            "The modes may switch at any times and in any order, arbitrarily fast: one V "
            "holds for all modes."
        )
    if certificate.value is not None:
        yield certificate.value.in_words(problem.unit)
    if certificate.rate:
        yield f"{_decay(certificate)}. The real decay may be faster."


def _left_open(certificate: Certificate) -> Iterator[str]:
    """What a proof does not say about starts and signals."""
    domain = covering_domain(certificate)
    if isinstance(domain, Around):
        yield "It says nothing about starts outside that set. They may converge or not."
    elif domain == NEAR_TARGET:
        yield FIXED["local"]
    if certificate.covered_by in OF_SIGNALS and certificate.covered_by != "safety":
        yield "It says nothing about other signals."


def _decay(certificate: Certificate) -> str:
    """How fast errors are proved to decay, with the factor where one is proved."""
    rate = lower(certificate.rate)
    if certificate.factor is None:
        return f"The errors decay at least like exp(−{rate} t), t in seconds"
    beside = " plus what the estimation error adds" if certificate.problem.groups else ""
    return (
        f"The errors stay below {upper(certificate.factor)} |e(0)| exp(−{rate} t){beside}, "
        f"t in seconds: one percent after {one_percent_words(certificate)}"
    )


def deployment_words(certificate: Certificate) -> str:
    """How fast the code has to be, as far as that is proved, and where the code is."""
    exact = {each.id: each.exact or {} for each in _proved_of(certificate)}
    late = rational(exact.get("delay", {}).get("delay"))
    held = rational(exact.get("sampling", {}).get("period"))
    allowed = []
    if late:
        allowed.append(f"communication delays of up to {lower(late)} s")
    if held:
        allowed.append(
            f"couplings and pins that are held for up to {lower(held)} s between samples"
        )
    covered = f"The proof allows {' or '.join(allowed)}. " if allowed else ""
    own = certificate.problem.dynamics
    if own is not None:
        return f"{covered}dobc_design.to_control gives the loop to python-control."
    return (
        f"{covered}Use dobc export to write the controller of an agent in C, as an FMU or for "
        "python-control."
    )


def _norms(domain: Around) -> str:
    """What the norms of a domain measure."""
    what = "|e|₂² is the sum of all squared distances"
    if domain.kind == "box":
        what = "|e|∞ is the largest distance of an agent from its goal"
    return f"{what} and |εᵢ| the distance of its observer from the disturbance’s own state"


def _about_the_model(problem: Problem, messages: str) -> str:
    agents = "single integrators"
    if problem.dynamics is not None:
        agents = "agents with the dynamics given, the same for all"
    disturbances = ""
    if problem.is_grouped:
        disturbances = "one (A, C) for each group of agents, "
    elif problem.groups:
        disturbances = "one (A, C) for all agents, "
    if problem.undisturbed:
        disturbances += "none for the others, "
    return (
        f"It is about the model as given: {agents}, {disturbances}{messages}. Whether the "
        "model fits the plant is not decided here."
    )


def shown_notes(certificate: Certificate) -> Texts:
    """What is assumed, and what the proof leaves open that people look for."""
    notes, problem = certificate.claims.notes, certificate.problem
    if certificate.verdict is not Verdict.PROVED or problem.dynamics is None:
        return notes
    if any(each.id == "delay" for each in certificate.checks):
        return notes
    simulated = LONGEST_PERIOD if problem.leader is None else NO_DELAY_OF_LEADERS
    return (*notes, NO_DELAY + simulated)


def loop_facts(certificate: Certificate) -> Iterator[Fact]:
    """What acts on the agents and what was designed against it, numbers in decimals."""
    problem = certificate.problem
    yield from _disturbances(problem)
    for told in dynamics_words(problem):
        yield "Agents", told
    # typed with hyphens, shown with minus signs
    h = ", ".join(problem.coupling.texts).replace("-", "−")
    yield "Coupling", f"h(y) = {h}"
    goal = "Fixed nodes" if problem.fixed else "Target"
    yield ("Goal" if problem.agrees else goal), target_words(problem)
    if problem.region is not None:
        yield "Starts asked for", _starts(problem.region, problem.units)
    # A large W stands among the matrices only.
    W = certificate.W_exact
    if W is not None and len(W) * len(W[0]) <= MOST_NAMES:
        rows = ["; ".join(map(decimal, row)) for row in W]
        yield "Observer gain W", f"({', '.join(rows)})′"
    if problem.has_target:
        yield "Pinning gains", _pins(problem)
    times = time_words(problem)
    if times:
        yield "Time scales", times


def _disturbances(problem: Problem) -> Iterator[Fact]:
    """What disturbs the agents, by group where they differ."""
    for group in problem.groups[:MOST_MODES]:
        whose = f" of {names_in_words(group.agents, 4)}" if problem.is_grouped else ""
        yield f"Disturbance{whose}", disturbance_words(problem, group)
    if problem.undisturbed:
        yield f"Disturbance of {names_in_words(problem.undisturbed, 4)}", "none"


def dynamics_words(problem: Problem) -> list[str]:
    """What agents with [dynamics] are; the constant inputs that hold their goals, where these are
    not 0."""
    own = problem.dynamics
    if own is None:
        return []
    moves = "Aₓ x" if own.f is None else "f(x)"
    inputs = counted(own.inputs, "input")
    what = f"x′ = {moves} + B (couplings + u + d), {inputs} each"
    if own.H is not None:
        what += f"; y = H x, {counted(len(own.H), 'output')}; couplings and pins act on "
        what += own.acts_on or "estimated states"
    # A goal that needs no input is an equilibrium of the agent by itself.
    held = [tuple(problem.input_at(problem.goal_of(i))) for i in range(problem.n)]
    if not any(any(row) for row in held):
        return [what]
    texts = [f"({', '.join(map(decimal_text, row))})" for row in held]
    alike = _shared(zip(texts, problem.network.labels, strict=True))
    told = [f"{u0} on {names_in_words(names, 4)}" for u0, names in alike[:MOST_MODES]]
    return [f"{what}; constant inputs u⁰ that hold the goals: {'; '.join(told)}"]


def _shared(rows: Iterable[Fact]) -> list[tuple[str, list[str]]]:
    """Every text once, with the agents that it is said of."""
    alike: dict[str, list[str]] = {}
    for text, agent in rows:
        alike.setdefault(text, []).append(agent)
    return list(alike.items())


def _starts(region: Region, units: Sequence[str]) -> str:
    pairs = [f"[{decimal(lo)}, {decimal(hi)}]" for lo, hi in region.initial_states]
    pairs = in_units(pairs, units)
    # Equal intervals are one.
    inside = pairs[0] if len(set(pairs)) == 1 else " × ".join(pairs)
    text, errors = f"every state in {inside}", region.initial_disturbance
    return text if errors is None else f"{text}, every estimation error up to {decimal(errors)}"


def _pins(problem: Problem) -> str:
    """Who is pinned with which gain; agents of one gain together."""
    labels = problem.network.labels
    pinning = problem.pinning
    every = [(_gain(gain), labels[i]) for i, gain in pinning.gains.items()]
    for mode, gains in pinning.modes.items():
        every += [(_gain(gain), f"{labels[i]} in {mode}") for i, gain in gains.items()]
    alike = _shared(every)
    if not alike:
        return "nobody is pinned"
    # With dynamics a gain has the unit that B gives it.
    unit = "" if problem.dynamics is not None else " 1/s"
    told = [f"{gain}{unit} on {names_in_words(names, 6)}" for gain, names in alike[:MOST_MODES]]
    if len(alike) > MOST_MODES:
        told.append("…")
    return "; ".join(told)


def decimal(value: Fraction) -> str:
    """A number of the problem or of the design, rounded to five digits; the files hold it
    exactly."""
    return typeset(significant(value, 5))


def agents_table(problem: Problem) -> Table | None:
    """One row per agent: its gain, goal, and whom it hears in each listed mode; None for networks
    too large to list."""
    if problem.n > MOST_LISTED:
        return None
    labels, pinning = problem.network.labels, problem.pinning
    moved = bool(problem.offsets)

    def gain(agent: int) -> str:
        if agent in pinning.gains:
            return _gain(pinning.gains[agent])
        own = [f"{_gain(k[agent])} in {mode}" for mode, k in pinning.modes.items() if agent in k]
        return ", ".join(own) or "–"

    columns = [Column("agent", lambda i: labels[i], 1.2)]
    weights = mean_weights(problem)
    if weights is not None:
        columns.append(Column("ends at", lambda i: typeset(limit_words(problem, weights[i])), 1.5))
    elif problem.goal == "containment":
        near = list(reached_from(loop_of(problem)))

        def from_whom(agent: int) -> str:
            return ", ".join(label for label, found in near if agent in found)

        columns.append(Column("reached from", from_whom, 1.5))
    if problem.has_target:
        shown = EVERY if moved else ("markdown",)
        columns.append(Column("k in 1/s" if problem.dynamics is None else "K", gain, 0.8))
        columns.append(Column("goal", lambda i: _goal(problem, i), only=shown))
    for name, arcs in list(problem.network.modes.items())[:MOST_MODES]:
        heard = _heard(arcs, problem.network.names)
        columns.append(Column(f"listens to in {name}", heard.__getitem__, 2))
    goals = ", goals" if moved else ""
    caption = f"Gain k of the pins{goals}, and whom each agent listens to"
    if not problem.has_target:
        caption = "Whom each agent listens to"
    return table_of(caption, range(problem.n), *columns, cards=True)


def _heard(arcs: Arcs, labels: Names) -> list[str]:
    """Whom each agent listens to, with what weight."""
    heard: list[list[tuple[int, str]]] = [[] for _ in labels]
    for listener, speaker, weight in arcs:
        times = "" if weight == 1 else f" ({number_text(weight)}×)"
        heard[listener].append((speaker, labels[speaker] + times))
    told = []
    for own in heard:
        names = [name for _, name in sorted(own)]
        text = ", ".join(names[:MOST_NAMES]) or "–"
        hidden = len(names) - MOST_NAMES
        told.append(f"{text} and {hidden} more" if hidden > 0 else text)
    return told


def _gain(gain: Matrix) -> str:
    if is_scalar_matrix(gain):
        return decimal(gain[0][0])
    return "[" + "; ".join(", ".join(map(decimal, row)) for row in gain) + "]"


def mode_sentences(problem: Problem) -> list[str]:
    """A sentence on each of the first modes; a rest is counted by the caller."""
    shown = list(problem.network.modes.items())[: 2 * MOST_MODES]
    return [f"{name}: {_mode_sentence(arcs, problem)}" for name, arcs in shown]


def _mode_sentence(arcs: Arcs, problem: Problem) -> str:
    """How many arcs there are, and what their pattern is where it has a name."""
    weights = {(listener, speaker): weight for listener, speaker, weight in arcs}
    n = problem.n
    if not weights:
        return "nobody listens to anybody."
    # Matplotlib comes with pictures, and words are asked for without them.
    from dobc_design.plotting.networks import common_offsets

    count = counted(len(weights), "arc")
    if set(weights.values()) != {1}:
        count += ", with weights"
    steps = None if problem.fixed else common_offsets(weights, n)
    if steps is not None and n > 2 and len(steps) <= MOST_STEPS and len(steps) < n - 1:
        labels = problem.network.labels
        if labels != tuple(map(str, range(1, n + 1))):
            whom = names_in_words([labels[s] for s in steps])
            return f"{count}; {labels[0]} listens to {whom}, and so on around the circle of agents."
        whom = names_in_words([f"i + {s}" if 2 * s <= n else f"i − {n - s}" for s in steps])
        return f"{count}; every agent i listens to {whom}, counted around a circle of {n}."
    # one way at least once
    if any((j, i) not in weights for i, j in weights):
        return f"{count}."
    count += "; whoever listens is also listened to"
    alike = all(weights[i, j] == weights[j, i] for i, j in weights)
    return f"{count} (undirected)." if alike and not problem.exceptions else f"{count}."


def problem_words(problem: Problem) -> str:
    """The size of the problem, its pins, its region and its switching, each in a sentence."""
    told = [size_sentence(problem)]
    if problem.has_target:
        told.append(pin_sentence(problem))
    if problem.region is not None:
        told.append(
            f"The proof has to cover all starts with {_starts(problem.region, problem.units)}."
        )
    switching = problem.switching
    if switching is not None:
        allowed = "allow any signal"
        if switching.signal == "mobile":
            allowed = "are about the arcs of the modes"
        if switching.is_guaranteed:
            allowed += ", except those that say for which signals they hold"
        run = "stays in one mode"
        if switching.guarantee in ("dwell", "sequence"):
            run = "switches like that"
        simulated = switching_words(switching, tuple(problem.network.modes))
        told.append(f"Switching in simulations: {simulated}.")
        told.append(f"The run shown here {run}, and the proofs {allowed}.")
    return " ".join(told)


def _goal(problem: Problem, agent: int) -> str:
    """Where an agent is to be; beside a leader s, at its offset from it."""
    goal = vector_text(problem.goal_of(agent))
    if problem.leader is None:
        return goal
    return f"s + {goal}" if agent in problem.offsets else "s"


def size_sentence(problem: Problem) -> str:
    """n, m, q and the number of modes."""
    size = f"{counted(problem.n, 'agent')}; {counted(problem.m, 'state component')} each"
    if problem.dynamics is not None:
        size += f", {counted(problem.inputs, 'input')} and dynamics of their own"
    modes = len(problem.network.modes)
    topology = "one fixed topology"
    if modes != 1:
        topology = f"{modes} modes between which the topology switches"
    return f"{size}; {topology}; {_disturbance(problem)}."


def _disturbance(problem: Problem) -> str:
    """On whom a disturbance acts."""
    if not problem.groups:
        return "no disturbance"
    if not problem.is_grouped:
        states = counted(problem.q, "exosystem state")
        return f"a disturbance on every agent, generated by {states}"
    whom = "every agent"
    if problem.undisturbed:
        whom = f"{problem.n - len(problem.undisturbed)} of {problem.n} agents"
    kinds = f", of {len(problem.groups)} kinds" if len(problem.groups) > 1 else ""
    return f"a disturbance on {whom}{kinds}"


def pin_sentence(problem: Problem) -> str:
    """Who is pinned."""
    pinned = problem.pinning.agents
    if not pinned:
        return "No agent is pinned."
    if len(pinned) == problem.n:
        return "Every agent is pinned." if problem.n > 1 else "The agent is pinned."
    names = agents_in_words(problem, pinned)
    are = "is" if len(pinned) == 1 else "are"
    return f"{len(pinned)} of {problem.n} agents {are} pinned: {names}."


def group_sentences(problem: Problem) -> list[str]:
    """Which agents have which exosystem, where they have different ones."""
    if not problem.is_grouped:
        return []
    told = []
    for group in problem.groups:
        states = counted(group.exosystem.order, "exosystem state")
        told.append(f"group of agent {group.name}: {names_in_words(group.agents)}; {states}")
    if problem.undisturbed:
        told.append(f"without a disturbance: {names_in_words(problem.undisturbed)}")
    return _first(told)


def exception_sentences(problem: Problem) -> list[str]:
    """Arcs with a coupling of their own, in words."""
    labels, told = problem.network.labels, []
    for (i, j), coupling in problem.exceptions.items():
        h = ", ".join(coupling.texts)
        told.append(f"{labels[i]} listening to {labels[j]}: h = {h}")
    return _first(told)


def _first(rows: list[str]) -> list[str]:
    hidden = len(rows) - MOST_NAMES
    return rows if hidden <= 0 else [*rows[:MOST_NAMES], f"and {hidden} more"]


def unreached_agents(certificate: Certificate, mode: str) -> set[int]:
    """Agents that no pin reaches in this mode, as the refuted check names them."""
    for check in certificate.checks:
        if check.id == REACHABILITY and check.mode == mode and check.verdict is Verdict.REFUTED:
            witness = check.witness
            named = set() if witness is None else set(witness.labels or ())
            labels = certificate.problem.network.labels
            return {i for i, label in enumerate(labels) if label in named}
    return set()


def names_in_words(names: Names, most: int = MOST_NAMES) -> str:
    """List names: "1", "1 and 6", "1, 2, 3 and 40 more"."""
    if not names:
        return "nobody"
    if len(names) > most:
        return some(names, most)
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def agents_in_words(problem: Problem, agents: Iterable[int]) -> str:
    """List agents by their labels."""
    return names_in_words([problem.network.labels[i] for i in agents])


def target_words(problem: Problem) -> str:
    """The target, a vector or a leader; or the fixed nodes."""
    if problem.fixed:
        shown = islice(problem.fixed.items(), MOST_NAMES)
        return typeset("; ".join(f"{label} {place_words(at, problem.unit)}" for label, at in shown))
    if problem.agrees:
        return "agreement, on a value that nobody prescribes"
    leader = typeset(leader_words(problem)).replace(" x [", " × [").replace("s'", "s′")
    return leader or vector_text(problem.target, problem.units)


def vector_text(vector: Vector, units: Sequence[str] = ()) -> str:
    """A vector as text, with the units of its components."""
    entries = in_units([decimal_text(x) for x in vector], units)[:MOST_NAMES]
    if len(vector) == 1:
        return entries[0]
    if len(vector) > MOST_NAMES:
        entries.append("…")
    return f"({', '.join(entries)})"
