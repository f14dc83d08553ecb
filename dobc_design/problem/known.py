"""What excludes what in a problem, and which part of the program knows what of it.

Both are tables, ``known.toml``: a combination that a proof or a part learns is a line less there.
It looks at a problem through the paths that these name, and knows no class of it.
"""

from typing import Any

from dobc_design._files import own_table
from dobc_design.errors import Mistakes, about, wrong
from dobc_design.exact.reading import named

from .region import GOALS

_TABLES = own_table("problem/known.toml")


def _has(problem: Any, path: str, value: str = "") -> bool:
    """Whether a problem has something at the path of an attribute, or this value there."""
    found: Any = problem
    for name in path.split("."):
        # A name that is no attribute is a slip in the table, and ends here.
        found = None if found is None else getattr(found, name)
    if path == "target":
        return any(problem.target)  # 0 is none
    return found == value if value else bool(found)


def check_together(problem: Any) -> None:
    """Refuse what does not go together.  Raises: SpecError with all that does not."""
    labels = problem.network.labels
    ends = (problem.signs and problem.signs.breaks) or ()
    names = dict(zip(("listener", "speaker"), (named(labels[i]) for i in ends), strict=False))
    errors = Mistakes()
    for about_such, rules in _TABLES["together"].items():
        is_such = about_such == problem.goal if about_such in GOALS else _has(problem, about_such)
        if not is_such:
            continue
        for rule in rules:
            if "lacks" in rule and _has(problem, rule["lacks"]):
                continue
            for key in rule["keys"]:
                with errors:
                    if _has(problem, rule.get("has", key), rule.get("value", "")):
                        raise wrong(key, rule["what"].format(**names), rule["cure"])
    errors.raise_all()


def require(problem: Any, what: str) -> None:
    """Refuse a problem with something that ``what``, a part of the program, does not know.  Raises:
    SpecError."""
    for path in _TABLES["unknown"][what]:
        if _has(problem, path):
            told = _TABLES["refused"][path]
            key = told["key"].format(loose=named(problem.network.loose or ""))
            raise about(key, told["what"].format(what=what), told["cure"])
