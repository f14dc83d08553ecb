"""A whole design, and a trade-off of designs: what is asked, what was decided and why, what each
limit costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any

from dobc_design._checks import noun
from dobc_design._show.cards import MOST_ITEMS, Card, Headed, listed, text_of
from dobc_design._show.text import significant_away_from_zero, significant_towards_zero
from dobc_design.certificate.certificate import Certificate
from dobc_design.conditions.consensus.network import name_agents
from dobc_design.conditions.numbers import fields_to_json, time_to_one_percent
from dobc_design.errors import Mistakes, SpecError
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import ZERO, float_above, number_text, typed_number
from dobc_design.exact.reading import Document, Table, Texts, counted, flag
from dobc_design.problem.changes import typed_matrix, value_text
from dobc_design.problem.problem import Problem
from dobc_design.synthesis.observer.claim import Answer, NoiseLimit, ObserverDesign, read_noise
from dobc_design.synthesis.pinning.claim import (
    AskedGains,
    Limits,
    PinningDesign,
    Structure,
    read_request,
)
from dobc_design.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd


AXES = {
    "gain": ("rate, 1/s", "sum of the gains, 1/s"),
    "pins": ("pinned agents", "rate, 1/s"),
    "noise": ("decay of the estimate's error, 1/s", "largest gain from noise to dhat, 1/s"),
}
NO_LIMITS = "no limits, and every agent may be pinned"
# What the limits of these kinds of statements are called as arguments.
ARGUMENTS = {
    "structure": "allowed",
    "detectable": "reduce",
    "gain": "noise",
    "stabilisable": None,
    "outputs": None,
}
PIN_HEADS = ("pins", "total gain", "certified rate, 1/s", "pinned")
NAMED = 8  # allowed agents in a sentence
SHOWN = 6  # gains in a sentence
FASTER = 1.5  # times the rate asked of an observer: explained
FEWER_MAY_DO = "fewer may do under the guarantee, which designs ignore"
SAVED = "Gain saved elsewhere (1/s) for each 1/s of gain there"


@noun
class DesignRequest(Limits):
    """What W and the gains k_i have to do together, so that everything the problem asks is proved.
    The certified rate has to be at least ``rate``.  ``pins``: None for as few as it takes.
    ``digits``: those of W as well.  ``noise``: bounds on norms of the observer.  ``reduce``: an
    exosystem that C does not see whole may be replaced by its observable part.  ``coupling``: h is
    designed, too."""

    pins: int | None
    noise: tuple[NoiseLimit, ...]
    reduce: bool
    coupling: bool = False

    def limits(self, labels: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Every limit that was set, as the name of the argument and its value in words."""
        if self.rate is not None:
            yield "rate", f"a certified rate of at least {typed_number(self.rate)} 1/s"
        if self.pins is not None:
            yield "pins", f"at most {counted(self.pins, 'pinned agent')}"
        if self.caps:
            # the smallest and the largest; one number where all are alike
            ends = sorted({min(self.caps.values()), max(self.caps.values())})
            yield "max_gain", f"gains up to {' to '.join(str(typed_number(k)) for k in ends)}"
        if len(self.allowed) < len(labels):
            names = [labels[i] for i in self.allowed[:NAMED]]
            if len(self.allowed) > NAMED:
                names.append("...")
            yield "allowed", f"pins on {', '.join(names)} only"
        for limit in self.noise:
            yield "noise", str(limit)
        if not self.reduce:
            yield "reduce", "the exosystem kept as it is"
        if self.conservative:
            yield "conservative", "V = e'e near the target"
        if self.coupling:
            yield "coupling", "a coupling of the design's own"


@noun
class AskedDesign(AskedGains):
    """The arguments of ``design`` as they were given, not yet read."""

    rate: Any = None
    noise: Any = None
    reduce: Any = True
    coupling: bool = False


