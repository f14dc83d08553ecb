"""Joint design: what is designed is certified, and what is refused is impossible by an oracle of
its own."""

import math
from fractions import Fraction
from itertools import combinations

import pytest
from networks import (
    BOX,
    CONSTANT,
    HIDDEN,
    NOISY_BOX,
    linear_rate,
    linked,
    ring,
    star,
    two_leaders,
)

import dobc_design as dd
from dobc_design.errors import SpecError
from dobc_design.problem.changes import changed_problem
from dobc_design.synthesis.joint.claim import RegionPrices
from dobc_design.synthesis.pinning.decide import structural_obstacle, structure_of
from dobc_design.synthesis.pinning.propose_regions import RegionSearch
from dobc_design.verdict import Verdict


def is_proved(found: dd.Design) -> bool:
    """The design is a problem whose certificate holds, decided again by both checkers."""
    if found.verdict is not Verdict.PROVED:
        return False
    again = dd.verify(found.certificate, found.problem)
    return again.holds and again.verdict is Verdict.PROVED


@pytest.mark.slow
def test_a_nonlinear_ring_with_a_region_gets_one_pin_that_is_proved_for_it():
    problem = ring(coupling="tanh(y)", region=BOX)
    found = dd.design(problem)
    assert is_proved(found)
    assert list(found.gains) == ["1"]
    assert found.certificate.covered_by == "max-separable"
    assert found.cost == sum(found.gains.values())


@pytest.mark.slow
def test_with_a_disturbance_w_is_designed_too_and_rounded_to_the_digits_asked():
    problem = ring(3, region=NOISY_BOX, exosystem=CONSTANT)
    found = dd.design(problem, digits=2)
    assert is_proved(found)
    assert found.problem.observer.W == found.W
    gains = found.gains.values()
    cases = (*gains, *(x for row in found.W for x in row))
    for number in cases:
        assert Fraction(f"{float(number):.2g}") == number


@pytest.mark.slow
def test_the_papers_example_without_k_and_w_is_proved_for_its_box_with_at_most_two_pins():
    """Starts in [0, 5] about xbar = 1 and |eps| <= 1/2; gains with the printed arcs' likeliest
    reading."""
    paper = dd.load_problem("paper-fixed")
    changes = {"pinning.gains": None, "observer.P": None, "observer.W": None}
    bare = changed_problem(paper, changes)
    found = dd.design(bare)
    assert is_proved(found)
    assert found.problem.region == paper.region
    assert 1 <= len(found.gains) <= 2


def test_without_a_region_the_design_is_proved_at_the_consensus():
    """Ring of 4 at the rate b with one pin: (1 + k - b) (1 - b)^3 = 1; twice as many pins are
    needed for V = e'e."""
    found = dd.design(ring(region=None), rate="0.1")
    assert is_proved(found)
    assert found.certificate.covered_by == "theorem1-weighted"
    expected = 1 / 0.9**3 - 0.9
    assert float(found.cost) == pytest.approx(expected, rel=0.05)
    assert any("the true rate near the target" in sentence for sentence in found.decisions)
    two = dd.design(ring(region=None), rate="0.3")  # with one pin V = e'e has no such rate
    assert len(two.gains) == 2
    assert float(two.cost) < 1 / 0.7**3 - 0.7
    plain = dd.design(ring(region=None), rate="0.1", conservative=True)
    assert is_proved(plain)
    assert plain.cost > found.cost
    assert any("chosen for V = e'e" in sentence for sentence in plain.decisions)
    answer = plain.request.limits(plain.labels)
    assert dict(answer)["conservative"] == "V = e'e near the target"


def test_gains_of_the_problem_are_not_looked_at():
    problem = ring(2, gains={"2": 77})
    found = dd.design(problem, rate="0.1")
    assert found.gains == dd.design(ring(2), rate="0.1").gains


def own_gains(**gains: str) -> dd.Problem:
    return ring(4, coupling="y", region=BOX, gains={name[1:]: k for name, k in gains.items()})


