"""The tables of a problem file as they are read, or what is wrong with them: which key, what it
must be, and a line to copy."""

import re
from collections.abc import Mapping
from difflib import get_close_matches
from types import SimpleNamespace
from typing import Any

from dobc_design.errors import MOST_ERRORS, Mistakes, SpecError, wrong
from dobc_design.exact.reading import named, shown

from .schema import EXAMPLES, FORMS, TABLES, below, known_keys


class Given(SimpleNamespace):
    """A table: under each key that it may have what the file gives, None where it gives nothing."""


def tables_of(document: Any) -> Any:
    """All tables of a file.  Values are read by the nouns; numbers stay as they were typed until
    then.  Raises: SpecError with the first twenty mistakes."""
    errors = Mistakes()
    found = _read(document, "", errors)
    if errors:
        raise SpecError.several(errors[:MOST_ERRORS])
    return found


def _read(given: Any, place: str, errors: Mistakes) -> Given | None:
    """The table at a place of the file, such as exosystem.groups[0]."""
    name = _without_places(place)
    if not isinstance(given, Mapping):
        errors.append(_wrong_kind(place, "table", given))
        return None
    found = dict.fromkeys(known_keys(name))
    mistakes = Mistakes()
    for key, (form, *_) in TABLES[name]["keys"].items():
        value, own = given.get(key), below(place, key)
        if key not in given:
            if key in TABLES[name].get("needed", ()):
                mistakes.append(wrong(own, "is required and missing.", _example(own)))
        elif form == "table":
            found[key] = _read(value, own, mistakes)
        elif form == "tables" and isinstance(value, list):
            found[key] = [_read(each, f"{own}[{k}]", mistakes) for k, each in enumerate(value)]
        elif form == "tables":
            mistakes.append(_wrong_kind(own, "list of tables", value))
        elif FORMS[form].get("type") == "object" and not isinstance(value, Mapping):
            mistakes.append(_wrong_kind(own, "table", value))
        else:
            found[key] = value
    mistakes += [_unknown_key(place, str(key)) for key in given if key not in found]
    # All that stands in a table in place of its main key is one mistake.
    errors += mistakes[: None if _main_key(name) is None else 1]
    return Given(**found)


def _wrong_kind(key: str, kind: str, value: object) -> SpecError:
    return wrong(key, f"must be a {kind}; got {shown(value)}.", _example(key))


def _example(key: str) -> str:
    return f"Write {EXAMPLES.get(_without_places(key), f'[{key}] and its keys below')}."


def _without_places(key: str) -> str:
    """The key without the places in lists: exosystem.groups.A."""
    return re.sub(r"\[\d+\]", "", key)


def _unknown_key(table: str, name: str) -> SpecError:
    """Says which key may be meant, or in which table it belongs."""
    key = below(table, named(name))
    what = f"is an unknown key in [{table}]" if table else "is an unknown key"
    known = known_keys(_without_places(table))
    place = f" in [{table}]" if table else ""
    cure = f"Known keys{place}: {', '.join(known)}."
    if name in known_keys(""):
        head = f"Write [{name}] as the head of a table of its own."
        cure = head if name in TABLES else "Write it above the first table."
        return wrong(key, f"{what}; it belongs to the top of the file.", cure)
    # Other capitals first: for difflib "a" and "A" have nothing in common.
    near = [other for other in known if other.lower() == name.lower()]
    near += get_close_matches(name[:100], known, n=1, cutoff=0.7)
    if near:
        return wrong(key, f'{what}; did you mean "{near[0]}"?', cure)
    main = _main_key(_without_places(table))
    if main is not None:
        cure = f"Write {EXAMPLES.get(f'{table}.{main}', main)}."
        return wrong(key, f"{what}, where {main} is written.", cure)
    homes = [f"[{home}]" for home in TABLES if home and name in known_keys(home)]
    if homes:
        return wrong(key, f"{what}; it belongs in {' or '.join(homes)}.", cure)
    return wrong(key, f"{what}.", cure)


def _main_key(table: str) -> str | None:
    """What is meant by other keys of a table; None where it may be one of several."""
    known = known_keys(table)
    return known[0] if len(known) == 1 or table == "pinning" else None