def read_design_request(labels: Sequence[str], asked: AskedDesign) -> DesignRequest:
    """Read the arguments of ``design``, exactly.  Raises: SpecError that names every wrong one."""
    # Gains near the consensus are always for a rate; any number stands in for none.
    gains = replace(asked, rate=1) if asked.rate is None else asked
    # All that is wrong is said at once.
    errors = Mistakes()
    with errors:
        found = read_request(labels, gains)
    with errors:
        noise = read_noise(asked.noise)
    with errors:
        cure = "True lets the observable part take the exosystem's place."
        flag(asked.reduce, "reduce", cure)
    errors.raise_all()
    return DesignRequest(
        rate=None if asked.rate is None else found.rate,
        allowed=found.allowed,
        caps=found.caps,
        # "fewest" is what a design does anyhow
        pins=found.pins if isinstance(found.pins, int) else None,
        noise=noise,
        digits=found.digits,
        reduce=asked.reduce,
        conservative=found.conservative,
        coupling=asked.coupling,
    )


@noun
class RegionPrices:
    """What the multipliers of gains over a region say.

    ``share``: near ``rate`` (1/s), each percent of rate takes so many percent of gain.  ``capped``:
    agents whose gain is at its cap.  ``savings``: what each 1/s of gain on agents without one saves
    elsewhere (1/s), of those that would save most, where that is more than it costs; None where
    every agent has a gain.  ``barred``: those of them that may not be pinned.
    """

    rate: float
    share: float
    capped: Texts
    savings: Mapping[str, float] | None
    barred: Texts

    def sentences(self, *, pins: bool) -> Iterator[str]:
        """What each limit costs; ``pins``: their number, too."""
        more = f"each 1 % more takes about {self.share:.3g} % more gain"
        yield f"Price of the rate: near {self.rate:.4g} 1/s, {more}."
        if self.capped:
            have = "has" if len(self.capped) == 1 else "have"
            who = name_agents(self.capped)
            yield f"Price of the caps: {who} {have} the largest gain allowed."
        if not pins:
            return
        if self.savings:
            first = next(iter(self.savings))
            each = ", ".join(f"agent {label} {saved:.3g}" for label, saved in self.savings.items())
            barred = f" (not allowed: {name_agents(self.barred)})" if self.barred else ""
            most = f"agent {first} would save most. {SAVED}: {each}{barred}"
            yield f"Price of so few pins: {most}."
        elif self.savings is not None:
            none = "none; a gain on any other agent would cost more than it saves"
            yield f"Price of so few pins: {none}."


@noun
class Grounds:
    """Why a design has these pins and gains, and what they cost.

    ``structure``: which groups need a pin.  ``limited``: as many pins as were allowed.  ``part``:
    what is aimed at of the fastest rate that the pins allow, where no rate was asked for.
    ``reduction``: how the exosystem was replaced by its observable part; ``arcs``: those that were
    added.  ``near``: the design near
    the consensus that the gains are from, or ``region``: their multipliers over the region.
    ``everything``: the rate is proved only where every condition is run.  ``weaker``: so many times
    all couplings and gains would keep the rate of agents with [dynamics], by the eigenvalues of the
    linearisation.
    """

    structure: Structure
    limited: bool
    part: Fraction | None
    reduction: str | None
    everything: bool
    arcs: str | None = None
    near: PinningDesign | None = None
    region: RegionPrices | None = None
    weaker: float | None = None


