"""A time limit ends what runs, and what was cut says so: in its own reason and in the first
sentence."""

import time
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import pytest

import dobc_design as dd
from dobc_design.certificate.text import certificate_bytes
from dobc_design.certification.overall import decide_overall
from dobc_design.certification.recheck import agreed
from dobc_design.checker import examine as checker
from dobc_design.checker.curves import throughout
from dobc_design.checker.loop import points
from dobc_design.conditions.check import cut_check
from dobc_design.exact.work import last_call, seconds_left, until
from dobc_design.loop.make import loop_of
from dobc_design.problem.canonical import canonical_bytes

ZERO, ONE = Fraction(0), Fraction(1)


def agents_with_states(count: int, slope: str = "sin(x{next})-x{own}**3") -> dict[str, object]:
    """Two agents of so many states, each driven by the next one."""
    inner = [slope.format(own=k, next=k + 1) for k in range(1, count)]
    f = [*inner, f"x1-x{count}**3"]
    modes = {"m": [[2, 1]]}
    dynamics = {"dynamics": {"f": f}}
    return {"agents": 2, "modes": modes, "gains": "100", "more": dynamics, "region": True}


def many_modes(count: int) -> dict[str, object]:
    """A ring of three agents whose last arc has another weight in every mode."""
    modes = {}
    for k in range(count):
        modes[f"m{k}"] = [[2, 1], [3, 2], [1, 3, k + 1]]
    return {"agents": 3, "modes": modes, "gains": "{1=3}", "h": "tanh(y)", "region": True}


def turns(count: int) -> dict[str, object]:
    """Three agents, of whom one is not reached in each of two modes that follow each other."""
    sequence = ["A", *["A", "B"] * (count // 2)]
    switching = {"guarantee": "sequence", "dwell": 0.1, "sequence": sequence}
    modes = {"A": [[2, 1]], "B": [[3, 2]]}
    return {
        "agents": 3,
        "modes": modes,
        "gains": "{1=3}",
        "more": {"switching": switching},
        "h": "tanh(y)",
        "region": True,
    }


def written(folder: Path, own: dict[str, object]) -> Path:
    """The problem file."""
    modes = "\n".join(f'"{name}" = {arcs}' for name, arcs in own["modes"].items())
    text = f'[network]\nagents = {own["agents"]}\narrow = "listens_to"\n[network.modes]\n{modes}\n'
    text += f'[coupling]\nh = "{own.get("h", "y")}"\n[pinning]\ngains = {own["gains"]}\n'
    for table, keys in own.get("more", {}).items():
        text += f"[{table}]\n" + "".join(
            f"{key} = {str(x) if not isinstance(x, str) else repr(x)}\n" for key, x in keys.items()
        )
    text += "[region]\ninitial_states = [-1, 1]\n" if own["region"] else ""
    (folder / "problem.toml").write_text(text, encoding="utf-8")
    return folder / "problem.toml"


@pytest.mark.parametrize(
    "own", [agents_with_states(30), many_modes(60), turns(100)], ids=["states", "modes", "turns"]
)
def test_what_the_time_limit_cuts_is_named_first_and_nothing_is_said_to_fail(own, tmp_path: Path):
    problem = dd.load_problem(written(tmp_path, own))
    certificate = dd.certify(problem, time_limit="1e-3")
    assert certificate.verdict is dd.Verdict.UNDECIDED
    assert certificate.reason.startswith(
        "Undecided: time ran out. The time limit of 0.001 s ended before "
    )
    cut = [check for check in certificate.checks if "time limit" in check.reason]
    assert {"max-separable", "schedule"} & {check.id for check in cut}
    reasons = [certificate.reason, *(check.reason for check in cut)]
    told = " ".join(reasons)
    for words in ("no pin", "not found", "found", "not reach"):
        assert words not in told
    assert dd.verify(certificate, problem).holds


def test_what_is_cut_for_its_work_is_named_first(tmp_path: Path):
    problem = dd.load_problem(written(tmp_path, turns(4)))
    lure = cut_check("lure", "consensus", "cut off.")
    delay = cut_check("delay", "consensus", "cut off.")
    checks = [lure, delay]
    found = decide_overall(loop_of(problem), checks, None)
    assert found.reason.startswith(
        "Undecided: work ran out. lure would take too long for a problem of this size"
    )
    assert "delay" not in found.reason  # it decides nothing


def test_a_longer_search_is_named_where_there_is_one(tmp_path: Path):
    problem = dd.load_problem(written(tmp_path, turns(4)))
    for longer in (True, False):
        checks = [cut_check("lure", "consensus", "cut off.", longer=longer)]
        told = decide_overall(loop_of(problem), checks, None).reason
        assert told.endswith("`dobc certify --all` searches longer.") is longer


def test_a_clock_inside_another_ends_with_the_earlier_of_both():
    assert seconds_left() == float("inf")
    assert last_call() is None
    with until(100.0):
        assert 99 < seconds_left() <= 100
        with until(1000.0):
            assert seconds_left() <= 100
        with until(1.0):
            assert seconds_left() <= 1
            assert last_call() == pytest.approx(time.monotonic() + 1.1, abs=0.5)


def test_the_second_program_examines_no_claim_after_its_time_and_the_certificate_says_so():
    certificate = dd.certify("clock-sync")
    claims, problem = certificate.claims, certificate.problem
    data, document = certificate_bytes(claims), canonical_bytes(problem)
    assert checker.examine(data, document, until=0.0) == []
    assert len(checker.examine(data, document)) == len(claims.checks) + 4
    with until(1e-9):
        time.sleep(1e-3)
        found = agreed(claims, problem)
    assert found.verdict == claims.verdict
    assert found.checks == claims.checks
    assert found.notes[-1].startswith("Time ran out before the second checker was asked about ")
    assert agreed(claims, problem).notes == claims.notes


def test_a_point_at_which_a_function_is_not_shown_is_not_halved():
    asked = []

    def at(*sides):
        asked.append(sides)
        return ((-ONE, -ONE), ())

    corners = [(ZERO, ZERO), (ONE, ONE)]
    assert not points(SimpleNamespace(at=at), 1, corners)
    assert len(asked) == 1


def test_a_row_that_fails_at_zero_is_refused_before_the_floats_end():
    asked = []
    assert not throughout(1.0, lambda a, b: bool(asked.append(a)))
    assert 200 <= len(asked) <= 205
    # far below what rounding leaves of any row
    assert throughout(1.0, lambda a, b: b <= 2.0**-150 or a > 0)