@pytest.mark.slow
def test_without_a_rate_a_design_is_no_slower_than_the_own_gains_for_no_more_gain():
    """One pin would do at the rate of both, b = 0.253, with b + (1 - b)^-3 - 1 = 1.65 for 1.2."""
    problem = own_gains(k1="0.7", k3="0.5")
    given = dd.certify(problem)
    found = dd.design(problem)
    assert is_proved(found)
    assert found.certificate.rate >= given.rate
    assert len(found.gains) > 1
    assert found.cost <= Fraction("1.2")
    assert found.request.rate is None
    assert found.given.rate == given.rate
    first = found.decisions[0]
    assert first.startswith(f"Your own gains are certified at {given.rate:.4f}"[:-1])
    assert f"({float(found.cost):g} instead of 1.2)" in first
    assert first.endswith("at least that of your own gains was aimed at.")


@pytest.mark.slow
def test_a_rate_asked_for_overrules_the_own_gains_and_limits_may_not_reach_them():
    """One gain of at most 1/2 has a rate below (1 + k - b)(1 - b)^3 = 1, b = 0.105."""
    problem = own_gains(k1="0.6", k3="0.5")
    slow = dd.design(problem, rate="0.1")
    assert slow.rate < 0.11 < slow.given.rate
    assert "No rate was asked for" not in slow.decisions[0]
    held = dd.design(problem, pins=1, allowed=[1], max_gain="1/2")
    assert is_proved(held)
    assert held.rate < 0.11
    assert held.decisions[0].endswith(
        "No design with the rate of your own gains was proved within the limits."
    )


@pytest.mark.slow
def test_further_pins_cost_what_closed_forms_say_and_are_no_slower():
    """A ring with opposite hard pins, h = y: k = b + 1/(1 - b) - 1 for each, at the rate b."""
    found = dd.design(own_gains(), rate="0.2", further=1)
    (second,) = found.further
    assert second.pinned == ("1", "3")
    assert second.proved
    assert second.x >= 0.2
    expected = 2 * (0.2 + 1 / 0.8 - 1)
    assert second.y == pytest.approx(expected, rel=0.02)
    rows = str(found).split("Price of further pins\n")[1].splitlines()
    assert [row.split()[0] for row in rows] == ["pins", "1", "2"]
    assert "<td>1, 3</td>" in found._repr_html_()
    further = found.to_json()["further"]
    assert further == [{"pinned": ["1", "3"], "cost": second.y, "rate": second.x}]
    design = dd.design(own_gains(), rate="0.2", pins=1, further=1)
    assert design.further == ()


def test_a_larger_rate_with_a_later_time_is_explained_by_its_factor():
    """A chain, all pinned with k = 1, against its leader alone: both rates are near 0.9."""
    problem = pinned_chain()
    found = dd.design(problem)
    given, own = found.given, found.certificate
    assert own.rate > given.rate
    own_time = math.log(100 * own.factor) / own.rate
    given_time = math.log(100 * given.factor) / given.rate
    assert own_time > given_time
    first = found.decisions[0]
    assert "s, factor 1.711), this design" in first
    assert "The larger rate has the later time because its factor is larger" in first
    assert "later time" not in dd.design(problem, rate="0.2").decisions[0]


def test_a_design_names_the_conditions_that_it_loses():
    """J + J' - K - K' of the chain is < 0 for k = 1 everywhere; for the leader alone it is only if
    k > 1/3 (Schur complement)."""
    found = dd.design(pinned_chain(), rate="0.2")
    assert list(found.gains) == ["3"] and found.cost < Fraction(1, 3)
    assert found.decisions[1] == "Proved with your own gains, but not with this design: lemma1."


def pinned_chain() -> dd.Problem:
    """3 leads 2 leads 1, h = y, all pinned with k = 1."""
    arcs = [[1, 2], [2, 3]]
    gains = {1: 1, 2: 1, 3: 1}
    return linked(arcs, 3, gains=gains)


