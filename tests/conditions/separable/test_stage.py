"""The max-separable stage of ``certify``: the box asked for, the largest one where that fails, and
what is said."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from certified import certified, confirmed
from networks import cycle, listening, pair

from dobc_design import Exosystem, Observer, Problem, Verdict, certify
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.overall import decide_overall
from dobc_design.certification.recheck import recheck
from dobc_design.conditions.check import Values
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET
from dobc_design.conditions.separable.claim import separable_from_json
from dobc_design.conditions.separable.propose import Cover, flatter_plans
from dobc_design.conditions.separable.stage import separable_stage
from dobc_design.conditions.separable.timing import largest_period
from dobc_design.loop.make import loop_of
from dobc_design.problem.exosystems import harmonics

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
TIMED_ARCS = "dobc_design.conditions.separable.stage.TIMED_ARCS"
OBSERVED = [["16/5"], ["12/5"]]  # of a sine of 2 rad/s


def side(radius, disturbance=None):
    region = {"initial_states": [f"-{radius}", f"{radius}"]}
    if disturbance is not None:
        region["initial_disturbance"] = disturbance
    return region


def ids(certificate) -> set[str]:
    return {check.id for check in certificate.checks}


def stage(problem: Problem, *, W=None, domain=NEAR_TARGET, everything=False):
    """The checks of this stage alone, each confirmed after a way through JSON."""
    asked = read_region(loop_of(problem), W, domain=domain, everything=everything)
    found = separable_stage(asked, str)
    for check in found:
        answer = confirmed(check, problem, W=W, domain=domain, beside=found[0])
        assert answer is None
    return {check.id: check for check in found}


def test_the_rate_of_the_papers_examples_is_that_of_the_theory():
    """paper-switching 0.0301 for all four modes; single mode Ga 0.216 at rho = 4, less at the rho
    that eps needs."""
    assert certified("paper-switching").rate == pytest.approx(0.0301, rel=0.01)
    assert 0.19 < certified("paper-fixed").rate < 0.216


def test_without_a_region_nothing_regional_is_examined_and_a_box_answers_no_question():
    """The verdict is about the consensus; with everything wanted, boxes up to 10 are tried."""
    watched = {"exosystem": harmonics([2]), "observer": Observer(W=OBSERVED)}
    simulation = {"xi0": ["0.3", "0.4"]}
    problem = cycle(2, simulation=simulation, **watched)
    W = problem.observer.W
    certificate = certify(problem)
    assert not ids(certificate) & {"max-separable", "lure"}
    check = stage(problem, W=W, everything=True)["max-separable"]
    assert check.domain.radius == 10.0
    # |xi(0)| of its simulation
    assert check.domain.disturbance == pytest.approx(0.5, abs=1e-5)
    assert "No region is asked for; boxes up to 10 were tried" in check.reason
    faster = replace(check, rate=9.0)
    whole = decide_overall(loop_of(problem), [*certificate.checks, faster], W)
    assert whole.covered_by == "theorem1-weighted"


def test_a_region_that_the_theorem_covers_needs_no_more():
    """Linear couplings: Lemma 1 is global."""
    arcs = [[1, 2], [2, 1]]
    problem = listening(arcs, "2*y", gains=5, region=side(4))
    certificate = certify(problem)
    assert ids(certificate) == {"reachability", "lemma1", "theorem1-weighted", "tolerance"}
    check = stage(problem, domain=EVERYWHERE, everything=True)["max-separable"]
    assert check.verdict == PROVED
    assert check.domain == EVERYWHERE
    assert check.exact["rho"] is None


def test_linear_couplings_are_proved_from_everywhere_where_v_is_not_quadratic():
    """A star with a far heavier arc: e'e grows, e'De and max |e_i|/v_i fall, however large the
    region."""
    arcs = [[2, 1, 50]]
    problem = listening(arcs, "y", n=2, gains={1: 1}, target=0, region=side("1e9"))
    certificate = certify(problem)
    assert certificate.check("lemma1").verdict is REFUTED
    assert certificate.verdict == PROVED
    assert certificate.covered_by == "theorem1-weighted"
    assert stage(problem, domain=EVERYWHERE)["max-separable"].verdict is PROVED
    assert recheck(certificate_bytes(certificate.claims), problem).holds


def test_where_the_box_asked_for_is_too_large_the_largest_one_is_proved(monkeypatch):
    """sin, one pin: pi/2 is the limit, and the whole stays undecided with both numbers in the
    sentence; delays and sampling are left out for more than TIMED_ARCS arcs."""
    monkeypatch.setattr(TIMED_ARCS, 1)
    problem = cycle(2, h="sin(y)", region=side(4))
    found = stage(problem)
    check = found["max-separable"]
    assert check.verdict is PROVED
    assert 1.56 < check.domain.radius < np.pi / 2
    assert "the region asks for 4: beyond, no v is found" in check.reason
    whole = decide_overall(loop_of(problem), [check], None)
    assert whole.verdict is UNDECIDED
    assert f"|e_i| <= {check.domain.radius}" in whole.reason
    assert "the region asks for |e_i| <= 4" in whole.reason
    for id in ("delay", "sampling"):
        assert found[id].verdict is UNDECIDED
        assert "the network has 2 arcs" in found[id].reason


@pytest.mark.slow
def test_the_largest_box_leaves_room_for_the_disturbance_and_none_is_found_where_there_is_none():
    exosystem = Exosystem(A=[[0]], C=[[1]])
    steady = cycle(3, h="sin(y)", exosystem=exosystem)

    def found(disturbance):
        problem = steady.replace(region=side(4, disturbance))
        W = ((Fraction(2),),)
        return stage(problem, W=W)

    less = found("1/10")["max-separable"].domain.radius
    more = found(1)["max-separable"].domain.radius
    assert more < less < 1.55
    nothing = found(1000)
    assert set(nothing) == {"max-separable"}
    check = nothing["max-separable"]
    assert check.verdict is UNDECIDED
    assert "a smaller initial disturbance may help" in check.reason


def test_agents_that_no_v_holds_are_refuted_and_the_whole_is_not():
    """Each mode reaches everybody; 3 hears 2 in one and 2 hears 3 in the other."""
    modes = {"A": [[2, 1], [3, 2]], "B": [[3, 1], [2, 3]]}
    problem = listening(modes, "tanh(y)", n=3, gains={1: 3}, region=side(1))
    check = stage(problem)["max-separable"]
    assert check.verdict == REFUTED
    assert check.witness.labels == ("2", "3")
    whole = decide_overall(loop_of(problem), [check], None)
    assert whole.verdict is UNDECIDED
    assert "2 in B, 3 in A" in whole.reason


VECTORS = Problem(
    network=cycle(2).network, coupling=["y1 + y2**2", "y2"], gains=1, target=[0, 0], region=side(1)
)
BLIND = cycle(3, exosystem=Exosystem(A=[[0]], C=[[0]]), region=side(1, 1))


SAID = [
    (VECTORS, "every start with"),
    (BLIND, "does not apply: there is no obs"),
    (pair("y**3"), "no v is found"),
]


@pytest.mark.parametrize(("problem", "said"), SAID)
def test_what_does_not_apply_says_so(problem, said):
    assert stage(problem)["max-separable"].reason.startswith(said)


FAR = [
    ("exp(y) - 1 + y", 900, PROVED),
    ("tanh(y)", "1e200", UNDECIDED),
    ("log(1 + y)", 3, PROVED),
    ("sin(y)", "1e6", UNDECIDED),
    ("tanh(y)", "1e-300", PROVED),
]


@pytest.mark.slow
@pytest.mark.parametrize(("h", "box", "verdict"), FAR)
def test_far_out_boxes_end_in_an_answer(h, box, verdict):
    """Couplings overflow, end or turn thousands of times there; nothing is claimed that is not
    confirmed."""
    problem = Problem(network=cycle(2).network, coupling=h, gains={1: 1}, region=side(box))
    assert stage(problem)["max-separable"].verdict is verdict


def test_claims_keep_a_part_in_hand_for_a_second_program():
    """alpha, the delayed rate and the period all hold with a little more."""
    problem = cycle(gains=5, region=side(2))
    checks = stage(problem)
    alpha = ("max-separable", "alpha", "1.00009")
    rate = ("delay", "rate", "1.00009")
    more = [alpha, rate, ("sampling", "period", "1.0009")]
    for id, name, factor in more:
        exact = dict(checks[id].exact)
        exact[name] = str(Fraction(exact[name]) * Fraction(factor))
        more_claimed = replace(checks[id], claim=Values(exact))
        assert confirmed(more_claimed, problem, beside=checks["max-separable"]) is None


def test_where_a_coupling_is_steep_sampling_has_flatter_weights_of_its_own():
    """exp(y) - 1 + y on |e| <= 4: v next to 1 allow hundreds of times the period of the fastest v,
    and at four times that one step from opposite corners leaves the proved set; tanh keeps the v of
    max-separable."""
    problem = cycle(4, gains={1: 5}, region=side(4))
    checks = stage(problem)
    sampling = checks["sampling"].exact
    loop = loop_of(problem)
    fastest = separable_from_json(checks["max-separable"].exact, loop)
    own = separable_from_json(sampling["certificate"], loop)
    period = Fraction(sampling["period"])
    factor = Fraction(sampling["factor"])
    assert period > 20 * largest_period(loop, fastest).period
    assert own.alpha < fastest.alpha
    v = np.array(own.v, dtype=float)
    k = np.array([5.0, 0, 0, 0])
    h = problem.coupling.numpy_function()
    rng = np.random.default_rng(0)
    e = rng.uniform(-1, 1, (2000, 4))
    e[:1000] = np.sign(e[:1000])
    e *= float(own.rho) * v
    differences = np.roll(e, -1, axis=1) - e
    pulls = h(differences[..., None])[..., 0]
    change = pulls - k * e

    def largest(time: float) -> np.ndarray:
        """N after a held step."""
        moved = np.abs(e + time * change) / v
        return np.max(moved, axis=1)

    allowed = float(factor) * largest(0) + 1e-12
    assert np.all(largest(float(period)) <= allowed)
    found = np.max(largest(4 * float(period)))
    assert found > float(own.rho)
    calm = cycle(4, gains={1: 5}, region=side(4), h="tanh(y)")
    assert "certificate" not in stage(calm)["sampling"].exact


def ring(n: int, h: str, *, step: int, k: int, reach) -> Problem:
    """Both neighbours are heard, every so many agents one is pinned."""
    arcs = []
    for i in range(n):
        next_agent = (i + 1) % n + 1
        forward = [i + 1, next_agent]
        backward = [i + 1, (i - 1) % n + 1]
        arcs += [forward, backward]
    gains = dict.fromkeys(range(1, n + 1, step), k)
    return listening(arcs, h, n=n, gains=gains, region=side(reach))


@pytest.mark.slow
def test_a_large_network_is_certified_and_confirmed_and_v_travels_as_doubles():
    problem = ring(3000, "tanh(y)", step=7, k=5, reach=2)
    certificate = certify(problem)
    assert certificate.verdict == PROVED
    assert certificate.covered_by == "max-separable"
    assert set(certificate.check("max-separable").exact["v"]) == {"float64"}
    found = [certificate.check(id).verdict for id in ("delay", "sampling")]
    assert found == [PROVED, PROVED]
    assert recheck(certificate_bytes(certificate.claims), problem).holds


def test_a_chain_whose_fastest_v_is_too_steep_is_proved_with_a_flatter_one():
    """Five agents in a row, the first pinned: a common v exists for every radius (theory, section
    5, existence)."""
    arcs = [[i + 1, i] for i in range(1, 5)]
    problem = listening(arcs, "exp(y) - 1 + y", n=5, gains={1: 2}, region=side(1))
    cover = Cover(loop=loop_of(problem), radius=Fraction(1))
    steep = cover.fastest()
    assert steep.v.max() > 1e5
    check = stage(problem)["max-separable"]
    assert check.verdict == PROVED
    assert check.domain.radius == 1.0
    largest_v = max(map(Fraction, check.exact["v"]))
    allowed = steep.v.max() / 10
    assert largest_v < allowed
    assert check.rate > steep.rate / 3
    # a flat v is not flattened
    loop = loop_of(cycle(4, gains=5))
    flat = Cover(loop=loop, radius=Fraction(1)).fastest()
    assert list(flatter_plans(loop, flat)) == []


def test_large_networks_get_no_delay_and_no_sampling_period(monkeypatch):
    """Up to a number of arcs they are examined, and beyond it is said that they are not."""
    problem = pair("tanh(y)").replace(region=side(1))
    assert stage(problem)["delay"].verdict is PROVED
    monkeypatch.setattr(TIMED_ARCS, 0)
    found = stage(problem)
    assert found["max-separable"].verdict is PROVED
    for check in (found["delay"], found["sampling"]):
        assert check.verdict is UNDECIDED
        assert check.reason.startswith(
            "left out: the network has 1 arcs; delays and sampling are examined up to 0."
        )