@noun
class Design(Answer):
    """An observer gain, pinned agents and gains, and what is known of them.

    ``verdict``: PROVED, everything that the problem asks is proved for ``problem``, with these
    rounded numbers, and ``certificate`` shows it; REFUTED, nothing can do what was asked, and
    ``reason`` is the proof in words; UNDECIDED, neither was shown.  ``W`` (q, p), ``P`` (q, q) and
    ``gains`` (1/s, by label) are exact; ``rate`` (1/s) is the certified rate and ``cost`` the sum
    of the gains; of agents with [dynamics] these are multiples of the coupling. ``decisions``: what
    was chosen and why, beside the problem's own gains (``given``: their certificate); ``prices``:
    what each limit costs, about.  ``further``: designs with more pins for the same rate (x:
    certified, y: total gain), as many as were asked for.  ``grounds``: what all put into words.
    ``observer``: W with what is proved of it.  ``changes``: the keys of the problem file that were
    set (None: removed).  ``nearest``: the design for the nearest request that was proved possible,
    where this one was not.
    """

    request: DesignRequest
    labels: Texts
    W: Matrix | None = None
    P: Matrix | None = None
    gains: Mapping[str, Fraction]
    rate: float | None = None
    cost: Fraction | None = None
    changes: Table
    problem: Problem | None = None
    certificate: Certificate | None = None
    observer: ObserverDesign | None = None
    nearest: Design | None = None
    grounds: Grounds | None = None
    given: Certificate | None = None
    further: tuple[TradePoint, ...] = ()

    @property
    def binding(self) -> str | None:
        """The limit that a refuted request fails by, as the argument is called; None where nothing
        was refuted."""
        if self.verdict is not Verdict.REFUTED or not self.statements:
            return None
        kind = self.statements[0].kind
        return ARGUMENTS.get(kind, kind)

    @property
    def limits(self) -> str:
        """The limits that were set, in words."""
        return "; ".join(words for _, words in self.request.limits(self.labels)) or NO_LIMITS

    def _why(self) -> str:
        proof = self.certificate
        if proof is None:
            return "" if self.obstacle is None else self.obstacle.text
        wanted = self.request.rate
        # What the certificate says is true, and not what was asked.
        too_slow = not self.is_proved and proof.verdict is Verdict.PROVED
        if too_slow and wanted is not None:
            asked = f"{typed_number(wanted)} was asked for"
            return f"the rate proved is {self.rate or 0:.4g} 1/s, {asked}."
        return proof.reason

    @property
    def decisions(self) -> Texts:
        """What was chosen and why, in words."""
        return tuple(_decisions(self))

    @property
    def prices(self) -> Texts:
        """What each limit costs, in words."""
        return tuple(_prices(self))

    def __str__(self) -> str:
        lines = [f"{self.verdict.value}: {self.reason}"]
        lines += [f"  {sentence}" for sentence in (*self.decisions, *self.prices)]
        if self.further:
            lines.append(f"  {self.pin_table()}")
        if self.nearest is not None:
            lines.append(f"  Nearest possible request: {self.nearest.limits}.")
        return "\n".join(lines)

    def pin_table(self) -> str:
        """The total gain and the certified rate of this design and of those with further pins."""
        return text_of(Card(title="Price of further pins", heads=PIN_HEADS, rows=self._pin_rows()))

    def _pin_rows(self) -> list[Texts]:
        if not self.further or self.rate is None or self.cost is None:
            return []
        own = TradePoint(x=self.rate, y=float(self.cost), pinned=tuple(self.gains), proved=True)
        rows = list[Texts]()
        for p in (own, *self.further):
            rate = significant_towards_zero(p.x)
            rows.append((str(len(p.pinned)), f"{p.y:.6g}", rate, listed(p.pinned)))
        return rows

    def to_json(self) -> Document:
        """JSON object; exact numbers as text, ``cost`` rounded up.  ``problem`` is the name of the
        problem."""
        proof = self.certificate
        document = {"verdict": self.verdict.value} | fields_to_json(self, "W", "P", "gains")
        # Only designs that chose a coupling have the key.
        if "coupling.h" in self.changes:
            document["coupling"] = self.changes["coupling.h"]
        return document | {
            "rate": self.rate,
            "factor": None if proof is None else proof.factor,
            "cost": None if self.cost is None else float_above(self.cost),
            "reason": self.reason,
            "problem": None if self.problem is None else self.problem.name,
            "covered_by": None if proof is None else proof.covered_by,
            **fields_to_json(self, "binding", "decisions", "prices", "statements"),
            "request": dict(self.request.limits(self.labels)),
            **fields_to_json(self, "nearest", "further"),
        }

    def _card(self) -> Card:
        facts = list[tuple[str, Any]]()
        if self.W is not None:
            facts.append(("W", self.W))
        if self.P is not None:
            facts.append(("P", self.P))
        if self.gains:
            first = islice(self.gains.items(), MOST_ITEMS + 1)
            pairs = [f"{label}: {number_text(k)}" for label, k in first]
            facts.append(("gains in 1/s", listed(pairs, count=len(self.gains))))
        if self.rate is not None:
            facts.append(("certified rate in 1/s", significant_towards_zero(self.rate, 6)))
        if self.certificate is not None and self.certificate.factor is not None:
            facts.append(("factor of it", significant_away_from_zero(self.certificate.factor, 6)))
        facts += [("decided", sentence) for sentence in self.decisions]
        if self.nearest is not None:
            facts.append(("nearest possible", self.nearest.limits))
        return Card(
            title="Design",
            verdict=self.verdict.value,
            text=self.reason,
            facts=facts,
            heads=PIN_HEADS,
            rows=self._pin_rows(),
            lines=self.prices,
        )