@pytest.mark.parametrize("pins", [True, False])
def test_where_further_pins_have_a_table_no_price_of_a_small_gain_stands_beside_it(pins):
    prices = RegionPrices(rate=1.0, share=1.0, capped=(), savings={"7": 2.0}, barred=())
    said = " ".join(prices.sentences(pins=pins))
    assert ("agent 7 would save most" in said) is pins


def test_agents_that_would_save_most_and_may_not_be_pinned_are_all_named():
    savings = {"4": 9.0, "3": 8.0, "2": 7.0}
    prices = RegionPrices(rate=1.0, share=1.0, capped=(), savings=savings, barred=("4", "3"))
    said = list(prices.sentences(pins=True))
    assert said[-1].endswith("agent 2 7 (not allowed: agents 4 and 3).")


def line_of_seven(**changes):
    """Agents in a line.  j of them beside a hard pin decay at 2 - 2 cos(pi / (2j + 1)), between two
    at 2 - 2 cos(pi / (j + 1)): 4 alone allows 0.198, 2 and 6 allow 0.586, other pairs up to
    0.382."""
    arcs = [arc for i in range(1, 7) for arc in ([i, i + 1], [i + 1, i])]
    return linked(arcs, 7, region=BOX, **changes)


@pytest.mark.parametrize("pins", [None, pytest.param(2, marks=pytest.mark.slow)])
def test_the_only_pair_that_reaches_a_rate_is_found_although_one_pin_would_be_elsewhere(pins):
    found = dd.design(line_of_seven(), rate="0.4", pins=pins)
    assert is_proved(found)
    assert list(found.gains) == ["2", "6"]


@pytest.mark.slow
def test_the_nearest_rate_uses_all_pins_that_are_allowed():
    found = dd.design(line_of_seven(coupling="tanh(y)"), rate="0.58", pins=2)
    assert found.verdict is Verdict.UNDECIDED
    assert is_proved(found.nearest)
    assert list(found.nearest.gains) == ["2", "6"]
    assert found.nearest.rate > 0.198


@pytest.mark.slow
def test_of_all_sets_of_three_agents_the_cheapest_is_pinned():
    problem = line_of_seven()
    found = dd.design(problem, rate="0.6", pins=3)
    assert is_proved(found)
    zero = Fraction(0)
    search = RegionSearch(problem=problem, W=None, caps={}, radius=1 + zero, disturbance=zero)
    totals = list[float]()
    for agents in combinations(range(7), 3):
        gains = search.smallest(agents, 0.6)
        totals.append(math.inf if gains is None else sum(gains.gains.values()))
    assert found.cost < min(totals) * 1.02


@pytest.mark.slow
def test_one_pin_is_not_enough_where_a_percent_of_rate_takes_more_than_ten_of_gain():
    """Ring of 4: k = b + (1 - b)^-3 - 1, so that 1 % of b takes about 3 b / (1 - b) % of k."""
    problem = ring(4, region=BOX)
    assert len(dd.design(problem, rate="0.6").gains) == 1
    assert len(dd.design(problem, rate="0.8").gains) == 2


def test_a_bound_on_noise_below_what_the_rate_of_the_file_takes_is_refuted_with_the_cure():
    """C W = 1 = -F for a constant disturbance at 1 1/s."""
    observer = dd.Observer(rate=1)
    problem = ring(2, region=NOISY_BOX, exosystem=CONSTANT, observer=observer)
    found = dd.design(problem, noise=1)
    assert found.verdict is Verdict.REFUTED
    assert found.binding == "noise"
    assert "at least 1 1/s at high frequencies (|C W|). Lower observer.rate" in found.reason
    assert is_proved(found.nearest)


def test_an_observer_that_is_faster_than_the_file_asks_says_why():
    observer = dd.Observer(rate="0.1")
    problem = ring(2, region=NOISY_BOX, exosystem=CONSTANT, observer=observer)
    found = dd.design(problem, rate="0.3")
    assert is_proved(found)
    assert "W is faster than observer.rate = 0.1 asks, so that" in str(found)


