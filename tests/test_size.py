"""``tests/size.py`` counts what it says, on made-up sources."""

import importlib.util
import subprocess
import sys

from house import ROOT, House

PROGRAM = ROOT / "tests" / "size.py"
_spec = importlib.util.spec_from_file_location("size", PROGRAM)
size = importlib.util.module_from_spec(_spec)
sys.modules["size"] = size
_spec.loader.exec_module(size)

MADE_UP = '''\
"""A docstring
of two lines."""

# Why this number.
LIMIT = 3  # and a word beside it


def wide(a, b, c, d, /, e, f, *, g, h):
    """Another docstring."""
    return a + "a text that is no docstring"


def narrow(a, b, c, d, e, f, g):
    "One more."
'''


def test_tokens_statements_comments_and_wide_functions_of_a_made_up_file():
    found = size.size_of(MADE_UP)
    # LIMIT = 3, then "def wide(...):" with 9 commas and 10 names and marks between two brackets,
    # "return a + text", "def narrow(...):" with 6 commas and 7 names
    assert found.tokens == 3 + (2 + 2 + 10 + 9 + 1) + 4 + (2 + 2 + 7 + 6 + 1)
    assert found.statements == 4  # LIMIT, wide, its return, narrow: no docstring
    assert found.code_lines == 4
    assert found.comment_lines == 2
    assert found.wide_functions == 1
    assert found.modules == 1


def test_a_file_of_the_proofs_that_names_a_leader_is_listed_and_one_of_problem_is_not():
    sources = {
        "conditions.lure.claim": "def f(problem):\n    return problem.leader or problem.dynamics",
        "certificate.text": "def f(loop):\n    return loop.rows",
        "problem.leader": "def f(problem):\n    return problem.leader",
    }
    listed = list(size.knows_kinds_of_network(House(sources)))
    assert listed == ["conditions.lure.claim: .dynamics, .leader"]


def test_rooms_are_added_up_with_topics_apart():
    sources = {"errors": "a = 1", "conditions.lure.claim": "a = 1", "conditions.lure.decide": "b"}
    rooms = size.rooms_of_package(House(sources))
    assert {name: room.tokens for name, room in rooms.items()} == {"(top)": 3, "conditions/lure": 4}


def test_the_standard_library_is_enough():
    """-S leaves the packages of the set-up out.  The table itself takes seconds, so only one row is
    made."""
    asked = "import runpy, sys; print(runpy.run_path(sys.argv[1])['size_of']('a = 1').row('room'))"
    command = [sys.executable, "-I", "-S", "-c", asked, str(PROGRAM)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["room", "3", "3.0", "0.0", "1", "0"]