def _decisions(design: Design) -> Iterator[str]:
    """What was chosen and why: beside the own gains, exosystem, observer, pins, gains, proof."""
    grounds = design.grounds
    if grounds is None or design.problem is None:
        return
    if design.given is not None:
        yield _beside_words(design, design.given)
        lost = _lost(design, design.given)
        if lost:
            yield f"Proved with your own gains, but not with this design: {', '.join(lost)}."
    if grounds.reduction is not None:
        yield f"Exosystem: {grounds.reduction}"
    if design.observer is not None:
        yield from _observer_words(design.observer)
        asked = design.problem.joint_observer.rate
        if asked and design.observer.measures.get("rate", 0.0) > FASTER * asked:
            so = "so that it does not hold back the certified rate"
            yield f"W is faster than observer.rate = {typed_number(asked)} asks, {so}."
    if grounds.arcs is not None:
        yield f"Arcs: {grounds.arcs}"
    if not design.problem.agrees:
        pinned = tuple(design.gains)
        why = _why_so_many(design.problem, grounds, len(pinned))
        yield f"Pinned: {name_agents(pinned)}; {why}."
        yield _gains_words(design, design.problem, grounds)
    proof = design.certificate
    covered_by = None if proof is None else proof.covered_by
    how = f"Proved by: {covered_by or 'nothing yet'}."
    if grounds.everything:
        # Somebody who certifies the file as usual would see a lower rate.
        how += " That rate is proved when every condition is run (dobc certify --all)."
    yield how


def _observer_words(found: ObserverDesign, whose: str = "") -> Iterator[str]:
    """W, how fast its error decays, how it came about; a sentence for every group of agents."""
    if found.groups:
        for name, each in found.groups.items():
            yield from _observer_words(each, f" of the group of agent {name}")
        return
    rate = found.measures.get("rate")
    noise = found.measures.get("hinf measurement")
    size = found.measures.get("gain")
    rows = value_text(typed_matrix(found.W or ()))
    text = f"Observer{whose}: W = {rows} ({found.source}): the error of the estimate decays"
    if rate:
        text += f" at {rate:.4g} 1/s"
    if noise:
        text += f", noise on the measured x reaches dhat with a gain of at most {noise:.4g} 1/s"
    text += "."
    if size:
        text += f" |W| = {size:.4g}."
    yield text


def _why_so_many(problem: Problem, grounds: Grounds, count: int) -> str:
    """Why a design has so many pins."""
    least = grounds.structure.least
    groups = grounds.structure.groups
    if count != least and grounds.limited:
        return "as many as were allowed"
    if count != least:
        are = "is" if least == 1 else "are"
        fewer = f"fewer than {count} need larger gains or have no proof"
        return f"{least} {are} the least that the arcs allow, but {fewer}"
    # There cannot be fewer pins than the graph asks for.
    if problem.dynamics is not None:  # agents that may settle by themselves
        return "pins go where agents listen to nobody else"
    if len(groups) > 1:
        why = f"{len(groups)} groups listen to nobody outside, and each needs a pin"
        if len(groups) > count:
            why = f"{why} (groups of different modes may share one)"
        switching = problem.switching
        # Groups are those of every mode alone, although a signal may leave it in time.
        guaranteed = switching is not None and switching.is_guaranteed
        if guaranteed and len(problem.network.modes) > 1:
            why = f"{why} under arbitrary switching; {FEWER_MAY_DO}"
        return why
    group = groups[0]
    if len(group) == problem.n:
        return "at least one is needed, or the group can drift as a whole. No more were needed"
    listen = "listens" if len(group) == 1 else "listen"
    who = name_agents([problem.network.labels[i] for i in group])
    return f"{who} {listen} to nobody outside, so there has to be a pin"