@pytest.mark.parametrize("further", [-1, True, 21, "two"])
def test_a_number_of_further_pins_is_a_small_integer(further):
    with pytest.raises(SpecError, match="further must be an integer from 0 to 20"):
        dd.design(ring(2), further=further)


@pytest.mark.slow
def test_a_rate_beyond_the_allowed_agents_is_refuted_with_the_nearest_one():
    """A held leader: the other follows at h'(0) = 1 and no faster, whatever k_1."""
    star_of_two = star(2, region=BOX)
    found = dd.design(star_of_two, rate="1.01", allowed=["1"])
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "rate"
    answer = linear_rate(star(2), {0: 1e9})
    assert answer == pytest.approx(1)
    assert is_proved(found.nearest)
    assert Fraction(1, 2) < found.nearest.request.rate < 1
    within = dd.design(star(2, region=BOX), rate="0.99", allowed=["1"])
    assert is_proved(within)
    assert within.rate >= 0.99


@pytest.mark.slow
def test_a_cap_that_is_too_small_is_refuted_and_the_nearest_cap_does():
    """All agents at k = 1/2 return at 1/2 together, and never faster."""
    found = dd.design(ring(3, region=BOX), rate="0.51", max_gain="1/2")
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "max_gain"
    gains = dict.fromkeys(range(3), 0.5)
    answer = linear_rate(ring(3), gains)
    assert answer == pytest.approx(0.5)
    assert is_proved(found.nearest)
    assert max(found.nearest.request.caps.values()) > Fraction(1, 2)


def test_fewer_pins_than_groups_is_refuted_and_the_nearest_request_has_enough():
    found = dd.design(two_leaders(region=BOX), pins=1)
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "pins"
    assert "1; " in found.reason
    assert is_proved(found.nearest)
    assert found.nearest.request.pins == 2
    assert is_proved(dd.design(two_leaders(region=BOX), pins=2))


def test_too_few_pins_for_a_rate_are_refuted_set_by_set():
    """Held by two pins, one leaf of the star still returns at 1 only: both leaves need their own
    pin."""
    found = dd.design(star(3, region=BOX), rate="1.2", pins=2)
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "pins"
    sets = combinations(range(3), 2)
    assert max(linear_rate(star(3), dict.fromkeys(pair, 1e6)) for pair in sets) < 1.2
    assert is_proved(found.nearest)
    assert len(found.nearest.gains) == 3


@pytest.mark.parametrize("pins", [None, 1])
def test_a_group_that_is_alone_in_one_mode_only_is_refuted_for_arbitrary_switching(pins):
    """In turn, modes A (3 hears 2) and B (2 hears 1) may converge with a pin on 1; put together
    they need no other."""
    chain = ({"A": [[3, 2]], "B": [[2, 1]]}, True)
    both_at_once = ({"A": [[3, 2], [2, 1]]}, False)
    cases = (chain, both_at_once)
    for modes, several in cases:
        problem = linked(modes, 3)
        structure = structure_of(problem, range(3) if pins else (0,))
        found = structural_obstacle(problem, pins, structure)
        assert (found is not None) is several
        assert found is None or "under arbitrary switching" in found.text


def test_a_group_without_an_allowed_agent_is_refuted_and_the_nearest_request_allows_it():
    found = dd.design(star(region=BOX), allowed=["2", "3"])
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "allowed"
    assert is_proved(found.nearest)
    assert 0 in found.nearest.request.allowed


def test_an_undetectable_pair_is_refuted_when_its_reduction_is_declined_and_reduced_otherwise():
    problem = ring(2, exosystem=HIDDEN)
    found = dd.design(problem, reduce=False)
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "reduce"
    assert is_proved(found.nearest)
    assert found.nearest.problem.q == 1
    assert found.nearest.request.reduce


