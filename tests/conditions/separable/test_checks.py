"""Regional checks: what is claimed, confirmed and refused.  Every true claim has twins that just
fail."""

import base64
from dataclasses import replace
from fractions import Fraction

import certified
import numpy as np
import pytest
from networks import fractions, listening, pair

from dobc_design import Exosystem, Observer, Problem, Verdict
from dobc_design.conditions.case import Case
from dobc_design.conditions.check import Values
from dobc_design.conditions.coverage import read_region
from dobc_design.conditions.domain import EVERYWHERE, NEAR_TARGET, Box, domain_from_json
from dobc_design.conditions.numbers import vector_from_json, vector_to_json
from dobc_design.conditions.separable.checks import (
    delay_check,
    max_separable_check,
    sampling_check,
    stuck_check,
)
from dobc_design.conditions.separable.claim import (
    DelayBound,
    ErrorBound,
    Separable,
    pins_that_order,
    separable_from_json,
    stuck_agents,
)
from dobc_design.conditions.separable.coordinates import enclosed_ranges
from dobc_design.loop.make import loop_of

F = Fraction
PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED

# Two agents, h = y + y^3, k = 5 on the first, v = (1, 3/2): agent 2 has (v_2 - v_1)/v_2 + s^2 (v_2
# - v_1)^3/v_2, least at s -> 0: alpha = 1/3 whatever the radius.
CUBIC = pair("y + y**3")
V = fractions(1, "3/2")
CLAIM = Separable(v=V, alpha=F(1, 3), rho=F(2))
BOX = Box(2.0, 0.0)


def proved(claim=CLAIM, radius=2.0, problem=CUBIC, W=None, disturbance=0.0):
    loop = loop_of(problem)
    domain = EVERYWHERE if loop.is_linear else NEAR_TARGET
    asked = read_region(loop, W, domain=domain, everything=False)
    return max_separable_check(replace(asked, disturbance=disturbance), claim, radius=radius)


#: Two agents with h = y, of which the first one is pinned.
LINEAR = pair("y")


def delayed(problem, claim, bound, proof):
    return delay_check(loop_of(problem), claim, bound, proof, domain=NEAR_TARGET)


def sampled(problem, claim, proof):
    case = Case(loop=loop_of(problem), W=None, domain=NEAR_TARGET)
    return sampling_check(case, claim, proof)


def confirmed(check, problem=CUBIC, **settings):
    return certified.confirmed(check, problem, **settings)


def bent(check, **changes):
    claim = Values({**check.exact, **changes})
    return replace(check, claim=claim)


def test_a_true_claim_is_proved_and_confirmed():
    check = proved()
    assert check.verdict == PROVED
    assert check.rate == 0.333333333
    assert check.domain == BOX
    assert separable_from_json(check.exact, loop_of(CUBIC)) == CLAIM
    assert confirmed(check) is None
    assert confirmed(replace(check, rate=0.333333333333)) is None  # 1/3 is larger
    for rate in (0.333333334, 0.0, -1.0, None):
        assert "does not follow" in confirmed(replace(check, rate=rate))


MORE = [(replace(CLAIM, alpha=F(1, 3) + F(1, 10**9)), 2.0), (CLAIM, 2.0000001)]


@pytest.mark.parametrize(
    ("claim", "radius"), [*MORE, (replace(CLAIM, v=fractions(1, "1.4999999")), 2.0)]
)
def test_a_little_more_is_undecided(claim, radius):
    """One claim that fails says nothing against the others, so it is not refuted."""
    check = proved(claim, radius)
    assert check.verdict == UNDECIDED
    assert check.exact is None
    assert check.domain == NEAR_TARGET


def test_an_undecided_check_claims_nothing():
    nothing = replace(proved(), verdict=UNDECIDED, domain=NEAR_TARGET, claim=None, rate=None)
    assert confirmed(nothing) is None
    assert "claim nothing" in confirmed(replace(nothing, rate=0.1))
    check = replace(nothing, domain=replace(BOX, radius=1.0))
    assert "domain" in confirmed(check)


def test_linear_couplings_are_proved_for_every_start_and_only_they():
    """h = 2 y: agent 2 has 2 (v_2 - v_1)/v_2 = 2/3."""
    problem = pair("2*y")
    claim = Separable(v=V, alpha=F(2, 3), rho=None)
    check = proved(claim, problem=problem)
    assert check.verdict == PROVED
    assert check.domain == EVERYWHERE
    assert confirmed(check, problem, domain=EVERYWHERE) is None
    found = confirmed(bent(check, alpha="0.66667"), problem, domain=EVERYWHERE)
    assert found is not None
    assert confirmed(check) is not None
    assert proved(replace(CLAIM, rho=None)).verdict is UNDECIDED


# with an observer: xi' = 0, d = xi, W = 2, so P = 1 works with beta = 2

