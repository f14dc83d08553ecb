"""Search beside a certificate: suspects refute nothing, proved equilibria do, certified sets are
never contradicted."""

from dataclasses import replace
from functools import cache

import pytest
from matplotlib.figure import Figure
from networks import linked
from regional_problems import half_difference, listening_pair

import dobc_design as dd
from dobc_design import Check, Verdict
from dobc_design.conditions.reason import Reason
from dobc_design.falsification.falsify import Searched
from dobc_design.falsification.suspect import RESTS, STAYS_AWAY
from dobc_design.report.document import Text
from dobc_design.report.figures import plot_search
from dobc_design.report.pictures import search_picture, search_sheet
from dobc_design.report.region_words import (
    WARNING,
    equilibrium_sentences,
    found_sentence,
    search_sections,
)

RUNS, pytestmark = 24, pytest.mark.slow  # one search of a few seconds serves most of them


@cache
def found() -> Searched:
    """Of the pair that listens to each other, sin, k = 1/10, starts in [-5, 5]."""
    return dd.falsify(dd.certify(listening_pair()), runs=RUNS)


@cache
def overlooked() -> dd.Certificate:
    """The same certificate without its refutation, as if the quick search had missed it."""
    certificate = found().certificate
    checks = tuple(check for check in certificate.checks if check.id != "equilibrium")
    claims = replace(
        certificate.claims, checks=checks, verdict=Verdict.UNDECIDED, why=Reason(head="so far.")
    )
    return replace(certificate, claims=claims)


def test_nothing_that_is_certified_is_contradicted_by_the_search():
    """Starts on the boundary of the certified box; it ends before |e|_inf = 1.65387."""
    certified = found().searches[1]
    assert certified.target == "the boundary of the max-separable set"
    assert certified.suspects == ()
    assert certified.proved == ()
    assert certified.observed_rate >= certified.certified_rate
    box = found().certificate.check("max-separable").domain.radius
    assert box < float(half_difference(3.3))
    assert "No suspect was found, which proves nothing." in found_sentence(certified)
    assert Text(WARNING, "warning") not in search_sections([certified])[0].blocks


def test_a_proved_equilibrium_refutes_what_was_undecided_and_both_programs_agree():
    after = dd.falsify(overlooked(), runs=RUNS).certificate
    assert after.verdict is Verdict.REFUTED
    assert after.checks[:-1] == overlooked().checks
    assert dd.verify(after, listening_pair()).holds


def test_a_suspect_alone_refutes_nothing(monkeypatch):
    """Twin: the same runs, but no equilibrium is proved."""
    region = found().searches[0]
    runs = tuple(each for each in region.suspects if each.kind == STAYS_AWAY)
    assert runs
    bare = replace(region, suspects=runs, proved=(), check=None)
    monkeypatch.setattr(
        "dobc_design.falsification.falsify.search_starts", lambda *args, **settings: bare
    )
    after = dd.falsify(overlooked(), runs=RUNS)
    assert after.certificate == overlooked()
    assert Text(WARNING, "warning") in search_sections([bare])[0].blocks
    assert "refutes nothing" in WARNING
    assert equilibrium_sentences(bare) == []


def test_a_proof_is_not_shaken_by_a_check_from_the_search(monkeypatch):
    """Both cannot be true; what is decided stays."""
    proved = dd.certify(listening_pair(reach=0.5))
    contradicting = found().searches[0]
    monkeypatch.setattr(
        "dobc_design.falsification.falsify.search_starts", lambda *args, **settings: contradicting
    )
    assert isinstance(contradicting.check, Check)
    after = dd.falsify(proved).certificate
    assert after.verdict == proved.verdict
    assert after.checks == proved.checks


def test_without_an_observer_gain_nothing_is_searched():
    region = {"initial_states": [-5, 5], "initial_disturbance": 1}
    unseen = dd.Exosystem(A=[[0]], C=[[0]])
    arcs = [[1, 2], [2, 1]]
    problem = linked(arcs, coupling="sin(y)", gains="1/10", exosystem=unseen, region=region)
    assert dd.falsify(dd.certify(problem)).searches == ()


def test_proved_equilibria_are_solid_and_suspects_are_dashed():
    region, certified = found().searches
    ax = plot_search(Figure().add_subplot(), region)
    solid = [line for line in ax.lines if line.get_linestyle() == "-"]
    assert len(solid) == sum(suspect.kind == RESTS for suspect in region.suspects)
    levels = {round(float(line.get_ydata()[0]), 3) for line in solid}
    assert levels == {1.654, 2.99}
    assert "rests there (proved)" in search_picture(region, 0, unit="m").alt
    assert search_picture(certified, 1, unit="m") is None
    assert search_sheet([certified]) is None
