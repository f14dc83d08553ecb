"""The quick search for a second equilibrium in the region asked for."""

from fractions import Fraction

import numpy as np
import pytest
from networks import PAPER, cycle
from regional_problems import field, half_difference, listening_pair, random_folded

from dobc_design import Network, Problem, Verdict
from dobc_design.certification import equilibria
from dobc_design.certification.equilibria import equilibrium_check
from dobc_design.conditions.equilibrium import propose
from dobc_design.conditions.equilibrium.propose import find_roots
from dobc_design.conditions.separable.claim import Separable
from dobc_design.conditions.separable.decide import verify_separable
from dobc_design.conditions.separable.propose import propose_separable, rounded_vectors
from dobc_design.conditions.separable.propose_limits import largest_rate
from dobc_design.loop.loop import Loop
from dobc_design.loop.make import loop_of

F = Fraction
SADDLE = half_difference(3.3)


@pytest.fixture
def few_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twelve corners and twelve random starts in all modes together."""
    monkeypatch.setattr(equilibria, "STARTS", 12)


def start_of(check) -> list[F]:
    return [F(value) for value in check.witness.values]


@pytest.mark.usefixtures("few_starts")
def test_it_is_found_up_to_the_edge_of_the_region_and_not_beyond():
    """The saddle is at |e| = 1.65387: twin regions on both sides of it."""
    assert equilibrium_check(listening_pair(reach=1.655)) is not None
    assert equilibrium_check(listening_pair(reach=1.653)) is None


def test_nothing_is_certified_beyond_it():
    """v = (1, 1): the rows hold exactly up to the false equilibrium; proved at 1.653, refuted at
    1.655."""
    problem = listening_pair()
    v = (F(1), F(1))
    assert largest_rate(loop_of(problem), v, rho=F("1.653")) is not None
    assert largest_rate(loop_of(problem), v, rho=F("1.655")) is None
    small_rate = F(1, 10**9)
    tiny = Separable(v=v, alpha=small_rate, rho=F("1.655"))
    assert verify_separable(loop_of(problem), tiny).verdict is Verdict.REFUTED
    for rho in ("1.66", "2", "3", "5"):
        proposal = propose_separable(loop_of(problem), rho=float(rho))
        for other in () if proposal is None else rounded_vectors(proposal):
            assert largest_rate(loop_of(problem), other, rho=F(rho)) is None


@pytest.mark.usefixtures("few_starts")
def test_one_mode_that_has_one_is_enough():
    """Mode B is the pair; in mode A nobody listens, and every pin holds."""
    pair = [[1, 2], [2, 1]]
    modes = {"A": [], "B": pair}
    network = Network.from_arcs(modes, arrow="listens_to", agents=2)
    region = {"initial_states": [-5, 5]}
    problem = Problem(network=network, coupling="sin(y)", gains="1/10", region=region)
    assert equilibrium_check(problem).exact["mode"] == "B"


@pytest.mark.usefixtures("few_starts")
def test_of_more_modes_than_the_work_is_for_the_first_are_looked_at(
    monkeypatch: pytest.MonkeyPatch,
):
    """The same mode over and over: what was found when the work ends is kept, and nothing begins
    after it."""
    looked = list[str]()

    def roots(loop: Loop, mode: str, points: list[np.ndarray]):
        looked.append(mode)
        yield from find_roots(loop, mode, points)

    monkeypatch.setattr(propose, "find_roots", roots)
    monkeypatch.setattr(equilibria, "STAGE", 3 * equilibria.RUNS_WORK + 40 * propose.ROOT_WORK)
    pair = {}
    for k in range(9):
        pair[f"m{k}"] = [[1, 2], [2, 1]]
    network = Network.from_arcs(pair, arrow="listens_to", agents=2)
    region = {"initial_states": [-5, 5]}
    many = Problem(network=network, coupling="sin(y)", gains="1/10", region=region)
    monkeypatch.setattr(equilibria, "STARTS", 72)
    assert equilibrium_check(many) is not None
    assert looked == list(pair)[: len(looked)] != list(pair)


@pytest.mark.parametrize("h", [PAPER, "tanh(y)", "y + y**3", "clip(y, -1, 1)"])
def test_monotone_couplings_with_one_pin_have_none(h: str):
    """Theory, section 5: every start converges, so that a second equilibrium would be a
    contradiction."""
    region = {"initial_states": [-4, 4]}
    unlimited = cycle(4, h=h, region=region)
    assert equilibrium_check(unlimited) is None


@pytest.mark.usefixtures("few_starts")
def test_without_a_region_with_linear_couplings_and_for_many_agents_nothing_is_searched():
    region = {"initial_states": [-4, 4]}
    assert equilibrium_check(listening_pair(reach=None)) is None
    assert equilibrium_check(cycle(3, h="y", region=region)) is None
    assert equilibrium_check(cycle(61, h="sin(y)", region=region)) is None


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_roots_are_roots_of_the_field_and_none_is_the_target(seed: int, m: int):
    """Weights, exceptions, matrix gains, offsets; the field is written out arc by arc."""
    problem = random_folded(seed, m=m)
    rng = np.random.default_rng(seed)
    points = rng.uniform(-6, 6, (20, problem.n * m))
    roots = list(find_roots(loop_of(problem), "G", points))
    for root in roots:
        residual = np.max(np.abs(field(problem, "G", root)))
        size = np.max(np.abs(root))
        allowed = 1e-9 * (1 + size)
        assert residual < allowed
        assert np.max(np.abs(root)) > 1e-4
    gaps = []
    for k, a in enumerate(roots):
        for b in roots[:k]:
            gaps.append(np.max(np.abs(a - b)))
    assert not gaps or min(gaps) > 1e-7


@pytest.mark.usefixtures("few_starts")
@pytest.mark.parametrize("unit", ["1e-9", "1e9"])
def test_the_unit_of_the_states_does_not_matter(unit: str):
    """sin(y/unit) unit: the same problem in other units."""
    problem = listening_pair(f"{unit}*sin(y/{unit})", reach=F(unit) * 5)
    e = start_of(equilibrium_check(problem))
    difference = abs(e[1] - e[0]) / F(unit)
    gap = abs(difference - 2 * SADDLE)
    assert gap < F(1, 10**5)


def test_a_numerical_library_that_breaks_down_costs_the_answer_only(monkeypatch, caplog):
    def broken(*arguments):
        raise np.linalg.LinAlgError("no convergence")

    monkeypatch.setattr("dobc_design.conditions.equilibrium.propose.find_roots", broken)
    assert equilibrium_check(listening_pair()) is None
    assert "no convergence" in caplog.text


@pytest.mark.usefixtures("few_starts")
def test_close_to_the_edge_of_the_region_a_smaller_box_is_taken():
    """The region ends 1e-6 beyond the saddle; the usual box of 1e-5 would leave it."""
    reach = SADDLE + F(1, 10**6)
    check = equilibrium_check(listening_pair(reach=F(f"{float(reach):.12f}")))
    lo, hi = map(F, check.exact["box"][0])
    assert hi - lo <= F(1, 10**6)
