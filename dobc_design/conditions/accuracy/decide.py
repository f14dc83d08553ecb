"""Final bounds of the error under [uncertainty]: what a proved ``accuracy`` claims (theory, section
12).

The plant is x_i' = sum_j w h_ij(x_j - x_i) + u_i + d_i + w_i with |w_i| <= omega, xi_i' = A xi_i +
g_i with |g_i| <= gamma, and every measured state may be off by nubar (by component, all).  Each
weight w may be off by the part dw and each entry of a gain by the part dk.  Then every start of the
domain ends with |e_i| <= bounds_i, for arbitrary switching, and no start of it leaves the box |e_i|
<= rho v_i of the first stage.

With F = A - WC, H_i = sum_j w sup |h'| and Hmax_i the largest H_i of all modes, what acts on agent
i besides its row (in which weights and gains take their worse ends) and a part of the estimation
error that decays by itself is at most b_i + eta_i s while N was at most s (theory, What the model
leaves out),

    b_i = omega (1 + peak of W) + gamma (peak of I) + nubar ((1 + dk) |k_i| + |C W| + peak of F W)
          + 2 nubar (1 + dw) (H_i + (peak of W) Hmax_i)
    eta_i = dw (peak of W) max over modes of sum_j w (v_i + v_j) sup |h(y)/y|

where eta_i is 0 if the observers know the weights: else they are fed sum w h and not what acts.
Where rows with b_i + eta_i s added stay <= -alpha s v_i for all s in [level, rho], N reaches the
level in finite time and stays below it, if kappa beta min v > 1 for the part of V that is the
observer's: when V = N + kappa E is larger than ever before, so is N (E falls), so that the history
counts with s = N; and the largest limit of N counts with itself, since observers forget.

In coordinates z_i = T e_i (``separable.coordinates``; agents with dynamics, couplings of vectors) b
= omega (1 + peak of W) + gamma (peak of I) acts through B: |T B| b is added to the rows, which are
linear in s for gains of the stage.  Where errors are those of estimates of measured outputs, b is
what y - H xhat comes to and acts through W_x, and bounds have |x - xhat| added (``channels``).

Where couplings do not rise, ``balls`` may do: in {V <= level} of an arc-wise claim (``arcs``) V' <=
-2 rate V + 2 sum d_i |e_i|_1 b_i, with b_i as in a box that holds it, so that V falls to m sum d_i
b_i^2 / rate^2 (Cauchy and Schwarz).  There a smaller ball may take over.

A linear loop in one mode, e' = M e + (I (x) B)(w + C eps) with M = J - K, needs neither stages nor
coordinates: e_ic ends below b times the integral of row (i, c) of |exp(M t) (I (x) B)|, its peak
gain, which some w attains without eps.  Of a sine z of frequency w no more is left than its size
times each of

    sum of |M^l E|/w^(l+1) for l < k  +  (peak gain of M^k E)/w^k,    E = I (x) B,

since z is the derivative of a sine smaller by w: e less E times that sine obeys the same equation
with M E in place of E.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from typing import Any

from dobc_design._checks import noun
from dobc_design.conditions.arcs import claim as arcs
from dobc_design.conditions.arcs import decide as discs
from dobc_design.conditions.case import Case, not_all_starts
from dobc_design.conditions.check import Check, read_parts
from dobc_design.conditions.consensus.claim import jacobians_at_consensus, linearisation
from dobc_design.conditions.domain import EVERYWHERE, Around, Box, Domain
from dobc_design.conditions.numbers import (
    fields_to_json,
    form_from_json,
    known_to_json,
    matrix_from_json,
    positive_from_json,
    rational_or_none,
    read_rational,
    rounded_up,
    vector_from_json,
    vector_to_json,
    whole_from_json,
)
from dobc_design.conditions.observer.bands import are_bounded
from dobc_design.conditions.observer.channels import channels, entries
from dobc_design.conditions.quadratic.sectors import GainRange, ranges_from_json
from dobc_design.conditions.reason import fixed_obstacle
from dobc_design.conditions.separable.checks import obstacle as not_applicable
from dobc_design.conditions.separable.claim import (
    EXACT,
    FACES,
    ErrorBound,
    Errors,
    Row,
    Separable,
    Term,
    error_of,
    error_sizes,
    error_to_json,
    observed_in,
    rows,
    stated_errors,
    tied_sizes,
)
from dobc_design.conditions.separable.coordinates import rows_obstacle
from dobc_design.conditions.separable.decide import (
    FaceRow,
    coupling_profiles,
    covers,
    observer_obstacle,
)
from dobc_design.conditions.stated import is_felt_by_arcs_alone
from dobc_design.coupling.enclosures import Profile, jet, secant_range
from dobc_design.coupling.tree import ZERO
from dobc_design.exact.interval import Interval, UndefinedError
from dobc_design.exact.matrix import Matrix, Vector, dot, identity, multiply, row_norm
from dobc_design.exact.peaks import MOST_STEPS, peak_gains
from dobc_design.exact.reading import Document
from dobc_design.exact.symmetric import Doubles, least
from dobc_design.loop.loop import Loop
from dobc_design.loop.pairs import are_pairs
from dobc_design.problem.bands import band_words
from dobc_design.problem.exosystems import block_diagonal
from dobc_design.problem.uncertainty import BOUNDS, Uncertainty
from dobc_design.verdict import Verdict

MOST_STAGES = 30
INPUTS = BOUNDS


@noun
class Level:
    """One stage: for all s in [level, rho] the box |e_i| <= s v_i shrinks, N = max |e_i|/v_i
    falling at least at the rate alpha.  ``rho`` None: for all s >= level (linear couplings).  All
    numbers > 0.  In coordinates v has an entry for each component of z, and ``ranges`` are the
    gains where N <= rho."""

    v: Vector | Doubles
    alpha: Fraction
    level: Fraction
    rho: Fraction | None
    ranges: tuple[GainRange, ...] = ()

    def to_json(self) -> Document:
        """The exact values as text."""
        values = {"v": vector_to_json(self.v), **fields_to_json(self, "alpha", "level", "rho")}
        if self.ranges:
            values |= fields_to_json(self, "ranges")
        return values


@noun
class Peaks:
    """How far the observer passes on what the model leaves out, F = A - WC: upper bounds of the
    integrals of |C exp(F t) W| (``disturbance``), |C exp(F t)| (``drift``), and of |C exp(F t) F
    W|, plus |C W| (``measurement``), row sums, in every group of agents.  Shown in ``steps`` steps
    of ``step`` (s); all 0 where nothing of that kind is stated.  ``bands``: for each band of sines
    bounds (r, p) of what is left of them (``bands``).  ``off``: where errors are those of estimates
    (m,), what all but bands leaves of |x - xhat|.  In general as ``channels`` has it."""

    disturbance: Fraction = Fraction(0)
    drift: Fraction = Fraction(0)
    measurement: Fraction = Fraction(0)
    step: Fraction = Fraction(0)
    steps: int = 0
    bands: tuple[Matrix, ...] = ()
    off: Vector = ()

    def to_json(self) -> Document:
        """The exact values as text."""
        names = [*INPUTS, "step", "steps"] if self.steps else []
        names += [name for name in ("bands", "off") if getattr(self, name)]
        return fields_to_json(self, *names)


def takes_integrals(loop: Loop) -> bool:
    """Whether something is stated of which an observer passes on up to an integral."""
    plant = loop.uncertainty
    if plant is None:
        return True
    felt = bool(plant.weights) and not plant.known_to_agents
    return felt or any(getattr(plant, name) for name in INPUTS)


@noun
class Response:
    """Steps in which the response of a linear loop is followed: ``steps`` of ``step`` (s)."""

    step: Fraction
    steps: int

    def to_json(self) -> Document:
        """The exact values."""
        return fields_to_json(self, "step", "steps")


@noun
class Accuracy:
    """Stages or ``balls`` from the outside inwards, or the ``response`` of a linear loop, and
    ``bounds``: label -> final bound of |e_i|, in coordinates z = T e and with a response one for
    each component of e_i.  ``peaks``: with an exosystem; ``error``: with one, where the couplings
    are not linear."""

    stages: tuple[Level, ...]
    bounds: Mapping[str, Fraction | Vector]
    peaks: Peaks | None = None
    error: ErrorBound | None = None
    T: Matrix | None = None
    response: Response | None = None
    balls: tuple[arcs.ArcWise, ...] = ()

    @property
    def by_component(self) -> bool:
        """Whether every component of e_i has a bound of its own."""
        return self.T is not None or self.response is not None

    @property
    def listed(self) -> dict[str, Vector]:
        """The bounds, each as a vector."""
        return {label: x if isinstance(x, tuple) else (x,) for label, x in self.bounds.items()}

    def in_stage(self, stage: Level) -> Separable:
        """The boxes of a stage as those of a max-separable claim."""
        return Separable(
            v=stage.v,
            alpha=stage.alpha,
            rho=stage.rho,
            error=self.error,
            T=self.T,
            ranges=stage.ranges,
        )

    def to_json(self) -> Document:
        """The exact values of a proved check."""
        first = "stages" if self.response is None else "response"
        first = "balls" if self.balls else first
        values = fields_to_json(self, first, "bounds") | known_to_json(self, "T", "peaks")
        return values | error_to_json(self.error)


def read_claim(check: Check, loop: Loop, W: Matrix | None) -> Accuracy:
    """What a proved check of this topic claims, for this problem."""
    given = check.exact or {}
    linear = "response" in given
    turned = not (linear or "balls" in given) and "T" in given
    bound = (read_rational,) * loop.m if turned or linear else read_rational
    shape: Document = {"bounds": dict.fromkeys(loop.labels, bound)}
    if loop.groups:
        shape["peaks"] = partial(peaks_from_json, loop=loop)
    if linear:
        shape["response"] = {"step": read_rational, "steps": whole_from_json}
        values = read_parts(given, shape)
        return Accuracy(stages=(), **values | {"response": Response(**values["response"])})
    if "balls" in given:
        shape["balls"] = [partial(arcs.claim_from_json, loop=loop, W=W)]
        return Accuracy(stages=(), **read_parts(given, shape))
    shape["stages"] = [partial(_read_level, loop=loop, turned=turned)]
    if turned:
        shape["T"] = form_from_json
    if not loop.is_linear:
        shape |= observed_in(loop)
    values = read_parts(given, shape)
    return Accuracy(error=error_of(values), **values)


def peaks_from_json(data: Any, loop: Loop | None = None) -> Peaks:
    """Peak gains as a certificate has them; without a ``loop`` those of the integrals."""
    shape: Document = {}
    if loop is None or takes_integrals(loop):
        shape = dict.fromkeys((*INPUTS, "step"), read_rational) | {"steps": whole_from_json}
        if loop is not None and loop.estimated:
            shape["off"] = (read_rational,) * loop.m
    if loop is not None and loop.bands:
        shape["bands"] = [matrix_from_json]
    return Peaks(**read_parts(data, shape))


def _read_level(data: object, loop: Loop, turned: bool) -> Level:
    shape = level_shape(loop.size if turned else loop.n) | {"rho": rational_or_none}
    if turned:
        shape["ranges"] = None
    values = read_parts(data, shape)
    rho = values["rho"]
    if (rho is None) != loop.is_linear:
        raise ValueError("rho must be null exactly where every coupling is linear")
    if turned:
        values["ranges"] = ranges_from_json(values["ranges"], loop, rho)
    return level_of(values)


def level_shape(size: int) -> Document:
    """The shape of v (``size`` entries), alpha and level (``read_parts``)."""
    v = partial(vector_from_json, size=size)
    return {"v": v, "alpha": positive_from_json, "level": positive_from_json}


def level_of(values: Document) -> Level:
    """The stage with these values."""
    level = Level(**values)
    if least(level.v) <= 0 or (level.rho is not None and level.rho < level.level):
        raise ValueError("v must be > 0, and rho at least level")
    return level


ID = "accuracy"
MOST_AGENTS = 500
MOST_ROWS = 60  # n m of a loop whose response is followed
MOST_PRODUCTS = 20_000_000  # of numbers, along all steps of a response
_SHOWN = 6  # bounds told in the reason
_NO_HANDOVER = "a stage does not hold the box in which the one before ends."


def obstacle(loop: Loop, W: Matrix | None, *, turned: bool = False) -> str | None:
    """Why no final bounds can be shown for the loop with the gain W (q, m); None if they may be.
    ``turned``: in coordinates."""
    if loop.n > MOST_AGENTS:
        nodes = "pairs of " * are_pairs(loop)
        return f"does not apply: final bounds are decided for at most {MOST_AGENTS} {nodes}agents."
    plant = loop.uncertainty or Uncertainty()
    # Rows in coordinates take what acts as a load; they know nothing of noise in couplings.
    if turned and plant.measurement and not loop.estimated:
        return (
            "does not apply: measurement noise is known for couplings that act by component only."
        )
    if turned and (plant.weights or plant.gains):
        return (
            "does not apply: with a disturbance, errors of weights and gains are known for "
            "couplings by component only."
        )
    if loop.estimated and loop.is_apart and len(loop.sensed) > 1:
        return "does not apply: pairs of agents with different observers estimate their states."
    reason = fixed_obstacle(loop, apart=True)
    if reason is None and not turned and loop.drift is not None:
        return "does not apply: bounds for agents with [dynamics] are made in coordinates."
    return reason or not_applicable(loop, W, turned=turned)


def response_obstacle(loop: Loop) -> str | None:
    """Why the response of the whole loop bounds nothing here; None if it may."""
    plant, (mode, *others) = loop.uncertainty or Uncertainty(), loop.modes
    if not loop.is_linear or others or loop.modes[mode].optional:
        return (
            "the response of the whole loop is followed for linear couplings in one mode "
            "without optional arcs only."
        )
    measured = bool(plant.measurement) and not loop.estimated
    if measured or plant.weights or plant.gains:
        return (
            "noise and errors of weights and gains are not known where the response of the "
            "whole loop is followed."
        )
    if loop.signed:
        return "the response of the whole loop is followed without signs, or with two sides."
    if loop.size > MOST_ROWS:
        return (
            f"the response of the whole loop is followed for at most {MOST_ROWS} states of agents."
        )
    return None


def loop_matrix(loop: Loop) -> Matrix | None:
    """M = J - K of a linear loop in one mode; None where a slope is not rational."""
    (jacobian,) = jacobians_at_consensus(loop).modes
    if not jacobian.is_point:
        return None
    entries = linearisation(jacobian, loop.m)
    size = range(loop.size)
    return tuple(tuple(entries.get((a, b), Fraction(0)) for b in size) for a in size)


def most_steps(loop: Loop) -> int:
    """Steps in which a response may be followed."""
    columns = loop.size + (1 + _times(loop)) * sum(len(each[0]) for each in entries(loop))
    return min(MOST_STEPS, MOST_PRODUCTS // (loop.size**2 * columns))


def observer_peaks(loop: Loop, W: Matrix, *, step: Fraction, steps: int) -> Peaks | None:
    """The peak gains, the worst of all groups, for the gain W (q, m); None where they are not
    shown."""
    worst: dict[str, Any] = dict.fromkeys(INPUTS, Fraction(0))
    plant = _stated(loop)
    off = [Fraction(0)] * (loop.m if loop.estimated else 0)
    for channel in channels(loop, W):
        inputs = [channel.disturbance, channel.drift, channel.noise]
        found = peak_gains(channel.F, channel.C, inputs, step=step, steps=steps)
        if found is None:
            return None
        for row, (disturbance, drift, noise) in enumerate(found):
            gains = (disturbance, drift, noise + sum(map(abs, channel.at_once[row])))
            if row < channel.acting:
                for name, x in zip(INPUTS, gains, strict=True):
                    worst[name] = max(worst[name], x)
            else:
                sizes = (getattr(plant, name) for name in INPUTS)
                place = row - channel.acting
                off[place] = max(off[place], dot(tuple(sizes), gains))
    return Peaks(**worst, off=tuple(off), step=step, steps=steps)


def _stated(loop: Loop) -> Uncertainty:
    """What the problem states; of a difference of agents, what acts on both together."""
    table = loop.uncertainty or Uncertainty()
    if not loop.is_apart:
        return table
    return replace(table, disturbance=2 * table.disturbance, measurement=2 * table.measurement)


def _times(loop: Loop) -> int:
    """How often sines are integrated by parts."""
    return 2 if loop.bands else 0


def _by_parts(sizes: Sequence[Fraction], gains: Sequence[Fraction], low: Fraction) -> Fraction:
    """How much of a sine of frequency ``low`` or more a row passes on, as the module says."""
    best = gains[0]
    at_once = Fraction(0)
    for k in range(1, len(gains)) if low else ():
        at_once += sizes[k - 1] / low**k
        best = min(best, at_once + gains[k] / low**k)
    return best


@noun
class Load:
    """What acts on one agent in one mode besides its row: b_i, and eta_i s, what observers that do
    not know the errors of the weights pass on while N is at most s.  ``by_input`` is the part of
    b_i that the agent's own input adds."""

    mode: str
    agent: int
    row: Row
    constant: Fraction
    growing: Fraction
    by_input: Fraction

    @property
    def held(self) -> Row:
        """The row with what grows like s taken off its pull."""
        return replace(self.row, pull=self.row.pull - self.growing / self.row.own)


