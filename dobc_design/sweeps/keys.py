"""Key paths of a problem file, and values put in their places.

``pinning.gains.1``, ``coupling.h``, ``exosystem.A[0][1]``, ``pinning.gains."s 1"``: names between dots, in quotes
where they hold other characters, and places of lists, from 0, in brackets.  A document is what a problem file
holds, tables as dictionaries.
"""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Mapping
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.reading import shown

Path = tuple[str | int, ...]

_PART = re.compile(
    r"""(?:(?P<dot>\.)?(?:(?P<bare>[^\s."'\[\],=]+)|(?P<quoted>"(?:[^"\\]|\\.)*"))|\[(?P<place>\d{1,9})\])"""
)
_LONGEST = 500
_EXAMPLE = "For example pinning.gains.1, coupling.h or exosystem.A[0][1]."


def split_axis(text: str) -> tuple[str, str]:
    """Split "KEY=VALUES" at the first "=" outside quotes.  Raises: SpecError."""
    inside = False
    for place, character in enumerate(text):
        if character == '"':
            inside = not inside
        elif character == "=" and not inside:
            return text[:place].strip(), text[place + 1 :].strip()
    raise SpecError(
        f"what is varied must be given as KEY=VALUES; got {shown(text)}.",
        key=text[:60],
        cure="For example pinning.gains.1=1:5:9.",
    )


def read_keys(text: str) -> tuple[Path, ...]:
    """The key paths of an axis: one, or several that get the same value, separated by commas.  Raises: SpecError."""
    paths = []
    rest = text.strip()
    while True:
        path, rest = _read_path(rest, whole=text)
        paths.append(path)
        if not rest:
            break
        rest = rest[1:].strip()
    if len(set(paths)) < len(paths):
        raise SpecError(f"{shown(text)} names a key twice.", key=text[:60], cure="Name each key once.")
    return tuple(paths)


def _read_path(text: str, *, whole: str) -> tuple[Path, str]:
    """One path from the beginning of ``text``, and what follows: nothing, or a comma and more."""
    parts: list[str | int] = []
    place = 0
    while (found := _PART.match(text, place)) is not None:
        named = found["place"] is None
        if named and (found["dot"] is None) is not (not parts):  # a dot stands between names, and only there
            break
        parts.append(_name(found) if named else int(found["place"]))
        place = found.end()
    rest = text[place:].strip()
    if not parts or isinstance(parts[0], int) or (rest and not rest.startswith(",")) or len(whole) > _LONGEST:
        raise SpecError(
            f"{shown(whole)} is no key of a problem file: names between dots, places of lists in brackets.",
            key=whole[:60],
            cure=_EXAMPLE,
        )
    return tuple(parts), rest


def _name(found: re.Match[str]) -> str:
    if found["bare"] is not None:
        return found["bare"]
    try:
        return str(json.loads(found["quoted"]))  # TOML's basic strings escape as JSON's do
    except ValueError:
        raise SpecError(f"{shown(found['quoted'])} is no quoted name.", key="key", cure=_EXAMPLE) from None


def path_text(path: Path) -> str:
    """The path as it is typed."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = re.fullmatch(r"[^\s.\"'\[\],=]+", part) is not None
            text += ("." if text else "") + (part if plain else json.dumps(part, ensure_ascii=False))
    return text


def with_changes(document: Mapping[str, Any], changes: Mapping[Path, Any]) -> dict[str, Any]:
    """A copy of the document with these places set; None removes a key.  Tables on the way are made.

    Raises: SpecError where a path leads through something that is no table and no list.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(document))
    for path, value in changes.items():
        _set(changed, path, copy.deepcopy(value))
    return changed


def _set(document: dict[str, Any], path: Path, value: Any) -> None:
    inner: Any = document
    for depth, part in enumerate(path[:-1]):
        if isinstance(inner, dict) and isinstance(part, str):
            if part not in inner:
                if value is None:
                    return
                inner[part] = [] if isinstance(path[depth + 1], int) else {}
            inner = inner[part]
        else:
            inner = _entry(inner, path, depth)
    last = path[-1]
    if isinstance(inner, dict) and isinstance(last, str):
        if value is None:
            inner.pop(last, None)
        else:
            inner[last] = value
    elif isinstance(inner, list) and isinstance(last, int) and last == len(inner) and value is not None:
        inner.append(value)  # such as the weight of an arc [a, b]
    else:
        _entry(inner, path, len(path) - 1)
        if value is None:
            del inner[last]
        else:
            inner[last] = value


def _entry(inner: Any, path: Path, depth: int) -> Any:
    """The entry of a list that the part of the path at ``depth`` names.  Raises: SpecError."""
    part, so_far = path[depth], path_text(path[:depth])
    if isinstance(inner, list) and isinstance(part, int):
        if part < len(inner):
            return inner[part]
        raise SpecError(
            f"{path_text(path)}: {so_far} has {len(inner)} entries, counted from 0; got place {part}.",
            key=path_text(path),
            cure="Name a place that is there, or the next one.",
        )
    kind = "a table" if isinstance(inner, dict) else "a list" if isinstance(inner, list) else shown(inner)
    cure = "Name a place, such as [0]." if isinstance(inner, list) else "Name a key of it."
    if not isinstance(inner, (dict, list)):
        cure = f"Vary {so_far} itself, or write it as a table in the problem file."
    raise SpecError(
        f"{path_text(path)}: {so_far} is {kind}, which has no {shown(part)}.", key=path_text(path), cure=cure
    )