WATCHED = {"exosystem": Exosystem(A=[[0]], C=[[1]]), "observer": Observer(W=[[2]])}
OBSERVED = listening([[2, 1]], "y + y**3", n=2, gains={1: 5}, target=0, **WATCHED)
W = OBSERVED.observer.W
BOUND = ErrorBound(P=((F(1),),), beta=F(2), kappa=F(1), size=F(1))
COMPOSITE = replace(CLAIM, error=BOUND)


def composite(claim=COMPOSITE, radius=1.5, disturbance=0.5):
    return proved(claim, radius, OBSERVED, W, disturbance)


def test_the_observers_part_cannot_be_left_out():
    check = composite()
    own = {key: check.exact[key] for key in ("v", "alpha", "rho")}
    less = replace(check, claim=Values(own))
    assert "lacks" in confirmed(less, OBSERVED, W=W)
    assert "kappa must exceed" in confirmed(bent(check, kappa="1/2"), OBSERVED, W=W)
    assert confirmed(check, OBSERVED, W=None).startswith("does not apply")
    found = confirmed(check, OBSERVED, W=((F("1.99"),),))
    assert found is not None  # beta = 2 needs W >= 2


# agents that no common v holds

CROSSED = listening({"A": [[2, 1], [3, 2]], "B": [[3, 1], [2, 3]]}, "tanh(y)", n=3, gains={1: 3})


def test_agents_that_hear_only_each_other_in_turn_are_shown():
    """In mode A agent 3 hears 2, in mode B agent 2 hears 3: no order of the two serves both
    modes."""
    check = stuck_check(loop_of(CROSSED), None, domain=NEAR_TARGET)
    assert check.verdict == REFUTED
    assert check.witness.labels == ("2", "3")
    assert confirmed(check, CROSSED) is None
    assert "2 in B, 3 in A" in check.reason
    assert stuck_check(loop_of(CUBIC), None, domain=NEAR_TARGET) is None
    assert not stuck_agents(loop_of(CUBIC))
    # One agent removed: it is then heard from outside.
    too_many = ("1", "2", "3")
    cases = (("2",), too_many, ("2", "4"), None)
    for labels in cases:
        witness = replace(check.witness, labels=labels)
        assert confirmed(replace(check, witness=witness), CROSSED) is not None
    for witness in (None, replace(check.witness, values=("1",))):
        assert confirmed(replace(check, witness=witness), CROSSED) is not None


def test_the_pins_that_are_advised_remove_the_obstacle_and_larger_gains_do_not():
    check = stuck_check(loop_of(CROSSED), None, domain=NEAR_TARGET)
    assert check.reason.endswith(
        "Pinning agent 2 would remove this obstacle; larger gains would not."
    )
    stronger = CROSSED.replace(gains={1: 300})
    assert stuck_check(loop_of(stronger), None, domain=NEAR_TARGET) is not None
    pinned = CROSSED.replace(gains={1: 3, 2: "1/10"})
    assert stuck_check(loop_of(pinned), None, domain=NEAR_TARGET) is None


def test_advised_pins_are_among_the_fewest_that_serve():
    """Pairs (2, 3) and (4, 5) that hear each other in turn: no single pin serves both."""
    rows = {"A": [[2, 1], [3, 2], [4, 1], [5, 4]], "B": [[3, 1], [2, 3], [5, 1], [4, 5]]}
    loop = loop_of(listening(rows, "tanh(y)", n=5, gains={1: 3}))
    pins = pins_that_order(loop)
    assert not stuck_agents(loop, held=pins)
    assert len(pins) == 2
    assert all(stuck_agents(loop, held=[agent]) for agent in range(5))


def test_couplings_between_components_are_neither_proved_nor_refuted():
    mixed = {"coupling": ["y1 + y2", "y2"], "gains": {1: 3}, "target": [0, 0]}
    problem = Problem(network=CROSSED.network, **mixed)
    assert stuck_check(loop_of(problem), None, domain=EVERYWHERE) is None
    assert proved(CLAIM, problem=problem).reason.startswith("does not apply:")
    stuck = stuck_check(loop_of(CROSSED), None, domain=NEAR_TARGET)
    check = replace(stuck, domain=EVERYWHERE)
    assert confirmed(check, problem, domain=EVERYWHERE).startswith("does not apply")


# delays and sampling


def test_a_delay_is_proved_beside_its_proof_and_confirmed():
    """h = y, v = (1, 3/2): alpha = 1 - theta/1.5; theta = exp(b T) = 1.2 leaves b = 1/5, so T = 5
    ln(1.2) = 0.9116."""
    proof = proved(CLAIM, problem=LINEAR)
    bound = DelayBound(delay=F("0.9115"), rate=F(1, 5))
    check = delayed(LINEAR, CLAIM, bound, proof)
    assert check.verdict == PROVED
    assert check.rate == 0.2
    assert check.domain == proof.domain
    longer = replace(bound, delay=F("0.9117"))
    assert delayed(LINEAR, CLAIM, longer, proof).verdict is UNDECIDED
    assert confirmed(check, LINEAR, beside=proof) is None
    found = confirmed(bent(check, delay="0.9117"), LINEAR, beside=proof)
    assert found is not None
    found = confirmed(bent(check, rate="0.2001"), LINEAR, beside=proof)
    assert found is not None
    faster = replace(check, rate=0.2001)
    assert "does not follow" in confirmed(faster, LINEAR, beside=proof)
    for other in (replace(proof, domain=EVERYWHERE), replace(proof, verdict=UNDECIDED)):
        assert "needs a proved max-separable check" in confirmed(check, LINEAR, beside=other)