@noun(eq=False)
class Plant:
    """A loop under all that [uncertainty] states; ``peaks``: how far its observer passes that on,
    None without an exosystem.  ``room``: the part by which eta_i is taken larger."""

    loop: Loop
    peaks: Peaks | None
    room: Fraction = Fraction(0)

    @property
    def stated(self) -> Uncertainty:
        """What the problem states (``_stated``)."""
        return _stated(self.loop)

    @property
    def input(self) -> Fraction:
        """b = omega (1 + peak of W) + gamma (peak of I) and what is left of sines in bands: what
        acts on every agent in the end, by ``entries``."""
        return self.irregular + self.sines

    @property
    def irregular(self) -> Fraction:
        """The part of b that is of any shape."""
        plant = self.stated
        peaks = self.peaks
        if peaks is None:
            return plant.disturbance
        passed = plant.drift * peaks.drift
        if self.loop.estimated:
            passed += plant.measurement * peaks.measurement
            return plant.disturbance * peaks.disturbance + passed
        return plant.disturbance * (1 + peaks.disturbance) + passed

    @property
    def sines(self) -> Fraction:
        """The part that is left of sines whose frequencies lie in bands."""
        return sum(self.sines_by_band(), Fraction(0))

    def sines_by_band(self) -> list[Fraction]:
        """The same of every band."""
        acting = -self.loop.m if self.loop.estimated else None
        return [max(rows[:acting]) for rows in self._left_by_row()]

    @property
    def off(self) -> Vector:
        """How far states end from their estimates (m,), which errors are those of; 0 where they are
        those of states."""
        m = self.loop.m
        off = (Fraction(0),) * m
        if self.loop.estimated and self.peaks is not None:
            parts = [self.peaks.off or off, *(rows[-m:] for rows in self._left_by_row())]
            off = tuple(sum(each, Fraction(0)) for each in zip(*parts, strict=True))
        return off

    def _left_by_row(self) -> list[Vector]:
        """What observers leave of the sines of every band, by row of its gains."""
        if self.peaks is None:
            return []
        # Those of two agents may be in opposite phases.
        double = 2 if self.loop.is_apart else 1
        bands = zip(self.loop.bands, self.peaks.bands, strict=True)
        return [tuple(double * band.amplitude * sum(row) for row in gains) for band, gains in bands]

    def load_in(self, T: Matrix) -> Vector:
        """|T B| b by agent and component of z = T e, (n m,): what acts on every agent."""
        b = self.input
        acts = (multiply(T, each) for each in entries(self.loop))
        return tuple(b * sum(map(abs, row)) for each in acts for row in each)

    def ends(self, claim: Accuracy) -> Iterator[list[Fraction]]:
        """What the last stage leaves of the error of every agent, by component."""
        last = claim.stages[-1]
        if claim.T is None:
            return ([last.level * x] for x in last.v)
        sizes = error_sizes(claim.T, tuple(last.v))
        off = self.off
        return ([last.level * x + y for x, y in zip(each, off, strict=True)] for each in sizes)

    def left_in(self, ball: arcs.ArcWise) -> Fraction:
        """The level to which V falls in a ball although b_i acts.  Raises: UndefinedError."""
        loop = self.loop
        # A box that holds it says how steep what passes noise on is.
        v = tuple(discs.close_root(ball.level / d) for d in ball.d)
        box = Level(v=v, alpha=ball.rate, level=Fraction(1), rho=Fraction(1))
        if loop.drift is not None:
            acts = self.load_in(identity(loop.m))
        else:
            acts = tuple(b for b in self.largest(box) for _ in range(loop.m))
        squares = (ball.d[k // loop.m] * b * b for k, b in enumerate(acts))
        return sum(squares, Fraction(0)) / ball.rate**2

    def largest(self, stage: Level) -> list[Fraction]:
        """The largest b_i of every agent.  Raises: as ``loads``."""
        found = [Fraction(0)] * self.loop.n
        for load in self.loads(stage):
            found[load.agent] = max(found[load.agent], load.constant)
        return found

    def response_bounds(self, response: Response) -> dict[str, Vector] | None:
        """Label -> what is left of every |e_ic|: b times the peak gains of a linear loop in one
        mode; None where they are not shown with these steps."""
        loop = self.loop
        M = loop_matrix(loop)
        if M is None or response.steps > most_steps(loop):
            return None
        turned = [block_diagonal(entries(loop))]
        for _ in range(_times(loop)):
            turned.append(multiply(M, turned[-1]))
        found = peak_gains(M, identity(len(M)), turned, step=response.step, steps=response.steps)
        if found is None:
            return None
        m = loop.m
        off = self.off * loop.n
        ends = []
        for place, gains in enumerate(found):
            sizes = [sum(map(abs, each[place]), Fraction(0)) for each in turned]
            end = off[place] + self.irregular * gains[0]
            for band, left in zip(loop.bands, self.sines_by_band(), strict=True):
                end += left * _by_parts(sizes, gains, band.low)
            ends.append(end)
        return {label: tuple(ends[i * m : (i + 1) * m]) for i, label in enumerate(loop.labels)}

    def loads(self, stage: Level) -> Iterator[Load]:
        """Every row of a stage with what acts besides.  What an observer passes on it has seen in
        any mode: there the largest over the modes counts.  Raises: UndefinedError where a slope has
        no bound as far out."""
        loop = self.loop
        plant = self.stated
        peaks = self.peaks
        errors = stated_errors(loop)
        noise = plant.measurement
        # Of the difference of two measured states, which a coupling acts on.
        heard = noise if loop.is_apart else 2 * noise
        slopes = _Slopes(loop, stage, heard)
        passed = unknown = Fraction(0)
        by_model = self.input - plant.disturbance
        if peaks is not None:
            passed = peaks.disturbance
            by_model += noise * peaks.measurement
        # Observers with other weights take sum dw h for a disturbance, which W passes on.
        if not plant.known_to_agents:
            unknown = errors.weights * passed * (1 + self.room)
        heard *= 1 + (max(errors) if loop.fixed else errors.weights)
        tied = tied_sizes(loop) or {}
        for agent in range(loop.n):
            steepest = {mode: slopes.at_noise(mode, agent) for mode in loop.modes}
            eta = pinned = Fraction(0)
            if unknown:
                eta = unknown * max(slopes.in_box(mode, agent) for mode in loop.modes)
            if agent in loop.pulls.gains:
                pinned = (1 + errors.gains) * row_norm(loop.pulls.gains[agent])
            b = by_model + noise * pinned + heard * passed * max(steepest.values())
            for mode, steep in steepest.items():
                row = _row_of(loop, stage, mode, agent, errors)
                own = b + plant.disturbance + heard * steep
                acts = b + noise * tied.get(agent, Fraction(0))
                yield Load(
                    mode=mode, agent=agent, row=row, constant=own, growing=eta, by_input=acts
                )

    def not_shrinking(self, stage: Level) -> str | None:
        """Which row of a stage is not proved for all s in [level, rho], in words; None if all
        are."""
        loop = self.loop
        try:
            profiles = coupling_profiles(loop, stage.v, rho=stage.rho)
            holds = cache(partial(_row_holds, profiles=profiles, stage=stage))
            for load in self.loads(stage):
                row = load.held
                for face, name in FACES.items():
                    if not holds(row, load.constant, face):
                        return (
                            f"the {name} row of agent {loop.labels[load.agent]} in mode "
                            f"{load.mode} is not shown for all s from {float(stage.level):.6g} on."
                        )
        except UndefinedError as error:
            return f"does not apply: {error}"
        return None


def _row_of(loop: Loop, stage: Level, mode: str, agent: int, errors: Errors = EXACT) -> Row:
    ((row, _),) = rows(loop, stage.v, modes=[mode], agents=[agent], errors=errors)
    return row


class _Slopes:
    """How steep what an agent hears is, in the box of a stage.  Agents hear others by few
    functions, so each function and reach is bounded once."""

    def __init__(self, loop: Loop, stage: Level, noise: Fraction) -> None:
        self.loop = loop
        self.stage = stage
        self.noise = noise
        self.curves = coupling_profiles(loop, stage.v, rho=stage.rho)
        self.steepest = cache(self._steepest)
        self.secant = cache(self._secant)
        self.heard = cache(self._heard)

    def at_noise(self, mode: str, agent: int) -> Fraction:
        """A bound of sum w |h'|, as far as noise takes arguments; 0 without noise."""
        total = Fraction(0)
        for term in self.heard(mode, agent) if self.noise else ():
            total += term.weight * self.steepest(term.coupling, term.reach)
        return total

    def in_box(self, mode: str, agent: int) -> Fraction:
        """A bound of sum w |h| / s."""
        total = Fraction(0)
        for term in self.heard(mode, agent):
            total += term.weight * term.reach * self.secant(term.coupling, term.reach)
        return total

    def _heard(self, mode: str, agent: int) -> tuple[Term, ...]:
        """The arcs of an agent as the file states them."""
        return _row_of(self.loop, self.stage, mode, agent).terms

    def _steepest(self, coupling: int, reach: Fraction) -> Fraction:
        """A bound of |h'| as far as noise takes an argument."""
        Y = ZERO
        if self.stage.rho is not None:
            Y = Interval(Fraction(-1), Fraction(1)) * (self.stage.rho * reach + self.noise)
        return jet(self.curves[coupling].curve, Y).slope.magnitude

    def _secant(self, coupling: int, reach: Fraction) -> Fraction:
        """A bound of |h(y)/y| in the box."""
        if self.stage.rho is None:
            return self.steepest(coupling, reach)
        far = self.stage.rho * reach
        return secant_range(self.curves[coupling].curve, Interval(-far, far)).magnitude


def _row_holds(
    row: Row, load: Fraction, face: int, *, profiles: tuple[Profile, ...], stage: Level
) -> bool:
    on_face = FaceRow(row, face, profiles)
    if stage.rho is None:
        limit = (row.pull - stage.alpha) * row.own
        return on_face.linear_bound() + load / stage.level <= limit
    verdict, _ = on_face.decide(alpha=stage.alpha, rho=stage.rho, start=stage.level, load=load)
    return verdict is Verdict.PROVED


def accuracy_check(case: Case, claim: Accuracy, starts: Domain) -> Check:
    """Decide ``claim`` for these starts: PROVED or UNDECIDED."""
    check = Check(
        id=ID,
        verdict=Verdict.PROVED,
        domain=starts,
        claim=claim,
        reason=_told(case.loop, claim, starts),
    )
    return check.unless(confirm(check, case), case.domain)


def _told(loop: Loop, claim: Accuracy, domain: Domain) -> str:
    """The final bounds in words, agents with the same bound together."""
    agents: dict[Vector, list[str]] = {}
    for label, bounds in claim.listed.items():
        rounded = tuple(rounded_up(x, digits=4) for x in bounds)
        agents.setdefault(rounded, []).append(label)
    told = []
    node = "pair" if are_pairs(loop) else "agent"
    for ends, who in sorted(agents.items()):
        names = ", ".join(who[:_SHOWN])
        if len(who) > _SHOWN:
            names += " and others"
        shown = " and ".join(f"{float(x):.6g}" for x in ends)
        told.append(f"{shown} ({node}{'s' if len(who) > 1 else ''} {names})")
    if len(told) > _SHOWN:
        told[1:-1] = ["..."]
    starts = "every start"
    if isinstance(domain, Around):
        starts += f" with |e_i| <= {domain.radius:.6g}"
        starts += f" and |eps_i| <= {domain.disturbance:.6g}" if loop.groups else ""
    sizes = {name: getattr(loop.uncertainty, name) for name in INPUTS}
    acting = [f"{name} {float(x):.6g}" for name, x in sizes.items() if x]
    acts = (
        [f"whatever acts within the bounds of [uncertainty]: {', '.join(acting)}"] if acting else []
    )
    if loop.bands:
        acts.append(f"with {' and '.join(map(band_words, loop.bands))} in every disturbance")
    listed = ", ".join(told).replace(", ..., ", " ... ")
    each = "the components of |e_i|" if claim.by_component else "|e_i|"
    return f"{starts} ends with {each} <= {listed}, {', '.join(acts)}."


def confirm(check: Check, case: Case) -> str | None:
    """None if everything that a proved check of this topic claims is confirmed, else what is
    not."""
    loop = case.loop
    W = case.W
    claim = check.claim if isinstance(check.claim, Accuracy) else read_claim(check, loop, W)
    turned = claim.by_component or (bool(claim.balls) and loop.drift is not None)
    reason = obstacle(loop, W, turned=turned)
    if reason is not None:
        return reason
    if not check.is_proved or check.witness is not None or check.rate is not None:
        return "it can only be proved or undecided, and has no witness and no rate"
    if loop.uncertainty is None:
        return "the problem has no [uncertainty]"
    if claim.response is None and not 1 <= len(claim.balls or claim.stages) <= MOST_STAGES:
        return f"it needs between 1 and {MOST_STAGES} stages"
    wrong = None
    if claim.peaks is not None and W is not None:
        wrong = wrong_peaks(loop, W, claim.peaks)
    plant = Plant(loop=loop, peaks=claim.peaks)
    if claim.response is not None:
        return wrong or _wrong_response(check, case, claim, plant, claim.response)
    if claim.balls:
        return wrong or _wrong_balls(check, case, claim, plant)
    return wrong or _wrong_starts(check, case, claim) or _wrong_stages(claim, plant)


def wrong_peaks(loop: Loop, W: Matrix, peaks: Peaks) -> str | None:
    """None if the observer passes on no more than these peak gains say."""
    if len(peaks.bands) != len(loop.bands):
        return "it needs gains for every band"
    for band, gains in zip(loop.bands, peaks.bands, strict=True):
        if not are_bounded(loop, W, band, gains):
            return f"more may be left of {band_words(band)}."
    if not takes_integrals(loop):
        return None
    own = observer_peaks(loop, W, step=peaks.step, steps=peaks.steps)
    if own is None:
        return "the peak gains of the observer are not shown with these steps."
    # A claim may be larger than what is shown here, never smaller.
    for name in INPUTS:
        claimed = getattr(peaks, name)
        if getattr(own, name) > claimed:
            return f"the peak gain of {name} is not shown to be at most {float(claimed):.6g}."
    if len(peaks.off) != len(own.off) or _are_below(peaks.off, own.off):
        return "how far states end from their estimates is not shown."
    return None


def _wrong_stages(claim: Accuracy, plant: Plant) -> str | None:
    """None if the stages hand over to each other, all shrink, and the last leaves no more than the
    bounds."""
    # Where one stage ends, strictly inside, the next one begins.
    for before, stage in pairwise(claim.stages):
        if stage.rho is None:
            return _NO_HANDOVER
        sizes = zip(before.v, stage.v, strict=True)
        if any(before.level * x >= stage.rho * y for x, y in sizes):
            return _NO_HANDOVER
    for bounds, ends in zip(claim.listed.values(), plant.ends(claim), strict=True):
        if _are_below(bounds, ends):
            return "a bound is below that of the last stage."
    for stage in claim.stages:
        if claim.T is None:
            wrong = plant.not_shrinking(stage)
        else:
            at_level = tuple(b / stage.level for b in plant.load_in(claim.T))
            wrong = rows_obstacle(plant.loop, claim.in_stage(stage), load=at_level)
        if wrong is not None:
            return wrong
    return None


def _are_below(bounds: Vector, ends: Sequence[Fraction]) -> bool:
    """Whether a bound is smaller than what it has to bound."""
    return any(bound < end for bound, end in zip(bounds, ends, strict=True))


def _wrong_response(
    check: Check, case: Case, claim: Accuracy, plant: Plant, response: Response
) -> str | None:
    """None if a linear loop is shown to pass on no more than the bounds."""
    loop = case.loop
    if claim.stages or claim.T is not None or claim.error is not None:
        return "beside a response there are no stages and no coordinates."
    if loop.groups and claim.peaks is None:
        return "with an [exosystem] it needs peaks."
    if not check.domain == EVERYWHERE == case.domain:
        return "the bounds of a response are global."
    reason = response_obstacle(loop)
    if reason is not None:
        return reason
    if not plant.input > 0:
        return "nothing acts on the loop."
    found = plant.response_bounds(response)
    if found is None:
        return "the response of the loop is not shown to decay in these steps."
    for label, ends in found.items():
        if _are_below(claim.listed[label], ends):
            return f"a bound of agent {label} is below what the response of the loop reaches."
    return None


def _wrong_balls(check: Check, case: Case, claim: Accuracy, plant: Plant) -> str | None:
    """None if the first ball holds all starts, and V falls in each until the next one holds it, and
    in the last down to the bounds."""
    loop = case.loop
    starts = check.domain
    if loop.estimated or not is_felt_by_arcs_alone(loop):
        return "balls know no errors of weights in estimates, and no estimates of outputs."
    wrong = discs.obstacle(loop, case.W)
    if wrong is not None:
        return wrong
    if not isinstance(starts, Box) or not discs.holds_starts(loop, claim.balls[0], starts):
        return "the box of starts is not inside the first ball."
    for ball, after in pairwise((*claim.balls, claim.balls[-1])):
        wrong = discs.why_not(loop, ball)
        if wrong is not None:
            return wrong
        try:
            left = plant.left_in(ball)
        except UndefinedError as error:
            return f"does not apply: {error}"
        if tuple(ball.d) != tuple(after.d) or left >= min(ball.level, after.level):
            return "a ball does not hold what the one before leaves of V."
    for (bound,), d in zip(claim.listed.values(), ball.d, strict=True):
        if bound <= 0 or bound**2 * d < left:
            return "a bound is below what the last ball leaves."
    return None


def _wrong_starts(check: Check, case: Case, claim: Accuracy) -> str | None:
    """Whether the first stage holds all starts of the domain until their estimates are right."""
    first = claim.stages[0]
    if first.rho is None:
        return not_all_starts(check, case, None)
    box = claim.in_stage(first)
    # The level is reached with errors of estimates that may still be as large as at the start.
    least = first.level / box.spread

    def holds(radius: Fraction, disturbance: Fraction) -> bool:
        return covers(box, radius=max(radius, least), disturbance=disturbance)

    return observer_obstacle(case.loop, case.W, box) or not_all_starts(check, case, holds)