def _gains_words(design: Design, problem: Problem, grounds: Grounds) -> str:
    """The gains, rounded up; what they are chosen for, and with which coupling."""
    gains = design.gains
    first = islice(gains.items(), SHOWN)
    words = ", ".join(f"k = {typed_number(k)} for agent {label}" for label, k in first)
    if len(gains) > SHOWN:
        words += f" and {len(gains) - SHOWN} more"
    if len(gains) > 1:
        words += f", in total {typed_number(sum(gains.values(), ZERO))}"
    unit = "(1/s)" if problem.dynamics is None else "(times the coupling)"
    digits = counted(design.request.digits, "digit")
    words = f"Gains: {words} {unit}, rounded up to {digits}."
    if grounds.part is not None:
        part = f"{float(grounds.part):.0%} of the fastest rate that pins there allow"
        words += f" They are meant for {part}."
    if grounds.near is not None:
        by = "V = e'e."
        if grounds.near.weights is not None:
            by = "the true rate near the target (V = e'De, a weight for each agent)."
        words += f" They are chosen for {by}"
    if "coupling.h" in design.changes:
        words += f" Coupling: h = {value_text(design.changes['coupling.h'])}."
    return words


def _prices(design: Design) -> Iterator[str]:
    """What each limit costs, by the multipliers of the gains."""
    grounds = design.grounds
    if grounds is None:
        return
    if grounds.near is not None:
        yield from grounds.near.prices
        yield from grounds.near.ties
    if grounds.region is not None:
        # These prices are of small gains beside the others; a table of whole designs says more.
        yield from grounds.region.sentences(pins=not design.further)
    if grounds.weaker is not None:
        part = f"{grounds.weaker:.3g} times all couplings and gains"
        rate = f"would keep {design.rate or 0:.4g} 1/s"
        yield f"By the eigenvalues of the linearisation, which prove nothing, {part} {rate}."


def total_gain(problem: Problem) -> Fraction | None:
    """The sum of a problem's gains; None without gains, or where one is a matrix."""
    gains = problem.gains.values()
    if not gains or not problem.pinning.is_scalar:
        return None
    return sum(gains, ZERO)


def _beside_words(design: Design, given: Certificate) -> str:
    """The design beside the problem's own gains."""
    proof = design.certificate
    if given.verdict is not Verdict.PROVED or proof is None:
        return "Your own gains are not proved to do what the problem asks; this design is."
    if not given.rate or not design.rate:
        return "Your own gains are proved, too; there are no two rates to be compared."
    own = _rate_words(given.rate, given)
    this = _rate_words(design.rate, proof)
    text = f"Your own gains are certified at {own}, this design at {this}"
    total = total_gain(given.problem)
    if total and design.cost is not None:
        both = f"{typed_number(design.cost)} instead of {typed_number(total)}"
        text += f" with {float(design.cost / total):.3g} times the total gain ({both})"
    text += "."
    gap = _one_percent(given) - _one_percent(proof)
    if math.isfinite(gap) and gap * (given.rate - (proof.rate or 0.0)) > 0:
        text += (
            " The larger rate has the later time because its factor is larger: one percent is "
            "reached after ln(100 factor) / rate."
        )
    if design.request.rate is not None:
        return text
    if design.rate >= given.rate:
        return f"{text} No rate was asked for; at least that of your own gains was aimed at."
    return f"{text} No design with the rate of your own gains was proved within the limits."


def _one_percent(proof: Certificate) -> float:
    return time_to_one_percent(proof.rate, proof.factor)


def _rate_words(rate: float, proof: Certificate) -> str:
    """A certified rate, and the certified time to one percent with the factor that it follows
    from."""
    text = f"{significant_towards_zero(rate)} 1/s"
    time = _one_percent(proof)
    if math.isfinite(time):
        by = f"factor {significant_away_from_zero(proof.factor)}"
        # The largest rate may be another check's than the least time.
        if proof.rate != rate:
            by += f" at {significant_towards_zero(proof.rate)} 1/s"
        text += f" (one percent after {significant_away_from_zero(time, 3)} s, {by})"
    return text


