"""The sentences of the report: what a verdict says and what it does not, the network and the pins, numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction

from dobc_design._show.text import significant, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.check import Domain
from dobc_design.conditions.kinds import ids_of
from dobc_design.exact.matrix import Matrix, Vector
from dobc_design.exact.number import number_text
from dobc_design.problem.network import Arcs
from dobc_design.problem.problem import Problem
from dobc_design.problem.words import switching_words
from dobc_design.report import document as doc
from dobc_design.verdict import Verdict

MOST_LISTED = 40  # agents listed one by one
MOST_MODES = 6
MOST_NAMES = 12
SYMBOLS = {Verdict.PROVED: "✓", Verdict.REFUTED: "✗", Verdict.UNDECIDED: "?"}

MEANINGS = {
    Verdict.PROVED: "Shown by exact arithmetic on rational numbers. No solver and no rounding is trusted: what a solver"
    " proposed was rounded to rationals and then decided. Anybody can repeat the decision.",
    Verdict.REFUTED: "Shown by exact arithmetic to be false, with a witness that can be checked by hand: a vector,"
    " a set of agents, a polynomial. A refuted condition is not yet a failure of consensus: a theorem whose"
    " condition is false says nothing. Only the overall verdict “refuted” says that consensus fails.",
    Verdict.UNDECIDED: "Neither proved nor refuted here: the condition does not apply, or nothing was found that"
    " decides it. It never means that consensus fails.",
}

_POWER = re.compile(r"e([+-]\d+)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_IDEAL = "messages without delay, noise or quantisation"
_TIMED = "messages without noise or quantisation; late messages and sampling as far as their checks say"


def mark_of(verdict: Verdict) -> doc.Mark:
    """A verdict as a sign and a word."""
    return doc.Mark(SYMBOLS[verdict], verdict.value)


def domain_words(domain: Domain) -> str:
    """Where a check holds, in a few words."""
    if isinstance(domain, Mapping):
        radius, disturbance = domain.get("radius"), domain.get("disturbance")
        size = "|e|∞" if domain.get("kind") == "box" else "|e|₂"
        text = f"starts with {size} ≤ {_number(radius)}"
        return text if disturbance is None else f"{text} and every |εᵢ| ≤ {_number(disturbance)}"
    return {"global": "everywhere", "consensus": "near the target"}.get(domain, domain)


def covering_domain(certificate: Certificate) -> Domain | None:
    """The domain of the proof that carries the verdict."""
    for check in certificate.checks:
        if check.id == certificate.covered_by and check.verdict is Verdict.PROVED:
            return check.domain
    return None


def typeset(text: str) -> str:
    """Write a number given as text with a real minus and a power of ten: -1.5e-08 as −1.5·10⁻⁸."""
    return _POWER.sub(lambda match: "·10" + str(int(match.group(1))).translate(_RAISED), text).replace("-", "−")


def number(value: float | None) -> str:
    """A rounded number as people write it."""
    return typeset(significant(None if value is None else value + 0.0))  # no -0


def shortened(text: str, longest: int = 1200) -> str:
    """The text, or its beginning and an ellipsis."""
    return text if len(text) <= longest else text[: longest - 1] + "…"


def capitalize_first(text: str) -> str:
    """Make the first letter a capital and leave the others alone."""
    return text[:1].upper() + text[1:]


def what_it_means(certificate: Certificate) -> tuple[list[str], list[str]]:
    """What the overall verdict says, and what it does not."""
    if certificate.verdict is Verdict.PROVED:
        return _proved(certificate)
    if certificate.verdict is Verdict.REFUTED:
        return _refuted(certificate.problem)
    return _undecided(certificate)


def _proved(certificate: Certificate) -> tuple[list[str], list[str]]:
    switching = len(certificate.problem.network.modes) > 1
    domain = covering_domain(certificate)
    yes = [_from_where(domain)]
    if certificate.problem.groups:
        yes.append("The estimates converge to the true disturbances, wherever observer and disturbance start.")
    if switching:
        yes.append("The modes may switch at any times and in any order, arbitrarily fast: one V serves them all.")
    if certificate.rate:
        yes.append(
            f"The errors decay at least like exp(−{_number(certificate.rate)} t), t in seconds."
            " The real decay may be faster."
        )
    no = []
    if domain == "consensus":
        no.append(
            "It is local, a statement at the consensus. It names no radius: nothing is said about starts at a"
            " given distance, not even when simulations from there look well."
        )
    elif isinstance(domain, Mapping):
        no.append("It says nothing about starts outside that set. They may converge or not.")
    timed = [
        check.id for check in certificate.checks if check.kind.role == "timing" and check.verdict is Verdict.PROVED
    ]
    no.append(_about_the_model(certificate.problem, _TIMED if len(timed) == len(ids_of("timing")) else _IDEAL))
    return yes, no


def _about_the_model(problem: Problem, messages: str = _IDEAL) -> str:
    disturbances = "one (A, C) for all agents, " if problem.groups else ""
    disturbances = "one (A, C) for each group of agents, " if problem.is_grouped else disturbances
    return (
        f"It is about the model as given: single integrators, {disturbances}{messages}. Whether the model fits the"
        " plant is not decided here."
    )


def _from_where(domain: Domain | None) -> str:
    if domain == "global":
        return "Every agent goes to its goal from every start, however far: the proof is global."
    if isinstance(domain, Mapping):
        return f"Every agent goes to its goal from all {domain_words(domain)}."
    return "There is a neighbourhood of the target from which every agent goes to its goal."


def _refuted(problem: Problem) -> tuple[list[str], list[str]]:
    yes = [
        "Consensus on the target fails for this network, these pins and this observer, and the checks below say why.",
        "The reason is exact. More accuracy, another solver or more time cannot change it.",
    ]
    no = [
        "It does not say that the task is impossible: another pin, arc, gain or observer may cure it."
        " Where a cure is known, it is named here.",
        "It does not say that every start fails; some may still converge.",
        _about_the_model(problem),
    ]
    return yes, no


def _undecided(certificate: Certificate) -> tuple[list[str], list[str]]:
    proved = sum(check.verdict is Verdict.PROVED for check in certificate.checks)
    yes = [
        "What was asked is neither proved nor refuted.",
        f"{proved} of {len(certificate.checks)} checks are proved, and these hold by themselves.",
    ]
    no = [
        "It does not say that consensus fails. A sufficient condition that is not met says nothing.",
        "It does not say that consensus holds, even if a simulation below shows it.",
        _about_the_model(certificate.problem),
    ]
    return yes, no


def _number(value: object) -> str:
    return typeset(significant_towards_zero(value)) if isinstance(value, (int, float, Fraction)) else "?"


def agents_table(problem: Problem) -> doc.Table | None:
    """One row per agent: its gain, goal, and whom it hears in each listed mode; None for networks too large to list."""
    if problem.n > MOST_LISTED:
        return None
    labels, gains = problem.network.labels, problem.pinning.gains
    goals = doc.EVERY if problem.offsets else ("markdown",)
    heard = [(name, _heard(arcs, problem.n)) for name, arcs in list(problem.network.modes.items())[:MOST_MODES]]
    return doc.table_of(
        f"Gain k of the pins{', goals' if problem.offsets else ''}, and whom each agent listens to",
        range(problem.n),
        (doc.Column(head="agent", width=1.2), lambda i: labels[i]),
        (doc.Column(head="k in 1/s", width=0.8), lambda i: _gain(gains.get(i))),
        (doc.Column(head="goal", only=goals), lambda i: vector_text(problem.goal_of(i))),
        *(
            (doc.Column(head=f"listens to in {name}", width=2), lambda i, each=each: _names(problem, each[i]))
            for name, each in heard
        ),
    )


def mode_sentences(problem: Problem) -> list[tuple[str, str]]:
    """(mode, sentence) for the first modes; a rest is counted by the caller."""
    shown = list(problem.network.modes.items())[: 2 * MOST_MODES]
    return [(name, _mode_sentence(arcs, problem)) for name, arcs in shown]


def pin_sentence(problem: Problem) -> str:
    """Who is pinned."""
    pinned = problem.pinning.agents
    if not pinned:
        return "No agent is pinned."
    if len(pinned) == problem.n:
        return "Every agent is pinned." if problem.n > 1 else "The agent is pinned."
    names = names_in_words([problem.network.labels[i] for i in pinned])
    return f"{len(pinned)} of {problem.n} agents {'is' if len(pinned) == 1 else 'are'} pinned: {names}."


#: What the formulas mean where agents have different exosystems.
BY_GROUP = (
    "Agents differ in their exosystem. A, C and W in the equations of an agent are those of its group. I ⊗ C, I ⊗ Ω₀"
    " and I ⊗ S stand for matrices with the C, Ω₀ and S of each agent's group along the diagonal. The matrices below"
    " hold all groups along their diagonal, in this order."
)


def size_sentence(problem: Problem) -> str:
    """n, m, q and the number of modes."""
    modes = len(problem.network.modes)
    parts = [
        _count(problem.n, "agent"),
        f"{_count(problem.m, 'state component')} each",
        "one fixed topology" if modes == 1 else f"{modes} modes between which the topology switches",
    ]
    if problem.is_grouped:
        parts.append(f"a disturbance on every agent, of {len(problem.groups)} kinds")
    elif problem.groups:
        parts.append(f"a disturbance on every agent, generated by {_count(problem.q, 'exosystem state')}")
    else:
        parts.append("no disturbance")
    return "; ".join(parts) + "."


def group_sentences(problem: Problem) -> list[str]:
    """Which agents have which exosystem, where they have different ones."""
    if not problem.is_grouped:
        return []
    rows = [
        f"group of agent {group.name}: {names_in_words(group.agents)};"
        f" {_count(group.exosystem.order, 'exosystem state')}"
        for group in problem.groups[:MOST_NAMES]
    ]
    hidden = len(problem.groups) - len(rows)
    return [*rows, f"and {hidden} more"] if hidden else rows


def exception_sentences(problem: Problem) -> list[str]:
    """Arcs with a coupling of their own, in words."""
    labels = problem.network.labels
    rows = [
        f"{labels[i]} listening to {labels[j]}: h = {', '.join(coupling.texts)}"
        for (i, j), coupling in list(problem.exceptions.items())[:MOST_NAMES]
    ]
    hidden = len(problem.exceptions) - len(rows)
    return [*rows, f"and {hidden} more"] if hidden else rows


def region_sentence(problem: Problem) -> str | None:
    """What was asked to be covered."""
    if problem.region is None:
        return None
    pairs = [f"[{number_text(lo)}, {number_text(hi)}]" for lo, hi in problem.region.initial_states]
    inside = pairs[0] if len(set(pairs)) == 1 else " × ".join(pairs)
    text = f"The proof has to cover all starts with every state component in {inside}"
    if problem.region.initial_disturbance is not None:
        text += f" and every estimation error |ξᵢ(0) − ξ̂ᵢ(0)| ≤ {number_text(problem.region.initial_disturbance)}"
    return text + "."


def switching_sentence(problem: Problem) -> str | None:
    """The signal that simulations use."""
    if problem.switching is None:
        return None
    moving = problem.switching.signal == "mobile"
    allowed = "are about the arcs of the modes" if moving else "allow any signal"
    return (
        f"Switching in simulations: {switching_words(problem)}. The run shown here stays in one mode, and the proofs"
        f" {allowed}."
    )


def common_offsets(pairs: Iterable[tuple[int, int]], n: int) -> tuple[int, ...] | None:
    """The steps s with "every agent i listens to i + s (mod n)" when they are all there is, else None.

    ``pairs`` are (listener, speaker), each once.
    """
    known = list(pairs)
    steps = {(speaker - listener) % n for listener, speaker in known}
    return tuple(sorted(steps)) if known and len(known) == n * len(steps) else None


def unreached_agents(certificate: Certificate, mode: str) -> set[int]:
    """Agents that no pin reaches in this mode, as the refuted check names them."""
    for check in certificate.checks:
        if check.id == "reachability" and check.mode == mode and check.verdict is Verdict.REFUTED:
            named = set(check.witness.labels or ()) if check.witness is not None else set()
            return {i for i, label in enumerate(certificate.problem.network.labels) if label in named}
    return set()


def names_in_words(names: Sequence[str], most: int = MOST_NAMES) -> str:
    """List names: "1", "1 and 6", "1, 2, 3 and 40 more"."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "nobody"


