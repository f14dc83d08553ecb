"""Designs of problems with [readings] or [processor]: gains stay below the limit of overshooting,
and what is proved is proved with the tables."""

import math
from fractions import Fraction
from typing import Any

import pytest

import dobc_design as dd
from dobc_design.errors import SpecError


def ring(agents: int = 4, **tables: Any) -> dd.Problem:
    """Agent i hears agent i + 1, the last one the first, by h = y: every agent has slopes of 1."""
    arcs = [[i, i % agents + 1] for i in range(1, agents + 1)]
    network = dd.Network.from_arcs(arcs, arrow="listens_to")
    return dd.Problem(network=network, coupling="y", name="ring", **tables)


def steepest(problem: dd.Problem) -> Fraction:
    """The largest sum of weights and gain of an agent, by hand."""
    gains = {i: k[0][0] for i, k in problem.pinning.gains.items()}
    (arcs,) = problem.network.modes.values()
    sums = [gains.get(i, Fraction(0)) for i in range(problem.n)]
    for i, _, weight in arcs:
        sums[i] += weight
    return max(sums)


def both_programs_accept(found: dd.Design) -> bool:
    assert found.certificate is not None and found.problem is not None
    again = dd.verify(found.certificate, found.problem)
    return again.holds and again.lone_checker == "it accepts every claim"


@pytest.mark.slow
def test_gains_of_a_processor_keep_q_t_at_most_1():
    """Theory, section 15: with d = 0 the limit is Q T <= 1.  T = 0.6 leaves a gain of 2/3 beside
    one arc of slope 1; without the table the same request takes a larger one."""
    found = dd.design(ring(processor={"period": "3/5"}))
    assert found.is_proved and found.problem is not None
    assert steepest(found.problem) * Fraction(3, 5) <= 1
    assert both_programs_accept(found)
    free = dd.design(ring())
    assert free.problem is not None and steepest(free.problem) * Fraction(3, 5) > 1


def test_a_period_that_leaves_no_gain_is_open_and_the_limit_is_named():
    """T = 1.01: one arc of slope 1 alone makes Q T > 1."""
    found = dd.design(ring(processor={"period": "101/100"}))
    assert found.verdict is dd.Verdict.UNDECIDED and not found.gains
    assert "may add up to 0.99 1/s with these readings" in found.reason


def test_gains_beside_late_own_readings_keep_q_sigma_at_most_1_over_e():
    late = ring(readings={"own_delay": "1/5", "delay": "1/2"})
    found = dd.design(late, rate="1/20")
    assert found.is_proved and found.problem is not None and found.certificate is not None
    assert float(steepest(found.problem)) <= 5 / math.e
    # The rate is that with the readings, not that of a check that knows none.
    assert found.rate == found.certificate.rate and found.rate >= 1 / 20
    assert both_programs_accept(found)


def test_a_rate_beyond_the_limit_of_overshooting_is_not_refuted():
    """Q sigma <= 1/e is sufficient only; with sigma = 1/5 the gains that it allows reach 0.83."""
    late = ring(readings={"own_delay": "1/5"})
    assert dd.design(ring(processor={"period": "1/2"}), rate=2).verdict is dd.Verdict.UNDECIDED
    found = dd.design(late, rate=1)
    assert found.verdict is dd.Verdict.UNDECIDED
    assert found.nearest is not None and found.nearest.is_proved
    assert dd.design(late, rate="7/10").is_proved


def test_pins_and_gains_alone_are_designed_with_the_readings_too():
    late = ring(readings={"delay": 1})
    found = dd.design_pinning(late, rate="1/10", pins=1)
    assert found.is_proved and list(found.gains) == ["1"]
    whole = found.whole
    assert whole is not None and whole.certificate is not None
    assert whole.certificate.covered_by == "readings"
    with pytest.raises(SpecError, match=r"cost, region, .* does not know readings that are late"):
        dd.design_pinning(late, rate="1/10", cost=2)
