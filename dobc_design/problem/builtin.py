"""The problems shipped with the package, by name."""

from __future__ import annotations

from importlib.resources import files

SUFFIX = ".toml"


def builtin_names() -> tuple[str, ...]:
    """Names of the built-in problems, in the order they are best read."""
    folder = files("dobc_design.problems")
    names = sorted(item.name[: -len(SUFFIX)] for item in folder.iterdir() if item.name.endswith(SUFFIX))
    first = [name for name in ("paper-fixed", "paper-switching") if name in names]
    return (*first, *(name for name in names if name not in first))


def builtin_text(name: str) -> str:
    """The problem file of that name, as text."""
    return (files("dobc_design.problems") / f"{name}{SUFFIX}").read_text(encoding="utf-8")


def builtin_summary(name: str) -> str:
    """The first sentence of the comment a built-in problem opens with."""
    lines = []
    for line in builtin_text(name).splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").strip())
    text = " ".join(lines)
    return text.split(". ", 1)[0].rstrip(".") + "."