def vector_text(vector: Vector) -> str:
    """A vector as text."""
    entries = [number_text(x) for x in vector[:MOST_NAMES]]
    if len(vector) == 1:
        return entries[0]
    return f"({', '.join(entries)}{', …' if len(vector) > MOST_NAMES else ''})"


def _mode_sentence(arcs: Arcs, problem: Problem) -> str:
    pairs = list(zip(arcs.listeners.tolist(), arcs.speakers.tolist(), strict=True))
    if not pairs:
        return "nobody listens to anybody."
    weighted = "" if all(weight == 1 for weight in arcs.weights) else ", with weights"
    count = f"{_count(len(pairs), 'arc')}{weighted}"
    steps = common_offsets(pairs, problem.n)
    if steps is not None and problem.n > 2 and len(steps) <= 4 and len(steps) < problem.n - 1:
        whom = names_in_words([f"i + {s}" if 2 * s <= problem.n else f"i − {problem.n - s}" for s in steps])
        return f"{count}; every agent i listens to {whom}, counted around a circle of {problem.n}."
    back = set(pairs)
    if all((j, i) in back for i, j in pairs):
        weights = dict(zip(pairs, arcs.weights, strict=True))
        alike = all(weights[i, j] == weights[j, i] for i, j in pairs) and not problem.exceptions
        return f"{count}; whoever listens is also listened to{' (undirected)' if alike else ''}."
    return f"{count}."


def _heard(arcs: Arcs, n: int) -> list[list[tuple[int, str]]]:
    heard: list[list[tuple[int, str]]] = [[] for _ in range(n)]
    for listener, speaker, weight in arcs:
        heard[listener].append((speaker, "" if weight == 1 else f" ({number_text(weight)}×)"))
    return heard


def _names(problem: Problem, heard: Sequence[tuple[int, str]]) -> str:
    names = [f"{problem.network.labels[speaker]}{weight}" for speaker, weight in sorted(heard)[:MOST_NAMES]]
    hidden = len(heard) - len(names)
    return (", ".join(names) + (f" and {hidden} more" if hidden else "")) or "–"


def _gain(gain: Matrix | None) -> str:
    if gain is None:
        return "–"
    if all(entry == (gain[0][0] if i == j else 0) for i, row in enumerate(gain) for j, entry in enumerate(row)):
        return number_text(gain[0][0])
    return "[" + "; ".join(", ".join(number_text(x) for x in row) for row in gain) + "]"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
