"""What the tables of a problem file say, each in the rest of a sentence.

Formatting only: nothing is computed or decided here, so that a Problem can show itself with these
words.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from dobc_design.coupling.coupling import Coupling
from dobc_design.exact.matrix import Matrix
from dobc_design.exact.number import decimal_text
from dobc_design.exact.reading import Names, counted, is_scalar_matrix, some

from .bands import band_words
from .groups import Observer
from .region import Region
from .simulation import Simulation
from .switching import Switching
from .uncertainty import Actuators, Uncertainty

LISTED = 30  # agents, modes, limits, ... in one sentence
MOST_COUPLINGS = 8  # beside the default one, and arcs with each of them


def in_units(texts: Sequence[str], units: Names) -> list[str]:
    """What is said of every state component, with its unit; ``units`` are empty or as many."""
    return [" ".join(each) for each in zip(texts, units, strict=True)] if units else list(texts)


def vector_text(values: Sequence[Any], units: Names = ()) -> str:
    """A vector: a number, or (1, 2), with the units of its components."""
    texts = in_units([decimal_text(value) for value in values], units)
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def gain_text(gain: Matrix) -> str:
    """A gain: a number, a row [1 2], or "matrix"."""
    if is_scalar_matrix(gain):
        return decimal_text(gain[0][0])
    if len(gain) == 1:
        return f"[{' '.join(map(decimal_text, gain[0]))}]"
    return "matrix"


def exception_words(exceptions: Mapping[tuple[int, int], Coupling], labels: Names) -> str:
    """Which arcs have a coupling of their own, coupling by coupling."""
    # By coupling and not by arc: a thousand arcs may share one.
    arcs = defaultdict(list)
    for (listener, speaker), coupling in exceptions.items():
        arcs[coupling].append(f"{labels[listener]} listens to {labels[speaker]}")
    said = []
    for coupling in list(arcs)[:MOST_COUPLINGS]:
        h = "; ".join(coupling.texts)
        said.append(f"h = {h} where {some(arcs[coupling], MOST_COUPLINGS)}")
    if len(arcs) > len(said):
        said.append(f"and {len(arcs) - len(said)} more")
    return "; ".join(said)


def offset_words(offsets: Mapping[int, Sequence[Any]], labels: Names, units: Names) -> str:
    """Where the agents of a formation go, from the target."""
    return some([f"{labels[i]}: {vector_text(x, units)}" for i, x in offsets.items()], LISTED)


def observer_words(observer: Observer) -> str:
    """Whether an observer gain is given, or what is asked of a designed one."""
    if observer.W is not None:
        return "given. P: given, will be tested" if observer.P else "given"
    if observer.rate is None:
        return "to be designed"
    return f"to be designed for a decay rate of {decimal_text(observer.rate)} 1/s"


def region_words(region: Region, units: Names) -> str:
    """The starts that a certificate has to cover."""
    pairs = [f"[{decimal_text(lo)}, {decimal_text(hi)}]" for lo, hi in region.initial_states]
    said = f"initial states in {', '.join(in_units(pairs, units))}"
    if region.initial_disturbance is None:
        return said
    return f"{said}, estimation error at most {decimal_text(region.initial_disturbance)}"


_SATURATED = (
    "; inputs saturate there, and the proof counts it: an input is the pin less the estimate, and "
    "observers are fed what was applied (couplings that pass through the actuators are another "
    "model)"
)


def limit_words(table: Actuators, agents: int) -> str:
    """The limits of the inputs that [actuators] states; ``agents``: how many there are."""
    if table.limit is None:
        return "inputs have no limit"
    if not isinstance(table.limit, Mapping):
        said = f"|u_i| is at most {decimal_text(table.limit)} by component, for every agent"
        return f"{said}{_SATURATED}" if table.saturates else said
    limits = [f"{label}: {decimal_text(limit)}" for label, limit in table.limit.items()]
    said = f"|u_i| by component is at most {some(limits, LISTED)}"
    if len(table.limit) < agents:
        said += "; the inputs of the other agents have no limit"
    return f"{said}{_SATURATED}" if table.saturates else said


def amplitude_words(table: Actuators, simulation: Simulation) -> str:
    """How large a disturbance may be."""
    if table.amplitude is not None:
        return f"|d_i| is at most {decimal_text(table.amplitude)} by component"
    if simulation.xi0 is not None:
        return "|d_i| is as large as from simulation.xi0"
    return "how large |d_i| may be is not said"


def uncertainty_words(table: Uncertainty) -> str:
    """What [uncertainty] says: how far the plant may be from the model."""
    said = []
    for error, what in ((table.weights, "every arc weight"), (table.gains, "every gain")):
        if error:
            said.append(f"{what} may be {decimal_text(100 * error)} % off")
    for bound, what in (
        (table.disturbance, "a disturbance that no exosystem generates, |w_i|,"),
        (table.drift, "|xi' - A xi|"),
        (table.measurement, "the noise of every measured state"),
    ):
        if bound:
            said.append(f"{what} is at most {decimal_text(bound)}")
    said += [f"the disturbance of every agent has {band_words(band)}" for band in table.bands or ()]
    if not said:
        said.append("nothing is uncertain")
    if not table.known_to_agents:
        said.append("the observers do not know the true weights")
    return "; ".join(said)


def simulation_words(table: Simulation, unit: str) -> str:
    """What [simulation] says, and what runs do without it: how long, from which seed, from
    where."""
    said = [f"{decimal_text(table.t_final)} {unit}, seed {table.seed}"]
    if table.x0 is not None:
        where = "every agent at its own"
        if len(table.x0) == 1:
            where = f"all agents at {vector_text(table.x0[0])}"
        said.append(f"they start at x0, {where}")
    if table.xi0 is not None:
        where = "one for every agent"
        if len(table.xi0) == 1:
            where = f"{vector_text(table.xi0[0])} for all agents"
        said.append(f"the exosystem starts at xi0, {where}")
    return "; ".join(said)


def guarantee_words(switching: Switching | None, modes: Names) -> str:
    """What proofs may assume of the signal; "" for one mode, where there is nothing to say."""
    guarantee = None if switching is None else switching.guarantee
    if guarantee == "sequence":
        return "this order and these times"
    if guarantee == "markov":
        return "this Markov chain, with any first mode"
    if switching is not None and guarantee == "dwell" and switching.dwell is not None:
        return f"a mode lasts {lasting(switching.dwell, switching.longest)}"
    if len(modes) > 1:
        return "nothing of the signal (any mode, for any time)"
    return ""


def lasting(dwell: Fraction, longest: Fraction | None) -> str:
    """How long a mode lasts: "at least 1 s and at most 2 s"."""
    if dwell == longest:
        return f"exactly {float(dwell):.6g} s"
    least = f"at least {float(dwell):.6g} s"
    return least if longest is None else f"{least} and at most {float(longest):.6g} s"


def switching_words(own: Switching, modes: Names) -> str:
    """What [switching] asks of simulations."""
    dwell = None if own.dwell is None else f"{decimal_text(own.dwell)} s"
    if own.signal == "mobile":
        return (
            f"mobile, {_nearness(own)}; the arcs of the modes are not used, and proofs are about "
            "those arcs"
        )
    if own.schedule is not None:
        return _schedule_words(own)
    if own.signal == "periodic":
        turns = ", ".join((own.sequence or tuple(modes))[:LISTED])
        pace = "dwell not given"
        if own.period is not None:
            pace = f"a round in {decimal_text(own.period)} s"
        elif dwell is not None:
            pace = dwell
        each = "" if dwell is None else " each"
        return f"periodic, {turns} in turn, {pace}{each}"
    if own.generator is not None:
        return _stays(own.generator, modes)
    if own.signal == "markov":
        mean = dwell or "a length not given"
        return f"a Markov chain, stays of {mean} on average, other modes equally likely"
    when = f"every {dwell}" if dwell else "after a dwell time that is not given"
    return f"random, a mode drawn anew {when}"


def _schedule_words(own: Switching) -> str:
    """Which mode is active from when on."""
    schedule = own.schedule or ()
    begins = [f"{mode} from {decimal_text(time)} s" for time, mode in schedule[:LISTED]]
    if len(schedule) > LISTED:
        begins.append("...")
    said = ", ".join(begins)
    if own.period is None:
        return said
    return f"{said}, and so again every {decimal_text(own.period)} s"


def _stays(generator: Matrix, modes: Names) -> str:
    """How long a Markov chain stays in each mode, on average."""
    stays = []
    for k, (mode, row) in enumerate(zip(modes, generator, strict=True)):
        stays.append(f"{mode} for ever" if row[k] == 0 else f"{mode} {decimal_text(-1 / row[k])} s")
    return f"a Markov chain, whose stays last on average: {some(stays, LISTED)}"


def _nearness(own: Switching) -> str:
    """Whom an agent hears when agents move."""
    kept = ""
    if own.hysteresis:
        kept = f", with a hysteresis of {decimal_text(own.hysteresis)}"
    if own.radius is None:
        return f"an agent hears its {counted(own.neighbours or 1, 'nearest neighbour')}{kept}"
    return f"an agent hears everyone within {decimal_text(own.radius)} in the unit of x{kept}"