def _lost(design: Design, given: Certificate) -> list[str]:
    """Ids of conditions that are proved with the problem's own gains, but not with the design."""
    failing = {each.id for each in given.checks if not each.is_proved}
    proved = {each.id for each in given.checks} - failing
    checks = () if design.certificate is None else design.certificate.checks
    return list(
        dict.fromkeys(each.id for each in checks if each.id in proved and not each.is_proved)
    )


@noun
class TradePoint:
    """One design of a curve.  ``pinned``: labels of the agents; ``proved``: whether y is a proved
    bound."""

    x: float
    y: float
    pinned: Texts = ()
    proved: bool = False

    def to_json(self) -> Document:
        """JSON object, as one of the further pins of a design."""
        return {"pinned": list(self.pinned), "cost": self.y, "rate": self.x}


@noun
class TradeOff(Headed):
    """One limit of a design in terms of another.

    ``curve``: "gain" (x: rate asked, y: sum of the gains), "pins" (x: how many agents, y: the rate
    that gains there approach) or "noise" (x: decay rate of the estimate's error, y: largest gain
    from measurement noise to dhat); all in 1/s but the number of agents.  ``points``: by x.
    ``chosen``: the point of the design that was handed in, or None. ``sensitivity``: what the
    multipliers of ``design``, or the points of the curve of pins, say, in sentences.
    """

    name: str
    curve: str
    points: tuple[TradePoint, ...]
    chosen: TradePoint | None
    design: Design | None = None

    @property
    def sensitivity(self) -> Texts:
        """What a further pin buys, or what each limit of the design costs."""
        if self.curve == "pins":
            if len(self.points) < 2:
                return ()
            before, after = max(pairwise(self.points), key=lambda step: step[1].y / step[0].y)
            new = ", ".join(label for label in after.pinned if label not in before.pinned)
            times = f"With agent {new} the rate grows {after.y / before.y:.3g} times"
            return (f"The most useful step: from {before.x:g} to {after.x:g} pins. {times}.",)
        if self.curve != "gain" or self.design is None:
            return ()
        if not self.design.gains:
            return (self.design.reason,)
        return self.design.prices

    @property
    def x_name(self) -> str:
        """What x is, with its unit."""
        return AXES[self.curve][0]

    @property
    def y_name(self) -> str:
        """What y is, with its unit."""
        return AXES[self.curve][1]

    def plot(self, ax: Any = None) -> Any:
        """The curve with the chosen point.  Returns: a Sheet; with Matplotlib's ``ax`` these
        axes."""
        from dobc_design.plotting.sweeps import trade_off_plot

        return trade_off_plot(self, steps=self.curve == "pins", ax=ax)

    def to_pandas(self) -> pd.DataFrame:
        """One row per point: x, y, pinned, proved, chosen.  Raises: SpecError if pandas is not
        installed."""
        try:
            import pandas as pd
        except ImportError:
            message = "to_pandas needs the package pandas, which is not installed."
            cure = "Install it (pip install dobc_design[store]), or use the points themselves."
            raise SpecError(message, key="pandas", cure=cure) from None
        columns = [self.x_name, self.y_name, "pinned", "proved", "chosen"]
        rows = list[tuple[Any, ...]]()
        for p in self._all():
            rows.append((p.x, p.y, ", ".join(p.pinned), p.proved, p is self.chosen))
        return pd.DataFrame(rows, columns=columns)

    def _all(self) -> list[TradePoint]:
        own = [] if self.chosen is None else [self.chosen]
        return sorted([*self.points, *own], key=lambda point: (point.x, point.y))

    def _card(self) -> Card:
        rows = list[Texts]()
        for p in self._all():
            mark = "chosen" if p is self.chosen else ""
            rows.append((f"{p.x:.4g}", f"{p.y:.4g}", listed(p.pinned), mark))
        return Card(
            title=self.name,
            text=f"{self.y_name} against {self.x_name}",
            rows=rows,
            lines=self.sensitivity,
            heads=(self.x_name, self.y_name, "pinned", ""),
        )
