"""The package's docstrings are plain text; here they become reStructuredText.

An entry ``    name: what it is`` below a line that ends with a colon becomes an item of a list;
``Returns:``, ``Raises:`` and ``Source:`` begin a paragraph, also after a sentence; every sign that
reStructuredText would read as markup is taken as it stands, except in double backticks.
"""

from __future__ import annotations

import re

from sphinx.application import Sphinx

_LITERAL = re.compile(r"(``.+?``)")
_MARKUP = re.compile(r"([\\*|`_])")
_ENTRY = re.compile(r"^ {4}(\S[^:]{0,60}): (.*)$")
_SECTION = re.compile(
    r"^(Returns|Raises|Source|Shape|Units|Parameters[^:]*|Fields[^:]*|Example)s?:\s*(.*)$"
)
_INSIDE = re.compile(r"(?<=\.) +(?=(?:Returns|Raises|Source|Units): )")


def escaped(text: str) -> str:
    """Text without markup."""
    parts = _LITERAL.split(text)
    return "".join(part if part.startswith("``") else _MARKUP.sub(r"\\\1", part) for part in parts)


def as_restructured(lines: list[str]) -> list[str]:
    """The lines of one docstring."""
    result: list[str] = []
    code = False
    for line in (part for each in lines for part in _INSIDE.split(each)):
        if not line.strip():
            result.append("")
            code = False
            continue
        entry, section = _ENTRY.match(line), _SECTION.match(line)
        indent = len(line) - len(line.lstrip())
        if section:
            result += ["", f"**{section[1]}:** {escaped(section[2])}"]
        elif entry and not code and not entry[1].startswith(">>>"):
            result += ["", f"* **{escaped(entry[1])}**: {escaped(entry[2])}"]
        elif indent >= 4 and (code or not _in_entry(result)):
            result += [] if code else ["", "::", ""]
            result.append(line)
            code = True
        elif indent:
            result.append("  " + escaped(line.strip()))
        else:
            if result and (code or _in_entry(result)):
                result.append("")
            result.append(escaped(line))
            code = False
    return result


def _in_entry(result: list[str]) -> bool:
    """Whether the last paragraph is an item of a list."""
    for line in reversed(result):
        if line.startswith("* "):
            return True
        if not line.startswith("  "):
            return False
    return False


def convert(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Change the lines in place, as sphinx wants it."""
    lines[:] = as_restructured(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by sphinx."""
    app.connect("autodoc-process-docstring", convert)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
