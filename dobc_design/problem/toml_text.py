"""From the bytes of a problem file to tables: TOML with bounds on size and nesting, numbers kept as text.

Whatever the bytes are, the time is linear in their number: strings are skipped without backtracking, and
nesting is counted before the TOML parser, which is recursive and quadratic in it, sees the text.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dobc_design.errors import SpecError
from dobc_design.exact.reading import NumberText, shown

MAX_BYTES = 16 * 1024 * 1024
MAX_NESTING = 50
PIECE = 16 * 1024 * 1024
PROBLEM = "problem file"

# Strings and comments; possessive, so that no byte is looked at twice. A string that is not closed reaches
# to the end (of the line): the parser stops there anyway.
_TEXTS = re.compile(
    rb'"""(?:[^"\\]++|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    rb"|'''(?:[^']++|'(?!''))*+(?:'{3,5}|\Z)"
    rb'|"(?:[^"\\\n]++|\\.)*+"?'
    rb"|'[^'\n]*+'?"
    rb"|#[^\n]*+",
    re.DOTALL,
)
_DOTTED_KEY = re.compile(rb"[A-Za-z0-9_\-' \t.]++")
_BRACKET = re.compile(rb"[\[\]{}]")


def read_bytes(path: Path, *, limit: int = MAX_BYTES, what: str = PROBLEM) -> bytes:
    """Read a regular file of at most ``limit`` bytes; ``what`` it ought to be is for messages.

    Raises: SpecError that names the file.  Pipes and devices are refused: they may never end, or never begin.
    """
    name = shown(path.name)
    try:
        # Not blocking, so that a pipe nobody writes to is opened and then refused.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        try:
            kind = _kind(os.fstat(descriptor).st_mode)
            data = b"" if kind else _read_at_most(limit + 1, descriptor)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        known = " and no built-in problem of that name" if what == PROBLEM else ""
        cure = "`dobc problems` lists the built-in ones." if known else "Check the path."
        raise SpecError(f"there is no file {name}{known}.", key=path.name, cure=cure) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        kind = "folder" if os.path.isdir(path) else ""  # Windows does not open folders
        if not kind:
            reason = getattr(error, "strerror", None) or error
            raise SpecError(f"{name} cannot be read: {reason}.", key=path.name, cure="Check the path.") from None
    if kind:
        cure = "Name the file in it." if kind == "folder" else "Write it to a file first."
        raise SpecError(f"{shown(str(path))} is a {kind}, not a {what}.", key=path.name, cure=cure)
    if len(data) > limit:
        raise _too_large(limit, what)
    return data


def _read_at_most(count: int, descriptor: int) -> bytes:
    """Up to ``count`` bytes.  In pieces, so that memory is taken for what is there, not for what may be."""
    with os.fdopen(descriptor, "rb", closefd=False) as stream:
        pieces = []
        while count > 0 and (piece := stream.read(min(count, PIECE))):
            pieces.append(piece)
            count -= len(piece)
    return b"".join(pieces)


def _kind(mode: int) -> str:
    """What is no regular file, in a word; "" for a file."""
    kinds = {stat.S_IFREG: "", stat.S_IFDIR: "folder", stat.S_IFIFO: "pipe"}
    return kinds.get(stat.S_IFMT(mode), "device")


def parse_toml(data: bytes) -> dict[str, Any]:
    """Parse TOML; numbers with a point or an exponent stay text.  Raises SpecError."""
    if len(data) > MAX_BYTES:
        raise _too_large(MAX_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"the problem file must be UTF-8 text; byte {error.start} is not."
        raise SpecError(what, cure="Save it as UTF-8.") from None
    if not text.strip():
        what = "the problem file is empty."
        raise SpecError(what, key="network", cure="Copy a built-in one to start from: `dobc problems`.")
    _check_nesting(data)
    try:
        document = tomllib.loads(text, parse_float=NumberText)
    except RecursionError:
        raise _too_deep() from None
    except tomllib.TOMLDecodeError as error:
        what = f"the problem file is not valid TOML: {error}."
        raise SpecError(what, cure="Look at that line: a missing quote or bracket, or a key given twice.") from None
    except ValueError:  # Python refuses to read a whole number of more than 4300 digits
        what = "the problem file holds a whole number of thousands of digits."
        raise SpecError(what, cure="Numbers have at most 200 digits.") from None
    _check_depth(document)
    return document


def _check_nesting(data: bytes) -> None:
    bare = _TEXTS.sub(b"''", data)
    depth = 0
    for match in _BRACKET.finditer(bare):
        depth = depth + 1 if match.group() in b"[{" else max(0, depth - 1)
        if depth > MAX_NESTING:
            raise _too_deep()
    if any(match.group().count(b".") >= MAX_NESTING for match in _DOTTED_KEY.finditer(bare)):
        raise _too_deep()


def _check_depth(document: Mapping[str, Any]) -> None:
    level: list[Any] = [document]
    for _ in range(MAX_NESTING + 1):
        deeper: list[Any] = []
        for value in level:
            children = value.values() if isinstance(value, dict) else value
            deeper.extend(child for child in children if isinstance(child, (dict, list)))
        if not deeper:
            return
        level = deeper
    raise _too_deep()


def _too_large(limit: int, what: str = PROBLEM) -> SpecError:
    arcs = 'Keep long lists of arcs in a CSV file: Ga = { file = "arcs.csv" }.'
    cure = arcs if what == PROBLEM else "It is not one of ours."
    return SpecError(f"the {what} is too large: at most {limit} bytes are read.", cure=cure)


def _too_deep() -> SpecError:
    what = f"the problem file is nested too deeply: at most {MAX_NESTING} levels are read."
    return SpecError(what, cure="Flatten it.")