def test_too_quiet_an_observer_is_refuted_and_the_nearest_bound_is_met():
    """A harmonic of 1 rad/s is followed with a gain of 1 at least."""
    problem = ring(2, region=NOISY_BOX, exosystem=dd.exosystems.harmonics(1))
    found = dd.design(problem, noise="0.9")
    assert found.verdict == Verdict.REFUTED
    assert found.binding == "noise"
    assert is_proved(found.nearest)
    assert found.nearest.request.noise[0].bound > 1


@pytest.mark.slow
def test_a_region_that_no_proof_reaches_is_undecided_and_not_called_impossible():
    """One pin cannot hold a ring of sines whose angles may be pi apart; three pins can, with large
    gains."""
    region = {"initial_states": [-3, 3]}
    problem = ring(3, coupling="sin(y)", region=region)
    found = dd.design(problem, pins=1, allowed=["1"])
    assert found.verdict is Verdict.UNDECIDED
    assert found.problem is None
    region = {"initial_states": [-3, 3]}
    problem = ring(3, coupling="sin(y)", region=region)
    assert is_proved(dd.design(problem))


def test_wrong_arguments_are_named_all_at_once():
    with pytest.raises(SpecError) as caught:
        dd.design(ring(), rate=-1, noise=-2, reduce="no")
    found = {error.key for error in caught.value.errors}
    assert found == {"rate", "noise", "reduce"}


def test_a_design_says_what_was_decided_and_what_each_limit_costs():
    problem = ring(2, region=BOX, name="<script>")
    found = dd.design(problem, rate="0.2")
    text = str(found)
    assert "Pinned: agent 1; at least one is needed" in text
    assert "Gains: k = " in text
    assert "Price of the rate" in text
    assert "<script" not in found._repr_html_()
    keys = set(found.to_json())
    expected = {"verdict", "W", "P", "gains", "rate", "cost", "reason", "problem"}
    assert keys >= expected


def test_the_smallest_gains_and_the_price_of_the_rate_are_those_of_closed_forms():
    """A leader hears nobody: k = b.  Ring with one hard pin and h = y: v_j = (1 - b)^-(distance), k
    = b + v_2 - 1."""
    star2 = star(2, region=BOX)
    ring4 = ring(4, coupling="y", region=BOX)
    stars = [(star2, b, b, 1.0) for b in (0.2, 0.8)]
    rings = [(ring4, 0.1, 0.1 + 0.9**-3 - 1, 1 + 3 * 0.9**-4)]
    known = stars + rings
    for problem, rate, total, slope in known:
        zero = Fraction(0)
        search = RegionSearch(problem=problem, W=None, caps={}, radius=1 + zero, disturbance=zero)
        found = search.smallest([0], rate)
        assert sum(found.gains.values()) == pytest.approx(total)
        assert found.rate_price == pytest.approx(slope)


@pytest.mark.slow
def test_under_a_guarantee_nothing_is_refuted_that_holds_for_arbitrary_switching_only():
    """One pin does where A and B are on in turn; each of two agents hears nobody in one of the
    modes."""
    arcs = {"A": [[1, 2]], "B": [[2, 1]]}
    network = dd.Network.from_arcs(arcs, arrow="listens_to", agents=2)
    turns = dd.Switching(guarantee="sequence", sequence=["A", "B"], dwell=1)
    for switching, verdict in ((turns, Verdict.UNDECIDED), (None, Verdict.REFUTED)):
        problem = dd.Problem(network=network, coupling="y", gains={1: 1}, switching=switching)
        found = dd.design(problem, pins=1, conservative=True)
        assert found.verdict is verdict
        assert ("guarantee of [switching]" in found.reason) == (switching is not None)
        answer = dd.design_pinning(problem, rate="1/10", pins=1, conservative=True)
        assert answer.verdict is verdict
        said = str(dd.design(problem))
        assert "2 groups listen to nobody outside, and each needs a pin" in said
        assert ("fewer may do under the guarantee" in said) == (switching is not None)