def test_with_an_observer_no_delayed_rate_exceeds_beta():
    error = replace(BOUND, beta=F(1, 4), kappa=F(5))
    slow = replace(COMPOSITE, error=error)
    proof = composite(slow, radius=0.5, disturbance=0.1)
    assert proof.verdict is PROVED
    for rate, verdict in (("0.25", PROVED), ("0.2500001", UNDECIDED)):
        bound = DelayBound(delay=F(0), rate=F(rate))
        assert delayed(OBSERVED, slow, bound, proof).verdict is verdict


def test_a_sampling_period_is_the_inverse_of_the_stiffest_row():
    """h = y: agent 1 has k = 5 and agent 2 the weight 1, so T = 1/5; a thousandth is kept in
    hand."""
    proof = proved(CLAIM, problem=LINEAR)
    check = sampled(LINEAR, CLAIM, proof)
    assert check.exact == {"period": "999/5000", "factor": "4667/5000"}
    assert confirmed(check, LINEAR, beside=proof) is None
    largest = bent(check, period="1/5", factor="14/15")
    assert confirmed(largest, LINEAR, beside=proof) is None
    longer = bent(check, period="0.2000001", factor="14/15")
    assert "overshoot" in confirmed(longer, LINEAR, beside=proof)
    none = bent(check, period="0")
    assert "must be > 0" in confirmed(none, LINEAR, beside=proof)
    # true equals 1 in Python, and is no number in a certificate
    equal = domain_from_json(check.domain.to_json() | {"disturbance": False})
    assert "with its domain" in confirmed(replace(check, domain=equal), LINEAR, beside=proof)


def test_a_sampling_period_is_for_an_estimate_that_is_not_held():
    """k = 1, T = 1: with eps = 0 and dhat(t) the error is gone after a step; dhat held for d = sin
    2t leaves some."""
    proof = composite(COMPOSITE, radius=0.5, disturbance=0.1)
    with_estimate = sampled(OBSERVED, COMPOSITE, proof)
    assert with_estimate.verdict is PROVED
    assert "dhat acts continuously" in with_estimate.reason
    without = sampled(LINEAR, CLAIM, proved(CLAIM, problem=LINEAR))
    assert "dhat" not in without.reason
    T = e = 1.0
    held = []
    for t in np.arange(30.0):
        before = np.cos(2 * t)
        after = np.cos(2 * (t + T))
        disturbance = (before - after) / 2
        e += T * -e + disturbance - T * np.sin(2 * t)
        held.append(abs(e))
    assert max(held[-10:]) > 0.5


def test_rows_in_coordinates_say_nothing_about_delays_and_sampling():
    """With T = 1 they are the same rows, but what is decided beside them is by component."""
    loop = loop_of(LINEAR)
    one = ((F(1),),)
    ranges = enclosed_ranges(loop, one, V, F(2))
    claim = replace(CLAIM, T=one, ranges=ranges)
    turned = proved(claim, problem=LINEAR)
    assert turned.verdict is PROVED
    assert confirmed(turned, LINEAR) is None
    plain = proved(CLAIM, problem=LINEAR)
    bound = DelayBound(delay=F("0.9115"), rate=F(1, 5))
    late = delayed(LINEAR, CLAIM, bound, plain)
    in_samples = sampled(LINEAR, CLAIM, plain)
    for check in (late, in_samples):
        assert confirmed(check, LINEAR, beside=plain) is None
        wrong = confirmed(check, LINEAR, beside=turned)
        assert "needs a proved max-separable check" in wrong


# vectors of many agents


def test_many_agents_travel_as_doubles_that_mean_exactly_what_they_are():
    v = tuple(F(4096 + k, 4096) for k in range(1001))
    packed = vector_to_json(v)
    assert list(packed) == ["float64"]
    assert tuple(vector_from_json(packed, 1001)) == v
    assert isinstance(vector_to_json(v[:1000]), list)
    assert isinstance(vector_to_json((F(1, 3), *v)), list)  # 1/3 is no double
    with pytest.raises(ValueError, match="expected 1000 numbers"):
        vector_from_json(packed, 1000)
    values = np.array([1.0, np.nan])
    encoded = base64.b64encode(values.tobytes())
    bad = encoded.decode()
    for text in (bad, bad[:-4], "not base64!", 5, None):
        with pytest.raises((ValueError, TypeError)):
            vector_from_json({"float64": text}, 2)
